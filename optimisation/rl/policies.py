"""What a policy is, and the two that need no thought: the same action always, and any action."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require

Observations = NDArray[np.float32]
Actions = NDArray[np.float32]


class Policy(Protocol):
    """Chooses actions for a number of lanes at once."""

    @property
    def name(self) -> str:
        """What figures and tables call it."""

    def start(self, lanes: int) -> None:
        """Get ready for the first interval of new episodes in all lanes."""

    def act(self, observations: Observations) -> Actions:
        """Return actions (L, A) in [-1, 1] for observations (L, features); A is how many numbers the task takes."""


@runtime_checkable
class Informed(Protocol):
    """A policy that is told more than the observation: what the environment's info says of each lane, before each `Policy.act`."""

    def inform(self, info: Mapping[str, NDArray[Any]]) -> None:
        """Take info, one array (L,) for each name."""


class Constant:
    """The same action always: one number in [-1, 1], or several for a task that takes them."""

    def __init__(self, action: float | Sequence[float], name: str = "constant") -> None:
        self.actions, self.name = np.atleast_1d(np.asarray(action, dtype=np.float32)), name
        require(bool(np.all(np.abs(self.actions) <= 1)), "action", action, "a number from -1 to 1, or several")

    def start(self, lanes: int) -> None:
        """Do nothing: there is no memory."""

    def act(self, observations: Observations) -> Actions:
        """Return the action for all lanes."""
        return np.tile(self.actions, (len(observations), 1))


class Random:
    """Any action from [-1, 1] in every interval, the same ones again after `start`; ``numbers`` of them for a task that takes several."""

    def __init__(self, seed: int = 0, name: str = "random", numbers: int = 1) -> None:
        self.seed, self.name, self.numbers = seed, name, numbers
        self.start(0)

    def start(self, lanes: int) -> None:  # noqa: ARG002 - one generator serves all lanes
        """Begin the sequence again."""
        self._generator = np.random.default_rng(self.seed)

    def act(self, observations: Observations) -> Actions:
        """Return one draw for each lane."""
        return self._generator.uniform(-1, 1, (len(observations), self.numbers)).astype(np.float32)
