"""A guard signal between two events: its parts and its guards, its value at an offset, and what a search for its events returns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room, jit_view
from impact_env.kernels.motion.forced import THIRD, Forced, signal_value
from impact_env.kernels.motion.forced_sums import first_values, polynomial_value
from impact_env.kernels.motion.numbers import cos_sin
from impact_env.kernels.motion.slot_sums import sum_sizes
from impact_env.kernels.motion.slots import SPEED, Slots, digits, sum_block, value
from impact_env.kernels.motion.vector import BLOCK

# events
NOTHING = 0
HIT_LOW = 1
HIT_HIGH = 2
REVERSAL = 3
TIME_RESOLUTION = 5e-15  # of the time scale of the slowest slot, or of a quicker force
EPSILON = 2.2e-16
NOISE = 4.0 * EPSILON  # rounding of a computed signal, relative to its scale
MOST_EVALUATIONS = 2e7  # of a search
FEW = (
    1e-4  # of the curvature's share of a step in Newton's: there its series is as good as its root
)


class Signal(NamedTuple):
    """A guard signal from a reference time on, and room for its search.

    Slots' amplitudes ``u`` (2, J); a polynomial p0 + p1 t + p2 t^2/2 (3,); the amplitudes of value, rate and bend where the search is,
    ``moving`` (6 J,) = (3, 2, J); ``block`` (BLOCK,) of vector.py; ``memory`` (2,): the level to
    begin with, and the evaluations that a search may use.
    """

    u: NDArray[np.float64]
    polynomial: NDArray[np.float64]
    moving: NDArray[np.float64]
    block: NDArray[np.float64]
    memory: NDArray[np.float64]


class Course(NamedTuple):
    """A signal in a window: ``slots`` and ``forced`` part of its regime, the force's ``omega`` (rad/s), and its reference time ``tau`` (s)."""

    slots: Slots
    forced: Forced
    omega: float
    signal: Signal
    tau: float


class Terms(NamedTuple):
    """Of a `Course` what the signal's value at a time needs, and no more: each array costs time at a call."""

    rows: NDArray[np.float64]
    table: NDArray[np.float64]
    scale: NDArray[np.float64]
    signals: NDArray[np.float64]
    omega: float
    u: NDArray[np.float64]
    polynomial: NDArray[np.float64]
    tau: float


class Guards(NamedTuple):
    """What ends a signal's course, and which of it the signal starts on.

    ``low`` and ``high``: walls, which may be infinite; None: there are no walls at all. ``side`` -1 or 1: the signal starts on the low or the high
    wall. ``direction`` 1 or -1: the sign that the signal's rate has at the start, and must keep; None: the rate is not watched. ``zero_rate``: it
    starts at zero.
    """

    low: float | None
    high: float | None
    side: int
    direction: float | None
    zero_rate: bool


class Bounded(NamedTuple):
    """A signal at a time with its first two derivatives, and bounds of the second to fourth that hold for ever after."""

    y: float
    v: float
    a: float
    b2: float
    b3: float
    b4: float


class Event(NamedTuple):
    """What ended a search: kind, offset from the start (s), signal, its rate and its second derivative there, evaluations made."""

    kind: int
    offset: float
    value: float
    rate: float
    bend: float
    evaluations: int


@jit_room
def new_signal(size):
    """Return room for a signal of ``size`` slots."""
    return Signal(
        np.zeros((2, size)),
        np.zeros(3),
        np.zeros(6 * size),
        np.zeros(BLOCK),
        np.array([0.0, MOST_EVALUATIONS]),
    )


@jit_view
def terms_of(course):
    """Return the terms of a course's signal."""
    slots = course.slots
    signal = course.signal
    return Terms(
        slots.rows,
        slots.table,
        slots.scale,
        course.forced.signals,
        course.omega,
        signal.u,
        signal.polynomial,
        course.tau,
    )


@jit_inline
def signal_scale(signal, bound):
    """Return the size of the terms that a signal is the sum of."""
    return bound[0] + abs(signal.polynomial[0]) + sum_sizes(signal.u.shape[1], signal.u)


