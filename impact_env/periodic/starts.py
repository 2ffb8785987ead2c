"""Starts of orbits from simulation: run until the motion comes again, and read its schedule off the run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import ParameterError, count, positive, require
from impact_env.periodic.approach import start_from
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.orbit import Orbit, orbit_at, shot_orbit
from impact_env.periodic.schedule import Event, EventSchedule, Regime, flying_schedule
from impact_env.response import ContactPhases, History, Impacts, Record, Response
from impact_env.scene import InitialState
from impact_env.sweep import simulate

Array = NDArray[np.float64]
SAMPLES = 40  # in a period of the fastest mode: reversals are read off samples
MOST_SAMPLES = 20000  # in a pseudo period; reversals between two samples are found when the orbit is mended
SAME = 1e-8  # of the largest entry of a state: two states that are one
CLOSE = 1e-3  # of gap and gap times omega: a return as close as this is taken for one
SETTLE = 400.0  # periods of the force before anything is read off
MOST_MULTIPLE = 8


def state_after(case: Case, periods: float, initial: InitialState | None = None, phase: float = 0.0) -> tuple[Array, float]:
    """Return the state (2 N_m + 2,) after some of the force's periods from ``initial`` (default: rest), and the phase there (rad, below 2 pi)."""
    duration = positive("periods", periods) * case.period
    response = simulate(case.scene, case.drive(duration, phase), initial=initial, record=Record(level=False, events=True))
    return response.end_state, (phase + case.omega * duration) % (2 * np.pi)


def initial_of(case: Case, state: Array) -> InitialState:
    """Return a state (2 N_m + 2,) as a start of a case's scene, as `start_from`."""
    return start_from(case.scene, state)


def recorded(case: Case, state: Array, phase: float, periods: int) -> Response:
    """Return a run of whole periods of the force with its events and enough samples to find reversals."""
    fastest = max(float(np.max(case.model.omega)), case.omega)
    samples = min(int(np.ceil(SAMPLES * fastest / float(case.model.omega[0]))), MOST_SAMPLES)
    record = Record(level=False, events=True, series=True, samples_per_period=max(samples, 64))
    return simulate(case.scene, case.drive(periods * case.period, phase), initial=initial_of(case, state), record=record)


def read_schedule(case: Case, response: Response, phase: float, period_multiple: int, symmetric: bool = False) -> tuple[EventSchedule, Array]:
    """Return schedule and phases (n,) in rad of what a recorded run shows in its first ``period_multiple`` periods (the first half, if symmetric).

    ``phase``: that of the force where the run began. Raises ParameterError if the run recorded no events or samples, or shows no impact.
    """
    require(response.impacts is not None and response.history is not None, "record", "without events or series", "Record(events=True, series=True)")
    assert response.impacts is not None
    assert response.phases is not None
    assert response.history is not None
    span = period_multiple * case.period * (0.5 if symmetric else 1.0)
    times, events = _events(case, response.impacts, response.phases, response.history, span)
    hits = [k for k, event in enumerate(events) if event.is_impact]
    require(len(hits) > 0, "run", f"{len(events)} events without an impact", "one with an impact in each period")
    first = hits[0]  # a schedule begins with an impact: what came before it comes again behind
    turned = [event.mirrored if symmetric else event for event in events[:first]]
    times = np.concatenate([times[first:], times[:first] + span])
    return EventSchedule((*events[first:], *turned), symmetric, period_multiple), phase + case.omega * times


def _events(case: Case, impacts: Impacts, phases: ContactPhases, history: History, span: float) -> tuple[Array, list[Event]]:
    """Return the times (s) and events of a run up to ``span`` (s)."""
    sliding = Regime.SLIDING if case.friction_limit > 0 else Regime.FREE
    found = [(t, Event(sliding, int(-np.sign(p)), int(np.sign(p)))) for t, p in zip(impacts.time, impacts.impulse, strict=True)]
    for start, end, kind in zip(phases.start, phases.end, phases.kind, strict=True):
        found.append((start, Event(Regime.JOINED, {0: 0, 1: -1, 2: 1}[int(kind)], 0)))
        found.append((end, Event(sliding, 0, _sign_after(history, end))))
    if case.friction_limit > 0:
        found += [(t, Event(sliding, 0, sign)) for t, sign in _reversals(impacts, phases, history)]
    found = sorted((pair for pair in found if pair[0] < span), key=lambda pair: pair[0])
    return np.array([t for t, _ in found]), [event for _, event in found]


def _sign_after(history: History, time: float) -> int:
    relative = history.absorber_velocity - history.tip_velocity
    k = min(int(np.searchsorted(history.time, time, side="right")) + 1, len(relative) - 1)
    return 1 if relative[k] > 0 else -1


def _reversals(impacts: Impacts, phases: ContactPhases, history: History) -> list[tuple[float, int]]:
    """Return times (s) and signs afterwards of changes of the relative velocity's sign between samples that no impact or joined phase explains."""
    relative, time = history.absorber_velocity - history.tip_velocity, history.time
    found = []
    for k in np.flatnonzero(np.sign(relative[:-1]) * np.sign(relative[1:]) < 0):
        low, high = time[k], time[k + 1]
        joined = np.any((phases.start <= high) & (phases.end >= low))
        if joined or np.sum((impacts.time >= low) & (impacts.time <= high)) % 2:
            continue
        share = abs(relative[k]) / (abs(relative[k]) + abs(relative[k + 1]))
        found.append((float(low + share * (high - low)), 1 if relative[k + 1] > 0 else -1))
    return found


