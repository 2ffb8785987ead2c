"""The check of a built site finds dead links and external fetches.

The contents of the site agree with its index.
"""

import importlib
import importlib.util
import inspect
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from places import ROOT, SCRIPTS

import impact_env

sys.path.insert(0, str(SCRIPTS / "lib"))
from check_site import main

WHOLE = (
    '<a href="b.html#place">b</a><a href="#top">up</a><img src="c.png"><a '
    'href="https://host.example/">else</a><p id="top"></p>'
)
WRONG = {
    '<a href="none.html">x</a>': "none.html leads to no file",
    '<a href="b.html#nowhere">x</a>': "b.html#nowhere leads to no place",
    '<a href="#nowhere">x</a>': "#nowhere leads to no place",
    '<a href="folder">x</a>': "folder leads to no file",
    '<img src="none.png">': "none.png leads to no file",
    '<script src="https://host.example/a.js"></script>': "fetches https://host.example/a.js",
    '<script src="//host.example/a.js"></script>': "fetches //host.example/a.js",
    '<link rel="stylesheet" href="https://host.example/a.css">': "fetches https://host.example/a.css",
}


def test_what_is_wrong_in_a_site_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (page := tmp_path / "a.html").write_text(WHOLE)
    (tmp_path / "b.html").write_text('<h2 id="place">b</h2>')
    (tmp_path / "c.png").touch()
    (tmp_path / "folder").mkdir()
    assert (main(tmp_path), capsys.readouterr().err) == (0, "")
    for line, words in WRONG.items():
        page.write_text(WHOLE + line)
        assert main(tmp_path) == 1
        assert re.fullmatch(rf"a\.html: {re.escape(words)}.*\n", capsys.readouterr().err)


def test_the_reference_has_every_public_name_once() -> None:
    folder = ROOT / "docs" / "site"
    pages = re.findall(r"^   (reference_\w+)$", (folder / "api.rst").read_text(), re.MULTILINE)
    assert {f"{page}.rst" for page in pages} == {file.name for file in folder.glob("reference_*")}
    described: list[str] = []
    for page in pages:
        module = ""
        for directive, name in re.findall(
            r"^\.\. (currentmodule|autoclass|autofunction):: (\S+)",
            (folder / f"{page}.rst").read_text(),
            re.MULTILINE,
        ):
            if directive == "currentmodule":
                module = name
            else:
                described.append(name if "." in name else f"{module}.{name}")
    assert len(described) == len(set(described))
    for name in described:
        module, _, attribute = name.rpartition(".")
        assert inspect.getdoc(getattr(importlib.import_module(module), attribute)), name
    public = {f"impact_env.{name}" for name in impact_env.__all__ if name != "__version__"}
    assert public <= set(described)


def test_the_sites_contents_are_those_of_the_index() -> None:
    pytest.importorskip("docutils")
    sys.path.insert(0, str(ROOT / "docs" / "site"))
    from conf import toctrees

    listed = set(re.findall(r"^[\w./-]+$", toctrees(), re.MULTILINE))
    contents = (
        page for pattern in ("*.md", "internals/*.md") for page in (ROOT / "docs").glob(pattern)
    )
    pages = {page.relative_to(ROOT).with_suffix("").as_posix() for page in contents} | {
        "CONTRIBUTING",
        "CHANGELOG",
        "SECURITY",
        "CODE_OF_CONDUCT",
    }
    assert pages | {"impact_env/kernels/README", "docs/site/api", "docs/site/notebooks"} == listed


# Notebooks are committed as executed, small, and run to their end with what they showed.


NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
MOST_BYTES = 150_000


def cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def words(notebook: Any) -> list[str]:
    """Return each cell's text and the kinds of pictures it shows.

    Each number is replaced by one sign, and several spaces by one.
    """
    outputs = []
    for cell in cells(notebook):
        text = "".join("".join(output.get("text", "")) for output in cell["outputs"])
        kinds = [
            sorted(output.get("data", {}))
            for output in cell["outputs"]
            if output["output_type"] != "stream"
        ]
        outputs.append(f"{re.sub(r' +', ' ', re.sub(r'-?[0-9][0-9.e-]*', '#', text))} {kinds}")
    return outputs


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_is_executed_whole_and_small(file: Path) -> None:
    notebook = json.loads(file.read_text(encoding="utf-8"))
    assert [cell["execution_count"] for cell in cells(notebook)] == list(
        range(1, len(cells(notebook)) + 1)
    )
    outputs = [output for cell in cells(notebook) for output in cell["outputs"]]
    assert outputs
    assert not [
        output
        for output in outputs
        if output["output_type"] == "error" or output.get("name") == "stderr"
    ]
    assert file.stat().st_size < MOST_BYTES
    assert str(ROOT) not in file.read_text(encoding="utf-8")


@pytest.mark.nightly
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_runs_and_says_the_same_with_todays_numbers(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    if file.stem.startswith("train"):
        pytest.importorskip("stable_baselines3")
    monkeypatch.syspath_prepend(str(SCRIPTS / "lib"))
    from notebooks import executed

    assert words(executed(file)) == words(json.loads(file.read_text(encoding="utf-8")))
