"""Cyclic structures and forces at several places are correct.

They are compared with closed forms and with rotated motions. Wrong parameters are refused.
"""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from core import OMEGA, drive_of
from places import EXAMPLES, ROOT

from impact_env import (
    Beam,
    Moreau,
    ParameterError,
    Record,
    Scene,
    beam_scene,
    impact_absorber,
    modal_model,
    simulate,
)
from impact_env.frequency import receptance, tip_response
from impact_env.loads import Loads, Samples
from impact_env.modes import mode_shapes
from impact_env.periodic.case import Case
from impact_env.plain import from_disk, load_structure, to_beam, to_disk, to_scene
from impact_env.plain_disks import CYCLIC_KEYS
from impact_env.plain_files import read_plain
from impact_env.structures.cyclic import BladedDisk, CyclicStructure, Mistuning, ring_of_masses

HERTZ = OMEGA / (2 * np.pi)


def test_a_ring_of_masses_has_the_frequencies_of_its_nodal_diameters() -> None:
    """A ring of masses has the frequencies of its nodal diameters.

    In closed form: omega_k^2 = omega_0^2 (1 + 4 kappa sin^2(pi k/N)), each but the first and the
    last twice.
    """
    model = ring_of_masses(10, 0.01, HERTZ).model()
    wave = np.array([0, 1, 1, 2, 2, 3, 3, 4, 4, 5])
    wanted = OMEGA * np.sqrt(1 + 0.04 * np.sin(np.pi * wave / 10) ** 2)
    np.testing.assert_allclose(model.omega, wanted, rtol=1e-13)
    assert model.beam_mass == 10.0


@pytest.mark.parametrize(("order", "twice"), [(0, False), (2, True), (3, True), (5, False)])
@pytest.mark.parametrize("direction", ["forward", "backward", "standing"])
def test_an_engine_order_excites_its_nodal_diameter_alone(
    order: int, twice: bool, direction: str
) -> None:
    ring = ring_of_masses(10, 0.05, HERTZ)
    model = ring.model(order, direction)
    size = np.abs(model.force_pattern)
    driven = np.flatnonzero(size > 1e-9 * np.max(size))
    own = OMEGA * np.sqrt(1 + 0.2 * np.sin(np.pi * order / 10) ** 2)
    np.testing.assert_allclose(model.omega[driven], own, rtol=1e-12)
    travels = twice and direction != "standing"
    assert len(driven) == 2 or not travels
    assert (model.force_quadrature is not None) == travels
    sectors = ring.response_shapes() @ model.force_pattern
    turns = {"forward": -1, "backward": 1}.get(direction)
    angle = 2 * np.pi * order * np.arange(10) / 10
    wanted = np.cos(angle) if turns is None else np.exp(1j * turns * angle)
    np.testing.assert_allclose(sectors, wanted, atol=1e-12)


def test_matrices_of_a_sector_give_the_ring_of_masses() -> None:
    ring = ring_of_masses(7, 0.03, HERTZ, mass=2.0)
    ground = 2.0 * OMEGA**2
    same = CyclicStructure(7, 2.0, ground * 1.06, -0.03 * ground)
    np.testing.assert_allclose(same.model(3).omega, ring.model(3).omega, rtol=1e-14)
    blade = CyclicStructure(
        6,
        np.diag([1.0, 0.2]),
        [[3e4, -1e4], [-1e4, 1e4]],
        [[-2e3, 0.0], [0.0, 0.0]],
        absorber=1,
        response=1,
        sector_mass=1.2,
    )
    mass, stiffness = blade.assemble()
    model = blade.model(1, modes=6)
    wanted = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real))
    np.testing.assert_allclose(model.omega, wanted[:6], rtol=1e-9)
    assert model.beam_mass == pytest.approx(7.2)
    assert len(model.places) == 6


