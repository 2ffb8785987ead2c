"""Eigenvalues, eigenvectors and responses of linear regimes agree with dense matrices.

The dense matrices have 40 digits. No kernel is compiled.
"""

import numpy as np
import pytest
import scipy.interpolate
import scipy.linalg
import scipy.optimize
from core import Array

from impact_env import Beam, ModalModel, ParameterError, Scene, impact_absorber
from impact_env.kernels.events import careful
from impact_env.kernels.events.search import SCAN_NOISE
from impact_env.kernels.exact import rigid_contact
from impact_env.kernels.motion.modal_system import DRIVE, GUARD, RELATIVE, REST, SPEED, TIP
from impact_env.kernels.motion.segments import LinearRegime
from impact_env.modes import modal_model
from impact_env.regime_sets import _solve_lightly_damped, solve_set_modes
from impact_env.regimes import (
    BASIS_TOL,
    basis_error,
    checked_modes,
    find_fastest,
    free_regime,
    joined_regime,
    padded_size,
    sprung_regime,
)
from impact_env.solvers import (
    MOST_BYTES_CACHED,
    RegimeCache,
    cache_regimes,
    count_bytes,
    linear_regime,
    rigid_regimes,
)
from impact_env.structures.cyclic import Mistuning, ring_of_masses

pytest.importorskip("mpmath")
from reference.motion import joined_motion, sprung_motion, swinging_tip

BAR = 1e-12  # of the energy norm


def free(model: ModalModel) -> LinearRegime:
    return free_regime(model, padded_size(find_fastest(model)[1]), 0.01)


def joined(model: ModalModel, mass: float) -> LinearRegime:
    return joined_regime(model, mass, padded_size(find_fastest(model, mass)[1]), 0.01)


def sprung(model: ModalModel, mass: float, stiffness: float, damper: float = 0.0) -> LinearRegime:
    return sprung_regime(
        model,
        mass,
        stiffness,
        damper,
        padded_size(find_fastest(model, mass, stiffness, damper)[1]),
        0.01,
    )


def times(model: ModalModel) -> tuple[float, float]:
    return 2.0 / model.omega[0], 2.0 / model.omega[-1]


def beam_states(model: ModalModel) -> tuple[Array, Array]:
    n = model.modes
    return np.concatenate([np.arange(n), n + 1 + np.arange(n)]), np.append(model.omega, np.ones(n))


def slot_motion(regime: LinearRegime, states: Array, scale: Array, time: float) -> Array:
    """Return the motion of chosen ``states`` from a regime's slots.

    It is Re(out exp(s t) into), in coordinates times ``scale``.
    """
    s = regime.system.rows[0] + 1j * regime.system.rows[1]
    out = regime.out[0] + 1j * regime.out[1]
    into = (regime.into[0] + 1j * regime.into[1]).T
    whole = np.real((out * np.exp(s * time)) @ into)[np.ix_(states, states)]
    return np.asarray(whole * scale[:, None] / scale)


def joined_error(model: ModalModel, mass: float) -> float:
    """Return the largest error of the motions from all states, scaled to energy.

    It is the largest entry of the difference. ``mass`` 0 is the free beam.
    """
    regime = joined(model, mass) if mass > 0 else free(model)
    states, scale = beam_states(model)
    truths = [
        joined_motion(model, np.array([mass]), model.tip_shape[None], t) for t in times(model)
    ]
    return max(
        float(np.max(np.abs(slot_motion(regime, states, scale, t) - truth)))
        for t, truth in zip(times(model), truths, strict=True)
    )


