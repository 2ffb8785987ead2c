"""Tuning of the linear absorber against closed forms and known optima."""

import itertools

import numpy as np
import pytest
from scipy.integrate import quad

from impact_env.frequency import natural_frequencies, poles, tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, ParameterError, StuckAbsorber, TunedAbsorber
from optimisation.report.tuning_report import NONE, PAPER_VALUES, paper_tuning, tuning_table
from optimisation.tuned import (
    PAPER,
    den_hartog,
    effective_mass_ratio,
    h2_norm,
    h2_norm_everywhere,
    highest_amplitude,
    minimax,
    minimum_h2,
    paper_rule,
    peak,
    peaks,
    undamped_h2,
    undamped_minimax,
)


@pytest.fixture(scope="module")
def model() -> ModalModel:
    return modal_model(Beam())


def one_mode(damping_ratio: float = 0.0, frequency: float = 1.0, shape: float = 1.0) -> ModalModel:
    return ModalModel([frequency], [damping_ratio], [shape], [shape], 1.0)


def test_resonance_without_absorber(model: ModalModel) -> None:
    height, ratio = peak(model, None)
    assert height == pytest.approx(1.28115e-3, rel=2e-6)
    assert 1e-3 / height == pytest.approx(0.7806, abs=1e-4)
    assert ratio == pytest.approx(1.0, abs=2e-4)


def test_peak_of_one_damped_mode() -> None:
    height, ratio = peak(one_mode(0.02, 250.0, 2.0), None)
    assert height == pytest.approx(4 / 250**2 / (2 * 0.02 * np.sqrt(1 - 0.02**2)), rel=1e-13)
    assert ratio == pytest.approx(np.sqrt(1 - 2 * 0.02**2), abs=1e-7)


def test_narrow_peaks_are_found() -> None:
    height, _ = peak(one_mode(1e-7), None)
    assert height == pytest.approx(1 / 2e-7, rel=1e-9)
    assert peak(one_mode(), None) == (np.inf, pytest.approx(1.0))
    with pytest.raises(ParameterError, match="damping_ratio"):
        peaks(one_mode(), None)


def test_effective_mass_and_reference_values(model: ModalModel) -> None:
    assert effective_mass_ratio(model) == pytest.approx(0.08, rel=1e-5)
    rule = den_hartog(model)
    assert rule.stiffness == pytest.approx(615.4, abs=0.05)
    assert rule.damping == pytest.approx(0.878, abs=5e-4)
    assert (PAPER.stiffness, PAPER.damping) == (701.8, 0.728)


def test_scores_of_the_three_tunings(model: ModalModel) -> None:
    without = peak(model, None)[0]
    best = minimax(model)
    assert best.stiffness == pytest.approx(614.5, abs=0.1)
    assert best.damping == pytest.approx(0.892, abs=5e-4)
    assert peak(model, PAPER)[0] / without == pytest.approx(0.1358, abs=5e-5)
    assert peak(model, den_hartog(model))[0] / without == pytest.approx(0.0940, abs=5e-5)
    assert peak(model, best)[0] / without == pytest.approx(0.0938, abs=5e-5)
    (first, _), (second, _) = peaks(model, best)
    assert first == pytest.approx(second, rel=1e-8)


@pytest.mark.parametrize("resonance", [2, 3])
def test_minimax_of_higher_resonances_beats_the_closed_forms(model: ModalModel, resonance: int) -> None:
    best = minimax(model, resonance=resonance)
    height = peak(model, best, resonance)[0]
    assert height < 0.12 * peak(model, None, resonance)[0]
    for closed in (den_hartog(model, resonance=resonance), undamped_minimax(model, resonance=resonance)):
        assert height < peak(model, closed, resonance)[0]
    (first, _), (second, _) = peaks(model, best, resonance)
    assert first == pytest.approx(second, rel=1e-7)


@pytest.mark.parametrize("mu", [0.001, 0.01, 0.08, 0.3, 0.6])
def test_exact_closed_form_has_equal_peaks(mu: float) -> None:
    found = peaks(one_mode(), undamped_minimax(one_mode(), mu), low=0.3)
    assert len(found) == 2
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-6)


