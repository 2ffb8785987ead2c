"""What kind of response a stationary motion is: no impacts, periodic, sustained impacts, strongly modulated (paper, sections 3.1 and 3.2)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import count, fraction, positive, require

Array = NDArray[np.float64]


class Kind(StrEnum):
    """Kinds of stationary response."""

    LINEAR = "linear"  # no impacts; friction may still slide
    PERIODIC = "periodic"
    SUSTAINED = "sustained"  # impacts go on without pause, almost periodic or chaotic
    MODULATED = "strongly modulated"  # impacts and pauses take turns


@dataclass(frozen=True)
class Criteria:
    """What tells the kinds apart.

    ``tolerance``: a motion is periodic if its states at one phase of the force come again, after up to ``most_multiple`` periods, to within this
    share of the largest tip displacement, throughout the window. ``pause``: periods of the force without impact that make a pause, and ``depth``: the
    least modulation depth of a strongly modulated response, which has both.
    """

    tolerance: float = 1e-4
    most_multiple: int = 12
    pause: float = 1.0
    depth: float = 0.5

    def __post_init__(self) -> None:
        positive("tolerance", self.tolerance)
        count("most_multiple", self.most_multiple, 1)
        positive("pause", self.pause)
        fraction("depth", self.depth)


@dataclass(frozen=True, eq=False)
class Window:
    """A stretch of M whole periods of the force: all that a response is judged by.

    ``states`` (M + 1, d): states at one phase of the force, each as a displacement of the tip or of the absorber against it in m (velocities
    over the force's circular frequency). ``impacts`` (K,): times of impacts in periods of the force from the window's start. ``peaks`` (M,): largest
    |q_tip| of each period in m.
    """

    states: Array
    impacts: Array
    peaks: Array

    def __post_init__(self) -> None:
        periods = len(self.peaks)
        require(periods >= 2 and self.peaks.ndim == 1, "peaks", np.shape(self.peaks), "a row of two periods or more")
        ok = self.states.ndim == 2 and len(self.states) == periods + 1
        require(ok, "states", np.shape(self.states), f"{periods + 1} rows, one more than periods")
        ok = self.impacts.ndim == 1 and bool(np.all(np.diff(self.impacts) >= 0))
        require(ok, "impacts", self.impacts, "times in periods of the force that do not fall")

    @property
    def periods(self) -> int:
        """Number of periods of the force."""
        return len(self.peaks)

    @property
    def unit(self) -> float:
        """Largest |q_tip| in m."""
        return float(np.max(self.peaks))


@dataclass(frozen=True)
class Classified:
    """A window's kind, and what it was judged by.

    ``multiple``: periods of the force after which the motion comes again, None unless it does; ``miss``: how close it comes to itself at the
    best of all multiples, of the largest tip displacement; ``impacts_per_period`` of the force; ``depth``: modulation depth; ``longest_pause``
    in periods of the force.
    """

    kind: Kind
    multiple: int | None
    miss: float
    impacts_per_period: float
    depth: float
    longest_pause: float


def modulation_depth(peaks: Array) -> float:
    """Return (largest - least) / (largest + least) of the peaks (M,) of a response's periods; 0 where nothing moves."""
    high, low = float(np.max(peaks)), float(np.min(peaks))
    return (high - low) / (high + low) if high > 0 else 0.0


def longest_pause(impacts: Array, periods: float) -> float:
    """Return the longest time without impact in a window, its ends included; times in periods of the force."""
    return float(np.max(np.diff(np.concatenate([[0.0], impacts, [float(periods)]]))))


def misses(window: Window, most_multiple: int) -> Array:
    """Return for each multiple 1, 2, ... the largest distance of two states that many periods apart, of the largest tip displacement.

    At most half of the window's periods are compared so.
    """
    most, unit = min(most_multiple, window.periods // 2), window.unit
    states = window.states
    return np.array([float(np.max(np.abs(states[k:] - states[:-k]))) / unit if unit > 0 else 0.0 for k in range(1, most + 1)])


def classify(window: Window, criteria: Criteria | None = None) -> Classified:
    """Return a window's kind.

    Without impact it is linear. It is periodic if it comes again; else strongly modulated if it has pauses and is deeply modulated, or sustained.
    """
    criteria = Criteria() if criteria is None else criteria
    distances = misses(window, criteria.most_multiple)
    close = np.flatnonzero(distances <= criteria.tolerance)
    multiple = int(close[0]) + 1 if len(close) else None
    depth, pause = modulation_depth(window.peaks), longest_pause(window.impacts, window.periods)
    if len(window.impacts) == 0:
        kind = Kind.LINEAR
    elif multiple is not None:
        kind = Kind.PERIODIC
    else:
        kind = Kind.MODULATED if pause >= criteria.pause and depth >= criteria.depth else Kind.SUSTAINED
    return Classified(kind, multiple, float(np.min(distances)), len(window.impacts) / window.periods, depth, pause)
