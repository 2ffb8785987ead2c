"""What an absorber sits on, as plain data: a beam, modal data, a Universal File or matrices. `impact_env.plain` has scenes; docs/scenes.md the form.

Each kind of structure is a table of a file. Keys with a unit end in it. Names of other files are relative to the folder of the file.
"""

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.forms import NUMBER, ROW, WHOLE, Keys, Sort, form, tables
from impact_env.modes import ModalModel
from impact_env.parameters import Beam, ParameterError, Section, count, positive, require, row
from impact_env.structures.checks import StructureWarning, warnings_of_matrix
from impact_env.structures.matrices import checked, lowest_modes, proportional_damping, read_matrix
from impact_env.structures.modal import DAMPING_RATIO, TEXT, model_beside, ratios_of, text
from impact_env.structures.modal import MODEL as MODEL
from impact_env.structures.universal import DIRECTIONS, at, read_modes

PROFILES = {
    "rectangle": ("width", "height"),
    "tube": ("diameter", "wall"),
    "I": ("width", "height", "flange", "web"),
}


@dataclass(frozen=True)
class Profile:
    """A cross section that bends about its level axis: a rectangle, a round tube (a rod if ``wall`` is half the diameter) or an I."""

    kind: str
    width: float = 0.0
    height: float = 0.0
    diameter: float = 0.0
    wall: float = 0.0
    flange: float = 0.0
    web: float = 0.0

    def __post_init__(self) -> None:
        require(self.kind in PROFILES, "kind", self.kind, f"one of {', '.join(PROFILES)}")
        for name in PROFILES:
            for key in PROFILES[name]:
                value = getattr(self, key)
                own = key in PROFILES[self.kind]
                require(
                    value > 0 if own else value == 0,
                    f"{key}_m",
                    value,
                    f"above 0, for {name}" if own else f"for {name} only",
                )
        if self.kind == "tube":
            require(
                2 * self.wall <= self.diameter,
                "wall_m",
                self.wall,
                f"at most half the diameter, {self.diameter / 2:g} m",
            )
        if self.kind == "I":
            ok = 2 * self.flange < self.height and self.web < self.width
            allowed = "less than half the height, the width"
            require(ok, "flange_m, web_m", (self.flange, self.web), allowed)

    @property
    def area(self) -> float:
        """Area in m^2."""
        if self.kind == "tube":
            return math.pi * self.wall * (self.diameter - self.wall)
        cut = (self.width - self.web) * (self.height - 2 * self.flange) if self.kind == "I" else 0.0
        return self.width * self.height - cut

    @property
    def second_moment(self) -> float:
        """Second moment of area in m^4."""
        if self.kind == "tube":
            return math.pi / 64 * (self.diameter**4 - (self.diameter - 2 * self.wall) ** 4)
        cut = (
            (self.width - self.web) * (self.height - 2 * self.flange) ** 3
            if self.kind == "I"
            else 0.0
        )
        return (self.width * self.height**3 - cut) / 12


MODES = 10  # kept of matrices, unless told otherwise
UNITS = {
    "kg, m, s": 1.0,
    "t, mm, s": 1e3,
}  # of matrices -> kg of the unit of mass; lengths cancel in mass-normalised shapes


def _ratios(path: str, plain: Any) -> dict[int, float]:
    require(
        isinstance(plain, Mapping),
        path,
        plain,
        'a table from mode numbers, 2 or more, to frequency ratios, as {"2" = 6.3}',
    )
    for mode in plain:
        require(
            isinstance(mode, str) and mode.isascii() and mode.isdigit() and mode[0] != "0",
            f"{path}'s mode",
            mode,
            "a mode number, 2 or more",
        )
    return {int(mode): NUMBER.read(f"{path}[{mode}]", ratio) for mode, ratio in plain.items()}