def sprung_error(model: ModalModel, mass: float, stiffness: float, damper: float) -> float:
    regime = sprung(model, mass, stiffness, damper)
    n = model.modes
    own = np.sqrt(mass) * np.clip(np.sqrt(stiffness / mass), model.omega[0], model.omega[-1])
    scale = np.concatenate([model.omega, [own], np.ones(n), [np.sqrt(mass)]])
    worst = 0.0
    for t in times(model):
        truth = sprung_motion(model, mass, stiffness, damper, t, scale)
        far = np.abs(slot_motion(regime, np.arange(2 * n + 2), scale, t) - truth)
        worst = max(worst, float(np.max(far)) / max(1.0, float(np.max(np.abs(truth)))))
    return worst


def several_error(model: ModalModel, masses: Array) -> float:
    modes = solve_set_modes(model, masses, model.absorber_shapes)
    n = model.modes
    worst = 0.0
    scale = np.append(model.omega, np.ones(n))
    twice = np.where(modes.values.imag == 0, 1, 2)
    out = np.concatenate([modes.shapes, modes.shapes * modes.values[:, None]], axis=1).T * twice
    for t in times(model):
        motion = np.real((out * np.exp(modes.values * t)) @ modes.into) * scale[:, None] / scale
        worst = max(
            worst,
            float(np.max(np.abs(motion - joined_motion(model, masses, model.absorber_shapes, t)))),
        )
    return worst


def custom(seed: int, modes: int, ratio: float | Array, absorbers: int = 1) -> ModalModel:
    rng = np.random.default_rng(seed)
    omega = np.cumsum(rng.uniform(30, 200, modes))
    shapes = rng.normal(size=(absorbers, modes))
    return ModalModel(
        omega, np.broadcast_to(ratio, modes), rng.normal(size=modes), shapes[0], 1.0, shapes
    )


def all_errors(model: ModalModel, mass: float, own: float, damping: float) -> list[float]:
    """Return the errors of the joined regime, the sprung one and that of several absorbers.

    ``own`` is in units of the second frequency (or of the only one).
    """
    omega = own * model.omega[min(1, model.modes - 1)]
    errors = [
        joined_error(model, mass),
        sprung_error(model, mass, mass * omega**2, 2 * mass * omega * damping),
    ]
    return [*errors, several_error(model, np.linspace(0.4, 1, len(model.absorber_shapes)) * mass)]


CLOSE_TO_ONE = [
    1.0,
    1 + 1e-14,
    1 - 1e-12,
    1 + 1e-9,
    1 - 1e-8,
    1 + 1.2e-7,
    1 - 1.2e-7,
    1 + 1e-5,
    1 + 1.3e-5,
    1 - 1.2e-5,
    1 - 1.3e-5,
]


@pytest.mark.parametrize("ratio", CLOSE_TO_ONE)
def test_free_motion_at_and_near_critical_damping(ratio: float) -> None:
    assert joined_error(custom(1, 2, ratio), 0.0) < BAR


@pytest.mark.parametrize("ratio", CLOSE_TO_ONE)
def test_forced_motion_at_and_near_critical_damping(ratio: float) -> None:
    model = custom(2, 1, ratio)
    rows = free(model).system.rows
    omega = model.omega[0]
    d = model.damping_ratio[0]
    s = rows[0] + 1j * rows[1]
    both = (rows[TIP] + 1j * rows[TIP + 1]) * (rows[DRIVE] + 1j * rows[DRIVE + 1])
    for at in np.array([0.0, 0.3, 1.0, 3.0]) * omega:
        computed = np.sum(both / (1j * at - s) + np.conj(both) / (1j * at - np.conj(s))) / 2
        expected = (
            model.tip_shape[0] * model.force_shape[0] / (omega**2 - at**2 + 2j * d * omega * at)
        )
        assert abs(computed - expected) < 2 * BAR * abs(expected)


@pytest.mark.parametrize("modes", [1, 2, 4])
@pytest.mark.parametrize("every", [True, False])
@pytest.mark.parametrize("mass", [1e-6, 1e-2, 2.0])
def test_coupled_motion_with_critically_damped_modes(modes: int, every: bool, mass: float) -> None:
    for seed in range(2):
        ratio = np.ones(modes) if every else np.where(np.arange(modes) % 2 == seed % 2, 1.0, 0.02)
        model = custom(10 + seed, modes, ratio, 2)
        assert max(all_errors(model, mass, 0.7, (0.1, 1.0)[seed])) < 3 * BAR


