"""Choose the gap of an impact absorber for a force by simulation: the one with the lowest level, and the one that bears a change of the force."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.curve import PerformanceCurve
from impact_env.drive import PAPER_LIMITS, default_rate
from impact_env.ensemble import Executor
from impact_env.loads import Loads
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Beam,
    RigidWalls,
    SlidingAbsorber,
    friction_law,
    impact_absorber,
    non_negative,
    positive,
    require,
)
from impact_env.scene import Scene
from optimisation.cli import common
from optimisation.cli import scene_options as scenes
from optimisation.duration import (
    COARSE_PERIODS,
    COARSER,
    LONG_S,
    announce_coarse,
    announce_duration,
    announce_load_runs,
)
from optimisation.executors import cluster_option, workers
from optimisation.executors import executor as executor_on
from optimisation.extremes import usable_force, usable_gap, usable_rate
from optimisation.files import require_writable, write_files
from optimisation.frequency_levels import (
    NO_ABSORBER,
    RECOMMENDED,
    ResonanceCurves,
    find_worst_run,
    record_worst_run,
    resonance_curves,
)
from optimisation.friction_rule import PAPER_FRICTION
from optimisation.gap_advice import FREE, MEMBERS, TOLERANCE, Advice, Answer, Limits, advise
from optimisation.gap_card import (
    ALLOWED,
    YIELD_PRESSURE,
    case_of,
    change_with_modes,
    material,
    meeting_mass,
    service_loads,
    speed_for_pressure,
    uncertain_levels,
)
from optimisation.gap_check import RESTITUTION, gap_factors, rigid_walls, scaled_absorber
from optimisation.gap_search import PAIRS
from optimisation.load_comparison import LoadAdvice, advise_for_loads
from optimisation.measures import SHOWN, TOLD, UNITS, design_gap_for
from optimisation.mounting import mounted
from optimisation.progress import runs_bar, sweeps_bar
from optimisation.report import load_gap_report as report
from optimisation.report.card import Row, write_card
from optimisation.report.card import text as as_text
from optimisation.report.design_figures import save_sensitivity
from optimisation.report.frequency_report import (
    HISTORY_FORMATS,
    HISTORY_HELP,
    frequency_files,
    save_history,
)
from optimisation.report.gap_report import (
    COLUMNS,
    Unsure,
    answer,
    baselines,
    card,
    probability,
    rows,
    save_figure,
    summary,
    text,
    warnings,
)
from optimisation.report.precision_report import (
    sensitivity_data,
    sensitivity_lines,
    sensitivity_rows,
    tolerance_data,
    tolerance_lines,
    tolerance_rows,
)
from optimisation.sobol import Sensitivity, device_box, device_sensitivity
from optimisation.sweep_range import find_sweep_range
from optimisation.tolerances import (
    DRAWS_ALONE,
    DRAWS_CHECKED,
    DRAWS_TOGETHER,
    SURE,
    Tolerances,
    find_tolerances,
)
from optimisation.uncertain import FRICTION, GAP, Spread, require_parts, spreads

QUICK_MEMBERS = 1
SWEEPS = 40  # of a search, about
MEMBERS_HELP = (
    f"Runs for each gap of an answer, other in phase and 1e-6 of force.  [default: {MEMBERS}]"
)
FRICTION_HELP = f"Friction limit in N at any gap; 0: none.  [default: the paper's {PAPER_FRICTION} N by the scaling law, in proportion to the gap]"
CONTACT_HELP = f"Estimate contact time and force: of absorber and wall {ALLOWED}; radius in m of the rounder one."
CONSTRAINTS = ("stroke", "impact_speed", "yield_stress")
CONSTRAINT_HELP = (
    "Answer within a limit, in SI units; may be repeated: stroke (m, from the middle of the cavity), impact_speed (m/s, the largest), yield_stress "
    f"(Pa, of the softer body of --contact, whose peak pressure stays below {YIELD_PRESSURE:g} times it)."
)
MOST_DRAWS = 3 * DRAWS_ALONE + DRAWS_TOGETHER + DRAWS_CHECKED
TOLERANCES_HELP = (
    "With --limit-level: how precisely gap, restitution and friction must be made so that the level stays below it with "
    f"{100 * SURE:.0f} % probability; what --uncertain names besides is drawn too. About {2 * MOST_DRAWS} sweeps."
)
SOBOL_HELP = (
    "Sobol shares of the recommended device: which of gap, restitution, friction, mass, force and on a beam place its level depends on, within "
    "10 %, 0.1, 50 %, 5 %, 10 % and 0.02 of the length. About 1000 sweeps."
)
DRAWS_OF_TOLERANCES = (DRAWS_ALONE, DRAWS_TOGETHER, DRAWS_CHECKED)
QUICK_DRAWS = (16, 32, 16)
SOBOL = 64
QUICK_SOBOL = 16
OF_SCENE = (
    "structure",
    "modes",
    "damping",
    "mass_ratio",
    "mass_kg",
    "position",
    "restitution",
    "friction_limit",
)


def runs_of(given: dict[str, Any]) -> dict[str, Any]:
    """Return how a search runs, whatever acts."""
    members = given["members"] or (QUICK_MEMBERS if given["quick"] else MEMBERS)
    return {"tolerance": given["force_tolerance"], "members": members, "seed": given["seed"]}


def simulated(
    model: ModalModel,
    absorber: SlidingAbsorber,
    given: dict[str, Any],
    rate: float,
    factors: tuple[float, ...],
    limits: Limits,
    executor: Executor,
) -> Advice:
    """Search the gap as the options say, under a bar; a long search says how long, and answers from fast sweeps first."""
    low, high = find_sweep_range(model, absorber.mass_ratio, given["resonance"])
    periods = 1e4 * (high - low) / rate

    def search(rate: float, factors: tuple[float, ...], **how: Any) -> Advice:
        with sweeps_bar("simulating", leave="members" not in how) as show:
            return advise(
                model,
                given["force"],
                given["resonance"],
                absorber,
                free=given["free"],
                friction_given=given["friction_limit"] is not None,
                factors=factors,
                percent_per_100_periods=rate,
                limits=limits,
                progress=show,
                executor=executor,
                **runs_of(given) | how,
            )

    scene = Scene(model, absorber)
    force, resonance = given["force"], given["resonance"]
    long = (
        given["cluster"] is None
        and announce_duration(scene, force, resonance, periods, SWEEPS, given["threads"]) > LONG_S
    )
    if long and periods > COARSER * COARSE_PERIODS:
        coarse = search(COARSER * rate, (), members=1)
        if not coarse.complete:
            return coarse
        best = coarse.recommended
        if best is not None:
            announce_coarse(f"a gap of {1e3 * best.gap:.3g} mm, level {1e3 * best.level:.3g} mm.")
    return search(rate, factors)


def limits_of(given: dict[str, Any], model: ModalModel, absorber: SlidingAbsorber) -> Limits:
    """Return the limits that the options give: a yield stress as the impact speed at which yield begins."""
    found = {name: positive(f"constraint {name}", value) for name, value in given["constraint"]}
    speeds = [found["impact_speed"]] if "impact_speed" in found else []
    if "yield_stress" in found:
        if not given["contact"]:
            raise common.BadInput(
                "--constraint yield_stress needs --contact: materials and radius that touch"
            )
        first, second, radius = given["contact"]
        mass = meeting_mass(model, absorber.mass_ratio * model.beam_mass)
        pressure = YIELD_PRESSURE * found["yield_stress"]
        speeds.append(speed_for_pressure(first, second, radius, mass, pressure))
    return Limits(found.get("stroke"), min(speeds, default=None))


def structure_in(given: dict[str, Any]) -> Structure:
    """Return the structure that the options describe; with --scene the values of the file's absorber take the place of the options'."""
    if given["scene"] is None:
        return scenes.structure_of(
            given["structure"],
            given["position"],
            modes=given["modes"],
            damping_ratio=given["damping"],
        )
    structure, absorber = scenes.read_device(given["scene"], *OF_SCENE)
    given["friction_limit"] = (
        0.0 if absorber.friction is None else absorber.friction.limit
    )  # that of the file stays as it is, whatever the gap
    given["mass_ratio"], given["restitution"] = (
        absorber.mass_ratio,
        rigid_walls(absorber).restitution,
    )
    return structure


def absorber_on(model: ModalModel, given: dict[str, Any]) -> SlidingAbsorber:
    """Return the absorber at the rule's gap that the options describe."""
    ratio = scenes.mass_ratio_of(given["mass_ratio"], given["mass_kg"], model.beam_mass)
    absorber = scaled_absorber(
        model, given["force"], given["resonance"], ratio, given["restitution"]
    )
    limit = given["friction_limit"]
    return (
        absorber
        if limit is None
        else replace(absorber, friction=friction_law(non_negative("friction_limit", limit)))
    )


