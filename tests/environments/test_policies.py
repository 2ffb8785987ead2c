from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("cmaes")

from impact_env.parameters import ParameterError
from optimisation.cli import (
    evaluate_policies,
    train_sweep_agent,
    tune_baselines,
)
from optimisation.files import read_json
from optimisation.rl.agents import Agent, save_agent
from optimisation.rl.baselines import families, load, policy, store, tune
from optimisation.rl.families import FrequencyWindow, OpenLoop, Rates, policy_of
from optimisation.rl.gap_rules import GapScale
from optimisation.rl.judging import Judged, agents_for, contenders, judge, read_results, summarise, write_results
from optimisation.rl.play import GAP, SWEEP, play
from optimisation.rl.runs import Evaluation, Run, read_learning, typical
from optimisation.rl.tasks import sweep
from optimisation.rl.tasks.baseline import BEST_CONSTANT, BEST_SCHEDULE, Baseline
from optimisation.rl.tasks.effort import QUICK, Effort
from optimisation.rl.tasks.table import task_named
from optimisation.rl.traces import gap_curves, passage_curves
from optimisation.rl.tuning import Search, Tuned, best_of, evolve, mean_scores
from studies.cli import sweep_tradeoff

RUBBING = {"modes": 2, "absorber_options": {"friction_limit": 0.025}}
SWIFT: dict[str, Any] = {"rates": (1.0, 20.0), "time_budget": 400.0}
BRIEF: dict[str, Any] = {"hold": (20.0, 40.0), "time_budget": 100.0} | RUBBING
RATES = Rates(1.0, 20.0, 0.93, 1.03)


def call(command: Any, *arguments: object) -> Result:
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


def observations(ratio: float, lanes: int = 1) -> np.ndarray:
    seen = np.zeros((lanes, 10), dtype=np.float32)
    seen[:, 6] = (ratio - 1) / 0.1
    return seen


def test_rates_and_actions_belong_together() -> None:
    rates = np.array([1.0, 3.0, 20.0])
    np.testing.assert_allclose(RATES.rate(RATES.action(rates)), rates)
    env = gymnasium.make(SWEEP, **SWIFT)
    env.reset(seed=0)
    *_, info = env.step(RATES.action(3.0).astype(np.float32)[None])
    assert (1.03 - info["frequency_ratio"]) * 1e4 / info["time"] == pytest.approx(3.0, rel=1e-6)


def test_a_window_rule_does_what_its_numbers_say() -> None:
    rule = policy_of("rule", FrequencyWindow(RATES), [0.5, 0.3, -0.8, 0.6])  # the edges, in any order: 0.96 and 0.98
    rule.start(1)
    acts = {ratio: float(rule.act(observations(ratio))[0, 0]) for ratio in (0.955, 0.965, 0.975, 0.985)}
    assert acts == pytest.approx({0.955: 0.6, 0.965: -0.8, 0.975: -0.8, 0.985: 0.6})


def test_a_schedule_is_linear_between_its_knots_and_each_lane_has_its_own() -> None:
    schedule = policy_of("schedule", OpenLoop(RATES, 3), np.array([[0.0, 1.0, -1.0], [0.5, 0.5, 3.0]]))
    schedule.start(2)
    np.testing.assert_allclose(schedule.act(observations(0.93, 2))[:, 0], [0.0, 0.5], atol=1e-5)
    np.testing.assert_allclose(schedule.act(observations(0.955, 2))[:, 0], [0.5, 0.5], atol=1e-5)
    np.testing.assert_allclose(schedule.act(observations(1.005, 2))[:, 0], [0.0, 0.75], atol=1e-5)
    np.testing.assert_allclose(schedule.act(observations(1.05, 2))[:, 0], [-1.0, 1.0], atol=1e-5)


def test_the_rule_with_the_true_force_follows_the_force() -> None:
    kinds = families("gap", BRIEF)
    oracle = policy(Baseline("oracle", "true force", (1.0, 0.0)), kinds)
    traces = play(oracle, GAP, [0, 1, 2], BRIEF, ("force", "action")).traces
    scale = kinds["true force"].scale
    assert isinstance(scale, GapScale)
    wanted = scale.low + 0.5 * (traces["action"][1:].astype(float) + 1) * (scale.high - scale.low)
    np.testing.assert_allclose(wanted, np.clip(traces["force"][:-1] / scale.force_per_gap, scale.low, scale.high), rtol=1e-5)
    assert len(np.unique(traces["force"])) > 5
    assert 1e-3 * scale.force_per_gap == pytest.approx(3.49, abs=0.15)  # physics of the first mode: f* of the paper's gap


