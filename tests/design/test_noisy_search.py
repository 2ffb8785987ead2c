"""Searches that model the noise, and the study that compares them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.stats import norm

from studies.cli import search_methods

pytest.importorskip("optuna")

from design_studies import Model, problem

from optimisation.files import read_json
from optimisation.objectives import Condition
from optimisation.search.find import Plan, find
from optimisation.search.noisy import NOISY, best_width, fitted, kernel_quantile, noisy_search
from optimisation.search.settings import Rung, Settings, default_settings


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
    assert [e.score.values[0] for e in told] == sorted(e.score.values[0] for e in told)
    assert off(told[0].design) < 0.3
    found = find(one, Plan(22, method, from_scratch=True, audit=0, modes=False), None, Noisy())
    assert off(found.verdict.winner.design) < 0.3
    assert found.cost.runs == pytest.approx(2 * default_settings(one).members_a_design * 22, abs=2 * 8)


def test_a_screened_design_costs_what_its_rungs_run() -> None:
    """Of 40 designs 40 run 2 members ten times as fast, 8 run 2, and 2 of them 14 more: 8 + 16 + 28 members for 40."""
    screened = Settings("cma", 40, (Rung(2, 10.0, 0.2), Rung(2, 1.0, 0.25), Rung(16)))
    assert screened.members_a_design == pytest.approx((8 + 16 + 28) / 40)
    assert Settings("cma", 40, (Rung(16),)).members_a_design == 16


def test_search_follows_from_its_seed_and_keeps_what_an_interrupt_leaves() -> None:
    one = problem(conditions=(Condition(1, 3.5),), members=8)
    first, second, other = (noisy_search(one, "replicated", 40, Noisy(), seed, True)[0] for seed in (0, 0, 1))
    assert [e.design.values for e in first] == [e.design.values for e in second]
    assert [e.design.values for e in first] != [e.design.values for e in other]
    told, finished = noisy_search(one, "replicated", 400, Noisy(stop=60), 0, True)
    assert not finished
    assert told


def test_failed_runs_cost_a_design_and_not_the_search() -> None:
    class Failing(Noisy):
        def each(self, function, chunks, kinds):
            for k, values in super().each(function, chunks, kinds):
                yield k, np.full_like(values, np.nan) if self.seen[-1][1] > 0.6 else values

    one = problem(conditions=(Condition(1, 3.5),), members=4)
    for method in NOISY:
        told, finished = noisy_search(one, method, 60, Failing(), from_scratch=True)
        assert finished
        assert told[0].design.values["restitution"] < 0.65
        assert off(told[0].design) < 0.6


def test_kernel_quantile_is_the_quantile_of_a_normal_around_a_slope() -> None:
    generator = np.random.default_rng(0)
    x = generator.random((4000, 1))
    y = 2 * x[:, 0] + 0.3 * generator.normal(size=4000)
    for quantile in (0.5, 0.9):
        found = kernel_quantile(np.array([[0.5]]), x, y, 0.05, quantile)[0]
        assert found == pytest.approx(1 + 0.3 * norm.ppf(quantile), abs=0.06)
    assert best_width(x[:400], y[:400], 0.5) < 0.2
    flat = generator.normal(size=400)
    assert best_width(x[:400], flat, 0.5) > best_width(x[:400], 10 * np.sin(20 * x[:400, 0]) + flat, 0.5)


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


def test_comparison_runs_goes_on_and_writes_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    beam, conditions = search_methods.QUESTIONS["steel, second"]
    monkeypatch.setitem(search_methods.QUESTIONS, "steel, second", (replace(beam, modes=2), conditions))
    monkeypatch.setattr(search_methods, "QUICK", {"designs": 10, "members": 2, "seeds": 1, "speed": 100.0})
    arguments = ["--quick", "--question", "steel, second", "--out", str(tmp_path)]
    result = CliRunner().invoke(search_methods.main, arguments)
    assert result.exit_code == 0, result.output
    content = read_json(tmp_path / "search_methods.json.gz")
    assert [t["method"] for t in content["trials"]] == list(search_methods.METHODS)
    assert all(0 < t["level"] < 1.1 and len(t["members"]) == 2 for t in content["trials"])
    assert "Least mean rank" in (tmp_path / "search_methods.md").read_text()
    monkeypatch.setattr(search_methods, "trial", lambda *_: pytest.fail("searched again"))
    assert CliRunner().invoke(search_methods.main, arguments).exit_code == 0