NODE = scipy.optimize.brentq(
    lambda x: modal_model(Beam(modes=3), [x]).absorber_shapes[0, 1], 0.7, 0.85, xtol=1e-16
)


@pytest.mark.parametrize("ratio", [0.0, 0.01, 1.0, 3.0])
@pytest.mark.parametrize("distance", [1e-9, 1e-8, 1e-7])
def test_places_near_a_node_of_the_beam(ratio: float, distance: float) -> None:
    model = modal_model(
        Beam(modes=3, damping_ratio=ratio, absorber_position=NODE + distance),
        [NODE + distance, 0.5],
    )
    assert max(all_errors(model, 0.05 * model.beam_mass, 1.0, 0.1)) < BAR


@pytest.mark.parametrize("ratio", [0.0, 0.02, 1.0])
@pytest.mark.parametrize("share", [1e-20, 1e-9, 1e-7, 1e-4])
def test_tip_shapes_that_almost_vanish(ratio: float, share: float) -> None:
    model = custom(3, 4, ratio, 2)
    shapes = model.absorber_shapes * np.array(
        [[1, share, 1, 0.3 * share], [1, -3 * share, 1, share]]
    )
    changed = ModalModel(
        model.omega, model.damping_ratio, model.force_shape, shapes[0], 1.0, shapes
    )
    assert max(all_errors(changed, 0.3, 1.0, 0.05)) < BAR


@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-9, 1e-4])
def test_two_modes_with_one_frequency(apart: float) -> None:
    for seed in range(4):
        model = custom(seed, 4, 0.01, 2)
        omega = np.array(model.omega)
        omega[2] = omega[1] * (1 + apart)
        equal = ModalModel(
            omega,
            model.damping_ratio,
            model.force_shape,
            model.tip_shape,
            1.0,
            model.absorber_shapes,
        )
        assert max(all_errors(equal, 0.1, 1.0, 0.1)) < BAR


@pytest.mark.parametrize(
    ("mass", "stiffness"), [(1.7e-6, 2.8e7), (1e-9, 1e9), (1e-4, 1e-6), (50.0, 1.0)]
)
def test_light_heavy_stiff_and_soft_absorbers(mass: float, stiffness: float) -> None:
    model = custom(6, 3, 0.01)
    turned = find_fastest(model, mass, stiffness)[0] * max(
        times(model)
    )  # an angle, of which rounding is a share
    assert sprung_error(model, mass, stiffness, 0.0) < BAR + 4e-16 * turned


@pytest.mark.parametrize(("mass", "stiffness"), [(1.7e-6, 2.8e7), (0.05, 2e3), (1e-9, 1e9)])
def test_stretch_under_a_constant_force_is_that_of_the_spring(
    mass: float, stiffness: float
) -> None:
    """The stretch under a constant force is that of the spring.

    The tip does not move, since the spring takes the whole force. A constant drive bends the beam
    as without absorber.
    """
    model = custom(7, 3, 0.01)
    regime = sprung(model, mass, stiffness)
    rows = regime.system.rows
    stretch = np.sum(rows[GUARD] * rows[REST] - rows[GUARD + 1] * rows[REST + 1])
    assert stretch == pytest.approx(1 / stiffness, rel=BAR)
    assert abs(regime.tip_rest) < BAR * np.sum((model.tip_shape / model.omega) ** 2)
    s = rows[0] + 1j * rows[1]
    drive = rows[DRIVE] + 1j * rows[DRIVE + 1]
    bent = np.real(np.sum((rows[TIP] + 1j * rows[TIP + 1]) * -drive / s))
    assert bent == pytest.approx(
        np.sum(model.tip_shape * model.force_shape / model.omega**2), rel=BAR
    )


