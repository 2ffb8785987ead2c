"""Mass, stiffness and damping matrices from files.

The formats are those of NumPy, SciPy, Matrix Market, Abaqus and CalculiX.

Every reader checks that the file is complete and returns a square matrix of real numbers, dense or
sparse, with the node and direction of each row where the file names them.
"""

import csv
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from impact_env.checks import describe_error, require
from impact_env.extras import MissingExtraError
from impact_env.plain_files import decode_text, require_readable
from impact_env.structures.ansys import read_full

# Abaqus writes this on the diagonal of a freedom that a boundary condition holds
ABAQUS_FIXED_MARK = 1e36
NODE_AXES = ("x", "y", "z")  # of the freedoms 1, 2, 3 of a node; 4, 5, 6 are rotations about them
FREEDOM_NAMES = (*NODE_AXES, *(f"r{axis}" for axis in NODE_AXES))
WHOLE_LIMIT = 2.0**53  # whole numbers up to here are exact as floating point numbers

Freedoms = tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class MatrixFile:
    """A matrix of a file with the freedoms of its rows.

    Attributes
    ----------
    matrix : array or sparse matrix, (N, N)
        The matrix.
    freedoms : tuple of (int, int), (N,), or None
        Node and freedom (1 to 6) of each row, None if the file does not contain them.
    held : tuple of int
        Rows of freedoms that a boundary condition fixes.
    """

    matrix: Any
    freedoms: Freedoms | None = None
    held: tuple[int, ...] = ()


def _read_npz(path: Path, letter: str) -> MatrixFile:
    """Return a sparse matrix that SciPy saved, or an array of the file.

    It is the array with the name of the matrix, or the only array.
    """
    with zipfile.ZipFile(path) as archive:
        damaged = archive.testzip()
    if damaged is not None:
        raise ValueError(f"the member {damaged} is damaged")
    with np.load(path, allow_pickle=False) as arrays:
        names = list(arrays.files)
        if "format" in names:
            return MatrixFile(scipy.sparse.load_npz(path))
        if letter not in names and (len(names) != 1 or names[0] in ("M", "K", "C")):
            raise ValueError(f"it has {', '.join(names) or 'nothing'}, and no {letter}")
        name = letter if letter in names else names[0]
        try:
            return MatrixFile(arrays[name])
        except ValueError as error:
            if "Object arrays" not in str(error):
                raise
            raise ValueError(
                f"{name} is an array of Python objects; write a sparse matrix by "
                "scipy.sparse.save_npz"
            ) from error


def _require_newline(lines: list[str]) -> None:
    if not lines or not lines[-1].endswith("\n"):
        raise ValueError("the file ends within a line or is empty")


def _number(cell: str) -> float:
    """Return a number that may have a Fortran exponent; raises ValueError unless it is finite."""
    value = float(cell.replace("D", "E").replace("d", "e"))
    if not np.isfinite(value):
        raise ValueError(f"{cell} is not finite")
    return value


def _rows(lines: list[str], columns: int) -> NDArray[np.float64]:
    """Return the numbers of lines (entries, columns); raises ValueError that names the line."""
    result = []
    for number, line in enumerate(lines, 1):
        cells = line.replace(",", " ").split()
        if not cells or cells[0].startswith("*"):
            continue
        try:
            values = [_number(cell) for cell in cells]
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from error
        if len(values) != columns:
            raise ValueError(f"line {number}: {len(values)} numbers; {columns} in the lines before")
        result.append(values)
    return np.array(result).reshape(-1, columns)


def _symmetric(
    rows: NDArray[np.int64], columns: NDArray[np.int64], values: Any, size: int
) -> scipy.sparse.csc_matrix:
    """Return the matrix of entries that are one triangle, or all, of a symmetric matrix."""
    if len(np.unique(rows * size + columns)) != len(rows):
        raise ValueError("an entry is listed twice")
    # either half of the entries, in whatever order of the rows, or all of them
    off = rows != columns
    mirrored = np.isin(rows[off] * size + columns[off], columns[off] * size + rows[off])
    if not np.any(mirrored):
        rows, columns, values = (
            np.concatenate([rows, columns[off]]),
            np.concatenate([columns, rows[off]]),
            np.concatenate([values, values[off]]),
        )
    return scipy.sparse.csc_matrix((values, (rows, columns)), shape=(size, size))


def _whole(values: NDArray[np.float64], least: int, what: str) -> NDArray[np.int64]:
    ok = (values == np.round(values)) & (np.abs(values) < WHOLE_LIMIT) & (values >= least)
    if not np.all(ok):
        raise ValueError(f"{values[~ok][0]:g} is no {what}, a whole number from {least}")
    return values.astype(np.int64)


