"""Training of one agent in legs: learn, evaluate, write a checkpoint.

A run that was killed continues from its last checkpoint.

A checkpoint contains the model, the states of its lanes, and for SAC the replay buffer; each leg
seeds all generators from the run's seed and the leg's number. A resumed run therefore equals an
uninterrupted one, number by number (on one machine, with the same versions and compiled kernels).
"""

import json
import platform
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from impact_env.checks import (
    ParameterError,
    count_from,
    describe_error,
    kind_of,
    require,
)
from impact_env.envs.evaluation import interquartile_mean, play
from impact_env.envs.vector_shell import TaskVectorEnv
from impact_env.extras import optional
from impact_env.fields import check_fields
from optimisation.checkpoint import difference, installed_versions
from optimisation.executors import Bar, Pool, PoolTask
from optimisation.files import require_writable, write_json
from optimisation.rl.agents import (
    CHECKPOINT_AGENT,
    FINAL,
    SETTINGS,
    TrainingEvaluation,
    actor_of,
    load_agent,
    read_evaluations,
    save_agent,
    write_evaluations,
)
from optimisation.rl.hyperparameters import FRESH, PPOSettings, Settings
from optimisation.rl.models import (
    ScaledRewards,
    begin_leg,
    best_checkpoint,
    forget_replay,
    last_checkpoint,
    make_lanes,
    make_model,
    save_checkpoint,
)
from optimisation.rl.starts import apply_start, describe_start

with optional():
    import gymnasium
    import torch
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

RUN_FORMAT = 3
PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "torch",
    "gymnasium",
    "stable_baselines3",
)  # what a training's digits may depend on
# apart from the seeds on which baselines are tuned, and from those on which all are judged
FIRST_EVALUATION_SEED = 1_000_000
EVALUATION_EPISODES = 256  # the choice of a checkpoint by fewer would be one by chance
Show = Callable[[int, list[TrainingEvaluation]], None]


@dataclass(frozen=True)
class Job:
    """An agent to train.

    It has an environment with its ``arguments``, the hyperparameters of an algorithm and a seed.
    """

    env_id: str
    algorithm: str
    seed: int
    hyperparameters: Settings
    arguments: Mapping[str, Any] = field(default_factory=dict)
    episodes: int = EVALUATION_EPISODES

    def __post_init__(self) -> None:
        check_fields(
            self,
            seed=count_from(0),
            hyperparameters=kind_of(Settings),
            arguments=kind_of(Mapping),
            episodes=count_from(1),
        )
        start = self.hyperparameters.start
        memory = self.algorithm == "rppo"
        require(
            not memory or start == FRESH,
            "start",
            start,
            f"{FRESH} for rppo: an imitation of single steps teaches no memory",
        )

    def describe(self) -> dict[str, Any]:
        """Return everything on which the result depends as JSON values.

        The environment is described with all its arguments, also those with default values.
        """
        env = gymnasium.make_vec(
            self.env_id, num_envs=1, vectorization_mode="vector_entry_point", **self.arguments
        )
        try:
            if not isinstance(env, TaskVectorEnv):
                allowed = "one of the environments of impact_env"
                raise describe_error("env_id", self.env_id, allowed)
            environment = env.task.describe()
        finally:
            env.close()
        own = {
            "environment": self.env_id,
            "environment_arguments": environment,
            "algorithm": self.algorithm,
            "seed": self.seed,
        }
        evaluation = {"first_seed": FIRST_EVALUATION_SEED, "episodes": self.episodes}
        hyperparameters = self.hyperparameters.describe()
        hyperparameters.pop("start")  # a path, perhaps: what is behind it counts
        whole = {
            "format": RUN_FORMAT,
            **own,
            **describe_start(self.hyperparameters, self.env_id, self.algorithm),
            "hyperparameters": hyperparameters,
            "evaluation": evaluation,
        }
        return dict(json.loads(json.dumps(whole)))


def evaluate(policy: Any, job: Job, leg: int, steps: int) -> TrainingEvaluation:
    """Return a policy's evaluation on the job's seeds for it."""
    played = play(
        policy,
        job.env_id,
        range(FIRST_EVALUATION_SEED, FIRST_EVALUATION_SEED + job.episodes),
        job.arguments,
    )
    low, high = np.percentile(played.scores, (10, 90)).tolist()
    return TrainingEvaluation(
        leg,
        steps,
        float(played.scores.mean()),
        interquartile_mean(played.scores),
        low,
        high,
        float(played.steps.mean()),
    )


