"""What a controlled run keeps from one control interval to the next, what it is told, and what it reports.

A lane's interval is one stretch of a schedule, so a chain of intervals is the run that a single call with all stretches would make.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_room, jit_view
from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, record
from impact_env.kernels.exact import rigid_contact, springs
from impact_env.kernels.exact.budget import EVALUATIONS_PER_EVENT, FIRST_EVENTS
from impact_env.kernels.exact.rigid_contact import Walls
from impact_env.kernels.motion.level import LEVEL, Envelope, Level, clear_level, close_level
from impact_env.kernels.motion.loads import (
    ALPHA,
    BEGINS,
    NUMBERS,
    OMEGA,
    PHASE,
    POLYNOMIAL,
    BaseShare,
    LoadPieces,
    new_load,
)
from impact_env.kernels.motion.observers import CLOCK, COUNTS, Counters, Observe
from impact_env.kernels.motion.segments import last_sample, samples_before

Array = NDArray[np.float64]

# an order: duration (s), circular frequency at start and end (rad/s), force (N), its phase at the start (rad; becomes that at the end),
# half-clearance (m; becomes the one in use), friction limit (N), place in the record that acts beside (steps; becomes that at the end), whether to
# start afresh, whether the run ends here
ORDER = record(
    duration=NUMBER,
    omega_start=NUMBER,
    omega_stop=NUMBER,
    force=NUMBER,
    phase=NUMBER,
    gap=NUMBER,
    limit=NUMBER,
    place=NUMBER,
    fresh=FLAG,
    final=FLAG,
)
# a report: tip's amplitude in phase with the force and a quarter behind it (m), absorber less tip at the end (m, m/s), impacts, absorber's share of
# the energy at the end, level so far (m), mean of q_tip^2 (m^2), sum of |q_tip/unit|^exponent over the samples, tip displacement at the end (m)
REPORT = record(
    in_phase=NUMBER,
    quadrature=NUMBER,
    distance=NUMBER,
    relative_velocity=NUMBER,
    impact_count=INTEGER,
    absorber_share=NUMBER,
    level=NUMBER,
    mean_square=NUMBER,
    damage=NUMBER,
    tip=NUMBER,
)
# half-clearance (m), friction limit (N) and force (N) in use, and the level that a search begins with
KEPT = record(gap=NUMBER, limit=NUMBER, force=NUMBER, search_level=NUMBER)
SAME_PLACE = 1e-9  # of a record's step: breakpoints closer than this are one
MARGIN = 1e-9  # by which a wall that is moved keeps off the absorber, relative to their distance from the middle


class Lanes(NamedTuple):
    """What lanes carry from interval to interval, one row each: free parts of the slots (L, 2, J), records of a rigid and of a compliant contact
    (L,), whatever the lane has, KEPT records (L,), state (L, 2 N_m + 2), and the level's ring (L, W + 1) and LEVEL records (L,).
    """  # noqa: D205

    z: Array
    rigid: NDArray[Any]
    sprung: NDArray[Any]
    kept: NDArray[Any]
    state: Array
    ring: Array
    level: NDArray[Any]


def new_lanes(lanes: int, slots: int, state: int, half_window: int) -> Lanes:
    """Return lanes at rest with this many slots and places of a state; ``half_window``: samples in half the level's window."""
    contacts = np.zeros(lanes, rigid_contact.NOW), np.zeros(lanes, springs.NOW)
    ring = np.zeros((lanes, half_window + 1))
    return Lanes(
        np.zeros((lanes, 2, slots)),
        *contacts,
        np.zeros(lanes, KEPT),
        np.zeros((lanes, state)),
        ring,
        np.zeros(lanes, LEVEL),
    )


class Beside(NamedTuple):
    """What acts beside the lanes' own force: a ``record`` (K,) in N or m/s^2, straight between its ``step`` (s), that repeats.

    ``moves_base`` (2,): whether the force of the orders, and the record, are the base's acceleration (m/s^2); ``base`` None if neither is.
    """

    record: Array
    step: float
    moves_base: NDArray[np.bool_]
    base: BaseShare | None


