"""The gap of an impact absorber for a force."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from impact_env.checks import non_negative, positive
from impact_env.drive import PAPER_LIMITS, default_rate
from impact_env.ensemble import Executor, LaneProgress
from impact_env.modes import ModalModel, Structure
from impact_env.parameters import RigidWalls, SlidingAbsorber, friction_law, impact_absorber
from impact_env.scene import Scene
from optimisation.absorber_rules import rigid_walls, scaled_absorber
from optimisation.answers.gap import (
    SOBOL_SAMPLES,
    TOLERANCE_DRAWS,
    GapAnswer,
    GapQuestions,
    complete_gap_answer,
    measured_posterior,
    model_for_gap,
    read_uncertain,
)
from optimisation.cli import common, disk_commands
from optimisation.cli import scene_options as scenes
from optimisation.cli.options import number, option, switch
from optimisation.contact import check_contact
from optimisation.executors import (
    COARSE_PERIODS,
    COARSER,
    LONG_S,
    announce_coarse,
    announce_duration,
    announce_load_runs,
    runs_bar,
    sweeps_bar,
    workers,
)
from optimisation.executors import executor as executor_on
from optimisation.gap_advice import (
    CANDIDATES,
    MEMBERS,
    TOLERANCE,
    Advice,
    Limits,
    gap_factors,
    search_gap,
)
from optimisation.gap_search import CHECK_MEMBERS, PAIRS
from optimisation.load_cases import AppliedLoads, swept_force
from optimisation.measures import DISPLAY_UNITS, LABELS, UNITS, design_gap_for
from optimisation.report.report import Stages
from optimisation.sweep_range import find_sweep_range, usable_force, usable_gap, usable_rate
from optimisation.tolerances import (
    DRAWS_ALONE,
    DRAWS_CHECKED,
    DRAWS_TOGETHER,
    SURE,
)

QUICK_MEMBERS = 1
SWEEPS = 50  # of a search, about
MOST_DRAWS = 3 * DRAWS_ALONE + DRAWS_TOGETHER + DRAWS_CHECKED
TOLERANCES_MORE = (
    f"So that the level stays below that of --limit-level with {100 * SURE:.0f} % "
    "probability; what --uncertain names besides is drawn too. "
    f"About {2 * MOST_DRAWS} sweeps."
)
SOBOL_MORE = (
    "Gap, restitution, friction, mass, force and on a beam place, within 10 %, 0.1, 50 %, 5 "
    "%, 10 % and 0.02 of the length. "
    "About 1000 sweeps."
)
DRAWS_OF_TOLERANCES = TOLERANCE_DRAWS
QUICK_DRAWS = (16, 32, 16)
SOBOL = SOBOL_SAMPLES
QUICK_SOBOL = 16
OF_A_SWEPT_FORCE = (  # options of questions that have an answer for a swept force alone
    *("free", "gaps", "uncertain", "contact", "constraint", "limit_level", "tolerances", "sobol"),
    "history",
)
NOT_OF_DISKS = (
    *("structure", "modes", "damping", "mass_ratio", "mass_kg", "position", "restitution"),
    *("friction_limit", "load"),
    *OF_A_SWEPT_FORCE,
)


@dataclass(frozen=True, kw_only=True)
class GapOptions(
    scenes.RecommendationOptions,
    scenes.SweepRunOptions,
    scenes.ImpactOptions,
    scenes.AbsorberOptions,
    scenes.BeamOptions,
):
    """Options of ``design gap``; None: not given."""

    force: float | None = option("force", more="With --load a factor on it, 1 unless given.")
    load: Path | None = option("load")
    resonance: int = option("resonance", help="Resonance near which it acts, counted from 1")
    force_tolerance: float = option("force_tolerance", default=TOLERANCE)
    free: tuple[str, ...] = option(
        "free",
        help=f"Search this too: {' or '.join(CANDIDATES)}; may be repeated",
        more="The gap is searched for each value.",
        type=click.Choice([*CANDIDATES]),
        metavar="NAME",
        usual=False,
    )
    uncertain: tuple[tuple[str, tuple[str, ...]], ...] = option("uncertain", usual=True)
    limit_level: float | None = option("limit_level", more="Prints the probability that it does.")
    tolerances: bool = option(
        switch(
            "--tolerances",
            "How precisely gap, restitution and friction must be made",
            more=TOLERANCES_MORE,
        )
    )
    sobol: bool = option(
        switch("--sobol", "Sobol shares of what the level depends on", more=SOBOL_MORE)
    )
    gaps: int | None = option(
        number(
            "--gaps",
            "Simulate so many gaps around the rule's as well, an odd number",
            type=click.IntRange(min=3),
        )
    )
    quick: bool = option("quick", help=f"A first answer from {QUICK_MEMBERS} member, unless given")
    members: int | None = option("members", default_text=str(MEMBERS))
    out: Path = option("out", default=Path("results/design_gap"))

    @property
    def usual_members(self) -> int:
        """Return the number of runs for each gap of an answer."""
        return self.members or (QUICK_MEMBERS if self.quick else MEMBERS)

    @property
    def runs(self) -> dict[str, Any]:
        """Return how a search runs, whatever acts."""
        return {
            "tolerance": self.force_tolerance,
            "members": self.usual_members,
            "seed": self.seed,
        }


def search_swept(
    model: ModalModel,
    absorber: SlidingAbsorber,
    options: GapOptions,
    force: float,
    rate: float,
    factors: tuple[float, ...],
    limits: Limits,
    executor: Executor,
) -> Advice:
    """Search the gap for the options, with a progress bar.

    For a long search the duration is printed, and a first result from fast sweeps.
    """
    low, high = find_sweep_range(model, absorber.mass_ratio, options.resonance)
    periods = 1e4 * (high - low) / rate

    def search(rate: float, factors: tuple[float, ...], **how: Any) -> Advice:
        with sweeps_bar("simulating", leave="members" not in how) as show:
            case = swept_force(model, force, options.resonance, absorber.mass_ratio, rate)
            return search_gap(
                case,
                absorber,
                free=options.free,
                friction_fixed=options.friction_limit is not None,
                factors=factors,
                limits=limits,
                progress=show,
                executor=executor,
                **options.runs | how,
            )

    scene = Scene(model, absorber)
    resonance = options.resonance
    long = (
        options.cluster is None
        and announce_duration(scene, force, resonance, periods, SWEEPS, options.threads) > LONG_S
    )
    if long and periods > COARSER * COARSE_PERIODS:
        coarse = search(COARSER * rate, (), members=1)
        if not coarse.complete:
            return coarse
        best = coarse.recommended
        if best is not None:
            announce_coarse(f"a gap of {1e3 * best.gap:.3g} mm, level {1e3 * best.level:.3g} mm.")
    return search(rate, factors)


def limits_of(options: GapOptions, model: ModalModel, absorber: SlidingAbsorber) -> Limits:
    """Return the limits given by the options.

    A yield stress becomes a limit of the impact speed, the speed at which yield begins.
    """
    limits, yield_limit = scenes.read_limits(options)
    if yield_limit is None:
        return limits
    speed = yield_limit.speed(model, absorber.mass_ratio * model.beam_mass)
    return replace(limits, impact_speed=min(speed, limits.impact_speed or speed))


def use_posterior(options: GapOptions) -> GapOptions:
    """Return the options with restitution and friction limit from a calibration's posterior.

    Values that are not given are replaced by the posterior's medians.
    """
    posterior = measured_posterior(common.parse_uncertain(options.uncertain))
    medians = {} if posterior is None else posterior.medians

    taken = {
        name
        for name in ("restitution", "friction_limit")
        if name in medians and not scenes.is_option_set(name) and name not in options.free
    }
    if "restitution" in taken:
        options = replace(options, restitution=medians["restitution"])
    if "friction_limit" in taken:
        options = replace(options, friction_limit=medians["friction_limit"])
    return options


def read_structure(options: GapOptions) -> tuple[GapOptions, Structure]:
    """Return the options and the structure.

    With --scene the values of the file's absorber replace those of the options.
    """
    if options.scene is None:
        options = use_posterior(options)
    structure, device, _ = scenes.read_source(options, position=options.position)
    if device is not None:
        restitution, friction_limit = scenes.values_of(device)
        options = replace(
            options,
            mass_ratio=device.mass_ratio,
            restitution=restitution,
            friction_limit=friction_limit,
        )
    return options, structure


def absorber_on(model: ModalModel, options: GapOptions, force: float) -> SlidingAbsorber:
    """Return the absorber at the rule's gap that the options describe."""
    ratio = scenes.mass_ratio_of(options.mass_ratio, options.mass_kg, model.beam_mass)
    absorber = scaled_absorber(model, force, options.resonance, ratio, options.restitution)
    limit = options.friction_limit
    return (
        absorber
        if limit is None
        else replace(absorber, friction=friction_law(non_negative("friction_limit", limit)))
    )


