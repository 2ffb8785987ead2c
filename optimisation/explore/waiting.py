"""Computations for which the explorer's page waits.

They are the compilation of kernels in other processes, and branches of periodic motions.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from impact_env.kernels.compiling.parts import NotCached, only_cached
from impact_env.parameters import RigidWalls, SlidingAbsorber
from impact_env.periodic.case import case_of
from impact_env.periodic.orbit_branches import orbit_branches
from impact_env.periodic.response_curve import ResponseCurve, orbit_curve
from impact_env.prepare import Preparation
from impact_env.scene import Scene
from impact_env.sweep import Stop


class Newer(Exception):  # noqa: N818 - no error
    """The page has moved on."""


class Kernels:
    """Kernels that are compiled, and those that other processes are compiling.

    Each of the latter has its own process. All tabs share them.
    """

    def __init__(self) -> None:
        self.ready: set[object] = set()
        self._preparing: dict[object, Preparation] = {}
        self._lock = threading.Lock()

    def wait_for_kernels(
        self, key: object, ready: Callable[[], bool], begin: Callable[[], Preparation], stop: Stop
    ) -> Iterator[float]:
        """Yield the elapsed seconds of compilation until the kernels of a key are ready.

        Raises Newer after a stop. The compilation then continues.
        """
        if key in self.ready:
            return
        with self._lock:
            work = self._preparing.get(key)
            if work is None and ready():
                self.ready.add(key)
                return
            work = self._preparing.setdefault(key, begin()) if work is None else work
        yield work.elapsed
        while not work.done:
            if stop.given:
                raise Newer
            work.wait(0.2)
            yield work.elapsed
        self._preparing.pop(key, None)
        self.ready.add(
            key
        )  # if the other process could not, this one compiles, or tells why it cannot

    def cancel(self) -> None:
        """End what is on its way."""
        for work in list(self._preparing.values()):
            work.cancel()


def branches(
    scene: Scene, force: float, resonance: int, low: float, high: float, stop: Stop | None = None
) -> Iterator[ResponseCurve]:
    """Yield the branches of symmetric orbits between two ratios of a resonance.

    They have their stability. Nothing is yielded without rigid walls.
    """
    absorber = scene.absorber
    if not (isinstance(absorber, SlidingAbsorber) and isinstance(absorber.walls, RigidWalls)):
        return

    def check_stop(_label: str, _points: int, _omega: float) -> None:
        if stop is not None and stop.given:
            raise Newer

    reference = scene.model.resonance_omega(resonance)
    for branch in orbit_branches(
        case_of(scene, force, low * reference),
        low * reference,
        high * reference,
        progress=check_stop,
    ):
        check_stop("", 0, 0.0)
        yield orbit_curve(branch, reference)


def _all_branches(*arguments: Any) -> None:
    """Do what `branches` does, for a process that compiles what it takes."""
    list(branches(*arguments))


def follow_branches(
    scene: Scene,
    force: float,
    resonance: int,
    low: float,
    high: float,
    stop: Stop,
    kernels: Kernels,
) -> Iterator[ResponseCurve | float]:
    """Yield the curves of `branches`, or the seconds for which their kernels have compiled.

    The kernels are compiled in another process.

    There are no curves where the level is read elsewhere than at the absorber, since the branches
    have the amplitude there.
    """
    if scene.model.response_shape is not None:
        return
    arguments = (scene, force, resonance, low, high)
    key = (
        "branches",
        isinstance(scene.absorber, SlidingAbsorber) and scene.absorber.friction is not None,
    )
    if key in kernels.ready:
        yield from branches(*arguments, stop)
        return
    try:
        with only_cached():
            curves = list(branches(*arguments, stop))
    except NotCached:
        yield from kernels.wait_for_kernels(
            key, lambda: False, lambda: Preparation(partial(_all_branches, *arguments)), stop
        )
        curves = list(branches(*arguments, stop))
    kernels.ready.add(key)
    yield from curves
