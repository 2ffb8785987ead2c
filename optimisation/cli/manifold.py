"""The slow invariant manifold by one formula, beside exact orbits."""

from dataclasses import replace
from itertools import product
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
from optimisation.cli.scene_options import make_scene, option_name, refuse_parts, scene_options
from optimisation.files import write_files
from optimisation.page import markdown
from optimisation.progress import counting_bar
from optimisation.report.periodic_figures import save_manifold

MAPS = {
    "map_modes": int,
    "map_restitutions": float,
    "map_mass_ratios": float,
    "map_friction_limits": float,
}
COLUMNS = ("modes", "restitution", "mass_ratio", "friction_limit_N", "orbits", *VARIANTS)


def variant_table(found: ManifoldCheck, force: float | None) -> str:
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
        manifold = found.manifold(name)
        row = [
            name,
            f"{manifold.restitution:.3f}",
            f"{1e3 * manifold.least_amplitude:.4g}",
            f"{manifold.fold_force:.4g}",
            f"{manifold.modulation_force:.4g}",
        ]
        if force is not None:
            gap = manifold_gap(found.case.changed(force=force), found.resonance, name)
            row.append(f"{1e3 * gap:.4g}")
        rows.append(row)
    if found.points:
        header += ["median error, %", "95 % of orbits within, %"]
        for name, row in zip(VARIANTS, rows, strict=True):
            size = 100 * np.abs(found.errors(name))
            row += [f"{np.median(size):.2f}", f"{np.quantile(size, 0.95):.2f}"]
    return markdown(tuple(header), rows)


def map_row(found: ManifoldCheck) -> list[Any]:
    """Return the values of `COLUMNS`: the parameters, the number of orbits, and the median relative error of each variant."""
    case = found.case
    errors = [found.median_error(name) for name in VARIANTS]
    return [
        case.model.modes,
        case.restitution,
        case.mass_ratio,
        case.friction_limit,
        len(found.points),
        *errors,
    ]


def plain_rows(rows: list[list[Any]]) -> list[dict[str, Any]]:
    """Return the map as JSON has it; an error without orbits is None."""
    found = [dict(zip(COLUMNS, row, strict=True)) for row in rows]
    return [
        {name: None if value != value else value for name, value in row.items()} for row in found
    ]


def map_table(rows: list[list[Any]]) -> str:
    """Return the table of median errors in %."""
    header = ("modes", "restitution", "mass, %", "friction, N", "orbits", *VARIANTS)
    shown = [
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
    return markdown(header, shown)


def cases_of_map(case: Case, given: dict[str, Any]) -> list[Case]:
    """Return the cases of the map that the options ask for, none if there is no such option."""
    values = {
        name: common.numbers(option_name(name), given[name], kind) if given[name] else ()
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


@common.command()
@scene_options(", 0 to 1", friction="none")
@click.option(
    "--resonance", type=int, default=1, show_default=True, help="Number of the resonance."
)
@click.option("--force", type=float, help="Amplitude in N of a force for which a gap is wanted.")
@click.option(
    "--forces",
    default="",
    metavar="N,N,...",
    help="Forces in N of the exact orbits.  [default: 0.5, 0.7, 1, 1.4, 2 times the onset of modulation]",
)
@click.option(
    "--from",
    "start",
    type=float,
    default=0.92,
    show_default=True,
    help="Lowest frequency of the orbits over the resonance's.",
)
@click.option(
    "--to",
    "stop",
    type=float,
    default=1.04,
    show_default=True,
    help="Highest frequency of the orbits over the resonance's.",
)
@click.option(
    "--points",
    type=int,
    default=13,
    show_default=True,
    help="Number of frequencies; 0: no orbits, only the formulas.",
)
@click.option("--map-modes", default="", metavar="N,N,...", help="Numbers of modes of a map.")
@click.option("--map-restitutions", default="", metavar="E,E,...", help="Restitutions of a map.")
@click.option("--map-mass-ratios", default="", metavar="M,M,...", help="Mass ratios of a map.")
@click.option(
    "--map-friction-limits", default="", metavar="N,N,...", help="Friction limits of a map in N."
)
@common.json_option("Write variants, orbits and map, in SI units.")
@common.file_option("--csv", "Write a row for each case of the map.")
@common.plot_option
def main(**given: Any) -> None:
    """Compute the slow invariant manifold of an impact absorber, and compare it with exact orbits.

    Two impacts a period keep the amplitude of the resonant mode on a curve over the absorber's amplitude, whatever the force is. Four variants of
    the formula are printed, from the literature's to the one with all modes, with what each says of fold force, modulation and gap.

    Example: periodic manifold --modes 10 --restitution 0.7 --force 3.5 --plot manifold.png
    """
    with common.plain_errors():
        common.check_targets(given)
        refuse_map_of_one(given)
        given |= dict.fromkeys(
            (
                "absorber",
                "contact_stiffness",
                "friction_stiffness",
                "stiffness",
                "absorber_damping",
            )
        )
        refuse_parts(given)
        points = count("--points", given["points"], 0)
        wanted = given["force"]
        scene, _ = make_scene(dict(given))
        resonance = count("--resonance", given["resonance"], 1, scene.model.modes)
        case = case_of(scene, 1.0, float(scene.model.resonance_omega(resonance)))
        cases = cases_of_map(case, given)
        ratios = np.linspace(given["start"], given["stop"], points)
        forces = common.numbers("--forces", given["forces"], float) if given["forces"] else None
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
            click.echo(f"\n{len(own.points)} exact orbits, {stable_of(own)} of them stable")
        if rows:
            click.echo(f"\nMedian error in %:\n\n{map_table(rows)}")
        plain = own.to_plain() | {"map": plain_rows(rows), "complete": complete[0]}
        files = write_files(
            {
                given["json"]: plain,
                given["csv"]: (COLUMNS, rows),
                given["plot"]: lambda path: save_manifold(path, own),
            }
        )
    common.name_files(files)
    common.end_early(complete[0])


def stable_of(found: ManifoldCheck) -> int:
    """Return how many of the orbits are stable."""
    return sum(point.stable for point in found.points)


def refuse_map_of_one(given: dict[str, Any]) -> None:
    """Raise BadInput for --csv without a map, whose rows it would hold."""
    if given["csv"] is not None and not any(given[name] for name in MAPS):
        raise common.BadInput("--csv is for a map: add --map-modes or one of its siblings")
