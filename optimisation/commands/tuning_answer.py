"""Tunings of the linear absorber with the proofs of their peaks: what scripts/run tune_ltva proves, prints and writes."""

from __future__ import annotations

from pathlib import Path

import click

from optimisation.files import replacing, write_csv, write_json
from optimisation.progress import BAR, Bar
from optimisation.tuned.table import TuningTable

MARKER = "tunings"


def certificates(table: TuningTable) -> dict[str, float]:
    """Return the proved largest amplitude (m/N) of each tuning by its key; one that cannot be proved is told and left out."""
    from optimisation.convex import NotOptimalError  # needs cvxpy, which is slow to import
    from optimisation.tuned.certificate import certify

    bounds = {}
    for tuning in Bar(table.tunings, desc="proving", bar_format=BAR, leave=False):
        try:
            bounds[tuning.key] = certify(table.model, tuning.absorber, table.resonance, table.low, table.high).bound
        except NotOptimalError as error:  # its cell stays empty: the others are none the worse for it
            click.echo(f"Not proved, {tuning.label}: {error}", err=True)
    return bounds


def write(out: Path, table: TuningTable, bounds: dict[str, float]) -> list[Path]:
    """Write the figure and the tables into a folder, and return the files."""
    from optimisation.report.tuning_report import COLUMNS, rows, save_figure, summary  # matplotlib is slow to import

    files = [out / name for name in ("tunings.csv", "summary.json", "tunings.png")]
    write_csv(files[0], COLUMNS, rows(table, bounds))
    write_json(files[1], summary(table, bounds))
    with replacing(files[2]) as temporary:
        save_figure(temporary, table)
    return files
