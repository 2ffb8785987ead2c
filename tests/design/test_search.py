"""Searches: what they find, how they judge it, on formulas in the place of runs and on a steel strip."""

import importlib.util
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import done
from core import STEEL
from design_studies import BATCH, Model, problem, settings
from scipy.stats import norm

from impact_env.ensemble import Threads
from impact_env.parameters import Beam
from optimisation.designs import design_space
from optimisation.files import read_json
from optimisation.insight import SHOWN
from optimisation.objectives import Condition, Constraint
from optimisation.problem import Problem
from optimisation.search.find import Plan, find, smooth_search
from optimisation.search.judge import AUDIT, CHOICE, VERDICT, Findings, audit, more_modes, verdict
from optimisation.search.noisy import NOISY, best_width, fitted, kernel_quantile, noisy_search
from optimisation.search.settings import (
    Rung,
    SearchSettings,
    default_settings,
    hypervolume,
    nondominated,
)
from optimisation.search.study import DesignStudy
from optimisation.tuned import HIGH, LOW, minimax
from studies.cli import search_methods

pytest.importorskip("optuna")
pytest.importorskip("cmaes")


DESIGNS = 3 * BATCH + 1


def test_only_the_best_share_climbs_and_the_others_are_told_as_worse() -> None:
    rungs = (Rung(1, 2.0, 0.5), Rung(2, 1.0, 0.5), Rung(4))
    model = Model()
    study = DesignStudy(problem(), settings(rungs=rungs))
    study.run(BATCH + 1, model)
    reached = Counter(e.rungs for e in study.told)
    assert reached == {1: 2, 2: 1, 3: 2}  # of 5 designs 3 go on, then 2
    values = {
        e.number: trial.value
        for e, trial in zip(study.told, study._study.get_trials(), strict=True)
    }
    by_rung = {r: [values[e.number] for e in study.told if e.rungs == r] for r in reached}
    assert max(by_rung[3]) <= min(by_rung[2])
    assert max(by_rung[2]) <= min(by_rung[1])
    assert all(e.rungs == 3 for e in study.complete)
    assert study.runs == 2 * 2 * (
        5 * 1 + 3 * 2 + 2 * 2
    )  # conditions, directions; the last rung adds two members to the two it has


def test_searches_find_the_bottom_of_a_bowl() -> None:
    one = problem(conditions=(Condition(1, 3.5),))
    for sampler in ("cma", "random"):
        study = DesignStudy(one, SearchSettings(sampler, 8, (Rung(4),)))
        study.run(240, Model())
        best = min(study.complete, key=lambda e: e.score.values[0])
        off = np.hypot(
            np.log(best.design.values["gap"] / 6e-4), best.design.values["restitution"] - 0.5
        )
        assert off < (0.02 if sampler == "cma" else 0.3)


@pytest.mark.skipif(
    importlib.util.find_spec("torch") is None, reason="the Gaussian process needs torch"
)
def test_gaussian_process_needs_few_designs() -> None:
    study = DesignStudy(
        problem(conditions=(Condition(1, 3.5),), members=1), SearchSettings("gp", 4, (Rung(1),), 1)
    )
    study.run(17, Model())
    best = min(study.complete, key=lambda e: e.score.values[0]).design.values
    assert np.hypot(np.log(best["gap"] / 6e-4), best["restitution"] - 0.5) < 0.15


def test_broken_constraints_cannot_win() -> None:
    limited = problem(
        space=design_space("impact", ["gap", "mass_ratio"]),
        constraints=(Constraint("mass_ratio", 0.01),),
    )
    study = DesignStudy(limited, settings())
    study.run(6 * BATCH + 1, Model())
    assert 0 < len(study.complete) < len(study.told)
    assert all(e.design.values["mass_ratio"] <= 0.01 for e in study.complete)
    told = {t.number: t for t in study._study.get_trials()}
    broken = [e for e in study.told if not e.score.feasible]
    assert min(told[e.number].value for e in broken) > max(
        told[e.number].value for e in study.complete
    )
    assert all(told[e.number].system_attrs["constraints:mass_ratio"] > 0 for e in broken)


def test_winner_is_chosen_and_judged_on_members_that_the_search_has_not_seen() -> None:
    model = Model()
    study = DesignStudy(problem(), settings())
    study.run(DESIGNS, model)
    searched = {run[3] for run in model.seen}
    judge = Model()
    found = verdict(study.problem, study.complete, judge, finalists=2)
    assert not searched & {run[3] for run in judge.seen}
    assert found.winner.members.shape == (1, 4)
    assert found.gain.low <= found.gain.ratio <= found.gain.high
    assert found.gain.ratio == pytest.approx(
        np.median(found.winner.members) / np.median(found.paper.members)
    )
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


