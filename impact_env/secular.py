"""Eigenvalues and eigenvectors of a beam with masses, with all digits.

The masses are attached rigidly or through one spring.

In scaled coordinates sqrt(m_a) x_a the masses are 1, psi_a = sqrt(m_a) phi_a, and with d_i(s) = s^2
+ 2 D_i omega_i s + omega_i^2 the eigenvalues are where

    W(s) = (1/s^2 + 1/kappa(s)) I + psi^T diag(1/d_i(s)) psi,

with one row and column for each mass, has a null vector y; v_i = psi_i y/d_i is the beam's share.
kappa = (k + c s)/m is a spring's, without a spring 1/kappa = 0.

W is large and loses digits by cancellation if a mode is weakly coupled to the masses. Each
eigenvalue is therefore computed in the coordinate with the largest share of its eigenvector, its
*lead*; the others are eliminated. For the mode j

    f_j(s) = d_j(s) + R_j(s) = 0,    R_j = psi_j^T W_j(s)^-1 psi_j,
    y = -W_j^-1 psi_j,    v_j = 1,

where W_j is W without the mode j, and likewise s^2 + kappa + R_a for a mass on a spring. R is small
and smooth if the coupling is weak. The unknown is the offset from the lead's own pole, so that
neither d_j nor a small offset loses digits. Mass, damping and stiffness matrices are symmetric, so
left and right eigenvectors are equal; they are normalised by f_j'.

Two eigenvalues that (almost) coincide on the real axis, such as those of a critically damped mode,
have no modal form. Their part of exp(A t) is that of a 2 x 2 matrix with eigenvalues a +- sqrt(-b),
an analytic function of b. A small constant added to f gives b a wanted value. The part is
extrapolated to its own b from three sets of slots with b = (SPLIT |s|)^2 and four and nine times
this value, with weights that are exact up to the second order in b. The error is of sixth order in
SPLIT, 1e-13, and rounding errors grow only by 1/SPLIT.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

SPLIT_TOL = (
    5e-3  # imaginary part over size below which a pair of eigenvalues is replaced by several
)
HEIGHT_FACTORS = (1, 2, 3)  # with imaginary parts of so many times SPLIT
# imaginary part over size: as good as none, small, and what Newton's method keeps apart from none
LEAST_HEIGHT = 1e-9
LOW_HEIGHT = 1e-4
SEPARATION_TOL = 1e-5
# of Newton's method, and the share of |s| in a step after which another one changes nothing
ITERATIONS = 30
NEWTON_TOL = 1e-15

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]
Index = NDArray[np.int64]
SameDataclass = TypeVar("SameDataclass")


def raise_off_axis(size: Real, square: Real) -> list[tuple[Real, Real]]:
    """Return imaginary part and weight (J,) of the slots that stand for close pairs.

    The pairs have a ``size`` (J,) and the squared imaginary part ``square`` (J,).
    """
    heights = [k * SPLIT_TOL * size for k in HEIGHT_FACTORS]
    weights = []
    for h in heights:
        others = [o for o in heights if o is not h]
        weights.append(np.prod([(square - o**2) / (h**2 - o**2) for o in others], axis=0))
    return list(zip(heights, weights, strict=True))


def concatenate(parts: list[SameDataclass]) -> SameDataclass:
    """Return an object whose arrays are those of several ``parts``, concatenated."""
    return type(parts[0])(
        *(
            np.concatenate(values)
            for values in zip(*(vars(part).values() for part in parts), strict=True)
        )
    )


@dataclass(frozen=True, eq=False)
class Coupling:
    """Oscillators (N,) and their coupling.

    They are the beam's n modes, followed by a mass on its spring if ``sprung``.

    Attributes
    ----------
    omega : array, (N,)
        Frequencies in rad/s.
    ratio : array, (N,)
        Damping ratios.
    psi : array, (p, n)
        Coupling of the n modes to p masses.
    sprung : bool
        Whether a mass is on a spring.
    """

    omega: Real
    ratio: Real
    psi: Real
    sprung: bool

    def __post_init__(self) -> None:
        """Separate equal frequencies by their last digit.

        Otherwise a motion that leaves the masses at rest would be a root at two poles at the same
        time.
        """
        omega = np.array(self.omega)
        order = np.argsort(self.omega, kind="stable")
        for a, b in pairwise(order):
            omega[b] = max(omega[b], np.nextafter(omega[a], np.inf))
        object.__setattr__(self, "omega", omega)

    @property
    def rate(self) -> Real:
        """Twice damping ratio times frequency in 1/s, (N,)."""
        return np.asarray(2 * self.ratio * self.omega)

    @property
    def modes(self) -> int:
        """Number of the beam's modes."""
        return self.psi.shape[1]

    def spread(self) -> Real:
        """Return omega^2 (1 - D^2) (N,): the square of an oscillator's own imaginary part."""
        return np.asarray(self.omega**2 * (1 - self.ratio) * (1 + self.ratio))

    def own_poles(self) -> tuple[Complex, Complex]:
        """Return the roots of s^2 + rate s + omega^2, each (N,).

        They are the upper root of a pair and its conjugate, or the slow and the fast real root.
        """
        root = np.sqrt(np.abs(self.spread()))
        swift = self.ratio >= 1
        half = self.rate / 2
        fast = -(half + root)
        slow = np.divide(
            self.omega**2, fast, out=np.zeros_like(fast), where=swift
        )  # the product of both is omega^2: nothing cancels
        upper = np.where(swift, slow, -half + 1j * root)
        return upper, np.where(swift, fast, np.conj(upper))


