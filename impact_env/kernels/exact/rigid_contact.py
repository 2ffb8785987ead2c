"""One rigid contact between an absorber and the beam: what is known of it between two events, and the laws that it follows.

An impact whose remaining bounces, all together, stay below the rounding of the position is completed at once (complete chatter): the remaining
relative velocity is taken out by a plastic impulse.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room
from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, record
from impact_env.kernels.events.signals import (
    EPSILON,
    HIT_HIGH,
    NOISE,
    Signal,
    at_offset,
    signal_scale,
    value_at_offset,
)
from impact_env.kernels.motion.observers import (
    HELD_LOWER,
    HELD_UPPER,
    STUCK_INSIDE,
    push_impact,
    push_phase,
)
from impact_env.kernels.motion.segments import Work
from impact_env.kernels.motion.slots import GUARD, RELATIVE, REST, SPEED, add, weigh

FREE = 0
JOINED = 1
# of the sizes of a joint force's terms: a hundred times what the change to the joined modes' basis may be off (`regimes.SOUND`), so that an absorber
# that a bound just holds is not released by rounding; one is held beyond its bound by no more than that share
JOINT_FORCE_TOL = 1e-9
SLOWEST_DECAY = 0.1  # 1 - e counts as at least this where a chatter is completed
ROUNDING = 16.0 * NOISE  # of a signal: above what the search takes for zero distance

# a contact between two events: regime, time from the window's centre, absorber displacement, velocity, acceleration, constant relative force, sign of
# the relative velocity, wall touched (-1, 0, 1), whether the relative velocity is zero, joined offset absorber - tip, start of phase, largest
# relative acceleration by a unit impulse, number of the absorber
NOW = record(
    regime=INTEGER,
    tau=NUMBER,
    q=NUMBER,
    v=NUMBER,
    a=NUMBER,
    force=NUMBER,
    sign=NUMBER,
    side=NUMBER,
    at_rest=FLAG,
    offset=NUMBER,
    since=NUMBER,
    kick=NUMBER,
    which=INTEGER,
)


class Walls(NamedTuple):
    """Clearance to either wall in m, Newton's coefficient of restitution, and the velocity (m/s) above which it falls; None where it does not."""

    gap: float
    restitution: float
    yield_velocity: float | None


class Contact(NamedTuple):
    """Absorber mass (kg), G = 1/m_a + sum tip_shape^2 (1/kg), tip shape (N_m,); walls, and limit of sliding friction (N), None where absent.

    ``static_ratio``: the friction limit of an absorber that sticks over that of one that slides, 1 or above.

    ``gravity`` (m/s^2): weight of the absorber over its mass, towards the lower wall; None: across its motion.
    """

    mass: float
    compliance: float
    tip_shape: NDArray[np.float64]
    walls: Walls | None
    limit: float | None
    gravity: float | None
    static_ratio: float


class Body(NamedTuple):
    """One absorber in motion: its contact, a NOW record, the slots it moves with, and its guard signal."""

    now: Any
    work: Work
    signal: Signal


@jit_room
def new_now(n):
    """Return the contacts (n,) of absorbers that are free and at rest."""
    return np.zeros(n, NOW)


@jit
def fall(contact, now):
    """Set the acceleration of a free absorber: friction, and its weight."""
    now.a = now.force / contact.mass
    if contact.gravity is not None:
        now.a -= contact.gravity


@jit
def weight_held(gravity):
    """Return a joined regime's constant force, as the acceleration of the absorber's weight (`regimes.with_weight`)."""
    if gravity is None:
        return 0.0
    return gravity


@jit
def friction_force(limit, now):
    """Set the constant relative force and the absorber's acceleration from the sign of sliding."""
    if limit is not None:
        now.force = -now.sign * limit


@jit
def add_friction_loss(limit, slots, forced, omega, body, tau, offset, energy):
    """Add friction limit times the distance slid."""
    if energy is None or limit is None:
        return
    start = value_at_offset(slots, forced.signals, omega, body.signal, tau, 0.0)
    end = value_at_offset(slots, forced.signals, omega, body.signal, tau, offset)
    energy.totals[0].friction_loss += limit * abs(end - start)


@jit
def slide_on(slots, limit, sign, now, z):
    """Let the friction force follow a new sign of sliding, and with it the free part z of the slots."""
    if limit is None:
        return
    old = now.force
    now.sign = sign
    friction_force(limit, now)
    add(slots.rows, REST, old - now.force, z)


@jit
def turn(slots, contact, limit, body, found):
    """The relative velocity is zero: slide on the other way if static friction cannot hold, and return False; else return True."""
    if limit is None:
        return False
    # the constant force F alone bends the relative displacement by F G
    needed = body.now.force - found.bend / contact.compliance
    if abs(needed) <= limit * contact.static_ratio:
        return True
    body.now.at_rest = True
    slide_on(slots, limit, -1.0 if needed > 0.0 else 1.0, body.now, body.work.z)
    return False


