"""Training methods that are compared.

The module has algorithms with their settings, scales of the tasks, and the effort of a training.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

ITERATION = "rpi"
PLANNER = "planner"
REPLAYED = ("sac", "tqc", "crossq")  # algorithms that learn from stored experience
PERIOD = 4  # control intervals of a reward that is spread


@dataclass(frozen=True)
class TaskScales:
    """Parameters of training that depend on the task.

    They are the discount, the factor of the rewards, the number of intervals of a lane in a round
    of PPO, and the actions that the planner tries.
    """

    gamma: float
    reward_scale: float
    round: int
    candidates: Sequence[Sequence[float]]


_POINTS = np.linspace(-1, 1, 5).tolist()
SCALES = {
    "ActiveGap-v0": TaskScales(0.98, 50.0, 80, [(a,) for a in _POINTS]),
    "Passage-v0": TaskScales(0.999, 10.0, 60, [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)]),
}


@dataclass(frozen=True)
class TrainingMethod:
    """An algorithm with settings that differ from its usual ones.

    ``gamma`` is the discount, None for the task's. ``frames`` is the number of observations on
    which the network acts, ``rounds`` the length of PPO's rounds over the usual one, ``period`` the
    number of intervals over which a reward is spread, and ``horizon`` that of the trials of rollout
    policy iteration, in intervals.
    """

    algorithm: str
    gamma: float | None = None
    frames: int = 1
    hidden: tuple[int, ...] = (64, 64)
    rounds: int = 1
    period: int = 1
    horizon: int = 12
    lanes: int = 128


_PPO = TrainingMethod("ppo")
METHODS: dict[str, TrainingMethod] = {
    "PPO": _PPO,
    "PPO, discount 0.99": replace(_PPO, gamma=0.99),
    "PPO, discount 0.995": replace(_PPO, gamma=0.995),
    "PPO, rounds four times as long": replace(_PPO, rounds=4),
    "PPO, last 4 observations": replace(_PPO, frames=4),
    "PPO, 256 x 256": replace(_PPO, hidden=(256, 256)),
    "PPO, rewards over 4 intervals": replace(_PPO, period=PERIOD),
    "recurrent PPO": TrainingMethod("rppo"),
    "SAC, 256 lanes": TrainingMethod("sac", lanes=256),
    "TQC, 256 lanes": TrainingMethod("tqc", lanes=256),
    "CrossQ, 256 lanes": TrainingMethod("crossq", lanes=256),
    "policy iteration over 12 intervals": TrainingMethod(ITERATION),
    "policy iteration over 30 intervals": TrainingMethod(ITERATION, horizon=30),
    "imitation of the robust planner": TrainingMethod(PLANNER),
}


@dataclass(frozen=True)
class TrainingEffort:
    """Effort of a training.

    It consists of the CPU time in s, the number of evaluations, the number of episodes of each, and
    the number of steps after which one additional evaluation is made.
    """

    seconds: float = 150.0
    evaluations: int = 6
    episodes: int = 256
    steps: int = 100_000
