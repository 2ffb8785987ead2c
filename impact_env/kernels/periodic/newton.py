"""Newton's method on the conditions of `green.py`.

Its steps are limited so that the events remain in their order.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_allocating
from impact_env.kernels.periodic.green import fill_conditions, new_orbit_workspace

CONVERGED, NOT_CONVERGED, ORDER_LOST, SINGULAR = range(4)
MOST_STEPS = 30
RESIDUAL_TOL = 1e-13  # of the units: a residual below this is rounding
STALLED_RESIDUAL_TOL = 1e-9  # a residual below this that no longer falls is rounding as well
LEAST_INTERVAL_SHARE = 0.2  # share of the time between two events that one step leaves at least
LEAST_PHASE_INTERVAL = 1e-9  # rad between events, below which their order is lost


@jit
def solve_in_place(matrix, columns, rows):
    """Solve ``matrix`` x = column number ``columns`` of the same array, (m, > m).

    The method is elimination with row exchange. Returns False if the matrix is singular.
    """
    m = rows.shape[0]
    largest = 0.0
    for i in range(m):
        for k in range(m):
            largest = max(largest, abs(matrix[i, k]))
    for i in range(m):
        best = i
        for k in range(i + 1, m):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if not abs(matrix[best, i]) > 1e-15 * largest:
            return False
        if best != i:
            for k in range(i, m):
                matrix[i, k], matrix[best, k] = matrix[best, k], matrix[i, k]
            matrix[i, columns], matrix[best, columns] = matrix[best, columns], matrix[i, columns]
        for k in range(i + 1, m):
            factor = matrix[k, i] / matrix[i, i]
            if factor != 0.0:
                for c in range(i + 1, m):
                    matrix[k, c] -= factor * matrix[i, c]
                matrix[k, columns] -= factor * matrix[i, columns]
    for i in range(m - 1, -1, -1):
        total = matrix[i, columns]
        for k in range(i + 1, m):
            total -= matrix[i, k] * rows[k]
        rows[i] = total / matrix[i, i]
    return True


@jit
def limit_step(order, z, step):
    """Return the largest share (at most 1) of a Newton step that keeps the events in order.

    Each time between two events keeps at least `LEAST_INTERVAL_SHARE` of its length.
    """
    n = order.wall.shape[0]
    share = 1.0
    for i in range(n):
        after = z[i + 1] if i + 1 < n else z[0] + order.turn
        move = step[i + 1] - step[i] if i + 1 < n else step[0] - step[i]
        if move < 0.0:
            share = min(share, (LEAST_INTERVAL_SHARE - 1.0) * (after - z[i]) / move)
    return share


@jit
def find_least_interval(order, z):
    """Return the shortest way between two events in rad."""
    n = order.wall.shape[0]
    least = z[0] + order.turn - z[n - 1]
    for i in range(n - 1):
        least = min(least, z[i + 1] - z[i])
    return least


@jit_allocating
def solve_orbit(structure, point, order, z, scale, system):
    """Move the unknowns ``z`` (m,) to a solution.

    Returns status, steps and largest residual. The ``system`` is left as it is at ``z``.
    """
    workspace = new_orbit_workspace(structure, order)
    size = z.shape[0]
    work = np.zeros((size, size + 1))
    step = np.zeros(size)
    error = np.inf
    last = np.inf
    for k in range(MOST_STEPS):
        fill_conditions(structure, point, order, z, scale, workspace, system, False)
        error = np.max(np.abs(system.residual))
        if not np.isfinite(error):
            return NOT_CONVERGED, k, error
        if error < RESIDUAL_TOL or (error < STALLED_RESIDUAL_TOL and error > 0.3 * last):
            break
        last = error
        work[:, :size] = system.jacobian[:, :size]
        work[:, size] = system.residual
        if not solve_in_place(work, size, step):
            return SINGULAR, k, error
        step *= -1.0
        share = limit_step(order, z, step)
        z += share * step
        if find_least_interval(order, z) < LEAST_PHASE_INTERVAL:
            return ORDER_LOST, k, error
    else:
        return NOT_CONVERGED, MOST_STEPS, error
    fill_conditions(structure, point, order, z, scale, workspace, system, True)
    return CONVERGED, k, error
