"""A control task over many lanes at once, shared by single and vector environments.

A task is composed of parts: a schedule of the force, actuators, a reward, and the columns of its
observation. This module has the composed `Task`, the bases of its parts, and the state that all
parts share. The parts of the registered environments are in `passages` and `one_frequency`
(schedules and rewards) and in `actuators`.

Each lane behaves as a single environment.

Only arithmetic that gives the same digits for one number and for an array is done on arrays over
lanes; anything else (powers, roots of several terms, draws) is done lane by lane or in a kernel.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.controlled import ControlledRuns, PooledRuns
from impact_env.envs.observation import STATE, Feature
from impact_env.envs.settings import FORCE_BOUNDS, Range, TaskSettings
from impact_env.envs.signals import ActionDelay, Sensors
from impact_env.kernels.control.episodes import (
    FEATURE_UNITS,
    close_step,
    fill_costs,
    fill_features,
    fill_orders,
)
from impact_env.modes import ModalModel
from impact_env.scene import Scene

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Generator = np.random.Generator
Advance = tuple[Array, Array, Mask]  # duration, frequency ratio, end of the episode
IMPACTS_SCALE = 2.0  # per pseudo period: the two that the paper finds in the favourable regime
FREQUENCY_SCALE = 0.1


class LaneArrays:
    """An object whose attributes that are arrays belong to lanes, and can be saved and copied."""

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of all arrays by name, for `restore`."""
        return {
            name: values.copy()
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray)
        }

    def restore(self, snapshot: Mapping[str, NDArray[Any]]) -> None:
        """Set all arrays to those of a snapshot."""
        for name, values in snapshot.items():
            setattr(self, name, values.copy())

    def copy_arrays(self, source: Self, lanes: int, times: int) -> None:
        """Copy the arrays of another object with ``lanes`` lanes, each lane ``times`` times."""
        for name, values in vars(source).items():
            if not isinstance(values, np.ndarray) or values.shape[:1] != (lanes,):
                continue
            if getattr(self, name).shape[:1] == (lanes * times,):  # else it has no row for a lane
                setattr(self, name, np.repeat(values, times, axis=0))


