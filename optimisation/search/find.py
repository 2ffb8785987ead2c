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

from impact_env.ensemble import Executor, Threads
from optimisation.checkpoint import RunCache, open_run_cache
from optimisation.machine import SEARCHING, source_hash
from optimisation.problem import Problem
from optimisation.progress import Bar, runs_bar
from optimisation.search.gaussian_process import ROUND_MEMBERS, model_search
from optimisation.search.judge import (
    AUDITED,
    Cost,
    SearchResult,
    Verdict,
    audit,
    more_modes,
    verdict,
    with_repaired,
)
from optimisation.search.settings import (
    GP,
    NSGA2,
    SCIPY,
    Evaluated,
    SearchSettings,
    default_settings,
)
from optimisation.search.smooth import MEMBERS, smooth_search
from optimisation.space import WITH_IMPACTS

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

    They are the number of ``designs``, the ``sampler`` (None: `method`), and others as in
    `default_settings`. ``audit`` as in `judge.audit`.

    ``modes``: whether the winner runs again with more modes.
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


def searched(
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
    """Search, choose and judge.

    Results that a KeyboardInterrupt prevents are left out. The same call continues from the
    ``journal``.

    ``journal`` None keeps the study in memory, ``executor`` None is all cores. Raises
    ParameterError for a plan that the problem does not allow and for a journal that is another
    study's.
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
        study, finished, cost = searched(
            f"{concept}: search", problem, settings, plan.designs, cache, bars
        )
        findings = SearchResult(problem, study.evaluated, finished, cost)
        if not finished:
            return findings
        findings = _judged(findings, study.complete or study.evaluated, plan, cache, bars)
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
        from optimisation.search.optuna_samplers import write_study

        costs = [[problem.penalised_cost(e.score)] for e in evaluated]
        path = optuna_file(cache.checkpoint.path)
        write_study(path, problem.space, problem.objectives, evaluated, costs)
    cost = Cost(len(evaluated), cache.runs, seconds, 1 - clocked.seconds / seconds)
    findings = SearchResult(problem, evaluated, finished, cost)
    return _judged(findings, candidates_left, plan, cache, bars) if finished else findings


def _judged(
    findings: SearchResult,
    candidates: Sequence[Evaluated],
    plan: SearchOptions,
    executor: Executor,
    bars: ProgressBars,
) -> SearchResult:
    if not candidates:
        return findings
    problem = findings.problem
    concept = findings.problem.space.concept
    with bars.runs(f"{concept}: judging on fresh members") as show:
        candidates = with_repaired(problem, candidates, executor, show)
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
