"""Linear regimes of a scene: modal amplitudes (slots), maps and tables.

The exact kernels propagate them (see kernels/motion/modal_system.py).

The coupled regimes (absorber stuck, held, or on a spring) have the eigenvalues and eigenvectors of
secular.py; the free regime has the beam's own.

Start values for secular.py: the eigenvalue of a mode with weak coupling to the masses lies next to
the mode's pole. The pole is its start value, because a dense eigensolver cannot separate the two.
For all other modes a dense eigensolver gives start values.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from impact_env.force_channels import find_base_shapes
from impact_env.kernels.events.search import HERMITE_SHARE, LEVEL_RATIO, SCAN_NOISE
from impact_env.kernels.motion.modal_system import (
    POINTS,
    REST,
    TAYLOR_REACH,
    TAYLOR_TERMS,
    ModalSystem,
)
from impact_env.kernels.motion.segments import LinearRegime
from impact_env.modes import MOST_HEAVINESS, ModalModel, with_link
from impact_env.secular import (
    SPLIT_TOL,
    Complex,
    Coupling,
    Eigen,
    Index,
    PoleOffsets,
    Real,
    close_pairs,
    concatenate,
    eigenvectors,
    eliminate,
    offset_from_points,
    offset_from_poles,
    raise_off_axis,
    select_offsets,
    solve_secular,
)

# the modes of a regime span the state up to this, in terms of energy; below the second nothing
# better is tried
COMPLETENESS_TOL = 1e-8
BASIS_TOL = 1e-11
WEAK_COUPLINGS = (1e-4, 1e-8, 0.0)  # what is tried in turn: see `solve_eigenproblem`
UNCOUPLED = 1e-30  # of the largest tip shape: a mode with a node at the absorber
# a spring or damper against the beam's first mode at the tip: far beyond, the stretch is a
# difference of equal numbers
MOST_STIFFNESS_RATIO = 1e8
AWAY_FROM_DOUBLE = "damping and stiffness away from a double eigenvalue"
NEAR_CRITICAL = 0.01  # of 1 - D^2: offsets are then from the middle of both poles
COMPLEX_PAIR_TOL = (
    1e-3  # imaginary part over size of a complex pair that has no modal form in practice
)
REAL_PAIR_TOL = 3e-5  # half the distance of two real eigenvalues over their size, likewise
MOST_NEWTON_STEP = 0.3  # share of |s| that a Newton step may go

Starts = tuple[PoleOffsets, Complex]
M = TypeVar("M")


def _start_at_middles(c: Coupling, weak: float) -> tuple[list[Starts], Index]:
    """Return leads and offsets of weakly coupled oscillators close to critical damping.

    The indices of these oscillators are returned as well.
    """
    near = np.flatnonzero(np.abs(c.spread()) < NEAR_CRITICAL * c.omega**2)
    leads = offset_from_points(c, near, (-c.rate[near] / 2).astype(complex))
    begin = eliminate(c, leads, np.zeros(len(near), complex))
    rest = (begin.f - leads.constant).real
    slope = begin.slope.real
    ok = (np.abs(rest) < weak * c.omega[near] ** 2) & (np.abs(slope) < 10 * weak * c.omega[near])
    square = begin.f.real + slope**2 / 4
    half = np.sqrt(np.abs(square))
    up = (leads, (-slope / 2 + np.where(square > 0, 1j * half, half)).astype(np.complex128))
    down = (leads, (-slope / 2 - half).astype(np.complex128))
    return [_select_starts(up, ok), _select_starts(down, ok & (square <= 0))], near[ok]


def _start_at_poles(c: Coupling, weak: float) -> tuple[list[Starts], Index]:
    """Return leads and offsets of weakly coupled oscillators farther from critical damping.

    The indices of these oscillators are returned as well.
    """
    far = np.flatnonzero(np.abs(c.spread()) >= NEAR_CRITICAL * c.omega**2)
    one, other = c.own_poles()
    swift = c.ratio[far] >= 1
    ok = np.ones(len(far), dtype=bool)
    starts = []
    for p, q, used in ((one[far], other[far], np.ones_like(swift)), (other[far], one[far], swift)):
        leads = offset_from_poles(c, far, p, q)
        nothing = np.zeros(len(far), complex)
        begin = eliminate(c, leads, nothing)
        size = np.abs(leads.slope)
        small = (np.abs(begin.f) < weak * np.abs(p) * size) & (
            np.abs(begin.slope - leads.slope) < 10 * weak * size
        )
        ok &= small | ~used
        starts.append((leads, nothing, used))
    return [_select_starts((leads, offset), ok & used) for leads, offset, used in starts], far[ok]


def _select_starts(starts: Starts, which: NDArray[np.bool_]) -> Starts:
    return select_offsets(starts[0], which), starts[1][which]


def _start_by_dense_solver(c: Coupling, which: Index) -> Starts:
    """Return leads and offsets of the strongly coupled oscillators ``which``.

    A dense eigensolver computes them.
    """
    modes = which[which < c.modes]
    sprung = c.sprung and len(which) > 0
    psi = c.psi[:, modes]
    omega = c.omega[modes]
    rate = c.rate[modes]
    if sprung:
        line = np.append(-psi[0], 1.0)
        m = np.eye(len(line))
        own = np.append(modes, c.modes)
        damping = with_link(rate, c.rate[-1], line)
        stiffness = with_link(omega**2, c.omega[-1] ** 2, line)
    else:
        m = np.eye(len(modes)) + psi.T @ psi
        own = modes
        damping = np.diag(rate)
        stiffness = np.diag(omega**2)
    values, shapes = quadratic_modes(m, damping, stiffness)
    lead = own[np.argmax(np.abs(shapes), axis=0)]
    one, other = (pole[lead] for pole in c.own_poles())
    nearer = np.abs(values - one) <= np.abs(values - other)
    pole = np.where(nearer, one, other)
    second = np.where(nearer, other, one)
    near = np.abs(values - pole) < np.abs(values)
    parts = (
        offset_from_poles(c, lead[near], pole[near], second[near]),
        offset_from_points(c, lead[~near], np.zeros(int(np.sum(~near)), complex)),
    )
    leads = concatenate(list(parts))
    return leads, np.concatenate([values[near], values[~near]]) - leads.point


def quadratic_modes(m: Real, c: Real, k: Real) -> tuple[Complex, Complex]:
    """Return approximate eigenvalues (J,) of s^2 m + s c + k, and their vectors (N, J).

    Only eigenvalues with an imaginary part of 0 or above are returned.
    """
    squares, vectors = scipy.linalg.eigh(k, m)
    frequencies = np.sqrt(np.maximum(squares, 1e-16 * np.max(squares)))
    zero = np.zeros_like(k)
    block = np.block(
        [[zero, np.diag(frequencies)], [-np.diag(frequencies), -vectors.T @ c @ vectors]]
    )
    values, states = scipy.linalg.eig(block)
    values = np.where(np.abs(values.imag) < 1e-9 * np.abs(values), values.real, values)
    upper = values.imag >= 0
    return values[upper], vectors @ states[len(k) :, upper]


def _close(lead: Index, s: Complex) -> tuple[NDArray[np.bool_], Index, Complex]:
    """Return which eigenvalues (J,) are isolated, and lead and place of each close pair.

    The place of a complex pair is its upper eigenvalue, the place of two real eigenvalues their
    middle.
    """
    alone = np.ones(len(s), dtype=bool)
    leads = []
    places = []
    for k in np.flatnonzero((s.imag != 0) & (np.abs(s.imag) < COMPLEX_PAIR_TOL * np.abs(s))):
        alone[k] = False
        leads.append(lead[k])
        places.append(s[k])
    real = np.flatnonzero(s.imag == 0)
    real = real[np.lexsort((s[real].real, lead[real]))]
    for a, b in pairwise(real):
        if alone[a] and lead[a] == lead[b] and abs(s[a] - s[b]) < REAL_PAIR_TOL * abs(s[a] + s[b]):
            alone[[a, b]] = False
            leads.append(lead[a])
            places.append((s[a] + s[b]) / 2)
    return alone, np.array(leads, dtype=int), np.array(places, dtype=complex)


@np.errstate(
    divide="ignore", invalid="ignore"
)  # where two poles are one: what is not a number is no start, or found by the check of the basis
def solve_eigenproblem(c: Coupling, weak: float) -> Eigen:
    """Return all eigenvalues and eigenvectors.

    Oscillators whose R is below ``weak`` times |s|^2 are solved from their own pole.
    """
    middles, near = _start_at_middles(c, weak)
    poles, far = _start_at_poles(c, weak)
    starts = middles + poles
    left = np.setdiff1d(np.arange(len(c.omega)), np.concatenate([near, far]))
    if len(left) > 0:
        if c.sprung:  # the dense solver always has the mass
            starts = [_select_starts(part, part[0].lead < c.modes) for part in starts]
        starts.append(_start_by_dense_solver(c, left))
    leads = concatenate([part[0] for part in starts])
    offset = np.concatenate([part[1] for part in starts])
    alone, lead, place = _close(leads.lead, leads.point + offset)
    single = select_offsets(leads, alone)
    result = [eigenvectors(c, single, solve_secular(c, single, offset[alone], MOST_NEWTON_STEP))]
    if len(lead) > 0:
        result.append(close_pairs(c, lead, place))
    return concatenate(result)


@dataclass(frozen=True)
class RegimeModes:
    """Modes of a regime, J of them.

    Attributes
    ----------
    values : array, (J,)
        Eigenvalues in 1/s.
    out : array, (2 N_m + 2, J)
        State per unit of each modal amplitude.
    into : array, (J, 2 N_m + 2)
        Modal amplitudes per unit of each entry of the state.
    drive, relative : array, (J,)
        Responses to the drive, and to a force between absorber and tip.
    tip, stretch : array, (J,)
        Displacement of the tip, and of the absorber relative to the tip, per unit amplitude;
        without the absorber's own share if it is free.
    push : array, (J, N_m)
        Responses to a unit force on each of the beam's modes.
    """

    values: Complex
    out: Complex
    into: Complex
    drive: Complex
    relative: Complex
    tip: Complex
    stretch: Complex
    push: Complex


def _own_values(model: ModalModel, which: Index) -> tuple[Index, Complex, Complex, Real]:
    """Return mode, eigenvalue, the other root, and weight of each slot of the free beam."""
    omega = model.omega[which]
    ratio = model.damping_ratio[which]
    rate = ratio * omega
    square = omega**2 * (1 - ratio) * (1 + ratio)
    close = np.abs(square) < (SPLIT_TOL * omega) ** 2
    under = (square > 0) & ~close
    over = (square < 0) & ~close
    root = np.sqrt(np.abs(square))
    parts: list[tuple[NDArray[Any], ...]] = [
        (
            which[under],
            (-rate + 1j * root)[under],
            (-rate - 1j * root)[under],
            np.ones(int(np.sum(under))),
        )
    ]
    fast = -(rate + root)
    slow = omega**2 / fast  # the product of both is omega^2: no cancellation
    parts += [
        (which[over], s[over] + 0j, other[over] + 0j, np.ones(int(np.sum(over))))
        for s, other in ((slow, fast), (fast, slow))
    ]
    for height, weight in raise_off_axis(omega, square):
        parts.append(
            (
                which[close],
                (-rate + 1j * height)[close],
                (-rate - 1j * height)[close],
                weight[close],
            )
        )
    mode, values, others, weight = (np.concatenate(part) for part in zip(*parts, strict=True))
    return mode, values, others, weight


def solve_own_modes(model: ModalModel, which: Index) -> RegimeModes:
    """Return the modes of the free beam with indices ``which``, as slots.

    An oscillating mode has one slot, an overdamped mode has two. A mode with a damping ratio within
    about 1e-5 of 1 has three: motion and forced response are extrapolated from three pairs of
    eigenvalues next to the double one (see secular.py). The error is below 1e-12 of the energy norm
    (tests/kernels/test_regimes.py).
    """
    n = model.modes
    index, s, other, weight = _own_values(model, which)
    kappa = np.where(s.imag == 0, 1.0, 2.0) / (
        s - other
    )  # real parts are taken: twice the one of a pair
    alpha = -other * kappa
    size = len(s)
    row = np.arange(len(s))
    out = np.zeros((2 * n + 2, size), complex)
    into = np.zeros((size, 2 * n + 2), complex)
    out[index, row] = weight
    out[n + 1 + index, row] = weight * s
    into[row, index] = alpha
    into[row, n + 1 + index] = kappa
    tip = (weight * model.tip_shape[index]).astype(np.complex128)
    push = into[:, n + 1 : 2 * n + 1]
    return RegimeModes(
        s,
        out,
        into,
        kappa * model.force_shape[index],
        -kappa * model.tip_shape[index],
        tip,
        -tip,
        push,
    )


def solve_coupled_modes(
    model: ModalModel, mass: float, stiffness: float | None, damper: float, weak: float
) -> RegimeModes:
    """Return the modes of beam and absorber (``mass`` in kg).

    They are joined if ``stiffness`` is None, else connected by a spring (N/m) and a damper (N s/m).
    """
    n = model.modes
    root = np.sqrt(mass)
    which, own = split_modes(model.tip_shape[None])
    omega = model.omega[which]
    ratio = model.damping_ratio[which]
    psi = root * model.tip_shape[None, which]
    if stiffness is not None:
        spring = np.sqrt(stiffness / mass)
        omega = np.append(omega, spring)
        ratio = np.append(ratio, damper / (2 * mass * spring))
    c = Coupling(omega, ratio, psi, stiffness is not None)
    e = solve_eigenproblem(c, weak)
    count = len(e.s)
    counted = np.where(e.s.imag == 0, 1, 2)
    shape = np.zeros((count, n + 1), complex)
    into = np.zeros((count, 2 * n + 2), complex)
    shape[:, which] = e.v
    shape[:, n] = e.z[:, 0] / root
    place = np.append(which, n)[: len(c.omega)]
    scale = np.append(np.ones(len(which)), root)[: len(c.omega)]
    into[:, place] = e.by_displacement * scale
    into[:, n + 1 + place] = e.by_velocity * scale
    summed = e.v * c.psi[0]
    direct = (stiffness is not None) & (
        np.sum(np.abs(summed), axis=1) < np.abs(e.z[:, 0]) + np.abs(e.stretch)
    )
    tip = np.where(
        direct, np.sum(summed, axis=1), e.z[:, 0] - e.stretch
    )  # the same twice: whichever cancels less
    rates = np.concatenate([shape, shape * e.s[:, None]], axis=1)
    forces = e.by_force @ model.force_shape[which], e.by_pull / root
    push = np.zeros((count, n), complex)
    push[:, which] = e.by_force
    result = RegimeModes(
        e.s,
        (rates.T * counted),
        into,
        *forces,
        counted * tip / root,
        counted * e.stretch / root,
        push,
    )
    alone = solve_own_modes(model, own)
    return RegimeModes(
        *(
            np.concatenate(parts, axis=axis)
            for parts, axis in zip(
                zip(vars(result).values(), vars(alone).values(), strict=True),
                (0, 1, 0, 0, 0, 0, 0, 0),
                strict=True,
            )
        )
    )


def split_modes(shapes: Real) -> tuple[Index, Index]:
    """Return the modes that move absorbers, and those with a node at all of them.

    ``shapes`` (p, N_m): mode shapes at the absorbers.
    """
    coupled = np.any(
        np.abs(shapes) > UNCOUPLED * np.max(np.abs(shapes), axis=1, keepdims=True), axis=0
    )
    return np.flatnonzero(coupled), np.flatnonzero(~coupled)


def padded_size(slots: int) -> int:
    """Return the number of slots after padding to whole vectors of four."""
    return 4 * -(-slots // 4)


def carried_response(modes: RegimeModes, model: ModalModel, mass: float, spring: bool) -> Complex:
    """Return the response (J,) to a unit acceleration of the absorber's mass (kg).

    The acceleration is applied as a force on the mass. On a ``spring`` the absorber moves by
    itself.
    """
    return mass * (modes.push @ model.tip_shape + (modes.relative if spring else 0.0))


def with_weight(modes: RegimeModes, carried: Complex) -> RegimeModes:
    """Return modes whose constant force is the absorber's weight, per unit of gravity.

    The weight acts downwards.
    """
    return replace(modes, relative=-carried)


def base_rows(modes: RegimeModes, model: ModalModel, size: int, carried: Complex | None) -> Real:
    """Return the rows from BASE on: responses to unit accelerations of the bases.

    Coordinates are relative to the base; the load on the modes is then -Gamma. An absorber that is
    not free adds -m_a r with the rigid displacement r at its place; ``carried`` (J,) is the
    response to a unit acceleration of its mass.
    """
    rows = []
    for participation, at_absorber in zip(*find_base_shapes(model), strict=True):
        response = -(modes.push @ participation)
        if carried is not None:
            response = response - at_absorber * carried
        rows.append(split_re_im(order_slots(response, modes.values, size)))
    return np.concatenate(rows)


def _regime(
    modes: RegimeModes, guard: Complex, size: int, reach: float, base: Real | None = None
) -> LinearRegime:
    """Return a regime with sorted, padded and tabulated modes.

    ``base`` (2 C, J): the regime's rows from BASE on, if it has any.
    """
    rows = slot_rows(modes.values, modes.drive, modes.relative, guard, modes.tip, size)
    rows = rows if base is None else np.concatenate([rows, base])
    slots = ModalSystem(rows, *slot_tables(modes.values, size, reach))
    out = order_slots(modes.out, modes.values, size, 1)
    into = order_slots(modes.into, modes.values, size).T
    rest = rows[REST] + 1j * rows[REST + 1]
    return LinearRegime(
        slots,
        split_re_im(out),
        split_re_im(into),
        float(np.real(order_slots(modes.tip, modes.values, size) @ rest)),
    )


def order_slots(values: Complex, eigenvalues: Complex, size: int, axis: int = 0) -> Complex:
    """Return values in the order of growing |s|, padded with zeros to ``size``.

    There is one value for each slot along ``axis``.
    """
    order = np.argsort(np.abs(eigenvalues), kind="stable")
    shape = list(values.shape)
    shape[axis] = size
    ordered = np.zeros(shape, values.dtype)
    slots = [slice(None)] * values.ndim
    slots[axis] = slice(len(order))
    ordered[tuple(slots)] = np.take(values, order, axis=axis)
    return ordered


def split_re_im(values: Complex) -> Real:
    """Return real and imaginary parts, concatenated."""
    return np.ascontiguousarray([values.real, values.imag])


def _decaying(eigenvalues: Complex, size: int) -> Complex:
    """Return eigenvalues in order, padded with -1.

    Real parts above 0 are set to 0, so that rounding does not make an undamped slot grow.
    """
    s = order_slots(eigenvalues, eigenvalues, size)
    s = np.minimum(s.real, 0) + 1j * s.imag
    s[len(eigenvalues) :] = -1
    return s


def slot_rows(
    eigenvalues: Complex, drive: Complex, relative: Complex, guard: Complex, tip: Complex, size: int
) -> Real:
    """Return the rows of weights (..., ROWS, size) of a modal system.

    The arguments have values for each eigenvalue, in any order: ``eigenvalues`` and ``drive`` (J,),
    and ``relative``, ``guard`` and ``tip`` (..., J), one set of weights for each leading index.
    """
    used = len(eigenvalues)
    s = _decaying(eigenvalues, size)
    real = np.arange(size) < used
    taylor = (
        s ** np.arange(TAYLOR_TERMS)[:, None]
        / np.array([float(math.factorial(p)) for p in range(TAYLOR_TERMS)])[:, None]
    )
    taylor[1:, used:] = 0
    drive = order_slots(drive, eigenvalues, size)
    relative, guard, tip = (
        order_slots(values, eigenvalues, size, values.ndim - 1) for values in (relative, guard, tip)
    )
    pairs = [s, s**2, drive, relative, np.where(real, -relative / s, 0), guard, tip, *taylor[1:]]
    speed = np.where(real, np.abs(s), 0)
    parts = [part for pair in pairs for part in (pair.real, pair.imag)]
    parts += [speed, speed**2, speed**3]
    rows = np.empty((*relative.shape[:-1], len(parts), size))
    for row, part in enumerate(parts):
        rows[..., row, :] = part
    return rows


def slot_tables(
    eigenvalues: Complex, size: int, reach: float, speed: float | None = None
) -> tuple[Real, Real, Real, Real, Real, Real]:
    """Return table, scale, steps, waves, turns and errors of Slots.

    ``speed`` (1/s) is the largest |s| for which they are laid out (None: that of the eigenvalues).
    """
    used = len(eigenvalues)
    s = _decaying(eigenvalues, size)
    base, finest, table = propagators(s, used, reach, speed)
    scale = np.array([np.log2(base), finest, 1 / finest, np.max(np.abs(s[:used]))])
    return split_re_im(table), scale, *propagation_tables(s, used, reach, speed)


def basis_error(out: Complex, into: Complex, scale: Real) -> float:
    """Return the largest entry of Re(out into) less the identity.

    Each coordinate is multiplied by its ``scale``, so that squares are energies.
    """
    error = (np.real(out @ into) - np.eye(len(scale))) * scale[:, None] / scale
    return float(np.max(np.abs(error))) if np.all(np.isfinite(error)) else float("inf")


def require_complete(
    modes_for: Callable[[float], M] | None,
    error_of: Callable[[M], float],
    name: str,
    value: object,
    allowed: str,
    otherwise: Callable[[], M] | None = None,
) -> M:
    """Return the modes whose basis has the smallest error.

    Raise ParameterError if none is complete.

    ``modes_for(weak)`` returns modes for each kind of start values in `WEAK_COUPLINGS`,
    ``otherwise()`` returns further ones, and ``error_of`` returns the error of a basis. The message
    says that the parameter ``name`` with ``value`` is not ``allowed``.
    """
    best = None
    least = np.inf
    ways: list[Callable[[], M]] = []
    if modes_for is not None:
        ways += [partial(modes_for, weak) for weak in WEAK_COUPLINGS]
    if otherwise is not None:
        ways.append(otherwise)
    for way in ways:
        try:
            modes = way()
        except (np.linalg.LinAlgError, ValueError):
            continue
        error = error_of(modes)
        if error < least:
            best = modes
            least = error
        if error < BASIS_TOL:
            break
    if best is None or least > COMPLETENESS_TOL:
        raise ParameterError(
            f"{name} = {value} is not allowed: {allowed} (modal basis off by {least:.1e})"
        )
    return best


def _needed_of_mass(model: ModalModel, mass: float) -> str:
    """Return the text of what is allowed if no basis was found.

    It requires a mass that is light enough for accurate modes, or else no double eigenvalue.
    """
    mobility = float(np.sum(model.tip_shape**2))
    if mass * mobility <= MOST_HEAVINESS:
        return AWAY_FROM_DOUBLE
    most = MOST_HEAVINESS / mobility
    return (
        f"an absorber of at most {most / model.beam_mass:.1e} times the beam's mass: a tip that "
        "hardly moves has no digits"
    )


def _needed_of_spring(model: ModalModel, stiffness: float, damper: float) -> str:
    """Return the text of what is allowed if no basis was found.

    It requires a spring (N/m) and a damper (N s/m) that are soft enough for an accurate relative
    displacement, or else `AWAY_FROM_DOUBLE`.
    """
    first = float(model.omega[0])
    mobility = float(np.sum(model.tip_shape**2))
    if max(stiffness / first**2, damper / first) * mobility <= MOST_STIFFNESS_RATIO:
        return AWAY_FROM_DOUBLE
    most = MOST_STIFFNESS_RATIO * first**2 / mobility
    damped = MOST_STIFFNESS_RATIO * first / mobility
    limits = (
        f"{most:.1e} N/m and {damped:.1e} N s/m on this beam: a stretch that hardly changes has "
        "no digits"
    )
    return f"a contact stiffness, friction stiffness or absorber of at most about {limits}"


def _energy_scale(model: ModalModel, mass: float, stiffness: float | None) -> Real:
    """Return the factor of each coordinate of the state (2 N_m + 2,) for the norm of energy.

    It is 0 if the absorber has no coordinate of its own. An absorber has the factor of its own
    frequency on the spring, or of the beam's frequency nearest to it.
    """
    own = (
        0.0
        if stiffness is None
        else float(np.clip(np.sqrt(stiffness / mass), np.min(model.omega), np.max(model.omega)))
    )
    root = 0.0 if stiffness is None else float(np.sqrt(mass))
    return np.concatenate([model.omega, [own * root], np.ones(model.modes), [root]])


@lru_cache(maxsize=8)
def checked_modes(
    model: ModalModel, mass: float, stiffness: float | None, damper: float
) -> RegimeModes:
    """Return the modes of beam and absorber that span the state.

    Raise ParameterError if none do.
    """
    scale = _energy_scale(model, mass, stiffness)
    states = np.flatnonzero(scale)
    name = "mass_ratio"
    value = f"{mass / model.beam_mass:g}"
    allowed = _needed_of_mass(model, mass)
    if stiffness is not None:
        value = f"{value}, {stiffness:g} N/m, {damper:g} N s/m"
        allowed = _needed_of_spring(model, stiffness, damper)
        name = "mass_ratio, stiffness, damping"

    def spanned(modes: RegimeModes) -> float:
        return basis_error(modes.out[states], modes.into[:, states], scale[states])

    return require_complete(
        lambda weak: solve_coupled_modes(model, mass, stiffness, damper, weak),
        spanned,
        name,
        value,
        allowed,
    )


def free_regime(model: ModalModel, size: int, reach: float, *, moves: bool = False) -> LinearRegime:
    """Return the regime in which beam and absorber are apart.

    Its guard signal is the relative displacement absorber - tip, without the absorber's share.
    ``moves``: whether the base moves.
    """
    modes = solve_own_modes(model, np.arange(model.modes))
    return _regime(
        modes, modes.stretch, size, reach, base_rows(modes, model, size, None) if moves else None
    )


def joined_regime(
    model: ModalModel,
    mass: float,
    size: int,
    reach: float,
    *,
    moves: bool = False,
    heavy: bool = False,
) -> LinearRegime:
    """Return the regime of an absorber (kg) that moves with the tip.

    Its guard signal is the force on the absorber, mass times tip acceleration. ``moves``: whether
    the base moves; ``heavy``: whether the constant force is the absorber's weight.
    """
    modes = checked_modes(model, mass, None, 0.0)
    carried = carried_response(modes, model, mass, spring=False)
    base = base_rows(modes, model, size, carried) if moves else None
    return _regime(
        with_weight(modes, carried) if heavy else modes,
        mass * modes.values**2 * modes.tip,
        size,
        reach,
        base,
    )


def sprung_regime(
    model: ModalModel,
    mass: float,
    stiffness: float,
    damper: float,
    size: int,
    reach: float,
    *,
    moves: bool = False,
    heavy: bool = False,
) -> LinearRegime:
    """Return the regime of an absorber (kg) on a spring (N/m) and a damper (N s/m).

    Its guard signal is the relative displacement absorber - tip. ``moves`` and ``heavy`` are as in
    `joined_regime`.
    """
    modes = checked_modes(model, mass, stiffness, damper)
    carried = carried_response(modes, model, mass, spring=True)
    base = base_rows(modes, model, size, carried) if moves else None
    return _regime(
        with_weight(modes, carried) if heavy else modes, modes.stretch, size, reach, base
    )


def find_fastest(
    model: ModalModel,
    mass: float | None = None,
    stiffness: float | None = None,
    damper: float = 0.0,
) -> tuple[float, int]:
    """Return the largest |s| in 1/s and the number of slots of a regime.

    The regime is free if ``mass`` is None, else joined, or on a spring if ``stiffness`` is given.
    """
    modes = (
        solve_own_modes(model, np.arange(model.modes))
        if mass is None
        else checked_modes(model, mass, stiffness, damper)
    )
    return float(np.max(np.abs(modes.values))), len(modes.values)


MAX_BASE = 256
COARSEST = 16.0  # largest step of the event search: a share of the tables' reach
FINEST_PHASE = 0.08  # |s| h of the fastest slot at the finest level, at most


def table_reach(fastest: float, wanted: float) -> float:
    """Return the time offset in s that the tables cover.

    It is ``wanted``, or less if the fastest slot (1/s) rotates too quickly for the tables.
    """
    return min(wanted, TAYLOR_REACH * MAX_BASE**3 / fastest)


def propagators(
    values: Complex, used: int, reach: float, speed: float | None = None
) -> tuple[int, float, Complex]:
    """Return base, finest step (s) and exp(s h) (3, base, J) of the three-digit tables.

    Slots from ``used`` on are empty. ``speed`` (1/s) is the |s| for which the steps are chosen
    (None: the largest one).
    """
    fastest = np.max(np.abs(values[:used])) if speed is None else speed
    base = 4
    while base**3 * TAYLOR_REACH < reach * fastest * (1 - 1e-12):
        base *= 2
    finest = reach / base**3
    steps = finest * np.array([base**2, base, 1])
    table = np.exp(values * steps[:, None, None] * np.arange(base)[:, None])
    table[:, :, used:] = 1
    return base, finest, table


def propagation_tables(
    values: Complex, used: int, reach: float, speed: float | None = None
) -> tuple[Real, Real, Real, Real]:
    """Return the tables of the event search, the finest level first.

    They are steps (L, 2), waves (L, J, 2, POINTS), turns (L, POINTS, 2, J) and errors (L, J). An
    error is the largest difference of a slot's signal from its interpolation, relative to its
    amplitude (see kernels/events/search.py). ``speed`` is as in `propagators`.
    """
    speeds = np.abs(values)
    fastest = np.max(speeds[:used]) if speed is None else speed
    count = 1 + max(
        0, int(np.ceil(np.log(fastest * reach / COARSEST / FINEST_PHASE) / np.log(LEVEL_RATIO)))
    )
    h = reach / COARSEST / LEVEL_RATIO ** np.arange(count - 1, -1, -1.0)
    share = (speeds * h[:, None]) ** 4 * HERMITE_SHARE
    share[:, used:] = 0
    summed = np.sum(share[:, :used] < 1, axis=1)
    wave = np.exp(values[:, None] * (h[:, None, None] * np.arange(1, POINTS + 1)))
    waves = np.stack([wave.real, wave.imag], axis=2)
    turns = np.stack([part.transpose(0, 2, 1) for part in (wave.real, wave.imag)], axis=2)
    return (
        np.column_stack([h, summed]),
        np.ascontiguousarray(waves),
        np.ascontiguousarray(turns),
        np.minimum(share, 1) + SCAN_NOISE,
    )
