"""What docs/findings.md says about the searches themselves: scaling to two workers, a study of full size, fronts against random search."""

import statistics
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from impact_env.ensemble import Executor, Threads
from impact_env.extras import optional
from optimisation.evaluation import evaluate
from optimisation.machine import peak_memory
from optimisation.progress import Bar
from optimisation.search.cluster import Workers
from optimisation.search.find import BARS, Plan, find
from optimisation.search.judge import Audit
from optimisation.search.pareto import BY_RESONANCE, CORNER, FORCES, bounds_of, compare_with_random, front_summary, judge_front, search_front
from optimisation.search.settings import default_settings
from optimisation.variables import IMPACT
from studies.findings.parts import AT, Settings
from studies.study import Json, there

with optional():
    import distributed

WORKERS = (1, 2)
FRONT_MEMBERS, FRONT_DESIGNS, SEEDS = 2, 300, 5
FULL = 2000


@contextmanager
def _cluster(workers: int) -> Iterator[Executor]:
    local = distributed.LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50)
    with local, Workers(local.scheduler_address) as executor:
        yield executor


def scaling(study: Settings) -> Json:
    """Time of one batch of random designs with one and two threads, and with one and two worker processes of a cluster, in turn."""
    problem = study.problem(IMPACT, AT, members=study.few)
    generator = np.random.default_rng(study.seed)
    designs = [problem.space.at(shares) for shares in generator.random((2 * study.points, len(problem.space.free)))]
    with ExitStack() as stack:
        kinds: dict[str, list[Executor]] = {"threads": [Threads(n) for n in WORKERS]}
        kinds["cluster"] = [stack.enter_context(_cluster(n)) for n in WORKERS]
        for executor in (e for group in kinds.values() for e in group):  # workers load their kernels
            dict(evaluate(problem, designs[:4], problem.ensemble[:1], 10 * problem.rate, executor))
        times: dict[tuple[str, int], list[float]] = {(kind, n): [] for kind in kinds for n in WORKERS}
        for _ in Bar(range(3), desc="scaling", unit="rounds", leave=False):
            for kind, group in kinds.items():
                for n, executor in zip(WORKERS, group, strict=True):
                    began = time.perf_counter()
                    dict(evaluate(problem, designs, problem.ensemble, problem.rate, executor))
                    times[kind, n].append(time.perf_counter() - began)
    speedup = {kind: statistics.median(times[kind, 1]) / statistics.median(times[kind, 2]) for kind in kinds}
    runs = 2 * len(designs) * len(problem.ensemble) * len(problem.conditions)
    rows = [{"kind": kind, "workers": n, "seconds": statistics.median(s), "all_s": s} for (kind, n), s in times.items()]
    return {"designs": len(designs), "runs": runs, "rows": rows, "speedup": speedup}


def full_study(study: Settings) -> Json:
    """A robust two-resonance study of full size with the defaults of scripts/optimise_design.py: time, share of it outside the runs, memory."""
    problem, began = study.problem(IMPACT, AT), time.perf_counter()
    plan = Plan(FULL if study.designs >= 100 else study.designs, seed=study.seed)
    found = find(problem, plan, study.folder / "full.journal", study.executor, BARS)
    if not found.finished or found.verdict is None:
        raise KeyboardInterrupt
    wall = time.perf_counter() - began
    audit, winner = found.audit or Audit(0, 0, float("nan")), found.verdict.winner
    size = {"designs": found.cost.designs, "variables": len(problem.space.free), "members": problem.members, "modes": problem.beam.modes}
    cost = {"runs": found.cost.runs, "search_s": found.cost.seconds, "with_judging_s": wall, "overhead": found.cost.overhead}
    left = {"left_behind": {"run_in_full": audit.designs, "better_than_best_found": audit.missed}, "memory_bytes": peak_memory()}
    best = {"winner": dict(winner.design.values), "score": winner.score.values[0], "score_5_to_95_percent": list(winner.bands[0])}
    return size | cost | left | best


def front(study: Settings) -> Json:
    """The front of first against second resonance, and its hypervolume beside that of random searches with the same budget."""
    members = min(FRONT_MEMBERS, study.members)
    problem = replace(study.problem(IMPACT, FORCES, members=members), objectives=BY_RESONANCE)
    settings = default_settings(problem, seed=study.seed)
    designs, seeds = (FRONT_DESIGNS, SEEDS) if study.designs >= 100 else (study.designs, 2)
    found = search_front(problem, settings, designs, CORNER, study.folder / "front.journal", study.executor)
    found = compare_with_random(judge_front(found, study.executor), settings, seeds, study.executor) if found.finished else found
    if not found.finished:
        raise KeyboardInterrupt
    arrays: dict[str, Any] = {
        "labels": [o.label for o in problem.objectives],
        "front_scores": [list(e.score.values) for e in found.members],
        "searched": [list(e.score.values) for e in found.told],
        "fresh": [list(judged.score.values) for judged in there(found.fresh)],
        "bound": bounds_of(found).tolist(),
    }
    return front_summary(found) | arrays
