"""The rigid contact laws of one of Moreau's time steps in closed form.

The laws are those of the paper (Eqs. signorini, coulomb, impulse).

The laws are numbers, 0 where a scene has no such law, so that one kernel integrates every scene.
"""

from __future__ import annotations

from typing import NamedTuple

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.exact.rigid_contact import NO_WALLS, Walls, compute_restitution
from impact_env.kernels.motion.observers import HELD_LOWER, HELD_UPPER, STUCK_INSIDE
from impact_env.kernels.stepping.grid import NO_PHASE

# a relative velocity after impact this much smaller than what one step changes is rest: ends the
# scheme's endless chatter on a closed wall
REST_TOL = 1e-6


class Spring(NamedTuple):
    """Spring (N/m) and damper (N s/m) between absorber and tip; a stiffness of 0: there is none."""

    stiffness: float
    damping: float


NO_SPRING = Spring(0.0, 0.0)


class RigidLaws(NamedTuple):
    """Contact laws of one absorber.

    They are given by the mass (kg, 0 without absorber), the walls, the friction limit (N, 0 without
    friction, infinity: stuck), and the spring.
    """

    mass: float = 0.0
    walls: Walls = NO_WALLS
    limit: float = 0.0
    spring: Spring = NO_SPRING


@jit
def solve_contact(before, free, distance, walls, slip, compliance):
    """Solve one step's contact problem.

    Returns (relative velocity after, friction and wall percussion on the absorber, kind of phase).

    ``before`` and ``free`` are the relative velocity at the step's start and at its end without
    contact. First friction alone is tried. If it leaves a closed wall with less than -e times the
    velocity before (measured as opening), the wall enforces that value and friction takes the share
    that its law gives for it. ``slip`` (N s): largest friction percussion, 0 without friction.
    """
    after = free
    friction = 0.0
    normal = 0.0
    kind = NO_PHASE
    if slip > 0.0:
        reach = slip * compliance
        if free > reach:
            friction = -slip
            after = free - reach
        elif free < -reach:
            friction = slip
            after = free + reach
        else:
            friction = -free / compliance
            after = 0.0
            kind = STUCK_INSIDE
    if abs(distance) >= walls.gap:
        outward = 1.0 if distance > 0.0 else -1.0
        e = compute_restitution(walls, before)
        if outward * (after + e * before) > 0.0:
            after = -e * before
            if abs(after) < REST_TOL * abs(free - before):
                after = 0.0
            total = (after - free) / compliance
            kind = NO_PHASE
            if after == 0.0:
                kind = HELD_UPPER if outward > 0.0 else HELD_LOWER
            if after > 0.0:
                friction = -slip
            elif after < 0.0:
                friction = slip
            else:
                friction = min(max(total, -slip), slip)
            normal = total - friction
    return after, friction, normal, kind
