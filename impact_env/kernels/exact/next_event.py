"""The search for a rigid contact's next event: what ends a flight or a hold."""

from __future__ import annotations

import numpy as np

from impact_env.kernels.compiling.jit import jit_inline
from impact_env.kernels.events.search import find_next_event
from impact_env.kernels.events.signals import EventFunction, Guards
from impact_env.kernels.exact.rigid_contact import joint_bounds
from impact_env.kernels.motion.modal_system import GUARD, apply_weights


@jit_inline
def find_end_of_flight(system, forced, window, walls, limit, body, deflection, length):
    """Return the first event within ``length`` (s) of an absorber apart from the beam.

    ``deflection`` (m): static displacement of the beam at its place under the constant forces.
    """
    contact_state = body.contact_state
    signal = body.signal
    p = body.signal.polynomial
    # before all else: what the caller has just written is still in registers
    p[0] = contact_state.q - deflection
    p[1] = contact_state.v
    p[2] = contact_state.a
    apply_weights(system.rows, GUARD, body.buffers.z, signal.u)
    function = EventFunction(system, forced, window.omega, signal, contact_state.tau)
    gap = walls.gap
    if limit is None:
        return find_next_event(
            window,
            function,
            Guards(
                -gap,
                gap,
                int(contact_state.side),
                None,
                contact_state.at_rest and contact_state.side != 0.0,
            ),
            length,
        )
    # only the wall ahead can be reached before the relative velocity turns
    low = -gap if contact_state.sign < 0.0 else -np.inf
    high = gap if contact_state.sign > 0.0 else np.inf
    return find_next_event(
        window, function, Guards(low, high, 0, contact_state.sign, contact_state.at_rest), length
    )


@jit_inline
def find_end_of_hold(system, forced, window, limit, weight, body, length):
    """Return the event at which the joint force of a joined absorber leaves its bounds.

    It is the first one within ``length`` (s).

    ``weight`` (N): static part of the joint force.
    """
    signal = body.signal
    apply_weights(system.rows, GUARD, body.buffers.z, signal.u)
    signal.polynomial[:] = 0.0
    signal.polynomial[0] = weight
    low, high = joint_bounds(limit, body.contact_state.side)
    function = EventFunction(system, forced, window.omega, signal, body.contact_state.tau)
    return find_next_event(window, function, Guards(low, high, 0, None, False), length)
