"""Compare levels of a cyclic chain with an absorber in every sector with those of the published code CC, and draw its performance curve."""

import csv
import statistics
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env.sectors import participation_ratio
from optimisation.cli.common import command
from optimisation.page import DOCS, markdown
from studies.blades.chain import (
    PERIODS,
    SAMPLES_PER_PERIOD,
    SECTORS,
    Chain,
    Step,
    count_transient,
    run_periods,
    step_frequencies,
)
from studies.study import (
    Json,
    Measurement,
    Saver,
    Study,
    add_sources,
    make_rows_part,
    not_none,
    paths_beside_page,
    run,
)

NAME = "compare_chain"
CURVE = "chain_curve"
RESPONSES = "chain_responses"
PAGE = "many_absorbers"
PEER = DOCS / PAGE / "chain_peer.csv"
COUPLING = 0.01
CLEARANCES = (0.1, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0)
STARTS = 5
QUICK_PERIODS = 30
LEVEL_TICKS = (0.05, 0.1, 0.2, 0.4)
CURVE_CASES = tuple(
    (coupling, clearance)
    for coupling in (0.01,)
    for clearance in (0.1, 0.2, 0.3, 0.45, 0.7, 1.2, 2.0)
)


class Example(NamedTuple):
    """A public example of CC: its configuration file, coupling, wave number, clearance, frequency (None: the resonance) and start."""

    name: str
    coupling: float
    wave_number: int
    clearance: float
    frequency: float | None
    start: str


EXAMPLES = (
    Example("SSMR", 0.05, 2, 0.43, None, "zero"),
    Example("ASMR", 0.05, 2, 0.43, None, "random"),
    Example("TravelingBreather", 0.01, 1, 0.15, None, "random"),
    Example("FindCoexistingSolutions_k0_1", 0.002, 1, 0.33, 0.992297, "localised"),
    Example("FindCoexistingSolutions_k0_1", 0.002, 1, 0.33, 0.992297, "random"),
)
LOCALISED_START = 1.5  # displacement of one sector over the linear amplitude


class Settings(NamedTuple):
    """Wave numbers, clearances, random starts, periods, cases of the curve, examples, and whether transients are shortened."""

    wave_numbers: tuple[int, ...]
    clearances: tuple[float, ...]
    starts: int
    periods: int
    curve: tuple[tuple[float, float], ...]
    examples: tuple[int, ...]
    quick: bool = False


def describe_step(step: Step) -> Json:
    """Return the numbers of a motion at one frequency."""
    return {
        "frequency": step.frequency,
        "amplitude": step.amplitude.round(6).tolist(),
        "deviation": step.deviation.round(6).tolist(),
        "impacts": step.impacts.round(4).tolist(),
        "kind": step.kind,
    }


def measure_levels(wave_number: int, clearance: float, settings: Settings) -> list[Json]:
    """Return the motion at the resonance with absorbers stuck, after the transient, by random start, and the time it takes."""
    chain = Chain(COUPLING, wave_number, clearance)
    transient = settings.periods if settings.quick else count_transient(chain.resonance)
    starts = []
    spent = []
    for seed in range(1, settings.starts + 1):
        began = time.process_time()
        state, _ = run_periods(
            chain, chain.resonance, transient, chain.draw_start(seed), samples=None
        )
        spent.append(1e3 * (time.process_time() - began) / transient)
        _, step = run_periods(chain, chain.resonance, settings.periods, state, SAMPLES_PER_PERIOD)
        starts.append(describe_step(not_none(step)))
    return [
        {
            "wave_number": wave_number,
            "clearance": clearance,
            "transient": transient,
            "starts": starts,
            "cpu_ms": statistics.median(spent),
        }
    ]


def measure_example(number: int, settings: Settings) -> list[Json]:
    """Return the motion of a public example after its transient, with the amplitudes of all periods."""
    example = EXAMPLES[number]
    chain = Chain(example.coupling, example.wave_number, example.clearance)
    places = np.zeros(SECTORS)
    if example.start == "localised":
        places[0] = LOCALISED_START * chain.linear_amplitude
    start = chain.draw_start(1) if example.start == "random" else chain.make_start(places)
    frequency = example.frequency or chain.resonance
    transient = settings.periods if settings.quick else count_transient(frequency)
    state, _ = run_periods(chain, frequency, transient, start, samples=None)
    _, step = run_periods(chain, frequency, settings.periods, state, SAMPLES_PER_PERIOD)
    step = not_none(step)
    amplitudes = not_none(step.by_period)
    return [
        {
            "number": number,
            "participation": float(np.mean(participation_ratio(amplitudes))),
            "amplitudes": amplitudes.round(4).tolist(),
            **describe_step(step),
        }
    ]


