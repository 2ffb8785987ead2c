"""A debug observer: after each search for an event the guard signal is sampled densely up to what was found, and must not have passed its guard.

The samples are direct sums at single times and know nothing of blocks, levels, bounds or margins. They are uniform, some a radian of the fastest
slot that is still active, and crowd geometrically at both ends, where errors of a start or of an event would be. A start lies on its guard and
so does the event, but for rounding: nothing is looked at closer to either than `CLOSEST`, and rounding of signal and time is allowed for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.events.signals import NOISE, at_offset, signal_scale, time_resolution
from impact_env.kernels.exact.rigid_contact import JOINT_FORCE_TOL, joint_bounds
from impact_env.kernels.exact.sets import forced_of, is_joined, signal_of, slots_with
from impact_env.kernels.motion.observers import PASSED, PULLED, TURNED
from impact_env.kernels.motion.slots import SPEED

DENSITY = 5.0  # samples a radian of the fastest active slot
ACTIVE = 1e-13  # of the largest share of the signal
MOST_SAMPLES = 4096  # uniform ones: 60 modes that all ring would take a second a search
HALVINGS = 30
CLOSEST = 0.5**HALVINGS  # to either end, of the way between them: 1e-9
DEPTH = 1e-10  # of the clearance: a deeper place is beyond a wall
ROUNDING = 50.0 * NOISE  # of the terms of signal or rate
TIME_ROUNDING = 4.0  # times the search's resolution of time


@jit
def active_speed(slots, omega, u):
    """Return the largest |s| (1/s) of the slots that count in the signal u, or the force's frequency."""
    largest = 0.0
    speed = omega
    for j in range(u.shape[1]):
        largest = max(largest, abs(u[0, j]) + abs(u[1, j]))
    for j in range(u.shape[1]):
        if abs(u[0, j]) + abs(u[1, j]) > ACTIVE * largest:
            speed = max(speed, slots.rows[SPEED, j])
    return speed


@jit
def rate_scale(slots, signal, bound, offset):
    """Return the size of the terms that a signal's rate is the sum of."""
    scale = bound[1] + abs(signal.polynomial[1]) + offset * abs(signal.polynomial[2])
    for j in range(signal.u.shape[1]):
        scale += slots.rows[SPEED, j] * (abs(signal.u[0, j]) + abs(signal.u[1, j]))
    return scale


@jit
def sample_time(k, count, offset):
    """Return the time (s) of sample k: first those close to the start, then ``count`` uniform ones, then those close to the end."""
    if k < HALVINGS:
        return offset * 0.5 ** (HALVINGS - k)
    if k < HALVINGS + count:
        return offset * (k - HALVINGS + 0.5) / count
    return offset * (1.0 - 0.5 ** (k - HALVINGS - count + 1))


@jit
def note_miss(check, time, kind, share):
    """Count a miss of a kind and of a share of what it is measured by, and list the first few."""
    check.worst[kind] = max(check.worst[kind], share)
    n = check.counts.misses
    if n < check.first.shape[0]:
        row = check.first[n]
        row.time = time
        row.kind = kind
        row.share = share
    check.counts.misses = n + 1


class Guard(NamedTuple):
    """What a signal must keep: the interval (low, high), and the sign of its rate (0: not watched).

    ``unit``: what a place beyond low or high is measured by (0: the signal's terms); ``slack``: share of these terms that is allowed; ``kind``: of
    miss.
    """

    low: float
    high: float
    unit: float
    slack: float
    sign: float
    kind: int


@jit
def sample_guard(check, slots, forced, window, signal, tau, offset, guard):
    """Check that a signal keeps within its guard from tau up to an offset (s)."""
    if not offset > 0.0:  # nothing was passed, or not a number
        return
    low, high, unit, slack, sign, kind = guard
    check.counts.searches += 1
    omega = window.omega
    scale = signal_scale(signal, forced.bound)
    speed_scale = rate_scale(slots, signal, forced.bound, offset)
    margin = max(DEPTH * unit, (ROUNDING + slack) * scale)
    rate_margin = ROUNDING * speed_scale
    moment = TIME_ROUNDING * time_resolution(slots.rows, omega, window.half)
    wanted = 8.0 + DENSITY * offset * active_speed(slots, omega, signal.u)
    if not np.isfinite(wanted):  # the run ends with its state
        return
    count = int(min(wanted, float(MOST_SAMPLES)))
    deepest = 0.0
    deepest_at = 0.0
    wrong = 0.0
    wrong_at = 0.0
    for k in range(count + 2 * HALVINGS):
        t = sample_time(k, count, offset)
        y, v, a = at_offset(slots, forced.signals, omega, signal, tau, t)
        depth = max(y - high, low - y)
        if depth > max(deepest, margin + moment * abs(v)):
            deepest = depth
            deepest_at = t
        if sign != 0.0:
            if -sign * v > max(wrong, rate_margin + moment * abs(a)):
                wrong = -sign * v
                wrong_at = t
    if deepest > 0.0:
        note_miss(
            check, window.centre + tau + deepest_at, kind, deepest / (unit if unit > 0.0 else scale)
        )
    elif wrong > 0.0:
        note_miss(check, window.centre + tau + wrong_at, TURNED, wrong / speed_scale)


@jit
def check_flight(check, slots, forced, window, walls, limit, body, offset):
    """Check the search of a flight: no wall is passed, and with friction the relative velocity keeps its sign."""
    if check is None:
        return
    gap = np.inf
    sign = 0.0
    if walls is not None:
        gap = walls.gap
    if limit is not None:
        sign = body.now.sign
    guard = Guard(-gap, gap, gap if gap < np.inf else 0.0, 0.0, sign, PASSED)
    sample_guard(check, slots, forced, window, body.signal, body.now.tau, offset, guard)


@jit
def check_hold(check, slots, forced, window, limit, body, offset):
    """Check the search of a hold: the joint force keeps within what the joint can give."""
    if check is None:
        return
    low, high = joint_bounds(limit, body.now.side)
    sample_guard(
        check,
        slots,
        forced,
        window,
        body.signal,
        body.now.tau,
        offset,
        Guard(low, high, 0.0, JOINT_FORCE_TOL, 0.0, PULLED),
    )


@jit
def check_set(check, scene, window, s, offset, room):
    """Check the searches of all absorbers in set s, up to the earliest event."""
    if check is None:
        return
    sets = scene.sets
    absorbers = scene.absorbers
    for a in range(room.now.shape[0]):
        now = room.now[a]
        limit = absorbers.limit[a]
        gap = absorbers.gap[a]
        slots = slots_with(sets, s, sets.rows[s, a])
        forced = forced_of(room.flow, s, a)
        signal = signal_of(room.signals, a)
        if is_joined(s, a):
            low, high = joint_bounds(limit, now.side)
            guard = Guard(low, high, 0.0, JOINT_FORCE_TOL, 0.0, PULLED)
        else:
            guard = Guard(
                -gap,
                gap,
                gap if gap < np.inf else 0.0,
                0.0,
                now.sign if limit > 0.0 else 0.0,
                PASSED,
            )
        sample_guard(check, slots, forced, window, signal, now.tau, offset, guard)
