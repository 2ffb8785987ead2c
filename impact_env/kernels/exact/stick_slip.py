"""The two regimes of one absorber with rigid contact.

The module advances each to its next event and changes from one to the other.

- free: the beam's modes and the absorber move apart, with a constant force between them if there is
  friction. Ends at a wall (impact), or where the relative velocity turns (friction).
- joined: the absorber moves with the tip. Its force, absorber mass times tip acceleration, must
  stay within what friction and the wall it touches can give; where it leaves that interval the
  phase ends. It begins where friction can hold at a reversal, or after a complete chatter.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline, jit_view
from impact_env.kernels.energy.energies import add_energy
from impact_env.kernels.events.signals import HIT_HIGH, Signal, new_signal
from impact_env.kernels.exact.check import check_free_segment, check_joined_segment
from impact_env.kernels.exact.next_event import find_end_of_flight, find_end_of_hold
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINED,
    JOINT_FORCE_TOL,
    AbsorberView,
    ContactLaw,
    add_friction_loss,
    compute_tip_motion,
    detect_wall_contact,
    impulse_response_bound,
    joint_bounds,
    new_contact_states,
    record_joined_phase,
    static_limit,
    update_free_acceleration,
    update_friction_force,
    update_wall_contact,
)
from impact_env.kernels.motion.forced import (
    Forced,
    add_forced,
    base_motion,
    evaluate_signal,
    new_forced,
)
from impact_env.kernels.motion.modal_system import (
    GUARD,
    REST,
    add_weighted,
    apply_weights,
    copy_amplitudes,
    propagate,
)
from impact_env.kernels.motion.observers import ABSORBER_MOTION
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
)


class Rigid(NamedTuple):
    """A scene of one absorber with rigid contact.

    It consists of the two regimes, the contact, and the data for the energy balance.
    """

    free: LinearRegime
    joined: LinearRegime
    contact: ContactLaw
    losses: Losses


class RigidWorkspace(NamedTuple):
    """Motion and scratch memory of a run with one absorber and rigid contact.

    ``contact_states`` (1,), a RIGID_CONTACT_STATE record, and ``buffers.z`` carry the motion from
    section to section. ``solved`` (2,): whether the forced response of a regime is known in the
    current window. ``motion`` (1,): as in `segments.Segment`.
    """

    contact_states: NDArray[Any]
    buffers: Buffers
    signal: Signal
    free_forced: Forced
    joined_forced: Forced
    solved: NDArray[np.bool_]
    motion: NDArray[Any]
    scratch: NDArray[np.float64]


@jit_allocating
def new_rigid_workspace(free, joined, load, state):
    """Return the workspace of a scene under a load, None: under a chirp."""
    size = free.system.rows.shape[1]
    contact_states = new_contact_states(1)
    contact_states[0].impulse_bound = impulse_response_bound(free.system.rows)
    free_forced = new_forced(free.system, load)
    joined_forced = new_forced(joined.system, load)
    solved = np.zeros(2, np.bool_)
    return RigidWorkspace(
        contact_states,
        new_buffers(size),
        new_signal(size),
        free_forced,
        joined_forced,
        solved,
        np.zeros(1, ABSORBER_MOTION),
        np.zeros_like(state),
    )


@jit_view
def view_absorber(workspace):
    """Return the absorber's contact state, buffers and guard signal."""
    return AbsorberView(workspace.contact_states[0], workspace.buffers, workspace.signal)


@jit_inline
def add_base_motion(window, workspace, sign):
    """Add a moving base's motion of a free absorber, times ``sign``.

    The remaining motion of a free absorber is a polynomial.
    """
    load = window.load
    if load is not None:
        contact_state = workspace.contact_states[0]
        q, v = base_motion(load, workspace.free_forced.signals, window.omega, contact_state.tau)
        contact_state.q += sign * q
        contact_state.v += sign * v


@jit
def assemble_amplitudes(regime, forced, omega, contact_state, z, w):
    """Write the complete modal amplitudes at the current time to ``w``.

    They are the sum of the free, the forced and the static part.
    """
    copy_amplitudes(z, w)
    add_forced(forced.polynomials, omega, contact_state.tau, 1.0, w)
    add_weighted(regime.system.rows, REST, contact_state.force, w)


