"""Values and sweeps that a study can use.

The values are forces, masses, gaps and sweep rates. All absorbers that are compared have the same
range of frequencies.

What cannot be used is refused with a reason before anything runs. An absorber of some mass changes
a resonance within a few times the shift of its frequency by the stuck mass
(`optimisation.bounds.near_range`), and a tuned absorber splits it into two peaks, which lie between
the natural frequencies of the undamped system with Den Hartog's tuning. The range holds both, but
for the peaks it goes no further than half-way (geometric mean) to the neighbouring resonances,
which are not the absorber's task.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import flag, instance, positive, require, two, within
from impact_env.curve import PerformanceCurve
from impact_env.drive import MOST_PERIODS, PAPER_LIMITS, Drive, linear_sweep
from impact_env.frequency import find_steady_start
from impact_env.modes import ModalModel
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.bounds import near_range
from optimisation.tuned import highest_amplitude

BELOW = 0.97  # of the lower end of `near_range`: where a range begins
MARGIN = 0.01  # beyond the natural frequencies of the tuned system
LOWEST = 0.3  # of the resonance
# of the level, in units of the resonance, at a rate of 1 % per 100 pseudo periods: 10 of them
HALF_WINDOW = 1e-3
END_SHARES = (0.01, 0.05)  # of the range: the narrowest and widest end


def find_sweep_range(
    model: ModalModel, mass_ratio: float, resonance: int = 1
) -> tuple[float, float]:
    """Return (low, high) in units of omega_r, the range of sweeps near a resonance.

    It is for absorbers up to a mass ratio (over the structure's mass), and contains the paper's
    range, 0.9 to 1.06, the resonance with the mass stuck to the structure, and both peaks of a
    tuned absorber. Raises ParameterError for a resonance that the model lacks.
    """
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    omega_r = model.resonance_omega(resonance)
    low = min(PAPER_LIMITS[0], BELOW * near_range(model, mass, resonance)[0])
    high = PAPER_LIMITS[1]

    modal_mass_ratio = mass * float(model.tip_shape[resonance - 1]) ** 2
    first, second = split_frequencies(modal_mass_ratio)
    # half-way to the neighbouring resonances, 0 and infinity where there is none
    ratios = model.omega / omega_r
    lower = np.sqrt(np.max(ratios[ratios < 1 - 1e-9], initial=0.0))
    upper = np.sqrt(np.min(ratios[ratios > 1 + 1e-9], initial=np.inf))
    low = min(low, max((1 - MARGIN) * first, float(lower), LOWEST))
    high = max(high, min((1 + MARGIN) * second, float(upper)))
    return low, high


def find_common_range(
    models: Sequence[ModalModel], mass_ratio: float, resonance: int = 1
) -> tuple[float, float]:
    """Return the range that contains those of several models.

    The models are, for example, a structure with the absorber at several places.
    """
    every = [find_sweep_range(model, mass_ratio, resonance) for model in models]
    return min(low for low, _ in every), max(high for _, high in every)


def split_frequencies(modal_mass_ratio: float) -> tuple[float, float]:
    """Return the two natural frequencies of a resonance with an undamped absorber.

    They are over the frequency of the resonance, with Den Hartog's tuning.

    ``modal_mass_ratio``: absorber mass over the effective modal mass. The damped peaks lie between
    them.
    """
    square = 1 / (1 + modal_mass_ratio) ** 2  # of the absorber's frequency
    half = (1 + (1 + modal_mass_ratio) * square) / 2
    second = half + np.sqrt(half**2 - square)
    return float(np.sqrt(square / second)), float(np.sqrt(second))


def find_reading_ratios(curve: PerformanceCurve) -> NDArray[np.float64]:
    """Return the frequencies over the resonance at which a curve's levels were read, (F,).

    Each is the median over the members, of the direction with the larger level.

    NaN where nothing is finished.
    """
    levels = np.where(np.isnan(curve.level), -np.inf, curve.level)
    worse = np.argmax(levels, axis=2)[..., None]
    ratios = np.take_along_axis(curve.lanes.frequency_ratio, worse, axis=2)[..., 0]
    ratios_read = np.full(len(ratios), np.nan)
    for k, row in enumerate(ratios):
        finished = row[np.isfinite(row)]
        if finished.size:
            ratios_read[k] = np.median(finished)
    return ratios_read


def is_at_end(ratio: float, sweep_range: tuple[float, float], rate: float) -> bool:
    """Return whether a level was read at an end of sweeps.

    ``rate`` in % per 100 pseudo periods. ``ratio`` and ``sweep_range`` over the resonance.

    An end is half the window of the level wide, but from 1 to 5 % of the range. Not a number is not
    at an end.
    """
    low, high = sweep_range
    near = float(np.clip(HALF_WINDOW * rate / (high - low), *END_SHARES)) * (high - low)
    return bool(ratio <= low + near or ratio >= high - near)


def reading_in_words(ratio: float, sweep_range: tuple[float, float], rate: float) -> str:
    """Return a text that says where a level was read.

    An end of the sweeps is named, because the level may be larger beyond it.
    """
    words = f"{ratio:.4g} of the resonance"
    return f"{words}, an end of the sweeps" if is_at_end(ratio, sweep_range, rate) else words


# N: far above what any structure bears, and far below where squares of displacements overflow
MOST_FORCE = 1e12
# of the structure's: design rule, limit and tunings are those of an absorber, not of what it would
# hang on
MOST_MASS = 1.0
LEAST_GAP = 1e-6  # m: a tenth of what a fine fit of two parts leaves
MOST_GAP = 10.0  # m
LEAST_PERIODS = 5.0  # of a sweep: in fewer the response has not begun to build up


def usable_force(name: str, value: float) -> float:
    """Return a force in N; raises ParameterError unless it is above 0 and at most `MOST_FORCE`."""
    allowed = f"above 0 and at most {MOST_FORCE:g} N"
    return positive(name, within(name, value, math.ulp(0.0), MOST_FORCE, allowed))


def usable_gap(name: str, value: object, rule: str, gap: float) -> None:
    """Raise ParameterError if a rule gives a gap in m that nobody can build.

    Such gaps result from numbers in wrong units. ``value``: the value for which the rule gives the
    gap, with its unit.
    """
    words = f"{1e3 * gap:.3g} mm"
    allowed = (
        f"one for which {rule} gives a gap from {1e3 * LEAST_GAP:g} mm to {MOST_GAP:g} m, and not "
        f"{words}: are all numbers in SI units?"
    )
    require(LEAST_GAP <= gap <= MOST_GAP, name, value, allowed)


def usable_mass_ratio(name: str, value: float) -> float:
    """Return an absorber's mass over the structure's.

    Raises ParameterError unless it is above 0 and at most `MOST_MASS`.
    """
    ratio = positive(name, value)
    require(
        ratio <= MOST_MASS,
        name,
        value,
        f"above 0 and at most {MOST_MASS:g}: an absorber no heavier than the structure",
    )
    return ratio


def usable_rate(name: str, value: float, sweeps: Iterable[tuple[float, float]]) -> float:
    """Return a sweep rate in % per 100 pseudo periods.

    Raises ParameterError if one of the ``sweeps`` (low, high over omega_r) takes too few or too
    many pseudo periods.
    """
    rate = positive(name, value)
    widths = [
        1e4 * abs(high - low) for low, high in sweeps
    ]  # rate times the number of pseudo periods
    least = max(widths) / MOST_PERIODS
    most = min(widths) / LEAST_PERIODS
    allowed = (
        f"from {least:.3g} to {most:.4g} % per 100 pseudo periods, so that a sweep takes "
        f"{LEAST_PERIODS:g} to {MOST_PERIODS:g} of them"
    )
    require(least <= rate <= most, name, value, allowed)
    return rate


# of the stationary level that a sweep must reach for a share of the possible reduction to be told
LEAST_RATIO = 0.95


def stationary_level(
    model: ModalModel, resonance: int = 1, limits: tuple[float, float] = PAPER_LIMITS
) -> float:
    """Return the largest stationary RMS where the level is read, without absorber.

    It is in m per newton, over ``limits`` times omega_r.

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
    """Return the level of the sweeps without absorber over `stationary_level`.

    It is 0 for an undamped resonance. The level is the larger one of the sweeps up and down.

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
