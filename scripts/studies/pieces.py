"""The exact method's parts, each in a compiled loop of its own, so that one call of it can be timed."""

from typing import Any, NamedTuple

import numpy as np

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.events.signals import Course, Guards, Signal, new_signal, signal_at, terms_of
from impact_env.kernels.motion.forced import Forced, Window, fill_carrier, new_forced, solve_forced
from impact_env.kernels.motion.segments import Regime
from impact_env.kernels.motion.slots import advance
from impact_env.kernels.motion.vector import POINTS, Place, Step, begin_orders, scan, turn_2


class Room(NamedTuple):
    """A signal and a window to work on, and slots to advance (2, J)."""

    signal: Signal
    forced: Forced
    window: Window
    z: Any


def make_room(regime: Regime, omega: float, half: float) -> Room:
    """Return room with amplitudes of a millimetre on every slot, forced at ``omega`` in a window of half length ``half`` (s)."""
    signal, forced = new_signal(regime.slots.rows.shape[1]), new_forced(regime.slots, None)
    window = Window(0.0, half, omega, 0.0, 1.0, 0.0)
    solve_forced(regime.slots, window, None, forced)
    signal.u[:] = 1e-3
    return Room(signal, forced, window, np.full_like(signal.u, 1e-3))


@jit
def repeat_scan(calls, slots, room, level):  # type: ignore[no-untyped-def]
    """Look at a block of times, again and again."""
    w, size, total = room.signal.moving, slots.rows.shape[1], 0
    begin_orders(slots.rows, room.signal.u, w, size)
    fill_carrier(slots.steps, room.window.omega, level, room.forced.carrier)
    course, guards = Course(slots, room.forced, room.window.omega, room.signal, 0.0), Guards(-1.0, 1.0, 0, None, False)
    place, step = Place(0.0, 1.0, 0.0, 0), Step(level, slots.steps[level, 0], size, 1e-9, 1e-9)
    for k in range(calls):
        w[0] = 1e-3 + 1e-12 * k
        walls, _ = scan(course, guards, place, step, size)
        total += walls
    return total


@jit
def repeat_turn(calls, slots, room, level):  # type: ignore[no-untyped-def]
    """Move the amplitudes on by a block, again and again."""
    w, size = room.signal.moving, slots.rows.shape[1]
    begin_orders(slots.rows, room.signal.u, w, size)
    turns = slots.turns
    for _ in range(calls):
        turn_2(turns, (level * POINTS + POINTS - 1) * 2 * size, w, size)


@jit
def repeat_refine(calls, slots, room):  # type: ignore[no-untyped-def]
    """Evaluate the signal exactly at another offset each time."""
    total, step = 0.0, room.window.half / calls
    terms = terms_of(Course(slots, room.forced, room.window.omega, room.signal, 0.0))
    for k in range(calls):
        y, v, a, j = signal_at(terms, k * step)
        total += y + v + a + j
    return total


@jit
def repeat_advance(calls, slots, room):  # type: ignore[no-untyped-def]
    """Advance slots by another offset each time."""
    step = room.window.half / calls
    for k in range(calls):
        advance(slots.rows, slots.table, slots.scale, k * step, room.z)
        room.z[0, 0] = 1e-3


@jit
def repeat_solve(calls, slots, room):  # type: ignore[no-untyped-def]
    """Solve a window's forced part, again and again."""
    for _ in range(calls):
        solve_forced(slots, room.window, None, room.forced)
