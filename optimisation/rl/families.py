"""Kinds of policies with a few numbers to choose, each lane with its own numbers: the engineer's answers that an agent is compared with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import impact_env  # noqa: F401 - registers the environments
from impact_env.envs.observation import STATE
from impact_env.envs.sweep_task import SweepTask
from impact_env.envs.task import FREQUENCY_SCALE
from impact_env.extras import optional
from impact_env.parameters import ParameterError, count, require
from optimisation.rl.policies import Observations

Array = NDArray[np.float64]
Info = Mapping[str, NDArray[Any]]
FREQUENCY = [feature.name for feature in STATE].index("frequency")


class Family(Protocol):
    """A kind of policy: lane i acts by row i of ``parameters`` (L, P)."""

    informed: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the P parameters."""

    def begin(self, lanes: int) -> None:
        """Forget what was seen in earlier episodes."""

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:
        """Return actions (L,), or (L, A) for tasks that take several numbers; what lies outside [-1, 1] is cut off. ``info`` is empty unless
        ``informed``.
        """  # noqa: D205


class Stateless:
    """What families without memory have in common."""

    informed = False

    def begin(self, lanes: int) -> None:
        """Do nothing: there is no memory."""


def task_of(name: str, arguments: Mapping[str, Any]) -> Any:
    """Return the task behind one environment, for its settings."""
    with optional():
        import gymnasium
    env = gymnasium.make(name, **arguments)
    env.close()
    return env.unwrapped.task  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Rates:
    """The sweep's scale: slowest and fastest rate in % per 100 pseudo periods, range of frequency ratios, rate of going back (0: never), and zero
    and unit of the frequency in observations.
    """  # noqa: D205

    slow: float
    fast: float
    low: float
    high: float
    back: float = 0.0
    origin: float = 1.0
    unit: float = FREQUENCY_SCALE

    @classmethod
    def of(cls, task: SweepTask) -> Rates:
        """Return the scale of a task."""
        passage = task.passage
        return cls(*passage.rates, *passage.limits, passage.backward_rate, task.frequency_origin, task.frequency_unit)

    @property
    def slowest(self) -> float:
        """Action of the slowest rate forward."""
        return -1.0 if self.back == 0 else 0.0

    def action(self, rate: NDArray[Any] | float) -> Array:
        """Return the action of a rate forward."""
        share = np.log(np.asarray(rate) / self.slow) / np.log(self.fast / self.slow)
        return np.asarray(self.slowest + (1 - self.slowest) * share)

    def rate(self, action: NDArray[Any] | float) -> Array:
        """Return the rate of an action, below 0 for one that goes back."""
        cut = np.clip(action, -1, 1)
        forward = self.slow * (self.fast / self.slow) ** np.maximum((cut - self.slowest) / (1 - self.slowest), 0)
        return np.asarray(np.where(cut < self.slowest, cut * self.back, forward))

    def ratio(self, observations: Observations) -> Array:
        """Return the frequency ratios (L,) in observations."""
        return np.asarray(self.origin + self.unit * observations[:, FREQUENCY].astype(np.float64))

    def share(self, observations: Observations) -> Array:
        """Return where in the range the frequencies in observations are (L,): 0 at its low end, 1 at its high one."""
        return (self.ratio(observations) - self.low) / (self.high - self.low)


class ConstantAction(Stateless):
    """One number, always: a constant rate, or a fixed gap."""

    names = ("action",)

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the parameter."""
        return parameters[:, 0]


class FrequencyWindow(Stateless):
    """A rule that looks at the frequency ratio: one rate inside a window, another outside. Edges are shares of the range, in any order."""

    names = ("edge", "other edge", "action inside", "action outside")

    def __init__(self, rates: Rates) -> None:
        self.rates = rates

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the action inside or outside."""
        share = self.rates.share(observations)
        edges = np.sort(parameters[:, :2], axis=1)
        return np.where((share > edges[:, 0]) & (share <= edges[:, 1]), parameters[:, 2], parameters[:, 3])


class OpenLoop(Stateless):
    """A schedule over the frequency: actions at equidistant knots over the range, linear between them (so that rates are geometric)."""

    def __init__(self, rates: Rates, knots: int) -> None:
        self.rates, self.knots = rates, count("knots", knots, 2)

    @property
    def names(self) -> tuple[str, ...]:
        """The knots' places."""
        return tuple(f"action at {ratio:.4f}" for ratio in np.linspace(self.rates.low, self.rates.high, self.knots))

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the interpolated action."""
        share = self.rates.share(observations) * (self.knots - 1)
        left = np.clip(share.astype(np.int64), 0, self.knots - 2)
        part, lanes = np.clip(share - left, 0, 1), np.arange(len(share))
        actions = np.clip(parameters, -1, 1)
        return actions[lanes, left] * (1 - part) + actions[lanes, left + 1] * part


class FamilyPolicy:
    """A family with its numbers chosen: one row (P,) for all lanes, or one for each lane (L, P)."""

    def __init__(self, name: str, family: Family, parameters: NDArray[Any] | list[float]) -> None:
        self.name, self.family = name, family
        self.parameters = np.atleast_2d(np.asarray(parameters, dtype=np.float64))
        if self.parameters.shape[1] != len(family.names):
            raise ParameterError(f"parameters of {name} = {parameters!r} is not allowed: {len(family.names)} numbers ({', '.join(family.names)})")
        self._info: Info = {}

    def start(self, lanes: int) -> None:
        """Begin new episodes in all lanes."""
        require(len(self.parameters) in (1, lanes), "lanes", lanes, f"one for each of the {len(self.parameters)} rows of parameters")
        self.family.begin(lanes)
        self._rows = np.broadcast_to(self.parameters, (lanes, self.parameters.shape[1]))

    def act(self, observations: Observations) -> NDArray[np.float32]:
        """Return what the family does with the numbers."""
        actions = self.family.act(self._rows, observations, self._info)
        return np.clip(actions, -1, 1).astype(np.float32).reshape(len(actions), -1)


class InformedPolicy(FamilyPolicy):
    """A policy of an informed family: it is given info."""

    def inform(self, info: Info) -> None:
        """Take info for the next action."""
        self._info = info


def policy_of(name: str, family: Family, parameters: NDArray[Any] | list[float]) -> FamilyPolicy:
    """Return the policy of a family, one that is given info if the family wants it."""
    return (InformedPolicy if family.informed else FamilyPolicy)(name, family, parameters)
