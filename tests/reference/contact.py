"""Contact mechanics of all references, for any number of absorbers.

The module has the regimes of each absorber, and the effects that an event of one absorber has on
all.

A regime defines the force lambda between an absorber and its place on the beam (lambda acts on the
absorber, minus its shape times lambda on the modes): a law of the relative displacement y and
velocity gamma, or, if both are joined, the joint force. A regime lasts as long as all its guards
are positive. A guard is a constant plus weights times y, gamma and lambda. The module does not
depend on the computation of the motion between events.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import (
    Absorber,
    CompliantWalls,
    ElasticCoulombFriction,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
)
from impact_env.scene import Scene

Array = NDArray[np.float64]
Number = float | Fraction  # a reference with many digits keeps them

# what happens when a guard is used up
WALL = "wall"
REVERSAL = "reversal"
RELEASE_UP = "release up"
RELEASE_DOWN = "release down"
CONTACT = "contact"
PARTING = "parting"
SLIP = "slip"
HOLD = "hold"
MOST_STRIKES = 1000  # at one time
TOUCHING = 1 - 1e-15  # of the gap: an absorber that starts there is on the wall


@dataclass(frozen=True)
class Guard:
    """A guard of a regime.

    Its value is ``constant + y_weight (y - rest) + gamma_weight gamma + force_weight lambda``.
    ``side`` is 1 or -1 for a wall or an end of a slider.
    """

    event: str
    constant: float
    y_weight: float = 0.0
    gamma_weight: float = 0.0
    force_weight: float = 0.0
    side: int = 0
    rest: Number = 0.0


@dataclass(frozen=True)
class Regime:
    """A regime with its law of the contact force.

    The law is ``lambda = constant - stiffness (y - rest) - slider (y - slider_rest) - damping
    gamma``, or lambda is the joint force if ``joined``. ``side`` is the wall of a joined absorber,
    or the wall whose spring is touched; ``sliding`` is the sign of the relative velocity in
    friction.
    """

    name: str
    guards: tuple[Guard, ...] = ()
    constant: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    joined: bool = False
    slider: float = 0.0
    slider_rest: Number = 0.0
    side: int = 0
    sliding: int = 0


def sign_of(value: Number) -> int:
    """Return -1, 0 or 1."""
    return int(value > 0) - int(value < 0)


def size_of(value: Number) -> Number:
    """Return the absolute value."""
    return value if value >= 0 else -value


def _named(word: str, sign: int) -> str:
    return f"{word} {'+' if sign > 0 else '-'}" if sign else ""


class Automaton:
    """The regimes of one absorber (or of none).

    Gap (m), restitution, limit (N) and stiffnesses (N/m) are None if the absorber does not have
    them.
    """

    def __init__(self, absorber: Absorber | None, mobility: float = 0.0) -> None:
        sliding = absorber if isinstance(absorber, SlidingAbsorber) else None
        walls, friction = (None, None) if sliding is None else (sliding.walls, sliding.friction)
        self.absorber = absorber
        self.gap = None if walls is None else walls.gap
        self.restitution = walls.restitution if isinstance(walls, RigidWalls) else None
        self.wall_stiffness = walls.stiffness if isinstance(walls, CompliantWalls) else None
        self.wall_damper = 0.0
        if isinstance(walls, CompliantWalls) and walls.restitution < 1:
            # a mass on a spring and a damper leaves with e = exp(-pi D/sqrt(1 - D^2)) of its
            # velocity after half a period
            loss = np.log(walls.restitution) / np.pi
            ratio = -loss / np.sqrt(1 + loss**2)
            self.wall_damper = float(2 * ratio * np.sqrt(walls.stiffness / mobility))
        self.limit = None if friction is None else friction.limit
        self.slider = friction.stiffness if isinstance(friction, ElasticCoulombFriction) else None
        self.bonded = (
            self.wall_stiffness is not None and self.gap == 0
        )  # both walls touch at once: one spring, and no events
        self.linear = sliding is None
        self.springs = self.wall_stiffness is not None or self.slider is not None

    def regime(self, name: str) -> Regime:
        """Return the regime of a name.

        Names are ``linear``, ``free``, ``slide +``, ``slide -``, ``stuck``, ``held +``, ``held -``,
        ``contact +`` and ``contact -``.
        """
        kind, _, sign = name.partition(" ")
        side = {"+": 1, "-": -1, "": 0}[sign]
        if kind == "linear":
            return self.only()
        if kind in ("stuck", "held"):
            return self.joined(side)
        return self.moving(side) if kind in ("free", "slide") else self.sprung(side)

    def only(self) -> Regime:
        """Return the regime of a scene without events: no absorber, a stuck one or a tuned one."""
        tuned = self.absorber if isinstance(self.absorber, TunedAbsorber) else None
        stiffness, damping = (0.0, 0.0) if tuned is None else (tuned.stiffness, tuned.damping)
        return Regime(
            "linear",
            stiffness=stiffness,
            damping=damping,
            joined=isinstance(self.absorber, StuckAbsorber),
        )

    def moving(self, sign: int) -> Regime:
        """Return the regime in which the absorber moves with a relative velocity of a sign."""
        if self.springs:
            return self.sprung(0, sign if self.slider is not None else 0)
        if self.limit is None:
            return Regime("free", self._walls())
        turn = Guard(REVERSAL, 0.0, gamma_weight=sign)
        return Regime(
            _named("slide", sign), (*self._walls(), turn), constant=-sign * self.limit, sliding=sign
        )

    def joined(self, side: int) -> Regime:
        """Return the regime in which friction or the wall of a side holds the absorber."""
        limit = 0.0 if self.limit is None else self.limit
        up = Guard(RELEASE_DOWN, limit, force_weight=-1.0)
        down = Guard(RELEASE_UP, limit, force_weight=1.0)
        # a wall pushes as hard as it must: at the upper one only the upper bound of the force
        # remains
        return Regime(
            _named("held", side) or "stuck",
            {0: (up, down), 1: (up,), -1: (down,)}[side],
            joined=True,
            side=side,
        )

    def sprung(self, side: int, sliding: int = 0, slider_rest: Number = 0.0) -> Regime:
        """Return the regime with contact at a compliant wall, or with an elastic slider.

        ``side`` is that of the wall, 0 for none. The slider slides or sticks with its rest position
        in m.
        """
        stiffness = (
            self.wall_stiffness
            if self.wall_stiffness is not None and (side or self.bonded)
            else 0.0
        )
        damping = self.wall_damper if side or self.bonded else 0.0
        rest = 0.0 if self.gap is None else side * self.gap
        guards = self._walls(side)
        words = [_named("contact", side)]
        if self.slider is None:
            return Regime(
                words[0] or "free",
                guards,
                stiffness=stiffness,
                rest=rest,
                side=side,
                damping=damping,
            )
        assert self.limit is not None
        words.insert(0, _named("slip", sliding) or "hold")
        name = ", ".join(word for word in words if word)
        if sliding:
            guards = (*guards, Guard(HOLD, 0.0, gamma_weight=sliding))
            return Regime(
                name,
                guards,
                -sliding * self.limit,
                stiffness,
                rest,
                side=side,
                sliding=sliding,
                damping=damping,
            )
        guards = (
            *guards,
            *(
                Guard(SLIP, self.limit, y_weight=-end * self.slider, side=end, rest=slider_rest)
                for end in (1, -1)
            ),
        )
        return Regime(
            name,
            guards,
            stiffness=stiffness,
            rest=rest,
            slider=self.slider,
            slider_rest=slider_rest,
            side=side,
            damping=damping,
        )

    def _walls(self, touched: int = 0) -> tuple[Guard, ...]:
        if self.gap is None or self.bonded:
            return ()
        if touched:
            return (Guard(PARTING, -self.gap, y_weight=touched, side=touched),)
        event = WALL if self.restitution is not None else CONTACT
        return tuple(Guard(event, self.gap, y_weight=-side, side=side) for side in (1, -1))


def automata_of(scene: Scene) -> list[Automaton]:
    """Return the automaton of each absorber, or one automaton without regimes for no absorber."""
    absorber = scene.absorber
    if isinstance(absorber, SeveralAbsorbers):
        return [Automaton(one) for one in absorber.absorbers]
    mass = scene.absorber_mass
    mobility = 0.0 if mass is None else 1 / mass + float(np.sum(scene.model.tip_shape**2))
    return [Automaton(absorber, mobility)]


class Motion(Protocol):
    """The state of a reference as `Contacts` reads and changes it.

    ``mobility`` (n, n) in 1/kg gives relative accelerations for forces.
    """

    mobility: Array

    def relative(self, which: int) -> tuple[Number, Number]:
        """Return relative displacement (m) and velocity (m/s) of an absorber."""

    def pull(self) -> Array:
        """Return the accelerations (n,) in m/s^2 of the absorbers' places if no absorber pushed."""

    def strike(self, which: int, restitution: float) -> None:
        """Reverse the relative velocity of an absorber by an impulse (paper, Eq. impulse).

        It becomes -restitution times itself.
        """

    def stop(self, which: Sequence[int]) -> None:
        """Make relative velocities zero, by impulses."""


