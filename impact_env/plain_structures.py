"""Structures as plain data: a beam, modal data, a Universal File or matrices.

`impact_env.plain` has the scenes. docs/scenes.md describes the format.

Each kind of structure is a table of a file. Keys with a unit end in it. Names of other files are
relative to the folder of the file.
"""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.checks import (
    ParameterError,
    count,
    count_from,
    describe_error,
    finite,
    non_negative,
    positive,
    require,
    row,
    word_of,
)
from impact_env.fields import check_fields, parameter
from impact_env.modes import ModalModel
from impact_env.parameters import Beam, Section
from impact_env.plain_disks import disk_codec_for
from impact_env.plain_files import (
    NUMBER_CODEC,
    ROW_CODEC,
    WHOLE_CODEC,
    Codec,
    Keys,
    dataclass_codec,
    dataclass_keys,
    list_codec,
    require_readable,
)
from impact_env.structures import ansys, nastran, universal
from impact_env.structures.checks import StructureWarning, list_matrix_warnings
from impact_env.structures.matrices import (
    StructureModes,
    check_matrix,
    lowest_modes,
    proportional_damping,
)
from impact_env.structures.matrix_files import (
    FREEDOM_NAMES as FREEDOMS,
)
from impact_env.structures.matrix_files import (
    MatrixFile,
    read_coordinates,
    read_matrix,
    with_freedoms,
    without_freedoms,
)
from impact_env.structures.modal import (
    DAMPING_RATIO_CODEC,
    TEXT_CODEC,
    choose_damping_ratios,
    model_codec_for,
    require_text,
)
from impact_env.structures.modal import MODEL_CODEC as MODEL_CODEC
from impact_env.structures.units import ConsistentUnits, read_units
from impact_env.structures.universal import (
    UNIVERSAL_DIRECTIONS,
    MeasuredMode,
    read_modes,
    require_global_directions,
    select_shapes,
)

PROFILES = {
    "rectangle": ("width", "height"),
    "tube": ("diameter", "wall"),
    "I": ("width", "height", "flange", "web"),
}


LENGTH = parameter(non_negative, unit="m")


@dataclass(frozen=True)
class Profile:
    """A cross section that bends about its horizontal axis.

    It is a rectangle, a round tube (a rod if ``wall`` is half the diameter) or an I-section.
    """

    kind: str = field(metadata=parameter(word_of(PROFILES)))
    width: float = field(default=0.0, metadata=LENGTH)
    height: float = field(default=0.0, metadata=LENGTH)
    diameter: float = field(default=0.0, metadata=LENGTH)
    wall: float = field(default=0.0, metadata=LENGTH)
    flange: float = field(default=0.0, metadata=LENGTH)
    web: float = field(default=0.0, metadata=LENGTH)

    def __post_init__(self) -> None:
        check_fields(self)
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
    return {int(mode): NUMBER_CODEC.read(f"{path}[{mode}]", ratio) for mode, ratio in plain.items()}


RATIOS_CODEC = Codec(
    _ratios, lambda ratios: {str(mode): float(ratio) for mode, ratio in ratios.items()}
)
VECTOR_CODEC = Codec(
    lambda path, plain: (
        require_text(path, plain) if isinstance(plain, str) else ROW_CODEC.read(path, plain)
    ),
    list,
)  # or the name of a file
BEAM_VALUES_CODEC = dataclass_codec(
    Beam,
    dataclass_keys(
        Beam,
        damping_ratio=DAMPING_RATIO_CODEC,
        modal_frequency_ratio=RATIOS_CODEC,
        ends=TEXT_CODEC,
        sections=list_codec(Section, dataclass_keys(Section)),
    ),
)
PROFILE_CODEC = dataclass_codec(Profile, dataclass_keys(Profile, kind=TEXT_CODEC))
OF_MATERIAL = ("young_modulus_pa", "density_kg_m3", "section")


