"""Free and sliding orbits by the periodic Green's function.

The state is linear in the impulses, so that only the phases of the events need Newton's method.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import (
    require,
    word_of,
)
from impact_env.fields import check_fields
from impact_env.kernels.periodic.green import (
    CONVERGED,
    FORCE,
    GAP,
    LIMIT,
    NOT_CONVERGED,
    OMEGA,
    ORDER_LOST,
    RESTITUTION,
    SINGULAR,
    OrbitEquations,
    fill_conditions,
    new_orbit_workspace,
    solve_orbit,
)
from impact_env.kernels.periodic.structure import Point
from impact_env.periodic.case import Case
from impact_env.periodic.model_parameters import MODEL_PARAMETERS, difference_rule, domain_of
from impact_env.periodic.schedule import EventSchedule

Array = NDArray[np.float64]
NO_ORBIT_REASONS = {
    NOT_CONVERGED: "Newton's method did not converge",
    ORDER_LOST: "two events change places",
    SINGULAR: "the conditions are singular: a fold, or two events at once",
}
PARAMETERS = {
    "omega": OMEGA,
    "force": FORCE,
    "gap": GAP,
    "restitution": RESTITUTION,
    "friction_limit": LIMIT,
}
ALL_PARAMETERS = (*PARAMETERS, *MODEL_PARAMETERS)  # in which orbits and curves are continued


@dataclass(frozen=True, eq=False)
class Solution:
    """Events of an orbit that satisfy the conditions.

    Attributes
    ----------
    case : Case
        Structure, absorber, force and frequency.
    schedule : EventSchedule
        Kinds and order of the events.
    phases : array, (n,)
        Phase of the force at each event in rad.
    impulses : array, (n,)
        Impulse on the absorber at each event in N s, 0 at reversals.
    offset : float
        Mean relative displacement in m.
    error : float
        Largest scaled residual of the conditions.
    steps : int
        Number of Newton steps.
    """

    case: Case
    schedule: EventSchedule
    phases: Array
    impulses: Array
    offset: float
    error: float
    steps: int


@dataclass(frozen=True, eq=False)
class NoOrbit:
    """The reason why no orbit exists, and the end of the search.

    ``phases`` (n,) in rad are those at which the search ended.
    """

    case: Case
    schedule: EventSchedule
    reason: str
    phases: Array


def read_unknowns(solution: Solution) -> Array:
    """Return a solution's unknowns (m,).

    The unknowns are phases in rad, scaled impulses and, for a whole period, the scaled mean
    relative displacement.
    """
    case = solution.case
    schedule = solution.schedule
    parts = [solution.phases, solution.impulses[schedule.order.wall != 0] / case.scale.impulse]
    return np.concatenate(
        parts if schedule.symmetric else [*parts, [solution.offset / case.scale.length]]
    )


def make_solution(
    case: Case, schedule: EventSchedule, unknowns: Array, error: float, steps: int = 0
) -> Solution:
    """Return the solution with these unknowns (m,).

    Its first phase is moved into the first period.
    """
    n = len(schedule.events)
    wall = schedule.order.wall
    impulses = np.zeros(n)
    impulses[wall != 0] = unknowns[n : n + schedule.impacts] * case.scale.impulse
    offset = 0.0 if schedule.symmetric else float(unknowns[-1]) * case.scale.length
    whole = 2 * np.pi * schedule.period_multiple
    phases = unknowns[:n] - whole * np.floor(unknowns[0] / whole)
    return Solution(case, schedule, phases, impulses, offset, float(error), int(steps))


def new_system(m: int) -> OrbitEquations:
    """Return arrays for m conditions and their derivatives."""
    return OrbitEquations(np.zeros(m), np.zeros((m, m + len(PARAMETERS))))


def residual_and_jacobian(
    case: Case, schedule: EventSchedule, unknowns: Array
) -> tuple[Array, Array]:
    """Return the scaled conditions (m,) and their derivatives (m, m + 5).

    The derivatives are with respect to the unknowns, then to `PARAMETERS` in SI units.
    """
    order = schedule.order
    structure = case.structure
    m = len(unknowns)
    require(m == schedule.unknowns, "unknowns", m, f"{schedule.unknowns} numbers for this schedule")
    system = new_system(m)
    workspace = new_orbit_workspace(structure, order)
    fill_conditions(
        structure,
        case.point,
        order,
        np.asarray(unknowns, dtype=float),
        case.scale,
        workspace,
        system,
        True,
    )
    return system.residual, system.jacobian


def linear_states(case: Case, schedule: EventSchedule, phases: ArrayLike) -> Array:
    """Return all unknowns (m,) for given phases (n,) in rad.

    Impulses and mean relative displacement are the least-squares solution of the conditions, which
    are linear in them.
    """
    start = np.zeros(schedule.unknowns)
    n = len(schedule.events)
    start[:n] = phases
    residual, jacobian = residual_and_jacobian(case, schedule, start)
    start[n:] = np.linalg.lstsq(jacobian[:, n : len(start)], -residual, rcond=None)[0]
    return start


def solve(case: Case, schedule: EventSchedule, start: ArrayLike) -> Solution | NoOrbit:
    """Return the solution near ``start``, or the reason why there is none.

    ``start`` contains the unknowns (m,), or only the phases (n,) in rad, from which the other
    unknowns follow. Newton's method has an analytic Jacobian. A solution satisfies the conditions
    at the events; `impact_env.periodic.orbit` checks the motion between them. Raises ParameterError
    for a schedule with joined segments.
    """
    unknowns = np.array(start, dtype=float)
    z = (
        linear_states(case, schedule, unknowns)
        if len(unknowns) == len(schedule.events)
        else unknowns
    )
    require(
        len(z) == schedule.unknowns,
        "start",
        len(z),
        f"{len(schedule.events)} phases or {schedule.unknowns} unknowns",
    )
    status, steps, error = solve_orbit(
        case.structure, case.point, schedule.order, z, case.scale, new_system(len(z))
    )
    if status != CONVERGED:
        return NoOrbit(
            case,
            schedule,
            f"{NO_ORBIT_REASONS[status]} (residual {error:.1e} after {steps} steps)",
            z[: len(schedule.events)],
        )
    return make_solution(case, schedule, z, error, steps)


@dataclass(frozen=True, eq=False)
class Conditions:
    """The conditions at the events as a residual(z, parameter) for continuation.

    The parameter is one of `ALL_PARAMETERS`, in SI units.
    """

    case: Case
    schedule: EventSchedule
    parameter: str = "omega"

    def __post_init__(self) -> None:
        check_fields(self, parameter=word_of(ALL_PARAMETERS))

    def __call__(self, z: Array, value: float) -> tuple[Array, Array]:
        """Return the conditions (m,) at unknowns (m,), and their derivatives (m, m + 1).

        The derivatives are those by the unknowns and by the parameter.
        """
        return self.over(z, {self.parameter: value})

    def over(self, z: Array, values: dict[str, float]) -> tuple[Array, Array]:
        """Return conditions and derivatives with several parameters: one more column (m,) for each.

        Derivatives with respect to parameters of the modal model are differences of fourth order.
        Outside the domains of parameters the conditions are extrapolated along their tangent.
        """
        z = np.ascontiguousarray(z, dtype=float)
        point = self.case.point._replace(
            **{
                Point._fields[PARAMETERS[name]]: value
                for name, value in values.items()
                if name in PARAMETERS
            }
        )
        others = {name: value for name, value in values.items() if name in MODEL_PARAMETERS}
        domains = {name: domain_of(self.case.model, name) for name in others}
        inside = {name: float(np.clip(value, *domains[name])) for name, value in others.items()}
        system = self._fill(z, point, inside)
        residual = system.residual
        columns = [system.jacobian[:, : len(z)]]
        for name, value in values.items():
            if name in PARAMETERS:
                columns.append(system.jacobian[:, [len(z) + PARAMETERS[name]]])
                continue
            size = abs(float(getattr(self.case, name))) or 1.0
            points, weights = difference_rule(inside[name], domains[name], size)
            column = sum(
                weight * self._fill(z, point, inside | {name: float(at)}).residual
                for at, weight in zip(points, weights, strict=True)
            )
            columns.append(np.reshape(column, (-1, 1)))
            residual = residual + columns[-1][:, 0] * (value - inside[name])
        return residual, np.hstack(columns)

    def _fill(self, z: Array, point: Point, others: dict[str, float]) -> OrbitEquations:
        """Return the system at other parameters of the modal model.

        The units remain those of the original case.
        """
        order = self.schedule.order
        structure = (self.case.changed(**others) if others else self.case).structure
        system = new_system(len(z))
        workspace = new_orbit_workspace(structure, order)
        fill_conditions(structure, point, order, z, self.case.scale, workspace, system, True)
        return system
