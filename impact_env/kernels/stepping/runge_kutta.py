"""Classical Runge-Kutta stepping for linear scenes and for the appendix' compliant contact (paper, Eqs. elSignorini, elCoulomb).

All contact acts along one line, so a scene is a row of independent oscillators (the absorber is one more, of frequency zero) with one
scalar feedback: a force p(y) on the absorber that depends on an observation y, a weighted sum of displacements and velocities. In
each of the four stages y, and so p, follows from the state at the step's start, the excitation, and the p of the stages before, all
linearly. The weights come from the textbook step applied to unit states and unit inputs, once. Then one pass over the modes does a
whole step. This is the classical method with its sums in another order, not an approximation of it.

The slider of elastic friction stays where it is within a step and follows at its end.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room
from impact_env.kernels.compiling.records import NUMBER, record
from impact_env.kernels.exact.budget import note_time
from impact_env.kernels.motion.level import push_level
from impact_env.kernels.motion.observers import (
    DONE,
    HELD_LOWER,
    HELD_UPPER,
    NOT_FINITE,
    STUCK_INSIDE,
    push_impact,
    push_phase,
)
from impact_env.kernels.stepping.chirp import fill_phases
from impact_env.kernels.stepping.feedback import (
    Q_BEFORE,
    TIP,
    U_BEFORE,
    CompliantLaws,
    Q,
    Table,
    U,
    move_slider,
    new_table,
    stop_force,
    stride_of,
)
from impact_env.kernels.stepping.grid import Modes, close_phase, rows_wanted, step_of_row
from impact_env.kernels.stepping.runge_kutta_step import (
    account_step,
    observations,
    relative_velocities,
    stages,
    swing,
    swing_watched,
)

_BLOCK = 16  # steps between two checks for values that are not finite
# a contact with a wall's spring: wall (-1, 0, 1), time and relative velocity at its start, impulse so far
TOUCH = record(side=NUMBER, time=NUMBER, rate=NUMBER, impulse=NUMBER)


@jit
def _crossing(left, right, level, h):
    """Return (time into the step, relative velocity) where the cubic through both ends' values and slopes passes ``level``."""
    (d0, g0), (d1, g1) = left, right
    low = 0.0
    high = 1.0
    rising = d1 > d0
    for _ in range(52):
        s = 0.5 * (low + high)
        d = (1 - s) * (1 - s) * ((1 + 2 * s) * d0 + s * h * g0) + s * s * (
            (3 - 2 * s) * d1 - (1 - s) * h * g1
        )
        if (d < level) == rising:
            low = s
        else:
            high = s
    return low * h, 6 * low * (1 - low) * (d1 - d0) / h + (1 - low) * (1 - 3 * low) * g0 + low * (
        3 * low - 2
    ) * g1


@jit
def _side(y, gap):
    return 1.0 if y > gap else (-1.0 if y < -gap else 0.0)


@jit_inline
def _slope(y, h):
    """Return the relative displacement and its rate from a step's observations."""
    return y[0], 2.0 * (y[1] - y[0]) / h


@jit
def _begin_touch(stops, touches, y, h):
    """Note a contact that there is from the start."""
    if stops is not None:
        touches[0].side, touches[0].rate = _side(y[0], stops.gap), _slope(y, h)[1]


@jit
def _track_stops(stops, touches, before, y, seen, span, observe):
    """Note where a wall's spring is reached and left; ``touches`` (1,): a TOUCH record; ``span``: start and length of the step (s)."""
    if stops is None:
        return
    touch = touches[0]
    t = span[0]
    h = span[1]
    if touch.side == 0.0 and not abs(y[0]) > stops.gap:
        return
    touch.impulse += (
        h
        / 6.0
        * (
            stop_force(seen[0], stops)
            + 2.0 * stop_force(seen[1], stops)
            + 2.0 * stop_force(seen[2], stops)
            + stop_force(seen[3], stops)
        )
    )
    side = _side(y[0], stops.gap)
    if side == touch.side:
        return
    left = _slope(before, h)
    right = _slope(y, h)
    if touch.side != 0.0:
        tau, _ = _crossing(left, right, touch.side * stops.gap, h)
        _end_touch(touches, t + tau, observe)
    touch.side = side
    if side != 0.0:
        tau, gamma = _crossing(left, right, side * stops.gap, h)
        touch.time = t + tau
        touch.rate = gamma


