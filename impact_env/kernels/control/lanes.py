"""Control intervals of many lanes in one call, one function for each family of integrators.

Lanes do not touch each other: any split of them over threads gives the same numbers. The loops over lanes are functions of their own, beside those
that make room for them: with numba's reference counts they would take a fifth longer.
"""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit, jit_room, jit_view
from impact_env.kernels.control.change import take_change
from impact_env.kernels.control.crew import all_done, first_part, next_part
from impact_env.kernels.control.interval import (
    can_do,
    close_interval,
    lay_load,
    new_desk,
    new_interval_load,
    observe_lane,
    open_interval,
    possible_gap,
    report_state,
    with_gap,
    with_limit,
)
from impact_env.kernels.exact import compliant, linear, springs
from impact_env.kernels.exact import rigid as exact
from impact_env.kernels.exact.free_and_joined import Rigid, new_room
from impact_env.kernels.exact.rigid_contact import FREE, Contact, new_now, tip_motion
from impact_env.kernels.motion.level import push_block
from impact_env.kernels.motion.observers import DONE, ORDER_REFUSED, Observe, Series
from impact_env.kernels.motion.segments import Schedule, samples_before, to_slots, to_state
from impact_env.kernels.motion.slots import copy
from impact_env.kernels.stepping.grid import Force
from impact_env.kernels.stepping.moreau import moreau_lane
from impact_env.kernels.stepping.moreau_law import RigidLaws
from impact_env.kernels.stepping.runge_kutta import runge_kutta_lane


@jit
def move_walls(walls, order, now, gap, relative):
    """Set the half-clearance in use; return True if an absorber that a wall held is set free and its regime must be found anew."""
    if walls is None:
        return False
    order.gap = possible_gap(order.gap, gap, abs(relative), now.side != 0.0)
    if order.gap == gap or now.side == 0.0:
        return False
    now.side = 0.0
    return now.regime != FREE


@jit
def take_up(walls, lanes, i, order, distance, start, room):
    """Put lane i into the room; return whether its regime must be found anew.

    ``distance``: of the absorber from the tip (m); ``start`` (1,): the contact of a lane that begins.
    """
    begins = order.fresh
    room.now[0] = lanes.rigid[i]
    room.signal.memory[0] = lanes.kept[i].search_level
    if not begins:
        copy(lanes.z[i], room.work.z)
        begins = move_walls(walls, order, room.now[0], lanes.kept[i].gap, distance)
    if begins:
        room.now[0] = start[0]
        room.signal.memory[0] = 0.0
    return begins


@jit
def keep_order(kept, order, search_level):
    """Keep what was in use."""
    kept.gap = order.gap
    kept.limit = order.limit
    kept.force = order.force
    kept.search_level = search_level


@jit
def report_rigid(watch, scene, room, state, report):
    """Write the lane's state, and report its share."""
    exact.current_state(scene, room, state)
    now = room.now[0]
    half = state.shape[0] // 2
    tip, tip_velocity = tip_motion(watch, state)
    if now.regime != FREE:
        state[2 * half - 1] = (
            tip_velocity  # to the last digit: `begin` then knows that they move as one
        )
        report_state(watch, state, now.offset, 0.0, report)
    else:
        report_state(
            watch, state, state[half - 1] - tip, state[2 * half - 1] - tip_velocity, report
        )


@jit_room
def rigid_lanes(scene, reach, batch, board, parts, patience):
    """Take parts from the board and advance their lanes, of a scene with rigid contact; return whether all parts are done.

    ``reach`` (s): longest window. The caller gives the number of ``parts`` that it has written on the board, a helper 0; ``patience``: looks at the
    board before a thread leaves. Walls' gap and friction limit are those of a lane's order.
    """
    desk = new_desk(batch.watch)
    load = new_interval_load(batch.watch)
    fresh = new_now(1)
    room = new_room(scene.free, scene.joined, load, batch.lanes.state[0])
    fresh[0] = room.now[0]
    part = first_part(board, parts, patience)
    while part >= 0:
        _each_rigid(
            scene, reach, batch, board.cuts[part, 0], board.cuts[part, 1], desk, load, room, fresh
        )
        part = next_part(board, patience)
    return all_done(board, parts)


