"""A whole search from Python, on a steel strip: judged on fresh members, with more modes, and told in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("optuna")
pytest.importorskip("cmaes")

from impact_env.ensemble import Threads
from impact_env.parameters import Beam
from optimisation.designs import design_space
from optimisation.insight import SHOWN
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.report.design_tables import summary, text
from optimisation.search.find import Bars, Plan, find
from optimisation.search.judge import AUDIT, CHOICE, VERDICT, more_modes
from optimisation.search.result import Findings
from studies.rule import STRUCTURES

STEEL = replace(STRUCTURES["steel"], modes=2, damping_ratio=0.005)


@pytest.fixture(scope="module")
def findings(tmp_path_factory: pytest.TempPathFactory) -> Findings:
    problem = Problem(design_space("impact"), (Condition(1, 0.5),), beam=STEEL, members=4, rate=40.0)
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


def test_text_and_summary_say_it(findings: Findings) -> None:
    told, content = text(findings), summary(findings)
    for part in ("over the rule's design", "95 % bootstrap intervals", "winner with 4 modes", "(paper 0.001, rule", "too fast to tell the share"):
        assert part in told, told
    (condition,) = content["conditions"]
    assert condition["winner"]["share_of_possible_reduction"] is None
    assert condition["sweep_over_stationary_level"] < 0.95
    assert set(content["winner_over_rule"]) == {"ratio", "95_percent"}
    edge = findings.problem.space.at([0.0, 0.5, 0.5])
    at_edge = replace(findings, verdict=replace(findings.verdict, winner=replace(findings.verdict.winner, design=edge)))
    assert "the winner lies at a bound: gap at its lower bound of 0.1 of the rule's gap" in text(at_edge)


def test_branches_of_a_winner_are_told(findings: Findings) -> None:
    without = float(np.median(findings.verdict.winner.without))
    levels = without * np.repeat([0.14, 0.19], 4)[:, None]
    winner, paper = replace(findings.verdict.winner, levels=levels), replace(findings.verdict.paper, levels=0 * levels + without)
    told = text(replace(findings, verdict=replace(findings.verdict, winner=winner, paper=paper)))
    assert "winner has two branches: 14.0 % (50 % of the members) and 19.0 % (50 % of the members)" in told


def test_search_is_quiet_by_default_and_tells_its_bars_if_asked() -> None:
    problem = Problem(design_space("friction"), (Condition(1, 0.5),), beam=STEEL, members=2, rate=40.0)
    labels: list[str] = []
    found = find(problem, Plan(6))
    assert found.verdict.gain.high < 1  # 0.1 N of friction is not this structure's

    def noted(label: str):
        labels.append(label)
        return Bars().runs(label)

    find(problem, Plan(4, modes=False), None, Threads(1), Bars(runs=noted))
    assert labels == ["friction: search", "friction: judging on fresh members"]
