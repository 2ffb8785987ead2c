"""What scripts/run isola computes, prints and writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from impact_env.parameters import ParameterError
from impact_env.periodic.case import Case, case_of
from impact_env.periodic.isola_map import COLUMNS, IsolaMap, isola_map
from impact_env.periodic.validation import trials_alongside
from impact_env.plain import from_scene
from optimisation.commands.sweep_scene import make_scene, option_name
from optimisation.files import replacing, write_csv, write_json
from optimisation.pieces import Pieces
from optimisation.progress import counting_bar


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
    with trials_alongside(case), counting_bar("isolas", "cells", leave=False) as show:
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
    if given["figure"] is not None:
        from optimisation.report.isola_figure import save_figure  # matplotlib is slow to import

        with replacing(given["figure"]) as temporary:
            save_figure(temporary, found)
    return [given[name] for name in ("json", "csv", "figure") if given[name] is not None]
