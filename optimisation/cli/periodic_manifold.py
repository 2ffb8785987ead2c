"""The slow invariant manifold, and exact orbits."""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from impact_env.checks import count
from impact_env.periodic.case import Case, case_of
from impact_env.periodic.isolas import truncate_model
from impact_env.periodic.slow_manifold import (
    ManifoldCheck,
    check_manifold,
)
from impact_env.periodic.validation import validation_alongside
from optimisation.cli import common
from optimisation.cli.options import OptionSpec, option
from optimisation.cli.scene_options import (
    MapOptions,
    SceneOptions,
    make_scene,
    option_name,
    refuse_parts,
)
from optimisation.executors import counting_bar
from optimisation.report.manifold_report import make_manifold_report

MAPS = {
    "map_modes": int,
    "map_restitutions": float,
    "map_mass_ratios": float,
    "map_friction_limits": float,
}


@dataclass(frozen=True, kw_only=True)
class ManifoldOptions(SceneOptions, MapOptions):
    """Options of ``periodic manifold``; None or empty: not given."""

    force: float | None = option("force", help="Amplitude of a force for which a gap is wanted")
    resonance: int = option("resonance")
    orbit_forces: str = option(
        OptionSpec(
            names=("--orbit-forces",),
            help="Forces in N of the exact orbits",
            type=str,
            metavar="F,F,...",
            default="",
            default_text="0.5, 0.7, 1, 1.4, 2 times the onset of modulation",
            section="Excitation",
            older=("--forces",),
        )
    )
    start: float = option("start", help="First frequency of the orbits over the resonance")
    stop: float = option("stop", help="Last frequency of the orbits over the resonance")
    points: int = option(
        "points", help="Number of frequencies; 0: no orbits, only the formulas", default=13
    )
    map_mass_ratios: str = option(
        OptionSpec(
            names=("--map-mass-ratios",),
            help="Mass ratios of a map",
            type=str,
            metavar="M,M,...",
            default="",
            default_text="--mass-ratio",
        )
    )
    json: Path | None = option("json", help="Write variants, orbits and map")
    csv: Path | None = option("csv", help="Write a row for each case of the map")
    plot: Path | None = option("plot")


def cases_of_map(case: Case, options: ManifoldOptions) -> list[Case]:
    """Return the cases of the map that the options ask for, none if there is no such option."""
    values = {
        name: common.numbers(option_name(name), getattr(options, name), kind)
        if getattr(options, name)
        else ()
        for name, kind in MAPS.items()
    }
    if not any(values.values()):
        return []
    return [
        replace(
            case,
            model=truncate_model(case.model, modes),
            restitution=restitution,
            mass_ratio=mass_ratio,
            friction_limit=limit,
        )
        for modes, restitution, mass_ratio, limit in product(
            values["map_modes"] or (case.model.modes,),
            values["map_restitutions"] or (case.restitution,),
            values["map_mass_ratios"] or (case.mass_ratio,),
            values["map_friction_limits"] or (case.friction_limit,),
        )
    ]


@common.command(
    ManifoldOptions,
    examples=(
        "periodic manifold --modes 1 --points 1",
        "periodic manifold --modes 10 --restitution 0.7 --force 3.5",
    ),
)
def main(options: ManifoldOptions) -> None:
    """Compute the slow invariant manifold of an impact absorber, and compare it with exact orbits.

    Two impacts a period keep the amplitude of the resonant mode on a curve over the absorber's
    amplitude, whatever the force is. Four variants of the formula are printed, from the
    literature's to the one with all modes, with what each says of fold force, modulation and gap.
    """
    with common.plain_errors():
        common.check_targets(vars(options))
        if options.csv is not None and not any(getattr(options, name) for name in MAPS):
            raise common.BadInput("--csv is for a map: add --map-modes or one of its siblings")
        refuse_parts(options)
        points = count("--points", options.points, 0)
        scene = make_scene(options).scene
        resonance = count("--resonance", options.resonance, 1, scene.model.modes)
        case = case_of(scene, 1.0, float(scene.model.resonance_omega(resonance)))
        cases = cases_of_map(case, options)
        ratios = np.linspace(options.start, options.stop, points)
        forces = None
        if options.orbit_forces:
            forces = common.numbers("--orbit-forces", options.orbit_forces, float)
        complete = [True]
        own = ManifoldCheck(case, resonance, ())
        cells: list[ManifoldCheck] = []
        with (
            common.stop_on_interrupt(complete),
            validation_alongside(case),
            counting_bar("orbits", "points", leave=False) as show,
        ):
            if points > 0:
                own = check_manifold(case, resonance, ratios, forces, show)
            for here in cases:
                cell = check_manifold(here, resonance, ratios, forces, show)
                cells.append(cell)  # an interrupt leaves those that are finished
        report = make_manifold_report(own, options.force, cells, complete[0])
        common.write_report(report, options)
    common.end_early(complete[0])
