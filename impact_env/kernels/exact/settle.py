"""Which of the absorbers without relative velocity move with the beam: a small complementarity problem.

With the forces f of their joints the relative accelerations are c + G f, G being symmetric and positive definite (masses, and the beam's mobility
between the places). Each force lies in the interval that friction and the wall touched can give. Inside it the relative acceleration is zero; at its
upper end the absorber lags, at its lower end it leads. These are the conditions for the minimum of f G f/2 + c f in a box, which is unique. With at
most four absorbers there are at most 3^4 cases of inside, upper end and lower end: each is solved directly, and the one that meets all conditions is
the solution. For one absorber it is `free_and_joined.try_join`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_room
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINED,
    JOINT_FORCE_TOL,
    end_phase,
    friction_force,
    joint_bounds,
)
from impact_env.kernels.motion.loads import value_of

# of the sum of the sizes of a condition's terms: the rounding of four additions and of a direct solution is below 1e-14 of it, the smallest gap
# between two cases that are not one is far above
COMPLEMENTARITY_TOL = 1e-11
# cases of a joint force
INSIDE = 0
UPPER = 1
LOWER = 2


class Joints(NamedTuple):
    """Scratch for the complementarity problem, (n,) each: relative acceleration without joint forces (m/s^2), its slack, joint force (N),
    displacement and velocity of the beam at the absorber's place, who has no relative velocity, and the case of its force.

    ``system`` (n, n + 1): matrix and right-hand side of the forces inside their intervals, whose absorbers are ``inside`` (n,). ``unsolved`` (1,):
    whether a problem had no solution up to rounding.
    """  # noqa: D205

    start: NDArray[np.float64]
    slack: NDArray[np.float64]
    force: NDArray[np.float64]
    place: NDArray[np.float64]
    speed: NDArray[np.float64]
    waits: NDArray[np.bool_]
    case: NDArray[np.int64]
    inside: NDArray[np.int64]
    system: NDArray[np.float64]
    unsolved: NDArray[np.bool_]


@jit_room
def new_joints(n):
    """Return scratch for n absorbers."""
    return Joints(
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n, np.bool_),
        np.zeros(n, np.int64),
        np.zeros(n, np.int64),
        np.zeros((n, n + 1)),
        np.zeros(1, np.bool_),
    )


@jit
def see_places(absorbers, state, joints):
    """Write displacement and velocity of the beam at the absorbers' places."""
    n, modes = absorbers.shapes.shape
    half = n + modes
    for a in range(n):
        q = 0.0
        v = 0.0
        for i in range(modes):
            q += absorbers.shapes[a, i] * state[i]
            v += absorbers.shapes[a, i] * state[half + i]
        joints.place[a], joints.speed[a] = q, v


@jit
def force_now(window, tau):
    """Return the force at an offset from the window's centre (N)."""
    load = window.load
    if load is not None:
        return value_of(load.terms, window.omega, tau)
    angle = (window.omega + 0.5 * window.alpha * tau) * tau
    return window.force_r * math.cos(angle) - window.force_i * math.sin(angle)


@jit
def see_accelerations(absorbers, losses, window, now, state, joints):
    """Write the relative accelerations without the forces of those that wait, and how far the terms' sizes make them uncertain."""
    n, modes = absorbers.shapes.shape
    half = n + modes
    tau = now[0].tau
    force = force_now(window, tau)
    for a in range(n):
        joints.start[a], joints.slack[a] = 0.0, 0.0
        if not joints.waits[a] and now[a].regime == FREE:
            joints.start[a] = now[a].force / absorbers.mass[a]
    for i in range(modes):
        pull = absorbers.square[i] * state[i]
        drag = losses.rate[i] * state[half + i]
        push = losses.force_shape[i] * force
        rate = push - drag - pull
        size = abs(push) + abs(drag) + abs(pull)
        for b in range(n):
            if not joints.waits[b] and now[b].regime == FREE:
                rate -= absorbers.shapes[b, i] * now[b].force
                size += abs(absorbers.shapes[b, i] * now[b].force)
        for a in range(n):
            joints.start[a] -= absorbers.shapes[a, i] * rate
            joints.slack[a] += abs(absorbers.shapes[a, i]) * size


@jit
def wanted_force(compliance, joints, a):
    """Return the force on absorber a that would leave it without relative acceleration, the other joint forces being what they are."""
    r = joints.start[a]
    for b in range(joints.force.shape[0]):
        if b != a and joints.waits[b]:
            r += compliance[a, b] * joints.force[b]
    return -r / compliance[a, a]


