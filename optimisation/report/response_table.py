"""Curves of periodic responses over the frequency as a table."""

from __future__ import annotations

from impact_env.periodic.envelope import QUANTILES
from impact_env.periodic.overview import Overview
from optimisation.report.markdown import markdown


def text(result: Overview) -> str:
    """Return a table of the curves, and what was refused."""
    rows, notes = [], []
    for number, curve in enumerate(result.curves, 1):
        peak = curve.peak
        folds = ", ".join(f"{fold.omega_ratio:.9g}" for fold in sorted(curve.folds, key=lambda point: point.omega_ratio))
        stable = "" if curve.stable is None else f"{100 * curve.stable.mean():.0f}"
        where = ["", ""] if peak is None else [f"{1e3 * peak.tip_max:.4f}", f"{peak.omega_ratio:.4f}"]
        rows.append([str(number), curve.method, "closed" if curve.closed else "open", str(len(curve.tip_max)), *where, folds, stable])
        notes += [f"Curve {number}: {curve.message}." if not curve.closed else ""]
        notes += [f"Curve {number}: {points} points are no orbit: {reason}." for reason, points in curve.refused]
    header = ("curve", "method", "", "points", "peak, mm", "at", "folds", "stable, %")
    blocks = [str(result.scene) + f", {result.force:g} N", "", markdown(header, rows), "", *[note for note in notes if note]]
    return "\n".join([*blocks, *(["", runs_table(result)] if result.stationary else [])])


def runs_table(result: Overview) -> str:
    """Return a line for each frequency of the stationary responses."""
    rows = [[f"{at.omega_ratio:.5f}", *(f"{1e3 * tip:.4f}" for tip in at.tip_max), f"{at.impacts:.2f}"] for at in result.stationary]
    return markdown(("runs at", *(f"{100 * q:g} %, mm" for q in QUANTILES), "impacts a period"), rows)
