"""A design besides its score: its level over the force, detuned and in its neighbourhood, and the sensitivity to each of its numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import sobol_indices, uniform

from impact_env.curve import BAND
from impact_env.ensemble import Executor
from impact_env.parameters import count, fraction, require
from optimisation.designs import GAP, Design, DesignSpace, Variable
from optimisation.evaluation import Progress, evaluate
from optimisation.measures import LEVEL
from optimisation.objectives import Condition, Objective
from optimisation.problem import Problem

Array = NDArray[np.float64]
SHOWN = 2  # set of fresh members on which all is run that is shown of a design; others choose and judge a winner
SPREAD = 0.2  # of a value, to either side: the neighbourhood of a design


@dataclass(frozen=True, eq=False)
class Levels:
    """Response levels in m: ``median``, ``low`` and ``high`` (5 and 95 %) over the members, each (designs, conditions), and that without absorber."""

    conditions: tuple[Condition, ...]
    median: Array
    low: Array
    high: Array
    without: Array

    @property
    def relative(self) -> Array:
        """Median over the level without absorber, (designs, conditions)."""
        return np.asarray(self.median / self.without)


def levels(
    problem: Problem,
    designs: Sequence[Design],
    conditions: Sequence[Condition],
    members: int,
    executor: Executor,
    progress: Progress | None = None,
    rate: float | None = None,
) -> Levels:
    """Run designs under other conditions than a problem's own, for fresh ``members``, at its sweep rate or another ``rate``."""
    worse, without = member_levels(problem, designs, conditions, members, executor, progress, rate)
    low, median, high = np.quantile(worse, (BAND[0], 0.5, BAND[1]), axis=1)
    return Levels(tuple(conditions), median, low, high, np.median(without, axis=0))


def member_levels(
    problem: Problem,
    designs: Sequence[Design],
    conditions: Sequence[Condition],
    members: int,
    executor: Executor,
    progress: Progress | None = None,
    rate: float | None = None,
) -> tuple[Array, Array]:
    """Return single members' levels in m, (designs, members, conditions), and that without absorber, (members, conditions)."""
    count("members", members, 1)
    wider = replace(problem, conditions=tuple(conditions), objectives=(Objective(),), constraints=(), members=members)
    at = wider.measures.index(LEVEL)
    chosen = problem.rate if rate is None else rate
    worse = np.empty((len(designs), members, len(conditions)))
    fresh = problem.fresh_ensemble(members, SHOWN)
    for k, measured in evaluate(wider, designs, fresh, chosen, executor, progress):
        worse[k] = measured[..., at].max(axis=2)
    return worse, np.asarray(wider.reference(fresh, chosen)[..., at].max(axis=2))


def over_force(condition: Condition, forces: ArrayLike) -> list[Condition]:
    """Return a condition with other forces (F,) in N."""
    return [replace(condition, force=float(force)) for force in np.asarray(forces)]


def detuned(condition: Condition, shares: ArrayLike) -> list[Condition]:
    """Return a condition with the beam's frequencies shifted by shares (D,)."""
    return [replace(condition, detuning=float(share)) for share in np.asarray(shares)]


def with_gaps(design: Design, gaps: ArrayLike) -> list[Design]:
    """Return a design of an impact absorber with other gaps (G,) in m."""
    require(GAP in design.values, "design", str(design), "an impact absorber: only that has a gap")
    return [Design(design.concept, {**design.values, GAP: float(gap)}) for gap in np.asarray(gaps)]


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Sobol indices of the first objective around a design, with 95 % bootstrap intervals: share of its variance that a variable causes.

    Arrays (variables,), intervals (variables, 2). ``first`` is a variable's own share, ``total`` includes what it does with others. ``low`` and
    ``high`` are the ends of the box of values in SI units, ``spread`` the standard deviation of the objective in it.
    """

    names: tuple[str, ...]
    low: Array
    high: Array
    first: Array
    first_band: Array
    total: Array
    total_band: Array
    spread: float
    designs: int


def varied(space: DesignSpace) -> list[Variable]:
    """Return the free variables that have a neighbourhood: all but choices among whole numbers."""
    return [v for v in space.free if not v.whole]


def neighbourhood(space: DesignSpace, design: Design, spread: float = SPREAD) -> tuple[Array, Array]:
    """Return the ends (variables,) of a box around a design: its `varied` values (SI) times 1 -+ spread, cut to the space's bounds at the design."""
    share, free, at = fraction("spread", spread), varied(space), space.coordinates(design)
    values = np.array([design.values[v.name] for v in free])
    units = values / np.array([at[v.name] for v in free])
    low, high = (np.array([getattr(v, end) for v in free]) * units for end in ("low", "high"))
    return np.maximum(values * (1 - share), low), np.minimum(values * (1 + share), high)


def sensitivity(
    problem: Problem,
    design: Design,
    samples: int,
    members: int,
    executor: Executor,
    spread: float = SPREAD,
    progress: Progress | None = None,
) -> Sensitivity:
    """Return the Sobol indices (SciPy, Saltelli's estimator) of the first objective in a design's neighbourhood.

    ``samples``, a power of 2, stands for samples * (variables + 2) designs, each run for fresh
    ``members``. Constraints are left out. The objective's own
    noise counts as an interaction: it shows in the total indices only.
    """
    names = tuple(v.name for v in varied(problem.space))
    require(len(names) > 1, "free variables", list(names), "two or more: one alone causes everything")
    require(samples >= 2 and samples & (samples - 1) == 0, "samples", samples, "a power of 2")
    near = replace(problem, objectives=problem.objectives[:1], constraints=(), members=members)
    low, high = neighbourhood(problem.space, design, spread)
    runs, fresh = 0, problem.fresh_ensemble(members, SHOWN)

    def costs(x: Array) -> Array:
        nonlocal runs
        designs = [Design(design.concept, {**design.values, **dict(zip(names, map(float, row), strict=True))}) for row in x.T]
        result = np.empty(len(designs))
        for k, measured in evaluate(near, designs, fresh, near.rate, executor, progress):
            result[k] = near.cost(near.score(designs[k], measured, fresh, near.rate))
        runs += len(designs)
        require(bool(np.all(np.isfinite(result))), "neighbourhood", spread, "a smaller one: runs in it could not be finished")
        return result[None]

    generator = np.random.default_rng(problem.seed)
    values: list[Array] = []

    def noted(x: Array) -> Array:
        values.append(costs(x))
        return values[-1]

    result = sobol_indices(func=noted, n=samples, dists=[uniform(a, b - a) for a, b in zip(low, high, strict=True)], rng=generator)
    bands = result.bootstrap(0.95, n_resamples=500)
    first_band = np.array([bands.first_order.confidence_interval.low, bands.first_order.confidence_interval.high]).reshape(2, -1).T
    total_band = np.array([bands.total_order.confidence_interval.low, bands.total_order.confidence_interval.high]).reshape(2, -1).T
    first, total = np.ravel(result.first_order), np.ravel(result.total_order)
    return Sensitivity(names, low, high, first, first_band, total, total_band, float(np.std(np.concatenate(values, axis=1))), runs)
