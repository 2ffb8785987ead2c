"""A device in service: impacts, wear, heat, force range, baselines and uncertainty.

These are the data that the builder of the device needs.

`service_loads` is for the device of a search for a gap, under one swept force. `service` is for a
design of a problem: everything runs on fresh members. Its tolerances are tried one by one at both
ends, and jointly: each draw has all numbers off at once, uniformly within their tolerances, and a
member of its own, so that its quantiles cover both chaos and tolerances.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import count
from impact_env.curve import CurveCase, performance_curves
from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import Executor, Lane, Members, draw_members, each_lane, run_lanes
from impact_env.modes import Structure, modal_model
from impact_env.parameters import Beam
from impact_env.results import Record
from impact_env.sweep import simulate
from optimisation.absorber_rules import Baselines, simulate_baselines
from optimisation.gap_advice import Advice, Answer
from optimisation.insight import REPORT_SEEDS, levels, over_force
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
    impact_measures,
    prediction_interval,
)
from optimisation.objectives import Condition
from optimisation.problem import Problem, Progress, measured_chunks
from optimisation.space import (
    DAMPING,
    FRICTION_LIMIT,
    GAP,
    RESTITUTION,
    STIFFNESS,
    WITH_IMPACTS,
    Design,
    parts_of,
)
from optimisation.tolerances import Distribution, draw_lane, on_another_structure, shares

Array = NDArray[np.float64]
UNCERTAIN_DRAWS = 64
UNSEEN = 1  # seed of members that no search has seen
FACTORS = np.geomspace(0.25, 4.0, 97)  # of the force
EFFECTIVE_RATIO = 0.5  # of the level without absorber, which a device that works is below


@dataclass(frozen=True)
class ImpactLoads:
    """Loads of impacts over the worse of a sweep up and a sweep down.

    They are the largest and RMS relative speed (m/s), the number of impacts in a second, and the
    power lost in them (W).

    ``omega``: the higher frequency of the structure's level in rad/s.
    """

    largest: float
    rms: float
    rate: float
    power: float
    omega: float


@dataclass(frozen=True, eq=False)
class ServiceLoads:
    """Service loads of a device and levels in m (RMS) with other absorbers.

    ``works`` and ``helps`` are the lowest and highest of the simulated forces in N at which the
    device at least halves the level, and at which it lowers the level; NaN for none.
    """

    answer: Answer
    forces: Array
    levels: Array
    impacts: ImpactLoads
    works: tuple[float, float]
    helps: tuple[float, float]
    baselines: Baselines


def service_loads(advice: Advice, answer: Answer, executor: Executor) -> ServiceLoads:
    """Run a device with its impacts recorded, and baselines.

    The device is run once up and once down. Raises KeyboardInterrupt if the runs are stopped.
    """
    check = advice.check
    impacts = impact_loads(check.swept.curve_case(answer.absorber), executor)
    forces = check.force * FACTORS
    without = float(check.without.median[0]) / check.force
    levels = np.array([advice.at_force(answer, float(factor)) for factor in FACTORS])
    works, helps = (
        contiguous_range(forces, levels < share * without * forces, len(forces) // 2)
        for share in (EFFECTIVE_RATIO, 1.0)
    )
    baselines = simulate_baselines(
        check.model,
        check.absorber.mass_ratio,
        (check.force, check.resonance),
        check.limits,
        check.rate,
        executor,
    )
    return ServiceLoads(answer, forces, levels, impacts, works, helps, baselines)


def impact_loads(case: CurveCase, executor: Executor) -> ImpactLoads:
    """Run a case's first force once up and once down with its impacts recorded.

    Raises KeyboardInterrupt if the runs are stopped.
    """
    lanes = [
        Lane(case.scene, Drive(float(case.forces[0]), schedule), case.steady_start)
        for schedule in case.schedules()
    ]
    pairs = each_lane(lanes, _impacts, executor=executor)
    complete = [one for one in pairs if one is not None]
    if len(complete) < len(lanes):
        raise KeyboardInterrupt
    largest, rms, rate, power, ratio = (float(x) for x in np.max(complete, axis=0))
    return ImpactLoads(
        largest, rms, rate, power, ratio * case.scene.model.resonance_omega(case.resonance)
    )


def with_more_modes(structure: Structure) -> Beam | None:
    """Return a beam with twice the modes, as far as its elements allow.

    The result is None if the structure has no more modes, or none whose damping is known.
    """
    if not isinstance(structure, Beam) or isinstance(structure.damping_ratio, tuple):
        return None
    modes = min(2 * structure.modes, structure.freedoms)
    return None if modes <= structure.modes else replace(structure, modes=modes)


def change_with_modes(
    advice: Advice, answer: Answer, structure: Structure, seed: int, executor: Executor
) -> str:
    """Return a text on the change of a device's level with twice the modes.

    The text is empty if the structure has no more modes.
    """
    beam = with_more_modes(structure)
    check = advice.check
    if beam is None:
        return ""
    case = check.swept.curve_case(answer.absorber, modal_model(beam))
    (curve,) = performance_curves([case], advice.members, seed, executor=executor)
    return (
        f"; with {beam.modes} the level is {1e3 * curve.median[0]:.4g} mm, "
        f"{curve.median[0] / answer.level:.2f} times as high"
    )


def uncertain_levels(
    advice: Advice, answer: Answer, every: Sequence[Distribution], executor: Executor
) -> tuple[float, float, float]:
    """Return the 5, 50 and 95 % quantiles of a device's level in m under uncertainty.

    All uncertain quantities are drawn. Raises KeyboardInterrupt if the runs are stopped.
    """
    check = advice.check
    case = check.swept.curve_case(answer.absorber)
    ensemble = draw_members(UNCERTAIN_DRAWS + 1, UNSEEN)[1:]
    pairs = zip(
        *(ensemble.drives(check.force, schedule) for schedule in case.schedules()), strict=True
    )
    lanes = [
        draw_lane(
            Lane(case.scene, drive, case.steady_start), every, share, check.resonance, check.force
        )
        for pair, share in zip(pairs, shares(every, ensemble), strict=True)
        for drive in pair
    ]
    levels = run_lanes(lanes, executor=executor)
    if not levels.complete:
        raise KeyboardInterrupt
    low, median, high = np.quantile(
        levels.level.reshape(UNCERTAIN_DRAWS, 2).max(axis=1), (0.05, 0.5, 0.95)
    )
    return float(low), float(median), float(high)


def _impacts(lane: Lane) -> tuple[float, ...]:
    """Return a lane's `impact_measures`, and the frequency of its level over the resonance's."""
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=Record(events=True))
    assert response.level is not None
    return *impact_measures(response), response.level.frequency_ratio


def contiguous_range(forces: Array, good: NDArray[np.bool_], middle: int) -> tuple[float, float]:
    """Return the lowest and highest force of the good range around a force.

    ``middle``: index of that force. The result is NaN if that force is not good.
    """
    if not good[middle]:
        return float("nan"), float("nan")
    bad = np.flatnonzero(~good)
    first = int(np.max(bad[bad < middle], initial=-1)) + 1
    last = int(np.min(bad[bad > middle], initial=len(good))) - 1
    return float(forces[first]), float(forces[last])


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
# of the condition's force
FORCES = np.geomspace(1 / 4, 4, 17)
# of a lasting vibration: how many, time constants before it is watched, pseudo periods it is
# watched
FREQUENCIES = 21
SETTLING_CONSTANTS = 8.0
LASTING_PERIODS = 200.0


@dataclass(frozen=True, eq=False)
class Service:
    """Service data of a design at each of the problem's C conditions, the last axis of all arrays.

    Attributes
    ----------
    conditions : tuple of Condition
        The conditions.
    measures : dict of str to array, (3, C)
        For each of `SERVICE_MEASURES` the lower end, the median and the upper end of the interval
        that contains 90 % of further runs, in the units of `optimisation.measures.MEASURES`.
    forces : array, (2, C)
        Forces in N between which the level is at least halved; NaN if it is not at the condition's
        own force.
    single : dict of str to array, (2, C)
        Median level in m with a number too small and too large by its tolerance.
    joint : array, (quantiles, C)
        `QUANTILES` of the levels in m of ``draws`` with all numbers drawn.
    level : array, (C,)
        Median level in m of the nominal design.
    lasting : array, (C,)
        Largest stationary RMS in m over the range of the sweep.
    draws : int
        Number of draws.
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
    """Return the names of the uncertain numbers: the design's own, then the beam's."""
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
    """Return a design's runs with numbers off by shares (-1 to 1) of their tolerances.

    The sweeps follow the beam's own frequency.
    """
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
    """Return the measures of several sets of runs, each (members, conditions, measures).

    They are the larger ones of up and down.
    """
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
    """Return the largest RMS in m of the free end under forces of constant frequency, (C,).

    It is the largest over the frequencies of each condition's sweep.

    Each run begins at rest, settles for `SETTLING_CONSTANTS` time constants of the resonance, and
    then is watched for at least 200 pseudo periods.
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
    """Run a design as it will be used.

    ``members``: number of members for each point of ranges and tolerances. ``draws``: number of
    draws with all numbers off.

    Values to which a run contributes that the integrator could not finish are NaN. Raises
    ParameterError for numbers out of range.
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
