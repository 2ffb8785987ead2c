"""How much is spent on choosing numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from optimisation.rl.families import Array
from optimisation.rl.tuning import Search

RULES, SCHEDULES = Search(generations=12, population=10, sigma=0.1), Search(generations=40, population=16, sigma=0.2)
FITS = Search(generations=14, population=12, sigma=0.4)
SUITE_SEARCH = Search(generations=18, population=12, sigma=0.15, relative=True)


@dataclass(frozen=True)
class Effort:
    """How much is spent on choosing numbers: training seeds, a first look at windows, points of a grid, searches."""

    seeds: int = 96
    windows: bool = True
    grid: int = 25
    rule: Search = RULES
    schedule: Search = SCHEDULES
    fit: Search = FITS
    suite: Search = SUITE_SEARCH

    def scaled(self, share: float, seeds: int | None = None) -> Effort:
        """Return an effort with a share of the generations, at least one, and another number of seeds if one is given."""
        searches: dict[str, Any] = {
            name: replace(search, generations=max(1, round(share * search.generations)))
            for name, search in (("rule", self.rule), ("schedule", self.schedule), ("fit", self.fit), ("suite", self.suite))
        }
        return replace(self, **searches, seeds=seeds or self.seeds)


FEW = Search(generations=2, population=6, finalists=2)
QUICK = Effort(seeds=9, windows=False, grid=5, rule=FEW, schedule=FEW, fit=FEW, suite=replace(FEW, sigma=0.1, relative=True))


def spent(search: Search, starts: int) -> int:
    """Return how many candidates `optimisation.rl.tuning.evolve` tries from a number of starts."""
    return starts * (search.generations * search.population + search.finalists + 2)


def grid(effort: Effort, low: float = -1.0) -> Array:
    """Return constant actions (n, 1) to try, from ``low`` to 1."""
    return np.linspace(low, 1, effort.grid)[:, None]
