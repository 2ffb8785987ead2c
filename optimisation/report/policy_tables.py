"""Tables of judged policies: all of a task, and the few that stand at the top of its page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from optimisation.report.markdown import markdown
from optimisation.rl.baselines import (
    BEST_CONSTANT,
    BEST_GAP,
    BEST_LIMIT,
    BEST_PAIR,
    BEST_SCHEDULE,
    RIVAL,
    TUNED_ESTIMATE,
    TUNED_TRUE,
    ZERO_AND_ONE,
    Baseline,
)
from optimisation.rl.judging import NO_LEARNING, Estimate, Line
from optimisation.rl.suite import FEEDBACK, ORACLE

TASK_WORDS = {
    "sweep": "passage (v0)",
    "gap": "gap",
    "passage": "passage (v1)",
    "noisy": "noisy passage",
    "delayed": "delayed passage",
    "adaptive": "rate and gap",
    "friction": "friction limit",
}
SHORT = (BEST_CONSTANT, BEST_SCHEDULE, BEST_GAP, TUNED_ESTIMATE, TUNED_TRUE, BEST_PAIR, BEST_LIMIT, FEEDBACK, ORACLE)


def cell(estimate: Estimate | None, digits: int = 3) -> str:
    """Return an estimate with its interval; a dash for None."""
    if estimate is None:
        return "-"
    value, low, high = (f"{round(x, digits) + 0.0:.{digits}f}" for x in (estimate.value, estimate.low, estimate.high))  # no -0.00
    return value if low == high else f"{value} [{low}, {high}]"


def table(task: str, lines: Sequence[Line]) -> str:
    """Return the table of a task, best first."""
    extra = ("level", "pseudo periods") if task != "gap" else ()
    one = ZERO_AND_ONE[task][1]
    beside = () if one == RIVAL[task] else (f"over {one}",)
    header = ("policy", "runs", "mean score", f"over {RIVAL[task]}", *beside, "normalised", *extra)
    rows = [
        (
            line.name,
            str(line.runs),
            cell(line.mean),
            "-" if line.name == RIVAL[task] else cell(line.over_rival),
            *(("-" if line.name == one else cell(line.over_one),) if beside else ()),
            cell(line.normalised, 2),
            *((f"{line.level:.3f}", f"{line.time:,.0f}") if task != "gap" else ()),
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


def baseline_table(baselines: list[Baseline]) -> str:
    """Return the table of what was tuned: scores on the training seeds, and how many candidates were tried."""
    rows = [
        (b.name, "-" if b.training is None else f"{b.training.score:.4f}", "-" if b.training is None else str(b.training.candidates))
        for b in baselines
    ]
    return markdown(("policy", "mean score, training seeds", "candidates"), rows)
