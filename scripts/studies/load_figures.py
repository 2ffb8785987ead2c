"""The figures of the answers about loads."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from optimisation.report.report import write_figure
from studies.study import Json

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
MARKS = "os^vDPX*"
TICKS = (0.1, 0.2, 0.5, 1.0, 2.0)


def _structures(rows: Sequence[Json]) -> list[str]:
    return list(dict.fromkeys(row["structure"] for row in rows))


def _line(
    panel: Axes,
    x: Sequence[float],
    every: Sequence[Sequence[float]],
    colour: str,
    style: str,
    label: str,
) -> None:
    low, middle, high = np.quantile(np.array(every), (0.05, 0.5, 0.95), axis=1)
    panel.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    panel.plot(x, middle, style, color=colour, label=label)


def _panels(
    rows: Sequence[Json], width: float, height: float, across: int
) -> tuple[Figure, list[tuple[str, Any]]]:
    """Return a figure, and each structure with its line of panels."""
    figure = Figure(figsize=(width, height), layout="constrained")
    structures = _structures(rows)
    return figure, list(
        zip(structures, figure.subplots(len(structures), across, squeeze=False), strict=True)
    )


def save_both(path: Path, rows: Sequence[Json]) -> None:
    """Draw the relative level in both bands, and the effect of the remedies.

    The left panels are over the free level of the higher resonance. The right ones show all
    variants at the largest higher force, with a large marker for the best of each remedy.
    """
    figure, panels = _panels(rows, 8.4, 7.0, 2)
    for structure, (left, right) in panels:
        own = [row for row in rows if row["structure"] == structure]
        shares = [row for row in own if row["group"] == "share"]
        driven = [row for row in shares if row["share"] > 0]
        for name, colour, part in (("lower", COLOURS[0], shares), ("higher", COLOURS[1], driven)):
            _line(
                left,
                [row["free_over_gap"][1] for row in part],
                [row[name] for row in part],
                colour,
                "-o",
                f"{name} resonance",
            )
        left.set_title(structure, fontsize=10)
        left.set(
            xlabel="free level of the higher resonance over the gap",
            ylabel="level over that without absorber",
            ylim=(0, None),
        )
        left.legend(frameon=False)
        tried = [row for row in own if row["higher"] is not None and row["share"] == 1.0]
        for k, group in enumerate(dict.fromkeys(row["group"] for row in tried)):
            for judged in (False, True):
                part = [
                    row for row in tried if row["group"] == group and ("judged" in row) == judged
                ]
                x, y = (
                    [float(np.median(row[name])) for row in part] for name in ("lower", "higher")
                )
                label = None if not judged else "as it is" if group == "share" else group
                right.plot(
                    x,
                    y,
                    MARKS[k],
                    color=COLOURS[k],
                    alpha=1.0 if judged else 0.35,
                    markersize=8 if judged else 4,
                    label=label,
                )
        right.axvline(1, color="black", linewidth=0.6)
        right.axhline(1, color="black", linewidth=0.6)
        right.set(
            xlim=(0, None), ylim=(0, None), xlabel="lower resonance", ylabel="higher resonance"
        )
        right.set_title(f"{structure}: what was tried", fontsize=10)
        right.legend(frameon=False, fontsize=8)
    write_figure(figure, path, 110)


def save_over_force(
    path: Path, rows: Sequence[Json], colour: str, words: tuple[str, str], style: str = "friction"
) -> None:
    """Draw the level over the force for all combinations of two parameters.

    Each value of ``colour`` has a colour, and each of the two values of ``style`` a line style,
    which ``words`` describe.

    Of rows that name a restitution, those with neither losses nor friction and those with both.
    """
    rows = [
        row
        for row in rows
        if "restitution" not in row
        or (row["restitution"], row["friction"]) in ((1.0, 0.0), (0.7, 1.0))
    ]
    figure = Figure(figsize=(8.6, 5.2), layout="constrained")
    panels = figure.subplots(1, len(_structures(rows)), sharey=True, squeeze=False)[0]
    colours, styles = (list(dict.fromkeys(row[name] for row in rows)) for name in (colour, style))
    for panel, structure in zip(panels, _structures(rows), strict=True):
        for k, value in enumerate(colours):
            for other, line_style, text in zip(styles, ("-", "--"), words, strict=True):
                part = [
                    row
                    for row in rows
                    if (row["structure"], row[colour], row[style]) == (structure, value, other)
                ]
                label = f"{value if isinstance(value, str) else f'weight {value:g}'}, {text}"
                _line(
                    panel,
                    [row["factor"] for row in part],
                    [row["ratio"] for row in part],
                    COLOURS[k],
                    line_style,
                    label,
                )
        panel.set_xscale("log")
        panel.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
        panel.xaxis.set_minor_locator(NullLocator())
        panel.set_title(structure, fontsize=10)
        panel.set_xlabel("force over the design rule's")
        panel.set_ylim(0, None)
    panels[0].set_ylabel("level over that without absorber")
    handles, labels = panels[-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    write_figure(figure, path, 110)


def _finish(figure: Figure, panels: list[tuple[str, Any]], path: Path) -> None:
    for panel in (panel for _, line in panels for panel in line):
        panel.set_ylim(0, None)
        panel.legend(frameon=False, fontsize=8)
    write_figure(figure, path, 110)


def save_random(path: Path, rows: Sequence[Json]) -> None:
    """Draw the relative RMS under random loads.

    It is drawn over the gap under three spectra, and on structures with shifted frequencies. Dashed
    lines are tuned absorbers.
    """
    figure, panels = _panels(rows, 9.0, 6.6, 2)
    for structure, (left, right) in panels:
        own = [row for row in rows if row["structure"] == structure]
        usual = [row for row in own if row["variant"] in ("as it is", "narrow", "two modes")]
        for k, row in enumerate(usual):
            _line(left, row["gaps_over_rms"], row["impact"], COLOURS[k], "-o", row["spectrum"])
            left.axhline(
                float(np.median(row["tuned"])), color=COLOURS[k], linestyle="--", linewidth=1
            )
        left.set_title(f"{structure} (broken: tuned for the spectrum)", fontsize=10)
        left.set(
            xlabel="gap over the free RMS at the absorber", ylabel="RMS over that without absorber"
        )
        shifted = own[0]["shifted"]
        shifts = [100 * float(shift) for shift in shifted]
        for name, colour, style in (("impact", COLOURS[0], "-o"), ("tuned", COLOURS[2], "--s")):
            _line(
                right,
                shifts,
                [result[name] for result in shifted.values()],
                colour,
                style,
                f"{name} absorber",
            )
        right.set_title(f"{structure}, wide band", fontsize=10)
        right.set_xlabel("all frequencies shifted by, %")
    _finish(figure, panels, path)


def save_shock(path: Path, rows: Sequence[Json]) -> None:
    """Draw the decay time over the peak of a shock, and the energy share of higher modes.

    The decay time is relative to that without absorber. Dashed lines are tuned absorbers.
    """
    figure, panels = _panels(rows, 9.0, 6.6, 2)
    for structure, (left, right) in panels:
        for k, width in enumerate(dict.fromkeys(row["width"] for row in rows)):
            own = [row for row in rows if (row["structure"], row["width"]) == (structure, width)]
            x = [row["peak_over_gap"] for row in own]
            label = f"pulse of {width:g} periods"
            _line(left, x, [row["decay"] for row in own], COLOURS[k], "-o", label)
            left.plot(x, [row["tuned"] for row in own], "--", color=COLOURS[k])
            shares = {
                row["peak_over_gap"]: [share for share in row["high_share"] if share is not None]
                for row in own
            }
            many = {
                peak: result
                for peak, result in shares.items()
                if 2 * len(result) > len(own[0]["high_share"])
            }
            if many:
                _line(
                    right,
                    list(many),
                    [
                        np.quantile(result, np.linspace(0, 1, 101)).tolist()
                        for result in many.values()
                    ],
                    COLOURS[k],
                    "-o",
                    label,
                )
        left.set_title(f"{structure} (broken: tuned for the fastest decay)", fontsize=10)
        right.set_title(f"{structure}: after ten impacts", fontsize=10)
        left.set(
            xlabel="largest free displacement over the gap",
            ylabel="decay time over that without absorber",
        )
        right.set(
            xlabel="largest free displacement over the gap",
            ylabel="share of energy in modes above the first",
        )
    _finish(figure, panels, path)


FIGURES: dict[str, Callable[[Path, Sequence[Json]], None]] = {
    "loads_both": save_both,
    "loads_random": save_random,
    "loads_gravity": partial(
        save_over_force, colour="weight", words=("no friction", "with friction")
    ),
    "loads_shock": save_shock,
    "loads_start": partial(
        save_over_force, colour="start", words=("no friction, e = 1", "with friction, e = 0.7")
    ),
}
