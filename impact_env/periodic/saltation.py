"""What events do to a state and to a small disturbance of it: jumps, vector fields on both sides, saltation matrices."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.case import Case

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Mechanics:
    """A case's states (2 N_m + 2,) as `InitialState.vector`: rates, the relative displacement and velocity as rows, impulses as a column."""

    case: Case

    @cached_property
    def distance(self) -> Array:
        """Row of the relative displacement."""
        n = self.case.model.modes
        return np.concatenate([-self.case.model.tip_shape, [1.0], np.zeros(n + 1)])

    @cached_property
    def speed(self) -> Array:
        """Row of the relative velocity."""
        return np.roll(self.distance, self.case.model.modes + 1)

    @cached_property
    def push(self) -> Array:
        """What a unit impulse on the absorber does to the state."""
        n = self.case.model.modes
        return np.concatenate([np.zeros(n + 1), -self.case.model.tip_shape, [1 / self.case.structure.mass]])

    def field(self, state: Array, phase: float, force: float | None) -> Array:
        """Return the state's rate under a ``force`` (N) on the absorber; None: the one that keeps the relative velocity."""
        model, n = self.case.model, self.case.model.modes
        rate = np.zeros(2 * n + 2)
        rate[: n + 1] = state[n + 1 :]
        rate[n + 1 : -1] = self.case.force * np.cos(phase) * model.force_shape - model.omega**2 * state[:n]
        rate[n + 1 : -1] -= 2 * model.damping_ratio * model.omega * state[n + 1 : -1]
        return np.asarray(rate + self.push * (self.holding(rate) if force is None else force))

    def holding(self, rate: Array) -> float:
        """Return the force (N) on the absorber that takes the relative acceleration out of a state's ``rate`` (2 N_m + 2,)."""
        return -float(self.speed @ rate) / self.case.structure.compliance

    def bounced(self, state: Array, restitution: float) -> tuple[Array, float]:
        """Return the state after an impact, and the impulse on the absorber in N s."""
        impulse = -(1 + restitution) * float(self.speed @ state) / self.case.structure.compliance
        return np.asarray(state + impulse * self.push), impulse

    def saltation(self, before: Array, after: Array, guard: Array, restitution: float | None = None) -> Array:
        """Return the saltation matrix of an event with the fields (2 N_m + 2,) ``before`` and ``after``, where ``guard`` . state is a constant.

        ``restitution`` of an impact, None: the state does not jump.
        """
        jump = np.eye(len(before))
        if restitution is not None:
            jump -= (1 + restitution) / self.case.structure.compliance * np.outer(self.push, self.speed)
        return np.asarray(jump + np.outer(after - jump @ before, guard) / float(guard @ before))
