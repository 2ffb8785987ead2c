"""The tuned linear absorber, with a proof of its peak."""

# needs: optimise

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click

from impact_env.parameters import Beam
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    check_page,
    check_targets,
    command,
    fill_page,
    name_files,
    page_spec,
    plain_errors,
)
from optimisation.cli.options import option
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

MARKER = "tunings"
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


@dataclass(frozen=True, kw_only=True)
class TuneOptions:
    """Options of ``design tune``; None: not given."""

    structure: Path | None = option("structure")
    scene: Path | None = option(
        "scene", help="Structure and impact absorber from a .toml or .json file"
    )
    position: float = option("position")
    modes: int = option("modes", default=Beam.modes)
    damping: float = option("damping", default=Beam.damping_ratio)
    mass_ratio: float = option("mass_ratio")
    mass_kg: float | None = option("mass_kg", usual=True)
    load: Path | None = option("load")
    resonance: int = option("resonance", help="Resonance to tune to, counted from 1")
    low: float = option(
        "start",
        help="First frequency that is scored, over the resonance",
        default=LOW,
        older=("--low",),
    )
    high: float = option(
        "stop",
        help="Last frequency that is scored, over the resonance",
        more="A range that cannot hold both peaks is refused.",
        default=HIGH,
        older=("--high",),
    )
    quick: bool = option(
        "quick",
        help="Without the proofs",
        more="They take a second for the first resonance and a minute for higher ones.",
    )
    json: Path | None = option("json", help="Write the summary here, too")
    out: Path = option("out", default=Path("results/design_tune"))
    page: Path | None = option(page_spec(MARKER, "docs/which_gap.md"))


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


@command(
    TuneOptions, examples=("design tune --quick", "design tune --resonance 2 --mass-ratio 0.05")
)
def main(options: TuneOptions) -> None:
    """Tune the linear absorber (LTVA) of a given mass to a resonance of the paper's beam, or another structure.

    Prints a table of all tunings with their highest peak, H2 norm and proved amplitude, and writes tunings.png, tunings.csv and summary.json.

    With --load the spring and damper with the least measure under the loads of a file (docs/loads.md), beside those of the least peak: for a random
    load the H2 tuning for its spectrum.
    """
    with plain_errors():
        scenes.refuse_with_structure(options.structure, "modes", "damping")
        if options.scene is None:
            model = scenes.model_of(
                options.structure,
                options.position,
                modes=options.modes,
                damping_ratio=options.damping,
            )
            ratio = options.mass_ratio
        else:
            own, absorber = scenes.read_device(
                options.scene, "structure", "modes", "damping", "mass_ratio", "mass_kg", "position"
            )
            model = model_with_absorber_at(own)
            ratio = absorber.mass_ratio
        ratio = scenes.mass_ratio_of(ratio, options.mass_kg, model.beam_mass)
        require_writable("--out", options.out)
        check_targets({"json": options.json})
        if options.load is not None:
            scenes.refuse_with_load(
                options.load,
                "low",
                "high",
                "page",
                "quick",
                why="there is no range of frequencies to score, and nothing to prove",
            )
            loads = scenes.loads_of(options.load, model, options.resonance)
            tuned = tuned_under(model, loads, ratio)
            click.echo(tuned_text(tuned))
            content = tuned_summary(tuned)
            files = write_files({options.out / "summary.json": content, options.json: content})
        else:
            check_page(options.page, MARKER)
            scenes.warn_of_nodes(model, options.resonance)
            table = tuning_table(model, ratio, options.resonance, options.low, options.high)
            bounds = {} if options.quick else certificates(table)
            printed = text(table, bounds)
            click.echo(printed)
            files = write(options.out, table, bounds)
            files += write_files({options.json: summary(table, bounds)})
            files += fill_page(options.page, MARKER, printed)
    name_files(files)