@jit_inline
def signal_at(terms, offset):
    """Return a signal and its first three derivatives at an offset from its reference time."""
    p = terms.polynomial
    tau = terms.tau + offset
    d1, d2, d3, x = digits(terms.scale, offset)
    y, v, a, j = sum_block(terms.rows, terms.table, terms.u, d1, d2, d3, x)
    c, s = cos_sin(terms.omega * tau)
    f0, f1, f2 = first_values(terms.signals, tau, c, s)
    f3 = polynomial_value(terms.signals, THIRD, tau, c, s)
    return (
        y + f0 + p[0] + offset * (p[1] + 0.5 * offset * p[2]),
        v + f1 + p[1] + offset * p[2],
        a + f2 + p[2],
        j + f3,
    )


@jit
def at_offset(slots, signals, omega, signal, tau, offset):
    """Return a signal and its first two derivatives at an offset from its reference time."""
    y, v, a, _ = signal_at(
        Terms(
            slots.rows, slots.table, slots.scale, signals, omega, signal.u, signal.polynomial, tau
        ),
        offset,
    )
    return y, v, a


@jit
def value_at_offset(slots, signals, omega, signal, tau, offset):
    """Return a signal at an offset from its reference time, to the last digit that of `at_offset`."""
    p = signal.polynomial
    y = value(slots.rows, slots.table, slots.scale, signal.u, offset)
    return (
        y
        + signal_value(signals, 0, omega, tau + offset)
        + p[0]
        + offset * (p[1] + 0.5 * offset * p[2])
    )


@jit_inline
def time_resolution(rows, omega, length):
    """Return the shortest time (s) that a search tells apart: by the slowest slot, or a quicker force."""
    return max(TIME_RESOLUTION / max(rows[SPEED, 0], omega), 4.0 * EPSILON * length)


@jit_inline
def wall_of(kind, guards):
    """Return the wall that an event is at; 0 where there are none."""
    wall = 0.0
    if guards.low is not None:
        wall = guards.high if kind == HIT_HIGH else guards.low
    return wall


@jit_inline
def counted(event, evaluations):
    """Return an event with the evaluations of the whole search."""
    return Event(event.kind, event.offset, event.value, event.rate, event.bend, evaluations)


@jit_inline
def given_up(evaluations):
    """Return an Event of NaN, so that the run ends in an error: an event could be missed."""
    return Event(NOTHING, np.nan, np.nan, np.nan, np.nan, evaluations)


@jit
def refine(terms, offset, kind, wall, b4, resolution):
    """Return the simple root near ``offset`` of a signal as an Event, by Newton's method with two more derivatives.

    The last step is not evaluated again: it must be so short that the fourth derivative's bound b4 leaves time and rate exact. NOTHING where it
    finds none.
    """
    y = 0.0
    v = 0.0
    a = 0.0
    count = 0
    while count < 12:
        count += 1
        y, v, a, j = signal_at(terms, offset)
        if kind == REVERSAL:
            inverse = 1.0 / a
            step = -v * inverse
            e = 0.5 * j * step * inverse
            step -= step * e * (1.0 - 2.0 * e)
            exact = b4 * abs(step * step * step) <= 6.0 * abs(a) * resolution and abs(e) < FEW
        else:
            d = wall - y if kind == HIT_HIGH else y - wall
            g = v if kind == HIT_HIGH else -v
            c = a if kind == HIT_HIGH else -a
            k = j if kind == HIT_HIGH else -j
            inverse = 1.0 / g
            first = d * inverse
            e = 0.5 * c * first * inverse
            step = first * (1.0 - e * (1.0 - 2.0 * e) - k * first * first * inverse / 6.0)
            exact = b4 * abs(step * step * step) <= 6.0 * EPSILON * g and abs(e) < FEW
        offset += step
        y += step * (v + step * (0.5 * a + step * j / 6.0))
        v += step * (a + 0.5 * step * j)
        a += step * j
        if exact or abs(step) <= resolution:
            return Event(kind, offset, y, v, a, count)
    return Event(NOTHING, 0.0, 0.0, 0.0, 0.0, count)