def refuse_contradictions(given: dict[str, Any], absorber: SlidingAbsorber) -> None:
    """Raise BadInput or ParameterError for options that say two things of one quantity, or need what is left out."""
    for name in given["free"]:
        if scenes.is_given(name):
            option = scenes.option_name(name)
            raise common.BadInput(
                f"--free {name} does not go with {option}: it is searched, or has the value that is given"
            )
    if "friction_limit" in given["free"] and absorber.friction is None:
        raise common.BadInput(
            "--free friction_limit does not go with a device that has no friction: shares of its limit are tried"
        )
    if given["contact"] is None:
        return
    if given["no_card"]:
        raise common.BadInput("--contact does not go with --no-card: its estimate is on the card")
    first, second, radius = given["contact"]
    for name in (first, second):
        material(name)
    given["contact"] = (first, second, positive("radius of --contact in m", radius))


def model_on(structure: Structure) -> ModalModel:
    """Return a structure's modal model, the level read at the absorber's place where nothing else is said."""
    return modal_model(structure) if isinstance(structure, Beam) else mounted(structure)


def distributions(given: dict[str, Any], absorber: SlidingAbsorber) -> tuple[Spread, ...]:
    """Return the uncertain quantities; raises ParameterError for those that the absorber lacks, and for SI values of searched ones."""
    every = spreads(common.uncertain_of(given["uncertain"]))
    require_parts(every, absorber)
    for one in every:
        searched = one.name == GAP or (one.name == FRICTION and given["friction_limit"] is None)
        require(
            one.relative or not searched,
            f"uncertain {one.name}",
            one.words,
            "in %, as the number itself is searched",
        )
    return every


