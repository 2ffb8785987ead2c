"""What was found of gaps in words: the answers, and the levels over the gap as a table."""

from __future__ import annotations

import math
from collections.abc import Sequence

from optimisation.bounds import LARGE_REACH, SMALL_REACH
from optimisation.gap_advice import Advice, Answer
from optimisation.report.markdown import markdown
from optimisation.sweep_rate import LEAST_RATIO

HEADER = ("gap, mm", "of the rule's", "level, mm", "5 to 95 %, mm", "of no absorber, %", "limit, mm", "share of the possible, %", "members")


def _percent(answer: Answer, found: Advice, factor: float) -> str:
    """Return how much more a device's level is under so many times the force, in words."""
    change = 100 * (found.at_force(answer, factor) / answer.level - 1)
    return "not known" if math.isnan(change) else f"{change:+.0f} %"


def device(answer: Answer, mass: float) -> str:
    """Return what is to be built, mass in kg."""
    friction = f"friction limit {answer.friction_limit:.4g} N" if answer.friction_limit else "no friction"
    restitution = answer.absorber.walls.restitution  # type: ignore[union-attr]
    return f"a clearance of {1e3 * answer.gap:.4g} mm to either wall, {friction}, restitution {restitution:g}, mass {mass:.4g} kg"


def answer(found: Advice) -> list[str]:
    """Return the recommended device, the one with the lowest level, and what both do when the force changes."""
    check, best, sharp = found.check, found.recommended, found.sharp
    if best is None or sharp is None:
        return ["No gap was simulated in full."]
    without, t = float(check.without.median[0]), found.tolerance
    force = f"{check.force:g} N near resonance {check.resonance}"
    lines = [
        f"Recommended: {device(best, check.mass)}, for {force}.",
        (
            f"  Level {1e3 * best.level:.4g} mm ({1e3 * best.low:.4g} to {1e3 * best.high:.4g}), {100 * best.level / without:.1f} % of no absorber; "
            f"at most {1e3 * best.worst:.4g} mm from {(1 - t) * check.force:.4g} to {(1 + t) * check.force:.4g} N."
        ),
    ]
    if sharp.gap != best.gap:
        lines.append(
            f"Lowest level: {1e3 * sharp.gap:.4g} mm, level {1e3 * sharp.level:.4g} mm ({1e3 * sharp.low:.4g} to {1e3 * sharp.high:.4g}), "
            f"{100 * sharp.level / without:.1f} % of no absorber; at most {1e3 * sharp.worst:.4g} mm over that range."
        )
    rows = [f"{100 * (factor - 1):+.0f} % force: {_percent(best, found, factor)}, {_percent(sharp, found, factor)}" for factor in (1.1, 1.2, 1.3)]
    lines.append("The cliff, level at the recommended gap and at that of the lowest level: " + "; ".join(rows) + ".")
    rule = f"Design rule (no simulation): {1e3 * check.rule:.4g} mm"
    at_rule = float(check.level[check.at_rule]) if check.gaps.size and check.gaps[check.at_rule] == check.rule else math.nan
    lines.append(f"{rule}{'' if math.isnan(at_rule) else f', level {at_rule / best.level:.2f} times that of the recommended'}.")
    lines.append(f"Free amplitude over the rule's gap: {check.reach:.3g}. Friction goes with the gap and the first frequency: docs/which_gap.md.")
    lines += _tried(found.tried)
    return lines


def _tried(tried: Sequence[tuple[str, float, float]]) -> list[str]:
    """Return what each value of a free variable can do, relative to the first."""
    lines = []
    for name in dict.fromkeys(name for name, _, _ in tried):
        rows = [(value, level) for other, value, level in tried if other == name]
        words = "; ".join(f"{value:.3g}: {level / rows[0][1]:.2f}" for value, level in rows)
        lines.append(f"Lowest level of a look over the first, {name.replace('_', ' ')} {words}.")
    return lines


def warnings(found: Advice, ratio: float) -> list[str]:
    """Return what to take care of; ``ratio``: of sweeps without absorber to the stationary level."""
    check, lines = found.check, []
    if check.reach < SMALL_REACH:
        lines.append(f"Warning: the free amplitude is {check.reach:.3g} of the rule's gap; below {SMALL_REACH:g} the absorber does little.")
    if check.reach > LARGE_REACH:
        lines.append(f"Warning: free amplitude over the rule's gap above {LARGE_REACH:g}: the rule's gap is too narrow, on the steep side.")
    if found.at_end:
        lines.append("Warning: the best gap is the narrowest or widest that was tried: another mass or place may suit better.")
    if found.recommended is not None and found.recommended.level >= float(check.without.median[0]):
        lines.append("Warning: no gap brings the level below that without absorber: another place may suit better.")
    lines.append(f"Sweeps at {check.rate:.3g} % per 100 pseudo periods show {ratio:.3f} of the stationary level without absorber.")
    if ratio < LEAST_RATIO:
        lines.append(f"Warning: below {LEAST_RATIO:g} shares of the possible are left out; sweep more slowly.")
    lines.append(f"{found.sweeps} sweeps, {len(found.looks)} gaps looked at with sweeps at {found.look_rate:.3g} %.")
    return lines


def text(found: Advice) -> str:
    """Return a line for each gap that was run in full."""
    check, lines = found.check, []
    for k, gap in enumerate(check.gaps):
        low, high = 1e3 * check.band[:, k]
        share = "-" if math.isnan(check.share[k]) else f"{100 * check.share[k]:.1f}"
        cells = (f"{1e3 * gap:.4g}", f"{gap / check.rule:.3g}", f"{1e3 * check.level[k]:.4g}", f"{low:.4g} to {high:.4g}")
        more = (f"{100 * check.relative[k]:.1f}", f"{1e3 * check.limit[k]:.4g}", share, str(len(check.curves[k].members)))
        lines.append((*cells, *more))
    return markdown(HEADER, lines)