def measure_curve(coupling: float, clearance: float, settings: Settings) -> list[Json]:
    """Return the motion of the frequency with the highest level of the paper's 50."""
    chain = Chain(coupling, 1, clearance)
    frequencies = chain.frequencies[::16] if settings.quick else chain.frequencies
    steps = list(step_frequencies(chain, frequencies, 1, settings.periods))
    worst = max(steps, key=lambda step: step.level)
    kinds = sorted({step.kind for step in steps})
    ratio = worst.frequency / chain.resonance
    return [
        {
            "coupling": coupling,
            "clearance": clearance,
            "ratio": ratio,
            "kinds": kinds,
            **describe_step(worst),
        }
    ]


def read_peer() -> dict[tuple[int, float], Json]:
    """Return the rows of the other program by wave number and clearance."""
    with PEER.open(newline="") as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    return {(int(row["wave_number"]), row["clearance"]): row for row in rows}


def make_table(measured: Measurement) -> str:
    """Return the table of levels."""
    peer = read_peer()
    lines = []
    for row in measured.values["rows"]:
        levels = [float(np.mean(start["amplitude"])) for start in row["starts"]]
        kinds = sorted({start["kind"] for start in row["starts"]})
        other = peer.get((row["wave_number"], row["clearance"]))
        lines.append(
            [
                str(row["wave_number"]),
                f"{row['clearance']:g}",
                f"{statistics.median(levels):.4f} ({min(levels):.4f} to {max(levels):.4f})",
                ", ".join(kinds),
                "" if other is None else f"{other['amplitude']:.4f}",
                f"{row['cpu_ms']:.2f}",
            ]
        )
    head = ("wave number", "clearance", "amplitude", "response", "amplitude, CC", "ms a period")
    return markdown(head, lines)


def make_curve_table(measured: Measurement) -> str:
    """Return the table of the performance curve."""
    lines = [
        [
            f"{row['coupling']:g}",
            f"{row['clearance']:g}",
            f"{np.mean(row['amplitude']):.3f}",
            f"{row['ratio']:.4f}",
            row["kind"],
            ", ".join(row["kinds"]),
        ]
        for row in measured.values["rows"]
    ]
    head = (
        "coupling",
        "clearance",
        "largest amplitude",
        "at frequency",
        "response there",
        "responses at all frequencies",
    )
    return markdown(head, lines)


def make_example_table(measured: Measurement) -> str:
    """Return the table of the public examples."""
    lines = []
    for row in measured.values["rows"]:
        example = EXAMPLES[row["number"]]
        amplitude = np.array(row["amplitude"])
        modulation = np.mean(np.array(row["deviation"]) / amplitude)
        lines.append(
            [
                example.name,
                example.start,
                row["kind"],
                f"{amplitude.mean():.3f} ({amplitude.min():.3f} to {amplitude.max():.3f})",
                f"{modulation:.2f}",
                f"{row['participation']:.2f}",
            ]
        )
    head = ("example", "start", "response", "amplitude", "modulation", "participation")
    return markdown(head, lines)


def make_example_figure(measured: Measurement) -> Saver:
    """Return the figure of amplitudes by sector over the periods of the public examples."""
    rows = measured.values["rows"]

    def save(path: Path) -> None:
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(
            1, len(rows), figsize=(2.6 * len(rows), 3.0), layout="constrained", sharey=True
        )
        for ax, row in zip(np.atleast_1d(axes), rows, strict=True):
            example = EXAMPLES[row["number"]]
            amplitudes = np.array(row["amplitudes"]).T
            mesh = ax.pcolormesh(amplitudes, vmin=0.0, cmap="viridis", rasterized=True)
            figure.colorbar(mesh, ax=ax, orientation="horizontal")
            name = example.name.partition("_")[0]
            ax.set_title(f"{name},\n{example.start} start", fontsize=8)
            ax.set_xlabel("period")
        np.atleast_1d(axes)[0].set_ylabel("sector")
        figure.savefig(path, dpi=100)
        plt.close(figure)

    return save


