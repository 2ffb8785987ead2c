"""Options of the commands about attractors (basins, diagram, section): the case, how long runs are, and ranges of parameters."""

from collections.abc import Callable
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import count, positive, require
from impact_env.periodic.attractors import FREQUENCY, PARAMETERS, SettleOptions, change_parameter
from impact_env.periodic.case import Case, case_of
from optimisation.cli import common
from optimisation.cli.scene_options import make_scene, refuse_parts, scene_options

FORCE = 1.5  # N, the paper's moderate level of excitation
AT = 0.95  # of the first resonance
DEFAULTS = SettleOptions()
Command = Callable[..., Any]


def case_options(command: Command) -> Command:
    """Add the options of structure, absorber, force and frequency."""
    options = (
        scene_options(", 0 to 1", friction="none"),
        click.option(
            "--force",
            type=float,
            default=FORCE,
            show_default=True,
            help="Amplitude of the harmonic force in N.",
        ),
        click.option(
            "--at",
            type=float,
            default=AT,
            show_default=True,
            help="Frequency of the force over the first resonance.",
        ),
    )
    return common.stack_options(options)(command)


def settle_options(command: Command) -> Command:
    """Add the options of the length of runs."""
    options = (
        click.option(
            "--periods",
            type=int,
            default=DEFAULTS.periods,
            show_default=True,
            help="Periods of the force within which a run settles.",
        ),
        click.option(
            "--window",
            type=int,
            default=DEFAULTS.window,
            show_default=True,
            help="Periods after these by which a motion that does not repeat is judged.",
        ),
        click.option(
            "--longest",
            type=int,
            default=DEFAULTS.most_multiple,
            show_default=True,
            help="Longest period of a periodic motion, and most circles of a quasi-periodic one.",
        ),
    )
    return common.stack_options(options)(command)


def range_option(name: str, words: str, **options: Any) -> Callable[[Command], Command]:
    """Add an option that takes a parameter and its range."""
    return click.option(
        name,
        type=click.Tuple([click.Choice(tuple(PARAMETERS)), float, float]),
        metavar="PARAMETER LOW HIGH",
        help=f"{words}: {', '.join(PARAMETERS)}.",
        **options,
    )


def case_from(options: dict[str, Any]) -> Case:
    """Return the case that the options describe; raises BadInput or ParameterError."""
    options |= dict.fromkeys(
        ("absorber", "contact_stiffness", "friction_stiffness", "stiffness", "absorber_damping")
    )
    options["resonance"] = 1  # whose frequency --at is a ratio to
    refuse_parts(options)
    force = positive("--force", options["force"])
    ratio = positive("--at", options["at"])
    scene, _ = make_scene(options)
    return case_of(scene, force, ratio * float(scene.model.omega[0]))


def settling_from(options: dict[str, Any]) -> SettleOptions:
    """Return the length of runs that the options describe."""
    return SettleOptions(options["periods"], options["window"], options["longest"])


def values_of(
    option: str, over: tuple[str, float, float], points: int, case: Case
) -> NDArray[np.float64]:
    """Return evenly spaced values of a range; raises ParameterError for a range that does not rise, or values that a case cannot have."""
    name, low, high = over
    require(low < high, option, (low, high), "two numbers, the lower one first")
    if name in (FREQUENCY, "force"):
        low = positive(f"{option} {name}", low)
    for value in (low, high):
        change_parameter(case, name, value)
    return np.linspace(low, high, count("--points", points, 2))


def ratio_text(case: Case) -> str:
    """Return where a case is, in words."""
    return f"{case.force:g} N at {case.omega_ratio:.6g} of the first resonance"