def curve_at(found: Advice, answer: Answer) -> PerformanceCurve:
    """Return the runs of an answer."""
    return found.check.curves[int(np.argmin(np.abs(found.check.gaps - answer.gap)))]


def frequency_of(found: Advice, answer: Answer, executor: Executor) -> ResonanceCurves:
    """Return the level over the frequency of the worst member of an answer, and without absorber."""
    check = found.check
    curve = curve_at(found, answer)
    member, _ = find_worst_run(curve)
    cases = {
        RECOMMENDED: (case_of(check, answer.absorber), member),
        NO_ABSORBER: (case_of(check, None), 0),
    }
    return resonance_curves(cases, curve.members, executor)


@dataclass(frozen=True)
class Precision:
    """How precisely a device must be made, and which of its numbers its level depends on; None where it is not asked for."""

    absorber: SlidingAbsorber
    tolerances: Tolerances | None = None
    sobol: Sensitivity | None = None

    @property
    def lines(self) -> list[str]:
        """What is printed."""
        found = []
        if self.tolerances is not None:
            found += tolerance_lines(self.tolerances, self.absorber)
        if self.sobol is not None:
            found += sensitivity_lines(self.sobol)
        return found

    @property
    def groups(self) -> tuple[tuple[str, tuple[Row, ...]], ...]:
        """Groups of a card."""
        found = []
        if self.tolerances is not None:
            heading = f"How precisely it must be made for a level below {1e3 * self.tolerances.limit:.4g} mm"
            found.append((heading, tolerance_rows(self.tolerances, self.absorber)))
        if self.sobol is not None:
            rows = sensitivity_rows(self.sobol)
            found.append(("Sobol shares of the level's variance (95 % interval)", rows))
        return tuple(found)

    @property
    def content(self) -> dict[str, object]:
        """JSON values."""
        found: dict[str, object] = {}
        if self.tolerances is not None:
            found["tolerances"] = tolerance_data(self.tolerances, self.absorber)
        if self.sobol is not None:
            found["sobol"] = sensitivity_data(self.sobol)
        return found


