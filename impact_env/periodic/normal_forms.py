"""Normal forms of maps at a multiplier on the unit circle.

Their coefficients determine on which side of a bifurcation the new orbits lie.

The coefficients are those of Kuznetsov, Elements of Applied Bifurcation Theory (2004), sections 5.4
and 9.7: of a fold b = <p, B(q, q)>/2, of a doubled period (or, of a map over half a period, of
broken symmetry) and of a torus the cubic coefficient on the centre manifold. A is the map's
derivative at its fixed point, B and C its second and third derivatives, q and p the right and left
eigenvectors with <p, q> = 1 and |q| = 1 in the norm of the forms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Vector = Array | Complex
SUPERCRITICAL = "supercritical"  # what is born is stable where the orbit left is not
SUBCRITICAL = "subcritical"


def euclidean(vector: Vector) -> float:
    """Return the length of a vector, real or complex."""
    return float(np.linalg.norm(vector))


@dataclass(frozen=True, eq=False)
class MapForms:
    """Derivatives of a map of R^n at its fixed point.

    ``matrix`` is A (n, n); ``second(u, v)`` returns B(u, v) (n,) and ``third(u, v, w)`` returns
    C(u, v, w) (n,) of vectors (n,) that may be complex. ``norm(u)`` is the norm in which critical
    vectors have the length 1.
    """

    matrix: Array
    second: Callable[[Vector, Vector], Vector]
    third: Callable[[Vector, Vector, Vector], Vector]
    norm: Callable[[Vector], float] = euclidean


@dataclass(frozen=True, eq=False)
class CriticalVectors:
    """Critical eigenvectors of a map.

    Attributes
    ----------
    right : array, (n,)
        Unit right eigenvector q.
    left : array, (n,)
        Left eigenvector p with <p, q> = 1.
    angle : float
        det(U V) <u, v> with the singular value decomposition U S V^T of A - mu I, and the unit
        vectors u and v of its smallest singular value. It is real for a real multiplier,
        continuous, and zero where the multiplier is double.
    """

    right: Vector
    left: Vector
    angle: float


def find_critical_vectors(matrix: Array, multiplier: complex) -> CriticalVectors:
    """Return the eigenvectors of a ``multiplier`` of a matrix (n, n).

    They are real for a real multiplier.
    """
    value = multiplier.real if multiplier.imag == 0 else multiplier
    left, _, right = np.linalg.svd(matrix - value * np.eye(len(matrix)))
    u = left[:, -1]
    v = right[-1].conj()
    product = np.vdot(u, v)
    sign = np.sign(np.linalg.slogdet(left)[0] * np.linalg.slogdet(right)[0])
    return CriticalVectors(v, u / np.conj(product), float((sign * product).real))


def fold_coefficient(forms: MapForms, vectors: CriticalVectors) -> float:
    """Return b of w -> w + b w^2 at a fold, where w is the amplitude of q.

    b = <p, B(q, q)>/2, divided by the norm of q (see the module). The sign of b changes with that
    of q.
    """
    q = vectors.right
    return float(0.5 * vectors.left @ forms.second(q, q)) / forms.norm(q)


def flip_coefficient(forms: MapForms, vectors: CriticalVectors) -> float:
    """Return c of w -> -w + c w^3 at a multiplier of -1.

    For c above 0 the bifurcation is supercritical.
    """
    q = vectors.right
    square: Vector = np.asarray(
        np.linalg.solve(np.eye(len(q)) - forms.matrix, forms.second(q, q)), dtype=float
    )
    cubic = forms.third(q, q, q) / 6 + forms.second(q, square) / 2
    return float(vectors.left @ cubic) / forms.norm(q) ** 2


def torus_coefficient(forms: MapForms, vectors: CriticalVectors, multiplier: complex) -> float:
    """Return a of |w| -> |w| + a |w|^3 at a complex pair on the unit circle.

    For a below 0 the torus is supercritical.

    The state is w q and its complex conjugate, so that its amplitude is 2 |w|.
    """
    q = vectors.right
    one = np.eye(len(q))
    turned = np.exp(1j * np.angle(multiplier))
    mean: Complex = np.linalg.solve(one - forms.matrix, forms.second(q, q.conj())).astype(complex)
    square: Complex = np.linalg.solve(turned**2 * one - forms.matrix, forms.second(q, q)).astype(
        complex
    )
    cubic = forms.third(q, q, q.conj()) + 2 * forms.second(q, mean) + forms.second(q.conj(), square)
    return float((np.vdot(vectors.left, cubic) / turned).real / 2) / forms.norm(q) ** 2