def _read_beam(path: str, plain: Any) -> Beam:
    """Return a beam from plain data.

    Its bending stiffness and mass are given, or follow from material and section.
    """
    if not (isinstance(plain, Mapping) and any(key in plain for key in OF_MATERIAL)):
        return BEAM_VALUES_CODEC.read(path, plain)
    result = dict(plain)
    for key in OF_MATERIAL:
        require(
            key in result, f"{path}.{key}", None, f"given: {', '.join(OF_MATERIAL)} belong together"
        )
    for key in ("bending_stiffness_n_m2", "mass_per_length_kg_m"):
        require(
            key not in result,
            f"{path}.{key}",
            result.get(key),
            "left out beside a section, from which it follows",
        )
    young, density = (
        positive(f"{path}.{key}", NUMBER_CODEC.read(f"{path}.{key}", result.pop(key)))
        for key in OF_MATERIAL[:2]
    )
    profile = PROFILE_CODEC.read(f"{path}.section", result.pop("section"))
    result |= {
        "bending_stiffness_n_m2": young * profile.second_moment,
        "mass_per_length_kg_m": density * profile.area,
    }
    return BEAM_VALUES_CODEC.read(path, result)


BEAM_CODEC = Codec(_read_beam, BEAM_VALUES_CODEC.write)


@dataclass(frozen=True)
class _NodeDirection:
    """A node of a Universal File and one of its directions."""

    node: int = field(metadata=parameter(count_from(0)))
    direction: str

    def __post_init__(self) -> None:
        check_fields(self)
        allowed = f"one of {', '.join(UNIVERSAL_DIRECTIONS)}, with - before it for the other sense"
        require(
            self.direction.lstrip("+-") in UNIVERSAL_DIRECTIONS and len(self.direction) <= 2,
            "direction",
            self.direction,
            allowed,
        )


PLACE_CODEC = dataclass_codec(_NodeDirection, dataclass_keys(_NodeDirection, direction=TEXT_CODEC))


# a term of a strain: a weight, and the displacement it multiplies, of a node in a direction or of a
# row of the matrices
STRAIN_CODEC = dataclass_codec(
    lambda node, direction, weight: (weight, _NodeDirection(node, direction)),
    {
        "node": ("node", WHOLE_CODEC),
        "direction": ("direction", TEXT_CODEC),
        "weight": ("weight", NUMBER_CODEC),
    },
)
ROW_STRAIN_CODEC = dataclass_codec(
    lambda row, weight: (weight, row),
    {"row": ("row", WHOLE_CODEC), "weight": ("weight", NUMBER_CODEC)},
)


def _read_row(path: str, plain: Any) -> Any:
    """Return a row of the matrices.

    The place is a node and a direction if the matrices' file names them.
    """
    return (
        PLACE_CODEC.read(path, plain)
        if isinstance(plain, Mapping)
        else WHOLE_CODEC.read(path, plain)
    )


ROW_OR_PLACE_CODEC = Codec(_read_row, WHOLE_CODEC.write)
ROW_OR_PLACE_STRAIN_CODEC = Codec(
    lambda path, plain: (
        STRAIN_CODEC if isinstance(plain, Mapping) and "node" in plain else ROW_STRAIN_CODEC
    ).read(path, plain),
    list,
)


@dataclass(frozen=True)
class PointForce:
    """A force on a structure.

    ``place`` is in the form of the structure's table, ``amplitude`` in N and ``phase`` in rad.
    ``name`` is the place's name in the file, by which loads refer to it.
    """

    place: Any
    amplitude: float = field(metadata=parameter(positive, unit="N"))
    phase: float = field(default=0.0, metadata=parameter(finite, unit="rad"))
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self)


def read_forces(path: str, plain: Any, place_codec: Codec) -> tuple[PointForce, ...]:
    """Return the forces of a list of tables, each at another place."""
    keys = dataclass_keys(PointForce, without=("name",), place=place_codec)
    require(
        isinstance(plain, list | tuple) and len(plain) > 0,
        path,
        plain,
        "a list of tables with the keys place, amplitude_n and phase_rad",
    )
    forces = tuple(list_codec(PointForce, keys).read(path, plain))
    for k, force in enumerate(forces):
        once = all(force.place != other.place for other in forces[:k])
        require(once, f"{path}[{k}].place", plain[k]["place"], "each place once")
    return forces