@jit
def static_limit(contact):
    """Return the friction limit (N) of an absorber that sticks, None without friction."""
    if contact.limit is None:
        return None
    return contact.limit * contact.static_ratio


@jit
def joint_bounds(limit, side):
    """Return the interval of the joint force on the absorber: friction up to its static limit (N), and what the wall touched can push."""
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
def end_phase(events, now, time):
    """Note a joined phase that ends."""
    kind = STUCK_INSIDE if now.side == 0.0 else (HELD_UPPER if now.side > 0.0 else HELD_LOWER)
    push_phase(events, now.since, time, kind, now.which)


@jit
def tip_motion(contact, state):
    """Return displacement and velocity of the tip."""
    half = state.shape[0] // 2
    q = 0.0
    v = 0.0
    for i in range(contact.tip_shape.shape[0]):
        q += contact.tip_shape[i] * state[i]
        v += contact.tip_shape[i] * state[half + i]
    return q, v


@jit_inline
def stay_at_wall(walls, now, q_tip):
    """Note the wall that an absorber touches within rounding, as after a plastic impact, whose flight is one of no length."""
    if walls is not None:
        if walls.gap < np.inf and abs(now.q - q_tip) >= walls.gap - 4.0 * EPSILON * (
            walls.gap + abs(now.q) + abs(q_tip)
        ):
            now.side = 1.0 if now.q > q_tip else -1.0


@jit
def touch(contact, walls, now, state):
    """Find the wall that an absorber touches and the sign in which it slides; return its relative velocity."""
    q_tip, v_tip = tip_motion(contact, state)
    relative = now.v - v_tip
    stay_at_wall(walls, now, q_tip)
    now.sign = 1.0 if relative > 0.0 else -1.0
    return relative


@jit
def add_impact_loss(loss, energy):
    """Add what an impact has dissipated."""
    if energy is not None:
        energy.totals[0].impact_loss += loss


@jit_inline
def restitution_at(walls, v):
    """Return the coefficient of restitution of an impact with a relative velocity (m/s): `parameters.YieldingWalls`."""
    if walls.yield_velocity is None:
        return walls.restitution
    return walls.restitution / np.sqrt(np.sqrt(1.0 + abs(v) / walls.yield_velocity))


@jit_inline
def impact(slots, forced, window, walls, contact, body, found, observe):
    """Apply Newton's impact law; return True if the remaining chatter is below rounding and was completed by a plastic impulse."""
    if walls is None:
        return False
    now = body.now
    z = body.work.z
    v = found.rate
    side = 1.0 if found.kind == HIT_HIGH else -1.0
    now.q -= found.value - side * walls.gap  # rounding must not add up to a penetration
    e = restitution_at(walls, v)
    impulse = -(1.0 + e) * v / contact.compliance
    loss = 0.5 * (1.0 - e * e) * v * v / contact.compliance
    after = -e * v
    add(slots.rows, RELATIVE, impulse, z)
    now.v += impulse / contact.mass
    now.side = side
    observe.counters.counts.impacts += 1
    largest = abs(found.bend) + abs(impulse) * now.kick + 2.0 * abs(now.force) * contact.compliance
    complete = chatter_is_complete(slots, forced, window, walls, body, side, after, largest)
    if complete:
        rest = -after / contact.compliance
        add(slots.rows, RELATIVE, rest, z)
        now.v += rest / contact.mass
        impulse += rest
        loss += 0.5 * after * after / contact.compliance
    push_impact(observe.events, window.centre + now.tau, v, impulse, loss, now.which)
    add_impact_loss(loss, observe.energy)
    slide_on(slots, contact.limit, -side, now, z)
    return complete


@jit
def largest_kick(rows):
    """Return a bound of the relative acceleration that a unit impulse between beam and absorber leaves."""
    kick = 0.0
    for j in range(rows.shape[1]):
        gain = np.hypot(rows[GUARD, j], rows[GUARD + 1, j]) * np.hypot(
            rows[RELATIVE, j], rows[RELATIVE + 1, j]
        )
        kick += gain * (rows[SPEED, j] * rows[SPEED, j])
    return kick


@jit
def chatter_is_complete(slots, forced, window, walls, body, side, after, largest):
    """Return whether all bounces to come, of heights summed to v^2/(2 a (1 - e)), stay below the rounding of the position.

    ``largest`` bounds the relative acceleration after the impact.
    """
    signal = body.signal
    height = (
        ROUNDING * signal_scale(signal, forced.bound) * max(1.0 - walls.restitution, SLOWEST_DECAY)
    )
    if after * after > 2.0 * largest * height + 1e-300:
        return False
    weigh(slots.rows, GUARD, body.work.z, signal.u)
    _, _, a = at_offset(slots, forced.signals, window.omega, signal, body.now.tau, 0.0)
    return side * a >= 0.0 and after * after <= 2.0 * abs(a) * height + 1e-300
