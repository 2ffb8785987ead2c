"""The study of what each scene leaves out: its files and its exit code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from optimisation.page import published
from studies.one_part import one_part
from studies.specialisation.page import MARKERS, said, sections
from studies.specialisation.results import Results, claims, left, measure
from studies.study import Json, Study

NAME = "specialisation"
QUICK_OUT = Path("results/specialisation")
OUT = published(Path("docs/internals"), QUICK_OUT)
COLUMNS = (
    "absorber", "method", "record", "cold_s", "cached_s", "ns_per_period", "impacts_per_period", "memory_mb", "instructions",
)  # fmt: skip


def _steps(quick: bool, known: Json) -> int:
    variants, pairs = left(quick, known)
    return 2 * len(variants) + len(pairs)


def _figure() -> Callable[[Path, Results], None]:
    from studies.specialisation.figure import save_figure  # matplotlib is slow to import

    return save_figure


# settings: whether it is a quick look
STUDY: Study[bool] = one_part(
    NAME,
    "what each scene leaves out",
    Results,
    measure=measure,
    steps=_steps,
    markers=MARKERS,
    sections=sections,
    said=said,
    columns=COLUMNS,
    rows=lambda results: list(results.own.values()),
    figure=_figure,
    failures=lambda results: [claim.text for claim in claims(results) if not claim.holds],
    notes=lambda quick: {"quick": quick},
)
