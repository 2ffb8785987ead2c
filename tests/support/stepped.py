"""Runs of the time-stepping methods with every observer, for the tests of both."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from places import TRUTHS

from impact_env.drive import Drive, FrequencySchedule
from impact_env.families import Observers, family
from impact_env.kernels.motion.observers import Energy, Series, new_counters, new_energy, new_events
from impact_env.methods import Moreau, RungeKutta
from impact_env.modes import ModalModel
from impact_env.parameters import CompliantWalls, SlidingAbsorber, TunedAbsorber, impact_absorber
from impact_env.scene import InitialState, Scene


@dataclass
class Run:
    status: int
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    impacts: NDArray[np.float64]
    phases: NDArray[np.float64]
    states: NDArray[np.float64]
    counters: Any
    energy: Energy
    balance_error: float


def stored_energy(scene: Scene, state: NDArray[np.float64]) -> float:
    model, n = scene.model, scene.model.modes
    distance = state[n] - model.tip_shape @ state[:n]
    energy = 0.5 * np.sum(state[n + 1 : 2 * n + 1] ** 2) + 0.5 * np.sum((model.omega * state[:n]) ** 2)
    if scene.absorber_mass is not None:
        energy += 0.5 * scene.absorber_mass * state[-1] ** 2
    if isinstance(scene.absorber, TunedAbsorber):
        energy += 0.5 * scene.absorber.stiffness * distance**2
    if isinstance(scene.absorber, SlidingAbsorber) and isinstance(scene.absorber.walls, CompliantWalls):
        energy += 0.5 * scene.absorber.walls.stiffness * max(abs(distance) - scene.absorber.walls.gap, 0.0) ** 2
    return float(energy)


def integrate(scene: Scene, drive: Drive, method: Moreau | RungeKutta, initial: InitialState | None = None, sample_dt: float | None = None) -> Run:
    n = scene.model.modes
    start = (initial or InitialState()).vector(scene)
    end = start.copy()
    sample_dt = drive.schedule.pseudo_period / 128 if sample_dt is None else sample_dt
    rows = int(drive.schedule.times[-1] / sample_dt + 1e-9) + 1
    counters, events = new_counters(), new_events(2000)
    series, energy = Series(np.full((rows, 2 * n + 2), np.nan)), new_energy(n)
    status = family(scene, method).run(scene, drive, method, end, sample_dt, Observers(counters, None, events, series, energy))
    work, *other_losses = energy.totals[0].tolist()
    losses = sum(other_losses) + energy.modal.sum() + stored_energy(scene, end) - stored_energy(scene, start)
    scale = max(abs(work), stored_energy(scene, start), 1e-300)
    impacts, phases = events.impacts[: events.counts["impacts"]], events.phases[: events.counts["phases"]]
    return Run(status, start, end, impacts, phases, series.states, counters.counts, energy, abs(work - losses) / scale)


def table(phases: NDArray[Any]) -> NDArray[np.float64]:
    """Return start, end and kind of phases, one row each."""
    return np.column_stack([phases[name] for name in ("start", "end", "kind")])


def still(duration: float, reference: float) -> Drive:
    """No force for a time."""
    return Drive(0.0, FrequencySchedule(np.array([0.0, duration]), np.array([reference, reference]), reference))


def golden(name: str, duration: float) -> tuple[Scene, Drive, NDArray[np.float64], NDArray[np.float64]]:
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


def order(errors: list[float], factor: float = 2.0) -> float:
    """Return the smallest convergence order between neighbours; each step is ``factor`` times smaller than the one before."""
    return float(np.min(np.diff(-np.log(errors)) / np.log(factor)))
