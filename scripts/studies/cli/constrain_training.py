"""Training of agents with a limit of one cost by a Lagrange multiplier.

For comparison, MO-Gymnasium's linear rewards give the front of the level over that cost.
"""

# needs: env, rl

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env.envs.evaluation import EPISODES, SEED_SPLITS, bootstrap_interval
from impact_env.extras import optional
from optimisation.cli.common import command
from optimisation.files import markdown
from optimisation.report.report import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    draw_grid,
    figure_of,
    write_figure,
)
from optimisation.rl.rules import EIGHT, env_of, policies
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_folder_options,
    add_sources,
    make_rows_study,
    run,
)

NAME = "constrained_training"
FRONT = "cost_front"
PAGE = "tasks"
LANES = 128
LINEAR_LANES = 64  # of single environments
ROUND = 80  # intervals of a lane
REWARD_SCALE = 50.0
INTERVALS = 160  # of an episode
MULTIPLIER_SEEDS = range(900_000, 900_064)  # of training
STEPS = 1_200_000
QUICK_STEPS = 20_480
UNLIMITED = "PPO"
LIMITED = "PPO with a limit"
LINEAR = "PPO with a weight"


class CostLimits(NamedTuple):
    """A cost of a task, with its limits and weights.

    The fields are the cost's column, name and unit, limits of its mean, and its weights in linear
    rewards.
    """

    column: int
    name: str
    unit: str
    limits: tuple[float, ...]
    weights: tuple[float, ...]


COSTS = {
    "ActiveFriction-v0": CostLimits(
        3, "way of the actuator", "half range an interval", (0.30, 0.14), (0.05, 0.15, 0.4)
    )
}


class Settings(NamedTuple):
    """Settings of the study.

    They are the number of steps of each agent, the number of test episodes, and whether the linear
    rewards of MO-Gymnasium are tried.
    """

    steps: int
    episodes: int
    with_front: bool


def aim_of(task: str) -> list[float]:
    """Return the weights of the costs with which they give the task's own score.

    The level has the weight 1. The actuator's travel has the task's price as weight.
    """
    with optional():
        import gymnasium
    env: Any = gymnasium.make(env_of(task))
    price = env.unwrapped.task.describe()["price"]
    env.close()
    return [1.0, 0.0, 0.0, price, 0.0]


def make_ppo(lanes: Any, task: str, seed: int) -> tuple[Any, Any]:
    """Return an untrained PPO model, and the policy that adds its action to the rule of eight.

    The lanes of the model add its action to that of the rule, too. Their rewards are scaled.
    """
    from optimisation.rl.models import ScaledRewards
    from optimisation.rl.residual import AddRule, RuleAndNetwork

    with optional():
        from stable_baselines3 import PPO
    rule = policies(task)[EIGHT]
    model = PPO(
        "MlpPolicy",
        ScaledRewards(AddRule(lanes, rule), REWARD_SCALE),
        n_steps=ROUND,
        batch_size=1024,
        n_epochs=4,
        gamma=0.98,
        learning_rate=lambda left: 5e-5 + 4.5e-4 * left,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -1.2},
        seed=seed,
        device="cpu",
    )
    return model, RuleAndNetwork(model, policies(task)[EIGHT], 1)


def make_linear_lanes(task: str, weights: Sequence[float], lanes: int) -> Any:
    """Return lanes of single environments whose reward is the linear one of MO-Gymnasium."""
    with optional():
        from stable_baselines3.common.vec_env import DummyVecEnv
    library: Any = import_module("mo_gymnasium")

    def make_one() -> Any:
        return library.wrappers.LinearReward(
            library.make(env_of(task), vector_reward=True), np.asarray(weights)
        )

    return DummyVecEnv([make_one] * lanes)


def measure_policy(task: str, kind: str, value: float | None, settings: Settings) -> list[Json]:
    """Return the row of a policy: the rule, or a trained agent.

    An agent is trained without a limit, with a limit, or with a weight of the cost.
    """
    from optimisation.rl.costs import LagrangeMultiplier, make_weighted_lanes, mean_costs

    cost = COSTS[task]
    seeds = SEED_SPLITS["test"][: settings.episodes]
    aim = aim_of(task)
    multiplier = None
    if kind == EIGHT:
        policy: Any = policies(task)[EIGHT]
    else:
        if kind == LINEAR:
            assert value is not None
            aim[cost.column] += value / INTERVALS
            lanes = make_linear_lanes(task, aim, LINEAR_LANES)
        else:
            lanes = make_weighted_lanes(env_of(task), LANES, aim, {"threads": 1})
        model, policy = make_ppo(lanes, task, 0)
        callback = None
        if kind == LIMITED:
            assert value is not None
            callback = LagrangeMultiplier(
                lanes, cost.column, value, policy, env_of(task), MULTIPLIER_SEEDS, INTERVALS
            )
        model.learn(settings.steps, callback=callback)
        multiplier = None if callback is None else callback.multiplier
    costs = mean_costs(policy, env_of(task), seeds)
    scores = -(costs @ np.array(aim_of(task))) * INTERVALS
    return [
        {
            "task": task,
            "kind": kind,
            "value": value,
            "multiplier": multiplier,
            "scores": [round(s, 6) for s in scores.tolist()],
            "costs": [round(c, 6) for c in costs[:, cost.column].tolist()],
        }
    ]


