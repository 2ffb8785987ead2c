"""Place, mass and gap of an impact absorber for forces near one or several resonances.

1. `optimisation.place_map` ranks all places for each mass by the linear structure, without a run.
2. The best few of each mass run at three gaps with one member.
3. For the best of these, and the second if it is close, the gap is searched as by `design gap`
   (`optimisation.gap_search`), for all resonances together: the search minimises the largest level
   over that without absorber. Member m of every resonance is one member.

All sweeps go over one range for each resonance, that of the heaviest mass at the places that run,
and start from the steady state.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import count, fraction, listed, non_negative, positive, require
from impact_env.curve import CurveCase, PerformanceCurve, performance_curves
from impact_env.drive import default_rate
from impact_env.ensemble import Executor, Lane, LaneLevels, LaneProgress
from impact_env.modes import ModalModel, Structure
from impact_env.parameters import Absorber, SlidingAbsorber, friction_law, impact_absorber
from impact_env.scene import Scene
from optimisation.absorber_rules import RESTITUTION, rigid_walls, scaled_friction
from optimisation.bounds import design_gap, gap_unit, reach, resonance_limit
from optimisation.contact import YieldLimit
from optimisation.gap_advice import (
    MEMBERS,
    MOST_TOLERANCE,
    TOLERANCE,
    USELESS,
    GapRuns,
    Limits,
    RunLanes,
    SearchStopped,
)
from optimisation.gap_search import (
    CHECK_PAIRS,
    NARROWEST,
    PAIRS,
    STEP,
    WIDEST,
    LevelSamples,
    find_best,
    level_between,
    search_gaps,
)
from optimisation.load_cases import RunOptions, SweptForce, run_swept
from optimisation.measures import Prediction, format_number, predict
from optimisation.place_map import (
    PlaceMap,
    Places,
    expected_gap_and_share,
    find_places,
    map_places,
    shortlist,
)
from optimisation.sweep_range import (
    find_common_range,
    find_reading_ratios,
    usable_gap,
    usable_mass_ratio,
    usable_rate,
)
from optimisation.tolerances import SURE as SURE

Array = NDArray[np.float64]
MASS_RATIOS = (0.01, 0.02, 0.05)
TRIAL_PLACES = 5  # places of each mass that run
TRIAL_FACTORS = (0.8, 1.15, 1.6)  # of the gap to expect
SEARCHED = 2  # places of each mass whose gap is searched, at most
CLOSE_TRIAL = 1.25  # times the lowest level of a trial: a place whose gap is searched too
LIGHTEST = 1.1  # times the lowest level: the lightest mass that leaves no more is recommended
FLAT = 1.1  # times the level at the recommended gap: the range of gaps that leave no more


@dataclass(frozen=True, eq=False)
class ResonanceLevel:
    """A device's level near one resonance.

    Attributes
    ----------
    resonance : int
        Number of the resonance, from 1.
    force : float
        Amplitude in N.
    level, worst, without : float
        Median level at the force, largest level over the tolerance of the force, and level without
        absorber, in m.
    prediction : Prediction or None
        Prediction of a further run's level; None if no gap ran twice.
    frequency_ratio : float
        Frequency at the level's maximum over the resonance.
    sweep_range : (float, float)
        Range of the sweep over the resonance.
    rate : float
        Sweep rate in % per 100 pseudo periods.
    limit : float
        Passive limit in m for this cavity.
    """

    resonance: int
    force: float
    level: float
    worst: float
    without: float
    prediction: Prediction | None
    frequency_ratio: float
    sweep_range: tuple[float, float]
    rate: float
    limit: float

    @property
    def share(self) -> float:
        """Level over that without absorber."""
        return self.level / self.without

    @property
    def interval(self) -> tuple[float, float]:
        """Ends in m of the interval that holds 90 % of further runs; NaN where no gap ran twice."""
        return (math.nan, math.nan) if self.prediction is None else self.prediction.interval()


@dataclass(frozen=True, eq=False)
class PlacedDevice:
    """A device at a place that was simulated near all resonances.

    Attributes
    ----------
    place, name : int and str
        Index and name of the place in `Places`.
    mass_ratio : float
        Mass of the absorber over that of the structure.
    absorber : SlidingAbsorber
        The device.
    share, worst : float
        Median over the members of the largest level over that without absorber, and its largest
        value over the tolerance of the force.
    prediction : Prediction or None
        Prediction of a further run's share.
    parts : tuple of ResonanceLevel
        Levels near each resonance.
    members : int
        Number of runs, each up and down.
    gaps : (float, float)
        Narrowest and widest gap in m around this one with at most `FLAT` times its share.
    sweeps : int
        Number of all sweeps.
    runs : dict of int to PerformanceCurve
        Runs by resonance.
    impact_speed : float or None
        Largest impact speed in m/s, None if not recorded.
    """

    place: int
    name: str
    mass_ratio: float
    absorber: SlidingAbsorber
    share: float
    worst: float
    prediction: Prediction | None
    parts: tuple[ResonanceLevel, ...]
    members: int
    gaps: tuple[float, float]
    sweeps: int
    runs: dict[int, PerformanceCurve]
    impact_speed: float | None = None

    @property
    def gap(self) -> float:
        """Clearance to either wall in m."""
        return rigid_walls(self.absorber).gap

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the interval that holds 90 % of further runs' shares.

        They are NaN if no gap was run twice.
        """
        return (math.nan, math.nan) if self.prediction is None else self.prediction.interval()

    @property
    def friction_limit(self) -> float:
        """Friction limit in N, 0 for none."""
        return 0.0 if self.absorber.friction is None else self.absorber.friction.limit

    def probability_below(self, limit: float) -> float:
        """Return the probability that the level stays below a limit in m near all resonances.

        It is NaN if no gap was run twice.
        """
        known = [part.prediction for part in self.parts if part.prediction is not None]
        if len(known) < len(self.parts):
            return math.nan
        return float(np.prod([one.probability_below(limit) for one in known]))


