"""Load cases: a force that is swept near a resonance, or other loads.

A `LoadCase` gives the runs of an absorber and their measure. The search for a gap and the
comparison of absorbers use this interface, so the same code serves both kinds of load.

An ensemble member of a swept force has two runs, a sweep up and one down with the member's phase
and factor; the larger response level counts. A member of other loads has one run under its own
record. The results of a design are a `PerformanceCurve` in both cases. For other loads its level is
the loads' measure (`optimisation.measures`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import positive, require
from impact_env.curve import CurveCase, PerformanceCurve
from impact_env.drive import Drive, Excitation, Member, default_rate
from impact_env.ensemble import (
    Executor,
    Lane,
    LaneLevels,
    LaneProgress,
    Members,
    draw_members,
    drives_of,
    each_lane,
    run_lanes,
)
from impact_env.loads import Loads
from impact_env.methods import Exact
from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, Absorber, SlidingAbsorber, impact_absorber
from impact_env.results import Record, require_recorded
from impact_env.scene import Scene
from impact_env.solvers import check_load
from impact_env.sweep import simulate
from optimisation.absorber_rules import scaled_friction
from optimisation.bounds import design_gap, reach
from optimisation.measures import (
    DECAY,
    LEVEL,
    START,
    free_size,
    measure_lane,
    measure_of,
    record_of,
)
from optimisation.signals import band_levels, edges_of
from optimisation.sweep_range import find_sweep_range, is_at_end, usable_force, usable_rate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RunOptions:
    """Executor and progress of runs.

    Runs are computed by ``threads`` of this process (None: all cores), or by an ``executor``.
    ``progress`` is called with the numbers of finished and of all runs.
    """

    threads: int | None = None
    executor: Executor | None = None
    progress: LaneProgress | None = None


@dataclass(frozen=True)
class Reading:
    """Frequency at which the largest displacement of a sweep occurs.

    ``hertz``: frequency in Hz, NaN if the loads' measure is not a response level. ``at_end``:
    whether it lies at an end of the sweep, so that the level may be larger beyond.
    """

    hertz: float = math.nan
    at_end: bool = False


NO_READING = Reading()


class LoadCase(Protocol):
    """Structure and load for the comparison of absorbers: `SweptForce` or `AppliedLoads`."""

    @property
    def model(self) -> ModalModel:
        """Structure without absorber."""

    @property
    def measure(self) -> str:
        """Name of a run's measure."""

    @property
    def power(self) -> float:
        """Exponent p of the scaling law: the measure grows with alpha^p."""

    @property
    def runs_a_member(self) -> int:
        """Number of runs of an ensemble member: 2 (sweeps up and down) or 1."""

    @property
    def amplitude(self) -> float:
        """Force in N, or 1 for loads as they are."""

    def reference_gap(self, mass: float) -> float:
        """Return the gap in m around which a search for the best gap takes place.

        It is the design rule's gap for the absorber's ``mass`` in kg. Without a rule it is
        proportional to the motion without absorber.
        """
        ...

    def rule_gap(self, mass: float) -> float:
        """Return the design rule's gap in m for an absorber's mass in kg; NaN without a rule."""
        ...

    def reach(self, mass: float) -> float:
        """Return the amplitude without absorber over the rule's gap, for a mass in kg.

        It is NaN without a rule.
        """
        ...

    def reference_members(self, members: int) -> int:
        """Return the number of ensemble members to run without absorber, of ``members``."""
        ...

    def lanes(self, absorber: Absorber | None, members: Members, first: int = 0) -> list[Lane]:
        """Return the runs of the members from number ``first`` on, one member after the other."""
        ...

    def run(
        self, lanes: Sequence[Lane], options: RunOptions, speeds: bool = False
    ) -> tuple[LaneLevels, Array | None]:
        """Run L lanes and return (levels, None), or (levels, speeds) if ``speeds`` is True.

        ``speeds`` is the largest impact speed of each lane in m/s, (L,); only sweeps have it. Lanes
        that were not run have NaN.
        """
        ...


