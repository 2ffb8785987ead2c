"""The option --structure: what an absorber is put on, from a file, in every command that simulates or designs."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls, SlidingAbsorber, require
from impact_env.plain import from_scene, to_beam, to_scene
from impact_env.plain_files import read_plain
from impact_env.scene import Scene
from impact_env.structure import StructureWarning, load_structure
from optimisation.cli.common import BadInput
from optimisation.files import write_json
from optimisation.mounting import mounted

Command = Callable[..., Any]
PLACE = "Place of absorber and response, over the length; of a beam from a file the absorber's only; of modes the number of a place."
position_option = click.option("--position", type=float, default=Beam.absorber_position, show_default=True, help=PLACE)
RESONANCES_HELP = "Two resonances to look at, counted from 1; twice the same: one."


def structure_option(command: Command) -> Command:
    """Add --structure to a command."""
    text = "Structure from a .toml or .json file in place of the paper's beam (docs/your_structure.md)."
    return click.option("--structure", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help=text)(command)


def read_structure(path: Path) -> Structure:
    """Return the structure of a file; its warnings are printed, a line each."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", StructureWarning)
        structure = load_structure(path)
    for warning in found:
        if issubclass(warning.category, StructureWarning):
            click.echo(f"warning: {warning.message}", err=True)
        else:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return structure


def structure_of(path: Path | None, position: float = Beam.absorber_position, **options: Any) -> Structure:
    """Return the structure of a file, or the beam that the ``options`` describe, with the absorber where --position says, if given."""
    if path is None:
        return Beam(absorber_position=position, **options)
    structure = read_structure(path)
    if not is_given("position"):
        return structure
    return mounted(structure, position) if isinstance(structure, ModalModel) else replace(structure, absorber_position=position)


def model_of(path: Path | None, position: float = Beam.absorber_position, **options: Any) -> ModalModel:
    """Return the modal model of `structure_of`. On modes a position is the number of one of the file's places for absorbers."""
    structure = structure_of(path, position, **options)
    return modal_model(structure) if path is None else mounted(structure)


def scene_option(command: Command) -> Command:
    """Add --scene to a command that has --structure."""
    text = "Structure and impact absorber from a .toml or .json file, as design_gap --device writes it."
    return click.option("--scene", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help=text)(command)


def read_device(path: Path, *names: str) -> tuple[Structure, SlidingAbsorber]:
    """Return the structure and the impact absorber of a file; raises BadInput if one of the options that are named was given beside it."""
    for name in names:
        if is_given(name):
            raise BadInput(f"--{name.replace('_', '-')} does not go with --scene: the file says what structure and absorber are")
    plain = read_plain(path)
    scene, beam = to_scene(plain, path.parent), to_beam(plain)
    absorber = scene.absorber
    if not isinstance(absorber, SlidingAbsorber) or not isinstance(absorber.walls, RigidWalls):
        raise BadInput(f"--scene = {path} is not allowed: a scene with one impact absorber between rigid walls")
    if beam is None:
        return scene.model, absorber
    return (beam if beam.response_position is not None else replace(beam, response_position=beam.absorber_position)), absorber


def write_device(path: Path, structure: Structure, absorber: SlidingAbsorber) -> None:
    """Write structure and absorber as a scene, which other commands read by --scene: a beam as a beam."""
    beam = structure if isinstance(structure, Beam) else None
    write_json(path, from_scene(Scene(mounted(structure) if beam is None else modal_model(beam), absorber), beam))


def mass_option(command: Command) -> Command:
    """Add --mass-kg to a command that has --mass-ratio, or variables."""
    return click.option("--mass-kg", type=float, help="Absorber mass in kg, in the place of its ratio.")(command)


def mass_ratio_of(mass_ratio: float, mass_kg: float | None, structure_mass: float) -> float:
    """Return the mass ratio, that of --mass-kg if given; raises BadInput if both are."""
    if mass_kg is None:
        return mass_ratio
    if is_given("mass_ratio"):
        raise BadInput("--mass-kg does not go with --mass-ratio: each says what the mass is")
    require(0 < mass_kg <= structure_mass, "mass_kg", mass_kg, f"above 0 and at most the structure's {structure_mass:.4g} kg")
    return mass_kg / structure_mass


def is_given(name: str) -> bool:
    """Return whether an option of the command that runs was given, and has not its default; a command without it was not given it."""
    return click.get_current_context().get_parameter_source(name) not in (None, ParameterSource.DEFAULT)


def refuse_beside(structure: Path | None, *names: str) -> None:
    """Raise BadInput if one of the options is given beside a structure, whose file says what it is about."""
    for name in names:
        if structure is not None and is_given(name):
            raise BadInput(f"--{name.replace('_', '-')} does not go with --structure: the file says what the structure is")


# The options of an absorber on the paper's beam, for commands on periodic motions; what is left out is None.


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
