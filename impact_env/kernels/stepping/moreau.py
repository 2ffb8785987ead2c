"""The paper's Moreau time stepping with rigid contact laws (paper, section 2.4).

The laws are Eqs. signorini, coulomb and impulse. Laws that a scene lacks have values without effect
(`RigidLaws`), so that one kernel integrates every scene.

In: modes, laws, force, the initial state, a time step, observers. Out: the final state and a status
code (`moreau_lane`).

One step: q_M = q_n + dt/2 u_n; forces at q_M, u_n and t_M = t_n + dt/2; the contact problem at
velocity level, with a wall taking part if q_M has reached it; q_n+1 = q_M + dt/2 u_n+1. Since the
next q_M is q_M + dt u_n+1, the loop keeps the displacements at the middle of the steps, and one
pass over the modes does a step. All contact acts along one line, so the contact problem has a
closed form and needs no iteration. The scheme is of first order, because damping acts at u_n and an
impact takes effect at the end of its step. Without damping and impacts it is of second order.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import NUMBER, jit, jit_allocating, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index, Number
from impact_env.kernels.exact.rigid_contact import NO_WALLS, Walls, compute_restitution
from impact_env.kernels.motion.loads import compute_force, has_sources
from impact_env.kernels.motion.observers import (
    DONE,
    HELD_LOWER,
    HELD_UPPER,
    LEVEL_OFF,
    NOT_FINITE,
    STUCK_INSIDE,
    push_impact,
    push_sample,
    record_time,
)
from impact_env.kernels.stepping.grid import (
    NO_PHASE,
    NO_SPRING,
    PHASOR_STEPS,
    Spring,
    compute_phasor,
    count_steps_left,
    find_sample_range,
    find_sample_step,
    find_section,
    find_series_row,
    interpolate_displacement,
    interpolate_velocity,
    needs_all_modes,
    record_contact_phase,
)

# a relative velocity after an impact below this share of its change in one step counts as rest,
# which ends the scheme's endless chatter on a closed wall
REST_TOL = 1e-6


class RigidLaws(NamedTuple):
    """Mass and contact laws of one absorber."""

    mass: float = 0.0  # kg, 0 without absorber
    walls: Walls = NO_WALLS  # `NO_WALLS` without walls
    limit: float = 0.0  # friction limit (N), 0 without friction, infinity: always stuck
    spring: Spring = NO_SPRING  # `NO_SPRING` without a spring


Array = NDArray[np.float64]
STRIDE = 64  # distance between rows of the table of modes
# rows, with one number for each mode. _Q: displacement at the middle of the step. _U: velocity at
# its start. _KEEP: 1 - 2 D omega dt. _PULL: omega^2 dt. _PUSH: change of velocity by force 1. _TIP:
# mode shape at the absorber. _Q_BEFORE, _U_BEFORE: state at the step's start (`_save_modes`).
_Q, _U, _KEEP, _PULL, _PUSH, _TIP, _Q_BEFORE, _U_BEFORE, _ROWS = range(9)


class MoreauTable(NamedTuple):
    """The modes in the form that the loop over steps uses."""

    cells: Array  # (_ROWS * distance between rows,) the rows _Q to _U_BEFORE
    modes: int  # N_m
    lanes: int  # N_m rounded up to a multiple of 4
    wide_stride: int | None  # distance between rows, None: `STRIDE`
    dt: float  # time step (s)


class StepState(NamedTuple):
    """Displacements of tip and absorber at the middle of a step, velocities at its start."""

    tip_q: float  # displacement of the tip at the middle of the step (m)
    tip_u: float  # velocity of the tip at the start of the step (m/s)
    q: float  # displacement of the absorber at the middle (m)
    v: float  # velocity of the absorber at the start (m/s)
    gamma: float  # relative velocity v - tip_u at the start (m/s)


class ContactPercussion(NamedTuple):
    """Contact percussions on the absorber in a step, and the kind of contact."""

    friction: float  # N s
    normal: float  # of the wall (N s)
    kind: int  # STUCK_INSIDE, HELD_LOWER, HELD_UPPER or NO_PHASE


@jit
def solve_contact(before, free, distance, walls, slip, compliance):
    """Solve one step's contact problem.

    Returns (relative velocity at the step's end in m/s, friction percussion and wall percussion on
    the absorber in N s, kind of contact phase: STUCK_INSIDE, HELD_LOWER, HELD_UPPER or NO_PHASE).

    ``before`` and ``free`` (m/s) are the relative velocities at the step's start, and at its end
    without contact. ``distance`` (m) is the relative displacement at the middle of the step,
    ``slip`` (N s) the largest friction percussion, 0 without friction, and ``compliance`` (1/kg)
    that at the contact.

    First friction alone is tried. If a wall is reached and the absorber would leave it more slowly
    than with -e times ``before``, the wall enforces this velocity, and its percussion is the total
    less that of friction.
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


