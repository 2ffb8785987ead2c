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

Where the set of absorbers that stick changes, all safe times are computed again.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.compiling.records import NUMBER, record_type
from impact_env.kernels.events.careful import bound_signal, solve_parabola
from impact_env.kernels.events.signals import EventFunction, compute_signal_scale
from impact_env.kernels.exact.rigid_contact import POSITION_ROUNDING, find_joint_bounds
from impact_env.kernels.exact.sets import is_joined, view_set_response, view_set_system, view_signal
from impact_env.kernels.motion.modal_system import LARGEST_RATE

# bounds of an absorber's guard signal from a time on, through all events of others
SAFE_TIME = record_type(
    taken_at=NUMBER,  # time of the evaluation (s from the window's centre), NaN: to be evaluated
    to_low=NUMBER,  # signal less its lower guard and its rounding
    to_high=NUMBER,  # upper guard less the signal and its rounding
    rate=NUMBER,  # rate of the signal
    rate_change=NUMBER,  # bound of the rate's rounding and of its changes by events of others
    curvature=NUMBER,  # bound of the second derivative
    direction=NUMBER,  # sign that the rate must keep, 0: any
    until=NUMBER,  # time before which there is no event (s from the window's centre)
)
# share of the earliest time at which a signal that starts on a guard, and leaves it, can return to
# it: because of rounding at the start not all of this time is taken as safe
RETURN_SHARE = 0.5


@jit
def forget_safe_times(safe_times):
    """Forget all safe times: each absorber is evaluated again before its next search."""
    for a in range(safe_times.shape[0]):
        safe_times[a].taken_at = np.nan
        safe_times[a].until = -np.inf


@jit
def find_most_urgent(safe_times):
    """Return the number of the absorber whose next event may come first."""
    first = 0
    for a in range(1, safe_times.shape[0]):
        if safe_times[a].until < safe_times[first].until:
            first = a
    return first


@jit
def _compute_time_to_guard(distance, closing, slack, curvature):
    """Return the shortest time (s) in which a signal can reach a guard.

    ``closing``: its speed towards the guard, with an uncertainty ``slack``. A ``distance`` below 0
    says that it may be on the guard already; it leaves the guard if the closing speed is negative.
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
    """Set ``until`` from the bounds of the signal at ``taken_at``."""
    high = _compute_time_to_guard(safe.to_high, safe.rate, safe.rate_change, safe.curvature)
    low = _compute_time_to_guard(safe.to_low, -safe.rate, safe.rate_change, safe.curvature)
    length = min(low, high)
    if safe.direction != 0.0:
        least_rate = safe.direction * safe.rate - safe.rate_change
        length = min(length, max(least_rate, 0.0) / (safe.curvature + 1e-300))
    safe.until = safe.taken_at + length


@jit
def update_safe_time(scene, window, s, a, workspace):
    """Compute the safe time of absorber a at the current time, in the set at position s.

    The absorber's guard signal must be filled (`fill_guard_signal`), its forced part known
    (`update_guard_response`). ``workspace.safe_times[a]`` is written.
    """
    sets = scene.sets
    absorbers = scene.absorbers
    contact_state = workspace.contact_states[a]
    safe = workspace.safe_times[a]
    signal = view_signal(workspace.signals, a)
    forced = view_set_response(workspace.forced_sets, s, a)
    system = view_set_system(sets, s, sets.rows[s, a])
    function = EventFunction(system, forced, window.omega, signal, contact_state.tau)
    bounded = bound_signal(function, 0.0)
    limit = absorbers.limit[a]
    safe.direction = 0.0
    if is_joined(sets, s, a):
        low, high = find_joint_bounds(limit, contact_state.side)
    else:
        low = -absorbers.gap[a]
        high = absorbers.gap[a]
        if limit > 0.0:
            safe.direction = contact_state.sign
            # only the wall ahead can be reached before the relative velocity turns
            low = low if contact_state.sign < 0.0 else -np.inf
            high = high if contact_state.sign > 0.0 else np.inf
    margin = POSITION_ROUNDING * compute_signal_scale(signal, forced.bound)
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
    """Correct the safe times after an event of absorber a that left set s unchanged.

    ``impulse`` (N s): on absorber a. ``workspace.forces`` are the constant forces before the event.
    Absorbers that must be evaluated again have ``taken_at`` NaN.
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
    """Return whether an impulse (N s) on absorber a may change the sign of b's relative velocity.

    The result is False only if the safe time of b is known and bounds its rate away from zero.
    """
    safe = workspace.safe_times[b]
    if np.isnan(safe.taken_at) or workspace.contact_states[b].at_rest:
        return True
    change = safe.rate_change + abs(impulse) * sets.velocity_bound[s, b, a]
    change += safe.curvature * (workspace.contact_states[b].tau - safe.taken_at)
    return not safe.direction * safe.rate > change
