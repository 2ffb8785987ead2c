"""A reference with about 40 correct digits.

It uses Taylor series of order 70 in whole numbers of 2^-200, and finds events on the series
themselves.

The whole numbers stand for numbers of some 60 digits: NumPy arrays of Python's integers.

With q'' = -2 D omega q' - omega^2 q + force_shape f(t) - sum_a shape_a lambda_a and m_a q_a'' =
lambda_a the coefficients follow order by order, time counted in steps. The force A cos(theta),
theta' = Omega + alpha t, has the coefficients that follow from c' = -theta' s, s' = theta' c. All
inputs count as the exact doubles that they are. Regimes, guards and jumps are those of `contact`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.extras import optional
from impact_env.scene import InitialState, Scene
from reference.contact import Contacts, Guard, Number, Regime
from reference.mechanics import Mechanics

with optional():
    import mpmath

Array = NDArray[np.float64]
Whole = NDArray[np.object_]  # integers, in units of 2^-BITS

BITS = 200
ONE = 1 << BITS
UNIT = 2.0**-BITS
PARTS = 96  # places in a step at which a guard is looked at
# a quotient in double precision suffices for Newton's method: each pass gains its digits anew
BISECTIONS = 60
NEWTON = 5
DIGITS = 70  # of the force's phase
ORDER = 70
REACH = 6.0  # rad of the fastest motion in a step: 6^70/70! is below 1e-45
REST_SPEED = 1e-22  # m/s: slower bounces end a chatter
MOST_EVENTS = 20_000


def whole(value: Number) -> int:
    """Return a number in units of 2^-BITS."""
    number = Fraction(value)
    return (number.numerator << BITS) // number.denominator


def wholes(values: Sequence[Number] | Array) -> Whole:
    """Return numbers in units of 2^-BITS, as an array."""
    return np.array([whole(value) for value in values], dtype=object)


def fraction(value: int) -> Fraction:
    """Return the fraction that a whole number stands for."""
    return Fraction(value, ONE)


def inverse(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Return the inverse of a small positive definite matrix."""
    n = len(matrix)
    rows = [[*row, *(Fraction(int(i == j)) for j in range(n))] for i, row in enumerate(matrix)]
    for i in range(n):
        pivot = rows[i][i]
        rows[i] = [x / pivot for x in rows[i]]
        for j in range(n):
            if j != i:
                factor = rows[j][i]
                rows[j] = [x - factor * y for x, y in zip(rows[j], rows[i], strict=True)]
    return [row[n:] for row in rows]


def value_at(rows: Whole, at: int) -> tuple[Whole, Whole]:
    """Return the sums of rows[k] at^k, and their derivatives."""
    count = np.arange(1, len(rows)).astype(object)
    if at == ONE:
        return rows.sum(axis=0), count @ rows[1:]
    powers = [ONE]
    for _ in range(len(rows) - 1):
        powers.append((powers[-1] * at) >> BITS)
    row = np.array(powers, dtype=object)
    return (row @ rows) >> BITS, ((row[:-1] * count) @ rows[1:]) >> BITS


def first_root(row: list[int], end: int) -> int | None:
    """Return the first place in (0, end], in steps, where a guard becomes negative.

    ``row`` is the guard's series without the powers of time with which it starts, so that a regime
    that starts at a zero of its guard lasts until the next zero.
    """
    numbers = np.array(row, dtype=object).astype(float) * UNIT
    if numbers[0] < 0:
        return 0
    reach = end * UNIT
    places = np.arange(1, PARTS + 1) / PARTS
    negative = np.flatnonzero(np.polynomial.polynomial.polyval(reach * places, numbers) < 0)
    if not len(negative):
        return None
    low, high = (reach * (int(negative[0]) + k) / PARTS for k in (0, 1))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (
            (low, middle)
            if np.polynomial.polynomial.polyval(middle, numbers) < 0
            else (middle, high)
        )
    at = whole(high)
    series = np.array(row, dtype=object)
    for _ in range(NEWTON):
        value, slope = (float(x) for x in value_at(series, at))
        at -= whole(value / slope)
    return at


