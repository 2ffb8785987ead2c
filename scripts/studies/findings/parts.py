"""The studies behind docs/findings.md.

Each returns all numbers of its figure and its table as JSON values, in SI units.
"""

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.checks import ParameterError
from impact_env.drive import PAPER_LIMITS, PAPER_RATE
from impact_env.ensemble import Executor, Threads
from impact_env.extras import optional
from impact_env.parameters import RigidWalls
from optimisation.absorber_rules import best_friction
from optimisation.bounds import design_force, design_gap
from optimisation.checkpoint import peak_memory
from optimisation.comparison import WIDE_LIMITS
from optimisation.executors import Bar, runs_bar
from optimisation.files import number, read_json
from optimisation.insight import (
    Levels,
    detuned_conditions,
    levels,
    member_levels,
    over_force,
    stationary_limit,
    with_gaps,
)
from optimisation.objectives import Condition
from optimisation.problem import Problem, evaluate
from optimisation.report.design_report import summary
from optimisation.report.front_report import bounds_of, front_summary
from optimisation.search.find import BARS, SearchOptions, find
from optimisation.search.judge import Audit, SearchResult
from optimisation.search.pareto import (
    BY_RESONANCE,
    CORNER,
    FORCES,
    compare_with_random,
    judge_front,
    search_front,
)
from optimisation.search.settings import CMA, RANDOM, default_settings
from optimisation.space import (
    FRICTION,
    FRICTION_LIMIT,
    GAP,
    IMPACT,
    MASS_RATIO,
    POSITION,
    SEVERAL,
    TUNED,
    VARIABLES,
    WITH_IMPACTS,
    Design,
    design_space,
)
from optimisation.tuned import minimax
from studies.study import Json, not_none
from studies.timing import time_call, time_in_turn

AT = ((1, 3.5), (2, 35.0))  # resonance and force in N: the paper's optimum at either
Point = tuple[int, float]
Bounds = Mapping[str, tuple[float, float]]
WIDE = (0.02, 100.0)  # N: from a damper that slides all the time to one that sticks
# forces of the limit's curve; members where a point is one of a hundred and its run is recorded
DENSE = 60
LEAST = 2
# times the designs for a pair of absorbers: with as many as for one its search ends above two equal
# halves
PAIRS = 1.5
SPAN = 5.0  # curves reach from a force over this to the force times this


def make_conditions(concept: str, at: Sequence[Point]) -> tuple[Condition, ...]:
    """Return conditions over the frequency range of the paper.

    For a tuned absorber the sweep is wider, so that it passes both peaks.
    """
    limits = WIDE_LIMITS if concept == TUNED else PAPER_LIMITS
    return tuple(Condition(resonance, force, limits) for resonance, force in at)


def choose_sampler(problem: Problem) -> str | None:
    """Return the sampler of the page's searches.

    It is CMA-ES for impact absorbers, random search for one variable, and otherwise the default
    (None).
    """
    if problem.space.concept not in WITH_IMPACTS:
        return None
    return CMA if len(problem.space.free) > 1 else RANDOM


@dataclass(frozen=True)
class FindingsSettings:
    """Folders and sizes of the studies.

    ``folder`` has the journals and ``data`` the numbers of earlier parts; the robustness is that of
    the designs in them. A search has ``designs``, each with ``members``. Figures with many
    ``points`` use ``few`` members.
    """

    executor: Executor
    folder: Path
    designs: int
    members: int
    few: int
    points: int
    data: Path
    rate: float = PAPER_RATE
    seed: int = 0
    quick: bool = False

    def problem(
        self,
        concept: str,
        at: Sequence[Point],
        free: Sequence[str] | None = None,
        bounds: Bounds | None = None,
        members: int | None = None,
    ) -> Problem:
        """Return the problem of a concept at resonances and forces (N).

        Its objective is the larger of the relative levels at these conditions.
        """
        space = design_space(concept, free, bounds)
        conditions = make_conditions(concept, list(at))
        return Problem(
            space, conditions, members=members or self.members, seed=self.seed, rate=self.rate
        )

    def find(self, name: str, problem: Problem, designs: int | None = None) -> SearchResult:
        """Search from scratch and judge the result.

        Raises KeyboardInterrupt if the search is interrupted. The journal contains what is
        finished.
        """
        journal = self.folder / f"{name}.journal"
        result = find(
            problem,
            SearchOptions(
                designs or self.designs, choose_sampler(problem), seed=self.seed, from_scratch=True
            ),
            journal,
            self.executor,
            BARS,
        )
        if not result.finished or result.verdict is None:
            raise KeyboardInterrupt
        return result


