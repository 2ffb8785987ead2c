"""Start of the training of an agent by behaviour cloning.

Its actor imitates a rule, an agent or recorded episodes.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_env  # noqa: F401 - registers the environments
from impact_env.checks import require
from impact_env.envs.evaluation import SEED_SPLITS
from impact_env.extras import optional
from optimisation.rl.agents import actor_of, load_agent, packaged_file
from optimisation.rl.demonstrations import Demonstrations, dataset_hash, read_demonstrations
from optimisation.rl.hyperparameters import AGENT, FRESH, RULE, Hyperparameters
from optimisation.rl.models import Model
from optimisation.rl.rules import EIGHT, TASKS, chosen, policies

with optional():
    import gymnasium
    import torch

EPOCHS = 40  # of demonstrations, of which there are few
BATCH = 256
LEARNING_RATE = 1e-3
Decisions = tuple[NDArray[np.float32], NDArray[np.float32]]


def imitate(model: Model, demonstrations: Demonstrations, seed: int, epochs: int = EPOCHS) -> float:
    """Fit the mean action of a PPO or SAC model to demonstrations by least squares.

    The mean squared error at the end is returned.

    Raises ParameterError if the demonstrations' observations or actions are of another size than
    the model's.
    """
    observations = np.concatenate([rows[:-1] for rows in demonstrations.observations])
    actions = np.concatenate(demonstrations.actions)
    sizes = (model.observation_space.shape, model.action_space.shape)
    shapes = (observations.shape[1:], actions.shape[1:])
    require(
        shapes == sizes, "shapes of demonstrations", shapes, f"{sizes}, those of the environment"
    )
    return fit_actor(model, (observations, actions), seed, epochs, BATCH, LEARNING_RATE)


def fit_actor(
    model: Model, decisions: Decisions, seed: int, epochs: int, batch: int, learning_rate: float
) -> float:
    """Fit the mean action of a PPO or SAC model to decisions by least squares.

    The mean squared error at the end is returned.

    Parameters
    ----------
    decisions : pair of arrays
        Observations (n, features) and the actions (n, A) to be taken there.
    learning_rate : float
        Of Adam at the first step; it falls to 0 as half a cosine.
    """
    tools: Any = torch
    observations, actions = (torch.from_numpy(values) for values in decisions)
    actor = getattr(model, "actor", None)
    policy: Any = model.policy
    parameters = list((policy if actor is None else actor).parameters())
    optimiser: Any = tools.optim.Adam(parameters, lr=learning_rate)
    steps = epochs * -(-len(observations) // batch)
    schedule = tools.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    generator: Any = tools.Generator().manual_seed(seed)

    def mean_action(observed: Any) -> Any:
        if actor is not None:
            return actor(observed, deterministic=True)
        return policy.action_net(policy.mlp_extractor.forward_actor(observed))

    for _ in range(epochs):
        for part in tools.randperm(len(observations), generator=generator).split(batch):
            loss = tools.nn.functional.mse_loss(mean_action(observations[part]), actions[part])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
    with torch.no_grad():
        return float(tools.nn.functional.mse_loss(mean_action(observations), actions))


@dataclass(frozen=True)
class CloneEffort:
    """Effort of `clone_policy`: ``rounds`` in which the clone acts.

    ``episodes`` of each round are played on training seeds; ``noise`` is the standard deviation of
    what is added to actions; ``epochs`` over all decisions so far follow, with batches of ``batch``
    decisions.
    """

    rounds: int = 2
    episodes: int = 128
    noise: float = 0.3
    epochs: int = 10
    batch: int = 1024
    learning_rate: float = 2e-3


EFFORT = CloneEffort()
TRAINING_SEEDS = len(SEED_SPLITS["train"])


def record_decisions(
    actor: Any,
    teacher: Any,
    env_id: str,
    arguments: Mapping[str, Any],
    seeds: Sequence[int],
    noise: float,
    generator: np.random.Generator,
) -> Decisions:
    """Play one episode for each seed by ``actor``, and record what ``teacher`` would do.

    All observations are returned with the actions that ``teacher`` takes for them.

    Both have ``start`` and ``act``. ``noise`` (standard deviation) is added to the actor's actions,
    so that states off its way occur, too.
    """
    lanes = len(seeds)
    env: Any = gymnasium.make_vec(
        env_id, num_envs=lanes, vectorization_mode="vector_entry_point", **arguments
    )
    observations = []
    actions = []
    going = np.ones(lanes, dtype=np.bool_)
    try:
        actor.start(lanes)
        teacher.start(lanes)
        observed, _ = env.reset(seed=list(seeds))
        while going.any():
            wanted = teacher.act(observed)
            played = wanted if actor is teacher else actor.act(observed)
            observations.append(observed[going])
            actions.append(wanted[going])
            played = played + noise * generator.standard_normal(played.shape)
            observed, _, terminated, truncated, _ = env.step(
                np.clip(played, -1, 1).astype(np.float32)
            )
            going &= ~(terminated | truncated)
            env.unwrapped.rest(~going)
    finally:
        env.close()
    return np.concatenate(observations), np.concatenate(actions)


def clone_policy(
    model: Model,
    teacher: Any,
    env_id: str,
    arguments: Mapping[str, Any],
    seed: int,
    effort: CloneEffort = EFFORT,
) -> float:
    """Fit the mean action of a PPO or SAC model to that of a policy; return the mean squared error.

    The error is over all decisions. The first fit uses the teacher's own episodes, without and with
    noise. In further rounds the model acts, and the teacher's actions for the visited observations
    are added to the data (S. Ross, G. Gordon and D. Bagnell 2011, dataset aggregation, DAgger).
    """
    generator = np.random.default_rng(seed)
    first = seed * (effort.rounds + 2) * effort.episodes
    parts: list[Decisions] = []

    def record(actor: Any, noise: float) -> None:
        begin = first + len(parts) * effort.episodes
        seeds = [k % TRAINING_SEEDS for k in range(begin, begin + effort.episodes)]
        parts.append(record_decisions(actor, teacher, env_id, arguments, seeds, noise, generator))

    def fit() -> float:
        observations, actions = (np.concatenate(column) for column in zip(*parts, strict=True))
        return fit_actor(
            model,
            (observations, actions),
            seed + len(parts),
            effort.epochs,
            effort.batch,
            effort.learning_rate,
        )

    record(teacher, 0.0)
    record(teacher, effort.noise)
    error = fit()
    for _ in range(effort.rounds):
        record(actor_of(model, env_id, seed, arguments), effort.noise)
        error = fit()
    return error


def _hash_file(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def task_name(env_id: str) -> str:
    """Return the task of an environment's name; raises ParameterError if it has no rule."""
    task = env_id.rpartition("/")[2]
    require(task in TASKS, "task of a start at the rule", task, f"one of {', '.join(TASKS)}")
    return task


