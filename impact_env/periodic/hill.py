"""Stability of what harmonic balance finds, by Hill's method (G. W. Hill, Acta Mathematica 8, 1886; as a matrix: A. Lazarus, O. Thomas, 2010).

A disturbance is harmonics, as many as the solution has, times exp(mu t): of modes and absorber, their velocities, and the force between them, which
follows the contact law linearised along the solution. The exponents mu are eigenvalues; most of them are copies of others, moved by multiples of the
frequency and cut off, so that those count whose harmonics are the lowest.

The contact comes again after half a period of a symmetric solution, and after one of any other, so harmonics of even and of odd order of that span's
frequency do not meet: in one kind the disturbance has the sign of exp(mu t) after the span, in the other kind the opposite one.
"""

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.contact import CompliantContact
from impact_env.periodic.harmonic_balance import OMEGA, Balance, JointOfMass, real_row
from impact_env.periodic.trigonometric import Real, derivative

Complex = NDArray[np.complex128]
STRIP, COPY = 0.6, 0.1  # of the frequency, in which exponents are looked for; relative: as far apart are copies of one in both kinds at its edge


def hill_multipliers(balance: Balance, z: Real) -> Complex:
    """Return the 2 N_m + 2 Floquet multipliers of a solution z, the largest first; of a symmetric balance over half a period, mirrored.

    At compliant walls they converge; at rigid ones a fast pair's size does not (docs/harmonic_balance.md): `Orbit.stability` has those. Raises
    ParameterError for a structure other than `JointOfMass`, and for elastic friction, whose force depends on the motion's past.
    """
    linear, law = balance.linear, balance.law
    require(isinstance(linear, JointOfMass), "structure", linear, "a mass beside a beam's tip for Hill's method")
    elastic = isinstance(law, CompliantContact) and law.friction_limit is not None
    require(not elastic, "friction", law, "rigid, or none, for Hill's method")
    found: list[tuple[float, complex, int]] = []
    for kind in (0, 1):
        exponents, order, omega = _exponents(balance, z, kind)
        sign = 1 if balance.symmetric == (kind == 1) else -1
        found += [(at, complex(sign * np.exp(np.pi / omega * exponent)), kind) for at, exponent in zip(order, exponents, strict=True)]
    taken: list[tuple[float, complex, int]] = []
    for one in sorted(found, key=lambda each: each[0]):
        if all(one[2] == other[2] or abs(one[1] - other[1]) > COPY * abs(one[1]) for other in taken):
            taken.append(one)
    assert isinstance(linear, JointOfMass)
    return np.array(sorted((value for _, value, _ in taken[: 2 * linear.model.modes + 2]), key=abs, reverse=True))


def _exponents(balance: Balance, z: Real, kind: int) -> tuple[Complex, Real, float]:
    """Return exponents (1/s) of disturbances of even (0) or odd (1) order, the mean order of each, and the frequency (rad/s) that orders count."""
    linear, law = balance.linear, balance.law
    assert isinstance(linear, JointOfMass)
    rows = [balance.polynomial(z), real_row(balance.response(z).contact)]
    omega = balance.omega / linear.multiple
    if not balance.symmetric:  # over two periods
        rows, omega = [_doubled(row) for row in rows], omega / 2
    h = len(rows[0]) // 2
    orders = np.concatenate([[0], np.arange(1, h + 1), np.arange(1, h + 1)])
    kept = np.flatnonzero(orders % 2 == kind)
    contact = law.contact(rows[0], rows[1], omega, OMEGA)
    turn, held, slope, rate = (
        each[np.ix_(kept, kept)] for each in (omega * derivative(np.eye(2 * h + 1)).T, contact.by_dynamic, contact.by_motion, contact.by_rate)
    )
    model, tip = linear.model, linear.model.tip_shape
    across, push = np.append(-tip, 1.0), np.append(-tip, 1 / linear.mass)
    losses = np.append(2 * model.damping_ratio * model.omega, linear.grounded_damper / linear.mass)
    one, bodies, size = np.eye(len(kept)), np.eye(len(across)), len(across) * len(kept)
    flow = np.block([
        [-np.kron(bodies, turn), np.eye(size), np.zeros((size, len(kept)))],
        [-np.kron(np.diag(np.append(model.omega**2, 0.0)), one), -np.kron(bodies, turn) - np.kron(np.diag(losses), one), np.kron(push[:, None], one)],
        [np.kron(across[None], slope - rate @ turn), np.kron(across[None], rate), held - one],
    ])  # fmt: skip
    exponents, vectors = scipy.linalg.eig(flow, scipy.linalg.block_diag(np.eye(2 * size), np.zeros_like(one)))
    inside = np.isfinite(exponents) & (np.abs(exponents.imag) < STRIP * omega)
    shares = np.sum(np.abs(vectors[:size, inside].reshape(len(across), len(kept), -1)) ** 2, axis=0)
    inside[inside] = ok = np.sum(shares, axis=0) > 0
    return exponents[inside], orders[kept] @ (shares[:, ok] / np.sum(shares[:, ok], axis=0)), omega


def _doubled(row: Real) -> Real:
    """Return a polynomial over twice the period."""
    h = len(row) // 2
    twice = np.zeros(4 * h + 1)
    twice[0], twice[2 : 2 * h + 1 : 2], twice[2 * h + 2 :: 2] = row[0], row[1 : h + 1], row[h + 1 :]
    return twice
