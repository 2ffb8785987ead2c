"""Commands and environments work on a structure from a file.

Sweeps are so fast that the numbers do not matter.
"""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from commands import call as call_command
from commands import done, load
from places import EXAMPLES

from impact_env import Beam, beam_scene, impact_absorber, load_structure, modal_model
from impact_env.curve import performance_curve
from impact_env.periodic.case import Case
from impact_env.periodic.survey import closed_form_orbits
from impact_env.plain import from_scene
from impact_env.scene import Scene
from optimisation.absorber_rules import best_friction
from optimisation.bounds import design_force, design_gap
from optimisation.mounting import model_with_absorber_at
from optimisation.sweep_range import find_sweep_range
from optimisation.tuned import den_hartog, undamped_h2

STEEL, FRAME, MEASURED = (
    str(EXAMPLES / f"{name}.toml") for name in ("steel_beam_tip", "frame", "measured")
)


@pytest.fixture(autouse=True)
def quickly_tuned(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = lambda model, mass, resonance=1, *_range: den_hartog(model, mass, resonance)  # noqa: E731
    monkeypatch.setattr("optimisation.comparison.minimax", closed)
    monkeypatch.setattr("optimisation.report.tuning_report.minimax", closed)
    monkeypatch.setattr(
        "optimisation.report.tuning_report.minimum_h2",
        lambda model, mass, resonance, *_range: undamped_h2(model, mass, resonance),
    )


def call(name: str, monkeypatch: pytest.MonkeyPatch, line: str) -> Result:
    return done(load(name, monkeypatch), *shlex.split(line))


@pytest.mark.parametrize("structure", [FRAME, MEASURED])
def test_every_example_runs_from_rule_to_comparison(
    structure: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if structure == MEASURED:
        pytest.importorskip("pyuff")
    model = modal_model(load_structure(structure))
    result = call(
        "design_gap",
        monkeypatch,
        (
            f"--structure {structure} --mass-ratio 0.01 --force 2 --rate 40 --gaps 3 --members 1 "
            f"--out {tmp_path}"
        ),
    )
    assert (
        "Design rule (no simulation): "
        f"{1e3 * design_gap(model, 0.01 * model.beam_mass, 2.0):.4g} mm"
    ) in result.output
    line = (
        f"--structure {structure} --mass-ratio 0.01 --force 2 --resonances 1 1 --rate 40 --forces "
        f"2 --members 1 --out {tmp_path}"
    )
    call("compare_absorbers", monkeypatch, line)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["settings"]["gap_m"] == pytest.approx(
        design_gap(model, 0.01 * model.beam_mass, 2.0)
    )
    assert list(summary["resonances"]) == ["1"]
    concepts = summary["resonances"]["1"]["concepts"]
    damper = concepts["friction"]["absorber"]["friction"]["limit"]
    estimate = best_friction(model, 0.01 * model.beam_mass, 2.0)[0]
    assert estimate / 5 < damper < 5 * estimate
    assert concepts["ltva_tuned"]["absorber"]["stiffness"] == pytest.approx(
        den_hartog(model, 0.01).stiffness, rel=0.1
    )


def test_a_sweep_has_the_rule_gap_and_writes_its_scene(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    model = modal_model(load_structure(STEEL))
    target = tmp_path / "sweep.json"
    options = "--rate 40 --mass-ratio 0.01"
    call("sweep", monkeypatch, f"--structure {STEEL} --force 0.3 {options} --json {target}")
    output = json.loads(target.read_text())
    assert output["scene"]["beam"]["response_position"] == 0.9
    assert output["scene"]["absorber"]["gap"] == pytest.approx(
        design_gap(model, 0.01 * model.beam_mass, 0.3)
    )
    np.testing.assert_array_equal(output["omega_rad_s"], model.omega)
    target.with_name("scene.json").write_text(json.dumps(output["scene"]))
    call(
        "sweep",
        monkeypatch,
        f"--scene {target.with_name('scene.json')} --rate 40 --force 0.3 --json {target}",
    )
    assert json.loads(target.read_text())["response_level_m"] == output["response_level_m"]


def test_periodic_motions_are_of_the_structure_and_at_the_force_of_the_rule(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    target = tmp_path / "periodic.json"
    model = modal_model(load_structure(FRAME))
    force = design_force(model, 0.01 * model.beam_mass, 1e-3, 1)
    line = f"--structure {FRAME} --mass-ratio 0.01 --from 0.97 --to 0.99 --json {target}"
    call("frequency_response", monkeypatch, f"{line} --method balance --harmonics 3 --no-sweeps")
    assert json.loads(target.read_text())["force_N"] == pytest.approx(force)
    call("orbits", monkeypatch, f"{line} --points 2 --symmetric")
    for orbit in json.loads(target.read_text()):
        case = Case(
            model, orbit["omega_ratio"] * float(model.omega[0]), force, 1e-3, mass_ratio=0.01
        )
        known = [o.motion.tip_max for o in closed_form_orbits(case).orbits]
        assert min(abs(orbit["tip_max_m"] / tip - 1) for tip in known) < 1e-6


def test_mode_shapes_are_compared_with_a_second_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    target = tmp_path / "mac.json"
    printed = call("structure", monkeypatch, f"{FRAME} --mac {FRAME} --json {target}").output
    mac = json.loads(target.read_text())["mac"]
    assurance = np.array(mac["assurance"])
    np.testing.assert_allclose(np.diag(assurance), 1.0)
    np.testing.assert_allclose(assurance, assurance.T, atol=1e-12)
    assert f"{assurance[0, 1]:.3f}" in printed
    assert "mode 1, +0.00 %" in printed
    refused = call_command(load("structure", monkeypatch), FRAME, "--mac", STEEL)
    assert refused.exit_code != 0
    assert "a file with nodes" in refused.output


def test_a_search_takes_the_structure_and_its_forces(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("optuna")
    short = "--rate 40 --members 1 --designs 4 --no-screening --no-figures --audit 0 --threads 1"
    line = f"--structure {STEEL} --fix mass_ratio 0.01 --resonances 1 3 {short} --out {tmp_path}"
    call("optimise_design", monkeypatch, line)
    problem = json.loads((tmp_path / "impact" / "summary.json").read_text())["problem"]
    assert problem["beam"]["length"] == 1.2
    assert [c["resonance"] for c in problem["conditions"]] == [1, 3]
    model = modal_model(load_structure(STEEL))
    for condition in problem[
        "conditions"
    ]:  # about the forces that a gap of 1 mm is for, as 3.5 and 35 N are on the paper's beam
        assert design_gap(
            model, 0.01 * model.beam_mass, condition["force"], condition["resonance"]
        ) == pytest.approx(1e-3, rel=0.1)


def test_an_environment_takes_a_structure() -> None:
    pytest.importorskip("gymnasium")
    from impact_env.envs.settings import TaskSettings

    settings = TaskSettings(structure=STEEL, absorber_options={"gap": 1e-3, "mass_ratio": 0.01})
    model = modal_model(load_structure(STEEL))
    np.testing.assert_array_equal(settings.scene.model.omega, model.omega)
    np.testing.assert_array_equal(settings.scene.model.level_shape, model.level_shape)
    assert settings.scene.model.response_shape is not None
    assert (
        settings.scene
        is TaskSettings(structure=STEEL, absorber_options={"mass_ratio": 0.01, "gap": 1e-3}).scene
    )
    with pytest.raises(ValueError, match="is not allowed"):
        TaskSettings(structure=STEEL, beam={"length": 1.0})


def test_a_device_goes_to_other_commands(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    beam = Beam(modes=2, damping_ratio=0.02, response_position=1.0)
    device = tmp_path / "device.json"
    device.write_text(
        json.dumps(from_scene(beam_scene(beam, impact_absorber(7e-4, 0.55, 0.03, 0.015)), beam))
    )
    line = (
        f"--scene {device} --force 1.7 --resonances 1 2 --forces 2 --members 1 --rate 60 --out "
        f"{tmp_path}"
    )
    call("compare_absorbers", monkeypatch, line)
    summary = json.loads((tmp_path / "summary.json").read_text())
    impact = summary["resonances"]["1"]["concepts"]["impact"]["absorber"]
    assert impact == {
        "mass_ratio": 0.015,
        "walls": {"gap": 7e-4, "restitution": 0.55},
        "friction": {"limit": 0.03, "static_ratio": 1.0},
        "gravity": 0.0,
    }
    model = model_with_absorber_at(beam)
    first, second = (summary["resonances"][k]["concepts"] for k in ("1", "2"))
    own = performance_curve(
        Scene(model, impact_absorber(7e-4, 0.55, 0.03, 0.015)),
        [1.7],
        members=1,
        limits=find_sweep_range(model, 0.015),
        percent_per_100_periods=60.0,
        steady_start=True,
    )
    assert first["impact"]["at_the_force"]["response_level_m"] == pytest.approx(
        own.median[0], rel=1e-9
    )
    damper = first["friction"]["absorber"]["friction"]["limit"]
    estimate = best_friction(model, 0.015 * model.beam_mass, 1.7)[0]
    assert estimate / 5 < damper < 5 * estimate
    assert "at_the_force" not in second["impact"]
    call("tune_ltva", monkeypatch, f"--scene {device} --quick --out {tmp_path}")
    assert json.loads((tmp_path / "summary.json").read_text())["settings"]["mass_ratio"] == 0.015
    line = (
        f"--scene {device} --at 1:2 --free gap --members 1 --rate 60 --batch 2 --designs 2 "
        f"--no-figures --audit 0 --out {tmp_path}"
    )
    call("optimise_design", monkeypatch, line)
    values = json.loads((tmp_path / "impact" / "summary.json").read_text())["winner"]["values"]
    assert (values["restitution"], values["friction_limit"], values["mass_ratio"]) == (
        0.55,
        0.03,
        0.015,
    )
