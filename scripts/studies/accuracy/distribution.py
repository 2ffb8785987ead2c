"""Error of the distribution of response levels of an ensemble, at matched cost.

The distributions of other methods are compared with that of the exact method.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter

import numpy as np
import scipy.stats
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from impact_env import Beam, Scene, beam_scene, linear_sweep, simulate
from impact_env.ensemble import Members, draw_members
from impact_env.laws import SceneKind
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from optimisation.files import markdown
from optimisation.report.report import force_axis
from studies.accuracy import cases as shared
from studies.accuracy.cases import AccuracySettings, Cases, Row, SceneGroup
from studies.study import Array

NAME = "distribution"
KINDS = (
    "impact, e = 1",
    "impact, e = 0.7",
    "impact, e = 0.7, with friction",
    "compliant walls, stiff",
)
TRUTH = "truth"
FEWEST = 3  # runs of a method, however slow it is


def _levels(
    scene: Scene,
    kind: SceneGroup,
    method: Method,
    members: Members,
    settings: AccuracySettings,
    budget: float | None,
) -> Iterator[tuple[int, float, float]]:
    """Yield member, level in m and run time in s, until the budget (s) is used up."""
    schedule = linear_sweep(scene.model.resonance_omega(1), *settings.sweep)
    began = time.perf_counter()
    for member, drive in enumerate(members.drives(kind.force, schedule)):
        if budget is not None and member >= FEWEST and time.perf_counter() - began > budget:
            return
        response = simulate(scene, drive, method)
        yield member, response.recorded.level.value, response.wall_time


key = itemgetter("scene", "modes")  # of a row: its case


def cases(settings: AccuracySettings) -> Cases:
    """Return a case for each scene and number of modes."""
    return {
        (name, modes): partial(_measured, shared.kind_named(name), modes, settings)
        for name, modes in settings.scenes_and_modes(KINDS)
    }


def _measured(kind: SceneGroup, modes: int, settings: AccuracySettings) -> list[Row]:
    """Return a row for each run."""
    truth = draw_members(settings.truth_members, settings.seed + 1)
    members = draw_members(settings.members, settings.seed)
    scene = beam_scene(Beam(modes=modes), kind.absorber())
    step_method = RungeKutta if scene.kind is SceneKind.COMPLIANT else Moreau
    plans: list[tuple[str, Method, Members]] = [(TRUTH, Exact(), truth), ("", Exact(), members)]
    plans += [("", step_method(steps), members) for steps in settings.sweep_steps]
    short = replace(
        settings, sweep=(settings.sweep[0], settings.sweep[0] + 1e-4)
    )  # a sweep of one pseudo period
    result = []
    for label, method, own in plans:
        list(_levels(scene, kind, method, own[:1], short, None))  # compile
        for member, level, seconds in _levels(
            scene, kind, method, own, settings, None if label else settings.budget
        ):
            setting = None if isinstance(method, Exact) else method.steps_per_period
            row: Row = {
                "scene": kind.name,
                "modes": modes,
                "method": label or shared.method_name(method, scene),
                "setting": setting,
            }
            result.append(row | {"member": member, "level_m": level, "wall_s": seconds})
    return result


def bootstrap(
    statistic: Callable[[Array, Array], float], one: ArrayLike, other: ArrayLike
) -> tuple[float, float]:
    """Return the 95 % percentile interval of a statistic of two samples.

    Both samples are redrawn with replacement.
    """
    a = np.asarray(one, dtype=float)
    b = np.asarray(other, dtype=float)
    generator = np.random.default_rng(0)
    low, high = np.quantile(
        [statistic(generator.choice(a, a.size), generator.choice(b, b.size)) for _ in range(400)],
        [0.025, 0.975],
    )
    return float(low), float(high)


def mean_difference(one: Array, other: Array) -> float:
    """Return the difference of the means, relative to the other's."""
    return float(np.mean(one) / np.mean(other) - 1)


def relative_distance(one: Array, other: Array) -> float:
    """Return W1 relative to the mean of the other sample."""
    return float(scipy.stats.wasserstein_distance(one, other)) / abs(float(np.mean(other)))


def distance_at_size(sample: ArrayLike, truth: ArrayLike, size: int) -> float:
    """Return the expected distance between ``size`` runs of a method and the truth.

    It is relative to the mean of the truth, and is the mean over resamples.
    """
    values = np.asarray(sample, dtype=float)
    target = np.asarray(truth, dtype=float)
    generator = np.random.default_rng(0)
    return float(
        np.mean([relative_distance(generator.choice(values, size), target) for _ in range(200)])
    )


@dataclass(frozen=True)
class Compared:
    """The levels of one method and the reference levels."""

    scene: str
    modes: int
    method: str
    setting: float | None
    levels: np.ndarray
    truth: np.ndarray
    seconds: float  # a run, median

    def at_cost(self, seconds: float) -> float:
        """Return the expected distance for an ensemble that takes ``seconds``.

        The ensemble has at least one run.
        """
        return distance_at_size(self.levels, self.truth, max(1, int(seconds / self.seconds)))


