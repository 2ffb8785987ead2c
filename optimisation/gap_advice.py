"""What `design_gap` answers: the gap with the lowest level, the one that is best over a tolerance of the force, and the runs that both rest on."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import CurveCase, PerformanceCurve
from impact_env.drive import PAPER_RATE, default_rate
from impact_env.ensemble import Executor, Lane, LaneLevels, Progress, draw_members, run_lanes
from impact_env.modes import ModalModel
from impact_env.parameters import CoulombFriction, SlidingAbsorber, count, friction_law, listed, one_of, require
from impact_env.scene import Scene
from optimisation.bounds import design_gap, require_reach
from optimisation.extremes import usable_force, usable_rate
from optimisation.gap_check import GapCheck, rigid_walls, scaled_absorber, sweep_limits
from optimisation.gap_search import LEAST, MEMBERS, MOST, PAIRS, STEP, Table, answers, bracket, level_between, search, start_factor, worst

Array = NDArray[np.float64]
TOLERANCE = 0.1  # of the force
MOST_TOLERANCE = 0.3
FASTER = 4.0  # times the rate of the answers: that of looks at free variables
FREE = {"restitution": (0.5, 0.35, 0.2), "friction_limit": (0.0, 0.5, 2.0)}  # what is tried of a free variable; friction as shares of the usual


@dataclass(frozen=True, eq=False)
class Answer:
    """A device that was simulated: its absorber, its level (median and 5 to 95 %, m) at the force, and the ``worst`` median over the tolerance."""

    absorber: SlidingAbsorber
    level: float
    low: float
    high: float
    worst: float

    @property
    def gap(self) -> float:
        """Clearance to either wall in m."""
        return rigid_walls(self.absorber).gap

    @property
    def friction_limit(self) -> float:
        """Friction limit in N, 0 for none."""
        return 0.0 if self.absorber.friction is None else self.absorber.friction.limit


@dataclass(frozen=True, eq=False)
class Advice:
    """The answers and what they rest on.

    ``check`` has the runs, ``table`` their levels by steps from the rule's gap. ``sweeps`` counts all runs, one member and one direction each.
    ``tried`` has what was tried of free variables: name, value, the lowest level of a look there and its gap (m). The answers are None where
    nothing was finished.
    """

    check: GapCheck
    table: Table
    tolerance: float
    members: int
    sweeps: int
    sharp: Answer | None
    recommended: Answer | None
    complete: bool
    tried: tuple[tuple[str, float, float, float], ...] = ()

    @property
    def looks(self) -> tuple[tuple[float, float], ...]:
        """Gaps that only one of several members ran, and its levels, in m."""
        every = zip(self.check.gaps, self.check.curves, strict=True)
        return tuple((float(gap), float(curve.median[0])) for gap, curve in every if len(curve.members) < min(2, self.members))

    @cached_property
    def curve(self) -> tuple[Array, Array]:
        """Steps and ln of levels that are known, see `Table.known`."""
        return self.table.known()

    def at_force(self, answer: Answer, factor: float) -> float:
        """Return the median level in m of a device under ``factor`` times the force, by the scaling law; NaN where no such gap was simulated."""
        steps, levels = self.curve
        at = math.log(answer.gap / self.check.rule) - math.log(factor)
        return math.nan if at > STEP * (steps[-1] + 1) else factor * float(level_between(STEP * steps, levels, at))

    @property
    def at_end(self) -> bool:
        """Whether the best gap is the narrowest or the widest that may be tried."""
        return self.sharp is not None and round(math.log(self.sharp.gap / self.check.rule) / STEP) in (LEAST, MOST)


class _Stopped(Exception):  # noqa: N818 - no error: what is finished is kept
    """A search was interrupted."""


@dataclass(eq=False)
class _Runs:
    """Runs at gaps by steps from the rule's, kept and continued member by member."""

    model: ModalModel
    force: float
    resonance: int
    absorber: SlidingAbsorber
    limits: tuple[float, float]
    seed: int
    friction_goes: bool
    run: Callable[[Sequence[Lane], int], LaneLevels]
    sweeps: int = 0

    def __post_init__(self) -> None:
        self.kept: dict[tuple[float | None, float], PerformanceCurve] = {}

    def device(self, step: float) -> SlidingAbsorber:
        """Return the absorber of a gap; friction goes with it unless it was given."""
        factor, friction = math.exp(STEP * step), self.absorber.friction
        if friction is not None and self.friction_goes:
            friction = CoulombFriction(friction.limit * factor)
        walls = rigid_walls(self.absorber)
        return replace(self.absorber, walls=replace(walls, gap=walls.gap * factor), friction=friction)

    def curve(self, step: float | None, members: int, rate: float) -> PerformanceCurve:
        """Return the levels of the first members at a gap, None for no absorber; those that were run before are not run again."""
        known = self.kept.get((step, rate))
        have = 0 if known is None else len(known.members)
        if known is None or have < members:
            case = CurveCase(
                Scene(self.model, None if step is None else self.device(step)), np.array([self.force]), self.resonance, self.limits, rate
            )
            every = draw_members(members, self.seed)
            lanes = [
                Lane(case.scene, drive) for m in range(have, members) for s in case.schedules() for drive in every[m : m + 1].drives(self.force, s)
            ]
            found = self.run(lanes, self.sweeps)
            if not found.complete:
                raise _Stopped
            self.sweeps += len(lanes)
            names = [f.name for f in fields(LaneLevels) if f.name != "complete"]
            arrays = {name: getattr(found, name).reshape(1, members - have, 2) for name in names}
            if known is not None:
                arrays = {name: np.concatenate([getattr(known.lanes, name), arrays[name]], axis=1) for name in names}
            known = PerformanceCurve(case.forces, every, LaneLevels(**arrays, complete=True))
            self.kept[step, rate] = known
        return known

    def levels(self, step: float, members: int, rate: float) -> Array:
        """Return the members' levels in m at a gap."""
        return self.curve(step, members, rate).combined[0, :members]


