"""Control intervals of many lanes in one call, one function for each family of integrators.

Lanes are independent: any split of them over threads gives the same numbers. Each thread has memory
of its own (`new_rigid_memory` and its like), made once and used in every call: its allocation takes
as long as the quarter of a period of several lanes.

In: a scene, the lanes with an order each (`interval.Batch`), and a queue of parts of the lanes.
Out: the lanes at the interval's end, and their reports.

Threads. A thread that sleeps is woken through the interpreter's lock: that takes as long as a step
of some hundred lanes. So a helper thread polls in compiled code for a while after its work, and
takes the next call's parts from the `WorkQueue` itself. Passive-v0 with 256 and 1,024 lanes takes
1.5 and 1.4 times as long a step with a pool of Python's threads instead (two cores). Which thread
does which part, and whether there are helpers at all, changes no number.

New orders: a new friction limit or a jump of the force's amplitude. A sliding absorber continues to
slide in its direction, with the new friction. A joined absorber stays joined if the joint force is
within the new bounds of friction and wall, and else slips or leaves the wall. Positions and
velocities do not jump (paper, Eqs. signorini and coulomb: friction is a force, no impulse). A slip
that begins just at the change, without relative velocity, needs no special case: if the new
friction can hold it, the search finds a reversal at once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import INTEGER, jit, jit_allocating, jit_view, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index
from impact_env.kernels.control.interval import (
    IntervalScratch,
    close_interval,
    expand_interval_load,
    is_order_valid,
    limit_gap,
    new_interval_load,
    new_interval_scratch,
    open_interval,
    replace_gap,
    replace_limit,
    report_state,
    view_observers,
)
from impact_env.kernels.events.signals import HIT_HIGH, HIT_LOW
from impact_env.kernels.exact.compliant import (
    init_compliant_contact,
    integrate_compliant_section,
    new_compliant_state,
    new_compliant_workspace,
)
from impact_env.kernels.exact.linear import integrate_linear_section, new_linear_workspace
from impact_env.kernels.exact.rigid import (
    Rigid,
    add_forced_part,
    compute_joint_force,
    integrate_rigid_section,
    new_rigid_workspace,
    release_absorber,
    update_free_response,
    update_joined_response,
    write_current_state,
)
from impact_env.kernels.exact.rigid_contact import (
    FREE,
    JOINT_FORCE_TOL,
    ContactLaw,
    compute_static_limit,
    compute_tip_motion,
    find_joint_bounds,
    has_walls,
    new_contact_states,
    update_slip_direction,
)
from impact_env.kernels.motion.loads import Schedule, count_windows, expand_window, new_no_loads
from impact_env.kernels.motion.modal_system import copy_amplitudes
from impact_env.kernels.motion.observers import (
    DONE,
    ORDER_REFUSED,
    Observers,
    StateSeries,
    push_samples,
)
from impact_env.kernels.motion.segments import (
    compute_amplitudes,
    compute_state,
    count_samples_before,
)
from impact_env.kernels.stepping.grid import DriveForce
from impact_env.kernels.stepping.moreau import RigidLaws, moreau_lane
from impact_env.kernels.stepping.runge_kutta import runge_kutta_lane

# indices in `WorkQueue.words`: parts that no thread has taken yet, and parts that are done; each in
# a cache line of its own
PARTS_LEFT = 0
PARTS_DONE = 16
MOST_POLLS = 1 << 15  # of the other threads' last parts, before the caller returns to Python


class WorkQueue(NamedTuple):
    """Memory shared by the threads of one call.

    ``words`` (32,) are read and changed atomically. Part p consists of the lanes [low, high) in
    ``cuts[p]``; ``cuts`` (L, 2) has room for a part for each lane.
    """

    words: NDArray[np.int64]
    cuts: NDArray[np.int64]


class LaneMemory(NamedTuple):
    """Memory of one thread that advances lanes one after the other."""

    scratch: IntervalScratch  # of the interval
    load: Any  # `LoadWorkspace` of the disturbance, None without
    workspace: Any  # of the scene's exact method
    start: NDArray[Any]  # (1,) contact state with which a run begins


class SteppingMemory(NamedTuple):
    """Memory of one thread that advances lanes by a stepping method."""

    scratch: IntervalScratch  # of the interval
    series: StateSeries  # states at the samples
    load: Any  # `LoadPieces` without sources: the chirp of one force


def new_work_queue(lanes: int) -> WorkQueue:
    """Return an empty queue for a number of lanes."""
    return WorkQueue(np.zeros(32, dtype=np.int64), np.zeros((lanes, 2), dtype=np.int64))


@vector_code(INTEGER)
def _atomic_add(code: Code, words, place: Index, change: Index):
    """Add ``change`` to a word and return its former value."""
    return code.atomic_rmw("add", words, place, change)


@vector_code(INTEGER)
def _atomic_exchange(code: Code, words, place: Index, value: Index):
    """Set a word to ``value`` and return its former value."""
    return code.atomic_rmw("xchg", words, place, value)


@jit
def take_first_part(queue, parts, patience):
    """Offer ``parts`` parts to all threads (0: none, from a helper thread), and take a part.

    Returns the number of the part, or -1 as `take_next_part` does.
    """
    if parts > 0:
        _atomic_exchange(queue.words, PARTS_DONE, 0)
        _atomic_exchange(queue.words, PARTS_LEFT, parts)
    return _take_part(queue, patience)


@jit
def take_next_part(queue, patience):
    """Count a part as done, and return the number of another part.

    The result is -1 if none was available in ``patience`` + 1 polls.
    """
    _atomic_add(queue.words, PARTS_DONE, 1)
    return _take_part(queue, patience)


@jit
def _take_part(queue, patience):
    """Return the number of a part that no thread has taken, -1 after ``patience`` + 1 polls."""
    for _ in range(patience + 1):
        if _atomic_add(queue.words, PARTS_LEFT, 0) > 0:
            part = _atomic_add(queue.words, PARTS_LEFT, -1) - 1
            if part >= 0:  # else another thread was quicker
                return part
    return -1


@jit
def wait_until_done(queue, parts):
    """Return whether all ``parts`` are done, after at most MOST_POLLS polls."""
    polls = 0
    while parts > 0 and _atomic_add(queue.words, PARTS_DONE, 0) != parts:
        if polls == MOST_POLLS:
            return False
        polls += 1
    return True


@jit
def recheck_stick(scene, window, workspace, state):
    """Release a joined absorber if the joint force is beyond its bounds.

    The amplitudes in ``workspace`` include the forced part, before and after. At a bound the
    absorber sticks, and the rate of the joint force decides.
    """
    contact_state = workspace.contact_states[0]
    buffers = workspace.buffers
    update_joined_response(scene, window, workspace)
    copy_amplitudes(buffers.z, buffers.rows[1])
    add_forced_part(window, contact_state.tau, -1.0, workspace)
    f, scale = compute_joint_force(
        scene.joined,
        workspace.joined_forced,
        window.omega,
        contact_state.tau,
        scene.contact,
        buffers,
    )
    low, high = find_joint_bounds(compute_static_limit(scene.contact), contact_state.side)
    slack = JOINT_FORCE_TOL * scale
    if low - slack <= f <= high + slack:
        copy_amplitudes(buffers.rows[1], buffers.z)  # as before, to the last digit
        return
    update_free_response(scene, window, workspace)
    release_absorber(scene, window, workspace, state, HIT_HIGH if f > high else HIT_LOW, None)
    add_forced_part(window, contact_state.tau, 1.0, workspace)


@jit
def apply_order_change(scene, limit, before, jumps, schedule, workspace, state):
    """Continue a lane with the friction ``limit`` (N, or None) of its new order.

    ``before`` (N): the limit of the last interval; ``jumps``: whether the amplitude of the force
    changes; ``schedule``: that of the new interval. The contact state and the amplitudes in
    ``workspace`` change.
    """
    contact_state = workspace.contact_states[0]
    other = False
    lower = False
    if limit is not None:
        other = limit != before
        lower = limit < before
    if contact_state.regime == FREE:
        if other:
            update_slip_direction(
                scene.free.system, limit, contact_state.sign, contact_state, workspace.buffers.z
            )
    elif jumps or lower:
        window = expand_window(schedule, 0, 0, count_windows(schedule, 0))
        contact_state.tau = -window.half
        workspace.solved[:] = False
        recheck_stick(scene, window, workspace, state)


@jit
def update_rigid_gap(walls, order, contact_state, gap, relative):
    """Set ``order.gap`` (m) to the half-clearance that the cavity can take (`limit_gap`).

    ``gap`` (m): half-clearance of the last interval; ``relative`` (m): absorber less tip. Where the
    gap changes, an absorber that touches a wall touches it no longer. Returns True if an absorber
    that a wall held is freed, so that its regime must be found again.
    """
    if not has_walls(walls):
        return False
    order.gap = limit_gap(order.gap, gap, abs(relative), contact_state.side != 0.0)
    if order.gap == gap or contact_state.side == 0.0:
        return False
    contact_state.side = 0.0
    return contact_state.regime != FREE


@jit
def load_lane(walls, lanes, i, order, distance, start, workspace):
    """Load lane i into the workspace; return whether its regime must be found from its state.

    This is so for a new run, and for an absorber held by a wall that has moved away. ``order.gap``
    is set as in `update_rigid_gap`. ``distance`` (m): absorber less tip; ``start`` (1,): contact
    state with which a run begins.
    """
    begins = order.fresh
    workspace.contact_states[0] = lanes.rigid[i]
    workspace.signal.memory[0] = lanes.last_order[i].search_level
    if not begins:
        copy_amplitudes(lanes.z[i], workspace.buffers.z)
        begins = update_rigid_gap(
            walls, order, workspace.contact_states[0], lanes.last_order[i].gap, distance
        )
    if begins:
        workspace.contact_states[0] = start[0]
        workspace.signal.memory[0] = 0.0
    return begins


@jit
def report_rigid(settings, scene, workspace, state, report):
    """Write the lane's motion in ``workspace`` to ``state`` (S,), and the state to ``report``."""
    write_current_state(scene, workspace, state)
    contact_state = workspace.contact_states[0]
    half = state.shape[0] // 2
    tip, tip_velocity = compute_tip_motion(settings, state)
    if contact_state.regime != FREE:
        # equal to the last digit, so that a run from this state begins in the joined regime
        state[2 * half - 1] = tip_velocity
        report_state(settings, state, contact_state.offset, 0.0, report)
    else:
        report_state(
            settings, state, state[half - 1] - tip, state[2 * half - 1] - tip_velocity, report
        )


