"""The tuned linear absorber, with a proof of its peak."""

# needs: optimise

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import click

from impact_env.parameters import Beam
from optimisation.answers.tuning import TuningAnswer, prove_peaks
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
from optimisation.progress import BAR, Bar
from optimisation.report.tuning_report import Tuning, tuning_table
from optimisation.tuned import HIGH, LOW
from optimisation.tuned.under_loads import tuned_under

MARKER = "tunings"


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


def show_proofs(tunings: list[Tuning]) -> Iterable[Tuning]:
    """Return tunings under a bar."""
    return Bar(tunings, desc="proving", bar_format=BAR, leave=False)


def report_failure(line: str) -> None:
    """Print a line on standard error."""
    click.echo(line, err=True)


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
            answer = TuningAnswer(tuned_under(model, loads, ratio))
        else:
            check_page(options.page, MARKER)
            scenes.warn_of_nodes(model, options.resonance)
            table = tuning_table(model, ratio, options.resonance, options.low, options.high)
            bounds = {} if options.quick else prove_peaks(table, report_failure, show_proofs)
            answer = TuningAnswer(table, bounds)
        click.echo(str(answer))
        files = answer.save(options.out) + write_files({options.json: answer.to_json()})
        files += fill_page(options.page, MARKER, str(answer))
    name_files(files)
