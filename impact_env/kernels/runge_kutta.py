"""Classical Runge-Kutta stepping for linear scenes and for the appendix' compliant contact (paper, Eqs. elSignorini, elCoulomb).

All contact acts along one line, so a scene is a row of independent oscillators (the absorber is one more, of frequency zero) with one
scalar feedback: a force p(y) on the absorber that depends on an observation y, a weighted sum of displacements and velocities. In
each of the four stages y, and so p, follows from the state at the step's start, the excitation, and the p of the stages before, all
linearly. The weights come from the textbook step applied to unit states and unit inputs, once. Then one pass over the modes does a
whole step. This is the classical method with its sums in another order, not an approximation of it.

The slider of elastic friction stays where it is within a step and follows at its end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core import types
from numba.extending import intrinsic

from impact_env.kernels.budget import note_time
from impact_env.kernels.chirp import fill_phases
from impact_env.kernels.feedback import (
    Q_BEFORE,
    QF1,
    QFM,
    QP1,
    QP2,
    QP3,
    QQ,
    QU,
    STRIDE,
    TIP,
    U_BEFORE,
    UF1,
    UF4,
    UFM,
    UP1,
    UP2,
    UP3,
    UP4,
    UQ,
    UU,
    Q,
    U,
    Y,
    feedback,
    move_slider,
    new_table,
    slider_force,
    stop_force,
    textbook_step,
)
from impact_env.kernels.grid import close_phase, rows_wanted, step_of_row
from impact_env.kernels.jit import jit, jit_inline, jit_room
from impact_env.kernels.observers import (
    ABSORBER_DAMPING,
    DONE,
    EVALUATIONS,
    FRICTION_LOSS,
    HELD_LOWER,
    HELD_UPPER,
    IMPACTS,
    NOT_FINITE,
    STEPS,
    STUCK_INSIDE,
    WORK,
    push_impact,
    push_level,
    push_phase,
)
from impact_env.kernels.vector_code import Code, Number

_BLOCK = 16  # steps between two checks for values that are not finite


def _swing_code(pushed: bool, watched: bool) -> Any:
    def swing(typing_context, table, lanes, stride, f1, fm, f4, p1, p2, p3, p4):  # type: ignore[no-untyped-def]
        def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
            code = Code(context, builder, signature.args, values)
            table, lanes, stride, *numbers = code.arguments
            sums = [code.sum() for _ in range(4)]

            def of(row: int, j: Any) -> Number:
                return code.vector(table, code.plus(code.times(stride, row), j))

            for j in code.slots(lanes):
                f1, fm, f4, p1, p2, p3, p4 = (code.spread(number) for number in numbers)
                q, u = of(Q, j), of(U, j)
                in_q = [(QU, u), (QF1, f1), (QFM, fm)] + ([(QP1, p1), (QP2, p2), (QP3, p3)] if pushed else [])
                in_u = [(UU, u), (UF1, f1), (UFM, fm), (UF4, f4)] + ([(UP1, p1), (UP2, p2), (UP3, p3), (UP4, p4)] if pushed else [])
                q_next, u_next = of(QQ, j) * q, of(UQ, j) * q
                for row, number in in_q:
                    q_next = of(row, j).fma(number, q_next)
                for row, number in in_u:
                    u_next = of(row, j).fma(number, u_next)
                code.store(q_next, table, code.plus(code.times(stride, Q), j))
                code.store(u_next, table, code.plus(code.times(stride, U), j))
                if watched:
                    for k, total in enumerate(sums):
                        total.add_product(of(Y + 2 * k, j), q_next)
                        total.add_product(of(Y + 2 * k + 1, j), u_next)
            return code.result(signature, context, [total.total() for total in sums])

        return types.UniTuple(types.float64, 4)(table, types.int64, types.int64, *[types.float64] * 7), build

    return intrinsic(swing)


_freely, _freely_watched, _pushed, _pushed_watched = (_swing_code(pushed, watched) for pushed in (False, True) for watched in (False, True))


@jit_inline
def _swing(table, lanes, wide, forces, at, push, watched):  # type: ignore[no-untyped-def]
    """Advance all oscillators by a step; return the next step's four observations as far as they follow from the state."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    f1, fm, f4 = forces[at], forces[at + 1], forces[at + 2]
    if push is None:
        if watched is None:
            return _freely(table, lanes, stride, f1, fm, f4, 0.0, 0.0, 0.0, 0.0)
        return _freely_watched(table, lanes, stride, f1, fm, f4, 0.0, 0.0, 0.0, 0.0)
    if watched is None:
        return _pushed(table, lanes, stride, f1, fm, f4, push[0], push[1], push[2], push[3])
    return _pushed_watched(table, lanes, stride, f1, fm, f4, push[0], push[1], push[2], push[3])