@jit
def enter_regime(regime, forced, omega, contact_state, state, z):
    """Write the free part of a regime's modal amplitudes for a state at the current time."""
    compute_amplitudes(regime.into, state, z)
    add_forced(forced.polynomials, omega, contact_state.tau, -1.0, z)
    add_weighted(regime.system.rows, REST, -contact_state.force, z)


@jit
def write_free_state(free, forced, omega, contact_state, buffers, state):
    """Write the state in the free regime."""
    assemble_amplitudes(free, forced, omega, contact_state, buffers.z, buffers.rows[0])
    compute_state(free.out, buffers.rows[0], state)
    half = state.shape[0] // 2
    state[half - 1] = contact_state.q
    state[2 * half - 1] = contact_state.v


@jit
def compute_joint_force(joined, forced, omega, tau, contact, buffers):
    """Return the joint force (N) at ``tau`` in the joined regime.

    The second result is the sum of the magnitudes of its terms.

    ``buffers.z`` holds the free part of the amplitudes.
    """
    apply_weights(joined.system.rows, GUARD, buffers.z, buffers.u)
    f = evaluate_signal(forced.signals, 0, omega, tau)
    scale = forced.bound[0]
    for j in range(buffers.u.shape[1]):
        f += buffers.u[0, j]
        scale += abs(buffers.u[0, j]) + abs(buffers.u[1, j])
    weight = contact.mass * contact.gravity
    return f + weight, scale + abs(weight)


@jit
def try_stick(scene, window, workspace, state):
    """Join absorber and beam if the joint force is within its bounds; return True if joined.

    Else the direction of slip is set. At a bound the absorber sticks: the rate of the joint force
    then decides in the joined regime.
    """
    contact_state = workspace.contact_states[0]
    joined = scene.joined
    forced = workspace.joined_forced
    buffers = workspace.buffers
    q_tip, v_tip = compute_tip_motion(scene.contact, state)
    contact_state.force = scene.contact.gravity
    enter_regime(joined, forced, window.omega, contact_state, state, buffers.z)
    f, scale = compute_joint_force(
        joined, forced, window.omega, contact_state.tau, scene.contact, buffers
    )
    update_wall_contact(scene.contact.walls, contact_state, q_tip)
    low, high = joint_bounds(static_limit(scene.contact), contact_state.side)
    slack = (
        JOINT_FORCE_TOL * scale
    )  # at its bound the joint force decides in the joined regime, by its rate
    contact_state.v = v_tip
    contact_state.offset = contact_state.q - q_tip
    if low - slack <= f <= high + slack:
        contact_state.regime = JOINED
        contact_state.phase_start = window.centre + contact_state.tau
        return True
    contact_state.sign = -1.0 if f > high else 1.0
    contact_state.force = 0.0
    return False


@jit_inline
def observe_segment(scene, segment, r, scratch, observers):
    """Pass a segment in regime ``r`` to the observers of samples and energies."""
    sample_level(segment, observers.clock, observers.level)
    sample_state(segment, observers.clock, observers.series)
    add_energy(segment, scene.losses, scratch, r, observers.energy)


@jit_inline
def advance_free_regime(scene, window, workspace, observers):
    """Advance the free regime to its next event or to the window's end; return the event."""
    free = scene.free
    forced = workspace.free_forced
    contact = scene.contact
    body = view_absorber(workspace)
    omega = window.omega
    contact_state = body.contact_state
    system = free.system
    counters = observers.counters
    update_free_acceleration(contact, contact_state)
    tau = contact_state.tau
    deflection = free.tip_rest * contact_state.force
    event = find_end_of_flight(
        system, forced, window, contact.walls, contact.limit, body, deflection, window.half - tau
    )
    counters.counts.evaluations += event.evaluations
    offset = event.offset
    check_free_segment(
        counters.check, system, forced, window, contact.walls, contact.limit, body, offset
    )
    end = tau + offset
    motion = workspace.motion[0]
    motion.q = contact_state.q
    motion.v = contact_state.v
    motion.a = contact_state.a
    motion.base_share = 1.0
    observe_segment(
        scene,
        Segment(
            free,
            forced,
            window,
            workspace.buffers,
            contact_state.force,
            deflection,
            workspace.motion,
            tau,
            end,
        ),
        FREE,
        workspace.scratch,
        observers,
    )
    add_friction_loss(contact.limit, system, forced, omega, body, tau, offset, observers.energy)
    propagate(system.rows, system.table, system.scale, offset, workspace.buffers.z)
    contact_state.q += offset * (contact_state.v + 0.5 * offset * contact_state.a)
    contact_state.v += offset * contact_state.a
    contact_state.tau = end
    contact_state.side = 0.0
    contact_state.at_rest = False
    return event


