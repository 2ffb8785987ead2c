"""A guard signal between two events: its parts, its value at an offset, and what a search for its events returns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.forced import guard_values
from impact_env.kernels.jit import jit, jit_inline, jit_room
from impact_env.kernels.slot_sums import sum_sizes
from impact_env.kernels.slots import SPEED, digits, sum_block
from impact_env.kernels.vector import BLOCK

# events
NOTHING, HIT_LOW, HIT_HIGH, REVERSAL = 0, 1, 2, 3
TIME_RESOLUTION = 5e-15  # of the time scale of the slowest slot, or of a quicker force
EPSILON = 2.2e-16
NOISE = 4.0 * EPSILON  # rounding of a computed signal, relative to its scale


class Signal(NamedTuple):
    """A guard signal from a reference time on, and room for its search.

    Slots' amplitudes ``u`` (2, J); a polynomial p0 + p1 t + p2 t^2/2 (3,); the amplitudes of value, rate and bend where the search is,
    ``moving`` (6 J,) = (3, 2, J); ``block`` (BLOCK,) of vector.py; ``memory`` (1,): the level to
    begin with.
    """

    u: NDArray[np.float64]
    polynomial: NDArray[np.float64]
    moving: NDArray[np.float64]
    block: NDArray[np.float64]
    memory: NDArray[np.float64]


class Event(NamedTuple):
    """What ended a search: kind, offset from the start (s), signal, its rate and its second derivative there, evaluations made."""

    kind: int
    offset: float
    value: float
    rate: float
    bend: float
    evaluations: int


@jit_room
def new_signal(size):  # type: ignore[no-untyped-def]
    """Return room for a signal of ``size`` slots."""
    return Signal(np.zeros((2, size)), np.zeros(3), np.zeros(6 * size), np.zeros(BLOCK), np.zeros(1))


@jit_inline
def signal_scale(signal, bound):  # type: ignore[no-untyped-def]
    """Return the size of the terms that a signal is the sum of."""
    return bound[0] + abs(signal.polynomial[0]) + sum_sizes(signal.u.shape[1], signal.u)


@jit_inline
def signal_at(rows, table, scale, signals, omega, u, p, tau, offset):  # type: ignore[no-untyped-def]
    """Return the signal with the amplitudes u and the polynomial p, and its first two derivatives, at an offset from its reference time."""
    d1, d2, d3, x = digits(scale, offset)
    y, v, a = sum_block(rows, table, u, d1, d2, d3, x)
    f0, f1, f2 = guard_values(signals, omega, tau + offset)
    return y + f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2]), v + f1 + p[1] + offset * p[2], a + f2 + p[2]


@jit
def at_offset(slots, signals, omega, signal, tau, offset):  # type: ignore[no-untyped-def]
    """Return a signal and its first two derivatives at an offset from its reference time."""
    return signal_at(slots.rows, slots.table, slots.scale, signals, omega, signal.u, signal.polynomial, tau, offset)


@jit_inline
def time_resolution(rows, omega, length):  # type: ignore[no-untyped-def]
    """Return the shortest time (s) that a search tells apart: by the slowest slot, or a quicker force."""
    return max(TIME_RESOLUTION / max(rows[SPEED, 0], omega), 4.0 * EPSILON * length)


@jit_inline
def wall_of(kind, low, high):  # type: ignore[no-untyped-def]
    """Return the wall that an event is at; 0 where there are none."""
    wall = 0.0
    if low is not None:
        wall = high if kind == HIT_HIGH else low
    return wall


@jit
def refine(rows, table, scale, signals, omega, u, p, tau, offset, kind, wall, b3, resolution):  # type: ignore[no-untyped-def]
    """Return the simple root near ``offset`` of the signal (u, p) as an Event, by Newton's method with curvature.

    The last step is not evaluated again: it must be so short that the third derivative's bound b3 leaves time and rate exact.
    """
    y, v, a, count = 0.0, 0.0, 0.0, 0
    while count < 12:
        count += 1
        y, v, a = signal_at(rows, table, scale, signals, omega, u, p, tau, offset)
        if kind == REVERSAL:
            step = -v / a
            exact = 0.5 * b3 * step * step <= abs(a) * resolution
        else:
            d = wall - y if kind == HIT_HIGH else y - wall
            g = v if kind == HIT_HIGH else -v
            c = a if kind == HIT_HIGH else -a
            step = d / g * (1.0 - 0.5 * c * d / (g * g))
            exact = b3 * step * step <= EPSILON * g
        offset += step
        y += step * (v + 0.5 * step * a)
        v += step * a
        if exact or abs(step) <= resolution:
            break
    return Event(kind, offset, y, v, a, count)