def compared(all_rows: list[Row]) -> list[Compared]:
    """Return each method of each scene and number of modes, in the order of the rows."""
    cells: dict[tuple[str, int, str, float | None], list[Row]] = {}
    for row in all_rows:
        cells.setdefault((row["scene"], row["modes"], row["method"], row["setting"]), []).append(
            row
        )
    truths = {
        key[:2]: np.array([row["level_m"] for row in cell])
        for key, cell in cells.items()
        if key[2] == TRUTH
    }
    result = []
    for (scene, modes, method, setting), cell in cells.items():
        if method != TRUTH:
            levels, seconds = (
                np.array([row[name] for row in cell]) for name in ("level_m", "wall_s")
            )
            result.append(
                Compared(
                    scene,
                    modes,
                    method,
                    setting,
                    levels,
                    truths[scene, modes],
                    float(np.median(seconds)),
                )
            )
    return result


MATCHED_RUNS = 16  # of the exact method: the cost at which methods are compared


def distribution_table(rows: list[Row]) -> str:
    """Return a line for each method of each scene and number of modes."""
    methods = compared(shared.select_page_rows(rows))
    header = (
        "scene",
        "modes",
        "method",
        "runs",
        "ms a run",
        "mean, %",
        "95 %",
        "distance, %",
        "95 %",
        "at matched cost, %",
    )
    lines = []
    for method in methods:
        exact = next(
            m
            for m in methods
            if (m.scene, m.modes, m.setting) == (method.scene, method.modes, None)
        )
        both = (method.levels, method.truth)
        cells = list[str]()
        for statistic, form in ((mean_difference, "{:+.2f}"), (relative_distance, "{:.2f}")):
            low, high = (form.format(100 * x) for x in bootstrap(statistic, *both))
            cells += [form.format(100 * statistic(*both)), f"{low} to {high}"]
        name = shared.named({"method": method.method, "setting": method.setting})
        runs = (str(len(method.levels)), shared.number(1e3 * method.seconds, 3))
        cost = f"{100 * method.at_cost(MATCHED_RUNS * exact.seconds):.2f}"
        lines.append((method.scene, str(method.modes), name, *runs, *cells, cost))
    return markdown(header, lines)


# scenes and numbers of modes of the figure; the file has all
CELLS = (
    ("impact, e = 1", 10),
    ("impact, e = 0.7", 10),
    ("impact, e = 0.7, with friction", 10),
    ("compliant walls, stiff", 10),
)


def distribution_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw the expected distance from the truth over the computing time.

    Each line belongs to ensembles of growing size.
    """
    cells = shared.choose_cells(all_rows, CELLS)
    methods = [m for m in compared(all_rows) if (m.scene, m.modes) in cells]
    figure, panels = shared.panel_grid(cells)
    settings = sorted({m.setting for m in methods if m.setting is not None})
    for panel, (scene, count) in zip(panels.flat, cells, strict=False):
        for method in methods:
            if (method.scene, method.modes) == (scene, count):
                _ensemble_line(panel, method, settings)
        _few_ticks(panel)
    shared.label_edges(panels, "time of the ensemble, s", "distance of the distributions, %")
    named = {
        f"{m.method}, {m.setting:g} steps" if m.setting else m.method: _style(m, settings)
        for m in methods
    }
    handles = [
        Line2D([], [], color=colour, marker=marker, alpha=alpha, label=name)
        for name, (colour, marker, alpha) in named.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(
        "Distance of the response level's distribution from the exact one",
        fontsize=12,
    )
    return {"distribution": figure}


def _few_ticks(panel: Axes) -> None:
    panel.set(xscale="log", yscale="log")
    low, high = panel.get_ylim()
    if high < 10 * low:
        panel.set_ylim(np.sqrt(low * high) / np.sqrt(10), np.sqrt(low * high) * np.sqrt(10))
    for axis in (panel.xaxis, panel.yaxis):
        force_axis(axis, (1, 3))
    panel.grid(True, color="0.9", lw=0.6)
    panel.set_axisbelow(True)


def _style(method: Compared, settings: list[float]) -> tuple[str, str, float]:
    colour, marker = shared.LOOKS[method.method]
    if method.setting is None:
        return colour, marker, 1.0
    at = settings.index(method.setting)
    return (
        colour,
        ("sPX*h" if method.method == "Moreau" else "^<>vd")[at % 5],
        0.45 + 0.55 * (at + 1) / len(settings),
    )


def _ensemble_line(panel: Axes, method: Compared, settings: list[float]) -> None:
    sizes = np.unique(np.round(np.geomspace(1, len(method.levels), 6)).astype(int))
    values = [100 * method.at_cost(method.seconds * size * (1 + 1e-9)) for size in sizes]
    colour, marker, alpha = _style(method, settings)
    panel.plot(
        method.seconds * sizes,
        np.maximum(values, 1e-4),
        marker=marker,
        color=colour,
        alpha=alpha,
        ms=5,
        lw=1,
    )