def apply_forces(model: ModalModel, forces: Sequence[PointForce], shapes: Any) -> ModalModel:
    """Return a model under forces at places with ``shapes`` (P, N_m).

    The drive's amplitude is that of the first force.
    """
    largest = forces[0].amplitude
    places = dict(zip((one.name for one in forces), np.array(shapes), strict=True))
    try:
        return model.with_forces(
            shapes, [one.amplitude / largest for one in forces], [one.phase for one in forces]
        ).with_force_places(places)
    except ParameterError as error:
        sizes = [(one.amplitude, one.phase) for one in forces]
        allowed = "amplitudes in N and phases in rad of forces that do not cancel on all modes kept"
        raise describe_error("force", sizes, allowed) from error


def _place_or_forces(place_codec: Codec) -> Codec:
    """Return the codec of a place, or of forces that have been read already."""

    def read(path: str, plain: Any) -> Any:
        read_before = isinstance(plain, tuple) and all(isinstance(x, PointForce) for x in plain)
        return plain if read_before else place_codec.read(path, plain)

    return Codec(read, place_codec.write)


def _one_or_list(codec: Codec) -> Codec:
    """Return the codec of a list of items, or of one item, which is read as a list of one."""

    def read(path: str, plain: Any) -> list[Any]:
        if not isinstance(plain, list | tuple):
            return [codec.read(path, plain)]
        require(len(plain) > 0, path, plain, "one place, or a list of them")
        return [codec.read(f"{path}[{i}]", part) for i, part in enumerate(plain)]

    return Codec(read, list)


StrainParts = list[tuple[float, Any]]
SHAPES_WITH_SIGN = (
    "force_shape",
    "tip_shape",
    "absorber_shapes",
    "response_shape",
    "stress_shape",
    "base_participation",
    "force_quadrature",
    "force_places",
)  # with the modes' signs


def _signed(model: ModalModel) -> ModalModel:
    """Return a model whose absorber moves up in every mode, as a beam's tip does."""
    sign = np.where(model.tip_shape < 0, -1.0, 1.0)
    return replace(
        model,
        **{
            name: getattr(model, name) * sign
            for name in SHAPES_WITH_SIGN
            if getattr(model, name) is not None
        },
    )


def _force_places(force: Any) -> tuple[Any, ...]:
    """Return the places of a structure's force, or of its forces."""
    return tuple(one.place for one in force) if isinstance(force, tuple) else (force,)


def _locate_rows(
    omega: Any,
    damping: Any,
    force: Any,
    absorbers: list[Any],
    response: Any,
    mass: float,
    stress: Any,
    base: Any = None,
    at_absorber: float = 1.0,
    forces: Any = None,
) -> ModalModel:
    """Return the model of shapes (N_m,) at the places.

    If there are several places for absorbers, a single absorber is at the first one, and several
    absorbers are at the places that they name.

    ``force`` has a shape for each place of a force, and ``forces`` their amplitudes and phases
    where there are several. ``base`` (N_m,) and ``at_absorber`` as in `ModalModel`.
    """
    several = None if len(absorbers) == 1 else np.array(absorbers)
    model = ModalModel(
        omega, damping, force[0], absorbers[0], mass, several, response, stress, base, at_absorber
    )
    if isinstance(forces, tuple):
        model = apply_forces(model, forces, np.array(force))
    return _signed(model)


def _combine_strains(parts: StrainParts | None, shape: Callable[[Any], Any]) -> Any:
    """Return the strain per modal displacement (N_m,), or None for no parts.

    It is the sum over the parts of their weights times their ``shape`` (N_m,).
    """
    return None if parts is None else np.sum([weight * shape(of) for weight, of in parts], axis=0)


def _modes_of_universal(
    folder: Path,
    *,
    file: str,
    load_case: int | None = None,
    modes: int | None = None,
    **_places: Any,
) -> tuple[Path, list[MeasuredMode], int | None]:
    """Return the file, its modes, and the number of modes to keep (None: all)."""
    path = folder / file
    result = read_modes(path, None if load_case is None else count("load_case", load_case, 0))
    return path, result, modes


