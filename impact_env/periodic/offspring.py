"""Orbits beyond the symmetric ones over a range of frequencies.

They are pairs without symmetry, orbits with doubled periods, and orbits on which runs end.

A branch of the first two kinds emerges from another branch where a multiplier is -1. A multiplier
-1 over half a period of a symmetric orbit breaks the symmetry; over the period of an orbit without
symmetry it doubles the period. A symmetric orbit does not double its period in one parameter: that
needs a pair of half-period multipliers at +i and -i, and their modulus and angle are two conditions
(Swift and Wiesenfeld, Phys. Rev. Lett. 52, 1984). Other orbits, such as those with three periods,
are found by runs of the exact method.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.periodic.basins import DEFAULT_RUNS, find_basins
from impact_env.periodic.bifurcations import (
    LEAST_HALF_DIFFERENCE,
    PERIOD_DOUBLING,
    SYMMETRY_BREAKING,
    largest_half_difference,
)
from impact_env.periodic.branch import BRANCH_POINT, INTERRUPTED, NoConvergenceError, SpecialPoint
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import ContinuationProblem, Steps, switch_at_branch_point
from impact_env.periodic.green import Conditions, NoOrbit, Solution, read_unknowns, solve
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.orbit_branches import (
    COARSE_STEPS,
    PARAMETER_SHARE,
    OrbitBranch,
    in_units,
    list_places,
    mirror_places,
    orbit_branch,
    orbit_branches,
)
from impact_env.periodic.schedule import EventSchedule
from impact_env.periodic.survey import (
    MOST_MULTIPLE,
    OrbitSearch,
    attractors,
    closed_form_over,
    drop_repeated,
    join_results,
)

BACK_ON_PARENT = "it is back on the branch that it left"
SWITCH_SIZES = (
    0.02,
    0.05,
    0.01,
    0.1,
)  # of arclength: how far from the branch point the other branch is sought, in turn
Array = NDArray[np.float64]
SearchProgress = Callable[
    [str, int, int], None
]  # what is done, how many frequencies or branches of how many (0: not known)
MOST_EVENTS_OF_BRANCH = 100  # on a branch: Newton's method takes the third power of them
# of a branch in a search for orbits, in a row: solutions at which friction would do something else;
# the frequencies at which branches begin lie closer to each other than these reach
MOST_WRONG_POINTS = 30
MOST_BRANCHES = 30  # in a range: without losses they leave one another without end
DESCENDANT_STEPS = Steps(first=0.01, least=1e-8, most=0.1, points=400)
# of the first resonance: how far beyond the range branches are followed, since a pair may leave
# there
RANGE_MARGIN = 0.02


def switch_branch(orbits: OrbitBranch, kind: str) -> Iterator[Solution]:
    """Yield solutions on the branches that emerge from a branch at bifurcations of a ``kind``.

    The kind is broken symmetry or a doubled period. Bifurcations from which no such solution is
    found are left out.
    """
    require(
        kind in (SYMMETRY_BREAKING, PERIOD_DOUBLING),
        "kind",
        kind,
        f"{SYMMETRY_BREAKING} or {PERIOD_DOUBLING}",
    )
    side = -1.0 if kind == SYMMETRY_BREAKING else 1.0
    for one in orbits.starts(kind):
        # listed twice: its events and, behind them, what they are a span later
        old = one.schedule
        later = (event.mirrored if side < 0 else event for event in old.events)
        schedule = EventSchedule(
            (*old.events, *later), False, old.period_multiple * (1 if side < 0 else 2)
        )
        phases = np.concatenate([one.phases, one.phases + old.turn])
        impulses = np.concatenate([one.impulses, side * one.impulses])
        twice = Solution(one.case, schedule, phases, impulses, one.offset, one.error, one.steps)
        result = _start_next_to_fold(twice, side, orbits.branch.parameter)
        if result is not None:
            yield result


def _start_next_to_fold(solution: Solution, side: float, parameter: str) -> Solution | None:
    """Return an orbit of the branch that emerges at a solution, or None if none is found.

    At ``solution`` the second half of the events is the first half times ``side``.
    """
    conditions = Conditions(solution.case, solution.schedule, parameter)
    value = getattr(solution.case, parameter)
    problem = ContinuationProblem(
        conditions, parameter, 1.0, PARAMETER_SHARE * (abs(value) if value != 0 else 1.0)
    )
    z = read_unknowns(solution)
    system = problem.system(len(z), Steps())
    along = _is_tangent_alike(system(system.scaled(z, value))[1], solution, side)
    for size in SWITCH_SIZES:
        try:
            point, unknowns, _ = switch_at_branch_point(
                problem, SpecialPoint(BRANCH_POINT, 0, z, value, along), size
            )[0]
        except NoConvergenceError:
            continue
        at = solution.case.changed(**{parameter: unknowns})
        result = solve(at, solution.schedule, in_units(at, solution.schedule, point, solution.case))
        if (
            not isinstance(result, NoOrbit)
            and largest_half_difference(result, side) > LEAST_HALF_DIFFERENCE
        ):
            return result
    return None


def _is_tangent_alike(jacobian: Array, solution: Solution, side: float) -> Array:
    """Return the unit tangent (m + 1,) of the branch from which another one emerges.

    It is the direction in the Jacobian's kernel in which both halves of the orbit move in the same
    way.
    """
    n = len(solution.schedule.events)
    m = solution.schedule.impacts
    shift = np.zeros((jacobian.shape[1], jacobian.shape[1]))
    for begin, size, sign in ((0, n, 1.0), (n, m, side)):
        index = np.arange(begin, begin + size)
        shift[index, np.roll(index, size // 2)] = sign
    shift[-2, -2] = side
    shift[-1, -1] = 1.0
    plane = np.linalg.svd(jacobian)[2][-2:]
    alike = plane @ (shift + np.eye(len(shift))) @ plane.T
    weights = np.linalg.eigh(0.5 * (alike + alike.T))[1][:, -1]
    result = weights @ plane
    return np.asarray(result / np.linalg.norm(result))


def descendants(
    branches: Iterable[OrbitBranch],
    limits: tuple[float, float],
    longest: int = MOST_MULTIPLE,
    most: int = MOST_BRANCHES,
    most_wrong: int | None = None,
) -> Iterator[OrbitBranch | NoOrbit]:
    """Yield the branches in frequency that emerge from ``branches``, and their descendants.

    They emerge by broken symmetry or doubled periods. ``limits`` are in rad/s, ``longest`` is the
    largest multiple of the force's period, and ``most_wrong`` is as in `orbit_branch`. Of two
    mirrored branches one is followed. For a branch with more than `MOST_EVENTS_OF_BRANCH` events,
    and for those beyond ``most`` branches, a `NoOrbit` with the reason is yielded. After Ctrl-C the
    last branch has ended as `INTERRUPTED`.
    """
    queue = list(branches)
    known: list[tuple[OrbitBranch, Array]] = []
    while queue:
        branch = queue.pop(0)
        multiple = branch.schedules[0].period_multiple
        for kind in (SYMMETRY_BREAKING, *((PERIOD_DOUBLING,) if 2 * multiple <= longest else ())):
            for solution in switch_branch(branch, kind):
                new = solution.schedule.period_multiple
                if any(
                    mirror_places(places, solution)
                    for other, places in known
                    if other.schedules[0].period_multiple == new
                ):
                    continue
                if len(known) >= most:
                    reason = (
                        f"there are more branches that leave others than the {MOST_BRANCHES} that "
                        "are followed in a range"
                    )
                    yield NoOrbit(solution.case, solution.schedule, reason, solution.phases)
                    return
                side = -1.0 if kind == SYMMETRY_BREAKING else 1.0
                result = follow_descendants(solution, limits, side, most_wrong)
                if isinstance(result, NoOrbit):
                    yield result
                    continue
                known.append((result, list_places(result)))
                queue.append(result)
                yield result
                if result.branch.ended == INTERRUPTED:
                    return


def follow_descendants(
    solution: Solution,
    limits: tuple[float, float],
    side: float | None = None,
    most_wrong: int | None = None,
) -> OrbitBranch | NoOrbit:
    """Return the branch in frequency through a solution, or the reason why it is not followed.

    ``side``: the branch emerges from another branch, on which the second half of the events is the
    first half times ``side``. It ends where it returns to the other branch.
    """
    events = len(solution.schedule.events)
    if events > MOST_EVENTS_OF_BRANCH:
        return NoOrbit(
            solution.case,
            solution.schedule,
            f"a branch of more than {MOST_EVENTS_OF_BRANCH} events is not followed",
            solution.phases,
        )
    if not limits[0] <= solution.case.omega <= limits[1]:
        return NoOrbit(
            solution.case,
            solution.schedule,
            "a branch that begins beyond the range is not followed",
            solution.phases,
        )
    try:
        result = orbit_branch(solution, "omega", limits, DESCENDANT_STEPS, most_wrong=most_wrong)
    except NoConvergenceError as error:
        return NoOrbit(solution.case, solution.schedule, str(error), solution.phases)
    return result if side is None else _cut_at_return(result, side)


def _cut_at_return(orbits: OrbitBranch, side: float) -> OrbitBranch:
    """Return a branch without ends that lie on the branch from which it emerged.

    Orbits on these ends repeat those of the other branch. A step may lead onto it where both
    branches meet.
    """
    apart = np.flatnonzero(
        [
            largest_half_difference(orbits.solution(k), side) > LEAST_HALF_DIFFERENCE
            for k in range(len(orbits.schedules))
        ]
    )
    if len(apart) == 0 or apart[-1] - apart[0] == len(orbits.schedules) - 1:
        return orbits
    branch = orbits.branch
    (first, last) = apart[[0, -1]]
    section = slice(first, last + 1)
    pairs = [
        pair
        for pair in zip(branch.located, orbits.located_schedules, strict=True)
        if first <= pair[0].after + 1 <= last + 1
    ]
    located = tuple(replace(event, after=max(0, event.after - first)) for event, _ in pairs)
    whole = replace(
        branch,
        points=branch.points[section],
        parameters=branch.parameters[section],
        located=located,
        ended=BACK_ON_PARENT,
        message=BACK_ON_PARENT,
    )
    return replace(
        orbits,
        branch=whole,
        schedules=orbits.schedules[section],
        located_schedules=tuple(schedule for _, schedule in pairs),
    )


def all_orbits_over(
    case: Case,
    ratios: Array,
    progress: SearchProgress | None = None,
    longest: int = MOST_MULTIPLE,
    settle: bool = True,
    starts: int = DEFAULT_RUNS,
    seed: int = 0,
) -> Iterator[OrbitSearch]:
    """Yield the orbits of a case at each of ascending frequency ratios (M,).

    They are symmetric orbits, orbits without symmetry, and orbits of up to ``longest`` periods of
    the force.

    If ``settle``, runs from ``starts`` random initial states at each ratio (`find_basins` with
    ``seed``) add the stable orbits that are on no known branch, and their branches;
    `OrbitSearch.basins` then has the shares of all stable orbits. Before, at ratios without a
    stable orbit, one run starts from rest and one next to each orbit. Ctrl-C yields the orbits
    found so far and is raised again. Raises ParameterError for ratios that do not ascend.
    """
    search = _DescendantSearch(case, ratios, longest, progress)
    try:
        search.symmetric()
        search.follow_offspring(search.branches)
        if settle:
            search.add_orbits_of_runs()
            search.add_orbits_of_random_starts(starts, seed)
    except KeyboardInterrupt:
        yield from search.groups
        raise
    yield from search.groups


@dataclass(eq=False)
class _DescendantSearch:
    """State of a search: a group of orbits for each frequency, and the branches found."""

    case: Case
    ratios: Array
    longest: int
    progress: SearchProgress | None
    groups: list[OrbitSearch] = field(default_factory=list)
    branches: list[OrbitBranch] = field(default_factory=list)

    @property
    def limits(self) -> tuple[float, float]:
        """Frequencies in rad/s between which branches are followed."""
        first = float(self.case.model.omega[0])
        return max(float(self.ratios[0]) - RANGE_MARGIN, 0.5 * float(self.ratios[0])) * first, (
            float(self.ratios[-1]) + RANGE_MARGIN
        ) * first

    def _report_progress(self, what: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(what, done, total)

    def symmetric(self) -> None:
        """Compute the symmetric orbits and their branches."""
        self.groups += closed_form_over(
            self.case,
            self.ratios,
            lambda done, total: self._report_progress("closed form", done, total),
        )
        self._join(
            orbit_branches(
                self.case,
                *self.limits,
                self.ratios * float(self.case.model.omega[0]),
                COARSE_STEPS,
                most_wrong=MOST_WRONG_POINTS,
            )
        )

    def follow_offspring(self, branches: Iterable[OrbitBranch]) -> None:
        """Follow what leaves some branches, and what leaves that."""
        self._join(
            descendants(
                branches,
                self.limits,
                self.longest,
                max(0, MOST_BRANCHES - len(self.branches)),
                MOST_WRONG_POINTS,
            )
        )

    def _join(self, branches: Iterable[OrbitBranch | NoOrbit]) -> None:
        """Follow branches, and add their orbits at each frequency."""
        new: list[OrbitBranch] = []
        left: list[NoOrbit] = []
        for branch in branches:
            if isinstance(branch, NoOrbit):
                left.append(branch)
                continue
            new.append(branch)
            self._report_progress("branches", len(self.branches) + len(new), 0)
            if branch.branch.ended == INTERRUPTED:
                break
        self.branches += new
        for k, group in enumerate(self.groups):
            self.groups[k] = join_results(group, new)
        self.groups[0] = replace(self.groups[0], refused=(*self.groups[0].refused, *left))
        if new and new[-1].branch.ended == INTERRUPTED:  # what was followed before Ctrl-C counts
            raise KeyboardInterrupt

    def add_orbits_of_runs(self) -> None:
        """Make runs at frequencies without a stable orbit, and follow the orbits that they find.

        The runs start from rest and from states close to the orbits.
        """
        for k in range(len(self.groups)):
            self._report_progress("runs", k, len(self.groups))
            group = self.groups[k]
            if not any(orbit.stability.stable for orbit in group.orbits):
                for result in attractors(group.case, group.orbits, most_multiple=self.longest):
                    self._add(k, result)

    def add_orbits_of_random_starts(self, starts: int, seed: int) -> None:
        """Make runs from random initial states at each frequency, and follow the orbits found."""
        for k in range(len(self.groups)):
            self._report_progress("random starts", k, len(self.groups))
            group = self.groups[k]
            basins = find_basins(
                group.case, group.orbits, starts, seed=seed, most_multiple=self.longest
            )
            self.groups[k] = replace(group, basins=basins)
            for orbit in basins.orbits:
                self._add(k, orbit)

    def _add(self, k: int, result: Orbit | NoOrbit) -> None:
        group = self.groups[k]
        if isinstance(result, NoOrbit):
            self.groups[k] = replace(group, refused=(*group.refused, result))
            return
        if len(result.impacts) == 0 or len(orbits := drop_repeated([*group.orbits, result])) == len(
            group.orbits
        ):
            return
        self.groups[k] = replace(group, orbits=tuple(orbits))
        if result.schedule.flies:
            branch = follow_descendants(result.solution, self.limits, most_wrong=MOST_WRONG_POINTS)
            self._join([branch])
            self.follow_offspring([] if isinstance(branch, NoOrbit) else [branch])
