"""Hyperparameters of the agents, read from YAML by environment and algorithm.

They are checked before any training.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from impact_env.checks import (
    Check,
    count,
    count_from,
    finite,
    flag,
    fraction,
    non_negative,
    positive,
    require,
    within,
)
from impact_env.envs import ENVIRONMENTS
from impact_env.extras import optional
from impact_env.fields import check_fields
from impact_env.plain_files import require_readable

WIDTHS = "a list of widths, as [64, 64]"


def _check_widths(name: str, value: Any) -> tuple[int, ...]:
    require(isinstance(value, Sequence) and not isinstance(value, str), name, value, WIDTHS)
    return tuple(count(name, width, 1) for width in value)


def _check_noise_steps(name: str, value: Any) -> int:
    allowed = "a number of steps of each lane, 1 or more, or -1 for a whole round"
    counted = count(name, value, -1, allowed=allowed)
    require(counted != 0, name, value, allowed)
    return counted


def _check_action(name: str, value: Any) -> float:
    most = math.nextafter(1.0, 0.0)
    return within(name, value, -most, most, "a number between -1 and 1")


FRESH = "none"  # a start of the networks at random
RULE = "rule"  # at the best rule of the task
AGENT = "agent"  # at the agent that ships with the package


def _check_start(name: str, value: Any) -> str:
    allowed = f"{FRESH}, {RULE}, {AGENT}, or the path of an agent's file or of a data set"
    require(isinstance(value, str) and value != "", name, value, allowed)
    return str(value)


WHOLE = (
    "steps",
    "legs",
    "lanes",
    "batch_size",
    "n_steps",
    "n_epochs",
    "lstm",
    "buffer_size",
    "train_freq",
    "gradient_steps",
    "candidates",
    "hold",
    "horizon",
    "trial_interval",
    "rounds_in_memory",
)
# how the hyperparameters of any algorithm are checked
CHECKS: dict[str, Check] = {
    **dict.fromkeys(WHOLE, count_from(1)),
    **dict.fromkeys(
        ("reward_scale", "learning_rate", "final_learning_rate", "clip_range", "reach", "width"),
        positive,
    ),
    **dict.fromkeys(("gamma", "gae_lambda", "tau"), fraction),
    **dict.fromkeys(("log_std_init", "target_entropy", "initial_value"), finite),
    "hidden": _check_widths,
    "initial_action": _check_action,
    "use_sde": flag,
    "sde_sample_freq": _check_noise_steps,
    "start": _check_start,
    "critic_rounds": count_from(0),
}
PACKAGED = Path(__file__).with_name("hyperparameters.yaml")


@dataclass(frozen=True)
class Hyperparameters(ABC):
    """Hyperparameters of all algorithms.

    Attributes
    ----------
    steps : int
        Steps of the environment, counted over all lanes.
    legs : int
        Number of equal parts of the training; after each the agent is evaluated and a checkpoint is
        written.
    lanes : int
        Number of lanes.
    reward_scale : float
        Factor of rewards, for the algorithm alone.
    hidden : tuple of int
        Widths of the layers of actor and critic.
    learning_rate, final_learning_rate : float
        First and last learning rate, linear from leg to leg.
    gamma : float
        Discount for one step.
    batch_size : int
        Samples in a gradient step.
    initial_action : float
        Approximate action of the first policy for any observation.
    start : str
        Policy that the actor imitates before training: `FRESH` for no policy, `RULE`, `AGENT`, or
        the path of an agent's file or of a data set of demonstrations.
    """

    steps: int
    legs: int
    lanes: int
    reward_scale: float
    hidden: tuple[int, ...]
    learning_rate: float
    final_learning_rate: float
    gamma: float
    batch_size: int
    initial_action: float
    start: str = field(default=FRESH, kw_only=True)

    def __post_init__(self) -> None:
        own = vars(self)
        check_fields(self, **{name: check for name, check in CHECKS.items() if name in own})
        require(self.legs <= self.steps, "legs", self.legs, f"not more than steps = {self.steps}")
        require(len(self.hidden) > 0, "hidden", self.hidden, WIDTHS)

    def rate_of(self, leg: int) -> float:
        """Return the learning rate of a leg, counted from 0."""
        share = leg / max(1, self.legs - 1)
        return (1 - share) * self.learning_rate + share * self.final_learning_rate

    @property
    @abstractmethod
    def round(self) -> int:
        """Steps that the algorithm makes between two updates, over all lanes."""

    def describe(self) -> dict[str, Any]:
        """Return the hyperparameters as JSON values."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }


