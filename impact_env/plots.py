"""Figures of responses and curves, for notebooks.

matplotlib is imported when a figure is drawn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes

Array = NDArray[np.float64]
MM = 1e3


def axes_or_new(axes: Axes | None) -> Axes:
    """Return the given axes, or new axes of pyplot."""
    if axes is not None:
        return axes
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=(6.4, 3.6), layout="constrained")[1]


def plot_curve(
    forces: Array,
    median: Array,
    band: Array,
    axes: Axes | None,
    label: str | None,
    options: dict[str, Any],
) -> Axes:
    """Draw the median level (F,) in m over the force (F,) in N, with a band (2, F) in m.

    Scales are logarithmic, so forces and levels of 0 are left out.
    """
    axes = axes_or_new(axes)
    (line,) = axes.loglog(forces, MM * median, label=label, **options)
    axes.fill_between(forces, *(MM * band), color=line.get_color(), alpha=0.25, lw=0)
    axes.set_xlabel("amplitude of the force in N")
    axes.set_ylabel("response level in mm (RMS)")
    axes.grid(visible=True, which="both", lw=0.3)
    if label is not None:
        axes.legend(frameon=False)
    return axes


def plot_envelope(
    x: Array,
    low: Array,
    high: Array,
    level: tuple[float, float] | None,
    swept: bool,
    axes: Axes | None,
    options: dict[str, Any],
) -> Axes:
    """Draw an envelope (B,) in m and the response level, a place on the abscissa and a value in m.

    The abscissa ``x`` (B,) is the frequency ratio of a sweep, or the time in s.
    """
    axes = axes_or_new(axes)
    axes.fill_between(x, MM * low, MM * high, lw=0.3, **options)
    if level is not None:
        place, value = level
        label = f"level {MM * value:.3g} mm"
        axes.plot(place, MM * value, "o", mfc="none", color="k", label=label)
        axes.legend(frameon=False)
    axes.set_xlabel("frequency over the resonance's" if swept else "time in s")
    axes.set_ylabel("displacement in mm")
    axes.grid(visible=True, lw=0.3)
    return axes


def plot_waterfall(
    x: Array, rms: Array, swept: bool, axes: Axes | None, options: dict[str, Any]
) -> Axes:
    """Draw the RMS displacement (B, N) in m of each sector as a colour over ``x`` (B,).

    ``x`` is the frequency ratio of a sweep, or the time in s.
    """
    axes = axes_or_new(axes)
    sectors = np.arange(rms.shape[1])
    mesh = axes.pcolormesh(x, sectors, MM * rms.T, **{"shading": "nearest"} | options)
    axes.figure.colorbar(mesh, ax=axes, label="displacement in mm (RMS)")
    axes.set_xlabel("frequency over the resonance's" if swept else "time in s")
    axes.set_ylabel("sector")
    return axes
