"""Bifurcations of orbits: their kinds, test functions that vanish there, and their confirmation.

A multiplier on the unit circle makes a bifurcation: 1 at a fold, -1 where the symmetry breaks (over
half a period) or the period doubles, a complex pair at a torus (Kuznetsov, Elements of Applied
Bifurcation Theory, 2004). Determinants of the return map's derivative M have poles where an impact
gets infinitely slow, and change their sign there. The test functions here are products of one
bounded factor for each multiplier, or pair of them, times signs of the impacts' velocities and the
reversals' accelerations: they pass a pole without a change of sign.
"""

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from impact_env.periodic.branch import BRANCH_POINT, FOLD
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit, Solution, read_unknowns, solve
from impact_env.periodic.motion import AnyMotion, Motion, motion_of
from impact_env.periodic.orbit import Orbit, confirm_orbit
from impact_env.periodic.schedule import EventSchedule

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
# a multiplier of -1, of half a period and of a whole one
SYMMETRY_BREAKING = "symmetry breaking"
PERIOD_DOUBLING = "period doubling"
TORUS = "torus"  # a pair of complex multipliers on the unit circle (Neimark and Sacker)
ON_CIRCLE = 1e-6  # a multiplier this close to the unit circle lies on it; located places have 1e-9
CRITICAL_MULTIPLIERS = {
    FOLD: 1.0,
    BRANCH_POINT: 1.0,
    SYMMETRY_BREAKING: -1.0,
    PERIOD_DOUBLING: -1.0,
}
LEAST_HALF_DIFFERENCE = 1e-4  # of what tells the two halves apart: below it they are the same
NEAR_BIRTH = (
    1e-3  # the same next to a birth, and where the root search broke down on its way to one
)
LOST_BIRTH = 0.05
# share of the parameter: how far from a birth on a branch the orbit is sought that it leaves, and
# how sharply
BIRTH_REACH = 1e-6
BIRTH_TOL = 1e-14


def critical_multipliers(kind: str, multipliers: Complex, tolerance: float = ON_CIRCLE) -> Complex:
    """Return the multipliers over the schedule's span that cause a bifurcation of a ``kind``.

    These are multipliers next to 1 or -1; for a torus the upper one of a complex pair with a
    modulus next to 1. The result is empty without such a multiplier.
    """
    values = np.asarray(multipliers, dtype=complex)
    if kind == TORUS:
        upper = values[values.imag > tolerance]
        return upper[np.abs(np.abs(upper) - 1) < tolerance]
    return values[np.abs(values - CRITICAL_MULTIPLIERS[kind]) < tolerance]


def compute_multipliers(motion: AnyMotion) -> Complex | None:
    """Return the multipliers (2 N_m + 2,) over the schedule's span.

    The result is None if an impact has zero velocity.
    """
    matrix = motion.derivative
    return np.linalg.eigvals(matrix).astype(complex) if np.all(np.isfinite(matrix)) else None


def find_objection(kind: str, motion: AnyMotion) -> str | None:
    """Return the reason why a motion has no bifurcation of a ``kind``.

    The result is None if the motion has a multiplier of this bifurcation.
    """
    multipliers = compute_multipliers(motion)
    if multipliers is None:
        return "an impact without speed has no multipliers"
    if len(critical_multipliers(kind, multipliers)) > 0:
        return None
    if kind == TORUS:
        return "no pair of complex multipliers lies on the unit circle"
    return f"no multiplier is {CRITICAL_MULTIPLIERS[kind]:g}"


def confirmed_bifurcation(kind: str, motion: AnyMotion) -> Orbit | NoOrbit:
    """Return the orbit at a bifurcation of a ``kind``, or the reason why there is none.

    The exact method must confirm the orbit, and a multiplier must have the value that the
    bifurcation requires.
    """
    reason = find_objection(kind, motion)
    if reason is not None:
        solution = motion.solution
        return NoOrbit(solution.case, solution.schedule, reason, solution.phases)
    return confirm_orbit(motion)


def _orientation_of_impacts(motion: Motion) -> float:
    """Return the sign, 1 or -1, of the product of the relative velocities before all impacts.

    Each velocity is positive towards its wall.
    """
    solution = motion.solution
    wall = solution.schedule.order.wall
    return float(np.prod(np.where(wall * solution.impulses > 0, -1.0, 1.0)))


def _orientation_of_reversals(motion: Motion) -> float:
    """Return the sign, 1 or -1, of a product over all reversals.

    The factors are the relative accelerations before the reversals divided by the changes that
    friction causes.
    """
    return float(np.prod(np.where(motion.turning > 0, -1.0, 1.0)))


def minus_one_test(motion: Motion) -> float:
    """Return a function from -1 to 1 that is zero where a multiplier is -1, without a pole.

    The result is NaN if an impact has zero velocity.
    """
    values = compute_multipliers(motion)
    if values is None:
        return np.nan
    factors = (values + 1) / (1 + np.abs(values))
    sign = _orientation_of_impacts(motion) * _orientation_of_reversals(motion)
    return sign * float(np.prod(factors).real)


