"""Oscillators on one coordinate for harmonic balance, and their steady motion by time integration: nothing is shared but the equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.integrate

from impact_env.periodic.contact import Contact
from impact_env.periodic.harmonic_balance import Dynamics

Array = np.ndarray
Rate = Callable[[float, Array], list[float]]


@dataclass(frozen=True)
class Oscillator:
    """x'' + 2 damping x' + x = drive + contact force: what the coordinate asks of the contact is its own dynamic force."""

    harmonics: int
    damping: float = 0.05
    multiple: int = 1

    def dynamics(self, omega: float) -> Dynamics:
        k = np.arange(self.harmonics + 1)
        drive = np.zeros(self.harmonics + 1, dtype=complex)
        drive[1] = -1.0
        stiffness = 1 - (k * omega) ** 2 + 2j * self.damping * k * omega
        return Dynamics(stiffness, drive, -2 * k**2 * omega + 2j * self.damping * k, 0 * drive)

    def tip(self, dynamic: Array, force: float, omega: float) -> Array:
        d = self.dynamics(omega)
        return (dynamic - force * d.drive) / d.stiffness


@dataclass(frozen=True)
class Cubic:
    """A hardening spring: contact force -strength x^3, its harmonics by convolution of Fourier coefficients."""

    strength: float

    def contact(self, motion: Array, dynamic: Array, omega: float, parameter: str) -> Contact:  # noqa: ARG002
        h, n = (len(motion) - 1) // 2, len(motion)

        def two_sided(row: Array) -> Array:
            half = (row[1 : h + 1] - 1j * row[h + 1 :]) / 2
            return np.concatenate([np.conj(half[::-1]), [row[0]], half])

        def one_sided(values: Array, middle: int) -> Array:
            half = 2 * values[middle + 1 : middle + 1 + h]
            return np.concatenate([[values[middle].real], half.real, -half.imag])

        x = two_sided(motion)
        square = np.convolve(x, x)
        force = -self.strength * one_sided(np.convolve(square, x), 3 * h)
        columns = [one_sided(np.convolve(square, two_sided(unit)), 3 * h) for unit in np.eye(n)]
        return Contact(force, -3 * self.strength * np.array(columns).T, np.zeros((n, n)), np.zeros(n), np.zeros(n))


def settled(rate: Rate, start: list[float], omega: float, periods: int) -> tuple[float, float, Array]:
    """Return half of peak to peak and RMS of the first coordinate in the last of many periods, and its state, by DOP853 at 1e-11."""
    turn = 2 * np.pi / omega
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "max_step": turn / 40}
    before = scipy.integrate.solve_ivp(rate, (0, periods * turn), start, **options)
    t = np.linspace(0, turn, 4001)
    x = scipy.integrate.solve_ivp(rate, (0, turn), before.y[:, -1], t_eval=t, **options).y[0]
    return float(np.ptp(x)) / 2, float(np.sqrt(np.mean(x[:-1] ** 2))), before.y[:, -1]


def elastic_friction_settled(omega: float, force: float, damping: float, limit: float, stiffness: float, periods: int) -> tuple[float, float]:
    """Return half of peak to peak and RMS of an oscillator on an elastic Coulomb joint: stretch by stretch, each ended by its event."""
    turn, t, now, state = 2 * np.pi / omega, 0.0, [0.0, 0.0, 0.0], "stick"
    times, values = [], []

    def rate(t: float, y: Array) -> list[float]:
        slope = -stiffness * y[1] if state == "stick" else 0.0
        return [y[1], force * np.cos(omega * t) - y[0] - 2 * damping * y[1] + y[2], slope]

    def at_limit(t: float, y: Array) -> float:  # noqa: ARG001
        return limit - abs(y[2])

    def turns(t: float, y: Array) -> float:  # noqa: ARG001
        return y[1] * -np.sign(y[2])  # falls to zero while it slides against the force

    at_limit.terminal, at_limit.direction = True, -1
    turns.terminal, turns.direction = True, -1
    while t < periods * turn:
        event = at_limit if state == "stick" else turns
        run = scipy.integrate.solve_ivp(
            rate, (t, periods * turn), now, events=event, method="DOP853", rtol=1e-11, atol=1e-13, max_step=turn / 60, dense_output=True
        )
        grid = np.linspace(run.t[0], run.t[-1], max(3, int(2000 * (run.t[-1] - run.t[0]) / turn)))
        times.append(grid)
        values.append(run.sol(grid)[0])
        t, now = float(run.t[-1]), [float(v) for v in run.y[:, -1]]
        if run.status == 1:
            if state == "stick":
                now[2] = limit * np.sign(now[2])
            else:
                now[1] = 0.0
            state = "slip" if state == "stick" else "stick"
    time, x = np.concatenate(times), np.concatenate(values)
    last = np.interp(np.linspace(periods - 1, periods, 20001) * turn, time, x)
    return float(np.ptp(last)) / 2, float(np.sqrt(np.mean(last[:-1] ** 2)))


def symmetric_orbit(model, mass: float, omega: float, force: float, gap: float, limit: float = 0.0) -> tuple[float, float, float]:
    """Return impulse (N s), phase of the force (rad) at the lower wall's impact, and half of peak to peak of the tip (m); larger impulse, e = 1.

    The two conditions at the impact, with all responses summed over 2e5 harmonics: a check of closed forms and of harmonic balance alike.
    """
    k = np.arange(1, 200001, 2)
    w = k * omega

    def receptance(a: Array, b: Array, w: Array) -> Array:
        return sum(x * y / (o**2 - w**2 + 2j * d * o * w) for x, y, o, d in zip(a, b, model.omega, model.damping_ratio, strict=True))

    tip = model.tip_shape
    own = receptance(tip, tip, w)
    relative = own - 1 / (mass * w**2)
    beat, square = 2 * omega / np.pi * np.ones_like(w), 4j * limit / (np.pi * k)  # impulses +1, -1 half a period apart; friction against the motion
    driven = force * complex(receptance(tip, model.force_shape, np.array(omega)))
    tail = 2 * omega / np.pi / mass * (np.pi**2 / 8 - np.sum(1.0 / k**2)) / omega**2  # of the absorber's own part, which falls as 1/k^2
    a, a0 = np.sum((relative * beat).real) - tail, np.sum((relative * square).real) + gap
    # velocity as the mean of both sides: the sum of its harmonics at the jump is just that
    b, b0 = np.sum((1j * w * relative * beat).real) / omega, np.sum((1j * w * relative * square).real) / omega
    p = np.max(np.roots([a * a + b * b, 2 * (a * a0 + b * b0), a0 * a0 + b0 * b0 - abs(driven) ** 2]).real)
    phase = float(np.angle(((a * p + a0) - 1j * (b * p + b0)) / driven))
    angle = np.linspace(0, 2 * np.pi, 40001)
    pushed = -own * (p * beat + square)
    x = (driven * np.exp(1j * (angle + phase))).real
    for part, order in zip(pushed[:300], k[:300], strict=True):
        x = x + (part * np.exp(1j * order * angle)).real
    return float(p), phase, float(np.ptp(x)) / 2
