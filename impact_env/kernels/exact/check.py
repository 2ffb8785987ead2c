"""A debug observer that checks the result of each search.

The guard signal is sampled densely up to the event, and must not have passed its guard.

The samples are direct sums at single times, without blocks, levels, bounds or margins. Uniform
samples, `SAMPLES_PER_RADIAN` of the fastest modal amplitude that is still active, are supplemented
by geometrically denser ones at both ends, where a wrong start or event would show. Up to rounding
the signal may start on a guard, and ends on one at an event. So no sample is closer to either end
than `CLOSEST_SHARE` of the length, and rounding of signal and time is allowed for.

In: the observer ``check`` of the counters, the searched signal, its bounds. Out: the number of
searches and of misses, the largest miss of each kind, and the first misses, written to ``check``.
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
MOST_SAMPLES = 4096  # uniform ones; without a limit 60 active modes would take a second a search
END_HALVINGS = 30  # geometric samples at each end, each at half the distance of the one before
CLOSEST_SHARE = 0.5**END_HALVINGS  # least distance to an end, of the length: 1e-9
DEPTH_TOL = 1e-10  # of the clearance: a larger depth beyond a wall is a miss
SIGNAL_CHECK_TOL = 50.0 * SIGNAL_ROUNDING  # of the sum of the sizes of the terms of signal or rate
TIME_CHECK_FACTOR = 4.0  # times the search's resolution of time


@jit
def find_active_rate(system, omega, u):
    """Return the largest |s| (1/s) of the active modal amplitudes u (2, J) of a signal.

    The result is at least the frequency ``omega`` (rad/s) of the force.
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
    """Return the time (s) of sample k after the start of a segment that is ``offset`` (s) long.

    The first END_HALVINGS samples are spaced geometrically from the start, the next ``count``
    uniformly, and the last END_HALVINGS geometrically towards the end.
    """
    if k < END_HALVINGS:
        return offset * 0.5 ** (END_HALVINGS - k)
    if k < END_HALVINGS + count:
        return offset * (k - END_HALVINGS + 0.5) / count
    return offset * (1.0 - 0.5 ** (k - END_HALVINGS - count + 1))


@jit
def record_miss(check, time, kind, share):
    """Count a miss in ``check`` and list it if it is one of the first.

    ``time`` (s) is that of the run. ``kind``: GUARD_PASSED, JOINT_EXCEEDED or RATE_TURNED.
    ``share``: size of the violation relative to the scale of its signal.
    """
    check.worst[kind] = max(check.worst[kind], share)
    n = check.counts.misses
    if n < check.first.shape[0]:
        row = check.first[n]
        row.time = time
        row.kind = kind
        row.share = share
    check.counts.misses = n + 1


class GuardBounds(NamedTuple):
    """Bounds that a signal must keep, a relative displacement (m) or a joint force (N)."""

    low: float  # lower bound, -infinity: none
    high: float  # upper bound, infinity: none
    unit: float  # scale of a violation; 0: the sum of the sizes of the signal's terms
    slack: float  # allowed violation as a share of this sum, besides rounding
    sign: float  # sign that the rate must keep; 0: not checked
    kind: int  # of the miss if a bound is passed: GUARD_PASSED or JOINT_EXCEEDED


@jit
def check_guard_samples(check, system, forced, window, signal, tau, offset, guard):
    """Check on dense samples that a signal remains within its bounds.

    The samples are taken over a length ``offset`` (s) from ``tau`` (s from the window's centre) on,
    the signal's reference time. ``guard``: `GuardBounds`. At most one miss, the largest, is
    recorded in ``check``.
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
    """Check the search of a free segment of length ``offset`` (s).

    No wall may be passed and, with friction (``limit`` not None), the relative velocity must not
    change its sign.
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
    """Check the search of a joined segment of length ``offset`` (s).

    The joint force must remain within its bounds. ``limit`` (N): of static friction, None without.
    """
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
    """Check the searches of all absorbers in the set at position s.

    The earliest event is at ``offset`` (s). The guard signals and their forced parts in
    ``workspace`` are filled.
    """
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
