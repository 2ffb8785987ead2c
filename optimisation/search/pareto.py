"""A Pareto study: search, run the front again on fresh members, compare with random search of the same budget; and the study as numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor
from optimisation.files import Table, numbers
from optimisation.insight import watched
from optimisation.measures import LEVEL, TOLD
from optimisation.objectives import Objective, Score
from optimisation.problem import Problem
from optimisation.progress import runs_bar
from optimisation.report.design_tables import limit, name_of
from optimisation.search.find import BARS, identity, searched
from optimisation.search.judge import Cost, Judged, judged
from optimisation.search.ledger import Ledger, remembering
from optimisation.search.settings import (
    NSGA2,
    RANDOM,
    SAMPLERS,
    Evaluated,
    SearchSettings,
    default_settings,
    hypervolume,
    nondominated,
)

Array = NDArray[np.float64]
Json = dict[str, object]


@dataclass(frozen=True, eq=False)
class Front:
    """A study of two objectives: all designs, the indices of those not dominated, and these and the paper's design on fresh members.

    ``corner`` is what hypervolumes refer to, ``volume`` that of the front as the search saw it; ``against`` has seed, hypervolume of the method and
    of a random search with the same budget, both of their fronts run again on fresh members. ``borne``: `Service.watched` of some designs, by
    their number.
    """

    problem: Problem
    told: list[Evaluated]
    finished: bool
    cost: Cost
    index: list[int]
    corner: tuple[float, float]
    volume: float
    fresh: list[Judged] | None = None
    paper: Judged | None = None
    against: tuple[tuple[int, float, float], ...] = ()
    borne: tuple[tuple[int, dict[str, Array]], ...] = ()

    @property
    def fresh_volume(self) -> float | None:
        """Hypervolume of the front on fresh members; None if they were not run."""
        return (
            None
            if self.fresh is None
            else hypervolume(
                signed(self.problem, [judged.score for judged in self.fresh]), self.corner
            )
        )

    @property
    def members(self) -> list[Evaluated]:
        """The designs that are not dominated, by the first objective."""
        return [self.told[k] for k in self.index]

    @property
    def won(self) -> int:
        """In how many seeds the method's hypervolume is larger than that of the random search."""
        return sum(mine > random for _, mine, random in self.against)


def signed(problem: Problem, scores: Sequence[Score]) -> Array:
    """Return the costs of scores, (scores, objectives); infinite where a constraint is broken."""
    signs = np.array([-1.0 if o.maximise else 1.0 for o in problem.objectives])
    rows = np.array(
        [
            score.values if score.feasible else np.full(len(signs), np.inf) * signs
            for score in scores
        ]
    ).reshape(-1, len(signs))
    return np.asarray(rows * signs)


def front_table(front: Front) -> Table:
    """Return a table with a row for each design, by number; an empty cell where it did not run on fresh members."""
    fresh = {} if front.fresh is None else dict(zip(front.index, front.fresh, strict=True))
    free = [v.name for v in front.problem.space.free]
    names = [name_of(objective) for objective in front.problem.objectives]
    rows = []
    for k, e in enumerate(front.told):
        again = fresh[k].score.values if k in fresh else [""] * len(names)
        rows.append(
            [
                e.number,
                *(e.design.values[name] for name in free),
                *e.score.values,
                int(k in front.index),
                *again,
            ]
        )
    return ["number", *free, *names, "on_front", *(f"{name}_fresh" for name in names)], rows


def front_summary(front: Front) -> Json:
    """Return the study's result as JSON values."""
    rows: list[Json] = [
        {"number": e.number, "values": dict(e.design.values), "score": numbers(e.score.values)}
        for e in front.members
    ]
    for row, judge in zip(rows, front.fresh or (), strict=False):
        row["score_on_fresh_members"] = numbers(judge.score.values)
    return {
        "problem": front.problem.describe(),
        "finished": front.finished,
        **front.cost.describe(),
        "front": rows,
        "paper": None if front.paper is None else numbers(front.paper.score.values),
        "hypervolume": {
            "corner": list(front.corner),
            "front": front.volume,
            "front_on_fresh_members": front.fresh_volume,
        },
        "against_random": [
            {"seed": seed, "method": mine, "random": random} for seed, mine, random in front.against
        ],
        "seeds_won_against_random": front.won if front.against else None,
    }