@dataclass(frozen=True, eq=False)
class PoleOffsets:
    """Leads and reference points of J eigenvalues, with f = constant + offset (offset + slope) + R.

    Attributes
    ----------
    lead : array of int, (J,)
        Lead of each eigenvalue.
    point : array, (J,)
        Point p from which the offset is measured.
    constant, slope : array, (J,)
        Coefficients of f.
    d : array, (J, n)
        d_i(p) of the modes.
    turn : array, (J, N)
        p + rate of the oscillators.
    """

    lead: Index
    point: Complex
    constant: Complex
    slope: Complex
    d: Complex
    turn: Complex


def offset_from_points(c: Coupling, lead: Index, point: Complex) -> PoleOffsets:
    """Return leads with offsets from any ``point``."""
    p = point[:, None]
    j = lead
    away = point + c.rate[j] / 2
    turn = p + c.rate
    d = p * turn[:, : c.modes] + c.omega[: c.modes] ** 2
    return PoleOffsets(lead, point, away**2 + c.spread()[j], 2 * away, d, turn)


def offset_from_poles(c: Coupling, lead: Index, pole: Complex, other: Complex) -> PoleOffsets:
    """Return leads with offsets from one of their own poles; ``other`` is the second one."""
    n = c.modes
    rows = np.arange(len(lead))
    at = offset_from_points(c, lead, pole)
    j = np.minimum(lead, n - 1) if n else lead
    difference = pole[:, None] * (c.rate[:n] - c.rate[j][:, None]) + (
        c.omega[:n] - c.omega[j][:, None]
    ) * (c.omega[:n] + c.omega[j][:, None])
    d = np.where((lead < n)[:, None], difference, at.d)
    turn = at.turn.copy()
    turn[rows, lead] = -other
    return PoleOffsets(lead, pole, np.zeros_like(pole), pole - other, d, turn)


def select_offsets(leads: PoleOffsets, which: NDArray[np.bool_] | Index) -> PoleOffsets:
    """Return some of the leads."""
    return PoleOffsets(*(value[which] for value in vars(leads).values()))


