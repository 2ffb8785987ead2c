"""A plain reference for the stability report: dense matrix exponentials on a fine grid, events by bisection. Slow, short and independent.

It shares no algorithm with the methods it judges: no modes of coupled regimes, no expansion of the drive, no bounds. A regime is a dense
first-order matrix; a step is its exponential plus Gauss-Legendre quadrature of the force. Between two grid points a guard is taken to change
sign at most once, which the grid's fineness makes likely and nothing proves. Where the reference cannot go on safely it ends early.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from impact_env import CoulombFriction, Drive, ElasticCoulombFriction, InitialState, RigidWalls, Scene, SlidingAbsorber, TunedAbsorber
from impact_env.kernels.rigid_contact import Walls

Array = NDArray[np.float64]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
SLIDER_TURN = 0.125  # rad; the same where a spring gives way at the very peak of its force
TURN = 0.5  # rad by which the fastest motion turns in a step of the grid
COARSE_TURN, COARSE_FROM = 1.0, 30  # the same for scenes of so many modes: their highest modes hardly move
FINER, FINEST = 32, 32**3  # where an event seems to follow another within a step
TAYLOR_TERMS = 20
FORCE_WEIGHT = 6.0  # the force alone may turn a relative velocity twice in a step that would do for a mode
SAME_STEP = 1e-12  # two steps that differ by less, relatively, differ by the rounding of their ends
# guards that a value just beyond them does not pass, after an event that left them behind
FRESH = {"wall": {"upper", "lower"}, "turn": {"turn"}, "wall turn": {"upper", "lower", "turn"}, "slip": {"turn"}}
FIRST_SLIP = 64  # steps within TURN of the spring that gives way: a stiff one holds again soon
MOST_STEPS = 3_000_000
MOST_EVENTS = 50  # between two samples


@dataclass(frozen=True)
class Law:
    """Force on the absorber, -stiffness r - damping r' + constant, r being absorber - tip; ``joined``: both move as one."""

    stiffness: float = 0.0
    damping: float = 0.0
    constant: float = 0.0
    joined: bool = False


@dataclass(frozen=True, eq=False)
class Truth:
    """Samples (S,) of time in s, tip and relative displacement in m, as far as the reference goes; times of the impacts before that in s."""

    time: Array
    tip: Array
    relative: Array
    impacts: Array


@dataclass
class Contact:
    """What the contact is doing: side of the wall touched, sign of sliding or None (sticking, or no friction), place of the elastic slider."""

    side: int = 0
    sliding: int | None = None
    rest: float = 0.0
    joined: bool = False
    fresh: str = ""  # the guard that an event has just left behind


