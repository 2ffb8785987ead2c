"""Control within a period, at one frequency and from rest.

The friction or the walls of an absorber are set every quarter of a period.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    non_negative,
    positive,
    require,
)
from impact_env.controlled import friction_limit
from impact_env.envs.adaptive_task import (
    FrictionRange,
    GapRange,
    VariableFrictionTask,
    VariableGapTask,
    find_log_place,
    require_cavity,
)
from impact_env.envs.observation import (
    DISTANCE,
    FREQUENCY,
    FRICTION_IN_USE,
    GAP_IN_USE,
    IMPACTS,
    LENGTH_UNIT,
    TIME_LEFT,
    VELOCITY,
    Feature,
)
from impact_env.envs.reference import stationary_amplitude
from impact_env.envs.settings import FORCE_BOUNDS, Range, TaskSettings, check_pair, check_range
from impact_env.envs.task import Array, Mask, PooledTask
from impact_env.fields import check_fields
from impact_env.kernels.control.episodes import (
    compute_cycle_rewards,
    fill_cycle_features,
    measure_wall_motion,
    order_wall_motion,
)
from impact_env.level import require_samples
from impact_env.modes import ModalModel
from impact_env.scene import Scene

PLANTS = 16  # dampings that episodes draw from
PERIODS_PER_LEVEL = (
    Feature("tip displacement", True, "displacement of the tip", LENGTH_UNIT),
    Feature("tip velocity", True, "velocity of the tip", "m/s / unit of velocity"),
    Feature(DISTANCE.name, True, "place of the absorber relative to the tip", LENGTH_UNIT),
    Feature(
        VELOCITY.name,
        True,
        "velocity of the absorber relative to the tip",
        "m/s / unit of velocity",
    ),
    IMPACTS,
    Feature("cosine of the force's phase", False, "cosine of the force's phase"),
    Feature("sine of the force's phase", False, "sine of the force's phase"),
    FREQUENCY,
    TIME_LEFT,
    Feature("RMS of the last period", True, "RMS of the tip over the last period", LENGTH_UNIT),
)


def _check_error(name: str, value: Any) -> Range:
    """Return a relative error as a pair (low, high), above -1."""
    low, high = check_range(name, value)
    allowed = "above -1, as a share of what the scene has: a number, or a pair (low, high)"
    require(low > -1, name, value, allowed)
    return low, high


def vary_damping(scenes: Sequence[Scene], error: Range) -> list[Scene]:
    """Return scenes with changed damping ratios, by the same factor for all modes of a scene.

    Several scenes are returned once each. A single scene is returned in `PLANTS` variants.

    ``error``: range of the relative change; its values are spread evenly.
    """
    low, high = error
    if low == high == 0:
        return list(scenes)
    number = 1 if low == high else PLANTS if len(scenes) == 1 else len(scenes)
    shares = np.random.default_rng(0).permutation((np.arange(number) + 0.5) / number)
    varied = []
    for k in range(max(number, len(scenes))):
        scene = scenes[k % len(scenes)]
        factor = 1 + low + float(shares[k % number]) * (high - low)
        model = replace(scene.model, damping_ratio=factor * np.asarray(scene.model.damping_ratio))
        varied.append(replace(scene, model=model))
    return varied


@dataclass(frozen=True)
class ActiveSettings:
    """Arguments of the control within a period.

    Parameters
    ----------
    frequency_ratio : float or pair
        Frequency over the resonance, or a pair (low, high) from which each episode draws.
    time_budget : float
        Length of an episode in pseudo periods.
    fatigue_exponent : float
        Exponent of the displacement in the cost of fatigue.
    price : float
        Price of moving the action by 1, or the walls by one half-clearance of the scene.
    friction_error : float or pair
        Share by which the friction limit is above the limit that the control assumes (0.2: 20 %
        more), or a pair (low, high) from which each episode draws.
    damping_error : float or pair
        The same of all damping ratios; a pair gives 16 values to draw from. The reference of the
        score has the true damping.

    """

    frequency_ratio: float | Range = (0.96, 1.02)
    time_budget: float = 40.0
    fatigue_exponent: float = 5.0
    price: float = 0.0
    friction_error: float | Range = 0.0
    damping_error: float | Range = 0.0

    def __post_init__(self) -> None:
        check_fields(
            self,
            friction_error=_check_error,
            damping_error=_check_error,
            frequency_ratio=check_pair("ratios to the resonance"),
            time_budget=positive,
            fatigue_exponent=positive,
            price=non_negative,
        )


class ActiveTask(PooledTask):
    """Lanes at one frequency each, whose absorber is set in every interval.

    Each lane has one of ``scenes``, which differ in damping.

    Of `costs` the level is the RMS over the stationary RMS without absorber, over the number of
    intervals; the contact force is the mean force of wall and friction on the absorber, from its
    momentum, over the amplitude of the force.
    """

    cost_names = ("level", "time", "fatigue", "actuator", "contact force")
    level_name = "RMS of a period over the scene's half-clearance"

    def __init__(self, settings: TaskSettings, cycle: ActiveSettings, lanes: int) -> None:
        low, high = check_range("frequency_ratio", cycle.frequency_ratio)
        require_samples(settings.samples_per_period, high)
        self.cycle = cycle
        damping_error = check_range("damping_error", cycle.damping_error)
        nominal = self.nominal_scenes(settings)
        self.scenes = vary_damping(nominal, damping_error)
        self._draws_damping = len(self.scenes) > len(nominal)
        self.friction_error = check_range("friction_error", cycle.friction_error)
        self._ratios = (low, high)
        self.described = (cycle,)
        super().__init__(
            settings,
            lanes,
            max(1, math.ceil(cycle.time_budget / settings.interval - 1e-9)),
            cycle.fatigue_exponent,
        )
        self.options = {"force": FORCE_BOUNDS, "frequency_ratio": (low, high)}
        self.squares = np.zeros((lanes, max(1, round(1 / settings.interval))))
        self._scale = np.ones(lanes)
        self._speed, self._rms = (np.zeros(lanes) for _ in range(2))
        self._whole = np.full(lanes, float(self.interval))
        self._shape = np.array([self.scene.model.level_shape])
        mass = self.scene.absorber_mass
        assert mass is not None  # what is set is an absorber's
        self._mass_rate = mass / (self.interval * self._period)

    def nominal_scenes(self, settings: TaskSettings) -> Sequence[Scene]:
        """Return the scenes that episodes draw from, without errors of damping."""
        return [settings.scene]

    def model(self, lane: int) -> ModalModel:
        """Return a lane's structure."""
        return self.scenes[self.which[lane]].model

    def draw(self, lane: int, generator: np.random.Generator) -> None:
        """Draw frequency and force."""
        low, high = self._ratios
        self.ratio[lane] = self.drawn(
            "frequency_ratio", lane, low if low == high else generator.uniform(low, high)
        )
        self.force[lane] = self.draw_force(lane, generator)
        self.squares[lane] = self._speed[lane] = self._rms[lane] = 0.0

    def draw_machine(self, lane: int, generator: np.random.Generator) -> None:
        """Draw damping and friction, see `Task.draw_machine`.

        The reference of the score has the true damping.
        """
        if self._draws_damping:
            self.which[lane] = generator.integers(len(self.scenes))
        low, high = self.friction_error
        if low != 0 or high != 0:
            error = low if low == high else float(generator.uniform(low, high))
            self.set_friction_factor(lane, 1 + error)
        unit = stationary_amplitude(
            self.model(lane), self.ratio[lane] * self.omega, self.settings.moves_base
        )
        self._scale[lane] = unit * self.force[lane] / math.sqrt(2)

    @abstractmethod
    def set_friction_factor(self, lane: int, factor: float) -> None:
        """Set a lane's friction limit to ``factor`` times the limit that the control assumes."""

    @abstractmethod
    def act(self, actions: Array) -> None:
        """Order the absorber's friction or gap in the next interval.

        ``actions`` (L, 1) are numbers from -1 to 1.
        """

    @abstractmethod
    def moved(self) -> Array:
        """Return how far the actuator moved (L,) in the unit of its price."""

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Order what is chosen, and stay at the frequency."""
        self.act(actions)
        return self._whole, self.ratio, np.zeros(self.lanes, dtype=np.bool_)

    def reward(self) -> Array:
        """Return minus the interval's share of the mean relative RMS, less the actuator's price.

        The actuator's price is paid for each change of the actuator's setting.
        """
        moved = self.moved()
        self.charge(moved)
        rewards = np.empty(self.lanes)
        compute_cycle_rewards(  # type: ignore[no-untyped-call]
            self.runs.reports,
            self.runs.state,
            self.steps,
            self.cycle.price,
            self._mass_rate,
            self.force,
            self._scale,
            moved,
            self.squares,
            self._speed,
            self._rms,
            self.costs,
            rewards,
        )
        return rewards

    def level(self) -> Array:
        """Return the RMS of the last period in half-clearances of the scene."""
        return np.sqrt(np.add.reduce(self.squares, axis=1) / self.squares.shape[1]) / self.length

    def expected_amplitude(self) -> Array:
        """Return the amplitude without absorber (L,) in m."""
        return math.sqrt(2) * self._scale

    def fill_state(self, values: Array) -> None:
        """Write the first of the scaled features into ``values`` (L, features).

        They describe the state at the end of the interval.
        """
        fill_cycle_features(  # type: ignore[no-untyped-call]
            self.runs.reports,
            self.runs.orders,
            self.runs.state,
            self.level_shapes(),
            self.squares,
            self._units,
            self.ratio,
            self.elapsed,
            values,
        )

    def level_shapes(self) -> Array:
        """Return the mode shapes at the place where the level is measured.

        The result is (1, N_m), or (L, N_m) where the lanes differ.
        """
        return self._shape

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the task's part of the info, arrays (L,) by key."""
        return super().info() | {"rms": self._rms.copy()}


