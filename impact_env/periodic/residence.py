"""How long a regime of impacts lasts at a constant frequency: runs that come to it, their stays, and the rate at which they leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from impact_env.drive import Drive, FrequencySchedule
from impact_env.ensemble import Executor, Lane, Progress, each_lane
from impact_env.parameters import non_negative, positive, require
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
T = TypeVar("T")
LEVEL = 0.95
SILENCE = 100.0  # pseudo periods without impact that end a stay: docs/regimes.md compares it with the longest pauses after which impacts came back


@dataclass(frozen=True)
class Approach:
    """From rest ``periods`` at ``ratio``, where runs come into impact by themselves, then ``ramp`` to the frequency wanted.

    The ratio is of the ``reference`` (rad/s), times are in pseudo periods of it. A ``ratio`` of None: from rest at the frequency wanted, at once.
    """

    reference: float
    ratio: float | None = None
    periods: float = 200.0
    ramp: float = 50.0

    def __post_init__(self) -> None:
        positive("reference frequency", self.reference)
        if self.ratio is not None:
            non_negative("approach ratio", self.ratio)
        positive("approach periods", self.periods)
        positive("approach ramp", self.ramp)

    @property
    def lead(self) -> float:
        """Pseudo periods before the frequency wanted is reached."""
        return 0.0 if self.ratio is None else self.periods + self.ramp

    def to(self, *points: tuple[float, float]) -> FrequencySchedule:
        """Return the schedule through ``points``, pairs of a time in pseudo periods and the ratio at its end; the first begins after the lead.

        The first point's ratio is also where the approach ends.
        """
        first = points[0][1]
        before = [] if self.ratio is None else [(self.periods, self.ratio), (self.ramp, first)]
        start = first if self.ratio is None else self.ratio
        spans, ratios = zip(*before, *points, strict=True)
        times = np.concatenate([[0.0], np.cumsum(spans)]) * 2 * np.pi / self.reference
        return FrequencySchedule(times, np.array([start, *ratios]) * self.reference, self.reference)


def hold(approach: Approach, force: float, ratio: float, periods: float, phase: float = 0.0) -> Drive:
    """Return the drive that stays at ``ratio`` for a number of pseudo ``periods`` once it is there; force in N, initial phase in rad."""
    return Drive(force, approach.to((positive("periods", periods), ratio)), phase)


def passage(approach: Approach, force: float, start: float, stop: float, periods_per_percent: float, phase: float = 0.0) -> Drive:
    """Return the drive that sweeps from one ratio to another at a constant rate, in pseudo periods for each percent of the reference frequency."""
    span = abs(stop - start) * 100 * positive("periods_per_percent", periods_per_percent)
    settle = approach.ramp  # at the start, so that the sweep begins as stays do
    return Drive(force, approach.to((settle, start), (positive("sweep", span), stop)), phase)


@dataclass(frozen=True)
class Silence:
    """The first silence of a run: when it ``began`` (None: there was none), and whether impacts ``returned`` after it."""

    began: float | None
    returned: bool


def first_silence(impacts: Array, begin: float, end: float, length: float) -> Silence:
    """Return the first stretch of at least ``length`` without impact between ``begin`` and ``end``; all times in one unit.

    A stretch before the first impact counts, and one that goes on to the end.
    """
    inside = impacts[(impacts >= begin) & (impacts <= end)]
    edges = np.concatenate([[begin], inside, [end]])
    long = np.flatnonzero(np.diff(edges) >= length)
    if not len(long):
        return Silence(None, returned=False)
    return Silence(float(edges[long[0]]), returned=bool(long[0] + 1 < len(edges) - 1))


@dataclass(frozen=True, eq=False)
class Stays:
    """How long lanes stayed in the regime of impacts, (n,) each: ``durations`` in pseudo periods, and whether a stay ``ended``.

    What has not ended is censored: it lasted at least as long. ``absent``: lanes that had left before their stay began. ``returned``: lanes whose
    impacts came back after the silence that ended their stay; a silence long enough leaves none. ``longest_pauses`` (n,): longest time without
    impact before the stay's end, which a silence must exceed.
    """

    durations: Array
    ended: NDArray[np.bool_]
    absent: int = 0
    returned: int = 0
    longest_pauses: Array | None = None

    def after(self, time: float) -> Stays:
        """Return the rest, after ``time``, of the stays that last longer."""
        left = self.durations > time
        return Stays(self.durations[left] - time, self.ended[left])


def stay_of(impacts: Array, begin: float, end: float, silence: float) -> tuple[float, bool, bool, float] | None:
    """Return a run's stay from ``begin``: duration, whether it ended, whether impacts returned, longest pause before; None if it had left before.

    It had left if the silence began before ``begin``, whose last ``silence`` is looked at too. A run is observed until
    ``end`` less the ``silence``: what happens later could not be told from a pause, and is left out.
    """
    last, found = end - silence, first_silence(impacts, begin - silence, end, silence)
    if found.began is not None and found.began <= begin:
        return None
    stop = last if found.began is None else min(found.began, last)
    inside = impacts[(impacts >= begin) & (impacts <= stop)]
    pause = float(np.max(np.diff(np.concatenate([[begin], inside])), initial=0.0))
    return stop - begin, found.began is not None and found.began < last, found.returned, pause


def _stay(period: float, begin: float, end: float, silence: float, lane: Lane) -> tuple[float, bool, bool, float] | tuple[()]:
    """Return what `stays` measures of a lane, empty if it had left before; another process gets the same numbers."""
    response = simulate(lane.scene, lane.drive, record=Record(events=True))
    assert response.impacts is not None
    return stay_of(response.impacts.time / period, begin, end, silence) or ()


def stays(
    scene: Scene,
    force: float,
    approach: Approach,
    ratio: float,
    periods: float,
    phases: Sequence[float],
    silence: float = SILENCE,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Stays:
    """Return the stays at one frequency ratio, a lane for each initial phase of the force (rad), over at most ``periods`` pseudo periods.

    Each lane comes from the state of impacts as ``approach`` says. A KeyboardInterrupt is raised again once the lanes under way are finished; an
    ``executor`` makes the runs elsewhere, as for `ensemble.run_lanes`.
    Raises ParameterError for a bad value, IntegrationError if a lane breaks down.
    """
    positive("periods", periods)
    require(0 < silence < periods, "silence", silence, f"above 0 and below the {periods} pseudo periods of a stay")
    begin = approach.lead
    measure = partial(_stay, 2 * np.pi / approach.reference, begin, begin + periods, silence)
    lanes = [Lane(scene, hold(approach, force, ratio, periods, phase)) for phase in phases]
    found = finished(each_lane(lanes, measure, threads=threads, progress=progress, executor=executor))
    there = [stay for stay in found if stay]
    columns = list(zip(*there, strict=True)) or [(), (), (), ()]
    return Stays(
        np.array(columns[0], dtype=np.float64),
        np.array(columns[1], dtype=np.bool_),
        len(found) - len(there),
        int(np.sum(columns[2])),
        np.array(columns[3], dtype=np.float64),
    )


def finished(found: Sequence[T | None]) -> list[T]:
    """Return the results of lanes; raises KeyboardInterrupt if one is missing."""
    whole = [value for value in found if value is not None]
    if len(whole) < len(found):
        raise KeyboardInterrupt
    return whole


@dataclass(frozen=True)
class ExitRate:
    """Rate of leaving a regime per pseudo period with its interval, from a number of ``exits`` in the time at risk, ``exposure`` (pseudo periods)."""

    exits: int
    exposure: float
    rate: float
    low: float
    high: float


def exit_rate(observed: Stays, burn_in: float = 0.0, level: float = LEVEL) -> ExitRate:
    """Return the maximum-likelihood rate of a constant hazard: exits over the time at risk, stays under way counted as censored.

    ``burn_in``: pseudo periods at a stay's start that are left out, with what ended in them. The interval is Garwood's for a Poisson count
    (F. Garwood, Biometrika 28, 1936). Without any time at risk rate and interval are NaN.
    """
    non_negative("burn_in", burn_in)
    require(0 < level < 1, "level", level, "a number between 0 and 1")
    rest = observed.after(burn_in)
    exits, exposure = int(np.sum(rest.ended)), float(np.sum(rest.durations))
    if exposure == 0:
        return ExitRate(0, 0.0, np.nan, np.nan, np.nan)
    tail = (1 - level) / 2
    low = 0.0 if exits == 0 else float(scipy.stats.gamma.ppf(tail, exits)) / exposure
    return ExitRate(exits, exposure, exits / exposure, low, float(scipy.stats.gamma.ppf(1 - tail, exits + 1)) / exposure)