def make_figure(measured: Measurement) -> Saver:
    """Return the figure of amplitudes over the clearance."""
    peer = read_peer()
    rows = measured.values["rows"]

    def save(path: Path) -> None:
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt

        figure, ax = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
        for wave in sorted({row["wave_number"] for row in rows}):
            own = [row for row in rows if row["wave_number"] == wave]
            x = [row["clearance"] for row in own]
            levels = np.array(
                [[np.mean(start["amplitude"]) for start in row["starts"]] for row in own]
            )
            ax.plot(x, np.median(levels, axis=1), "o-", ms=4, label=f"exact, wave number {wave}")
            others = [
                (clearance, row["amplitude"])
                for (number, clearance), row in peer.items()
                if number == wave
            ]
            if others:
                ax.plot(
                    *zip(*sorted(others), strict=True), "kx", ms=7, label=f"CC, wave number {wave}"
                )
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xticks(x, [f"{value:g}" for value in x])
        ax.set_yticks(LEVEL_TICKS, [f"{value:g}" for value in LEVEL_TICKS])
        ax.minorticks_off()
        ax.set_xlabel("clearance over the linear amplitude")
        ax.set_ylabel("amplitude over the linear one")
        ax.grid(visible=True, which="both", lw=0.3)
        ax.legend(frameon=False)
        figure.savefig(path, dpi=110)
        plt.close(figure)

    return save


def list_levels(settings: Settings) -> dict[Any, Any]:
    """Return a function that measures each case of the comparison."""
    return {
        (wave, clearance): partial(measure_levels, wave, clearance, settings)
        for wave in settings.wave_numbers
        for clearance in settings.clearances
    }


def list_curve(settings: Settings) -> dict[Any, Any]:
    """Return a function that measures each case of the performance curve."""
    return {case: partial(measure_curve, *case, settings) for case in settings.curve}


STUDY: Study[Settings] = Study(
    (
        make_rows_part(
            NAME,
            "levels of the cyclic chain and those of CC",
            list_levels,
            lambda row: (row["wave_number"], row["clearance"]),
            add_sources(make_table),
            told=lambda settings: {"periods": settings.periods},
            figures=lambda measured: {NAME: make_figure(measured)},
        ),
        make_rows_part(
            RESPONSES,
            "public examples of the cyclic chain",
            lambda settings: {
                number: partial(measure_example, number, settings) for number in settings.examples
            },
            lambda row: row["number"],
            add_sources(make_example_table),
            told=lambda settings: {"periods": settings.periods},
            figures=lambda measured: {RESPONSES: make_example_figure(measured)},
        ),
        make_rows_part(
            CURVE,
            "performance curve of the cyclic chain",
            list_curve,
            lambda row: (row["coupling"], row["clearance"]),
            add_sources(make_curve_table),
            told=lambda settings: {"periods": settings.periods},
        ),
    ),
    kept="finished cases are in the files.",
)


@command()
@click.option("--quick", is_flag=True, help="A clearance of each, few periods and frequencies.")
@click.option(
    "--only", multiple=True, type=click.Choice([NAME, RESPONSES, CURVE]), help="This part alone."
)
@click.option("--redraw", is_flag=True, help="Write tables and figures from existing numbers.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=DOCS,
    show_default=False,
    help="Folder of the page many_absorbers.md and of its folder of numbers and figures (default: docs).",
)
def main(quick: bool, only: tuple[str, ...], redraw: bool, out: Path) -> None:
    """Compare levels of the cyclic chain with those of the published code CC; a run that was stopped goes on when it is called again."""
    settings = (
        Settings((1,), (0.2,), 1, QUICK_PERIODS, ((0.01, 0.2),), (0,), quick=True)
        if quick
        else Settings((1, 0), CLEARANCES, STARTS, PERIODS, CURVE_CASES, tuple(range(len(EXAMPLES))))
    )
    run(STUDY, settings, paths_beside_page(out, PAGE, out / PAGE), only=only, redraw=redraw)
