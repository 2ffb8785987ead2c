"""Wrong input of the simulator is refused with a message that names it.

These tests cover ranges of numbers, parameters that do not fit together, and messages of plain data
by their paths. The test at the end, which calls everything with wrong values, cannot know these.
"""

import inspect
import math
import re
import warnings
from collections.abc import Callable
from functools import partial
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
    CurveCase,
    Drive,
    InitialState,
    ModalModel,
    Moreau,
    ParameterError,
    Record,
    RigidWalls,
    Scene,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    beam_scene,
    constant_frequency,
    impact_absorber,
    linear_sweep,
    modal_model,
    performance_curve,
)
from impact_env.checks import require
from impact_env.drive import default_rate
from impact_env.ensemble import Lane, Members, draw_members, run_lanes
from impact_env.envs.settings import TaskSettings
from impact_env.frequency import joint_matrices, tip_response
from impact_env.level import response_level
from impact_env.parameters import friction_law
from impact_env.periodic.contact import CompliantContact, RigidContact
from impact_env.plain import from_drive, from_scene, to_drive, to_method, to_scene
from impact_env.plain_files import read_plain

NAN = math.nan
SCENE = beam_scene(Beam(modes=2), impact_absorber())
ONE_MODE: dict[str, Any] = {
    "omega": [1.0],
    "damping_ratio": [0.1],
    "force_shape": [1.0],
    "tip_shape": [1.0],
    "beam_mass": 1.0,
}
LANE = Lane(SCENE, Drive(1.0, constant_frequency(252.0, 1.0, 1.0)))
RUN: dict[str, Any] = {"scene": SCENE, "drive": LANE.drive}


@pytest.mark.parametrize(
    "value",
    [
        impact_absorber(restitution=0.7),
        SeveralAbsorbers((impact_absorber(), impact_absorber()), (1.0, 0.6)),
        RigidWalls(),
        CoulombFriction(0.1),
        StuckAbsorber(),
    ],
    ids=lambda value: type(value).__name__,
)
def test_an_error_describes_an_absorber_in_words(value: object) -> None:
    with pytest.raises(ParameterError) as caught:
        require(False, "absorber", value, "another one")
    text = str(caught.value)
    assert "\n" not in text
    assert not any(f"{name}=" in text for name in ("walls", "mass_ratio", "gap", "limit"))


