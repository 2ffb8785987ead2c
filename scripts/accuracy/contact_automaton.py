"""A scene as regimes, guards and jumps: what the high-precision reference and the peer integrators share, and no kernel of impact_env uses.

The force lambda between absorber and tip (on the absorber, minus tip_shape lambda on the modes) is either a law of the relative
displacement y and velocity gamma, or, where both are joined, what keeps them together: m_a (tip acceleration).
A regime lasts as long as all its guards are positive. A guard is a constant plus weights times y, gamma and lambda.
"""

from __future__ import annotations

from dataclasses import dataclass

from impact_env.parameters import CompliantWalls, CoulombFriction, RigidWalls, SlidingAbsorber, StuckAbsorber, TunedAbsorber
from impact_env.scene import Scene

# what happens when a guard is used up
WALL, REVERSAL, RELEASE_UP, RELEASE_DOWN, CONTACT, PARTING = "wall", "reversal", "release up", "release down", "contact", "parting"


@dataclass(frozen=True)
class Guard:
    """``constant + y_weight y + gamma_weight gamma + force_weight lambda``; ``side`` is 1 (upper wall) or -1 where a wall has part in it."""

    event: str
    constant: float
    y_weight: float = 0.0
    gamma_weight: float = 0.0
    force_weight: float = 0.0
    side: int = 0


@dataclass(frozen=True)
class Regime:
    """``lambda = constant - stiffness (y - rest) - damping gamma``, or the joint's force."""

    name: str
    guards: tuple[Guard, ...] = ()
    constant: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    joined: bool = False


class Automaton:
    """The regimes of a scene, where a run starts, and what follows on a guard. Elastic friction is not covered."""

    def __init__(self, scene: Scene) -> None:
        absorber = scene.absorber
        self.scene = scene
        self.gap: float | None = None
        self.restitution: float | None = None
        self.limit: float | None = None
        self.wall_stiffness: float | None = None
        if isinstance(absorber, SlidingAbsorber):
            walls = absorber.walls
            self.gap = None if walls is None else walls.gap
            self.restitution = walls.restitution if isinstance(walls, RigidWalls) else None
            self.wall_stiffness = walls.stiffness if isinstance(walls, CompliantWalls) else None
            self.limit = absorber.friction.limit if isinstance(absorber.friction, CoulombFriction) else None
            if absorber.friction is not None and (self.limit is None or self.wall_stiffness is not None):
                raise ValueError("elastic friction, and friction beside compliant walls, are not covered")

    def _walls(self) -> tuple[Guard, ...]:
        if self.gap is None:
            return ()
        event = WALL if self.restitution is not None else CONTACT
        return tuple(Guard(event, self.gap, y_weight=-side, side=side) for side in (1, -1))

    def regime(self, name: str) -> Regime:
        """Return the regime ``linear``, ``free``, ``slide +``, ``slide -``, ``stuck``, ``held +``, ``held -``, ``contact +`` or ``contact -``."""
        kind, _, sign = name.partition(" ")
        side = -1 if sign == "-" else 1
        if kind == "linear":
            absorber = self.scene.absorber
            tuned = absorber if isinstance(absorber, TunedAbsorber) else None
            return Regime(
                name,
                stiffness=0.0 if tuned is None else tuned.stiffness,
                damping=0.0 if tuned is None else tuned.damping,
                joined=isinstance(absorber, StuckAbsorber),
            )
        if kind == "free":
            return Regime(name, self._walls())
        if kind == "slide":
            assert self.limit is not None
            return Regime(name, (*self._walls(), Guard(REVERSAL, 0.0, gamma_weight=side)), constant=-side * self.limit)
        if kind == "contact":
            assert self.gap is not None
            assert self.wall_stiffness is not None
            return Regime(name, (Guard(PARTING, -self.gap, y_weight=side, side=side),), stiffness=self.wall_stiffness, rest=side * self.gap)
        limit = 0.0 if self.limit is None else self.limit
        up, down = Guard(RELEASE_DOWN, limit, force_weight=-1.0), Guard(RELEASE_UP, limit, force_weight=1.0)
        # a wall pushes as hard as it must: at the upper one only the upper bound of the force remains
        guards = {"stuck": (up, down), "held +": (up,), "held -": (down,)}[name]
        return Regime(name, guards, joined=True)

    def moving(self, gamma: float) -> str:
        """Return the regime in which the absorber moves with a relative velocity."""
        if self.limit is None:
            return "free"
        return "slide +" if gamma > 0 else "slide -"

    def start(self, y: float, gamma: float, joint_force: float) -> str:
        """Return the regime of a state; ``joint_force`` is what would keep absorber and tip together."""
        if not isinstance(self.scene.absorber, SlidingAbsorber):
            return "linear"
        if self.wall_stiffness is not None and self.gap is not None and abs(y) >= self.gap:
            return "contact +" if y > 0 else "contact -"
        return self._reversed(joint_force) if gamma == 0 and self.limit is not None else self.moving(gamma)

    def _reversed(self, joint_force: float) -> str:
        assert self.limit is not None
        if abs(joint_force) <= self.limit:
            return "stuck"
        return "slide -" if joint_force > 0 else "slide +"

    def after(self, guard: Guard, gamma: float, joint_force: float, rest_speed: float) -> tuple[str, bool]:
        """Return the regime that follows on a guard, and whether the relative velocity becomes zero.

        ``gamma`` is the relative velocity after the jump. A bounce slower than ``rest_speed`` that friction and wall can hold ends a chatter.
        """
        if guard.event == WALL:
            limit = 0.0 if self.limit is None else self.limit
            if abs(gamma) >= rest_speed:
                return self.moving(gamma), False
            if guard.side * joint_force < limit:
                return ("held +" if guard.side > 0 else "held -"), True
            return self.moving(-guard.side), True
        if guard.event == REVERSAL:
            return self._reversed(joint_force), True
        if guard.event in (RELEASE_UP, RELEASE_DOWN):
            sign = 1.0 if guard.event == RELEASE_UP else -1.0
            return self.moving(sign), True
        if guard.event == CONTACT:
            return ("contact +" if guard.side > 0 else "contact -"), False
        return "free", False

    @staticmethod
    def roots_at_start(guard: Guard, left: Regime, entered: Regime, stopped: bool) -> tuple[int, ...]:
        """Return the order of the root that each guard of the regime ``entered`` has at its start, 0 where it has none.

        The relative displacement is continuous, and the relative velocity is zero where it was ``stopped``. At a release the relative acceleration is
        zero too.
        """
        held_side = {"held +": 1, "held -": -1}.get(left.name, 0)
        at_wall = guard.side if guard.event in (WALL, CONTACT, PARTING) else held_side
        still = 0
        if stopped:
            still = 2 if guard.event in (RELEASE_UP, RELEASE_DOWN) else 1

        def order(new: Guard) -> int:
            if new.event == REVERSAL:
                return still
            on_it = new.event in (WALL, CONTACT, PARTING) and new.side == at_wall
            return 1 + still if on_it else 0

        return tuple(order(new) for new in entered.guards)
