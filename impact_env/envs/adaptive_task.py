"""An absorber that is adjusted interval by interval, during a passage or at one frequency.

The half-clearance of its cavity or its friction limit is adjusted.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    positive,
    require,
    word_of,
)
from impact_env.controlled import friction_limit
from impact_env.envs.observation import (
    DISTANCE_TO_END,
    FRICTION_IN_USE,
    GAP_IN_USE,
    LENGTH_UNIT,
    LEVEL_FEATURE,
    RMS,
    STATE,
    Feature,
)
from impact_env.envs.reference import mean_power_of_cosine
from impact_env.envs.settings import Range, TaskSettings, check_pair, check_range
from impact_env.envs.sweep_task import OneRateSettings, PassageSettings, PassiveTask, SweepTask
from impact_env.envs.task import Array, Mask, Task
from impact_env.fields import check_fields
from impact_env.frequency import receptance
from impact_env.kernels.control.episodes import order_friction
from impact_env.kernels.control.interval import interpolate_log
from impact_env.level import require_samples
from impact_env.parameters import Absorber, RigidWalls, SlidingAbsorber

WIDEST_GAPS = (1e-9, 1e9)  # of the range, in its unit


@dataclass(frozen=True)
class GapRange:
    """Arguments of the choice of the gap.

    Parameters
    ----------
    gap_limits : pair
        Smallest and largest half-clearance in m.

    """

    gap_limits: Range = (0.1e-3, 3e-3)

    def __post_init__(self) -> None:
        check_fields(self, gap_limits=check_pair("half-clearances in m"))


def find_log_place(value: float, low: float, high: float) -> float:
    """Return the position of a value between ``low`` and ``high`` on a logarithmic scale.

    The position is -1 at ``low`` and 1 at ``high``. Values outside are moved to the ends.
    """
    if low == high:
        return 0.0
    return min(max(2 * math.log(value / low) / math.log(high / low) - 1, -1.0), 1.0)


def require_cavity(absorber: Absorber | None) -> None:
    """Raise ParameterError unless an absorber is in a cavity with rigid walls."""
    rigid = isinstance(absorber, SlidingAbsorber) and isinstance(absorber.walls, RigidWalls)
    require(
        rigid,
        "absorber",
        absorber,
        "an impact absorber with rigid walls: there must be a cavity whose walls can be set",
    )


class VariableGapTask(Task):
    """A task whose cavity is set: the half-clearance in use is that of the runs' orders."""

    def begin(self, lane: int) -> None:
        """Give the cavity the scene's half-clearance, see `Task.begin`."""
        super().begin(lane)
        self.runs.orders["gap"][lane] = self.length

    def further(self) -> tuple[Array, ...]:
        """Return the half-clearance in use, too."""
        return (*super().further(), self.runs.orders["gap"] / self.length)

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the task's part of the info, arrays (L,) by key."""
        return super().info() | {"gap": self.runs.orders["gap"].copy()}


class ChosenGapTask(VariableGapTask):
    """A task whose half-clearances take effect immediately.

    They are ``wanted`` (L,) in m, but no smaller than the absorber's distance from the middle.
    """

    wanted: Array
    gap_before: Array

    def moved(self) -> Array:
        """Return the walls' way (L,) in half-clearances of the scene."""
        return np.abs(self.runs.orders["gap"] - self.gap_before) / self.length

    def begin(self, lane: int) -> None:
        """Give the cavity the scene's half-clearance, see `Task.begin`."""
        super().begin(lane)
        self.wanted[lane] = self.length

    def order_gaps(self, wanted: Array) -> None:
        """Order half-clearances (L,) in m; ``gap_before`` (L,): those until now."""
        self.gap_before = self.runs.orders["gap"].copy()
        self.runs.orders["gap"] = self.wanted = wanted

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the task's part of the info, arrays (L,) by key."""
        return super().info() | {"gap_limited": self.runs.orders["gap"] > self.wanted}


