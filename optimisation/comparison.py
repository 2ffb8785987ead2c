"""The main study: absorber concepts compared over the force, near two resonances.

It corresponds to section 6 of the paper and its last figure.

All concepts have the same mass. Impact absorber, friction damper and tuned absorber (the paper's
LTVA) have the paper's parameters. The paper's tuned absorber is mistuned (see
`optimisation.tuned`), so a well-tuned absorber is added. It splits the resonance into two peaks
outside the paper's sweep. Both tuned absorbers are therefore also swept over the wide range for
which the second is tuned.

Under other loads (`compare_loads`) each concept is optimised for the loads at their own intensity:
the tuned absorber by a simplex search (`optimisation.tuned.under_loads`), the impact absorber's gap
and the friction damper's limit on a grid that is refined once. The objective is the loads' measure
(`optimisation.measures`) relative to the structure without absorber, in the mean over the members.
All concepts run under the same records and phases, so ratios are paired.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count, instance, listed, positive, require
from impact_env.curve import DEFAULT_MEMBERS, CurveCase, PerformanceCurve, performance_curves
from impact_env.drive import PAPER_LIMITS, Excitation, Member, default_rate
from impact_env.ensemble import Executor, Lane, LaneProgress, draw_members, drives_of
from impact_env.loads import Loads
from impact_env.methods import Method
from impact_env.modes import ModalModel, Structure
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    RigidWalls,
    SlidingAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.scene import Scene
from optimisation.absorber_rules import (
    RESTITUTION,
    estimate_damper,
    find_best_damper,
    rigid_walls,
    scaled_friction,
)
from optimisation.bounds import design_force, design_gap, reach, resonance_limit
from optimisation.load_cases import (
    AppliedLoads,
    Reading,
    find_reading,
    measure_bands,
    measure_curve,
    runs_of,
)
from optimisation.measures import check_size, free_size
from optimisation.mounting import model_with_absorber_at
from optimisation.signals import edges_of
from optimisation.sweep_range import (
    find_sweep_range,
    stationary_level,
    usable_force,
    usable_mass_ratio,
    usable_rate,
)
from optimisation.tuned import HIGH, LOW, minimax, smallest_amplitude
from optimisation.tuned.under_loads import MeanRatio, mean_ratio, tune_for_loads

Array = NDArray[np.float64]
WIDE_LIMITS = (LOW, HIGH)
WIDE = f"swept {LOW:g} to {HIGH:g}"
DEFAULT_FORCES = 24
MOST_FORCES = 10_000
RESONANCES = (1, 2)
# range of forces over the design force of the resonance: from where no wall is reached to where the
# absorber is almost an added mass
FORCE_SPAN = (0.06, 5.0)
# four in ten forces lie this close around the design force, where the optimum is
OPTIMUM_SPAN = (0.5, 1.6)


@dataclass(frozen=True)
class Concept:
    """An absorber of the comparison.

    ``key``: short name for files. ``label``: name in tables and figures. ``limits``: ends of the
    sweep, relative to the resonance's frequency.
    """

    key: str
    label: str
    absorber: Absorber | None
    limits: tuple[float, float] = PAPER_LIMITS


NONE = "none"
IMPACT = "impact"
FRICTION = "friction"
LTVA_PAPER = "ltva_paper"
LTVA_TUNED = "ltva_tuned"
LTVA_PAPER_WIDE = "ltva_paper_wide"
LTVA_TUNED_WIDE = "ltva_tuned_wide"


def concepts(model: ModalModel) -> tuple[Concept, ...]:
    """Return the concepts with the paper's parameters.

    The well-tuned absorber is tuned to the first resonance of ``model``.
    """
    paper = TunedAbsorber()
    tuned = minimax(model)
    return (
        Concept(NONE, "no absorber", None),
        Concept(
            IMPACT, "impact absorber", impact_absorber(restitution=RESTITUTION, friction_limit=0.1)
        ),
        Concept(FRICTION, "friction damper", friction_damper()),
        Concept(LTVA_PAPER, "tuned absorber, paper's values", paper),
        Concept(LTVA_TUNED, "tuned absorber, well tuned", tuned),
        Concept(LTVA_PAPER_WIDE, f"tuned absorber, paper's values, {WIDE}", paper, WIDE_LIMITS),
        Concept(LTVA_TUNED_WIDE, f"tuned absorber, well tuned, {WIDE}", tuned, WIDE_LIMITS),
    )


def scaled_concepts(
    model: ModalModel,
    mass_ratio: float,
    gap: float,
    resonance: int,
    force: float,
    damper_level: Callable[[SlidingAbsorber], float],
) -> tuple[Concept, ...]:
    """Return the concepts for any structure, near a ``resonance`` at a ``force`` (N).

    All have the same mass ratio. Their parameters follow from rules that give the paper's choices
    for its beam:

    - The impact absorber has the ``gap`` (m) and a friction limit by the scaling law.
    - The friction damper is the best of four (`find_best_damper`). ``damper_level`` returns the
      level in m of a damper.
    - The tuned absorber is tuned to the resonance.
    """
    mass = mass_ratio * model.beam_mass
    absorber = impact_absorber(gap, RESTITUTION, scaled_friction(model, mass, gap), mass_ratio)
    limit, _ = find_best_damper(
        lambda limit: damper_level(friction_damper(limit, mass_ratio)),
        estimate_damper(model, mass, force, resonance),
    )
    damper = friction_damper(limit, mass_ratio)
    sweep_range = find_sweep_range(model, mass_ratio, resonance)
    tuned = smallest_amplitude(model, mass_ratio, resonance, *sweep_range)
    return (
        Concept(NONE, "no absorber", None),
        Concept(IMPACT, "impact absorber", absorber),
        Concept(FRICTION, "friction damper", damper),
        Concept(LTVA_TUNED, f"tuned absorber, for resonance {resonance}", tuned),
    )


@dataclass(frozen=True, eq=False)
class ComparedLevels:
    """Levels of all concepts at F amplitudes.

    ``forces``: amplitudes (F,) in N, or factors on loads. ``curves``: performance curves by the
    concepts' keys.
    """

    forces: Array
    curves: dict[str, PerformanceCurve]

    def relative(self, key: str) -> Array:
        """Return a concept's levels relative to no absorber, (F, M), of each ensemble member."""
        return self.curves[key].relative_to(self.curves[NONE])


