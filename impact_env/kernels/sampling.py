"""The tip displacement at equidistant samples: slots and force turn by fixed factors from one to the next, instead of being looked up each time."""

from __future__ import annotations

from impact_env.kernels.forced import TIP_SIGNAL, signal_value
from impact_env.kernels.jit import jit_sum, jit_sum_inline
from impact_env.kernels.slots import TAYLOR, TAYLOR_TERMS, cos_sin, digits, turned, value
from impact_env.kernels.vector import TERMS

FEW = 3  # samples up to which each is evaluated for itself


@jit_sum_inline
def factor(rows, table, d1, d2, d3, x, j):  # type: ignore[no-untyped-def]
    """Return exp(s_j t), t given by its digits and rest."""
    b_r = table[0, 1, d2, j] * table[0, 2, d3, j] - table[1, 1, d2, j] * table[1, 2, d3, j]
    b_i = table[0, 1, d2, j] * table[1, 2, d3, j] + table[1, 1, d2, j] * table[0, 2, d3, j]
    p_r = table[0, 0, d1, j] * b_r - table[1, 0, d1, j] * b_i
    p_i = table[0, 0, d1, j] * b_i + table[1, 0, d1, j] * b_r
    c_r, c_i = 0.0, 0.0
    for k in range(TAYLOR_TERMS - 1):
        row = TAYLOR + 2 * (TAYLOR_TERMS - 2 - k)
        c_r, c_i = x * (rows[row, j] + c_r), x * (rows[row + 1, j] + c_i)
    c_r += 1.0
    return p_r * c_r - p_i * c_i, p_r * c_i + p_i * c_r


@jit_sum_inline
def forced_value(signals, tau, c, s):  # type: ignore[no-untyped-def]
    """Return the forced tip displacement at an offset from the window's centre, where the force's phasor is c + i s."""
    q_r, q_i = 0.0, 0.0
    for k in range(TERMS):
        q_r = q_r * tau + signals[TIP_SIGNAL, 0, TERMS - 1 - k]
        q_i = q_i * tau + signals[TIP_SIGNAL, 1, TERMS - 1 - k]
    return q_r * c - q_i * s


@jit_sum
def fill_samples(slots, signals, omega, u, tip_rest, offset, x, interval, block, first, count):  # type: ignore[no-untyped-def]
    """Write the tip displacement at ``count`` equidistant samples into the block from place ``first`` on.

    ``u``: the slots' shares at the reference time, ``offset`` from which the first sample lies; ``x``: its time from the window's centre. From sample
    to sample slots and force turn by fixed factors; what rounding adds to that stays below ``count`` times 1e-16.
    """
    rows, table, scale = slots.rows, slots.table, slots.scale
    if count <= FEW:
        for k in range(count):
            t = k * interval
            block[first + k] = value(rows, table, scale, u, offset + t) + signal_value(signals, TIP_SIGNAL, omega, x + t) + tip_rest
        return
    c, s = cos_sin(omega * x)
    turn_c, turn_s = cos_sin(omega * interval)
    for k in range(count):
        block[first + k] = tip_rest + forced_value(signals, x + k * interval, c, s)
        c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
    d1, d2, d3, rest = digits(scale, offset)
    h1, h2, h3, h_rest = digits(scale, interval)
    for j in range(u.shape[1]):
        a_r, a_i = turned(rows, table, u, d1, d2, d3, rest, j)
        if a_r != 0.0 or a_i != 0.0:
            e_r, e_i = factor(rows, table, h1, h2, h3, h_rest, j)
            add_turning(block, first, count, a_r, a_i, e_r, e_i)


@jit_sum_inline
def add_turning(block, first, count, a_r, a_i, e_r, e_i):  # type: ignore[no-untyped-def]
    """Add Re(a e^k), k = 0 ... count - 1, to the block; four interleaved rows, so that a product need not wait for the one before."""
    b_r, b_i = a_r * e_r - a_i * e_i, a_r * e_i + a_i * e_r
    f_r, f_i = e_r * e_r - e_i * e_i, 2.0 * e_r * e_i
    c_r, c_i = a_r * f_r - a_i * f_i, a_r * f_i + a_i * f_r
    d_r, d_i = b_r * f_r - b_i * f_i, b_r * f_i + b_i * f_r
    f_r, f_i = f_r * f_r - f_i * f_i, 2.0 * f_r * f_i
    k = first
    stop = first + count
    while k + 3 < stop:
        block[k] += a_r
        block[k + 1] += b_r
        block[k + 2] += c_r
        block[k + 3] += d_r
        a_r, a_i = a_r * f_r - a_i * f_i, a_r * f_i + a_i * f_r
        b_r, b_i = b_r * f_r - b_i * f_i, b_r * f_i + b_i * f_r
        c_r, c_i = c_r * f_r - c_i * f_i, c_r * f_i + c_i * f_r
        d_r, d_i = d_r * f_r - d_i * f_i, d_r * f_i + d_i * f_r
        k += 4
    if k < stop:
        block[k] += a_r
    if k + 1 < stop:
        block[k + 1] += b_r
    if k + 2 < stop:
        block[k + 2] += c_r
