"""What `design_gap` answers: the gap with the lowest level, the one that is best over a tolerance of the force, and the runs that both rest on."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import CurveCase, PerformanceCurve
from impact_env.drive import PAPER_RATE, default_rate
from impact_env.ensemble import (
    Executor,
    Lane,
    LaneLevels,
    LaneProgress,
    draw_members,
    each_lane,
    run_lanes,
)
from impact_env.methods import Exact
from impact_env.modes import ModalModel
from impact_env.parameters import (
    ParameterError,
    SlidingAbsorber,
    count,
    friction_law,
    listed,
    one_of,
    positive,
    require,
)
from impact_env.results import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.bounds import design_gap, free_amplitude, reach
from optimisation.extremes import usable_force, usable_rate
from optimisation.gap_check import GapCheck, rigid_walls, scaled_absorber
from optimisation.gap_search import (
    CHECK_MEMBERS,
    NARROWEST,
    PAIRS,
    STEP,
    WIDEST,
    LevelSamples,
    bracket,
    find_best,
    level_between,
    search_gaps,
)
from optimisation.statistics import Prediction, predict
from optimisation.sweep_range import find_reading_ratios, find_sweep_range

Array = NDArray[np.float64]
MEMBERS = 3
TOLERANCE = 0.1  # of the force
MOST_TOLERANCE = 0.3
FASTER = 4.0  # times the rate of the answers: that of single runs for free variables
CANDIDATES = {
    "restitution": (0.5, 0.35, 0.2),
    "friction_limit": (0.0, 0.5, 2.0),
}  # what is tried of a free variable; friction as shares of the usual
LOW_REACH = (
    1.0  # free amplitude over the rule's gap, below which a search starts from the free amplitude
)
LOW_REACH_START = 0.4  # of the free amplitude
USELESS = 0.85  # of the level without absorber: a device that leaves more does not help


@dataclass(frozen=True)
class Limits:
    """Limits that a device must keep; None for none: ``stroke`` in m from the middle of the cavity, ``impact_speed`` in m/s (the largest)."""

    stroke: float | None = None
    impact_speed: float | None = None

    def __post_init__(self) -> None:
        for name in ("stroke", "impact_speed"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, positive(f"limit of {name}", value))


@dataclass(frozen=True, eq=False)
class Answer:
    """A device that was simulated: its absorber, its median ``level`` in m at the force, and the ``worst`` level over the tolerance of the force.

    ``members``: number of runs, each up and down. ``prediction``: of a fresh run's level; None where no gap ran twice. ``frequency_ratio``: where
    the level was read, over the resonance (the median of the runs); NaN under loads. ``impact_speed``: the largest in m/s; None if not recorded.
    """

    absorber: SlidingAbsorber
    level: float
    worst: float
    members: int
    prediction: Prediction | None
    frequency_ratio: float = math.nan
    impact_speed: float | None = None

    @property
    def gap(self) -> float:
        """Clearance to either wall in m."""
        return rigid_walls(self.absorber).gap

    @property
    def friction_limit(self) -> float:
        """Friction limit in N, 0 for none."""
        return 0.0 if self.absorber.friction is None else self.absorber.friction.limit

    @property
    def low(self) -> float:
        """Lower end of the interval in m that holds 90 % of fresh runs; NaN where no gap ran twice."""
        return math.nan if self.prediction is None else self.prediction.interval()[0]

    @property
    def high(self) -> float:
        """Upper end of the interval in m that holds 90 % of fresh runs; NaN where no gap ran twice."""
        return math.nan if self.prediction is None else self.prediction.interval()[1]


@dataclass(frozen=True, eq=False)
class Advice:
    """The answers and what they rest on.

    ``check`` has the runs; ``samples`` has their levels by steps from the gap ``reference`` (m). ``sweeps`` counts all runs, one member and one
    direction each. ``tried`` has what was tried of free variables: name, value, the lowest level of a single run there and its gap (m). The answers
    are None where nothing was finished. ``widest``: step of the widest gap that was allowed.
    """

    check: GapCheck
    samples: LevelSamples
    reference: float
    tolerance: float
    members: int
    sweeps: int
    sharp: Answer | None
    recommended: Answer | None
    complete: bool
    limits: Limits = Limits()
    narrowest: int = NARROWEST
    widest: int = WIDEST
    tried: tuple[tuple[str, float, float, float], ...] = ()

    @property
    def single_runs(self) -> tuple[tuple[float, float], ...]:
        """Gaps that only one of several members ran, and its levels, in m."""
        every = zip(self.check.gaps, self.check.curves, strict=True)
        return tuple(
            (float(gap), float(curve.median[0]))
            for gap, curve in every
            if len(curve.members) < min(2, self.members)
        )

    @cached_property
    def band(self) -> Array:
        """Ends in m of the interval that holds 90 % of fresh runs at each gap of ``check``, (2, G); NaN where no gap ran twice."""
        ends = []
        for gap, curve in zip(self.check.gaps, self.check.curves, strict=True):
            values = curve.combined[0][~np.isnan(curve.combined[0])]
            step = math.log(float(gap) / self.reference) / STEP
            prediction = predict(values, self.samples.groups_near(step)) if values.size else None
            ends.append((math.nan, math.nan) if prediction is None else prediction.interval())
        return np.array(ends).reshape(-1, 2).T

    def at_force(self, answer: Answer, factor: float) -> float:
        """Return the level in m of a device under ``factor`` times the force, by means of ln levels and the scaling law; NaN if not known."""
        steps, levels = self.samples.means()
        at = math.log(answer.gap / self.reference) - math.log(factor)
        return (
            math.nan
            if at > STEP * (steps[-1] + 1)
            else factor * float(level_between(STEP * steps, levels, at))
        )

    @property
    def at_end(self) -> bool:
        """Whether the best gap is the narrowest or the widest that may be tried, other than by a limit."""
        if self.sharp is None:
            return False
        step = round(math.log(self.sharp.gap / self.reference) / STEP)
        return step == self.narrowest or (step == self.widest and self.limits.stroke is None)

    @property
    def keeps_limits(self) -> bool:
        """Whether the recommended device keeps the limits."""
        answer = self.recommended
        most = self.limits.impact_speed
        return (
            answer is None
            or most is None
            or answer.impact_speed is None
            or answer.impact_speed <= most
        )


class SearchStopped(Exception):  # noqa: N818 - no error: what is finished is kept
    """A search was interrupted."""


def run_with_speeds(
    lanes: Sequence[Lane],
    speeds: bool,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> tuple[LaneLevels, Array | None]:
    """Run lanes; return their levels and, with ``speeds``, the largest impact speed of each in m/s, (L,). Arguments as in `run_lanes`."""
    if not speeds:
        return run_lanes(lanes, threads=threads, progress=progress, executor=executor), None
    pairs = each_lane(
        lanes,
        measure_level_and_speed,
        Exact(),
        threads=threads,
        progress=progress,
        executor=executor,
    )
    rows = np.array([(math.nan,) * 7 if one is None else one for one in pairs]).T
    level, time, ratio, tip, impacts, stuck, largest = rows
    complete = not np.isnan(level).any()
    return LaneLevels(level, time, ratio, tip, impacts, stuck, complete=complete), largest


def measure_level_and_speed(lane: Lane) -> tuple[float, ...]:
    """Run a lane; return the numbers of `LaneLevels` and the largest impact speed in m/s."""
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=Record(events=True))
    level = response.level
    impacts = response.impacts
    assert level is not None
    assert impacts is not None
    return (
        level.value,
        level.time,
        level.frequency_ratio,
        level.max_tip,
        float(response.impact_count),
        response.stuck_time,
        float(np.max(np.abs(impacts.relative_velocity), initial=0.0)),
    )


@dataclass(eq=False)
class GapRuns:
    """Runs at gaps by steps from the absorber's own gap, kept and continued member by member.

    ``range`` of the sweeps over the resonance; ``friction_goes``: the friction limit is in proportion to the gap; ``run`` returns the levels of
    lanes, and their impact speeds where these are wanted, for the lanes and the number of sweeps before (see `run_with_speeds`).
    """

    model: ModalModel
    force: float
    resonance: int
    absorber: SlidingAbsorber
    range: tuple[float, float]
    seed: int
    friction_goes: bool
    run: Callable[[Sequence[Lane], int], tuple[LaneLevels, Array | None]]
    sweeps: int = 0

    def __post_init__(self) -> None:
        self.curves: dict[tuple[float | None, float], PerformanceCurve] = {}
        self.speeds: dict[tuple[float | None, float], float] = {}

    def device(self, step: float) -> SlidingAbsorber:
        """Return the absorber of a gap; friction goes with it unless it was given."""
        factor = math.exp(STEP * step)
        friction = self.absorber.friction
        if friction is not None and self.friction_goes:
            friction = replace(friction, limit=friction.limit * factor)
        walls = rigid_walls(self.absorber)
        return replace(
            self.absorber, walls=replace(walls, gap=walls.gap * factor), friction=friction
        )

    def curve(self, step: float | None, members: int, rate: float) -> PerformanceCurve:
        """Return the levels of the first members at a gap, None for no absorber; those that were run before are not run again."""
        known = self.curves.get((step, rate))
        have = 0 if known is None else len(known.members)
        if known is not None and have >= members:
            return known
        scene = Scene(self.model, None if step is None else self.device(step))
        every = draw_members(members, self.seed)
        case = CurveCase(
            scene, np.array([self.force]), self.resonance, self.range, rate, steady_start=True
        )
        lanes = [
            Lane(scene, drive, steady_start=True)
            for m in range(have, members)
            for schedule in case.schedules()
            for drive in every[m : m + 1].drives(self.force, schedule)
        ]
        levels, speeds = self.run(lanes, self.sweeps)
        if not levels.complete:
            raise SearchStopped
        self.sweeps += len(lanes)
        names = [f.name for f in fields(LaneLevels) if f.name != "complete"]
        arrays = {name: getattr(levels, name).reshape(1, members - have, 2) for name in names}
        if known is not None:
            arrays = {
                name: np.concatenate([getattr(known.lanes, name), arrays[name]], axis=1)
                for name in names
            }
        curve = PerformanceCurve(case.forces, every, LaneLevels(**arrays, complete=True))
        self.curves[step, rate] = curve
        if speeds is not None:
            before = self.speeds.get((step, rate), 0.0)
            self.speeds[step, rate] = max(before, float(np.max(speeds)))
        return curve

    def levels(self, step: float, members: int, rate: float) -> Array:
        """Return the members' levels in m at a gap."""
        return self.curve(step, members, rate).combined[0, :members]

    def at_rate(self, rate: float) -> dict[float, PerformanceCurve]:
        """Return the runs with an absorber at a rate, by steps in their order."""
        return dict(
            sorted(
                (step, curve)
                for (step, of), curve in self.curves.items()
                if of == rate and step is not None
            )
        )

    def check(self, rule: float, free_over_rule: float, rate: float) -> GapCheck:
        """Return the runs at a rate; levels without an absorber that were not finished are NaN."""
        reference = rigid_walls(self.absorber).gap
        gaps = reference * np.exp(STEP * np.array([*self.at_rate(rate)], dtype=float))
        none = np.full((1, 1, 2), np.nan)
        nothing = PerformanceCurve(
            np.array([self.force]),
            draw_members(1, 0),
            LaneLevels(none, none, none, none, none, none, complete=False),
        )
        return GapCheck(
            self.model,
            self.resonance,
            self.force,
            self.absorber,
            rule,
            gaps,
            self.range,
            tuple(self.at_rate(rate).values()),
            self.curves.get((None, rate), nothing),
            free_over_rule,
            rate,
        )

    def forget_gaps(self) -> None:
        """Forget the runs with an absorber, whose other numbers have changed."""
        self.curves = {key: curve for key, curve in self.curves.items() if key[0] is None}
        self.speeds = {key: speed for key, speed in self.speeds.items() if key[0] is None}


