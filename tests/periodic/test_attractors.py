"""What runs end on: classes of motion, basin fractions, lifetimes, and bifurcation diagrams."""

from functools import cache

import numpy as np
import pytest
import scipy
from orbit_cases import high_orbit, one_sided, paper_case, steel

from impact_env.checks import ParameterError
from impact_env.drive import Drive, constant_frequency
from impact_env.periodic import (
    Case,
    MotionKind,
    SettledMotion,
    SettleOptions,
    attractor_map,
    basin_fractions,
    fit_lifetimes,
    largest_exponent,
    rotation_number,
    settle_motion,
)
from impact_env.periodic.attractors import feature_distance, group_motions, judge_motion
from impact_env.periodic.basins import START_REACH, _match_groups, draw_start
from impact_env.periodic.bifurcations import TORUS
from impact_env.periodic.diagrams import diagram_branches, diagram_points
from impact_env.periodic.motion import stability_of
from impact_env.periodic.orbit_branches import orbit_branch
from impact_env.results import Record
from impact_env.scene import InitialState
from impact_env.sweep import simulate

GOLDEN = (np.sqrt(5) - 1) / 2


def plain_states(case: Case, state: np.ndarray, phase: float, periods: int) -> np.ndarray:
    """Return the states (periods + 1, 2 N_m + 2) once in each period of the force.

    They begin at the given start and are in units of the gap and of the gap times omega.
    """
    n = case.model.modes + 1
    unit = np.concatenate([np.full(n, case.gap), np.full(n, case.gap * case.omega)])
    drive = Drive(case.force, constant_frequency(case.omega, 1.0, periods), phase)
    record = Record(level=False, series=True, samples_per_period=4)
    start = InitialState.from_vector(case.scene, state)
    history = simulate(case.scene, drive, initial=start, record=record).recorded.history
    columns = (
        history.modal_displacement,
        history.absorber_displacement,
        history.modal_velocity,
        history.absorber_velocity,
    )
    return np.column_stack(columns)[::4] / unit


def test_the_rotation_number_of_points_on_a_curve_is_the_one_they_were_made_with() -> None:
    for turns, width in ((GOLDEN, 1.0), (0.1234567, 0.2), (np.sqrt(2) / 2, 0.6)):
        angle = 2 * np.pi * turns * np.arange(512)
        bent = angle + 0.4 * np.sin(angle)
        points = np.column_stack([np.cos(bent), width * np.sin(bent), 0.1 * np.cos(2 * bent)])
        result = rotation_number(points)
        assert result.value == pytest.approx(min(turns % 1, 1 - turns % 1), abs=1e-6)
        assert result.change < 1e-5
        assert result.circles == 1


