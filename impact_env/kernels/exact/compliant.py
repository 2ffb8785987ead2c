"""Event-driven exact integration of compliant contact (paper, appendix).

Each wall has a spring k_n, perhaps with a damper in parallel (Kelvin-Voigt), and friction is a
spring k_t in series with a Coulomb slider. A contact lasts as long as the wall is overlapped.

In: a scene (`CompliantScene`), a schedule, the initial state, observers. Out: the final state and a
status code (`compliant_lane`).

Between events the scene is linear: absorber and tip apart, or joined by the springs that act.
Events are the contact of a wall and its end, the slider's slip (its spring at the limit) and its
stick (the relative velocity turns): all guards on the relative displacement and its rate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.compiling.records import FLAG, NUMBER, record_type
from impact_env.kernels.energy.energies import add_energy, new_account, replace_energies_by_account
from impact_env.kernels.events.search import find_next_event
from impact_env.kernels.events.signals import (
    HIT_HIGH,
    NOTHING,
    REVERSAL,
    EventFunction,
    Guards,
    Signal,
    new_signal,
)
from impact_env.kernels.exact.check import GuardBounds, check_guard_samples
from impact_env.kernels.exact.rigid_contact import ContactLaw
from impact_env.kernels.motion.forced import Forced, add_forced, new_forced
from impact_env.kernels.motion.loads import copy_schedule, count_windows, expand_window
from impact_env.kernels.motion.modal_system import (
    GUARD,
    REST,
    add_weighted,
    apply_weights,
    copy_amplitudes,
    propagate,
)
from impact_env.kernels.motion.observers import (
    ABSORBER_MOTION,
    DONE,
    GUARD_PASSED,
    HELD_LOWER,
    HELD_UPPER,
    NOT_FINITE,
    STUCK_INSIDE,
    count_progress,
    limit_searches,
    push_impact,
    push_phase,
)
from impact_env.kernels.motion.segments import (
    Buffers,
    LinearRegime,
    Losses,
    Segment,
    compute_amplitudes,
    compute_state,
    new_buffers,
    sample_level,
    sample_state,
    take_last_sample,
    update_forced_response,
)


class ContactStiffness(NamedTuple):
    """Stiffness of the springs (N/m), 0 where absent."""

    wall: float  # of each wall
    friction: float  # in series with the slider


# a contact between two events
COMPLIANT_CONTACT_STATE = record_type(
    tau=NUMBER,  # time from the window's centre (s)
    q=NUMBER,  # displacement of the absorber in the free regime (m), 0 in all others
    v=NUMBER,  # its velocity (m/s)
    a=NUMBER,  # its acceleration (m/s^2)
    force=NUMBER,  # constant force on the absorber (N)
    wall=NUMBER,  # wall touched: -1 lower, 1 upper, 0 none
    sticks=FLAG,  # whether the slider sticks
    sign=NUMBER,  # sign of the relative velocity of sliding
    anchor=NUMBER,  # slider's position, at which its spring is without force (m)
    side=NUMBER,  # the guard signal starts on its low (-1) or high (1) bound, or on none (0)
    contact_time=NUMBER,  # start of the wall contact (s)
    contact_rate=NUMBER,  # relative velocity at this time (m/s)
    contact_v=NUMBER,  # absorber's velocity at this time (m/s)
    contact_loss=NUMBER,  # loss in the walls' damper up to this time (J)
    stick_time=NUMBER,  # start of the stick (s)
    at_rest=FLAG,  # whether the relative velocity starts at zero
)


class CompliantScene(NamedTuple):
    """A scene of one absorber with compliant contact.

    ``regimes``: without a spring, with the wall's, with the friction's, with both, in the order of
    `find_regime_number`. ``contact``: only mass and tip shape are used; ``springs``: stiffness;
    ``gap``: clearance to either wall (m), infinite without walls; ``limit``: friction limit (N),
    None without friction. Energy balance: ``wall_losses``, with the walls' damper, while a wall is
    touched, else ``losses``.
    """

    regimes: tuple[LinearRegime, LinearRegime, LinearRegime, LinearRegime]
    contact: ContactLaw
    springs: ContactStiffness
    gap: float
    limit: float | None
    losses: Losses
    wall_losses: Losses


class CompliantWorkspace(NamedTuple):
    """Motion and scratch memory of a run with compliant contact."""

    contact_states: NDArray[Any]  # (1,) a COMPLIANT_CONTACT_STATE record
    buffers: Buffers  # of the modal amplitudes
    signal: Signal  # guard signal
    forced: tuple[Forced, Forced, Forced, Forced]  # response of each regime
    solved: NDArray[np.bool_]  # (4,) whether the response of each regime is known in the window
    motion: NDArray[Any]  # (1,) as `Segment.motion`
    scratch: NDArray[np.float64]  # (2 N_m + 2,) a state


@jit_allocating
def new_compliant_state():
    """Return an array (1,) of one COMPLIANT_CONTACT_STATE record, all zeros."""
    return np.zeros(1, COMPLIANT_CONTACT_STATE)


@jit
def find_regime_number(contact_state):
    """Return the regime's number.

    It is 0 for free, 1 with the wall spring, 2 with the friction spring, and 3 with both.
    """
    return (1 if contact_state.wall != 0.0 else 0) + (2 if contact_state.sticks else 0)


@jit
def find_guard_bounds(gap, reach, contact_state):
    """Return the lower and the upper bound (m) of the relative displacement in the regime.

    ``gap`` (m): clearance; ``reach`` (m): friction limit over the friction spring's stiffness.
    Infinity: no bound.
    """
    low = -np.inf
    high = np.inf
    if contact_state.wall == 0.0:
        low = -gap
        high = gap
    elif contact_state.wall > 0.0:
        low = gap
    else:
        high = -gap
    if contact_state.sticks:
        low = max(low, contact_state.anchor - reach)
        high = min(high, contact_state.anchor + reach)
    return low, high


@jit
def update_constant_force(springs, gap, limit, contact_state):
    """Set ``contact_state.force``, the constant part of the force on the absorber (N).

    It follows from the clearance, the slider's position and the sliding friction (``limit``, None
    without friction).
    """
    force = 0.0
    if contact_state.wall != 0.0:
        force += springs.wall * gap * contact_state.wall
    if limit is not None:
        force += (
            springs.friction * contact_state.anchor
            if contact_state.sticks
            else -limit * contact_state.sign
        )
    contact_state.force = force


@jit
def compute_relative_motion(contact, state):
    """Return relative displacement (m) and velocity (m/s) of a state, absorber minus tip."""
    modes = contact.tip_shape.shape[0]
    r = state[modes]
    v = state[2 * modes + 1]
    for i in range(modes):
        r -= contact.tip_shape[i] * state[i]
        v -= contact.tip_shape[i] * state[modes + 1 + i]
    return r, v


@jit
def read_damper_loss(damped, energy):
    """Return the loss in the walls' damper since the start of the run (J).

    ``damped``: whether the walls have a damper. ``energy`` None, energies are not observed: the
    result is NaN with a damper, and 0 without.
    """
    if energy is None:
        return np.nan if damped else 0.0
    return energy.totals[0].absorber_damping


@jit
def begin_wall_contact(side, time, rate, absorber_velocity, loss, contact_state, counters):
    """Begin a wall contact in ``contact_state`` and count it as an impact.

    ``side``: the wall, -1 or 1. At ``time`` (s) the relative velocity is ``rate`` (m/s), and
    ``loss`` (J) the loss in the walls' damper since the start of the run.
    """
    contact_state.wall = side
    contact_state.contact_loss = loss
    contact_state.contact_time = time
    contact_state.contact_rate = rate
    contact_state.contact_v = absorber_velocity
    counters.counts.impacts += 1


@jit
def record_wall_contact(time, absorber_velocity, loss, contact_state, events, mass):
    """Append the contact that ends at ``time`` (s) to the lists of impacts and of phases.

    ``absorber_velocity`` (m/s) is that at this time, ``loss`` (J) the loss in the walls' damper
    from the start of the run up to it. The contact state is not changed.
    """
    push_impact(
        events,
        contact_state.contact_time,
        contact_state.contact_rate,
        mass * (absorber_velocity - contact_state.contact_v),
        loss - contact_state.contact_loss,
        0,
    )
    push_phase(
        events,
        contact_state.contact_time,
        time,
        HELD_UPPER if contact_state.wall > 0.0 else HELD_LOWER,
        0,
    )


@jit
def toggle_wall_contact(event, gap, contact_state, time, absorber_velocity, loss, mass, observers):
    """Begin a wall contact in ``contact_state``, or end and record the present one.

    Without clearance the contact with the other wall begins where that with one wall ends.
    ``time``, ``absorber_velocity`` and ``loss`` as in `record_wall_contact`.
    """
    if contact_state.wall == 0.0:
        side = 1.0 if event.kind == HIT_HIGH else -1.0
        contact_state.side = -side
        begin_wall_contact(
            side, time, event.rate, absorber_velocity, loss, contact_state, observers.counters
        )
        return
    record_wall_contact(time, absorber_velocity, loss, contact_state, observers.events, mass)
    contact_state.side = contact_state.wall
    if gap == 0.0:
        begin_wall_contact(
            -contact_state.wall,
            time,
            event.rate,
            absorber_velocity,
            loss,
            contact_state,
            observers.counters,
        )
    else:
        contact_state.wall = 0.0


@jit_inline
def handle_contact_event(event, scene, reach, contact_state, state, time, observers):
    """Set the contact state after an event: stick, slip, or a wall contact begins or ends.

    ``state`` is the state at the event, ``time`` (s) that of the run, ``reach`` (m) as in
    `find_guard_bounds`. The constant force is not updated.
    """
    half = state.shape[0] // 2
    r, v = compute_relative_motion(scene.contact, state)
    if event.kind == REVERSAL:
        contact_state.sticks = True
        contact_state.anchor = r - contact_state.sign * reach
        contact_state.side = contact_state.sign
        contact_state.at_rest = True
        contact_state.stick_time = time
        return
    sign = 1.0 if event.kind == HIT_HIGH else -1.0
    if contact_state.sticks:
        low, high = find_guard_bounds(scene.gap, reach, contact_state)
        slip = contact_state.anchor + sign * reach
        if slip == (high if sign > 0.0 else low):
            contact_state.sticks = False
            contact_state.sign = sign
            contact_state.at_rest = sign * v <= 0.0
            push_phase(observers.events, contact_state.stick_time, time, STUCK_INSIDE, 0)
            return
    toggle_wall_contact(
        event,
        scene.gap,
        contact_state,
        time,
        state[2 * half - 1],
        read_damper_loss(scene.wall_losses.damper > 0.0, observers.energy),
        scene.contact.mass,
        observers,
    )


@jit
def init_compliant_contact(springs, gap, limit, contact_state, state, contact, counters):
    """Set the contact state at the start of a run, from the initial ``state``.

    With friction the slider sticks, without force. A wall that the absorber overlaps is in contact.
    """
    r, v = compute_relative_motion(contact, state)
    if abs(r) > gap or gap == 0.0:
        begin_wall_contact(
            1.0 if r >= 0.0 else -1.0, 0.0, v, state[-1], 0.0, contact_state, counters
        )
        if r == 0.0:
            contact_state.side = -1.0
    if limit is not None:
        contact_state.sticks = True
        contact_state.anchor = r
        contact_state.stick_time = 0.0
    update_constant_force(springs, gap, limit, contact_state)


@jit_inline
def check_compliant_segment(check, scene, system, forced, window, bounds, workspace, offset):
    """Check a search on dense samples over a length ``offset`` (s).

    The relative displacement must stay within ``bounds`` (low, high; m), and a slider that slides
    must not turn.
    """
    contact_state = workspace.contact_states[0]
    sign = 0.0
    if scene.limit is not None:
        if not contact_state.sticks:
            sign = contact_state.sign
    guard = GuardBounds(
        bounds[0], bounds[1], scene.gap if scene.gap < np.inf else 0.0, 0.0, sign, GUARD_PASSED
    )
    check_guard_samples(
        check, system, forced, window, workspace.signal, contact_state.tau, offset, guard
    )


@jit_inline
def find_segment_end(system, forced, window, limit, low, high, workspace):
    """Return the first `GuardEvent` up to the window's end, NOTHING without.

    The relative displacement, in ``workspace.signal``, reaches ``low`` or ``high`` (m), or a
    sliding slider reverses (REVERSAL).
    """
    contact_state = workspace.contact_states[0]
    length = window.half - contact_state.tau
    side = int(contact_state.side)
    function = EventFunction(system, forced, window.omega, workspace.signal, contact_state.tau)
    if limit is None:
        return find_next_event(window, function, Guards(low, high, side, None, False), length)
    if not contact_state.sticks:
        return find_next_event(
            window,
            function,
            Guards(low, high, side, contact_state.sign, contact_state.at_rest),
            length,
        )
    return find_next_event(
        window, function, Guards(low, high, side, None, contact_state.at_rest), length
    )


@jit_inline
def advance_regime(regime, forced, scene, window, reach, workspace, observers):
    """Advance a regime to its next event or the window's end; return the `GuardEvent`.

    Contact state and free amplitudes in ``workspace`` are then those at its end, before the event
    is applied; the segment is passed to the observers.
    """
    contact_state = workspace.contact_states[0]
    buffers = workspace.buffers
    counters = observers.counters
    r = find_regime_number(workspace.contact_states[0])
    free = r == 0
    system = regime.system
    p = workspace.signal.polynomial
    rows = system.rows
    compliance = 0.0  # static relative displacement under a unit constant force (m/N)
    for j in range(rows.shape[1]):
        compliance += rows[GUARD, j] * rows[REST, j] - rows[GUARD + 1, j] * rows[REST + 1, j]
    rest = compliance * contact_state.force
    apply_weights(system.rows, GUARD, buffers.z, workspace.signal.u)
    contact_state.a = contact_state.force / scene.contact.mass if free else 0.0
    if free:
        p[0] = contact_state.q + rest
        p[1] = contact_state.v
        p[2] = contact_state.a
    else:
        p[0] = rest
        p[1] = 0.0
        p[2] = 0.0
        contact_state.q = 0.0
        contact_state.v = 0.0
    low, high = find_guard_bounds(scene.gap, reach, contact_state)
    tau = contact_state.tau
    event = find_segment_end(system, forced, window, scene.limit, low, high, workspace)
    counters.counts.evaluations += event.evaluations
    offset = event.offset
    check = counters.check
    if check is not None:
        if check.first.shape[0] > 0:
            check_compliant_segment(
                check, scene, system, forced, window, (low, high), workspace, offset
            )
    end = tau + offset
    motion = workspace.motion[0]
    motion.q = contact_state.q
    motion.v = contact_state.v
    motion.a = contact_state.a
    segment = Segment(
        regime,
        forced,
        window,
        buffers,
        contact_state.force,
        regime.tip_rest * contact_state.force,
        workspace.motion,
        tau,
        end,
    )
    sample_level(segment, observers.clock, observers.level)
    sample_state(segment, observers.clock, observers.series)
    if contact_state.wall != 0.0:
        add_energy(segment, scene.wall_losses, workspace.scratch, r, observers.energy)
    else:
        add_energy(segment, scene.losses, workspace.scratch, r, observers.energy)
    propagate(system.rows, system.table, system.scale, offset, buffers.z)
    if free:
        contact_state.q += offset * (contact_state.v + 0.5 * offset * contact_state.a)
        contact_state.v += offset * contact_state.a
    contact_state.tau = end
    contact_state.side = 0.0
    contact_state.at_rest = False
    if contact_state.sticks:
        counters.counts.stuck_time += offset
    return event


@jit
def write_regime_state(regime, forced, omega, contact_state, buffers, state):
    """Write ``state`` in the current regime at the current time; ``buffers.rows`` is scratch."""
    w = buffers.rows[0]
    copy_amplitudes(buffers.z, w)
    add_forced(forced.polynomials, omega, contact_state.tau, 1.0, w)
    add_weighted(regime.system.rows, REST, contact_state.force, w)
    compute_state(regime.out, w, state)
    half = state.shape[0] // 2
    if find_regime_number(contact_state) == 0:
        state[half - 1] = contact_state.q
        state[2 * half - 1] = contact_state.v


@jit
def read_regime_state(regime, forced, omega, contact_state, buffers, state):
    """Write free amplitudes and the absorber's motion for a state at the current time.

    They are written to ``buffers.z`` and ``contact_state``.
    """
    half = state.shape[0] // 2
    contact_state.q = state[half - 1]
    contact_state.v = state[2 * half - 1]
    compute_amplitudes(regime.into, state, buffers.z)
    add_forced(forced.polynomials, omega, contact_state.tau, -1.0, buffers.z)
    add_weighted(regime.system.rows, REST, -contact_state.force, buffers.z)


@jit_allocating
def new_compliant_workspace(regimes, load, state):
    """Return the workspace of a scene with four ``regimes``.

    ``load``: workspace of the loads, None under the chirp of one force; ``state`` (2 N_m + 2,)
    gives the size only.
    """
    free, wall, friction, both = regimes
    size = free.system.rows.shape[1]
    forced = (
        new_forced(free.system, load),
        new_forced(wall.system, load),
        new_forced(friction.system, load),
        new_forced(both.system, load),
    )
    return CompliantWorkspace(
        new_compliant_state(),
        new_buffers(size),
        new_signal(size),
        forced,
        np.zeros(4, np.bool_),
        np.zeros(1, ABSORBER_MOTION),
        np.zeros_like(state),
    )


@jit_inline
def enter_compliant_regime(scene, window, workspace, state):
    """Continue from a state in the regime of the contact state.

    Its forced response is solved unless it is known in this window.
    """
    contact_state = workspace.contact_states[0]
    r = find_regime_number(contact_state)
    regime = scene.regimes[r]
    forced = workspace.forced[r]
    if not workspace.solved[r]:
        update_forced_response(regime.system, window, None, forced)
        workspace.solved[r] = True
    read_regime_state(regime, forced, window.omega, contact_state, workspace.buffers, state)


@jit_inline
def advance_to_compliant_event(scene, window, reach, workspace, state, observers):
    """Advance to the next event, or to the window's end, and apply the event.

    ``state`` is the state at the current time, before and after the call.
    """
    contact_state = workspace.contact_states[0]
    energy = observers.energy
    r0, _ = compute_relative_motion(scene.contact, state)
    number = find_regime_number(contact_state)
    regime = scene.regimes[number]
    forced = workspace.forced[number]
    event = advance_regime(regime, forced, scene, window, reach, workspace, observers)
    write_regime_state(regime, forced, window.omega, contact_state, workspace.buffers, state)
    r1, _ = compute_relative_motion(scene.contact, state)
    if energy is not None and scene.limit is not None:
        if not contact_state.sticks:
            energy.totals[0].friction_loss += scene.limit * abs(r1 - r0)
    if event.kind != NOTHING:
        handle_contact_event(
            event, scene, reach, contact_state, state, window.centre + contact_state.tau, observers
        )
        update_constant_force(scene.springs, scene.gap, scene.limit, contact_state)
        enter_compliant_regime(scene, window, workspace, state)


@jit
def integrate_compliant_section(scene, schedule, k, workspace, state, observers):
    """Integrate section ``k`` of the schedule and return a status code, DONE or an error.

    ``state`` is that at the start of the section and becomes that at its end. The contact state
    stays in ``workspace`` for the next section.
    """
    contact_state = workspace.contact_states[0]
    reach = 0.0  # of the slider's spring (m): limit over stiffness
    if scene.limit is not None:
        reach = scene.limit / scene.springs.friction
    count = count_windows(schedule, k)
    for w in range(count):
        window = expand_window(schedule, k, w, count)
        contact_state.tau = -window.half
        workspace.solved[:] = False
        last = contact_state.tau
        stalled = 0
        enter_compliant_regime(scene, window, workspace, state)
        while contact_state.tau < window.half:
            advance_to_compliant_event(scene, window, reach, workspace, state, observers)
            stalled, status = count_progress(
                observers.counters, window, contact_state.tau, last, stalled
            )
            if status != DONE:
                return status
            last = contact_state.tau
        if not np.isfinite(state[0]):
            return NOT_FINITE
    return DONE


@jit_allocating
def compliant_lane(scene, plan, state, observers):
    """Integrate one run of a `CompliantScene` and return a status code, DONE or an error.

    ``plan``: the `Schedule`, which is not written. ``state`` (2 N_m + 2,) is the initial state and
    becomes the final one. The friction loss contains the energy that the slider's spring stores at
    the end.
    """
    schedule = copy_schedule(plan)
    workspace = new_compliant_workspace(scene.regimes, schedule.load, state)
    status = DONE
    counts = observers.counters.counts
    limit_searches(workspace.signal.memory, observers.counters)
    lane_observers = replace_energies_by_account(
        observers, new_account(observers.energy, 4, workspace.buffers.z.shape[1])
    )
    init_compliant_contact(
        scene.springs,
        scene.gap,
        scene.limit,
        workspace.contact_states[0],
        state,
        scene.contact,
        observers.counters,
    )
    for k in range(schedule.times.shape[0] - 1):
        status = integrate_compliant_section(scene, schedule, k, workspace, state, lane_observers)
        if status != DONE:
            break
    if status == DONE:
        counts.reached = schedule.times[-1]
    finish_compliant_run(scene, workspace, state, counts.reached, observers)
    return status


@jit
def finish_compliant_run(scene, workspace, state, end, observers):
    """Finish the observations of a run that ended at ``end`` (s) with ``state``.

    Open wall contacts and stick phases are recorded, the energy that the slider's spring stores is
    added to the friction loss, the loss in the walls' damper is moved to the impact loss, and a
    sample at ``end`` is taken.
    """
    contact_state = workspace.contact_states[0]
    contact = scene.contact
    if contact_state.sticks:
        push_phase(observers.events, contact_state.stick_time, end, STUCK_INSIDE, 0)
    if contact_state.wall != 0.0:
        loss = read_damper_loss(scene.wall_losses.damper > 0.0, observers.energy)
        record_wall_contact(end, state[-1], loss, contact_state, observers.events, contact.mass)
    energy = observers.energy
    if energy is not None:
        totals = energy.totals[0]
        if scene.limit is not None:
            # the energy that the slider's spring stores; its force is at its limit while it slides
            deflection = scene.limit / scene.springs.friction
            if contact_state.sticks:
                r, _ = compute_relative_motion(contact, state)
                deflection = r - contact_state.anchor
            totals.friction_loss += 0.5 * scene.springs.friction * deflection * deflection
        # the walls' damper was counted as an absorber's
        totals.impact_loss += totals.absorber_damping
        totals.absorber_damping = 0.0
    take_last_sample(
        state, contact.tip_shape, end, observers.clock, observers.level, observers.series
    )
