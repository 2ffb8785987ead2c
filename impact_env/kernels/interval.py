"""What a controlled run keeps from one control interval to the next, what it is told, and what it reports.

A lane's interval is one stretch of a schedule, so a chain of intervals is the run that a single call with all stretches would make.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.budget import EVALUATIONS_PER_EVENT, FIRST_EVENTS
from impact_env.kernels.contact_law import Walls
from impact_env.kernels.jit import jit, jit_room
from impact_env.kernels.observers import COUNTS, IMPACTS, MOST_EVALUATIONS, MOST_EVENTS, Counters, Level, clear_level, close_level
from impact_env.kernels.segments import last_sample

Array = NDArray[np.float64]

# columns of an order: duration (s), circular frequency at start and end (rad/s), force (N), its phase at the start (rad; becomes that at the end),
# half-clearance (m; becomes the one in use), start afresh (0, 1), the run ends here (0, 1)
DURATION, OMEGA_START, OMEGA_STOP, FORCE, PHASE, GAP, FRESH, FINAL = range(8)
ORDERS = 8
# columns of a report: tip's amplitude in phase with the force and a quarter behind it (m), absorber less tip at the end (m, m/s), impacts,
# absorber's share of the energy at the end, level so far (m), mean of q_tip^2 (m^2), sum of |q_tip/unit|^exponent over the samples, tip
# displacement at the end (m)
IN_PHASE, QUADRATURE, DISTANCE, RELATIVE_VELOCITY, IMPACT_COUNT, ABSORBER_SHARE, LEVEL, MEAN_SQUARE, DAMAGE, TIP = range(10)
REPORTS = 10
NOW, GAP_IN_USE, SEARCH_LEVEL = 17, 15, 16  # columns of Lanes.now, and those behind what the integrators keep there
MARGIN = 1e-9  # by which a wall that is moved keeps off the absorber, relative to their distance from the middle


class Lanes(NamedTuple):
    """What lanes carry from interval to interval, one row each: free parts of the slots (L, 2, J), the integrator's variables (L, NOW), state
    (L, 2 N_m + 2), and the level's ring (L, W + 1) and state (L, 10).
    """  # noqa: D205

    z: Array
    now: Array
    state: Array
    ring: Array
    level: Array


class Watch(NamedTuple):
    """What all lanes share: sampling interval (s), samples of a whole interval, exponent of the damage (0: none), its unit of length (m),
    circular frequencies of the modes (N_m,), tip shape (N_m,), absorber mass (kg, 0 without one).
    """  # noqa: D205

    sample_dt: float
    samples: int
    exponent: float
    unit: float
    omega: Array
    tip_shape: Array
    mass: float


class Desk(NamedTuple):
    """Scratch of one thread: the stretch's breakpoints (2,) each, samples of the interval, clock, counters."""

    times: Array
    omegas: Array
    phases: Array
    block: Array
    clock: Array
    counters: Counters


@jit_room
def new_desk(watch):  # type: ignore[no-untyped-def]
    """Return scratch for one thread."""
    return Desk(np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(watch.samples), np.zeros(3), Counters(np.zeros(COUNTS), None))


@jit_room
def open_interval(desk, watch, lanes, i, order):  # type: ignore[no-untyped-def]
    """Lay out a lane's interval and return its level."""
    desk.times[1] = order[DURATION]
    desk.omegas[0], desk.omegas[1] = order[OMEGA_START], order[OMEGA_STOP]
    desk.phases[0] = order[PHASE]
    desk.phases[1] = order[PHASE] + 0.5 * (order[OMEGA_START] + order[OMEGA_STOP]) * order[DURATION]
    desk.clock[0], desk.clock[1], desk.clock[2] = 0.0, watch.sample_dt, 0.0
    values = desk.counters.values
    values[:] = 0.0
    values[MOST_EVENTS], values[MOST_EVALUATIONS] = FIRST_EVENTS, FIRST_EVENTS * EVALUATIONS_PER_EVENT
    level = Level(lanes.ring[i], lanes.level[i], desk.block)
    if order[FRESH] > 0.0:
        clear_level(level)
    return level


@jit
def report_samples(desk, watch, order, report):  # type: ignore[no-untyped-def]
    """Report what the interval's samples say: the amplitudes by projection on the force's phase, mean square, damage."""
    count = int(desk.clock[0])
    step = watch.sample_dt
    change = (order[OMEGA_STOP] - order[OMEGA_START]) / order[DURATION] * step * step
    turn = order[OMEGA_START] * step + 0.5 * change
    c, s = np.cos(order[PHASE]), np.sin(order[PHASE])
    turn_c, turn_s, change_c, change_s = np.cos(turn), np.sin(turn), np.cos(change), np.sin(change)
    along, behind, square, damage = 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        q = desk.block[k]
        along += q * c
        behind += q * s
        square += q * q
        c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
        turn_c, turn_s = turn_c * change_c - turn_s * change_s, turn_c * change_s + turn_s * change_c
    if watch.exponent > 0.0:
        for k in range(count):
            damage += (abs(desk.block[k]) / watch.unit) ** watch.exponent
    share = 1.0 / max(count, 1)
    report[IN_PHASE], report[QUADRATURE], report[MEAN_SQUARE], report[DAMAGE] = 2.0 * along * share, 2.0 * behind * share, square * share, damage


@jit
def report_state(watch, state, relative, relative_velocity, report):  # type: ignore[no-untyped-def]
    """Report what the state at the interval's end says."""
    modes = watch.omega.shape[0]
    energy, tip = 0.0, 0.0
    for i in range(modes):
        tip += watch.tip_shape[i] * state[i]
        energy += (watch.omega[i] * state[i]) ** 2 + state[modes + 1 + i] ** 2
    absorber = watch.mass * state[2 * modes + 1] ** 2
    report[DISTANCE], report[RELATIVE_VELOCITY], report[TIP] = relative, relative_velocity, tip
    report[ABSORBER_SHARE] = absorber / (absorber + energy) if absorber > 0.0 else 0.0


@jit
def close_interval(desk, watch, level, state, order, report):  # type: ignore[no-untyped-def]
    """Report samples and level, and set the order's phase to that of the interval's end."""
    report_samples(desk, watch, order, report)
    report[IMPACT_COUNT] = desk.counters.values[IMPACTS]
    if order[FINAL] > 0.0:
        last_sample(state, watch.tip_shape, order[DURATION], desk.clock, level, None)
    report[LEVEL] = close_level(level)[0]
    turns = np.floor(desk.phases[1] / (2.0 * np.pi))
    order[PHASE] = desk.phases[1] - 2.0 * np.pi * turns
    order[FRESH] = 0.0


@jit
def with_gap(restitution, gap):  # type: ignore[no-untyped-def]
    """Return the walls of a lane, or None."""
    if restitution is None:
        return None
    return Walls(gap, restitution)


@jit
def possible_gap(wanted, gap, distance, touching):  # type: ignore[no-untyped-def]
    """Return the half-clearance nearest to ``wanted`` that a cavity of half-clearance ``gap`` can take without closing onto the absorber."""
    if wanted >= gap:
        return wanted
    if touching:
        return gap
    return min(gap, max(wanted, distance * (1.0 + MARGIN)))


@jit_room
def spread(share, low, high):  # type: ignore[no-untyped-def]
    """Return low (high/low)^share for an array of shares from 0 to 1; here, because a vectorised power may differ in its last digit."""
    values = np.empty_like(share)
    for i in range(share.shape[0]):
        values[i] = low * (high / low) ** share[i]
    return values