@dataclass(frozen=True, eq=False)
class ResonanceComparison(ComparedLevels):
    """Levels near one resonance.

    Attributes
    ----------
    model : ModalModel
        Modes of the structure.
    resonance : int
        Number of the resonance, from 1.
    design_force : float
        Force of the design rule in N.
    mass, gap : float
        Mass in kg and clearance in m of the absorbers.
    own_force : float or None
        Force in N at which the concepts are compared, None: the impact absorber's best force.
    limits : (float, float)
        Ends of the sweeps relative to the resonance, except for concepts with a wider range.
    cases : dict of str to CurveCase
        Scene and sweeps of each curve, by the concepts' keys.
    """

    model: ModalModel
    resonance: int
    design_force: float
    mass: float
    gap: float
    own_force: float | None = None
    limits: tuple[float, float] = PAPER_LIMITS
    cases: dict[str, CurveCase] = field(default_factory=dict)

    def limits_of(self, concept: Concept) -> tuple[float, float]:
        """Return the ends of a concept's sweeps, relative to the resonance's frequency."""
        return self.limits if concept.limits == PAPER_LIMITS else concept.limits

    @property
    def omega(self) -> float:
        """Resonance frequency of the free beam in rad/s."""
        return self.model.resonance_omega(self.resonance)

    def limit_at(self, forces: Array) -> Array:
        """Return the passive limit in m at forces in N.

        No device of this mass and gap has a smaller stationary maximum (`optimisation.bounds`).
        """
        return resonance_limit(
            self.model, self.mass, self.gap, forces, self.resonance, *self.limits
        )

    @cached_property
    def limit(self) -> Array:
        """The passive limit in m at the curves' forces, (F,)."""
        return self.limit_at(self.forces)

    @property
    def reach(self) -> float:
        """Amplitude without absorber over the gap, at the design force.

        If it is below 1, the impact absorber never touches a wall at that force.
        """
        return reach(self.model, self.mass, self.resonance)

    @property
    def sweep_ratio(self) -> float:
        """Level of the sweeps over the stationary level, both without absorber.

        It is NaN if no run is finished.
        """
        none = self.curves[NONE]
        return float(none.median[0] / self.forces[0]) / stationary_level(
            self.model, self.resonance, self.limits
        )

    @property
    def best(self) -> int | None:
        """Index of the force at which the impact absorber's relative level is lowest.

        It is None if no run is finished.
        """
        optimum = self.curves[IMPACT].optimum(self.curves[NONE])
        return None if optimum is None else int(np.flatnonzero(self.forces == optimum.force)[0])

    @property
    def reported_index(self) -> int | None:
        """Index of the force at which the concepts are compared; None if nothing is finished."""
        return (
            self.best
            if self.best is None or self.own_force is None
            else int(np.flatnonzero(self.forces == self.own_force)[0])
        )


