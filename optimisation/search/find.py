"""A whole search: propose and run designs, choose among the finalists, judge the choice on fresh members, and say what is known.

    problem = Problem(design_space("impact"), (Condition(1, 3.5), Condition(2, 35.0)))
    findings = find(problem, Plan(designs=200))
    findings.verdict.winner.design

The command `optimise_design` does no more than that, with bars and files.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.ensemble import Executor, Threads
from impact_env.parameters import count, require
from optimisation.designs import Design
from optimisation.evaluation import Clocked, evaluate
from optimisation.machine import SEARCHING, fingerprint
from optimisation.problem import Problem
from optimisation.progress import Bar, runs_bar
from optimisation.search.judge import (
    AUDITED,
    Cost,
    Findings,
    Verdict,
    audit,
    more_modes,
    verdict,
    with_repaired,
)
from optimisation.search.ledger import Ledger, remembering
from optimisation.search.noisy import NOISY, noisy_search
from optimisation.search.settings import CMA, Evaluated, SearchSettings, default_settings
from optimisation.variables import WITH_IMPACTS

# SciPy's search for problems that are smooth: without walls there is no chaos, a level has hardly any noise, and few minima.
#
# Nelder-Mead over the shares of the free variables' ranges, from several starts, since the optimum is often a kink (two equal peaks). A few
# members of the ensemble are enough here.


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
) -> tuple[list[Evaluated], bool]:
    """Return the designs that were run, by number: the space's start (unless ``from_scratch``), scattered ones, and descents from the best of those.

    Ends after about ``designs`` of them, or when every descent has come to rest. The flag is
    False if a KeyboardInterrupt ended it early. Raises ParameterError
    for several objectives and for impact absorbers.
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
    seen: list[Evaluated] = []

    def run(batch: list[Design]) -> list[float]:
        found = dict(evaluate(problem, batch, problem.ensemble, problem.rate, executor))
        for k, design in enumerate(batch):
            seen.append(
                Evaluated(
                    len(seen),
                    design,
                    problem.score(design, found[k], problem.ensemble, problem.rate),
                    1,
                )
            )
        if progress is not None:
            progress(len(seen))
        return [problem.penalised_cost(e.score) for e in seen[-len(batch) :]]

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
            left = designs - len(seen)
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
        return seen, False
    return seen, True


if TYPE_CHECKING:
    from optimisation.search.study import DesignStudy

SCIPY = "scipy"
# the default where levels are noisy: the best of docs/search_methods.md; any of `SAMPLERS` and `NOISY` may stand here
FOR_NOISE = CMA
Counting = Callable[[int, int], None]  # takes how many runs are done, and of how many


@dataclass(frozen=True)
class Bars:
    """What shows how far a search is: ``runs`` under a label, and the designs of a ``study`` under a label, of so many, with their runs.

    The default shows nothing.
    """

    runs: Callable[[str], AbstractContextManager[Counting]] = lambda _label: nullcontext(
        lambda _done, _total: None
    )
    study: Callable[[str, int], AbstractContextManager[Counting]] = lambda _label, _wanted: (
        nullcontext(lambda _designs, _runs: None)
    )


QUIET = Bars()


@dataclass(frozen=True)
class Plan:
    """How to search: number of ``designs``, method (None: by the concept), and the rest as in `default_settings`; ``audit`` as in `judge.audit`.

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

    @property
    def noisy(self) -> bool:
        """Whether a model of the noise searches, see `optimisation.search.noisy`."""
        return self.sampler in NOISY

    def smooth(self, concept: str) -> bool:
        """Return whether SciPy searches: on request, and by default where there are no walls and so no chaos."""
        return (self.sampler or (None if concept in WITH_IMPACTS else SCIPY)) == SCIPY


def identity(problem: Problem, search: dict[str, object]) -> dict[str, object]:
    """Return the identity of a search, which one that goes on with its runs must share: question, method and sources."""
    return {"problem": problem.describe(), "search": search, "sources": fingerprint(SEARCHING)}


def searched(
    label: str,
    problem: Problem,
    settings: SearchSettings,
    designs: int,
    ledger: Ledger,
    bars: Bars = QUIET,
) -> tuple[DesignStudy, bool, Cost]:
    """Run a study under a bar; return it, whether it came to its end, and what it took. Beside a ledger's file it is written for Optuna."""
    from optimisation.search.study import DesignStudy  # the other searches need no Optuna

    began = time.perf_counter()
    clocked = Clocked(ledger)
    study = DesignStudy(problem, settings)
    with bars.study(label, settings.whole_batches(designs)) as show:
        finished = study.run(designs, clocked, show)
    seconds = time.perf_counter() - began
    if ledger.kept.path is not None:
        study.save(ledger.kept.path.with_name(f"{ledger.kept.path.name}.optuna"))
    return (
        study,
        finished,
        Cost(
            len(study.told),
            ledger.runs,
            seconds,
            1 - clocked.seconds / seconds if ledger.runs else 0.0,
        ),
    )


