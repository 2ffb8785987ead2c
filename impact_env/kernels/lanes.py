"""Control intervals of many lanes in one call, one function for each family of integrators.

Lanes do not touch each other: any split of them over threads gives the same numbers.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels import compliant, exact
from impact_env.kernels.interval import (
    DISTANCE,
    DURATION,
    FORCE,
    FRESH,
    GAP,
    GAP_IN_USE,
    SEARCH_LEVEL,
    close_interval,
    new_desk,
    open_interval,
    possible_gap,
    report_state,
    with_gap,
)
from impact_env.kernels.jit import jit, jit_room
from impact_env.kernels.linear import linear_stretch, new_room
from impact_env.kernels.moreau import moreau_lane
from impact_env.kernels.observers import Series, push_block
from impact_env.kernels.rigid_contact import FREE, KICK, OFFSET, REGIME, SIDE, tip_motion
from impact_env.kernels.runge_kutta import runge_kutta_lane
from impact_env.kernels.segments import Schedule, samples_before, to_slots, to_state


@jit
def move_walls(restitution, order, now, gap, relative):  # type: ignore[no-untyped-def]
    """Set the half-clearance in use; return True if an absorber that a wall held is set free and its regime must be found anew."""
    if restitution is None:
        return False
    order[GAP] = possible_gap(order[GAP], gap, abs(relative), now[SIDE] != 0.0)
    if order[GAP] == gap or now[SIDE] == 0.0:
        return False
    now[SIDE] = 0.0
    return now[REGIME] != FREE


@jit_room
def rigid_lanes(free, joined, contact, restitution, limit, losses, reach, watch, lanes, orders, reports, status, start, stop):  # type: ignore[no-untyped-def]
    """Advance lanes [start, stop) of a scene with rigid contact; ``restitution`` None: no walls, ``limit`` None: no friction."""
    desk, room = new_desk(watch), exact.new_room(free, joined, lanes.state[start])
    now, work, kick = room.now, room.work, room.now[KICK]
    size = now.shape[0]
    for i in range(start, stop):
        order, report, state = orders[i], reports[i], lanes.state[i]
        level = open_interval(desk, watch, lanes, i, order)
        begins = order[FRESH] > 0.0
        now[:] = lanes.now[i, :size]
        if not begins:
            work.z[:, :] = lanes.z[i]
            begins = move_walls(restitution, order, now, lanes.now[i, GAP_IN_USE], report[DISTANCE])
        room.signal.memory[0] = lanes.now[i, SEARCH_LEVEL]
        if begins:
            now[:] = 0.0
            now[KICK] = kick
            room.signal.memory[0] = 0.0
        walls = with_gap(restitution, order[GAP])
        schedule = Schedule(desk.times, desk.omegas, desk.phases, order[FORCE], reach)
        status[i] = exact.exact_stretch(
            free, joined, contact, walls, limit, losses, schedule, 0, not begins, room, state, desk.clock, desk.counters, level, None, None, None
        )
        exact.current_state(free, joined, now, work, state)
        tip, tip_velocity = tip_motion(watch, state)
        half = state.shape[0] // 2
        if now[REGIME] != FREE:
            state[2 * half - 1] = tip_velocity  # to the last digit: `begin` then knows that they move as one
            report_state(watch, state, now[OFFSET], 0.0, report)
        else:
            report_state(watch, state, state[half - 1] - tip, state[2 * half - 1] - tip_velocity, report)
        close_interval(desk, watch, level, state, order, report)
        lanes.now[i, :size] = now
        lanes.now[i, GAP_IN_USE] = order[GAP]
        lanes.now[i, SEARCH_LEVEL] = room.signal.memory[0]
        lanes.z[i, :, :] = work.z


@jit_room
def linear_lanes(regime, losses, reach, watch, lanes, orders, reports, status, start, stop):  # type: ignore[no-untyped-def]
    """Advance lanes [start, stop) of a scene with one linear regime."""
    desk, room = new_desk(watch), new_room(regime, lanes.state[start])
    work = room.work
    for i in range(start, stop):
        order, report, state = orders[i], reports[i], lanes.state[i]
        level = open_interval(desk, watch, lanes, i, order)
        if order[FRESH] > 0.0:
            to_slots(regime.into, state, work.z)
        else:
            work.z[:, :] = lanes.z[i]
        schedule = Schedule(desk.times, desk.omegas, desk.phases, order[FORCE], reach)
        status[i] = linear_stretch(regime, losses, schedule, 0, room, desk.clock, desk.counters, level, None, None)
        to_state(regime.out, work.z, state)
        report_relative(watch, state, report)
        close_interval(desk, watch, level, state, order, report)
        lanes.z[i, :, :] = work.z


@jit
def report_relative(watch, state, report):  # type: ignore[no-untyped-def]
    """Report the state's share with the relative motion read from it; there is none without an absorber."""
    half = state.shape[0] // 2
    if watch.mass > 0.0:
        tip, tip_velocity = tip_motion(watch, state)
        report_state(watch, state, state[half - 1] - tip, state[2 * half - 1] - tip_velocity, report)
    else:
        report_state(watch, state, 0.0, 0.0, report)


