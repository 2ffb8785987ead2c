"""Analyses of a design: level over the force, detuned, and around it, and sensitivity.

The sensitivity is that of the level to the design's variables, by Sobol indices.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import ParameterError, count, fraction, instance, require, row
from impact_env.curve import CurveCase
from impact_env.drive import Drive
from impact_env.ensemble import Executor, Lane, LaneProgress, draw_members, run_lanes
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import Beam, RigidWalls, SlidingAbsorber
from impact_env.scene import Scene
from optimisation.bounds import resonance_limit
from optimisation.measures import (
    COVERED,
    LEVEL,
    prediction_band,
)
from optimisation.mounting import detune as detuned_structure
from optimisation.objectives import Condition, Objective
from optimisation.problem import Problem, Progress, evaluate
from optimisation.space import (
    GAP,
    Design,
    DesignSpace,
    Variable,
)

# Sobol indices show on which parameters of a device its level depends. Points, estimator (Saltelli
# 2010) and indices are SciPy's; its bootstrap takes no seed, so that its intervals differ from call
# to call. Here the rows of the samples are drawn again by a generator with a seed.

Array = NDArray[np.float64]
SOBOL_RESAMPLES = 500
SOBOL_SEED = 99  # of members that no search has seen
# half widths of a device's box: shares of gap, friction limit, mass and force, differences of
# restitution and of the place over the length
DEVICE_BOX = {
    "gap": 0.1,
    "restitution": 0.1,
    "friction": 0.5,
    "mass": 0.05,
    "force": 0.1,
    "place": 0.02,
}
BOX_UNITS = {
    "gap": "m",
    "restitution": "",
    "friction": "N",
    "mass": "kg",
    "force": "N",
    "place": "",
}
BOX_DIFFERENCES = ("restitution", "place")


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Sobol indices of a value around a design, with 95 % bootstrap intervals.

    An index is the share of the value's variance that a variable causes.

    Attributes
    ----------
    names : tuple of str
        Variables, (V,).
    low, high : array, (V,)
        Ends of the box of values in SI units.
    first, total : array, (V,)
        Share of each variable alone, and including its interactions with others.
    first_band, total_band : array, (V, 2)
        Their intervals.
    spread : float
        Standard deviation of the value in the box.
    designs : int
        Number of designs that were run.
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


def sobol_points(samples: int, low: ArrayLike, high: ArrayLike, seed: int) -> Array:
    """Return the points of Saltelli's method in a box, (d + 2, samples, d).

    They are A, B, and A with a column of B for each variable.

    ``samples``: a power of 2; ``low``, ``high``: ends (d,) of the box.
    """
    samples = count("samples", samples, 2)
    require(samples & (samples - 1) == 0, "samples", samples, "a power of 2")
    low, high = row("low", low, "a row of numbers"), row("high", high, "a row of numbers")
    d = len(low)
    sampler = scipy.stats.qmc.Sobol(2 * d, rng=np.random.default_rng(seed), bits=64)
    unit = sampler.random(samples)
    first = low + (high - low) * unit[:, :d]
    second = low + (high - low) * unit[:, d:]
    mixed = np.repeat(first[None], d, axis=0)
    for k in range(d):
        mixed[k, :, k] = second[:, k]
    return np.concatenate([first[None], second[None], mixed])


def sobol_sensitivity(
    names: tuple[str, ...], low: Array, high: Array, values: ArrayLike, seed: int = 0
) -> Sensitivity:
    """Return the indices of the ``values`` (d + 2, samples) at `sobol_points`.

    Their intervals are those of a seeded bootstrap over the samples.

    Examples
    --------
    >>> points = sobol_points(256, [0.0, 0.0], [1.0, 1.0], 0)
    >>> values = points[..., 0] + 2 * points[..., 1]
    >>> sensitivity = sobol_sensitivity(("x", "y"), np.zeros(2), np.ones(2), values)
    >>> sensitivity.first.round(1)
    array([0.2, 0.8])
    """
    rows = row("values", values, "a finite number for each point", axes=2)
    samples = rows.shape[1]

    def indices(which: NDArray[np.int64]) -> tuple[Array, Array]:
        part = rows[:, which]
        result = scipy.stats.sobol_indices(
            func={"f_A": part[:1], "f_B": part[1:2], "f_AB": part[2:, None]}, n=samples
        )
        return np.ravel(result.first_order), np.ravel(result.total_order)

    generator = np.random.default_rng([seed, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        first, total = indices(np.arange(samples))
        drawn = generator.integers(0, samples, (SOBOL_RESAMPLES, samples))
        again = [indices(which) for which in drawn]
        ends = ((1 - COVERED) / 2, (1 + COVERED) / 2)
        first_band, total_band = (
            np.nanquantile(np.array(part), ends, axis=0).T for part in zip(*again, strict=True)
        )
    return Sensitivity(
        names, low, high, first, first_band, total, total_band, float(np.std(rows)), rows.size
    )


def device_box(case: CurveCase, structure: Structure) -> dict[str, tuple[float, float]]:
    """Return the ends of the box around a case's device by name, in SI units.

    See `DEVICE_BOX`. The place is included on a beam only.
    """
    absorber = case.scene.absorber
    if not isinstance(absorber, SlidingAbsorber) or not isinstance(absorber.walls, RigidWalls):
        raise ParameterError(
            f"absorber = {absorber} is not allowed: one impact absorber between rigid walls"
        )
    values = {
        "gap": absorber.walls.gap,
        "restitution": float(absorber.walls.restitution),
        "friction": 0.0 if absorber.friction is None else absorber.friction.limit,
        "mass": absorber.mass_ratio * case.scene.model.beam_mass,
        "force": float(case.forces[0]),
    }
    if isinstance(structure, Beam):
        values["place"] = structure.absorber_position
    box = {}
    for name, value in values.items():
        if name == "friction" and value == 0:
            continue
        half = DEVICE_BOX[name] * (1.0 if name in BOX_DIFFERENCES else value)
        low = value - half
        high = value + half
        if name in BOX_DIFFERENCES:
            low, high = max(low, 0.0), min(high, 1.0)
        box[name] = (low, high)
    return box


def device_sensitivity(
    case: CurveCase,
    structure: Structure,
    samples: int,
    *,
    seed: int = 0,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> Sensitivity:
    """Return the Sobol indices of an impact absorber's level in the box around it.

    Parameters
    ----------
    case : CurveCase
        Scene with an impact absorber between rigid walls, force (the first), resonance and sweeps.
    structure : Beam or ModalModel
        What the absorber is on: on a beam its place is one of the variables, and the level stays
        where it is read.
    samples : int
        A power of 2; (variables + 2) times as many devices run, each once up and once down, all
        with one member's phase. What runs differ by chance counts as an interaction of all
        variables: it shows in the total indices only.
    seed : int
        Of the points and the intervals.
    progress, executor
        As in `impact_env.ensemble.run_lanes`.

    Returns
    -------
    Sensitivity
        Of the level in m.

    """
    box = device_box(case, structure)
    names = tuple(box)
    low, high = np.array([*box.values()]).T
    points = sobol_points(samples, low, high, seed)
    (factor,), (phase,) = (
        getattr(draw_members(2, SOBOL_SEED), name)[1:] for name in ("factors", "phases")
    )
    make = _scene_maker(case, structure)
    lanes = []
    for point in points.reshape(-1, len(names)).tolist():
        values = dict(zip(names, point, strict=True))
        scene = make(values)
        for schedule in case.schedules():
            drive = Drive(values["force"] * float(factor), schedule, float(phase))
            lanes.append(Lane(scene, drive, case.steady_start))
    runs = run_lanes(lanes, progress=progress, executor=executor)
    if not runs.complete:
        raise KeyboardInterrupt
    levels = runs.level.reshape(points.shape[0], points.shape[1], 2).max(axis=2)
    return sobol_sensitivity(names, low, high, levels, seed)


def _scene_maker(case: CurveCase, structure: Structure) -> Callable[[dict[str, float]], Scene]:
    """Return the function that makes the scene of a device's values."""
    model = case.scene.model
    absorber = case.scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    walls = absorber.walls
    friction = absorber.friction
    assert isinstance(walls, RigidWalls)

    def model_at(place: float) -> ModalModel:
        assert isinstance(structure, Beam)
        level = structure.response_position
        level = structure.absorber_position if level is None else level
        return modal_model(replace(structure, absorber_position=place, response_position=level))

    def make(values: dict[str, float]) -> Scene:
        limit = values.get("friction")
        own = replace(
            absorber,
            mass_ratio=values["mass"] / model.beam_mass,
            walls=replace(walls, gap=values["gap"], restitution=values["restitution"]),
            friction=friction
            if friction is None or limit is None
            else replace(friction, limit=limit),
        )
        return Scene(model_at(values["place"]) if "place" in values else model, own)

    return make


