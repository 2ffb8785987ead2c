"""Stationary responses over the frequency: quantiles of the largest displacement in a period, over many runs at each frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor, draw_members
from impact_env.parameters import count, non_negative, positive
from impact_env.periodic.approach import Approach
from impact_env.periodic.envelope import QUANTILES, envelope, stationary_members
from impact_env.scene import Scene

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stationary:
    """The response at one frequency ratio: ``tip_max`` (Q,) in m, the quantiles `QUANTILES` over all members and periods of the force.

    They are of the tip's largest displacement in a period; ``impacts``: mean number in a period.
    """

    omega_ratio: float
    tip_max: Real
    impacts: float

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and lists; keys with their units."""
        return {"omega_ratio": self.omega_ratio, "quantiles": list(QUANTILES), "tip_max_m": self.tip_max.tolist(), "impacts_per_period": self.impacts}

    @staticmethod
    def from_plain(plain: dict[str, Any]) -> Stationary:
        """Return the response of `to_plain`."""
        return Stationary(float(plain["omega_ratio"]), np.array(plain["tip_max_m"], dtype=np.float64), float(plain["impacts_per_period"]))


@dataclass(frozen=True)
class StationaryRuns:
    """How they are computed: ``members`` runs at each of ``points`` frequencies, each with a phase of its own.

    ``settle`` pseudo periods come before a window of ``window`` periods of the force. ``approach``: the ratio at which runs begin, to come into
    impact; None: at the frequency itself. ``threads`` and ``executor``: as in `run_lanes`; nothing depends on them. Raises ParameterError for values
    out of range.
    """

    points: int
    members: int = 20
    settle: float = 500.0
    window: int = 100
    approach: float | None = None
    seed: int = 0
    threads: int | None = None
    executor: Executor | None = None

    def __post_init__(self) -> None:
        count("points", self.points, 2)
        count("members", self.members, 1)
        positive("settle", self.settle)
        count("window", self.window, 2)
        count("seed", self.seed, 0)
        if self.approach is not None:
            non_negative("approach", self.approach)

    @property
    def settings(self) -> dict[str, Any]:
        """What the numbers depend on, but for scene, force and frequency."""
        return {"members": self.members, "settle": self.settle, "window": self.window, "approach": self.approach, "seed": self.seed}

    def ratios(self, low: float, high: float) -> list[float]:
        """Return the frequency ratios between two."""
        return [float(x) for x in np.linspace(low, high, self.points)]

    def at(self, scene: Scene, force: float, reference: float, ratio: float) -> Stationary:
        """Return the response at a ratio of ``reference`` (rad/s) under a force in N; Ctrl-C and errors as `stationary_members`."""
        phases = draw_members(self.members, self.seed, "phase").phases.tolist()
        way = Approach(reference, self.approach)
        found = stationary_members(scene, force, way, ratio, self.settle, self.window, phases, threads=self.threads, executor=self.executor)
        impacts = float(np.mean([member.found.impacts_per_period for member in found]))
        return Stationary(ratio, envelope(found), impacts)
