from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from impact_env import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    Drive,
    ElasticCoulombFriction,
    FrequencySchedule,
    InitialState,
    ModalModel,
    ParameterError,
    Record,
    RigidWalls,
    Scene,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    constant_frequency,
    impact_absorber,
    linear_sweep,
    modal_model,
    simulate,
)
from impact_env.methods import Exact, check_supported

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize("name", ["length", "bending_stiffness", "mass_per_length"])
@pytest.mark.parametrize("value", [0.0, -1.0, NAN, INF, "1", None, True])
def test_bad_beam(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        Beam(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"elements": 0}, "elements"),
        ({"elements": 2.5}, "elements"),
        ({"modes": 0}, "modes"),
        ({"modes": 61}, "modes"),
        ({"modes": 1.0}, "modes"),
        ({"elements": 2, "modes": 5}, "modes"),
        ({"damping_ratio": -0.1}, "damping_ratio"),
        ({"damping_ratio": NAN}, "damping_ratio"),
        ({"damping_ratio": INF}, "damping_ratio"),
        ({"damping_ratio": (0.1, 0.1)}, "damping_ratio"),
        ({"modes": 2, "damping_ratio": (0.1, -0.1)}, "damping_ratio"),
        ({"damping_ratio": "small"}, "damping_ratio"),
        ({"damping_ratio": True}, "damping_ratio"),
        ({"damping_ratio": None}, "damping_ratio"),
        ({"force_position": 0.0}, "force_position"),
        ({"force_position": 1.01}, "force_position"),
        ({"absorber_position": NAN}, "absorber_position"),
        ({"absorber_position": -0.5}, "absorber_position"),
        ({"modal_frequency_ratio": {1: 2.0}}, "modal_frequency_ratio"),
        ({"modal_frequency_ratio": {11: 2.0}}, "modal_frequency_ratio"),
        ({"modal_frequency_ratio": {2: 0.0}}, "modal_frequency_ratio"),
        ({"modal_frequency_ratio": {2: INF}}, "modal_frequency_ratio"),
    ],
)
def test_bad_beam_of_other_kinds(arguments: dict[str, object], name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        Beam(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [-1e-3, NAN, "wide", None, True])
def test_bad_gap(value: object) -> None:
    with pytest.raises(ParameterError, match="gap"):
        RigidWalls(value)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="gap"):
        CompliantWalls(1e5, value)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [-0.1, 1.1, NAN, INF, "1", True])
def test_bad_restitution(value: object) -> None:
    with pytest.raises(ParameterError, match="restitution"):
        RigidWalls(restitution=value)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [0.0, -1.0, NAN, INF, "1", None, True])
def test_bad_numbers_above_zero(value: object) -> None:
    for make, name in (
        (CoulombFriction, "friction limit"),
        (lambda x: ElasticCoulombFriction(x, 1e5), "friction limit"),
        (lambda x: ElasticCoulombFriction(1.0, x), "friction stiffness"),
        (CompliantWalls, "contact stiffness"),
        (StuckAbsorber, "mass_ratio"),
        (TunedAbsorber, "mass_ratio"),
        (lambda x: TunedAbsorber(stiffness=x), "absorber stiffness"),
        (lambda x: impact_absorber(mass_ratio=x), "mass_ratio"),
        (lambda x: linear_sweep(x), "reference"),
        (lambda x: linear_sweep(1.0, percent_per_100_periods=x), "percent_per_100_periods"),
        (lambda x: constant_frequency(1.0, 1.0, x), "periods"),
        (lambda x: constant_frequency(x, 1.0, 1.0), "reference"),
    ):
        with pytest.raises(ParameterError, match=name):
            make(value)


@pytest.mark.parametrize("value", [-1.0, NAN, INF, "1", None])
def test_bad_numbers_from_zero(value: object) -> None:
    for make, name in (
        (lambda x: TunedAbsorber(damping=x), "absorber damping"),
        (lambda x: linear_sweep(1.0, x), "start ratio"),
        (lambda x: linear_sweep(1.0, 0.9, x), "stop ratio"),
        (lambda x: constant_frequency(1.0, x, 1.0), "ratio"),
    ):
        with pytest.raises(ParameterError, match=name):
            make(value)


def test_too_few_samples_for_the_level_of_a_fast_force() -> None:
    """At 20 times the reference 32 samples a pseudo period are 1.6 a cycle."""
    scene = beam_scene(Beam(modes=2))
    drive = Drive(1.0, linear_sweep(scene.model.resonance_omega(1), 0.5, 20.0, 1e4))
    with pytest.raises(ParameterError, match=r"samples_per_period = 32 is not allowed: 80 or more"):
        simulate(scene, drive)
    assert simulate(scene, drive, record=Record(samples_per_period=80)).level is not None
    assert simulate(scene, drive, record=Record(level=False)).level is None


