"""Special points on curves of bifurcations, at which a second condition is satisfied.

The curves are those of folds, doubled periods (broken symmetry) and tori.

Names and conditions are those of Kuznetsov, Elements of Applied Bifurcation Theory (2004), chapter
9. Each condition is a zero of a `Monitor`: of a product over the multipliers that are not critical,
of the angle between left and right critical vectors, or of a normal form's coefficient. A
coefficient has poles at other special points, so it is multiplied by a factor that vanishes there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.bifurcations import PERIOD_DOUBLING, SYMMETRY_BREAKING, TORUS
from impact_env.periodic.branch import FOLD, Monitor
from impact_env.periodic.normal_forms import (
    SUBCRITICAL,
    SUPERCRITICAL,
    CriticalVectors,
    MapForms,
    Vector,
    find_critical_vectors,
    flip_coefficient,
    fold_coefficient,
    torus_coefficient,
)

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
CUSP = "cusp"
R1, R2, R3, R4 = (f"R{k} resonance" for k in range(1, 5))
FOLD_FLIP = "fold-flip"
FOLD_TORUS = "fold-Neimark-Sacker"
FLIP_TORUS = "flip-Neimark-Sacker"
DOUBLE_TORUS = "double Neimark-Sacker"
GENERALISED_FLIP = "generalised period doubling"
DEGENERATE_SYMMETRY_BREAKING = "degenerate symmetry breaking"
CHENCINER = "Chenciner"
NEEDS_PAIR = (FOLD_TORUS, FLIP_TORUS, DOUBLE_TORUS)  # of complex multipliers, not two real ones
CODIMENSION_TWO = (
    *(CUSP, R1, R2, R3, R4, FOLD_FLIP, *NEEDS_PAIR),
    *(GENERALISED_FLIP, DEGENERATE_SYMMETRY_BREAKING, CHENCINER),
)
ZERO_TOL = (
    1e-5  # of a bounded test function at what is located: a pole, or a jump, is far from zero
)
ROUNDING = 1e-12  # of a coefficient without its poles
UPPER_TOL = 1e-6  # least imaginary part of a complex multiplier


def bound(value: float) -> float:
    """Return a function of ``value`` from -1 to 1 that has the same zeros.

    Values below rounding, as in systems without losses, give zero.
    """
    return 0.0 if abs(value) < ROUNDING else value / (1 + abs(value))


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """A fixed point of a map at a bifurcation of a ``kind``.

    ``forms`` are the derivatives of the map (see `MapForms`). The critical vector q has the sign
    with which its product with ``reference`` is not negative.
    """

    kind: str
    forms: MapForms
    reference: Vector | None = None

    @cached_property
    def multipliers(self) -> Complex:
        """Eigenvalues (n,) of the map's derivative."""
        return np.asarray(np.linalg.eigvals(self.forms.matrix), dtype=complex)

    @cached_property
    def critical(self) -> NDArray[np.int64]:
        """Indices of the critical multiplier, or of the pair (2,) whose product is next to 1."""
        values = self.multipliers
        if self.kind != TORUS:
            return np.array([np.argmin(np.abs(values - self.side))])
        first, second = np.triu_indices(len(values), 1)
        k = int(np.argmin(np.abs(values[first] * values[second] - 1)))
        return np.array([first[k], second[k]])

    @property
    def side(self) -> float:
        """The critical multiplier, 1 or -1."""
        return 1.0 if self.kind == FOLD else -1.0

    @property
    def others(self) -> Complex:
        """All multipliers except the critical ones."""
        return np.delete(self.multipliers, self.critical)

    @property
    def pair_sum(self) -> float:
        """Sum of the two critical multipliers of a torus: twice the cosine of their angle."""
        return float(np.sum(self.multipliers[self.critical]).real)

    @cached_property
    def multiplier(self) -> complex:
        """The critical multiplier.

        It is 1, -1, or that of a pair on the unit circle with positive imaginary part.
        """
        if self.kind != TORUS:
            return complex(self.side)
        return complex(np.exp(1j * np.arccos(np.clip(self.pair_sum / 2, -1, 1))))

    @cached_property
    def vectors(self) -> CriticalVectors:
        """Left and right critical vectors."""
        vectors = find_critical_vectors(self.forms.matrix, self.multiplier)
        if self.reference is None or self.kind == TORUS or vectors.right @ self.reference >= 0:
            return vectors
        return CriticalVectors(-vectors.right, -vectors.left, vectors.angle)

    @cached_property
    def coefficient(self) -> float:
        """Coefficient of the normal form.

        See `fold_coefficient`, `flip_coefficient` and `torus_coefficient`. It is NaN if it does not
        exist.
        """
        if not np.all(np.isfinite(self.forms.matrix)):
            return np.nan
        try:
            if self.kind == FOLD:
                return fold_coefficient(self.forms, self.vectors)
            if self.kind != TORUS:
                return flip_coefficient(self.forms, self.vectors)
            if abs(self.pair_sum) >= 2:
                return np.nan
            return torus_coefficient(self.forms, self.vectors, self.multiplier)
        except np.linalg.LinAlgError:
            return np.nan

    @property
    def criticality(self) -> str | None:
        """Whether the bifurcation is "supercritical" or "subcritical".

        None at a fold, or if it is not known.
        """
        if self.kind == FOLD or not np.isfinite(self.coefficient):
            return None
        stable = self.coefficient < 0 if self.kind == TORUS else self.coefficient > 0
        return SUPERCRITICAL if stable else SUBCRITICAL

    def distance(self, value: float) -> float:
        """Return a product from -1 to 1 over all other multipliers.

        It is zero if one of them equals ``value``, which is 1 or -1.
        """
        others = self.others
        return float(np.prod((others - value) / (1 + np.abs(others))).real)

    def reciprocal(self) -> float:
        """Return a product from -1 to 1 over pairs of all other multipliers.

        It is zero if two of them have the product 1.
        """
        others = self.others
        first, second = np.triu_indices(len(others), 1)
        products = others[first] * others[second]
        return float(np.prod((products - 1) / (1 + np.abs(products))).real)

    def test(self, label: str) -> float:
        """Return the bounded test function of the special point called ``label``.

        The result is NaN if the map has no derivative.
        """
        if not np.all(np.isfinite(self.forms.matrix)):
            return np.nan
        return float(_TESTS[label](self))


