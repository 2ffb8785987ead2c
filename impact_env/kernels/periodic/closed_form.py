"""The symmetric orbit with one impact at each wall in a period, in closed form.

The relative velocity, and so the friction force, has one sign between impacts.

The impulse P on the absorber at the lower wall pushes up, so P > 0; its mirror image follows half a
period later. The conditions at the lower wall for distance and rate are

    a P + a0 = Re(f H exp(i phase)),     b P + b0 = -Im(f H exp(i phase)).

The sum of their squares is a quadratic in P; the phase follows from its roots. The points
(a P + a0, b P + b0) for all P are the line of the symmetric orbits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.periodic.structure import (
    compute_receptance,
    divide_complex,
    replace_frequency,
)


class SymmetricLine(NamedTuple):
    """Coefficients of the conditions at the lower wall: a P + a0 and b P + b0."""

    a: float  # m/(N s)
    b: float  # m/(N s)
    a0: float  # m
    b0: float  # m
    receptance: complex  # H at the tip under the force (m/N)


@jit_inline
def compute_kappa(restitution, compliance):
    """Return kappa (1/kg) of an impact, from restitution and compliance G (1/kg).

    The mean of the relative velocities before and after an impact is -kappa P.
    """
    return 0.5 * compliance * (1.0 - restitution) / (1.0 + restitution)


@jit
def compute_line(structure, point):
    """Return the `SymmetricLine` of a `Structure` at a `Point` of the parameters."""
    half = np.pi / point.omega
    k = -0.25 * half / structure.mass
    k_rate = 0.0
    s_value = 0.0
    s_rate = 0.0
    for j in range(structure.s.shape[0]):
        s = structure.s[j]
        e = np.exp(s * half)
        mean = divide_complex(0.5 * (1.0 - e), 1.0 + e)
        share = structure.powers[1, j]
        k += (share * mean).real
        k_rate += (share * s * mean).real
        s_value += (structure.powers[0, j] * mean).real
    # friction jumps by 2 muN at an impact on the lower wall: from +muN (moving down) to -muN; its
    # response is -2 muN times that of a unit jump
    s_value = -2.0 * s_value
    s_rate = -2.0 * k
    limit = point.limit
    omega = point.omega
    kappa = compute_kappa(point.restitution, structure.compliance)
    h, _ = compute_receptance(structure, omega)
    return SymmetricLine(
        k, (k_rate + kappa) / omega, limit * s_value + point.gap, limit * s_rate / omega, h
    )


@jit
def solve_impulses(line, force):
    """Return the smaller and the larger root P (N s) of the quadratic at a force amplitude (N).

    Both are nan if the quadratic has no real root. A root may be negative: then it is no orbit.
    """
    quadratic = line.a * line.a + line.b * line.b  # coefficients of the quadratic in P
    linear = line.a * line.a0 + line.b * line.b0
    reach = force * abs(line.receptance)
    cross = line.a * line.b0 - line.b * line.a0  # linear^2 - quadratic c without its cancellation
    discriminant = quadratic * reach * reach - cross * cross
    if discriminant < 0.0 or quadratic == 0.0:
        return np.nan, np.nan
    root = np.sqrt(discriminant)
    return (-linear - root) / quadratic, (-linear + root) / quadratic


@jit
def compute_phase(line, force, impulse):
    """Return the force's phase (rad, 0 to 2 pi) at the lower wall for an impulse (N s).

    ``force`` (N) is the amplitude; a nan impulse gives a nan phase.
    """
    x = line.a * impulse + line.a0
    y = line.b * impulse + line.b0
    phase = math.atan2(-y, x) - math.atan2(line.receptance.imag, line.receptance.real)
    if force < 0.0:
        phase += np.pi
    return phase - 2.0 * np.pi * np.floor(phase / (2.0 * np.pi))


@jit
def compute_fold(line):
    """Return the smallest force amplitude (N) with a real root, and its impulse (N s).

    The force is the distance of the `SymmetricLine` from the origin over |H|.
    """
    square = line.a * line.a + line.b * line.b
    cross = abs(line.a * line.b0 - line.b * line.a0)
    impulse = -(line.a * line.a0 + line.b * line.b0) / square
    return cross / np.sqrt(square) / abs(line.receptance), impulse


@jit
def fill_closed_forms(structure, point, omegas, out):
    """Write impulses and phases of both branches into ``out`` (M, 4) at ``omegas`` (M,) in rad/s.

    The columns are the smaller P (N s), its phase (rad), the larger P and its phase; all are nan
    without an orbit. ``point.omega`` is not used.
    """
    for m in range(omegas.shape[0]):
        line = compute_line(structure, replace_frequency(point, omegas[m]))
        small, large = solve_impulses(line, point.force)
        out[m, 0] = small
        out[m, 2] = large
        out[m, 1] = compute_phase(line, point.force, small)
        out[m, 3] = compute_phase(line, point.force, large)


@jit
def fill_fold_forces(structure, point, omegas, out):
    """Write fold forces into ``out`` (M, 2) at circular frequencies ``omegas`` (M,) in rad/s.

    The columns are the force (N) and the impulse (N s) at the fold. ``point.omega`` is not used.
    """
    for m in range(omegas.shape[0]):
        out[m, 0], out[m, 1] = compute_fold(
            compute_line(structure, replace_frequency(point, omegas[m]))
        )
