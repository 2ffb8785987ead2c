"""Control intervals of a lane: the memory kept between them, orders, and reports.

A lane's interval is one section of a schedule, or several under a recorded disturbance. A chain of
intervals is the run that a single call with all sections would make.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_view
from impact_env.kernels.compiling.records import FLAG, INTEGER, NUMBER, record_type
from impact_env.kernels.exact import compliant, rigid_contact
from impact_env.kernels.exact.rigid_contact import Walls, has_walls
from impact_env.kernels.motion.loads import (
    ALPHA,
    BEGINS,
    NUMBERS,
    OMEGA,
    PHASE,
    POLYNOMIAL,
    BaseParticipation,
    LoadPieces,
    new_load_workspace,
)
from impact_env.kernels.motion.observers import (
    CLOCK,
    COUNTS,
    DONE,
    EVALUATIONS_PER_EVENT,
    FIRST_EVENTS,
    LEVEL_STATE,
    Counters,
    EnvelopeObserver,
    LevelObserver,
    Observers,
    compute_level,
    reset_level,
)
from impact_env.kernels.motion.segments import count_samples_before, take_last_sample

Array = NDArray[np.float64]

# an order: what acts on a lane in the next interval
ORDER = record_type(
    duration=NUMBER,  # s
    omega_start=NUMBER,  # circular frequency of the force at the start (rad/s)
    omega_stop=NUMBER,  # and at the end (rad/s)
    force=NUMBER,  # force amplitude (N)
    phase=NUMBER,  # phase of the force at the start (rad); becomes that at the end
    gap=NUMBER,  # half-clearance (m); becomes the one in use
    limit=NUMBER,  # friction limit (N), unused without friction
    place=NUMBER,  # position in the disturbance's record (steps); becomes that at the end
    fresh=FLAG,  # whether a new run begins, from the lane's state; becomes False
    final=FLAG,  # whether its run ends here
)
# a report of an interval
REPORT = record_type(
    in_phase=NUMBER,  # tip's amplitude in phase with the force (m)
    quadrature=NUMBER,  # tip's amplitude a quarter period behind the force (m)
    distance=NUMBER,  # absorber less tip at the end (m)
    relative_velocity=NUMBER,  # absorber less tip at the end (m/s)
    impact_count=INTEGER,  # impacts in the interval
    absorber_share=NUMBER,  # absorber's share of the energy at the end
    level=NUMBER,  # response level so far (m)
    mean_square=NUMBER,  # mean of q_tip^2 (m^2)
    damage=NUMBER,  # sum of |q_tip/unit|^exponent over the samples
    tip=NUMBER,  # tip displacement at the end (m)
)
# values of a lane's last interval that the next one needs
LAST_ORDER = record_type(
    gap=NUMBER,  # half-clearance in use (m)
    limit=NUMBER,  # friction limit in use (N)
    force=NUMBER,  # force amplitude in use (N)
    search_level=NUMBER,  # level with which the next search begins
)
BREAKPOINT_TOL = 1e-9  # of a record's step: breakpoints closer than this are one
# distance of a moved wall from the absorber, relative to the absorber's distance from the middle
WALL_MARGIN = 1e-9


class Lanes(NamedTuple):
    """Memory of L lanes between two intervals."""

    z: Array  # (L, 2, J) modal amplitudes
    rigid: NDArray[Any]  # (L,) RIGID_CONTACT_STATE records, used with rigid contact
    compliant: NDArray[Any]  # (L,) COMPLIANT_CONTACT_STATE records, used with compliant contact
    last_order: NDArray[Any]  # (L,) LAST_ORDER records
    state: Array  # (L, 2 N_m + 2)
    ring: Array  # (L, W + 1) as `LevelObserver.ring`
    level: NDArray[Any]  # (L,) LEVEL_STATE records


def new_lanes(lanes: int, size: int, state: int, half_window: int) -> Lanes:
    """Return ``lanes`` lanes at rest.

    ``size`` is the number of modal amplitudes, ``state`` the number of entries of a state, and
    ``half_window`` the number of samples in half the level's window.
    """
    contacts = (
        np.zeros(lanes, rigid_contact.RIGID_CONTACT_STATE),
        np.zeros(lanes, compliant.COMPLIANT_CONTACT_STATE),
    )
    ring = np.zeros((lanes, half_window + 1))
    return Lanes(
        np.zeros((lanes, 2, size)),
        *contacts,
        np.zeros(lanes, LAST_ORDER),
        np.zeros((lanes, state)),
        ring,
        np.zeros(lanes, LEVEL_STATE),
    )


class Disturbance(NamedTuple):
    """A load that acts in addition to the lanes' own force.

    It is a periodic record, interpolated linearly between samples.
    """

    record: Array  # (K,) N or m/s^2
    step: float  # between two samples (s)
    channel: NDArray[np.int64]  # (2,) of the orders' force and of the record: 0 force, 1 base
    base: BaseParticipation  # for the acceleration of a base


class LaneSettings(NamedTuple):
    """Settings that all lanes share."""

    sample_dt: float  # sampling interval (s)
    samples: int  # number of samples in an interval of full length
    exponent: float  # of `REPORT.damage`; 0: not computed
    unit: float  # unit of the displacement in the damage (m)
    omega: Array  # (N_m,) circular frequencies of the modes (rad/s)
    tip_shape: Array  # (N_m,)
    mass: float  # of the absorber (kg), 0 without one
    level_shape: Array  # (N_m,) mode shape where level and amplitudes are read
    place: Array  # ``level_shape`` if it is not that of the tip, else of size 0
    disturbance: Disturbance | None  # None where one force is all


class Batch(NamedTuple):
    """L lanes under control."""

    settings: LaneSettings  # of all lanes
    lanes: Lanes  # their memory
    orders: NDArray[Any]  # (L,) ORDER records
    reports: NDArray[Any]  # (L,) REPORT records
    status: NDArray[np.int64]  # (L,) status codes


class IntervalScratch(NamedTuple):
    """Scratch memory of one thread."""

    times: Array  # (K,) breakpoints of the interval (s)
    omegas: Array  # (2,) frequencies at its ends (rad/s)
    phases: Array  # (2,) phases at its ends (rad)
    block: Array  # samples of the interval (m)
    clock: NDArray[Any]  # (1,) a CLOCK record
    counts: NDArray[Any]  # (1,) a COUNTS record
    budget: NDArray[Any]  # (1,) COUNTS record at zero, with the limits of an interval
    no_values: Array  # (0,) of the envelope, which lanes do not have
    no_numbers: NDArray[np.int64]  # (0,)


@jit_allocating
def new_interval_scratch(settings):
    """Return scratch memory for one thread."""
    budget = np.zeros(1, COUNTS)
    budget[0].most_events = FIRST_EVENTS
    budget[0].most_evaluations = FIRST_EVENTS * EVALUATIONS_PER_EVENT
    return IntervalScratch(
        np.zeros(1 + count_most_sections(settings)),
        np.zeros(2),
        np.zeros(2),
        np.zeros(settings.samples),
        np.zeros(1, CLOCK),
        np.zeros(1, COUNTS),
        budget,
        np.zeros(0),
        np.zeros(0, np.int64),
    )


@jit
def count_most_sections(settings):
    """Return the largest number of sections of an interval."""
    disturbance = settings.disturbance
    if disturbance is None:
        return 1
    return int(settings.samples * settings.sample_dt / disturbance.step) + 3


@jit_allocating
def new_interval_load(settings):
    """Return the load workspace of one thread, None where the load is one force."""
    disturbance = settings.disturbance
    if disturbance is None:
        return None
    most = count_most_sections(settings)
    pieces = np.zeros((1 + most, NUMBERS))
    which = np.zeros((most, 2), np.int64)
    return new_load_workspace(LoadPieces(pieces, which, disturbance.channel, disturbance.base))


@jit
def expand_interval_load(disturbance, order, times, load):
    """Write the sections of an interval to ``times`` and ``load``; return their number.

    ``order.place`` becomes the position in the record at the interval's end. A section is given by
    breakpoints ``times`` and by pieces of the load: the force of the order, and the straight line
    between two samples of the disturbance's record.
    """
    record = disturbance.record
    step = disturbance.step
    pieces = load.pieces
    duration = order.duration
    size = record.shape[0]
    place = order.place
    if abs(place - np.floor(place + 0.5)) < BREAKPOINT_TOL:
        place = np.floor(place + 0.5)
    first = int(np.floor(place))
    n = 0
    pieces[0, OMEGA] = order.omega_start
    pieces[0, ALPHA] = (order.omega_stop - order.omega_start) / duration
    pieces[0, PHASE] = order.phase
    pieces[0, POLYNOMIAL] = order.force
    end = 0.0
    while end < duration - BREAKPOINT_TOL * step:
        times[n], value = end, record[(first + n) % size]
        load.which[n, 0], load.which[n, 1] = 0, 1 + n
        pieces[1 + n, BEGINS], pieces[1 + n, POLYNOMIAL] = (first + n - place) * step, value
        pieces[1 + n, POLYNOMIAL + 2] = (record[(first + n + 1) % size] - value) / step
        n += 1
        end = (first + n - place) * step
    times[n] = duration
    order.place = (place + duration / step) % size
    return n


@jit_view
def view_level(scratch, settings, lanes, i):
    """Return the level observer of lane i."""
    return LevelObserver(
        lanes.ring[i],
        lanes.level[i],
        scratch.block,
        settings.place,
        EnvelopeObserver(scratch.no_values, scratch.no_values, scratch.no_numbers),
    )


@jit_view
def view_observers(scratch, settings, lanes, i):
    """Return the observers of lane i: the level."""
    return Observers(
        clock=scratch.clock[0],
        counters=Counters(scratch.counts[0], None),
        level=view_level(scratch, settings, lanes, i),
        events=None,
        series=None,
        energy=None,
    )


@jit
def is_order_valid(settings, order):
    """Return whether an interval fits the scratch memory.

    It must be longer than 0 and no longer than a whole interval, and its position in the record
    must be finite.
    """
    if not order.duration > 0.0 or not np.isfinite(order.place):
        return False
    return count_samples_before(order.duration, settings.sample_dt) <= settings.samples


@jit
def scan_orders(orders, idle, read, expected):
    """Return (highest frequency in rad/s, whether an order is wrong, whether a lane is idle).

    ``read`` (3,): whether the scene uses the orders' gap, limit and place. One that it does not use
    is wrong if it differs from its value in ``expected`` (3,). ``idle`` (L,): flags of the lanes.
    """
    highest = 0.0
    differs = False
    rests = False
    for i in range(orders.shape[0]):
        order = orders[i]
        if order.omega_start > highest:
            highest = order.omega_start
        if order.omega_stop > highest:
            highest = order.omega_stop
        if not read[0] and order.gap != expected[0]:
            differs = True
        if not read[1] and order.limit != expected[1]:
            differs = True
        if not read[2] and order.place != expected[2]:
            differs = True
        if idle[i]:
            rests = True
    return highest, differs, rests


@jit
def find_failed_lane(status):
    """Return the number of the first lane whose status is not DONE, -1 if there is none."""
    for i in range(status.shape[0]):
        if status[i] != DONE:
            return i
    return -1


@jit
def open_interval(scratch, settings, lanes, i, order):
    """Write lane i's interval to the scratch memory; reset the level of a new run."""
    clock = scratch.clock[0]
    scratch.times[1] = order.duration
    scratch.omegas[0] = order.omega_start
    scratch.omegas[1] = order.omega_stop
    scratch.phases[0] = order.phase
    scratch.phases[1] = order.phase + 0.5 * (order.omega_start + order.omega_stop) * order.duration
    clock.level = 0
    clock.interval = settings.sample_dt
    clock.series = 0
    clock.first = 0
    scratch.counts[0] = scratch.budget[0]
    if order.fresh:
        reset_level(view_level(scratch, settings, lanes, i))


