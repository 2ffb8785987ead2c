"""The tuned linear absorber, with a proof of its peak."""

# needs: optimise

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import click

from optimisation.answers.tuning import TuningAnswer, prove_peaks
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    AnswerFiles,
    check_page,
    command,
    fill_page,
    name_files,
    page_spec,
    plain_errors,
)
from optimisation.cli.options import option
from optimisation.executors import BAR, Bar
from optimisation.report.tuning_report import Tuning, tuning_table
from optimisation.tuned import HIGH, LOW
from optimisation.tuned.under_loads import tune_under_loads

MARKER = "tunings"


@dataclass(frozen=True, kw_only=True)
class TuneOptions(scenes.SummaryOptions, scenes.AbsorberOptions, scenes.BeamOptions):
    """Options of ``design tune``; None: not given."""

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
    out: Path = option("out", default=Path("results/design_tune"))
    page: Path | None = option(page_spec(MARKER, "docs/gap_method.md"))


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
    """Tune the linear absorber of a given mass to a resonance of a structure.

    The structure is the paper's beam or another one.

    Prints a table of all tunings with their highest peak, H2 norm and proved amplitude, and writes
    tunings.png, tunings.csv and summary.json.

    With --load the spring and damper with the least measure under the loads of a file
    (docs/loads.md), beside those of the least peak: for a random load the H2 tuning for its
    spectrum.
    """
    with plain_errors():
        model, device = scenes.read_source_model(options, position=options.position)
        ratio = options.mass_ratio if device is None else device.mass_ratio
        ratio = scenes.mass_ratio_of(ratio, options.mass_kg, model.beam_mass)
        targets = AnswerFiles(options.out, options.json)
        targets.check()
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
            answer = TuningAnswer(tune_under_loads(model, loads, ratio))
        else:
            check_page(options.page, MARKER)
            scenes.warn_of_nodes(model, options.resonance)
            table = tuning_table(model, ratio, options.resonance, options.low, options.high)
            bounds = {} if options.quick else prove_peaks(table, report_failure, show_proofs)
            answer = TuningAnswer(table, bounds)
        files = targets.write(answer)
        files += fill_page(options.page, MARKER, str(answer))
    name_files(files)
