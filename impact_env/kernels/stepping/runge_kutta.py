"""Classical Runge-Kutta stepping for linear scenes and for compliant contact.

The compliant contact is that of the paper's appendix (Eqs. elSignorini, elCoulomb).

All contact acts along one line, so a scene is a set of independent oscillators (the modes, and the
absorber as one more of frequency zero) with one scalar feedback: a force p(y) on the absorber that
depends on an observation y, a weighted sum of displacements and velocities
(`new_runge_kutta_table`). In each of the four stages y is linear in the state at the step's start,
the excitation, and the p of the earlier stages. The weights are computed once, by the textbook step
applied to unit states and unit inputs. Then one pass over the modes does a whole step. This is the
classical method with its sums in another order, not an approximation of it.

The slider of elastic friction keeps its position within a step and is moved at the step's end.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.compiling.records import NUMBER, record_type
from impact_env.kernels.motion.observers import (
    DONE,
    HELD_LOWER,
    HELD_UPPER,
    LEVEL_OFF,
    NOT_FINITE,
    STEP_TOO_LONG,
    STUCK_INSIDE,
    push_impact,
    push_phase,
    push_sample,
    record_time,
)
from impact_env.kernels.stepping.grid import (
    BeamModes,
    fill_force,
    find_sample_range,
    find_sample_step,
    find_series_row,
    interpolate_displacement,
    interpolate_velocity,
    record_contact_phase,
)
from impact_env.kernels.stepping.runge_kutta_step import (
    Q_BEFORE,
    TIP,
    U_BEFORE,
    CompliantLaws,
    Q,
    RungeKuttaTable,
    U,
    Y,
    account_step,
    advance_oscillators,
    compute_relative_velocities,
    compute_stages,
    compute_stop_force,
    find_stride,
    new_runge_kutta_table,
    observe_rows,
)

_STEPS_PER_CHECK = 16  # steps between two checks for values that are not finite
# fewest steps in a period of a nonlinear spring's tangent stiffness, as in a period of a mode
# (`methods.LEAST_STEPS`)
LEAST_STEPS_PER_PERIOD = 4
# the current contact with a wall's spring
WALL_TOUCH = record_type(
    side=NUMBER,  # wall touched: -1 lower, 1 upper, 0 none
    time=NUMBER,  # start of the contact (s)
    rate=NUMBER,  # relative velocity at the start (m/s)
    impulse=NUMBER,  # so far (N s)
)


class AbsorberStages(NamedTuple):
    """The absorber between two steps.

    ``y`` and ``v`` are the parts that follow from the state, without excitation and feedback, in
    the next step's four stages.
    """

    y: tuple[float, float, float, float]  # observations (units: `new_runge_kutta_table`)
    rest: float  # slider's position relative to the tip (m)
    v: tuple[float, float, float, float]  # relative velocities (m/s), 0 without a nonlinear spring
    largest: float  # largest |y| at a step's start so far, a nonlinear spring's deflection (m)


class StepContext(NamedTuple):
    """Constants of the loop over steps."""

    modes: BeamModes  # of the beam
    laws: CompliantLaws  # of the absorber
    table: RungeKuttaTable  # oscillators with their state, which each step updates
    amplitude: float  # of the force (N)
    joined_mass: float  # of a stuck absorber, as in `ActiveLaws` (kg), else 0
    touches: NDArray[Any]  # (1,) a WALL_TOUCH record


@jit_inline
def _evaluate_cubic(s, left, right, h):
    """Return (value, rate) of a cubic at the fraction ``s`` (0 to 1) of a step of h (s).

    The cubic matches ``left`` and ``right``, which are (value, rate) at the step's two ends.
    """
    d0, g0 = left
    d1, g1 = right
    d = (1 - s) * (1 - s) * ((1 + 2 * s) * d0 + s * h * g0) + s * s * (
        (3 - 2 * s) * d1 - (1 - s) * h * g1
    )
    g = 6 * s * (1 - s) * (d1 - d0) / h + (1 - s) * (1 - 3 * s) * g0 + s * (3 * s - 2) * g1
    return d, g


@jit
def _find_crossing(left, right, level, h, rising, low, high):
    """Return (fraction of the step, relative velocity in m/s) where the cubic crosses ``level``.

    The cubic is that of `_evaluate_cubic`. It crosses between the fractions ``low`` and ``high``
    of the step, upwards if ``rising``.
    """
    for _ in range(52):
        s = 0.5 * (low + high)
        if (_evaluate_cubic(s, left, right, h)[0] < level) == rising:
            low = s
        else:
            high = s
    return low, _evaluate_cubic(low, left, right, h)[1]


@jit
def _find_turning_point(left, right, side, h):
    """Return the fraction of the step at which the cubic of `_evaluate_cubic` reverses.

    The cubic approaches a wall (``side`` -1 lower, 1 upper) at the start of the step and moves away
    from it at the end.
    """
    low = 0.0
    high = 1.0
    for _ in range(52):
        s = 0.5 * (low + high)
        if side * _evaluate_cubic(s, left, right, h)[1] > 0.0:
            low = s
        else:
            high = s
    return low


@jit
def _record_short_contact(stops, left, right, stages, span, observers):
    """Record a contact that begins and ends within a step, if there is one in its stages.

    Arguments as in `_track_wall_contact`; ``left`` and ``right`` are (relative displacement, its
    rate) at the step's ends. The impulse is that of the wall's force in the four stages. The
    contact lasts while the cubic through the step's ends is beyond the wall. If the cubic stays
    short of the wall, the contact has no duration and lies where the cubic reverses.
    """
    h = span[1]
    impulse = (
        h
        / 6.0
        * (2.0 * compute_stop_force(stages[1], stops) + 2.0 * compute_stop_force(stages[2], stops))
    )
    impulse += (
        h / 6.0 * (compute_stop_force(stages[0], stops) + compute_stop_force(stages[3], stops))
    )
    if impulse == 0.0:
        return
    side = -1.0 if impulse > 0.0 else 1.0
    turning = _find_turning_point(left, right, side, h)
    begin = turning
    end = turning
    rate = 0.0
    if side * _evaluate_cubic(turning, left, right, h)[0] > stops.gap:
        begin, rate = _find_crossing(left, right, side * stops.gap, h, side > 0.0, 0.0, turning)
        end, _ = _find_crossing(left, right, side * stops.gap, h, side < 0.0, turning, 1.0)
    observers.counters.counts.impacts += 1
    push_impact(observers.events, span[0] + begin * h, rate, impulse, 0.0, 0)
    kind = HELD_UPPER if side > 0.0 else HELD_LOWER
    push_phase(observers.events, span[0] + begin * h, span[0] + end * h, kind, 0)


@jit
def _find_wall_side(y, gap):
    """Return the wall that a relative displacement y (m) overlaps: -1 lower, 1 upper, 0 none."""
    return 1.0 if y > gap else (-1.0 if y < -gap else 0.0)


@jit_inline
def _compute_displacement_and_rate(y, h):
    """Return (relative displacement in m, its rate in m/s) at the start of a step of h (s).

    ``y`` are the observations in the step's stages; the second stage lies at q + h/2 u.
    """
    return y[0], 2.0 * (y[1] - y[0]) / h


@jit
def _track_wall_contact(stops, touches, before, y, stages, span, observers):
    """Update the contact with a wall's spring after a step, and record each contact that ended.

    ``stops`` are `ElasticStops`; ``touches`` (1,) is the WALL_TOUCH record, updated in place.
    ``before`` and ``y`` are `AbsorberStages.y` before and after the step, ``stages`` the
    observations in its four stages; ``span`` is (start, length) of the step in s.
    """
    if stops.stiffness == 0.0:
        return
    touch = touches[0]
    t = span[0]
    h = span[1]
    if touch.side == 0.0 and not abs(y[0]) > stops.gap:
        if max(abs(stages[1]), abs(stages[2]), abs(stages[3])) > stops.gap:
            _record_short_contact(
                stops,
                _compute_displacement_and_rate(before, h),
                _compute_displacement_and_rate(y, h),
                stages,
                span,
                observers,
            )
        return
    touch.impulse += (
        h
        / 6.0
        * (
            compute_stop_force(stages[0], stops)
            + 2.0 * compute_stop_force(stages[1], stops)
            + 2.0 * compute_stop_force(stages[2], stops)
            + compute_stop_force(stages[3], stops)
        )
    )
    side = _find_wall_side(y[0], stops.gap)
    if side == touch.side:
        return
    left = _compute_displacement_and_rate(before, h)
    right = _compute_displacement_and_rate(y, h)
    rising = right[0] > left[0]
    if touch.side != 0.0:
        share, _ = _find_crossing(left, right, touch.side * stops.gap, h, rising, 0.0, 1.0)
        _record_wall_touch(touches, t + share * h, observers)
    touch.side = side
    if side != 0.0:
        share, gamma = _find_crossing(left, right, side * stops.gap, h, rising, 0.0, 1.0)
        touch.time = t + share * h
        touch.rate = gamma


@jit
def _record_wall_touch(touches, time, observers):
    """Record the contact with a wall's spring that ends at ``time`` (s), if there is one.

    It is recorded as an impact without loss and as a contact phase. Its impulse in ``touches`` is
    set to 0; the side is left to the caller.
    """
    touch = touches[0]
    if touch.side == 0.0:
        return
    observers.counters.counts.impacts += 1
    push_impact(observers.events, touch.time, touch.rate, touch.impulse, 0.0, 0)
    push_phase(
        observers.events, touch.time, time, HELD_UPPER if touch.side > 0.0 else HELD_LOWER, 0
    )
    touch.impulse = 0.0


@jit
def _save_oscillators(table):
    """Write the oscillators' current state into the rows Q_BEFORE and U_BEFORE."""
    cells = table.cells
    stride = find_stride(table.wide_stride)
    for j in range(table.lanes):
        cells[Q_BEFORE * stride + j] = cells[Q * stride + j]
        cells[U_BEFORE * stride + j] = cells[U * stride + j]


