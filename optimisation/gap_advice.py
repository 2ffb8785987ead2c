"""Which gap: levels at gaps, the gap with the lowest level, and the robust gap.

The robust gap is the best over a tolerance of the force.

`search_gap` brackets the best gap (`optimisation.gap_search`) under a load case
(`optimisation.load_cases`); `check_gap` runs gaps around the design rule's for a swept force.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, count, listed, one_of, positive, require
from impact_env.curve import DEFAULT_MEMBERS, PerformanceCurve, performance_curves
from impact_env.drive import PAPER_RATE
from impact_env.ensemble import Executor, Lane, LaneLevels, LaneProgress, draw_members
from impact_env.modes import ModalModel
from impact_env.parameters import SlidingAbsorber, friction_law
from optimisation.absorber_rules import rigid_walls, scaled_absorber
from optimisation.bounds import free_amplitude, resonance_limit, share_reached
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
from optimisation.load_cases import (
    NO_READING,
    AppliedLoads,
    LoadCase,
    Reading,
    RunOptions,
    SweptForce,
    find_reading,
    swept_force,
)
from optimisation.measures import Prediction, predict
from optimisation.sweep_range import (
    LEAST_RATIO,
    find_reading_ratios,
    stationary_level,
    usable_force,
)

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
SPAN = 2.5  # gaps reach from the rule's over this to the rule's times this


@dataclass(frozen=True)
class Limits:
    """Limits of a device; None: no limit.

    ``stroke`` is in m from the middle of the cavity, ``impact_speed`` the largest impact speed in
    m/s.
    """

    stroke: float | None = None
    impact_speed: float | None = None

    def __post_init__(self) -> None:
        for name in ("stroke", "impact_speed"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, positive(f"limit of {name}", value))


@dataclass(frozen=True, eq=False)
class Answer:
    """A simulated device with its levels.

    Attributes
    ----------
    absorber : SlidingAbsorber
        The device.
    level : float
        Median level in m at the force.
    worst : float
        Highest level over the tolerance of the force in m.
    members : int
        Number of runs, each up and down.
    prediction : Prediction or None
        Prediction of a further run's level; None if no gap ran twice.
    frequency_ratio : float
        Median over the runs of the frequency at the level's maximum over the resonance; NaN under
        loads.
    impact_speed : float or None
        Largest impact speed in m/s, None if not recorded.
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
        """Lower end in m of the interval that holds 90 % of fresh runs.

        It is NaN if no gap was run twice.
        """
        return math.nan if self.prediction is None else self.prediction.interval()[0]

    @property
    def high(self) -> float:
        """Upper end in m of the interval that holds 90 % of fresh runs.

        It is NaN if no gap was run twice.
        """
        return math.nan if self.prediction is None else self.prediction.interval()[1]