def refuse_contradictions(options: GapOptions, absorber: SlidingAbsorber) -> None:
    """Raise BadInput or ParameterError for contradictory or incomplete options.

    Options contradict each other if both set one quantity. They are incomplete if another option
    that they need is missing.
    """
    for name in options.free:
        if scenes.is_option_set(name):
            option = scenes.option_name(name)
            raise common.BadInput(
                f"--free {name} does not go with {option}: it is searched, or has the value "
                "that is given"
            )
    if "friction_limit" in options.free and absorber.friction is None:
        raise common.BadInput(
            "--free friction_limit does not go with a device that has no friction: shares of "
            "its limit are tried"
        )


def questions_of(options: GapOptions, absorber: SlidingAbsorber) -> GapQuestions:
    """Return the analyses to run for the recommended device.

    Raises BadInput or ParameterError for options that contradict each other.
    """
    contact = options.contact
    if contact is not None:
        contact = check_contact(contact, "radius of --contact in m")
    every = read_uncertain(
        common.parse_uncertain(options.uncertain),
        absorber,
        options.friction_limit is not None,
    )
    limit_level = options.limit_level
    if limit_level is not None:
        limit_level = positive("limit_level", limit_level)
    elif options.tolerances:
        raise common.BadInput(
            "--tolerances needs --limit-level: the level in m below which the device must stay"
        )
    draws = QUICK_DRAWS if options.quick else DRAWS_OF_TOLERANCES
    samples = QUICK_SOBOL if options.quick else SOBOL
    return GapQuestions(
        every,
        limit_level,
        contact,
        draws if options.tolerances else None,
        samples if options.sobol else None,
        not options.no_card,
        options.seed,
    )