class System:
    """First-order matrices of a scene. State: omega_i q_i, rate q_a, u_i, v_a, 1; the scaling keeps exponentials accurate."""

    def __init__(self, scene: Scene, drive: Drive) -> None:
        self.scene, self.drive, model = scene, drive, scene.model
        self.n = model.modes
        self.mass = scene.absorber_mass
        self.scale = np.append(model.omega, model.omega[0])
        self.row = np.append(-model.tip_shape, 1.0)
        self.tip_row = np.zeros(2 * self.n + 3)
        self.tip_row[: self.n] = model.tip_shape / model.omega
        self.relative_row = np.zeros(2 * self.n + 3)
        self.relative_row[: self.n + 1] = self.row / self.scale
        self.rate_row = np.zeros(2 * self.n + 3)
        self.rate_row[self.n + 1 : -1] = self.row
        self._made: dict[Law, tuple[Array, Array]] = {}
        self._speeds: dict[tuple[float, float, bool], float] = {}

    def start(self, initial: InitialState) -> Array:
        state = initial.vector(self.scene)
        half = self.n + 1
        return np.concatenate([state[:half] * self.scale, state[half:], [1.0]])

    def fastest(self, law: Law) -> float:
        """Return the fastest rate in 1/s of a law and of the force."""
        key = (law.stiffness, law.damping, law.joined)
        if key not in self._speeds:
            speed = float(np.max(np.abs(np.linalg.eigvals(self.matrices(law)[0]))))
            self._speeds[key] = max(speed, FORCE_WEIGHT * float(np.max(self.drive.schedule.omegas)))
        return self._speeds[key]

    def matrices(self, law: Law) -> tuple[Array, Array]:
        """Return matrix (2N + 3,)^2 and force column (2N + 3,) of a law."""
        if law not in self._made:
            self._made[law] = self._make(law)
        return self._made[law]

    def _make(self, law: Law) -> tuple[Array, Array]:
        model, n = self.scene.model, self.n
        square, rate = np.append(model.omega**2, 0.0), np.append(2 * model.damping_ratio * model.omega, 0.0)
        force = np.append(model.force_shape, 0.0)
        if law.joined or self.mass is None:
            mass, tip = self.mass or 0.0, model.tip_shape
            inverse = np.zeros((n + 1, n + 1))  # of the mass matrix I + m tip tip^T; the last row gives the tip's acceleration
            inverse[n, :n] = tip / (1 + mass * float(tip @ tip))
            inverse[:n, :n] = np.eye(n) - mass * np.outer(tip, inverse[n, :n])
            stiffness, damping, constant = np.diag(square), np.diag(rate), np.zeros(n + 1)
        else:
            inverse = np.diag(np.append(np.ones(n), 1 / self.mass))
            line = np.outer(self.row, self.row)
            stiffness, damping, constant = np.diag(square) + law.stiffness * line, np.diag(rate) + law.damping * line, law.constant * self.row
        half = n + 1
        matrix = np.zeros((2 * half + 1, 2 * half + 1))
        matrix[:half, half:-1] = np.diag(self.scale)
        matrix[half:-1, :half] = -inverse @ stiffness / self.scale
        matrix[half:-1, half:-1] = -inverse @ damping
        matrix[half:-1, -1] = inverse @ constant
        column = np.zeros(2 * half + 1)
        column[half:-1] = inverse @ force
        return matrix, column

    def force(self, times: Array) -> Array:
        return self.drive.amplitude * np.cos(self.drive.schedule.phase_at(times) + self.drive.phase)

    def part(self, law: Law, x: Array, time: float, length: float) -> Array:
        """Return the state ``length`` (less than a step) later, by Taylor series."""
        matrix, column = self.matrices(law)
        after = _flow(matrix, length, x)
        nodes = 0.5 * length * (1 + NODES)
        for node, weight, force in zip(nodes, 0.5 * length * WEIGHTS, self.force(time + nodes), strict=True):
            after = after + weight * force * _flow(matrix, length - node, column)
        return after

    def tip_force(self, xs: Array, times: Array) -> Array:
        """Return the forces (S,) in N that the joint of absorber and tip would carry in states (2N + 3, S): mass times tip acceleration."""
        matrix, column = self.matrices(Law(joined=True))
        row = 2 * self.n + 1  # the absorber's: it moves with the tip
        return np.asarray((self.mass or 0.0) * (matrix[row] @ xs + column[row] * self.force(times)))


def _flow(matrix: Array, length: float, x: Array) -> Array:
    total, term = x, x
    for k in range(1, TAYLOR_TERMS):
        term = matrix @ term * (length / k)
        total = total + term
    return total


