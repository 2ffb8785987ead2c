"""A complete search: propose and run designs, choose a finalist, and judge it.

The choice is judged on fresh members, and the results are collected.

    problem = Problem(design_space("impact"), (Condition(1, 3.5), Condition(2, 35.0)))
    findings = find(problem, Plan(designs=200))
    findings.verdict.winner.design

The command `design search` does no more than that, with bars and files.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import count, require
from impact_env.ensemble import Executor, Threads
from optimisation.checkpoint import SEARCHING, RunCache, open_run_cache, source_hash
from optimisation.executors import Bar, runs_bar
from optimisation.problem import Problem, evaluate
from optimisation.search.gaussian_process import ROUND_MEMBERS, model_search
from optimisation.search.judge import (
    AUDITED,
    Cost,
    SearchResult,
    Verdict,
    add_repairs,
    audit,
    more_modes,
    verdict,
)
from optimisation.search.settings import (
    GP,
    NSGA2,
    SCIPY,
    EvaluatedDesign,
    SearchSettings,
    default_settings,
)
from optimisation.space import WITH_IMPACTS, Design

if TYPE_CHECKING:
    from optimisation.search.study import DesignStudy

T = TypeVar("T")
R = TypeVar("R")
Counting = Callable[[int, int], None]  # takes how many runs are done, and of how many


@dataclass
class TimedExecutor:
    """An executor that counts the ``seconds`` for which its caller waits for runs.

    The remaining time of a search is overhead.
    """

    executor: Executor
    seconds: float = 0.0

    def each(
        self, function: Callable[[T], R], items: Sequence[T], kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, R], None, None]:
        """See `Executor`."""
        results = self.executor.each(function, items, kinds)
        while True:
            began = time.perf_counter()
            result = next(results, None)
            self.seconds += time.perf_counter() - began
            if result is None:
                return
            yield result


@dataclass(frozen=True)
class ProgressBars:
    """Progress displays of a search.

    ``runs``: display of runs under a label. ``study``: display of designs under a label, with their
    total number and the number of their runs.

    The default shows nothing.
    """

    runs: Callable[[str], AbstractContextManager[Counting]] = lambda _label: nullcontext(
        lambda _done, _total: None
    )
    study: Callable[[str, int], AbstractContextManager[Counting]] = lambda _label, _wanted: (
        nullcontext(lambda _designs, _runs: None)
    )


QUIET = ProgressBars()


@dataclass(frozen=True)
class SearchOptions:
    """Options of a search.

    Attributes
    ----------
    designs : int
        Number of designs.
    sampler : str or None
        Name of the sampler, None: `method`.
    batch, seed, screening, from_scratch
        As in `default_settings`.
    audit : int
        Number of designs of `judge.audit`.
    modes : bool
        Whether the winner runs again with more modes.
    """

    designs: int
    sampler: str | None = None
    batch: int | None = None
    seed: int = 0
    screening: bool = True
    from_scratch: bool = False
    audit: int = AUDITED
    modes: bool = True

    def method(self, problem: Problem) -> str:
        """Return the sampler, or the default one.

        The default is SciPy without walls, NSGA-II for several objectives, and the Gaussian process
        otherwise.
        """
        if self.sampler is not None:
            return self.sampler
        if problem.space.concept not in WITH_IMPACTS:
            return SCIPY
        return NSGA2 if len(problem.objectives) > 1 else GP


def identity(problem: Problem, search: dict[str, object]) -> dict[str, object]:
    """Return the identity of a search: question, method and sources.

    Only a search with the same identity can continue its runs.
    """
    return {"problem": problem.describe(), "search": search, "sources": source_hash(SEARCHING)}


def optuna_file(journal: Path) -> Path:
    """Return the file that Optuna reads beside a journal."""
    return journal.with_name(f"{journal.name}.optuna")


def run_study(
    label: str,
    problem: Problem,
    settings: SearchSettings,
    designs: int,
    cache: RunCache,
    bars: ProgressBars = QUIET,
) -> tuple[DesignStudy, bool, Cost]:
    """Run a study with a progress bar; return it, whether it was completed, and its cost.

    The study is also written for Optuna, next to the run cache's file.
    """
    from optimisation.search.study import DesignStudy  # the other searches need no Optuna

    began = time.perf_counter()
    clocked = TimedExecutor(cache)
    study = DesignStudy(problem, settings)
    with bars.study(label, settings.whole_batches(designs)) as show:
        finished = study.run(designs, clocked, show)
    seconds = time.perf_counter() - began
    if cache.checkpoint.path is not None:
        study.save(optuna_file(cache.checkpoint.path))
    return (
        study,
        finished,
        Cost(
            len(study.evaluated),
            cache.runs,
            seconds,
            1 - clocked.seconds / seconds if cache.runs else 0.0,
        ),
    )


def find(
    problem: Problem,
    plan: SearchOptions,
    journal: Path | None = None,
    executor: Executor | None = None,
    bars: ProgressBars = QUIET,
) -> SearchResult:
    """Search designs, choose a winner and evaluate it with new members.

    Results that a KeyboardInterrupt prevents are left out; the same call continues from the
    ``journal``. ``journal`` None keeps the study in memory, ``executor`` None is all cores. Raises
    ParameterError for a plan that the problem does not allow, and for the journal of another study.
    """
    executor = executor or Threads()
    concept = problem.space.concept
    plan = replace(plan, sampler=plan.method(problem))
    if plan.sampler in (SCIPY, GP):
        search: dict[str, object] = {
            "sampler": plan.sampler,
            "seed": plan.seed,
            "from_scratch": plan.from_scratch,
        }
        if plan.sampler == GP:
            search["batch"] = plan.batch or ROUND_MEMBERS
        with open_run_cache(executor, identity(problem, search), journal) as cache:
            return _find_without_study(problem, plan, cache, bars)
    settings = default_settings(
        problem, plan.sampler, plan.batch, plan.seed, plan.screening, plan.from_scratch
    )
    with open_run_cache(executor, identity(problem, settings.describe()), journal) as cache:
        study, finished, cost = run_study(
            f"{concept}: search", problem, settings, plan.designs, cache, bars
        )
        findings = SearchResult(problem, study.evaluated, finished, cost)
        if not finished:
            return findings
        findings = _judge_finalists(findings, study.complete or study.evaluated, plan, cache, bars)
        if len(settings.rungs) > 1 and findings.verdict is not None and plan.audit:
            with bars.runs(f"{concept}: designs left behind, in full") as show:
                findings = replace(findings, audit=audit(study, cache, plan.audit, show))
    return findings


def _find_without_study(
    problem: Problem, plan: SearchOptions, cache: RunCache, bars: ProgressBars
) -> SearchResult:
    """Search by SciPy or with a Gaussian process, and judge what it found.

    For the process a design of the plan stands for as many members as a screened design costs.
    """
    began = time.perf_counter()
    clocked = TimedExecutor(cache)
    wanted = plan.designs
    runs = 2 * min(MEMBERS, problem.members) * len(problem.conditions)
    if plan.sampler == GP:
        wanted = max(2, round(default_settings(problem).members_a_design * plan.designs))
        runs = 2 * len(problem.conditions)
    with bars.runs(f"{problem.space.concept}: search") as show:

        def count(done: int) -> None:
            show(runs * done, runs * max(done, wanted))

        shared = (problem, wanted, clocked, plan.seed, plan.from_scratch, count)
        if plan.sampler == GP:
            evaluated, candidates_left, finished = model_search(
                *shared, plan.batch or ROUND_MEMBERS
            )
        else:
            evaluated, finished = smooth_search(*shared)
            candidates_left = [e for e in evaluated if e.score.feasible] or evaluated
    seconds = time.perf_counter() - began
    if plan.sampler == GP and cache.checkpoint.path is not None and find_spec("optuna") is not None:
        from optimisation.search.study import write_study

        costs = [[problem.penalised_cost(e.score)] for e in evaluated]
        path = optuna_file(cache.checkpoint.path)
        write_study(path, problem.space, problem.objectives, evaluated, costs)
    cost = Cost(len(evaluated), cache.runs, seconds, 1 - clocked.seconds / seconds)
    findings = SearchResult(problem, evaluated, finished, cost)
    return _judge_finalists(findings, candidates_left, plan, cache, bars) if finished else findings


def _judge_finalists(
    findings: SearchResult,
    candidates: Sequence[EvaluatedDesign],
    plan: SearchOptions,
    executor: Executor,
    bars: ProgressBars,
) -> SearchResult:
    if not candidates:
        return findings
    problem = findings.problem
    concept = findings.problem.space.concept
    with bars.runs(f"{concept}: judging on fresh members") as show:
        candidates = add_repairs(problem, candidates, executor, show)
        verdict_of_search: Verdict = verdict(problem, candidates, executor, progress=show)
    findings = replace(findings, verdict=verdict_of_search)
    if not plan.modes:
        return findings
    with bars.runs(f"{concept}: winner with more modes") as show:
        return replace(
            findings,
            wider=more_modes(
                problem, verdict_of_search.winner, verdict_of_search.share, executor, show
            ),
        )


@contextmanager
def study_bar(label: str, wanted: int) -> Iterator[Counting]:
    """Yield a function that shows the number of finished designs and of their runs.

    ``wanted``: number of all designs.
    """
    with Bar(total=wanted, desc=label, unit="designs") as bar:

        def show(designs: int, runs: int) -> None:
            bar.set_postfix_str(f"{runs} runs", refresh=False)
            bar.update(designs - bar.n)
            bar.refresh()

        yield show


BARS = ProgressBars(runs_bar, study_bar)
Plan = SearchOptions  # the name before; for one release


# `smooth_search`: SciPy's search for smooth problems.
#
# Without walls there is no chaos. A level then has hardly any noise and few minima.
#
# Nelder-Mead over the shares of the free variables' ranges, from several starts, since the
# optimum is often a kink (two equal peaks). A few members of the ensemble are enough here.

Array = NDArray[np.float64]
STARTS = 3
SCATTERED = 16
MEMBERS = 2
_TOLERANCE = 1e-5  # in shares of the ranges, and in the objective


def smooth_search(
    problem: Problem,
    designs: int,
    executor: Executor,
    seed: int = 0,
    from_scratch: bool = False,
    progress: Callable[[int], None] | None = None,
) -> tuple[list[EvaluatedDesign], bool]:
    """Return the designs that were run, by number, and whether the search was finished.

    They are the start of the space (unless ``from_scratch``), scattered designs, and descents from
    the best of these. The search ends after about ``designs`` of them, or when every descent has
    converged. Raises ParameterError for several objectives and for impact absorbers.
    """
    designs = count("designs", designs, 2)
    require(
        problem.space.concept not in WITH_IMPACTS,
        "sampler",
        "scipy",
        "a concept without walls: impacts are chaotic, and their levels noisy",
    )
    require(len(problem.objectives) == 1, "sampler", "scipy", "one objective")
    problem = replace(problem, members=min(MEMBERS, problem.members))
    evaluated: list[EvaluatedDesign] = []

    def run(batch: list[Design]) -> list[float]:
        measured = dict(evaluate(problem, batch, problem.ensemble, problem.rate, executor))
        for k, design in enumerate(batch):
            evaluated.append(
                EvaluatedDesign(
                    len(evaluated),
                    design,
                    problem.score(design, measured[k], problem.ensemble, problem.rate),
                    1,
                )
            )
        if progress is not None:
            progress(len(evaluated))
        return [problem.penalised_cost(e.score) for e in evaluated[-len(batch) :]]

    def at(shares: Array) -> float:
        return run([problem.space.at(np.clip(shares, 0, 1).tolist())])[0] + float(
            np.sum(np.abs(shares - np.clip(shares, 0, 1)))
        )

    size = len(problem.space.free)
    start = problem.space.shares(problem.space.default)
    points = scipy.stats.qmc.Halton(size, rng=np.random.default_rng(seed)).random(
        min(SCATTERED, designs - 1)
    )
    points = points if from_scratch else np.vstack([start, points])
    try:
        costs = run([problem.space.at(shares.tolist()) for shares in points])
        for k in np.argsort(costs, kind="stable")[:STARTS]:
            left = designs - len(evaluated)
            if left > 0:
                simplex = np.vstack([points[k], points[k] + 0.05 * np.eye(size)])
                options = {
                    "initial_simplex": simplex,
                    "maxfev": left,
                    "xatol": _TOLERANCE,
                    "fatol": _TOLERANCE,
                }
                scipy.optimize.minimize(at, points[k], method="Nelder-Mead", options=options)
    except KeyboardInterrupt:
        return evaluated, False
    return evaluated, True