# set of fresh members on which all is run that is shown of a design; others choose and judge a
# winner
REPORT_SEEDS = 2
SPREAD = 0.2  # of a value, to either side: the neighbourhood of a design


@dataclass(frozen=True, eq=False)
class Levels:
    """Response levels in m of designs under conditions.

    Attributes
    ----------
    conditions : tuple of Condition
        The conditions.
    median : array, (designs, conditions)
        Median over the members.
    low, high : array, (designs, conditions)
        Ends of the interval that contains 90 % of further runs, NaN if the spread is not known.
    without : array, (conditions,)
        Level without absorber.
    ratios : array, (designs, conditions), or None
        Frequency at each level's maximum over the resonance, 0 under loads.
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


def detuned_conditions(condition: Condition, shares: ArrayLike) -> list[Condition]:
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


def list_varied(space: DesignSpace) -> list[Variable]:
    """Return the free variables that have a neighbourhood: all but choices among whole numbers."""
    return [v for v in space.free if not v.whole]


def neighbourhood(
    space: DesignSpace, design: Design, spread: float = SPREAD
) -> tuple[Array, Array]:
    """Return the ends (variables,) of a box around a design.

    The box is the design's values (SI) of `list_varied` times 1 -+ spread, cut to the bounds of the
    space at the design.
    """
    space = instance("space", space, DesignSpace)
    design = instance("design", design, Design)
    share = fraction("spread", spread)
    free = list_varied(space)
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
    names = tuple(v.name for v in list_varied(problem.space))
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
