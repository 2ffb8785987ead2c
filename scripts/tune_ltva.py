"""Tune the linear absorber: closed forms, numerical optima and the paper's values, with a proof of each peak."""

# needs: optimise

from __future__ import annotations

from pathlib import Path

import click

from impact_env.parameters import DEFAULT_MASS_RATIO, Beam
from optimisation.command_line import check_target, name_files, plain_errors
from optimisation.commands.structure_option import POSITION_HELP, model_of, refuse_beside, structure_option
from optimisation.commands.tuning_answer import MARKER, certificates, write
from optimisation.files import require_writable
from optimisation.report.tuning_table import text
from optimisation.studies.machine import conditions, sources
from optimisation.studies.page import fill, require_markers
from optimisation.tuned import HIGH, LOW
from optimisation.tuned.table import tuning_table


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@structure_option
@click.option("--resonance", type=click.IntRange(min=1), default=1, show_default=True, help="Resonance to tune to, counted from 1.")
@click.option("--mass-ratio", type=float, default=DEFAULT_MASS_RATIO, show_default=True, help="Absorber mass over beam mass.")
@click.option(
    "--position",
    type=float,
    default=Beam.absorber_position,
    show_default=True,
    help=POSITION_HELP,
)
@click.option("--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept.")
@click.option("--damping", type=float, default=Beam.damping_ratio, show_default=True, help="Modal damping ratio, the same for all modes.")
@click.option("--low", type=float, default=LOW, show_default=True, help="Begin of the scoring range over the resonance frequency.")
@click.option("--high", type=float, default=HIGH, show_default=True, help="End of the scoring range; a range that cannot hold both peaks is refused.")
@click.option("--quick", is_flag=True, help="Without the proofs, which take a second for the first resonance and a minute for higher ones.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("results/tune_ltva"), show_default=True, help="Folder for figure and tables.")
@click.option(
    "--page",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help=f"Write the table into this page, between <!-- {MARKER} --> and <!-- /{MARKER} -->, as in docs/limits.md.",
)
def main(
    structure: Path | None,
    resonance: int,
    mass_ratio: float,
    position: float,
    modes: int,
    damping: float,
    low: float,
    high: float,
    quick: bool,
    out: Path,
    page: Path | None,
) -> None:
    """Tune the linear absorber (LTVA) of a given mass to a resonance of the paper's beam, or another structure.

    Prints a table of all tunings with their highest peak, H2 norm and proved amplitude, and writes tunings.png, tunings.csv and summary.json.
    """
    with plain_errors():
        refuse_beside(structure, "modes", "damping")
        model = model_of(structure, position, modes=modes, damping_ratio=damping)
        require_writable("--out", out)
        check_target("--page", page)
        if page is not None:
            require_markers(page, page, (MARKER,))
        table = tuning_table(model, mass_ratio, resonance, low, high)
        bounds = {} if quick else certificates(table)
        files = write(out, table, bounds)
        if page is not None:
            fill(page, page, {MARKER: f"{text(table, bounds)}\n\n{sources(conditions())}"})
            files.append(page)
    click.echo(text(table, bounds))
    name_files(files)


if __name__ == "__main__":
    main()
