"""One sweep through a resonance: level and impacts."""

import statistics
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np

from impact_env.checks import count
from impact_env.drive import (
    Drive,
    Excitation,
    FrequencySchedule,
    constant_frequency,
    default_rate,
    linear_sweep,
)
from impact_env.ensemble import Executor, Lane, draw_members, drives_of, each_lane, run_lanes
from impact_env.laws import CONCEPTS
from impact_env.methods import PAPER_STEPS, Exact, Method
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls, TunedAbsorber
from impact_env.plain import find_force_amplitude
from impact_env.plain_files import read_plain
from impact_env.results import MOST_SAMPLES_PER_PERIOD, Record, Response
from impact_env.scene import Scene
from impact_env.solvers import check_load, find_solver
from impact_env.structures.cyclic import BladedDisk
from impact_env.sweep import simulate
from optimisation.answers.disk import sweep_disk
from optimisation.calibration.drawn_scenes import band_of_levels, draw_scenes
from optimisation.checkpoint import TimedRun
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    BadInput,
    check_target,
    command,
    parse_posterior,
    plain_errors,
)
from optimisation.cli.options import FIGURES, OptionSpec, number, option, option_values, switch
from optimisation.disks import find_disk_range, find_excited_resonance, force_of
from optimisation.executors import Bar, announce_duration, workers
from optimisation.files import write_files
from optimisation.measures import SAMPLES, check_size, stress_shape
from optimisation.report.report import Report, list_named_files, render_text
from optimisation.report.sweep_report import SweepResult, make_sweep_report
from optimisation.signals import SignalOptions
from optimisation.sweep_range import find_sweep_range, sweep_ratio

FORCE = 3.5  # N, where the paper's absorber works best in the first resonance
REST = "rest"
STEADY = "steady"
SHORT = 2.0  # s: a run below this is timed three times
TIME_BAR = (
    "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} pseudo periods [{elapsed}, {remaining} "
    "left]"
)
DRAWN_MEMBERS = 32  # with the parameters of a posterior
MOST_SAMPLED = 2**30  # bytes of states that a figure or measures may need
T = TypeVar("T")


START_MORE = (
    "At rest, as in the paper, or in the steady state of the linear structure at the first "
    "frequency, "
    "as in the commands that choose a design."
)
VALUE_TEXTS = {
    "gap": f"{RigidWalls.gap}, with --structure by the design rule",
    "friction_limit": (
        f"none for impact, {scenes.FRICTION_DAMPER_LIMIT} for friction, with --structure by the "
        "energy of a cycle"
    ),
    "friction_stiffness": "with compliant walls their stiffness",
    "stiffness": f"{TunedAbsorber.stiffness}, with --structure tuned",
    "damping": f"{TunedAbsorber.damping}, of a tuned one with --structure tuned",
}


