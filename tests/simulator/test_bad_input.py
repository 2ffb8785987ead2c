"""What the walk at the end cannot know: the ranges of numbers, what does not go together, and the messages of plain data, by their paths."""

import inspect
import math
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import handed_in
import numpy as np
import pytest

import impact_env
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
    TunedAbsorber,
    beam_scene,
    constant_frequency,
    friction_damper,
    impact_absorber,
    linear_sweep,
    modal_model,
    simulate,
)
from impact_env.curve import CurveCase, performance_curve
from impact_env.drive import default_rate
from impact_env.ensemble import Lane, Members, draw_members, run_lanes
from impact_env.envs.settings import Settings
from impact_env.frequency import joint_matrices, receptance, tip_response
from impact_env.level import response_level
from impact_env.plain import from_drive, from_scene, to_drive, to_scene
from impact_env.plain_files import read_plain

NAN = math.nan
SCENE = beam_scene(Beam(modes=2), impact_absorber())
ONE = constant_frequency(252.0, 1.0, 1.0)
Refused = tuple[str, Callable[[], object]]


def starting(**start: Any) -> Callable[[], object]:
    return lambda: simulate(SCENE, Drive(1.0, ONE), initial=InitialState(**start))


CALLS: list[Refused] = [
    ("modes = 0", lambda: Beam(modes=0)),
    ("modes = 5", lambda: Beam(elements=2, modes=5)),
    ("damping_ratio = -0.1", lambda: Beam(damping_ratio=-0.1)),
    ("damping_ratio = (0.1, 0.1)", lambda: Beam(damping_ratio=(0.1, 0.1))),
    ("force_position = 0.0", lambda: Beam(force_position=0.0)),
    ("absorber_position = -0.5", lambda: Beam(absorber_position=-0.5)),
    ("modal_frequency_ratio's mode = 1", lambda: Beam(modal_frequency_ratio={1: 2.0})),
    ("modal_frequency_ratio[2] = 0.0", lambda: Beam(modal_frequency_ratio={2: 0.0})),
    ("gap = -0.001", lambda: RigidWalls(-1e-3)),
    ("restitution = -0.1", lambda: RigidWalls(restitution=-0.1)),
    ("friction limit = 0.0", lambda: CoulombFriction(0.0)),
    ("friction stiffness = 0.0", lambda: ElasticCoulombFriction(1.0, 0.0)),
    ("contact stiffness = 0.0", lambda: CompliantWalls(0.0)),
    ("absorber stiffness = 0.0", lambda: TunedAbsorber(stiffness=0.0)),
    ("absorber damping = -1.0", lambda: TunedAbsorber(damping=-1.0)),
    ("mass_ratio = 0.0", lambda: impact_absorber(mass_ratio=0.0)),
    ("walls, friction or both", lambda: SlidingAbsorber()),
    ("rigid or both compliant", lambda: SlidingAbsorber(walls=RigidWalls(), friction=ElasticCoulombFriction(1.0, 1.0))),
    ("rigid or both compliant", lambda: SlidingAbsorber(walls=CompliantWalls(1.0), friction=CoulombFriction(1.0))),
    ("absorber", lambda: Scene(modal_model(Beam(modes=1)), RigidWalls())),
    ("reference", lambda: linear_sweep(0.0)),
    ("start ratio = -1.0", lambda: linear_sweep(1.0, -1.0)),
    ("stop ratio = 0.9", lambda: linear_sweep(1.0, 0.9, 0.9)),
    ("percent_per_100_periods = 0.0", lambda: linear_sweep(1.0, percent_per_100_periods=0.0)),
    ("periods = 0.0", lambda: constant_frequency(1.0, 1.0, 0.0)),
    ("times", lambda: FrequencySchedule([0.0], [1.0], 1.0)),
    ("times", lambda: FrequencySchedule([0.0, 1.0, 1.0], [1.0, 1.0, 1.0], 1.0)),
    ("omegas", lambda: FrequencySchedule([0.0, 1.0], [1.0, -1.0], 1.0)),
    ("resonance = 0", lambda: modal_model(Beam()).pseudo_period(0)),
    ("absorber_displacement", starting(absorber_displacement=1.001e-3)),
    ("absorber_displacement", starting(modal_displacement=np.array([1e-3, 0.0]), absorber_displacement=0.0)),
    ("modal_displacement", starting(modal_displacement=np.zeros(3))),
    ("damping_ratio", lambda: ModalModel([1.0], [-0.1], [1.0], [1.0], 1.0)),
    ("modal model", lambda: ModalModel([1.0], [0.0], [1.0, 2.0], [1.0], 1.0)),
    ("beam_mass", lambda: ModalModel([1.0], [0.0], [1.0], [1.0], 0.0)),
    ("samples_per_period = 3", lambda: Record(samples_per_period=3)),
    ("omega = -1.0", lambda: tip_response(SCENE.model, None, -1.0)),
    ("2 finite modal amplitudes", lambda: receptance(SCENE.model, 1.0, [1.0], SCENE.model.tip_shape)),
    ("absorber", lambda: tip_response(SCENE.model, friction_damper(), 1.0)),
    ("absorber", lambda: joint_matrices(SCENE.model, friction_damper())),
    ("tip_shape", lambda: tip_response(ModalModel([1.0], [0.1], [1.0], [0.0], 1.0), None, 1.0)),
    ("the beam whose modes the scene has", lambda: from_scene(beam_scene(Beam(modes=2)), Beam(modes=3))),
    ("the beam whose modes the scene has", lambda: from_scene(Scene(modal_model(Beam(modes=2), (0.5,))), Beam(modes=2))),
]


