"""A card: what an answer says on one screen, as text, JSON and one HTML file whose curves tell their values where one points.

The HTML asks for nothing beside itself: its policy forbids every request. Its curves are drawn by the script of the explorer's page, which it holds
with uPlot, and printed as vectors.
"""

import html
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from impact_env.modes import ModalModel
from impact_env.parameters import SlidingAbsorber
from optimisation.baselines import Baselines
from optimisation.files import replacing, write_json
from optimisation.service import ImpactLoads

Json = dict[str, object]
# colours in card.html; a curve of fewer points shows them
COLOURS = 7
MARKED = 60
FRAME = Path(__file__).with_name("card.html")
ASSETS = Path(__file__).parents[1] / "explore/assets"
SHARED = ("uplot-LICENSE.txt", "uplot.css", "uplot.js", "figure.js")


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
        return (
            self.value if isinstance(self.value, str) else f"{self.value:.4g} {self.unit}".rstrip()
        )


@dataclass(frozen=True)
class Curve:
    """Points (x, y) of a name, with a band if there is one; ``points``: not joined by a line."""

    name: str
    x: Sequence[float | None]
    y: Sequence[float | None]
    low: Sequence[float | None] = ()
    high: Sequence[float | None] = ()
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


def text(card: Card) -> str:
    """Return the card to read in a terminal."""
    width = max((len(row.label) for _, rows in card.groups for row in rows), default=0)
    lines = [card.title]
    for heading, rows in card.groups:
        lines += ["", heading, *(f"  {row.label:<{width}}  {row.text}" for row in rows)]
    return "\n".join(
        [
            *lines,
            *(["", "Warnings", *(f"  {line}" for line in card.warnings)] if card.warnings else []),
        ]
    )


def content(card: Card) -> Json:
    """Return the card as JSON values."""
    groups = {
        heading: [
            {"label": r.label, "value": None if r.text == "not known" else r.value, "unit": r.unit}
            for r in rows
        ]
        for heading, rows in card.groups
    }
    return {"title": card.title, "groups": groups, "warnings": list(card.warnings)}


def page(card: Card) -> str:
    """Return the card as one HTML file."""
    parts = [f"<h1>{html.escape(card.title)}</h1>"]
    if card.warnings:
        parts.append(
            "<ul class='warnings'>"
            + "".join(f"<li>{html.escape(line)}</li>" for line in card.warnings)
            + "</ul>"
        )
    parts.append("<div class='groups'>")
    for heading, rows in card.groups:
        cells = "".join(
            f"<tr><th>{html.escape(row.label)}</th><td>{html.escape(row.text)}</td></tr>"
            for row in rows
        )
        parts.append(f"<section><h2>{html.escape(heading)}</h2><table>{cells}</table></section>")
    parts.append("</div>")
    data = json.dumps([_figure(chart) for chart in card.charts], allow_nan=False).replace(
        "<", "\\u003c"
    )
    filled = {"title": html.escape(card.title), "body": "\n".join(parts), "charts": data}
    filled |= {name: (ASSETS / name).read_text(encoding="utf-8") for name in SHARED}
    return re.sub(
        r"\{\{([\w.-]+)\}\}", lambda match: filled[match[1]], FRAME.read_text(encoding="utf-8")
    )


def _figure(chart: Chart) -> Json:
    """Return a chart as figure.js draws it."""
    lines = list[Json]()
    areas = list[Json]()
    for k, curve in enumerate(chart.curves):
        order = sorted(
            (i for i, x in enumerate(curve.x) if x is not None),
            key=lambda i: curve.x[i],  # type: ignore[arg-type, return-value]
        )
        x, y, low, high = (
            [
                None if v is None or (log and v <= 0) else v
                for v in (values[i] for i in order if values)
            ]
            for values, log in (
                (curve.x, chart.log_x),
                (curve.y, chart.log_y),
                (curve.low, chart.log_y),
                (curve.high, chart.log_y),
            )
        )
        own: Json = {"name": curve.name, "colour": f"c{k % COLOURS}", "x": x}
        lines.append(
            own
            | {
                "y": y,
                "width": 0 if curve.points else 2,
                "points": curve.points or len(x) < MARKED,
                "hollow": curve.points,
            }
        )
        areas += [own | {"low": low, "high": high, "strength": 0.2}] if low else []
    axes: Json = {
        "x": {"label": chart.x, "short": chart.x, "log": chart.log_x},
        "y": {"label": chart.y, "log": chart.log_y},
    }
    return axes | {
        "title": chart.title,
        "lines": lines,
        "areas": areas,
        "marks": [{"name": name, "x": at} for name, at in chart.marks],
    }


