"""Computing time of a pseudo period over numbers of modes, lanes and threads.

It is also given over the length of the sweep.
"""

from collections.abc import Callable
from functools import partial
from operator import itemgetter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from impact_env import Beam, Drive, beam_scene, linear_sweep, simulate
from impact_env.ensemble import Lane, available_cores, draw_members, run_lanes
from impact_env.methods import Exact, Method, Moreau
from optimisation.files import markdown
from optimisation.report.report import figure_of, force_axis
from studies.accuracy.cases import (
    COLOURS,
    MARKERS,
    AccuracySettings,
    Cases,
    Row,
    case,
    kind_named,
    method_name,
    number,
    plain,
    unique,
)
from studies.accuracy.trajectory import own_time
from studies.timing import measure_median_time, time_call

NAME = "cost"
MODES = "modes"
LANES = "lanes"
THREADS = "threads"
LENGTH = "pseudo periods"
OVER_MODES: tuple[tuple[str, Method], ...] = (
    ("no absorber", Exact()),
    ("impact, e = 1", Exact()),
    ("impact, e = 0.7, with friction", Exact()),
    ("compliant walls, stiff", Exact()),
    ("impact, e = 1", Moreau()),
)
LANE_KIND = "impact, e = 1"
LANE_MODES = 10
LANE_PERIODS = 400.0
THREAD_LANES = 64
LENGTH_KIND = "impact, e = 1"
LENGTH_MODES = 3
LENGTH_LIMITS = (0.94, 0.98)


key = itemgetter("over", "value", "scene", "method")  # of a row: its case


def cases(settings: AccuracySettings) -> Cases:
    """Return a case for each row."""
    result: dict[tuple[str, float, str, str], Callable[[], list[Row]]] = {}

    def add(
        over: str, value: float, scene: str, modes: int, method: str, us: Callable[[], float]
    ) -> None:
        row: Row = {"over": over, "value": value, "scene": scene, "modes": modes, "method": method}
        result[over, value, scene, method] = lambda: [row | {"us_per_period": us()}]

    for name, method in OVER_MODES:
        for modes in settings.cost_modes:
            words = method_name(method, beam_scene(Beam(modes=modes), kind_named(name).absorber()))
            label = (
                f"{words}, {method.steps_per_period} steps" if isinstance(method, Moreau) else words
            )
            us = partial(
                lambda name, modes, method: own_time(
                    case(kind_named(name), modes), method, 1.0, settings
                ),
                name,
                modes,
                method,
            )
            add(MODES, modes, name, modes, label, us)
    for lanes in settings.cost_lanes:
        add(LANES, lanes, LANE_KIND, LANE_MODES, "Exact", partial(_lanes_time, lanes, 1, settings))
    cores = available_cores()
    for threads in sorted({2**k for k in range(cores.bit_length()) if 2**k <= cores} | {cores}):
        add(
            THREADS,
            threads,
            LANE_KIND,
            LANE_MODES,
            "Exact",
            partial(_lanes_time, THREAD_LANES, threads, settings),
        )
    for periods in settings.cost_periods:
        add(
            LENGTH,
            periods,
            LENGTH_KIND,
            LENGTH_MODES,
            "Exact",
            partial(_length_time, periods, settings),
        )
    return result


def _lanes_time(lanes: int, threads: int, settings: AccuracySettings) -> float:
    """Return the computing time of a pseudo period of one lane in us.

    All lanes run together through the ensemble.
    """
    kind = kind_named(LANE_KIND)
    scene = beam_scene(Beam(modes=LANE_MODES), kind.absorber())
    schedule = linear_sweep(scene.model.resonance_omega(1), 0.95, 0.95 + LANE_PERIODS / 1e4)
    wanted = [
        Lane(scene, drive)
        for drive in draw_members(lanes, settings.seed).drives(kind.force, schedule)
    ]
    run_lanes(wanted[:1], threads=1)  # compile
    taken = measure_median_time(
        partial(time_call, partial(run_lanes, wanted, threads=threads)),
        settings.repeats,
        settings.patience,
    )
    return 1e6 * taken / (lanes * LANE_PERIODS)


