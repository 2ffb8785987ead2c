"""The paper's Moreau time stepping with rigid contact laws (paper, section 2.4; laws: Eqs. signorini, coulomb, impulse).

One step: q_M = q_n + dt/2 u_n; forces at q_M, u_n and t_M = t_n + dt/2; the contact problem at velocity level, with a wall taking part
if q_M has reached it; q_n+1 = q_M + dt/2 u_n+1. Since the next q_M is q_M + dt u_n+1, the loop keeps the displacements at the middle of
the steps, and one pass over the modes does a step. All contact acts along one line, so the contact problem has a closed form and needs
no iteration. The scheme is of first order: damping acts at u_n and an impact is noticed at the end of its step. Without both it is of second.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core import types
from numba.extending import intrinsic

from impact_env.kernels.budget import note_time
from impact_env.kernels.chirp import RESET, phasor, stretch_at, turns_left
from impact_env.kernels.contact_law import solve_contact
from impact_env.kernels.grid import FREE, close_phase, rows_wanted, step_of_row
from impact_env.kernels.jit import jit, jit_inline, jit_room
from impact_env.kernels.observers import (
    ABSORBER_DAMPING,
    DONE,
    EVALUATIONS,
    FRICTION_LOSS,
    IMPACT_LOSS,
    IMPACTS,
    NOT_FINITE,
    STEPS,
    WORK,
    push_impact,
    push_level,
)
from impact_env.kernels.vector_code import Code

# rows of the table of modes
STRIDE = 64
_Q, _U, _KEEP, _PULL, _PUSH, _TIP, _Q_BEFORE, _U_BEFORE, _ROWS = range(9)


@jit_room
def _new_table(omega, damping_ratio, force_shape, tip_shape, amplitude, state, dt, wide):  # type: ignore[no-untyped-def]
    stride = STRIDE
    if wide is not None:
        stride = wide
    n = omega.shape[0]
    table = np.zeros(_ROWS * stride)
    for j in range(n):
        table[_Q * stride + j] = state[j] + 0.5 * dt * state[n + 1 + j]
        table[_U * stride + j] = state[n + 1 + j]
        table[_KEEP * stride + j] = 1.0 - 2.0 * damping_ratio[j] * omega[j] * dt
        table[_PULL * stride + j] = omega[j] * omega[j] * dt
        table[_PUSH * stride + j] = force_shape[j] * amplitude * dt
        table[_TIP * stride + j] = tip_shape[j]
    return table


def _swing_code(pushed: bool) -> Any:
    def swing(typing_context, table, n, stride, force, push, dt):  # type: ignore[no-untyped-def]
        def build(context, builder, signature, values):  # type: ignore[no-untyped-def]
            code = Code(context, builder, signature.args, values)
            table, n, stride, force, push, dt = code.arguments
            numbers, velocity, displacement = (force, push, dt), code.sum(), code.sum()
            for j in code.slots(n):
                force, push, dt = (code.spread(number) for number in numbers)
                places = [code.plus(code.times(stride, row), j) for row in range(_TIP + 1)]
                q, u, keep, pull, load, tip = (code.vector(table, place) for place in places)
                given = load * force
                if pushed:
                    given = tip.fma(push, given)
                u = keep.fma(u, (-pull).fma(q, given))
                q = dt.fma(u, q)
                code.store(u, table, places[_U])
                code.store(q, table, places[_Q])
                velocity.add_product(tip, u)
                displacement.add_product(tip, q)
            return code.result(signature, context, [total.total() for total in (velocity, displacement)])

        return types.UniTuple(types.float64, 2)(table, types.int64, types.int64, *[types.float64] * 3), build

    return intrinsic(swing)


_swing_freely, _swing_pushed = _swing_code(False), _swing_code(True)


@jit_inline
def _swing(table, n, wide, force, push, dt):  # type: ignore[no-untyped-def]
    """Advance the modes by a step without contact; return the tip's velocity at its end and displacement at the next step's middle."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    if push is None:
        return _swing_freely(table, n, stride, force, 0.0, dt)
    return _swing_pushed(table, n, stride, force, push, dt)


@jit
def _kick(table, n, wide, percussion, dt):  # type: ignore[no-untyped-def]
    """Let the contact's percussion (N s, on the absorber) act back on the modes."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    for j in range(n):
        change = table[_TIP * stride + j] * percussion
        table[_U * stride + j] -= change
        table[_Q * stride + j] -= change * dt


@jit
def _keep_before(table, n, wide, dt):  # type: ignore[no-untyped-def]
    """Note displacements and velocities of the modes at the step's start."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    for j in range(n):
        u = table[_U * stride + j]
        table[_Q_BEFORE * stride + j] = table[_Q * stride + j] - 0.5 * dt * u
        table[_U_BEFORE * stride + j] = u


