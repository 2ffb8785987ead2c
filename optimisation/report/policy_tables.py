"""Tables of judged policies: all of a task, and the few that stand at the top of its page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from optimisation.report.markdown import markdown
from optimisation.rl.judging import NO_LEARNING, Estimate, Line
from optimisation.rl.tasks.baseline import ORACLE, Baseline
from optimisation.rl.tasks.table import task_named
from optimisation.rl.tasks.task import LEVEL, TIME

COLUMNS: dict[str, Callable[[Line], str]] = {LEVEL: lambda line: f"{line.level:.3f}", TIME: lambda line: f"{line.time:,.0f}"}  # as tasks name them


def cell(estimate: Estimate | None, digits: int = 3) -> str:
    """Return an estimate with its interval; a dash for None."""
    if estimate is None:
        return "-"
    value, low, high = (f"{round(x, digits) + 0.0:.{digits}f}" for x in (estimate.value, estimate.low, estimate.high))  # no -0.00
    return value if low == high else f"{value} [{low}, {high}]"


def table(task: str, lines: Sequence[Line]) -> str:
    """Return the table of a task, best first."""
    columns, one, rival = task_named(task).columns, task_named(task).one, task_named(task).rival
    beside = () if one == rival else (f"over {one}",)
    header = ("policy", "runs", "mean score", f"over {rival}", *beside, "normalised", *columns)
    rows = [
        (
            line.name,
            str(line.runs),
            cell(line.mean),
            "-" if line.name == rival else cell(line.over_rival),
            *(("-" if line.name == one else cell(line.over_one),) if beside else ()),
            cell(line.normalised, 2),
            *(COLUMNS[column](line) for column in columns),
        )
        for line in sorted(lines, key=lambda line: -line.mean.value)
    ]
    return markdown(header, rows)


def short_table(tasks: Mapping[str, Sequence[Line]]) -> str:
    """Return one table of all tasks: the yardsticks, the rule for the true force and the agents, best first in each task."""
    rows = [
        (own.words, line.name if line.runs == 1 else f"{line.name}, {line.runs} agents", cell(line.mean), cell(line.normalised, 2))
        for own, lines in ((task_named(task), lines) for task, lines in tasks.items())
        for line in sorted(lines, key=lambda line: -line.mean.value)
        if line.name in (*own.yardsticks, ORACLE) or line.kind != NO_LEARNING
    ]
    return markdown(("task", "policy", "mean score", "normalised"), rows)


def baseline_table(baselines: list[Baseline]) -> str:
    """Return the table of what was tuned: scores on the training seeds, and how many candidates were tried."""
    rows = [
        (b.name, "-" if b.training is None else f"{b.training.score:.4f}", "-" if b.training is None else str(b.training.candidates))
        for b in baselines
    ]
    return markdown(("policy", "mean score, training seeds", "candidates"), rows)
