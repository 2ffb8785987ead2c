"""Tuning of the linear absorber against closed forms and known optima."""

import itertools

import numpy as np
import pytest
import scipy
from scipy.integrate import quad

from impact_env.frequency import poles, state_space, tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, StuckAbsorber, TunedAbsorber
from optimisation.report.tuning_report import (
    NONE,
    PAPER_VALUES,
    make_report,
    paper_tuning,
    tuning_table,
)
from optimisation.tuned import (
    PAPER,
    den_hartog,
    effective_mass_ratio,
    h2_norm,
    minimax,
    minimum_h2,
    paper_rule,
    peak,
    peaks,
    undamped_h2,
    undamped_minimax,
)

MODEL = modal_model(Beam())


def h2_norm_everywhere(model: ModalModel, absorber: TunedAbsorber | StuckAbsorber | None) -> float:
    """Return the H2 norm over all frequencies in m/(N sqrt(s)), by a Lyapunov equation."""
    reference = float(model.omega[0])
    matrix, b, c = state_space(model, absorber, reference)
    return float(
        np.sqrt(
            reference * (c @ scipy.linalg.solve_continuous_lyapunov(matrix, -np.outer(b, b)) @ c)
        )
    )


def one_mode(damping_ratio: float = 0.0, frequency: float = 1.0, shape: float = 1.0) -> ModalModel:
    return ModalModel([frequency], [damping_ratio], [shape], [shape], 1.0)


def test_resonance_without_absorber() -> None:
    height, ratio = peak(MODEL, None)
    assert height == pytest.approx(1.28115e-3, rel=2e-6)
    assert 1e-3 / height == pytest.approx(0.7806, abs=1e-4)
    assert ratio == pytest.approx(1.0, abs=2e-4)


def test_peak_of_one_damped_mode() -> None:
    height, ratio = peak(one_mode(0.02, 250.0, 2.0), None)
    assert height == pytest.approx(4 / 250**2 / (2 * 0.02 * np.sqrt(1 - 0.02**2)), rel=1e-13)
    assert ratio == pytest.approx(np.sqrt(1 - 2 * 0.02**2), abs=1e-7)


def test_peaks_finds_narrow_peaks() -> None:
    height, _ = peak(one_mode(1e-7), None)
    assert height == pytest.approx(1 / 2e-7, rel=1e-9)
    assert peak(one_mode(), None) == (np.inf, pytest.approx(1.0))


def test_scores_of_the_three_tunings() -> None:
    without = peak(MODEL, None)[0]
    best = minimax(MODEL)
    assert best.stiffness == pytest.approx(614.5, abs=0.1)
    assert best.damping == pytest.approx(0.892, abs=5e-4)
    assert peak(MODEL, den_hartog(MODEL))[0] / without == pytest.approx(0.0940, abs=5e-5)
    (first, _), (second, _) = peaks(MODEL, best)
    assert first == pytest.approx(second, rel=1e-8)


@pytest.mark.parametrize("mu", [0.001, 0.08, 0.6])
def test_exact_closed_form_has_equal_peaks(mu: float) -> None:
    maxima = peaks(one_mode(), undamped_minimax(one_mode(), mu), low=0.3)
    assert len(maxima) == 2
    assert maxima[0][0] == pytest.approx(maxima[1][0], rel=1e-6)


@pytest.mark.parametrize("mu", [0.01, 0.3])
def test_numerical_minimax_finds_the_exact_optimum(mu: float) -> None:
    single = one_mode(0.0, 250.0, 2.0)
    mass_ratio = mu / 4
    exact = undamped_minimax(single, mass_ratio)
    tuning = minimax(single, mass_ratio)
    assert tuning.stiffness == pytest.approx(exact.stiffness, rel=1e-6)
    assert tuning.damping == pytest.approx(exact.damping, rel=1e-5)
    assert peak(single, tuning)[0] == pytest.approx(peak(single, exact)[0], rel=1e-9)


@pytest.mark.parametrize("mu", [0.02, 0.25])
def test_den_hartog_fixed_points(mu: float) -> None:
    """Den Hartog's fixed points have the same height for any damping.

    At both frequencies it is sqrt((2 + mu)/mu) times the static displacement.
    """
    single = one_mode()
    rule = den_hartog(single, mu)
    assert rule.damping / (2 * mu * np.sqrt(rule.stiffness / mu)) == pytest.approx(
        np.sqrt(3 * mu / (8 * (1 + mu)))
    )
    centre = 1 / (1 + mu)
    half = np.sqrt(mu / (2 + mu)) / (1 + mu)
    fixed = np.sqrt([centre - half, centre + half])
    for factor in (0.3, 1.0, 3.0):
        heights = np.abs(
            tip_response(single, TunedAbsorber(mu, rule.stiffness, factor * rule.damping), fixed)
        )
        np.testing.assert_allclose(heights, np.sqrt((2 + mu) / mu), rtol=1e-12)


# H2 norms against quadrature, and H2 tunings against the closed form and their own neighbours.


def quadrature(
    model: ModalModel, absorber: TunedAbsorber | StuckAbsorber | None, low: float, high: float
) -> float:
    """Return the norm over low..high (rad/s) from an adaptive quadrature cut at the poles."""
    s = poles(model, absorber)
    cuts = np.unique(
        np.concatenate(
            [[low, high], *(s.imag + k * np.abs(s.real) for k in (-20, -4, -1, 0, 1, 4, 20))]
        )
    )
    cuts = cuts[(cuts >= low) & (cuts <= high)]
    pieces = [
        quad(
            lambda w: abs(tip_response(model, absorber, w)) ** 2,
            a,
            b,
            epsabs=0,
            epsrel=1e-10,
            limit=200,
        )[0]
        for a, b in itertools.pairwise(cuts)
    ]
    return float(np.sqrt(sum(pieces) / np.pi))