@jit_allocating
def _new_moreau_table(modes, amplitude, state, dt, wide_stride):
    """Return the `MoreauTable` of `grid.BeamModes` for the ``state`` (2 N_m + 2,) at a run's start.

    ``amplitude`` (N) is that of the force, ``dt`` (s) the time step.
    """
    stride = STRIDE
    if wide_stride is not None:
        stride = wide_stride
    n = modes.omega.shape[0]
    cells = np.zeros(_ROWS * stride)
    for j in range(n):
        cells[_Q * stride + j] = state[j] + 0.5 * dt * state[n + 1 + j]
        cells[_U * stride + j] = state[n + 1 + j]
        cells[_KEEP * stride + j] = 1.0 - 2.0 * modes.damping_ratio[j] * modes.omega[j] * dt
        cells[_PULL * stride + j] = modes.omega[j] * modes.omega[j] * dt
        cells[_PUSH * stride + j] = modes.force_shape[j] * amplitude * dt
        cells[_TIP * stride + j] = modes.tip_shape[j]
    return MoreauTable(cells, n, 4 * ((n + 3) // 4), wide_stride, dt)


def _step_code(pushed: bool) -> Any:
    """Return vector code for a step of all modes, ``pushed`` by a spring or not.

    The code updates the rows _Q and _U of a table, and returns the tip's velocity at the step's end
    and its displacement at the middle of the next step. ``force`` is the force over its amplitude,
    ``push`` the spring's percussion on the tip (N s).
    """

    @vector_code(NUMBER, 2)
    def advance(
        code: Code, table, n: Index, stride: Index, force: Number, push: Number, dt: Number
    ):
        numbers = (force, push, dt)
        velocity = code.sum()
        displacement = code.sum()
        for j in code.vectors(n):
            force, push, dt = (code.spread(number) for number in numbers)
            places = [stride * row + j for row in range(_TIP + 1)]
            q, u, keep, pull, load, tip = (code.vector(table, place) for place in places)
            total = load * force
            if pushed:
                total = tip.fma(push, total)
            u = keep.fma(u, (-pull).fma(q, total))
            q = dt.fma(u, q)
            code.store(u, table, places[_U])
            code.store(q, table, places[_Q])
            velocity.add_product(tip, u)
            displacement.add_product(tip, q)
        return [total.total() for total in (velocity, displacement)]

    return advance


_step_without_spring = _step_code(False)
_step_with_spring = _step_code(True)


@jit_inline
def _find_stride(wide_stride):
    """Return the distance between rows; the constant `STRIDE` spares a check for overlap."""
    if wide_stride is None:
        return STRIDE
    return wide_stride


@jit_inline
def _advance_modes(table, laws, body, distance, force):
    """Advance the modes in ``table`` by a step without contact.

    Returns (tip's velocity at the step's end in m/s, its displacement at the next step's middle in
    m, absorber's velocity at the step's end in m/s). ``body`` is the `StepState` of the step,
    ``distance`` (m) its relative displacement, ``force`` the force over its amplitude. With and
    without a spring are two branches with a loop each, which the compiler does not merge: else each
    step would wait for the spring's arithmetic.
    """
    if laws.spring.stiffness == 0.0:
        tip_u, tip_q = _step_without_spring(
            table.cells, table.lanes, _find_stride(table.wide_stride), force, 0.0, table.dt
        )
        return tip_u, tip_q, body.v
    push = (laws.spring.stiffness * distance + laws.spring.damping * body.gamma) * table.dt
    tip_u, tip_q = _step_with_spring(
        table.cells, table.lanes, _find_stride(table.wide_stride), force, push, table.dt
    )
    return tip_u, tip_q, body.v - push / laws.mass


@jit
def _apply_percussion(table, percussion):
    """Apply the reaction to a percussion on the absorber (N s) to the modes in ``table``."""
    cells = table.cells
    stride = _find_stride(table.wide_stride)
    for j in range(table.lanes):
        change = cells[_TIP * stride + j] * percussion
        cells[_U * stride + j] -= change
        cells[_Q * stride + j] -= change * table.dt


@jit
def _save_modes(table):
    """Write the modes' state at the step's start into the rows _Q_BEFORE and _U_BEFORE."""
    cells = table.cells
    stride = _find_stride(table.wide_stride)
    for j in range(table.modes):
        u = cells[_U * stride + j]
        cells[_Q_BEFORE * stride + j] = cells[_Q * stride + j] - 0.5 * table.dt * u
        cells[_U_BEFORE * stride + j] = u


@jit_inline
def _account_modes(energy, table, force):
    """Add the force's work and the modes' dissipation in a step to ``energy`` (J).

    ``force`` is the force over its amplitude; `_save_modes` was called at the step's start. With
    the mean velocity of the step the energy balance closes up to dt^2/8 times the change of
    sum omega^2 u^2, which does not grow with time.
    """
    cells = table.cells
    stride = _find_stride(table.wide_stride)
    totals = energy.totals[0]
    for j in range(table.modes):
        old = cells[_U_BEFORE * stride + j]
        mean = 0.5 * (old + cells[_U * stride + j])
        totals.work += cells[_PUSH * stride + j] * force * mean
        energy.modal[j] += (1.0 - cells[_KEEP * stride + j]) * old * mean


@jit_inline
def _record_impact(normal, distance, before, after, time, observers):
    """Add the loss by a wall's percussion ``normal`` (N s) to the energies, and record an impact.

    ``distance`` (m) is the relative displacement, ``before`` and ``after`` (m/s) are the relative
    velocities. It is an impact only if the absorber approached the wall: else the wall holds it.
    """
    loss = -0.5 * normal * (before + after)
    energy = observers.energy
    if energy is not None:
        energy.totals[0].impact_loss += loss
    if distance * before > 0.0:
        observers.counters.counts.impacts += 1
        push_impact(observers.events, time, before, normal, loss, 0)


@jit_inline
def _compute_tip_at_start(body, dt):
    """Return (displacement in m, velocity in m/s) of the tip at the start of the step."""
    return body.tip_q - 0.5 * dt * body.tip_u, body.tip_u


@jit_inline
def _compute_absorber_at_start(body, dt):
    """Return (displacement in m, velocity in m/s) of the absorber at the start of the step."""
    return body.q - 0.5 * dt * body.v, body.v


@jit
def _read_mode_before(table, j):
    """Return displacement and velocity of mode ``j`` at the step's start, from `_save_modes`."""
    stride = _find_stride(table.wide_stride)
    return table.cells[_Q_BEFORE * stride + j], table.cells[_U_BEFORE * stride + j]


@jit
def _read_mode_after(table, j):
    """Return displacement and velocity of mode ``j`` at the end of the step."""
    stride = _find_stride(table.wide_stride)
    u = table.cells[_U * stride + j]
    return table.cells[_Q * stride + j] - 0.5 * table.dt * u, u


@jit_inline
def _sample_level(level, clock, part, before, after, table):
    """Add the displacement at the fraction ``part`` (0 to 1) of a step to the level.

    Nothing is done if ``level`` is None or off. ``before`` and ``after`` are the `StepState` of
    this step and of the next.
    """
    if level is None:
        return
    if clock.level == LEVEL_OFF:
        return
    if level.place.shape[0] == 0:
        start = _compute_tip_at_start(before, table.dt)
        end = _compute_tip_at_start(after, table.dt)
        push_sample(level, interpolate_displacement(start, end, part, table.dt))
    else:
        q = 0.0
        for j in range(table.modes):
            start = _read_mode_before(table, j)
            end = _read_mode_after(table, j)
            q += level.place[j] * interpolate_displacement(start, end, part, table.dt)
        push_sample(level, q)


@jit_inline
def _sample_state(series, clock, sample, part, before, after, table):
    """Write the state at the fraction ``part`` (0 to 1) of a step, if the series has its sample.

    ``series`` may be None; ``before`` and ``after`` are as in `_sample_level`.
    """
    if series is None:
        return
    row = find_series_row(clock, series, sample)
    if row < 0:
        return
    n = table.modes
    dt = table.dt
    target = series.states[row]
    for j in range(n):
        start = _read_mode_before(table, j)
        end = _read_mode_after(table, j)
        target[j] = interpolate_displacement(start, end, part, dt)
        target[n + 1 + j] = interpolate_velocity(start, end, part, dt)
    start = _compute_absorber_at_start(before, dt)
    end = _compute_absorber_at_start(after, dt)
    target[n] = interpolate_displacement(start, end, part, dt)
    target[2 * n + 1] = interpolate_velocity(start, end, part, dt)


@jit
def _write_state(m_a, state, table, body):
    """Write the state at the end of the last step into ``state`` (2 N_m + 2,).

    ``body`` is the `StepState` after this step. Without an absorber (``m_a`` 0) the absorber's
    entries are kept.
    """
    cells = table.cells
    n = table.modes
    stride = _find_stride(table.wide_stride)
    for j in range(n):
        u = cells[_U * stride + j]
        state[j], state[n + 1 + j] = cells[_Q * stride + j] - 0.5 * table.dt * u, u
    if m_a > 0.0:
        state[n] = body.q - 0.5 * table.dt * body.v
        state[2 * n + 1] = body.v


@jit
def _init_step_state(m_a, tip_shape, state, dt):
    """Return the `StepState` of the first step for an initial state, and the compliance.

    The compliance at the contact (1/kg) is the relative acceleration of absorber and tip under a
    unit force between them.
    """
    n = tip_shape.shape[0]
    displacement = 0.0
    velocity = 0.0
    square = 0.0
    for j in range(n):
        displacement += tip_shape[j] * (state[j] + 0.5 * dt * state[n + 1 + j])
        velocity += tip_shape[j] * state[n + 1 + j]
        square += tip_shape[j] * tip_shape[j]
    if m_a == 0.0:
        return StepState(displacement, velocity, state[n], 0.0, 0.0), square
    v = state[2 * n + 1]
    return StepState(
        displacement, velocity, state[n] + 0.5 * dt * v, v, v - velocity
    ), square + 1.0 / m_a


@jit_inline
def _apply_contact(m_a, bounds, table, body, distance):
    """Solve the contact problem of a step, and apply its percussions to the modes in ``table``.

    ``bounds`` is (walls, largest friction percussion in N s, compliance in 1/kg). ``body`` has the
    motion after the step without contact, but the relative velocity ``gamma`` before it;
    ``distance`` (m) is the relative displacement. Returns the `StepState` of the next step, and the
    `ContactPercussion`.
    """
    walls, slip, compliance = bounds
    v = body.v
    tip_u = body.tip_u
    tip_q = body.tip_q
    gamma, friction, normal, kind = solve_contact(
        body.gamma, v - tip_u, distance, walls, slip, compliance
    )
    percussion = friction + normal
    if percussion != 0.0:
        _apply_percussion(table, percussion)
        v += percussion / m_a
        tip_u = v - gamma
        tip_q -= table.dt * (compliance - 1.0 / m_a) * percussion
    return StepState(tip_q, tip_u, body.q + table.dt * v, v, gamma), ContactPercussion(
        friction, normal, kind
    )


@jit_inline
def _advance_step(i, table, laws, bounds, body, force, observers):
    """Perform step ``i``, record its impact, and add its work and losses to the energies.

    ``body`` is the `StepState` of this step, ``force`` the force over its amplitude, ``bounds`` as
    in `_apply_contact`. Returns the `StepState` of the next step, and the kind of contact phase in
    this one.
    """
    dt = table.dt
    energy = observers.energy
    if laws.mass == 0.0:
        tip_u, tip_q = _step_without_spring(
            table.cells, table.lanes, _find_stride(table.wide_stride), force, 0.0, dt
        )
        if energy is not None:
            _account_modes(energy, table, force)
        return StepState(tip_q, tip_u, body.q, 0.0, 0.0), NO_PHASE
    distance = body.q - body.tip_q
    tip_u, tip_q, v = _advance_modes(table, laws, body, distance, force)
    after, hit = _apply_contact(
        laws.mass, bounds, table, StepState(tip_q, tip_u, body.q, v, body.gamma), distance
    )
    if hit.normal != 0.0:
        _record_impact(hit.normal, distance, body.gamma, after.gamma, (i + 1) * dt, observers)
    if energy is not None:
        # the mean relative velocity of the step closes the energy balance
        mean = 0.5 * (body.gamma + after.gamma)
        energy.totals[0].friction_loss -= hit.friction * mean
        energy.totals[0].absorber_damping += laws.spring.damping * body.gamma * mean * dt
        _account_modes(energy, table, force)
    return after, hit.kind


@jit_allocating
def moreau_lane(modes, laws, force, state, step, observers):
    """Integrate one run from time 0 to the drive's end and return a status code.

    The code is DONE, NOT_FINITE, or STOPPED by another thread. ``modes``: `grid.BeamModes`,
    ``laws``: `RigidLaws`, ``force``: `grid.DriveForce`, ``step``: `grid.TimeStep`. ``state``
    (2 N_m + 2,) is the initial state and becomes the final one; its order is modal displacements,
    absorber displacement, modal velocities, absorber velocity. The ``observers`` are filled. Sample
    k lies at time k ``observers.clock.interval``. ``step.wide_stride`` is None, or N_m rounded up
    to a multiple of 4 if that is above `STRIDE`.
    """
    times = force.times
    sample_dt = observers.clock.interval
    counters = observers.counters
    steps = max(1, int(np.ceil(times[-1] / step.dt - 1e-9)))
    dt = times[-1] / steps
    table = _new_moreau_table(modes, force.amplitude, state, dt, step.wide_stride)
    body, compliance = _init_step_state(laws.mass, modes.tip_shape, state, dt)
    bounds = (laws.walls, laws.limit * dt, compliance)
    row, rows = find_sample_range(observers.clock, observers.level, observers.series, times[-1])
    modal = needs_all_modes(observers.level, observers.series)
    row_step = find_sample_step(row, rows, sample_dt, dt, steps)
    loads = np.empty(PHASOR_STEPS)
    loaded = has_sources(force.load)
    held = NO_PHASE
    held_since = 0.0
    i = 0
    k = 0
    status = DONE
    while i < steps:
        k = find_section(times, k, (i + 0.5) * dt)
        start = i
        stop = i + count_steps_left(times, k, (i + 0.5) * dt, dt, min(PHASOR_STEPS, steps - i))
        if loaded:
            for n in range(stop - start):
                loads[n] = compute_force(force.load, k, (start + n + 0.5) * dt)
        c, s, turn_c, turn_s, change_c, change_s = compute_phasor(force, k, (i + 0.5) * dt, dt)
        while i < stop:
            if observers.energy is not None or (modal and i == row_step):
                _save_modes(table)
            before = body
            force_value = loads[i - start] if loaded else c
            body, kind = _advance_step(i, table, laws, bounds, body, force_value, observers)
            if kind != held:
                record_contact_phase(held, held_since, i * dt, counters, observers.events)
                held = kind
                held_since = i * dt
            while i == row_step:
                part = min(max(row * sample_dt / dt - i, 0.0), 1.0)
                _sample_level(observers.level, observers.clock, part, before, body, table)
                _sample_state(observers.series, observers.clock, row, part, before, body, table)
                row += 1
                row_step = find_sample_step(row, rows, sample_dt, dt, steps)
            c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
            turn_c, turn_s = (
                turn_c * change_c - turn_s * change_s,
                turn_c * change_s + turn_s * change_c,
            )
            i += 1
        status = record_time(counters, i * dt) if np.isfinite(body.tip_q + body.q) else NOT_FINITE
        if status != DONE:
            break
    record_contact_phase(held, held_since, i * dt, counters, observers.events)
    _write_state(laws.mass, state, table, body)
    counters.counts.steps += i
    counters.counts.evaluations += i
    return status
