"""Families of policies with a few parameters, the baselines of an agent.

Each lane has its own parameters. The policies are schedules and rules that an engineer would use.

A family is made from the task of its environment, whose scales it may need. Its actions are clipped
to [-1, 1].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_env  # noqa: F401 - registers the environments
from impact_env.checks import ParameterError, require
from impact_env.envs.actuators import GapActuator
from impact_env.envs.observation import STATE
from impact_env.envs.task import FREQUENCY_SCALE, Task
from impact_env.extras import optional
from impact_env.frequency import receptance
from optimisation.bounds import design_force

Array = NDArray[np.float64]
Observations = NDArray[np.float32]
FREQUENCY = [feature.name for feature in STATE].index("frequency")
LARGEST = 3.0  # of a rule's numbers, where a family does not say otherwise
Start = Callable[[Sequence[float]], Sequence[float]]


class Family(ABC):
    """A family of policies with a few parameters.

    Lane i acts by row i of ``parameters`` (L, P).

    Attributes
    ----------
    names : sequence of str
        Names of the parameters.
    limits : sequence of (float, float)
        Range of each parameter, by default +- `LARGEST`.
    begins : sequence of Start
        Starts of a search, as functions of the best constant action.
    neutral : sequence of float
        Values of the parameters after the first ``few`` for which the family is a rule with ``few``
        parameters.
    few : int
        Number of parameters of this smaller rule, 0 without one.
    """

    names: Sequence[str] = ()
    limits: Sequence[tuple[float, float]] = ()
    begins: Sequence[Start] = ()
    few = 0
    neutral: Sequence[float] = ()

    def __init__(self, task: Any = None) -> None:
        self.task = task

    @property
    def bounds(self) -> Array:
        """Where the numbers may lie (P, 2)."""
        return np.array(self.limits or [(-LARGEST, LARGEST)] * len(self.names), dtype=np.float64)

    def begin(self, lanes: int) -> None:  # noqa: B027 - most have no memory
        """Reset the memory of earlier episodes."""

    @abstractmethod
    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return actions (L,), or (L, A) for tasks that take several numbers."""


def task_of(name: str, arguments: Mapping[str, Any] | None = None) -> Any:
    """Return the task behind one environment, for its settings."""
    with optional():
        import gymnasium
    env = gymnasium.make(name, **(arguments or {}))
    env.close()
    return env.unwrapped.task  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Rates:
    """Frequency scale of the sweep.

    It has the range of frequency ratios, and the zero and the unit of the frequency in
    observations.
    """

    low: float
    high: float
    origin: float = 1.0
    unit: float = FREQUENCY_SCALE

    @classmethod
    def of(cls, task: Task) -> Rates:
        """Return the scale of a passage's task."""
        schedule: Any = task.schedule
        low, high = schedule.passage.limits
        return cls(low, high, schedule.frequency_origin, schedule.frequency_unit)

    def share(self, observations: Observations) -> Array:
        """Return the position in the range of the frequencies in observations, (L,).

        It is 0 at the low end and 1 at the high end.
        """
        ratio = self.origin + self.unit * observations[:, FREQUENCY].astype(np.float64)
        return (ratio - self.low) / (self.high - self.low)


class ConstantAction(Family):
    """The same action always."""

    names: Sequence[str] = ("action",)

    def act(self, parameters: Array, observations: Observations) -> Array:  # noqa: ARG002
        """Return the numbers."""
        return parameters


class ConstantPair(ConstantAction):
    """The same for a task that takes two numbers."""

    names = ("first action", "second action")


class FamilyPolicy:
    """A family with its numbers chosen: one row (P,) for all lanes, or one for each lane (L, P)."""

    def __init__(
        self, name: str, family: Family, parameters: NDArray[Any] | Sequence[float]
    ) -> None:
        self.name = name
        self.family = family
        self.parameters = np.atleast_2d(np.asarray(parameters, dtype=np.float64))
        if self.parameters.shape[1] != len(family.names):
            raise ParameterError(
                f"parameters of {name} = {parameters!r} is not allowed: {len(family.names)} "
                f"numbers ({', '.join(family.names)})"
            )

    def start(self, lanes: int) -> None:
        """Begin new episodes in all lanes."""
        require(
            len(self.parameters) in (1, lanes),
            "lanes",
            lanes,
            f"one for each of the {len(self.parameters)} rows of parameters",
        )
        self.family.begin(lanes)
        self._rows = np.broadcast_to(self.parameters, (lanes, self.parameters.shape[1]))

    def act(self, observations: Observations) -> NDArray[np.float32]:
        """Return the family's policy with these numbers."""
        actions = self.family.act(self._rows, observations)
        return np.clip(actions, -1, 1).astype(np.float32).reshape(len(actions), -1)


