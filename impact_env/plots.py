"""Responses and curves as figures and as tables, for notebooks; matplotlib is imported when something is drawn."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_env.parameters import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from impact_env.curve import PerformanceCurve
    from impact_env.response import Response

PLOT_BINS = 600  # columns of an envelope, about those of a figure
MM = 1e3


def html_table(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return a heading and two columns of text as HTML."""
    cells = "".join(
        f'<tr><td style="text-align:left">{escape(name)}</td><td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in rows
    )
    return f"<b>{escape(title)}</b><table>{cells}</table>"


def axes_or_new(axes: Axes | None) -> Axes:
    """Return the axes to draw into: those that are given, or new ones of pyplot, which a notebook shows."""
    if axes is not None:
        return axes
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=(6.4, 3.6), layout="constrained")[1]


def plot_curve(
    curve: PerformanceCurve, axes: Axes | None, label: str | None, options: dict[str, Any]
) -> Axes:
    """Draw the median level in mm over the force in N, with the band; forces and levels of 0 have no place on these scales."""
    axes = axes_or_new(axes)
    (line,) = axes.loglog(curve.forces, MM * curve.median, label=label, **options)
    axes.fill_between(curve.forces, *(MM * curve.band), color=line.get_color(), alpha=0.25, lw=0)
    axes.set_xlabel("amplitude of the force in N")
    axes.set_ylabel("response level in mm (RMS)")
    axes.grid(visible=True, which="both", lw=0.3)
    if label is not None:
        axes.legend(frameon=False)
    return axes


def draw_columns(response: Response) -> tuple[Any, Any, Any]:
    """Return the times (B,) in s, and least and largest displacement (B,) in m around each, from what the run has recorded.

    Raises ParameterError if it has recorded neither its series nor an envelope.
    """
    history = response.history
    envelope = response.envelope
    if envelope is not None:
        return (envelope.edges[1:] + envelope.edges[:-1]) / 2, envelope.low, envelope.high
    require(
        history is not None,
        "response",
        response,
        "one that has its motion: simulate(..., record=Record(series=True)), or Record(envelope=600)",
    )
    assert history is not None
    shape = response.scene.model.level_shape
    values = history.modal_displacement @ shape
    bins = min(PLOT_BINS, len(values))
    pieces = np.array_split(np.arange(len(values)), bins) if bins > 0 else []
    return tuple(
        np.array([reduce(of[piece]) for piece in pieces])
        for reduce, of in ((np.mean, history.time), (np.min, values), (np.max, values))
    )  # type: ignore[return-value]


def plot_response(response: Response, axes: Axes | None, options: dict[str, Any]) -> Axes:
    """Draw the displacement's envelope in mm over the frequency ratio or, at a constant frequency, over time, with the level where it is read."""
    time, low, high = draw_columns(response)
    axes = axes_or_new(axes)
    schedule = response.drive.schedule
    level = response.level
    swept = np.ptp(schedule.omegas) > 0
    x = schedule.omega_at(time) / schedule.reference if swept else time
    axes.fill_between(x, MM * low, MM * high, lw=0.3, **options)
    if level is not None:
        axes.plot(
            level.frequency_ratio if swept else level.time,
            MM * level.value,
            "o",
            mfc="none",
            color="k",
            label=f"level {MM * level.value:.3g} mm",
        )
        axes.legend(frameon=False)
    axes.set_xlabel("frequency over the resonance's" if swept else "time in s")
    axes.set_ylabel("displacement in mm")
    axes.grid(visible=True, lw=0.3)
    return axes