@dataclass(frozen=True, eq=False)
class Comparison:
    """The comparison of all concepts near all resonances.

    ``gap`` in m. ``own_structure``: whether the structure is not the paper's beam; its absorbers
    then have other parameters than the paper's.
    """

    model: ModalModel
    concepts: tuple[Concept, ...]
    resonances: tuple[ResonanceComparison, ...]
    members: int
    seed: int
    percent_per_100_periods: float
    mass_ratio: float = DEFAULT_MASS_RATIO
    gap: float = RigidWalls.gap
    own_structure: bool = False

    @property
    def complete(self) -> bool:
        """Whether all runs were made."""
        return all(
            curve.complete for resonance in self.resonances for curve in resonance.curves.values()
        )

    @property
    def empty(self) -> bool:
        """Whether no run was finished."""
        return all(
            bool(np.isnan(curve.lanes.level).all())
            for resonance in self.resonances
            for curve in resonance.curves.values()
        )


def force_grid(design: float, forces: int = DEFAULT_FORCES) -> Array:
    """Return ascending forces in N, (forces,), over `FORCE_SPAN` times the design force.

    They are denser around the design force (N). Raises ParameterError for fewer than 2 forces.
    """
    forces = count("forces", forces, 2, MOST_FORCES)
    design = positive("design force", design)
    marks = np.log([FORCE_SPAN[0], OPTIMUM_SPAN[0], OPTIMUM_SPAN[1], FORCE_SPAN[1]])
    return np.asarray(
        design * np.exp(np.interp(np.linspace(0, 1, forces), [0, 0.4, 0.8, 1], marks))
    )


