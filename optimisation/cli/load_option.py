"""The option --load: loads from a file in the place of one harmonic force, in every command that takes them."""

import math
from pathlib import Path

import click

from impact_env.loads import Loads, Random
from impact_env.modes import ModalModel
from impact_env.plain_loads import read_loads
from optimisation.cli.common import BadInput
from optimisation.cli.structure_option import is_given

load_option = click.option(
    "--load",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Loads other than one force, from a .toml or .json file (docs/loads.md): base, unbalance, tones, samples, random, shock.",
)


def loads_of(path: Path, model: ModalModel, resonance: int = 1) -> Loads:
    """Return the loads of a file; tell of what of a random one lies above the modes."""
    loads = read_loads(path, model.resonance_omega(resonance))
    highest = float(model.omega.max()) / (2 * math.pi)
    for part in loads.parts:
        if isinstance(part, Random) and (share := part.share_above(highest)) > 0:
            click.echo(f"warning: {100 * share:.3g} % of the random load's mean square lies above the highest mode, {highest:.4g} Hz", err=True)
    return loads


SAID = "the file says what acts, and for how long"


def refuse_beside_load(load: Path | None, *names: str, why: str = SAID) -> None:
    """Raise BadInput if one of the options that are named was given beside --load."""
    options = {parameter.name: parameter.opts[0] for parameter in click.get_current_context().command.params}
    for name in names:
        if load is not None and is_given(name):
            raise BadInput(f"{options[name]} does not go with --load: {why}")
