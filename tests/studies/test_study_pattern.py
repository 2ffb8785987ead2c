"""The pattern of all studies: files, page, exit codes, and what is left of a run that is stopped, breaks down or is gone on with."""

import csv
import gzip
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from impact_env import Beam, IntegrationError, modal_model
from optimisation.files import read_json
from optimisation.machine import sources
from optimisation.page import has_markers
from studies import runner
from studies.study import Part, Place, Study, Table, left, rows_by_case

PAGE = "by hand\n<!-- omega -->\nold\n<!-- /omega -->\nalso by hand\n<!-- shape -->\nold\n<!-- /shape -->\n"
Event = Callable[[], object]


@dataclass(frozen=True)
class Settings:
    """Numbers of elements; what happens before that of one of them is measured; the word that a run must share with one that it goes on from."""

    elements: tuple[int, ...] = (2, 3, 5)
    events: tuple[tuple[int, Event], ...] = ()
    word: str = "same"


def measured_rows(name: str, elements: int, settings: Settings) -> list[dict[str, Any]]:
    dict(settings.events).get(elements, lambda: None)()
    model = modal_model(Beam(elements=elements, modes=2))
    values = model.omega if name == "omega" else model.tip_shape
    return [{"elements": elements, "mode": k + 1, name: float(value)} for k, value in enumerate(values)]


def part(name: str) -> Part[Settings]:
    def cases(settings: Settings) -> dict[int, Any]:
        return {n: partial(measured_rows, name, n, settings) for n in settings.elements}

    def key(row: dict[str, Any]) -> int:
        return int(row["elements"])

    def save(path: Path, rows: list[dict[str, Any]]) -> None:
        path.write_text(str(len(rows)))

    return Part(
        name,
        f"the {name}s of a beam",
        measure=lambda settings, known: rows_by_case(cases(settings), key, known),
        markers=(name,),
        sections=lambda measured: {name: f"{len(measured.values['rows'])} rows. {sources(measured.conditions)}"},
        steps=lambda settings, known: len(left(cases(settings), key, known)),
        tables=lambda measured: [Table(name, ("elements", name), [[row["elements"], row[name]] for row in measured.values["rows"]])],
        figures=lambda measured: {name: partial(save, rows=measured.values["rows"]), f"{name}.html": partial(save, rows=measured.values["rows"][:1])},
        failures=lambda measured: [str(row) for row in measured.values["rows"] if row[name] > 1e5],
    )


STUDY: Study[Settings] = Study(
    (part("omega"), part("shape")), notes=lambda settings: {"word": settings.word}, same=("versions", "word"), kept="what is done is written."
)


@pytest.fixture
def place(tmp_path: Path) -> Place:
    (tmp_path / "template.md").write_text(PAGE)
    return Place(tmp_path / "data", tmp_path / "page.md", tmp_path / "template.md")


def carry_out(settings: Settings, place: Place, study: Study[Settings] = STUDY, **options: Any) -> Result:
    @click.command()
    def main() -> None:
        runner.run(study, settings, place, **options)

    return CliRunner().invoke(main, [])


def content(place: Place, name: str) -> dict[str, Any]:
    assert place.folder is not None
    return dict(read_json(place.folder / f"{name}.json.gz"))


def stop() -> None:
    raise KeyboardInterrupt


def break_down() -> None:
    raise IntegrationError("lost at 3 elements")


def forbidden() -> None:
    pytest.fail("measured")


def test_a_run_writes_numbers_tables_figures_and_page(place: Place) -> None:
    result = carry_out(Settings(), place)
    assert result.exit_code == 0, result.output
    assert {file.name for file in place.folder.iterdir()} == {
        f"{name}.{kind}" for name in ("omega", "shape") for kind in ("json.gz", "csv", "png", "html")
    }
    values = content(place, "omega")
    assert values["complete"] is True
    assert values["conditions"]["word"] == "same"
    assert values["conditions"]["wall_s"] >= 0
    assert [row["elements"] for row in values["rows"]] == [2, 2, 3, 3, 5, 5]
    with (place.folder / "omega.csv").open(newline="") as file:
        assert [float(row["omega"]) for row in csv.DictReader(file)] == [row["omega"] for row in values["rows"]]
    assert (place.folder / "shape.png").read_text() == "6"
    assert (place.folder / "shape.html").read_text() == "1"
    text = place.page.read_text()
    assert text.count("6 rows. Measured on ") == 2
    assert text.startswith("by hand\n<!-- omega -->\n6 rows.")
    assert "old" not in text
    assert f"kernels {values['conditions']['versions']['kernels']}." in text
    assert f"written: {place.folder / 'omega.json.gz'}" in result.output


