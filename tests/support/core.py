"""Runs and truths shared by the tests of the simulator's core. One set of observers for all runs, so that each kernel is compiled once."""

import json
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from places import TRUTHS

from impact_env.drive import Drive, FrequencySchedule
from impact_env.methods import Method
from impact_env.modes import ModalModel
from impact_env.parameters import Absorber, Beam, impact_absorber
from impact_env.response import Record, Response
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
OMEGA = float(beam_scene(Beam(modes=1)).model.omega[0])
PERIOD = 2 * np.pi / OMEGA
STEEL = Beam(length=1.2, bending_stiffness=210e9 * 0.04 * 0.008**3 / 12, mass_per_length=7850 * 0.04 * 0.008, force_position=0.25)
ALL = Record(level=False, events=True, series=True, energy=True, check=True)
EVERYTHING = replace(ALL, level=True)


def run(scene: Scene, drive: Drive, method: Method | None = None, initial: InitialState | None = None, samples: int = 32) -> Response:
    return simulate(scene, drive, method, initial=initial, record=replace(ALL, samples_per_period=samples))


def drive_of(force: float, *ratios: float, periods: float = 5.0, reference: float = OMEGA, phase: float = 0.0) -> Drive:
    """Frequencies (ratios of the reference) joined by straight lines over equal shares of ``periods`` pseudo periods; one ratio is constant."""
    omegas = np.array(ratios if len(ratios) > 1 else ratios * 2) * reference
    return Drive(force, FrequencySchedule(np.linspace(0, periods * 2 * np.pi / reference, len(omegas)), omegas, reference), phase)


def cut(drive: Drive, end: float) -> Drive:
    """Return a drive of one stretch up to a time in s."""
    times, schedule = np.array([0.0, end]), drive.schedule
    return replace(drive, schedule=FrequencySchedule(times, schedule.omega_at(times), schedule.reference))


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
    history = response.history
    return np.asarray(history.absorber_displacement - history.tip_displacement)


def golden(name: str, duration: float) -> tuple[Scene, Drive, Array, Array]:
    """Return a golden case's scene and drive, impact times (s) and relative velocities before impact (m/s)."""
    case = json.loads((TRUTHS / f"golden_{name}.json").read_text())
    model = ModalModel(
        case["omega_rad_s"], [case["damping_ratio"]] * case["modes"], case["phi_force"], case["phi_tip"], case["absorber_mass_kg"] / 0.02
    )
    absorber = impact_absorber(case["gap_m"], case["restitution"], case["friction_limit_N"] or None)
    start, rate = case["excitation"]["start_rad_s"], case["excitation"]["rate_rad_s2"]
    schedule = FrequencySchedule(np.array([0.0, duration]), np.array([start, start + rate * duration]), model.omega[0])
    truths = (np.array(case[key], dtype=float) for key in ("impact_time_s", "pre_impact_relative_velocity_m_s"))
    return Scene(model, absorber), Drive(case["force_amplitude_N"], schedule), *truths
