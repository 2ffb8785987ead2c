"""Birth and merger of isolas over restitution, friction and number of modes: what becomes of them as impacts lose energy and modes take it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.modes import ModalModel
from impact_env.parameters import count, require
from impact_env.periodic.case import Case
from impact_env.periodic.fold_map import BIRTH, MERGER, map_frequencies
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.isolas import thresholds
from impact_env.periodic.keeping import Keep, anew
from impact_env.periodic.symmetric import fold_force

Real = NDArray[np.float64]
COLUMNS = ("modes", "restitution", "friction_limit_N", "kind", "force_N", "omega_ratio", "orbit")


@dataclass(frozen=True)
class Level:
    """A birth or a merger (``kind``) at a force in N and a frequency ratio; ``refused``: why it is no orbit, else empty."""

    kind: str
    force: float
    omega_ratio: float
    refused: str = ""


@dataclass(frozen=True, eq=False)
class IsolaCell:
    """Births and mergers at a number of modes, a restitution and a friction limit in N, in the order of frequency."""

    modes: int
    restitution: float
    friction_limit: float
    found: tuple[Level, ...]

    @property
    def pair(self) -> tuple[Level | None, Level | None]:
        """Birth and merger of the isola next to the resonance: the last merger, and the last birth at a lower frequency; None where there is none."""
        mergers = [t for t in self.found if t.kind == MERGER]
        if not mergers:
            return None, None
        births = [t for t in self.found if t.kind == BIRTH and t.omega_ratio < mergers[-1].omega_ratio]
        return (births[-1] if births else None), mergers[-1]

    def rows(self) -> list[tuple[object, ...]]:
        """Return a row of `COLUMNS` for each: "orbit" is "yes", or why the exact method refuses it."""
        own = (self.modes, self.restitution, self.friction_limit)
        return [(*own, level.kind, level.force, level.omega_ratio, level.refused or "yes") for level in self.found]

    def to_plain(self) -> dict[str, Any]:
        """Return names and plain values."""
        return asdict(self)

    @staticmethod
    def from_plain(plain: dict[str, Any]) -> IsolaCell:
        """Return the cell of `to_plain`."""
        levels = tuple(Level(**level) for level in plain["found"])
        return IsolaCell(int(plain["modes"]), float(plain["restitution"]), float(plain["friction_limit"]), levels)


def cell_of(case: Case, low: float, high: float) -> IsolaCell:
    """Return the births and mergers of a case between two ratios of its first resonance."""
    levels = [Level(t.kind, t.force, t.omega_ratio, t.orbit.reason if isinstance(t.orbit, NoOrbit) else "") for t in thresholds(case, low, high)]
    return IsolaCell(case.model.modes, case.restitution, case.friction_limit, tuple(levels))


@dataclass(frozen=True, eq=False)
class IsolaMap:
    """Fold force (m,) in N over ``omega_ratio`` (m,) of one case, and the cells of the map; ``complete`` is False after Ctrl-C."""

    case: Case
    omega_ratio: Real
    fold_force: Real
    own: IsolaCell
    cells: tuple[IsolaCell, ...]
    complete: bool

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings."""
        return {
            "scene": str(self.case.scene),
            "complete": self.complete,
            "thresholds": [dict(zip(COLUMNS, row, strict=True)) for row in self.own.rows()],
            "fold_force": {"omega_ratio": self.omega_ratio.tolist(), "force_N": [float(f) if np.isfinite(f) else None for f in self.fold_force]},
            "map": [dict(zip(COLUMNS, row, strict=True)) for cell in self.cells for row in cell.rows()],
        }


def truncated(model: ModalModel, modes: int) -> ModalModel:
    """Return the model with its first ``modes`` modes; raises ParameterError if it has fewer."""
    count("modes", modes, 1, model.modes)
    return ModalModel(model.omega[:modes], model.damping_ratio[:modes], model.force_shape[:modes], model.tip_shape[:modes], model.beam_mass)


def isola_map(
    case: Case,
    low: float,
    high: float,
    modes: Sequence[int],
    restitutions: Sequence[float],
    progress: Callable[[int, int], None] | None = None,
    limits: Sequence[float] = (),
    keep: Keep = anew,
) -> IsolaMap:
    """Return the fold force of a case between two ratios of its first resonance, its thresholds, and those of a map.

    The map is over numbers of modes, restitutions and friction ``limits`` in N (none: the case's own). The case's own model has the largest number of
    modes that is asked for. ``keep`` takes finished cells and gives them back. Ctrl-C ends it with what is known so far. Raises ParameterError.
    """
    require(0 < low < high, "frequency range", (low, high), "two ratios of the resonance frequency above 0, the lower one first")
    omegas = map_frequencies(case, low, high)
    models = [truncated(case.model, n) for n in modes]
    mass = case.mass_ratio * case.model.beam_mass
    friction = limits or (case.friction_limit,)
    points = [
        Case(model, case.omega, case.force, case.gap, e, limit, mass / model.beam_mass)
        for model in models
        for limit in friction
        for e in restitutions
    ]

    def cell(at: Case) -> Iterator[IsolaCell]:
        name = {"modes": at.model.modes, "restitution": at.restitution, "friction_limit": at.friction_limit, "range": [low, high]}
        return keep(name, lambda: iter([cell_of(at, low, high)]), IsolaCell.from_plain)

    (own,) = cell(case)
    cells: list[IsolaCell] = []
    complete = True
    try:
        for at in points:
            cells += cell(at)
            if progress is not None:
                progress(len(cells), len(points))
    except KeyboardInterrupt:
        complete = False
    return IsolaMap(case, omegas / float(case.model.omega[0]), fold_force(case, omegas), own, tuple(cells), complete)
