"""Passage through a resonance.

The frequency runs from one side of the resonance to the other at a rate that is chosen in each
interval, or fixed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    non_negative,
    positive,
    require,
    word_of,
)
from impact_env.drive import PAPER_LIMITS, default_rate
from impact_env.envs.observation import DISTANCE_TO_END, STATE, Feature
from impact_env.envs.reference import simulate_passage
from impact_env.envs.settings import SWEEP_OBJECTIVES, Range, TaskSettings, check_range
from impact_env.envs.task import FREQUENCY_SCALE, Array, Mask, Task
from impact_env.fields import check_fields
from impact_env.kernels.control.episodes import (
    advance_frequency,
    compute_damage_rewards,
    compute_level_rewards,
)
from impact_env.kernels.control.interval import interpolate_log
from impact_env.level import require_samples

SWEEP_DIRECTIONS = ("up", "down", "random")
BUDGET_ENDS = ("truncated", "terminated")
FREQUENCY_ORIGINS = ("resonance", "middle")
LEVEL_UNITS = ("reference", "gap")
PER_PERIOD = 1e-4  # a rate of 1 % in 100 pseudo periods, as change of the frequency ratio in one


def speeds(name: str, value: Any, limits: Range) -> Range:
    """Return (slowest, fastest) of the rates in % per 100 pseudo periods.

    ``limits`` are the frequency ratios of the passage. Rates are refused that would cross them in
    less than one pseudo period, which would leave no response.
    """
    slow, fast = check_range(name, value)
    most = (limits[1] - limits[0]) / PER_PERIOD
    allowed = (
        f"in % per 100 pseudo periods, above 0 and at most {most:.6g}, at which the whole of "
        "limits takes one pseudo period"
    )
    require(slow > 0 and fast <= most * (1 + 1e-9), name, value, allowed)
    return slow, fast


@dataclass(frozen=True)
class PassageSettings:
    """Arguments of a passage.

    Parameters
    ----------
    direction : str
        ``"down"``, ``"up"`` or ``"random"``.
    limits : pair
        Lowest and highest frequency over the resonance.
    rates : pair
        Slowest and fastest rate in % per 100 pseudo periods.
    backward_rate : float
        Rate of going back in % per 100 pseudo periods; 0: never back.
    time_budget : float
        Longest time of an episode in pseudo periods, rounded up to whole intervals.
    time_price : float
        Price of 100 pseudo periods.
    unfinished_price : float
        Price of a passage that does not reach the far frequency.
    objective : str
        ``"level"`` or ``"fatigue"``.
    fatigue_exponent : float
        Exponent of the displacement with the objective ``"fatigue"``.
    budget_end : str
        Whether an episode whose time budget is spent is ``"truncated"`` or ``"terminated"``.
    frequency_origin : str
        Zero of the observed frequency: ``"resonance"`` or ``"middle"`` (of ``limits``).
    frequency_unit : float
        Unit of features 7 and 10, as a frequency ratio.
    level_unit : str
        Unit of feature 9: ``"reference"`` (level without absorber) or ``"gap"`` (half-clearance,
        from which a random force cannot be inferred).

    """

    direction: str = "down"
    limits: Range = PAPER_LIMITS
    rates: Range = (0.05, 4.0)
    backward_rate: float = 0.0
    time_budget: float = 4000.0
    time_price: float = 0.002
    unfinished_price: float = 1.0
    objective: str = "level"
    fatigue_exponent: float = 5.0
    budget_end: str = "truncated"
    frequency_origin: str = "resonance"
    frequency_unit: float = FREQUENCY_SCALE
    level_unit: str = "reference"

    def __post_init__(self) -> None:
        check_fields(self, limits=check_range)
        low, high = self.limits
        allowed = "(low, high) frequency ratios with 0 < low < high"
        require(0 < low < high, "limits", self.limits, allowed)
        check_fields(
            self,
            direction=word_of(SWEEP_DIRECTIONS),
            objective=word_of(SWEEP_OBJECTIVES),
            rates=partial(speeds, limits=self.limits),
            backward_rate=non_negative,
            time_budget=positive,
            time_price=non_negative,
            unfinished_price=non_negative,
            fatigue_exponent=positive,
            budget_end=word_of(BUDGET_ENDS),
            frequency_origin=word_of(FREQUENCY_ORIGINS),
            frequency_unit=positive,
            level_unit=word_of(LEVEL_UNITS),
        )


class SweepTask(Task):
    """Lanes that pass through a resonance.

    Of `costs` the level is the rise of the relative level (or damage), time is that over the time
    budget, and impacts are those a pseudo period of a whole interval.
    """

    cost_names: Sequence[str] = ("level", "time", "actuator", "impacts")
    least_cost: float | Array = np.array([-math.inf, 0.0, 0.0, 0.0])
    features: Sequence[Feature] = (*STATE, DISTANCE_TO_END)

    def __init__(
        self, settings: TaskSettings, passage_settings: PassageSettings, lanes: int
    ) -> None:
        self.passage = passage_settings
        self.described = (passage_settings,)
        self.absolute = passage_settings.level_unit == "gap"
        self.level_name = (
            "level over the scene's half-clearance"
            if self.absolute
            else "level relative to no absorber"
        )
        self.budget_terminates = passage_settings.budget_end == "terminated"
        self.frequency_unit = passage_settings.frequency_unit
        if passage_settings.frequency_origin == "middle":
            self.frequency_origin = 0.5 * sum(passage_settings.limits)
        self.fatigue = passage_settings.objective == "fatigue"
        exponent = passage_settings.fatigue_exponent if self.fatigue else 0.0
        super().__init__(
            settings,
            lanes,
            max(1, math.ceil(passage_settings.time_budget / settings.interval - 1e-9)),
            exponent,
        )
        low, high = passage_settings.limits
        require_samples(settings.samples_per_period, high)
        self._ends = np.array([(low, high), (high, low)])
        yardstick = (settings.samples_per_period, exponent, settings.length, settings.moves_base)
        self._references = [
            simulate_passage(settings.scene, settings.resonance, *ends, *yardstick)
            for ends in self._ends.tolist()
        ]
        self.sign, self.far, self.level_scale, self.damage_scale, self._potential = (
            np.ones(lanes) for _ in range(5)
        )

    def draw(self, lane: int, generator: np.random.Generator) -> None:
        """Draw direction and force."""
        direction = self.passage.direction
        down = bool(generator.integers(2)) if direction == "random" else direction == "down"
        self.ratio[lane], self.far[lane] = self._ends[int(down)]
        self.sign[lane] = -1.0 if down else 1.0
        self.force[lane] = force = self.draw_force(lane, generator)
        level, damage = self._references[int(down)]
        self.level_scale[lane] = level * force
        self.damage_scale[lane] = (
            damage * force**self.passage.fatigue_exponent if self.fatigue else 1.0
        )
        self._potential[lane] = 0.0

    def rate(self, actions: NDArray[Any]) -> Array:
        """Return the rates (L,) in % per 100 pseudo periods for actions in [-1, 1], (L, 1)."""
        share = actions[:, 0]
        (slow, fast) = self.passage.rates
        back = self.passage.backward_rate
        if back == 0:
            return interpolate_log(0.5 * (share + 1), slow, fast)
        return np.where(share < 0, share * back, interpolate_log(np.maximum(share, 0), slow, fast))

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Continue at the chosen rate.

        The frequency goes no further than the far end of the range, and not back beyond its start.
        """
        low, high = self.passage.limits
        duration = np.empty(self.lanes)
        ratio = np.empty(self.lanes)
        ended = np.empty(self.lanes, dtype=np.bool_)
        advance_frequency(  # type: ignore[no-untyped-call]
            float(self.interval),
            high - low,
            self.far,
            self.sign,
            self.rate(actions) * PER_PERIOD,
            self.ratio,
            duration,
            ratio,
            ended,
        )
        return duration, ratio, ended

    def reward(self) -> Array:
        """Return the fall of the relative level (or damage) in the interval, less prices.

        The prices are those of the interval's time and of a passage that is cut off in this
        interval.
        """
        before = self._potential.copy() if self.cost_names else self._potential
        price = self.passage.time_price / 100
        fine = float(self.passage.unfinished_price)
        rewards = np.empty(self.lanes)
        pay, scale = (
            (compute_damage_rewards, self.damage_scale)
            if self.fatigue
            else (compute_level_rewards, self.level_scale)
        )
        pay(
            self.runs.reports,
            scale,
            price,
            self.duration,
            fine,
            self.late,
            self._potential,
            rewards,
        )  # type: ignore[no-untyped-call]
        if self.cost_names:
            self.charge_passage(self._potential - before)
        return rewards

    def moved(self) -> Array:
        """Return how far the actuator moved (L,): nothing moves where only the rate is chosen."""
        return np.zeros(self.lanes)

    def charge_passage(self, rise: Array) -> None:
        """Fill the interval's ``costs`` (L, 4); ``rise`` (L,) of the level."""
        self.costs[:, 0] = rise
        self.costs[:, 1] = self.duration / self.interval / self.steps
        self.costs[:, 2] = self.moved()
        self.costs[:, 3] = self.runs.reports["impact_count"] / self.interval

    def level(self) -> Array:
        """Return the level up to now.

        It is relative to the level of the reference passage under the same force, or in
        half-clearances.
        """
        return self.runs.reports["level"] / (self.length if self.absolute else self.level_scale)

    def expected_amplitude(self) -> Array:
        """Return the amplitude of the reference passage (L,) in m."""
        return 1.5 * self.level_scale

    def further(self) -> tuple[Array, ...]:
        """Return the way to the far end."""
        return ((self.far - self.ratio) / self.frequency_unit,)

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the task's part of the info, arrays (L,) by key."""
        info = super().info()
        info["level"] = self.runs.reports["level"].copy()
        info["relative_level"] = self.runs.reports["level"] / self.level_scale
        if self.fatigue:
            info["relative_damage"] = self._potential.copy()
        return info


