"""The text of the study of regimes, from rows alone."""

from __future__ import annotations

from itertools import groupby

import numpy as np

from impact_env.periodic.jump import Hazard, Jumps, hazard
from impact_env.periodic.residence import ExitRate
from impact_env.periodic.stationary import Kind
from optimisation.report.markdown import markdown
from studies.regimes.measured import STAY, SWEEP, WAYS, Row

SHOWN = 8  # frequencies of a case's rates on the page
NAMES = {Kind.LINEAR: "no impacts", Kind.PERIODIC: "periodic", Kind.SUSTAINED: "sustained", Kind.MODULATED: "strongly modulated"}


def of_case(rows: list[Row], what: str, case: str) -> list[Row]:
    """Return a case's rows of one sort."""
    return [row for row in rows if (row["what"], row["case"]) == (what, case)]


def names(rows: list[Row]) -> list[str]:
    """Return the names of cases, in the order of the rows."""
    return list(dict.fromkeys(row["case"] for row in rows))


def hazard_of(stays: list[Row], first: float = np.inf, last: float = -np.inf) -> Hazard | None:
    """Return the integral of the rates between two ratios, None where fewer than two frequencies have one."""
    known = [row for row in stays if row["rate"] is not None and last <= row["at"] <= first]
    if len(known) < 2:
        return None
    rates = [ExitRate(row["exits"], row["exposure"], row["rate"], row["low"], row["high"]) for row in known]
    return hazard([row["at"] for row in known], rates)


def stay_table(stays: list[Row]) -> str:
    """Return lines for some of the frequencies, evenly chosen; the CSV file has all."""
    step = max(1, len(stays) // SHOWN)
    lines = [
        (
            f"{row['at']:g}",
            str(row["runs"] - row["absent"]),
            str(row["exits"]),
            "" if row["rate"] is None else f"{1e4 * row['rate']:.3g}",
            "" if row["rate"] is None else f"{1e4 * row['low']:.2g} to {1e4 * row['high']:.2g}",
            f"{1e4 * row['late_exits'] / row['late_exposure']:.3g}" if row["late_exposure"] else "",
            "" if row["longest_pause"] is None else f"{row['longest_pause']:.1f}",
            str(row["returned"]),
        )
        for row in stays[::step]
    ]
    header = ("frequency ratio", "runs there", "exits", "rate, 1e-4 per pseudo period", "95 %", "later rate", "longest pause", "returned")
    return markdown(header, lines) + ("" if step == 1 else f"\n\nAll {len(stays)} frequencies: [jump_stay.csv](regimes/jump_stay.csv).")


def sweep_table(sweeps: list[Row], found: Hazard | None) -> str:
    """Return a line for each slowness: measured beside predicted."""
    lines = []
    for row in sweeps:
        told = ("", "")
        if found is not None:
            value, low, high = found.probability(row["at"])
            told = (f"{value:.3f}", f"{low:.3f} to {high:.3f}")
        share = "" if row["share"] is None else f"{row['share']:.3f}"
        high_level = "" if row["high_level"] is None else f"{row['high_level'] / row['runs']:.3f}"
        lines.append((f"{row['at']:g}", *told, share, f"{row['low']:.3f} to {row['high']:.3f}", f"{row['jumped']} of {row['present']}", high_level))
    header = ("pseudo periods per 1 %", "P(jump) predicted", "95 %", "measured", "95 %, Wilson", "runs", "level above the limit, of all")
    return markdown(header, lines)


def about(found: Hazard | None) -> str:
    """Say what the rates amount to."""
    if found is None:
        return "Fewer than two frequencies have a rate: no prediction."
    reach = f"Integral of the rate from {found.first:g} to {found.last:g}: "
    if found.value == 0:
        return f"{reach}no run left."
    inverse, interval = f"exp(-N/{1 / found.value:.0f})", f"(95 %: {1 / found.high:.0f} to {1 / found.low:.0f})"
    if found.factor == 1:
        return f"{reach}P(jump) = {inverse} {interval}."
    factor = f"A = {found.factor:.3f} (95 %: {found.factor_low:.3f} to {found.factor_high:.3f}) from the sweeps"
    return f"{reach}P(jump) = A {inverse} {interval}, {factor}."


def with_sweeps(found: Hazard | None, sweeps: list[Row]) -> Hazard | None:
    """Return the hazard with the factor that sweeps show; as it is where none of them tells."""
    measured = {row["at"]: Jumps(row["jumped"], row["present"], row["runs"]) for row in sweeps}
    told = [one for one in measured.values() if 0 < one.jumped < one.present]
    return found.with_sweeps(measured) if found is not None and told else found


def ways_table(rows: list[Row], case: str) -> str:
    """Return a line for each slowness and way of sweeps through one range, beside what constant frequencies say; empty if there are none."""
    lines = []
    for row in (row for way in WAYS for row in of_case(rows, way, case)):
        high, low = max(row["first"], row["last"]), min(row["first"], row["last"])
        rates = hazard_of(of_case(rows, STAY, case), high, low)
        share = row["left"] / row["present"]
        told, measured, error = 0.0 if rates is None else row["at"] * rates.value, -np.log1p(-share), np.sqrt(share / (1 - share) / row["present"])
        cells = (f"{told:.4f}", f"{measured:.4f}", f"{measured - told:+.4f} +- {error:.4f}")
        lines.append((f"{row['what']}, {row['first']:g} to {row['last']:g}", f"{row['at']:g}", f"{row['left']} of {row['present']}", *cells))
    header = ("sweep", "pseudo periods per 1 %", "left", "exits told by the rates", "measured, -log of the share that stays", "more than told")
    return markdown(header, lines) if lines else ""


def pattern(row: Row) -> str:
    """Return the kinds at a frequency, each with its share, the multiples of periodic ones named."""
    words = [f"{NAMES[kind]} {100 * row[kind.value] / row['runs']:.0f} %" for kind in (Kind.LINEAR,) if row[kind.value]]
    words += [f"period {multiple} {100 * number / row['runs']:.0f} %" for multiple, number in row["multiples"].items()]
    words += [f"{NAMES[kind]} {100 * row[kind.value] / row['runs']:.0f} %" for kind in (Kind.SUSTAINED, Kind.MODULATED) if row[kind.value]]
    return ", ".join(words)


def kind_table(rows: list[Row]) -> str:
    """Return a line for each stretch of frequencies with the same kinds in the same shares."""
    lines = []
    for words, run in groupby(rows, key=pattern):
        group = list(run)
        first, last = group[0]["at"], group[-1]["at"]
        lines.append(
            (
                f"{first:g}" if first == last else f"{first:g} to {last:g}",
                words,
                _span(group, "impacts_per_period", 1, "{:.2f}"),
                _span(group, "depth", 1, "{:.2f}"),
                _span(group, "absorber_share", 100, "{:.0f}"),
                _span(group, "impact_loss", 100, "{:.0f}"),
                _span(group, "friction_loss", 100, "{:.0f}"),
                _span(group, "peak_50", 1e3, "{:.3f}"),
            )
        )
    header = ("frequency ratio", "kinds", "impacts per period", "depth", "absorber's energy, %", "impact losses, %", "friction losses, %", "peak, mm")
    return markdown(header, lines)


def _span(group: list[Row], name: str, factor: float, form: str) -> str:
    low, high = (form.format(factor * f(row[name] for row in group)) for f in (min, max))
    return low if low == high else f"{low} to {high}"


def slownesses(rows: list[Row], case: str) -> list[Row]:
    """Return a case's sweeps, the fastest first."""
    return sorted(of_case(rows, SWEEP, case), key=lambda row: row["at"])
