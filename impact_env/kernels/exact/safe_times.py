"""The time before which an absorber has no event, whatever the other absorbers do.

Until this time it is not searched.

Among n absorbers an event of one changes the signals of all others, and a search of every guard
after every event would cost n^2 modal sums for each of about 2 n events a period. But an impulse p
on absorber b changes the rate of absorber a's guard signal by no more than V_ab |p| and its second
derivative by no more than A_ab |p|, at any later time (`Sets.velocity_bound`,
`Sets.acceleration_bound`); a jump F of b's friction force changes the second derivative by no more
than V_ab |F|. So value, rate and a bound of the second derivative at one time (`SAFE_TIME`) bound
the signal from then on, through all events of others, and give a time before which none of its
guards can be reached. Only an absorber whose safe time comes before the earliest event found is
evaluated again and, where that is not enough, searched. In rings of 10 to 64 sectors that is 36 to
54 evaluations a period and absorber, so a period of n absorbers on n modes costs about n^2.

While absorbers stick, in a set that changes, all safe times are forgotten at its changes.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.compiling.records import NUMBER, record_type
from impact_env.kernels.events.careful import bound_signal, solve_parabola
from impact_env.kernels.events.signals import EventFunction, signal_scale
from impact_env.kernels.exact.rigid_contact import POSITION_ROUNDING, joint_bounds
from impact_env.kernels.exact.sets import (
    forced_of_set,
    is_joined,
    signal_of_absorber,
    system_of_set,
)
from impact_env.kernels.motion.modal_system import LARGEST_RATE

# of an absorber's guard signal at a time (s from the window's centre): the signal less what its
# rounding may be from either guard, its rate with the sign of approach to the upper one, what
# events of others have changed the rate by at most, and a bound of the second derivative; the sign
# that the rate must keep (0: any); the time before which there is no event
SAFE_TIME = record_type(
    taken_at=NUMBER,
    to_low=NUMBER,
    to_high=NUMBER,
    rate=NUMBER,
    rate_change=NUMBER,
    curvature=NUMBER,
    direction=NUMBER,
    until=NUMBER,
)
# of the time that a signal which starts on a guard, and leaves it, needs to come back to it at the
# earliest: a start that rounding could spoil is searched
RETURN_SHARE = 0.5


@jit
def forget_safe_times(safe_times):
    """Forget all safe times: each absorber is evaluated again before its next search."""
    for a in range(safe_times.shape[0]):
        safe_times[a].taken_at = np.nan
        safe_times[a].until = -np.inf


@jit
def find_most_urgent(safe_times):
    """Return the absorber whose next event may come first."""
    first = 0
    for a in range(1, safe_times.shape[0]):
        if safe_times[a].until < safe_times[first].until:
            first = a
    return first


@jit
def _time_to_guard(distance, closing, slack, curvature):
    """Return the shortest time (s) in which a signal can reach a guard.

    ``distance`` below 0: it may be on the guard already, and leaves it where the closing speed,
    ``slack`` more than it is, is negative.
    """
    if distance == np.inf:
        return np.inf
    if distance > 0.0:
        return solve_parabola(distance, closing + slack, curvature)
    if closing + slack < 0.0:
        return -2.0 * RETURN_SHARE * (closing + slack) / (curvature + 1e-300)
    return 0.0


@jit
def _set_until(safe):
    """Set the time before which there is no event, from the signal at the time it was taken at."""
    high = _time_to_guard(safe.to_high, safe.rate, safe.rate_change, safe.curvature)
    low = _time_to_guard(safe.to_low, -safe.rate, safe.rate_change, safe.curvature)
    length = min(low, high)
    if safe.direction != 0.0:
        least_rate = safe.direction * safe.rate - safe.rate_change
        length = min(length, max(least_rate, 0.0) / (safe.curvature + 1e-300))
    safe.until = safe.taken_at + length


@jit
def update_safe_time(scene, window, s, a, workspace):
    """Compute the safe time of absorber a at the current time.

    The set of joined absorbers is at position s. The guard signal of the absorber is filled.
    """
    sets = scene.sets
    absorbers = scene.absorbers
    contact_state = workspace.contact_states[a]
    safe = workspace.safe_times[a]
    signal = signal_of_absorber(workspace.signals, a)
    forced = forced_of_set(workspace.forced_sets, s, a)
    system = system_of_set(sets, s, sets.rows[s, a])
    function = EventFunction(system, forced, window.omega, signal, contact_state.tau)
    bounded = bound_signal(function, 0.0)
    limit = absorbers.limit[a]
    safe.direction = 0.0
    if is_joined(sets, s, a):
        low, high = joint_bounds(limit, contact_state.side)
    else:
        low = -absorbers.gap[a]
        high = absorbers.gap[a]
        if limit > 0.0:
            safe.direction = contact_state.sign
            # only the wall ahead can be reached before the relative velocity turns
            low = low if contact_state.sign < 0.0 else -np.inf
            high = high if contact_state.sign > 0.0 else np.inf
    margin = POSITION_ROUNDING * signal_scale(signal, forced.bound)
    safe.to_low = bounded.y - low - margin
    safe.to_high = high - bounded.y - margin
    safe.rate = bounded.v
    safe.rate_change = margin * system.scale[LARGEST_RATE]  # its rounding
    safe.curvature = bounded.b2
    safe.taken_at = contact_state.tau
    _set_until(safe)
    if contact_state.at_rest:
        safe.until = safe.taken_at


@jit
def update_safe_times_after_event(sets, s, a, impulse, workspace):
    """Correct the safe times after an event of absorber a.

    The event has not changed the set of joined absorbers, which is at position s.

    ``impulse`` (N s) is what absorber a was given. The friction forces that have changed are found
    by ``workspace.forces``.
    """
    contact_states = workspace.contact_states
    safe_times = workspace.safe_times
    n = safe_times.shape[0]
    size = abs(impulse)
    for b in range(n):
        safe_times[b].rate_change += size * sets.velocity_bound[s, b, a]
        safe_times[b].curvature += size * sets.acceleration_bound[s, b, a]
    for c in range(n):
        jump = abs(contact_states[c].force - workspace.forces[c])
        if jump > 0.0:
            for b in range(n):
                safe_times[b].curvature += jump * sets.velocity_bound[s, b, c]
    for b in range(n):
        changed = contact_states[b].force != workspace.forces[b]
        if b == a or changed or is_joined(sets, s, b):
            safe_times[b].taken_at = np.nan
            safe_times[b].until = -np.inf
        else:
            _set_until(safe_times[b])


@jit
def may_turn(sets, s, a, b, impulse, workspace):
    """Return whether an impulse (N s) on absorber a may reverse absorber b.

    In this case the impulse changes the sign of the relative velocity of absorber b.

    It cannot where the safe time of b is known and bounds its rate away from zero.
    """
    safe = workspace.safe_times[b]
    if np.isnan(safe.taken_at) or workspace.contact_states[b].at_rest:
        return True
    change = safe.rate_change + abs(impulse) * sets.velocity_bound[s, b, a]
    change += safe.curvature * (workspace.contact_states[b].tau - safe.taken_at)
    return not safe.direction * safe.rate > change
