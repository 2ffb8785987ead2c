"""The jump of the paper's two-mode absorber: share of downward sweeps that reach the high branch, against the sweep's slowness and the method."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from accuracy.statistics import clopper_pearson, wilson
from accuracy.study import Row, Settings
from impact_env.drive import PAPER_LIMITS, linear_sweep
from impact_env.ensemble import draw_members
from impact_env.methods import Exact, Method, Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.scene import beam_scene
from impact_env.sweep import simulate

NAME = "jumps"
FORCE, FRICTION = 1.5, 0.025  # N
HIGH = 0.75e-3  # m: between the two branches, which lie at about 0.5e-3 and 1.0e-3


def _methods(settings: Settings) -> list[Method]:
    return [Exact(), *(Moreau(steps) for steps in settings.jump_steps)]


def count(settings: Settings) -> int:
    return len(settings.jump_rates) * (1 + len(settings.jump_steps))


def rows(settings: Settings) -> Iterator[list[Row]]:
    """Yield the rows, one for each run, of one slowness and method after the other."""
    scene = beam_scene(Beam(modes=2), impact_absorber(friction_limit=FRICTION))
    low, high = PAPER_LIMITS
    members = draw_members(settings.jump_members, settings.seed)
    for slowness in settings.jump_rates:
        schedule = linear_sweep(scene.model.resonance_omega(1), high, low, percent_per_100_periods=100 / slowness)
        for method in _methods(settings):
            found = []
            for member, drive in enumerate(members.drives(FORCE, schedule)):
                level = simulate(scene, drive, method).level
                assert level is not None
                found.append(
                    {
                        "periods_per_percent": slowness,
                        "method": "Exact" if isinstance(method, Exact) else "Moreau",
                        "setting": None if isinstance(method, Exact) else method.steps_per_period,
                        "member": member,
                        "level_m": level.value,
                    }
                )
            yield found


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
        return self.hits / self.runs

    @property
    def wilson(self) -> tuple[float, float]:
        return wilson(self.hits, self.runs)

    @property
    def clopper_pearson(self) -> tuple[float, float]:
        return clopper_pearson(self.hits, self.runs)


def shares(all_rows: list[Row]) -> list[Share]:
    cells: dict[tuple[float, str, float | None], list[float]] = {}
    for row in all_rows:
        cells.setdefault((row["periods_per_percent"], row["method"], row["setting"]), []).append(row["level_m"])
    result = []
    for (slowness, method, setting), levels in cells.items():
        values = np.array(levels)
        between = int(np.sum(np.abs(values - HIGH) < 0.1 * HIGH))
        result.append(Share(slowness, method, setting, int(np.sum(values > HIGH)), len(values), between))
    return result