class Rules:
    """Guards, jumps and laws of a sliding absorber."""

    def __init__(self, system: System) -> None:
        absorber = system.scene.absorber
        sliding = absorber if isinstance(absorber, SlidingAbsorber) else None
        self.system, self.absorber = system, absorber
        self.rigid = sliding is not None and isinstance(sliding.walls or sliding.friction, RigidWalls | CoulombFriction)
        walls, friction = (None, None) if sliding is None else (sliding.walls, sliding.friction)
        self.gap = np.inf if walls is None else walls.gap
        self.walls = Walls(walls.gap, walls.restitution) if isinstance(walls, RigidWalls) else None
        self.spring = 0.0 if walls is None or isinstance(walls, RigidWalls) else walls.stiffness
        self.bonded = self.spring > 0 and self.gap == 0  # both walls touch at once: one spring, and no events
        self.limit = 0.0 if friction is None else friction.limit
        self.slider = friction.stiffness if isinstance(friction, ElasticCoulombFriction) else 0.0

    def law(self, contact: Contact) -> Law:
        if isinstance(self.absorber, TunedAbsorber):
            return Law(self.absorber.stiffness, self.absorber.damping)
        if not isinstance(self.absorber, SlidingAbsorber) or contact.joined:
            return Law(joined=True)
        if self.rigid:
            return Law(constant=-(contact.sliding or 0) * self.limit)
        stiffness, constant = 0.0, 0.0
        if contact.side or self.bonded:
            stiffness, constant = self.spring, self.spring * contact.side * self.gap
        if self.slider and contact.sliding is None:
            stiffness, constant = stiffness + self.slider, constant + self.slider * contact.rest
        elif self.slider:
            constant -= (contact.sliding or 0) * self.limit
        return Law(stiffness, 0.0, constant)

    def bounds(self, side: int) -> tuple[float, float]:
        return (-np.inf if side > 0 else -self.limit), (np.inf if side < 0 else self.limit)

    def begin(self, x: Array) -> Contact:
        """Return the first contact state, or one that ends the reference if it needs more than a look at the state."""
        relative, rate = float(self.system.relative_row @ x), float(self.system.rate_row @ x)
        if not self.rigid:
            return Contact(side=int(np.sign(relative)) if abs(relative) > self.gap and self.spring and not self.bonded else 0, rest=relative)
        side = int(np.sign(relative)) if abs(relative) >= self.gap * (1 - 1e-15) else 0
        if rate == 0.0 and (self.limit or side):
            return self.rest(x, 0.0, side)
        sign = int(np.sign(rate))
        if side and rate * side > 0:  # on the wall and into it: an impact at once
            self.strike(x)
            sign = int(np.sign(float(self.system.rate_row @ x)))
        return Contact(sliding=sign if self.limit else None, fresh="wall" if side else "")

    def rest(self, x: Array, time: float, side: int) -> Contact:
        """Join absorber and tip if the joint can carry it, else let them part."""
        force, (low, high) = float(self.system.tip_force(x[:, None], np.array([time]))[0]), self.bounds(side)
        if low <= force <= high:
            return Contact(side=side, joined=True)
        return Contact(sliding=(-1 if force > high else 1) if self.limit else None, fresh="wall turn" if side else "turn")

    def strike(self, x: Array) -> None:
        """Apply Newton's impact law in place."""
        assert self.walls is not None
        system, rate = self.system, float(self.system.rate_row @ x)
        inverse = np.append(np.ones(system.n), 1 / (system.mass or 1.0))
        impulse = -(1 + self.walls.restitution) * rate / float(np.sum(system.row**2 * inverse))
        x[system.n + 1 : -1] += inverse * system.row * impulse

    def guards(self, contact: Contact, xs: Array, times: Array) -> dict[str, Array]:
        """Return values (steps,) that are above 0 once an event has happened, for states ``xs`` (2N + 3, steps)."""
        system = self.system
        if not isinstance(self.absorber, SlidingAbsorber):
            return {}
        if contact.joined:
            low, high = self.bounds(contact.side)
            force = system.tip_force(xs, times)
            return {"high": force - high, "low": low - force}
        relative, rate = system.relative_row @ xs, system.rate_row @ xs
        found: dict[str, Array] = {}
        if self.walls is not None:
            found |= {"upper": relative - self.gap, "lower": -self.gap - relative}
        elif self.spring and not self.bonded:
            found["contact"] = {0: np.abs(relative) - self.gap, 1: self.gap - relative, -1: relative + self.gap}[contact.side]
        if self.limit and contact.sliding is not None:
            found["turn"] = -contact.sliding * rate
        elif self.slider:
            found["slip"] = np.abs(relative - contact.rest) * self.slider - self.limit
        return found


