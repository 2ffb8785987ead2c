"""The study of what each scene leaves out: its files and its exit code."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from optimisation.studies.page import published
from optimisation.studies.specialisation.page import MARKERS, said, sections
from optimisation.studies.specialisation.results import Results, claims, left, measure
from optimisation.studies.study import Json, Measured, Part, Saver, Study, Table, unpack

NAME = "specialisation"
QUICK_OUT = Path("results/specialisation")
OUT = published(Path("docs"), QUICK_OUT)
COLUMNS = (
    "absorber", "method", "record", "cold_s", "cached_s", "ns_per_period", "impacts_per_period", "memory_mb", "import_s", "instructions",
)  # fmt: skip


def _steps(quick: bool, known: Json) -> int:
    variants, pairs = left(quick, known)
    return 2 * len(variants) + len(pairs)


def _tables(measured: Measured) -> list[Table]:
    return [Table(NAME, COLUMNS, [[entry[name] for name in COLUMNS] for entry in measured.values["own"].values()])]


def _figures(measured: Measured) -> dict[str, Saver]:
    from optimisation.studies.specialisation.figure import save_figure  # matplotlib is slow to import

    return {NAME: partial(save_figure, results=Results(**measured.values))}


def _failures(measured: Measured) -> list[str]:
    return [claim.text for claim in claims(Results(**measured.values)) if not claim.holds]


def _unpack(name: str, content: Json) -> Measured:
    measured = unpack(name, content)
    return Measured(vars(Results(**measured.values)), measured.conditions, measured.complete)


# settings: whether it is a quick look
STUDY: Study[bool] = Study(
    (
        Part(
            NAME,
            "what each scene leaves out",
            measure=measure,
            markers=MARKERS,
            sections=sections,
            steps=_steps,
            tables=_tables,
            figures=_figures,
            said=said,
            failures=_failures,
        ),
    ),
    notes=lambda quick: {"quick": quick},
    unpack=_unpack,
)
