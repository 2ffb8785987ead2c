"""First events of guard signals by brute force.

A dense scan in numpy and SciPy's root finder share no code with the exact method.

A signal is y(t) = sum_j Re(u_j exp(s_j t)) + f(tau + t) + p_0 + p_1 t + p_2 t^2/2, with f Re(P(x)
exp(i omega x)). Near t = 0 what is summed is the remainder of each term's Taylor series, on top of
the rate and the bend at the start as they are meant, and walls are measured from the start: a start
on a wall then is exactly there, and the way from it has all digits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

NOTHING = 0
LOW = 1
HIGH = 2
TURN = 3
PER_PERIOD = 24  # times of the scan in a period of the fastest slot
PER_DECADE = 24  # near the start
FIRST = 1e-9  # of that period
EARLY = 2.0  # |s| t of the fastest slot up to which the way from the start is summed
CHUNK = 1024
SERIES = 30  # terms of a Taylor series, for arguments up to EARLY
TANGENT = 1e-12  # of a guard's terms: a touch less deep than this is not judged

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]


def remainder(z: Complex, order: int) -> Complex:
    """Return exp(z) less the first ``order`` terms of its series, for |z| up to EARLY."""
    total = np.zeros_like(z)
    for n in range(SERIES, order - 1, -1):
        total = total * z + 1 / factorial(n)
    return total * z**order


@dataclass(frozen=True)
class Force:
    """The force f(x) = Re(P(x) exp(i omega x)) and its derivatives.

    ``polynomials`` (SERIES, K) are functions of the time x (s) from the window's centre. ``omega``
    is in rad/s.
    """

    polynomials: Complex
    omega: float

    @classmethod
    def of(cls, polynomial: Complex, omega: float) -> Force:
        """Return the force of a polynomial (K,), rising powers, at ``omega`` in rad/s."""
        rows = [polynomial]
        for _ in range(SERIES - 1):
            p = rows[-1]
            rows.append(np.append(p[1:] * np.arange(1, len(p)), 0) + 1j * omega * p)
        return cls(np.array(rows), omega)

    def __call__(self, order: int, x: Array | float) -> Array:
        """Return a derivative of the force at times x in s from the window's centre."""
        return np.real(np.polyval(self.polynomials[order, ::-1], x) * np.exp(1j * self.omega * x))


@dataclass(frozen=True)
class Signals:
    """N signals of the same slots under the same force.

    The arrays are s (J,), u (N, J), p (N, 3), start (N, 3), f with its derivatives at tau
    (SERIES,), and tau (s).

    ``start`` holds y, y' and y'' at t = 0.
    """

    s: Complex
    u: Complex
    p: Array
    start: Array
    force: Force
    pushes: Array
    tau: float

    @property
    def fastest(self) -> float:
        """Largest |s|, or the largest rate of the force, in 1/s."""
        return float(max(np.max(np.abs(self.s)), self.force.omega))

    def of(self, which: Integers) -> Signals:
        """Return some of the signals."""
        return replace(self, u=self.u[which], p=self.p[which], start=self.start[which])

    def sizes(self) -> Array:
        """Return the size of the terms of y, y' and y'' (N, 3)."""
        free = np.stack([np.abs(self.u * self.s**m).sum(axis=1) for m in range(3)], axis=1)
        return np.asarray(
            free
            + [abs(np.polyval(self.force.polynomials[m, ::-1], self.tau)) for m in range(3)]
            + np.abs(self.p)
        )

    def early(self, t: Array) -> tuple[Array, ...]:
        """Return y - y(0), y' and y'' (N, T) at times near the start."""
        z = self.s[:, None] * t
        values = []
        for m in range(3):
            way = np.real((self.u * self.s**m) @ remainder(z, 3 - m))
            way += sum(self.pushes[n] * t ** (n - m) / factorial(n - m) for n in range(3, SERIES))
            way += sum(
                self.start[:, n : n + 1] * t ** (n - m) / factorial(n - m)
                for n in range(max(m, 1), 3)
            )
            values.append(way)
        return tuple(values)

    def late(self, t: Array, wave: Complex | None = None, shift: float = 0.0) -> tuple[Array, ...]:
        """Return y - y(0), y' and y'' (N, T) at times shift + t.

        ``wave`` (J, T) is exp(s t), if it is known.
        """
        wave = np.exp(self.s[:, None] * t) if wave is None else wave
        u = self.u * np.exp(self.s * shift)
        x = shift + t
        p = self.p[:, :, None]
        way = p[:, 0] - self.start[:, :1]
        polynomials = (way + x * (p[:, 1] + 0.5 * x * p[:, 2]), p[:, 1] + x * p[:, 2], p[:, 2])
        rows = [u * self.s**m for m in range(3)]
        return tuple(
            row.real @ wave.real
            - row.imag @ wave.imag
            + self.force(m, self.tau + x)
            + polynomials[m]
            for m, row in enumerate(rows)
        )

    def at(self, t: Array) -> tuple[Array, ...]:
        """Return y - y(0), y' and y'' (N, T) at times that lie close together."""
        return self.early(t) if t[-1] * self.fastest < EARLY * (1 + 1e-9) else self.late(t)