def plus_one_test(motion: Motion) -> float:
    """Return a function from -1 to 1 that is zero where a multiplier is 1, without a pole.

    The result is NaN if an impact has zero velocity.
    """
    values = compute_multipliers(motion)
    if values is None:
        return np.nan
    factors = (values - 1) / (1 + np.abs(values))
    sign = _orientation_of_impacts(motion) * _orientation_of_reversals(motion)
    return sign * float(np.prod(factors).real)


def torus_test(motion: Motion) -> float:
    """Return a function from -1 to 1 that is zero where two multipliers have the product 1.

    It has no pole. The result is NaN if an impact has zero velocity.

    At a slow impact the determinant of M stays finite: one multiplier grows without bounds, another
    vanishes and their product stays, so an even number of products changes its sign. At a reversal
    the determinant grows too, and an odd number of products changes its sign.
    """
    values = compute_multipliers(motion)
    if values is None:
        return np.nan
    first, second = np.triu_indices(len(values), 1)
    products = values[first] * values[second]
    factors = (products - 1) / (1 + np.abs(products))
    return _orientation_of_reversals(motion) * float(np.prod(factors).real)


def compute_half_difference(solution: Solution, side: float) -> Array:
    """Return the second half of the events less the first half times ``side``.

    The differences are those of phases in rad, and of impulses relative to the largest one. They
    are infinite for an odd number of events.
    """
    half = len(solution.phases) // 2
    if len(solution.phases) % 2:
        return np.array([np.inf])
    late = solution.phases[half:] - solution.phases[:half] - solution.schedule.turn / 2
    return np.append(
        late,
        (solution.impulses[half:] - side * solution.impulses[:half])
        / np.max(np.abs(solution.impulses)),
    )


def largest_half_difference(solution: Solution, side: float) -> float:
    """Return the largest difference of `compute_half_difference`."""
    return float(np.max(np.abs(compute_half_difference(solution, side))))


def kinds_of_birth(schedule: EventSchedule) -> tuple[tuple[float, str], ...]:
    """Return the bifurcations from which orbits with a schedule may emerge.

    Each is a pair (sign, kind): the second half of the orbit is ``sign`` times the first at the
    bifurcation.
    """
    if schedule.symmetric:
        return ()
    return (
        ((-1.0, SYMMETRY_BREAKING),) if schedule.period_multiple % 2 else ((1.0, PERIOD_DOUBLING),)
    )


def find_parent_at_birth(
    solution: Solution, parameter: str, apart: float = NEAR_BIRTH
) -> tuple[str, Solution] | None:
    """Return the bifurcation from which the orbits next to a solution emerge.

    It is a bifurcation in ``parameter``, returned as its kind and the orbit at it, whose span is
    half of the solution's and whose multiplier is -1. The solution has no symmetry or a doubled
    period. The result is None if both halves of the solution differ by more than ``apart`` (rad and
    shares of the largest impulse), or if no such orbit is found.
    """
    for side, kind in kinds_of_birth(solution.schedule):
        if not largest_half_difference(solution, side) < apart:
            continue
        half = len(solution.phases) // 2
        old = solution.schedule
        multiple = old.period_multiple if side < 0 else old.period_multiple // 2
        try:
            schedule = EventSchedule(old.events[:half], side < 0, multiple)
        except ParameterError:  # reversals of friction in another order in the other half
            return None
        start = Solution(
            solution.case,
            schedule,
            solution.phases[:half],
            solution.impulses[:half],
            0.0 if side < 0 else solution.offset,
            solution.error,
            solution.steps,
        )
        result = _solve_for_minus_one(start, parameter)
        return None if result is None else (kind, result)
    return None


def _solve_for_minus_one(start: Solution, parameter: str) -> Solution | None:
    """Return the orbit next to a solution at which `minus_one_test` vanishes.

    The parameter is varied by the secant method. The result is None if it does not converge to such
    an orbit.
    """
    last = [start]

    def test(value: float) -> float:
        case: Case = start.case.changed(**{parameter: value})
        near = solve(case, start.schedule, read_unknowns(last[-1]))
        if isinstance(near, NoOrbit):
            raise RuntimeError(near.reason)
        last.append(near)
        return minus_one_test(motion_of(near))

    value = float(getattr(start.case, parameter))
    unit = abs(value) if value != 0 else 1.0
    try:
        scipy.optimize.newton(
            test, value, x1=value + BIRTH_REACH * unit, tol=BIRTH_TOL * unit, maxiter=30
        )
    except (RuntimeError, ValueError):
        return None
    result = last[-1]
    away = abs(float(getattr(result.case, parameter)) - value) / unit
    return result if away < LEAST_HALF_DIFFERENCE else None
