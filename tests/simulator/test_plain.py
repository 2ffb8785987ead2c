import json
import math
import re
import tomllib
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pytest
from places import ROOT

from impact_env import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    Drive,
    ElasticCoulombFriction,
    Exact,
    FrequencySchedule,
    ModalModel,
    Moreau,
    ParameterError,
    RigidWalls,
    RungeKutta,
    Scene,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    linear_sweep,
)
from impact_env.envs.settings import TaskSettings
from impact_env.fields import list_file_keys, parameter
from impact_env.laws import CONCEPTS
from impact_env.loads import Random, ShakenBase, Shock, Strike, Tone, Tones, Unbalance
from impact_env.parameters import Absorber, Section, friction_law
from impact_env.plain import (
    from_drive,
    from_method,
    from_scene,
    to_beam,
    to_drive,
    to_method,
    to_scene,
)
from impact_env.plain_files import dataclass_keys
from impact_env.plain_structures import PointForce, Profile
from impact_env.scene import InitialState
from impact_env.structures.cyclic import Mistuning
from optimisation.space import design_space

INF = math.inf
NAN = math.nan
PAGE = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
SEVERAL = impact_absorbers((1e-3, 3e-4), (1.0, 0.6), (0.7, 0.0), (None, 0.05), 0.04, (0.3, 0.7))
RARE: list[Absorber | None] = [
    impact_absorber(0.0),  # no clearance
    impact_absorber(INF, friction_limit=0.2),
    impact_absorber(INF),  # nothing in reach
    SEVERAL,
    SeveralAbsorbers(
        (friction_damper(), impact_absorber(INF, 0.5, 0.1), impact_absorber()), (1.0, 0.5, 0.25)
    ),
]


def through_json(plain: dict[str, Any]) -> dict[str, Any]:
    """Return plain data after it was text, which by standard JSON has no infinite number."""
    return json.loads(json.dumps(plain, allow_nan=False))


def assert_same(one: Scene, other: Scene) -> None:
    """Both scenes hold the same bits."""
    for name in ("omega", "damping_ratio", "force_shape", "tip_shape", "absorber_shapes"):
        left = getattr(one.model, name)
        right = getattr(other.model, name)
        assert (left is None) == (right is None), name
        if left is not None:
            assert left.shape == right.shape, name
            assert left.tobytes() == right.tobytes(), name
    assert one.model.beam_mass == other.model.beam_mass
    assert one.absorber == other.absorber
    assert type(one.absorber) is type(other.absorber)


def random_absorber(rng: np.random.Generator) -> Absorber | None:
    mass, gap, restitution, limit, stiffness = (
        float(x) for x in rng.uniform(0.0, 1.0, 5) + [1e-6, 1e-6, 0.0, 1e-6, 1e-6]
    )
    soft = ElasticCoulombFriction(limit, 1e5 * stiffness)
    hard = CoulombFriction(limit)
    some = [
        None,
        StuckAbsorber(mass),
        TunedAbsorber(mass, 1e3 * stiffness, limit),
        SlidingAbsorber(
            mass, RigidWalls(gap, min(restitution, 1.0)), None if rng.random() < 0.5 else hard
        ),
        SlidingAbsorber(
            mass, CompliantWalls(1e7 * stiffness, gap), None if rng.random() < 0.5 else soft
        ),
        SlidingAbsorber(mass, None, hard if rng.random() < 0.5 else soft),
    ]
    return some[rng.integers(len(some))]


def random_beam(rng: np.random.Generator) -> Beam:
    modes = int(rng.integers(1, 5))
    elements = int(rng.integers(3, 6))
    length, stiffness, mass, force, place = (float(x) for x in rng.uniform(0.1, 1.0, 5))
    damping = (
        tuple(rng.uniform(0, 0.1, modes).tolist())
        if rng.random() < 0.5
        else float(rng.uniform(0, 0.1))
    )
    ratios = {mode: float(rng.uniform(1, 30)) for mode in range(2, modes + 1) if rng.random() < 0.4}
    return Beam(length, stiffness, mass, elements, modes, damping, force, place, ratios)


def test_scenes_of_every_kind_come_back_bit_for_bit() -> None:
    rng = np.random.default_rng(7)
    for absorber in (*RARE, *(random_absorber(rng) for _ in range(200))):
        beam = Beam(modes=3) if absorber in RARE else random_beam(rng)
        scene = beam_scene(beam, absorber)
        for plain in (from_scene(scene), from_scene(scene, beam)):
            assert_same(to_scene(through_json(plain)), scene)
        assert to_beam(through_json(from_scene(scene, beam))) == beam
        assert to_beam(from_scene(scene)) is None