def show_stages(options: GapOptions, force: float, scene: Scene, advice: Advice) -> Stages:
    """Return the progress bars of the stages after the search.

    Each stage first prints how long it takes, unless it runs on a cluster.
    """
    low, high = advice.check.limits
    periods = 1e4 * (high - low) / advice.check.rate

    @contextmanager
    def show_stage(label: str, runs: int) -> Iterator[LaneProgress | None]:
        if options.cluster is None:
            announce_duration(scene, force, options.resonance, periods, runs, options.threads)
        with sweeps_bar(label, leave=False) as show:
            yield show

    return show_stage


def under_load(options: GapOptions, load: Path) -> None:
    """Search the gap under the loads of a file, and write and list the output files.

    They are figure, runs and summary.
    """
    scenes.refuse_with_load(load, "rate")
    scenes.refuse_with_load(load, *OF_A_SWEPT_FORCE, why="there the gap alone is searched")
    options, structure = read_structure(options)
    targets = common.AnswerFiles(options.out, options.json, options.device)
    targets.check()
    model = model_for_gap(structure)
    loads = scenes.loads_of(load, model, options.resonance)
    ratio = scenes.mass_ratio_of(options.mass_ratio, options.mass_kg, model.beam_mass)

    with workers(options.threads, options.cluster) as executor:
        case = AppliedLoads(model, loads, options.resonance)
        case = case.times(1.0 if options.force is None else options.force)
        absorber = case.absorber(ratio, options.restitution, options.friction_limit)

        def search(**how: Any) -> Advice:
            with runs_bar("simulating") as show:
                return search_gap(
                    case,
                    absorber,
                    friction_fixed=options.friction_limit is not None,
                    threads=options.threads,
                    progress=show,
                    executor=executor,
                    **options.runs | how,
                )

        members = options.usual_members
        # of a run that is timed: a gap from which a search begins, or 1 mm where nothing moves
        gap = design_gap_for(model, loads) or RigidWalls.gap
        probe = Scene(model, impact_absorber(gap, options.restitution, None, ratio))
        number = CHECK_MEMBERS + (PAIRS if members <= MEMBERS else 10 + 5 * members)
        long = (
            options.cluster is None
            and announce_load_runs(probe, loads, number, options.threads) > LONG_S
        )
        if long and members > 1:
            coarse = search(members=1)
            scale, unit = DISPLAY_UNITS[UNITS[case.measure]]
            best = coarse.recommended
            if best is None:
                raise KeyboardInterrupt
            click.echo(
                (
                    f"Coarse answer, of one run a gap: a gap of {1e3 * best.gap:.3g} mm, "
                    f"{LABELS[case.measure]} {scale * best.level:.3g} {unit}."
                ),
                err=True,
            )
        advice = search()
    if advice.recommended is None:
        raise KeyboardInterrupt
    answer = GapAnswer(advice, structure, GapQuestions(card=not options.no_card))
    common.name_files(targets.write(answer))
    common.end_early(advice.complete, "the files hold the runs that were finished.")


