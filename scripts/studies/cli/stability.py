"""Results of every method for stiff and extreme cases, and for very long runs.

Step limits and the eigenproblem are tested as well. The tables show which cases are correct, which
are refused and which fail.
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, fields
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from impact_env.ensemble import available_cores
from optimisation.checkpoint import sources
from optimisation.cli.common import command
from optimisation.executors import Pool
from optimisation.files import markdown, publication_folder
from optimisation.report.report import write_figure
from studies.stability.cells import FAILED, GOOD, REFUSED, WEAK, Cell
from studies.stability.tasks import failures, finished, gather, tasks
from studies.study import (
    CsvTable,
    Json,
    Measurement,
    Part,
    Steps,
    Study,
    format_table,
    paths_with_page,
    run,
)

NAME = "stability"
COMPILE_S = 240.0  # at most, for the kernels of a kind of scene
QUICK_OUT = Path("results/stability")
OUT = publication_folder(Path("docs/methods"), QUICK_OUT)


@dataclass(frozen=True)
class StabilitySettings:
    """Some of the cases and shorter runs, or all; number of processes."""

    quick: bool
    workers: int


def _measure(settings: StabilitySettings, earlier: Json) -> Steps:
    order = tasks(settings.quick)
    outcomes = finished(order, earlier)
    done = {(outcome.task.function, outcome.task.arguments) for outcome in outcomes}
    with closing(
        Pool(settings.workers, COMPILE_S).run(
            [task for task in order if (task.function, task.arguments) not in done]
        )
    ) as stream:
        for outcome in stream:
            outcomes.append(outcome)
            yield gather(outcomes, order)


def _steps(settings: StabilitySettings, earlier: Json) -> int:
    order = tasks(settings.quick)
    return len(order) - len(finished(order, earlier))


CELL_COLUMNS = tuple(field.name for field in fields(Cell))
LONGEST_REASON = 150
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def make_summary(measured: Measurement) -> str:
    """Return the printed text: the matrix, and all failures."""
    failed = list(failures(measured.values))
    return "\n".join(
        [
            _matrix(measured.values),
            *(f"FAILED  {line}" for line in failed),
            f"\n{len(failed)} failures",
        ]
    )


def _number(value: float | None) -> str:
    return "" if value is None else "0" if value == 0 else f"{value:.1e}"


def _worst(cells: Sequence[Json], name: str) -> str:
    return _number(max((cell[name] for cell in cells if cell[name] is not None), default=None))


def _summary(results: Json, measured: Measurement) -> str:
    counts = Counter(cell["verdict"] for cell in results["cells"])
    made = measured.conditions
    words = {
        GOOD: "good",
        WEAK: "with fewer digits",
        REFUSED: "refused with an error",
        FAILED: "failed",
    }
    parts = ", ".join(f"{counts[verdict]} {text}" for verdict, text in words.items())
    paragraphs = [f"{len(results['cells'])} cells: {parts}. {sources(made)}"]
    paragraphs.append(
        f"Wall time {made.get('wall_s', 0):.0f} s on {made.get('workers', '?')} processes, "
        "compiling included."
    )
    if not measured.complete:
        paragraphs.append("**Stopped early or a quick look: not all of the report.**")
    if failed := list(failures(results)):
        paragraphs += ["", "Failures:", "", *(f"- {line}" for line in failed)]
    return "\n".join(paragraphs)


def _matrix(results: Json) -> str:
    header = (
        "group and method",
        "cells",
        GOOD,
        WEAK,
        REFUSED,
        FAILED,
        "worst balance",
        "penetration",
        "from reference",
        "finer step",
        "slowest, s",
    )
    rows = []
    for group in dict.fromkeys(cell["group"] for cell in results["cells"]):
        for method in dict.fromkeys(cell["method"] for cell in results["cells"]):
            some = [
                cell
                for cell in results["cells"]
                if cell["group"] == group and cell["method"] == method
            ]
            if not some:
                continue
            counts = Counter(cell["verdict"] for cell in some)
            slowest = max(
                (cell["wall_s"] for cell in some if cell["wall_s"] is not None), default=None
            )
            numbers = [str(counts[verdict] or "") for verdict in (GOOD, WEAK, REFUSED, FAILED)]
            measures = [
                _worst(some, name) for name in ("balance", "penetration", "deviation", "finer")
            ]
            rows.append(
                (
                    f"{group}, {method}",
                    str(len(some)),
                    *numbers,
                    *measures,
                    "" if slowest is None else f"{slowest:.3f}",
                )
            )
    return markdown(header, rows)


def _remarks(results: Json) -> str:
    """Return a line for each reason, with its first case and its number of cells.

    Reasons that differ only in numbers count as the same.
    """
    rows = []
    for verdict in (FAILED, WEAK, REFUSED):
        alike: dict[tuple[str, str], list[Json]] = {}
        for cell in results["cells"]:
            if cell["verdict"] == verdict:
                same = (
                    cell["group"] if verdict == REFUSED else cell["case"]
                )  # digits that are lost are told case by case
                alike.setdefault(
                    (
                        same,
                        NUMBER.sub("", cell["reason"]) if verdict == REFUSED else cell["reason"],
                    ),
                    [],
                ).append(cell)
        for some in alike.values():
            first = some[0]
            reason = first["reason"].replace("|", "/").replace("\n", " ")
            short = (
                reason if len(reason) <= LONGEST_REASON else reason[: LONGEST_REASON - 3] + "..."
            )
            methods = ", ".join(dict.fromkeys(cell["method"] for cell in some))
            rows.append(
                (f"{first['group']}: {first['case']}", str(len(some)), methods, verdict, short)
            )
    return (
        markdown(("first case", "cells", "methods", "verdict", "reason of the first"), rows)
        if rows
        else "None."
    )


def _limits(results: Json) -> str:
    columns = {
        "method and scene": "{method}, {what}",
        "D": "{damping_ratio:g}",
        "omega dt, theory": "{theory:.5f}",
        "omega dt, found": "{found:.5f}",
        "difference": "{off:+.1e}",
        "paper's step / limit": "{share:.3f}",
    }
    rows = []
    for x in results["limits"]:
        omega = x["omega"]
        theory = x["theory_s"]
        result = x["found_s"]
        rows.append(
            x
            | {
                "theory": theory * omega,
                "found": result * omega,
                "off": result / theory - 1,
                "share": x["paper_s"] / theory,
            }
        )
    return format_table(columns, rows)


def _stiffness(results: Json) -> str:
    some = [
        cell
        for cell in results["cells"]
        if cell["group"] == "contact stiffness" and cell["case"].startswith("1e")
    ]
    header = (
        "contact",
        "exact: balance",
        "from reference",
        "s",
        "Runge-Kutta: balance",
        "from reference ",
        "finer step",
        "s ",
    )
    rows = []
    for case in dict.fromkeys(cell["case"] for cell in some):
        by = {cell["method"]: cell for cell in some if cell["case"] == case}
        cells = [(by.get("exact", {}), name) for name in ("balance", "deviation", "wall_s")]
        cells += [
            (by.get("runge-kutta", {}), name)
            for name in ("balance", "deviation", "finer", "wall_s")
        ]
        rows.append((case, *(_number(cell.get(name)) for cell, name in cells)))
    return markdown(header, rows)


def _eigen(results: Json) -> str:
    header = (
        "elements",
        "rounding, mode 1",
        "mode 2",
        "mode 10",
        "highest",
        "elements' error, mode 1",
        "mode 2 ",
        "mode 10 ",
        "tip of mode 1",
    )
    rows = []
    for x in results["eigen"]:
        rounding, other = (
            [_number(x[name].get(mode)) for mode in ("1", "2", "10")]
            for name in ("rounding", "discretisation")
        )
        rows.append(
            (str(x["elements"]), *rounding, _number(x["highest"]), *other, _number(x["tip"]))
        )
    return markdown(header, rows)


def _soaks(results: Json) -> str:
    header = (
        "run",
        "pseudo periods",
        "balance",
        "memory, MB",
        "us per period",
        "impacts per period",
        "passed",
    )
    rows = []
    for x in results["soaks"]:
        last = len(x["lengths"]) - 1
        for k, length in enumerate(x["lengths"]):
            numbers = (
                f"{x['memory_mb'][k]:.1f}",
                f"{x['us_per_period'][k]:.2f}",
                f"{x['impacts_per_period'][k]:.2f}",
            )
            passed = "" if k < last else "yes" if x["passed"] else "NO"
            rows.append(
                ("" if k else x["name"], f"{length:,}", _number(x["balance"][k]), *numbers, passed)
            )
    return markdown(header, rows)


def _checks(results: Json) -> str:
    if not results["checks"]:
        return "Not measured yet."
    rows = [
        (x["name"], f"{x['searches']:,}", f"{x['misses']:,}", _number(x["worst"]), x["first"])
        for x in results["checks"]
    ]
    total = (f"{sum(x[name] for x in results['checks']):,}" for name in ("searches", "misses"))
    return markdown(
        ("scene", "searches", "misses", "worst", "first miss"),
        [*rows, ("all", *total, _worst(results["checks"], "worst"), "")],
    )


SECTIONS: dict[str, Callable[[Json], str]] = {
    "stability:matrix": _matrix,
    "stability:remarks": _remarks,
    "stability:limits": _limits,
    "stability:stiffness": _stiffness,
    "stability:eigenproblem": _eigen,
    "stability:soak": _soaks,
    "stability:checks": _checks,
}


def sections(measured: Measurement) -> dict[str, str]:
    """Return the page's sections by the names of their markers."""
    own = {name: text(measured.values) for name, text in SECTIONS.items()}
    return {"stability:summary": _summary(measured.values, measured)} | own


