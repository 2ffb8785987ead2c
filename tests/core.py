"""Runs and truths shared by the tests of the simulator's core. One set of observers for all runs, so that each kernel is compiled once."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from impact_env import (
    Drive,
    FrequencySchedule,
    InitialState,
    ModalModel,
    Record,
    Response,
    Scene,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    simulate,
)
from impact_env.methods import Method
from impact_env.parameters import Absorber, Beam

Array = NDArray[np.float64]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(14)
OMEGA = float(beam_scene(Beam(modes=1)).model.omega[0])
PERIOD = 2 * np.pi / OMEGA


def run(scene: Scene, drive: Drive, method: Method | None = None, initial: InitialState | None = None, samples: int = 32) -> Response:
    return simulate(
        scene, drive, method, initial=initial, record=Record(level=False, events=True, series=True, energy=True, samples_per_period=samples)
    )


def drive_of(force: float, *ratios: float, periods: float = 5.0, reference: float = OMEGA, phase: float = 0.0) -> Drive:
    """Frequencies (ratios of the reference) joined by straight lines over equal shares of ``periods`` pseudo periods; one ratio is constant."""
    omegas = np.array(ratios if len(ratios) > 1 else ratios * 2) * reference
    return Drive(force, FrequencySchedule(np.linspace(0, periods * 2 * np.pi / reference, len(omegas)), omegas, reference), phase)


def still(duration: float, reference: float = OMEGA) -> Drive:
    return drive_of(0.0, 1.0, periods=duration * reference / (2 * np.pi), reference=reference)


def steady_base(limit_of_motion: float = 0.0) -> ModalModel:
    """A mode that an absorber of ratio 1 does not move: the tip's share of it is ``limit_of_motion``."""
    return ModalModel([100.0], [0.0], [0.0], [limit_of_motion], 1.0)


def pushed_base() -> ModalModel:
    """A base of 1 kg, as good as free, that a force moves as Newton's law says."""
    return ModalModel([1e-6], [0.0], [1.0], [1.0], 1.0)


def scene_of(absorber: Absorber | None = None, **beam: object) -> Scene:
    return beam_scene(Beam(**({"modes": 3} | beam)), absorber)  # type: ignore[arg-type]


def relative_displacement(response: Response) -> Array:
    history = response.history
    assert history is not None
    return np.asarray(history.absorber_displacement - history.tip_displacement)


def first_order(scene: Scene) -> tuple[Array, Array]:
    """Return matrix (2N, 2N) and force column (2N,) of a linear scene; without an absorber or with a stuck one its own coordinate stays at zero."""
    model, n = scene.model, scene.model.modes
    mass, damping, stiffness = np.eye(n + 1), np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    damping[:n, :n], stiffness[:n, :n] = np.diag(2 * model.damping_ratio * model.omega), np.diag(model.omega**2)
    line = np.append(-model.tip_shape, 1.0)
    if isinstance(scene.absorber, TunedAbsorber):
        mass[n, n] = scene.absorber_mass
        damping += scene.absorber.damping * np.outer(line, line)
        stiffness += scene.absorber.stiffness * np.outer(line, line)
    if isinstance(scene.absorber, StuckAbsorber):
        mass[:n, :n] += scene.absorber_mass * np.outer(model.tip_shape, model.tip_shape)  # type: ignore[operator]
    inverse = np.linalg.inv(mass)
    matrix = np.block([[np.zeros_like(mass), np.eye(n + 1)], [-inverse @ stiffness, -inverse @ damping]])
    return matrix, np.concatenate([np.zeros(n + 1), inverse @ np.append(model.force_shape, 0.0)])


def linear_truth(scene: Scene, drive: Drive, times: Array, initial: InitialState | None = None) -> Array:
    """Return modal displacements and velocities (S, 2 N_m) by Duhamel's integral: matrix exponentials and Gauss-Legendre quadrature.

    ``times`` are equidistant, and every break of the schedule is one of them.
    """
    n = scene.model.modes
    matrix, force = first_order(scene)
    step = times[1] - times[0]
    fastest = max(float(np.max(np.abs(np.linalg.eigvals(matrix)))), float(np.max(drive.schedule.omegas)))
    parts = int(np.ceil(step * fastest / 3))
    h = step / parts
    at = 0.5 * h * (1 + NODES)
    whole = scipy.linalg.expm(matrix * h)
    columns = np.array([0.5 * h * w * scipy.linalg.expm(matrix * (h - t)) @ force for w, t in zip(WEIGHTS, at, strict=True)]).T
    x = (initial or InitialState()).vector(scene)
    if not isinstance(scene.absorber, TunedAbsorber):
        x[[n, -1]] = 0.0
    states = [x]
    for k in range(len(times) - 1):
        for part in range(parts):
            # phases from the stretch's own start keep their digits, and a node at a break belongs to this stretch
            f = drive.amplitude * np.cos(drive.schedule.phase_at(times[k] + part * h + at) + drive.phase)
            x = whole @ x + columns @ f
        states.append(x)
    return np.delete(np.array(states), [n, 2 * n + 1], axis=1)
