"""Several absorbers to linear regimes: one for each set of those that move with the beam (see kernels/exact/sets.py).

The set's masses at their places make a change of low rank of the mass matrix; eigenvalues and eigenvectors are those of secular.py.
"""

from dataclasses import dataclass

import numpy as np

from impact_env.kernels.exact.sets import Sets
from impact_env.kernels.motion.modal_system import REST, TIP
from impact_env.modes import ModalModel, with_masses
from impact_env.regimes import (
    basis_error,
    order_slots,
    padded_size,
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


@dataclass(frozen=True)
class SetModes:
    """Modes of a set: eigenvalues (J,), eigenvectors of the beam ``shapes`` (J, N_m), their rows ``into`` from modal displacements and velocities
    (J, 2 N_m), response ``weights`` (J, N_m) to unit modal forces, and displacement (J, p) of the masses.
    """  # noqa: D205

    values: Complex
    shapes: Complex
    into: Complex
    weights: Complex
    places: Complex


def _double(values: Complex) -> Real:
    """Return 2 for a complex eigenvalue, which stands for a conjugate pair, and 1 for a real one, (J,)."""
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


def solve_set_modes(model: ModalModel, masses: Real, shapes: Real) -> SetModes:
    """Return the modes of a beam that carries ``masses`` (p,) in kg at places with ``shapes`` (p, N_m); none of them: the free beam.

    Raises ParameterError where two eigenvalues (almost) coincide, so that there is no modal basis.
    """
    if len(masses) == 0:
        return _solve_uncoupled(model, np.arange(model.modes), 0)
    scale = np.append(model.omega, np.ones(model.modes))

    def spanned(modes: SetModes) -> float:
        shapes = modes.shapes * _double(modes.values)[:, None]
        return basis_error(
            np.concatenate([shapes, shapes * modes.values[:, None]], axis=1).T, modes.into, scale
        )

    kilograms = f"{[float(m) for m in masses]} kg"
    allowed = "damping, masses and positions away from a double eigenvalue"
    return require_complete(
        lambda weak: _solve_coupled(model, masses, shapes, weak),
        spanned,
        "mass_ratio of several absorbers",
        kilograms,
        allowed,
    )


def _maps(modes: SetModes, joined: list[int], shapes: Real, size: int) -> tuple[Real, Real]:
    """Return the maps of `segments.LinearRegime`: a joined absorber has the beam's displacement at its place."""
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
    model: ModalModel, modes: SetModes, joined: list[int], masses: Real, shapes: Real, size: int
) -> Real:
    """Return the rows of weights (n + 1, ROWS, J) of a set."""
    s = modes.values
    every = []
    at_places = modes.shapes @ np.vstack([shapes, model.tip_shape]).T
    at_places[:, joined] = modes.places
    at_places *= _double(s)[:, None]
    for a, (mass, shape) in enumerate(zip(masses, shapes, strict=True)):
        guard = mass * s**2 * at_places[:, a] if a in joined else -at_places[:, a]
        every.append(
            slot_rows(
                s,
                modes.weights @ model.force_shape,
                -modes.weights @ shape,
                guard,
                at_places[:, a],
                size,
            )
        )
    nothing = np.zeros_like(s)
    every.append(
        slot_rows(s, modes.weights @ model.force_shape, nothing, nothing, at_places[:, -1], size)
    )
    return np.array(every)


def regime_sets(model: ModalModel, shapes: Real, masses: Real, wanted: float) -> tuple[Sets, float]:
    """Return the regimes of absorbers of ``masses`` (n,) in kg at ``shapes`` (n, N_m), and the reach of their tables (s): ``wanted`` or less.

    Raises ParameterError where a set has no modal basis.
    """
    shapes = np.array(shapes)
    n = len(masses)
    sets = [[a for a in range(n) if s >> a & 1] for s in range(2**n)]
    every = [solve_set_modes(model, masses[joined], shapes[joined]) for joined in sets]
    size = padded_size(max(len(modes.values) for modes in every))
    speed = max(float(np.max(np.abs(modes.values))) for modes in every)
    reach = table_reach(speed, wanted)
    rows = np.array(
        [
            _rows(model, modes, joined, masses, shapes, size)
            for modes, joined in zip(every, sets, strict=True)
        ]
    )
    tables = [
        np.ascontiguousarray(part)
        for part in map(
            np.array, zip(*(slot_tables(m.values, size, reach, speed) for m in every), strict=True)
        )
    ]
    maps = [
        np.array(part)
        for part in zip(
            *(
                _maps(modes, joined, shapes, size)
                for modes, joined in zip(every, sets, strict=True)
            ),
            strict=True,
        )
    ]
    bent = np.array([_bent(row) for row in rows])
    mobility = np.array([_compliance(masses, shapes, joined) for joined in sets])
    return Sets._make([rows, *tables, *maps, bent, mobility]), reach


def _bent(rows: Real) -> Real:
    """Return the displacement (n + 1, n) of each place under a unit constant force on each absorber, and so against the beam, in m/N."""
    tip, rest = (rows[:, row] + 1j * rows[:, row + 1] for row in (TIP, REST))
    return np.ascontiguousarray(np.real(tip @ rest[:-1].T))


def _compliance(masses: Real, shapes: Real, joined: list[int]) -> Real:
    """Return the relative acceleration (n, n) of each absorber by a unit force on each, in 1/kg, where some are joined."""
    mass = with_masses(shapes[joined], masses[joined])
    return np.ascontiguousarray(shapes @ np.linalg.solve(mass, shapes.T) + np.diag(1 / masses))
