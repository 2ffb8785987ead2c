"""Conditions at the events of a free or sliding periodic orbit, and their solution.

The relative displacement is linear in the impulses P_j, the jumps J_j of the friction force and a
constant c, by the periodic Green's function K:

    r(t) = c + sum_j P_j K(t - t_j) + sum_j J_j L(t - t_j) - Re(f H exp(i omega t)),     L' = K

K is the response to an impulse that repeats after each span, with the opposite sign if the order is
mirrored. It is a sum of exponentials and a polynomial (the absorber's share).

The m unknowns z are, in this order, the phases of the n events (rad of the force), the impulses of
the impacts (over `Scale.impulse`), and c (over `Scale.length`) unless the order is mirrored. The
m conditions are in the same order: at each event the rate r' (the mean of both sides equals
-kappa P at a wall, 0 at a reversal), at each impact the distance r, and, unless mirrored, no net
impulse over the span.

In: a structure, a point of the parameters, an order of events, a first guess. Out: residuals and
Jacobian (`fill_conditions`), and the solution by Newton's method (`solve_orbit`), whose steps are
limited so that the events remain in their order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.periodic.closed_form import compute_kappa
from impact_env.kernels.periodic.structure import compute_receptance, divide_complex

# columns of the Jacobian after the m columns of the unknowns: derivatives by the parameters
OMEGA, FORCE, GAP, RESTITUTION, LIMIT = range(5)


class OrbitEquations(NamedTuple):
    """Residuals of the scaled conditions for m unknowns, and their derivatives."""

    residual: NDArray[np.float64]  # (m,)
    jacobian: NDArray[np.float64]  # (m, m + 5) by the scaled unknowns, then OMEGA to LIMIT


class OrbitWorkspace(NamedTuple):
    """Scratch memory for n events, m unknowns and J exponentials."""

    steps: NDArray[np.complex128]  # (n, J) exp(s dt) from the previous event to each event
    # (J,) exponentials of the periodic kernel, from an impulse to the current event
    running: NDArray[np.complex128]
    first: NDArray[np.complex128]  # (J,) the same just after the impulse
    mean: NDArray[np.complex128]  # (J,) the same at the impulse: mean of both sides
    mean_slope: NDArray[np.complex128]  # (J,) derivative of ``mean`` by the span
    # (J,) derivative of ``running`` by the span over ``running``
    span_derivative: NDArray[np.complex128]
    # (n,) index of an event's impulse among the unknowns and of its distance among the conditions;
    # -1: a reversal
    impulse_index: NDArray[np.int64]
    jump: NDArray[np.float64]  # (n,) change of the friction force over muN
    friction_response: NDArray[np.float64]  # (n, 2) displacement and rate by friction, over muN
    # (n, 2) derivatives of displacement and rate by the event's own time
    by_time: NDArray[np.float64]
    # (n, 2) the same by the span with all phases kept, without the forced part
    by_span: NDArray[np.float64]


CONVERGED, NOT_CONVERGED, ORDER_LOST, SINGULAR = range(4)  # status codes of `solve_orbit`
MOST_STEPS = 30
RESIDUAL_TOL = 1e-13  # a scaled residual below this is rounding
STALLED_RESIDUAL_TOL = 1e-9  # a residual below this that no longer falls is rounding as well
LEAST_INTERVAL_SHARE = 0.2  # least share of the time between two events that one step leaves
LEAST_PHASE_INTERVAL = 1e-9  # rad between events, below which their order is lost


@jit_allocating
def new_orbit_workspace(structure, order):
    """Return an `OrbitWorkspace` for an `Order`, with ``impulse_index`` and ``jump`` filled."""
    n = order.wall.shape[0]
    j = structure.s.shape[0]
    place = np.full(n, -1, np.int64)
    jump = np.zeros(n)
    at = n
    for i in range(n):
        if order.wall[i] != 0:
            place[i] = at
            at += 1
        before = order.sign[i - 1] if i > 0 else order.mirror * order.sign[n - 1]
        jump[i] = before - order.sign[i]
    rows = np.zeros((5, j), np.complex128)
    return OrbitWorkspace(
        np.zeros((n, j), np.complex128),
        rows[0],
        rows[1],
        rows[2],
        rows[3],
        rows[4],
        place,
        jump,
        np.zeros((n, 2)),
        np.zeros((n, 2)),
        np.zeros((n, 2)),
    )


@jit_inline
def evaluate_absorber_kernel(structure, span, mirror, tau):
    """Return the polynomial share of the kernels at 0 <= tau <= span (s).

    The seven numbers are L, K, K', K'' and dL/dspan, dK/dspan, dK'/dspan. The polynomials come from
    the free absorber and from the structure's static compliance.
    """
    mass = structure.mass
    static = structure.static
    if mirror < 0.0:
        return (
            0.25 * tau * (tau - span) / mass + 0.5 * static,
            (0.5 * tau - 0.25 * span) / mass, 0.5 / mass, 0.0,
            -0.25 * tau / mass, -0.25 / mass, 0.0,
        )  # fmt: skip
    share = tau / span
    return (
        tau * (0.25 * tau - tau * share / 6.0 - span / 12.0) / mass + static * (0.5 - share),
        (0.5 * tau - 0.5 * tau * share - span / 12.0) / mass - static / span,
        (0.5 - share) / mass,
        -1.0 / (span * mass),
        (tau * share * share / 6.0 - tau / 12.0) / mass + static * share / span,
        (0.5 * share * share - 1.0 / 12.0) / mass + static / (span * span),
        share / (span * mass),
    )


@jit
def compute_exponentials(structure, order, omega, z, workspace):
    """Fill ``steps``, ``first``, ``mean`` and the derivatives by the span in the workspace.

    ``z`` has the events' phases (rad), ``omega`` is in rad/s.
    """
    n = order.wall.shape[0]
    span = order.turn / omega
    mirror = order.mirror
    for j in range(structure.s.shape[0]):
        s = structure.s[j]
        whole = mirror * np.exp(s * span)
        workspace.first[j] = divide_complex(complex(1.0, 0.0), 1.0 - whole)
        workspace.mean[j] = divide_complex(0.5 * (1.0 + whole), 1.0 - whole)
        workspace.span_derivative[j] = divide_complex(s * whole, 1.0 - whole)
        workspace.mean_slope[j] = divide_complex(workspace.span_derivative[j], 1.0 - whole)
        for i in range(n):
            before = z[i - 1] if i > 0 else z[n - 1] - order.turn
            workspace.steps[i, j] = np.exp(s * ((z[i] - before) / omega))


@jit_inline
def sum_kernels(structure, workspace, tau, span, mirror, with_span):
    """Return the kernels at ``tau`` (s) after an impulse, and their derivatives by the span.

    The seven numbers are L, K, K', K'' and dL/dspan, dK/dspan, dK'/dspan for the exponentials in
    ``workspace.running``. If ``with_span`` is False, the last three lack the exponentials' share.
    """
    g0, g1, g2, g3, d0, d1, d2 = evaluate_absorber_kernel(structure, span, mirror, tau)
    for j in range(structure.s.shape[0]):
        e = workspace.running[j]
        g0 += (structure.powers[0, j] * e).real
        g1 += (structure.powers[1, j] * e).real
        g2 += (structure.powers[2, j] * e).real
        g3 += (structure.powers[3, j] * e).real
        if with_span:
            e *= workspace.span_derivative[j]
            d0 += (structure.powers[0, j] * e).real
            d1 += (structure.powers[1, j] * e).real
            d2 += (structure.powers[2, j] * e).real
    return g0, g1, g2, g3, d0, d1, d2


@jit_inline
def sum_own_kernels(structure, workspace, span, mirror):
    """Return L, K, K' at the time of an impulse itself, and dL/dspan, dK/dspan, dK'/dspan.

    Where a kernel jumps, the mean of both sides is returned.
    """
    g0 = 0.0
    g1 = -0.25 * span / structure.mass
    g2 = 0.0
    d0 = 0.0
    d1 = -0.25 / structure.mass
    d2 = 0.0
    if mirror > 0.0:
        g1 = -span / (12.0 * structure.mass) - structure.static / span
        d1 = -1.0 / (12.0 * structure.mass) + structure.static / (span * span)
    for j in range(structure.s.shape[0]):
        g0 += (structure.powers[0, j] * workspace.mean[j]).real
        g1 += (structure.powers[1, j] * workspace.mean[j]).real
        g2 += (structure.powers[2, j] * workspace.mean[j]).real
        d0 += (structure.powers[0, j] * workspace.mean_slope[j]).real
        d1 += (structure.powers[1, j] * workspace.mean_slope[j]).real
        d2 += (structure.powers[2, j] * workspace.mean_slope[j]).real
    return g0, g1, g2, d0, d1, d2


@jit
def fill_own_rows(structure, point, order, z, scale, workspace, system):
    """Fill the conditions with the forced part, the constant c and each event's own share.

    Rows of ``system`` for rates and distances are overwritten, in m/s and m, and the workspace's
    (n, 2) arrays too. `add_pairs` adds the shares of the other events.
    """
    residual = system.residual
    jacobian = system.jacobian
    n = order.wall.shape[0]
    omega = point.omega
    span = order.turn / omega
    h, h_slope = compute_receptance(structure, omega)
    g0, g1, g2, d0, d1, d2 = sum_own_kernels(structure, workspace, span, order.mirror)
    kappa = compute_kappa(point.restitution, structure.compliance)
    kappa_slope = -structure.compliance / ((1.0 + point.restitution) * (1.0 + point.restitution))
    size = jacobian.shape[0]
    limit = point.limit
    for i in range(n):
        row = workspace.impulse_index[i]
        wall = order.wall[i]
        jump = workspace.jump[i]
        at = workspace.impulse_index[i]
        turning = np.exp(1j * z[i])
        forced = point.force * h * turning
        forced_slope = point.force * h_slope * turning
        impulse = 0.0
        if wall != 0:
            impulse = z[at] * scale.impulse
        workspace.friction_response[i, 0] = jump * g0
        workspace.friction_response[i, 1] = jump * g1
        # derivatives by the event's own phase: an event's own response moves with it
        workspace.by_time[i, 0] = omega * forced.imag
        workspace.by_time[i, 1] = omega * omega * forced.real
        workspace.by_span[i, 0] = impulse * d1 + limit * jump * d0
        workspace.by_span[i, 1] = impulse * d2 + limit * jump * d1
        residual[i] = impulse * (g2 + kappa) + limit * jump * g1 + omega * forced.imag
        jacobian[i, size + OMEGA] = forced.imag + omega * forced_slope.imag
        jacobian[i, size + FORCE] = omega * (h * turning).imag
        jacobian[i, size + RESTITUTION] = kappa_slope * impulse
        if wall != 0:
            residual[row] = impulse * g1 + limit * jump * g0 - forced.real - wall * point.gap
            jacobian[i, at] = g2 + kappa
            jacobian[row, at] = g1
            jacobian[row, size + OMEGA] = -forced_slope.real
            jacobian[row, size + FORCE] = -(h * turning).real
            jacobian[row, size + GAP] = -float(wall)
            if order.mirror > 0.0:
                residual[row] += z[size - 1] * scale.length
                jacobian[row, size - 1] = scale.length


@jit
def add_pairs(structure, point, order, z, scale, workspace, system, with_span):
    """Add the shares of the other events' impulses and friction jumps to each event's rows.

    ``system`` and the workspace's (n, 2) arrays are modified.
    """
    residual = system.residual
    jacobian = system.jacobian
    n = order.wall.shape[0]
    omega = point.omega
    limit = point.limit
    span = order.turn / omega
    for j in range(n):
        at = workspace.impulse_index[j]
        jump = workspace.jump[j]
        impulse = 0.0
        if order.wall[j] != 0:
            impulse = z[at] * scale.impulse
        for slot in range(structure.s.shape[0]):
            workspace.running[slot] = workspace.first[slot]
        for d in range(1, n):
            i = j + d if j + d < n else j + d - n
            tau = (z[i] - z[j]) / omega
            turn = 1.0
            if i < j:
                tau = tau + span
                turn = order.mirror
            for slot in range(structure.s.shape[0]):
                workspace.running[slot] *= workspace.steps[i, slot]
            g0, g1, g2, g3, d0, d1, d2 = sum_kernels(
                structure, workspace, tau, span, order.mirror, with_span
            )
            row = workspace.impulse_index[i]
            rate = turn * (impulse * g2 + limit * jump * g1)
            bend = turn * (impulse * g3 + limit * jump * g2)
            residual[i] += rate
            jacobian[i, j] -= bend / omega
            workspace.by_time[i, 1] += bend
            workspace.by_time[i, 0] += rate
            workspace.friction_response[i, 1] += turn * jump * g1
            workspace.friction_response[i, 0] += turn * jump * g0
            # with the phases kept, tau and span are proportional to 1/omega
            workspace.by_span[i, 0] += turn * (impulse * d1 + limit * jump * d0) + rate * tau / span
            workspace.by_span[i, 1] += turn * (impulse * d2 + limit * jump * d1) + bend * tau / span
            if at >= 0:
                jacobian[i, at] = turn * g2
            if row >= 0:
                residual[row] += turn * (impulse * g1 + limit * jump * g0)
                jacobian[row, j] -= rate / omega
                if at >= 0:
                    jacobian[row, at] = turn * g1


@jit
def fill_derivative_rows(structure, point, order, scale, workspace, jacobian):
    """Complete the Jacobian from the workspace's (n, 2) arrays.

    These are the derivatives by the events' own phases, by omega and by the friction limit.
    """
    n = order.wall.shape[0]
    size = jacobian.shape[0]
    omega = point.omega
    span = order.turn / omega
    for i in range(n):
        row = workspace.impulse_index[i]
        jacobian[i, i] += workspace.by_time[i, 1] / omega
        jacobian[i, size + OMEGA] -= workspace.by_span[i, 1] * span / omega
        jacobian[i, size + LIMIT] = workspace.friction_response[i, 1]
        if row >= 0:
            jacobian[row, i] += workspace.by_time[i, 0] / omega
            jacobian[row, size + OMEGA] -= workspace.by_span[i, 0] * span / omega
            jacobian[row, size + LIMIT] = workspace.friction_response[i, 0]


@jit
def fill_momentum_row(structure, point, order, z, scale, workspace, system):
    """Fill the last row of the conditions, in units of `Scale.impulse`, unless mirrored.

    It states that impulses and friction together leave the absorber's momentum unchanged.
    """
    residual = system.residual
    jacobian = system.jacobian
    n = order.wall.shape[0]
    size = jacobian.shape[0]
    if order.mirror < 0.0:
        return
    total = 0.0
    friction = 0.0
    for i in range(n):
        after = z[i + 1] if i + 1 < n else z[0] + order.turn
        friction -= order.sign[i] * (after - z[i]) / point.omega
        jacobian[size - 1, i] = -workspace.jump[i] * point.limit / point.omega / scale.impulse
        if workspace.impulse_index[i] >= 0:
            total += z[workspace.impulse_index[i]]
            jacobian[size - 1, workspace.impulse_index[i]] = 1.0
    residual[size - 1] = total + friction * point.limit / scale.impulse
    jacobian[size - 1, size + OMEGA] = -friction * point.limit / point.omega / scale.impulse
    jacobian[size - 1, size + LIMIT] = friction / scale.impulse


@jit
def fill_conditions(structure, point, order, z, scale, workspace, system, with_span):
    """Fill the `OrbitEquations` ``system`` with residuals and Jacobian at the unknowns ``z`` (m,).

    If ``with_span`` is False, the column OMEGA is incomplete and must not be used; Newton's method
    at one point does not need it. The workspace is overwritten.
    """
    residual = system.residual
    jacobian = system.jacobian
    n = order.wall.shape[0]
    size = jacobian.shape[0]
    jacobian[:, :] = 0.0
    compute_exponentials(structure, order, point.omega, z, workspace)
    fill_own_rows(structure, point, order, z, scale, workspace, system)
    add_pairs(structure, point, order, z, scale, workspace, system, with_span)
    fill_derivative_rows(structure, point, order, scale, workspace, jacobian)
    for i in range(n):
        for row, unit in ((i, scale.velocity), (workspace.impulse_index[i], scale.length)):
            if row >= 0:
                residual[row] /= unit
                for k in range(size + 5):
                    jacobian[row, k] /= unit
                for k in range(n):
                    if workspace.impulse_index[k] >= 0:
                        jacobian[row, workspace.impulse_index[k]] *= scale.impulse
    fill_momentum_row(structure, point, order, z, scale, workspace, system)


@jit
def solve_in_place(matrix, columns, rows):
    """Write the solution of a linear system of m equations into ``rows`` (m,).

    ``matrix`` (m, > m) has the system's matrix in its first m columns and the right-hand side in
    column number ``columns``; it is overwritten. The method is elimination with row exchange.
    Returns False, with ``rows`` unchanged, if the matrix is singular.
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
    """Return the largest share (at most 1) of a Newton step (m,) that keeps the events in order.

    Each interval between two events keeps at least `LEAST_INTERVAL_SHARE` of its length.
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
    """Return the shortest interval between consecutive events (rad)."""
    n = order.wall.shape[0]
    least = z[0] + order.turn - z[n - 1]
    for i in range(n - 1):
        least = min(least, z[i + 1] - z[i])
    return least


@jit_allocating
def solve_orbit(structure, point, order, z, scale, system):
    """Move the unknowns ``z`` (m,) to a solution by Newton's method, in place.

    Returns (status, number of steps, largest scaled residual). The status is CONVERGED,
    NOT_CONVERGED, ORDER_LOST or SINGULAR. After CONVERGED, ``system`` has residuals and the whole
    Jacobian at ``z``; otherwise it must not be used.
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
