"""Compare the gap of the slow invariant manifold with the best gaps of scans.

The structures are those of docs/gap_method.md.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from impact_env import Scene
from impact_env.checks import ParameterError
from impact_env.periodic.case import case_of
from impact_env.periodic.slow_manifold import manifold_gap
from optimisation.absorber_rules import scaled_absorber
from optimisation.cli.common import check_page, command, fill_page, page_option
from optimisation.files import ROOT, markdown
from optimisation.gap_advice import expected_factor
from studies.structures import CASES, HARD_CASES

SCAN = ROOT / "docs" / "gap_method.md"
FORCE = 1.0  # N; gap and friction are in proportion to it
MARKER = "manifold_gaps"


class Row(NamedTuple):
    """A structure with its reach and its gaps.

    The gaps are relative to that of the design rule: the best of the scan, that of the fit, and
    that of the manifold.
    """

    name: str
    resonance: int
    reach: float
    best: float
    fit: float
    manifold: float


def scanned(page: Path) -> dict[tuple[str, int, float], tuple[float, float]]:
    """Return reach and best gap from the table of the scans.

    The gap is relative to that of the rule. Keys are name, resonance and mass in %.
    """
    text = page.read_text(encoding="utf-8")
    table = text.partition("<!-- check_gaps -->")[2].partition("<!-- /check_gaps -->")[0]
    lines = [line.strip().strip("|").split("|") for line in table.splitlines() if line[:1] == "|"]
    result = {}
    for cells in lines[2:]:
        name, resonance, _, mass, reach, best, *_ = (cell.strip() for cell in cells)
        result[name, int(resonance), float(mass)] = (float(reach), float(best))
    if not result:
        raise ParameterError(f"{page} is not allowed: a page with the table of check_gaps")
    return result


def rows_of(scans: dict[tuple[str, int, float], tuple[float, float]]) -> Iterator[Row]:
    """Yield a row for each structure that was scanned."""
    for case in (*CASES, *HARD_CASES):
        key = (case.name, case.resonance, round(100 * case.mass_ratio, 6))
        if key not in scans:
            continue
        reach, best = scans[key]
        model = case.model()
        absorber = scaled_absorber(model, FORCE, case.resonance, case.mass_ratio)
        scene = Scene(model, absorber)
        here = case_of(scene, FORCE, float(model.resonance_omega(case.resonance)))
        gap = manifold_gap(here, case.resonance) / here.gap
        yield Row(case.name, case.resonance, reach, best, expected_factor(reach), gap)


def summary(rows: list[Row]) -> str:
    """Return the deviations of fit, manifold and their geometric mean from the best gaps."""
    best = np.log([row.best for row in rows])
    fit = np.log([row.fit for row in rows])
    manifold = np.log([row.manifold for row in rows])
    lines = []
    for name, values in (("fit", fit), ("manifold", manifold), ("mean", (fit + manifold) / 2)):
        error = 100 * (np.exp(np.abs(values - best)) - 1)
        lines.append(
            [
                name,
                f"{np.median(error):.0f}",
                f"{np.quantile(error, 0.9):.0f}",
                f"{error.max():.0f}",
            ]
        )
    return markdown(("gap by", "median error, %", "90 % within, %", "largest error, %"), lines)


@command()
@page_option(MARKER, "docs/slow_manifold.md")
def main(page: Path | None) -> None:
    """Print the best gap, the fitted one and that of the manifold for each structure.

    All are relative to that of the design rule. The structures are those that were scanned.
    """
    check_page(page, MARKER)
    rows = list(rows_of(scanned(SCAN)))
    header = ("structure", "resonance", "reach", "best gap of the scan", "fit", "manifold")
    lines = [[row.name, str(row.resonance), *(f"{value:.3g}" for value in row[2:])] for row in rows]
    short = summary(rows)
    click.echo(f"{markdown(header, lines)}\n\n{short}")
    for file in fill_page(page, MARKER, f"{short}\n\nn = {len(rows)} structures."):
        click.echo(f"\nwritten: {file}")
