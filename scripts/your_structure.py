"""Run the commands of docs/your_structure.md and write what they print into it."""
# needs: optimise, cluster, files

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import click
from tqdm import tqdm

from optimisation.command_line import plain_errors
from optimisation.files import replacing
from optimisation.progress import BAR

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "your_structure.md"
BLOCK = re.compile(r"```sh\n(?P<command>scripts/run [^\n]+)\n```\n\n```text\n(?P<printed>(?:(?!```).*\n)*?)```\n")


def printed_by(command: str) -> str:
    """Return what a command of the page prints, warnings and errors included."""
    _, name, *arguments = shlex.split(command)
    call = [sys.executable, str(ROOT / "scripts" / f"{name}.py"), *arguments]
    found = subprocess.run(call, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    return "\n".join(line.rstrip() for line in found.stdout.strip().splitlines())


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--page", type=click.Path(path_type=Path, dir_okay=False, exists=True), default=PAGE, show_default=True, help="Page to bring up to date."
)
def main(page: Path) -> None:
    """Run the commands of docs/your_structure.md, from file to absorber, and write what they print into the page.

    Ctrl-C leaves the page as it was.
    """
    text, started = page.read_text(encoding="utf-8"), time.perf_counter()
    blocks = list(BLOCK.finditer(text))
    shutil.rmtree(ROOT / "results" / "your_structure", ignore_errors=True)  # a study goes on where it was left, and would print something else
    with plain_errors("Broken off; the page is as it was."):
        results = [printed_by(block["command"]) for block in tqdm(blocks, desc="commands", bar_format=BAR, disable=None)]
        for block, result in reversed(list(zip(blocks, results, strict=True))):
            text = f"{text[: block.start('printed')]}{result}\n{text[block.end('printed') :]}"
        with replacing(page) as temporary:
            temporary.write_text(text, encoding="utf-8")
    click.echo(f"{len(blocks)} commands in {(time.perf_counter() - started) / 60:.1f} minutes, written: {page}")


if __name__ == "__main__":
    main()
