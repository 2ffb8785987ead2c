"""A Pareto study as numbers: rows for a CSV file, a summary for JSON, and a text to read. SI units, unless named."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optimisation.load_measures import TOLD
from optimisation.objectives import Score
from optimisation.problem import Problem
from optimisation.report.design_tables import number
from optimisation.search.judge import Judged
from optimisation.search.result import Cost
from optimisation.search.told import Evaluated, hypervolume

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
        return None if self.fresh is None else hypervolume(signed(self.problem, [judged.score for judged in self.fresh]), self.corner)

    @property
    def members(self) -> list[Evaluated]:
        """The designs that are not dominated, by the first objective."""
        return [self.told[k] for k in self.index]

    @property
    def won(self) -> int:
        """In how many seeds the method's hypervolume is larger than that of the random search."""
        return sum(mine > random for _, mine, random in self.against)


def costs(problem: Problem, told: Sequence[Evaluated]) -> Array:
    """Return the costs of both objectives, (designs, 2); infinite for designs that break a constraint."""
    return signed(problem, [e.score for e in told])


def signed(problem: Problem, scores: Sequence[Score]) -> Array:
    """Return the costs of scores, (scores, objectives); infinite where a constraint is broken."""
    signs = np.array([-1.0 if o.maximise else 1.0 for o in problem.objectives])
    rows = np.array([score.values if score.feasible else np.full(len(signs), np.inf) * signs for score in scores]).reshape(-1, len(signs))
    return np.asarray(rows * signs)


def front_columns(problem: Problem) -> list[str]:
    """Return the columns of `front_rows`."""
    names = [_name(problem, k) for k in range(len(problem.objectives))]
    return ["number", *(v.name for v in problem.space.free), *names, "on_front", *(f"{name}_fresh" for name in names)]


def _name(problem: Problem, k: int) -> str:
    objective = problem.objectives[k]
    return objective.kind if objective.resonance is None else f"{objective.kind}_{objective.resonance}"


def front_rows(front: Front) -> Iterator[list[object]]:
    """Yield a row for each design, by number; an empty cell where it did not run on fresh members."""
    fresh = {} if front.fresh is None else dict(zip(front.index, front.fresh, strict=True))
    for k, e in enumerate(front.told):
        again = fresh[k].score.values if k in fresh else [""] * len(front.problem.objectives)
        yield [e.number, *(e.design.values[v.name] for v in front.problem.space.free), *e.score.values, int(k in front.index), *again]


def front_summary(front: Front) -> Json:
    """Return the study's result as JSON values."""
    rows = []
    for k, e in enumerate(front.members):
        row: Json = {"number": e.number, "values": dict(e.design.values), "score": [number(x) for x in e.score.values]}
        if front.fresh is not None:
            row["score_on_fresh_members"] = [number(x) for x in front.fresh[k].score.values]
        rows.append(row)
    return {
        "problem": front.problem.describe(),
        "finished": front.finished,
        "designs": front.cost.designs,
        "runs": front.cost.runs,
        "seconds": round(front.cost.seconds, 2),
        "overhead": number(round(front.cost.overhead, 4)),
        "front": rows,
        "paper": None if front.paper is None else [number(x) for x in front.paper.score.values],
        "hypervolume": {"corner": list(front.corner), "front": front.volume, "front_on_fresh_members": front.fresh_volume},
        "against_random": [{"seed": seed, "method": mine, "random": random} for seed, mine, random in front.against],
        "seeds_won_against_random": front.won if front.against else None,
    }


def front_text(front: Front) -> str:
    """Return the study's result as a text to read."""
    problem, cost = front.problem, front.cost
    lines = [f"{problem.space.concept}: " + " against ".join(o.label for o in problem.objectives)]
    lines.append(f"  {cost.designs} designs, {cost.runs} runs, {cost.seconds:.0f} s, {100 * cost.overhead:.1f} % of it outside the runs")
    for condition in problem.conditions:
        ratio = problem.sweep_ratio(condition)
        if condition.loads is not None:
            lines.append(f"  under {condition.words}; the level is the {TOLD[condition.told[0]]}")
            continue
        lines.append(f"  resonance {condition.resonance}: sweeps show {ratio:.3f} of the stationary level without absorber")
    header = [*(v.name for v in problem.space.free), *(_name(problem, k) for k in range(2)), *(f"{_name(problem, k)} fresh" for k in range(2))]
    lines.append("  " + "  ".join(f"{name:>14}" for name in header))
    for k, e in enumerate(front.members):
        again = [] if front.fresh is None else list(front.fresh[k].score.values)
        values = [*(e.design.values[v.name] for v in problem.space.free), *e.score.values, *again]
        lines.append("  " + "  ".join(f"{value:14.4g}" for value in values))
    if front.paper is not None:
        lines.append("  paper's design on fresh members: " + ", ".join(f"{x:.4g}" for x in front.paper.score.values))
    fresh = "" if front.fresh_volume is None else f", {front.fresh_volume:.4g} on fresh members"
    lines.append(f"  hypervolume {front.volume:.4g}{fresh} up to the corner {front.corner[0]:g}, {front.corner[1]:g}")
    for seed, mine, random in front.against:
        lines.append(f"  seed {seed}: {mine:.4g}, random search {random:.4g}, {100 * (mine / random - 1):+.1f} %" if random > 0 else f"  seed {seed}")
    if front.against:
        lines.append(f"  larger hypervolume than a random search with the same budget in {front.won} of {len(front.against)} seeds")
    return "\n".join(lines)