@jit
def _account_modes(energy, table, n, wide, force):  # type: ignore[no-untyped-def]
    """Add a step's work of the force and dissipation of the modes, both with the mean velocity of the step.

    With that velocity the balance closes up to dt^2/8 times the change of sum omega^2 u^2, which does not grow with time.
    """
    stride = STRIDE
    if wide is not None:
        stride = wide
    for j in range(n):
        old = table[_U_BEFORE * stride + j]
        mean = 0.5 * (old + table[_U * stride + j])
        energy.totals[WORK] += table[_PUSH * stride + j] * force * mean
        energy.modal[j] += (1.0 - table[_KEEP * stride + j]) * old * mean


@jit
def _account_contact(energy, spring, friction, before, after, dt):  # type: ignore[no-untyped-def]
    """Add a step's friction loss and loss in the tuned absorber's damper, with the mean relative velocity of the step."""
    mean = 0.5 * (before + after)
    energy.totals[FRICTION_LOSS] -= friction * mean
    if spring is not None:
        energy.totals[ABSORBER_DAMPING] += spring.damping * before * mean * dt


@jit_inline
def _note_impact(normal, distance, before, after, time, counters, events, energy):  # type: ignore[no-untyped-def]
    """Add an impulse's loss to the energies; it is listed as an impact where the absorber came towards the wall."""
    loss = -0.5 * normal * (before + after)
    if energy is not None:
        energy.totals[IMPACT_LOSS] += loss
    if distance * before > 0.0:
        counters.values[IMPACTS] += 1
        push_impact(events, time, before, normal, loss)


@jit_inline
def _take_sample(row, part, start, end, table, n, wide, dt, level, series):  # type: ignore[no-untyped-def]
    """Take a sample at ``part`` (0 to 1) of a step from tip displacement, absorber displacement and velocity at its two ends."""
    if level is not None:
        push_level(level, start[0] + part * (end[0] - start[0]))
    if series is not None:
        _store_row(series.states[row], table, n, wide, part, dt)
        series.states[row, n] = start[1] + part * (end[1] - start[1])
        series.states[row, 2 * n + 1] = start[2] + part * (end[2] - start[2])


@jit
def _store_row(target, table, n, wide, part, dt):  # type: ignore[no-untyped-def]
    """Write the modes' state at ``part`` (0 to 1) of the step into a row of the series."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    for j in range(n):
        q, u = table[_Q_BEFORE * stride + j], table[_U_BEFORE * stride + j]
        u_after = table[_U * stride + j]
        target[j] = q + part * (table[_Q * stride + j] - 0.5 * dt * u_after - q)
        target[n + 1 + j] = u + part * (u_after - u)


@jit
def _write_state(state, table, n, wide, dt):  # type: ignore[no-untyped-def]
    """Write the modes' state at the end of the last step."""
    stride = STRIDE
    if wide is not None:
        stride = wide
    for j in range(n):
        u = table[_U * stride + j]
        state[j], state[n + 1 + j] = table[_Q * stride + j] - 0.5 * dt * u, u


@jit
def _tip(tip_shape, state, dt):  # type: ignore[no-untyped-def]
    """Return the tip's displacement at the middle of the first step, its velocity at the start, and sum tip_shape^2."""
    n = tip_shape.shape[0]
    displacement, velocity, square = 0.0, 0.0, 0.0
    for j in range(n):
        displacement += tip_shape[j] * (state[j] + 0.5 * dt * state[n + 1 + j])
        velocity += tip_shape[j] * state[n + 1 + j]
        square += tip_shape[j] * tip_shape[j]
    return displacement, velocity, square


@jit
def _scaled(limit, dt):  # type: ignore[no-untyped-def]
    """Return the largest friction percussion of a step, or None."""
    if limit is None:
        return None
    return limit * dt


@jit
def _spring_percussion(spring, distance, gamma, dt):  # type: ignore[no-untyped-def]
    """Return the percussion of the tuned absorber's spring and damper on the tip, or None."""
    if spring is None:
        return None
    return (spring.stiffness * distance + spring.damping * gamma) * dt