@dataclass(frozen=True)
class TrialRun:
    """A single run of an absorber at a place, at the best of three gaps.

    It has the index of the place, the mass ratio, the gap in m, and ``share``, the largest level
    over that without absorber.
    """

    place: int
    mass_ratio: float
    gap: float
    share: float


@dataclass(frozen=True, eq=False)
class PlaceAdvice:
    """Which place, mass and gap, and what that rests on.

    Attributes
    ----------
    places : Places
        All places.
    forces : dict
        Force in N by resonance, counted from 1.
    maps : tuple of PlaceMap
        What the linear structure says of all places, for each mass, rising.
    trials : tuple of TrialRun
        Single runs of the most promising places.
    devices : tuple of PlacedDevice
        Devices whose gap was searched, by rising mass, the lower ``worst`` first.
    recommended : PlacedDevice or None
        The lightest of them that keeps ``limit_level`` with a probability of `SURE`, or without a
        limit the lightest that leaves no more than `LIGHTEST` times the lowest ``worst``. None
        where nothing was finished.
    without : dict
        Level in m without absorber by resonance.
    tolerance : float
        Share by which the forces may be larger or smaller.
    limit_level : float or None
        Level in m.
    study : PlaceStudy
        How levels were read.
    sweeps : int
        All runs, one member and one direction near one resonance each.
    complete : bool
        Whether all runs were made.

    """

    places: Places
    forces: dict[int, float]
    maps: tuple[PlaceMap, ...]
    trials: tuple[TrialRun, ...]
    devices: tuple[PlacedDevice, ...]
    recommended: PlacedDevice | None
    without: dict[int, float]
    tolerance: float
    members: int
    limits: Limits
    limit_level: float | None
    study: "PlaceStudy"
    sweeps: int
    complete: bool

    @property
    def keeps_limit(self) -> bool:
        """Whether the recommended device satisfies the limit of the level."""
        best = self.recommended
        return (
            self.limit_level is None
            or best is None
            or best.probability_below(self.limit_level) >= SURE
        )

    @cached_property
    def best_by_mass(self) -> tuple[PlacedDevice, ...]:
        """The device with the lowest ``worst`` of each mass that was finished, by rising mass."""
        best: dict[float, PlacedDevice] = {}
        for device in self.devices:
            best.setdefault(device.mass_ratio, device)
        return tuple(best.values())

    @property
    def rivals(self) -> tuple[PlacedDevice, ...]:
        """Devices of the recommended mass at other places."""
        best = self.recommended
        if best is None:
            return ()
        return tuple(
            one
            for one in self.devices
            if one.mass_ratio == best.mass_ratio and one.place != best.place
        )

    def keeps_speed(self, device: PlacedDevice) -> bool:
        """Return whether a device satisfies the limit of the impact speed at its place."""
        model = self.places.model_at(device.place)
        speed = device.impact_speed
        return speed is None or speed <= self.study.speed_limit(model, device.mass_ratio)

    def map_of(self, device: PlacedDevice) -> PlaceMap:
        """Return the map of a device's mass."""
        return next(one for one in self.maps if one.mass_ratio == device.mass_ratio)

    def case_of(self, device: PlacedDevice, resonance: int) -> CurveCase:
        """Return the sweeps of a device near a resonance."""
        return self.study.case(self.places.model_at(device.place), device.absorber, resonance)


