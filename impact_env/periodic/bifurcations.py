"""Bifurcations of orbits: their kinds, test functions that vanish there, and their confirmation.

At a bifurcation a Floquet multiplier is on the unit circle: 1 at a fold; -1 at symmetry breaking
(over half a period) and at period doubling; a complex pair at a torus bifurcation (Kuznetsov,
Elements of Applied Bifurcation Theory, 2004). Multipliers belong to the derivative M of the return
map over the span of a schedule, which is half an orbit if the orbit is symmetric.

Determinants such as det(M - 1) have poles where the velocity of an impact vanishes, and change
their sign there. Each test function here is a product of one bounded factor for each multiplier, or
for each pair of multipliers, times signs of the impacts' velocities and the reversals'
accelerations. So it passes a pole without a change of sign.
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
# a multiplier of -1 over half a period, and over a whole one
SYMMETRY_BREAKING = "symmetry breaking"
PERIOD_DOUBLING = "period doubling"
TORUS = "torus"  # a pair of complex multipliers on the unit circle (Neimark and Sacker)
ON_CIRCLE = 1e-6  # tolerance of a multiplier on the unit circle; located bifurcations reach 1e-9
CRITICAL_MULTIPLIERS = {
    FOLD: 1.0,
    BRANCH_POINT: 1.0,
    SYMMETRY_BREAKING: -1.0,
    PERIOD_DOUBLING: -1.0,
}
LEAST_HALF_DIFFERENCE = 1e-4  # below this difference the two halves of an orbit are equal
# difference of the halves next to a bifurcation from which the orbits emerge, and where the root
# search failed on its way to one
NEAR_BIRTH = 1e-3
LOST_BIRTH = 0.05
# first step and tolerance of the parameter, relative, in the search for such a bifurcation
BIRTH_REACH = 1e-6
BIRTH_TOL = 1e-14


def critical_multipliers(kind: str, multipliers: Complex, tolerance: float = ON_CIRCLE) -> Complex:
    """Return those of the ``multipliers`` that have the value of a bifurcation of a ``kind``.

    They are within ``tolerance`` of 1 or -1; for a torus they have a modulus within ``tolerance``
    of 1 and a positive imaginary part. The result is empty without such a multiplier.
    """
    values = np.asarray(multipliers, dtype=complex)
    if kind == TORUS:
        upper = values[values.imag > tolerance]
        return upper[np.abs(np.abs(upper) - 1) < tolerance]
    return values[np.abs(values - CRITICAL_MULTIPLIERS[kind]) < tolerance]


def compute_multipliers(motion: AnyMotion) -> Complex | None:
    """Return the Floquet multipliers (2 N_m + 2,) over the span of the motion's schedule.

    The result is None if an impact has zero relative velocity.
    """
    matrix = motion.derivative
    return np.linalg.eigvals(matrix).astype(complex) if np.all(np.isfinite(matrix)) else None


def find_objection(kind: str, motion: AnyMotion) -> str | None:
    """Return the reason, as text, why a motion has no bifurcation of a ``kind``.

    The result is None if a multiplier of the motion has the value of this bifurcation.
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
    """Return a motion as an orbit at a bifurcation of a ``kind``, or the reason why it is none.

    A multiplier must have the value of the bifurcation, and the exact method must confirm the
    orbit.
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
    """Return -1 if an odd number of reversals have a positive `Motion.turning`, else 1.

    `Motion.turning` is the relative acceleration before a reversal over its change by friction.
    """
    return float(np.prod(np.where(motion.turning > 0, -1.0, 1.0)))


def minus_one_test(motion: Motion) -> float:
    """Return a test function of period doubling and symmetry breaking, from -1 to 1.

    It is zero where a multiplier is -1, and has no pole. The result is NaN if an impact has zero
    relative velocity.
    """
    values = compute_multipliers(motion)
    if values is None:
        return np.nan
    factors = (values + 1) / (1 + np.abs(values))
    sign = _orientation_of_impacts(motion) * _orientation_of_reversals(motion)
    return sign * float(np.prod(factors).real)


def plus_one_test(motion: Motion) -> float:
    """Return a test function of folds and branch points, from -1 to 1.

    It is zero where a multiplier is 1, and has no pole. The result is NaN if an impact has zero
    relative velocity.
    """
    values = compute_multipliers(motion)
    if values is None:
        return np.nan
    factors = (values - 1) / (1 + np.abs(values))
    sign = _orientation_of_impacts(motion) * _orientation_of_reversals(motion)
    return sign * float(np.prod(factors).real)


def torus_test(motion: Motion) -> float:
    """Return a test function of torus bifurcations, from -1 to 1.

    It is zero where two multipliers have the product 1, and has no pole. The product is also 1 for
    two real multipliers, which is no bifurcation. The result is NaN if an impact has zero relative
    velocity.

    Where the velocity of an impact passes zero, det M stays finite: one multiplier grows without
    bound, another vanishes, and their product stays finite. So an even number of products changes
    its sign, and no factor for impacts is needed. At a reversal det M grows without bound too, and
    an odd number of products changes its sign.
    """
    values = compute_multipliers(motion)
    if values is None:
        return np.nan
    first, second = np.triu_indices(len(values), 1)
    products = values[first] * values[second]
    factors = (products - 1) / (1 + np.abs(products))
    return _orientation_of_reversals(motion) * float(np.prod(factors).real)


def compute_half_difference(solution: Solution, side: float) -> Array:
    """Return the differences between the second and the first half of an orbit's events.

    They are, for each pair of events, the difference of the phases in rad, less half of the orbit,
    and then the second impulse less ``side`` (1 or -1) times the first, over the largest impulse.
    For an odd number of events the result is [inf].
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
    """Return the largest absolute value of `compute_half_difference`."""
    return float(np.max(np.abs(compute_half_difference(solution, side))))


def kinds_of_birth(schedule: EventSchedule) -> tuple[tuple[float, str], ...]:
    """Return the bifurcations from which orbits with a schedule may emerge as (sign, kind).

    At the bifurcation the second half of the orbit is ``sign`` times the first: -1 at symmetry
    breaking, 1 at period doubling. The result is empty for a symmetric schedule.
    """
    if schedule.symmetric:
        return ()
    return (
        ((-1.0, SYMMETRY_BREAKING),) if schedule.period_multiple % 2 else ((1.0, PERIOD_DOUBLING),)
    )


def find_parent_at_birth(
    solution: Solution, parameter: str, apart: float = NEAR_BIRTH
) -> tuple[str, Solution] | None:
    """Return the bifurcation in ``parameter`` from which orbits like a solution emerge.

    The solution is unsymmetric, after symmetry breaking, or has a doubled period. Next to the
    bifurcation its halves are nearly equal, up to the sign. The result is the kind of the
    bifurcation, and the orbit there: it has half of the solution's span and a multiplier of -1. The
    result is None if the halves differ by ``apart`` or more, as by `largest_half_difference`, or if
    no such orbit is found.
    """
    for side, kind in kinds_of_birth(solution.schedule):
        if not largest_half_difference(solution, side) < apart:
            continue
        half = len(solution.phases) // 2
        old = solution.schedule
        multiple = old.period_multiple if side < 0 else old.period_multiple // 2
        try:
            schedule = EventSchedule(old.events[:half], side < 0, multiple)
        except ParameterError:  # the halves have slip reversals in different orders
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

    ``parameter`` is varied by the secant method. The result is None if that does not converge, or
    if the parameter changes by `LEAST_HALF_DIFFERENCE` (relative) or more.
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
