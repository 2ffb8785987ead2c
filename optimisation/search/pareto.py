"""A Pareto study: a search, its front on fresh members, and a comparison.

The comparison is with random search of the same budget.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from impact_env.extras import optional
from optimisation.checkpoint import RunCache, open_run_cache
from optimisation.executors import runs_bar
from optimisation.objectives import Objective, Score
from optimisation.problem import Problem
from optimisation.search.find import BARS, identity, run_study
from optimisation.search.judge import Cost, JudgedDesign, judge_designs
from optimisation.search.settings import (
    NSGA2,
    RANDOM,
    SAMPLERS,
    EvaluatedDesign,
    SearchSettings,
    default_settings,
)
from optimisation.service import service_measures

Array = NDArray[np.float64]


def hypervolume(costs: Array, corner: tuple[float, float]) -> float:
    """Return the area between costs (N, 2), to be minimised, and a corner.

    Rows that are not better than the corner in both costs do not count.
    """
    with optional():
        import moocore
    rows = costs[np.isfinite(costs).all(axis=1)]
    return float(moocore.hypervolume(rows, ref=corner)) if len(rows) else 0.0


def find_front(costs: Array) -> list[int]:
    """Return the indices of the finite rows of costs (N, K) that no other row dominates.

    They are in the order of the costs. Of equal rows the first one counts.
    """
    with optional():
        import moocore
    finite = np.flatnonzero(np.isfinite(costs).all(axis=1))
    if not finite.size:
        return []
    front = finite[moocore.is_nondominated(costs[finite], keep_weakly=True)]
    first = {tuple(costs[k]): int(k) for k in front[::-1]}
    return [first[values] for values in sorted(first)]


@dataclass(frozen=True, eq=False)
class Front:
    """A study of two objectives.

    Attributes
    ----------
    problem : Problem
        The problem.
    evaluated : list of EvaluatedDesign
        All designs.
    index : list of int
        Indices of designs that are not dominated.
    corner, volume : (float, float) and float
        Reference point of hypervolumes, and the hypervolume of the front in the search.
    fresh, paper : list of JudgedDesign and JudgedDesign, or None
        Results of the front and of the paper's design for new members.
    against : tuple
        Seed, hypervolume of the method and of a random search with the same number of runs, both
        with new members.
    service : dict
        `Service.measures` of some designs, by index.
    """

    problem: Problem
    evaluated: list[EvaluatedDesign]
    finished: bool
    cost: Cost
    index: list[int]
    corner: tuple[float, float]
    volume: float
    fresh: list[JudgedDesign] | None = None
    paper: JudgedDesign | None = None
    against: tuple[tuple[int, float, float], ...] = ()
    service: tuple[tuple[int, dict[str, Array]], ...] = ()

    @property
    def fresh_volume(self) -> float | None:
        """Hypervolume of the front on fresh members; None if they were not run."""
        return (
            None
            if self.fresh is None
            else hypervolume(
                signed_costs(self.problem, [one.score for one in self.fresh]), self.corner
            )
        )

    @property
    def members(self) -> list[EvaluatedDesign]:
        """The designs that are not dominated, by the first objective."""
        return [self.evaluated[k] for k in self.index]

    @property
    def won(self) -> int:
        """In how many seeds the method's hypervolume is larger than that of the random search."""
        return sum(mine > random for _, mine, random in self.against)


def signed_costs(problem: Problem, scores: Sequence[Score]) -> Array:
    """Return the costs of scores, (scores, objectives); infinite where a constraint is broken."""
    signs = np.array([-1.0 if o.maximise else 1.0 for o in problem.objectives])
    rows = np.array(
        [
            score.values if score.feasible else np.full(len(signs), np.inf) * signs
            for score in scores
        ]
    ).reshape(-1, len(signs))
    return np.asarray(rows * signs)


FORCES = (
    (1, 3.5),
    (2, 15.0),
)  # in N: each the design force of its resonance for one gap would leave nothing to trade
BY_RESONANCE = (Objective(resonance=1), Objective(resonance=2))
CORNER = (1.1, 1.1)  # relative levels: what hypervolumes refer to


def search_front(
    problem: Problem,
    settings: SearchSettings,
    designs: int,
    corner: tuple[float, float],
    journal: Path | None,
    executor: Executor,
) -> Front:
    """Search; the front is that of all designs that were run, by the members of the search."""
    with open_run_cache(executor, identity(problem, settings.describe()), journal) as cache:
        study, finished, cost = run_study("search", problem, settings, designs, cache, BARS)
    evaluated = study.evaluated
    rows = signed_costs(problem, [e.score for e in evaluated])
    volume = hypervolume(rows, corner)
    return Front(problem, evaluated, finished, cost, find_front(rows), corner, volume)


def judge_front(front: Front, executor: Executor) -> Front:
    """Run the front and the paper's design again on fresh members.

    They are twice as many members as in the search, none of which the search has used.
    """
    problem = front.problem
    designs = [e.design for e in front.members]
    with runs_bar("front on fresh members") as show:
        *fresh, paper = judge_designs(
            problem,
            [*designs, problem.space.paper],
            problem.fresh_ensemble(2 * problem.members, 0),
            executor,
            show,
        )
    return replace(front, fresh=fresh, paper=paper)


def front_service_loads(front: Front, executor: Executor) -> Front:
    """Compute the service loads of three designs of the front.

    They are the best for either objective and the middle one. Nothing is computed under loads, only
    under a force.
    """
    if front.problem.under_loads:
        return front
    chosen = [front.members[k] for k in sorted({0, len(front.index) // 2, len(front.index) - 1})]
    service = []
    for one in chosen:
        with runs_bar(f"what design {one.number} bears") as show:
            service.append(
                (
                    one.number,
                    service_measures(
                        replace(front.problem, uncertain={}), one.design, executor, show
                    )[0],
                )
            )
    return replace(front, service=tuple(service))


def compare_with_random(
    front: Front, settings: SearchSettings, seeds: int, executor: Executor
) -> Front:
    """Search again with other seeds, by the method and at random, with the same budget.

    The fronts are compared on fresh members.
    """
    problem = front.problem
    wanted = len(front.evaluated)
    batch = settings.batch if settings.sampler != RANDOM else default_settings(problem, NSGA2).batch
    rows: list[tuple[int, float, float]] = []
    for seed in range(settings.seed, settings.seed + seeds):
        volumes = []
        for sampler in (settings.sampler, RANDOM):
            own = default_settings(problem, sampler, batch, seed)
            study, finished, _ = run_study(
                f"seed {seed}, {SAMPLERS[sampler]}", problem, own, wanted, RunCache(executor), BARS
            )
            if not finished:
                return replace(front, against=tuple(rows), finished=False)
            rows_of = signed_costs(problem, [e.score for e in study.evaluated])
            best = [study.evaluated[k].design for k in find_front(rows_of)]
            with runs_bar(f"seed {seed}, {SAMPLERS[sampler]}, on fresh members") as show:
                again = judge_designs(
                    problem, best, problem.fresh_ensemble(2 * problem.members, 0), executor, show
                )
            volumes.append(
                hypervolume(signed_costs(problem, [judge.score for judge in again]), front.corner)
            )
        rows.append((seed, volumes[0], volumes[1]))
    return replace(front, against=tuple(rows))