@dataclass(frozen=True, kw_only=True)
class SweepOptions(scenes.SceneOptions):
    """Options of ``sweep``; None: not given."""

    absorber: str | None = option(
        OptionSpec(
            names=("--absorber",),
            help=f"Kind of absorber: {', '.join(CONCEPTS)}",
            more=(
                "Impact absorber, friction damper, linear tuned absorber, added mass (stuck), "
                "nonlinear sink, nothing."
            ),
            type=click.Choice(list(CONCEPTS)),
            metavar="KIND",
            default_text=scenes.DEFAULT_ABSORBER,
            usual=True,
            section="Absorber",
        )
    )
    values: Mapping[str, float] = option_values(scenes.absorber_specs(**VALUE_TEXTS))
    load: Path | None = option("load")
    force: float | None = option(
        "force", default_text=f"{FORCE}, with --structure by the design rule"
    )
    phase: float = option(
        number(
            "--phase", "Initial phase of the force", unit="rad", default=0.0, section="Excitation"
        )
    )
    resonance: int = option("resonance")
    start: float = option(
        "start", more="With a heavier absorber than the paper's lower, and --to higher."
    )
    stop: float = option("stop", more="Equal to --from: constant.")
    periods: float | None = option(
        number(
            "--periods", "Length in pseudo periods at a constant frequency", section="Excitation"
        )
    )
    rate: float | None = option("rate")
    down: bool = option(switch("--down", "Sweep down: swaps --from and --to", section="Excitation"))
    initial_state: str = option(
        OptionSpec(
            names=("--start",),
            help="State in which runs begin",
            more=START_MORE,
            type=click.Choice([REST, STEADY]),
            default=REST,
            section="Runs",
        )
    )
    method: str = option(
        OptionSpec(
            names=("--method",),
            help="Method of integration: exact, moreau or runge-kutta",
            type=click.Choice(["exact", "moreau", "runge-kutta"]),
            metavar="METHOD",
            default="exact",
            section="Runs",
        )
    )
    steps_per_period: int | None = option(
        number(
            "--steps-per-period",
            "Steps per period of the highest mode (moreau, runge-kutta)",
            type=int,
            default_text=str(PAPER_STEPS),
            section="Runs",
        )
    )
    most_events: int | None = option(
        number(
            "--most-events",
            "Events after which a run is given up (exact)",
            type=int,
            default_text="a million, and 5000 each pseudo period",
            section="Runs",
        )
    )
    members: int = option("members", default=1, more="The first one has the phase of --phase.")
    uncertain: tuple[tuple[str, tuple[str, ...]], ...] = option(
        "uncertain",
        help="Posterior of calibrate, of which members have the parameters",
        more=(
            f"Members after the first have those of one draw each; {DRAWN_MEMBERS} of them "
            "without --members."
        ),
        metavar="FILE",
    )
    seed: int = option("seed")
    cluster: str | None = option("cluster")
    energy: bool = option(
        switch(
            "--energy",
            "Account for the energies of the first member",
            more="It takes a kernel of its own.",
            section="Output",
        )
    )
    time: bool = option(
        switch(
            "--time",
            "Time an integration alone, with nothing observed",
            more="It takes a kernel of its own.",
            section="Output",
        )
    )
    measures: int | None = option(
        number(
            "--measures",
            "Spectrum, percentiles, rainflow and impacts of each member",
            more=f"From so many samples a pseudo period, {SAMPLES} unless given (docs/loads.md).",
            type=int,
            flag_value=SAMPLES,
            metavar="[SAMPLES]",
            section="Output",
        )
    )
    absolute: bool = option(
        switch(
            "--absolute",
            "With --measures and a base that moves: of the motion in space",
            more="Not relative to the base.",
            section="Output",
        )
    )
    json: Path | None = option("json")
    plot: Path | None = option("plot")


def integration_time(
    scene: Scene, drive: Excitation, method: Method, most_events: int | None = None
) -> float:
    """Return the time in s of an integration without recording, without compilation.

    It is the median of three integrations, or the time of one if it is long.
    """
    timed = TimedRun(scene, drive, method, most_events)
    times = [timed.run().wall_time]
    while times[0] < SHORT and len(times) < 3:
        times.append(timed.run().wall_time)
    return statistics.median(times)


def run_in_thread(work: Callable[[], T], bar: Bar) -> T:
    """Run ``work`` in a thread.

    So Ctrl-C is handled and the bar's clock advances while compiled code runs.
    """
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


def recorded(lane: Lane, method: Method, record: Record, most_events: int | None) -> Response:
    """Run the first member, with a bar in pseudo periods."""
    schedule = lane.drive.schedule
    with Bar(
        total=round(schedule.periods), desc="integrating", bar_format=TIME_BAR, delay=1, leave=False
    ) as bar:

        def show(time: float, _end: float) -> None:
            bar.update(round(time / schedule.pseudo_period) - bar.n)
            bar.refresh()

        return simulate(
            lane.scene,
            lane.drive,
            method,
            initial=lane.start,
            record=record,
            most_events=most_events,
            progress=show,
        )