RATIOS = Sort(_ratios, lambda ratios: {str(mode): float(ratio) for mode, ratio in ratios.items()})
SECTION_KEYS: Keys = {
    "elements": ("elements", WHOLE),
    "bending_stiffness_n_m2": ("bending_stiffness", NUMBER),
    "mass_per_length_kg_m": ("mass_per_length", NUMBER),
}
VECTOR = Sort(
    lambda path, plain: text(path, plain) if isinstance(plain, str) else ROW.read(path, plain), list
)  # or the name of a file
SECTIONS = tables(Section, SECTION_KEYS)
BEAM_KEYS = form(
    Beam,
    {
        "length_m": ("length", NUMBER),
        "bending_stiffness_n_m2": ("bending_stiffness", NUMBER),
        "mass_per_length_kg_m": ("mass_per_length", NUMBER),
        "elements": ("elements", WHOLE),
        "modes": ("modes", WHOLE),
        "damping_ratio": ("damping_ratio", DAMPING_RATIO),
        "force_position": ("force_position", NUMBER),
        "absorber_position": ("absorber_position", NUMBER),
        "response_position": ("response_position", NUMBER),
        "modal_frequency_ratio": ("modal_frequency_ratio", RATIOS),
        "ends": ("ends", TEXT),
        "tip_mass_kg": ("tip_mass", NUMBER),
        "sections": ("sections", SECTIONS),
        "suspension_frequency_hz": ("suspension_frequency", NUMBER),
    },
)
PROFILE = form(
    Profile,
    {
        "kind": ("kind", TEXT),
        **{f"{key}_m": (key, NUMBER) for keys in PROFILES.values() for key in keys},
    },
)
OF_MATERIAL = ("young_modulus_pa", "density_kg_m3", "section")


def _read_beam(path: str, plain: Any) -> Beam:
    """Return a beam whose bending stiffness and mass are given, or follow from material and section."""
    if not (isinstance(plain, Mapping) and any(key in plain for key in OF_MATERIAL)):
        return BEAM_KEYS.read(path, plain)
    found = dict(plain)
    for key in OF_MATERIAL:
        require(
            key in found, f"{path}.{key}", None, f"given: {', '.join(OF_MATERIAL)} belong together"
        )
    for key in ("bending_stiffness_n_m2", "mass_per_length_kg_m"):
        require(
            key not in found,
            f"{path}.{key}",
            found.get(key),
            "left out beside a section, from which it follows",
        )
    young, density = (
        positive(f"{path}.{key}", NUMBER.read(f"{path}.{key}", found.pop(key)))
        for key in OF_MATERIAL[:2]
    )
    profile = PROFILE.read(f"{path}.section", found.pop("section"))
    found |= {
        "bending_stiffness_n_m2": young * profile.second_moment,
        "mass_per_length_kg_m": density * profile.area,
    }
    return BEAM_KEYS.read(path, found)


BEAM = Sort(_read_beam, BEAM_KEYS.write)


@dataclass(frozen=True)
class _Place:
    """A node of a Universal File and one of its directions."""

    node: int
    direction: str

    def __post_init__(self) -> None:
        count("node", self.node, 0)
        allowed = f"one of {', '.join(DIRECTIONS)}, with - before it for the other sense"
        require(
            self.direction.lstrip("+-") in DIRECTIONS and len(self.direction) <= 2,
            "direction",
            self.direction,
            allowed,
        )


PLACE = form(_Place, {"node": ("node", WHOLE), "direction": ("direction", TEXT)})


# a term of a strain: a weight, and the displacement it multiplies, of a node in a direction or of a row of the matrices
STRAINED = form(
    lambda node, direction, weight: (weight, _Place(node, direction)),
    {"node": ("node", WHOLE), "direction": ("direction", TEXT), "weight": ("weight", NUMBER)},
)
STRAINED_ROW = form(
    lambda row, weight: (weight, row), {"row": ("row", WHOLE), "weight": ("weight", NUMBER)}
)


def _one_or_list(sort: Sort) -> Sort:
    """Return the sort of a list of things, or of one of them, which is a list of one."""

    def read(path: str, plain: Any) -> list[Any]:
        if not isinstance(plain, list | tuple):
            return [sort.read(path, plain)]
        require(len(plain) > 0, path, plain, "one place, or a list of them")
        return [sort.read(f"{path}[{i}]", part) for i, part in enumerate(plain)]

    return Sort(read, list)