def test_mistuning_is_drawn_by_its_seed() -> None:
    disks = [
        ring_of_masses(200, 0.0, HERTZ, mistuning=Mistuning(0.02, 0.05, seed)) for seed in (1, 1, 2)
    ]
    first, again, other = (disk.model().omega for disk in disks)
    np.testing.assert_array_equal(first, again)
    assert np.max(np.abs(first - other)) > 0
    assert np.std(first / OMEGA) == pytest.approx(0.02, rel=0.2)
    scene = disks[0].scene(impact_absorber(1e-3, 0.8), sectors=range(100))
    gaps = np.array([one.walls.gap for one in scene.absorber.absorbers])
    assert np.std(gaps / 1e-3) == pytest.approx(0.05, rel=0.25)
    assert abs(np.corrcoef(gaps, disks[0].mistuning.factors("frequency", 200)[:100])[0, 1]) < 0.3


def test_forces_at_several_places_add_up_with_their_phases() -> None:
    """The stationary motion of the beam alone is the sum of receptances."""
    model = modal_model(Beam(modes=2, damping_ratio=0.3))
    shapes = mode_shapes(Beam(modes=2), [0.3, 0.8])
    driven = model.with_forces(shapes, [1.0, 0.7], [0.3, -1.1])
    drive = drive_of(2.0, 0.9, periods=7)
    response = simulate(Scene(driven), drive, record=Record(level=False, series=True))
    assert response.history is not None
    total = sum(
        size * np.exp(1j * phase) * receptance(model, 0.9 * OMEGA, model.tip_shape, shape)
        for size, phase, shape in zip((1.0, 0.7), (0.3, -1.1), shapes, strict=True)
    )
    time = response.history.time[-50:]
    wanted = (2.0 * total * np.exp(1j * 0.9 * OMEGA * time)).real
    tip = response.history.modal_displacement[-50:] @ model.tip_shape
    np.testing.assert_allclose(tip, wanted, atol=3e-5 * abs(2.0 * total))


def test_a_wave_that_travels_turns_the_motion_with_it() -> None:
    """A travelling wave carries the motion around the ring.

    The ring has impacts and friction. A force that acts a k-th of a turn later gives the same
    motion, shifted by one sector.
    """
    disk = ring_of_masses(3, 0.05, HERTZ, 0.01)
    scene = disk.scene(impact_absorber(2e-4, 0.8, 0.3), 1)
    first, later = (
        simulate(
            scene,
            drive_of(60.0, 1.02, periods=0.8, phase=0.2 + turn),
            record=Record(level=False, events=True),
        )
        for turn in (0.0, 2 * np.pi / 3)
    )
    shapes = disk.response_shapes()
    assert first.impact_count == later.impact_count >= 4
    sectors = shapes @ first.end_state[:3]
    np.testing.assert_allclose(
        np.roll(shapes @ later.end_state[:3], -1), sectors, atol=1e-9 * np.max(np.abs(sectors))
    )


MASSES: dict[str, Any] = {
    "sectors": 10,
    "coupling": 0.01,
    "frequency_hz": 100.0,
    "mass_kg": 2.0,
}
BLADE: dict[str, Any] = {
    "sectors": 4,
    "mass": [[1.0, 0.0], [0.0, 0.2]],
    "stiffness": [[3e4, -1e4], [-1e4, 1e4]],
    "coupling_stiffness": [[-2e3, 0.0], [500.0, 0.0]],
    "mass_kg": 1.2,
    "absorber": 1,
    "response": 1,
}
ABSORBER: dict[str, Any] = {"kind": "impact", "gap": 5e-5, "restitution": 0.8}


def read_disk(absorber: dict[str, Any] | None = None, **changes: Any) -> BladedDisk:
    """Return the disk of the table of masses with some keys changed."""
    plain: dict[str, Any] = {"cyclic": MASSES | changes}
    disk = to_disk(plain if absorber is None else plain | {"absorber": absorber})
    assert disk is not None
    return disk