def test_drawing_anew_measures_nothing(place: Place) -> None:
    assert carry_out(Settings(), place).exit_code == 0
    before = {file: file.read_bytes() for file in place.folder.iterdir()} | {place.page: place.page.read_bytes()}
    for file in before:
        if file.suffix != ".gz":
            file.unlink()
    never = Settings(events=tuple((n, forbidden) for n in (2, 3, 5)))
    assert carry_out(never, place, redraw=True).exit_code == 0
    assert {file: file.read_bytes() for file in before} == before
    (place.folder / "omega.json.gz").unlink()
    assert carry_out(never, place, redraw=True).exit_code == 0  # what there is
    named = carry_out(never, place, redraw=True, only=("omega",))
    assert named.exit_code == 2
    assert "omega.json.gz" in named.output
    whole = before[place.folder / "shape.json.gz"]
    for wrong in (*map(gzip.compress, (b"{", b"[]", b"{}", b'{"conditions": 3, "complete": true}')), b"{}", whole[:-20], whole[:30] + whole[40:]):
        (place.folder / "shape.json.gz").write_bytes(wrong)
        refused = carry_out(never, place, redraw=True)
        assert refused.exit_code == 2, wrong
        assert "--redraw" in refused.output
    (place.folder / "shape.json.gz").unlink()
    assert "omega, shape" in carry_out(never, place, redraw=True).output


def test_what_is_stopped_is_kept_and_gone_on_with(place: Place) -> None:
    result = carry_out(Settings(events=((5, stop),)), place)
    assert result.exit_code == 130
    assert "Stopped early: what is done is written." in result.stderr
    values = content(place, "omega")
    assert [row["elements"] for row in values["rows"]] == [2, 2, 3, 3]
    assert values["complete"] is False
    assert "4 rows." in place.page.read_text()
    again = carry_out(Settings(events=((2, forbidden), (3, forbidden))), place, only=("omega",), resume=True)
    assert again.exit_code == 0, again.output
    assert content(place, "omega")["complete"] is True
    assert [row["elements"] for row in content(place, "omega")["rows"]] == [2, 2, 3, 3, 5, 5]
    whole = content(place, "omega")
    assert carry_out(Settings(events=((5, forbidden),)), place, only=("omega",), resume=True).exit_code == 0
    assert content(place, "omega") == whole


def test_a_run_goes_on_only_from_one_like_it(place: Place) -> None:
    assert carry_out(Settings(events=((3, stop),)), place, only=("omega",)).exit_code == 130
    before = content(place, "omega")
    refused = carry_out(Settings(word="other", events=((3, forbidden),)), place, only=("omega",), resume=True)
    assert refused.exit_code == 2
    assert "--resume" in refused.output
    assert "word" in refused.output
    assert content(place, "omega") == before


def test_nothing_is_written_where_nothing_is_known(place: Place) -> None:
    for event, code, words in ((stop, 130, "Stopped early"), (break_down, 1, "lost at 3 elements")):
        result = carry_out(Settings(events=((2, event),)), place)
        assert result.exit_code == code
        assert words in result.stderr
    assert list(place.folder.iterdir()) == []
    assert not place.page.exists()


def test_a_run_that_breaks_down_keeps_what_there_is(place: Place) -> None:
    result = carry_out(Settings(events=((3, break_down),)), place)
    assert result.exit_code == 1
    assert "omega is not complete: lost at 3 elements" in result.stderr
    assert content(place, "omega")["conditions"]["failure"] == "lost at 3 elements"
    assert [row["elements"] for row in content(place, "omega")["rows"]] == [2, 2]


def test_long_runs_are_written_on_the_way(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "KEEP_S", -1.0)
    seen = []
    assert carry_out(Settings(events=((5, lambda: seen.append(content(place, "omega"))),)), place, only=("omega",)).exit_code == 0
    assert [row["elements"] for row in seen[0]["rows"]] == [2, 2, 3, 3]
    assert seen[0]["complete"] is False
    assert content(place, "omega")["complete"] is True


def test_a_page_without_a_place_is_refused_before_anything_is_measured(place: Place) -> None:
    never = Settings(events=((2, forbidden),))
    for text in ("no marker", PAGE.replace("<!-- /shape -->", ""), PAGE + PAGE, PAGE.replace("<!-- shape", "<!-- /shape", 1)):
        place.template.write_text(text)
        result = carry_out(never, place)
        assert result.exit_code == 2
        assert "one pair of markers" in result.output
    assert not has_markers("<!-- /a --> <!-- a -->", "a")


def test_numbers_and_table_alone(tmp_path: Path) -> None:
    """As commands of one table do: JSON to a file, the table into a page that is there."""
    (tmp_path / "page.md").write_text(PAGE)
    place = Place(json=tmp_path / "numbers.json", page=tmp_path / "page.md")
    assert carry_out(Settings(), place, only=("shape",)).exit_code == 0
    assert json.loads((tmp_path / "numbers.json").read_text())["complete"] is True
    assert {file.name for file in tmp_path.iterdir()} == {"numbers.json", "page.md"}
    assert "6 rows." in (tmp_path / "page.md").read_text()