def train(
    job: Job, folder: Path, show: Show | None = None, threads: int | None = None
) -> list[TrainingEvaluation]:
    """Train an agent in a folder, or continue its training, and return its evaluations.

    A finished agent is not trained again. The folder gets settings.json, evaluations.csv, final.npz
    (`load_agent`), checkpoints/ and tensorboard/. The agent of final.npz is that of the leg with
    the best evaluation. ``show`` is called with the number of finished steps and the evaluations so
    far. After a KeyboardInterrupt the present leg is lost. Raises ParameterError if the folder
    contains a run with other settings, or is in use.
    """
    require_writable("folder", folder)
    with _folder_lock(folder):
        check_folder(job, folder)
        if not (folder / SETTINGS).exists():
            versions = {"python": platform.python_version(), **installed_versions(PACKAGES)}
            write_json(folder / SETTINGS, job.describe() | {"versions": versions})
        show = show or (lambda _steps, _evaluations: None)
        if (
            folder / FINAL
        ).exists():  # SAC's memory is gone with the end, so that its checkpoints are not whole
            forget_replay(folder / "checkpoints")
            evaluations = list(read_evaluations(folder))
            show(evaluations[-1].steps, evaluations)
            return evaluations
        env = make_lanes(job.env_id, job.hyperparameters, job.arguments, threads)
        before = torch.get_num_threads()
        torch.set_num_threads(
            1
        )  # the networks are so small that more threads only wait for one another
        try:
            return _train(job, folder, env, show)
        finally:
            torch.set_num_threads(before)
            env.close()


@contextmanager
def _folder_lock(folder: Path) -> Iterator[None]:
    """Lock a folder for this process; the system releases the lock when the process ends."""
    try:
        with FileLock(folder / ".lock", blocking=False):
            yield
    except Timeout as error:
        raise ParameterError(
            f"folder = {str(folder)!r} is not allowed: one that no other process trains in"
        ) from error


