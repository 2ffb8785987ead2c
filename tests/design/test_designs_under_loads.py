"""Searches under loads: problems whose measures are written out, members with records of their own, and both commands on a structure of one mode."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import call, read
from load_cases import MASS, OMEGA

from impact_env.loads import Loads, Random, Shock
from impact_env.modes import ModalModel
from impact_env.parameters import ParameterError, impact_absorber
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.cli.design_options import load_conditions
from optimisation.cli.group import imported
from optimisation.designs import GAP, IMPACT, TUNED, design_space
from optimisation.evaluation import evaluate_arrays
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.problem import Problem

MODEL = ModalModel(*(np.array([x]) for x in (OMEGA[0], 0.02, 0.6, 2.6)), MASS)
NOISE = Loads((Random(np.array(((35.0, 0.5), (46.0, 0.5))), 4.0, 1),), OMEGA[0])
SHOCK = Loads((Shock("half-sine", 20.0, 0.0125, 0.5),), OMEGA[0])
STRUCTURE = f"""
[model]
omega_rad_s = [{OMEGA[0]}]
damping_ratio = [0.02]
force_shape_per_sqrt_kg = [0.6]
tip_shape_per_sqrt_kg = [2.6]
beam_mass_kg = {MASS}
"""


def problem(loads: Loads, factors: tuple[float, ...] = (1.0,), members: int = 1, **more: object) -> Problem:
    conditions = tuple(Condition(1, factor, loads=loads) for factor in factors)
    return Problem(design_space(IMPACT, (GAP,)), conditions, beam=MODEL, members=members, **more)


def late_rms(scene: Scene, factor: float) -> float:
    """Return the RMS after five time constants under so many times the noise, from the run's samples."""
    record = Record(level=False, series=True, samples_per_period=64)
    history = simulate(scene, Loads((Random(NOISE.parts[0].spectrum, 4.0, 1, factor=factor),), OMEGA[0]), record=record).history
    late = history.time >= 5 / (0.02 * OMEGA[0])
    return float(np.sqrt(np.mean(history.tip_displacement[late] ** 2)))


def test_a_design_is_judged_by_the_measure_of_its_loads() -> None:
    """Member 0 meets the loads as they are, times the factor, and the value is relative to the same record without absorber."""
    own = problem(NOISE, (1.0, 2.0))
    gap = own.space.free[0]
    F, _, _ = evaluate_arrays(own, [[own.space.coordinates(own.space.decoded({gap.name: gap.low}))[gap.name]]])
    design = own.space.decoded({gap.name: gap.low})
    expected = []
    for factor in (1.0, 2.0):
        absorber = impact_absorber(design.values[GAP], design.values["restitution"], design.values["friction_limit"], 0.02)
        expected.append(late_rms(Scene(MODEL, absorber), factor) / late_rms(Scene(MODEL), factor))
    assert F[0, 0] == pytest.approx(max(expected), rel=1e-9)


def test_every_member_has_a_record_of_its_own() -> None:
    """Also those of the set on which a winner is judged, and the parts of a set that a search runs one after the other."""
    own = problem(NOISE, members=6)
    sets = [own.ensemble, own.fresh_ensemble(6, 0), own.fresh_ensemble(6, 1)]
    drawn = [lane.drive.parts[0].amplitudes()[0] for members in sets for chunk in own.chunks(None, members, own.rate) for lane in chunk.lanes]
    assert len(drawn) == 18
    assert len(set(drawn)) == 18
    again = [lane.drive.parts[0].amplitudes()[0] for chunk in own.chunks(None, own.ensemble[4:6], own.rate) for lane in chunk.lanes]
    assert again == drawn[4:6]


def test_a_search_begins_at_the_gap_that_the_free_motion_sets() -> None:
    history = simulate(Scene(MODEL), SHOCK, record=Record(level=False, series=True)).history
    largest = float(np.max(np.abs(history.tip_displacement)))
    assert problem(SHOCK).space.default.values[GAP] == pytest.approx(1.5 * largest / np.sqrt(2), rel=0.01)


def test_what_a_problem_is_tells_its_loads() -> None:
    told = [problem(loads).describe()["conditions"] for loads in (NOISE, SHOCK, Loads(SHOCK.parts, OMEGA[0], "lower-wall"))]
    assert len({json.dumps(one) for one in told}) == 3
    assert told[0] == problem(NOISE).describe()["conditions"]


def test_what_does_not_go_with_loads_is_refused() -> None:
    mixed = (*load_conditions(NOISE), Condition(1, 1.0))
    with pytest.raises(ParameterError, match="loads in all of them, or in none"):
        Problem(design_space(TUNED), mixed, beam=MODEL)
    with pytest.raises(ParameterError, match="another under shocks"):
        problem(SHOCK, constraints=(Constraint("level", 1e-3),))
    with pytest.raises(ParameterError, match="another under shocks"):
        problem(SHOCK, objectives=(Objective("absolute"),))
    with pytest.raises(ParameterError, match="left out under loads"):
        problem(NOISE, uncertain={"gap": (0.9e-3, 1.1e-3)})


def written(folder: Path) -> list[object]:
    (folder / "structure.toml").write_text(STRUCTURE)
    (folder / "load.toml").write_text('[load]\nkind = "shock"\npulse = "half-sine"\npeak_n = 20.0\npulse_s = 0.0125\nduration_s = 0.5\n')
    return ["--structure", folder / "structure.toml", "--load", folder / "load.toml", "--out", folder / "out", "--designs", 10, "--members", 2]


def test_optimise_design_under_a_shock(tmp_path: Path) -> None:
    given = written(tmp_path)
    result = call(imported("optimise_design"), *given, "--quick", "--free", "gap", "--threads", 1)
    assert result.exit_code == 0, result.output
    out = tmp_path / "out" / "impact"
    found = json.loads((out / "summary.json").read_text())
    condition = found["conditions"][0]
    assert condition["winner"]["decay_s"] == pytest.approx(condition["winner"]["relative"] * condition["without_s"])
    assert condition["winner"]["relative"] < 0.7
    assert "in_service" not in found
    assert f"{condition['winner']['decay_s']:.3f} s, {100 * condition['winner']['relative']:.1f} % of no absorber" in result.output
    assert {"load", "factor", "decay_median_s"} <= set(read(out / "curves.csv")[0])
    for option, value in (("--at", "1:3"), ("--rate", 1), ("--uncertain", "gap 5%")):
        refused = call(imported("optimise_design"), *given, option, *str(value).split())
        assert refused.exit_code == 2
        assert f"{option} does not go with --load" in refused.output


def test_a_front_under_a_shock(tmp_path: Path) -> None:
    given = written(tmp_path)
    result = call(imported("pareto"), *given, "--batch", 5, "--free", "gap", "--threads", 1)
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "out" / "severity" / "summary.json").read_text())
    assert len(found["front"]) >= 1
    assert "under shock, 1 times; the level is the decay time" in result.output
    refused = call(imported("pareto"), *given, "--against", "resonances")
    assert refused.exit_code == 2
    assert "--against does not go with --load" in refused.output