def _read_universal(folder: Path, **values: Any) -> ModalModel:
    path, result, _ = _modes_of_universal(folder, **values)
    used = {
        name: part.node
        for name in ("force", "absorber", "response", "stress")
        for part in _as_list(values.get(name))
    }
    require_global_directions(path, used)
    return _read_modes_table(result, path, **values)


def _as_list(places: Any) -> list[_NodeDirection]:
    """Return the places of a key as a list; the key has one place, several, or weighted ones."""
    if places is None:
        return []
    if isinstance(places, tuple):
        return list(_force_places(places))
    parts = places if isinstance(places, list) else [places]
    return [part[1] if isinstance(part, tuple) else part for part in parts]


def _read_modes_table(
    result: list[MeasuredMode],
    path: Path,
    *,
    force: Any,
    absorber: list[_NodeDirection],
    mass: float,
    response: _NodeDirection | None = None,
    modes: int | None = None,
    damping_ratio: Any = None,
    stress: StrainParts | None = None,
    base_participation: list[float] | None = None,
    base_at_absorber: float = ModalModel.base_at_absorber,
    **_file: Any,
) -> ModalModel:
    """Return the model of the modes of a file.

    It has the lowest ``modes`` modes, with their shapes at the places.
    """
    selected = result if modes is None else result[: count("modes", modes, 1, len(result))]
    measured = [mode.damping_ratio for mode in selected]
    ratios = choose_damping_ratios(
        damping_ratio, None if None in measured else measured, len(selected)
    )

    def shape(name: str, place: _NodeDirection) -> Any:
        return select_shapes(selected, path, name, (place.node, place.direction))

    places = [shape("absorber", place) for place in absorber]
    read = None if response is None else shape("response", response)
    strain = _combine_strains(stress, lambda place: shape("stress", place))
    base = None if base_participation is None else np.array(base_participation)
    require(
        base is None or len(base) == len(selected),
        "base_participation",
        base_participation,
        f"a number for each of the {len(selected)} modes",
    )
    omega = [m.omega for m in selected]
    return _locate_rows(
        omega,
        ratios,
        [shape("force", place) for place in _force_places(force)],
        places,
        read,
        mass,
        strain,
        base,
        base_at_absorber,
        force,
    )


MODE_KEYS: Keys = {
    "file": ("file", TEXT_CODEC),
    "force": ("force", _place_or_forces(PLACE_CODEC)),
    "absorber": ("absorber", _one_or_list(PLACE_CODEC)),
    "response": ("response", PLACE_CODEC),
    "mass_kg": ("mass", NUMBER_CODEC),
    "modes": ("modes", WHOLE_CODEC),
    "damping_ratio": ("damping_ratio", DAMPING_RATIO_CODEC),
    "stress": ("stress", _one_or_list(STRAIN_CODEC)),
    "base_participation_sqrt_kg": ("base_participation", ROW_CODEC),
    "base_at_absorber": ("base_at_absorber", NUMBER_CODEC),
}


def _modes_of_nastran(
    folder: Path,
    *,
    file: str,
    units: str,
    bdf: str | None = None,
    subcase: int | None = None,
    modes: int | None = None,
    **_places: Any,
) -> tuple[Path, list[MeasuredMode], int | None]:
    path = folder / file
    case = None if subcase is None else count("subcase", subcase, 0)
    result = nastran.read_modes(
        path, None if bdf is None else folder / bdf, read_units(units), case
    )
    return path, result, modes


def _read_nastran(folder: Path, **values: Any) -> ModalModel:
    path, result, _ = _modes_of_nastran(folder, **values)
    return _read_modes_table(result, path, **values)


def _modes_of_ansys(
    folder: Path, *, file: str, units: str, modes: int | None = None, **_places: Any
) -> tuple[Path, list[MeasuredMode], int | None]:
    path = folder / file
    return path, ansys.read_modes(path, read_units(units), units), modes


def _read_ansys(folder: Path, **values: Any) -> ModalModel:
    path, result, _ = _modes_of_ansys(folder, **values)
    return _read_modes_table(result, path, **values)


