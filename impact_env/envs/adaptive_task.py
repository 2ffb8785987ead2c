"""An absorber that is set interval by interval, the half-clearance of its cavity or its friction limit: on a passage, or at one frequency."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.controlled import friction_limit
from impact_env.envs.observation import STATE, Feature
from impact_env.envs.reference import mean_power_of_cosine
from impact_env.envs.settings import Range, Settings, pair, span
from impact_env.envs.sweep_task import OneRate, Passage, PassiveTask, SweepTask
from impact_env.envs.task import Array, Mask, Task
from impact_env.frequency import receptance
from impact_env.kernels.control.interval import spread
from impact_env.level import require_samples
from impact_env.parameters import Absorber, RigidWalls, SlidingAbsorber, check_each, one_of, positive, require

WIDEST = (1e-9, 1e9)  # of the range, in its unit


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


OBJECTIVES = ("rms", "fatigue")


@dataclass(frozen=True)
class GapControl:
    """Arguments of the choice of the gap; `GapChoiceEnv` describes them."""

    gap_limits: Range = (0.1e-3, 3e-3)
    hold: Range = (100.0, 300.0)
    frequency_ratio: float | Range = (0.97, 1.01)
    time_budget: float = 1000.0
    objective: str = "rms"
    fatigue_exponent: float = 5.0

    def __post_init__(self) -> None:
        one_of("objective", self.objective, OBJECTIVES)
        for name, unit in (("gap_limits", "half-clearances in m"), ("hold", "pseudo periods"), ("frequency_ratio", "ratios to the resonance")):
            pair(self, name, unit)
        check_each(self, time_budget=positive, fatigue_exponent=positive)


class GapTask(Task):
    """Lanes with a cavity that is set under a force that changes."""

    features: Sequence[Feature] = (*STATE, Feature("half-clearance in use", False))
    level_name = "RMS over the scene's half-clearance"

    def __init__(self, settings: Settings, control: GapControl, lanes: int) -> None:
        require_cavity(settings.scene.absorber)
        self.described = (control,)
        self.control, self._ratios = control, span("frequency_ratio", control.frequency_ratio)
        self._gaps = span("gap_limits", control.gap_limits)
        require_samples(settings.samples_per_period, self._ratios[1])
        self.fatigue = control.objective == "fatigue"
        steps = max(1, math.ceil(control.time_budget / settings.interval - 1e-9))
        super().__init__(settings, lanes, steps, control.fatigue_exponent if self.fatigue else 0.0)
        self._forces = np.zeros((lanes, steps))
        self._scale = np.ones((lanes, steps))
        self._ratio = np.ones(lanes)
        self._rows = np.arange(lanes)
        self.limited = np.zeros(lanes, dtype=np.bool_)

    def draw(self, lane: int, generator: np.random.Generator) -> None:
        """Draw the frequency, the schedule of the force, and the phase; the cavity starts as the scene has it."""
        low, high = self._ratios
        self.ratio[lane] = low if low == high else generator.uniform(low, high)
        done, interval = 0, self.interval
        shortest, longest = self.control.hold
        while done < self.steps:
            held = max(1, round(generator.uniform(shortest, longest) / interval))
            self._forces[lane, done : done + held] = self.draw_force(lane, generator)
            done += held
        model = self.settings.scene.model
        amplitude = float(abs(receptance(model, self.ratio[lane] * self.omega, model.level_shape, model.force_shape)))
        exponent = self.control.fatigue_exponent
        largest, mean = amplitude * self._forces[lane], mean_power_of_cosine(exponent)
        self._scale[lane] = [(one / self.length) ** exponent * mean for one in largest.tolist()] if self.fatigue else largest / math.sqrt(2)
        self.force[lane] = self._forces[lane, 0]
        self.runs.orders["gap"][lane] = self.length
        self.limited[lane] = False
        self.draw_phase(lane, generator)

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Order the wanted half-clearances and the forces of the interval."""
        low, high = self._gaps
        self._wanted = low + 0.5 * (actions[:, 0].astype(np.float64) + 1) * (high - low)
        self.runs.orders["gap"] = self._wanted
        self.force = self._forces[self._rows, np.minimum(self.elapsed, self.steps - 1)]
        return np.full(self.lanes, self.interval), self.ratio.copy(), np.zeros(self.lanes, dtype=np.bool_)

    def reward(self) -> Array:
        """Return minus the interval's share of the mean relative response."""
        self.limited = self.runs.orders["gap"] > self._wanted
        scale = self._scale[self._rows, self.elapsed - 1] * self.steps
        if self.fatigue:
            samples = self.interval * self.settings.samples_per_period
            return -(self.runs.reports["damage"] / samples) / scale
        return -np.sqrt(self.runs.reports["mean_square"]) / scale

    def level(self) -> Array:
        """Return the RMS of the last interval in units of the scene's half-clearance."""
        return np.sqrt(self.runs.reports["mean_square"]) / self.length

    def expected_amplitude(self) -> Array:
        """Return twice the largest half-clearance for all lanes (L,) in m."""
        return np.full(self.lanes, 2 * self.control.gap_limits[1])  # type: ignore[index]

    def values(self) -> Array:
        """Return the scaled features (L, features)."""
        values = super().values()
        values[:, 9] = self.runs.orders["gap"] / self.length
        return values

    def info(self) -> dict[str, NDArray[Any]]:
        """Return what info says of each lane."""
        own = {"rms": np.sqrt(self.runs.reports["mean_square"]), "gap": self.runs.orders["gap"].copy(), "gap_limited": self.limited.copy()}
        return super().info() | own