@jit
def _compute_tip(table):
    """Return (displacement in m, velocity in m/s) of the tip."""
    cells = table.cells
    stride = find_stride(table.wide_stride)
    q = 0.0
    u = 0.0
    for j in range(table.modes):
        q += cells[TIP * stride + j] * cells[Q * stride + j]
        u += cells[TIP * stride + j] * cells[U * stride + j]
    return q, u


@jit
def _is_finite(table):
    """Return whether the displacements of all modes and of the absorber are finite."""
    total = 0.0
    for j in range(table.lanes):
        total += abs(table.cells[Q * find_stride(table.wide_stride) + j])
    return np.isfinite(total)


@jit
def _write_state_between(target, table, part, m_a, added_mass, offset):
    """Write the state at the fraction ``part`` (0 to 1) of the step into ``target`` (2 N_m + 2,).

    The step lies between the states in the rows Q_BEFORE and Q. ``m_a`` (kg) is the mass of a
    moving absorber, ``added_mass`` (kg) that of a stuck one, and ``offset`` (m) the position of a
    stuck absorber relative to the tip. Without absorber, its two entries are kept.
    """
    cells = table.cells
    n = table.modes
    stride = find_stride(table.wide_stride)
    tip_q = 0.0
    tip_u = 0.0
    for j in range(n + 1):
        before = cells[Q_BEFORE * stride + j], cells[U_BEFORE * stride + j]
        after = cells[Q * stride + j], cells[U * stride + j]
        q = interpolate_displacement(before, after, part, table.h)
        u = interpolate_velocity(before, after, part, table.h)
        if j < n:
            target[j] = q
            target[n + 1 + j] = u
            tip_q += cells[TIP * stride + j] * q
            tip_u += cells[TIP * stride + j] * u
        elif m_a > 0.0:
            target[n] = q / np.sqrt(m_a)
            target[2 * n + 1] = u / np.sqrt(m_a)
    if added_mass > 0.0:
        target[n] = tip_q + offset
        target[2 * n + 1] = tip_u


