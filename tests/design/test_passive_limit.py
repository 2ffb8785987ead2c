"""The limit of passive devices by semidefinite programming is correct.

It is compared with the closed form, with brute force and with its own multipliers.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impact_env.frequency import receptance, state_space, tip_response
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, StuckAbsorber, TunedAbsorber
from optimisation.bounds import lines as line_terms
from optimisation.bounds import stroke_limit_rms
from optimisation.bounds.relaxation import NotOptimalError, dual_bound, passive_limit
from optimisation.tuned import PAPER, den_hartog, highest_amplitude, peak
from optimisation.tuned.certificate import certify

cvxpy = pytest.importorskip("cvxpy")


MODEL = modal_model(Beam())
MASS = 0.02 * MODEL.beam_mass
GAP = 1e-3


def lines(model: ModalModel, mass: float, force: float, omega: float) -> tuple[complex, complex]:
    """Return A and B of the tip's line q = A + B r, from the receptances."""
    kappa = complex(receptance(model, omega, model.tip_shape, model.tip_shape) * mass * omega**2)
    return complex(force * receptance(model, omega, model.tip_shape, model.force_shape)) / (
        1 - kappa
    ), kappa / (1 - kappa)


@given(
    force=st.floats(-2, 3),
    gap=st.floats(-5, -1),
    mass_ratio=st.floats(-3, 0.5),
    at=st.floats(0.2, 20),
    modes=st.integers(1, 6),
    place=st.floats(0.6, 1),
)
@settings(max_examples=60)
def test_relaxation_is_exact_and_passivity_costs_nothing(
    force: float, gap: float, mass_ratio: float, at: float, modes: int, place: float
) -> None:
    model = modal_model(Beam(modes=modes, absorber_position=place))
    mass = 10**mass_ratio * model.beam_mass
    amplitude = 10**force
    omega = at * model.omega[0]
    limit = passive_limit(model, mass, 10**gap, amplitude, omega)
    closed = float(stroke_limit_rms(model, mass, 10**gap, amplitude, omega))
    a, b = lines(model, mass, amplitude, omega)
    assert limit.rms == pytest.approx(closed, rel=1e-6, abs=3e-5 * abs(a))
    assert limit.rms <= closed * (1 + 1e-9) + 1e-12 * abs(a)
    q = a + b * limit.stroke
    assert abs(q) / np.sqrt(2) == pytest.approx(
        limit.rms, abs=2e-4 * abs(a)
    )  # the stroke found is one that comes that low
    assert abs(limit.stroke) <= 4 * 10**gap / np.pi * (1 + 1e-4)


@given(
    real=st.floats(-3, 3),
    imag=st.floats(-3, 0),
    stroke=st.floats(0, 20),
    power=st.floats(0, 20),
    largest=st.floats(0.5, 5),
)
@settings(max_examples=200)
def test_any_multipliers_give_a_lower_bound(
    real: float, imag: float, stroke: float, power: float, largest: float
) -> None:
    b = complex(real, imag)
    r = (
        largest * np.linspace(0, 1, 61)[:, None] * np.exp(2j * np.pi * np.arange(120) / 120)
    ).ravel()
    admissible = (r * (1 + b * r).conj()).imag <= 0
    smallest = float(np.min(np.abs(1 + b * r[admissible]) ** 2))
    assert dual_bound(b, largest, stroke, power) <= smallest + 1e-9


@given(
    force=st.floats(0, 2),
    gap=st.floats(-4, -2),
    mass_ratio=st.floats(-2.5, 0),
    at=st.floats(0.3, 8),
    place=st.floats(0.3, 0.95),
    phase=st.floats(0, 1),
)
@settings(max_examples=60, deadline=None)
def test_read_elsewhere_no_admissible_passive_stroke_is_below_it(
    force: float, gap: float, mass_ratio: float, at: float, place: float, phase: float
) -> None:
    model = modal_model(Beam(modes=3, absorber_position=place))
    end = modal_model(Beam(modes=3)).tip_shape
    mass = 10**mass_ratio * model.beam_mass
    amplitude = 10**force
    omega = at * model.omega[0]
    size = 4 * 10**gap / np.pi
    limit = passive_limit(model, mass, 10**gap, amplitude, omega, end)
    level, own = (line_terms(model, np.array([mass]), omega, row) for row in (end, model.tip_shape))
    r = (
        size
        * np.linspace(0, 1, 201)[:, None]
        * np.exp(2j * np.pi * (phase + np.arange(1440)) / 1440)
    )
    passive = (r * (amplitude * complex(own.force) + complex(own.strokes[0]) * r).conj()).imag <= 0
    stroke = float(
        np.min(np.abs(amplitude * complex(level.force) + complex(level.strokes[0]) * r)[passive])
    ) / np.sqrt(2)
    stuck = amplitude * abs(complex(level.force))
    assert limit.rms <= stroke * (1 + 1e-9) + 1e-12 * stuck
    assert (
        stroke - limit.rms <= 1e-2 * abs(complex(level.strokes[0])) * size + 1e-4 * stuck
    )  # the grid's spacing
    assert (
        limit.rms
        >= float(stroke_limit_rms(model, mass, 10**gap, amplitude, omega, end)) - 3e-5 * stuck
    )