@dataclass(frozen=True)
class Guards:
    """Walls of signals, and the signs of their rates.

    ``low`` and ``high`` (N,) are distances of the walls from y(0), infinite if there is no wall.
    ``direction`` (N,) is the initial sign of the rate, 0 if its zero is not an event.
    """

    low: Array
    high: Array
    direction: Array

    def of(self, which: Integers) -> Guards:
        """Return some of the guards."""
        return Guards(self.low[which], self.high[which], self.direction[which])

    def distances(self, y: Array, v: Array, a: Array) -> dict[int, tuple[Array, Array]]:
        """Return the distance of the signal from each kind of event, and its slope.

        They have the shape (N,) or (N, T).
        """
        low, high, sign = (
            g.reshape(-1, *[1] * (y.ndim - 1)) for g in (self.low, self.high, self.direction)
        )
        turn = np.where(sign == 0, np.inf, sign * v), np.where(sign == 0, 0.0, sign * a)
        return {LOW: (y - low, v), HIGH: (high - y, -v), TURN: turn}


@dataclass
class FirstEvents:
    """First events (N,) of signals.

    Kind, time (s; infinite if there is no event), slope of the guard at the event, and whether the
    case is clear enough to judge.
    """

    kind: Integers
    time: Array
    slope: Array
    clear: NDArray[np.bool_]


def first_events(signals: Signals, guards: Guards, length: float) -> FirstEvents:
    """Return the first event of each signal within ``length`` (s)."""
    count = len(signals.u)
    events = FirstEvents(
        np.zeros(count, dtype=np.int64),
        np.full(count, np.inf),
        np.ones(count),
        np.ones(count, dtype=bool),
    )
    sizes = signals.sizes()
    open_cases = np.arange(count)
    period = 2 * np.pi / signals.fastest
    last = min(EARLY / signals.fastest, length)
    early = np.geomspace(FIRST * period, last, int(PER_DECADE * np.log10(last / FIRST / period)))
    open_cases = _scan(signals, guards, sizes, early, signals.early(early), open_cases, events)
    step = np.arange(CHUNK + 1) * period / PER_PERIOD
    wave = np.exp(signals.s[:, None] * step)
    shift = last
    while shift < length and len(open_cases):
        values = signals.of(open_cases).late(step, wave, shift)
        open_cases = _scan(signals, guards, sizes, shift + step, values, open_cases, events)
        shift += step[-1]
    beyond = events.time >= length
    events.clear &= np.abs(events.time - length) > 1e-6 * period
    events.kind[beyond] = NOTHING
    events.time[beyond] = np.inf
    return events


def _scan(
    signals: Signals,
    guards: Guards,
    sizes: Array,
    t: Array,
    values: tuple[Array, ...],
    cases: Integers,
    events: FirstEvents,
) -> Integers:
    """Find the first events of the open cases at the times t.

    Return the cases that stay open.
    """
    flags = []
    h = np.diff(t)
    for kind, (distance, slope) in guards.of(cases).distances(*values).items():
        terms = sizes[cases, 1 if kind == TURN else 0][:, None]
        with np.errstate(invalid="ignore"):
            dip = np.minimum(
                distance[:, :-1] + h / 3 * slope[:, :-1], distance[:, 1:] - h / 3 * slope[:, 1:]
            )
            dips = (slope[:, :-1] < 0) & (slope[:, 1:] > 0) & (dip < 1e-4 * terms)
        flags.append((distance[:, 1:] <= 0) | dips)
    flagged = flags[0] | flags[1] | flags[2]
    left = []
    for row, case in enumerate(cases):
        one = signals.of(np.array([case]))
        guard = guards.of(np.array([case]))
        for k in np.flatnonzero(flagged[row]):
            if _judge(one, guard, sizes[case], float(t[k]), float(t[k + 1]), case, events):
                break
        else:
            left.append(case)
    return np.array(left, dtype=np.int64)


def _judge(
    signal: Signals,
    guard: Guards,
    sizes: Array,
    start: float,
    stop: float,
    case: int,
    events: FirstEvents,
) -> bool:
    """Find the first event in [start, stop]; return False if there is none."""

    def distance(t: float, kind: int) -> float:
        return float(guard.distances(*signal.at(np.array([t])))[kind][0][0, 0])

    hits = []
    times = np.linspace(start, stop, 65)
    for kind, (distances, _) in guard.distances(*signal.at(times)).items():
        t = times
        values = distances[0]
        k = int(np.argmin(values))
        if 0 < k < 64 and np.isfinite(values[k]):  # a dip
            exact = {"xatol": 1e-9 * (stop - start)}
            low = scipy.optimize.minimize_scalar(
                distance, bounds=(t[k - 1], t[k + 1]), args=(kind,), method="bounded", options=exact
            )
            t = np.insert(t, k, low.x)
            values = np.insert(values, k, low.fun)
            events.clear[case] &= abs(low.fun) > TANGENT * sizes[1 if kind == TURN else 0]
        below = np.flatnonzero(values <= 0)
        if len(below):
            left = t[below[0] - 1] if below[0] else t[0] * 1e-6
            hits.append(
                (
                    scipy.optimize.brentq(
                        distance, left, t[below[0]], args=(kind,), xtol=1e-300, rtol=1e-14
                    ),
                    kind,
                )
            )
    if not hits:
        return False
    hits.sort()
    time, kind = hits[0]
    _, v, a = (float(x[0, 0]) for x in signal.at(np.array([time])))
    events.kind[case] = kind
    events.time[case] = time
    events.slope[case] = abs(a if kind == TURN else v)
    returns = (
        a if kind == LOW else -a
    )  # where this is above zero the signal only dips into the wall
    events.clear[case] &= kind == TURN or v * v > 2 * TANGENT * sizes[0] * returns
    events.clear[case] &= len(hits) == 1 or abs(hits[1][0] - time) > 1e-6 / signal.fastest
    return True
