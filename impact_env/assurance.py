"""The modal assurance criterion: how alike the mode shapes of two files are."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import require, row
from impact_env.plain_files import read_plain
from impact_env.plain_structures import NodalShapes, read_structure_shapes

Real = NDArray[np.float64]

FREEDOM_COLUMNS = ("row", "x", "y", "z", "rx", "ry", "rz")


def modal_assurance(first: ArrayLike, second: ArrayLike) -> Real:
    """Return the modal assurance criterion of two sets of real mode shapes.

    Parameters
    ----------
    first, second : array_like
        Shapes (N_a, n) and (N_b, n) at the same n places and directions, in any scale.

    Returns
    -------
    array
        (N_a, N_b), (a^T b)^2 / (a^T a b^T b): 1 for shapes that are alike but for a factor, 0 for
        orthogonal ones and for a shape of zeros.

    Raises
    ------
    ParameterError
        Unless both are arrays of finite numbers with rows of one length.

    Examples
    --------
    >>> modal_assurance([[1.0, 2.0], [1.0, -1.0]], [[2.0, 4.0]]).round(2)
    array([[1. ],
           [0.1]])

    """
    a = row("first", first, "an array of finite numbers, a row for each mode", axes=2)
    b = row("second", second, "an array of finite numbers, a row for each mode", axes=2)
    require(a.shape[1] == b.shape[1], "second", b.shape, f"rows of {a.shape[1]} numbers, as first")
    lengths = np.outer(np.sum(a * a, axis=1), np.sum(b * b, axis=1))
    products = (a @ b.T) ** 2
    return np.asarray(np.divide(products, lengths, out=np.zeros_like(products), where=lengths > 0))


@dataclass(frozen=True, eq=False)
class ModeComparison:
    """The modes of two structures, compared by the modal assurance criterion.

    ``first`` (N_a,) and ``second`` (N_b,) are the frequencies in Hz, ``assurance`` (N_a, N_b) is
    the criterion, and ``places`` is the number of nodal directions compared.
    """

    first: Real
    second: Real
    assurance: Real
    places: int


def compare_modes(first: Path | str, second: Path | str) -> ModeComparison:
    """Return the modal assurance criterion between the modes of two structure files.

    The shapes are compared at the nodes and directions that both files have, and in which both have
    a mode that moves: a test that measured one direction is compared in this one. Structures
    without nodes, beams and modes as numbers, are refused.

    Parameters
    ----------
    first, second : path
        Structure files (docs/scenes.md) with one of the tables universal, nastran, ansys and
        matrices.

    Raises
    ------
    ParameterError
        For a file that cannot be read or has no nodes, and for files without a common place.

    """
    shapes = [_shapes(Path(path)) for path in (first, second)]
    moved = [
        {place for k, place in enumerate(part.freedoms) if np.any(part.shapes[:, k])}
        for part in shapes
    ]
    common = sorted(moved[0] & moved[1])
    some = [
        ", ".join(f"{n} {FREEDOM_COLUMNS[axis]}" for n, axis in sorted(part)[:6]) for part in moved
    ]
    require(
        len(common) > 0,
        "mac",
        str(second),
        f"a structure with nodes and directions of the other: {some[0]}; it has {some[1]}",
    )
    rows = []
    for part in shapes:
        index = {place: k for k, place in enumerate(part.freedoms)}
        rows.append(part.shapes[:, [index[place] for place in common]])
    hertz = [part.omega / (2 * np.pi) for part in shapes]
    return ModeComparison(hertz[0], hertz[1], modal_assurance(rows[0], rows[1]), len(common))


def _shapes(path: Path) -> NodalShapes:
    return read_structure_shapes(path.parent, read_plain(path))
