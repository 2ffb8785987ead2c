"""Linear regimes of several absorbers, one for each set of joined absorbers.

Joined absorbers move with the beam. A regime is computed when a run first needs it
(kernels/exact/sets.py). The masses of the set are a low-rank change of the mass matrix; eigenvalues
and eigenvectors are computed as in secular.py.
"""

import ctypes
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg

from impact_env.checks import ParameterError
from impact_env.force_channels import find_base_shapes
from impact_env.kernels.compiling.records import new_record
from impact_env.kernels.exact.sets import SET_REQUEST, Sets
from impact_env.kernels.motion.modal_system import GUARD, RELATIVE, REST, TIP, S
from impact_env.modes import ModalModel, with_masses
from impact_env.regimes import (
    BASIS_TOL,
    basis_error,
    order_slots,
    padded_size,
    quadratic_modes,
    require_complete,
    slot_rows,
    slot_tables,
    solve_eigenproblem,
    solve_own_modes,
    split_modes,
    split_re_im,
    table_reach,
)
from impact_env.secular import Complex, Coupling, Index, Real, concatenate

MOST_SECULAR = 4  # masses up to which eigenvalues are solved for one by one, to all digits
EQUAL_VALUES_TOL = 1e-9  # of an eigenvalue: closer ones count as one that occurs several times
# damping and spread of frequencies up to which modes are found from those without damping; steps on
# the way, and the last one's size
MOST_LIGHT_RATE = 0.2  # of a frequency: a damping ratio of 10 %
MOST_LIGHT_SPREAD = (
    30.0  # its square is how many times the rounding of the highest mode counts for the lowest
)
MOST_LIGHT_STEPS = 30
LIGHT_TOL = 2e-15
MIXING_ROUNDING = 1e-13  # of the largest damping: smaller entries are rounding


@dataclass(frozen=True)
class SetModes:
    """Modes of a set of p joined absorbers, J of them.

    Attributes
    ----------
    values : array, (J,)
        Eigenvalues in 1/s.
    shapes : array, (J, N_m)
        Eigenvectors over the beam's modes.
    into : array, (J, 2 N_m)
        Amplitudes per unit modal displacement and velocity.
    weights : array, (J, N_m)
        Responses to unit modal forces.
    places : array, (J, p)
        Displacements of the masses.
    """

    values: Complex
    shapes: Complex
    into: Complex
    weights: Complex
    places: Complex


def _double(values: Complex) -> Real:
    """Return 2 for a complex eigenvalue and 1 for a real one, (J,).

    A complex eigenvalue stands for a conjugate pair.
    """
    return np.where(values.imag == 0, 1.0, 2.0)


def _solve_uncoupled(model: ModalModel, which: Index, masses: int) -> SetModes:
    modes = solve_own_modes(model, which)
    n = model.modes
    shapes = modes.out[:n].T / _double(modes.values)[:, None]
    into = np.delete(modes.into, [n, 2 * n + 1], axis=1)
    return SetModes(
        modes.values, shapes, into, into[:, n:], np.zeros((len(shapes), masses), complex)
    )


def _solve_coupled(model: ModalModel, masses: Real, shapes: Real, weak: float) -> SetModes:
    """Return the modes of beam and masses; ``weak``: see `eigenvalues.solve_eigenproblem`."""
    which, own = split_modes(shapes)
    c = Coupling(
        model.omega[which],
        model.damping_ratio[which],
        (np.sqrt(masses)[:, None] * shapes)[:, which],
        sprung=False,
    )
    e = solve_eigenproblem(c, weak)
    n = model.modes
    v = np.zeros((len(e.s), n), complex)
    to = np.zeros((len(e.s), 2 * n), complex)
    weights = np.zeros((len(e.s), n), complex)
    v[:, which] = e.v
    weights[:, which] = e.by_force
    to[:, which] = e.by_displacement
    to[:, n + which] = e.by_velocity
    coupled = SetModes(e.s, v, to, weights, e.z / np.sqrt(masses))
    return concatenate([coupled, _solve_uncoupled(model, own, len(masses))])