Parts = list[tuple[float, Any]]
TURNED = (
    "force_shape",
    "tip_shape",
    "absorber_shapes",
    "response_shape",
    "stress_shape",
    "base_participation",
)  # with the modes' signs


def _signed(model: ModalModel) -> ModalModel:
    """Return a model whose absorber moves up in every mode, as a beam's tip does."""
    sign = np.where(model.tip_shape < 0, -1.0, 1.0)
    return replace(
        model,
        **{
            name: getattr(model, name) * sign for name in TURNED if getattr(model, name) is not None
        },
    )


def _placed(
    omega: Any,
    damping: Any,
    force: Any,
    absorbers: list[Any],
    response: Any,
    mass: float,
    stress: Any,
    base: Any = None,
    at_absorber: float = 1.0,
) -> ModalModel:
    """Return the model of shapes (N_m,) at the places; of several places for absorbers one has the first, and several have those they are put on.

    ``base`` (N_m,) and ``at_absorber`` as in `ModalModel`.
    """
    several = None if len(absorbers) == 1 else np.array(absorbers)
    return _signed(
        ModalModel(
            omega, damping, force, absorbers[0], mass, several, response, stress, base, at_absorber
        )
    )


def _strain(parts: Parts | None, shape: Callable[[Any], Any]) -> Any:
    """Return the strain per modal displacement (N_m,): the sum of the parts' weights times the ``shape`` (N_m,) that a part has; None for none."""
    return None if parts is None else np.sum([weight * shape(of) for weight, of in parts], axis=0)


def _of_universal(
    folder: Path,
    *,
    file: str,
    force: _Place,
    absorber: list[_Place],
    mass: float,
    response: _Place | None = None,
    modes: int | None = None,
    damping_ratio: Any = None,
    stress: Parts | None = None,
    base_participation: list[float] | None = None,
    base_at_absorber: float = ModalModel.base_at_absorber,
) -> ModalModel:
    path = folder / file
    found = read_modes(path)
    kept = found if modes is None else found[: count("modes", modes, 1, len(found))]
    measured = [mode.damping_ratio for mode in kept]
    ratios = ratios_of(damping_ratio, None if None in measured else measured, len(kept))

    def shape(name: str, place: _Place) -> Any:
        return at(kept, path, name, (place.node, place.direction))

    places = [shape("absorber", place) for place in absorber]
    read = None if response is None else shape("response", response)
    strain = _strain(stress, lambda place: shape("stress", place))
    base = None if base_participation is None else np.array(base_participation)
    require(
        base is None or len(base) == len(kept),
        "base_participation",
        base_participation,
        f"a number for each of the {len(kept)} modes",
    )
    omega = [m.omega for m in kept]
    return _placed(
        omega, ratios, shape("force", force), places, read, mass, strain, base, base_at_absorber
    )


UNIVERSAL_KEYS: Keys = {
    "file": ("file", TEXT),
    "force": ("force", PLACE),
    "absorber": ("absorber", _one_or_list(PLACE)),
    "response": ("response", PLACE),
    "mass_kg": ("mass", NUMBER),
    "modes": ("modes", WHOLE),
    "damping_ratio": ("damping_ratio", DAMPING_RATIO),
    "stress": ("stress", _one_or_list(STRAINED)),
    "base_participation_sqrt_kg": ("base_participation", ROW),
    "base_at_absorber": ("base_at_absorber", NUMBER),
}


MATRIX_KEYS: Keys = {
    "mass": ("mass", TEXT),
    "stiffness": ("stiffness", TEXT),
    "damping": ("damping", TEXT),
    "units": ("units", TEXT),
    "force": ("force", WHOLE),
    "absorber": ("absorber", _one_or_list(WHOLE)),
    "response": ("response", WHOLE),
    "mass_kg": ("structure_mass", NUMBER),
    "modes": ("modes", WHOLE),
    "damping_ratio": ("damping_ratio", DAMPING_RATIO),
    "suspension_frequency_hz": ("suspension_frequency", NUMBER),
    "stress": ("stress", _one_or_list(STRAINED_ROW)),
    "base_vector": ("base_vector", VECTOR),
    "coordinates": ("coordinates", TEXT),
}


