"""The jump of a sweep: the chance of being in the regime of impacts still when the sweep has passed the range in which runs leave it.

Rates of leaving are measured at constant frequencies (`residence`); their integral over a sweep's time gives P = exp(-N value). That leaves out that
the frequency moves: it carries runs over the border of the regime, or away from it, which costs exits for each percent, not for each period, so that
P = A exp(-N value) with an A that does not depend on N. It is read off sweeps (`Hazard.with_sweeps`); sweeps the other way have its inverse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from impact_env.ensemble import Executor, Lane, Progress, each_lane
from impact_env.methods import Exact, Method
from impact_env.parameters import count, positive, require
from impact_env.periodic.residence import LEVEL, SILENCE, Approach, ExitRate, finished, first_silence, passage
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
DRAWS = 4000


@dataclass(frozen=True)
class Hazard:
    """Integral of the rate of leaving over the frequency, in exits per (pseudo period / percent): a jump at N has probability A exp(-N value).

    ``low`` and ``high``: its interval from the counting of exits alone. ``first`` and ``last``: the ratios between which it is taken.
    ``factor``: A with its interval, what the motion of the frequency adds; 1 where no sweeps were measured.
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
        """Return the probability of a jump at a slowness, and its interval: the errors of integral and factor are added as squares."""
        n = positive("periods_per_percent", periods_per_percent)
        middle = np.log(self.factor) - n * self.value
        down = np.hypot(n * (self.high - self.value), np.log(self.factor / self.factor_low))
        up = np.hypot(n * (self.value - self.low), np.log(self.factor_high / self.factor))
        at, low, high = (min(1.0, float(np.exp(x))) for x in (middle, middle - down, middle + up))
        return at, low, high

    def with_sweeps(self, measured: Mapping[float, Jumps], level: float = LEVEL) -> Hazard:
        """Return the hazard with the factor that sweeps show, by their slowness: the mean of log(share) + N value by generalised least squares.

        Shares have the errors of their counts and, all of them together, that of the integral. Raises ParameterError if none of them both jumped
        and left.
        """
        own = {n: found for n, found in measured.items() if 0 < found.jumped < found.present}
        require(bool(own), "sweeps", list(measured), "at least one slowness at which some runs jump and some do not")
        n, share = np.array(list(own)), np.array([found.share for found in own.values()])
        counted = (1 - share) / np.array([found.jumped for found in own.values()])
        bound = float(scipy.stats.norm.ppf((1 + level) / 2))
        common = (self.high - self.low) / (2 * bound) * n
        weights = np.linalg.solve(np.diag(counted) + np.outer(common, common), np.ones(len(n)))
        middle, width = float(weights @ (np.log(share) + n * self.value) / weights.sum()), bound / float(np.sqrt(weights.sum()))
        low, at, high = (float(np.exp(x)) for x in (middle - width, middle, middle + width))
        return replace(self, factor=at, factor_low=low, factor_high=high)


def hazard(ratios: Sequence[float], rates: Sequence[ExitRate], *, level: float = LEVEL, seed: int = 0) -> Hazard:
    """Return the trapezoidal integral of rates (per pseudo period) measured at frequency ``ratios``, rising or falling.

    The interval is that of the sum of the counts, each drawn from the gamma distribution with its exits plus a half and its exposure. Raises
    ParameterError unless there are two ratios or more, in order, with as many rates and some time at risk each.
    """
    x = np.asarray(ratios, dtype=np.float64)
    turns = np.diff(x)
    ordered = len(x) >= 2 and bool(np.all(turns > 0) or np.all(turns < 0))
    require(ordered, "ratios", ratios, "two frequency ratios or more, rising or falling")
    require(len(rates) == len(x), "rates", len(rates), f"one for each of the {len(x)} ratios")
    empty = [float(ratio) for ratio, rate in zip(x, rates, strict=True) if rate.exposure == 0]
    require(not empty, "rates", empty, "at each ratio at least one run that is in the regime when its stay begins")
    weights = np.zeros(len(x))
    weights[:-1] += np.abs(turns) / 2
    weights[1:] += np.abs(turns) / 2
    weights *= 100  # percent
    drawn = np.random.default_rng(count("seed", seed, 0))
    shapes, exposures = np.array([rate.exits + 0.5 for rate in rates]), np.array([rate.exposure for rate in rates])
    sums = (drawn.gamma(shapes, size=(DRAWS, len(x))) / exposures) @ weights
    tail = (1 - level) / 2
    low, high = np.quantile(sums, [tail, 1 - tail])
    value = float(weights @ [rate.rate for rate in rates])
    return Hazard(value, min(float(low), value), max(float(high), value), float(x[0]), float(x[-1]))


