"""What a search found, judged again: the best of many noisy values is too good to be true.

The finalists of a study run again on members of the ensemble that the search has not seen, and the best of them there is the
winner. What the winner is worth is then read from yet other members, on which the paper's design runs as well, member by member.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from impact_env.curve import BAND
from impact_env.ensemble import Members
from impact_env.parameters import count, require
from optimisation.designs import Design
from optimisation.evaluation import Executor, Progress, evaluate
from optimisation.objectives import KINDS, Score
from optimisation.problem import Problem
from optimisation.search.samplers import seed_of
from optimisation.search.study import DesignStudy, Evaluated

Array = NDArray[np.float64]
FINALISTS, AUDITED = 5, 8
CHOICE, VERDICT = 0, 1  # two sets of fresh members: one chooses among the finalists, one judges the choice


@dataclass(frozen=True, eq=False)
class Judged:
    """A design on fresh members: its ``score`` and, for each objective, one value a member, ``members`` (objectives, M)."""

    design: Design
    score: Score
    members: Array

    @property
    def bands(self) -> list[tuple[float, float]]:
        """5 and 95 % quantiles of the members, for each objective."""
        return [(float(low), float(high)) for low, high in np.quantile(self.members, BAND, axis=1).T]


@dataclass(frozen=True, eq=False)
class Verdict:
    """The winner of a study, what the search thought of it, and winner and paper's design on the same fresh members."""

    found: Evaluated
    winner: Judged
    paper: Judged

    @property
    def gain(self) -> tuple[float, float, float]:
        """Winner over paper's design in the first objective: median and 5 to 95 % band over the members; NaN where the paper's is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.winner.members[0] / self.paper.members[0]
        if not np.all(np.isfinite(ratio)):
            return (float("nan"),) * 3
        middle, low, high = (float(x) for x in np.quantile(ratio, (0.5, *BAND)))
        return middle, low, high


def judged(problem: Problem, designs: Sequence[Design], ensemble: Members, executor: Executor, progress: Progress | None = None) -> list[Judged]:
    """Run designs at the problem's own rate on these members."""
    reference = problem.reference(ensemble, problem.rate)
    results: dict[int, Judged] = {}
    for k, measured in evaluate(problem, designs, ensemble, problem.rate, executor, progress):
        values = []
        for objective in problem.objectives:
            column = problem.measures.index(KINDS[objective.kind].measure)
            scale = reference[..., column].max(axis=2, keepdims=True) if KINDS[objective.kind].relative else 1.0
            values.append(objective.per_member(measured[..., column] / scale, problem.conditions))
        results[k] = Judged(designs[k], problem.score(designs[k], measured, ensemble, problem.rate), np.array(values))
    return [results[k] for k in range(len(designs))]


def verdict(
    problem: Problem, candidates: Sequence[Evaluated], executor: Executor, finalists: int = FINALISTS, progress: Progress | None = None
) -> Verdict:
    """Choose among the best ``finalists`` of the candidates and judge the choice; both on members that the search has not seen.

    Raises ParameterError if no design kept the constraints.
    """
    count("finalists", finalists, 1)
    require(len(candidates) > 0, "candidates", 0, "one design or more that keeps all constraints: loosen them, or search longer")
    best = sorted(candidates, key=lambda e: (problem.cost(e.score), e.number))[:finalists]
    again = judged(problem, [e.design for e in best], problem.fresh_ensemble(problem.members, CHOICE), executor, progress)
    chosen = min(range(len(best)), key=lambda k: (problem.cost(again[k].score), k))
    ensemble = problem.fresh_ensemble(problem.members, VERDICT)
    winner, paper = judged(problem, [best[chosen].design, problem.space.default], ensemble, executor, progress)
    return Verdict(best[chosen], winner, paper)


@dataclass(frozen=True)
class Audit:
    """Designs that were left behind, run in full: how many, how many of them beat the best found, and the rank correlation of both values."""

    designs: int
    missed: int
    rank_correlation: float


def audit(study: DesignStudy, executor: Executor, designs: int = AUDITED, progress: Progress | None = None) -> Audit:
    """Run some of the designs that a study left behind on all members at the problem's own rate: what did the shortcut cost?

    Drawn at random from the better half of those that stopped on each rung, where a mistake is most likely.
    """
    problem = study.problem
    complete = study.complete
    stopped = [e for e in study.told if e.rungs < len(study.settings.rungs) and e.score.feasible]
    by_rung = {r: sorted((e for e in stopped if e.rungs == r), key=lambda e: problem.cost(e.score)) for r in {e.rungs for e in stopped}}
    pool = [e for r in sorted(by_rung) for e in by_rung[r][: max(1, len(by_rung[r]) // 2)]]
    if not pool or not complete:
        return Audit(0, 0, float("nan"))
    generator = np.random.default_rng(seed_of(study.settings.seed, 1))
    drawn = [pool[k] for k in sorted(generator.choice(len(pool), min(designs, len(pool)), replace=False))]
    again = judged(problem, [e.design for e in drawn], problem.ensemble, executor, progress)
    best = min(problem.cost(e.score) for e in complete)
    missed = sum(problem.cost(j.score) < best for j in again)
    told, full = [problem.cost(e.score) for e in drawn], [problem.cost(j.score) for j in again]
    return Audit(len(drawn), missed, float(spearmanr(told, full).statistic) if len(drawn) > 2 else float("nan"))