@pytest.mark.parametrize("order", [1, -1])
def test_an_audit_counts_the_designs_that_were_left_behind_wrongly(order: int) -> None:
    """Run in full, designs are as good as the search thought, or in the opposite order: then each of them beats the best one found."""
    study = DesignStudy(problem(), settings())
    study.run(8 * BATCH + 1, Model())

    class Judge(Model):
        def value(self, chunk, lane):
            level = super().value(chunk, lane)
            return level if order > 0 else 1e-9 / level

    found = audit(study, Judge(), designs=8)
    assert found.designs == 8
    assert found.missed == (0 if order > 0 else 8)
    assert order * found.rank_correlation > 0.8


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
    """``scripts/run pareto --random-seeds 5`` shows it with the simulator."""
    for seed in range(2):
        volumes = []
        for sampler in ("nsga2", "random"):
            study = DesignStudy(
                problem(2, members=1), SearchSettings(sampler, 10, (Rung(1),), seed)
            )
            assert study.run(80, Model())
            volumes.append(
                hypervolume(1e3 * np.array([e.score.values for e in study.told]), (200.0, 200.0))
            )
        assert volumes[0] > volumes[1] > 0, f"seed {seed}: {volumes}"


def test_friction_damper_optimum_follows_the_energy_argument() -> None:
    """At a tip amplitude q the loss 4 muN sqrt(q^2 - (4 muN/(pi m w^2))^2) is largest where 4 muN/pi = m w^2 q/sqrt(2)."""
    space = design_space("friction", bounds={"friction_limit": (0.1, 2.0)})
    damped = Problem(space, (Condition(1, 3.5),), beam=Beam(modes=1), members=1, rate=10.0)
    best = min(
        smooth_search(damped, 50, Threads(), from_scratch=True)[0], key=lambda e: e.score.values[0]
    )
    scene = best.design.scene(damped.beam)
    without = damped.reference(damped.ensemble, damped.rate)[0, 0, :, 0].max()
    q = np.sqrt(2) * best.score.values[0] * without
    omega = 0.97 * scene.model.omega[0]  # the absorber's mass takes part
    assert scene.absorber_mass is not None
    argued = np.pi / 4 * scene.absorber_mass * omega**2 * q / np.sqrt(2)
    assert best.design.values["friction_limit"] == pytest.approx(argued, rel=0.25)


def test_tuned_absorber_is_tuned_as_the_minimax_says() -> None:
    space = design_space("tuned")
    slow = Problem(
        space, (Condition(1, 1.0, (LOW, HIGH)),), beam=Beam(modes=2), members=1, rate=4.0
    )
    found, finished = smooth_search(slow, 80, Threads())
    assert finished
    best = min(found, key=lambda e: e.score.values[0]).design.values
    exact = minimax(slow.model)
    assert best["stiffness"] == pytest.approx(exact.stiffness, rel=0.02)
    assert best["damping"] == pytest.approx(exact.damping, rel=0.2)


def test_default_settings_screen_only_where_it_helps() -> None:
    impact = Problem(design_space("impact"), (Condition(1, 3.5),))
    assert [(r.members, r.speed) for r in default_settings(impact).rungs] == [
        (2, 10.0),
        (2, 1.0),
        (16, 1.0),
    ]
    assert [(r.members, r.speed) for r in default_settings(replace(impact, rate=10.0)).rungs] == [
        (2, 1.0),
        (16, 1.0),
    ]
    assert default_settings(replace(impact, rate=10.0, members=2)).rungs == (Rung(2),)
    assert default_settings(impact, screening=False).rungs == (Rung(16),)
    assert default_settings(impact).whole_batches(2000) == 2001
    assert default_settings(problem(2)).sampler == "nsga2"


# A whole search from Python, on a steel strip: judged on fresh members, with more modes, and told in words.


STRIP = replace(STEEL, modes=2, damping_ratio=0.005)


