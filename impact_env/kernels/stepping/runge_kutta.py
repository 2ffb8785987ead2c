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
from impact_env.kernels.motion.level import OFF, push_level
from impact_env.kernels.motion.observers import (
    DONE,
    HELD_LOWER,
    HELD_UPPER,
    NOT_FINITE,
    STEP_TOO_LONG,
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
from impact_env.kernels.stepping.grid import (
    Modes,
    close_phase,
    displacement_between,
    row_of_series,
    sample_range,
    step_of_row,
    velocity_between,
)
from impact_env.kernels.stepping.runge_kutta_step import (
    account_step,
    observations,
    relative_velocities,
    stages,
    swing,
    swing_watched,
)

_BLOCK = 16  # steps between two checks for values that are not finite
STEPS_PER_SWING = 4  # least in a period of a nonlinear spring's tangent stiffness, as of a mode (`methods.LEAST_STEPS`)
# a contact with a wall's spring: wall (-1, 0, 1), time and relative velocity at its start, impulse so far
TOUCH = record(side=NUMBER, time=NUMBER, rate=NUMBER, impulse=NUMBER)


@jit_inline
def _cubic(s, left, right, h):
    """Return value and rate, at the share ``s`` of a step, of the cubic through both ends' values and slopes."""
    (d0, g0), (d1, g1) = left, right
    d = (1 - s) * (1 - s) * ((1 + 2 * s) * d0 + s * h * g0) + s * s * (
        (3 - 2 * s) * d1 - (1 - s) * h * g1
    )
    g = 6 * s * (1 - s) * (d1 - d0) / h + (1 - s) * (1 - 3 * s) * g0 + s * (3 * s - 2) * g1
    return d, g


@jit
def _crossing(left, right, level, h, rising, low, high):
    """Return (share of the step, relative velocity) where the cubic passes ``level`` between two shares of the step, ``rising`` or falling."""
    for _ in range(52):
        s = 0.5 * (low + high)
        if (_cubic(s, left, right, h)[0] < level) == rising:
            low = s
        else:
            high = s
    return low, _cubic(low, left, right, h)[1]


@jit
def _turning(left, right, side, h):
    """Return the share of the step at which the cubic, which approaches a wall at its start and leaves it at its end, turns."""
    low = 0.0
    high = 1.0
    for _ in range(52):
        s = 0.5 * (low + high)
        if side * _cubic(s, left, right, h)[1] > 0.0:
            low = s
        else:
            high = s
    return low


@jit
def _list_short_contact(stops, left, right, seen, span, observe):
    """List a contact with a wall's spring that begins and ends within a step, if its stages have met one.

    Its impulse is what acts in the step. It lasts while the cubic through the step's ends is beyond the wall; one that stays short of it has its
    contact where it turns.
    """
    h = span[1]
    impulse = h / 6.0 * (2.0 * stop_force(seen[1], stops) + 2.0 * stop_force(seen[2], stops))
    impulse += h / 6.0 * (stop_force(seen[0], stops) + stop_force(seen[3], stops))
    if impulse == 0.0:
        return
    side = -1.0 if impulse > 0.0 else 1.0
    turning = _turning(left, right, side, h)
    begin = turning
    end = turning
    rate = 0.0
    if side * _cubic(turning, left, right, h)[0] > stops.gap:
        begin, rate = _crossing(left, right, side * stops.gap, h, side > 0.0, 0.0, turning)
        end, _ = _crossing(left, right, side * stops.gap, h, side < 0.0, turning, 1.0)
    observe.counters.counts.impacts += 1
    push_impact(observe.events, span[0] + begin * h, rate, impulse, 0.0, 0)
    kind = HELD_UPPER if side > 0.0 else HELD_LOWER
    push_phase(observe.events, span[0] + begin * h, span[0] + end * h, kind, 0)


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
        if max(abs(seen[1]), abs(seen[2]), abs(seen[3])) > stops.gap:
            _list_short_contact(stops, _slope(before, h), _slope(y, h), seen, span, observe)
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
    rising = right[0] > left[0]
    if touch.side != 0.0:
        share, _ = _crossing(left, right, touch.side * stops.gap, h, rising, 0.0, 1.0)
        _end_touch(touches, t + share * h, observe)
    touch.side = side
    if side != 0.0:
        share, gamma = _crossing(left, right, side * stops.gap, h, rising, 0.0, 1.0)
        touch.time = t + share * h
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
    """Return displacement and velocity of the tip."""
    cells = table.cells
    stride = stride_of(table.wide)
    q = 0.0
    u = 0.0
    for j in range(table.modes):
        q += cells[TIP * stride + j] * cells[Q * stride + j]
        u += cells[TIP * stride + j] * cells[U * stride + j]
    return q, u


@jit
def _is_finite(table):
    """Return whether the displacements of all oscillators, modes and absorber, are finite."""
    total = 0.0
    for j in range(table.lanes):
        total += abs(table.cells[Q * stride_of(table.wide) + j])
    return np.isfinite(total)


@jit
def _too_stiff(cubic, compliance, largest, h):
    """Return whether a step (s) is too long for a nonlinear spring's tangent stiffness at its largest stretch (m)."""
    if cubic is None:
        return False
    square = 3.0 * cubic.cubic_stiffness * largest * largest * compliance
    return square * h * h > (2.0 * np.pi / STEPS_PER_SWING) ** 2


@jit
def _store(target, table, part, m_a, added_mass, offset):
    """Write the state at ``part`` (0 to 1) of the step; ``offset`` is where a stuck absorber sits in the cavity."""
    cells = table.cells
    n = table.modes
    stride = stride_of(table.wide)
    tip_q = 0.0
    tip_u = 0.0
    for j in range(n + 1):
        before = cells[Q_BEFORE * stride + j], cells[U_BEFORE * stride + j]
        after = cells[Q * stride + j], cells[U * stride + j]
        q = displacement_between(before, after, part, table.h)
        u = velocity_between(before, after, part, table.h)
        if j < n:
            target[j], target[n + 1 + j] = q, u
            tip_q += cells[TIP * stride + j] * q
            tip_u += cells[TIP * stride + j] * u
        elif m_a is not None:
            target[n], target[2 * n + 1] = q / np.sqrt(m_a), u / np.sqrt(m_a)
    if added_mass is not None:
        target[n], target[2 * n + 1] = tip_q + offset, tip_u


@jit
def _at_place(place, part, table):
    """Return the displacement at ``part`` (0 to 1) of the step of the place of a mode shape (N_m,)."""
    cells = table.cells
    stride = stride_of(table.wide)
    total = 0.0
    for j in range(table.modes):
        before = cells[Q_BEFORE * stride + j], cells[U_BEFORE * stride + j]
        after = cells[Q * stride + j], cells[U * stride + j]
        total += place[j] * displacement_between(before, after, part, table.h)
    return total


@jit_inline
def _take_level(level, clock, part, start, table):
    if level is None:
        return
    if clock.level == OFF:
        return
    if level.place.shape[0] == 0:
        push_level(level, displacement_between(start, _tip(table), part, table.h))
    else:
        push_level(level, _at_place(level.place, part, table))


@jit_inline
def _take_row(series, clock, sample, part, table, laws, offset, state):
    """Write a row of the series; where there is no absorber its place keeps what ``state`` has there."""
    if series is None:
        return
    row = row_of_series(clock, series, sample)
    if row < 0:
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
def _compliance(mass, tip_shape):
    """Return the relative acceleration (1/kg) of absorber and tip by a unit force between them, 0 without an absorber that moves."""
    if mass is None:
        return 0.0
    total = 1.0 / mass
    for i in range(tip_shape.shape[0]):
        total += tip_shape[i] * tip_shape[i]
    return total


@jit
def _close_stuck(added_mass, end, counters, events):
    """Note the phase of a stuck absorber, which is the whole run."""
    if added_mass is not None:
        close_phase(STUCK_INSIDE, 0.0, end, counters, events)


class Absorber(NamedTuple):
    """What the loop carries of the absorber: the four stages' observations and relative velocities as far as they follow from the state, the
    slider's place, and the largest stretch of a nonlinear spring so far (m).
    """  # noqa: D205

    y: tuple[float, float, float, float]
    rest: float
    v: tuple[float, float, float, float]
    largest: float


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
    largest = absorber.largest if laws.cubic is None else max(absorber.largest, abs(y[0]))
    return Absorber(
        y, move_slider(y[0], absorber.rest, laws.slider), relative_velocities(table), largest
    )


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
    offset = state[table.modes] - _tip(table)[0]
    y = observations(table)
    _begin_touch(laws.stops, touches, y, dt)
    absorber = Absorber(y, y[0], relative_velocities(table), abs(y[0]))
    compliance = _compliance(laws.mass, modes.tip_shape)
    row, rows = sample_range(observe.clock, observe.level, observe.series, end)
    row_step = step_of_row(row, rows, sample_dt, dt, steps)
    forces = np.empty(2 * _BLOCK + 1)
    i = 0
    k = 0
    status = DONE
    tip_start = _tip(table)
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
                _take_level(observe.level, observe.clock, part, tip_start, table)
                _take_row(observe.series, observe.clock, row, part, table, laws, offset, state)
                row += 1
                row_step = step_of_row(row, rows, sample_dt, dt, steps)
            i += 1
        if _too_stiff(laws.cubic, compliance, absorber.largest, dt):
            status = STEP_TOO_LONG
        elif not _is_finite(table):
            status = NOT_FINITE
        else:
            status = note_time(counters, i * dt)
        if status != DONE:
            break
    _finish(kit, offset, state, i * dt, observe)
    counters.counts.steps += i
    counters.counts.evaluations += 4 * i
    return status
