"""The levels over the gap as a table."""

from __future__ import annotations

import math

from optimisation.gap_check import GapCheck
from optimisation.report.markdown import markdown

HEADER = ("gap, mm", "of the rule's", "level, mm", "5 to 95 %, mm", "of no absorber, %", "limit, mm", "share of the possible, %")


def text(check: GapCheck) -> str:
    """Return a line for each gap, and what the best of them says of the rule's."""
    lines = []
    for k, gap in enumerate(check.gaps):
        cells = [f"{1e3 * gap:.4g}", f"{gap / check.rule:.3g}"]
        if math.isnan(check.level[k]):
            lines.append([*cells, *["-"] * 5])
            continue
        low, high = 1e3 * check.band[:, k]
        cells += [f"{1e3 * check.level[k]:.4g}", f"{low:.4g} to {high:.4g}", f"{100 * check.relative[k]:.1f}"]
        share = "-" if math.isnan(check.share[k]) else f"{100 * check.share[k]:.1f}"
        lines.append([*cells, f"{1e3 * check.limit[k]:.4g}", share])
    best = check.best
    if best is None or math.isnan(check.level[check.at_rule]):
        return markdown(HEADER, lines)
    verdict = "The rule's gap is the best of these."
    if best != check.at_rule:
        loss = 100 * (check.level[check.at_rule] / check.level[best] - 1)
        verdict = f"Best of these is {check.gaps[best] / check.rule:.3g} times the rule's gap; the level at the rule's is {loss:.1f} % higher."
    return "\n".join([markdown(HEADER, lines), "", verdict])