def _solve_coupled_densely(model: ModalModel, masses: Real, shapes: Real) -> SetModes:
    """Return the modes of beam and masses by a dense eigensolver.

    It is also accurate for coincident eigenvalues, such as those of a ring of equal sectors. An
    eigenvalue that occurs g times has g eigenvectors. Left eigenvectors are the dual basis: the
    matrix v_i^T ((s_i + s_j) M + C) v_j is diagonal up to rounding errors, which close eigenvalues
    magnify, and is inverted as a whole. The relative error is at most rounding times the ratio of
    the largest to the smallest frequency.
    """
    which, own = split_modes(shapes)
    omega = model.omega[which]
    rate = 2 * model.damping_ratio[which] * omega
    coupling = np.sqrt(masses)[:, None] * shapes[:, which]
    mass = np.eye(len(which)) + coupling.T @ coupling
    values, vectors = quadratic_modes(mass, np.diag(rate), np.diag(omega**2))
    order = np.lexsort((values.real, values.imag))
    values = values[order]
    vectors = vectors[:, order]
    groups = np.split(
        np.arange(len(values)),
        1 + np.flatnonzero(np.abs(np.diff(values)) > EQUAL_VALUES_TOL * np.abs(values[1:])),
    )
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    for group in groups:
        if len(group) > 1:
            values[group] = np.mean(values[group])
            vectors[:, group] = np.linalg.qr(vectors[:, group])[0]
    pairs = vectors.T @ mass @ vectors * (values[:, None] + values)
    pairs = pairs + vectors.T @ (rate[:, None] * vectors)
    left = np.linalg.solve(pairs, vectors.T)
    by_displacement = np.linalg.solve(pairs, vectors.T @ mass * values[:, None] + vectors.T * rate)
    n = model.modes
    v = np.zeros((len(values), n), complex)
    weights = np.zeros((len(values), n), complex)
    into = np.zeros((len(values), 2 * n), complex)
    v[:, which] = vectors.T
    weights[:, which] = left
    into[:, which] = by_displacement
    into[:, n + which] = left @ mass
    places = np.asarray(v @ shapes.T, dtype=np.complex128)
    coupled = SetModes(values, v, into, weights, places)
    return concatenate([coupled, _solve_uncoupled(model, own, len(masses))])


def _basis_error(model: ModalModel, modes: SetModes) -> float:
    """Return the error, in terms of energy, with which modes span the state."""
    scale = np.append(model.omega, np.ones(model.modes))
    shapes = modes.shapes * _double(modes.values)[:, None]
    out = np.concatenate([shapes, shapes * modes.values[:, None]], axis=1).T
    return basis_error(out, modes.into, scale)


