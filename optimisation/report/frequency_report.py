"""The level over the frequency as figure, chart and JSON; and the time history of a run as table, arrays or figure."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import SlidingAbsorber
from impact_env.results import require_recorded
from optimisation.files import numbers, replacing, write_csv
from optimisation.frequency_levels import NO_ABSORBER, ResonanceCurves, WorstRun
from optimisation.report.card import Chart, Curve
from optimisation.report.figures import (
    BLUE,
    GREEN,
    GREY,
    MM,
    ORANGE,
    PINK,
    SKY,
    draw_grid,
    figure_of,
    force_axis,
    write_figure,
)

Array = NDArray[np.float64]
CURVE_COLOURS = (BLUE, ORANGE, PINK, GREEN, SKY)  # of the concepts as in the figure over the force
FREQUENCY_COLUMNS = ("resonance", "force_n", "absorber", "frequency_hz", "level_m")
HISTORY_FORMATS = (".csv", ".npz", ".png", ".pdf", ".svg")
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


def frequency_files(folder: Path, parts: Sequence[ResonanceCurves]) -> dict[Path | None, object]:
    """Return figure and table of levels over the frequency, for `optimisation.files.write_files`; nothing without curves."""
    if not any(part.curves for part in parts):
        return {}
    table = (FREQUENCY_COLUMNS, frequency_rows(parts))
    figure = partial(save_frequency, parts=parts)
    return {folder / "frequency.csv": table, folder / "frequency.png": figure}


def frequency_rows(parts: Sequence[ResonanceCurves]) -> Iterator[tuple[object, ...]]:
    """Yield a row of `FREQUENCY_COLUMNS` for each point of levels over the frequency."""
    for part in parts:
        for one in part.curves:
            hertz = one.ratio * part.omega / (2 * np.pi)
            known = np.isfinite(one.level)
            for frequency, level in zip(
                hertz[known].tolist(), one.level[known].tolist(), strict=True
            ):
                yield part.resonance, part.force, one.name, frequency, level


def draw_frequency(axes: Any, part: ResonanceCurves) -> None:
    """Draw the levels over the frequency near one resonance."""
    hertz = part.omega / (2 * np.pi)
    colours = iter(CURVE_COLOURS)
    for one in part.curves:
        colour = GREY if one.name == NO_ABSORBER else next(colours)
        axes.plot(one.ratio * hertz, MM * one.level, color=colour, lw=1.8, label=one.name)
    axes.set_yscale("log")
    force_axis(axes.yaxis)
    axes.set_xlabel("frequency in Hz")
    axes.set_ylabel("level in mm (RMS)")
    axes.set_title(f"{part.force:.4g} N near resonance {part.resonance}", fontsize=10)
    draw_grid(axes)
    axes.legend(fontsize=8.5, framealpha=0.95)


def save_frequency(path: Path, parts: Sequence[ResonanceCurves]) -> None:
    """Draw levels over the frequency, a panel for each resonance; the ending of ``path`` chooses the format."""
    figure, panels = figure_of(6.4 * len(parts), 4.4, 1, len(parts))
    for axes, part in zip(np.atleast_1d(panels), parts, strict=True):
        draw_frequency(axes, part)
    write_figure(figure, path)


def history_arrays(run: WorstRun) -> dict[str, Array]:
    """Return a run's samples by the names of `COLUMNS`; of several absorbers the first, and without an absorber only the structure's."""
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
    """Write or draw the motion of a run; the ending of ``path`` chooses the format, one of `HISTORY_FORMATS`."""
    arrays = history_arrays(run)
    ending = path.suffix.lower()
    if ending == ".csv":
        columns = [values.tolist() for values in arrays.values()]
        write_csv(path, tuple(arrays), zip(*columns, strict=True))
    elif ending == ".npz":
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
    else:
        _draw_history(path, run, arrays)


def _draw_history(path: Path, run: WorstRun, arrays: dict[str, Array]) -> None:
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
    write_figure(figure, path)
