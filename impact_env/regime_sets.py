"""Several absorbers to linear regimes: one for each set of those that move with the beam (see kernels/sets.py).

The set's masses m_a at places with shapes phi_a make a change of low rank of the mass matrix. With d_i(s) as in regimes.py, psi_a = sqrt(m_a) phi_a
and the matrix

    W(s) = 1/s^2 + psi^T diag(1/d_i(s)) psi        (one row and column for each absorber of the set)

the eigenvalues are where W has a null vector y, and the eigenvectors v_i = psi_i y/d_i. A dense eigensolver gives start values, Newton's
method with y^T W y, which is stationary in y since W is symmetric, full digits. For one absorber this is the secular equation of regimes.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.sets import Sets
from impact_env.kernels.slots import REST, TIP
from impact_env.modes import ModalModel
from impact_env.parameters import require
from impact_env.regimes import UNCOUPLED, in_order, modal_damping, own_modes, padded_size, parted, quadratic_values, slot_rows, slot_tables
from impact_env.tables import table_reach

COMPLETE = 1e-9  # the modes of a set span the state up to this

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


@dataclass(frozen=True)
class SetModes:
    """Modes of a set: eigenvalues (J,), eigenvectors of the beam ``shapes`` (J, N_m), their rows ``into`` from modal displacements and velocities
    (J, 2 N_m), and response ``weights`` (J, N_m) to unit modal forces.
    """  # noqa: D205

    values: Complex
    shapes: Complex
    into: Complex
    weights: Complex


def _twice(values: Complex) -> Real:
    """Return 2 for each pair of complex eigenvalues, of which one stands for both, and 1 for a real one, (J,)."""
    return np.where(values.imag == 0, 1.0, 2.0)


def _own(model: ModalModel, which: NDArray[np.int64]) -> SetModes:
    modes, n = own_modes(model, which), model.modes
    shapes = modes.out[:n].T / _twice(modes.values)[:, None]
    return SetModes(modes.values, shapes, np.delete(modes.into, [n, 2 * n + 1], axis=1), modes.into[:, n + 1 : 2 * n + 1])


def set_modes(model: ModalModel, masses: Real, shapes: Real) -> SetModes:
    """Return the modes of a beam that carries ``masses`` (p,) in kg at places with ``shapes`` (p, N_m); none of them: the free beam.

    Raises ParameterError where two eigenvalues (almost) coincide, so that there is no modal basis.
    """
    if len(masses) == 0:
        return _own(model, np.arange(model.modes))
    coupled = np.any(np.abs(shapes) > UNCOUPLED * np.max(np.abs(shapes), axis=1, keepdims=True), axis=0)
    which = np.flatnonzero(coupled)
    psi = (np.sqrt(masses)[:, None] * shapes)[:, which]
    omega, rate = model.omega[which], (2 * modal_damping(model) * model.omega)[which]
    start = quadratic_values(np.eye(len(which)) + psi.T @ psi, np.diag(rate), np.diag(omega**2), omega)
    s, y = _polish(start, psi, omega, rate)
    v = (y @ psi) / (s[:, None] ** 2 + rate * s[:, None] + omega**2)
    momentum = v + (v @ psi.T) @ psi
    norm = (2 * s * np.sum(v * momentum, axis=1) + v**2 @ rate)[:, None]
    own = _own(model, np.flatnonzero(~coupled))
    n = model.modes
    spread = np.zeros((len(s), n), complex), np.zeros((len(s), 2 * n), complex), np.zeros((len(s), n), complex)
    spread[0][:, which], spread[2][:, which] = v, v / norm
    spread[1][:, which], spread[1][:, n + which] = (momentum * s[:, None] + v * rate) / norm, momentum / norm
    modes = SetModes(*(np.concatenate([one, other]) for one, other in zip((s, *spread), vars(own).values(), strict=True)))
    _check(modes)
    return modes


def _polish(values: Complex, psi: Real, omega: Real, rate: Real) -> tuple[Complex, Complex]:
    """Improve eigenvalues by Newton's method on W(s) y = 0; return them with their null vectors (J, p)."""
    s, one = values.copy(), np.eye(len(psi))
    for _ in range(8):
        d = s[:, None] ** 2 + rate * s[:, None] + omega**2
        w = one / s[:, None, None] ** 2 + np.einsum("ai,ji,bi->jab", psi, 1 / d, psi)
        slope = -2 * one / s[:, None, None] ** 3 - np.einsum("ai,ji,bi->jab", psi, (2 * s[:, None] + rate) / d**2, psi)
        y = np.linalg.svd(w)[2][:, -1].conj()
        step = np.einsum("ja,jab,jb->j", y, w, y) / np.einsum("ja,jab,jb->j", y, slope, y)
        good = np.isfinite(step) & (np.abs(step) < 1e-4 * np.abs(s))
        s = np.where(good, s - np.where(good, step, 0), s)
        s = np.where(values.imag == 0, s.real, s)
    return s, y