NAMED: list[
    tuple[str, dict[str, Any], str]
] = [  # what is public, its arguments, and what the error says
    ("Beam", {"modes": 0}, "modes = 0"),
    ("Beam", {"elements": 2, "modes": 5}, "modes = 5"),
    ("Beam", {"damping_ratio": -0.1}, "damping_ratio = -0.1"),
    ("Beam", {"force_position": 0.0}, "force_position = 0.0"),
    ("Beam", {"absorber_position": -0.5}, "absorber_position = -0.5"),
    ("Beam", {"modal_frequency_ratio": {1: 2.0}}, "modal_frequency_ratio's mode = 1"),
    ("RigidWalls", {"gap": -1e-3}, "gap = -0.001"),
    ("RigidWalls", {"restitution": -0.1}, "restitution = -0.1"),
    ("CoulombFriction", {"limit": 0.0}, "friction limit = 0.0"),
    ("ElasticCoulombFriction", {"limit": 1.0, "stiffness": 0.0}, "friction stiffness = 0.0"),
    ("CompliantWalls", {"stiffness": 0.0}, "contact stiffness = 0.0"),
    ("TunedAbsorber", {"stiffness": 0.0}, "absorber stiffness = 0.0"),
    ("TunedAbsorber", {"damping": -1.0}, "absorber damping = -1.0"),
    ("impact_absorber", {"mass_ratio": 0.0}, "mass_ratio = 0.0"),
    ("SlidingAbsorber", {}, "walls, friction or both"),
    (
        "SlidingAbsorber",
        {"walls": CompliantWalls(1.0), "friction": CoulombFriction(1.0)},
        "rigid or both compliant",
    ),
    ("Scene", {"model": SCENE.model, "absorber": CompliantWalls(1.0)}, "absorber"),
    ("linear_sweep", {"reference": 0.0}, "reference"),
    ("linear_sweep", {"reference": 1.0, "start_ratio": -1.0}, "start ratio = -1.0"),
    ("linear_sweep", {"reference": 1.0, "start_ratio": 0.9, "stop_ratio": 0.9}, "stop ratio = 0.9"),
    (
        "linear_sweep",
        {"reference": 1.0, "percent_per_100_periods": 0.0},
        "percent_per_100_periods = 0.0",
    ),
    (
        "FrequencySchedule",
        {"times": [0.0, 1.0, 1.0], "omegas": [1.0, 1.0, 1.0], "reference": 1.0},
        "times",
    ),
    ("FrequencySchedule", {"times": [0.0, 1.0], "omegas": [1.0, -1.0], "reference": 1.0}, "omegas"),
    ("ModalModel", ONE_MODE | {"damping_ratio": [-0.1]}, "damping_ratio"),
    ("ModalModel", ONE_MODE | {"force_shape": [1.0, 2.0]}, "modal model"),
    ("Record", {"samples_per_period": 3}, "samples_per_period = 3"),
    (
        "simulate",
        {**RUN, "initial": InitialState(absorber_displacement=1.001e-3)},
        "absorber_displacement",
    ),
    (
        "simulate",
        {**RUN, "method": Moreau(), "record": Record(reversals=True)},
        "reversals = True is not allowed: with rigid contact and the exact",
    ),
    (
        "simulate",
        {**RUN, "initial": InitialState(modal_displacement=np.zeros(3))},
        "modal_displacement",
    ),
    (
        "simulate",
        {**RUN, "drive": Drive(1.0, linear_sweep(252.0, 0.5, 20.0, 1e4))},
        "samples_per_period = 32 is not allowed: 80 or more",
    ),
    ("performance_curve", {"scene": SCENE, "forces": [1.0, -1.0]}, "forces"),
    ("performance_curve", {"scene": SCENE, "forces": [1.0], "resonance": 3}, "resonance"),
    ("performance_curve", {"scene": SCENE, "forces": [1.0], "limits": (1.06, 0.9)}, "limits"),
]
CALLS: list[tuple[Callable[[], object], str]] = [
    *(
        (partial(getattr(impact_env, name), **arguments), message)
        for name, arguments, message in NAMED
    ),
    (lambda: SCENE.model.pseudo_period(0), "resonance = 0"),
    (lambda: tip_response(SCENE.model, None, -1.0), "omega = -1.0"),
    (lambda: tip_response(ModalModel(**ONE_MODE | {"tip_shape": [0.0]}), None, 1.0), "tip_shape"),
    (lambda: joint_matrices(SCENE.model, SCENE.absorber), "absorber"),
    (
        lambda: from_scene(Scene(modal_model(Beam(modes=2), (0.5,))), Beam(modes=2)),
        "the beam whose modes the scene has",
    ),
    (lambda: friction_law(-1e-300), "friction limit = -1e-300"),
    (lambda: to_method({"kind": "euler"}), "method.kind = 'euler'"),
    (lambda: to_method({"kind": "moreau", "steps_per_period": 3}), "method.steps_per_period = 3"),
    (lambda: to_method({"steps_per_period": 20}), "steps_per_period = 20 is not allowed"),
    (
        lambda: run_lanes(
            [
                LANE,
                Lane(beam_scene(absorber=SlidingAbsorber(walls=CompliantWalls(1e5))), LANE.drive),
            ],
            Moreau(),
        ),
        "method",
    ),
    (lambda: run_lanes([LANE], threads=0), "threads = 0"),
    (lambda: draw_members(0, 0), "members = 0"),
    (lambda: draw_members(2, -1), "seed = -1"),
    (lambda: draw_members(2, 0, "neither"), "kind = 'neither'"),
]


@pytest.mark.parametrize(("call", "message"), CALLS, ids=[message for _, message in CALLS])
def test_what_is_out_of_range_or_does_not_go_together_is_named(
    call: Callable[[], object], message: str
) -> None:
    with pytest.raises(ParameterError, match=re.escape(message)):
        call()


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
    (
        [],
        (
            "scene = [] is not allowed: a table with keys among beam, model, universal, matrices, "
            "nastran, ansys, cyclic, absorber, force, places"
        ),
    ),
    (
        {"beams": {}},
        (
            "scene.beams = {} is not allowed: only the keys beam, model, universal, matrices, "
            "nastran, ansys, cyclic, absorber, force, places are known"
        ),
    ),
    ({"beam": 3}, "scene.beam = 3 is not allowed: a table with keys among length_m"),
    ({"beam": {"length_m": 10**400}}, "scene.beam.length_m = a whole number of very many digits"),
    (
        {"beam": {"modes": 2, "damping_ratio": [0.1, "0"]}},
        "scene.beam.damping_ratio[1] = '0' is not allowed: a finite number",
    ),
    ({"beam": {"modal_frequency_ratio": {"2": 0}}}, "scene.beam.modal_frequency_ratio[2] = 0"),
    (
        {"beam": {}, "model": MODEL},
        "scene.beam = {} is not allowed: left out beside another structure",
    ),
    ({"model": {**MODEL, "omega_rad_s": [1, NAN]}}, "scene.model.omega_rad_s[1] = nan"),
    (
        {"model": {**MODEL, "absorber_shapes_per_sqrt_kg": [1, 2]}},
        "scene.model.absorber_shapes_per_sqrt_kg[0] = 1",
    ),
    (
        {"model": MODEL, **several({"position": 1}, {"position": 1})},
        "scene: absorber_shapes of the modal model = 0 is not allowed: 2 rows",
    ),
    (
        {"absorber": "impact"},
        "scene.absorber = 'impact' is not allowed: a table of an absorber's values",
    ),
    ({"absorber": {}}, "scene.absorber.kind = None is not allowed: one of impact, friction"),
    (absorber(walls={"thickness": 1}), "scene.absorber.walls.thickness = 1 is not allowed"),
    (
        absorber(friction_stiffness=1),
        "scene.absorber.friction_stiffness = 1 is not allowed: left out without a friction_limit",
    ),
    (
        absorber(friction_limit=1, friction_stiffness=1),
        "walls and friction either both rigid or both compliant",
    ),
    (
        {"absorber": {"kind": "friction", "friction_limit": 0}},
        "scene.absorber.friction_limit = 0 is not allowed: above 0 for a friction damper",
    ),
    (several(), "scene.absorber: number of absorbers = 0 is not allowed: 2 to 128"),
    (
        several({"position": 1}, {}),
        "scene.absorber.absorbers[1] = {} is not allowed: the key position must be given",
    ),
    (
        several({"position": 1, "share": 0.5}, {"position": 1, "share": 0.4}),
        "scene.absorber: shares = (0.5, 0.4)",
    ),
    (
        several({"position": 1}, {"position": 1, "kind": "tuned"}),
        "scene.absorber.absorbers[1].kind = 'tuned'",
    ),
    (several({"position": 1}, {"position": 1, "contact_stiffness": 1}), "rigid contact"),
    (
        {"beam": {"absorber_position": 0.5}, **several({"position": 1}, {"position": 1})},
        "scene: absorber_position = 0.5",
    ),
]