class Contacts:
    """Regimes of the absorbers of a scene during a motion.

    ``zeros`` has for each absorber the order of the root that each guard of its regime has at the
    regime's start, 0 for none.
    """

    def __init__(self, scene: Scene, motion: Motion, rest_speed: float) -> None:
        """Start in the motion's state; bounces slower than ``rest_speed`` (m/s) end a chatter."""
        self.automata = automata_of(scene)
        self.motion = motion
        self.rest_speed = rest_speed
        self.struck: list[
            tuple[int, float]
        ] = []  # absorber and relative velocity before each impact or contact of the last event
        self.regimes = [self._first(which) for which in range(len(self.automata))]
        self.zeros: list[tuple[int, ...]] = [() for _ in self.regimes]
        self._begin()

    def _first(self, which: int) -> Regime:
        automaton = self.automata[which]
        y, gamma = self.motion.relative(which)
        if automaton.linear:
            return automaton.only()
        if not automaton.springs:
            return automaton.moving(sign_of(gamma) or 1)
        within = (
            automaton.wall_stiffness is None
            or automaton.gap is None
            or automaton.bonded
            or size_of(y) < automaton.gap
        )
        deep = not within and (size_of(y) > automaton.gap or y * gamma > 0)  # type: ignore[operator]
        return automaton.sprung(sign_of(y) if deep else 0, 0, y)

    def _begin(self) -> None:
        on_wall: dict[int, int] = {}
        rests: dict[int, int] = {}
        for which, automaton in enumerate(self.automata):
            y, gamma = self.motion.relative(which)
            at = (
                sign_of(y)
                if automaton.gap is not None and size_of(y) >= automaton.gap * TOUCHING
                else 0
            )
            self._enter(which, self.regimes[which], at, int(gamma == 0))
            if automaton.linear or automaton.springs:
                continue
            if at:
                on_wall[which] = at
            if gamma == 0 and (at or automaton.limit):
                rests[which] = at
        first = [
            which for which, side in on_wall.items() if self.motion.relative(which)[1] * side > 0
        ]
        if first:
            self._collide(first[0], on_wall, rests)
        elif rests:
            self._settle(rests)

    def _enter(self, which: int, regime: Regime, at: int = 0, still: int = 0) -> None:
        """Set a regime that starts on the wall of a side (0: on none).

        The relative velocity has a root of order ``still`` at the start.
        """

        def order(guard: Guard) -> int:
            if guard.event in (REVERSAL, HOLD):
                return still
            return (
                1 + still
                if at and guard.side == at and guard.event in (WALL, CONTACT, PARTING)
                else 0
            )

        self.regimes[which] = regime
        self.zeros[which] = tuple(order(guard) for guard in regime.guards)

    def go_on(self) -> None:
        """Reset the orders of roots, because the motion has left the start of its regimes."""
        self.zeros = [(0,) * len(regime.guards) for regime in self.regimes]

    def jump(self, which: int, guard: Guard) -> None:
        """Apply the event of a guard of an absorber."""
        self.go_on()
        self.struck = []
        left = self.regimes[which]
        resting = {k: regime.side for k, regime in enumerate(self.regimes) if regime.joined}
        if guard.event == WALL:
            self._collide(
                which,
                {k: side for k, side in resting.items() if side} | {which: guard.side},
                resting,
            )
        elif guard.event == REVERSAL:
            self._settle(resting | {which: 0})
        elif guard.event in (RELEASE_UP, RELEASE_DOWN):
            self.motion.stop(list(resting))
            self._enter(
                which,
                self.automata[which].moving(1 if guard.event == RELEASE_UP else -1),
                left.side,
                2,
            )
        else:
            self._spring(which, left, guard)

    def _spring(self, which: int, left: Regime, guard: Guard) -> None:
        automaton = self.automata[which]
        y, gamma = self.motion.relative(which)
        if guard.event == CONTACT:
            self.struck.append((which, float(gamma)))
            self._enter(
                which, automaton.sprung(guard.side, left.sliding, left.slider_rest), guard.side
            )
        elif guard.event == PARTING:
            self._enter(which, automaton.sprung(0, left.sliding, left.slider_rest), guard.side)
        elif guard.event == SLIP:
            self._enter(which, automaton.sprung(left.side, guard.side))
        else:
            assert automaton.limit is not None
            assert automaton.slider is not None
            exact = type(y)  # of floats or fractions
            regime = automaton.sprung(
                left.side, 0, y - left.sliding * (exact(automaton.limit) / exact(automaton.slider))
            )
            self._enter(which, regime)
            # it holds where it slid: at the very end of its reach, and comes back from it
            self.zeros[which] = tuple(
                2 * int(new.event == SLIP and new.side == left.sliding) for new in regime.guards
            )

    def _collide(self, first: int, on_wall: Mapping[int, int], resting: Mapping[int, int]) -> None:
        """Apply an absorber's impact, and the impacts of others that it drives into their walls.

        Absorbers at relative rest that are moved by these impacts are released.
        """
        into = [first]
        while into:
            if len(self.struck) > MOST_STRIKES:
                raise RuntimeError(f"more than {MOST_STRIKES} impacts at one time")
            which = into[0]
            restitution = self.automata[which].restitution
            assert restitution is not None
            self.struck.append((which, float(self.motion.relative(which)[1])))
            self.motion.strike(which, restitution)
            into = [
                k
                for k, side in on_wall.items()
                if side * self.motion.relative(k)[1] > self.rest_speed
            ]
        rests: dict[int, int] = {}
        for k, automaton in enumerate(self.automata):
            gamma = self.motion.relative(k)[1]
            if (k in on_wall or k in resting) and size_of(gamma) < self.rest_speed:
                rests[k] = on_wall.get(k, 0)
            elif k in on_wall or k in resting or sign_of(gamma) != self.regimes[k].sliding:
                self._enter(k, automaton.moving(sign_of(gamma) or 1), on_wall.get(k, 0))
        self._settle(rests)

    def _settle(self, resting: Mapping[int, int]) -> None:
        """Decide which of the absorbers without relative velocity stay joined; release the others.

        ``resting`` maps absorbers to the side of their wall, or 0. All assignments are tried:
        joined with a force within its bounds, or sliding under a force at a bound. Exactly one is
        consistent, because the mobility is positive definite; if rounding gives none or two, the
        first of those with the smallest violation is used.
        """
        if not resting:
            return
        who = list(resting)
        self.motion.stop(who)
        bounds = [self._bounds(k, side) for k, side in resting.items()]
        mobility = self.motion.mobility
        others = np.array([0.0 if k in resting else r.constant for k, r in enumerate(self.regimes)])
        drift = (mobility @ others - self.motion.pull())[
            who
        ]  # relative accelerations without forces of their own
        coupling = mobility[np.ix_(who, who)]
        best: tuple[int, ...] = (0,) * len(who)
        wrong = np.inf
        for choice in product((0, 1, -1), repeat=len(who)):
            wrongness = _wrongness(choice, drift, coupling, bounds)
            if wrongness < wrong:
                best = choice
                wrong = wrongness
        for k, sign in zip(who, best, strict=True):
            automaton = self.automata[k]
            side = resting[k]
            self._enter(k, automaton.moving(sign) if sign else automaton.joined(side), side, 1)

    def _bounds(self, which: int, side: int) -> tuple[float, float]:
        """Return the least and the largest force of friction and a side's wall in N."""
        limit = self.automata[which].limit or 0.0
        return (-np.inf if side > 0 else -limit), (np.inf if side < 0 else limit)


def _wrongness(
    choice: Sequence[int], drift: Array, coupling: Array, bounds: Sequence[tuple[float, float]]
) -> float:
    """Return the violation (N) of the conditions of an assignment.

    ``choice`` is 0 for a joined absorber, else the sign of the relative motion.
    """
    forces = np.array(
        [
            0.0 if sign == 0 else bound[0] if sign > 0 else bound[1]
            for sign, bound in zip(choice, bounds, strict=True)
        ]
    )
    if not np.all(np.isfinite(forces)):
        return float(np.inf)
    joined = [k for k, sign in enumerate(choice) if sign == 0]
    if joined:
        forces[joined] = np.linalg.solve(
            coupling[np.ix_(joined, joined)], -(drift + coupling @ forces)[joined]
        )
    accelerations = drift + coupling @ forces
    worst = 0.0
    for k, (sign, (low, high)) in enumerate(zip(choice, bounds, strict=True)):
        off = (
            max(low - forces[k], forces[k] - high)
            if sign == 0
            else -sign * accelerations[k] / coupling[k, k]
        )
        worst = max(worst, float(off))
    return worst
