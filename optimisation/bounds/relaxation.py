"""The limit of a passive device by semidefinite programming, certified by its multipliers.

One complex unknown, the line r of the stroke; the level's line is f A + B r, that of the device's
own place q = f A_a + B_a r (see `optimisation.bounds`). The problem

    minimise |f A + B r|^2    subject to    |r| <= R,    Im(r conj(q)) <= 0

is a quadratic programme with quadratic constraints. Its relaxation replaces |r|^2 by the corner of
a matrix [[1, conj(r)], [r, x]] that is positive semidefinite, x >= |r|^2. It is exact here: since
Im(B_a) <= 0 both constraints are convex, so r of the relaxation itself is admissible. Where the
level is that of the device's own place the limit is the closed form of `optimisation.bounds`;
elsewhere it may be higher.

The result does not depend on the solver's accuracy. For any multipliers a >= 0 and c >= 0 the
smallest value of the Lagrangian over all r is a lower bound (weak duality) in closed form. This
value is returned.

Everything is dimensionless: the level's line over |f A|, r over R, turned so that f A is 1; the
power's constraint is divided by |f A_a|.
"""

import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impact_env.checks import non_negative, positive, require
from impact_env.extras import optional
from impact_env.modes import ModalModel
from optimisation.bounds import lines, masses_of, output_shape, places, strokes_of

with optional():
    import cvxpy

_TOLERANCE = 1e-9
# of the stuck beam's amplitude: limit by multipliers against the amplitude of the admissible line
# found
_AGREEMENT = 1e-4
_ADMISSIBLE = 1e-5  # of the largest stroke: violation of the constraints by that line


@dataclass(frozen=True)
class PassiveLimit:
    """Smallest stationary RMS of any passive device at one frequency.

    ``rms``: that RMS in m. ``omega``: frequency in rad/s. ``stroke``: spectral line r in m of a
    stroke that reaches it.

    ``slack``: the matrix' x - |r|^2 over R^2; it may be above 0 only where the limit is 0 and many
    strokes serve.
    """

    rms: float
    omega: float
    stroke: complex
    slack: float


@lru_cache(maxsize=1)
def _programme() -> tuple[Any, Any, Any, list[Any]]:
    """Return the cvxpy problem, its matrix over (1, Re u, Im u), parameters and constraints.

    The result is cached, so that cvxpy compiles the problem only once.
    """
    matrix = cvxpy.Variable((3, 3), PSD=True)
    data = cvxpy.Parameter(7)
    real = matrix[0, 1]
    imag = matrix[0, 2]
    square = matrix[1, 1] + matrix[2, 2]
    # stroke at most R; no power into the beam: Im(u conj(a + c u)) = Im(u) Re(a) - Re(u) Im(a) -
    # Im(c) |u|^2
    constraints = [
        data[3] * square <= 1,
        data[4] * imag - data[5] * real - data[6] * square <= 0,
        matrix[0, 0] == 1,
    ]
    objective = 1 + 2 * (data[0] * real - data[1] * imag) + data[2] * square
    return cvxpy.Problem(cvxpy.Minimize(objective), constraints), matrix, data, constraints


def dual_bound(
    b: complex,
    largest: float,
    stroke: float,
    power: float,
    own: tuple[complex, complex] | None = None,
) -> float:
    """Return the lower bound of the passive limit for given multipliers, 0 or above.

    It is min over u of |1 + b u|^2 + stroke (|u/largest|^2 - 1) + power Im(u conj(a + c u)), with
    the multipliers ``stroke`` and ``power``.

    ``own``: (a, c), by default (1, b).
    """
    a, c = (1.0 + 0j, b) if own is None else own
    square = abs(b) ** 2 + stroke / largest**2 - power * c.imag
    slope = float(np.hypot(2 * b.real - power * a.imag, 2 * b.imag - power * a.real))
    if slope == 0:
        return 1.0 - stroke
    return 1.0 - stroke - slope**2 / (4 * square) if square > 0 else -np.inf


