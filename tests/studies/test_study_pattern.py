"""All studies have the same files, page and exit codes.

The results of a run that is stopped, fails or is continued are tested.
"""

import csv
import gzip
import json
import operator
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import pytest
from click.testing import CliRunner, Result

import impact_env
from impact_env import Beam, IntegrationError, modal_model
from optimisation.checkpoint import sources
from optimisation.files import has_markers, read_json
from studies import study as pattern
from studies.study import CsvTable, OutputPaths, Part, Study, make_rows_part

PAGE = (
    "by hand\n<!-- omega -->\nold\n<!-- /omega -->\nalso by hand\n<!-- shape -->\nold\n<!-- "
    "/shape -->\n"
)
ELEMENTS = (2, 3, 5)
OMEGA = {"only": ("omega",)}


class Settings(NamedTuple):
    """Settings of a test study.

    ``events`` are called before the given number of elements is measured. ``word`` must be the same
    in a run and in the earlier one that it continues.
    """

    events: dict[int, Callable[[], object]] = {}  # noqa: RUF012
    word: str = "same"


def measured_rows(name: str, elements: int, settings: Settings) -> list[dict[str, Any]]:
    settings.events.get(elements, lambda: None)()
    model = modal_model(Beam(elements=elements, modes=2))
    values = model.omega if name == "omega" else model.tip_shape
    return [
        {"elements": elements, "mode": k + 1, name: float(value)} for k, value in enumerate(values)
    ]


def part(name: str, with_message: bool = False) -> Part[Settings]:
    def cases(settings: Settings) -> dict[int, Any]:
        return {n: partial(measured_rows, name, n, settings) for n in ELEMENTS}

    def save(path: Path, rows: list[dict[str, Any]]) -> None:
        path.write_text(str(len(rows)))

    return make_rows_part(
        name,
        f"the {name}s of a beam",
        cases,
        operator.itemgetter("elements"),
        lambda measured: f"{len(measured.values['rows'])} rows. {sources(measured.conditions)}",
        key_values=lambda settings: {"word": settings.word} if with_message else {},
        tables=lambda measured: [
            CsvTable(
                name,
                ("elements", name),
                [[row["elements"], row[name]] for row in measured.values["rows"]],
            )
        ],
        figures=lambda measured: {
            name: partial(save, rows=measured.values["rows"]),
            f"{name}.html": partial(save, rows=measured.values["rows"][:1]),
        },
    )


STUDY: Study[Settings] = Study(
    (part("omega"), part("shape")),
    notes=lambda settings: {"word": settings.word},
    same=("versions", "word"),
    stopped_message="what is done is written.",
)


@pytest.fixture
def place(tmp_path: Path) -> OutputPaths:
    (tmp_path / "template.md").write_text(PAGE)
    return OutputPaths(tmp_path / "data", tmp_path / "page.md", tmp_path / "template.md")


def carry_out(
    place: OutputPaths,
    events: dict[int, Any] | None = None,
    word: str = "same",
    code: int = 0,
    **options: Any,
) -> Result:
    @click.command()
    def main() -> None:
        pattern.run(STUDY, Settings(events or {}, word), place, **options)

    result = CliRunner().invoke(main, [])
    assert result.exit_code == code, result.output
    return result


def content(place: OutputPaths) -> dict[str, Any]:
    return dict(read_json(place.folder / "omega.json.gz"))


def measured(place: OutputPaths) -> list[int]:
    return [row["elements"] for row in content(place)["rows"]]


def stop() -> None:
    raise KeyboardInterrupt


def break_down() -> None:
    raise IntegrationError("lost at 3 elements")


def forbidden() -> None:
    pytest.fail("measured")


def test_a_run_writes_numbers_tables_figures_and_page(place: OutputPaths) -> None:
    result = carry_out(place)
    assert {file.name for file in place.folder.iterdir()} == {
        f"{name}.{end}" for name in ("omega", "shape") for end in ("json.gz", "csv", "png", "html")
    }
    values = content(place)
    assert values["complete"] is True
    assert values["conditions"]["word"] == "same"
    assert measured(place) == [2, 2, 3, 3, 5, 5]
    with (place.folder / "omega.csv").open(newline="") as file:
        assert [float(row["omega"]) for row in csv.DictReader(file)] == [
            row["omega"] for row in values["rows"]
        ]
    assert [(place.folder / f"shape.{end}").read_text() for end in ("png", "html")] == ["6", "1"]
    text = place.page.read_text()
    assert text.count("6 rows. Measured on ") == 2
    assert text.startswith("by hand\n<!-- omega -->\n6 rows.")
    assert "old" not in text
    assert f", version {impact_env.__version__}, " in text
    assert values["conditions"]["versions"]["kernels"] not in text
    assert f"written: {place.folder / 'omega.json.gz'}" in result.output


