"""A reference in double precision by dense matrix exponentials on a fine grid.

Events are found by root finding. The reference is slow, short and independent.

It shares no algorithm with the methods that it tests: no modes of coupled regimes, no expansion of
the drive, no bounds. A regime is a dense first-order matrix (`mechanics`); a step is its
exponential plus Gauss-Legendre quadrature of the force. A guard is assumed to change its sign at
most once between two grid points; this is likely on the fine grid, but not proved. Where the
reference is not reliable it ends early.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.scene import InitialState, Scene
from reference.contact import CONTACT, HOLD, SLIP, WALL, Contacts, Guard, Number, Regime
from reference.mechanics import Linear, Mechanics

Array = NDArray[np.float64]
TURN = 0.5  # rad by which the fastest motion turns in a step of the grid
SLIDER_TURN = 0.125  # rad; the same where a spring gives way at the very peak of its force
# the same for scenes of so many modes: their highest modes hardly move
COARSE_TURN = 1.0
COARSE_FROM = 30
CALM_TURN = 1.0  # rad; the same without events, where long steps are asked for
NODES, CALM_NODES = (np.polynomial.legendre.leggauss(n) for n in (8, 14))
# where an event seems to follow another within a step
FINER = 32
FINEST = 32**5
TAYLOR_TERMS = 20
FORCE_WEIGHT = (
    6.0  # the force alone may turn a relative velocity twice in a step that would do for a mode
)
SAME_STEP = 1e-12  # two steps that differ by less, relatively, differ by the rounding of their ends
FIRST_SLIP = 64  # steps within TURN of the spring that gives way: a stiff one holds again soon
REST_SPEED = 1e-9  # of gap times first frequency: slower bounces end a chatter
REST_SHARE = (
    1e-6  # of the fastest impact so far: the same. What that leaves out is as small as its square
)
MOST_STEPS = 3_000_000
MOST_EVENTS = 50  # between two samples
HUMP = np.linspace(0, 1, 65)[1:-1]

Step = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Inputs:
    """A load as functions of time.

    ``force`` is in N and ``base``, the base's acceleration, in m/s^2. Both are smooth between
    ``breaks`` (K,) in s. ``highest`` is in rad/s.

    ``further``: further forces in N, each with its mode shape (N_m,) in 1/sqrt(kg).
    """

    force: Callable[[Array], Array]
    base: Callable[[Array], Array]
    breaks: Array
    highest: float
    further: tuple[tuple[Array, Callable[[Array], Array]], ...] = ()


def harmonic(drive: Drive) -> Inputs:
    """Return the inputs of one force."""
    schedule = drive.schedule

    def force(times: Array) -> Array:
        return np.asarray(drive.amplitude * np.cos(schedule.phase_at(times) + drive.phase))

    return Inputs(force, np.zeros_like, schedule.times, float(np.max(schedule.omegas)))


@dataclass(frozen=True, eq=False)
class Truth:
    """Samples (S,) of a reference run, as far as the reference could follow it.

    Time in s, tip displacement in m, (S, n) relative displacements in m, and states (S, 2 N_m + 2
    n).

    A state is that of `InitialState.vector`. ``relative`` is (S,) with one absorber or none.
    Impacts and contacts (K,) up to the last sample: time in s, relative velocity before in m/s,
    absorber. ``events`` counts all events, ``complete`` says whether the reference went to its end.
    """

    time: Array
    tip: Array
    relative: Array
    states: Array
    impacts: Array
    impact_velocity: Array
    impact_absorber: NDArray[np.int64]
    events: int
    complete: bool


def _flow(matrix: Array, length: float, x: Array) -> Array:
    total = x
    term = x
    for k in range(1, TAYLOR_TERMS):
        term = matrix @ term * (length / k)
        total = total + term
    return total


def _exponential(matrix: Array, length: float, x: Array) -> Array:
    return np.asarray(scipy.linalg.expm(matrix * length) @ x)


class Walk:
    """State of a reference run for `contact`, with steps from event to event."""

    def __init__(
        self,
        scene: Scene,
        drive: Inputs,
        initial: InitialState,
        most_events: int = MOST_EVENTS,
        long_steps: bool = False,
    ) -> None:
        self.mechanics = Mechanics(scene, further=[shape for shape, _ in drive.further])
        self.drive = drive
        self.most_events = most_events
        self.long_steps = long_steps
        self.mobility = self.mechanics.mobility
        self.x = self.mechanics.state(initial.vector(scene))
        self.time = 0.0
        self._made: dict[tuple[Regime, ...], tuple[Linear, float]] = {}
        self._last_step: tuple[tuple[Regime, ...], float, Step] | None = None
        gaps = [walls.gap for walls in map(scene.cavity, range(scene.places)) if walls is not None]
        self.contacts = Contacts(
            scene, self, REST_SPEED * min(gaps, default=0.0) * float(scene.model.omega[0])
        )
        self.steps = 0
        self.events = 0
        self.slipped = False
        self.impacts: list[tuple[float, int, float]] = []
        self._note()
        self._joined_at: float | None = None  # relative displacement since one absorber is joined

    # --- what the contacts ask for

    def relative(self, which: int) -> tuple[Number, Number]:
        """Return relative displacement (m) and velocity (m/s) of an absorber."""
        return float(self.mechanics.gaps[which] @ self.x), float(
            self.mechanics.speeds[which] @ self.x
        )

    def pull(self) -> Array:
        """Return the relative accelerations (n,) in m/s^2 of the absorbers' places.

        They are relative to the absorbers, without forces of the absorbers.
        """
        m = self.mechanics
        now = self._inputs(np.array([self.time]))[:, 0]
        return np.asarray(
            m.shapes @ (m.unforced @ self.x + m.driven @ now) - m.carried @ now - m.falling
        )

    def strike(self, which: int, restitution: float) -> None:
        """Turn the relative velocity of an absorber into -restitution times itself."""
        self.mechanics.impulse(
            self.x, [which], -(1 + restitution) * self.mechanics.speeds[[which]] @ self.x
        )

    def stop(self, which: Sequence[int]) -> None:
        """Make relative velocities zero, by impulses."""
        self.mechanics.impulse(self.x, which, -self.mechanics.speeds[list(which)] @ self.x)

    # --- motion

    def _inputs(self, times: Array) -> Array:
        further = [force(times) for _, force in self.drive.further]
        return np.stack([self.drive.force(times), self.drive.base(times), *further])

    def _linear(self, regimes: tuple[Regime, ...]) -> tuple[Linear, float]:
        """Return the equations of regimes and their fastest rate in 1/s."""
        if regimes not in self._made:
            linear = self.mechanics.linear(regimes)
            self._made[regimes] = linear, float(np.max(np.abs(np.linalg.eigvals(linear.matrix))))
        return self._made[regimes]

    def sample(self) -> tuple[float, Array]:
        """Return tip displacement and relative displacements (n,) in m.

        The position of a joined absorber gives the tip more precisely than a sum over modes.
        """
        m = self.mechanics
        tip = float(m.tip @ self.x)
        relative = m.gaps @ self.x
        if self.contacts.regimes[0].joined and m.places == 1:
            self._joined_at = float(relative[0]) if self._joined_at is None else self._joined_at
            relative = np.array([self._joined_at])
            tip = float(self.x[m.modes] / m.scale[-1]) - self._joined_at
        return tip, relative

    def to(self, end: float) -> bool:
        """Advance to a time in s; return False if the reference must end before."""
        before = self.events
        breaks = self.drive.breaks
        while self.time < end:
            stop = breaks[(breaks > self.time) & (breaks < end)]
            if self.events - before > self.most_events or not self._stretch(
                float(stop[0]) if len(stop) else end
            ):
                return False
        return True

    def _turn(self) -> float:
        if self.long_steps and not any(regime.guards for regime in self.contacts.regimes):
            return CALM_TURN
        if self.mechanics.modes >= COARSE_FROM:
            return COARSE_TURN
        return (
            SLIDER_TURN if any(automaton.slider for automaton in self.contacts.automata) else TURN
        )

    def _stretch(self, end: float, finer: int = 1, least: int = 1) -> bool:
        """Advance to ``end`` or to the next event.

        The grid is ``finer`` times finer than usual and has at least ``least`` steps.
        """
        regimes = tuple(self.contacts.regimes)
        linear, fastest = self._linear(regimes)
        calm = self.long_steps and not any(regime.guards for regime in regimes)
        if self.slipped and least == 1:
            held = self._linear((self.contacts.automata[0].sprung(regimes[0].side),))[1]
            return self._stretch(
                min(end, self.time + TURN / self._rate(held, False) / finer), finer, FIRST_SLIP
            )
        count = max(
            least,
            int(np.ceil((end - self.time) * self._rate(fastest, calm) * finer / self._turn())),
        )
        h = (end - self.time) / count
        if self.steps + count > MOST_STEPS:
            return False
        self.steps += count
        whole, columns, nodes = self._step(regimes, linear, h, calm)
        times = np.asarray(self.time + h * np.arange(count + 1), dtype=np.float64)
        pushes = np.einsum("sum,umk->sk", columns, self._inputs(times[:-1] + nodes[:, None]))
        xs = np.empty((len(self.x), count + 1))
        xs[:, 0] = self.x
        for k in range(count):
            xs[:, k + 1] = whole @ xs[:, k] + pushes[:, k]
        passed = self._first(linear, xs, times, h)
        if not passed:
            self.x = xs[:, -1]
            self.time = end
            self.slipped = False
            self.contacts.go_on()
            return True
        k = passed[0][2]
        if k == 0 and any(self._fresh(which, number) for which, number, _ in passed):
            # back within the first step: the grid is too coarse to tell what happened
            return finer < FINEST and self._stretch(
                self.time + min(4 * h, end - self.time), finer * FINER
            )
        self._event(passed, linear, xs[:, k], float(times[k]), h)
        return True

    def _rate(self, fastest: float, calm: bool) -> float:
        return max(fastest, (1.0 if calm else FORCE_WEIGHT) * self.drive.highest)

    def _fresh(self, which: int, number: int) -> bool:
        """Return whether a guard is one that the last event has just left behind."""
        guard = self.contacts.regimes[which].guards[number]
        return self.contacts.zeros[which][number] > 0 or (self.slipped and guard.event == HOLD)

    def _step(self, regimes: tuple[Regime, ...], linear: Linear, h: float, calm: bool) -> Step:
        """Return the exponential of a step of h s, and its quadrature of the inputs.

        The columns (S, inputs, nodes) are the weights of the inputs at the nodes of the step. The
        nodes are in s.
        """
        known = self._last_step
        if known is None or known[0] != regimes or abs(known[1] - h) > SAME_STEP * h:
            places, weights = CALM_NODES if calm else NODES
            nodes = 0.5 * h * (1 + places)
            flow = _exponential if calm else _flow
            flows = [flow(linear.matrix, h - t, linear.column) for t in nodes]
            columns = np.array(
                [0.5 * h * w * each for w, each in zip(weights, flows, strict=True)]
            ).transpose(1, 2, 0)
            known = self._last_step = (
                regimes,
                h,
                (scipy.linalg.expm(linear.matrix * h), columns, nodes),
            )
        return known[2]

    def _part(self, linear: Linear, x: Array, time: float, length: float) -> Array:
        """Return the state ``length`` (less than a step) later, by Taylor series."""
        after = _flow(linear.matrix, length, x)
        nodes = 0.5 * length * (1 + NODES[0])
        for node, weight, inputs in zip(
            nodes, 0.5 * length * NODES[1], self._inputs(time + nodes).T, strict=True
        ):
            after = after + weight * _flow(linear.matrix, length - node, linear.column @ inputs)
        return after

    # --- events

    def _value(self, which: int, guard: Guard, linear: Linear, xs: Array, times: Array) -> Array:
        row, push = self.mechanics.guard(which, guard, linear)
        values = row @ xs
        return np.asarray(values + push @ self._inputs(times) if np.any(push) else values)

    def _first(
        self, linear: Linear, xs: Array, times: Array, h: float
    ) -> list[tuple[int, int, int]]:
        """Return the guards that are violated in the first step with a violated guard.

        Each has the absorber, the number of the guard and the step.
        """
        events = []
        for which, regime in enumerate(self.contacts.regimes):
            for number, guard in enumerate(regime.guards):
                values = self._value(which, guard, linear, xs, times)
                past = values[1:] < 0
                if guard.event in (WALL, CONTACT, SLIP):
                    past |= _dips(values, guard.y_weight * (self.mechanics.speeds[which] @ xs), h)
                at = np.flatnonzero(past)
                if len(at):
                    events.append((which, number, int(at[0])))
        step = min((k for *_, k in events), default=0)
        return [each for each in events if each[2] == step]

    def _event(
        self, passed: list[tuple[int, int, int]], linear: Linear, x: Array, time: float, h: float
    ) -> None:
        """Find the earliest of the events in the step from ``time``, go there, and apply it."""
        guards = [
            (which, self.contacts.regimes[which].guards[number]) for which, number, _ in passed
        ]
        lengths = [self._passage(which, guard, linear, x, time, h) for which, guard in guards]
        k = int(np.argmin(lengths))
        self.x = self._part(linear, x, time, lengths[k])
        self.time = time + lengths[k]
        self._joined_at = None
        self.events += 1
        which, guard = guards[k]
        self.contacts.jump(which, guard)
        self.slipped = guard.event == SLIP
        self._note()

    def _note(self) -> None:
        self.impacts += [(self.time, which, speed) for which, speed in self.contacts.struck]
        self.contacts.rest_speed = max(
            self.contacts.rest_speed,
            *(REST_SHARE * abs(speed) for _, speed in self.contacts.struck),
            0.0,
        )

    def _passage(
        self, which: int, guard: Guard, linear: Linear, x: Array, time: float, h: float
    ) -> float:
        """Return the time in s from a step's start to where a guard is passed."""

        def value(length: float) -> float:
            trial = self._part(linear, x, time, length)
            return float(
                self._value(which, guard, linear, trial[:, None], np.array([time + length]))[0]
            )

        def speed(length: float) -> float:
            return float(self.mechanics.speeds[which] @ self._part(linear, x, time, length))

        end = h
        if value(h) >= 0:
            # a graze: up to where the relative velocity turns, if it is not rounding that the step's
            # end is beyond the guard
            if speed(0.0) * speed(h) >= 0:
                return h
            end = scipy.optimize.brentq(speed, 0.0, h, xtol=1e-18, rtol=1e-15)
        if value(0.0) <= 0:
            return 0.0
        return (
            float(scipy.optimize.brentq(value, 0.0, end, xtol=1e-18, rtol=1e-15))
            if value(end) < 0
            else end
        )


