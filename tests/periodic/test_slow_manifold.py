"""The slow invariant manifold is correct.

It is compared with sums of harmonics, dense matrices, exact orbits, and long runs of the exact
method.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from orbit_cases import model_of
from periodic_truth import Truth

from impact_env import Drive, ModalModel, ParameterError, Record, constant_frequency, simulate
from impact_env.periodic import SlowManifold, check_manifold, manifold_gap, modal_restitution
from impact_env.periodic.case import Case
from impact_env.periodic.slow_manifold import VARIANTS
from optimisation.cli.group import imported
from studies.cli.manifold_gaps import SCAN, rows_of, scanned


def other_model() -> ModalModel:
    """Not the paper's beam: four modes, one overdamped, shapes of both signs."""
    return ModalModel(
        [31.0, 74.0, 155.0, 210.0],
        [0.03, 0.02, 1.7, 0.05],
        [0.8, -0.5, 0.4, 0.2],
        [1.1, 0.9, -0.7, 0.5],
        1.4,
    )


OTHER = Case(other_model(), 30.2, 8.0, 3e-3, 0.6, 0.05, 0.06)


def motion_at_impact(case: Case, manifold: SlowManifold, impulse: float) -> tuple[float, float]:
    """Return relative displacement and mean relative velocity at the lower wall.

    They are sums over harmonics, with the first harmonic of the resonant mode given by the
    manifold.
    """
    model = case.model
    order = np.arange(1, 400_001, 2)[:, None]
    omega = case.omega * order
    receptance = 1 / (
        model.omega**2 - omega**2 + 2j * np.asarray(model.damping_ratio) * model.omega * omega
    )
    # force on the structure: alternating impulses -P, and +limit in the half period after the
    # impact on the lower wall
    train = -impulse * 2 * case.omega / np.pi - 4j * case.friction_limit / (np.pi * order)
    response = np.asarray(model.tip_shape) ** 2 * receptance * train
    offset, slope = manifold.coefficients
    response[0, manifold.resonance - 1] = offset + slope * impulse
    tip = float(np.sum(response.real))
    tip_rate = float(np.sum((1j * omega * response).real))
    mass = case.mass_ratio * model.beam_mass
    half = np.pi / case.omega
    absorber = -impulse * half / (4 * mass)
    absorber_rate = case.friction_limit * half / (2 * mass)
    return absorber - tip, absorber_rate - tip_rate


@pytest.mark.parametrize("resonance", [1, 2])
@pytest.mark.parametrize("impulse", [0.01, 0.3])
def test_the_complete_variant_fulfils_the_impact_law_by_sums_of_harmonics(
    resonance: int, impulse: float
) -> None:
    case = replace(OTHER, omega=0.98 * float(OTHER.model.omega[resonance - 1]))
    manifold = SlowManifold(case, resonance, "complete")
    distance, rate = motion_at_impact(case, manifold, impulse)
    mass = case.mass_ratio * case.model.beam_mass
    compliance = 1 / mass + float(np.sum(np.asarray(case.model.tip_shape) ** 2))
    law = compliance * (1 - case.restitution) / (2 * (1 + case.restitution))
    assert distance == pytest.approx(-case.gap, rel=1e-4)
    assert rate == pytest.approx(-law * impulse, rel=1e-3)


@pytest.mark.parametrize("ratio", [0.9, 0.97, 1.04])
def test_with_one_mode_the_fold_force_is_that_of_dense_matrices(ratio: float) -> None:
    model = model_of(1)
    case = Case(model, ratio * float(model.omega[0]), 1.5, restitution=0.75, friction_limit=0.03)
    fold_force = SlowManifold(case, 1, "complete").fold_force
    assert fold_force == pytest.approx(Truth(case).fold_force(), rel=1e-10)


def test_the_modal_restitution_is_that_of_an_impact_of_free_bodies() -> None:
    """The modal restitution is that of an impact of free bodies.

    It is the velocity of the resonant mode alone after an impact of the absorber at one metre a
    second.
    """
    model = other_model()
    mass = 0.06 * model.beam_mass
    shape = np.asarray(model.tip_shape)
    compliance = 1 / mass + shape @ shape
    impulse = (1 + 0.6) / compliance
    for resonance in (1, 2, 3, 4):
        before = -1.0
        after = before + impulse * (1 / mass + shape[resonance - 1] ** 2)
        assert modal_restitution(model, 0.6, 0.06, resonance) == pytest.approx(-after / before)


@pytest.fixture(scope="module")
def orbits_of_ten_modes():
    case = Case(model_of(10), 1.0, 1.0, restitution=0.7)
    return check_manifold(case, 1, np.linspace(0.94, 1.02, 5))


