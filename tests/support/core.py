"""Runs and references for the tests of the simulator's core.

All runs have the same set of observers, so that each kernel is compiled once.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from places import TRUTHS

from impact_env.drive import Drive, FrequencySchedule
from impact_env.kernels.motion.observers import STUCK_INSIDE
from impact_env.methods import Method
from impact_env.modes import ModalModel
from impact_env.parameters import (
    Absorber,
    Beam,
    CompliantWalls,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    impact_absorber,
)
from impact_env.results import Record, Response
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
OMEGA = float(beam_scene(Beam(modes=1)).model.omega[0])
PERIOD = 2 * np.pi / OMEGA
STEEL = Beam(
    length=1.2,
    bending_stiffness=210e9 * 0.04 * 0.008**3 / 12,
    mass_per_length=7850 * 0.04 * 0.008,
    force_position=0.25,
)
ALL = Record(level=False, events=True, series=True, energy=True, check=True)
EVERYTHING = replace(ALL, level=True)


def run(
    scene: Scene,
    drive: Drive,
    method: Method | None = None,
    initial: InitialState | None = None,
    samples: int = 32,
) -> Response:
    return simulate(
        scene, drive, method, initial=initial, record=replace(ALL, samples_per_period=samples)
    )


def drive_of(
    force: float, *ratios: float, periods: float = 5.0, reference: float = OMEGA, phase: float = 0.0
) -> Drive:
    """Return a drive whose frequency is piecewise linear over ``periods`` pseudo periods.

    ``ratios`` are relative to the reference and joined by straight lines over equal shares of the
    time. One ratio gives a constant frequency.
    """
    omegas = np.array(ratios if len(ratios) > 1 else ratios * 2) * reference
    return Drive(
        force,
        FrequencySchedule(
            np.linspace(0, periods * 2 * np.pi / reference, len(omegas)), omegas, reference
        ),
        phase,
    )


def cut(drive: Drive, end: float) -> Drive:
    """Return a drive of one stretch up to a time in s."""
    times = np.array([0.0, end])
    schedule = drive.schedule
    return replace(
        drive, schedule=FrequencySchedule(times, schedule.omega_at(times), schedule.reference)
    )


def still(duration: float, reference: float = OMEGA) -> Drive:
    return drive_of(0.0, 1.0, periods=duration * reference / (2 * np.pi), reference=reference)


def steady_base() -> ModalModel:
    """A mode that does not move the tip: an absorber of ratio 1 has a mass of 1 kg."""
    return ModalModel([100.0], [0.0], [0.0], [0.0], 1.0)


def pushed_base() -> ModalModel:
    """A base of 1 kg, as good as free, that a force moves as Newton's law says."""
    return ModalModel([1e-6], [0.0], [1.0], [1.0], 1.0)


def scene_of(absorber: Absorber | None = None, **beam: object) -> Scene:
    return beam_scene(Beam(**({"modes": 3} | beam)), absorber)


def relative_displacement(response: Response) -> Array:
    """Return the absorber's relative displacement (S,), or those of several (S, n), in m."""
    history = response.history
    absorber = response.history.absorber_displacement
    return np.asarray(
        absorber
        - (
            history.tip_displacement
            if absorber.ndim == 1
            else history.modal_displacement @ response.scene.absorber_shapes.T
        )
    )


def check(
    response: Response, error: float = 1e-11, scale: float = 0.0, noise: float = 1e-13
) -> Response:
    """Check energies, walls and lists of a response.

    The energy is balanced, losses are not negative, no rigid wall is penetrated, and the lists of
    impacts and of phases are consistent. ``error`` is relative to the largest term of the balance,
    or to ``scale`` in J if that is larger; ``noise`` is relative to the displacements.
    """
    energy = response.energy
    impacts = response.impacts
    phases = response.phases
    several = response.scene.places > 1
    scale = max(
        scale,
        abs(energy.work),
        float(np.sum(energy.modal_loss)),
        energy.stored_at_start,
        energy.stored_at_end,
    )
    assert abs(energy.balance_error) <= error * scale + 1e-25
    for loss in (
        *energy.modal_loss,
        energy.friction_loss,
        energy.impact_loss,
        energy.absorber_damping,
        *impacts.energy_lost,
    ):
        assert loss >= -1e-15 * scale
    assert np.sum(impacts.energy_lost) == pytest.approx(energy.impact_loss, rel=1e-12, abs=1e-30)
    assert np.all(np.isfinite(response.end_state))
    assert len(impacts.time) == response.impact_count
    assert np.all(
        np.diff(impacts.time) >= (-1e-13 * PERIOD if several else 0)
    )  # of several at one time, within the resolution of time
    assert np.all(phases.end >= phases.start)
    soft = isinstance(getattr(response.scene.absorber, "walls", None), CompliantWalls)
    joined = phases.kind == STUCK_INSIDE if soft else phases.kind >= 0
    if isinstance(response.scene.absorber, SlidingAbsorber | SeveralAbsorbers):
        assert response.stuck_time == pytest.approx(
            np.sum((phases.end - phases.start)[joined]), rel=1e-9, abs=1e-15
        )
    size = np.max(np.abs(response.history.absorber_displacement)) + np.max(
        np.abs(response.history.tip_displacement)
    )
    for a, distance in enumerate(
        relative_displacement(response).reshape(len(response.history.time), -1).T
    ):
        walls = response.scene.cavity(a)
        assert not isinstance(walls, RigidWalls) or np.max(
            np.abs(distance)
        ) <= walls.gap + noise * (walls.gap + size)
    return response


def golden(name: str, duration: float) -> tuple[Scene, Drive, Array, Array]:
    """Return the scene, drive and impacts of a golden case.

    The impacts have times (s) and relative velocities before impact (m/s).
    """
    case = json.loads((TRUTHS / f"golden_{name}.json").read_text())
    model = ModalModel(
        case["omega_rad_s"],
        [case["damping_ratio"]] * case["modes"],
        case["phi_force"],
        case["phi_tip"],
        case["absorber_mass_kg"] / 0.02,
    )
    absorber = impact_absorber(case["gap_m"], case["restitution"], case["friction_limit_N"] or None)
    start = case["excitation"]["start_rad_s"]
    rate = case["excitation"]["rate_rad_s2"]
    schedule = FrequencySchedule(
        np.array([0.0, duration]), np.array([start, start + rate * duration]), model.omega[0]
    )
    truths = (
        np.array(case[key], dtype=float)
        for key in ("impact_time_s", "pre_impact_relative_velocity_m_s")
    )
    return Scene(model, absorber), Drive(case["force_amplitude_N"], schedule), *truths