@dataclass(frozen=True, eq=False)
class Elimination:
    """Function f with its derivative (J,), and the vectors with 1 for the lead.

    They are modes ``v`` (J, n), masses ``y`` (J, p) in W y = 0, and the spring's stretch (J,).
    """

    f: Complex
    slope: Complex
    v: Complex
    y: Complex
    stretch: Complex


def eliminate(c: Coupling, leads: PoleOffsets, offset: Complex) -> Elimination:
    """Return f, its derivative and the vectors at offsets (J,) from the leads' points."""
    count = len(offset)
    n = c.modes
    p = len(c.psi)
    s = leads.point + offset
    at = offset[:, None]
    rate = leads.turn[:, :n] + leads.point[:, None]  # 2 p + rate
    rows = np.arange(count)
    mode = leads.lead < n
    d = leads.d + at * (at + rate)
    d[rows[mode], leads.lead[mode]] = np.inf  # the lead itself is not eliminated
    change = 2 * at + rate
    own = leads.constant + offset * (offset + leads.slope)
    own_slope = 2 * offset + leads.slope
    v = np.zeros((count, n), complex)
    y = np.zeros((count, p), complex)
    stretch = np.zeros(count, complex)
    rest = np.zeros(count, complex)
    rest_slope = np.zeros(count, complex)
    kappa, damper = (
        (c.omega[-1] ** 2 + c.rate[-1] * s, float(c.rate[-1]))
        if c.sprung
        else (np.full(count, np.inf, complex), 0.0)
    )
    if np.any(mode):
        k = leads.lead[mode]
        e = 1 / kappa[mode]
        x = s[mode]
        w = c.psi / d[mode][:, None, :] @ c.psi.T + (1 / x**2 + e)[:, None, None] * np.eye(p)
        force = -np.linalg.solve(w, c.psi.T[k][:, :, None])[:, :, 0]
        moved = force @ c.psi / d[mode]
        y[mode] = force
        stretch[mode] = force[:, 0] * e
        rest[mode] = -np.einsum("ja,ja->j", c.psi.T[k], force)
        rest_slope[mode] = (2 / x**3 + damper * e**2) * np.sum(force**2, axis=1) + np.sum(
            change[mode] * moved**2, axis=1
        )
        moved[np.arange(len(k)), k] = 1
        v[mode] = moved
    if not np.all(mode):
        mass = ~mode
        g = kappa[~mode]
        mobility = np.sum(c.psi[0] ** 2 / d[mass], axis=1)
        part = 1 / (1 + g * mobility)
        v[mass], y[mass, 0], stretch[mass] = (
            c.psi[0] * (g * part)[:, None] / d[mass],
            g * part,
            part,
        )
        rest[mass] = -g * part * g * mobility
        rest_slope[mass] = -damper * g * mobility * part * (part + 1) + np.sum(
            change[mass] * v[mass] ** 2, axis=1
        )
    return Elimination(own + rest, own_slope + rest_slope, v, y, stretch)


def solve_secular(c: Coupling, leads: PoleOffsets, offset: Complex, most: float) -> Complex:
    """Return the offsets at which f vanishes, by Newton's method.

    Its steps are at most ``most`` times |s|. Real offsets stay real.
    """
    real = (offset.imag == 0) & (leads.point.imag == 0)
    for _ in range(ITERATIONS):
        now = eliminate(c, leads, offset)
        step = now.f / now.slope
        good = np.isfinite(step) & (np.abs(step) < most * np.abs(leads.point + offset))
        step = np.where(good, step, 0)
        offset = offset - step
        offset = np.where(real, offset.real, offset)
        if np.all(np.abs(step) <= NEWTON_TOL * np.abs(leads.point + offset)):
            break
    return offset


