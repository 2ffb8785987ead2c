"""Compare search methods at equal cost, on four problems over ten seeds.

The methods are random search, CMA-ES, TPE, differential evolution and a Gaussian process.

All methods search from scratch, each until it has cost as much: members (a sweep up and a sweep
down per condition) at the usual rate, of which the fast ones of a screened design are parts. The
best five designs of each run again on fresh members, which chooses the winner, and its level is the
median of 16 others, as in `optimisation.search.judge.verdict`.
"""

# needs: optimise

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click
import numpy as np
import scipy

from impact_env.ensemble import Executor
from impact_env.parameters import Beam
from optimisation.checkpoint import sources
from optimisation.cli.common import cluster_option, command, threads_option
from optimisation.executors import executor
from optimisation.files import DOCS, publication_folder
from optimisation.objectives import Condition, Constraint
from optimisation.problem import Problem
from optimisation.search.gaussian_process import model_search
from optimisation.search.judge import (
    FINALISTS,
    best_candidates,
    judge_designs,
    rank_on_fresh_members,
)
from optimisation.search.settings import (
    CMA,
    RANDOM,
    EvaluatedDesign,
    Rung,
    SearchSettings,
    default_settings,
)
from optimisation.space import (
    FRICTION_LIMIT,
    GAP,
    MASS_RATIO,
    POSITION,
    RESTITUTION,
    Design,
    design_space,
)
from optimisation.sweep_range import find_sweep_range
from studies.structures import boom, close_plate
from studies.study import (
    Array,
    Json,
    Measurement,
    Study,
    format_table,
    make_rows_study,
    paths_next_to_page,
    run,
)

if TYPE_CHECKING:
    from optimisation.search.study import Sampler

# ``cost`` of a search in members at the usual rate; ``members`` of a design that is run in full;
# ``speed``: of the sweeps, over the usual rate
FULL: Json = {"cost": 160.0, "members": 8, "judging": 16, "seeds": 10, "speed": 6.0}
QUICK: Json = {"cost": 60.0, "members": 4, "judging": 8, "seeds": 2, "speed": 10.0}
UNSCREENED_MEMBERS = 2  # members of a design where no design is screened
JUDGING_SET = 4  # set of fresh members that judge the winners
BEAM_MODES = 2  # kept, and one more of the plate: a search costs seconds
BEAM_DAMPING = 0.02
RULE = "rule"  # the design that the rule gives, without a search


def paper_problem(members: int, seed: int) -> Problem:
    """Return the paper's beam at 3.5 N near its first resonance."""
    conditions = (Condition(1, 3.5),)
    beam = Beam(modes=BEAM_MODES)
    return Problem(design_space("impact"), conditions, beam=beam, members=members, seed=seed)


def boom_problem(members: int, seed: int) -> Problem:
    """Return the problem of a cantilever with a tip mass.

    It has five free variables, among them mass and place of the absorber.
    """
    names = [GAP, RESTITUTION, FRICTION_LIMIT, MASS_RATIO, POSITION]
    space = design_space("impact", names, {MASS_RATIO: (0.005, 0.03)})
    conditions = (Condition(1, 20.0),)
    beam = replace(boom(BEAM_DAMPING), modes=BEAM_MODES)
    return with_range(Problem(space, conditions, beam=beam, members=members, seed=seed), 0.03)


def plate_problem(members: int, seed: int) -> Problem:
    """Return a nearly square plate near its second resonance, 5 % below its third."""
    model = close_plate()
    names = ("omega", "force_shape", "tip_shape", "response_shape")
    rows = {name: getattr(model, name)[: BEAM_MODES + 1] for name in names}
    few = replace(model, damping_ratio=np.full(BEAM_MODES + 1, 0.015), **rows)
    conditions = (Condition(2, 60.0),)
    space = design_space("impact")
    return with_range(Problem(space, conditions, beam=few, members=members, seed=seed), 0.02)


def limited_problem(members: int, seed: int) -> Problem:
    """Return the problem of a beam at two resonances with constraints.

    They limit the impact speed and the power lost in impacts.
    """
    limits = (Constraint("impact_speed", 4.0), Constraint("impact_power", 7.5))
    conditions = (Condition(1, 5.0), Condition(2, 50.0))
    beam = Beam(modes=BEAM_MODES, damping_ratio=BEAM_DAMPING)
    space = design_space("impact")
    return Problem(space, conditions, constraints=limits, beam=beam, members=members, seed=seed)