def probability_lower(first: Prediction, second: Prediction) -> float:
    """Return the probability that a further run of the first design has the lower value.

    It is compared with a further run of the second design.

    Both logarithms follow Student's distribution; the integral is over the quantiles of the first.
    """
    if first.scale == 0 and second.scale == 0:
        return float(first.centre < second.centre)
    quantiles = (np.arange(400) + 0.5) / 400
    values = first.centre + first.scale * scipy.stats.t.ppf(quantiles, first.freedoms)
    if second.scale == 0:
        return float(np.mean(values < second.centre))
    above = scipy.stats.t.sf((values - second.centre) / second.scale, second.freedoms)
    return float(np.mean(above))


@dataclass(frozen=True)
class PlaceStudy:
    """Requirements and settings that are the same for all devices of a search.

    ``forces`` (N), ``ranges``, ``rates`` and levels ``without`` absorber (m) are given by
    resonance. ``friction_limit`` is in N; None: the paper's by the scaling law, proportional to the
    gap. ``yield_limit`` gives a limit of the impact speed for each place and mass. The others are
    settings of the gap search.
    """

    forces: dict[int, float]
    ranges: dict[int, tuple[float, float]]
    rates: dict[int, float]
    without: dict[int, float]
    restitution: float
    friction_limit: float | None
    tolerance: float
    members: int
    seed: int
    limits: Limits
    yield_limit: YieldLimit | None = None

    @property
    def limits_speed(self) -> bool:
        """Whether the impact speed has a limit."""
        return self.limits.impact_speed is not None or self.yield_limit is not None

    def speed_limit(self, model: ModalModel, mass_ratio: float) -> float:
        """Return the largest allowed impact speed in m/s at a model's place.

        It is infinite without a limit.
        """
        most = math.inf if self.limits.impact_speed is None else self.limits.impact_speed
        if self.yield_limit is None:
            return most
        return min(most, self.yield_limit.speed(model, mass_ratio * model.beam_mass))

    def case(self, model: ModalModel, absorber: Absorber | None, resonance: int) -> CurveCase:
        """Return the sweeps with an absorber near a resonance."""
        return self.load_case(model, resonance).curve_case(absorber)

    def load_case(self, model: ModalModel, resonance: int) -> SweptForce:
        """Return the force that is swept near a resonance, on a model."""
        force = self.forces[resonance]
        return SweptForce(model, force, resonance, self.ranges[resonance], self.rates[resonance])

    def absorber(self, model: ModalModel, mass_ratio: float, gap: float) -> SlidingAbsorber:
        """Return the absorber with a gap in m."""
        limit = self.friction_limit
        if limit is None:
            limit = gap * self._friction_over_gap(model, mass_ratio)
        return impact_absorber(gap, self.restitution, limit, mass_ratio)

    def _friction_over_gap(self, model: ModalModel, mass_ratio: float) -> float:
        """Return the friction limit over the gap in N/m.

        It is that of `optimisation.absorber_rules.scaled_absorber` at the resonance with the widest
        gap by the design rule.
        """
        mass = mass_ratio * model.beam_mass
        rules = {r: design_gap(model, mass, force, r) for r, force in self.forces.items()}
        widest = max(rules, key=lambda r: rules[r])
        unit = gap_unit(model, mass, self.forces[widest], widest)
        return scaled_friction(model, mass, unit) / rules[widest]


