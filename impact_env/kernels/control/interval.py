"""Control intervals of a lane: the memory kept between them, orders, and reports.

A lane's interval is one segment of a schedule, so a chain of intervals is the run that a single
call with all segments would make.
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

# an order: duration (s), circular frequency at start and end (rad/s), force (N), its phase at the
# start (rad; becomes that at the end), half-clearance (m; becomes the one in use), friction limit
# (N), place in the record that acts beside (steps; becomes that at the end), whether to start
# afresh, whether the run ends here
ORDER = record_type(
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
# a report: tip's amplitude in phase with the force and a quarter behind it (m), absorber less tip
# at the end (m, m/s), impacts, absorber's share of the energy at the end, level so far (m), mean of
# q_tip^2 (m^2), sum of |q_tip/unit|^exponent over the samples, tip displacement at the end (m)
REPORT = record_type(
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
# half-clearance (m), friction limit (N) and force (N) in use, and the level that a search begins
# with
LAST_ORDER = record_type(gap=NUMBER, limit=NUMBER, force=NUMBER, search_level=NUMBER)
BREAKPOINT_TOL = 1e-9  # of a record's step: breakpoints closer than this are one
# by which a wall that is moved keeps off the absorber, relative to their distance from the middle
WALL_MARGIN = 1e-9


class Lanes(NamedTuple):
    """Memory of all lanes between two intervals, one row each.

    ``z`` (L, 2, J): free parts of the modal amplitudes; ``rigid`` and ``compliant`` (L,): contact
    states, of which a lane has one; ``last_order`` (L,): LAST_ORDER records; ``state`` (L, 2 N_m +
    2); ``ring`` (L, W + 1) and ``level`` (L,): ring and LEVEL_STATE records of the level.
    """

    z: Array
    rigid: NDArray[Any]
    compliant: NDArray[Any]
    last_order: NDArray[Any]
    state: Array
    ring: Array
    level: NDArray[Any]


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

    It is a periodic ``record`` (K,) in N or m/s^2, interpolated linearly between samples that are
    ``step`` (s) apart.

    ``channel`` (2,): of the force of the orders, and of the record: 0 of a force, 1 of the base's
    acceleration (m/s^2).
    """

    record: Array
    step: float
    channel: NDArray[np.int64]
    base: BaseParticipation


class LaneSettings(NamedTuple):
    """Settings that all lanes share.

    Sampling interval (s), samples of a whole interval, exponent of the damage (0: none), its unit
    of length (m), circular frequencies of the modes (N_m,), tip shape (N_m,), absorber mass (kg, 0
    without one), mode shape (N_m,) where level and amplitudes are read, and again in ``place`` if
    that is not the tip, else of size 0; ``disturbance``: None where one force is all.
    """

    sample_dt: float
    samples: int
    exponent: float
    unit: float
    omega: Array
    tip_shape: Array
    mass: float
    level_shape: Array
    place: Array
    disturbance: Disturbance | None


class Batch(NamedTuple):
    """Lanes under control with their orders, reports and status codes.

    ``orders`` and ``reports`` are ORDER and REPORT records (L,), the status codes have the shape
    (L,).
    """

    settings: LaneSettings
    lanes: Lanes
    orders: NDArray[Any]
    reports: NDArray[Any]
    status: NDArray[np.int64]


class IntervalScratch(NamedTuple):
    """Scratch memory of one thread.

    The interval's breakpoints in time (K,), frequencies and phases at its ends (2,), samples of
    the interval, a CLOCK and a COUNTS record, (1,) each. ``budget`` (1,): counters at zero, with
    the limits of an interval. ``no_values`` and ``no_numbers`` (0,): of the envelope, which lanes
    do not have.
    """

    times: Array
    omegas: Array
    phases: Array
    block: Array
    clock: NDArray[Any]
    counts: NDArray[Any]
    budget: NDArray[Any]
    no_values: Array
    no_numbers: NDArray[np.int64]


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
    """Write the sections of an interval and return their number.

    A section is given by breakpoints ``times`` and by pieces of the load: the force of the order,
    and the straight line between two samples of the disturbance's record.
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
def level_of_lane(scratch, settings, lanes, i):
    """Return the level observer of lane i."""
    return LevelObserver(
        lanes.ring[i],
        lanes.level[i],
        scratch.block,
        settings.place,
        EnvelopeObserver(scratch.no_values, scratch.no_values, scratch.no_numbers),
    )


@jit_view
def observers_of_lane(scratch, settings, lanes, i):
    """Return the observers of lane i: the level."""
    return Observers(
        clock=scratch.clock[0],
        counters=Counters(scratch.counts[0], None),
        level=level_of_lane(scratch, settings, lanes, i),
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
    """Return the highest frequency, whether an order is wrong, and whether a lane is idle.

    The frequency is in rad/s. An order is wrong if it is not ``read`` and differs from
    ``expected``.

    ``read`` and ``expected`` (3,): of gap, limit and place.
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
    """Prepare scratch memory and level for a lane's interval."""
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
        reset_level(level_of_lane(scratch, settings, lanes, i))


@jit
def report_samples(scratch, settings, order, report):
    """Report the amplitudes, mean square and damage of the interval's samples.

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
    """Report the state at the interval's end.

    It consists of the tip displacement, the relative motion and the absorber's share of the energy.
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
    """Report samples and level, and set the order's phase to that of the interval's end."""
    report_samples(scratch, settings, order, report)
    report.impact_count = scratch.counts[0].impacts
    if order.final:
        take_last_sample(state, settings.level_shape, order.duration, scratch.clock[0], level, None)
    report.level = compute_level(level)[0]
    turns = np.floor(scratch.phases[1] / (2.0 * np.pi))
    order.phase = scratch.phases[1] - 2.0 * np.pi * turns
    order.fresh = False


@jit
def with_gap(walls, gap):
    """Return walls at another half-clearance; what is no wall stays out of reach."""
    if not has_walls(walls):
        return walls
    return Walls(gap, walls.restitution, walls.yield_velocity)


@jit
def with_limit(limit, wanted):
    """Return another friction limit (N), or None where there is no friction."""
    if limit is None:
        return None
    return wanted


@jit
def limit_gap(wanted, gap, distance, touching):
    """Return the half-clearance nearest to ``wanted`` (m) that a cavity can take.

    The cavity has the half-clearance ``gap``. It must not close onto the absorber.
    """
    if wanted >= gap:
        return wanted
    if touching:
        return gap
    return min(gap, max(wanted, distance * (1.0 + WALL_MARGIN)))


@jit_allocating
def interpolate_log(share, low, high):
    """Return low (high/low)^share for an array of shares from 0 to 1.

    The result has the same last digit on every processor.
    """
    values = np.empty_like(share)
    for i in range(share.shape[0]):
        values[i] = low * (high / low) ** share[i]
    return values