@jit
def _compute_displacement_between(place, part, table):
    """Return the displacement (m) of a point of the beam at the fraction ``part`` of the step.

    The point is given by the mode shapes there, ``place`` (N_m,).
    """
    cells = table.cells
    stride = find_stride(table.wide_stride)
    total = 0.0
    for j in range(table.modes):
        before = cells[Q_BEFORE * stride + j], cells[U_BEFORE * stride + j]
        after = cells[Q * stride + j], cells[U * stride + j]
        total += place[j] * interpolate_displacement(before, after, part, table.h)
    return total


@jit_inline
def _sample_level(level, clock, part, start, table):
    """Add the displacement at the fraction ``part`` (0 to 1) of a step to the level.

    Nothing is done if ``level`` is None or off. ``start`` is (displacement, velocity) of the tip at
    the step's start.
    """
    if level is None:
        return
    if clock.level == LEVEL_OFF:
        return
    if level.place.shape[0] == 0:
        push_sample(level, interpolate_displacement(start, _compute_tip(table), part, table.h))
    else:
        push_sample(level, _compute_displacement_between(level.place, part, table))


@jit_inline
def _sample_state(series, clock, sample, part, table, laws, offset, state):
    """Write the state at the fraction ``part`` of a step, if the series has a row for the sample.

    ``series`` may be None. ``state`` is the initial state, ``offset`` as in `_write_state_between`.
    """
    if series is None:
        return
    row = find_series_row(clock, series, sample)
    if row >= 0:
        target = series.states[row]
        n = table.modes
        target[n] = state[n]  # without an absorber these two do not change
        target[2 * n + 1] = state[2 * n + 1]
        _write_state_between(target, table, part, laws.mass, laws.added_mass, offset)


