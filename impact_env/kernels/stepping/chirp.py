"""The harmonic force at equidistant times without a cosine at each step.

It is the real part of a rotating phasor, which is recomputed every few steps.

Over one section of the schedule the phase is a quadratic in time, so the phasor's turn per step is
itself a phasor that turns at a constant rate. Rounding grows with the square of the number of
turns: after `PHASOR_STEPS` of them it is below 2e-13.
"""

from __future__ import annotations

import math

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.motion.loads import compute_force, has_sources

PHASOR_STEPS = 32


@jit
def find_section(times, k, t):
    """Return the section of the schedule that contains time ``t``.

    The search goes forward from section ``k``. The last section has no end.
    """
    while k + 2 < times.shape[0] and t >= times[k + 1]:
        k += 1
    return k


@jit
def count_steps_left(times, k, t, dt, most):
    """Return how many of the times t, t + dt, ... (1 to ``most``) lie in section ``k``."""
    if k + 2 >= times.shape[0] or t + most * dt < times[k + 1]:
        return most
    return max(1, min(most, int((times[k + 1] - t) / dt)))


@jit
def compute_force_angle(force, k, t):
    """Return the force's angle in section ``k`` at time ``t``.

    The result is (phase in rad, frequency in rad/s, its rate in rad/s^2).
    """
    times = force.times
    omegas = force.omegas
    phases = force.phases
    rate = (omegas[k + 1] - omegas[k]) / (times[k + 1] - times[k])
    tau = t - times[k]
    return phases[k] + (omegas[k] + 0.5 * rate * tau) * tau, omegas[k] + rate * tau, rate


@jit
def compute_phasor(force, k, t, dt):
    """Return cosine and sine of the force's phase and of its changes.

    They are those of the phase at ``t``, of its turn to t + dt, and of the change of this turn per
    step.
    """
    angle, omega, rate = compute_force_angle(force, k, t)
    turn = (omega + 0.5 * rate * dt) * dt
    change = rate * dt * dt
    return (
        math.cos(angle + force.phase),
        math.sin(angle + force.phase),
        math.cos(turn),
        math.sin(turn),
        math.cos(change),
        math.sin(change),
    )


@jit
def fill_midpoint_loads(target, load, k, start, stop, dt):
    """Write loads in the middle of the steps from ``start`` to ``stop``, all in section ``k``.

    Only loads other than the chirp of one force are written. Without such loads nothing is written.
    """
    if has_sources(load):
        for n in range(stop - start):
            target[n] = compute_force(load, k, (start + n + 0.5) * dt)


@jit
def fill_load_values(target, count, times, load, k, t, dt):
    """Write loads other than the chirp of one force at t, t + dt, ..., as `fill_force`."""
    first = find_section(times, k, t)
    k = first
    for n in range(count):
        k = find_section(times, k, t + n * dt)
        target[n] = compute_force(load, k, t + n * dt)
    return first


@jit
def fill_force(target, count, force, k, t, dt):
    """Write the force for amplitude 1 at t, t + dt, ... into ``target``.

    The first ``count`` entries are written. Returns the section of the first time.
    """
    times = force.times
    load = force.load
    if has_sources(load):
        return fill_load_values(target, count, times, load, k, t, dt)
    first = find_section(times, k, t)
    k = first
    done = 0
    while done < count:
        time = t + done * dt
        k = find_section(times, k, time)
        stop = done + count_steps_left(times, k, time, dt, min(PHASOR_STEPS, count - done))
        c, s, turn_c, turn_s, change_c, change_s = compute_phasor(force, k, time, dt)
        while done < stop:
            target[done] = c
            c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
            turn_c, turn_s = (
                turn_c * change_c - turn_s * change_s,
                turn_c * change_s + turn_s * change_c,
            )
            done += 1
    return first