def expected_gap(model: ModalModel, mass_ratio: float, forces: Mapping[int, float]) -> float:
    """Return the gap in m from which the search for all resonances together starts."""
    mass = mass_ratio * model.beam_mass
    rules = np.array([[design_gap(model, mass, force, r)] for r, force in forces.items()])
    reaches = np.array([[reach(model, mass, r)] for r in forces])
    gap, _ = expected_gap_and_share(rules, reaches)
    return float(gap[0])


@dataclass(eq=False)
class JointRuns:
    """Runs of one place and mass at several gaps, near all resonances.

    ``parts``: runs by resonance, with a common reference gap.
    """

    study: PlaceStudy
    parts: dict[int, GapRuns]
    samples: LevelSamples = field(default_factory=LevelSamples)

    @property
    def sweeps(self) -> int:
        """Number of runs."""
        return sum(part.runs for part in self.parts.values())

    def shares(self, step: float, number: int) -> Array:
        """Return the members' largest levels over those without absorber at a gap, (M,)."""
        study = self.study
        relative = [part.levels(step, number) / study.without[r] for r, part in self.parts.items()]
        if study.limits_speed:
            speed = max(part.speeds[step] for part in self.parts.values())
            first = next(iter(self.parts.values()))
            most = study.speed_limit(first.case.model, first.absorber.mass_ratio)
            self.samples.excess[step] = math.log(max(speed, 1e-300) / most)
        return np.asarray(np.max(relative, axis=0))


def search_place(
    study: PlaceStudy,
    model: ModalModel,
    mass_ratio: float,
    run: RunLanes,
    pairs: int = PAIRS,
) -> tuple[JointRuns, float]:
    """Search the gap of an absorber at a model's place near all resonances.

    Return the runs and the step of the gap that is best over the tolerance of the force.

    Raises `SearchStopped` if it is stopped.
    """
    mass = mass_ratio * model.beam_mass
    rule = max(design_gap(model, mass, force, r) for r, force in study.forces.items())
    stroke = study.limits.stroke
    reference = rule if stroke is None else stroke
    absorber = study.absorber(model, mass_ratio, reference)
    joint = JointRuns(
        study,
        {
            r: GapRuns(
                study.load_case(model, r), absorber, study.seed, study.friction_limit is None, run
            )
            for r in study.forces
        },
    )
    start = round(math.log(expected_gap(model, mass_ratio, study.forces) / reference) / STEP)
    widest = start + WIDEST if stroke is None else min(start + WIDEST, 0)
    start = min(start, widest)
    ends = (start + NARROWEST, widest)
    rule_step = math.log(rule / reference) / STEP
    search_gaps(
        joint.shares, start, study.tolerance, study.members, pairs, joint.samples, ends, rule_step
    )
    _, robust = find_best(joint.samples, study.tolerance, study.members)
    return joint, robust


