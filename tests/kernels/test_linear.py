import numpy as np
import pytest
from core import OMEGA, PERIOD, Array, drive_of, run, scene_of, still

from impact_env import Beam, Drive, FrequencySchedule, InitialState, ParameterError, Scene, StuckAbsorber, TunedAbsorber
from impact_env.parameters import Absorber
from impact_env.response import Response
from reference import dense
from reference.contact import Automaton
from reference.mechanics import Mechanics

LINEAR = [None, StuckAbsorber(0.5), TunedAbsorber(), TunedAbsorber(damping=0.0), TunedAbsorber(0.1, 1e6, 300.0)]


def modal_states(response: Response) -> Array:
    history = response.history
    return np.concatenate([history.modal_displacement, history.modal_velocity], axis=1)


def error(scene: Scene, drive: Drive, initial: InitialState | None = None, samples: int = 32) -> float:
    """Largest deviation from the truth, each modal displacement and velocity relative to its largest value; or the energy's, if that is larger."""
    response = run(scene, drive, initial=initial, samples=samples)
    n = scene.model.modes
    truth = np.delete(dense.follow(scene, drive, initial, response.history.time, long_steps=True).states, [n, 2 * n + 1], axis=1)
    deviation = np.max(np.abs(modal_states(response) - truth) / np.max(np.abs(truth), axis=0))
    return float(max(deviation, response.energy.relative_error))


def equations(scene: Scene) -> tuple[Array, Array]:
    """Return matrix (2N, 2N) and force column (2N,) in displacements and velocities."""
    mechanics = Mechanics(scene)
    linear, scale = mechanics.linear([Automaton(scene.absorber).only()]), np.append(mechanics.scale, np.ones(mechanics.half))
    return linear.matrix[:-1, :-1] * scale / scale[:, None], linear.column[:-1, 0] / scale


@pytest.mark.parametrize("absorber", LINEAR)
@pytest.mark.parametrize("ratio", [0.5, 1.0, 6.2669, 100.0])
def test_steady_state_at_a_constant_frequency(absorber: Absorber | None, ratio: float) -> None:
    scene = scene_of(absorber, damping_ratio=0.2)
    matrix, force = equations(scene)
    n, omega = 3, ratio * OMEGA
    steady = np.linalg.solve(1j * omega * np.eye(2 * n + 2) - matrix, force)
    start = InitialState(steady[:n].real, steady[n + 1 : -1].real, steady[n].real, steady[-1].real)
    response = run(scene, drive_of(1.0, ratio, periods=4), initial=start)
    expected = np.real(steady[:n] * np.exp(1j * omega * response.history.time)[:, None])
    np.testing.assert_allclose(response.history.modal_displacement, expected, rtol=0, atol=2e-12 * (1 + ratio) * np.max(np.abs(steady[:n])))


@pytest.mark.parametrize("damping", [0.0, 0.01, 0.9999, 1.5, 40.0, (0.0, 1.2, 0.5)])
def test_free_response(damping: float | tuple[float, ...]) -> None:
    scene = scene_of(damping_ratio=damping)
    omega, ratio, q0, u0 = scene.model.omega, scene.model.damping_ratio, np.array([1e-3, -2e-4, 5e-5]), np.array([0.1, 0.3, -0.2])
    response = run(scene, still(3 * PERIOD), initial=InitialState(q0, u0))
    root = np.sqrt(ratio**2 - 1 + 0j)
    fast, slow = omega * (-ratio - root), -omega / (ratio + root)
    t = response.history.time[:, None]
    expected = np.real(((u0 - fast * q0) * np.exp(slow * t) - (u0 - slow * q0) * np.exp(fast * t)) / (slow - fast))
    np.testing.assert_allclose(response.history.modal_displacement, expected, rtol=0, atol=1e-11 * np.max(np.abs(expected)))


def test_critically_damped_free_response() -> None:
    scene = scene_of(damping_ratio=1.0)
    omega, start = scene.model.omega, np.array([1e-3, -2e-4, 5e-5])
    response = run(scene, still(3 * PERIOD), initial=InitialState(start))
    t = response.history.time[:, None]
    np.testing.assert_allclose(response.history.modal_displacement, start * (1 + omega * t) * np.exp(-omega * t), rtol=0, atol=1e-12 * start[0])


@pytest.mark.parametrize("phase", [0.0, 1.0])
def test_undamped_resonance_grows_without_bound(phase: float) -> None:
    scene = scene_of(damping_ratio=0.0, modes=1)
    omega, shape = scene.model.omega[0], scene.model.force_shape[0]
    response = run(scene, drive_of(2.0, 1.0, periods=200, reference=omega, phase=phase))
    t = response.history.time
    grown = 2.0 * shape / (2 * omega) * (t * np.sin(omega * t + phase) - np.sin(phase) * np.sin(omega * t) / omega)
    np.testing.assert_allclose(response.history.modal_displacement[:, 0], grown, rtol=0, atol=1e-12 * np.max(np.abs(grown)))