@dataclass(frozen=True)
class Event:
    """An event.

    Its time (s), its absorber, its kind (a name of `contact`), and the following regime of that
    absorber.
    """

    time: Fraction
    absorber: int
    what: str
    regime: str


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A trajectory with its impacts and events.

    Impact times (s) are exact fractions. Relative velocities are those before the impact (m/s).
    Contacts with compliant walls are included.

    ``end``: modal displacements, absorber displacements, modal velocities, absorber velocities at
    ``end_time``, with all their digits. ``start``: the regime of each absorber at time 0.
    """

    impact_time: tuple[Fraction, ...]
    relative_velocity: tuple[float, ...]
    impact_absorber: tuple[int, ...]
    start: tuple[str, ...]
    events: tuple[Event, ...]
    end_time: Fraction
    end: tuple[Fraction, ...]

    @property
    def end_state(self) -> Array:
        """The end as numbers of 16 digits, (2 N_m + 2 n,)."""
        return np.array([float(value) for value in self.end])


class Run:
    """State and constants of one trajectory for `contact`, with its steps."""

    def __init__(
        self, scene: Scene, drive: Drive, initial: InitialState, rate: float | None
    ) -> None:
        m = Mechanics(scene)
        model = scene.model
        self.mechanics = m
        self.modes = m.modes
        self.places = m.places
        self.mobility = m.mobility
        self.schedule = [
            (Fraction(t), Fraction(omega))
            for t, omega in zip(drive.schedule.times, drive.schedule.omegas, strict=True)
        ]
        slopes = [
            (later[1] - sooner[1]) / (later[0] - sooner[0])
            for sooner, later in zip(self.schedule, self.schedule[1:], strict=False)
        ]
        if rate is not None and len(slopes) > 1:
            raise ValueError(
                "a rate of its own takes the place of one slope: the schedule must be straight"
            )
        self.slopes = slopes if rate is None else [Fraction(rate)]
        self.amplitude = Fraction(drive.amplitude)
        self.shapes = np.array([wholes(row) for row in m.shapes], dtype=object).reshape(
            m.places, m.modes
        )
        self.inverse_mass = wholes([1 / Fraction(mass) for mass in m.masses])
        self.exact_mobility = [
            [fraction(x) for x in row]
            for row in ((self.shapes @ self.shapes.T) >> BITS) + np.diag(self.inverse_mass)
        ]
        start = initial.vector(scene)
        self.place = wholes(start[: m.half])
        self.speed = wholes(start[m.half :])
        with mpmath.workdps(DIGITS):
            phase = mpmath.mpf(drive.phase)
            self.cosine, self.sine = (
                int(mpmath.floor(mpmath.ldexp(f(phase), BITS))) for f in (mpmath.cos, mpmath.sin)
            )
        self.time = Fraction(0)
        self.contacts = Contacts(scene, self, REST_SPEED)
        self.step = Fraction(REACH / self._fastest(float(np.max(drive.schedule.omegas))))
        omega = [Fraction(x) for x in model.omega]
        ratio = [Fraction(x) for x in model.damping_ratio]
        self.square = wholes([(x * self.step) ** 2 for x in omega])
        self.rate = wholes([2 * d * x * self.step for d, x in zip(ratio, omega, strict=True)])
        self.push = wholes([Fraction(x) * self.amplitude * self.step**2 for x in model.force_shape])

    def _fastest(self, force: float) -> float:
        rates = [force, float(np.max(self.mechanics.model.omega))]
        for a, automaton in enumerate(self.contacts.automata):
            only = automaton.only()
            compliance = float(self.mobility[a, a])
            stiffness = (
                (automaton.wall_stiffness or 0.0) + (automaton.slider or 0.0) + only.stiffness
            )
            rates += [np.sqrt(stiffness * compliance), only.damping * compliance]
        return max(rates)

    # --- what the contacts ask for

    def relative(self, which: int) -> tuple[Number, Number]:
        """Return relative displacement (m) and velocity (m/s) of an absorber."""
        n = self.modes
        shape = self.shapes[which]
        y, gamma = (
            int(row[n + which]) - (int(shape @ row[:n]) >> BITS) for row in (self.place, self.speed)
        )
        return fraction(y), fraction(gamma)

    def pull(self) -> Array:
        """Return the accelerations (n,) in m/s^2 of the absorbers' places if no absorber pushed."""
        n = self.modes
        model = self.mechanics.model
        q, u = (row[:n].astype(float) * UNIT for row in (self.place, self.speed))
        force = float(self.amplitude) * self.cosine * UNIT
        return np.asarray(
            self.mechanics.shapes
            @ (
                force * model.force_shape
                - model.omega**2 * q
                - 2 * model.damping_ratio * model.omega * u
            )
        )

    def strike(self, which: int, restitution: float) -> None:
        """Turn the relative velocity of an absorber into -restitution times itself."""
        self._change([which], -(1 + Fraction(restitution)))

    def stop(self, which: Sequence[int]) -> None:
        """Make relative velocities zero, by impulses."""
        self._change(which, Fraction(-1))

    def _change(self, which: Sequence[int], share: Fraction) -> None:
        """Change the relative velocities of absorbers by a multiple of themselves."""
        n = self.modes
        changes = [share * Fraction(self.relative(a)[1]) for a in which]
        inverted = inverse([[self.exact_mobility[a][b] for b in which] for a in which])
        for a, row in zip(which, inverted, strict=True):
            impulse = whole(
                sum((x * change for x, change in zip(row, changes, strict=True)), Fraction(0))
            )
            self.speed[:n] -= (self.shapes[a] * impulse) >> BITS
            self.speed[n + a] += (int(self.inverse_mass[a]) * impulse) >> BITS

    # --- series

    def _laws(self) -> tuple[Whole, list[int], Whole]:
        """Return the laws of all absorbers in units of a step, (6, n).

        They are forces without motion, stiffnesses, rest positions, sliders' stiffnesses, sliders'
        rest positions, and dampings.

        And which are joined (their laws are zero), with the inverse mobility of these.
        """
        regimes = self.contacts.regimes
        h = self.step
        loose = [Regime("joined") if regime.joined else regime for regime in regimes]
        joined = [a for a, regime in enumerate(regimes) if regime.joined]
        joint = inverse([[self.exact_mobility[a][b] for b in joined] for a in joined])
        rows = [
            (
                Fraction(r.constant) * h**2,
                Fraction(r.stiffness) * h**2,
                r.rest,
                Fraction(r.slider) * h**2,
                r.slider_rest,
                Fraction(r.damping) * h,
            )
            for r in loose
        ]
        return (
            np.array([wholes(row) for row in rows], dtype=object).T,
            joined,
            np.array([wholes(row) for row in joint], dtype=object),
        )

    def _pushes(self, omega: Fraction, slope: Fraction) -> tuple[list[int], list[int]]:
        """Return the coefficients (ORDER + 1,) of the force's cosine and sine."""
        turn = whole(omega * self.step)
        bend = whole(slope * self.step**2)
        cosine = [self.cosine]
        sine = [self.sine]
        for k in range(ORDER):
            before = (cosine[k - 1], sine[k - 1]) if k else (0, 0)
            cosine.append(-((turn * sine[k] + bend * before[1]) >> BITS) // (k + 1))
            sine.append(((turn * cosine[k] + bend * before[0]) >> BITS) // (k + 1))
        return cosine, sine

    def _series(self, cosine: list[int]) -> tuple[Whole, Whole]:
        """Return the coefficients of all displacements and forces.

        Those of displacements are (ORDER + 1, N_m + n), those of forces in units of a step (ORDER +
        1, n).
        """
        n = self.modes
        shapes = self.shapes
        (constant, stiffness, rest, slider, slider_rest, damping), joined, joint = self._laws()
        springs = any(
            map(np.any, (stiffness, slider, damping))
        )  # forces depend on the motion of an absorber that is not joined
        x = np.zeros((ORDER + 1, n + self.places), dtype=object)
        forces = np.zeros((ORDER + 1, self.places), dtype=object)
        h = whole(self.step)
        x[0] = self.place
        x[1] = (self.speed * h) >> BITS
        y = self._distance(x[0])
        later = self._distance(x[1])
        for k in range(ORDER - 1):
            free = (
                self.push * cosine[k]
                - self.square * x[k, :n]
                - self.rate * (x[k + 1, :n] * (k + 1))
            ) >> BITS
            force = forces[k]
            if k == 0:
                force += constant + ((stiffness * rest + slider * slider_rest) >> BITS)
            if springs:
                force -= ((stiffness + slider) * y + damping * (later * (k + 1))) >> BITS
            acting = k == 0 or springs
            if joined:
                pull = (
                    shapes[joined] @ (free - ((shapes.T @ force) >> BITS if acting else 0)) >> BITS
                )
                force[joined] = (joint @ pull) >> BITS
            if acting or joined:
                free = free - ((shapes.T @ force) >> BITS)
                x[k + 2, n:] = ((self.inverse_mass * force) >> BITS) // ((k + 1) * (k + 2))
            x[k + 2, :n] = free // ((k + 1) * (k + 2))
            if springs:
                y = later
                later = self._distance(x[k + 2])
        return x, forces

    def _distance(self, x: Whole) -> Whole:
        """Return relative displacements (..., n) of displacements (..., N_m + n)."""
        return np.asarray(x[..., self.modes :] - ((x[..., : self.modes] @ self.shapes.T) >> BITS))

    def _guard(self, guard: Guard, y: Whole, force: Whole) -> list[int]:
        """Return the coefficients (ORDER - 1,) of a guard, times a positive factor.

        They follow from those of an absorber's y and force.
        """
        if guard.gamma_weight:
            return [int(guard.gamma_weight) * (k + 1) * int(y[k + 1]) for k in range(ORDER - 1)]
        weight = whole(guard.y_weight or guard.force_weight)
        row = [
            (weight * int(value)) >> BITS for value in (y if guard.y_weight else force)[: ORDER - 1]
        ]
        constant = Fraction(guard.constant) - Fraction(guard.y_weight) * Fraction(guard.rest)
        row[0] += whole(constant if guard.y_weight else constant * self.step**2)
        return row

    def advance(self, until: Fraction) -> tuple[int, Guard] | None:
        """Advance by one step, at most to ``until``.

        Return the absorber and the guard if an event ended the step. The event is not applied yet.
        """
        k = max(k for k, (time, _) in enumerate(self.schedule[:-1]) if time <= self.time)
        slope = self.slopes[k]
        cosine, sine = self._pushes(
            self.schedule[k][1] + slope * (self.time - self.schedule[k][0]), slope
        )
        x, forces = self._series(cosine)
        end = min(until, self.schedule[k + 1][0]) if k + 2 < len(self.schedule) else until
        last = min(ONE, whole((end - self.time) / self.step))
        hit = None
        at = last
        if any(regime.guards for regime in self.contacts.regimes):
            y = self._distance(x)
            for which, regime in enumerate(self.contacts.regimes):
                for guard, order in zip(regime.guards, self.contacts.zeros[which], strict=True):
                    root = first_root(self._guard(guard, y[:, which], forces[:, which])[order:], at)
                    if root is not None and (hit is None or root < at):
                        hit = (which, guard)
                        at = root
        self.contacts.go_on()
        self.place, speed = value_at(x, at)
        self.speed = (speed * whole(1 / self.step)) >> BITS
        self.cosine, self.sine = (
            int(value_at(np.array(row, dtype=object), at)[0]) for row in (cosine, sine)
        )
        self.time = end if hit is None and last < ONE else self.time + self.step * fraction(at)
        return hit


def follow(
    scene: Scene,
    drive: Drive,
    initial: InitialState | None = None,
    *,
    impacts: int | None = None,
    events: int | None = None,
    until: float | None = None,
    rate: float | None = None,
) -> Trajectory:
    """Follow a trajectory to the drive's end, or to an earlier limit.

    The limits are a time ``until`` (s) and numbers of impacts or events. The first one that is
    reached ends the trajectory.

    ``rate`` (rad/s^2) takes the place of the slope between the schedule's two frequencies, whose
    rounding it carries otherwise.

    Raises ValueError for a rate beside a bent schedule, RuntimeError if events pile up without end.
    """
    run = Run(scene, drive, InitialState() if initial is None else initial, rate)
    end = run.schedule[-1][0] if until is None else min(run.schedule[-1][0], Fraction(until))
    start = tuple(regime.name for regime in run.contacts.regimes)
    struck = [(run.time, *hit) for hit in run.contacts.struck]
    happened: list[Event] = []
    while (
        run.time < end
        and (impacts is None or len(struck) < impacts)
        and (events is None or len(happened) < events)
    ):
        hit = run.advance(end)
        if hit is None:
            continue
        if len(happened) >= MOST_EVENTS:
            raise RuntimeError(f"more than {MOST_EVENTS} events by {float(run.time)} s")
        which, guard = hit
        run.contacts.jump(which, guard)
        happened.append(Event(run.time, which, guard.event, run.contacts.regimes[which].name))
        struck += [(run.time, *one) for one in run.contacts.struck]
    times, who, speeds = zip(*struck, strict=True) if struck else ((), (), ())
    last = tuple(fraction(int(x)) for x in (*run.place, *run.speed))
    return Trajectory(times, speeds, who, start, tuple(happened), run.time, last)