@jit
def _compute_compliance(mass, tip_shape):
    """Return the compliance at the contact of absorber and tip (1/kg).

    It is their relative acceleration under a unit force between them. ``mass`` is that of a moving
    absorber; the result is 0 if that is 0.
    """
    if mass == 0.0:
        return 0.0
    total = 1.0 / mass
    for i in range(tip_shape.shape[0]):
        total += tip_shape[i] * tip_shape[i]
    return total


@jit_inline
def _advance_without_absorber(context, forces, at, observers):
    """Perform a step without an absorber, and add its work and losses to the energies.

    ``forces[at : at + 3]`` is the force over its amplitude at start, middle and end of the step.
    """
    zero = (0.0, 0.0, 0.0, 0.0)
    f = (forces[at], forces[at + 1], forces[at + 2])
    account_step(
        observers.energy,
        context.modes,
        context.amplitude,
        context.laws,
        context.table,
        0.0,
        (f, zero, zero),
    )
    advance_oscillators(context.table, forces, at, None, None)


@jit_inline
def _advance_with_absorber(context, absorber, forces, at, time, observers):
    """Perform a step that begins at ``time`` (s), and add its work and losses to the energies.

    ``forces`` and ``at`` are as in `_advance_without_absorber`. Wall contacts are recorded and the
    slider is moved. Returns the `AbsorberStages` after the step.
    """
    laws = context.laws
    table = context.table
    before = absorber.y
    f = (forces[at], forces[at + 1], forces[at + 2])
    stages, push = compute_stages(absorber, table, forces, at, laws, context.joined_mass)
    account_step(
        observers.energy,
        context.modes,
        context.amplitude,
        laws,
        table,
        absorber.rest,
        (f, stages, push),
    )
    if push[0] == 0.0 and push[1] == 0.0 and push[2] == 0.0 and push[3] == 0.0:  # most steps
        y = advance_oscillators(table, forces, at, None, 0.0)
    else:
        y = advance_oscillators(table, forces, at, push, 0.0)
    _track_wall_contact(laws.stops, context.touches, before, y, stages, (time, table.h), observers)
    rest = absorber.rest
    if laws.slider.limit != 0.0:  # the slider follows at the end of the step
        reach = laws.slider.limit / laws.slider.stiffness
        rest = min(max(rest, y[0] - reach), y[0] + reach)
    v = (0.0, 0.0, 0.0, 0.0)
    if laws.cubic.cubic_stiffness > 0.0:  # else no law depends on it
        v = compute_relative_velocities(table)
    return AbsorberStages(y, rest, v, max(absorber.largest, abs(y[0])))


@jit_inline
def _advance_step(context, absorber, forces, at, time, observers):
    """Perform a step that begins at ``time`` (s); return the `AbsorberStages` after it.

    Without an absorber the stages are returned unchanged.
    """
    if context.laws.mass + context.laws.added_mass == 0.0:
        _advance_without_absorber(context, forces, at, observers)
        return absorber
    return _advance_with_absorber(context, absorber, forces, at, time, observers)