class Watch(NamedTuple):
    """What all lanes share: sampling interval (s), samples of a whole interval, exponent of the damage (0: none), its unit of length (m),
    circular frequencies of the modes (N_m,), tip shape (N_m,), absorber mass (kg, 0 without one), mode shape (N_m,) where level and amplitudes are
    read, and again in ``place`` if that is not the tip, else of size 0; what acts beside one force, None where that is all.
    """  # noqa: D205

    sample_dt: float
    samples: int
    exponent: float
    unit: float
    omega: Array
    tip_shape: Array
    mass: float
    level_shape: Array
    place: Array
    beside: Beside | None


class Batch(NamedTuple):
    """Lanes under control, what is ordered and reported, ORDER and REPORT records (L,), and their status codes (L,)."""

    watch: Watch
    lanes: Lanes
    orders: NDArray[Any]
    reports: NDArray[Any]
    status: NDArray[np.int64]


class Desk(NamedTuple):
    """Scratch of one thread: the interval's breakpoints in time (K,), frequencies and phases at its ends (2,), samples of the interval, a CLOCK and a
    COUNTS record, (1,) each.

    ``budget`` (1,): counters at zero, with what an interval may use. ``none`` and ``nobody`` (0,): of the envelope, which lanes do not have.
    """  # noqa: D205

    times: Array
    omegas: Array
    phases: Array
    block: Array
    clock: NDArray[Any]
    counts: NDArray[Any]
    budget: NDArray[Any]
    none: Array
    nobody: NDArray[np.int64]


@jit_room
def new_desk(watch):
    """Return scratch for one thread."""
    budget = np.zeros(1, COUNTS)
    budget[0].most_events = FIRST_EVENTS
    budget[0].most_evaluations = FIRST_EVENTS * EVALUATIONS_PER_EVENT
    return Desk(
        np.zeros(1 + most_stretches(watch)),
        np.zeros(2),
        np.zeros(2),
        np.zeros(watch.samples),
        np.zeros(1, CLOCK),
        np.zeros(1, COUNTS),
        budget,
        np.zeros(0),
        np.zeros(0, np.int64),
    )


@jit
def most_stretches(watch):
    """Return how many stretches an interval has at most."""
    beside = watch.beside
    if beside is None:
        return 1
    return int(watch.samples * watch.sample_dt / beside.step) + 3


@jit_room
def new_interval_load(watch):
    """Return room of one thread for what acts in an interval, None where that is one force."""
    beside = watch.beside
    if beside is None:
        return None
    most = most_stretches(watch)
    pieces = np.zeros((1 + most, NUMBERS))
    which = np.zeros((most, 2), np.int64)
    return new_load(LoadPieces(pieces, which, beside.moves_base, beside.base))


@jit
def lay_load(beside, order, times, load):
    """Lay out what acts in an interval, to whose ends ``times`` are set, and turn the record; return how many stretches it has."""
    if beside is None:
        return 1
    return _lay_record(beside, order, times, load)


@jit
def _lay_record(beside, order, times, load):
    record = beside.record
    step = beside.step
    pieces = load.pieces
    duration = order.duration
    size = record.shape[0]
    place = order.place
    if abs(place - np.floor(place + 0.5)) < SAME_PLACE:
        place = np.floor(place + 0.5)
    first = int(np.floor(place))
    n = 0
    pieces[0, OMEGA], pieces[0, ALPHA] = (
        order.omega_start,
        (order.omega_stop - order.omega_start) / duration,
    )
    pieces[0, PHASE], pieces[0, POLYNOMIAL] = order.phase, order.force
    end = 0.0
    while end < duration - SAME_PLACE * step:
        times[n], now = end, record[(first + n) % size]
        load.which[n, 0], load.which[n, 1] = 0, 1 + n
        pieces[1 + n, BEGINS], pieces[1 + n, POLYNOMIAL] = (first + n - place) * step, now
        pieces[1 + n, POLYNOMIAL + 2] = (record[(first + n + 1) % size] - now) / step
        n += 1
        end = (first + n - place) * step
    times[n] = duration
    order.place = (place + duration / step) % size
    return n


@jit_view
def lane_level(desk, watch, lanes, i):
    """Return the level of lane i."""
    return Level(
        lanes.ring[i],
        lanes.level[i],
        desk.block,
        watch.place,
        Envelope(desk.none, desk.none, desk.nobody),
    )


@jit_view
def observe_lane(desk, watch, lanes, i):
    """Return the observers of lane i, of which there is the level."""
    return Observe(
        clock=desk.clock[0],
        counters=Counters(desk.counts[0], None),
        level=lane_level(desk, watch, lanes, i),
        events=None,
        series=None,
        energy=None,
    )