def test_exact_orbits_lie_on_the_manifold_with_the_modal_restitution_and_not_on_the_classical_one(
    orbits_of_ten_modes,
) -> None:
    orbits = orbits_of_ten_modes
    assert len(orbits.points) >= 8
    assert orbits.median_error("classical") > 0.1
    assert orbits.median_error("modal") < 0.03
    assert orbits.median_error("complete") < 0.01
    assert np.max(np.abs(orbits.errors("complete"))) < 0.03


def test_friction_belongs_to_the_manifold() -> None:
    case = Case(model_of(3), 1.0, 1.0, restitution=0.8, friction_limit=0.01)
    rows = check_manifold(case, 1, [0.95, 1.0], [2.0, 3.0])
    assert len(rows.points) >= 3
    assert rows.median_error("complete") < 0.01
    without = replace(rows, case=case.changed(friction_limit=0.0))
    assert without.manifold("corrected").least_amplitude != pytest.approx(
        rows.manifold("corrected").least_amplitude, rel=1e-3
    )


@pytest.mark.parametrize(("share", "settles"), [(0.9, False), (1.08, True)])
def test_the_motion_is_modulated_below_the_onset_and_settles_above_it(
    share: float, settles: bool
) -> None:
    """The motion is modulated below the onset and constant above it.

    One mode is at its resonance. Above the onset all impulses at the end of a run are equal, below
    it they are not.
    """
    model = model_of(1)
    omega = float(model.omega[0])
    case = Case(model, omega, 1.0, restitution=0.7)
    force = share * SlowManifold(case, 1, "complete").modulation_force
    drive = Drive(force, constant_frequency(omega, 1.0, 800.0))
    impacts = simulate(case.scene, drive, record=Record(events=True)).impacts
    assert impacts is not None
    late = np.abs(impacts.impulse[impacts.time > 0.7 * impacts.time[-1]])
    spread = float(np.std(late) / np.mean(late))
    assert spread < 1e-3 if settles else spread > 0.1


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_gap_is_that_whose_onset_is_the_force(variant: str) -> None:
    gap = manifold_gap(OTHER, 1, variant)
    scale = gap / OTHER.gap
    at = OTHER.changed(
        gap=gap,
        friction_limit=scale * OTHER.friction_limit,
        omega=float(OTHER.model.resonance_omega(1)),
    )
    assert SlowManifold(at, 1, variant).modulation_force == pytest.approx(OTHER.force, rel=1e-12)


def test_bad_values_are_refused() -> None:
    with pytest.raises(ParameterError, match="resonance = 5"):
        SlowManifold(OTHER, 5)
    with pytest.raises(ParameterError, match="variant = 'best'"):
        SlowManifold(OTHER, 1, "best")
    with pytest.raises(ParameterError, match="force amplitude"):
        manifold_gap(OTHER.changed(force=0.0))
    model = OTHER.model
    still = ModalModel(
        model.omega, model.damping_ratio, model.force_shape, [0.0, 1.0, 1.0, 1.0], 1.4
    )
    with pytest.raises(ParameterError, match="whose mode moves the absorber's place"):
        SlowManifold(replace(OTHER, model=still))
    undamped = ModalModel([10.0], [0.0], [1.0], [1.0], 1.0)
    with pytest.raises(ParameterError, match="not exactly the resonance of an undamped mode"):
        SlowManifold(Case(undamped, 10.0, 1.0)).modulation_force  # noqa: B018


def test_the_command_writes_formula_orbits_and_map(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("m.json", "m.csv", "m.png")]
    options = ["--json", files[0], "--csv", files[1], "--plot", files[2]]
    options += ["--modes", 3, "--force", 3.5, "--points", 1, "--map-modes", "1,3", "--forces", 3]
    options += ["--from", 1, "--to", 1]
    result = CliRunner().invoke(imported("manifold").main, list(map(str, options)))
    assert result.exit_code == 0, result.output
    plain = json.loads(files[0].read_text())
    assert [row["variant"] for row in plain["variants"]] == list(VARIANTS)
    offset, slope = (complex(*plain["variants"][3][key]) for key in ("offset_m", "slope_m_per_Ns"))
    assert plain["orbits"]
    for orbit in plain["orbits"]:
        near = abs(offset + slope * orbit["impulse_Ns"])
        assert orbit["amplitude_m"] == pytest.approx(near, rel=0.05)
    assert [row["modes"] for row in plain["map"]] == [1, 3]
    assert len(files[1].read_text().splitlines()) == 3
    assert "gap for 3.5 N" in result.output


def test_the_manifolds_gap_is_near_the_best_gap_of_scans() -> None:
    """On structures that are not the paper's beam, without a fitted number."""
    rows = list(rows_of(scanned(SCAN)))
    assert len(rows) >= 28
    error = np.abs(np.log([row.manifold / row.best for row in rows]))
    assert np.median(error) < 0.25
    together = np.abs(np.log([np.sqrt(row.manifold * row.fit) / row.best for row in rows]))
    assert np.median(together) < 0.15
