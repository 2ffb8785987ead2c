"""Loss of rules and agents on a machine that differs from the model of its control.

The differences are noise, delays, a coarse actuator, and other friction and damping.
"""

# needs: env

import hashlib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env.envs.evaluation import (
    EPISODES,
    SEED_SPLITS,
    bootstrap_interval,
    difference_of_means,
    play,
)
from optimisation.cli.common import command
from optimisation.files import markdown
from optimisation.rl.agents import Agent, list_shipped, load_agent
from optimisation.rl.rules import CONSTANT, EIGHT, env_of, policies
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_folder_options,
    make_rows_study,
    not_none,
    run,
)

NAME = "real_controller"
TASKS = ("ActiveFriction-v0", "ActiveGap-v0")
QUICK_EPISODES = 16
IDEAL = "as the control takes it"
ALL = "all but the actuator's delay"
# what agents for real machines are trained on; the widths are a choice
RANDOMISED: dict[str, Any] = {
    "observation_noise": 0.05,
    "observation_delay": 1,
    "action_levels": 8,
    "friction_error": (-0.2, 0.2),
    "damping_error": (-0.3, 0.3),
}
MACHINES: dict[str, dict[str, Any]] = {
    IDEAL: {},
    "noise, 0.05 of each unit": {"observation_noise": 0.05},
    "sensors an interval late": {"observation_delay": 1},
    "actuator an interval late": {"action_delay": 1},
    "actuator with 8 levels": {"action_levels": 8},
    "friction 20 % higher": {"friction_error": 0.2},
    "friction 20 % lower": {"friction_error": -0.2},
    "damping 30 % higher": {"damping_error": 0.3},
    "damping 30 % lower": {"damping_error": -0.3},
    ALL: RANDOMISED,
}


class Settings(NamedTuple):
    """Number of episodes, and agents beside those that ship."""

    episodes: int
    agents: tuple[Agent, ...]


def name_agent(agent: Agent) -> str:
    """Return the name of an agent in the table: whether it was trained on machines that differ."""
    trained = "on machines that differ" if agent.arguments else "on the ideal machine"
    return f"{agent.algorithm.upper()} trained {trained}, seed {agent.seed}"


def list_policies(task: str, agents: tuple[Agent, ...]) -> dict[str, Any]:
    """Return the policies of a task.

    They are the best constant, the best rule, the agents that the package contains, and the given
    agents.
    """
    rules = policies(task)
    own = [load_agent(task, algorithm) for algorithm in list_shipped().get(task, [])]
    chosen = [agent for agent in agents if agent.env_id == env_of(task)]
    return {CONSTANT: rules[CONSTANT], EIGHT: rules[EIGHT]} | {
        name_agent(agent): agent for agent in (*own, *chosen)
    }


def digest_policy(policy: Any) -> str:
    """Return a hash of a policy's parameters.

    If a policy has the same name but another hash, its rows are measured again.
    """
    layers = (
        [*policy.layers, policy.cells or ()]
        if isinstance(policy, Agent)
        else [(policy.parameters,)]
    )
    numbers = [np.ascontiguousarray(part).tobytes() for layer in layers for part in layer]
    return hashlib.sha256(b"".join(numbers)).hexdigest()[:16]


def measure_machine(task: str, machine: str, settings: Settings) -> list[Json]:
    """Return a row for each policy on a machine.

    A row has the mean score, its change from the ideal machine on the same seeds, and 95 %
    intervals.
    """
    seeds = SEED_SPLITS["test"][: settings.episodes]
    rows = []
    for name, policy in list_policies(task, settings.agents).items():
        ideal, scores = (
            play(policy, env_of(task), seeds, MACHINES[key]).scores for key in (IDEAL, machine)
        )
        low, high = bootstrap_interval(np.mean, scores[None])
        lost = bootstrap_interval(difference_of_means, scores[None], ideal[None])
        rows.append(
            {
                "task": task,
                "machine": machine,
                "policy": name,
                "score": float(scores.mean()),
                "interval": [float(low), float(high)],
                "change": [float(scores.mean() - ideal.mean()), *lost.tolist()],
            }
        )
    return rows


def list_cases(settings: Settings) -> Mapping[Any, Callable[[], list[Json]]]:
    """Return a function for each task and machine that measures its rows."""
    return {
        (task, machine): partial(measure_machine, task, machine, settings)
        for task in TASKS
        for machine in MACHINES
    }


def write_cell(row: Json) -> str:
    """Return score and change of a row."""
    low, high = row["interval"]
    if row["machine"] == IDEAL:
        return f"{row['score']:.3f} [{low:.3f}, {high:.3f}]"
    change, low, high = row["change"]
    return f"{row['score']:.3f}; {change:+.3f} [{low:+.3f}, {high:+.3f}]"


def make_tables(measured: Measurement) -> str:
    """Return a table for each task, a line for each machine."""
    parts = []
    for task in TASKS:
        rows = [row for row in measured.values["rows"] if row["task"] == task]
        names = list(dict.fromkeys(row["policy"] for row in rows))
        cells = {(row["machine"], row["policy"]): write_cell(row) for row in rows}
        lines = [
            [machine, *(cells.get((machine, name), "-") for name in names)]
            for machine in MACHINES
            if any(row["machine"] == machine for row in rows)
        ]
        parts.append(f"**`{task}`**\n\n{markdown(('machine', *names), lines)}")
    return "\n\n".join(parts)


def describe_settings(settings: Settings) -> Json:
    """Return what the rows depend on."""
    return {
        "episodes": settings.episodes,
        "policies": {
            task: {name: digest_policy(policy) for name, policy in listed.items()}
            for task in TASKS
            for listed in (list_policies(task, settings.agents),)
        },
    }


STUDY: Study[Settings] = make_rows_study(
    NAME,
    "what rules and agents lose on another machine",
    list_cases,
    lambda row: (row["task"], row["machine"]),
    make_tables,
    key_values=describe_settings,
    stopped_message="finished machines are in the file.",
)


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_EPISODES} episodes instead of {EPISODES}.")
@click.option(
    "--agent",
    "files",
    type=click.Path(path_type=Path, dir_okay=False),
    multiple=True,
    help="File of a further agent; may be repeated (default: those in the folder of the numbers).",
)
@add_folder_options(NAME)
def main(quick: bool, redraw: bool, files: tuple[Path, ...], place: OutputPaths) -> None:
    """Evaluate rules and agents on machines that differ from the model of their control.

    They run on test seeds.
    """
    chosen = files or sorted(not_none(place.folder).glob("*.npz"))
    agents = tuple(load_agent(file) for file in chosen)
    settings = Settings(QUICK_EPISODES if quick else EPISODES, agents)
    run(STUDY, settings, place, redraw=redraw)