@jit_inline
def _swing_watched(table, lanes, wide, forces, at, push):  # type: ignore[no-untyped-def]
    """Advance as `_swing` does, with the four feedbacks; most steps are without any."""
    if push[0] == 0.0 and push[1] == 0.0 and push[2] == 0.0 and push[3] == 0.0:
        return _swing(table, lanes, wide, forces, at, None, 0.0)
    return _swing(table, lanes, wide, forces, at, push, 0.0)


@jit_room
def _observe(table, lanes, wide):  # type: ignore[no-untyped-def]
    """Return the four observations of the first step as far as they follow from the state."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    y = np.zeros(4)
    for stage in range(4):
        for j in range(lanes):
            y[stage] += table[(Y + 2 * stage) * stride + j] * table[Q * stride + j]
            y[stage] += table[(Y + 2 * stage + 1) * stride + j] * table[U * stride + j]
    return y[0], y[1], y[2], y[3]


@jit
def _stages(y, mix, forces, at, rest, stops, slider, spring, added_mass, joined_mass):  # type: ignore[no-untyped-def]
    """Return the observations and the feedbacks in the four stages."""
    f1, fm, f4 = forces[at], forces[at + 1], forces[at + 2]
    y1 = y[0] + mix[0, 0] * f1
    p1 = feedback(y1, rest, stops, slider, spring, added_mass, joined_mass)
    y2 = y[1] + mix[1, 0] * f1 + mix[1, 1] * fm + mix[1, 3] * p1
    p2 = feedback(y2, rest, stops, slider, spring, added_mass, joined_mass)
    y3 = y[2] + mix[2, 0] * f1 + mix[2, 1] * fm + mix[2, 3] * p1 + mix[2, 4] * p2
    p3 = feedback(y3, rest, stops, slider, spring, added_mass, joined_mass)
    y4 = y[3] + mix[3, 0] * f1 + mix[3, 1] * fm + mix[3, 2] * f4 + mix[3, 3] * p1 + mix[3, 4] * p2 + mix[3, 5] * p3
    p4 = feedback(y4, rest, stops, slider, spring, added_mass, joined_mass)
    return (y1, y2, y3, y4), (p1, p2, p3, p4)


@jit_room
def _account(energy, table, wide, omega, damping_ratio, force_shape, amplitude, m_a, spring, slider, rest, forces, at, y, p, h):  # type: ignore[no-untyped-def]
    """Add a step's work and losses: the powers in the four stages with the weights of the method."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    n = omega.shape[0]
    weights = (h / 6.0, h / 3.0, h / 3.0, h / 6.0)
    gamma = np.zeros(4)
    for j in range(n + 1):
        w2, c, push = 0.0, 0.0, 0.0
        if j < n:
            w2, c, push = omega[j] * omega[j], 2.0 * damping_ratio[j] * omega[j], force_shape[j] * amplitude
        tip = table[TIP * stride + j]
        f = (push * forces[at], push * forces[at + 1], push * forces[at + 1], push * forces[at + 2])
        w = (f[0] - tip * p[0], f[1] - tip * p[1], f[2] - tip * p[2], f[3] - tip * p[3])
        stages = textbook_step(w2, c, h, table[Q * stride + j], table[U * stride + j], w[0], w[1], w[2], w[3])
        us = (stages[1], stages[3], stages[5], stages[7])
        for s in range(4):
            gamma[s] -= tip * us[s]
            energy.totals[WORK] += weights[s] * f[s] * us[s]
            if j < n:
                energy.modal[j] += weights[s] * c * us[s] * us[s]
    for s in range(4):
        if slider is not None:
            energy.totals[FRICTION_LOSS] -= weights[s] * slider_force(y[s], rest, slider) * gamma[s]
        if spring is not None:
            energy.totals[ABSORBER_DAMPING] += weights[s] * spring.damping * gamma[s] * gamma[s]


