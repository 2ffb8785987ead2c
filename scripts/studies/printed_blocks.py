"""Blocks of pages that show the output of a command or of a Python example.

They are found, run again and compared.
"""

import contextlib
import io
import re
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from optimisation.cli.names import find_command, imported
from optimisation.files import ROOT

EXAMPLES = Path("docs", "examples")
# a command or Python code and what it prints: all of it, or, where words stand behind ```text, the
# paragraphs that begin with one of them, or the lines after "="; several are separated by
# semicolons
BLOCK = re.compile(
    r"```(?P<language>sh|python)\n(?P<source>(?:(?!```).*\n)+?)```\n\n"
    r"```text(?P<starts>[^\n]*)\n(?P<printed>(?:(?!```).*\n)*?)```\n"
)
FILE = re.compile(r"```toml\n# (?P<name>[\w.]+\.toml)\n(?P<text>(?:(?!```).*\n)*?)```\n")
NUMBER = re.compile(r"[-+]?(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?:e[-+]?\d+)?")
# a relative change is a small difference of two noisy levels: its size is not compared
CHANGE = re.compile(r"[-+]\d+(?:\.\d+)? %")
# lines about what a search ran besides its answer, which depends on the last bits of chaotic runs:
# their words are not compared
SEARCH_LINES = ("Place:",)


@dataclass(frozen=True)
class Block:
    """A command or Python example of a page, and the text that the page shows as its output."""

    language: str
    source: str
    starts: tuple[str, ...]
    printed: str
    place: tuple[int, int]

    @property
    def command(self) -> str:
        """Return the name of the command, empty for a Python example."""
        if self.language != "sh":
            return ""
        return find_command(shlex.split(self.source)[1:])[0]


def find_blocks(text: str) -> list[Block]:
    """Return the blocks of a page in order."""
    return [
        Block(
            result["language"],
            result["source"],
            tuple(start.strip() for start in result["starts"].split(";") if start.strip()),
            result["printed"],
            result.span("printed"),
        )
        for result in BLOCK.finditer(text)
    ]


def write_files(text: str, folder: Path) -> None:
    """Write the files that a page shows, and the examples, into a folder.

    The files are TOML blocks whose first line is ``# NAME.toml``.
    """
    for result in FILE.finditer(text):
        (folder / result["name"]).write_text(result["text"], encoding="utf-8")
    shutil.copytree(ROOT / EXAMPLES, folder / EXAMPLES, dirs_exist_ok=True)


def run_source(language: str, source: str, names: dict[str, Any] | None = None) -> str:
    """Return the output of a command or a Python example in the current folder.

    Warnings and errors come first. Progress is left out.

    ``names``: what the Python examples before it on the page have defined; the example adds its
    own.
    """
    if language == "python":
        names = {} if names is None else names
        names["__name__"] = "__example__"
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            exec(compile(source, "<example>", "exec"), names)
        return output.getvalue()
    _, *words = shlex.split(source)
    name, length = find_command(words)
    result = CliRunner().invoke(imported(name).main, words[length:])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    warnings = [
        line for line in result.stderr.splitlines() if line.lower().startswith(("warning", "error"))
    ]
    return "\n".join([*warnings, result.stdout])


def select_paragraphs(text: str, starts: tuple[str, ...]) -> str:
    """Return the paragraphs of an output that begin with one of ``starts``.

    All paragraphs are returned if ``starts`` is empty.

    Of a paragraph with lines that begin with a word after "=", such as "=Level", only these lines
    are returned.
    """
    whole = "\n".join(line.rstrip() for line in text.strip().splitlines())
    if not starts:
        return whole
    of_lines = tuple(start.removeprefix("=") for start in starts if start.startswith("="))
    parts = []
    for part in whole.split("\n\n"):
        lines = [line for line in part.splitlines() if of_lines and line.startswith(of_lines)]
        if part.startswith(tuple(start for start in starts if not start.startswith("="))):
            parts.append(part)
        elif lines:
            parts.append("\n".join(lines))
    return "\n\n".join(parts)


def _pattern(line: str) -> str:
    """Return a pattern of a line that does not depend on its numbers.

    Each number becomes ``#``, and a sequence of spaces and rules of tables one space. Of
    `SEARCH_LINES` only the label is returned.
    """
    if line.startswith(SEARCH_LINES):
        return line.partition(":")[0]
    return re.sub(r"[ \-:]+", " ", NUMBER.sub("#", line)).strip()


def _numbers(line: str) -> list[float]:
    if line.startswith(SEARCH_LINES):
        return []
    return [float(number.replace(",", "")) for number in NUMBER.findall(CHANGE.sub("", line))]


def _by_pattern(text: str) -> dict[str, list[str]]:
    lines: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line.strip():
            lines.setdefault(_pattern(line), []).append(line)
    return lines


def find_differences(page: str, output: str, tolerance: float) -> Iterator[str]:
    """Yield the differences between an output and the text of a page.

    A difference is another text, or a number that differs by more than a relative ``tolerance``.

    A table may have other rows, as long as they have the form of those on the page: which gaps a
    search runs depends on the last bits of chaotic runs. Then its numbers are not compared.
    """
    visible = _by_pattern(page)
    result = _by_pattern(output)
    for pattern in [*visible, *result]:
        if pattern not in result:
            yield f"the page shows '{visible[pattern][0]}', which is not printed"
        elif pattern not in visible:
            yield f"'{result[pattern][0]}' is printed, which the page does not show"
    for pattern in visible.keys() & result.keys():
        if len(visible[pattern]) != len(result[pattern]):
            continue
        for old, new in zip(visible[pattern], result[pattern], strict=True):
            if any(
                abs(a - b) > tolerance * max(abs(a), abs(b))
                for a, b in zip(_numbers(old), _numbers(new), strict=True)
            ):
                yield f"the page shows '{old}', printed is '{new}'"