@pytest.mark.parametrize(
    "absorber",
    [
        None,
        PAPER,
        StuckAbsorber(0.1),
        TunedAbsorber(0.02, 600.0, 0.0),
        TunedAbsorber(0.05, 300.0, 40.0),
    ],
)
def test_norms_agree_with_quadrature(absorber: TunedAbsorber | StuckAbsorber | None) -> None:
    model = modal_model(Beam(modes=4))
    assert h2_norm_everywhere(model, absorber) == pytest.approx(
        quadrature(model, absorber, 0.0, 1e6), rel=1e-7
    )
    for resonance in (1, 2, 4):
        omega = model.omega[resonance - 1]
        assert h2_norm(model, absorber, resonance) == pytest.approx(
            quadrature(model, absorber, 0.5 * omega, 1.6 * omega), rel=1e-8
        )


def test_one_mode_in_closed_form() -> None:
    single = ModalModel([250.0], [0.02], [2.0], [1.5], 1.0)
    assert h2_norm_everywhere(single, None) == pytest.approx(
        3.0 / np.sqrt(4 * 0.02 * 250.0**3), rel=1e-12
    )
    assert h2_norm(single, None, low=1e-6, high=1e6) == pytest.approx(
        h2_norm_everywhere(single, None), rel=1e-6
    )


def test_coinciding_poles() -> None:
    """A critically damped mode has one pole twice, so its eigenvectors say nothing."""
    critical = ModalModel([1.0, 7.0], [1.0, 0.01], [1.0, 1.0], [1.0, 1.0], 1.0)
    assert h2_norm(critical, None) == pytest.approx(quadrature(critical, None, 0.5, 1.6), rel=1e-6)


@pytest.mark.parametrize("mu", [0.005, 0.08, 0.3])
def test_closed_form_is_the_optimum_of_one_undamped_mode(mu: float) -> None:
    single = ModalModel([250.0], [0.0], [2.0], [2.0], 1.0)
    best = undamped_h2(single, mu / 4)
    value = h2_norm_everywhere(single, best)
    for stiffness, damping in (
        (0.02, 0),
        (-0.02, 0),
        (0, 0.05),
        (0, -0.05),
        (0.01, 0.03),
        (-0.01, 0.03),
    ):
        detuned = TunedAbsorber(
            mu / 4, best.stiffness * (1 + stiffness), best.damping * (1 + damping)
        )
        assert h2_norm_everywhere(single, detuned) > value
    tuning = minimum_h2(single, mu / 4, low=1e-4, high=1e4)
    assert tuning.stiffness == pytest.approx(best.stiffness, rel=1e-3)
    assert tuning.damping == pytest.approx(best.damping, rel=1e-3)


def test_papers_values_follow_from_its_rule() -> None:
    assert effective_mass_ratio(MODEL) == pytest.approx(0.08, rel=1e-5)
    rule = paper_rule(MODEL)
    own = den_hartog(MODEL)
    assert (own.stiffness, own.damping) == (
        pytest.approx(615.4, abs=0.05),
        pytest.approx(0.878, abs=5e-4),
    )
    assert (PAPER.stiffness, PAPER.damping) == (701.8, 0.728)
    assert rule.stiffness == pytest.approx(701.8, abs=0.1)
    assert rule.damping == pytest.approx(0.728, abs=5e-4)
    assert paper_tuning(MODEL) is PAPER
    assert paper_tuning(MODEL, 0.05) == paper_rule(MODEL, 0.05)


def test_table_shows_the_mistuning() -> None:
    table = tuning_table(MODEL)
    by_key = {tuning.key: tuning for tuning in table.tunings}
    assert table.tunings[0].key == NONE
    assert min(table.tunings, key=lambda tuning: tuning.peak).key == "minimax"
    assert min(table.tunings, key=lambda tuning: tuning.h2).key == "h2"
    assert table.relative_peak(by_key[PAPER_VALUES]) == pytest.approx(0.1358, abs=5e-5)
    assert table.relative_peak(by_key["minimax"]) == pytest.approx(0.0938, abs=5e-5)
    assert table.ratios(PAPER)[0] == pytest.approx(
        np.sqrt(701.8 / (0.02 * MODEL.beam_mass)) / MODEL.omega[0]
    )


@pytest.mark.parametrize("mass_ratio", [0.01, 0.05])
def test_an_undamped_structure_has_the_values_of_the_textbook(mass_ratio: float) -> None:
    """Tunings of an undamped structure agree with the textbook.

    Den Hartog's fixed points are both as high as sqrt(1 + 2/mu) times the static deflection, for
    any damping.
    """
    model = modal_model(Beam(modes=1, damping_ratio=0.0))
    table = tuning_table(model, mass_ratio)
    by_key = {tuning.key: tuning for tuning in table.tunings}
    mu = mass_ratio * model.beam_mass * float(model.tip_shape[0]) ** 2
    rule = by_key["den_hartog"]
    assert rule.absorber is not None
    assert table.ratios(rule.absorber) == pytest.approx(
        (1 / (1 + mu), np.sqrt(3 * mu / 8 / (1 + mu)))
    )
    height = np.sqrt(1 + 2 / mu)
    assert height <= table.relative_peak(rule) < 1.01 * height
    assert height <= table.relative_peak(by_key["minimax"]) <= table.relative_peak(rule)
    assert by_key[NONE].peak == by_key[NONE].h2 == np.inf
    plain = make_report(table, {}).numbers["tunings"][NONE]
    assert plain["peak_m_n"] is None
    assert plain["h2_relative"] is None
