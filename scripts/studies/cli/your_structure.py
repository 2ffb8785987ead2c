"""Run the commands of docs/which_gap.md and docs/your_structure.md and write what they print into these pages."""


# needs: optimise

import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import click

from optimisation.cli.common import command, plain_errors
from optimisation.files import replacing
from optimisation.machine import conditions, sources
from optimisation.page import ROOT, fill, require_markers
from optimisation.progress import BAR, Bar

PRINTED = "printed"  # the section that says when and where the commands ran
PAGES = tuple(ROOT / "docs" / f"{name}.md" for name in ("which_gap", "your_structure"))
# a command and what it prints: all, or the paragraphs that begin with what stands behind ```text, several apart by ;
BLOCK = re.compile(
    r"```sh\n(?P<command>scripts/run [^\n]+)\n```\n\n```text(?P<shown>[^\n]*)\n(?P<printed>(?:(?!```).*\n)*?)```\n"
)


def printed_by(command: str, shown: str = "") -> str:
    """Return the output of a page's command, warnings and errors included: of it the paragraphs that begin with one of ``shown``."""
    _, name, *arguments = shlex.split(command)
    call = [sys.executable, "-m", "optimisation.cli.group", name, *arguments]
    found = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=False)
    told = [
        line for line in found.stderr.splitlines() if line.lower().startswith(("warning", "error"))
    ]  # not progress
    text = "\n".join(line.rstrip() for line in [*told, *found.stdout.strip().splitlines()])
    starts = tuple(start.strip() for start in shown.split(";") if start.strip())
    return (
        "\n\n".join(part for part in text.split("\n\n") if part.startswith(starts))
        if starts
        else text
    )


def bring_up_to_date(page: Path) -> int:
    """Run the commands of a page in turn, write what they print into it, and return their number; the page stays as it is until all have run."""
    text = require_markers(page, page, (PRINTED,))
    blocks = list(BLOCK.finditer(text))
    shutil.rmtree(
        ROOT / "results" / page.stem, ignore_errors=True
    )  # a study goes on where it was left, and would print something else
    results = [
        printed_by(block["command"], block["shown"])
        for block in Bar(blocks, desc=page.stem, bar_format=BAR)
    ]
    for block, result in reversed(list(zip(blocks, results, strict=True))):
        text = f"{text[: block.start('printed')]}{result}\n{text[block.end('printed') :]}"
    with replacing(page) as temporary:
        temporary.write_text(text, encoding="utf-8")
    fill(page, page, {PRINTED: sources(conditions())})
    return len(blocks)


@command()
@click.option(
    "--page",
    "pages",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    multiple=True,
    default=PAGES,
    show_default=True,
    help="Page to bring up to date; may be repeated.",
)
def main(pages: tuple[Path, ...]) -> None:
    """Run the commands of docs/which_gap.md and docs/your_structure.md, and write what they print into these pages.

    Ctrl-C leaves a page as it was.
    """
    started = time.perf_counter()
    with plain_errors("Broken off; the page is as it was."):
        number = sum(bring_up_to_date(page) for page in pages)
    click.echo(
        f"{number} commands in {(time.perf_counter() - started) / 60:.1f} minutes, written: {', '.join(map(str, pages))}"
    )
