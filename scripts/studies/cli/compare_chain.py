"""Compare the levels of a cyclic chain of absorbers with those of the published code CC.

Every sector of the chain has an absorber. The performance curve of the chain is drawn too.
"""

import csv
import re
import statistics
import subprocess
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env.sectors import participation_ratio
from optimisation.cli.common import command
from optimisation.files import DOCS, markdown
from studies.blades.chain import (
    PERIODS,
    SAMPLES_PER_PERIOD,
    SECTORS,
    Chain,
    Step,
    classify_response,
    count_transient,
    run_periods,
    step_frequencies,
)
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Saver,
    Study,
    add_folder_options,
    add_sources,
    make_rows_part,
    not_none,
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
CURVE_COUPLINGS = (0.001, 0.002, 0.01, 0.05)
CURVE_CLEARANCES = (0.1, 0.2, 0.3, 0.45, 0.7, 1.2, 2.0)
# wave numbers and couplings: 0 and 1 with every coupling, the others with that of the comparison
CURVE_LINES = (
    *((wave, coupling) for wave in (0, 1) for coupling in CURVE_COUPLINGS),
    *((wave, COUPLING) for wave in (2, 3, 4, 5)),
)
CURVE_CASES = tuple((*line, clearance) for line in CURVE_LINES for clearance in CURVE_CLEARANCES)
COST = "chain_cost"
COST_DRIVER = Path(__file__).parent.parent / "blades" / f"{COST}.m"
COST_CLEARANCES = (0.1, 0.2, 0.45, 1.0, 2.0)
COST_PERIODS = 100
COST_REPEATS = 3
COST_START = 0.3  # largest displacement of a sector over the linear amplitude


class Example(NamedTuple):
    """A public example of the code CC.

    ``name`` is its configuration file. ``frequency`` None is the resonance.
    """

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
KIND_LETTERS = {
    "synchronised": "S",
    "localised": "L",
    "solitary": "1",
    "modulated": "M",
    "without impacts": "0",
}
KIND_MARKERS = {
    "synchronised": "o",
    "localised": "D",
    "solitary": "*",
    "modulated": "x",
    "without impacts": ".",
}
LOCALISED_START = 1.5  # displacement of one sector over the linear amplitude


class Settings(NamedTuple):
    """Settings of the comparison.

    Wave numbers, clearances, number of random starts and of periods, cases of the curve, examples,
    whether transients are shortened, and the folder of the code CC.
    """

    wave_numbers: tuple[int, ...]
    clearances: tuple[float, ...]
    starts: int
    periods: int
    curve: tuple[tuple[int, float, float], ...]
    examples: tuple[int, ...]
    quick: bool = False
    peer: Path | None = None


def describe_step(step: Step) -> Json:
    """Return the numbers of a motion at one frequency."""
    return {
        "frequency": step.frequency,
        "amplitude": step.amplitude.round(6).tolist(),
        "deviation": step.deviation.round(6).tolist(),
        "impacts": step.impacts.round(4).tolist(),
    }


def kind_of(row: Json) -> str:
    """Return the kind of the response of a row of `describe_step`."""
    return classify_response(np.array(row["impacts"]))


def measure_levels(wave_number: int, clearance: float, settings: Settings) -> list[Json]:
    """Return the motion after the transient, for each random start.

    The frequency is that of the resonance with stuck absorbers.
    """
    chain = Chain(COUPLING, wave_number, clearance)
    transient = settings.periods if settings.quick else count_transient(chain.resonance)
    starts = []
    for seed in range(1, settings.starts + 1):
        state, _ = run_periods(
            chain, chain.resonance, transient, chain.draw_start(seed), samples=None
        )
        _, step = run_periods(chain, chain.resonance, settings.periods, state, SAMPLES_PER_PERIOD)
        starts.append(describe_step(not_none(step)))
    return [
        {
            "wave_number": wave_number,
            "clearance": clearance,
            "transient": transient,
            "starts": starts,
        }
    ]


def measure_example(number: int, settings: Settings) -> list[Json]:
    """Return the motion of a public example after its transient.

    The result has the amplitudes of all periods.
    """
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


