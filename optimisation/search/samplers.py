"""Samplers: methods that propose designs as points of the unit cube.

A sampler is asked for a batch, the batch is run, and its costs are passed to the sampler.

A coordinate of a point is the share of a free variable's range (`DesignSpace.at`). What a sampler
proposes follows from its seed and from all batches before, and nothing else: the same search run
again proposes the same designs.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impact_env.extras import optional

with optional():
    import cmaes

Array = NDArray[np.float64]
CMA_STEP = 1 / 6  # standard deviation of CMA-ES's first generation, in shares of the ranges


@dataclass(frozen=True)
class BatchCosts:
    """What a batch of n designs cost; all to be minimised.

    ``costs`` (n, objectives); ``violations`` (n, constraints), 0 or below where a constraint is
    kept; ``penalised`` (n,): the first objective's cost, or more than any cost where a constraint
    is broken.
    """

    costs: Array
    violations: Array
    penalised: Array


class Sampler(Protocol):
    """A method that proposes points from the costs of earlier ones."""

    def ask(self, count: int, first: Array | None = None) -> Array:
        """Return ``count`` points (count, variables).

        If the point ``first`` (variables,) is given, it comes first, followed by the ``count``
        points.
        """
        ...

    def tell(self, batch: BatchCosts) -> None:
        """Take the costs of all points that were returned last, in their order."""
        ...


def prepend(first: Array | None, points: Array) -> Array:
    """Return points (n, variables) below ``first``, if there is one."""
    return points if first is None else np.vstack([first, points])


class RandomSampler:
    """Uniformly distributed points."""

    def __init__(self, variables: int, seed: int) -> None:
        self._variables = variables
        self._generator = np.random.default_rng(seed)

    def ask(self, count: int, first: Array | None = None) -> Array:
        """See `Sampler`."""
        return prepend(first, self._generator.random((count, self._variables)))

    def tell(self, batch: BatchCosts) -> None:
        """See `Sampler`; costs change nothing."""


class CmaSampler:
    """CMA-ES by the package cmaes (N. Hansen, arXiv:1604.00772).

    Each batch is a generation. The search starts from the middle of the ranges.

    After it has converged it begins again at a random point. The point ``first`` of `ask` has no
    part in its distribution.
    """

    def __init__(self, variables: int, population: int, seed: int) -> None:
        self._population = population
        self._generator = np.random.default_rng(seed)
        self._points = np.empty((0, variables))
        self._optimiser = self._begin(np.full(variables, 0.5))

    def _begin(self, mean: Array) -> cmaes.CMA:
        bounds = np.tile([0.0, 1.0], (len(mean), 1))
        seed = int(self._generator.integers(2**31))
        return cmaes.CMA(mean, CMA_STEP, bounds, seed=seed, population_size=self._population)

    def ask(self, count: int, first: Array | None = None) -> Array:
        """See `Sampler`; ``count`` is the population."""
        if self._optimiser.should_stop():
            self._optimiser = self._begin(self._generator.random(self._points.shape[1]))
        self._points = np.array([self._optimiser.ask() for _ in range(count)])
        return prepend(first, self._points)

    def tell(self, batch: BatchCosts) -> None:
        """See `Sampler`."""
        costs = batch.penalised[-len(self._points) :].tolist()
        self._optimiser.tell(list(zip(self._points, costs, strict=True)))