def orbit_of_simulation(
    case: Case, settle: float = SETTLE, most_multiple: int = MOST_MULTIPLE, initial: InitialState | None = None, phase: float = 0.0
) -> Orbit | NoOrbit:
    """Return the orbit that a run from ``initial`` (default: rest) comes to within ``settle`` periods of the force, or why there is none.

    The run is then taken to have the smallest period, of up to ``most_multiple`` of the force's, after which it comes as close to itself as `CLOSE`;
    Newton's method does the rest. Only an attracting orbit is found so.
    """
    count("most_multiple", most_multiple, 1)
    state, here = state_after(case, settle, initial, phase)
    symmetric, multiple, miss = _return_of(case, state, here, most_multiple)
    if multiple == 0:
        return NoOrbit(case, _blank(case), f"the run does not come again within {most_multiple} periods (miss {miss:.1e})", np.zeros(1))
    response = recorded(case, state, here, multiple)
    if response.impact_count == 0 and case.friction_limit == 0:
        return NoOrbit(case, _blank(case), "the run has no impacts", np.zeros(1))
    assert response.phases is not None
    if response.impact_count == 0 or len(response.phases.start) > 0:
        return _shot_from(case, response, here, symmetric, multiple)
    try:
        found = orbit_at(case, *read_schedule(case, response, here, multiple, symmetric))
        shorter = multiple if isinstance(found, NoOrbit) else least_multiple(found)
        found = found if shorter == multiple else orbit_at(case, *read_schedule(case, response, here, shorter, symmetric))
    except ParameterError:  # reversals between two samples: what was read is no order of events
        return _shot_from(case, response, here, symmetric, multiple)
    if isinstance(found, Orbit):
        return found
    shot = _shot_from(case, response, here, symmetric, multiple)
    return shot if isinstance(shot, Orbit) else found


def _shot_from(case: Case, response: Response, here: float, symmetric: bool, multiple: int) -> Orbit | NoOrbit:
    """Return the orbit found by shooting from a sample of a recorded run that began at the phase ``here`` (rad), of the shortest period."""
    section = flight_of(response)
    if section is None:
        return NoOrbit(case, _blank(case), "friction holds the absorber all the time", np.zeros(1))
    phase, state = here + case.omega * section[0], section[1]
    found = shot_orbit(case, phase, state, symmetric, multiple)
    shorter = multiple if isinstance(found, NoOrbit) else least_multiple(found)
    return found if shorter == multiple else shot_orbit(case, phase, state, symmetric, shorter)


def flight_of(response: Response) -> tuple[float, Array] | None:
    """Return time (s) and state (2 N_m + 2,) of the sample next to the middle of a run's longest flight without an event, None if it never flies."""
    history, impacts, phases = response.history, response.impacts, response.phases
    assert history is not None
    assert impacts is not None
    assert phases is not None
    relative, time = history.absorber_velocity - history.tip_velocity, history.time
    turns = time[1:][np.sign(relative[:-1]) != np.sign(relative[1:])]
    marks = np.unique(np.concatenate([[0.0], impacts.time, phases.start, phases.end, turns, [time[-1]]]))
    middles, lengths = 0.5 * (marks[1:] + marks[:-1]), np.diff(marks)
    lengths[[bool(np.any((phases.start <= t) & (t <= phases.end))) for t in middles]] = 0.0
    if len(lengths) == 0 or np.max(lengths) < 2 * time[1]:
        return None
    k = int(np.argmin(np.abs(time - middles[int(np.argmax(lengths))])))
    displacement, velocity = history.modal_displacement[k], history.modal_velocity[k]
    return float(time[k]), np.concatenate([displacement, [history.absorber_displacement[k]], velocity, [history.absorber_velocity[k]]])


def least_multiple(orbit: Orbit) -> int:
    """Return the multiple of the force's period after which an orbit really comes again: a slow approach may look like a long period."""
    whole, start = orbit.schedule.period_multiple, orbit.motion.mid_flight()[0]
    first = orbit.motion.state_at(start)
    for multiple in range(1, whole):
        miss = np.abs(orbit.motion.state_at(start + 2 * np.pi * multiple) - first)
        if whole % multiple == 0 and np.max(miss) < SAME * np.max(np.abs(first)):
            return multiple
    return whole


def _blank(case: Case) -> EventSchedule:
    return flying_schedule([-1], case.friction_limit > 0, symmetric=True)


def _return_of(case: Case, first: Array, phase: float, most: int) -> tuple[bool, int, float]:
    """Return whether the motion mirrors itself after half of its period, the multiple of the force's period (0: none), and the least miss.

    The state ``first`` (2 N_m + 2,) at a ``phase`` (rad) is compared with those after each half period of the force.
    """
    n, state, least = case.model.modes + 1, first, np.inf
    for half in range(1, 2 * most + 1):
        state, phase = state_after(case, 0.5, initial_of(case, state), phase)
        symmetric = half % 2 == 1
        miss = np.abs((-1.0 if symmetric else 1.0) * state - first) / case.gap
        least = min(least, float(max(np.max(miss[:n]), np.max(miss[n:]) / case.omega)))
        if least < CLOSE and (half <= most or not symmetric):
            return symmetric, half if symmetric else half // 2, least
    return False, 0, least
