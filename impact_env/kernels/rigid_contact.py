"""One rigid contact between an absorber and the beam: what is known of it between two events, and the laws that it follows.

An impact whose remaining bounces, all together, stay below the rounding of the position is completed at once (complete chatter): the remaining
relative velocity is taken out by a plastic impulse.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.jit import jit
from impact_env.kernels.observers import FRICTION_LOSS, HELD_LOWER, HELD_UPPER, IMPACT_LOSS, IMPACTS, STUCK_INSIDE, push_impact, push_phase
from impact_env.kernels.signals import EPSILON, NOISE, at_offset, signal_scale
from impact_env.kernels.slots import GUARD, RELATIVE, REST, SPEED, add, weigh

FREE, JOINED = 0, 1
JOINT_SLACK = 1e-9  # of the joint force's scale: above the rounding of the change of basis
SLOWEST_DECAY = 0.1  # 1 - e counts as at least this where a chatter is completed
ROUNDING = 16.0 * NOISE  # of a signal: above what the search takes for zero distance

# rows of a contact's `now`: regime, time from the window's centre, absorber displacement, velocity, acceleration, constant relative
# force, sign of the relative velocity, wall touched (-1, 0, 1), relative velocity is zero (0, 1), joined offset absorber - tip, start of phase,
# largest relative acceleration by a unit impulse, number of the absorber
REGIME, TAU, Q, V, A, FORCE, SIGN, SIDE, AT_REST, OFFSET, SINCE, KICK, WHICH = range(13)
NOW = 13


class Contact(NamedTuple):
    """Absorber mass (kg), G = 1/m_a + sum tip_shape^2 (1/kg), tip shape (N_m,)."""

    mass: float
    compliance: float
    tip_shape: NDArray[np.float64]


@jit
def friction_force(limit, now):  # type: ignore[no-untyped-def]
    """Set the constant relative force and the absorber's acceleration from the sign of sliding."""
    if limit is not None:
        now[FORCE] = -now[SIGN] * limit


@jit
def add_friction_loss(limit, slots, forced, omega, signal, tau, offset, energy):  # type: ignore[no-untyped-def]
    """Add friction limit times the distance slid."""
    if energy is None or limit is None:
        return
    start, _, _ = at_offset(slots, forced.signals, omega, signal, tau, 0.0)
    end, _, _ = at_offset(slots, forced.signals, omega, signal, tau, offset)
    energy.totals[FRICTION_LOSS] += limit * abs(end - start)


@jit
def turn(free, contact, limit, now, work, found):  # type: ignore[no-untyped-def]
    """The relative velocity is zero: slide on the other way if friction cannot hold, and return False; else return True."""
    if limit is None:
        return False
    # the constant force F alone bends the relative displacement by F G
    needed = now[FORCE] - found.bend / contact.compliance
    if abs(needed) <= limit:
        return True
    old = now[FORCE]
    now[SIGN], now[AT_REST] = -1.0 if needed > 0.0 else 1.0, 1.0
    friction_force(limit, now)
    add(free.slots.rows, REST, old - now[FORCE], work.z)
    return False


@jit
def joint_bounds(limit, side):  # type: ignore[no-untyped-def]
    """Return the interval of the joint force on the absorber: friction, and what the wall touched can push."""
    low, high = 0.0, 0.0
    if limit is not None:
        low, high = -limit, limit
    if side > 0.0:
        low = -np.inf
    if side < 0.0:
        high = np.inf
    return low, high


@jit
def end_phase(events, now, time):  # type: ignore[no-untyped-def]
    """Note a joined phase that ends."""
    kind = STUCK_INSIDE if now[SIDE] == 0.0 else (HELD_UPPER if now[SIDE] > 0.0 else HELD_LOWER)
    push_phase(events, now[SINCE], time, kind, now[WHICH])


@jit
def tip_motion(contact, state):  # type: ignore[no-untyped-def]
    """Return displacement and velocity of the tip."""
    half = state.shape[0] // 2
    q, v = 0.0, 0.0
    for i in range(contact.tip_shape.shape[0]):
        q += contact.tip_shape[i] * state[i]
        v += contact.tip_shape[i] * state[half + i]
    return q, v


@jit
def touch(contact, walls, now, state):  # type: ignore[no-untyped-def]
    """Find the wall that an absorber touches and the sign in which it slides; return its relative velocity."""
    q_tip, v_tip = tip_motion(contact, state)
    relative = now[V] - v_tip
    if walls is not None:
        if abs(now[Q] - q_tip) >= walls.gap * (1.0 - 4.0 * EPSILON):
            now[SIDE] = 1.0 if now[Q] > q_tip else -1.0
    now[SIGN] = 1.0 if relative > 0.0 else -1.0
    return relative


@jit
def impact(free, forced, window, contact, walls, limit, now, work, signal, side, found, counters, events, energy):  # type: ignore[no-untyped-def]
    """Apply Newton's impact law; return True if the remaining chatter is below rounding and was completed by a plastic impulse."""
    if walls is None:
        return False
    v = found.rate
    now[Q] -= found.value - side * walls.gap  # rounding must not add up to a penetration
    impulse = -(1.0 + walls.restitution) * v / contact.compliance
    loss = 0.5 * (1.0 - walls.restitution**2) * v * v / contact.compliance
    after = -walls.restitution * v
    add(free.slots.rows, RELATIVE, impulse, work.z)
    now[V] += impulse / contact.mass
    now[SIDE] = side
    counters.values[IMPACTS] += 1.0
    largest = abs(found.bend) + abs(impulse) * now[KICK] + 2.0 * abs(now[FORCE]) * contact.compliance
    complete = chatter_is_complete(free, forced, window, walls, now, work, signal, side, after, largest)
    if complete:
        rest = -after / contact.compliance
        add(free.slots.rows, RELATIVE, rest, work.z)
        now[V] += rest / contact.mass
        impulse += rest
        loss += 0.5 * after * after / contact.compliance
    push_impact(events, window.centre + now[TAU], v, impulse, loss, now[WHICH])
    if energy is not None:
        energy.totals[IMPACT_LOSS] += loss
    if limit is not None:
        old = now[FORCE]
        now[SIGN] = -side
        friction_force(limit, now)
        add(free.slots.rows, REST, old - now[FORCE], work.z)
    return complete


@jit
def largest_kick(rows):  # type: ignore[no-untyped-def]
    """Return a bound of the relative acceleration that a unit impulse between beam and absorber leaves."""
    kick = 0.0
    for j in range(rows.shape[1]):
        gain = np.hypot(rows[GUARD, j], rows[GUARD + 1, j]) * np.hypot(rows[RELATIVE, j], rows[RELATIVE + 1, j])
        kick += gain * rows[SPEED, j] ** 2
    return kick


@jit
def chatter_is_complete(free, forced, window, walls, now, work, signal, side, after, largest):  # type: ignore[no-untyped-def]
    """Return whether all bounces to come, of heights summed to v^2/(2 a (1 - e)), stay below the rounding of the position.

    ``largest`` bounds the relative acceleration after the impact.
    """
    height = ROUNDING * signal_scale(signal, forced.bound) * max(1.0 - walls.restitution, SLOWEST_DECAY)
    if after * after > 2.0 * largest * height + 1e-300:
        return False
    weigh(free.slots.rows, GUARD, work.z, signal.u)
    _, _, a = at_offset(free.slots, forced.signals, window.omega, signal, now[TAU], 0.0)
    return side * a >= 0.0 and after * after <= 2.0 * abs(a) * height + 1e-300
