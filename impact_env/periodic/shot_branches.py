"""Branches by shooting, for orbits with joined phases: the state at a section is continued, and the section moves along with the longest flight."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.branch import CLOSED, STOPPED, Branch
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import Chart, Problem, Progress, Steps, continuation
from impact_env.periodic.corrector import NoConvergenceError
from impact_env.periodic.green import PARAMETERS, NoOrbit
from impact_env.periodic.locating import Monitor
from impact_env.periodic.orbit import Orbit, confirmed
from impact_env.periodic.passage import Passage, PassageError, passage
from impact_env.periodic.shooting import shot, turn_of, units_of
from impact_env.periodic.shot_motion import ShotMotion
from impact_env.periodic.tracing import PARAMETER_SHARE, PERIOD_DOUBLING, SYMMETRY_BREAKING

Array = NDArray[np.float64]
DIFFERENCE = 1e-6  # of the parameter's share: half of the step of its central difference
MARGIN = 0.25  # of the longest flight: a section nearer to an event than this moves
STEPS = Steps(first=0.01, least=1e-7, most=0.3, points=400, tolerance=1e-11)


@dataclass(frozen=True, eq=False)
class Return:
    """What is zero on an orbit: the state after a span less the one before, over its units, as residual(z, parameter) for continuation.

    ``z`` (2 N_m + 2,) is the state at the section's ``phase`` (rad) in units of ``case``, whose parameter changes; mirrored after half a period of a
    ``symmetric`` orbit.
    """

    case: Case
    parameter: str
    phase: float
    symmetric: bool
    period_multiple: int

    def passage(self, z: Array, value: float) -> Passage:
        """Return the motion over the span; raises NoConvergenceError where it cannot be followed."""
        low = 0.0 if self.parameter in ("restitution", "friction_limit", "force") else np.finfo(float).tiny
        if value < low or (self.parameter == "restitution" and value > 1):
            raise NoConvergenceError(f"{self.parameter} = {value:.6g} is out of its range")
        case = self.case.changed(**{self.parameter: value})
        try:
            return passage(case, self.phase, z * units_of(self.case), turn_of(self.symmetric, self.period_multiple) / case.omega)
        except PassageError as error:
            raise NoConvergenceError(str(error)) from error

    def __call__(self, z: Array, value: float) -> tuple[Array, Array]:
        """Return the residual (2 N_m + 2,) and its derivatives (2 N_m + 2, 2 N_m + 3) by z and by the parameter."""
        unit, sign = units_of(self.case), -1.0 if self.symmetric else 1.0
        found = self.passage(z, value)
        step = DIFFERENCE * share_of(value)
        ends = [self.passage(z, value + side * step).end for side in (1, -1)]
        by_state = sign * found.derivative * unit / unit[:, None] - np.eye(len(z))
        return sign * found.end / unit - z, np.column_stack([by_state, sign * (ends[0] - ends[1]) / (2 * step) / unit])


def share_of(value: float) -> float:
    """Return the change of a parameter that counts as much as a unit of the state."""
    return PARAMETER_SHARE * (abs(value) if value != 0 else 1.0)


@dataclass(frozen=True, eq=False)
class ShotBranch:
    """A branch of states at sections: ``sections`` (m,) are their phases in rad, one for each point; a state is in units of ``case``."""

    case: Case
    branch: Branch
    sections: Array
    symmetric: bool
    period_multiple: int

    def motion(self, k: int) -> ShotMotion | NoOrbit:
        """Return the motion at point ``k``, or why its events are no orbit's."""
        at = Return(self.case, self.branch.parameter, float(self.sections[k]), self.symmetric, self.period_multiple)
        value = float(self.branch.parameters[k])
        found = at.passage(self.branch.points[k], value)
        return shot(self.case.changed(**{self.branch.parameter: value}), found, self.symmetric, self.period_multiple, 0.0, 0)

    def orbits(self) -> Iterator[Orbit | NoOrbit]:
        """Yield each point's orbit, confirmed by the exact method, or why it is none."""
        for k in range(len(self.sections)):
            motion = self.motion(k)
            yield motion if isinstance(motion, NoOrbit) else confirmed(motion)


