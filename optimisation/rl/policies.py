"""What a policy is, and the two that need no thought: the same action always, and any action."""

from __future__ import annotations

from collections.abc import Mapping
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
        """Return actions (L, 1) in [-1, 1] for observations (L, features)."""


@runtime_checkable
class Informed(Protocol):
    """A policy that is told more than the observation: what the environment's info says of each lane, before each `Policy.act`."""

    def inform(self, info: Mapping[str, NDArray[Any]]) -> None:
        """Take info, one array (L,) for each name."""


def column(values: NDArray[Any] | float, lanes: int) -> Actions:
    """Return actions (L, 1) from one number, or one for each lane; numbers are cut to [-1, 1]."""
    return np.broadcast_to(np.clip(values, -1, 1), (lanes,)).astype(np.float32)[:, None]


class Constant:
    """The same action always, in [-1, 1]."""

    def __init__(self, action: float, name: str = "constant") -> None:
        require(-1 <= action <= 1, "action", action, "a number from -1 to 1")
        self.action, self.name = action, name

    def start(self, lanes: int) -> None:
        """Do nothing: there is no memory."""

    def act(self, observations: Observations) -> Actions:
        """Return the action for all lanes."""
        return column(self.action, len(observations))


class Random:
    """Any action from [-1, 1] in every interval, the same ones again after `start`."""

    def __init__(self, seed: int = 0, name: str = "random") -> None:
        self.seed, self.name = seed, name
        self.start(0)

    def start(self, lanes: int) -> None:  # noqa: ARG002 - one generator serves all lanes
        """Begin the sequence again."""
        self._generator = np.random.default_rng(self.seed)

    def act(self, observations: Observations) -> Actions:
        """Return one draw for each lane."""
        return column(self._generator.uniform(-1, 1, len(observations)), len(observations))
