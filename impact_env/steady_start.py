"""Initial state of a run whose load has acted for a long time.

It is the steady state of the linear structure.

A force that appears at once on a structure at rest starts a transient of every mode. Near resonance
r the transient of a lower mode k counts about D omega_r/omega_k of the resonance, with D the
damping ratio, and it depends on the force's phase: at high resonances the largest level of a sweep
is then that of its start. From the steady state at the first frequency there is no such transient.

The structure is linear there: an absorber whose friction can carry its inertia moves with it
(stuck), another one stays at rest between its walls (free). Equations: (K - omega^2 M + i omega C)
z = f, with M of the beam and the masses that move with it. Coordinates are relative to a base that
moves, whose acceleration a acts as the load -(participation + masses that move with the structure)
a, and leaves a free absorber at rest in space. Several harmonic loads, tones and orders of a
schedule, add up; shocks, records and random loads begin at time 0, from the state of the others.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import require
from impact_env.drive import LOAD_STARTS, Excitation, find_schedule
from impact_env.loads import Tones
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


@dataclass(frozen=True)
class _Harmonic:
    """A harmonic load at time 0.

    It has the frequency in rad/s, the complex amplitudes of the force in N and of the base's
    acceleration in m/s^2, and the force's place.
    """

    omega: float
    force: complex
    base: complex
    place: str | None


def find_steady_start(scene: Scene, drive: Excitation) -> InitialState | None:
    """Return the steady state of the linear structure under the harmonic loads.

    The loads have their first frequencies. The result is None (rest) if there is no steady state.

    There is none where it is infinite, with gravity, without a harmonic load, and beside a
    ``start`` of the loads' own. Several absorbers are stuck or free each by its own friction. A
    free absorber is at rest; if the structure moves further than its gap it starts at the middle of
    the cavity and moves with the structure.
    """
    harmonics = _harmonics_of(drive)
    if not harmonics or find_largest_gravity(scene.absorber) != 0:
        return None
    if isinstance(scene.absorber, TunedAbsorber):
        return _tuned_start(scene, scene.absorber, harmonics)

    shapes = scene.absorber_shapes
    masses = scene.absorber_masses
    moved = scene.model.base_at_absorber
    sliding = _sliding_absorbers(scene)
    limits = np.zeros(len(masses))
    if isinstance(scene.absorber, StuckAbsorber):
        limits[:] = np.inf
    for k, absorber in enumerate(sliding):
        friction = absorber.friction
        if friction is not None:
            static_ratio = friction.static_ratio if isinstance(friction, CoulombFriction) else 1.0
            limits[k] = friction.limit * static_ratio
    omegas = np.array([one.omega for one in harmonics])
    bases = np.array([one.base for one in harmonics])
    stuck = limits > 0
    while True:
        rows = [_modal_motion(scene, one, shapes[stuck], masses[stuck]) for one in harmonics]
        if any(row is None for row in rows):
            return None
        motion = np.array(rows)
        places = motion @ shapes.T
        accelerations = -(omegas[:, None] ** 2) * places + moved * bases[:, None]
        inertia = masses * np.sum(np.abs(accelerations), axis=0)
        slipping = stuck & (inertia > limits)
        if not np.any(slipping):
            break
        stuck &= ~slipping

    still = np.zeros(len(harmonics), dtype=complex)  # an absorber at rest in space
    based = bases != 0
    if np.any(omegas[based] == 0):
        return None
    still[based] = moved * bases[based] / omegas[based] ** 2
    displacement = np.sum(places, axis=0).real
    velocity = np.sum(1j * omegas[:, None] * places, axis=0).real
    for k, absorber in enumerate(sliding):
        travel = float(np.sum(np.abs(places[:, k] - still)))
        fits = absorber.walls is None or travel <= absorber.walls.gap
        if fits and not stuck[k]:
            displacement[k] = np.sum(still).real
            velocity[k] = np.sum(1j * omegas * still).real
    single = len(masses) == 1
    return InitialState(
        np.sum(motion, axis=0).real,
        np.sum(1j * omegas[:, None] * motion, axis=0).real,
        float(displacement[0]) if single else displacement,
        float(velocity[0]) if single else velocity,
    )


def _harmonics_of(drive: Excitation) -> list[_Harmonic]:
    """Return the harmonic loads at time 0; empty beside a start of the loads' own."""
    if drive.start != LOAD_STARTS[0]:
        return []
    harmonics = []
    for part in drive.parts:
        if find_schedule(part) is None and not isinstance(part, Tones):
            continue
        for piece in part.pieces():
            omega, _, phase, real, imaginary = piece.rows[0, :5].tolist()
            size = complex(real, imaginary) * complex(np.exp(1j * phase))
            force, base = (0j, size) if piece.moves_base else (size, 0j)
            harmonics.append(_Harmonic(omega, force, base, part.force_place))
    return harmonics


