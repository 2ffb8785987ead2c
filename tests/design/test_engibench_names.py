"""The adapter has the names and calls of EngiBench's problems: recorded from version 0.2.0, and compared with the package where it is installed."""

from __future__ import annotations

import dataclasses
import inspect
from enum import Enum
from typing import Any

import pytest

pytest.importorskip("gymnasium")

from gymnasium import spaces

from impact_env import Beam
from optimisation.benchmark_problem import ImpactAbsorberProblem, ObjectiveDirection, OptiStep, Violations

# engibench/core.py of 0.2.0: each method's arguments after self, those with a default, and those by keyword only
CALLS: dict[str, tuple[list[str], list[str], list[str]]] = {
    "simulate": (["design", "config"], ["config"], []),
    "optimize": (["starting_point", "config"], ["config"], []),
    "reset": (["seed"], ["seed"], []),
    "render": (["design", "open_window"], ["open_window"], ["open_window"]),
    "random_design": ([], [], []),
    "check_constraints": (["design", "config"], [], []),
}
ATTRIBUTES = {
    "version",
    "objectives",
    "Conditions",
    "conditions",
    "design_space",
    "Config",
    "config",
    "dataset_id",
    "design_constraints",
    "container_id",
    "dataset",
    "objectives_keys",
    "conditions_keys",
}
ASSIGNED = {"seed", "np_random"}
DIRECTIONS = {"MINIMIZE": 1, "MAXIMIZE": 2}
STEP = ["obj_values", "step"]
VIOLATIONS = {"by_category", "by_criticality", "__bool__", "__len__", "__str__"}


def arguments(function: Any) -> tuple[list[str], list[str], list[str]]:
    every = [p for p in inspect.signature(function).parameters.values() if p.name != "self"]
    optional = [p.name for p in every if p.default is not p.empty]
    return [p.name for p in every], optional, [p.name for p in every if p.kind is p.KEYWORD_ONLY]


@pytest.fixture(scope="module")
def own() -> ImpactAbsorberProblem:
    return ImpactAbsorberProblem(seed=1, config={"members": 1, "rate": 100.0}, beam=Beam(modes=2))


@pytest.mark.parametrize("name", CALLS)
def test_a_call_that_theirs_take_is_taken(name: str) -> None:
    theirs, optional, by_keyword = CALLS[name]
    mine, mine_optional, mine_by_keyword = arguments(getattr(ImpactAbsorberProblem, name))
    assert mine[: len(theirs)] == theirs
    assert set(mine) - set(theirs) <= set(mine_optional)  # what is added may be left out
    assert set(optional) <= set(mine_optional)
    assert set(by_keyword) <= set(mine_by_keyword)


def test_attributes_are_there_and_are_what_theirs_are(own: ImpactAbsorberProblem) -> None:
    assert {name for name in ATTRIBUTES if hasattr(ImpactAbsorberProblem, name) or name in vars(own)} == ATTRIBUTES
    assert set(vars(own)) >= ASSIGNED
    assert isinstance(own.dataset_id, str)
    assert isinstance(own.design_space, spaces.Box)
    assert dataclasses.is_dataclass(own.Conditions)
    assert isinstance(own.conditions, own.Conditions)
    assert isinstance(own.config, own.Config)
    assert set(own.conditions_keys) == {f.name for f in dataclasses.fields(own.Conditions)} < {f.name for f in dataclasses.fields(own.Config)}
    assert own.objectives_keys == ["level"]
    assert {direction.name: direction.value for direction in ObjectiveDirection} == DIRECTIONS
    assert [f.name for f in dataclasses.fields(OptiStep)][:2] == STEP
    assert VIOLATIONS - {"__bool__"} <= set(dir(Violations))  # an empty one is false by its length


def test_calls_answer_as_theirs_do(own: ImpactAbsorberProblem) -> None:
    own.reset(seed=4)
    design, index = own.random_design()
    assert design.dtype == own.design_space.dtype
    assert own.design_space.contains(design)
    assert isinstance(index, int)
    assert own.simulate(design, config={"force": 2.0}).shape == (1,)
    found = own.check_constraints(design=design, config={})
    assert (bool(found), len(found), found.violations) == (False, 0, [])
    severity = Enum("severity", ["Error", "Warning"])
    broken = own.check_constraints(design=2 * own.design_space.high, config={})
    assert broken
    assert len(broken.by_criticality(severity.Error)) == len(broken)  # type: ignore[attr-defined]
    assert not broken.by_criticality(severity.Warning)  # type: ignore[attr-defined]
    best, history = own.optimize(starting_point=design, config={"force": 2.0}, designs=4)
    assert own.design_space.contains(best)
    assert history[0].obj_values.shape == (1,)
    own.reset(seed=4)
    assert own.random_design()[1] == index
    own.reset()
    assert own.seed is None
    assert own.render(design)


def test_the_record_is_that_of_the_package() -> None:
    core = pytest.importorskip("engibench.core")
    assert {name: arguments(getattr(core.Problem, name)) for name in CALLS} == CALLS
    named = set(core.Problem.__annotations__) | {name for name, x in vars(core.Problem).items() if isinstance(x, property)}
    assert {name for name in named if not name.startswith("_")} == ATTRIBUTES | {"np_random"}
    assert {direction.name: direction.value for direction in core.ObjectiveDirection} == DIRECTIONS
    assert [f.name for f in dataclasses.fields(core.OptiStep)] == STEP
