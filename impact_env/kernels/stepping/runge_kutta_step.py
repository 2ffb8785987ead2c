"""One step of the classical Runge-Kutta method, and its energies.

The equations are those of independent oscillators with one scalar feedback.

In each of the four stages the observation y, and so the force p(y), follows from the state at the
step's start, the excitation, and the p of the stages before, all linearly. The weights are in the
table of feedback.py. Then one pass over the modes does a whole step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from impact_env.kernels.compiling.jit import NUMBER, jit, jit_allocating, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index, Number
from impact_env.kernels.stepping.feedback import (
    QF1,
    QFM,
    QP1,
    QP2,
    QP3,
    QQ,
    QU,
    TIP,
    UF1,
    UF4,
    UFM,
    UP1,
    UP2,
    UP3,
    UP4,
    UQ,
    UU,
    ActiveLaws,
    Q,
    U,
    Y,
    compute_feedback,
    compute_slider_force,
    runge_kutta_step,
    stride_of,
)


def _step_code(pushed: bool, sampled: bool) -> Any:
    @vector_code(NUMBER, 4)
    def swing(
        code: Code,
        table,
        lanes: Index,
        stride: Index,
        f1: Number,
        fm: Number,
        f4: Number,
        p1: Number,
        p2: Number,
        p3: Number,
        p4: Number,
    ):
        numbers = (f1, fm, f4, p1, p2, p3, p4)
        sums = [code.sum() for _ in range(4)]

        def of(row: int, j: Any) -> Number:
            return code.vector(table, stride * row + j)

        for j in code.vectors(lanes):
            f1, fm, f4, p1, p2, p3, p4 = (code.spread(number) for number in numbers)
            q = of(Q, j)
            u = of(U, j)
            in_q = [(QU, u), (QF1, f1), (QFM, fm)] + (
                [(QP1, p1), (QP2, p2), (QP3, p3)] if pushed else []
            )
            in_u = [(UU, u), (UF1, f1), (UFM, fm), (UF4, f4)] + (
                [(UP1, p1), (UP2, p2), (UP3, p3), (UP4, p4)] if pushed else []
            )
            q_next = of(QQ, j) * q
            u_next = of(UQ, j) * q
            for row, number in in_q:
                q_next = of(row, j).fma(number, q_next)
            for row, number in in_u:
                u_next = of(row, j).fma(number, u_next)
            code.store(q_next, table, stride * Q + j)
            code.store(u_next, table, stride * U + j)
            if sampled:
                for k, total in enumerate(sums):
                    total.add_product(of(Y + 2 * k, j), q_next)
                    total.add_product(of(Y + 2 * k + 1, j), u_next)
        return [total.total() for total in sums]

    return swing


_step_forced, _step_forced_observed, _step_fed_back, _step_fed_back_observed = (
    _step_code(pushed, sampled) for pushed in (False, True) for sampled in (False, True)
)


@jit_inline
def advance_oscillators(table, forces, at, push, sampled):
    """Advance all oscillators by a step.

    Returns those parts of the next step's four observations that follow from the state.
    """
    cells = table.cells
    lanes = table.lanes
    stride = stride_of(table.wide_stride)
    f1 = forces[at]
    fm = forces[at + 1]
    f4 = forces[at + 2]
    if push is None:
        if sampled is None:
            return _step_forced(cells, lanes, stride, f1, fm, f4, 0.0, 0.0, 0.0, 0.0)
        return _step_forced_observed(cells, lanes, stride, f1, fm, f4, 0.0, 0.0, 0.0, 0.0)
    if sampled is None:
        return _step_fed_back(cells, lanes, stride, f1, fm, f4, push[0], push[1], push[2], push[3])
    return _step_fed_back_observed(
        cells, lanes, stride, f1, fm, f4, push[0], push[1], push[2], push[3]
    )


@jit_inline
def advance_observed(table, forces, at, push):
    """Advance as `advance_oscillators` does, with the four feedbacks.

    Most steps have no feedback.
    """
    if push[0] == 0.0 and push[1] == 0.0 and push[2] == 0.0 and push[3] == 0.0:
        return advance_oscillators(table, forces, at, None, 0.0)
    return advance_oscillators(table, forces, at, push, 0.0)


@jit_allocating
def _observe_rows(table, rows):
    """Return the eight rows of an observation of the state, in the four stages of the next step."""
    cells = table.cells
    stride = stride_of(table.wide_stride)
    y = np.zeros(4)
    for stage in range(4):
        for j in range(table.lanes):
            y[stage] += rows[2 * stage * stride + j] * cells[Q * stride + j]
            y[stage] += rows[(2 * stage + 1) * stride + j] * cells[U * stride + j]
    return y[0], y[1], y[2], y[3]


@jit_allocating
def compute_observations(table):
    """Return the four observations of the first step as far as they follow from the state."""
    return _observe_rows(table, table.cells[Y * stride_of(table.wide_stride) :])


@jit_allocating
def compute_relative_velocities(table):
    """Return the relative velocities in the next step's four stages.

    Only their parts that follow from the state are returned. They are 0 if no law depends on them.
    """
    if table.speeds.cells.shape[0] == 0:
        return 0.0, 0.0, 0.0, 0.0
    return _observe_rows(table, table.speeds.cells)


@jit_inline
def _stage_velocity(cubic, speeds, v, k, f, p):
    """Return the relative velocity in stage ``k``.

    ``p`` are the feedbacks of the stages before. The result is 0 if no law depends on the relative
    velocity.
    """
    if cubic is None:
        return 0.0
    mix = speeds.mix
    forced = mix[k, 0] * f[0] + mix[k, 1] * f[1] + mix[k, 2] * f[2]
    return v[k] + forced + mix[k, 3] * p[0] + mix[k, 4] * p[1] + mix[k, 5] * p[2]


@jit_inline
def _compute_stages_under(absorber, table, forces, at, laws):
    """Return the observations and the feedbacks in the four stages under `feedback.ActiveLaws`."""
    y = absorber.y
    rest = absorber.rest
    v = absorber.v
    mix = table.mix
    speeds = table.speeds
    f = f1, fm, f4 = forces[at], forces[at + 1], forces[at + 2]
    y1 = y[0] + mix[0, 0] * f1
    v1 = _stage_velocity(laws.cubic, speeds, v, 0, f, (0.0, 0.0, 0.0))
    p1 = compute_feedback(y1, v1, rest, laws)
    y2 = y[1] + mix[1, 0] * f1 + mix[1, 1] * fm + mix[1, 3] * p1
    v2 = _stage_velocity(laws.cubic, speeds, v, 1, f, (p1, 0.0, 0.0))
    p2 = compute_feedback(y2, v2, rest, laws)
    y3 = y[2] + mix[2, 0] * f1 + mix[2, 1] * fm + mix[2, 3] * p1 + mix[2, 4] * p2
    v3 = _stage_velocity(laws.cubic, speeds, v, 2, f, (p1, p2, 0.0))
    p3 = compute_feedback(y3, v3, rest, laws)
    y4 = (
        y[3]
        + mix[3, 0] * f1
        + mix[3, 1] * fm
        + mix[3, 2] * f4
        + mix[3, 3] * p1
        + mix[3, 4] * p2
        + mix[3, 5] * p3
    )
    v4 = _stage_velocity(laws.cubic, speeds, v, 3, f, (p1, p2, p3))
    p4 = compute_feedback(y4, v4, rest, laws)
    return (y1, y2, y3, y4), (p1, p2, p3, p4)


@jit_inline
def compute_stages(absorber, table, forces, at, laws, joined_mass):
    """Return the observations and the feedbacks in the four stages.

    ``absorber`` is a `runge_kutta.AbsorberStages`.

    ``joined_mass``: that of `feedback.ActiveLaws`, 0 unless the absorber is stuck.
    """
    if laws.cubic.cubic_stiffness > 0.0:
        of_cubic = ActiveLaws(None, None, None, None, laws.cubic)
        return _compute_stages_under(absorber, table, forces, at, of_cubic)
    if laws.spring.stiffness > 0.0:
        of_spring = ActiveLaws(None, None, laws.spring, None, None)
        return _compute_stages_under(absorber, table, forces, at, of_spring)
    if joined_mass > 0.0:
        of_mass = ActiveLaws(None, None, None, joined_mass, None)
        return _compute_stages_under(absorber, table, forces, at, of_mass)
    if laws.slider.limit > 0.0:
        of_slider = ActiveLaws(laws.stops, laws.slider, None, None, None)
        return _compute_stages_under(absorber, table, forces, at, of_slider)
    of_stops = ActiveLaws(laws.stops, None, None, None, None)
    return _compute_stages_under(absorber, table, forces, at, of_stops)


@jit
def _account_laws(energy, laws, y, rest, gamma, weight):
    """Add a stage's losses in slider and absorber's damper, at a relative velocity."""
    energy.totals[0].friction_loss -= weight * compute_slider_force(y, rest, laws.slider) * gamma
    energy.totals[0].absorber_damping += weight * laws.spring.damping * gamma * gamma
    energy.totals[0].absorber_damping += weight * laws.cubic.damping * gamma * gamma


@jit_allocating
def account_step(energy, modes, amplitude, laws, table, rest, stages):
    """Add a step's work and losses: the powers in the four stages with the weights of the method.

    ``compute_stages``: the excitation at start, middle and end, the observations, and the
    feedbacks.
    """
    if energy is None:
        return
    f, y, p = stages
    cells = table.cells
    n = table.modes
    h = table.h
    stride = stride_of(table.wide_stride)
    totals = energy.totals[0]
    weights = (h / 6.0, h / 3.0, h / 3.0, h / 6.0)
    gamma = np.zeros(4)
    for j in range(n + 1):
        w2 = 0.0
        c = 0.0
        push = 0.0
        if j < n:
            w2 = modes.omega[j] * modes.omega[j]
            c = 2.0 * modes.damping_ratio[j] * modes.omega[j]
            push = modes.force_shape[j] * amplitude
        tip = cells[TIP * stride + j]
        e = (push * f[0], push * f[1], push * f[1], push * f[2])
        w = (e[0] - tip * p[0], e[1] - tip * p[1], e[2] - tip * p[2], e[3] - tip * p[3])
        steps = runge_kutta_step(w2, c, h, cells[Q * stride + j], cells[U * stride + j], w)
        us = (steps[1], steps[3], steps[5], steps[7])
        for s in range(4):
            gamma[s] -= tip * us[s]
            totals.work += weights[s] * e[s] * us[s]
            if j < n:
                energy.modal[j] += weights[s] * c * us[s] * us[s]
    for s in range(4):
        _account_laws(energy, laws, y[s], rest, gamma[s], weights[s])
