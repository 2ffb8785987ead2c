"""Floquet multipliers of an orbit: what becomes of a small disturbance in a period, or in half of one and its mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.periodic.monodromy import monodromy
from impact_env.periodic.motion import Motion
from impact_env.periodic.shot_motion import ShotMotion

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Stability:
    """``multipliers`` (2 N_m + 2,) over the schedule's span, the largest first; ``half``: that is half a period, with the mirror image taken.

    Half-period multipliers of a symmetric orbit: +1 is a fold, -1 breaks the symmetry. ``slow``: the places (2,) of the pair whose disturbances
    lie most in the resonant mode and die out as slowly as that mode's own vibration; all others are fast. ``matrix``: the map's
    derivative, from just after the first event on, or from the section of an orbit found by shooting.
    """

    multipliers: Complex
    half: bool
    slow: NDArray[np.int64]
    matrix: Array

    @property
    def stable(self) -> bool:
        """Whether every small disturbance dies out."""
        return bool(np.max(np.abs(self.multipliers)) < 1)

    @property
    def slow_multipliers(self) -> Complex:
        """The slow pair, (2,)."""
        return np.asarray(self.multipliers[self.slow])

    @property
    def fast_multipliers(self) -> Complex:
        """All others, the largest first."""
        return np.asarray(np.delete(self.multipliers, self.slow))

    @property
    def slowly_stable(self) -> bool:
        """Whether the slow pair dies out: a regime may then live around an orbit that is unstable by a fast pair."""
        return bool(np.max(np.abs(self.slow_multipliers)) < 1)

    @property
    def full(self) -> Complex:
        """Multipliers over a whole period."""
        return np.asarray(self.multipliers**2 if self.half else self.multipliers)


def derivative_of(motion: Motion) -> tuple[Array, Array]:
    """Return the derivative (2 N_m + 2,)^2 of the map over the schedule's span, and (n,) how each event turns the absorber.

    The second is the relative acceleration before a reversal over the change that friction brings: -1 or below where the absorber slides on the other
    way, in between friction would hold it, above 0 it never got there. It is -inf at impacts.
    """
    solution = motion.solution
    case, order = solution.case, solution.schedule.order
    size = 2 * case.model.modes + 2
    before = np.append(order.mirror * order.sign[-1], order.sign[:-1])
    jumps = case.friction_limit * (before - order.sign)
    matrix, turning = np.empty((size, size)), np.empty(len(jumps))
    monodromy(case.structure, case.point, order, motion.flights, solution.impulses, jumps, matrix, turning)
    return matrix, turning


def shot_stability(motion: ShotMotion) -> Stability:
    """Return the stability of a motion found by shooting: its passage has carried the derivative along."""
    mirror = -1.0 if motion.solution.schedule.symmetric else 1.0
    return stability_of(motion, mirror * motion.passage.derivative)


def stability_of(motion: Motion | ShotMotion, matrix: Array) -> Stability:
    """Return the stability of a motion from its map's derivative."""
    values, vectors = np.linalg.eig(matrix)
    rank = np.argsort(-np.abs(values), kind="stable")
    values, vectors = values[rank].astype(complex), vectors[:, rank]
    return Stability(values, motion.solution.schedule.symmetric, _slow_pair(motion, values, vectors), matrix)


def _slow_pair(motion: Motion | ShotMotion, values: Complex, vectors: Complex) -> NDArray[np.int64]:
    """Return the places of the pair that lives like the beam's vibration in the mode nearest to the force's frequency.

    Its disturbances lie in that mode (share of energy), and decay as the mode alone would over the span. A pair is a complex multiplier and its
    conjugate, or two real ones.
    """
    case = motion.solution.case
    model, n = case.model, case.model.modes
    nearest = int(np.argmin(np.abs(model.omega - case.omega)))
    energy = np.abs(vectors) ** 2 * np.concatenate([model.omega**2, [0.0], np.ones(n), [case.structure.mass]])[:, None]
    share = (energy[nearest] + energy[n + 1 + nearest]) / np.maximum(np.sum(energy, axis=0), TINY)
    alone = -min(float(model.damping_ratio[nearest]), 1.0) * float(model.omega[nearest]) * motion.solution.schedule.turn / case.omega
    unlike = np.abs(np.log(np.maximum(np.abs(values), TINY)) - alone) - np.log(np.maximum(share, TINY))
    upper, real = np.flatnonzero(values.imag > 0), np.flatnonzero(values.imag == 0)
    pairs = [(2 * float(unlike[k]), int(k), int(np.argmin(np.abs(values - np.conj(values[k]))))) for k in upper]
    pairs += [(float(unlike[j] + unlike[k]), int(j), int(k)) for j, k in combinations(real, 2)]
    return np.array(sorted(min(pairs)[1:]), dtype=np.int64)
