"""Residence times in a regime of impacts at a constant frequency.

The module computes the escape rate of runs, and from it the probability that a sweep jumps.

Escape rates are measured at constant frequencies. Their integral over a sweep with N pseudo periods
per percent gives the probability P = exp(-N value) of passing without escape. A moving frequency
also carries runs over the border of the regime, or away from it; this effect is proportional to the
range of frequencies, not to time, so that P = A exp(-N value) with a factor A that does not depend
on N. A is estimated from sweeps (`Hazard.with_sweeps`); sweeps in the other direction have its
inverse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import (
    count,
    finite,
    labelled,
    non_negative,
    or_none,
    positive,
    require,
)
from impact_env.drive import Drive, FrequencySchedule
from impact_env.ensemble import Executor, Lane, LaneProgress, each_lane
from impact_env.fields import check_fields
from impact_env.methods import Exact, Method
from impact_env.results import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
T = TypeVar("T")
EXIT_CONFIDENCE = 0.95
# pseudo periods without impact that end a stay: docs/regimes.md compares it with the longest pauses
# after which impacts came back
SILENT_PERIODS = 100.0


@dataclass(frozen=True)
class Approach:
    """The approach to a regime of impacts: a frequency at which impacts begin, then a ramp.

    Parameters
    ----------
    reference : float
        Circular frequency in rad/s to which ratios and pseudo periods refer.
    ratio : float, optional
        Frequency ratio at which runs from rest begin to have impacts. None: runs start from rest at
        the wanted frequency.
    periods : float, optional
        Pseudo periods at this ratio.
    ramp : float, optional
        Pseudo periods from this ratio to the wanted one.
    """

    reference: float
    ratio: float | None = None
    periods: float = 200.0
    ramp: float = 50.0

    def __post_init__(self) -> None:
        check_fields(
            self,
            reference=labelled("reference frequency", positive),
            ratio=or_none(labelled("approach ratio", non_negative)),
            periods=labelled("approach periods", positive),
            ramp=labelled("approach ramp", positive),
        )

    @property
    def lead(self) -> float:
        """Pseudo periods until the wanted frequency is reached."""
        return 0.0 if self.ratio is None else self.periods + self.ramp

    def to(self, *points: tuple[float, float]) -> FrequencySchedule:
        """Return the schedule of the approach, followed by linear changes through ``points``.

        Each point is a pair (duration in pseudo periods, frequency ratio at its end). The approach
        ends at the first point's ratio.
        """
        first = points[0][1]
        before = [] if self.ratio is None else [(self.periods, self.ratio), (self.ramp, first)]
        start = first if self.ratio is None else self.ratio
        spans, ratios = zip(*before, *points, strict=True)
        times = np.concatenate([[0.0], np.cumsum(spans)]) * 2 * np.pi / self.reference
        return FrequencySchedule(times, np.array([start, *ratios]) * self.reference, self.reference)


def hold(
    approach: Approach, force: float, ratio: float, periods: float, phase: float = 0.0
) -> Drive:
    """Return the drive that approaches ``ratio`` and stays at it for ``periods`` pseudo periods.

    The force is in N, the initial phase in rad.
    """
    return Drive(force, approach.to((positive("periods", periods), ratio)), phase)


def passage_schedule(
    approach: Approach,
    force: float,
    start: float,
    stop: float,
    periods_per_percent: float,
    phase: float = 0.0,
) -> Drive:
    """Return the drive that sweeps from the ratio ``start`` to ``stop`` after the approach.

    The rate is given in pseudo periods for each percent of the reference frequency. The force is in
    N, the initial phase in rad.
    """
    span = abs(stop - start) * 100 * positive("periods_per_percent", periods_per_percent)
    settle = approach.ramp  # at the start, so that the sweep begins as stays do
    return Drive(force, approach.to((settle, start), (positive("sweep", span), stop)), phase)


@dataclass(frozen=True)
class ImpactFreeInterval:
    """The first interval of a run without impacts.

    ``began`` is its start (None: no such interval), and ``returned`` says whether impacts occurred
    after it.
    """

    began: float | None
    returned: bool


def find_impact_free_interval(
    impacts: Array, begin: float, end: float, length: float
) -> ImpactFreeInterval:
    """Return the first interval without impacts of at least ``length``.

    It is sought between ``begin`` and ``end``. ``impacts`` (K,) are the times of impacts; all times
    have the same unit. The intervals before the first impact and after the last one count, too.
    """
    inside = impacts[(impacts >= begin) & (impacts <= end)]
    edges = np.concatenate([[begin], inside, [end]])
    long = np.flatnonzero(np.diff(edges) >= length)
    if not len(long):
        return ImpactFreeInterval(None, returned=False)
    return ImpactFreeInterval(float(edges[long[0]]), returned=bool(long[0] + 1 < len(edges) - 1))


@dataclass(frozen=True, eq=False)
class ResidenceTimes:
    """Residence times of lanes in the regime of impacts.

    Attributes
    ----------
    durations : array, (n,)
        Residence times in pseudo periods; lower limits if not ended (censored).
    ended : array of bool, (n,)
        Whether the run left the regime.
    absent : int
        Number of lanes that had left the regime before the observation began.
    returned : int
        Number of lanes with impacts after the silence by which they left. With a silence that is
        long enough there are none.
    longest_pauses : array, (n,), optional
        Longest time without impact before the end of each stay. A silence must be longer.
    """

    durations: Array
    ended: NDArray[np.bool_]
    absent: int = 0
    returned: int = 0
    longest_pauses: Array | None = None

    def after(self, time: float) -> ResidenceTimes:
        """Return the stays longer than ``time``, with ``time`` subtracted."""
        left = self.durations > time
        return ResidenceTimes(self.durations[left] - time, self.ended[left])


def read_duration(
    impacts: Array, begin: float, end: float, silence: float
) -> tuple[float, bool, bool, float] | None:
    """Return a run's stay from ``begin`` on, None if it had left the regime before.

    The results are the duration, whether the stay ended, whether impacts returned, and the longest
    pause before the end. A run leaves the regime when a time without impacts of at least
    ``silence`` begins; the last ``silence`` before ``begin`` is included. Runs are observed until
    ``end`` less ``silence``, because later silences cannot be distinguished from pauses.
    """
    last = end - silence
    result = find_impact_free_interval(impacts, begin - silence, end, silence)
    if result.began is not None and result.began <= begin:
        return None
    stop = last if result.began is None else min(result.began, last)
    inside = impacts[(impacts >= begin) & (impacts <= stop)]
    pause = float(np.max(np.diff(np.concatenate([[begin], inside])), initial=0.0))
    return stop - begin, result.began is not None and result.began < last, result.returned, pause


def _simulate_residence(
    period: float, begin: float, end: float, silence: float, lane: Lane
) -> tuple[float, bool, bool, float] | tuple[()]:
    """Return a lane's stay as `read_duration` does, an empty tuple if it had left before."""
    response = simulate(lane.scene, lane.drive, record=Record(events=True))
    assert response.impacts is not None
    return read_duration(response.impacts.time / period, begin, end, silence) or ()


