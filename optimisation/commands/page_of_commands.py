"""A page whose commands are run, and which holds what they print."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from optimisation.files import replacing
from optimisation.progress import BAR, Bar
from optimisation.studies.page import ROOT

PAGE = ROOT / "docs" / "your_structure.md"
BLOCK = re.compile(r"```sh\n(?P<command>scripts/run [^\n]+)\n```\n\n```text\n(?P<printed>(?:(?!```).*\n)*?)```\n")


def printed_by(command: str) -> str:
    """Return what a command of the page prints, warnings and errors included."""
    _, name, *arguments = shlex.split(command)
    call = [sys.executable, str(ROOT / "scripts" / f"{name}.py"), *arguments]
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