def _solve_lightly_damped(model: ModalModel, masses: Real, shapes: Real) -> SetModes | None:
    """Return the modes of beam and masses from those without damping.

    The result is None if these are not a good start. In the undamped modes the damping matrix has
    small entries off its diagonal. A fixed point of (s_i^2 + s_i c_jj + lambda_j) y_ji = -s_i sum_k
    c_jk y_ki with y_ii = 1 is an eigenvector; in each step the error falls by the ratio of these
    entries to the distance of the frequencies. Because the matrices are symmetric, left and right
    eigenvectors are equal. Only one symmetric eigenproblem of N_m rows takes a time proportional to
    N_m^3.
    """
    which, own = split_modes(shapes)
    omega = model.omega[which]
    rate = 2 * model.damping_ratio[which] * omega
    if np.any(rate > MOST_LIGHT_RATE * omega) or np.max(omega) > MOST_LIGHT_SPREAD * np.min(omega):
        return None
    coupling = np.sqrt(masses)[:, None] * shapes[:, which]
    mass = np.eye(len(which)) + coupling.T @ coupling
    squares, undamped = scipy.linalg.eigh(np.diag(omega**2), mass)
    damping = undamped.T @ (rate[:, None] * undamped)
    diagonal = np.diag(damping).copy()
    mixing = damping - np.diag(diagonal)
    mixing[np.abs(mixing) < MIXING_ROUNDING * np.max(diagonal)] = 0.0
    equal = np.abs(squares[:, None] - squares) <= EQUAL_VALUES_TOL * squares
    if np.any(mixing[equal]):
        return None
    shares = np.eye(len(squares), dtype=np.complex128)
    for _ in range(MOST_LIGHT_STEPS):
        mixed = mixing @ shares
        drag = diagonal + np.diag(mixed)
        values = -drag / 2 + 1j * np.sqrt(squares - drag**2 / 4)
        apart = values * (values + diagonal[:, None]) + squares[:, None]
        apart[equal] = 1.0
        mixed[equal] = 0.0
        following = np.eye(len(squares)) - mixed * values / apart
        change = np.max(np.abs(following - shares))
        shares = following
        if change < LIGHT_TOL:
            break
    else:
        return None
    norms = 2 * values * np.sum(shares**2, axis=0) + np.sum(shares * (damping @ shares), axis=0)
    vectors = undamped @ shares
    left = (vectors / norms).T
    n = model.modes
    v = np.zeros((len(values), n), complex)
    weights = np.zeros((len(values), n), complex)
    into = np.zeros((len(values), 2 * n), complex)
    inertia = left @ mass
    v[:, which] = vectors.T
    weights[:, which] = left
    into[:, which] = values[:, None] * inertia + left * rate
    into[:, n + which] = inertia
    places = np.asarray(v @ shapes.T, dtype=np.complex128)
    coupled = SetModes(values, v, into, weights, places)
    return concatenate([coupled, _solve_uncoupled(model, own, len(masses))])


def solve_set_modes(
    model: ModalModel, masses: Real, shapes: Real, quickly: bool = False
) -> SetModes:
    """Return the modes of a beam that carries masses.

    ``masses`` (p,) in kg are at places with ``shapes`` (p, N_m). Without masses the modes are those
    of the free beam. ``quickly``: by `_solve_lightly_damped` if its error is below `BASIS_TOL`.
    Raises ParameterError if two eigenvalues (almost) coincide, so that there is no modal basis.
    """
    if len(masses) == 0:
        return _solve_uncoupled(model, np.arange(model.modes), 0)
    if quickly:
        light = _solve_lightly_damped(model, masses, shapes)
        if light is not None and _basis_error(model, light) < BASIS_TOL:
            return light
    densely = partial(_solve_coupled_densely, model, masses, shapes)
    kilograms = f"{[float(m) for m in masses]} kg"
    allowed = "damping, masses and positions away from a double eigenvalue"
    return require_complete(
        None if len(masses) > MOST_SECULAR else partial(_solve_coupled, model, masses, shapes),
        partial(_basis_error, model),
        "mass_ratio of several absorbers",
        kilograms,
        allowed,
        densely,
    )


def _maps(modes: SetModes, joined: list[int], shapes: Real, size: int) -> tuple[Real, Real]:
    """Return the maps of `segments.LinearRegime`.

    A joined absorber has the beam's displacement at its place.
    """
    n = modes.shapes.shape[1]
    absorbers = len(shapes)
    half = n + absorbers
    displacement = np.zeros((len(modes.values), half), complex)
    displacement[:, :n] = modes.shapes
    displacement[:, n + np.array(joined, dtype=int)] = modes.places
    out = np.concatenate([displacement, displacement * modes.values[:, None]], axis=1).T * _double(
        modes.values
    ).astype(complex)
    into = np.zeros((len(modes.values), 2 * half), complex)
    into[:, :n], into[:, half : half + n] = modes.into[:, :n], modes.into[:, n:]
    return split_re_im(order_slots(out, modes.values, size, 1)), split_re_im(
        order_slots(into, modes.values, size).T
    )


