"""Tune the linear absorber: closed forms, numerical optima and the paper's values, with a proof of each peak."""

# needs: optimise

import math
from functools import partial
from pathlib import Path
from typing import Any

import click

from impact_env.parameters import DEFAULT_MASS_RATIO, Beam
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    check_page,
    command,
    fill_page,
    name_files,
    out_option,
    page_option,
    plain_errors,
)
from optimisation.files import require_writable, write_files
from optimisation.mounting import model_with_absorber_at
from optimisation.page import markdown
from optimisation.progress import BAR, Bar
from optimisation.report.card import write_card
from optimisation.report.cards import tuning_card
from optimisation.report.comparison_tables import tuned_summary, tuned_text
from optimisation.report.tuning_report import (
    MINIMAX,
    PAPER_VALUES,
    TuningTable,
    csv_table,
    save_figure,
    summary,
    tuning_table,
)
from optimisation.tuned import HIGH, LOW
from optimisation.tuned.under_loads import tuned_under

HEADER = (
    "tuning",
    "k, N/m",
    "c, N s/m",
    "omega_a/omega_r",
    "damping ratio",
    "peak, %",
    "at",
    "H2 norm, %",
    "proved, %",
)


def text(table: TuningTable, bounds: dict[str, float]) -> str:
    """Return a line for each tuning with its ``bounds`` (m/N) where there are any, and how to read them."""
    lines = []
    for tuning in table.tunings:
        values = ["", "", "", ""]
        if tuning.absorber is not None:
            frequency, damping = table.ratios(tuning.absorber)
            values = [
                f"{tuning.absorber.stiffness:.6g}",
                f"{tuning.absorber.damping:.4g}",
                f"{frequency:.4f}",
                f"{damping:.4f}",
            ]
        scores = [
            f"{100 * table.relative_peak(tuning):.2f}",
            f"{tuning.peak_ratio:.4f}",
            f"{100 * table.relative_h2(tuning):.2f}",
        ]
        proved = f"{100 * bounds[tuning.key] / table.reference:.3f}" if tuning.key in bounds else ""
        lines.append([tuning.label, *values, *scores, proved])
    by_key = {tuning.key: tuning for tuning in table.tunings}
    paper = by_key[PAPER_VALUES]
    best = by_key[MINIMAX]
    relative = (
        "peaks in % of the static deflection, H2 norms in % of the smallest"
        if table.undamped
        else "relative to no absorber"
    )
    notes = [
        f"Scored over {table.low:g} to {table.high:g} times omega_{table.resonance} = {table.omega:.6g} rad/s, {relative}.",
        f"Mistuning: {paper.label} leave{'s' if paper.label.endswith('rule') else ''} a peak {paper.peak / best.peak:.2f} times the smallest one.",
    ]
    if bounds:
        notes.append(
            "Proved: no amplitude in the range is larger, flanks of other resonances and all between the grid's points included."
        )
    return "\n".join([markdown(HEADER, lines), "", *notes])


MARKER = "tunings"


def certificates(table: TuningTable) -> dict[str, float]:
    """Return the proved largest amplitude (m/N) of each tuning by its key; one that cannot be proved is left out, with a line on standard error."""
    from optimisation.bounds.relaxation import (
        NotOptimalError,
    )  # needs cvxpy, which is slow to import
    from optimisation.tuned.certificate import certify

    bounds = {}
    finite = [tuning for tuning in table.tunings if math.isfinite(tuning.peak)]
    for tuning in Bar(finite, desc="proving", bar_format=BAR, leave=False):
        try:
            bounds[tuning.key] = certify(
                table.model, tuning.absorber, table.resonance, table.low, table.high
            ).bound
        except (
            NotOptimalError
        ) as error:  # its cell stays empty: the others are none the worse for it
            click.echo(f"Not proved, {tuning.label}: {error}", err=True)
    return bounds


def write(out: Path, table: TuningTable, bounds: dict[str, float]) -> list[Path]:
    """Write the figure and the tables into a folder, and return the files."""
    tunings = csv_table(table, bounds)
    figure = partial(save_figure, table=table)
    files = write_files(
        {
            out / "tunings.csv": tunings,
            out / "summary.json": summary(table, bounds),
            out / "tunings.png": figure,
        }
    )
    return files + write_card(out, tuning_card(table, bounds))


@command()
@scenes.structure_option
@scenes.scene_option
@scenes.load_option
@click.option(
    "--resonance",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Resonance to tune to, counted from 1.",
)
@click.option(
    "--mass-ratio",
    type=float,
    default=DEFAULT_MASS_RATIO,
    show_default=True,
    help="Absorber mass over beam mass.",
)
@scenes.mass_option
@scenes.position_option
@click.option(
    "--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept."
)
@click.option(
    "--damping",
    type=float,
    default=Beam.damping_ratio,
    show_default=True,
    help="Modal damping ratio, the same for all modes.",
)
@click.option(
    "--low",
    type=float,
    default=LOW,
    show_default=True,
    help="Begin of the scoring range over the resonance frequency.",
)
@click.option(
    "--high",
    type=float,
    default=HIGH,
    show_default=True,
    help="End of the scoring range; a range that cannot hold both peaks is refused.",
)
@click.option(
    "--quick",
    is_flag=True,
    help="Without the proofs, which take a second for the first resonance and a minute for higher ones.",
)
@out_option("results/tune_ltva")
@page_option(MARKER, "docs/which_gap.md")
def main(**options: Any) -> None:
    """Tune the linear absorber (LTVA) of a given mass to a resonance of the paper's beam, or another structure.

    Prints a table of all tunings with their highest peak, H2 norm and proved amplitude, and writes tunings.png, tunings.csv and summary.json.

    With --load the spring and damper with the least measure under the loads of a file (docs/loads.md), beside those of the least peak: for a random
    load the H2 tuning for its spectrum.
    """
    structure, scene, load, page, resonance, out = (
        options[name] for name in ("structure", "scene", "load", "page", "resonance", "out")
    )
    with plain_errors():
        scenes.refuse_with_structure(structure, "modes", "damping")
        if scene is None:
            model = scenes.model_of(
                structure,
                options["position"],
                modes=options["modes"],
                damping_ratio=options["damping"],
            )
            ratio = options["mass_ratio"]
        else:
            own, absorber = scenes.read_device(
                scene, "structure", "modes", "damping", "mass_ratio", "mass_kg", "position"
            )
            model = model_with_absorber_at(own)
            ratio = absorber.mass_ratio
        ratio = scenes.mass_ratio_of(ratio, options["mass_kg"], model.beam_mass)
        require_writable("--out", out)
        if load is not None:
            scenes.refuse_with_load(
                load,
                "low",
                "high",
                "page",
                "quick",
                why="there is no range of frequencies to score, and nothing to prove",
            )
            tuned = tuned_under(model, scenes.loads_of(load, model, resonance), ratio)
            click.echo(tuned_text(tuned))
            files = write_files({out / "summary.json": tuned_summary(tuned)})
        else:
            check_page(page, MARKER)
            scenes.warn_of_nodes(model, resonance)
            table = tuning_table(model, ratio, resonance, options["low"], options["high"])
            bounds = {} if options["quick"] else certificates(table)
            printed = text(table, bounds)
            click.echo(printed)
            files = write(out, table, bounds) + fill_page(page, MARKER, printed)
    name_files(files)
