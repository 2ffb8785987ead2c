"""Speed of the exact method against the Moreau scheme at the paper's step.

Times are for one core and one process, without compilation.
"""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import click
import numpy as np
import scipy.signal

from impact_env import (
    Beam,
    ModalModel,
    Record,
    Scene,
    SlidingAbsorber,
    beam_scene,
    impact_absorber,
    modal_model,
)
from impact_env.drive import PAPER_RATE
from impact_env.loads import Loads, Samples
from impact_env.methods import PAPER_STEPS, Exact, Moreau
from optimisation.checkpoint import BARE, TimedRun
from optimisation.cli.common import command
from studies.study import (
    Array,
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_table_options,
    format_table,
    make_table_study,
    run,
)
from studies.timing import (
    Advance,
    TimingSettings,
    make_sweep_up,
    measure_all_cases,
    summarise_times,
    time_call,
    time_in_turn,
)

NAME = "benchmark"
START = 0.98  # of the first resonance; with the whole length the sweep ends at 1.06
# pseudo periods
WHOLE = 800.0
QUICK = 60.0
REPEATS = 5
QUICK_REPEATS = 1


@dataclass(frozen=True)
class SpeedCase:
    """One line of the benchmark.

    The Moreau scheme runs over at most ``moreau_periods``, because all its steps take the same
    time.
    """

    modes: int
    force: float
    restitution: float
    friction_limit: float | None
    moreau_periods: float = WHOLE

    @property
    def name(self) -> str:
        """The name in a table."""
        friction = "" if self.friction_limit is None else f", muN = {self.friction_limit:g} N"
        return f"{self.modes} modes, {self.force:g} N, e = {self.restitution:g}{friction}"

    def scene(self) -> Scene:
        """Return the scene."""
        return beam_scene(
            Beam(modes=self.modes),
            impact_absorber(restitution=self.restitution, friction_limit=self.friction_limit),
        )


CASES = (
    SpeedCase(3, 1.5, 1.0, None),
    SpeedCase(10, 5.0, 1.0, None),
    SpeedCase(30, 5.0, 1.0, None, moreau_periods=200.0),
    SpeedCase(10, 3.5, 0.7, 0.1),
)


def measure(case: SpeedCase, settings: TimingSettings, advance: Advance) -> Json:
    """Time both methods: times per pseudo period in us, medians and all repeats."""
    scene = case.scene()
    periods = settings.periods
    short = min(settings.periods, case.moreau_periods)
    exact, moreau = (
        TimedRun(scene, make_sweep_up(scene, case.force, START, length), method)
        for length, method in ((periods, Exact()), (short, Moreau()))
    )
    response = exact.run()
    impacts, events, evaluations = (
        count / periods for count in (response.impact_count, response.steps, response.evaluations)
    )
    runs = {
        "exact": lambda: exact.run().wall_time / periods,
        "moreau": lambda: moreau.run().wall_time / short,
    }
    times = summarise_times(time_in_turn(runs, settings.repeats, advance))
    return {
        "name": case.name,
        "case": asdict(case),
        "pseudo_periods": periods,
        "moreau_pseudo_periods": short,
        "impacts_per_period": impacts,
        "events_per_period": events,
        "evaluations_per_period": evaluations,
        **times,
        "ratio": times["moreau_us"] / times["exact_us"],
    }


def table(cases: Sequence[Json]) -> str:
    """Return a line for each case."""
    columns = {
        "case": "{name}",
        "exact, us": "{exact_us:.3g}",
        "impacts": "{impacts_per_period:.2f}",
        "events": "{events_per_period:.1f}",
        "evaluations": "{evaluations_per_period:.0f}",
        "Moreau, us": "{moreau_us:.4g}",
        "ratio": "{ratio:.1f}",
    }
    return format_table(columns, cases)


def _summary(measured: Measurement) -> str:
    cases = measured.values["cases"]
    repeats = measured.values["repeats"]
    periods = cases[0]["pseudo_periods"]
    return (
        f"{table(cases)}\n\n"
        f"All per pseudo period; median of {repeats} runs on one core, of the integration "
        "alone, with compiled kernels.\n"
        f"Sweep up from {START:g} times the first resonance at {PAPER_RATE:g} % per 100 "
        f"pseudo periods over {periods:g} of them.\n"
        "Events are impacts and reversals of the relative velocity; one evaluation samples "
        "eight instants or refines one\n"
        f"event. The Moreau scheme has {PAPER_STEPS} steps per period of the highest mode "
        "and, with 30 modes, runs over at\n"
        "most 200 pseudo periods. The ratio is that of the times of Moreau and exact method."
    )


STUDY: Study[TimingSettings] = make_table_study(
    NAME,
    "speed of the exact method",
    lambda settings: measure_all_cases(CASES, settings, measure),
    _summary,
)


# A sample of a record: beside scipy.signal.lsim where all is linear, and beside the Moreau scheme
# where walls are.
RECORD = "benchmark_loads"
# samples a second; N, the record's RMS
MODES = 10
RATE = 5000.0
FORCE = 20.0
# samples
SAMPLES = 100_000
QUICK_SAMPLES = 2_000
PERIOD = (
    32  # samples in a pseudo period, so that what is recorded is the motion at the record's samples
)
RECORDED: dict[str, SlidingAbsorber | None] = {
    "no absorber": None,
    "walls that are watched, never met": impact_absorber(1.0, 0.7),
    "walls that are met, gap 1 mm, e = 0.7": impact_absorber(1e-3, 0.7),
}


