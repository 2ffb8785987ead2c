"""Steps that are too long are refused before anything is computed, and only those."""

import numpy as np
import pytest
from core import run

from impact_env import (
    Beam,
    Drive,
    Exact,
    Moreau,
    ParameterError,
    RungeKutta,
    StuckAbsorber,
    TunedAbsorber,
    beam_scene,
    constant_frequency,
    friction_damper,
    impact_absorber,
    modal_model,
    simulate,
)
from impact_env.methods import LEAST_STEPS, SURE_REACH, check_mass, check_step


def checked(ratio: float, method: Moreau | RungeKutta | Exact, frequency: float = 1.0, force: float = 1.0, **beam: object) -> None:
    scene = beam_scene(Beam(**({"modes": 1, "damping_ratio": ratio} | beam)))
    check_step(scene, Drive(force, constant_frequency(float(scene.model.omega[0]), frequency, 1.0)), method)


@pytest.mark.parametrize("steps", [4, 20, 200])
def test_moreau_limit_is_that_of_its_quadratic(steps: int) -> None:
    """z^2 - (2 - 2 D x - x^2) z + 1 - 2 D x has a root at -1 where x^2 + 4 D x = 4."""
    x = 2 * np.pi / steps
    critical = (4 - x**2) / (4 * x)
    checked(critical * (1 - 1e-6), Moreau(steps))
    with pytest.raises(ParameterError, match=rf"steps_per_period = {steps} .*damping"):
        checked(critical * (1 + 1e-6), Moreau(steps))


@pytest.mark.parametrize("steps", [4, 20, 200])
def test_runge_kutta_limit_of_strong_damping(steps: int) -> None:
    x = 2 * np.pi / steps
    fastest = 2.785293563405282 / x  # D + sqrt(D^2 - 1) at which the fourth-order polynomial is 1
    critical = 0.5 * (fastest + 1 / fastest)
    checked(critical * (1 - 1e-6), RungeKutta(steps))
    with pytest.raises(ParameterError, match=rf"steps_per_period = {steps} .*damping"):
        checked(critical * (1 + 1e-6), RungeKutta(steps))


def test_any_slot_within_the_sure_reach_is_stable() -> None:
    z = SURE_REACH * np.exp(1j * np.linspace(np.pi / 2, np.pi, 1000))
    assert np.all(np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) <= 1 + 1e-12)


@pytest.mark.parametrize("method", [Moreau, RungeKutta])
def test_steps_that_the_message_asks_for_are_allowed(method: type[Moreau] | type[RungeKutta]) -> None:
    for ratio in (5.0, 50.0, 500.0):
        with pytest.raises(ParameterError) as caught:
            checked(ratio, method())
        checked(ratio, method(int(str(caught.value).partition("about ")[2].split()[0])))
    checked(1e3, Exact())


@pytest.mark.parametrize("method", [Moreau, RungeKutta])
def test_a_force_between_the_steps_is_refused(method: type[Moreau] | type[RungeKutta]) -> None:
    most = 20 / LEAST_STEPS
    checked(0.01, method(), most * (1 - 1e-9))
    checked(0.01, method(), 100.0, force=0.0)
    with pytest.raises(ParameterError, match=r"steps_per_period = 20 .*force"):
        checked(0.01, method(), most * 1.01)
    checked(0.01, method(401), 100.0)
    checked(0.01, Exact(), 1e9)


def test_friction_under_a_force_far_above_all_modes() -> None:
    """The micro flights after a reversal are then set by the force, not by the modes."""
    scene = beam_scene(Beam(modes=3), impact_absorber(restitution=0.7, friction_limit=0.1))
    drive = Drive(1e7, constant_frequency(float(scene.model.omega[0]), 1e4, 0.002))
    exact, stepped = (run(scene, drive, method).end_state for method in (Exact(), Moreau(400_000)))
    np.testing.assert_allclose(exact, stepped, atol=3e-5 * float(np.max(np.abs(stepped))))


def test_moreau_with_a_tuned_absorber() -> None:
    for steps in (4, 20):
        scene = beam_scene(Beam(modes=5, damping_ratio=0.01), TunedAbsorber())
        drive = Drive(1.0, constant_frequency(float(scene.model.omega[0]), 1.0, 1.0))
        check_step(scene, drive, Moreau(steps))
    scene = beam_scene(Beam(modes=5, damping_ratio=4.0), TunedAbsorber())
    with pytest.raises(ParameterError, match="steps_per_period"):
        check_step(scene, drive, Moreau())


def test_simulate_refuses_in_a_short_run_what_would_blow_up_in_a_long_one() -> None:
    """After a third of a period the numbers would still look like numbers."""
    scene = beam_scene(Beam(modes=3, damping_ratio=6.0))
    drive = Drive(50.0, constant_frequency(float(scene.model.omega[0]), 1.0, 0.3))
    for method in (Moreau(), RungeKutta()):
        with pytest.raises(ParameterError, match="steps_per_period"):
            simulate(scene, drive, method)


def test_an_absorber_that_holds_the_tip_still_is_refused() -> None:
    model = beam_scene(Beam(modes=3)).model
    # a mass that the tip slides along is another matter: to it, a mass without end is the ground
    for absorber in (StuckAbsorber(8e5), friction_damper(1.0, 1e9), TunedAbsorber(1e9)):
        check_mass(beam_scene(Beam(modes=3), absorber))
    drive = Drive(1.0, constant_frequency(float(model.omega[0]), 1.0, 1.0))
    for method in (Exact(), Moreau(), RungeKutta()):
        with pytest.raises(ParameterError, match=r"mass_ratio = 1000000.0 is not allowed: at most 8\.3e\+05"):
            simulate(beam_scene(Beam(modes=3), StuckAbsorber(1e6)), drive, method)
    assert 8.3e5 * model.beam_mass * np.sum(model.tip_shape**2) == pytest.approx(1e7, rel=0.01)


@pytest.mark.parametrize("elements", [30, 500])
def test_frequencies_have_all_digits_for_any_number_of_elements(elements: int) -> None:
    """Against the same finite elements in many digits, which `scripts/run stability` computes."""
    known = {30: (252.3097245382703, 1581.198693128902), 500: (252.30972186531497, 1581.1980363001915)}
    model = modal_model(Beam(elements=elements, modes=2))
    np.testing.assert_allclose(model.omega, known[elements], rtol=2e-13)
