"""Passages through a resonance: arguments, schedules, reward, and the rate as an actuator.

The frequency runs from one side of the resonance to the other at a rate that is chosen in each
interval, fixed, or random.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count_from, non_negative, positive, require, word_of
from impact_env.drive import PAPER_LIMITS, default_rate
from impact_env.envs.actuators import MovingWallsActuator
from impact_env.envs.observation import DISTANCE_TO_END, SWEEP_RATE
from impact_env.envs.reference import simulate_passage
from impact_env.envs.settings import SWEEP_OBJECTIVES, Range, TaskSettings, check_range
from impact_env.envs.task import (
    FREQUENCY_SCALE,
    Actuator,
    Advance,
    Array,
    ForceSchedule,
    Generator,
    LaneState,
    Reward,
)
from impact_env.fields import check_fields
from impact_env.kernels.control.episodes import (
    advance_frequency,
    compute_damage_rewards,
    compute_level_rewards,
)
from impact_env.kernels.control.interval import interpolate_log
from impact_env.level import require_samples
from impact_env.parameters import RigidWalls, SlidingAbsorber
from impact_env.scene import Scene

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

    @property
    def damage_exponent(self) -> float:
        """The exponent of the damage, 0 if the level is rated."""
        return self.fatigue_exponent if self.objective == "fatigue" else 0.0


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


DIGITS = 1e-12


def _span_within(
    name: str, value: Any, *, lowest: float, highest: float = math.inf
) -> tuple[float, float]:
    """Return (low, high) as floats if both lie from ``lowest`` to ``highest``."""
    low, high = check_range(name, value)
    allowed = f"(low, high), from {lowest:g} to {highest:g}"
    require(lowest <= low and high <= highest, name, value, allowed)
    return low, high


@dataclass(frozen=True)
class RandomisedSettings:
    """Arguments of the random values of a passage.

    Parameters
    ----------
    limits : pair
        Lowest and highest frequency over the resonance.
    start_spread : float
        Largest distance of the start from the near end of ``limits``, as a frequency ratio.
    sweep_rates : pair
        Slowest and fastest rate in % per 100 pseudo periods.
    gap_starts : pair
        Smallest and largest half-clearance at the start in m.
    damping : pair
        Smallest and largest damping ratio of all modes.
    restitution : pair
        Smallest and largest coefficient of restitution.
    scenes : int
        Number of pairs of damping and restitution, spread evenly over their ranges.
    price : float
        Price of moving the walls by one half-clearance of the scene.
    fatigue_exponent : float
        Exponent of the displacement in the cost of fatigue.

    """

    limits: Range = (0.93, 1.03)
    start_spread: float = 0.01
    sweep_rates: Range = (2.0, 6.0)
    gap_starts: Range = (0.3e-3, 2e-3)
    damping: Range = (0.005, 0.02)
    restitution: Range = (0.6, 1.0)
    scenes: int = 12
    price: float = 0.01
    fatigue_exponent: float = PassageSettings.fatigue_exponent

    def __post_init__(self) -> None:
        check_fields(
            self,
            limits=partial(_span_within, lowest=DIGITS),
            gap_starts=partial(_span_within, lowest=DIGITS),
            damping=partial(_span_within, lowest=1e-4, highest=0.5),
            restitution=partial(_span_within, lowest=0.0, highest=1.0),
            scenes=count_from(1, 1000),
            price=non_negative,
            fatigue_exponent=positive,
            start_spread=non_negative,
        )
        half_width = 0.5 * (self.limits[1] - self.limits[0])
        require(
            self.start_spread < half_width,
            "start_spread",
            self.start_spread,
            f"less than half the width of limits, {half_width:g}",
        )
        check_fields(self, sweep_rates=partial(speeds, limits=self.limits))

    def pool(self, scene: Scene) -> list[Scene]:
        """Return the scenes from which episodes draw.

        Each has its own damping and restitution. The scenes are the same at every call.
        """
        absorber = scene.absorber
        assert isinstance(absorber, SlidingAbsorber)
        assert isinstance(absorber.walls, RigidWalls)
        shares = np.random.default_rng(0).permutation((np.arange(self.scenes) + 0.5) / self.scenes)
        made = []
        for k, share in enumerate(shares.tolist()):
            damping = self.damping[0] * (self.damping[1] / self.damping[0]) ** (
                (k + 0.5) / self.scenes
            )
            model = replace(scene.model, damping_ratio=np.full(scene.model.modes, damping))
            walls = replace(
                absorber.walls,
                restitution=self.restitution[0]
                + share * (self.restitution[1] - self.restitution[0]),
            )
            made.append(replace(scene, model=model, absorber=replace(absorber, walls=walls)))
        return made


class PassageSchedule(ForceSchedule):
    """A passage through a resonance at ``rates`` (L,) in % per 100 pseudo periods.

    The rates are the slowest one, unless a `RateActuator` sets others. ``sign`` (L,) is 1 for a
    passage up and -1 for one down, and ``far`` (L,) is the frequency ratio at its end.
    """

    def __init__(self, lanes: LaneState, passage: PassageSettings) -> None:
        super().__init__(lanes)
        self.passage = passage
        self.steps = max(1, math.ceil(passage.time_budget / lanes.interval - 1e-9))
        self.budget_terminates = passage.budget_end == "terminated"
        self.frequency_unit = passage.frequency_unit
        low, high = passage.limits
        if passage.frequency_origin == "middle":
            self.frequency_origin = 0.5 * sum(passage.limits)
        require_samples(lanes.settings.samples_per_period, high)
        self.ends = ((low, high), (high, low))  # of a passage up, and of one down
        self.sign = np.ones(lanes.count)
        self.far = np.ones(lanes.count)
        self.rates = np.full(lanes.count, passage.rates[0])
        self.columns = {DISTANCE_TO_END.name: self.compute_distance_to_end}

    def start(self, lane: int, generator: Generator) -> None:
        """Draw the direction."""
        direction = self.passage.direction
        down = bool(generator.integers(2)) if direction == "random" else direction == "down"
        self.lanes.ratio[lane], self.far[lane] = self.ends[int(down)]
        self.sign[lane] = -1.0 if down else 1.0

    def advance(self) -> Advance:
        """Continue at the rates.

        The frequency goes no further than the far end of the range, and not back beyond its start.
        """
        count = self.lanes.count
        low, high = self.passage.limits
        duration = np.empty(count)
        ratio = np.empty(count)
        ended = np.empty(count, dtype=np.bool_)
        advance_frequency(  # type: ignore[no-untyped-call]
            float(self.lanes.interval),
            high - low,
            self.far,
            self.sign,
            self.rates * PER_PERIOD,
            self.lanes.ratio,
            duration,
            ratio,
            ended,
        )
        return duration, ratio, ended

    def compute_distance_to_end(self) -> Array:
        """Return the distances (L,) to the far end in the unit of frequency."""
        return (self.far - self.lanes.ratio) / self.frequency_unit


class RandomPassageSchedule(PassageSchedule):
    """A passage with random direction, start and rate."""

    def __init__(
        self, lanes: LaneState, passage: PassageSettings, randomised: RandomisedSettings
    ) -> None:
        super().__init__(lanes, passage)
        self.randomised = randomised
        self.columns[SWEEP_RATE.name] = self.scale_rate

    def start(self, lane: int, generator: Generator) -> None:
        """Draw direction, start and rate."""
        super().start(lane, generator)
        offset = self.sign[lane] * self.randomised.start_spread * generator.uniform()
        self.lanes.ratio[lane] += offset
        self.rates[lane] = generator.uniform(*self.randomised.sweep_rates)

    def scale_rate(self) -> Array:
        """Return the rates (L,) over 4 % per 100 pseudo periods."""
        return self.rates / 4


class RateActuator(Actuator):
    """The rate of a passage."""

    def __init__(self, schedule: PassageSchedule) -> None:
        super().__init__(schedule.lanes)
        self.schedule = schedule

    def starting_action(self) -> float:
        """Return the middle of the range, since a machine at rest has no rate."""
        return 0.0

    def apply(self, actions: Array, column: int) -> None:
        """Set the rates: logarithmic between the slowest and the fastest, or backward."""
        share = actions[:, column]
        slow, fast = self.schedule.passage.rates
        back = self.schedule.passage.backward_rate
        if back == 0:
            self.schedule.rates = interpolate_log(0.5 * (share + 1), slow, fast)
            return
        forward = interpolate_log(np.maximum(share, 0), slow, fast)
        self.schedule.rates = np.where(share < 0, share * back, forward)


class PassageReward(Reward):
    """The fall of the relative level (or damage) in an interval, less prices.

    Level and damage are relative to those of the beam without absorber in the same passage. The
    prices are those of the interval's time and of a passage that is cut off in this interval.

    Of ``costs`` the level is the rise of the relative level (or damage), time is that over the time
    budget, and impacts are those a pseudo period of a whole interval. ``level_scale`` (L,) in m is
    the level of the reference.

    Parameters
    ----------
    schedule : PassageSchedule
        The passage.
    actuator : Actuator or None
        Actuator whose motion is a cost; without one there are no costs.
    """

    cost_names: Sequence[str] = ("level", "time", "actuator", "impacts")
    least_cost: float | Array = np.array([-math.inf, 0.0, 0.0, 0.0])

    def __init__(self, schedule: PassageSchedule, actuator: Actuator | None = None) -> None:
        if actuator is None:
            self.cost_names = ()
            self.least_cost = 0.0
        super().__init__(schedule.lanes)
        count = self.lanes.count
        passage = schedule.passage
        self.schedule = schedule
        self.passage = passage
        self.actuator = actuator
        self.is_fatigue = passage.objective == "fatigue"
        self.in_gaps = passage.level_unit == "gap"
        self.level_name = (
            "level over the scene's half-clearance"
            if self.in_gaps
            else "level relative to no absorber"
        )
        self.level_scale = np.ones(count)
        self.damage_scale = np.ones(count)
        self.relative = np.zeros(count)  # level (or damage) so far
        self._references: dict[tuple[int, bool], tuple[float, float]] = {}
        for down in (False, True):
            self.find_reference(0, down)  # an error is raised here, not at a reset

    def find_reference(self, scene: int, down: bool) -> tuple[float, float]:
        """Return level (m) and damage without absorber under 1 N, over the whole range."""
        if (scene, down) not in self._references:
            settings = self.lanes.settings
            self._references[scene, down] = simulate_passage(
                self.lanes.scenes[scene],
                settings.resonance,
                *self.schedule.ends[int(down)],
                settings.samples_per_period,
                self.passage.damage_exponent,
                settings.length,
                settings.moves_base,
            )
        return self._references[scene, down]

    def start(self, lane: int, generator: Generator) -> None:
        """Set a lane's reference, see `Reward.start`."""
        super().start(lane, generator)
        scene = int(self.lanes.which[lane])
        force = float(self.lanes.force[lane])
        level, damage = self.find_reference(scene, bool(self.schedule.sign[lane] < 0))
        self.level_scale[lane] = level * force
        if self.is_fatigue:
            self.damage_scale[lane] = damage * force**self.passage.fatigue_exponent
        self.relative[lane] = 0.0

    def compute(self) -> Array:
        """Return the rewards (L,) of the last interval."""
        lanes = self.lanes
        before = self.relative if self.actuator is None else self.relative.copy()
        rewards = np.empty(lanes.count)
        compute_rewards, scale = (
            (compute_damage_rewards, self.damage_scale)
            if self.is_fatigue
            else (compute_level_rewards, self.level_scale)
        )
        compute_rewards(  # type: ignore[no-untyped-call]
            lanes.runs.reports,
            scale,
            self.passage.time_price / 100,
            lanes.duration,
            float(self.passage.unfinished_price),
            lanes.late,
            self.relative,
            rewards,
        )
        if self.actuator is not None:
            self.charge(self.relative - before, self.actuator.compute_displacement())
        return rewards

    def charge(self, rise: Array, displacement: Array) -> None:
        """Fill the costs of the last interval.

        ``rise`` (L,) is that of the relative level, ``displacement`` (L,) that of the actuator.
        """
        lanes = self.lanes
        self.costs[:, 0] = rise
        self.costs[:, 1] = lanes.duration / lanes.interval / self.schedule.steps
        self.costs[:, 2] = displacement
        self.costs[:, 3] = lanes.runs.reports["impact_count"] / lanes.interval

    def level(self) -> Array:
        """Return the level so far (L,), relative to the reference or in half-clearances."""
        unit = self.lanes.length if self.in_gaps else self.level_scale
        return self.lanes.runs.reports["level"] / unit

    def expected_amplitude(self) -> Array:
        """Return the amplitude of the reference (L,) in m."""
        return 1.5 * self.level_scale

    def info(self) -> dict[str, NDArray[Any]]:
        """Return level (m) and relative level, and the relative damage if it is rated."""
        level = self.lanes.runs.reports["level"]
        info = {"level": level.copy(), "relative_level": level / self.level_scale}
        return info | {"relative_damage": self.relative.copy()} if self.is_fatigue else info