@jit_allocating
def new_rigid_memory(scene, batch):
    """Return the memory of one thread for lanes of a scene with rigid contact."""
    scratch = new_interval_scratch(batch.settings)
    load = new_interval_load(batch.settings)
    workspace = new_rigid_workspace(scene.free, scene.joined, load, batch.lanes.state[0])
    start = new_contact_states(1)
    start[0] = workspace.contact_states[0]
    return LaneMemory(scratch, load, workspace, start)


@jit
def rigid_lanes(scene, reach, batch, memory, queue, parts, patience):
    """Advance lanes of a scene with rigid contact, in parts that are taken from the queue.

    Returns whether all parts are done: False if other threads still work after MOST_POLLS polls.
    ``reach`` (s): longest window; ``batch``: `Batch`, whose lanes, orders, reports and status codes
    are written; ``memory``: `LaneMemory` of this thread. The caller passes the number of ``parts``
    in the queue, a helper thread 0; ``patience``: further polls of an empty queue before a thread
    stops. Walls' gap and friction limit are those of a lane's order.
    """
    part = take_first_part(queue, parts, patience)
    while part >= 0:
        _advance_rigid_lanes(scene, reach, batch, queue.cuts[part, 0], queue.cuts[part, 1], memory)
        part = take_next_part(queue, patience)
    return wait_until_done(queue, parts)