def compare(
    beam: Structure | None = None,
    *,
    resonances: Sequence[int] = RESONANCES,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    force: float | None = None,
    gap: float | None = None,
    device: SlidingAbsorber | None = None,
    forces: int = DEFAULT_FORCES,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    percent_per_100_periods: float | None = None,
    method: Method | None = None,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> Comparison:
    """Return the performance curves of all concepts near the ``resonances`` (counted from 1).

    On the paper's beam (``beam`` None or with another number of modes) the absorbers have the
    paper's parameters. On another structure, with another ``mass_ratio``, or if ``gap`` (m),
    ``force`` (N) or ``device`` is given, their parameters follow from rules (`scaled_concepts`).

    Without ``device`` a ``force`` gives the gap by the design rule for the first of ``resonances``,
    and must not be combined with ``gap`` (default 1 mm). A ``device`` with rigid walls replaces the
    impact absorber and defines mass and gap. With a device, ``force`` is the force at which the
    concepts are compared near the first of ``resonances``; the friction damper is chosen for it.

    ``forces`` is the number of forces around the design force of each resonance (`force_grid`).
    ``percent_per_100_periods`` is the sweep rate, None: `default_rate`. Other arguments, and the
    result of an interruption, are those of `performance_curves`. Raises ParameterError for
    arguments out of range or that exclude each other.
    """
    if device is not None:
        require(gap is None, "gap", gap, "left out beside a device")
        gap = rigid_walls(device).gap
        mass_ratio = device.mass_ratio
    model = model_with_absorber_at(
        Beam() if beam is None else instance("beam", beam, Beam | ModalModel)
    )
    every = tuple(
        dict.fromkeys(
            count("resonances", resonance, 1) for resonance in listed("resonances", resonances)
        )
    )
    require(len(every) > 0, "resonances", resonances, "one or more, counted from 1")
    rate = (
        default_rate(model, every) if percent_per_100_periods is None else percent_per_100_periods
    )
    mass = usable_mass_ratio("mass_ratio", mass_ratio) * model.beam_mass
    require(
        device is not None or force is None or gap is None,
        "gap",
        gap,
        "left out beside a force, for which the design rule gives it",
    )
    at = None if force is None else usable_force("force", force)
    clearance = (
        design_gap(model, mass, at, every[0])
        if gap is None and at is not None
        else positive("gap", RigidWalls.gap if gap is None else gap)
    )
    own = at if device is not None else None
    design = [design_force(model, mass, clearance, resonance) for resonance in every]
    paper = (
        isinstance(beam, Beam | None)
        and replace(beam or Beam(), modes=Beam.modes, response_position=None) == Beam()
    )
    usual = (
        paper
        and device is None
        and force is None
        and gap is None
        and mass_ratio == DEFAULT_MASS_RATIO
    )
    # the paper's study has the paper's range
    ranges = {
        resonance: PAPER_LIMITS if usual else find_sweep_range(model, mass_ratio, resonance)
        for resonance in every
    }
    rate = usable_rate("rate", rate, [*ranges.values(), *([WIDE_LIMITS] if usual else [])])

    def case_of(absorber: Absorber | None, at: NDArray[np.float64], resonance: int) -> CurveCase:
        return CurveCase(
            Scene(model, absorber), at, resonance, ranges[resonance], rate, steady_start=True
        )

    def damper_level(damper: SlidingAbsorber) -> float:
        at = np.array([design[0] if own is None else own])
        case = case_of(damper, at, every[0])
        (curve,) = performance_curves([case], 1, seed, method, threads=threads, executor=executor)
        if not curve.complete:
            raise KeyboardInterrupt
        return float(curve.median[0])

    if usual:
        compared = concepts(model)
    else:
        force_of_damper = design[0] if own is None else own
        compared = scaled_concepts(
            model, mass_ratio, clearance, every[0], force_of_damper, damper_level
        )
    if device is not None:
        compared = tuple(
            replace(concept, absorber=device) if concept.key == IMPACT else concept
            for concept in compared
        )
    grids = [force_grid(f, forces) for f in design]
    if own is not None:
        grids[0] = np.union1d(grids[0], own)
    pairs = [(r, c) for r in every for c in compared]
    grid_of = dict(zip(every, grids, strict=True))
    cases = [
        replace(
            case_of(concept.absorber, grid_of[resonance], resonance),
            limits=concept.limits if usual else ranges[resonance],
        )
        for resonance, concept in pairs
    ]
    swept_curves = performance_curves(
        cases, members, seed, method, threads=threads, progress=progress, executor=executor
    )
    curves: dict[int, dict[str, PerformanceCurve]] = {resonance: {} for resonance in every}
    swept: dict[int, dict[str, CurveCase]] = {resonance: {} for resonance in every}
    for (resonance, concept), case, curve in zip(pairs, cases, swept_curves, strict=True):
        curves[resonance][concept.key] = curve
        swept[resonance][concept.key] = case
    parts = tuple(
        ResonanceComparison(
            grid,
            curves[resonance],
            model,
            resonance,
            f,
            mass,
            clearance,
            own if resonance == every[0] else None,
            ranges[resonance],
            swept[resonance],
        )
        for resonance, grid, f in zip(every, grids, design, strict=True)
    )
    return Comparison(model, compared, parts, members, seed, rate, mass_ratio, clearance, not paper)


GAPS = np.geomspace(0.35, 5.6, 13)  # in units of `free_size`, the free motion at the absorber
# friction limits in units of m_a omega_1^2 times `free_size`; higher modes need larger limits
LIMITS = np.geomspace(0.05, 51.2, 16)
BETWEEN = np.linspace(-0.75, 0.75, 7)  # refinement around a grid's best point, in grid steps
SPAN = (0.2, 5.0)  # range of the factors on the loads
DEFAULT_FACTORS = DEFAULT_FORCES
TUNED = "tuned"
Stages = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class BandComparison(ComparedLevels):
    """Measures of all concepts in a frequency band from ``low`` to ``high`` (Hz).

    A single band extends from 0 to infinity.
    """

    low: float
    high: float


@dataclass(frozen=True, eq=False)
class LoadComparison:
    """Measures of each concept over factors on the loads, band by band.

    ``free_size`` is the size in m of the motion without absorber at the absorber's place
    (`optimisation.measures.free_size`). ``readings`` has the frequency at which each concept's
    level occurs (`optimisation.load_cases.find_reading`), by the concepts' keys.
    """

    case: AppliedLoads
    concepts: tuple[Concept, ...]
    bands: tuple[BandComparison, ...]
    free_size: float
    readings: dict[str, Reading]

    @property
    def factors(self) -> Array:
        """Factors on the loads, (F,)."""
        return self.bands[0].forces

    @property
    def absorbers(self) -> dict[str, Absorber]:
        """The absorbers by their concepts' keys."""
        return {one.key: one.absorber for one in self.concepts if one.absorber is not None}


def _best(left: MeanRatio, make: Callable[[float], Absorber], sizes: Array) -> Absorber:
    """Return the absorber with the least mean relative measure among a grid of ``sizes``.

    A size is a gap in m or a friction limit in N, and ``make`` returns its absorber. The grid has
    equal ratios; a finer grid around its best size follows. ``left`` returns the mean relative
    measures of absorbers.
    """

    def least(grid: Array) -> float:
        return float(grid[np.argmin(left([make(float(size)) for size in grid]))])

    best = least(sizes) if len(sizes) > 1 else float(sizes[0])
    return make(least(best * (sizes[1] / sizes[0]) ** BETWEEN) if len(sizes) > 1 else best)


def compare_loads(
    case: AppliedLoads,
    *,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    gap: float | None = None,
    factors: int = DEFAULT_FACTORS,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: Stages | None = None,
) -> LoadComparison:
    """Return the comparison of concepts over a number of ``factors`` on the loads, `SPAN`.

    The absorbers are optimised on ``members`` ensemble members, and compared on as many others. A
    given ``gap`` in m is used instead of the best gap. ``progress`` is called with a text, the
    number of finished runs, and 0, as the number of all runs is unknown. Runs are computed by
    ``threads`` or by an ``executor``. Raises KeyboardInterrupt if the runs are stopped.
    """
    model = case.model
    loads = case.loads
    none = Scene(model, None)
    members = count("members", members, 1)
    factors = count("forces", factors, 2, MOST_FORCES)
    drawn = draw_members(2 * members, seed)
    every = drives_of(drawn, loads)
    drives = every[:members]  # for the choice of absorbers; the other half is for the comparison
    mass = usable_mass_ratio("mass_ratio", mass_ratio) * model.beam_mass
    size = float(np.mean([free_size(Lane(none, drive, steady_start=True)) for drive in drives]))
    if gap is not None:
        check_size(Scene(model, impact_absorber(gap, RESTITUTION, None, mass_ratio)), loads)
    gaps = size * GAPS if gap is None else np.array([gap])
    done = 0

    def run(
        absorbers: Sequence[Absorber | None], drives: Sequence[Excitation], **how: Any
    ) -> Array:
        nonlocal done
        before = done
        done += len(absorbers) * len(drives)
        show = None if progress is None else lambda k, _: progress("runs", before + k, 0)
        return runs_of(model, absorbers, drives, threads, executor=executor, progress=show, **how)

    left = mean_ratio(run, drives)
    impact = _best(left, lambda gap: impact_absorber(gap, RESTITUTION, None, mass_ratio), gaps)
    scale = mass * float(model.omega[0]) ** 2 * size
    friction = _best(left, lambda limit: friction_damper(limit, mass_ratio), scale * LIMITS)
    tuned = tune_for_loads(model, mass_ratio, drives, run)
    compared = (
        Concept(NONE, "no absorber", None),
        Concept(IMPACT, "impact absorber", impact),
        Concept(FRICTION, "friction damper", friction),
        Concept(TUNED, "tuned absorber", tuned),
    )
    factors_run = np.geomspace(*SPAN, factors)
    grid = [
        drive.member(Member(factor=float(factor)))
        for factor in factors_run
        for drive in every[members:]
        if isinstance(drive, Loads)
    ]
    values = {
        one.key: run([one.absorber], grid, measure=measure_bands).reshape(factors, members, -1)
        for one in compared
    }
    bands = tuple(
        BandComparison(
            factors_run,
            {
                key: measure_curve(factors_run, drawn[members:], rows[..., k])
                for key, rows in values.items()
            },
            low,
            high,
        )
        for k, (low, high) in enumerate(pairwise(edges_of(model, loads)))
    )
    readings = {one.key: find_reading(model, one.absorber, loads) for one in compared}
    return LoadComparison(case, compared, bands, size, readings)
