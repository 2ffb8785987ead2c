"""Bifurcation diagrams by brute force.

Runs are made along a parameter, up and down, and each starts from the end of the previous one.
Exact branches are added.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count, require
from impact_env.periodic.attractors import (
    FREQUENCY,
    PARAMETERS,
    MotionKind,
    SettledMotion,
    SettleOptions,
    change_parameter,
    parameter_of,
    settle_motion,
    settle_runs,
)
from impact_env.periodic.basins import START_REACH, draw_start
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.offspring import descendants
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.orbit_branches import (
    ORBIT_BRANCH_STEPS,
    OrbitBranch,
    lies_on,
    list_places,
    mirror_places,
    orbit_branch,
    orbit_branches,
)
from impact_env.periodic.survey import closed_form_orbits
from impact_env.plain import from_scene

Array = NDArray[np.float64]
UP = "up"
DOWN = "down"
DIRECTIONS = (UP, DOWN)
RANDOM = "random"
DRAWN_PERIODS = 64  # of the force: drawn of a motion that does not repeat
FOLLOWED = ("frequency", "force", "gap", "restitution", "friction-limit")  # by branches of orbits
DIAGRAM_COLUMNS = (
    "direction",
    "value",
    "kind",
    "period",
    "symmetric",
    "level_m",
    "impacts_per_period",
    "exponent_per_period",
    "rotation_number",
    "quantity",
    "number",
    "section",
)
PointProgress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class DiagramPoint:
    """The motion on which a run ended at one value of the parameter.

    ``direction`` is "up" or "down" along the parameter, or "random" for a run from a random state.
    """

    direction: str
    value: float
    motion: SettledMotion

    def quantities(self) -> dict[str, Array]:
        """Return the quantities of diagrams by name, each an array of values.

        They are the relative displacement over the gap and the tip displacement (m) at phase 0, the
        impact phases (rad), and the level (m). A periodic motion has the points of one period,
        other motions those of the last periods.
        """
        motion = self.motion
        case = motion.case
        periods = motion.multiple or (1 if motion.kind is MotionKind.NO_IMPACTS else DRAWN_PERIODS)
        states = motion.section.states[-periods:]
        n = case.model.modes
        relative = (states[:, n] - states[:, :n] @ case.model.tip_shape) / case.gap
        share = periods / len(motion.section.states)
        impacts = round(share * len(motion.section.impact_phase))
        return {
            "relative": relative,
            "displacement": states[:, :n] @ case.scene.model.level_shape,
            "impact-phase": motion.section.impact_phase[
                len(motion.section.impact_phase) - impacts :
            ],
            "level": np.array([motion.level]),
        }

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and strings by name, with units in the names."""
        quantities = self.quantities()
        return {
            "direction": self.direction,
            "value": self.value,
            "relative_over_gap": quantities["relative"].tolist(),
            "displacement_m": quantities["displacement"].tolist(),
            "impact_phase_rad": quantities["impact-phase"].tolist(),
        } | self.motion.to_plain()

    def rows(self) -> Iterator[list[Any]]:
        """Yield the values of `DIAGRAM_COLUMNS`.

        Each number of each quantity except the level has its own row.
        """
        plain = self.motion.to_plain()
        common = [self.direction, self.value]
        common += [
            plain[name]
            for name in (
                "kind",
                "period",
                "symmetric",
                "level_m",
                "impacts_per_period",
                "exponent_per_period",
                "rotation_number",
            )
        ]
        for name, values in self.quantities().items():
            if name != "level":
                for k, value in enumerate(values):
                    yield [*common, name, k, float(value)]