def _dips(values: Array, slopes: Array, h: float) -> NDArray[np.bool_]:
    """Return (steps,) whether the cubic of a step goes below zero and returns.

    The cubic has the values and slopes at the step's ends.
    """
    past = np.zeros(len(values) - 1, dtype=bool)
    turns = (
        (slopes[:-1] < 0)
        & (slopes[1:] >= 0)
        & (np.minimum(values[:-1], values[1:]) < -h * slopes[:-1])
    )
    s = HUMP
    for k in np.flatnonzero(turns):
        cubic = (1 - s) ** 2 * ((1 + 2 * s) * values[k] + s * h * slopes[k]) + s**2 * (
            (3 - 2 * s) * values[k + 1] - (1 - s) * h * slopes[k + 1]
        )
        past[k] = bool(np.min(cubic) < 0)
    return past


def follow(
    scene: Scene,
    drive: Drive | Inputs,
    initial: InitialState | None,
    times: Array,
    most_impacts: int | None = None,
    most_events: int = MOST_EVENTS,
    long_steps: bool = False,
) -> Truth:
    """Return the reference at ``times`` (S,) in s, ascending from 0, or as far as it goes.

    It ends at the first of the times after more than ``most_impacts``, or before an interval with
    more than ``most_events``, or with events that are too close for the grid. ``long_steps`` are
    faster if no event ends a regime, but less accurate for a force far above all modes.
    """
    inputs = harmonic(drive) if isinstance(drive, Drive) else drive
    walk = Walk(
        scene, inputs, InitialState() if initial is None else initial, most_events, long_steps
    )
    rows = [walk.x]
    samples = [walk.sample()]
    for time in times[1:]:
        if not walk.to(float(time)) or (
            most_impacts is not None and len(walk.impacts) > most_impacts
        ):
            break
        rows.append(walk.x)
        samples.append(walk.sample())
    count = len(rows)
    tip = np.array([row[0] for row in samples])
    relative = np.array([row[1] for row in samples])
    if scene.places == 1:
        relative = relative[:, 0]
    struck = [impact for impact in walk.impacts if impact[0] <= times[count - 1]]
    at, which, speed = (
        (np.array(column) for column in zip(*struck, strict=True))
        if struck
        else (np.zeros(0), np.zeros(0, int), np.zeros(0))
    )
    states = walk.mechanics.vector(np.array(rows))
    return Truth(
        np.array(times[:count]),
        tip,
        relative,
        states,
        at,
        speed,
        which,
        walk.events,
        count == len(times),
    )
