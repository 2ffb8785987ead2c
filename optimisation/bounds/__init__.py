"""Limits that no device of a mass and a cavity can beat, and the design rule from them.

They also give the share of the possible reduction that a design reaches.

`optimisation.bounds.relaxation` holds the passive limit by semidefinite programming; it needs cvxpy
and is imported on its own.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import (
    LARGE,
    finite,
    instance,
    non_negative,
    numbers,
    positive,
    require,
    table_of,
)
from impact_env.frequency import frequency_range
from impact_env.modes import ModalModel, with_masses
from impact_env.parameters import DEFAULT_MASS_RATIO
from optimisation.tuned import highest_amplitude

# The spectral line of a beam that carries masses in cavities: what the limits are made of.
#
# Masses m_k (k = 1..n) move at places of the beam with mode shapes phi_k; r_k is a mass's
# displacement minus that of its place. Whatever happens between them, the beam feels minus the mass
# times its acceleration. The beam is linear, so at the forcing frequency Omega its modal line y
# obeys
#
#     H y = f p + Omega^2 sum_k m_k phi_k r_k,
#     H = diag(omega_i^2 - Omega^2 + 2 i D_i omega_i Omega) - Omega^2 sum_k m_k phi_k phi_k^T,
#
# H being the dynamic stiffness of the beam with all masses stuck to it, p the force's shape. The
# line of any place e is e y = f A + sum_k B_k r_k. For one mass, at its own place, A = G_f/(1 -
# kappa) and B = kappa/(1 - kappa) with the free beam's receptances G_f, G_t and kappa = G_t m_a
# Omega^2.


Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

# H is singular if it is this close to it, over the size of the terms that it is the sum of
SINGULAR = 1e-14


@dataclass(frozen=True)
class Lines:
    """Spectral line of the displacement at a place: shares of the force and of the strokes.

    ``force``: A in m/N, shape (...). ``strokes``: B_k, shape (..., n). Both are divided by
    ``scale``, shape (...), which is infinite at an undamped resonance and 1 elsewhere.
    """

    force: Complex
    strokes: Complex
    scale: Real


def places(model: ModalModel) -> Real:
    """Return the mode shapes at the absorbers' places, (n, N_m).

    For a model without places of several absorbers this is the mode shape at the tip, with n = 1.
    """
    return (
        model.tip_shape[None, :]
        if model.absorber_shapes is None
        else np.asarray(model.absorber_shapes)
    )


def masses_of(model: ModalModel, mass: ArrayLike) -> Real:
    """Return the masses in kg, (n,).

    Raises ParameterError unless there is one mass above 0 for each of the model's places.
    """
    return _each(model, "mass", mass)


def strokes_of(model: ModalModel, gap: ArrayLike) -> Real:
    """Return R = 4 g0/pi in m, (n,), for gaps in m.

    R is the largest amplitude of a spectral line of a signal within +-g0.
    """
    return 4 * _each(model, "gap", gap) / np.pi


MOST_MASSES = 1e6  # of the structure's: beyond that its matrices have no digits left


def _each(model: ModalModel, name: str, values: ArrayLike) -> Real:
    array = numbers(name, values, "numbers above 0")
    wanted = len(places(model))
    require(
        array.shape == (wanted,) or (wanted == 1 and array.shape == ()),
        name,
        values,
        f"{wanted} of them, one for each absorber of the model",
    )
    most = MOST_MASSES * model.beam_mass if name == "mass" else LARGE
    return np.array([positive(name, value, most=most) for value in array.ravel()])


def output_shape(model: ModalModel, at: ArrayLike | None) -> Real:
    """Return the mode shape (N_m,) at the place of the response level.

    It is ``at`` if given, else that of the model.
    """
    row = model.level_shape if at is None else numbers("tip_shape", at, "finite modal amplitudes")
    ok = row.shape == (model.modes,) and bool(np.all(np.isfinite(row)) and np.any(row != 0))
    require(
        ok,
        "tip_shape",
        row,
        f"{model.modes} finite modal amplitudes in 1/sqrt(kg), at least one of them other than 0",
    )
    return row


def lines(model: ModalModel, masses: Real, omega: ArrayLike, at: Real) -> Lines:
    """Return the spectral line at a place with mode shape ``at`` (N_m,).

    ``masses`` (n,) are in kg, the frequencies ``omega`` in rad/s have any shape.
    """
    w = numbers("omega", omega, "finite frequencies in rad/s, 0 or above")
    require(
        bool(np.all(np.isfinite(w) & (w >= 0))),
        "omega",
        omega,
        "finite frequencies in rad/s, 0 or above",
    )
    # in units in which each mode's stiffness is 1, so that high modes do not drown the others
    shapes = places(model) / model.omega
    force = model.one_phase_force_shape / model.omega
    row = at / model.omega
    ratio = w[..., None] / model.omega
    inertia = (shapes.T * masses) @ shapes
    matrix = np.asarray(-(w[..., None, None] ** 2) * inertia, dtype=np.complex128)
    matrix[..., np.arange(model.modes), np.arange(model.modes)] += (
        1 - ratio**2 + 2j * model.damping_ratio * ratio
    )
    answer, scale = _solve(matrix, row, 1 + np.max(ratio**2, axis=-1) + w**2 * np.trace(inertia))
    return Lines(answer @ force, (answer @ shapes.T) * masses * w[..., None] ** 2, scale)


def _solve(matrix: Complex, row: Real, size: Real) -> tuple[Complex, Real]:
    """Return row H^-1 (..., N) of symmetric matrices H and a scale, 1 if H is regular.

    At an undamped resonance the first result is the eigenvector along which row H^-1 grows, and the
    scale is infinity. ``size`` (...) is the size of the terms whose sum is a matrix.
    """
    try:
        answer = np.linalg.solve(
            matrix, np.broadcast_to(row.astype(complex)[:, None], (*matrix.shape[:-1], 1))
        )[..., 0]
    except np.linalg.LinAlgError:
        # one of them is singular to the last bit: changed by a rounding error it is regular, and
        # the same to all digits
        shift = np.finfo(float).eps * np.asarray(size)[..., None, None]
        return _solve(matrix + shift * np.eye(len(row)), row, size)
    growth = np.linalg.norm(answer, axis=-1) / np.linalg.norm(row)
    infinite = growth * size * SINGULAR > 1
    return np.where(infinite[..., None], answer / growth[..., None], answer), np.where(
        infinite, np.inf, 1.0
    )


def stuck_frequencies(model: ModalModel, masses: Real) -> Real:
    """Return the undamped natural frequencies of the structure with stuck absorbers.

    They are in rad/s in ascending order, for ``masses`` (n,) in kg at the model's places.
    """
    shapes = places(model)
    return np.asarray(
        np.sqrt(scipy.linalg.eigvalsh(np.diag(model.omega**2), with_masses(shapes, masses)))
    )


# A limit that no device in a cavity can beat, in closed form.
#
# A mass m_a moves in a cavity of half-clearance g0; r = its displacement minus that of its place,
# |r(t)| <= g0 at all times. The beam is linear, so the spectral line at the forcing frequency Omega
# of a stationary response is q = f A + B r, whatever the other lines do (`optimisation.bounds`,
# which also has the sum over several masses). A signal that never leaves [-g0, g0] has at most the
# line of a square wave: |r| = 2 |mean of r(t) exp(-i Omega t)| <= 2 g0 mean|cos| = 4 g0/pi = R. The
# best devices can do with the phases of their r is to oppose f A, and all other lines only add to
# the mean square. Therefore, at any place of the beam,
#
#     RMS(q) >= max(0, f |A| - sum_k |B_k| R_k) / sqrt(2).
#
# What is assumed: a linear beam with these modes; a harmonic force of constant amplitude and
# frequency; a stationary response (periodic, modulated or chaotic, RMS and line taken over the same
# long time); devices that act on the beam only at their places and only through their own masses;
# rigid walls (compliant ones let |r| exceed g0). Active devices are included. The response level of
# a sweep is another quantity, a windowed RMS around a maximum while the frequency moves: it lies
# near a stationary RMS, but nothing keeps it above this limit. Where "cannot be beaten" is the
# claim, compare with stationary runs.
#
# That a device is passive does not sharpen the limit of the level at its own place. A passive
# device feeds no power into the beam, and the beam only dissipates at all other lines, so Im(r
# conj(q)) <= 0 at this one. The best r above makes q = (1 - s) f A, r = -s f A/B and s = R |B|/|f
# A| < 1, so Im(r conj(q)) = s (1 - s) |f A|^2 Im(B)/|B|^2, and Im(B) = Im(kappa)/|1 - kappa|^2 <= 0
# because the free beam is passive itself. Read at another place the best stroke may feed power into
# the beam; `optimisation.bounds.relaxation` solves the problem with both constraints.


SWEPT = (0.9, 1.06)  # of the resonance frequency, the paper's sweep limits

GRID = 321


def _amplitudes(name: str, values: ArrayLike, allowed: str = "finite numbers, 0 or above") -> Real:
    array = numbers(name, values, allowed)
    require(bool(np.all(np.isfinite(array) & (array >= 0))), name, values, allowed)
    return array


def line_terms(
    model: ModalModel,
    mass: ArrayLike,
    gap: ArrayLike,
    omega: ArrayLike,
    at: ArrayLike | None = None,
) -> tuple[Real, Real, Real]:
    """Return |A| in m/N, sum |B_k| R_k in m, and the scale of both, each of omega's shape.

    The first two are to be multiplied by the scale (`Lines`).
    """
    terms = lines(model, masses_of(model, mass), omega, output_shape(model, at))
    return (
        np.abs(terms.force),
        np.asarray(np.abs(terms.strokes) @ strokes_of(model, gap)),
        terms.scale,
    )


def _rms(force: ArrayLike, terms: tuple[Real, Real, Real]) -> Real:
    by_force, reach, scale = terms
    excess = np.asarray(force) * by_force - reach
    return np.asarray(
        np.where(excess > 0, excess, 0.0) * np.where(excess > 0, scale, 1.0) / np.sqrt(2)
    )


def stroke_limit_rms(
    model: ModalModel,
    mass: ArrayLike,
    gap: ArrayLike,
    force_amplitude: ArrayLike,
    omega: ArrayLike,
    at: ArrayLike | None = None,
) -> Real:
    """Return the lower bound of the stationary RMS displacement in m of any device in a cavity.

    It has the broadcast shape of force and frequency. ``mass`` m_a is in kg and ``gap`` g0 in m,
    (n,) each if the model has the places of n absorbers; ``force_amplitude`` f is in N and
    ``omega`` in rad/s; ``at`` (N_m,) is the mode shape in 1/sqrt(kg) at the place of the
    displacement, by default the tip. The comment above has the derivation and the assumptions. The
    bound is proportional to a common factor of gaps and force. Raises ParameterError for numbers
    out of range.
    """
    model = instance("model", model, ModalModel)
    return _rms(
        _amplitudes("force_amplitude", force_amplitude), line_terms(model, mass, gap, omega, at)
    )


def resonance_limit(
    model: ModalModel,
    mass: ArrayLike,
    gap: ArrayLike,
    force: ArrayLike,
    resonance: int = 1,
    low: float = SWEPT[0],
    high: float = SWEPT[1],
    at: ArrayLike | None = None,
) -> Real:
    """Return the largest `stroke_limit_rms` in m over low..high times omega_r, of force's shape.

    ``force`` is in N; the other arguments are as in `stroke_limit_rms`. Every device has a
    stationary level at least as high somewhere in this range. The level of a sweep is a windowed
    RMS of a transient, and the limit is only an estimate for it.
    """
    model = instance("model", model, ModalModel)
    forces = _amplitudes("force", force)
    omega_r, (low, high) = model.resonance_omega(resonance), frequency_range(low, high)
    stuck = stuck_frequencies(model, masses_of(model, mass)) / omega_r
    # the limit is largest where the masses move with the beam, however narrow that resonance is
    grid = np.union1d(np.linspace(low, high, GRID), stuck[(stuck > low) & (stuck < high)])
    terms = line_terms(model, mass, gap, grid * omega_r, at)
    largest = []
    for amplitude in forces.ravel().tolist():
        limits = _rms(amplitude, terms)
        value = float(limits.max())
        if np.isfinite(value):
            value = -smallest(
                lambda x, f=amplitude: (  # type: ignore[misc]
                    -float(_rms(f, line_terms(model, mass, gap, x * omega_r, at)))
                ),
                grid,
                -limits,
            )[0]
        largest.append(value)
    return np.array(largest).reshape(forces.shape)


def smallest(function: Callable[[float], float], grid: Real, values: Real) -> tuple[float, float]:
    """Return the smallest value of a function and its argument.

    They are refined around the smallest of the ``values`` of the function on ``grid``.
    """
    at = int(np.argmin(values))
    on_grid = (float(values[at]), float(grid[at]))
    if at in (0, len(grid) - 1):
        return on_grid
    bounds = (float(grid[at - 1]), float(grid[at + 1]))
    minimum = scipy.optimize.minimize_scalar(
        function, bounds=bounds, method="bounded", options={"xatol": 1e-10}
    )
    return min(on_grid, (float(minimum.fun), float(minimum.x)))


# The design rule: the limit leaves zero at the force f*, and the gap that puts f* at a wanted force
# follows without simulation.


# of the resonance frequency, where `design_force` asks for the limit to be zero, for a mass like
# the paper's
NEAR = (
    0.93,
    1.06,
)
# free amplitude over the rule's gap: below the first the rule's cavity is not filled, below the
# second the best gap is narrower, above the third it is wider
LEAST_REACH = 1.0
SMALL_REACH = 1.5
LARGE_REACH = 6.0
# damping ratios between which `expected_factor` grows
LIGHT_DAMPING = 0.005
LEAST_DAMPING = 0.0015
_LEAST = 0.5  # of the resonance with the mass stuck: where the range begins at the lowest


def near_range(model: ModalModel, mass: float, resonance: int = 1) -> tuple[float, float]:
    """Return the default (low, high) of `design_force` in units of omega_r.

    It is `NEAR` for the paper's mass ratio, scaled for another ``mass`` in kg. An absorber
    influences a resonance within a few times the frequency shift by its stuck mass, so the distance
    of the lower end from 1 is proportional to this shift. At higher resonances and for masses from
    a tenth of the beam's an antiresonance lies in the range, and the rule then gives too wide a
    gap.
    """
    usual, shift = (
        1 - _stuck_ratio(model, m, resonance) for m in (DEFAULT_MASS_RATIO * model.beam_mass, mass)
    )
    if usual <= 0:  # a node at the absorber
        return NEAR
    return max(_LEAST * (1 - shift), 1 - (1 - NEAR[0]) * shift / usual), NEAR[1]


def _stuck_ratio(model: ModalModel, mass: float, resonance: int) -> float:
    """Return the natural frequency of the beam with the mass stuck to it, over omega_r."""
    omega_r = model.resonance_omega(resonance)
    return float(stuck_frequencies(model, masses_of(model, mass))[resonance - 1]) / omega_r


def design_force(
    model: ModalModel,
    mass: float,
    gap: float,
    resonance: int = 1,
    low: float | None = None,
    high: float | None = None,
) -> float:
    """Return f* in N, the force at which the limit leaves zero in low..high times omega_r.

    f* is the minimum over Omega of |kappa| R/|G_f|. ``mass`` m_a is in kg, ``gap`` g0 in m. The
    paper's best operating points of the first two modes, found by simulation, lie close to f*. For
    the paper's beam |kappa|/|G_f| grows with the frequency, so the minimum is at the lower end of
    the range: 1 % of this frequency changes f* by 2 % at the first mode and by 5 to 6 % at the
    second. The default begins 7 % below the resonance for the paper's mass ratio, see `near_range`.
    The limit is that at the absorber's own place, even if the response level is that at another
    place. Raises ParameterError for numbers out of range, and for a range without the resonance of
    the beam with the mass stuck to it, around which the limit is largest.
    """
    model = instance("model", model, ModalModel)
    omega_r = model.resonance_omega(resonance)
    default = near_range(model, mass, resonance)
    low, high = frequency_range(
        default[0] if low is None else low, default[1] if high is None else high
    )
    stuck = _stuck_ratio(model, mass, resonance)
    if default == (low, high):
        require(
            low <= stuck,
            "absorber mass",
            f"{mass:.4g} kg",
            f"less beside the {1 / model.tip_shape[resonance - 1] ** 2:.4g} kg that mode "
            f"{resonance} moves at its place: stuck there it takes "
            f"the resonance to {stuck:.4f} of its frequency; are the mass in kg and the "
            "shapes in 1/sqrt(kg)?",
        )
    require(
        low <= stuck <= high,
        "range (low, high)",
        (low, high),
        f"a range that holds the resonance with the mass stuck, at {stuck:.4f}",
    )

    def needed(ratio: Real) -> Real:
        by_force, reach, _ = line_terms(model, mass, gap, ratio * omega_r, model.tip_shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(by_force > 0, reach / by_force, np.inf))

    grid = np.linspace(low, high, GRID)
    forces = needed(grid)
    require(
        bool(np.isfinite(forces.min())),
        "force_shape",
        model.one_phase_force_shape,
        "a force that moves the tip",
    )
    return smallest(lambda ratio: float(needed(np.asarray(ratio))), grid, forces)[0]


def design_gap(model: ModalModel, mass: float, force: float, resonance: int = 1) -> float:
    """Return the half-clearance g0 in m whose `design_force` is ``force`` (N).

    Because f* is proportional to the gap, no simulation is needed.
    """
    model = instance("model", model, ModalModel)
    return positive("force", force) / design_force(model, mass, 1.0, resonance)


def free_amplitude(model: ModalModel, mass: float, force: float, resonance: int = 1) -> float:
    """Return the largest stationary amplitude in m at an absorber's place without absorber.

    It is the maximum over `near_range` for an absorber of ``mass`` (kg) and a force in N.

    Infinite at an undamped resonance. Raises ParameterError for numbers out of range.
    """
    own = replace(model, response_shape=None)
    return (
        positive("force", force)
        * highest_amplitude(own, None, resonance, *near_range(model, mass, resonance))[0]
    )


def reach(model: ModalModel, mass: float, resonance: int = 1) -> float:
    """Return `free_amplitude` over `design_gap`; both are proportional to the force.

    If it is below 1, the motion of the free structure is smaller than the rule's gap, and an
    absorber without friction does not touch a wall: near a node, with much damping or a very light
    mass. A narrower gap may help. Raises ParameterError as `design_gap` does.
    """
    return free_amplitude(model, mass, 1.0, resonance) / design_gap(model, mass, 1.0, resonance)


def expected_gap(model: ModalModel, mass: float, force: float, resonance: int = 1) -> float:
    """Return the gap in m that is expected to be best.

    It is the design rule's gap times `expected_factor`, which was fitted to simulations of other
    structures.

    Raises ParameterError as `design_gap` does.
    """
    # first: they know which resonances there are
    gap = design_gap(model, mass, force, resonance)
    value = reach(model, mass, resonance)
    return expected_factor(value, float(model.damping_ratio[resonance - 1])) * gap


def expected_factor(reach: float, damping: float) -> float:
    """Return the best gap in simulations of other structures over the design rule's gap, a fit.

    ``reach`` is the free amplitude over the rule's gap, ``damping`` the damping ratio of the
    resonance. The fit is (reach/2.5)^0.6, at least 0.25, below a reach of 2.5; 1 up to 6; and 1.2
    above, times (0.005/damping)^0.2 for a damping from 0.5 % down to 0.15 % (docs/gap_method.md).
    """
    if reach > LARGE_REACH:
        return 1.2 * max(1.0, LIGHT_DAMPING / max(damping, LEAST_DAMPING)) ** 0.2
    return float(np.clip((reach / 2.5) ** 0.6, 0.25, 1.0))


def gap_unit(model: ModalModel, mass: float, force: float, resonance: int = 1) -> float:
    """Return a length in m as the unit of gaps on any structure.

    It is the design rule's gap, or the free amplitude if that is smaller.
    """
    return min(
        design_gap(model, mass, force, resonance), free_amplitude(model, mass, force, resonance)
    )


def common_gap(model: ModalModel, mass: float, forces: Mapping[int, float]) -> float:
    """Return the smallest gap in m for which the limit is zero near several resonances.

    ``forces`` has the force in N of each resonance (counted from 1). The result is the largest of
    the single gaps. With a smaller gap the limit is above zero at one of the resonances; a larger
    gap gives higher levels at all of them, because levels below f* are proportional to the gap.
    """
    model = instance("model", model, ModalModel)
    forces = table_of(finite)("forces", forces)
    require(len(forces) > 0, "forces", dict(forces), "at least one resonance with its force in N")
    return max(design_gap(model, mass, force, resonance) for resonance, force in forces.items())


# How much of the possible reduction a design reached: 0 is no absorber, 1 is the limit.


def reduction_share(level: ArrayLike, without: ArrayLike, limit: ArrayLike) -> Real:
    """Return (without - level)/(without - limit), of the broadcast shape of the three levels in m.

    ``without`` is the level without absorber, ``limit`` a lower bound for all devices. The best
    device has a level above the limit, so the share is a lower bound of the share that was reached.
    It is negative if the absorber makes the level worse, and may be above 1 for a level that is not
    stationary (a sweep's). Raises ParameterError if limit >= without.
    """
    every = {"level": level, "without": without, "limit": limit}
    reached, start, end = (
        _amplitudes(name, values, "finite levels in m, 0 or above")
        for name, values in every.items()
    )
    require(
        bool(np.all(end < start)),
        "limit",
        limit,
        f"below the level without an absorber, {without!r} m",
    )
    return np.asarray((start - reached) / (start - end))


def share_reached(
    model: ModalModel,
    mass: float,
    gap: float,
    force: float,
    level: ArrayLike,
    resonance: int = 1,
    low: float = SWEPT[0],
    high: float = SWEPT[1],
) -> Real:
    """Return the share of the possible reduction that a ``level`` reaches near a resonance.

    ``level`` is a design's largest level in m (RMS) over low..high times omega_r, simulated or
    measured, of any shape, which is that of the result. ``force`` is in N, ``mass`` m_a in kg and
    ``gap`` g0 in m. The level is compared with `resonance_limit` and with the free beam's largest
    stationary level over the range. Raises ParameterError for numbers out of range, a force of 0,
    and an undamped resonance in the range.
    """
    low, high = frequency_range(low, high)
    force = non_negative("force", force)
    require(
        force > 0,
        "force",
        force,
        "above 0 N, since nothing is to be reduced",
    )
    without = force * highest_amplitude(model, None, resonance, low, high)[0] / np.sqrt(2)
    require(
        bool(np.isfinite(without)),
        "damping_ratio",
        model.damping_ratio,
        "above 0 at every resonance of the range",
    )
    return reduction_share(
        level, without, resonance_limit(model, mass, gap, force, resonance, low, high)
    )