class LaneState(LaneArrays):
    """The state of all lanes: their runs in the simulator, and the numbers of their episodes.

    ``count`` is the number of lanes L. ``force`` (N), frequency ``ratio``, ``time`` (pseudo
    periods), ``score`` and ``elapsed`` intervals are those at the end of the last interval;
    ``duration`` (pseudo periods) is its length, and ``late`` says whether the time budget is spent,
    (L,) each. ``runs`` has the orders to the simulator and its reports.

    Parameters
    ----------
    settings : TaskSettings
        Arguments that all environments have.
    count : int
        Number of lanes.
    exponent : float
        Exponent of the damage in the reports, 0 for none.
    scenes : sequence of Scene or None
        Scenes of the lanes, by default the scene of the settings alone.
    scene_option : str
        Name of the random choice of a scene in options and info. Without a name all lanes begin in
        the first scene.
    """

    def __init__(
        self,
        settings: TaskSettings,
        count: int,
        exponent: float = 0.0,
        scenes: Sequence[Scene] | None = None,
        scene_option: str = "",
    ) -> None:
        self.settings = settings
        self.count = count
        self.scenes = (settings.scene,) if scenes is None else tuple(scenes)
        self.scene_option = scene_option
        self.options: dict[str, Range] = (
            {scene_option: (0, len(self.scenes) - 1)} if scene_option else {}
        )
        self.omega = settings.omega
        self.length = settings.length
        self.interval = settings.interval
        self.period = 2 * np.pi / self.omega  # s
        self.record = settings.record
        is_pool = len(self.scenes) > 1
        pool: Any = self.scenes if is_pool else self.scenes[0]
        self.runs: ControlledRuns = (PooledRuns if is_pool else ControlledRuns)(
            pool,
            lanes=count,
            reference=self.omega,
            interval=self.interval,
            method=settings.integrator,
            samples_per_period=settings.samples_per_period,
            exponent=exponent,
            unit=self.length,
            threads=settings.threads,
            record=self.record,
            moves_base=settings.moves_base,
        )
        self.force, self.ratio, self.time, self.score, self.duration = (
            np.zeros(count) for _ in range(5)
        )
        self.elapsed = np.zeros(count, dtype=np.int64)
        self.late = np.zeros(count, dtype=np.bool_)
        self._force_range = settings.forces
        self._chosen: Mapping[str, Array] = {}
        shapes = np.array([scene.model.level_shape for scene in self.scenes])
        self._level_shapes = shapes[:1] if (shapes == shapes[0]).all() else shapes

    @property
    def which(self) -> NDArray[np.int64]:
        """The lanes' scenes (L,), by their numbers; changed in place if there are several."""
        if isinstance(self.runs, PooledRuns):
            return self.runs.which
        return np.zeros(self.count, dtype=np.int64)

    def model(self, lane: int) -> ModalModel:
        """Return a lane's structure."""
        return self.scenes[self.which[lane]].model

    def level_shapes(self) -> Array:
        """Return the mode shapes at the place where the level is measured.

        The result is (1, N_m), or (L, N_m) where the lanes differ.
        """
        shapes = self._level_shapes
        return shapes if len(shapes) == 1 else np.asarray(shapes[self.which])

    def set_choices(self, chosen: Mapping[str, Any], options: Mapping[str, Range]) -> None:
        """Set what the next episodes have in place of random values.

        Each value is a number, or one for each lane, in the range of its name in ``options``.
        """
        checked = {}
        for name, value in chosen.items():
            low, high = options[name]
            try:
                values = np.broadcast_to(np.asarray(value, dtype=np.float64), self.count)
            except (TypeError, ValueError):
                values = np.full(self.count, np.nan)
            whole = isinstance(low, int)  # of a structure or a scene
            inside = bool(((values >= low) & (values <= high)).all())
            kind = "whole number" if whole else "number"
            require(
                inside and not (whole and np.any(values % 1)),
                f"options[{name!r}]",
                value,
                f"a {kind} from {low:g} to {high:g}, or one for each of {self.count} lanes",
            )
            checked[name] = values
        self._chosen = checked

    def apply_choice(self, drawn: float, name: str, lane: int) -> float:
        """Return the value that a reset chose for a lane under this name, else the drawn one."""
        return float(self._chosen[name][lane]) if name in self._chosen else drawn

    def start(self, lane: int, generator: Generator) -> None:
        """Set a lane's time and score to zero, and draw its scene."""
        for values in (self.time, self.score, self.elapsed):
            values[lane] = 0
        if self.scene_option:
            number = float(generator.integers(len(self.scenes)))
            self.which[lane] = int(self.apply_choice(number, self.scene_option, lane))

    def draw_force(self, lane: int, generator: Generator) -> float:
        """Return an episode's force in N."""
        low, high = self._force_range
        drawn = low if low == high else float(generator.uniform(low, high))
        return self.apply_choice(drawn, "force", lane)

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the entries of info that all tasks have, new arrays (L,)."""
        info: dict[str, NDArray[Any]] = {
            "time": self.time.copy(),
            "frequency_ratio": self.ratio.copy(),
            "force": self.force.copy(),
            "score": self.score.copy(),
            "impacts": self.runs.reports["impact_count"].copy(),
        }
        if self.settings.raw_state:
            info["state"] = self.runs.state.copy()
        if self.scene_option:
            info[self.scene_option] = self.which.copy()
        return info


class TaskPart(LaneArrays):
    """A part of a task, which reads and changes the state of the ``lanes``.

    ``columns`` has the functions that return the part's columns (L,) of observations, by the names
    of their features. An attribute that is an array belongs to this part alone.
    """

    def __init__(self, lanes: LaneState) -> None:
        self.lanes = lanes
        self.columns: dict[str, Callable[[], Array]] = {}

    def start(self, lane: int, generator: Generator) -> None:
        """Start an episode in a lane: draw the part's random values, and set all others."""

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the part's entries of info, new arrays (L,) by name."""
        return {}


class ForceSchedule(TaskPart, ABC):
    """How force and frequency run, and when an episode ends.

    ``steps`` is the number of intervals in the time budget; an episode that has spent it is cut
    off, or ended where ``budget_terminates``. ``options`` are the ranges of the random values that
    a reset may choose. ``frequency_origin`` and ``frequency_unit`` are zero and unit of the
    observed frequency.
    """

    steps: int
    budget_terminates = False
    frequency_origin = 1.0
    frequency_unit = FREQUENCY_SCALE
    options: Mapping[str, Range] = {}

    def start_force(self, lane: int, generator: Generator) -> None:
        """Draw an episode's force."""
        self.lanes.force[lane] = self.lanes.draw_force(lane, generator)

    @abstractmethod
    def advance(self) -> Advance:
        """Return duration, frequency ratio and end (L,) of the next interval.

        They are the duration in pseudo periods, the frequency ratio at the interval's end, and
        whether the episode ends with it (a new array).
        """


