"""Error over the first impacts, and energy balance, over run time.

Each scene and method has its results.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from impact_env import Drive, IntegrationError, simulate
from impact_env.laws import SceneKind
from impact_env.methods import Exact, Method
from optimisation.files import markdown
from studies.accuracy import cases as shared
from studies.accuracy.cases import AccuracyCase, AccuracySettings, Cases, Row, SceneGroup
from studies.accuracy.event_driven import PeerFailedError, PeerRun, follow, scipy_integrator
from studies.study import Array
from studies.timing import measure_median_time

if TYPE_CHECKING:
    from reference import digits

NAME = "trajectory"
IMPACTS = 5  # the error is read in the widest gap between two impacts from this one on
LATEST = 9
MOST_PERIODS = 6.0
WITHOUT_IMPACTS = 2.3  # pseudo periods
LONGEST = 100.0  # pseudo periods of a timed run


@dataclass(frozen=True, eq=False)
class Truth:
    """Samples of a reference run, up to the time at which the reference ended.

    Attributes
    ----------
    time, tip : array, (S,)
        Times in s and tip displacements in m.
    relative : array, (S,) or (S, n)
        Relative displacements in m of one absorber (or none), or of n absorbers.
    states : array, (S, 2 N_m + 2 n)
        States, as `InitialState.vector`.
    impacts, impact_velocity, impact_absorber : array, (K,)
        Times in s of impacts and contacts up to the last sample, relative velocity before in m/s,
        and absorber.
    events : int
        Number of all events.
    complete : bool
        Whether the reference reached the end.
    """

    periods: float
    end_state: Array
    impact_time: Array


Start = tuple[AccuracyCase, Truth]
Maker = Callable[
    [float], Any
]  # makes a peer's integrator from a tolerance; what it compiles belongs to one scene and drive


def truth_of(it: AccuracyCase) -> Truth:
    """Compute the reference up to the middle of the widest interval between late impacts.

    At this time no method is close to an impact.
    """
    from reference import digits  # needs an extra

    def impact_times(run: digits.Trajectory) -> Array:
        return np.array([float(t) for t in run.impact_time])

    periods = WITHOUT_IMPACTS
    if getattr(it.scene.absorber, "walls", None) is not None:
        times = (
            impact_times(
                digits.follow(it.scene, it.drive(MOST_PERIODS), it.initial, impacts=LATEST)
            )
            / it.period
        )
        late = times[IMPACTS - 1 :]
        if len(late) > 1:
            k = int(np.argmax(np.diff(late)))
            periods = float(0.5 * (late[k] + late[k + 1]))
    ended = digits.follow(it.scene, it.drive(periods), it.initial)
    return Truth(periods, ended.end_state, impact_times(ended))


ERRORS = (
    "state_error",
    "first_impact_error_periods",
    "fifth_impact_error_periods",
    "balance_error",
)


def _row(
    start: Start,
    name: str,
    setting: float | None,
    result: list[tuple[float | None, ...]],
    us: float | None,
    note: str = "",
) -> Row:
    """Return a row: medians over the starts."""
    it, truth = start
    row: Row = {
        "scene": it.kind.name,
        "modes": it.modes,
        "method": name,
        "setting": setting,
        "compared_periods": truth.periods,
    }
    row |= {"impacts": len(truth.impact_time), "starts": len(result), "us_per_period": us}
    for k, error in enumerate(ERRORS):
        earlier = [values[k] for values in result if values[k] is not None]
        row[error] = float(np.median(earlier)) if earlier else None  # type: ignore[arg-type]
    return {**row, "note": note}


def _errors(
    it: AccuracyCase, truth: Truth, state: Array, times: Array, balance: float | None
) -> tuple[float | None, ...]:
    """Return the errors named in ERRORS."""
    both = min(len(times), len(truth.impact_time))
    impacts = [
        float(abs(times[k - 1] - truth.impact_time[k - 1]) / it.period) if k <= both else None
        for k in (1, IMPACTS)
    ]
    # in the norm of energy
    distance = np.sum(it.weights * (state - truth.end_state) ** 2)
    error = float(np.sqrt(distance / np.sum(it.weights * truth.end_state**2)))
    return error, *impacts, balance


def own_row(starts: list[Start], method: Method, settings: AccuracySettings) -> Row:
    """Measure one of the package's methods. Slow runs are made from fewer starts."""
    it, truth = starts[0]
    result = []
    us = None
    note = ""
    try:
        simulate(
            it.scene, it.drive(0.01), method, initial=it.initial, record=shared.RECORD
        )  # compile
        began = time.perf_counter()
        for each, true in starts:
            response = simulate(
                each.scene,
                each.drive(true.periods),
                method,
                initial=each.initial,
                record=shared.RECORD,
            )
            result.append(
                _errors(
                    each,
                    true,
                    response.end_state,
                    response.recorded.impacts.time,
                    response.recorded.energy.relative_error,
                )
            )
            if time.perf_counter() - began > settings.patience:
                break
        us = own_time(it, method, truth.periods, settings)
    except IntegrationError as error:
        note = str(error)
    return _row(
        starts[0],
        shared.method_name(method, it.scene),
        None if isinstance(method, Exact) else method.steps_per_period,
        result,
        us,
        note,
    )


