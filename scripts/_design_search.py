"""What the scripts of the design studies share: a search with its progress bars, its cost, and the judging of what it found."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from _design_options import study_bar
from _progress import runs_bar

from optimisation.designs import WITH_IMPACTS
from optimisation.evaluation import Clocked, Executor
from optimisation.insight import levels
from optimisation.problem import Problem
from optimisation.report.design_tables import Cost, Findings
from optimisation.search.judge import AUDITED, audit, verdict
from optimisation.search.settings import Settings, default_settings
from optimisation.search.smooth import MEMBERS, smooth_search
from optimisation.search.study import DesignStudy, Evaluated, opened

SCIPY = "scipy"


@dataclass(frozen=True)
class Plan:
    """How to search: number of ``designs``, method (None: by the concept), and the rest as in `default_settings`; ``audit`` as in `judge.audit`."""

    designs: int
    sampler: str | None = None
    batch: int | None = None
    seed: int = 0
    screening: bool = True
    from_scratch: bool = False
    audit: int = AUDITED

    def smooth(self, concept: str) -> bool:
        """Return whether SciPy searches: on request, and by default where there are no walls and so no chaos."""
        return (self.sampler or (None if concept in WITH_IMPACTS else SCIPY)) == SCIPY


@contextmanager
def searched(
    label: str, problem: Problem, settings: Settings, designs: int, journal: Path | None, executor: Executor
) -> Iterator[tuple[DesignStudy, bool, Cost]]:
    """Run a study under a bar and give it, still open, with whether it came to its end and what it took."""
    with opened(problem, settings, journal) as study:
        with study_bar(label, settings.whole_batches(designs)) as show:
            finished = study.run(designs, executor, show)
        overhead = 1 - study.evaluating / study.seconds if study.runs else 0.0
        yield study, finished, Cost(len(study.told), study.runs, study.seconds, overhead)


def find(problem: Problem, plan: Plan, journal: Path, executor: Executor) -> Findings:
    """Search, choose and judge; what a Ctrl-C breaks off is left out."""
    concept = problem.space.concept
    if plan.smooth(concept):
        return _find_smoothly(problem, plan, executor)
    settings = default_settings(problem, plan.sampler, plan.batch, plan.seed, plan.screening, plan.from_scratch)
    with searched(f"{concept}: search", problem, settings, plan.designs, journal, executor) as (study, finished, cost):
        findings = Findings(problem, study.told, finished, cost)
        if not finished:
            return findings
        findings = _judge(findings, study.complete, executor)
        if len(settings.rungs) > 1 and findings.finished and plan.audit:
            with runs_bar(f"{concept}: designs left behind, in full") as show:
                findings = replace(findings, audit=audit(study, executor, plan.audit, show))
    return findings


def _find_smoothly(problem: Problem, plan: Plan, executor: Executor) -> Findings:
    began, runs, clocked = time.perf_counter(), 2 * min(MEMBERS, problem.members) * len(problem.conditions), Clocked(executor)
    with runs_bar(f"{problem.space.concept}: search") as show:

        def count(done: int) -> None:
            show(runs * done, runs * max(done, plan.designs))

        told, finished = smooth_search(problem, plan.designs, clocked, plan.seed, plan.from_scratch, count)
    seconds = time.perf_counter() - began
    findings = Findings(problem, told, finished, Cost(len(told), runs * len(told), seconds, 1 - clocked.seconds / seconds))
    return _judge(findings, [e for e in told if e.score.feasible], executor) if finished else findings


def _judge(findings: Findings, candidates: Sequence[Evaluated], executor: Executor) -> Findings:
    if not candidates:
        return findings
    with runs_bar(f"{findings.problem.space.concept}: judging on fresh members") as show:
        found = verdict(findings.problem, candidates, executor, progress=show)
        both = [found.winner.design, found.paper.design]
        own = levels(findings.problem, both, findings.problem.conditions, findings.problem.members, executor, show)
    return replace(findings, verdict=found, own=own)
