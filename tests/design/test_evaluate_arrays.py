"""Designs in arrays for other people's optimisers, and the adapter in the style of EngiBench."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impact_env import ParameterError
from optimisation.designs import design_space
from optimisation.evaluation import Threads, evaluate
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.problem import Problem
from studies.rule import STRUCTURES

STEEL = replace(STRUCTURES["steel"], modes=2)


class Backwards(Threads):
    """An executor that finishes the last chunk first, and may give up the runs of some gaps."""

    lost = ()

    def run(self, chunks):  # type: ignore[no-untyped-def]
        for k, values in reversed(list(super().run(chunks))):
            gap = chunks[k].lanes[0].scene.absorber.walls.gap
            yield k, np.full_like(values, np.nan) if any(abs(gap - x) < 1e-9 for x in self.lost) else values


def steel(**changes: object) -> Problem:
    given = {
        "space": design_space("impact", ["gap", "friction_limit"]),
        "conditions": (Condition(1, 0.5),),
        "beam": STEEL,
        "members": 5,
        "rate": 40.0,
    }
    return Problem(**(given | changes))  # type: ignore[arg-type]


def test_rows_come_in_the_order_of_the_designs() -> None:
    problem = steel(constraints=(Constraint("impact_speed", 0.02),), objectives=(Objective(), Objective("severity")))
    X = np.array([[0.5, 0.1], [1.0, 0.05], [2.0, 0.2]])
    F, G, spread = problem.evaluate(X, executor=Backwards())
    assert F.shape == spread.shape == (3, 2)
    assert G.shape == (3, 1)
    for k, row in enumerate(X):
        design = problem.space.decoded({"gap": row[0], "friction_limit": row[1]})
        assert design.values["gap"] == pytest.approx(row[0] * problem.units.gap(0.02))
        ((_, measured),) = evaluate(problem, [design], problem.ensemble, problem.rate, Threads(1))
        score = problem.score(design, measured, problem.ensemble, problem.rate)
        assert tuple(F[k]) == score.values
        assert tuple(G[k]) == score.violations
    assert np.all(spread[:2] > 0)  # the third gap is never touched: no impacts, no noise
    members = problem.member_values(measured, problem.ensemble, problem.rate)
    assert spread[2, 0] < np.ptp(members[0])
    assert np.isnan(steel(members=1).evaluate(X[:1]).spread).all()


def test_all_objectives_are_minimised() -> None:
    conditions = tuple(Condition(1, force) for force in (0.3, 0.5, 0.9))
    F = steel(conditions=conditions, objectives=(Objective("range", limit=0.5),), members=2).evaluate([[1.0, 0.1]]).F
    assert F[0, 0] < 0  # decades, with their sign turned


def test_failures_are_nan_with_a_reason_and_leave_the_others() -> None:
    problem = steel()
    executor = Backwards()
    executor.lost = (problem.units.gap(0.02) * 2.0,)  # type: ignore[misc]
    why: dict[int, str] = {}
    F, _, spread = problem.evaluate([[1.0, 0.1], [9.0, 0.1], [2.0, 0.1], [np.nan, 0.1]], executor=executor, failures=why)
    assert np.isfinite(F[0]).all()
    assert np.isnan(F[1:]).all()
    assert np.isnan(spread[1:]).all()
    assert set(why) == {1, 2, 3}
    assert "gap = 9.0 is not allowed: from 0.1 to 4 of the rule's gap" in why[1]
    assert "the integrator gave up 5 of 5 runs, the first of them member 0 at resonance 1, 0.5 N" in why[2]
    assert "gap = nan" in why[3]
    with pytest.raises(ParameterError, match=r"X = \(1, 3\)"):
        problem.evaluate([[1.0, 0.1, 0.5]])


def test_fresh_members_give_other_values_of_the_same_design() -> None:
    problem = steel()
    here, there = problem.evaluate([[1.0, 0.1]]).F, problem.evaluate([[1.0, 0.1]], problem.fresh_ensemble(5, 0)).F
    assert here != there
    assert here == pytest.approx(there, rel=0.5)


def test_adapter_has_what_its_readers_expect(tmp_path: Path) -> None:
    pytest.importorskip("gymnasium")
    from optimisation.benchmark_problem import Conditions, ImpactAbsorberProblem, ObjectiveDirection

    given = {"force": 0.5, "members": 2, "rate": 40.0}
    own = ImpactAbsorberProblem(0, given, beam=STEEL, constraints=(Constraint("stroke", 1e-5),))
    assert own.conditions == Conditions(0.5)
    assert own.problem.rate == 40.0
    box = own.design_space
    design, number = own.random_design()
    assert box.contains(design)
    assert number >= 0
    assert own.objectives == (("level", ObjectiveDirection.MINIMIZE),)
    start = own.problem.space.coordinates(own.problem.space.default)
    row = np.array(list(start.values()))
    config = {"damping_ratio": 0.02}
    values, damped = own.simulate(row), own.simulate(row, config)
    assert values.shape == (1,)
    assert values != damped
    with pytest.raises(ParameterError, match="config"):
        own.simulate(row, {"colour": 1})
    assert own.check_constraints(row, {}).violations[0].constraint == "stroke"
    broken = own.check_constraints(2 * box.high, {})
    assert [violation.constraint for violation in broken.violations] == [v.name for v in own.problem.space.free]
    assert (len(broken), broken.n_constraints) == (3, 4)
    assert str(broken).startswith("gap: ")
    assert "impact absorber" in own.render(row, path=tmp_path / "card.png")
    assert (tmp_path / "card.png").read_bytes().startswith(b"\x89PNG")
    own.reset(seed=3)
    first = own.random_design()[0]
    own.reset(seed=3)
    np.testing.assert_array_equal(own.random_design()[0], first)


def test_adapters_search_and_data_set() -> None:
    pytest.importorskip("gymnasium")
    from optimisation.benchmark_problem import ImpactAbsorberProblem

    own = ImpactAbsorberProblem(0, {"force": 0.5, "members": 1, "rate": 40.0}, concept="friction", beam=STEEL)
    start = own.problem.space.at([0.65])  # too much friction
    best, history = own.optimize(list(own.problem.space.coordinates(start).values()), designs=13)
    assert own.simulate(best)[0] == min(step.obj_values[0] for step in history) < 0.9 * history[0].obj_values[0]
    assert [step.step for step in history] == list(range(len(history)))
    assert len(history) <= 13
    data = own.make_dataset(5)
    assert {name: len(part["design"]) for name, part in data.items()} == {"train": 4, "test": 1}
    np.testing.assert_array_equal(data["test"]["objectives"][0], own.simulate(data["test"]["design"][0]))
    assert data["test"]["level"][0] == data["test"]["objectives"][0, 0]
    assert data["train"]["force"].tolist() == [0.5] * 4
    own._samples = own.make_dataset(2)  # `dataset` itself has more designs
    assert own.dataset is own._samples
