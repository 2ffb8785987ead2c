"""Find an absorber's restitution, friction and clearance from a measured response, with intervals, and check whether the model explains it."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from impact_env.ensemble import LaneProgress
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    RigidWalls,
    SlidingAbsorber,
    friction_law,
    non_negative,
)
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
from optimisation.files import require_writable
from optimisation.mounting import model_with_absorber_at
from optimisation.progress import counting_bar

USUAL_RESTITUTION = 0.6
USUAL_FREE = ("restitution", "friction_limit", "gap")
FREE_HELP = (
    f"Free parameter, with its prior: {FORM}, or 'log' after two numbers; without numbers the usual range. May be repeated. "
    f"One of {', '.join(PARAMETERS)}.  [default: {', '.join(USUAL_FREE)}]"
)
PLAN_HELP = (
    "Expected width of the intervals after one more sweep at other forces: factors of the measured load, with commas between, or "
    f"'usual' for {', '.join(f'{factor:g}' for factor in FACTORS)}."
)
MEASUREMENT = click.Path(dir_okay=False, path_type=Path)


class FreeParameter(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A name of a parameter, and the words of its prior, as `CalibrateCommand` joins them."""

    name = "name [low high [log|normal]]"

    def convert(
        self,
        value: object,
        param: click.Parameter | None,  # noqa: ARG002
        ctx: click.Context | None,  # noqa: ARG002
    ) -> tuple[str, tuple[str, ...]]:
        """Return the name and the words."""
        name, *words = str(value).split(" ")
        return name, tuple(words)


class CalibrateCommand(common.OneCommand):
    """A command whose --free takes a name and up to three further words."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Join the words of each --free."""
        return super().parse_args(ctx, join_free(args))


def join_free(args: Sequence[str]) -> list[str]:
    """Return arguments with the words of each ``--free`` as one: a name, numbers, and the name of a distribution.

    >>> join_free(["m.toml", "--free", "gap", "1e-3", "2e-3", "log", "--seed", "1"])
    ['m.toml', '--free', 'gap 1e-3 2e-3 log', '--seed', '1']
    """
    joined = list[str]()
    k = 0
    while k < len(args):
        joined.append(args[k])
        k += 1
        if joined[-1] != "--free":
            continue
        words = [*args[k : k + 1]]
        k += 1
        while k < len(args) and len(words) < 4 and is_prior_word(args[k], len(words)):
            words.append(args[k])
            k += 1
        joined += [" ".join(words)] if words else []
    return joined


def is_prior_word(text: str, position: int) -> bool:
    """Return whether a word at a position after ``--free`` is a part of a prior: two numbers, then a distribution."""
    if position == 3:
        return text in ("log", "normal", "uniform")
    try:
        float(text)
    except ValueError:
        return False
    return True


def free_of(values: Sequence[tuple[str, tuple[str, ...]]]) -> dict[str, tuple[str, ...] | None]:
    """Return the free parameters with the words of their priors; raises BadInput for one that is given twice."""
    table: dict[str, tuple[str, ...] | None] = {}
    for name, words in values:
        if name in table:
            raise common.BadInput(f"--free {name} is given twice: once is allowed")
        table[name] = words or None
    return table or dict.fromkeys(USUAL_FREE)


def device_of(options: dict[str, Any]) -> tuple[Any, SlidingAbsorber]:
    """Return structure and absorber: of a scene's file, or the structure with the absorber that the options describe."""
    own = ("structure", "gap", "restitution", "friction_limit", "mass_ratio", "mass_kg")
    if options["scene"] is not None:
        return scenes.read_device(options["scene"], *own)
    structure = scenes.structure_of(options["structure"], options["position"])
    model = model_with_absorber_at(structure)
    ratio = scenes.mass_ratio_of(options["mass_ratio"], options["mass_kg"], model.beam_mass)
    friction = friction_law(non_negative("friction_limit", options["friction_limit"]))
    walls = RigidWalls(options["gap"], options["restitution"])
    free = {name for name, _ in options["free"]} or set(USUAL_FREE)
    if friction is None and "friction_limit" in free:
        inertia = ratio * model.beam_mass * model.resonance_omega(options["resonance"]) ** 2
        friction = friction_law(0.1 * inertia * options["gap"])
    return structure, SlidingAbsorber(ratio, walls, friction)


def factors_of(text: str | None) -> tuple[float, ...] | None:
    """Return the factors of --plan; empty for the usual ones, None without the option."""
    if text is None:
        return None
    return () if text == "usual" else tuple(common.numbers("--plan", text, float))


@contextmanager
def show_stage(label: str, _runs: int) -> Iterator[LaneProgress | None]:
    """Show a stage's progress in runs."""
    with counting_bar(label, "runs", leave=False) as show:
        yield show


@common.command(cls=CalibrateCommand)
@click.argument("measurement", type=MEASUREMENT)
@scenes.structure_option
@scenes.scene_option
@click.option(
    "--free",
    multiple=True,
    type=FreeParameter(),
    metavar="NAME [LOW HIGH [log|normal]]",
    help=FREE_HELP,
)
@click.option(
    "--gap",
    type=float,
    default=RigidWalls.gap,
    show_default=True,
    help="Clearance to either wall in m; a free one's usual range is half to twice this.",
)
@click.option(
    "--restitution",
    type=float,
    default=USUAL_RESTITUTION,
    show_default=True,
    help="Coefficient of restitution, where it is not free.",
)
@click.option(
    "--friction-limit",
    type=float,
    default=0.0,
    show_default=True,
    help="Friction limit in N, where it is not free; 0: none.",
)
@click.option(
    "--mass-ratio",
    type=float,
    default=DEFAULT_MASS_RATIO,
    show_default=True,
    help="Absorber mass over the structure's mass.",
)
@scenes.mass_option
@scenes.position_option
@click.option(
    "--resonance",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Resonance near which the structure was excited, counted from 1.",
)
@click.option(
    "--alternatives",
    type=click.Choice(ALTERNATIVES),
    default=WHEN_REFUSED,
    show_default=True,
    help="Compare other models: springs as walls, restitution that falls with speed, friction added or left out.",
)
@click.option("--plan", help=PLAN_HELP)
@click.option(
    "--quick", is_flag=True, help="A look: fewer simulated measurements, wider intervals."
)
@common.seed_option
@common.threads_option
@common.resume_option
@common.out_option("results/calibrate", "Folder for posterior, figures, tables and card.")
def main(measurement: Path, **options: Any) -> None:
    """Find an absorber's parameters from the records or levels of MEASUREMENT, a .toml or .json file (docs/calibrate.md).

    The measured load drives simulations with parameters from their prior distributions. Statistics of the response give the
    posterior: medians, 90 % intervals and correlations. A predictive check says whether the model explains the measurement.
    posterior.json is what design_gap --uncertain reads.
    """
    with common.plain_errors():
        require_writable("--out", options["out"])
        common.check_target("--resume", options["resume"])
        factors = factors_of(options["plan"])
        free = free_of(options["free"])
        structure, absorber = device_of(options)
        measurements = read_measurements(measurement)
        checkpoint = Checkpoint(options["resume"])
        try:
            answer = calibrate(
                measurements,
                structure,
                absorber,
                free,
                resonance=options["resonance"],
                alternatives=options["alternatives"],
                plan=factors,
                runs=QUICK_RUNS if options["quick"] else CalibrationRuns(),
                seed=options["seed"],
                threads=options["threads"],
                checkpoint=checkpoint,
                stages=show_stage,
            )
        finally:
            checkpoint.close()
        click.echo(str(answer))
        common.name_files(answer.save(options["out"]))