@dataclass(frozen=True, eq=False)
class SweptForce:
    """A harmonic ``force`` in N, swept up and down near a resonance.

    ``limits`` are the ends of the sweeps, relative to the resonance's frequency. ``rate`` is in %
    of this frequency per 100 pseudo periods.
    """

    model: ModalModel
    force: float
    resonance: int
    limits: tuple[float, float]
    rate: float
    measure = LEVEL
    power = 1.0
    runs_a_member = 2

    @property
    def amplitude(self) -> float:
        """The force in N."""
        return self.force

    def rule_gap(self, mass: float) -> float:
        """Return the design rule's gap in m for an absorber's mass in kg."""
        return design_gap(self.model, mass, self.force, self.resonance)

    def reference_gap(self, mass: float) -> float:
        """Return the design rule's gap in m."""
        return self.rule_gap(mass)

    def reach(self, mass: float) -> float:
        """Return the amplitude without absorber over the rule's gap, for a mass in kg."""
        return reach(self.model, mass, self.resonance)

    def reference_members(self, _members: int) -> int:
        """Return 1: a single member is run without absorber.

        Without absorber the members' levels differ by at most a millionth, as their forces do.
        """
        return 1

    def curve_case(self, absorber: Absorber | None, model: ModalModel | None = None) -> CurveCase:
        """Return the case of the sweeps with an absorber or none, on ``model`` if it is given."""
        return CurveCase(
            Scene(self.model if model is None else model, absorber),
            np.array([self.force]),
            self.resonance,
            self.limits,
            self.rate,
            steady_start=True,
        )

    def lanes(self, absorber: Absorber | None, members: Members, first: int = 0) -> list[Lane]:
        """Return the runs of members from number ``first`` on: up and down, for each in turn."""
        case = self.curve_case(absorber)
        up, down = case.schedules()
        return [
            Lane(case.scene, drive, steady_start=True)
            for m in range(first, len(members))
            for schedule in (up, down)
            for drive in members[m : m + 1].drives(self.force, schedule)
        ]

    def run(
        self, lanes: Sequence[Lane], options: RunOptions, speeds: bool = False
    ) -> tuple[LaneLevels, Array | None]:
        """Run lanes and return their levels, and impact speeds if wanted (`run_swept`)."""
        return run_swept(lanes, options, speeds)


def run_swept(
    lanes: Sequence[Lane], options: RunOptions, speeds: bool = False
) -> tuple[LaneLevels, Array | None]:
    """Run L sweeps and return (levels, None), or (levels, speeds) if ``speeds`` is True.

    ``speeds`` is the largest impact speed of each sweep in m/s, (L,). Sweeps that were not run have
    NaN.
    """
    if not speeds:
        levels = run_lanes(
            lanes, threads=options.threads, progress=options.progress, executor=options.executor
        )
        return levels, None
    pairs = _measure_lanes(lanes, measure_level_and_speed, options)
    rows = np.array([(math.nan,) * 7 if one is None else one for one in pairs]).T
    level, time, ratio, tip, impacts, stuck, largest = rows
    complete = not np.isnan(level).any()
    return LaneLevels(level, time, ratio, tip, impacts, stuck, complete=complete), largest


def swept_force(
    model: ModalModel,
    force: float,
    resonance: int = 1,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    rate: float | None = None,
) -> SweptForce:
    """Return a swept ``force`` (N) whose range contains the resonances of all kinds of absorber.

    The range is `optimisation.sweep_range.find_sweep_range` for the mass ratio.

    ``rate`` in % per 100 pseudo periods; None: `impact_env.drive.default_rate`. Raises
    ParameterError for arguments out of range.
    """
    force = usable_force("force", force)
    limits = find_sweep_range(model, mass_ratio, resonance)
    own = default_rate(model, (resonance,)) if rate is None else rate
    return SweptForce(model, force, resonance, limits, usable_rate("rate", own, [limits]))


