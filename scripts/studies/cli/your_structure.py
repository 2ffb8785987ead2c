"""Run the commands of docs/your_structure.md and write what they print into it."""


# needs: optimise

from __future__ import annotations

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
from optimisation.page import ROOT
from optimisation.progress import BAR, Bar

PAGE = ROOT / "docs" / "your_structure.md"
BLOCK = re.compile(r"```sh\n(?P<command>scripts/run [^\n]+)\n```\n\n```text\n(?P<printed>(?:(?!```).*\n)*?)```\n")


def printed_by(command: str) -> str:
    """Return what a command of the page prints, warnings and errors included."""
    _, name, *arguments = shlex.split(command)
    call = [sys.executable, "-m", "optimisation.cli.group", name, *arguments]
    found = subprocess.run(call, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    return "\n".join(line.rstrip() for line in found.stdout.strip().splitlines())


def bring_up_to_date(page: Path) -> int:
    """Run the commands of a page in turn, write what they print into it, and return their number; the page stays as it is until all have run."""
    text = page.read_text(encoding="utf-8")
    blocks = list(BLOCK.finditer(text))
    shutil.rmtree(ROOT / "results" / page.stem, ignore_errors=True)  # a study goes on where it was left, and would print something else
    results = [printed_by(block["command"]) for block in Bar(blocks, desc="commands", bar_format=BAR)]
    for block, result in reversed(list(zip(blocks, results, strict=True))):
        text = f"{text[: block.start('printed')]}{result}\n{text[block.end('printed') :]}"
    with replacing(page) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return len(blocks)


@command()
@click.option(
    "--page", type=click.Path(path_type=Path, dir_okay=False, exists=True), default=PAGE, show_default=True, help="Page to bring up to date."
)
def main(page: Path) -> None:
    """Run the commands of docs/your_structure.md, from file to absorber, and write what they print into the page.

    Ctrl-C leaves the page as it was.
    """
    started = time.perf_counter()
    with plain_errors("Broken off; the page is as it was."):
        number = bring_up_to_date(page)
    click.echo(f"{number} commands in {(time.perf_counter() - started) / 60:.1f} minutes, written: {page}")
