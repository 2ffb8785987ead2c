from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from impact_env import Beam, ParameterError, TunedAbsorber, beam_scene, impact_absorber, simulate
from impact_env.curve import DOWN, UP, CurveCase, PerformanceCurve, performance_curve, performance_curves, quantiles
from impact_env.ensemble import LaneLevels, Members, draw_members

BEAM = Beam(modes=3)
NONE, TUNED, IMPACT = (beam_scene(BEAM, absorber) for absorber in (None, TunedAbsorber(), impact_absorber(restitution=0.7, friction_limit=0.1)))
FAST = 100.0
FORCES = np.array([0.0, 1.0, 2.5])


def made_up(levels: np.ndarray, forces: np.ndarray) -> PerformanceCurve:
    return PerformanceCurve(
        forces, Members(np.arange(levels.shape[1]), np.ones(levels.shape[1])), LaneLevels(*[levels] * 6, complete=not np.isnan(levels).any())
    )


@pytest.mark.parametrize("scene", [NONE, TUNED, IMPACT], ids=["none", "tuned", "impact"])
def test_curve_holds_the_single_runs(scene: object) -> None:
    case = CurveCase(scene, FORCES, 2, (0.99, 1.01))  # type: ignore[arg-type]
    (curve,) = performance_curves([case], members=2, seed=5)
    members = draw_members(2, 5)
    assert curve.level.shape == (3, 2, 2)
    for (k, m, d), level in np.ndenumerate(curve.level):
        run = simulate(case.scene, members.drives(FORCES[k], case.schedules()[d])[m]).level
        assert run is not None
        # the level of a linear scene is computed at one newton and scaled
        tolerance = 0.0 if scene is IMPACT else 1e-12
        assert level == pytest.approx(run.value, rel=tolerance, abs=0)
        assert curve.lanes.max_tip[k, m, d] == pytest.approx(run.max_tip, rel=tolerance, abs=0)
        if FORCES[k] > 0:
            assert curve.lanes.frequency_ratio[k, m, d] == pytest.approx(run.frequency_ratio, rel=1e-9)


def test_directions_and_resonance_of_a_case() -> None:
    case = CurveCase(NONE, FORCES, 2)
    up, down = case.schedules()
    omega = NONE.model.omega[1]
    np.testing.assert_allclose(up.omegas / omega, [0.9, 1.06])
    np.testing.assert_allclose(down.omegas / omega, [1.06, 0.9])
    assert up.periods == pytest.approx(1600)
    assert (UP, DOWN) == (0, 1)


def test_rate_of_a_case_follows_the_damping_of_its_resonance() -> None:
    scene = beam_scene(Beam(modes=2, damping_ratio=(0.02, 0.005)))
    assert [CurveCase(scene, FORCES, k).percent_per_100_periods for k in (1, 2)] == [1.0, pytest.approx(0.25)]
    assert CurveCase(scene, FORCES, 2, percent_per_100_periods=3.0).percent_per_100_periods == 3.0
    slow, told = (performance_curve(scene, [1.0], 2, 1, limits=(0.95, 1.05), percent_per_100_periods=rate) for rate in (None, 0.25))
    np.testing.assert_array_equal(slow.level, told.level)


def test_linear_scenes_run_one_force_only() -> None:
    totals = []
    performance_curves([CurveCase(NONE, FORCES, 1, (0.95, 1.05), FAST)], 3, progress=lambda _done, total: totals.append(total))
    assert totals == [6] * 6


def test_several_curves_at_once_are_the_single_curves() -> None:
    cases = [CurveCase(scene, FORCES[1:], resonance, (0.95, 1.05), FAST) for scene in (IMPACT, NONE) for resonance in (1, 2)]
    together = performance_curves(cases, 3, 1, threads=2)
    for case, curve in zip(cases, together, strict=True):
        alone = performance_curve(case.scene, case.forces, case.resonance, 3, 1, limits=case.limits, percent_per_100_periods=FAST, threads=1)
        np.testing.assert_array_equal(curve.level, alone.level)
        assert curve.members.key == draw_members(3, 1).key
        assert curve.complete


def test_interrupt_leaves_whole_members() -> None:
    def stop(done: int, _total: int) -> None:
        if done == 10:
            raise KeyboardInterrupt

    cases = [CurveCase(scene, FORCES[1:], 1, (0.95, 1.05), FAST) for scene in (IMPACT, NONE)]
    curves = performance_curves(cases, 200, threads=1, progress=stop)  # so many that most are left when the interrupt is seen
    for curve in curves:
        assert not curve.complete
        assert np.isfinite(curve.combined[:, 0]).all()
        assert np.isnan(curve.combined[:, -1]).all()
        assert np.isfinite(curve.median).all()


def test_statistics_leave_out_what_is_missing() -> None:
    levels = np.array([[[1.0, 2.0], [4.0, 3.0], [9.0, np.nan]], [[np.nan] * 2] * 3])
    curve = made_up(levels, np.array([1.0, 2.0]))
    np.testing.assert_array_equal(curve.combined[0], [2.0, 4.0, np.nan])
    np.testing.assert_array_equal(curve.median, [3.0, np.nan])
    np.testing.assert_allclose(curve.band[:, 0], [2.1, 3.9])
    assert np.isnan(curve.band[:, 1]).all()
    np.testing.assert_array_equal(quantiles([[1.0, 2.0, 3.0]], (0.0, 0.5, 1.0))[:, 0], [1.0, 2.0, 3.0])


def test_optimum_is_relative_to_the_reference() -> None:
    forces = np.array([1.0, 2.0, 4.0])
    reference = made_up(np.broadcast_to(forces[:, None, None], (3, 2, 2)), forces)
    curve = made_up(np.broadcast_to(np.array([[0.9, 1.0], [0.5, 0.7], [1.4, 1.3]])[:, :, None], (3, 2, 2)), forces)
    best = curve.optimum(reference)
    assert best is not None
    assert (best.force, best.level, best.relative) == pytest.approx((2.0, 0.6, 0.3))
    assert best.level_band == pytest.approx((0.51, 0.69))
    assert best.relative_band == pytest.approx((0.255, 0.345))
    assert best.force_band == pytest.approx((2.1, 3.9))  # member 0 is best at 2 N, member 1 at 4 N
    assert made_up(np.full((3, 2, 2), np.nan), forces).optimum(reference) is None
    with pytest.raises(ParameterError, match="reference"):
        curve.relative_to(made_up(np.ones((3, 2, 2)), forces + 1))
    others = replace(reference, members=Members(reference.members.phases, [1.0, 1.0 + 1e-6]))
    with pytest.raises(ParameterError, match="reference"):
        curve.relative_to(others)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"forces": []}, "forces"),
        ({"forces": [1.0, -1.0]}, "forces"),
        ({"forces": [np.nan]}, "forces"),
        ({"forces": [[1.0]]}, "forces"),
        ({"resonance": 4}, "resonance"),
        ({"limits": (1.06, 0.9)}, "limits"),
        ({"percent_per_100_periods": 0.0}, "percent_per_100_periods"),
        ({"members": 0}, "members"),
        ({"seed": -1}, "seed"),
    ],
)
def test_bad_input_is_named(change: dict[str, object], name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        performance_curve(**{"scene": NONE, "forces": FORCES} | change)  # type: ignore[arg-type]
