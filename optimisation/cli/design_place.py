"""Choose place, mass and gap of an impact absorber by simulation, with a map of where on the structure one works."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from impact_env.ensemble import Executor
from impact_env.modes import Structure
from impact_env.parameters import Beam, positive
from optimisation.baselines import simulate_baselines
from optimisation.cli import common
from optimisation.cli import scene_options as scenes
from optimisation.cli.design_gap import FRICTION_HELP, MEMBERS_HELP
from optimisation.cli.design_options import At
from optimisation.duration import LONG_S, duration_in_words, seconds_per_period
from optimisation.executors import cluster_option
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
from optimisation.gap_card import impacts_of
from optimisation.gap_check import RESTITUTION, rigid_walls
from optimisation.place_advice import (
    MASS_RATIOS,
    SURE,
    TRIAL_PLACES,
    PlaceAdvice,
    SweepPlan,
    advise_place,
)
from optimisation.place_map import BEAM_PLACES, Places, find_places
from optimisation.progress import sweeps_bar
from optimisation.report import place_report as report
from optimisation.report.card import text as as_text
from optimisation.report.card import write_card
from optimisation.report.frequency_report import (
    HISTORY_FORMATS,
    HISTORY_HELP,
    frequency_files,
    save_history,
)

QUICK_TRIAL_PLACES = 3  # places of each mass
QUICK_MEMBERS = 1
DEFAULT_RESONANCES = (1, 1)
PLACE_CONSTRAINTS = ("stroke", "impact_speed")
CONSTRAINT_HELP = (
    "Answer within a limit, in SI units; may be repeated: stroke (m, from the middle of the cavity), impact_speed (m/s, the "
    "largest)."
)
AT_HELP = "Resonance and force in N; may be repeated. In place of --force and --resonances."
FORCE_HELP = "Amplitude of the harmonic force in N, the same near each of --resonances."
MASS_HELP = f"Absorber mass over the structure's to try; may be repeated.  [default: {', '.join(f'{x:g}' for x in MASS_RATIOS)}]"
POSITION_HELP = (
    "Try this place only; may be repeated: a share of the beam's length, or the number of a node, row or place of the file.  [default: "
    f"{BEAM_PLACES} places over the length; the places that the file lists, or all its nodes in the direction of the one that it lists]"
)
LIMIT_HELP = f"Recommend the lightest mass whose level stays below this, in m, with {100 * SURE:.0f} % probability."
EXAMPLES = """Examples:

\b
  design_place --force 3.5                                     # the paper's beam
  design_place --at 1:3.5 --at 2:35 --mass-ratio 0.02          # one device for two resonances
  design_place --structure docs/examples/frame.toml --force 20 --limit-level 0.0005
"""


def forces_of(given: dict[str, Any]) -> dict[int, float]:
    """Return the force in N by resonance; raises BadInput unless the options say it once."""
    if given["at"]:
        for name in ("force", "resonances"):
            if scenes.is_given(name):
                raise common.BadInput(
                    f"--{name} does not go with --at, which names resonances with their forces"
                )
        found: dict[int, float] = {}
        for resonance, force in given["at"]:
            if resonance in found:
                raise common.BadInput(
                    f"--at {resonance}:{force:g} is not allowed: each resonance once, and {resonance}:{found[resonance]:g} is given"
                )
            found[resonance] = usable_force("--at", force)
        return found
    if given["force"] is None:
        raise common.BadInput(
            "--force is missing: the amplitude of the harmonic force in N, or --at RESONANCE:FORCE"
        )
    force = usable_force("--force", given["force"])
    return dict.fromkeys(given["resonances"], force)


def structure_in(given: dict[str, Any]) -> tuple[Structure, Path | None]:
    """Return the structure, and its file if it has one; with --scene the absorber of the file gives mass, restitution and friction."""
    if given["scene"] is None:
        file = given["structure"]
        if file is not None:
            return scenes.read_structure(file), file
        return Beam(modes=given["modes"], damping_ratio=given["damping"]), None
    structure, absorber = scenes.read_device(
        given["scene"],
        "structure",
        "modes",
        "damping",
        "mass_ratio",
        "mass_kg",
        "restitution",
        "friction_limit",
    )
    given["mass_ratio"] = (absorber.mass_ratio,)
    given["restitution"] = rigid_walls(absorber).restitution
    given["friction_limit"] = 0.0 if absorber.friction is None else absorber.friction.limit
    return structure, None


def places_in(given: dict[str, Any]) -> Places:
    """Return the places that the options allow."""
    structure, file = structure_in(given)
    places = find_places(structure, file)
    return places.subset(given["position"]) if given["position"] else places


def masses_of(given: dict[str, Any], structure_mass: float) -> tuple[float, ...]:
    """Return the mass ratios to try."""
    if not given["mass_kg"]:
        return given["mass_ratio"] or MASS_RATIOS
    if given["mass_ratio"]:
        raise common.BadInput(
            "--mass-kg does not go with --mass-ratio: each says what the masses are"
        )
    return tuple(
        scenes.mass_ratio_of(MASS_RATIOS[0], mass, structure_mass) for mass in given["mass_kg"]
    )


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


def curves_of(found: PlaceAdvice, executor: Executor) -> list[ResonanceCurves]:
    """Return the levels over the frequency of the recommended device's worst member and without absorber, near each resonance."""
    best = found.recommended
    assert best is not None
    curves = []
    for r in found.forces:
        member, _ = find_worst_run(best.runs[r])
        model = found.places.model_at(best.place)
        cases = {
            RECOMMENDED: (found.case_of(best, r), member),
            NO_ABSORBER: (found.study.case(model, None, r), 0),
        }
        curves.append(resonance_curves(cases, best.runs[r].members, executor))
    return curves