@pytest.mark.parametrize(("message", "call"), CALLS, ids=[f"{k} {message}" for k, (message, _) in enumerate(CALLS)])
def test_what_is_out_of_range_or_does_not_go_together_is_named(message: str, call: Callable[[], object]) -> None:
    with pytest.raises(ParameterError, match=re.escape(message)):
        call()


def test_too_few_samples_for_the_level_of_a_fast_force() -> None:
    """At 20 times the reference 32 samples a pseudo period are 1.6 a cycle."""
    scene = beam_scene(Beam(modes=2))
    drive = Drive(1.0, linear_sweep(scene.model.resonance_omega(1), 0.5, 20.0, 1e4))
    with pytest.raises(ParameterError, match=r"samples_per_period = 32 is not allowed: 80 or more"):
        simulate(scene, drive)
    assert simulate(scene, drive, record=Record(samples_per_period=80)).level is not None
    assert simulate(scene, drive, record=Record(level=False)).level is None


MODEL = {
    "omega_rad_s": [100.0, 1 / 3],
    "damping_ratio": [0.01, 0.0],
    "force_shape_per_sqrt_kg": [-0.1, 0.2],
    "tip_shape_per_sqrt_kg": [1.0, 0.7],
    "beam_mass_kg": 0.3,
}


def absorber(**plain: Any) -> dict[str, Any]:
    return {"absorber": {"kind": "impact", **plain}}


def several(*members: dict[str, Any]) -> dict[str, Any]:
    return {"absorber": {"kind": "several", "absorbers": list(members)}}


PLAIN: list[tuple[Any, str]] = [
    ([], "scene = [] is not allowed: a table with keys among beam, model, universal, matrices, absorber"),
    ({"beams": {}}, "scene.beams = {} is not allowed: only the keys beam, model, universal, matrices, absorber are known"),
    ({"beam": 3}, "scene.beam = 3 is not allowed: a table with keys among length_m"),
    ({"beam": {"length": 0.5}}, "scene.beam.length = 0.5 is not allowed: only the keys length_m"),
    ({"beam": {"length_m": "0.5"}}, "scene.beam.length_m = '0.5' is not allowed: a finite number above 0"),
    ({"beam": {"length_m": 10**400}}, "scene.beam.length_m = a whole number of very many digits"),
    ({"beam": {"force_position": 0}}, "scene.beam.force_position = 0 is not allowed: a number in (0, 1]"),
    ({"beam": {"modes": 2, "damping_ratio": [0.1, "0"]}}, "scene.beam.damping_ratio[1] = '0' is not allowed: a finite number"),
    ({"beam": {"modes": 2, "damping_ratio": [0.1]}}, "scene.beam.damping_ratio = (0.1,) is not allowed: one number, or one for each of the 2 modes"),
    ({"beam": {"modal_frequency_ratio": {"two": 5}}}, "scene.beam.modal_frequency_ratio's mode = 'two'"),
    ({"beam": {"modal_frequency_ratio": {"2": 0}}}, "scene.beam.modal_frequency_ratio[2] = 0"),
    ({"beam": {}, "model": MODEL}, "scene.beam = {} is not allowed: left out beside another structure"),
    ({"model": {}}, "scene.model = {} is not allowed: the key damping_ratio must be given"),
    ({"model": {**MODEL, "omega_rad_s": [1, NAN]}}, "scene.model.omega_rad_s[1] = nan"),
    ({"model": {**MODEL, "damping_ratio": "one"}}, "scene.model.damping_ratio = 'one' is not allowed"),
    ({"model": {"modes_csv": "none.csv"}}, "scene.model.modes_csv = 'none.csv' is not allowed: a .csv file"),
    ({"model": {**MODEL, "absorber_shapes_per_sqrt_kg": [1, 2]}}, "scene.model.absorber_shapes_per_sqrt_kg[0] = 1"),
    ({"model": MODEL, **several({"position": 1}, {"position": 1})}, "scene: absorber_shapes of the modal model = 0 is not allowed: 2 rows"),
    ({"absorber": "impact"}, "scene.absorber = 'impact' is not allowed: a table of an absorber's values"),
    ({"absorber": {}}, "scene.absorber.kind = None is not allowed: one of impact, friction"),
    (absorber(gap_m=1e-3), "scene.absorber.gap_m = 0.001 is not allowed: only the keys mass_ratio, gap, restitution"),
    (absorber(walls={"thickness": 1}), "scene.absorber.walls.thickness = 1 is not allowed"),
    (absorber(friction_stiffness=1), "scene.absorber.friction_stiffness = 1 is not allowed: left out without a friction_limit"),
    (absorber(friction_limit=1, friction_stiffness=1), "walls and friction either both rigid or both compliant"),
    ({"absorber": {"kind": "friction", "friction_limit": 0}}, "scene.absorber.friction_limit = 0 is not allowed: above 0 for a friction damper"),
    ({"absorber": {"kind": "several"}}, "the key absorbers must be given"),
    (several(), "scene.absorber: number of absorbers = 0 is not allowed: 2 to 4"),
    (several({"position": 1}, {}), "scene.absorber.absorbers[1] = {} is not allowed: the key position must be given"),
    (several({"position": 1}, {"position": 0}), "scene.absorber.absorbers[1].position = 0"),
    (several({"position": 1, "share": 0.5}, {"position": 1, "share": 0.4}), "scene.absorber: shares = (0.5, 0.4)"),
    (several({"position": 1}, {"position": 1, "kind": "tuned"}), "scene.absorber.absorbers[1].kind = 'tuned'"),
    (several({"position": 1}, {"position": 1, "contact_stiffness": 1}), "rigid contact"),
    ({"beam": {"absorber_position": 0.5}, **several({"position": 1}, {"position": 1})}, "scene: absorber_position = 0.5"),
]


