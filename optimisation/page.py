"""Pages whose text is written by hand and whose tables are written by a command, between markers.

A marker is a line ``<!-- NAME -->``, its end ``<!-- /NAME -->``.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from impact_env.parameters import ParameterError
from optimisation.files import replacing

ROOT = Path(__file__).resolve().parents[1]  # the checkout, if there is one
DOCS = (
    ROOT / "docs"
)  # the pages with their text: where a page is written anew, it starts from the one here


def published(docs: Path, results: Path) -> Path:
    """Return where a whole study is written by default: into the checkout's docs, or where there is no checkout among other results."""
    return docs if (ROOT / "pyproject.toml").is_file() else results


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- {name} -->", f"<!-- /{name} -->"


def has_markers(text: str, name: str) -> bool:
    """Return whether a text has the markers of a section, once and in order."""
    start, end = _markers(name)
    return text.count(start) == 1 == text.count(end) and text.index(start) < text.index(end)


def require_markers(path: Path, template: Path, names: Iterable[str]) -> str:
    """Return the text of the page that `fill` starts from; raises ParameterError unless it has the markers of each section, once and in order."""
    source = path if path.exists() else template
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise ParameterError(
            f"{source} is not allowed: a page that can be read ({error})"
        ) from error
    for name in names:
        if not has_markers(text, name):
            start, end = _markers(name)
            raise ParameterError(
                f"{source} is not allowed: a page with one pair of markers {start} and {end}"
            )
    return text


def fill(path: Path, template: Path, sections: Mapping[str, str]) -> None:
    """Write ``template`` (or ``path`` itself where it exists) to ``path`` with the text between the markers of each section replaced.

    Raises ParameterError, before anything is written, if a marker is missing.
    """
    text = require_markers(path, template, sections)
    for name, body in sections.items():
        start, end = _markers(name)
        head, rest = text.split(start)
        text = head + start + "\n" + body.strip("\n") + "\n" + end + rest.split(end)[1]
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an aligned Markdown table; the first column is flush left, the others flush right."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        first, *others = (
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return "| " + " | ".join([first, *others]) + " |"

    rule = (
        "| "
        + " | ".join(
            "-" * width if i == 0 else "-" * (width - 1) + ":" for i, width in enumerate(widths)
        )
        + " |"
    )
    return "\n".join([line(header), rule, *map(line, rows)])
