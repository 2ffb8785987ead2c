"""The option --load: loads from a file, or in short, in the place of one harmonic force, in every command that takes them."""

import math
from pathlib import Path
from typing import Any

import click

from impact_env.drive import default_rate, linear_sweep
from impact_env.loads import Loads, Random, Samples
from impact_env.modes import ModalModel
from impact_env.plain_loads import read_loads, to_loads
from optimisation.cli.common import BadInput
from optimisation.cli.structure_option import is_given

SHORT = {
    "base": ("acceleration_m_s2",),
    "unbalance": ("unbalance_kg_m",),
    "random": ("low_hz", "high_hz", "value", "duration_s"),
    "shock": ("peak_n", "pulse_s", "duration_s"),
}
load_option = click.option(
    "--load",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Loads other than one force, from a .toml or .json file (docs/loads.md): base, unbalance, tones, samples, random, shock. In short: "
    + ", ".join(":".join((kind, *names)).upper() for kind, names in SHORT.items())
    + ".",
)
TOLD = 1e-3  # of a load's mean square: from there on it is told that it lies above the modes


def _in_short(text: str, model: ModalModel, resonance: int) -> dict[str, Any] | None:
    """Return the table that a short form stands for, None for the name of a file."""
    kind, *numbers = text.split(":")
    if kind not in SHORT or not numbers or Path(text).exists():
        return None
    names = SHORT[kind]
    try:
        found = dict(zip(names, map(float, numbers), strict=True))
    except ValueError:
        raise BadInput(f"--load {text}: {':'.join((kind, *names)).upper()}, numbers") from None
    if kind == "random":
        spectrum = [[found["low_hz"], found["value"]], [found["high_hz"], found["value"]]]
        return {"kind": kind, "spectrum": spectrum, "duration_s": found["duration_s"]}
    if kind == "shock":
        return {"kind": kind, "pulse": "half-sine", **found}
    sweep = linear_sweep(model.resonance_omega(resonance), percent_per_100_periods=default_rate(model, (resonance,)))
    schedule = {"times_s": sweep.times.tolist(), "omegas_rad_s": sweep.omegas.tolist(), "reference_rad_s": sweep.reference}
    return {"kind": kind, **found, "schedule": schedule}


def loads_of(path: Path, model: ModalModel, resonance: int = 1) -> Loads:
    """Return the loads of a file, or of a short form; tell of what lies above the modes."""
    reference, short = model.resonance_omega(resonance), _in_short(str(path), model, resonance)
    loads = read_loads(path, reference) if short is None else to_loads({"load": short}, reference)
    highest = float(model.omega.max()) / (2 * math.pi)
    for part in loads.parts:
        if isinstance(part, Random | Samples) and (share := part.share_above(highest)) > TOLD:
            name = "random load" if isinstance(part, Random) else "record"
            click.echo(f"warning: {100 * share:.3g} % of the {name}'s mean square lies above the highest mode, {highest:.4g} Hz", err=True)
    return loads


SAID = "the file says what acts, and for how long"


def refuse_beside_load(load: Path | None, *names: str, why: str = SAID) -> None:
    """Raise BadInput if one of the options that are named was given beside --load."""
    options = {parameter.name: parameter.opts[0] for parameter in click.get_current_context().command.params}
    for name in names:
        if load is not None and is_given(name):
            raise BadInput(f"{options[name]} does not go with --load: {why}")