def measure_curve(
    wave_number: int, coupling: float, clearance: float, settings: Settings
) -> list[Json]:
    """Return the motion of the frequency with the highest level of the paper's 50."""
    chain = Chain(coupling, wave_number, clearance)
    frequencies = chain.frequencies[::16] if settings.quick else chain.frequencies
    steps = list(step_frequencies(chain, frequencies, 1, settings.periods))
    worst = max(steps, key=lambda step: step.level)
    kinds = sorted({step.kind for step in steps})
    ratio = worst.frequency / chain.resonance
    return [
        {
            "wave_number": wave_number,
            "coupling": coupling,
            "clearance": clearance,
            "ratio": ratio,
            "kinds": kinds,
            **describe_step(worst),
        }
    ]


def time_peer(clearance: float, folder: Path, periods: int) -> float:
    """Return the CPU time in ms that CC takes for a period of one chain, under Octave."""
    numbers = (1, COUPLING, clearance, periods, COST_START)
    words = ["octave-cli", "--no-gui", str(COST_DRIVER), str(folder), *map(str, numbers)]
    text = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    match = re.search(r"cpu_s = ([0-9.]+)", text)
    return 1e3 * float(not_none(match)[1]) / periods


def time_exact(clearance: float, periods: int) -> float:
    """Return the CPU time in ms that the exact method takes for a period of the same chain."""
    chain = Chain(COUPLING, 1, clearance)
    drawn = np.random.default_rng(1).uniform(-1, 1, SECTORS)
    start = chain.make_start(COST_START * chain.linear_amplitude * drawn / np.max(np.abs(drawn)))
    run_periods(chain, chain.resonance, 1, start, samples=None)  # compiles
    began = time.process_time()
    run_periods(chain, chain.resonance, periods, start, samples=None)
    return 1e3 * (time.process_time() - began) / periods


def measure_cost(clearance: float, settings: Settings) -> list[Json]:
    """Return the CPU times of both programs, in turn."""
    folder = not_none(settings.peer)
    peer = []
    own = []
    for _ in range(COST_REPEATS):
        peer.append(time_peer(clearance, folder, COST_PERIODS))
        own.append(time_exact(clearance, COST_PERIODS))
    return [{"clearance": clearance, "peer_ms": peer, "exact_ms": own}]


def make_cost_table(measured: Measurement) -> str:
    """Return the table of costs."""
    lines = []
    for row in measured.values["rows"]:
        peer, own = (statistics.median(row[name]) for name in ("peer_ms", "exact_ms"))
        lines.append([f"{row['clearance']:g}", f"{peer:.0f}", f"{own:.2f}", f"{peer / own:.0f}"])
    return markdown(["clearance", "CC, ms a period", "exact, ms a period", "ratio"], lines)


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
        kinds = sorted(set(map(kind_of, row["starts"])))
        other = peer.get((row["wave_number"], row["clearance"]))
        lines.append(
            [
                str(row["wave_number"]),
                f"{row['clearance']:g}",
                f"{statistics.median(levels):.4f} ({min(levels):.4f} to {max(levels):.4f})",
                ", ".join(kinds),
                "" if other is None else f"{other['amplitude']:.4f}",
            ]
        )
    head = ("wave number", "clearance", "amplitude", "response", "amplitude, CC")
    return markdown(head, lines)


def make_curve_table(measured: Measurement) -> str:
    """Return the table of the performance curve.

    It has the largest amplitudes and the kind of the response at each.
    """
    rows = measured.values["rows"]
    clearances = sorted({row["clearance"] for row in rows})
    lines = []
    for wave, coupling in sorted({(row["wave_number"], row["coupling"]) for row in rows}):
        own = {
            row["clearance"]: f"{np.mean(row['amplitude']):.3f} {KIND_LETTERS[kind_of(row)]}"
            for row in rows
            if (row["wave_number"], row["coupling"]) == (wave, coupling)
        }
        cells = [own.get(clearance, "") for clearance in clearances]
        lines.append([str(wave), f"{coupling:g}", *cells])
    return markdown(["wave number", "coupling", *(f"{value:g}" for value in clearances)], lines)


