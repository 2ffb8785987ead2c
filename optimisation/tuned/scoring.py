"""Scores of a linear absorber: the largest resonance peak over a range that holds both of the peaks into which it splits a resonance.

A narrower range, the paper's sweep limits for one, lets an optimiser push a peak out of sight, so it is refused.
"""

import numpy as np
from numpy.typing import NDArray

from impact_env.frequency import LinearAbsorber, frequency_range, natural_frequencies, poles, tip_response
from impact_env.modes import ModalModel
from impact_env.parameters import ParameterError, TunedAbsorber, require
from optimisation.tuned.closed_forms import effective_mass_ratio

LOW, HIGH = 0.5, 1.6  # scoring range in units of the resonance frequency

_GRID = 121
_INSIDE = np.linspace(0, 1, 21)
_ROUNDS = 6  # each round narrows tenfold: a peak's frequency to about 1e-8, its height to rounding
_BESIDE_POLE = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])  # grid points around a pole, in half-widths
_UNDAMPED = 1e-10  # a pole with a smaller damping ratio counts as undamped


def _closed_form_split(mu: float) -> tuple[float, float]:
    """Return the two undamped natural frequencies over omega_r for one mode with omega_a/omega_r = 1/(1 + mu)."""
    tuning = 1 / (1 + mu) ** 2
    half = (1 + (1 + mu) * tuning) / 2
    high = half + np.sqrt(half**2 - tuning)
    return float(np.sqrt(tuning / high)), float(np.sqrt(high))


def require_wide_range(model: ModalModel, mass_ratio: float, resonance: int, low: float, high: float) -> None:
    """Raise ParameterError unless [low, high] (over omega_r) holds both peaks that a well-tuned absorber of this mass leaves.

    Measured by the undamped natural frequencies of the Den Hartog tuning, which lie outside the two damped peaks.
    """
    frequency_range(low, high)
    first, second = _closed_form_split(effective_mass_ratio(model, mass_ratio, resonance))
    allowed = f"a scoring range that holds both peaks of the split resonance: low at most {first:.4f}, high at least {second:.4f} (of the resonance)"
    require(low <= first and high >= second, "scoring range (low, high)", (low, high), allowed)


def _inside(s: NDArray[np.complex128], low: float, high: float) -> NDArray[np.bool_]:
    """Return which poles lie in low..high, the ends included up to rounding: there an undamped response is infinite, too."""
    return np.asarray((s.imag >= low * (1 - 1e-12)) & (s.imag <= high * (1 + 1e-12)))


def _grid(model: ModalModel, absorber: LinearAbsorber | None, omega_r: float, low: float, high: float) -> NDArray[np.float64] | None:
    """Return frequency ratios that no resonance peak can hide between, or None if an undamped pole lies in the range."""
    s = poles(model, absorber) / omega_r
    inside = _inside(s, low, high)
    if np.any(-s.real[inside] <= _UNDAMPED * s.imag[inside]):
        return None
    s = s[(s.imag > low - 5 * np.abs(s.real)) & (s.imag < high + 5 * np.abs(s.real))]
    beside = (s.imag[:, None] + np.abs(s.real)[:, None] * _BESIDE_POLE).ravel()
    return np.unique(np.concatenate([np.linspace(low, high, _GRID), beside[(beside > low) & (beside < high)]]))


def peaks(model: ModalModel, absorber: LinearAbsorber | None, resonance: int = 1, low: float = LOW, high: float = HIGH) -> list[tuple[float, float]]:
    """Return all local maxima of the tip amplitude in [low, high] as (m/N, frequency over omega_r), in order of frequency; ends are left out.

    Arguments and errors as in `peak`; an undamped pole in the range raises ParameterError.
    """
    omega_r = model.resonance_omega(resonance)
    if isinstance(absorber, TunedAbsorber):
        require_wide_range(model, absorber.mass_ratio, resonance, low, high)
    frequency_range(low, high)
    grid = _grid(model, absorber, omega_r, low, high)
    if grid is None:
        raise ParameterError(f"damping_ratio = {model.damping_ratio!r} is not allowed: above 0 at every resonance of the range")
    return _local_maxima(model, absorber, omega_r, grid)