@jit_room
def compliant_lanes(free, wall, friction, both, contact, springs, gap, limit, losses, reach, watch, lanes, orders, reports, status, start, stop):  # type: ignore[no-untyped-def]
    """Advance lanes [start, stop) of a scene with compliant contact; ``gap`` None: no walls, ``limit`` None: no friction."""
    desk, room = new_desk(watch), compliant.new_room(free, wall, friction, both, lanes.state[start])
    now = room.now
    size = now.shape[0]
    for i in range(start, stop):
        order, report, state = orders[i], reports[i], lanes.state[i]
        level = open_interval(desk, watch, lanes, i, order)
        now[:] = lanes.now[i, :size]
        room.signal.memory[0] = lanes.now[i, SEARCH_LEVEL]
        if order[FRESH] > 0.0:
            now[:] = 0.0
            room.signal.memory[0] = 0.0
            compliant.begin(springs, gap, limit, now, state, contact, 0.0, desk.counters)
        schedule = Schedule(desk.times, desk.omegas, desk.phases, order[FORCE], reach)
        status[i] = compliant.compliant_stretch(
            free, wall, friction, both, contact, springs, gap, limit, losses, schedule, 0, room, state,
            desk.clock, desk.counters, level, None, None, None,
        )  # fmt: skip
        report_relative(watch, state, report)
        close_interval(desk, watch, level, state, order, report)
        lanes.now[i, :size] = now
        lanes.now[i, SEARCH_LEVEL] = room.signal.memory[0]


@jit
def take_rows(desk, watch, series, level, order):  # type: ignore[no-untyped-def]
    """Push the recorded states' tip displacements to the level, all but the one at the interval's end."""
    count = int(samples_before(order[DURATION], watch.sample_dt))
    modes = watch.tip_shape.shape[0]
    for k in range(count):
        q = 0.0
        for j in range(modes):
            q += watch.tip_shape[j] * series.states[k, j]
        desk.block[k] = q
    push_block(level, 0, count)
    desk.clock[0] = count


@jit_room
def moreau_lanes(modal, m_a, restitution, limit, spring, dt, wide, watch, lanes, orders, reports, status, start, stop):  # type: ignore[no-untyped-def]
    """Advance lanes [start, stop) with the Moreau scheme; arguments as in `moreau_lane`, ``modal`` its first four."""
    omega, damping_ratio, force_shape, tip_shape = modal
    desk, series = new_desk(watch), Series(np.zeros((watch.samples + 1, lanes.state.shape[1])))
    for i in range(start, stop):
        order, report, state = orders[i], reports[i], lanes.state[i]
        level = open_interval(desk, watch, lanes, i, order)
        if order[FRESH] == 0.0:
            if restitution is not None:
                order[GAP] = possible_gap(order[GAP], lanes.now[i, GAP_IN_USE], abs(report[DISTANCE]), False)
        walls = with_gap(restitution, order[GAP])
        status[i] = moreau_lane(
            omega, damping_ratio, force_shape, tip_shape, m_a, walls, limit, spring, desk.times, desk.omegas, desk.phases, order[FORCE], 0.0,
            state, dt, watch.sample_dt, desk.counters, None, None, series, None, wide,
        )  # fmt: skip
        take_rows(desk, watch, series, level, order)
        report_relative(watch, state, report)
        close_interval(desk, watch, level, state, order, report)
        lanes.now[i, GAP_IN_USE] = order[GAP]


@jit_room
def runge_kutta_lanes(modal, m_a, added_mass, stops, spring, dt, wide, watch, lanes, orders, reports, status, start, stop):  # type: ignore[no-untyped-def]
    """Advance lanes [start, stop) with the Runge-Kutta method; arguments as in `runge_kutta_lane`, ``modal`` its first four. No friction."""
    omega, damping_ratio, force_shape, tip_shape = modal
    desk, series = new_desk(watch), Series(np.zeros((watch.samples + 1, lanes.state.shape[1])))
    for i in range(start, stop):
        order, report, state = orders[i], reports[i], lanes.state[i]
        level = open_interval(desk, watch, lanes, i, order)
        status[i] = runge_kutta_lane(
            omega, damping_ratio, force_shape, tip_shape, m_a, added_mass, stops, None, spring, desk.times, desk.omegas, desk.phases, order[FORCE],
            0.0, state, dt, watch.sample_dt, desk.counters, None, None, series, None, wide,
        )  # fmt: skip
        take_rows(desk, watch, series, level, order)
        report_relative(watch, state, report)
        close_interval(desk, watch, level, state, order, report)