def _triplets(lines: list[str]) -> scipy.sparse.csc_matrix:
    """Return the matrix of lines with row, column (from 1) and value."""
    entries = _rows(lines, 3)
    if len(entries) == 0:
        raise ValueError("it has no entries")
    index = _whole(entries[:, :2], 1, "number of a row or column")
    return _symmetric(index[:, 0] - 1, index[:, 1] - 1, entries[:, 2], int(index.max()))


def _labelled(lines: list[str]) -> MatrixFile:
    """Return the matrix of lines with node, freedom, node, freedom and value.

    Its rows are in ascending order of node and freedom.
    """
    entries = _rows(lines, 5)
    if len(entries) == 0:
        raise ValueError("it has no entries")
    if np.any(entries[:, [0, 2]] <= 0):
        raise ValueError(
            "it has nodes below 1, which Abaqus adds for constraints by Lagrange multipliers"
        )
    labels = _whole(entries[:, :4], 1, "node or freedom")
    pairs = np.concatenate([labels[:, :2], labels[:, 2:]])
    result, rows = np.unique(pairs, axis=0, return_inverse=True)
    rows = rows.reshape(2, -1)
    matrix = _symmetric(rows[0], rows[1], entries[:, 4], len(result))
    return MatrixFile(matrix, tuple((int(node), int(axis)) for node, axis in result))


def _read_mtx(path: Path, _letter: str) -> MatrixFile:
    """Return a matrix in the Matrix Market format, or in one of the text formats of Abaqus."""
    with path.open(encoding="utf-8") as file:
        first = file.readline()
    if first.lower().startswith("%%matrixmarket"):
        return MatrixFile(_matrix_market(path, first.lower().split()))
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    _require_newline(lines)
    data = [line for line in lines if line.strip() and not line.startswith("*")]
    columns = len(data[0].replace(",", " ").split()) if data else 0
    if columns == 3:
        return _mark_fixed_rows(MatrixFile(_triplets(lines)))
    if columns == 5:
        return _mark_fixed_rows(_labelled(lines))
    raise ValueError(
        "no %%MatrixMarket header, and no lines of Abaqus with 3 numbers (COORDINATE) or 5 "
        "(MATRIX INPUT)"
    )


def _mark_fixed_rows(file: MatrixFile) -> MatrixFile:
    """Return a matrix of Abaqus with the rows that have its mark of a boundary condition."""
    rows = np.flatnonzero(file.matrix.diagonal() >= ABAQUS_FIXED_MARK / 2)
    return replace(file, held=tuple(map(int, rows)))


def _matrix_market(path: Path, header: list[str]) -> Any:
    if "pattern" in header:
        raise ValueError("it is a pattern: places without numbers")
    result = scipy.io.mmread(path)
    if scipy.sparse.issparse(result):
        pairs = result.row.astype(np.int64) * result.shape[1] + result.col
        if len(np.unique(pairs)) != len(pairs):
            raise ValueError("an entry is listed twice")
    return result


def _read_calculix(path: Path, _letter: str) -> MatrixFile:
    """Return a matrix that CalculiX stored, with the freedoms of the .dof file.

    CalculiX stores it with *FREQUENCY, SOLVER=MATRIXSTORAGE.
    """
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    _require_newline(lines)
    matrix = _triplets(lines)
    labels = path.with_suffix(".dof")
    if not labels.is_file():
        return MatrixFile(matrix)
    freedoms = []
    for number, line in enumerate(labels.read_text(encoding="utf-8").splitlines(), 1):
        node, dot, axis = line.strip().partition(".")
        if not (node.isdigit() and dot and axis in "123456" and len(axis) == 1):
            raise ValueError(f"{labels.name}, line {number}: {line.strip()!r} is no node.freedom")
        freedoms.append((int(node), int(axis)))
    if len(set(freedoms)) != len(freedoms):
        raise ValueError(f"{labels.name}: a freedom is listed twice")
    if matrix.shape[0] > len(freedoms):
        raise ValueError(
            f"{labels.name} has {len(freedoms)} freedoms for the {matrix.shape[0]} rows"
        )
    matrix.resize(len(freedoms), len(freedoms))  # rows without mass at the end have no entries
    return MatrixFile(matrix, tuple(freedoms))


def _read_full(path: Path, letter: str) -> MatrixFile:
    """Return the stiffness or mass of an Ansys file."""
    result, freedoms = read_full(path, letter)
    rows = result.row.astype(np.int64)
    columns = result.col.astype(np.int64)
    return MatrixFile(_symmetric(rows, columns, result.data, result.shape[0]), freedoms)


MATRIX_READERS: dict[str, Callable[[Path, str], MatrixFile]] = {
    ".npz": _read_npz,
    ".mtx": _read_mtx,
    ".sti": _read_calculix,
    ".mas": _read_calculix,
    ".full": _read_full,
}