@jit
def _end_touch(touches, time, observe):
    """Note a contact, if there is one, as an impact without loss and as a phase."""
    touch = touches[0]
    if touch.side == 0.0:
        return
    observe.counters.counts.impacts += 1
    push_impact(observe.events, touch.time, touch.rate, touch.impulse, 0.0, 0)
    push_phase(observe.events, touch.time, time, HELD_UPPER if touch.side > 0.0 else HELD_LOWER, 0)
    touch.impulse = 0.0


@jit
def _keep_before(table):
    """Note the state at the step's start."""
    cells = table.cells
    stride = stride_of(table.wide)
    for j in range(table.lanes):
        cells[Q_BEFORE * stride + j] = cells[Q * stride + j]
        cells[U_BEFORE * stride + j] = cells[U * stride + j]


@jit
def _tip(table):
    """Return the tip's displacement."""
    cells = table.cells
    stride = stride_of(table.wide)
    tip = 0.0
    for j in range(table.modes):
        tip += cells[TIP * stride + j] * cells[Q * stride + j]
    return tip


@jit
def _store(target, table, part, m_a, added_mass, offset):
    """Write the state at ``part`` (0 to 1) of the step; ``offset`` is where a stuck absorber sits in the cavity."""
    cells = table.cells
    n = table.modes
    stride = stride_of(table.wide)
    tip_q = 0.0
    tip_u = 0.0
    for j in range(n + 1):
        q = cells[Q_BEFORE * stride + j]
        u = cells[U_BEFORE * stride + j]
        q = q + part * (cells[Q * stride + j] - q)
        u = u + part * (cells[U * stride + j] - u)
        if j < n:
            target[j], target[n + 1 + j] = q, u
            tip_q += cells[TIP * stride + j] * q
            tip_u += cells[TIP * stride + j] * u
        elif m_a is not None:
            target[n], target[2 * n + 1] = q / np.sqrt(m_a), u / np.sqrt(m_a)
    if added_mass is not None:
        target[n], target[2 * n + 1] = tip_q + offset, tip_u


@jit_inline
def _take_level(level, part, start, table):
    if level is not None:
        push_level(level, start + part * (_tip(table) - start))


@jit_inline
def _take_row(series, row, part, table, laws, offset, state):
    """Write a row of the series; where there is no absorber its place keeps what ``state`` has there."""
    if series is None:
        return
    n = table.modes
    target = series.states[row]
    target[n], target[2 * n + 1] = state[n], state[2 * n + 1]
    _store(target, table, part, laws.mass, laws.added_mass, offset)


@jit
def _joined_mass(added_mass, tip_shape):
    """Return m_a / (1 + m_a sum tip_shape^2) of a stuck absorber, else 0."""
    if added_mass is None:
        return 0.0
    square = 0.0
    for i in range(tip_shape.shape[0]):
        square += tip_shape[i] * tip_shape[i]
    return added_mass / (1.0 + added_mass * square)


@jit
def _close_stuck(added_mass, end, counters, events):
    """Note the phase of a stuck absorber, which is the whole run."""
    if added_mass is not None:
        close_phase(STUCK_INSIDE, 0.0, end, counters, events)


class Absorber(NamedTuple):
    """What the loop carries of the absorber: the four stages' observations and relative velocities as far as they follow from the state, and the
    slider's place.
    """  # noqa: D205

    y: tuple[float, float, float, float]
    rest: float
    v: tuple[float, float, float, float]


class Kit(NamedTuple):
    """What the loop works with; ``touches`` (1,): a TOUCH record."""

    modes: Modes
    laws: CompliantLaws
    table: Table
    amplitude: float
    joined_mass: float
    touches: NDArray[Any]


@jit_inline
def _free_step(kit, forces, at, observe):
    """Do a step without an absorber and account for it."""
    zero = (0.0, 0.0, 0.0, 0.0)
    f = (forces[at], forces[at + 1], forces[at + 2])
    account_step(
        observe.energy, kit.modes, kit.amplitude, kit.laws, kit.table, 0.0, (f, zero, zero)
    )
    swing(kit.table, forces, at, None, None)


