"""Objectives, constraints and measures of runs are correct.

They are compared with closed forms, the textbook and the recorded motion.
"""

import runpy
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from core import STEEL, drive_of, run, scene_of
from hypothesis import example, given
from hypothesis import strategies as st
from places import EXAMPLES

from impact_env import (
    Beam,
    Drive,
    ParameterError,
    Record,
    Scene,
    impact_absorber,
    modal_model,
    simulate,
)
from impact_env.drive import constant_frequency
from impact_env.ensemble import Lane, Threads
from optimisation.bounds import design_gap
from optimisation.measures import (
    MEASURES,
    Chunk,
    _value,
    fatigue_damage,
    rainflow_amplitudes,
    stress_shape,
    turning_points,
)
from optimisation.mounting import model_with_absorber_at
from optimisation.objectives import Condition, Constraint, Objective, Score, range_width
from optimisation.problem import FAILED, PENALTY, Problem, evaluate, measured_chunks
from optimisation.search.judge import add_repairs, propose_repairs
from optimisation.search.settings import EvaluatedDesign
from optimisation.space import Design, design_space

FIRST = Condition(1, 3.5)
BOTH = (FIRST, Condition(2, 35.0))


def small(**changes: object) -> Problem:
    """Return a problem whose runs take milliseconds.

    It has two modes, and sweeps forty times as fast as in the paper.
    """
    options = {
        "space": design_space("impact"),
        "conditions": BOTH,
        "beam": Beam(modes=2),
        "members": 3,
        "rate": 40.0,
    }
    return Problem(**(options | changes))


def heavy(measured: dict[str, np.ndarray]) -> np.ndarray:
    """A function of one's own: twice the worst level of each member."""
    return np.asarray(2 * measured["level"].max(axis=(1, 2)))


def test_objectives_and_constraints_of_ones_own() -> None:
    here = f"{__name__}:heavy"
    problem = small(
        objectives=(Objective(here), Objective("absolute")),
        constraints=(Constraint(here, 1e-4), Constraint("level", 1.0)),
    )
    ((_, measured),) = evaluate(
        problem, [problem.space.default], problem.ensemble, problem.rate, Threads(1)
    )
    own = problem.score(problem.space.default, measured, problem.ensemble, problem.rate)
    assert own.values[0] == pytest.approx(2 * own.values[1])
    assert own.violations[0] > 0
    assert not own.feasible


def test_acceleration_and_stress_of_a_linear_run() -> None:
    """Acceleration and stress of a linear run are correct.

    Without absorber they are compared with the modal equations of motion and the moment of the
    recorded motion.
    """
    model = modal_model(Beam(modes=2))
    beam = Beam(modes=2)
    drive = Drive(1.0, constant_frequency(float(model.omega[0]), 0.5, 200.0))
    chunk = Chunk(
        (Lane(Scene(model), drive),), ("rms", "acceleration", "stress"), stress_shape(beam), 5.0
    )
    rms, acceleration, stress = measured_chunks([chunk], Threads(1))[0][0]
    response = simulate(Scene(model), drive, record=Record(series=True))
    moments = response.history.modal_displacement @ stress_shape(beam)
    assert stress == pytest.approx(np.abs(moments).max())
    history = response.history
    force = np.cos(0.5 * model.omega[0] * history.time)[:, None] * model.force_shape
    own = (
        force
        - 2 * model.damping_ratio * model.omega * history.modal_velocity
        - model.omega**2 * history.modal_displacement
    )
    assert acceleration == pytest.approx(np.abs(own @ model.tip_shape).max(), rel=0.05)
    assert rms < np.abs(history.modal_displacement @ model.tip_shape).max()


def test_rainflow_counts_the_textbook_example() -> None:
    amplitudes, counts = rainflow_amplitudes(
        np.array([-2, 1, -3, 5, -1, 3, -4, 4, -2], dtype=float)
    )
    counted: dict[float, float] = {}
    for amplitude, number in zip(2 * amplitudes, counts, strict=True):
        counted[float(amplitude)] = counted.get(float(amplitude), 0.0) + float(number)
    assert counted == {
        3.0: 0.5,
        4.0: 1.5,
        6.0: 0.5,
        8.0: 1.0,
        9.0: 0.5,
    }  # ranges and counts of ASTM E1049's example