def test_a_table_of_masses_is_the_ring_in_closed_form() -> None:
    scene = to_scene({"cyclic": MASSES | {"engine_order": 2}, "absorber": ABSORBER})
    wave = np.array([0, 1, 1, 2, 2, 3, 3, 4, 4, 5])
    wanted = 200 * np.pi * np.sqrt(1 + 0.04 * np.sin(np.pi * wave / 10) ** 2)
    np.testing.assert_allclose(scene.model.omega, wanted, rtol=1e-13)
    np.testing.assert_array_equal(scene.model.damping_ratio, 1e-3)
    assert scene.model.beam_mass == 20.0
    np.testing.assert_allclose(scene.absorber_masses, 0.02 * 2.0, rtol=1e-14)  # of a sector
    driven = np.flatnonzero(np.abs(scene.model.force_pattern) > 1e-9)
    np.testing.assert_array_equal(wave[driven], [2, 2])
    assert to_beam({"cyclic": MASSES}) is None
    assert to_disk({"beam": {}}) is None


@pytest.mark.same_bits
def test_absorbers_of_some_sectors_have_values_of_their_own() -> None:
    gaps = [1e-5, 2e-5, 3e-5]
    limits = [0.1, 0.0, 0.2]
    lists = ABSORBER | {"gap": gaps, "friction_limit": limits, "mass_ratio": [0.01, 0.02, 0.03]}
    disk = read_disk(lists, absorber_sectors=[7, 0, 4])
    scene = disk.scene()
    np.testing.assert_allclose(scene.absorber_masses, [0.02, 0.04, 0.06])
    assert [scene.cavity(k).gap for k in range(3)] == gaps
    read_limits = [0.0 if one.friction is None else one.friction.limit for one in disk.absorbers]
    assert read_limits == limits
    shapes = disk.response_shapes  # of single masses also those at the absorbers
    np.testing.assert_array_equal(scene.absorber_shapes, shapes[[7, 0, 4]])
    tables = [
        {**ABSORBER, "gap": gap, "friction_limit": limit, "mass_ratio": mass}
        for gap, limit, mass in zip(gaps, limits, lists["mass_ratio"], strict=True)
    ]
    same = read_disk({"kind": "several", "absorbers": tables}, absorber_sectors=[7, 0, 4])
    assert same.absorbers == disk.absorbers


@pytest.mark.same_bits
def test_one_sector_with_an_absorber_is_a_single_absorber() -> None:
    disk = read_disk(ABSORBER, absorber_sectors=[3])
    scene = disk.scene()
    assert scene.places == 1
    np.testing.assert_array_equal(scene.model.tip_shape, disk.response_shapes[3])
    np.testing.assert_array_equal(scene.model.level_shape, disk.response_shapes[0])
    assert scene.absorber_mass == pytest.approx(0.04)


@pytest.mark.parametrize("form", [MASSES, BLADE])
@pytest.mark.parametrize(
    "absorber",
    [
        None,
        ABSORBER,
        {"kind": "friction", "friction_limit": [0.1, 0.2]},
        {"kind": "several", "absorbers": [ABSORBER, {"kind": "friction"}]},
    ],
)
def test_a_disk_is_written_and_read_back_bit_for_bit(
    form: dict[str, Any], absorber: dict[str, Any] | None
) -> None:
    own = {
        "mistuning": {"frequency": 0.02, "gap": 0.05, "seed": 3},
        "absorber_sectors": [2, 0],
        "engine_order": 1,
        "direction": "backward",
        "amplitude_n": 0.3,
        "modes": 4,
    }
    plain: dict[str, Any] = {"cyclic": form | own} | ({"absorber": absorber} if absorber else {})
    disk = to_disk(plain)
    assert disk is not None
    written = from_disk(disk)
    again = to_disk(json.loads(json.dumps(written, allow_nan=False)))
    assert again is not None
    assert from_disk(again) == written
    assert again.absorbers == disk.absorbers
    for name in ("omega", "force_pattern", "absorber_shapes", "level_shape"):
        assert getattr(again.model, name).tobytes() == getattr(disk.model, name).tobytes()
    assert again.amplitude == 0.3