def compute(
    options: SweepOptions,
    scene: Scene,
    beam: Beam | None,
    drives: list[Excitation],
    method: Method,
    executor: Executor | None,
    drawn: Sequence[Scene] = (),
) -> SweepResult:
    """Run all members and record the first one.

    The further members are run by the executor if one is given. If requested, the first member is
    timed separately.

    ``drawn``: scenes of the members after the first; empty: all have the same.
    """
    record = Record(events=True, energy=options.energy, series=options.plot is not None)
    most_events = options.most_events
    steady = options.initial_state == STEADY
    scenes_of_members = [scene, *(drawn or [scene] * (len(drives) - 1))]
    every = [
        Lane(own, drive, steady_start=steady)
        for own, drive in zip(scenes_of_members, drives, strict=True)
    ]
    if steady and every[0].start is None:
        raise BadInput(
            "--start steady: there is no steady state to start from (it needs a harmonic "
            "load, damping at its frequency, no gravity and "
            "no start in the load's file)"
        )
    response = recorded(every[0], method, record, most_events)
    others = None
    wall_time = None
    band = None
    with Bar(total=len(drives), desc="integrating", unit="run", delay=1, leave=False) as bar:
        if len(drives) > 1:
            others = run_lanes(
                every[1:],
                method,
                progress=lambda _done, _total: bar.update(),
                most_events=most_events,
                executor=executor,
            )
            if not others.complete:
                raise KeyboardInterrupt
        ratios = drives[0].schedule.omegas / drives[0].schedule.reference
        if drawn and isinstance(drives[0], Drive) and np.ptp(ratios) > 0:
            bar.set_description_str("band")
            limits = float(np.min(ratios)), float(np.max(ratios))
            band = band_of_levels(every[1:], limits, executor)
        if options.time:
            bar.set_description_str("timing")
            wall_time = run_in_thread(
                lambda: integration_time(scene, drives[0], method, most_events), bar
            )
    return SweepResult(
        response,
        others,
        options.resonance,
        beam,
        wall_time,
        steady=steady,
        drawn=bool(drawn),
        band=band,
    )


def refuse_long(option: str, scene: Scene, schedule: FrequencySchedule, samples: int) -> None:
    """Raise BadInput if the samples for an option exceed the allowed memory."""
    size = 8 * (2 * scene.model.modes + 2) * schedule.periods * samples
    if size > MOST_SAMPLED:
        raise BadInput(
            f"{option} of {schedule.periods:g} pseudo periods needs {size / 2**30:.1f} GiB: "
            "leave it out, or take fewer periods or modes"
        )


def measured(
    options: SweepOptions,
    scene: Scene,
    beam: Beam | None,
    drives: list[Excitation],
    executor: Executor | None,
) -> list[dict[str, Any]] | None:
    """Return the measures of each member; None without --measures."""
    if options.measures is None:
        return None
    signal_options = SignalOptions(
        options.measures,
        options.absolute,
        stress_shape(scene.model if beam is None else beam),
    )
    with Bar(total=len(drives), desc="measuring", unit="run", delay=1, leave=False) as bar:
        steady = options.initial_state == STEADY
        every = [Lane(scene, drive, steady_start=steady) for drive in drives]
        measures = each_lane(
            every, signal_options, progress=lambda _done, _total: bar.update(), executor=executor
        )
    if None in measures:
        raise KeyboardInterrupt
    return [one for one in measures if one is not None]


def print_and_write(report: Report, options: SweepOptions) -> None:
    """Print a report, and write its numbers and figure.

    The names of the written files are not printed, unlike those of commands that choose their
    names.
    """
    click.echo(render_text(report))
    write_files(list_named_files(report, options.json, plot=options.plot))


