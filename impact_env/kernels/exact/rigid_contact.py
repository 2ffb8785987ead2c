"""One rigid contact between an absorber and the beam: its state, its laws, its next event.

In: the laws (`ContactLaw`), the contact's record between two events (RIGID_CONTACT_STATE), and the
absorber in motion (`AbsorberView`). Out: the event that ends a flight or a hold, and the state
after an impact, a reversal or a stick.

An impact whose remaining bounces, all together, stay below the rounding of the position is
completed at once (complete chatter): the remaining relative velocity is taken out by a plastic
impulse.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, record_type
from impact_env.kernels.events.search import find_next_event
from impact_env.kernels.events.signals import (
    EPSILON,
    HIT_HIGH,
    SIGNAL_ROUNDING,
    EventFunction,
    Guards,
    Signal,
    compute_signal_scale,
    evaluate_at_offset,
    evaluate_value_at_offset,
)
from impact_env.kernels.motion.modal_system import (
    GUARD,
    RELATIVE,
    REST,
    SPEED,
    add_weighted,
    apply_weights,
)
from impact_env.kernels.motion.observers import (
    HELD_LOWER,
    HELD_UPPER,
    STUCK_INSIDE,
    push_impact,
    push_phase,
)
from impact_env.kernels.motion.segments import Buffers

FREE = 0
JOINED = 1
# share of the sum of the sizes of a joint force's terms by which the force may exceed its bound: a
# hundred times the allowed error of the change to the joined modes' basis (`regimes.SOUND`), so
# that rounding does not release an absorber whose joint force is at a bound
JOINT_FORCE_TOL = 1e-9
LEAST_CHATTER_DECAY = 0.1  # 1 - e counts as at least this where a chatter is completed
# share of a signal's scale: larger than the distance that the search takes for zero
POSITION_ROUNDING = 16.0 * SIGNAL_ROUNDING

# a contact between two events; signs refer to the absorber relative to the beam. Under a moving
# base q and v of a free absorber lack the motion that the base causes (`add_base_motion`)
RIGID_CONTACT_STATE = record_type(
    regime=INTEGER,  # FREE or JOINED
    tau=NUMBER,  # time from the window's centre (s)
    q=NUMBER,  # displacement of the free absorber (m)
    v=NUMBER,  # its velocity (m/s)
    a=NUMBER,  # its acceleration (m/s^2)
    force=NUMBER,  # constant force on the absorber (N); joined, one absorber: its gravity (m/s^2)
    sign=NUMBER,  # sign of the relative velocity (direction of slip), -1 or 1
    side=NUMBER,  # wall touched: -1 lower, 1 upper, 0 none
    at_rest=FLAG,  # whether the relative velocity is zero
    offset=NUMBER,  # displacement of a joined absorber relative to the beam (m)
    phase_start=NUMBER,  # start of the joined phase (s)
    impulse_bound=NUMBER,  # largest relative acceleration by a unit impulse (1/(kg s))
    absorber=INTEGER,  # number of the absorber, from 0
)


class Walls(NamedTuple):
    """Rigid walls."""

    gap: float  # clearance to either wall (m)
    restitution: float  # Newton's coefficient
    # relative velocity (m/s) above which the coefficient falls, infinity: constant coefficient
    yield_velocity: float = np.inf


NO_WALLS_GAP = 1e300
NO_WALLS = Walls(NO_WALLS_GAP, 1.0)  # out of reach: what a scene without walls has


class ContactLaw(NamedTuple):
    """Laws of one rigid contact."""

    mass: float  # mass of the absorber (kg)
    compliance: float  # G = 1/mass + sum tip_shape^2 (1/kg)
    tip_shape: NDArray[np.float64]  # (N_m,)
    walls: Walls  # `NO_WALLS` for a scene without walls
    limit: float | None  # limit of sliding friction (N), None without friction
    gravity: float  # weight over mass, towards the lower wall (m/s^2); 0: across the motion
    static_ratio: float  # limit of static over that of sliding friction, 1 or above


class AbsorberView(NamedTuple):
    """One absorber in motion; functions change all three parts in place."""

    contact_state: Any  # a RIGID_CONTACT_STATE record
    buffers: Buffers  # of the modal amplitudes
    signal: Signal  # its guard signal


@jit_inline
def has_walls(walls):
    """Return whether an absorber has walls."""
    return walls.gap < NO_WALLS_GAP


@jit_allocating
def new_contact_states(n):
    """Return the contact states (n,) of absorbers that are free and at rest."""
    return np.zeros(n, RIGID_CONTACT_STATE)


@jit
def update_friction_force(limit, contact_state):
    """Set ``contact_state.force`` (N) to the friction force for its direction of slip.

    Without friction (``limit`` None) it is left as it is.
    """
    if limit is not None:
        contact_state.force = -contact_state.sign * limit


@jit
def add_friction_loss(limit, system, forced, omega, body, tau, offset, energy):
    """Add the friction loss of a segment, friction limit times the distance slid, to ``energy``.

    The segment begins at ``tau`` (s from the window's centre) and is ``offset`` (s) long;
    ``body.signal`` is the relative displacement from ``tau`` on. Nothing is added if ``limit`` or
    ``energy`` is None.
    """
    if energy is None or limit is None:
        return
    start = evaluate_value_at_offset(system, forced.signals, omega, body.signal, tau, 0.0)
    end = evaluate_value_at_offset(system, forced.signals, omega, body.signal, tau, offset)
    energy.totals[0].friction_loss += limit * abs(end - start)


@jit
def update_slip_direction(system, limit, sign, contact_state, z):
    """Set the direction of slip, ``sign`` -1 or 1, and the friction force in ``contact_state``.

    The free part z (2, J) of the amplitudes is shifted by the change of the static part, so that
    the motion is continuous. Nothing is changed without friction (``limit`` None).
    """
    if limit is None:
        return
    old = contact_state.force
    contact_state.sign = sign
    update_friction_force(limit, contact_state)
    add_weighted(system.rows, REST, old - contact_state.force, z)


@jit
def reverse_or_stick(system, contact, limit, body, event):
    """Return whether static friction holds the absorber at zero relative velocity.

    If it does not, the direction of slip is reversed in ``body``, with the friction force and the
    free amplitudes. If it does, or without friction (``limit`` None, result False), ``body`` is
    unchanged. ``event`` is the REVERSAL.
    """
    if limit is None:
        return False
    # the constant force F alone bends the relative displacement by F G
    needed = body.contact_state.force - event.bend / contact.compliance
    if abs(needed) <= limit * contact.static_ratio:
        return True
    body.contact_state.at_rest = True
    update_slip_direction(
        system, limit, -1.0 if needed > 0.0 else 1.0, body.contact_state, body.buffers.z
    )
    return False


@jit
def compute_static_limit(contact):
    """Return the friction limit (N) of an absorber that sticks, None without friction."""
    if contact.limit is None:
        return None
    return contact.limit * contact.static_ratio


@jit
def find_joint_bounds(limit, side):
    """Return the lower and the upper bound (N) of the joint force on the absorber.

    They follow from the limit of static friction (N, None without friction) and from the wall that
    the absorber touches (``side`` as in the contact's record), whose push is unbounded: an upper
    wall pushes down, a lower one up.
    """
    low = 0.0
    high = 0.0
    if limit is not None:
        low = -limit
        high = limit
    if side > 0.0:
        low = -np.inf
    if side < 0.0:
        high = np.inf
    return low, high


@jit
def record_joined_phase(events, contact_state, time):
    """Append a joined phase that ends at ``time`` (s) to the list of phases."""
    kind = (
        STUCK_INSIDE
        if contact_state.side == 0.0
        else (HELD_UPPER if contact_state.side > 0.0 else HELD_LOWER)
    )
    push_phase(events, contact_state.phase_start, time, kind, contact_state.absorber)


@jit
def compute_tip_motion(contact, state):
    """Return displacement (m) and velocity (m/s) of the beam at the contact, from a state.

    ``contact.tip_shape`` has the mode shapes there.
    """
    half = state.shape[0] // 2
    q = 0.0
    v = 0.0
    for i in range(contact.tip_shape.shape[0]):
        q += contact.tip_shape[i] * state[i]
        v += contact.tip_shape[i] * state[half + i]
    return q, v


@jit_inline
def update_wall_contact(walls, contact_state, q_tip):
    """Set ``contact_state.side`` if the absorber touches a wall, else leave it unchanged.

    It touches a wall if their distance is below rounding, as after a plastic impact. ``q_tip`` (m):
    displacement of the beam at the absorber.
    """
    if walls.gap < np.inf and abs(contact_state.q - q_tip) >= walls.gap - 4.0 * EPSILON * (
        walls.gap + abs(contact_state.q) + abs(q_tip)
    ):
        contact_state.side = 1.0 if contact_state.q > q_tip else -1.0


@jit
def detect_wall_contact(contact, walls, contact_state, state):
    """Set the wall that an absorber touches and the direction of slip in ``contact_state``.

    Displacement and velocity of the absorber are those of ``contact_state``, those of the beam
    follow from ``state``. Returns the absorber's relative velocity (m/s); if it is zero the
    direction is -1.
    """
    q_tip, v_tip = compute_tip_motion(contact, state)
    relative = contact_state.v - v_tip
    update_wall_contact(walls, contact_state, q_tip)
    contact_state.sign = 1.0 if relative > 0.0 else -1.0
    return relative


@jit_inline
def compute_restitution(walls, v):
    """Return the coefficient of restitution of an impact with relative velocity v (m/s).

    See `parameters.YieldingWalls`.
    """
    return walls.restitution / np.sqrt(np.sqrt(1.0 + abs(v) / walls.yield_velocity))


@jit_inline
def apply_impact(system, forced, window, walls, contact, body, event, observers):
    """Apply Newton's impact law; return True if a complete chatter was ended by a plastic impulse.

    The impulse is -(1 + e) v / G with the relative velocity v at the ``event``, HIT_LOW or
    HIT_HIGH. Where all bounces to come stay below the rounding of the position, the remaining
    relative velocity is taken out at once. The contact state of ``body`` (displacement, velocity,
    wall, direction of slip), its free amplitudes and the observers are updated.
    """
    contact_state = body.contact_state
    z = body.buffers.z
    v = event.rate
    side = 1.0 if event.kind == HIT_HIGH else -1.0
    contact_state.q -= event.value - side * walls.gap  # rounding must not add up to a penetration

    e = compute_restitution(walls, v)
    impulse = -(1.0 + e) * v / contact.compliance
    loss = 0.5 * (1.0 - e * e) * v * v / contact.compliance
    after = -e * v
    add_weighted(system.rows, RELATIVE, impulse, z)
    contact_state.v += impulse / contact.mass
    contact_state.side = side
    observers.counters.counts.impacts += 1

    # bound of the relative acceleration after the impact
    largest = (
        abs(event.bend)
        + abs(impulse) * contact_state.impulse_bound
        + 2.0 * abs(contact_state.force) * contact.compliance
    )
    complete = is_chatter_complete(system, forced, window, walls, body, side, after, largest)
    if complete:
        rest = -after / contact.compliance
        add_weighted(system.rows, RELATIVE, rest, z)
        contact_state.v += rest / contact.mass
        impulse += rest
        loss += 0.5 * after * after / contact.compliance

    push_impact(
        observers.events,
        window.centre + contact_state.tau,
        v,
        impulse,
        loss,
        contact_state.absorber,
    )
    energy = observers.energy
    if energy is not None:
        energy.totals[0].impact_loss += loss
    update_slip_direction(system, contact.limit, -side, contact_state, z)
    return complete


@jit
def bound_impulse_response(rows):
    """Return a bound of the relative acceleration after a unit impulse (1/(kg s)).

    The impulse acts between beam and absorber. ``rows`` (ROWS, J) of a free regime's
    `ModalSystem`, whose guard signal is the relative displacement.
    """
    bound = 0.0
    for j in range(rows.shape[1]):
        gain = np.hypot(rows[GUARD, j], rows[GUARD + 1, j]) * np.hypot(
            rows[RELATIVE, j], rows[RELATIVE + 1, j]
        )
        bound += gain * (rows[SPEED, j] * rows[SPEED, j])
    return bound


@jit
def is_chatter_complete(system, forced, window, walls, body, side, after, largest):
    """Return whether all bounces to come stay below the rounding of the position.

    ``side``: the wall, -1 or 1. ``after`` (m/s): relative velocity v after the impact; the heights
    of the bounces sum to v^2/(2 a (1 - e)) under the relative acceleration a. ``largest`` (m/s^2)
    bounds a, so that most impacts are decided without computing it; otherwise ``body.signal.u`` is
    overwritten.
    """
    signal = body.signal
    height = (
        POSITION_ROUNDING
        * compute_signal_scale(signal, forced.bound)
        * max(1.0 - walls.restitution, LEAST_CHATTER_DECAY)
    )
    if after * after > 2.0 * largest * height + 1e-300:
        return False
    apply_weights(system.rows, GUARD, body.buffers.z, signal.u)
    _, _, a = evaluate_at_offset(
        system, forced.signals, window.omega, signal, body.contact_state.tau, 0.0
    )
    return side * a >= 0.0 and after * after <= 2.0 * abs(a) * height + 1e-300


@jit_inline
def find_end_of_flight(system, forced, window, walls, limit, body, deflection, length):
    """Return the first event within ``length`` (s) of an absorber apart from the beam.

    The event is a `GuardEvent`: a wall (HIT_LOW, HIT_HIGH), with friction a REVERSAL, or NOTHING.
    ``limit`` None: no friction. ``deflection`` (m): static displacement of the beam at the absorber
    under the constant forces. ``body.signal`` is overwritten by the relative displacement.
    """
    contact_state = body.contact_state
    signal = body.signal
    p = body.signal.polynomial
    # first of all, while the numbers that the caller has just written are still in registers
    p[0] = contact_state.q - deflection
    p[1] = contact_state.v
    p[2] = contact_state.a
    apply_weights(system.rows, GUARD, body.buffers.z, signal.u)
    function = EventFunction(system, forced, window.omega, signal, contact_state.tau)
    gap = walls.gap
    if limit is None:
        return find_next_event(
            window,
            function,
            Guards(
                -gap,
                gap,
                int(contact_state.side),
                None,
                contact_state.at_rest and contact_state.side != 0.0,
            ),
            length,
        )
    # only the wall ahead can be reached before the relative velocity turns
    low = -gap if contact_state.sign < 0.0 else -np.inf
    high = gap if contact_state.sign > 0.0 else np.inf
    return find_next_event(
        window, function, Guards(low, high, 0, contact_state.sign, contact_state.at_rest), length
    )


@jit_inline
def find_end_of_hold(system, forced, window, limit, weight, body, length):
    """Return the event within ``length`` (s) at which the joint force leaves its bounds.

    The event is a `GuardEvent`: HIT_LOW, HIT_HIGH or NOTHING. ``limit`` (N): of static friction,
    None without. ``weight`` (N): static part of the joint force. ``body.signal`` is overwritten by
    the joint force.
    """
    signal = body.signal
    apply_weights(system.rows, GUARD, body.buffers.z, signal.u)
    signal.polynomial[:] = 0.0
    signal.polynomial[0] = weight
    low, high = find_joint_bounds(limit, body.contact_state.side)
    function = EventFunction(system, forced, window.omega, signal, body.contact_state.tau)
    return find_next_event(window, function, Guards(low, high, 0, None, False), length)