def test_a_sector_is_read_from_files_of_matrices_in_their_units(tmp_path: Path) -> None:
    """The ring is assembled here by hand, in t, mm and s as in the files."""
    mass, stiffness, block = (
        np.array(BLADE[k]) for k in ("mass", "stiffness", "coupling_stiffness")
    )
    np.savez(tmp_path / "sector.npz", M=mass / 1e3, K=stiffness / 1e3)
    scipy.io.mmwrite(tmp_path / "coupling.mtx", block / 1e3)
    files = {
        "mass": "sector.npz",
        "stiffness": "sector.npz",
        "coupling_stiffness": "coupling.mtx",
        "units": "t, mm, s",
    }
    disk = to_disk({"cyclic": BLADE | files}, tmp_path)
    assert disk is not None
    ring = np.zeros((8, 8))
    for sector in range(4):
        own = slice(2 * sector, 2 * sector + 2)
        after = slice(2 * ((sector + 1) % 4), 2 * ((sector + 1) % 4) + 2)
        ring[own, own] = stiffness
        ring[own, after] += block
        ring[after, own] += block.T
    squares = np.linalg.eigvals(np.linalg.solve(np.kron(np.eye(4), mass), ring)).real
    np.testing.assert_allclose(disk.model.omega, np.sqrt(np.sort(squares)), rtol=1e-9)
    (tmp_path / "disk.json").write_text(json.dumps({"cyclic": BLADE | files}))
    loaded = load_structure(tmp_path / "disk.json")
    np.testing.assert_array_equal(modal_model(loaded).omega, disk.model.omega)


def test_the_page_names_every_key_of_a_disk() -> None:
    page = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    described = set(re.findall(r"`([a-z_]+)`", page))
    assert set(CYCLIC_KEYS) <= described
    assert to_scene(read_plain(EXAMPLES / "disk.toml")).places == 10


def test_members_are_other_disks_of_the_same_kind() -> None:
    disk = read_disk(ABSORBER, mistuning={"frequency": 0.02, "gap": 0.05, "seed": 5})
    other = read_disk(ABSORBER, mistuning={"frequency": 0.02, "gap": 0.05, "seed": 8})
    np.testing.assert_array_equal(disk.member(3).model.omega, other.model.omega)
    assert disk.member(3).scene().absorber == other.scene().absorber
    np.testing.assert_array_equal(disk.member(0).model.omega, disk.model.omega)
    assert len({one.walls.gap for one in disk.scene().absorber.absorbers}) == 10
    assert len({one.walls.gap for one in disk.tuned().scene().absorber.absorbers}) == 1


LEFT_OUT = object()