def describe_start(chosen_settings: Hyperparameters, env_id: str, algorithm: str) -> dict[str, Any]:
    """Return the identity of a start as JSON values.

    It has the rule's parameters, or the hash of a file or data set. It is empty for a random start.

    Raises ParameterError if there is no such rule, agent or data set.
    """
    start = chosen_settings.start
    if start == FRESH:
        return {}
    if start == RULE:
        return {"start": {RULE: chosen()[task_name(env_id)][EIGHT]}}
    if start == AGENT:
        return {"start": {AGENT: _hash_file(packaged_file(task_name(env_id), algorithm))}}
    path = Path(start)
    known = f"{RULE}, {AGENT}, {FRESH}, or the path of an agent's file or of a data set"
    require(path.exists(), "start", start, known)
    if path.is_dir():
        return {"start": {"demonstrations": dataset_hash(read_demonstrations(path, env_id))}}
    allowed = f"an agent of {env_id}, or a folder of demonstrations"
    require(load_agent(path).env_id == env_id, "start", start, allowed)
    return {"start": {AGENT: _hash_file(path)}}


def apply_start(
    model: Model,
    chosen_settings: Hyperparameters,
    env_id: str,
    algorithm: str,
    arguments: Mapping[str, Any],
    seed: int,
) -> None:
    """Train the actor of a new model to imitate the policy ``start`` of its hyperparameters."""
    start = chosen_settings.start
    if start == FRESH:
        return
    if start not in (RULE, AGENT) and Path(start).is_dir():
        imitate(model, read_demonstrations(Path(start), env_id), seed)
        return
    if start == RULE:
        teacher: Any = policies(task_name(env_id), arguments)[EIGHT]
    elif start == AGENT:
        teacher = load_agent(task_name(env_id), algorithm)
    else:
        teacher = load_agent(Path(start))
    clone_policy(model, teacher, env_id, arguments, seed)
