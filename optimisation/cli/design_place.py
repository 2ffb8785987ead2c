"""Place, mass and gap of an impact absorber."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click

from impact_env.ensemble import Executor
from impact_env.modes import Structure
from impact_env.parameters import Beam, positive
from optimisation.absorber_rules import RESTITUTION, rigid_walls
from optimisation.baselines import simulate_baselines
from optimisation.cli import common
from optimisation.cli import scene_options as scenes
from optimisation.cli.design_gap import CONSTRAINT_MORE, CONSTRAINTS, FRICTION_TEXT
from optimisation.cli.options import option
from optimisation.contact import ALLOWED, YieldLimit, material
from optimisation.duration import LONG_S, duration_in_words, seconds_per_period
from optimisation.executors import executor as executor_on
from optimisation.extremes import usable_force
from optimisation.files import require_writable, write_files
from optimisation.frequency_levels import (
    NO_ABSORBER,
    RECOMMENDED,
    ResonanceCurves,
    find_worst_run,
    record_worst_run,
    resonance_curves,
)
from optimisation.gap_advice import MEMBERS, TOLERANCE, Limits
from optimisation.place_advice import (
    MASS_RATIOS,
    SURE,
    TRIAL_PLACES,
    PlaceAdvice,
    SweepPlan,
    advise_place,
)
from optimisation.place_map import BEAM_PLACES, find_places
from optimisation.progress import sweeps_bar
from optimisation.report import place_report as report
from optimisation.report.card import text as as_text
from optimisation.report.card import write_card
from optimisation.report.frequency_report import (
    HISTORY_FORMATS,
    frequency_files,
    save_history,
)
from optimisation.service import impact_loads

QUICK_TRIAL_PLACES = 3  # places of each mass
QUICK_MEMBERS = 1
DEFAULT_RESONANCES = (1, 1)
LOAD_WORDS = (
    "--load is not possible here: places are ranked by the response to a harmonic force near resonances; "
    "`design gap --load FILE --position PLACE` searches the gap at one place"
)
POSITION_TEXT = f"{BEAM_PLACES} places over the length; the places that the file lists, or all its nodes in the direction of the one that it lists"


@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """Options of ``design place``; None or empty: not given."""

    structure: Path | None = option("structure")
    scene: Path | None = option(
        "scene", help="Structure and impact absorber from a .toml or .json file"
    )
    position: tuple[float, ...] = option(
        "position",
        help="Try this place only; may be repeated",
        more="A share of the beam's length, or the number of a node, row or place of the file.",
        default=None,
        default_text=POSITION_TEXT,
        multiple=True,
    )
    modes: int = option("modes", default=Beam.modes)
    damping: float = option("damping", default=Beam.damping_ratio)
    mass_ratio: tuple[float, ...] = option(
        "mass_ratio",
        help="Absorber mass over the structure's to try; may be repeated",
        default=None,
        default_text=", ".join(f"{ratio:g}" for ratio in MASS_RATIOS),
        multiple=True,
    )
    mass_kg: tuple[float, ...] = option(
        "mass_kg", help="Absorber mass to try in place of ratios; may be repeated", multiple=True
    )
    restitution: float = option("restitution", default=RESTITUTION)
    friction_limit: float | None = option(
        "friction_limit",
        help="Friction limit at any gap, 0 for none",
        default_text=FRICTION_TEXT,
    )
    load: Path | None = option("load", hidden=True)
    force: float | None = option(
        "force", help="Amplitude of the harmonic force, the same near each of --resonances"
    )
    resonances: tuple[int, int] = option("resonances", default=DEFAULT_RESONANCES, default_text="1")
    at: tuple[tuple[int, float], ...] = option("at", more="In place of --force and --resonances.")
    force_tolerance: float = option(
        "force_tolerance",
        help="Share by which the forces may be larger or smaller, all together",
        default=TOLERANCE,
    )
    contact: tuple[str, str, float] | None = option(
        "contact", more=f"Estimates contact time and force. Each material is {ALLOWED}."
    )
    constraint: tuple[tuple[str, float], ...] = option(
        "constraint",
        more=CONSTRAINT_MORE,
        type=click.Tuple([click.Choice(CONSTRAINTS), float]),
    )
    limit_level: float | None = option(
        "limit_level",
        more=f"The lightest mass that does so with {100 * SURE:.0f} % probability is recommended.",
        usual=True,
    )
    rate: float | None = option("rate")
    quick: bool = option(
        "quick",
        help=f"A first answer from {QUICK_MEMBERS} member, unless given, and {QUICK_TRIAL_PLACES} places of each mass",
    )
    members: int | None = option("members", default_text=str(MEMBERS))
    seed: int = option("seed")
    threads: int | None = option("threads")
    cluster: str | None = option("cluster")
    json: Path | None = option("json", help="Write the summary here, too")
    device: Path | None = option("device", usual=True)
    history: Path | None = option("history")
    no_card: bool = option("no_card")
    out: Path = option("out", default=Path("results/design_place"))


def forces_of(options: PlaceOptions) -> dict[int, float]:
    """Return the force in N by resonance; raises BadInput unless the options say it once."""
    if options.at:
        for name in ("force", "resonances"):
            if scenes.is_option_set(name):
                raise common.BadInput(
                    f"--{name} does not go with --at, which names resonances with their forces"
                )
        forces: dict[int, float] = {}
        for resonance, force in options.at:
            if resonance in forces:
                raise common.BadInput(
                    f"--at {resonance}:{force:g} is not allowed: each resonance once, and {resonance}:{forces[resonance]:g} is given"
                )
            forces[resonance] = usable_force("--at", force)
        return forces
    if options.force is None:
        raise common.BadInput(
            "--force is missing: the amplitude of the harmonic force in N, or --at RESONANCE:FORCE"
        )
    force = usable_force("--force", options.force)
    return dict.fromkeys(options.resonances, force)


class PlaceStructure(NamedTuple):
    """A structure and its file, None if it has none."""

    structure: Structure
    file: Path | None


def read_structure(options: PlaceOptions) -> tuple[PlaceOptions, PlaceStructure]:
    """Return the structure, and the options: with --scene mass, restitution and friction are those of the file's absorber."""
    if options.scene is None:
        file = options.structure
        if file is not None:
            return options, PlaceStructure(scenes.read_structure(file), file)
        beam = Beam(modes=options.modes, damping_ratio=options.damping)
        return options, PlaceStructure(beam, None)
    structure, absorber = scenes.read_device(
        options.scene,
        "structure",
        "modes",
        "damping",
        "mass_ratio",
        "mass_kg",
        "restitution",
        "friction_limit",
    )
    of_file = replace(
        options,
        mass_ratio=(absorber.mass_ratio,),
        restitution=rigid_walls(absorber).restitution,
        friction_limit=0.0 if absorber.friction is None else absorber.friction.limit,
    )
    return of_file, PlaceStructure(structure, None)


