"""Error of the response level's distribution over an ensemble, against the exact method, and at matched cost."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from impact_env.drive import linear_sweep
from impact_env.ensemble import Members, draw_members
from impact_env.laws import SceneKind
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.parameters import Beam
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from studies.accuracy.cases import Kind, kind_named, method_name
from studies.accuracy.settings import Cases, Row, Settings, unique
from studies.accuracy.statistics import bootstrap, distance_at_size, mean_difference, relative_distance

NAME = "distribution"
KINDS = ("impact, e = 1", "impact, e = 0.7", "impact, e = 0.7, with friction", "compliant walls, stiff")
TRUTH = "truth"
FEWEST = 3  # runs of a method, however slow it is


def _kinds(settings: Settings) -> list[Kind]:
    return [kind_named(name) for name in KINDS if not settings.kinds or name in settings.kinds]


def _levels(
    scene: Scene, kind: Kind, method: Method, members: Members, settings: Settings, budget: float | None
) -> Iterator[tuple[int, float, float]]:
    """Yield member, level in m and run time in s, until the budget (s) is used up."""
    schedule = linear_sweep(scene.model.resonance_omega(1), *settings.sweep)
    began = time.perf_counter()
    for member, drive in enumerate(members.drives(kind.force, schedule)):
        if budget is not None and member >= FEWEST and time.perf_counter() - began > budget:
            return
        response = simulate(scene, drive, method)
        assert response.level is not None
        yield member, response.level.value, response.wall_time


def key(row: Row) -> tuple[str, int]:
    """Return scene and number of modes."""
    return row["scene"], row["modes"]


def cases(settings: Settings) -> Cases:
    """Return a case for each scene and number of modes."""
    return {(kind.name, modes): partial(_measured, kind, modes, settings) for kind in _kinds(settings) for modes in settings.modes}


def _measured(kind: Kind, modes: int, settings: Settings) -> list[Row]:
    """Return a row for each run."""
    truth, members = draw_members(settings.truth_members, settings.seed + 1), draw_members(settings.members, settings.seed)
    scene = beam_scene(Beam(modes=modes), kind.absorber())
    step_method = RungeKutta if scene.kind is SceneKind.COMPLIANT else Moreau
    plans: list[tuple[str, Method, Members]] = [(TRUTH, Exact(), truth), ("", Exact(), members)]
    plans += [("", step_method(steps), members) for steps in settings.sweep_steps]
    found = []
    for label, method, own in plans:
        list(_levels(scene, kind, method, own[:1], _short(settings), None))  # compile
        for member, level, seconds in _levels(scene, kind, method, own, settings, None if label else settings.budget):
            row: Row = {
                "scene": kind.name,
                "modes": modes,
                "method": label or method_name(method, scene),
                "setting": None if isinstance(method, Exact) else method.steps_per_period,
                "member": member,
                "level_m": level,
                "wall_s": seconds,
            }
            found.append(row)
    return found


def _short(settings: Settings) -> Settings:
    """Return settings with a sweep of one pseudo period."""
    return replace(settings, sweep=(settings.sweep[0], settings.sweep[0] + 1e-4))


@dataclass(frozen=True)
class Compared:
    """One method beside the truth. Shares are relative to the truth's mean; intervals are 95 % bootstrap intervals."""

    scene: str
    modes: int
    method: str
    setting: float | None
    levels: np.ndarray
    truth: np.ndarray
    seconds: float  # a run, median

    @property
    def mean_difference(self) -> float:
        """Difference of the means."""
        return mean_difference(self.levels, self.truth)

    def mean_interval(self) -> tuple[float, float]:
        """Return the interval of the `mean_difference`."""
        return bootstrap(mean_difference, self.levels, self.truth)

    @property
    def distance(self) -> float:
        """Distance of the distributions (W1)."""
        return relative_distance(self.levels, self.truth)

    def distance_interval(self) -> tuple[float, float]:
        """Return the interval of the `distance`."""
        return bootstrap(relative_distance, self.levels, self.truth)

    def at_cost(self, seconds: float) -> float:
        """Return the distance to expect for an ensemble that takes ``seconds``, of one run at least."""
        return distance_at_size(self.levels, self.truth, max(1, int(seconds / self.seconds)))


def compared(all_rows: list[Row]) -> list[Compared]:
    """Return each method of each scene and number of modes, in the order of the rows."""
    cells: dict[tuple[str, int, str, float | None], list[Row]] = {}
    for row in all_rows:
        cells.setdefault((row["scene"], row["modes"], row["method"], row["setting"]), []).append(row)
    truths = {key[:2]: np.array([row["level_m"] for row in cell]) for key, cell in cells.items() if key[2] == TRUTH}
    result = []
    for (scene, modes, method, setting), cell in cells.items():
        if method != TRUTH:
            levels, seconds = (np.array([row[name] for row in cell]) for name in ("level_m", "wall_s"))
            result.append(Compared(scene, modes, method, setting, levels, truths[scene, modes], float(np.median(seconds))))
    return result


def cells_of(all_rows: list[Row]) -> tuple[list[str], list[int]]:
    """Return scenes and numbers of modes."""
    return unique(row["scene"] for row in all_rows), unique(row["modes"] for row in all_rows)
