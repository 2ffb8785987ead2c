"""Evaluation of a policy on fixed seeds, ``impact_env.evaluate``.

It gives scores by seed, bootstrap intervals, paired differences and a table.

Splits are disjoint ranges of seeds. Nothing enforces that ``test`` is looked at once, after tuning
on ``train`` and ``validation``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import count, one_of, require
from impact_env.envs import ENVIRONMENTS
from impact_env.extras import optional

Array = NDArray[np.float64]
Statistic = Callable[..., Any]
SEED_SPLITS = {
    "train": range(1_000_000),
    "validation": range(1_000_000, 2_000_000),
    "test": range(2_000_000, 2_500_000),
}
EPISODES = 256
RESAMPLES = 1000
INTERVAL_COVERAGE = 0.95


def interquartile_mean(scores: Array) -> float:
    """Return the mean of the middle half of all scores."""
    return float(scipy.stats.trim_mean(np.ravel(scores), 0.25))


def difference_of_means(scores: Array, others: Array) -> float:
    """Return how much higher the mean of ``scores`` is than the mean of ``others``.

    `bootstrap_interval` resamples the seeds of both together: a paired comparison.
    """
    return float(scores.mean() - others.mean())


def bootstrap_interval(
    statistic: Statistic,
    *scores: Array,
    resamples: int = RESAMPLES,
    covered: float = INTERVAL_COVERAGE,
    seed: int = 0,
) -> Array:
    """Return the bootstrap interval (low, high) of a statistic of one or several score arrays.

    Each of ``scores`` is an array (R, E) with R training runs, 1 for a policy that is not trained,
    and E evaluation seeds, the same for all. ``statistic`` is a function of such arrays, and
    ``covered`` the probability of the interval. The result has the shape (2, *shape of the
    statistic).

    Training runs are resampled separately for each policy and seeds together (A. B. Owen 2007, "The
    pigeonhole bootstrap"), because the episodes of one run are not independent, nor are the runs on
    one seed. Raises ParameterError unless all arrays have the same number of seeds.
    """
    columns = scores[0].shape[1]
    require(
        all(s.ndim == 2 and s.shape[1] == columns for s in scores),
        "scores",
        [s.shape for s in scores],
        "arrays (runs, evaluation seeds)",
    )
    generator = np.random.default_rng(seed)
    values = []
    for _ in range(resamples):
        chosen = generator.integers(columns, size=columns)
        values.append(
            statistic(*(s[generator.integers(len(s), size=len(s))][:, chosen] for s in scores))
        )
    tail = (1 - covered) / 2
    return np.quantile(np.asarray(values), [tail, 1 - tail], axis=0)


@dataclass(frozen=True)
class PolicyScores:
    """Scores of a policy on the seeds of an evaluation.

    Attributes
    ----------
    name : str
        Name of the policy.
    scores : array, (E,)
        Score of each seed.
    mean : float
        Mean of the scores.
    interval : (float, float)
        95 % bootstrap interval of the mean.
    middle : float
        Interquartile mean: the mean of the middle half of the scores.
    """

    name: str
    scores: Array
    mean: float
    interval: tuple[float, float]
    middle: float

    @classmethod
    def of(cls, name: str, scores: Array) -> PolicyScores:
        """Return the summary of a policy's scores (E,)."""
        low, high = bootstrap_interval(np.mean, scores[None])
        return cls(
            name,
            scores,
            float(scores.mean()),
            (float(low), float(high)),
            interquartile_mean(scores),
        )


@dataclass(frozen=True)
class Evaluation:
    """Result of `evaluate`; ``str()`` of it is a table.

    Attributes
    ----------
    env_id : str
        Registered name of the environment.
    split : str
        Name of the range of seeds.
    seeds : tuple of int, (E,)
        Seeds of the episodes.
    policy : PolicyScores
        Scores of the policy.
    others : dict of str to PolicyScores
        Scores of the policies with which it was compared, by name.
    differences : dict of str to (float, float, float)
        For each of the others: how much higher the policy's mean score is, and the 95 % interval
        (low, high) of this difference, paired by seed.
    """

    env_id: str
    split: str
    seeds: tuple[int, ...]
    policy: PolicyScores
    others: dict[str, PolicyScores] = field(default_factory=dict)
    differences: dict[str, tuple[float, float, float]] = field(default_factory=dict)

    @property
    def scores(self) -> Array:
        """The policy's scores (E,)."""
        return self.policy.scores

    def __str__(self) -> str:
        lines = [
            (
                f"{self.env_id}, {self.split}: {len(self.seeds)} episodes, seeds {self.seeds[0]} "
                f"to {self.seeds[-1]}"
            )
        ]
        width = 2 + max(22, *(len(row.name) for row in (self.policy, *self.others.values())))
        lines.append(
            f"{'policy':<{width}}{'mean score':>11}{'95 % interval':>20}"
            f"{'middle half':>13}{'policy is better by':>28}"
        )
        for row in (self.policy, *self.others.values()):
            better = self.differences.get(row.name)
            interval = (
                "" if better is None else f"{better[0]:.4f} [{better[1]:.4f}, {better[2]:.4f}]"
            )
            own_interval = f"[{row.interval[0]:.4f}, {row.interval[1]:.4f}]"
            lines.append(
                f"{row.name:<{width}}{row.mean:>11.4f}{own_interval:>20}"
                f"{row.middle:>13.4f}{interval:>28}"
            )
        return "\n".join(lines)


class _Player:
    """Adapter that calls any kind of policy in the same way.

    A policy is a function, a model of stable-baselines3, an object with ``start`` and ``act``, or a
    constant action. ``shape`` is the shape of the actions of all lanes.
    """

    def __init__(self, policy: Any, shape: tuple[int, ...]) -> None:
        constant = isinstance(policy, int | float | Sequence | np.ndarray) and not isinstance(
            policy, str | bool
        )
        known = constant or any(
            callable(getattr(policy, name, None)) for name in ("predict", "act", "__call__")
        )
        require(
            known,
            "policy",
            policy,
            (
                "a function of observations (L, features), a stable-baselines3 model, an agent, "
                "or a constant action"
            ),
        )
        self.policy = policy
        self.shape = shape
        self.constant = constant
        self.memory: Any = None
        self.fresh = np.ones(shape[0], dtype=np.bool_)
        if hasattr(policy, "start"):
            policy.start(shape[0])

    def act(self, observations: NDArray[np.float32]) -> NDArray[Any]:
        """Return the actions of all lanes."""
        if self.constant:
            actions = np.tile(
                np.atleast_1d(np.asarray(self.policy, dtype=np.float32)), (self.shape[0], 1)
            )
        elif hasattr(self.policy, "predict"):
            actions, self.memory = self.policy.predict(
                observations, state=self.memory, episode_start=self.fresh, deterministic=True
            )
            self.fresh = np.zeros_like(self.fresh)
        else:
            actions = (self.policy.act if hasattr(self.policy, "act") else self.policy)(
                observations
            )
        require(
            np.shape(actions) == self.shape,
            "actions",
            np.shape(actions),
            f"an array of shape {self.shape} from the policy",
        )
        return np.asarray(actions)


@dataclass(frozen=True)
class EpisodeScores:
    """Scores and lengths of one episode for each seed.

    ``scores`` (E,) are sums of rewards, or (E, costs) sums of reward vectors with
    ``vector_reward=True``. ``steps`` (E,) are the numbers of control intervals.
    """

    scores: Array
    steps: NDArray[np.int64]


def play(
    policy: Any, env_id: str, seeds: Sequence[int], arguments: Mapping[str, Any] | None = None
) -> EpisodeScores:
    """Play one episode for each seed, each in its own lane.

    ``policy`` is of any kind that `evaluate` accepts, and ``arguments`` are those of the
    environment. Lanes whose episode has ended are not advanced.

    Raises ParameterError for an unknown environment, no seeds, bad ``arguments``, or actions of a
    wrong shape.
    """
    require(env_id in ENVIRONMENTS, "env_id", env_id, f"one of {', '.join(ENVIRONMENTS)}")
    require(len(seeds) > 0, "seeds", seeds, "at least one seed")
    with optional():
        import gymnasium
    options = {
        "vectorization_mode": "vector_entry_point",
        "autoreset_mode": "DISABLED",
        **(arguments or {}),
    }
    env: Any = gymnasium.make_vec(env_id, num_envs=len(seeds), **options)
    try:
        observations, _ = env.reset(seed=list(seeds))
        player = _Player(policy, env.action_space.shape)
        over = np.zeros(len(seeds), dtype=np.bool_)
        reward_space = env.unwrapped.reward_space
        scores = np.zeros((len(seeds), *(() if reward_space is None else reward_space.shape)))
        steps = np.zeros(len(seeds), dtype=np.int64)
        while not over.all():
            observations, rewards, terminated, truncated, _ = env.step(player.act(observations))
            scores += rewards
            steps += ~over
            over = over | terminated | truncated
            env.rest(over)
    finally:
        env.close()
    return EpisodeScores(scores, steps)


def evaluate(
    policy: Any,
    env_id: str,
    split: str = "test",
    against: Any = None,
    *,
    episodes: int = EPISODES,
    arguments: Mapping[str, Any] | None = None,
) -> Evaluation:
    """Play a policy on the first seeds of a split and return its scores, with intervals.

    Parameters
    ----------
    policy : callable, model, agent or action
        Function of observations (L, features) that returns actions (L, A); or a model of
        stable-baselines3, whose deterministic action is taken; or an agent of `load_agent`; or a
        constant action (A,).
    env_id : str
        Registered name, as "ImpactAbsorber/SweepRate-v1".
    split : {"test", "train", "validation"}, optional
        Name of the range of seeds. Environments with an argument ``split`` get it too.
    against : policy or mapping of str to policy, optional
        Policies to compare with, on the same seeds.
    episodes : int, optional
        Number of episodes, one for each seed, 2 or more.
    arguments : mapping, optional
        Arguments of the environment. Only scores with the default arguments can be compared with
        published scores.

    Returns
    -------
    Evaluation
        Scores, their means with 95 % bootstrap intervals, and differences to the other policies.

    Raises
    ------
    ParameterError
        A value is out of range, or no environment has this name.

    Notes
    -----
    Needs gymnasium, the extra ``env``.
    """
    require(env_id in ENVIRONMENTS, "env_id", env_id, f"one of {', '.join(ENVIRONMENTS)}")
    split = one_of("split", split, SEED_SPLITS)
    seeds = SEED_SPLITS[split][: count("episodes", episodes, 2, len(SEED_SPLITS[split]))]
    options = ({"split": split} if ENVIRONMENTS[env_id].has_split else {}) | dict(arguments or {})
    own = PolicyScores.of(
        str(getattr(policy, "name", "policy")), play(policy, env_id, seeds, options).scores
    )
    rivals = (
        dict(against)
        if isinstance(against, Mapping)
        else {}
        if against is None
        else {str(getattr(against, "name", "rival")): against}
    )
    others = {
        name: PolicyScores.of(name, play(rival, env_id, seeds, options).scores)
        for name, rival in rivals.items()
    }
    differences = {}
    for name, other in others.items():
        low, high = bootstrap_interval(difference_of_means, own.scores[None], other.scores[None])
        differences[name] = (own.mean - other.mean, float(low), float(high))
    return Evaluation(env_id, split, tuple(seeds), own, others, differences)
