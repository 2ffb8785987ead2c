"""Passage through a resonance with an adaptive absorber: the rate and the half-clearance of the cavity are chosen interval by interval."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.envs.observation import STATE, Feature
from impact_env.envs.settings import Range, Settings, span
from impact_env.envs.sweep_task import Passage, SweepTask
from impact_env.envs.task import Array, Mask
from impact_env.kernels.control.interval import spread
from impact_env.parameters import Absorber, RigidWalls, SlidingAbsorber, require


@dataclass(frozen=True)
class Cavity:
    """Arguments of the choice of the gap during a passage; `SweepAndGapEnv` describes them."""

    gap_limits: Range = (0.1e-3, 3e-3)

    def __post_init__(self) -> None:
        low, high = span("gap_limits", self.gap_limits)
        require(low > 0, "gap_limits", self.gap_limits, "(low, high), half-clearances in m above 0")
        object.__setattr__(self, "gap_limits", (low, high))


def require_cavity(absorber: Absorber | None) -> None:
    """Raise ParameterError unless an absorber is in a cavity with rigid walls."""
    rigid = isinstance(absorber, SlidingAbsorber) and isinstance(absorber.walls, RigidWalls)
    require(rigid, "absorber", absorber, "an impact absorber with rigid walls: there must be a cavity whose walls can be set")


class SweepGapTask(SweepTask):
    """Lanes that pass through a resonance, each with a cavity that is set on the way."""

    features: Sequence[Feature] = (*STATE, Feature("way left", False), Feature("half-clearance in use", False))

    def __init__(self, settings: Settings, passage: Passage, cavity: Cavity, lanes: int) -> None:
        require_cavity(settings.scene.absorber)
        self.cavity = cavity
        super().__init__(settings, passage, lanes)
        self.limited = np.zeros(lanes, dtype=np.bool_)

    def draw(self, lane: int, generator: np.random.Generator) -> None:
        """Draw what a passage draws; the cavity starts as the scene has it."""
        super().draw(lane, generator)
        self.runs.orders["gap"][lane] = self.length
        self.limited[lane] = False

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Order the wanted half-clearances, and go on at the chosen rates."""
        self._wanted = spread(0.5 * (actions[:, 1].astype(np.float64) + 1), *self.cavity.gap_limits)
        self.runs.orders["gap"] = self._wanted
        return super().decide(actions)

    def reward(self) -> Array:
        """Return the reward of the passage."""
        self.limited = self.runs.orders["gap"] > self._wanted
        return super().reward()

    def values(self) -> Array:
        """Return the scaled features (L, features)."""
        values = super().values()
        values[:, 10] = self.runs.orders["gap"] / self.length
        return values

    def describe(self) -> dict[str, Any]:
        """Return the environment's arguments as plain values."""
        return super().describe() | asdict(self.cavity)

    def info(self) -> dict[str, NDArray[Any]]:
        """Return what info says of each lane."""
        info = super().info()
        info["gap"] = self.runs.orders["gap"].copy()
        info["gap_limited"] = self.limited.copy()
        return info
