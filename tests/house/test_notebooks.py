"""Notebooks are committed as executed, small, and run to their end with what they showed."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from places import ROOT, SCRIPTS

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
MOST_BYTES = 150_000


def cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def words(notebook: Any) -> list[str]:
    """Return what each cell says, with one sign for each number, and which kinds of pictures it shows."""
    said = []
    for cell in cells(notebook):
        text = "".join("".join(output.get("text", "")) for output in cell["outputs"])
        kinds = [sorted(output.get("data", {})) for output in cell["outputs"] if output["output_type"] != "stream"]
        said.append(f"{re.sub(r'-?[0-9][0-9.e-]*', '#', text)} {kinds}")
    return said


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_is_executed_whole_and_small(file: Path) -> None:
    notebook = json.loads(file.read_text(encoding="utf-8"))
    assert [cell["execution_count"] for cell in cells(notebook)] == list(range(1, len(cells(notebook)) + 1))
    outputs = [output for cell in cells(notebook) for output in cell["outputs"]]
    assert outputs
    assert not [output for output in outputs if output["output_type"] == "error" or output.get("name") == "stderr"]
    assert file.stat().st_size < MOST_BYTES
    assert str(ROOT) not in file.read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_runs_and_says_the_same_with_todays_numbers(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    if file.stem.startswith("train"):
        pytest.importorskip("stable_baselines3")
    monkeypatch.syspath_prepend(str(SCRIPTS / "lib"))
    from notebooks import executed

    assert words(executed(file)) == words(json.loads(file.read_text(encoding="utf-8")))
