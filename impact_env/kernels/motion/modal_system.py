"""Linear regimes in first-order modal form, and their exact propagation.

In every regime the state is a sum of modal amplitudes Z_j with Z_j' = s_j Z_j + drive_j f(t) +
relative_j F, where f is the external force and F a constant force between beam and absorber
(positive on the absorber). A pair of complex eigenvalues is one modal amplitude, of which real
parts are taken; a real eigenvalue has a modal amplitude of its own. A modal amplitude splits into
z_j exp(s_j t), a forced part (forced.py) and a rest part -relative_j F / s_j.

exp(s_j t) is a product of three table entries and a short Taylor polynomial: t = d1 h1 + d2 h2 +
d3 h3 + rest, with h1 = reach/base, h2 = h1/base, h3 = h2/base and |s_j| h3 <= TAYLOR_REACH, so that
the polynomial is exact to rounding. No transcendental function is called.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline
from impact_env.kernels.motion.modal_rows import BASE as BASE
from impact_env.kernels.motion.modal_rows import DRIVE as DRIVE
from impact_env.kernels.motion.modal_rows import GUARD as GUARD
from impact_env.kernels.motion.modal_rows import RELATIVE as RELATIVE
from impact_env.kernels.motion.modal_rows import REST as REST
from impact_env.kernels.motion.modal_rows import SPEED as SPEED
from impact_env.kernels.motion.modal_rows import SPEED_CUBE as SPEED_CUBE
from impact_env.kernels.motion.modal_rows import SPEED_SQUARE as SPEED_SQUARE
from impact_env.kernels.motion.modal_rows import TAYLOR_ROWS
from impact_env.kernels.motion.modal_rows import TIP as TIP
from impact_env.kernels.motion.modal_rows import S as S
from impact_env.kernels.motion.modal_sums import (
    add_row,
    copy_vectors,
    multiply_by_row,
    propagate_by_digits,
    sum_and_bound_derivatives,
    sum_third_to_fifth,
    sum_three_derivatives,
    sum_value,
)

TAYLOR_TERMS = 1 + TAYLOR_ROWS  # |s h3|^7 / 7! below 1e-16 for TAYLOR_REACH
TAYLOR_REACH = 0.04  # of |s h3|, and half of that is used

# entries of Modal amplitudes.scale
DIGIT_BITS, FINEST_STEP, INVERSE_FINEST_STEP, LARGEST_RATE = range(4)


class ModalSystem(NamedTuple):
    """One regime with J modal amplitudes, sorted by |s_j| and padded with empty ones.

    It consists of few arrays, because each costs time at every call.

    ``rows`` (ROWS, J), or (ROWS + 2 C, J) under C bases that move: see modal_rows.py. ``table``
    (2, 3, base, J): exp(s h), real and imaginary. ``scale`` (4,): log2 of the base, h3 (s), 1/h3,
    largest |s|.

    For the event search, at levels L of time steps h_L (search.py): ``steps`` (L, 2) h_L in s and
    the number of modal amplitudes to sum; ``waves`` (L, J, 2, POINTS) and ``turns`` (L, POINTS, 2,
    J): exp(k s h_L), k = 1 ... POINTS, in two orders; ``errors`` (L, J) as in tables.py.
    """

    rows: NDArray[np.float64]
    table: NDArray[np.float64]
    scale: NDArray[np.float64]
    steps: NDArray[np.float64]
    waves: NDArray[np.float64]
    turns: NDArray[np.float64]
    errors: NDArray[np.float64]


@jit_inline
def split_time(scale, delta):
    """Return (d1, d2, d3, rest) of a time offset within the reach of the tables.

    The magnitude of the rest is at most h3/2, and the rest is 0 on the grid of h3.
    """
    bits = np.int64(scale[DIGIT_BITS])
    mask = (np.int64(1) << bits) - 1
    x = delta * scale[INVERSE_FINEST_STEP] + 0.5
    # limited before the conversion, which is undefined beyond the integers; not a number becomes 0,
    # and the rest is then not a number
    x = x if x > 0.0 else 0.0
    n = np.int64(min(x, float((np.int64(1) << (3 * bits)) - 1)))
    return n >> (2 * bits), (n >> bits) & mask, n & mask, delta - n * scale[FINEST_STEP]


@jit_inline
def propagate(rows, table, scale, delta, z):
    """Multiply z (2, J) by exp(s delta) in place."""
    propagate_to(rows, table, scale, z, delta, z)


@jit
def propagate_to(rows, table, scale, u, delta, out):
    """Write u exp(s delta) to ``out``, real parts first."""
    d1, d2, d3, x = split_time(scale, delta)
    propagate_by_digits(rows, table, rows.shape[1], table.shape[2], d1, d2, d3, x, u, out)


@jit_inline
def sum_derivatives(rows, table, u, d1, d2, d3, x):
    """Return sum Re(u_j exp(s_j t)) and its first three derivatives."""
    return sum_three_derivatives(rows, table, rows.shape[1], table.shape[2], d1, d2, d3, x, u)


@jit_inline
def sum_with_bounds(rows, table, u, d1, d2, d3, x):
    """Return value and derivatives of sum Re(u_j exp(s_j t)), and bounds.

    The derivatives are the first and second. The bounds of the second to fourth derivative hold for
    all later times.

    A bound is the sum of |u_j exp(s_j t)| |s_j|^m.
    """
    return sum_and_bound_derivatives(rows, table, rows.shape[1], table.shape[2], d1, d2, d3, x, u)


@jit
def copy_amplitudes(z, w):
    """Write z to w, both (2, J)."""
    copy_vectors(z.shape[1], z, w)


@jit
def sum_amplitudes(rows, table, scale, u, delta):
    """Return sum Re(u_j exp(s_j delta))."""
    d1, d2, d3, x = split_time(scale, delta)
    return sum_value(rows, table, rows.shape[1], table.shape[2], d1, d2, d3, x, u)[0]


@jit_inline
def sum_high_derivatives(rows, u):
    """Return the third, fourth and fifth derivative of sum Re(u_j exp(s_j t)) at t = 0."""
    return sum_third_to_fifth(rows, rows.shape[1], u)


@jit
def apply_weights(rows, row, z, u):
    """Write u = w z with the complex weights w in ``row`` and the row behind it."""
    multiply_by_row(rows, row, rows.shape[1], z, u)


@jit
def add_weighted(rows, row, factor, z):
    """Add factor * w to z with the complex weights w in ``row`` and the row behind it."""
    add_row(rows, row, rows.shape[1], factor, z)
