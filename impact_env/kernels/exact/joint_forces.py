"""Which of the absorbers without relative velocity stick, and in which direction the others slip.

This is decided by a small complementarity problem for their joint forces (`resolve_joints`).

With the joint forces f the relative accelerations are c + G f. The compliance G is symmetric and
positive definite: absorber masses, and the beam's mobility between the absorbers' places. Each
force lies in the interval that friction and the touched wall allow. Inside the interval the
relative acceleration is zero; at its upper bound the absorber lags behind the beam, at its lower
bound it leads. These are the conditions for the
minimum of f G f/2 + c f in a box, which is unique. It is found by block principal pivoting: all
forces that break a condition change their case (inside, upper end, lower end) at once as long as
that leaves fewer of them, else only the last one, which ends for any such matrix [1]. For one
absorber it is `rigid.try_stick`.

[1] Judice, Pires: A block principal pivoting algorithm for large-scale strictly monotone linear
complementarity problems, Computers & Operations Research 21 (1994), for bounds on both sides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINED,
    JOINT_FORCE_TOL,
    find_joint_bounds,
    record_joined_phase,
    update_friction_force,
)
from impact_env.kernels.motion.loads import evaluate_load

# violation of a condition up to which it is satisfied, as a share of the sum of the sizes of its
# terms: rounding is below 1e-14 of this sum, and a case that is really wrong violates by far more
COMPLEMENTARITY_TOL = 1e-11
# block pivots in a row that may leave at least as many wrong cases as before
MOST_BLOCK_PIVOTS = 3
# pivots per absorber
MOST_PIVOTS = 100
# cases of a joint force
FORCE_INSIDE = 0
FORCE_AT_UPPER = 1
FORCE_AT_LOWER = 2


class Joints(NamedTuple):
    """Scratch memory of the complementarity problem of n absorbers.

    An absorber is ``undecided`` if it has no relative velocity: it may stick or slip.
    """

    # (n,) without the joint forces of undecided absorbers (m/s^2)
    relative_acceleration: NDArray[np.float64]
    # (n,) sum of the sizes of the terms of `relative_acceleration` (m/s^2)
    acceleration_slack: NDArray[np.float64]
    force: NDArray[np.float64]  # (n,) joint force on the absorber (N), 0 if not undecided
    beam_displacement: NDArray[np.float64]  # (n,) at the absorbers' places (m)
    beam_velocity: NDArray[np.float64]  # (n,) at the absorbers' places (m/s)
    undecided: NDArray[np.bool_]  # (n,)
    case: NDArray[np.int64]  # (n,) FORCE_INSIDE, FORCE_AT_UPPER, FORCE_AT_LOWER
    # (n,) scratch: the absorbers with forces inside their bounds, or each absorber's right case
    inside: NDArray[np.int64]
    system: NDArray[np.float64]  # (n, n + 1) matrix and right-hand side for the forces inside
    unsolved: NDArray[np.bool_]  # (1,) whether a problem of this run was not solved up to rounding
    freed: NDArray[np.bool_]  # (n,) absorbers that an impact separates from the beam
    complete: NDArray[np.bool_]  # (n,) whether a contact state includes a moving base's motion


@jit_allocating
def new_joints(n):
    """Return scratch memory for n absorbers."""
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
        np.zeros(n, np.bool_),
        np.zeros(n, np.bool_),
    )


@jit
def compute_contact_kinematics(absorbers, state, joints):
    """Write displacement and velocity of the beam at the absorbers' places to ``joints``.

    ``absorbers``: `sets.Absorbers`; ``state`` (2 N_m + 2 n,).
    """
    n, modes = absorbers.shapes.shape
    half = n + modes
    for a in range(n):
        q = 0.0
        v = 0.0
        for i in range(modes):
            q += absorbers.shapes[a, i] * state[i]
            v += absorbers.shapes[a, i] * state[half + i]
        joints.beam_displacement[a] = q
        joints.beam_velocity[a] = v


@jit
def compute_force_at(window, tau):
    """Return the external force (N) at an offset ``tau`` (s) from the window's centre.

    Loads other than the chirp count only with their force, not with their moving bases.
    """
    load = window.load
    if load is not None:
        return evaluate_load(load.terms, window.omega, tau)
    angle = (window.omega + 0.5 * window.alpha * tau) * tau
    return window.force_r * math.cos(angle) - window.force_i * math.sin(angle)


@jit
def compute_relative_accelerations(absorbers, losses, window, contact_states, state, joints):
    """Write the relative accelerations without the joint forces of undecided absorbers.

    They go to ``joints.relative_acceleration``, and the sums of the sizes of their terms, which
    bound their rounding, to ``joints.acceleration_slack``. ``joints.undecided`` must be set;
    ``state`` is that at the contact states' time, ``losses`` a `segments.Losses`.
    """
    n, modes = absorbers.shapes.shape
    half = n + modes
    tau = contact_states[0].tau
    force = compute_force_at(window, tau)
    load = window.load
    inertia = 0.0  # of an absorber under bases that move, over its mass
    if load is not None:
        base = load.base
        if base.moves:
            for c in range(base.terms.shape[0]):
                base.accelerations[c] = evaluate_load(base.terms[c], window.omega, tau)
                inertia += base.at_absorber[c] * base.accelerations[c]
    for a in range(n):
        joints.relative_acceleration[a] = -absorbers.gravity[a] - inertia
        joints.acceleration_slack[a] = abs(absorbers.gravity[a]) + abs(inertia)
        if not joints.undecided[a] and contact_states[a].regime == FREE:
            joints.relative_acceleration[a] += contact_states[a].force / absorbers.mass[a]
    for i in range(modes):
        pull = absorbers.square[i] * state[i]
        drag = losses.rate[i] * state[half + i]
        push = losses.force_shape[i] * force
        carried = 0.0  # inertia of the mode under bases that move
        carried_size = 0.0
        if load is not None:
            if load.base.moves:
                for c in range(load.base.terms.shape[0]):
                    share = load.base.participation[c, i] * load.base.accelerations[c]
                    carried += share
                    carried_size += abs(share)
        rate = push - carried - drag - pull
        size = abs(push) + carried_size + abs(drag) + abs(pull)
        for b in range(n):
            if not joints.undecided[b] and contact_states[b].regime == FREE:
                rate -= absorbers.shapes[b, i] * contact_states[b].force
                size += abs(absorbers.shapes[b, i] * contact_states[b].force)
        for a in range(n):
            joints.relative_acceleration[a] -= absorbers.shapes[a, i] * rate
            joints.acceleration_slack[a] += abs(absorbers.shapes[a, i]) * size


@jit
def compute_sticking_force(compliance, joints, a):
    """Return the joint force (N) for which absorber a has no relative acceleration.

    All other joint forces are those of ``joints.force``. ``compliance`` (n, n) in 1/kg.
    """
    r = joints.relative_acceleration[a]
    for b in range(joints.force.shape[0]):
        if b != a and joints.undecided[b]:
            r += compliance[a, b] * joints.force[b]
    return -r / compliance[a, a]


@jit
def set_forces_at_bounds(absorbers, contact_states, joints):
    """Set ``joints.force`` to the bound where the case is at a bound, and to 0 elsewhere."""
    for a in range(joints.force.shape[0]):
        joints.force[a] = 0.0
        if joints.undecided[a] and joints.case[a] != FORCE_INSIDE:
            low, high = find_joint_bounds(absorbers.limit[a], contact_states[a].side)
            joints.force[a] = high if joints.case[a] == FORCE_AT_UPPER else low


@jit
def solve_inside_forces(compliance, joints):
    """Solve for the joint forces whose case is FORCE_INSIDE, and write them to ``joints.force``.

    The other forces must be at their bounds (`set_forces_at_bounds`). The method is Gaussian
    elimination without pivoting, as the matrix is symmetric and positive definite;
    ``joints.system`` and ``joints.inside`` are overwritten.
    """
    system = joints.system
    inside = joints.inside
    n = joints.force.shape[0]
    m = 0
    for a in range(n):
        if joints.undecided[a] and joints.case[a] == FORCE_INSIDE:
            inside[m] = a
            m += 1
    for i in range(m):
        a = inside[i]
        for k in range(m):
            system[i, k] = compliance[a, inside[k]]
        r = joints.relative_acceleration[a]
        for b in range(n):
            if joints.undecided[b] and joints.case[b] != FORCE_INSIDE:
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
def find_better_case(absorbers, compliance, contact_states, joints, a):
    """Return the right case of absorber a's joint force, and the violation of the present case.

    The right case follows from the conditions for the present forces. The violation is relative to
    the sum of the sizes of the condition's terms, and 0 where the present case is right.
    """
    low, high = find_joint_bounds(absorbers.limit[a], contact_states[a].side)
    case = joints.case[a]
    r = joints.relative_acceleration[a]
    size = joints.acceleration_slack[a]
    for b in range(joints.force.shape[0]):
        if joints.undecided[b]:
            r += compliance[a, b] * joints.force[b]
            size += abs(compliance[a, b] * joints.force[b])
    if case == FORCE_INSIDE:
        if joints.force[a] > high:
            return FORCE_AT_UPPER, (joints.force[a] - high) * compliance[a, a] / size
        if joints.force[a] < low:
            return FORCE_AT_LOWER, (low - joints.force[a]) * compliance[a, a] / size
        return case, 0.0
    if case == FORCE_AT_UPPER and r > 0.0:
        return FORCE_INSIDE, r / size
    if case == FORCE_AT_LOWER and r < 0.0:
        return FORCE_INSIDE, -r / size
    return case, 0.0


@jit
def count_violations(absorbers, compliance, contact_states, joints):
    """Return the number of joint forces in a wrong case, and the last of them.

    Their right cases are written to ``joints.inside``.
    """
    count = 0
    last = 0
    for a in range(joints.force.shape[0]):
        joints.inside[a] = joints.case[a]
        if joints.undecided[a]:
            case, broken = find_better_case(absorbers, compliance, contact_states, joints, a)
            if broken > COMPLEMENTARITY_TOL:
                joints.inside[a] = case
                count += 1
                last = a
    return count, last


@jit
def solve_joint_forces(absorbers, compliance, contact_states, joints):
    """Find the joint forces that satisfy all conditions up to rounding.

    The undecided absorbers' forces and cases are written to ``joints.force`` and ``joints.case``.
    ``joints.unsolved`` is set if no solution is found within MOST_PIVOTS pivots per absorber.
    """
    n = joints.force.shape[0]
    for a in range(n):
        joints.case[a] = FORCE_INSIDE
    least = n + 1
    tries = MOST_BLOCK_PIVOTS
    for _ in range(MOST_PIVOTS * n):
        set_forces_at_bounds(absorbers, contact_states, joints)
        solve_inside_forces(compliance, joints)
        count, last = count_violations(absorbers, compliance, contact_states, joints)
        if count == 0:
            return
        if count < least:
            least = count
            tries = MOST_BLOCK_PIVOTS
        else:
            tries -= 1
        for a in range(n):
            if tries >= 0 or a == last:
                joints.case[a] = joints.inside[a]
    joints.unsolved[0] = True


@jit
def resolve_joints(absorbers, losses, compliance, window, contact_states, state, joints, events):
    """Decide for each absorber of ``joints.undecided`` whether it sticks, or how it slips.

    ``compliance`` (n, n) is that of the free beam (1/kg), ``state`` the state at the current time.
    If the joint force is at a bound the absorber sticks: the rate of the force then decides in the
    joined regime. ``contact_states`` are updated, joined phases that end are appended to
    ``events``. The regime's amplitudes are not changed.
    """
    compute_contact_kinematics(absorbers, state, joints)
    compute_relative_accelerations(absorbers, losses, window, contact_states, state, joints)
    solve_joint_forces(absorbers, compliance, contact_states, joints)
    time = window.centre + contact_states[0].tau
    for a in range(contact_states.shape[0]):
        if joints.undecided[a]:
            low, high = find_joint_bounds(absorbers.limit[a], contact_states[a].side)
            f = compute_sticking_force(compliance, joints, a)
            slack = JOINT_FORCE_TOL * joints.acceleration_slack[a] / compliance[a, a]
            if low - slack <= f <= high + slack:
                begin_stick(contact_states[a], joints.beam_displacement[a], time)
            else:
                begin_slip(
                    absorbers.limit[a],
                    contact_states[a],
                    joints.beam_velocity[a],
                    -1.0 if f > high else 1.0,
                    time,
                    events,
                )


@jit
def begin_stick(contact_state, place, time):
    """Set the contact state of an absorber that sticks from ``time`` (s) on, or sticks already.

    ``place`` (m) is the displacement of the beam at the absorber.
    """
    if contact_state.regime != JOINED:
        contact_state.regime = JOINED
        contact_state.phase_start = time
        contact_state.offset = contact_state.q - place
    contact_state.force = 0.0
    contact_state.at_rest = False


@jit
def begin_slip(limit, contact_state, speed, sign, time, events):
    """Set the contact state of an absorber that slips from ``time`` (s) on in direction ``sign``.

    ``sign``: -1 or 1; ``speed`` (m/s) is the velocity of the beam at the absorber's place, and so
    the absorber's. If the absorber was joined, its joined phase is appended to ``events``.
    """
    if contact_state.regime == JOINED:
        record_joined_phase(events, contact_state, time)
    contact_state.regime = FREE
    contact_state.sign = sign
    contact_state.at_rest = True
    contact_state.v = speed
    update_friction_force(limit, contact_state)