def advise(
    model: ModalModel,
    force: float,
    resonance: int = 1,
    absorber: SlidingAbsorber | None = None,
    *,
    tolerance: float = TOLERANCE,
    free: Sequence[str] = (),
    friction_given: bool = False,
    factors: Sequence[float] = (),
    members: int = MEMBERS,
    seed: int = 0,
    percent_per_100_periods: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Advice:
    """Search the gap of an impact absorber for a ``force`` in N near a resonance by simulation, see `optimisation.gap_search`.

    ``absorber`` gives mass, restitution and friction (default: `scaled_absorber`); its friction limit belongs to the rule's gap and goes with the
    gap, unless it is ``friction_given``. ``tolerance``: share of the force. ``free``: names of `FREE`. ``factors``: further gaps to run, over the
    rule's. Interruption and the other arguments as in `impact_env.curve.performance_curves`; raises ParameterError as
    `optimisation.gap_check.check_gap` does.
    """
    force = usable_force("force", force)
    require(0 <= tolerance <= MOST_TOLERANCE, "force_tolerance", tolerance, f"from 0 to {MOST_TOLERANCE:g}, a share of the force")
    wanted = [one_of("free", name, tuple(FREE)) for name in listed("free", free)]
    count("members", members, 1)
    own = scaled_absorber(model, force, resonance) if absorber is None else absorber
    walls, mass = rigid_walls(own), own.mass_ratio * model.beam_mass
    found, rule, limits = (
        require_reach(model, mass, force, resonance),
        design_gap(model, mass, force, resonance),
        sweep_limits(model, mass, resonance),
    )
    rate = usable_rate("rate", default_rate(model, (resonance,)) if percent_per_100_periods is None else percent_per_100_periods, [limits])
    pairs = PAIRS if members <= MEMBERS else 10 + 5 * members

    def run(lanes: Sequence[Lane], before: int) -> LaneLevels:
        show = None if progress is None else lambda done, _all: progress(before + done, max(2 * pairs + 4, before + len(lanes)))
        return run_lanes(lanes, threads=threads, progress=show, executor=executor)

    runs = _Runs(model, force, resonance, replace(own, walls=replace(walls, gap=rule)), limits, seed, not friction_given, run)
    start, table, complete = round(math.log(start_factor(found)) / STEP), Table(), True
    tried: list[tuple[str, float, float, float]] = []
    try:
        without = runs.curve(None, 1, rate)
        for name in wanted:
            start = _freed(runs, name, start, max(rate, min(PAPER_RATE, FASTER * rate)), tried)
        search(lambda n, m: runs.levels(n, m, rate), start, tolerance, members, pairs, table)
        runs.curve(0, 1, rate)
        for factor in factors:
            runs.curve(math.log(factor) / STEP, members, rate)
    except _Stopped:
        complete = False
        without = runs.kept.get((None, rate), _nothing(force))
    full = dict(sorted((step, curve) for (step, of), curve in runs.kept.items() if of == rate and step is not None))
    table.levels |= {step: curve.combined[0] for step, curve in full.items()}
    gaps = rule * np.exp(STEP * np.array([*full], dtype=float))
    check = GapCheck(model, resonance, force, runs.absorber, rule, gaps, limits, tuple(full.values()), without, found, rate)
    ran = max((len(levels) for levels in table.levels.values()), default=0)
    both = answers(table, tolerance, min(2, ran)) if ran else ()
    sharp, recommended = (_answer(runs.device(step), full[step], table, step, tolerance) for step in both) if both else (None, None)
    return Advice(check, table, tolerance, members, runs.sweeps, sharp, recommended, complete, tuple(tried))


def _nothing(force: float) -> PerformanceCurve:
    """Return the curve of no run."""
    none = np.full((1, 1, 2), np.nan)
    return PerformanceCurve(np.array([force]), draw_members(1, 0), LaneLevels(none, none, none, none, none, none, complete=False))


def _answer(absorber: SlidingAbsorber, curve: PerformanceCurve, table: Table, step: float, tolerance: float) -> Answer:
    """Return a device of the table with its level."""
    (low, high), (steps, levels) = curve.band[:, 0], table.known()
    level = float(curve.median[0])
    largest = float(np.maximum(level, worst(STEP * steps, levels, STEP * step, tolerance))) if tolerance > 0 else level
    return Answer(absorber, level, float(low), float(high), largest)


def _freed(runs: _Runs, name: str, start: int, rate: float, tried: list[tuple[str, float, float, float]]) -> int:
    """Put the value of a free variable with the lowest look into the runs' absorber, the gap found anew for each; return the step of its gap."""
    usual = runs.absorber
    walls, friction = rigid_walls(usual), usual.friction
    values = (walls.restitution, *FREE[name]) if name == "restitution" else (1.0, *FREE[name])
    best: tuple[float, int, SlidingAbsorber] | None = None
    for value in values:
        if name == "restitution":
            runs.absorber = replace(usual, walls=replace(walls, restitution=value))
        else:
            runs.absorber = replace(usual, friction=None if friction is None else friction_law(value * friction.limit))
        runs.kept = {key: curve for key, curve in runs.kept.items() if key[0] is None}
        seen = bracket(lambda n: float(runs.levels(n, 1, rate)[0]), start)
        step = min(seen, key=lambda n: seen[n])
        told = value if name == "restitution" else runs.device(step).friction
        tried.append((name, told if isinstance(told, float) else 0.0 if told is None else told.limit, seen[step], rigid_walls(runs.device(step)).gap))
        if best is None or seen[step] < best[0]:
            best = (seen[step], step, runs.absorber)
        start = step
    assert best is not None
    runs.absorber = best[2]
    runs.kept = {key: curve for key, curve in runs.kept.items() if key[0] is None}
    return best[1]
