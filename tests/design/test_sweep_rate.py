"""The default rate of sweeps, and what a sweep shows of the stationary level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from impact_env.drive import PAPER_LIMITS, Drive, default_rate, linear_sweep
from impact_env.level import response_level
from impact_env.modes import modal_model
from impact_env.parameters import Beam, ParameterError
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.sweep_rate import stationary_level, sweep_ratio
from studies.rule import STRUCTURES


@pytest.mark.parametrize(("damping", "ratio"), [(0.01, 0.989), (0.005, 0.934), (0.002, 0.718), (0.001, 0.491)])
def test_papers_rate_suits_its_damping_only(damping: float, ratio: float) -> None:
    model = modal_model(Beam(damping_ratio=damping))
    assert sweep_ratio(model, 1.0) == pytest.approx(ratio, abs=1e-3)
    assert default_rate(model) == pytest.approx((damping / 0.01) ** 2)
    assert sweep_ratio(model, default_rate(model)) == pytest.approx(0.99, abs=2e-3)


def test_default_rate_holds_for_another_beam_and_its_least_damped_resonance() -> None:
    beam = replace(STRUCTURES["steel"], modes=3, damping_ratio=(0.02, 0.004, 0.008))
    model = modal_model(beam)
    assert default_rate(model, (1,)) == 1.0  # never faster than the paper's
    assert default_rate(model, (1, 2, 3)) == default_rate(model, (2,)) == pytest.approx(0.16)
    for resonance in (1, 2, 3):
        assert 0.98 < sweep_ratio(model, default_rate(model, (resonance,)), resonance) < 1.001
    assert default_rate(modal_model(Beam(damping_ratio=0.0))) == pytest.approx(1e-4)


def test_ratio_agrees_with_an_integration_in_the_time_domain() -> None:
    """One mode, damped by 0.4 %, swept up: SciPy's state-space integration of a finely sampled force."""
    model = modal_model(replace(STRUCTURES["steel"], modes=1, damping_ratio=0.004))
    omega, damping = float(model.omega[0]), 0.004
    schedule = linear_sweep(omega, *PAPER_LIMITS, 2.0)
    samples = 128
    time = np.arange(0, schedule.times[-1], schedule.pseudo_period / samples)
    gain = float(model.force_shape[0] * model.tip_shape[0])
    system = scipy.signal.lti([gain], [1, 2 * damping * omega, omega**2])
    _, motion, _ = scipy.signal.lsim(system, np.cos(schedule.phase_at(time)), time)
    level = response_level(motion, samples)[0]
    stationary = gain / (2 * damping * np.sqrt(1 - damping**2) * omega**2) / np.sqrt(2)
    assert stationary_level(model) == pytest.approx(stationary, rel=1e-6)
    assert 0.98 < sweep_ratio(model, 2.0) / (level / stationary) < 1.03  # the ratio is of the larger of up and down
    assert sweep_ratio(model, 2.0) < 0.95


def test_ratio_at_another_place_than_the_absorbers_is_that_of_the_sampled_level() -> None:
    """The level of a scene whose response is read elsewhere comes from samples; the ratio streams it, which must be the same."""
    model = modal_model(replace(STRUCTURES["steel"], modes=3, absorber_position=0.8, response_position=0.6))
    omega = model.resonance_omega(2)
    levels = [simulate(Scene(model), Drive(1.0, linear_sweep(omega, *limits, 4.0))).level for limits in (PAPER_LIMITS, PAPER_LIMITS[::-1])]
    assert sweep_ratio(model, 4.0, 2) * stationary_level(model, 2) == pytest.approx(max(level.value for level in levels if level), rel=1e-9)


def test_bad_input() -> None:
    model = modal_model(Beam(modes=2))
    for call, name in (
        (lambda: default_rate(model, (3,)), "resonance = 3"),
        (lambda: default_rate(model, ()), "resonances"),
        (lambda: sweep_ratio(model, 0.0), "percent_per_100_periods"),
        (lambda: sweep_ratio(model, 1.0, 3), "resonance = 3"),
    ):
        with pytest.raises(ParameterError, match=name):
            call()


@pytest.mark.parametrize("end", [1 - 4e-16, 1 - 1e-16, 1.0, 1 + 2e-16])
def test_an_undamped_resonance_at_an_end_of_the_range_has_no_stationary_level(end: float) -> None:
    for modes in (1, 3, 10):
        model = modal_model(Beam(modes=modes, damping_ratio=0.0))
        assert [stationary_level(model, limits=limits) for limits in ((0.9, end), (end, 1.1))] == [np.inf, np.inf]
