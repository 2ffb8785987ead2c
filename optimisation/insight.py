"""Analyses of a design: level over the force, detuned, and around it, and sensitivity.

The sensitivity is that of the level to the design's variables.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import count, fraction, instance, require, row
from impact_env.ensemble import Executor
from optimisation.bounds import resonance_limit
from optimisation.measures import (
    LEVEL,
)
from optimisation.mounting import detuned as detuned_structure
from optimisation.objectives import Condition, Objective
from optimisation.problem import Problem, Progress, evaluate
from optimisation.sobol import Sensitivity as Sensitivity
from optimisation.sobol import sobol_points, sobol_sensitivity
from optimisation.space import (
    GAP,
    Design,
    DesignSpace,
    Variable,
)
from optimisation.statistics import prediction_band

Array = NDArray[np.float64]
# set of fresh members on which all is run that is shown of a design; others choose and judge a
# winner
REPORT_SEEDS = 2
SPREAD = 0.2  # of a value, to either side: the neighbourhood of a design


@dataclass(frozen=True, eq=False)
class Levels:
    """Response levels in m of designs under conditions.

    ``median``: of the members. ``low`` and ``high``: ends of the interval that holds 90 % of fresh
    runs. ``without``: without absorber.

    Each is (designs, conditions), but for the level ``without`` absorber, (conditions,). Ends are
    NaN where the spread is not known. ``ratios`` (designs, conditions): where a level was read,
    over the resonance, 0 under loads; None if that was not asked for.
    """

    conditions: tuple[Condition, ...]
    median: Array
    low: Array
    high: Array
    without: Array
    ratios: Array | None = None

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
    """Run designs under other conditions than a problem's own.

    They are run for fresh ``members``, at the problem's sweep rate or another ``rate``.
    """
    worse, without = member_levels(problem, designs, conditions, members, executor, progress, rate)
    low, high = np.moveaxis(np.array([prediction_band(one.T) for one in worse]), 1, 0)
    return Levels(
        tuple(conditions), np.median(worse, axis=1), low, high, np.median(without, axis=0)
    )


def member_levels(
    problem: Problem,
    designs: Sequence[Design],
    conditions: Sequence[Condition],
    members: int,
    executor: Executor,
    progress: Progress | None = None,
    rate: float | None = None,
) -> tuple[Array, Array]:
    """Return single members' levels in m, with and without absorber.

    They are (designs, members, conditions), and (members, conditions) without absorber.
    """
    members = count("members", members, 1)
    wider = replace(
        problem,
        conditions=tuple(conditions),
        objectives=(Objective(),),
        constraints=(),
        members=members,
    )
    at = wider.measures.index(LEVEL)
    chosen = problem.rate if rate is None else rate
    worse = np.empty((len(designs), members, len(conditions)))
    fresh = problem.fresh_ensemble(members, REPORT_SEEDS)
    for k, measured in evaluate(wider, designs, fresh, chosen, executor, progress):
        worse[k] = measured[..., at].max(axis=2)
    return worse, np.asarray(wider.reference(fresh, chosen)[..., at].max(axis=2))


def over_force(condition: Condition, forces: ArrayLike) -> list[Condition]:
    """Return a condition with other forces (F,) in N."""
    condition = instance("condition", condition, Condition)
    return [
        replace(condition, force=float(force))
        for force in row("forces", forces, "a row of forces in N")
    ]


def detuned(condition: Condition, shares: ArrayLike) -> list[Condition]:
    """Return a condition with the beam's frequencies shifted by shares (D,)."""
    condition = instance("condition", condition, Condition)
    return [
        replace(condition, detuning=float(share))
        for share in row("shares", shares, "a row of numbers")
    ]


def with_gaps(design: Design, gaps: ArrayLike) -> list[Design]:
    """Return a design of an impact absorber with other gaps (G,) in m."""
    design = instance("design", design, Design)
    require(GAP in design.values, "design", str(design), "an impact absorber: only that has a gap")
    return [
        Design(design.concept, {**design.values, GAP: float(gap)})
        for gap in row("gaps", gaps, "a row of gaps in m")
    ]


def varied(space: DesignSpace) -> list[Variable]:
    """Return the free variables that have a neighbourhood: all but choices among whole numbers."""
    return [v for v in space.free if not v.whole]


def neighbourhood(
    space: DesignSpace, design: Design, spread: float = SPREAD
) -> tuple[Array, Array]:
    """Return the ends (variables,) of a box around a design.

    The box is the design's `varied` values (SI) times 1 -+ spread, cut to the bounds of the space
    at the design.
    """
    space = instance("space", space, DesignSpace)
    design = instance("design", design, Design)
    share = fraction("spread", spread)
    free = varied(space)
    at = space.coordinates(design)
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
    progress: Progress | None = None,
) -> Sensitivity:
    """Return the Sobol indices of the first objective in a design's neighbourhood.

    They are computed by SciPy with Saltelli's estimator.

    ``samples``, a power of 2, stands for samples * (variables + 2) designs, each run for fresh
    ``members``. Constraints are left out. The objective's own
    noise counts as an interaction: it shows in the total indices only.
    """
    names = tuple(v.name for v in varied(problem.space))
    require(
        len(names) > 1, "free variables", list(names), "two or more: one alone causes everything"
    )
    near = replace(problem, objectives=problem.objectives[:1], constraints=(), members=members)
    low, high = neighbourhood(problem.space, design)
    fresh = problem.fresh_ensemble(members, REPORT_SEEDS)
    points = sobol_points(samples, low, high, problem.seed)
    designs = [
        Design(design.concept, {**design.values, **dict(zip(names, values, strict=True))})
        for values in points.reshape(-1, len(names)).tolist()
    ]
    costs = np.empty(len(designs))
    for k, measured in evaluate(near, designs, fresh, near.rate, executor, progress):
        costs[k] = near.cost(near.score(designs[k], measured, fresh, near.rate))
    allowed = "a smaller one: runs in it could not be finished"
    require(bool(np.all(np.isfinite(costs))), "neighbourhood", SPREAD, allowed)
    return sobol_sensitivity(names, low, high, costs.reshape(points.shape[:2]), problem.seed)


def stationary_limit(problem: Problem, design: Design, condition: Condition) -> float:
    """Return the stationary limit in m of the level that no device in the cavities can beat.

    It is NaN if an absorber has no cavity, and under loads.

    See `optimisation.bounds`; a sweep's level is near it, not bound by it.
    """
    if condition.loads is not None:
        return math.nan
    scene = design.scene(detuned_structure(problem.beam, condition.detuning))
    cavities = [scene.cavity(which) for which in range(scene.places)]
    gaps = [cavity.gap for cavity in cavities if cavity is not None]
    if len(gaps) < len(cavities):
        return math.nan
    return float(
        resonance_limit(
            scene.model,
            scene.absorber_masses,
            gaps,
            condition.force,
            condition.resonance,
            *condition.limits,
        )
    )