def masses_of(options: PlaceOptions, structure_mass: float) -> tuple[float, ...]:
    """Return the mass ratios to try."""
    if not options.mass_kg:
        return options.mass_ratio or MASS_RATIOS
    if options.mass_ratio:
        raise common.BadInput(
            "--mass-kg does not go with --mass-ratio: each says what the masses are"
        )
    return tuple(
        scenes.mass_ratio_of(MASS_RATIOS[0], mass, structure_mass) for mass in options.mass_kg
    )


def yield_limit_of(options: PlaceOptions, limits: dict[str, float]) -> YieldLimit | None:
    """Return the limit that yield sets to impacts, None without one; raises BadInput or ParameterError for options that do not go together."""
    contact = options.contact
    if contact is None:
        if "yield_stress" in limits:
            raise common.BadInput(
                "--constraint yield_stress needs --contact: materials and radius that touch"
            )
        return None
    first, second, radius = contact
    for name in (first, second):
        material(name)
    radius = positive("radius of --contact in m", radius)
    if "yield_stress" in limits:
        return YieldLimit((first, second), radius, limits["yield_stress"])
    if options.no_card:
        raise common.BadInput("--contact does not go with --no-card: its estimate is on the card")
    return None


def announce(plan: SweepPlan, threads: int | None) -> None:
    """Print how long the runs take at most, where that is long."""
    from impact_env.ensemble import available_cores

    seconds = sum(
        plan.sweeps[r] * periods * seconds_per_period(scene, force, r)
        for r, (scene, force, periods) in plan.scenes.items()
    ) / min(threads or available_cores(), 2)
    if seconds > LONG_S:
        click.echo(
            f"About {duration_in_words(seconds)}, within a factor of three: at most {plan.total} sweeps. --quick, fewer masses (--mass-ratio) or a "
            "higher --rate take less.",
            err=True,
        )


def curves_of(advice: PlaceAdvice, executor: Executor) -> list[ResonanceCurves]:
    """Return the levels over the frequency of the recommended device's worst member and without absorber, near each resonance."""
    best = advice.recommended
    assert best is not None
    curves = []
    for r in advice.forces:
        member, _ = find_worst_run(best.runs[r])
        model = advice.places.model_at(best.place)
        cases = {
            RECOMMENDED: (advice.case_of(best, r), member),
            NO_ABSORBER: (advice.study.case(model, None, r), 0),
        }
        curves.append(resonance_curves(cases, best.runs[r].members, executor))
    return curves


