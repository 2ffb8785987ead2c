"""How long a search of designs will take, and what the design rule's device leaves: printed before the search begins."""

from impact_env.ensemble import Executor
from optimisation.duration import (
    COARSER,
    LONG_S,
    PlannedRuns,
    announce_coarse,
    announce_load_runs,
    announce_runs,
)
from optimisation.problem import Problem, evaluate

LESS = "--quick, fewer --designs or --members take less."


def announce_search(
    problem: Problem,
    designs: float,
    threads: int | None,
    cluster: str | None,
    executor: Executor,
) -> None:
    """Print how long a search takes where it is long, and the value of the rule's design by single fast runs.

    ``designs``: how many are run with all members at the problem's rate. Workers of a cluster are not timed.
    """
    if cluster is not None:
        return
    rule = problem.space.default
    chunks = problem.chunks(rule, problem.ensemble[:1], problem.rate)
    if problem.under_loads:
        lane = chunks[0].lanes[0]
        number = round(designs * problem.members * len(problem.conditions))
        seconds = announce_load_runs(lane.scene, lane.drive, number, threads)
        rate = problem.rate
    else:
        planned = [
            PlannedRuns(
                chunk.lanes[0].scene,
                condition.force,
                condition.resonance,
                chunk.lanes[0].drive.schedule.periods,
                2 * designs * problem.members,
            )
            for condition, chunk in zip(problem.conditions, chunks, strict=True)
        ]
        seconds = announce_runs(planned, threads, LESS)
        rate = COARSER * problem.rate
    if seconds <= LONG_S:
        return
    few = problem.ensemble[:1]
    ((_, measured),) = evaluate(problem, [rule], few, rate, executor)
    score = problem.score(rule, measured, few, rate)
    if not score.failed:
        values = "; ".join(
            f"{objective.label} {value:.3g}"
            for objective, value in zip(problem.objectives, score.values, strict=True)
        )
        announce_coarse(f"the design rule's device has {values}.")
