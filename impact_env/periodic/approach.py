"""Runs that come to a constant frequency from another one: how the impacting state is prepared, whatever it does there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive, FrequencySchedule
from impact_env.parameters import non_negative, positive
from impact_env.scene import InitialState, Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Approach:
    """From rest ``periods`` at ``ratio``, where runs come into impact by themselves, then ``ramp`` to the frequency wanted.

    The ratio is of the ``reference`` (rad/s), times are in pseudo periods of it. A ``ratio`` of None: from rest at the frequency wanted, at once.
    """

    reference: float
    ratio: float | None = None
    periods: float = 200.0
    ramp: float = 50.0

    def __post_init__(self) -> None:
        positive("reference frequency", self.reference)
        if self.ratio is not None:
            non_negative("approach ratio", self.ratio)
        positive("approach periods", self.periods)
        positive("approach ramp", self.ramp)

    @property
    def lead(self) -> float:
        """Pseudo periods before the frequency wanted is reached."""
        return 0.0 if self.ratio is None else self.periods + self.ramp

    def to(self, *points: tuple[float, float]) -> FrequencySchedule:
        """Return the schedule through ``points``, pairs of a time in pseudo periods and the ratio at its end; the first begins after the lead.

        The first point's ratio is also where the approach ends.
        """
        first = points[0][1]
        before = [] if self.ratio is None else [(self.periods, self.ratio), (self.ramp, first)]
        start = first if self.ratio is None else self.ratio
        spans, ratios = zip(*before, *points, strict=True)
        times = np.concatenate([[0.0], np.cumsum(spans)]) * 2 * np.pi / self.reference
        return FrequencySchedule(times, np.array([start, *ratios]) * self.reference, self.reference)


def hold(approach: Approach, force: float, ratio: float, periods: float, phase: float = 0.0) -> Drive:
    """Return the drive that stays at ``ratio`` for a number of pseudo ``periods`` once it is there; force in N, initial phase in rad."""
    return Drive(force, approach.to((positive("periods", periods), ratio)), phase)


def passage(approach: Approach, force: float, start: float, stop: float, periods_per_percent: float, phase: float = 0.0) -> Drive:
    """Return the drive that sweeps from one ratio to another at a constant rate, in pseudo periods for each percent of the reference frequency."""
    span = abs(stop - start) * 100 * positive("periods_per_percent", periods_per_percent)
    settle = approach.ramp  # at the start, so that the sweep begins as stays do
    return Drive(force, approach.to((settle, start), (positive("sweep", span), stop)), phase)


def start_from(scene: Scene, state: Array) -> InitialState:
    """Return a state (2 N_m + 2,) as a start; one that rounding put beyond a wall is put on it."""
    n, cavity = scene.model.modes, scene.cavity(0)
    tip = float(scene.model.tip_shape @ state[:n])
    gap = np.inf if cavity is None else cavity.gap
    return InitialState(state[:n], state[n + 1 : -1], tip + float(np.clip(state[n] - tip, -gap, gap)), float(state[-1]))
