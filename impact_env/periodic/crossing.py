"""Where a piece of motion ends: an impact, a turn of the relative velocity, a joint force out of its bounds. By samples, then Newton's method."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.pieces import Piece

Array = NDArray[np.float64]
REVERSAL = 0  # kinds of a flight's end: this, or the wall hit (-1, 1)
ITERATIONS = 60


class Crossing(NamedTuple):
    """When, in s after the piece's start, and what: of a flight `REVERSAL` or a wall, of a held piece the bound that was left (-1, 1)."""

    dt: float
    kind: int


def root(f: Callable[[float], tuple[float, float]], low: float, high: float) -> float:
    """Return where a function, given with its derivative, is zero between two places at which its signs differ: Newton's method, else halving."""
    at_low, x = f(low)[0], 0.5 * (low + high)
    for _ in range(ITERATIONS):
        value, slope = f(x)
        if value == 0.0:
            return x
        if (value > 0) == (at_low > 0):
            low = x
        else:
            high = x
        new = x - value / slope if slope != 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-16 * abs(new) or new in (low, high):
            return new
        x = new
    return x


def end_of_hold(piece: Piece, left: float) -> Crossing | None:
    """Return where the joint force of a joined piece leaves what friction and its wall can give within ``left`` (s), or None."""
    limit = piece.flow.case.friction_limit
    low, high = (-np.inf if piece.wall > 0 else -limit), (np.inf if piece.wall < 0 else limit)
    start = 0.0
    while start < left:
        dts, (force,) = piece.samples(start)
        out = np.flatnonzero((force[1:] > high) | (force[1:] < low))
        if len(out):
            k = int(out[0]) + 1
            side = 1 if force[k] > high else -1
            bound = high if side > 0 else low

            def beyond(dt: float, bound: float = bound) -> tuple[float, float]:
                value, rate = piece.joint_force(dt)
                return value - bound, rate

            # a phase that begins at its bound and leaves it at once
            dt = root(beyond, float(dts[k - 1]), float(dts[k])) if side * (force[k - 1] - bound) < 0 else float(dts[k - 1])
            return Crossing(dt, side) if dt < left else None
        start = float(dts[-1])
    return None


def end_of_flight(piece: Piece, left: float) -> Crossing | None:
    """Return the first impact, or with friction turn of the relative velocity, of a free piece within ``left`` (s), or None."""
    found = None if piece.rested else _at_once(piece)
    start = 0.0
    while found is None and start < left:
        dts, values = piece.samples(start)
        if piece.rested and start == 0.0:
            values[1:, 0] = 0.0
        for k in _suspects(piece, values):
            found = _within(piece, float(dts[k]), float(dts[k + 1]), values[:, k], values[:, k + 1])
            if found is not None:
                break
        start = float(dts[-1])
    return found if found is not None and found.dt < left else None


def _at_once(piece: Piece) -> Crossing | None:
    """Return the end of a flight that lasts less than a sample, by its change of distance with all digits: a chatter's bounces."""
    gap, friction = piece.flow.case.gap, piece.flow.case.friction_limit > 0
    d, v, a, _ = piece.relative(0.0)
    step = 0.5 * piece.flow.step
    turn = -v / a if friction and a * piece.sign < 0 < v * piece.sign else np.inf
    best, kind = (turn, REVERSAL) if turn < step else (step, 2)
    for wall in (-1, 1):
        height = gap - wall * d
        if abs(height) < 1e-15 * piece.size:
            height = 0.0
        dt = _fall(height, wall * v, wall * a)
        if 0 < dt < best:
            best, kind = dt, wall
    if kind == 2:
        return None
    height = gap - kind * d if abs(gap - kind * d) >= 1e-15 * piece.size else 0.0

    def turning(dt: float) -> tuple[float, float]:
        values = piece.relative(dt)
        return float(values[1]), float(values[2])

    def falling(dt: float) -> tuple[float, float]:
        return piece.moved(dt) - kind * height, float(piece.relative(dt)[1])

    end = _polished(turning if kind == REVERSAL else falling, best)
    return None if end is None else Crossing(end, kind)


def _fall(height: float, rate: float, bend: float) -> float:
    """Return when a wall ``height`` (m) away is reached at constant acceleration, infinite if never; height 0 is left first."""
    if height <= 0:
        return -2 * rate / bend if bend > 0 > rate else np.inf
    square = rate * rate + 2 * bend * height
    if square < 0:
        return np.inf
    below = rate + np.sqrt(square)
    return 2 * height / below if below > 0 else np.inf


def _polished(f: Callable[[float], tuple[float, float]], x: float) -> float | None:
    """Return the root near ``x`` by Newton's method, or None if it leads away: then samples decide."""
    first = x
    for _ in range(ITERATIONS):
        value, slope = f(x)
        new = x - value / slope if slope != 0.0 else -1.0
        if not 0.5 * first < new < 2 * first:
            return None
        if abs(new - x) <= 1e-13 * x:
            return new
        x = new
    return x if abs(value) <= abs(slope) * 1e-6 * x else None  # a root whose digits are at their end


def _suspects(piece: Piece, values: Array) -> NDArray[np.int64]:
    """Return the samples between which, and the next ones, something may happen: a wall passed, a turn, or two turns at once."""
    gap = piece.flow.case.gap
    d, v, a = values
    outside = np.abs(d[1:]) > gap
    turns = v[:-1] * v[1:] <= 0
    near = (a[:-1] * a[1:] < 0) & (np.minimum(np.abs(v[:-1]), np.abs(v[1:])) < 0.5 * piece.flow.step * np.maximum(np.abs(a[:-1]), np.abs(a[1:])))
    return np.flatnonzero(outside | turns | near)


def _within(piece: Piece, low: float, high: float, before: Array, after: Array) -> Crossing | None:
    """Return the first end of a flight between two samples with relative displacement, velocity and acceleration ``before`` and ``after``."""
    friction, gap = piece.flow.case.friction_limit > 0, piece.flow.case.gap
    places = [low]
    if before[2] * after[2] < 0:
        places.append(root(lambda dt: (piece.relative(dt)[2], piece.relative(dt)[3]), low, high))
    places.append(high)
    # between these the relative velocity is monotonous
    for one, other in pairwise(places):
        v0 = piece.relative(one)[1] if one > 0 or piece.sign * before[1] > 0 else 0.0
        v1 = float(piece.relative(other)[1])
        marks = [one]
        if v0 * v1 < 0 and (not friction or piece.sign * v0 > 0):
            marks.append(root(lambda dt: (piece.relative(dt)[1], piece.relative(dt)[2]), one, other))
        elif friction and piece.sign * v1 < 0:
            return Crossing(one, REVERSAL)
        marks.append(other)
        for k in range(1, len(marks)):  # the relative displacement is monotonous here
            d = float(piece.relative(marks[k])[0])
            side = 1 if d > 0 else -1
            middle = float(piece.relative(0.5 * (marks[k - 1] + marks[k]))[1])
            if abs(d) > gap and middle * side > 0:
                return Crossing(_wall(piece, side, marks[k - 1], marks[k]), side)
            if friction and k + 1 < len(marks):
                return Crossing(marks[k], REVERSAL)
    return None


def _wall(piece: Piece, side: int, low: float, high: float) -> float:
    gap = piece.flow.case.gap

    def beyond(dt: float) -> tuple[float, float]:
        values = piece.relative(dt)
        return float(values[0] - side * gap), float(values[1])

    if side * beyond(low)[0] > 0:
        return low
    return root(beyond, low, high)
