"""Numerical tuning on the damped multi-mode model: the smallest peak (H-infinity) and the smallest variance (H2), from several starts."""

from collections.abc import Callable

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import minimize

from impact_env.frequency import LinearAbsorber, frequency_range, state_space
from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, TunedAbsorber, require
from optimisation.tuned.closed_forms import den_hartog, undamped_h2, undamped_minimax
from optimisation.tuned.scoring import HIGH, LOW, peak, require_wide_range, splits_inside

# H2: the response to white noise, from a Lyapunov equation, over all frequencies or over a range.
#
#     ||H||_2^2 = 1/(2 pi) integral of |H(i omega)|^2 over omega = c W c',    A W + W A' + b b' = 0.
#
# Over |omega| <= w the Gramian is S W + W S' with S = 1/(2 pi) times the integral of (i nu - A)^-1 from -w to w, which is
# i/(2 pi) log((A + i w)(A - i w)^-1); a range is the difference of two such. The range keeps a higher resonance from being drowned by the first.


Real = NDArray[np.float64]

_CONDITION = 1e9  # of the eigenvectors: above it their digits are lost


def _gramian(matrix: Real, b: Real) -> Real:
    return np.asarray(scipy.linalg.solve_continuous_lyapunov(matrix, -np.outer(b, b)))


def _stable(model: ModalModel, absorber: LinearAbsorber | None, reference: float) -> tuple[Real, Real, Real]:
    """Return the state space; raises ParameterError if a pole is not damped, since the variance is infinite then."""
    matrix, b, c = state_space(model, absorber, reference)
    decay = float(-np.max(np.linalg.eigvals(matrix).real))
    require(decay > 1e-12, "damping_ratio", model.damping_ratio, "above 0 at every mode, or an absorber that damps it: the variance is infinite")
    return matrix, b, c


def h2_norm_everywhere(model: ModalModel, absorber: LinearAbsorber | None) -> float:
    """Return the H2 norm of `tip_response` over all frequencies in m/(N sqrt(s)): RMS of the tip under white noise of unit intensity.

    Raises ParameterError for a mode without damping.
    """
    reference = float(model.omega[0])
    matrix, b, c = _stable(model, absorber, reference)
    return float(np.sqrt(reference * (c @ _gramian(matrix, b) @ c)))


def h2_norm(model: ModalModel, absorber: LinearAbsorber | None, resonance: int = 1, low: float = LOW, high: float = HIGH) -> float:
    """Return the part of the H2 norm that comes from low..high times omega_r (and its mirror image), in m/(N sqrt(s)).

    Raises ParameterError for a mode without damping and, with a TunedAbsorber, for a range that cannot hold both split peaks.
    """
    omega_r = model.resonance_omega(resonance)
    frequency_range(low, high)
    if isinstance(absorber, TunedAbsorber):
        require_wide_range(model, absorber.mass_ratio, resonance, low, high)
    matrix, b, c = _stable(model, absorber, omega_r)
    weighted = _gramian(matrix, b) @ c
    return float(np.sqrt(omega_r * 2 * max(0.0, _integrated(matrix, c, weighted, low, high))))


def _integrated(matrix: Real, c: Real, weighted: Real, low: float, high: float) -> float:
    """Return c (S(high) - S(low)) ``weighted``, S of the module's text: the logarithm of a matrix by its poles, or as such where two coincide."""
    s, vectors = np.linalg.eig(matrix)
    if np.linalg.cond(vectors) < _CONDITION:
        turned = [(np.log(-s - 1j * w) - np.log(-s + 1j * w)) for w in (low, high)]
        return float(np.real(1j / (2 * np.pi) * (c @ vectors) @ ((turned[1] - turned[0]) * np.linalg.solve(vectors, weighted))))
    shifts = [1j * w * np.eye(len(matrix)) for w in (low, high)]
    logs = [scipy.linalg.logm((matrix + shift) @ np.linalg.inv(matrix - shift)) for shift in shifts]
    return float(np.real(1j / (2 * np.pi) * c @ (logs[1] - logs[0]) @ weighted))


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