def _measure_lanes(
    lanes: Sequence[Lane], measure: Callable[[Lane], object], options: RunOptions
) -> list[object | None]:
    """Return ``measure`` of each lane, None for lanes that were not run."""
    return each_lane(
        lanes,
        measure,
        Exact(),
        threads=options.threads,
        progress=options.progress,
        executor=options.executor,
    )


def measure_level_and_speed(lane: Lane) -> tuple[float, ...]:
    """Run a sweep and return seven numbers: the fields of `LaneLevels` in order, then a speed.

    The speed is the largest impact speed in m/s, 0 without impacts.
    """
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


@dataclass(frozen=True, eq=False)
class AppliedLoads:
    """Loads that act on a structure, with the measure `optimisation.measures.measure_of`.

    If the loads are a single swept force, the design rule gives a gap for it near ``resonance``
    (counted from 1).

    Raises ParameterError for loads that the structure cannot have.
    """

    model: ModalModel
    loads: Loads
    resonance: int = 1
    runs_a_member = 1
    amplitude = 1.0

    def __post_init__(self) -> None:
        check_load(Scene(self.model), self.loads, Exact())

    @property
    def measure(self) -> str:
        """Name of the measure that belongs to the loads."""
        return measure_of(self.loads)

    @property
    def power(self) -> float:
        """Exponent of the scaling law: 0 for a decay time, otherwise 1."""
        return 0.0 if self.measure == DECAY else 1.0

    def times(self, factor: float) -> "AppliedLoads":
        """Return the case with the loads multiplied by a factor.

        Raises ParameterError for a factor that is not positive.
        """
        factor = positive("force, a factor on the loads", factor)
        return replace(self, loads=self.loads.member(Member(factor=factor)))

    @cached_property
    def free_size(self) -> float:
        """Size in m of the free motion at the absorber's place.

        It is `optimisation.measures.free_size` of an ensemble's first member. Raises ParameterError
        for loads that do not move this place.
        """
        size = free_size(self.lanes(None, draw_members(1, 0))[0])
        require(size > 0, "load", 0.0, "one that moves the absorber's place")
        return size

    @cached_property
    def swept_amplitude(self) -> float:
        """Amplitude in N of loads that are a single swept force.

        It is NaN for other loads, for which there is no design rule.
        """
        part = self.loads.parts[0]
        if len(self.loads.parts) > 1 or not isinstance(part, Drive):
            return math.nan
        return part.amplitude

    def rule_gap(self, mass: float) -> float:
        """Return the design rule's gap in m for loads that are a single swept force.

        It is NaN for other loads. ``mass`` in kg.
        """
        force = self.swept_amplitude
        return (
            math.nan if math.isnan(force) else design_gap(self.model, mass, force, self.resonance)
        )

    def reference_gap(self, mass: float) -> float:
        """Return the design rule's gap in m, without a rule `START` times `free_size`.

        ``mass`` in kg.
        """
        size = self.free_size
        rule = self.rule_gap(mass)
        return START * size if math.isnan(rule) else rule

    def absorber(
        self, mass_ratio: float, restitution: float, friction_limit: float | None = None
    ) -> SlidingAbsorber:
        """Return an impact absorber with the reference gap.

        ``friction_limit`` in N. None: the paper's friction limit by the scaling law.
        """
        mass = positive("mass_ratio", mass_ratio) * self.model.beam_mass
        gap = self.reference_gap(mass)
        if friction_limit is None:
            friction_limit = scaled_friction(self.model, mass, gap)
        return impact_absorber(gap, restitution, friction_limit, mass_ratio)

    def reach(self, mass: float) -> float:
        """Return the amplitude without absorber over the rule's gap, for a single swept force.

        It is NaN for other loads. ``mass`` in kg.
        """
        return (
            math.nan
            if math.isnan(self.swept_amplitude)
            else reach(self.model, mass, self.resonance)
        )

    def reference_members(self, members: int) -> int:
        """Return ``members``: each has a record of its own, so all are run without absorber."""
        return members

    def lanes(self, absorber: Absorber | None, members: Members, first: int = 0) -> list[Lane]:
        """Return the run of each member from number ``first`` on."""
        scene = Scene(self.model, absorber)
        drives = drives_of(members, self.loads)[first:]
        return [Lane(scene, drive, steady_start=True) for drive in drives]

    def run(
        self, lanes: Sequence[Lane], options: RunOptions, speeds: bool = False
    ) -> tuple[LaneLevels, Array | None]:
        """Run L lanes and return their measures as levels, and None.

        Other results of `LaneLevels` are NaN. ``speeds`` must be False.
        """
        assert not speeds
        values = _measure_lanes(lanes, measure_lane, options)
        level = np.array([math.nan if one is None else one for one in values], dtype=np.float64)
        other = np.full(len(lanes), np.nan)
        complete = not np.isnan(level).any()
        return LaneLevels(level, other, other, other, other, other, complete=complete), None