class RandomPolicy:
    """Uniformly distributed actions from [-1, 1] in every interval.

    The sequence is repeated after `start`. ``numbers``: how many numbers an action of the task has.
    """

    name = "random"

    def __init__(self, seed: int = 0, numbers: int = 1) -> None:
        self.seed = seed
        self.numbers = numbers
        self.start(0)

    def start(self, lanes: int) -> None:  # noqa: ARG002 - one generator serves all lanes
        """Begin the sequence again."""
        self._generator = np.random.default_rng(self.seed)

    def act(self, observations: Observations) -> NDArray[np.float32]:
        """Return one draw for each lane."""
        return self._generator.uniform(-1, 1, (len(observations), self.numbers)).astype(np.float32)


Random = RandomPolicy  # the name before; for one release


# Rules for the tasks that see amplitudes over an interval: rate, rate and gap, friction of a
# passage, and the gap under a force that changes.
#
# On the low branch impacts have stopped, and do not come back on the way down; that is all a rule
# of the rate looks at, beside the frequency, which the machine's control knows. A friction limit
# that suits a response goes with a power of its size (scaling law), and so does the gap: the design
# rule (`optimisation.bounds`) says g0 = force/f* for a gap of 1 m. Where the force is not known it
# follows from what is seen, by the balance of the spectral line at the forcing frequency that
# `optimisation.bounds` derives:
#
#     f G_f = (1 - kappa) q - kappa r.
#
# The observation gives q (in phase with the force and a quarter behind it). Without impacts the
# absorber, free of friction, stays where it is: r = -q and f = q/G_f. With impacts |r| is taken as
# ``stroke`` times the gap (a triangle's line is 0.81 of its amplitude, a square's 1.27), with the
# phase for which f is real (its phase is the reference) and the absorber works against the force:
#
#     f = Re a + sqrt((|b| stroke gap)^2 - (Im a)^2),  a = (1 - kappa) q/G_f,  b = kappa/G_f.
#
# This is exact for a stationary response with that stroke, so a transient misleads it; the estimate
# is smoothed over the intervals.


# columns of the observation
IN_PHASE = 0
QUADRATURE = 1
IMPACTS = 4
TIME_LEFT = 7
# of the feature "impacts": one in two pseudo periods; above the noise of a sensor, below what a
# sustained response has
FEW = 0.25
LAST = 0.15  # share of the time budget at which the small rule leaves
SMALLEST = 1e-9  # of a look: what a passage that was never looked at counts as


class OverFrequency(Family):
    """A family whose policies depend on the frequency."""

    def __init__(self, task: Any) -> None:
        self.rates = Rates.of(task)


class FrequencyWindow(OverFrequency):
    """A schedule with one rate inside a window of the frequency and another outside.

    The edges of the window are shares of the range, in any order.
    """

    names = ("edge", "other edge", "action inside", "action outside")
    begins = (lambda _: (0.35, 0.5, 0.05, 1.0), lambda _: (0.33, 0.47, 0.1, 1.0))
    limits = ((0, 1), (0, 1), (0, 1), (0, 1))

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the action inside or outside."""
        share = self.rates.share(observations)
        edges = np.sort(parameters[:, :2], axis=1)
        return np.where(
            (share > edges[:, 0]) & (share <= edges[:, 1]), parameters[:, 2], parameters[:, 3]
        )


class SmallRule(OverFrequency):
    """A rule with full speed down to a frequency, then a slow rate, and a rate backwards.

    The slow rate holds while there are impacts and time remains. Beyond another frequency the rate
    is negative under the same conditions. Otherwise the sweep has full speed.
    """

    names = ("slow from", "action when slow", "back at", "action back")
    begins = (
        lambda _: (0.46, 0.2, 0.4, -0.28),
        lambda _: (0.5, 0.1, 0.35, -0.6),
    )  # the first: ratios 0.976 and 0.970 of the default range
    limits = ((0.3, 0.7), (0, 1), (0.2, 0.6), (-1, 0))

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the actions (L,)."""
        slow_from, slow, back_at, back = parameters.T
        share = self.rates.share(observations)
        waits = (
            (share <= slow_from)
            & (observations[:, IMPACTS] >= FEW)
            & (observations[:, TIME_LEFT] > LAST)
        )
        return np.where(waits, np.where(share <= back_at, back, slow), 1.0)


