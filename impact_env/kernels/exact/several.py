"""Several absorbers on one beam.

The module contains the loop over the events of rigid contact, for any set of joined absorbers
(sets.py).

Each absorber has its own guard signal in the regime of the current set, and the next event is the
earliest one. Signals, searches, impact law and friction are those of the single absorber. The
effect of one absorber's event on the others is in several_events.py. Guards that cannot be reached
before the earliest event found are not searched (safe_times.py).

In: a scene (`Several`), a schedule, the initial state, observers. Out: the final state and a status
code (`several_lane`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating
from impact_env.kernels.energy.energies import (
    NOT_INITIALISED,
    add_energy,
    new_account,
    replace_energies_by_account,
)
from impact_env.kernels.events.signals import NOTHING, REVERSAL, GuardEvent, compute_time_resolution
from impact_env.kernels.exact.check import check_set
from impact_env.kernels.exact.joint_forces import Joints, new_joints
from impact_env.kernels.exact.rigid_contact import (
    JOINED,
    AbsorberView,
    Walls,
    add_friction_loss,
    find_end_of_flight,
    find_end_of_hold,
    new_contact_states,
    record_joined_phase,
)
from impact_env.kernels.exact.safe_times import (
    SAFE_TIME,
    find_most_urgent,
    forget_safe_times,
    update_safe_time,
    update_safe_times_after_event,
)
from impact_env.kernels.exact.sets import (
    Absorbers,
    ForcedSets,
    Sets,
    SignalSet,
    add_base_motion,
    fill_guard_signal,
    find_joined_set,
    is_joined,
    new_forced_sets,
    new_signal_set,
    update_guard_response,
    update_set_response,
    view_set_response,
    view_set_system,
    view_signal,
)
from impact_env.kernels.exact.several_events import (
    handle_impact,
    handle_reversal,
    init_joined_set,
    release_from_set,
    write_state_from,
)
from impact_env.kernels.motion.forced import add_forced
from impact_env.kernels.motion.loads import copy_schedule, count_windows, expand_window
from impact_env.kernels.motion.modal_system import copy_amplitudes, propagate
from impact_env.kernels.motion.observers import (
    ABSORBER_MOTION,
    DONE,
    JOINTS_UNSOLVED,
    NOT_FINITE,
    REGIME_FAILED,
    count_progress,
    limit_searches,
)
from impact_env.kernels.motion.segments import (
    Buffers,
    LinearRegime,
    Losses,
    Segment,
    new_buffers,
    sample_level,
    sample_state,
    take_last_sample,
)

Array = NDArray[np.float64]


class Several(NamedTuple):
    """A scene of several absorbers: regimes of all sets, absorbers, and losses."""

    sets: Sets
    absorbers: Absorbers
    losses: Losses


class SeveralWorkspace(NamedTuple):
    """Motion and scratch memory of a run with n absorbers and K positions for regimes."""

    contact_states: NDArray[Any]  # (n,) RIGID_CONTACT_STATE records
    buffers: Buffers  # ``z`` is the free part of the amplitudes
    signals: SignalSet  # of the absorbers
    forced_sets: ForcedSets  # responses in the current window
    joints: Joints  # of the joint forces
    place_rows: Array  # (K, ROWS, J) weights of the level's place, with the constant forces
    deflection: Array  # (n + 1,) of the beam at absorbers and level, under constant forces (m)
    motion: NDArray[Any]  # (n,) as `Segment.motion`; between two sets the relative motion
    safe_times: NDArray[Any]  # (n,) SAFE_TIME records
    last_fill: NDArray[np.int64]  # (K,) filling of each position that the responses belong to
    last_account: NDArray[np.int64]  # (K,) filling of each position that the energies belong to
    forces: Array  # (n,) constant forces before an event (N)
    scratch: Array  # (2 N_m + 2 n,) a state


@jit_allocating
def new_several_workspace(sets, absorbers, state):
    """Return the workspace of a run; ``state`` (2 N_m + 2 n,) gives the size only."""
    n = absorbers.mass.shape[0]
    count, _, rows, size = sets.rows.shape
    contact_states = new_contact_states(n)
    for a in range(n):
        contact_states[a].absorber = a
    buffers = new_buffers(size)
    scratch = np.zeros_like(state)
    return SeveralWorkspace(
        contact_states,
        buffers,
        new_signal_set(sets),
        new_forced_sets(sets),
        new_joints(n),
        np.zeros((count, rows, size)),
        np.zeros(n + 1),
        np.zeros(n, ABSORBER_MOTION),
        np.zeros(n, SAFE_TIME),
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.zeros(n),
        scratch,
    )


@jit
def find_absorber_event(scene, window, s, a, length, workspace):
    """Return the first `GuardEvent` of absorber a within ``length`` (s) in the set at position s.

    The forced part of the absorber's guard signal must be known; the signal is filled.
    """
    sets = scene.sets
    absorbers = scene.absorbers
    system = view_set_system(sets, s, sets.rows[s, a])
    forced = view_set_response(workspace.forced_sets, s, a)
    limit = absorbers.limit[a]
    body = AbsorberView(
        workspace.contact_states[a], workspace.buffers, view_signal(workspace.signals, a)
    )
    if is_joined(sets, s, a):
        weight = absorbers.mass[a] * absorbers.gravity[a]
        return find_end_of_hold(system, forced, window, limit, weight, body, length)
    walls = Walls(absorbers.gap[a], absorbers.restitution[a], absorbers.yield_velocity[a])
    if limit > 0.0:
        return find_end_of_flight(
            system, forced, window, walls, limit, body, workspace.deflection[a], length
        )
    return find_end_of_flight(
        system, forced, window, walls, None, body, workspace.deflection[a], length
    )


@jit
def find_earliest_event(scene, window, s, counters, workspace):
    """Return the absorber with the earliest event, and its `GuardEvent`.

    Without an event up to the window's end they are 0 and NOTHING; an offset NaN is a failed
    search. Safe times, guard signals and forced parts in ``workspace`` are updated.

    The absorber whose next event may be the earliest is treated first: its safe time is computed
    again, then it is searched, over a share of the window that doubles until its event is found
    or another absorber comes first.
    """
    sets = scene.sets
    safe_times = workspace.safe_times
    n = safe_times.shape[0]
    now = workspace.contact_states[0].tau
    first = 0
    earliest = GuardEvent(NOTHING, window.half - now, 0.0, 0.0, 0.0, 0)
    resolution = compute_time_resolution(sets.rows[s, 0], window.omega, window.half)
    share = window.half / n
    while earliest.offset > resolution or earliest.kind == NOTHING:
        a = find_most_urgent(safe_times)
        if not safe_times[a].until < now + earliest.offset:
            break
        update_guard_response(sets, scene.absorbers, window, s, a, workspace.forced_sets)
        if safe_times[a].taken_at != now:
            fill_guard_signal(scene, s, a, workspace)
            update_safe_time(scene, window, s, a, workspace)
            counters.counts.evaluations += 1
            continue
        length = min(earliest.offset, max(safe_times[a].until - now, 0.0) + share)
        event = find_absorber_event(scene, window, s, a, length, workspace)
        counters.counts.evaluations += event.evaluations
        if event.kind != NOTHING or np.isnan(event.offset):
            first = a
            earliest = event
            safe_times[a].until = now + event.offset
            if np.isnan(event.offset):
                break
        else:
            safe_times[a].until = now + length
            share = 2.0 * share
    check = counters.check
    if check is not None:
        if check.first.shape[0] > 0:
            check_set(check, scene, window, s, earliest.offset, workspace)
    return first, earliest


@jit
def observe_set_segment(scene, window, s, offset, workspace, observers):
    """Pass a segment of length ``offset`` (s) in the set at position s to the observers."""
    n = workspace.contact_states.shape[0]
    sets = scene.sets
    tau = workspace.contact_states[0].tau
    system = view_set_system(sets, s, workspace.place_rows[s])
    regime = LinearRegime(system, sets.out[s], sets.into[s], 0.0)
    forced = view_set_response(workspace.forced_sets, s, n)
    for a in range(n):
        contact_state = workspace.contact_states[a]
        motion = workspace.motion[a]
        joined = is_joined(sets, s, a)
        motion.q = contact_state.offset if joined else contact_state.q
        motion.v = 0.0 if joined else contact_state.v
        motion.a = 0.0 if joined else contact_state.a
        motion.base_share = 0.0 if joined else 1.0
    segment = Segment(
        regime,
        forced,
        window,
        workspace.buffers,
        1.0,
        workspace.deflection[n],
        workspace.motion,
        tau,
        tau + offset,
    )
    sample_level(segment, observers.clock, observers.level)
    sample_state(segment, observers.clock, observers.series)
    if workspace.last_account[s] != sets.last_fill[s]:
        workspace.last_account[s] = sets.last_fill[s]
        account = observers.energy
        if account is not None:  # another regime has taken this place
            account.states[s].kind = NOT_INITIALISED
            account.states[s].window = np.nan
            account.rows[s, :, :] = 0.0
    add_energy(segment, scene.losses, workspace.scratch, s, observers.energy)


@jit
def observe_friction(scene, window, s, a, offset, workspace, energy):
    """Add the friction loss of the free absorber a over the next ``offset`` (s) to ``energy``."""
    limit = scene.absorbers.limit[a]
    if limit == 0.0:
        return
    sets = scene.sets
    update_guard_response(sets, scene.absorbers, window, s, a, workspace.forced_sets)
    fill_guard_signal(scene, s, a, workspace)
    contact_state = workspace.contact_states[a]
    body = AbsorberView(contact_state, workspace.buffers, view_signal(workspace.signals, a))
    add_friction_loss(
        limit,
        view_set_system(sets, s, sets.rows[s, a]),
        view_set_response(workspace.forced_sets, s, a),
        window.omega,
        body,
        contact_state.tau,
        offset,
        energy,
    )


@jit
def advance_time(scene, window, s, offset, workspace, observers):
    """Advance beam and absorbers by ``offset`` (s) in the set at position s, without an event.

    The segment is passed to the observers; contact states and free amplitudes are updated.
    """
    sets = scene.sets
    tau = workspace.contact_states[0].tau
    observe_set_segment(scene, window, s, offset, workspace, observers)
    for a in range(workspace.contact_states.shape[0]):
        contact_state = workspace.contact_states[a]
        if is_joined(sets, s, a):
            observers.counters.counts.stuck_time += offset
        else:
            energy = observers.energy
            if energy is not None:
                observe_friction(scene, window, s, a, offset, workspace, energy)
            contact_state.q += offset * (contact_state.v + 0.5 * offset * contact_state.a)
            contact_state.v += offset * contact_state.a
            if offset > 0.0:
                contact_state.side = 0.0
                contact_state.at_rest = False
    for a in range(workspace.contact_states.shape[0]):
        workspace.contact_states[a].tau = tau + offset
    propagate(workspace.place_rows[s], sets.table[s], sets.scale[s], offset, workspace.buffers.z)


@jit
def enter_set_window(scene, window, started, workspace, state, events):
    """Begin a window: subtract the forced response, or choose the first set of a run.

    ``started`` False: the run begins with ``state``. Else ``state`` is not used, and the amplitudes
    are the sum of free and forced part before, and the free part after the call.
    """
    for a in range(workspace.contact_states.shape[0]):
        workspace.contact_states[a].tau = -window.half
    workspace.forced_sets.solved[:, :] = False
    if not started:
        init_joined_set(scene, window, state, workspace, events)
    else:
        s = find_joined_set(scene.sets, workspace.contact_states)
        update_set_response(scene.sets, window, s, workspace)
        add_forced(
            workspace.forced_sets.polynomials[s],
            window.omega,
            -window.half,
            -1.0,
            workspace.buffers.z,
        )
        add_base_motion_to_free(scene.sets, window, s, -1.0, workspace)
    forget_safe_times(workspace.safe_times)


@jit
def leave_set_window(scene, window, tau, workspace):
    """End a window, or a run, at ``tau`` (s from the window's centre).

    The forced response is added to the amplitudes, and the motion due to the base to the free
    absorbers.
    """
    s = find_joined_set(scene.sets, workspace.contact_states)
    add_forced(workspace.forced_sets.polynomials[s], window.omega, tau, 1.0, workspace.buffers.z)
    add_base_motion_to_free(scene.sets, window, s, 1.0, workspace)


@jit
def add_base_motion_to_free(sets, window, s, sign, workspace):
    """Add a moving base's motion, times ``sign``, to all free absorbers.

    These are the absorbers that are apart from the beam in the set at position s.
    """
    for a in range(workspace.contact_states.shape[0]):
        if not is_joined(sets, s, a):
            add_base_motion(sets, window, s, a, sign, workspace)


@jit
def advance_to_set_event(scene, window, state, workspace, observers):
    """Advance to the next event of any absorber, or to the window's end, and apply the event.

    The motion is in ``workspace``; ``state`` (2 N_m + 2 n,) is scratch.
    """
    contact_states = workspace.contact_states
    for b in range(contact_states.shape[0]):
        free = contact_states[b].force / scene.absorbers.mass[b]
        contact_states[b].a = free - scene.absorbers.gravity[b]
    s = find_joined_set(scene.sets, contact_states)
    a, event = find_earliest_event(scene, window, s, observers.counters, workspace)
    advance_time(scene, window, s, event.offset, workspace, observers)
    if event.kind == NOTHING:
        return
    for b in range(contact_states.shape[0]):
        workspace.forces[b] = contact_states[b].force
    before = contact_states[a].v
    if is_joined(scene.sets, s, a):
        release_from_set(scene, window, s, a, event.kind, state, workspace, observers.events)
    elif event.kind == REVERSAL:
        handle_reversal(scene, window, s, a, event, state, workspace, observers.events)
    else:
        handle_impact(scene, window, s, a, event, state, workspace, observers)
    if find_joined_set(scene.sets, contact_states) == s and not is_joined(scene.sets, s, a):
        impulse = scene.absorbers.mass[a] * (contact_states[a].v - before)
        update_safe_times_after_event(scene.sets, s, a, impulse, workspace)
    else:
        forget_safe_times(workspace.safe_times)


@jit
def integrate_several_section(scene, schedule, k, started, workspace, state, observers):
    """Integrate section ``k`` of the schedule and return a status code, DONE or an error.

    ``started`` False: the first section of a run, which begins with ``state``. Else ``state`` is
    scratch: the motion stays in ``workspace`` from section to section.
    """
    contact_states = workspace.contact_states
    count = count_windows(schedule, k)
    for w in range(count):
        window = expand_window(schedule, k, w, count)
        enter_set_window(scene, window, started or w > 0, workspace, state, observers.events)
        last = contact_states[0].tau
        stalled = 0
        while contact_states[0].tau < window.half:
            advance_to_set_event(scene, window, state, workspace, observers)
            stalled, status = count_progress(
                observers.counters, window, contact_states[0].tau, last, stalled
            )
            if workspace.joints.unsolved[0]:
                status = JOINTS_UNSOLVED
            if scene.sets.request.failed:
                status = REGIME_FAILED
            if status != DONE:
                leave_set_window(scene, window, contact_states[0].tau, workspace)
                return status
            last = contact_states[0].tau
        leave_set_window(scene, window, window.half, workspace)
        total = workspace.buffers.z[0, 0]
        for a in range(contact_states.shape[0]):
            total += contact_states[a].q
        if not np.isfinite(total):
            return NOT_FINITE
    return DONE


@jit_allocating
def several_lane(scene, plan, state, observers):
    """Integrate one run of a `Several` scene of n absorbers and return a status code.

    ``plan``: the `Schedule`, which is not written. ``state`` (2 N_m + 2 n,) is the initial state
    and becomes the final one.
    """
    schedule = copy_schedule(plan)
    sets = scene.sets
    workspace = new_several_workspace(scene.sets, scene.absorbers, state)
    status = DONE
    counts = observers.counters.counts
    for a in range(workspace.contact_states.shape[0]):
        limit_searches(workspace.signals.memory[a], observers.counters)
    lane_observers = replace_energies_by_account(
        observers, new_account(observers.energy, sets.rows.shape[0], sets.rows.shape[3])
    )
    for k in range(schedule.times.shape[0] - 1):
        status = integrate_several_section(
            scene, schedule, k, k > 0, workspace, state, lane_observers
        )
        if status != DONE:
            break
    if status == DONE:
        counts.reached = schedule.times[-1]
    finish_several_run(scene, counts.reached, workspace, state, observers)
    return status


@jit
def finish_several_run(scene, end, workspace, state, observers):
    """Write the final state, record open joined phases, and take the sample at ``end`` (s)."""
    contact_states = workspace.contact_states
    s = find_joined_set(scene.sets, workspace.contact_states)
    w = workspace.buffers.rows[0]
    copy_amplitudes(workspace.buffers.z, w)
    write_state_from(scene.sets, s, w, workspace, state)
    for a in range(contact_states.shape[0]):
        if contact_states[a].regime == JOINED:
            record_joined_phase(observers.events, contact_states[a], end)
    take_last_sample(
        state, scene.absorbers.tip_shape, end, observers.clock, observers.level, observers.series
    )
