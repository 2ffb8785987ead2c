"""The slow invariant manifold, and exact orbits."""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.parameters import count
from impact_env.periodic.case import Case, case_of
from impact_env.periodic.isolas import truncate_model
from impact_env.periodic.slow_manifold import (
    VARIANTS,
    ManifoldCheck,
    check_manifold,
    manifold_gap,
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
from optimisation.files import write_files
from optimisation.page import markdown
from optimisation.progress import counting_bar
from optimisation.report.periodic_figures import save_manifold
from optimisation.report.report import Table

MAPS = {
    "map_modes": int,
    "map_restitutions": float,
    "map_mass_ratios": float,
    "map_friction_limits": float,
}
COLUMNS = ("modes", "restitution", "mass_ratio", "friction_limit_N", "orbits", *VARIANTS)


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


def variant_table(result: ManifoldCheck, force: float | None) -> str:
    """Return a line for each variant: what it says of the absorber, and its error beside the orbits."""
    header = [
        "variant",
        "restitution of the mode",
        "least amplitude, mm",
        "fold force, N",
        "modulation below, N",
    ]
    if force is not None:
        header.append(f"gap for {force:g} N, mm")
    rows = []
    for name in VARIANTS:
        manifold = result.manifold(name)
        row = [
            name,
            f"{manifold.restitution:.3f}",
            f"{1e3 * manifold.least_amplitude:.4g}",
            f"{manifold.fold_force:.4g}",
            f"{manifold.modulation_force:.4g}",
        ]
        if force is not None:
            gap = manifold_gap(result.case.changed(force=force), result.resonance, name)
            row.append(f"{1e3 * gap:.4g}")
        rows.append(row)
    if result.points:
        header += ["median error, %", "95 % of orbits within, %"]
        for name, row in zip(VARIANTS, rows, strict=True):
            size = 100 * np.abs(result.errors(name))
            row += [f"{np.median(size):.2f}", f"{np.quantile(size, 0.95):.2f}"]
    return markdown(tuple(header), rows)


def map_row(result: ManifoldCheck) -> list[Any]:
    """Return the values of `COLUMNS`: the parameters, the number of orbits, and the median relative error of each variant."""
    case = result.case
    errors = [result.median_error(name) for name in VARIANTS]
    return [
        case.model.modes,
        case.restitution,
        case.mass_ratio,
        case.friction_limit,
        len(result.points),
        *errors,
    ]


def map_table(rows: list[list[Any]]) -> str:
    """Return the table of median errors in %."""
    header = ("modes", "restitution", "mass, %", "friction, N", "orbits", *VARIANTS)
    cells = [
        [
            str(modes),
            f"{restitution:g}",
            f"{100 * mass:g}",
            f"{limit:g}",
            str(orbits),
            *("-" if np.isnan(error) else f"{100 * error:.2f}" for error in errors),
        ]
        for modes, restitution, mass, limit, orbits, *errors in rows
    ]
    return markdown(header, cells)


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

    Two impacts a period keep the amplitude of the resonant mode on a curve over the absorber's amplitude, whatever the force is. Four variants of
    the formula are printed, from the literature's to the one with all modes, with what each says of fold force, modulation and gap.
    """
    with common.plain_errors():
        common.check_targets(vars(options))
        if options.csv is not None and not any(getattr(options, name) for name in MAPS):
            raise common.BadInput("--csv is for a map: add --map-modes or one of its siblings")
        refuse_parts(options)
        points = count("--points", options.points, 0)
        wanted = options.force
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
        rows: list[list[Any]] = []
        with (
            common.stop_on_interrupt(complete),
            validation_alongside(case),
            counting_bar("orbits", "points", leave=False) as show,
        ):
            if points > 0:
                own = check_manifold(case, resonance, ratios, forces, show)
            for here in cases:
                check = check_manifold(here, resonance, ratios, forces, show)
                rows.append(map_row(check))
        click.echo(variant_table(own, wanted))
        if own.points:
            stable = sum(point.stable for point in own.points)
            click.echo(f"\n{len(own.points)} exact orbits, {stable} of them stable")
        if rows:
            click.echo(f"\nMedian error in %:\n\n{map_table(rows)}")
        table = Table.of_values(COLUMNS, rows)
        plain = own.to_plain() | {"map": table.records(), "complete": complete[0]}
        files = write_files(
            {
                options.json: plain,
                options.csv: table.to_csv(),
                options.plot: lambda path: save_manifold(path, own),
            }
        )
    common.name_files(files)
    common.end_early(complete[0])