@jit_inline
def _finish_run(context, offset, state, end, observers):
    """Record the contacts that last until the ``end`` (s), and write the final ``state``."""
    laws = context.laws
    table = context.table
    _record_wall_touch(context.touches, end, observers)
    if laws.added_mass > 0.0:  # a stuck absorber: the whole run is one phase
        record_contact_phase(STUCK_INSIDE, 0.0, end, observers.counters, observers.events)
    _save_oscillators(table)
    _write_state_between(state, table, 0.0, laws.mass, laws.added_mass, offset)


@jit_allocating
def runge_kutta_lane(modes, laws, force, state, step, observers):
    """Integrate one run from time 0 to the drive's end and return a status code.

    The code is DONE, NOT_FINITE, STEP_TOO_LONG for a nonlinear spring, or STOPPED by another
    thread. ``modes``: `grid.BeamModes`, ``laws``: `runge_kutta_step.CompliantLaws`, ``force``:
    `grid.DriveForce`, ``step``: `grid.TimeStep`. ``state`` (2 N_m + 2,) is the initial state and
    becomes the final one; its order is modal displacements, absorber displacement, modal
    velocities, absorber velocity. The ``observers`` are filled. Sample k lies at time k
    ``observers.clock.interval``. ``step.wide_stride`` is None, or N_m + 1 rounded up to a multiple
    of 4 if that is above `runge_kutta_step.STRIDE`. The friction loss contains the energy that the
    slider's spring stores at the end. A contact with a wall's spring is listed as an impact at the
    time it begins.
    """
    end = force.times[-1]
    sample_dt = observers.clock.interval
    counters = observers.counters
    steps = max(1, int(np.ceil(end / step.dt - 1e-9)))
    dt = end / steps
    table = new_runge_kutta_table(modes, laws, force.amplitude, state, dt, step.wide_stride)
    touches = np.zeros(1, WALL_TOUCH)
    square = 0.0
    for j in range(table.modes):
        square += modes.tip_shape[j] * modes.tip_shape[j]
    joined_mass = laws.added_mass / (1.0 + laws.added_mass * square)
    context = StepContext(modes, laws, table, force.amplitude, joined_mass, touches)
    offset = state[table.modes] - _compute_tip(table)[0]
    y = observe_rows(table, table.cells[Y * find_stride(table.wide_stride) :])
    if laws.stops.stiffness > 0.0:  # a contact from the start
        touches[0].side = _find_wall_side(y[0], laws.stops.gap)
        touches[0].rate = _compute_displacement_and_rate(y, dt)[1]
    absorber = AbsorberStages(y, y[0], compute_relative_velocities(table), abs(y[0]))
    compliance = _compute_compliance(laws.mass, modes.tip_shape)
    row, rows = find_sample_range(observers.clock, observers.level, observers.series, end)
    row_step = find_sample_step(row, rows, sample_dt, dt, steps)
    forces = np.empty(2 * _STEPS_PER_CHECK + 1)
    i = 0
    k = 0
    status = DONE
    tip_start = _compute_tip(table)
    while i < steps:
        start = i
        stop = min(i + _STEPS_PER_CHECK, steps)
        k = fill_force(forces, 2 * (stop - start) + 1, force, k, i * dt, 0.5 * dt)
        while i < stop:
            if i == row_step:
                _save_oscillators(table)
                tip_start = _compute_tip(table)
            absorber = _advance_step(context, absorber, forces, 2 * (i - start), i * dt, observers)
            while i == row_step:
                part = min(max(row * sample_dt / dt - i, 0.0), 1.0)
                _sample_level(observers.level, observers.clock, part, tip_start, table)
                _sample_state(
                    observers.series, observers.clock, row, part, table, laws, offset, state
                )
                row += 1
                row_step = find_sample_step(row, rows, sample_dt, dt, steps)
            i += 1
        # square of the frequency from a nonlinear spring's tangent stiffness at its largest
        # deflection
        largest = absorber.largest
        square = 3.0 * laws.cubic.cubic_stiffness * largest * largest * compliance
        if square * dt * dt > (2.0 * np.pi / LEAST_STEPS_PER_PERIOD) ** 2:
            status = STEP_TOO_LONG
        elif not _is_finite(table):
            status = NOT_FINITE
        else:
            status = record_time(counters, i * dt)
        if status != DONE:
            break
    _finish_run(context, offset, state, i * dt, observers)
    counters.counts.steps += i
    counters.counts.evaluations += 4 * i
    return status