def own_time(
    it: AccuracyCase, method: Method, shortest: float, settings: AccuracySettings
) -> float:
    """Return the computing time of a pseudo period in us.

    It is the median of runs that are long enough for the clock.
    """

    def run(periods: float) -> float:
        return (
            simulate(
                it.scene, it.drive(periods), method, initial=it.initial, record=shared.BARE
            ).wall_time
            / periods
        )

    run(0.01)  # compile
    rough = run(min(shortest, 1.0))
    periods = float(np.clip(settings.timed_seconds / max(rough, 1e-9), min(shortest, 1.0), LONGEST))
    return 1e6 * measure_median_time(lambda: run(periods), settings.repeats, settings.patience)


def peer_row(
    starts: list[Start], name: str, tolerance: float, make: Maker, settings: AccuracySettings
) -> Row:
    """Measure a peer. Slow ones are run from fewer starts."""
    result = []
    us = None
    note = ""
    began = time.perf_counter()
    try:
        for it, truth in starts:
            drive = it.drive(truth.periods)
            balance = follow(it.scene, drive, it.initial, make(tolerance), energy=True).balance
            maker = make(tolerance)
            run: PeerRun = follow(it.scene, drive, it.initial, maker)
            result.append(_errors(it, truth, run.end_state, run.impact_time, balance))
            if us is None:
                us = 1e6 * _peer_time(it, drive, maker, run.wall_time, settings) / truth.periods
            if time.perf_counter() - began > settings.patience:
                break
    except PeerFailedError as error:
        note = str(error)
    return _row(starts[0], name, tolerance, result, us, note)


def _peer_time(
    it: AccuracyCase, drive: Drive, maker: Any, first: float, settings: AccuracySettings
) -> float:
    if first > settings.patience:
        return first
    return measure_median_time(
        lambda: follow(it.scene, drive, it.initial, maker).wall_time,
        settings.repeats,
        settings.patience,
    )


def peers(settings: AccuracySettings) -> list[tuple[str, float, Maker]]:
    """Return name, tolerance and maker of each peer; heyoka where it is installed."""
    if not settings.peers:
        return []
    result: list[tuple[str, float, Maker]] = [
        ("SciPy", tolerance, scipy_integrator) for tolerance in settings.scipy_tolerances
    ]
    try:
        from studies.accuracy.heyoka_peer import HeyokaRegimes
    except ModuleNotFoundError:
        return result
    return result + [
        ("heyoka", tolerance, HeyokaRegimes) for tolerance in settings.heyoka_tolerances
    ]


key = itemgetter("scene", "modes")  # of a row: its case


def cases(settings: AccuracySettings) -> Cases:
    """Return a case for each scene and number of modes."""
    every = settings.scenes_and_modes(kind.name for kind in shared.KINDS)
    return {
        (name, modes): partial(_measured, shared.kind_named(name), modes, settings)
        for name, modes in every
    }


def _measured(kind: SceneGroup, modes: int, settings: AccuracySettings) -> list[Row]:
    starts = _starts(kind, modes, settings)
    result = [own_row(starts, method, settings) for method in starts[0][0].methods(settings.steps)]
    return result + [
        peer_row(starts, name, tolerance, make, settings)
        for name, tolerance, make in peers(settings)
    ]


def _starts(kind: SceneGroup, modes: int, settings: AccuracySettings) -> list[Start]:
    """Return the starts of a scene with their references.

    A linear scene needs only one start, because it has no events that a method could resolve well
    by chance.
    """
    result = [shared.case(kind, modes)]
    if result[0].scene.kind is not SceneKind.LINEAR:
        result += [shared.case(kind, modes, number) for number in range(1, settings.starts)]
    return [(it, truth_of(it)) for it in result]


FLOOR = 1e-17  # errors below are drawn there
CEILING = 3.0
LABELS = {"state_error": "error of the state", "balance_error": "error of the energy balance"}
# scenes and numbers of modes of the figures; the files have all
MAIN = (
    ("impact, e = 1", 3),
    ("impact, e = 1", 30),
    ("impact, e = 0.7, with friction", 3),
    ("impact, e = 0.7, with friction", 30),
)
SCENES = (
    ("no absorber", 10),
    ("friction damper", 10),
    ("impact, e = 0.7, with friction", 10),
    ("compliant walls, stiff", 10),
)
STEPS_DRAWN = (20, 20000)


