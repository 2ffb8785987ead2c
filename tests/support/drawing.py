"""Figures as tests read them: what the artists hold, in the units of the axes."""

from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.figure import Figure


def saved_figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return a list that gets every figure which is saved from now on."""
    figures: list[Figure] = []
    save = Figure.savefig

    def savefig(figure: Figure, *arguments: Any, **options: Any) -> Any:
        figures.append(figure)
        return save(figure, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", savefig)
    return figures


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of the one line whose label begins so."""
    (drawn,) = (each for each in axes.get_lines() if str(each.get_label()).startswith(label))
    return np.asarray(drawn.get_xdata(), float), np.asarray(drawn.get_ydata(), float)


def lines(axes: Axes) -> list[np.ndarray]:
    """Return the points (2, K) of every line, in the order of drawing."""
    return [np.array(each.get_data(), dtype=float) for each in axes.get_lines()]


def labelled_lines(axes: Axes) -> list[tuple[np.ndarray, str]]:
    """Return points (2, K) and label of every line, in the order of drawing."""
    return [
        (points, str(each.get_label()))
        for points, each in zip(lines(axes), axes.get_lines(), strict=True)
    ]


def bands(axes: Axes) -> list[np.ndarray]:
    """Return abscissa, lower and upper end (3, K) of every filled band, in the order of drawing."""
    polygons = []
    for each in axes.collections:
        if isinstance(each, FillBetweenPolyCollection):
            corners = np.concatenate([path.vertices for path in each.get_paths()])
            x = np.unique(corners[:, 0])
            ends = [corners[corners[:, 0] == at, 1] for at in x]
            polygons.append(np.array([x, [y.min() for y in ends], [y.max() for y in ends]]))
    return polygons
