"""Passages through a resonance with an absorber that is set interval by interval: the half-clearance of its cavity, or its friction limit."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.controlled import friction_limit
from impact_env.envs.observation import STATE, Feature
from impact_env.envs.settings import Range, Settings, pair, span
from impact_env.envs.sweep_task import OneRate, Passage, PassiveTask, SweepTask
from impact_env.envs.task import Array, Mask
from impact_env.kernels.control.interval import spread
from impact_env.parameters import Absorber, RigidWalls, SlidingAbsorber, require

WIDEST = (1e-9, 1e9)  # of the range, in its unit  # of the range, in its unit


@dataclass(frozen=True)
class Cavity:
    """Arguments of the choice of the gap during a passage; `SweepAndGapEnv` describes them."""

    gap_limits: Range = (0.1e-3, 3e-3)

    def __post_init__(self) -> None:
        pair(self, "gap_limits", "half-clearances in m")


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
        self.described = (passage, cavity)
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

    def info(self) -> dict[str, NDArray[Any]]:
        """Return what info says of each lane."""
        return super().info() | {"gap": self.runs.orders["gap"].copy(), "gap_limited": self.limited.copy()}


@dataclass(frozen=True)
class Grip:
    """Arguments of the choice of the friction limit; `FrictionChoiceEnv` describes them."""

    friction_range: Range = (0.02, 20.0)

    def __post_init__(self) -> None:
        low, high = span("friction_range", self.friction_range)
        ok = WIDEST[0] <= low < high <= WIDEST[1]
        require(ok, "friction_range", self.friction_range, f"(low, high) with {WIDEST[0]} <= low < high <= {WIDEST[1]}")
        object.__setattr__(self, "friction_range", (low, high))


def limits_in_newtons(settings: Settings, grip: Grip) -> tuple[Range, float]:
    """Return the lowest and highest friction limit, and the scene's own, in N; raises ParameterError where there is no rigid friction."""
    scene, begin = settings.scene, friction_limit(settings.scene)
    require(math.isfinite(begin), "absorber", scene.absorber, "one with rigid friction: there must be a friction_limit that can be set")
    assert scene.absorber_mass is not None
    unit = scene.absorber_mass * settings.length * settings.omega**2
    return (grip.friction_range[0] * unit, grip.friction_range[1] * unit), begin


def place_of(limit: float, limits: Range) -> float:
    """Return the place of a friction limit in a range, as an action has it."""
    low, high = limits
    return 2 * math.log(limit / low) / math.log(high / low) - 1


class FrictionTask(PassiveTask):
    """Lanes that pass through a resonance, each with friction that is set on the way.

    ``limits`` (N): lowest and highest friction limit. ``friction`` (L,) in N and ``place`` (L,) in the range, from -1 to 1: those in use.
    """

    features: Sequence[Feature] = (*STATE, Feature("way left", False), Feature("friction limit in use", False))

    def __init__(self, settings: Settings, way: OneRate, grip: Grip, lanes: int) -> None:
        self.limits, self._begin = limits_in_newtons(settings, grip)
        super().__init__(settings, way, lanes)
        self.described = (self.passage, way, grip)
        self.friction, self.place = np.full(lanes, self._begin), np.zeros(lanes)

    def draw(self, lane: int, generator: np.random.Generator) -> None:
        """Draw what a passage draws; the friction starts as the scene has it."""
        super().draw(lane, generator)
        self.friction[lane], self.place[lane] = self._begin, place_of(self._begin, self.limits)

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Order the chosen friction limits, and go on."""
        self.place = actions[:, 0].astype(np.float64)
        self.runs.orders["limit"] = self.friction = spread(0.5 * (self.place + 1), *self.limits)
        return super().decide(actions)

    def values(self) -> Array:
        """Return the scaled features (L, features)."""
        values = super().values()
        values[:, 10] = self.place
        return values

    def info(self) -> dict[str, NDArray[Any]]:
        """Return what info says of each lane."""
        return super().info() | {"friction_limit": self.friction.copy()}
