"""The elastic Coulomb law (paper, Eq. elCoulomb) in the frequency domain: a spring in series with a slider, from turning point to turning point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.optimize

from impact_env.periodic.trigonometric import TURN, Real, basis, derivative, harmonics_of, roots, share, window


class Hysteresis(NamedTuple):
    """Polynomial (n,) of the force on the absorber in N, and its derivatives by motion (n, n), limit (n,) and stiffness (n,)."""

    force: Real
    by_motion: Real
    by_limit: Real
    by_stiffness: Real


class _State(NamedTuple):
    """Force at a turning point and its derivatives."""

    force: float
    by_motion: Real
    by_limit: float
    by_stiffness: float


class _Stick(NamedTuple):
    """A stretch [begin, end] with the force ``constant`` - k r."""

    begin: float
    end: float
    constant: _State


class _Slip(NamedTuple):
    """A stretch with the force ``sign`` times the limit."""

    begin: float
    end: float
    sign: float


def elastic_coulomb(motion: Real, limit: float, stiffness: float) -> Hysteresis:
    """Return the periodic force for a relative displacement ``motion`` (2H + 1,) in m; limit in N, stiffness in N/m.

    The stretches' ends are roots of r' and of r less a constant, so nothing is sampled. If nothing slips, the force is -k r without its mean: where
    the spring is at rest is free then.
    """
    h = harmonics_of(motion)
    turns = roots(derivative(motion)[None])[0]
    if len(turns):
        rows = np.array([basis(angle, h) for angle in turns])
        state, slipped = _cycle(motion, turns, rows, limit, stiffness, _State(0.0, np.zeros(len(motion)), 0.0, 0.0))[:2]
        if slipped:
            stretches = _cycle(motion, turns, rows, limit, stiffness, state)[2]
            return _summed(motion, stretches, limit, stiffness)
    moving = np.ones(len(motion))
    moving[0] = 0.0
    return Hysteresis(-stiffness * moving * motion, -stiffness * np.diag(moving), np.zeros(len(motion)), -moving * motion)


def _cycle(motion: Real, turns: Real, rows: Real, limit: float, stiffness: float, state: _State) -> tuple[_State, bool, list[_Stick | _Slip]]:
    """Go once round from the first turning point; return the state in the end, whether anything slipped, and the stretches."""
    reached, count, slipped = rows @ motion, len(turns), False
    stretches: list[_Stick | _Slip] = []
    for i in range(count):
        begin, end = turns[i], turns[i + 1] if i + 1 < count else turns[0] + TURN
        after = (i + 1) % count
        move = reached[after] - reached[i]
        held = _State(
            state.force + stiffness * reached[i],
            state.by_motion + stiffness * rows[i],
            state.by_limit,
            state.by_stiffness + reached[i],
        )
        pulled = state.force - stiffness * move
        if abs(pulled) <= limit:
            stretches.append(_Stick(begin, end, held))
            by_motion = held.by_motion - stiffness * rows[after]
            state = _State(pulled, by_motion, state.by_limit, state.by_stiffness - move)
            continue
        sign = -float(np.sign(move))
        at = _reaches(motion, begin, end, (held.force - sign * limit) / stiffness)
        stretches += [_Stick(begin, at, held), _Slip(at, end, sign)]
        state, slipped = _State(sign * limit, np.zeros(len(motion)), sign, 0.0), True
    return state, slipped, stretches


def _reaches(motion: Real, begin: float, end: float, value: float) -> float:
    """Return the angle between two turning points at which the motion has a value."""
    h = harmonics_of(motion)

    def rest(angle: float) -> float:
        return float(basis(angle, h) @ motion - value)

    if rest(begin) * rest(end) >= 0:  # slips from the turning point on, or at its very end: rounding
        return begin if abs(rest(begin)) < abs(rest(end)) else end
    return float(scipy.optimize.brentq(rest, begin, end, xtol=1e-15, rtol=1e-15))


def _summed(motion: Real, stretches: list[_Stick | _Slip], limit: float, stiffness: float) -> Hysteresis:
    h, n = harmonics_of(motion), len(motion)
    matrix = window(np.array([s[:2] for s in stretches if isinstance(s, _Stick)]), h)
    force, by_motion, by_limit, by_stiffness = -stiffness * (matrix @ motion), -stiffness * matrix, np.zeros(n), -(matrix @ motion)
    for stretch in stretches:
        part = share(np.array([stretch[:2]]), h)
        if isinstance(stretch, _Slip):
            force, by_limit = force + stretch.sign * limit * part, by_limit + stretch.sign * part
            continue
        constant = stretch.constant
        force, by_motion = force + constant.force * part, by_motion + np.outer(part, constant.by_motion)
        by_limit, by_stiffness = by_limit + constant.by_limit * part, by_stiffness + constant.by_stiffness * part
    return Hysteresis(force, by_motion, by_limit, by_stiffness)
