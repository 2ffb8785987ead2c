"""A proof that a linear absorber's amplitude stays below a bound at every frequency.

It holds between grid points as well.

Bounded-real lemma: with H(s) = c (s - A)^-1 b stable, |H(i w)| <= g at all w if a symmetric P makes

    [ A'P + P A + c'c    P b ]
    [ b'P               -g^2 ]   negative semidefinite.

Over w1 <= w <= w2 only, the generalised Kalman-Yakubovich-Popov lemma has a Hermitian P and a
Hermitian Q >= 0 instead:

    [A b; I 0]* [ -Q            P + i m Q ] [A b; I 0]  +  [ c'c   0  ]
                [ P - i m Q     -w1 w2 Q  ]                [ 0   -g^2 ]

negative semidefinite, m = (w1 + w2)/2.

A semidefinite programme minimises g^2. Its answer is not taken at its word: Q is shifted to Q >= 0,
the upper left block S is checked to be negative definite, and g^2 then follows from P and Q by the
Schur complement, whatever the solver's accuracy. Both lemmas hold at any frequency, so nothing is
sampled; the grid's largest amplitude only has to agree, as a check of the whole chain.

All quantities are dimensionless: time is divided by 1/omega_r, where omega_r (rad/s) is the
frequency of the resonance, and the amplitude by the grid's largest amplitude. The states are the
coordinates along the eigenvectors, scaled such that the input and output vectors of each block have
equal norms (`_balance_blocks`). In SI units the solver's result is far from the optimum.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from impact_env.extras import optional
from impact_env.frequency import state_space
from impact_env.modes import ModalModel
from impact_env.parameters import LinearAbsorber
from optimisation.bounds.relaxation import NotOptimalError, solve
from optimisation.tuned import HIGH, LOW, highest_amplitude

with optional():
    import cvxpy

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Margins: the matrix is required to be below -margin times the identity, and the margin is the
# solver's tolerance too. They raise the bound by some parts in a million.
_EVERYWHERE = 1e-4  # margin relative to the decay rate of the slowest pole
_WITHIN = (1e-6, 1e-5)  # the second is used if the solver finds no optimum with the first
_LEAST_MARGIN = 1e-8  # smaller tolerances are out of the solver's reach
_AGREEMENT = 1e-4  # largest relative difference between bound and grid
_CONDITION = 1e9  # largest condition number of the matrix of eigenvectors


@dataclass(frozen=True)
class Certificate:
    """A proved bound of the tip's amplitude per newton.

    ``bound`` is in m/N. ``grid`` in m/N is the largest amplitude on a refined grid, at
    ``frequency_ratio`` (over omega_r). If ``everywhere`` is True, bound and grid refer to all
    frequencies, otherwise to the requested range.
    """

    bound: float
    grid: float
    frequency_ratio: float
    everywhere: bool


def certify(
    model: ModalModel,
    absorber: LinearAbsorber | None,
    resonance: int = 1,
    low: float = LOW,
    high: float = HIGH,
    *,
    everywhere: bool | None = None,
) -> Certificate:
    """Return a certificate for frequencies of low..high times omega_r, or for all frequencies.

    ``absorber`` None: the structure alone. ``everywhere`` None: the bound is proved at all
    frequencies if the largest amplitude of all lies in the range, which takes less than a second,
    and otherwise in the range alone, which takes several. The largest amplitude may lie at an end
    of the range, on the flank of a neighbouring resonance, which `peak` leaves out. Raises
    ParameterError for bad input, an undamped pole and two equal poles; NotOptimalError if the
    solver finds no optimum or if bound and grid differ.
    """
    omega_r = model.resonance_omega(resonance)
    inside = highest_amplitude(model, absorber, resonance, low, high)
    overall = highest_amplitude(
        model, absorber, resonance, 1e-9 * low, max(high, 2 * float(model.omega[-1]) / omega_r)
    )
    if everywhere is None:
        everywhere = overall[0] <= inside[0] * (1 + 1e-9)
    grid, ratio = overall if everywhere else inside
    damped = model.damping_ratio
    require(
        bool(np.isfinite(grid)), "damping_ratio", damped, "above 0 at every resonance of the range"
    )
    matrix, b, c = _balance_blocks(*state_space(model, absorber, omega_r))
    decay = -float(np.max(np.linalg.eigvals(matrix).real))
    require(
        decay > 0, "damping_ratio", damped, "above 0 at every mode, or an absorber that damps it"
    )
    scale = 1 / np.sqrt(grid)
    system = matrix, scale * b[:, None], scale * c[None]
    margin = max(_LEAST_MARGIN, _EVERYWHERE * min(decay, 1.0))
    square = _everywhere(*system, (margin,)) if everywhere else _within(*system, low, high)
    bound = grid * float(np.sqrt(square))
    if not abs(bound / grid - 1) < _AGREEMENT:
        raise NotOptimalError(
            f"certificate: the bound is {bound:.9g} m/N and the grid's largest amplitude "
            f"{grid:.9g} m/N: no agreement"
        )
    return Certificate(bound, grid, ratio, bool(everywhere))


def _balance_blocks(matrix: Real, b: Real, c: Real) -> tuple[Real, Real, Real]:
    """Return the same system in real blocks, one for each complex pair of poles or real pole.

    In each block the input vector b and the output vector c have equal norms. Raises ParameterError
    if two poles are so close that their eigenvectors are nearly parallel.
    """
    s, vectors = np.linalg.eig(matrix)
    columns = []
    blocks = []
    for z, vector in zip(s, vectors.T, strict=True):
        if z.imag > 0:
            columns += [vector.real, vector.imag]
            blocks.append(np.array([[z.real, z.imag], [-z.imag, z.real]]))
        elif z.imag == 0:
            columns.append(vector.real)
            blocks.append(np.array([[z.real]]))
    basis = np.array(columns).T
    if np.linalg.cond(basis) > _CONDITION:
        raise ParameterError(
            "absorber is not allowed: two poles coincide; change its stiffness or damping by "
            "a part in a million"
        )
    b = np.linalg.solve(basis, b)
    c = c @ basis
    at = 0
    for block in blocks:
        part = slice(at, at + len(block))
        into = float(np.linalg.norm(b[part]))
        out = float(np.linalg.norm(c[part]))
        factor = np.sqrt(out / into) if into * out > 0 else 1.0
        b[part], c[part], at = b[part] * factor, c[part] / factor, part.stop
    return scipy.linalg.block_diag(*blocks), b, c


def _everywhere(a: Real, b: Real, c: Real, margins: Sequence[float]) -> float:
    """Return the certified g^2 over all frequencies.

    The ``margins`` of the matrix inequality are tried in turn, see `_minimise`.
    """
    size = len(a)
    p = cvxpy.Variable((size, size), symmetric=True)
    square = cvxpy.Variable()
    corner = a.T @ p + p @ a + c.T @ c
    side = p @ b
    _minimise(
        cvxpy.bmat([[corner, side], [side.T, cvxpy.reshape(-square, (1, 1), order="C")]]),
        square,
        margins,
        [],
    )
    solution = np.asarray(p.value)
    return _schur(a.T @ solution + solution @ a + c.T @ c, solution @ b, 0.0)


def _kyp_blocks(
    a: Real, b: Real, c: Real, p: Any, q: Any, low: float, high: float
) -> tuple[Any, Any, Any]:
    """Return the blocks (corner, side, last) of the generalised lemma's matrix without g^2.

    The matrix is [[corner, side], [side*, last - g^2]]. ``p`` and ``q`` are the matrices P and Q,
    arrays or variables of cvxpy.
    """
    middle = (low + high) / 2
    turned = p - 1j * middle * q
    corner = -a.T @ q @ a + a.T @ (p + 1j * middle * q) + turned @ a - low * high * q + c.T @ c
    return corner, -a.T @ q @ b + turned @ b, -b.T @ q @ b


def _within(a: Real, b: Real, c: Real, low: float, high: float) -> float:
    """Return the certified g^2 over low <= w <= high, both relative to omega_r."""
    size = len(a)
    p, q = (cvxpy.Variable((size, size), hermitian=True) for _ in range(2))
    square = cvxpy.Variable()
    corner, side, last = _kyp_blocks(a, b, c, p, q, low, high)
    _minimise(cvxpy.bmat([[corner, side], [side.H, last - square]]), square, _WITHIN, [q >> 0])
    shift = max(0.0, -2 * float(np.min(np.linalg.eigvalsh(q.value))))
    corner, side, last = _kyp_blocks(
        a, b, c, np.asarray(p.value), np.asarray(q.value) + shift * np.eye(size), low, high
    )
    return _schur(corner, side, float(np.real(last[0, 0])))


def _minimise(matrix: Any, square: Any, margins: Sequence[float], constraints: list[Any]) -> None:
    """Minimise ``square`` (g^2) such that ``matrix`` is below -margin times the identity.

    The first of the ``margins`` with which the solver finds an optimum is used. The solution is
    stored in the variables of cvxpy. Raises NotOptimalError if there is no optimum with the last.
    """
    size = matrix.shape[0]
    hermitian = (matrix + matrix.H) / 2
    for margin in margins:
        problem = cvxpy.Problem(
            cvxpy.Minimize(square), [hermitian << -margin * np.eye(size), *constraints]
        )
        try:
            return solve(problem, "largest amplitude", margin)
        except NotOptimalError:
            if margin == margins[-1]:
                raise
    return None


def _schur(corner: Complex | Real, side: Complex | Real, last: float) -> float:
    """Return the smallest g^2 for which a matrix is negative semidefinite.

    The matrix is [[corner, side], [side*, last - g^2]]. Raises NotOptimalError if there is no such
    g^2.
    """
    top = float(np.max(np.linalg.eigvalsh((corner + np.conj(corner.T)) / 2)))
    if not top < 0:
        raise NotOptimalError(
            "certificate: the solution found does not satisfy the matrix inequality (largest "
            f"eigenvalue {top:.3g})"
        )
    return last + float(np.real(np.conj(side.T) @ np.linalg.solve(-corner, side))[0, 0])