def test_the_estimated_force_is_exact_where_the_absorber_is_free_or_rattles_as_assumed() -> None:
    rule = families("gap", BRIEF)["estimated force"]
    scale, force, stroke = rule.scale, 2.5, 0.9
    seen = observations(0.98, 2)
    ratio = 1 + 0.1 * seen[:, 6].astype(float)
    by_force, kappa = scale.lines(ratio)
    gap = 1.4e-3
    # lane 0: the absorber stays where it is, r = -q. Lane 1: r opposes the force in the sense of the formula, at any angle with a negative cosine
    r = stroke * gap * np.exp(2.4j) / (kappa / by_force) * np.abs(kappa / by_force)
    q = np.where([True, False], force * by_force, (force * by_force + kappa * r) / (1 - kappa))
    seen[:, 0], seen[:, 1], seen[:, 9] = q.real / scale.length, -q.imag / scale.length, gap / scale.length
    seen[1, 4] = 1.0
    np.testing.assert_allclose(rule.estimate(np.full(2, stroke), seen), force, rtol=1e-5)


def test_without_an_absorber_that_moves_the_force_is_read_off_the_steady_response() -> None:
    """A gap too wide to be reached: after the transient the estimate is the force, but for an interval that is no whole number of its periods."""
    options = {"modes": 2, "absorber_options": {"gap": 1.0}, "gap_limits": (0.9, 1.0), "hold": (300.0, 300.0), "time_budget": 300.0, "force": 2.0}
    family = families("gap", options)["estimated force"]
    play(policy_of("estimate", family, [1.0, 0.0, 1.0, 0.0]), GAP, [3], options)
    assert family.force[0] == pytest.approx(2.0, rel=0.05)


def test_candidates_are_scored_as_if_each_played_alone() -> None:
    kinds = families("sweep", SWIFT)
    candidates = np.array([[-0.5], [0.3], [1.0]])
    together = mean_scores(kinds["constant"], candidates, SWEEP, range(4), SWIFT)
    alone = [play(policy_of("one", kinds["constant"], row), SWEEP, range(4), SWIFT).scores.mean() for row in candidates]
    np.testing.assert_array_equal(together, alone)
    assert best_of(kinds["constant"], candidates, SWEEP, range(4), SWIFT).parameters == (candidates[int(np.argmax(alone)), 0],)


def test_a_searched_schedule_beats_the_constant_it_starts_from() -> None:
    schedule, constant = OpenLoop(Rates.of(_task(SWIFT)), 5), families("sweep", SWIFT)["constant"]
    seeds, counted = range(12), []
    search = Search(generations=6, population=8, finalists=4)
    found = evolve(schedule, [[-0.5] * 5], np.array([(-1.0, 1.0)] * 5), SWEEP, seeds, SWIFT, search, counted.append)
    before = mean_scores(constant, np.array([[-0.5]]), SWEEP, seeds[4:], SWIFT)[0]
    assert found.score > before + 0.02
    assert found.score == mean_scores(schedule, np.array([found.parameters]), SWEEP, seeds[4:], SWIFT)[0]
    assert sum(counted) == 48
    assert found.candidates == 48 + 6


def _task(arguments: dict[str, Any]) -> Any:
    return gymnasium.make(SWEEP, **arguments).unwrapped.task


def agent(env_id: str, seed: int, arguments: dict[str, Any], action: float) -> Agent:
    layers = [(np.zeros((1, 10), np.float32), np.array([action], np.float32))]
    return Agent(env_id, "ppo", seed, 10, arguments, "tanh", "clip", layers)


def test_results_come_back_from_their_file_and_are_summarised(tmp_path: Path) -> None:
    kinds = families("sweep", SWIFT)
    rules = [policy(Baseline(name, "constant", (value,)), kinds) for name, value in ((BEST_CONSTANT, 0.0), (BEST_SCHEDULE, 1.0))]
    agents = [agent(SWEEP, seed, SWIFT, 1.0) for seed in (4, 5)]
    results = [judge("sweep", contender, range(50, 56), SWIFT) for contender in contenders(rules, agents)]
    assert [(r.name, r.runs, r.scores.shape) for r in results] == [
        (BEST_CONSTANT, (-1,), (1, 6)),
        (BEST_SCHEDULE, (-1,), (1, 6)),
        ("PPO", (4, 5), (2, 6)),
    ]
    write_results(tmp_path / "r.npz", results)
    for before, after in zip(results, read_results(tmp_path / "r.npz"), strict=True):
        assert (before.name, before.kind, before.runs, before.seeds) == (after.name, after.kind, after.runs, after.seeds)
        np.testing.assert_array_equal([before.scores, before.levels, before.times], [after.scores, after.levels, after.times])
    lines = {line.name: line for line in summarise("sweep", results, resamples=50)}
    assert lines["PPO"].normalised.value == pytest.approx(1.0)
    assert lines[BEST_SCHEDULE].normalised.value == pytest.approx(1.0)
    assert lines[BEST_CONSTANT].normalised.value == pytest.approx(0.0)
    assert lines["PPO"].improvement.value == 0.5
    assert lines["PPO"].mean.low <= lines["PPO"].mean.value <= lines["PPO"].mean.high