SWEEPS = [(0.0,), (1.0,), (300.0,), (0.98, 1.02), (1.02, 0.98), (0.0, 20.0), (20.0, 0.0), (1.0, 1.0, 3.0, 0.0, 7.0, 6.9)]


@pytest.mark.parametrize("absorber", LINEAR)
@pytest.mark.parametrize("ratios", SWEEPS)
def test_sweeps(absorber: Absorber | None, ratios: tuple[float, ...]) -> None:
    start = InitialState(np.array([1e-5, -2e-6, 5e-6]), np.array([1e-3, 3e-3, -2e-3]))
    assert error(scene_of(absorber), drive_of(1.0, *ratios, phase=0.3), start) < 2e-12


@pytest.mark.parametrize("damping", [0.0, 1e-6, 1e-3, 0.3, 1.0, 1 + 1e-9, 2.0, 30.0, (0.0, 1.0, 3.0)])
@pytest.mark.parametrize("absorber", [None, StuckAbsorber(), TunedAbsorber()])
@pytest.mark.parametrize("ratios", [(0.9, 1.1), (1.0,), (0.0,), (0.0, 8.0)])
def test_damping_from_none_to_overdamped(damping: float | tuple[float, ...], absorber: Absorber | None, ratios: tuple[float, ...]) -> None:
    assert error(scene_of(absorber, damping_ratio=damping), drive_of(1.0, *ratios)) < 2e-12


@pytest.mark.parametrize("absorber", [None, StuckAbsorber(), TunedAbsorber()])
def test_all_modes(absorber: Absorber | None) -> None:
    assert error(scene_of(absorber, modes=60), drive_of(1.0, 0.5, 2.0, periods=0.125), samples=1024) < 5e-11


@pytest.mark.parametrize("absorber", [StuckAbsorber(), TunedAbsorber()])
def test_fast_chirp_against_many_digits(absorber: Absorber) -> None:
    pytest.importorskip("mpmath")
    from reference import digits

    scene, drive = scene_of(absorber), drive_of(1.0, 0.2, 6.0, periods=2)
    state, truth = run(scene, drive).end_state, digits.follow(scene, drive).end_state
    for modes in (slice(0, 3), slice(4, 7)):
        assert np.max(np.abs(state[modes] - truth[modes])) < 1e-12 * np.max(np.abs(truth[modes]))


def test_a_break_in_a_straight_schedule_changes_nothing() -> None:
    scene = scene_of(TunedAbsorber())
    times = np.linspace(0, 10 * PERIOD, 2)
    parts = np.sort(np.append(times, [1e-5, 2.2 * PERIOD, 2.3 * PERIOD]))
    one, many = (run(scene, Drive(1.0, FrequencySchedule(t, np.interp(t, times, [0.9 * OMEGA, 1.1 * OMEGA]), OMEGA))) for t in (times, parts))
    np.testing.assert_allclose(many.end_state, one.end_state, rtol=0, atol=1e-12 * np.max(np.abs(one.end_state)))


def test_tuned_absorber_between_limits_of_its_spring() -> None:
    """A very stiff spring is a stuck mass; the beam does not feel a very soft one."""
    drive = drive_of(1.0, 0.9, 1.1, periods=3)
    stuck, stiff = (run(scene_of(a), drive).end_state for a in (StuckAbsorber(), TunedAbsorber(stiffness=1e9, damping=0.0)))
    alone, soft = (run(scene_of(a), drive).end_state for a in (None, TunedAbsorber(stiffness=1e-6, damping=0.0)))
    np.testing.assert_allclose(stiff[:3], stuck[:3], rtol=0, atol=1e-3 * np.max(np.abs(stuck[:3])))
    np.testing.assert_allclose(soft[:3], alone[:3], rtol=0, atol=1e-8 * np.max(np.abs(alone[:3])))


@pytest.mark.parametrize("absorber", [TunedAbsorber(0.05, 1e20, 0.0), TunedAbsorber(1e3, 1e3, 1e12)])
def test_spring_whose_stretch_has_no_digits_is_refused_with_what_is_allowed(absorber: TunedAbsorber) -> None:
    with pytest.raises(ParameterError, match=r"at most about 3\.0e\+11 N/m and 1\.2e\+09 N s/m on this beam"):
        run(scene_of(absorber), drive_of(1.0, 1.0))


@pytest.mark.parametrize(
    ("mass_ratio", "frequency", "ratio"),
    [(1e-6, 900.0, 0.0), (1e3, 1.1e-3, 0.0), (1e-6, 1.0, 450.0), (1e-9, 1e4, 0.0), (1e-4, 1e-6, 0.1), (1e-4, 1.0, 1.0)],
)
def test_light_and_heavy_slow_and_fast_absorbers_run(mass_ratio: float, frequency: float, ratio: float) -> None:
    mass, omega = mass_ratio * Beam().mass, frequency * OMEGA
    absorber = TunedAbsorber(mass_ratio, mass * omega**2, 2 * mass * omega * ratio)
    response = run(scene_of(absorber), drive_of(1.0, 1.0, periods=3))
    assert abs(response.energy.relative_error) < 1e-9
