import pickle
import threading
from collections.abc import Callable, Generator, Hashable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pytest

from impact_env import (
    Beam,
    CurveCase,
    Drive,
    Exact,
    IntegrationError,
    Moreau,
    ParameterError,
    PerformanceCurve,
    TunedAbsorber,
    beam_scene,
    impact_absorber,
    linear_sweep,
    simulate,
)
from impact_env.curve import performance_curves, quantiles
from impact_env.ensemble import (
    PERTURBATION,
    Lane,
    LaneLevels,
    Members,
    draw_members,
    each_lane,
    run_lanes,
)

T = TypeVar("T")
R = TypeVar("R")
BEAM = Beam(modes=3)
SCENES = [
    beam_scene(BEAM, absorber)
    for absorber in (None, TunedAbsorber(), impact_absorber(restitution=0.7, friction_limit=0.1))
]
FAST = 100.0  # percent per 100 pseudo periods


def some_lanes() -> list[Lane]:
    return [
        Lane(
            scene, Drive(force, linear_sweep(scene.model.resonance_omega(1), *limits, FAST), phase)
        )
        for scene in SCENES
        for force in (1.0, 3.0)
        for limits in ((0.9, 1.06), (1.06, 0.9))
        for phase in (0.0, 2.0)
    ]


def rows(levels: LaneLevels) -> np.ndarray:
    return np.array(
        [
            levels.level,
            levels.time,
            levels.frequency_ratio,
            levels.max_tip,
            levels.impacts,
            levels.stuck_time,
        ]
    )


def test_lanes_of_a_kind_that_ran_before_start_together() -> None:
    """Lanes of a kind that ran before start at the same time.

    Of all lanes only the first runs alone, since the others would wait for its kernels. Otherwise
    calls with two lanes would all use one core.
    """
    lanes = some_lanes()[:2]
    both = threading.Barrier(2, timeout=60)
    each_lane(lanes[:1], lambda _lane: 0)
    assert sorted(each_lane(lanes, lambda _lane: both.wait(), threads=2)) == [0, 1]


@pytest.mark.parametrize("method", [Exact(), Moreau()])
def test_lane_is_a_single_run_bit_for_bit(method: Exact | Moreau) -> None:
    """On any number of threads, in any order."""
    lanes = some_lanes()
    expected = []
    for lane in lanes:
        single = simulate(lane.scene, lane.drive, method)
        level = single.level
        expected.append(
            (
                level.value,
                level.time,
                level.frequency_ratio,
                level.max_tip,
                single.impact_count,
                single.stuck_time,
            )
        )
    for order, threads in ((1, 1), (1, 2), (1, 7), (-1, 3)):
        levels = run_lanes(lanes[::order], method, threads=threads)
        assert levels.complete
        np.testing.assert_array_equal(rows(levels).T, expected[::order])
    assert levels.impacts.max() > 10


def test_members_follow_from_the_seed() -> None:
    drawn = draw_members(400, 3)
    assert (drawn.phases[0], drawn.factors[0]) == (0, 1)
    assert np.all((drawn.phases[1:] > 0) & (drawn.phases[1:] < 2 * np.pi))
    # evenly, as many in each quarter of a turn
    assert np.histogram(drawn.phases[1:], 4, (0, 2 * np.pi))[0] == pytest.approx(100, abs=30)
    change = (drawn.factors[1:] - 1) / PERTURBATION
    assert np.all((np.abs(change) <= 1) & (change != 0))
    assert (change.min(), change.max()) == pytest.approx(
        (-1, 1), abs=0.02
    )  # all of the range, to either side
    assert abs(np.corrcoef(drawn.phases[1:], change)[0, 1]) < 0.1  # streams of their own
    few = draw_members(5, 3)
    other = draw_members(400, 4)
    assert few.key == drawn[:5].key
    assert not np.any(
        (other.phases[1:] == drawn.phases[1:]) | (other.factors[1:] == drawn.factors[1:])
    )
    assert draw_members(1, 9).key == Members([0.0], [1.0]).key
    phase, force = (draw_members(400, 3, kind) for kind in ("phase", "force"))
    assert phase.key == Members(drawn.phases, np.ones(400)).key
    assert force.key == Members(np.zeros(400), drawn.factors).key


@pytest.mark.parametrize("threads", [1, 3])
def test_interrupt_keeps_what_is_finished(threads: int) -> None:
    # so many that other threads cannot finish them before the interrupt arrives
    lanes = some_lanes() * 40
    reports = []

    def stop(done: int, total: int) -> None:
        reports.append((done, total))
        if done == 7:
            raise KeyboardInterrupt

    levels = run_lanes(lanes, threads=threads, progress=stop)
    assert reports == [(k, len(lanes)) for k in range(1, 8)]
    done = ~np.isnan(levels.level)
    assert not levels.complete
    assert 7 <= done.sum() < len(lanes)
    whole = run_lanes(lanes)
    for partial, full in zip(rows(levels), rows(whole), strict=True):
        np.testing.assert_array_equal(partial[done], full[done])
        assert np.isnan(partial[~done]).all()


class Elsewhere:
    """An executor that sends function and items through a pickle, as to another process.

    It returns the results in another order.
    """

    def __init__(self, stop: int | None = None) -> None:
        self.stop = stop
        self.kinds = 0
        self.closed = False

    def each(
        self, function: Callable[[T], R], items: Sequence[T], kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, R], None, None]:
        self.kinds = len(set(kinds))
        try:
            for count, k in enumerate(reversed(range(len(items)))):
                if count == self.stop:
                    raise KeyboardInterrupt
                unpickled, item = pickle.loads(pickle.dumps((function, items[k])))
                yield k, unpickled(item)
        finally:
            self.closed = True


