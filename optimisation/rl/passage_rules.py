"""Feedback during a passage: slow where the response may drop to the low branch, back for another try while it has not, haste once it has.

On the low branch impacts have stopped, and do not come back on the way down; that is all these rules look at, beside the frequency, which the
machine's control knows. `BlindTries` goes the same way without looking: what going back is worth by itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from optimisation.rl.families import Array, Info, Rates
from optimisation.rl.policies import Observations

IMPACTS, TIME_LEFT = 4, 7  # columns of the observation
FEW = 0.25  # of the feature "impacts": one in two pseudo periods; above the noise of a sensor, below what a sustained response has
LAST = 0.15  # share of the time budget at which the small rule leaves
# shares of the range of frequencies, from its low end to its high one; actions
WAY = ("entry from", "entry to", "action at entry", "slow from", "action when slow", "back at", "action back")


class TriedPassage:
    """What both rules have in common: the way of the frequency, from its high end down.

    Fast to "entry from", at an own rate to "entry to", fast to "slow from", slow to "back at"; there back, and slow again, until it is time to
    leave: fast to the end.
    """

    informed = False

    def __init__(self, rates: Rates) -> None:
        self.rates = rates
        self.begin(0)

    def begin(self, lanes: int) -> None:
        """Forget what was seen in earlier episodes."""
        self.memory = np.zeros(lanes)

    def way(self, parameters: Array, observations: Observations, leaves: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        """Return actions (L,) where lanes of a mask (L,) leave, and whether the others turn back."""
        entry_from, entry_to, entry, slow_from, slow, back_at, back = parameters[:, : len(WAY)].T
        share = self.rates.share(observations)
        actions = np.where((share <= entry_from) & (share > entry_to), entry, 1.0)
        turns = (share <= np.minimum(back_at, slow_from)) & ~leaves
        actions = np.where((share <= slow_from) & ~leaves, slow, actions)
        return np.where(turns, back, actions), turns


class TryAgain(TriedPassage):
    """Leaves once no impacts were seen for some intervals in a row below "slow from", or when a share of the time budget is all that is left."""

    names = (*WAY, "quiet intervals", "time to leave")

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the actions (L,)."""
        self.memory = np.where(observations[:, IMPACTS] < FEW, self.memory + 1, 0)
        wanted, last = parameters[:, len(WAY) :].T
        leaves = (self.memory >= np.maximum(wanted, 0.5)) | (observations[:, TIME_LEFT] <= last)
        return self.way(parameters, observations, leaves)[0]


class BlindTries(TriedPassage):
    """Leaves after a number of tries, whatever the response does: a schedule, which does not look at it."""

    names = (*WAY, "tries")

    def begin(self, lanes: int) -> None:
        """Forget earlier episodes."""
        super().begin(lanes)
        self._turning = np.zeros(lanes, dtype=np.bool_)

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the actions (L,)."""
        actions, turns = self.way(parameters, observations, self.memory >= np.round(parameters[:, len(WAY)]))
        self.memory = self.memory + (turns & ~self._turning)
        self._turning = turns
        return actions


class SmallRule:
    """Haste to a frequency; then slow while there are impacts and time is left, and back from another frequency on; else haste. Four numbers."""

    informed = False
    names = ("slow from", "action when slow", "back at", "action back")
    start = (0.46, 0.2, 0.4, -0.28)  # ratios 0.976 and 0.970 of the default range

    def __init__(self, rates: Rates) -> None:
        self.rates = rates

    def begin(self, lanes: int) -> None:
        """Do nothing: there is no memory."""

    def act(self, parameters: Array, observations: Observations, info: Info) -> Array:  # noqa: ARG002
        """Return the actions (L,)."""
        slow_from, slow, back_at, back = parameters.T
        share = self.rates.share(observations)
        waits = (share <= slow_from) & (observations[:, IMPACTS] >= FEW) & (observations[:, TIME_LEFT] > LAST)
        return np.where(waits, np.where(share <= back_at, back, slow), 1.0)
