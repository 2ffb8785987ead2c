"""Contact laws in the frequency domain.

They give the force on the absorber for a relative displacement, both as trigonometric polynomials.

Rigid laws use the dynamic Lagrangian method (Nacivet, Pierre, Thouverez and Jezequel, Journal of
Sound and Vibration 265, 2003): the force that the equations of motion require is corrected by
``weight`` times the violation of the law, and projected onto the allowed forces. Elastic Coulomb
friction (paper, Eq. elCoulomb) is a spring in series with a slider, computed from turning point to
turning point. The ends of intervals of contact, stick and slip are computed as roots, and the
coefficients in closed form.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import scipy.optimize

from impact_env.checks import (
    non_negative,
    or_none,
    positive,
    require,
)
from impact_env.fields import check_fields
from impact_env.parameters import CompliantWalls, CoulombFriction, ElasticCoulombFriction
from impact_env.periodic.trigonometric import (
    TURN,
    Real,
    basis,
    derivative,
    find_roots,
    harmonics_of,
    negative,
    share,
    window,
)


class Hysteresis(NamedTuple):
    """Polynomial (n,) of the force on the absorber in N, with its derivatives.

    The derivatives are with respect to motion (n, n), limit (n,) and stiffness (n,).
    """

    force: Real
    by_motion: Real
    by_limit: Real
    by_stiffness: Real


class _State(NamedTuple):
    """Force at a turning point and its derivatives."""

    force: float
    by_motion: Real
    by_limit: float
    by_stiffness: float


class _Stick(NamedTuple):
    """Interval [begin, end] (rad) in which the force is ``constant`` - k r."""

    begin: float
    end: float
    constant: _State


class _Slip(NamedTuple):
    """Interval [begin, end] (rad) in which the force is ``sign`` times the limit."""

    begin: float
    end: float
    sign: float


def elastic_coulomb_force(motion: Real, limit: float, stiffness: float) -> Hysteresis:
    """Return the periodic force for a relative displacement ``motion`` (2H + 1,) in m.

    ``limit`` is in N, ``stiffness`` in N/m. The ends of the intervals of stick and slip are roots
    of r' and of r less a constant, so nothing is sampled. If nothing slips, the force is -k r
    without its mean, because the rest position of the spring is then undetermined.
    """
    h = harmonics_of(motion)
    turns = find_roots(derivative(motion)[None])[0]
    if len(turns):
        rows = np.array([basis(angle, h) for angle in turns])
        state, slipped = _cycle(
            motion, turns, rows, limit, stiffness, _State(0.0, np.zeros(len(motion)), 0.0, 0.0)
        )[:2]
        if slipped:
            stretches = _cycle(motion, turns, rows, limit, stiffness, state)[2]
            return _sum_stretches(motion, stretches, limit, stiffness)
    moving = np.ones(len(motion))
    moving[0] = 0.0
    return Hysteresis(
        -stiffness * moving * motion,
        -stiffness * np.diag(moving),
        np.zeros(len(motion)),
        -moving * motion,
    )


def _cycle(
    motion: Real, turns: Real, rows: Real, limit: float, stiffness: float, state: _State
) -> tuple[_State, bool, list[_Stick | _Slip]]:
    """Follow the slider through one period from the first reversal on.

    Returns the final state, whether any slip occurred, and the intervals of stick and slip.
    """
    reached = rows @ motion
    count = len(turns)
    slipped = False
    stretches: list[_Stick | _Slip] = []
    for i in range(count):
        begin = turns[i]
        end = turns[i + 1] if i + 1 < count else turns[0] + TURN
        after = (i + 1) % count
        move = reached[after] - reached[i]
        held = _State(
            state.force + stiffness * reached[i],
            state.by_motion + stiffness * rows[i],
            state.by_limit,
            state.by_stiffness + reached[i],
        )
        pulled = state.force - stiffness * move
        if abs(pulled) <= limit:
            stretches.append(_Stick(begin, end, held))
            by_motion = held.by_motion - stiffness * rows[after]
            state = _State(pulled, by_motion, state.by_limit, state.by_stiffness - move)
            continue
        sign = -float(np.sign(move))
        at = _find_angle(motion, begin, end, (held.force - sign * limit) / stiffness)
        stretches += [_Stick(begin, at, held), _Slip(at, end, sign)]
        state = _State(sign * limit, np.zeros(len(motion)), sign, 0.0)
        slipped = True
    return state, slipped, stretches


def _find_angle(motion: Real, begin: float, end: float, value: float) -> float:
    """Return the angle between two turning points at which the motion has a value."""

    def rest(angle: float) -> float:
        return float(basis(angle, harmonics_of(motion)) @ motion - value)

    if (
        rest(begin) * rest(end) >= 0
    ):  # slips from the turning point on, or at its very end: rounding
        return begin if abs(rest(begin)) < abs(rest(end)) else end
    return float(scipy.optimize.brentq(rest, begin, end, xtol=1e-15, rtol=1e-15))


def _sum_stretches(
    motion: Real, stretches: list[_Stick | _Slip], limit: float, stiffness: float
) -> Hysteresis:
    h = harmonics_of(motion)
    n = len(motion)
    matrix = window(np.array([s[:2] for s in stretches if isinstance(s, _Stick)]), h)
    force = -stiffness * (matrix @ motion)
    by_motion = -stiffness * matrix
    by_limit = np.zeros(n)
    by_stiffness = -(matrix @ motion)
    for stretch in stretches:
        part = share(np.array([stretch[:2]]), h)
        if isinstance(stretch, _Slip):
            force = force + stretch.sign * limit * part
            by_limit = by_limit + stretch.sign * part
            continue
        constant = stretch.constant
        force = force + constant.force * part
        by_motion = by_motion + np.outer(part, constant.by_motion)
        by_limit = by_limit + constant.by_limit * part
        by_stiffness = by_stiffness + constant.by_stiffness * part
    return Hysteresis(force, by_motion, by_limit, by_stiffness)


class ContactForce(NamedTuple):
    """Force on the absorber (n,) in N with its derivatives.

    The derivatives are with respect to relative displacement and dynamic force (n, n), and to
    frequency and a parameter (n,). ``by_rate`` (n, n) is with respect to the relative velocity
    (m/s); ``by_motion`` includes this dependence through the harmonics of the velocity.
    """

    force: Real
    by_motion: Real
    by_dynamic: Real
    by_omega: Real
    by_parameter: Real
    by_rate: Real


class ContactForceLaw(Protocol):
    """Interface of a contact law of harmonic balance."""

    def contact(self, motion: Real, dynamic: Real, omega: float, parameter: str) -> ContactForce:
        """Return the force for relative displacement (n,) in m and dynamic force (n,) in N.

        ``omega`` is the fundamental frequency in rad/s. ``parameter`` is the name of the field with
        respect to which the force is differentiated; the derivative is zero for a name that the law
        does not have.
        """


@dataclass(frozen=True)
class RigidContact:
    """Signorini's and Coulomb's laws (paper, Eqs. signorini and coulomb); absent parts are None.

    ``gap`` is in m, ``friction_limit`` in N. ``weight`` in N/m and ``friction_weight`` in N s/m are
    parameters of the method, which influence the result if the number of harmonics is too small.
    Contact is conservative: there is no restitution.
    """

    gap: float | None
    friction_limit: float | None
    weight: float
    friction_weight: float

    def __post_init__(self) -> None:
        check_fields(
            self,
            gap=or_none(non_negative),
            friction_limit=or_none(lambda _name, value: CoulombFriction(value).limit),
            weight=positive,
            friction_weight=positive,
        )

    def contact(self, motion: Real, dynamic: Real, omega: float, parameter: str) -> ContactForce:
        """See `ContactForceLaw`."""
        walls = _walls(dynamic - self.weight * motion, self.weight, self.gap, parameter)
        held = walls.matrix
        slope = walls.by_gap if parameter == "gap" else np.zeros_like(motion)
        if parameter == "weight":
            slope = (
                walls.by_gap * (0.0 if self.gap is None else self.gap / self.weight) - held @ motion
            )
        wall = ContactForce(
            walls.force,
            -self.weight * held,
            held,
            np.zeros_like(motion),
            slope,
            np.zeros_like(held),
        )
        if self.friction_limit is None:
            return wall
        return self._with_friction(motion, dynamic, omega, parameter, wall)

    def _with_friction(
        self, motion: Real, dynamic: Real, omega: float, parameter: str, wall: ContactForce
    ) -> ContactForce:
        """Add friction to the force of the walls.

        Friction is the dynamic force less the walls' force and less the weighted velocity, clipped
        to the limit.
        """
        h = harmonics_of(motion)
        limit = float(self.friction_limit or 0.0)
        weight = self.friction_weight
        rate = derivative(motion)
        wanted = dynamic - wall.force - weight * omega * rate
        above = -wanted
        below = wanted.copy()
        above[0], below[0] = above[0] + limit, below[0] + limit
        at = find_roots(np.array([above, below]))
        up = negative(above, at[0])
        down = negative(below, at[1])
        stick = np.eye(len(motion)) - window(np.concatenate([up, down]), h)
        slid = share(up, h) - share(down, h)
        turning = weight * omega * derivative(np.eye(len(motion))).T
        by_parameter = wall.by_parameter - stick @ wall.by_parameter
        if parameter == "friction_limit":
            by_parameter = by_parameter + slid
        if parameter == "friction_weight":
            by_parameter = by_parameter - omega * (stick @ rate)
        return ContactForce(
            wall.force + stick @ wanted + limit * slid,
            wall.by_motion - stick @ (wall.by_motion + turning),
            wall.by_dynamic + stick @ (np.eye(len(motion)) - wall.by_dynamic),
            -weight * (stick @ rate),
            by_parameter,
            -weight * stick,
        )


@dataclass(frozen=True)
class CompliantContact:
    """Unilateral springs and elastic Coulomb friction (paper, Eqs. elSignorini and elCoulomb).

    Absent parts are None. ``gap`` is in m with ``stiffness`` in N/m, ``friction_limit`` in N with
    ``friction_stiffness`` in N/m. These laws need no weight.
    """

    gap: float | None
    stiffness: float | None
    friction_limit: float | None
    friction_stiffness: float | None

    def __post_init__(self) -> None:
        if self.gap is not None or self.stiffness is not None:
            # refuses one without the other, and so does friction
            walls = CompliantWalls(self.stiffness, self.gap)  # type: ignore[arg-type]
            object.__setattr__(self, "stiffness", walls.stiffness)
            object.__setattr__(self, "gap", walls.gap)
        if self.friction_limit is not None or self.friction_stiffness is not None:
            friction = ElasticCoulombFriction(self.friction_limit, self.friction_stiffness)  # type: ignore[arg-type]
            object.__setattr__(self, "friction_limit", friction.limit)
            object.__setattr__(self, "friction_stiffness", friction.stiffness)

    def contact(self, motion: Real, dynamic: Real, omega: float, parameter: str) -> ContactForce:  # noqa: ARG002 - no law of the dynamics
        """See `ContactForceLaw`."""
        zero = np.zeros_like(motion)
        stiffness = 0.0 if self.stiffness is None else self.stiffness
        walls = _walls(-stiffness * motion, stiffness, self.gap, parameter)
        slope = walls.by_gap if parameter == "gap" else zero
        if parameter == "stiffness" and self.gap is not None:
            slope = walls.force / stiffness
        force = walls.force
        by_motion = -stiffness * walls.matrix
        if self.friction_limit is not None and self.friction_stiffness is not None:
            friction = elastic_coulomb_force(motion, self.friction_limit, self.friction_stiffness)
            force = force + friction.force
            by_motion = by_motion + friction.by_motion
            slope = (
                friction.by_limit
                if parameter == "friction_limit"
                else friction.by_stiffness
                if parameter == "friction_stiffness"
                else slope
            )
        none = np.zeros((len(motion), len(motion)))
        return ContactForce(force, by_motion, none, zero, slope, none)


class _Walls(NamedTuple):
    force: Real
    matrix: Real
    by_gap: Real


def _walls(free: Real, weight: float, gap: float | None, parameter: str) -> _Walls:
    """Return the force of both walls, its Jacobian and its derivative with respect to the gap.

    The force is min(0, free + weight gap) + max(0, free - weight gap).
    """
    n = len(free)
    h = harmonics_of(free)
    if gap is None:
        require(
            parameter != "gap",
            "parameter",
            parameter,
            "a part that is there: this absorber has no walls",
        )
        return _Walls(np.zeros(n), np.zeros((n, n)), np.zeros(n))
    lower = free.copy()
    upper = -free
    lower[0], upper[0] = lower[0] + weight * gap, upper[0] + weight * gap
    at = find_roots(np.array([lower, upper]))
    first = negative(lower, at[0])
    second = negative(upper, at[1])
    matrix = window(np.concatenate([first, second]), h)
    pushed = weight * (share(first, h) - share(second, h))
    return _Walls(matrix @ free + gap * pushed, matrix, pushed)