class RandomPassageReward(PassageReward):
    """The reward of a passage, less a price for moving the walls.

    Impacts, a pseudo period of a whole interval, are a cost in the place of the contact force: over
    several periods the absorber's momentum does not give it, and reports have no impulses. The
    level of observations is the RMS of the last interval.
    """

    cost_names = ("level", "time", "fatigue", "actuator", "impacts")
    least_cost = np.array([-math.inf, 0.0, 0.0, 0.0, 0.0])

    def __init__(self, schedule: PassageSchedule, walls: MovingWallsActuator, price: float) -> None:
        super().__init__(schedule, walls)
        self.walls = walls
        self.price = price
        self.level_name = "RMS of an interval over the scene's half-clearance"

    def compute(self) -> Array:
        """Return the rewards (L,) of the last interval."""
        rewards = super().compute()
        distance = np.abs(self.lanes.runs.orders["gap"] - self.walls.gap_before)
        return rewards - self.price * distance / self.lanes.length

    def charge(self, rise: Array, displacement: Array) -> None:
        """Fill the costs of the last interval, see `PassageReward.charge`."""
        lanes = self.lanes
        self.fill_costs(displacement, self.schedule.steps)
        self.costs[:, 0] = rise
        self.costs[:, 4] = lanes.runs.reports["impact_count"] / lanes.interval

    def level(self) -> Array:
        """Return the RMS of the last interval (L,) in half-clearances of the scene."""
        return np.sqrt(self.lanes.runs.reports["mean_square"]) / self.lanes.length
