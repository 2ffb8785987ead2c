"""A debug observer that checks the result of each search.

The guard signal is sampled densely up to the event, and must not have passed its guard.

The samples are direct sums at single times, without blocks, levels, bounds or margins. They are
uniform, some a radian of the fastest modal amplitude that is still active, and geometrically denser
at both ends, where errors of a start or of an event would be. A start lies on its
guard and so does the event, but for rounding: no sample is closer to either than `CLOSEST_SHARE`,
and rounding of signal and time is allowed for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.events.signals import (
    SIGNAL_ROUNDING,
    compute_signal_scale,
    compute_time_resolution,
    evaluate_at_offset,
)
from impact_env.kernels.exact.rigid_contact import JOINT_FORCE_TOL, find_joint_bounds, has_walls
from impact_env.kernels.exact.sets import (
    fill_guard_signal,
    is_joined,
    update_guard_response,
    view_set_response,
    view_set_system,
    view_signal,
)
from impact_env.kernels.motion.modal_system import SPEED
from impact_env.kernels.motion.observers import GUARD_PASSED, JOINT_EXCEEDED, RATE_TURNED

SAMPLES_PER_RADIAN = 5.0  # samples a radian of the fastest active modal amplitude
ACTIVE_SHARE = 1e-13  # of the largest share of the signal
MOST_SAMPLES = 4096  # uniform ones: 60 modes that all ring would take a second a search
END_HALVINGS = 30
CLOSEST_SHARE = 0.5**END_HALVINGS  # to either end, of the way between them: 1e-9
DEPTH_TOL = 1e-10  # of the clearance: a deeper place is beyond a wall
SIGNAL_CHECK_TOL = 50.0 * SIGNAL_ROUNDING  # of the terms of signal or rate
TIME_CHECK_FACTOR = 4.0  # times the search's resolution of time


@jit
def find_active_rate(system, omega, u):
    """Return the largest |s| (1/s) of the active modal amplitudes in the signal u.

    The result is the force's frequency if this is larger.
    """
    largest = 0.0
    speed = omega
    for j in range(u.shape[1]):
        largest = max(largest, abs(u[0, j]) + abs(u[1, j]))
    for j in range(u.shape[1]):
        if abs(u[0, j]) + abs(u[1, j]) > ACTIVE_SHARE * largest:
            speed = max(speed, system.rows[SPEED, j])
    return speed


@jit
def compute_sample_time(k, count, offset):
    """Return the time (s) of sample k.

    Samples are spaced geometrically near the start, then follow ``count`` uniform samples, then
    geometric spacing near the end.
    """
    if k < END_HALVINGS:
        return offset * 0.5 ** (END_HALVINGS - k)
    if k < END_HALVINGS + count:
        return offset * (k - END_HALVINGS + 0.5) / count
    return offset * (1.0 - 0.5 ** (k - END_HALVINGS - count + 1))


@jit
def record_miss(check, time, kind, share):
    """Count a miss and list the first few; ``share``: its size relative to that of its guard."""
    check.worst[kind] = max(check.worst[kind], share)
    n = check.counts.misses
    if n < check.first.shape[0]:
        row = check.first[n]
        row.time = time
        row.kind = kind
        row.share = share
    check.counts.misses = n + 1


class GuardBounds(NamedTuple):
    """Bounds that a signal must keep."""

    low: float  # lower bound
    high: float  # upper bound
    unit: float  # scale of a violation; 0: the signal's terms
    slack: float  # allowed share of these terms
    sign: float  # of the rate; 0: not checked
    kind: int  # of miss


@jit
def check_guard_samples(check, system, forced, window, signal, tau, offset, guard):
    """Check on dense samples that a signal remains within its bounds.

    The samples are taken from ``tau`` up to an offset (s).
    """
    if not offset > 0.0:  # nothing was passed, or not a number
        return
    low, high, unit, slack, sign, kind = guard
    check.counts.searches += 1
    omega = window.omega
    scale = compute_signal_scale(signal, forced.bound)
    p = signal.polynomial
    speed_scale = forced.bound[1] + abs(p[1]) + offset * abs(p[2])  # of the terms of the rate
    for j in range(signal.u.shape[1]):
        size = abs(signal.u[0, j]) + abs(signal.u[1, j])
        speed_scale += system.rows[SPEED, j] * size
    margin = max(DEPTH_TOL * unit, (SIGNAL_CHECK_TOL + slack) * scale)
    rate_margin = SIGNAL_CHECK_TOL * speed_scale
    moment = TIME_CHECK_FACTOR * compute_time_resolution(system.rows, omega, window.half)
    samples = 8.0 + SAMPLES_PER_RADIAN * offset * find_active_rate(system, omega, signal.u)
    if not np.isfinite(samples):  # the state is not finite: the run ends
        return
    count = int(min(samples, float(MOST_SAMPLES)))
    deepest = 0.0
    deepest_at = 0.0
    wrong = 0.0
    wrong_at = 0.0
    for k in range(count + 2 * END_HALVINGS):
        t = compute_sample_time(k, count, offset)
        y, v, a = evaluate_at_offset(system, forced.signals, omega, signal, tau, t)
        depth = max(y - high, low - y)
        if depth > max(deepest, margin + moment * abs(v)):
            deepest = depth
            deepest_at = t
        if sign != 0.0:
            if -sign * v > max(wrong, rate_margin + moment * abs(a)):
                wrong = -sign * v
                wrong_at = t
    if deepest > 0.0:
        record_miss(
            check, window.centre + tau + deepest_at, kind, deepest / (unit if unit > 0.0 else scale)
        )
    elif wrong > 0.0:
        record_miss(check, window.centre + tau + wrong_at, RATE_TURNED, wrong / speed_scale)


@jit_inline
def check_free_segment(check, system, forced, window, walls, limit, body, offset):
    """Check the search of a free segment.

    No wall may be passed and, with friction, the relative velocity must not change its sign.
    """
    gap = walls.gap if has_walls(walls) else np.inf
    sign = 0.0
    if limit is not None:
        sign = body.contact_state.sign
    guard = GuardBounds(-gap, gap, gap if gap < np.inf else 0.0, 0.0, sign, GUARD_PASSED)
    check_guard_samples(
        check, system, forced, window, body.signal, body.contact_state.tau, offset, guard
    )


@jit_inline
def check_joined_segment(check, system, forced, window, limit, body, offset):
    """Check the search of a joined segment: the joint force keeps within its bounds."""
    low, high = find_joint_bounds(limit, body.contact_state.side)
    check_guard_samples(
        check,
        system,
        forced,
        window,
        body.signal,
        body.contact_state.tau,
        offset,
        GuardBounds(low, high, 0.0, JOINT_FORCE_TOL, 0.0, JOINT_EXCEEDED),
    )


@jit_inline
def check_set(check, scene, window, s, offset, workspace):
    """Check the searches of all absorbers in set s, up to the earliest event."""
    sets = scene.sets
    absorbers = scene.absorbers
    for a in range(workspace.contact_states.shape[0]):
        contact_state = workspace.contact_states[a]
        limit = absorbers.limit[a]
        gap = absorbers.gap[a]
        update_guard_response(sets, absorbers, window, s, a, workspace.forced_sets)
        fill_guard_signal(scene, s, a, workspace)
        system = view_set_system(sets, s, sets.rows[s, a])
        forced = view_set_response(workspace.forced_sets, s, a)
        signal = view_signal(workspace.signals, a)
        if is_joined(sets, s, a):
            low, high = find_joint_bounds(limit, contact_state.side)
            guard = GuardBounds(low, high, 0.0, JOINT_FORCE_TOL, 0.0, JOINT_EXCEEDED)
        else:
            guard = GuardBounds(
                -gap,
                gap,
                gap if gap < np.inf else 0.0,
                0.0,
                contact_state.sign if limit > 0.0 else 0.0,
                GUARD_PASSED,
            )
        check_guard_samples(check, system, forced, window, signal, contact_state.tau, offset, guard)