class ActiveFrictionTask(VariableFrictionTask, ActiveTask):
    """Lanes with a friction limit that is set."""

    features: Sequence[Feature] = (*PERIODS_PER_LEVEL, FRICTION_IN_USE)

    def __init__(
        self, settings: TaskSettings, cycle: ActiveSettings, grip: FrictionRange, lanes: int
    ) -> None:
        self.set_limits(settings, grip, lanes)
        super().__init__(settings, cycle, lanes)
        self.described = (cycle, grip)
        self.friction_factor = np.ones(lanes)

    def set_friction_factor(self, lane: int, factor: float) -> None:
        """Multiply the limits that are ordered, see `ActiveTask.set_friction_factor`."""
        self.friction_factor[lane] = factor

    def act(self, actions: Array) -> None:
        """Order the friction limits."""
        self.order_friction(actions)
        if self.friction_error != (0.0, 0.0):
            self.runs.orders["limit"] *= self.friction_factor

    def moved(self) -> Array:
        """Return the way over the range of limits, which is 2 wide."""
        return self.place_moved


ACCELERATION_UNIT = (
    "m/s^2 / (half-clearance times the square of the resonance's circular frequency)"
)
TIP_ACCELERATION = Feature(
    "acceleration of the tip", True, "mean acceleration of the tip", ACCELERATION_UNIT
)
ABSORBER_ACCELERATION = Feature(
    "acceleration of the absorber", True, "mean acceleration of the absorber", ACCELERATION_UNIT
)


