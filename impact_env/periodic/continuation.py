"""Pseudo-arclength continuation.

It is used for exact orbits and for harmonic balance, with any parameter.

It has a tangent predictor, a Newton corrector in the plane across the tangent, and a step length
that depends on the number of Newton steps and on the curvature (Allgower and Georg, Numerical
Continuation Methods, 1990; Seydel, Practical Bifurcation and Stability Analysis, 2010). It locates
folds (the tangent's component of the parameter changes sign), branch points (the bordered
determinant changes sign), and zeros of the caller's monitors.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from impact_env.checks import (
    count_from,
    finite,
    positive,
    require,
)
from impact_env.fields import check_fields
from impact_env.periodic.branch import (
    CLOSED,
    INTERRUPTED,
    KINK,
    MINIMUM_STEP,
    PARAMETER_LIMIT,
    POINT_LIMIT,
    Branch,
    BranchState,
    Monitor,
    NoConvergenceError,
    Real,
    Residual,
    ReturnGate,
    ScaledSystem,
    SpecialPoint,
    compute_tangent,
    correct_point,
    locate_zeros,
    make_state,
)

PointProgress = Callable[[int, float], None]  # number of points, parameter


@dataclass(frozen=True)
class Steps:
    """Options of the continuation of a branch.

    Attributes
    ----------
    first, least, most : float
        First, smallest and largest step of arclength, in scaled unknowns.
    points : int
        Largest number of points.
    turn : float
        Largest angle in rad between the tangents at both ends of a step.
    tolerance : float
        Tolerance of Newton's method, relative to 1 + |X|.
    iterations : int
        Largest number of Newton steps for a point.
    """

    first: float = 0.01
    least: float = 1e-7
    most: float = 0.1
    points: int = 2000
    turn: float = 0.3
    tolerance: float = 1e-11
    iterations: int = 9

    def __post_init__(self) -> None:
        check_fields(
            self,
            first=positive,
            least=positive,
            most=positive,
            turn=positive,
            tolerance=positive,
            points=count_from(2),
            iterations=count_from(2),
        )
        require(
            self.least <= self.first <= self.most,
            "first",
            self.first,
            f"from least = {self.least} to most = {self.most}",
        )


@dataclass(frozen=True, eq=False)
class ContinuationChart:
    """The same branch in other unknowns, such as those after a change of the event order.

    ``point`` (n,) are the new unknowns, ``scale`` their units, and ``residual`` and ``monitors``
    functions of them. ``tangent`` (n + 1,) in plain units is the direction in which the branch
    continues.
    """

    residual: Residual
    point: Real
    tangent: Real
    scale: Real | float = 1.0
    monitors: tuple[Monitor, ...] = ()


Recentre = Callable[
    [Real, float, Real], ContinuationChart | None
]  # (z, parameter, tangent in plain units) -> other unknowns, or None to keep these


@dataclass(frozen=True, eq=False)
class ContinuationProblem:
    """A problem for continuation.

    Attributes
    ----------
    residual : callable
        ``residual(z, parameter)`` returns the residual (n,) and its Jacobian (n, n + 1).
    parameter : str
        Name of the parameter.
    scale : float or array, (n,)
        Size of the unknowns z.
    parameter_scale : float
        Change of the parameter that counts as much as a change of the unknowns by ``scale``.
    limits : (float, float)
        Range of the parameter.
    monitors : tuple of Monitor
        Functions whose zeros are located.
    recentre : callable, optional
        ``recentre(z, parameter, tangent)`` is called after every point and returns new unknowns, or
        None to keep the present ones.
    closes : callable, optional
        ``closes(z, parameter, new_z, new_parameter)`` is called after every step. It returns
        whether the step passes the first point, where this point has other unknowns.
    """

    residual: Residual
    parameter: str = "parameter"
    scale: Real | float = 1.0
    parameter_scale: float = 1.0
    limits: tuple[float, float] = (-np.inf, np.inf)
    monitors: tuple[Monitor, ...] = ()
    recentre: Recentre | None = None
    closes: Callable[[Real, float, Real, float], bool] | None = None

    def __post_init__(self) -> None:
        low, high = self.limits
        require(low < high, "limits", self.limits, "two numbers, the lower one first")
        check_fields(self, parameter_scale=positive)
        require(bool(np.all(np.asarray(self.scale) > 0)), "scale", self.scale, "numbers above 0")

    def system(self, n: int, steps: Steps) -> ScaledSystem:
        """Return the residual in scaled unknowns."""
        scale = np.append(
            np.broadcast_to(np.asarray(self.scale, dtype=np.float64), (n,)), self.parameter_scale
        )
        return ScaledSystem(self.residual, scale, steps.tolerance, steps.iterations)


def start_branch(
    problem: ContinuationProblem,
    z: Real,
    parameter: float,
    direction: float | Real = 1.0,
    steps: Steps | None = None,
) -> tuple[ScaledSystem, BranchState]:
    """Return the branch's point at a parameter next to ``z`` (n,), and its state with the tangent.

    ``direction`` is the sign of the parameter's change along the tangent, or a vector (n + 1,) in
    plain units. With a vector the point is sought in the plane normal to it. Raises
    NoConvergenceError.
    """
    steps = Steps() if steps is None else steps
    z = np.asarray(z, dtype=np.float64)
    require(
        z.ndim == 1 and z.size > 0 and bool(np.all(np.isfinite(z))),
        "start",
        z,
        "a row of finite unknowns",
    )
    parameter = finite("parameter", parameter)
    low, high = problem.limits
    require(
        low <= parameter <= high,
        problem.parameter,
        parameter,
        f"a start within the limits {low} to {high}",
    )
    system = problem.system(len(z), steps)
    if np.ndim(direction) == 0:
        along = np.append(np.zeros(len(z)), np.sign(float(np.asarray(direction))))
        require(along[-1] != 0, "direction", direction, "above or below 0")
    else:
        along = np.asarray(direction, dtype=np.float64) / system.scale
        along = along / np.linalg.norm(along)
    x, jacobian, _ = correct_point(system, system.scaled(z, parameter), along)
    return system, make_state(x, jacobian, along)


def follow_branch(
    problem: ContinuationProblem,
    z: Real,
    parameter: float,
    direction: float | Real = 1.0,
    steps: Steps | None = None,
    progress: PointProgress | None = None,
) -> Branch:
    """Return the branch in one direction through the point next to ``z`` (n,) at a parameter.

    ``direction`` is as in `start_branch`. ``progress`` is called with the number of points and the
    parameter. After Ctrl-C the branch ends at the last point. Raises NoConvergenceError only if
    there is no point to start from, ParameterError for bad input.
    """
    steps = Steps() if steps is None else steps
    way: list[tuple[Real, float]] = []
    events: list[SpecialPoint] = []
    ended = None
    message = ""
    try:
        system, state = start_branch(problem, z, parameter, direction, steps)
        size = steps.first
        gates = [ReturnGate(0, system, state)]
        while True:
            way.append(system.plain(state.x))
            at = f"{problem.parameter} = {way[-1][1]:.10g}"
            if progress is not None:
                progress(len(way), way[-1][1])
            if ended is not None:
                break
            try:
                doing = f"lost at {at}, where the unknowns change"
                chart = (
                    problem.recentre(*way[-1], state.tangent * system.scale)
                    if problem.recentre is not None and len(way) > 1
                    else None
                )
                if chart is not None:
                    problem = replace(
                        problem, residual=chart.residual, scale=chart.scale, monitors=chart.monitors
                    )
                    system, state = start_branch(
                        problem, chart.point, way[-1][1], chart.tangent, steps
                    )
                    gates.append(ReturnGate(len(way) - 1, system, state))
                doing = f"no step from {at} down to {steps.least:.1e}"
                next_state, size, kink = _take_step(system, state, size, steps)
            except NoConvergenceError as error:
                ended = MINIMUM_STEP
                message = f"{doing}: {error}"
                break
            state, happened, ended, message = _end_step(
                problem, gates, system, state, next_state, kink, len(way) - 1
            )
            events += happened
            if ended is None and len(way) + 1 >= steps.points:
                ended = POINT_LIMIT
                message = f"{steps.points} points"
    except KeyboardInterrupt:
        ended = INTERRUPTED
        message = f"stopped after {len(way)} points"
    return Branch(
        problem.parameter,
        tuple(z for z, _ in way),
        np.array([p for _, p in way]),
        tuple(events),
        ended,
        message,
    )


def _end_step(
    problem: ContinuationProblem,
    gates: list[ReturnGate],
    system: ScaledSystem,
    state: BranchState,
    next_state: BranchState,
    kink: bool,
    index: int,
) -> tuple[BranchState, tuple[SpecialPoint, ...], str | None, str]:
    """Return the end of a step from point number ``index``, and the special points in it.

    The last two results are the reason why the branch ends (None: it does not) and a message.
    """
    ended = None
    message = ""
    gate = next(
        (gate for gate in gates if index - gate.index >= 2 and gate.returned(state, next_state)),
        None,
    )
    if gate is not None:
        next_state = gate.place
        ended = CLOSED
        message = (
            "back at its first point" if gate.index == 0 else f"back at its point {gate.index + 1}"
        )
    elif (
        index >= 2
        and problem.closes is not None
        and problem.closes(*system.plain(state.x), *system.plain(next_state.x))
    ):
        ended = CLOSED
        message = "back at its first point"
    bounded = _stop_at_limit(problem, system, state, next_state)
    if bounded is not None:
        next_state = bounded
        ended = PARAMETER_LIMIT
        message = f"{problem.parameter} = {system.plain(next_state.x)[1]:.10g} is its limit"
    events = locate_zeros(problem.monitors, system, state, next_state, index)
    if kink:
        events = (*events, SpecialPoint(KINK, index, *system.plain(state.x), state.tangent))
    enders = {monitor.kind for monitor in problem.monitors if monitor.ends}
    last = next((k for k, event in enumerate(events) if event.kind in enders), None)
    if last is not None:
        event = events[last]
        next_state = replace(next_state, x=system.scaled(event.point, event.parameter))
        events = events[: last + 1]
        ended = event.kind
        message = f"{event.kind} at {problem.parameter} = {event.parameter:.10g}"
    return next_state, events, ended, message


def _take_step(
    system: ScaledSystem, state: BranchState, size: float, steps: Steps
) -> tuple[BranchState, float, bool]:
    """Return the next point, the size of the following step, and whether the tangent jumps.

    Raises NoConvergenceError if the smallest step fails.
    """
    while True:
        why = ""
        try:
            x, jacobian, iterations = correct_point(
                system, state.x + size * state.tangent, state.tangent
            )
            next_state = make_state(x, jacobian, state.tangent)
            drift = float(np.linalg.norm(x - state.x)) / size
            angle = float(np.arccos(np.clip(next_state.tangent @ state.tangent, -1, 1)))
            smooth = angle <= steps.turn and drift < 1.2
            if smooth or (size <= 4 * steps.least and drift < 2):
                wanted = 4 / iterations * (1.5 if angle < steps.turn / 3 else 1.0)
                factor = np.clip(wanted, 0.5, 2.0) if angle <= 0.7 * steps.turn else 0.7
                return (
                    next_state,
                    float(np.clip(size * factor, steps.least, steps.most)),
                    not smooth,
                )
            why = f"the tangent turns by {angle:.2f} rad, and the point lies {drift:.2f} steps away"
        except NoConvergenceError as error:
            why = str(error)
        if size <= steps.least:
            raise NoConvergenceError(why)
        size = max(size / 2.5, steps.least)


def _stop_at_limit(
    problem: ContinuationProblem, system: ScaledSystem, state: BranchState, next_state: BranchState
) -> BranchState | None:
    """Return the branch's state at the parameter's limit if the step passes it, else None."""
    before = system.plain(state.x)[1]
    after = system.plain(next_state.x)[1]
    limit = (
        problem.limits[1]
        if after > problem.limits[1]
        else problem.limits[0]
        if after < problem.limits[0]
        else None
    )
    if limit is None or before == after:
        return None
    normal = np.append(np.zeros(len(state.x) - 1), 1.0)
    guess = state.x + (limit - before) / (after - before) * (next_state.x - state.x)
    try:
        x, jacobian, _ = correct_point(system, guess, normal, limit / float(system.scale[-1]))
        return make_state(x, jacobian, next_state.x - state.x)
    except NoConvergenceError:
        return next_state  # a fold at the limit itself: the last point lies just outside


def follow_both_ways(
    problem: ContinuationProblem,
    z: Real,
    parameter: float,
    steps: Steps | None = None,
    progress: PointProgress | None = None,
) -> Branch:
    """Return the branch through a point in both directions.

    It is followed first towards larger parameters. A closed branch is followed once. Arguments are
    as in `follow_branch`.
    """
    forward = follow_branch(problem, z, parameter, 1.0, steps, progress)
    if forward.closed or forward.ended == INTERRUPTED:
        return forward
    return forward.joined(follow_branch(problem, z, parameter, -1.0, steps, progress))


def switch_at_branch_point(
    problem: ContinuationProblem,
    event: SpecialPoint,
    size: float = 0.01,
    steps: Steps | None = None,
) -> tuple[tuple[Real, float, Real], ...]:
    """Return starts (z, parameter, direction) of the other branch through a branch point.

    There are two starts, one on either side, if the other branch has two sides. The kernel of the
    Jacobian at the branch point is a plane; a start is sought at ``size`` of arclength from the
    point, across the known tangent. ``direction`` is an argument of `follow_branch`. Raises
    NoConvergenceError if neither side has a point.
    """
    steps = Steps() if steps is None else steps
    system = problem.system(len(event.point), steps)
    x = system.scaled(event.point, event.parameter)
    plane = np.linalg.svd(system(x)[1])[2][-2:]
    across = plane - np.outer(plane @ event.tangent, event.tangent)
    other = across[int(np.argmax(np.linalg.norm(across, axis=1)))]
    other /= np.linalg.norm(other)
    result = []
    why = ""
    for sign in (1.0, -1.0):
        try:
            at, jacobian, _ = correct_point(system, x + sign * size * other, other)
            result.append(
                (*system.plain(at), compute_tangent(jacobian, sign * other) * system.scale)
            )
        except NoConvergenceError as error:
            why = str(error)
    if not result:
        raise NoConvergenceError(
            f"no other branch within {size:g} of the branch point at {problem.parameter} = "
            f"{event.parameter:.10g}: {why}"
        )
    return tuple(result)
