"""The conditions of a bifurcation over two parameters: those of an orbit's events, and one more.

With the derivative M of the return map, of half a period for a symmetric orbit, a matrix A(M) is
singular. A is M - I at a fold and M + I where the symmetry breaks or the period doubles. At a torus
A is the second compound of M, whose eigenvalues are the products of two multipliers, less I
(Kuznetsov, Elements of Applied Bifurcation Theory, 2004, chapter 10). The condition is the smallest
singular value of A with the sign of its determinant. It is smooth where it vanishes, and finite
where an impact velocity tends to zero and M grows without bounds.

At grazing the additional condition is the distance from a wall where the relative velocity turns.
At a loss of contact it is an impulse. Where friction begins to hold, it is the acceleration at a
reversal.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.bifurcations import TORUS
from impact_env.periodic.branch import FOLD
from impact_env.periodic.case import Case
from impact_env.periodic.green import Conditions, Solution
from impact_env.periodic.motion import derivative_of, motion_of
from impact_env.periodic.orbit_branches import solution_in
from impact_env.periodic.schedule import EventSchedule
from impact_env.periodic.shooting import units_of

Array = NDArray[np.float64]
MATRIX_DIFFERENCE_STEP = 1e-6  # of the unknowns' scales, for the derivatives of A


def second_compound(matrix: Array) -> Array:
    """Return the second compound of a matrix (n, n), of shape (n (n - 1)/2,)^2.

    It consists of the matrix's minors m_ik m_jl - m_il m_jk with i < j and k < l. Its eigenvalues
    are the products of two eigenvalues of the matrix.
    """
    i, j = np.triu_indices(len(matrix), 1)
    return np.asarray(
        matrix[np.ix_(i, i)] * matrix[np.ix_(j, j)] - matrix[np.ix_(i, j)] * matrix[np.ix_(j, i)]
    )


@dataclass(frozen=True, eq=False)
class DefiningSystem:
    """The conditions of a bifurcation as a residual(y, value) over a parameter.

    The unknowns y (m + 1,) are those of the orbit, and omega in rad/s. Calling the object returns
    the residual (m + 1,) and its derivatives (m + 1, m + 2). ``scale`` (m + 1,) are the units of y,
    and ``limits`` the range of the parameter.
    """

    case: Case
    schedule: EventSchedule
    kind: str
    parameter: str
    scale: Array  # (m + 2,) of all unknowns and the parameter
    limits: tuple[float, float]

    def solution(self, x: Array) -> Solution:
        """Return the solution for all unknowns and the parameter (m + 2,).

        Beyond its limits the parameter may have no meaning, such as a restitution above 1; the
        solution is then that at the limit.
        """
        return solution_in(
            self.case,
            self.schedule,
            x[:-2],
            {"omega": float(x[-2]), self.parameter: float(np.clip(x[-1], *self.limits))},
        )

    def matrix(self, x: Array) -> Array:
        """Return A (see the module) for all unknowns and the parameter (m + 2,).

        States are in units of the gap, and of the gap times the frequency of the start.
        """
        if not x[-2] > 0:
            return np.full((1, 1), np.nan)
        units = units_of(self.case)
        derivative = derivative_of(self.solution(x)) * units / units[:, None]
        matrix = second_compound(derivative) if self.kind == TORUS else derivative
        return matrix + (-1.0 if self.kind in (FOLD, TORUS) else 1.0) * np.eye(len(matrix))

    def __call__(self, y: Array, value: float) -> tuple[Array, Array]:
        """Return the residual (m + 1,) and its derivatives (m + 1, m + 2)."""
        residual, jacobian = Conditions(self.case, self.schedule).over(
            y[:-1], {"omega": float(y[-1]), self.parameter: value}
        )
        x = np.append(y, value)
        last = np.nan
        gradient = np.full(len(x), np.nan)
        if np.all(np.isfinite(residual)) and x[-2] > 0:
            last, gradient = self.last_condition(x)
        return np.append(residual, last), np.vstack([jacobian, gradient])

    def last_condition(self, x: Array) -> tuple[float, Array]:
        """Return the condition of the bifurcation and its derivatives (m + 2,).

        Both are NaN if the map has no derivative.
        """
        matrix = self.matrix(x)
        if not np.all(np.isfinite(matrix)):
            return np.nan, np.full(len(x), np.nan)
        left, sizes, right = np.linalg.svd(matrix)
        # that of A's own determinant is lost to rounding on the curve
        sign = float(np.linalg.slogdet(left)[0] * np.linalg.slogdet(right)[0])

        def projected(at: Array) -> float:
            return float(left[:, -1] @ self.matrix(at) @ right[-1])

        return float(sign * sizes[-1]), sign * self.gradient(projected, x)

    def gradient(self, function: Callable[[Array], float], x: Array) -> Array:
        """Return the derivatives (m + 2,) of a function of all unknowns and the parameter.

        They are computed by central differences.
        """
        steps = MATRIX_DIFFERENCE_STEP * self.scale
        result = np.empty(len(x))
        for k, step in enumerate(steps):
            ahead = x.copy()
            back = x.copy()
            ahead[k] += step
            back[k] -= step
            result[k] = (function(ahead) - function(back)) / (2 * step)
        return result


@dataclass(frozen=True, eq=False)
class GrazingSystem(DefiningSystem):
    """The conditions of an orbit that touches a wall without impact.

    It touches the wall where the relative velocity reverses at ``touch`` (rad) after the first
    event.
    """

    touch: float = 0.0

    def last_condition(self, x: Array) -> tuple[float, Array]:
        """See `DefiningSystem`: the distance from the wall divided by the gap.

        It is NaN where the relative velocity does not reverse between impacts.
        """

        def distance(at: Array) -> float:
            solution = self.solution(at)
            phases, distances = turns_after_first(solution)
            if len(phases) == 0:
                return np.nan
            return float(distances[nearest_turn(phases, self.touch, solution.schedule.turn)])

        return distance(x), self.gradient(distance, x)


@dataclass(frozen=True, eq=False)
class LossSystem(DefiningSystem):
    """The conditions of an orbit with an impact of zero velocity.

    ``number`` is the number of this impact, counted from 0.
    """

    number: int = 0

    def last_condition(self, x: Array) -> tuple[float, Array]:
        """See `DefiningSystem`: the scaled impulse."""
        k = len(self.schedule.events) + self.number
        gradient = np.zeros(len(x))
        gradient[k] = 1.0
        return float(x[k]), gradient


def turns_after_first(solution: Solution) -> tuple[Array, Array]:
    """Return phases and distances from a wall where the relative velocity reverses.

    Only reversals between impacts are included. Phases (K,) are in rad after the first event,
    distances (K,) are over the gap.
    """
    motion = motion_of(solution)
    if len(motion.turns) == 0:
        return np.empty(0), np.empty(0)
    n = solution.case.model.modes
    states = motion.states(motion.turns)
    relative = states[:, n] - states[:, :n] @ solution.case.model.tip_shape
    after = (motion.turns - solution.phases[0]) % solution.schedule.turn
    return after, 1 - np.abs(relative) / solution.case.gap


def nearest_turn(phases: Array, touch: float, span: float) -> int:
    """Return the index of the phase (K,) that is nearest to ``touch``.

    Phases repeat after ``span`` (rad).
    """
    late = np.abs(phases - touch) % span
    return int(np.argmin(np.minimum(late, span - late)))