class Actuator(TaskPart, ABC):
    """A quantity that a column of the actions sets, in each interval."""

    @abstractmethod
    def starting_action(self) -> float:
        """Return the action that leaves the actuator in its state at the episode's start."""

    @abstractmethod
    def apply(self, actions: Array, column: int) -> None:
        """Order the next interval by a column of the actions (L, A), from -1 to 1."""

    def compute_displacement(self) -> Array:
        """Return how far the actuator moved in the last interval (L,), in the unit of its price."""
        return np.zeros(self.lanes.count)


class MachineDifference(TaskPart):
    """What is different in the machine from what the control assumes."""

    def apply(self) -> None:
        """Change the orders of the actuators to those that the machine carries out."""


class Reward(TaskPart, ABC):
    """Reward and costs of each interval, and the level that observations have.

    ``costs`` (L, costs) are those of the last interval, by ``cost_names``, with ``least_cost`` for
    all or each of them. ``level_name`` says what `level` is.
    """

    level_name: str
    cost_names: Sequence[str] = ()
    least_cost: float | Array = 0.0

    def __init__(self, lanes: LaneState) -> None:
        super().__init__(lanes)
        self.costs = np.zeros((lanes.count, len(self.cost_names)))

    def start(self, lane: int, generator: Generator) -> None:  # noqa: ARG002 - nothing is drawn
        """Set a lane's costs to zero, and its reference to that of the drawn episode."""
        self.costs[lane] = 0.0

    def fill_costs(self, displacement: Array, steps: int) -> None:
        """Fill the costs of the last interval.

        ``displacement`` (L,) is the actuator's. ``steps`` is the number of intervals in the time
        budget.
        """
        lanes = self.lanes
        fill_costs(  # type: ignore[no-untyped-call]
            lanes.runs.reports,
            displacement,
            lanes.duration,
            float(lanes.interval),
            steps,
            lanes.interval * lanes.settings.samples_per_period,
            self.costs,
        )

    @abstractmethod
    def compute(self) -> Array:
        """Return the rewards (L,) of the last interval, a new array, and fill its costs."""

    @abstractmethod
    def level(self) -> Array:
        """Return the level (L,) as observations have it."""

    @abstractmethod
    def expected_amplitude(self) -> Array:
        """Return the tip's amplitude (L,) in m for which a picture has space."""


class StateColumns(LaneArrays):
    """The first columns of observations, which compiled code fills.

    These are the features `STATE`: amplitudes over the last interval.
    """

    features: Sequence[Feature] = STATE

    def __init__(self, lanes: LaneState, schedule: ForceSchedule, reward: Reward) -> None:
        self.lanes = lanes
        self.reward = reward
        self.units = np.zeros(1, FEATURE_UNITS)
        self.units[0] = (
            lanes.length,
            1 / (lanes.omega * lanes.length),
            lanes.interval * IMPACTS_SCALE,
            lanes.settings.impacts_limit,
            schedule.frequency_origin,
            float(schedule.frequency_unit),
            schedule.steps,
        )

    def start(self, lane: int) -> None:
        """Forget what was measured in a lane's last episode."""

    def measure(self) -> None:
        """Take the samples of the last interval."""

    def fill(self, values: Array) -> None:
        """Write the scaled features into the first columns of ``values`` (L, features)."""
        lanes = self.lanes
        fill_features(  # type: ignore[no-untyped-call]
            lanes.runs.reports, self.units, lanes.ratio, lanes.elapsed, self.reward.level(), values
        )


