import importlib.util
import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from core import STEEL
from design_studies import BATCH, Model, problem, settings

from impact_env import ParameterError
from impact_env.ensemble import Threads
from impact_env.parameters import Beam
from optimisation.designs import design_space
from optimisation.insight import SHOWN
from optimisation.objectives import Condition, Constraint
from optimisation.problem import Problem
from optimisation.search.find import Plan, find, smooth_search
from optimisation.search.judge import AUDIT, CHOICE, VERDICT, Findings, audit, more_modes, verdict
from optimisation.search.settings import Rung, Settings, default_settings, hypervolume, nondominated
from optimisation.search.study import opened
from optimisation.tuned import HIGH, LOW, minimax

pytest.importorskip("optuna")
pytest.importorskip("cmaes")


DESIGNS = 3 * BATCH + 1


def test_only_the_best_share_climbs_and_the_others_are_told_as_worse() -> None:
    rungs = (Rung(1, 2.0, 0.5), Rung(2, 1.0, 0.5), Rung(4))
    model = Model()
    with opened(problem(), settings(rungs=rungs)) as study:
        study.run(BATCH + 1, model)
        reached = Counter(e.rungs for e in study.told)
        assert reached == {1: 2, 2: 1, 3: 2}  # of 5 designs 3 go on, then 2
        values = {e.number: trial.value for e, trial in zip(study.told, study._study.get_trials(), strict=True)}
        by_rung = {r: [values[e.number] for e in study.told if e.rungs == r] for r in reached}
        assert max(by_rung[3]) <= min(by_rung[2])
        assert max(by_rung[2]) <= min(by_rung[1])
        assert all(e.rungs == 3 for e in study.complete)
        assert study.runs == 2 * 2 * (5 * 1 + 3 * 2 + 2 * 2)  # conditions, directions; the last rung adds two members to the two it has


def test_searches_find_the_bottom_of_a_bowl() -> None:
    one = problem(conditions=(Condition(1, 3.5),))
    for sampler in ("cma", "random"):
        with opened(one, Settings(sampler, 8, (Rung(4),))) as study:
            study.run(240, Model())
            best = min(study.complete, key=lambda e: e.score.values[0])
            off = np.hypot(np.log(best.design.values["gap"] / 6e-4), best.design.values["restitution"] - 0.5)
            assert off < (0.02 if sampler == "cma" else 0.3)


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="the Gaussian process needs torch")
def test_gaussian_process_needs_few_designs() -> None:
    """Seventeen designs: the model knows the bowl, a random search of the same budget does not."""
    one = problem(conditions=(Condition(1, 3.5),), members=1)
    off = {}
    for sampler in ("gp", "random"):
        with opened(one, Settings(sampler, 4, (Rung(1),), 1)) as study:
            study.run(17, Model())
            best = min(study.complete, key=lambda e: e.score.values[0]).design.values
        off[sampler] = np.hypot(np.log(best["gap"] / 6e-4), best["restitution"] - 0.5)
    assert off["gp"] < 0.15
    assert off["gp"] < off["random"]


def test_broken_constraints_cannot_win() -> None:
    limited = problem(space=design_space("impact", ["gap", "mass_ratio"]), constraints=(Constraint("mass_ratio", 0.01),))
    with opened(limited, settings()) as study:
        study.run(6 * BATCH + 1, Model())
        assert 0 < len(study.complete) < len(study.told)
        assert all(e.design.values["mass_ratio"] <= 0.01 for e in study.complete)
        told = {t.number: t for t in study._study.get_trials()}
        broken = [e for e in study.told if not e.score.feasible]
        assert min(told[e.number].value for e in broken) > max(told[e.number].value for e in study.complete)
        assert all(told[e.number].system_attrs["constraints:mass_ratio"] > 0 for e in broken)


def test_failed_runs_cost_a_design_and_not_the_study() -> None:
    class Failing(Model):
        def each(self, function, chunks, kinds):
            for k, values in super().each(function, chunks, kinds):
                yield k, np.full_like(values, np.nan) if self.seen[-1][1] > 0.6 else values

    with opened(problem(), settings()) as study:
        assert study.run(DESIGNS, Failing())
        assert any(e.score.failed for e in study.told)
        assert all(e.design.values["restitution"] <= 0.6 for e in study.complete)


