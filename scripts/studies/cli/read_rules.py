"""Actions of agents within a period, and rules of twelve parameters derived from them.

The actions are shown as pictures.
"""

# needs: env, optimise

from itertools import pairwise
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.envs.evaluation import SEED_SPLITS, bootstrap_interval
from optimisation.cli.common import check_target, command
from optimisation.executors import Bar
from optimisation.files import DOCS, markdown, read_json, write_json
from optimisation.report.report import figure_of, write_figure
from optimisation.rl.agents import load_agent
from optimisation.rl.demonstrations import record
from optimisation.rl.families import FamilyPolicy
from optimisation.rl.rules import EIGHT, READ, SideAndSlip, env_of, policies
from studies.agent_rules import (
    QUARTERS,
    QUICK,
    STATES,
    Effort,
    compare_with_rule,
    map_actions,
    read_rule,
)

DRAWN_STATES = {"ActiveFriction-v0": "place", "ActiveGap-v0": "slip", "Structures-v0": "place"}
EPISODES = 128  # of a picture
ALGORITHM = "rpi"
DPI = 90


def save_actions(path: Path, task: str, actors: dict[str, Any]) -> None:
    """Draw mean actions over phase and state.

    Each policy has a column, each range of the response size a row.
    """
    first = SEED_SPLITS["validation"][0]
    state = DRAWN_STATES[task]
    figure, panels = figure_of(
        3.1 * len(actors) + 1, 2.5 * (len(QUARTERS) - 1) + 0.4, len(QUARTERS) - 1, len(actors)
    )
    for column, (name, actor) in enumerate(actors.items()):
        episodes = record(actor, env_of(task), range(first, first + EPISODES))
        observations = np.concatenate([rows[:-1] for rows in episodes.observations])
        actions = np.concatenate(episodes.actions)[:, 0].astype(np.float64)
        edges = np.percentile(observations[:, 9], QUARTERS)
        for row, sizes in enumerate(pairwise(edges)):
            panel = panels[row, column]
            known = map_actions(observations, actions, state, sizes)
            image = panel.pcolormesh(
                known.phases, known.states, known.actions.T, cmap="RdBu_r", vmin=-1, vmax=1
            )
            panel.set_title(f"{name}, size {sizes[0]:.2f} to {sizes[1]:.2f}", fontsize=8)
            if column == 0:
                panel.set_ylabel(STATES[state][0], fontsize=7)
            if row == len(QUARTERS) - 2:
                panel.set_xlabel("phase of the tip / pi (0: largest displacement)", fontsize=7)
            panel.tick_params(labelsize=7)
            panel.set_xticks((-1, -0.5, 0, 0.5, 1))
    figure.colorbar(image, ax=panels, label="action", shrink=0.8)
    figure.suptitle(f"{task}: mean action, RMS of the last period in half-clearances", fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_figure(figure, path, DPI)


@command()
@click.option(
    "--task",
    "tasks",
    multiple=True,
    type=click.Choice(list(DRAWN_STATES)),
    help="May be repeated.  [default: all within a period]",
)
@click.option(
    "--agent",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="File of an agent, for a single --task.  [default: the one that ships]",
)
@click.option("--quick", is_flag=True, help="A few seeds and generations: to see that it works.")
@click.option("--redraw", is_flag=True, help="Only the pictures and the table, without a search.")
@click.option(
    "--json",
    "target",
    type=click.Path(path_type=Path),
    help="File of the rules' numbers, to which others are added.",
)
@click.option(
    "--pictures",
    type=click.Path(path_type=Path, file_okay=False),
    help=f"Folder of the pictures, as {DOCS.name}/tasks.",
)
def main(
    tasks: tuple[str, ...],
    agent: Path | None,
    quick: bool,
    redraw: bool,
    target: Path | None,
    pictures: Path | None,
) -> None:
    """Fit rules to agents and refine them by CMA-ES.

    The command prints how far their scores are above those of the rule of eight parameters on the
    validation seeds.
    """
    check_target("--json", target, (".json",))
    known = dict(read_json(target)) if target is not None and target.exists() else {}
    effort = QUICK if quick else Effort()
    rows = []
    for task in tasks or DRAWN_STATES:
        player = load_agent(task, ALGORITHM) if agent is None else load_agent(agent)
        if not redraw:
            total = effort.search.generations * effort.search.population
            with Bar(total=total, desc=task, unit="candidate", leave=False) as bar:
                rule = read_rule(task, player, effort, bar.update)
            known[task] = {
                READ: {"family": SideAndSlip.__name__, "numbers": list(rule.numbers)},
                "explained": rule.explained,
            }
            if target is not None:
                write_json(target, known)
        if task not in known:
            continue
        numbers = known[task][READ]["numbers"]
        over = compare_with_rule(task, numbers, "validation")
        low, high = bootstrap_interval(np.mean, over[None])
        rows.append(
            (
                f"`{task}`",
                ", ".join(f"{number:.3f}" for number in numbers),
                f"{known[task]['explained']:.2f}",
                f"{over.mean():+.3f} [{low:+.3f}, {high:+.3f}]",
            )
        )
        if pictures is not None:
            own = FamilyPolicy(READ, SideAndSlip(), numbers)
            actors = {EIGHT: policies(task)[EIGHT], "agent": player, READ: own}
            save_actions(pictures / f"actions_{task}.png", task, actors)
    header = ("task", "numbers", "explained variance of the fit", "over the rule of 8, validation")
    click.echo(markdown(header, rows))