@dataclass(frozen=True, eq=False)
class GapCheck:
    """Levels over the gap under a load case.

    Attributes
    ----------
    case : LoadCase
        Structure and load.
    absorber : SlidingAbsorber
        Mass, restitution and friction of the device.
    rule : float
        The design rule's gap in m, NaN if the rule does not apply.
    gaps : array, (G,)
        Gaps in m, ascending.
    curves : tuple of PerformanceCurve
        Runs at each gap.
    without : PerformanceCurve
        Runs without absorber.
    """

    case: LoadCase
    absorber: SlidingAbsorber
    rule: float
    gaps: Array
    curves: tuple[PerformanceCurve, ...]
    without: PerformanceCurve

    @property
    def model(self) -> ModalModel:
        """Structure without absorber."""
        return self.case.model

    @property
    def swept(self) -> SweptForce:
        """The swept force; raises TypeError under other loads."""
        if not isinstance(self.case, SweptForce):
            raise TypeError("levels under loads have neither resonance nor limit")
        return self.case

    @property
    def force(self) -> float:
        """Amplitude of the swept force in N."""
        return self.swept.force

    @property
    def resonance(self) -> int:
        """Resonance near which the force is swept, counted from 1."""
        return self.swept.resonance

    @property
    def limits(self) -> tuple[float, float]:
        """Ends of the sweeps over the resonance."""
        return self.swept.limits

    @property
    def rate(self) -> float:
        """Rate of the sweeps in % of the resonance per 100 pseudo periods."""
        return self.swept.rate

    @cached_property
    def reach(self) -> float:
        """Free amplitude over the rule's gap, `optimisation.bounds.reach`; NaN without a rule."""
        return self.case.reach(self.mass)

    @property
    def sweep_ratio(self) -> float:
        """Level of the sweeps without absorber over the stationary level.

        It is NaN if no run is finished. Below `LEAST_RATIO` the shares of the possible reduction
        are left out.
        """
        return float(self.without.median[0]) / (
            self.force * stationary_level(self.model, self.resonance, self.limits)
        )

    @property
    def mass(self) -> float:
        """Absorber mass in kg."""
        return self.absorber.mass_ratio * self.model.beam_mass

    @property
    def complete(self) -> bool:
        """Whether all runs were made."""
        return self.without.complete and all(curve.complete for curve in self.curves)

    @property
    def level(self) -> Array:
        """Median level in m at each gap, (G,); NaN where nothing is finished."""
        return np.array([curve.median[0] for curve in self.curves])

    @property
    def band(self) -> Array:
        """5 and 95 % quantiles of the level in m, (2, G)."""
        return np.array([curve.band[:, 0] for curve in self.curves]).reshape(-1, 2).T

    @property
    def relative(self) -> Array:
        """Median level over that without absorber, (G,)."""
        return np.asarray(self.level / self.without.median[0])

    @cached_property
    def limit(self) -> Array:
        """Limit in m of the stationary level over the sweep's range at each gap, (G,)."""
        return np.array([float(self.limit_at(gap)) for gap in self.gaps])

    def limit_at(self, gap: float) -> float:
        """Return the limit in m for a gap in m."""
        return float(
            resonance_limit(self.model, self.mass, gap, self.force, self.resonance, *self.limits)
        )

    @property
    def out_of_reach(self) -> NDArray[np.bool_]:
        """Gaps whose limit is not below the stationary level without absorber, (G,).

        For these the response is near a node of the resonance.
        """
        without = self.force * stationary_level(self.model, self.resonance, self.limits)
        return np.asarray(self.limit >= without)

    @cached_property
    def share(self) -> Array:
        """Share of the possible reduction that each gap reached, (G,).

        NaN where nothing is finished or nothing is possible (`out_of_reach`), and all NaN for
        sweeps too fast to tell.
        """
        shares = np.full(len(self.gaps), np.nan)
        if not self.sweep_ratio >= LEAST_RATIO:
            return shares
        for k in np.flatnonzero(~np.isnan(self.level) & ~self.out_of_reach):
            shares[k] = share_reached(
                self.model,
                self.mass,
                float(self.gaps[k]),
                self.force,
                self.level[k],
                self.resonance,
                *self.limits,
            )
        return shares

    @property
    def at_rule(self) -> int:
        """Index of the rule's gap."""
        return int(np.argmin(np.abs(self.gaps - self.rule)))

    @property
    def best(self) -> int | None:
        """Index of the gap with the smallest median level, None if nothing is finished."""
        return None if np.isnan(self.level).all() else int(np.nanargmin(self.level))