def _numbers(values: np.ndarray) -> list[Any]:
    """Return an array as nested lists, None where a run broke down."""
    return (
        [_numbers(row) for row in values]
        if values.ndim > 1
        else [number(x) for x in values.tolist()]
    )


def _summarise_search(result: SearchResult) -> Json:
    verdict = not_none(result.verdict)
    members = {
        "members_winner": _numbers(verdict.winner.members[0]),
        "members_paper": _numbers(verdict.paper.members[0]),
    }
    return summary(result) | members


def _listed(part: Levels) -> Json:
    axes = {
        "force_n": [c.force for c in part.conditions],
        "detuning": [c.detuning for c in part.conditions],
    }
    values = {name: _numbers(getattr(part, name)) for name in ("median", "low", "high", "without")}
    return {"resonance": part.conditions[0].resonance} | axes | values


def concepts(study: FindingsSettings) -> Json:
    """Search the best design of each concept for both resonances at the paper's mass.

    The search is from scratch. The result also has the levels over the force.
    """
    result: Json = {}
    for concept in VARIABLES:
        problem = study.problem(concept, AT)
        results = study.find(
            f"concepts-{concept}",
            problem,
            round((PAIRS if concept == SEVERAL else 1) * study.designs),
        )
        both = [not_none(results.verdict).winner.design, not_none(results.verdict).paper.design]
        curves = []
        for condition in problem.conditions:
            conditions = over_force(
                condition,
                np.geomspace(condition.force / SPAN, condition.force * SPAN, study.points),
            )
            with runs_bar(f"{concept}: levels over the force") as show:
                part = levels(problem, both, conditions, study.few, study.executor, show)
            forces = np.geomspace(
                condition.force / SPAN, condition.force * SPAN, DENSE
            )  # of the limit of the winner's cavity, None: no closed form
            reach = [
                number(stationary_limit(problem, both[0], c)) for c in over_force(condition, forces)
            ]
            curves.append(_listed(part) | {"limit_force_n": forces.tolist(), "limit_m": reach})
        result[concept] = _summarise_search(results) | {"curves": curves}
    return result


def optima(study: FindingsSettings) -> Json:
    """Search the best friction limit, gap and force at each resonance alone.

    The search is from scratch. The results are compared with the paper and with rules.
    """
    rows = [_friction_optimum(study, resonance, force) for resonance, force in AT]
    return {
        "friction": rows,
        "impact": [_impact_optimum(study, resonance, force) for resonance, force in AT],
    }


def _friction_optimum(study: FindingsSettings, resonance: int, force: float) -> Json:
    problem = study.problem(FRICTION, [(resonance, force)], bounds={FRICTION_LIMIT: WIDE})
    result = study.find(f"optima-{FRICTION}-{resonance}", problem)
    (variable,) = problem.space.free
    limits = [variable.value_at(share) for share in np.linspace(0, 1, 4 * study.points)]
    with runs_bar("friction damper: levels over the friction limit") as show:
        part = levels(
            problem,
            [problem.space.design({FRICTION_LIMIT: x}) for x in limits],
            problem.conditions,
            study.few,
            study.executor,
            show,
        )
    argued, level = best_friction(
        problem.model,
        problem.space.paper.values[MASS_RATIO] * problem.model.beam_mass,
        force,
        resonance,
    )
    curve = {"friction_limit_n": limits, "relative": part.relative[:, 0].tolist()}
    return _summarise_search(result) | {
        "resonance": resonance,
        "force_n": force,
        "argued_n": argued,
        "argued_level_m": level,
        "curve": curve,
    }


