"""What lies between an agent's action and the machine: finite steps and a delay."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Actuator:
    """Steps and delay of the actions of a number of lanes.

    ``levels``: number of equidistant values from -1 to 1 that an action is rounded to, 0 for any
    value. ``delay``: control intervals until an action has an effect; until then each number of an
    action has its value of ``start`` (A,).
    """

    def __init__(self, lanes: int, delay: int, levels: int, start: Array) -> None:
        self.levels = levels
        self.start = start
        self._past = np.tile(start, (delay, lanes, 1))
        self._at = 0

    @property
    def is_ideal(self) -> bool:
        """Whether actions pass unchanged."""
        return self.levels == 0 and len(self._past) == 0

    def apply(self, actions: Array) -> Array:
        """Return the actions (L, A) that take effect now.

        ``actions`` (L, A) are those chosen now, from -1 to 1.
        """
        if self.levels > 0:
            steps = self.levels - 1
            actions = np.round(0.5 * (actions + 1) * steps) * (2 / steps) - 1
        if len(self._past) == 0:
            return actions
        applied: Array = self._past[self._at].copy()
        self._past[self._at] = actions
        self._at = (self._at + 1) % len(self._past)
        return applied

    def restart(self, which: NDArray[np.bool_]) -> None:
        """Forget the earlier actions of the lanes of a mask (L,)."""
        self._past[:, which] = self.start

    def copy_from(self, source: "Actuator", times: int) -> None:
        """Take over the earlier actions of another actuator, of each lane ``times`` times."""
        self._past = np.repeat(source._past, times, axis=1)
        self._at = source._at

    def snapshot(self) -> tuple[Array, int]:
        """Return the actions under way."""
        return self._past.copy(), self._at

    def restore(self, snapshot: tuple[Array, int]) -> None:
        """Go on from a snapshot."""
        self._past[...], self._at = snapshot
