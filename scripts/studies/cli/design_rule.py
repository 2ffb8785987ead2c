"""Find out where the design rule holds: the best simulated gap over the rule's, over damping, mass ratio and place."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click

from impact_env.ensemble import Executor
from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, workers
from optimisation.machine import sources
from optimisation.page import DOCS, published
from optimisation.progress import runs_bar
from optimisation.report.markdown import markdown
from studies import rule
from studies.rule import FRESH, Case, Row, price_at, row_of, verdicts
from studies.runner import run
from studies.study import Json, Measured, Part, Steps, Study, rows_by_case, with_page

NAME = "design_rule"
QUICK_OUT = Path("results/design_rule")
OUT = published(DOCS / "which_gap", QUICK_OUT)
MEMBERS, QUICK_MEMBERS = 2, 1
MARKERS = VERDICT, FRESH_CASES, MACHINE = "rule:verdict", "rule:fresh", "rule:machine"


class Settings(NamedTuple):
    """Runs for each point, whether it is a look only (no gaps halfway, no light damping), and threads (None: all cores) or an executor."""

    members: int
    quick: bool
    threads: int | None
    executor: Executor | None = None

    @property
    def told(self) -> Json:
        """What the numbers depend on, as the file holds it."""
        return {"members": self.members, "quick": self.quick}

    def keep(self, values: Json) -> Json:
        """Return the values of an earlier run with the same settings, else nothing."""
        return values if values.get("settings") == self.told else {}


def settings(quick: bool, members: int | None, threads: int | None, executor: Executor | None = None) -> Settings:
    """Return how much to simulate, and where."""
    return Settings(members or (QUICK_MEMBERS if quick else MEMBERS), quick, threads, executor)


def _run(case: Case, given: Settings) -> list[Json]:
    with runs_bar(case.key) as show:
        checks = rule.run_case(case, given.members, rule.STEPS, given.threads, show, given.executor, fine=not given.quick)
    if not all(check.complete for check in checks):
        raise KeyboardInterrupt
    return [asdict(row_of(case, checks))]


def _measure(given: Settings, known: Json) -> Steps:
    cases: dict[str, Callable[[], list[Json]]] = {case.key: partial(_run, case, given) for case in rule.cases(given.quick)}
    for values in rows_by_case(cases, lambda row: row["key"], known):
        yield {"settings": given.told, **values}


def table(rows: Sequence[Row]) -> str:
    """Return a line for each case."""
    what = ("case", "free amplitude over gap", "best gap over rule's", "expected")
    lines = []
    for row in rows:
        levels = (min(row.relative), row.relative[row.factors.index(1.0)], min(row.relative) * price_at(row, row.expected))
        lines.append((row.key, f"{row.reach:.3g}", f"{row.best:.2g}", f"{row.expected:.2g}", *(f"{100 * x:.1f}" for x in levels)))
    return markdown((*what, "level at the best, %", "at the rule's, %", "at the expected, %"), lines)


def _verdict_table(rows: Sequence[Row]) -> str:
    good = ("rule within 10 %", "expected within 10 %", "rule's worst, times", "expected's worst, times")
    header = ("free amplitude over gap", "cases", "best gap over rule's", "from", "to", *good)
    lines = [
        (
            v.label,
            *(f"{x:.2g}" for x in (v.cases, v.median, v.low, v.high)),
            str(v.good),
            str(v.expected),
            f"{v.worst:.2f}",
            f"{v.worst_expected:.2f}",
        )
        for v in verdicts(rows)
    ]
    return markdown(header, lines)


def sections(measured: Measured) -> dict[str, str]:
    """Return the verdict, the cases that nothing is fitted to so far, and where it was measured; all other cases are in the JSON file."""
    rows = [Row(**row) for row in measured.values["rows"]]
    fresh = [row for row in rows if row.varied == FRESH]
    return {VERDICT: _verdict_table(rows), FRESH_CASES: table(fresh) if fresh else "Not measured yet.", MACHINE: sources(measured.conditions)}


def said(measured: Measured) -> str:
    """Return a line for each class of cases."""
    return "\n".join(
        f"free amplitude over gap {v.label}: best gap {v.low:.2g} to {v.high:.2g} of the rule's, {v.cases} cases"
        for v in verdicts([Row(**row) for row in measured.values["rows"]])
    )


STUDY: Study[Settings] = Study(
    (
        Part(
            NAME,
            "where the design rule holds",
            measure=_measure,
            markers=MARKERS,
            sections=sections,
            whole=lambda given, values: len(values["rows"]) == len(rule.cases(given.quick)),
            said=said,
        ),
    ),
    kept="the same command goes on from here.",
)


@command()
@click.option("--quick", is_flag=True, help="A look: one member, no gaps halfway to the best, no damping below 0.5 %.")
@click.option(
    "--members",
    type=click.IntRange(min=1),
    help=f"Runs for each point, at most 1 below 0.2 % damping.  [default: {MEMBERS}, with --quick {QUICK_MEMBERS}]",
)
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder for the numbers.  [default: {OUT}, with --quick {QUICK_OUT}]",
)
@click.option("--redraw", is_flag=True, help="Write the page again from the numbers in the folder; nothing is computed.")
def main(quick: bool, members: int | None, threads: int | None, cluster: str | None, out: Path | None, redraw: bool) -> None:
    """Simulate the rule's gap and its neighbours on two beams, over damping, mass ratio and place of the absorber, and in ten cases kept apart.

    Writes design_rule.json.gz, and its tables into the page FOLDER.md beside the folder, if there is one.
    Ctrl-C keeps what is finished: the same command goes on from there.
    """
    with plain_errors(), workers(threads, None if redraw else cluster) as found:
        given = settings(quick, members, threads if found is None else None, found)
        run(STUDY, given, with_page(out or (QUICK_OUT if quick else OUT), MARKERS), redraw=redraw, keep=given.keep)
