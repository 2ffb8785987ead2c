"""Linear frequency responses of a modal model, and the steady state in which a run starts.

The model is free or has a linear attachment at the tip.

Convention: all quantities vary as the real part of (complex amplitude) * exp(i omega t). Under a
tip displacement q a linear attachment exerts a force T(omega) q on the tip, a rank-one change of
the free receptances (Sherman-Morrison):

    H_ab = G_ab + G_at T G_tb / (1 - G_tt T),
    G_ab = sum_i a_i b_i / (omega_i^2 - omega^2 + 2 i D_i omega_i omega).

For a displacement at the tip (a = t) this is H_tb = G_tb / (1 - G_tt T), without cancellation.
`tip_response` uses this form with numerator and denominator multiplied by the smallest modal
denominator, so that it is exact at an undamped free resonance too.
"""

from dataclasses import dataclass
from typing import get_args

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import finite, instance, numbers, positive, require
from impact_env.drive import LOAD_STARTS, Excitation, find_schedule
from impact_env.laws import Link, find_link
from impact_env.loads import Tones
from impact_env.modes import ModalModel, with_link, with_masses
from impact_env.parameters import (
    CoulombFriction,
    LinearAbsorber,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    find_largest_gravity,
)
from impact_env.scene import InitialState, Scene

LINEAR_ONLY = (
    f"a {' or a '.join(known.__name__ for known in get_args(LinearAbsorber))} "
    "(others are not linear)"
)
Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


def frequency_range(low: float, high: float) -> tuple[float, float]:
    """Return a range as floats; raises ParameterError unless 0 < low < high, both finite."""
    low = positive("low", low)
    high = finite("high", high)
    require(high > low, "high", high, f"above low = {low}")
    return low, high


def _frequencies(omega: ArrayLike) -> Real:
    allowed = "finite frequencies in rad/s, 0 or above"
    values = numbers("omega", omega, allowed)
    require(bool(np.all(np.isfinite(values) & (values >= 0))), "omega", omega, allowed)
    return values


def _shape(model: ModalModel, name: str, row: ArrayLike) -> Real:
    allowed = (
        f"{model.modes} finite modal amplitudes in 1/sqrt(kg), one per mode (e.g. model.tip_shape)"
    )
    values = numbers(name, row, allowed)
    ok = values.shape == (model.modes,) and bool(np.all(np.isfinite(values)))
    require(ok, name, row, allowed)
    return values


def _bounded(omega: Real, response: Complex) -> Complex:
    infinite = omega[~np.isfinite(response)]
    require(
        infinite.size == 0,
        "omega",
        infinite,
        "frequencies off the undamped resonances (the response is infinite)",
    )
    return response


def _denominators(model: ModalModel, omega: Real) -> Complex:
    w = omega[..., None]
    return np.asarray(model.omega**2 - w**2 + 2j * model.damping_ratio * model.omega * w)