class RawSensorsTask(ActiveFrictionTask):
    """Lanes with a friction limit that is set from the signals of two accelerometers.

    A sample of an accelerometer is its mean over the interval.
    """

    features: Sequence[Feature] = (
        TIP_ACCELERATION,
        ABSORBER_ACCELERATION,
        *PERIODS_PER_LEVEL[5:9],  # what the control knows: phase, frequency and time
        FRICTION_IN_USE,
    )

    def __init__(
        self, settings: TaskSettings, cycle: ActiveSettings, grip: FrictionRange, lanes: int
    ) -> None:
        super().__init__(settings, cycle, grip, lanes)
        self._velocities, self._accelerations = (np.zeros((lanes, 2)) for _ in range(2))
        self._per_change = self._units["per_velocity"][0] / (2 * math.pi * self.interval)

    def begin(self, lane: int) -> None:
        """Start at rest, see `Task.begin`."""
        super().begin(lane)
        self._velocities[lane] = self._accelerations[lane] = 0.0

    def reward(self) -> Array:
        """Return the rewards of `ActiveFrictionTask`; take the samples of the interval."""
        state = self.runs.state
        modes = self.scene.model.modes
        velocities = np.zeros((self.lanes, 2))  # of tip and absorber
        for mode in range(modes):
            velocities[:, 0] += self.level_shapes()[:, mode] * state[:, modes + 1 + mode]
        velocities[:, 1] = state[:, -1]
        self._accelerations = (velocities - self._velocities) * self._per_change
        self._velocities = velocities
        return super().reward()

    def fill_state(self, values: Array) -> None:
        """Write samples and what the control knows into ``values`` (L, features)."""
        every = np.empty((self.lanes, len(PERIODS_PER_LEVEL)))
        super().fill_state(every)
        values[:, :2] = self._accelerations
        values[:, 2:6] = every[:, 5:9]


