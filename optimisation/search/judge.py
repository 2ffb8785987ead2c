"""A search's finalists judged again on fresh members: the best of many noisy values is biased.

The finalists of a study run again with members of the ensemble that the search has not used, and
the best of them is the winner. Its value is then computed with further new members, which are also
used for the designs to which it is compared. A gain is the ratio of two designs' values with a
bootstrap interval (`optimisation.measures`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import count, require
from impact_env.ensemble import Executor, Members
from optimisation.absorber_rules import Baselines
from optimisation.files import number
from optimisation.insight import Levels, Sensitivity
from optimisation.measures import LEVEL, LEVEL_RATIO, Gain, prediction_interval, ratio_of_quantiles
from optimisation.objectives import Condition, Score
from optimisation.problem import Problem, Progress, evaluate
from optimisation.search.settings import EvaluatedDesign, seed_of
from optimisation.service import Service, with_more_modes
from optimisation.space import FRICTION_LIMIT, GAP, Design, parts_of

if TYPE_CHECKING:
    from optimisation.search.study import DesignStudy

Array = NDArray[np.float64]
FINALISTS = 5
AUDITED = 8
# sets of fresh members: one chooses among the finalists, one judges the choice (2 is
# `insight.REPORT_SEEDS`)
CHOICE = 0
VERDICT = 1
AUDIT = 3


@dataclass(frozen=True, eq=False)
class JudgedDesign:
    """A design with its results for new members.

    Attributes
    ----------
    design : Design
        The design.
    score : Score
        Its score.
    members : array, (objectives, M)
        Value of each objective and member.
    levels, without : array, (M, conditions)
        Level in m at the place of the response, the larger of up and down, with the device and
        without absorber.
    ratios : array, (conditions,)
        Median over the members of the frequency at the level's maximum over the resonance; 0 under
        loads.
    alike : tuple of JudgedDesign
        Similar designs, whose spread is used if there are few members.
    """

    design: Design
    score: Score
    members: Array
    levels: Array
    without: Array
    ratios: Array
    alike: tuple[JudgedDesign, ...] = ()

    @property
    def bands(self) -> list[tuple[float, float]]:
        """Ends of the interval that holds 90 % of fresh runs, for each objective.

        They are NaN if the spread is not known.
        """
        return [
            prediction_interval(row, [other.members[k] for other in self.alike])
            for k, row in enumerate(self.members)
        ]

    @property
    def level_bands(self) -> Array:
        """Ends of the interval that holds 90 % of fresh levels in m, (2, conditions).

        They are NaN if the spread is not known.
        """
        ends = [
            prediction_interval(column, [other.levels[:, k] for other in self.alike])
            for k, column in enumerate(self.levels.T)
        ]
        return np.array(ends).reshape(-1, 2).T


@dataclass(frozen=True, eq=False)
class Verdict:
    """The winner of a study, the paper's design and the space's start, for the same new members.

    The winner is the best of the search's designs and these two with other new members (`verdict`).
    ``search_best`` is the search's best design with its score in the search. If no design satisfies
    the constraints, the winner is the one with the smallest violation, and `feasible` is False.
    """

    search_best: EvaluatedDesign
    winner: JudgedDesign
    paper: JudgedDesign
    # where the search begins unless it is from scratch: the paper's design scaled to the structure
    rule: JudgedDesign
    share: float = 0.5  # of the members that the first objective's value is the quantile of

    @property
    def feasible(self) -> bool:
        """Whether the winner satisfies all constraints with new members."""
        return self.winner.score.feasible

    def levels(self, conditions: Sequence[Condition]) -> Levels:
        """Return the levels of winner and paper's design, (2, conditions).

        They are those under the problem's own ``conditions``.
        """
        both = (self.winner, self.paper)
        median = np.array([np.median(one.levels, axis=0) for one in both])
        low, high = np.moveaxis(np.array([one.level_bands for one in both]), 1, 0)
        without = np.median(self.winner.without, axis=0)
        ratios = np.array([one.ratios for one in both])
        return Levels(tuple(conditions), median, low, high, without, ratios)

    def gain_over(self, other: JudgedDesign) -> Gain:
        """Return the ratio of the winner's first objective to that of another design.

        It has a 95 % bootstrap interval.
        """
        return ratio_of_quantiles(self.winner.members[0], other.members[0], self.share)

    @property
    def gain(self) -> Gain:
        """Winner over paper's design."""
        return self.gain_over(self.paper)


def judge_designs(
    problem: Problem,
    designs: Sequence[Design],
    ensemble: Members,
    executor: Executor,
    progress: Progress | None = None,
) -> list[JudgedDesign]:
    """Run designs at the problem's own rate on these members."""
    reference = problem.reference(ensemble, problem.rate)
    results: dict[int, JudgedDesign] = {}
    for k, measured in evaluate(problem, designs, ensemble, problem.rate, executor, progress):
        values = problem.member_values(measured, ensemble, problem.rate)
        at = problem.measures.index(LEVEL)
        level, without = (array[..., at].max(axis=2) for array in (measured, reference))
        worse = np.argmax(measured[..., at], axis=2)[..., None]
        read = np.take_along_axis(measured[..., problem.measures.index(LEVEL_RATIO)], worse, axis=2)
        results[k] = JudgedDesign(
            designs[k],
            problem.score(designs[k], measured, ensemble, problem.rate),
            values,
            level,
            without,
            np.median(read[..., 0], axis=0),
        )
    return [results[k] for k in range(len(designs))]


