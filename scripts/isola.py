"""Isolas of periodic responses: the forces at which they are born and merge, over frequency, restitution, friction and number of modes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from optimisation.command_line import RESUME, check_target, end_early, json_option, name_files, plain_errors
from optimisation.commands.isola_forces import computed, written
from optimisation.commands.scene_options import scene_options
from optimisation.commands.sweep_scene import refuse_parts
from optimisation.report.isola_table import table


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 130})
@scene_options(", 0 to 1", friction="none")
@click.option("--from", "start", type=float, default=0.9, show_default=True, help="Lowest frequency over the first resonance's.")
@click.option("--to", "stop", type=float, default=1.0, show_default=True, help="Highest frequency over the first resonance's.")
@click.option("--map-modes", default="", metavar="N,N,...", help="Numbers of modes of a map, at most --modes.  [default: that]")
@click.option("--map-restitutions", default="", metavar="E,E,...", help="Restitutions of a map.  [default: --restitution]")
@click.option("--map-friction-limits", default="", metavar="N,N,...", help="Friction limits of a map in N.  [default: --friction-limit]")
@click.option("--resume", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help=RESUME)
@json_option("Write fold force, thresholds and map, in SI units.")
@click.option("--csv", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write a row for each birth and merger.")
@click.option("--figure", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw it: .png, .pdf or .svg.")
def main(**given: Any) -> None:
    """Find the forces at which closed branches of symmetric two-impact orbits are born and merge with their neighbours.

    They are the valleys and ridges of the smallest force that has an orbit, a closed form over the frequency; each is then found again with its
    friction reversals and confirmed by the exact method. Ctrl-C writes what is known so far; --resume keeps each finished cell of the map.
    """
    with plain_errors():
        for option, suffixes in (("json", (".json",)), ("csv", (".csv",)), ("figure", (".png", ".pdf", ".svg"))):
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


if __name__ == "__main__":
    main(prog_name="scripts/run isola")