def make_curve_figure(measured: Measurement) -> Saver:
    """Return the figure of the performance curves."""
    rows = measured.values["rows"]

    def save(path: Path) -> None:
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt

        lines = {(row["wave_number"], row["coupling"]) for row in rows}
        number = Counter(wave for wave, _ in lines)
        waves = sorted(wave for wave in number if number[wave] == max(number.values()))
        figure, axes = plt.subplots(
            1, len(waves), figsize=(8.4, 3.8), layout="constrained", sharey=True, squeeze=False
        )
        for ax, wave in zip(axes[0], waves, strict=True):
            for coupling in sorted({row["coupling"] for row in rows}):
                own = [
                    row for row in rows if (row["wave_number"], row["coupling"]) == (wave, coupling)
                ]
                x = [row["clearance"] for row in own]
                y = [np.mean(row["amplitude"]) for row in own]
                (line,) = ax.plot(x, y, "-", lw=1, label=f"coupling {coupling:.4g}")
                for kind, marker in KIND_MARKERS.items():
                    of_kind = [k for k, row in enumerate(own) if kind_of(row) == kind]
                    at = [x[k] for k in of_kind]
                    ax.plot(at, [y[k] for k in of_kind], marker, color=line.get_color(), ms=5)
            ax.set_xscale("log")
            ax.set_yscale("log")
            ax.set_xticks(x, [f"{value:g}" for value in x])
            ax.set_yticks(LEVEL_TICKS, [f"{value:g}" for value in LEVEL_TICKS])
            ax.minorticks_off()
            ax.set_title(f"wave number {wave}", fontsize=10)
            ax.set_xlabel("clearance over the linear amplitude")
            ax.grid(visible=True, lw=0.3)
        axes[0][0].set_ylabel("largest amplitude over the linear one")
        axes[0][0].legend(frameon=False, fontsize=8)
        figure.savefig(path, dpi=110)
        plt.close(figure)

    return save


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
                kind_of(row),
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


def list_costs(settings: Settings) -> dict[Any, Any]:
    """Return a function that measures each case of the cost; none without CC."""
    clearances = () if settings.peer is None else COST_CLEARANCES
    return {clearance: partial(measure_cost, clearance, settings) for clearance in clearances}


STUDY: Study[Settings] = Study(
    (
        make_rows_part(
            NAME,
            "levels of the cyclic chain and those of CC",
            list_levels,
            lambda row: (row["wave_number"], row["clearance"]),
            add_sources(make_table),
            key_values=lambda settings: {"periods": settings.periods},
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
            key_values=lambda settings: {"periods": settings.periods},
            figures=lambda measured: {RESPONSES: make_example_figure(measured)},
        ),
        make_rows_part(
            CURVE,
            "performance curve of the cyclic chain",
            list_curve,
            lambda row: (row["wave_number"], row["coupling"], row["clearance"]),
            add_sources(make_curve_table),
            key_values=lambda settings: {"periods": settings.periods},
            figures=lambda measured: {CURVE: make_curve_figure(measured)},
        ),
        make_rows_part(
            COST,
            "cost of the cyclic chain with CC and with the exact method",
            list_costs,
            lambda row: row["clearance"],
            add_sources(make_cost_table),
        ),
    ),
    stopped_message="finished cases are in the files.",
)


@command()
@click.option("--quick", is_flag=True, help="A clearance of each, few periods and frequencies.")
@click.option(
    "--only",
    multiple=True,
    type=click.Choice([NAME, RESPONSES, CURVE, COST]),
    help="This part alone.",
)
@click.option(
    "--peer",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Folder of CC, which is run by octave-cli: measures the cost of both programs.",
)
@add_folder_options(PAGE, "numbers and figures")
def main(
    quick: bool, only: tuple[str, ...], peer: Path | None, redraw: bool, place: OutputPaths
) -> None:
    """Compare levels of the cyclic chain with those of the published code CC.

    An interrupted run continues when the command is called again.
    """
    settings = (
        Settings((1,), (0.2,), 1, QUICK_PERIODS, ((1, 0.01, 0.2),), (0,), quick=True, peer=peer)
        if quick
        else Settings(
            (1, 0),
            CLEARANCES,
            STARTS,
            PERIODS,
            CURVE_CASES,
            tuple(range(len(EXAMPLES))),
            peer=peer,
        )
    )
    if COST in only and peer is None and not redraw:
        raise click.UsageError(f"--only {COST} needs --peer FOLDER, where the code CC is")
    if not only and peer is None and not redraw:
        only = (NAME, RESPONSES, CURVE)
    run(STUDY, settings, place, only=only, redraw=redraw)