def precision_of(
    found: Advice,
    best: Answer,
    structure: Structure,
    every: Sequence[Spread],
    given: dict[str, Any],
    executor: Executor,
) -> Precision:
    """Run what --tolerances and --sobol ask for, under a bar."""
    case = case_of(found.check, best.absorber)
    low, high = found.check.limits
    periods = 1e4 * (high - low) / found.check.rate
    tolerances = None
    sobol = None

    def announce(runs: int) -> None:
        if given["cluster"] is None:
            force, resonance = given["force"], given["resonance"]
            announce_duration(case.scene, force, resonance, periods, runs, given["threads"])

    if given["tolerances"]:
        draws = QUICK_DRAWS if given["quick"] else DRAWS_OF_TOLERANCES
        announce(2 * (3 * draws[0] + draws[1] + draws[2]))
        with sweeps_bar("tolerances", leave=False) as show:
            tolerances = find_tolerances(
                case, given["limit_level"], every, draws=draws, progress=show, executor=executor
            )
    if given["sobol"]:
        samples = QUICK_SOBOL if given["quick"] else SOBOL
        announce(2 * samples * (len(device_box(case, structure)) + 2))
        with sweeps_bar("Sobol shares", leave=False) as show:
            sobol = device_sensitivity(
                case, structure, samples, seed=given["seed"], progress=show, executor=executor
            )
    return Precision(best.absorber, tolerances, sobol)


def write(
    out: Path,
    found: Advice,
    unsure: Unsure | None,
    frequency: Sequence[ResonanceCurves],
    precision: Precision | None,
) -> list[Path]:
    """Write the figures and the tables into a folder, and return the files."""
    content = summary(found) | ({} if unsure is None else {"uncertain": unsure.plain()})
    content |= {} if precision is None else precision.content
    contents: dict[Path | None, object] = {
        out / "levels.csv": (COLUMNS, rows(found)),
        out / "summary.json": content,
        out / "levels.png": partial(save_figure, found=found),
    }
    if precision is not None and precision.sobol is not None:
        contents[out / "sensitivity.png"] = partial(
            save_sensitivity, found=precision.sobol, of="the recommended device"
        )
    return write_files(contents | frequency_files(out, frequency))


def given_gap(model: ModalModel, loads: Loads) -> float:
    """Return a gap in m for a run that is timed: that from which a search begins, or 1 mm where nothing moves."""
    return design_gap_for(model, loads) or RigidWalls.gap