def _rows(
    model: ModalModel,
    modes: SetModes,
    joined: list[int],
    masses: Real,
    shapes: Real,
    size: int,
    moves: bool,
) -> Real:
    """Return the rows of weights (n + 1, ROWS, J) of a set.

    If the bases ``move``, the rows are (n + 1, ROWS + 2 C, J) for the C bases of
    `find_base_shapes`.
    """
    s = modes.values
    n = len(masses)
    at_places = modes.shapes @ np.vstack([shapes, model.tip_shape]).T
    at_places[:, joined] = modes.places
    at_places *= _double(s)[:, None]
    tip = np.ascontiguousarray(at_places.T)
    relative = np.zeros((n + 1, len(s)), complex)
    guard = np.zeros((n + 1, len(s)), complex)
    for a in range(n):
        relative[a] = -modes.weights @ shapes[a]
        guard[a] = masses[a] * s**2 * tip[a] if a in joined else -tip[a]
    rows = slot_rows(s, modes.weights @ model.force_shape, relative, guard, tip, size)
    if not moves:
        return rows
    participation, at_absorber = find_base_shapes(model)
    carried = masses[joined] @ shapes[joined]
    base = np.concatenate(
        [
            split_re_im(order_slots(-(modes.weights @ (own + share * carried)), s, size))
            for own, share in zip(participation, at_absorber, strict=True)
        ]
    )
    return np.concatenate([rows, np.broadcast_to(base, (n + 1, *base.shape))], axis=1)


@dataclass(frozen=True)
class SetLayout:
    """Common properties of the regimes of all sets of a scene.

    Attributes
    ----------
    size : int
        Number J of modal amplitudes of each, including empty ones.
    speed : float
        Largest |s| in 1/s.
    reach : float
        Time in s that their tables cover.
    """

    size: int
    speed: float
    reach: float


ALL_SETS_COUNT = 4  # absorbers up to which the layout is that of all sets
MOST_PLACE_BYTES = 32 * 2**20  # of the regimes that a run holds at a time
LEAST_PLACES = 4
SPEED_TOL = 1e-9  # of the layout's speed: by how much a regime may exceed it
Joined = tuple[int, ...]


def find_set_layout(model: ModalModel, shapes: Real, masses: Real, wanted: float) -> SetLayout:
    """Return the layout of the regimes of absorbers.

    The absorbers have ``masses`` (n,) in kg at ``shapes`` (n, N_m). The tables cover ``wanted`` s
    or less. For up to four absorbers all sets are computed; otherwise only the sets of no and of
    all absorbers, because masses lower frequencies, and because each mode has one pair of
    eigenvalues if damping is below critical. Raises ParameterError if a set has no modal basis.
    """
    n = len(masses)
    counts = range(n + 1) if n <= ALL_SETS_COUNT else (0, n)
    sets = (list(joined) for count in counts for joined in itertools.combinations(range(n), count))
    quickly = n > ALL_SETS_COUNT
    every = [
        solve_set_modes(model, masses[joined], shapes[joined], quickly).values for joined in sets
    ]
    speed = max(float(np.max(np.abs(values))) for values in every)
    return SetLayout(padded_size(max(map(len, every))), speed, table_reach(speed, wanted))