def test_read_elsewhere_being_passive_can_cost_most() -> None:
    """For a response at another place, passivity can cost most of the reduction.

    The frequency is between two resonances, and the force is farther out than the absorber. To calm
    the end, a device at the absorber's place would have to feed power into the beam.
    """
    beam = Beam(modes=3, absorber_position=0.55, force_position=0.94)
    model = modal_model(beam)
    end = modal_model(replace(beam, absorber_position=1.0)).tip_shape
    mass = 0.02 * model.beam_mass
    omega = 4.57 * model.omega[0]
    stuck = float(stroke_limit_rms(model, mass, 1e-15, 1.0, omega, end))
    line = line_terms(model, np.array([mass]), omega, end)
    gap = (
        np.pi / 4 * 0.5 * abs(complex(line.force) / complex(line.strokes[0]))
    )  # half of what an active device would need to bring the end to rest
    assert float(stroke_limit_rms(model, mass, gap, 1.0, omega, end)) == pytest.approx(
        0.5 * stuck, rel=1e-6
    )
    assert passive_limit(model, mass, gap, 1.0, omega, end).rms > 0.8 * stuck


def test_solution_of_another_problem_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The solution of another problem is refused.

    A status of "optimal" alone proves nothing. The multipliers must prove the level that the stroke
    reaches.
    """
    assert (
        passive_limit(MODEL, MASS, GAP, 5.0, 250.0).rms > 0
    )  # leaves its solution in the compiled problem
    monkeypatch.setattr("optimisation.bounds.relaxation.solve", lambda *_arguments: None)
    with pytest.raises(NotOptimalError, match="multipliers prove"):
        passive_limit(MODEL, MASS, GAP, 20.0, 240.0)


# The proof of a largest amplitude: against the grid and an eigenvalue test that shares nothing with
# it, and what it refuses.


MODEL_CERTIFICATE = modal_model(Beam(modes=3))


def reaches(
    model: ModalModel, absorber: TunedAbsorber | StuckAbsorber | None, amplitude: float
) -> bool:
    """Return whether |H(i w)| equals ``amplitude`` at some frequency.

    In this case the Hamiltonian matrix has an eigenvalue on the imaginary axis.
    """
    a, b, c = state_space(model, absorber, float(model.omega[0]))
    b = b[:, None] / np.sqrt(amplitude)
    c = c[None] / np.sqrt(amplitude)
    s = np.linalg.eigvals(np.block([[a, b @ b.T], [-c.T @ c, -a.T]]))
    return bool(np.any(np.abs(s.real) < 1e-7 * np.abs(s)))


@pytest.mark.parametrize(
    "absorber", [None, PAPER, den_hartog(MODEL_CERTIFICATE), StuckAbsorber(0.1)]
)
def test_bound_over_all_frequencies(absorber: TunedAbsorber | StuckAbsorber | None) -> None:
    proof = certify(MODEL_CERTIFICATE, absorber)
    assert proof.everywhere
    assert proof.grid == pytest.approx(highest_amplitude(MODEL_CERTIFICATE, absorber)[0], rel=1e-12)
    assert proof.grid * (1 - 1e-9) <= proof.bound <= proof.grid * (1 + 1e-4)
    assert reaches(MODEL_CERTIFICATE, absorber, 0.999 * proof.bound)
    assert not reaches(MODEL_CERTIFICATE, absorber, 1.0001 * proof.bound)


def test_bound_within_a_range() -> None:
    """The bound holds within its range of frequencies.

    At the second resonance the first peak is higher, but outside the range. A narrow range can be
    proved, but not scored.
    """
    rule = den_hartog(MODEL_CERTIFICATE, resonance=2)
    proof = certify(MODEL_CERTIFICATE, rule, 2)
    assert not proof.everywhere
    fine = np.abs(
        tip_response(
            MODEL_CERTIFICATE, rule, np.linspace(0.5, 1.6, 40001) * MODEL_CERTIFICATE.omega[1]
        )
    ).max()
    assert fine <= proof.bound <= fine * (1 + 1e-4)
    assert certify(MODEL_CERTIFICATE, rule, 2, everywhere=True).bound > 5 * proof.bound
    flank = certify(MODEL_CERTIFICATE, PAPER, 1, 0.9, 1.06, everywhere=False)
    assert flank.frequency_ratio == 0.9
    assert flank.bound == pytest.approx(
        float(abs(tip_response(MODEL_CERTIFICATE, PAPER, 0.9 * MODEL_CERTIFICATE.omega[0]))),
        rel=1e-4,
    )


def spoil(problem: cvxpy.Problem, *_arguments: object) -> None:
    for variable in problem.variables():
        variable.value = np.zeros(variable.shape)


# what is put in its place, and what the error says: whatever the status, the inequality is checked
# on the numbers given back
SPOILED = {
    "a peak that the grid missed": (
        "optimisation.tuned.certificate.highest_amplitude",
        lambda *_: (0.9 * peak(MODEL_CERTIFICATE, PAPER)[0], 0.87),
        "agreement",
    ),
    "a status": (
        "cvxpy.Problem.status",
        property(lambda _self: "optimal_inaccurate"),
        "optimal_inaccurate",
    ),
    "a matrix that proves nothing": (
        "optimisation.tuned.certificate.solve",
        spoil,
        "matrix inequality",
    ),
}


@pytest.mark.parametrize("everywhere", [True, False])
@pytest.mark.parametrize("name", SPOILED)
def test_what_is_not_proved_is_refused(
    monkeypatch: pytest.MonkeyPatch, name: str, everywhere: bool
) -> None:
    place, instead, words = SPOILED[name]
    monkeypatch.setattr(place, instead)
    with pytest.raises(NotOptimalError, match=words):
        certify(MODEL_CERTIFICATE, PAPER, everywhere=everywhere)
