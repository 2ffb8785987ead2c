"""Restitution, friction and gap from a measured response."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from impact_env.checks import non_negative
from impact_env.ensemble import LaneProgress
from impact_env.parameters import RigidWalls, SlidingAbsorber, friction_law
from optimisation.answers.calibration import (
    ALTERNATIVES,
    QUICK_RUNS,
    WHEN_REFUSED,
    CalibrationRuns,
    calibrate,
)
from optimisation.calibration.measurement import read_measurements
from optimisation.calibration.parameters import FORM, PARAMETERS
from optimisation.calibration.plan import FACTORS
from optimisation.checkpoint import Checkpoint
from optimisation.cli import common
from optimisation.cli import scene_options as scenes
from optimisation.cli.options import OptionSpec, Words, is_number, option
from optimisation.executors import counting_bar
from optimisation.mounting import model_with_absorber_at

USUAL_RESTITUTION = 0.6
USUAL_FREE = ("restitution", "friction_limit", "gap")
FREE_MORE = (
    f"{FORM}, or 'log' after two numbers; without numbers the usual range. One of "
    f"{', '.join(PARAMETERS)}."
)
PLAN_MORE = (
    "Factors of the measured load, with commas between, or "
    f"'usual' for {', '.join(f'{factor:g}' for factor in FACTORS)}."
)
MEASUREMENT = click.Path(dir_okay=False, path_type=Path)


def parse_prior(text: str) -> tuple[str, tuple[str, ...]]:
    """Return the name of a parameter and the words of its prior.

    The words are those that `count_prior_words` counts.
    """
    name, *words = text.split(" ")
    return name, tuple(words)


def count_prior_words(words: Sequence[str]) -> int:
    """Return the number of words after ``--free`` that form its value.

    They are a name, two numbers, and the name of a distribution.
    """
    count = 1
    while count < min(len(words), 3) and is_number(words[count]):
        count += 1
    has_distribution = count == 3 and words[3:4] and words[3] in ("log", "normal", "uniform")
    return count + 1 if has_distribution else count


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions(scenes.SummaryOptions, scenes.AbsorberOptions):
    """Options of ``calibrate``; None: not given."""

    measurement: Path = option(
        OptionSpec(names=("measurement",), help="Measurement", type=MEASUREMENT, required=True)
    )
    gap: float = option("gap", more="A free one's usual range is half to twice this.", usual=True)
    restitution: float = option(
        "restitution", more="Where it is not free.", default=USUAL_RESTITUTION
    )
    friction_limit: float = option("friction_limit", more="Where it is not free.", default=0.0)
    resonance: int = option(
        "resonance", help="Resonance near which the structure was excited, counted from 1"
    )
    free: tuple[tuple[str, tuple[str, ...]], ...] = option(
        "free",
        help="Free parameter, with its prior; may be repeated",
        more=FREE_MORE,
        type=Words("name [low high [log|normal]]", parse_prior),
        metavar="NAME [LOW HIGH]",
        default_text=", ".join(USUAL_FREE),
        count_words=count_prior_words,
    )
    alternatives: str = option(
        OptionSpec(
            names=("--alternatives",),
            help=f"Compare other models: {', '.join(ALTERNATIVES)}",
            more="Springs as walls, restitution that falls with speed, friction added or left out.",
            type=click.Choice(ALTERNATIVES),
            metavar="WHEN",
            default=WHEN_REFUSED,
        )
    )
    plan: str | None = option(
        OptionSpec(
            names=("--plan",),
            help="Expected width of the intervals after one more sweep at other forces",
            more=PLAN_MORE,
            type=str,
            metavar="F,F,...|usual",
        )
    )
    quick: bool = option("quick", more="Fewer simulated measurements, wider intervals.")
    seed: int = option("seed")
    threads: int | None = option("threads")
    resume: Path | None = option("resume")
    out: Path = option("out", default=Path("results/calibrate"))


def free_of(values: Sequence[tuple[str, tuple[str, ...]]]) -> dict[str, tuple[str, ...] | None]:
    """Return the free parameters with the words of their priors.

    Raises BadInput for a parameter that is given twice.
    """
    table: dict[str, tuple[str, ...] | None] = {}
    for name, words in values:
        if name in table:
            raise common.BadInput(f"--free {name} is given twice: once is allowed")
        table[name] = words or None
    return table or dict.fromkeys(USUAL_FREE)


def device_of(options: CalibrateOptions) -> tuple[Any, SlidingAbsorber]:
    """Return structure and absorber from a scene's file or from the options."""
    structure, device, _ = scenes.read_source(options, position=options.position)
    if device is not None:
        return structure, device
    model = model_with_absorber_at(structure)
    ratio = scenes.mass_ratio_of(options.mass_ratio, options.mass_kg, model.beam_mass)
    friction = friction_law(non_negative("friction_limit", options.friction_limit))
    walls = RigidWalls(options.gap, options.restitution)
    free = {name for name, _ in options.free} or set(USUAL_FREE)
    if friction is None and "friction_limit" in free:
        inertia = ratio * model.beam_mass * model.resonance_omega(options.resonance) ** 2
        friction = friction_law(0.1 * inertia * options.gap)
    return structure, SlidingAbsorber(ratio, walls, friction)


@contextmanager
def show_stage(label: str, _runs: int) -> Iterator[LaneProgress | None]:
    """Show a stage's progress in runs."""
    with counting_bar(label, "runs", leave=False) as show:
        yield show


@common.command(
    CalibrateOptions,
    examples=("calibrate measured.toml --quick", "calibrate measured.toml --structure arm.toml"),
)
def main(options: CalibrateOptions) -> None:
    """Find an absorber's parameters from the records or levels of MEASUREMENT.

    MEASUREMENT is a .toml or .json file (docs/calibrate.md).

    The measured load drives simulations with parameters from their prior distributions. Statistics
    of the response give the posterior: medians, 90 % intervals and correlations. A predictive check
    says whether the model explains the measurement. posterior.json is what design gap --uncertain
    reads.
    """
    with common.plain_errors():
        targets = common.AnswerFiles(options.out, options.json)
        targets.check()
        common.check_target("--resume", options.resume)
        factors: tuple[float, ...] | None = None  # of the planned sweep; empty: the usual ones
        if options.plan is not None:
            usual = options.plan == "usual"
            factors = () if usual else tuple(common.numbers("--plan", options.plan, float))
        free = free_of(options.free)
        structure, absorber = device_of(options)
        measurements = read_measurements(options.measurement)
        checkpoint = Checkpoint(options.resume)
        try:
            answer = calibrate(
                measurements,
                structure,
                absorber,
                free,
                resonance=options.resonance,
                alternatives=options.alternatives,
                plan=factors,
                runs=QUICK_RUNS if options.quick else CalibrationRuns(),
                seed=options.seed,
                threads=options.threads,
                checkpoint=checkpoint,
                stages=show_stage,
            )
        finally:
            checkpoint.close()
        common.name_files(targets.write(answer))