@jit
def report_samples(scratch, settings, order, report):
    """Write amplitudes, mean square and damage of the interval's samples to ``report``.

    The amplitudes are found by projection on the force's phase.
    """
    count = scratch.clock[0].level
    step = settings.sample_dt
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
        q = scratch.block[k]
        along += q * c
        behind += q * s
        square += q * q
        c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
        turn_c, turn_s = (
            turn_c * change_c - turn_s * change_s,
            turn_c * change_s + turn_s * change_c,
        )
    if settings.exponent > 0.0:
        for k in range(count):
            damage += (abs(scratch.block[k]) / settings.unit) ** settings.exponent
    share = 1.0 / max(count, 1)
    report.in_phase = 2.0 * along * share
    report.quadrature = 2.0 * behind * share
    report.mean_square = square * share
    report.damage = damage


@jit
def report_state(settings, state, relative, relative_velocity, report):
    """Write tip displacement, relative motion and the absorber's energy share to ``report``.

    ``state`` is that at the interval's end; ``relative`` (m) and ``relative_velocity`` (m/s):
    absorber less tip.
    """
    modes = settings.omega.shape[0]
    energy = 0.0
    tip = 0.0
    for i in range(modes):
        tip += settings.tip_shape[i] * state[i]
        omega_q = settings.omega[i] * state[i]
        rate = state[modes + 1 + i]
        energy += omega_q * omega_q + rate * rate
    absorber = settings.mass * (state[2 * modes + 1] * state[2 * modes + 1])
    report.distance = relative
    report.relative_velocity = relative_velocity
    report.tip = tip
    report.absorber_share = absorber / (absorber + energy) if absorber > 0.0 else 0.0