def test_an_unknown_absorber_is_of_no_kind() -> None:
    scene = Scene(modal_model(Beam(modes=1)))
    object.__setattr__(scene, "absorber", RigidWalls())
    with pytest.raises(ParameterError, match="absorber"):
        check_supported(scene, Exact())


def test_contradictory_absorbers() -> None:
    with pytest.raises(ParameterError, match="absorber"):
        SlidingAbsorber()
    with pytest.raises(ParameterError, match="rigid or both compliant"):
        SlidingAbsorber(walls=RigidWalls(), friction=ElasticCoulombFriction(1.0, 1.0))
    with pytest.raises(ParameterError, match="rigid or both compliant"):
        SlidingAbsorber(walls=CompliantWalls(1.0), friction=CoulombFriction(1.0))
    with pytest.raises(ParameterError, match="absorber"):
        Scene(modal_model(Beam(modes=1)), RigidWalls())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("times", "omegas"),
    [
        ([0.0], [1.0]),
        ([0.1, 1.0], [1.0, 1.0]),
        ([0.0, 1.0, 1.0], [1.0, 1.0, 1.0]),
        ([0.0, NAN], [1.0, 1.0]),
        ([0.0, 1.0], [1.0, -1.0]),
        ([0.0, 1.0], [1.0, INF]),
        ([0.0, 1.0], [1.0, 1.0, 1.0]),
        ([[0.0, 1.0]], [[1.0, 1.0]]),
    ],
)
def test_bad_schedules(times: list[float], omegas: list[float]) -> None:
    with pytest.raises(ParameterError, match=r"times|omegas"):
        FrequencySchedule(np.array(times), np.array(omegas), 1.0)


def test_bad_drives() -> None:
    schedule = constant_frequency(1.0, 1.0, 1.0)
    with pytest.raises(ParameterError, match="stop ratio"):
        linear_sweep(1.0, 0.9, 0.9)
    for value in (NAN, INF, "1", None):
        with pytest.raises(ParameterError, match="force amplitude"):
            Drive(value, schedule)  # type: ignore[arg-type]
        with pytest.raises(ParameterError, match="phase"):
            Drive(1.0, schedule, value)  # type: ignore[arg-type]


@pytest.mark.parametrize("resonance", [0, 11, -1, 1.5])
def test_bad_resonance(resonance: int) -> None:
    with pytest.raises(ParameterError, match="resonance"):
        modal_model(Beam()).pseudo_period(resonance)


@pytest.mark.parametrize(
    ("initial", "name"),
    [
        ({"absorber_displacement": 1.001e-3}, "absorber_displacement"),
        ({"absorber_displacement": -1.001e-3}, "absorber_displacement"),
        ({"modal_displacement": np.array([1e-3, 0.0]), "absorber_displacement": 0.0}, "absorber_displacement"),
        ({"modal_displacement": np.zeros(3)}, "modal_displacement"),
        ({"modal_velocity": np.array([NAN, 0.0])}, "modal_velocity"),
        ({"absorber_velocity": INF}, "absorber_velocity"),
        ({"absorber_displacement": NAN}, "absorber_displacement"),
        ({"absorber_velocity": [0.0, 1.0]}, "absorber_velocity"),
    ],
)
def test_bad_starts(initial: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        simulate(beam_scene(Beam(modes=2), impact_absorber()), Drive(1.0, constant_frequency(252.0, 1.0, 1.0)), initial=InitialState(**initial))


def test_bad_modal_models() -> None:
    good = ([1.0], [0.0], [1.0], [1.0])
    for at, bad in ((0, [0.0]), (0, [NAN]), (1, [-0.1]), (2, [1.0, 2.0]), (3, [INF])):
        with pytest.raises(ParameterError):
            ModalModel(*[bad if k == at else values for k, values in enumerate(good)], 1.0)  # type: ignore[arg-type]
    for mass in (0.0, -1.0, NAN):
        with pytest.raises(ParameterError, match="beam_mass"):
            ModalModel(*good, mass)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [0, 3, 32.5, -4, True])
def test_bad_sampling(value: object) -> None:
    with pytest.raises(ParameterError, match="samples_per_period"):
        Record(samples_per_period=value)  # type: ignore[arg-type]
