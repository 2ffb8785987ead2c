"""Scene to linear regimes: the slots, maps and tables that the exact kernels propagate (see kernels/slots.py).

The coupled regimes (absorber stuck, held, or on a spring) share one secular equation. With the force lambda = kappa(s) r between absorber and tip,
kappa = k + c s, a mode i answers phi_i/d_i(s), d_i = s^2 + 2 D_i omega_i s + omega_i^2, and the absorber -1/(m_a s^2), so

    g(s) = 1/kappa(s) + 1/(m_a s^2) + sum phi_i^2/d_i(s) = 0,

with 1/kappa = 0 where absorber and tip are joined. A dense eigensolver gives start values, Newton's method on g full digits, and the eigenvectors
follow in closed form. Mass, damping and stiffness matrices are symmetric, so left and right eigenvectors agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.special
from numpy.typing import NDArray

from impact_env.kernels.segments import Regime
from impact_env.kernels.slots import REST, TAYLOR_TERMS, Slots
from impact_env.modes import MOST_HEAVINESS, ModalModel
from impact_env.parameters import ParameterError, require
from impact_env.tables import ladder, propagators

CRITICAL = 1e-8  # a damping ratio this close to 1 is moved to 1 + CRITICAL: two equal eigenvalues have no modal form
LIGHT, EXTREME = 1e-6, 1e3  # mass over the beam's, and own rates over the beam's first frequency: far beyond, modes on a spring lose their digits
DISTINCT = "damping and stiffness away from a double eigenvalue"
COMPLETE = 1e-8  # the modes of a regime span the state up to this; at 1e-6 a run has lost all but four digits
UNCOUPLED = 1e-9  # of the largest tip shape: a mode with a node at the absorber

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Modes:
    """Eigenvalues (J,), their columns in the state (2 N_m + 2, J), rows from the state (J, 2 N_m + 2), responses to drive and relative force (J,)."""

    values: Complex
    out: Complex
    into: Complex
    drive: Complex
    relative: Complex


def modal_damping(model: ModalModel) -> Real:
    """Return the damping ratios (N_m,) that the regimes use: those of the model, but none closer to 1 than CRITICAL."""
    ratio = np.array(model.damping_ratio)
    return np.where(np.abs(ratio - 1) < CRITICAL, 1 + CRITICAL, ratio)


def own_modes(model: ModalModel, which: Index) -> Modes:
    """Return the free beam's modes ``which`` as slots: one for an oscillating mode, two for an overdamped one."""
    n = model.modes
    values, modes, weights = [], [], []
    ratios = modal_damping(model)
    for i in which:
        omega, ratio = model.omega[i], ratios[i]
        if ratio < 1:
            s = omega * complex(-ratio, np.sqrt((1 - ratio) * (1 + ratio)))
            values.append(s)
            modes.append(i)
            weights.append((1 + 1j * s.real / s.imag, -1j / s.imag))
        else:
            root = omega * np.sqrt((ratio - 1) * (ratio + 1))
            fast = -ratio * omega - root
            slow = omega**2 / fast  # the product of both is omega^2: no cancellation
            for s, other in ((slow, fast), (fast, slow)):
                values.append(complex(s))
                modes.append(i)
                weights.append((-other / (s - other), 1 / (s - other)))
    s = np.array(values, dtype=complex)
    index = np.array(modes, dtype=int)
    alpha, kappa = (np.array(w, dtype=complex) for w in zip(*weights, strict=True)) if weights else (s, s)
    size, row = len(s), np.arange(len(s))
    out, into = np.zeros((2 * n + 2, size), complex), np.zeros((size, 2 * n + 2), complex)
    out[index, row], out[n + 1 + index, row] = 1, s
    into[row, index], into[row, n + 1 + index] = alpha, kappa
    return Modes(s, out, into, kappa * model.force_shape[index], -kappa * model.tip_shape[index])


