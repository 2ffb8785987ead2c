"""Branches of harmonic balance over a range of frequencies, and their errors.

The main branches are followed from the ends of the range, isolas from exact orbits inside it. The
errors are those relative to the exact orbit and its branch.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.periodic.branch import INTERRUPTED, Branch, NoConvergenceError
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import (
    ContinuationProblem,
    Steps,
    follow_both_ways,
    follow_branch,
)
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.harmonic_balance import OMEGA_PARAMETER, Balance, harmonic_balance
from impact_env.periodic.motion import Motion
from impact_env.periodic.orbit import reorder_events
from impact_env.periodic.orbit_branches import ORBIT_BRANCH_STEPS as ORBIT_STEPS
from impact_env.periodic.orbit_branches import orbit_branch
from impact_env.periodic.response_curve import ResponseCurve, balance_curve, orbit_curve
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.periodic.trigonometric import Real

BranchProgress = Callable[
    [str, int, float], None
]  # name of the branch, number of its points, frequency in rad/s
START_FREQUENCIES = 24  # frequencies at which exact orbits are tried as starts
BALANCE_BRANCH_STEPS = Steps(first=0.02, most=0.15, least=1e-6, points=1500)
# of the upper limit of the frequency: the change of frequency that counts as much in arclength as a
# displacement of the size of the gap
PARAMETER_WIDTH = 0.05
NEAR_POINT = 0.2  # of a solution: within it, the solver tests whether a branch has the solution
SAME_SOLUTION_TOL = 1e-5  # of a solution: within it, two converged solutions are the same
BALANCE_STEPS = Steps(first=0.02, most=0.1, least=1e-6, points=1500)
OTHER_SOLUTION_DISTANCE = 0.5  # of the start: a solution farther from it is another motion


def frequency_problem(balance: Balance, low: float, high: float) -> ContinuationProblem:
    """Return the problem of continuation in frequency between two limits in rad/s.

    The unknowns are scaled by the gap, or without walls by the largest value of `Balance.free`.
    """
    gap = getattr(balance.law, "gap", None)
    scale = (
        gap if gap is not None else max(float(np.max(np.abs(balance.free()))), np.finfo(float).tiny)
    )
    return ContinuationProblem(
        balance.residual(OMEGA_PARAMETER),
        OMEGA_PARAMETER,
        scale,
        PARAMETER_WIDTH * high,
        (low, high),
    )


def start_of_orbit(balance: Balance, impulse: float, phase: float) -> Real:
    """Return the unknowns z (n,) of harmonic balance for an exact symmetric orbit.

    The absorber gets ``impulse`` (N s) from the lower wall at a ``phase`` of the force in rad, and
    the opposite impulse from the upper wall half a period later. The friction force is assumed to
    keep its sign between the impacts.
    """
    limit = getattr(balance.law, "friction_limit", None) or 0.0

    def friction_harmonics(order: Real) -> NDArray[np.complex128]:
        return np.where(order % 2 == 1, 4j * limit / (np.pi * order), 0) * np.exp(
            -1j * order * phase
        )

    return balance.at_impacts(
        np.array([phase, phase + np.pi]), np.array([impulse, -impulse]), friction_harmonics
    )


def _starts(balance: Balance, low: float, high: float, seeds: int) -> Iterator[tuple[float, Real]]:
    """Yield pairs of frequency (rad/s) and unknowns z (n,) from which branches are followed.

    The first two are motions without contact force at the ends of the range. The others are the
    exact symmetric orbits at ``seeds`` frequencies in between; without walls, and for motions of
    several periods of the force, there are none.
    """
    for omega in (low, high):
        yield omega, balance.at(OMEGA_PARAMETER, omega).free()
    gap = getattr(balance.law, "gap", None)
    linear = balance.linear
    if gap is None or linear.multiple != 1:
        return
    limit = getattr(balance.law, "friction_limit", None) or 0.0
    case = Case(
        linear.model, low, balance.force, gap, 1.0, limit, linear.mass / linear.model.beam_mass
    )
    for omega in np.linspace(low, high, seeds + 2)[1:-1]:
        for orbit in closed_form(case.changed(omega=float(omega))):
            if orbit.pushes:
                yield (
                    float(omega),
                    start_of_orbit(
                        balance.at(OMEGA_PARAMETER, float(omega)), orbit.impulse, orbit.phase
                    ),
                )


def balance_branches(
    balance: Balance,
    low: float,
    high: float,
    steps: Steps = BALANCE_BRANCH_STEPS,
    seeds: int = START_FREQUENCIES,
    progress: BranchProgress | None = None,
) -> tuple[Branch, ...]:
    """Return the branches between two frequencies in rad/s, first those from the ends.

    Other branches, such as isolas, are followed from exact symmetric orbits in closed form at
    ``seeds`` frequencies, if harmonic balance converges from there to a solution that is on no
    known branch. After Ctrl-C the branches known so far are returned. Raises ParameterError for a
    bad range, NoConvergenceError if no start gives a branch.
    """
    require(
        0 < low < high,
        "frequency range",
        (low, high),
        "two frequencies in rad/s above 0, the lower one first",
    )
    problem = frequency_problem(balance, low, high)
    result: list[Branch] = []
    for omega, z in _starts(balance, low, high, seeds):
        try:
            solution = balance.at(OMEGA_PARAMETER, omega).solved(z)
        except NoConvergenceError:
            continue
        if any(lies_on(balance, branch, solution, omega) for branch in result):
            continue
        show = None if progress is None else partial(progress, f"branch {len(result) + 1}")
        if omega in problem.limits:  # at a limit of the frequency the branch has one side only
            branch = follow_branch(
                problem, solution, omega, 1.0 if omega == low else -1.0, steps, show
            )
        else:
            branch = follow_both_ways(problem, solution, omega, steps, show)
        result.append(branch)
        if branch.ended == INTERRUPTED:
            break
    if not result:
        raise NoConvergenceError(
            "harmonic balance: no start at either end of the range or from an exact orbit converged"
        )
    return tuple(result)


def lies_on(balance: Balance, branch: Branch, z: Real, omega: float) -> bool:
    """Return whether a solution ``z`` (n,) at a frequency in rad/s is a point of a branch."""
    p = branch.parameters
    size = float(np.linalg.norm(z))
    for k in np.flatnonzero((p[:-1] - omega) * (p[1:] - omega) <= 0):
        share = 0.5 if p[k] == p[k + 1] else (omega - p[k]) / (p[k + 1] - p[k])
        between = (1 - share) * branch.points[k] + share * branch.points[k + 1]
        if np.linalg.norm(between - z) > NEAR_POINT * size:
            continue
        try:
            solution = balance.at(OMEGA_PARAMETER, omega).solved(between)
        except NoConvergenceError:
            continue
        if np.linalg.norm(solution - z) <= SAME_SOLUTION_TOL * size:
            return True
    return False


@dataclass(frozen=True)
class BalanceRow:
    """Relative errors of harmonic balance for one setting, positive if its value is too large.

    They refer to the values of the exact orbit and its branch.

    Attributes
    ----------
    harmonics : int
        Number of harmonics.
    weight : float
        Weight of the contact condition in m_a omega_1^2.
    tip_max_error : float or None
        Error of the largest tip displacement at the frequency of the exact orbit. None: no
        solution.
    closed : bool or None
        Whether the branch is closed. None, here and below: no branch was followed.
    first_fold_ratio, last_fold_ratio : float or None
        Lowest and highest frequency of its folds over omega_1. None: no fold.
    peak_error : float or None
        Error of the largest tip displacement on the branch. None: a branch without a peak.
    points : int or None
        Number of points of the branch.
    cpu_seconds_per_250_points : float or None
        Processor time of this process in s for 250 points of the branch.
    reason : str
        Why there is no solution, or why the branch ended if it is not closed; otherwise empty.
    """

    harmonics: int
    weight: float
    tip_max_error: float | None = None
    closed: bool | None = None
    first_fold_ratio: float | None = None
    last_fold_ratio: float | None = None
    peak_error: float | None = None
    points: int | None = None
    cpu_seconds_per_250_points: float | None = None
    reason: str = ""

    def to_plain(self) -> dict[str, Any]:
        """Return the attributes as a dictionary."""
        return asdict(self)


BALANCE_COLUMNS = tuple(field.name for field in fields(BalanceRow))


@dataclass(frozen=True, eq=False)
class ReferenceOrbit:
    """The exact symmetric orbit of two impacts with the largest impulse, for comparisons.

    ``impulse`` (N s) and ``phase`` of the force (rad) are those of the impact at the lower wall
    (`start_of_orbit`). ``motion`` is the orbit's motion, ``curve`` the response curve of its branch
    in frequency.
    """

    case: Case
    impulse: float
    phase: float
    motion: Motion
    curve: ResponseCurve


def exact_orbit(case: Case, low: float, high: float) -> ReferenceOrbit:
    """Return the exact orbit with the largest impulse, and its branch.

    The branch is followed between the frequencies ``low`` and ``high``, relative to omega_1. Raises
    ParameterError if there is no symmetric orbit of two impacts at the case's frequency.
    """
    pushed = [orbit for orbit in closed_form(case) if orbit.pushes]
    require(
        len(pushed) > 0,
        "frequency",
        case.omega_ratio,
        f"one with a symmetric orbit of two impacts at {case.force:g} N",
    )
    best = max(pushed, key=lambda orbit: orbit.impulse)
    motion = reorder_events(case, symmetric_schedule(case.friction_limit > 0), [best.phase])
    require(
        not isinstance(motion, NoOrbit),
        "frequency",
        case.omega_ratio,
        f"one with such an orbit ({getattr(motion, 'reason', '')})",
    )
    assert isinstance(motion, Motion)
    first = float(case.model.omega[0])
    branch = orbit_branch(
        motion.solution, OMEGA_PARAMETER, (low * first, high * first), ORBIT_STEPS
    )
    return ReferenceOrbit(case, best.impulse, best.phase, motion, orbit_curve(branch, first))


def balance_rows(
    exact: ReferenceOrbit,
    low: float,
    high: float,
    settings: Iterable[tuple[int, float]],
    traced: bool = True,
) -> Iterator[BalanceRow]:
    """Yield the errors for each pair (harmonics, weight) of ``settings``, see `BalanceRow`.

    ``traced``: whether the branch is followed and timed as well, between the frequencies ``low``
    and ``high`` relative to omega_1.
    """
    for harmonics, weight in settings:
        balance = harmonic_balance(
            exact.case.scene, exact.case.omega, exact.case.force, harmonics, weight
        )
        begin = start_of_orbit(balance, exact.impulse, exact.phase)
        try:
            z = balance.solved(begin)
        except NoConvergenceError as error:
            yield BalanceRow(harmonics, weight, reason=str(error))
            continue
        if np.linalg.norm(z - begin) > OTHER_SOLUTION_DISTANCE * np.linalg.norm(begin):
            yield BalanceRow(harmonics, weight, reason="the exact orbit leads to another solution")
            continue
        error_here = balance.response(z).tip_max / exact.motion.tip_max - 1
        yield (
            _trace_branch(exact, balance, z, low, high, weight, error_here)
            if traced
            else BalanceRow(harmonics, weight, error_here)
        )


def _trace_branch(
    exact: ReferenceOrbit,
    balance: Balance,
    z: Any,
    low: float,
    high: float,
    weight: float,
    error: float,
) -> BalanceRow:
    """Return the errors of the branch through a solution ``z`` (n,), and the time it takes.

    ``low`` and ``high`` are frequencies relative to omega_1; ``error`` is that of the largest tip
    displacement of ``z``.
    """
    first = float(exact.case.model.omega[0])
    problem: ContinuationProblem = frequency_problem(balance, low * first, high * first)
    begin = time.process_time()
    branch = follow_both_ways(problem, z, exact.case.omega, BALANCE_STEPS)
    spent = time.process_time() - begin
    curve = balance_curve(balance, branch, first)
    folds = sorted(fold.omega_ratio for fold in curve.folds)
    peak = curve.peak
    reference = exact.curve.peak
    peak_error = None if peak is None or reference is None else peak.tip_max / reference.tip_max - 1
    return BalanceRow(
        balance.linear.harmonics,
        weight,
        error,
        curve.closed,
        folds[0] if folds else None,
        folds[-1] if folds else None,
        peak_error,
        len(branch),
        250 * spent / len(branch),
        "" if branch.closed else branch.message,
    )
