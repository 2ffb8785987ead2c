"""Mass, stiffness and damping matrices to a modal model: the lowest modes by the inverse problem, dense or sparse; and their files.

Matrices are read from NumPy's and SciPy's .npz and from Matrix Market, columns of numbers from .csv.
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import scipy
import scipy.sparse.linalg
from numpy.typing import NDArray

from impact_env.parameters import ParameterError, positive, require, suspended


def _npz(path: Path, letter: str) -> Any:
    """Return a sparse matrix that SciPy saved, or the array that is named after the matrix, or the only one."""
    with np.load(path, allow_pickle=False) as archive:
        names = list(archive.files)
        if {"indptr", "format"} <= set(names):
            return scipy.sparse.load_npz(path)
        if letter not in names and len(names) != 1:
            raise ValueError(f"it has {', '.join(names) or 'nothing'}, and no {letter}")
        return archive[letter if letter in names else names[0]]


READERS: dict[str, Callable[[Path, str], Any]] = {
    ".npz": _npz,
    ".mtx": lambda path, _: scipy.io.mmread(path),
}


def read_matrix(path: Path, name: str, letter: str) -> Any:
    """Return a matrix from a file, dense or sparse; of several arrays in a .npz that called ``letter``, one of M, K, C.

    Raises ParameterError with the matrix's ``name`` if the file cannot be read.
    """
    require(
        path.suffix.lower() in READERS,
        name,
        str(path),
        f"a file that ends in {' or '.join(READERS)}",
    )
    try:
        return READERS[path.suffix.lower()](path, letter)
    except (OSError, ValueError, KeyError, BadZipFile, EOFError, TypeError) as error:
        raise ParameterError(
            f"{name} = {str(path)!r} is not allowed: a matrix that can be read ({error})"
        ) from error


def read_columns(path: Path, name: str) -> dict[str, list[float]]:
    """Return the columns of a CSV file with a line of names, commas between, by name; raises ParameterError, which names file and line."""
    allowed = "a .csv file: a line of names, then a line of numbers for each mode, commas between"
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [
                [cell.strip() for cell in line]
                for line in csv.reader(file)
                if any(cell.strip() for cell in line)
            ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(
            f"{name} = {str(path)!r} is not allowed: {allowed} ({error})"
        ) from error
    require(len(lines) > 1 and len(set(lines[0])) == len(lines[0]), name, str(path), allowed)
    rows = []
    for number, line in enumerate(lines[1:], 1):
        try:
            rows.append([float(cell) for cell in line])
        except ValueError as error:
            raise ParameterError(
                f"{name} = {str(path)!r}, mode {number} is not allowed: {allowed} ({error})"
            ) from error
        require(
            len(line) == len(lines[0]),
            name,
            f"{path}, mode {number}: {len(line)} numbers",
            f"{len(lines[0])}, one a column",
        )
    return {
        key: list(column) for key, column in zip(lines[0], zip(*rows, strict=True), strict=True)
    }


Real = NDArray[np.float64]

DENSE = 1200  # freedoms up to which all modes are computed, by a dense solver
SHIFT = 1e-10  # of the usual ratio of stiffness to mass: makes the stiffness of a free structure regular
ASYMMETRY = 1e-8  # of a matrix's largest entry
NOISE = 1e3  # times the rounding of the stiffness energy: squares of frequencies below that are taken as 0
COUPLING = 1e-6  # of the modal damping: what a damping matrix may have beside its diagonal
RIGID = (
    "a structure that is held. {number} motions bend nothing. Either hold it, or give suspension_frequency_hz, far below the first bending mode: "
    "these motions then are the first modes, on soft springs, as in a test; they cannot be left out, since they carry the absorber too"
)


@dataclass(frozen=True, eq=False)
class Modes:
    """Lowest modes: ``omega`` (N_m,) in rad/s, rising, mass-normalised ``shapes`` (freedoms, N_m); ``rigid``: how many are rigid-body motions."""

    omega: Real
    shapes: Real
    rigid: int


def checked(name: str, matrix: Any, size: int | None = None) -> Any:
    """Return a real symmetric matrix, dense or sparse (CSC); raises ParameterError for all else, and where it is not ``size`` by ``size``."""
    found = matrix.tocsc() if scipy.sparse.issparse(matrix) else np.asarray(matrix)
    shape = f"a matrix of shape {found.shape} and type {found.dtype}"
    square = found.ndim == 2 and found.shape[0] == found.shape[1] > 0
    require(
        square and size in (None, found.shape[0]),
        name,
        shape,
        "a square matrix" if size is None else f"{size} by {size}, as the mass matrix",
    )
    values = found.data if scipy.sparse.issparse(found) else found
    real = np.issubdtype(found.dtype, np.number) and not np.iscomplexobj(values)
    require(
        real and bool(np.all(np.isfinite(values))),
        name,
        shape,
        "finite real numbers in all entries",
    )
    found = found.astype(np.float64)
    largest = float(abs(found).max())
    require(largest > 0, name, "a matrix of zeros", "entries other than 0")
    difference = float(abs(found - found.T).max())
    require(
        difference <= ASYMMETRY * largest,
        name,
        f"a matrix with entries {difference / largest:.1e} from symmetry",
        "a symmetric matrix",
    )
    return (found + found.T) / 2


def lowest_modes(
    mass: Any, stiffness: Any, modes: int, suspension_frequency: float | None = None
) -> Modes:
    """Return the lowest ``modes`` modes of a structure without damping.

    The inverse problem M v = (1/omega^2) K v is solved: its largest eigenvalues are the modes that matter, and a mass matrix may have freedoms
    without mass. A structure with rigid-body motions is solved as K + s M with a small s; these motions get the ``suspension_frequency`` in Hz.
    Raises ParameterError for matrices that have no such modes, and for rigid-body motions without a suspension.
    """
    size = mass.shape[0]
    require(modes <= size, "modes", modes, f"at most the {size} freedoms of the matrices")
    omega, shapes = _eigen(mass, stiffness, min(modes, size))
    noise = (
        NOISE
        * np.finfo(float).eps
        * np.einsum("ij,ij->j", abs(shapes), abs(stiffness) @ abs(shapes))
    )
    require(
        bool(np.all(omega > -noise)),
        "stiffness",
        f"a matrix with the square frequency {omega[0]:.3g}",
        "none below 0: positive semidefinite",
    )
    rigid = int(np.sum(omega <= noise))
    if rigid == 0:
        require(
            suspension_frequency is None,
            "suspension_frequency",
            suspension_frequency,
            "left out: the structure is held",
        )
        return Modes(np.sqrt(omega), shapes, 0)
    require(
        suspension_frequency is not None,
        "stiffness",
        "a singular matrix",
        RIGID.format(number=rigid),
    )
    require(rigid < modes, "modes", modes, f"more than the {rigid} rigid-body motions")
    own = (
        2
        * np.pi
        * np.array(suspended(positive("suspension_frequency", suspension_frequency), rigid))
    )
    allowed = (
        f"below half of the first bending frequency, {np.sqrt(omega[rigid]) / (2 * np.pi):.6g} Hz"
    )
    require(
        bool(4 * own[-1] ** 2 < omega[rigid]), "suspension_frequency", suspension_frequency, allowed
    )
    return Modes(np.concatenate([own, np.sqrt(omega[rigid:])]), shapes, rigid)


def _eigen(mass: Any, stiffness: Any, modes: int) -> tuple[Real, Real]:
    """Return squares of frequencies, rising, and mass-normalised shapes; the squares of rigid-body motions are 0 within rounding."""
    diagonal = stiffness.diagonal(), mass.diagonal()
    require(
        bool(np.all(diagonal[1] >= 0)),
        "mass",
        "a matrix with a negative mass",
        "positive semidefinite",
    )
    shift = (
        SHIFT * float(np.median(diagonal[0][diagonal[1] > 0] / diagonal[1][diagonal[1] > 0]))
        if np.any(diagonal[1] > 0)
        else 0.0
    )
    if mass.shape[0] > DENSE and modes < mass.shape[0] // 4:
        values, vectors = _sparse(mass, stiffness, modes, shift)
    else:
        full = [m.toarray() if scipy.sparse.issparse(m) else m for m in (mass, stiffness)]
        values, vectors = _dense(full[0], full[1], modes, shift)
    norms = np.einsum("ij,ij->j", vectors, mass @ vectors)
    require(
        bool(np.all(norms > 0)),
        "mass",
        "a matrix without mass in one of the lowest modes",
        "positive semidefinite, with mass in all modes kept",
    )
    order = np.argsort(values)
    vectors = (vectors / np.sqrt(norms))[:, order]
    return _sharper(values[order], vectors, stiffness), vectors


def _sharper(squares: Real, shapes: Real, stiffness: Any) -> Real:
    """Return each square from Rayleigh's quotient where that has more digits than the inverse problem, whose error grows with the frequency.

    The quotient squares the error of the shape, but the entries of the stiffness of a fine mesh cancel in the low modes.
    """
    terms = np.einsum("ij,ij->j", abs(shapes), abs(stiffness) @ abs(shapes))
    with np.errstate(divide="ignore", invalid="ignore"):
        better = terms / squares < squares / squares[0]
    return np.asarray(
        np.where(
            better & (squares[0] > 0), np.einsum("ij,ij->j", shapes, stiffness @ shapes), squares
        )
    )


def _dense(mass: Real, stiffness: Real, modes: int, shift: float) -> tuple[Real, Real]:
    for s in (0.0, shift):  # the unshifted problem has the most digits
        try:
            inverse, vectors = scipy.linalg.eigh(
                mass, stiffness + s * mass, subset_by_index=[len(mass) - modes, len(mass) - 1]
            )
        except np.linalg.LinAlgError:
            continue
        if np.all(inverse > 0) and (s > 0 or inverse[-1] * shift < 1):
            return 1 / inverse - s, vectors
    raise ParameterError(
        "stiffness = 'a matrix that is indefinite' is not allowed: positive semidefinite, and regular together with the mass"
    )


def _sparse(mass: Any, stiffness: Any, modes: int, shift: float) -> tuple[Real, Real]:
    start = np.random.default_rng(0).standard_normal(
        mass.shape[0]
    )  # the solver's own start differs from call to call
    try:
        values, vectors = scipy.sparse.linalg.eigsh(
            scipy.sparse.csc_matrix(stiffness),
            modes,
            scipy.sparse.csc_matrix(mass),
            sigma=-shift,
            which="LM",
            v0=start,
            tol=0,
        )
    except (RuntimeError, scipy.sparse.linalg.ArpackError) as error:
        raise ParameterError(
            f"stiffness = 'a sparse matrix' is not allowed: one whose lowest modes can be computed ({error})"
        ) from error
    return values, vectors


def proportional_damping(damping: Any, modes: Modes) -> Real:
    """Return the damping ratios (N_m,) that a damping matrix stands for; raises ParameterError unless it leaves the modes uncoupled.

    Rigid-body motions that it does not damp have the ratio 0.
    """
    projected = modes.shapes.T @ (damping @ modes.shapes)
    own = np.diag(projected)
    scale = np.sqrt(np.maximum(np.outer(own, own), 0)) + COUPLING * np.max(np.abs(own))
    coupling = np.abs(projected - np.diag(own)) / np.maximum(scale, np.finfo(float).tiny)
    i, j = np.unravel_index(int(np.argmax(coupling)), coupling.shape)
    allowed = (
        "modal or proportional damping (C = a M + b K, or any that keeps the modes apart): the simulation works with real modes. Give damping_ratio "
        "instead, one for each mode, as measured or as a complex eigenvalue analysis finds it"
    )
    what = f"a matrix that couples the modes {min(i, j) + 1} and {max(i, j) + 1} by {coupling[i, j]:.2g} of their own damping"
    require(float(coupling[i, j]) <= COUPLING, "damping", what, allowed)
    ok = bool(np.all(own >= -COUPLING * np.max(np.abs(own))))
    what = f"a matrix that feeds mode {int(np.argmin(own)) + 1}"
    require(ok, "damping", what, "no negative damping")
    return np.asarray(np.maximum(own, 0.0) / (2 * modes.omega))