@pytest.mark.parametrize("stop", [None, 2])
def test_lanes_run_by_an_executor_are_those_of_threads(stop: int | None) -> None:
    """Those that are finished, if it is interrupted."""
    # the last batch is a smaller one
    lanes = some_lanes()[:-1]
    elsewhere = Elsewhere(stop)
    progress = []
    levels = run_lanes(
        lanes, executor=elsewhere, progress=lambda done, total: progress.append((done, total))
    )
    first = 0 if stop is None else -7
    assert levels.complete == (stop is None)
    np.testing.assert_array_equal(rows(levels)[:, first:], rows(run_lanes(lanes))[:, first:])
    assert np.isnan(levels.level[:first]).all()
    assert elsewhere.closed
    assert elsewhere.kinds == 2  # linear scenes share their kernels
    assert progress == [(done, 23) for done in (3, 7, 11, 15, 19, 23)][:stop]


def test_a_lane_that_fails_is_named_and_an_executor_has_its_own_threads() -> None:
    lanes = some_lanes()
    for executor in (None, Elsewhere()):
        with pytest.raises(IntegrationError, match=r"lane \d+ \([13] N, phase [02] rad"):
            run_lanes(lanes, executor=executor, most_events=1)
    with pytest.raises(ParameterError, match="threads = 2 is not allowed: None with an executor"):
        run_lanes(lanes, threads=2, executor=Elsewhere())


NONE, TUNED, IMPACT = SCENES
FORCES = np.array([0.0, 1.0, 2.5])


def made_up(levels: np.ndarray, forces: np.ndarray) -> PerformanceCurve:
    return PerformanceCurve(
        forces,
        Members(np.arange(levels.shape[1]), np.ones(levels.shape[1])),
        LaneLevels(*[levels] * 6, complete=not np.isnan(levels).any()),
    )


def test_curves_hold_the_single_runs() -> None:
    """Of several curves at once, where linear scenes run one force only."""
    cases = [
        CurveCase(scene, FORCES, resonance, (0.99, 1.01))
        for scene, resonance in ((NONE, 1), (TUNED, 2), (IMPACT, 2))
    ]
    totals = []
    curves = performance_curves(
        cases, members=2, seed=5, threads=2, progress=lambda _done, total: totals.append(total)
    )
    members = draw_members(2, 5)
    assert set(totals) == {4 + 4 + 12}
    for case, curve in zip(cases, curves, strict=True):
        assert curve.level.shape == (3, 2, 2)
        assert curve.members.key == members.key
        assert curve.complete
        # the level of a linear scene is computed at one newton and scaled
        tolerance = 0.0 if case.scene is IMPACT else 1e-12
        for (k, m, d), level in np.ndenumerate(curve.level):
            run = simulate(case.scene, members.drives(FORCES[k], case.schedules()[d])[m]).level
            assert level == pytest.approx(run.value, rel=tolerance, abs=0)
            assert curve.lanes.max_tip[k, m, d] == pytest.approx(run.max_tip, rel=tolerance, abs=0)
            if FORCES[k] > 0:
                assert curve.lanes.frequency_ratio[k, m, d] == pytest.approx(
                    run.frequency_ratio, rel=1e-9
                )


def test_interrupted_curves_have_whole_members() -> None:
    def stop(done: int, _total: int) -> None:
        if done == 10:
            raise KeyboardInterrupt

    cases = [CurveCase(scene, FORCES[1:], 1, (0.95, 1.05), FAST) for scene in (IMPACT, NONE)]
    for curve in performance_curves(
        cases, 200, threads=1, progress=stop
    ):  # so many that most are left when the interrupt is seen
        assert not curve.complete
        assert np.isfinite(curve.combined[:, 0]).all()
        assert np.isnan(curve.combined[:, -1]).all()
        assert np.isfinite(curve.median).all()


def test_rate_of_a_case_follows_the_damping_of_its_resonance() -> None:
    scene = beam_scene(Beam(modes=2, damping_ratio=(0.02, 0.005)))
    assert [CurveCase(scene, FORCES, k).percent_per_100_periods for k in (1, 2)] == [
        1.0,
        pytest.approx(0.25),
    ]
    assert CurveCase(scene, FORCES, 2, percent_per_100_periods=3.0).percent_per_100_periods == 3.0


def test_statistics_leave_out_what_is_missing() -> None:
    levels = np.array([[[1.0, 2.0], [4.0, 3.0], [9.0, np.nan]], [[np.nan] * 2] * 3])
    curve = made_up(levels, np.array([1.0, 2.0]))
    np.testing.assert_array_equal(curve.combined[0], [2.0, 4.0, np.nan])
    np.testing.assert_array_equal(curve.median, [3.0, np.nan])
    np.testing.assert_allclose(curve.band[:, 0], [2.1, 3.9])
    assert np.isnan(curve.band[:, 1]).all()
    np.testing.assert_array_equal(
        quantiles([[1.0, 2.0, 3.0]], (0.0, 0.5, 1.0))[:, 0], [1.0, 2.0, 3.0]
    )


def test_optimum_is_relative_to_the_reference() -> None:
    forces = np.array([1.0, 2.0, 4.0])
    reference = made_up(np.broadcast_to(forces[:, None, None], (3, 2, 2)), forces)
    curve = made_up(
        np.broadcast_to(np.array([[0.9, 1.0], [0.5, 0.7], [1.4, 1.3]])[:, :, None], (3, 2, 2)),
        forces,
    )
    best = curve.optimum(reference)
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
