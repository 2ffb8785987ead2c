"""Designs in arrays for other people's optimisers."""

from dataclasses import replace

import numpy as np
import pytest
from core import STEEL

from impact_env import ParameterError
from impact_env.ensemble import Threads
from optimisation.designs import design_space
from optimisation.evaluation import evaluate
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.problem import Problem

STRIP = replace(STEEL, modes=2)


class Backwards(Threads):
    """An executor that finishes the last chunk first, and may give up the runs of some gaps."""

    lost = ()

    def each(self, function, chunks, kinds):
        for k, values in reversed(list(super().each(function, chunks, kinds))):
            gap = chunks[k].lanes[0].scene.absorber.walls.gap
            yield k, np.full_like(values, np.nan) if any(abs(gap - x) < 1e-9 for x in self.lost) else values


def steel(**changes: object) -> Problem:
    given = {
        "space": design_space("impact", ["gap", "friction_limit"]),
        "conditions": (Condition(1, 0.5),),
        "beam": STRIP,
        "members": 5,
        "rate": 40.0,
    }
    return Problem(**(given | changes))


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
    executor.lost = (problem.units.gap(0.02) * 2.0,)
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