@common.command(
    GapOptions,
    examples=(
        "design gap --force 3.5 --quick",
        "design gap --force 3.5 --uncertain gap=5% --device device.json",
        "design gap --scene disk.toml --quick",
    ),
)
def main(options: GapOptions) -> None:
    """Choose the gap of an impact absorber for a force near a resonance.

    The structure is the paper's beam or another one.

    Sweeps up and down bracket the gap with the lowest level (sharp), and by the scaling law the one
    whose largest level over the tolerance of the force is lowest (recommended); the design rule's
    gap stands beside them. Writes levels.png, levels.csv, summary.json, the level over the
    frequency as frequency.png, and the recommended device's card as card.html, with curves, and
    card.json. Ctrl-C ends the simulation early and leaves what is finished.

    With --scene of a bladed disk the clearance is one for all its absorbers, and the level that of
    the worst sector.

    With --load what is made small is the measure that belongs to the loads (docs/loads.md).
    """
    with common.plain_errors():
        disk = scenes.read_disk(options.scene, "structure")
        if disk is not None:
            disk_commands.refuse_with_disk(NOT_OF_DISKS)
            common.AnswerFiles(options.out, options.json, options.device).check()
            disk_commands.choose_gap_on_file(disk, options)
            return
        if options.load is not None:
            under_load(options, options.load)
            return
        if options.force is None:
            raise common.BadInput(
                "--force is missing: the amplitude of the harmonic force in N, or --load FILE"
            )
        force = usable_force("--force", options.force)
        options, structure = read_structure(options)
        model = model_for_gap(structure)
        scenes.warn_of_nodes(model, options.resonance)
        absorber = absorber_on(model, options, force)
        usable_gap("--force", f"{force:g} N", "the design rule", rigid_walls(absorber).gap)
        refuse_contradictions(options, absorber)
        questions = questions_of(options, absorber)
        factors = () if options.gaps is None else tuple(map(float, gap_factors(options.gaps)))
        targets = common.AnswerFiles(options.out, options.json, options.device, options.history)
        targets.check()
        rate = (
            default_rate(model, (options.resonance,))
            if options.rate is None
            else usable_rate("--rate", options.rate, [PAPER_LIMITS])
        )
        limits = limits_of(options, model, absorber)
        with executor_on(options.threads, options.cluster) as executor:
            advice = search_swept(model, absorber, options, force, rate, factors, limits, executor)
            if advice.recommended is None:
                raise KeyboardInterrupt
            scene = Scene(model, advice.recommended.absorber)
            stages = show_stages(options, force, scene, advice)
            answer = complete_gap_answer(advice, structure, questions, executor, stages)
        files = targets.write(answer)
    common.name_files(files)
    common.end_early(advice.complete, "the files hold the runs that were finished.")
