"""The state in which a run starts if its force has acted for a long time: the steady state of the linear structure.

A force that appears at once on a structure at rest starts a transient of every mode. Near resonance r the transient of a lower mode k counts about
D omega_r/omega_k of the resonance, with D the damping ratio, and it depends on the force's phase: at high resonances the largest level of a sweep
is then that of its start. From the steady state at the first frequency there is no such transient.

The structure is linear there: an absorber whose friction can carry its inertia moves with it (stuck), another one stays at rest between its walls
(free). Equations: (K - omega^2 M + i omega C) z = f, with M of the beam and the masses that move with it.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.drive import Drive
from impact_env.modes import with_link, with_masses
from impact_env.parameters import (
    CoulombFriction,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    find_largest_gravity,
)
from impact_env.scene import InitialState, Scene

Complex = NDArray[np.complex128]


def find_steady_start(scene: Scene, drive: Drive) -> InitialState | None:
    """Return the steady state of the linear structure at the drive's first frequency; None (rest) if it is infinite, or with gravity.

    Several absorbers are stuck or free each by its own friction. A free absorber is at rest; if the structure moves further than its gap it starts
    at the middle of the cavity and moves with the structure.
    """
    omega = float(drive.schedule.omegas[0])
    force = drive.amplitude * np.exp(1j * drive.phase)

    if find_largest_gravity(scene.absorber) != 0:
        return None
    if isinstance(scene.absorber, TunedAbsorber):
        return _tuned_start(scene, scene.absorber, omega, force)

    shapes = scene.absorber_shapes
    masses = scene.absorber_masses
    sliding = _sliding_absorbers(scene)
    limits = np.zeros(len(masses))
    if isinstance(scene.absorber, StuckAbsorber):
        limits[:] = np.inf
    for k, absorber in enumerate(sliding):
        friction = absorber.friction
        if friction is not None:
            static_ratio = friction.static_ratio if isinstance(friction, CoulombFriction) else 1.0
            limits[k] = friction.limit * static_ratio
    stuck = limits > 0
    while True:
        motion = _modal_motion(scene, omega, force, shapes[stuck], masses[stuck])
        if motion is None:
            return None
        places = shapes @ motion
        slipping = stuck & (masses * omega**2 * np.abs(places) > limits)
        if not np.any(slipping):
            break
        stuck &= ~slipping

    displacement = places.real.copy()
    velocity = (1j * omega * places).real
    for k, absorber in enumerate(sliding):
        fits = absorber.walls is None or abs(places[k]) <= absorber.walls.gap
        if fits and not stuck[k]:
            displacement[k] = 0.0
            velocity[k] = 0.0
    single = len(masses) == 1
    return InitialState(
        motion.real,
        (1j * omega * motion).real,
        float(displacement[0]) if single else displacement,
        float(velocity[0]) if single else velocity,
    )


def _sliding_absorbers(scene: Scene) -> tuple[SlidingAbsorber, ...]:
    """Return the absorbers that slide."""
    if isinstance(scene.absorber, SeveralAbsorbers):
        return scene.absorber.absorbers
    return (scene.absorber,) if isinstance(scene.absorber, SlidingAbsorber) else ()


def _modal_motion(
    scene: Scene,
    omega: float,
    force: complex,
    shapes: NDArray[np.float64],
    masses: NDArray[np.float64],
) -> Complex | None:
    """Return the complex modal displacements (N_m,) with ``masses`` (n,) in kg stuck at places with ``shapes`` (n, N_m); None if infinite."""
    model = scene.model
    stiffness = np.diag(model.omega**2 + 2j * model.damping_ratio * model.omega * omega)
    return _solve(stiffness - omega**2 * with_masses(shapes, masses), force * model.force_shape)


def _tuned_start(
    scene: Scene, absorber: TunedAbsorber, omega: float, force: complex
) -> InitialState | None:
    """Return the steady state of structure and tuned absorber."""
    model = scene.model
    n = model.modes
    stretch = np.append(-model.tip_shape, 1.0)
    mass = np.append(np.ones(n), scene.absorber_masses[0])
    stiffness = with_link(model.omega**2, absorber.stiffness, stretch)
    damping = with_link(2 * model.damping_ratio * model.omega, absorber.damping, stretch)
    matrix = stiffness - omega**2 * np.diag(mass) + 1j * omega * damping
    motion = _solve(matrix, force * np.append(model.force_shape, 0.0))
    if motion is None:
        return None
    rate = (1j * omega * motion).real
    return InitialState(motion.real[:n], rate[:n], float(motion.real[n]), float(rate[n]))


def _solve(matrix: ArrayLike, force: ArrayLike) -> Complex | None:
    """Return the solution of a linear system; None if it is not finite."""
    try:
        motion = np.linalg.solve(np.asarray(matrix), np.asarray(force))
    except np.linalg.LinAlgError:
        return None
    return np.asarray(motion, dtype=np.complex128) if np.isfinite(motion).all() else None
