"""Pages have working links, complete indexes and all markers.

The markers are those of blocks that commands fill.
"""

import re
from pathlib import Path

import pytest
from places import ROOT

from impact_env.envs import ENVIRONMENTS
from impact_env.laws import CONCEPTS
from optimisation.cli.group import file_of, modules
from optimisation.cli.names import REPRODUCE
from optimisation.files import has_markers
from studies.cli import command_table

KERNELS = ROOT / "impact_env" / "kernels"
DOCS = [*sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "internals").glob("*.md"))]
ENVIRONMENT_PAGES = sorted((ROOT / "docs" / "environments").glob("*.md"))
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *DOCS,
    *ENVIRONMENT_PAGES,
    KERNELS / "README.md",
]
TYPED = (
    "README.md",
    "docs/sweep.md",
    "docs/tutorial.md",
    "docs/frequency_domain.md",
    "docs/explore.md",
)
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
MARKED = {
    "docs/tasks.md": ["admission", "rules", "leaderboard"],
    "docs/methods.md": ["benchmark", "levels"],
    "docs/internals/cost.md": ["cost"],
    "docs/method.md": ["benchmark_energies"],
    "docs/environments.md": ["speeds", "arguments"],
    "docs/gap_method.md": ["tunings"],
    "docs/load_findings.md": ["loads_both", "loads_gravity", "loads_start"],
}


def anchors(page: Path) -> set[str]:
    """Return the names that a page's headings have in links."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in headings
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        path, _, anchor = link.partition("#")
        if not link.startswith("http"):
            target = page.parent / path if path else page
            assert target.exists(), link
            assert not anchor or anchor in anchors(target), link


def test_the_index_has_every_page_and_names_real_commands() -> None:
    text = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    pages = {str(page.relative_to(ROOT / "docs")) for page in DOCS} - {"README.md"}
    assert pages == {link for link in LINK.findall(text) if not link.startswith("..")}
    listed = re.findall(r"^\| \[[^\]]*\]\(([^)]*)\)", text, re.MULTILINE)
    assert len(listed) == len(set(listed))
    scripts = modules().keys()
    named = {
        name
        for row in re.findall(r"^\| .* \|$", text, re.MULTILINE)
        for name in re.findall(r"`([\w -]+)`", row.rsplit(" | ", 1)[1])
    }
    assert named <= scripts
    assert {"reproduce findings", "reproduce stability", "rl evaluate"} <= named


def test_the_map_of_the_kernels_names_every_file_and_real_functions() -> None:
    text = (KERNELS / "README.md").read_text(encoding="utf-8")
    sources = {
        file.relative_to(KERNELS).as_posix(): file.read_text(encoding="utf-8")
        for file in KERNELS.glob("*/[!_]*.py")
    }
    order = re.findall(
        r"`(\w+/\w+\.py)`",
        text[text.index("| compilation") : text.index("## From event to event")],
    )
    assert set(order) >= set(sources)
    for place, function in re.findall(
        r"`(\w+/\w+\.py)` \(`(\w+)`", text.partition("## The paper's equations")[2]
    ):
        assert re.search(rf"^def {function}\b", sources[place], re.MULTILINE), function
    # to be read from top to bottom: nothing needs what comes later
    known: set[str] = set()
    for name in dict.fromkeys(order):
        known.add(name)
        needed = re.findall(
            r"^from impact_env\.kernels\.(\w+)\.(\w+) import", sources[name], re.MULTILINE
        )
        assert {f"{folder}/{module}.py" for folder, module in needed} <= known, name


@pytest.mark.slow
def test_python_examples_have_the_types_that_strict_checking_wants(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mypy = pytest.importorskip("mypy.api")
    blocks = [
        source
        for name in TYPED
        for source in PYTHON.findall((ROOT / name).read_text(encoding="utf-8"))
    ]
    assert len(blocks) >= len(TYPED)
    for number, source in enumerate(blocks):
        (tmp_path / f"example_{number}.py").write_text(source, encoding="utf-8")
    monkeypatch.chdir(ROOT)  # with the cache of the linters
    messages, _, status = mypy.run([*map(str, tmp_path.glob("*.py"))])
    assert status == 0, messages


@pytest.mark.parametrize("name", MARKED)
def test_blocks_have_their_markers(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    for block in MARKED[name]:
        assert has_markers(text, block)
        assert f"<!-- {block} -->\n|" in text


def test_tables_are_written_by_the_commands_that_pages_name() -> None:
    """Tables are written by the commands that pages name.

    No page says that a command prints its table. Each command that a page names with --page can
    fill this page.
    """
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"prints th(is|e) table", text), page.name
        for command, target in re.findall(
            r"scripts/run (\w+(?: \w[\w-]*)?) --page ([\w./]+)", text
        ):
            assert (ROOT / target).resolve() == page
            assert target in file_of(command).read_text(encoding="utf-8")


def test_pages_name_every_kind_of_absorber() -> None:
    """The option of `sweep`, and the table of kinds in files."""
    sweep = (ROOT / "docs" / "sweep.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| `--absorber` \|.*$", sweep, re.MULTILINE)
    assert set(CONCEPTS) <= set(re.findall(r"`([\w-]+)`", row))
    scenes = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    table = scenes.partition("kind")[2]
    for name, keys in CONCEPTS.items():
        rows = re.findall(rf"^\| `{name}`.*$", table, re.MULTILINE)
        if name != "none":
            assert rows, name
            named = "\n".join(rows) + scenes
            assert all(f"`{key}`" in named for key in keys), name


def test_the_page_of_commands_has_the_commands_of_today() -> None:
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert f"<!-- {command_table.NAME} -->\n{command_table.make_tables()}\n" in text
    shipped = [name for name in modules() if not name.startswith(REPRODUCE)]
    assert set(re.findall(r"^\| `([^`]+)`", text, re.MULTILINE)) == set(shipped)


def test_every_environment_has_a_page_of_today() -> None:
    """After a change `reproduce environment-pages` writes them again."""
    pytest.importorskip("gymnasium")
    from studies.cli import environment_pages

    pages = environment_pages.EXAMPLES
    names = [name for page in pages for name in environment_pages.list_names(page)]
    assert {environment_pages.PREFIX + name for name in names} == set(ENVIRONMENTS)
    assert {page.stem for page in ENVIRONMENT_PAGES} == set(pages)
    measured = environment_pages.read_measured()
    for page in ENVIRONMENT_PAGES:
        written = page.read_text(encoding="utf-8")
        assert written == environment_pages.make_page(page.stem, measured[page.stem])
    overview = (ROOT / "docs" / "environments.md").read_text(encoding="utf-8")
    assert environment_pages.make_shared_table() in overview
    assert {f"environments/{page}.md" for page in pages} <= set(LINK.findall(overview))