def run(options: SweepOptions) -> None:
    """Do what the options ask for: print the summary, then write files.

    Raises BadInput or ParameterError before anything is computed or written.
    """
    scenes.refuse_parts(options)
    refuse_runs(options)
    if options.force is None and options.load is None:
        file = options.scene or options.structure
        if file is not None:
            options = replace(options, force=find_force_amplitude(read_plain(file)))
    if options.force is None and (options.structure is None or options.load is not None):
        options = replace(options, force=FORCE)
    check_target("--json", options.json)
    check_target("--plot", options.plot, FIGURES)
    disk = scenes.read_disk(options.scene, "structure")
    if disk is not None:
        run_disk(options, disk)
        return
    scene, beam, force = scenes.make_scene(options)
    assert force is not None
    method = scenes.make_method(options.method, options.steps_per_period)
    find_solver(scene, method)
    first = make_drive(options, scene, force)
    schedule = first.schedule
    check_load(scene, first, method)
    posterior = parse_posterior(options.uncertain)
    members = count("members", options.members, 1)
    if posterior is not None and not scenes.is_option_set("members"):
        members = DRAWN_MEMBERS + 1
    if posterior is not None and members == 1:
        raise BadInput("--uncertain needs --members above 1: the first member has no draw")
    if posterior is not None and not isinstance(method, Exact):
        raise BadInput(f"--uncertain does not go with --method {options.method}")
    if posterior is not None and options.measures is not None:
        raise BadInput("--uncertain does not go with --measures")
    if members == 1 and options.cluster is not None:
        raise BadInput("--cluster needs --members above 1: the first member runs here")
    if options.plot is not None:
        refuse_long("--plot", scene, schedule, Record().samples_per_period)
    if options.measures is not None:
        samples = count("measures", options.measures, 4, MOST_SAMPLES_PER_PERIOD)
        refuse_long("--measures", scene, schedule, samples)
    drawn: list[Scene] = []
    if posterior is not None:
        drawn = draw_scenes(scene, posterior, members - 1, options.seed, options.resonance)
    drives = drives_of(draw_members(members, options.seed), first)
    if isinstance(first, Drive) and isinstance(method, Exact) and options.cluster is None:
        announce_duration(
            scene, first.amplitude, options.resonance, schedule.periods, len(drives), None
        )
    with workers(None, options.cluster) as executor:
        result = compute(options, scene, beam, drives, method, executor, drawn)
        result = replace(result, measures=measured(options, scene, beam, drives, executor))
    low, high = (float(end) for end in sorted((schedule.omegas / schedule.reference)[[0, -1]]))
    if options.load is None and low != high:  # at a constant frequency nothing is swept
        rate = 1e4 * (high - low) / schedule.periods
        ratio = sweep_ratio(
            scene.model, rate, options.resonance, (low, high), options.initial_state == STEADY
        )
        result = replace(result, sweep_ratio=ratio)
    print_and_write(make_sweep_report(result), options)


NOT_OF_DISKS = ("energy", "time", "measures", "absolute", "uncertain")


def run_disk(options: SweepOptions, disk: BladedDisk) -> None:
    """Sweep a bladed disk, print the levels of its sectors, and write files."""
    for name in NOT_OF_DISKS:
        if scenes.is_option_set(name):
            raise BadInput(f"{scenes.option_name(name)} does not go with a bladed disk")
    is_set = scenes.is_option_set
    chosen = options.resonance if is_set("resonance") else find_excited_resonance(disk)
    model = disk.tuned().model
    resonance = model.check_resonance(chosen)
    method = scenes.make_method(options.method, options.steps_per_period)
    if options.load is None:
        low, high = find_disk_range(disk, resonance)
        start = options.start if is_set("start") else low
        stop = options.stop if is_set("stop") else high
        wanted = replace(options, resonance=resonance)
        schedule = make_schedule(wanted, Scene(model), (start, stop))
        force = force_of(disk, options.force if is_set("force") else None)
        drive: Excitation = Drive(force, schedule, options.phase)
    else:
        drive = scenes.loads_of(options.load, model, resonance, all_places=False)
        size = disk.scene()
        refuse_long("a load", size, drive.schedule, Record().samples_per_period)
    check_load(disk.scene(), drive, method)
    total = round(drive.schedule.periods)
    with (
        workers(None, options.cluster) as executor,
        Bar(total=total, desc="integrating", bar_format=TIME_BAR, delay=1, leave=False) as bar,
    ):

        def show(time: float, _end: float) -> None:
            bar.update(round(time / drive.schedule.pseudo_period) - bar.n)
            bar.refresh()

        answer = sweep_disk(
            disk,
            drive=drive,
            resonance=resonance,
            members=count("members", options.members, 1),
            seed=options.seed,
            steady_start=options.initial_state == STEADY,
            method=method,
            most_events=options.most_events,
            watch=show,
            executor=executor,
        )
    print_and_write(answer.report, options)


