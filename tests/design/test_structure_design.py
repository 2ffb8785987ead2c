"""Design on other structures than the paper's beam agrees with closed forms.

Dense solutions that share no code with the package are also used for comparison.
"""

import json
from dataclasses import replace
from pathlib import Path

import cantilever
import numpy as np
import pytest
import scipy.signal
import scipy.sparse
from commands import done
from core import STEEL
from design_studies import values_of
from places import EXAMPLES

from impact_env import ModalModel, load_structure
from impact_env.drive import PAPER_LIMITS, Drive, default_rate, linear_sweep
from impact_env.frequency import find_steady_start
from impact_env.level import response_level
from impact_env.modes import assemble_matrices, deflection_row, modal_model
from impact_env.parameters import Beam
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.bounds import design_force, near_range, resonance_limit
from optimisation.cli import structure
from optimisation.mounting import detune, model_with_absorber_at
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.space import design_space
from optimisation.sweep_range import stationary_level, sweep_ratio
from optimisation.tuned import den_hartog, minimax, peak

LENGTH = 1.2
BENDING = 210e9 * 0.04 * 0.008**3 / 12
LINE = 7850 * 0.04 * 0.008
DAMPING = 0.005
MASS = LENGTH * LINE
ADDED = 0.01 * MASS
MODES = 10


def steel() -> Beam:
    beam = load_structure(EXAMPLES / "steel_beam.toml")
    assert isinstance(beam, Beam)
    return beam


def deflection(at: float) -> np.ndarray:
    return cantilever.shapes(MODES, at) / np.sqrt(MASS)


OMEGA = cantilever.roots(MODES) ** 2 * np.sqrt(BENDING / LINE) / LENGTH**2


