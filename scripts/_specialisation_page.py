"""Tables and figure of the specialisation report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from _report_page import conditions_line
from _specialisation_results import HEAVY, REAL, Measured, claims, unreal
from _table import markdown
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS = {"exact": "#0072B2", "moreau": "#D55E00", "runge-kutta": "#009E73"}
PARTS = (
    "search", "forced", "slots", "segments", "exact", "free_and_joined", "rigid_contact", "compliant", "linear", "moreau", "moreau_law",
    "runge_kutta", "feedback", "observers", "energies",
)  # fmt: skip
OF = {"springs": "compliant", "level": "observers"}  # modules that are counted with another


def _name(entry: dict[str, Any]) -> str:
    return f"{entry['absorber']}, {entry['method']}" + ("" if entry["record"] == "level" else f", {entry['record']}")


def sections(measured: Measured) -> dict[str, str]:
    """Return the page's sections by the names of their markers."""
    return {
        "specialisation:summary": _summary(measured),
        "specialisation:claims": _claims(measured),
        "specialisation:scenes": _scenes(measured),
        "specialisation:code": _code(measured),
        "specialisation:pairs": _pairs(measured),
    }


def _summary(measured: Measured) -> str:
    found, broken = list(claims(measured)), [claim for claim in claims(measured) if not claim.holds]
    lines = [f"{len(found) - len(broken)} of {len(found)} claims hold. {conditions_line(measured.conditions)}"]
    lines += ["**Stopped early or a quick look: not all of the report.**"] if not measured.complete or measured.conditions.get("quick") else []
    without = unreal(measured)
    if not measured.pairs:
        return "\n".join(lines)
    saving = f"Left out without a saving of {100 * (REAL - 1):.0f} % or more: {', '.join(without)}." if without else "Every part left out saves time."
    return "\n".join([*lines, saving])


def _claims(measured: Measured) -> str:
    return markdown(("claim", "found", "holds"), [(claim.text, claim.found, "yes" if claim.holds else "NO") for claim in claims(measured)])


def _scenes(measured: Measured) -> str:
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
            _name(entry),
            f"{entry['cold_s']:.1f}",
            f"{entry['cached_s']:.2f}",
            f"{entry['ns_per_period'] / 1e3:.2f}",
            f"{entry['impacts_per_period']:.2f}",
            f"{entry['memory_mb']:.0f}",
            *(f"{kb:.0f}" for kb in entry["peak_kb"]),
        )
        for entry in measured.own.values()
    ]
    return markdown(header, rows)


def _counts(entry: dict[str, Any]) -> dict[str, int]:
    """Return the arithmetic operations in each module of the kernels."""
    counts = dict.fromkeys(PARTS, 0)
    for function in entry["functions"]:
        module = function["name"].partition(".")[0]
        part = "energies" if module.startswith("energ") else OF.get(module, module)
        if part in counts:
            counts[part] += function["arithmetic"]
    return counts


def _code(measured: Measured) -> str:
    header = ("scene, method, recorded", "machine instructions", "functions", *PARTS)
    rows = [
        (_name(entry), f"{entry['instructions']:,}", str(len(entry["functions"])), *(str(count or "") for count in _counts(entry).values()))
        for entry in measured.own.values()
    ]
    return markdown(header, rows)


def _pairs(measured: Measured) -> str:
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
        for pair in measured.pairs
    ]
    return markdown(header, rows)


def imported(measured: Measured) -> str:
    """Say what an import of the simulator loads, and which heavy packages it does not."""
    loaded = sorted({name for entry in measured.own.values() for name in entry["imported"]})
    return f"loads {', '.join(loaded)}; not {', '.join(name for name in HEAVY if name not in loaded)}"


def save_figure(path: Path, measured: Measured) -> None:
    """Draw the report; the ending of ``path`` chooses the format."""
    entries = list(measured.own.values())
    figure = Figure(figsize=(14, 4 + 0.32 * max(len(entries), len(measured.pairs))), layout="constrained")
    axes = figure.subplots(1, 3)
    _draw_compile(axes[0], entries)
    _draw_code(axes[1], entries)
    _draw_pairs(axes[2], measured.pairs)
    figure.suptitle("What each scene compiles, and what a part costs that is only switched off", fontsize=13)
    figure.savefig(path, dpi=120, format=path.suffix[1:])


def _draw_compile(ax: Axes, entries: list[dict[str, Any]]) -> None:
    y = np.arange(len(entries))[::-1]
    ax.barh(y + 0.2, [entry["cold_s"] for entry in entries], 0.38, color="#0072B2", label="cold: compiled")
    ax.barh(y - 0.2, [entry["cached_s"] for entry in entries], 0.38, color="#56B4E9", label="from the cache")
    ax.set_yticks(y, [_name(entry) for entry in entries], fontsize=8)
    ax.set(xscale="log", xlabel="first run of one pseudo period, s")
    ax.set_title("compile time", fontsize=11)
    ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)


def _draw_code(ax: Axes, entries: list[dict[str, Any]]) -> None:
    y = np.arange(len(entries))[::-1]
    left = np.zeros(len(entries))
    colours = (
        "#D55E00", "#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#AA4499", "#332288", "#882255", "#999999", "#E69F00", "#F0E442", "#44AA99", "#117733",
        "#000000", "#BBBBBB",
    )  # fmt: skip
    for part, colour in zip(PARTS, colours, strict=True):
        width = np.array([_counts(entry)[part] for entry in entries], dtype=float)
        if width.any():
            ax.barh(y, width, 0.7, left=left, color=colour, label=part.replace("_", " "))
        left += width
    ax.set_yticks(y, [""] * len(entries))
    ax.set(xlabel="arithmetic operations written in its compiled functions")
    ax.set_title("what the compiled code contains, by module", fontsize=11)
    ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4, frameon=False)


def _draw_pairs(ax: Axes, pairs: list[dict[str, Any]]) -> None:
    y = np.arange(len(pairs))[::-1]
    for pair, at in zip(pairs, y, strict=True):
        method = next(name for name in COLOURS if f", {name}" in pair["without"])
        ends = pair["without_ns"] / 1e3, pair["switched_off_ns"] / 1e3
        ax.plot(ends, (at, at), color="0.7", lw=2, zorder=1)
        ax.plot(ends[0], at, "o", color=COLOURS[method], ms=7)
        ax.plot(ends[1], at, "D", mfc="white", mec=COLOURS[method], ms=6)
        ax.annotate(f"{pair['ratio']:.2f}", (max(ends), at), xytext=(8, 0), textcoords="offset points", va="center", fontsize=8)
    ax.set_yticks(y, [pair["part"] for pair in pairs], fontsize=8)
    ax.set(xscale="log", xlabel="us per pseudo period")
    if pairs:
        highest = max(max(pair["without_ns"], pair["switched_off_ns"]) for pair in pairs) / 1e3
        ax.set_xlim(None, 3 * highest)
    ax.plot([], [], "o", color="0.3", label="without the part")
    ax.plot([], [], "D", mfc="white", mec="0.3", label="with it, switched off by its value (records: on)")
    ax.set_title("cost of a part that does nothing", fontsize=11)
    ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=1, frameon=False)