def _check(modes: SetModes) -> None:
    """Raise ParameterError if the eigenvectors do not span the state."""
    back = np.concatenate([modes.shapes, modes.shapes * modes.values[:, None]], axis=1) * _twice(modes.values)[:, None]
    error = float(np.max(np.abs(np.real(np.sum(back * modes.into, axis=0)) - 1)))
    require(error < COMPLETE, "scene", f"modal basis off by {error:.1e}", "damping, masses and positions away from a double eigenvalue")


def _maps(modes: SetModes, joined: list[int], shapes: Real, size: int) -> tuple[Real, Real]:
    """Return the maps of `segments.Regime`: a joined absorber has the beam's displacement at its place."""
    n, absorbers = modes.shapes.shape[1], len(shapes)
    half = n + absorbers
    displacement = np.zeros((len(modes.values), half), complex)
    displacement[:, :n] = modes.shapes
    for a in joined:
        displacement[:, n + a] = modes.shapes @ shapes[a]
    out = np.concatenate([displacement, displacement * modes.values[:, None]], axis=1).T * _twice(modes.values).astype(complex)
    into = np.zeros((len(modes.values), 2 * half), complex)
    into[:, :n], into[:, half : half + n] = modes.into[:, :n], modes.into[:, n:]
    return parted(in_order(out, modes.values, size, 1)), parted(in_order(into, modes.values, size).T)


def _rows(model: ModalModel, modes: SetModes, joined: list[int], masses: Real, shapes: Real, size: int) -> Real:
    """Return the rows of weights (n + 1, 28, J) of a set."""
    s, every = modes.values, []
    there = (modes.shapes * _twice(s)[:, None]) @ np.vstack([shapes, model.tip_shape]).T
    for a, (mass, shape) in enumerate(zip(masses, shapes, strict=True)):
        guard = mass * s**2 * there[:, a] if a in joined else -there[:, a]
        every.append(slot_rows(s, modes.weights @ model.force_shape, -modes.weights @ shape, guard, there[:, a], size))
    nothing = np.zeros_like(s)
    every.append(slot_rows(s, modes.weights @ model.force_shape, nothing, nothing, there[:, -1], size))
    return np.array(every)


def regime_sets(model: ModalModel, masses: Real, wanted: float) -> tuple[Sets, float]:
    """Return the regimes of absorbers of ``masses`` (n,) in kg at the model's absorber shapes, and the reach of their tables (s): ``wanted`` or less.

    Raises ParameterError where a set has no modal basis.
    """
    assert model.absorber_shapes is not None
    shapes, n = np.array(model.absorber_shapes), len(masses)
    sets = [[a for a in range(n) if s >> a & 1] for s in range(2**n)]
    every = [set_modes(model, masses[joined], shapes[joined]) for joined in sets]
    size = padded_size(max(len(modes.values) for modes in every))
    speed = max(float(np.max(np.abs(modes.values))) for modes in every)
    reach = table_reach(speed, wanted)
    rows = np.array([_rows(model, modes, joined, masses, shapes, size) for modes, joined in zip(every, sets, strict=True)])
    tables = [np.ascontiguousarray(part) for part in map(np.array, zip(*(slot_tables(m.values, size, reach, speed) for m in every), strict=True))]
    maps = [np.array(part) for part in zip(*(_maps(modes, joined, shapes, size) for modes, joined in zip(every, sets, strict=True)), strict=True)]
    bent = np.array([_bent(row) for row in rows])
    mobility = np.array([_compliance(masses, shapes, joined) for joined in sets])
    out, into = maps
    table, scale, steps, waves, turns, errors = tables
    return Sets(rows, table, scale, steps, waves, turns, errors, out, into, bent, mobility), reach


def _bent(rows: Real) -> Real:
    """Return the displacement (n + 1, n) of each place under a unit constant force on each absorber, and so against the beam, in m/N."""
    tip, rest = (rows[:, row] + 1j * rows[:, row + 1] for row in (TIP, REST))
    return np.ascontiguousarray(np.real(tip @ rest[:-1].T))


def _compliance(masses: Real, shapes: Real, joined: list[int]) -> Real:
    """Return the relative acceleration (n, n) of each absorber by a unit force on each, in 1/kg, where some are joined."""
    mass = np.eye(shapes.shape[1]) + (shapes[joined].T * masses[joined]) @ shapes[joined]
    return np.ascontiguousarray(shapes @ np.linalg.solve(mass, shapes.T) + np.diag(1 / masses))