def test_winner_is_chosen_and_judged_on_members_that_the_search_has_not_seen() -> None:
    model = Model()
    with opened(problem(), settings()) as study:
        study.run(DESIGNS, model)
        searched = {run[3] for run in model.seen}
        judge = Model()
        found = verdict(study.problem, study.complete, judge, finalists=2)
        assert not searched & {run[3] for run in judge.seen}
        assert found.winner.members.shape == (1, 4)
        assert found.gain.low <= found.gain.ratio <= found.gain.high
        assert found.gain.ratio == pytest.approx(np.median(found.winner.members) / np.median(found.paper.members))
        assert dict(found.paper.design.values) == dict(study.problem.space.paper.values)
        shown = found.levels(study.problem.conditions)
        assert shown.median[0] == pytest.approx(np.median(found.winner.levels, axis=0))
        checked_on = {run[3] for run in judge.seen}
        audited = Model()
        audit(study, audited, designs=3)
        assert not (searched | checked_on) & {run[3] for run in audited.seen}
        checked = audit(study, Model(), designs=3)
        assert checked.designs == 3
        assert 0 <= checked.missed <= 3
    with pytest.raises(ParameterError, match="candidates"):
        verdict(problem(), [], Model())


def test_fronts_and_their_volume() -> None:
    costs = np.array([[1.0, 3.0], [2.0, 2.0], [2.0, 2.5], [3.0, 1.0], [2.0, 2.0], [5.0, 5.0]])
    np.testing.assert_array_equal(nondominated(costs), [True, True, False, True, True, False])
    assert hypervolume(costs, (4.0, 4.0)) == 3 * 1 + 2 * 1 + 1 * 1
    assert hypervolume(costs[:1], (1.0, 4.0)) == 0
    generator = np.random.default_rng(0)
    points = generator.random((30, 2))
    inside = np.mean([np.any(np.all(points <= x, axis=1)) for x in generator.random((20000, 2))])
    assert hypervolume(points, (1.0, 1.0)) == pytest.approx(inside, abs=0.01)


def test_front_of_a_search_beats_random_search_with_the_same_budget() -> None:
    """In all of five seeds; ``scripts/run pareto --random-seeds 5`` shows it with the simulator."""
    for seed in range(5):
        volumes = []
        for sampler in ("nsga2", "random"):
            with opened(problem(2, members=1), Settings(sampler, 10, (Rung(1),), seed)) as study:
                assert study.run(80, Model())
                volumes.append(hypervolume(1e3 * np.array([e.score.values for e in study.told]), (200.0, 200.0)))
        assert volumes[0] > volumes[1] > 0, f"seed {seed}: {volumes}"


def test_friction_damper_optimum_follows_the_energy_argument() -> None:
    """At a tip amplitude q the loss 4 muN sqrt(q^2 - (4 muN/(pi m w^2))^2) is largest where 4 muN/pi = m w^2 q/sqrt(2)."""
    space = design_space("friction", bounds={"friction_limit": (0.1, 2.0)})
    damped = Problem(space, (Condition(1, 3.5),), beam=Beam(modes=1), members=1, rate=10.0)
    best = min(smooth_search(damped, 50, Threads(), from_scratch=True)[0], key=lambda e: e.score.values[0])
    scene = best.design.scene(damped.beam)
    without = damped.reference(damped.ensemble, damped.rate)[0, 0, :, 0].max()
    q = np.sqrt(2) * best.score.values[0] * without
    omega = 0.97 * scene.model.omega[0]  # the absorber's mass takes part
    assert scene.absorber_mass is not None
    argued = np.pi / 4 * scene.absorber_mass * omega**2 * q / np.sqrt(2)
    assert best.design.values["friction_limit"] == pytest.approx(argued, rel=0.25)


def test_tuned_absorber_is_tuned_as_the_minimax_says() -> None:
    space = design_space("tuned")
    slow = Problem(space, (Condition(1, 1.0, (LOW, HIGH)),), beam=Beam(modes=2), members=1, rate=4.0)
    found, finished = smooth_search(slow, 80, Threads())
    assert finished
    best = min(found, key=lambda e: e.score.values[0]).design.values
    exact = minimax(slow.model)
    assert best["stiffness"] == pytest.approx(exact.stiffness, rel=0.02)
    assert best["damping"] == pytest.approx(exact.damping, rel=0.2)
    with pytest.raises(ParameterError, match="scipy"):
        smooth_search(problem(), 10, Model())


