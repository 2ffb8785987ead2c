"""What a Pareto study does: search, run the front again on fresh members, and compare with random search of the same budget."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from optimisation.measures import LEVEL
from optimisation.objectives import Objective
from optimisation.problem import Problem
from optimisation.progress import runs_bar
from optimisation.report.design_tables import limit
from optimisation.report.front_tables import Front, costs, signed
from optimisation.search.find import BARS, searched
from optimisation.search.judge import judged
from optimisation.search.settings import NSGA2, RANDOM, SAMPLERS, Settings, default_settings
from optimisation.search.told import hypervolume, nondominated
from optimisation.service import watched

FORCES = ((1, 3.5), (2, 15.0))  # in N: each the design force of its resonance for one gap would leave nothing to trade
BY_RESONANCE = (Objective(resonance=1), Objective(resonance=2))
CORNER = (1.1, 1.1)  # relative levels: what hypervolumes refer to


def search_front(problem: Problem, settings: Settings, designs: int, corner: tuple[float, float], journal: Path | None, executor: Executor) -> Front:
    """Search; the front is that of all designs that were run, by the members of the search."""
    with searched("search", problem, settings, designs, journal, executor, BARS) as (study, finished, cost):
        told = study.told
    rows = costs(problem, told)
    best = {tuple(rows[k]): int(k) for k in np.flatnonzero(nondominated(rows))[::-1] if np.isfinite(rows[k]).all()}  # NSGA-II repeats designs
    index = [best[values] for values in sorted(best)]
    return Front(problem, told, finished, cost, index, corner, hypervolume(rows, corner))


def judge_front(front: Front, executor: Executor) -> Front:
    """Run the front and the paper's design again, on twice as many members as the search had, none of which it has seen."""
    problem = front.problem
    designs = [e.design for e in front.members]
    with runs_bar("front on fresh members") as show:
        *fresh, paper = judged(problem, [*designs, problem.space.paper], problem.fresh_ensemble(2 * problem.members, 0), executor, show)
    return replace(front, fresh=fresh, paper=paper)


def borne_along(front: Front, executor: Executor) -> Front:
    """Run what is best for either objective, and the middle of the front, for what they bear, which is told under a force alone."""
    if front.problem.under_loads:
        return front
    chosen, borne = [front.members[k] for k in sorted({0, len(front.index) // 2, len(front.index) - 1})], []
    for one in chosen:
        with runs_bar(f"what design {one.number} bears") as show:
            borne.append((one.number, watched(replace(front.problem, uncertain={}), one.design, executor, show)[0]))
    return replace(front, borne=tuple(borne))


def compare_with_random(front: Front, settings: Settings, seeds: int, executor: Executor) -> Front:
    """Search again with other seeds, by the method and at random, with the same budget; what counts is each one's front on fresh members."""
    problem, wanted = front.problem, len(front.told)
    batch = settings.batch if settings.sampler != RANDOM else default_settings(problem, NSGA2).batch
    rows: list[tuple[int, float, float]] = []
    for seed in range(settings.seed, settings.seed + seeds):
        found = []
        for sampler in (settings.sampler, RANDOM):
            own = default_settings(problem, sampler, batch, seed)
            with searched(f"seed {seed}, {SAMPLERS[sampler]}", problem, own, wanted, None, executor, BARS) as (study, finished, _cost):
                if not finished:
                    return replace(front, against=tuple(rows), finished=False)
                rows_of = costs(problem, study.told)
                best = [study.told[k].design for k in np.flatnonzero(nondominated(rows_of)) if np.isfinite(rows_of[k]).all()]
            with runs_bar(f"seed {seed}, {SAMPLERS[sampler]}, on fresh members") as show:
                again = judged(problem, best, problem.fresh_ensemble(2 * problem.members, 0), executor, show)
            found.append(hypervolume(signed(problem, [judge.score for judge in again]), front.corner))
        rows.append((seed, found[0], found[1]))
    return replace(front, against=tuple(rows))


def bounds_of(front: Front) -> NDArray[np.float64]:
    """Return the stationary limits of the designs on the front, (designs, 2), as relative levels; NaN where the closed form does not apply."""
    problem = front.problem
    without = problem.reference(problem.ensemble[:1], problem.rate)[0, :, :, problem.measures.index(LEVEL)].max(axis=1)
    rows = []
    for judge in front.fresh or []:
        relative = [limit(problem, judge.design, c) / float(w) for c, w in zip(problem.conditions, without, strict=True)]
        own = [
            max(relative[k] for k in o.chosen(problem.conditions)) if o.kind == "level" else x
            for o, x in zip(problem.objectives, judge.score.values, strict=True)
        ]
        rows.append(own)
    return np.array(rows)