def solve_at_imaginary_part(c: Coupling, leads: PoleOffsets, height: Real) -> tuple[Complex, Real]:
    """Return offsets from real points at which f is real, and -f at these offsets, (J,).

    The offsets have the imaginary part ``height``. -f is the constant that moves the root there.
    """
    offset = np.array(1j * height, dtype=np.complex128)
    for _ in range(ITERATIONS):
        now = eliminate(c, leads, offset)
        step = now.f.imag / now.slope.imag
        offset -= np.where(np.isfinite(step) & (np.abs(step) < 0.1 * np.abs(leads.point)), step, 0)
        if np.all(np.abs(step) <= NEWTON_TOL * np.abs(leads.point)):
            break
    return offset, np.asarray(-eliminate(c, leads, offset).f.real)


@dataclass(frozen=True, eq=False)
class Eigen:
    """Eigenvalues and eigenvectors, J of them.

    The motion is the sum over the slots of real parts, doubled for complex eigenvalues.

    Attributes
    ----------
    s : array, (J,)
        Eigenvalues in 1/s.
    v, z, stretch : array, (J, n), (J, p) and (J,)
        Right eigenvectors: modes, scaled masses, and the spring's stretch.
    by_displacement, by_velocity : array, (J, N)
        Normalised left eigenvectors over the oscillators.
    by_force : array, (J, n)
        Left eigenvectors over forces on the modes.
    by_pull : array, (J,)
        Left eigenvectors over a force between the scaled masses and their places.
    """

    s: Complex
    v: Complex
    z: Complex
    stretch: Complex
    by_displacement: Complex
    by_velocity: Complex
    by_force: Complex
    by_pull: Complex


def eigenvectors(c: Coupling, leads: PoleOffsets, offset: Complex) -> Eigen:
    """Return eigenvalues and vectors for solved offsets."""
    now = eliminate(c, leads, offset)
    s = leads.point + offset
    return _vectors(c, leads, offset, now, _masses(c, leads, s, now), now.slope)


def _masses(c: Coupling, leads: PoleOffsets, s: Complex, now: Elimination) -> Complex:
    z = -now.y / s[:, None] ** 2
    z[leads.lead >= c.modes] = 1
    return z


def _vectors(
    c: Coupling, leads: PoleOffsets, offset: Complex, now: Elimination, z: Complex, norm: Complex
) -> Eigen:
    s = leads.point + offset
    n = c.modes
    divisor = norm[:, None]
    turn = leads.turn + offset[:, None]
    v = now.v
    stretch = now.stretch
    if not c.sprung:  # a mass moves with its place
        displacement = v * turn - now.y @ c.psi / s[:, None]
        velocity = v - now.y @ c.psi / s[:, None] ** 2
        return Eigen(
            s,
            v,
            z,
            np.zeros_like(s),
            displacement / divisor,
            velocity / divisor,
            v / divisor,
            np.zeros_like(s),
        )
    rate = float(c.rate[-1])
    square = float(c.omega[-1] ** 2)
    damped = c.rate[-1] * stretch[:, None]
    # v (s + rate) less the damper's share: where both are large, and that is for all but the lead,
    # what cancels is left out
    rest = v * (square * turn[:, :n] - rate * c.omega[:n] ** 2) / (square + rate * s)[:, None]
    modes = np.where(leads.lead[:, None] == np.arange(n), v * turn[:, :n] - damped * c.psi[0], rest)
    mass = np.where(
        leads.lead[:, None] == n,
        turn[:, n:] + rate * (stretch[:, None] - 1),
        s[:, None] * z + damped,
    )
    displacement = np.concatenate([modes, mass], axis=1)
    velocity = np.concatenate([v, z], axis=1)
    return Eigen(
        s, v, z, stretch, displacement / divisor, velocity / divisor, v / divisor, stretch / norm
    )


