"""Shooting: the unknown is the state at a section.

Newton's method finds the state that returns after a period, or mirrored after half a period.

Unlike the periodic Green's function it allows phases in which friction or a wall holds the
absorber, and complete chatter. The events and their order may change in each Newton step.

The largest Lyapunov exponent of a motion is the mean growth rate of small disturbances, computed
with the derivative of the exact motion. A tangent vector is multiplied by the derivative of a few
periods at a time and normalised (Benettin et al., Meccanica 15, 1980; with impacts Mueller, Chaos,
Solitons & Fractals 5, 1995). The exponent is positive for chaotic motion, negative for periodic
motion and zero on a torus.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import ParameterError, count, finite, require
from impact_env.drive import Drive
from impact_env.periodic.case import Case, case_of
from impact_env.periodic.green import NoOrbit, Solution
from impact_env.periodic.motion import ShotMotion
from impact_env.periodic.passage import RECORD, OrbitTrajectory, TrajectoryError, follow_trajectory
from impact_env.periodic.schedule import Event, EventSchedule, count_turns, flying_schedule
from impact_env.scene import Scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
MOST_SHOOTING_STEPS = 30
MOST_HALVINGS = 5
# of the scaled miss: where Newton's method ends, and what it may leave where rounding stops it
CLOSING_TOL = 1e-13
SUFFICIENT_TOL = 1e-10
# of the largest singular value: a direction in which every place is as good, such as the absorber's
# place of rest
NEUTRAL_TOL = 1e-10


def units_of(case: Case) -> Array:
    """Return the unit of each entry of a state, (2 N_m + 2,).

    The units are the gap, and the gap times the force's frequency.
    """
    n = case.model.modes + 1
    return np.concatenate([np.full(n, case.gap), np.full(n, case.gap * case.omega)])


def shoot(
    case: Case, phase: float, state: Array, symmetric: bool = False, period_multiple: int = 1
) -> ShotMotion | NoOrbit:
    """Return the motion near ``state`` (2 N_m + 2,) that repeats, or the reason why there is none.

    ``state`` is that at a ``phase`` (rad), at which the absorber must not be joined. The other
    arguments are as in `EventSchedule`. Raises ParameterError for a state of another size, or with
    a value that is not finite.
    """
    size = 2 * case.model.modes + 2
    finite_phase = finite("phase", phase)
    y = np.array(state, dtype=float)
    require(
        y.shape == (size,) and bool(np.all(np.isfinite(y))),
        "state",
        state,
        f"{size} finite numbers: modes, absorber, and their velocities",
    )
    turn = count_turns(symmetric, period_multiple)
    unit = units_of(case)
    sign = -1.0 if symmetric else 1.0
    blank = flying_schedule([-1], case.friction_limit > 0, symmetric=True)
    try:
        result = follow_trajectory(case, finite_phase, y, turn / case.omega)
        miss = _closing_error(result, y, sign, unit)
        steps = 0
        for _ in range(MOST_SHOOTING_STEPS):
            size_of_miss = float(np.max(np.abs(miss)))
            if size_of_miss <= CLOSING_TOL:
                break
            matrix = np.eye(size) - sign * result.derivative * unit / unit[:, None]
            step: Array = np.asarray(
                np.linalg.lstsq(matrix, miss, rcond=NEUTRAL_TOL)[0], dtype=np.float64
            )
            better = _damped_step(case, result, y, step, unit, sign, size_of_miss)
            if better is None:
                break
            result, y, miss = better
            steps += 1
        miss_left = float(np.max(np.abs(miss)))
    except (TrajectoryError, np.linalg.LinAlgError) as error:
        return NoOrbit(case, blank, str(error), np.array([finite_phase]))
    if not miss_left <= SUFFICIENT_TOL:
        return NoOrbit(
            case,
            blank,
            f"shooting did not converge (residual {miss_left:.1e} after {steps} steps)",
            np.array([finite_phase]),
        )
    return shoot_from(case, result, symmetric, period_multiple, miss_left, steps)


def _closing_error(result: OrbitTrajectory, y: Array, sign: float, unit: Array) -> Array:
    return np.asarray((sign * result.end - y) / unit)


def _damped_step(
    case: Case, last: OrbitTrajectory, y: Array, step: Array, unit: Array, sign: float, size: float
) -> tuple[OrbitTrajectory, Array, Array] | None:
    """Return trajectory, state and closing error after a damped Newton step, or None.

    The step is shortened until the closing error is smaller than ``size``.
    """
    share = 1.0
    for _ in range(MOST_HALVINGS):
        new = y + share * unit * step
        try:
            result = follow_trajectory(case, last.phase, new, last.span)
        except TrajectoryError:
            share /= 2
            continue
        miss = _closing_error(result, new, sign, unit)
        if np.max(np.abs(miss)) < size:
            return result, new, miss
        share /= 3
    return None


def shoot_from(
    case: Case,
    result: OrbitTrajectory,
    symmetric: bool,
    period_multiple: int,
    error: float,
    steps: int,
) -> ShotMotion | NoOrbit:
    """Return the motion of a trajectory that returns, or the reason why its events are no orbit."""
    turn = count_turns(symmetric, period_multiple)
    whole = 2 * np.pi * period_multiple
    blank = flying_schedule([-1], case.friction_limit > 0, symmetric=True)
    if not result.events:
        return NoOrbit(case, blank, "absorber and beam do not touch", np.array([result.phase]))
    phases = result.phase + case.omega * np.array([happening.time for happening in result.events])
    impulses = np.array([happening.impulse for happening in result.events])
    events, phases, impulses = rotate_start(
        [happening.event for happening in result.events], phases, impulses, turn, symmetric
    )
    try:
        schedule = EventSchedule(events, symmetric, period_multiple)
    except ParameterError as reason:
        return NoOrbit(case, blank, f"the events do not come again: {reason}", phases)
    solution = Solution(
        case, schedule, phases - whole * np.floor(phases[0] / whole), impulses, 0.0, error, steps
    )
    return ShotMotion(solution, result)


def rotate_start(
    events: list[Event], phases: Array, impulses: Array, turn: float, symmetric: bool
) -> tuple[tuple[Event, ...], Array, Array]:
    """Return events, phases (n,) in rad and impulses (n,) in N s, starting with the first impact.

    Without an impact they are unchanged. ``turn`` is the phase of the force (rad) over all events.
    """
    first = next((k for k, event in enumerate(events) if event.is_impact), 0)
    side = -1.0 if symmetric else 1.0
    turned = [event.mirrored if symmetric else event for event in events[:first]]
    impulses = np.concatenate([impulses[first:], side * impulses[:first]])
    return (
        (*events[first:], *turned),
        np.concatenate([phases[first:], phases[:first] + turn]),
        impulses,
    )


STRETCH_LENGTH = (
    4  # periods of the force in which a tangent vector is followed without being made a unit vector
)
SETTLING_STRETCHES = (
    20  # stretches in which it turns into the fastest direction, which are left out
)
INDEPENDENT_BLOCKS = 20  # whose means are taken as independent
EXPONENT_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Exponent:
    """The largest exponent per period of the force.

    Its 95 % interval follows from Student's distribution over the means of blocks.
    """

    value: float
    low: float
    high: float

    @property
    def chaotic(self) -> bool:
        """Whether the interval lies above zero."""
        return self.low > 0


def largest_exponent(scene: Scene, settled: Drive, periods: int) -> Exponent:
    """Return the largest exponent over ``periods`` of the force after the run ``settled``.

    The frequency is that at the end of this run. Raises ParameterError for fewer periods than one
    per block, or for a scene without one impact absorber; TrajectoryError if a motion has no
    derivative.
    """
    periods = count("periods", periods, STRETCH_LENGTH * INDEPENDENT_BLOCKS)
    schedule = settled.schedule
    case = case_of(scene, settled.amplitude, float(schedule.omegas[-1]))
    state = simulate(scene, settled, record=RECORD).end_state
    phase = settled.phase + float(schedule.phase_at(float(schedule.times[-1])))
    unit = units_of(case)
    vector = np.random.default_rng(0).normal(size=len(unit))
    growth = []
    for _ in range(SETTLING_STRETCHES + periods // STRETCH_LENGTH):
        result = follow_trajectory(case, phase, state, STRETCH_LENGTH * case.period)
        vector = (result.derivative @ (unit * vector)) / unit
        size = float(np.linalg.norm(vector))
        require(
            size > 0, "tangent vector", vector, "one that friction does not take away altogether"
        )
        growth.append(np.log(size))
        vector = vector / size
        state = result.end
    return exponent_of(np.array(growth[SETTLING_STRETCHES:]) / STRETCH_LENGTH)


def exponent_of(growth: Array) -> Exponent:
    """Return the exponent of growths (S,) per period, each the mean over a few periods."""
    means = np.array([np.mean(block) for block in np.array_split(growth, INDEPENDENT_BLOCKS)])
    value = float(np.mean(growth))
    width = float(
        np.std(means, ddof=1)
        / np.sqrt(INDEPENDENT_BLOCKS)
        * scipy.stats.t.ppf((1 + EXPONENT_CONFIDENCE) / 2, INDEPENDENT_BLOCKS - 1)
    )
    return Exponent(value, value - width, value + width)
