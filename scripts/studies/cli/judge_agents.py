"""Scores of trained agents on the test seeds compared with those of the best rule.

Each training seed has its result. The learning curves are drawn too.
"""

# needs: env

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env.checks import ParameterError, require
from impact_env.envs.evaluation import (
    EPISODES,
    SEED_SPLITS,
    bootstrap_interval,
    evaluate,
    play,
)
from optimisation.cli.common import check_target, command
from optimisation.executors import Bar
from optimisation.files import (
    DOCS,
    fill,
    markdown,
    read_json,
    require_markers,
    require_writable,
    write_csv,
)
from optimisation.report.report import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    PINK,
    draw_grid,
    figure_of,
    write_figure,
)
from optimisation.rl.agents import FINAL, Run, find_runs, load_agent
from optimisation.rl.rules import CONSTANT, EIGHT, TASKS, env_of, policies
from studies.admission import ROBUST
from studies.study import Array

PAGE = DOCS / "tasks.md"
PLANS = DOCS / "tasks.json.gz"  # scores of the planners
SCORES = DOCS / "tasks" / "agents.csv"
CURVES = DOCS / "tasks" / "learning_curves.csv"
FIGURE = "learning_curves.png"
MARKER = "agents"
COLOURS = {"ppo": BLUE, "sac": ORANGE, "rpi": PINK}
WIDE = 2  # panels side by side


class AgentScores(NamedTuple):
    """Result of one training seed.

    ``validation`` and ``test`` are its mean scores on the validation and test seeds, and
    ``over_rule`` is the mean difference to the rule on the test seeds with its interval from
    ``low`` to ``high``.
    """

    task: str
    algorithm: str
    seed: int
    steps: int
    validation: float
    test: float
    over_rule: float
    low: float
    high: float


class CurvePoint(NamedTuple):
    """A point of a learning curve: mean score on the validation seeds after so many steps."""

    task: str
    algorithm: str
    seed: int
    steps: int
    score: float


def judge(task: str, runs: Sequence[Run], episodes: int) -> list[AgentScores]:
    """Return the scores of finished runs of a task on test seeds.

    Each run also has the mean difference to the rule of eight parameters with its 95 % interval,
    paired by test seed.
    """
    rule = policies(task)[EIGHT]
    rows = []
    for run in Bar(runs, desc=task, unit="agent", leave=False):
        agent = load_agent(run.folder / FINAL)
        evaluation = evaluate(agent, env_of(task), "test", {EIGHT: rule}, episodes=episodes)
        rows.append(
            AgentScores(
                task,
                run.algorithm,
                run.seed,
                run.evaluations[-1].steps,
                run.score,
                evaluation.policy.mean,
                *evaluation.differences[EIGHT],
            )
        )
    return rows


