"""Operations of a task on all its lanes before and after a control interval.

Each is one loop over the lanes, whereas NumPy would need one pass over the lanes for every
operator. Each lane has the same arithmetic, so its numbers do not depend on the number of lanes.

In: actions (L, A), orders and reports of L lanes (interval.py). Out: orders for the next interval,
rewards, and features for the observations.
"""

from __future__ import annotations

import math

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.compiling.records import NUMBER, record_type

FREQUENCY_RATIO_TOL = 1e-12  # of the frequency ratio


# units of the features, as an array of one record: numba takes longer to find the types of a
# named tuple at a call
FEATURE_UNITS = record_type(
    length=NUMBER,  # m
    per_velocity=NUMBER,  # inverse of the velocity (s/m)
    impacts=NUMBER,  # unit of the number of impacts in an interval
    most_impacts=NUMBER,  # limit of this number, in its unit
    origin=NUMBER,  # frequency ratio whose feature is 0
    frequency=NUMBER,  # unit of the frequency ratio
    steps=NUMBER,  # intervals in the time budget
)


@jit
def advance_frequency(interval, width, far, sign, change, ratio, duration, after, ended):
    """Advance the frequency ``ratio`` (L,) by ``change`` (L,) per pseudo period.

    Frequencies are ratios to the resonance. ``interval``: full length of an interval (pseudo
    periods); ``width``: of the range; ``far`` (L,): its end that is approached; ``sign`` (L,): 1
    up, -1 down. Filled, (L,) each: ``duration`` of the interval (pseudo periods), the ratio
    ``after`` it, whether the passage has ``ended`` there. ``ratio`` is not changed.
    """
    for i in range(ratio.shape[0]):
        left = (far[i] - ratio[i]) * sign[i]
        rest = left - change[i] * interval
        ended[i] = rest <= FREQUENCY_RATIO_TOL
        if ended[i]:
            duration[i], after[i] = min(left / change[i], interval), far[i]
        else:
            duration[i], after[i] = interval, far[i] - sign[i] * min(rest, width)


@jit
def limit_actions(actions):
    """Limit ``actions`` (n,) to [-1, 1] in place; return whether all of them are finite.

    Actions that are not finite stay.
    """
    finite = True
    for i in range(actions.shape[0]):
        if not -math.inf < actions[i] < math.inf:
            finite = False
        elif actions[i] < -1.0:
            actions[i] = -1.0
        elif actions[i] > 1.0:
            actions[i] = 1.0
    return finite


@jit
def order_friction(actions, column, low, high, orders, friction, place, moved):
    """Write the friction limits that a column of ``actions`` (L, A) gives to ``orders`` (L,).

    Actions from -1 to 1 span ``low`` to ``high`` (N) on a log scale. ``place`` (L,): the last
    actions, which become those of the column. Filled, (L,) each: ``friction`` (N), and ``moved``,
    the magnitude of the change of the action.
    """
    for i in range(orders.shape[0]):
        action = actions[i, column]
        moved[i] = abs(action - place[i])
        place[i] = action
        friction[i] = low * (high / low) ** (0.5 * (action + 1.0))
        orders[i].limit = friction[i]


@jit
def order_wall_motion(actions, low, high, share, most, orders, before):
    """Write the half-clearances that walls reach in an interval to ``orders`` (L,).

    Column 0 of ``actions`` (L, A) gives the targets: -1 to 1 span ``low`` to ``high`` (m) on a log
    scale. The walls move by the ``share`` of the distance to the target, at most by ``most`` (m).
    ``before`` (L,) is filled with the half-clearances (m) before the motion.
    """
    for i in range(orders.shape[0]):
        gap = orders[i].gap
        before[i] = gap
        target = low * (high / low) ** (0.5 * (actions[i, 0] + 1.0))
        orders[i].gap = gap + min(max((target - gap) * share, -most), most)


@jit
def measure_wall_motion(orders, before, length, moved):
    """Fill ``moved`` (L,): change of half-clearances since ``before`` (L,), over ``length`` (m)."""
    for i in range(orders.shape[0]):
        moved[i] = abs(orders[i].gap - before[i]) / length


