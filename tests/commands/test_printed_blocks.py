"""Pages show what their commands and Python examples print today."""

from pathlib import Path
from typing import Any

import pytest
from places import ROOT

from studies.printed_blocks import (
    Block,
    find_blocks,
    find_differences,
    run_source,
    select_paragraphs,
    write_files,
)

# relative tolerances of numbers, by command: four digits without impacts, orbits by Newton's method
TOLERANCES = {"structure": 2e-3, "periodic orbits": 1e-6}
# after impacts another processor or library gives other last bits, and levels of single runs are
# random: tests of physics judge them
CHAOTIC_TOL = 0.35
ENVIRONMENT_PAGES = sorted((ROOT / "docs" / "environments").glob("*.md"))
PAGES = {
    "README.md": 2,
    "docs/tutorial.md": 5,
    "docs/tutorial_python.md": 4,
    "docs/sweep.md": 2,
    "docs/your_structure.md": 3,
    "docs/periodic_python.md": 1,
    "docs/slow_manifold.md": 3,
    "docs/basins.md": 2,
    "docs/frequency_domain.md": 2,
    "docs/loads.md": 1,
    "docs/many_absorbers.md": 1,
    "docs/which_gap.md": 5,
    "docs/which_place.md": 1,
    "docs/environments.md": 1,
    "docs/tasks.md": 1,
    **{f"docs/environments/{page.name}": 1 for page in ENVIRONMENT_PAGES},
}


@pytest.fixture(scope="module")
def outputs() -> dict[str, str]:
    """Return what commands of other pages printed, by command: each runs once."""
    return {}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that the commands of all pages share, as a reader's would."""
    return tmp_path_factory.mktemp("pages")


def print_block(block: Block, outputs: dict[str, str], names: dict[str, Any]) -> str:
    if block.source not in outputs:
        outputs[block.source] = run_source(block.language, block.source, names)
    return select_paragraphs(outputs[block.source], block.starts)


# pages with kernels of a moving base, which few other tests compile, or with whole searches
NIGHTLY = ("docs/loads.md", "docs/which_gap.md", "docs/which_place.md")
SLOW = ("design place", "--uncertain")  # 11 to 15 s of the processor: at night


@pytest.mark.parametrize(
    ("name", "slow"),
    [
        *((name, False) for name in PAGES if name not in NIGHTLY),
        *(
            pytest.param(name, True, marks=pytest.mark.nightly)
            for name in (*NIGHTLY, "docs/tutorial.md")
        ),
    ],
)
def test_a_page_shows_what_its_blocks_print(
    name: str,
    slow: bool,
    folder: Path,
    outputs: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    blocks = find_blocks(text)
    if any("gymnasium" in block.source or "evaluate" in block.source for block in blocks):
        pytest.importorskip("gymnasium")
    assert len(blocks) == text.count("```text")
    assert len(blocks) >= PAGES[name]
    write_files(text, folder)
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {}
    differences = [
        difference
        for block in blocks
        if slow or not any(word in block.source for word in SLOW)
        for difference in find_differences(
            block.printed,
            print_block(block, outputs, names),
            TOLERANCES.get(block.command, CHAOTIC_TOL),
        )
    ]
    assert not differences, "\n".join(differences)


def test_a_difference_in_a_word_a_number_or_a_line_is_reported() -> None:
    page = "level 1.20 mm of 16 members\n\n| gap |\n| --- |\n| 1.0 |\n"
    assert not list(find_differences(page, page.replace("1.20", "1.201"), 1e-2))
    for old, new in (("1.20", "1.25"), ("mm", "m"), ("| gap |", ""), ("| gap |", "| gap |\nmore")):
        assert list(find_differences(page, page.replace(old, new), 1e-2)), new
    changed = "+10 % force: +1 %, level 1.2 mm\nPlace: runs at 0.8 left more."
    other = "+10 % force: -8 %, level 1.3 mm\nPlace: 1 leaves 25 %; runs at 0.8 left more."
    assert not list(find_differences(changed, other, 0.35))
    assert list(find_differences(changed, other.replace("1.3 mm", "2.3 mm"), 0.35))
    assert list(find_differences(changed, other.partition("\n")[0], 0.35))
    other_rows = page.replace("| 1.0 |", "| 1.1 |\n| 2.0 |")
    assert not list(find_differences(page, other_rows, 1e-2))
    assert list(find_differences(page, other_rows.replace("| 2.0 |", "| - |"), 1e-2))


def test_a_block_of_a_page_is_read_with_the_files_it_needs(tmp_path: Path) -> None:
    page = (
        "```toml\n# beam.toml\n[beam]\nmodes = 2\n```\n\n"
        "```sh\nscripts/run structure beam.toml\n```\n\n```text mass; Shapes\nmass 1 kg\n```\n\n"
        '```python\nprint("one")\n```\n\n```text\none\n```\n'
    )
    command, code = find_blocks(page)
    assert (command.command, command.starts) == ("structure", ("mass", "Shapes"))
    assert page[slice(*command.place)] == command.printed == "mass 1 kg\n"
    assert run_source(code.language, code.source) == code.printed
    write_files(page, tmp_path)
    assert (tmp_path / "beam.toml").read_text() == "[beam]\nmodes = 2\n"
    assert (tmp_path / "docs" / "examples" / "arm.toml").is_file()
    assert select_paragraphs("mass 2 kg\n\nelse\n\nShapes", command.starts) == "mass 2 kg\n\nShapes"
    output = "Answer\n  level 1 mm\n  of 3\n\nDevice\n  gap 2 mm"
    assert select_paragraphs(output, ("=  level", "Device")) == "  level 1 mm\n\nDevice\n  gap 2 mm"