def test_redrawing_measures_nothing(place: OutputPaths) -> None:
    carry_out(place)
    before = {file: file.read_bytes() for file in place.folder.iterdir()} | {
        place.page: place.page.read_bytes()
    }
    for file in before:
        if file.suffix != ".gz":
            file.unlink()
    again = partial(carry_out, place, dict.fromkeys(ELEMENTS, forbidden), redraw=True)
    again()
    assert {file: file.read_bytes() for file in before} == before
    (place.folder / "omega.json.gz").unlink()
    again()  # what there is
    assert "omega.json.gz" in again(code=2, **OMEGA).output
    whole = before[place.folder / "shape.json.gz"]
    for wrong in (
        *map(gzip.compress, (b"{", b"[]", b"{}", b'{"conditions": 3, "complete": true}')),
        b"{}",
        whole[:-20],
        whole[:30] + whole[40:],
    ):
        (place.folder / "shape.json.gz").write_bytes(wrong)
        assert "--redraw" in again(code=2).output
    (place.folder / "shape.json.gz").unlink()
    assert "omega, shape" in again(code=2).output


def test_a_stopped_study_is_saved_and_continued(
    place: OutputPaths, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "Stopped early: what is done is written." in carry_out(place, {5: stop}, code=130).stderr
    assert measured(place) == [2, 2, 3, 3]
    assert content(place)["complete"] is False
    assert "4 rows." in place.page.read_text()
    refused = carry_out(place, {5: forbidden}, "other", code=2, resume=True, **OMEGA).output
    assert "--resume" in refused
    assert "word" in refused
    carry_out(place, {2: forbidden, 3: forbidden}, resume=True, **OMEGA)
    whole = content(place)
    assert whole["complete"] is True
    assert measured(place) == [2, 2, 3, 3, 5, 5]
    carry_out(place, {5: forbidden}, resume=True, **OMEGA)
    assert content(place) == whole
    monkeypatch.setattr(pattern, "WRITE_INTERVAL_S", -1.0)  # long runs are written on the way
    received: list[dict[str, Any]] = []
    carry_out(place, {5: lambda: received.append(content(place))}, **OMEGA)
    assert (received[0]["complete"], len(received[0]["rows"])) == (False, 4)


def test_rows_continue_while_their_description_is_the_same(
    place: OutputPaths, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "STUDY", Study((part("omega", with_message=True),)))
    carry_out(place, {5: stop}, code=130)
    carry_out(place, {2: forbidden, 3: forbidden})
    carry_out(place, dict.fromkeys(ELEMENTS, forbidden))
    carry_out(place, {3: stop}, "other", code=130)
    assert measured(place) == [2, 2]


def test_a_failing_run_saves_finished_parts(place: OutputPaths) -> None:
    for event, code, words in ((stop, 130, "Stopped early"), (break_down, 1, "lost at 3 elements")):
        assert words in carry_out(place, {2: event}, code=code).stderr
    assert list(place.folder.iterdir()) == []  # nothing is known
    assert not place.page.exists()
    assert (
        "omega is not complete: lost at 3 elements"
        in carry_out(place, {3: break_down}, code=1).stderr
    )
    assert content(place)["conditions"]["failure"] == "lost at 3 elements"
    assert measured(place) == [2, 2]


def test_a_page_without_a_place_is_refused_before_anything_is_measured(place: OutputPaths) -> None:
    for text in (
        "no marker",
        PAGE.replace("<!-- /shape -->", ""),
        PAGE + PAGE,
        PAGE.replace("<!-- shape", "<!-- /shape", 1),
    ):
        place.template.write_text(text)
        assert "one pair of markers" in carry_out(place, {2: forbidden}, code=2).output
    assert not has_markers("<!-- /a --> <!-- a -->", "a")


def test_numbers_and_table_alone(tmp_path: Path) -> None:
    """As commands of one table do: JSON to a file, the table into a page that is there."""
    (tmp_path / "page.md").write_text(PAGE)
    carry_out(
        OutputPaths(json=tmp_path / "numbers.json", page=tmp_path / "page.md"), only=("shape",)
    )
    assert json.loads((tmp_path / "numbers.json").read_text())["complete"] is True
    assert {file.name for file in tmp_path.iterdir()} == {"numbers.json", "page.md"}
    assert "6 rows." in (tmp_path / "page.md").read_text()


def test_a_run_of_some_cases_keeps_the_rows_of_the_others() -> None:
    earlier = {"rows": [{"case": name, "n": n} for name in "ab" for n in (0, 1)]}
    cases = {name: (lambda name=name: [{"case": name, "n": 0}]) for name in "dcb"}
    *_, last = pattern.measure_rows_by_case(cases, operator.itemgetter("case"), earlier)
    assert [row["case"] for row in last["rows"]] == ["a", "a", "d", "c", "b", "b"]
