"""Measure how far planners score above simple rules in each task.

The simple rules are constants, schedules and feedback rules optimised by CMA-ES. The planners look
ahead by simulation. The results also go into the page of tasks.
"""

# needs: env, optimise

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.checks import ParameterError
from impact_env.envs.evaluation import bootstrap_interval
from impact_env.extras import optional
from optimisation.cli.common import check_target, command
from optimisation.executors import Bar
from optimisation.files import DOCS, fill, markdown, read_json, require_markers, write_json
from optimisation.report.report import BLACK, BLUE, ORANGE, figure_of, write_figure
from optimisation.rl.agents import FINAL, find_agents
from optimisation.rl.families import RandomPolicy
from optimisation.rl.rules import CHOSEN, CONSTANT, EIGHT, TASKS, env_of, policies
from studies.admission import EFFORTS, HEADROOM, QUICK, add_agents, admit, tried
from studies.study import Array, Json

NAMES = (
    *(name for name in TASKS if not name.startswith(("SweepRateNoisy", "SweepRateDelayed"))),
    "SweepRateHard-v0",
)
PICTURES = "tasks"  # folder beside the page


def rooms(result: Mapping[str, Json]) -> str:
    """Return the admission table.

    It has mean scores with their intervals over the judged seeds, and the room, which is the
    relative advantage of the planner over the best rule.
    """
    columns = list(dict.fromkeys(label for one in result.values() for label in one["scores"]))
    rows = []
    for name, one in result.items():
        cells = []
        for label in columns:
            scores = np.array(one["scores"][label]) if label in one["scores"] else None
            cells.append("-" if scores is None else format_scores(scores))
        share = "{:.2f} [{:.2f}, {:.2f}]".format(*one[HEADROOM]) if HEADROOM in one else "-"
        verdict = (
            ("admitted" if one["admitted"] else "no room shown")
            if HEADROOM in one
            else "for comparison"
        )
        rows.append((f"`{name}`", *cells, share, verdict))
    return markdown(("task", *columns, HEADROOM, "verdict"), rows)


def format_scores(scores: Any) -> str:
    """Return the mean of scores (runs, seeds) with its interval, as text.

    If there are several runs, their number follows.
    """
    low, high = bootstrap_interval(np.mean, scores)
    runs = f" ({len(scores)} runs)" if len(scores) > 1 else ""
    return f"{scores.mean():.3f} [{low:.3f}, {high:.3f}]{runs}"


def searches(result: Mapping[str, Json]) -> str:
    """Return each rule's family and how it was tuned."""
    rows = []
    for name, one in result.items():
        effort = one["effort"]
        best = one["rules"][EIGHT]
        tried = ", ".join(f"{number:.3f}" for number in best["numbers"])
        spent = f"{effort['searched']} / {effort['judged']}"
        ahead = f"{effort['horizon']}, {effort['copies']}"
        rows.append((f"`{name}`", best["family"], tried, spent, ahead if HEADROOM in one else "-"))
    return markdown(
        (
            "task",
            "best family",
            "its numbers",
            "seeds of search / judged",
            "planner: intervals ahead, copies",
        ),
        rows,
    )


# Pictures: an episode of a task with what is observed, what is done, and what comes of it.


SEED = 3
DPI = 90
COLOURS = (BLUE, ORANGE)


@dataclass(frozen=True)
class Episode:
    """An episode of a task, step by step.

    Times (n + 1,) in pseudo periods, observations (n + 1, features), actions (n, numbers), and
    levels (n,) relative to those without absorber.

    ``cumulative``: a level is the passage's so far, and not the mean over the last pseudo period,
    or interval if that is longer.
    """

    features: list[str]
    times: Array
    observations: Array
    actions: Array
    levels: Array
    cumulative: bool


def episode(task: str, policy: Any) -> Episode:
    """Play an episode."""
    with optional():
        import gymnasium
    env: Any = gymnasium.make(f"ImpactAbsorber/{task}")
    observation, info = env.reset(seed=SEED)
    policy.start(1)
    times = [float(info["time"])]
    observations = [observation]
    actions = []
    levels = []
    over = False
    while not over:
        action = policy.act(observation[None])[0]
        observation, reward, end, cut, info = env.step(action)
        over = end or cut
        times.append(float(info["time"]))
        observations.append(observation)
        actions.append(action)
        levels.append(float(info.get("relative_level", -float(reward))))
    env.close()
    cumulative = "relative_level" in info
    shares = 1 if cumulative else len(levels)  # of a mean, as rewards are
    last = max(1, round(1 / env.unwrapped.task.interval))
    means = [
        shares * float(np.mean(levels[max(0, k + 1 - last) : k + 1])) for k in range(len(levels))
    ]
    features = [feature.name for feature in env.unwrapped.task.features]
    return Episode(
        features,
        np.array(times),
        np.array(observations),
        np.array(actions),
        np.array(means),
        cumulative,
    )


