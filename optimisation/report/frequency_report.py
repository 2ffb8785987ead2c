"""Level over the frequency as figure, chart and JSON, and a run's time history.

The time history is a table, arrays or a figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import SlidingAbsorber
from impact_env.results import require_recorded
from optimisation.files import numbers, replacing, write_csv
from optimisation.frequency_levels import ResonanceCurves, WorstRun
from optimisation.report.report import (
    BLUE,
    GREY,
    MM,
    ORANGE,
    Chart,
    Curve,
    Draw,
    Table,
    draw_charts,
    draw_grid,
    figure_of,
    write_drawing,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
COLUMNS = (
    "time_s",
    "frequency_hz",
    "displacement_m",
    "absorber_place_m",
    "absorber_relative_m",
)
DETAIL_PERIODS = 6  # to either side of the largest displacement
MOST_COLUMNS = 2000  # of the drawing of a whole run


def frequency_charts(parts: Sequence[ResonanceCurves]) -> tuple[Chart, ...]:
    """Return a card's charts of levels over the frequency, one for each resonance."""
    return tuple(
        Chart(
            f"Level over the frequency, {part.force:.4g} N near resonance {part.resonance}",
            "frequency in Hz",
            "level in mm (RMS)",
            tuple(
                Curve(
                    one.name,
                    numbers(one.ratio * part.omega / (2 * np.pi)),
                    numbers(MM * one.level),
                )
                for one in part.curves
            ),
            log_y=True,
        )
        for part in parts
        if part.curves
    )


def frequency_tables(parts: Sequence[ResonanceCurves]) -> dict[str, Table]:
    """Return the table of levels over the frequency by its file's name; nothing without curves."""
    rows = []
    for part in parts:
        for one in part.curves:
            hertz = one.ratio * part.omega / (2 * np.pi)
            known = np.isfinite(one.level)
            points = zip(hertz[known].tolist(), one.level[known].tolist(), strict=True)
            rows += [(part.resonance, part.force, one.name, *point) for point in points]
    columns = ("resonance", "force_n", "absorber", "frequency_hz", "level_m")
    return {"frequency.csv": Table.of_values(columns, rows)} if rows else {}


def frequency_figures(parts: Sequence[ResonanceCurves]) -> dict[str, Draw]:
    """Return the figure of levels over the frequency by its file's name; nothing without curves."""
    if not any(part.curves for part in parts):
        return {}
    return {"frequency.png": partial(draw_charts, frequency_charts(parts))}


def history_arrays(run: WorstRun) -> dict[str, Array]:
    """Return a run's samples by the names of `COLUMNS`.

    For several absorbers they are those of the first one, and without absorber those of the
    structure alone.
    """
    response = run.response
    history = require_recorded("history", response.history)
    model = response.scene.model
    place = history.modal_displacement @ response.scene.absorber_shapes[0]
    arrays = {
        "time_s": history.time,
        "frequency_hz": np.asarray(response.drive.schedule.omega_at(history.time)) / (2 * np.pi),
        "displacement_m": history.modal_displacement @ model.level_shape,
    }
    if response.scene.absorber is not None:
        absorber = np.reshape(history.absorber_displacement, (len(place), -1))[:, 0]
        arrays |= {"absorber_place_m": place, "absorber_relative_m": absorber - place}
    return arrays


def save_history(path: Path, run: WorstRun) -> None:
    """Write or draw the motion of a run.

    The ending of ``path`` determines the format, one of `HISTORY_FORMATS`.
    """
    arrays = history_arrays(run)
    ending = path.suffix.lower()
    if ending == ".csv":
        columns = [values.tolist() for values in arrays.values()]
        write_csv(path, tuple(arrays), zip(*columns, strict=True))
    elif ending == ".npz":
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
    else:
        write_drawing(path, partial(draw_history, run, arrays))


def draw_history(run: WorstRun, arrays: dict[str, Array]) -> Figure:
    """Draw the whole run, and some periods around its largest displacement."""
    time = arrays["time_s"]
    moved = MM * arrays["displacement_m"]
    relative = arrays.get("absorber_relative_m")
    figure, panels = figure_of(9, 6.4, 2, 1)
    whole, detail = np.ravel(panels)

    step = max(1, len(time) // MOST_COLUMNS)
    starts = np.arange(0, len(time), step)
    low = np.minimum.reduceat(moved, starts)
    high = np.maximum.reduceat(moved, starts)
    whole.fill_between(time[starts], low, high, color=BLUE, lw=0.6)
    whole.set_ylabel("displacement in mm")
    hertz = arrays["frequency_hz"]
    words = f"{hertz[0]:.4g} to {hertz[-1]:.4g} Hz"
    whole.set_title(f"{run.words}, {words}", fontsize=10)

    at = int(np.argmax(np.abs(moved)))
    half = DETAIL_PERIODS * 2 * np.pi / run.response.drive.schedule.reference
    near = np.abs(time - time[at]) <= half
    whole.axvspan(*time[near][[0, -1]], color=ORANGE, alpha=0.35, lw=0)
    detail.plot(time[near], moved[near], color=BLUE, lw=1.6, label="where the level is read")
    if relative is not None:
        words = "absorber over its place"
        detail.plot(time[near], MM * relative[near], color=ORANGE, lw=1.2, label=words)
        absorber = run.response.scene.absorber
        walls = absorber.walls if isinstance(absorber, SlidingAbsorber) else None
        if walls is not None:
            for sign in (-1, 1):
                detail.axhline(sign * MM * walls.gap, color=GREY, lw=0.9, ls="--")
    detail.set_ylabel("displacement in mm")
    detail.legend(fontsize=8.5, ncols=2, frameon=False, loc="lower right", bbox_to_anchor=(1, 1))
    for panel in (whole, detail):
        panel.set_xlabel("time in s")
        draw_grid(panel)
    return figure
