"""How far harmonic balance is from the exact orbit: one isola, over harmonics and weight."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from impact_env.parameters import require
from impact_env.periodic.balance_branches import frequency_problem, start_of_orbit
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import Problem, Steps, both_ways
from impact_env.periodic.corrector import NoConvergenceError
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.harmonic_balance import OMEGA, Balance, harmonic_balance
from impact_env.periodic.motion import Motion
from impact_env.periodic.orbit import mended
from impact_env.periodic.orbit_branches import STEPS as ORBIT_STEPS
from impact_env.periodic.response_curve import ResponseCurve, balance_curve, orbit_curve
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.periodic.tracing import orbit_branch

BALANCE_STEPS = Steps(first=0.02, most=0.1, least=1e-6, points=1500)
ELSEWHERE = 0.5  # of the start: a solution farther off is another one


@dataclass(frozen=True)
class BalanceRow:
    """Errors are relative to the exact orbit: of the largest tip displacement at the frequency asked for, and of the branch's peak.

    ``weight`` in m_a omega_1^2; folds over omega_1; time is that of the processor, so that other work on the machine does not
    count; ``reason`` says why there is no solution, the other values then are None.
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
        """Return names and values."""
        return asdict(self)


COLUMNS = tuple(field.name for field in fields(BalanceRow))


@dataclass(frozen=True, eq=False)
class Exact:
    """The exact orbit with the larger impulse: start for harmonic balance, its motion, and the curve of its branch."""

    case: Case
    impulse: float
    phase: float
    motion: Motion
    curve: ResponseCurve


def exact_orbit(case: Case, low: float, high: float) -> Exact:
    """Return the orbit with the larger impulse and its branch between two ratios; raises ParameterError where there is none."""
    pushed = [orbit for orbit in closed_form(case) if orbit.pushes]
    require(len(pushed) > 0, "frequency", case.omega_ratio, f"one with a symmetric orbit of two impacts at {case.force:g} N")
    best = max(pushed, key=lambda orbit: orbit.impulse)
    motion = mended(case, symmetric_schedule(case.friction_limit > 0), [best.phase])
    require(not isinstance(motion, NoOrbit), "frequency", case.omega_ratio, f"one with such an orbit ({getattr(motion, 'reason', '')})")
    assert isinstance(motion, Motion)
    first = float(case.model.omega[0])
    branch = orbit_branch(motion.solution, OMEGA, (low * first, high * first), ORBIT_STEPS)
    return Exact(case, best.impulse, best.phase, motion, orbit_curve(branch, first))


def balance_rows(exact: Exact, low: float, high: float, settings: Iterable[tuple[int, float]], traced: bool = True) -> Iterator[BalanceRow]:
    """Yield a row for each pair of harmonics and weight; ``traced``: the branch is followed and timed too."""
    for harmonics, weight in settings:
        balance = harmonic_balance(exact.case.scene, exact.case.omega, exact.case.force, harmonics, weight)
        begin = start_of_orbit(balance, exact.impulse, exact.phase)
        try:
            z = balance.solved(begin)
        except NoConvergenceError as error:
            yield BalanceRow(harmonics, weight, reason=str(error))
            continue
        if np.linalg.norm(z - begin) > ELSEWHERE * np.linalg.norm(begin):
            yield BalanceRow(harmonics, weight, reason="the exact orbit leads to another solution")
            continue
        error_here = balance.response(z).tip_max / exact.motion.tip_max - 1
        yield _followed(exact, balance, z, low, high, weight, error_here) if traced else BalanceRow(harmonics, weight, error_here)


def _followed(exact: Exact, balance: Balance, z: Any, low: float, high: float, weight: float, error: float) -> BalanceRow:
    first = float(exact.case.model.omega[0])
    problem: Problem = frequency_problem(balance, low * first, high * first)
    begin = time.process_time()
    branch = both_ways(problem, z, exact.case.omega, BALANCE_STEPS)
    spent = time.process_time() - begin
    curve = balance_curve(balance, branch, first)
    folds = sorted(fold.omega_ratio for fold in curve.folds)
    peak, reference = curve.peak, exact.curve.peak
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


def settings_of(harmonics: Iterable[int], weights: Iterable[float], growing: bool) -> list[tuple[int, float]]:
    """Return all pairs; ``growing``: the weights are those at 20 harmonics and grow with the square of their number."""
    rows = [(h, w * (h / 20) ** 2 if growing else w) for h in harmonics for w in weights]
    return [(h, float(np.round(w, 6))) for h, w in rows]