@dataclass(frozen=True, eq=False)
class Advice:
    """The gap with the lowest level (``sharp``) and the recommended one, with the runs behind them.

    Attributes
    ----------
    check : GapCheck
        The runs.
    samples : LevelSamples
        Levels by steps from the gap ``reference`` (m).
    tolerance : float
        Force tolerance.
    members : int
        Members of the gaps of a result.
    sweeps : int
        Number of all runs, one member and one direction each.
    sharp, recommended : Answer or None
        Results, None if no gap is finished.
    complete : bool
        Whether the search was finished.
    limits : Limits
        Limits of the device.
    narrowest, widest : int
        Steps of the narrowest and the widest allowed gap.
    tried : tuple
        Trials of free variables: name, value, lowest level of a single run and its gap (m).
    reading : Reading or None
        Where the level of the recommended device occurs, under loads with a schedule.
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
    reading: Reading = NO_READING

    @property
    def case(self) -> LoadCase:
        """What acts on the structure."""
        return self.check.case

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
        """Ends in m of the interval that holds 90 % of fresh runs at each gap of ``check``, (2, G).

        They are NaN if no gap was run twice.
        """
        ends = []
        for step, curve in zip(sorted(self.samples.levels), self.check.curves, strict=True):
            values = curve.combined[0][~np.isnan(curve.combined[0])]
            prediction = predict(values, self.samples.groups_near(step)) if values.size else None
            ends.append((math.nan, math.nan) if prediction is None else prediction.interval())
        return np.array(ends).reshape(-1, 2).T

    def at_force(self, answer: Answer, factor: float) -> float:
        """Return the level in m of a device under ``factor`` times the force.

        It follows from means of ln levels and the scaling law, and is NaN if it is not known.
        """
        steps, levels = self.samples.means()
        at = math.log(answer.gap / self.reference) - math.log(factor)
        return (
            math.nan
            if at > STEP * (steps[-1] + 1)
            else factor * float(level_between(STEP * steps, levels, at))
        )

    @property
    def at_end(self) -> bool:
        """Whether the best gap is the narrowest or the widest allowed gap.

        An end that is set by a limit does not count.
        """
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


# lanes and the number of runs before -> their levels, and their impact speeds where these are
# wanted
RunLanes = Callable[[Sequence[Lane], int], tuple[LaneLevels, Array | None]]


@dataclass(eq=False)
class GapRuns:
    """Runs at gaps, by steps from the absorber's own gap; more members can be added to each.

    ``friction_goes``: whether the friction limit is proportional to the gap. ``runs`` is the number
    of runs so far.
    """

    case: LoadCase
    absorber: SlidingAbsorber
    seed: int
    friction_goes: bool
    run: RunLanes
    runs: int = 0

    def __post_init__(self) -> None:
        self.curves: dict[float | None, PerformanceCurve] = {}
        self.speeds: dict[float | None, float] = {}

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

    def curve(self, step: float | None, members: int) -> PerformanceCurve:
        """Return the levels of the first members at a gap, or without absorber (None).

        Members that were run before are not run again.
        """
        known = self.curves.get(step)
        have = 0 if known is None else len(known.members)
        if known is not None and have >= members:
            return known
        every = draw_members(members, self.seed)
        lanes = self.case.lanes(None if step is None else self.device(step), every, have)
        levels, speeds = self.run(lanes, self.runs)
        if not levels.complete:
            raise SearchStopped
        self.runs += len(lanes)
        names = [f.name for f in fields(LaneLevels) if f.name != "complete"]
        arrays = {name: getattr(levels, name).reshape(1, members - have, -1) for name in names}
        if known is not None:
            arrays = {
                name: np.concatenate([getattr(known.lanes, name), arrays[name]], axis=1)
                for name in names
            }
        curve = PerformanceCurve(
            np.array([self.case.amplitude]), every, LaneLevels(**arrays, complete=True)
        )
        self.curves[step] = curve
        if speeds is not None:
            self.speeds[step] = max(self.speeds.get(step, 0.0), float(np.max(speeds)))
        return curve

    def levels(self, step: float, members: int) -> Array:
        """Return the members' levels at a gap."""
        return self.curve(step, members).combined[0, :members]

    def by_step(self) -> dict[float, PerformanceCurve]:
        """Return the runs with an absorber, by steps in their order."""
        return dict(
            sorted((step, curve) for step, curve in self.curves.items() if step is not None)
        )

    def check(self) -> GapCheck:
        """Return the runs; levels without an absorber that were not finished are NaN."""
        walls = rigid_walls(self.absorber)
        curves = self.by_step()
        gaps = walls.gap * np.exp(STEP * np.array([*curves], dtype=float))
        none = np.full((1, 1, 1), np.nan)
        nothing = PerformanceCurve(
            np.array([self.case.amplitude]),
            draw_members(1, 0),
            LaneLevels(none, none, none, none, none, none, complete=False),
        )
        return GapCheck(
            self.case,
            self.absorber,
            self.case.rule_gap(self.absorber.mass_ratio * self.case.model.beam_mass),
            gaps,
            tuple(curves.values()),
            self.curves.get(None, nothing),
        )


