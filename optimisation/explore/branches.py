"""Branches of periodic motions, found while a page waits and stopped when it moves on."""

from collections.abc import Iterator
from functools import partial
from typing import Any

from impact_env.budget import Stop
from impact_env.kernels.compiling.parts import NotKept, only_kept
from impact_env.parameters import RigidWalls, SlidingAbsorber
from impact_env.periodic.case import case_of
from impact_env.periodic.orbit_branches import orbit_branches
from impact_env.periodic.response_curve import ResponseCurve, orbit_curve
from impact_env.prepare import Preparation
from impact_env.scene import Scene
from optimisation.explore.waiting import Kernels, Newer


def branches(scene: Scene, force: float, resonance: int, low: float, high: float, stop: Stop | None = None) -> Iterator[ResponseCurve]:
    """Yield the branches of symmetric orbits between two ratios of a resonance, with their stability; none where there are no rigid walls."""
    absorber = scene.absorber
    if not (isinstance(absorber, SlidingAbsorber) and isinstance(absorber.walls, RigidWalls)):
        return

    def look(_label: str, _points: int, _omega: float) -> None:
        if stop is not None and stop.given:
            raise Newer

    reference = scene.model.resonance_omega(resonance)
    for branch in orbit_branches(case_of(scene, force, low * reference), low * reference, high * reference, progress=look):
        look("", 0, 0.0)
        yield orbit_curve(branch, reference)


def _all_branches(*given: Any) -> None:
    """Do what `branches` does, for a process that compiles what it takes."""
    list(branches(*given))


def followed(scene: Scene, force: float, resonance: int, low: float, high: float, stop: Stop, kernels: Kernels) -> Iterator[ResponseCurve | float]:
    """Yield the curves of `branches`, or for how many seconds another process has been compiling what they take.

    None where the level is read elsewhere than at the absorber, whose amplitude the branches tell.
    """
    if scene.model.response_shape is not None:
        return
    given = (scene, force, resonance, low, high)
    key = ("branches", isinstance(scene.absorber, SlidingAbsorber) and scene.absorber.friction is not None)
    if key in kernels.ready:
        yield from branches(*given, stop)
        return
    try:
        with only_kept():
            found = list(branches(*given, stop))
    except NotKept:
        yield from kernels.waited(key, lambda: False, lambda: Preparation(partial(_all_branches, *given)), stop)
        found = list(branches(*given, stop))
    kernels.ready.add(key)
    yield from found
