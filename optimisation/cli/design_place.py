"""Place, mass and gap of an impact absorber."""

from dataclasses import dataclass, replace
from pathlib import Path

import click

from impact_env.checks import positive
from optimisation.answers.place import complete_place_answer
from optimisation.cli import common
from optimisation.cli import scene_options as scenes
from optimisation.cli.options import option
from optimisation.executors import LONG_S, duration_in_words, seconds_per_period, sweeps_bar
from optimisation.executors import executor as executor_on
from optimisation.gap_advice import MEMBERS, TOLERANCE
from optimisation.place_advice import (
    MASS_RATIOS,
    SURE,
    TRIAL_PLACES,
    SweepPlan,
    advise_place,
)
from optimisation.place_map import BEAM_PLACES, find_places
from optimisation.sweep_range import usable_force

QUICK_TRIAL_PLACES = 3  # places of each mass
QUICK_MEMBERS = 1
DEFAULT_RESONANCES = (1, 1)
LOAD_WORDS = (
    "--load is not possible here: places are ranked by the response to a harmonic force near "
    "resonances; "
    "`design gap --load FILE --position PLACE` searches the gap at one place"
)
POSITION_TEXT = (
    f"{BEAM_PLACES} places over the length; the places that the file lists, or all its nodes in "
    "the direction of the one that it lists"
)


@dataclass(frozen=True, kw_only=True)
class PlaceOptions(
    scenes.RecommendationOptions, scenes.SweepRunOptions, scenes.ImpactOptions, scenes.BeamOptions
):
    """Options of ``design place``; None or empty: not given."""

    position: tuple[float, ...] = option(
        "position",
        help="Try this place only; may be repeated",
        more="A share of the beam's length, or the number of a node, row or place of the file.",
        default=None,
        default_text=POSITION_TEXT,
        multiple=True,
    )
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
    limit_level: float | None = option(
        "limit_level",
        more=f"The lightest mass that does so with {100 * SURE:.0f} % probability is recommended.",
        usual=True,
    )
    quick: bool = option(
        "quick",
        help=(
            f"A first answer from {QUICK_MEMBERS} member, unless given, and {QUICK_TRIAL_PLACES} "
            "places of each mass"
        ),
    )
    members: int | None = option("members", default_text=str(MEMBERS))
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
                    f"--at {resonance}:{force:g} is not allowed: each resonance once, and "
                    f"{resonance}:{forces[resonance]:g} is given"
                )
            forces[resonance] = usable_force("--at", force)
        return forces
    if options.force is None:
        raise common.BadInput(
            "--force is missing: the amplitude of the harmonic force in N, or --at RESONANCE:FORCE"
        )
    force = usable_force("--force", options.force)
    return dict.fromkeys(options.resonances, force)


def read_structure(options: PlaceOptions) -> tuple[PlaceOptions, scenes.DeviceSource]:
    """Return the options and the structure.

    With --scene mass, restitution and friction are those of the file's absorber.
    """
    source = scenes.read_source(options, "position")
    if source.device is not None:
        restitution, friction_limit = scenes.values_of(source.device)
        options = replace(
            options,
            mass_ratio=(source.device.mass_ratio,),
            restitution=restitution,
            friction_limit=friction_limit,
        )
    return options, source


def announce(plan: SweepPlan, threads: int | None) -> None:
    """Print how long the runs take at most, where that is long."""
    from impact_env.ensemble import available_cores

    seconds = sum(
        plan.sweeps[r] * periods * seconds_per_period(scene, force, r)
        for r, (scene, force, periods) in plan.scenes.items()
    ) / min(threads or available_cores(), 2)
    if seconds > LONG_S:
        click.echo(
            f"About {duration_in_words(seconds)}, within a factor of three: at most "
            f"{plan.total} sweeps. --quick, fewer masses (--mass-ratio) or a "
            "higher --rate take less.",
            err=True,
        )


@common.command(
    PlaceOptions,
    examples=(
        "design place --force 3.5 --quick",
        "design place --at 1:3.5 --at 2:35 --mass-ratio 0.02",
    ),
)
def main(options: PlaceOptions) -> None:
    """Choose the place, the mass and the gap of an impact absorber.

    It is chosen for forces near one or several resonances.

    All places are ranked by the linear structure; the best few of each mass run, and the gap of the
    best is searched as by design_gap, for all resonances together. The level is read where the file
    says, on a beam at its free end. Writes places.png (the structure coloured by reach, and levels
    over the place), places.csv (the map), frequency.png, summary.json and the recommended device's
    card. Ctrl-C ends the simulation early and leaves what is finished.
    """
    with common.plain_errors():
        if options.load is not None:
            raise common.BadInput(LOAD_WORDS)
        forces = forces_of(options)
        options, source = read_structure(options)
        places = find_places(source.structure, source.file)
        if options.position:
            places = places.subset(options.position)
        masses = (options.mass_ratio, options.mass_kg)
        ratios = scenes.mass_ratios_of(*masses, places.model.beam_mass) or MASS_RATIOS
        limits, yield_limit = scenes.read_limits(options)
        limit_level = options.limit_level
        if limit_level is not None:
            limit_level = positive("limit_level", limit_level)
        forces = {places.model.check_resonance(r): force for r, force in forces.items()}
        targets = common.AnswerFiles(options.out, options.json, options.device, options.history)
        targets.check()
        members = options.members or (QUICK_MEMBERS if options.quick else MEMBERS)
        with executor_on(options.threads, options.cluster) as executor:
            with sweeps_bar("simulating") as show:
                advice = advise_place(
                    places,
                    forces,
                    mass_ratios=ratios,
                    restitution=options.restitution,
                    friction_limit=options.friction_limit,
                    limits=limits,
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
            if advice.recommended is None:
                raise KeyboardInterrupt
            answer = complete_place_answer(advice, executor, not options.no_card, options.contact)
        files = targets.write(answer)
    common.name_files(files)
    common.end_early(advice.complete, "the files hold the runs that were finished.")
