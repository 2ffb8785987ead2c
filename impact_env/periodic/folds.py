"""Folds of orbits with given events, and births and mergers of branches.

Folds are located by Newton's method on the fold's own conditions. Births and mergers are folds
whose force has zero slope over the frequency.

At a fold the Jacobian F_z of the conditions has a null vector v (Moore and Spence): F = 0, F_z v =
0, |v| = 1. With the left null vector w the force f of the fold has the slope df/domega = -(w
F_omega)/(w F_f), so its minima and maxima over the frequency are zeros of w F_omega.
"""

from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from impact_env.periodic.case import Case
from impact_env.periodic.green import (
    PARAMETERS,
    Conditions,
    NoOrbit,
    Solution,
    linear_states,
    make_solution,
    read_unknowns,
    residual_and_jacobian,
)
from impact_env.periodic.motion import Motion, motion_of
from impact_env.periodic.orbit import is_consistent, order_of_motion, reorder_events
from impact_env.periodic.schedule import EventSchedule

Array = NDArray[np.float64]
MOST_FOLD_STEPS = 25
FOLD_DIFFERENCE_STEP = 1e-5
FOLD_TOL = 1e-12
# of the unknowns and of the scaled conditions of a fold: beyond them Newton's method has not come
# to one
STEP_TOL = 1e-8
RESIDUAL_TOL = 1e-9
START_FACTORS = (
    1.001,
    1.004,
    1.02,
)  # of the fold's force: where two orbits are far enough apart for Newton's method to find one
MOST_FOLD_REORDERINGS = 6
LEVEL_FOLD_TOL = 1e-11  # rad/s of the frequency, relative


@dataclass(frozen=True, eq=False)
class Fold:
    """A fold in one parameter: the motion at it, and the ``slope`` df/domega of its force (N s)."""

    motion: Motion
    slope: float

    @property
    def case(self) -> Case:
        """Structure, absorber, force and frequency at the fold."""
        return self.motion.solution.case


def _null_vectors(jacobian: Array) -> tuple[Array, Array]:
    """Return the left and the right singular vector (m,) of a matrix's smallest singular value."""
    left, _, right = np.linalg.svd(jacobian)
    return left[:, -1], right[-1]


def find_fold(solution: Solution, parameter: str = "omega") -> Fold | NoOrbit:
    """Return the fold next to a solution with the same events, or the reason why there is none.

    The fold is in ``parameter``, one of `PARAMETERS`.
    """
    case = solution.case
    schedule = solution.schedule
    conditions = Conditions(case, schedule, parameter)
    z = read_unknowns(solution)
    value = getattr(case, parameter)
    unit = abs(value) if value != 0 else 1.0
    m = len(z)
    v = _null_vectors(conditions(z, value)[1][:, :m])[1]
    normal = v
    error = np.inf
    for _ in range(MOST_FOLD_STEPS):
        residual, jacobian = conditions(z, value)
        bend = (
            conditions(z + FOLD_DIFFERENCE_STEP * v, value)[1]
            - conditions(z - FOLD_DIFFERENCE_STEP * v, value)[1]
        ) / (2 * FOLD_DIFFERENCE_STEP)
        rest = np.concatenate([residual, jacobian[:, :m] @ v, [normal @ v - 1]])
        whole = np.zeros((2 * m + 1, 2 * m + 1))
        whole[:m, :m], whole[:m, -1] = jacobian[:, :m], jacobian[:, m] * unit
        whole[m:-1, :m], whole[m:-1, m:-1], whole[m:-1, -1] = (
            bend[:, :m],
            jacobian[:, :m],
            bend[:, m] * unit,
        )
        whole[-1, m:-1] = normal
        try:
            step = np.linalg.solve(whole, -rest)
        except np.linalg.LinAlgError:
            return NoOrbit(
                case, schedule, "the conditions of a fold are singular", z[: len(schedule.events)]
            )
        z = z + step[:m]
        v = v + step[m:-1]
        value = value + unit * step[-1]
        error = float(np.max(np.abs(step)))
        if not np.isfinite(error) or error > 1e3 or value <= 0 or error < FOLD_TOL:
            break
    left = np.inf
    if np.isfinite(error) and value > 0:
        residual, jacobian = conditions(z, value)  # behind the last step
        left = float(max(np.max(np.abs(residual)), np.max(np.abs(jacobian[:, :m] @ v))))
    if not (error < STEP_TOL and left < RESIDUAL_TOL):
        return NoOrbit(
            case,
            schedule,
            f"no fold in {parameter} near here (residual {left:.1e}, last step {error:.1e})",
            z[: len(schedule.events)],
        )
    at = case.changed(**{parameter: value})
    return _fold_from_solution(make_solution(at, schedule, z, float(np.max(np.abs(residual)))))


