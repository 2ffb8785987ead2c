"""Isolas of periodic responses: the forces at which they are born and merge, over frequency, restitution and number of modes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from _sweep_scene import make_scene, refuse_parts

from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, ParameterError, RigidWalls
from impact_env.periodic.case import case_of
from impact_env.periodic.isola_map import COLUMNS, IsolaCell, IsolaMap, isola_map
from optimisation.command_line import check_target, end_early, name_files, plain_errors
from optimisation.files import replacing, write_csv, write_json
from optimisation.progress import counting_bar
from optimisation.report.markdown import markdown


def numbers(option: str, text: str, kind: type) -> tuple[Any, ...]:
    """Return comma-separated numbers; raises ParameterError that names the option."""
    try:
        return tuple(kind(part) for part in text.split(",") if part.strip())
    except ValueError as error:
        raise ParameterError(f"{option} = {text!r} is not allowed: numbers with commas between") from error


def computed(given: dict[str, Any]) -> IsolaMap:
    """Do what the options ask for. Raises BadInput or ParameterError before anything long is done."""
    modes = numbers("--map-modes", given["map_modes"], int)
    restitutions = numbers("--map-restitutions", given["map_restitutions"], float)
    scene, _ = make_scene(given)
    case = case_of(scene, 1.0, float(scene.model.omega[0]))
    with counting_bar("isolas", "cells", leave=False) as show:
        return isola_map(case, given["start"], given["stop"], modes, restitutions, show)


def table(cells: tuple[IsolaCell, ...]) -> str:
    rows = [
        [str(n), f"{e:g}", str(kind), f"{force:.6f}", f"{ratio:.6f}", str(orbit)] for cell in cells for n, e, kind, force, ratio, orbit in cell.rows()
    ]
    return markdown(("modes", "restitution", "kind", "force, N", "omega/omega_1", "confirmed orbit"), rows)


def written(found: IsolaMap, given: dict[str, Any]) -> list[Path]:
    if given["json"] is not None:
        write_json(given["json"], found.to_plain())
    if given["csv"] is not None:
        write_csv(given["csv"], COLUMNS, (row for cell in (found.own, *found.cells) for row in cell.rows()))
    if given["figure"] is not None:
        from optimisation.report.isola_figure import save_figure  # matplotlib is slow to import

        with replacing(given["figure"]) as temporary:
            save_figure(temporary, found)
    return [given[name] for name in ("json", "csv", "figure") if given[name] is not None]


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 130})
@click.option("--scene", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Beam and absorber from a .toml or .json file.")
@click.option("--modes", type=int, help=f"Number of modes kept.  [default: {Beam.modes}]")
@click.option("--damping", type=float, help=f"Modal damping ratio, the same for all modes.  [default: {Beam.damping_ratio}]")
@click.option("--mass-ratio", type=float, help=f"Absorber mass over beam mass.  [default: {DEFAULT_MASS_RATIO}]")
@click.option("--gap", type=float, help=f"Clearance to either wall in m.  [default: {RigidWalls.gap}]")
@click.option("--restitution", type=float, help=f"Coefficient of restitution, 0 to 1.  [default: {RigidWalls.restitution}]")
@click.option("--friction-limit", type=float, help="Friction limit in N; 0: no friction.  [default: none]")
@click.option("--from", "start", type=float, default=0.9, show_default=True, help="Lowest frequency over the first resonance's.")
@click.option("--to", "stop", type=float, default=1.0, show_default=True, help="Highest frequency over the first resonance's.")
@click.option("--map-modes", default="", metavar="N,N,...", help="Numbers of modes of a map, at most --modes; needs --map-restitutions.")
@click.option("--map-restitutions", default="", metavar="E,E,...", help="Restitutions of a map.")
@click.option("--json", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write fold force, thresholds and map, in SI units.")
@click.option("--csv", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write a row for each birth and merger.")
@click.option("--figure", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw it: .png, .pdf or .svg.")
def main(**given: Any) -> None:
    """Find the forces at which closed branches of symmetric two-impact orbits are born and merge with their neighbours.

    They are the valleys and ridges of the smallest force that has an orbit, a closed form over the frequency; each is then found again with its
    friction reversals and confirmed by the exact method. Ctrl-C writes what is known so far.
    """
    with plain_errors():
        for option, suffixes in (("json", (".json",)), ("csv", (".csv",)), ("figure", (".png", ".pdf", ".svg"))):
            check_target(f"--{option}", given[option], suffixes)
        given |= dict.fromkeys(("absorber", "contact_stiffness", "friction_stiffness", "stiffness", "absorber_damping"))
        refuse_parts(given)
        found = computed(given)
        files = written(found, given)
    click.echo(table((found.own, *found.cells)))
    if files:
        name_files(files)
    end_early(found.complete)


if __name__ == "__main__":
    main(prog_name="scripts/run isola")
