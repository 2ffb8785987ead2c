"""Closed form for scenes with one linear regime: no absorber, stuck absorber, tuned absorber. No step and no event search.

The windows only renew the expansion of the chirp; the response is exact at every sample whatever their length.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_inline, jit_room
from impact_env.kernels.energy.account import new_account, observe_with
from impact_env.kernels.energy.energies import add_energy
from impact_env.kernels.exact.budget import note_time
from impact_env.kernels.motion.forced import Forced, add_forced, new_forced, solve_response
from impact_env.kernels.motion.lines import leap_over, solve_lines
from impact_env.kernels.motion.observers import DONE, MOTION, NOT_FINITE
from impact_env.kernels.motion.segments import (
    Losses,
    Regime,
    Stretch,
    Work,
    is_due,
    last_sample,
    new_work,
    own_schedule,
    sample_level,
    sample_state,
    to_slots,
    to_state,
    window_count,
    window_of,
)
from impact_env.kernels.motion.slots import REST, add, advance


class Linear(NamedTuple):
    """A scene of one regime, and what the energy balance needs; the acceleration of the absorber's weight (m/s^2), None without."""

    regime: Regime
    losses: Losses
    gravity: float | None


class Room(NamedTuple):
    """What a lane carries from stretch to stretch, ``work.z``, and scratch for it; ``still`` (1,): a MOTION record, of no motion."""

    work: Work
    forced: Forced
    scratch: NDArray[np.float64]
    still: NDArray[Any]


@jit_room
def new_room(regime, load, state):
    """Return room for lanes of one scene under a load, None: a chirp."""
    size = regime.slots.rows.shape[1]
    return Room(
        new_work(size), new_forced(regime.slots, load), np.zeros_like(state), np.zeros(1, MOTION)
    )


@jit
def bend_by_weight(regime, gravity, sign, z):
    """Add to slots, times ``sign``, what the absorber's weight bends; return its acceleration, 0 without."""
    if gravity is None:
        return 0.0
    add(regime.slots.rows, REST, sign * gravity, z)
    return gravity


@jit_inline
def pass_unobserved(scene, window, room, observe):
    """Move the slots over a window of straight lines in which nothing is observed; return False where it is none."""
    load = window.load
    z = room.work.z
    if load is None:
        return False
    if not load.straight[0] or is_due(
        window, observe.clock, observe.level, observe.series, observe.energy
    ):
        return False
    bend_by_weight(scene.regime, scene.gravity, -1.0, z)
    passed = leap_over(load, scene.regime.slots, window, room.forced, room.work.rows[0], z)
    bend_by_weight(scene.regime, scene.gravity, 1.0, z)
    return passed


@jit_inline
def pass_window(scene, window, room, observe):
    """Move the slots over a window, and let the observers see it."""
    regime = scene.regime
    slots = scene.regime.slots
    work = room.work
    forced = room.forced
    if not solve_lines(window.load, slots, window, None, False, forced):
        solve_response(slots, window, forced)
    add_forced(forced.slots, window.omega, -window.half, -1.0, work.z)
    weight = bend_by_weight(regime, scene.gravity, -1.0, work.z)
    stretch = Stretch(
        regime,
        forced,
        window,
        work,
        weight,
        regime.tip_rest * weight,
        room.still,
        -window.half,
        window.half,
    )
    sample_level(stretch, observe.clock, observe.level)
    sample_state(stretch, observe.clock, observe.series)
    add_energy(stretch, scene.losses, room.scratch, 0, observe.energy)
    advance(slots.rows, slots.table, slots.scale, 2.0 * window.half, work.z)
    add_forced(forced.slots, window.omega, window.half, 1.0, work.z)
    bend_by_weight(regime, scene.gravity, 1.0, work.z)


@jit_inline
def linear_stretch(scene, schedule, k, room, observe):
    """Propagate over stretch ``k`` of the schedule and return a status code; what the next stretch needs stays in ``room``."""
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        if not pass_unobserved(scene, window, room, observe):
            pass_window(scene, window, room, observe)
        observe.counters.counts.steps += 1
        if not np.isfinite(room.work.z[0, 0]):
            return NOT_FINITE
        status = note_time(observe.counters, window.centre + window.half)
        if status != DONE:
            return status
    return DONE


@jit_room
def linear_lane(scene, plan, state, observe):
    """Propagate one lane of a `Linear` scene and return a status code; ``state`` (2 N_m + 2,) is the start and becomes the end."""
    schedule = own_schedule(plan)
    regime = scene.regime
    room = new_room(scene.regime, schedule.load, state)
    status = DONE
    counts = observe.counters.counts
    seen = observe_with(observe, new_account(observe.energy, 1, regime.slots.rows.shape[1]))
    to_slots(regime.into, state, room.work.z)
    for k in range(schedule.times.shape[0] - 1):
        status = linear_stretch(scene, schedule, k, room, seen)
        if status != DONE:
            break
    if status == DONE:
        counts.reached = schedule.times[-1]
    to_state(regime.out, room.work.z, state)
    last_sample(
        state, scene.losses.tip_shape, counts.reached, observe.clock, observe.level, observe.series
    )
    return status
