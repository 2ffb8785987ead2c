"""The friction limit of a passage: by the true force, and by one look at the response on the way.

Friction scales with the force (two scenes whose friction, gap and force differ by one factor move alike), so a limit in proportion to the force is
the first guess; the exponent is left to the search. Where the first limit holds the absorber fast the response until the look is linear, and its
amplitude speaks for the force.
"""

from __future__ import annotations

import numpy as np

from impact_env.envs.friction_task import FrictionTask
from optimisation.rl.families import Array, Info, Rates, Stateless
from optimisation.rl.gap_rules import IN_PHASE, QUADRATURE
from optimisation.rl.policies import Observations

SMALLEST = 1e-9  # of a look: what a passage that was never looked at counts as


class LimitScale:
    """What rules know of a task: how much of the action a factor of e in the limit is, and the way of the frequency."""

    def __init__(self, task: FrictionTask) -> None:
        low, high = task.limits
        self.per_e, self.rates = 2 / np.log(high / low), Rates.of(task)

    def action(self, level: Array, exponent: Array, slope: Array, size: Array, observations: Observations) -> Array:
        """Return actions (L,) of limits that go with a power of a size, and with the frequency: from -1 to 1 over the range."""
        way = 2 * self.rates.share(observations) - 1
        return level + exponent * self.per_e * np.log(np.maximum(size, SMALLEST)) + slope * way


class LimitByTrueForce(Stateless):
    """One limit at first, and from some place on one that goes with a power of the true force, which no agent sees: an oracle."""

    names = ("action at first", "share of the range at which the rest begins", "action for 1 N", "exponent", "slope over the frequency")
    informed = True

    def __init__(self, scale: LimitScale) -> None:
        self.scale = scale

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:
        """Return the actions (L,)."""
        first, place, level, exponent, slope = parameters.T
        by_force = self.scale.action(level, exponent, slope, np.asarray(info["force"], dtype=np.float64), observations)
        return np.where(self.scale.rates.share(observations) <= place, by_force, first)


class LimitByLook:
    """The same with the amplitude that is seen at that place: one look, which is remembered."""

    names = ("action until the look", "share of the range at which it is", "action for one half-clearance", "exponent", "slope over the frequency")
    informed = False

    def __init__(self, scale: LimitScale) -> None:
        self.scale = scale
        self.begin(0)

    def begin(self, lanes: int) -> None:
        """Forget what was seen."""
        self.seen, self.looked = np.zeros(lanes), np.zeros(lanes, dtype=np.bool_)

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the actions (L,)."""
        first, place, level, exponent, slope = parameters.T
        amplitude = np.hypot(observations[:, IN_PHASE].astype(np.float64), observations[:, QUADRATURE].astype(np.float64))
        self.seen = np.where(self.looked, self.seen, amplitude)
        self.looked = self.looked | (self.scale.rates.share(observations) <= place)
        return np.where(self.looked, self.scale.action(level, exponent, slope, self.seen, observations), first)
