"""One mode with a friction damper, piece by piece in closed form: stuck together it is an oscillator of larger mass, else one under a constant force.

Nothing of the package is used. The absorber slides (relative velocity of one sign), or sticks until the force that carries it reaches the limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.optimize

Array = np.ndarray


@dataclass(frozen=True)
class Damper:
    """q'' + 2 D w q' + w^2 q = push f cos(omega t) - tip R, and m x'' = R: |R| is at most the limit."""

    w: float
    damping: float
    push: float
    tip: float
    mass: float
    force: float
    omega: float
    limit: float

    def oscillator(self, t0: float, q0: float, v0: float, inertia: float, pull: float):
        """Return q(t) and its derivatives (3,) of inertia q'' + 2 D w q' + w^2 q = push f cos(omega t) - tip pull."""
        rate, root = self.damping * self.w / inertia, np.sqrt(self.w**2 / inertia - (self.damping * self.w / inertia) ** 2)
        wave = self.push * self.force / (self.w**2 - inertia * self.omega**2 + 2j * self.damping * self.w * self.omega)
        rest = -self.tip * pull / self.w**2
        s = complex(-rate, root)
        start = wave * np.exp(1j * self.omega * t0)
        a, b = q0 - rest - start.real, v0 - (1j * self.omega * start).real
        z = a - 1j * (b + rate * a) / root

        def motion(t: float) -> Array:
            free, forced = z * np.exp(s * (t - t0)), wave * np.exp(1j * self.omega * t)
            return np.array([free.real + forced.real + rest, (s * free + 1j * self.omega * forced).real, (s**2 * free - self.omega**2 * forced).real])

        return motion

    def settled(self, periods: int) -> tuple[list[tuple[str, float]], Array, float]:
        """Return events ("stick" or "slip", time) of the last period, its state (q, q', x') at its begin, and the largest |tip|."""
        turn = 2 * np.pi / self.omega
        t, q, v, u, stuck, pull = 0.0, 0.0, 0.0, 0.0, True, 0.0
        events, begin, tips = [], np.zeros(3), []
        while t < periods * turn:
            inertia = 1 + self.mass * self.tip**2 if stuck else 1.0
            motion = self.oscillator(t, q, v, inertia, pull if not stuck else 0.0)

            def guard(s: float, motion=motion, stuck=stuck, t=t, u=u, pull=pull) -> float:
                if stuck:
                    return self.limit - abs(self.mass * self.tip * motion(s)[2])
                return (u + pull / self.mass * (s - t) - self.tip * motion(s)[1]) * -np.sign(pull)  # friction acts against the sliding

            grid = t + turn / 100 * np.arange(1, 226)
            values = np.array([guard(s) for s in grid])
            out = np.flatnonzero(values < 0)
            if len(out) == 0:  # stuck for more than two periods, as at first
                t, (q, v, _) = float(grid[-1]), motion(grid[-1])
                u = self.tip * v
                continue
            k = int(out[0])
            low = t + 1e-9 * turn if k == 0 else grid[k - 1]
            end = scipy.optimize.brentq(guard, low, grid[k], xtol=1e-18, rtol=1e-15)
            last = (periods - 1) * turn
            if end > last:
                tips += [abs(self.tip * motion(s)[0]) for s in np.linspace(max(t, last), min(end, periods * turn), 200)]
            if t <= last < end:
                q1, v1, _ = motion(last)
                begin = np.array([q1, v1, self.tip * v1 if stuck else u + pull / self.mass * (last - t)])
            (q, v, a), before, t = motion(end), t, end
            if stuck:
                u, pull, stuck = self.tip * v, float(np.sign(a * self.tip)) * self.limit, False
                events.append(("slip", t))
            else:
                u += pull / self.mass * (t - before)
                acceleration = (self.push * self.force * np.cos(self.omega * t) - 2 * self.damping * self.w * v - self.w**2 * q) * self.tip
                needed = self.mass * acceleration / (1 + self.mass * self.tip**2)
                stuck = abs(needed) <= self.limit
                pull = float(np.sign(needed)) * self.limit
                events.append(("stick" if stuck else "turn", t))
        return [event for event in events if (periods - 1) * turn <= event[1] < periods * turn], begin, float(np.max(tips))