@jit
def _crossing(d0, g0, d1, g1, level, h):  # type: ignore[no-untyped-def]
    """Return (time into the step, relative velocity) where the cubic through both ends' values and slopes passes ``level``."""
    low, high = 0.0, 1.0
    rising = d1 > d0
    for _ in range(52):
        s = 0.5 * (low + high)
        d = (1 - s) * (1 - s) * ((1 + 2 * s) * d0 + s * h * g0) + s * s * ((3 - 2 * s) * d1 - (1 - s) * h * g1)
        if (d < level) == rising:
            low = s
        else:
            high = s
    return low * h, 6 * low * (1 - low) * (d1 - d0) / h + (1 - low) * (1 - 3 * low) * g0 + low * (3 * low - 2) * g1


@jit
def _side(y, gap):  # type: ignore[no-untyped-def]
    return 1.0 if y > gap else (-1.0 if y < -gap else 0.0)


@jit
def _track_stops(touch, stops, d0, g0, d1, g1, y, t, h, counters, events):  # type: ignore[no-untyped-def]
    """Note where a wall's spring is reached and left; ``touch`` holds side, time, relative velocity at the start of the contact, impulse."""
    touch[3] += h / 6.0 * (stop_force(y[0], stops) + 2.0 * stop_force(y[1], stops) + 2.0 * stop_force(y[2], stops) + stop_force(y[3], stops))
    side = _side(d1, stops.gap)
    if side == touch[0]:
        return
    if touch[0] != 0.0:
        tau, _ = _crossing(d0, g0, d1, g1, touch[0] * stops.gap, h)
        _end_touch(touch, t + tau, counters, events)
    touch[0] = side
    if side != 0.0:
        tau, gamma = _crossing(d0, g0, d1, g1, side * stops.gap, h)
        touch[1], touch[2] = t + tau, gamma


@jit
def _end_touch(touch, time, counters, events):  # type: ignore[no-untyped-def]
    """Note a contact as an impact without loss and as a phase."""
    counters.values[IMPACTS] += 1
    push_impact(events, touch[1], touch[2], touch[3], 0.0)
    push_phase(events, touch[1], time, HELD_UPPER if touch[0] > 0.0 else HELD_LOWER)
    touch[3] = 0.0


@jit
def _keep_before(table, lanes, wide):  # type: ignore[no-untyped-def]
    """Note the state at the step's start."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    for j in range(lanes):
        table[Q_BEFORE * stride + j] = table[Q * stride + j]
        table[U_BEFORE * stride + j] = table[U * stride + j]


@jit
def _tip(table, n, wide):  # type: ignore[no-untyped-def]
    """Return the tip's displacement."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    tip = 0.0
    for j in range(n):
        tip += table[TIP * stride + j] * table[Q * stride + j]
    return tip


