"""Solve a convex programme, and accept no status but `optimal`."""

import warnings
from typing import Any

from impact_env.extras import optional

with optional():
    import cvxpy


class NotOptimalError(RuntimeError):
    """A convex programme ended without an optimum; the message names the programme and the solver's status."""


def solve(problem: Any, what: str, tolerance: float) -> None:
    """Solve a cvxpy problem with CLARABEL, gap and feasibility to ``tolerance``; raise NotOptimalError unless the status is ``optimal``."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an inaccurate solution is an error here, not a warning
            problem.solve(solver=cvxpy.CLARABEL, tol_gap_abs=tolerance, tol_gap_rel=tolerance, tol_feas=tolerance)
    except cvxpy.error.SolverError as error:
        raise NotOptimalError(f"{what}: the solver failed ({error}); without an optimum there is no certificate") from error
    if problem.status != cvxpy.OPTIMAL:
        raise NotOptimalError(f"{what}: the solver ended with status {problem.status!r}, and only 'optimal' is a certificate")