def test_the_tip_under_a_swinging_relative_force() -> None:
    """A light absorber on a stiff spring, which takes all but a small part of the force."""
    model = custom(8, 2, 0.01)
    mass = 1.7e-6
    stiffness = 2.8e7
    rows = sprung(model, mass, stiffness).system.rows
    at = 1.3 * model.omega[0]
    s = rows[0] + 1j * rows[1]
    both = (rows[TIP] + 1j * rows[TIP + 1]) * (rows[RELATIVE] + 1j * rows[RELATIVE + 1])
    computed = np.sum(both / (1j * at - s) + np.conj(both) / (1j * at - np.conj(s))) / 2
    expected = swinging_tip(model, mass, stiffness, at)
    assert abs(computed - expected) < 1e-10 * abs(expected)


def test_what_has_no_digits_is_refused() -> None:
    model = custom(9, 3, 0.01)
    with pytest.raises(ParameterError, match=r"at most about .* N/m and .* N s/m"):
        sprung(model, 100.0, 1e22)


def test_errors_of_the_event_search_bound_those_of_cubic_interpolation() -> None:
    """Error bounds of the event search hold for cubic interpolation.

    A sine is interpolated through the values and slopes at both ends (SciPy's interpolation), at
    every level. The bound is at most twice the error.
    """
    slots = free(modal_model(Beam(modes=3, damping_ratio=0.0))).system
    speeds = np.abs(slots.rows[SPEED, :3])
    cases = 0
    for step, errors in zip(slots.steps[:, 0], slots.errors, strict=True):
        for speed, error in zip(speeds, errors, strict=False):
            if not 0.02 < speed * step < 0.3:
                continue
            ends = speed * step * np.array([-0.5, 0.5])  # about the sine's largest curvature
            cubic = scipy.interpolate.CubicHermiteSpline(ends, np.cos(ends), -np.sin(ends))
            between = np.linspace(*ends, 101)
            largest = float(np.max(np.abs(cubic(between) - np.cos(between))))
            assert 0.5 * (error - SCAN_NOISE) < largest <= error
            cases += 1
    assert cases > 3


def test_regimes_are_held_up_to_a_number_of_bytes() -> None:
    """Regimes are cached up to a number of bytes.

    The regime used least recently is removed first. A regime larger than the limit is cached alone.
    """
    cache = RegimeCache(8 * 100)
    computed: list[int] = []

    @cache
    def rows(size: int, wide: bool = False) -> tuple[Array, tuple[Array, float]]:
        computed.append(size)
        return np.zeros(size), (np.zeros(size), float(wide))

    for size in (10, 20, 10, 30, 10, 20):
        assert rows(size)[0].size == size
    assert computed == [10, 20, 30, 20]
    assert cache.bytes == 8 * 2 * 30  # of 10 and 20: 30 has gone
    assert rows(10) is rows(10)
    rows(10, wide=True)
    rows(60)
    assert cache.bytes == 8 * 2 * 60
    assert computed[-2:] == [10, 60]


def test_the_regimes_of_many_scenes_do_not_add_up() -> None:
    reach = 0.05
    regimes = [
        linear_regime(Scene(modal_model(Beam(modes=60, damping_ratio=d))), reach)
        for d in np.linspace(0.01, 0.02, 80)
    ]
    assert count_bytes(tuple(regimes)) > MOST_BYTES_CACHED
    assert cache_regimes.bytes <= MOST_BYTES_CACHED


def test_scenes_of_one_model_share_their_regimes() -> None:
    """Gap, restitution and friction limit have no part in them; the mass has."""
    model = modal_model(Beam(modes=2))
    first, other, heavier = (
        rigid_regimes(Scene(model, absorber), 0.05)
        for absorber in (
            impact_absorber(1e-3, 0.5, 0.1),
            impact_absorber(2e-3, 0.9, 0.2),
            impact_absorber(1e-3, 0.5, 0.1, mass_ratio=0.03),
        )
    )
    assert first[0] is other[0]
    assert first[1] is other[1]
    assert first[1] is not heavier[1]