def with_range(problem: Problem, mass_ratio: float) -> Problem:
    """Return a problem whose sweeps hold the peaks of absorbers up to a mass ratio."""
    conditions = tuple(
        replace(c, limits=find_sweep_range(problem.model, mass_ratio, c.resonance))
        for c in problem.conditions
    )
    return replace(problem, conditions=conditions)


PROBLEMS: dict[str, Callable[[int, int], Problem]] = {
    "paper's beam": paper_problem,
    "boom, 5 variables": boom_problem,
    "plate, close modes": plate_problem,
    "two resonances, limits": limited_problem,
}


class ComparisonSettings(NamedTuple):
    """Problems and sizes of the searches (`FULL`), and their executor."""

    executor: Executor
    problems: tuple[str, ...]
    cost: float
    members: int
    judging: int
    seeds: int
    speed: float

    @property
    def key_values(self) -> Json:
        """The settings on which numbers depend, in the form of the file."""
        return {name: x for name, x in self._asdict().items() if name != "executor"} | {
            "problems": list(self.problems)
        }


def batch_cost(settings: SearchSettings) -> float:
    """Return the cost of a batch, in members at the problem's own rate."""
    return settings.members_a_design * settings.batch


def run_study(
    problem: Problem,
    settings: SearchSettings,
    comparison: ComparisonSettings,
    sampler: Sampler | None = None,
) -> tuple[list[EvaluatedDesign], float]:
    """Search until the cost is reached; return the designs that can win, and the cost."""
    from optimisation.search.study import DesignStudy  # needs Optuna, which --help does not

    study = DesignStudy(problem, settings, sampler)
    batches = max(1, round(comparison.cost / batch_cost(settings)))
    if not study.run(1 + batches * settings.batch, comparison.executor):
        raise KeyboardInterrupt
    return study.complete or study.evaluated, batches * batch_cost(settings)


def search_screened(
    sampler: str, batch: int, problem: Problem, comparison: ComparisonSettings
) -> tuple[list[EvaluatedDesign], float]:
    """Search with successive halving of each batch."""
    settings = default_settings(problem, sampler, batch, problem.seed, from_scratch=True)
    return run_study(problem, settings, comparison)


def search_unscreened(
    sampler: str, batch: int, problem: Problem, comparison: ComparisonSettings
) -> tuple[list[EvaluatedDesign], float]:
    """Search with a few members for every design."""
    few = replace(problem, members=UNSCREENED_MEMBERS)
    settings = SearchSettings(
        sampler, batch, (Rung(UNSCREENED_MEMBERS),), problem.seed, from_scratch=True
    )
    return run_study(few, settings, comparison)


def search_tpe(
    problem: Problem, comparison: ComparisonSettings
) -> tuple[list[EvaluatedDesign], float]:
    """Search by Optuna's tree-structured Parzen estimator."""
    import optuna

    from optimisation.search.study import OptunaSampler, quiet_optuna

    few = replace(problem, members=UNSCREENED_MEMBERS)
    settings = SearchSettings(
        RANDOM, 4, (Rung(UNSCREENED_MEMBERS),), problem.seed, from_scratch=True
    )
    with quiet_optuna():
        tpe = optuna.samplers.TPESampler(multivariate=True, seed=problem.seed)
    sampler = OptunaSampler(len(problem.space.free), tpe, constraints=len(problem.constraints))
    return run_study(few, settings, comparison, sampler)


def search_differential_evolution(
    problem: Problem, comparison: ComparisonSettings
) -> tuple[list[EvaluatedDesign], float]:
    """Search by SciPy's differential evolution."""
    from optimisation.search.study import DesignStudy

    few = replace(problem, members=UNSCREENED_MEMBERS)
    size = len(problem.space.free)
    population = 4 * size
    settings = SearchSettings(
        RANDOM, population, (Rung(UNSCREENED_MEMBERS),), problem.seed, from_scratch=True
    )
    study = DesignStudy(few, settings)
    batches = max(2, round(comparison.cost / batch_cost(settings)))

    def costs(points: Array) -> Array:
        return study.run_batch(points.T, comparison.executor).penalised

    begin = scipy.stats.qmc.LatinHypercube(size, rng=problem.seed).random(population)
    scipy.optimize.differential_evolution(
        costs,
        [(0.0, 1.0)] * size,
        maxiter=batches - 1,
        init=begin,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=problem.seed,
    )
    cost = UNSCREENED_MEMBERS * float(len(study.evaluated))
    return study.complete or study.evaluated, cost