@pytest.mark.parametrize(("plain", "message"), PLAIN)
def test_what_does_not_fit_is_named_by_its_path(plain: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(message)):
        to_scene(plain)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"amplitude_n": "1"}, "drive.amplitude_n = '1'"),
        ({"phase_rad": NAN}, "drive.phase_rad = nan"),
        ({"phase": 0}, "drive.phase = 0 is not allowed: only the keys amplitude_n, phase_rad, schedule"),
        ({"schedule": {"times_s": [0, 1]}}, "the key omegas_rad_s must be given"),
        ({"schedule": {"times_s": [0, 0], "omegas_rad_s": [1, 1], "reference_rad_s": 1}}, "drive.schedule.times_s = "),
        ({"schedule": {"times_s": [0, 1], "omegas_rad_s": [1, -1], "reference_rad_s": 1}}, "drive.schedule.omegas_rad_s = "),
        ({"schedule": {"times_s": [0, 1], "omegas_rad_s": [1, 1], "reference_rad_s": 0}}, "drive.schedule.reference_rad_s = 0"),
    ],
)
def test_bad_drive_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(message)):
        to_drive({**from_drive(Drive(1.0, linear_sweep(250))), **change})


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "beam: 1", r"a.yaml' is not allowed: a name that ends in .toml or .json"),
        ("a.toml", "beam = ", "a.toml' is not allowed: TOML that can be read"),
        ("a.json", "{", "a.json' is not allowed: JSON that can be read"),
        ("a.json", '{"beam": {"modes": 2, "modes": 3}}', "the key modes twice"),
        ("a.json", "[" * 100_000, "JSON that can be read"),
        ("a.json", "[1]", "a table of keys and values"),
        ("a.json", b"\xff", "JSON that can be read"),
        ("a.json", None, "JSON that can be read"),
    ],
)
def test_bad_files_are_named(name: str, text: str | bytes | None, message: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ParameterError, match=re.escape(message)):
        read_plain(tmp_path / name)


# Whatever is handed in to what is public: refused by name, or right.


MADE_BY_RUNS = ("Compilation", "PerformanceCurve", "Preparation", "Response", "IntegrationError", "ParameterError", "Stopped", "StructureWarning")
ELSEWHERE = ("Stop", "curve_passes", "is_ready", "prepare", "evaluate", "__version__")  # test_stop_and_passes.py, test_evaluation.py
MORE = {
    make.__name__: make for make in (CurveCase, Lane, Members, default_rate, draw_members, performance_curve, response_level, run_lanes, Settings)
}
PUBLIC = {name: getattr(impact_env, name) for name in impact_env.__all__ if name not in MADE_BY_RUNS + ELSEWHERE} | MORE
OWN: dict[str, dict[str, Any]] = {
    "Beam": {"modes": 2, "elements": 4},
    "SlidingAbsorber": {"friction": CoulombFriction(0.1)},
    "load_structure": {"path": Path(__file__).parents[2] / "docs" / "examples" / "steel_beam.toml"},
    "Window": {"start": 0.0, "end": 1.0},
    "run_lanes": {"lanes": [Lane(handed_in.SCENE, handed_in.DRIVE)]},
}
DEAR = ("performance_curve", "run_lanes")
RARE = ("SlidingAbsorber", "StuckAbsorber", "SeveralAbsorbers")  # kinds of scenes of their own


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.plain) if name in RARE else name for name in PUBLIC])
def test_whatever_is_handed_in_is_refused_by_name_or_right(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of numpy, where numbers are extreme
        found = list(handed_in.complaints(name, PUBLIC[name], OWN.get(name, {}), dear=name in DEAR))
    assert not [problem for problem in found if problem is not None]
    assert len(found) >= len(handed_in.VALUES) / 2 * len(inspect.signature(PUBLIC[name]).parameters)
