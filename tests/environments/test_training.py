import inspect
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
from click.testing import CliRunner, Result
from environment_cases import GAP1 as GAP
from environment_cases import HARD
from environment_cases import V1 as SWEEP
from places import ROOT

pytest.importorskip("stable_baselines3")

import torch
import yaml
from stable_baselines3 import PPO, SAC

from impact_env.parameters import ParameterError
from optimisation.cli import train as command
from optimisation.rl.agents import Agent, actor_of, find_agents, load_agent, save_agent
from optimisation.rl.checkpoints import checkpoints
from optimisation.rl.hyperparameters import PACKAGED, PPOSettings, SACSettings, read, settings_for
from optimisation.rl.models import begin_leg, make_lanes, make_model
from optimisation.rl.runs import find_runs, read_evaluations
from optimisation.rl.training import Job, train

# a gap task of 20 intervals, and a passage that is cut off after 4: the same kernels as those of other tests of the environments
SHORT: dict[str, dict[str, Any]] = {
    GAP: {"modes": 2, "absorber_options": {"friction_limit": 0.025}, "time_budget": 100.0, "hold": [20.0, 40.0], "force": [0.5, 6.0]},
    SWEEP: {"modes": 2, "absorber_options": {"friction_limit": 0.025}, "limits": [0.96, 0.98], "rates": [2.0, 20.0], "time_budget": 60.0},
}
SMALL: dict[str, dict[str, Any]] = {
    "ppo": {"steps": 900, "legs": 3, "lanes": 8, "n_steps": 16, "batch_size": 64, "n_epochs": 2},
    "sac": {"steps": 600, "legs": 3, "lanes": 8, "batch_size": 32, "buffer_size": 400, "learning_starts": 100, "gradient_steps": 1},
}


def small_job(algorithm: str, env_id: str = GAP, **changes: Any) -> Job:
    return Job(env_id, algorithm, 3, settings_for(env_id, algorithm, **{**SMALL[algorithm], **changes}), SHORT[env_id], episodes=8)


ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}


def started(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "optimisation.cli.group", "train", *map(str, arguments)]
    return subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def finished(process: subprocess.Popen[str]) -> str:
    output = process.communicate(timeout=240)[0]
    assert process.returncode == 0
    return output


def call(*arguments: object) -> Result:
    return CliRunner().invoke(command.main, [str(argument) for argument in arguments])


class Interrupt:
    """Presses Ctrl-C after some calls."""

    def __init__(self, after: int) -> None:
        self.left = after

    def __call__(self, *_progress: object) -> None:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


LASTING: dict[str, Any] = {"use_sde": True, "sde_sample_freq": 3}


