"""What a family of kernels offers, and what a run hands to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.control.interval import Batch
from impact_env.kernels.motion.level import Level
from impact_env.kernels.motion.observers import Counters, Energy, Events, Observe, Series, new_clock
from impact_env.loads import AnyDrive
from impact_env.scene import Scene

Array = NDArray[np.float64]
Part = tuple[int, int]


@dataclass
class Observers:
    """The arrays into which a run is observed; what is None is not."""

    counters: Counters
    level: Level | None = None
    events: Events | None = None
    series: Series | None = None
    energy: Energy | None = None

    def every(self, sample_dt: float) -> Observe:
        """Return them as the kernels take them, for a run that begins, with samples ``sample_dt`` (s) apart."""
        return Observe(new_clock(sample_dt), self.counters, self.level, self.events, self.series, self.energy)


class Run(Protocol):
    """A family's single run."""

    def __call__(self, scene: Scene, drive: AnyDrive, method: Any, state: Array, sample_dt: float, observers: Observers, /) -> int:
        """Integrate over the whole schedule and return a status code of `impact_env.kernels.motion.observers`.

        ``state`` (2 N_m + 2 n,) is the start and becomes the end. Samples lie ``sample_dt`` (s) apart from time 0. A slider of elastic friction
        starts without force.
        """


class Control(Protocol):
    """A family's lanes under control."""

    def __call__(self, scene: Scene, method: Any, pseudo_period: float, batch: Batch, /) -> Callable[[int, int], None]:
        """Return the kernel of `kernels.control.lanes` that advances lanes [low, high) by their orders' intervals; ``pseudo_period`` in s."""


def one_slot(scene: Scene, pseudo_period: float) -> int:
    """Return the slots of a family that keeps nothing but the state."""
    return 1


def absent(law: object) -> object:
    """Return whether a law is absent; of one that has parts which may be, which of them are."""
    return tuple(part is None for part in law) if isinstance(law, tuple) else law is None


@dataclass(frozen=True)
class Family:
    """One family of kernels.

    ``laws``: parts of a scene without which the kernels are others, None where absent. ``searched``: its events are searched for.
    ``control``: lanes in intervals, or None where the family has none. ``slots``: number of slots that a lane keeps between intervals.
    """

    name: str
    laws: Callable[[Scene], tuple[object, ...]]
    run: Run
    control: Control | None = None
    slots: Callable[[Scene, float], int] = one_slot
    searched: bool = False

    def key(self, scene: Scene) -> tuple[object, ...]:
        """Return a key, equal for two scenes that the same compiled kernels simulate, under the same kind of drive."""
        return self.name, *(absent(law) for law in self.laws(scene))
