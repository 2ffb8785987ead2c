"""What `design_gap` answers: the gap with the lowest level, the one that is best over a tolerance of the force, and the runs that both rest on."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.curve import CurveCase, PerformanceCurve
from impact_env.drive import PAPER_RATE, default_rate
from impact_env.ensemble import Executor, Lane, LaneLevels, Progress, draw_members, run_lanes
from impact_env.modes import ModalModel
from impact_env.parameters import (
    CoulombFriction,
    SlidingAbsorber,
    count,
    friction_law,
    listed,
    one_of,
    require,
)
from impact_env.scene import Scene
from optimisation.bounds import design_gap, require_reach
from optimisation.extremes import usable_force, usable_rate
from optimisation.gap_check import GapCheck, rigid_walls, scaled_absorber, sweep_limits

# The search for a gap by simulation: the best one is bracketed by one member at a time, then more run where the answers rest.
#
# Gaps are counted in steps of ``STEP`` of ln gap from the design rule's. On the narrow side of the best gap the level climbs a cliff, on the wide one
# it is in proportion to the gap, and small dips between them are noise. So steps are wide and go towards lower levels until they are bracketed; then
# the wider neighbouring interval is halved, the narrow side first.
#
# By the scaling law a device under k times the force is the device with a k-th of the gap under the force, k times as large: level(k f, g) = k
# level(f, g/k), with a friction limit in proportion to the gap. So what a tolerance of the force does is in the table of levels already. What is no
# length scales with another ``power`` of k: a decay time with 0.


Array = NDArray[np.float64]
STEP = 0.05  # of ln gap
# steps of a bracket at first and at last, and how far it goes from the rule's gap
WIDE = 8
NEAR = 2
LEAST = -32
MOST = 32
PAIRS = 18  # of sweeps, up and down, that a search takes at most: with those of the rule's gap and of no absorber 40 sweeps
MEMBERS = 3
# (step, number of members) -> the members' levels, the first ones of the ensemble
Look = Callable[[float, int], Array]


@dataclass
class Table:
    """The members' levels by step of the gap, a whole number in a search; ``power`` see above."""

    levels: dict[float, Array] = field(default_factory=dict)
    power: float = 1.0

    def known(self) -> tuple[Array, Array]:
        """Return (steps, ln of median levels)."""
        steps = np.array(sorted(self.levels))
        return steps, np.log([float(np.median(self.levels[n])) for n in steps])


def level_between(ln_gaps: Array, ln_levels: Array, at: ArrayLike, power: float = 1.0) -> Array:
    """Return levels at ln gaps, straight lines in ln of both; beyond the widest as the gap's ``power``, beyond the narrowest NaN."""
    x = np.asarray(at, dtype=np.float64)
    beyond = np.where(x < ln_gaps[0] - 1e-9, np.nan, power * np.maximum(x - ln_gaps[-1], 0))
    return np.asarray(np.exp(np.interp(x, ln_gaps, ln_levels) + beyond))


def worst(
    ln_gaps: Array, ln_levels: Array, at: ArrayLike, tolerance: float, power: float = 1.0
) -> Array:
    """Return the largest level over force times (1 - tolerance), 1 and (1 + tolerance) of gaps at ln gaps; NaN where a neighbour is not known."""
    x = np.asarray(at, dtype=np.float64)
    every = [
        k**power * level_between(ln_gaps, ln_levels, x - np.log(k), power)
        for k in (1 - tolerance, 1.0, 1 + tolerance)
    ]
    return np.asarray(np.max(every, axis=0))