@jit
def can_do(watch, order):
    """Return whether an interval fits the scratch memory: above 0 and no longer than the samples of a whole one, from a place in the record."""
    if not order.duration > 0.0 or not np.isfinite(order.place):
        return False
    return samples_before(order.duration, watch.sample_dt) <= watch.samples


@jit
def open_interval(desk, watch, lanes, i, order):
    """Lay out a lane's interval."""
    clock = desk.clock[0]
    desk.times[1] = order.duration
    desk.omegas[0], desk.omegas[1] = order.omega_start, order.omega_stop
    desk.phases[0] = order.phase
    desk.phases[1] = order.phase + 0.5 * (order.omega_start + order.omega_stop) * order.duration
    clock.level = 0
    clock.interval = watch.sample_dt
    clock.series = 0
    clock.first = 0
    desk.counts[0] = desk.budget[0]
    if order.fresh:
        clear_level(lane_level(desk, watch, lanes, i))


@jit
def report_samples(desk, watch, order, report):
    """Report what the interval's samples say: the amplitudes by projection on the force's phase, mean square, damage."""
    count = desk.clock[0].level
    step = watch.sample_dt
    change = (order.omega_stop - order.omega_start) / order.duration * step * step
    turn = order.omega_start * step + 0.5 * change
    c = math.cos(order.phase)
    s = math.sin(order.phase)
    turn_c = math.cos(turn)
    turn_s = math.sin(turn)
    change_c = math.cos(change)
    change_s = math.sin(change)
    along = 0.0
    behind = 0.0
    square = 0.0
    damage = 0.0
    for k in range(count):
        q = desk.block[k]
        along += q * c
        behind += q * s
        square += q * q
        c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
        turn_c, turn_s = (
            turn_c * change_c - turn_s * change_s,
            turn_c * change_s + turn_s * change_c,
        )
    if watch.exponent > 0.0:
        for k in range(count):
            damage += (abs(desk.block[k]) / watch.unit) ** watch.exponent
    share = 1.0 / max(count, 1)
    report.in_phase = 2.0 * along * share
    report.quadrature = 2.0 * behind * share
    report.mean_square = square * share
    report.damage = damage


@jit
def report_state(watch, state, relative, relative_velocity, report):
    """Report what the state at the interval's end says."""
    modes = watch.omega.shape[0]
    energy = 0.0
    tip = 0.0
    for i in range(modes):
        tip += watch.tip_shape[i] * state[i]
        omega_q = watch.omega[i] * state[i]
        rate = state[modes + 1 + i]
        energy += omega_q * omega_q + rate * rate
    absorber = watch.mass * (state[2 * modes + 1] * state[2 * modes + 1])
    report.distance = relative
    report.relative_velocity = relative_velocity
    report.tip = tip
    report.absorber_share = absorber / (absorber + energy) if absorber > 0.0 else 0.0


@jit
def close_interval(desk, watch, level, state, order, report):
    """Report samples and level, and set the order's phase to that of the interval's end."""
    report_samples(desk, watch, order, report)
    report.impact_count = desk.counts[0].impacts
    if order.final:
        last_sample(state, watch.level_shape, order.duration, desk.clock[0], level, None)
    report.level = close_level(level)[0]
    turns = np.floor(desk.phases[1] / (2.0 * np.pi))
    order.phase = desk.phases[1] - 2.0 * np.pi * turns
    order.fresh = False


@jit
def with_gap(walls, gap):
    """Return walls at another half-clearance, or None."""
    if walls is None:
        return None
    return Walls(gap, walls.restitution, walls.yield_velocity)


@jit
def with_limit(limit, wanted):
    """Return another friction limit (N), or None where there is no friction."""
    if limit is None:
        return None
    return wanted


@jit
def possible_gap(wanted, gap, distance, touching):
    """Return the half-clearance nearest to ``wanted`` that a cavity of half-clearance ``gap`` can take without closing onto the absorber."""
    if wanted >= gap:
        return wanted
    if touching:
        return gap
    return min(gap, max(wanted, distance * (1.0 + MARGIN)))


@jit_room
def spread(share, low, high):
    """Return low (high/low)^share for an array of shares from 0 to 1; here, because a vectorised power may differ in its last digit."""
    values = np.empty_like(share)
    for i in range(share.shape[0]):
        values[i] = low * (high / low) ** share[i]
    return values