@pytest.mark.parametrize(
    ("make", "names"),
    [
        (lambda: default_settings(problem(), "annealing"), ["sampler = 'annealing'", "cma, nsga2, gp, random"]),
        (lambda: default_settings(problem(2), "cma"), ["sampler = 'cma'", "nsga2"]),
        (lambda: default_settings(problem(space=design_space("impact", ["gap"])), "cma"), ["sampler = 'cma'", "two or more"]),
        (lambda: default_settings(problem(), batch=1), ["batch = 1"]),
        (lambda: Rung(0), ["members of a rung"]),
        (lambda: Rung(1, keep=0.0), ["share kept"]),
        (lambda: Settings("cma", 4, (Rung(4, 2.0),)).check(problem()), ["rungs", "own sweep rate"]),
        (lambda: Settings("cma", 4, (Rung(3),)).check(problem()), ["members of the last rung = 3"]),
        (lambda: Settings("random", 4, (Rung(1), Rung(4))).check(problem(2)), ["rungs", "several objectives"]),
        (lambda: settings().whole_batches(0), ["designs = 0"]),
    ],
)
def test_bad_settings_are_named(make: object, names: list[str]) -> None:
    with pytest.raises(ParameterError) as error:
        make()
    assert all(name in str(error.value) for name in names), error.value


def test_default_settings_screen_only_where_it_helps() -> None:
    impact = Problem(design_space("impact"), (Condition(1, 3.5),))
    assert [(r.members, r.speed) for r in default_settings(impact).rungs] == [(2, 10.0), (2, 1.0), (16, 1.0)]
    assert [(r.members, r.speed) for r in default_settings(replace(impact, rate=10.0)).rungs] == [(2, 1.0), (16, 1.0)]
    assert default_settings(replace(impact, rate=10.0, members=2)).rungs == (Rung(2),)
    assert default_settings(impact, screening=False).rungs == (Rung(16),)
    assert default_settings(impact).whole_batches(2000) == 2001
    assert default_settings(problem(2)).sampler == "nsga2"
    assert json.dumps(default_settings(impact).describe())


# A whole search from Python, on a steel strip: judged on fresh members, with more modes, and told in words.


STRIP = replace(STEEL, modes=2, damping_ratio=0.005)


@pytest.fixture(scope="module")
def findings(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    problem = Problem(design_space("impact"), (Condition(1, 0.5),), beam=STRIP, members=4, rate=40.0)
    return find(problem, Plan(9, "cma", batch=4, from_scratch=True), tmp_path_factory.mktemp("find") / "a.journal", Threads())


def test_what_is_reported_is_the_verdicts_own(findings: Findings) -> None:
    found, problem = findings.verdict, findings.problem
    fresh = problem.fresh_ensemble(4, VERDICT)
    np.testing.assert_array_equal(found.winner.without, problem.reference(fresh, problem.rate)[..., 0].max(axis=2))
    assert findings.own.median[0, 0] == np.median(found.winner.levels[:, 0])
    assert found.gain.ratio == pytest.approx(np.median(found.winner.members[0]) / np.median(found.paper.members[0]))
    sets = [set(problem.fresh_ensemble(4, which).phases) for which in (CHOICE, VERDICT, SHOWN, AUDIT)]
    assert len(set.union(*sets)) == 16
    assert not set.union(*sets) & set(problem.ensemble.phases)


def test_paper_is_the_papers_design_and_the_rule_is_the_structures(findings: Findings) -> None:
    found, problem = findings.verdict, findings.problem
    assert dict(found.paper.design.values) == {"gap": 1e-3, "restitution": 0.7, "friction_limit": 0.1, "mass_ratio": 0.02, "position": 1.0}
    assert found.rule.design.values["gap"] == problem.units.gap(0.02)
    narrow = replace(problem, space=design_space("impact", ["gap"], {"gap": (2e-3, 3e-3)}, {"mass_ratio": 0.01}))
    assert narrow.space.paper.values["gap"] == 1e-3
    assert narrow.space.default.values["gap"] == 2e-3


def test_winner_runs_with_more_modes(findings: Findings) -> None:
    found, wider = findings.verdict, findings.wider
    assert wider.modes == 4
    assert wider.judged.design == found.winner.design
    assert wider.change.ratio == pytest.approx(np.median(wider.judged.members[0]) / np.median(found.winner.members[0]))
    assert not np.array_equal(wider.judged.members, found.winner.members)
    all_modes = replace(findings.problem, beam=Beam(modes=8, elements=4))
    assert more_modes(all_modes, found.winner, 0.5, Threads()) is None
