"""Floquet multipliers of an orbit: what becomes of a small disturbance in a period, or in half of one and its mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.motion import AnyMotion

Complex = NDArray[np.complex128]
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Stability:
    """``multipliers`` (2 N_m + 2,) over the schedule's span, the largest first; ``half``: that is half a period, with the mirror image taken.

    Half-period multipliers of a symmetric orbit: +1 is a fold, -1 breaks the symmetry. ``slow``: the places (2,) of the pair whose disturbances
    lie most in the resonant mode and die out as slowly as that mode's own vibration; all others are fast.
    """

    multipliers: Complex
    half: bool
    slow: NDArray[np.int64]

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


def stability_of(motion: AnyMotion) -> Stability:
    """Return the stability of a motion, from its map's derivative."""
    values, vectors = np.linalg.eig(motion.derivative)
    rank = np.argsort(-np.abs(values), kind="stable")
    values, vectors = values[rank].astype(complex), vectors[:, rank]
    return Stability(values, motion.solution.schedule.symmetric, _slow_pair(motion, values, vectors))


def _slow_pair(motion: AnyMotion, values: Complex, vectors: Complex) -> NDArray[np.int64]:
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