@jit
def close_interval(scratch, settings, level, state, order, report):
    """Report samples, impacts and level; set the order's phase to that of the end.

    ``order.fresh`` becomes False.
    """
    report_samples(scratch, settings, order, report)
    report.impact_count = scratch.counts[0].impacts
    if order.final:
        take_last_sample(state, settings.level_shape, order.duration, scratch.clock[0], level, None)
    report.level = compute_level(level)[0]
    turns = np.floor(scratch.phases[1] / (2.0 * np.pi))
    order.phase = scratch.phases[1] - 2.0 * np.pi * turns
    order.fresh = False


@jit
def replace_gap(walls, gap):
    """Return `Walls` with the half-clearance ``gap`` (m), or ``walls`` itself if there are none."""
    if not has_walls(walls):
        return walls
    return Walls(gap, walls.restitution, walls.yield_velocity)


@jit
def replace_limit(limit, ordered):
    """Return the friction limit of an order (N), or None in a scene without friction."""
    if limit is None:
        return None
    return ordered


@jit
def limit_gap(ordered, gap, distance, touching):
    """Return the half-clearance nearest to the ``ordered`` one (m) that a cavity can take.

    The cavity has the half-clearance ``gap``. It must not close onto the absorber, which is at
    ``distance`` (m) from its middle, ``touching`` a wall or not.
    """
    if ordered >= gap:
        return ordered
    if touching:
        return gap
    return min(gap, max(ordered, distance * (1.0 + WALL_MARGIN)))


@jit_allocating
def interpolate_log(share, low, high):
    """Return low (high/low)^share for an array of shares from 0 to 1.

    The result has the same last digit on every processor.
    """
    values = np.empty_like(share)
    for i in range(share.shape[0]):
        values[i] = low * (high / low) ** share[i]
    return values
