"""All eigenvalues of a beam with masses on it: start values for secular.py, and which eigenvalues are too close to each other.

The eigenvalue of a mode that hardly feels the masses lies beside the mode's pole, which is its start value, since no dense eigensolver could tell
the two apart. For the others together a dense eigensolver gives start values.
"""

from itertools import pairwise

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from impact_env.modes import with_link
from impact_env.secular import (
    Complex,
    Coupling,
    Eigen,
    Index,
    PoleOffsets,
    Real,
    close_pairs,
    concatenate,
    eigenvectors,
    eliminate,
    offset_from_points,
    offset_from_poles,
    select_offsets,
    solve_secular,
)

NEAR_CRITICAL = 0.01  # of 1 - D^2: offsets are then from the middle of both poles
COMPLEX_PAIR_TOL = (
    1e-3  # imaginary part over size of a complex pair that has no modal form in practice
)
REAL_PAIR_TOL = 3e-5  # half the distance of two real eigenvalues over their size, likewise
MOST_NEWTON_STEP = 0.3  # share of |s| that a Newton step may go

Starts = tuple[PoleOffsets, Complex]


def _start_at_middles(c: Coupling, weak: float) -> tuple[list[Starts], Index]:
    """Return leads and offsets of weakly coupled oscillators close to critical damping, and which these are."""
    near = np.flatnonzero(np.abs(c.spread()) < NEAR_CRITICAL * c.omega**2)
    leads = offset_from_points(c, near, (-c.rate[near] / 2).astype(complex))
    begin = eliminate(c, leads, np.zeros(len(near), complex))
    rest = (begin.f - leads.constant).real
    slope = begin.slope.real
    ok = (np.abs(rest) < weak * c.omega[near] ** 2) & (np.abs(slope) < 10 * weak * c.omega[near])
    square = begin.f.real + slope**2 / 4
    half = np.sqrt(np.abs(square))
    up = (leads, (-slope / 2 + np.where(square > 0, 1j * half, half)).astype(np.complex128))
    down = (leads, (-slope / 2 - half).astype(np.complex128))
    return [_select_starts(up, ok), _select_starts(down, ok & (square <= 0))], near[ok]


def _start_at_poles(c: Coupling, weak: float) -> tuple[list[Starts], Index]:
    """Return leads and offsets of weakly coupled oscillators farther from critical damping, and which these are."""
    far = np.flatnonzero(np.abs(c.spread()) >= NEAR_CRITICAL * c.omega**2)
    one, other = c.own_poles()
    swift = c.ratio[far] >= 1
    ok = np.ones(len(far), dtype=bool)
    starts = []
    for p, q, used in ((one[far], other[far], np.ones_like(swift)), (other[far], one[far], swift)):
        leads = offset_from_poles(c, far, p, q)
        nothing = np.zeros(len(far), complex)
        begin = eliminate(c, leads, nothing)
        size = np.abs(leads.slope)
        small = (np.abs(begin.f) < weak * np.abs(p) * size) & (
            np.abs(begin.slope - leads.slope) < 10 * weak * size
        )
        ok &= small | ~used
        starts.append((leads, nothing, used))
    return [_select_starts((leads, offset), ok & used) for leads, offset, used in starts], far[ok]


def _select_starts(starts: Starts, which: NDArray[np.bool_]) -> Starts:
    return select_offsets(starts[0], which), starts[1][which]


