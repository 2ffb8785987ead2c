from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest

from impact_env import Beam, Drive, ParameterError, Scene, beam_scene, linear_sweep, modal_model
from impact_env.plain import from_drive, from_scene, to_drive, to_scene
from impact_env.plain_files import read_plain

INF, NAN = math.inf, math.nan
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


BAD: list[tuple[Any, str]] = [
    ([], "scene = [] is not allowed: a table with keys among beam, model, universal, matrices, absorber"),
    ({"beams": {}}, "scene.beams = {} is not allowed: only the keys beam, model, universal, matrices, absorber are known"),
    ({"beam": 3}, "scene.beam = 3 is not allowed: a table with keys among length_m"),
    ({"beam": None}, "scene.beam = None"),
    ({"beam": {"length": 0.5}}, "scene.beam.length = 0.5 is not allowed: only the keys length_m"),
    ({"beam": {"length_m": "0.5"}}, "scene.beam.length_m = '0.5' is not allowed: a finite number above 0"),
    ({"beam": {"length_m": True}}, "scene.beam.length_m = True"),
    ({"beam": {"length_m": [0.5]}}, "scene.beam.length_m = [0.5]"),
    ({"beam": {"length_m": 10**400}}, "scene.beam.length_m = a whole number of very many digits"),
    ({"beam": {"bending_stiffness_n_m2": NAN}}, "scene.beam.bending_stiffness_n_m2 = nan"),
    ({"beam": {"mass_per_length_kg_m": INF}}, "scene.beam.mass_per_length_kg_m = inf"),
    ({"beam": {"force_position": 0}}, "scene.beam.force_position = 0 is not allowed: a number in (0, 1]"),
    ({"beam": {"absorber_position": 2}}, "scene.beam.absorber_position = 2"),
    ({"beam": {"modes": 2.0}}, "scene.beam.modes = 2.0 is not allowed: a whole number from 1 to 60"),
    ({"beam": {"elements": 0}}, "scene.beam.elements = 0"),
    ({"beam": {"damping_ratio": -1}}, "scene.beam.damping_ratio = -1"),
    ({"beam": {"damping_ratio": "0.1"}}, "scene.beam.damping_ratio = "),
    ({"beam": {"modes": 2, "damping_ratio": [0.1, "0"]}}, "scene.beam.damping_ratio[1] = '0' is not allowed: a finite number"),
    ({"beam": {"modes": 2, "damping_ratio": [0.1]}}, "scene.beam.damping_ratio = (0.1,) is not allowed: one number, or one for each of the 2 modes"),
    ({"beam": {"modal_frequency_ratio": 5}}, "scene.beam.modal_frequency_ratio = 5"),
    ({"beam": {"modal_frequency_ratio": {"two": 5}}}, "scene.beam.modal_frequency_ratio's mode = 'two'"),
    ({"beam": {"modal_frequency_ratio": {"02": 5}}}, "scene.beam.modal_frequency_ratio's mode = '02'"),
    ({"beam": {"modal_frequency_ratio": {"11": 5}}}, "scene.beam.modal_frequency_ratio's mode = 11"),
    ({"beam": {"modal_frequency_ratio": {"2": 0}}}, "scene.beam.modal_frequency_ratio[2] = 0"),
    ({"beam": {}, "model": MODEL}, "scene.beam = {} is not allowed: left out beside another structure"),
    ({"model": {}}, "scene.model = {} is not allowed: the key damping_ratio must be given"),
    ({"model": {**MODEL, "omega_rad_s": [1, NAN]}}, "scene.model.omega_rad_s[1] = nan"),
    ({"model": {**MODEL, "omega_rad_s": [1, 10**400]}}, "scene.model.omega_rad_s[1] = "),
    ({"model": {**MODEL, "omega_rad_s": [1, -2]}}, "scene.model.omega_rad_s = "),
    ({"model": {**MODEL, "omega_rad_s": []}}, "scene.model.omega_rad_s = []"),
    ({"model": {**MODEL, "omega_rad_s": [1]}}, "scene.model: modal model = "),
    ({"model": {**MODEL, "damping_ratio": 0.1}}, "scene.model.damping_ratio = 0.1 is not allowed: a list of finite numbers"),
    ({"model": {**MODEL, "absorber_shapes_per_sqrt_kg": [1, 2]}}, "scene.model.absorber_shapes_per_sqrt_kg[0] = 1"),
    ({"model": {**MODEL, "absorber_shapes_per_sqrt_kg": [[1, 2], [1]]}}, "scene.model.absorber_shapes_per_sqrt_kg = "),
    ({"model": {**MODEL, "absorber_shapes_per_sqrt_kg": [[1], [1]]}}, "scene.model.absorber_shapes_per_sqrt_kg = "),
    ({"model": MODEL, **several({"position": 1}, {"position": 1})}, "scene: absorber_shapes of the modal model = 0 is not allowed: 2 rows"),
    ({"absorber": "impact"}, "scene.absorber = 'impact' is not allowed: a table of an absorber's values"),
    ({"absorber": {}}, "scene.absorber.kind = None is not allowed: one of impact, friction"),
    ({"absorber": {"kind": ["impact"]}}, "scene.absorber.kind = ['impact']"),
    (absorber(gap_m=1e-3), "scene.absorber.gap_m = 0.001 is not allowed: only the keys mass_ratio, gap, restitution"),
    (absorber(mass_ratio=0), "scene.absorber.mass_ratio = 0"),
    (absorber(gap=NAN), "scene.absorber.gap = nan"),
    (absorber(gap=10**400), "scene.absorber.gap = "),
    ({"beam": {"damping_ratio": 10**400}}, "scene.beam.damping_ratio = "),
    ({"beam": {"modal_frequency_ratio": {"2": 10**400}}}, "scene.beam.modal_frequency_ratio[2] = "),
    (absorber(gap="wide"), "scene.absorber.gap = 'wide'"),
    (absorber(restitution=1.1), "scene.absorber.restitution = 1.1"),
    (absorber(walls={"thickness": 1}), "scene.absorber.walls.thickness = 1 is not allowed"),
    (absorber(contact_stiffness=-1), "scene.absorber.contact_stiffness = -1"),
    (absorber(contact_stiffness=1, gap="infinity"), "scene.absorber.gap = inf"),
    (absorber(friction_stiffness=1), "scene.absorber.friction_stiffness = 1 is not allowed: left out without a friction_limit"),
    (absorber(friction_limit=-1), "scene.absorber.friction_limit = -1 is not allowed: a finite number, 0 or above"),
    (absorber(friction_limit=0, friction_stiffness=0), "scene.absorber.friction_stiffness = 0"),
    (absorber(friction_limit=1, friction_stiffness=1), "walls and friction either both rigid or both compliant"),
    ({"absorber": {"kind": "friction", "friction_limit": 0}}, "scene.absorber.friction_limit = 0 is not allowed: above 0 for a friction damper"),
    ({"absorber": {"kind": "friction", "gap": 1e-3}}, "scene.absorber.gap = 0.001 is not allowed: only the keys mass_ratio, friction_limit"),
    ({"absorber": {"kind": "tuned", "stiffness": 0}}, "scene.absorber.stiffness = 0"),
    ({"absorber": {"kind": "tuned", "damping": NAN}}, "scene.absorber.damping = nan"),
    ({"absorber": {"kind": "several"}}, "the key absorbers must be given"),
    ({"absorber": {"kind": "several", "absorbers": {}}}, "scene.absorber.absorbers = {}"),
    (several(), "scene.absorber: number of absorbers = 0 is not allowed: 2 to 4"),
    (several({"position": 1}), "scene.absorber: number of absorbers = 1 is not allowed: 2 to 4"),
    (several({"position": 1}, {}), "scene.absorber.absorbers[1] = {} is not allowed: the key position must be given"),
    (several({"position": 1}, {"position": 0}), "scene.absorber.absorbers[1].position = 0"),
    (several({"position": 1}, {"position": 1, "mass_ratio": -1}), "scene.absorber.absorbers[1].mass_ratio = -1"),
    (several({"position": 1, "share": 0.5}, {"position": 1, "share": 0.4}), "scene.absorber: shares = (0.5, 0.4)"),
    (several({"position": 1}, {"position": 1, "kind": "tuned"}), "scene.absorber.absorbers[1].kind = 'tuned'"),
    (several({"position": 1}, {"position": 1, "contact_stiffness": 1}), "rigid contact"),
    ({"beam": {"absorber_position": 0.5}, **several({"position": 1}, {"position": 1})}, "scene: absorber_position = 0.5"),
]


@pytest.mark.parametrize(("plain", "message"), BAD)
def test_what_does_not_fit_is_named_by_its_path(plain: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(message)):
        to_scene(plain)


def test_beam_of_another_scene_is_refused() -> None:
    with pytest.raises(ParameterError, match="the beam whose modes the scene has"):
        from_scene(beam_scene(Beam(modes=2)), Beam(modes=3))
    scene = Scene(modal_model(Beam(modes=2), (0.5,)))  # shapes that the beam alone does not have
    with pytest.raises(ParameterError, match="the beam whose modes the scene has"):
        from_scene(scene, Beam(modes=2))


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