def test_a_model_of_any_structure_comes_back() -> None:
    shapes = np.array([[0.1, -0.0], [1 / 3, 1e-300]])
    for absorber_shapes in (None, shapes):
        model = ModalModel(
            [1e-6, 1e6], [0.0, 2.0], [-0.0, 5e-324], [1.0, 1 / 3], 1 / 7, absorber_shapes
        )
        assert_same(to_scene(through_json(from_scene(Scene(model)))), Scene(model))


def test_defaults_are_those_of_the_classes() -> None:
    cases = {
        "impact": impact_absorber(),
        "friction": friction_damper(),
        "tuned": TunedAbsorber(),
        "stuck": StuckAbsorber(),
    }
    for kind, absorber in cases.items():
        assert_same(to_scene({"absorber": {"kind": kind}}), beam_scene(absorber=absorber))
    for nothing in ({}, {"beam": {}, "absorber": None}):
        assert_same(to_scene(nothing), beam_scene())
    assert to_beam({}) == Beam()
    assert to_method({}) == Exact()


def test_several_absorbers_have_masses_of_their_own_or_share_one() -> None:
    def several(*masses: dict[str, Any], **common: Any) -> Any:
        members = [
            {"position": at, "gap": 2e-3} | mass
            for at, mass in zip((1.0, 0.5), masses, strict=True)
        ]
        return to_scene({"absorber": {"kind": "several", "absorbers": members, **common}}).absorber

    two = partial(impact_absorbers, (2e-3, 2e-3), (1.0, 0.5))
    assert several({}, {}) == two()
    assert several({}, {}, mass_ratio=0.1) == two(mass_ratio=0.1)
    assert several({"share": 0.3}, {"share": 0.7}) == two(shares=(0.3, 0.7))
    assert [
        absorber.mass_ratio
        for absorber in several({"mass_ratio": 0.3}, {"mass_ratio": 0.1}).absorbers
    ] == [0.3, 0.1]
    for masses, common in (
        (({"mass_ratio": 0.3}, {}), {}),
        (({"share": 0.3}, {}), {}),
        (({"mass_ratio": 0.3, "share": 0.5}, {"mass_ratio": 0.1, "share": 0.5}), {}),
        (({"mass_ratio": 0.3}, {"mass_ratio": 0.1}), {"mass_ratio": 0.4}),
    ):
        with pytest.raises(ParameterError, match="either a mass_ratio for each, or for none"):
            several(*masses, **common)


def test_drives_and_methods_come_back_bit_for_bit() -> None:
    schedule = FrequencySchedule([0, 1 / 3, 2.0], [100, 0.0, 1e3 / 7], 252.3)
    for drive in (Drive(3.5, linear_sweep(250)), Drive(-1 / 3, schedule, 1.1)):
        back = to_drive(through_json(from_drive(drive)))
        assert (back.amplitude, back.phase, back.schedule.reference) == (
            drive.amplitude,
            drive.phase,
            drive.schedule.reference,
        )
        assert back.schedule.times.tobytes() == drive.schedule.times.tobytes()
        assert back.schedule.omegas.tobytes() == drive.schedule.omegas.tobytes()
    for method in (Exact(), Moreau(), Moreau(50), RungeKutta(30, 40)):
        assert to_method(through_json(from_method(method))) == method


@pytest.mark.parametrize("zero", [0, 0.0, -0.0])
def test_no_friction_is_a_limit_of_zero_everywhere(zero: float) -> None:
    walls = impact_absorber()
    assert friction_law(zero) is None
    assert impact_absorber(friction_limit=zero) == walls
    for limit, same in (((zero, 0.1), (None, 0.1)), (zero, None)):
        two, other = (
            impact_absorbers((1e-3, 1e-3), (1, 0.5), friction_limit=friction)
            for friction in (limit, same)
        )
        assert two == other
    for law in ({}, {"contact_stiffness": 1e5}):
        assert (
            TaskSettings(absorber_options={**law, "friction_limit": zero}).scene.absorber
            == TaskSettings(absorber_options=law).scene.absorber
        )
    for elastic in ({}, {"friction_stiffness": 1e5}):
        assert (
            to_scene({"absorber": {"kind": "impact", "friction_limit": zero, **elastic}}).absorber
            == walls
        )
    assert design_space(
        "impact", ["gap"], fixed={"friction_limit": zero}
    ).default.absorber() == impact_absorber(restitution=0.7)


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