COLOURS = {"exact": "#0072B2", "moreau": "#D55E00", "runge-kutta": "#009E73"}
LABELS = {"exact": "exact", "moreau": "Moreau", "runge-kutta": "Runge-Kutta"}
SMALLEST = 1e-16
SOAK_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))


def save_figure(path: Path, results: Json) -> None:
    """Draw the report; the ending of ``path`` chooses the format."""
    figure = Figure(figsize=(8.6, 12.5), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.3, 1, 1))
    _draw_matrix(figure.add_subplot(grid[0, :]), results)
    _draw_limits(figure.add_subplot(grid[1, 0]), results)
    _draw_stiffness(figure.add_subplot(grid[1, 1]), results)
    _draw_eigen(figure.add_subplot(grid[2, 0]), results)
    _draw_soaks(figure.add_subplot(grid[2, 1]), results)
    write_figure(figure, path, 130)


def _draw_matrix(ax: Axes, results: Json) -> None:
    groups = list(dict.fromkeys(cell["group"] for cell in results["cells"]))
    generator = np.random.default_rng(0)
    offsets = {"exact": 0.25, "moreau": 0.0, "runge-kutta": -0.25}
    for cell in results["cells"]:
        y = (
            len(groups)
            - 1
            - groups.index(cell["group"])
            + offsets[cell["method"]]
            + generator.uniform(-0.09, 0.09)
        )
        colour = COLOURS[cell["method"]]
        if cell["verdict"] == FAILED:
            ax.plot(1e3 * generator.uniform(0.6, 1.6), y, "X", color="black", ms=8, zorder=4)
        elif cell["verdict"] == REFUSED:
            ax.plot(
                3e1 * 3 ** generator.uniform(-1, 1), y, "x", color=colour, ms=4, mew=1, alpha=0.8
            )
        elif cell["deviation"] is not None:
            ax.plot(max(cell["deviation"], SMALLEST), y, "o", color=colour, ms=3.2, alpha=0.7)
    ax.axvspan(6, 2e2, color="0.93", zorder=0)
    ax.set(xscale="log", xlim=(0.5 * SMALLEST, 4e3), ylim=(-1.5, len(groups) - 0.4))
    ax.set_yticks(range(len(groups)), groups[::-1])
    ticks = 10.0 ** np.arange(-16, 1, 2)
    ax.set_xticks(
        [*ticks, 3e1, 1e3],
        [*(f"$10^{{{int(np.log10(t))}}}$" for t in ticks), "refused", "failed"],
        fontsize=8,
    )
    ax.minorticks_off()
    ax.set_xlabel(
        "largest distance from an independent reference, relative, up to the first impacts"
    )
    handles = [
        Line2D([], [], marker="o", ls="", color=colour, label=LABELS[method])
        for method, colour in COLOURS.items()
    ]
    ax.legend(handles=handles, loc="lower left", fontsize=9, ncols=3)
    ax.grid(axis="x", color="0.9")
    ax.set_title("each case with each method, its usual step", fontsize=11)


