"""The regimes of several absorbers: one for each set of those that move with the beam (joined), the others being apart from it.

Bit a of a set's number says that absorber a is joined, so set 0 is the free beam. Every regime is
one of `segments.LinearRegime`, and every guard signal one of those that a single absorber has:
relative displacement of an absorber apart, joint force of a joined one. What differs from absorber
to absorber is a row of weights. The last row, index n, belongs to the place where the level is
measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_view
from impact_env.kernels.events.signals import MOST_SEARCH_EVALUATIONS, Signal
from impact_env.kernels.exact.rigid_contact import JOINED, impulse_response_bound
from impact_env.kernels.motion.forced import (
    DERIVATIVES,
    SCANNED,
    SIGNALS,
    Forced,
    add_forced,
    solve_guard,
    solve_response,
    solve_tip_signal,
)
from impact_env.kernels.motion.modal_system import REST, ModalSystem, add_weighted
from impact_env.kernels.motion.search_block import BLOCK, POINTS, TERMS
from impact_env.kernels.motion.segments import LinearRegime, compute_amplitudes

Array = NDArray[np.float64]


class Sets(NamedTuple):
    """The regimes of n absorbers, stacked: the first axis of all arrays is the set, 2^n long.

    ``rows`` (2^n, n + 1, ROWS, J) is Modal amplitudes.rows for each absorber: GUARD its signal, TIP
    the beam at its place, RELATIVE and REST a force on it; the last for the level's place, without
    such forces. ``table`` to ``errors``: as in `modal_system.ModalSystem`; ``out``, ``into``: as in
    `segments.LinearRegime`. ``deflection`` (2^n, n + 1, n): displacement (m/N) at each place under
    a unit constant force on absorber b; ``compliance`` (2^n, n, n): relative acceleration (1/kg) of
    absorber a by a unit force on absorber b.
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
    deflection: Array
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


class ForcedSets(NamedTuple):
    """Forced responses of all sets in one window: `forced.Forced` with one axis more for the set and, where they differ, for the absorber.

    ``solved`` (2^n,): whether the response of a set is known.
    """

    polynomials: Array
    signals: Array
    bound: Array
    carrier: Array
    terms: Array
    solved: NDArray[np.bool_]


class SignalSet(NamedTuple):
    """The guard signals of all absorbers: `signals.Signal` with one axis more, the absorber, in front."""

    u: Array
    polynomial: Array
    moving: Array
    block: Array
    memory: Array


@jit_allocating
def new_forced_sets(sets):
    """Return memory for the forced responses of all sets."""
    count, places, _, size = sets.rows.shape
    polynomials = np.zeros((count, 4, TERMS, size))
    signals = np.zeros((count, places, *SIGNALS))
    carrier = np.zeros((count, sets.steps.shape[1], 2, POINTS))
    return ForcedSets(
        polynomials,
        signals,
        np.zeros((count, places, DERIVATIVES + SCANNED)),
        carrier,
        np.zeros((2, TERMS)),
        np.zeros(count, np.bool_),
    )


@jit_allocating
def new_signal_set(sets):
    """Return memory for the absorbers' guard signals."""
    n = sets.deflection.shape[2]
    size = sets.rows.shape[3]
    memory = np.zeros((n, 2))
    memory[:, 1] = MOST_SEARCH_EVALUATIONS
    return SignalSet(
        np.zeros((n, 2, size)),
        np.zeros((n, 3)),
        np.zeros((n, 6 * size)),
        np.zeros((n, BLOCK)),
        memory,
    )


@jit_allocating
def compute_impulse_bounds(sets):
    """Return `rigid_contact.impulse_response_bound` (2^n, n) of every absorber in every set."""
    count = sets.rows.shape[0]
    n = sets.deflection.shape[2]
    kicks = np.zeros((count, n))
    for s in range(count):
        for a in range(n):
            kicks[s, a] = impulse_response_bound(sets.rows[s, a])
    return kicks


@jit_view
def system_of_set(sets, s, rows):
    """Return the modal system of set s with the weights ``rows``."""
    return ModalSystem(
        rows,
        sets.table[s],
        sets.scale[s],
        sets.steps[s],
        sets.waves[s],
        sets.turns[s],
        sets.errors[s],
    )


@jit_view
def regime_of_set(sets, s, rows):
    """Return the regime of set s with the weights ``rows``."""
    return LinearRegime(system_of_set(sets, s, rows), sets.out[s], sets.into[s], 0.0)


@jit_view
def forced_of_set(flow, s, place):
    """Return the forced response of set s with the signals of one place: an absorber's, or the level's."""
    return Forced(
        flow.polynomials[s],
        flow.signals[s, place],
        flow.bound[s, place],
        flow.carrier[s],
        flow.terms,
        None,
    )


@jit_view
def signal_of_absorber(signals, a):
    """Return the signal of absorber a."""
    return Signal(
        signals.u[a], signals.polynomial[a], signals.moving[a], signals.block[a], signals.memory[a]
    )


@jit
def is_joined(s, a):
    """Return whether absorber a is in set s."""
    return (s >> a) & 1 != 0


@jit
def find_joined_set(contact_states):
    """Return the number of the set of joined absorbers."""
    s = 0
    for a in range(contact_states.shape[0]):
        if contact_states[a].regime == JOINED:
            s |= 1 << a
    return s


@jit
def update_set_response(sets, absorbers, window, s, flow):
    """Solve the forced response of set s in a window, unless it is known."""
    if flow.solved[s]:
        return
    n = absorbers.mass.shape[0]
    solve_response(system_of_set(sets, s, sets.rows[s, n]), window, forced_of_set(flow, s, n))
    for a in range(n):
        system = system_of_set(sets, s, sets.rows[s, a])
        forced = forced_of_set(flow, s, a)
        if is_joined(s, a):
            solve_tip_signal(system, forced)
            solve_guard(system, window, absorbers.mass[a], forced)
        else:
            solve_guard(system, window, None, forced)
    flow.solved[s] = True


@jit
def update_static_deflection(sets, contact_states, s, own, deflection):
    """Write the static response to the constant forces of all absorbers in set s.

    The amplitudes' rest part goes to own[s], the displacement (m) of each place to ``deflection``.
    """
    n = contact_states.shape[0]
    own[s, REST, :] = 0.0
    own[s, REST + 1, :] = 0.0
    deflection[:] = 0.0
    for b in range(n):
        if not is_joined(s, b) and contact_states[b].force != 0.0:
            add_weighted(sets.rows[s, b], REST, contact_states[b].force, own[s, REST : REST + 2])
            for place in range(n + 1):
                deflection[place] += contact_states[b].force * sets.deflection[s, place, b]


@jit
def enter_set(sets, window, s, workspace, state):
    """Write the free part of the amplitudes of set s for a state and the absorbers' constant forces."""
    z = workspace.buffers.z
    update_static_deflection(
        sets, workspace.contact_states, s, workspace.place_rows, workspace.deflection
    )
    compute_amplitudes(sets.into[s], state, z)
    add_forced(
        workspace.forced_sets.polynomials[s], window.omega, workspace.contact_states[0].tau, -1.0, z
    )
    add_weighted(workspace.place_rows[s], REST, -1.0, z)