@dataclass(frozen=True)
class Jumps:
    """What became of sweeps: ``present`` in the regime of impacts at the range's first ratio, ``jumped`` out of these, and all ``runs``.

    ``high``: runs whose response level in m lies above a limit, None unless one was asked for. ``left``: frequency ratios at which those that were
    present left it, before the range's last ratio.
    """

    jumped: int
    present: int
    runs: int
    high: int | None = None
    left: tuple[float, ...] = ()

    @property
    def share(self) -> float:
        """Share of those present that jumped, NaN if none was present."""
        return self.jumped / self.present if self.present else float("nan")

    def interval(self, level: float = LEVEL) -> tuple[float, float]:
        """Return Wilson's interval of the share."""
        if not self.present:
            return 0.0, 1.0
        found = scipy.stats.binomtest(self.jumped, self.present).proportion_ci(level, method="wilson")
        return float(found.low), float(found.high)


@dataclass(frozen=True)
class Range:
    """Frequencies of a sweep over the reference: it runs from ``start`` to ``stop``; runs leave the regime between ``first`` and ``last``."""

    start: float
    first: float
    last: float
    stop: float

    def __post_init__(self) -> None:
        row = np.array([self.start, self.first, self.last, self.stop])
        ok = bool(np.all(np.diff(row) < 0) or np.all(np.diff(row) > 0))
        require(ok, "range", tuple(row.tolist()), "four ratios, start, first, last and stop, rising or falling")


def _passed(period: float, begin: float, end: float, silence: float, method: Method, lane: Lane) -> tuple[float, float]:
    """Return when a lane's first silence began (NaN: there was none), in pseudo periods of ``period`` s, and its level in m."""
    response = simulate(lane.scene, lane.drive, method, record=Record(events=True))
    assert response.impacts is not None
    assert response.level is not None
    began = first_silence(response.impacts.time / period, begin, end, silence).began
    return (np.nan if began is None else began), response.level.value


def jumps(
    scene: Scene,
    force: float,
    approach: Approach,
    over: Range,
    periods_per_percent: float,
    phases: Sequence[float],
    silence: float = SILENCE,
    high_level: float | None = None,
    method: Method | None = None,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Jumps:
    """Sweep lanes, one for each initial phase (rad), and return how many jumped; interruption and errors as in `residence.stays`.

    A run has jumped if no ``silence`` (pseudo periods without impact, at least) begins before the range's last ratio. It is present if none had begun
    before the first. ``high_level`` in m: response levels above it are counted too. ``method``: default Exact.
    Raises ParameterError if the sweep is too fast for a silence to show after the last ratio.
    """
    tail = abs(over.stop - over.last) * 100 * positive("periods_per_percent", periods_per_percent)
    require(tail >= silence, "periods_per_percent", periods_per_percent, f"{silence * periods_per_percent / tail:.4g} or more: a silence must show")
    method = Exact() if method is None else method
    begin = approach.lead + approach.ramp
    first, last = (begin + abs(ratio - over.start) * 100 * periods_per_percent for ratio in (over.first, over.last))
    measure = partial(_passed, 2 * np.pi / approach.reference, first - silence, last + silence, silence, method)
    lanes = [Lane(scene, passage(approach, force, over.start, over.stop, periods_per_percent, phase)) for phase in phases]
    found = np.array(finished(each_lane(lanes, measure, method, threads=threads, progress=progress, executor=executor)))
    began = np.where(np.isnan(found[:, 0]), np.inf, found[:, 0])
    left = over.start + np.sign(over.stop - over.start) * (began[(began > first) & (began <= last)] - begin) / (100 * periods_per_percent)
    high = None if high_level is None else int(np.sum(found[:, 1] > high_level))
    return Jumps(int(np.sum(began > last)), int(np.sum(began > first)), len(found), high, tuple(left.tolist()))