def test_the_command_judges_tells_and_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep, "KNOTS", 3)
    effort = Effort(seeds=3, windows=False, grid=2, rule=Search(1, 4, 0.4, 1), schedule=Search(1, 4, 0.4, 1), fit=Search(1, 4, 0.4, 1))
    for task, arguments in (("sweep", SWIFT), ("gap", BRIEF)):
        counted: list[int] = []
        store(tmp_path / f"{task}_baselines.json", task, arguments, effort, tune(task, arguments, effort, counted.append))
        assert 0 < sum(counted) <= task_named(task).tried(effort)
        (tmp_path / f"{task}-1").mkdir()
        save_agent(tmp_path / f"{task}-1" / "final.npz", agent(task_named(task).env_id, 1, arguments, 0.5))
    options = ("--baselines", tmp_path, "--agents", tmp_path, "--out", tmp_path / "out", "--quick", "--seeds", 3)
    result = call(evaluate_policies.main, *options)
    assert result.exit_code == 0, result.output
    files = {f"{task}_{kind}" for task in ("sweep", "gap") for kind in ("results.npz", "table.json", "curves.json.gz", "profile.png")}
    assert {file.name for file in (tmp_path / "out").iterdir()} == files | {"sweep_schedules.png", "gap_episode.png"}
    told = json.loads((tmp_path / "out" / "sweep_table.json").read_text())
    assert {row["name"] for row in told["policies"]} >= {"random", BEST_CONSTANT, BEST_SCHEDULE, "PPO"}
    again = call(evaluate_policies.main, "--redraw", "--quick", "--out", tmp_path / "out")
    assert again.exit_code == 0, again.output
    assert again.output == result.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--task", "sweep", "--policy", "nobody"), "--policy = 'nobody' is not allowed: one of random;"),
        (("--task", "sweep", "--agents", "{here}/none"), "a folder with agents for ImpactAbsorber/SweepRate-v0"),
        (("--task", "sweep", "--agents", "{here}/gap.npz"), "an agent for ImpactAbsorber/SweepRate-v0, not for ImpactAbsorber/GapChoice-v0"),
        (("--task", "sweep", "--agents", "{here}/other.npz"), "arguments of PPO, seed 0"),
        (("--agents", str(evaluate_policies.KEPT), "--out", str(evaluate_policies.POLICIES)), "a folder with all agents that the page tells of"),
        (
            (
                "--task",
                "gap",
            ),
            "gap_baselines.json",
        ),
        (
            (
                "--task",
                "sweep",
                "--redraw",
            ),
            "sweep_results.npz",
        ),
    ],
)
def test_bad_options_are_named(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    store(tmp_path / "sweep_baselines.json", "sweep", SWIFT, QUICK, [Baseline("random", "random", ()), Baseline("one", "constant", (0.0,))])
    save_agent(tmp_path / "gap.npz", agent(GAP, 0, {}, 0.0))
    save_agent(tmp_path / "other.npz", agent(SWEEP, 0, {"force": 9.0}, 0.0))
    given = [text.format(here=tmp_path) for text in arguments]
    out = [] if "--out" in given else ["--out", tmp_path / "out"]
    result = call(evaluate_policies.main, "--baselines", tmp_path, *out, *given)
    assert result.exit_code == 2
    assert words in " ".join(result.output.split())


def test_stored_baselines_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "b.json"
    store(path, "sweep", SWIFT, QUICK, [Baseline("one", "constant", (0.25,))])
    assert load(path, "sweep") == ([Baseline("one", "constant", (0.25,))], {key: list(v) if isinstance(v, tuple) else v for key, v in SWIFT.items()})
    with pytest.raises(ParameterError, match="of the task gap, not of sweep"):
        load(path, "gap")
    path.write_text(path.read_text()[:40])
    with pytest.raises(ParameterError, match="a whole file"):
        load(path, "sweep")
    with pytest.raises(ParameterError, match="kind = 'magic'"):
        policy(Baseline("x", "magic", ()), families("sweep", SWIFT))
    with pytest.raises(ParameterError, match="parameters of x"):
        policy(Baseline("x", "constant", (0.0, 1.0)), families("sweep", SWIFT))
    with pytest.raises(ParameterError, match="task = 'swim'"):
        families("swim", {})


def test_curves_show_the_rates_that_were_driven_and_the_force_that_acted() -> None:
    kinds = families("sweep", SWIFT)
    shown = passage_curves({"fast": [policy(Baseline("fast", "constant", (1.0,)), kinds)]}, range(3), SWIFT)
    np.testing.assert_allclose(np.array(shown["policies"]["fast"]["rate"]), 20.0)
    kinds = families("gap", BRIEF)
    curves = gap_curves({"fixed": policy(Baseline("fixed", "constant", (0.0,)), kinds)}, 4, BRIEF)
    assert np.allclose(curves["policies"]["fixed"]["gap"], 1.55e-3)
    assert len(set(curves["force"])) > 1


def test_tradeoff_study_and_tuning_write_what_they_measure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep_tradeoff, "QUICK_RATES", np.array([4.0, 8.0]))
    monkeypatch.setattr(sweep_tradeoff, "QUICK_SEEDS", 2)
    monkeypatch.setattr(sweep_tradeoff, "SLOW", (2.0,))
    result = call(sweep_tradeoff.main, "--quick", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    told = read_json(tmp_path / "sweep_tradeoff.json.gz")
    down = told["cases"][0]["directions"]["down"]
    np.testing.assert_allclose(down["time"], [250.0, 125.0])
    again = call(sweep_tradeoff.main, "--redraw", "--quick", "--out", tmp_path)
    assert again.output.split("\n\nwritten")[0] == result.output.split("\n\nwritten")[0]
    assert (tmp_path / "sweep_tradeoff.png").exists()
    scaled = Effort().scaled(0.5, 10)
    assert (scaled.seeds, scaled.rule.generations, scaled.schedule.generations) == (10, 6, 20)
    assert call(tune_baselines.main, "--effort", 0).exit_code == 2


def test_the_better_of_two_schedules_is_the_best() -> None:
    worse, better = Tuned((0.0,) * 4, -0.6, 1), Tuned((1.0,) * 21, -0.5, 1)
    assert [(b.name, b.kind) for b in sweep.schedules(worse, better)] == [("rule over the frequency", "window"), (BEST_SCHEDULE, "open loop")]
    assert [(b.name, b.kind) for b in sweep.schedules(better, worse)] == [(BEST_SCHEDULE, "window"), ("schedule by knots", "open loop")]


def test_agents_are_found_by_task(tmp_path: Path) -> None:
    for name, env_id, seed in (("a", SWEEP, 2), ("b", SWEEP, 1), ("c", GAP, 3)):
        (tmp_path / name).mkdir()
        save_agent(tmp_path / name / "final.npz", agent(env_id, seed, {}, 0.0))
    assert [found.seed for found in agents_for("sweep", tmp_path, {})] == [1, 2]
    assert [found.seed for found in agents_for("gap", tmp_path, {})] == [3]


def test_judged_arrays_are_runs_by_seeds() -> None:
    result = judge("gap", contenders([], [agent(GAP, 1, BRIEF, 0.0), agent(GAP, 2, BRIEF, 0.9)])[0], [7, 8], BRIEF)
    assert isinstance(result, Judged)
    assert result.scores.shape == result.levels.shape == (2, 2)
    np.testing.assert_array_equal(result.levels, -result.scores)
    assert np.all(result.times == 100.0)


def test_learning_curves_are_drawn_again_from_their_table(tmp_path: Path) -> None:
    written = {name: (evaluate_policies.KEPT / name).read_bytes() for name in ("learning_gap.csv", "learning_gap.json")}
    for name, content in written.items():
        (tmp_path / name).write_bytes(content)
    result = call(train_sweep_agent.main, "--task", "gap", "--redraw", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert {name: (tmp_path / name).read_bytes() for name in written} == written
    assert (tmp_path / "learning_gap.png").read_bytes().startswith(b"\x89PNG")
    runs = read_learning(tmp_path / "learning_gap.csv")
    assert [(run.algorithm, run.seed) for run in runs] == [(name, seed) for name in ("ppo", "sac") for seed in range(10)]
    (tmp_path / "learning_gap.csv").write_text("algorithm,seed\nppo,0\n")
    assert call(train_sweep_agent.main, "--task", "gap", "--redraw", "--out", tmp_path).exit_code == 2


@pytest.mark.parametrize(("last", "seed"), [((0.1,), 0), ((0.1, 0.2), 1), ((0.3, 0.1, 0.2), 2), ((0.4, 0.3, 0.2, 0.1), 1)])
def test_the_agent_that_is_kept_is_in_the_middle_at_its_end(last: tuple[float, ...], seed: int) -> None:
    runs = [Run(Path(), {"seed": k}, tuple(Evaluation(0, 0, score, 0, 0, 0, 0) for score in (1.0, end)), True) for k, end in enumerate(last)]
    assert typical(runs).seed == seed
