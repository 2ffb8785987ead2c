"""Harmonic balance beside the exact orbit: error over harmonics and weight, and what a branch takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from impact_env.parameters import RigidWalls
from impact_env.periodic.balance_error import COLUMNS
from optimisation.command_line import check_target, end_early, json_option, name_files, plain_errors
from optimisation.commands.balance_rows import computed
from optimisation.commands.frequency_curves import FIGURES
from optimisation.files import replacing, write_csv, write_json
from optimisation.report.balance_table import text


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 130})
@click.option("--modes", type=int, default=3, show_default=True, help="Number of modes of the paper's beam.")
@click.option("--friction-limit", type=float, default=0.01, show_default=True, help="Friction limit in N; 0: no friction.")
@click.option("--gap", type=float, default=RigidWalls.gap, show_default=True, help="Clearance to either wall in m.")
@click.option("--force", type=float, default=1.5, show_default=True, help="Amplitude of the harmonic force in N.")
@click.option("--at", type=float, default=0.95, show_default=True, help="Frequency over the first resonance's at which displacements are compared.")
@click.option("--from", "start", type=float, default=0.85, show_default=True, help="Lowest frequency of the branch over the first resonance's.")
@click.option("--to", "stop", type=float, default=1.1, show_default=True, help="Highest frequency of the branch over the first resonance's.")
@click.option("--harmonics", default="10,20,40", show_default=True, help="Highest harmonics, with commas between.")
@click.option("--weights", default="50,100,200", show_default=True, help="Weights of the contact in m_a omega_1^2, with commas between.")
@click.option("--growing", is_flag=True, help="Weights are those at 20 harmonics and grow with the square of their number.")
@click.option("--branches/--no-branches", default=True, show_default=True, help="Follow and time the branch at each setting too.")
@json_option("Write the rows.")
@click.option("--csv", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write the rows.")
@click.option(
    "--figure", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw errors and times over harmonics: .png, .pdf or .svg."
)
def main(**given: Any) -> None:
    """Compare harmonic balance with the exact orbit of the larger impulse, at one frequency and along its branch. Times are those of
    the processor; nothing is compiled."""
    with plain_errors():
        for option in ("json", "csv"):
            check_target(f"--{option}", given[option], (f".{option}",))
        check_target("--figure", given["figure"], FIGURES)
        exact, rows, complete = computed(given)
        if given["json"] is not None:
            write_json(given["json"], {"complete": complete, "rows": [row.to_plain() for row in rows]})
        if given["csv"] is not None:
            write_csv(given["csv"], COLUMNS, (["" if v is None else v for v in row.to_plain().values()] for row in rows))
        if given["figure"] is not None:
            from optimisation.report.balance_figure import save_figure  # matplotlib is slow to import

            with replacing(given["figure"]) as temporary:
                save_figure(temporary, exact, rows, given["growing"])
    click.echo(text(exact, rows))
    files = [given[option] for option in ("json", "csv", "figure") if given[option] is not None]
    if files:
        name_files(files)
    end_early(complete)


if __name__ == "__main__":
    main(prog_name="scripts/run balance_error")