def rank_on_fresh_members(
    problem: Problem,
    designs: Sequence[Design],
    executor: Executor,
    progress: Progress | None = None,
) -> dict[int, JudgedDesign]:
    """Run designs on members that neither the search nor the final judgement uses.

    The results are returned by the number of the design, best first.
    """
    ensemble = problem.fresh_ensemble(problem.members, CHOICE)
    again = judge_designs(problem, designs, ensemble, executor, progress)
    costs = [problem.penalised_cost(one.score) for one in again]
    return {k: again[k] for k in sorted(range(len(designs)), key=lambda k: (costs[k], k))}


def best_candidates(
    problem: Problem, candidates: Sequence[EvaluatedDesign], number: int
) -> list[EvaluatedDesign]:
    """Return the best of a search's designs by the results of the search.

    Designs that break constraints come last, in the order of their violation.
    """
    ranked = sorted(candidates, key=lambda e: (problem.penalised_cost(e.score), e.number))
    return ranked[:number]


def verdict(
    problem: Problem,
    candidates: Sequence[EvaluatedDesign],
    executor: Executor,
    finalists: int = FINALISTS,
    progress: Progress | None = None,
) -> Verdict:
    """Choose a winner among the best candidates, and judge it.

    It is chosen from the best ``finalists`` of the candidates, the paper's design and the start of
    the space.

    Fresh members rank them, and yet other members judge the first of the ranking: the least of
    several noisy values would be biased. A design that breaks a constraint there gives way to the
    next. Raises ParameterError if there are no candidates.
    """
    finalists = count("finalists", finalists, 1)
    require(len(candidates) > 0, "candidates", 0, "one design or more")
    best = best_candidates(problem, candidates, finalists)
    paper = problem.space.paper
    start = problem.space.default
    designs = [*(e.design for e in best), paper, start]
    ranked = rank_on_fresh_members(problem, designs, executor, progress)
    ranking = list(ranked)
    alike = tuple(one for k, one in ranked.items() if k < len(best))
    search_best = best[next(k for k in ranking if k < len(best))]

    ensemble = problem.fresh_ensemble(problem.members, VERDICT)
    first = list(dict.fromkeys([ranking[0], len(best), len(best) + 1]))
    again = judge_designs(problem, [designs[k] for k in first], ensemble, executor, progress)
    known = dict(zip(first, again, strict=True))
    tried = []
    for k in ranking:
        if k not in known:
            (known[k],) = judge_designs(problem, [designs[k]], ensemble, executor, progress)
        if k < len(best):
            known[k] = replace(known[k], alike=alike)
        tried.append(known[k])
        if known[k].score.feasible:
            break
    winner = min(tried, key=lambda one: (problem.penalised_cost(one.score), tried.index(one)))
    share = problem.objectives[0].share
    return Verdict(search_best, winner, known[len(best)], known[len(best) + 1], share)


REPAIRS = 8  # gaps that are tried for a design that breaks a constraint
# of the gap that the scaling law gives for the broken constraint: the narrowest that is tried, and
# of the design's own the widest
REPAIR_SPAN = (0.8, 1.05)


def propose_repairs(problem: Problem, candidates: Sequence[EvaluatedDesign]) -> list[Design]:
    """Return designs to try if no candidate satisfies the constraints.

    They are the candidate with the smallest violation, with other gaps. By the scaling law stroke
    and speeds are proportional to the gap, so for a quantity s times its limit the gap is divided
    by s; friction limits are proportional to it. Empty if a candidate satisfies all constraints,
    and for concepts without walls.
    """
    best = min(candidates, key=lambda e: (problem.penalised_cost(e.score), e.number))
    gaps = [name for name in best.design.values if parts_of(name)[0] == GAP]
    if best.score.feasible or best.score.failed or not gaps:
        return []
    factor = 1 / (1 + max(best.score.violations))
    designs = []
    for scale in np.geomspace(REPAIR_SPAN[0] * factor, REPAIR_SPAN[1], REPAIRS):
        values = dict(best.design.values)
        for name in values:
            if parts_of(name)[0] in (GAP, FRICTION_LIMIT) and name not in problem.space.fixed:
                values[name] *= float(scale)
        designs.append(Design(best.design.concept, values))
    return designs


