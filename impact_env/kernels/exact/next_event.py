"""The search for a rigid contact's next event: what ends a flight or a hold."""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit_inline
from impact_env.kernels.events.search import next_event
from impact_env.kernels.events.signals import Course, Guards
from impact_env.kernels.exact.rigid_contact import joint_bounds
from impact_env.kernels.motion.slots import GUARD, weigh


@jit_inline
def end_of_flight(slots, forced, window, walls, limit, body, bent, length):
    """Return the first event within ``length`` (s) of an absorber apart from the beam, which constant forces have bent by ``bent`` (m) there."""
    now = body.now
    signal = body.signal
    p = body.signal.polynomial
    p[0], p[1], p[2] = (
        now.q - bent,
        now.v,
        now.a,
    )  # first: what the caller has just written is still in registers
    weigh(slots.rows, GUARD, body.work.z, signal.u)
    course = Course(slots, forced, window.omega, signal, now.tau)
    gap = 0.0
    if walls is not None:
        gap = walls.gap
    if limit is None:
        return next_event(
            window,
            course,
            Guards(-gap, gap, int(now.side), None, now.at_rest and now.side != 0.0),
            length,
        )
    if walls is None:
        return next_event(window, course, Guards(None, None, 0, now.sign, now.at_rest), length)
    # only the wall ahead can be reached before the relative velocity turns
    low = -gap if now.sign < 0.0 else -np.inf
    high = gap if now.sign > 0.0 else np.inf
    return next_event(window, course, Guards(low, high, 0, now.sign, now.at_rest), length)


@jit_inline
def end_of_hold(slots, forced, window, limit, weight, body, length):
    """Return the first event within ``length`` (s) of an absorber that moves with the beam: its joint force leaves what the joint can give.

    ``weight`` (N): what the joint carries at rest.
    """
    signal = body.signal
    weigh(slots.rows, GUARD, body.work.z, signal.u)
    signal.polynomial[:] = 0.0
    signal.polynomial[0] = weight
    low, high = joint_bounds(limit, body.now.side)
    course = Course(slots, forced, window.omega, signal, body.now.tau)
    return next_event(window, course, Guards(low, high, 0, None, False), length)
