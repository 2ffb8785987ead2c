"""H2 norms against quadrature, and H2 tunings against the closed form and their own neighbours."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import quad

from impact_env.frequency import poles, tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, ParameterError, StuckAbsorber, TunedAbsorber
from optimisation.tuned import (
    PAPER,
    den_hartog,
    h2_norm,
    h2_norm_everywhere,
    highest_amplitude,
    minimum_h2,
    paper_rule,
    peak,
    undamped_h2,
)
from optimisation.tuned.table import NONE, PAPER_VALUES, paper_tuning, tuning_table

MODEL = modal_model(Beam())


def quadrature(model: ModalModel, absorber: TunedAbsorber | StuckAbsorber | None, low: float, high: float) -> float:
    """Return the norm over low..high (rad/s) from an adaptive quadrature cut at the poles."""
    s = poles(model, absorber)
    cuts = np.unique(np.concatenate([[low, high], *(s.imag + k * np.abs(s.real) for k in (-20, -4, -1, 0, 1, 4, 20))]))
    cuts = cuts[(cuts >= low) & (cuts <= high)]
    pieces = [
        quad(lambda w: abs(tip_response(model, absorber, w)) ** 2, a, b, epsabs=0, epsrel=1e-10, limit=200)[0] for a, b in itertools.pairwise(cuts)
    ]
    return float(np.sqrt(sum(pieces) / np.pi))


@pytest.mark.parametrize("absorber", [None, PAPER, StuckAbsorber(0.1), TunedAbsorber(0.02, 600.0, 0.0), TunedAbsorber(0.05, 300.0, 40.0)])
def test_norms_agree_with_quadrature(absorber: TunedAbsorber | StuckAbsorber | None) -> None:
    model = modal_model(Beam(modes=4))
    assert h2_norm_everywhere(model, absorber) == pytest.approx(quadrature(model, absorber, 0.0, 1e6), rel=1e-7)
    for resonance in (1, 2, 4):
        omega = model.omega[resonance - 1]
        assert h2_norm(model, absorber, resonance) == pytest.approx(quadrature(model, absorber, 0.5 * omega, 1.6 * omega), rel=1e-8)


def test_one_mode_in_closed_form() -> None:
    single = ModalModel([250.0], [0.02], [2.0], [1.5], 1.0)
    assert h2_norm_everywhere(single, None) == pytest.approx(3.0 / np.sqrt(4 * 0.02 * 250.0**3), rel=1e-12)
    assert h2_norm(single, None, low=1e-6, high=1e6) == pytest.approx(h2_norm_everywhere(single, None), rel=1e-6)


def test_coinciding_poles() -> None:
    """A critically damped mode has one pole twice, so its eigenvectors say nothing."""
    critical = ModalModel([1.0, 7.0], [1.0, 0.01], [1.0, 1.0], [1.0, 1.0], 1.0)
    assert h2_norm(critical, None) == pytest.approx(quadrature(critical, None, 0.5, 1.6), rel=1e-6)


@pytest.mark.parametrize("mu", [0.005, 0.08, 0.3])
def test_closed_form_is_the_optimum_of_one_undamped_mode(mu: float) -> None:
    single = ModalModel([250.0], [0.0], [2.0], [2.0], 1.0)
    best = undamped_h2(single, mu / 4)
    value = h2_norm_everywhere(single, best)
    for stiffness, damping in ((0.02, 0), (-0.02, 0), (0, 0.05), (0, -0.05), (0.01, 0.03), (-0.01, 0.03)):
        beside = TunedAbsorber(mu / 4, best.stiffness * (1 + stiffness), best.damping * (1 + damping))
        assert h2_norm_everywhere(single, beside) > value
    found = minimum_h2(single, mu / 4, low=1e-4, high=1e4)
    assert found.stiffness == pytest.approx(best.stiffness, rel=1e-3)
    assert found.damping == pytest.approx(best.damping, rel=1e-3)


@pytest.mark.parametrize("resonance", [1, 2])
def test_numerical_optimum_beats_the_closed_form_and_its_neighbours(resonance: int) -> None:
    model = modal_model(Beam(modes=5))
    best = minimum_h2(model, resonance=resonance)
    value = h2_norm(model, best, resonance)
    assert value < h2_norm(model, undamped_h2(model, resonance=resonance), resonance)
    for stiffness, damping in ((0.01, 0), (-0.01, 0), (0, 0.02), (0, -0.02)):
        beside = TunedAbsorber(best.mass_ratio, best.stiffness * (1 + stiffness), best.damping * (1 + damping))
        assert h2_norm(model, beside, resonance) > value


def test_papers_values_follow_from_its_rule() -> None:
    rule = paper_rule(MODEL)
    assert rule.stiffness == pytest.approx(701.8, abs=0.1)
    assert rule.damping == pytest.approx(0.728, abs=5e-4)
    assert paper_tuning(MODEL) is PAPER
    assert paper_tuning(MODEL, 0.05) == paper_rule(MODEL, 0.05)
    assert rule.damping < den_hartog(MODEL).damping


def test_table_shows_the_mistuning(monkeypatch: pytest.MonkeyPatch) -> None:
    table = tuning_table(MODEL)
    by_key = {tuning.key: tuning for tuning in table.tunings}
    assert table.tunings[0].key == NONE
    assert table.relative_peak(by_key[PAPER_VALUES]) == pytest.approx(0.1358, abs=5e-5)
    assert min(table.tunings, key=lambda tuning: tuning.peak).key == "minimax"
    assert min(table.tunings, key=lambda tuning: tuning.h2).key == "h2"
    assert table.relative_peak(by_key["minimax"]) == pytest.approx(0.0938, abs=5e-5)
    assert table.ratios(PAPER)[0] == pytest.approx(np.sqrt(701.8 / (0.02 * MODEL.beam_mass)) / MODEL.omega[0])
    monkeypatch.setattr("optimisation.tuned.table.minimax", lambda *_arguments: pytest.fail("searched"))
    with pytest.raises(ParameterError, match="both peaks"):
        tuning_table(MODEL, low=0.9, high=1.06)


def test_highest_amplitude_counts_flanks() -> None:
    height, ratio = highest_amplitude(MODEL, None, 1, 0.5, 0.9)
    assert (height, ratio) == (pytest.approx(float(abs(tip_response(MODEL, None, 0.9 * MODEL.omega[0])))), 0.9)
    assert highest_amplitude(MODEL, PAPER, 1, 0.9, 1.06)[0] < peak(MODEL, PAPER)[0]
    assert highest_amplitude(MODEL, None) == peak(MODEL, None)
    assert highest_amplitude(modal_model(Beam(damping_ratio=0.0)), None)[0] == np.inf


def test_bad_input() -> None:
    undamped = modal_model(Beam(damping_ratio=0.0))
    for call, name in (
        (lambda: h2_norm(MODEL, PAPER, low=0.9, high=1.06), "both peaks"),
        (lambda: h2_norm(MODEL, None, low=1.0, high=0.9), "high"),
        (lambda: h2_norm(undamped, None), "damping_ratio"),
        (lambda: h2_norm_everywhere(undamped, None), "damping_ratio"),
        (lambda: minimum_h2(MODEL, low=0.9, high=1.06), "both peaks"),
        (lambda: minimum_h2(MODEL, -1.0), "mass_ratio"),
        (lambda: paper_rule(MODEL, 0.0), "mass_ratio"),
        (lambda: undamped_h2(MODEL, resonance=99), "resonance"),
        (lambda: highest_amplitude(MODEL, None, low=2.0), "high"),
    ):
        with pytest.raises(ParameterError, match=name):
            call()
