"""A design besides its score: its level over the force, detuned and in its neighbourhood, the sensitivity to its numbers; and in service."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from impact_env.drive import constant_frequency
from impact_env.ensemble import Executor, Lane, Members
from impact_env.parameters import count, fraction, instance, require, row
from optimisation.designs import Design, DesignSpace
from optimisation.evaluation import Progress, evaluate, measured_chunks
from optimisation.gap_card import contiguous_range
from optimisation.measures import (
    ACCELERATION,
    FRICTION_HEAT,
    IMPACT_POWER,
    IMPACT_RATE,
    IMPACT_RMS,
    IMPACT_SPEED,
    LEVEL,
    RMS,
    STROKE,
    Chunk,
)
from optimisation.objectives import Condition, Objective
from optimisation.problem import Problem
from optimisation.sobol import Sensitivity as Sensitivity
from optimisation.sobol import sobol_points, sobol_sensitivity
from optimisation.statistics import prediction_band, prediction_interval
from optimisation.uncertain import on_another_structure
from optimisation.variables import (
    DAMPING,
    FRICTION_LIMIT,
    GAP,
    RESTITUTION,
    STIFFNESS,
    WITH_IMPACTS,
    Variable,
    parts_of,
)

Array = NDArray[np.float64]
REPORT_SEEDS = 2  # set of fresh members on which all is run that is shown of a design; others choose and judge a winner
SPREAD = 0.2  # of a value, to either side: the neighbourhood of a design


@dataclass(frozen=True, eq=False)
class Levels:
    """Response levels in m: ``median`` of the members, the ends ``low`` and ``high`` of the interval that holds 90 % of fresh runs, and ``without``.

    Each is (designs, conditions), but for the level ``without`` absorber, (conditions,). Ends are NaN where the spread is not known. ``ratios``
    (designs, conditions): where a level was read, over the resonance, 0 under loads; None if that was not asked for.
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
    """Run designs under other conditions than a problem's own, for fresh ``members``, at its sweep rate or another ``rate``."""
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
    """Return single members' levels in m, (designs, members, conditions), and that without absorber, (members, conditions)."""
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
    """Return the ends (variables,) of a box around a design: its `varied` values (SI) times 1 -+ spread, cut to the space's bounds at the design."""
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
    """Return the Sobol indices (SciPy, Saltelli's estimator) of the first objective in a design's neighbourhood.

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


# A design in service, as its builder needs it: impacts, wear, heat, forces it serves, tolerances, and what a lasting vibration does.
#
# Everything is run on fresh members. Tolerances are tried one by one at both ends, and jointly: each draw has all numbers off at once, uniformly
# within their tolerances, and a member of its own, so that its quantiles cover both chaos and tolerances.


SERVICE_MEASURES_ANYWHERE = (FRICTION_HEAT, STROKE, ACCELERATION)
SERVICE_MEASURES = (IMPACT_SPEED, IMPACT_RMS, IMPACT_RATE, IMPACT_POWER, *SERVICE_MEASURES_ANYWHERE)
OF_BEAM = ("damping ratio", "frequency")
# what a number may be off by: a share of it, a difference, or a factor either way
TOLERANCES = {
    GAP: ("share", 0.1),
    RESTITUTION: ("difference", 0.1),
    FRICTION_LIMIT: ("factor", 1.5),
    STIFFNESS: ("share", 0.1),
    DAMPING: ("factor", 1.3),
}
BEAM_TOLERANCES = {OF_BEAM[0]: ("factor", 1.3), OF_BEAM[1]: ("share", 0.05)}
QUANTILES = (0.5, 0.9, 0.95)
DRAWS = 32
FEW = 4
# of the condition's force; the relative level that is asked of the range
FORCES = np.geomspace(1 / 4, 4, 17)
EFFECTIVE_RATIO = 0.5
# of a lasting vibration: how many, time constants before it is watched, pseudo periods it is watched
FREQUENCIES = 21
SETTLING_CONSTANTS = 8.0
LASTING_PERIODS = 200.0


@dataclass(frozen=True, eq=False)
class Service:
    """What is known of a design in service, at each of the problem's C conditions, the last axis of all arrays.

    ``measures``: for each of `SERVICE_MEASURES` the median of the members between the ends of the interval that holds 90 % of fresh runs, (3, C),
    in the units of `optimisation.measures.MEASURES`. ``forces`` (2, C) in N: between them it at least halves the level; NaN where it does not at the
    condition's own force. ``single``: for each tolerance the median level in m with the number too small and too large, (2, C). ``joint``
    (quantiles, C) in m: `QUANTILES` of the levels of ``draws`` with all of them off. ``level`` (C,) in m: the median with none off.
    ``lasting`` (C,) in m: the largest RMS of a vibration of constant frequency over the range of the sweep.
    """

    conditions: tuple[Condition, ...]
    measures: dict[str, Array]
    forces: Array
    single: dict[str, Array]
    joint: Array
    level: Array
    lasting: Array
    draws: int


def _shifted(value: float, kind: str, size: float, at: float) -> float:
    """Return a value that is off by ``at`` (-1 to 1) of a tolerance."""
    if kind == "share":
        return value * (1 + at * size)
    return value * size**at if kind == "factor" else float(np.clip(value + at * size, 0.0, 1.0))


def tolerances(design: Design) -> list[str]:
    """Return the names of what can be off: the design's own numbers, then the beam's."""
    own = [
        name
        for name in design.values
        if parts_of(name)[0] in TOLERANCES and design.values[name] > 0
    ]
    return [*own, *OF_BEAM]


def _chunks(
    problem: Problem,
    design: Design,
    off: dict[str, float],
    ensemble: Members,
    measures: tuple[str, ...],
) -> list[Chunk]:
    """Return a design's runs with numbers off by shares (-1 to 1) of their tolerances; the sweeps follow the beam's own frequency."""
    values = {
        name: _shifted(x, *TOLERANCES[parts_of(name)[0]], off[name]) if name in off else x
        for name, x in design.values.items()
    }
    damping = _shifted(1.0, *BEAM_TOLERANCES[OF_BEAM[0]], off.get(OF_BEAM[0], 0.0))
    frequency = _shifted(1.0, *BEAM_TOLERANCES[OF_BEAM[1]], off.get(OF_BEAM[1], 0.0))
    chunks = problem.chunks(Design(design.concept, values), ensemble, problem.rate)
    if damping == 1 and frequency == 1:
        return [replace(chunk, measures=measures) for chunk in chunks]
    lanes = (
        tuple(on_another_structure(lane, damping, frequency) for lane in chunk.lanes)
        for chunk in chunks
    )
    return [
        replace(chunk, lanes=own, measures=measures)
        for chunk, own in zip(chunks, lanes, strict=True)
    ]


def _run(
    problem: Problem,
    every: list[list[Chunk]],
    members: int,
    executor: Executor,
    progress: Progress | None,
) -> list[Array]:
    """Return the measures of several sets of runs, each (members, conditions, measures), the larger of up and down."""
    measured = measured_chunks([chunk for chunks in every for chunk in chunks], executor, progress)
    ends = np.cumsum([0, *(len(chunks) for chunks in every)])
    rows = [np.concatenate(measured[start:stop]) for start, stop in pairwise(ends)]
    return [
        np.asarray(
            row.reshape(len(problem.conditions), members, -1, row.shape[1])
            .max(axis=2)
            .transpose(1, 0, 2)
        )
        for row in rows
    ]


def service_measures(
    problem: Problem, design: Design, executor: Executor, progress: Progress | None = None
) -> tuple[dict[str, Array], Array]:
    """Return `Service.measures` of a design on fresh members, and the median level in m, (C,)."""
    ensemble = problem.fresh_ensemble(problem.members, REPORT_SEEDS)
    names = (
        LEVEL,
        *(SERVICE_MEASURES if design.concept in WITH_IMPACTS else SERVICE_MEASURES_ANYWHERE),
    )
    (measured,) = _run(
        problem, [_chunks(problem, design, {}, ensemble, names)], len(ensemble), executor, progress
    )
    median = np.median(measured, axis=0)
    intervals = {}
    for k, name in enumerate(names):
        if name == LEVEL:
            continue
        ends = np.array([prediction_interval(row) for row in measured[:, :, k].T])
        intervals[name] = np.array([ends[:, 0], median[:, k], ends[:, 1]])
    return intervals, np.asarray(median[:, 0])


def lasting_levels(
    problem: Problem, design: Design, executor: Executor, progress: Progress | None = None
) -> Array:
    """Return the largest RMS in m of the free end under a force of constant frequency, over frequencies of each condition's sweep, (C,).

    Each run begins at rest, settles for `SETTLING_CONSTANTS` time constants of the resonance, and then is watched for at least 200 pseudo periods.
    """
    ensemble = problem.fresh_ensemble(1, REPORT_SEEDS)
    begun = problem.chunks(design, ensemble, problem.rate)
    chunks = []
    for condition, chunk in zip(problem.conditions, begun, strict=True):
        scene = chunk.lanes[0].scene
        reference = chunk.lanes[0].drive.schedule.reference
        damping = max(float(scene.model.damping_ratio[condition.resonance - 1]), 1e-4)
        periods = 2 * max(
            SETTLING_CONSTANTS / (2 * np.pi * damping), LASTING_PERIODS
        )  # the second half is what the measure reads
        for ratio in np.linspace(*condition.limits, FREQUENCIES):
            drives = ensemble.drives(
                condition.force, constant_frequency(reference, float(ratio), periods)
            )
            chunks.append(
                replace(chunk, lanes=tuple(Lane(scene, drive) for drive in drives), measures=(RMS,))
            )
    measured = np.concatenate(measured_chunks(chunks, executor, progress))
    return np.asarray(measured.reshape(len(problem.conditions), FREQUENCIES).max(axis=1))


def service(
    problem: Problem,
    design: Design,
    executor: Executor,
    members: int = FEW,
    draws: int = DRAWS,
    progress: Progress | None = None,
) -> Service:
    """Run a design as it will be used; ``members`` for each point of ranges and tolerances, ``draws`` with all numbers off.

    What a run has a part in that the integrator gives up is NaN. Raises ParameterError for numbers out of range.
    """
    members = count("members", members, 1)
    draws = count("draws", draws, 1)
    problem = replace(problem, uncertain={})
    measures, level = service_measures(problem, design, executor, progress)
    forces = np.full((2, len(problem.conditions)), np.nan)
    for c, condition in enumerate(problem.conditions):
        part = levels(
            problem,
            [design],
            over_force(condition, condition.force * FORCES),
            members,
            executor,
            progress,
        )
        forces[:, c] = contiguous_range(
            condition.force * FORCES, part.relative[0] <= EFFECTIVE_RATIO, len(FORCES) // 2
        )
    names = tolerances(design)
    few = problem.fresh_ensemble(members, REPORT_SEEDS)
    many = problem.fresh_ensemble(draws, REPORT_SEEDS)
    ends = [
        _chunks(problem, design, {name: at}, few, (LEVEL,)) for name in names for at in (-1.0, 1.0)
    ]
    alone = np.median(
        np.array(_run(problem, ends, members, executor, progress))[..., 0], axis=1
    ).reshape(len(names), 2, -1)
    points = (
        2
        * scipy.stats.qmc.Halton(len(names), rng=np.random.default_rng(problem.seed)).random(draws)
        - 1
    )
    offs = [dict(zip(names, map(float, row), strict=True)) for row in points]
    sets = [_chunks(problem, design, off, many[k : k + 1], (LEVEL,)) for k, off in enumerate(offs)]
    joint = np.quantile(
        np.array(_run(problem, sets, 1, executor, progress))[:, 0, :, 0], QUANTILES, axis=0
    )
    lasting = lasting_levels(problem, design, executor, progress)
    return Service(
        problem.conditions,
        measures,
        forces,
        dict(zip(names, alone, strict=True)),
        np.asarray(joint),
        level,
        lasting,
        draws,
    )