def _impact_optimum(study: FindingsSettings, resonance: int, force: float) -> Json:
    """Search the best force for the paper's absorber, and the best absorber for the force.

    The best force is found for each member.
    """
    problem = study.problem(IMPACT, [(resonance, force)])
    mass = problem.space.paper.values[MASS_RATIO] * problem.model.beam_mass
    rule = design_force(problem.model, mass, RigidWalls.gap, resonance)
    forces = rule * np.geomspace(0.5, 1.8, 2 * study.points)
    with runs_bar(f"resonance {resonance}: levels over the force") as show:
        worse, without = member_levels(
            problem,
            [problem.space.paper],
            over_force(problem.conditions[0], forces),
            2 * study.few,
            study.executor,
            show,
        )
    relative = worse[0] / without
    low, median, high = np.quantile(relative, (0.05, 0.5, 0.95), axis=0)
    curve = {
        "force_n": forces.tolist(),
        "low": low.tolist(),
        "median": median.tolist(),
        "high": high.tolist(),
    }
    best = forces[np.argmin(relative, axis=1)]
    result = study.find(f"optima-{resonance}", problem)
    rules = {"rule_force_n": rule, "rule_gap_m": design_gap(problem.model, mass, force, resonance)}
    bests = {
        "best_force_n": float(forces[np.argmin(median)]),
        "best_force_5_to_95_percent_n": np.quantile(best, (0.05, 0.95)).tolist(),
    }
    return (
        _summarise_search(result)
        | {"resonance": resonance, "force_n": force}
        | rules
        | bests
        | {"curve": curve}
    )


