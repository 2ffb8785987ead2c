"""A control task over many lanes at once, shared by single and vector environments.

Each lane behaves as a single environment.

Only arithmetic that gives the same digits for one number and for an array is done on arrays over
lanes; anything else (powers, roots of several terms, draws) is done lane by lane or in a kernel.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.controlled import ControlledRuns, PooledRuns
from impact_env.envs.actuator import Actuator
from impact_env.envs.observation import Feature, Sensors
from impact_env.envs.settings import FORCE_BOUNDS, Range, TaskSettings
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
IMPACTS_SCALE = 2.0  # per pseudo period: the two that the paper finds in the favourable regime
FREQUENCY_SCALE = 0.1


class Task(ABC):
    """Lanes of one task.

    ``reset`` starts episodes and ``step`` advances all lanes by one control interval. Shapes are
    those of a vector environment.
    """

    features: Sequence[Feature]
    level_name: str

    options: Mapping[str, Range] = {"force": FORCE_BOUNDS}
    cost_names: Sequence[str] = ()
    least_cost: float | Array = 0.0  # (costs,), or of all
    described: tuple[Any, ...] = ()  # further groups of arguments, dataclasses
    budget_terminates = False
    frequency_origin = 1.0
    frequency_unit = FREQUENCY_SCALE

    def __init__(
        self, settings: TaskSettings, lanes: int, steps: int, exponent: float = 0.0
    ) -> None:
        """``steps``: control intervals of the time budget; ``exponent`` of the damage, 0 for none.

        An episode that has spent its budget is cut off, or ended where ``budget_terminates``. What
        is set in ``limit`` cuts it off after that number of intervals, as gymnasium's TimeLimit
        does from outside: the task knows nothing of it.
        """
        self.settings = settings
        self.lanes = lanes
        self.steps = steps
        self.scene = settings.scene
        self.limit: int | None = None
        self.omega = settings.omega
        self.length = settings.length
        self.interval = settings.interval
        self._record = settings.record
        self.runs = self.make_runs(
            lanes=lanes,
            reference=self.omega,
            interval=self.interval,
            method=settings.integrator,
            samples_per_period=settings.samples_per_period,
            exponent=exponent,
            unit=self.length,
            threads=settings.threads,
            record=self._record,
            moves_base=settings.moves_base,
        )
        self._chosen: dict[str, Any] = {}
        self._force_range = settings.forces
        self.force, self.ratio, self.time, self.score = (np.zeros(lanes) for _ in range(4))
        self.elapsed = np.zeros(lanes, dtype=np.int64)
        self.duration = np.zeros(lanes)
        self.late, self._never = (np.zeros(lanes, dtype=np.bool_) for _ in range(2))
        self.costs = np.zeros((lanes, len(self.cost_names)))
        self.sensors = Sensors(
            self.features,
            lanes,
            settings.observation_noise,
            settings.observation_delay,
            settings.observation_drift,
        )
        self.actuator = Actuator(
            lanes, settings.action_delay, settings.action_levels or 0, self.starting_action()
        )
        impacts = self.interval * IMPACTS_SCALE
        unit = float(self.frequency_unit)
        self._units = np.zeros(1, FEATURE_UNITS)
        self._units[0] = (
            self.length,
            1 / (self.omega * self.length),
            impacts,
            settings.impacts_limit,
            self.frequency_origin,
            unit,
            steps,
        )
        self._period = 2 * np.pi / self.omega

    def copy_from(self, source: "Task", times: int = 1) -> None:
        """Continue from the episodes of another task with the same settings.

        Each episode of ``source`` is copied to ``times`` lanes in succession.

        The delayed observations and actions are copied, too. Raises ParameterError unless this task
        has ``times`` as many lanes as ``source``.
        """
        self.runs.copy_from(source.runs, times)
        self.actuator.copy_from(source.actuator, times)
        self.sensors.copy_from(source.sensors, times)
        for name, values in vars(source).items():
            if (
                isinstance(values, np.ndarray)
                and values.shape[:1] == (source.lanes,)
                and getattr(self, name).shape[:1] == (self.lanes,)  # else it is not one of lanes
            ):
                setattr(self, name, np.repeat(values, times, axis=0))

    def model(self, lane: int) -> ModalModel:  # noqa: ARG002 - all lanes have one, unless a task says otherwise
        """Return a lane's structure."""
        return self.scene.model

    def starting_action(self) -> Array:
        """Return the action (A,) that leaves the actuator in its state at the episode's start."""
        return np.zeros(1)

    def make_runs(self, **arguments: Any) -> ControlledRuns:
        """Return the lanes' runs."""
        return ControlledRuns(self.scene, **arguments)

    def reset(
        self,
        which: Mask,
        generators: Sequence[np.random.Generator],
        chosen: Mapping[str, Any] | None = None,
    ) -> NDArray[np.float32]:
        """Start episodes in the lanes of a mask and return observations (L, features).

        Only the observations of these lanes are new.

        ``chosen`` takes the place of what is drawn: of each name in `options` one number, or one
        for each lane.
        """
        self._chosen = {name: self._checked(name, value) for name, value in (chosen or {}).items()}
        for lane in np.flatnonzero(which).tolist():
            self.begin(lane)
            self.draw(lane, generators[lane])
            self.runs.orders["phase"][lane] = generators[lane].uniform(0, 2 * np.pi)
            if self._record is not None:
                self.runs.orders["place"][lane] = generators[lane].integers(
                    len(self._record.values) - 1
                )
            self.draw_machine(lane, generators[lane])
        self.runs.restart(which)
        self.actuator.restart(which)
        return self.sensors.see(self.values(), generators, which)

    def step(self, actions: NDArray[Any], resting: Mask | None = None) -> tuple[Array, Mask, Mask]:
        """Advance all lanes by one control interval.

        The results are rewards (L,), whether episodes ended (L,), and whether they were cut off
        (L,).

        Lanes of the mask ``resting`` (L,) stay where they are; their reward is 0, and what else is
        said of them holds only after a `reset`.
        """
        chosen = np.asarray(actions, dtype=np.float64)
        duration, ratio, terminated = self.decide(
            chosen
            if self.actuator.is_ideal or chosen.ndim < 2  # a passage without a choice
            else self.actuator.apply(chosen)
        )
        rests = self._never if resting is None else resting
        if resting is not None:
            self.runs.idle = resting
        fill_orders(  # type: ignore[no-untyped-call]
            self.runs.orders,
            self.omega,
            self._period,
            self.steps,
            duration,
            self.ratio,
            ratio,
            self.force,
            terminated,
            rests,
            self.elapsed,
            self.late,
        )
        self.runs.advance()
        self.ratio = ratio
        self.duration = duration
        rewards = self.reward()
        truncated = np.empty(self.lanes, dtype=np.bool_)
        close_step(  # type: ignore[no-untyped-call]
            duration,
            self.elapsed,
            self.limit or 0,
            self.budget_terminates,
            rests,
            self.late,
            self.time,
            self.score,
            rewards,
            terminated,
            truncated,
        )
        if resting is not None:
            self.runs.idle = np.zeros_like(resting)
        return rewards, terminated, truncated

    def observe(
        self, generators: Sequence[np.random.Generator], resting: Mask | None = None
    ) -> NDArray[np.float32]:
        """Return the observations (L, features) after a step."""
        return self.sensors.see(self.values(), generators, None, resting)

    def begin(self, lane: int) -> None:
        """Set a lane's time, score and costs to zero.

        Quantities that are set interval by interval are set to their values in the scene.
        """
        for values in (self.time, self.score, self.elapsed, self.costs):
            values[lane] = 0

    @abstractmethod
    def draw(self, lane: int, generator: np.random.Generator) -> None:
        """Set what an episode draws before the force's phase, and the lane's first orders."""

    def draw_machine(self, lane: int, generator: np.random.Generator) -> None:  # noqa: B027 - most tasks have nothing to draw
        """Draw the differences between the machine and the control's model of it.

        They are drawn last, so that the same seed has the same episode without them.
        """

    @abstractmethod
    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Return each lane's duration, frequency ratio and end.

        They are the duration in pseudo periods, the frequency ratio at the interval's end, and
        whether the episode ends with it (a new array).
        """

    @abstractmethod
    def reward(self) -> Array:
        """Return the rewards (L,) of the interval that was just made, a new array."""

    def charge(self, moved: Array) -> None:
        """Fill in the costs of the interval that all tasks have, among ``costs`` (L, 5).

        ``moved`` (L,) is the actuator's displacement.

        The others are time, over the time budget, and fatigue: (|q|/g0)^m summed over the samples,
        over the number of them in a whole interval.
        """
        fill_costs(  # type: ignore[no-untyped-call]
            self.runs.reports,
            moved,
            self.duration,
            float(self.interval),
            self.steps,
            self.interval * self.settings.samples_per_period,
            self.costs,
        )

    @abstractmethod
    def level(self) -> Array:
        """Return the level (L,) as the observation has it."""

    @abstractmethod
    def expected_amplitude(self) -> Array:
        """Return the tip's amplitude (L,) in m that a picture should have room for."""

    def _checked(self, name: str, value: Any) -> Array:
        low, high = self.options[name]
        try:
            values = np.broadcast_to(np.asarray(value, dtype=np.float64), self.lanes)
        except (TypeError, ValueError):
            values = np.full(self.lanes, np.nan)
        whole = isinstance(low, int)  # of a structure or a scene
        ok = bool(((values >= low) & (values <= high)).all()) and not (whole and np.any(values % 1))
        kind = "whole number" if whole else "number"
        require(
            ok,
            f"options[{name!r}]",
            value,
            f"a {kind} from {low:g} to {high:g}, or one for each of {self.lanes} lanes",
        )
        return values

    def drawn(self, name: str, lane: int, drawn: float) -> float:
        """Return the value that a reset chose for a lane under this name, else the drawn one."""
        return float(self._chosen[name][lane]) if name in self._chosen else drawn

    def draw_force(self, lane: int, generator: np.random.Generator) -> float:
        """Return an episode's force in N."""
        low, high = self._force_range
        return self.drawn(
            "force", lane, low if low == high else float(generator.uniform(low, high))
        )

    def values(self) -> Array:
        """Return the scaled features (L, features)."""
        values = np.empty((self.lanes, len(self.features)))
        self.fill_state(values)
        further = self.further()
        for k, column in enumerate(further, values.shape[1] - len(further)):
            values[:, k] = column
        return values

    def fill_state(self, values: Array) -> None:
        """Write the first of the scaled features into ``values`` (L, features)."""
        fill_features(  # type: ignore[no-untyped-call]
            self.runs.reports, self._units, self.ratio, self.elapsed, self.level(), values
        )

    def further(self) -> tuple[Array, ...]:
        """Return the last scaled features, (L,) each.

        They are those that a task has in addition to the features of all tasks.
        """
        return ()

    def info(self) -> dict[str, NDArray[Any]]:
        """Return Gymnasium's info of the lanes by key, new arrays (L,)."""
        info: dict[str, NDArray[Any]] = {
            "time": self.time.copy(),
            "frequency_ratio": self.ratio.copy(),
            "force": self.force.copy(),
            "score": self.score.copy(),
            "impacts": self.runs.reports["impact_count"].copy(),
        }
        if self.cost_names:
            info["costs"] = self.costs.copy()
        if self.settings.raw_state:
            info["state"] = self.runs.state.copy()
        return info

    def snapshot(self) -> dict[str, Any]:
        """Return copies of all that the next steps depend on, but for the random generators."""
        own = {
            name: values.copy()
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray)
        }
        return {
            "lanes": own,
            "runs": self.runs.snapshot(),
            "sensors": self.sensors.snapshot(),
            "actuator": self.actuator.snapshot(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot of a task that was made with the same arguments."""
        for name, values in snapshot["lanes"].items():
            setattr(self, name, values.copy())
        self.runs.restore(snapshot["runs"])
        self.sensors.restore(snapshot["sensors"])
        self.actuator.restore(snapshot["actuator"])

    def describe(self) -> dict[str, Any]:
        """Return the environment's arguments as plain values, including defaults.

        ``threads`` is left out, as it changes no result.
        """
        return self.settings.describe() | {
            name: value for group in self.described for name, value in asdict(group).items()
        }

    def close(self) -> None:
        """End the threads."""
        self.runs.close()


class PooledTask(Task):
    """A task whose lanes are each in one of several ``scenes``, which an episode draws."""

    scenes: Sequence[Scene]

    def make_runs(self, **arguments: Any) -> ControlledRuns:
        """Return lanes in a pool of scenes, or in one scene if it is the only one."""
        if len(self.scenes) == 1:
            return ControlledRuns(self.scenes[0], **arguments)
        return PooledRuns(self.scenes, **arguments)

    @property
    def which(self) -> NDArray[np.int64]:
        """The lanes' scenes (L,), by their numbers."""
        if isinstance(self.runs, PooledRuns):
            return self.runs.which
        return np.zeros(self.lanes, dtype=np.int64)

    def draw_scene(self, name: str, lane: int, generator: np.random.Generator) -> int:
        """Draw a lane's scene and return its number.

        A reset may choose the number by ``name``, which is also its name in info.
        """
        self.which[lane] = number = int(
            self.drawn(name, lane, float(generator.integers(len(self.scenes))))
        )
        return number
