"""Bladed disks as plain data: the table ``[cyclic]`` of a file.

The sectors are single masses or have matrices. docs/scenes.md lists the keys.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from impact_env.checks import positive, require
from impact_env.plain_files import (
    NUMBER_CODEC,
    ROWS_CODEC,
    WHOLE_CODEC,
    Codec,
    Keys,
    dataclass_codec,
    dataclass_keys,
)
from impact_env.structures.cyclic import (
    DIRECTIONS,
    BladedDisk,
    CyclicStructure,
    Mistuning,
    ring_of_masses,
)
from impact_env.structures.matrices import check_matrix
from impact_env.structures.matrix_files import MatrixFile, read_matrix
from impact_env.structures.modal import TEXT_CODEC, require_text
from impact_env.structures.units import read_units

Array = NDArray[np.float64]
SI_UNITS = "kg, m, s"
COUPLING_FILES = (".npz", ".mtx")
# keys of the two forms of a sector
MASS_FORM = ("coupling", "frequency_hz")
MATRIX_FORM = ("mass", "stiffness", "coupling_stiffness")
OF_MATRICES = (*MATRIX_FORM, "units", "force", "absorber", "response")


def _read_matrix_or_name(path: str, plain: Any) -> Any:
    if isinstance(plain, str):
        return require_text(path, plain)
    return np.array(ROWS_CODEC.read(path, plain))


def _read_sector_list(path: str, plain: Any) -> list[Any]:
    require(isinstance(plain, list | tuple), path, plain, "a list of sectors, counted from 0")
    return list(plain)


MATRIX_OR_NAME_CODEC = Codec(_read_matrix_or_name, ROWS_CODEC.write)
SECTORS_CODEC = Codec(_read_sector_list, list)
MISTUNING_CODEC = dataclass_codec(Mistuning, dataclass_keys(Mistuning))
CYCLIC_KEYS: Keys = {
    "sectors": ("sectors", WHOLE_CODEC),
    "coupling": ("coupling", NUMBER_CODEC),
    "frequency_hz": ("frequency", NUMBER_CODEC),
    "mass_kg": ("sector_mass", NUMBER_CODEC),
    "damping_ratio": ("damping_ratio", NUMBER_CODEC),
    "mass": ("mass", MATRIX_OR_NAME_CODEC),
    "stiffness": ("stiffness", MATRIX_OR_NAME_CODEC),
    "coupling_stiffness": ("coupling_stiffness", MATRIX_OR_NAME_CODEC),
    "units": ("units", TEXT_CODEC),
    "force": ("force", WHOLE_CODEC),
    "absorber": ("absorber", WHOLE_CODEC),
    "response": ("response", WHOLE_CODEC),
    "engine_order": ("engine_order", WHOLE_CODEC),
    "direction": ("direction", TEXT_CODEC),
    "amplitude_n": ("amplitude", NUMBER_CODEC),
    "mistuning": ("mistuning", MISTUNING_CODEC),
    "absorber_sectors": ("absorber_sectors", SECTORS_CODEC),
    "modes": ("modes", WHOLE_CODEC),
}


def _require_one_form(path: str, plain: Mapping[str, Any]) -> None:
    """Raise ParameterError unless the keys are those of one of the two forms of a sector.

    The forms are single masses and matrices.
    """
    form = MATRIX_FORM if any(key in plain for key in MATRIX_FORM) else MASS_FORM
    if form is MATRIX_FORM:
        for key in MASS_FORM:
            allowed = f"left out of a sector with matrices ({', '.join(MATRIX_FORM)})"
            require(key not in plain, f"{path}.{key}", plain.get(key), allowed)
    else:
        for key in OF_MATRICES:
            allowed = f"left out of a sector of one mass ({', '.join(MASS_FORM)}, mass_kg)"
            require(key not in plain, f"{path}.{key}", plain.get(key), allowed)
    for key in form:
        require(key in plain, f"{path}.{key}", None, "given: it has no default")


def _read_array(folder: Path, name: str, entry: Any, letter: str) -> Array:
    """Return a matrix (d, d), given as rows or as the name of a file."""
    if not isinstance(entry, str):
        return np.asarray(entry, dtype=float)
    path = folder / entry
    if name == "coupling_stiffness":
        allowed = f"a file that ends in {' or '.join(COUPLING_FILES)}, or rows of numbers"
        require(path.suffix.lower() in COUPLING_FILES, name, entry, allowed)
    file: MatrixFile = read_matrix(path, name, letter)
    require(
        not file.held,
        name,
        f"a matrix with held degrees of freedom, as in row {file.held[0] if file.held else None}",
        "a sector without them: leave their rows and columns out",
    )
    matrix = file.matrix.toarray() if scipy.sparse.issparse(file.matrix) else file.matrix
    require(matrix.dtype.kind in "iuf", name, f"type {matrix.dtype}", "real numbers")
    return np.asarray(matrix, dtype=float)


def _ring_from_matrices(
    folder: Path,
    sectors: int,
    sector_mass: float | None,
    *,
    mass: Any,
    stiffness: Any,
    coupling_stiffness: Any,
    units: str = SI_UNITS,
    **more: Any,
) -> CyclicStructure:
    system = read_units(units)
    inertia = check_matrix("mass", _read_array(folder, "mass", mass, "M"))
    size = len(inertia)
    elastic = check_matrix("stiffness", _read_array(folder, "stiffness", stiffness, "K"), size)
    block = _read_array(folder, "coupling_stiffness", coupling_stiffness, "coupling")
    require(
        block.shape == (size, size) and bool(np.all(np.isfinite(block))),
        "coupling_stiffness",
        f"a matrix of shape {block.shape}",
        f"{size} rows of {size} finite numbers, as the mass matrix",
    )
    newton_per_metre = system.mass / system.time**2
    return CyclicStructure(
        sectors,
        system.mass * inertia,
        newton_per_metre * elastic,
        newton_per_metre * block,
        sector_mass=sector_mass,
        **more,
    )


def _build_disk(
    folder: Path,
    *,
    sectors: int,
    sector_mass: float | None = None,
    coupling: float | None = None,
    frequency: float | None = None,
    mass: Any = None,
    damping_ratio: float = CyclicStructure.damping_ratio,
    mistuning: Mistuning | None = None,
    engine_order: int = 0,
    direction: str = DIRECTIONS[0],
    amplitude: float | None = None,
    absorber_sectors: list[Any] | None = None,
    modes: int | None = None,
    **matrices: Any,
) -> BladedDisk:
    """Return the disk of a table, without absorbers."""
    drawn = Mistuning() if mistuning is None else mistuning
    if mass is None:
        require(sector_mass is not None, "sector_mass", None, "given, in kg: it has no default")
        assert coupling is not None
        assert frequency is not None
        assert sector_mass is not None
        kilograms = positive("sector_mass", sector_mass)
        ring = ring_of_masses(sectors, coupling, frequency, damping_ratio, kilograms, drawn)
    else:
        matrices |= {"mass": mass, "damping_ratio": damping_ratio, "mistuning": drawn}
        ring = _ring_from_matrices(folder, sectors, sector_mass, **matrices)
    return BladedDisk(
        ring,
        engine_order,
        direction,
        amplitude,
        absorber_sectors=absorber_sectors,  # type: ignore[arg-type]  # checked there
        modes=modes,
    )


def disk_codec_for(folder: Path) -> Codec:
    """Return the codec of a bladed disk without absorbers.

    ``folder`` is that of the files that the disk's table names. A disk is written with its
    matrices, so that it is read back bit for bit.
    """
    read_keys = dataclass_codec(partial(_build_disk, folder), CYCLIC_KEYS, ("sectors",)).read

    def read(path: str, plain: Any) -> BladedDisk:
        if isinstance(plain, Mapping) and set(plain) <= set(CYCLIC_KEYS):
            _require_one_form(path, plain)
        disk = read_keys(path, plain)
        assert isinstance(disk, BladedDisk)
        return disk

    return Codec(read, _write_disk)


def _write_disk(disk: BladedDisk) -> dict[str, Any]:
    ring = disk.ring
    matrices = {
        "mass": ring.mass,
        "stiffness": ring.stiffness,
        "coupling_stiffness": ring.coupling,
    }
    places = {name: getattr(ring, name) for name in ("force", "absorber", "response")}
    options = {"amplitude_n": disk.amplitude, "modes": disk.modes}
    return {
        "sectors": ring.sectors,
        **{name: np.asarray(matrix, dtype=float).tolist() for name, matrix in matrices.items()},
        **places,
        "mass_kg": float(ring.sector_mass or 0.0),
        "damping_ratio": float(ring.damping_ratio),
        "engine_order": disk.engine_order,
        "direction": disk.direction,
        "mistuning": MISTUNING_CODEC.write(ring.mistuning),
        "absorber_sectors": list(disk.absorber_sectors),
        **{name: value for name, value in options.items() if value is not None},
    }
