"""The reference: a trajectory to about 28 digits by Taylor series in double-double arithmetic, independent of impact_env's kernels.

Scenes are those of `contact_automaton`; the drive is one straight piece of frequency. All inputs count as the exact doubles that they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from accuracy import taylor
from accuracy.contact_automaton import CONTACT, REVERSAL, WALL, Automaton, Guard, Regime
from accuracy.taylor import fraction, pair
from impact_env.drive import Drive
from impact_env.extras import optional
from impact_env.scene import InitialState, Scene

with optional():
    import mpmath

Array = NDArray[np.float64]
REST_SPEED = 1e-22  # m/s: slower bounces end a chatter
MAX_EVENTS = 20_000
DIGITS = 40


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Impact times (s) as exact fractions and relative velocities before (m/s), contacts of compliant walls included.

    ``end``: modal displacements, absorber displacement, modal velocities, absorber velocity at ``end_time``, with all their digits. ``events`` counts
    impacts, reversals and releases.
    """

    impact_time: tuple[Fraction, ...]
    relative_velocity: tuple[float, ...]
    end_time: Fraction
    end: tuple[Fraction, ...]
    events: int

    @property
    def end_state(self) -> Array:
        """The end as numbers of 16 digits, (2 N_m + 2,)."""
        return np.array([float(value) for value in self.end])


def _pairs(values: list[Fraction]) -> Array:
    return np.array([pair(value) for value in values])


class _Run:
    """State and constants of one trajectory."""

    def __init__(self, scene: Scene, drive: Drive, initial: InitialState | None, rate: float | None) -> None:
        model, schedule = scene.model, drive.schedule
        if len(schedule.times) != 2:
            raise ValueError("the reference takes one straight piece of frequency")
        self.scene, self.automaton, self.modes = scene, Automaton(scene), model.modes
        self.mass = Fraction(1 if scene.absorber_mass is None else scene.absorber_mass)
        self.tip = [Fraction(x) for x in model.tip_shape]
        self.compliance = 1 / self.mass + sum(x * x for x in self.tip)
        omega = [Fraction(x) for x in model.omega]
        rows = (
            [x * x for x in omega],
            [2 * Fraction(d) * x for d, x in zip(model.damping_ratio, omega, strict=True)],
            [Fraction(x) for x in model.force_shape],
            self.tip,
        )
        self.beam = np.array([_pairs(row) for row in rows])
        self.start_omega = Fraction(schedule.omegas[0])
        slope = (Fraction(schedule.omegas[1]) - self.start_omega) / Fraction(schedule.times[1])
        self.alpha = slope if rate is None else Fraction(rate)
        self.amplitude, self.end = Fraction(drive.amplitude), Fraction(schedule.times[1])
        start = (InitialState() if initial is None else initial).vector(scene)
        with mpmath.workdps(DIGITS):
            phase = [_from_mpmath(f(mpmath.mpf(drive.phase))) for f in (mpmath.cos, mpmath.sin)]
        n = self.modes
        self.place = _pairs([*map(Fraction, start[: n + 1]), *phase])
        self.rate = _pairs([*map(Fraction, start[n + 1 :]), Fraction(0), Fraction(0)])
        self.inverse = _pairs([Fraction(1, k + 1) for k in range(taylor.ORDER + 2)])
        self.time = Fraction(0)
        y, gamma = self.relative()
        self.regime = self.automaton.regime(self.automaton.start(float(y), float(gamma), self.joint_force()))
        self.roots = np.array([int(gamma == 0 and guard.event == REVERSAL) for guard in self.regime.guards], dtype=np.int64)
        self.step = taylor.REACH / self._fastest()

    def _fastest(self) -> float:
        model = self.scene.model
        stiffness = max(self.automaton.wall_stiffness or 0.0, self.regime.stiffness)
        damping = self.regime.damping * float(self.compliance)
        return max(float(np.max(model.omega)), np.sqrt(stiffness * float(self.compliance)), damping, float(self.start_omega))

    def relative(self) -> tuple[Fraction, Fraction]:
        """Return relative displacement and velocity."""
        n = self.modes
        return tuple(  # type: ignore[return-value]
            fraction(*row[n]) - sum(x * fraction(*value) for x, value in zip(self.tip, row, strict=False)) for row in (self.place, self.rate)
        )

    def joint_force(self) -> float:
        """Return the force (N) that would keep absorber and tip together."""
        n, model = self.modes, self.scene.model
        q, u = self.place[:n, 0], self.rate[:n, 0]
        push = float(self.amplitude) * self.place[n + 1, 0] * model.force_shape
        free = push - model.omega**2 * q - 2 * model.damping_ratio * model.omega * u
        return float(model.tip_shape @ free) / float(self.compliance)

    def constants(self, regime: Regime) -> Array:
        joint = 1 / self.compliance
        values = (self.amplitude, self.alpha, 1 / self.mass, joint, regime.constant, regime.stiffness, regime.rest, regime.damping)
        return _pairs([Fraction(value) for value in values])

    def kick(self, restitution: Fraction) -> None:
        """Apply the impulse that turns the relative velocity into -restitution times itself (paper, Eq. impulse); -0 makes it exactly zero."""
        n = self.modes
        impulse = -(1 + restitution) * self.relative()[1] / self.compliance
        rates = [fraction(*row) for row in self.rate]
        for i in range(n):
            rates[i] -= self.tip[i] * impulse
        rates[n] += impulse / self.mass
        self.rate = _pairs(rates)

    def advance(self, until: Fraction) -> Guard | None:
        """Go on by one step, at most to ``until``, and return the guard that ended it, if one did."""
        n = self.modes
        series = np.zeros((taylor.ORDER + 1, n + taylor.EXTRA, 2))
        series[0, : n + 3] = self.place
        series[1, : n + 1] = self.rate[: n + 1]
        omega = np.array(pair(self.start_omega + self.alpha * self.time))
        regime = self.regime
        taylor.taylor_series(series, self.beam, self.constants(regime), self.inverse, omega, regime.joined)
        left = until - self.time
        whole = float(left) > self.step
        offset = (self.step, 0.0) if whole else pair(left)
        hit = -1
        if regime.guards:
            rows = np.array([(g.constant, g.y_weight, g.gamma_weight, g.force_weight) for g in regime.guards])
            hit, at = taylor.first_root(taylor.guard_series(series, rows), self.roots, offset[0])
            offset = at if hit >= 0 else offset
        self.roots = np.zeros(len(regime.guards), dtype=np.int64)
        taylor.advanced(series, offset[0], offset[1], self.place, self.rate)
        self.time = until if hit < 0 and not whole else self.time + fraction(*offset)
        return regime.guards[hit] if hit >= 0 else None

    def jump(self, guard: Guard) -> None:
        """Apply what a guard's end brings."""
        if guard.event == WALL:
            assert self.automaton.restitution is not None
            self.kick(Fraction(self.automaton.restitution))
        name, stop = self.automaton.after(guard, float(self.relative()[1]), self.joint_force(), REST_SPEED)
        if stop:
            self.stop()
        left, self.regime = self.regime, self.automaton.regime(name)
        self.roots = np.array(self.automaton.roots_at_start(guard, left, self.regime, stop), dtype=np.int64)

    def stop(self) -> None:
        """Make the relative velocity zero. It is zero but for rounding, unless a bounce is cut off."""
        gamma = self.relative()[1]
        if abs(gamma) <= REST_SPEED:
            n = self.modes
            self.rate[n] = pair(fraction(*self.rate[n]) - gamma)
        else:
            self.kick(Fraction(0))