def front_text(front: Front) -> str:
    """Return the study's result as a text to read."""
    problem = front.problem
    cost = front.cost
    lines = [f"{problem.space.concept}: " + " against ".join(o.label for o in problem.objectives)]
    lines.append(
        f"  {cost.designs} designs, {cost.runs} runs, {cost.seconds:.0f} s, {100 * cost.overhead:.1f} % of it outside the runs"
    )
    for condition in problem.conditions:
        ratio = problem.sweep_ratio(condition)
        if condition.loads is not None:
            lines.append(f"  under {condition.words}; the level is the {TOLD[condition.told[0]]}")
            continue
        lines.append(
            f"  resonance {condition.resonance}: sweeps show {ratio:.3f} of the stationary level without absorber"
        )
    names = [name_of(objective) for objective in problem.objectives]
    header = [*(v.name for v in problem.space.free), *names, *(f"{name} fresh" for name in names)]
    lines.append("  " + "  ".join(f"{name:>14}" for name in header))
    for k, e in enumerate(front.members):
        again = [] if front.fresh is None else list(front.fresh[k].score.values)
        values = [*(e.design.values[v.name] for v in problem.space.free), *e.score.values, *again]
        lines.append("  " + "  ".join(f"{value:14.4g}" for value in values))
    if front.paper is not None:
        lines.append(
            "  paper's design on fresh members: "
            + ", ".join(f"{x:.4g}" for x in front.paper.score.values)
        )
    fresh = "" if front.fresh_volume is None else f", {front.fresh_volume:.4g} on fresh members"
    lines.append(
        f"  hypervolume {front.volume:.4g}{fresh} up to the corner {front.corner[0]:g}, {front.corner[1]:g}"
    )
    for seed, mine, random in front.against:
        lines.append(
            f"  seed {seed}: {mine:.4g}, random search {random:.4g}, {100 * (mine / random - 1):+.1f} %"
            if random > 0
            else f"  seed {seed}"
        )
    if front.against:
        lines.append(
            f"  larger hypervolume than a random search with the same budget in {front.won} of {len(front.against)} seeds"
        )
    return "\n".join(lines)


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
    with remembering(executor, identity(problem, settings.describe()), journal) as ledger:
        study, finished, cost = searched("search", problem, settings, designs, ledger, BARS)
    told = study.told
    rows = signed(problem, [e.score for e in told])
    best = {
        tuple(rows[k]): int(k)
        for k in np.flatnonzero(nondominated(rows))[::-1]
        if np.isfinite(rows[k]).all()
    }  # NSGA-II repeats designs
    index = [best[values] for values in sorted(best)]
    return Front(problem, told, finished, cost, index, corner, hypervolume(rows, corner))


def judge_front(front: Front, executor: Executor) -> Front:
    """Run the front and the paper's design again, on twice as many members as the search had, none of which it has seen."""
    problem = front.problem
    designs = [e.design for e in front.members]
    with runs_bar("front on fresh members") as show:
        *fresh, paper = judged(
            problem,
            [*designs, problem.space.paper],
            problem.fresh_ensemble(2 * problem.members, 0),
            executor,
            show,
        )
    return replace(front, fresh=fresh, paper=paper)


def borne_along(front: Front, executor: Executor) -> Front:
    """Run what is best for either objective, and the middle of the front, for what they bear, which is told under a force alone."""
    if front.problem.under_loads:
        return front
    chosen = [front.members[k] for k in sorted({0, len(front.index) // 2, len(front.index) - 1})]
    borne = []
    for one in chosen:
        with runs_bar(f"what design {one.number} bears") as show:
            borne.append(
                (
                    one.number,
                    watched(replace(front.problem, uncertain={}), one.design, executor, show)[0],
                )
            )
    return replace(front, borne=tuple(borne))


def compare_with_random(
    front: Front, settings: SearchSettings, seeds: int, executor: Executor
) -> Front:
    """Search again with other seeds, by the method and at random, with the same budget; what counts is each one's front on fresh members."""
    problem = front.problem
    wanted = len(front.told)
    batch = settings.batch if settings.sampler != RANDOM else default_settings(problem, NSGA2).batch
    rows: list[tuple[int, float, float]] = []
    for seed in range(settings.seed, settings.seed + seeds):
        found = []
        for sampler in (settings.sampler, RANDOM):
            own = default_settings(problem, sampler, batch, seed)
            study, finished, _ = searched(
                f"seed {seed}, {SAMPLERS[sampler]}", problem, own, wanted, Ledger(executor), BARS
            )
            if not finished:
                return replace(front, against=tuple(rows), finished=False)
            rows_of = signed(problem, [e.score for e in study.told])
            best = [
                study.told[k].design
                for k in np.flatnonzero(nondominated(rows_of))
                if np.isfinite(rows_of[k]).all()
            ]
            with runs_bar(f"seed {seed}, {SAMPLERS[sampler]}, on fresh members") as show:
                again = judged(
                    problem, best, problem.fresh_ensemble(2 * problem.members, 0), executor, show
                )
            found.append(
                hypervolume(signed(problem, [judge.score for judge in again]), front.corner)
            )
        rows.append((seed, found[0], found[1]))
    return replace(front, against=tuple(rows))


def bounds_of(front: Front) -> NDArray[np.float64]:
    """Return the stationary limits of the designs on the front, (designs, 2), as relative levels; NaN where the closed form does not apply."""
    problem = front.problem
    without = problem.reference(problem.ensemble[:1], problem.rate)[
        0, :, :, problem.measures.index(LEVEL)
    ].max(axis=1)
    rows = []
    for judge in front.fresh or []:
        relative = [
            limit(problem, judge.design, c) / float(w)
            for c, w in zip(problem.conditions, without, strict=True)
        ]
        own = [
            max(relative[k] for k in o.chosen(problem.conditions)) if o.kind == "level" else x
            for o, x in zip(problem.objectives, judge.score.values, strict=True)
        ]
        rows.append(own)
    return np.array(rows)