def worst_resonance(advice: PlaceAdvice) -> int:
    """Return the resonance at which the recommended device leaves most of the level without absorber."""
    best = advice.recommended
    assert best is not None
    return max(best.parts, key=lambda part: part.share).resonance


def write(
    options: PlaceOptions, advice: PlaceAdvice, curves: Sequence[ResonanceCurves]
) -> list[Path]:
    """Write figures, map and summary, and what the options ask for; return the files."""
    out = options.out
    content = report.summary(advice)
    contents: dict[Path | None, object] = {
        options.json: content,
        out / "summary.json": content,
        out / "places.csv": (report.columns(advice), report.rows(advice)),
        out / "places.png": partial(report.save_places, advice=advice),
    }
    contents |= frequency_files(out, curves)
    best = advice.recommended
    if options.history is not None and best is not None:
        r = worst_resonance(advice)
        run = record_worst_run(advice.case_of(best, r), best.runs[r])
        contents[options.history] = partial(save_history, run=run)
    files = write_files(contents)
    if options.device is not None and best is not None:
        scenes.write_device(options.device, advice.structure_with(best), best.absorber)
        files.append(options.device)
    return files


@common.command(
    PlaceOptions,
    examples=(
        "design place --force 3.5 --quick",
        "design place --at 1:3.5 --at 2:35 --mass-ratio 0.02",
    ),
)
def main(options: PlaceOptions) -> None:
    """Choose where an impact absorber sits, how heavy it is and which gap it has, for forces near one or several resonances.

    All places are ranked by the linear structure; the best few of each mass run, and the gap of the best is searched as by design_gap, for all
    resonances together. The level is read where the file says, on a beam at its free end. Writes places.png (the structure coloured by reach, and
    levels over the place), places.csv (the map), frequency.png, summary.json and the recommended device's card. Ctrl-C ends the simulation early
    and leaves what is finished.
    """
    with common.plain_errors():
        if options.load is not None:
            raise common.BadInput(LOAD_WORDS)
        scenes.refuse_with_structure(options.structure, "modes", "damping")
        forces = forces_of(options)
        options, source = read_structure(options)
        places = find_places(source.structure, source.file)
        if options.position:
            places = places.subset(options.position)
        ratios = masses_of(options, places.model.beam_mass)
        limits = {name: positive(f"constraint {name}", x) for name, x in options.constraint}
        yield_limit = yield_limit_of(options, limits)
        limit_level = options.limit_level
        if limit_level is not None:
            limit_level = positive("limit_level", limit_level)
        forces = {places.model.check_resonance(r): force for r, force in forces.items()}
        require_writable("--out", options.out)
        common.check_targets({"json": options.json})
        common.check_target("--device", options.device, (".json",))
        common.check_target("--history", options.history, HISTORY_FORMATS)
        members = options.members or (QUICK_MEMBERS if options.quick else MEMBERS)
        with executor_on(options.threads, options.cluster) as executor:
            with sweeps_bar("simulating") as show:
                advice = advise_place(
                    places,
                    forces,
                    mass_ratios=ratios,
                    restitution=options.restitution,
                    friction_limit=options.friction_limit,
                    limits=Limits(limits.get("stroke"), limits.get("impact_speed")),
                    yield_limit=yield_limit,
                    limit_level=limit_level,
                    tolerance=options.force_tolerance,
                    members=members,
                    trial_places=QUICK_TRIAL_PLACES if options.quick else TRIAL_PLACES,
                    seed=options.seed,
                    percent_per_100_periods=options.rate,
                    announce=None
                    if options.cluster
                    else lambda plan: announce(plan, options.threads),
                    progress=show,
                    executor=executor,
                )
            best = advice.recommended
            if best is None:
                raise KeyboardInterrupt
            own = None
            curves: list[ResonanceCurves] = []
            if advice.complete:
                curves = curves_of(advice, executor)
            if advice.complete and not options.no_card:
                r = worst_resonance(advice)
                impacts = impact_loads(advice.case_of(best, r), executor)
                baselines = {
                    part.resonance: simulate_baselines(
                        places.model_at(best.place),
                        best.mass_ratio,
                        (part.force, part.resonance),
                        part.sweep_range,
                        part.rate,
                        executor,
                    )
                    for part in best.parts
                }
                own = report.card(advice, impacts, baselines, curves, options.contact)
        printed = [*report.answer(advice), "", report.text(advice), ""]
        printed += [f"Warning: {line}." for line in report.warnings(advice)]
        printed += [report.sweeps_line(advice), *([] if own is None else ["", as_text(own)])]
        click.echo("\n".join(printed))
        files = write(options, advice, curves)
        files += [] if own is None else write_card(options.out, own)
    common.name_files(files)
    common.end_early(advice.complete, "the files hold the runs that were finished.")