def under_load(given: dict[str, Any]) -> None:
    """Search the gap under the loads of a file, write figure, runs and summary, and tell of them."""
    scenes.refuse_beside_load(given["load"], "rate")
    scenes.refuse_beside_load(
        given["load"],
        "free",
        "gaps",
        "uncertain",
        "contact",
        "constraint",
        "limit_level",
        "tolerances",
        "sobol",
        "history",
        "no_card",
        why="there the gap alone is searched, and there is no card",
    )
    structure = structure_in(given)
    require_writable("--out", given["out"])
    common.check_target("--device", given["device"], (".json",))
    model = model_on(structure)
    loads = scenes.loads_of(given["load"], model, given["resonance"])
    ratio = scenes.mass_ratio_of(given["mass_ratio"], given["mass_kg"], model.beam_mass)

    with workers(given["threads"], given["cluster"]) as executor:

        def search(**how: Any) -> LoadAdvice:
            with runs_bar("simulating") as show:
                return advise_for_loads(
                    model,
                    loads,
                    given["resonance"],
                    factor=1.0 if given["force"] is None else given["force"],
                    threads=given["threads"],
                    mass_ratio=ratio,
                    restitution=given["restitution"],
                    friction_limit=given["friction_limit"],
                    progress=show,
                    executor=executor,
                    **runs_of(given) | how,
                )

        members = runs_of(given)["members"]
        probe = Scene(
            model, impact_absorber(given_gap(model, loads), given["restitution"], None, ratio)
        )
        number = PAIRS if members <= MEMBERS else 10 + 5 * members
        long = (
            given["cluster"] is None
            and announce_load_runs(probe, loads, number, given["threads"]) > LONG_S
        )
        if long and members > 1:
            coarse = search(members=1)
            scale, unit = SHOWN[UNITS[coarse.measure]]
            best = coarse.recommended
            click.echo(
                f"Coarse answer, of one run a gap: a gap of {1e3 * best.gap:.3g} mm, {TOLD[coarse.measure]} {scale * best.level:.3g} {unit}.",
                err=True,
            )
        found = search()
    out = given["out"]
    table = (report.COLUMNS, report.rows(found))
    figure = partial(report.save_figure, found=found)
    click.echo(report.text(found))
    files = write_files(
        {
            out / "runs.csv": table,
            out / "summary.json": report.summary(found),
            out / "levels.png": figure,
        }
    )
    if given["device"] is not None:
        scenes.write_device(given["device"], structure, found.recommended.absorber)
        files.append(given["device"])
    common.name_files(files)