@pytest.mark.parametrize("mass_ratio", [1e-3, 0.02, 1.0])
@pytest.mark.parametrize("modes", [1, 3, 10, 40])
def test_bases_are_complete_far_within_the_tolerances_of_joint_forces_and_accelerations(
    modes: int, mass_ratio: float
) -> None:
    """Modal bases are complete far within the tolerances of joint forces and accelerations.

    These tolerances allow for the error of a change of basis. Usual scenes have a smaller error,
    and the tolerance of joint forces is a hundred times as large.
    """
    assert careful.ACCELERATION_TOL == BASIS_TOL
    assert pytest.approx(100 * BASIS_TOL) == rigid_contact.JOINT_FORCE_TOL
    for damping in (0.0, 0.01, 0.3, 1.0, 1.5):
        model = modal_model(Beam(modes=modes, damping_ratio=damping))
        scale = np.concatenate([model.omega, [0.0], np.ones(modes), [0.0]])
        states = np.flatnonzero(scale)
        basis = checked_modes(model, mass_ratio * model.beam_mass, None, 0.0)
        assert basis_error(basis.out[states], basis.into[:, states], scale[states]) < BASIS_TOL


@pytest.mark.parametrize("deviation", [0.0, 0.01])
@pytest.mark.parametrize("joined", [(0,), (2, 3), (0, 2, 4, 6, 8, 10), (0, 6), tuple(range(12))])
def test_modes_of_light_damping_propagate_as_the_matrix_exponential(
    joined: tuple[int, ...], deviation: float
) -> None:
    """Also of a tuned disk, whose eigenvalues come in equal pairs."""
    drawn = Mistuning(frequency=deviation, seed=3)
    ring = ring_of_masses(12, 0.02, 100.0, 0.002, mistuning=drawn)
    model = ring.model()
    shapes = ring.response_shapes()[list(joined)]
    masses = np.linspace(0.02, 0.05, len(joined)) if deviation else np.full(len(joined), 0.02)
    modes = solve_set_modes(model, masses, shapes, quickly=True)
    light = _solve_lightly_damped(model, masses, shapes)
    assert light is not None
    np.testing.assert_array_equal(modes.values, light.values)
    n = model.modes
    inverse = np.linalg.inv(np.eye(n) + (shapes.T * masses) @ shapes)
    damping = np.diag(2 * model.damping_ratio * model.omega)
    zero = np.zeros((n, n))
    matrix = np.block([[zero, np.eye(n)], [-inverse @ np.diag(model.omega**2), -inverse @ damping]])
    time = 0.0123
    scale = np.append(model.omega, np.ones(n))
    right = np.concatenate([modes.shapes, modes.shapes * modes.values[:, None]], axis=1).T
    motion = np.real((2 * right * np.exp(modes.values * time)) @ modes.into)
    wanted = scipy.linalg.expm(matrix * time)
    scaled = scale[:, None] * (motion - wanted) / scale
    np.testing.assert_allclose(scaled, 0.0, atol=2e-12)
    np.testing.assert_allclose(modes.weights, modes.into[:, n:] @ inverse, atol=1e-12)
    np.testing.assert_allclose(modes.places, modes.shapes @ shapes.T, atol=1e-14)


def test_heavy_damping_and_wide_spectra_are_solved_as_before() -> None:
    for ratio, speeds in ((0.3, [10.0, 11.0]), (0.01, [10.0, 400.0])):
        model = ModalModel(speeds, [ratio] * 2, [1.0, 1.0], [1.0, 0.5], 1.0)
        assert _solve_lightly_damped(model, np.array([0.1]), np.array([[1.0, 0.5]])) is None
