"""The paper's resonant response level: windowed RMS of the tip displacement around its maximum (paper, Eqs. tmax and barqtip)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.motion.level import LevelObserver, compute_level, new_level, push_samples
from impact_env.loads import AnyDrive
from impact_env.parameters import count, require, row

HALF_WINDOW_PERIODS = 10  # pseudo periods to either side of the maximum
MOST_SAMPLES_PER_PERIOD = 100_000  # a pseudo period: the level keeps those of twenty
# samples of the force's fastest cycle: the mean square of a cosine is right from three on, its peak
# at most 3/10 too low with four
LEAST_SAMPLES_PER_CYCLE = 4


@dataclass(frozen=True)
class ResponseLevel:
    """RMS ``value`` in m; ``time`` (s) and ``frequency_ratio`` (to the reference) of the maximum; ``max_tip``: largest |q_tip| in m.

    The tip is the absorber's place on the beam (`Beam.absorber_position`), or the place where the
    level is read (`Beam.response_position`).
    """

    value: float
    time: float
    frequency_ratio: float
    max_tip: float


def require_samples(samples_per_period: int, ratio: float) -> None:
    """Raise ParameterError if a level has fewer than `LEAST_SAMPLES_PER_CYCLE` samples a cycle.

    The cycle is that of a force of ``ratio`` times the reference frequency.
    """
    needed = LEAST_SAMPLES_PER_CYCLE * ratio * (1 - 1e-9)
    allowed = (
        f"{int(np.ceil(needed))} or more for the level under a force of {ratio:g} times the "
        f"reference frequency, {LEAST_SAMPLES_PER_CYCLE} a cycle"
    )
    require(samples_per_period >= needed, "samples_per_period", samples_per_period, allowed)


def response_level(
    tip_displacement: NDArray[np.float64],
    samples_per_period: int,
    half_window_periods: int = HALF_WINDOW_PERIODS,
) -> tuple[float, float]:
    """Return (response level, largest |q_tip|) in m of equidistant samples (S,) in m, S >= 2; the window is cut at the ends of the series."""
    values = row("tip_displacement", tip_displacement, "two or more finite samples")
    require(len(values) >= 2, "tip_displacement", values, "two or more finite samples")
    samples_per_period = count("samples_per_period", samples_per_period, 1, MOST_SAMPLES_PER_PERIOD)
    half_window_periods = count(
        "half_window_periods", half_window_periods, 1, MOST_SAMPLES_PER_PERIOD
    )
    rms, _, largest = compute_level(level_of(values, samples_per_period, half_window_periods))
    return float(rms), float(largest)


def level_of(
    values: NDArray[np.float64],
    samples_per_period: int,
    half_window_periods: int = HALF_WINDOW_PERIODS,
) -> LevelObserver:
    """Return the level observer of a run that has pushed ``values`` (S,) in m, one a sample from time 0."""
    level = new_level(samples_per_period, half_window_periods)._replace(
        block=np.ascontiguousarray(values, dtype=np.float64)
    )
    push_samples(level, 0, len(level.block))
    return level


def read_level(
    level: LevelObserver | None, drive: AnyDrive, interval: float
) -> ResponseLevel | None:
    """Return the level observer's result, or None."""
    if level is None:
        return None
    value, sample, largest = compute_level(level)
    at = min(float(sample) * interval, float(drive.schedule.times[-1]))
    ratio = float(drive.schedule.omega_at(at)) / drive.schedule.reference
    return ResponseLevel(float(value), at, ratio, float(largest))
