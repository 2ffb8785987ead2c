"""The tunings of a linear absorber as a table."""

from __future__ import annotations

from optimisation.report.markdown import markdown
from optimisation.tuned.table import MINIMAX, PAPER_VALUES, TuningTable

HEADER = ("tuning", "k, N/m", "c, N s/m", "omega_a/omega_r", "damping ratio", "peak, %", "at", "H2 norm, %", "proved, %")


def text(table: TuningTable, bounds: dict[str, float]) -> str:
    """Return a line for each tuning with its ``bounds`` (m/N) where there are any, and how to read them."""
    without, lines = table.tunings[0].peak, []
    for tuning in table.tunings:
        values = ["", "", "", ""]
        if tuning.absorber is not None:
            frequency, damping = table.ratios(tuning.absorber)
            values = [f"{tuning.absorber.stiffness:.6g}", f"{tuning.absorber.damping:.4g}", f"{frequency:.4f}", f"{damping:.4f}"]
        scores = [f"{100 * table.relative_peak(tuning):.2f}", f"{tuning.peak_ratio:.4f}", f"{100 * table.relative_h2(tuning):.2f}"]
        proved = f"{100 * bounds[tuning.key] / without:.3f}" if tuning.key in bounds else ""
        lines.append([tuning.label, *values, *scores, proved])
    by_key = {tuning.key: tuning for tuning in table.tunings}
    paper, best = by_key[PAPER_VALUES], by_key[MINIMAX]
    notes = [
        f"Scored over {table.low:g} to {table.high:g} times omega_{table.resonance} = {table.omega:.6g} rad/s, relative to no absorber.",
        f"Mistuning: {paper.label} leave{'s' if paper.label.endswith('rule') else ''} a peak {paper.peak / best.peak:.2f} times the smallest one.",
    ]
    if bounds:
        notes.append("Proved: no amplitude in the range is larger, flanks of other resonances and all between the grid's points included.")
    return "\n".join([markdown(HEADER, lines), "", *notes])
