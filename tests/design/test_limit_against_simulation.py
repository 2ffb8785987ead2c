"""No device is ever below the limit.

Random impact absorbers and friction dampers are simulated, and random tuned absorbers have a closed
form.
"""

import core
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impact_env import (
    Beam,
    Drive,
    Scene,
    TunedAbsorber,
    beam_scene,
    constant_frequency,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    modal_model,
)
from impact_env.frequency import receptance, tip_response
from impact_env.modes import ModalModel
from optimisation.bounds import design_force, stroke_limit_rms

# pseudo periods: start-up has decayed to 1e-6, the mean over the window moves by less than SLACK
SAMPLES = 16
SETTLED = 220
MEASURED = 250
SLACK = 5e-3
DESIGNS = 40  # for each of four seeds


def stationary(
    scene: Scene, force: float, omega: float, reference: float, settled: float = SETTLED
) -> tuple[float, np.ndarray]:
    """Return the tip's RMS and the absorber's relative displacement after the start-up.

    Displacements are in m and relative to the tip. Several absorbers have no relative displacements
    here.
    """
    drive = Drive(force, constant_frequency(reference, omega / reference, settled + MEASURED))
    history = core.run(scene, drive, samples=SAMPLES).history
    part = slice(-MEASURED * SAMPLES, None)
    rms = float(np.sqrt(np.mean(history.tip_displacement[part] ** 2)))
    if history.absorber_displacement.ndim > 1:
        return rms, np.zeros(0)
    return rms, (history.absorber_displacement - history.tip_displacement)[part]


def random_model(random: np.random.Generator) -> ModalModel:
    damping = random.uniform(0.005, 0.03)
    at = random.uniform(0.3, 0.6)
    absorber_at = random.choice([1.0, random.uniform(0.85, 1.0)])
    return modal_model(
        Beam(
            modes=3,
            damping_ratio=float(damping),
            force_position=float(at),
            absorber_position=float(absorber_at),
        )
    )


@pytest.mark.parametrize("seed", range(4))
def test_stationary_runs_of_random_designs_obey_the_limit(seed: int) -> None:
    random = np.random.default_rng(seed)
    margins = []
    for k in range(DESIGNS):
        model = random_model(random)
        resonance = 1 + k % 2
        mass_ratio = 0.005 * 20 ** random.random()
        gap = 10 ** random.uniform(-4, -2)
        mass = mass_ratio * model.beam_mass
        reference = model.resonance_omega(resonance)
        force = design_force(model, mass, gap, resonance) * 10 ** random.uniform(-0.2, 0.9)
        friction = random.choice([0.0, force * 10 ** random.uniform(-3, -0.5)])
        restitution = random.choice([random.uniform(0.3, 0.95), 1.0])
        absorber = impact_absorber(gap, restitution, float(friction) or None, mass_ratio)
        omega = random.uniform(0.9, 1.05) * reference
        rms, relative = stationary(Scene(model, absorber), force, omega, reference)
        limit = float(stroke_limit_rms(model, mass, gap, force, omega))
        assert np.max(np.abs(relative)) <= gap * (1 + 1e-9)
        assert rms >= limit * (1 - SLACK), (model, absorber, force, omega)
        margins.append(rms / limit if limit > 0 else np.inf)
    assert np.sum(np.isfinite(margins)) >= DESIGNS // 2  # the limit says something
    assert min(margins) < 1.25  # and is not far away


