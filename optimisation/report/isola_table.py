"""Births and mergers of isolas as a table."""

from __future__ import annotations

from impact_env.periodic.isola_map import IsolaCell
from optimisation.report.markdown import markdown


def table(cells: tuple[IsolaCell, ...]) -> str:
    """Return a line for each birth and merger."""
    rows = [
        [str(n), f"{e:g}", f"{limit:g}", str(kind), f"{force:.6f}", f"{ratio:.6f}", str(orbit)]
        for cell in cells
        for n, e, limit, kind, force, ratio, orbit in cell.rows()
    ]
    return markdown(("modes", "restitution", "friction limit, N", "kind", "force, N", "omega/omega_1", "confirmed orbit"), rows)
