"""Published pages and tables are those that today's code writes of the published numbers.

Nothing is measured here.
"""

import csv
import io
import re
from pathlib import Path
from typing import Any

import pytest
from places import ROOT

from optimisation.files import read_json
from studies.cli import (
    check_calibration,
    check_plan,
    compare_chain,
    compare_inference,
    compare_training,
    constrain_training,
    error_vs_runtime,
    findings,
    friction_branches,
    load_answers,
    memory_trial,
    real_controller,
    regimes,
    search_methods,
    specialisation,
    stability,
    which_blades,
)
from studies.paper import study as paper
from studies.study import Measurement, OutputPaths, Part, Study, read_measurement

DOCS = ROOT / "docs"
# studies that publish their numbers: the page, and the folder or the file of the numbers
PUBLISHED: tuple[tuple[Study[Any], str, str], ...] = (
    (paper.STUDY, "paper.md", "paper"),
    (check_calibration.STUDY, "calibrate.md", "calibrate"),
    (check_plan.STUDY, "calibrate.md", "calibrate"),
    (compare_inference.STUDY, "calibrate.md", "calibrate"),
    (compare_chain.STUDY, "many_absorbers.md", "many_absorbers"),
    (which_blades.STUDY, "which_blades.md", "which_blades"),
    (error_vs_runtime.STUDY, "methods.md", "methods"),
    (stability.STUDY, "methods.md", "methods"),
    (findings.STUDY, "findings.md", "findings"),
    (friction_branches.STUDY, "findings.md", "findings/friction_branches.json"),
    (load_answers.STUDY, "load_findings.md", "."),
    (compare_training.STUDY, "tasks.md", "tasks"),
    (constrain_training.STUDY, "tasks.md", "tasks"),
    (memory_trial.STUDY, "real_controller.md", "real_controller"),
    (real_controller.STUDY, "real_controller.md", "real_controller"),
    (regimes.STUDY, "regimes.md", "regimes"),
    (search_methods.STUDY, "search_methods.md", "."),
    (specialisation.STUDY, "internals/specialisation.md", "internals"),
)


def published() -> list[Any]:
    """Return each part with published numbers, its page and the place of its numbers."""
    return [
        pytest.param(part, DOCS / page, place_of(DOCS / name), id=part.name)
        for study, page, name in PUBLISHED
        for part in study.parts
    ]


def place_of(path: Path) -> OutputPaths:
    """Return the place of a folder of numbers, or of one JSON file."""
    return OutputPaths(json=path) if path.suffix == ".json" else OutputPaths(path)


def section(page: Path, marker: str) -> str:
    """Return the text of a page between the markers of a name."""
    text = page.read_text(encoding="utf-8")
    match = re.search(
        f"<!-- {re.escape(marker)} -->\n(.*?)<!-- /{re.escape(marker)} -->", text, re.S
    )
    assert match, f"{page.name} has no markers {marker}"
    return match[1].strip()


def rows_of(columns: Any, rows: Any) -> list[list[str]]:
    """Return a table as a CSV file has it."""
    file = io.StringIO()
    csv.writer(file).writerows([columns, *rows])
    return list(csv.reader(io.StringIO(file.getvalue())))


@pytest.mark.parametrize(("part", "page", "place"), published())
def test_pages_have_what_their_numbers_give(
    part: Part[Any], page: Path, place: OutputPaths
) -> None:
    measured: Measurement = read_measurement(part, place)
    for marker, text in part.sections(measured).items():
        assert section(page, marker) == text.strip(), marker
    for table in part.tables(measured):
        assert place.folder is not None
        with (place.folder / f"{table.name}.csv").open(newline="", encoding="utf-8") as file:
            assert list(csv.reader(file)) == rows_of(table.columns, table.rows), table.name


def test_claims_are_those_that_the_published_figures_decide() -> None:
    published = read_json(DOCS / "paper" / "claims.json.gz")
    place = OutputPaths(DOCS / "paper")
    claims = list[dict[str, Any]]()
    answers = dict[str, str]()
    for figure, part in zip(paper.FIGURES, paper.STUDY.parts, strict=True):
        values = read_measurement(part, place).values
        claims += [claim.to_plain() for claim in figure.claims(values)]
        if figure.answer:
            answers[figure.label] = figure.answer(values)
    assert claims == published["claims"]
    assert answers == published["answers"]
    assert published["missing"] == []
    part = paper.CLAIMS.parts[0]
    test_pages_have_what_their_numbers_give(part, DOCS / "paper.md", place)