@pytest.mark.parametrize(
    ("table", "changes", "message"),
    [
        ("cyclic", {"coupling": -0.1}, r"scene.cyclic.coupling = -0.1 .* 0 or above"),
        (
            "cyclic",
            {"sectors": 0},
            "scene.cyclic.sectors = 0 is not allowed: a whole number from 1",
        ),
        ("cyclic", {"sectors": 2.5}, "scene.cyclic.sectors = 2.5"),
        ("cyclic", {"sectors": LEFT_OUT}, "the key sectors must be given"),
        ("cyclic", {"engine_order": 6}, "engine_order = 6 is not allowed: 0 to 5, half of the"),
        ("cyclic", {"direction": "up"}, "one of forward, backward, standing"),
        ("cyclic", {"absorber_sectors": [0, 2, 2]}, "one or more different sectors, 0 to 9"),
        ("cyclic", {"absorber_sectors": [10]}, "absorber_sectors = 10"),
        ("cyclic", {"absorber_sectors": []}, r"absorber_sectors = \[\]"),
        ("cyclic", {"absorber_sectors": 3}, "a list of sectors, counted from 0"),
        ("cyclic", {"absorber_sectors": [1.5]}, "absorber_sectors = 1.5"),
        ("cyclic", {"modes": 1, "engine_order": 3}, "one that excites a mode of the 1 kept"),
        ("cyclic", {"mistuning": {"frequency": -0.1}}, "scene.cyclic.mistuning.frequency = -0.1"),
        ("cyclic", {"mistuning": {"gaps": 0.1}}, "only the keys frequency, gap, seed"),
        ("cyclic", {"mass_kg": LEFT_OUT}, "scene.cyclic.mass_kg = None .* given, in kg"),
        ("cyclic", {"coupling": LEFT_OUT}, "scene.cyclic.coupling = None"),
        ("cyclic", {"mass": [[1.0]]}, "coupling = 0.01 .* left out of a sector with matrices"),
        ("cyclic", {"force": 0}, "scene.cyclic.force = 0 .* left out of a sector of one mass"),
        ("cyclic", {"colour": 1}, "scene.cyclic.colour = 1 is not allowed: only the keys"),
        ("cyclic", {"amplitude_n": 0.0}, "scene.cyclic.amplitude_n = 0.0"),
        ("absorber", {"gap": [1e-5]}, "'1 of them' .* one for each of the 10 sectors"),
        ("absorber", {"gap": [-1.0] * 10}, r"scene.absorber\[0\].gap = -1.0"),
        ("absorber", {"kind": "tuned", "gap": LEFT_OUT}, "one of impact, friction, several"),
        ("absorber", {"contact_stiffness": 1e5}, "rigid contact"),
        ("blade", {"coupling": 0.1}, "left out of a sector with matrices"),
        ("blade", {"mass": [[1.0, 0.0], [0.0, 0.0]]}, "each degree of freedom of a sector has a"),
        ("blade", {"mass_kg": LEFT_OUT}, "scene.cyclic.mass_kg = None"),
        ("blade", {"force": 2}, "a degree of freedom of a sector, 0 to 1"),
        ("blade", {"coupling_stiffness": [[1.0]]}, "2 rows of 2 finite numbers, as the mass"),
        ("blade", {"coupling_stiffness": "x.full"}, "a file that ends in .npz or .mtx"),
        ("blade", {"stiffness": "none.npz"}, "scene.cyclic.stiffness = 'none.npz'"),
        ("blade", {"stiffness": [[3e4, -1e4], [-1e4, 1e3]]}, "all frequencies above 0"),
        ("blade", {"units": "stone"}, "scene.cyclic.units = 'stone'"),
        ("blade", {"sectors": 3000}, "scene.cyclic.sectors = 3000"),
    ],
)
def test_what_does_not_fit_in_a_table_is_one_error(
    table: str, changes: dict[str, Any], message: str
) -> None:
    plain = {"cyclic": BLADE if table == "blade" else MASSES, "absorber": ABSORBER}
    name = "cyclic" if table == "blade" else table
    plain[name] = {k: v for k, v in (plain[name] | changes).items() if v is not LEFT_OUT}
    with pytest.raises(ParameterError, match=message):
        to_scene(plain)


def test_one_sector_is_the_beam_with_one_mode() -> None:
    """One sector is equal to the beam with one mode, except for rounding.

    The sector's mass is the modal mass at the tip, and the force gives this mass the same motion.
    """
    beam = beam_scene(Beam(modes=1), impact_absorber(5e-4, 0.7, 0.05, 0.02))
    model = beam.model
    shape = float(model.tip_shape[0])
    disk = ring_of_masses(1, 0.0, HERTZ, float(model.damping_ratio[0]), shape**-2)
    absorber = impact_absorber(5e-4, 0.7, 0.05, 0.02 * model.beam_mass * shape**2)
    record = Record(events=True)
    drive = drive_of(12.0, 0.98, 1.0, periods=4.0)
    force = replace(drive, amplitude=drive.amplitude * float(model.force_shape[0]) / shape)
    wanted = simulate(beam, drive, record=record)
    response = simulate(Scene(disk.model(), absorber), force, record=record)
    assert response.impact_count == wanted.impact_count >= 6
    np.testing.assert_allclose(response.impacts.time, wanted.impacts.time, rtol=1e-9)
    assert response.level.value == pytest.approx(wanted.level.value, rel=1e-9)