@dataclass(eq=False)
class _Walk:
    """What a continuation needs to know on its way: the section in use, and those of the points passed."""

    at: Return
    passed: list[float] = field(default_factory=list)

    def monitors(self) -> tuple[Monitor, ...]:
        return (Monitor(SYMMETRY_BREAKING if self.at.symmetric else PERIOD_DOUBLING, self._turning_back),)

    def _turning_back(self, z: Array, value: float) -> float:
        matrix = self.at.passage(z, value).derivative * (-1.0 if self.at.symmetric else 1.0)
        return float(np.linalg.det(matrix + np.eye(len(matrix))))

    def recentre(self, z: Array, value: float, along: Array) -> Chart | None:
        """Return the state at another section if this one has come near to an event."""
        self.passed.append(self.at.phase)
        at, found = self.at, self.at.passage(z, value)
        case = at.case.changed(**{at.parameter: value})
        motion = shot(case, found, at.symmetric, at.period_multiple, 0.0, 0)
        if isinstance(motion, NoOrbit):
            return None
        phase, state = motion.mid_flight()
        if abs(phase - at.phase) < MARGIN * case.omega * _longest(found):
            return None
        unit, step = units_of(at.case), DIFFERENCE / max(float(np.max(np.abs(along[:-1]))), float(abs(along[-1])) / share_of(value), 1e-30)
        moved = [self._carried(z + side * step * along[:-1], value + side * step * along[-1], phase) for side in (1, -1)]
        self.at = Return(at.case, at.parameter, phase, at.symmetric, at.period_multiple)
        return Chart(self.at, state / unit, np.append((moved[0] - moved[1]) / (2 * step), along[-1]), 1.0, self.monitors())

    def _carried(self, z: Array, value: float, phase: float) -> Array:
        """Return the state in its units, carried on to another section."""
        at = self.at
        case, unit = at.case.changed(**{at.parameter: value}), units_of(at.case)
        turn = turn_of(at.symmetric, at.period_multiple)
        rounds = np.floor((phase - at.phase) / turn)
        span = (phase - at.phase - rounds * turn) / case.omega
        mirror = -1.0 if at.symmetric and rounds % 2 == 1 else 1.0
        try:
            return np.asarray(mirror * passage(case, at.phase, z * unit, span).end / unit)
        except PassageError as error:
            raise NoConvergenceError(str(error)) from error


def _longest(found: Passage) -> float:
    times = np.diff([piece.time for piece in found.pieces] + [found.span])
    flying = [not piece.flow.joined for piece in found.pieces]
    return float(max(np.max(times * flying), times[0] + times[-1]))


def _one_way(
    orbit: Orbit, parameter: str, limits: tuple[float, float], side: float, steps: Steps, progress: Progress | None
) -> tuple[Branch, list[float]]:
    phase, state = orbit.motion.mid_flight()
    walk = _Walk(Return(orbit.case, parameter, phase, orbit.schedule.symmetric, orbit.schedule.period_multiple))
    value = getattr(orbit.case, parameter)
    problem = Problem(walk.at, parameter, 1.0, share_of(value), limits, walk.monitors(), walk.recentre)
    branch = continuation(problem, state / units_of(orbit.case), value, side, steps, progress)
    sections = [phase, *walk.passed]
    return branch, [*sections, *[walk.at.phase] * (len(branch) - len(sections))][: len(branch)]


def shot_branch(orbit: Orbit, parameter: str, limits: tuple[float, float], steps: Steps = STEPS, progress: Progress | None = None) -> ShotBranch:
    """Return the branch through an orbit, to both sides, in a parameter of `PARAMETERS` (SI units) within ``limits``, by shooting.

    Joined phases, reversals and impacts come and go along it. It ends at its limits, where it is back at its start, or where no smaller step leads
    on, as where the absorber grazes a wall; Ctrl-C ends it with what is known so far. Raises ParameterError for another parameter.
    """
    require(parameter in PARAMETERS, "parameter", parameter, f"one of {', '.join(PARAMETERS)}")
    multiple, symmetric = orbit.schedule.period_multiple, orbit.schedule.symmetric
    forward, sections = _one_way(orbit, parameter, limits, 1.0, steps, progress)
    if forward.ended in (CLOSED, STOPPED):
        return ShotBranch(orbit.case, forward, np.array(sections), symmetric, multiple)
    backward, others = _one_way(orbit, parameter, limits, -1.0, steps, progress)
    return ShotBranch(orbit.case, forward.joined(backward), np.array([*others[:0:-1], *sections]), symmetric, multiple)
