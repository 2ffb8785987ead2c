"""Print what friction does to the paper's impact absorber: levels and branches of the members, with 1, 0.5 and 0.2 % damping."""

from __future__ import annotations

import click

from optimisation.command_line import plain_errors
from optimisation.evaluation import Threads
from optimisation.progress import runs_bar
from optimisation.report.markdown import markdown
from optimisation.studies.friction import CASES, rows

MEMBERS = 32
HEADER = ("damping, %", "gap over rule's", "muN, N", "level, %", "5 to 95 %", "branches")


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help="A look: the paper's damping only.")
@click.option("--members", type=click.IntRange(min=1), default=MEMBERS, show_default=True, help="Runs for each point.")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
def main(quick: bool, members: int, threads: int | None) -> None:
    """Print the table of docs/findings.md on friction; sweeps as slow as the damping asks for, so 0.2 % takes longest."""
    lines = []
    with plain_errors():
        try:
            for damping, gap in CASES[:1] if quick else CASES:
                with runs_bar(f"damping {100 * damping:g} %") as show:
                    for r in rows(damping, gap, members, Threads(threads), progress=show):
                        told = "one" if r.branches is None else r.branches.text(100, " %")
                        cells = (
                            f"{100 * r.damping:g}",
                            f"{r.gap:g}",
                            f"{r.limit:g}",
                            f"{100 * r.median:.1f}",
                            f"{100 * r.low:.1f} to {100 * r.high:.1f}",
                        )
                        lines.append((*cells, told))
        finally:
            click.echo(markdown(HEADER, lines))


if __name__ == "__main__":
    main()