def _test_flip(point: CriticalPoint) -> float:
    """Return the cubic coefficient times factors that remove its poles.

    The coefficient has poles where a second multiplier is -1, or where a multiplier is 1.
    """
    return bound(point.coefficient * point.vectors.angle * point.distance(1.0))


_TESTS: dict[str, Callable[[CriticalPoint], float]] = {
    CUSP: lambda point: bound(point.coefficient * point.vectors.angle),
    FOLD_FLIP: lambda point: point.distance(-point.side),
    FOLD_TORUS: lambda point: point.distance(1.0) if point.kind == TORUS else point.reciprocal(),
    FLIP_TORUS: lambda point: point.distance(-1.0) if point.kind == TORUS else point.reciprocal(),
    DOUBLE_TORUS: CriticalPoint.reciprocal,
    GENERALISED_FLIP: _test_flip,
    DEGENERATE_SYMMETRY_BREAKING: _test_flip,
    CHENCINER: lambda point: bound(point.coefficient * point.distance(1.0)),
    R1: lambda point: (2 - point.pair_sum) / 4 if point.kind == TORUS else point.vectors.angle,
    R2: lambda point: (2 + point.pair_sum) / 4 if point.kind == TORUS else point.vectors.angle,
    R3: lambda point: (1 + point.pair_sum) / 4,
    R4: lambda point: point.pair_sum / 4,
}
LABELS = {
    FOLD: (CUSP, R1, FOLD_FLIP, FOLD_TORUS),
    PERIOD_DOUBLING: (GENERALISED_FLIP, R2, FOLD_FLIP, FLIP_TORUS),
    SYMMETRY_BREAKING: (DEGENERATE_SYMMETRY_BREAKING, R2, FOLD_FLIP, FLIP_TORUS),
    TORUS: (CHENCINER, R1, R2, R3, R4, FOLD_TORUS, FLIP_TORUS, DOUBLE_TORUS),
}
TORUS_ENDS = (R1, R2)  # behind them the pair is real, and no torus


def codimension_two_monitors(
    kind: str, point_at: Callable[[Array, float], CriticalPoint]
) -> tuple[Monitor, ...]:
    """Return the monitors of the special points on a curve of a ``kind``.

    ``point_at`` gives the curve's points as a function of unknowns and parameter.
    """

    def value(label: str, z: Array, parameter: float) -> float:
        return point_at(z, parameter).test(label)

    return tuple(
        Monitor(label, partial(value, label), ends=kind == TORUS and label in TORUS_ENDS)
        for label in LABELS[kind]
    )


def is_special(point: CriticalPoint, label: str) -> bool:
    """Return whether a located zero of a test function is a special point.

    The function must vanish at the point, not jump or have a pole, and its zero must not come from
    two real multipliers.
    """
    if not abs(point.test(label)) < ZERO_TOL:
        return False
    needs_pair = label in NEEDS_PAIR and not (point.kind == TORUS and label != DOUBLE_TORUS)
    if not needs_pair:
        return True
    # the two other multipliers whose product is next to 1 must be complex
    others = point.others
    first, second = np.triu_indices(len(others), 1)
    k = int(np.argmin(np.abs(others[first] * others[second] - 1)))
    return abs(others[first[k]].imag) > UPPER_TOL