def save_picture(path: Path, task: str) -> None:
    """Draw an episode under the chosen rule, or under random actions if a task has no rule.

    Observations, actions and levels are drawn, with the actions and levels of the best constant for
    comparison.
    """
    chosen = policies(task) if task in TASKS else {}
    actors = (
        {"the chosen rule": chosen[EIGHT], CONSTANT: chosen[CONSTANT]}
        if chosen
        else {"random actions": RandomPolicy()}
    )
    result = {name: episode(task, policy) for name, policy in actors.items()}
    first = next(iter(actors))
    features = result[first].features
    observations = result[first].observations
    times = result[first].times
    figure, panels = figure_of(
        8.6, 6.0, 3, 1, sharex=True, height_ratios=(0.24 * len(features), 1, 1.2)
    )
    overview, done, came = panels[:, 0]
    visible = observations.T / np.maximum(np.abs(observations).max(axis=0), 1e-12)[:, None]
    edges = np.append(times, 2 * times[-1] - times[-2])
    overview.pcolormesh(
        edges, np.arange(len(features) + 1), visible, cmap="RdBu_r", vmin=-1, vmax=1
    )
    overview.set_yticks(np.arange(len(features)) + 0.5, features, fontsize=8)
    overview.invert_yaxis()
    figure.suptitle(
        f"{task}: what is observed (blue below 0, red above), what is done, and the level",
        fontsize=10,
    )
    for (name, one), colour in zip(result.items(), COLOURS, strict=False):
        for values, style, label in zip(
            one.actions.T, ("-", (0, (2, 1))), (name, f"{name}: second number"), strict=False
        ):
            done.stairs(
                values, one.times, baseline=None, color=colour, ls=style, lw=1.3, label=label
            )
        came.stairs(one.levels, one.times, baseline=None, color=colour, lw=1.3)
    came.axhline(1.0, color=BLACK, lw=0.8, ls=":")
    done.set(ylabel="action", ylim=(-1.08, 1.08))
    came.set(ylabel="level so far" if result[first].cumulative else "RMS and prices")
    came.set(
        xlabel="time in pseudo periods", xlim=(0, max(one.times[-1] for one in result.values()))
    )
    came.set_ylim(bottom=min(0.0, *(float(one.levels.min()) for one in result.values())))
    for panel in (done, came):
        panel.grid(True, color="0.9", lw=0.7)
    figure.align_ylabels([done, came])
    figure.legend(
        *done.get_legend_handles_labels(),
        loc="outside lower center",
        ncols=2,
        frameon=False,
        fontsize=9,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_figure(figure, path, DPI)


NUMBERS = DOCS / "tasks.json.gz"
PAGE = DOCS / "tasks.md"
MARKERS = ("admission", "rules")


def known(file: Path) -> dict[str, Json]:
    """Return the results of earlier runs by task.

    Raises ParameterError if this command did not write the file.
    """
    if not file.exists():
        return {}
    try:
        result = dict(read_json(file)["tasks"])
        rooms(result)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ParameterError(
            f"--json = {file} is not allowed: a file that an earlier run of this command "
            f"wrote ({error!r})"
        ) from error
    return {name: result[name] for name in TASKS if name in result}


@command()
@click.option(
    "--task",
    "tasks",
    multiple=True,
    type=click.Choice(list(TASKS)),
    help="May be repeated.  [default: all that have a planner]",
)
@click.option("--quick", is_flag=True, help="A few seeds and generations: to see that it works.")
@click.option(
    "--judged",
    type=click.IntRange(min=8),
    help="Seeds that all are judged on.  [default: 32 to 64, by task]",
)
@click.option(
    "--agents",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Folder of trained agents to judge beside rules.",
)
@click.option(
    "--json",
    "target",
    type=click.Path(path_type=Path),
    help="File of the numbers, to which others are added.",
)
@click.option(
    "--page",
    type=click.Path(path_type=Path),
    help=f"Write tables and pictures of all tasks, as in docs/{PAGE.name}.",
)
@click.option(
    "--rules",
    type=click.Path(path_type=Path),
    help=f"Write the numbers of all rules, too, as in optimisation/rl/{CHOSEN.name}.",
)
@click.option(
    "--redraw",
    is_flag=True,
    help=(
        "The page again from the numbers in --json; only agents of --agents are judged, beside "
        "these."
    ),
)
def main(
    tasks: tuple[str, ...], quick: bool, judged: int | None, redraw: bool, **files: Path | None
) -> None:
    """Find the best rules of each task, let planners look ahead, and print scores and room."""
    agents, target, page, rules = (files[name] for name in ("agents", "target", "page", "rules"))
    check_target("--json", target)
    check_target("--page", page)
    check_target("--rules", rules)
    if page is not None:
        require_markers(page, PAGE, MARKERS)
    result = known(target or NUMBERS) if target is not None or redraw else {}
    for task in tasks or [name for name, own in TASKS.items() if own.planned]:
        effort = QUICK if quick else EFFORTS[task]
        effort = replace(effort, judged=judged or effort.judged)
        trained = [] if agents is None else find_agents(agents, FINAL, env_of(task))
        if not redraw:
            with Bar(total=tried(task, effort), desc=task, unit="candidate", leave=False) as bar:
                result[task] = admit(task, {}, effort, bar.update)
        if task in result:
            add_agents(task, result[task], trained)
        result = {name: result[name] for name in TASKS if name in result}
        if target is not None:
            write_json(target, {"tasks": result})
    click.echo(rooms(result))
    if rules is not None:
        write_json(rules, {name: one["rules"] for name, one in result.items()})
    if page is not None:
        for name in Bar(NAMES, desc="pictures", unit="task", leave=False):
            save_picture(page.parent / PICTURES / f"{name}.png", name)
        fill(
            page,
            PAGE,
            {"admission": rooms(result), "rules": searches(result)},
        )
