"""The option --structure: what an absorber is put on, from a file, in every command that simulates or designs."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import Beam
from impact_env.structure import StructureWarning, load_structure
from optimisation.cli.common import BadInput
from optimisation.mounting import mounted

Command = Callable[..., Any]
POSITION_HELP = "Place of absorber and response, over the length; of a beam from a file the absorber's only; of modes the number of a place."
RESONANCES_HELP = "Two resonances to look at, counted from 1; twice the same: one."


def structure_option(command: Command) -> Command:
    """Add --structure to a command."""
    text = "Structure from a .toml or .json file in place of the paper's beam (docs/your_structure.md)."
    return click.option("--structure", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help=text)(command)


def read_structure(path: Path) -> Structure:
    """Return the structure of a file; what looks wrong in it is told in a line each."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", StructureWarning)
        structure = load_structure(path)
    for warning in found:
        if issubclass(warning.category, StructureWarning):
            click.echo(f"warning: {warning.message}", err=True)
        else:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return structure


def model_of(path: Path | None, position: float = Beam.absorber_position, **options: Any) -> ModalModel:
    """Return the modal model of a file's structure, or of the beam that the ``options`` describe, with the absorber where --position says, if given.

    On modes a position is the number of one of the file's places for absorbers.
    """
    if path is None:
        return modal_model(Beam(absorber_position=position, **options))
    structure = read_structure(path)
    return mounted(structure, position) if is_given("position") else mounted(structure)


def is_given(name: str) -> bool:
    """Return whether an option of the command that runs was given, and has not its default; a command without it was not given it."""
    return click.get_current_context().get_parameter_source(name) not in (None, ParameterSource.DEFAULT)


def refuse_beside(structure: Path | None, *names: str) -> None:
    """Raise BadInput if one of the options is given beside a structure, whose file says what it is about."""
    for name in names:
        if structure is not None and is_given(name):
            raise BadInput(f"--{name.replace('_', '-')} does not go with --structure: the file says what the structure is")