class SweepGapTask(ChosenGapTask, SweepTask):
    """Lanes that pass through a resonance, each with a cavity that is set on the way."""

    features: Sequence[Feature] = (*STATE, DISTANCE_TO_END, GAP_IN_USE)

    def __init__(
        self, settings: TaskSettings, passage: PassageSettings, cavity: GapRange, lanes: int
    ) -> None:
        require_cavity(settings.scene.absorber)
        self.cavity = cavity
        self.wanted = np.zeros(lanes)
        self.gap_before = np.zeros(lanes)
        super().__init__(settings, passage, lanes)
        self.described = (passage, cavity)

    def starting_action(self) -> Array:
        """Return the middle of the rate's range and the scene's half-clearance (2,).

        See `Task.starting_action`.
        """
        return np.array([0.0, find_log_place(self.length, *self.cavity.gap_limits)])

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Order the wanted half-clearances, and go on at the chosen rates."""
        self.order_gaps(interpolate_log(0.5 * (actions[:, 1] + 1), *self.cavity.gap_limits))
        return super().decide(actions)


@dataclass(frozen=True)
class FrictionRange:
    """Arguments of the choice of the friction limit.

    Parameters
    ----------
    friction_range : pair
        Smallest and largest friction limit, above 0, in units of m_a g0 omega^2 (mass of the
        absorber, half-clearance, resonance; 0.72 N in the default scene). Friction of equal size in
        this unit has equal effect on any structure.

    """

    friction_range: Range = (0.02, 20.0)

    def __post_init__(self) -> None:
        check_fields(self, friction_range=check_range)
        low, high = self.friction_range
        ok = WIDEST_GAPS[0] <= low < high <= WIDEST_GAPS[1]
        allowed = f"(low, high) with {WIDEST_GAPS[0]} <= low < high <= {WIDEST_GAPS[1]}"
        require(ok, "friction_range", self.friction_range, allowed)


class VariableFrictionTask(Task):
    """A task with friction that is set: ``limits`` (N) has the lowest and highest friction limit.

    ``friction`` (L,) in N and ``place`` (L,) in the range, from -1 to 1, are those in use.
    """

    def set_limits(self, settings: TaskSettings, grip: FrictionRange, lanes: int) -> None:
        """Set the limits in N; raises ParameterError where there is no rigid friction."""
        scene = settings.scene
        self._begin = friction_limit(settings.scene)
        require(
            math.isfinite(self._begin),
            "absorber",
            scene.absorber,
            "one with rigid friction: there must be a friction_limit that can be set",
        )
        assert scene.absorber_mass is not None
        unit = scene.absorber_mass * settings.length * settings.omega**2
        self.limits = low, high = grip.friction_range[0] * unit, grip.friction_range[1] * unit
        self._begin_place = 2 * math.log(self._begin / low) / math.log(high / low) - 1
        self.friction = np.full(lanes, self._begin)
        self.place = np.zeros(lanes)
        self.place_moved = np.zeros(lanes)

    def begin(self, lane: int) -> None:
        """Show the scene's friction, see `Task.begin`."""
        super().begin(lane)
        self.friction[lane], self.place[lane] = self._begin, self._begin_place

    def starting_action(self) -> Array:
        """Return the position of the scene's friction limit in the range (1,).

        See `Task.starting_action`.
        """
        return np.clip([self._begin_place], -1, 1)

    def order_friction(self, actions: Array, column: int = 0) -> None:
        """Order the friction limits by their positions in the range.

        The positions are a column of the actions (L, A). ``place_moved`` (L,) is set to the
        distances by which the positions change.
        """
        order_friction(  # type: ignore[no-untyped-call]
            actions,
            column,
            *self.limits,
            self.runs.orders,
            self.friction,
            self.place,
            self.place_moved,
        )

    def further(self) -> tuple[Array, ...]:
        """Return the place of the friction limit in use, too."""
        return (*super().further(), self.place)

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the task's part of the info, arrays (L,) by key."""
        return super().info() | {"friction_limit": self.friction.copy()}


