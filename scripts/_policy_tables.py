"""Tables of judged policies: all of a task, and the few that stand at the top of its page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from _table import markdown

from optimisation.rl.baselines import BEST_CONSTANT, BEST_GAP, BEST_SCHEDULE, RIVAL, TUNED_ESTIMATE, TUNED_TRUE
from optimisation.rl.judging import NO_LEARNING, Estimate, Line

TASK_WORDS = {"sweep": "passage", "gap": "gap"}
SHORT = (BEST_CONSTANT, BEST_SCHEDULE, BEST_GAP, TUNED_ESTIMATE, TUNED_TRUE)


def cell(estimate: Estimate | None, digits: int = 3) -> str:
    if estimate is None:
        return "-"
    value, low, high = (f"{round(x, digits) + 0.0:.{digits}f}" for x in (estimate.value, estimate.low, estimate.high))  # no -0.00
    return value if low == high else f"{value} [{low}, {high}]"


def table(task: str, lines: Sequence[Line]) -> str:
    """Return the table of a task, best first."""
    extra = ("level", "pseudo periods") if task == "sweep" else ()
    header = ("policy", "runs", "mean score", "interquartile mean", "normalised", f"better than {RIVAL[task]}", *extra)
    rows = [
        (
            line.name,
            str(line.runs),
            cell(line.mean),
            cell(line.middle),
            cell(line.normalised, 2),
            "-" if line.name == RIVAL[task] else cell(line.improvement, 2),
            *((f"{line.level:.3f}", f"{line.time:,.0f}") if task == "sweep" else ()),
        )
        for line in sorted(lines, key=lambda line: -line.mean.value)
    ]
    return markdown(header, rows)


def short_table(tasks: Mapping[str, Sequence[Line]]) -> str:
    """Return one table of all tasks: the yardsticks and the agents, best first in each task."""
    rows = [
        (TASK_WORDS[task], line.name if line.runs == 1 else f"{line.name}, {line.runs} agents", cell(line.mean), cell(line.normalised, 2))
        for task, lines in tasks.items()
        for line in sorted(lines, key=lambda line: -line.mean.value)
        if line.name in SHORT or line.kind != NO_LEARNING
    ]
    return markdown(("task", "policy", "mean score", "normalised"), rows)