def add_repairs(
    problem: Problem,
    candidates: Sequence[EvaluatedDesign],
    executor: Executor,
    progress: Progress | None = None,
) -> list[EvaluatedDesign]:
    """Return the candidates and proposed repairs, run on the members of the search."""
    designs = propose_repairs(problem, candidates)
    if not designs:
        return list(candidates)
    ensemble = problem.ensemble
    number = 1 + max(e.number for e in candidates)
    added = []
    for k, measured in evaluate(problem, designs, ensemble, problem.rate, executor, progress):
        score = problem.score(designs[k], measured, ensemble, problem.rate)
        added.append(EvaluatedDesign(number + k, designs[k], score, 1))
    return [*candidates, *sorted(added, key=lambda e: e.number)]


@dataclass(frozen=True, eq=False)
class MoreModes:
    """Results of a winner with more ``modes`` than in the search.

    It is judged on the same members. ``change``: change of its value with a bootstrap interval.
    """

    modes: int
    judged: JudgedDesign
    change: Gain


def more_modes(
    problem: Problem,
    winner: JudgedDesign,
    share: float,
    executor: Executor,
    progress: Progress | None = None,
) -> MoreModes | None:
    """Run a winner again with twice the modes, as far as the elements allow.

    The result is None if the structure has no more modes.
    """
    beam = with_more_modes(problem.beam)
    if beam is None:
        return None
    (judgement,) = judge_designs(
        replace(problem, beam=beam),
        [winner.design],
        problem.fresh_ensemble(problem.members, VERDICT),
        executor,
        progress,
    )
    return MoreModes(
        beam.modes, judgement, ratio_of_quantiles(judgement.members[0], winner.members[0], share)
    )


@dataclass(frozen=True)
class Audit:
    """Results of designs that were abandoned early and then run in full.

    ``designs`` is their number, ``missed`` the number of those better than the best design, and
    ``rank_correlation`` that of their values before and after.
    """

    designs: int
    missed: int
    rank_correlation: float


def audit(
    study: DesignStudy, executor: Executor, designs: int = AUDITED, progress: Progress | None = None
) -> Audit:
    """Run some of a study's abandoned designs in full.

    This test uses fresh members, on which the best design found is run as well.

    It shows what the shortcut cost.

    The designs are drawn at random from the better half of those that stopped on each rung, where a
    mistake is most likely.
    """
    problem = study.problem
    complete = study.complete
    stopped = [
        e for e in study.evaluated if e.rungs < len(study.settings.rungs) and e.score.feasible
    ]
    by_rung = {
        r: sorted((e for e in stopped if e.rungs == r), key=lambda e: problem.cost(e.score))
        for r in {e.rungs for e in stopped}
    }
    pool = [e for r in sorted(by_rung) for e in by_rung[r][: max(1, len(by_rung[r]) // 2)]]
    if not pool or not complete:
        return Audit(0, 0, float("nan"))
    generator = np.random.default_rng(seed_of(study.settings.seed, 1))
    drawn = [
        pool[k] for k in sorted(generator.choice(len(pool), min(designs, len(pool)), replace=False))
    ]
    best_design = min(complete, key=lambda e: problem.cost(e.score))
    ensemble = problem.fresh_ensemble(problem.members, AUDIT)
    *again, winner = judge_designs(
        problem, [*(e.design for e in drawn), best_design.design], ensemble, executor, progress
    )
    best = problem.cost(winner.score)
    missed = sum(problem.cost(j.score) < best for j in again)
    costs = [problem.cost(e.score) for e in drawn]
    full = [problem.cost(j.score) for j in again]
    return Audit(
        len(drawn),
        missed,
        float(scipy.stats.spearmanr(costs, full).statistic) if len(drawn) > 2 else float("nan"),
    )


@dataclass(frozen=True, eq=False)
class Cost:
    """Cost of a search.

    It has the designs, runs and seconds of this session. ``overhead``: share of the seconds that
    was not spent in runs.
    """

    designs: int
    runs: int
    seconds: float
    overhead: float

    def describe(self) -> dict[str, object]:
        """Return it as JSON values."""
        return {
            **asdict(self),
            "seconds": round(self.seconds, 2),
            "overhead": number(round(self.overhead, 4)),
        }


@dataclass(frozen=True, eq=False)
class SearchResult:
    """All results on one concept, judged on fresh members.

    A result that was not computed, or was interrupted, is None.
    """

    problem: Problem
    evaluated: list[EvaluatedDesign]
    finished: bool
    cost: Cost
    verdict: Verdict | None = None
    audit: Audit | None = None
    wider: MoreModes | None = None
    service: Service | None = None
    curves: tuple[Levels, ...] | None = None  # over the force, one for each condition
    detuned: tuple[Levels, ...] | None = None
    gap_map: tuple[Levels, ...] | None = None
    gaps: tuple[float, ...] = ()
    sensitivity: Sensitivity | None = None
    baselines: tuple[Baselines | None, ...] = ()  # by condition, None under loads

    @cached_property
    def own(self) -> Levels | None:
        """Levels of winner and paper's design under the problem's own conditions.

        They are those of the members that judged the two designs.
        """
        return None if self.verdict is None else self.verdict.levels(self.problem.conditions)