@pytest.mark.parametrize("mu", [0.01, 0.3])
def test_numerical_minimax_finds_the_exact_optimum(mu: float) -> None:
    single = one_mode(0.0, 250.0, 2.0)
    mass_ratio = mu / 4
    exact, found = undamped_minimax(single, mass_ratio), minimax(single, mass_ratio)
    assert found.stiffness == pytest.approx(exact.stiffness, rel=1e-6)
    assert found.damping == pytest.approx(exact.damping, rel=1e-5)
    assert peak(single, found)[0] == pytest.approx(peak(single, exact)[0], rel=1e-9)


@pytest.mark.parametrize("mu", [0.02, 0.08, 0.25])
def test_den_hartog_fixed_points(mu: float) -> None:
    """The two frequencies at which the damping does not matter have one height, sqrt((2 + mu)/mu) times the static one."""
    single = one_mode()
    rule = den_hartog(single, mu)
    assert rule.damping / (2 * mu * np.sqrt(rule.stiffness / mu)) == pytest.approx(np.sqrt(3 * mu / (8 * (1 + mu))))
    centre, half = 1 / (1 + mu), np.sqrt(mu / (2 + mu)) / (1 + mu)
    fixed = np.sqrt([centre - half, centre + half])
    for factor in (0.3, 1.0, 3.0):
        heights = np.abs(tip_response(single, TunedAbsorber(mu, rule.stiffness, factor * rule.damping), fixed))
        np.testing.assert_allclose(heights, np.sqrt((2 + mu) / mu), rtol=1e-12)


def test_tuning_follows_the_units_and_the_attachment() -> None:
    """Frequency and shape only scale the closed forms: what counts is the effective mass ratio."""
    here, there = den_hartog(one_mode(), 0.08), den_hartog(one_mode(0.0, 100.0, 2.0), 0.02)
    assert there.stiffness == pytest.approx(here.stiffness * 100**2 / 4)
    assert there.damping == pytest.approx(here.damping * 100 / 4)


def test_ranges_too_narrow_for_both_peaks_are_refused(model: ModalModel) -> None:
    for score in (lambda: peak(model, PAPER, low=0.9, high=1.06), lambda: minimax(model, low=0.9, high=1.06), lambda: peaks(model, PAPER, high=1.06)):
        with pytest.raises(ParameterError, match=r"scoring range .*both peaks"):
            score()
    assert peak(model, None, low=0.9, high=1.06)[0] == pytest.approx(peak(model, None)[0], rel=1e-12)
    with pytest.raises(ParameterError, match="scoring range"):  # a heavy absorber splits wider than the default range
        minimax(model, 0.25)


def test_a_tight_range_does_not_hide_a_peak(model: ModalModel) -> None:
    tight = minimax(model, low=0.83, high=1.11)
    assert peak(model, tight)[0] == pytest.approx(peak(model, minimax(model))[0], rel=1e-6)
    low, high = natural_frequencies(model, tight)[:2] / model.omega[0]
    assert low >= 0.83
    assert high <= 1.11


# H2 norms against quadrature, and H2 tunings against the closed form and their own neighbours.


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
    monkeypatch.setattr("optimisation.report.tuning_report.minimax", lambda *_arguments: pytest.fail("searched"))
    with pytest.raises(ParameterError, match="both peaks"):
        tuning_table(MODEL, low=0.9, high=1.06)


def test_highest_amplitude_counts_flanks() -> None:
    height, ratio = highest_amplitude(MODEL, None, 1, 0.5, 0.9)
    assert (height, ratio) == (pytest.approx(float(abs(tip_response(MODEL, None, 0.9 * MODEL.omega[0])))), 0.9)
    assert highest_amplitude(MODEL, PAPER, 1, 0.9, 1.06)[0] < peak(MODEL, PAPER)[0]
    assert highest_amplitude(MODEL, None) == peak(MODEL, None)
    assert highest_amplitude(modal_model(Beam(damping_ratio=0.0)), None)[0] == np.inf
