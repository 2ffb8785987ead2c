"""The best design of a search, and a Pareto front of two objectives.

The design comes with its levels around the study's conditions, its service loads and its
sensitivity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace

import numpy as np

from impact_env.ensemble import Executor, Lane, LaneProgress, Threads, run_lanes
from optimisation.absorber_rules import Baselines, simulate_baselines
from optimisation.frequency_levels import (
    NO_ABSORBER,
    ResonanceCurves,
    WorstRun,
    frequency_curve,
    record_lane,
)
from optimisation.insight import (
    REPORT_SEEDS,
    Levels,
    detuned_conditions,
    levels,
    list_varied,
    over_force,
    sensitivity,
    with_gaps,
)
from optimisation.objectives import Condition
from optimisation.report.design_report import make_report
from optimisation.report.front_report import make_report as make_front_report
from optimisation.report.report import CompleteAnswer, Report, silent_stages
from optimisation.search.judge import SearchResult
from optimisation.search.pareto import Front
from optimisation.search.settings import FAST
from optimisation.service import DRAWS, FEW, service
from optimisation.space import GAP, IMPACT, MASS_RATIO, Design

Stage = Callable[[str], AbstractContextManager[LaneProgress | None]]


@dataclass(frozen=True)
class ExplanationSizes:
    """Numbers of runs of the analyses of a winner.

    Attributes
    ----------
    forces, detunings : int
        Points of the curves over the force, and over a detuning of the beam.
    gap_map : int
        Points along each side of the map over gap and force.
    samples : int
        Samples of the Sobol indices, a power of 2.
    draws : int
        Draws of all tolerances together.
    map_speed : float
        Rate of the map's sweeps over the problem's rate.
    """

    forces: int = 10
    detunings: int = 9
    gap_map: int = 16
    samples: int = 64
    draws: int = DRAWS
    map_speed: float = FAST


QUICK_SIZES = ExplanationSizes(samples=16, draws=8, map_speed=1.0)


@dataclass(frozen=True, eq=False)
class DesignAnswer(CompleteAnswer):
    """The result of a search with further simulations of its winner.

    Attributes
    ----------
    result : SearchResult
        The search, its verdict, and the runs around the winner.
    frequency : tuple of ResonanceCurves
        Levels over the frequency of the winner and without absorber, near each resonance.
    worst : WorstRun, optional
        Recorded run of the winner with the highest level.
    conditions : dict
        Further content of summary.json: versions, settings.
    """

    result: SearchResult
    frequency: tuple[ResonanceCurves, ...] = ()
    worst: WorstRun | None = None
    conditions: Mapping[str, object] = field(default_factory=dict)

    def make_report(self) -> Report:
        """Return the content of the answer."""
        return make_report(self.result, self.frequency, self.conditions)

    def worst_run(self) -> WorstRun | None:
        """Return the recorded run of the winner with the highest level, if it was recorded."""
        return self.worst


@dataclass(frozen=True)
class WinnerRuns:
    """Runs of a search's winner on fresh members."""

    result: SearchResult

    @property
    def exists(self) -> bool:
        """Whether the search ended with a winner that satisfies all constraints."""
        verdict = self.result.verdict
        return verdict is not None and verdict.feasible and self.result.finished

    @property
    def design(self) -> Design:
        """The winner."""
        assert self.result.verdict is not None
        return self.result.verdict.winner.design

    @property
    def members(self) -> int:
        """Number of members."""
        return min(FEW, self.result.problem.members)

    @property
    def conditions(self) -> list[Condition]:
        """The middle condition of each resonance."""
        by_resonance: dict[int, list[Condition]] = {}
        for condition in self.result.problem.conditions:
            by_resonance.setdefault(condition.resonance, []).append(condition)
        return [part[len(part) // 2] for part in by_resonance.values()]

    def lanes(self, condition: Condition, design: Design | None, members: int) -> list[Lane]:
        """Return the runs of a design under a condition; each member sweeps up and down.

        Without a design (None) the runs are those of the structure without absorber.
        """
        problem = replace(self.result.problem, conditions=(condition,), uncertain={})
        ensemble = problem.fresh_ensemble(members, REPORT_SEEDS)
        chunks = problem.chunks(design, ensemble, problem.rate)
        lanes = [lane for chunk in chunks for lane in chunk.lanes]
        if design is not None:
            return lanes
        # a problem's runs without absorber are under 1 N
        drives = [replace(lane.drive, amplitude=condition.force) for lane in lanes]
        return [replace(lane, drive=drive) for lane, drive in zip(lanes, drives, strict=True)]

    def frequency_levels(self, executor: Executor) -> list[ResonanceCurves]:
        """Return the levels over the frequency of the winner and without absorber.

        The winner's level is the highest of a few members. There is a pair of curves near each
        resonance.
        """
        if not self.exists or self.result.problem.under_loads:
            return []
        name = f"winner, highest of {self.members} members" if self.members > 1 else "winner"
        curves = []
        for condition in self.conditions:
            own = self.lanes(condition, self.design, self.members)
            without = self.lanes(condition, None, 1)
            both = (
                frequency_curve(name, own, condition.limits, executor),
                frequency_curve(NO_ABSORBER, without, condition.limits, executor),
            )
            omega = own[0].drive.schedule.reference
            finished = tuple(one for one in both if one is not None)
            curves.append(ResonanceCurves(condition.resonance, omega, condition.force, finished))
        return curves

    def worst_run(self, executor: Executor) -> WorstRun | None:
        """Return the winner's recorded run with the highest level under the first condition.

        The result is None without a winner.
        """
        if not self.exists:
            return None
        condition = self.conditions[0]
        lanes = self.lanes(condition, self.design, self.members)
        runs = run_lanes(lanes, executor=executor)
        if not runs.complete:
            raise KeyboardInterrupt
        k = int(np.argmax(runs.level))
        return record_lane(lanes[k], k // 2, k % 2, condition.resonance)


def run_baselines(result: SearchResult, executor: Executor) -> SearchResult:
    """Return a search result to which the baselines of the winner's mass are added.

    The baselines are other absorbers of that mass, under each condition with a swept force. Without
    a winner the result is returned unchanged.
    """
    if result.verdict is None:
        return result
    problem = result.problem
    mass_ratio = result.verdict.winner.design.values[MASS_RATIO]
    baselines: list[Baselines | None] = []
    for condition in problem.conditions:
        force = (condition.force, condition.resonance)
        baselines.append(
            None
            if condition.loads is not None
            else simulate_baselines(
                problem.model, mass_ratio, force, condition.limits, problem.rate, executor
            )
        )
    return replace(result, baselines=tuple(baselines))


def run_around_winner(
    result: SearchResult,
    executor: Executor,
    sizes: ExplanationSizes | None = None,
    stage: Stage = lambda label: silent_stages(label, 0),
) -> SearchResult:
    """Return a search result with the winner's service loads and levels around conditions.

    The conditions are those of the study. Without a winner the result is returned unchanged.
    """
    runs = WinnerRuns(result)
    if not runs.exists:
        return result
    sizes = ExplanationSizes() if sizes is None else sizes
    problem = result.problem
    verdict = result.verdict
    assert verdict is not None
    winner = verdict.winner.design
    if not problem.under_loads:  # its ranges and tolerances are those of a force
        with stage("winner in service") as show:
            loads = service(problem, winner, executor, runs.members, sizes.draws, show)
        result = replace(result, service=loads)
    both = [winner, verdict.paper.design]
    main = runs.conditions

    def run_levels(
        what: str,
        designs: list[Design],
        around: list[list[Condition]],
        members: int = runs.members,
        rate: float | None = None,
    ) -> tuple[Levels, ...]:
        with stage(what) as show:
            return tuple(
                levels(problem, designs, conditions, members, executor, show, rate)
                for conditions in around
            )

    def forces(number: int) -> list[list[Condition]]:
        return [over_force(c, np.geomspace(c.force / 5, 5 * c.force, number)) for c in main]

    curves = run_levels("curves over the force", both, forces(sizes.forces))
    result = replace(result, curves=curves)
    shares = np.linspace(-0.1, 0.1, sizes.detunings)
    around = [detuned_conditions(c, shares) for c in main]
    result = replace(result, detuned=run_levels("detuned beams", both, around))
    if problem.space.concept == IMPACT:
        gap = winner.values[GAP]
        gaps = np.geomspace(gap / 5, 5 * gap, sizes.gap_map)
        gap_map = run_levels(
            "map over gap and force",
            with_gaps(winner, gaps),
            forces(sizes.gap_map),
            1,
            sizes.map_speed * problem.rate,
        )
        result = replace(result, gap_map=gap_map, gaps=tuple(gaps.tolist()))
    if len(list_varied(problem.space)) > 1:
        with stage("sensitivity") as show:
            indices = sensitivity(
                problem, winner, sizes.samples, runs.members, executor, progress=show
            )
        result = replace(result, sensitivity=indices)
    return result


def explain(
    result: SearchResult,
    *,
    sizes: ExplanationSizes | None = None,
    executor: Executor | None = None,
) -> DesignAnswer:
    """Explain the winner of a search, as the command `design search` does.

    Parameters
    ----------
    result : SearchResult
        Result of `optimisation.search.find.find`.
    sizes : ExplanationSizes, optional
        Numbers of runs.
    executor : Executor, optional
        Where the runs are made; default: threads of this process.

    Returns
    -------
    DesignAnswer
        Result with `str`, `to_json`, `plot` and `save`; for a search without a winner only the
        search.

    Examples
    --------
    >>> from optimisation.search.find import find  # doctest: +SKIP
    >>> explain(find(problem)).save("results/design")  # doctest: +SKIP
    """
    executor = Threads() if executor is None else executor
    result = run_baselines(run_around_winner(result, executor, sizes), executor)
    return DesignAnswer(result, tuple(WinnerRuns(result).frequency_levels(executor)))


@dataclass(frozen=True, eq=False)
class FrontAnswer(CompleteAnswer):
    """A Pareto front of designs.

    Attributes
    ----------
    front : Front
        All designs, and those of the front simulated with new members.
    conditions : dict
        Further content of summary.json: versions, settings.
    """

    front: Front
    conditions: Mapping[str, object] = field(default_factory=dict)

    def make_report(self) -> Report:
        """Return the content of the answer."""
        return make_front_report(self.front, self.conditions)
