"""A machine at one frequency whose force changes by itself: the half-clearance of the cavity is chosen interval by interval."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.envs.adaptive_task import require_cavity
from impact_env.envs.observation import STATE, Feature
from impact_env.envs.reference import mean_power_of_cosine
from impact_env.envs.settings import Range, Settings, pair, span
from impact_env.envs.task import Array, Mask, Task
from impact_env.frequency import receptance
from impact_env.level import require_samples
from impact_env.parameters import check_each, one_of, positive

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