@pytest.mark.parametrize(
    ("algorithm", "after", "changes"), [("ppo", 60, {}), ("sac", 32, {}), ("ppo", 60, LASTING), ("sac", 32, LASTING | {"train_freq": 5})]
)
def test_interrupted_training_equals_one_that_never_stopped(tmp_path: Path, algorithm: str, after: int, changes: dict[str, Any]) -> None:
    job = small_job(algorithm, **changes)
    whole = train(job, tmp_path / "whole")
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train(job, tmp_path / "broken", Interrupt(after))
        assert 0 < len(read_evaluations(tmp_path / "broken")) < 3
    assert train(job, tmp_path / "broken") == whole
    for name in ("evaluations.csv", "final.npz"):
        assert (tmp_path / "broken" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert [folder.name for folder in checkpoints(tmp_path / "whole" / "checkpoints")] == ["leg-001", "leg-002"]
    assert not list(tmp_path.rglob("replay.npz"))


def test_damaged_checkpoint_costs_one_leg(tmp_path: Path) -> None:
    job = small_job("ppo")
    with pytest.raises(KeyboardInterrupt):
        train(job, tmp_path, Interrupt(110))
    first, last = checkpoints(tmp_path / "checkpoints")
    content = (last / "model.zip").read_bytes()
    (last / "model.zip").write_bytes(content[: len(content) // 2])
    legs: list[int] = []
    evaluations = train(job, tmp_path, lambda _steps, done: legs.append(len(done)))
    assert first.name == "leg-000"
    assert legs[0] == 1  # not 2, which the damaged one had reached
    assert len(evaluations) == 3


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (lambda job: replace(job, hyperparameters=replace(job.hyperparameters, gamma=0.5)), "hyperparameters.gamma is 0.98 there and 0.5 here"),
        (lambda job: replace(job, seed=4), "seed is 3 there and 4 here"),
        (lambda job: replace(job, arguments={**job.arguments, "interval": 10.0}), "environment_arguments.interval is 5.0 there and 10.0 here"),
        (lambda job: replace(job, episodes=9), "evaluation.episodes is 8 there and 9 here"),
    ],
)
def test_folder_of_other_settings_is_refused(tmp_path_factory: pytest.TempPathFactory, changed: Any, words: str) -> None:
    folder, job = tmp_path_factory.getbasetemp() / "refusing", small_job("ppo", steps=128, legs=1, gamma=0.98)
    train(job, folder)
    before = (folder / "settings.json").read_bytes()
    with pytest.raises(ParameterError, match="other settings") as error:
        train(changed(job), folder)
    assert words in str(error.value)
    assert (folder / "settings.json").read_bytes() == before


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_agent_acts_as_its_model(tmp_path: Path, algorithm: str) -> None:
    job = small_job(algorithm)
    env = make_lanes(job.env_id, job.hyperparameters, job.arguments, 1)
    model = make_model(job.hyperparameters, env, 0)
    begin_leg(model, 0, 0, 1e-2)
    model.learn(400)
    agent = actor_of(model, job.env_id, 0, job.arguments)
    file = tmp_path / "final.npz"
    save_agent(file, agent)
    loaded = load_agent(file)
    observations = np.random.default_rng(0).normal(0, 1, (500, 10)).astype(np.float32)
    expected = model.predict(observations, deterministic=True)[0]
    np.testing.assert_allclose(loaded.act(observations), expected, atol=2e-6)
    assert loaded.act(observations).dtype == np.float32
    assert np.ptp(expected) > 0.05
    assert (loaded.env_id, loaded.algorithm, loaded.steps, loaded.arguments) == (GAP, algorithm, model.num_timesteps, job.arguments)
    assert file.stat().st_size < 40_000
    assert [found.name for found in find_agents(tmp_path, env_id=GAP)] == [f"{algorithm.upper()}, seed 0"]
    assert find_agents(tmp_path, env_id=SWEEP) == []


def test_critics_begin_at_the_value_they_are_told() -> None:
    """So that what an agent does not know costs as much as it says, and putting it off is not worth more."""
    hopeful, wary = (
        make_model(job.hyperparameters, make_lanes(job.env_id, job.hyperparameters, job.arguments, 1), 0)
        for job in (small_job("sac", initial_value=value) for value in (0.0, -12.0))
    )
    observations = torch.from_numpy(np.random.default_rng(0).normal(0, 1, (50, 10)).astype(np.float32))
    actions = torch.linspace(-1, 1, 50)[:, None]
    for critics in ("critic", "critic_target"):
        for one, other in zip(getattr(hopeful, critics)(observations, actions), getattr(wary, critics)(observations, actions), strict=True):
            assert one.detach().numpy().std() > 0.01
            np.testing.assert_allclose((other - one).detach().numpy(), -12.0, atol=1e-4)
    with pytest.raises(ParameterError, match="initial_value = 'low'"):
        settings_for(GAP, "sac", initial_value="low")


def test_file_that_is_no_agent_is_refused(tmp_path: Path) -> None:
    text, arrays = tmp_path / "text.npz", tmp_path / "arrays.npz"
    text.write_text("nothing")
    np.savez(arrays, a=np.zeros(3))
    for file in (text, arrays, tmp_path / "absent.npz"):
        with pytest.raises(ParameterError, match=f"agent = .*{file.name}"):
            load_agent(file)
    with pytest.raises(ParameterError, match="layers"):
        Agent(GAP, "ppo", 0, 0, {}, "tanh", "clip", [(np.zeros((4, 10), np.float32), np.zeros(4, np.float32))])


def test_end_by_the_clock_is_no_end_for_the_value() -> None:
    """A passage whose budget is spent is told to PPO as cut off: what it was still worth is added to its last reward."""
    chosen = replace(settings_for(SWEEP, "ppo", **SMALL["ppo"]), n_steps=8, gamma=0.5, reward_scale=3.0)
    env = make_lanes(HARD, chosen, SHORT[SWEEP] | {"time_budget": 40.0, "limits": [0.9, 1.1]}, 1)
    model = make_model(chosen, env, 0)
    seen: dict[str, Any] = {}

    class Recorded(type(env.venv.venv)):
        def step_wait(self) -> Any:
            result = super().step_wait()
            seen.setdefault("rewards", []).append(result[1].copy())
            seen.setdefault("infos", []).append(result[3])
            return result

    env.venv.venv.__class__ = Recorded
    before = {name: values.clone() for name, values in model.policy.state_dict().items()}  # while the first round is collected
    model.learn(8 * 8)
    model.policy.load_state_dict(before)
    ends = [(step, lane) for step, infos in enumerate(seen["infos"]) for lane, info in enumerate(infos) if "terminal_observation" in info]
    assert ends
    given, plain = model.rollout_buffer.rewards, np.array(seen["rewards"]) * 3
    for step, lane in ends:
        info = seen["infos"][step][lane]
        assert info["TimeLimit.truncated"]
        worth = float(model.policy.predict_values(model.policy.obs_to_tensor(info["terminal_observation"])[0]).item())
        assert abs(worth) > 1e-3
        assert given[step, lane] == pytest.approx(plain[step, lane] + 0.5 * worth, abs=1e-5)
    others = np.ones_like(plain, dtype=bool)
    others[tuple(np.array(ends).T)] = False
    np.testing.assert_allclose(given[others], plain[others], rtol=1e-5)


def test_recipes_are_written_in_the_form_of_rl_zoo3(tmp_path: Path) -> None:
    """A file for each algorithm, and but for what that library takes itself, only what stable-baselines3 knows."""
    assert call("--zoo", tmp_path / "zoo").exit_code == 0
    kinds, its_own = {"ppo": PPO, "sac": SAC, "ppo_lstm": PPO}, {"n_envs", "n_timesteps", "normalize", "policy"}
    assert {file.stem for file in (tmp_path / "zoo").iterdir()} == set(kinds)
    found = {name: yaml.safe_load((tmp_path / "zoo" / f"{name}.yml").read_text()) for name in kinds}
    for name, kind in kinds.items():
        for recipe in found[name].values():
            assert set(recipe) - its_own <= set(inspect.signature(kind).parameters)
            assert eval(recipe["policy_kwargs"])["net_arch"] in ([64, 64], [128, 128])
    own, chosen = found["sac"]["ImpactAbsorber/ActiveGap-v0"], settings_for("ImpactAbsorber/ActiveGap-v0", "sac")
    assert (own["n_envs"], own["n_timesteps"], own["learning_rate"]) == (chosen.lanes, chosen.steps, "lin_0.001")


def test_hyperparameters_of_the_package_are_whole_and_a_file_replaces_what_it_names(tmp_path: Path) -> None:
    for environment in (SWEEP, GAP):
        assert isinstance(settings_for(environment, "ppo"), PPOSettings)
        assert isinstance(settings_for(environment, "sac"), SACSettings)
    file = tmp_path / "mine.yaml"
    file.write_text(f"{GAP}:\n  ppo:\n    gamma: 0.5\n    hidden: [8]\n")
    mine, packaged = settings_for(GAP, "ppo", file), settings_for(GAP, "ppo")
    assert (mine.gamma, mine.hidden) == (0.5, (8,))
    assert replace(mine, gamma=packaged.gamma, hidden=packaged.hidden) == packaged
    assert settings_for(GAP, "sac", file) == settings_for(GAP, "sac")
    assert mine.rate_of(0) == packaged.learning_rate
    assert mine.rate_of(mine.legs - 1) == pytest.approx(packaged.final_learning_rate)
    assert read(PACKAGED)[GAP]["ppo"]["gamma"] == packaged.gamma


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "a file in YAML"),
        ("", "a mapping"),
        ("Other-v0:\n  ppo: {gamma: 1}", "'Other-v0' is not allowed: an environment of"),
        (f"{GAP}:\n  dqn: {{gamma: 1}}", "'dqn' is not allowed: an algorithm of ppo, sac"),
        (f"{GAP}:\n  ppo: {{gama: 1}}", "'gama' is not allowed: a hyperparameter of"),
        (f"{GAP}:\n  ppo: {{learning_rate: 1e-3}}", "learning_rate = '1e-3'"),
        (f"{GAP}:\n  ppo: {{batch_size: 1000}}", "batch_size = 1000 is not allowed: a divisor of"),
        (f"{GAP}:\n  ppo: {{hidden: 64}}", "hidden = 64"),
        (f"{GAP}:\n  ppo: {{legs: 0}}", "legs = 0"),
        (f"{GAP}:\n  ppo: {{sde_sample_freq: 0}}", "sde_sample_freq = 0"),
    ],
)
def test_bad_hyperparameters_are_named(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    result = call("--task", "GapChoice-v1", "--algorithm", "ppo", "--hyperparameters", file, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert words in result.output
    assert not list((tmp_path / "out").rglob("*.*"))


@pytest.mark.same_bits
@pytest.mark.slow
def test_command_goes_on_after_kill_and_reports(tmp_path: Path) -> None:
    """Kill -9 in the middle of a training; the same command finishes it, as an undisturbed one would have."""
    file = tmp_path / "small.yaml"
    names = {**SMALL["ppo"], "steps": 2560, "legs": 10}
    file.write_text(json.dumps({GAP: {"ppo": names}}))
    arguments = [f"--argument {name} {json.dumps(value)}" for name, value in SHORT[GAP].items()]
    words = [part for argument in arguments for part in argument.split(" ", 2)]
    options = ["--task", "GapChoice-v1", "--algorithm", "ppo", "--seeds", "1", "--workers", "1", "--hyperparameters", str(file), *words]
    out, folder = tmp_path / "out", tmp_path / "out" / "GapChoice-v1" / "ppo" / "seed-0"
    undisturbed = call(*options, "--out", tmp_path / "undisturbed")  # in this process, after other trainings
    assert undisturbed.exit_code == 0, undisturbed.output
    process = started(*options, "--out", out)
    until = time.monotonic() + 120
    while process.poll() is None and len(read_evaluations(folder)) < 2 and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    (run,) = find_runs(out)
    assert 2 <= len(run.evaluations) < 10
    assert not run.finished
    refused = call(*options, "--steps", 1280, "--out", out)
    assert refused.exit_code == 2
    assert "steps is 2560 there and 1280 here" in refused.output
    output = finished(started(*options, "--out", out, "--ship", tmp_path / "kept"))
    assert "| PPO " in output
    assert (out / "learning_GapChoice-v1.png").stat().st_size > 10_000
    other = tmp_path / "undisturbed" / "GapChoice-v1" / "ppo" / "seed-0"
    assert read_evaluations(folder) == read_evaluations(other)
    (kept,) = (tmp_path / "kept").iterdir()
    assert kept.name == "GapChoice-v1_ppo.zip"
    with ZipFile(kept) as archive:
        assert archive.read("final.npz") == (other / "final.npz").read_bytes()
