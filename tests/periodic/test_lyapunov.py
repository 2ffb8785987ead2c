"""The largest Lyapunov exponent: of a stable orbit its multiplier's, of chaos how two runs part, by the exact method alone."""

import numpy as np
import pytest

from impact_env import Beam, beam_scene, impact_absorber
from impact_env.drive import Drive, constant_frequency
from impact_env.periodic.case import case_of, start_from
from impact_env.periodic.lyapunov import exponent_of, largest_exponent
from impact_env.periodic.residence import Approach
from impact_env.periodic.survey import closed_form_orbits
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate


def drive(scene: Scene, force: float, ratio: float, periods: float) -> Drive:
    return Drive(force, constant_frequency(scene.model.resonance_omega(1), ratio, periods))


def test_exponent_of_a_stable_orbit_is_its_largest_multipliers() -> None:
    scene = beam_scene(Beam(modes=1), impact_absorber(restitution=0.75))
    reference = scene.model.resonance_omega(1)
    settled = Drive(1.5, Approach(reference, 1.0).to((800.0, 0.9), (400.0, 0.9)))  # down from impact at the resonance
    found = largest_exponent(scene, settled, 800)
    orbits = closed_form_orbits(case_of(scene, 1.5, 0.9 * reference)).orbits
    (stable,) = (orbit for orbit in orbits if orbit.stability.stable)
    assert found.value == pytest.approx(np.log(abs(stable.stability.full[0])), abs=2e-3)
    assert not found.chaotic


def test_chaos_parts_runs_as_its_exponent_says() -> None:
    """Pairs of runs a billionth of the gap apart: the mean logarithm of what they part by grows along the exponent until they forget each other."""
    scene = beam_scene(Beam(modes=1), impact_absorber())
    omega = scene.model.resonance_omega(1)
    found = largest_exponent(scene, drive(scene, 1.7, 1.0, 500.0), 1600)
    assert found.chaotic
    rates = []
    record = Record(level=False, events=True)
    for k in range(40):
        state = simulate(scene, drive(scene, 1.7, 1.0, 500.0 + 10 * k), record=record).end_state
        other = state + 1e-11 * np.random.default_rng(k).normal(size=len(state)) * np.array([1.0, 1.0, omega, omega])
        ends = []
        for periods in (2.0, 12.0):  # the first two turn the difference into the fastest direction
            run = Drive(1.7, constant_frequency(omega, 1.0, periods))
            one, two = (simulate(scene, run, initial=start_from(scene, start), record=record).end_state for start in (state, other))
            ends.append(np.linalg.norm((two - one) / np.array([1.0, 1.0, omega, omega])))
        rates.append(np.log(ends[1] / ends[0]) / 10)
    width = 3 * np.std(rates) / np.sqrt(len(rates)) + found.high - found.low
    assert abs(np.mean(rates) - found.value) < width


def test_interval_covers_the_mean_of_independent_growths() -> None:
    drawn = np.random.default_rng(1)
    hits = sum((found := exponent_of(drawn.normal(0.3, 1.0, 400))).low < 0.3 < found.high for _ in range(400))
    assert 0.9 * 400 < hits < 0.985 * 400
