"""The harmonic force at equidistant times without a cosine a step: a rotating phasor that is set anew every few steps.

Over one stretch of the schedule the phase is a quadratic in time, so the phasor's turn per step is itself a phasor that turns at a
constant rate. Rounding grows with the square of the number of turns: after `RESET` of them it is below 2e-13.
"""

from __future__ import annotations

import math

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.motion.loads import force_in

RESET = 32


@jit
def stretch_at(times, k, t):
    """Return the stretch of the schedule that holds time ``t``, searching onwards from stretch ``k``; the last stretch has no end."""
    while k + 2 < times.shape[0] and t >= times[k + 1]:
        k += 1
    return k


@jit
def turns_left(times, k, t, dt, most):
    """Return how many of the times t, t + dt, ... (1 to ``most``) lie in stretch ``k``."""
    if k + 2 >= times.shape[0] or t + most * dt < times[k + 1]:
        return most
    return max(1, min(most, int((times[k + 1] - t) / dt)))


@jit
def force_angle(force, k, t):
    """Return (phase in rad, frequency in rad/s, its rate in rad/s^2) of stretch ``k`` at time ``t``."""
    times = force.times
    omegas = force.omegas
    phases = force.phases
    rate = (omegas[k + 1] - omegas[k]) / (times[k + 1] - times[k])
    tau = t - times[k]
    return phases[k] + (omegas[k] + 0.5 * rate * tau) * tau, omegas[k] + rate * tau, rate


@jit
def phasor(force, k, t, dt):
    """Return cosine and sine of: the force's phase at ``t``, its turn to t + dt, and the change of that turn per step."""
    angle, omega, rate = force_angle(force, k, t)
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
def fill_loads(target, count, times, load, k, t, dt):
    """Do the same for other loads than the chirp of one force."""
    first = stretch_at(times, k, t)
    k = first
    for n in range(count):
        k = stretch_at(times, k, t + n * dt)
        target[n] = force_in(load, k, t + n * dt)
    return first


@jit
def force_or(load, k, t, given):
    """Return the force of loads at time ``t`` of stretch ``k`` (N), or what is ``given`` where there are none."""
    if load is None:
        return given
    return force_in(load, k, t)


@jit
def fill_phases(target, count, force, k, t, dt):
    """Write the force for amplitude 1 at t, t + dt, ... into the first ``count`` places of ``target``; return the stretch of the first."""
    times = force.times
    load = force.load
    if load is not None:
        return fill_loads(target, count, times, load, k, t, dt)
    first = stretch_at(times, k, t)
    k = first
    done = 0
    while done < count:
        now = t + done * dt
        k = stretch_at(times, k, now)
        stop = done + turns_left(times, k, now, dt, min(RESET, count - done))
        c, s, turn_c, turn_s, change_c, change_s = phasor(force, k, now, dt)
        while done < stop:
            target[done] = c
            c, s = c * turn_c - s * turn_s, c * turn_s + s * turn_c
            turn_c, turn_s = (
                turn_c * change_c - turn_s * change_s,
                turn_c * change_s + turn_s * change_c,
            )
            done += 1
    return first