def residence_times(
    scene: Scene,
    force: float,
    approach: Approach,
    ratio: float,
    periods: float,
    phases: Sequence[float],
    silence: float = SILENT_PERIODS,
    *,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> ResidenceTimes:
    """Return the stays at one frequency ratio, with a lane for each initial phase (rad).

    The phases are those of the force. Each lane starts with ``approach`` and is observed over at
    most ``periods`` pseudo periods. An ``executor`` makes the runs elsewhere, as in
    `ensemble.run_lanes`. A KeyboardInterrupt is raised again after the lanes under way are
    finished. Raises ParameterError for a bad value, IntegrationError if a lane breaks down.
    """
    periods = positive("periods", periods)
    require(
        0 < silence < periods,
        "silence",
        silence,
        f"above 0 and below the {periods} pseudo periods of a stay",
    )
    begin = approach.lead
    measure = partial(
        _simulate_residence, 2 * np.pi / approach.reference, begin, begin + periods, silence
    )
    lanes = [Lane(scene, hold(approach, force, ratio, periods, phase)) for phase in phases]
    result = drop_unfinished(
        each_lane(lanes, measure, threads=threads, progress=progress, executor=executor)
    )
    present = [stay for stay in result if stay]
    columns = list(zip(*present, strict=True)) or [(), (), (), ()]
    return ResidenceTimes(
        np.array(columns[0], dtype=np.float64),
        np.array(columns[1], dtype=np.bool_),
        len(result) - len(present),
        int(np.sum(columns[2])),
        np.array(columns[3], dtype=np.float64),
    )


def drop_unfinished(result: Sequence[T | None]) -> list[T]:
    """Return the results of lanes; raise KeyboardInterrupt if one is missing."""
    whole = [value for value in result if value is not None]
    if len(whole) < len(result):
        raise KeyboardInterrupt
    return whole


@dataclass(frozen=True)
class ExitRate:
    """Escape rate from a regime per pseudo period, with its interval.

    It follows from a number of ``exits`` in the time at risk, ``exposure`` (pseudo periods).
    """

    exits: int
    exposure: float
    rate: float
    low: float
    high: float


def exit_rate(
    observed: ResidenceTimes, burn_in: float = 0.0, level: float = EXIT_CONFIDENCE
) -> ExitRate:
    """Return the maximum-likelihood escape rate of a constant hazard.

    It is the number of exits over the time at risk; stays that have not ended are censored.
    ``burn_in``: pseudo periods at the start of stays that are left out; stays that end earlier do
    not count. The interval with probability ``level`` is Garwood's for a Poisson count (F. Garwood,
    Biometrika 28, 1936). Rate and interval are NaN without time at risk.
    """
    burn_in = non_negative("burn_in", burn_in)
    require(0 < level < 1, "level", level, "a number between 0 and 1")
    rest = observed.after(burn_in)
    exits = int(np.sum(rest.ended))
    exposure = float(np.sum(rest.durations))
    if exposure == 0:
        return ExitRate(0, 0.0, np.nan, np.nan, np.nan)
    tail = (1 - level) / 2
    low = 0.0 if exits == 0 else float(scipy.stats.gamma.ppf(tail, exits)) / exposure
    return ExitRate(
        exits,
        exposure,
        exits / exposure,
        low,
        float(scipy.stats.gamma.ppf(1 - tail, exits + 1)) / exposure,
    )


BOOTSTRAP_DRAWS = 4000


@dataclass(frozen=True)
class Hazard:
    """Integral of the escape rate over the frequency, in exits per (pseudo period / percent).

    A sweep at N pseudo periods per percent stays in the regime with the probability A exp(-N
    value).

    Attributes
    ----------
    value, low, high : float
        The integral, and its interval from the counts of exits.
    first, last : float
        Frequency ratios between which it is taken.
    factor, factor_low, factor_high : float
        The factor A (see the module) and its interval; 1 if no sweeps were measured.
    """

    value: float
    low: float
    high: float
    first: float
    last: float
    factor: float = 1.0
    factor_low: float = 1.0
    factor_high: float = 1.0

    def probability(self, periods_per_percent: float) -> tuple[float, float, float]:
        """Return the probability of a jump at a slowness, and its interval.

        The errors of integral and factor are combined as the root of the sum of squares.
        """
        n = positive("periods_per_percent", periods_per_percent)
        middle = np.log(self.factor) - n * self.value
        down = np.hypot(n * (self.high - self.value), np.log(self.factor / self.factor_low))
        up = np.hypot(n * (self.value - self.low), np.log(self.factor_high / self.factor))
        at, low, high = (min(1.0, float(np.exp(x))) for x in (middle, middle - down, middle + up))
        return at, low, high

    def with_sweeps(
        self, measured: Mapping[float, Jumps], level: float = EXIT_CONFIDENCE
    ) -> Hazard:
        """Return the hazard with the factor A estimated from sweeps.

        ``measured`` has the results of sweeps by their slowness (pseudo periods per percent). The
        logarithm of the factor is the generalised least-squares mean of log(share) + N value.
        Shares have the errors of their counts and the common error of the integral. Raises
        ParameterError unless some runs jumped and some left.
        """
        own = {n: result for n, result in measured.items() if 0 < result.jumped < result.present}
        require(
            bool(own),
            "sweeps",
            list(measured),
            "at least one slowness at which some runs jump and some do not",
        )
        n = np.array(list(own))
        share = np.array([result.share for result in own.values()])
        counted = (1 - share) / np.array([result.jumped for result in own.values()])
        bound = float(scipy.stats.norm.ppf((1 + level) / 2))
        common = (self.high - self.low) / (2 * bound) * n
        weights = np.linalg.solve(np.diag(counted) + np.outer(common, common), np.ones(len(n)))
        middle = float(weights @ (np.log(share) + n * self.value) / weights.sum())
        width = bound / float(np.sqrt(weights.sum()))
        low, at, high = (float(np.exp(x)) for x in (middle - width, middle, middle + width))
        return replace(self, factor=at, factor_low=low, factor_high=high)


def hazard(
    ratios: Sequence[float],
    rates: Sequence[ExitRate],
    *,
    level: float = EXIT_CONFIDENCE,
    seed: int = 0,
) -> Hazard:
    """Return the trapezoidal integral of escape rates over the frequency.

    The rates (per pseudo period) are measured at frequency ``ratios``, which ascend or descend.

    The interval is that of the sum of the counts, each drawn from the gamma distribution with its
    exits plus a half and its exposure. Raises ParameterError unless there are two ratios or more,
    in order, with as many rates and some time at risk each.
    """
    x = np.asarray(ratios, dtype=np.float64)
    turns = np.diff(x)
    ordered = len(x) >= 2 and bool(np.all(turns > 0) or np.all(turns < 0))
    require(ordered, "ratios", ratios, "two frequency ratios or more, rising or falling")
    require(len(rates) == len(x), "rates", len(rates), f"one for each of the {len(x)} ratios")
    empty = [float(ratio) for ratio, rate in zip(x, rates, strict=True) if rate.exposure == 0]
    require(
        not empty,
        "rates",
        empty,
        "at each ratio at least one run that is in the regime when its stay begins",
    )
    weights = np.zeros(len(x))
    weights[:-1] += np.abs(turns) / 2
    weights[1:] += np.abs(turns) / 2
    weights *= 100  # percent
    drawn = np.random.default_rng(count("seed", seed, 0))
    shapes = np.array([rate.exits + 0.5 for rate in rates])
    exposures = np.array([rate.exposure for rate in rates])
    sums = (drawn.gamma(shapes, size=(BOOTSTRAP_DRAWS, len(x))) / exposures) @ weights
    tail = (1 - level) / 2
    low, high = np.quantile(sums, [tail, 1 - tail])
    value = float(weights @ [rate.rate for rate in rates])
    return Hazard(value, min(float(low), value), max(float(high), value), float(x[0]), float(x[-1]))


@dataclass(frozen=True)
class Jumps:
    """Results of sweeps over a range of frequencies.

    Attributes
    ----------
    jumped : int
        Runs that jumped: they were in the regime at the range's first ratio and did not leave it.
    present : int
        Runs that were in the regime of impacts at the range's first ratio.
    runs : int
        All runs.
    high : int or None
        Runs with a response level above a limit, None without limit.
    left : tuple of float
        Frequency ratios at which the present runs left the regime.
    """

    jumped: int
    present: int
    runs: int
    high: int | None = None
    left: tuple[float, ...] = ()

    @property
    def share(self) -> float:
        """Share of the present runs that jumped, NaN if none was present."""
        return self.jumped / self.present if self.present else float("nan")

    def interval(self, level: float = EXIT_CONFIDENCE) -> tuple[float, float]:
        """Return Wilson's interval of the share."""
        if not self.present:
            return 0.0, 1.0
        result = scipy.stats.binomtest(self.jumped, self.present).proportion_ci(
            level, method="wilson"
        )
        return float(result.low), float(result.high)


@dataclass(frozen=True)
class Range:
    """Frequencies of a sweep relative to the reference.

    The sweep runs from ``start`` to ``stop``, and runs leave the regime between ``first`` and
    ``last``.
    """

    start: float
    first: float
    last: float
    stop: float

    def __post_init__(self) -> None:
        check_fields(self, start=finite, first=finite, last=finite, stop=finite)
        row = np.array([self.start, self.first, self.last, self.stop])
        ok = bool(np.all(np.diff(row) < 0) or np.all(np.diff(row) > 0))
        require(
            ok,
            "range",
            tuple(row.tolist()),
            "four ratios, start, first, last and stop, rising or falling",
        )


def _has_passed(
    period: float, begin: float, end: float, silence: float, method: Method, lane: Lane
) -> tuple[float, float]:
    """Return the begin of a lane's first interval without impacts, and its level in m.

    The begin is in pseudo periods of ``period`` s (NaN: no such interval).
    """
    response = simulate(lane.scene, lane.drive, method, record=Record(events=True))
    assert response.impacts is not None
    assert response.level is not None
    began = find_impact_free_interval(response.impacts.time / period, begin, end, silence).began
    return (np.nan if began is None else began), response.level.value


def jumps(
    scene: Scene,
    force: float,
    approach: Approach,
    over: Range,
    periods_per_percent: float,
    phases: Sequence[float],
    silence: float = SILENT_PERIODS,
    high_level: float | None = None,
    method: Method | None = None,
    *,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> Jumps:
    """Sweep lanes, one for each initial phase (rad) of the force, and return how many jumped.

    A run is present if no ``silence`` (at least so many pseudo periods without impact) begins
    before the first ratio of ``over``, and has jumped if none begins before its last ratio.
    Response levels above ``high_level`` (m) are counted. Interruption and errors are those of
    `residence_times`. Raises ParameterError if the sweep is so fast that a silence does not end
    before the sweep.
    """
    tail = abs(over.stop - over.last) * 100 * positive("periods_per_percent", periods_per_percent)
    require(
        tail >= silence,
        "periods_per_percent",
        periods_per_percent,
        f"{silence * periods_per_percent / tail:.4g} or more: a silence must show",
    )
    method = Exact() if method is None else method
    begin = approach.lead + approach.ramp
    first, last = (
        begin + abs(ratio - over.start) * 100 * periods_per_percent
        for ratio in (over.first, over.last)
    )
    measure = partial(
        _has_passed,
        2 * np.pi / approach.reference,
        first - silence,
        last + silence,
        silence,
        method,
    )
    lanes = [
        Lane(
            scene,
            passage_schedule(approach, force, over.start, over.stop, periods_per_percent, phase),
        )
        for phase in phases
    ]
    result = np.array(
        drop_unfinished(
            each_lane(lanes, measure, method, threads=threads, progress=progress, executor=executor)
        )
    )
    began = np.where(np.isnan(result[:, 0]), np.inf, result[:, 0])
    left = over.start + np.sign(over.stop - over.start) * (
        began[(began > first) & (began <= last)] - begin
    ) / (100 * periods_per_percent)
    high = None if high_level is None else int(np.sum(result[:, 1] > high_level))
    return Jumps(
        int(np.sum(began > last)),
        int(np.sum(began > first)),
        len(result),
        high,
        tuple(left.tolist()),
    )
