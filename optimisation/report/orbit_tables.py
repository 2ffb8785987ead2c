"""Periodic orbits, folds and thresholds of isolas: tables to print, and the plain values of the JSON file."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from impact_env.periodic.branch import FOLD
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.isolas import Threshold
from impact_env.periodic.orbit import Orbit
from optimisation.report.markdown import markdown

CURVE_COLUMNS = ("curve", "kind", "period", "symmetric", "omega_ratio", "value", "multiplier_real", "multiplier_imag", "orbit", "located")


def plain_fold(fold: Threshold) -> dict[str, Any]:
    """Return a fold with a confirmed orbit in the JSON file's form."""
    assert isinstance(fold.orbit, Orbit)
    return {"omega_ratio": fold.omega_ratio, "force_N": fold.force, "tip_max_m": fold.orbit.motion.tip_max}


def plain_threshold(threshold: Threshold) -> dict[str, Any]:
    """Return a birth or a merger as the JSON file holds it."""
    return {"kind": threshold.kind, "force_N": threshold.force, "omega_ratio": threshold.omega_ratio}


def orbit_table(orbits: list[Orbit]) -> str:
    """Return a line for each orbit."""
    rows = []
    for orbit in orbits:
        slow, fast = (float(np.max(np.abs(values))) for values in (orbit.stability.slow_multipliers, orbit.stability.fast_multipliers))
        schedule = orbit.schedule
        kind = ("symmetric" if schedule.symmetric else "one-sided") + (
            "" if schedule.period_multiple == 1 else f", period {schedule.period_multiple}"
        )
        kind += "" if schedule.flies else ", held"
        sides = 2 if schedule.symmetric else 1
        rows.append(
            [
                f"{orbit.case.omega_ratio:.6f}", kind, str(len(orbit.impacts)), str(sides * schedule.reversals), f"{1e3 * orbit.motion.tip_max:.6f}",
                f"{1e3 * orbit.motion.tip_rms:.6f}", f"{slow:.4f}", f"{fast:.4f}", "yes" if orbit.stability.stable else "no", f"{orbit.residual:.0e}",
            ]
        )  # fmt: skip
    header = ("omega/omega_1", "kind", "impacts", "reversals", "tip max, mm", "tip RMS, mm", "slow", "fast", "stable", "residual")
    return markdown(header, rows)


def refusals(refused: list[NoOrbit], what: str) -> list[str]:
    """Say how many are no orbit, and why, the commonest reasons first; nothing if there are none."""
    if not refused:
        return []
    seen = Counter(orbit.reason.split(" (")[0] for orbit in refused)  # what is in brackets are numbers, each time others
    lines = [f"  {number} x {reason}" for reason, number in seen.most_common(8)]
    return [f"{len(refused)} {what} no orbit:", *lines, *(["  ..."] if len(seen) > 8 else [])]


def fold_text(located: tuple[Threshold, ...]) -> str:
    """Return the table of folds, and why others are none."""
    good = [(fold, fold.orbit) for fold in located if isinstance(fold.orbit, Orbit)]
    rows = [[f"{f.omega_ratio:.10f}", f"{f.force:g}", f"{1e3 * o.motion.tip_max:.6f}", str(2 * o.schedule.reversals)] for f, o in good]
    text = markdown(("omega/omega_1", "force, N", "tip max, mm", "reversals"), rows)
    return "\n".join([text, *refusals([f.orbit for f in located if isinstance(f.orbit, NoOrbit)], "folds of the closed form lead to")])


def threshold_text(found: tuple[Threshold, ...]) -> str:
    """Return the table of births and mergers, and why others are none."""
    good = [(threshold, threshold.orbit) for threshold in found if isinstance(threshold.orbit, Orbit)]
    rows = [[t.kind, f"{t.force:.8f}", f"{t.omega_ratio:.8f}", str(2 * orbit.schedule.reversals)] for t, orbit in good]
    text = markdown(("kind", "force, N", "omega/omega_1", "reversals"), rows)
    return "\n".join([text, *refusals([t.orbit for t in found if isinstance(t.orbit, NoOrbit)], "level places of the closed form lead to")])


def curve_rows(curves: list[dict[str, Any]]) -> Iterator[tuple[object, ...]]:
    """Yield a row of `CURVE_COLUMNS` for each point of the plain forms of `BifurcationCurve`, then one for each place located."""
    for number, curve in enumerate(curves, 1):
        head = (number, curve["kind"], curve["period"], int(curve["symmetric"]))
        for ratio, value, (real, imaginary), told in zip(*(curve[name] for name in ("omega_ratio", "value", "multiplier", "orbit")), strict=True):
            yield (*head, ratio, value, real, imaginary, told, "")
        for mark in curve["located"]:
            yield (*head, mark["omega_ratio"], mark["value"], "", "", mark["orbit"], mark["kind"])


def curve_text(curves: list[dict[str, Any]], words: str, scale: float) -> str:
    """Return a line for each plain form of a `BifurcationCurve`; values of the second parameter times ``scale``."""
    rows, notes = [], []
    for number, curve in enumerate(curves, 1):
        ratio, value, good = np.array(curve["omega_ratio"]), scale * np.array(curve["value"]), [told == "yes" for told in curve["orbit"]]
        turns = [f"{scale * mark['value']:.7g} at {mark['omega_ratio']:.6f}" for mark in curve["located"] if mark["kind"] == FOLD]
        ends = [f"{np.min(row):.6g} to {np.max(row):.6g}" for row in (ratio, value)]
        what = ("symmetric" if curve["symmetric"] else "one-sided") + ("" if curve["period"] == 1 else f", period {curve['period']}")
        rows.append((str(number), curve["kind"], what, f"{sum(good)} of {len(good)}", *ends, ", ".join(turns)))
        notes.append(f"Curve {number}: {curve['ended']}.")
    header = ("curve", "of", "orbits", "points that are orbits", "omega/omega_1", words, f"least or greatest {words}")
    return "\n".join([markdown(header, rows), "", *notes]) if rows else "No such place on the branches over this range of frequencies."
