"""A card: what an answer says on one screen, as text, JSON and one HTML file whose curves tell their values where one points.

The HTML asks for nothing beside itself: its policy forbids every request, its curves are drawn by its own few lines of script, and it prints.
"""

import html
import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from optimisation.files import replacing, write_json

Json = dict[str, object]
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#000000", "#CC79A7", "#E69F00", "#56B4E9")  # Okabe and Ito
ASSETS = Path(__file__).with_name("card.html")


@dataclass(frozen=True)
class Row:
    """A number, or some words, with what it is and its unit."""

    label: str
    value: float | str | None
    unit: str = ""

    @property
    def text(self) -> str:
        """Value and unit as one reads them."""
        if self.value is None or (isinstance(self.value, float) and not math.isfinite(self.value)):
            return "not known"
        return self.value if isinstance(self.value, str) else f"{self.value:.4g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Curve:
    """Points (x, y) of a name, with a band if there is one; ``points``: not joined by a line."""

    name: str
    x: tuple[float | None, ...]
    y: tuple[float | None, ...]
    low: tuple[float | None, ...] = ()
    high: tuple[float | None, ...] = ()
    points: bool = False


@dataclass(frozen=True)
class Chart:
    """Curves over one axis, with marked places on it."""

    title: str
    x: str
    y: str
    curves: tuple[Curve, ...]
    marks: tuple[tuple[str, float], ...] = ()
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True)
class Card:
    """The content of a card: groups of rows under headings, charts, warnings."""

    title: str
    groups: tuple[tuple[str, tuple[Row, ...]], ...]
    charts: tuple[Chart, ...] = ()
    warnings: tuple[str, ...] = ()


def numbers(values: Iterable[float]) -> tuple[float | None, ...]:
    """Return numbers as JSON knows them: None for those that are not finite."""
    return tuple(float(x) if math.isfinite(x) else None for x in values)


def text(card: Card) -> str:
    """Return the card to read in a terminal."""
    width = max((len(row.label) for _, rows in card.groups for row in rows), default=0)
    lines = [card.title]
    for heading, rows in card.groups:
        lines += ["", heading, *(f"  {row.label:<{width}}  {row.text}" for row in rows)]
    return "\n".join([*lines, *(["", "Warnings", *(f"  {line}" for line in card.warnings)] if card.warnings else [])])


def content(card: Card) -> Json:
    """Return the card as JSON values."""
    groups = {
        heading: [{"label": r.label, "value": None if r.text == "not known" else r.value, "unit": r.unit} for r in rows]
        for heading, rows in card.groups
    }
    return {"title": card.title, "groups": groups, "warnings": list(card.warnings)}


def page(card: Card) -> str:
    """Return the card as one HTML file."""
    parts = [f"<h1>{html.escape(card.title)}</h1>"]
    if card.warnings:
        parts.append("<ul class='warnings'>" + "".join(f"<li>{html.escape(line)}</li>" for line in card.warnings) + "</ul>")
    parts.append("<div class='groups'>")
    for heading, rows in card.groups:
        cells = "".join(f"<tr><th>{html.escape(row.label)}</th><td>{html.escape(row.text)}</td></tr>" for row in rows)
        parts.append(f"<section><h2>{html.escape(heading)}</h2><table>{cells}</table></section>")
    parts.append("</div>")
    charts = [asdict(chart) | {"colours": COLOURS} for chart in card.charts]
    data = json.dumps(charts, allow_nan=False).replace("<", "\\u003c")
    frame = ASSETS.read_text(encoding="utf-8")
    return frame.replace("{{title}}", html.escape(card.title)).replace("{{body}}", "\n".join(parts)).replace("{{charts}}", data)


def write_card(folder: Path, card: Card) -> list[Path]:
    """Write card.html and card.json into a folder, and return the files."""
    files = [folder / "card.html", folder / "card.json"]
    with replacing(files[0]) as temporary:
        temporary.write_text(page(card), encoding="utf-8")
    write_json(files[1], content(card))
    return files
