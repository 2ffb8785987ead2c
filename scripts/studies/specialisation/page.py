"""Tables of the specialisation report."""

from __future__ import annotations

from collections import Counter
from typing import Any

from optimisation.machine import sources
from optimisation.report.markdown import markdown
from studies.specialisation.results import REAL, Results, claims, unreal
from studies.study import Measured

PARTS = (
    "search", "forced", "slots", "segments", "exact", "free_and_joined", "rigid_contact", "compliant", "linear", "moreau", "moreau_law",
    "runge_kutta", "feedback", "observers", "energies",
)  # fmt: skip
OF = {"rigid": "exact", "springs": "compliant", "level": "observers", "steps": "search"}  # modules that are counted with another


def name_of(entry: dict[str, Any]) -> str:
    """Return scene, method and what is recorded beside the level."""
    return f"{entry['absorber']}, {entry['method']}" + ("" if entry["record"] == "level" else f", {entry['record']}")


MARKERS = tuple(f"specialisation:{name}" for name in ("summary", "claims", "scenes", "code", "pairs"))


def sections(measured: Measured) -> dict[str, str]:
    """Return the page's sections by the names of their `MARKERS`."""
    results = Results(**measured.values)
    return dict(zip(MARKERS, (_summary(results, measured), _claims(results), _scenes(results), _code(results), _pairs(results)), strict=True))


def said(measured: Measured) -> str:
    """Return what the command prints: all claims."""
    return "\n".join(f"{'holds ' if claim.holds else 'BROKEN'}  {claim.text}: {claim.found}" for claim in claims(Results(**measured.values)))


def _summary(results: Results, measured: Measured) -> str:
    found, broken = list(claims(results)), [claim for claim in claims(results) if not claim.holds]
    lines = [f"{len(found) - len(broken)} of {len(found)} claims hold. {sources(measured.conditions)}"]
    lines += ["**Stopped early or a quick look: not all of the report.**"] if not measured.complete or measured.conditions.get("quick") else []
    without = unreal(results)
    if not results.pairs:
        return "\n".join(lines)
    saving = f"Left out without a saving of {100 * (REAL - 1):.0f} % or more: {', '.join(without)}." if without else "Every part left out saves time."
    return "\n".join([*lines, saving])


def _claims(results: Results) -> str:
    """Return a line for each kind of claim with the number of scenes in which it holds, and one for each claim that does not hold."""
    every = list(claims(results))
    held = Counter(claim.text.rpartition(": ")[2] for claim in every if claim.holds)
    rows = [(kind, f"holds in {number}", next(c.found for c in every if c.holds and c.text.endswith(kind))) for kind, number in held.items()]
    return markdown(("claim", "scenes", "in the first"), rows + [(claim.text, "DOES NOT HOLD", claim.found) for claim in every if not claim.holds])


def _scenes(results: Results) -> str:
    header = (
        "scene, method, recorded",
        "compile cold, s",
        "cached, s",
        "us per period",
        "impacts",
        "memory, MB",
        "held by a run, kB",
        "10 times longer, kB",
    )
    rows = [
        (
            name_of(entry),
            f"{entry['cold_s']:.1f}",
            f"{entry['cached_s']:.2f}",
            f"{entry['ns_per_period'] / 1e3:.2f}",
            f"{entry['impacts_per_period']:.2f}",
            f"{entry['memory_mb']:.0f}",
            *(f"{kb:.0f}" for kb in entry["peak_kb"]),
        )
        for entry in results.own.values()
    ]
    return markdown(header, rows)


def counts(entry: dict[str, Any]) -> dict[str, int]:
    """Return the arithmetic operations in each module of the kernels."""
    counts = dict.fromkeys(PARTS, 0)
    for function in entry["functions"]:
        module = function["name"].partition(".")[0]
        part = "energies" if module.startswith("energ") else OF.get(module, module)
        if part in counts:
            counts[part] += function["arithmetic"]
    return counts


def _code(results: Results) -> str:
    header = ("scene, method, recorded", "machine instructions", "functions", *PARTS)
    rows = [
        (name_of(entry), f"{entry['instructions']:,}", str(len(entry["functions"])), *(str(count or "") for count in counts(entry).values()))
        for entry in results.own.values()
    ]
    return markdown(header, rows)


def _pairs(results: Results) -> str:
    header = ("part", "scene without it", "us per period", "scene with it switched off", "us per period ", "ratio")
    rows = [
        (
            pair["part"],
            pair["without"],
            f"{pair['without_ns'] / 1e3:.2f}",
            pair["switched_off"],
            f"{pair['switched_off_ns'] / 1e3:.2f}",
            f"{pair['ratio']:.2f}",
        )
        for pair in results.pairs
    ]
    return markdown(header, rows)
