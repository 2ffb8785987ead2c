"""The regimes of several absorbers.

Each set of absorbers that move with the beam (joined) has one regime, in which the others are apart
from the beam.

There are 2^n sets of n absorbers, and nearly all time is spent in few of them. So a run has K
positions in memory for regimes. Position 0 always holds the regime without joined absorbers. The
others are filled when a set is first needed, by a function in Python (`regime_sets.RegimePlaces`);
if all are in use, the least recently used one is filled again. A regime is as
`segments.LinearRegime`, and a guard signal as that of a single absorber: relative displacement of
an absorber apart, joint force of a joined one. The weights (`Sets.rows`) differ between absorbers;
the last ones, index n, belong to the place on the beam where the level is measured.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_view
from impact_env.kernels.compiling.records import FLAG, INTEGER, record_type
from impact_env.kernels.events.signals import BLOCK, MOST_SEARCH_EVALUATIONS, Signal
from impact_env.kernels.exact.rigid_contact import JOINED
from impact_env.kernels.motion.forced import (
    DERIVATIVES,
    SCANNED,
    SIGNALS,
    Forced,
    add_forced,
    compute_base_motion,
    integrate_base,
    solve_guard,
    solve_response,
    solve_tip_signal,
)
from impact_env.kernels.motion.loads import TERMS
from impact_env.kernels.motion.modal_system import (
    GUARD,
    POINTS,
    REST,
    ModalSystem,
    add_weighted,
    apply_weights,
)
from impact_env.kernels.motion.observers import call_function
from impact_env.kernels.motion.segments import compute_amplitudes

Array = NDArray[np.float64]

# the current set, and how a position is filled for another one
SET_REQUEST = record_type(
    place=INTEGER,  # position of the current set
    uses=INTEGER,  # uses and fillings of positions so far
    fill_address=INTEGER,  # address of the function that fills a position for `Sets.wanted`
    failed=FLAG,  # whether this function has failed
)


class Sets(NamedTuple):
    """The regimes of n absorbers at K positions, each for one set of joined absorbers.

    Row a of ``rows`` has the weights of absorber a: GUARD its signal, TIP the beam at its place,
    RELATIVE and REST a force on it; row n those of the level's place, without such forces.
    """

    rows: Array  # (K, n + 1, ROWS, J) as `ModalSystem.rows`
    table: Array  # (K, ...) as `ModalSystem.table`
    scale: Array  # as `ModalSystem.scale`
    steps: Array  # as `ModalSystem.steps`
    waves: Array  # as `ModalSystem.waves`
    turns: Array  # as `ModalSystem.turns`
    errors: Array  # as `ModalSystem.errors`
    out: Array  # (K, ...) as `segments.LinearRegime.out`
    into: Array  # as `segments.LinearRegime.into`
    deflection: Array  # (K, n + 1, n) at each place under a unit force on absorber b (m/N)
    compliance: Array  # (K, n, n) relative acceleration of a by a unit force on b (1/kg)
    velocity_bound: Array  # (K, n, n) of the rate of a's signal after a unit impulse on b
    acceleration_bound: Array  # (K, n, n) of its second derivative after a unit impulse on b
    joined: NDArray[np.bool_]  # (K, n) whether an absorber is joined in the set
    last_use: NDArray[np.int64]  # (K,) number of the last use of a position, 0: empty
    last_fill: NDArray[np.int64]  # (K,) number of its last filling
    wanted: NDArray[np.bool_]  # (n,) set to be filled
    request: Any  # a SET_REQUEST record


class Absorbers(NamedTuple):
    """Laws of n absorbers and mode shapes at their places."""

    mass: Array  # (n,) kg
    gap: Array  # (n,) half-clearance (m), infinity: no walls
    restitution: Array  # (n,)
    # (n,) relative velocity (m/s) above which the restitution falls, infinity: constant
    yield_velocity: Array
    limit: Array  # (n,) friction limit (N), 0: none
    gravity: Array  # (n,) weight over mass, towards the lower wall (m/s^2)
    shapes: Array  # (n, N_m) at the absorbers' places
    tip_shape: Array  # (N_m,) where the level is measured
    square: Array  # (N_m,) omega^2 of the modes (1/s^2)


class ForcedSets(NamedTuple):
    """Forced responses of the regimes in one window, as in `forced.Forced`."""

    polynomials: Array  # (K, 4, TERMS, J)
    signals: Array  # (K, n + 1, 2, TERMS, 2, 4) of each absorber and the level
    bound: Array  # (K, n + 1, DERIVATIVES + SCANNED)
    carrier: Array  # (K, L, 2, POINTS)
    terms: Array  # (2, TERMS)
    # (K, n + 1) whether an absorber's signal is known; index n: the response itself
    solved: NDArray[np.bool_]


class SignalSet(NamedTuple):
    """The guard signals of n absorbers: `signals.Signal` with a first axis for the absorber."""

    u: Array  # (n, 2, J)
    polynomial: Array  # (n, 3)
    moving: Array  # (n, 6 J)
    block: Array  # (n, BLOCK)
    memory: Array  # (n, 2)


@jit_allocating
def new_forced_sets(sets):
    """Return memory for the forced responses of all regimes."""
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
        np.zeros((count, places), np.bool_),
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


@jit_view
def view_set_system(sets, s, rows):
    """Return the modal system of the set at position s with the weights ``rows`` (ROWS, J)."""
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
def view_set_response(flow, s, place):
    """Return the forced response of the set at position s with the signals of one place.

    ``place``: number of an absorber, or n for the level's place on the beam. ``flow``:
    `ForcedSets`.
    """
    return Forced(
        flow.polynomials[s],
        flow.signals[s, place],
        flow.bound[s, place],
        flow.carrier[s],
        flow.terms,
        None,
    )


@jit_view
def view_signal(signals, a):
    """Return the guard signal of absorber a, a view of ``signals`` (`SignalSet`)."""
    return Signal(
        signals.u[a], signals.polynomial[a], signals.moving[a], signals.block[a], signals.memory[a]
    )


@jit
def is_joined(sets, s, a):
    """Return whether absorber a is joined in the set at position s."""
    return sets.joined[s, a]


@jit
def _is_current_set(sets, s, contact_states):
    """Return whether the absorbers that are joined now are the set at position s."""
    same = True
    for a in range(contact_states.shape[0]):
        same = same and sets.joined[s, a] == (contact_states[a].regime == JOINED)
    return same


@jit
def find_joined_set(sets, contact_states):
    """Return the position of the set of joined absorbers.

    It becomes the current set. If its regime is not stored, a function in Python makes it, which
    may replace that of another set; ``sets.request.failed`` then says whether this failed.
    """
    request = sets.request
    if _is_current_set(sets, request.place, contact_states):
        return request.place
    place = -1
    for s in range(sets.joined.shape[0]):
        if sets.last_use[s] > 0 and _is_current_set(sets, s, contact_states):
            place = s
            break
    if place < 0:
        for a in range(contact_states.shape[0]):
            sets.wanted[a] = contact_states[a].regime == JOINED
        call_function(request.fill_address)
        place = request.place
    request.uses += 1
    request.place = place
    sets.last_use[place] = request.uses
    return place


@jit
def update_set_response(sets, window, s, workspace):
    """Solve the forced response of the set at position s in a window, unless it is known.

    It is written to ``workspace.forced_sets``. If the position was filled anew, its
    ``workspace.place_rows`` are written as well.
    """
    n = sets.deflection.shape[2]
    flow = workspace.forced_sets
    if workspace.last_fill[s] != sets.last_fill[s]:
        workspace.last_fill[s] = sets.last_fill[s]
        rows = sets.rows[s, n]
        for i in range(rows.shape[0]):
            for j in range(rows.shape[1]):
                workspace.place_rows[s, i, j] = rows[i, j]
        flow.solved[s, :] = False
    if flow.solved[s, n]:
        return
    forced = view_set_response(flow, s, n)
    solve_response(view_set_system(sets, s, sets.rows[s, n]), window, forced)
    integrate_base(window, forced)
    flow.solved[s, :] = False
    flow.solved[s, n] = True


@jit
def update_guard_response(sets, absorbers, window, s, a, flow):
    """Solve the forced part of absorber a's guard signal in the set at position s.

    The response of the set must be known (`update_set_response`). The result is written to
    ``flow`` (`ForcedSets`), unless the forced part is known already.
    """
    if flow.solved[s, a]:
        return
    system = view_set_system(sets, s, sets.rows[s, a])
    forced = view_set_response(flow, s, a)
    if is_joined(sets, s, a):
        solve_tip_signal(system, forced)
        solve_guard(system, window, absorbers.mass[a], forced)
    else:
        solve_guard(system, window, None, forced)
    flow.solved[s, a] = True


@jit
def add_base_motion(sets, window, s, a, sign, workspace):
    """Add a moving base's motion of the free absorber a, times ``sign``, to its contact state.

    Between events the contact state holds the rest of the motion, a polynomial of second order. The
    response of the set at position s must be known.
    """
    load = window.load
    if load is not None:
        contact_state = workspace.contact_states[a]
        n = sets.deflection.shape[2]
        signals = view_set_response(workspace.forced_sets, s, n).signals
        q, v = compute_base_motion(load, signals, window.omega, contact_state.tau)
        contact_state.q += sign * q
        contact_state.v += sign * v


@jit
def fill_guard_signal(scene, s, a, workspace):
    """Fill the free part of absorber a's guard signal in the set at position s.

    The signal begins at the current time. It is written to ``workspace.signals``.
    """
    sets = scene.sets
    contact_state = workspace.contact_states[a]
    signal = view_signal(workspace.signals, a)
    apply_weights(sets.rows[s, a], GUARD, workspace.buffers.z, signal.u)
    p = signal.polynomial
    if is_joined(sets, s, a):
        p[0] = scene.absorbers.mass[a] * scene.absorbers.gravity[a]
        p[1] = 0.0
        p[2] = 0.0
    else:
        p[0] = contact_state.q - workspace.deflection[a]
        p[1] = contact_state.v
        p[2] = contact_state.a


@jit
def update_static_deflection(sets, absorbers, contact_states, s, place_rows, deflection):
    """Write the static response to the constant forces of all absorbers in the set at position s.

    The amplitudes' rest part goes to the rows REST of place_rows[s], the displacement (m) of the
    beam at each absorber and at the level's place to ``deflection`` (n + 1,).
    """
    n = contact_states.shape[0]
    place_rows[s, REST, :] = 0.0
    place_rows[s, REST + 1, :] = 0.0
    deflection[:] = 0.0
    for b in range(n):
        force = contact_states[b].force  # friction
        if is_joined(sets, s, b):
            force = absorbers.mass[b] * absorbers.gravity[b]
        if force != 0.0:
            add_weighted(sets.rows[s, b], REST, force, place_rows[s, REST : REST + 2])
            for place in range(n + 1):
                deflection[place] += force * sets.deflection[s, place, b]


@jit
def enter_set(sets, absorbers, window, s, workspace, state):
    """Write the free part of the amplitudes of the set at position s to ``workspace.buffers.z``.

    It follows from the ``state`` at the current time and from the absorbers' constant forces, whose
    static response is written as well (`update_static_deflection`). The forced response must be
    known.
    """
    z = workspace.buffers.z
    update_static_deflection(
        sets, absorbers, workspace.contact_states, s, workspace.place_rows, workspace.deflection
    )
    compute_amplitudes(sets.into[s], state, z)
    add_forced(
        workspace.forced_sets.polynomials[s], window.omega, workspace.contact_states[0].tau, -1.0, z
    )
    add_weighted(workspace.place_rows[s], REST, -1.0, z)