@dataclass(frozen=True)
class WallActuator(GapRange):
    """Arguments of walls that move: those of `GapRange`, speed and lag.

    Parameters
    ----------
    gap_speed : float
        Largest change of the half-clearance in a pseudo period, in m.
    gap_lag : float
        Time constant of the walls in pseudo periods.

    """

    gap_speed: float = 0.3e-3
    gap_lag: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, gap_speed=positive, gap_lag=non_negative)

    def motion(self, interval: float) -> tuple[float, float]:
        """Return the two limits of the walls' motion in an interval (pseudo periods).

        They are the share of the distance to their target that the walls cover because of the lag,
        and their longest displacement in m.
        """
        share = -math.expm1(-interval / self.gap_lag) if self.gap_lag > 0 else 1.0
        return share, self.gap_speed * interval


class MovingWallsTask(VariableGapTask):
    """A task whose walls move towards what is wanted, as ``drive`` lets them."""

    drive: WallActuator

    def set_drive(self, settings: TaskSettings, drive: WallActuator, lanes: int) -> None:
        """Set what moves the walls; raises ParameterError where there are none."""
        require_cavity(settings.scene.absorber)
        self.drive = drive
        self._motion = (*drive.gap_limits, *drive.motion(settings.interval))
        self._before, self._wall_moved = (np.zeros(lanes) for _ in range(2))

    def starting_action(self) -> Array:
        """Return the position of the scene's half-clearance in the range (1,).

        See `Task.starting_action`.
        """
        return np.array([find_log_place(self.length, *self.drive.gap_limits)])

    def act(self, actions: Array) -> None:
        """Order half-clearances that approach the wanted ones.

        ``actions`` (L, A) are numbers from -1 to 1, and the first column sets the walls.
        """
        order_wall_motion(actions, *self._motion, self.runs.orders, self._before)  # type: ignore[no-untyped-call]

    def moved(self) -> Array:
        """Return the walls' way in half-clearances of the scene."""
        measure_wall_motion(self.runs.orders, self._before, self.length, self._wall_moved)  # type: ignore[no-untyped-call]
        return self._wall_moved


class ActiveGapTask(MovingWallsTask, ActiveTask):
    """Lanes with walls that are moved."""

    features: Sequence[Feature] = (*PERIODS_PER_LEVEL, GAP_IN_USE)

    def __init__(
        self, settings: TaskSettings, cycle: ActiveSettings, drive: WallActuator, lanes: int
    ) -> None:
        self.set_drive(settings, drive, lanes)
        self._friction = friction_limit(settings.scene)
        allowed = "0 for an absorber without rigid friction"
        exact = cycle.friction_error == (0.0, 0.0)
        require(
            exact or math.isfinite(self._friction), "friction_error", cycle.friction_error, allowed
        )
        super().__init__(settings, cycle, lanes)
        self.described = (cycle, drive)

    def set_friction_factor(self, lane: int, factor: float) -> None:
        """Multiply the scene's limit, see `ActiveTask.set_friction_factor`."""
        self.runs.orders["limit"][lane] = factor * self._friction