def _start_by_dense_solver(c: Coupling, which: Index) -> Starts:
    """Return leads and offsets of oscillators ``which`` that move together, from a dense eigensolver."""
    modes = which[which < c.modes]
    sprung = c.sprung and len(which) > 0
    psi = c.psi[:, modes]
    omega = c.omega[modes]
    rate = c.rate[modes]
    if sprung:
        line = np.append(-psi[0], 1.0)
        m = np.eye(len(line))
        own = np.append(modes, c.modes)
        damping = with_link(rate, c.rate[-1], line)
        stiffness = with_link(omega**2, c.omega[-1] ** 2, line)
    else:
        m = np.eye(len(modes)) + psi.T @ psi
        own = modes
        damping = np.diag(rate)
        stiffness = np.diag(omega**2)
    values, shapes = quadratic_modes(m, damping, stiffness)
    lead = own[np.argmax(np.abs(shapes), axis=0)]
    one, other = (pole[lead] for pole in c.own_poles())
    nearer = np.abs(values - one) <= np.abs(values - other)
    pole = np.where(nearer, one, other)
    second = np.where(nearer, other, one)
    near = np.abs(values - pole) < np.abs(values)
    parts = (
        offset_from_poles(c, lead[near], pole[near], second[near]),
        offset_from_points(c, lead[~near], np.zeros(int(np.sum(~near)), complex)),
    )
    leads = concatenate(list(parts))
    return leads, np.concatenate([values[near], values[~near]]) - leads.point


def quadratic_modes(m: Real, c: Real, k: Real) -> tuple[Complex, Complex]:
    """Return approximate eigenvalues (J,) of s^2 m + s c + k with imaginary part not below 0, and their vectors (N, J)."""
    squares, vectors = scipy.linalg.eigh(k, m)
    frequencies = np.sqrt(np.maximum(squares, 1e-16 * np.max(squares)))
    zero = np.zeros_like(k)
    block = np.block(
        [[zero, np.diag(frequencies)], [-np.diag(frequencies), -vectors.T @ c @ vectors]]
    )
    values, states = scipy.linalg.eig(block)
    values = np.where(np.abs(values.imag) < 1e-9 * np.abs(values), values.real, values)
    upper = values.imag >= 0
    return values[upper], vectors @ states[len(k) :, upper]


def _close(lead: Index, s: Complex) -> tuple[NDArray[np.bool_], Index, Complex]:
    """Return which eigenvalues (J,) are alone, and lead and place of each close pair: the upper of a complex one, the middle of two real ones."""
    alone = np.ones(len(s), dtype=bool)
    leads = []
    places = []
    for k in np.flatnonzero((s.imag != 0) & (np.abs(s.imag) < COMPLEX_PAIR_TOL * np.abs(s))):
        alone[k] = False
        leads.append(lead[k])
        places.append(s[k])
    real = np.flatnonzero(s.imag == 0)
    real = real[np.lexsort((s[real].real, lead[real]))]
    for a, b in pairwise(real):
        if alone[a] and lead[a] == lead[b] and abs(s[a] - s[b]) < REAL_PAIR_TOL * abs(s[a] + s[b]):
            alone[[a, b]] = False
            leads.append(lead[a])
            places.append((s[a] + s[b]) / 2)
    return alone, np.array(leads, dtype=int), np.array(places, dtype=complex)


@np.errstate(
    divide="ignore", invalid="ignore"
)  # where two poles are one: what is not a number is no start, or found by the check of the basis
def solve_eigenproblem(c: Coupling, weak: float) -> Eigen:
    """Return all eigenvalues and vectors; ``weak``: share of |s|^2 up to which R leaves a mode near its own pole, from where it is then sought."""
    middles, near = _start_at_middles(c, weak)
    poles, far = _start_at_poles(c, weak)
    starts = middles + poles
    left = np.setdiff1d(np.arange(len(c.omega)), np.concatenate([near, far]))
    if len(left) > 0:
        if c.sprung:  # the dense solver always has the mass
            starts = [_select_starts(part, part[0].lead < c.modes) for part in starts]
        starts.append(_start_by_dense_solver(c, left))
    leads = concatenate([part[0] for part in starts])
    offset = np.concatenate([part[1] for part in starts])
    alone, lead, place = _close(leads.lead, leads.point + offset)
    single = select_offsets(leads, alone)
    result = [eigenvectors(c, single, solve_secular(c, single, offset[alone], MOST_NEWTON_STEP))]
    if len(lead) > 0:
        result.append(close_pairs(c, lead, place))
    return concatenate(result)