class Task:
    """Lanes of one task, composed of its parts.

    ``reset`` starts episodes and ``step`` advances all lanes by one control interval. Shapes are
    those of a vector environment. The parts' functions are called in this order:

    - reset, in each lane: `LaneState.start` (scene), `ForceSchedule.start` (frequency),
      `Actuator.start` of each actuator, `ForceSchedule.start_force`; then the task draws the phase
      of the force; `MachineDifference.start`, drawn late, so that the same seed has the same
      episode without differences; `Reward.start` (reference), `StateColumns.start`.
    - step: `Actuator.apply` of each actuator with its column of the actions,
      `MachineDifference.apply`, `ForceSchedule.advance`; then the simulator advances the lanes;
      `StateColumns.measure`, `Reward.compute`.
    - observation, after both: `StateColumns.fill`, then the ``columns`` of the other parts; noise,
      drift and delay of the sensors come last.

    Parameters
    ----------
    lanes : LaneState
        State that all parts share.
    schedule : ForceSchedule
        How the force runs, and when an episode ends.
    reward : Reward
        Reward and costs.
    actuators : sequence of Actuator
        Actuators, one for each number of an action.
    columns : sequence of Feature
        Columns of observations. The first are those of ``state``, the others are found by name
        among the columns of the parts.
    state : type of StateColumns
        First columns.
    machine : sequence of MachineDifference
        Differences between the machine and what the control assumes.
    arguments : sequence
        Dataclasses of the task's own arguments.
    """

    def __init__(
        self,
        lanes: LaneState,
        schedule: ForceSchedule,
        reward: Reward,
        *,
        columns: Sequence[Feature],
        actuators: Sequence[Actuator] = (),
        state: type[StateColumns] = StateColumns,
        machine: Sequence[MachineDifference] = (),
        arguments: Sequence[Any] = (),
    ) -> None:
        settings = lanes.settings
        self.lanes = lanes
        self.schedule = schedule
        self.reward = reward
        self.actuators = tuple(actuators)
        self.machine = tuple(machine)
        self.settings = settings
        self.interval = lanes.interval
        self.runs = lanes.runs
        self.arguments = tuple(arguments)
        self.options = {"force": FORCE_BOUNDS, **schedule.options, **lanes.options}
        # intervals after which an episode is cut off, as by gymnasium's TimeLimit; None: never
        self.limit: int | None = None
        self.features = tuple(columns)
        self.state_columns = state(lanes, schedule, reward)
        self.parts: tuple[TaskPart, ...] = (schedule, *self.actuators, *self.machine, reward)
        named = {name: read for part in self.parts for name, read in part.columns.items()}
        first = len(self.state_columns.features)
        self._further_columns = [
            (k, named[feature.name]) for k, feature in enumerate(self.features[first:], first)
        ]
        self.sensors = Sensors(
            self.features,
            lanes.count,
            settings.observation_noise,
            settings.observation_delay,
            settings.observation_drift,
        )
        self.action_delay = ActionDelay(
            lanes.count,
            settings.action_delay,
            settings.action_levels or 0,
            self.starting_action(),
        )
        self._no_lane = np.zeros(lanes.count, dtype=np.bool_)

    def starting_action(self) -> Array:
        """Return the action (A,) that leaves the actuators in their state at the start."""
        return np.array([actuator.starting_action() for actuator in self.actuators])

    def reset(
        self,
        which: Mask,
        generators: Sequence[Generator],
        chosen: Mapping[str, Any] | None = None,
    ) -> NDArray[np.float32]:
        """Start episodes in the lanes of a mask and return observations (L, features).

        Only the observations of these lanes are new.

        ``chosen`` takes the place of what is drawn: of each name in `options` one number, or one
        for each lane.
        """
        lanes = self.lanes
        lanes.set_choices(chosen or {}, self.options)
        for lane in np.flatnonzero(which).tolist():
            self._start(lane, generators[lane])
        self.runs.restart(which)
        self.action_delay.restart(which)
        return self.sensors.see(self._compute_features(), generators, which)

    def _start(self, lane: int, generator: Generator) -> None:
        """Start an episode in a lane: draw all random values, in a fixed order."""
        self.lanes.start(lane, generator)
        self.schedule.start(lane, generator)
        for actuator in self.actuators:
            actuator.start(lane, generator)
        self.schedule.start_force(lane, generator)
        orders = self.runs.orders
        orders["phase"][lane] = generator.uniform(0, 2 * np.pi)
        record = self.lanes.record
        if record is not None:
            orders["place"][lane] = generator.integers(len(record.values) - 1)
        for difference in self.machine:
            difference.start(lane, generator)
        self.reward.start(lane, generator)
        self.state_columns.start(lane)

    def step(self, actions: NDArray[Any], resting: Mask | None = None) -> tuple[Array, Mask, Mask]:
        """Advance all lanes by one control interval.

        The results are rewards (L,), whether episodes ended (L,), and whether they were cut off
        (L,).

        Lanes of the mask ``resting`` (L,) stay where they are; their reward is 0, and their other
        values hold only after a `reset`.
        """
        lanes = self.lanes
        schedule = self.schedule
        if self.actuators:
            self._apply(np.asarray(actions, dtype=np.float64))
        duration, ratio, terminated = schedule.advance()
        rests = self._no_lane if resting is None else resting
        if resting is not None:
            self.runs.idle = resting
        fill_orders(  # type: ignore[no-untyped-call]
            self.runs.orders,
            lanes.omega,
            lanes.period,
            schedule.steps,
            duration,
            lanes.ratio,
            ratio,
            lanes.force,
            terminated,
            rests,
            lanes.elapsed,
            lanes.late,
        )
        self.runs.advance()
        lanes.ratio = ratio
        lanes.duration = duration
        self.state_columns.measure()
        rewards = self.reward.compute()
        truncated = np.empty(lanes.count, dtype=np.bool_)
        close_step(  # type: ignore[no-untyped-call]
            duration,
            lanes.elapsed,
            self.limit or 0,
            schedule.budget_terminates,
            rests,
            lanes.late,
            lanes.time,
            lanes.score,
            rewards,
            terminated,
            truncated,
        )
        if resting is not None:
            self.runs.idle = np.zeros_like(resting)
        return rewards, terminated, truncated

    def _apply(self, actions: Array) -> None:
        """Order the next interval by the actions (L, A), as the machine carries them out."""
        if not self.action_delay.is_ideal:
            actions = self.action_delay.apply(actions)
        for column, actuator in enumerate(self.actuators):
            actuator.apply(actions, column)
        for difference in self.machine:
            difference.apply()

    def observe(
        self, generators: Sequence[Generator], resting: Mask | None = None
    ) -> NDArray[np.float32]:
        """Return the observations (L, features) after a step."""
        return self.sensors.see(self._compute_features(), generators, None, resting)

    def _compute_features(self) -> Array:
        """Return the scaled features (L, features) without errors of the sensors."""
        values = np.empty((self.lanes.count, len(self.features)))
        self.state_columns.fill(values)
        for k, read_column in self._further_columns:
            values[:, k] = read_column()
        return values

    def info(self) -> dict[str, NDArray[Any]]:
        """Return Gymnasium's info of the lanes by key, new arrays (L,)."""
        info = self.lanes.info()
        if self.reward.cost_names:
            info["costs"] = self.reward.costs.copy()
        for part in self.parts:
            info.update(part.info())
        return info

    def copy_from(self, source: "Task", times: int = 1) -> None:
        """Continue from the episodes of another task with the same settings.

        Each episode of ``source`` is copied to ``times`` lanes in succession.

        The delayed observations and actions are copied, too. Raises ParameterError unless this task
        has ``times`` as many lanes as ``source``.
        """
        self.runs.copy_from(source.runs, times)
        self.action_delay.copy_from(source.action_delay, times)
        self.sensors.copy_from(source.sensors, times)
        for own, other in zip(self._arrays(), source._arrays(), strict=True):
            own.copy_arrays(other, source.lanes.count, times)

    def snapshot(self) -> dict[str, Any]:
        """Return copies of all that the next steps depend on, but for the random generators."""
        return {
            "arrays": [part.snapshot() for part in self._arrays()],
            "runs": self.runs.snapshot(),
            "sensors": self.sensors.snapshot(),
            "actions": self.action_delay.snapshot(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot of a task that was made with the same arguments."""
        for part, arrays in zip(self._arrays(), snapshot["arrays"], strict=True):
            part.restore(arrays)
        self.runs.restore(snapshot["runs"])
        self.sensors.restore(snapshot["sensors"])
        self.action_delay.restore(snapshot["actions"])

    def _arrays(self) -> tuple[LaneArrays, ...]:
        return (self.lanes, *self.parts, self.state_columns)

    def describe(self) -> dict[str, Any]:
        """Return the environment's arguments as plain values, including defaults.

        ``threads`` is left out, as it changes no result.
        """
        own = {name: value for group in self.arguments for name, value in asdict(group).items()}
        return self.settings.describe() | own

    def close(self) -> None:
        """End the threads."""
        self.runs.close()