def passive_limit(
    model: ModalModel,
    mass: float,
    gap: float,
    force: float,
    omega: float,
    at: ArrayLike | None = None,
) -> PassiveLimit:
    """Return the limit of passive devices at one frequency.

    ``mass`` m_a is in kg, ``gap`` g0 in m, ``force`` in N and ``omega`` in rad/s; ``at`` (N_m,) is
    the mode shape at the place of the response level. The assumptions are those of
    `optimisation.bounds`, for one absorber. Raises ParameterError for numbers out of range,
    NotOptimalError if the solver's status is not ``optimal`` or its solution fails a check.
    """
    amplitude = non_negative("force", force)
    omega = positive("omega", omega)
    own_place = places(model)
    require(
        len(own_place) == 1,
        "model",
        f"with the places of {len(own_place)} absorbers",
        "one absorber: the passive limit is for a single device",
    )
    masses = masses_of(model, mass)
    size = float(strokes_of(model, gap)[0])
    level, own = (
        lines(model, masses, omega, place) for place in (output_shape(model, at), own_place[0])
    )
    by_force = amplitude * complex(level.force)
    if by_force == 0:
        return PassiveLimit(0.0, omega, 0j, 0.0)
    turn = by_force / abs(by_force)
    place = amplitude * complex(own.force)
    unit = abs(place) or 1.0
    # at an undamped resonance both lines grow along the same eigenvector, and only ratios of what
    # is left are used
    stroke, bound, slack = _solve(
        complex(level.strokes[0]) * size / abs(by_force),
        place / turn / unit,
        complex(own.strokes[0]) * size / unit,
    )
    rms = float(level.scale) * abs(by_force) * bound / np.sqrt(2) if bound > 0 else 0.0
    return PassiveLimit(float(rms), omega, size * stroke * turn, slack)


def _solve(b: complex, a: complex, c: complex) -> tuple[complex, float, float]:
    """Return the stroke u over R, the certified least level, and the slack of the relaxation.

    The level is given over |f A|.

    The level's line is 1 + b u for strokes |u| <= 1, the line of the device's own place, but for a
    factor, a + c u.
    """
    programme, matrix, data, constraints = _programme()
    largest = max(
        1.0, abs(b)
    )  # where rest is in reach the stroke that gives it, 1/|b|, is the unit instead of R
    b = b / largest
    c = c / largest
    data.value = np.array([b.real, b.imag, abs(b) ** 2, 1 / largest**2, a.real, a.imag, c.imag])
    solve(programme, f"passive limit (ratio of strokes {largest:.6g})", _TOLERANCE)
    stroke, power = (max(0.0, float(constraint.dual_value)) for constraint in constraints[:2])
    bound = float(np.sqrt(max(0.0, dual_bound(b, largest, stroke, power, (a, c)))))
    u = complex(matrix.value[0, 1], matrix.value[0, 2])
    reached = abs(1 + b * u)
    flow = float((u * np.conj(a + c * u)).imag)
    if abs(u) > largest + _ADMISSIBLE or flow > _ADMISSIBLE or reached - bound > _AGREEMENT:
        raise NotOptimalError(
            f"passive limit: the multipliers prove {bound:.9g}, and the stroke found reaches "
            f"{reached:.9g} (power {flow:.3g})"
        )
    return (
        u / largest,
        bound,
        float(matrix.value[1, 1] + matrix.value[2, 2] - abs(u) ** 2) / largest**2,
    )


with optional():
    import cvxpy


class NotOptimalError(RuntimeError):
    """A convex programme ended without an optimum.

    The message names the programme and the solver's status.
    """


def solve(problem: Any, what: str, tolerance: float) -> None:
    """Solve a cvxpy problem with CLARABEL.

    The duality gap and the feasibility are solved to ``tolerance``. Raises NotOptimalError unless
    the status is ``optimal``.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", UserWarning
            )  # an inaccurate solution is an error here, not a warning
            problem.solve(
                solver=cvxpy.CLARABEL,
                tol_gap_abs=tolerance,
                tol_gap_rel=tolerance,
                tol_feas=tolerance,
            )
    except cvxpy.error.SolverError as error:
        raise NotOptimalError(
            f"{what}: the solver failed ({error}); without an optimum there is no certificate"
        ) from error
    if problem.status != cvxpy.OPTIMAL:
        raise NotOptimalError(
            f"{what}: the solver ended with status {problem.status!r}, and only 'optimal' is "
            "a certificate"
        )
