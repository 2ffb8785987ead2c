"""Linear frequency responses of a modal model, free or with a linear attachment at the tip.

Convention: all quantities vary as the real part of (complex amplitude) * exp(i omega t). Under a
tip displacement q a linear attachment exerts a force T(omega) q on the tip, a rank-one change of
the free receptances (Sherman-Morrison):

    H_ab = G_ab + G_at T G_tb / (1 - G_tt T),
    G_ab = sum_i a_i b_i / (omega_i^2 - omega^2 + 2 i D_i omega_i omega).

For a displacement at the tip (a = t) this is H_tb = G_tb / (1 - G_tt T), without cancellation.
`tip_response` uses this form with numerator and denominator multiplied by the smallest modal
denominator, so that it is exact at an undamped free resonance too.
"""

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import finite, instance, numbers, positive, require
from impact_env.modes import ModalModel, with_link, with_masses
from impact_env.parameters import StuckAbsorber, TunedAbsorber

LinearAbsorber = TunedAbsorber | StuckAbsorber
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

    n = m_a omega^2 K and D = K - m_a omega^2 with K = k + i omega c. For a stuck absorber K is
    infinite.
    """
    require(
        isinstance(absorber, LinearAbsorber),
        "absorber",
        absorber,
        "a TunedAbsorber or a StuckAbsorber (others are not linear)",
    )
    inertia = np.asarray(absorber.mass_ratio * model.beam_mass * omega**2, dtype=np.complex128)
    if isinstance(absorber, StuckAbsorber):
        return inertia, np.ones_like(inertia)
    spring = absorber.stiffness + 1j * omega * absorber.damping
    return inertia * spring, spring - inertia


def tip_response(model: ModalModel, absorber: LinearAbsorber | None, omega: ArrayLike) -> Complex:
    """Return the displacement per newton at the place of the response level, in m/N.

    By default this place is the tip. ``omega`` is in rad/s, of any shape. ``absorber`` is a
    TunedAbsorber (spring and damper between tip and mass), a StuckAbsorber (added mass) or None.
    The result is complex with the shape of omega. Raises ParameterError for bad frequencies,
    another kind of absorber, and if the response is infinite (no damping anywhere).
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

    The coordinates are the free structure's N_m modal coordinates, and with a tuned absorber also
    its displacement (m): n = N_m or N_m + 1.
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
        "a TunedAbsorber or a StuckAbsorber (others are not linear)",
    )
    absorber_mass = absorber.mass_ratio * model.beam_mass
    if isinstance(absorber, StuckAbsorber):
        return (
            with_masses(model.tip_shape[None, :], np.array([absorber_mass])),
            np.diag(rate),
            np.diag(square),
        )
    stretch = np.append(-model.tip_shape, 1.0)
    mass = np.diag(np.append(np.ones(model.modes), absorber_mass))
    return (
        mass,
        with_link(rate, absorber.damping, stretch),
        with_link(square, absorber.stiffness, stretch),
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