def build_set_regime(
    model: ModalModel,
    shapes: Real,
    masses: Real,
    joined: Joined,
    layout: SetLayout,
    moves: bool = False,
) -> tuple[Real, ...]:
    """Return the arrays of `sets.Sets`, from ``rows`` to ``acceleration_bound``, of a set.

    ``joined`` are the set's absorbers. ``moves``: whether the base moves. Raises ParameterError if
    the set has no modal basis, or does not fit the layout.
    """
    which = list(joined)
    quickly = len(masses) > ALL_SETS_COUNT
    modes = solve_set_modes(model, masses[which], shapes[which], quickly)
    fastest = float(np.max(np.abs(modes.values)))
    if len(modes.values) > layout.size or fastest > layout.speed * (1 + SPEED_TOL):
        raise ParameterError(
            f"damping_ratio = {float(np.max(model.damping_ratio)):g} (the largest) is not "
            f"allowed: smaller with more than {ALL_SETS_COUNT} absorbers"
            f" (those numbered {which}, counted from 0, change the modes too much where they stick)"
        )
    rows = _rows(model, modes, which, masses, shapes, layout.size, moves)
    guard, push, s = (np.abs(rows[:, row] + 1j * rows[:, row + 1]) for row in (GUARD, RELATIVE, S))
    rate = guard[:-1] * s[:-1]
    # displacement (n + 1, n) in m/N of each place under a constant force on each absorber and its
    # reaction on the beam
    tip, rest = (rows[:, row] + 1j * rows[:, row + 1] for row in (TIP, REST))
    static = np.ascontiguousarray(np.real(tip @ rest[:-1].T))
    return (
        rows,
        *slot_tables(modes.values, layout.size, layout.reach, layout.speed),
        *_maps(modes, which, shapes, layout.size),
        static,
        _compliance(masses, shapes, which),
        rate @ push[:-1].T,
        (rate * s[:-1]) @ push[:-1].T,
    )


class RegimePlaces:
    """Storage of one run for the regimes of sets.

    ``sets`` is the argument of the run's kernel, which requests the regime of a set if it is not
    stored. ``build`` returns the arrays of a set, as `build_set_regime`. A new set replaces the
    least recently used one, except the set without joined absorbers, which is the first. ``error``
    is an error of ``build`` or a KeyboardInterrupt, which the caller of the kernel raises.
    """

    def __init__(self, absorbers: int, build: Callable[[Joined], tuple[Real, ...]]) -> None:
        self._build = build
        free = build(())
        count = min(MOST_PLACE_BYTES // sum(array.nbytes for array in free), 2**absorbers)
        count = max(int(count), min(LEAST_PLACES, 2**absorbers))
        self._function = ctypes.CFUNCTYPE(None)(self._fill)  # as long as a kernel may call it
        address = ctypes.cast(self._function, ctypes.c_void_p).value or 0
        self._arrays = [np.empty((count, *array.shape)) for array in free]
        places = (
            np.zeros((count, absorbers), np.bool_),
            np.zeros(count, np.int64),
            np.zeros(count, np.int64),
            np.zeros(absorbers, np.bool_),
            new_record(SET_REQUEST, fill_address=address),
        )
        self.sets = Sets._make([*self._arrays, *places])
        self.error: BaseException | None = None
        self._put(0, free)

    def _put(self, place: int, regime: tuple[Real, ...]) -> None:
        for array, own in zip(self._arrays, regime, strict=True):
            array[place] = own
        sets = self.sets
        sets.joined[place] = sets.wanted
        sets.request["uses"] += 1
        sets.last_use[place] = sets.request["uses"]
        sets.last_fill[place] += 1
        sets.request["place"] = place

    def _fill(self) -> None:
        sets = self.sets
        try:
            regime = self._build(tuple(np.flatnonzero(sets.wanted).tolist()))
            self._put(1 + int(np.argmin(sets.last_use[1:])), regime)
        except BaseException as error:  # a function that compiled code calls cannot raise
            self.error = error
            sets.request["failed"] = True
            sets.request["place"] = 0


def _compliance(masses: Real, shapes: Real, joined: list[int]) -> Real:
    """Return the relative acceleration (n, n) of each absorber per unit force on each, in 1/kg.

    The absorbers of ``joined`` move with the beam.
    """
    mass = with_masses(shapes[joined], masses[joined])
    return np.ascontiguousarray(shapes @ np.linalg.solve(mass, shapes.T) + np.diag(1 / masses))
