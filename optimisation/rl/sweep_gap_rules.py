"""Rate and gap during a passage: constant, scheduled over the frequency, and by the design rule for the force that the response speaks for.

The rate has one value from the start to some place on the way, where there is time for a look at the force, and another after it.
"""

from __future__ import annotations

import numpy as np

from optimisation.rl.families import Array, Info, Rates, Stateless
from optimisation.rl.gap_rules import EstimatedForceRule, GapScale, rule_action
from optimisation.rl.policies import Observations

PACE = ("rate action at the start", "share of the range at which the rest begins", "rate action after it")


def pace(rates: Rates, parameters: Array, observations: Observations) -> Array:
    """Return rate actions (L,): one above a share of the range (of a passage down), another below it."""
    return np.where(rates.share(observations) > parameters[:, 1], parameters[:, 0], parameters[:, 2])


class ConstantPair(Stateless):
    """The same rate and the same gap always."""

    names = ("rate action", "gap action")

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return both (L, 2)."""
        return parameters


class PairOverFrequency(Stateless):
    """A schedule over the frequency, blind to the response: the rate in two pieces, the gap's action a parabola over the share of the range."""

    names = (*PACE, "gap action in the middle", "its slope", "its curvature")

    def __init__(self, rates: Rates) -> None:
        self.rates = rates

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return rate and gap actions (L, 2)."""
        x = 2 * self.rates.share(observations) - 1
        first, slope, curvature = parameters[:, 3:6].T
        return np.stack([pace(self.rates, parameters, observations), first + slope * x + curvature * x * x], axis=1)


class PairByTrueForce(Stateless):
    """The design rule for the true force, which no agent sees: an oracle. The factor may depend on the frequency."""

    names = (*PACE, "factor", "slope over the frequency")
    informed = True

    def __init__(self, rates: Rates, scale: GapScale) -> None:
        self.rates, self.scale = rates, scale

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:
        """Return rate and gap actions (L, 2)."""
        gap = rule_action(self.scale, parameters[:, 3:5], observations, np.asarray(info["force"], dtype=np.float64))
        return np.stack([pace(self.rates, parameters, observations), gap], axis=1)


class PairByEstimatedForce:
    """The design rule for a force that is estimated from the response as `EstimatedForceRule` does."""

    names = (*PACE, *EstimatedForceRule.names)
    informed = False

    def __init__(self, rates: Rates, scale: GapScale) -> None:
        self.rates, self.rule = rates, EstimatedForceRule(scale)

    def begin(self, lanes: int) -> None:
        """Forget the force."""
        self.rule.begin(lanes)

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:
        """Return rate and gap actions (L, 2)."""
        gap = self.rule.act(parameters[:, len(PACE) :], observations, info)
        return np.stack([pace(self.rates, parameters, observations), gap], axis=1)
