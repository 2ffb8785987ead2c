"""One sweep through a resonance to look at: response level and impacts, on request energy balance and the time it took."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from impact_env.drive import PAPER_LIMITS
from impact_env.methods import PAPER_STEPS
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls, TunedAbsorber
from optimisation.command_line import json_option, plain_errors
from optimisation.commands.structure_option import structure_option
from optimisation.commands.sweep_run import FORCE, default, run
from optimisation.commands.sweep_scene import (
    DEFAULT_ABSORBER,
    FRICTION_DAMPER_LIMIT,
    PARTS,
)
from optimisation.executors import cluster_option


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 150})
@click.option(
    "--absorber",
    type=click.Choice(list(PARTS)),
    help=default("Impact absorber, friction damper, linear tuned absorber, added mass, nothing.", DEFAULT_ABSORBER),
)
@click.option(
    "--scene", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Beam and absorber from a .toml or .json file (docs/scenes.md)."
)
@structure_option
@click.option("--modes", type=int, help=default("Number of modes kept.", Beam.modes))
@click.option("--damping", type=float, help=default("Modal damping ratio, the same for all modes.", Beam.damping_ratio))
@click.option("--mass-ratio", type=float, help=default("Absorber mass over beam mass.", DEFAULT_MASS_RATIO))
@click.option("--gap", type=float, help=default("Clearance to either wall in m (impact).", f"{RigidWalls.gap}, with --structure by the design rule"))
@click.option("--restitution", type=float, help=default("Coefficient of restitution, 0 to 1 (impact, rigid walls).", RigidWalls.restitution))
@click.option(
    "--friction-limit",
    type=float,
    help=default(
        "Friction limit in N; 0: no friction.", f"none for impact, {FRICTION_DAMPER_LIMIT} for friction, with --structure by the energy of a cycle"
    ),
)
@click.option("--contact-stiffness", type=float, help="Makes the walls springs of this stiffness in N/m (impact).")
@click.option(
    "--friction-stiffness",
    type=float,
    help="Makes friction elastic with this stiffness in N/m.  [default with compliant walls: the contact stiffness]",
)
@click.option("--stiffness", type=float, help=default("Spring of the tuned absorber in N/m.", f"{TunedAbsorber.stiffness}, with --structure tuned"))
@click.option(
    "--absorber-damping", type=float, help=default("Damper of the tuned absorber in N s/m.", f"{TunedAbsorber.damping}, with --structure tuned")
)
@click.option("--force", type=float, help=default("Amplitude of the harmonic force in N.", f"{FORCE}, with --structure by the design rule"))
@click.option("--phase", type=float, default=0.0, show_default=True, help="Initial phase of the force in rad.")
@click.option("--resonance", type=int, default=1, show_default=True, help="Resonance, counted from 1, that frequencies and pseudo periods refer to.")
@click.option("--from", "start", type=float, default=PAPER_LIMITS[0], show_default=True, help="First frequency over the resonance frequency.")
@click.option(
    "--to",
    "stop",
    type=float,
    default=PAPER_LIMITS[1],
    show_default=True,
    help="Last frequency over the resonance frequency; equal to --from: constant.",
)
@click.option("--periods", type=float, help="Length in pseudo periods at a constant frequency.")
@click.option(
    "--percent-per-100-periods",
    type=float,
    help=default("Rate of the sweep in percent of the resonance frequency.", "1, less by the square of damping below 1 %"),
)
@click.option("--down", is_flag=True, help="Sweep down: swaps --from and --to.")
@click.option("--method", type=click.Choice(["exact", "moreau", "runge-kutta"]), default="exact", show_default=True, help="Method of integration.")
@click.option("--steps-per-period", type=int, help=default("Steps per period of the highest mode (moreau, runge-kutta).", PAPER_STEPS))
@click.option("--most-events", type=int, help=default("Events after which a run is given up (exact).", "a million, and 5000 each pseudo period"))
@click.option("--members", type=int, default=1, show_default=True, help="Runs that differ in phase and by rounding; the first has --phase.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the other members' phases and roundings.")
@cluster_option
@click.option("--energy", is_flag=True, help="Account for the energies of the first member, which takes a kernel of its own.")
@click.option("--time", is_flag=True, help="Time an integration alone, with nothing observed, which takes a kernel of its own.")
@json_option("Write the results, in SI units.")
@click.option("--plot", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw the run: .png, .pdf or .svg.")
def main(**given: Any) -> None:
    """Integrate one sweep of the force's frequency through a resonance of the beam, and print what came out.

    In the JSON file response_level_m and level_frequency_ratio have one number for each member; impacts, tip and stuck time are those of the first
    member, which runs here also with --cluster, and so are energy_balance_relative_error with --energy, and with --time wall_s: the time of an
    integration alone, compiled and with nothing observed.
    """
    with plain_errors():
        click.echo(run(given))


if __name__ == "__main__":
    main(prog_name="scripts/run sweep")