def search_model(
    problem: Problem, comparison: ComparisonSettings
) -> tuple[list[EvaluatedDesign], float]:
    """Search with a Gaussian process that runs one member at a time."""
    members = round(comparison.cost)
    _, ranked, finished = model_search(
        problem, members, comparison.executor, problem.seed, from_scratch=True
    )
    if not finished:
        raise KeyboardInterrupt
    return ranked, float(members)


Search = Callable[[Problem, ComparisonSettings], tuple[list[EvaluatedDesign], float]]
METHODS: dict[str, tuple[str, Search]] = {
    "random": ("random search", partial(search_unscreened, RANDOM, 8)),
    "cma": ("CMA-ES", partial(search_unscreened, CMA, 8)),
    "screened": ("CMA-ES, screened", partial(search_screened, CMA, 16)),
    "tpe": ("TPE", search_tpe),
    "de": ("differential evolution", search_differential_evolution),
    "gp": ("Gaussian process", search_model),
}


def judge_design(problem: Problem, design: Design, comparison: ComparisonSettings) -> Json:
    """Evaluate a design on fresh members.

    Return its median ``level``, and the relative amount by which it exceeds a limit.
    """
    fresh = problem.fresh_ensemble(comparison.judging, JUDGING_SET)
    (evaluated,) = judge_designs(problem, [design], fresh, comparison.executor)
    violation = max([0.0, *evaluated.score.violations])
    return {
        "level": evaluated.score.values[0],
        "violation": violation,
        "values": dict(design.values),
    }


def trial(name: str, method: str, seed: int, comparison: ComparisonSettings) -> list[Json]:
    """Return the one row of a search.

    It has the search's cost, the winner's level ``found`` by the search, its level when it was
    ``chosen``, and the judged ``level``.
    """
    problem = PROBLEMS[name](comparison.members, seed)
    problem = replace(problem, rate=comparison.speed * problem.rate)
    row: Json = {"problem": name, "method": method, "seed": seed}
    if method == RULE:
        return [row | judge_design(problem, problem.space.default, comparison)]
    candidates, cost = METHODS[method][1](problem, comparison)
    finalists = best_candidates(problem, candidates, FINALISTS)
    ranking = rank_on_fresh_members(problem, [e.design for e in finalists], comparison.executor)
    first, chosen = next(iter(ranking.items()))
    winner = finalists[first]
    own = {"cost": cost, "found": winner.score.values[0], "chosen": chosen.score.values[0]}
    return [row | own | judge_design(problem, winner.design, comparison)]


class Standing(NamedTuple):
    """Results of a method on one problem, or on all.

    ``levels`` are those of its winners over the seeds, and ``ratios`` are their ratios to random
    search, seed by seed.
    """

    problem: str
    method: str
    levels: list[float]
    ratios: list[float]

    @property
    def level(self) -> str:
        """Median, least and largest level in percent."""
        low, middle, high = np.quantile(np.array(self.levels) * 100, (0, 0.5, 1))
        return f"{middle:.1f} ({low:.1f} to {high:.1f})"

    @property
    def over_random(self) -> str:
        """Median ratio with its interval.

        The interval comes from order statistics and is exact for any distribution.
        """
        if not self.ratios:
            return "-"
        middle = float(np.median(self.ratios))
        interval = scipy.stats.quantile_test(self.ratios, p=0.5).confidence_interval(0.95)
        if not np.isfinite([interval.low, interval.high]).all():
            return f"{middle:.3f}"
        return f"{middle:.3f} ({interval.low:.3f} to {interval.high:.3f})"


def standings(rows: Sequence[Json]) -> list[Standing]:
    """Return the results of each method on each problem from the rows of `trial`.

    Within a problem the method with the lowest median level is first.
    """
    # a design that exceeds a limit by x percent counts x percent worse
    levels = {
        (r["problem"], r["method"], r["seed"]): r["level"] * (1 + r["violation"]) for r in rows
    }
    summaries = []
    for name in dict.fromkeys(r["problem"] for r in rows):
        own = []
        for method in dict.fromkeys(r["method"] for r in rows):
            seeds = [k for n, m, k in levels if (n, m) == (name, method)]
            mine = [levels[name, method, k] for k in seeds]
            pairs = [(name, REFERENCE, k) for k in seeds]
            ratios = [x / levels[p] for x, p in zip(mine, pairs, strict=True) if p in levels]
            own.append(Standing(name, method, mine, ratios))
        summaries += sorted((s for s in own if s.levels), key=lambda s: float(np.median(s.levels)))
    return summaries