def search_gap(
    case: LoadCase,
    absorber: SlidingAbsorber,
    *,
    tolerance: float = TOLERANCE,
    free: Sequence[str] = (),
    friction_fixed: bool = False,
    factors: Sequence[float] = (),
    members: int = MEMBERS,
    seed: int = 0,
    limits: Limits | None = None,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> Advice:
    """Search the gap of an impact absorber under a load case by simulation.

    The search is described in `optimisation.gap_search`.

    Parameters
    ----------
    case : SweptForce or AppliedLoads
        What acts on which structure.
    absorber : SlidingAbsorber
        Mass, restitution and friction; its gap is replaced. Its friction limit is that at the
        case's `LoadCase.reference_gap`, and in proportion to the gap.
    tolerance : float
        Share by which the force, or the loads, may be larger or smaller.
    free : sequence of str
        Names of `CANDIDATES`, to search as well; for a swept force.
    friction_fixed : bool
        Whether the friction limit is the same at every gap.
    factors : sequence of float
        Further gaps to run, over the reference gap.
    members, seed : int
        Runs of each gap of an answer, and their seed.
    limits : Limits, optional
        Limits that the answers keep, if a gap that ran does; of the impact speed for a swept force.
    threads, progress, executor
        As in `impact_env.curve.performance_curves`, interruption too: what is finished is returned.

    Returns
    -------
    Advice

    Raises
    ------
    ParameterError
        For numbers out of range, for an absorber without rigid walls, and where no gap that was
        simulated leaves less than `USELESS` of the level without absorber under a swept force.

    Examples
    --------
    >>> from impact_env import Beam, modal_model
    >>> from optimisation.absorber_rules import scaled_absorber
    >>> model = modal_model(Beam(modes=2))
    >>> case = swept_force(model, 3.5, rate=40.0)
    >>> found = search_gap(case, scaled_absorber(model, 3.5), members=1)
    >>> bool(found.recommended.level < found.check.without.median[0])
    True
    """
    require(
        0 <= tolerance <= MOST_TOLERANCE,
        "force_tolerance",
        tolerance,
        f"from 0 to {MOST_TOLERANCE:g}, a share of the force",
    )
    limits = Limits() if limits is None else limits
    wanted = [one_of("free", name, tuple(CANDIDATES)) for name in listed("free", free)]
    if not isinstance(case, SweptForce):
        require(not wanted, "free", wanted, "left out under loads: the gap alone is searched")
        speed = limits.impact_speed
        require(speed is None, "limit of impact_speed", speed, "left out under loads")
    members = count("members", members, 1)
    walls = rigid_walls(absorber)
    mass = absorber.mass_ratio * case.model.beam_mass
    base = case.reference_gap(mass)
    pairs = PAIRS if members <= MEMBERS else 10 + 5 * members
    expected = case.runs_a_member * (1 + pairs + (CHECK_MEMBERS if members > 1 else 0))

    def run(lanes: Sequence[Lane], before: int) -> tuple[LaneLevels, Array | None]:
        stopped = False

        def show(done: int, _all: int) -> None:
            nonlocal stopped
            if progress is None:
                return
            try:
                progress(before + done, max(expected, before + len(lanes)))
            except KeyboardInterrupt:
                stopped = True
                raise

        measured = case.run(
            lanes, RunOptions(threads, executor, show), limits.impact_speed is not None
        )
        if stopped:  # all lanes may have been finished or under way
            raise SearchStopped
        return measured

    # the stroke limit is a gap that can be run itself
    reference = base if limits.stroke is None else limits.stroke
    base_step = math.log(base / reference) / STEP
    friction = absorber.friction
    if friction is not None and not friction_fixed:
        friction = replace(friction, limit=friction.limit * reference / base)
    device = replace(absorber, walls=replace(walls, gap=reference), friction=friction)
    runs = GapRuns(case, device, seed, not friction_fixed, run)
    known_reach = case.reach(mass)
    factor = 1.0 if math.isnan(known_reach) else expected_factor(known_reach)
    start = round(math.log(base / reference * factor) / STEP)
    widest = start + WIDEST if limits.stroke is None else min(start + WIDEST, 0)
    start = min(start, widest)
    narrowest = start + NARROWEST
    samples = LevelSamples(power=case.power)
    complete = True
    tried: list[tuple[str, float, float, float]] = []

    def levels(step: float, number: int) -> Array:
        measured = runs.levels(step, number)
        if limits.impact_speed is not None:
            samples.excess[step] = math.log(max(runs.speeds[step], 1e-300) / limits.impact_speed)
        return measured

    try:
        runs.curve(None, case.reference_members(members))
        for name in wanted:
            start = _choose_free(runs, name, start, widest, tried)
        search_gaps(
            levels, start, tolerance, members, pairs, samples, (narrowest, widest), base_step
        )
        for factor in factors:
            step = base_step + math.log(factor) / STEP
            if step <= widest:
                samples.levels[step] = levels(step, members)
    except SearchStopped:
        complete = False
    samples.levels |= {step: curve.combined[0] for step, curve in runs.by_step().items()}
    ran = max((len(levels) for levels in samples.levels.values()), default=0)
    sharp = recommended = None
    if ran:
        best = find_best(samples, tolerance, min(members, ran))
        sharp, recommended = in_order(*(_answer(runs, samples, step, tolerance) for step in best))
    check = runs.check()
    reading = NO_READING
    if complete and sharp is not None and recommended is not None:
        if isinstance(case, AppliedLoads):
            drive = case.lanes(None, draw_members(1, seed))[0].drive
            reading = find_reading(case.model, recommended.absorber, drive)
        else:
            _require_help(sharp, check)
    return Advice(
        check,
        samples,
        reference,
        tolerance,
        members,
        runs.runs,
        sharp,
        recommended,
        complete,
        limits,
        narrowest,
        widest,
        tuple(tried),
        reading,
    )


def expected_factor(free_over_rule: float) -> float:
    """Return the gap over the rule's at which a search starts.

    It is a fit to simulations of other structures. ``free_over_rule``: free amplitude over the
    rule's gap.
    """
    if free_over_rule < LOW_REACH:
        return max(LOW_REACH_START * free_over_rule, 1e-9)
    return 1.57 / (1 + 1.14 / free_over_rule)


def _require_help(sharp: Answer, check: GapCheck) -> None:
    """Raise ParameterError if no gap lowers the level enough.

    This is the case if the best gap leaves more than `USELESS` of the level without absorber.
    """
    share = sharp.level / float(check.without.median[0])
    if share > USELESS:
        free = free_amplitude(check.model, check.mass, check.force, check.resonance)
        raise ParameterError(
            f"no gap helps for {check.force:g} N near resonance {check.resonance}: at best "
            f"{100 * share:.0f} % of the level without absorber, with "
            f"{1e3 * sharp.gap:.4g} mm to either wall; without it its place moves "
            f"{1e3 * free:.4g} mm, {check.reach:.3g} of the rule's gap (choose "
            "another place, a heavier absorber, or a structure with less damping)"
        )


def _answer(runs: GapRuns, samples: LevelSamples, step: float, tolerance: float) -> Answer:
    """Return a device that ran, with where its level was read and its impact speed."""
    (ratio,) = find_reading_ratios(runs.curves[step])
    values = samples.levels[step]
    return Answer(
        runs.device(step),
        float(np.median(values)),
        samples.worst(step, tolerance),
        len(values),
        predict(values, samples.groups_near(step)),
        float(ratio),
        runs.speeds.get(step),
    )


def in_order(sharp: Answer, recommended: Answer) -> tuple[Answer, Answer]:
    """Return the answer with the lower level, then that with the lower worst level.

    Gaps are chosen by means of ln levels, so that medians may contradict the names sharp and
    recommended.
    """
    lower = min(sharp, recommended, key=lambda answer: answer.level)
    steadier = min(recommended, sharp, key=lambda answer: answer.worst)
    return lower, steadier


def _choose_free(
    runs: GapRuns,
    name: str,
    start: int,
    widest: int,
    tried: list[tuple[str, float, float, float]],
) -> int:
    """Choose the value of a free variable with the lowest level of a single run.

    The gap is searched for each value. The runs' absorber is given the chosen value, and the step
    of its gap is returned.
    """
    case = runs.case
    assert isinstance(case, SweptForce)
    usual = runs.absorber
    walls = rigid_walls(usual)
    friction = usual.friction
    values = (
        (walls.restitution, *CANDIDATES[name])
        if name == "restitution"
        else (1.0, *CANDIDATES[name])
    )
    fast_rate = max(case.rate, min(PAPER_RATE, FASTER * case.rate))
    fast = replace(runs, case=replace(case, rate=fast_rate))
    best: tuple[float, int, SlidingAbsorber] | None = None
    for value in values:
        if name == "restitution":
            fast.absorber = replace(usual, walls=replace(walls, restitution=value))
        else:
            fast.absorber = replace(
                usual, friction=None if friction is None else friction_law(value * friction.limit)
            )
        # only runs without absorber (step None) are the same for another value
        fast.curves = {n: curve for n, curve in fast.curves.items() if n is None}
        fast.speeds = {n: speed for n, speed in fast.speeds.items() if n is None}
        try:
            logs = bracket(
                lambda n: math.log(float(fast.levels(n, 1)[0])),
                start,
                (start + NARROWEST, widest),
                wide_runs=False,
            )
        finally:
            runs.runs = fast.runs
        step = min(logs, key=lambda n: logs[n])
        level = math.exp(logs[step])
        device = fast.device(step)
        number = value
        if name == "friction_limit":
            number = 0.0 if device.friction is None else device.friction.limit
        tried.append((name, number, level, rigid_walls(device).gap))
        if best is None or level < best[0]:
            best = (level, step, fast.absorber)
        start = step
    assert best is not None
    runs.absorber = best[2]
    return best[1]


FACTORS = "an odd number, 3 or more (the rule's gap is the middle one)"
MOST_GAPS = 1001  # a curve is simulated for each


def gap_factors(number: int) -> Array:
    """Return an odd number of factors of the rule's gap, geometric, 1 in the middle."""
    number = count("gaps", number, 3, MOST_GAPS, FACTORS)
    require(number % 2 == 1, "gaps", number, FACTORS)
    half = np.geomspace(1, SPAN, number // 2 + 1)
    return np.concatenate([1 / half[:0:-1], half])


def check_gap(
    model: ModalModel,
    force: float,
    resonance: int = 1,
    absorber: SlidingAbsorber | None = None,
    *,
    factors: Sequence[float] | Array | None = None,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    percent_per_100_periods: float | None = None,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> GapCheck:
    """Simulate sweeps up and down at one force (N) for gaps around the rule's.

    ``absorber`` gives mass, restitution and friction (default: `scaled_absorber`); its gap is
    replaced. ``factors`` of the rule's gap must contain 1. ``percent_per_100_periods``: None is
    `default_rate`. Interruption and the other arguments as in `performance_curves`. Raises
    ParameterError for numbers out of range, and for an absorber without rigid walls.
    """
    force = usable_force("force", force)
    absorber = scaled_absorber(model, force, resonance) if absorber is None else absorber
    walls = rigid_walls(absorber)
    case = swept_force(model, force, resonance, absorber.mass_ratio, percent_per_100_periods)
    rule = case.rule_gap(absorber.mass_ratio * model.beam_mass)
    multiples = np.sort(
        np.asarray(gap_factors(11) if factors is None else factors, dtype=np.float64)
    )
    require(
        bool(np.all(multiples > 0)) and 1.0 in multiples,
        "factors",
        factors,
        "numbers above 0, one of them 1",
    )
    devices = [replace(absorber, walls=replace(walls, gap=float(rule * k))) for k in multiples]
    without, *curves = performance_curves(
        [case.curve_case(device) for device in [None, *devices]],
        members,
        seed,
        threads=threads,
        progress=progress,
        executor=executor,
    )
    return GapCheck(case, absorber, rule, rule * multiples, tuple(curves), without)