@jit
def fill_orders(
    orders, omega, period, steps, duration, ratio, after, force, ended, resting, elapsed, late
):
    """Fill duration, force, frequencies and end of ORDER records from arrays (L,).

    ``duration`` is in periods of ``period`` (s); the frequency ratios, ``ratio`` at the start and
    ``after`` the interval, refer to ``omega`` (rad/s); ``force`` is in N. ``elapsed``, the number
    of intervals, grows by one except for lanes that are ``resting``. Filled: ``late``, whether an
    episode has not ``ended`` after ``steps`` intervals.
    """
    for i in range(orders.shape[0]):
        order = orders[i]
        if not resting[i]:
            elapsed[i] += 1
        late[i] = elapsed[i] >= steps and not ended[i]
        order.duration = duration[i] * period
        order.force = force[i]
        order.final = ended[i] or late[i]
        order.omega_start = ratio[i] * omega
        order.omega_stop = after[i] * omega


@jit
def close_step(
    duration, elapsed, limit, late_ends, resting, late, time, score, rewards, ended, cut
):
    """Add the interval to ``time`` and ``score`` (L,), and find the episodes that end.

    Changed: ``ended`` (L,), whether an episode has terminated; filled: ``cut`` (L,), whether it is
    truncated. A ``late`` episode terminates if ``late_ends``, else it is truncated. An episode with
    ``limit`` intervals is truncated (0: no limit). The ``rewards`` (L,) of ``resting`` lanes are
    set to 0, and their episodes do not end.
    """
    for i in range(rewards.shape[0]):
        time[i] += duration[i]
        score[i] += rewards[i]
        cut[i] = late[i] and not late_ends
        if late[i] and late_ends:
            ended[i] = True
        if limit > 0 and elapsed[i] >= limit:
            cut[i] = True
        if resting[i]:
            rewards[i] = 0.0
            ended[i] = False
            cut[i] = False


@jit
def fill_costs(reports, moved, duration, interval, steps, samples, costs):
    """Fill columns 1 to 3 of ``costs`` (L, 5): time, damage, displacement of the actuator.

    The time is relative to that of ``steps`` full intervals, the damage is divided by the number
    ``samples`` of a full interval. ``moved`` (L,): displacement of the actuator; ``duration`` (L,)
    and ``interval``, the full length, in pseudo periods.
    """
    for i in range(reports.shape[0]):
        costs[i, 1] = duration[i] / interval / steps
        costs[i, 2] = reports[i].damage / samples
        costs[i, 3] = moved[i]


@jit
def compute_cycle_rewards(
    reports,
    state,
    steps,
    price,
    mass_rate,
    force,
    scale,
    moved,
    squares,
    speed,
    rms,
    costs,
    rewards,
):
    """Fill the rewards (L,) of control within a period.

    A reward is minus the interval's share of the mean relative RMS, less the price of the
    actuator's displacement ``moved`` (L,). ``state`` (L, S) at the end; ``steps``: intervals in the
    time budget; ``price`` of a unit that the actuator moves; ``mass_rate`` (kg/s): absorber's mass
    over an interval's duration; ``force`` (N) and ``scale`` (m), the RMS without absorber, (L,).
    Changed: ``squares`` (L, n), mean squares of the last n intervals (m^2), and ``speed`` (L,), the
    absorber's velocity (m/s). Filled: ``rms`` (L,) of the interval (m), and columns 0 and 4 of
    ``costs`` (L, 5): level, and contact force over ``force``.
    """
    last = state.shape[1] - 1
    intervals = squares.shape[1]
    for i in range(reports.shape[0]):
        for k in range(intervals - 1):
            squares[i, k] = squares[i, k + 1]
        square = reports[i].mean_square
        squares[i, intervals - 1] = square
        rms[i] = math.sqrt(square)
        level = rms[i] / scale[i] / steps
        costs[i, 0] = level
        costs[i, 4] = abs(state[i, last] - speed[i]) * mass_rate / force[i]
        speed[i] = state[i, last]
        rewards[i] = -level - price * moved[i]


