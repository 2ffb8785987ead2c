"""Orbits of a case at a frequency or over a range of frequencies.

They are found from the closed form, along its branches, and from runs that converge to an orbit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count, positive, require
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.orbit import Orbit, find_orbit_at, mirror_orbit, shoot_orbit
from impact_env.periodic.orbit_branches import COARSE_STEPS, OrbitBranch, orbit_branches
from impact_env.periodic.passage import RECORD, TrajectoryError, follow_trajectory
from impact_env.periodic.schedule import count_turns, flying_schedule
from impact_env.periodic.shooting import shoot_from
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.scene import InitialState
from impact_env.sweep import simulate

if TYPE_CHECKING:
    from impact_env.periodic.basins import Basins

Array = NDArray[np.float64]
SAME_STATE_TOL = 1e-8  # of the largest entry of a state: two states that are one
RETURN_TOL = 1e-3  # of gap and gap times omega: a return as close as this is taken for one
SETTLING_PERIODS = 400.0  # periods of the force before anything is read off
MOST_MULTIPLE = 8
SHORTEST_FLIGHT = 1e-2  # rad: of the longest flight, from the middle of which shooting begins
SAME_ORBIT_TOL = 1e-7  # rad and units of impulse: two orbits closer than this are one
FAINTEST_IMPULSE = 1e-5  # units of impulse: bounces below are not compared
DISTURBANCE = 1e-3  # of gap times omega: a disturbance that a run starts with beside an orbit
SurveyProgress = Callable[[int, int], None]


def state_after(
    case: Case, periods: float, initial: InitialState | None = None, phase: float = 0.0
) -> tuple[Array, float]:
    """Return the state (2 N_m + 2,) after some periods of the force, and the phase.

    The run starts from ``initial`` (default: rest). The phase is that at its end (rad, below 2 pi).
    """
    duration = positive("periods", periods) * case.period
    response = simulate(case.scene, case.drive(duration, phase), initial=initial, record=RECORD)
    return response.end_state, (phase + case.omega * duration) % (2 * np.pi)


def orbit_of_simulation(
    case: Case,
    settle: float = SETTLING_PERIODS,
    most_multiple: int = MOST_MULTIPLE,
    initial: InitialState | None = None,
    phase: float = 0.0,
) -> Orbit | NoOrbit:
    """Return the orbit to which a run converges, or the reason why there is none.

    The run starts from ``initial`` (default: rest) and lasts ``settle`` periods of the force. The
    orbit has the smallest period, of up to ``most_multiple`` periods of the force, after which the
    state returns to within `RETURN_TOL`; Newton's method computes it. Only a stable orbit is found.
    """
    most_multiple = count("most_multiple", most_multiple, 1)
    state, here = state_after(case, settle, initial, phase)
    symmetric, multiple, miss = find_return(case, state, here, most_multiple)
    if multiple == 0:
        return _report_nothing(
            case, f"the run does not come again within {most_multiple} periods (miss {miss:.1e})"
        )
    result = orbit_next_to(case, here, state, symmetric, multiple)
    shorter = multiple if isinstance(result, NoOrbit) else least_multiple(result)
    return result if shorter == multiple else orbit_next_to(case, here, state, symmetric, shorter)


def orbit_next_to(
    case: Case, phase: float, state: Array, symmetric: bool, multiple: int
) -> Orbit | NoOrbit:
    """Return the orbit next to a ``state`` (2 N_m + 2,) at a ``phase`` (rad).

    It is computed from the events of the motion, or else by shooting from its longest flight.
    """
    try:
        run = follow_trajectory(case, phase, state, count_turns(symmetric, multiple) / case.omega)
    except TrajectoryError as error:
        return _report_nothing(case, str(error))
    times, lengths = run.flights
    if not any(happening.event.is_impact for happening in run.events) and case.friction_limit == 0:
        return _report_nothing(case, "the run has no impacts")
    if np.max(lengths) <= SHORTEST_FLIGHT / case.omega:
        return _report_nothing(case, "friction holds the absorber all the time")
    motion = shoot_from(case, run, symmetric, multiple, 0.0, 0)
    result = None
    if (
        not isinstance(motion, NoOrbit)
        and motion.solution.schedule.flies
        and motion.solution.schedule.impacts > 0
    ):
        result = find_orbit_at(case, motion.solution.schedule, motion.solution.phases)
        if isinstance(result, Orbit):
            return result
    k = int(np.argmax(lengths))
    middle = float(times[k] + 0.5 * lengths[k])
    held = shoot_orbit(
        case, phase + case.omega * middle, run.states(np.array([middle]))[0], symmetric, multiple
    )
    return held if isinstance(held, Orbit) or result is None else result


def _report_nothing(case: Case, reason: str) -> NoOrbit:
    return NoOrbit(
        case, flying_schedule([-1], case.friction_limit > 0, symmetric=True), reason, np.zeros(1)
    )


def least_multiple(orbit: Orbit) -> int:
    """Return the smallest multiple of the force's period after which an orbit repeats.

    It may be smaller than the orbit's own multiple, because a slow approach resembles a longer
    period.
    """
    whole = orbit.schedule.period_multiple
    start = orbit.motion.mid_flight()[0]
    first = orbit.motion.state_at(start)
    for multiple in range(1, whole):
        miss = np.abs(orbit.motion.state_at(start + 2 * np.pi * multiple) - first)
        if whole % multiple == 0 and np.max(miss) < SAME_STATE_TOL * np.max(np.abs(first)):
            return multiple
    return whole


def find_return(case: Case, first: Array, phase: float, most: int) -> tuple[bool, int, float]:
    """Return whether the motion is symmetric, its period, and the smallest difference.

    The state ``first`` (2 N_m + 2,) at a ``phase`` (rad) is compared with the states after each
    half period of the force; a symmetric motion mirrors itself after half of its period. The period
    is in periods of the force (0: none).
    """
    n = case.model.modes + 1
    state = first
    least = np.inf
    for half in range(1, 2 * most + 1):
        state, phase = state_after(case, 0.5, InitialState.from_vector(case.scene, state), phase)
        symmetric = half % 2 == 1
        miss = np.abs((-1.0 if symmetric else 1.0) * state - first) / case.gap
        least = min(least, float(max(np.max(miss[:n]), np.max(miss[n:]) / case.omega)))
        if least < RETURN_TOL and (half <= most or not symmetric):
            return symmetric, half if symmetric else half // 2, least
    return False, 0, least


@dataclass(frozen=True, eq=False)
class OrbitSearch:
    """Results of a search at one frequency.

    Attributes
    ----------
    case : Case
        Structure, absorber, force and frequency.
    orbits : tuple of Orbit
        Confirmed orbits.
    refused : tuple of NoOrbit
        Solutions that are no orbits, with the reason.
    basins : Basins or None
        Motions on which runs from random initial states end, None without runs.
    """

    case: Case
    orbits: tuple[Orbit, ...]
    refused: tuple[NoOrbit, ...]
    basins: Basins | None = None


def closed_form_orbits(case: Case) -> OrbitSearch:
    """Return the orbits that are found from the closed form's branches.

    Only branches on which the wall pushes are used. The order of the reversals is corrected.
    """
    schedule = symmetric_schedule(case.friction_limit > 0)
    orbits: list[Orbit] = []
    refused: list[NoOrbit] = []
    for branch in closed_form(case):
        if branch.pushes:
            result = find_orbit_at(
                case, schedule, np.array([branch.phase, branch.impulse / case.scale.impulse])
            )
            if isinstance(result, NoOrbit):
                refused.append(result)
            else:
                orbits.append(result)
    return OrbitSearch(case, tuple(drop_repeated(orbits)), tuple(refused))


def drop_repeated(orbits: Iterable[Orbit]) -> list[Orbit]:
    """Return orbits of one case without repetitions, the largest response first."""
    distinct: list[Orbit] = []
    for orbit in orbits:
        if not any(is_same_orbit(orbit, other) for other in distinct):
            distinct.append(orbit)
    return sorted(distinct, key=lambda orbit: -orbit.motion.tip_max)


def is_same_orbit(one: Orbit, other: Orbit) -> bool:
    """Return whether two orbits of one case are the same.

    Their schedules may begin with different events. The faintest bounces of a chatter do not count.
    Orbits without impacts are compared by their states.
    """
    unit = one.case.scale.impulse
    a, b = (
        [impact for impact in orbit.impacts if abs(impact.impulse) > FAINTEST_IMPULSE * unit]
        for orbit in (one, other)
    )
    if len(a) != len(b) or one.schedule.period_multiple != other.schedule.period_multiple:
        return False
    if len(a) == 0:
        return (
            abs(one.motion.tip_max / other.motion.tip_max - 1) < SAME_ORBIT_TOL
            and abs(one.motion.tip_rms / other.motion.tip_rms - 1) < SAME_ORBIT_TOL
        )
    whole = 2 * np.pi * one.schedule.period_multiple
    shifts = {2 * np.pi * k for k in range(one.schedule.period_multiple)}
    for shift in shifts:
        moved = sorted(((impact.phase + shift) % whole, impact.impulse) for impact in a)
        if all(
            abs(p - y.phase) < SAME_ORBIT_TOL and abs(i - y.impulse) < SAME_ORBIT_TOL * unit
            for (p, i), y in zip(moved, b, strict=True)
        ):
            return True
    return False


def crossings(branch: OrbitBranch, omega: float) -> Iterator[Orbit | NoOrbit]:
    """Yield the orbits of a branch in frequency at ``omega`` (rad/s).

    For a solution that is no orbit the reason is yielded.
    """
    values = branch.branch.parameters
    for k in np.flatnonzero((values[:-1] - omega) * (values[1:] - omega) <= 0):
        if values[k] == values[k + 1]:
            continue
        near = int(k if abs(values[k] - omega) <= abs(values[k + 1] - omega) else k + 1)
        z = np.array(branch.branch.points[near])
        if branch.schedules[k] == branch.schedules[k + 1]:
            share = (omega - values[k]) / (values[k + 1] - values[k])
            z = branch.branch.points[k] + share * (
                branch.branch.points[k + 1] - branch.branch.points[k]
            )
        yield find_orbit_at(branch.case.changed(omega=omega), branch.schedules[near], z)


def closed_form_over(
    case: Case, ratios: Array, progress: SurveyProgress | None = None
) -> list[OrbitSearch]:
    """Return `closed_form_orbits` at each of ascending frequency ``ratios`` (M,).

    ``progress`` is called with the number of finished frequencies.
    """
    require(
        len(ratios) > 0 and bool(np.all(np.diff(ratios) > 0)),
        "ratios",
        ratios,
        "one or more frequency ratios, rising",
    )
    first = float(case.model.omega[0])
    result = []
    for k, ratio in enumerate(ratios, 1):
        result.append(closed_form_orbits(case.changed(omega=float(ratio) * first)))
        if progress is not None:
            progress(k, len(ratios))
    return result


def join_results(group: OrbitSearch, branches: Iterable[OrbitBranch]) -> OrbitSearch:
    """Return the group of a frequency with the orbits of branches added.

    The mirror images of orbits without symmetry are added as well.
    """
    more = [orbit for branch in branches for orbit in crossings(branch, group.case.omega)]
    good = [
        orbit
        for orbit in more
        if isinstance(orbit, Orbit) and least_multiple(orbit) == orbit.schedule.period_multiple
    ]
    images = [
        orbit
        for one in good
        if not one.schedule.symmetric and isinstance(orbit := mirror_orbit(one), Orbit)
    ]
    refused = (
        tuple(orbit for orbit in more if isinstance(orbit, NoOrbit)) if more else group.refused
    )
    orbits = tuple(drop_repeated([*group.orbits, *good, *images]))
    return replace(group, orbits=orbits, refused=refused)


def orbits_over(
    case: Case, ratios: Array, progress: SurveyProgress | None = None
) -> Iterator[OrbitSearch]:
    """Yield the symmetric two-impact orbits of a case at ascending frequency ``ratios`` (M,).

    Without friction the closed form gives all of them. With friction some are missing, so branches
    are followed between the first and the last ratio; ``progress`` is called with the number of
    finished frequencies.
    """
    result = closed_form_over(case, ratios, progress)
    if case.friction_limit == 0 or len(ratios) < 2:
        yield from result
        return
    omegas = np.asarray(ratios) * float(case.model.omega[0])
    branches = list(orbit_branches(case, float(omegas[0]), float(omegas[-1]), omegas, COARSE_STEPS))
    yield from (join_results(group, branches) for group in result)


def attractors(
    case: Case,
    near: Iterable[Orbit],
    settle: float = SETTLING_PERIODS,
    most_multiple: int = MOST_MULTIPLE,
) -> Iterator[Orbit | NoOrbit]:
    """Yield the orbits to which runs converge, with mirror images that differ from them.

    The runs start from rest, and next to each unstable orbit of ``near``: an unstable symmetric
    orbit leads to the stable pair without symmetry. Other arguments are as in
    `orbit_of_simulation`.
    """
    starts: list[tuple[InitialState | None, float]] = [(None, 0.0)]
    for orbit in near:
        if not orbit.stability.stable:
            phase, state = orbit.motion.mid_flight()
            state[-1] += DISTURBANCE * case.gap * case.omega
            starts.append((InitialState.from_vector(case.scene, state), phase))
    for initial, phase in starts:
        result = orbit_of_simulation(case, settle, most_multiple, initial, phase)
        yield result
        if isinstance(result, Orbit) and not result.schedule.symmetric:
            yield mirror_orbit(result)