def worst_resonance(found: PlaceAdvice) -> int:
    """Return the resonance at which the recommended device leaves most of the level without absorber."""
    best = found.recommended
    assert best is not None
    return max(best.parts, key=lambda part: part.share).resonance


def write(
    given: dict[str, Any], found: PlaceAdvice, curves: Sequence[ResonanceCurves]
) -> list[Path]:
    """Write figures, map and summary, and what the options ask for; return the files."""
    out = given["out"]
    content = report.summary(found)
    contents: dict[Path | None, object] = {
        given["json"]: content,
        out / "summary.json": content,
        out / "places.csv": (report.columns(found), report.rows(found)),
        out / "places.png": partial(report.save_places, found=found),
    }
    contents |= frequency_files(out, curves)
    best = found.recommended
    if given["history"] is not None and best is not None:
        r = worst_resonance(found)
        run = record_worst_run(found.case_of(best, r), best.runs[r])
        contents[given["history"]] = partial(save_history, run=run)
    files = write_files(contents)
    if given["device"] is not None and best is not None:
        scenes.write_device(given["device"], found.structure_with(best), best.absorber)
        files.append(given["device"])
    return files


@common.command(epilog=EXAMPLES)
@scenes.structure_option
@scenes.scene_option
@click.option("--force", type=float, help=FORCE_HELP)
@click.option(
    "--resonances",
    type=(int, int),
    default=DEFAULT_RESONANCES,
    show_default=True,
    help="Resonances near which it acts, counted from 1; twice the same: one.",
)
@click.option("--at", multiple=True, type=At(), help=AT_HELP)
@click.option(
    "--force-tolerance",
    type=float,
    default=TOLERANCE,
    show_default=True,
    help="Share by which the forces may be larger or smaller, all together.",
)
@click.option("--mass-ratio", type=float, multiple=True, help=MASS_HELP)
@click.option(
    "--mass-kg", type=float, multiple=True, help="Masses to try in kg, in place of the ratios."
)
@click.option("--position", type=float, multiple=True, help=POSITION_HELP)
@click.option(
    "--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept."
)
@click.option(
    "--damping",
    type=float,
    default=Beam.damping_ratio,
    show_default=True,
    help="Damping ratio of all modes.",
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
    "--constraint",
    multiple=True,
    type=(click.Choice(PLACE_CONSTRAINTS), float),
    metavar="NAME LIMIT",
    help=CONSTRAINT_HELP,
)
@click.option("--limit-level", type=float, help=LIMIT_HELP)
@common.rate_option
@click.option(
    "--quick",
    is_flag=True,
    help=f"A look: {QUICK_MEMBERS} member, unless given, and {QUICK_TRIAL_PLACES} places of each mass.",
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
@common.json_option("Write the summary here, too.")
@common.out_option("results/design_place", "Folder for figures and tables.")
def main(**given: Any) -> None:
    """Choose where an impact absorber sits, how heavy it is and which gap it has, for forces near one or several resonances.

    All places are ranked by the linear structure; the best few of each mass run, and the gap of the best is searched as by design_gap, for all
    resonances together. The level is read where the file says, on a beam at its free end. Writes places.png (the structure coloured by reach, and
    levels over the place), places.csv (the map), frequency.png, summary.json and the recommended device's card. Ctrl-C ends the simulation early
    and leaves what is finished.
    """
    with common.plain_errors():
        scenes.refuse_beside(given["structure"], "modes", "damping")
        forces = forces_of(given)
        places = places_in(given)
        ratios = masses_of(given, places.model.beam_mass)
        limits = {name: positive(f"constraint {name}", x) for name, x in given["constraint"]}
        if given["limit_level"] is not None:
            given["limit_level"] = positive("limit_level", given["limit_level"])
        forces = {places.model.check_resonance(r): force for r, force in forces.items()}
        require_writable("--out", given["out"])
        common.check_targets(given)
        common.check_target("--device", given["device"], (".json",))
        common.check_target("--history", given["history"], HISTORY_FORMATS)
        members = given["members"] or (QUICK_MEMBERS if given["quick"] else MEMBERS)
        with executor_on(given["threads"], given["cluster"]) as executor:
            with sweeps_bar("simulating") as show:
                found = advise_place(
                    places,
                    forces,
                    mass_ratios=ratios,
                    restitution=given["restitution"],
                    friction_limit=given["friction_limit"],
                    limits=Limits(limits.get("stroke"), limits.get("impact_speed")),
                    limit_level=given["limit_level"],
                    tolerance=given["force_tolerance"],
                    members=members,
                    trial_places=QUICK_TRIAL_PLACES if given["quick"] else TRIAL_PLACES,
                    seed=given["seed"],
                    percent_per_100_periods=given["rate"],
                    announce=None
                    if given["cluster"]
                    else lambda plan: announce(plan, given["threads"]),
                    progress=show,
                    executor=executor,
                )
            best = found.recommended
            if best is None:
                raise KeyboardInterrupt
            own = None
            curves: list[ResonanceCurves] = []
            if found.complete:
                curves = curves_of(found, executor)
            if found.complete and not given["no_card"]:
                r = worst_resonance(found)
                impacts = impacts_of(found.case_of(best, r), executor)
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
                own = report.card(found, impacts, baselines, curves)
        told = [*report.answer(found), "", report.text(found), ""]
        told += [f"Warning: {line}." for line in report.warnings(found)]
        told += [report.sweeps_line(found), *([] if own is None else ["", as_text(own)])]
        click.echo("\n".join(told))
        files = write(given, found, curves)
        files += [] if own is None else write_card(given["out"], own)
    common.name_files(files)
    common.end_early(found.complete, "the files hold the runs that were finished.")