class LimitOverFrequency(OverFrequency):
    """A schedule of the friction limit: a parabola over the frequency."""

    names = ("action in the middle", "slope", "curvature")
    begins = (lambda c: (c[0], 0.0, 0.0),)
    limits = ((-1, 1), (-2, 2), (-2, 2))

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the parabola's value."""
        x = 2 * self.rates.share(observations) - 1
        return parameters[:, 0] + parameters[:, 1] * x + parameters[:, 2] * x * x


class FeedbackFriction(OverFrequency):
    """A constant friction limit up to a place, then one that follows the amplitude there.

    The limit is proportional to a power of the amplitude, which is measured once at that place and
    stored.

    Where the first limit holds the absorber stuck, the response up to that observation is linear
    and its amplitude is proportional to the force.
    """

    names = (
        "action until the observation",
        "share of the range at which it is",
        "action for one half-clearance",
        "exponent",
        "slope over the frequency",
    )
    begins = (lambda _: (1.0, 0.9, 0.5, 1.0, 0.0), lambda _: (0.5, 0.5, 0.0, 1.0, 0.0))
    limits = ((-1, 1), (0.2, 0.98), (-1, 1), (0.0, 2.5), (-1, 1))

    def __init__(self, task: Any) -> None:
        super().__init__(task)
        low, high = task.actuators[0].limits
        self.per_e = 2 / np.log(high / low)  # of the action, for a factor of e in the limit
        self.begin(0)

    def begin(self, lanes: int) -> None:
        """Reset the stored amplitude."""
        self.amplitude = np.zeros(lanes)
        self.measured = np.zeros(lanes, dtype=np.bool_)

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the actions (L,)."""
        first, place, level, exponent, slope = parameters.T
        share = self.rates.share(observations)
        amplitude = np.hypot(
            observations[:, IN_PHASE].astype(np.float64),
            observations[:, QUADRATURE].astype(np.float64),
        )
        self.amplitude = np.where(self.measured, self.amplitude, amplitude)
        self.measured = self.measured | (share <= place)
        feedback = (
            level
            + exponent * self.per_e * np.log(np.maximum(self.amplitude, SMALLEST))
            + slope * (2 * share - 1)
        )
        return np.where(self.measured, feedback, first)


class GapScale:
    """Properties of a task that the gap rules use.

    They are limits and unit of the gap (m), f*/gap of the design rule (N/m), the beam and the
    absorber's mass.
    """

    def __init__(self, task: Task) -> None:
        actuator = next(one for one in task.actuators if isinstance(one, GapActuator))
        self.low, self.high = actuator.limits
        self.geometric = actuator.is_logarithmic
        self.column = [feature.name for feature in task.features].index("half-clearance in use")
        self.origin = task.schedule.frequency_origin
        self.unit = task.schedule.frequency_unit
        self.length = task.lanes.length
        self.omega = task.lanes.omega
        self.model = task.settings.scene.model
        mass = task.settings.scene.absorber_mass
        assert mass is not None  # the task has a cavity, so there is an absorber
        self.mass = float(mass)
        self.force_per_gap = design_force(self.model, self.mass, 1.0, task.settings.resonance)

    def action(self, gap: Array | float) -> Array:
        """Return the action of a half-clearance in m."""
        if self.geometric:
            return np.asarray(
                2
                * np.log(np.maximum(gap, 1e-3 * self.low) / self.low)
                / np.log(self.high / self.low)
                - 1
            )
        return np.asarray(2 * (np.asarray(gap) - self.low) / (self.high - self.low) - 1)

    def offset(self, observations: NDArray[Any]) -> Array:
        """Return the frequency ratios less 1 in observations, over 0.1 (L,)."""
        return np.asarray(
            (self.origin + self.unit * observations[:, FREQUENCY].astype(np.float64) - 1)
            / FREQUENCY_SCALE
        )

    def lines(self, ratio: Array) -> tuple[Array, Array]:
        """Return G_f (m/N) and kappa, complex (L,), at frequency ratios."""
        omega = ratio * self.omega
        by_force = receptance(
            self.model, omega, self.model.one_phase_force_shape, self.model.tip_shape
        )
        kappa = (
            receptance(self.model, omega, self.model.tip_shape, self.model.tip_shape)
            * self.mass
            * omega**2
        )
        return by_force, kappa  # type: ignore[return-value]


class GapOverFrequency(Family):
    """A gap that depends on the frequency alone: action = first + second * (ratio - 1)/0.1."""

    names = ("action at the resonance", "change for a tenth of the frequency")
    begins = (lambda c: (c[0], 0.0),)
    limits = ((-1, 1), (-5, 5))

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the straight line's value."""
        return parameters[:, 0] + parameters[:, 1] * observations[:, FREQUENCY]