def table(measured: Measurement) -> str:
    """Return a line for each method on each problem."""
    rows = [
        {
            "problem": s.problem,
            "label": LABELS[s.method],
            "seeds": len(s.levels),
            "level": s.level,
            "ratio": s.over_random,
        }
        for s in standings(measured.values["rows"])
    ]
    columns = {
        "problem": "{problem}",
        "method": "{label}",
        "seeds": "{seeds}",
        "level of the winner, %": "{level}",
        "over random search (95 %)": "{ratio}",
    }
    return format_table(columns, rows)


def summary(measured: Measurement) -> str:
    """Return a line for each method over all problems.

    It has the ratio to random search, the mean rank, and the relative errors of the winner's level
    as the search found it and as it was when chosen.
    """
    rows = measured.values["rows"]
    every = standings(rows)
    summaries: list[Json] = []
    for method in METHODS:
        own = [s for s in every if s.method == method]
        if not own:
            continue
        ranks = []
        for s in own:
            rivals = [o for o in every if o.problem == s.problem and o.method != RULE]
            ranks.append(1 + rivals.index(s))
        ratios = [x for s in own for x in s.ratios]
        mine = [r for r in rows if r["method"] == method]
        bias = {
            name: 100 * float(np.median([r[name] / r["level"] - 1 for r in mine]))
            for name in ("found", "chosen")
        }
        all_of_them = Standing("", method, [], ratios)
        summaries.append(
            {"label": LABELS[method], "ratio": all_of_them.over_random, "rank": np.mean(ranks)}
            | bias
        )
    columns = {
        "method": "{label}",
        "over random search, all problems (95 %)": "{ratio}",
        "mean rank": "{rank:.1f}",
        "level by the search, % off": "{found:+.1f}",
        "by the choice, % off": "{chosen:+.1f}",
    }
    return format_table(columns, sorted(summaries, key=itemgetter("rank")))


NAME = "search_methods"
QUICK_OUT = Path("results/search_methods")
OUT = publication_folder(DOCS, QUICK_OUT)
SECTION = "searches:levels"
OVERALL = "searches:summary"
MACHINE = "searches:machine"
REFERENCE = "random"
LABELS = {RULE: "the rule's design, no search"} | {name: own[0] for name, own in METHODS.items()}


def trials(comparison: ComparisonSettings) -> dict[tuple[str, str, int], Callable[[], list[Json]]]:
    """Return all searches, seed by seed, so that a run that is stopped has all methods."""
    every = product(range(comparison.seeds), comparison.problems, [RULE, *METHODS])
    return {
        (name, method, seed): partial(trial, name, method, seed, comparison)
        for seed, name, method in every
    }


STUDY: Study[ComparisonSettings] = make_rows_study(
    NAME,
    "searches at equal cost",
    cases=trials,
    key=itemgetter("problem", "method", "seed"),
    text=table,
    key_values=lambda comparison: {"settings": comparison.key_values},
    markers=(SECTION, OVERALL, MACHINE),
    sections=lambda measured: {
        SECTION: table(measured),
        OVERALL: summary(measured),
        MACHINE: sources(measured.conditions),
    },
    summary=lambda measured: f"{table(measured)}\n\n{summary(measured)}",
    stopped_message="the same command goes on from here.",
)


@command()
@click.option(
    "--quick",
    is_flag=True,
    help="2 seeds of searches of 60 members, sweeps 10 times as fast as usual.",
)
@click.option(
    "--problem",
    multiple=True,
    type=click.Choice(list(PROBLEMS)),
    help="What is searched; may be repeated.  [default: all]",
)
@threads_option
@cluster_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder.  [default: docs, with --quick {QUICK_OUT}]",
)
@click.option(
    "--redraw",
    is_flag=True,
    help="Write the page again from the numbers in the folder; nothing is computed.",
)
def main(
    quick: bool,
    problem: tuple[str, ...],
    threads: int | None,
    cluster: str | None,
    out: Path | None,
    redraw: bool,
) -> None:
    """Search with each method from scratch over several seeds.

    The winners are judged on fresh members.

    Writes search_methods.json.gz and the page search_methods.md. Ctrl-C keeps what is finished: the
    same command goes on from there.
    """
    with executor(threads, None if redraw else cluster) as where:
        comparison = ComparisonSettings(
            where, problem or tuple(PROBLEMS), **(QUICK if quick else FULL)
        )
        run(
            STUDY,
            comparison,
            paths_next_to_page(out or (QUICK_OUT if quick else OUT), NAME),
            redraw=redraw,
        )