@dataclass(frozen=True)
class OneRateSettings:
    """Arguments of a passage at one rate; those of `PassageSettings` where the names are equal.

    Parameters
    ----------
    rate : float or None
        Rate in % per 100 pseudo periods. By default it suits the damping of the resonance
        (`impact_env.drive.default_rate`; 1 for the paper's beam).
    direction : str
        ``"down"``, ``"up"`` or ``"random"``.
    limits : pair
        Lowest and highest frequency over the resonance.
    time_price : float
        Price of 100 pseudo periods.
    objective : str
        ``"level"`` or ``"fatigue"``.
    level_unit : str
        Unit of feature 9: ``"reference"`` (level without absorber) or ``"gap"`` (half-clearance).
    fatigue_exponent : float
        Exponent of the displacement with the objective ``"fatigue"``.

    """

    rate: float | None = None
    direction: str = PassageSettings.direction
    limits: Range = PassageSettings.limits
    time_price: float = PassageSettings.time_price
    objective: str = PassageSettings.objective
    level_unit: str = PassageSettings.level_unit
    fatigue_exponent: float = PassageSettings.fatigue_exponent

    def passage(self, settings: TaskSettings) -> PassageSettings:
        """Return the passage with enough time to finish it.

        If no rate is given, it has the rate that suits the damping of the resonance.
        """
        low, high = check_range("limits", self.limits)
        rate = (
            default_rate(settings.scene.model, (settings.resonance,))
            if self.rate is None
            else positive("rate", self.rate)
        )
        rates = speeds("rate", rate, (low, high))
        budget = abs(high - low) / (rates[0] * PER_PERIOD)
        own = {name: value for name, value in vars(self).items() if name != "rate"}
        return PassageSettings(rates=rates, time_budget=1.01 * budget + 1, **own)


class PassiveTask(SweepTask):
    """A passage at one rate, without a choice and so without costs."""

    cost_names: Sequence[str] = ()
    least_cost: float | Array = 0.0

    def __init__(self, settings: TaskSettings, way: OneRateSettings, lanes: int) -> None:
        super().__init__(settings, way.passage(settings), lanes)
        self._rate = np.full(lanes, self.passage.rates[0])

    def rate(self, actions: NDArray[Any]) -> Array:  # noqa: ARG002 - there is no choice
        """Return the one rate for all lanes."""
        return self._rate
