"""Compliant contact of one absorber (paper, appendix).

Each wall has a spring k_n, and friction is a spring k_t in series with a Coulomb slider.

Beside a wall's spring there may be a damper (Kelvin-Voigt). A contact lasts as long as the wall is
overlapped.

What is known of it between two events (``now``), its regimes' guards, and its laws.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.compiling.records import FLAG, NUMBER, record_type
from impact_env.kernels.events.signals import HIT_HIGH, REVERSAL
from impact_env.kernels.motion.observers import (
    HELD_LOWER,
    HELD_UPPER,
    STUCK_INSIDE,
    push_impact,
    push_phase,
)


class ContactStiffness(NamedTuple):
    """Stiffness of the walls and of the friction spring (N/m), 0 where absent."""

    wall: float
    friction: float


# a lane between two events: time from the window's centre; absorber displacement, velocity,
# acceleration (used in the free regime); constant relative force; wall touched (-1, 0, 1); whether
# the slider sticks; sign of sliding; slider's position; signal starts on the low or high guard (-1,
# 0, 1); start of the contact, relative velocity and absorber velocity there, loss in the walls'
# damper up to it (J); start of the stick; whether the relative velocity starts at zero
COMPLIANT_CONTACT_STATE = record_type(
    tau=NUMBER,
    q=NUMBER,
    v=NUMBER,
    a=NUMBER,
    force=NUMBER,
    wall=NUMBER,
    sticks=FLAG,
    sign=NUMBER,
    anchor=NUMBER,
    side=NUMBER,
    contact_time=NUMBER,
    contact_rate=NUMBER,
    contact_v=NUMBER,
    contact_loss=NUMBER,
    stick_time=NUMBER,
    at_rest=FLAG,
)


@jit_allocating
def new_compliant_state():
    """Return a COMPLIANT_CONTACT_STATE record (1,) of a run at its start."""
    return np.zeros(1, COMPLIANT_CONTACT_STATE)


@jit
def find_regime_number(contact_state):
    """Return the regime's number.

    It is 0 for free, 1 with the wall spring, 2 with the friction spring, and 3 with both.
    """
    return (1 if contact_state.wall != 0.0 else 0) + (2 if contact_state.sticks else 0)


@jit
def find_guard_bounds(gap, reach, contact_state):
    """Return the bounds (m) of the relative displacement within which the regime holds.

    ``reach`` (m) is the slider's limit over its stiffness.
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
    """Set the constant part of the force on the absorber.

    It follows from the clearance, the slider's position and the sliding friction.
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
def find_slider_sign(limit, contact_state):
    """Return the sign of the relative velocity while the slider slides, else 0."""
    if limit is None:
        return 0.0
    return 0.0 if contact_state.sticks else contact_state.sign


@jit
def compute_relative_motion(contact, state):
    """Return relative displacement (m) and velocity (m/s), absorber minus tip."""
    modes = contact.tip_shape.shape[0]
    r = state[modes]
    v = state[2 * modes + 1]
    for i in range(modes):
        r -= contact.tip_shape[i] * state[i]
        v -= contact.tip_shape[i] * state[modes + 1 + i]
    return r, v


@jit
def read_damper_loss(damped, energy):
    """Return the loss in the walls' damper since the start (J); NaN if it is not observed."""
    if energy is None:
        return np.nan if damped else 0.0
    return energy.totals[0].absorber_damping


@jit
def begin_wall_contact(side, time, rate, absorber_velocity, loss, contact_state, counters):
    """Begin a wall contact; ``loss`` (J): that in the walls' damper so far."""
    contact_state.wall = side
    contact_state.contact_loss = loss
    contact_state.contact_time = time
    contact_state.contact_rate = rate
    contact_state.contact_v = absorber_velocity
    counters.counts.impacts += 1


@jit
def record_wall_contact(time, absorber_velocity, loss, contact_state, events, mass):
    """Append the contact that ends at ``time`` (s) to the lists of events.

    ``loss`` (J) is the loss in the walls' damper up to this time.
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
    """Begin or end a wall contact.

    Without clearance the end of the contact with one wall is the begin of that with the other.
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
    """Set the regime after an event.

    The slider sticks or slips, or a wall contact begins or ends.
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
    """Set the first regime.

    The slider starts without force. A wall that the absorber overlaps at the start is in contact.
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


@jit
def add_slider_loss(limit, r0, r1, contact_state, energy):
    """Add the friction loss over a segment: the limit times the distance slid."""
    if energy is None or limit is None:
        return
    if not contact_state.sticks:
        energy.totals[0].friction_loss += limit * abs(r1 - r0)


@jit
def add_slider_energy(scene, limit, contact_state, state, energy):
    """Add the energy stored in the slider's spring (J).

    While the slider slides, the spring's force is at its limit.
    """
    if energy is None or limit is None:
        return
    deflection = compute_slider_reach(scene.springs, limit)
    if contact_state.sticks:
        r, _ = compute_relative_motion(scene.contact, state)
        deflection = r - contact_state.anchor
    energy.totals[0].friction_loss += 0.5 * scene.springs.friction * deflection * deflection


@jit
def move_damper_loss(energy):
    """Move the loss in the walls' damper to the impact losses, at the end of a run."""
    if energy is None:
        return
    totals = energy.totals[0]
    totals.impact_loss += totals.absorber_damping
    totals.absorber_damping = 0.0


@jit
def compute_slider_reach(springs, limit):
    """Return the slider's limit over its stiffness (m), 0 without a slider."""
    if limit is None:
        return 0.0
    return limit / springs.friction
