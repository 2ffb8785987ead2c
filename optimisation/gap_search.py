"""The search for a gap: which gaps to run with how many members, and which to choose.

This module runs nothing itself.

Gaps are counted in steps of ``STEP`` of ln gap from a reference gap. On the narrow side of the best
gap the level rises steeply, on the wide side it is proportional to the gap. Levels scatter over the
members, so a single run is not sufficient.

1. Single runs at four gaps around the start, and at the reference gap; further ones outwards while
  the lowest level is at an end.
2. The interval around the lowest level is halved down to ``NEAR`` steps, the wider side first. A
  second basin is refined too if its level is within
   ``SECOND_BASIN`` of the lowest.
3. Whichever gap is the best so far runs with one member more, until it has all of them; then the
  gaps on which the answer for a tolerance of the
   force rests. A gap that one lucky run made the best is so replaced by another before the runs are
   spent.
4. The answers are chosen among gaps that ran with all members.
5. The answer for a tolerance stands beside the cliff: under the largest force its members may part
  over two branches, and all members of a few may
   lie on the lower one by chance. So it runs there with `CHECK_MEMBERS` members, and if another gap
   is then better, that gap is checked as well, at most `CHECKS` of them.

By the scaling law a device under k times the force is the device with a k-th of the gap under the
force, k times as large: level(k f, g) = k level(f, g/k), with a friction limit in proportion to the
gap. So the level over a tolerance of the force is in the samples already. A quantity that is no
length scales with another ``power`` of k: a decay time with 0.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
STEP = 0.05  # of ln gap
FIRST_RUNS = (0, -8, 8, 16)  # steps from the start
WIDE = 8  # steps between the first looks
NEAR = 2  # steps between the lowest level and its neighbours after step 2
# steps from the start: the narrowest and the widest gap that are tried
NARROWEST = -32
WIDEST = 32
SECOND_BASIN = 1.15  # times the lowest level
# pairs of sweeps, up and down, that a search takes at most: with one without absorber 40 sweeps
PAIRS = 19
CHECK_MEMBERS = 8  # of the recommended device under the largest force of the tolerance
ONE_BRANCH = 0.15  # standard deviation of ln levels: members on one branch differ by less
CHECKS = 3  # gaps that are checked so at most
SAME_STEP_TOL = (
    0.1  # steps: 0.5 % of the gap, far less than the steps between the gaps that are run
)
# pairs of sweeps that the checks take at most
CHECK_PAIRS = CHECKS * CHECK_MEMBERS
# (step, number of members) -> the members' levels, the first ones of the ensemble
RunGap = Callable[[float, int], Array]


@dataclass
class LevelSamples:
    """The members' levels by step of the gap; in a search steps are whole numbers.

    ``power`` is that of the scaling law (see the module). ``excess`` has, by step, the logarithm of
    the largest ratio of other quantities to their limits, 0 or less within the limits (see
    `limited`).
    """

    levels: dict[float, Array] = field(default_factory=dict)
    power: float = 1.0
    excess: dict[float, float] = field(default_factory=dict)

    @property
    def runs(self) -> int:
        """Number of members that ran, over all gaps."""
        return sum(len(levels) for levels in self.levels.values())

    def known(self) -> tuple[Array, Array]:
        """Return (steps, ln of median levels)."""
        steps = np.array(sorted(self.levels))
        return steps, np.log([float(np.median(self.levels[n])) for n in steps])

    def means(self) -> tuple[Array, Array]:
        """Return (steps, means of ln levels), by which gaps are chosen.

        In a mean a single run on a higher branch counts, which the median of three runs ignores.
        """
        steps = np.array(sorted(self.levels))
        return steps, np.array([self.mean(n) for n in steps.tolist()])

    def mean(self, step: float) -> float:
        """Return the mean of ln levels at a gap.

        If `CHECK_MEMBERS` or more ran, their standard deviation beyond `ONE_BRANCH` is added:
        members on two branches then count almost as the upper branch, because few members do not
        determine the share of each.
        """
        logarithms = np.log(self.levels[step])
        mean = float(np.mean(logarithms))
        if len(logarithms) < CHECK_MEMBERS:
            return mean
        return mean + max(0.0, float(np.std(logarithms, ddof=1)) - ONE_BRANCH)

    def groups_near(self, step: float) -> list[Array]:
        """Return the levels of the gaps whose spread is used as that of a gap.

        They are the gaps within `POOLED` steps, or all gaps if these have few runs.

        Far down the cliff the spread is another one: members part between two regimes.
        """
        near = [levels for n, levels in self.levels.items() if abs(n - step) <= POOLED]
        freedoms = sum(len(levels) - 1 for levels in near)
        return near if freedoms >= LEAST_FREEDOMS else list(self.levels.values())

    def is_allowed(self, step: float) -> bool:
        """Return whether a gap keeps the limits."""
        return self.excess.get(step, 0.0) <= 0

    def worst(self, step: float, tolerance: float) -> float:
        """Return the largest level over the tolerance of the force, by means of ln levels.

        It is at least the median at the force itself (see `means`), because a median of few members
        does not show a branch that every other run is on. NaN if the level of a gap needed for it
        is not known.
        """
        level = float(np.median(self.levels[step]))
        if tolerance == 0:
            return level
        steps, levels = self.means()
        largest = worst_level(STEP * steps, levels, STEP * step, tolerance, self.power)
        return float(np.maximum(level, largest))

    def cost(self, step: float) -> float:
        """Return the mean ln level of a gap, increased if it breaks a limit."""
        excess = max(0.0, self.excess.get(step, 0.0))
        return self.mean(step) + PENALTY * excess


POOLED = 3.0  # steps
LEAST_FREEDOMS = 4
PENALTY = 10.0  # on ln of the level, times ln of the quantity over its limit


def level_between(ln_gaps: Array, ln_levels: Array, at: ArrayLike, power: float = 1.0) -> Array:
    """Return levels at ln gaps by linear interpolation in the logarithms of both.

    Beyond the widest gap the level is proportional to the gap's ``power``. Below the narrowest gap
    it is NaN.
    """
    x = np.asarray(at, dtype=np.float64)
    beyond = np.where(x < ln_gaps[0] - 1e-9, np.nan, power * np.maximum(x - ln_gaps[-1], 0))
    return np.asarray(np.exp(np.interp(x, ln_gaps, ln_levels) + beyond))


def worst_level(
    ln_gaps: Array, ln_levels: Array, at: ArrayLike, tolerance: float, power: float = 1.0
) -> Array:
    """Return the largest level over the tolerance of the force, of gaps at ln gaps.

    It is the largest for the force times (1 - tolerance), 1 and (1 + tolerance), and NaN if a
    neighbouring gap is not known.
    """
    x = np.asarray(at, dtype=np.float64)
    every = [
        k**power * level_between(ln_gaps, ln_levels, x - np.log(k), power)
        for k in (1 - tolerance, 1.0, 1 + tolerance)
    ]
    return np.asarray(np.max(every, axis=0))


def find_best(
    samples: LevelSamples, tolerance: float, members: int = 1, between: bool = False
) -> tuple[float, float]:
    """Return the steps with the lowest level (sharp) and the lowest `worst_level` (robust).

    They are chosen from the gaps that were run with at least ``members`` members. ``between``: the
    robust gap may lie between gaps that were run. Gaps that break a limit count only if there are
    no others. Raises ValueError if no gap has so many members.
    """
    steps, levels = samples.means()
    ran = [n for n in steps.tolist() if len(samples.levels[n]) >= members]
    allowed = [n for n in ran if samples.is_allowed(n)] or ran
    sharp = min(allowed, key=samples.cost)
    candidates = np.array(allowed)
    if between and all(samples.is_allowed(n) for n in steps.tolist()):
        whole = np.arange(math.ceil(steps[0]), math.floor(steps[-1]) + 1)
        candidates = np.union1d(candidates, whole)
    robust = worst_level(STEP * steps, levels, STEP * candidates, tolerance, samples.power)
    if np.isnan(robust).all():
        return float(sharp), float(max(allowed))
    penalty = [PENALTY * max(0.0, samples.excess.get(n, 0.0)) for n in candidates.tolist()]
    return float(sharp), float(candidates[np.nanargmin(np.log(robust) + penalty)])


def bracket(
    run_at: Callable[[int], float],
    start: int,
    ends: tuple[int, int] | None = None,
    wide_runs: bool = True,
) -> dict[int, float]:
    """Return the costs (ln of levels) by step around the lowest cost.

    The neighbours of the lowest are then `NEAR`. These are parts 1 and 2 of the search above.

    ``ends``: the narrowest and the widest step; ``wide_runs`` False: from the start and its
    neighbours alone, in one basin.
    """
    narrowest, widest = ends or (start + NARROWEST, start + WIDEST)
    levels: dict[int, float] = {}

    def cost_at(n: int) -> float:
        if n not in levels:
            levels[n] = run_at(n)
        return levels[n]

    looks = FIRST_RUNS if wide_runs else FIRST_RUNS[:2]
    for n in looks:
        cost_at(min(max(start + n, narrowest), widest))
    ends = (narrowest, widest)
    best = min(levels, key=lambda n: levels[n])
    _refine(levels, cost_at, best, ends)
    best = min(levels, key=lambda n: levels[n])
    others = [n for n in _local_minima(levels) if abs(n - best) >= WIDE]
    lowest = levels[best]
    if wide_runs and others and levels[others[0]] <= lowest + math.log(SECOND_BASIN):
        _refine(levels, cost_at, others[0], ends)
    return levels


def _local_minima(levels: dict[int, float]) -> list[int]:
    """Return the steps whose neighbours both cost more, the cheapest first."""
    steps = sorted(levels)
    minima = [
        n
        for k, n in enumerate(steps)
        if all(levels[n] < levels[m] for m in steps[max(k - 1, 0) : k + 2] if m != n)
    ]
    return sorted(minima, key=lambda n: levels[n])


def _refine(
    levels: dict[int, float],
    cost_at: Callable[[int], float],
    basin: int,
    ends: tuple[int, int],
) -> None:
    """Bracket a local minimum that lies at an end of the tried steps, and refine it.

    The intervals to both sides are halved, the wider first, down to `NEAR`.
    """
    best = basin
    while True:
        steps = sorted(levels)
        at = steps.index(best)
        if at == 0 and best > ends[0]:
            neighbour = max(best - WIDE, ends[0])
        elif at == len(steps) - 1 and best < ends[1]:
            neighbour = min(best + WIDE, ends[1])
        else:
            below = best - steps[at - 1] if at > 0 else 0
            above = steps[at + 1] - best if at + 1 < len(steps) else 0
            if max(below, above) <= NEAR:
                return
            neighbour = best - below // 2 if below >= above else best + above // 2
        if cost_at(neighbour) < levels[best]:
            best = neighbour


def gaps_to_run(samples: LevelSamples, tolerance: float, members: int) -> list[float]:
    """Return the gaps on which the answers rest and that lack members, the most important first."""
    sharp, robust = find_best(samples, tolerance, between=True)
    wanted = [sharp, robust]
    if tolerance > 0:
        steps = np.array(sorted(samples.levels))
        narrower = robust - np.log1p(tolerance) / STEP  # the device under a larger force
        wanted.append(float(steps[np.argmin(np.abs(steps - narrower))]))
    return [n for n in dict.fromkeys(wanted) if len(samples.levels.get(n, ())) < members]


def search_gaps(
    run: RunGap,
    start: int,
    tolerance: float,
    members: int,
    pairs: int,
    samples: LevelSamples,
    ends: tuple[int, int] | None = None,
    also: float | None = None,
) -> None:
    """Fill ``samples`` from the step ``start``, as the module describes.

    ``pairs`` is the number of sweeps up and down after which only runs of the checks are added, at
    most `CHECK_PAIRS`. ``ends`` are the steps of the narrowest and the widest gap; ``also`` is a
    further step, that of the design rule's gap, which is run if it lies between.
    """
    narrowest, widest = ends or (start + NARROWEST, start + WIDEST)

    def run_members(n: float, number: int) -> float:
        samples.levels[n] = run(n, number)
        return samples.cost(n)

    if also is not None and narrowest <= also <= widest:
        run_members(also, 1)
    costs = bracket(lambda n: run_members(n, 1), start, (narrowest, widest))
    best = min(costs, key=lambda n: costs[n])
    if best > narrowest:
        run_members(best - 1, 1)  # is the foot of the cliff there?

    def has_answer() -> bool:
        return any(len(levels) >= members for levels in samples.levels.values())

    def add_members(most: int, neighbours: bool) -> None:
        """Run missing members of the chosen gaps, one at a time, up to ``most`` in total."""
        while True:
            missing = gaps_to_run(samples, tolerance, members)
            if neighbours and not missing and has_answer():
                missing = _neighbours(samples, tolerance, members, (narrowest, widest))
            if not missing or samples.runs >= most:
                return
            n = missing[0]
            run_members(n, len(samples.levels.get(n, ())) + 1)

    add_members(pairs, neighbours=True)
    if not has_answer():
        run_members(find_best(samples, tolerance)[0], members)
    if tolerance == 0 or members == 1:
        return

    checked: set[float] = set()
    for _ in range(CHECKS):
        _, robust = find_best(samples, tolerance, members)
        if robust in checked:
            return
        checked.add(robust)
        # by the scaling law a narrower gap has the level, over the force, of this gap under the
        # largest force of the tolerance; a step that was run takes its place if it is close
        narrower = robust - math.log1p(tolerance) / STEP
        nearest = min(samples.levels, key=lambda n: abs(n - narrower))
        if abs(nearest - narrower) <= SAME_STEP_TOL:
            narrower = nearest
        run_members(narrower, max(CHECK_MEMBERS, members))
        add_members(pairs + CHECK_PAIRS, neighbours=False)


def _neighbours(
    samples: LevelSamples, tolerance: float, members: int, ends: tuple[int, int]
) -> list[float]:
    """Return the neighbours of the answers that lack members."""
    sharp, robust = find_best(samples, tolerance, members)
    near = [sharp - 1, sharp + 1, robust - 1, robust + 1]
    return [
        n
        for n in dict.fromkeys(near)
        if ends[0] <= n <= ends[1] and len(samples.levels.get(n, ())) < members
    ]