def test_several_absorbers_anywhere_obey_the_limit_of_the_free_end() -> None:
    random = np.random.default_rng(0)
    margins = []
    designs = 8
    for k in range(designs):
        resonance = 1 + k % 2
        n = 2 + k % 3 // 2
        positions = [float(random.choice([1.0, random.uniform(0.5, 1.0)])) for _ in range(n)]
        shares = random.dirichlet(np.ones(n))
        ratio = 0.01 * 10 ** random.random()
        gaps = 10 ** random.uniform(-4, -2.5, n)
        e = random.uniform(0.3, 0.9, n)
        friction = [float(x) if x > 1e-3 else None for x in 10 ** random.uniform(-4, -1, n)]
        absorbers = impact_absorbers(gaps, positions, e, friction, ratio, shares / shares.sum())
        scene = beam_scene(
            Beam(modes=3, damping_ratio=float(random.uniform(0.02, 0.03))), absorbers
        )
        model = scene.model
        masses = scene.absorber_masses
        reference = model.resonance_omega(resonance)
        omega = random.uniform(0.93, 1.03) * reference
        # a force at which the limit is some way above zero
        reach = float(
            stroke_limit_rms(model, masses, 1e-9 * np.ones(n), 1.0, omega, model.tip_shape)
        )
        force = (
            10 ** random.uniform(0.1, 0.5)
            * float(np.sum(masses * gaps))
            / float(np.sum(masses))
            / reach
        )
        rms, _ = stationary(scene, force, omega, reference, SETTLED / 2)  # twice the damping
        limit = float(stroke_limit_rms(model, masses, gaps, force, omega, model.tip_shape))
        assert rms >= limit * (1 - SLACK), (absorbers, force, omega)
        margins.append(rms / limit if limit > 0 else np.inf)
    assert np.sum(np.isfinite(margins)) >= designs // 2
    assert min(margins) < 1.5


def test_stationary_friction_dampers_obey_the_limit_of_their_own_stroke() -> None:
    model = modal_model(Beam(modes=3))
    for friction in (0.02, 0.3, 1.0):
        scene = Scene(model, friction_damper(friction))
        mass = 0.02 * model.beam_mass
        for ratio in (0.94, 0.97, 1.0):
            omega = ratio * model.omega[0]
            rms, relative = stationary(scene, 3.5, omega, model.omega[0])
            stroke = (
                float(np.ptp(relative)) / 2
            )  # it may have drifted: the middle of its motion does not matter
            assert rms >= float(stroke_limit_rms(model, mass, max(stroke, 1e-12), 3.5, omega)) * (
                1 - SLACK
            )


@given(
    stiffness=st.floats(-3, 3),
    damping=st.floats(-3, 1),
    mass_ratio=st.floats(0.001, 0.5),
    at=st.floats(0.3, 20),
    resonance=st.integers(1, 3),
)
@settings(max_examples=400)
def test_tuned_absorbers_obey_the_limit_of_their_own_stroke(
    stiffness: float, damping: float, mass_ratio: float, at: float, resonance: int
) -> None:
    """Tuned absorbers obey the limit of their own stroke.

    A tuned absorber is passive, and its stroke is one line of amplitude |r|. A gap of pi |r|/4
    admits just this line, so its response must not be below the limit.
    """
    model = modal_model(Beam(modes=4))
    mass = mass_ratio * model.beam_mass
    omega = at * model.omega[0]
    own = model.resonance_omega(resonance) * 10**stiffness
    absorber = TunedAbsorber(mass_ratio, mass * own**2, 2 * mass * own * 10**damping)
    tip = complex(tip_response(model, absorber, omega))
    spring = absorber.stiffness + 1j * omega * absorber.damping
    stroke = tip * mass * omega**2 / (spring - mass * omega**2)
    # the equation that the limit is made of
    kappa = receptance(model, omega, model.tip_shape, model.tip_shape) * mass * omega**2
    free = receptance(model, omega, model.tip_shape, model.force_shape)
    assert tip * (1 - kappa) == pytest.approx(
        complex(free + kappa * stroke), rel=1e-6, abs=1e-9 * abs(free)
    )
    assert (stroke * np.conj(tip)).imag <= 1e-12 * abs(stroke * tip)
    limit = float(stroke_limit_rms(model, mass, np.pi * abs(stroke) / 4, 1.0, omega))
    assert abs(tip) / np.sqrt(2) >= limit * (1 - 1e-9) - 1e-12 * abs(free)