def describe_device(
    study: PlaceStudy, places: Places, place: int, joint: JointRuns, step: float
) -> PlacedDevice:
    """Return the device at a gap that ran, with its levels and their certainty."""
    samples = joint.samples
    shares = samples.levels[step]
    parts = []
    for resonance, runs in joint.parts.items():
        case = runs.case
        assert isinstance(case, SweptForce)
        own = LevelSamples(
            {n: curve.combined[0] for n, curve in runs.by_step().items()}, samples.power
        )
        values = own.levels[step]
        (ratio,) = find_reading_ratios(runs.curves[step])
        level = float(np.median(values))
        device = runs.device(step)
        limit = resonance_limit(
            case.model,
            device.mass_ratio * case.model.beam_mass,
            rigid_walls(device).gap,
            case.force,
            resonance,
            *case.limits,
            at=case.model.level_shape,
        )
        parts.append(
            ResonanceLevel(
                resonance,
                case.force,
                level,
                float(np.fmax(level, own.worst(step, study.tolerance))),
                study.without[resonance],
                predict(values, own.groups_near(step)),
                float(ratio),
                case.limits,
                case.rate,
                float(limit),
            )
        )
    share = float(np.median(shares))
    first = next(iter(joint.parts.values()))
    speeds = [part.speeds.get(step) for part in joint.parts.values()]
    known = [speed for speed in speeds if speed is not None]
    return PlacedDevice(
        place,
        places.names[place],
        first.absorber.mass_ratio,
        first.device(step),
        share,
        float(np.fmax(share, samples.worst(step, study.tolerance))),
        predict(shares, samples.groups_near(step)),
        tuple(parts),
        len(shares),
        _flat_range(samples, step, share, rigid_walls(first.absorber).gap),
        joint.sweeps,
        {r: part.curves[step] for r, part in joint.parts.items()},
        max(known) if known else None,
    )


def _flat_range(
    samples: LevelSamples, step: float, share: float, reference: float
) -> tuple[float, float]:
    """Return the narrowest and widest gap in m around a step with nearly the lowest level.

    Between them the level is at most `FLAT` times ``share``.
    """
    steps, levels = samples.known()
    fine = np.arange(steps[0], steps[-1] + 0.01, 0.1)
    good = level_between(STEP * steps, levels, STEP * fine, samples.power) <= FLAT * share * (
        1 + 1e-9
    )
    at = int(np.argmin(np.abs(fine - step)))
    good[at] = True
    bad = np.flatnonzero(~good)
    first = int(np.max(bad[bad < at], initial=-1)) + 1
    last = int(np.min(bad[bad > at], initial=len(fine))) - 1
    low, high = (reference * math.exp(STEP * float(fine[k])) for k in (first, last))
    return low, high


