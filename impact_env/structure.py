"""A structure from a file, for everything that simulates or designs. docs/your_structure.md shows it, docs/scenes.md has the form."""

import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

from impact_env.modes import Structure, modal_model
from impact_env.parameters import Beam, ParameterError, instance, require, suspended
from impact_env.plain import to_structure
from impact_env.plain_files import read_plain
from impact_env.structures.checks import StructureWarning as StructureWarning
from impact_env.structures.checks import warnings_of

NEEDED = ("length_m", "bending_stiffness_n_m2", "mass_per_length_kg_m")


def load_structure(path: Path | str) -> Structure:
    """Return the structure that a TOML or JSON file describes: a `Beam`, or the `ModalModel` of modal data, a Universal File or matrices.

    The file has one of the tables ``beam``, ``model``, ``universal`` and ``matrices``, and no absorber (`docs/scenes.md`). Level and limits are read
    at the response's place, or at the absorber's if it names none. Raises ParameterError that names file, key, value and what is
    allowed; warns with a StructureWarning about what looks wrong: shapes that are not mass-normalised, frequencies that coincide, units.
    """
    path = Path(instance("path", path, str | Path))
    plain = read_plain(path)
    try:
        structure = _read(plain, path)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error
    beam = structure if isinstance(structure, Beam) else None
    model = modal_model(structure)
    own = plain.get("matrices", {}).get("suspension_frequency_hz")
    rigid = beam.rigid_motions if beam is not None else 0
    if own is not None:
        rigid = sum(math.isclose(a, 2 * math.pi * b, rel_tol=1e-12) for a, b in zip(model.omega, suspended(own, model.modes), strict=True))
    for text in warnings_of(model, beam, rigid):
        warnings.warn(f"{path}: {text}", StructureWarning, stacklevel=2)
    return structure


def _read(plain: dict[str, Any], path: Path) -> Structure:
    kinds = [kind for kind in ("beam", "model", "universal", "matrices") if kind in plain]
    require("absorber" not in plain, "absorber", plain.get("absorber"), "left out: a structure is what an absorber is put on (a scene has both)")
    structure = to_structure(plain, path.parent, "")
    require(len(kinds) == 1, "structure", list(plain), "a file with one of the tables beam, model, universal, matrices")
    if isinstance(structure, Beam):
        missing = [key for key in (NEEDED[:1] if "section" in plain["beam"] else NEEDED) if key not in plain["beam"]]
        require(not missing, "beam", list(plain["beam"]), f"the keys {', '.join(missing)} must be given")
        if structure.response_position is None:  # in every command: where the absorber was, also if a search moves it
            return replace(structure, response_position=structure.absorber_position)
    return structure