def place(study: FindingsSettings) -> Json:
    """The best gap at each position along the beam, and a search with the position free."""
    least = min(LEAST, study.few)
    problem = study.problem(IMPACT, AT, (GAP, POSITION), members=least)
    positions = np.round(np.linspace(0.4, 1.0, study.points // 2 + 1), 4)
    gaps = np.geomspace(2e-4, 1.6e-3, study.points)
    designs = [
        Design(IMPACT, {**design.values, POSITION: float(x)})
        for x in positions
        for design in with_gaps(problem.space.paper, gaps)
    ]
    with runs_bar("levels over position and gap") as show:
        part = levels(problem, designs, problem.conditions, least, study.executor, show)
    relative = part.relative.reshape(len(positions), len(gaps), len(AT))
    bounds = (
        np.array(
            [
                [stationary_limit(problem, design, condition) for condition in problem.conditions]
                for design in designs
            ]
        )
        / part.without
    )
    shapes = [
        problem.space.design({GAP: 1e-3, POSITION: float(x)})
        .scene(problem.beam)
        .model.tip_shape[:2]
        .tolist()
        for x in positions
    ]
    free = study.problem(
        IMPACT, AT, (GAP, "restitution", FRICTION_LIMIT, POSITION), members=2 * study.few
    )
    result = study.find("place", free, max(2, 3 * study.designs // 4))
    arrays = {
        "positions": positions,
        "gaps_m": gaps,
        "relative": relative,
        "limit": bounds.reshape(relative.shape),
    }
    mass = problem.space.paper.values[MASS_RATIO] * problem.model.beam_mass
    return {name: array.tolist() for name, array in arrays.items()} | {
        "shapes": shapes,
        "mass_kg": mass,
        "free": _summarise_search(result),
    }


def robustness(study: FindingsSettings) -> Json:
    """Compute levels near the first resonance of beams with shifted frequencies.

    The designs are the winners and those of the paper.
    """
    path = study.data / "concepts.json.gz"
    rows = list[Json]()
    try:
        earlier = dict(read_json(path))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ParameterError(
            f"{path} is not allowed: a file that an earlier run of this command wrote ({error})"
        ) from error
    for concept in VARIABLES:
        problem = study.problem(concept, AT[:1], members=study.few)
        named = {
            "winner": Design(concept, earlier[concept]["winner"]["values"]),
            "paper": problem.space.paper,
        }
        if concept == TUNED:
            tuned = minimax(problem.model)
            values = {
                **problem.space.paper.values,
                "stiffness": tuned.stiffness,
                "damping": tuned.damping,
            }
            named["tuned to the first resonance"] = Design(TUNED, values)
        with runs_bar(f"{concept}: detuned beams") as show:
            conditions = detuned_conditions(
                problem.conditions[0], np.linspace(-0.1, 0.1, 2 * (study.points // 2) + 1)
            )
            part = levels(
                problem, list(named.values()), conditions, study.few, study.executor, show
            )
        listed = _listed(part)
        selection = {
            "concept": concept,
            "detuning": listed["detuning"],
            "without": listed["without"],
        }
        rows += [
            selection | {"name": name} | {key: listed[key][d] for key in ("median", "low", "high")}
            for d, name in enumerate(named)
        ]
    return {"designs": rows, "force_n": AT[0][1]}


WORKERS = (1, 2)
FRONT_MEMBERS = 2
FRONT_DESIGNS = 300
SEEDS = 5
FULL = 2000


@contextmanager
def _cluster(workers: int) -> Iterator[Executor]:
    with optional():
        import distributed  # slow to import

        from optimisation.search.cluster import Workers

    local = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        dashboard_address=":0",
        silence_logs=50,
    )
    with local, Workers(local.scheduler_address) as executor:
        yield executor


def scaling(study: FindingsSettings) -> Json:
    """Measure the time of one batch of random designs with one and two workers.

    Threads and worker processes of a cluster are timed in turn.
    """
    problem = study.problem(IMPACT, AT, members=study.few)
    generator = np.random.default_rng(study.seed)
    designs = [
        problem.space.at(shares)
        for shares in generator.random((2 * study.points, len(problem.space.free)))
    ]
    with ExitStack() as stack:
        kinds: dict[str, list[Executor]] = {"threads": [Threads(n) for n in WORKERS]}
        kinds["cluster"] = [stack.enter_context(_cluster(n)) for n in WORKERS]
        for executor in (
            e for group in kinds.values() for e in group
        ):  # workers load their kernels
            dict(evaluate(problem, designs[:4], problem.ensemble[:1], 10 * problem.rate, executor))

        def once(executor: Executor) -> float:
            return time_call(
                lambda: dict(evaluate(problem, designs, problem.ensemble, problem.rate, executor))
            )

        batches = {
            (kind, n): partial(once, executor)
            for kind, group in kinds.items()
            for n, executor in zip(WORKERS, group, strict=True)
        }
        with Bar(total=3, desc="scaling", unit="rounds", leave=False) as bar:
            times = time_in_turn(batches, 3, bar.update)
    speedup = {
        kind: statistics.median(times[kind, 1]) / statistics.median(times[kind, 2])
        for kind in kinds
    }
    runs = 2 * len(designs) * len(problem.ensemble) * len(problem.conditions)
    rows = [
        {"kind": kind, "workers": n, "seconds": statistics.median(s), "all_s": s}
        for (kind, n), s in times.items()
    ]
    return {"designs": len(designs), "runs": runs, "rows": rows, "speedup": speedup}


def full(study: FindingsSettings) -> Json:
    """Measure a robust two-resonance study of full size by CMA-ES.

    The result has the time, the share of it outside the runs, and the memory.
    """
    problem = study.problem(IMPACT, AT)
    began = time.perf_counter()
    plan = SearchOptions(FULL if study.designs >= 100 else study.designs, CMA, seed=study.seed)
    result = find(problem, plan, study.folder / "full.journal", study.executor, BARS)
    if not result.finished or result.verdict is None:
        raise KeyboardInterrupt
    wall = time.perf_counter() - began
    audit = result.audit or Audit(0, 0, float("nan"))
    winner = result.verdict.winner
    size = {
        "designs": result.cost.designs,
        "variables": len(problem.space.free),
        "members": problem.members,
        "modes": problem.beam.modes,
    }
    cost = {
        "runs": result.cost.runs,
        "search_s": result.cost.seconds,
        "with_judging_s": wall,
        "overhead": result.cost.overhead,
    }
    left = {
        "left_behind": {"run_in_full": audit.designs, "better_than_best_found": audit.missed},
        "memory_bytes": peak_memory(),
    }
    best = {
        "winner": dict(winner.design.values),
        "score": winner.score.values[0],
        "score_5_to_95_percent": list(winner.bands[0]),
    }
    return size | cost | left | best


def front(study: FindingsSettings) -> Json:
    """Compute the front of the levels at the first and second resonance, and its hypervolume.

    The hypervolume is compared with that of random searches with the same budget.
    """
    members = min(FRONT_MEMBERS, study.members)
    problem = replace(study.problem(IMPACT, FORCES, members=members), objectives=BY_RESONANCE)
    settings = default_settings(problem, seed=study.seed)
    designs, seeds = (FRONT_DESIGNS, SEEDS) if study.designs >= 100 else (study.designs, 2)
    result = search_front(
        problem, settings, designs, CORNER, study.folder / "front.journal", study.executor
    )
    result = (
        compare_with_random(judge_front(result, study.executor), settings, seeds, study.executor)
        if result.finished
        else result
    )
    if not result.finished:
        raise KeyboardInterrupt
    arrays: dict[str, Any] = {
        "labels": [o.label for o in problem.objectives],
        "front_scores": [list(e.score.values) for e in result.members],
        "searched": [list(e.score.values) for e in result.evaluated],
        "fresh": [list(judged.score.values) for judged in not_none(result.fresh)],
        "bound": bounds_of(result).tolist(),
    }
    return front_summary(result) | arrays