RESULT_KEYS: Keys = {**MODE_KEYS, "units": ("units", TEXT_CODEC)}
NASTRAN_KEYS: Keys = {
    **RESULT_KEYS,
    "bdf": ("bdf", TEXT_CODEC),
    "subcase": ("subcase", WHOLE_CODEC),
}
# keys without a default, which the functions above pass on
NEEDED_OF_MODES = ("file", "force", "absorber", "mass_kg")
NEEDED_OF_RESULTS = (*NEEDED_OF_MODES, "units")
UNIVERSAL_KEYS: Keys = {**MODE_KEYS, "load_case": ("load_case", WHOLE_CODEC)}


MATRIX_KEYS: Keys = {
    "mass": ("mass", TEXT_CODEC),
    "stiffness": ("stiffness", TEXT_CODEC),
    "damping": ("damping", TEXT_CODEC),
    "units": ("units", TEXT_CODEC),
    "force": ("force", _place_or_forces(ROW_OR_PLACE_CODEC)),
    "absorber": ("absorber", _one_or_list(ROW_OR_PLACE_CODEC)),
    "response": ("response", ROW_OR_PLACE_CODEC),
    "mass_kg": ("structure_mass", NUMBER_CODEC),
    "modes": ("modes", WHOLE_CODEC),
    "damping_ratio": ("damping_ratio", DAMPING_RATIO_CODEC),
    "suspension_frequency_hz": ("suspension_frequency", NUMBER_CODEC),
    "stress": ("stress", _one_or_list(ROW_OR_PLACE_STRAIN_CODEC)),
    "base_vector": ("base_vector", VECTOR_CODEC),
    "coordinates": ("coordinates", TEXT_CODEC),
}


NEEDED_OF_MATRICES = ("mass", "stiffness", "units", "force", "absorber", "mass_kg")


@dataclass(frozen=True, eq=False)
class _Solved:
    """Modes of matrices, with the data from which they were computed.

    ``omega`` (N_m,) in rad/s, and ``shapes`` (rows, N_m) in 1/sqrt(kg).
    """

    omega: Any
    shapes: Any
    modes: StructureModes
    inertia: Any
    stiffness: MatrixFile
    damping: Any
    units: ConsistentUnits


def _solve_matrices(
    folder: Path,
    *,
    mass: str,
    stiffness: str,
    units: str,
    damping: str | None = None,
    modes: int = MODES,
    suspension_frequency: float | None = None,
    coordinates: str | None = None,
    **_places: Any,
) -> _Solved:
    system = read_units(units)
    matrices = _read_matrices(folder, {"mass": mass, "stiffness": stiffness, "damping": damping})
    inertia = check_matrix("mass", matrices["mass"].matrix)
    size = inertia.shape[0]
    elastic = check_matrix("stiffness", matrices["stiffness"].matrix, size)
    resistance = (
        None if damping is None else check_matrix("damping", matrices["damping"].matrix, size)
    )
    if coordinates is not None:
        read_coordinates(folder / coordinates, size)
    suspension = None
    if suspension_frequency is not None:  # in the unit of time of the matrices
        suspension = positive("suspension_frequency", suspension_frequency) * system.time
    solution = lowest_modes(inertia, elastic, count("modes", modes, 1), suspension)
    omega = solution.omega / system.time
    shapes = solution.shapes / np.sqrt(system.mass)
    return _Solved(omega, shapes, solution, inertia, matrices["stiffness"], resistance, system)


