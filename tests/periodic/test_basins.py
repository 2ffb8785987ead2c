"""Runs from random initial states find attractors that no branch leads to.

The shares of runs have correct intervals.
"""

import numpy as np
import pytest
from support.orbit_cases import multipliers_by_reference, paper_case

from impact_env.checks import ParameterError
from impact_env.periodic.basins import Share, distance_to, draw_start, find_basins
from impact_env.periodic.motion import Motion
from impact_env.periodic.offspring import all_orbits_over
from impact_env.periodic.orbit import Orbit, mirror_orbit
from impact_env.periodic.survey import is_same_orbit, state_after
from impact_env.scene import InitialState


def test_an_orbit_over_three_periods_attracts_runs_where_no_branch_leads_to_it() -> None:
    """N_m = 1, e = 0.838, 2.76 N: its multipliers are those of an own propagation by matrices."""
    case = paper_case(1, 0.9315, 2.76, 0.838)
    basins = find_basins(case, starts=16)
    (orbit,) = basins.orbits
    assert orbit.schedule.period_multiple == 3
    assert len(orbit.impacts) == 8
    assert orbit.motion.tip_max == pytest.approx(1.36379e-3, abs=5e-9)
    assert isinstance(orbit.motion, Motion)
    truth = multipliers_by_reference(orbit.motion)
    assert np.max(np.abs(truth)) ** 2 == pytest.approx(0.719, abs=2e-3)
    share = basins.share_of(orbit)
    assert share.runs == basins.runs == 16
    assert share.ended == 16 - basins.nothing_periodic
    assert share.ended > 1  # each run misses it with a chance of about a third


def test_a_stable_orbit_does_not_end_the_search_for_others() -> None:
    """A stable orbit does not end the search for others.

    N_m = 1, e = 0.8346, 1.5227 N: a pair with three impacts is stable, and so is a pair over two
    periods.
    """
    case = paper_case(1, 0.9284908266, 1.522687766, 0.8346017255)
    (group,) = all_orbits_over(case, np.array([0.9284908266]), longest=2)
    stable = [orbit for orbit in group.orbits if orbit.stability.stable]
    doubled = [orbit for orbit in stable if orbit.schedule.period_multiple == 2]
    assert len(doubled) == 2
    image = mirror_orbit(doubled[0])
    assert isinstance(image, Orbit)
    assert is_same_orbit(image, doubled[1])
    assert group.basins is not None
    assert sum(group.basins.share_of(orbit).ended for orbit in stable) == group.basins.runs
    assert any(orbit.schedule.period_multiple == 1 for orbit in stable)


def test_a_run_ends_on_the_orbit_that_it_is_counted_for() -> None:
    """Another run of the same start, of another length, is next to that orbit."""
    case = paper_case(1, 0.93, 1.5, 0.75)
    basins = find_basins(case, starts=4, periods=400, seed=3, reach=2e-3)
    ended = [0] * len(basins.orbits)
    for k in range(4):
        state, phase = draw_start(case, 2e-3, np.random.default_rng([3, k]))
        end, after = state_after(case, 601.0, InitialState.from_vector(case.scene, state), phase)
        miss = [distance_to(orbit, end, after) for orbit in basins.orbits]
        ended[int(np.argmin(miss))] += 1
        assert min(miss) < 1e-6
    assert tuple(ended) == basins.ended


def test_a_force_too_small_for_impacts_leaves_none() -> None:
    basins = find_basins(paper_case(1, 0.9, 0.1, 0.75, 0.05), starts=3, periods=400)
    assert basins.without_impacts == basins.runs == 3
    assert basins.orbits == ()


def test_chaos_is_nothing_periodic() -> None:
    basins = find_basins(paper_case(3, 1.0, 3.0), starts=3, periods=100)
    assert basins.nothing_periodic == 3


@pytest.mark.parametrize(("ended", "runs"), [(0, 16), (9, 30), (16, 16)])
def test_intervals_are_wilsons(ended: int, runs: int) -> None:
    share = Share(ended, runs)
    z = 1.959963984540054
    p = ended / runs
    middle = (p + z**2 / (2 * runs)) / (1 + z**2 / runs)
    half = z / (1 + z**2 / runs) * np.sqrt(p * (1 - p) / runs + z**2 / (4 * runs**2))
    assert share.value == p
    assert (share.low, share.high) == pytest.approx((middle - half, middle + half), abs=1e-9)


@pytest.mark.parametrize("name", ["starts", "periods", "seed", "reach"])
def test_numbers_out_of_range_are_refused(name: str) -> None:
    with pytest.raises(ParameterError, match=f"{name} = -1"):
        find_basins(paper_case(1, 0.93, 1.5, 0.75), **{name: -1})