@jit
def _each_rigid(scene, reach, batch, start, stop, desk, load, room, fresh):
    watch, lanes, orders, reports, status = batch
    free, joined, contact, losses = scene
    for i in range(start, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not can_do(watch, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(desk, watch, lanes, i, order)
        begins = take_up(contact.walls, lanes, i, order, report.distance, fresh, room)
        walls = with_gap(contact.walls, order.gap)
        limit = with_limit(contact.limit, order.limit)
        now_there = Rigid(
            free,
            joined,
            Contact(
                contact.mass,
                contact.compliance,
                contact.tip_shape,
                walls,
                limit,
                None,
                contact.static_ratio,
            ),
            losses,
        )
        stretches = lay_load(watch.beside, order, desk.times, load)
        schedule = Schedule(desk.times, desk.omegas, desk.phases, order.force, reach, load)
        observe = observe_lane(desk, watch, lanes, i)
        if not begins:
            kept = lanes.kept[i]
            take_change(
                now_there, limit, kept.limit, order.force != kept.force, schedule, room, state
            )
        for k in range(stretches):
            status[i] = exact.exact_stretch(
                now_there, schedule, k, k > 0 or not begins, room, state, observe
            )
            if status[i] != DONE:
                break
        report_rigid(watch, scene, room, state, report)
        close_interval(desk, watch, observe.level, state, order, report)
        lanes.rigid[i] = room.now[0]
        keep_order(lanes.kept[i], order, room.signal.memory[0])
        copy(room.work.z, lanes.z[i])


@jit_room
def linear_lanes(scene, reach, batch, board, parts, patience):
    """Take parts and advance the lanes of a scene with one linear regime, as `rigid_lanes`."""
    desk = new_desk(batch.watch)
    load = new_interval_load(batch.watch)
    room = linear.new_room(scene.regime, load, batch.lanes.state[0])
    part = first_part(board, parts, patience)
    while part >= 0:
        _each_linear(
            scene, reach, batch, board.cuts[part, 0], board.cuts[part, 1], desk, load, room
        )
        part = next_part(board, patience)
    return all_done(board, parts)


@jit
def _each_linear(scene, reach, batch, start, stop, desk, load, room):
    watch, lanes, orders, reports, status = batch
    regime = scene.regime
    work = room.work
    for i in range(start, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not can_do(watch, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(desk, watch, lanes, i, order)
        if order.fresh:
            to_slots(regime.into, state, work.z)
        else:
            copy(lanes.z[i], work.z)
        stretches = lay_load(watch.beside, order, desk.times, load)
        schedule = Schedule(desk.times, desk.omegas, desk.phases, order.force, reach, load)
        observe = observe_lane(desk, watch, lanes, i)
        for k in range(stretches):
            status[i] = linear.linear_stretch(scene, schedule, k, room, observe)
            if status[i] != DONE:
                break
        to_state(regime.out, work.z, state)
        report_relative(watch, state, report)
        close_interval(desk, watch, observe.level, state, order, report)
        copy(work.z, lanes.z[i])


@jit
def report_relative(watch, state, report):
    """Report the state's share with the relative motion read from it; there is none without an absorber."""
    half = state.shape[0] // 2
    if watch.mass > 0.0:
        tip, tip_velocity = tip_motion(watch, state)
        report_state(
            watch, state, state[half - 1] - tip, state[2 * half - 1] - tip_velocity, report
        )
    else:
        report_state(watch, state, 0.0, 0.0, report)


@jit_room
def compliant_lanes(scene, reach, batch, board, parts, patience):
    """Take parts and advance the lanes of a scene with compliant contact, as `rigid_lanes`."""
    desk = new_desk(batch.watch)
    room = compliant.new_room(scene.regimes, None, batch.lanes.state[0])
    fresh = springs.new_now()
    part = first_part(board, parts, patience)
    while part >= 0:
        _each_compliant(
            scene, reach, batch, board.cuts[part, 0], board.cuts[part, 1], desk, room, fresh
        )
        part = next_part(board, patience)
    return all_done(board, parts)


@jit
def _each_compliant(scene, reach, batch, start, stop, desk, room, fresh):
    watch, lanes, orders, reports, status = batch
    for i in range(start, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not can_do(watch, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(desk, watch, lanes, i, order)
        schedule = Schedule(desk.times, desk.omegas, desk.phases, order.force, reach, None)
        observe = observe_lane(desk, watch, lanes, i)
        room.now[0] = lanes.sprung[i]
        room.signal.memory[0] = lanes.kept[i].search_level
        if order.fresh:
            room.now[0], room.signal.memory[0] = fresh[0], 0.0
            springs.begin(
                scene.springs,
                scene.gap,
                scene.limit,
                room.now[0],
                state,
                scene.contact,
                observe.counters,
            )
        status[i] = compliant.compliant_stretch(scene, schedule, 0, room, state, observe)
        report_relative(watch, state, report)
        close_interval(desk, watch, observe.level, state, order, report)
        lanes.sprung[i] = room.now[0]
        lanes.kept[i].search_level = room.signal.memory[0]


@jit
def take_rows(desk, watch, series, level, order):
    """Push the recorded states' displacements where the level is read to it, all but the one at the interval's end."""
    count = int(samples_before(order.duration, watch.sample_dt))
    modes = watch.level_shape.shape[0]
    for k in range(count):
        q = 0.0
        for j in range(modes):
            q += watch.level_shape[j] * series.states[k, j]
        desk.block[k] = q
    push_block(level, 0, count)
    desk.clock[0].level = count


@jit
def close_walls(walls, lanes, i, order, distance):
    """Set the half-clearance in use of a lane that goes on; ``distance``: of the absorber from the tip (m)."""
    if walls is None or order.fresh:
        return
    order.gap = possible_gap(order.gap, lanes.kept[i].gap, abs(distance), False)


@jit_view
def observe_steps(seen, series):
    """Return observers that record the states, from which the level is taken later."""
    return Observe(
        clock=seen.clock,
        counters=seen.counters,
        level=None,
        events=None,
        series=series,
        energy=None,
    )


@jit_room
def moreau_lanes(modes, laws, step, batch, board, parts, patience):
    """Take parts and advance their lanes with the Moreau scheme, as `rigid_lanes`; ``modes``, ``laws``, ``step`` as in `moreau_lane`."""
    desk = new_desk(batch.watch)
    series = Series(np.zeros((batch.watch.samples + 1, batch.lanes.state.shape[1])))
    part = first_part(board, parts, patience)
    while part >= 0:
        _each_moreau(
            modes, laws, step, batch, board.cuts[part, 0], board.cuts[part, 1], desk, series
        )
        part = next_part(board, patience)
    return all_done(board, parts)


@jit_room
def _each_moreau(modes, laws, step, batch, start, stop, desk, series):
    watch, lanes, orders, reports, status = batch
    for i in range(start, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not can_do(watch, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(desk, watch, lanes, i, order)
        observe = observe_lane(desk, watch, lanes, i)
        close_walls(laws.walls, lanes, i, order, report.distance)
        now_there = RigidLaws(
            laws.mass,
            with_gap(laws.walls, order.gap),
            with_limit(laws.limit, order.limit),
            laws.spring,
        )
        force = Force(desk.times, desk.omegas, desk.phases, order.force, 0.0, None)
        status[i] = moreau_lane(
            modes, now_there, force, state, step, observe_steps(observe, series)
        )
        take_rows(desk, watch, series, observe.level, order)
        report_relative(watch, state, report)
        close_interval(desk, watch, observe.level, state, order, report)
        lanes.kept[i].gap = order.gap


@jit_room
def runge_kutta_lanes(modes, laws, step, batch, board, parts, patience):
    """Take parts and advance their lanes with the Runge-Kutta method, as `moreau_lanes`. No friction."""
    desk = new_desk(batch.watch)
    series = Series(np.zeros((batch.watch.samples + 1, batch.lanes.state.shape[1])))
    part = first_part(board, parts, patience)
    while part >= 0:
        _each_runge_kutta(
            modes, laws, step, batch, board.cuts[part, 0], board.cuts[part, 1], desk, series
        )
        part = next_part(board, patience)
    return all_done(board, parts)


@jit_room
def _each_runge_kutta(modes, laws, step, batch, start, stop, desk, series):
    watch, lanes, orders, reports, status = batch
    for i in range(start, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not can_do(watch, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(desk, watch, lanes, i, order)
        observe = observe_lane(desk, watch, lanes, i)
        force = Force(desk.times, desk.omegas, desk.phases, order.force, 0.0, None)
        status[i] = runge_kutta_lane(
            modes, laws, force, state, step, observe_steps(observe, series)
        )
        take_rows(desk, watch, series, observe.level, order)
        report_relative(watch, state, report)
        close_interval(desk, watch, observe.level, state, order, report)
