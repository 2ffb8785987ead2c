"""The observations of an agent: named, scaled features.

Features that a sensor would measure have noise and delay.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.control.episodes import limit_features

Array = NDArray[np.float64]
FEATURE_LIMIT = 100.0  # of a scaled feature; what lies outside is cut off
FEW_IMPACTS = 4.0  # the same of feature 5 in newer tasks, so that chatter stays of order one


@dataclass(frozen=True)
class Feature:
    """One number of an observation.

    Attributes
    ----------
    name : str
        Name of the feature.
    measured : bool
        Whether a sensor measures it, with noise and delay. Other features are known to the
        machine's control.
    what : str
        Description for the tables of the environments (`shells.list_features`), with names of
        arguments in braces.
    unit : str
        Unit and scale for these tables.
    """

    name: str
    measured: bool
    what: str
    unit: str = "1"


LENGTH_UNIT = "m / half-clearance"
OF_SCENE = "m / half-clearance of the scene"
PER_VELOCITY = "m/s / (half-clearance times the resonance's circular frequency)"
TIP_IN_PHASE = Feature(
    "tip amplitude in phase with the force",
    True,
    "amplitude of the tip in phase with the force, over the last interval",
    LENGTH_UNIT,
)
TIP_QUADRATURE = Feature(
    "tip amplitude a quarter behind the force",
    True,
    "amplitude of the tip a quarter of a period behind the force",
    LENGTH_UNIT,
)
DISTANCE = Feature(
    "absorber's place in the cavity",
    True,
    "place of the absorber relative to the tip at the end of the interval",
    LENGTH_UNIT,
)
VELOCITY = Feature(
    "absorber's velocity in the cavity",
    True,
    "velocity of the absorber relative to the tip",
    PER_VELOCITY,
)
IMPACTS = Feature(
    "impacts per pseudo period", True, "impacts in the last interval", "per pseudo period / 2{few}"
)
SHARE = Feature(
    "absorber's share of the energy",
    True,
    "share of the absorber's kinetic energy in the energy of beam and absorber",
)
FREQUENCY = Feature(
    "frequency", False, "frequency ratio to the resonance, minus {origin}", "1 / {scale}"
)
TIME_LEFT = Feature("time left", False, "remaining share of the time budget")
LEVEL_FEATURE = Feature("level", True, "response level so far", "m / {level}")
RMS = Feature(
    "RMS of the last interval", True, "RMS of the tip over the last interval", LENGTH_UNIT
)
DISTANCE_TO_END = Feature(
    "way left", False, "far frequency minus present frequency", "ratio / {scale}"
)
GAP_IN_USE = Feature("half-clearance in use", False, "half-clearance in use", OF_SCENE)
FRICTION_IN_USE = Feature(
    "friction limit in use",
    False,
    "friction limit in use",
    "place in the range, from -1 to 1",
)
STATE = (
    TIP_IN_PHASE,
    TIP_QUADRATURE,
    DISTANCE,
    VELOCITY,
    IMPACTS,
    SHARE,
    FREQUENCY,
    TIME_LEFT,
    LEVEL_FEATURE,
)


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
