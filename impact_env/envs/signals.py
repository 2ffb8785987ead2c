"""Signals between an agent and the machine: sensors and the transmission of actions.

Sensors have noise, drift and delay. Actions have finite steps and a delay.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impact_env.envs.observation import FEATURE_LIMIT, Feature
from impact_env.kernels.control.episodes import limit_features

Array = NDArray[np.float64]


class ActionDelay:
    """Steps and delay of the actions of a number of lanes.

    ``levels`` is the number of equidistant values from -1 to 1 to which an action is rounded, 0 for
    any value. ``delay`` is the number of control intervals until an action has an effect; until
    then the action is ``start`` (A,).
    """

    def __init__(self, lanes: int, delay: int, levels: int, start: Array) -> None:
        self.levels = levels
        self.start = start
        self._past = np.tile(start, (delay, lanes, 1))
        self._at = 0
        self.is_ideal = levels == 0 and delay == 0  # whether actions pass unchanged

    def apply(self, actions: Array) -> Array:
        """Return the actions (L, A) that take effect now.

        ``actions`` (L, A) are chosen now, from -1 to 1.
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
        """Reset the lanes of a mask (L,): their earlier actions have no effect."""
        self._past[:, which] = self.start

    def copy_from(self, source: "ActionDelay", times: int) -> None:
        """Copy the earlier actions of another group of lanes, each lane ``times`` times."""
        self._past = np.repeat(source._past, times, axis=1)
        self._at = source._at

    def snapshot(self) -> tuple[Array, int]:
        """Return the actions that have no effect yet."""
        return self._past.copy(), self._at

    def restore(self, snapshot: tuple[Array, int]) -> None:
        """Set the actions that have no effect yet to those of a snapshot."""
        self._past[...], self._at = snapshot


class Sensors:
    """Noise, drift and delay of the measured features of a number of lanes.

    ``noise`` is the standard deviation of the noise of each scaled, measured feature. ``drift`` is
    the standard deviation of the change of its bias in an interval; the bias is 0 at the start of
    an episode. ``delay`` is a number of intervals; until they have passed, the first observation
    of an episode is repeated.
    """

    def __init__(
        self,
        features: Sequence[Feature],
        lanes: int,
        noise: float,
        delay: int,
        drift: float = 0.0,
    ) -> None:
        self.measured = np.array([feature.measured for feature in features])
        self.noise = noise
        self.delay = delay
        self.drift = drift
        self._bias = np.zeros((lanes, int(self.measured.sum())))
        self._past = np.zeros((delay + 1, lanes, len(features)))
        self._at = 0

    def see(
        self,
        values: Array,
        generators: Sequence[np.random.Generator],
        fresh: NDArray[np.bool_] | None = None,
        resting: NDArray[np.bool_] | None = None,
    ) -> NDArray[np.float32]:
        """Return the observations (L, features) of the scaled values (L, features).

        ``fresh`` (L,) marks lanes at the start of an episode: only their observations are then new.
        Lanes in the mask ``resting`` (L,) draw no random numbers, because they are reset before
        their observation is used.
        """
        observed = values
        if self.noise > 0 or self.drift > 0:
            observed = values.copy()
            wanted = np.ones(len(values), dtype=np.bool_) if fresh is None else fresh
            for lane in np.flatnonzero(wanted if resting is None else wanted & ~resting).tolist():
                observed[lane, self.measured] += self._draw_error(
                    lane, generators[lane], fresh is not None
                )
        if self.delay > 0:
            size = len(self._past)
            if fresh is None:
                self._at = (self._at + 1) % size
                self._past[self._at] = observed
            else:
                self._past[:, fresh] = observed[fresh]
            observed = np.where(self.measured, self._past[(self._at + 1) % size], observed)
        limited = np.empty(observed.shape, dtype=np.float32)
        limit_features(observed, FEATURE_LIMIT, limited)  # type: ignore[no-untyped-call]
        return limited

    def _draw_error(self, lane: int, generator: np.random.Generator, is_start: bool) -> Array:
        """Return the sum of bias and noise of each measured feature of a lane."""
        bias = self._bias[lane]
        if is_start:
            bias[:] = 0.0
        elif self.drift > 0:
            bias += self.drift * generator.standard_normal(len(bias))
        if self.noise == 0:
            return bias
        return np.asarray(bias + self.noise * generator.standard_normal(len(bias)))

    def copy_from(self, source: "Sensors", times: int) -> None:
        """Copy the delayed observations and biases of other sensors.

        Each lane of ``source`` is copied ``times`` times.
        """
        self._past = np.repeat(source._past, times, axis=1)
        self._at = source._at
        self._bias = np.repeat(source._bias, times, axis=0)

    def snapshot(self) -> tuple[Array, int, Array]:
        """Return the delayed observations and the biases."""
        return self._past.copy(), self._at, self._bias.copy()

    def restore(self, snapshot: tuple[Array, int, Array]) -> None:
        """Set delayed observations and biases to those of a snapshot."""
        self._past[...], self._at, self._bias[...] = snapshot
