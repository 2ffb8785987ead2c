"""Control at one frequency: arguments, schedules, rewards, and errors of the machine.

The force changes from time to time while the gap is set every few periods, or it is constant while
friction or walls are set every quarter of a period, from rest.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import non_negative, positive, require, word_of
from impact_env.controlled import friction_limit
from impact_env.envs.actuators import FrictionActuator
from impact_env.envs.observation import ACCELERATIONS, KNOWN_TO_CONTROL, STATE_IN_PERIOD, Feature
from impact_env.envs.reference import stationary_amplitude
from impact_env.envs.settings import Range, check_pair, check_range
from impact_env.envs.task import (
    Actuator,
    Advance,
    Array,
    ForceSchedule,
    Generator,
    LaneState,
    MachineDifference,
    Reward,
    StateColumns,
)
from impact_env.fields import check_fields
from impact_env.frequency import receptance
from impact_env.kernels.control.episodes import (
    compute_cycle_rewards,
    fill_cycle_features,
)
from impact_env.level import require_samples
from impact_env.scene import Scene

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

    @property
    def damage_exponent(self) -> float:
        """The exponent of the damage, 0 if the RMS is rated."""
        return self.fatigue_exponent if self.objective == "fatigue" else 0.0


class ChangingForceSchedule(ForceSchedule):
    """A force that changes from time to time, at one frequency.

    ``forces`` (L, steps) are those of all intervals of an episode in N.
    """

    def __init__(self, lanes: LaneState, control: GapControl) -> None:
        super().__init__(lanes)
        self.control = control
        self._ratios = check_range("frequency_ratio", control.frequency_ratio)
        require_samples(lanes.settings.samples_per_period, self._ratios[1])
        self.steps = max(1, math.ceil(control.time_budget / lanes.interval - 1e-9))
        self.forces = np.zeros((lanes.count, self.steps))
        self._rows = np.arange(lanes.count)

    def start(self, lane: int, generator: Generator) -> None:
        """Draw the frequency."""
        low, high = self._ratios
        self.lanes.ratio[lane] = low if low == high else generator.uniform(low, high)

    def start_force(self, lane: int, generator: Generator) -> None:
        """Draw the forces of an episode, and how long each lasts."""
        shortest, longest = self.control.hold
        done = 0
        while done < self.steps:
            held = max(1, round(generator.uniform(shortest, longest) / self.lanes.interval))
            self.forces[lane, done : done + held] = self.lanes.draw_force(lane, generator)
            done += held
        self.lanes.force[lane] = self.forces[lane, 0]

    def advance(self) -> Advance:
        """Set the force of the interval, and stay at the frequency."""
        lanes = self.lanes
        lanes.force = self.forces[self._rows, np.minimum(lanes.elapsed, self.steps - 1)]
        never = np.zeros(lanes.count, dtype=np.bool_)
        return np.full(lanes.count, lanes.interval), lanes.ratio.copy(), never


class ResponseReward(Reward):
    """Minus the interval's share of the mean relative response (RMS or damage).

    The response is relative to the stationary one without absorber under the interval's force.

    Of ``costs`` the level is minus the reward, and impacts are those a pseudo period.
    """

    cost_names = ("level", "time", "actuator", "impacts")
    level_name = "RMS over the scene's half-clearance"

    def __init__(self, schedule: ChangingForceSchedule, actuator: Actuator) -> None:
        super().__init__(schedule.lanes)
        self.schedule = schedule
        self.control = schedule.control
        self.actuator = actuator
        self.is_fatigue = self.control.objective == "fatigue"
        self._scale = np.ones_like(schedule.forces)
        self._rows = np.arange(self.lanes.count)

    def start(self, lane: int, generator: Generator) -> None:
        """Set the stationary responses to a lane's forces, see `Reward.start`."""
        super().start(lane, generator)
        lanes = self.lanes
        model = lanes.settings.scene.model
        omega = lanes.ratio[lane] * lanes.omega
        amplitude = float(abs(receptance(model, omega, model.level_shape, model.force_shape)))
        largest = amplitude * self.schedule.forces[lane]
        if self.is_fatigue:
            exponent = self.control.fatigue_exponent
            # the mean of |cos|^exponent over a period
            mean = math.gamma((exponent + 1) / 2)
            mean /= math.sqrt(math.pi) * math.gamma(exponent / 2 + 1)
            self._scale[lane] = [
                (one / lanes.length) ** exponent * mean for one in largest.tolist()
            ]
        else:
            self._scale[lane] = largest / math.sqrt(2)

    def compute(self) -> Array:
        """Return the rewards (L,) of the last interval."""
        lanes = self.lanes
        reports = lanes.runs.reports
        scale = self._scale[self._rows, lanes.elapsed - 1] * self.schedule.steps
        samples = lanes.interval * lanes.settings.samples_per_period
        rewards: Array = (
            -(reports["damage"] / samples) / scale
            if self.is_fatigue
            else -np.sqrt(reports["mean_square"]) / scale
        )
        self.costs[:, 0] = -rewards
        self.costs[:, 1] = 1 / self.schedule.steps
        self.costs[:, 2] = self.actuator.compute_displacement()
        self.costs[:, 3] = reports["impact_count"] / lanes.interval
        return rewards

    def level(self) -> Array:
        """Return the RMS of the last interval (L,) in half-clearances of the scene."""
        return np.sqrt(self.lanes.runs.reports["mean_square"]) / self.lanes.length

    def expected_amplitude(self) -> Array:
        """Return twice the largest half-clearance for all lanes (L,) in m."""
        return np.full(self.lanes.count, 2 * self.control.gap_limits[1])

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the RMS of the last interval in m."""
        return {"rms": np.sqrt(self.lanes.runs.reports["mean_square"])}


PLANTS = 16  # dampings that episodes draw from


def _check_error(name: str, value: Any) -> Range:
    """Return a relative error as a pair (low, high), above -1."""
    low, high = check_range(name, value)
    allowed = "above -1, as a share of what the scene has: a number, or a pair (low, high)"
    require(low > -1, name, value, allowed)
    return low, high


def vary_damping(scenes: Sequence[Scene], error: float | Range) -> list[Scene]:
    """Return scenes with changed damping ratios, by the same factor for all modes of a scene.

    Several scenes are returned once each. A single scene is returned in `PLANTS` variants.

    ``error``: range of the relative change; its values are spread evenly.
    """
    low, high = check_range("damping_error", error)
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


class SteadySchedule(ForceSchedule):
    """One force and one frequency in an episode.

    ``force_scale`` (scenes,) multiplies the force of the lanes in each scene.
    """

    def __init__(
        self, lanes: LaneState, cycle: ActiveSettings, force_scale: Sequence[float] = ()
    ) -> None:
        super().__init__(lanes)
        low, high = check_range("frequency_ratio", cycle.frequency_ratio)
        require_samples(lanes.settings.samples_per_period, high)
        self._ratios = (low, high)
        self._force_scale = tuple(force_scale)
        self.steps = max(1, math.ceil(cycle.time_budget / lanes.interval - 1e-9))
        self.options = {"frequency_ratio": (low, high)}
        self._duration = np.full(lanes.count, float(lanes.interval))

    def start(self, lane: int, generator: Generator) -> None:
        """Draw the frequency."""
        low, high = self._ratios
        drawn = low if low == high else generator.uniform(low, high)
        self.lanes.ratio[lane] = self.lanes.apply_choice(drawn, "frequency_ratio", lane)

    def start_force(self, lane: int, generator: Generator) -> None:
        """Draw the force, in units of the lane's scene."""
        super().start_force(lane, generator)
        if self._force_scale:
            self.lanes.force[lane] *= self._force_scale[self.lanes.which[lane]]

    def advance(self) -> Advance:
        """Stay at the frequency."""
        return self._duration, self.lanes.ratio, np.zeros(self.lanes.count, dtype=np.bool_)