def _start_values(model: ModalModel, which: Index, mass: float, stiffness: float | None, damper: float) -> Complex:
    """Return approximate eigenvalues of a coupled regime with imaginary part not below 0."""
    omega, ratio, tip = model.omega[which], modal_damping(model)[which], model.tip_shape[which]
    if stiffness is None:
        m, c, k = np.eye(len(omega)) + mass * np.outer(tip, tip), np.diag(2 * ratio * omega), np.diag(omega**2)
    else:
        w = np.append(-tip, 1.0)
        m = np.diag(np.append(np.ones(len(omega)), mass))
        c = np.diag(np.append(2 * ratio * omega, 0)) + damper * np.outer(w, w)
        k = np.diag(np.append(omega**2, 0)) + stiffness * np.outer(w, w)
    return quadratic_values(m, c, k, omega)


def quadratic_values(m: Real, c: Real, k: Real, omega: Real) -> Complex:
    """Return approximate eigenvalues of s^2 m + s c + k with imaginary part not below 0; ``omega``: frequencies of the coupled free modes."""
    squares, vectors = scipy.linalg.eigh(k, m)
    frequencies = np.sqrt(np.maximum(squares, 1e-8 * omega[0] ** 2 if len(omega) else 0))
    zero = np.zeros_like(k)
    block = np.block([[zero, np.diag(frequencies)], [-np.diag(frequencies), -vectors.T @ c @ vectors]])
    values = scipy.linalg.eigvals(block)
    values = np.where(np.abs(values.imag) < 1e-9 * np.abs(values), values.real, values)
    return values[values.imag >= 0]


def _polish(values: Complex, model: ModalModel, which: Index, mass: float, stiffness: float | None, damper: float) -> Complex:
    """Improve eigenvalues by Newton's method on the secular equation."""
    omega, ratio, tip = model.omega[which], modal_damping(model)[which], model.tip_shape[which]
    s = values.copy()
    for _ in range(8):
        d = s[:, None] ** 2 + 2 * ratio * omega * s[:, None] + omega**2
        g = 1 / (mass * s**2) + np.sum(tip**2 / d, axis=1)
        slope = -2 / (mass * s**3) - np.sum(tip**2 * (2 * s[:, None] + 2 * ratio * omega) / d**2, axis=1)
        if stiffness is not None:
            g += 1 / (stiffness + damper * s)
            slope -= damper / (stiffness + damper * s) ** 2
        step = g / slope
        good = np.isfinite(step) & (np.abs(step) < 1e-4 * np.abs(s))
        s = np.where(good, s - np.where(good, step, 0), s)
    return np.where(values.imag == 0, s.real, s)


def _coupled_modes(model: ModalModel, mass: float, stiffness: float | None, damper: float = 0.0) -> Modes:
    """Return the modes of beam and absorber: joined for ``stiffness`` None, else with a spring (N/m) and a damper (N s/m) between them."""
    n = model.modes
    coupled = np.abs(model.tip_shape) > UNCOUPLED * np.max(np.abs(model.tip_shape))
    which = np.flatnonzero(coupled)
    s = _polish(_start_values(model, which, mass, stiffness, damper), model, which, mass, stiffness, damper)
    ratio = modal_damping(model)
    d = s[:, None] ** 2 + 2 * ratio * model.omega * s[:, None] + model.omega**2
    v = np.where(coupled, model.tip_shape, 0) / np.where(coupled, d, 1)  # modal displacements of the eigenvectors, (J, N_m)
    tip = v @ model.tip_shape
    absorber = tip if stiffness is None else -1 / (mass * s**2)
    relative = np.zeros_like(s) if stiffness is None else 1 / (stiffness + damper * s)
    rate = 2 * ratio * model.omega
    norm = 2 * s * (np.sum(v**2, axis=1) + mass * absorber**2) + v**2 @ rate + damper * relative**2
    twice = np.where(s.imag == 0, 1, 2)
    shape = np.concatenate([v, absorber[:, None]], axis=1)
    out = np.concatenate([shape, shape * s[:, None]], axis=1).T * twice
    momentum = shape * np.append(np.ones(n), mass)
    from_displacement = momentum * s[:, None]
    from_displacement[:, :n] += v * rate - damper * relative[:, None] * model.tip_shape
    from_displacement[:, n] += damper * relative
    if stiffness is None:  # the absorber's coordinate is not a freedom here: its share belongs to the tip
        for rows in (momentum, from_displacement):
            rows[:, :n] += rows[:, n : n + 1] * model.tip_shape
            rows[:, n] = 0
    into = np.concatenate([from_displacement, momentum], axis=1) / norm[:, None]
    drive = v @ model.force_shape / norm
    force = (absorber - tip) / norm
    own = own_modes(model, np.flatnonzero(~coupled))
    return Modes(
        np.concatenate([s, own.values]),
        np.concatenate([out, own.out], axis=1),
        np.concatenate([into, own.into]),
        np.concatenate([drive, own.drive]),
        np.concatenate([force, own.relative]),
    )