@jit
def set_case(absorbers, now, joints, number):
    """Set the case of each joint force from a number in base 3, and the forces at their bounds; return whether these are finite."""
    rest = number
    for a in range(joints.force.shape[0]):
        joints.force[a] = 0.0
        joints.case[a] = INSIDE
        if joints.waits[a]:
            joints.case[a] = rest % 3
            rest = rest // 3
            low, high = joint_bounds(absorbers.limit[a], now[a].side)
            if joints.case[a] == UPPER:
                joints.force[a] = high
            elif joints.case[a] == LOWER:
                joints.force[a] = low
            if not np.isfinite(joints.force[a]):
                return False
    return True


@jit
def solve_inside(compliance, joints):
    """Solve for the forces inside their intervals, the others being at their bounds: Gaussian elimination of a positive definite matrix."""
    system = joints.system
    inside = joints.inside
    n = joints.force.shape[0]
    m = 0
    for a in range(n):
        if joints.waits[a] and joints.case[a] == INSIDE:
            inside[m] = a
            m += 1
    for i in range(m):
        a = inside[i]
        for k in range(m):
            system[i, k] = compliance[a, inside[k]]
        r = joints.start[a]
        for b in range(n):
            if joints.waits[b] and joints.case[b] != INSIDE:
                r += compliance[a, b] * joints.force[b]
        system[i, m] = -r
    for i in range(m):
        for k in range(i + 1, m):
            factor = system[k, i] / system[i, i]
            for j in range(i + 1, m + 1):
                system[k, j] -= factor * system[i, j]
    for back in range(m):
        i = m - 1 - back
        r = system[i, m]
        for k in range(i + 1, m):
            r -= system[i, k] * joints.force[inside[k]]
        joints.force[inside[i]] = r / system[i, i]


@jit
def violation(absorbers, compliance, now, joints):
    """Return by how much the forces break a condition of their case, of the sum of the sizes of its terms."""
    largest = 0.0
    for a in range(joints.force.shape[0]):
        if joints.waits[a]:
            low, high = joint_bounds(absorbers.limit[a], now[a].side)
            r = joints.start[a]
            size = joints.slack[a]
            for b in range(joints.force.shape[0]):
                if joints.waits[b]:
                    r += compliance[a, b] * joints.force[b]
                    size += abs(compliance[a, b] * joints.force[b])
            beyond = max(low - joints.force[a], joints.force[a] - high) * compliance[a, a]
            if joints.case[a] == INSIDE:
                broken = max(abs(r), beyond)
            elif joints.case[a] == UPPER:
                broken = r
            else:
                broken = -r
            if broken > 0.0:
                largest = max(largest, broken / size)
    return largest


@jit
def balance(absorbers, compliance, now, joints):
    """Find the joint forces of those that wait, case by case; note in ``joints.unsolved`` where no case meets all conditions up to rounding."""
    count = 1
    for a in range(joints.force.shape[0]):
        if joints.waits[a]:
            count *= 3
    best = np.inf
    found = 0
    for number in range(count):
        if set_case(absorbers, now, joints, number):
            solve_inside(compliance, joints)
            broken = violation(absorbers, compliance, now, joints)
            if broken <= COMPLEMENTARITY_TOL:
                return
            if broken < best:
                best = broken
                found = number
    set_case(absorbers, now, joints, found)
    solve_inside(compliance, joints)
    joints.unsolved[0] = True


@jit
def settle(absorbers, losses, compliance, window, now, state, joints, events):
    """Decide for each absorber that waits (``joints.waits``) whether it moves with the beam or begins to slide, and which way.

    ``compliance`` (n, n): of the free beam. The state is the one at the current time. At its bound a joint force is let join: there its rate
    decides, in the joined regime.
    """
    see_places(absorbers, state, joints)
    see_accelerations(absorbers, losses, window, now, state, joints)
    balance(absorbers, compliance, now, joints)
    time = window.centre + now[0].tau
    for a in range(now.shape[0]):
        if joints.waits[a]:
            low, high = joint_bounds(absorbers.limit[a], now[a].side)
            f = wanted_force(compliance, joints, a)
            slack = JOINT_FORCE_TOL * joints.slack[a] / compliance[a, a]
            if low - slack <= f <= high + slack:
                join(now[a], joints.place[a], time)
            else:
                part(
                    absorbers.limit[a],
                    now[a],
                    joints.speed[a],
                    -1.0 if f > high else 1.0,
                    time,
                    events,
                )


@jit
def join(now, place, time):
    """Let an absorber move with the beam from now on; one that does so already goes on."""
    if now.regime != JOINED:
        now.regime = JOINED
        now.since = time
        now.offset = now.q - place
    now.force = 0.0
    now.at_rest = False


@jit
def part(limit, now, speed, sign, time, events):
    """Let an absorber without relative velocity slide in a sign from now on; ``speed``: of the beam at its place."""
    if now.regime == JOINED:
        end_phase(events, now, time)
    now.regime = FREE
    now.sign = sign
    now.at_rest = True
    now.v = speed
    friction_force(limit, now)
