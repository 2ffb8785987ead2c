"""What scripts/run sweep does with its options: one run recorded, and timed if asked for; other members, files."""

from __future__ import annotations

import json
import statistics
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from typing import TypeVar

from impact_env.drive import Drive, FrequencySchedule
from impact_env.ensemble import Executor, Lane, draw_members, run_lanes
from impact_env.methods import Method, check_supported
from impact_env.parameters import Beam, count
from impact_env.response import Record, Response
from impact_env.scene import Scene
from impact_env.sweep import simulate
from impact_env.wording import absorber_words
from optimisation.command_line import BadInput, check_target
from optimisation.commands.sweep_scene import (
    Options,
    make_method,
    make_scene,
    make_schedule,
    refuse_contradictions,
)
from optimisation.executors import workers
from optimisation.files import replacing
from optimisation.progress import Bar
from optimisation.report.sweep_report import Result, contract, describe_run, summary
from optimisation.studies.timing import Timed
from optimisation.sweep_rate import sweep_ratio

FORCE = 3.5  # N, where the paper's absorber works best in the first resonance
SHORT = 2.0  # s: a run below this is timed three times
TIME_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} pseudo periods [{elapsed}, {remaining} left]"
MOST_PLOTTED = 2**30  # bytes of states that a figure may need
T = TypeVar("T")


def integration_time(scene: Scene, drive: Drive, method: Method, most_events: int | None = None) -> float:
    """Return the time in s of an integration that observes nothing, without compilation: the median of three, or one if it is long."""
    timed = Timed(scene, drive, method, most_events)
    times = [timed.run().wall_time]
    while times[0] < SHORT and len(times) < 3:
        times.append(timed.run().wall_time)
    return statistics.median(times)


def heard(work: Callable[[], T], bar: Bar) -> T:
    """Do ``work`` in a thread, so that Ctrl-C is heard and the bar's clock runs while compiled code does."""
    results: list[T] = []
    errors: list[Exception] = []

    def run() -> None:
        try:
            results.append(work())
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(1.0)
    while thread.is_alive():
        bar.refresh()
        thread.join(0.2)
    if errors:
        raise errors[0]
    return results[0]


def recorded(scene: Scene, drive: Drive, method: Method, record: Record, most_events: int | None) -> Response:
    """Run the first member, with a bar in pseudo periods."""
    schedule = drive.schedule
    with Bar(total=round(schedule.periods), desc="integrating", bar_format=TIME_BAR, delay=1, leave=False) as bar:

        def show(time: float, _end: float) -> None:
            bar.update(round(time / schedule.pseudo_period) - bar.n)
            bar.refresh()

        return simulate(scene, drive, method, record=record, most_events=most_events, progress=show)


def compute(
    scene: Scene, drives: list[Drive], method: Method, record: Record, timed: bool, most_events: int | None, executor: Executor | None
) -> Result:
    """Run all members, those after the first by an executor if there is one; the first is recorded and, if ``timed``, by itself timed."""
    response, others, wall_time = recorded(scene, drives[0], method, record, most_events), None, None
    with Bar(total=len(drives), desc="integrating", unit="run", delay=1, leave=False) as bar:
        if len(drives) > 1:
            lanes = [Lane(scene, drive) for drive in drives[1:]]
            others = run_lanes(lanes, method, progress=lambda _done, _total: bar.update(), most_events=most_events, executor=executor)
            if not others.complete:
                raise KeyboardInterrupt
        if timed:
            bar.set_description("timing")
            wall_time = heard(lambda: integration_time(scene, drives[0], method, most_events), bar)
    return Result(response, others, wall_time)


def ratio_of(given: Options, scene: Scene, schedule: FrequencySchedule) -> float | None:
    """Return what such sweeps without absorber show of the stationary level; None at a constant frequency, where nothing is swept."""
    low, high = sorted(schedule.omegas / schedule.reference)
    if low == high:
        return None
    return sweep_ratio(scene.model, 1e4 * (high - low) / schedule.periods, given["resonance"], (float(low), float(high)))


def refuse_long_plot(scene: Scene, schedule: FrequencySchedule, samples: int) -> None:
    """Raise BadInput if the record for a figure would not fit into the memory that is allowed for it."""
    size = 8 * (2 * scene.model.modes + 2) * schedule.periods * samples
    if size > MOST_PLOTTED:
        raise BadInput(f"--plot of {schedule.periods:g} pseudo periods needs {size / 2**30:.1f} GiB: leave it out, or take fewer periods or modes")


def write(result: Result, given: Options, beam: Beam | None) -> None:
    """Write the files asked for: all of them or none."""
    with ExitStack() as files:
        if given["json"] is not None:
            text = json.dumps(contract(result, beam), indent=1, allow_nan=False)
            files.enter_context(replacing(given["json"].resolve())).write_text(text + "\n")
        if given["plot"] is not None:
            from optimisation.report.sweep_figure import save_figure

            absorbers = absorber_words(result.response.scene.absorber).split("; ")  # a line for each of several
            title = "\n".join([*absorbers, describe_run(result.response, given["resonance"])])
            save_figure(files.enter_context(replacing(given["plot"].resolve())), title, result.response, given["resonance"])


def run(given: Options) -> str:
    """Do what the options ask for and return the summary. Raises BadInput or ParameterError before anything is computed or written."""
    refuse_contradictions(given)
    given["force"] = FORCE if given["force"] is None and given["structure"] is None else given["force"]
    check_target("--json", given["json"])
    check_target("--plot", given["plot"], (".png", ".pdf", ".svg"))
    (scene, beam), method = make_scene(given), make_method(given)
    check_supported(scene, method)
    schedule = make_schedule(given, scene)
    if count("members", given["members"], 1) == 1 and given["cluster"] is not None:
        raise BadInput("--cluster needs --members above 1: the first member runs here")
    if given["plot"] is not None:
        refuse_long_plot(scene, schedule, Record().samples_per_period)
    first = Drive(given["force"], schedule, given["phase"])
    drives = draw_members(given["members"], given["seed"]).drives(first.amplitude, schedule, first.phase)
    with workers(None, given["cluster"]) as executor:
        record = Record(events=True, energy=given["energy"], series=given["plot"] is not None)
        result = compute(scene, drives, method, record, given["time"], given["most_events"], executor)
    result = replace(result, sweep_ratio=ratio_of(given, scene, schedule))
    write(result, given, beam)
    return summary(result, given["resonance"])


def default(text: str, value: object) -> str:
    """Return a help text with a default that click does not know of."""
    return f"{text}  [default: {value}]"