def refuse_runs(options: SweepOptions) -> None:
    """Raise BadInput if two options of the run do not go together."""
    if options.steps_per_period is not None and options.method == "exact":
        raise BadInput("--steps-per-period does not go with --method exact: it has no steps")
    if options.most_events is not None and options.method != "exact":
        raise BadInput(
            f"--most-events does not go with --method {options.method}: it steps through "
            "time, whatever happens"
        )
    if options.measures is not None and options.method != "exact":
        raise BadInput(
            f"--measures does not go with --method {options.method}: they are read from exact runs"
        )
    if options.absolute and options.measures is None:
        raise BadInput("--absolute needs --measures: it says what these are of")
    scenes.refuse_with_load(options.load, *scenes.LOAD_OPTIONS)
    if options.load is not None:
        return
    constant = options.start == options.stop
    if constant and options.periods is None:
        raise BadInput(
            f"--to = {options.stop} equal to --from is a constant frequency: it needs --periods"
        )
    if not constant and options.periods is not None:
        raise BadInput(
            "--periods is for a constant frequency, --to equal to --from: the length of a "
            "sweep follows from its rate"
        )
    if constant and options.rate is not None:
        raise BadInput("--rate does not go with a constant frequency, --to equal to --from")
    if options.down and not options.start < options.stop:
        raise BadInput(
            f"--down swaps --from and --to: it needs --from = {options.start} below --to = "
            f"{options.stop}"
        )


def make_schedule(
    options: SweepOptions, scene: Scene, limits: tuple[float, float]
) -> FrequencySchedule:
    """Return the sweep or the constant frequency that the options describe.

    ``limits``: ends of the sweep over the resonance.
    """
    omega = scene.model.resonance_omega(options.resonance)
    start, stop = limits
    if start == stop:
        assert options.periods is not None
        return constant_frequency(omega, start, options.periods)
    if options.down:
        start, stop = stop, start
    rate = options.rate
    return linear_sweep(
        omega,
        start,
        stop,
        default_rate(scene.model, (options.resonance,)) if rate is None else rate,
    )


def make_drive(options: SweepOptions, scene: Scene, force: float) -> Excitation:
    """Return the force, or the loads of a file."""
    if options.load is None:
        scenes.warn_of_nodes(scene.model, options.resonance)
        schedule = make_schedule(options, scene, limits_of(options, scene))
        return Drive(force, schedule, options.phase)
    loads = scenes.loads_of(options.load, scene.model, options.resonance)
    check_size(scene, loads)
    return loads


def limits_of(options: SweepOptions, scene: Scene) -> tuple[float, float]:
    """Return the range of a sweep.

    It is the given range. Without one, an absorber heavier than the paper's has a wider range than
    the default.
    """
    absorber = scene.absorber
    heavy = absorber is not None and absorber.mass_ratio > 1.05 * DEFAULT_MASS_RATIO
    range_set = scenes.is_option_set("start") or scenes.is_option_set("stop")
    if absorber is None or not heavy or range_set:
        return options.start, options.stop
    return find_sweep_range(scene.model, absorber.mass_ratio, options.resonance)


@command(
    SweepOptions,
    examples=(
        "sweep --modes 2 --from 0.98 --to 1 --rate 10",
        "sweep --absorber tuned --force 3.5 --plot sweep.png",
    ),
)
def main(options: SweepOptions) -> None:
    """Integrate one sweep of the frequency through a resonance and print the results.

    The force acts on the beam.

    In the JSON file response_level_m and level_frequency_ratio have one number for each member;
    impacts, tip and stuck time are those of the first member, which runs here also with --cluster,
    and so are energy_balance_relative_error with --energy, and with --time wall_s: the time of an
    integration alone, compiled and with nothing observed.
    """
    with plain_errors():
        run(options)
