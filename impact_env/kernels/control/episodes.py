"""What a task does with all its lanes before and after a control interval, in one loop each: NumPy would pass over the lanes once for every sign.

The arithmetic is that of a single lane, so a lane of a thousand has the digits of one that is
alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit

FREQUENCY_RATIO_TOL = 1e-12  # of the frequency ratio


class FeatureUnits(NamedTuple):
    """Units of the features.

    Length (m), inverse of the velocity (s/m), impacts of an interval; zero and unit of the
    frequency ratio; intervals of the time budget.
    """

    length: float
    per_velocity: float
    impacts: float
    origin: float
    frequency: float
    steps: int


class PassageRange(NamedTuple):
    """Range of a passage.

    Longest ``interval`` in pseudo periods, ``width`` and ``far`` end (L,) in units of the
    resonance, ``sign`` (L,) 1 up, -1 down.
    """

    interval: float
    width: float
    far: NDArray[np.float64]
    sign: NDArray[np.float64]


@jit
def advance_frequency(way, change, ratio, duration, after, ended):
    """Advance the frequency ``ratio`` (L,) by ``change`` (L,) per pseudo period, within the range of the passage.

    Filled: ``duration`` in pseudo periods, ratio ``after`` it, whether the passage has ``ended``
    there, each (L,).
    """
    interval = way.interval
    width = way.width
    far = way.far
    sign = way.sign
    for i in range(ratio.shape[0]):
        left = (far[i] - ratio[i]) * sign[i]
        rest = left - change[i] * interval
        ended[i] = rest <= FREQUENCY_RATIO_TOL
        if ended[i]:
            duration[i], after[i] = min(left / change[i], interval), far[i]
        else:
            duration[i], after[i] = interval, far[i] - sign[i] * min(rest, width)


@jit
def fill_orders(orders, omega, period, duration, ratio, after, force, final):
    """Fill drive and end of ORDER records from arrays (L,): durations in periods (s), frequency ratios to ``omega`` (rad/s), forces (N)."""
    for i in range(orders.shape[0]):
        order = orders[i]
        order.duration = duration[i] * period
        order.force = force[i]
        order.final = final[i]
        order.omega_start = ratio[i] * omega
        order.omega_stop = after[i] * omega


@jit
def compute_level_rewards(reports, level_scale, price, duration, fine, late, potential, rewards):
    """Fill the rewards (L,): the fall of the level over ``level_scale``, less ``price`` a pseudo period and a ``fine`` where ``late``.

    ``potential`` (L,) holds the relative level so far.
    """
    for i in range(reports.shape[0]):
        relative = reports[i].level / level_scale[i]
        rewards[i] = -(relative - potential[i]) - (duration[i] * price + (fine if late[i] else 0.0))
        potential[i] = relative


@jit
def compute_damage_rewards(reports, damage_scale, price, duration, fine, late, potential, rewards):
    """Fill the rewards as `compute_level_rewards` does, for the damage of the interval; ``potential`` is its sum."""
    for i in range(reports.shape[0]):
        gain = reports[i].damage / damage_scale[i]
        rewards[i] = -gain - (duration[i] * price + (fine if late[i] else 0.0))
        potential[i] += gain


@jit
def fill_features(reports, units, ratio, elapsed, level, values):
    """Write the features that all tasks share into the first columns of ``values`` (L, features)."""
    for i in range(reports.shape[0]):
        report = reports[i]
        row = values[i]
        row[0], row[1], row[2] = (
            report.in_phase / units.length,
            report.quadrature / units.length,
            report.distance / units.length,
        )
        row[3] = report.relative_velocity * units.per_velocity
        row[4], row[5] = report.impact_count / units.impacts, report.absorber_share
        row[6], row[7], row[8] = (
            (ratio[i] - units.origin) / units.frequency,
            1.0 - elapsed[i] / units.steps,
            level[i],
        )