def _of_matrices(
    folder: Path,
    *,
    mass: str,
    stiffness: str,
    units: str,
    force: int,
    absorber: list[int],
    structure_mass: float,
    damping: str | None = None,
    response: int | None = None,
    modes: int = MODES,
    damping_ratio: Any = None,
    suspension_frequency: float | None = None,
    stress: Parts | None = None,
    base_vector: Any = None,
    coordinates: str | None = None,  # noqa: ARG001 - of the rows, for who looks for one
) -> ModalModel:
    require(
        units in UNITS,
        "units",
        units,
        f"one of {', '.join(repr(known) for known in UNITS)}, those of the matrices",
    )
    inertia = checked("mass", read_matrix(folder / mass, "mass", "M"))
    size = inertia.shape[0]
    elastic = checked("stiffness", read_matrix(folder / stiffness, "stiffness", "K"), size)
    force = count("force", force, 0, size - 1)
    absorber = [count("absorber", k, 0, size - 1) for k in absorber]
    response = None if response is None else count("response", response, 0, size - 1)
    rows = {"force": force, "absorber": absorber[0]} | (
        {} if response is None else {"response": response}
    )
    for line in warnings_of_matrix(inertia.diagonal() * UNITS[units], structure_mass, rows):
        warnings.warn(line, StructureWarning, stacklevel=2)
    kept = lowest_modes(inertia, elastic, min(count("modes", modes, 1), size), suspension_frequency)
    found = None
    if damping is not None:
        require(
            damping_ratio is None,
            "damping_ratio",
            damping_ratio,
            "left out beside a damping matrix",
        )
        found = proportional_damping(
            checked("damping", read_matrix(folder / damping, "damping", "C"), size), kept
        )
    ratios = ratios_of(damping_ratio, found, len(kept.omega))
    shapes = kept.shapes / np.sqrt(UNITS[units])
    places = [shapes[k] for k in absorber]
    read = None if response is None else shapes[response]
    strain = _strain(stress, lambda row: shapes[count("stress's row", row, 0, size - 1)])
    if base_vector is None:
        return _placed(kept.omega, ratios, shapes[force], places, read, structure_mass, strain)
    rigid = _base_vector(folder, base_vector, size)
    moved = rigid[absorber]
    allowed = "the same displacement at all places for absorbers"
    require(len(set(moved.tolist())) == 1, "base_vector", moved.tolist(), allowed)
    base = np.sqrt(UNITS[units]) * (kept.shapes.T @ (inertia @ rigid))
    return _placed(
        kept.omega,
        ratios,
        shapes[force],
        places,
        read,
        structure_mass,
        strain,
        base,
        float(moved[0]),
    )


def _base_vector(folder: Path, given: Any, size: int) -> Any:
    """Return the rigid displacement (size,) for a unit motion of the base: a list, or a text file with one number a row."""
    allowed = f"a list or a file with {size} finite numbers, one for each row of the matrices"
    if isinstance(given, str):
        try:
            given = np.loadtxt(folder / given, ndmin=1).tolist()
        except (OSError, ValueError) as error:
            raise ParameterError(
                f"base_vector = {given!r} is not allowed: {allowed} ({error})"
            ) from error
    found = row("base_vector", given, allowed)
    require(len(found) == size, "base_vector", f"{len(found)} numbers", allowed)
    return found


# kinds of structure -> the form of their table, for the folder in which the files lie that it names
STRUCTURES: dict[str, Callable[[Path], Sort]] = {
    "beam": lambda _: BEAM,
    "model": model_beside,
    "universal": lambda folder: form(partial(_of_universal, folder), UNIVERSAL_KEYS),
    "matrices": lambda folder: form(partial(_of_matrices, folder), MATRIX_KEYS),
}
