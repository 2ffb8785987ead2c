"""Ensembles whose members take two branches of response: one design, force and structure, and two levels.

A median of such members is a level that hardly any run has. So two log-normal branches of one width are fitted beside a single one, and are reported
where they fit clearly better: by Schwarz's criterion, with a margin that single samples of 8 to 64 members pass in about one of a hundred.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
MARGIN = 8.0  # of Schwarz's criterion (BIC) for two branches over one
APART = 1.1  # upper over lower level: what lies closer together is one level to anyone who builds an absorber
FEWEST = 2  # members that make a branch
MEMBERS = 8  # fewer tell nothing
_ROUNDS = 200
_WIDTH = 1e-6  # of a branch, relative: members that agree to all digits are no branch of no width


@dataclass(frozen=True)
class Branches:
    """Two branches of levels: ``levels`` (lower, upper; medians of their members, in the members' unit), and the ``shares`` of the members."""

    levels: tuple[float, float]
    shares: tuple[float, float]
    margin: float

    def text(self, scale: float = 1.0, unit: str = "") -> str:
        """Return the branches in words, levels times ``scale``."""
        low, high = (f"{scale * level:.3g}{unit} ({100 * share:.0f} % of the members)" for level, share in zip(self.levels, self.shares, strict=True))
        return f"two branches, {low} and {high}"


def _log_likelihood(x: Array, centres: Array, weights: Array, width: float) -> tuple[float, Array]:
    """Return the log-likelihood of rows (M,) under a mixture, and each member's chances of being of either branch, (M, 2)."""
    with np.errstate(divide="ignore"):
        terms = np.log(weights) - 0.5 * ((x[:, None] - centres) / width) ** 2 - np.log(width * np.sqrt(2 * np.pi))
    total = np.logaddexp(terms[:, 0], terms[:, 1])
    return float(total.sum()), np.exp(terms - total[:, None])


def _fit(x: Array, cut: int) -> tuple[float, Array]:
    """Return the best log-likelihood from a start that parts the sorted members after ``cut``, and the chances, by expectation and maximisation."""
    chances = np.zeros((len(x), 2))
    chances[:cut, 0] = chances[cut:, 1] = 1.0
    best = -np.inf
    for _ in range(_ROUNDS):
        mass = chances.sum(axis=0)
        if mass.min() < 1e-9:
            break
        centres = (x @ chances) / mass
        width = max(float(np.sqrt(np.sum(chances * (x[:, None] - centres) ** 2) / len(x))), _WIDTH)
        value, chances = _log_likelihood(x, centres, mass / len(x), width)
        if value - best < 1e-9:
            break
        best = value
    return best, chances


def branches(members: ArrayLike) -> Branches | None:
    """Return the two branches of members' levels (M,), above 0; None if one branch does as well, the two lie within a tenth, or fewer than 8."""
    levels = np.sort(np.asarray(members, dtype=np.float64))
    if levels.ndim != 1 or len(levels) < MEMBERS or not np.all(np.isfinite(levels)) or levels[0] <= 0:
        return None
    x, n = np.log(levels), len(levels)
    gaps = np.diff(x)
    starts = {int(k) + 1 for k in np.argsort(-gaps)[:4]} | {n // 4, n // 2, 3 * n // 4}
    value, chances = max((_fit(x, cut) for cut in sorted(starts)), key=lambda found: found[0])
    width = max(float(np.std(x)), _WIDTH)
    single = -0.5 * n * (1 + np.log(2 * np.pi * width**2))
    margin = 2 * (value - single) - 2 * np.log(n)  # two numbers more: another centre, and the share
    upper = chances[:, 1] > 0.5
    if margin < MARGIN or min(upper.sum(), n - upper.sum()) < FEWEST:
        return None
    low, high = (float(np.median(levels[part])) for part in (~upper, upper))
    if high < APART * low:
        return None
    return Branches((low, high), (float(1 - upper.mean()), float(upper.mean())), float(margin))
