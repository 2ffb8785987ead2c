"""Modes and nodes from a Universal File.

Modes are read from its datasets 55, nodes from datasets 15 and 2411, units from dataset 164, and
coordinate systems from datasets 18 and 2420.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.structures.checks import StructureWarning
from impact_env.structures.universal_file import Dataset, read_datasets

Real = NDArray[np.float64]

# fields of a dataset 55
NORMAL = 2  # kinds of analysis
COMPLEX = (3, 7)
REAL_DATA_TYPE = 2
COMPLEX_DATA_TYPE = 5
VALUES_A_NODE = (3, 6)
STRUCTURAL = (0, 1)  # kinds of model: unknown, structural
VECTORS = {
    0: None,
    2: 3,
    3: 6,
}  # kinds of data (unknown, vector, vector with rotations) and their values at a node
DISPLACEMENT = (0, 1, 8)  # quantities: unknown, general, displacement
MOTION_TYPES = {11: "velocity", 12: "acceleration"}
UNITS_DATASET = 164
COLLINEAR = 0.95  # least modal phase collinearity of a complex shape that is read as a real one
SAME_SHAPE = 1e-3  # relative difference of two listings of one mode, which have six digits
SAME_MODE = 0.95  # modal assurance criterion of two estimates of one mode
NODE_DATASETS = (15, 2411)  # datasets with coordinates
SYSTEMS = (18, 2420)  # datasets with coordinate systems
GLOBAL = (
    0,
    1,
)  # numbers of the global coordinate system, unless a dataset defines them otherwise
IDENTITY_TOL = 1e-9
UNIVERSAL_DIRECTIONS = {"x": "r1", "y": "r2", "z": "r3"}


@dataclass(frozen=True, eq=False)
class MeasuredMode:
    """A mode of a Universal File.

    Attributes
    ----------
    omega : float
        Frequency in rad/s.
    damping_ratio : float or None
        Damping ratio relative to critical damping, None if the file has none.
    nodes : array of int, (nodes,)
        Numbers of the nodes.
    shape : array, (nodes, 3)
        Real, mass-normalised mode shape at the nodes in 1/sqrt(kg).
    normalised_by_mass : bool
        Whether the file has the mode's modal mass, or modal A of a complex mode. If not, the shape
        is taken as mass-normalised.
    number, load_case : int
        Numbers of mode and load case in the file.
    conjugated : bool
        Whether the file lists the mode with the eigenvalue of negative imaginary part.
    """

    omega: float
    damping_ratio: float | None
    nodes: NDArray[np.int64]
    shape: Real
    normalised_by_mass: bool
    number: int = 0  # in the file; 0: not given
    load_case: int = 0
    conjugated: bool = False


def read_modes(path: Path, load_case: int | None = None) -> list[MeasuredMode]:
    """Return the modes of a Universal File by ascending frequency, in SI units.

    If ``load_case`` is given, only its modes are returned. A shape is divided by the square root of
    its modal mass; if no mode has one, shapes are taken as mass-normalised, with a
    StructureWarning. A complex mode and its conjugate count as one mode, as do two listings of a
    mode with equal values. Raises ParameterError for a file that is cut or has no modes, for fields
    with inconsistent values, for modal masses of some modes only, for two different listings of one
    mode, and for shapes that are far from real.
    """
    datasets = read_datasets(path)
    mass_unit = _units(datasets)[1]
    modes = [
        mode
        for part in datasets
        if part.kind == 55
        and (mode := _mode(part, mass_unit)) is not None
        and load_case in (None, mode.load_case)
    ]
    result = ", ".join(str(kind) for kind in sorted({part.kind for part in datasets})) or "none"
    of_case = "" if load_case is None else f" of load case {load_case}"
    require(
        len(modes) > 0,
        "file",
        str(path),
        f"a Universal File with modes{of_case} in datasets 55; it has datasets {result}",
    )
    modes = without_repeats(path, sorted(modes, key=lambda mode: mode.omega))
    by_mass = {mode.normalised_by_mass for mode in modes}
    require(len(by_mass) == 1, "file", str(path), "a modal mass for all modes, or 0 (none) for all")
    if by_mass == {False}:
        warnings.warn(
            f"{path.name}: no modal mass is given; the shapes are taken as mass-normalised",
            StructureWarning,
            stacklevel=2,
        )
    return modes


def _units(datasets: list[Dataset]) -> tuple[float, float]:
    """Return the unit of length in m and the unit of mass in kg from the datasets 164.

    They are 1 without a dataset 164. Raises ParameterError if these datasets differ.
    """
    result = set()
    for part in datasets:
        if part.kind == UNITS_DATASET:
            factors = [part.numbers(1, 3, 25)[k] for k in (0, 1)]  # of a length and a force over SI
            if min(factors) <= 0:
                raise part.refuse(1, "factors above 0 for length and force")
            result.add((1 / factors[0], factors[0] / factors[1]))
    if not result:
        return 1.0, 1.0
    require(
        len(result) == 1,
        "file",
        str(datasets[0].path),
        "one system of units in all datasets 164",
    )
    return result.pop()


def without_repeats(path: Path, modes: list[MeasuredMode]) -> list[MeasuredMode]:
    """Return modes without repeated listings of a mode.

    A listing is dropped if frequency, damping ratio and shape agree with those of an earlier one;
    a StructureWarning reports it, except for a conjugate. Raises ParameterError if a
    mode is listed twice with different values: the same mode number in one load case, or nearly the
    same shape with a close frequency or the same mode number.
    """
    distinct: list[MeasuredMode] = []
    dropped = []
    for mode in modes:
        repeated = False
        for other in distinct:
            distance = abs(mode.omega - other.omega)
            if not np.array_equal(mode.nodes, other.nodes):
                assurance = 1.0 if mode.number and mode.number == other.number else 0.0
            else:  # modal assurance criterion of two shapes of one size
                scale = float(np.sum(mode.shape**2) * np.sum(other.shape**2))
                product = float(np.sum(mode.shape * other.shape))
                assurance = 0.0 if scale == 0 else product**2 / scale
            sign = -1.0 if np.sum(mode.shape * other.shape) < 0 else 1.0
            same = (
                distance <= SAME_SHAPE * other.omega
                and mode.damping_ratio == other.damping_ratio
                and mode.shape.shape == other.shape.shape
                and np.max(np.abs(mode.shape - sign * other.shape))
                <= SAME_SHAPE * np.max(np.abs(other.shape))
            )
            width = (mode.damping_ratio or 0.0) + (other.damping_ratio or 0.0)
            one_number = mode.number == other.number != 0
            close = distance <= max(width, SAME_SHAPE) * other.omega
            if same:
                repeated = True
                break
            require(
                not (assurance > SAME_MODE and (close or one_number))
                and not (one_number and mode.load_case == other.load_case),
                "file",
                (
                    f"{path}, mode {mode.number} of load case {mode.load_case} and mode "
                    f"{other.number} of load case {other.load_case}"
                ),
                (
                    "each mode once: choose one listing by load_case, where the file has some, or "
                    "remove one of them"
                ),
            )
        if not repeated:
            distinct.append(mode)
        elif not (mode.conjugated or other.conjugated):
            dropped.append(mode)
    if dropped:
        numbers = ", ".join(str(mode.number) for mode in dropped)
        warnings.warn(
            f"{path.name}: mode {numbers} is listed again with the same numbers; it counts once",
            StructureWarning,
            stacklevel=2,
        )
    return distinct


def _mode(part: Dataset, mass_unit: float) -> MeasuredMode | None:
    """Return the mode of a dataset 55, its shape in 1/sqrt(kg).

    A conjugate is returned as the mode with positive imaginary part, marked as ``conjugated``. The
    result is None if the dataset has no mode, or values other than displacements. Raises
    ParameterError for fields that cannot be read as a real mode, and for velocities or
    accelerations.
    """
    model, analysis, kind, quantity, data, values = part.whole(5, 6)
    if analysis != NORMAL and analysis not in COMPLEX:
        return None
    if quantity in MOTION_TYPES:
        raise part.refuse(
            5, f"shapes of displacement (8 in the fourth field), not {MOTION_TYPES[quantity]}"
        )
    if quantity not in DISPLACEMENT:
        return None
    if values not in VALUES_A_NODE:
        raise part.refuse(5, "3 or 6 values a node (sixth field): x, y, z, and rotations")
    if kind not in VECTORS or VECTORS[kind] not in (None, values):
        raise part.refuse(
            5,
            "displacements (third field 2 with 3 values a node, or 3 with 6), no scalar or tensor",
        )
    if model not in STRUCTURAL:
        raise part.refuse(5, "modes of a structure (first field 0 or 1)")
    if data not in (REAL_DATA_TYPE, COMPLEX_DATA_TYPE):
        raise part.refuse(5, "real (2) or complex (5) values (fifth field)")
    integers, reals, load_case, number = part.whole(6, 4, 3)
    name = f"{part.path}, mode {number} (line {part.start})"
    needed = 4 if analysis == NORMAL else 6
    if integers < 1 or not 1 <= reals <= 12:
        raise part.refuse(6, "the numbers of whole and of real values that follow")
    header = part.numbers(7, reals)
    header += [0.0] * (needed - len(header))
    nodes, shape = _values(part, 7 + -(-reals // 6), values, data == COMPLEX_DATA_TYPE)
    mass = 0.0
    conjugated = False
    damping: float | None
    if analysis == NORMAL:
        omega = 2 * np.pi * header[0]
        mass = header[1]
        damping = _damping(name, header[2], header[3])
    else:
        value = complex(header[0], header[1])
        modal_a = complex(header[2], header[3])
        require(
            value.imag != 0 and value.real <= 0,
            "file",
            f"{name}, eigenvalue {value:.6g}",
            (
                "a mode that oscillates and does not grow: an imaginary part other than 0, a real "
                "part of 0 or below"
            ),
        )
        conjugated = value.imag < 0
        if conjugated:
            # the same motion as its conjugate, which `without_repeats` finds where both are listed
            value = value.conjugate()
            modal_a = modal_a.conjugate()
            shape = shape.conjugate()
        omega = abs(value)
        damping = -value.real / abs(value)
        require(
            modal_a != 0,
            "file",
            f"{name}, modal A 0",
            "complex modes with their modal A, which scales them",
        )
        # the residue of a mass-normalised real mode is 1/(2 i omega_d): modal A becomes 2 i omega_d
        shape = np.asarray(shape * np.sqrt(2j * value.imag / modal_a))
    if np.iscomplexobj(shape):
        shape = _real(name, shape)
    require(
        omega > 0,
        "file",
        name,
        "a frequency above 0: a rigid-body motion needs that of its suspension",
    )
    require(mass >= 0, "file", f"{name}, modal mass {mass}", "a modal mass of 0 (none) or above")
    shape = shape / np.sqrt((mass or 1.0) * mass_unit)
    by_mass = mass > 0 or analysis != NORMAL
    return MeasuredMode(omega, damping, nodes, shape, by_mass, number, load_case, conjugated)


def _damping(name: str, viscous: float, hysteretic: float) -> float | None:
    """Return the damping ratio of a normal mode.

    It is the ``viscous`` ratio, or half of the ``hysteretic`` loss factor. It is None if both are 0
    (not given), or, with a StructureWarning, if they disagree. Raises ParameterError for negative
    values.
    """
    for value in (viscous, hysteretic):
        require(value >= 0, "file", f"{name}, damping {value:g}", "damping of 0 (none) or above")
    if viscous and hysteretic and abs(hysteretic - 2 * viscous) > 0.01 * hysteretic:
        warnings.warn(
            (
                f"{name}: viscous damping {viscous:g} and hysteretic damping {hysteretic:g} "
                "disagree (a loss factor is twice the ratio); neither is used"
            ),
            StructureWarning,
            stacklevel=2,
        )
        return None
    return viscous or hysteretic / 2 or None


def _values(
    part: Dataset, line: int, number: int, complex_data: bool
) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Return node numbers (N,) and the displacements in x, y and z (N, 3), real or complex.

    They are read from index ``line`` of a dataset 55 to its end; ``number``: values at a node.
    """
    wanted = number * (2 if complex_data else 1)
    lines_a_node = -(-wanted // 6)
    nodes = []
    rows = []
    while line < len(part.lines):
        if not part.lines[line].strip() and not any(text.strip() for text in part.lines[line:]):
            break
        nodes.append(part.whole(line, 1)[0])
        row = part.numbers(line + 1, wanted)
        rows.append(row)
        line += 1 + lines_a_node
    if not nodes:
        raise part.refuse(line, "values at one node or more")
    require(len(set(nodes)) == len(nodes), "file", part.name(), "each node once in a dataset 55")
    table = np.array(rows)
    result = table[:, 0::2] + 1j * table[:, 1::2] if complex_data else table
    return np.array(nodes, dtype=np.int64), result[:, :3]


def _real(name: str, shape: NDArray[np.complex128]) -> Real:
    """Return the real part of a complex shape after the rotation that makes it largest.

    Raises ParameterError if the modal phase collinearity is below `COLLINEAR`.
    """
    turn = np.sum(shape**2)
    collinear = float(abs(turn)) / max(float(np.sum(np.abs(shape) ** 2)), np.finfo(float).tiny)
    allowed = f"{COLLINEAR} or above: the simulation works with real modes, so fit normal modes"
    require(collinear >= COLLINEAR, "file", f"{name}, phase collinearity {collinear:.3f}", allowed)
    return np.asarray(np.real(shape * np.exp(-0.5j * np.angle(turn))))


def select_shapes(modes: list[MeasuredMode], path: Path, name: str, place: tuple[int, str]) -> Real:
    """Return the modes' shapes (N_m,) at a node in a direction, in 1/sqrt(kg).

    ``place``: number of the node, and x, y or z with or without a sign. A mode without the node has
    the value 0 there, because the format allows zeros to be left out. Raises ParameterError, with
    ``name`` in its message, if no mode has the node.
    """
    node, direction = place
    sign, axis = (
        (-1.0, direction[1:]) if direction.startswith("-") else (1.0, direction.removeprefix("+"))
    )
    column = list(UNIVERSAL_DIRECTIONS).index(axis)
    every = np.unique(np.concatenate([mode.nodes for mode in modes]))
    nodes = ", ".join(str(n) for n in every[:12]) + (" ..." if len(every) > 12 else "")
    require(node in every, name, node, f"a node of {path.name}: {nodes}")
    values = []
    for mode in modes:
        where = np.flatnonzero(mode.nodes == node)
        values.append(sign * mode.shape[where[0], column] if len(where) else 0.0)
    return np.array(values)


def _global_systems(datasets: list[Dataset], rows: int) -> set[int]:
    """Return the numbers of the coordinate systems that are equal to the global one.

    ``rows``: 3 to compare directions, 4 to compare the origin too. Systems of dataset 18 always
    count as local.
    """
    result = set(GLOBAL)
    for part in datasets:
        if part.kind == 2420:
            for line in range(2, len(part.lines), 6):
                if not part.lines[line].strip():
                    continue
                label, kind = part.whole(line, 2)
                matrix = np.array([part.numbers(line + 2 + k, 3, 25) for k in range(4)])
                difference = np.abs(matrix - np.eye(4, 3))[:rows]
                same = kind == 0 and np.max(difference) < IDENTITY_TOL
                result = result | {label} if same else result - {label}
        elif (
            part.kind == 18
        ):  # all systems of the older dataset count as local: their form has many variants
            result -= {part.whole(line, 1)[0] for line in range(0, len(part.lines), 4)}
    return result


def _nodes(datasets: list[Dataset]) -> dict[int, tuple[int, int, list[float]]]:
    """Return a dict of the nodes in datasets 15 and 2411, by their numbers.

    Each has the number of the coordinate system of its coordinates, that of its displacements, and
    the three coordinates in the file's unit. Raises ParameterError for two different nodes with one
    number.
    """
    result: dict[int, tuple[int, int, list[float]]] = {}
    for part in datasets:
        if part.kind not in NODE_DATASETS:
            continue
        lines = [k for k, text in enumerate(part.lines) if text.strip()]
        for line in lines if part.kind == 15 else lines[::2]:
            if part.kind == 15:
                label, definition, displacement, _ = part.whole(line, 4)
                point = _point_15(part, line)
            else:
                label, definition, displacement, _ = part.whole(line, 4, 3)
                point = part.numbers(line + 1, 3, 25)
            node = (definition, displacement, point)
            if result.setdefault(label, node) != node:
                raise part.refuse(line, f"node {label} once, or each time with the same numbers")
    return result


def _point_15(part: Dataset, line: int) -> list[float]:
    """Return the three coordinates in a line of a dataset 15, in the file's unit.

    The line has four integers in 40 columns before them.
    """
    text = part.lines[line].rstrip()
    cells = text.split()[4:]
    if len(cells) != 3:
        cells = [text[k : k + 13].strip() for k in range(40, len(text), 13)]
    try:
        point = [float(cell.replace("D", "E").replace("d", "e")) for cell in cells]
    except ValueError:
        point = []
    if len(point) != 3 or not np.all(np.isfinite(point)):
        raise part.refuse(line, "four whole numbers and three coordinates")
    return point


def require_global_directions(path: Path, places: dict[str, int]) -> None:
    """Raise ParameterError if a node in use has displacements in a local coordinate system.

    ``places``: node numbers by names for the message. A node that the file does not define counts
    as global.
    """
    datasets = read_datasets(path)
    systems = _global_systems(datasets, 3)
    nodes = _nodes(datasets)
    for name, node in places.items():
        system = nodes[node][1] if node in nodes else 0
        require(
            system in systems,
            name,
            f"node {node} with displacements in the coordinate system {system}",
            (
                f"nodes of {path.name} with displacements in the global coordinate system: export "
                "the modes in it"
            ),
        )


def read_nodes(path: Path) -> tuple[NDArray[np.int64], Real]:
    """Return numbers (N,) and coordinates (N, 3) in m of a Universal File's nodes.

    They come from its datasets 15 and 2411. Raises ParameterError if it has none, or if a node has
    coordinates in a local coordinate system.
    """
    datasets = read_datasets(path)
    nodes = _nodes(datasets)
    require(
        len(nodes) > 0,
        "file",
        str(path),
        "a Universal File with the coordinates of its nodes, in datasets 15 or 2411",
    )
    systems = _global_systems(datasets, 4)
    local = [label for label, node in nodes.items() if node[0] not in systems]
    require(
        not local,
        "file",
        f"{path}, node {local[0] if local else 0}",
        "coordinates in the global coordinate system",
    )
    unit = _units(datasets)[0]
    return np.array(list(nodes), dtype=np.int64), unit * np.array(
        [point for _, _, point in nodes.values()]
    )
