"""The forces at which isolas are born and merge."""

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from impact_env.periodic.case import case_of
from impact_env.periodic.isolas import IsolaMap, isola_map
from impact_env.periodic.validation import validation_alongside
from impact_env.plain import from_scene
from optimisation.checkpoint import Checkpoint
from optimisation.cli import common
from optimisation.cli.options import option
from optimisation.cli.scene_options import (
    MapOptions,
    SceneOptions,
    make_scene,
    option_name,
    refuse_parts,
)
from optimisation.executors import counting_bar
from optimisation.report.isola_report import make_isola_report


@dataclass(frozen=True, kw_only=True)
class IsolaOptions(SceneOptions, MapOptions):
    """Options of ``periodic isola``; None or empty: not given."""

    start: float = option("start", help="First frequency over the first resonance")
    stop: float = option("stop", help="Last frequency over the first resonance")
    resume: Path | None = option("resume")
    json: Path | None = option("json", help="Write fold force, thresholds and map")
    csv: Path | None = option("csv", help="Write a row for each birth and merger", usual=True)
    plot: Path | None = option("plot")


def computed(options: IsolaOptions) -> IsolaMap:
    """Return the map of isolas for the options.

    Raises BadInput or ParameterError before any long computation.
    """
    kinds = {"map_modes": int, "map_restitutions": float, "map_friction_limits": float}
    modes, restitutions, limits = (
        common.numbers(option_name(name), getattr(options, name), kind)
        if getattr(options, name)
        else ()
        for name, kind in kinds.items()
    )
    scene = make_scene(options).scene
    case = case_of(scene, 1.0, float(scene.model.omega[0]))
    if modes or restitutions or limits:  # the case's own where only the others are given
        modes = modes or (case.model.modes,)
        restitutions = restitutions or (case.restitution,)
    with (
        closing(Checkpoint(options.resume)) as checkpoint,
        validation_alongside(case),
        counting_bar("isolas", "cells", leave=False) as show,
    ):
        return isola_map(
            case,
            options.start,
            options.stop,
            modes,
            restitutions,
            show,
            limits,
            checkpoint.section({"scene": from_scene(scene)}),
        )


@common.command(
    IsolaOptions,
    examples=(
        "periodic isola --modes 1 --from 0.93 --to 1",
        "periodic isola --modes 3 --map-modes 1,3 --plot isola.png",
    ),
)
def main(options: IsolaOptions) -> None:
    """Find the forces at which isolas are born and merge with their neighbours.

    An isola is a closed branch of symmetric two-impact orbits. Births and mergers are extrema of
    the force.

    They are the valleys and ridges of the smallest force that has an orbit, a closed form over the
    frequency; each is then found again with its friction reversals and confirmed by the exact
    method. Ctrl-C writes what is known so far; --resume keeps each finished cell of the map.
    """
    with common.plain_errors():
        common.check_targets(vars(options))
        refuse_parts(options)
        isola_map = computed(options)
        common.write_report(make_isola_report(isola_map), options)
    common.end_early(isola_map.complete)