def _length_time(periods: float, settings: AccuracySettings) -> float:
    """Return the computing time of a pseudo period in us for a sweep of given length.

    The sweep takes ``periods`` pseudo periods through the same frequency range. Its response level
    is observed.
    """
    kind = kind_named(LENGTH_KIND)
    scene = beam_scene(Beam(modes=LENGTH_MODES), kind.absorber())
    width = float(np.diff(LENGTH_LIMITS)[0])
    schedule = linear_sweep(
        scene.model.resonance_omega(1),
        *LENGTH_LIMITS,
        percent_per_100_periods=1e4 * width / periods,
    )
    simulate(
        scene,
        Drive(kind.force, linear_sweep(scene.model.resonance_omega(1), 0.94, 0.9401)),
        Exact(),
    )  # compile
    return (
        1e6
        * measure_median_time(
            lambda: simulate(scene, Drive(kind.force, schedule), Exact()).wall_time,
            settings.repeats,
            settings.patience,
        )
        / periods
    )


def cost_table(rows: list[Row]) -> str:
    """Return the costs over modes, lanes, threads and length, a table each."""
    over_modes = [row for row in rows if row["over"] == MODES]
    counts = unique(row["value"] for row in over_modes)
    lines = []
    for scene, method in unique((row["scene"], row["method"]) for row in over_modes):
        result = {
            row["value"]: row["us_per_period"]
            for row in over_modes
            if (row["scene"], row["method"]) == (scene, method)
        }
        lines.append((f"{scene}: {method}", *(number(result.get(count), 3) for count in counts)))
    parts = (
        [markdown(("µs per pseudo period at this number of modes", *map(str, counts)), lines)]
        if lines
        else []
    )
    names = {
        LANES: "lanes, one thread",
        THREADS: "threads, 64 lanes",
        LENGTH: "pseudo periods in the sweep",
    }
    for over, name in names.items():
        result = {row["value"]: row["us_per_period"] for row in rows if row["over"] == over}
        if result:
            parts.append(
                markdown(
                    (name, *(f"{x:g}" for x in result)),
                    [("µs per pseudo period and lane", *(number(us, 3) for us in result.values()))],
                )
            )
    return "\n\n".join(parts)


def cost_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw the cost over modes, lanes, threads and length."""
    titles = {
        MODES: ("number of modes", "Number of modes"),
        LANES: ("lanes, one thread", "Number of lanes: impact, e = 1, 10 modes"),
        THREADS: ("threads", "Number of threads: impact, e = 1, 10 modes, 64 lanes"),
        LENGTH: ("pseudo periods in the sweep", "Length of the sweep: impact, e = 1, 3 modes"),
    }
    several = [
        over
        for over in titles
        if len({row["value"] for row in all_rows if row["over"] == over}) > 1
    ]  # a single value has no curve
    figure, panels = figure_of(8.4, 1.6 + 3.2 * -(-len(several) // 2), -(-len(several) // 2), 2)
    panels = np.atleast_2d(panels)
    for panel in panels.flat[len(several) :]:
        panel.remove()
    for panel, over in zip(panels.flat, several, strict=False):
        label, title = titles[over]
        rows = [row for row in all_rows if row["over"] == over]
        for k, (scene, method) in enumerate(unique((row["scene"], row["method"]) for row in rows)):
            line = [row for row in rows if (row["scene"], row["method"]) == (scene, method)]
            at = [row["value"] for row in line]
            us = [row["us_per_period"] for row in line]
            panel.plot(
                at,
                us,
                color=COLOURS[k],
                marker=MARKERS[k],
                ms=5,
                lw=1.2,
                label=f"{scene}: {method}",
            )
        panel.set(xscale="log", yscale="log", xlabel=label, ylabel="µs per pseudo period and lane")
        panel.set_title(title, fontsize=10)
        panel.grid(True, which="both", color="0.92", lw=0.6)
        if over in (THREADS, MODES) and rows:
            plain(
                panel,
                [
                    value
                    for value in unique(row["value"] for row in rows)
                    if over == THREADS or value in (1, 2, 3, 5, 10, 20, 30, 60)
                ],
            )
        _widen_axis(panel, rows)
    figure.legend(
        *panels.flat[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=2,
        frameon=False,
        title="first panel",
        fontsize=9,
    )
    return {"cost": figure}


def _widen_axis(panel: Axes, rows: list[Row]) -> None:
    """Set limits of at least a decade, so that an almost constant quantity looks constant."""
    values = [row["us_per_period"] for row in rows]
    if values and max(values) < 10 * min(values):
        middle = float(np.sqrt(min(values) * max(values)))
        panel.set_ylim(middle / 4, middle * 4)
        force_axis(panel.yaxis)
