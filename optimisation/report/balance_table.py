"""Harmonic balance beside the exact orbit as a table."""

from __future__ import annotations

from typing import Any

from impact_env.periodic.balance_error import BalanceRow, Exact
from optimisation.report.markdown import markdown


def shown(value: Any, scale: float, digits: int) -> str:
    """Return a value times ``scale`` with so many digits, and nothing for None."""
    return "" if value is None else f"{scale * value:.{digits}f}"


def text(exact: Exact, rows: list[BalanceRow]) -> str:
    """Return the exact orbit in words, and a table with a line for each setting of harmonic balance."""
    header = ("harmonics", "weight", "error, %", "first fold", "last fold", "peak error, %", "CPU s, 250 points", "ended")
    lines = []
    for row in rows:
        located = [shown(row.first_fold_ratio, 1, 6), shown(row.last_fold_ratio, 1, 6)]
        last = [shown(row.peak_error, 100, 2), shown(row.cpu_seconds_per_250_points, 1, 2), "closed" if row.closed else row.reason]
        lines.append([str(row.harmonics), f"{row.weight:g}", shown(row.tip_max_error, 100, 2), *located, *last])
    case, peak = exact.case, exact.curve.peak
    folds = sorted(fold.omega_ratio for fold in exact.curve.folds)
    notes = [f"{case.scene}, {case.force:g} N. The exact orbit at {case.omega_ratio:g}: {1e3 * exact.motion.tip_max:.4f} mm."]
    if peak is not None and folds:
        notes.append(f"Its branch: folds at {folds[0]:.6f} and {folds[-1]:.6f}, peak {1e3 * peak.tip_max:.4f} mm at {peak.omega_ratio:.4f}.")
    return "\n".join([*notes, "", markdown(header, lines)])
