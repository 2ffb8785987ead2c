"""Tuning of the linear absorber (LTVA): closed forms as start values and tests, a numerical minimax as the answer.

The mass ratio that counts for a resonance is the *effective* one, mu = m_a phi_tip,r^2, absorber mass over the modal mass seen at
the tip: four times the plain ratio to the beam's mass for the free end of a cantilever. The paper (section 6) names Den Hartog's
rule, but its values follow from a modal mass of one and twice the rule's damping: `PAPER` is mistuned, and a fair comparison shows
a well-tuned absorber beside it.

A score is the largest tip amplitude per newton over a range that holds both of the peaks into which a tuned absorber splits a resonance.
A narrower range, the paper's sweep limits for one, lets an optimiser push a peak out of sight, so it is refused.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, ParameterError, TunedAbsorber, finite, positive, require
from optimisation.response import LinearAbsorber, natural_frequencies, poles, tip_response

PAPER = TunedAbsorber()  # the paper's values are the defaults
LOW, HIGH = 0.5, 1.6  # scoring range in units of the resonance frequency

_GRID = 121
_INSIDE = np.linspace(0, 1, 21)
_ROUNDS = 6  # each round narrows tenfold: a peak's frequency to about 1e-8, its height to rounding
_BESIDE_POLE = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])  # grid points around a pole, in half-widths
_REFUSED = 1e3  # objective (log of m/N) of a design that the range cannot score
_UNDAMPED = 1e-10  # a pole with a smaller damping ratio counts as undamped


def effective_mass_ratio(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> float:
    """Return mu = m_a phi_tip,r^2, the absorber mass over the resonance's effective modal mass at the tip.

    ``mass_ratio`` is m_a over the beam's mass. Raises ParameterError if the mode has a node at the absorber: nothing can be tuned there.
    """
    model.resonance_omega(resonance)
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    shape = float(model.tip_shape[resonance - 1])
    require(shape != 0, f"tip_shape of mode {resonance}", shape, "not 0: an absorber at a node of a mode cannot act on it")
    return mass * shape**2


def _tuned(model: ModalModel, mass_ratio: float, resonance: int, frequency_ratio: float, damping_ratio: float) -> TunedAbsorber:
    """Return the absorber with omega_a = frequency_ratio * omega_r and c = 2 m_a omega_a * damping_ratio."""
    mass, omega = mass_ratio * model.beam_mass, frequency_ratio * model.resonance_omega(resonance)
    return TunedAbsorber(mass_ratio, mass * omega**2, 2 * mass * omega * damping_ratio)


def den_hartog(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> TunedAbsorber:
    """Return Den Hartog's tuning of a resonance: fixed points of equal height, damping the mean of the two that flatten one of them.

    omega_a/omega_r = 1/(1 + mu), c/(2 m_a omega_a) = sqrt(3 mu / (8 (1 + mu))) with the effective mu (one undamped mode). The same
    damping referred to the beam's frequency, c/(2 m_a omega_r), has (1 + mu)^3 under the root: the two forms are easily confused.
    """
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    return _tuned(model, mass_ratio, resonance, 1 / (1 + mu), float(np.sqrt(3 * mu / (8 * (1 + mu)))))


def undamped_minimax(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> TunedAbsorber:
    """Return the exact minimum of the largest amplitude for one undamped mode (force to displacement): both peaks are equal.

    With r = sqrt(4 + 3 mu): omega_a/omega_r = 2/(1 + mu) sqrt(2 (16 + 23 mu + 9 mu^2 + 2 (2 + mu) r) / (3 (64 + 80 mu + 27 mu^2)))
    and c/(2 m_a omega_a) = sqrt((8 + 9 mu - 4 r)/(1 + mu))/4 (the closed-form exact solution of Nishihara and Asami).
    """
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    r = np.sqrt(4 + 3 * mu)
    frequency = 2 / (1 + mu) * np.sqrt(2 * (16 + 23 * mu + 9 * mu**2 + 2 * (2 + mu) * r) / (3 * (64 + 80 * mu + 27 * mu**2)))
    # 8 + 9 mu - 4 r without the cancellation at small mu
    damping = np.sqrt((9 * mu - 12 * mu / (r + 2)) / (1 + mu)) / 4
    return _tuned(model, mass_ratio, resonance, float(frequency), float(damping))


def _closed_form_split(mu: float) -> tuple[float, float]:
    """Return the two undamped natural frequencies over omega_r for one mode with omega_a/omega_r = 1/(1 + mu)."""
    tuning = 1 / (1 + mu) ** 2
    half = (1 + (1 + mu) * tuning) / 2
    high = half + np.sqrt(half**2 - tuning)
    return float(np.sqrt(tuning / high)), float(np.sqrt(high))


def _check_range(low: float, high: float) -> None:
    positive("low", low)
    finite("high", high)
    require(high > low, "high", high, f"above low = {low}")


def require_wide_range(model: ModalModel, mass_ratio: float, resonance: int, low: float, high: float) -> None:
    """Raise ParameterError unless [low, high] (over omega_r) holds both peaks that a well-tuned absorber of this mass leaves.

    Measured by the undamped natural frequencies of the Den Hartog tuning, which lie outside the two damped peaks.
    """
    _check_range(low, high)
    first, second = _closed_form_split(effective_mass_ratio(model, mass_ratio, resonance))
    allowed = f"a scoring range that holds both peaks of the split resonance: low at most {first:.4f}, high at least {second:.4f} (of the resonance)"
    require(low <= first and high >= second, "scoring range (low, high)", (low, high), allowed)


def _grid(model: ModalModel, absorber: LinearAbsorber | None, omega_r: float, low: float, high: float) -> NDArray[np.float64] | None:
    """Return frequency ratios that no resonance peak can hide between, or None if an undamped pole lies in the range."""
    s = poles(model, absorber) / omega_r
    s = s[(s.imag > low - 5 * np.abs(s.real)) & (s.imag < high + 5 * np.abs(s.real))]
    inside = (s.imag >= low) & (s.imag <= high)
    if np.any(-s.real[inside] <= _UNDAMPED * s.imag[inside]):
        return None
    beside = (s.imag[:, None] + np.abs(s.real)[:, None] * _BESIDE_POLE).ravel()
    return np.unique(np.concatenate([np.linspace(low, high, _GRID), beside[(beside > low) & (beside < high)]]))


def peaks(model: ModalModel, absorber: LinearAbsorber | None, resonance: int = 1, low: float = LOW, high: float = HIGH) -> list[tuple[float, float]]:
    """Return all local maxima of the tip amplitude in [low, high] as (m/N, frequency over omega_r), in order of frequency; ends are left out.

    Arguments and errors as in `peak`; an undamped pole in the range raises ParameterError.
    """
    omega_r = model.resonance_omega(resonance)
    if isinstance(absorber, TunedAbsorber):
        require_wide_range(model, absorber.mass_ratio, resonance, low, high)
    _check_range(low, high)
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
        return float("inf"), float(s.imag[np.argmin(np.where((s.imag >= low) & (s.imag <= high), -s.real, np.inf))])
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
    _check_range(low, high)
    if isinstance(absorber, TunedAbsorber):
        require_wide_range(model, absorber.mass_ratio, resonance, low, high)
    return _highest(model, absorber, omega_r, low, high)


def minimax(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1, low: float = LOW, high: float = HIGH) -> TunedAbsorber:
    """Return the stiffness and damping with the smallest `peak` over low..high times omega_r.

    H-infinity tuning on the damped multi-mode model: Nelder-Mead in the logarithms of k and c from both closed forms and two detuned
    starts, then again from the best, because the optimum is a kink (two equal peaks). Designs with a natural frequency next to
    omega_r outside the range are excluded, so no peak can be pushed out of sight. Raises ParameterError if the range is too narrow
    for a tuned absorber of this mass.
    """
    omega_r = model.resonance_omega(resonance)
    require_wide_range(model, mass_ratio, resonance, low, high)

    def absorber_at(logs: NDArray[np.float64]) -> TunedAbsorber:
        return TunedAbsorber(mass_ratio, float(np.exp(logs[0])), float(np.exp(logs[1])))

    def objective(logs: NDArray[np.float64]) -> float:
        absorber = absorber_at(logs)
        first, second = natural_frequencies(model, absorber)[resonance - 1 : resonance + 1] / omega_r
        # a natural frequency outside the range is a peak that the score would not see
        return float(np.log(_highest(model, absorber, omega_r, low, high)[0])) if low <= first and second <= high else _REFUSED

    exact, rule = undamped_minimax(model, mass_ratio, resonance), den_hartog(model, mass_ratio, resonance)
    starts = [np.log([a.stiffness, a.damping]) for a in (exact, rule)]
    starts += [starts[0] + np.array([-0.15, 0.5]), starts[0] + np.array([0.15, -0.5])]

    def descend(start: NDArray[np.float64], size: float, steps: float, gain: float) -> NDArray[np.float64]:
        options = {"initial_simplex": _simplex(start, size), "xatol": steps, "fatol": gain}
        return np.asarray(minimize(objective, start, method="Nelder-Mead", options=options).x)

    best = min((descend(start, 0.05, 1e-3, 1e-6) for start in starts), key=objective)
    for size in (1e-2, 1e-4):
        best = descend(best, size, 1e-8, 1e-12)
    require(objective(best) < _REFUSED, "scoring range (low, high)", (low, high), "wider: it must hold both natural frequencies around the resonance")
    return absorber_at(best)


def _simplex(x: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    return np.array([x, x + np.array([size, 0.0]), x + np.array([0.0, 3 * size])])
