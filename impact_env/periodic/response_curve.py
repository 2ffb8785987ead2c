"""A branch as a frequency response: what is reported and drawn of it, whichever method it is from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.branch import Branch
from impact_env.periodic.harmonic_balance import OMEGA, Balance

Real = NDArray[np.float64]
EXACT, HARMONIC_BALANCE = "exact orbits", "harmonic balance"


@dataclass(frozen=True)
class CurvePoint:
    """Something located on a curve: ``kind`` is "fold" and the like."""

    kind: str
    omega_ratio: float
    tip_max: float


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """Tip displacement along a branch, m points: ``omega_ratio`` (m,), ``tip_max`` and ``tip_rms`` (m,) in m.

    ``stable`` and ``slowly_stable`` (m,) of booleans, None where the method does not tell: the second leaves the fast multipliers out.
    """

    method: str
    omega_ratio: Real
    tip_max: Real
    tip_rms: Real
    located: tuple[CurvePoint, ...]
    closed: bool
    message: str
    stable: NDArray[np.bool_] | None = None
    slowly_stable: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        rows = [row for row in (self.omega_ratio, self.tip_max, self.tip_rms, self.stable, self.slowly_stable) if row is not None]
        require(len({len(row) for row in rows}) == 1, "curve", [len(row) for row in rows], "rows of one length")

    @property
    def folds(self) -> tuple[CurvePoint, ...]:
        """Turning points in the frequency."""
        return tuple(point for point in self.located if point.kind == "fold")

    @property
    def peak(self) -> CurvePoint:
        """The point with the largest displacement."""
        k = int(np.argmax(self.tip_max))
        return CurvePoint("peak", float(self.omega_ratio[k]), float(self.tip_max[k]))

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings; keys with their units."""
        marks = [{"kind": p.kind, "omega_ratio": p.omega_ratio, "tip_max_m": p.tip_max} for p in self.located]
        rows = {"omega_ratio": self.omega_ratio, "tip_max_m": self.tip_max, "tip_rms_m": self.tip_rms}
        rows |= {name: row for name, row in (("stable", self.stable), ("slowly_stable", self.slowly_stable)) if row is not None}
        return {
            "method": self.method,
            "closed": self.closed,
            "ended": self.message,
            "peak": {"omega_ratio": self.peak.omega_ratio, "tip_max_m": self.peak.tip_max},
            "located": marks,
            **{name: row.tolist() for name, row in rows.items()},
        }


def balance_curve(balance: Balance, branch: Branch, reference: float) -> ResponseCurve:
    """Return the frequency response of a branch of harmonic balance; frequencies over ``reference`` in rad/s."""
    responses = [balance.at(OMEGA, p).response(z) for z, p in zip(branch.points, branch.parameters, strict=True)]
    marks = tuple(CurvePoint(e.kind, e.parameter / reference, balance.at(OMEGA, e.parameter).response(e.point).tip_max) for e in branch.located)
    largest, rms = (np.array([getattr(r, name) for r in responses]) for name in ("tip_max", "tip_rms"))
    return ResponseCurve(HARMONIC_BALANCE, branch.parameters / reference, largest, rms, marks, branch.closed, branch.message)