def trajectory_table(rows: list[Row]) -> str:
    """Return the lines of most interest; all are in the JSON file."""
    failed = [
        f"- {row['scene']}, {row['modes']} modes, {shared.named(row)}: {row['note']}"
        for row in rows
        if row["note"]
    ]
    rows = shared.select_page_rows(rows)
    own = ("Moreau", "Runge-Kutta")
    tight = {
        name: min((row["setting"] for row in rows if row["method"] == name), default=None)
        for name in ("SciPy", "heyoka")
    }
    visible = [
        row
        for row in rows
        if row["setting"] is None
        or (row["method"] in own and row["setting"] in STEPS_DRAWN)
        or row["setting"] == tight.get(row["method"])
    ]
    header = (
        "scene",
        "modes",
        "method",
        "µs per pseudo period",
        "state",
        "first impact",
        "fifth impact",
        "energy",
    )
    lines = []
    for row in visible:
        errors = ("" if row[name] is None else f"{row[name]:.1e}" for name in ERRORS)
        lines.append(
            (
                row["scene"],
                str(row["modes"]),
                shared.named(row),
                shared.number(row["us_per_period"], 3),
                *errors,
            )
        )
    return markdown(header, lines) + ("\n\nNot finished:\n\n" + "\n".join(failed) if failed else "")


def draw_cells(
    all_rows: list[Row], value: str, chosen: tuple[tuple[str, int], ...], title: str
) -> Figure:
    """Draw a value over the computing time of a pseudo period.

    Each of the chosen scenes and numbers of modes has a panel.
    """
    cells = shared.choose_cells(all_rows, chosen)
    all_rows = [row for row in all_rows if (row["scene"], row["modes"]) in cells]
    figure, panels = shared.panel_grid(cells, share=True)
    for panel, (scene, count) in zip(panels.flat, cells, strict=False):
        rows = [row for row in all_rows if row["scene"] == scene and row["modes"] == count]
        _panel(panel, rows, value)
    shared.label_edges(panels, "time of a pseudo period, µs", LABELS[value])
    visible = [
        name
        for name in shared.LOOKS
        if any(row["method"] == name for row in all_rows)
        and (name != "closed form" or len(cells) == 1)
    ]
    closed = any(row["method"] == "closed form" for row in all_rows)
    names = {"Exact": "Exact (closed form where there are no events)"} if closed else {}
    handles = [
        Line2D(
            [],
            [],
            color=shared.LOOKS[name][0],
            marker=shared.LOOKS[name][1],
            lw=1,
            ls=_line(name),
            label=names.get(name, name),
        )
        for name in visible
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(title, fontsize=12)
    return figure


def _panel(panel: Axes, cell: list[Row], value: str) -> None:
    for name in shared.unique(row["method"] for row in cell):
        points = [
            (row["us_per_period"], row[value])
            for row in cell
            if row["method"] == name and row[value] is not None and row["us_per_period"]
        ]
        if points:
            x, y = np.array(sorted(points)).T
            colour, marker = shared.LOOKS[name]
            size = 7 if name in ("Exact", "closed form") else 4.5
            panel.plot(
                x,
                np.clip(y, FLOOR, CEILING),
                marker=marker,
                ls=_line(name),
                color=colour,
                ms=size,
                lw=1,
                clip_on=False,
            )
    panel.set(xscale="log", yscale="log")
    panel.yaxis.set_major_locator(LogLocator(numticks=7))
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.grid(True, color="0.9", lw=0.6)
    panel.set_axisbelow(True)
    panel.set_ylim(FLOOR, CEILING)


def _line(name: str) -> str:
    """Return the style of the line that joins the settings of a method."""
    return "" if name in ("Exact", "closed form") else "-"


def trajectory_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw the errors of the state and of the energy balance in four scenes.

    A further figure has the errors after the impacts with few and with many modes.
    """
    without = f"(without impacts: after {WITHOUT_IMPACTS} pseudo periods)"
    error = f"Error of the state after {IMPACTS} to {LATEST - 1} impacts"
    figures = {
        "trajectory_error": draw_cells(all_rows, "state_error", SCENES, f"{error}\n{without}"),
        "energy_balance": draw_cells(
            all_rows, "balance_error", SCENES, "Relative error of the energy balance"
        ),
    }
    if any(row["scene"] in {scene for scene, _ in MAIN} for row in all_rows):
        figures["main"] = draw_cells(all_rows, "state_error", MAIN, error)
    return figures
