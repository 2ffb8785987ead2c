"""Run the commands and examples of pages and write what they print into these pages."""


# needs: optimise, env

import contextlib
import tempfile
import time
from pathlib import Path
from typing import Any

import click

from impact_env.checks import ParameterError
from optimisation.checkpoint import conditions, sources
from optimisation.cli.common import command, plain_errors
from optimisation.executors import BAR, Bar
from optimisation.files import ROOT, fill, has_markers, replacing
from studies.printed_blocks import find_blocks, run_source, select_paragraphs, write_files

PRINTED = "printed"  # the section that says when and where the commands ran
NAMES = (
    "which_gap",
    "which_place",
    "your_structure",
    "tutorial",
    "sweep",
    "periodic_python",
    "slow_manifold",
    "frequency_domain",
    "tutorial_python",
    "loads",
    "environments",
    "tasks",
)
PAGES = (ROOT / "README.md", *(ROOT / "docs" / f"{name}.md" for name in NAMES))


def update_page(page: Path) -> int:
    """Run the blocks of a page in order and write what they print into it; return their number.

    The page stays as it is until all have run.
    """
    text = page.read_text(encoding="utf-8")
    blocks = find_blocks(text)
    if not blocks:
        raise ParameterError(f"{page} is not allowed: a page with printed blocks")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        write_files(text, Path(folder))
        names: dict[str, Any] = {}
        results = [
            select_paragraphs(run_source(block.language, block.source, names), block.starts)
            for block in Bar(blocks, desc=page.stem, bar_format=BAR)
        ]
    for block, result in reversed(list(zip(blocks, results, strict=True))):
        text = f"{text[: block.place[0]]}{result}\n{text[block.place[1] :]}"
    with replacing(page) as temporary:
        temporary.write_text(text, encoding="utf-8")
    if has_markers(text, PRINTED):
        fill(page, page, {PRINTED: sources(conditions())})
    return len(blocks)


@command()
@click.option(
    "--page",
    "pages",
    type=click.Path(path_type=Path, dir_okay=False, exists=True, resolve_path=True),
    multiple=True,
    default=PAGES,
    help="Page to bring up to date; may be repeated.  [default: all pages with printed blocks]",
)
def main(pages: tuple[Path, ...]) -> None:
    """Run the commands and examples of pages, and write what they print into these pages.

    Ctrl-C leaves a page as it was.
    """
    started = time.perf_counter()
    with plain_errors("Broken off; the page is as it was."):
        number = sum(update_page(page) for page in pages)
    click.echo(
        f"{number} blocks in {(time.perf_counter() - started) / 60:.1f} minutes, written: "
        f"{', '.join(map(str, pages))}"
    )
