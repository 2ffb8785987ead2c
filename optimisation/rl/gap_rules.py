"""The gap by the design rule: for the true force, and for a force that is estimated from the response.

The rule (`optimisation.bounds.rule`) says that a gap serves a force in proportion to it, g0 = force/f* for a gap of 1 m. Where the force is not
known it follows from what is seen, by the balance of the spectral line at the forcing frequency that `optimisation.bounds.lines` derives:

    f G_f = (1 - kappa) q - kappa r.

The observation gives q (in phase with the force and a quarter behind it). Without impacts the absorber, free of friction, stays where it is:
r = -q and f = q/G_f. With impacts |r| is taken as ``stroke`` times the gap (a triangle's line is 0.81 of its amplitude, a square's 1.27), with
the phase for which f is real (its phase is the reference) and the absorber works against the force:

    f = Re a + sqrt((|b| stroke gap)^2 - (Im a)^2),        a = (1 - kappa) q/G_f,        b = kappa/G_f.

This is exact for a stationary response with that stroke, so a transient misleads it; the estimate is smoothed over the intervals.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.envs.gap_task import GapTask
from impact_env.envs.settings import span
from impact_env.envs.sweep_gap_task import SweepGapTask
from impact_env.envs.task import FREQUENCY_SCALE
from impact_env.frequency import receptance
from optimisation.bounds import design_force
from optimisation.rl.families import FREQUENCY, Array, Info, Stateless
from optimisation.rl.policies import Observations

IN_PHASE, QUADRATURE, IMPACTS = 0, 1, 4  # columns of the observation


class GapScale:
    """What gap rules know of a task: limits and unit of the gap (m), f*/gap of the design rule (N/m), the beam, the absorber's mass."""

    def __init__(self, task: GapTask | SweepGapTask) -> None:
        limits = task.cavity.gap_limits if isinstance(task, SweepGapTask) else task.control.gap_limits
        self.low, self.high = span("gap_limits", limits)
        self.geometric = isinstance(task, SweepGapTask)
        self.column = [feature.name for feature in task.features].index("half-clearance in use")
        self.origin, self.unit = task.frequency_origin, task.frequency_unit
        self.length, self.omega = task.length, task.omega
        self.model = task.settings.scene.model
        mass = task.settings.scene.absorber_mass
        assert mass is not None  # the task has a cavity, so there is an absorber
        self.mass = float(mass)
        self.force_per_gap = design_force(self.model, self.mass, 1.0, task.settings.resonance)

    def action(self, gap: Array | float) -> Array:
        """Return the action of a half-clearance in m."""
        if self.geometric:
            return np.asarray(2 * np.log(np.maximum(gap, 1e-3 * self.low) / self.low) / np.log(self.high / self.low) - 1)
        return np.asarray(2 * (np.asarray(gap) - self.low) / (self.high - self.low) - 1)

    def gap(self, action: Array | float) -> Array:
        """Return the half-clearance of an action in m."""
        if self.geometric:
            return np.asarray(self.low * (self.high / self.low) ** (0.5 * (np.clip(action, -1, 1) + 1)))
        return np.asarray(self.low + 0.5 * (np.clip(action, -1, 1) + 1) * (self.high - self.low))

    def offset(self, observations: NDArray[Any]) -> Array:
        """Return the frequency ratios less 1 in observations, over 0.1 (L,)."""
        return np.asarray((self.origin + self.unit * observations[:, FREQUENCY].astype(np.float64) - 1) / FREQUENCY_SCALE)

    def lines(self, ratio: Array) -> tuple[Array, Array]:
        """Return G_f (m/N) and kappa, complex (L,), at frequency ratios."""
        omega = ratio * self.omega
        by_force = receptance(self.model, omega, self.model.force_shape, self.model.tip_shape)
        kappa = receptance(self.model, omega, self.model.tip_shape, self.model.tip_shape) * self.mass * omega**2
        return by_force, kappa  # type: ignore[return-value]


class GapOverFrequency(Stateless):
    """A gap that depends on the frequency alone: action = first + second * (ratio - 1)/0.1."""

    names = ("action at the resonance", "change for a tenth of the frequency")

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the straight line's value."""
        return parameters[:, 0] + parameters[:, 1] * observations[:, FREQUENCY]


class TrueForceRule(Stateless):
    """The design rule with the true force (info's ``force`` of the last interval), times a factor that may depend on the frequency.

    gap = (factor + slope * (ratio - 1)/0.1) * force/f* ; factor 1 and slope 0 are the rule as it stands.
    """

    names = ("factor", "slope over the frequency")
    informed = True

    def __init__(self, scale: GapScale) -> None:
        self.scale = scale

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:
        """Return the action of the rule's gap."""
        return rule_action(self.scale, parameters, observations, np.asarray(info["force"], dtype=np.float64))


def rule_action(scale: GapScale, parameters: Array, observations: Observations, force: Array) -> Array:
    """Return the actions (L,) of the rule's gap, times the first two parameters' factor, for forces in N."""
    factor = parameters[:, 0] + parameters[:, 1] * scale.offset(observations)
    return scale.action(factor * force / scale.force_per_gap)


class EstimatedForceRule:
    """The design rule with a force that is estimated from the response, see the module's text. ``memory`` is the weight of the estimate so far."""

    names = (*TrueForceRule.names, "stroke", "memory")
    informed = False

    def __init__(self, scale: GapScale) -> None:
        self.scale = scale
        self.begin(0)

    def begin(self, lanes: int) -> None:
        """Start with what the first gap would be right for."""
        self.force = np.full(lanes, self.scale.length * self.scale.force_per_gap)
        self._first = True

    def estimate(self, stroke: Array, observations: Observations) -> Array:
        """Return the force (L,) in N that the last interval speaks for."""
        seen, length = observations.astype(np.float64), self.scale.length
        q = (seen[:, IN_PHASE] - 1j * seen[:, QUADRATURE]) * length
        by_force, kappa = self.scale.lines(1 + FREQUENCY_SCALE * self.scale.offset(seen))
        a, size = (1 - kappa) * q / by_force, np.abs(kappa / by_force) * stroke * seen[:, self.scale.column] * length
        knocked = a.real + np.sqrt(np.maximum(size**2 - a.imag**2, 0.0))
        return np.maximum(np.where(seen[:, IMPACTS] > 0, knocked, (q / by_force).real), 0.0)

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the action of the rule's gap for the smoothed estimate."""
        if not self._first:  # at the start nothing has been seen yet
            memory = np.clip(parameters[:, 3], 0, 1)
            self.force = memory * self.force + (1 - memory) * self.estimate(parameters[:, 2], observations)
        self._first = False
        return rule_action(self.scale, parameters, observations, self.force)