@common.command()
@scenes.structure_option
@scenes.scene_option
@click.option(
    "--force",
    type=float,
    help="Amplitude of the harmonic force in N; with --load a factor on it.  [default: with --load 1]",
)
@scenes.load_option
@click.option(
    "--resonance",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Resonance near which it acts, counted from 1.",
)
@click.option(
    "--force-tolerance",
    type=float,
    default=TOLERANCE,
    show_default=True,
    help="Share by which the force may be larger or smaller.",
)
@click.option(
    "--mass-ratio",
    type=float,
    default=DEFAULT_MASS_RATIO,
    show_default=True,
    help="Absorber mass over beam mass.",
)
@scenes.mass_option
@scenes.position_option
@click.option(
    "--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept."
)
@click.option(
    "--restitution",
    type=float,
    default=RESTITUTION,
    show_default=True,
    help="Coefficient of restitution in the simulation, 0 to 1.",
)
@click.option("--friction-limit", type=float, help=FRICTION_HELP)
@click.option(
    "--free",
    multiple=True,
    type=click.Choice([*FREE]),
    help="Search this one too, the gap anew for each value; may be repeated.",
)
@common.uncertain_option
@click.option(
    "--contact", type=(str, str, float), metavar="MATERIAL MATERIAL RADIUS", help=CONTACT_HELP
)
@click.option(
    "--constraint",
    multiple=True,
    type=(click.Choice(CONSTRAINTS), float),
    metavar="NAME LIMIT",
    help=CONSTRAINT_HELP,
)
@click.option(
    "--limit-level",
    type=float,
    help="Print the probability that the level of the recommended device stays below this, in m.",
)
@click.option("--tolerances", is_flag=True, help=TOLERANCES_HELP)
@click.option("--sobol", is_flag=True, help=SOBOL_HELP)
@common.rate_option
@click.option(
    "--damping",
    type=float,
    default=Beam.damping_ratio,
    show_default=True,
    help="Damping ratio of all modes.",
)
@click.option("--quick", is_flag=True, help=f"A look: {QUICK_MEMBERS} member, unless given.")
@click.option(
    "--gaps",
    type=click.IntRange(min=3),
    help="Simulate so many gaps around the rule's besides, odd, the rule's in the middle.",
)
@click.option("--members", type=click.IntRange(min=1), help=MEMBERS_HELP)
@common.seed_option
@common.threads_option
@cluster_option
@common.file_option("--device", "Write structure and recommended absorber as a scene, .json.")
@common.file_option("--history", HISTORY_HELP)
@click.option(
    "--no-card",
    is_flag=True,
    help="Leave the card out: what the device bears, and what a tuned absorber or a damper would do.",
)
@common.out_option("results/design_gap")
def main(**given: Any) -> None:
    """Choose the gap of an impact absorber on the paper's beam, or another structure, for a force near a resonance.

    Sweeps up and down bracket the gap with the lowest level (sharp), and by the scaling law the one whose largest level over the tolerance of the
    force is lowest (recommended); the design rule's gap stands beside them. Writes levels.png, levels.csv, summary.json, the level over the
    frequency as frequency.png, and the recommended device's card as card.html, with curves, and card.json. Ctrl-C ends the
    simulation early and leaves what is finished.

    With --load what is made small is the measure that belongs to the loads (docs/loads.md), and there is no card.
    """
    with common.plain_errors():
        scenes.refuse_beside(given["structure"], "modes", "damping")
        if given["load"] is not None:
            under_load(given)
            return
        if given["force"] is None:
            raise common.BadInput(
                "--force is missing: the amplitude of the harmonic force in N, or --load FILE"
            )
        given["force"] = usable_force("--force", given["force"])
        structure = structure_in(given)
        model = model_on(structure)
        scenes.warn_of_nodes(model, given["resonance"])
        absorber = absorber_on(model, given)
        usable_gap("--force", f"{given['force']:g} N", "the design rule", rigid_walls(absorber).gap)
        refuse_contradictions(given, absorber)
        factors = () if given["gaps"] is None else tuple(map(float, gap_factors(given["gaps"])))
        require_writable("--out", given["out"])
        common.check_target("--device", given["device"], (".json",))
        common.check_target("--history", given["history"], HISTORY_FORMATS)
        rate = (
            default_rate(model, (given["resonance"],))
            if given["rate"] is None
            else usable_rate("--rate", given["rate"], [PAPER_LIMITS])
        )
        every = distributions(given, absorber)
        limits = limits_of(given, model, absorber)
        if given["limit_level"] is not None:
            given["limit_level"] = positive("limit_level", given["limit_level"])
        elif given["tolerances"]:
            raise common.BadInput(
                "--tolerances needs --limit-level: the level in m below which the device must stay"
            )
        with executor_on(given["threads"], given["cluster"]) as executor:
            found = simulated(model, absorber, given, rate, factors, limits, executor)
            if found.recommended is None:
                raise KeyboardInterrupt
            best = found.recommended if found.complete else None
            unsure = (
                None
                if best is None or not every
                else Unsure(every, *uncertain_levels(found, best, every, executor))
            )
            precision = (
                None
                if best is None
                else precision_of(found, best, structure, every, given, executor)
            )
            own, beside = None, list[str]()
            frequency = [] if best is None else [frequency_of(found, best, executor)]
            if best is not None and not given["no_card"]:
                service = service_loads(found, best, executor)
                more = change_with_modes(found, best, structure, given["seed"], executor)
                own = card(found, service, unsure, given["contact"], more, frequency)
                if precision is not None:
                    own = replace(own, groups=(*own.groups, *precision.groups))
                beside = [baselines(service)]
        told = [*answer(found), *probability(found, given["limit_level"]), *beside]
        told += [] if unsure is None else [unsure.words]
        told += [*([] if precision is None else precision.lines), "", text(found)]
        told += ["", *warnings(found), *([] if own is None else ["", as_text(own)])]
        click.echo("\n".join(told))
        files = write(given["out"], found, unsure, frequency, precision)
        if given["history"] is not None and best is not None:
            run = record_worst_run(case_of(found.check, best.absorber), curve_at(found, best))
            files += write_files({given["history"]: partial(save_history, run=run)})
        if given["device"] is not None and found.recommended is not None:
            scenes.write_device(given["device"], structure, found.recommended.absorber)
            files.append(given["device"])
        files += [] if own is None else write_card(given["out"], own)
    common.name_files(files)
    common.end_early(found.complete, "the files hold the runs that were finished.")