@example([1.0, 0.0, 1e-200, 0.0, 1.0])  # steps whose product is zero
@given(st.lists(st.floats(-100, 100), min_size=1, max_size=60))
def test_rainflow_loses_no_range(values: list[float]) -> None:
    series = np.array(values)
    amplitudes, counts = rainflow_amplitudes(series)
    turns = turning_points(series)
    assert fatigue_damage(series, 5.0) == pytest.approx(np.sum(counts * amplitudes**5), rel=1e-9)
    assert np.sum(counts) == (len(turns) - 1) / 2
    assert np.max(amplitudes, initial=0.0) == pytest.approx(np.ptp(series) / 2)
    assert 4 * np.sum(amplitudes * counts) == pytest.approx(
        np.sum(np.abs(np.diff(turns))), abs=1e-9
    )


@pytest.mark.same_bits
def test_moment_at_the_clamp_of_a_load_at_the_end() -> None:
    beam = Beam(modes=60)
    model = modal_model(beam)
    moment = stress_shape(beam)
    assert moment is not None
    still = model.tip_shape * 7.0 / model.omega**2
    assert moment @ still == pytest.approx(7.0 * beam.length, rel=1e-6)
    off = model_with_absorber_at(beam, 0.4)
    assert off.level_shape @ still == pytest.approx(
        7.0 * beam.length**3 / (3 * beam.bending_stiffness), rel=1e-6
    )
    np.testing.assert_array_equal(off.level_shape, model.tip_shape)
    assert stress_shape(Beam(ends="pinned-pinned", absorber_position=0.5)) is None
    assert stress_shape(model) is None


def test_measures_agree_with_the_energy_account_and_the_events() -> None:
    scene = scene_of(impact_absorber(restitution=0.7, friction_limit=0.1))
    drive = drive_of(3.5, 0.95, 1.0, periods=40)
    response = run(scene, drive)  # without the level, for one kernel fewer
    chunk = Chunk((), tuple(MEASURES), stress_shape(Beam(modes=3)), 5.0)
    measures = {
        name: _value(name, chunk, response)
        for name in MEASURES
        if name not in ("level", "level_ratio")
    }
    energy = response.energy
    impacts = response.impacts
    duration = response.drive.schedule.times[-1]
    assert len(impacts.time) > 20
    assert measures["impact_power"] == pytest.approx(energy.impact_loss / duration, rel=1e-9)
    assert measures["friction_heat"] == pytest.approx(energy.friction_loss / duration, rel=0.02)
    assert measures["impact_speed"] == np.max(np.abs(impacts.relative_velocity))
    assert 0.99e-3 < measures["stroke"] <= 1e-3 * (1 + 1e-9)
    assert measures["damage"] > 0


@pytest.mark.parametrize(
    ("levels", "limit", "decades"),
    [
        ([0.2, 0.2, 0.2], 0.3, 2.0),
        ([0.5, 0.5, 0.5], 0.3, 0.0),
        ([0.2, 0.4, 0.2], 0.3, 0.5),
        ([0.4, 0.2, 0.4], 0.3, 1.0),
        ([0.2, 0.2, 0.4, 0.2, 0.4], 0.3, 1.5),  # the longer of two
        ([0.4, 0.2, 0.4, 0.2, 0.2, 0.4], 0.3, 2.0),
    ],
)
def test_width_of_a_range(levels: list[float], limit: float, decades: float) -> None:
    forces = 10.0 ** np.arange(len(levels))
    assert range_width(forces, np.array(levels), limit) == pytest.approx(decades)


def test_conditions_directions_and_members_are_aggregated_as_chosen() -> None:
    values = np.array(
        [[[1.0, 2.0], [5.0, 3.0]], [[4.0, 1.0], [1.0, 1.0]], [[2.0, 2.0], [3.0, 3.0]]]
    )  # member, condition, direction
    np.testing.assert_array_equal(Objective().per_member(values, BOTH), [5.0, 4.0, 3.0])
    np.testing.assert_array_equal(Objective(over="mean").per_member(values, BOTH), [3.5, 2.5, 2.5])
    np.testing.assert_array_equal(Objective(resonance=2).per_member(values, BOTH), [5.0, 1.0, 3.0])

    def aggregate(objective: Objective, conditions: tuple[Condition, ...]) -> float:
        return objective.value_of(objective.per_member(values, conditions))

    assert aggregate(Objective(), BOTH) == 4.0
    assert aggregate(Objective(quantile=1.0), BOTH) == 5.0
    forces = tuple(Condition(1, f) for f in (1.0, 10.0, 100.0))
    wide = Objective("range", limit=0.3, quantile=1.0)
    values = np.repeat(np.array([[0.2, 0.2, 0.2], [0.2, 0.4, 0.4]])[..., None], 2, axis=2)
    assert aggregate(wide, forces) == pytest.approx(0.5)  # what every member reaches
    assert aggregate(replace(wide, quantile=0.5), forces) == pytest.approx(1.25)