def _from_mpmath(value: mpmath.mpf) -> Fraction:
    sign, mantissa, exponent, _ = value._mpf_
    return Fraction(int(-mantissa if sign else mantissa)) * Fraction(2) ** int(exponent)


def reference(
    scene: Scene,
    drive: Drive,
    initial: InitialState | None = None,
    *,
    impacts: int | None = None,
    until: float | None = None,
    rate: float | None = None,
) -> Trajectory:
    """Follow a trajectory to the drive's end, to a time ``until`` (s) or to a number of impacts, whichever is first.

    ``rate`` (rad/s^2) takes the place of the slope between the schedule's two frequencies, whose rounding it carries otherwise.

    Raises ValueError for elastic friction, friction beside compliant walls and bent schedules, RuntimeError if events pile up without end.
    """
    run = _Run(scene, drive, initial, rate)
    end = run.end if until is None else min(run.end, Fraction(until))
    times: list[Fraction] = []
    speeds: list[float] = []
    events = 0
    while run.time < end and (impacts is None or len(times) < impacts):
        guard = run.advance(end)
        if guard is None:
            continue
        events += 1
        if events > MAX_EVENTS:
            raise RuntimeError(f"more than {MAX_EVENTS} events by {float(run.time)} s")
        if guard.event in (WALL, CONTACT):
            times.append(run.time)
            speeds.append(float(run.relative()[1]))
        run.jump(guard)
    last = tuple(fraction(*row) for row in np.concatenate([run.place[: run.modes + 1], run.rate[: run.modes + 1]]))
    return Trajectory(tuple(times), tuple(speeds), run.time, last, events)
