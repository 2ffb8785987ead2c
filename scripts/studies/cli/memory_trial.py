"""Benefit of memory for an agent that observes only noisy accelerations.

PPO is trained on the last observation, on the last eight, and with a recurrent network.
"""

# needs: env, rl

from collections.abc import Callable, Mapping
from functools import partial
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
from impact_env.extras import optional
from optimisation.cli.common import command
from optimisation.files import markdown
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_folder_options,
    make_rows_study,
    run,
)

NAME = "memory_trial"
PAGE = "real_controller"
ENV_ID = "ImpactAbsorber/RawSensors-v0"
LAST = "last observation"
STACKED = "last 8 observations"
RECURRENT = "recurrent network"
KINDS = (LAST, STACKED, RECURRENT)
FRAMES = 8  # two periods
SEEDS = 10
STEPS = 1_000_000
QUICK_STEPS = 20_480
LANES = 128
REWARD_SCALE = 50.0


class Settings(NamedTuple):
    """Number of agents of each kind, steps of each, number of test episodes, and the kinds."""

    seeds: int
    steps: int
    episodes: int
    kinds: tuple[str, ...]


class StackedPolicy:
    """A model that acts on the last `FRAMES` observations, as `evaluate` takes policies."""

    name = STACKED

    def __init__(self, model: Any) -> None:
        self.model = model

    def start(self, lanes: int) -> None:
        """Begin new episodes: nothing has been observed."""
        self._frames: np.ndarray | None = None
        self._lanes = lanes

    def act(self, observations: np.ndarray) -> np.ndarray:
        """Return the actions for the observations so far."""
        if self._frames is None:
            width = observations.shape[1]
            self._frames = np.zeros((self._lanes, FRAMES * width), dtype=np.float32)
        self._frames = np.roll(self._frames, -observations.shape[1], axis=1)
        self._frames[:, -observations.shape[1] :] = observations
        actions: np.ndarray = self.model.predict(self._frames, deterministic=True)[0]
        return actions


def make_model(kind: str, seed: int) -> Any:
    """Return an untrained model of a kind, with its lanes."""
    from optimisation.rl.models import ScaledRewards
    from optimisation.rl.vec_env import make_native

    with optional():
        from sb3_contrib import RecurrentPPO
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import VecFrameStack, VecMonitor

    env: Any = ScaledRewards(VecMonitor(make_native(ENV_ID, LANES)), REWARD_SCALE)
    env.seed(seed)
    options: dict[str, Any] = {
        "n_steps": 80,
        "n_epochs": 4,
        "gamma": 0.98,
        "learning_rate": lambda left: 5e-5 + 4.5e-4 * left,
        "seed": seed,
        "device": "cpu",
    }
    shape: dict[str, Any] = {"net_arch": [64, 64], "log_std_init": -0.8}
    if kind == RECURRENT:
        shape["lstm_hidden_size"] = 64
        return RecurrentPPO("MlpLstmPolicy", env, batch_size=2560, policy_kwargs=shape, **options)
    if kind == STACKED:
        env = VecFrameStack(env, FRAMES)
    return PPO("MlpPolicy", env, batch_size=1024, policy_kwargs=shape, **options)


def measure_agent(kind: str, seed: int, settings: Settings) -> list[Json]:
    """Train an agent and return its scores on the test seeds."""
    model = make_model(kind, seed)
    model.learn(settings.steps)
    policy = StackedPolicy(model) if kind == STACKED else model
    scores = play(policy, ENV_ID, SEED_SPLITS["test"][: settings.episodes]).scores
    return [{"kind": kind, "seed": seed, "scores": [round(s, 6) for s in scores.tolist()]}]


def list_cases(settings: Settings) -> Mapping[Any, Callable[[], list[Json]]]:
    """Return a function for each agent that trains and plays it, seed after seed."""
    return {
        (kind, seed): partial(measure_agent, kind, seed, settings)
        for seed in range(settings.seeds)
        for kind in settings.kinds
    }


def make_table(measured: Measurement) -> str:
    """Return a line for each kind: mean score, and its difference to the last observation.

    The mean is over agents and test episodes. The difference is to the mean of agents that observe
    only the last observation.
    """
    rows = measured.values["rows"]
    scores = {
        kind: np.array([row["scores"] for row in rows if row["kind"] == kind])
        for kind in KINDS
        if any(row["kind"] == kind for row in rows)
    }
    lines = []
    for kind, own in scores.items():
        low, high = bootstrap_interval(np.mean, own)
        better = "-"
        if kind != LAST and LAST in scores:
            ends = bootstrap_interval(difference_of_means, own, scores[LAST])
            difference = own.mean() - scores[LAST].mean()
            better = f"{difference:+.3f} [{ends[0]:+.3f}, {ends[1]:+.3f}]"
        lines.append([kind, str(len(own)), f"{own.mean():.3f} [{low:.3f}, {high:.3f}]", better])
    settings = measured.values["settings"]
    head = ("PPO on", "agents", "mean test score", "higher than on the last observation")
    return (
        f"{markdown(head, lines)}\n\n"
        f"{settings['steps']:,} steps an agent, {settings['episodes']} test episodes; 95 % "
        "intervals over agents and episodes."
    )


def describe_settings(settings: Settings) -> Json:
    """Return what the rows depend on."""
    return {"settings": {"steps": settings.steps, "episodes": settings.episodes}}


STUDY: Study[Settings] = make_rows_study(
    NAME,
    "whether memory pays with accelerometers",
    list_cases,
    lambda row: (row["kind"], row["seed"]),
    make_table,
    key_values=describe_settings,
    stopped_message="trained agents' scores are in the file.",
)


@command()
@click.option("--quick", is_flag=True, help=f"One seed of {QUICK_STEPS:,} steps, 16 episodes.")
@click.option(
    "--seeds", type=click.IntRange(1), default=SEEDS, show_default=True, help="Agents of each kind."
)
@click.option(
    "--steps", type=click.IntRange(1), default=STEPS, show_default=True, help="Steps of each agent."
)
@click.option(
    "--kind",
    "kinds",
    type=click.Choice(KINDS),
    multiple=True,
    help="Kind of agent; may be repeated (default: all).",
)
@add_folder_options(PAGE)
def main(
    quick: bool, redraw: bool, seeds: int, steps: int, kinds: tuple[str, ...], place: OutputPaths
) -> None:
    """Train agents with and without memory on RawSensors-v0 and score them on test seeds.

    An interrupted run continues when the command is called again.
    """
    chosen = kinds or KINDS
    settings = (
        Settings(1, QUICK_STEPS, 16, chosen) if quick else Settings(seeds, steps, EPISODES, chosen)
    )
    run(STUDY, settings, place, redraw=redraw)
