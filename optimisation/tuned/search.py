"""Numerical tuning on the damped multi-mode model: the smallest peak (H-infinity) and the smallest variance (H2), from several starts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, TunedAbsorber, require
from optimisation.tuned.closed_forms import den_hartog, undamped_h2, undamped_minimax
from optimisation.tuned.scoring import HIGH, LOW, peak, require_wide_range, splits_inside
from optimisation.tuned.variance import h2_norm

_REFUSED = 1e3  # objective (log of the score) of a design that the range cannot score

Array = NDArray[np.float64]
Score = Callable[[TunedAbsorber], float]


def minimax(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1, low: float = LOW, high: float = HIGH) -> TunedAbsorber:
    """Return the stiffness and damping with the smallest `peak` over low..high times omega_r: H-infinity tuning.

    Designs with a natural frequency next to omega_r outside the range are excluded, so no peak can be pushed out of sight. Raises
    ParameterError if the range is too narrow for a tuned absorber of this mass.
    """
    exact, rule = undamped_minimax(model, mass_ratio, resonance), den_hartog(model, mass_ratio, resonance)
    return _smallest(lambda absorber: peak(model, absorber, resonance, low, high)[0], (exact, rule), model, resonance, low, high)


def minimum_h2(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1, low: float = LOW, high: float = HIGH) -> TunedAbsorber:
    """Return the stiffness and damping with the smallest `h2_norm` over low..high times omega_r; range and errors as in `minimax`."""
    exact, rule = undamped_h2(model, mass_ratio, resonance), den_hartog(model, mass_ratio, resonance)
    return _smallest(lambda absorber: h2_norm(model, absorber, resonance, low, high), (exact, rule), model, resonance, low, high)


def _smallest(score: Score, known: tuple[TunedAbsorber, TunedAbsorber], model: ModalModel, resonance: int, low: float, high: float) -> TunedAbsorber:
    """Return the absorber with the smallest score: Nelder-Mead in the logarithms of k and c from two known tunings and two detuned ones.

    The search is repeated from the best, because the optimum of a largest peak is a kink (two equal peaks).
    """
    mass_ratio = known[0].mass_ratio
    require_wide_range(model, mass_ratio, resonance, low, high)

    def absorber_at(logs: Array) -> TunedAbsorber:
        return TunedAbsorber(mass_ratio, float(np.exp(logs[0])), float(np.exp(logs[1])))

    def objective(logs: Array) -> float:
        absorber = absorber_at(logs)
        return float(np.log(score(absorber))) if splits_inside(model, absorber, resonance, low, high) else _REFUSED

    starts = [np.log([a.stiffness, a.damping]) for a in known]
    starts += [starts[0] + np.array([-0.15, 0.5]), starts[0] + np.array([0.15, -0.5])]

    def descend(start: Array, size: float, steps: float, gain: float) -> Array:
        options = {"initial_simplex": _simplex(start, size), "xatol": steps, "fatol": gain}
        return np.asarray(minimize(objective, start, method="Nelder-Mead", options=options).x)

    best = min((descend(start, 0.05, 1e-3, 1e-6) for start in starts), key=objective)
    for size in (1e-2, 1e-4):
        best = descend(best, size, 1e-8, 1e-12)
    require(objective(best) < _REFUSED, "scoring range (low, high)", (low, high), "wider: it must hold both natural frequencies around the resonance")
    return absorber_at(best)


def _simplex(x: Array, size: float) -> Array:
    return np.array([x, x + np.array([size, 0.0]), x + np.array([0.0, 3 * size])])