def test_best_gap_scales_with_the_force_and_lies_at_the_rule() -> None:
    """The best gap is proportional to the force and close to the rule.

    By the scaling law, twice the force gives twice the best gap and friction with the same scores.
    """
    model = modal_model(Beam(modes=3))
    rule = design_gap(model, 0.02 * model.beam_mass, 3.5)
    factors = np.geomspace(1 / 2.5, 2.5, 9)
    best_gaps = []
    for scale in (1, 2):
        problem = small(
            conditions=(Condition(1, 3.5 * scale),), beam=Beam(modes=3), members=1, rate=3.0
        )
        values = {
            "restitution": 0.7,
            "friction_limit": 0.05 * scale,
            "mass_ratio": 0.02,
            "position": 1.0,
        }
        designs = [Design("impact", {"gap": rule * factor * scale, **values}) for factor in factors]
        scores = dict(evaluate(problem, designs, problem.ensemble, problem.rate, Threads(1)))
        best_gaps.append(
            [
                problem.score(d, scores[k], problem.ensemble, problem.rate).values[0]
                for k, d in enumerate(designs)
            ]
        )
    np.testing.assert_allclose(best_gaps[1], best_gaps[0], rtol=1e-9)
    assert 0.75 < factors[np.argmin(best_gaps[0])] < 1.7
    assert min(best_gaps[0]) < 0.6 * max(best_gaps[0])


def test_constraints_are_the_worst_of_all_runs() -> None:
    problem = small(constraints=(Constraint("mass_ratio", 0.01), Constraint("stroke", 1e-3)))
    assert problem.measures == ("level", "stroke", "level_ratio")
    measured = np.full((3, 2, 2, 3), 1e-3)
    measured[1, 1, 0, 1] = 2e-3
    score = problem.score(problem.space.default, measured, problem.ensemble, problem.rate)
    assert score.violations == pytest.approx((1.0, 1.0))
    assert not score.feasible
    assert PENALTY < problem.penalised_cost(score) < FAILED
    failed = problem.score(
        problem.space.default, np.full((3, 2, 2, 3), np.nan), problem.ensemble, problem.rate
    )
    assert failed.failed
    assert problem.penalised_cost(failed) > problem.penalised_cost(score)


def test_a_stroke_limit_cuts_the_space_of_gaps() -> None:
    """A stroke limit reduces the space of gaps.

    Between rigid walls the stroke is the gap. The widest gap of the space is thus the limit, also
    if the rule's gap is wider.
    """
    problem = small(constraints=(Constraint("stroke", 0.6e-3),))
    gap = [v.name for v in problem.space.free].index("gap")
    shares = [0.5] * len(problem.space.free)
    shares[gap] = 1.0
    assert problem.space.at(shares).values["gap"] == pytest.approx(0.6e-3)
    assert problem.space.default.values["gap"] <= 0.6e-3
    assert small().space.at(shares).values["gap"] > 0.6e-3


def test_the_least_bad_design_is_tried_with_other_gaps() -> None:
    """The design that exceeds its limit least is tried with other gaps.

    A quantity is 1.5 times its limit. Gaps are tried around 1/1.5 of the design's, with friction in
    proportion. A design within all limits is not changed.
    """
    problem = small(constraints=(Constraint("impact_speed", 0.5),), members=1, rate=40.0)
    design = problem.space.default
    bad = EvaluatedDesign(3, design, Score((0.5,), (0.5,)), 1)
    worse = EvaluatedDesign(4, problem.space.paper, Score((0.2,), (0.9,)), 1)
    designs = propose_repairs(problem, [worse, bad])
    scales = np.array([one.values["gap"] / design.values["gap"] for one in designs])
    assert scales.min() < 1 / 1.5 < scales.max()
    np.testing.assert_allclose(
        [one.values["friction_limit"] for one in designs],
        scales * design.values["friction_limit"],
    )
    every = add_repairs(problem, [worse, bad], Threads(1))
    assert [one.number for one in every[2:]] == list(range(5, 5 + len(designs)))
    good = EvaluatedDesign(5, design, Score((0.5,), (-0.1,)), 1)
    assert propose_repairs(problem, [bad, good]) == []


# Designs in arrays for other people's optimisers, and the worked examples with those, where they
# are installed.


STRIP = replace(STEEL, modes=2)
GAP_AND_FRICTION = design_space("impact", ["gap", "friction_limit"])
steel = partial(
    small, space=GAP_AND_FRICTION, conditions=(Condition(1, 0.5),), beam=STRIP, members=5
)