@jit_inline
def advance_joined_regime(scene, window, workspace, observers):
    """Advance the joined regime and return the kind of event.

    The regime lasts until the joint force leaves its bounds, or to the window's end.
    """
    joined = scene.joined
    forced = workspace.joined_forced
    limit = static_limit(scene.contact)
    body = view_absorber(workspace)
    contact_state = body.contact_state
    system = joined.system
    counters = observers.counters
    tau = contact_state.tau
    weight = scene.contact.gravity
    event = find_end_of_hold(
        system, forced, window, limit, scene.contact.mass * weight, body, window.half - tau
    )
    counters.counts.evaluations += event.evaluations
    offset = event.offset
    check_joined_segment(counters.check, system, forced, window, limit, body, offset)
    end = tau + offset
    motion = workspace.motion[0]
    motion.q = contact_state.offset
    motion.v = 0.0
    motion.a = 0.0
    motion.base_share = 0.0
    segment = Segment(
        joined,
        forced,
        window,
        workspace.buffers,
        weight,
        joined.tip_rest * weight,
        workspace.motion,
        tau,
        end,
    )
    observe_segment(scene, segment, JOINED, workspace.scratch, observers)
    propagate(system.rows, system.table, system.scale, offset, workspace.buffers.z)
    contact_state.tau = end
    counters.counts.stuck_time += offset
    return event.kind


@jit
def release_absorber(scene, window, workspace, state, event, events):
    """Leave the joined regime.

    The absorber lags behind the beam if the joint force is above its upper bound, and leads if it
    is below its lower bound.
    """
    contact_state = workspace.contact_states[0]
    joined = scene.joined
    buffers = workspace.buffers
    half = state.shape[0] // 2
    assemble_amplitudes(
        joined, workspace.joined_forced, window.omega, contact_state, buffers.z, buffers.rows[0]
    )
    compute_state(joined.out, buffers.rows[0], state)
    state[half - 1] += contact_state.offset
    contact_state.q = state[half - 1]
    contact_state.v = state[2 * half - 1]
    record_joined_phase(events, contact_state, window.centre + contact_state.tau)
    contact_state.regime = FREE
    contact_state.sign = -1.0 if event == HIT_HIGH else 1.0
    contact_state.at_rest = True
    contact_state.force = 0.0
    update_friction_force(scene.contact.limit, contact_state)
    enter_regime(scene.free, workspace.free_forced, window.omega, contact_state, state, buffers.z)
    add_base_motion(window, workspace, -1.0)


@jit_inline
def can_stick(limit, side):
    """Return whether friction or a wall could hold an absorber without relative velocity."""
    return limit is not None or side != 0.0


@jit
def init_regime(scene, window, workspace, state):
    """Choose the first regime.

    It is joined if the relative velocity is zero and friction or a wall can hold the absorber.
    """
    contact_state = workspace.contact_states[0]
    contact = scene.contact
    half = state.shape[0] // 2
    contact_state.q = state[half - 1]
    contact_state.v = state[2 * half - 1]
    relative = detect_wall_contact(contact, contact.walls, contact_state, state)
    if relative == 0.0 and can_stick(contact.limit, contact_state.side):
        if try_stick(scene, window, workspace, state):
            return
        contact_state.at_rest = True
    elif relative * contact_state.side > 0.0:
        contact_state.side = (
            0.0  # on a wall and moving into it: the search reports the impact at once
        )
    update_friction_force(contact.limit, contact_state)
    enter_regime(
        scene.free, workspace.free_forced, window.omega, contact_state, state, workspace.buffers.z
    )
    add_base_motion(window, workspace, -1.0)