def test_examples_of_the_page_are_the_same_scene_in_both_languages() -> None:
    toml = blocks("toml")
    (*scenes, drive) = blocks("json")
    assert len(toml) == len(scenes) == 3
    for one, other in zip(toml, scenes, strict=True):
        assert tomllib.loads(one) == json.loads(other)
        to_scene(json.loads(other))
    assert to_scene(tomllib.loads(toml[0])).absorber == impact_absorber(1e-3, 0.7, 0.1)
    assert to_scene(tomllib.loads(toml[1])).absorber == impact_absorbers(
        (1e-3, 3e-4), (1.0, 0.6), friction_limit=(0.05, None), shares=(0.75, 0.25)
    )
    assert to_drive(json.loads(drive)).phase == 0


def test_page_names_every_key_with_its_default() -> None:
    described = set(re.findall(r"`(?:\"?)([a-z_0-9]+)(?:\"?)`", PAGE))
    beam = from_scene(beam_scene(), Beam())["beam"]
    for key, value in beam.items():
        assert key in described
        if not isinstance(value, dict):
            printed = f"{value:g}" if isinstance(value, float) else str(value)
            assert f"`{key}` ({printed}" in PAGE or f"`{key}` ({value}" in PAGE, key
    tuned = from_scene(beam_scene(absorber=TunedAbsorber()))["absorber"]
    assert f"`stiffness` ({tuned['stiffness']})" in PAGE
    assert f"`damping` ({tuned['damping']})" in PAGE
    model = from_scene(beam_scene(absorber=SEVERAL))
    keys = {
        *model["model"],
        *model["absorber"],
        *model["absorber"]["absorbers"][0],
        "share",
        *from_drive(Drive(1.0, linear_sweep(1.0))),
    }
    keys |= {name for concept in CONCEPTS.values() for name in concept} | {"steps_per_contact"}
    assert keys <= described, keys - described


DECLARED_KEYS = {
    "scenes.md": (
        (Beam, ()),
        (Section, ()),
        (Profile, ()),
        (PointForce, ("name",)),
        (ModalModel, ("beam", "force_quadrature", "force_places", "force_place_names")),
        (FrequencySchedule, ()),
        (Drive, ("force_place",)),
        (Moreau, ()),
        (RungeKutta, ()),
        (Mistuning, ()),
    ),
    "loads.md": (
        (Drive, ()),
        (Unbalance, ()),
        (ShakenBase, ()),
        (Tone, ("amplitude",)),
        (Tones, ("quantity",)),
        (Random, ("quantity", "number", "factor")),
        (Shock, ("peak", "quantity")),
        (Strike, ()),
        (InitialState, ()),
    ),
}


@pytest.mark.parametrize("page", DECLARED_KEYS)
def test_pages_name_every_key_that_a_field_declares(page: str) -> None:
    words = set(re.findall(r"[a-z_0-9]+", (ROOT / "docs" / page).read_text(encoding="utf-8")))
    for kind, without in DECLARED_KEYS[page]:
        keys = {key for key, name in list_file_keys(kind).items() if name not in without}
        assert keys <= words, (kind, keys - words)


def test_a_key_ends_in_its_unit() -> None:
    @dataclass
    class Example:
        plain: float = 0.0
        force: float = field(default=0.0, metadata=parameter(unit="N"))
        rigidity: float = field(default=0.0, metadata=parameter(unit="N m^2"))
        rate: float = field(default=0.0, metadata=parameter(unit="rad/s"))
        shape: float = field(default=0.0, metadata=parameter(unit="1/sqrt(kg)"))
        length: float = field(default=0.0, metadata=parameter(unit="s", name="duration"))

    assert list_file_keys(Example) == {
        "plain": "plain",
        "force_n": "force",
        "rigidity_n_m2": "rigidity",
        "rate_rad_s": "rate",
        "shape_per_sqrt_kg": "shape",
        "duration_s": "length",
    }
    with pytest.raises(TypeError, match="has no fields rate_rad_s"):
        dataclass_keys(Example, without=("rate_rad_s",))