def _draw_limits(ax: Axes, results: Json) -> None:
    for method in ("moreau", "runge-kutta"):
        some = sorted(
            (x for x in results["limits"] if x["method"] == method and x["what"] == "one mode"),
            key=lambda x: x["damping_ratio"],
        )
        if not some:
            continue
        ratio = np.maximum([x["damping_ratio"] for x in some], 3e-4)
        ax.plot(
            ratio,
            [x["found_s"] * x["omega"] for x in some],
            "o",
            color=COLOURS[method],
            ms=6,
            label=f"{LABELS[method]}, found",
        )
    ratio = np.geomspace(3e-4, 30, 150)
    ax.plot(
        ratio,
        2 * (np.sqrt(ratio**2 + 1) - ratio),
        color=COLOURS["moreau"],
        lw=1.2,
        label="Moreau, theory",
    )
    ax.plot(
        ratio,
        [_runge_kutta_reach(d) for d in ratio],
        color=COLOURS["runge-kutta"],
        lw=1.2,
        label="Runge-Kutta, theory",
    )
    ax.axhline(2 * np.pi / 20, color="0.4", ls="--", lw=1, label="paper's step, 20 a period")
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="damping ratio D (left end: 0)",
        ylabel=r"largest stable $\omega\,\Delta t$",
        ylim=(0.02, 6),
    )
    ax.set_title("step limit of one mode", fontsize=11)
    ax.legend(fontsize=8, loc="lower left")
    ax.grid(color="0.92")