class MachineErrors(MachineDifference):
    """Errors of damping and friction; each episode draws them from their ranges.

    ``friction_factor`` (L,) is the friction limit of the machine over that of the control.
    """

    def __init__(
        self,
        lanes: LaneState,
        cycle: ActiveSettings,
        friction: FrictionActuator | None = None,
        *,
        draws_damping: bool,
    ) -> None:
        """Set the ranges of errors.

        ``friction`` is the actuator that sets the friction limit, None if it is the scene's.
        ``draws_damping``: whether episodes draw one of the scenes, which differ in damping.
        """
        super().__init__(lanes)
        self._friction_error = check_range("friction_error", cycle.friction_error)
        self._draws_damping = draws_damping
        self._friction = friction
        self._nominal_limit = friction_limit(lanes.settings.scene)
        self.friction_factor = np.ones(lanes.count)

    def start(self, lane: int, generator: Generator) -> None:
        """Draw damping and friction."""
        lanes = self.lanes
        if self._draws_damping:
            lanes.which[lane] = generator.integers(len(lanes.scenes))
        low, high = self._friction_error
        if low != 0 or high != 0:
            error = low if low == high else float(generator.uniform(low, high))
            self.friction_factor[lane] = 1 + error

    def apply(self) -> None:
        """Multiply the friction limits that the control assumes."""
        if self._friction_error != (0.0, 0.0):
            limits = self._nominal_limit if self._friction is None else self._friction.friction
            self.lanes.runs.orders["limit"] = limits * self.friction_factor