def read_rows(file: Path, kind: type[Any]) -> list[Any]:
    """Return the rows of a CSV file as named tuples, or none if the file does not exist.

    Raises ParameterError if this command did not write the file.
    """
    if not file.exists():
        return []
    try:
        with file.open(newline="", encoding="utf-8") as lines:
            types = kind.__annotations__
            return [
                kind(**{name: types[name](text) for name, text in row.items()})
                for row in csv.DictReader(lines)
            ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ParameterError(
            f"{file} is not allowed: a table that an earlier run of this command wrote ({error!r})"
        ) from error


def share_of_way(agents: Array, rule: Array, planner: Array) -> float:
    """Return the improvement of agents on a rule, as a share of that of a planner.

    The scores have the shape (runs, seeds).
    """
    return float((agents.mean() - rule.mean()) / (planner.mean() - rule.mean()))


def format_shares(task: str, algorithm: str, plans: Mapping[str, Any]) -> str:
    """Return the improvement of agents on the rule, relative to that of the robust planner.

    It has its 95 % interval. The text is "-" where planner, rule or agents have not been judged.
    """
    scores = plans.get(task, {}).get("scores", {})
    known = [scores.get(label) for label in (algorithm.upper(), EIGHT, ROBUST)]
    if any(values is None for values in known):
        return "-"
    arrays = [np.array(values) for values in known]
    low, high = bootstrap_interval(share_of_way, *arrays)
    return f"{share_of_way(*arrays):.2f} [{low:.2f}, {high:.2f}]"


def table(rows: Sequence[AgentScores], plans: Mapping[str, Any]) -> str:
    """Return the table of the page: a line for each task and algorithm."""
    groups: dict[tuple[str, str], list[AgentScores]] = {}
    for row in rows:
        groups.setdefault((row.task, row.algorithm), []).append(row)
    lines = []
    for (task, algorithm), group in groups.items():
        over = np.array([row.over_rule for row in group])
        steps = max(row.steps for row in group)
        lines.append(
            (
                f"`{task}`",
                algorithm.upper(),
                f"{steps:,}",
                f"{sum(row.low > 0 for row in group)} of {len(group)}",
                f"{np.median(over):+.3f}",
                f"{over.min():+.3f} to {over.max():+.3f}",
                format_shares(task, algorithm, plans),
            )
        )
    header = (
        "task",
        "algorithm",
        "steps",
        "seeds above the rule",
        "over the rule, median",
        "worst to best seed",
        "share of the way to the planner",
    )
    return markdown(header, lines)


def save_curves(path: Path, points: Sequence[CurvePoint]) -> None:
    """Draw validation scores over training steps.

    Each task has a panel, each seed a thin line, and the median a thick one. Horizontal lines are
    the rule and the constant.
    """
    tasks = [task for task in TASKS if any(point.task == task for point in points)]
    rows = -(-len(tasks) // WIDE)
    figure, panels = figure_of(9.6, 3.6 * rows, rows, WIDE)
    flat = np.ravel(panels)
    for panel in flat[len(tasks) :]:
        panel.set_axis_off()
    seeds = range(SEED_SPLITS["validation"][0], SEED_SPLITS["validation"][0] + EPISODES)
    for panel, task in zip(flat, tasks, strict=False):
        for algorithm, colour in COLOURS.items():
            own = [p for p in points if (p.task, p.algorithm) == (task, algorithm)]
            curves = [
                np.array([(p.steps, p.score) for p in own if p.seed == seed])
                for seed in sorted({p.seed for p in own})
            ]
            for curve in curves:
                panel.plot(*curve.T / [[1e6], [1]], color=colour, lw=0.5, alpha=0.5)
            if curves:
                length = min(map(len, curves))
                middle = np.median([curve[:length, 1] for curve in curves], axis=0)
                label = f"{algorithm.upper()}, training seeds: {len(curves)}"
                panel.plot(curves[0][:length, 0] / 1e6, middle, color=colour, lw=2, label=label)
        chosen = policies(task)
        for name, colour, style in ((EIGHT, BLACK, "--"), (CONSTANT, GREY, ":")):
            score = play(chosen[name], env_of(task), seeds).scores.mean()
            panel.axhline(score, color=colour, ls=style, lw=1.2, label=f"{name}, {score:.3f}")
        panel.set(title=task, xlabel="million steps", ylabel="score, validation", xlim=(0, None))
        panel.legend(fontsize=8, frameon=False)
        draw_grid(panel)
    write_figure(figure, path, dpi=110)


@command()
@click.option(
    "--agents",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Folder of trained agents that are judged.  [default: none, only table and figure]",
)
@click.option(
    "--task",
    "tasks",
    multiple=True,
    type=click.Choice(list(TASKS)),
    help="May be repeated.  [default: all]",
)
@click.option(
    "--episodes",
    type=click.IntRange(min=2),
    default=EPISODES,
    show_default=True,
    help="Test seeds that are played.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=SCORES.parent,
    help=f"Folder of {SCORES.name}, {CURVES.name} and {FIGURE}.  [default: docs/tasks]",
)
@click.option("--page", type=click.Path(path_type=Path), help="Write the table into a page.")
def main(
    agents: Path | None, tasks: tuple[str, ...], episodes: int, out: Path, page: Path | None
) -> None:
    """Evaluate each finished agent once on the test seeds.

    The table has the number of training seeds that score higher than the rule of eight parameters.
    """
    check_target("--page", page)
    require_writable("--out", out)
    if page is not None:
        require_markers(page, PAGE, (MARKER,))
    scores = out / SCORES.name
    curves = out / CURVES.name
    rows: list[AgentScores] = read_rows(scores, AgentScores)
    points: list[CurvePoint] = read_rows(curves, CurvePoint)
    for task in tasks or TASKS:
        runs = [run for run in find_runs(agents / task) if run.finished] if agents else []
        own = {(task, run.algorithm, run.seed) for run in runs}
        rows = [row for row in rows if row[:3] not in own]
        rows += judge(task, runs, episodes)
        points = [point for point in points if point[:3] not in own]
        points += [
            CurvePoint(task, run.algorithm, run.seed, evaluation.steps, evaluation.score)
            for run in runs
            for evaluation in run.evaluations
        ]
    require(len(rows) > 0, "--agents", str(agents), "a folder with finished agents")
    order = list(TASKS)
    rows.sort(key=lambda row: (order.index(row.task), *row[1:3]))
    points.sort(key=lambda point: (order.index(point.task), *point[1:4]))
    plans = read_json(PLANS)["tasks"] if PLANS.exists() else {}
    text = table(rows, plans)
    click.echo(text)
    out.mkdir(parents=True, exist_ok=True)
    write_csv(scores, AgentScores._fields, [format_row(row) for row in rows])
    write_csv(curves, CurvePoint._fields, [format_row(point) for point in points])
    save_curves(out / FIGURE, points)
    if page is not None:
        fill(page, PAGE, {MARKER: text})


def format_row(row: Sequence[Any]) -> list[Any]:
    """Return the cells of a row, with floats of six decimals."""
    return [f"{value:.6f}" if isinstance(value, float) else value for value in row]
