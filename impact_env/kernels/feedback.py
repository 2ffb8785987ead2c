"""One Runge-Kutta step as a linear map, and the compliant contact laws that feed back into it (paper, Eqs. elSignorini, elCoulomb)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impact_env.kernels.jit import jit, jit_room

# rows of the table of oscillators. A constant distance between rows spares a run-time check for overlap; it is no power of two, so that
# rows do not share cache lines' low address bits. Q, U: state. QQ to UU: its map over a step. QF1 to UF4: excitation at start, middle and
# end. QP1 to UP4: feedback in the four stages. Y: four pairs, observation in each stage from Q and U.
STRIDE = 68
Q, U, QQ, QU, UQ, UU, QF1, QFM, UF1, UFM, UF4, QP1, QP2, QP3, UP1, UP2, UP3, UP4, Y, TIP, Q_BEFORE, U_BEFORE, ROWS = (*range(19), 26, 27, 28, 29)
# columns of the mix: what the observation in a stage takes from the excitation at start, middle, end and from the feedback in stages 1 to 3
_MIX = 6


class Slider(NamedTuple):
    """Spring (N/m) in series with a Coulomb slider (limit in N)."""

    limit: float
    stiffness: float


class Stops(NamedTuple):
    """Unilateral springs (N/m) at +- gap (m)."""

    gap: float
    stiffness: float


@jit
def textbook_step(w2, c, h, q, u, w1, wm2, wm3, w4):  # type: ignore[no-untyped-def]
    """Return the four stages' (q, u) and the new (q, u) of q'' + c q' + w2 q = w, with w given stage by stage."""
    a1 = w1 - w2 * q - c * u
    q2, u2 = q + 0.5 * h * u, u + 0.5 * h * a1
    a2 = wm2 - w2 * q2 - c * u2
    q3, u3 = q + 0.5 * h * u2, u + 0.5 * h * a2
    a3 = wm3 - w2 * q3 - c * u3
    q4, u4 = q + h * u3, u + h * a3
    a4 = w4 - w2 * q4 - c * u4
    return q, u, q2, u2, q3, u3, q4, u4, q + h / 6.0 * (u + 2.0 * u2 + 2.0 * u3 + u4), u + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


@jit_room
def _unit_response(w2, c, h, one):  # type: ignore[no-untyped-def]
    """Return `textbook_step` for the unit vector ``one`` of (q, u, w1, w2, w3, w4)."""
    e = np.zeros(6)
    e[one] = 1.0
    return np.array(textbook_step(w2, c, h, e[0], e[1], e[2], e[3], e[4], e[5]))


@jit_room
def _add_oscillator(table, mix, stride, j, w2, c, push, tip, see_q, see_u, see_push, h):  # type: ignore[no-untyped-def]
    """Fill column ``j`` and add its share to the mix; (see_q, see_u) weigh its state in the observation, see_push the excitation."""
    responses = np.empty((6, 10))
    for one in range(6):
        responses[one] = _unit_response(w2, c, h, one)
    table[TIP * stride + j] = tip
    for row in range(2):  # new q, new u
        after = responses[:, 8 + row]
        table[(QQ + 2 * row) * stride + j] = after[0]
        table[(QU + 2 * row) * stride + j] = after[1]
        table[(QF1 + 2 * row) * stride + j] = push * after[2]
        table[(QFM + 2 * row) * stride + j] = push * (after[3] + after[4])
        for stage in range(3 + row):
            table[(QP1 + 3 * row + stage) * stride + j] = -tip * after[2 + stage]
    table[UF4 * stride + j] = push * responses[5, 9]
    for stage in range(4):
        seen = see_q * responses[:, 2 * stage] + see_u * responses[:, 2 * stage + 1]
        table[(Y + 2 * stage) * stride + j] = seen[0]
        table[(Y + 2 * stage + 1) * stride + j] = seen[1]
        mix[stage, 0] += push * seen[2]
        mix[stage, 1] += push * (seen[3] + seen[4])
        mix[stage, (stage + 1) // 2] += see_push * push
        for earlier in range(3):
            mix[stage, 3 + earlier] -= tip * seen[2 + earlier]


@jit_room
def new_table(omega, damping_ratio, force_shape, tip_shape, amplitude, m_a, added_mass, spring, state, h, wide):  # type: ignore[no-untyped-def]
    """Return (table, mix) of a scene. The observation is the relative displacement; with a spring, its force; with an added mass, the
    tip's acceleration without that mass.
    """  # noqa: D205
    n = omega.shape[0]
    stride = STRIDE
    if wide is not None:
        stride = wide
    table, mix = np.zeros(ROWS * stride), np.zeros((4, _MIX))
    stiffness, damping = 1.0, 0.0
    if spring is not None:
        stiffness, damping = spring.stiffness, spring.damping
    for j in range(n):
        w2, c, tip = omega[j] * omega[j], 2.0 * damping_ratio[j] * omega[j], tip_shape[j]
        see_q, see_u, see_push = -stiffness * tip, -damping * tip, 0.0
        if added_mass is not None:
            see_q, see_u, see_push = -tip * w2, -tip * c, tip
        _add_oscillator(table, mix, stride, j, w2, c, force_shape[j] * amplitude, tip, see_q, see_u, see_push, h)
        table[Q * stride + j], table[U * stride + j] = state[j], state[n + 1 + j]
    if m_a is not None:
        root = np.sqrt(m_a)
        _add_oscillator(table, mix, stride, n, 0.0, 0.0, 0.0, -1.0 / root, stiffness / root, damping / root, 0.0, h)
        table[Q * stride + n], table[U * stride + n] = root * state[n], root * state[2 * n + 1]
    return table, mix


@jit
def stop_force(y, stops):  # type: ignore[no-untyped-def]
    """Return the walls' force on the absorber (N)."""
    if stops is None:
        return 0.0
    if y > stops.gap:
        return -stops.stiffness * (y - stops.gap)
    if y < -stops.gap:
        return -stops.stiffness * (y + stops.gap)
    return 0.0


@jit
def slider_force(y, rest, slider):  # type: ignore[no-untyped-def]
    """Return the friction on the absorber (N) with the slider at ``rest``."""
    if slider is None:
        return 0.0
    return -min(max(slider.stiffness * (y - rest), -slider.limit), slider.limit)


@jit
def feedback(y, rest, stops, slider, spring, added_mass, joined_mass):  # type: ignore[no-untyped-def]
    """Return the force on the absorber (N) for an observation; ``joined_mass`` is m_a / (1 + m_a sum tip_shape^2)."""
    force = stop_force(y, stops) + slider_force(y, rest, slider)
    if spring is not None:
        force -= y
    if added_mass is not None:
        force += joined_mass * y
    return force


@jit
def move_slider(y, rest, slider):  # type: ignore[no-untyped-def]
    """Return the slider's place after a step that ends at relative displacement ``y``."""
    if slider is None:
        return rest
    reach = slider.limit / slider.stiffness
    return min(max(rest, y - reach), y + reach)
