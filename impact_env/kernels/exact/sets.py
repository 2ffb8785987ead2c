"""The regimes of several absorbers: one for each set of those that move with the beam (joined), the others being apart from it.

Bit a of a set's number says that absorber a is joined, so set 0 is the free beam. Every regime is one of `segments.Regime`, and every guard signal
one of those that a single absorber has: relative displacement of an absorber apart, joint force of a joined one. What differs from absorber to
absorber is a row of weights. The last row, index n, belongs to the place where the level is measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_room, jit_view
from impact_env.kernels.events.signals import MOST_EVALUATIONS, Signal
from impact_env.kernels.exact.rigid_contact import JOINED, largest_kick
from impact_env.kernels.motion.forced import (
    DERIVATIVES,
    SCANNED,
    SIGNALS,
    Forced,
    add_forced,
    solve_guard,
    solve_place,
    solve_response,
)
from impact_env.kernels.motion.segments import Regime, to_slots
from impact_env.kernels.motion.slots import REST, Slots, add
from impact_env.kernels.motion.vector import BLOCK, POINTS, TERMS

Array = NDArray[np.float64]


class Sets(NamedTuple):
    """The regimes of n absorbers, stacked: the first axis of all arrays is the set, 2^n long.

    ``rows`` (2^n, n + 1, ROWS, J) is Slots.rows for each absorber: GUARD its signal, TIP the beam at its place, RELATIVE and REST a force on it; the
    last for the level's place, without such forces. ``table`` to ``errors``: as in `slots.Slots`; ``out``, ``into``: as in `segments.Regime`.
    ``bent`` (2^n, n + 1, n): displacement (m/N) at each place under a unit constant force on absorber b; ``compliance`` (2^n, n, n): relative
    acceleration (1/kg) of absorber a by a unit force on absorber b.
    """

    rows: Array
    table: Array
    scale: Array
    steps: Array
    waves: Array
    turns: Array
    errors: Array
    out: Array
    into: Array
    bent: Array
    compliance: Array


class Absorbers(NamedTuple):
    """Mass (kg), half-clearance (m, infinity: no walls), restitution, friction limit (N, 0: none), each (n,), shapes at their places (n, N_m).

    ``tip_shape`` (N_m,): where the level is measured; ``square`` (N_m,): omega^2.
    """

    mass: Array
    gap: Array
    restitution: Array
    limit: Array
    shapes: Array
    tip_shape: Array
    square: Array


class Flow(NamedTuple):
    """The forced parts of all sets in one window: `forced.Forced` with the axes set and, where they differ, absorber; ``solved`` (2^n,)."""

    slots: Array
    signals: Array
    bound: Array
    carrier: Array
    terms: Array
    solved: NDArray[np.bool_]


class Signals(NamedTuple):
    """`signals.Signal` of each absorber: the first axis of all arrays is the absorber."""

    u: Array
    polynomial: Array
    moving: Array
    block: Array
    memory: Array


@jit_room
def new_flow(sets):
    """Return empty room for the forced parts."""
    count, places, _, size = sets.rows.shape
    slots = np.zeros((count, 4, TERMS, size))
    signals = np.zeros((count, places, *SIGNALS))
    carrier = np.zeros((count, sets.steps.shape[1], 2, POINTS))
    return Flow(
        slots,
        signals,
        np.zeros((count, places, DERIVATIVES + SCANNED)),
        carrier,
        np.zeros((2, TERMS)),
        np.zeros(count, np.bool_),
    )


@jit_room
def new_signals(sets):
    """Return room for the absorbers' signals."""
    n = sets.bent.shape[2]
    size = sets.rows.shape[3]
    memory = np.zeros((n, 2))
    memory[:, 1] = MOST_EVALUATIONS
    return Signals(
        np.zeros((n, 2, size)),
        np.zeros((n, 3)),
        np.zeros((n, 6 * size)),
        np.zeros((n, BLOCK)),
        memory,
    )


@jit_room
def all_kicks(sets):
    """Return `rigid_contact.largest_kick` (2^n, n) of every absorber in every set."""
    count = sets.rows.shape[0]
    n = sets.bent.shape[2]
    kicks = np.zeros((count, n))
    for s in range(count):
        for a in range(n):
            kicks[s, a] = largest_kick(sets.rows[s, a])
    return kicks


@jit_view
def slots_with(sets, s, rows):
    """Return the slots of set s with these rows of weights."""
    return Slots(
        rows,
        sets.table[s],
        sets.scale[s],
        sets.steps[s],
        sets.waves[s],
        sets.turns[s],
        sets.errors[s],
    )


@jit_view
def regime_with(sets, s, rows):
    """Return the regime of set s with these rows of weights."""
    return Regime(slots_with(sets, s, rows), sets.out[s], sets.into[s], 0.0)


@jit_view
def forced_of(flow, s, place):
    """Return the forced part of set s with the signals of an absorber, or of the level's place."""
    return Forced(
        flow.slots[s],
        flow.signals[s, place],
        flow.bound[s, place],
        flow.carrier[s],
        flow.terms,
        None,
    )


@jit_view
def signal_of(signals, a):
    """Return the signal of absorber a."""
    return Signal(
        signals.u[a], signals.polynomial[a], signals.moving[a], signals.block[a], signals.memory[a]
    )


@jit
def is_joined(s, a):
    """Return whether absorber a is in set s."""
    return (s >> a) & 1 != 0


@jit
def joined_set(now):
    """Return the number of the set of joined absorbers."""
    s = 0
    for a in range(now.shape[0]):
        if now[a].regime == JOINED:
            s |= 1 << a
    return s


@jit
def solve_set(sets, absorbers, window, s, flow):
    """Fill the forced part of set s for a window, unless it is known."""
    if flow.solved[s]:
        return
    n = absorbers.mass.shape[0]
    solve_response(slots_with(sets, s, sets.rows[s, n]), window, forced_of(flow, s, n))
    for a in range(n):
        slots = slots_with(sets, s, sets.rows[s, a])
        forced = forced_of(flow, s, a)
        if is_joined(s, a):
            solve_place(slots, forced)
            solve_guard(slots, window, absorbers.mass[a], forced)
        else:
            solve_guard(slots, window, None, forced)
    flow.solved[s] = True


@jit
def bend(sets, now, s, own, bent):
    """Note what the constant forces of all absorbers do in set s: the slots' rest part in own[s], the displacement of each place in ``bent``."""
    n = now.shape[0]
    own[s, REST, :] = 0.0
    own[s, REST + 1, :] = 0.0
    bent[:] = 0.0
    for b in range(n):
        if not is_joined(s, b) and now[b].force != 0.0:
            add(sets.rows[s, b], REST, now[b].force, own[s, REST : REST + 2])
            for place in range(n + 1):
                bent[place] += now[b].force * sets.bent[s, place, b]


@jit
def enter_set(sets, window, s, room, state):
    """Write the free part of the slots of set s for a state and the absorbers' constant forces."""
    z = room.work.z
    bend(sets, room.now, s, room.own, room.bent)
    to_slots(sets.into[s], state, z)
    add_forced(room.flow.slots[s], window.omega, room.now[0].tau, -1.0, z)
    add(room.own[s], REST, -1.0, z)
