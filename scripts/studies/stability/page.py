"""Tables and text of the stability report's page."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from optimisation.machine import sources
from optimisation.report.markdown import markdown
from studies.stability.cells import FAILED, GOOD, REFUSED, WEAK
from studies.stability.tasks import Results
from studies.study import Measured

CELL_COLUMNS = (
    "group", "case", "method", "verdict", "reason", "balance", "identity", "drift", "penetration", "deviation", "finer", "followed", "impacts",
    "wall_s", "memory_mb",
)  # fmt: skip
LONGEST_REASON = 150
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


MARKERS = tuple(f"stability:{name}" for name in ("summary", "matrix", "remarks", "limits", "stiffness", "eigenproblem", "soak", "checks"))


def sections(measured: Measured) -> dict[str, str]:
    """Return the page's sections by the names of their `MARKERS`."""
    results = Results(**measured.values)
    return {
        "stability:summary": _summary(results, measured),
        "stability:matrix": _matrix(results.cells),
        "stability:remarks": _remarks(results.cells),
        "stability:limits": _limits(results.limits),
        "stability:stiffness": _stiffness(results.cells),
        "stability:eigenproblem": _eigen(results.eigen),
        "stability:soak": _soaks(results.soaks),
        "stability:checks": _checks(results.checks),
    }


def said(measured: Measured) -> str:
    """Return what the command prints: the matrix, and all that failed."""
    failures = list(Results(**measured.values).failures())
    return "\n".join([sections(measured)["stability:matrix"], *(f"FAILED  {line}" for line in failures), f"\n{len(failures)} failures"])


def _number(value: float | None) -> str:
    return "" if value is None else "0" if value == 0 else f"{value:.1e}"


def _worst(cells: Sequence[dict[str, Any]], name: str) -> str:
    return _number(max((cell[name] for cell in cells if cell[name] is not None), default=None))


def _summary(results: Results, measured: Measured) -> str:
    counts = Counter(cell["verdict"] for cell in results.cells)
    failures = list(results.failures())
    parts = ", ".join(
        f"{counts[verdict]} {text}" for verdict, text in ((GOOD, "good"), (WEAK, "with fewer digits"), (REFUSED, "refused with an error"))
    )
    lines = [f"{len(results.cells)} cells: {parts}, {counts[FAILED]} failed. {sources(measured.conditions)}"]
    made = measured.conditions
    lines.append(f"Wall time {made.get('wall_s', 0):.0f} s on {made.get('workers', '?')} processes, compiling included.")
    if not measured.complete:
        lines.append("**Stopped early or a quick look: not all of the report.**")
    if failures:
        lines += ["", "Failures:", "", *(f"- {line}" for line in failures)]
    return "\n".join(lines)


def _matrix(cells: Sequence[dict[str, Any]]) -> str:
    header = ("group and method", "cells", GOOD, WEAK, REFUSED, FAILED, "worst balance", "penetration", "from reference", "finer step", "slowest, s")
    rows = []
    for group in dict.fromkeys(cell["group"] for cell in cells):
        for method in dict.fromkeys(cell["method"] for cell in cells):
            some = [cell for cell in cells if cell["group"] == group and cell["method"] == method]
            if not some:
                continue
            counts = Counter(cell["verdict"] for cell in some)
            slowest = max((cell["wall_s"] for cell in some if cell["wall_s"] is not None), default=None)
            numbers = [str(counts[verdict] or "") for verdict in (GOOD, WEAK, REFUSED, FAILED)]
            measures = [_worst(some, name) for name in ("balance", "penetration", "deviation", "finer")]
            rows.append((f"{group}, {method}", str(len(some)), *numbers, *measures, "" if slowest is None else f"{slowest:.3f}"))
    return markdown(header, rows)