class PeriodReward(Reward):
    """Minus the interval's share of the mean relative RMS, less a price of the actuator's motion.

    The RMS is relative to the stationary one without absorber, with the true damping.

    Of ``costs`` the level is the RMS over the stationary RMS without absorber, over the number of
    intervals; the contact force is the mean force of wall and friction on the absorber, from its
    momentum, over the amplitude of the force. ``squares`` (L, n) are the mean squares of the
    intervals of the last period in m^2.
    """

    cost_names = ("level", "time", "fatigue", "actuator", "contact force")
    level_name = "RMS of a period over the scene's half-clearance"

    def __init__(self, schedule: SteadySchedule, actuator: Actuator, price: float) -> None:
        super().__init__(schedule.lanes)
        lanes = self.lanes
        self.schedule = schedule
        self.actuator = actuator
        self.price = price
        self.squares = np.zeros((lanes.count, max(1, round(1 / lanes.interval))))
        self._scale = np.ones(lanes.count)  # stationary RMS without absorber in m
        self._speed = np.zeros(lanes.count)  # of the absorber in m/s
        self._rms = np.zeros(lanes.count)  # of the last interval in m
        mass = lanes.settings.scene.absorber_mass
        assert mass is not None  # what is set is an absorber's
        self._mass_rate = mass / (lanes.interval * lanes.period)

    def start(self, lane: int, generator: Generator) -> None:
        """Set the stationary response to a lane's force, see `Reward.start`."""
        super().start(lane, generator)
        lanes = self.lanes
        self.squares[lane] = self._speed[lane] = self._rms[lane] = 0.0
        amplitude = stationary_amplitude(
            lanes.model(lane), lanes.ratio[lane] * lanes.omega, lanes.settings.moves_base
        )
        self._scale[lane] = amplitude * lanes.force[lane] / math.sqrt(2)

    def compute(self) -> Array:
        """Return the rewards (L,) of the last interval."""
        lanes = self.lanes
        displacement = self.actuator.compute_displacement()
        self.fill_costs(displacement, self.schedule.steps)
        rewards = np.empty(lanes.count)
        compute_cycle_rewards(  # type: ignore[no-untyped-call]
            lanes.runs.reports,
            lanes.runs.state,
            self.schedule.steps,
            self.price,
            self._mass_rate,
            lanes.force,
            self._scale,
            displacement,
            self.squares,
            self._speed,
            self._rms,
            self.costs,
            rewards,
        )
        return rewards

    def level(self) -> Array:
        """Return the RMS of the last period (L,) in half-clearances of the scene."""
        mean = np.add.reduce(self.squares, axis=1) / self.squares.shape[1]
        return np.sqrt(mean) / self.lanes.length

    def expected_amplitude(self) -> Array:
        """Return the amplitude without absorber (L,) in m."""
        return math.sqrt(2) * self._scale

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the RMS of the last interval in m."""
        return {"rms": self._rms.copy()}


class PeriodColumns(StateColumns):
    """The features `STATE_IN_PERIOD`, of the state at the end of the interval."""

    features: Sequence[Feature] = STATE_IN_PERIOD
    reward: PeriodReward

    def fill(self, values: Array) -> None:
        """Write the scaled features into the first columns of ``values`` (L, features)."""
        lanes = self.lanes
        fill_cycle_features(  # type: ignore[no-untyped-call]
            lanes.runs.reports,
            lanes.runs.orders,
            lanes.runs.state,
            lanes.level_shapes(),
            self.reward.squares,
            self.units,
            lanes.ratio,
            lanes.elapsed,
            values,
        )


class AccelerometerColumns(PeriodColumns):
    """Signals of two accelerometers, and the features that the control knows.

    A sample of an accelerometer is its mean over the interval.
    """

    features = (*ACCELERATIONS, *KNOWN_TO_CONTROL)

    def __init__(self, lanes: LaneState, schedule: ForceSchedule, reward: Reward) -> None:
        super().__init__(lanes, schedule, reward)
        self._velocities = np.zeros((lanes.count, 2))  # of tip and absorber in m/s
        self._accelerations = np.zeros((lanes.count, 2))  # scaled
        self._per_change = self.units["per_velocity"][0] / (2 * math.pi * lanes.interval)

    def start(self, lane: int) -> None:
        """Start at rest."""
        self._velocities[lane] = self._accelerations[lane] = 0.0

    def measure(self) -> None:
        """Take the samples of the last interval."""
        lanes = self.lanes
        state = lanes.runs.state
        modes = lanes.settings.scene.model.modes
        velocities = np.zeros((lanes.count, 2))
        for mode in range(modes):
            velocities[:, 0] += lanes.level_shapes()[:, mode] * state[:, modes + 1 + mode]
        velocities[:, 1] = state[:, -1]
        self._accelerations = (velocities - self._velocities) * self._per_change
        self._velocities = velocities

    def fill(self, values: Array) -> None:
        """Write the scaled features into the first columns of ``values`` (L, features)."""
        every = np.empty((self.lanes.count, len(STATE_IN_PERIOD)))
        super().fill(every)
        values[:, :2] = self._accelerations
        values[:, 2:6] = every[:, 5:9]