def list_cases(settings: Settings) -> Mapping[Any, Callable[[], list[Json]]]:
    """Return a function for each policy of each task."""
    cases = [
        (task, kind, value)
        for task, cost in COSTS.items()
        for kind, values in ((EIGHT, (None,)), (UNLIMITED, (None,)), (LIMITED, cost.limits))
        for value in values
    ]
    if settings.with_front:
        cases += [(task, LINEAR, w) for task, cost in COSTS.items() for w in cost.weights]
    return {case: partial(measure_policy, *case, settings) for case in cases}


def format_mean(values: Sequence[float]) -> str:
    """Return a mean with its 95 % interval over the episodes."""
    low, high = bootstrap_interval(np.mean, np.array(values)[None])
    return f"{np.mean(values):.3f} [{low:.3f}, {high:.3f}]"


def make_limit_table(measured: Measurement) -> str:
    """Return a line for each policy: limit, score and the limited cost."""
    lines = [
        (
            f"`{row['task']}`",
            row["kind"],
            "-"
            if row["value"] is None
            else f"{COSTS[row['task']].name}: {row['value']:.2f} {COSTS[row['task']].unit}",
            format_mean(row["scores"]),
            format_mean(row["costs"]),
            "-" if row["multiplier"] is None else f"{row['multiplier']:.3f}",
        )
        for row in measured.values["rows"]
        if row["kind"] != LINEAR
    ]
    head = ("task", "policy", "limit", "mean score", "limited cost, mean", "multiplier at the end")
    settings = measured.values["settings"]
    return (
        f"{markdown(head, lines)}\n\n{settings['steps']:,} steps an agent, one agent each; "
        f"{settings['episodes']} test episodes, 95 % intervals over them."
    )


def make_front_table(measured: Measurement) -> str:
    """Return a line for each weight of the linear reward."""
    rows = [row for row in measured.values["rows"] if row["kind"] == LINEAR]
    lines = [
        (
            f"`{row['task']}`",
            f"{row['value']:g}",
            format_mean(row["scores"]),
            format_mean(row["costs"]),
        )
        for row in rows
    ]
    names = {row["task"]: COSTS[row["task"]] for row in rows}
    (cost,) = names.values() or tuple(COSTS.values())
    head = ("task", f"weight of the {cost.name}", "mean score", f"{cost.name} ({cost.unit})")
    return markdown(head, lines)


def save_front(path: Path, measured: Measurement) -> None:
    """Draw the score over the cost in a panel for each task.

    A panel shows the rule, agents without and with limits, and the front of the weights.
    """
    figure, panels = figure_of(5.6 * len(COSTS), 3.8, 1, len(COSTS))
    styles = {EIGHT: (BLACK, "s"), UNLIMITED: (GREEN, "o"), LIMITED: (ORANGE, "^")}
    for panel, (task, cost) in zip(np.ravel(panels), COSTS.items(), strict=True):
        rows = [row for row in measured.values["rows"] if row["task"] == task]
        for kind, (colour, mark) in styles.items():
            own = [row for row in rows if row["kind"] == kind]
            points = [(np.mean(row["costs"]), np.mean(row["scores"])) for row in own]
            if points:
                panel.plot(*np.array(points).T, mark, color=colour, label=kind)
            for row in own:
                if kind == LIMITED:
                    panel.axvline(row["value"], color=colour, lw=0.8, ls=":")
        front = sorted(
            (np.mean(row["costs"]), np.mean(row["scores"])) for row in rows if row["kind"] == LINEAR
        )
        if front:
            panel.plot(*np.array(front).T, "-x", color=BLUE, label="weights, MO-Gymnasium")
        panel.set(title=task, xlabel=f"{cost.name} ({cost.unit})", ylabel="mean score")
        panel.legend(fontsize=8, frameon=False)
        draw_grid(panel)
    write_figure(figure, path, dpi=110)


def describe_settings(settings: Settings) -> Json:
    """Return what the rows depend on."""
    return {"settings": {"steps": settings.steps, "episodes": settings.episodes}}


STUDY: Study[Settings] = make_rows_study(
    NAME,
    "agents with a limit of one cost",
    list_cases,
    lambda row: (row["task"], row["kind"], row["value"]),
    make_limit_table,
    key_values=describe_settings,
    markers=(NAME, FRONT),
    sections=lambda measured: {
        NAME: make_limit_table(measured),
        FRONT: add_sources(make_front_table)(measured),
    },
    summary=None,
    figures=lambda measured: {NAME: partial(save_front, measured=measured)},
    stopped_message="trained agents' scores are in the file.",
)


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_STEPS:,} steps an agent, 16 episodes.")
@click.option(
    "--steps", type=click.IntRange(1), default=STEPS, show_default=True, help="Steps of each agent."
)
@click.option("--front", is_flag=True, help="Also the linear rewards; needs MO-Gymnasium.")
@add_folder_options(PAGE)
def main(quick: bool, redraw: bool, steps: int, front: bool, place: OutputPaths) -> None:
    """Train agents with limits of a cost and score them on test seeds.

    A run that was stopped continues when the command is called again.
    """
    settings = Settings(QUICK_STEPS, 16, front) if quick else Settings(steps, EPISODES, front)
    run(STUDY, settings, place, redraw=redraw)