def _sliding_absorbers(scene: Scene) -> tuple[SlidingAbsorber, ...]:
    """Return the absorbers that slide."""
    if isinstance(scene.absorber, SeveralAbsorbers):
        return scene.absorber.absorbers
    return (scene.absorber,) if isinstance(scene.absorber, SlidingAbsorber) else ()


def _load_on_modes(scene: Scene, harmonic: _Harmonic) -> Complex:
    """Return the complex modal load (N_m,) on the structure alone."""
    load = harmonic.force * scene.model.force_pattern_at(harmonic.place)
    if harmonic.base == 0:
        return load
    participation = scene.model.base_participation
    require(participation is not None, "base_participation", None, "given for a base that moves")
    return load - harmonic.base * np.asarray(participation)


def _modal_motion(
    scene: Scene, harmonic: _Harmonic, shapes: NDArray[np.float64], masses: NDArray[np.float64]
) -> Complex | None:
    """Return the complex modal displacements (N_m,) with stuck masses.

    ``masses`` (n,) in kg are stuck at places with ``shapes`` (n, N_m). The result is None if they
    are infinite.
    """
    model = scene.model
    omega = harmonic.omega
    stiffness = np.diag(model.omega**2 + 2j * model.damping_ratio * model.omega * omega)
    load = _load_on_modes(scene, harmonic)
    load = load - model.base_at_absorber * harmonic.base * (masses @ shapes)
    return _solve(stiffness - omega**2 * with_masses(shapes, masses), load)


def _tuned_start(
    scene: Scene, absorber: TunedAbsorber, harmonics: list[_Harmonic]
) -> InitialState | None:
    """Return the steady state of structure and tuned absorber."""
    model = scene.model
    n = model.modes
    absorber_mass = scene.absorber_masses[0]
    stretch = np.append(-model.tip_shape, 1.0)
    mass = np.append(np.ones(n), absorber_mass)
    stiffness = with_link(model.omega**2, absorber.stiffness, stretch)
    damping = with_link(2 * model.damping_ratio * model.omega, absorber.damping, stretch)
    place = np.zeros(n + 1)
    rate = np.zeros(n + 1)
    for one in harmonics:
        matrix = stiffness - one.omega**2 * np.diag(mass) + 1j * one.omega * damping
        on_absorber = -absorber_mass * model.base_at_absorber * one.base
        motion = _solve(matrix, np.append(_load_on_modes(scene, one), on_absorber))
        if motion is None:
            return None
        place += motion.real
        rate += (1j * one.omega * motion).real
    return InitialState(place[:n], rate[:n], float(place[n]), float(rate[n]))


def _solve(matrix: ArrayLike, force: ArrayLike) -> Complex | None:
    """Return the solution of a linear system; None if it is not finite."""
    try:
        motion = np.linalg.solve(np.asarray(matrix), np.asarray(force))
    except np.linalg.LinAlgError:
        return None
    return np.asarray(motion, dtype=np.complex128) if np.isfinite(motion).all() else None