def _runge_kutta_reach(ratio: float) -> float:
    """Return the first omega h at which the method grows."""
    s = -(ratio + np.sqrt(complex(ratio**2 - 1)))
    z = s * np.linspace(0, 4, 2001)[1:]
    outside = np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) > 1 + 1e-9
    return float(np.abs(z[np.argmax(outside)]) / np.abs(s)) if outside.any() else float("nan")


def _draw_stiffness(ax: Axes, results: Json) -> None:
    for method in ("exact", "runge-kutta"):
        for friction, marker in ((False, "o"), (True, "s")):
            some = [
                (float(cell["case"].split()[0]), cell)
                for cell in results["cells"]
                if cell["group"] == "contact stiffness"
                and cell["case"].startswith("1e")
                and cell["method"] == method
                if "3EI" in cell["case"] and ("friction" in cell["case"]) == friction
            ]
            points = sorted(
                (k, max(cell["deviation"], SMALLEST), cell["wall_s"])
                for k, cell in some
                if cell["deviation"] is not None
            )
            if points:
                k, deviation, _ = zip(*points, strict=True)
                label = LABELS[method] + (", with elastic friction" if friction else "")
                ax.plot(
                    k,
                    deviation,
                    marker=marker,
                    ms=5,
                    lw=1,
                    ls="--" if friction else "-",
                    color=COLOURS[method],
                    label=label,
                )
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="contact stiffness, in $3EI/l^3$",
        ylabel="largest relative distance",
        ylim=(1e-16, 1e6),
    )
    ax.set_title("contact stiffness", fontsize=11)
    if ax.lines:
        ax.legend(fontsize=8, loc="upper left")
    ax.grid(color="0.92")