@jit
def _advance_rigid_lanes(scene, reach, batch, first, stop, memory):
    """Advance lanes [first, stop) with rigid contact by an interval and report."""
    settings, lanes, orders, reports, status = batch
    scratch, load, workspace, start = memory
    free, joined, contact, losses = scene
    for i in range(first, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not is_order_valid(settings, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(scratch, settings, lanes, i, order)
        begins = load_lane(contact.walls, lanes, i, order, report.distance, start, workspace)
        walls = replace_gap(contact.walls, order.gap)
        limit = replace_limit(contact.limit, order.limit)
        ordered_scene = Rigid(
            free,
            joined,
            ContactLaw(
                contact.mass,
                contact.compliance,
                contact.tip_shape,
                walls,
                limit,
                0.0,
                contact.static_ratio,
            ),
            losses,
        )
        sections = 1
        disturbance = batch.settings.disturbance
        if disturbance is not None:
            sections = expand_interval_load(disturbance, order, scratch.times, load)
        schedule = Schedule(scratch.times, scratch.omegas, scratch.phases, order.force, reach, load)
        observers = view_observers(scratch, settings, lanes, i)
        if not begins:
            last = lanes.last_order[i]
            apply_order_change(
                ordered_scene,
                limit,
                last.limit,
                order.force != last.force,
                schedule,
                workspace,
                state,
            )
        for k in range(sections):
            status[i] = integrate_rigid_section(
                ordered_scene, schedule, k, k > 0 or not begins, workspace, state, observers
            )
            if status[i] != DONE:
                break
        report_rigid(settings, scene, workspace, state, report)
        close_interval(scratch, settings, observers.level, state, order, report)
        lanes.rigid[i] = workspace.contact_states[0]
        used = lanes.last_order[i]
        used.gap = order.gap
        used.limit = order.limit
        used.force = order.force
        used.search_level = workspace.signal.memory[0]
        copy_amplitudes(workspace.buffers.z, lanes.z[i])


@jit_allocating
def new_linear_memory(scene, batch):
    """Return the memory of one thread for lanes of a scene with one linear regime."""
    load = new_interval_load(batch.settings)
    return LaneMemory(
        new_interval_scratch(batch.settings),
        load,
        new_linear_workspace(scene.regime, load, batch.lanes.state[0]),
        new_contact_states(1),
    )


@jit
def linear_lanes(scene, reach, batch, memory, queue, parts, patience):
    """Take parts and advance the lanes of a scene with one linear regime, as `rigid_lanes`."""
    part = take_first_part(queue, parts, patience)
    while part >= 0:
        _advance_linear_lanes(scene, reach, batch, queue.cuts[part, 0], queue.cuts[part, 1], memory)
        part = take_next_part(queue, patience)
    return wait_until_done(queue, parts)


@jit
def _advance_linear_lanes(scene, reach, batch, first, stop, memory):
    """Advance lanes [first, stop) of one linear regime by an interval and report."""
    settings, lanes, orders, reports, status = batch
    scratch, load, workspace, _ = memory
    regime = scene.regime
    buffers = workspace.buffers
    for i in range(first, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not is_order_valid(settings, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(scratch, settings, lanes, i, order)
        if order.fresh:
            compute_amplitudes(regime.into, state, buffers.z)
        else:
            copy_amplitudes(lanes.z[i], buffers.z)
        sections = 1
        disturbance = batch.settings.disturbance
        if disturbance is not None:
            sections = expand_interval_load(disturbance, order, scratch.times, load)
        schedule = Schedule(scratch.times, scratch.omegas, scratch.phases, order.force, reach, load)
        observers = view_observers(scratch, settings, lanes, i)
        for k in range(sections):
            status[i] = integrate_linear_section(scene, schedule, k, workspace, observers)
            if status[i] != DONE:
                break
        compute_state(regime.out, buffers.z, state)
        report_relative(settings, state, report)
        close_interval(scratch, settings, observers.level, state, order, report)
        copy_amplitudes(buffers.z, lanes.z[i])


@jit
def report_relative(settings, state, report):
    """Report the state as `report_state` does, with the relative motion computed from it.

    Without an absorber the relative motion is 0.
    """
    half = state.shape[0] // 2
    if settings.mass > 0.0:
        tip, tip_velocity = compute_tip_motion(settings, state)
        report_state(
            settings, state, state[half - 1] - tip, state[2 * half - 1] - tip_velocity, report
        )
    else:
        report_state(settings, state, 0.0, 0.0, report)


@jit_allocating
def new_compliant_memory(scene, batch):
    """Return the memory of one thread for lanes of a scene with compliant contact."""
    return LaneMemory(
        new_interval_scratch(batch.settings),
        None,
        new_compliant_workspace(scene.regimes, None, batch.lanes.state[0]),
        new_compliant_state(),
    )


@jit
def compliant_lanes(scene, reach, batch, memory, queue, parts, patience):
    """Take parts and advance the lanes of a scene with compliant contact, as `rigid_lanes`."""
    part = take_first_part(queue, parts, patience)
    while part >= 0:
        _advance_compliant_lanes(
            scene, reach, batch, queue.cuts[part, 0], queue.cuts[part, 1], memory
        )
        part = take_next_part(queue, patience)
    return wait_until_done(queue, parts)


@jit
def _advance_compliant_lanes(scene, reach, batch, first, stop, memory):
    """Advance lanes [first, stop) with compliant contact by an interval and report."""
    settings, lanes, orders, reports, status = batch
    scratch, _, workspace, start = memory
    for i in range(first, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not is_order_valid(settings, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(scratch, settings, lanes, i, order)
        schedule = Schedule(scratch.times, scratch.omegas, scratch.phases, order.force, reach, None)
        observers = view_observers(scratch, settings, lanes, i)
        workspace.contact_states[0] = lanes.compliant[i]
        workspace.signal.memory[0] = lanes.last_order[i].search_level
        if order.fresh:
            workspace.contact_states[0] = start[0]
            workspace.signal.memory[0] = 0.0
            init_compliant_contact(
                scene.springs,
                scene.gap,
                scene.limit,
                workspace.contact_states[0],
                state,
                scene.contact,
                observers.counters,
            )
        status[i] = integrate_compliant_section(scene, schedule, 0, workspace, state, observers)
        report_relative(settings, state, report)
        close_interval(scratch, settings, observers.level, state, order, report)
        lanes.compliant[i] = workspace.contact_states[0]
        lanes.last_order[i].search_level = workspace.signal.memory[0]


@jit
def push_recorded_samples(scratch, settings, series, level, order):
    """Add the displacements of the recorded states to the level, and to ``scratch.block``.

    The displacement at the interval's end is left out.
    """
    count = int(count_samples_before(order.duration, settings.sample_dt))
    modes = settings.level_shape.shape[0]
    for k in range(count):
        q = 0.0
        for j in range(modes):
            q += settings.level_shape[j] * series.states[k, j]
        scratch.block[k] = q
    push_samples(level, 0, count)
    scratch.clock[0].level = count


@jit_view
def replace_level_by_series(observers, series):
    """Return observers that record the states, from which the level is computed later."""
    return Observers(
        clock=observers.clock,
        counters=observers.counters,
        level=None,
        events=None,
        series=series,
        energy=None,
    )


@jit_allocating
def new_stepping_memory(batch):
    """Return the memory of one thread for lanes that are advanced by a method with a fixed step."""
    return SteppingMemory(
        new_interval_scratch(batch.settings),
        StateSeries(np.zeros((batch.settings.samples + 1, batch.lanes.state.shape[1]))),
        new_no_loads(),
    )


@jit_allocating
def moreau_lanes(modes, laws, step, batch, memory, queue, parts, patience):
    """Take parts and advance their lanes with the Moreau scheme, as `rigid_lanes` does.

    ``modes``, ``laws`` and ``step`` are those of `moreau_lane`.
    """
    part = take_first_part(queue, parts, patience)
    while part >= 0:
        _advance_moreau_lanes(
            modes, laws, step, batch, queue.cuts[part, 0], queue.cuts[part, 1], memory
        )
        part = take_next_part(queue, patience)
    return wait_until_done(queue, parts)


@jit_allocating
def _advance_moreau_lanes(modes, laws, step, batch, first, stop, memory):
    """Advance lanes [first, stop) by the Moreau scheme by an interval and report."""
    settings, lanes, orders, reports, status = batch
    scratch, series, load = memory
    for i in range(first, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not is_order_valid(settings, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(scratch, settings, lanes, i, order)
        observers = view_observers(scratch, settings, lanes, i)
        if not order.fresh and has_walls(laws.walls):
            gap = lanes.last_order[i].gap
            order.gap = limit_gap(order.gap, gap, abs(report.distance), False)
        ordered_scene = RigidLaws(
            laws.mass,
            replace_gap(laws.walls, order.gap),
            order.limit if laws.limit > 0.0 else 0.0,
            laws.spring,
        )
        force = DriveForce(scratch.times, scratch.omegas, scratch.phases, order.force, 0.0, load)
        status[i] = moreau_lane(
            modes, ordered_scene, force, state, step, replace_level_by_series(observers, series)
        )
        push_recorded_samples(scratch, settings, series, observers.level, order)
        report_relative(settings, state, report)
        close_interval(scratch, settings, observers.level, state, order, report)
        lanes.last_order[i].gap = order.gap


@jit_allocating
def runge_kutta_lanes(modes, laws, step, batch, memory, queue, parts, patience):
    """Take parts and advance their lanes with the Runge-Kutta method, as `moreau_lanes` does.

    Friction is not available.
    """
    part = take_first_part(queue, parts, patience)
    while part >= 0:
        _advance_runge_kutta_lanes(
            modes, laws, step, batch, queue.cuts[part, 0], queue.cuts[part, 1], memory
        )
        part = take_next_part(queue, patience)
    return wait_until_done(queue, parts)


@jit_allocating
def _advance_runge_kutta_lanes(modes, laws, step, batch, first, stop, memory):
    """Advance lanes [first, stop) by the Runge-Kutta method by an interval and report."""
    settings, lanes, orders, reports, status = batch
    scratch, series, load = memory
    for i in range(first, stop):
        order = orders[i]
        report = reports[i]
        state = lanes.state[i]
        if not is_order_valid(settings, order):
            status[i] = ORDER_REFUSED
            continue
        open_interval(scratch, settings, lanes, i, order)
        observers = view_observers(scratch, settings, lanes, i)
        force = DriveForce(scratch.times, scratch.omegas, scratch.phases, order.force, 0.0, load)
        status[i] = runge_kutta_lane(
            modes, laws, force, state, step, replace_level_by_series(observers, series)
        )
        push_recorded_samples(scratch, settings, series, observers.level, order)
        report_relative(settings, state, report)
        close_interval(scratch, settings, observers.level, state, order, report)
