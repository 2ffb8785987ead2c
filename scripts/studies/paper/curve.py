"""A performance curve of this study as plain values: members' levels, and what the contacts do around each maximum, of the critical direction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import BAND, DOWN, CurveCase, PerformanceCurve, quantiles
from impact_env.ensemble import Lane, draw_members
from impact_env.methods import Exact, Method
from impact_env.parameters import require
from impact_env.periodic.stationary import Criteria
from impact_env.scene import Scene
from studies.paper.settings import Settings
from studies.paper.watched import Contacts, Seen
from studies.study import Json

Array = NDArray[np.float64]
PAUSE = Criteria().pause  # periods of the force: without such a pause within the level's window impacts are sustained


@dataclass(frozen=True, eq=False)
class Curve:
    """Forces (F,) in N and, for each member, (F, M): level in m, the larger of up and down, and of that direction what follows.

    ``at``: frequency ratio of the maximum; ``down``: 1 where it is the sweep down. ``impacts``: the larger number of both directions. The rest is NaN
    where the contacts were not looked at: largest |q_tip| in m, impacts per pseudo period and longest pause in the
    level's window, pseudo periods since the first impact.
    """

    forces: Array
    level: Array
    at: Array
    down: Array
    impacts: Array
    tip: Array
    rate: Array
    pause: Array
    before: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, np.asarray(getattr(self, field.name), dtype=np.float64))
        shapes = {getattr(self, field.name).shape for field in fields(self)[1:]}
        require(len(shapes) == 1 and self.level.shape[:1] == self.forces.shape, "curve", shapes, "a row of members for each force")

    @property
    def median(self) -> Array:
        """Median of the level in m, (F,)."""
        return quantiles(self.level, (0.5,))[0]

    @property
    def band(self) -> tuple[Array, Array]:
        """5 and 95 % of the level in m, (F,) each."""
        low, high = quantiles(self.level, BAND)
        return low, high

    @property
    def sustained(self) -> Array:
        """Share of the members whose impacts go on without pause around the maximum, (F,)."""
        return np.asarray(np.mean((self.pause * self.at < PAUSE) & (self.rate > 0), axis=1))

    @property
    def impacting(self) -> Array:
        """Share of the members with any impact, (F,)."""
        return np.asarray(np.mean(self.impacts > 0, axis=1))

    def relative(self, reference: Curve) -> Array:
        """Return the level over that of the same member of a reference over the same forces, (F, M)."""
        require(np.array_equal(self.forces, reference.forces), "reference", reference.forces, f"a curve over the forces {self.forces}")
        return np.asarray(self.level / reference.level)

    def nearest(self, force: float) -> int:
        """Return the number of the force next to ``force`` in N."""
        return int(np.argmin(np.abs(self.forces - force)))

    def to_plain(self) -> Json:
        """Return lists, None for NaN."""
        return {field.name: _plain(getattr(self, field.name)) for field in fields(self)}


def _plain(values: Array) -> list[Any]:
    return [_plain(row) for row in values] if values.ndim > 1 else [float(x) if np.isfinite(x) else None for x in values]


def curve_of(plain: Json) -> Curve:
    """Return the curve of its plain form."""
    return Curve(**{field.name: np.array(plain[field.name], dtype=np.float64) for field in fields(Curve)})


def plain_curve(found: PerformanceCurve) -> Json:
    """Return a performance curve without a look at its contacts."""
    lanes = found.lanes
    nothing = np.full(lanes.level.shape, np.nan)
    values = {"level": lanes.level, "at": lanes.frequency_ratio, "tip": lanes.max_tip, "impacts": lanes.impacts}
    return _critical(found.forces, values | dict.fromkeys(("rate", "pause", "before"), nothing)).to_plain()


def _critical(forces: Array, values: Mapping[str, Array]) -> Curve:
    """Return the curve of arrays (F, M, 2): up, down."""
    which = np.argmax(values["level"], axis=-1)[..., None]
    own = {name: np.take_along_axis(array, which, axis=-1)[..., 0] for name, array in values.items()}
    own["impacts"] = np.max(values["impacts"], axis=-1)
    return Curve(forces, down=which[..., 0] == DOWN, **own)


def curves(settings: Settings, label: str, scenes: Mapping[str, Scene], forces: Sequence[float], members: int, method: Method | None = None) -> Json:
    """Return the plain performance curve of each scene near its first resonance."""
    cases = [CurveCase(scene, np.array(forces)) for scene in scenes.values()]
    return {name: plain_curve(found) for name, found in zip(scenes, settings.curves(label, cases, members, method), strict=True)}


def watched_curve(settings: Settings, label: str, scene: Scene, forces: Sequence[float], members: int, method: Method | None = None) -> Json:
    """Return the plain performance curve of a scene near its first resonance, with a look at its contacts."""
    case, drawn = CurveCase(scene, np.array(forces)), draw_members(members, settings.seed)
    method = Exact() if method is None else method
    lanes = [Lane(scene, drive) for force in case.forces for schedule in case.schedules() for drive in drawn.drives(float(force), schedule)]
    seen = settings.each(label, lanes, Contacts(method), method)
    shape = (len(case.forces), 2, members)
    arrays = {name: np.array([one[k] for one in seen]).reshape(shape).transpose(0, 2, 1) for k, name in enumerate(Seen._fields)}
    return _critical(case.forces, arrays).to_plain()


def force_grid(low: float, high: float, points: int, also: Sequence[float] = ()) -> tuple[float, ...]:
    """Return rising forces in N, evenly spaced on a logarithmic axis, with some more among them."""
    return tuple(sorted({*np.round(np.geomspace(low, high, points), 6).tolist(), *also}))
