"""Modal model from mass, stiffness and damping matrices.

The lowest modes are solved by the inverse problem, dense or sparse.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
import scipy.sparse.linalg
from numpy.typing import NDArray

from impact_env.checks import describe_error, positive, require
from impact_env.parameters import suspension_frequencies

Real = NDArray[np.float64]

DENSE = 1200  # freedoms up to which all modes are computed, by a dense solver
# of the usual ratio of stiffness to mass: makes the stiffness of a free structure regular
SPECTRAL_SHIFT = 1e-10
SYMMETRY_TOL = 1e-8  # of the root of the product of the two diagonal entries: rounding in an export
# a positive semidefinite matrix has no entry above the root of that product; exports have 5 digits
# or more
DIAGONAL_TOL = 1e-4
LARGEST_ENTRY = 1e60  # products of a few entries are still numbers
PIVOT_TOL = (
    1e-14  # of a factor's pivot over the matrix's diagonal entry: below it the matrix is singular
)
# times the rounding of the stiffness energy: squares of frequencies below that are taken as 0
NOISE_FACTOR = 1e3
COUPLING = 1e-6  # of the modal damping: what a damping matrix may have beside its diagonal
ALLOWED_RIGID = (
    "a structure that is held. {number} motions bend nothing. Either hold it, or give "
    "suspension_frequency_hz, far below the first bending mode: "
    "these motions then are the first modes, on soft springs, as in a test; they cannot be "
    "left out, since they carry the absorber too"
)


@dataclass(frozen=True, eq=False)
class StructureModes:
    """Lowest modes of a structure.

    Attributes
    ----------
    omega : array, (N_m,)
        Frequencies in rad/s, ascending.
    shapes : array, (freedoms, N_m)
        Mass-normalised mode shapes.
    rigid : int
        Number of rigid-body motions among them.
    """

    omega: Real
    shapes: Real
    rigid: int


def check_matrix(name: str, matrix: Any, size: int | None = None) -> Any:
    """Return a real symmetric matrix, dense or sparse (CSC).

    Raises ParameterError for any other value, and for a matrix that is not ``size`` by ``size``.
    """
    result = matrix.tocsc() if scipy.sparse.issparse(matrix) else np.asarray(matrix)
    shape = f"a matrix of shape {result.shape} and type {result.dtype}"
    square = result.ndim == 2 and result.shape[0] == result.shape[1] > 0
    require(
        square and size in (None, result.shape[0]),
        name,
        shape,
        "a square matrix" if size is None else f"{size} by {size}, as the mass matrix",
    )
    finite = "finite real numbers in all entries"
    require(result.dtype.kind in "iuf", name, shape, finite)
    rows, columns, values = _entries(result)
    for i in np.flatnonzero(~np.isfinite(values))[:1]:
        place = f"a matrix with {values[i]} in row {rows[i]}, column {columns[i]}"
        require(False, name, place, f"{finite} (rows and columns are counted from 0)")
    result = result.astype(np.float64)
    largest = float(abs(result).max())
    require(largest > 0, name, "a matrix of zeros", "entries other than 0")
    require(
        1 / LARGEST_ENTRY < largest < LARGEST_ENTRY,
        name,
        f"a matrix with the largest entry {largest:.3g}",
        f"a largest entry from {1 / LARGEST_ENTRY:g} to {LARGEST_ENTRY:g}",
    )
    row, column, difference = _entries(result - result.T)
    diagonal = np.abs(result.diagonal())
    usual = np.sqrt(diagonal[row] * diagonal[column])
    allowed = SYMMETRY_TOL * usual + 4 * np.finfo(float).eps * largest
    wrong = np.flatnonzero(np.abs(difference) > allowed)
    if len(wrong):
        i = int(row[wrong[0]])
        j = int(column[wrong[0]])
        require(
            False,
            name,
            (
                f"a matrix with {result[i, j]:.6g} in row {i}, column {j}, and {result[j, i]:.6g} "
                f"in row {j}, column {i}"
            ),
            "a symmetric matrix, both triangles given (rows and columns are counted from 0)",
        )
    return (result + result.T) / 2


def _entries(matrix: Any) -> tuple[NDArray[np.int64], NDArray[np.int64], Real]:
    """Return rows, columns and values of the entries that are not zero."""
    result = scipy.sparse.coo_matrix(matrix)
    return result.row, result.col, result.data


def _require_semidefinite(name: str, matrix: Any) -> None:
    """Raise ParameterError for entries that no positive semidefinite matrix has.

    A matrix that passes may still be indefinite.
    """
    diagonal = matrix.diagonal()
    allowed = "a positive semidefinite matrix"
    least = int(np.argmin(diagonal))
    what = f"a matrix with {diagonal[least]:.6g} on its diagonal, in row {least} (from 0)"
    require(bool(diagonal[least] >= 0), name, what, allowed)
    row, column, value = _entries(matrix)
    wrong = value**2 > (1 + DIAGONAL_TOL) * diagonal[row] * diagonal[column]
    if np.any(wrong):
        i = int(row[wrong][0])
        j = int(column[wrong][0])
        what = (
            f"a matrix with {value[wrong][0]:.6g} in row {i}, column {j} (from 0), more than the "
            f"diagonal entries {diagonal[i]:.6g} and {diagonal[j]:.6g} allow"
        )
        require(False, name, what, allowed)


def lowest_modes(
    mass: Any, stiffness: Any, modes: int, suspension_frequency: float | None = None
) -> StructureModes:
    """Return the lowest ``modes`` modes of a structure without damping.

    The number of modes is at most the rank of the mass matrix. The inverse problem M v =
    (1/omega^2) K v is solved, whose largest eigenvalues belong to the lowest modes. Freedoms
    without mass are eliminated exactly (static condensation); freedoms with neither mass nor
    stiffness do not move. A structure with rigid-body motions is solved as K + s M with a small s;
    these motions get the ``suspension_frequency`` in Hz. Raises ParameterError for matrices that
    have no such modes, and for rigid-body motions without a suspension.
    """
    _require_semidefinite("mass", mass)
    _require_semidefinite("stiffness", stiffness)
    omega, shapes = _eigen(mass, stiffness, modes)
    noise = (
        NOISE_FACTOR
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
        return StructureModes(np.sqrt(omega), shapes, 0)
    require(
        suspension_frequency is not None,
        "stiffness",
        "a singular matrix",
        ALLOWED_RIGID.format(number=rigid),
    )
    require(rigid < len(omega), "modes", modes, f"more than the {rigid} rigid-body motions")
    own = (
        2
        * np.pi
        * np.array(
            suspension_frequencies(positive("suspension_frequency", suspension_frequency), rigid)
        )
    )
    allowed = (
        f"below half of the first bending frequency, {np.sqrt(omega[rigid]) / (2 * np.pi):.6g} Hz"
    )
    require(
        bool(4 * own[-1] ** 2 < omega[rigid]), "suspension_frequency", suspension_frequency, allowed
    )
    return StructureModes(np.concatenate([own, np.sqrt(omega[rigid:])]), shapes, rigid)


def _eigen(mass: Any, stiffness: Any, modes: int) -> tuple[Real, Real]:
    """Return squares of frequencies, ascending, and mass-normalised shapes.

    The squares of rigid-body motions are 0 within rounding.
    """
    diagonal = stiffness.diagonal(), mass.diagonal()
    inertial = np.flatnonzero(diagonal[1] > 0)
    massless = np.flatnonzero((diagonal[1] <= 0) & (diagonal[0] > 0))
    modes = min(modes, len(inertial))
    ratios = diagonal[0][inertial] / diagonal[1][inertial]
    shift = SPECTRAL_SHIFT * float(np.median(ratios))
    freedoms = np.union1d(inertial, massless)
    vectors = np.zeros((mass.shape[0], modes))
    if len(freedoms) > DENSE and modes < len(inertial) // 4:
        squares, result = _sparse(
            _part(mass, freedoms, freedoms), _part(stiffness, freedoms, freedoms), modes, shift
        )
        vectors[freedoms] = result
    else:
        condensed, follow = _condense_massless(stiffness, inertial, massless)
        squares, result = _dense(_dense_part(mass, inertial, inertial), condensed, modes, shift)
        vectors = vectors[:, : len(squares)]
        vectors[inertial] = result
        vectors[massless] = follow @ result
    norms = np.einsum("ij,ij->j", vectors, mass @ vectors)
    order = np.argsort(squares)
    vectors = (vectors / np.sqrt(norms))[:, order]
    return _refine_squares(squares[order], vectors, stiffness), vectors


def _part(matrix: Any, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Any:
    if scipy.sparse.issparse(matrix):
        return matrix[rows][:, columns]
    return matrix[np.ix_(rows, columns)]


def _dense_part(matrix: Any, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Real:
    part = _part(matrix, rows, columns)
    return np.asarray(part.toarray() if scipy.sparse.issparse(part) else part)


def _condense_massless(
    stiffness: Any, inertial: NDArray[np.int64], massless: NDArray[np.int64]
) -> tuple[Real, Real]:
    """Return the stiffness of the freedoms with mass, and the motion of the others.

    The motion of the freedoms without mass is per unit motion of those with mass.
    """
    own = _dense_part(stiffness, inertial, inertial)
    if len(massless) == 0:
        return own, np.zeros((0, len(inertial)))
    link = _dense_part(stiffness, massless, inertial)
    if scipy.sparse.issparse(stiffness):
        held = _symmetric_factor(scipy.sparse.csc_matrix(_part(stiffness, massless, massless)))
        follow = -held.solve(link)
        condensed = own + link.T @ follow
        return (condensed + condensed.T) / 2, follow
    held = _dense_part(stiffness, massless, massless)
    # scaled to a unit diagonal, so that a pivot shows how far the matrix is from singular in any
    # units
    scale = 1 / np.sqrt(np.diag(held))
    try:
        factor = scipy.linalg.cholesky(scale[:, None] * held * scale, lower=True)
    except np.linalg.LinAlgError:
        factor = np.zeros((1, 1))
    if np.min(np.diag(factor)) ** 2 < PIVOT_TOL:
        _refuse_mechanism(len(massless))
    follow = -scale[:, None] * scipy.linalg.cho_solve((factor, True), scale[:, None] * link)
    condensed = own + link.T @ follow
    return (condensed + condensed.T) / 2, follow


def _refuse_mechanism(number: int) -> None:
    raise describe_error(
        "stiffness",
        f"a matrix with {number} freedoms without mass, which it does not hold",
        "positive definite on the freedoms without mass, so that they follow the others",
    )


def _refine_squares(squares: Real, shapes: Real, stiffness: Any) -> Real:
    """Return each square refined by Rayleigh's quotient.

    The quotient replaces the square if it has more digits than the inverse problem, whose error
    grows with the frequency.

    The quotient squares the error of the shape, but the entries of the stiffness of a fine mesh
    cancel in the low modes.
    """
    terms = np.einsum("ij,ij->j", abs(shapes), abs(stiffness) @ abs(shapes))
    with np.errstate(divide="ignore", invalid="ignore"):
        better = terms / squares < squares / squares[0]
    return np.asarray(
        np.where(
            better & (squares[0] > 0), np.einsum("ij,ij->j", shapes, stiffness @ shapes), squares
        )
    )


INDEFINITE = "positive semidefinite, and regular together with the mass"


def _dense(mass: Real, stiffness: Real, modes: int, shift: float) -> tuple[Real, Real]:
    least = float(scipy.linalg.eigvalsh(mass, subset_by_index=[0, 0])[0])
    require(
        bool(least >= -NOISE_FACTOR * np.finfo(float).eps * np.max(np.diag(mass))),
        "mass",
        f"a matrix with the eigenvalue {least:.3g}",
        "none below 0: positive semidefinite",
    )
    for s in (0.0, shift):  # the unshifted problem has the most digits
        try:
            inverse, vectors = scipy.linalg.eigh(
                mass, stiffness + s * mass, subset_by_index=[len(mass) - modes, len(mass) - 1]
            )
        except np.linalg.LinAlgError:
            continue
        if inverse[-1] > 0 and (s > 0 or inverse[-1] * shift < 1):
            # a combination of freedoms may be without mass too: its frequency is infinite
            finite = inverse > NOISE_FACTOR * np.finfo(float).eps * inverse[-1]
            return 1 / inverse[finite] - s, vectors[:, finite]
    raise describe_error("stiffness", "a matrix that is indefinite", INDEFINITE)


def _sparse(mass: Any, stiffness: Any, modes: int, shift: float) -> tuple[Real, Real]:
    start = np.random.default_rng(0).standard_normal(
        mass.shape[0]
    )  # the solver's own start differs from call to call
    mass = scipy.sparse.csc_matrix(mass)
    shifted = scipy.sparse.csc_matrix(stiffness + shift * mass)
    try:
        factor = _symmetric_factor(shifted)
        values, vectors = scipy.sparse.linalg.eigsh(
            scipy.sparse.csc_matrix(stiffness),
            modes,
            mass,
            sigma=-shift,
            which="LM",
            v0=start,
            tol=0,
            OPinv=scipy.sparse.linalg.LinearOperator(shifted.shape, factor.solve),
        )
    except (RuntimeError, scipy.sparse.linalg.ArpackError) as error:
        allowed = f"one whose lowest modes can be computed ({error})"
        raise describe_error("stiffness", "a sparse matrix", allowed) from error
    # one step of the inverse iteration: freedoms without mass follow the others exactly
    return values, factor.solve(mass @ vectors) * (values + shift)


def _symmetric_factor(matrix: Any) -> Any:
    """Return the factors of a positive definite sparse matrix.

    Raises ParameterError if the pivots show that the matrix is indefinite or singular.
    """
    singular = "a singular sparse matrix"
    allowed = "regular together with the mass, and on the freedoms without mass"
    try:
        factor = scipy.sparse.linalg.splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise describe_error("stiffness", singular, allowed) from error
    if np.array_equal(factor.perm_r, factor.perm_c):
        order = np.argsort(factor.perm_c)
        pivots = factor.U.diagonal() / matrix.diagonal()[order]
        if np.any(pivots < -PIVOT_TOL):
            raise describe_error("stiffness", "a matrix that is indefinite", INDEFINITE)
        if np.any(pivots < PIVOT_TOL):
            raise describe_error("stiffness", singular, allowed)
    return factor


def proportional_damping(damping: Any, modes: StructureModes, massless: NDArray[np.bool_]) -> Real:
    """Return the damping ratios (N_m,) that correspond to a damping matrix.

    Rigid-body motions without damping have the ratio 0. Freedoms without mass, ``massless``
    (freedoms,), are eliminated statically; this is exact only if no damping force acts on them in
    any mode, as with C = a M + b K. Raises ParameterError otherwise, or if the matrix couples the
    modes.
    """
    forces = damping @ modes.shapes
    largest = abs(damping) @ abs(modes.shapes)
    free = np.abs(forces) <= COUPLING * np.max(largest, axis=0)
    require(
        bool(np.all(free[massless])),
        "damping",
        "a matrix that damps freedoms without mass",
        "modal or proportional damping, as C = a M + b K, or a mass at these freedoms",
    )
    projected = modes.shapes.T @ forces
    own = np.diag(projected)
    scale = np.sqrt(np.maximum(np.outer(own, own), 0)) + COUPLING * np.max(np.abs(own))
    coupling = np.abs(projected - np.diag(own)) / np.maximum(scale, np.finfo(float).tiny)
    i, j = np.unravel_index(int(np.argmax(coupling)), coupling.shape)
    allowed = (
        "modal or proportional damping (C = a M + b K, or any that keeps the modes apart): "
        "the simulation works with real modes. Give damping_ratio "
        "instead, one for each mode, as measured or as a complex eigenvalue analysis finds it"
    )
    what = (
        f"a matrix that couples the modes {min(i, j) + 1} and {max(i, j) + 1} by "
        f"{coupling[i, j]:.2g} of their own damping"
    )
    require(float(coupling[i, j]) <= COUPLING, "damping", what, allowed)
    ok = bool(np.all(own >= -COUPLING * np.max(np.abs(own))))
    what = f"a matrix that feeds mode {int(np.argmin(own)) + 1}"
    require(ok, "damping", what, "no negative damping")
    return np.asarray(np.maximum(own, 0.0) / (2 * modes.omega))