def test_the_work_of_a_travelling_wave_is_what_the_disk_loses_and_stores() -> None:
    """The work is also the integral of forces times velocities over dense samples of the motion."""
    disk = ring_of_masses(3, 0.05, HERTZ, 0.01)
    scene = disk.scene(impact_absorber(2e-4, 0.8, 0.3), 1)
    drive = drive_of(60.0, 1.02, periods=0.7, phase=0.2)
    record = Record(level=False, series=True, energy=True, samples_per_period=400)
    response = simulate(scene, drive, record=record)
    assert response.impact_count >= 3
    assert response.energy.relative_error < 1e-11
    time = response.history.time
    turn = np.exp(1j * (drive.schedule.phase_at(time) + drive.phase))
    power = np.sum(
        (60.0 * turn[:, None] * scene.model.force_pattern).real * response.history.modal_velocity,
        axis=1,
    )
    last = int(len(time) - 1)
    assert time[last] == pytest.approx(drive.schedule.times[-1], rel=1e-3)
    work = np.sum((power[1:] + power[:-1]) / 2) * time[1]
    assert response.energy.work == pytest.approx(work, rel=2e-3)


RING = ring_of_masses(4, 0.05, HERTZ)
WAVE = RING.scene(impact_absorber(), 1)
RECORD = Samples(np.linspace(0, 0.1, 11), np.ones(11))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ring_of_masses(0, 0.1, HERTZ), "sectors = 0"),
        (lambda: ring_of_masses(4, -0.1, HERTZ), "coupling = -0.1"),
        (lambda: RING.model(3), "engine_order = 3 is not allowed: 0 to 2, half of the sectors"),
        (lambda: RING.model(1, "sideways"), "direction = 'sideways'"),
        (lambda: RING.scene(impact_absorber(), sectors=[1, 1]), r"sectors = \[1, 1\]"),
        (lambda: RING.scene(impact_absorber(), sectors=[1, 4]), "sectors = 4 is not allowed"),
        (lambda: RING.scene([impact_absorber()] * 3), "one for each of the 4 sectors"),
        (lambda: BladedDisk(RING, absorbers=[impact_absorber()]), "'1 absorbers'"),
        (lambda: tip_response(WAVE.model, None, OMEGA), "forces of one phase"),
        (lambda: Case(RING.model(1), OMEGA, 1.0), "forces of one phase"),
        (lambda: Mistuning(0.6), "frequency = 0.6 is not allowed: at most 0.5"),
        (
            lambda: CyclicStructure(3, 1.0, 2.0, -1.0).model(),
            "all frequencies above 0",
        ),
        (
            lambda: CyclicStructure(3, np.eye(2), np.eye(2), np.zeros((2, 2))),
            "sector_mass = None",
        ),
        (
            lambda: CyclicStructure(3, np.eye(2), np.eye(2), [[1.0]]),
            "2 rows of 2 finite numbers",
        ),
        (
            lambda: RING.model().with_forces(RING.response_shapes()[[0, 0]], [1.0, -1.0]),
            "forces that do not cancel",
        ),
        (
            lambda: simulate(WAVE, Loads((RECORD,), reference=OMEGA)),
            "a record or a pulse, which has no phase",
        ),
        (
            lambda: simulate(
                Scene(replace(WAVE.model, absorber_shapes=None), impact_absorber()),
                drive_of(1.0, 1.0),
                Moreau(),
            ),
            "forces of one phase",
        ),
    ],
)
def test_refusals(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make()
