"""Choosing a family's numbers on training seeds: a grid for one number, CMA-ES for several. All candidates see the same seeds.

CMA-ES: N. Hansen, The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772; the implementation is the package cmaes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.envs.evaluation import play
from impact_env.extras import optional
from impact_env.parameters import require
from optimisation.rl.families import Array, Family, FamilyPolicy

CHUNK = 512  # lanes that are played together: candidates times seeds
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Tuned:
    """Numbers chosen for a family: their mean score over the training seeds, and how many candidates were tried."""

    parameters: tuple[float, ...]
    score: float
    candidates: int


def mean_scores(family: Family, candidates: NDArray[Any], name: str, seeds: Sequence[int], arguments: Mapping[str, Any]) -> Array:
    """Return the mean score (C,) of each candidate (C, P) over the seeds."""
    require(len(candidates) > 0, "candidates", candidates, "at least one")
    together = max(1, CHUNK // len(seeds))
    means = []
    for part in np.array_split(candidates, range(together, len(candidates), together)):
        policy = FamilyPolicy("candidates", family, np.repeat(part, len(seeds), axis=0))
        means.append(play(policy, name, list(seeds) * len(part), arguments).scores.reshape(len(part), len(seeds)).mean(axis=1))
    return np.concatenate(means)


def best_of(
    family: Family,
    candidates: NDArray[Any],
    name: str,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    progress: Progress | None = None,
) -> Tuned:
    """Return the candidate (C, P) with the largest mean score."""
    scores = mean_scores(family, candidates, name, seeds, arguments)
    if progress is not None:
        progress(len(candidates))
    best = int(np.argmax(scores))
    return Tuned(tuple(candidates[best].tolist()), float(scores[best]), len(candidates))


@dataclass(frozen=True)
class Search:
    """How far CMA-ES looks from each start: generations of ``population`` candidates, first standard deviation ``sigma``, in units of the
    width of the numbers' bounds.
    """  # noqa: D205

    generations: int = 50
    population: int = 16
    sigma: float = 0.1
    finalists: int = 8


def searched(seeds: Sequence[int]) -> Sequence[int]:
    """Return the seeds that a search sees: the first third."""
    require(len(seeds) >= 3, "seeds", seeds, "at least three")
    return seeds[: len(seeds) // 3]


def evolve(
    family: Family,
    starts: Sequence[Sequence[float]],
    name: str,
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
    search: Search,
    progress: Progress | None = None,
) -> Tuned:
    """Return the best numbers that CMA-ES finds from each of several starts (P,) within the family's bounds.

    It sees a third of the seeds; the means of the distributions, the starts, and the best candidates of all generations (``finalists`` a start) are
    then compared on the others, which were not searched on, so that the luckiest candidate has no advantage.
    """
    with optional():
        from cmaes import CMA
    shown = searched(seeds)
    kept = seeds[len(shown) :]
    finalists: list[Array] = []
    tried, bounds = 0, family.bounds
    shape = np.diag((bounds[:, 1] - bounds[:, 0]) ** 2)
    for number, start in enumerate(starts):
        mean = np.asarray(start, dtype=np.float64)
        optimiser = CMA(mean=mean, sigma=search.sigma, bounds=bounds, seed=number + 1, population_size=search.population, cov=shape)
        seen: list[tuple[float, Array]] = []
        for _ in range(search.generations):
            candidates = np.array([optimiser.ask() for _ in range(search.population)])
            scores = mean_scores(family, candidates, name, shown, arguments)
            optimiser.tell([(candidate, -float(score)) for candidate, score in zip(candidates, scores, strict=True)])
            seen += zip(scores.tolist(), candidates, strict=True)
            tried += len(candidates)
            if progress is not None:
                progress(len(candidates))
        seen.sort(key=lambda pair: -pair[0])
        finalists += [mean, np.clip(optimiser.mean, *bounds.T), *(candidate for _, candidate in seen[: search.finalists])]
    best = best_of(family, np.array(finalists), name, kept, arguments)
    return Tuned(best.parameters, best.score, tried + best.candidates)