@dataclass
class Walk:
    """A reference under way."""

    rules: Rules
    x: Array
    contact: Contact
    time: float = 0.0
    steps: int = 0
    events: int = 0
    impacts: list[float] = field(default_factory=list)
    kept: tuple[Law, float, Array, Array, Array] | None = None
    joined_at: float | None = None  # relative displacement since both are joined

    def seen(self) -> tuple[float, float]:
        """Return tip and relative displacement in m. Where both are joined the absorber tells more exactly where the tip is than a sum over modes."""
        system = self.rules.system
        tip, relative = float(system.tip_row @ self.x), float(system.relative_row @ self.x)
        if system.mass is not None and self.rules.law(self.contact).joined:
            relative = self.joined_at if self.joined_at is not None else relative
            self.joined_at, tip = relative, float(self.x[system.n] / system.scale[-1]) - relative
        return tip, relative

    def to(self, end: float) -> bool:
        """Advance to a time in s; return False where the reference cannot go on."""
        before = self.events
        while self.time < end:
            if self.events - before > MOST_EVENTS or not self._stretch(end):
                return False
        return True

    def _stretch(self, end: float, finer: int = 1, least: int = 1) -> bool:
        """Advance to ``end`` or to the next event, on a grid ``finer`` times finer than usual and of ``least`` steps."""
        system, law = self.rules.system, self.rules.law(self.contact)
        if self.contact.fresh == "slip" and least == 1:
            held = replace(self.contact, sliding=None)
            return self._stretch(min(end, self.time + TURN / system.fastest(self.rules.law(held)) / finer), finer, FIRST_SLIP)
        turn = COARSE_TURN if system.n >= COARSE_FROM else SLIDER_TURN if self.rules.slider else TURN
        count = max(least, int(np.ceil((end - self.time) * system.fastest(law) * finer / turn)))
        h = (end - self.time) / count
        if self.steps + count > MOST_STEPS:
            return False
        self.steps += count
        whole, columns, nodes = self._step(law, h)
        times = self.time + h * np.arange(count + 1)
        pushes = columns @ system.force(times[:-1] + nodes[:, None])
        xs = np.empty((len(self.x), count + 1))
        xs[:, 0] = self.x
        for k in range(count):
            xs[:, k + 1] = whole @ xs[:, k] + pushes[:, k]
        event = self._first(xs, times, h)
        if event is None:
            self.x, self.time, self.contact.fresh = xs[:, -1], end, ""
            return True
        names, k = event
        if k == 0 and set(names) & FRESH.get(self.contact.fresh, set()):
            # back within the first step: the grid is too coarse to tell what happened
            return finer < FINEST and self._stretch(self.time + min(4 * h, end - self.time), finer * FINER)
        self._event(names, law, xs[:, k], float(times[k]), h)
        return True

    def _step(self, law: Law, h: float) -> tuple[Array, Array, Array]:
        """Return the exponential of a step of h s, the columns (2N + 3, nodes) that weigh the force at its nodes, and the nodes in s."""
        known = self.kept
        if known is None or known[0] != law or abs(known[1] - h) > SAME_STEP * h:
            matrix, column = self.rules.system.matrices(law)
            nodes = 0.5 * h * (1 + NODES)
            columns = np.array([0.5 * h * w * _flow(matrix, h - t, column) for w, t in zip(WEIGHTS, nodes, strict=True)]).T
            known = self.kept = (law, h, scipy.linalg.expm(matrix * h), columns, nodes)
        return known[2:]

    def _first(self, xs: Array, times: Array, h: float) -> tuple[list[str], int] | None:
        """Return the guards that are passed in the first step in which any is, and the number of that step."""
        first: dict[str, int] = {}
        for name, values in self.rules.guards(self.contact, xs, times).items():
            past = values[1:] > 0
            if name == "slip" or (name in ("upper", "lower", "contact") and self.contact.side == 0):
                past |= self._humps(name, xs, h)
            at = np.flatnonzero(past)
            if len(at):
                first[name] = int(at[0])
        if not first:
            return None
        step = min(first.values())
        return [name for name, k in first.items() if k == step], step

    def _humps(self, name: str, xs: Array, h: float) -> NDArray[np.bool_]:
        """Return (steps,) whether the cubic through values and slopes at a step's ends passes a wall or a slider's limit and comes back."""
        rules, slips = self.rules, name == "slip"
        distance = rules.system.relative_row @ xs - (self.contact.rest if slips else 0.0)
        sign = -1.0 if name == "lower" else np.ones(xs.shape[1]) if name == "upper" else np.sign(distance)
        value, slope = sign * distance - (rules.limit / rules.slider if slips else rules.gap), sign * (rules.system.rate_row @ xs)
        turns = (slope[:-1] > 0) & (slope[1:] <= 0)
        past = np.zeros(xs.shape[1] - 1, dtype=bool)
        s = np.linspace(0, 1, 65)[1:-1]
        for k in np.flatnonzero(turns & (np.maximum(value[:-1], value[1:]) > -h * slope[:-1])):
            cubic = (1 - s) ** 2 * ((1 + 2 * s) * value[k] + s * h * slope[k]) + s**2 * ((3 - 2 * s) * value[k + 1] - (1 - s) * h * slope[k + 1])
            past[k] = bool(np.max(cubic) > 0)
        return past

    def _event(self, names: list[str], law: Law, x: Array, time: float, h: float) -> None:
        """Find the earliest of the events in the step from ``time``, go there, and apply it."""
        found = {name: self._passage(name, law, x, time, h) for name in names}
        name = min(found, key=found.__getitem__)
        self.x, self.time = self.rules.system.part(law, x, time, found[name]), time + found[name]
        self._jump(name)

    def _passage(self, name: str, law: Law, x: Array, time: float, h: float) -> float:
        """Return the time in s from a step's start to where a guard is passed."""
        system = self.rules.system

        def value(length: float) -> float:
            trial = system.part(law, x, time, length)
            return float(self.rules.guards(self.contact, trial[:, None], np.array([time + length]))[name][0])

        end = h
        if value(h) <= 0:  # a graze: up to where the relative velocity turns
            end = scipy.optimize.brentq(lambda length: float(system.rate_row @ system.part(law, x, time, length)), 0.0, h, xtol=1e-18, rtol=1e-15)
        if value(0.0) >= 0:
            return 0.0
        return float(scipy.optimize.brentq(value, 0.0, end, xtol=1e-18, rtol=1e-15)) if value(end) > 0 else end

    def _jump(self, name: str) -> None:
        self.joined_at = None
        self.events += 1
        rules, contact = self.rules, self.contact
        relative = float(rules.system.relative_row @ self.x)
        if name in ("upper", "lower"):
            self.impacts.append(self.time)
            rules.strike(self.x)
            after = int(np.sign(float(rules.system.rate_row @ self.x)))
            self.contact = Contact(sliding=after if rules.limit else None, fresh="wall")
        elif name in ("high", "low"):
            self.contact = Contact(sliding=(-1 if name == "high" else 1) if rules.limit else None, fresh="wall turn" if contact.side else "turn")
        elif name == "contact":
            side = int(np.sign(relative)) if contact.side == 0 else 0
            if side:
                self.impacts.append(self.time)
            self.contact = Contact(side, contact.sliding, contact.rest)
        elif name == "slip":
            self.contact = Contact(contact.side, int(np.sign(relative - contact.rest)), 0.0, fresh="slip")
        elif rules.rigid:
            self.contact = rules.rest(self.x, self.time, 0)
        else:
            self.contact = Contact(contact.side, None, relative - (contact.sliding or 0) * rules.limit / rules.slider)


def truth(scene: Scene, drive: Drive, initial: InitialState, interval: float, samples: int, most_impacts: int) -> Truth:
    """Return the reference over ``samples`` intervals (s), or up to the end of the interval of impact number ``most_impacts``."""
    rules = Rules(System(scene, drive))
    x = rules.system.start(initial)
    walk = Walk(rules, x, rules.begin(x))
    rows = [(0.0, *walk.seen())]
    for k in range(1, samples):
        if not walk.to(k * interval) or len(walk.impacts) > most_impacts:
            break
        rows.append((k * interval, *walk.seen()))
    time, tip, relative = np.array(rows).T
    return Truth(time, tip, relative, np.array([t for t in walk.impacts if t <= time[-1]]))