def test_points_on_several_circles_are_counted_and_rotate_on_each() -> None:
    k = np.arange(1536)
    centre = 5 * np.exp(2j * np.pi * k / 3)
    own = np.exp(2j * np.pi * (GOLDEN * (k // 3) + 0.1 * (k % 3)))
    result = rotation_number(np.column_stack([(centre + own).real, (centre + own).imag]))
    assert result.circles == 3
    assert result.value == pytest.approx(1 - GOLDEN, abs=1e-6)


def test_points_without_a_circle_have_no_converged_rotation_number() -> None:
    x = [0.1]
    for _ in range(600):
        x.append(4 * x[-1] * (1 - x[-1]))
    for points in (
        np.column_stack([x[1:], x[:-1]]),
        np.random.default_rng(0).normal(size=(600, 3)),
    ):
        result = rotation_number(points)
        assert result is None or result.change > 1e-3
    assert rotation_number(np.column_stack([np.arange(64.0), np.zeros(64)])) is None
    with pytest.raises(ParameterError, match="points = "):
        rotation_number(np.zeros((5, 2)))


@cache
def torus_runs() -> tuple[float, float, list[SettledMotion], list[SettledMotion]]:
    """Return the frequency ratio of a torus, the angle of its pair, and runs on both sides.

    The frequency ratio is to the first resonance, and the angle is in turns per period. Runs beyond
    the bifurcation and before it are separate lists.
    """
    case = steel()
    first = float(case.model.omega[0])
    branch = orbit_branch(high_orbit(case).solution, "omega", (0.95 * first, 0.956 * first))
    (place,) = branch.of(TORUS)
    (pair,) = [m for m in stability_of(place).multipliers if abs(abs(m) - 1) < 1e-6 and m.imag > 0]
    turns = 2 * float(np.angle(pair)) / (2 * np.pi)  # of half a period, twice
    ratio = place.solution.case.omega_ratio
    runs = []
    for shift in (3e-5, 6e-5, -1e-3):
        here = case.changed(omega=(ratio + shift) * first)
        start = high_orbit(here).motion.states(np.zeros(1))[0]
        start[-1] += 0.05 * here.gap * here.omega
        runs.append(settle_motion(here, start, options=SettleOptions(4000, 1024)))
    return ratio, turns, runs[:2], runs[2:]


def test_beyond_a_torus_bifurcation_motions_rotate_by_the_angle_of_its_pair() -> None:
    ratio, turns, beyond, before = torus_runs()
    for motion in beyond:
        assert motion.kind is MotionKind.QUASI_PERIODIC
        assert motion.exponent.low < 0 < motion.exponent.high
        assert motion.rotation.change < 1e-4
        assert motion.rotation.value == pytest.approx(min(turns % 1, 1 - turns % 1), abs=3e-4)
    (motion,) = before
    assert motion.name == "period 1, symmetric"
    near, far = (float(np.std(motion.section.states[:, -1])) for motion in beyond)
    assert far / near == pytest.approx(np.sqrt(2), rel=0.1)  # the circle grows as the square root
    assert ratio == pytest.approx(0.954577, abs=1e-5)


def test_the_rotation_number_is_the_mean_advance_of_a_plain_run_around_its_centre() -> None:
    motion = torus_runs()[2][1]
    states = plain_states(motion.case, motion.state, 0.0, 4000)
    plane = states[:, motion.case.model.modes] - states[:, : motion.case.model.modes] @ (
        motion.case.model.tip_shape
    )
    delayed = (plane[1:] - plane.mean()) + 1j * (plane[:-1] - plane.mean())
    turns = np.sum(np.angle(delayed[1:] / delayed[:-1]) % (2 * np.pi)) / (2 * np.pi)
    share = (turns / (len(delayed) - 1)) % 1
    assert min(share, 1 - share) == pytest.approx(motion.rotation.value, abs=1e-3)


def test_a_periodic_motion_has_level_period_and_symmetry_of_its_orbit() -> None:
    orbit = one_sided()
    case = orbit.case
    state, phase = draw_start(case, 1.5 * case.gap, np.random.default_rng(1))
    motion = settle_motion(case, state, phase)
    assert (motion.kind, motion.multiple, motion.symmetric) == (MotionKind.PERIODIC, 1, False)
    assert motion.level == pytest.approx(orbit.motion.tip_rms, rel=1e-3)
    assert motion.impacts_per_period == len(orbit.impacts)
    assert motion.orbit().stability.stable
    states = plain_states(case, state, phase, 400)
    final = states[-1]
    distance = np.max(np.abs(states - final), axis=1)
    assert np.all(distance[motion.captured + 1 :] < 0.06)
    assert motion.captured > 0


def test_chaotic_motions_have_the_exponent_of_the_saltation_derivative() -> None:
    """Intervals of two estimates that share no tangent vectors, over several starts."""
    case = paper_case(2, 0.985, 1.5, 1.0, 0.025)
    result = [
        settle_motion(case, *draw_start(case, 1.5e-3, np.random.default_rng(k))) for k in range(3)
    ]
    assert {motion.kind for motion in result} == {MotionKind.CHAOTIC}
    other = largest_exponent(case.scene, case.drive(400 * case.period, 0.0), 240)
    value = float(np.mean([motion.exponent.value for motion in result]))
    assert value == pytest.approx(other.value, rel=0.2)
    assert all(motion.rotation is None or motion.rotation.change > 1e-3 for motion in result)


def test_a_motion_is_judged_over_the_window_in_which_it_did_not_repeat() -> None:
    """A metastable motion that leaves later is judged by what it was: the same run, bit for bit."""
    case = paper_case(2, 0.97, 1.5, 1.0, 0.025)
    runs = [
        settle_motion(
            case,
            *draw_start(case, 1.5e-3, np.random.default_rng(k)),
            options=SettleOptions(400),
            with_exponent=False,
        )
        for k in range(4)
    ]
    lasting = [motion for motion in runs if motion.kind is MotionKind.CHAOTIC]
    assert lasting
    for motion in lasting[:2]:
        assert motion.exponent is None
        judged = judge_motion(motion, SettleOptions(400))
        assert judged.exponent.low > 0
        states = motion.section.states
        assert np.array_equal(judged.section.states, states[len(states) - 512 :])
        assert judge_motion(judged) is judged


def test_a_run_that_settles_only_within_the_window_is_periodic_too() -> None:
    case = paper_case(1, 0.93, 1.5, 0.8)
    state, phase = draw_start(case, 1.5e-3, np.random.default_rng(2))
    early = settle_motion(case, state, phase)
    assert early.captured > 100
    late = settle_motion(case, state, phase, SettleOptions(100))
    assert late.name == early.name == "period 1"
    assert late.level == pytest.approx(early.level, rel=1e-6)
    assert late.captured == early.captured
    silent = paper_case(2, 0.9, 0.3, 1.0, 0.025)
    start, phase = draw_start(silent, 1.5e-3, np.random.default_rng(0))
    motion = settle_motion(silent, start, phase)
    assert motion.kind is MotionKind.NO_IMPACTS
    again = settle_motion(silent, start, phase, SettleOptions(100))
    assert (again.kind, again.captured) == (motion.kind, motion.captured)


def coexisting() -> Case:
    """A motion of period 1 beside one of period 2, each with its mirror image."""
    return paper_case(1, 0.9335, 1.5, 0.8)


def test_basin_fractions_are_those_of_plain_runs() -> None:
    case = coexisting()
    (point,) = basin_fractions(case, starts=16, threads=1)
    ended = {}
    for k in range(16):
        state, phase = draw_start(case, START_REACH * case.gap, np.random.default_rng([0, k]))
        states = plain_states(case, state, phase, 1500)
        misses = [np.max(np.abs(states[-20:] - states[-20 - m : -m])) for m in (1, 2)]
        multiple = 1 + int(np.argmax(np.array(misses) < 1e-6))
        assert misses[multiple - 1] < 1e-6
        ended[multiple] = ended.get(multiple, 0) + 1
    result = {
        attractor.motion.multiple: attractor.share.ended
        for attractor in point.attractors
        if attractor.share.ended
    }
    assert result == ended
    assert len(ended) == 2
    assert sum(attractor.share.value for attractor in point.attractors) == pytest.approx(1)
    for attractor in point.attractors:
        assert attractor.orbit.stability.stable
        assert attractor.share.low < attractor.share.value < attractor.share.high


def test_an_attractor_keeps_its_label_along_a_parameter_also_where_no_run_hits_it() -> None:
    case = coexisting()
    points = list(basin_fractions(case, "frequency", [0.9335, 0.9345], starts=16, threads=2))
    labels = [
        {attractor.label: attractor.motion.multiple for attractor in point.attractors}
        for point in points
    ]
    assert labels[0] == labels[1]
    assert sorted(labels[0].values()) == [1, 2]
    again = list(basin_fractions(case, "frequency", [0.9335, 0.9345], starts=16, threads=1))
    assert [point.to_plain() for point in again] == [point.to_plain() for point in points]


def test_labels_follow_runs_first_and_then_the_nearest_features() -> None:
    case = coexisting()
    base = settle_motion(case, *draw_start(case, 1.5e-3, np.random.default_rng([0, 0])))

    def motion(level: float) -> SettledMotion:
        values = {name: getattr(base, name) for name in base.__dataclass_fields__}
        return SettledMotion(**values | {"level": level})

    latest = {1: motion(1.0), 2: motion(1.2)}
    new = [motion(1.05), motion(1.15), motion(9.0)]
    groups = [[0], [1], [2]]
    assert _match_groups(groups, new, latest, {}, 0.3) == [1, 2, 3]
    assert _match_groups(groups, new, latest, {1: 1, 2: 0}, 0.3) == [2, 1, 3]
    assert _match_groups(groups, new, latest, {}, 0.01) == [3, 4, 5]


def test_motions_are_one_attractor_if_kind_period_and_features_agree() -> None:
    orbit = one_sided()
    result = [
        settle_motion(orbit.case, *draw_start(orbit.case, 1.5e-3, np.random.default_rng(k)))
        for k in range(6)
    ]
    sides = {float(np.sign(motion.offset)) for motion in result}
    assert sides == {-1.0, 1.0}  # both images
    assert list(group_motions(result)) == [list(range(6))]
    assert max(feature_distance(result[0], motion) for motion in result) < 1e-3


def test_lifetimes_are_those_of_a_maximum_likelihood_fit_of_censored_data() -> None:
    rng = np.random.default_rng(3)
    true = rng.exponential(400.0, 200)
    durations = np.minimum(true, 700.0)
    ended = true <= 700.0
    result = fit_lifetimes(durations, ended, burn_in=0.0)
    data = scipy.stats.CensoredData.right_censored(durations, ~ended)
    _, mean = scipy.stats.expon.fit(data, floc=0)
    assert result.mean == pytest.approx(mean, rel=1e-4)
    assert (result.ended, result.censored) == (int(ended.sum()), int((~ended).sum()))
    late = fit_lifetimes(durations, ended, burn_in=100.0)
    assert late.interval[0] < 400 < late.interval[1]
    assert late.ended == int(np.sum(ended & (durations > 100)))


def test_the_interval_of_a_lifetime_holds_the_true_one_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(400):
        true = rng.exponential(300.0, 30)
        low, high = fit_lifetimes(np.minimum(true, 600.0), true <= 600.0, 50.0).interval
        held += low <= 300 <= high
    assert 0.92 <= held / 400 <= 0.99


def test_lifetimes_that_are_not_exponential_are_noticed() -> None:
    rng = np.random.default_rng(1)
    fast_and_slow = np.concatenate([rng.exponential(20.0, 60), rng.exponential(2000.0, 60)])
    assert fit_lifetimes(fast_and_slow, [True] * 120, 0.0).constant < 1e-3
    assert fit_lifetimes(rng.exponential(300.0, 120), [True] * 120, 0.0).constant > 0.01
    nothing = fit_lifetimes([100.0], [False], 0.0)
    assert nothing.mean == np.inf
    assert nothing.to_plain()["mean_periods"] is None
    with pytest.raises(ParameterError, match="ended = "):
        fit_lifetimes([1.0, 2.0], [True])


def test_a_map_has_the_motion_of_each_point() -> None:
    case = coexisting()
    result = attractor_map(case, ("frequency", "force"), [0.92, 0.95], [0.5, 3.0], threads=1)
    assert result.complete
    assert [len(row) for row in result.motions] == [2, 2]
    for ratio, force, motion in result.cells():
        here = case.changed(omega=ratio * float(case.model.omega[0]), force=force)
        own = settle_motion(here)
        assert (own.name, own.level) == (motion.name, motion.level)
    assert result.motions[0][0].kind is MotionKind.NO_IMPACTS
    with pytest.raises(ParameterError, match="two different parameters"):
        attractor_map(case, ("force", "force"), [1.0], [2.0])


def test_points_of_a_diagram_are_those_of_plain_runs_and_lie_on_exact_branches() -> None:
    case = coexisting()
    ratios = [0.929, 0.930, 0.932]
    points = list(
        diagram_points(case, "frequency", ratios, directions=["up"], random_start=True, seed=4)
    )
    state, phase = draw_start(
        case.changed(omega=ratios[0] * float(case.model.omega[0])),
        START_REACH * case.gap,
        np.random.default_rng([4, 0]),
    )
    n = case.model.modes
    for point, ratio in zip(points, ratios, strict=True):
        here = case.changed(omega=ratio * float(case.model.omega[0]))
        # to a whole number of turns, as sections are at phase 0
        lead = (-phase % (2 * np.pi)) / here.omega
        start = simulate(
            here.scene,
            here.drive(lead, phase) if lead else here.drive(here.period, 0.0),
            initial=InitialState.from_vector(here.scene, state),
        ).end_state
        unit = here.gap * np.concatenate([np.ones(n + 1), np.full(n + 1, here.omega)])
        states = plain_states(here, start, 0.0, 1200)[-2:]
        relative = states[:, n] - states[:, :n] @ case.model.tip_shape
        section = point.quantities()["relative"]
        assert len(section) == point.motion.multiple
        np.testing.assert_allclose(
            np.sort(np.unique(relative.round(4))), np.sort(section), atol=2e-4
        )
        state = states[-1] * unit
        phase = 0.0
    branches = list(diagram_branches(case, "frequency", (0.928, 0.933), points, longest=2))
    assert {branch.multiple for branch in branches} == {1, 2}
    for point in points:
        value = point.quantities()["relative"][0]
        misses = []
        for branch in branches:
            x = branch.values
            for k in np.flatnonzero((x[:-1] - point.value) * (x[1:] - point.value) <= 0):
                share = (point.value - x[k]) / (x[k + 1] - x[k])
                on = branch.relative[k] + share * (branch.relative[k + 1] - branch.relative[k])
                if branch.stable[k] and branch.multiple == point.motion.multiple:
                    misses.append(np.min(np.abs(on - value)))
        assert min(misses) < 1e-3


def test_the_direction_of_a_diagram_decides_where_attractors_coexist() -> None:
    case = paper_case(1, 0.95, 1.5, 0.75)
    points = list(diagram_points(case, "force", np.linspace(0.8, 3.0, 5).tolist()))
    assert [point.direction for point in points] == ["up"] * 5 + ["down"] * 5
    up, down = ({round(p.value, 6): p.motion for p in part} for part in (points[:5], points[5:]))
    assert up[0.8].kind is MotionKind.NO_IMPACTS
    different = [value for value in up if feature_distance(up[value], down[value]) > 0.05]
    assert different
    with pytest.raises(ParameterError, match="rising"):
        next(diagram_points(case, "force", [2.0, 1.0]))
    with pytest.raises(ParameterError, match="parameter = "):
        next(diagram_points(case, "colour", [1.0, 2.0]))
    with pytest.raises(ParameterError, match="window = 10"):
        SettleOptions(window=10)
