"""Designs with their scores, and the progress of a study."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.parameters import require
from optimisation.designs import Design
from optimisation.objectives import Score


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A design that was told: its ``number``, what it scored, and on how many ``rungs`` (all of them: it can win)."""

    number: int
    design: Design
    score: Score
    rungs: int


@dataclass(frozen=True, eq=False)
class Progress:
    """How far a study is: ``designs`` told, ``wanted`` in all, and the ``runs`` made in this session."""

    designs: int
    wanted: int
    runs: int


# Pareto fronts of two objectives: who is not dominated, and how much of the plane a front dominates.


Array = NDArray[np.float64]


def nondominated(costs: ArrayLike) -> NDArray[np.bool_]:
    """Return which rows of costs (N, K), all to be minimised, no other row beats: none at least as good in all and better in one, (N,)."""
    rows = np.asarray(costs, dtype=np.float64)
    require(rows.ndim == 2, "costs", rows.shape, "a row of costs for each design")
    no_worse = np.all(rows[:, None] <= rows[None], axis=2)
    better = np.any(rows[:, None] < rows[None], axis=2)
    return ~np.any(no_worse & better, axis=0)


def hypervolume(costs: ArrayLike, corner: tuple[float, float]) -> float:
    """Return the area between costs (N, 2), to be minimised, and a corner that is worse than all that counts; 0 if no row is better."""
    rows = np.asarray(costs, dtype=np.float64).reshape(-1, 2)
    rows = rows[np.all(rows < np.array(corner), axis=1)]
    area, height = 0.0, corner[1]
    for first, second in sorted(map(tuple, rows)):
        if second < height:
            area += (corner[0] - first) * (height - second)
            height = second
    return float(area)