@jit
def _store(target, table, n, wide, part, m_a, added_mass, offset):  # type: ignore[no-untyped-def]
    """Write the state at ``part`` (0 to 1) of the step; ``offset`` is where a stuck absorber sits in the cavity."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    tip_q, tip_u = 0.0, 0.0
    for j in range(n + 1):
        q, u = table[Q_BEFORE * stride + j], table[U_BEFORE * stride + j]
        q, u = q + part * (table[Q * stride + j] - q), u + part * (table[U * stride + j] - u)
        if j < n:
            target[j], target[n + 1 + j] = q, u
            tip_q += table[TIP * stride + j] * q
            tip_u += table[TIP * stride + j] * u
        elif m_a is not None:
            target[n], target[2 * n + 1] = q / np.sqrt(m_a), u / np.sqrt(m_a)
    if added_mass is not None:
        target[n], target[2 * n + 1] = tip_q + offset, tip_u


@jit_inline
def _take_sample(row, part, tip_start, table, n, wide, m_a, added_mass, offset, state, level, series):  # type: ignore[no-untyped-def]
    """Take a sample at ``part`` (0 to 1) of a step; where there is no absorber its place in the series keeps what ``state`` has there."""
    if level is not None:
        push_level(level, tip_start + part * (_tip(table, n, wide) - tip_start))
    if series is not None:
        series.states[row, n], series.states[row, 2 * n + 1] = state[n], state[2 * n + 1]
        _store(series.states[row], table, n, wide, part, m_a, added_mass, offset)


@jit_room
def runge_kutta_lane(  # type: ignore[no-untyped-def]
    omega, damping_ratio, force_shape, tip_shape, m_a, added_mass, stops, slider, spring, times, omegas, phases, amplitude, phase,
    state, dt, sample_dt, counters, level, events, series, energy, wide,
):  # fmt: skip
    """Integrate one lane from time 0 to ``times[-1]`` and return a status code; ``state`` (2 N_m + 2,) is the start and becomes the end.

    An absorber has either ``m_a`` (kg) with ``stops``, ``slider`` or ``spring``, or, stuck, ``added_mass`` (kg); what is absent is None, as are
    observers. ``phases`` is the integral of the frequency at each of ``times``. ``dt`` (s) is reduced so that it divides the duration.
    Sample k lies at k ``sample_dt``. ``wide`` is None, or N_m + 1 rounded up to a multiple of 4 if that is above `STRIDE`. The friction loss
    contains what the slider's spring holds at the end. A contact with a wall's spring is noted as an impact at the time it begins.
    """
    n = omega.shape[0]
    steps = max(1, int(np.ceil(times[-1] / dt - 1e-9)))
    dt = times[-1] / steps
    table, mix = new_table(omega, damping_ratio, force_shape, tip_shape, amplitude, m_a, added_mass, spring, state, dt, wide)
    lanes = 4 * ((n + 4) // 4)
    offset = state[n] - _tip(table, n, wide)
    joined_mass = 0.0
    if added_mass is not None:
        joined_mass = added_mass / (1.0 + added_mass * np.sum(tip_shape * tip_shape))
    y = _observe(table, lanes, wide)
    rest, touch = y[0], np.zeros(4)
    if stops is not None:
        touch[0], touch[2] = _side(y[0], stops.gap), 2.0 * (y[1] - y[0]) / dt
    rows, row = rows_wanted(level, series, times[-1], sample_dt), 0
    row_step = step_of_row(row, rows, sample_dt, dt, steps)
    forces = np.empty(2 * _BLOCK + 1)

    i, k, status, tip_start = 0, 0, DONE, 0.0
    while i < steps:
        start, stop = i, min(i + _BLOCK, steps)
        k = fill_phases(forces, 2 * (stop - start) + 1, times, omegas, phases, phase, k, i * dt, 0.5 * dt)
        while i < stop:
            at = 2 * (i - start)
            if i == row_step:
                _keep_before(table, lanes, wide)
                tip_start = _tip(table, n, wide)
            if m_a is None and added_mass is None:
                if energy is not None:
                    zero = (0.0, 0.0, 0.0, 0.0)
                    _account(energy, table, wide, omega, damping_ratio, force_shape, amplitude, m_a, spring, slider, rest, forces, at, zero, zero, dt)
                _swing(table, lanes, wide, forces, at, None, None)
            else:
                seen, push = _stages(y, mix, forces, at, rest, stops, slider, spring, added_mass, joined_mass)
                if energy is not None:
                    _account(energy, table, wide, omega, damping_ratio, force_shape, amplitude, m_a, spring, slider, rest, forces, at, seen, push, dt)
                before, y = y, _swing_watched(table, lanes, wide, forces, at, push)
                if stops is not None:
                    if touch[0] != 0.0 or abs(y[0]) > stops.gap:
                        g0, g1 = 2.0 * (before[1] - before[0]) / dt, 2.0 * (y[1] - y[0]) / dt
                        _track_stops(touch, stops, before[0], g0, y[0], g1, seen, i * dt, dt, counters, events)
                rest = move_slider(y[0], rest, slider)
            while i == row_step:
                part = min(max(row * sample_dt / dt - i, 0.0), 1.0)
                _take_sample(row, part, tip_start, table, n, wide, m_a, added_mass, offset, state, level, series)
                row += 1
                row_step = step_of_row(row, rows, sample_dt, dt, steps)
            i += 1
        status = note_time(counters, i * dt) if np.isfinite(_tip(table, n, wide)) else NOT_FINITE
        if status != DONE:
            break
    if touch[0] != 0.0:
        _end_touch(touch, i * dt, counters, events)
    if added_mass is not None:
        close_phase(STUCK_INSIDE, 0.0, i * dt, counters, events)
    _keep_before(table, lanes, wide)
    _store(state, table, n, wide, 0.0, m_a, added_mass, offset)
    counters.values[STEPS] += i
    counters.values[EVALUATIONS] += 4 * i
    return status