def _fold_from_solution(solution: Solution) -> Fold | NoOrbit:
    z = read_unknowns(solution)
    if (
        np.any(np.diff(solution.phases) <= 0)
        or solution.phases[-1] >= solution.phases[0] + solution.schedule.turn
    ):
        return NoOrbit(
            solution.case, solution.schedule, "two events change places", solution.phases
        )
    jacobian = residual_and_jacobian(solution.case, solution.schedule, z)[1]
    left = _null_vectors(jacobian[:, : len(z)])[0]
    by = left @ jacobian[:, len(z) :]
    return Fold(motion_of(solution), float(-by[PARAMETERS["omega"]] / by[PARAMETERS["force"]]))


def shift_from_fold(case: Case, schedule: EventSchedule, z: Array, share: float) -> Array:
    """Return approximate unknowns (m,) of one of the two orbits that emerge from a fold.

    ``z`` (m,) are the unknowns at the fold. The orbit has ``share`` times the force of the fold. To
    second order z moves along the null vector v by s with (w D_v F_z v) s^2/2 + w F_f df = 0.
    """
    conditions = Conditions(case, schedule, "force")
    m = len(z)
    jacobian = conditions(z, case.force)[1]
    w, v = _null_vectors(jacobian[:, :m])
    bend = (
        conditions(z + FOLD_DIFFERENCE_STEP * v, case.force)[1]
        - conditions(z - FOLD_DIFFERENCE_STEP * v, case.force)[1]
    )[:, :m] / (2 * FOLD_DIFFERENCE_STEP)
    square = -2 * (w @ jacobian[:, m]) * case.force * (share - 1) / (w @ bend @ v)
    return np.asarray(z + np.sqrt(abs(square)) * v)


def find_reordered_fold(
    case: Case, schedule: EventSchedule, start: Array, parameter: str = "omega"
) -> Fold | NoOrbit:
    """Return the fold near ``case`` and ``start`` with consistent reversals, or why there is none.

    ``start`` (m,) are unknowns. The reversals in the fold's schedule are those of its motion.
    Newton's method for orbits fails at a fold, so the order of events is first determined at a
    slightly larger force.
    """
    motion = _find_reordered_orbit(case, schedule, start)
    for _ in range(MOST_FOLD_REORDERINGS):
        if isinstance(motion, NoOrbit):
            return motion
        solution = motion.solution
        fold = find_fold(
            make_solution(case, solution.schedule, read_unknowns(solution), solution.error),
            parameter,
        )
        if isinstance(fold, NoOrbit) or case.friction_limit == 0 or is_consistent(fold.motion):
            return fold
        case = fold.case
        (order, phases) = order_of_motion(fold.motion)
        motion = _find_reordered_orbit(case, order, linear_states(case, order, phases))
    return NoOrbit(
        case, schedule, "the order of its reversals does not settle", start[: len(schedule.events)]
    )


def _find_reordered_orbit(case: Case, schedule: EventSchedule, start: Array) -> Motion | NoOrbit:
    result: Motion | NoOrbit = NoOrbit(
        case, schedule, "no orbit beside the fold", start[: len(schedule.events)]
    )
    for share in START_FACTORS:
        result = reorder_events(
            case.changed(force=case.force * share),
            schedule,
            shift_from_fold(case, schedule, start, share),
        )
        if not isinstance(result, NoOrbit):
            break
    return result


def find_level_fold(fold: Fold, reach: float) -> Fold | NoOrbit:
    """Return the fold near ``fold`` whose force has zero slope over the frequency.

    It is within ``reach`` (rad/s) and is a birth or a merger.
    """
    last = [fold]
    lost = list[NoOrbit]()

    def slope(omega: float) -> float:
        solution = last[-1].motion.solution
        neighbour = find_reordered_fold(
            solution.case.changed(omega=omega), solution.schedule, read_unknowns(solution), "force"
        )
        if isinstance(neighbour, NoOrbit):
            lost.append(neighbour)
            raise RuntimeError(neighbour.reason)
        last.append(neighbour)
        return neighbour.slope

    omega = fold.case.omega
    try:
        scipy.optimize.newton(
            slope, omega, x1=omega + 0.01 * reach, tol=LEVEL_FOLD_TOL * omega, maxiter=30
        )
    except RuntimeError as error:
        return (
            lost[0]
            if lost
            else NoOrbit(
                fold.case,
                fold.motion.solution.schedule,
                f"no level fold near here: {error}",
                fold.motion.solution.phases,
            )
        )
    result = last[-1]
    if abs(result.case.omega - omega) > reach:
        return NoOrbit(
            result.case,
            result.motion.solution.schedule,
            "its level fold lies elsewhere",
            result.motion.solution.phases,
        )
    return result
