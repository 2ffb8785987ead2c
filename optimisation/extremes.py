"""Which forces, masses and rates a study can use, refused with a reason before anything runs; and what a sweep shows of the stationary response."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from impact_env.drive import MOST_PERIODS, PAPER_LIMITS, Drive, linear_sweep
from impact_env.modes import ModalModel
from impact_env.parameters import flag, instance, positive, require, two, within
from impact_env.scene import Scene
from impact_env.steady_start import find_steady_start
from impact_env.sweep import simulate
from optimisation.tuned import highest_amplitude

MOST_FORCE = 1e12  # N: far above what any structure bears, and far below where squares of displacements overflow
MOST_MASS = 1.0  # of the structure's: design rule, limit and tunings are those of an absorber, not of what it would hang on
LEAST_GAP = 1e-6  # m: a tenth of what a fine fit of two parts leaves
MOST_GAP = 10.0  # m
LEAST_PERIODS = 5.0  # of a sweep: in fewer the response has not begun to build up


def usable_force(name: str, value: float) -> float:
    """Return a force in N; raises ParameterError unless it is above 0 and at most `MOST_FORCE`."""
    allowed = f"above 0 and at most {MOST_FORCE:g} N"
    return positive(name, within(name, value, math.ulp(0.0), MOST_FORCE, allowed))


def usable_gap(name: str, value: object, rule: str, gap: float) -> None:
    """Raise ParameterError if a rule gives a gap in m for a value that nobody can build, as of numbers in other units; ``value`` with its unit."""
    words = f"{1e3 * gap:.3g} mm"
    allowed = f"one for which {rule} gives a gap from {1e3 * LEAST_GAP:g} mm to {MOST_GAP:g} m, and not {words}: are all numbers in SI units?"
    require(LEAST_GAP <= gap <= MOST_GAP, name, value, allowed)


def usable_mass_ratio(name: str, value: float) -> float:
    """Return an absorber's mass over the structure's; raises ParameterError unless it is above 0 and at most `MOST_MASS`."""
    ratio = positive(name, value)
    require(
        ratio <= MOST_MASS,
        name,
        value,
        f"above 0 and at most {MOST_MASS:g}: an absorber no heavier than the structure",
    )
    return ratio


def usable_rate(name: str, value: float, sweeps: Iterable[tuple[float, float]]) -> float:
    """Return a sweep rate in % per 100 pseudo periods; raises ParameterError if a sweep (low, high over omega_r) is over at once or never ends."""
    rate = positive(name, value)
    widths = [
        1e4 * abs(high - low) for low, high in sweeps
    ]  # rate times the number of pseudo periods
    least = max(widths) / MOST_PERIODS
    most = min(widths) / LEAST_PERIODS
    allowed = f"from {least:.3g} to {most:.4g} % per 100 pseudo periods, so that a sweep takes {LEAST_PERIODS:g} to {MOST_PERIODS:g} of them"
    require(least <= rate <= most, name, value, allowed)
    return rate


LEAST_RATIO = 0.95  # of the stationary level that a sweep must reach for a share of the possible reduction to be told


def stationary_level(
    model: ModalModel, resonance: int = 1, limits: tuple[float, float] = PAPER_LIMITS
) -> float:
    """Return the largest stationary RMS where the level is read, in m per newton, over ``limits`` times omega_r, without absorber.

    Infinite if undamped.
    """
    model = instance("model", model, ModalModel)
    limits = two("limits", limits)
    return highest_amplitude(model, None, resonance, *limits)[0] / float(np.sqrt(2))


def sweep_ratio(
    model: ModalModel,
    rate: float,
    resonance: int = 1,
    limits: tuple[float, float] = PAPER_LIMITS,
    steady: bool = True,
) -> float:
    """Return the level of the sweeps without absorber (the larger of up and down) over `stationary_level`; 0 for an undamped resonance.

    They start from the steady state at their first frequency, or from rest (``steady`` False).
    ``rate`` in % of the resonance per 100 pseudo periods, ``limits`` over omega_r.
    Raises ParameterError for numbers out of range.
    """
    model = instance("model", model, ModalModel)
    limits = two("limits", limits)
    steady = flag("steady", steady)
    stationary = stationary_level(model, resonance, limits)
    if np.isinf(stationary):
        return 0.0
    scene = Scene(
        replace(model, tip_shape=model.level_shape, response_shape=None)
    )  # without absorber its place is free, and a level there streams
    levels = []
    for start, stop in (limits, limits[::-1]):
        drive = Drive(1.0, linear_sweep(model.resonance_omega(resonance), start, stop, rate))
        start_state = find_steady_start(scene, drive) if steady else None
        level = simulate(scene, drive, initial=start_state).level
        assert level is not None
        levels.append(level.value)
    return max(levels) / stationary
