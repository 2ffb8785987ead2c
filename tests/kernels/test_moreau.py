import numpy as np
import pytest
from stepped import golden, integrate, order, still, table

from impact_env.drive import Drive, FrequencySchedule, constant_frequency, linear_sweep
from impact_env.families import Observers, family
from impact_env.kernels.motion.level import close_level, new_level
from impact_env.kernels.motion.observers import DONE, HELD_LOWER, HELD_UPPER, NOT_FINITE, STUCK_INSIDE, new_counters
from impact_env.kernels.stepping.chirp import fill_phases
from impact_env.kernels.stepping.grid import Force
from impact_env.methods import Moreau
from impact_env.parameters import (
    Beam,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.scene import InitialState, Scene, beam_scene

LIGHT = 1e-9  # mass ratio of an absorber that the beam does not feel
OMEGA = beam_scene(Beam(modes=1)).model.omega[0]


def damped_free_response(beam: Beam, start: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    model = beam_scene(beam).model
    delta, nu = model.damping_ratio * model.omega, model.omega * np.sqrt(1 - model.damping_ratio**2)
    decay = np.exp(-delta * time)
    return start * decay * (np.cos(nu * time) + delta / nu * np.sin(nu * time)), -start * decay * model.omega**2 / nu * np.sin(nu * time)


@pytest.mark.parametrize(("damping", "least", "most"), [(0.0, 1.9, 2.2), (0.05, 0.8, 1.3)])
def test_linear_scene_has_second_order_and_first_with_damping(damping: float, least: float, most: float) -> None:
    beam = Beam(modes=3, damping_ratio=damping)
    start = np.array([1e-3, -2e-4, 5e-5])
    q, u = damped_free_response(beam, start, 0.1)
    errors = []
    for steps in (40, 80, 160, 320):
        run = integrate(beam_scene(beam), still(0.1, OMEGA), Moreau(steps), InitialState(start))
        assert run.status == DONE
        errors.append(np.max(np.abs(run.end[[0, 1, 2]] - q)) * OMEGA + np.max(np.abs(run.end[[4, 5, 6]] - u)))
    assert least < order(errors) < most


@pytest.mark.parametrize("restitution", [1.0, 0.7])
def test_bouncing_absorber(restitution: float) -> None:
    light = Scene(beam_scene(Beam(modes=1)).model, impact_absorber(1e-3, restitution, mass_ratio=LIGHT))
    speed, mass = 0.05, light.absorber_mass
    assert mass is not None
    speeds = speed * restitution ** np.arange(5)
    times = np.cumsum(np.concatenate([[1e-3 / speed], 2e-3 / speeds[1:]]))
    for steps in (200, 20_000):
        run = integrate(light, still(times[-1] * 1.02, OMEGA), Moreau(steps), InitialState(absorber_velocity=speed))
        dt = 2 * np.pi / steps / OMEGA
        assert len(run.impacts) == 5
        np.testing.assert_array_less(np.abs(run.impacts["time"] - times), 2 * dt * np.arange(1, 6) / restitution**4)
        np.testing.assert_allclose(np.abs(run.impacts["relative_velocity"]), speeds, rtol=1e-6)
        np.testing.assert_allclose(np.sign(run.impacts["relative_velocity"]), [1, -1, 1, -1, 1])
        np.testing.assert_allclose(run.impacts["impulse"], -(1 + restitution) * run.impacts["relative_velocity"] * mass, rtol=1e-6)
        np.testing.assert_allclose(run.impacts["loss"], (1 - restitution**2) * speeds**2 * mass / 2, rtol=1e-6, atol=1e-20 * speed)
        assert run.balance_error < 1e-9


def test_friction_stops_the_absorber_and_holds_it() -> None:
    limit, speed = 1e-9, 0.02
    light = Scene(beam_scene(Beam(modes=1)).model, friction_damper(limit, LIGHT))
    assert light.absorber_mass is not None
    slowing = limit / light.absorber_mass
    stop = speed / slowing
    run = integrate(light, still(2 * stop, OMEGA), Moreau(500), InitialState(absorber_velocity=speed))
    dt = 2 * np.pi / 500 / OMEGA
    assert run.end[1] == pytest.approx(speed**2 / slowing / 2, abs=speed * dt)
    assert abs(run.end[3]) < 1e-9
    np.testing.assert_allclose(table(run.phases), [[stop, 2 * stop, STUCK_INSIDE]], atol=dt)
    assert run.counters["stuck_time"] == pytest.approx(stop, abs=dt)
    assert run.energy.totals["friction_loss"][0] == pytest.approx(light.absorber_mass * speed**2 / 2, rel=1e-6)


def test_coulomb_oscillator_loses_a_fixed_amplitude_each_half_period() -> None:
    limit, start = 0.5, 1e-3
    heavy = Scene(beam_scene(Beam(modes=1, damping_ratio=0.0)).model, friction_damper(limit, 1e9))
    shape = heavy.model.tip_shape[0]
    for halves in (1, 2, 3):
        run = integrate(heavy, still(halves * np.pi / OMEGA, OMEGA), Moreau(2000), InitialState(np.array([start]), absorber_displacement=0.0))
        assert run.end[0] * (-1) ** halves == pytest.approx(start - 2 * halves * shape * limit / OMEGA**2, abs=2e-3 * start)


def test_without_rebound_the_absorber_is_held_at_the_wall() -> None:
    held = beam_scene(Beam(modes=3), impact_absorber(1e-3, 0.0))
    run = integrate(held, Drive(5.0, constant_frequency(OMEGA, 1.0, 30)), Moreau(50))
    assert {HELD_LOWER, HELD_UPPER} <= set(run.phases["kind"])
    assert run.counters["stuck_time"] == pytest.approx(np.sum(run.phases["end"] - run.phases["start"]))
    assert run.counters["stuck_time"] > 0
    distance = run.states[:, 3] - run.states[:, :3] @ held.model.tip_shape
    assert np.max(np.abs(distance)) < 1.05e-3


def test_energy_balance_shrinks_with_the_square_of_the_step() -> None:
    for absorber in (impact_absorber(1e-3, 0.7, 0.1), TunedAbsorber(), StuckAbsorber(), None):
        present = beam_scene(Beam(modes=3), absorber)
        drive = Drive(3.5, linear_sweep(present.model.omega[0], 0.98, 0.99))
        coarse, fine = (integrate(present, drive, Moreau(steps)) for steps in (20, 200))
        assert coarse.status == fine.status == DONE
        assert coarse.balance_error < 1e-3
        assert fine.balance_error < 1e-5


@pytest.mark.parametrize(("name", "duration", "paper_error"), [("rigid_friction_10_modes", 0.2, 3e-4), ("rigid_frictionless_3_modes", 0.45, 5e-3)])
def test_first_impacts_of_the_golden_cases(name: str, duration: float, paper_error: float) -> None:
    present, drive, times, velocities = golden(name, duration)
    period = drive.schedule.pseudo_period
    paper, fine = (integrate(present, drive, Moreau(steps)) for steps in (20, 10_000))
    assert abs(paper.impacts["time"][0] - times[0]) < paper_error * period
    np.testing.assert_allclose(fine.impacts["time"][:5], times[:5], atol=1e-3 * period)
    assert abs(fine.impacts["time"][0] - times[0]) < 2e-5 * period
    np.testing.assert_allclose(fine.impacts["relative_velocity"][:3], velocities[:3], rtol=1e-2)


def test_impact_times_are_of_first_order() -> None:
    present, drive, times, _ = golden("rigid_frictionless_3_modes", 0.36)
    errors = [abs(integrate(present, drive, Moreau(steps)).impacts["time"][1] - times[1]) for steps in (100, 1000, 10_000)]
    assert 0.7 < order(errors, 10.0) < 1.6


def test_mirror_symmetry_and_scaling_law() -> None:
    drive = linear_sweep(OMEGA, 0.98, 0.985)
    one, mirrored = (integrate(beam_scene(Beam(modes=3), impact_absorber(1e-3, 0.7, 0.1)), Drive(f, drive), Moreau()) for f in (3.5, -3.5))
    doubled = integrate(beam_scene(Beam(modes=3), impact_absorber(2e-3, 0.7, 0.2)), Drive(7.0, drive), Moreau())
    np.testing.assert_array_equal(mirrored.states, -one.states)
    np.testing.assert_array_equal(doubled.states, 2 * one.states)


def test_samples_lie_on_their_times_and_end_with_the_run() -> None:
    beam, sample_dt = beam_scene(Beam(modes=1), None), 1e-3
    run = integrate(beam, Drive(1.0, constant_frequency(OMEGA, 1.0, 0.05 * OMEGA / 2 / np.pi)), Moreau(2000), sample_dt=sample_dt)
    shorter = integrate(beam, Drive(1.0, constant_frequency(OMEGA, 1.0, 0.02 * OMEGA / 2 / np.pi)), Moreau(2000), sample_dt=sample_dt)
    assert run.states.shape == (51, 4)
    np.testing.assert_array_equal(run.states[0], 0.0)
    np.testing.assert_allclose(run.states[-1], run.end, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(run.states[20], shorter.end, rtol=1e-3)


def test_level_agrees_with_the_series_and_any_step_grid() -> None:
    present = beam_scene(Beam(modes=3), impact_absorber())
    drive = Drive(1.5, constant_frequency(OMEGA, 1.0, 40))
    run = integrate(present, drive, Moreau())
    tip = run.states[:, :3] @ present.model.tip_shape
    level, counters = new_level(128), new_counters()
    interval = drive.schedule.pseudo_period / 128
    family(present, Moreau()).run(present, drive, Moreau(), InitialState().vector(present), interval, Observers(counters, level))
    assert level.state["next"] == len(tip)
    at = int(np.argmax(np.abs(tip)))
    window = tip[max(0, at - 1280) + 1 : at + 1281]
    assert close_level(level)[0] == pytest.approx(np.sqrt(np.mean(window**2)), rel=1e-9)
    assert counters.counts["impacts"] == run.counters["impacts"]


def test_stuck_absorber_moves_with_the_tip() -> None:
    stuck = beam_scene(Beam(modes=3), StuckAbsorber())
    run = integrate(stuck, Drive(1.0, constant_frequency(OMEGA, 1.0, 10)), Moreau())
    distance = run.states[:, 3] - run.states[:, :3] @ stuck.model.tip_shape
    assert np.max(np.abs(distance)) < 1e-12
    np.testing.assert_allclose(table(run.phases), [[0.0, 10 * 2 * np.pi / OMEGA, STUCK_INSIDE]])


def test_an_unstable_step_is_reported() -> None:
    overdamped = beam_scene(Beam(modes=2, damping_ratio=20.0))
    with np.errstate(over="ignore", invalid="ignore"):
        assert integrate(overdamped, Drive(1.0, constant_frequency(OMEGA, 1.0, 50)), Moreau(4)).status == NOT_FINITE


@pytest.mark.parametrize("dt", [1e-4, 3.3e-3, 0.4])
def test_the_turning_phasor_is_the_cosine(dt: float) -> None:
    schedule = FrequencySchedule(np.array([0.0, 0.3, 0.301, 0.5, 2.0]), np.array([240.0, 270.0, 100.0, 100.0, 900.0]), OMEGA)
    force = Force(*(np.array(row) for row in (schedule.times, schedule.omegas, schedule.phase_at(schedule.times))), 1.0, 0.7, None)
    count = int(2.0 / dt)
    target = np.zeros(count)
    fill_phases(target, count, force, 0, 0.0, dt)
    np.testing.assert_allclose(target, np.cos(schedule.phase_at(dt * np.arange(count)) + 0.7), atol=2e-12)