@dataclass(frozen=True, eq=False)
class BranchPoints:
    """An exact branch as points of a diagram.

    Attributes
    ----------
    multiple : int
        Period in periods of the force.
    symmetric : bool
        Whether the orbits are symmetric.
    values : array, (n,)
        Values of the parameter.
    stable : array of bool, (n,)
        Whether each orbit is stable.
    relative, displacement : array, (n, multiple)
        Relative displacement over the gap, and tip displacement in m, at phase 0 of each period.
    impact_phase : tuple of n arrays
        Phases of the impacts in rad; their number may change along the branch.
    level : array, (n,)
        Level in m. Points without an orbit are NaN.
    """

    multiple: int
    symmetric: bool
    values: Array
    stable: NDArray[np.bool_]
    relative: Array
    displacement: Array
    impact_phase: tuple[Array, ...]
    level: Array

    def to_plain(self) -> dict[str, Any]:
        """Return numbers by name, with units in the names; None stands for NaN."""
        rows = {
            "relative_over_gap": self.relative,
            "displacement_m": self.displacement,
            "level_m": self.level,
        }
        plain = {
            name: [
                [_finite(x) for x in row] if isinstance(row, np.ndarray) else _finite(row)
                for row in table
            ]
            for name, table in rows.items()
        }
        return {
            "period": self.multiple,
            "symmetric": self.symmetric,
            "value": self.values.tolist(),
            "stable": self.stable.tolist(),
            "impact_phase_rad": [row.tolist() for row in self.impact_phase],
        } | plain


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True, eq=False)
class Diagram:
    """A bifurcation diagram: ``points`` of runs along a ``parameter``, and exact ``branches``."""

    case: Case
    parameter: str
    points: tuple[DiagramPoint, ...]
    branches: tuple[BranchPoints, ...] = ()

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and strings by name, with units in the names."""
        return {
            "scene": from_scene(self.case.scene),
            "force_N": self.case.force,
            "omega_ratio": self.case.omega_ratio,
            "parameter": self.parameter,
            "points": [point.to_plain() for point in self.points],
            "branches": [branch.to_plain() for branch in self.branches],
        }


def diagram_points(
    case: Case,
    parameter: str,
    values: Sequence[float],
    *,
    directions: Sequence[str] = DIRECTIONS,
    starts: int = 0,
    random_start: bool = False,
    seed: int = 0,
    options: SettleOptions | None = None,
    threads: int | None = None,
    progress: PointProgress | None = None,
) -> Iterator[DiagramPoint]:
    """Yield the motions on which runs end along a parameter.

    Each run begins with the state at the end of the previous one.

    Parameters
    ----------
    case
        Structure, absorber, force and frequency.
    parameter
        One of "frequency" (over the first resonance), "force", "gap", "restitution",
        "friction-limit" and "mass-ratio".
    values
        Values of the parameter, rising, in SI units.
    directions
        "up", "down" or both, in this order.
    starts
        Number of further runs at each value, from random initial states (see `basins.draw_start`);
        their direction is "random".
    random_start
        Whether the first run of each direction begins at a random state, not at rest.
    seed
        Of the random states.
    options
        How long runs are.
    threads
        Number of threads of the runs from random states. None: all cores.
    progress
        Called with the number of finished runs and of all.

    Yields
    ------
    DiagramPoint
        A point for each run.

    Raises
    ------
    ParameterError
        For numbers out of range, or values that do not rise.

    Examples
    --------
    >>> from impact_env import Beam, modal_model
    >>> from impact_env.periodic import Case, diagram_points
    >>> model = modal_model(Beam(modes=1))
    >>> case = Case(model, 0.95 * float(model.omega[0]), 0.1, gap=1e-3)
    >>> points = diagram_points(case, "force", [0.05, 0.1], directions=["up"])
    >>> [point.motion.name for point in points]
    ['no impacts', 'no impacts']
    """
    rising = np.asarray(values, dtype=np.float64)
    ok = rising.ndim == 1 and len(rising) > 0 and bool(np.all(np.diff(rising) > 0))
    require(ok, "values", values, "one or more rising numbers")
    for direction in directions:
        allowed = "up, down"
        require(direction in DIRECTIONS, "directions", direction, allowed)
    options = SettleOptions() if options is None else options
    starts = count("starts", starts, 0)
    seed = count("seed", seed, 0)
    total = (len(directions) + starts) * len(rising)
    done = 0

    def show(more: int) -> None:
        if progress is not None:
            progress(done + more, total)

    for direction in directions:
        state: Array | None = None
        phase = 0.0
        ordered = rising if direction == UP else rising[::-1]
        if random_start:
            first = change_parameter(case, parameter, float(ordered[0]))
            state, phase = _draw(first, seed, 0)
        for value in ordered:
            here = change_parameter(case, parameter, float(value))
            motion = settle_motion(here, state, phase, options)
            state = motion.state
            phase = 0.0
            yield DiagramPoint(direction, parameter_of(here, parameter), motion)
            done += 1
            show(0)
    for value in rising if starts else ():
        here = change_parameter(case, parameter, float(value))
        drawn = [(here, *_draw(here, seed, k)) for k in range(starts)]
        motions = settle_runs(
            drawn, options, threads=threads, progress=lambda more, _all: show(more)
        )
        for finished in motions:
            if finished is None:
                raise KeyboardInterrupt
            yield DiagramPoint(RANDOM, parameter_of(here, parameter), finished)
        done += starts


def _draw(case: Case, seed: int, number: int) -> tuple[Array, float]:
    return draw_start(case, START_REACH * case.gap, np.random.default_rng([seed, number]))


def diagram_branches(
    case: Case,
    parameter: str,
    limits: tuple[float, float],
    points: Sequence[DiagramPoint] = (),
    *,
    longest: int = 2,
    progress: Callable[[int], None] | None = None,
) -> Iterator[BranchPoints]:
    """Yield exact branches over a parameter.

    Over the frequency these are all symmetric orbits with two impacts a period between the limits,
    and branches that emerge from them where the symmetry breaks or the period doubles. Over another
    parameter they are the branches through the orbits at the case's own value. Branches through
    orbits on which runs of ``points`` ended are added, unless they lie on a known branch.

    Parameters
    ----------
    case : Case
        Structure, absorber, force and frequency.
    parameter : str
        One of "frequency" (over the first resonance), "force", "gap", "restitution" and
        "friction-limit".
    limits : (float, float)
        Least and largest value of the parameter, in SI units.
    points : sequence of DiagramPoint, optional
        Points of a diagram.
    longest : int, optional
        The longest period, in periods of the force.
    progress : callable, optional
        Called with the number of points of the branch that is followed.

    Yields
    ------
    BranchPoints
        The points of one branch.

    Raises
    ------
    ParameterError
        The parameter is not one of these, or the limits do not ascend.
    """
    require(parameter in FOLLOWED, "parameter", parameter, f"one of {', '.join(FOLLOWED)}")
    require(limits[0] < limits[1], "limits", limits, "two rising numbers")
    longest = count("longest", longest, 1)
    field = PARAMETERS[parameter]
    factor = float(case.model.omega[0]) if parameter == FREQUENCY else 1.0
    inside = (factor * limits[0], factor * limits[1])

    def show(*arguments: Any) -> None:
        if progress is not None:
            progress(int(arguments[-2]))

    known: list[Array] = []
    if parameter == FREQUENCY:
        branches = list(orbit_branches(case, *inside, progress=show))
        for branch in branches:
            known.append(list_places(branch))
            yield from _points_of(branch, factor)
        for descendant in descendants(branches, inside, longest=longest):
            if isinstance(descendant, OrbitBranch):
                known.append(list_places(descendant))
                yield from _points_of(descendant, factor)
    else:
        for orbit in closed_form_orbits(case).orbits:
            if not any(lies_on(places, orbit.solution) for places in known):
                branch = orbit_branch(orbit.solution, field, inside, ORBIT_BRANCH_STEPS, show)
                known.append(list_places(branch))
                yield from _points_of(branch, factor)
    for point in _middles_of_stretches(points):
        multiple = point.motion.multiple
        settled = point.motion.orbit() if 0 < multiple <= longest else None
        if settled is None or not settled.schedule.flies:
            continue
        solution = settled.solution
        if any(lies_on(places, solution) or mirror_places(places, solution) for places in known):
            continue
        branch = orbit_branch(solution, field, inside, ORBIT_BRANCH_STEPS, show)
        known.append(list_places(branch))
        yield from _points_of(branch, factor)


def _middles_of_stretches(points: Sequence[DiagramPoint]) -> Iterator[DiagramPoint]:
    """Yield the middle point of each series of neighbouring points with one kind of motion."""
    start = 0
    for k in range(1, len(points) + 1):
        ended = k == len(points) or (
            (points[k].direction, points[k].motion.name)
            != (points[start].direction, points[start].motion.name)
        )
        if ended:
            yield points[(start + k - 1) // 2]
            start = k


def _points_of(branch: OrbitBranch, factor: float) -> Iterator[BranchPoints]:
    """Yield the points of a branch, and of its mirror image if it is another branch.

    ``factor`` converts values of the branch's parameter to those of the diagram.
    """
    orbits = list(branch.orbits())
    values = np.asarray(branch.branch.parameters) / factor
    yield _section_points(orbits, values, branch, mirrored=False)
    if not branch.schedules[0].symmetric:
        yield _section_points(orbits, values, branch, mirrored=True)


def _section_points(
    orbits: Sequence[Orbit | NoOrbit], values: Array, branch: OrbitBranch, mirrored: bool
) -> BranchPoints:
    schedule = branch.schedules[0]
    multiple = schedule.period_multiple
    n = branch.case.model.modes
    shape = branch.case.model.tip_shape
    level_shape = branch.case.scene.model.level_shape
    side = -1.0 if mirrored else 1.0
    shift = np.pi if mirrored else 0.0
    orbit_count = len(orbits)
    relative = np.full((orbit_count, multiple), np.nan)
    displacement = np.full((orbit_count, multiple), np.nan)
    level = np.full(orbit_count, np.nan)
    stable = np.zeros(orbit_count, dtype=np.bool_)
    phases = [np.zeros(0) for _ in orbits]
    for k, orbit in enumerate(orbits):
        if not isinstance(orbit, Orbit):
            continue
        states = side * orbit.motion.states(shift + 2 * np.pi * np.arange(multiple))
        relative[k] = (states[:, n] - states[:, :n] @ shape) / orbit.case.gap
        displacement[k] = states[:, :n] @ level_shape
        phases[k] = np.array([(impact.phase + shift) % (2 * np.pi) for impact in orbit.impacts])
        level[k] = orbit.motion.tip_rms
        stable[k] = orbit.stability.stable
    return BranchPoints(
        multiple,
        schedule.symmetric,
        values,
        stable,
        relative,
        displacement,
        tuple(phases),
        level,
    )