def _build_from_matrices(
    folder: Path,
    *,
    force: Any,
    absorber: list[Any],
    structure_mass: float,
    response: Any = None,
    damping_ratio: Any = None,
    stress: StrainParts | None = None,
    base_vector: Any = None,
    **files: Any,
) -> ModalModel:
    structure_mass = positive("mass_kg", structure_mass)
    require(
        files.get("damping") is None or damping_ratio is None,
        "damping_ratio",
        damping_ratio,
        "left out beside a damping matrix",
    )
    solved = _solve_matrices(folder, **files)
    inertia = solved.inertia
    size = inertia.shape[0]

    def find(name: str, place: Any) -> tuple[int, float]:
        return _find_row(solved.stiffness, name, place, size)

    places = [find("absorber", place) for place in absorber]
    forced = [find("force", place) for place in _force_places(force)]
    read = None if response is None else find("response", response)
    rows = {"force": forced[0][0], "absorber": places[0][0]} | (
        {} if read is None else {"response": read[0]}
    )
    for line in list_matrix_warnings(inertia.diagonal() * solved.units.mass, structure_mass, rows):
        warnings.warn(line, StructureWarning, stacklevel=2)
    result = None
    if solved.damping is not None:
        result = proportional_damping(solved.damping, solved.modes, inertia.diagonal() == 0)
    ratios = choose_damping_ratios(damping_ratio, result, len(solved.omega))

    def shape(place: tuple[int, float]) -> Any:
        return place[1] * solved.shapes[place[0]]

    strain = _combine_strains(stress, lambda place: shape(find("stress's row", place)))
    base = None
    moved = [ModalModel.base_at_absorber]
    if base_vector is not None:
        rigid = _base_vector(folder, base_vector, size)
        moved = [sign * float(rigid[k]) for k, sign in places]
        allowed = "the same displacement at all places for absorbers"
        require(len(set(moved)) == 1, "base_vector", moved, allowed)
        base = np.sqrt(solved.units.mass) * (solved.modes.shapes.T @ (inertia @ rigid))
    return _locate_rows(
        solved.omega,
        ratios,
        [shape(place) for place in forced],
        [shape(place) for place in places],
        None if read is None else shape(read),
        structure_mass,
        strain,
        base,
        moved[0],
        force,
    )


def _read_matrices(folder: Path, names: Mapping[str, str | None]) -> dict[str, MatrixFile]:
    """Return the matrices of files over the freedoms of the stiffness matrix.

    Freedoms that a boundary condition fixes have empty rows.
    """
    letters = {"mass": "M", "stiffness": "K", "damping": "C"}
    result = {
        key: read_matrix(folder / file, key, letters[key])
        for key, file in names.items()
        if file is not None
    }
    held = result["stiffness"].held
    return {
        key: without_freedoms(with_freedoms(key, part, result["stiffness"].freedoms), held)
        for key, part in result.items()
    }


def _find_row(file: MatrixFile, name: str, place: Any, size: int) -> tuple[int, float]:
    """Return the row of the matrices at a place, counted from 0, and the sign of its direction."""
    if not isinstance(place, _NodeDirection):
        return count(name, place, 0, size - 1), 1.0
    require(
        file.freedoms is not None,
        name,
        f"node {place.node}",
        "a row of the matrices, counted from 0: their file names no nodes",
    )
    assert file.freedoms is not None
    axis = 1 + FREEDOMS.index(place.direction.lstrip("+-"))
    nodes = sorted({node for node, _ in file.freedoms})
    some = ", ".join(map(str, nodes[:12])) + (" ..." if len(nodes) > 12 else "")
    require(
        (place.node, axis) in file.freedoms,
        name,
        f"node {place.node}, {place.direction}",
        f"a freedom of the stiffness matrix; its nodes: {some}",
    )
    sign = -1.0 if place.direction.startswith("-") else 1.0
    return file.freedoms.index((place.node, axis)), sign


def _base_vector(folder: Path, entries: Any, size: int) -> Any:
    """Return the rigid displacement (size,) for a unit motion of the base.

    ``entries``: a list, or a text file with one number in each row.
    """
    allowed = f"a list or a file with {size} finite numbers, one for each row of the matrices"
    if isinstance(entries, str):
        require_readable("base_vector", folder / entries, allowed)
        try:
            entries = np.loadtxt(folder / entries, ndmin=1).tolist()
        except (OSError, ValueError) as error:
            raise describe_error("base_vector", entries, f"{allowed} ({error})") from error
    result = row("base_vector", entries, allowed)
    require(len(result) == size, "base_vector", f"{len(result)} numbers", allowed)
    return result