def advise_place(
    structure: Structure | Places,
    forces: Mapping[int, float],
    *,
    mass_ratios: Sequence[float] = MASS_RATIOS,
    restitution: float = RESTITUTION,
    friction_limit: float | None = None,
    limits: Limits | None = None,
    yield_limit: YieldLimit | None = None,
    limit_level: float | None = None,
    tolerance: float = TOLERANCE,
    members: int = MEMBERS,
    trial_places: int = TRIAL_PLACES,
    seed: int = 0,
    percent_per_100_periods: float | None = None,
    announce: Callable[["SweepPlan"], None] | None = None,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> PlaceAdvice:
    """Return place, mass and gap of an impact absorber, with their certainty.

    They are for forces near one or several resonances.

    Parameters
    ----------
    structure : Beam, ModalModel or Places
        The structure, or the places of it that are allowed (`optimisation.place_map.find_places`).
    forces : dict
        Force in N by resonance, counted from 1.
    mass_ratios : sequence of float
        Masses to try, over the structure's.
    restitution, friction_limit : float
        Of the absorber; the limit in N at any gap. None: the paper's 0.1 N by the scaling law, in
        proportion to the gap.
    limits : Limits, optional
        Limits that the devices keep, if a gap that ran does.
    yield_limit : YieldLimit, optional
        Impacts that the devices keep below the beginning of yield, if a gap that ran does.
    limit_level : float, optional
        Level in m below which the recommended device stays with a probability of `SURE`, near every
        resonance.
    tolerance : float
        Share by which the forces may be larger or smaller.
    members : int
        Runs for each gap of an answer, each up and down.
    trial_places : int
        Places of each mass that run.
    percent_per_100_periods : float, optional
        Rate of the sweeps. None: `impact_env.drive.default_rate` near each resonance.
    announce : callable, optional
        Called with the `SweepPlan` before the runs.
    seed, threads, progress, executor
        As in `impact_env.curve.performance_curves`.

    Returns
    -------
    PlaceAdvice

    Raises
    ------
    ParameterError
        For numbers out of range, and where no place leaves less than `USELESS` of the level without
        absorber.

    Examples
    --------
    >>> from impact_env import Beam
    >>> advice = advise_place(
    ...     Beam(modes=2), {1: 3.5}, mass_ratios=[0.02], trial_places=1, members=1,
    ...     percent_per_100_periods=40.0,
    ... )
    >>> advice.recommended.name
    '1'
    """
    places = structure if isinstance(structure, Places) else find_places(structure)
    ratios = tuple(
        sorted({usable_mass_ratio("mass_ratio", x) for x in listed("mass_ratios", mass_ratios)})
    )
    require(len(ratios) > 0, "mass_ratios", mass_ratios, "one or more")
    require(
        0 <= tolerance <= MOST_TOLERANCE,
        "force_tolerance",
        tolerance,
        f"from 0 to {MOST_TOLERANCE:g}, a share of the force",
    )
    restitution = fraction("restitution", restitution)
    if friction_limit is not None:
        friction_law(non_negative("friction_limit", friction_limit))
    members = count("members", members, 1)
    trial_places = count("trial_places", trial_places, 1)
    if limit_level is not None:
        limit_level = positive("limit_level", limit_level)
    limits = Limits() if limits is None else limits
    maps = tuple(map_places(places, forces, ratio) for ratio in ratios)
    forces = maps[0].forces
    chosen = {one.mass_ratio: shortlist(places, one, trial_places) for one in maps}
    for one in maps:
        for r, rules in zip(forces, one.rule, strict=True):
            known = rules[np.isfinite(rules) & (rules > 0)]
            if known.size:
                name = f"{forces[r]:g} N near resonance {r}, mass ratio {one.mass_ratio:g}"
                usable_gap("force", name, "the design rule", float(np.min(known)))
    _require_place(places, maps, chosen)

    models = {k: places.model_at(k) for k in sorted({k for ks in chosen.values() for k in ks})}
    ranges = {r: find_common_range(list(models.values()), ratios[-1], r) for r in forces}
    rates = {
        r: usable_rate(
            "rate",
            default_rate(places.model, (r,))
            if percent_per_100_periods is None
            else percent_per_100_periods,
            [ranges[r]],
        )
        for r in forces
    }
    study = PlaceStudy(
        forces,
        ranges,
        rates,
        {},
        restitution,
        friction_limit,
        tolerance,
        members,
        seed,
        limits,
        yield_limit,
    )
    search = _PlaceSearch(study, places, models, maps, chosen, threads, progress, executor)
    if announce is not None:
        announce(search.plan())
    return search.run(limit_level)


def _words(forces: Mapping[int, float]) -> str:
    return " and ".join(
        f"{format_number(force)} N near resonance {r}" for r, force in forces.items()
    )


def _require_place(
    places: Places, maps: Sequence[PlaceMap], chosen: Mapping[float, Sequence[int]]
) -> None:
    """Raise ParameterError where no place can be used at all."""
    if any(chosen[one.mass_ratio] for one in maps):
        return
    heaviest = maps[-1]
    words = f"{_words(heaviest.forces)}, mass ratio {heaviest.mass_ratio:g}"
    known = np.where(np.isfinite(heaviest.reach), heaviest.reach, np.nan)
    if np.isnan(known).all():
        reason = (
            "a lighter absorber: stuck at any place it takes a resonance out of its range; are "
            "the mass in kg, the shapes in 1/sqrt(kg)?"
        )
    else:
        largest = ", ".join(
            f"{np.nanmax(row, initial=0.0):.2g} near resonance {r}"
            for r, row in zip(heaviest.forces, known, strict=True)
        )
        reason = (
            "forces and places that suit one gap; the largest free amplitude over the rule's gap "
            f"is {largest}"
        )
    require(False, "places", words, f"{reason} ({len(places)} places)")


@dataclass(frozen=True)
class SweepPlan:
    """Upper bound of the sweeps of a search, and its longest scenes, by resonance.

    ``scenes``: scene, force in N and pseudo periods of a sweep.
    """

    sweeps: dict[int, int]
    scenes: dict[int, tuple[Scene, float, float]]

    @property
    def total(self) -> int:
        """All sweeps."""
        return sum(self.sweeps.values())


@dataclass(eq=False)
class _PlaceSearch:
    """The runs of `advise_place`."""

    study: PlaceStudy
    places: Places
    models: dict[int, ModalModel]
    maps: tuple[PlaceMap, ...]
    chosen: dict[float, list[int]]
    threads: int | None
    progress: LaneProgress | None
    executor: Executor | None
    done: int = 0
    total: int = 0

    def __post_init__(self) -> None:
        self.total = self.plan().total

    @property
    def pairs(self) -> int:
        """Pairs of sweeps near each resonance that a search of a gap takes at most."""
        return PAIRS if self.study.members <= MEMBERS else 10 + 5 * self.study.members

    def plan(self) -> SweepPlan:
        """Return the largest numbers of runs."""
        trials = sum(len(ks) for ks in self.chosen.values()) * len(TRIAL_FACTORS)
        searches = sum(min(SEARCHED, len(ks)) for ks in self.chosen.values())
        each = 2 * (1 + trials + (self.pairs + CHECK_PAIRS + 1) * searches)
        heaviest = self.maps[-1]
        place = self.chosen[heaviest.mass_ratio][0] if self.chosen[heaviest.mass_ratio] else None
        scenes = {}
        for r, force in self.study.forces.items():
            low, high = self.study.ranges[r]
            absorber = None
            model = self.places.model
            if place is not None:
                model = self.models[place]
                absorber = self.study.absorber(
                    model, heaviest.mass_ratio, float(heaviest.gap[place])
                )
            scenes[r] = (Scene(model, absorber), force, 1e4 * (high - low) / self.study.rates[r])
        return SweepPlan(dict.fromkeys(self.study.forces, each), scenes)

    def _show(self, done: int, _all: int = 0) -> None:
        if self.progress is not None:
            self.progress(done, max(done, self.total))

    def _run_lanes(self, lanes: Sequence[Lane], _before: int) -> tuple[LaneLevels, Array | None]:
        options = RunOptions(
            self.threads, self.executor, lambda done, _all: self._show(self.done + done)
        )
        pairs = run_swept(lanes, options, self.study.limits_speed)
        self.done += len(lanes)
        return pairs

    def _levels(self, cases: Sequence[CurveCase]) -> list[float]:
        """Return the level in m of a single run of each case.

        Raises `SearchStopped` if the runs are stopped.
        """
        curves = performance_curves(
            cases,
            1,
            self.study.seed,
            threads=self.threads,
            progress=lambda done, _all: self._show(self.done + done),
            executor=self.executor,
        )
        if not all(curve.complete for curve in curves):
            raise SearchStopped
        self.done += 2 * len(cases)
        return [float(curve.median[0]) for curve in curves]

    def run(self, limit_level: float | None) -> PlaceAdvice:
        """Make the runs and return the answer."""
        study = self.study
        trials: list[TrialRun] = []
        devices: list[PlacedDevice] = []
        complete = True
        try:
            none = self._levels([study.case(self.places.model, None, r) for r in study.forces])
            self.study = study = replace(study, without=dict(zip(study.forces, none, strict=True)))
            for one in self.maps:
                trials += self._try(one)
            for one in self.maps:
                own = sorted(
                    (trial for trial in trials if trial.mass_ratio == one.mass_ratio),
                    key=lambda trial: trial.share,
                )
                close = [trial for trial in own if trial.share <= CLOSE_TRIAL * own[0].share]
                for trial in close[:SEARCHED]:
                    joint, step = search_place(
                        study,
                        self.models[trial.place],
                        one.mass_ratio,
                        self._run_lanes,
                        self.pairs,
                    )
                    devices.append(describe_device(study, self.places, trial.place, joint, step))
        except SearchStopped:
            complete = False
        devices.sort(key=lambda device: (device.mass_ratio, device.worst))
        best = recommend(devices, limit_level)
        if complete and best is not None:
            _require_help(best, study.forces)
        return PlaceAdvice(
            self.places,
            study.forces,
            self.maps,
            tuple(trials),
            tuple(devices),
            best,
            study.without,
            study.tolerance,
            study.members,
            study.limits,
            limit_level,
            study,
            self.done,
            complete,
        )

    def _try(self, one: PlaceMap) -> list[TrialRun]:
        """Return single runs of the most promising places of a mass."""
        study = self.study
        devices = []
        for place in self.chosen[one.mass_ratio]:
            gaps = [factor * float(one.gap[place]) for factor in TRIAL_FACTORS]
            if study.limits.stroke is not None:
                gaps = sorted({min(gap, study.limits.stroke) for gap in gaps})
            devices += [(place, gap) for gap in gaps]
        cases = [
            study.case(
                self.models[place],
                study.absorber(self.models[place], one.mass_ratio, gap),
                r,
            )
            for place, gap in devices
            for r in study.forces
        ]
        if not cases:
            return []
        levels = np.array(self._levels(cases)).reshape(len(devices), len(study.forces))
        shares = (levels / np.array([study.without[r] for r in study.forces])).max(axis=1)
        best: dict[int, TrialRun] = {}
        for (place, gap), share in zip(devices, shares.tolist(), strict=True):
            if place not in best or share < best[place].share:
                best[place] = TrialRun(place, one.mass_ratio, gap, share)
        return list(best.values())


def recommend(devices: Sequence[PlacedDevice], limit_level: float | None) -> PlacedDevice | None:
    """Return the lightest device that satisfies the limit of the level.

    It does so with a probability of `SURE`. If there is none, the device with the highest
    probability is returned. Without a limit the result is the lightest device with at most
    `LIGHTEST` times the lowest level over the tolerance. None if there are no devices.
    """
    if not devices:
        return None
    by_mass = sorted(devices, key=lambda device: (device.mass_ratio, device.worst))
    if limit_level is None:
        lowest = min(device.worst for device in devices)
        return next(device for device in by_mass if device.worst <= LIGHTEST * lowest)
    chances = [device.probability_below(limit_level) for device in by_mass]
    sure = [one for one, chance in zip(by_mass, chances, strict=True) if chance >= SURE]
    if sure:
        lightest = [one for one in sure if one.mass_ratio == sure[0].mass_ratio]
        return min(lightest, key=lambda device: device.worst)
    if np.isnan(chances).all():
        return min(devices, key=lambda device: device.worst)
    return by_mass[int(np.nanargmax(chances))]


def _require_help(best: PlacedDevice, forces: Mapping[int, float]) -> None:
    require(
        best.share <= USELESS,
        "places",
        _words(forces),
        "forces that an absorber at one of the places lowers: the best leaves "
        f"{100 * best.share:.0f} % of the level without absorber "
        f"(place {best.name}, mass ratio {best.mass_ratio:g}, gap {1e3 * best.gap:.4g} mm)",
    )
