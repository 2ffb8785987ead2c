"""What is seen of one sweep beside its level: the contacts around its maximum, its envelope, and the passage near the resonance.

All of it is read from one set of observers, so that each kernel is compiled once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive, FrequencySchedule
from impact_env.ensemble import Lane
from impact_env.level import HALF_WINDOW_PERIODS, ResponseLevel, level_of, read_level
from impact_env.methods import Method
from impact_env.periodic.lyapunov import largest_exponent
from impact_env.periodic.stationary import longest_pause
from impact_env.response import DEFAULT_SAMPLES, Record, Response
from impact_env.sweep import simulate

Array = NDArray[np.float64]
WATCHED = Record(level=False, events=True, series=True, energy=True)


class Seen(NamedTuple):
    """A sweep's level (m), frequency ratio of the maximum, largest |q_tip| (m) and number of impacts.

    Then, of the level's window: impacts per pseudo period, and the longest pause between impacts in pseudo periods. ``before``: pseudo periods from
    the first impact of the sweep to the maximum; NaN if there is none.
    """

    level: float
    at: float
    tip: float
    impacts: float
    rate: float
    pause: float
    before: float


def sampled_level(response: Response) -> ResponseLevel:
    """Return the level of a run that was recorded as samples."""
    history, schedule = response.history, response.drive.schedule
    assert history is not None
    found = read_level(level_of(history.tip_displacement, DEFAULT_SAMPLES), response.drive, schedule.pseudo_period / DEFAULT_SAMPLES)
    assert found is not None
    return found


def part_of(drive: Drive, start: float, stop: float) -> Drive:
    """Return a drive between two of its times in s, as one that begins at 0."""
    schedule = drive.schedule
    times = np.concatenate([[start], schedule.times[(schedule.times > start) & (schedule.times < stop)], [stop]])
    own = FrequencySchedule(times - start, schedule.omega_at(times), schedule.reference)
    return Drive(drive.amplitude, own, drive.phase + float(schedule.phase_at(start)))


@dataclass(frozen=True)
class Contacts:
    """Measures a lane's `Seen` with a method."""

    method: Method

    def __call__(self, lane: Lane) -> Seen:
        """Return what is seen of the lane."""
        response = simulate(lane.scene, lane.drive, self.method, record=WATCHED)
        assert response.impacts is not None
        level, period = sampled_level(response), lane.drive.schedule.pseudo_period
        times, middle = response.impacts.time / period, level.time / period
        begin = max(0.0, middle - HALF_WINDOW_PERIODS)
        length = min(lane.drive.schedule.periods, middle + HALF_WINDOW_PERIODS) - begin
        inside = times[(times >= begin) & (times <= begin + length)] - begin
        pause = longest_pause(inside, length)
        before = middle - times[0] if len(times) else np.nan
        return Seen(level.value, level.frequency_ratio, level.max_tip, len(times), len(inside) / length, pause, float(before))


@dataclass(frozen=True)
class Chaos:
    """Measures the largest Lyapunov exponent of what a lane settles to, over ``periods`` of the force: value, and the ends of its interval."""

    periods: int

    def __call__(self, lane: Lane) -> tuple[float, float, float]:
        """Return that of the lane, per period of the force."""
        found = largest_exponent(lane.scene, lane.drive, self.periods)
        return found.value, found.low, found.high


@dataclass(frozen=True)
class Envelope:
    """Measures a lane's largest |q_tip| in m in each stretch of ``periods`` pseudo periods; the last one may be shorter."""

    periods: int = 4

    def __call__(self, lane: Lane) -> Array:
        """Return the envelope of the lane, (stretches,)."""
        history = simulate(lane.scene, lane.drive, record=WATCHED).history
        assert history is not None
        firsts = np.arange(0, len(history.time), self.periods * DEFAULT_SAMPLES)
        return np.asarray(np.maximum.reduceat(np.abs(history.tip_displacement), firsts))

    def ratios(self, schedule: FrequencySchedule) -> Array:
        """Return the frequency in the middle of each stretch over the schedule's reference."""
        stretches = int(np.ceil((int(schedule.periods * (1 + 1e-12) * DEFAULT_SAMPLES) + 1) / (self.periods * DEFAULT_SAMPLES)))
        middles = np.minimum((np.arange(stretches) + 0.5) * self.periods, schedule.periods)
        return np.asarray(schedule.omega_at(middles * schedule.pseudo_period)) / schedule.reference
