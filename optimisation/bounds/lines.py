"""The spectral line of a beam that carries masses in cavities: what the limits are made of.

Masses m_k (k = 1..n) move at places of the beam with mode shapes phi_k; r_k is a mass's displacement minus that of its place. Whatever happens
between them, the beam feels minus the mass times its acceleration. The beam is linear, so at the forcing frequency Omega its modal line y obeys

    H y = f p + Omega^2 sum_k m_k phi_k r_k,     H = diag(omega_i^2 - Omega^2 + 2 i D_i omega_i Omega) - Omega^2 sum_k m_k phi_k phi_k^T,

H being the dynamic stiffness of the beam with all masses stuck to it, p the force's shape. The line of any place e is e y = f A + sum_k B_k r_k.
For one mass, at its own place, A = G_f/(1 - kappa) and B = kappa/(1 - kappa) with the free beam's receptances G_f, G_t and kappa = G_t m_a Omega^2.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from impact_env.modes import ModalModel, with_masses
from impact_env.parameters import positive, require

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

SINGULAR = 1e-14  # H is singular if it is this close to it, over the size of the terms that it is the sum of


@dataclass(frozen=True)
class Lines:
    """Line of a place: ``force`` A in m/N (...), ``strokes`` B_k (..., n), both over ``scale`` (...): infinite at an undamped resonance, else 1."""

    force: Complex
    strokes: Complex
    scale: Real


def places(model: ModalModel) -> Real:
    """Return the mode shapes at the absorbers' places, (n, N_m): those of several absorbers, else the tip's."""
    return model.tip_shape[None, :] if model.absorber_shapes is None else np.asarray(model.absorber_shapes)


def masses_of(model: ModalModel, mass: ArrayLike) -> Real:
    """Return the masses in kg, (n,); raises ParameterError unless there is one above 0 for each of the model's places."""
    return _each(model, "mass", mass)


def strokes_of(model: ModalModel, gap: ArrayLike) -> Real:
    """Return R = 4 g0/pi in m, (n,), for gaps in m: the largest spectral line of a signal within +-g0."""
    return 4 * _each(model, "gap", gap) / np.pi


def _each(model: ModalModel, name: str, values: ArrayLike) -> Real:
    given = np.asarray(values, dtype=np.float64)
    wanted = len(places(model))
    require(given.shape == (wanted,) or (wanted == 1 and given.shape == ()), name, values, f"{wanted} of them, one for each absorber of the model")
    return np.array([positive(name, value) for value in given.ravel()])


def watched(model: ModalModel, at: ArrayLike | None) -> Real:
    """Return the mode shape (N_m,) of the place where the level is read: ``at``, or where the model says."""
    row = model.level_shape if at is None else np.asarray(at, dtype=np.float64)
    ok = row.shape == (model.modes,) and bool(np.all(np.isfinite(row)) and np.any(row != 0))
    require(ok, "tip_shape", row, f"{model.modes} finite modal amplitudes in 1/sqrt(kg), at least one of them other than 0")
    return row


def lines(model: ModalModel, masses: Real, omega: ArrayLike, at: Real) -> Lines:
    """Return the line at a place with mode shape ``at`` (N_m,), for ``masses`` (n,) in kg and frequencies in rad/s of any shape."""
    w = np.asarray(omega, dtype=np.float64)
    require(bool(np.all(np.isfinite(w) & (w >= 0))), "omega", omega, "finite frequencies in rad/s, 0 or above")
    # in units in which each mode's stiffness is 1, so that high modes do not drown the others
    shapes, force, row = places(model) / model.omega, model.force_shape / model.omega, at / model.omega
    ratio = w[..., None] / model.omega
    inertia = (shapes.T * masses) @ shapes
    matrix = np.asarray(-(w[..., None, None] ** 2) * inertia, dtype=np.complex128)
    matrix[..., np.arange(model.modes), np.arange(model.modes)] += 1 - ratio**2 + 2j * model.damping_ratio * ratio
    answer, scale = _solve(matrix, row, 1 + np.max(ratio**2, axis=-1) + w**2 * np.trace(inertia))
    return Lines(answer @ force, (answer @ shapes.T) * masses * w[..., None] ** 2, scale)


def _solve(matrix: Complex, row: Real, size: Real) -> tuple[Complex, Real]:
    """Return row H^-1 (..., N) of symmetric matrices, and 1; at an undamped resonance the eigenvector that it grows along, and infinity.

    ``size`` (...): of the terms that a matrix is the sum of.
    """
    try:
        answer = np.linalg.solve(matrix, np.broadcast_to(row.astype(complex)[:, None], (*matrix.shape[:-1], 1)))[..., 0]
    except np.linalg.LinAlgError:  # one of them is singular to the last bit: off by a rounding error it is not, and the same to all digits
        shift = np.finfo(float).eps * np.asarray(size)[..., None, None]
        return _solve(matrix + shift * np.eye(len(row)), row, size)
    growth = np.linalg.norm(answer, axis=-1) / np.linalg.norm(row)
    infinite = growth * size * SINGULAR > 1
    return np.where(infinite[..., None], answer / growth[..., None], answer), np.where(infinite, np.inf, 1.0)


def stuck_frequencies(model: ModalModel, masses: Real) -> Real:
    """Return the undamped natural frequencies in rad/s, rising, of the beam with ``masses`` (n,) in kg stuck at the model's places."""
    shapes = places(model)
    return np.asarray(np.sqrt(scipy.linalg.eigvalsh(np.diag(model.omega**2), with_masses(shapes, masses))))
