"""What one absorber can do: regimes, what each means for the force, and the guards that end it.

The force lambda between an absorber and its place on the beam (on the absorber, minus its shape times lambda on the modes) is either a law of the
relative displacement y and velocity gamma, or, where both are joined, what keeps them together. A regime lasts as long as all its guards are
positive. A guard is a constant plus weights times y, gamma and lambda.
"""

from dataclasses import dataclass
from fractions import Fraction

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

Number = float | Fraction  # a reference with many digits keeps them

# what happens when a guard is used up
WALL, REVERSAL, RELEASE_UP, RELEASE_DOWN = "wall", "reversal", "release up", "release down"
CONTACT, PARTING, SLIP, HOLD = "contact", "parting", "slip", "hold"


@dataclass(frozen=True)
class Guard:
    """``constant + y_weight (y - rest) + gamma_weight gamma + force_weight lambda``; ``side``: 1 or -1 where a wall or a slider's end is meant."""

    event: str
    constant: float
    y_weight: float = 0.0
    gamma_weight: float = 0.0
    force_weight: float = 0.0
    side: int = 0
    rest: Number = 0.0


@dataclass(frozen=True)
class Regime:
    """``lambda = constant - stiffness (y - rest) - slider (y - slider_rest) - damping gamma``, or the joint's force.

    ``side``: the wall that a joined absorber rests on, or whose spring is touched. ``sliding``: the sign of the relative velocity in friction.
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
    """The regimes of one absorber (or of none): gap (m), restitution, limit (N) and stiffnesses (N/m) are None where there is no such thing."""

    def __init__(self, absorber: Absorber | None) -> None:
        sliding = absorber if isinstance(absorber, SlidingAbsorber) else None
        walls, friction = (None, None) if sliding is None else (sliding.walls, sliding.friction)
        self.absorber = absorber
        self.gap = None if walls is None else walls.gap
        self.restitution = walls.restitution if isinstance(walls, RigidWalls) else None
        self.wall_stiffness = walls.stiffness if isinstance(walls, CompliantWalls) else None
        self.limit = None if friction is None else friction.limit
        self.slider = friction.stiffness if isinstance(friction, ElasticCoulombFriction) else None
        self.bonded = self.wall_stiffness is not None and self.gap == 0  # both walls touch at once: one spring, and no events
        self.linear = sliding is None
        self.springs = self.wall_stiffness is not None or self.slider is not None

    def regime(self, name: str) -> Regime:
        """Return the regime ``linear``, ``free``, ``slide +``, ``slide -``, ``stuck``, ``held +``, ``held -``, ``contact +`` or ``contact -``."""
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
        return Regime("linear", stiffness=stiffness, damping=damping, joined=isinstance(self.absorber, StuckAbsorber))

    def moving(self, sign: int) -> Regime:
        """Return the regime in which the absorber moves with a relative velocity of a sign."""
        if self.springs:
            return self.sprung(0, sign if self.slider is not None else 0)
        if self.limit is None:
            return Regime("free", self._walls())
        turn = Guard(REVERSAL, 0.0, gamma_weight=sign)
        return Regime(_named("slide", sign), (*self._walls(), turn), constant=-sign * self.limit, sliding=sign)

    def joined(self, side: int) -> Regime:
        """Return the regime in which friction or the wall of a side holds the absorber."""
        limit = 0.0 if self.limit is None else self.limit
        up, down = Guard(RELEASE_DOWN, limit, force_weight=-1.0), Guard(RELEASE_UP, limit, force_weight=1.0)
        # a wall pushes as hard as it must: at the upper one only the upper bound of the force remains
        return Regime(_named("held", side) or "stuck", {0: (up, down), 1: (up,), -1: (down,)}[side], joined=True, side=side)

    def sprung(self, side: int, sliding: int = 0, slider_rest: Number = 0.0) -> Regime:
        """Return the regime with a compliant wall touched (``side``, 0: none), and an elastic slider that slides or holds with its rest in m."""
        stiffness = self.wall_stiffness if self.wall_stiffness is not None and (side or self.bonded) else 0.0
        rest = 0.0 if self.gap is None else side * self.gap
        guards, words = self._walls(side), [_named("contact", side)]
        if self.slider is None:
            return Regime(words[0] or "free", guards, stiffness=stiffness, rest=rest, side=side)
        assert self.limit is not None
        words.insert(0, _named("slip", sliding) or "hold")
        name = ", ".join(word for word in words if word)
        if sliding:
            guards = (*guards, Guard(HOLD, 0.0, gamma_weight=sliding))
            return Regime(name, guards, -sliding * self.limit, stiffness, rest, side=side, sliding=sliding)
        guards = (*guards, *(Guard(SLIP, self.limit, y_weight=-end * self.slider, side=end, rest=slider_rest) for end in (1, -1)))
        return Regime(name, guards, stiffness=stiffness, rest=rest, slider=self.slider, slider_rest=slider_rest, side=side)

    def _walls(self, touched: int = 0) -> tuple[Guard, ...]:
        if self.gap is None or self.bonded:
            return ()
        if touched:
            return (Guard(PARTING, -self.gap, y_weight=touched, side=touched),)
        event = WALL if self.restitution is not None else CONTACT
        return tuple(Guard(event, self.gap, y_weight=-side, side=side) for side in (1, -1))


def automata_of(scene: Scene) -> list[Automaton]:
    """Return the automaton of each absorber; one without regimes where there is none."""
    absorber = scene.absorber
    return [Automaton(one) for one in (absorber.absorbers if isinstance(absorber, SeveralAbsorbers) else (absorber,))]
