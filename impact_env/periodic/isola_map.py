"""Birth and merger of isolas over restitution and number of modes: what becomes of them as impacts lose energy and modes take it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.modes import ModalModel
from impact_env.parameters import count, require
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.isolas import BIRTH, MERGER, Threshold, map_frequencies, thresholds
from impact_env.periodic.symmetric import fold_force

Real = NDArray[np.float64]
COLUMNS = ("modes", "restitution", "kind", "force_N", "omega_ratio", "orbit")


@dataclass(frozen=True, eq=False)
class IsolaCell:
    """Births and mergers at a number of modes and a restitution, in the order of frequency."""

    modes: int
    restitution: float
    found: tuple[Threshold, ...]

    @property
    def pair(self) -> tuple[Threshold | None, Threshold | None]:
        """Birth and merger of the isola next to the resonance: the last merger, and the last birth at a lower frequency; None where there is none."""
        mergers = [t for t in self.found if t.kind == MERGER]
        if not mergers:
            return None, None
        births = [t for t in self.found if t.kind == BIRTH and t.omega_ratio < mergers[-1].omega_ratio]
        return (births[-1] if births else None), mergers[-1]

    def rows(self) -> list[tuple[object, ...]]:
        """Return a row of `COLUMNS` for each: "orbit" is "yes", or why the exact method refuses it."""
        verdicts = [t.orbit.reason if isinstance(t.orbit, NoOrbit) else "yes" for t in self.found]
        return [(self.modes, self.restitution, t.kind, t.force, t.omega_ratio, said) for t, said in zip(self.found, verdicts, strict=True)]


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
    case: Case, low: float, high: float, modes: Sequence[int], restitutions: Sequence[float], progress: Callable[[int, int], None] | None = None
) -> IsolaMap:
    """Return the fold force of a case between two ratios of its first resonance, its thresholds, and those over numbers of modes and restitutions.

    The case's own model has the largest number of modes that is asked for. Ctrl-C ends it with what is known so far. Raises ParameterError.
    """
    require(0 < low < high, "frequency range", (low, high), "two ratios of the resonance frequency above 0, the lower one first")
    omegas = map_frequencies(case, low, high)
    own = IsolaCell(case.model.modes, case.restitution, thresholds(case, low, high))
    models = [truncated(case.model, n) for n in modes]
    cells: list[IsolaCell] = []
    complete, total = True, len(models) * len(restitutions)
    try:
        for model in models:
            for e in restitutions:
                at = Case(model, case.omega, case.force, case.gap, e, case.friction_limit, case.mass_ratio * case.model.beam_mass / model.beam_mass)
                cells.append(IsolaCell(model.modes, e, thresholds(at, low, high)))
                if progress is not None:
                    progress(len(cells), total)
    except KeyboardInterrupt:
        complete = False
    return IsolaMap(case, omegas / float(case.model.omega[0]), fold_force(case, omegas), own, tuple(cells), complete)