def receptances(w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the receptances of the absorber's place.

    They are displacements per force at the force's place, and per force at the absorber's own
    place.
    """
    den = OMEGA**2 - w[:, None] ** 2 + 2j * DAMPING * OMEGA * w[:, None]
    return (deflection(0.9) * deflection(0.25) / den).sum(axis=1), (deflection(0.9) ** 2 / den).sum(
        axis=1
    )


def test_the_steel_beam_has_the_modes_of_the_closed_form() -> None:
    model = modal_model(steel())
    np.testing.assert_allclose(
        model.omega, OMEGA, rtol=1e-3
    )  # thirty elements; the mesh stiffens the highest modes
    np.testing.assert_allclose(model.omega[:3], OMEGA[:3], rtol=5e-6)
    np.testing.assert_allclose(
        model.tip_shape[:4] * model.force_shape[:4],
        (deflection(0.9) * deflection(0.25))[:4],
        atol=2e-5,
    )


@pytest.mark.parametrize("resonance", [1, 2])
def test_limit_and_rule_of_the_steel_beam_are_those_of_the_closed_form(resonance: int) -> None:
    model = modal_model(steel())
    gap = 1e-3
    w = OMEGA[resonance - 1] * np.linspace(0.9, 1.06, 40001)
    g_f, g_t = receptances(w)
    kappa = g_t * ADDED * w**2
    reach = np.abs(kappa / (1 - kappa)) * 4 * gap / np.pi
    for force in (0.3, 1.0, 10.0):
        wanted = np.max(np.maximum(0, force * np.abs(g_f / (1 - kappa)) - reach)) / np.sqrt(2)
        assert float(resonance_limit(model, ADDED, gap, force, resonance)) == pytest.approx(
            wanted, rel=2e-3, abs=1e-9
        )
    low, high = near_range(model, ADDED, resonance)
    w = OMEGA[resonance - 1] * np.linspace(low, high, 40001)
    g_f, g_t = receptances(w)
    assert design_force(model, ADDED, gap, resonance) == pytest.approx(
        np.min(np.abs(g_t) * ADDED * w**2 / np.abs(g_f)) * 4 * gap / np.pi, rel=2e-3
    )


@pytest.mark.slow
def test_the_tuned_absorber_of_the_steel_beam_is_the_best_by_dense_solution() -> None:
    beam = steel()
    model = modal_model(beam)
    mu = ADDED * deflection(0.9)[0] ** 2
    rule = den_hartog(model, 0.01)
    assert np.sqrt(rule.stiffness / ADDED) == pytest.approx(OMEGA[0] / (1 + mu), rel=1e-5)
    mass, stiffness = assemble_matrices(beam)
    values, vectors = scipy.linalg.eigh(stiffness, mass)
    damping = mass @ vectors @ np.diag(2 * DAMPING * np.sqrt(values)) @ vectors.T @ mass
    load = deflection_row(beam, 0.25)
    place = deflection_row(beam, 0.9)
    link = np.append(-place, 1.0)
    whole = [np.pad(m, (0, 1)) for m in (mass, damping, stiffness)]
    whole[0][-1, -1] = ADDED
    ratios = np.linspace(0.8, 1.25, 601)

    def largest(k: float, c: float) -> float:
        answers = []
        for w in ratios * OMEGA[0]:
            dynamic = (
                whole[2]
                + 1j * w * whole[1]
                - w**2 * whole[0]
                + (k + 1j * w * c) * np.outer(link, link)
            )
            answers.append(
                abs(np.append(place, 0.0) @ np.linalg.solve(dynamic, np.append(load, 0.0)))
            )
        return max(answers)

    best = minimax(model, 0.01)
    own = largest(best.stiffness, best.damping)
    assert own == pytest.approx(peak(model, best)[0], rel=1e-3)
    for k, c in ((1.03, 1.0), (1.0, 0.85)):
        assert largest(best.stiffness * k, best.damping * c) > 1.005 * own


def small(beam: Beam | ModalModel, **changes: object) -> Problem:
    options = {
        "space": design_space("impact"),
        "conditions": (Condition(1, 3.5), Condition(2, 35.0, detuning=0.02)),
        "members": 2,
        "rate": 40.0,
    }
    return Problem(beam=beam, **(options | changes))


def test_a_problem_takes_a_modal_model_as_it_takes_its_beam() -> None:
    beam = small(Beam(modes=2))
    own = small(modal_model(Beam(modes=2)))
    np.testing.assert_allclose(values_of(own)[:, 0], values_of(beam)[:, 0], rtol=1e-12)
    assert own.describe() != beam.describe()
    assert model_with_absorber_at(detune(own.beam, 0.1)).omega[1] == pytest.approx(
        1.1 * beam.model.omega[1]
    )


@pytest.mark.same_bits
def test_a_problem_puts_the_absorber_where_the_beam_says() -> None:
    problem = small(Beam(modes=3, absorber_position=0.8))
    assert problem.space.default.values["position"] == 0.8
    scene = problem.chunks(problem.space.default, problem.ensemble, problem.rate)[0].lanes[0].scene
    np.testing.assert_array_equal(
        scene.model.tip_shape, modal_model(Beam(modes=3, absorber_position=0.8)).tip_shape
    )
    np.testing.assert_array_equal(
        scene.model.level_shape, modal_model(Beam(modes=3)).tip_shape
    )  # the free end is to be quiet


# The default rate of sweeps, and what a sweep shows of the stationary level.


@pytest.mark.parametrize(
    ("damping", "ratio"), [(0.01, 0.989), (0.005, 0.934), (0.002, 0.718), (0.001, 0.491)]
)
def test_papers_rate_suits_its_damping_only(damping: float, ratio: float) -> None:
    model = modal_model(Beam(damping_ratio=damping))
    assert sweep_ratio(model, 1.0) == pytest.approx(ratio, abs=1e-3)
    assert default_rate(model) == pytest.approx((damping / 0.01) ** 2)
    assert sweep_ratio(model, default_rate(model)) == pytest.approx(0.99, abs=2e-3)


def test_default_rate_holds_for_another_beam_and_its_least_damped_resonance() -> None:
    beam = replace(STEEL, modes=3, damping_ratio=(0.02, 0.004, 0.008))
    model = modal_model(beam)
    assert default_rate(model, (1,)) == 1.0  # never faster than the paper's
    assert default_rate(model, (1, 2, 3)) == default_rate(model, (2,)) == pytest.approx(0.16)
    for resonance in (1, 2, 3):
        assert 0.98 < sweep_ratio(model, default_rate(model, (resonance,)), resonance) < 1.001
    assert default_rate(modal_model(Beam(damping_ratio=0.0))) == pytest.approx(1e-4)


def test_ratio_agrees_with_an_integration_in_the_time_domain() -> None:
    """The ratio of swept to stationary level agrees with an integration in the time domain.

    One mode with 0.4 % damping is swept up. The reference is SciPy's state-space integration of a
    finely sampled force.
    """
    model = modal_model(replace(STEEL, modes=1, damping_ratio=0.004))
    omega = float(model.omega[0])
    damping = 0.004
    schedule = linear_sweep(omega, *PAPER_LIMITS, 2.0)
    samples = 128
    time = np.arange(0, schedule.times[-1], schedule.pseudo_period / samples)
    gain = float(model.force_shape[0] * model.tip_shape[0])
    system = scipy.signal.lti([gain], [1, 2 * damping * omega, omega**2])
    _, motion, _ = scipy.signal.lsim(system, np.cos(schedule.phase_at(time)), time)
    level = response_level(motion, samples)[0]
    stationary = gain / (2 * damping * np.sqrt(1 - damping**2) * omega**2) / np.sqrt(2)
    assert stationary_level(model) == pytest.approx(stationary, rel=1e-6)
    assert (
        0.98 < sweep_ratio(model, 2.0) / (level / stationary) < 1.03
    )  # the ratio is of the larger of up and down
    assert sweep_ratio(model, 2.0) < 0.95


def test_ratio_at_another_place_than_the_absorbers_is_that_of_the_sampled_level() -> None:
    """The ratio of levels at another place is that of the sampled level.

    If the response is read at another place than the absorber's, the level of a scene comes from
    samples. The ratio computes the same level during the run.
    """
    model = modal_model(replace(STEEL, modes=3, absorber_position=0.8, response_position=0.6))
    omega = model.resonance_omega(2)
    scene = Scene(model)
    drives = [
        Drive(1.0, linear_sweep(omega, *limits, 4.0))
        for limits in (PAPER_LIMITS, PAPER_LIMITS[::-1])
    ]
    levels = [
        simulate(scene, drive, initial=find_steady_start(scene, drive)).level for drive in drives
    ]
    assert sweep_ratio(model, 4.0, 2) * stationary_level(model, 2) == pytest.approx(
        max(level.value for level in levels if level), rel=1e-9
    )


@pytest.mark.parametrize("end", [1 - 4e-16, 1 - 1e-16, 1.0, 1 + 2e-16])
def test_an_undamped_resonance_at_an_end_of_the_range_has_no_stationary_level(end: float) -> None:
    for modes in (1, 3, 10):
        model = modal_model(Beam(modes=modes, damping_ratio=0.0))
        assert [stationary_level(model, limits=limits) for limits in ((0.9, end), (end, 1.1))] == [
            np.inf,
            np.inf,
        ]


# The command `structure`: modes and places of a file, beside closed forms, and nodes near a point.


PINNED = """[beam]
length_m = 1.0
young_modulus_pa = 210e9
density_kg_m3 = 7850
section = { kind = "rectangle", width_m = 0.04, height_m = 0.01 }
ends = "pinned-pinned"
damping_ratio = 0.004
force_position = 0.5
absorber_position = 0.25
"""


def test_a_beam_of_material_and_section_has_the_modes_of_the_closed_form(tmp_path: Path) -> None:
    file = tmp_path / "beam.toml"
    target = tmp_path / "a.json"
    picture = tmp_path / "a.svg"
    file.write_text(PINNED)
    output = done(structure, file, "--json", target, "--plot", picture).output
    assert "mass 3.14 kg: an absorber of 1 % has 0.0314 kg" in output
    assert "force, absorber and response at 0.5, 0.25, 0.25 of the length, 1 m" in output
    printed = json.loads(target.read_text())
    stiffness = 210e9 * 0.04 * 0.01**3 / 12
    per_length = 7850 * 0.04 * 0.01
    for n, row in enumerate(printed["modes"][:3], 1):
        omega = (n * np.pi) ** 2 * np.sqrt(stiffness / per_length)
        force, tip = (np.sqrt(2 / 3.14) * np.sin(n * np.pi * x) for x in (0.5, 0.25))
        assert row["frequency_hz"] == pytest.approx(omega / (2 * np.pi), rel=1e-4)
        assert abs(row["tip_shape_per_sqrt_kg"]) == pytest.approx(abs(tip), rel=1e-3)
        assert row["mass_at_absorber_kg"] == pytest.approx(1 / tip**2, rel=2e-3)
        assert row["free_amplitude_m_per_n"] == pytest.approx(
            abs(force * tip) / (2 * 0.004 * omega**2), rel=2e-3, abs=1e-12
        )
    assert picture.read_bytes().startswith(b"<?xml")


def test_rows_of_matrices_near_a_point(tmp_path: Path) -> None:
    chain = scipy.sparse.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(6, 6))
    scipy.sparse.save_npz(tmp_path / "K.npz", scipy.sparse.csr_matrix(1e4 * chain))
    scipy.sparse.save_npz(tmp_path / "M.npz", scipy.sparse.eye(6, format="csr"))
    (tmp_path / "nodes.csv").write_text(
        "x_m,y_m,z_m\n" + "".join(f"{0.1 * (k // 2)},0,0\n" for k in range(6))
    )  # two rows a node
    keys = (
        'mass = "M.npz"\nstiffness = "K.npz"\nunits = "kg, m, s"\nforce = 1\nabsorber = '
        "4\nmass_kg = 6\ndamping_ratio = 0.01\n"
    )
    (tmp_path / "chain.toml").write_text(f'[matrices]\n{keys}coordinates = "nodes.csv"\n')
    assert (
        "row 2, 3: 20 mm away\nrow 4, 5: 80 mm away\nrow 0, 1: 120 mm away"
        in done(structure, tmp_path / "chain.toml", "--near", 0.12, 0, 0).output
    )


def test_nodes_of_a_universal_file_near_a_point(tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(tmp_path / "a.uff"))
    n = np.arange(11, 14)
    zero = np.zeros(3)
    places = {"x": np.array([0.0, 0.5, 1.0]), "y": zero, "z": zero}
    file.write_sets(
        {"type": 15, "node_nums": n, "def_cs": n * 0, "disp_cs": n * 0, "color": n * 0, **places},
        "add",
    )
    at = {"node_nums": n, "r1": zero, "r2": zero, "r3": np.array([0.5, 1.0, 0.5])}
    numbers = {
        "analysis_type": 2,
        "data_ch": 2,
        "spec_data_type": 8,
        "data_type": 2,
        "n_data_per_node": 3,
        "load_case": 0,
        "mode_n": 1,
    }
    damping = {"modal_m": 1.0, "modal_damp_vis": 0.01, "modal_damp_his": 0.0}
    file.write_sets(
        pyuff.prepare_55(id1="a", model_type=1, freq=40.0, **numbers, **damping, **at), "add"
    )
    place = '{ node = 12, direction = "z" }'
    (tmp_path / "a.toml").write_text(
        f'[universal]\nfile = "a.uff"\nforce = {place}\nabsorber = {place}\nmass_kg = 2\n'
    )
    assert (
        "node 12: 100 mm away\nnode 13: 400 mm away"
        in done(structure, tmp_path / "a.toml", "--near", 0.6, 0, 0).output
    )