@pytest.mark.parametrize(("plain", "message"), PLAIN)
def test_what_does_not_fit_is_named_by_its_path(plain: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(message)):
        to_scene(plain)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"amplitude_n": "1"}, "drive.amplitude_n = '1'"),
        (
            {"phase": 0},
            "drive.phase = 0 is not allowed: only the keys amplitude_n, schedule, phase_rad",
        ),
        (
            {"schedule": {"times_s": [0, 0], "omegas_rad_s": [1, 1], "reference_rad_s": 1}},
            "drive.schedule.times_s = ",
        ),
        (
            {"schedule": {"times_s": [0, 1], "omegas_rad_s": [1, -1], "reference_rad_s": 1}},
            "drive.schedule.omegas_rad_s = ",
        ),
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
        ("a.json", b"\xff", "JSON that can be read"),
    ],
)
def test_bad_files_are_named(name: str, text: str | bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ParameterError, match=re.escape(message)):
        read_plain(tmp_path / name)


def test_files_that_cannot_be_opened_are_named_in_words(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    for name, why in (("none.toml", "there is no such file"), ("folder.toml", "it is a folder")):
        with pytest.raises(ParameterError, match=why) as caught:
            read_plain(tmp_path / name)
        assert "Errno" not in str(caught.value)


@pytest.mark.parametrize(("name", "text"), [("a.toml", "beam = 1\n"), ("a.json", '{"beam": 1}')])
def test_a_byte_order_mark_is_no_key(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert read_plain(tmp_path / name) == {"beam": 1}


# Whatever is handed in to what is public: refused by name, or right.


MADE_BY_RUNS = (
    "Compilation",
    "PerformanceCurve",
    "Preparation",
    "Response",
    "IntegrationError",
    "ParameterError",
    "Stopped",
    "StructureWarning",
)
ELSEWHERE = (
    "Stop",
    "curve_passes",
    "is_ready",
    "prepare",
    "evaluate",
    "__version__",
)  # test_stop_and_passes.py, test_evaluation.py
MORE = {
    make.__name__: make
    for make in (
        CompliantContact,
        CurveCase,
        Lane,
        Members,
        RigidContact,
        TaskSettings,
        default_rate,
        draw_members,
        performance_curve,
        response_level,
        run_lanes,
    )
}
PUBLIC = {
    name: getattr(impact_env, name)
    for name in impact_env.__all__
    if name not in MADE_BY_RUNS + ELSEWHERE
} | MORE
OWN: dict[str, dict[str, Any]] = {
    "Beam": {"modes": 2, "elements": 4},
    "SlidingAbsorber": {"friction": CoulombFriction(0.1)},
    "RigidContact": {"gap": 1e-3, "friction_limit": 0.1},
    "CompliantContact": {
        "gap": 1e-3,
        "stiffness": 1e5,
        "friction_limit": 0.1,
        "friction_stiffness": 1e5,
    },
    "load_structure": {"path": Path(__file__).parents[2] / "docs" / "examples" / "steel_beam.toml"},
    "Window": {"start": 0.0, "end": 1.0},
    "run_lanes": {"lanes": [Lane(handed_in.SCENE, handed_in.DRIVE)]},
}
DEAR = ("performance_curve", "run_lanes")


@pytest.mark.parametrize("name", PUBLIC)
def test_whatever_is_handed_in_is_refused_by_name_or_right(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of numpy, where numbers are extreme
        complaints = list(
            handed_in.complaints(name, PUBLIC[name], OWN.get(name, {}), dear=name in DEAR)
        )
    assert not [problem for problem in complaints if problem is not None]
    assert len(complaints) >= len(handed_in.VALUES) / 2 * len(
        inspect.signature(PUBLIC[name]).parameters
    )