class FrictionTask(VariableFrictionTask, PassiveTask):
    """Lanes that pass through a resonance, each with friction that is set on the way.

    Of `costs` the actuator's way is over the range of limits, which is 2 wide.
    """

    cost_names = SweepTask.cost_names
    least_cost = SweepTask.least_cost

    def moved(self) -> Array:
        """Return the way over the range of limits."""
        return self.place_moved

    features: Sequence[Feature] = (*STATE, DISTANCE_TO_END, FRICTION_IN_USE)

    def __init__(
        self, settings: TaskSettings, way: OneRateSettings, grip: FrictionRange, lanes: int
    ) -> None:
        self.set_limits(settings, grip, lanes)
        super().__init__(settings, way, lanes)
        self.described = (self.passage, way, grip)

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Order the chosen friction limits, and go on."""
        self.order_friction(actions)
        return super().decide(actions)


GAP_OBJECTIVES = ("rms", "fatigue")


@dataclass(frozen=True)
class GapControl:
    """Arguments of the choice of the gap at one frequency.

    Parameters
    ----------
    gap_limits : pair
        Smallest and largest half-clearance in m.
    hold : pair
        Shortest and longest time for which a force lasts, in pseudo periods.
    frequency_ratio : float or pair
        Frequency over the resonance, or a pair (low, high) from which each episode draws.
    time_budget : float
        Length of an episode in pseudo periods, rounded up to whole intervals.
    objective : str
        ``"rms"`` or ``"fatigue"``.
    fatigue_exponent : float
        Exponent of the displacement with the objective ``"fatigue"``.

    """

    gap_limits: Range = (0.1e-3, 3e-3)
    hold: Range = (100.0, 300.0)
    frequency_ratio: float | Range = (0.97, 1.01)
    time_budget: float = 1000.0
    objective: str = "rms"
    fatigue_exponent: float = 5.0

    def __post_init__(self) -> None:
        check_fields(
            self,
            objective=word_of(GAP_OBJECTIVES),
            gap_limits=check_pair("half-clearances in m"),
            hold=check_pair("pseudo periods"),
            frequency_ratio=check_pair("ratios to the resonance"),
            time_budget=positive,
            fatigue_exponent=positive,
        )


class GapTask(ChosenGapTask):
    """Lanes with a cavity that is set under a force that changes.

    Of `costs` the level is the interval's share of the mean relative response, the actuator moves
    the walls, in half-clearances of the scene, and impacts are those a pseudo period.
    """

    cost_names = ("level", "time", "actuator", "impacts")

    features: Sequence[Feature] = (
        *STATE[:-1],
        Feature(LEVEL_FEATURE.name, True, RMS.what, LENGTH_UNIT),
        GAP_IN_USE,
    )
    level_name = "RMS over the scene's half-clearance"

    def __init__(self, settings: TaskSettings, control: GapControl, lanes: int) -> None:
        require_cavity(settings.scene.absorber)
        self.described = (control,)
        self.control = control
        self._ratios = check_range("frequency_ratio", control.frequency_ratio)
        self._gaps = check_range("gap_limits", control.gap_limits)
        require_samples(settings.samples_per_period, self._ratios[1])
        self.fatigue = control.objective == "fatigue"
        steps = max(1, math.ceil(control.time_budget / settings.interval - 1e-9))
        super().__init__(settings, lanes, steps, control.fatigue_exponent if self.fatigue else 0.0)
        self._forces = np.zeros((lanes, steps))
        self._scale = np.ones((lanes, steps))
        self._ratio = np.ones(lanes)
        self._rows = np.arange(lanes)
        self.wanted = np.zeros(lanes)
        self.gap_before = np.zeros(lanes)

    def starting_action(self) -> Array:
        """Return the scene's half-clearance in the range (1,), see `Task.starting_action`."""
        low, high = self._gaps
        return np.clip([2 * (self.length - low) / (high - low) - 1 if low < high else 0.0], -1, 1)

    def draw(self, lane: int, generator: np.random.Generator) -> None:
        """Draw the frequency and the schedule of the force."""
        low, high = self._ratios
        self.ratio[lane] = low if low == high else generator.uniform(low, high)
        done = 0
        interval = self.interval
        shortest, longest = self.control.hold
        while done < self.steps:
            held = max(1, round(generator.uniform(shortest, longest) / interval))
            self._forces[lane, done : done + held] = self.draw_force(lane, generator)
            done += held
        model = self.settings.scene.model
        amplitude = float(
            abs(
                receptance(
                    model, self.ratio[lane] * self.omega, model.level_shape, model.force_shape
                )
            )
        )
        exponent = self.control.fatigue_exponent
        largest = amplitude * self._forces[lane]
        mean = mean_power_of_cosine(exponent)
        self._scale[lane] = (
            [(one / self.length) ** exponent * mean for one in largest.tolist()]
            if self.fatigue
            else largest / math.sqrt(2)
        )
        self.force[lane] = self._forces[lane, 0]

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Order the wanted half-clearances and the forces of the interval."""
        low, high = self._gaps
        self.order_gaps(low + 0.5 * (actions[:, 0] + 1) * (high - low))
        self.force = self._forces[self._rows, np.minimum(self.elapsed, self.steps - 1)]
        return (
            np.full(self.lanes, self.interval),
            self.ratio.copy(),
            np.zeros(self.lanes, dtype=np.bool_),
        )

    def reward(self) -> Array:
        """Return minus the interval's share of the mean relative response."""
        scale = self._scale[self._rows, self.elapsed - 1] * self.steps
        samples = self.interval * self.settings.samples_per_period
        rewards: Array = (
            -(self.runs.reports["damage"] / samples) / scale
            if self.fatigue
            else -np.sqrt(self.runs.reports["mean_square"]) / scale
        )
        self.costs[:, 0] = -rewards
        self.costs[:, 1] = 1 / self.steps
        self.costs[:, 2] = self.moved()
        self.costs[:, 3] = self.runs.reports["impact_count"] / self.interval
        return rewards

    def level(self) -> Array:
        """Return the RMS of the last interval in units of the scene's half-clearance."""
        return np.sqrt(self.runs.reports["mean_square"]) / self.length

    def expected_amplitude(self) -> Array:
        """Return twice the largest half-clearance for all lanes (L,) in m."""
        return np.full(self.lanes, 2 * self.control.gap_limits[1])  # type: ignore[index]

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the task's part of the info, arrays (L,) by key."""
        return super().info() | {"rms": np.sqrt(self.runs.reports["mean_square"])}
