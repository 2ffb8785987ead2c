"""Isolas of periodic responses: the forces at which they are born and merge, over frequency, restitution, friction and number of modes."""

from pathlib import Path
from typing import Any

import click

from impact_env.parameters import ParameterError
from impact_env.periodic.case import Case, case_of
from impact_env.periodic.isolas import COLUMNS, IsolaCell, IsolaMap, isola_map
from impact_env.periodic.validation import validation_alongside
from impact_env.plain import from_scene
from optimisation.cli.common import FIGURES, RESUME, check_target, command, end_early, json_option, name_files, plain_errors
from optimisation.cli.structure_option import scene_options
from optimisation.cli.sweep_scene import make_scene, option_name, refuse_parts
from optimisation.files import replacing, write_csv, write_json
from optimisation.pieces import Pieces
from optimisation.progress import counting_bar
from optimisation.report.markdown import markdown


def table(cells: tuple[IsolaCell, ...]) -> str:
    """Return a line for each birth and merger."""
    rows = [
        [str(n), f"{e:g}", f"{limit:g}", str(kind), f"{force:.6f}", f"{ratio:.6f}", str(orbit)]
        for cell in cells
        for n, e, limit, kind, force, ratio, orbit in cell.rows()
    ]
    return markdown(("modes", "restitution", "friction limit, N", "kind", "force, N", "omega/omega_1", "confirmed orbit"), rows)


def numbers(option: str, text: str, kind: type) -> tuple[Any, ...]:
    """Return comma-separated numbers; raises ParameterError that names the option."""
    try:
        return tuple(kind(part) for part in text.split(",") if part.strip())
    except ValueError as error:
        raise ParameterError(f"{option} = {text!r} is not allowed: numbers with commas between") from error


def computed(given: dict[str, Any]) -> IsolaMap:
    """Do what the options ask for. Raises BadInput or ParameterError before anything long is done."""
    modes = numbers("--map-modes", given["map_modes"], int)
    restitutions, limits = (numbers(option_name(name), given[name], float) for name in ("map_restitutions", "map_friction_limits"))
    scene, _ = make_scene(given)
    case = case_of(scene, 1.0, float(scene.model.omega[0]))
    modes, restitutions = whole_map(case, modes, restitutions, limits)
    with validation_alongside(case), counting_bar("isolas", "cells", leave=False) as show:
        return isola_map(
            case, given["start"], given["stop"], modes, restitutions, show, limits, Pieces(given["resume"], {"scene": from_scene(scene)})
        )


def whole_map(
    case: Case, modes: tuple[int, ...], restitutions: tuple[float, ...], limits: tuple[float, ...]
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return modes and restitutions of a map, the case's own where only the other ones, or friction limits, are given."""
    if not (modes or restitutions or limits):
        return (), ()
    return modes or (case.model.modes,), restitutions or (case.restitution,)


def written(found: IsolaMap, given: dict[str, Any]) -> list[Path]:
    """Write the files that the options ask for, and return them."""
    if given["json"] is not None:
        write_json(given["json"], found.to_plain())
    if given["csv"] is not None:
        write_csv(given["csv"], COLUMNS, (row for cell in (found.own, *found.cells) for row in cell.rows()))
    if given["plot"] is not None:
        from optimisation.report.periodic_figures import save_isolas  # matplotlib is slow to import

        with replacing(given["plot"]) as temporary:
            save_isolas(temporary, found)
    return [given[name] for name in ("json", "csv", "plot") if given[name] is not None]


@command()
@scene_options(", 0 to 1", friction="none")
@click.option("--from", "start", type=float, default=0.9, show_default=True, help="Lowest frequency over the first resonance's.")
@click.option("--to", "stop", type=float, default=1.0, show_default=True, help="Highest frequency over the first resonance's.")
@click.option("--map-modes", default="", metavar="N,N,...", help="Numbers of modes of a map, at most --modes.  [default: that]")
@click.option("--map-restitutions", default="", metavar="E,E,...", help="Restitutions of a map.  [default: --restitution]")
@click.option("--map-friction-limits", default="", metavar="N,N,...", help="Friction limits of a map in N.  [default: --friction-limit]")
@click.option("--resume", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help=RESUME)
@json_option("Write fold force, thresholds and map, in SI units.")
@click.option("--csv", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write a row for each birth and merger.")
@click.option("--plot", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw it: .png, .pdf or .svg.")
def main(**given: Any) -> None:
    """Find the forces at which closed branches of symmetric two-impact orbits are born and merge with their neighbours.

    They are the valleys and ridges of the smallest force that has an orbit, a closed form over the frequency; each is then found again with its
    friction reversals and confirmed by the exact method. Ctrl-C writes what is known so far; --resume keeps each finished cell of the map.
    """
    with plain_errors():
        for option, suffixes in (("json", (".json",)), ("csv", (".csv",)), ("plot", FIGURES)):
            check_target(f"--{option}", given[option], suffixes)
        check_target("--resume", given["resume"], (".json",))
        given |= dict.fromkeys(("absorber", "contact_stiffness", "friction_stiffness", "stiffness", "absorber_damping", "force"))
        given["resonance"] = 1  # the one that is looked at
        refuse_parts(given)
        found = computed(given)
        files = written(found, given)
    click.echo(table((found.own, *found.cells)))
    if files:
        name_files(files)
    end_early(found.complete)