@dataclass(frozen=True)
class PPOSettings(Hyperparameters):
    """Proximal policy optimisation.

    ``n_steps``: steps of each lane in a round. The names are those of stable-baselines3.

    In the first ``critic_rounds`` only the critic is trained: that of a cloned actor knows nothing
    yet, and its advantages would spoil the clone. With ``use_sde`` a deviation from the policy
    lasts ``sde_sample_freq`` steps of a lane, with -1 a whole round.
    """

    log_interval = 1  # rounds

    n_steps: int
    n_epochs: int
    gae_lambda: float
    clip_range: float
    ent_coef: float
    log_std_init: float
    use_sde: bool
    sde_sample_freq: int
    critic_rounds: int = field(default=0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        whole = self.n_steps * self.lanes % self.batch_size == 0 and self.batch_size > 1
        require(
            whole,
            "batch_size",
            self.batch_size,
            f"a divisor of n_steps * lanes = {self.n_steps * self.lanes}, above 1",
        )
        check_fields(self, ent_coef=non_negative)

    @property
    def round(self) -> int:
        """Steps between two updates."""
        return self.n_steps * self.lanes


@dataclass(frozen=True)
class RecurrentPPOSettings(PPOSettings):
    """Proximal policy optimisation with a long short-term memory (sb3-contrib).

    Actor and critic have ``lstm`` memory cells each, ahead of their layers.
    """

    lstm: int


@dataclass(frozen=True)
class PolicyIterationSettings(Hyperparameters):
    """Rollout policy iteration (`optimisation.rl.policy_iteration`).

    A round has ``n_steps`` intervals of each lane, with actions explored at a standard deviation of
    exp(``log_std_init``), and then ``n_epochs`` over the trials of ``rounds_in_memory`` rounds. A
    trial, every ``trial_interval`` intervals, compares ``candidates`` actions within ``reach`` of
    the actor's. Each is held for ``hold`` intervals and followed by the actor, ``horizon``
    intervals in all. ``width``: of the kernel that gives the mean action a score.
    """

    log_interval = 1  # rounds

    n_steps: int
    n_epochs: int
    log_std_init: float
    candidates: int
    reach: float
    hold: int
    horizon: int
    trial_interval: int
    width: float
    rounds_in_memory: int

    @property
    def round(self) -> int:
        """Steps between two updates, those of the trials among them."""
        trials = -(-self.n_steps // self.trial_interval)
        return self.lanes * (self.n_steps + trials * (self.candidates + 1) * self.horizon)


@dataclass(frozen=True)
class SACSettings(Hyperparameters):
    """Soft actor-critic.

    There are ``gradient_steps`` after every ``train_freq`` steps of all lanes, with targets that
    contain the rewards of ``n_steps`` steps. The names are those of stable-baselines3. With
    ``use_sde`` a deviation from the policy lasts ``sde_sample_freq`` steps of a lane, and no longer
    than a round. ``initial_value``: value that the critics give to any state at first, in scaled
    rewards. If rewards are costs, the value 0 is optimistic, and an agent delays actions that it
    does not know.
    """

    log_interval = 100  # episodes

    buffer_size: int
    learning_starts: int
    train_freq: int
    gradient_steps: int
    n_steps: int
    tau: float
    ent_coef: float | str
    target_entropy: float
    log_std_init: float
    use_sde: bool
    sde_sample_freq: int
    initial_value: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, learning_starts=count_from(0))
        require(
            self.buffer_size >= self.lanes,
            "buffer_size",
            self.buffer_size,
            f"not less than lanes = {self.lanes}",
        )
        if isinstance(self.ent_coef, str):
            ok = re.fullmatch(r"auto(_\d*\.?\d+(e-?\d+)?)?", self.ent_coef) is not None
            require(
                ok,
                "ent_coef",
                self.ent_coef,
                "a number, auto, or auto_ and the value to start from, as auto_0.1",
            )
        else:
            check_fields(self, ent_coef=non_negative)

    @property
    def round(self) -> int:
        """Steps between two updates."""
        return self.train_freq * self.lanes


Settings = PPOSettings | SACSettings | PolicyIterationSettings
ALGORITHMS: dict[str, type[Settings]] = {
    "ppo": PPOSettings,
    "sac": SACSettings,
    "rppo": RecurrentPPOSettings,
    "rpi": PolicyIterationSettings,
}


def read(file: Path = PACKAGED) -> dict[str, dict[str, dict[str, Any]]]:
    """Return a YAML file's values by environment, algorithm and name.

    Raises ParameterError for any other content.
    """
    with optional():
        import yaml
    name = "hyperparameters"
    require_readable(name, file)
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        require(False, name, str(file), f"a file that can be read ({error})")
    except yaml.YAMLError as error:
        require(False, name, str(file), f"a file in YAML ({' '.join(str(error).split())})")
    _mapping(file, "", content, ENVIRONMENTS, "an environment")
    for environment, algorithms in content.items():
        _mapping(file, environment, algorithms, ALGORITHMS, "an algorithm")
        for algorithm, values in algorithms.items():
            _mapping(
                file,
                f"{environment}: {algorithm}",
                values,
                [f.name for f in fields(ALGORITHMS[algorithm])],
                "a hyperparameter",
            )
    return dict(content)


def _mapping(
    file: Path, where: str, value: Any, known: Mapping[str, Any] | Sequence[str], kind: str
) -> None:
    place = f"hyperparameters in {file}" + (f", {where}" if where else "")
    require(
        isinstance(value, Mapping) and len(value) > 0,
        place,
        value,
        f"a mapping with one key or more, each the name of {kind}",
    )
    for key in value:
        require(key in known, place, key, f"{kind} of {', '.join(known)}")


def recipes(environment: str) -> list[str]:
    """Return the algorithms for which the package has hyperparameters on an environment.

    Raises ParameterError if there are none.
    """
    packaged = read()
    require(environment in packaged, "environment", environment, f"one of {', '.join(packaged)}")
    return list(packaged[environment])


def settings_for(
    environment: str, algorithm: str, file: Path | None = None, **options: Any
) -> Settings:
    """Return the hyperparameters of an algorithm on an environment.

    Values of ``file`` override those of the package, and ``options`` override both. Raises
    ParameterError for an unknown environment or algorithm, and for a value that is not allowed.
    """
    require(algorithm in ALGORITHMS, "algorithm", algorithm, f"one of {', '.join(ALGORITHMS)}")
    packaged = read()
    known = recipes(environment)
    require(
        algorithm in known, f"algorithm for {environment}", algorithm, f"one of {', '.join(known)}"
    )
    own = read(file).get(environment, {}).get(algorithm, {}) if file is not None else {}
    return ALGORITHMS[algorithm](**{**packaged[environment][algorithm], **own, **options})


ZOO = {
    "ppo": ("ppo", "MlpPolicy"),
    "sac": ("sac", "MlpPolicy"),
    "rppo": ("ppo_lstm", "MlpLstmPolicy"),
}  # files and policies in rl-zoo3
ELSEWHERE = {f.name for f in fields(Hyperparameters)} - {"gamma", "batch_size"} | {
    "log_std_init",
    "lstm",
    "initial_value",
    "critic_rounds",
}


def zoo_recipe(environment: str, algorithm: str) -> dict[str, Any]:
    """Return the package's recipe in the form of rl-zoo3.

    There rewards are scaled by their variation, the learning rate falls to 0, and actions start at
    0.
    """
    own = settings_for(environment, algorithm).describe()
    net = {"net_arch": own["hidden"], "log_std_init": own["log_std_init"]} | (
        {"lstm_hidden_size": own["lstm"]} if "lstm" in own else {}
    )
    return {
        "n_envs": own["lanes"],
        "n_timesteps": float(own["steps"]),
        "policy": ZOO[algorithm][1],
        "normalize": "dict(norm_obs=False, norm_reward=True)",
        "learning_rate": f"lin_{own['learning_rate']}",
        "policy_kwargs": f"dict({', '.join(f'{name}={value}' for name, value in net.items())})",
        **{name: value for name, value in own.items() if name not in ELSEWHERE},
    }


def write_zoo(folder: Path) -> list[Path]:
    """Write all recipes of the package in the form of rl-zoo3, and return the files.

    Each algorithm has a file.
    """
    import yaml

    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for algorithm, (name, _) in ZOO.items():
        known = {
            environment: zoo_recipe(environment, algorithm)
            for environment, own in read().items()
            if algorithm in own
        }
        files.append(folder / f"{name}.yml")
        files[-1].write_text(yaml.safe_dump(known, sort_keys=False), encoding="utf-8")
    return files