def _remarks(cells: Sequence[dict[str, Any]]) -> str:
    """Return a line for each reason, numbers in it aside: the first case that has it, and how many cells have."""
    rows = []
    for verdict in (FAILED, WEAK, REFUSED):
        alike: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for cell in cells:
            if cell["verdict"] == verdict:
                same = cell["group"] if verdict == REFUSED else cell["case"]  # digits that are lost are told case by case
                alike.setdefault((same, NUMBER.sub("", cell["reason"]) if verdict == REFUSED else cell["reason"]), []).append(cell)
        for some in alike.values():
            first = some[0]
            reason = first["reason"].replace("|", "/").replace("\n", " ")
            short = reason if len(reason) <= LONGEST_REASON else reason[: LONGEST_REASON - 3] + "..."
            methods = ", ".join(dict.fromkeys(cell["method"] for cell in some))
            rows.append((f"{first['group']}: {first['case']}", str(len(some)), methods, verdict, short))
    return markdown(("first case", "cells", "methods", "verdict", "reason of the first"), rows) if rows else "None."


def _limits(limits: Sequence[dict[str, Any]]) -> str:
    header = ("method and scene", "D", "omega dt, theory", "omega dt, found", "difference", "paper's step / limit")
    rows = [
        (
            f"{x['method']}, {x['what']}",
            f"{x['damping_ratio']:g}",
            f"{x['theory_s'] * x['omega']:.5f}",
            f"{x['found_s'] * x['omega']:.5f}",
            f"{x['found_s'] / x['theory_s'] - 1:+.1e}",
            f"{x['paper_s'] / x['theory_s']:.3f}",
        )
        for x in limits
    ]
    return markdown(header, rows)


def _stiffness(cells: Sequence[dict[str, Any]]) -> str:
    some = [cell for cell in cells if cell["group"] == "contact stiffness" and cell["case"].startswith("1e")]
    header = ("contact", "exact: balance", "from reference", "s", "Runge-Kutta: balance", "from reference ", "finer step", "s ")
    rows = []
    for case in dict.fromkeys(cell["case"] for cell in some):
        by: dict[str, dict[str, Any]] = {cell["method"]: cell for cell in some if cell["case"] == case}
        get: Callable[[str, str], Any] = lambda method, name, by=by: by.get(method, {}).get(name)  # type: ignore[misc]  # noqa: E731
        exact = (_number(get("exact", "balance")), _number(get("exact", "deviation")), _number(get("exact", "wall_s")))
        steps = tuple(_number(get("runge-kutta", name)) for name in ("balance", "deviation", "finer", "wall_s"))
        rows.append((case, *exact, *steps))
    return markdown(header, rows)


def _eigen(entries: Sequence[dict[str, Any]]) -> str:
    header = ("elements", "rounding, mode 1", "mode 2", "mode 10", "highest", "elements' error, mode 1", "mode 2 ", "mode 10 ", "tip of mode 1")
    rows = []
    for x in entries:
        rounding, other = ([_number(x[name].get(mode)) for mode in ("1", "2", "10")] for name in ("rounding", "discretisation"))
        rows.append((str(x["elements"]), *rounding, _number(x["highest"]), *other, _number(x["tip"])))
    return markdown(header, rows)


def _soaks(soaks: Sequence[dict[str, Any]]) -> str:
    header = ("run", "pseudo periods", "balance", "memory, MB", "us per period", "impacts per period", "passed")
    rows = [
        (
            x["name"] if k == 0 else "",
            f"{length:,}",
            _number(x["balance"][k]),
            f"{x['memory_mb'][k]:.1f}",
            f"{x['us_per_period'][k]:.2f}",
            f"{x['impacts_per_period'][k]:.2f}",
            ("yes" if x["passed"] else "NO") if k == len(x["lengths"]) - 1 else "",
        )
        for x in soaks
        for k, length in enumerate(x["lengths"])
    ]
    return markdown(header, rows)


def _checks(checks: Sequence[dict[str, Any]]) -> str:
    if not checks:
        return "Not measured yet."
    rows = [(x["name"], f"{x['searches']:,}", f"{x['misses']:,}", _number(x["worst"]), x["first"]) for x in checks]
    total = ("all", f"{sum(x['searches'] for x in checks):,}", f"{sum(x['misses'] for x in checks):,}", _worst(checks, "worst"), "")
    return markdown(("scene", "searches", "misses", "worst", "first miss"), [*rows, total])