@jit_room
def moreau_lane(  # type: ignore[no-untyped-def]
    omega, damping_ratio, force_shape, tip_shape, m_a, walls, friction_limit, spring, times, omegas, phases, amplitude, phase,
    state, dt, sample_dt, counters, level, events, series, energy, wide,
):  # fmt: skip
    """Integrate one lane from time 0 to ``times[-1]`` and return a status code; ``state`` (2 N_m + 2,) is the start and becomes the end.

    ``m_a`` (kg), ``walls``, ``friction_limit`` (N, infinity: stuck), ``spring`` and the observers are None where absent. ``phases`` is the
    integral of the frequency at each of ``times``. ``dt`` (s) is reduced so that it divides the duration. Sample k lies at k ``sample_dt``.
    ``wide`` is None, or N_m rounded up to a multiple of 4 if that is above `STRIDE`.
    """
    n = omega.shape[0]
    steps = max(1, int(np.ceil(times[-1] / dt - 1e-9)))
    dt = times[-1] / steps
    lanes = 4 * ((n + 3) // 4)
    table = _new_table(omega, damping_ratio, force_shape, tip_shape, amplitude, state, dt, wide)
    tip_q, tip_u, compliance = _tip(tip_shape, state, dt)
    q_a, v_a, gamma = state[n], 0.0, 0.0
    if m_a is not None:
        v_a = state[2 * n + 1]
        q_a += 0.5 * dt * v_a
        gamma = v_a - tip_u
        compliance += 1.0 / m_a
    slip = _scaled(friction_limit, dt)
    rows, row = rows_wanted(level, series, times[-1], sample_dt), 0
    row_step = step_of_row(row, rows, sample_dt, dt, steps)
    held, held_since = FREE, 0.0

    i, k, status = 0, 0, DONE
    while i < steps:
        k = stretch_at(times, k, (i + 0.5) * dt)
        stop = i + turns_left(times, k, (i + 0.5) * dt, dt, min(RESET, steps - i))
        force, quadrature, turn_c, turn_s, change_c, change_s = phasor(times, omegas, phases, phase, k, (i + 0.5) * dt, dt)
        while i < stop:
            if energy is not None or (series is not None and i == row_step):
                _keep_before(table, n, wide, dt)
            start = (tip_q - 0.5 * dt * tip_u, q_a - 0.5 * dt * v_a, v_a)
            distance = q_a - tip_q
            push = _spring_percussion(spring, distance, gamma, dt)
            tip_u, tip_q = _swing(table, lanes, wide, force, push, dt)
            if m_a is not None:
                if spring is not None:
                    v_a -= push / m_a
                before = gamma
                gamma, friction, normal, kind = solve_contact(before, v_a - tip_u, distance, walls, slip, compliance)
                percussion = friction + normal
                if percussion != 0.0:
                    _kick(table, lanes, wide, percussion, dt)
                    v_a += percussion / m_a
                    tip_u = v_a - gamma
                    tip_q -= dt * (compliance - 1.0 / m_a) * percussion
                if normal != 0.0:
                    _note_impact(normal, distance, before, gamma, (i + 1) * dt, counters, events, energy)
                if kind != held:
                    close_phase(held, held_since, i * dt, counters, events)
                    held, held_since = kind, i * dt
                if energy is not None:
                    _account_contact(energy, spring, friction, before, gamma, dt)
                q_a += dt * v_a
            if energy is not None:
                _account_modes(energy, table, n, wide, force)
            while i == row_step:
                part = min(max(row * sample_dt / dt - i, 0.0), 1.0)
                end = (tip_q - 0.5 * dt * tip_u, q_a - 0.5 * dt * v_a, v_a)
                _take_sample(row, part, start, end, table, n, wide, dt, level, series)
                row += 1
                row_step = step_of_row(row, rows, sample_dt, dt, steps)
            force, quadrature = force * turn_c - quadrature * turn_s, force * turn_s + quadrature * turn_c
            turn_c, turn_s = turn_c * change_c - turn_s * change_s, turn_c * change_s + turn_s * change_c
            i += 1
        status = note_time(counters, i * dt) if np.isfinite(tip_q + q_a) else NOT_FINITE
        if status != DONE:
            break
    close_phase(held, held_since, i * dt, counters, events)
    _write_state(state, table, n, wide, dt)
    if m_a is not None:
        state[n], state[2 * n + 1] = q_a - 0.5 * dt * v_a, v_a
    counters.values[STEPS] += i
    counters.values[EVALUATIONS] += i
    return status
