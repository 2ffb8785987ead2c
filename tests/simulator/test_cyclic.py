"""Cyclic structures and forces at several places: closed forms, symmetry under rotation, and refusals."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from core import OMEGA, drive_of

from impact_env import (
    Beam,
    Moreau,
    ParameterError,
    Record,
    Scene,
    impact_absorber,
    modal_model,
    simulate,
)
from impact_env.frequency import receptance, tip_response
from impact_env.loads import Loads, Samples
from impact_env.modes import mode_shapes
from impact_env.periodic.case import Case
from impact_env.structures.cyclic import CyclicStructure, Mistuning, ring_of_masses

HERTZ = OMEGA / (2 * np.pi)


def test_a_ring_of_masses_has_the_frequencies_of_its_nodal_diameters() -> None:
    """In closed form: omega_k^2 = omega_0^2 (1 + 4 kappa sin^2(pi k/N)), each but the first and the last twice."""
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


@pytest.mark.plain
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


@pytest.mark.plain
def test_a_wave_that_travels_turns_the_motion_with_it() -> None:
    """A ring with impacts and friction: the force a k-th of a turn later gives the same motion, one sector on."""
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
        (lambda: RING.scene(impact_absorber(), sectors=[1, 4]), r"sectors = \[1, 4\]"),
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