@jit_inline
def _watched_step(kit, absorber, forces, at, time, observe):
    """Do a step that begins at a time (s) and account for it; return the `Absorber` at its end."""
    laws = kit.laws
    table = kit.table
    before = absorber.y
    f = (forces[at], forces[at + 1], forces[at + 2])
    seen, push = stages(absorber, table, forces, at, laws, kit.joined_mass)
    account_step(
        observe.energy, kit.modes, kit.amplitude, laws, table, absorber.rest, (f, seen, push)
    )
    y = swing_watched(table, forces, at, push)
    _track_stops(laws.stops, kit.touches, before, y, seen, (time, table.h), observe)
    return Absorber(y, move_slider(y[0], absorber.rest, laws.slider), relative_velocities(table))


@jit_inline
def _advance(m_a, added_mass, kit, absorber, forces, at, time, observe):
    """Do a step that begins at a time (s); without an absorber nothing feeds back."""
    if m_a is None:
        if added_mass is None:
            _free_step(kit, forces, at, observe)
            return absorber
    return _watched_step(kit, absorber, forces, at, time, observe)


@jit_inline
def _finish(kit, offset, state, end, observe):
    """Close what is open at the end (s), and write the state."""
    laws = kit.laws
    table = kit.table
    _end_touch(kit.touches, end, observe)
    _close_stuck(laws.added_mass, end, observe.counters, observe.events)
    _keep_before(table)
    _store(state, table, 0.0, laws.mass, laws.added_mass, offset)


@jit_room
def runge_kutta_lane(modes, laws, force, state, step, observe):
    """Integrate one lane from time 0 to the drive's end and return a status code; ``state`` (2 N_m + 2,) is the start and becomes the end.

    `grid.Modes`, `feedback.CompliantLaws`, `grid.Force`, `grid.Step`. Sample k lies at k ``observe.clock.interval``. ``step.wide`` is None, or
    N_m + 1 rounded up to a multiple of 4 if that is above `STRIDE`. The friction loss contains what the slider's spring holds at the end. A contact
    with a wall's spring is noted as an impact at the time it begins.
    """
    end = force.times[-1]
    sample_dt = observe.clock.interval
    counters = observe.counters
    steps = max(1, int(np.ceil(end / step.dt - 1e-9)))
    dt = end / steps
    table = new_table(modes, laws, force.amplitude, state, dt, step.wide)
    touches = np.zeros(1, TOUCH)
    kit = Kit(
        modes, laws, table, force.amplitude, _joined_mass(laws.added_mass, modes.tip_shape), touches
    )
    offset = state[table.modes] - _tip(table)
    y = observations(table)
    _begin_touch(laws.stops, touches, y, dt)
    absorber = Absorber(y, y[0], relative_velocities(table))
    rows = rows_wanted(observe.level, observe.series, end, sample_dt)
    row = 0
    row_step = step_of_row(row, rows, sample_dt, dt, steps)
    forces = np.empty(2 * _BLOCK + 1)
    i = 0
    k = 0
    status = DONE
    tip_start = 0.0
    while i < steps:
        start = i
        stop = min(i + _BLOCK, steps)
        k = fill_phases(forces, 2 * (stop - start) + 1, force, k, i * dt, 0.5 * dt)
        while i < stop:
            if i == row_step:
                _keep_before(table)
                tip_start = _tip(table)
            absorber = _advance(
                laws.mass, laws.added_mass, kit, absorber, forces, 2 * (i - start), i * dt, observe
            )
            while i == row_step:
                part = min(max(row * sample_dt / dt - i, 0.0), 1.0)
                _take_level(observe.level, part, tip_start, table)
                _take_row(observe.series, row, part, table, laws, offset, state)
                row += 1
                row_step = step_of_row(row, rows, sample_dt, dt, steps)
            i += 1
        status = note_time(counters, i * dt) if np.isfinite(_tip(table)) else NOT_FINITE
        if status != DONE:
            break
    _finish(kit, offset, state, i * dt, observe)
    counters.counts.steps += i
    counters.counts.evaluations += 4 * i
    return status
