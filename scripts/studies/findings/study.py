"""The study of what the workbench finds on the paper's beam: its parts, its files and its page."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import PAPER_RATE
from impact_env.ensemble import Executor
from optimisation.conditions import QUICK_MEMBERS, QUICK_SPEED
from optimisation.machine import sources
from optimisation.memory import peak_memory
from optimisation.page import published
from studies.findings import parts
from studies.findings.page import PARTS, sections
from studies.findings.parts import Settings
from studies.study import Json, Measured, Part, Place, Saver, Steps, Study, beside

NAME = "findings"
QUICK_OUT = Path("results/findings")
OUT = published(Path("docs"), QUICK_OUT)
JOURNALS = Path("results/findings/journals")
DESIGNS, FEW, POINTS = 160, 4, 13  # odd: the study's own force is one of the points
QUICK_DESIGNS, QUICK_POINTS = 20, 6


def place(out: Path) -> Place:
    """Return where files go: the page into a folder, all else into its folder findings."""
    return beside(out, NAME, out / NAME)


def settings(quick: bool, executor: Executor, seed: int, out: Path) -> Settings:
    """Return how much to search, with journals by which the same command goes on where it was stopped."""
    journals, data = JOURNALS / ("quick" if quick else "full") / str(seed), out / NAME
    if quick:
        return Settings(
            executor, journals, QUICK_DESIGNS, QUICK_MEMBERS, QUICK_MEMBERS, QUICK_POINTS, data, QUICK_SPEED * PAPER_RATE, seed, quick=True
        )
    return Settings(executor, journals, DESIGNS, DEFAULT_MEMBERS, FEW, POINTS, data, PAPER_RATE, seed)


def _compute(name: str, given: Settings) -> Json:
    if name in ("front", "scaling", "full"):
        from studies.findings import measured  # distributed is slow to import

        about_searches: dict[str, Callable[[Settings], Json]] = {
            "front": measured.front, "scaling": measured.scaling, "full": measured.full_study,
        }  # fmt: skip
        return about_searches[name](given)
    functions: dict[str, Callable[[Settings], Json]] = {
        "concepts": parts.concepts, "optima": parts.optima, "place": parts.place, "robustness": parts.robustness,
    }  # fmt: skip
    return functions[name](given)


def _measure(given: Settings, _known: Json, name: str) -> Steps:
    yield _compute(name, given)


def _figures(measured: Measured, name: str) -> dict[str, Saver]:
    from studies.findings.figures import FIGURES  # matplotlib is slow to import

    return {name: lambda path: FIGURES[name](path, measured.values)} if name in FIGURES else {}


def _part(name: str, title: str) -> Part[Settings]:
    marker = f"{NAME}:{name}"
    return Part(
        name,
        title,
        measure=partial(_measure, name=name),
        markers=(marker,),
        sections=lambda measured: {marker: f"{sections(name, measured.values)}\n\n{sources(measured.conditions)}"},
        figures=partial(_figures, name=name),
    )


def pack(_name: str, measured: Measured) -> Json:
    """Return what PART.json.gz holds."""
    return {"conditions": measured.conditions, "result": measured.values}


def unpack(_name: str, content: Json) -> Measured:
    """Return what `pack` has packed; raises KeyError if it was another."""
    return Measured(dict(content["result"]), dict(content["conditions"]))


STUDY: Study[Settings] = Study(
    tuple(_part(name, f"{name}: {title}") for name, title in PARTS.items()),
    notes=lambda given: {"memory_bytes": peak_memory(), "quick": given.quick, "seed": given.seed},
    pack=pack,
    unpack=unpack,
    kept="finished parts are written; the same command goes on from here.",
)
