"""Closed form for scenes with one linear regime.

These are scenes without absorber and with a stuck or tuned absorber. No time step and no event
search is needed.

The load is expanded anew in each window; the response is exact at every sample, whatever the
windows' length.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.energy.energies import add_energy, new_account, replace_energies_by_account
from impact_env.kernels.motion.forced import Forced, add_forced, new_forced, solve_response
from impact_env.kernels.motion.loads import copy_schedule, count_windows, expand_window
from impact_env.kernels.motion.modal_system import REST, add_weighted, propagate
from impact_env.kernels.motion.observers import ABSORBER_MOTION, DONE, NOT_FINITE, record_time
from impact_env.kernels.motion.segments import (
    Buffers,
    LinearRegime,
    Losses,
    Segment,
    compute_amplitudes,
    compute_state,
    is_observed,
    new_buffers,
    sample_level,
    sample_state,
    take_last_sample,
)
from impact_env.kernels.motion.unit_loads import combine_unit_responses, propagate_sampled_load


class Linear(NamedTuple):
    """A scene of one linear regime."""

    regime: LinearRegime  # of beam and absorber
    losses: Losses  # data for the energy balance
    gravity: float  # acceleration by the absorber's weight (m/s^2), 0 without


class LinearWorkspace(NamedTuple):
    """Motion and scratch memory of a run with one regime."""

    buffers: Buffers  # between windows ``z`` holds the complete modal amplitudes
    forced: Forced  # response in the current window
    scratch: NDArray[np.float64]  # (2 N_m + 2,) a state
    no_motion: NDArray[Any]  # (1,) an ABSORBER_MOTION record of zeros


@jit_allocating
def new_linear_workspace(regime, load, state):
    """Return the workspace of a scene with one regime.

    ``load``: workspace of the loads, None under the chirp of one force; ``state`` (2 N_m + 2,)
    gives the size only.
    """
    size = regime.system.rows.shape[1]
    return LinearWorkspace(
        new_buffers(size),
        new_forced(regime.system, load),
        np.zeros_like(state),
        np.zeros(1, ABSORBER_MOTION),
    )


@jit
def add_weight_deflection(regime, gravity, sign, z):
    """Add the static deflection under the absorber's weight, times ``sign``, to z (2, J).

    Returns ``gravity`` (m/s^2), which is 0 without a weight.
    """
    if gravity != 0.0:
        add_weighted(regime.system.rows, REST, sign * gravity, z)
    return gravity


@jit_inline
def skip_unobserved_window(scene, window, workspace, observers):
    """Propagate over a window of a sampled load in which nothing is observed; return whether done.

    If the load is not linear in the window, or something is observed, the result is False and the
    amplitudes in ``workspace`` are unchanged.
    """
    load = window.load
    z = workspace.buffers.z
    if load is None:
        return False
    if not load.linear[0] or is_observed(
        window, observers.clock, observers.level, observers.series, observers.energy
    ):
        return False
    add_weight_deflection(scene.regime, scene.gravity, -1.0, z)
    passed = propagate_sampled_load(
        load, scene.regime.system, window, workspace.forced, workspace.buffers.rows[0], z
    )
    add_weight_deflection(scene.regime, scene.gravity, 1.0, z)
    return passed


@jit_inline
def advance_window(scene, window, workspace, observers):
    """Propagate the amplitudes in ``workspace`` over a window and pass it to the observers."""
    regime = scene.regime
    system = scene.regime.system
    buffers = workspace.buffers
    forced = workspace.forced
    load = window.load
    solved = False
    if load is not None:
        solved = combine_unit_responses(load, system, window, None, False, forced)
    if not solved:
        solve_response(system, window, forced)
    add_forced(forced.polynomials, window.omega, -window.half, -1.0, buffers.z)
    weight = add_weight_deflection(regime, scene.gravity, -1.0, buffers.z)
    segment = Segment(
        regime,
        forced,
        window,
        buffers,
        weight,
        regime.tip_rest * weight,
        workspace.no_motion,
        -window.half,
        window.half,
    )
    sample_level(segment, observers.clock, observers.level)
    sample_state(segment, observers.clock, observers.series)
    add_energy(segment, scene.losses, workspace.scratch, 0, observers.energy)
    propagate(system.rows, system.table, system.scale, 2.0 * window.half, buffers.z)
    add_forced(forced.polynomials, window.omega, window.half, 1.0, buffers.z)
    add_weight_deflection(regime, scene.gravity, 1.0, buffers.z)


@jit_inline
def integrate_linear_section(scene, schedule, k, workspace, observers):
    """Propagate over section ``k`` of the schedule and return a status code, DONE or an error.

    The amplitudes stay in ``workspace`` for the next section.
    """
    count = count_windows(schedule, k)
    for w in range(count):
        window = expand_window(schedule, k, w, count)
        if not skip_unobserved_window(scene, window, workspace, observers):
            advance_window(scene, window, workspace, observers)
        observers.counters.counts.steps += 1
        if not np.isfinite(workspace.buffers.z[0, 0]):
            return NOT_FINITE
        status = record_time(observers.counters, window.centre + window.half)
        if status != DONE:
            return status
    return DONE


@jit_allocating
def linear_lane(scene, plan, state, observers):
    """Propagate one run of a `Linear` scene and return a status code, DONE or an error.

    ``plan``: the `Schedule`, which is not written. ``state`` (2 N_m + 2,) is the initial state and
    becomes the final one.
    """
    schedule = copy_schedule(plan)
    regime = scene.regime
    workspace = new_linear_workspace(scene.regime, schedule.load, state)
    status = DONE
    counts = observers.counters.counts
    lane_observers = replace_energies_by_account(
        observers, new_account(observers.energy, 1, regime.system.rows.shape[1])
    )
    compute_amplitudes(regime.into, state, workspace.buffers.z)
    for k in range(schedule.times.shape[0] - 1):
        status = integrate_linear_section(scene, schedule, k, workspace, lane_observers)
        if status != DONE:
            break
    if status == DONE:
        counts.reached = schedule.times[-1]
    compute_state(regime.out, workspace.buffers.z, state)
    take_last_sample(
        state,
        scene.losses.tip_shape,
        counts.reached,
        observers.clock,
        observers.level,
        observers.series,
    )
    return status