def state_space(model: ModalModel) -> tuple[Array, ...]:
    """Return A, B, C, D of the state-space model from the force to the displacement.

    The displacement is taken where the level is measured. The states are the modes' displacements
    and velocities.
    """
    n = model.modes
    a = np.block(
        [
            [np.zeros((n, n)), np.eye(n)],
            [-np.diag(model.omega**2), -np.diag(2 * model.damping_ratio * model.omega)],
        ]
    )
    b = np.concatenate([np.zeros(n), model.force_shape])[:, None]
    return a, b, np.concatenate([model.level_shape, np.zeros(n)])[None], np.zeros((1, 1))


def measure_record(
    case: tuple[str, SlidingAbsorber | None], settings: TimingSettings, advance: Advance
) -> Json:
    """Return computing times of a sample in us, and the error of lsim.

    The error is the difference between its displacement and that of the exact method, relative to
    the largest exact displacement.
    """
    name, absorber = case
    samples = int(settings.periods)
    model = modal_model(Beam(modes=MODES))
    times = np.arange(samples + 1) / RATE
    values = FORCE * np.random.default_rng(0).standard_normal(len(times))
    loads = Loads((Samples(times, values),), 2 * np.pi * RATE / PERIOD)
    scene = Scene(model, absorber)
    recorded = Record(level=False, series=True, samples_per_period=PERIOD)
    exact = TimedRun(scene, loads, Exact(), record=BARE)
    recorder = TimedRun(scene, loads, Exact(), record=recorded)
    history = recorder.run().recorded.history
    row: Json = {
        "name": name,
        "samples": samples,
        "impacts_per_s": exact.run().impact_count / float(times[-1]),
    }
    runs: dict[str, Callable[[], object]] = {"exact": exact.run, "recorded": recorder.run}
    if absorber is None:
        system = scipy.signal.StateSpace(*state_space(model))
        _, result, _ = scipy.signal.lsim(system, values, times)
        row["difference"] = float(
            np.max(np.abs(history.modal_displacement @ model.level_shape - result))
            / np.max(np.abs(result))
        )
        runs["lsim"] = partial(scipy.signal.lsim, system, values, times)
    else:
        runs["moreau"] = TimedRun(scene, loads, Moreau()).run
    each = time_in_turn(
        {name: partial(time_call, run) for name, run in runs.items()}, settings.repeats, advance
    )
    return row | {
        f"{name}_us": 1e6 * statistics.median(result) / samples for name, result in each.items()
    }


COLUMNS = {
    "case": "name",
    "exact, us": "exact_us",
    "with all samples kept, us": "recorded_us",
    "lsim, us": "lsim_us",
    "Moreau, us": "moreau_us",
    "impacts a second": "impacts_per_s",
}


def _record_summary(measured: Measurement) -> str:
    cases = measured.values["cases"]
    repeats = measured.values["repeats"]
    cells = [
        {
            name: row[name] if name == "name" else f"{row[name]:.3g}" if name in row else ""
            for name in COLUMNS.values()
        }
        for row in cases
    ]
    samples = cases[0]["samples"]
    difference = cases[0]["difference"]
    return (
        f"{format_table({head: f'{{{name}}}' for head, name in COLUMNS.items()}, cells)}\n\n"
        f"All per sample of a white record of {samples:,} at {RATE:,.0f} a second, {FORCE:g} "
        f"N RMS, on the paper's beam with {MODES} modes; whole\n"
        f"calls on one core, compiled before, median of {repeats}. What lsim, with straight "
        "lines between samples, gives for the displacement\n"
        f"differs by {difference:.1g} of the largest. The Moreau scheme has {PAPER_STEPS} "
        "steps per period of the highest mode."
    )


RECORD_STUDY: Study[TimingSettings] = make_table_study(
    RECORD,
    "a sample of a record",
    lambda settings: measure_all_cases(list(RECORDED.items()), settings, measure_record),
    _record_summary,
)


@command()
@click.option(
    "--quick",
    is_flag=True,
    help=f"{QUICK_REPEATS} repeat of {QUICK:g} pseudo periods: a look, not a measurement.",
)
@click.option(
    "--repeats",
    type=click.IntRange(min=1),
    help=f"Runs of each method, of which the median counts.  [default: {REPEATS}]",
)
@click.option(
    "--record",
    is_flag=True,
    help="Time a sample of a record instead, beside lsim as well; its page is docs/loads.md.",
)
@add_table_options(NAME, "docs/methods.md")
def main(quick: bool, repeats: int | None, record: bool, place: OutputPaths) -> None:
    """Time the exact method and the Moreau scheme on the same sweeps, and print a table.

    The Moreau scheme has the step of the paper.

    Run it on an otherwise idle machine. The first call compiles the kernels, which is not part of
    the times.
    """
    times = repeats or (QUICK_REPEATS if quick else REPEATS)
    if record:
        run(
            RECORD_STUDY,
            TimingSettings(QUICK_SAMPLES if quick else SAMPLES, times),
            place,
        )
    else:
        run(STUDY, TimingSettings(QUICK if quick else WHOLE, times), place)