def _draw_eigen(ax: Axes, results: Json) -> None:
    elements = [x["elements"] for x in results["eigen"]]
    for mode, colour in (("1", "#0072B2"), ("2", "#D55E00"), ("10", "#009E73")):
        for name, style, what in (
            ("rounding", "o-", "rounding"),
            ("discretisation", "--", "elements"),
        ):
            points = [
                (n, max(x[name][mode], SMALLEST))
                for n, x in zip(elements, results["eigen"], strict=True)
                if mode in x[name]
            ]
            if points:
                ax.plot(
                    *zip(*points, strict=True),
                    style,
                    color=colour,
                    ms=4,
                    lw=1.2,
                    label=f"mode {mode}, {what}",
                )
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="number of elements",
        ylabel="relative error of the frequency",
        ylim=(5e-17, 1e7),
    )
    ax.set_title("eigenproblem", fontsize=11)
    if ax.lines:
        ax.legend(fontsize=8, ncols=2, loc="upper right")
    ax.grid(color="0.92")


def _draw_soaks(ax: Axes, results: Json) -> None:
    other = ax.twinx()
    for soak, style in zip(results["soaks"], SOAK_STYLES, strict=False):
        name = next(method for method, label in LABELS.items() if soak["name"].endswith(label))
        ax.plot(
            soak["lengths"],
            np.maximum(soak["balance"], SMALLEST),
            marker="o",
            ms=4,
            ls=style,
            color=COLOURS[name],
            label=soak["name"],
        )
        other.plot(
            soak["lengths"],
            np.array(soak["memory_mb"]) - soak["memory_mb"][0],
            ls=style,
            color="0.6",
            lw=1,
        )
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="pseudo periods",
        ylabel="energy balance, relative error",
        ylim=(1e-16, 1e6),
    )
    ax.set_yticks(10.0 ** np.arange(-16, 1, 2))
    other.set(ylabel="memory beyond the shortest run's, MB (grey)", ylim=(-5, 105))
    ax.set_title("very long runs", fontsize=11)
    if ax.lines:
        ax.legend(fontsize=8, loc="upper left")
    ax.grid(color="0.92")


PART: Part[StabilitySettings] = Part(
    NAME,
    "stiff and extreme cases",
    measure=_measure,
    markers=("stability:summary", *SECTIONS),
    sections=sections,
    steps=_steps,
    tables=lambda measured: [
        CsvTable(
            NAME,
            CELL_COLUMNS,
            [[cell[column] for column in CELL_COLUMNS] for cell in measured.values["cells"]],
        )
    ],
    figures=lambda measured: {NAME: lambda path: save_figure(path, measured.values)},
    summary=make_summary,
    failures=lambda measured: list(failures(measured.values)),
)
STUDY: Study[StabilitySettings] = Study(
    (PART,), notes=lambda settings: {"workers": settings.workers, "quick": settings.quick}
)


@command()
@click.option(
    "--quick",
    is_flag=True,
    help=f"Some of the cases and shorter runs, into {QUICK_OUT} unless told otherwise.",
)
@click.option(
    "--workers", type=click.IntRange(min=1), help="Number of processes.  [default: all cores]"
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder for stability.json.gz, .csv and .png.  [default: {OUT}]",
)
@click.option(
    "--redraw",
    is_flag=True,
    help="Draw figure and page again from the folder's numbers; nothing is computed.",
)
@click.option(
    "--resume",
    is_flag=True,
    help="Go on from the stability.json.gz in the folder, if that run was stopped early.",
)
def main(quick: bool, workers: int | None, out: Path | None, redraw: bool, resume: bool) -> None:
    """Run stiff and extreme cases with every method.

    Step limits, errors of the eigenproblem and drift in very long runs are measured too.

    Each cell either comes close to an independent reference or is refused with a clear error. The
    exit code is 1 if any cell failed. Tables go into the page FOLDER.md beside the folder, if there
    is one. Under 10 minutes (--quick: under one) once the kernels are compiled. Ctrl-C ends the run
    early and leaves what is finished.
    """
    place = paths_with_page(out or (QUICK_OUT if quick else OUT), PART.markers)
    run(
        STUDY,
        StabilitySettings(quick, workers or available_cores()),
        place,
        redraw=redraw,
        resume=resume,
    )