def padded_size(slots: int) -> int:
    """Return the number of slots after padding to whole vectors of four."""
    return 4 * -(-slots // 4)


def _regime(modes: Modes, guard: Complex, tip: Complex, size: int, reach: float) -> Regime:
    """Sort, pad and tabulate a regime's modes."""
    rows = slot_rows(modes.values, modes.drive, modes.relative, guard, tip, size)
    slots = Slots(rows, *slot_tables(modes.values, size, reach))
    out, into = in_order(modes.out, modes.values, size, 1), in_order(modes.into, modes.values, size).T
    rest = rows[REST] + 1j * rows[REST + 1]
    return Regime(slots, parted(out), parted(into), float(np.real(in_order(tip, modes.values, size) @ rest)))


def in_order(values: Complex, eigenvalues: Complex, size: int, axis: int = 0) -> Complex:
    """Return values (one a slot along ``axis``) in the order of growing |s|, padded with zeros to ``size``."""
    values = np.take(values, np.argsort(np.abs(eigenvalues), kind="stable"), axis=axis)
    return np.pad(values, [(0, size - len(eigenvalues)) if a == axis else (0, 0) for a in range(values.ndim)])


def parted(values: Complex) -> Real:
    """Return real and imaginary parts, one array behind the other."""
    return np.ascontiguousarray([values.real, values.imag])


def _decaying(eigenvalues: Complex, size: int) -> Complex:
    """Return eigenvalues in order; those of padding are -1, and rounding must not make an undamped slot grow."""
    s = in_order(eigenvalues, eigenvalues, size)
    s = np.minimum(s.real, 0) + 1j * s.imag
    s[len(eigenvalues) :] = -1
    return s


def slot_rows(eigenvalues: Complex, drive: Complex, relative: Complex, guard: Complex, tip: Complex, size: int) -> Real:
    """Return Slots.rows from what belongs to each eigenvalue, all (J,) and unsorted."""
    used, s = len(eigenvalues), _decaying(eigenvalues, size)
    real = np.arange(size) < used
    taylor = s ** np.arange(TAYLOR_TERMS)[:, None] / np.array([float(scipy.special.factorial(p)) for p in range(TAYLOR_TERMS)])[:, None]
    taylor[1:, used:] = 0
    drive, relative, guard, tip = (in_order(values, eigenvalues, size) for values in (drive, relative, guard, tip))
    pairs = [s, s**2, drive, relative, np.where(real, -relative / s, 0), guard, tip, *taylor[1:]]
    speed = np.where(real, np.abs(s), 0)
    return np.array([part for pair in pairs for part in (pair.real, pair.imag)] + [speed, speed**2])


def slot_tables(eigenvalues: Complex, size: int, reach: float, speed: float | None = None) -> tuple[Real, Real, Real, Real, Real, Real]:
    """Return table, scale, steps, waves, turns and errors of Slots; ``speed`` (1/s) lays them out as for that largest |s|, None for the own one."""
    used, s = len(eigenvalues), _decaying(eigenvalues, size)
    base, finest, table = propagators(s, used, reach, speed)
    scale = np.array([np.log2(base), finest, 1 / finest, np.max(np.abs(s[:used]))])
    return parted(table), scale, *ladder(s, used, reach, speed)


def check_basis(modes: Modes, states: Index, allowed: str) -> None:
    """Raise ParameterError, saying what is ``allowed``, if the eigenvectors do not span the state."""
    block = np.real(modes.out @ modes.into)[np.ix_(states, states)]
    scale = np.sqrt(np.outer(np.diag(block), 1 / np.diag(block))) if np.all(np.diag(block) > 0) else np.full_like(block, np.nan)
    error = np.max(np.abs(np.diag(block) - 1))
    require(bool(np.isfinite(scale).all()) and error < COMPLETE, "scene", f"modal basis off by {error:.1e}", allowed)


def _needed_of_mass(model: ModalModel, mass: float) -> str:
    """Return how heavy a mass on the tip may be for its modes to have digits, or what else is needed where it is not too heavy."""
    mobility = float(np.sum(model.tip_shape**2))
    if mass * mobility <= MOST_HEAVINESS:
        return DISTINCT
    most = MOST_HEAVINESS / mobility
    return f"an absorber of at most {most / model.beam_mass:.1e} times the beam's mass: a tip that hardly moves has no digits"


def _needed_of_spring(model: ModalModel, mass: float, stiffness: float, damper: float) -> str:
    """Return what a mass on a spring must be for its modes to have digits, or that no two eigenvalues may be alike where it is that."""
    omega, spread = float(np.sqrt(stiffness / mass)), max(1.0, damper / float(np.sqrt(stiffness * mass)))
    slow, fast = (omega * factor / float(model.omega[0]) for factor in (1 / spread, spread))
    critical = bool(np.any(np.abs(modal_damping(model) - 1) < 2 * CRITICAL))
    if critical or (mass >= LIGHT * model.beam_mass and slow >= 1 / EXTREME and fast <= EXTREME):
        return DISTINCT
    rates = f"rates from {1 / EXTREME:g} to {EXTREME:g} times the beam's first frequency"
    own = f"{mass:.3g} kg on {stiffness:.3g} N/m and {damper:.3g} N s/m has rates from {slow:.2g} to {fast:.2g} times"
    return f"an absorber or contact of {LIGHT:g} of the beam's mass or more, with {rates} ({own})"


def _state_index(model: ModalModel, absorber: bool) -> Index:
    n = model.modes
    own = np.concatenate([np.arange(n), n + 1 + np.arange(n)])
    return np.concatenate([own, [n, 2 * n + 1]]) if absorber else own


def free_regime(model: ModalModel, size: int, reach: float) -> Regime:
    """Return the regime of beam and absorber apart. Guard signal: relative displacement absorber - tip, without the absorber's share."""
    modes = own_modes(model, np.arange(model.modes))
    tip = model.tip_shape @ modes.out[: model.modes]
    return _regime(modes, -tip, tip, size, reach)


def joined_regime(model: ModalModel, mass: float, size: int, reach: float) -> Regime:
    """Return the regime of an absorber (kg) that moves with the tip. Guard signal: the force on the absorber, mass times tip acceleration."""
    modes = _coupled_modes(model, mass, None)
    check_basis(modes, _state_index(model, False), _needed_of_mass(model, mass))
    tip = model.tip_shape @ modes.out[: model.modes]
    return _regime(modes, mass * modes.values**2 * tip, tip, size, reach)


def sprung_regime(model: ModalModel, mass: float, stiffness: float, damper: float, size: int, reach: float) -> Regime:
    """Return the regime of an absorber (kg) on a spring (N/m) and a damper (N s/m). Guard signal: relative displacement absorber - tip."""
    modes = _coupled_modes(model, mass, stiffness, damper)
    check_basis(modes, _state_index(model, True), _needed_of_spring(model, mass, stiffness, damper))
    tip = model.tip_shape @ modes.out[: model.modes]
    return _regime(modes, modes.out[model.modes] - tip, tip, size, reach)


def fastest(model: ModalModel, mass: float | None = None, stiffness: float | None = None, damper: float = 0.0) -> tuple[float, int]:
    """Return the largest |s| in 1/s and the number of slots of a regime: free for ``mass`` None, else joined or sprung."""
    try:
        values = own_modes(model, np.arange(model.modes)).values if mass is None else _coupled_modes(model, mass, stiffness, damper).values
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ParameterError(f"the scene has no usable modes: {error}") from error
    return float(np.max(np.abs(values))), len(values)
