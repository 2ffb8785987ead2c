"""Uncertain parameters are drawn correctly.

Distributions, lanes with all parameters drawn, members of a search, and options of the command line
are tested.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from impact_env import (
    Beam,
    Drive,
    ParameterError,
    Scene,
    beam_scene,
    impact_absorber,
    linear_sweep,
    modal_model,
)
from impact_env.ensemble import Lane, draw_members
from optimisation.answers.gap import read_uncertain
from optimisation.calibration.posterior import Posterior
from optimisation.cli.common import parse_uncertain
from optimisation.cli.options import count_uncertain_words, join_words
from optimisation.contact import estimate, material, meeting_mass, reaches_beyond
from optimisation.files import write_json
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.space import IMPACT, design_space
from optimisation.tolerances import NAMES, draw_lane, posterior_spreads, shares, spreads

EVERY = dict.fromkeys(NAMES, "5%")


def values(name: str, tolerance: str | Sequence[float | str], nominal: float) -> np.ndarray:
    (one,) = spreads({name: tolerance})
    return np.array([one.value_at(share, nominal) for share in np.linspace(0, 1, 2001)])


def test_a_deviation_is_a_normal_distribution_cut_at_three() -> None:
    drawn_gaps = values("gap", "5%", 2e-3)
    assert drawn_gaps.min() == pytest.approx(2e-3 * 0.85)
    assert drawn_gaps.max() == pytest.approx(2e-3 * 1.15)
    # standard deviation of a standard normal variable that is cut at three, from tables of the
    # truncated normal
    cut = 0.98658
    assert drawn_gaps.std() == pytest.approx(2e-3 * 0.05 * cut, rel=5e-3)
    assert np.mean(np.abs(drawn_gaps / 2e-3 - 1) < 0.05) == pytest.approx(0.6827 / 0.9973, abs=2e-3)


def test_two_numbers_are_a_uniform_distribution() -> None:
    np.testing.assert_allclose(
        values("gap", (1e-3, 3e-3), 17.0)[[0, 1000, 2000]], [1e-3, 2e-3, 3e-3]
    )
    np.testing.assert_allclose(
        values("damping", ("-20%", "40%"), 0.01)[[0, 1000, 2000]], [0.008, 0.011, 0.014]
    )


def test_a_lane_has_everything_drawn_and_its_sweep_follows_the_frequency() -> None:
    scene = beam_scene(Beam(modes=3), impact_absorber(1e-3, 0.7, 0.1))
    omega = scene.model.resonance_omega(2)
    lane = Lane(scene, Drive(2.0, linear_sweep(omega, 0.9, 1.1, 40.0), 0.3))
    every = spreads(
        {
            "damping": (0.02, 0.03),
            "frequency": ("-10%", "30%"),
            "force": (1, 4),
            "gap": "5%",
            "restitution": (0.2, 0.4),
            "friction": "10%",
        }
    )
    share = dict.fromkeys(NAMES, 0.5)
    lane_drawn = draw_lane(lane, every, share, 2, 2.0)
    np.testing.assert_allclose(lane_drawn.scene.model.damping_ratio, 0.025)
    np.testing.assert_allclose(lane_drawn.scene.model.omega, 1.1 * scene.model.omega)
    assert lane_drawn.drive.amplitude == pytest.approx(2.5)
    assert lane_drawn.drive.phase == 0.3
    np.testing.assert_allclose(lane_drawn.drive.schedule.omegas, 1.1 * lane.drive.schedule.omegas)
    np.testing.assert_allclose(lane_drawn.drive.schedule.times, lane.drive.schedule.times / 1.1)
    absorber = lane_drawn.scene.absorber
    assert (absorber.walls.gap, absorber.friction.limit) == pytest.approx((1e-3, 0.1))
    assert absorber.walls.restitution == pytest.approx(0.3)
    wide = draw_lane(lane, every, dict.fromkeys(NAMES, 1.0), 2, 2.0).scene.absorber
    assert (wide.walls.gap, wide.friction.limit) == pytest.approx((1.15e-3, 0.13))


def test_members_draw_the_same_in_every_run_and_different_from_each_other() -> None:
    every = spreads(EVERY)
    members = draw_members(200, 3)
    drawn_shares = shares(every, members)
    assert drawn_shares[5:9] == shares(every, members[5:9])
    table = np.array([[row[name] for name in NAMES] for row in drawn_shares])
    assert np.all(np.abs(table.mean(axis=0) - 0.5) < 0.1)
    assert np.abs(np.corrcoef(table.T) - np.eye(len(NAMES))).max() < 0.3


def test_a_problem_runs_each_member_with_its_own_numbers() -> None:
    options = {
        "space": design_space(IMPACT),
        "conditions": (Condition(1, 3.5),),
        "beam": Beam(modes=2),
        "members": 3,
        "rate": 40.0,
    }
    problem = Problem(**options, uncertain={"gap": "5%", "force": "10%", "damping": "10%"})
    assert "uncertain" not in Problem(**options).describe()
    assert problem.describe()["uncertain"] == {"damping": ["10%"], "force": ["10%"], "gap": ["5%"]}
    (chunk,) = problem.chunks(problem.space.default, problem.ensemble, problem.rate)
    gaps = [lane.scene.absorber.walls.gap for lane in chunk.lanes]
    assert gaps[::2] == gaps[1::2]  # up and down are one machine
    assert len(set(gaps)) == 3
    bare = problem._chunk(
        None,
        Scene(modal_model(Beam(modes=2))),
        problem.conditions[0],
        problem.ensemble,
        problem.rate,
    )
    for with_one, without in zip(
        chunk.lanes, bare.lanes, strict=True
    ):  # relative to no absorber: the same machine without it
        assert with_one.drive.amplitude == pytest.approx(3.5 * without.drive.amplitude)
        np.testing.assert_array_equal(
            with_one.scene.model.damping_ratio, without.scene.model.damping_ratio
        )


def test_words_of_the_command_line() -> None:
    line = [
        "--uncertain",
        "gap",
        "5%",
        "--force",
        "3",
        "--uncertain",
        "gap",
        "1e-3",
        "2e-3",
        "--uncertain",
        "damping",
        "-5%",
        "5%",
        "--quick",
    ]
    parsed = [
        "--uncertain",
        "gap 5%",
        "--force",
        "3",
        "--uncertain",
        "gap 1e-3 2e-3",
        "--uncertain",
        "damping -5% 5%",
        "--quick",
    ]
    assert join_words(line, {"--uncertain": count_uncertain_words}) == parsed
    assert join_words(["--uncertain"], {"--uncertain": count_uncertain_words}) == ["--uncertain"]
    assert parse_uncertain([("gap", ("5%",)), ("force", ("1", "2"))]) == {
        "gap": ("5%",),
        "force": ("1", "2"),
    }


# The estimate of an impact after Hertz, beside the motion of the two bodies integrated in time.


@pytest.mark.parametrize(
    ("first", "second", "radius", "mass", "speed"),
    [("steel", "steel", 0.01, 0.03, 0.5), ("nylon", "brass", 0.004, 0.2, 2.0)],
)
def test_time_and_force_are_those_of_the_motion(
    first: str, second: str, radius: float, mass: float, speed: float
) -> None:
    contact = estimate(first, second, radius, mass, speed)
    stiff = 1 / sum((1 - nu**2) / young for young, nu in (material(first), material(second)))

    def force(depth: float) -> float:
        return 4 / 3 * stiff * np.sqrt(radius) * max(depth, 0.0) ** 1.5

    parted = lambda _, y: y[0]  # noqa: E731
    parted.terminal = True
    parted.direction = -1
    run = solve_ivp(
        lambda _, y: [y[1], -force(y[0]) / mass],
        (0, 5 * contact.time),
        [0, speed],
        events=parted,
        rtol=1e-9,
        atol=1e-14,
        max_step=contact.time / 200,
    )
    assert run.t_events[0][0] == pytest.approx(contact.time, rel=5e-3)
    assert force(run.y[0].max()) == pytest.approx(contact.force, rel=1e-3)
    contact_radius = np.sqrt(radius * run.y[0].max())
    assert contact.pressure == pytest.approx(
        1.5 * contact.force / (np.pi * contact_radius**2), rel=1e-3
    )


def test_the_meeting_mass_is_below_that_of_the_absorber_and_falls_with_the_modes() -> None:
    masses = [meeting_mass(modal_model(Beam(modes=modes)), 0.01) for modes in (1, 5, 10)]
    assert 0.01 > masses[0] > masses[1] > masses[2] > 0
    # the velocities of one impact: momentum P of the absorber against sum phi_i^2 P of the place
    model = modal_model(Beam(modes=3))
    assert 1 / meeting_mass(model, 0.01) == pytest.approx(
        1 / 0.01 + sum(phi**2 for phi in model.tip_shape)
    )


def test_a_hard_impact_reaches_modes_that_were_left_out() -> None:
    model = modal_model(Beam(modes=3))
    assert reaches_beyond(model, estimate("steel", "steel", 0.01, 0.01, 1.0))
    assert not reaches_beyond(model, estimate("1e5:0.45", "steel", 0.01, 0.01, 0.1))


def test_draws_of_a_posterior_are_joint_and_leave_other_draws_as_they_are() -> None:
    """A row of the posterior for each member: what two quantities have in common stays."""
    rows = np.random.default_rng(0).uniform(0.3, 0.9, 200)
    posterior = Posterior(
        ("restitution", "friction_limit", "gap"), np.column_stack([rows, rows / 10, rows * 1e-3])
    )
    absorber = impact_absorber(1e-3, 0.6, 0.1)
    every = posterior_spreads(posterior, absorber)
    assert [one.name for one in every] == ["restitution", "friction"]
    members = draw_members(50, 3)
    own = shares(every, members)
    values = [[one.value_at(share[one.name], 0.0) for one in every] for share in own]
    assert np.allclose([a / b for a, b in values], 10.0)
    assert np.std([a for a, _ in values]) > 0.1
    damping = spreads({"damping": "10%"})
    both = shares((*damping, *every), members)
    assert [one["damping"] for one in both] == [one["damping"] for one in shares(damping, members)]
    frictionless = impact_absorber(1e-3, 0.6)
    assert [one.name for one in posterior_spreads(posterior, frictionless)] == ["restitution"]


def test_a_posterior_is_read_where_a_gap_is_chosen(tmp_path: Path) -> None:
    rows = np.random.default_rng(0).uniform(0.5, 0.6, (60, 1))
    write_json(tmp_path / "p.json", Posterior(("restitution",), rows).to_plain())
    line = ["--uncertain", str(tmp_path / "p.json"), "--uncertain", "force", "5%"]
    assert join_words(line, {"--uncertain": count_uncertain_words}) == [*line[:3], "force 5%"]
    words = parse_uncertain([(str(tmp_path / "p.json"), ()), ("force", ("5%",))])
    absorber = impact_absorber(1e-3, 0.6, 0.1)
    assert [one.name for one in read_uncertain(words, absorber, True)] == ["force", "restitution"]
    with pytest.raises(ParameterError, match="left out beside a posterior"):
        read_uncertain(words | {"restitution": ("5%",)}, absorber, True)
    with pytest.raises(
        ParameterError, match=r"uncertain posterior = .* is not allowed: a posterior"
    ):
        read_uncertain({"posterior": str(tmp_path / "no.json")}, absorber, True)
