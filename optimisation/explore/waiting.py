"""What the explorer's page waits for: kernels that other processes compile meanwhile, branches of periodic motions, and advice."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from impact_env.curve import CurveCase
from impact_env.kernels.compiling.parts import NotCached, only_cached
from impact_env.loads import Loads
from impact_env.modes import ModalModel
from impact_env.parameters import RigidWalls, SlidingAbsorber, TunedAbsorber, require
from impact_env.periodic.case import case_of
from impact_env.periodic.orbit_branches import orbit_branches
from impact_env.periodic.response_curve import ResponseCurve, orbit_curve
from impact_env.prepare import Preparation
from impact_env.scene import Scene
from impact_env.sweep import Stop
from optimisation.absorber_rules import best_friction, scaled_absorber
from optimisation.explore.settings import ControlValues, Loading
from optimisation.gap_advice import search_gap
from optimisation.load_cases import AppliedLoads, swept_force
from optimisation.measures import LABELS
from optimisation.sweep_range import find_sweep_range
from optimisation.tuned import smallest_amplitude


class Newer(Exception):  # noqa: N818 - no error
    """The page has moved on."""


class Kernels:
    """Which kernels are ready, and those on their way, each in a process of its own; shared by all tabs."""

    def __init__(self) -> None:
        self.ready: set[object] = set()
        self._preparing: dict[object, Preparation] = {}
        self._lock = threading.Lock()

    def waited(
        self, key: object, ready: Callable[[], bool], begin: Callable[[], Preparation], stop: Stop
    ) -> Iterator[float]:
        """Yield the seconds of compiling until the kernels of a key are ready; raises Newer after a stop, and leaves the compiling be."""
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
    """Yield the branches of symmetric orbits between two ratios of a resonance, with their stability; none where there are no rigid walls."""
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


def followed(
    scene: Scene,
    force: float,
    resonance: int,
    low: float,
    high: float,
    stop: Stop,
    kernels: Kernels,
) -> Iterator[ResponseCurve | float]:
    """Yield the curves of `branches`, or for how many seconds another process has been compiling what they take.

    None where the level is read elsewhere than at the absorber, whose amplitude the branches tell.
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
        yield from kernels.waited(
            key, lambda: False, lambda: Preparation(partial(_all_branches, *arguments)), stop
        )
        curves = list(branches(*arguments, stop))
    kernels.ready.add(key)
    yield from curves


MEMBERS = 1  # as `design_gap --quick`


_TUNED: dict[tuple[object, ...], TunedAbsorber] = {}


def tuned_to(model: ModalModel, mass_ratio: float, resonance: int) -> TunedAbsorber:
    """Return the linear absorber with the smallest amplitude over the sweep's range; known at once for the same numbers, as it takes seconds."""
    shapes = (
        model.omega,
        model.damping_ratio,
        model.one_phase_force_shape,
        model.tip_shape,
        model.level_shape,
    )
    key = (*(x.tobytes() for x in shapes), mass_ratio, resonance)
    if key not in _TUNED:
        limits = find_sweep_range(model, mass_ratio, resonance)
        _TUNED[key] = smallest_amplitude(model, mass_ratio, resonance, *limits)
    return _TUNED[key]


def recommended(
    values: ControlValues, model: ModalModel, stop: Stop, tell: Callable[[int, int], None]
) -> dict[str, Any]:
    """Return the advice of a search by quick sweeps at the marked force: new values by the controls' names, and why.

    ``model`` has the absorber's place, ``tell`` is told finished and all runs. Raises `Newer` after a ``stop``.
    """
    mass = values["mass_ratio"] * model.beam_mass
    resonance = values.resonance
    loading = Loading(values.load, model, resonance)
    if values.concept == "tuned":
        tuned = tuned_to(model, values["mass_ratio"], resonance)
        return {
            "values": {"stiffness": tuned.stiffness, "damper": tuned.damping},
            "why": "smallest peak of the linear response",
        }
    if values.concept == "friction":
        require(
            loading.swept,
            "Recommended",
            "friction damper",
            "for a swept load: there is no closed form for a random force",
        )
        limit, _ = best_friction(model, mass, values.intensity * loading.worth, resonance)
        return {
            "values": {"damper_friction": limit},
            "why": "most energy lost in a cycle at this force",
        }
    if values.concept == "two":
        gap = loading.rule_gap(mass, values.intensity)
        return {
            "values": {"gap": gap, "second_gap": gap},
            "why": "the gap from which a search would begin, as if both masses were one",
        }

    def watch(done: int, total: int) -> None:
        if stop.given:
            raise KeyboardInterrupt  # the sweeps end early, with what they have
        tell(done, total)

    if values.load != "force":
        return _for_loads(values, loading, watch)
    own = scaled_absorber(
        model, values.intensity, resonance, values["mass_ratio"], values["restitution"]
    )
    case = swept_force(model, values.intensity, resonance, values["mass_ratio"])
    advice = search_gap(case, own, members=MEMBERS, progress=watch)
    best = advice.recommended or advice.sharp
    if stop.given or best is None:
        raise Newer
    rule = 1e3 * advice.check.rule
    why = f"lowest level over {100 * advice.tolerance:.0f} % of the force, by {advice.sweeps} sweeps; the design rule says {rule:.3g} mm"
    return {"values": {"gap": best.gap, "friction": best.friction_limit}, "why": why}


def _for_loads(
    values: ControlValues, loading: Loading, watch: Callable[[int, int], None]
) -> dict[str, Any]:
    """Return the gap that a search under a load recommends, with the friction as it is."""
    limits = find_sweep_range(loading.model, values["mass_ratio"], loading.resonance)
    case = CurveCase(Scene(loading.model), np.ones(1), loading.resonance, limits)
    schedule = case.schedules()[0]
    loads = loading.act(values.intensity, schedule)
    assert isinstance(loads, Loads)
    mass_ratio, restitution, friction = (
        values[name] for name in ("mass_ratio", "restitution", "friction")
    )
    applied = AppliedLoads(loading.model, loads, loading.resonance)
    absorber = applied.absorber(mass_ratio, restitution, friction)
    advice = search_gap(applied, absorber, friction_fixed=True, members=MEMBERS, progress=watch)
    if not advice.complete or advice.recommended is None:
        raise Newer
    why = f"lowest {LABELS[applied.measure]} over {100 * advice.tolerance:.0f} % of the load, at {len(advice.check.gaps)} gaps"
    return {"values": {"gap": advice.recommended.gap}, "why": why}
