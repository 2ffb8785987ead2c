"""Exact periodic orbits of the impact absorber: two impacts a period and what a run settles to, folds, births and mergers of isolas."""

from __future__ import annotations

from typing import Any

import click

from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls
from optimisation.command_line import end_early, json_option, plain_errors
from optimisation.commands.orbit_list import FORCE_HELP, FROM, POINTS, TO, run
from optimisation.commands.structure_option import structure_option
from optimisation.files import write_json


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 150})
@structure_option
@click.option("--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept.")
@click.option("--damping", type=float, default=Beam.damping_ratio, show_default=True, help="Modal damping ratio, the same for all modes.")
@click.option("--mass-ratio", type=float, default=DEFAULT_MASS_RATIO, show_default=True, help="Absorber mass over beam mass.")
@click.option("--gap", type=float, default=RigidWalls.gap, show_default=True, help="Clearance to either wall in m.")
@click.option("--restitution", type=float, default=RigidWalls.restitution, show_default=True, help="Coefficient of restitution, 0 to 1.")
@click.option("--friction-limit", type=float, default=0.0, show_default=True, help="Friction limit in N; 0: no friction.")
@click.option("--force", type=float, help=FORCE_HELP)
@click.option("--from", "start", type=float, default=FROM, show_default=True, help="First frequency over that of the first resonance.")
@click.option("--to", "stop", type=float, default=TO, show_default=True, help="Last frequency over that of the first resonance.")
@click.option("--at", type=float, help="One frequency only; also what runs settle to there, of any period up to eight of the force's.")
@click.option("--points", type=int, default=POINTS, show_default=True, help="Frequencies listed from the first to the last.")
@click.option("--symmetric", is_flag=True, help="Symmetric orbits only, which is quicker.")
@click.option("--folds", is_flag=True, help="The folds of the branches at this force instead of orbits.")
@click.option("--thresholds", is_flag=True, help="The forces at which isolas are born and merge instead of orbits.")
@json_option("Write the list, in SI units.")
def main(**given: Any) -> None:
    """List exact periodic orbits of the impact absorber under a harmonic force, each confirmed by the exact method.

    It is on the paper's beam, or on another structure.

    Symmetric orbits with one impact a wall are found in closed form, with all reversals of friction, and along their branches. What leaves these
    where the symmetry breaks and where periods double, up to eight of the force's, is followed too, and where nothing is stable, what runs settle to.

    Multipliers of symmetric orbits are those of half a period: +1 is a fold, -1 breaks the symmetry. Columns slow and fast: the largest of the pair
    that lives as long as the beam's vibration, and of all others. Held: friction or a wall holds the absorber for a while.
    """
    with plain_errors():
        text, content, complete = run(given)
        if given["json"] is not None:
            write_json(given["json"].resolve(), content)
    click.echo(text)
    end_early(complete, "what was finished is shown.")


if __name__ == "__main__":
    main(prog_name="scripts/run orbits")
