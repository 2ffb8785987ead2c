"""Kinds of policies with a few numbers to choose, each lane with its own numbers: the engineer's answers that an agent is compared with.

A family is made from the task behind its environment, whose scales it may need. What lies outside [-1, 1] of its actions is cut off.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_env  # noqa: F401 - registers the environments
from impact_env.envs.observation import STATE
from impact_env.envs.sweep_task import SweepTask
from impact_env.envs.task import FREQUENCY_SCALE
from impact_env.extras import optional
from impact_env.parameters import ParameterError, require

Array = NDArray[np.float64]
Observations = NDArray[np.float32]
FREQUENCY = [feature.name for feature in STATE].index("frequency")
LARGEST = 3.0  # of a rule's numbers, where a family does not say otherwise
Start = Callable[[Sequence[float]], Sequence[float]]


class Family(ABC):
    """A kind of policy: lane i acts by row i of ``parameters`` (L, P), which have ``names`` and ``limits`` (P pairs, or `LARGEST` to either side).

    ``begins``: where a search begins, for the numbers of the best constant action. The first ``few`` numbers alone are a rule, with the others at
    ``neutral``; ``few`` is 0 for a family that has no such rule in it.
    """

    names: Sequence[str] = ()
    limits: Sequence[tuple[float, float]] = ()
    begins: Sequence[Start] = ()
    few = 0
    neutral: Sequence[float] = ()

    def __init__(self, task: Any = None) -> None:
        self.task = task

    @property
    def bounds(self) -> Array:
        """Where the numbers may lie (P, 2)."""
        return np.array(self.limits or [(-LARGEST, LARGEST)] * len(self.names), dtype=np.float64)

    def begin(self, lanes: int) -> None:  # noqa: B027 - most have no memory
        """Forget what was seen in earlier episodes."""

    @abstractmethod
    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return actions (L,), or (L, A) for tasks that take several numbers."""


def task_of(name: str, arguments: Mapping[str, Any] | None = None) -> Any:
    """Return the task behind one environment, for its settings."""
    with optional():
        import gymnasium
    env = gymnasium.make(name, **(arguments or {}))
    env.close()
    return env.unwrapped.task  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Rates:
    """The sweep's scale: range of frequency ratios, and zero and unit of the frequency in observations."""

    low: float
    high: float
    origin: float = 1.0
    unit: float = FREQUENCY_SCALE

    @classmethod
    def of(cls, task: SweepTask) -> Rates:
        """Return the scale of a task."""
        return cls(*task.passage.limits, task.frequency_origin, task.frequency_unit)

    def share(self, observations: Observations) -> Array:
        """Return where in the range the frequencies in observations are (L,): 0 at its low end, 1 at its high one."""
        ratio = self.origin + self.unit * observations[:, FREQUENCY].astype(np.float64)
        return (ratio - self.low) / (self.high - self.low)


class ConstantAction(Family):
    """The same action always."""

    names: Sequence[str] = ("action",)

    def act(self, parameters: Array, observations: Observations) -> Array:  # noqa: ARG002
        """Return the numbers."""
        return parameters


class ConstantPair(ConstantAction):
    """The same for a task that takes two numbers."""

    names = ("first action", "second action")


class FamilyPolicy:
    """A family with its numbers chosen: one row (P,) for all lanes, or one for each lane (L, P)."""

    def __init__(self, name: str, family: Family, parameters: NDArray[Any] | Sequence[float]) -> None:
        self.name, self.family = name, family
        self.parameters = np.atleast_2d(np.asarray(parameters, dtype=np.float64))
        if self.parameters.shape[1] != len(family.names):
            raise ParameterError(f"parameters of {name} = {parameters!r} is not allowed: {len(family.names)} numbers ({', '.join(family.names)})")

    def start(self, lanes: int) -> None:
        """Begin new episodes in all lanes."""
        require(len(self.parameters) in (1, lanes), "lanes", lanes, f"one for each of the {len(self.parameters)} rows of parameters")
        self.family.begin(lanes)
        self._rows = np.broadcast_to(self.parameters, (lanes, self.parameters.shape[1]))

    def act(self, observations: Observations) -> NDArray[np.float32]:
        """Return what the family does with the numbers."""
        actions = self.family.act(self._rows, observations)
        return np.clip(actions, -1, 1).astype(np.float32).reshape(len(actions), -1)


class Random:
    """Any action from [-1, 1] in every interval, the same ones again after `start`; ``numbers`` of them for a task that takes several."""

    name = "random"

    def __init__(self, seed: int = 0, numbers: int = 1) -> None:
        self.seed, self.numbers = seed, numbers
        self.start(0)

    def start(self, lanes: int) -> None:  # noqa: ARG002 - one generator serves all lanes
        """Begin the sequence again."""
        self._generator = np.random.default_rng(self.seed)

    def act(self, observations: Observations) -> NDArray[np.float32]:
        """Return one draw for each lane."""
        return self._generator.uniform(-1, 1, (len(observations), self.numbers)).astype(np.float32)
