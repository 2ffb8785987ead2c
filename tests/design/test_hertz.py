"""The estimate of an impact after Hertz, beside the motion of the two bodies integrated in time."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from impact_env import Beam, ParameterError, modal_model
from optimisation.hertz import estimate, material, meeting_mass, reaches_beyond


@pytest.mark.parametrize(("first", "second", "radius", "mass", "speed"), [("steel", "steel", 0.01, 0.03, 0.5), ("nylon", "brass", 0.004, 0.2, 2.0)])
def test_time_and_force_are_those_of_the_motion(first: str, second: str, radius: float, mass: float, speed: float) -> None:
    found = estimate(first, second, radius, mass, speed)
    stiff = 1 / sum((1 - nu**2) / young for young, nu in (material(first), material(second)))

    def force(depth: float) -> float:
        return 4 / 3 * stiff * np.sqrt(radius) * max(depth, 0.0) ** 1.5

    parted = lambda _, y: y[0]  # noqa: E731
    parted.terminal, parted.direction = True, -1
    run = solve_ivp(
        lambda _, y: [y[1], -force(y[0]) / mass], (0, 5 * found.time), [0, speed], events=parted, rtol=1e-9, atol=1e-14, max_step=found.time / 200
    )
    assert run.t_events[0][0] == pytest.approx(found.time, rel=5e-3)
    assert force(run.y[0].max()) == pytest.approx(found.force, rel=1e-3)
    contact_radius = np.sqrt(radius * run.y[0].max())
    assert found.pressure == pytest.approx(1.5 * found.force / (np.pi * contact_radius**2), rel=1e-3)


def test_the_meeting_mass_is_below_that_of_the_absorber_and_falls_with_the_modes() -> None:
    masses = [meeting_mass(modal_model(Beam(modes=modes)), 0.01) for modes in (1, 5, 10)]
    assert 0.01 > masses[0] > masses[1] > masses[2] > 0
    # the velocities of one impact: momentum P of the absorber against sum phi_i^2 P of the place
    model = modal_model(Beam(modes=3))
    assert 1 / meeting_mass(model, 0.01) == pytest.approx(1 / 0.01 + sum(phi**2 for phi in model.tip_shape))


def test_a_hard_impact_reaches_modes_that_were_left_out() -> None:
    model = modal_model(Beam(modes=3))
    assert reaches_beyond(model, estimate("steel", "steel", 0.01, 0.01, 1.0))
    assert not reaches_beyond(model, estimate("1e5:0.45", "steel", 0.01, 0.01, 0.1))


@pytest.mark.parametrize("name", ["wood", "1e9", "-1:0.3", "1e9:0.7", "a:b"])
def test_a_wrong_material_is_one_error(name: str) -> None:
    with pytest.raises(ParameterError, match="is not allowed: one of steel, aluminium"):
        material(name)
    with pytest.raises(ParameterError, match="radius"):
        estimate("steel", "steel", 0.0, 1.0, 1.0)
