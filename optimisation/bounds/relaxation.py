"""The limit of a passive device by semidefinite programming, certified by its multipliers.

One complex unknown, the line r of the stroke; the tip's line is q = A + B r (see `optimisation.bounds.stroke`). The problem

    minimise |A + B r|^2    subject to    |r| <= R,    Im(r conj(q)) <= 0

is a quadratic programme with quadratic constraints. Its relaxation replaces |r|^2 by the corner of a matrix [[1, conj(r)], [r, x]] that is
positive semidefinite, x >= |r|^2. It is exact here: since Im(B) <= 0 both constraints are convex, so r of the relaxation itself is admissible.

The solver's number is not taken at its word. For any multipliers a >= 0 and c >= 0 the smallest value of the Lagrangian over all r is a lower
bound (weak duality), and it has a closed form. So the number given back is a limit whatever the solver's accuracy.

Everything is dimensionless: q over |A|, r over R, turned so that A is 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cvxpy
import numpy as np

from impact_env.modes import ModalModel
from impact_env.parameters import non_negative, positive
from optimisation.bounds.stroke import SWEPT, line_amplitude, line_responses, worst_frequency
from optimisation.convex import NotOptimalError, solve

_TOLERANCE = 1e-9
_AGREEMENT = 1e-4  # of the stuck beam's amplitude: limit by multipliers against the amplitude of the admissible line found
_ADMISSIBLE = 1e-5  # of the largest stroke: violation of the constraints by that line


@dataclass(frozen=True)
class PassiveLimit:
    """``rms`` in m: no passive device has a smaller stationary RMS. ``omega`` in rad/s. ``stroke``: line r in m of a stroke that comes that low.

    ``slack``: the matrix' x - |r|^2 over R^2; it may be above 0 only where the limit is 0 and many strokes serve.
    """

    rms: float
    omega: float
    stroke: complex
    slack: float


@lru_cache(maxsize=1)
def _programme() -> tuple[Any, Any, Any, list[Any]]:
    """Return problem, matrix over (1, Re r, Im r), parameters (Re b, Im b, |b|^2, 1/R^2) and constraints; so cvxpy compiles it only once."""
    matrix, data = cvxpy.Variable((3, 3), PSD=True), cvxpy.Parameter(4)
    real, imag, square = matrix[0, 1], matrix[0, 2], matrix[1, 1] + matrix[2, 2]
    # stroke at most R; no power into the beam: Im(r conj(1 + b r)) = Im(r) - Im(b) |r|^2
    constraints = [data[3] * square <= 1, imag - data[1] * square <= 0, matrix[0, 0] == 1]
    objective = 1 + 2 * (data[0] * real - data[1] * imag) + data[2] * square
    return cvxpy.Problem(cvxpy.Minimize(objective), constraints), matrix, data, constraints


def dual_bound(b: complex, largest: float, stroke: float, power: float) -> float:
    """Return min over r of |1 + b r|^2 + stroke (|r/largest|^2 - 1) + power Im(r conj(1 + b r)), a lower bound for multipliers 0 or above."""
    square = abs(b) ** 2 + stroke / largest**2 - power * b.imag
    slope = abs(2 * b - 1j * power)
    if slope == 0:
        return 1.0 - stroke
    return 1.0 - stroke - slope**2 / (4 * square) if square > 0 else -np.inf


def passive_limit(model: ModalModel, mass: float, gap: float, force: float, omega: float) -> PassiveLimit:
    """Return the limit of passive devices at one frequency.

    ``mass`` m_a in kg, ``gap`` g0 in m, ``force`` in N, ``omega`` in rad/s; assumptions as in `optimisation.bounds.stroke`. Raises ParameterError for
    numbers out of range, NotOptimalError if the solver's status is not ``optimal`` or its solution does not stand the checks.
    """
    amplitude, omega = non_negative("force", force), positive("omega", omega)
    size = line_amplitude(gap)
    by_force, kappa, joined = (complex(x) for x in line_responses(model, positive("mass", mass), omega))
    if amplitude * abs(by_force) == 0:
        return PassiveLimit(0.0, omega, 0j, 0.0)
    # b = B R/|A| with the phase of B = kappa/(1 - kappa); the joined beam's undamped resonance, 1 - kappa = 0, leaves any phase
    turn = abs(joined) / joined if joined != 0 else 1.0
    b = kappa * size / (amplitude * abs(by_force)) * turn
    unit, bound, slack = _solve(b)
    with np.errstate(divide="ignore"):
        scale = float(np.float64(amplitude * abs(by_force)) / np.float64(abs(joined)))
    phase = by_force / abs(by_force) * turn
    return PassiveLimit(float(scale * bound / np.sqrt(2)) if bound > 0 else 0.0, omega, size * unit * phase, slack)


def _solve(b: complex) -> tuple[complex, float, float]:
    """Return for A = 1 and R = 1 the stroke, the certified least amplitude, and the slack of the relaxation."""
    problem, matrix, data, constraints = _programme()
    largest = max(1.0, abs(b))  # where rest is in reach the stroke that gives it, 1/|b|, is the unit instead of R
    b = b / largest
    data.value = np.array([b.real, b.imag, abs(b) ** 2, 1 / largest**2])
    solve(problem, f"passive limit (ratio of strokes {largest:.6g})", _TOLERANCE)
    stroke, power = (max(0.0, float(constraint.dual_value)) for constraint in constraints[:2])
    bound = float(np.sqrt(max(0.0, dual_bound(b, largest, stroke, power))))
    r = complex(matrix.value[0, 1], matrix.value[0, 2])
    reached, flow = abs(1 + b * r), (r * np.conj(1 + b * r)).imag
    if abs(r) > largest + _ADMISSIBLE or flow > _ADMISSIBLE or reached - bound > _AGREEMENT:
        raise NotOptimalError(f"passive limit: the multipliers prove {bound:.9g}, and the stroke found reaches {reached:.9g} (power {flow:.3g})")
    return r / largest, bound, float(matrix.value[1, 1] + matrix.value[2, 2] - abs(r) ** 2) / largest**2


def passive_resonance_limit(
    model: ModalModel, mass: float, gap: float, force: float, resonance: int = 1, low: float = SWEPT[0], high: float = SWEPT[1]
) -> PassiveLimit:
    """Return the passive limit at the frequency in low..high times omega_r where the closed-form limit is largest.

    Whatever the frequency, it is a limit of the largest stationary level over the range; arguments and errors as in `passive_limit`.
    """
    return passive_limit(model, mass, gap, force, worst_frequency(model, mass, gap, force, resonance, low, high))