def bracket(look: Callable[[int], float], start: int) -> dict[int, float]:
    """Return the levels looked at, by step, around the lowest, whose neighbours then are `NEAR` (or at the ends `LEAST`, `MOST`)."""
    seen: dict[int, float] = {}

    def at(n: int) -> float:
        if n not in seen:
            seen[n] = look(n)
        return seen[n]

    low = start
    high = start + WIDE
    while at(low) <= at(high) and low - WIDE >= LEAST and at(low - WIDE) < at(low):
        low, high = low - WIDE, low
    while at(high) < at(low) and high + WIDE <= MOST and at(high + WIDE) < at(high):
        low = high
        high = high + WIDE
    while True:
        best = min(seen, key=lambda n: seen[n])
        below = max((n for n in seen if n < best), default=best)
        above = min((n for n in seen if n > best), default=best)
        if max(best - below, above - best) <= NEAR:
            return seen
        at((best + below) // 2 if best - below >= above - best else (best + above) // 2)


def answers(table: Table, tolerance: float, members: int = 0) -> tuple[float, float]:
    """Return the steps with the lowest level and with the lowest of `worst`, as far as is known.

    ``members``: only of gaps that so many ran. Raises ValueError if there are none.
    """
    steps, levels = table.known()
    whole = np.arange(np.ceil(steps[0]), np.floor(steps[-1]) + 1)
    every = (
        np.array([n for n, x in table.levels.items() if len(x) >= members])
        if members
        else np.union1d(whole, steps)
    )
    lowest = level_between(STEP * steps, levels, STEP * every)
    robust = worst(STEP * steps, levels, STEP * every, tolerance, table.power)
    return float(every[np.argmin(lowest)]), float(
        every[np.argmin(np.where(np.isnan(robust), np.inf, robust))]
    )


def asked(table: Table, tolerance: float, beside: bool) -> list[float]:
    """Return the steps that the answers rest on: their own, and the narrower neighbour of a larger force; ``beside``: those beside them too."""
    sharp, robust = answers(table, tolerance)
    near = [robust - round(np.log1p(tolerance) / STEP)] if tolerance > 0 else []
    return list(
        dict.fromkeys(
            (sharp, robust, *near, *((sharp - 1, sharp + 1, robust - 1) if beside else ()))
        )
    )


def search(
    look: Look, start: int, tolerance: float, members: int, pairs: int, table: Table
) -> None:
    """Fill a table, from a step on, see above; ``pairs``: of sweeps, up and down, after which no runs are added.

    Answers and the gaps beside them run with one member, then two, so that a lucky one does not take all runs; then the answers with all members, and
    what pairs are left go to the gaps beside them.
    """

    def levels(n: float, number: int) -> float:
        table.levels[n] = look(n, number)
        return float(table.levels[n][0])

    seen = bracket(lambda n: levels(n, 1), start)
    levels(min(seen, key=lambda n: seen[n]) - 1, 1)  # is the foot of the cliff there?
    spent = len(table.levels)
    for number, beside in ((1, True), (min(2, members), True), (members, False), (members, True)):
        while True:
            open_ = [
                n for n in asked(table, tolerance, beside) if len(table.levels.get(n, ())) < number
            ]
            cost = number - len(table.levels.get(open_[0], ())) if open_ else 0
            if not open_ or spent + cost > pairs:
                break
            levels(open_[0], number)
            spent += cost


TOLERANCE = 0.1  # of the force
MOST_TOLERANCE = 0.3
FASTER = 4.0  # times the rate of the answers: that of looks at free variables
FREE = {
    "restitution": (0.5, 0.35, 0.2),
    "friction_limit": (0.0, 0.5, 2.0),
}  # what is tried of a free variable; friction as shares of the usual


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
        return tuple(
            (float(gap), float(curve.median[0]))
            for gap, curve in every
            if len(curve.members) < min(2, self.members)
        )

    @cached_property
    def curve(self) -> tuple[Array, Array]:
        """Steps and ln of levels that are known, see `Table.known`."""
        return self.table.known()

    def at_force(self, answer: Answer, factor: float) -> float:
        """Return the median level in m of a device under ``factor`` times the force, by the scaling law; NaN where no such gap was simulated."""
        steps, levels = self.curve
        at = math.log(answer.gap / self.check.rule) - math.log(factor)
        return (
            math.nan
            if at > STEP * (steps[-1] + 1)
            else factor * float(level_between(STEP * steps, levels, at))
        )

    @property
    def at_end(self) -> bool:
        """Whether the best gap is the narrowest or the widest that may be tried."""
        return self.sharp is not None and round(
            math.log(self.sharp.gap / self.check.rule) / STEP
        ) in (LEAST, MOST)


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
        factor = math.exp(STEP * step)
        friction = self.absorber.friction
        if friction is not None and self.friction_goes:
            friction = CoulombFriction(friction.limit * factor)
        walls = rigid_walls(self.absorber)
        return replace(
            self.absorber, walls=replace(walls, gap=walls.gap * factor), friction=friction
        )

    def curve(self, step: float | None, members: int, rate: float) -> PerformanceCurve:
        """Return the levels of the first members at a gap, None for no absorber; those that were run before are not run again."""
        known = self.kept.get((step, rate))
        have = 0 if known is None else len(known.members)
        if known is None or have < members:
            scene = Scene(self.model, None if step is None else self.device(step))
            every = draw_members(members, self.seed)
            case = CurveCase(scene, np.array([self.force]), self.resonance, self.limits, rate)
            single = [every[m : m + 1] for m in range(have, members)]
            lanes = [
                Lane(scene, drive)
                for one in single
                for schedule in case.schedules()
                for drive in one.drives(self.force, schedule)
            ]
            found = self.run(lanes, self.sweeps)
            if not found.complete:
                raise _Stopped
            self.sweeps += len(lanes)
            names = [f.name for f in fields(LaneLevels) if f.name != "complete"]
            arrays = {name: getattr(found, name).reshape(1, members - have, 2) for name in names}
            if known is not None:
                arrays = {
                    name: np.concatenate([getattr(known.lanes, name), arrays[name]], axis=1)
                    for name in names
                }
            known = PerformanceCurve(case.forces, every, LaneLevels(**arrays, complete=True))
            self.kept[step, rate] = known
        return known

    def levels(self, step: float, members: int, rate: float) -> Array:
        """Return the members' levels in m at a gap."""
        return self.curve(step, members, rate).combined[0, :members]

    def at_rate(self, rate: float) -> dict[float, PerformanceCurve]:
        """Return the runs with an absorber at a rate, by steps in their order."""
        return dict(
            sorted(
                (step, curve)
                for (step, of), curve in self.kept.items()
                if of == rate and step is not None
            )
        )

    def check(self, rule: float, reach: float, rate: float) -> GapCheck:
        """Return the runs at a rate over the ``rule``'s gap in m; levels without an absorber that were not finished are NaN."""
        gaps = rule * np.exp(STEP * np.array([*self.at_rate(rate)], dtype=float))
        none = np.full((1, 1, 2), np.nan)
        nothing = PerformanceCurve(
            np.array([self.force]),
            draw_members(1, 0),
            LaneLevels(none, none, none, none, none, none, complete=False),
        )
        curves = tuple(self.at_rate(rate).values())
        without = self.kept.get((None, rate), nothing)
        return GapCheck(
            self.model,
            self.resonance,
            self.force,
            self.absorber,
            rule,
            gaps,
            self.limits,
            curves,
            without,
            reach,
            rate,
        )


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
    """Search the gap of an impact absorber for a ``force`` in N near a resonance by simulation, see `optimisation.gap_advice`.

    ``absorber`` gives mass, restitution and friction (default: `scaled_absorber`); its friction limit belongs to the rule's gap and goes with the
    gap, unless it is ``friction_given``. ``tolerance``: share of the force. ``free``: names of `FREE`. ``factors``: further gaps to run, over the
    rule's. Interruption and the other arguments as in `impact_env.curve.performance_curves`; raises ParameterError as
    `optimisation.gap_check.check_gap` does.
    """
    force = usable_force("force", force)
    require(
        0 <= tolerance <= MOST_TOLERANCE,
        "force_tolerance",
        tolerance,
        f"from 0 to {MOST_TOLERANCE:g}, a share of the force",
    )
    wanted = [one_of("free", name, tuple(FREE)) for name in listed("free", free)]
    members = count("members", members, 1)
    own = scaled_absorber(model, force, resonance) if absorber is None else absorber
    walls = rigid_walls(own)
    mass = own.mass_ratio * model.beam_mass
    found = require_reach(model, mass, force, resonance)
    limits = sweep_limits(model, mass, resonance)
    rule = design_gap(model, mass, force, resonance)
    rate = usable_rate(
        "rate",
        default_rate(model, (resonance,))
        if percent_per_100_periods is None
        else percent_per_100_periods,
        [limits],
    )
    pairs = PAIRS if members <= MEMBERS else 10 + 5 * members

    def run(lanes: Sequence[Lane], before: int) -> LaneLevels:
        show = (
            None
            if progress is None
            else lambda done, _all: progress(before + done, max(2 * pairs + 4, before + len(lanes)))
        )
        return run_lanes(lanes, threads=threads, progress=show, executor=executor)

    runs = _Runs(
        model,
        force,
        resonance,
        replace(own, walls=replace(walls, gap=rule)),
        limits,
        seed,
        not friction_given,
        run,
    )
    # a search begins where a fit to simulations of other structures has the best gap over the rule's, by the free amplitude over that
    start = round(math.log(1.57 / (1 + 1.14 / found)) / STEP)
    table = Table()
    complete = True
    tried: list[tuple[str, float, float, float]] = []
    try:
        runs.curve(None, 1, rate)
        for name in wanted:
            start = _freed(runs, name, start, max(rate, min(PAPER_RATE, FASTER * rate)), tried)
        search(lambda n, m: runs.levels(n, m, rate), start, tolerance, members, pairs, table)
        runs.curve(0, 1, rate)
        for factor in factors:
            runs.curve(math.log(factor) / STEP, members, rate)
    except _Stopped:
        complete = False
    table.levels |= {step: curve.combined[0] for step, curve in runs.at_rate(rate).items()}
    ran = max((len(levels) for levels in table.levels.values()), default=0)
    both = answers(table, tolerance, min(2, ran)) if ran else ()
    sharp, recommended = (
        (answer_at(runs.device(step), table, step, tolerance) for step in both)
        if both
        else (None, None)
    )
    return Advice(
        runs.check(rule, found, rate),
        table,
        tolerance,
        members,
        runs.sweeps,
        sharp,
        recommended,
        complete,
        tuple(tried),
    )


def answer_at(absorber: SlidingAbsorber, table: Table, step: float, tolerance: float) -> Answer:
    """Return a device of the table with its level, or what else is measured."""
    low, level, high = np.quantile(table.levels[step], (0.05, 0.5, 0.95)).tolist()
    steps, levels = table.known()
    largest = (
        float(np.maximum(level, worst(STEP * steps, levels, STEP * step, tolerance, table.power)))
        if tolerance > 0
        else level
    )
    return Answer(absorber, level, low, high, largest)


def _freed(
    runs: _Runs, name: str, start: int, rate: float, tried: list[tuple[str, float, float, float]]
) -> int:
    """Put the value of a free variable with the lowest look into the runs' absorber, the gap found anew for each; return the step of its gap."""
    usual = runs.absorber
    walls = rigid_walls(usual)
    friction = usual.friction
    values = (walls.restitution, *FREE[name]) if name == "restitution" else (1.0, *FREE[name])
    best: tuple[float, int, SlidingAbsorber] | None = None
    for value in values:
        if name == "restitution":
            runs.absorber = replace(usual, walls=replace(walls, restitution=value))
        else:
            runs.absorber = replace(
                usual, friction=None if friction is None else friction_law(value * friction.limit)
            )
        runs.kept = {key: curve for key, curve in runs.kept.items() if key[0] is None}
        seen = bracket(lambda n: float(runs.levels(n, 1, rate)[0]), start)
        step = min(seen, key=lambda n: seen[n])
        told = value if name == "restitution" else runs.device(step).friction
        tried.append(
            (
                name,
                told if isinstance(told, float) else 0.0 if told is None else told.limit,
                seen[step],
                rigid_walls(runs.device(step)).gap,
            )
        )
        if best is None or seen[step] < best[0]:
            best = (seen[step], step, runs.absorber)
        start = step
    assert best is not None
    runs.absorber = best[2]
    runs.kept = {key: curve for key, curve in runs.kept.items() if key[0] is None}
    return best[1]