class GapByEstimatedForce(Family):
    """The design rule's gap for a force that is estimated from the response.

    The estimation is described in the text above. The gap is multiplied by a factor that depends on
    the frequency.

    gap = (factor + slope * (ratio - 1)/0.1) * force/f*. ``memory`` is the weight of the estimate so
    far.
    """

    names = ("factor", "slope over the frequency", "stroke", "memory")
    begins = (lambda _: (1.5, 0.0, 1.0, 0.7), lambda _: (1.0, 0.0, 1.0, 0.5))
    limits = ((0.2, 4.0), (-5.0, 5.0), (0.3, 1.5), (0.0, 0.98))

    def __init__(self, task: Any) -> None:
        self.scale = GapScale(task)
        self.begin(0)

    def begin(self, lanes: int) -> None:
        """Start with the force for which the first gap is best."""
        self.force = np.full(lanes, self.scale.length * self.scale.force_per_gap)
        self._first = True

    def estimate(self, stroke: Array, observations: Observations) -> Array:
        """Return the force (L,) in N that the last interval speaks for."""
        features = observations.astype(np.float64)
        length = self.scale.length
        q = (features[:, IN_PHASE] - 1j * features[:, QUADRATURE]) * length
        by_force, kappa = self.scale.lines(1 + FREQUENCY_SCALE * self.scale.offset(features))
        a = (1 - kappa) * q / by_force
        size = np.abs(kappa / by_force) * stroke * features[:, self.scale.column] * length
        knocked = a.real + np.sqrt(np.maximum(size**2 - a.imag**2, 0.0))
        return np.maximum(np.where(features[:, IMPACTS] > 0, knocked, (q / by_force).real), 0.0)

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the action of the rule's gap for the smoothed estimate."""
        factor, slope, stroke, memory = parameters.T
        if not self._first:  # at the start nothing has been seen yet
            weight = np.clip(memory, 0, 1)
            self.force = weight * self.force + (1 - weight) * self.estimate(stroke, observations)
        self._first = False
        return self.scale.action(
            (factor + slope * self.scale.offset(observations))
            * self.force
            / self.scale.force_per_gap
        )


PACE = (
    "rate action at the start",
    "share of the range at which the rest begins",
    "rate action after it",
)


def pace(parameters: Array, share: Array) -> Array:
    """Return rate actions (L,), with one value above a share of the range and one below.

    A passage goes down through the range.
    """
    return np.where(share > parameters[:, 1], parameters[:, 0], parameters[:, 2])


class RateAndGapOverFrequency(OverFrequency):
    """A schedule of rate and gap.

    The rate has one value up to some place on the way and another after it. The gap's action is a
    parabola over the frequency.
    """

    names = (*PACE, "gap action in the middle", "its slope", "its curvature")
    begins = (lambda c: (c[0], 0.5, c[0], c[1], 0.0, 0.0),)
    limits = ((-1, 1), (0, 1), (-1, 1), (-1, 1), (-2, 2), (-2, 2))

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return rate and gap actions (L, 2)."""
        share = self.rates.share(observations)
        first, slope, curvature = parameters[:, 3:6].T
        x = 2 * share - 1
        return np.stack([pace(parameters, share), first + slope * x + curvature * x * x], axis=1)


class RateAndGapByEstimatedForce(OverFrequency):
    """Rates as in `RateAndGapOverFrequency`, with the gap of `GapByEstimatedForce`.

    Slow rates leave time to estimate the force.
    """

    names = (*PACE, *GapByEstimatedForce.names)
    begins = (
        lambda c: (c[0], 0.5, c[0], 1.5, 0.0, 1.0, 0.7),
        lambda c: (0.0, 0.9, c[0], 1.5, 0.0, 1.0, 0.9),
    )
    limits = (*RateAndGapOverFrequency.limits[:3], *GapByEstimatedForce.limits)

    def __init__(self, task: Any) -> None:
        super().__init__(task)
        self.rule = GapByEstimatedForce(task)

    def begin(self, lanes: int) -> None:
        """Forget the force."""
        self.rule.begin(lanes)

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return rate and gap actions (L, 2)."""
        return np.stack(
            [
                pace(parameters, self.rates.share(observations)),
                self.rule.act(parameters[:, 3:], observations),
            ],
            axis=1,
        )
