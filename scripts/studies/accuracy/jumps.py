"""The jump of the paper's two-mode absorber: share of downward sweeps that reach the high branch, against the sweep's slowness and the method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from impact_env.drive import PAPER_LIMITS, linear_sweep
from impact_env.ensemble import draw_members
from impact_env.methods import Exact, Method, Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.scene import beam_scene
from impact_env.sweep import simulate
from studies.accuracy.settings import Cases, Row, Settings
from studies.accuracy.statistics import clopper_pearson, wilson

NAME = "jumps"
FORCE, FRICTION = 1.5, 0.025  # N
HIGH = 0.75e-3  # m: between the two branches, which lie at about 0.5e-3 and 1.0e-3


def _methods(settings: Settings) -> list[Method]:
    return [Exact(), *(Moreau(steps) for steps in settings.jump_steps)]


def key(row: Row) -> tuple[float, str, float | None]:
    """Return slowness, method and its setting."""
    return row["periods_per_percent"], row["method"], row["setting"]


def cases(settings: Settings) -> Cases:
    """Return a case for each slowness and method."""
    return {
        (slowness, *_names(method).values()): partial(_measured, slowness, method, settings)
        for slowness in settings.jump_rates
        for method in _methods(settings)
    }


def _names(method: Method) -> Row:
    return {"method": "Exact", "setting": None} if isinstance(method, Exact) else {"method": "Moreau", "setting": method.steps_per_period}


def _measured(slowness: float, method: Method, settings: Settings) -> list[Row]:
    """Return a row for each run."""
    scene = beam_scene(Beam(modes=2), impact_absorber(friction_limit=FRICTION))
    low, high = PAPER_LIMITS
    members = draw_members(settings.jump_members, settings.seed)
    schedule = linear_sweep(scene.model.resonance_omega(1), high, low, percent_per_100_periods=100 / slowness)
    found = []
    for member, drive in enumerate(members.drives(FORCE, schedule)):
        level = simulate(scene, drive, method).level
        assert level is not None
        found.append({"periods_per_percent": slowness, **_names(method), "member": member, "level_m": level.value})
    return found


@dataclass(frozen=True)
class Share:
    """Share of the runs that reach the high branch, with both 95 % intervals; ``between`` counts levels close to the limit between the branches."""

    slowness: float
    method: str
    setting: float | None
    hits: int
    runs: int
    between: int

    @property
    def share(self) -> float:
        """Share of the runs."""
        return self.hits / self.runs

    @property
    def wilson(self) -> tuple[float, float]:
        """Wilson's interval."""
        return wilson(self.hits, self.runs)

    @property
    def clopper_pearson(self) -> tuple[float, float]:
        """The exact interval."""
        return clopper_pearson(self.hits, self.runs)


def shares(all_rows: list[Row]) -> list[Share]:
    """Return the share for each slowness and method, in the order of the rows."""
    cells: dict[tuple[float, str, float | None], list[float]] = {}
    for row in all_rows:
        cells.setdefault((row["periods_per_percent"], row["method"], row["setting"]), []).append(row["level_m"])
    result = []
    for (slowness, method, setting), levels in cells.items():
        values = np.array(levels)
        between = int(np.sum(np.abs(values - HIGH) < 0.1 * HIGH))
        result.append(Share(slowness, method, setting, int(np.sum(values > HIGH)), len(values), between))
    return result
