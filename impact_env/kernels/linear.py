"""Closed form for scenes with one linear regime: no absorber, stuck absorber, tuned absorber. No step and no event search.

The windows only renew the expansion of the chirp; the response is exact at every sample whatever their length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.budget import note_time
from impact_env.kernels.energies import add_energy
from impact_env.kernels.energy_account import new_account
from impact_env.kernels.forced import Forced, add_forced, new_forced, solve_response
from impact_env.kernels.jit import jit, jit_room
from impact_env.kernels.observers import DONE, NOT_FINITE, REACHED, STEPS
from impact_env.kernels.segments import Work, last_sample, new_work, sample_state, sample_tip, to_slots, to_state, window_count, window_of
from impact_env.kernels.slots import advance


class Room(NamedTuple):
    """What a lane carries from stretch to stretch, ``work.z``, and scratch for it."""

    work: Work
    forced: Forced
    scratch: NDArray[np.float64]
    still: NDArray[np.float64]


@jit_room
def new_room(regime, state):  # type: ignore[no-untyped-def]
    """Return room for lanes of one scene."""
    size = regime.slots.rows.shape[1]
    return Room(new_work(size), new_forced(regime.slots), np.zeros_like(state), np.zeros(3))


@jit
def linear_stretch(regime, losses, schedule, k, room, clock, counters, level, series, energy):  # type: ignore[no-untyped-def]
    """Propagate over stretch ``k`` of the schedule and return a status code; what the next stretch needs stays in ``room``."""
    slots = regime.slots
    work, forced, scratch, still = room
    count = window_count(schedule, k)
    for w in range(count):
        window = window_of(schedule, k, w, count)
        solve_response(slots, window, forced)
        add_forced(forced.slots, window.omega, -window.half, -1.0, work.z)
        sample_tip(slots, forced.signals, window, work.z, work.u, 0.0, -window.half, window.half, clock, level)
        sample_state(regime, forced, window, work.z, 0.0, still, -window.half, window.half, clock, work.rows[0], series)
        add_energy(regime, forced, window, losses, work.z, 0.0, still, -window.half, window.half, work.rows, scratch, 0, energy)
        advance(slots.rows, slots.table, slots.scale, 2.0 * window.half, work.z)
        add_forced(forced.slots, window.omega, window.half, 1.0, work.z)
        counters.values[STEPS] += 1.0
        if not np.isfinite(work.z[0, 0]):
            return NOT_FINITE
        status = note_time(counters, window.centre + window.half)
        if status != DONE:
            return status
    return DONE


@jit_room
def linear_lane(regime, tip_shape, losses, schedule, state, clock, counters, level, series, energy):  # type: ignore[no-untyped-def]
    """Propagate one lane; ``state`` (2 N_m + 2,) is the start and becomes the end. Return a status code."""
    room, book, status = new_room(regime, state), new_account(energy, 1, regime.slots.rows.shape[1]), DONE
    to_slots(regime.into, state, room.work.z)
    for k in range(schedule.times.shape[0] - 1):
        status = linear_stretch(regime, losses, schedule, k, room, clock, counters, level, series, book)
        if status != DONE:
            break
    if status == DONE:
        counters.values[REACHED] = schedule.times[-1]
    to_state(regime.out, room.work.z, state)
    last_sample(state, tip_shape, counters.values[REACHED], clock, level, series)
    return status
