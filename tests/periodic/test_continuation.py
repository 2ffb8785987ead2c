"""Continuation on curves whose folds, branch points and lengths are known in closed form."""

import numpy as np
import pytest

from impact_env.periodic.branch import CLOSED, INTERRUPTED, MINIMUM_STEP, PARAMETER_LIMIT, Monitor
from impact_env.periodic.continuation import (
    ContinuationProblem,
    follow_both_ways,
    follow_branch,
    switch_at_branch_point,
)

Array = np.ndarray


def circle(z: Array, p: float) -> tuple[Array, Array]:
    return np.array([z[0] ** 2 + p**2 - 1]), np.array([[2 * z[0], 2 * p]])


def cubic(z: Array, p: float) -> tuple[Array, Array]:
    """p = x - x^3/3 with folds at x = 1, p = 2/3 and x = -1, p = -2/3."""
    x = z[0]
    return np.array([x - x**3 / 3 - p]), np.array([[1 - x**2, -1.0]])


def pitchfork(z: Array, p: float) -> tuple[Array, Array]:
    """X (p - x^2 - y) = 0, y = p^2: the branch point is at p = 0 and, far from it, p = 1."""
    x, y = z
    values = np.array([x * (p - x**2 - y), y - p**2])
    return values, np.array([[p - 3 * x**2 - y, -x, x], [0.0, 1.0, -2 * p]])


def test_a_circle_is_closed_and_its_folds_are_where_they_should_be() -> None:
    branch = follow_branch(ContinuationProblem(circle), np.array([1.0]), 0.0)
    assert branch.ended == CLOSED
    assert branch.points[-1] == branch.points[0]
    folds = branch.of("fold")
    assert sorted(f.parameter for f in folds) == pytest.approx([-1, 1], abs=1e-10)
    assert [f.point[0] for f in folds] == pytest.approx([0, 0], abs=1e-6)
    length = sum(
        np.hypot(a[0] - b[0], p - q)
        for a, b, p, q in zip(
            branch.points, branch.points[1:], branch.parameters, branch.parameters[1:], strict=False
        )
    )
    assert length == pytest.approx(2 * np.pi, rel=5e-3)
    assert (
        max(
            abs(z[0] ** 2 + p**2 - 1) for z, p in zip(branch.points, branch.parameters, strict=True)
        )
        < 1e-10
    )


def test_folds_of_an_s_shaped_curve_to_both_sides() -> None:
    branch = follow_both_ways(ContinuationProblem(cubic, limits=(-3.0, 3.0)), np.array([0.1]), 0.1)
    assert branch.ended == PARAMETER_LIMIT
    assert branch.parameters[[0, -1]] == pytest.approx(
        [3, -3], abs=1e-12
    )  # the middle part runs backwards: p rises to the left
    assert [f.parameter for f in branch.of("fold")] == pytest.approx([-2 / 3, 2 / 3], abs=1e-11)
    x = np.array([z[0] for z in branch.points])
    assert np.all(np.diff(x) > 0)
    for fold in branch.of("fold"):
        assert x[fold.after] <= fold.point[0] <= x[fold.after + 1]


def test_one_branch_of_a_pitchfork_leads_to_the_other_two() -> None:
    problem = ContinuationProblem(pitchfork, limits=(-0.5, 0.5))
    trivial = follow_both_ways(problem, np.array([0.0, 0.25]), -0.5 + 1e-3)
    (event,) = trivial.of("branch point")
    assert event.parameter == pytest.approx(0, abs=1e-8)
    assert trivial.ended == PARAMETER_LIMIT
    starts = switch_at_branch_point(problem, event)
    assert len(starts) == 2
    ends = []
    for z, p, direction in starts:
        branch = follow_branch(problem, z, p, direction)
        assert branch.ended == PARAMETER_LIMIT
        ends.append(branch.points[-1][0])
        for point, q in zip(branch.points, branch.parameters, strict=True):
            assert point[0] ** 2 == pytest.approx(q - q**2, abs=1e-9)
    assert sorted(ends) == pytest.approx([-0.5, 0.5], abs=1e-9)


def test_monitors_are_located_and_may_end_a_branch() -> None:
    monitor = Monitor("x is a half", lambda z, _: z[0] - 0.5)
    last = Monitor("x is -0.3", lambda z, _: z[0] + 0.3, ends=True)
    branch = follow_branch(
        ContinuationProblem(circle, monitors=(monitor, last)), np.array([1.0]), 0.0
    )
    assert branch.ended == "x is -0.3"
    assert branch.points[-1][0] == pytest.approx(-0.3, abs=1e-11)
    (event,) = branch.of("x is a half")
    assert (event.point[0], event.parameter) == (
        pytest.approx(0.5, abs=1e-11),
        pytest.approx(np.sqrt(0.75), abs=1e-11),
    )
    kinds = [e.kind for e in branch.located]
    assert kinds == ["x is a half", "fold", "x is -0.3"]


def roof(slope: float) -> ContinuationProblem:
    """p = 1 - slope |x| has a corner at x = 0."""

    def residual(z: Array, p: float) -> tuple[Array, Array]:
        return np.array([p - 1 + slope * abs(z[0])]), np.array([[slope * np.sign(z[0]), 1.0]])

    return ContinuationProblem(residual, limits=(-1.0, 2.0))


def test_a_blunt_kink_is_passed_and_a_sharp_one_reported() -> None:
    blunt = follow_branch(roof(0.3), np.array([-1.0]), 0.701)
    assert blunt.ended == PARAMETER_LIMIT
    (kink,) = blunt.of("kink")
    assert kink.parameter == pytest.approx(1, abs=1e-6)
    assert blunt.points[-1][0] == pytest.approx(2 / 0.3, abs=1e-9)
    sharp = follow_branch(roof(2.0), np.array([-1.0]), -0.999)
    assert sharp.ended == MINIMUM_STEP
    assert sharp.parameters[-1] == pytest.approx(1, abs=1e-6)
    assert "no step from parameter = 0.99999" in sharp.message


def test_a_branch_can_be_stopped_and_keeps_what_it_has() -> None:
    def interrupt(points: int, _: float) -> None:
        if points == 7:
            raise KeyboardInterrupt

    branch = follow_branch(ContinuationProblem(circle), np.array([1.0]), 0.0, progress=interrupt)
    assert (branch.ended, len(branch)) == (INTERRUPTED, 7)