class Backwards(Threads):
    """An executor that finishes the last chunk first, and may give up the runs of some gaps."""

    lost = ()

    def each(self, function, chunks, kinds):
        for k, values in reversed(list(super().each(function, chunks, kinds))):
            gap = chunks[k].lanes[0].scene.absorber.walls.gap
            yield (
                k,
                np.full_like(values, np.nan)
                if any(abs(gap - x) < 1e-9 for x in self.lost)
                else values,
            )


def test_rows_come_in_the_order_of_the_designs() -> None:
    problem = steel(
        constraints=(Constraint("impact_speed", 0.02),),
        objectives=(Objective(), Objective("severity")),
    )
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
    conditions = tuple(Condition(1, force) for force in (0.3, 0.5, 0.9))
    wide = steel(
        conditions=conditions, objectives=(Objective("range", limit=0.5),), members=1
    ).evaluate([[1.0, 0.1]])
    assert wide.F[0, 0] < 0  # decades, with their sign turned: all objectives are minimised
    assert np.isnan(wide.spread).all()


def test_failures_are_nan_with_a_reason_and_leave_the_others() -> None:
    problem = steel()
    executor = Backwards()
    executor.lost = (problem.units.gap(0.02) * 2.0,)
    why: dict[int, str] = {}
    F, _, spread = problem.evaluate(
        [[1.0, 0.1], [9.0, 0.1], [2.0, 0.1], [np.nan, 0.1]], executor=executor, failures=why
    )
    assert np.isfinite(F[0]).all()
    assert np.isnan(F[1:]).all()
    assert np.isnan(spread[1:]).all()
    assert set(why) == {1, 2, 3}
    assert "gap = 9.0 is not allowed: from 0.1 to 4 of the rule's gap" in why[1]
    assert (
        "the integrator gave up 5 of 5 runs, the first of them member 0 at resonance 1, 0.5 N"
        in why[2]
    )
    with pytest.raises(ParameterError, match=r"X = \(1, 3\)"):
        problem.evaluate([[1.0, 0.1, 0.5]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "sizes", "printed"),
    [
        ("pymoo", (8, 3, 2), "mW lost in impacts"),
        ("botorch", (6, 1, 2, 2), "on fresh members"),
        ("openmdao", (6, 2), "of no absorber, impact speed"),
    ],
)
def test_worked_examples_find_a_quiet_design(
    package: str, sizes: tuple[int, ...], printed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip(package)
    best = runpy.run_path(str(EXAMPLES / f"optimise_with_{package}.py"))["main"](*sizes, rate=40.0)
    assert 0.05 < np.min(np.atleast_2d(best)[:, 0]) < 0.6
    assert printed in capsys.readouterr().out


def test_means_of_a_constant_frequency_leave_its_start_out() -> None:
    """Means at a constant frequency do not include its start.

    They are computed here from the recorded impacts and motion, from five time constants 1/(D
    omega) on.
    """
    scene = Scene(modal_model(Beam(modes=2)), impact_absorber(0.5e-3, 0.7, 0.1))
    omega = float(scene.model.omega[0])
    drive = Drive(3.5, constant_frequency(omega, 0.95, 300.0))
    response = simulate(scene, drive, record=Record(events=True, series=True))
    impacts = response.impacts
    history = response.history
    assert impacts is not None
    assert history is not None
    start = 5 / (0.01 * omega)
    end = 300 * 2 * np.pi / omega
    late = impacts.time >= start
    assert 0 < np.sum(late) < len(late)
    place = history.modal_velocity @ scene.model.tip_shape
    speed = np.abs(history.absorber_velocity - place)[history.time >= start]
    wanted = {
        "impact_rate": np.sum(late) / (end - start),
        "impact_power": np.sum(impacts.energy_lost[late]) / (end - start),
        "impact_rms_speed": np.sqrt(np.mean(impacts.relative_velocity[late] ** 2)),
        "impact_speed": np.max(np.abs(impacts.relative_velocity)),
        "friction_heat": 0.1 * np.mean(speed),
    }
    chunk = Chunk((), tuple(wanted), None, 5.0)
    assert {name: _value(name, chunk, response) for name in wanted} == pytest.approx(wanted)


def test_a_variable_that_is_fixed_alone_is_not_free() -> None:
    space = design_space("impact", fixed={"friction_limit": 0.0})
    assert "friction_limit" not in {variable.name for variable in space.free}
    assert space.default.values["friction_limit"] == 0.0