@pytest.fixture(scope="module")
def findings(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    problem = Problem(
        design_space("impact"), (Condition(1, 0.5),), beam=STRIP, members=4, rate=40.0
    )
    return find(
        problem,
        Plan(9, "cma", batch=4, from_scratch=True),
        tmp_path_factory.mktemp("find") / "a.journal",
        Threads(),
    )


def test_what_is_reported_is_the_verdicts_own(findings: Findings) -> None:
    found = findings.verdict
    problem = findings.problem
    assert found.rule.design.values["gap"] == problem.units.gap(0.02)
    fresh = problem.fresh_ensemble(4, VERDICT)
    np.testing.assert_array_equal(
        found.winner.without, problem.reference(fresh, problem.rate)[..., 0].max(axis=2)
    )
    assert findings.own.median[0, 0] == np.median(found.winner.levels[:, 0])
    assert found.gain.ratio == pytest.approx(
        np.median(found.winner.members[0]) / np.median(found.paper.members[0])
    )
    sets = [
        set(problem.fresh_ensemble(4, which).phases) for which in (CHOICE, VERDICT, SHOWN, AUDIT)
    ]
    assert len(set.union(*sets)) == 16
    assert not set.union(*sets) & set(problem.ensemble.phases)


def test_winner_runs_with_more_modes(findings: Findings) -> None:
    found = findings.verdict
    wider = findings.wider
    assert wider.modes == 4
    assert wider.judged.design == found.winner.design
    assert wider.change.ratio == pytest.approx(
        np.median(wider.judged.members[0]) / np.median(found.winner.members[0])
    )
    all_modes = replace(findings.problem, beam=Beam(modes=8, elements=4))
    assert more_modes(all_modes, found.winner, 0.5, Threads()) is None


# Searches that model the noise, and the study that compares them.


class Noisy(Model):
    """The formula of the tests' studies, with one in five members on an upper branch."""

    def each(self, function, chunks, kinds):
        for k, values in super().each(function, chunks, kinds):
            phase = chunks[k].lanes[0].drive.phase
            yield k, values * np.exp(0.3 * (np.sin(1e5 * phase) > 0.8) + 0.05 * np.sin(3e5 * phase))


def off(design: object) -> float:
    values = design.values
    return float(np.hypot(np.log(values["gap"] / 6e-4), values["restitution"] - 0.5))


@pytest.mark.parametrize("method", NOISY)
def test_noise_does_not_hide_the_bottom_of_a_bowl(method: str) -> None:
    one = problem(conditions=(Condition(1, 3.5),), members=16)
    told, finished = noisy_search(one, method, 120, Noisy(), from_scratch=True)
    assert finished
    assert off(told[0].design) < 0.3
    found = find(one, Plan(22, method, from_scratch=True, audit=0, modes=False), None, Noisy())
    assert off(found.verdict.winner.design) < 0.3
    assert found.cost.runs == pytest.approx(
        2 * default_settings(one).members_a_design * 22, abs=2 * 8
    )


def test_kernel_quantile_is_the_quantile_of_a_normal_around_a_slope() -> None:
    generator = np.random.default_rng(0)
    x = generator.random((4000, 1))
    y = 2 * x[:, 0] + 0.3 * generator.normal(size=4000)
    for quantile in (0.5, 0.9):
        found = kernel_quantile(np.array([[0.5]]), x, y, 0.05, quantile)[0]
        assert found == pytest.approx(1 + 0.3 * norm.ppf(quantile), abs=0.06)
    assert best_width(x[:400], y[:400], 0.5) < 0.2
    flat = generator.normal(size=400)
    assert best_width(x[:400], flat, 0.5) > best_width(
        x[:400], 10 * np.sin(20 * x[:400, 0]) + flat, 0.5
    )


def test_process_knows_noise_and_slope() -> None:
    generator = np.random.default_rng(1)
    x = generator.random((60, 2))
    truth = np.sin(3 * x[:, 0])
    rows = truth[:, None] + 0.2 * generator.normal(size=(60, 4))
    rows[::2, 2:] = np.nan
    process = fitted(x, rows)
    assert np.exp(process.logs[-1]) == pytest.approx(0.2, rel=0.2)
    assert process.logs[1] > process.logs[0]  # the second coordinate does nothing
    points = generator.random((200, 2))
    mean, spread = process.predict(points)
    errors = (mean - np.sin(3 * points[:, 0])) / np.sqrt(np.diag(spread))
    assert np.sqrt(np.mean((mean - np.sin(3 * points[:, 0])) ** 2)) < 0.1
    assert np.mean(np.abs(errors) < 2) > 0.85


def test_comparison_runs_goes_on_and_writes_its_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beam, conditions = search_methods.QUESTIONS["steel, second"]
    monkeypatch.setitem(
        search_methods.QUESTIONS, "steel, second", (replace(beam, modes=2), conditions)
    )
    monkeypatch.setattr(
        search_methods, "QUICK", {"designs": 10, "members": 2, "seeds": 1, "speed": 100.0}
    )
    done(search_methods, *["--quick", "--question", "steel, second", "--out", str(tmp_path)])
    content = read_json(tmp_path / "search_methods.json.gz")
    assert [t["method"] for t in content["rows"]] == list(search_methods.METHODS)
    assert all(0 < t["level"] < 1.1 and len(t["members"]) == 2 for t in content["rows"])
    assert "Least mean rank" in (tmp_path / "search_methods.md").read_text()