def write_card(folder: Path, card: Card) -> list[Path]:
    """Write card.html and card.json into a folder, and return the files."""
    files = [folder / "card.html", folder / "card.json"]
    with replacing(files[0]) as temporary:
        temporary.write_text(page(card), encoding="utf-8")
    write_json(files[1], content(card))
    return files


# Groups of rows that the cards of several commands share: the device, what it bears, its rivals, and what is assumed. Given in SI units.


Rows = tuple[Row, ...]
RATE = "% per 100 pseudo periods"
NO_DEVICE = "no device in this cavity comes below"


def mass_rows(mass_ratio: float, model: ModalModel) -> Rows:
    """Return an absorber's mass and what it is a share of."""
    own = Row("absorber mass", mass_ratio * model.beam_mass, "kg")
    return own, Row("that is", 100 * mass_ratio, f"% of the structure's {model.beam_mass:.4g} kg")


def device_rows(absorber: SlidingAbsorber, model: ModalModel) -> Rows:
    """Return an impact absorber between rigid walls as it is built."""
    walls = absorber.walls
    friction = absorber.friction
    return (
        *mass_rows(absorber.mass_ratio, model),
        Row("clearance to either wall", 1e3 * walls.gap, "mm"),  # type: ignore[union-attr]
        Row("coefficient of restitution", float(walls.restitution)),  # type: ignore[union-attr]
        Row("friction limit", 0.0 if friction is None else friction.limit, "N"),
    )


def baseline_rows(baselines: Baselines) -> Rows:
    """Return the lines about other absorbers of the same mass."""
    damper = f"best friction damper of this mass, {baselines.damper_limit:.4g} N"
    return (
        Row("best tuned absorber of this mass", 1e3 * baselines.tuned, "mm"),
        Row(damper, 1e3 * baselines.damper, "mm"),
    )


def service_rows(gap: float, impacts: ImpactLoads, level: float) -> Rows:
    """Return the lines about a device's service: its structure has the ``level`` in m."""
    return (
        Row("stroke of the absorber, wall to wall", 2e3 * gap, "mm"),
        Row("largest impact speed", impacts.largest, "m/s"),
        Row("RMS impact speed", impacts.rms, "m/s"),
        Row("impacts", impacts.rate, "1/s"),
        Row("power lost in impacts", 1e3 * impacts.power, "mW"),
        Row(
            "largest acceleration of the structure, harmonic part",
            math.sqrt(2) * level * impacts.omega**2,
            "m/s^2",
        ),
    )


def assumed_rows(
    model: ModalModel, resonances: Sequence[int], rate: float | None, more: str = ""
) -> Rows:
    """Return the lines about the runs behind the levels; ``rate`` None: no sweeps."""
    rows = [
        Row(
            f"resonance {r}",
            f"{model.resonance_omega(r) / (2 * math.pi):.4g} Hz, damping ratio {100 * model.damping_ratio[r - 1]:.4g} %",
        )
        for r in dict.fromkeys(resonances)
    ]
    swept = () if rate is None else (Row("sweeps up and down at", rate, RATE),)
    return *rows, Row("modes kept", f"{model.modes}{more or '; more are not tried'}"), *swept


def with_band(
    value: float, low: float, high: float, pattern: str = "{:.4g}", unit: str = ""
) -> str:
    """Return a value with its unit, and in brackets the band; without it where it is not known (NaN), or its ends agree to the digits shown."""
    if math.isnan(low) or math.isnan(high):
        low = high = value
    ends = pattern.format(low), pattern.format(high)
    text = f"{pattern.format(value)} {unit}".rstrip()
    return text if ends[0] == ends[1] else f"{text} ({ends[0]} to {ends[1]})"


def between(low: float, high: float) -> str:
    """Return a range of forces in words."""
    return "at no force that is known" if math.isnan(low) else f"{low:.3g} to {high:.3g} N"