def read_structure_nodes(folder: Path, plain: Mapping[str, Any]) -> tuple[Any, Any] | None:
    """Return numbers (N,) and coordinates (N, 3) in m of a structure's nodes.

    They are those in the file of a structure's plain form. The result is None for a structure
    without nodes.
    """
    if "universal" in plain:
        return universal.read_nodes(folder / plain["universal"]["file"])
    if "nastran" in plain:
        table = plain["nastran"]
        bdf = None if "bdf" not in table else folder / table["bdf"]
        return nastran.read_nodes(folder / table["file"], bdf, read_units(table["units"]))
    if "ansys" in plain:
        table = plain["ansys"]
        units = read_units(table["units"])
        return ansys.read_nodes(folder / table["file"], units, table["units"])
    return None


@dataclass(frozen=True, eq=False)
class NodalShapes:
    """Modes of a file at all its places.

    ``omega`` (N_m,) in rad/s, and ``shapes`` (N_m, n) in 1/sqrt(kg).

    ``freedoms``: node and freedom, 1 to 6, of each place, or the row of the matrices and 0.
    """

    omega: Any
    freedoms: tuple[tuple[int, int], ...]
    shapes: Any


def read_structure_shapes(folder: Path, plain: Mapping[str, Any]) -> NodalShapes:
    """Return the modes of a structure's plain form at all places of its file.

    Raises ParameterError for a structure without a file.
    """
    kinds = {
        "universal": (_modes_of_universal, UNIVERSAL_KEYS),
        "nastran": (_modes_of_nastran, NASTRAN_KEYS),
        "ansys": (_modes_of_ansys, RESULT_KEYS),
    }
    for kind, (read, keys) in kinds.items():
        if kind in plain:
            _path, result, limit = dataclass_codec(partial(read, folder), keys).read(
                kind, plain[kind]
            )
            selected = result if limit is None else result[: count("modes", limit, 1, len(result))]
            nodes = sorted({int(node) for mode in selected for node in mode.nodes})
            freedoms = tuple((node, axis) for node in nodes for axis in (1, 2, 3))
            rows = {node: k for k, node in enumerate(nodes)}
            shapes = np.zeros((len(selected), len(nodes), 3))
            for k, mode in enumerate(selected):
                shapes[k, [rows[int(node)] for node in mode.nodes]] = mode.shape
            omega = np.array([mode.omega for mode in selected])
            return NodalShapes(omega, freedoms, shapes.reshape(len(selected), -1))
    require(
        "matrices" in plain,
        "structure",
        list(plain),
        "a file with nodes: one of the tables universal, nastran, ansys, matrices",
    )
    result = dataclass_codec(partial(_solve_matrices, folder), MATRIX_KEYS).read(
        "matrices", plain["matrices"]
    )
    own = result.stiffness.freedoms
    freedoms = own or tuple((k, 0) for k in range(len(result.shapes)))
    return NodalShapes(result.omega, freedoms, result.shapes.T)


def _ring_codec_for(folder: Path) -> Codec:
    """Return the codec of a bladed disk that is read as the modes of its ring.

    The modes are under the ring's force. `impact_env.plain.to_disk` reads it as a disk.
    """
    return Codec(
        lambda path, plain: disk_codec_for(folder).read(path, plain).model, MODEL_CODEC.write
    )


# places in the tables of structures: how they are read, of those whose table has one for the force
PLACE_CODECS = {
    "universal": PLACE_CODEC,
    "matrices": ROW_OR_PLACE_CODEC,
    "nastran": PLACE_CODEC,
    "ansys": PLACE_CODEC,
}


# kinds of structure -> the form of their table, for the folder in which the files lie that it names
STRUCTURES: dict[str, Callable[[Path], Codec]] = {
    "beam": lambda _: BEAM_CODEC,
    "model": model_codec_for,
    "universal": lambda folder: dataclass_codec(
        partial(_read_universal, folder), UNIVERSAL_KEYS, NEEDED_OF_MODES
    ),
    "matrices": lambda folder: dataclass_codec(
        partial(_build_from_matrices, folder), MATRIX_KEYS, NEEDED_OF_MATRICES
    ),
    "nastran": lambda folder: dataclass_codec(
        partial(_read_nastran, folder), NASTRAN_KEYS, NEEDED_OF_RESULTS
    ),
    "ansys": lambda folder: dataclass_codec(
        partial(_read_ansys, folder), RESULT_KEYS, NEEDED_OF_RESULTS
    ),
    "cyclic": _ring_codec_for,
}
