"""The derivative of an orbit's return map: flights as linear maps, events as saltation matrices.

An event moves in time with the state, so its matrix is the derivative of its jump plus what the
vector fields before and after differ by during the shift: each is a rank-one change (of the
velocities, by the relative displacement or by its rate at the event).
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_allocating
from impact_env.kernels.periodic.motion import compute_state_in_flight


@jit
def apply_flight(structure, dt, block, matrix):
    """Multiply ``matrix`` from the left by the linear map of a flight of ``dt`` (s).

    ``matrix`` has the shape (2 N_m + 2, columns).
    """
    n = structure.omega.shape[0]
    columns = matrix.shape[1]
    block[:, :] = 0.0
    for j in range(structure.s.shape[0]):
        e = structure.weight[j] * np.exp(structure.s[j] * dt)
        i = structure.mode[j]
        block[0, i] += e.real  # h, the answer to a unit impulse, and its rate
        block[1, i] += (structure.s[j] * e).real
    for i in range(n):
        h = block[0, i]
        rate = block[1, i]
        own = rate + structure.rate[i] * h
        stiff = -structure.omega[i] * structure.omega[i] * h
        for c in range(columns):
            q = matrix[i, c]
            v = matrix[n + 1 + i, c]
            matrix[i, c] = own * q + h * v
            matrix[n + 1 + i, c] = stiff * q + rate * v
    for c in range(columns):
        matrix[n, c] += dt * matrix[2 * n + 1, c]


@jit
def compute_relative_rows(structure, matrix, c):
    """Return relative displacement and velocity of column ``c``."""
    n = structure.omega.shape[0]
    d = matrix[n, c]
    v = matrix[2 * n + 1, c]
    for i in range(n):
        d -= structure.tip[i] * matrix[i, c]
        v -= structure.tip[i] * matrix[n + 1 + i, c]
    return d, v


@jit
def apply_saltation(structure, wall, restitution, impulse, jump, rate, bend, matrix):
    """Multiply ``matrix`` from the left by the saltation matrix of an event.

    ``impulse`` (N s), ``jump`` (N) of the friction force on the absorber, relative velocity
    ``rate`` (m/s) and acceleration ``bend`` (m/s^2) before.
    """
    n = structure.omega.shape[0]
    mass = structure.mass
    bounce = (1.0 + restitution) / structure.compliance
    for c in range(matrix.shape[1]):
        d, v = compute_relative_rows(structure, matrix, c)
        if wall == 0:
            push = jump * v / bend
            shift = 0.0
        else:
            shift = d / rate
            push = -bounce * (v - bend * shift) + jump * shift
            matrix[n, c] += impulse * shift / mass
        matrix[2 * n + 1, c] += push / mass
        for i in range(n):
            # a mode's damping answers the impulse at once, and so for the time of the shift
            matrix[i, c] -= structure.tip[i] * impulse * shift
            matrix[n + 1 + i, c] -= structure.tip[i] * (push - structure.rate[i] * impulse * shift)


@jit_allocating
def compute_monodromy(structure, point, order, flights, impulses, jumps, matrix, turning):
    """Write the derivative of the map over one span.

    The map leads from just after the first event to just after its return. It is mirrored back if
    the order is mirrored.

    ``jumps`` (n,): changes of the friction force in N. ``turning`` (n,) takes the relative
    acceleration before each reversal over the change that friction brings: -1 or below where the
    absorber slides on the other way, in between friction holds it; and -inf at impacts.
    """
    n = order.wall.shape[0]
    size = matrix.shape[0]
    modes = size // 2 - 1
    block = np.zeros((2, modes))
    modal = np.zeros((3, modes))
    amplitude = np.zeros(structure.s.shape[0], np.complex128)
    state = np.zeros(size)
    matrix[:, :] = np.eye(size)
    turning[:] = -np.inf
    for k in range(1, n + 1):
        i, turn = (k, 1.0) if k < n else (0, order.mirror)
        dt = flights.time[k] - flights.time[k - 1]
        apply_flight(structure, dt, block, matrix)
        compute_state_in_flight(structure, point, flights, k - 1, dt, amplitude, modal, state)
        rate = state[size - 1]
        bend = flights.force[k - 1] / structure.mass
        for m in range(modes):
            rate -= structure.tip[m] * state[modes + 1 + m]
            bend -= structure.tip[m] * modal[2, m]
        if order.wall[i] == 0:
            turning[i] = (
                bend / (turn * jumps[i] * structure.compliance) if jumps[i] != 0.0 else -np.inf
            )
        apply_saltation(
            structure,
            order.wall[i],
            point.restitution,
            turn * impulses[i],
            turn * jumps[i],
            rate,
            bend,
            matrix,
        )
    if order.mirror < 0.0:
        matrix[:, :] = -matrix