def _local_maxima(model: ModalModel, absorber: LinearAbsorber | None, omega_r: float, grid: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Return the local maxima on the grid, each refined by a grid of its own that shrinks tenfold a round."""
    amplitude = np.abs(tip_response(model, absorber, grid * omega_r))
    middle = amplitude[1:-1]
    at = 1 + np.flatnonzero((middle >= amplitude[:-2]) & (middle > amplitude[2:]))
    if len(at) == 0:
        return []
    left, right, refined, row = grid[at - 1], grid[at + 1], (amplitude[at], grid[at]), np.arange(len(at))
    for _ in range(_ROUNDS):
        x = left[:, None] + (right - left)[:, None] * _INSIDE
        y = np.abs(tip_response(model, absorber, x * omega_r))
        best = np.clip(np.argmax(y, axis=1), 1, len(_INSIDE) - 2)
        left, right, refined = x[row, best - 1], x[row, best + 1], (y[row, best], x[row, best])
    return [(float(height), float(ratio)) for height, ratio in zip(*refined, strict=True)]


def _highest(model: ModalModel, absorber: LinearAbsorber | None, omega_r: float, low: float, high: float) -> tuple[float, float]:
    grid = _grid(model, absorber, omega_r, low, high)
    if grid is None:
        s = poles(model, absorber) / omega_r
        return float("inf"), float(s.imag[np.argmin(np.where(_inside(s, low, high), -s.real, np.inf))])
    found = _local_maxima(model, absorber, omega_r, grid)
    return max(found or [(float(abs(tip_response(model, absorber, x * omega_r))), float(x)) for x in (low, high)])


def peak(model: ModalModel, absorber: LinearAbsorber | None, resonance: int = 1, low: float = LOW, high: float = HIGH) -> tuple[float, float]:
    """Return the highest resonance peak over low..high times omega_r: (tip amplitude per newton in m/N, its frequency over omega_r).

    A peak is a local maximum of the amplitude; a flank of a neighbouring resonance at an end of the range counts only if there is
    none. All modes and their damping take part, and a neighbouring resonance inside the range is scored with the rest: narrow the
    range for high modes, which lie close together. The grid contains every pole of the damped system with points around it, and
    local maxima are refined, so narrow peaks are not missed. Infinite if an undamped pole lies in the range. Raises ParameterError
    for a resonance that the model lacks and, with a TunedAbsorber, for a range that cannot hold both split peaks (see
    `require_wide_range`).
    """
    omega_r = model.resonance_omega(resonance)
    frequency_range(low, high)
    if isinstance(absorber, TunedAbsorber):
        require_wide_range(model, absorber.mass_ratio, resonance, low, high)
    return _highest(model, absorber, omega_r, low, high)


def highest_amplitude(
    model: ModalModel, absorber: LinearAbsorber | None, resonance: int = 1, low: float = LOW, high: float = HIGH
) -> tuple[float, float]:
    """Return the largest amplitude over low..high times omega_r, ends and flanks included: (m/N, its frequency over omega_r).

    It serves for limits and certificates, which know no difference between a peak and a flank; `peak` is the score. A range of any
    width may be asked for. Infinite if an undamped pole lies in the range.
    """
    omega_r = model.resonance_omega(resonance)
    frequency_range(low, high)
    ends = np.array([low, high])
    grid = _grid(model, absorber, omega_r, low, high)
    if grid is None:
        return _highest(model, absorber, omega_r, low, high)
    heights = np.abs(tip_response(model, absorber, ends * omega_r))
    return max(_local_maxima(model, absorber, omega_r, grid) + [(float(y), float(x)) for y, x in zip(heights, ends, strict=True)])


def splits_inside(model: ModalModel, absorber: TunedAbsorber, resonance: int, low: float, high: float) -> bool:
    """Return whether both natural frequencies around omega_r lie in low..high times omega_r: a peak outside would not be seen by a score."""
    first, second = natural_frequencies(model, absorber)[resonance - 1 : resonance + 1] / model.resonance_omega(resonance)
    return bool(low <= first and second <= high)
