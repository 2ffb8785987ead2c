"""The options of an absorber on the paper's beam, for commands on periodic motions; what is left out is None."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls
from optimisation.cli.structure_option import Command, structure_option


def scene_options(restitution: str, friction: str = "") -> Callable[[Command], Command]:
    """Add --scene, --structure, --modes, --damping, --mass-ratio, --gap, --restitution and --friction-limit to a command.

    ``restitution`` says which are allowed, ``friction`` is the default of the friction limit where it is to be told.
    """
    file = click.Path(dir_okay=False, path_type=Path)
    told = f"  [default: {friction}]" if friction else ""
    options = (
        click.option("--scene", type=file, metavar="FILE", help="Beam and absorber from a .toml or .json file."),
        structure_option,
        click.option("--modes", type=int, help=f"Number of modes kept.  [default: {Beam.modes}]"),
        click.option("--damping", type=float, help=f"Modal damping ratio, the same for all modes.  [default: {Beam.damping_ratio}]"),
        click.option("--mass-ratio", type=float, help=f"Absorber mass over beam mass.  [default: {DEFAULT_MASS_RATIO}]"),
        click.option("--gap", type=float, help=f"Clearance to either wall in m.  [default: {RigidWalls.gap}]"),
        click.option("--restitution", type=float, help=f"Coefficient of restitution{restitution}.  [default: {RigidWalls.restitution}]"),
        click.option("--friction-limit", type=float, help=f"Friction limit in N; 0: no friction.{told}"),
    )

    def add(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add