def read_matrix(path: Path, name: str, letter: str) -> MatrixFile:
    """Return a matrix from a file, dense or sparse.

    If a .npz file has several arrays, it is the array with the name ``letter``, one of M, K, C.

    Raises ParameterError with the matrix's ``name`` if the file cannot be read or is not complete.
    """
    require(
        path.suffix.lower() in MATRIX_READERS,
        name,
        str(path),
        f"a file that ends in {' or '.join(MATRIX_READERS)}",
    )
    try:
        return MATRIX_READERS[path.suffix.lower()](path, letter)
    except MissingExtraError:
        raise
    except Exception as error:  # of damaged files NumPy, SciPy and zipfile raise many kinds
        lines = str(error).strip().splitlines()
        reason = ": ".join([type(error).__name__, *lines[:1]])
        raise describe_error(name, str(path), f"a matrix that can be read ({reason})") from error


def with_freedoms(name: str, file: MatrixFile, freedoms: Freedoms | None) -> MatrixFile:
    """Return a matrix over given freedoms.

    The file may list the freedoms in another order. Freedoms that it does not list have zeros.
    """
    if freedoms == file.freedoms:
        return file
    require(
        freedoms is not None and file.freedoms is not None,
        name,
        f"a matrix {'without' if file.freedoms is None else 'with'} nodes and freedoms",
        "one form for all matrices: with nodes and freedoms, or all without",
    )
    assert freedoms is not None
    assert file.freedoms is not None
    rows = {freedom: row for row, freedom in enumerate(freedoms)}
    missing = [freedom for freedom in file.freedoms if freedom not in rows]
    require(
        not missing,
        name,
        f"a matrix with the freedom {missing[0] if missing else None} (node, freedom)",
        "the freedoms of the stiffness matrix",
    )
    places = np.array([rows[freedom] for freedom in file.freedoms])
    entries = scipy.sparse.coo_matrix(file.matrix)
    size = len(freedoms)
    matrix = scipy.sparse.csc_matrix(
        (entries.data, (places[entries.row], places[entries.col])), shape=(size, size)
    )
    return MatrixFile(matrix, freedoms)


def without_freedoms(file: MatrixFile, held: tuple[int, ...]) -> MatrixFile:
    """Return a matrix with zeros in the rows and columns ``held``."""
    if not held:
        return file
    if max(held) >= file.matrix.shape[0]:
        return file  # of another size, which is refused
    free = np.ones(file.matrix.shape[0])
    free[list(held)] = 0.0
    diagonal = scipy.sparse.diags(free)
    matrix = (diagonal @ scipy.sparse.csc_matrix(file.matrix) @ diagonal).tocsc()
    return replace(file, matrix=matrix)


COORDINATES = ("x_m", "y_m", "z_m")


def read_coordinates(path: Path, size: int | None = None) -> NDArray[np.float64]:
    """Return the coordinates (N, 3) in m of the rows of matrices from a CSV file.

    If ``size`` is given, there must be ``size`` rows.
    """
    columns = read_columns(path, "coordinates")
    names = ", ".join(COORDINATES)
    for axis in COORDINATES:
        require(
            axis in columns,
            "coordinates",
            str(path),
            f"the columns {names}, a line for each row of the matrices; missing {axis}",
        )
    places = np.column_stack([columns[axis] for axis in COORDINATES])
    require(
        size in (None, len(places)),
        "coordinates",
        f"{path}: {len(places)} lines",
        f"{size}, one for each row of the matrices",
    )
    return places


def read_columns(path: Path, name: str) -> dict[str, list[float]]:
    """Return the columns of a CSV file with a line of names, by name.

    Encodings and separators are those of records.

    Raises ParameterError, which names file and line.
    """
    allowed = (
        "a .csv file: a line of names, then a line of numbers for each mode, with commas, "
        "semicolons or tabs between"
    )
    require_readable(name, path)
    text = [line for line in decode_text(path) if line.strip()]
    separator = next((mark for mark in (";", "\t", ",") if text and mark in text[0]), ",")
    try:
        rows_of_cells = list(csv.reader(text, delimiter=separator))
    except csv.Error as error:
        raise describe_error(name, str(path), f"{allowed} ({error})") from error
    lines = [
        [cell.strip() for cell in line]
        for line in rows_of_cells
        if any(cell.strip() for cell in line)
    ]
    if separator != ",":  # the decimal mark may be a comma
        lines = lines[:1] + [[cell.replace(",", ".") for cell in line] for line in lines[1:]]
    require(len(lines) > 1 and len(set(lines[0])) == len(lines[0]), name, str(path), allowed)
    rows = []
    for number, line in enumerate(lines[1:], 1):
        require(
            len(line) == len(lines[0]),
            name,
            f"{path}, mode {number}: {len(line)} numbers",
            f"{len(lines[0])}, one a column",
        )
        try:
            rows.append([_number(cell) for cell in line])
        except ValueError as error:
            raise describe_error(name, f"{path}, mode {number}", f"{allowed} ({error})") from error
    return {
        key: list(column) for key, column in zip(lines[0], zip(*rows, strict=True), strict=True)
    }