def advise(
    model: ModalModel,
    force: float,
    resonance: int = 1,
    absorber: SlidingAbsorber | None = None,
    *,
    tolerance: float = TOLERANCE,
    free: Sequence[str] = (),
    friction_fixed: bool = False,
    factors: Sequence[float] = (),
    members: int = MEMBERS,
    seed: int = 0,
    percent_per_100_periods: float | None = None,
    limits: Limits | None = None,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> Advice:
    """Search the gap of an impact absorber for a ``force`` in N near a resonance by simulation, see `optimisation.gap_search`.

    ``absorber`` gives mass, restitution and friction (default: `scaled_absorber`); its friction limit belongs to the rule's gap and goes with the
    gap, unless it is ``friction_fixed``. ``tolerance``: share of the force. ``free``: names of `CANDIDATES`. ``factors``: further gaps to run, over
    the rule's. ``limits`` that the answers keep, if a gap that ran does. Interruption and the other arguments as in
    `impact_env.curve.performance_curves`. Raises ParameterError for numbers out of range, for an absorber without rigid walls, and where no gap that
    was simulated leaves less than `USELESS` of the level without absorber.
    """
    force = usable_force("force", force)
    require(
        0 <= tolerance <= MOST_TOLERANCE,
        "force_tolerance",
        tolerance,
        f"from 0 to {MOST_TOLERANCE:g}, a share of the force",
    )
    limits = Limits() if limits is None else limits
    wanted = [one_of("free", name, tuple(CANDIDATES)) for name in listed("free", free)]
    members = count("members", members, 1)
    own = scaled_absorber(model, force, resonance) if absorber is None else absorber
    walls = rigid_walls(own)
    mass = own.mass_ratio * model.beam_mass
    free_over_rule = reach(model, mass, resonance)
    sweep_range = find_sweep_range(model, own.mass_ratio, resonance)
    rule = design_gap(model, mass, force, resonance)
    rate = usable_rate(
        "rate",
        default_rate(model, (resonance,))
        if percent_per_100_periods is None
        else percent_per_100_periods,
        [sweep_range],
    )
    pairs = PAIRS if members <= MEMBERS else 10 + 5 * members
    expected = 2 * (1 + pairs + (CHECK_MEMBERS if members > 1 else 0))

    def run(lanes: Sequence[Lane], before: int) -> tuple[LaneLevels, Array | None]:
        show = (
            None
            if progress is None
            else lambda done, _all: progress(before + done, max(expected, before + len(lanes)))
        )
        return run_with_speeds(lanes, limits.impact_speed is not None, threads, show, executor)

    # the stroke limit is a gap that can be run itself
    reference = rule if limits.stroke is None else limits.stroke
    rule_step = math.log(rule / reference) / STEP
    friction = own.friction
    if friction is not None and not friction_fixed:
        friction = replace(friction, limit=friction.limit * reference / rule)
    runs = GapRuns(
        model,
        force,
        resonance,
        replace(own, walls=replace(walls, gap=reference), friction=friction),
        sweep_range,
        seed,
        not friction_fixed,
        run,
    )
    start = round(math.log(rule / reference * expected_factor(free_over_rule)) / STEP)
    widest = start + WIDEST if limits.stroke is None else min(start + WIDEST, 0)
    start = min(start, widest)
    narrowest = start + NARROWEST
    samples = LevelSamples()
    complete = True
    tried: list[tuple[str, float, float, float]] = []

    def levels(step: float, number: int) -> Array:
        measured = runs.levels(step, number, rate)
        if limits.impact_speed is not None:
            samples.excess[step] = math.log(
                max(runs.speeds[step, rate], 1e-300) / limits.impact_speed
            )
        return measured

    try:
        runs.curve(None, 1, rate)
        for name in wanted:
            fast = max(rate, min(PAPER_RATE, FASTER * rate))
            start = _choose_free(runs, name, start, widest, fast, tried)
        search_gaps(
            levels, start, tolerance, members, pairs, samples, (narrowest, widest), rule_step
        )
        for factor in factors:
            step = rule_step + math.log(factor) / STEP
            if step <= widest:
                samples.levels[step] = levels(step, members)
    except SearchStopped:
        complete = False
    samples.levels |= {step: curve.combined[0] for step, curve in runs.at_rate(rate).items()}
    ran = max((len(levels) for levels in samples.levels.values()), default=0)
    sharp = recommended = None
    if ran:
        best = find_best(samples, tolerance, min(members, ran))
        sharp, recommended = in_order(
            *(_answer(runs, samples, step, tolerance, rate) for step in best)
        )
    check = runs.check(rule, free_over_rule, rate)
    if complete and sharp is not None:
        _require_help(sharp, check, free_amplitude(model, mass, force, resonance))
    return Advice(
        check,
        samples,
        reference,
        tolerance,
        members,
        runs.sweeps,
        sharp,
        recommended,
        complete,
        limits,
        narrowest,
        widest,
        tuple(tried),
    )


def expected_factor(free_over_rule: float) -> float:
    """Return where a search starts, over the rule's gap, for the free amplitude over the rule's gap: a fit to simulations of other structures."""
    if free_over_rule < LOW_REACH:
        return max(LOW_REACH_START * free_over_rule, 1e-9)
    return 1.57 / (1 + 1.14 / free_over_rule)


def _require_help(sharp: Answer, check: GapCheck, free: float) -> None:
    """Raise ParameterError where even the best gap leaves more than `USELESS` of the level without absorber; ``free`` amplitude in m."""
    share = sharp.level / float(check.without.median[0])
    if share > USELESS:
        raise ParameterError(
            f"no gap helps for {check.force:g} N near resonance {check.resonance}: at best {100 * share:.0f} % of the level without absorber, with "
            f"{1e3 * sharp.gap:.4g} mm to either wall; without it its place moves {1e3 * free:.4g} mm, {check.reach:.3g} of the rule's gap (choose "
            "another place, a heavier absorber, or a structure with less damping)"
        )


def _answer(
    runs: GapRuns, samples: LevelSamples, step: float, tolerance: float, rate: float
) -> Answer:
    """Return a device that ran, with where its level was read and its impact speed."""
    (ratio,) = find_reading_ratios(runs.curves[step, rate])
    answer = answer_at(runs.device(step), samples, step, tolerance)
    return replace(
        answer,
        frequency_ratio=float(ratio),
        impact_speed=runs.speeds.get((step, rate)),
    )


def in_order(sharp: Answer, recommended: Answer) -> tuple[Answer, Answer]:
    """Return the two answers so that their medians do not contradict their names, as gaps are chosen by means."""
    lower = min(sharp, recommended, key=lambda answer: answer.level)
    steadier = min(recommended, sharp, key=lambda answer: answer.worst)
    return lower, steadier


def answer_at(
    absorber: SlidingAbsorber, samples: LevelSamples, step: float, tolerance: float
) -> Answer:
    """Return a device of the samples with its level, or what else is measured."""
    values = samples.levels[step]
    level = float(np.median(values))
    prediction = predict(values, samples.groups_near(step))
    return Answer(absorber, level, samples.worst(step, tolerance), len(values), prediction)


def _choose_free(
    runs: GapRuns,
    name: str,
    start: int,
    widest: int,
    rate: float,
    tried: list[tuple[str, float, float, float]],
) -> int:
    """Put the value of a free variable with the lowest single run into the runs' absorber, the gap searched for each; return the step of its gap."""
    usual = runs.absorber
    walls = rigid_walls(usual)
    friction = usual.friction
    values = (
        (walls.restitution, *CANDIDATES[name])
        if name == "restitution"
        else (1.0, *CANDIDATES[name])
    )
    best: tuple[float, int, SlidingAbsorber] | None = None
    for value in values:
        if name == "restitution":
            runs.absorber = replace(usual, walls=replace(walls, restitution=value))
        else:
            runs.absorber = replace(
                usual, friction=None if friction is None else friction_law(value * friction.limit)
            )
        runs.forget_gaps()
        logs = bracket(
            lambda n: math.log(float(runs.levels(n, 1, rate)[0])),
            start,
            (start + NARROWEST, widest),
            wide_runs=False,
        )
        step = min(logs, key=lambda n: logs[n])
        level = math.exp(logs[step])
        device = runs.device(step)
        number = value
        if name == "friction_limit":
            number = 0.0 if device.friction is None else device.friction.limit
        tried.append((name, number, level, rigid_walls(device).gap))
        if best is None or level < best[0]:
            best = (level, step, runs.absorber)
        start = step
    assert best is not None
    runs.absorber = best[2]
    runs.forget_gaps()
    return best[1]