def _train(job: Job, folder: Path, env: ScaledRewards, show: Show) -> list[TrainingEvaluation]:
    chosen = job.hyperparameters
    checkpoints = folder / "checkpoints"
    last = last_checkpoint(checkpoints, job.algorithm, env)
    model, evaluations = last or (make_model(chosen, env, job.seed), [])
    if last is None:
        apply_start(model, chosen, job.env_id, job.algorithm, job.arguments, job.seed)
    show(model.num_timesteps, evaluations)
    if len(evaluations) < chosen.legs:
        model.set_logger(Logger(None, [TensorBoardOutputFormat(str(folder / "tensorboard"))]))
    for leg in range(len(evaluations), chosen.legs):
        begin_leg(model, job.seed, leg, chosen.rate_of(leg))
        # rounded up; a leg may end later, since a round of the algorithm is always completed
        last_step = -(-chosen.steps * (leg + 1) // chosen.legs)
        todo = last_step - model.num_timesteps
        if todo > 0:
            model.learn(
                todo,
                callback=[_Watch(show, evaluations), _CriticFirst(chosen)],
                log_interval=chosen.log_interval,
                reset_num_timesteps=False,
            )
        agent = actor_of(model, job.env_id, job.seed, job.arguments)
        evaluations = [*evaluations, evaluate(agent, job, leg, model.num_timesteps)]
        for name in ("score", "iqm", "intervals"):
            model.logger.record(f"evaluation/{name}", getattr(evaluations[-1], name))
        model.logger.dump(model.num_timesteps)
        save_checkpoint(checkpoints, leg, model, env, evaluations, agent)
        write_evaluations(folder, evaluations)
        show(model.num_timesteps, evaluations)
    save_agent(folder / FINAL, load_agent(best_checkpoint(checkpoints) / CHECKPOINT_AGENT))
    forget_replay(checkpoints)
    return evaluations


class _Watch(BaseCallback):
    """Callback that reports the progress of a leg."""

    def __init__(self, show: Show, evaluations: list[TrainingEvaluation]) -> None:
        super().__init__()
        self.show = show
        self.evaluations = evaluations

    def _on_step(self) -> bool:
        self.show(self.num_timesteps, self.evaluations)
        return True


class _CriticFirst(BaseCallback):
    """Trains PPO's critic alone in the first rounds of a run."""

    def __init__(self, chosen: Settings) -> None:
        super().__init__()
        rounds = chosen.critic_rounds if isinstance(chosen, PPOSettings) else 0
        self.steps = rounds * chosen.round

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        if self.steps == 0:
            return
        trains = self.num_timesteps > self.steps
        policy: Any = self.model.policy
        for part in (policy.mlp_extractor.policy_net, policy.action_net):
            part.requires_grad_(trains)
        policy.log_std.requires_grad_(trains)


def check_folder(job: Job, folder: Path) -> None:
    """Raise ParameterError if a folder holds a run with other settings than the job's.

    A new folder is allowed.
    """
    file = folder / SETTINGS
    if not file.exists():
        return
    wanted = job.describe()
    try:
        held = json.loads(file.read_text(encoding="utf-8"))
        held.pop("versions", None)
    except (OSError, ValueError, AttributeError) as error:
        raise ParameterError(
            f"folder = {str(folder)!r} is not allowed: its {SETTINGS} cannot be read "
            f"({error}); choose another"
        ) from error
    if held != wanted:
        other = difference(held, wanted)
        raise ParameterError(
            f"folder = {str(folder)!r} is not allowed: it holds a run of other settings: "
            f"{other}; choose another, or remove it"
        )


# What `train` does with its runs: one after the other with a live bar, or in several processes
# whose files are watched.


BAR = (
    "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} steps [{elapsed}, {remaining} "
    "left{postfix}]"
)
WATCH_S = 1.0
NO_LIMIT_S = 1e9
LogFormatter = Callable[["PlannedTraining", TrainingEvaluation], str]


@dataclass(frozen=True)
class PlannedTraining:
    """A job and its folder."""

    job: Job
    folder: Path

    @property
    def label(self) -> str:
        """Task, algorithm and seed."""
        return (
            f"{self.job.env_id.split('/')[1]}, {self.job.algorithm.upper()}, seed {self.job.seed}"
        )

    def share(self, steps: int) -> int:
        """Return ``steps``, limited to the steps of the job."""
        return min(steps, self.job.hyperparameters.steps)


class TrainingProgress:
    """Progress bar over all steps of all runs.

    If requested, each evaluation prints a line.
    """

    def __init__(self, bar: Bar, format_line: LogFormatter | None) -> None:
        self.bar = bar
        self.format_line = format_line
        self.done: dict[Path, int] = {}
        self.reported: dict[Path, int] = {}

    def __call__(
        self, planned: PlannedTraining, steps: int, evaluations: Sequence[TrainingEvaluation]
    ) -> None:
        """Show the steps that a run has made, and its last evaluation if that is new."""
        if evaluations and len(evaluations) != self.reported.get(planned.folder):
            self.reported[planned.folder] = len(evaluations)
            self.bar.set_postfix_str(f"{planned.label}: {evaluations[-1].score:.4f}", refresh=False)
            if self.format_line is not None:
                self.bar.write(self.format_line(planned, evaluations[-1]))
        before = self.done.get(planned.folder, 0)
        self.done[planned.folder] = planned.share(steps)
        self.bar.update(self.done[planned.folder] - before)


def train_all(
    runs: Sequence[PlannedTraining], workers: int, format_line: LogFormatter | None = None
) -> list[str]:
    """Train or continue all runs; return a line with the error of each run that failed."""
    total = sum(planned.job.hyperparameters.steps for planned in runs)
    with Bar(total=total, desc="training", unit="step", bar_format=BAR, smoothing=0.05) as bar:
        show = TrainingProgress(bar, format_line)
        if min(workers, len(runs)) > 1:
            tasks = [
                PoolTask(train, (planned.job, planned.folder, None, 1), planned.label, NO_LIMIT_S)
                for planned in runs
            ]
            with _progress_thread(runs, show):
                return [
                    f"{outcome.task.kind}: {outcome.error}"
                    for outcome in Pool(workers, 0.0).run(tasks)
                    if outcome.error
                ]
        for planned in runs:
            train(planned.job, planned.folder, partial(show, planned))
    return []


@contextmanager
def _progress_thread(runs: Sequence[PlannedTraining], show: TrainingProgress) -> Iterator[None]:
    """Show what the runs' files say while other processes write them."""
    over = threading.Event()

    def update() -> None:
        for planned in runs:
            evaluations = read_evaluations(planned.folder)
            show(planned, evaluations[-1].steps if evaluations else 0, evaluations)

    def follow() -> None:
        while not over.wait(WATCH_S):
            update()

    watcher = threading.Thread(target=follow, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
        update()