def find(
    problem: Problem,
    plan: Plan,
    journal: Path | None = None,
    executor: Executor | None = None,
    bars: Bars = QUIET,
) -> Findings:
    """Search, choose and judge; what a KeyboardInterrupt breaks off is left out, and the same call goes on from the ``journal``.

    ``journal`` None keeps the study in memory, ``executor`` None is all cores. Raises ParameterError for a plan that the problem does not allow and
    for a journal that is another study's.
    """
    executor = executor or Threads()
    concept = problem.space.concept
    if (
        plan.sampler is None
        and not plan.smooth(concept)
        and len(problem.objectives) == 1
        and len(problem.space.free) > 1
    ):
        plan = replace(plan, sampler=FOR_NOISE)
    if plan.smooth(concept) or plan.noisy:
        search: dict[str, object] = {
            "sampler": plan.sampler if plan.noisy else SCIPY,
            "seed": plan.seed,
            "from_scratch": plan.from_scratch,
        }
        with remembering(executor, identity(problem, search), journal) as ledger:
            return _find_again(problem, plan, ledger, bars)
    settings = default_settings(
        problem, plan.sampler, plan.batch, plan.seed, plan.screening, plan.from_scratch
    )
    with remembering(executor, identity(problem, settings.describe()), journal) as ledger:
        study, finished, cost = searched(
            f"{concept}: search", problem, settings, plan.designs, ledger, bars
        )
        findings = Findings(problem, study.told, finished, cost)
        if not finished:
            return findings
        findings = _judged(findings, study.complete or study.told, plan, ledger, bars)
        if len(settings.rungs) > 1 and findings.verdict is not None and plan.audit:
            with bars.runs(f"{concept}: designs left behind, in full") as show:
                findings = replace(findings, audit=audit(study, ledger, plan.audit, show))
    return findings


def _find_again(problem: Problem, plan: Plan, ledger: Ledger, bars: Bars) -> Findings:
    """Search by SciPy, or with a model of the noise.

    Of the latter a design of the plan counts as one member or a little more, as many as one costs that is screened.
    """
    began, clocked, done = time.perf_counter(), Clocked(ledger), 0
    runs = 2 * min(MEMBERS, problem.members) * len(problem.conditions)
    wanted = plan.designs
    if plan.noisy:
        runs = 2 * len(problem.conditions)
        wanted = max(2, round(default_settings(problem).members_a_design * plan.designs))
    with bars.runs(f"{problem.space.concept}: search") as show:

        def count(told: int) -> None:
            nonlocal done
            done = told
            show(runs * told, runs * max(told, wanted))

        rest = (wanted, clocked, plan.seed, plan.from_scratch, count)
        told, finished = (
            noisy_search(problem, str(plan.sampler), *rest)
            if plan.noisy
            else smooth_search(problem, *rest)
        )
    seconds = time.perf_counter() - began
    findings = Findings(
        problem, told, finished, Cost(done, ledger.runs, seconds, 1 - clocked.seconds / seconds)
    )
    kept = told if plan.noisy else [e for e in told if e.score.feasible] or told
    return _judged(findings, kept, plan, ledger, bars) if finished else findings


def _judged(
    findings: Findings, candidates: Sequence[Evaluated], plan: Plan, executor: Executor, bars: Bars
) -> Findings:
    if not candidates:
        return findings
    problem = findings.problem
    concept = findings.problem.space.concept
    with bars.runs(f"{concept}: judging on fresh members") as show:
        candidates = with_repaired(problem, candidates, executor, show)
        found: Verdict = verdict(problem, candidates, executor, progress=show)
    findings = replace(findings, verdict=found)
    if not plan.modes:
        return findings
    with bars.runs(f"{concept}: winner with more modes") as show:
        return replace(
            findings, wider=more_modes(problem, found.winner, found.share, executor, show)
        )


@contextmanager
def study_bar(label: str, wanted: int) -> Iterator[Counting]:
    """Give a function that shows how many designs are done of those that are ``wanted``, and the runs that they took."""
    with Bar(total=wanted, desc=label, unit="designs") as bar:

        def show(designs: int, runs: int) -> None:
            bar.set_postfix_str(f"{runs} runs", refresh=False)
            bar.update(designs - bar.n)
            bar.refresh()

        yield show


BARS = Bars(runs_bar, study_bar)