def scaled_receptances(
    model: ModalModel, omega: ArrayLike, *shapes: ArrayLike
) -> tuple[Complex, ...]:
    """Return (d, d G_tb for each b in ``shapes``), arrays of omega's shape.

    G_tb is the receptance from a force at b to a displacement at the tip.

    d is the smallest modal denominator (rad^2/s^2) among the modes that move the tip. Products d G
    stay finite where G does not, and every response at the tip is a quotient of such products.
    """
    model = instance("model", model, ModalModel)
    moves = model.tip_shape != 0
    require(
        bool(np.any(moves)), "tip_shape", model.tip_shape, "at least one mode that moves the tip"
    )
    w = _frequencies(omega)
    terms = _denominators(model, w)[..., moves]
    nearest = np.argmin(np.abs(terms), axis=-1)[..., None]
    d = np.take_along_axis(terms, nearest, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = np.asarray(d / terms, dtype=np.complex128)
    np.put_along_axis(weights, nearest, 1.0, axis=-1)
    products: list[Complex] = [d[..., 0]]
    products += [
        weights @ (_shape(model, "shape", b)[moves] * model.tip_shape[moves]) for b in shapes
    ]
    return tuple(products)


def receptance(model: ModalModel, omega: ArrayLike, a: ArrayLike, b: ArrayLike) -> Complex:
    """Return the free structure's displacement at ``a`` per force at ``b`` in m/N.

    ``omega`` is in rad/s, of any shape; ``a`` and ``b`` are rows (N_m,) of mode shapes in
    1/sqrt(kg), such as ``model.tip_shape`` and ``model.force_shape``. The result is complex with
    the shape of omega: the stationary solution of the paper's modal equations (Eq. eqmmod). Raises
    ParameterError for bad frequencies or rows, and if the response is infinite (an undamped mode at
    its own frequency).
    """
    model = instance("model", model, ModalModel)
    w = _frequencies(omega)
    row_a = _shape(model, "a", a)
    row_b = _shape(model, "b", b)
    with np.errstate(divide="ignore", invalid="ignore"):
        response = np.asarray((row_a * row_b / _denominators(model, w)).sum(axis=-1))
    return _bounded(w, response)


def receptance_slope(model: ModalModel, omega: ArrayLike, a: ArrayLike, b: ArrayLike) -> Complex:
    """Return the derivative of `receptance` with respect to omega in m s/(N rad).

    The result is complex and has omega's shape. Arguments and errors are those of `receptance`.
    """
    model = instance("model", model, ModalModel)
    w = _frequencies(omega)
    row_a = _shape(model, "a", a)
    row_b = _shape(model, "b", b)
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = (
            row_a
            * row_b
            * (2 * w[..., None] - 2j * model.damping_ratio * model.omega)
            / _denominators(model, w) ** 2
        )
    return _bounded(w, np.asarray(terms.sum(axis=-1)))


def _attachment(
    model: ModalModel, absorber: LinearAbsorber, omega: Real
) -> tuple[Complex, Complex]:
    """Return n and D of the dynamic stiffness T = n/D (N/m) of an attached absorber.

    n = m_a omega^2 K and D = K - m_a omega^2 with K = k + i omega c of its `Link`. For a stuck
    absorber K is infinite.
    """
    require(
        isinstance(absorber, LinearAbsorber),
        "absorber",
        absorber,
        LINEAR_ONLY,
    )
    absorber_mass = absorber.mass_ratio * model.beam_mass
    inertia = np.asarray(absorber_mass * omega**2, dtype=np.complex128)
    link = find_link(absorber, absorber_mass)
    if link is None:
        return inertia, np.ones_like(inertia)
    spring = link.stiffness + 1j * omega * link.damping
    return inertia * spring, spring - inertia


def tip_response(model: ModalModel, absorber: LinearAbsorber | None, omega: ArrayLike) -> Complex:
    """Return the displacement per newton at the place of the response level, in m/N.

    By default this place is the tip. ``omega`` is in rad/s, of any shape. ``absorber`` is a
    linear one, such as a TunedAbsorber (spring and damper between tip and mass) or a StuckAbsorber
    (added mass), or None. The result is complex with the shape of omega. Raises ParameterError for
    bad frequencies, another kind of absorber, and if the response is infinite (no damping
    anywhere).
    """
    model = instance("model", model, ModalModel)
    w = _frequencies(omega)
    if model.response_shape is not None:
        rows = model.response_shape, model.one_phase_force_shape
        return (
            receptance(model, w, *rows)
            if absorber is None
            else coupled_receptance(model, absorber, w, *rows)
        )
    d, by_force, by_tip = scaled_receptances(model, w, model.one_phase_force_shape, model.tip_shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        if absorber is None:
            return _bounded(w, np.asarray(by_force / d))
        n, denominator = _attachment(model, absorber, w)
        return _bounded(w, np.asarray(by_force * denominator / (d * denominator - by_tip * n)))


def coupled_receptance(
    model: ModalModel, absorber: LinearAbsorber, omega: ArrayLike, a: ArrayLike, b: ArrayLike
) -> Complex:
    """Return the displacement at ``a`` per force at ``b`` in m/N with a linear absorber at the tip.

    Arguments and result are as in `receptance` and `tip_response`. The general Sherman-Morrison
    form loses digits next to a free resonance that is hardly damped, unlike `tip_response`.
    """
    model = instance("model", model, ModalModel)
    w = _frequencies(omega)
    n, denominator = _attachment(model, absorber, w)
    free = receptance(model, w, a, b)
    to_tip = receptance(model, w, a, model.tip_shape)
    from_tip = receptance(model, w, model.tip_shape, b)
    own = receptance(model, w, model.tip_shape, model.tip_shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        return _bounded(w, np.asarray(free + to_tip * n * from_tip / (denominator - own * n)))


def joint_matrices(model: ModalModel, absorber: LinearAbsorber | None) -> tuple[Real, Real, Real]:
    """Return the mass, damping and stiffness matrices of structure and absorber, (n, n) each.

    The coordinates are the free structure's N_m modal coordinates, and with an absorber on a spring
    also its displacement (m): n = N_m or N_m + 1.
    """
    model = instance("model", model, ModalModel)
    rate = 2 * model.damping_ratio * model.omega
    square = model.omega**2
    if absorber is None:
        return np.eye(model.modes), np.diag(rate), np.diag(square)
    require(
        isinstance(absorber, LinearAbsorber),
        "absorber",
        absorber,
        LINEAR_ONLY,
    )
    absorber_mass = absorber.mass_ratio * model.beam_mass
    link = find_link(absorber, absorber_mass)
    if link is None:
        return (
            with_masses(model.tip_shape[None, :], np.array([absorber_mass])),
            np.diag(rate),
            np.diag(square),
        )
    stretch = np.append(-model.tip_shape, 1.0)
    mass = np.diag(np.append(np.ones(model.modes), absorber_mass))
    return (
        mass,
        with_link(rate, link.damping, stretch),
        with_link(square, link.stiffness, stretch),
    )


def natural_frequencies(model: ModalModel, absorber: LinearAbsorber | None) -> Real:
    """Return the undamped natural frequencies in rad/s, in ascending order.

    Their shape is (N_m,), or (N_m + 1,) with a tuned absorber.

    A stuck mass lowers each frequency: frequency r lies between omega_{r-1} and omega_r of the free
    structure. A tuned absorber splits each: frequencies r and r + 1 (from 1) enclose omega_r,
    because its spring is a rank-one change of the free structure together with the free mass.
    """
    model = instance("model", model, ModalModel)
    mass, _, stiffness = joint_matrices(model, absorber)
    return np.asarray(np.sqrt(np.maximum(scipy.linalg.eigvalsh(stiffness, mass), 0.0)))


def state_space(
    model: ModalModel, absorber: LinearAbsorber | None, reference: float
) -> tuple[Real, Real, Real]:
    """Return the state space form A (S, S), b (S,), c (S,) of `tip_response`.

    `tip_response` = c (i omega/reference - A)^-1 b in m/N. ``reference`` is a circular frequency in
    rad/s, and time is in units of 1/reference. The state consists of the coordinates of
    `joint_matrices` and their rates.
    """
    model = instance("model", model, ModalModel)
    mass, damping, stiffness = joint_matrices(model, absorber)
    size = len(mass)
    inverse = np.linalg.inv(mass)
    reference = positive("reference", reference)
    force, tip = (
        np.pad(row, (0, size - model.modes))
        for row in (model.one_phase_force_shape, model.level_shape)
    )
    matrix = np.block(
        [
            [np.zeros((size, size)), np.eye(size)],
            [-inverse @ stiffness / reference**2, -inverse @ damping / reference],
        ]
    )
    return (
        matrix,
        np.concatenate([np.zeros(size), inverse @ force / reference**2]),
        np.concatenate([tip, np.zeros(size)]),
    )


def poles(model: ModalModel, absorber: LinearAbsorber | None) -> Complex:
    """Return the poles s in rad/s of structure and absorber that have a positive imaginary part."""
    model = instance("model", model, ModalModel)
    s = np.linalg.eigvals(state_space(model, absorber, 1.0)[0])
    return np.asarray(s[s.imag > 0], dtype=np.complex128)


# `find_steady_start`: the initial state of a run whose load has acted for a long time, which is the
# steady state of the linear structure.
#
# A force that appears at once on a structure at rest starts a transient of every mode. Near
# resonance r the transient of a lower mode k counts about D omega_r/omega_k of the resonance,
# with D the damping ratio, and it depends on the force's phase: at high resonances the largest
# level of a sweep is then that of its start. From the steady state at the first frequency there
# is no such transient.
#
# The structure is linear there: an absorber whose friction can carry its inertia moves with it
# (stuck), another one stays at rest between its walls (free). Equations: (K - omega^2 M + i omega
# C) z = f, with M of the beam and the masses that move with it. Coordinates are relative to a
# base that moves, whose acceleration a acts as the load -(participation + masses that move with
# the structure) a, and leaves a free absorber at rest in space. Several harmonic loads, tones and
# orders of a schedule, add up; shocks, records and random loads begin at time 0, from the state
# of the others.


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

    The loads have their first frequencies. The result is None (rest) if there is no steady state:
    if it is infinite, with gravity, without a harmonic load, or if the loads have a ``start``. Each
    of several absorbers is stuck or free according to its own friction. A free absorber is at rest;
    if the structure moves further than its gap, it starts in the middle of the cavity and moves
    with the structure.
    """
    harmonics = _harmonics_of(drive)
    if not harmonics or find_largest_gravity(scene.absorber) != 0:
        return None
    if scene.link is not None:
        return _linked_start(scene, scene.link, harmonics)

    shapes = scene.absorber_shapes
    masses = scene.absorber_masses
    moved = scene.model.base_at_absorber
    sliding: tuple[SlidingAbsorber, ...] = ()
    if isinstance(scene.absorber, SeveralAbsorbers):
        sliding = scene.absorber.absorbers
    elif isinstance(scene.absorber, SlidingAbsorber):
        sliding = (scene.absorber,)
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
    """Return the harmonic loads at time 0; none if the loads have a start of their own."""
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


def _linked_start(scene: Scene, link: Link, harmonics: list[_Harmonic]) -> InitialState | None:
    """Return the steady state of a structure and an absorber on a spring and a damper."""
    model = scene.model
    n = model.modes
    absorber_mass = scene.absorber_masses[0]
    stretch = np.append(-model.tip_shape, 1.0)
    mass = np.append(np.ones(n), absorber_mass)
    stiffness = with_link(model.omega**2, link.stiffness, stretch)
    damping = with_link(2 * model.damping_ratio * model.omega, link.damping, stretch)
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