def _vectors_at_height(c: Coupling, leads: PoleOffsets, offset: Complex) -> list[tuple[Real, Real]]:
    """Return x, y of s and vectors = x + i height y of pairs.

    The height is the imaginary part of the pairs at an ``offset`` (J,).

    Complex numbers with imaginary parts of any smallness keep the digits of x and y apart, and so
    does the norm, which is i height times v_y^T (2 s M + C) v + v*^T M v, from v^T (2 s M + C) v
    and the orthogonality of v and its conjugate.
    """
    height = offset.imag
    now = eliminate(c, leads, offset)
    s = leads.point + offset
    z = _masses(c, leads, s, now)
    rate = leads.turn[:, : c.modes] + leads.point[:, None] + 2 * offset[:, None]
    whole = np.sum(now.v.imag / height[:, None] * rate * now.v + np.abs(now.v) ** 2, axis=1)
    whole += np.sum(z.imag / height[:, None] * 2 * s[:, None] * z + np.abs(z) ** 2, axis=1)
    if c.sprung:
        whole += c.rate[-1] * now.stretch.imag / height * now.stretch
    parts = [value.T for value in vars(_vectors(c, leads, offset, now, z, whole)).values()]
    return [(value.real.T, (value.imag / height).T) for value in parts]


def _sum_weighted(shares: tuple[Real, ...], parts: list[tuple[Real, Real]]) -> tuple[Real, Real]:
    """Return x and y summed over ``parts``, each weighted by its share (J,)."""
    x, y = (
        sum(
            np.where(share != 0, share * part[k].T, 0).T
            for share, part in zip(shares, parts, strict=True)
        )
        for k in (0, 1)
    )
    return np.asarray(x), np.asarray(y)


def _square(c: Coupling, leads: PoleOffsets) -> Real:
    """Return the squared imaginary part (J,) of pairs by their leads' real points.

    It is the value at which the perturbation `solve_at_imaginary_part` vanishes.
    """
    size = np.abs(leads.point)
    lowest = LEAST_HEIGHT * size
    low = LOW_HEIGHT * size
    none, some = (solve_at_imaginary_part(c, leads, height)[1] for height in (lowest, low))
    rise = low**2 / (some - none)
    square = -none * rise
    for _ in range(8):
        height = np.sqrt(np.maximum(square, lowest**2))
        square = np.where(
            square > 0, square - solve_at_imaginary_part(c, leads, height)[1] * rise, square
        )
    return np.asarray(square)


def close_pairs(c: Coupling, lead: Index, place: Complex) -> Eigen:
    """Return the slots of pairs of close eigenvalues.

    ``place`` (J,) is near the upper eigenvalue, or near the middle of two real eigenvalues.
    """
    leads = offset_from_points(c, lead, place.real.astype(np.complex128))
    size = np.abs(place)
    apart = place.imag > SEPARATION_TOL * size  # far enough from each other to be found as they are
    upper = solve_secular(
        c,
        leads,
        np.where(apart, 1j * place.imag, 1j * SEPARATION_TOL * size).astype(np.complex128),
        0.1,
    )
    square = np.where(apart, upper.imag**2, _square(c, leads))
    above = square > 0
    height = np.sqrt(np.maximum(np.abs(square), (LEAST_HEIGHT * size) ** 2))
    shares = (
        np.where(above, 0.0, 3.0),
        np.where(above, 1.0, -3.0),
        np.where(above, 0.0, 1.0),
    )  # at it, or extrapolated from three heights
    offsets = [
        solve_at_imaginary_part(c, leads, h)[0]
        for h in (LEAST_HEIGHT * size, height, np.sqrt(2) * height)
    ]
    offsets[1] = np.where(apart, upper, offsets[1])
    nodes = [_vectors_at_height(c, leads, offset) for offset in offsets]
    basis = [_sum_weighted(shares, [node[k] for node in nodes]) for k in range(len(nodes[0]))]
    slots = []
    for h, weight in raise_off_axis(size, square):
        parts = [(x.T + 1j * h * y.T) for x, y in basis]
        factors = [1, weight, weight, weight] + 4 * [1 / (2j * h)]
        slots.append(
            Eigen(*((part * factor).T for part, factor in zip(parts, factors, strict=True)))
        )
    return concatenate(slots)