@jit
def compute_level_rewards(reports, level_scale, price, duration, fine, late, potential, rewards):
    """Fill the rewards (L,) of a passage that is rated by its level.

    A reward is the fall of the level relative to ``level_scale`` (L,) (m), less ``price`` for each
    pseudo period of ``duration`` (L,) and a ``fine`` where the episode is ``late``. ``potential``
    (L,): the relative level before the interval, becomes that after it.
    """
    for i in range(reports.shape[0]):
        relative = reports[i].level / level_scale[i]
        rewards[i] = -(relative - potential[i]) - (duration[i] * price + (fine if late[i] else 0.0))
        potential[i] = relative


@jit
def compute_damage_rewards(reports, damage_scale, price, duration, fine, late, potential, rewards):
    """Fill the rewards as `compute_level_rewards` does, for the damage of the interval.

    ``damage_scale`` (L,): unit of the damage. ``potential`` (L,): sum of the relative damage, to
    which that of the interval is added.
    """
    for i in range(reports.shape[0]):
        gain = reports[i].damage / damage_scale[i]
        rewards[i] = -gain - (duration[i] * price + (fine if late[i] else 0.0))
        potential[i] += gain


@jit
def fill_features(reports, units, ratio, elapsed, level, values):
    """Write features to columns 0 to 8 of ``values`` (L, features).

    ``units`` (1,) is a record FEATURE_UNITS; ``ratio`` (L,): frequency ratios; ``elapsed`` (L,):
    numbers of intervals; ``level`` (L,): column 8, as it is.
    """
    unit = units[0]
    for i in range(reports.shape[0]):
        report = reports[i]
        row = values[i]
        row[0] = report.in_phase / unit.length
        row[1] = report.quadrature / unit.length
        row[2] = report.distance / unit.length
        row[3] = report.relative_velocity * unit.per_velocity
        row[4] = min(report.impact_count / unit.impacts, unit.most_impacts)
        row[5] = report.absorber_share
        row[6] = (ratio[i] - unit.origin) / unit.frequency
        row[7] = 1.0 - elapsed[i] / unit.steps
        row[8] = level[i]


@jit
def fill_cycle_features(reports, orders, state, shapes, squares, units, ratio, elapsed, values):
    """Write features of control within a period to columns 0 to 9 of ``values`` (L, features).

    ``state`` (L, S) at the end, ``shapes`` (L or 1, N_m) of the modes where the level is read, mean
    ``squares`` (L, n) of the intervals of the last period (m^2), ``units`` (1,): FEATURE_UNITS.
    """
    modes = shapes.shape[1]
    intervals = squares.shape[1]
    unit = units[0]
    for i in range(reports.shape[0]):
        report = reports[i]
        row = values[i]
        shape = shapes[i % shapes.shape[0]]
        tip = 0.0
        rate = 0.0
        for j in range(modes):
            tip += shape[j] * state[i, j]
            rate += shape[j] * state[i, modes + 1 + j]
        square = 0.0
        for k in range(intervals):
            square += squares[i, k]
        row[0] = tip / unit.length
        row[1] = rate * unit.per_velocity
        row[2] = report.distance / unit.length
        row[3] = report.relative_velocity * unit.per_velocity
        row[4] = min(report.impact_count / unit.impacts, unit.most_impacts)
        row[5] = math.cos(orders[i].phase)
        row[6] = math.sin(orders[i].phase)
        row[7] = (ratio[i] - unit.origin) / unit.frequency
        row[8] = 1.0 - elapsed[i] / unit.steps
        row[9] = math.sqrt(square / intervals) / unit.length


@jit
def limit_features(values, most, observed):
    """Write ``values`` (L, features) to ``observed``, limited to +-``most``.

    ``observed`` (L, features) is float32. NaN stays NaN.
    """
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            value = values[i, k]
            if value > most:
                value = most
            elif value < -most:
                value = -most
            observed[i, k] = value
