"""Which blades of a mistuned disk need an impact absorber.

The study computes the level of the worst blade of randomly mistuned disks, for each layout of
absorbers and each clearance.
"""

from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from optimisation.cli.common import command
from optimisation.files import markdown
from studies.blades.mistuned import (
    BARE,
    LAYOUTS,
    Case,
    add_disks,
    find_best,
    measure_case,
    summarise,
)
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Part,
    Saver,
    Steps,
    Study,
    add_folder_options,
    add_sources,
    run,
)

NAME = "which_blades"
DISKS = 200  # without absorbers, and with the best clearance of a layout
SCAN_DISKS = 20  # with each clearance
QUICK_DISKS = 4
LEGEND_SPACE = 1.15  # of the largest level: space above it
CLEARANCES = (0.2, 0.35, 0.6, 1.0)  # over the amplitude of the tuned disk without absorbers
QUICK_CLEARANCES = (0.35, 0.8)


class Settings(NamedTuple):
    """Numbers of random disks, and clearances."""

    disks: int  # without absorbers, and with the best clearance of each layout
    scan_disks: int  # with each clearance of each layout
    clearances: tuple[float, ...]  # over the amplitude of the tuned disk without absorbers


def count_steps(settings: Settings) -> int:
    """Return the number of steps of `measure`.

    They are the disk without absorbers, and for each layout every clearance and the further disks
    with the best clearance.
    """
    return 1 + len(LAYOUTS) * (len(settings.clearances) + 1)


def measure(settings: Settings, known: Json) -> Steps:
    """Yield the settings and all rows so far after each step.

    Each layout is measured on ``settings.scan_disks`` disks with every clearance, then on
    ``settings.disks`` disks with its best clearance. Rows of ``known`` are not measured again.
    """
    rows = {key(row): row for row in known.get("rows", ())}
    cases = [Case(BARE, 0.0)]
    cases += [Case(name, clearance) for name in LAYOUTS for clearance in settings.clearances]

    def values() -> Json:
        return {"settings": list(settings[:2]), "rows": [rows[c] for c in cases if c in rows]}

    if cases[0] not in rows:
        rows[cases[0]] = measure_case(cases[0], 0, settings.disks)
    yield values()
    for layout in LAYOUTS.values():
        own = [case for case in cases if case.layout == layout.name]
        for case in own:
            if case not in rows:
                rows[case] = measure_case(case, 0, settings.scan_disks)
            yield values()
        best = key(find_best([rows[case] for case in own])[layout.name])
        if rows[best]["drawn"] < settings.disks:
            rows[best] = add_disks(rows[best], settings.disks)
        yield values()


def key(row: Json) -> Case:
    """Return the case, layout and clearance, of a row."""
    return Case(row["layout"], row["clearance"])


def divide_rows(rows: list[Json]) -> tuple[Json, list[Json]]:
    """Return the row without absorbers, and the others."""
    (bare,) = (row for row in rows if row["layout"] == BARE)
    return bare, [row for row in rows if row["layout"] != BARE]


def band(values: list[float], digits: int = 2) -> str:
    """Return ``values`` (median, low, high) as "1.20 (1.10 to 1.31)"."""
    median, low, high = (f"{value:.{digits}f}" for value in values)
    return f"{median} ({low} to {high})"


def make_line(words: str, row: Json, bare: Json, clearance: str) -> list[str]:
    """Return the cells of a line of `make_table`, the first two of which are given.

    Levels are relative to those of the row ``bare``, the disks without absorbers.
    """
    summary = summarise(row, bare)
    return [
        words,
        clearance,
        band(summary["level"]),
        f"{summary['tuned']:.2f}",
        band(summary["amplification"]),
        f"{summary['participation'][0]:.2f}",
        str(summary["disks"]),
    ]


def make_table(measured: Measurement) -> str:
    """Return a Markdown table of the layouts, each with its best clearance."""
    bare, rows = divide_rows(measured.values["rows"])
    best = find_best(rows)
    lines = [make_line("none", bare, bare, "")]
    for layout in LAYOUTS.values():
        if layout.name in best:
            row = best[layout.name]
            lines.append(make_line(layout.words, row, bare, f"{row['clearance']:g}"))
    head = (
        "absorbers in",
        "best clearance",
        "worst blade, mistuned",
        "worst blade, tuned",
        "amplification factor",
        "participation",
        "disks",
    )
    return markdown(head, lines)


def make_figure(measured: Measurement) -> Saver:
    """Return a function that writes the figure to a path.

    The figure has level and amplification factor of the worst blade over the clearance.
    """
    bare, rows = divide_rows(measured.values["rows"])

    def save(path: Path) -> None:
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.8), layout="constrained")
        for k, layout in enumerate(LAYOUTS.values()):
            own = sorted(
                (row for row in rows if row["layout"] == layout.name),
                key=lambda row: row["clearance"],
            )
            if not own:
                continue
            x = [row["clearance"] for row in own]
            for ax, name in zip(axes, ("level", "amplification"), strict=True):
                values = np.array([summarise(row, bare)[name] for row in own])
                (line,) = ax.plot(x, values[:, 0], "o-", ms=3, color=f"C{k}", label=layout.words)
                ax.fill_between(x, values[:, 1], values[:, 2], color=line.get_color(), alpha=0.15)
        for ax, name in zip(axes, ("level", "amplification"), strict=True):
            median, low, high = summarise(bare, bare)[name]
            ax.axhline(median, color="k", ls="--", lw=1, label="no absorbers")
            ax.axhspan(low, high, color="k", alpha=0.06, lw=0)
            ax.set_xlabel("clearance over the tuned amplitude")
            ax.set_xscale("log")
            ax.set_xticks(x, [f"{value:g}" for value in x], minor=False)
            ax.minorticks_off()
            ax.grid(visible=True, lw=0.3)
        axes[0].set_ylabel(
            "level of the worst blade over that\nof the tuned disk without absorbers"
        )
        axes[1].set_ylabel("amplification factor")
        axes[0].set_ylim(top=LEGEND_SPACE * axes[0].get_ylim()[1])
        axes[0].legend(frameon=False, fontsize=8, ncols=2, loc="upper left")
        figure.savefig(path, dpi=110)
        plt.close(figure)

    return save


PART: Part[Settings] = Part(
    NAME,
    "which blades need an absorber",
    measure=measure,
    steps=lambda settings, _: count_steps(settings),
    markers=(NAME,),
    sections=lambda measured: {NAME: add_sources(make_table)(measured)},
    key_values=lambda settings: {"settings": list(settings[:2])},
    figures=lambda measured: {NAME: make_figure(measured)},
)
STUDY: Study[Settings] = Study((PART,), stopped_message="finished cases are in the file.")


@command()
@click.option("--quick", is_flag=True, help="Four disks and two clearances.")
@add_folder_options(NAME, "numbers and figures")
def main(quick: bool, redraw: bool, place: OutputPaths) -> None:
    """Compare layouts of absorbers on randomly mistuned disks.

    An interrupted run continues when the command is called again.
    """
    settings = (
        Settings(QUICK_DISKS, QUICK_DISKS // 2, QUICK_CLEARANCES)
        if quick
        else Settings(DISKS, SCAN_DISKS, CLEARANCES)
    )
    run(STUDY, settings, place, redraw=redraw)