def measure_curve(factors: Array, members: Members, values: Array) -> PerformanceCurve:
    """Return a curve of measures over factors on loads, with a run for each of M members.

    ``factors`` (F,); ``values`` (F, M): measures, NaN for runs that were not made.
    """
    level = values[..., None]
    other = np.full(level.shape, np.nan)
    complete = not np.isnan(level).any()
    lanes = LaneLevels(level, other, other, other, other, other, complete=complete)
    return PerformanceCurve(factors, members, lanes)


def find_reading(model: ModalModel, absorber: Absorber | None, loads: Excitation) -> Reading:
    """Return the frequency at which an absorber's largest displacement under loads occurs.

    It is found by a run. It is NaN if the measure is not a response level, or if the loads have
    several frequency bands.
    """
    if not isinstance(loads, Loads) or measure_of(loads) != LEVEL:
        return NO_READING
    if len(edges_of(model, loads)) > 2:
        return NO_READING
    lane = Lane(Scene(model, absorber), loads, steady_start=True)
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=record_of(loads))
    ratio = require_recorded("level", response.level).frequency_ratio
    schedule = loads.schedule
    ends = np.array([schedule.omegas.min(), schedule.omegas.max()]) / schedule.reference
    rate = 1e4 * float(np.ptp(schedule.omegas)) / schedule.reference / schedule.periods
    at_end = ends[0] < ends[1] and is_at_end(ratio, (float(ends[0]), float(ends[1])), rate)
    return Reading(ratio * schedule.reference / (2 * np.pi), bool(at_end))


def measure_bands(lane: Lane) -> tuple[float, ...]:
    """Run a lane and return the measure in each frequency band of its loads.

    The bands are those of `optimisation.signals.edges_of`; usually there is a single band.
    """
    edges = edges_of(lane.scene.model, lane.drive)
    return band_levels(lane) if len(edges) > 2 else (measure_lane(lane),)


def runs_of(
    model: ModalModel,
    absorbers: Sequence[Absorber | None],
    drives: Sequence[Excitation],
    threads: int | None = None,
    measure: Callable[[Lane], Any] = measure_lane,
    executor: Executor | None = None,
    progress: LaneProgress | None = None,
) -> Array:
    """Return ``measure`` of each absorber under each drive, (absorbers, drives, ...).

    The last axis is the band if ``measure`` is `measure_bands`. Raises KeyboardInterrupt if the
    runs were stopped.
    """
    measured_lanes = each_lane(
        [
            Lane(Scene(model, absorber), drive, steady_start=True)
            for absorber in absorbers
            for drive in drives
        ],
        measure,
        threads=threads,
        executor=executor,
        progress=progress,
    )
    if any(one is None for one in measured_lanes):
        raise KeyboardInterrupt
    values = np.array(measured_lanes, dtype=np.float64)
    return values.reshape(len(absorbers), len(drives), *values.shape[1:])
