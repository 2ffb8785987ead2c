"""The table of families: every kind of scene with every method is either simulated or refused, and its key tells compiled kernels apart."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest

from impact_env.controlled import ControlledRuns
from impact_env.drive import Drive, constant_frequency
from impact_env.families import exact, family, kernel_key, stepping
from impact_env.families.table import FAMILIES
from impact_env.laws import SceneKind
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.parameters import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    NonlinearSink,
    ParameterError,
    RigidWalls,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    YieldingWalls,
)
from impact_env.scene import Scene, beam_scene
from impact_env.shared_mass import impact_absorbers
from impact_env.sweep import simulate

RATIO = 0.02
ABSORBERS = {
    "none": None,
    "stuck": StuckAbsorber(RATIO),
    "tuned": TunedAbsorber(RATIO, 600.0, 0.9),
    "walls": SlidingAbsorber(RATIO, RigidWalls(1e-3), None),
    "friction": SlidingAbsorber(RATIO, None, CoulombFriction(0.1)),
    "both": SlidingAbsorber(RATIO, RigidWalls(1e-3), CoulombFriction(0.1)),
    "spring walls": SlidingAbsorber(RATIO, CompliantWalls(1e6, 1e-3), None),
    "spring friction": SlidingAbsorber(RATIO, None, ElasticCoulombFriction(0.1, 1e5)),
    "springs": SlidingAbsorber(RATIO, CompliantWalls(1e6, 1e-3), ElasticCoulombFriction(0.1, 1e5)),
    "yielding": SlidingAbsorber(RATIO, YieldingWalls(0.5, 1e-3)),
    "sink": NonlinearSink(1e8, RATIO),
    "several": impact_absorbers((1e-3, 1e-3), (0.8, 1.0), mass_ratio=0.01),
}
METHODS: tuple[Method, ...] = (Exact(), Moreau(), RungeKutta())
EVERY = list(itertools.product(ABSORBERS, METHODS))
LANES = (
    (exact, "linear_lane"),
    (exact, "exact_lane"),
    (exact, "compliant_lane"),
    (exact, "several_lane"),
    (stepping, "moreau_lane"),
    (stepping, "runge_kutta_lane"),
)


def scene(name: str) -> Scene:
    return beam_scene(Beam(modes=2), ABSORBERS[name])


def drive(of: Scene) -> Drive:
    return Drive(1e-3, constant_frequency(of.model.resonance_omega(1), 1.0, 1.0))


@pytest.mark.parametrize(("name", "method"), EVERY, ids=str)
def test_each_pair_is_in_the_table_or_refused(name: str, method: Method) -> None:
    present = scene(name)
    if (present.kind, type(method)) in FAMILIES:
        assert FAMILIES[present.kind, type(method)] is family(present, method)
    else:
        for what in (lambda: family(present, method), lambda: simulate(present, drive(present), method)):
            with pytest.raises(ParameterError, match=r"method = .* is not allowed"):
                what()


def test_the_table_has_no_row_that_no_scene_meets() -> None:
    assert {(scene(name).kind, type(method)) for name, method in EVERY} >= set(FAMILIES)
    assert {scene(name).kind for name in ABSORBERS} == set(SceneKind)


def test_a_derived_method_is_the_one_that_it_is_derived_from() -> None:
    class Finer(Moreau):
        pass

    assert family(scene("both"), Finer()) is family(scene("both"), Moreau())
    with pytest.raises(ParameterError, match="compliant contact"):
        family(scene("springs"), Finer())


def test_linear_scenes_are_those_whose_response_goes_with_the_force() -> None:
    for name in ABSORBERS:
        present = scene(name)
        omega = present.model.resonance_omega(1)
        method = RungeKutta() if present.kind is SceneKind.SMOOTH else Exact()
        levels = [simulate(present, Drive(force, constant_frequency(omega, 1.0, 30.0)), method).level for force in (1.0, 10.0)]
        goes_with_force = levels[1].value == pytest.approx(10 * levels[0].value, rel=1e-6)
        assert goes_with_force == (present.kind is SceneKind.LINEAR), name


def signatures(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """Return a list to which each call of a lane's kernel adds its name and the types by which numba finds the compiled variant."""
    calls: list[tuple[object, ...]] = []

    def watched(lane: Any) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            calls.append((lane.__name__, *map(numba.typeof, arguments)))
            return lane(*arguments)

        return call

    for module, name in LANES:
        monkeypatch.setattr(module, name, watched(getattr(module, name)))
    return calls


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_scenes_have_one_key_exactly_where_they_share_compiled_kernels(method: Method, monkeypatch: pytest.MonkeyPatch) -> None:
    calls, seen = signatures(monkeypatch), []
    for name in ABSORBERS:
        present = scene(name)
        if (present.kind, type(method)) in FAMILIES:
            simulate(present, drive(present), method)
            seen.append((kernel_key(present, method), calls[-1]))
    assert len(calls) == len(seen) > 3
    for (key, call), (other_key, other_call) in itertools.combinations(seen, 2):
        assert (key == other_key) == (call == other_call), (key, other_key)


def test_control_is_offered_to_all_but_several_absorbers() -> None:
    for name, method in EVERY:
        present = scene(name)
        if (present.kind, type(method)) not in FAMILIES:
            continue
        control = family(present, method).control
        assert (control is None) == (present.kind is SceneKind.SEVERAL)
    with pytest.raises(ParameterError, match="one absorber"):
        ControlledRuns(scene("several"), 1, 250.0, 1.0, samples_per_period=16)
    with pytest.raises(ParameterError, match="elastic friction"):
        ControlledRuns(scene("springs"), 1, 250.0, 1.0, RungeKutta(), samples_per_period=16)
    assert np.isfinite(ControlledRuns(scene("both"), 1, 250.0, 1.0, samples_per_period=16).state).all()
