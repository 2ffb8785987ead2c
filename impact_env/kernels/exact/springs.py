"""Compliant contact of one absorber (paper, appendix): a spring k_n at either wall, a spring k_t in series with a Coulomb slider.

Beside a wall's spring there may be a damper (Kelvin-Voigt). A contact lasts as long as the wall is overlapped.

What is known of it between two events (``now``), its regimes' guards, and its laws.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room
from impact_env.kernels.compiling.records import FLAG, NUMBER, record
from impact_env.kernels.events.signals import HIT_HIGH, REVERSAL
from impact_env.kernels.motion.observers import (
    HELD_LOWER,
    HELD_UPPER,
    STUCK_INSIDE,
    push_impact,
    push_phase,
)


class Springs(NamedTuple):
    """Stiffness of the walls and of the friction in N/m, 0 where absent."""

    wall: float
    friction: float


# a lane between two events: time from the window's centre; absorber displacement, velocity, acceleration (used in the free regime); constant relative
# force; wall touched (-1, 0, 1); whether the slider sticks; sign of sliding; slider's position; signal starts on the low or high guard (-1, 0, 1);
# start of the contact, relative velocity and absorber velocity there, loss in the walls' damper up to it (J);
# start of the stick; whether the relative velocity starts at zero
NOW = record(
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


@jit_room
def new_now():
    """Return the record (1,) of a lane at its start."""
    return np.zeros(1, NOW)


@jit
def regime_number(now):
    """Return 0 free, 1 wall's spring, 2 friction's spring, 3 both."""
    return (1 if now.wall != 0.0 else 0) + (2 if now.sticks else 0)


@jit
def guard_bounds(gap, reach, now):
    """Return the interval of the relative displacement in which the regime holds; ``reach`` is the slider's limit over its stiffness."""
    low = -np.inf
    high = np.inf
    if gap is not None:
        if now.wall == 0.0:
            low = -gap
            high = gap
        elif now.wall > 0.0:
            low = gap
        else:
            high = -gap
    if now.sticks:
        low = max(low, now.anchor - reach)
        high = min(high, now.anchor + reach)
    return low, high


@jit
def constant_force(springs, gap, limit, now):
    """Set the constant part of the force on the absorber: from the wall's place, the slider's place, and sliding friction."""
    force = 0.0
    if gap is not None:
        force += springs.wall * gap * now.wall
    if limit is not None:
        force += springs.friction * now.anchor if now.sticks else -limit * now.sign
    now.force = force


@jit
def slider_sign(limit, now):
    """Return the sign that the relative velocity keeps while a slider slides, else 0."""
    if limit is None:
        return 0.0
    return 0.0 if now.sticks else now.sign


@jit
def clearance(gap):
    """Return the half-clearance, 0 without walls."""
    if gap is None:
        return 0.0
    return gap


@jit
def relative_motion(contact, state):
    """Return relative displacement and velocity, absorber less tip."""
    modes = contact.tip_shape.shape[0]
    r = state[modes]
    v = state[2 * modes + 1]
    for i in range(modes):
        r -= contact.tip_shape[i] * state[i]
        v -= contact.tip_shape[i] * state[modes + 1 + i]
    return r, v


@jit
def damper_loss(damped, energy):
    """Return the loss in the walls' damper since the run's start (J); not a number where it is not observed."""
    if energy is None:
        return np.nan if damped else 0.0
    return energy.totals[0].absorber_damping


@jit
def start_contact(side, time, rate, absorber_velocity, loss, now, counters):
    """A wall is touched; ``loss``: that in the walls' damper so far (J)."""
    now.wall = side
    now.contact_loss = loss
    now.contact_time = time
    now.contact_rate = rate
    now.contact_v = absorber_velocity
    counters.counts.impacts += 1


@jit
def list_contact(time, absorber_velocity, loss, now, events, mass):
    """List the contact that lasts up to ``time``; ``loss``: that in the walls' damper up to then (J)."""
    push_impact(
        events,
        now.contact_time,
        now.contact_rate,
        mass * (absorber_velocity - now.contact_v),
        loss - now.contact_loss,
        0,
    )
    push_phase(events, now.contact_time, time, HELD_UPPER if now.wall > 0.0 else HELD_LOWER, 0)


@jit
def touch(found, gap, now, time, absorber_velocity, loss, mass, observe):
    """A wall's contact begins or ends; without clearance the end at one wall is the begin at the other."""
    if gap is None:
        return
    if now.wall == 0.0:
        side = 1.0 if found.kind == HIT_HIGH else -1.0
        now.side = -side
        start_contact(side, time, found.rate, absorber_velocity, loss, now, observe.counters)
        return
    list_contact(time, absorber_velocity, loss, now, observe.events, mass)
    now.side = now.wall
    if gap == 0.0:
        start_contact(-now.wall, time, found.rate, absorber_velocity, loss, now, observe.counters)
    else:
        now.wall = 0.0


@jit_inline
def switch(found, scene, reach, now, state, time, observe):
    """Set the regime that follows an event."""
    half = state.shape[0] // 2
    r, v = relative_motion(scene.contact, state)
    if found.kind == REVERSAL:
        now.sticks = True
        now.anchor = r - now.sign * reach
        now.side = now.sign
        now.at_rest = True
        now.stick_time = time
        return
    sign = 1.0 if found.kind == HIT_HIGH else -1.0
    if now.sticks:
        low, high = guard_bounds(scene.gap, reach, now)
        slip = now.anchor + sign * reach
        if slip == (high if sign > 0.0 else low):
            now.sticks = False
            now.sign = sign
            now.at_rest = sign * v <= 0.0
            push_phase(observe.events, now.stick_time, time, STUCK_INSIDE, 0)
            return
    touch(
        found,
        scene.gap,
        now,
        time,
        state[2 * half - 1],
        damper_loss(scene.wall_losses.damper > 0.0, observe.energy),
        scene.contact.mass,
        observe,
    )


@jit
def begin(springs, gap, limit, now, state, contact, counters):
    """Set the first regime at time 0: the slider starts without force, a wall that is already overlapped is in contact."""
    r, v = relative_motion(contact, state)
    if gap is not None:
        if abs(r) > gap or gap == 0.0:
            start_contact(1.0 if r >= 0.0 else -1.0, 0.0, v, state[-1], 0.0, now, counters)
            if r == 0.0:
                now.side = -1.0
    if limit is not None:
        now.sticks = True
        now.anchor = r
        now.stick_time = 0.0
    constant_force(springs, gap, limit, now)


@jit
def add_slider_loss(limit, r0, r1, now, energy):
    """Add limit times the distance slid."""
    if energy is None or limit is None:
        return
    if not now.sticks:
        energy.totals[0].friction_loss += limit * abs(r1 - r0)


@jit
def add_slider_energy(scene, limit, now, state, energy):
    """Add what the slider's spring holds: at the limit while it slides."""
    if energy is None or limit is None:
        return
    stretch = slider_reach(scene.springs, limit)
    if now.sticks:
        r, _ = relative_motion(scene.contact, state)
        stretch = r - now.anchor
    energy.totals[0].friction_loss += 0.5 * scene.springs.friction * stretch * stretch


@jit
def book_contact_loss(energy):
    """Count the loss in the walls' damper as one of impacts, at a lane's end."""
    if energy is None:
        return
    totals = energy.totals[0]
    totals.impact_loss += totals.absorber_damping
    totals.absorber_damping = 0.0


@jit
def slider_reach(springs, limit):
    """Return the slider's limit over its stiffness (m), 0 without a slider."""
    if limit is None:
        return 0.0
    return limit / springs.friction
