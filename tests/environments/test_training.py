"""Training works, also after an interruption.

The bridge to stable-baselines3, resumed runs, files of agents, and the shipped agents are tested.
"""

import inspect
import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
from click.testing import Result
from commands import call
from drawing import bands, labelled_lines, line, saved_figures

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("stable_baselines3")

import torch
import yaml
from environment_cases import BRIEF, HARD, RUBBING
from environment_cases import GAP1 as GAP
from places import ROOT
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from impact_env import ParameterError
from optimisation.cli import rl_train as command
from optimisation.report.learning_report import save_learning_curve
from optimisation.rl.agents import (
    Agent,
    TrainingEvaluation,
    actor_of,
    find_agents,
    find_runs,
    list_shipped,
    load_agent,
    packaged_file,
    read_evaluations,
    run_folder,
    save_agent,
    ship,
    write_evaluations,
)
from optimisation.rl.hyperparameters import PACKAGED, PPOSettings, SACSettings, read, settings_for
from optimisation.rl.models import begin_leg, checkpoints, make_lanes, make_model
from optimisation.rl.policy_iteration import (
    RolloutPolicyIteration,
    add_errors,
    draw_candidates,
    score_candidates,
)
from optimisation.rl.training import Job, train
from optimisation.rl.vec_env import NativeVecEnv, make_native

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*-v0 is out of date", "ignore:`n_steps=4` is ignored"
)

# a gap task of 20 intervals, with the same kernels as those of other tests of the environments
SHORT: dict[str, Any] = RUBBING | {"time_budget": 100.0, "hold": [20.0, 40.0], "force": [0.5, 6.0]}
SMALL: dict[str, dict[str, Any]] = {
    "ppo": {"steps": 900, "legs": 3, "lanes": 8, "n_steps": 16, "batch_size": 64, "n_epochs": 2},
    "sac": {
        "steps": 600,
        "legs": 3,
        "lanes": 8,
        "batch_size": 32,
        "buffer_size": 400,
        "learning_starts": 100,
        "gradient_steps": 1,
    },
}


def small_job(algorithm: str, **changes: Any) -> Job:
    return Job(
        GAP,
        algorithm,
        3,
        settings_for(GAP, algorithm, **{**SMALL[algorithm], **changes}),
        SHORT,
        episodes=8,
    )


def train_command(*arguments: object) -> Result:
    return call(command.main, *arguments)


def test_bridge_gives_what_the_librarys_own_loop_over_single_environments_gives() -> None:
    lanes = 4
    bridge = make_native(HARD, lanes, all_info=True, **BRIEF)
    own = DummyVecEnv([lambda: gymnasium.make(HARD, **BRIEF)] * lanes)
    for env in (bridge, own):
        env.seed(7)
    np.testing.assert_array_equal(bridge.reset(), own.reset())
    np.testing.assert_equal(bridge.reset_infos, own.reset_infos)
    generator = np.random.default_rng(0)
    cut = set()
    for _ in range(40):
        actions = (generator.uniform(-1, 0, (lanes, 1)) + [[-0.5], [-0.5], [0.5], [1.0]]).astype(
            np.float32
        )
        mine = bridge.step(actions)
        theirs = own.step(actions)
        for a, b in zip(mine[:3], theirs[:3], strict=True):
            np.testing.assert_array_equal(a, b)
            assert a.dtype == b.dtype
        for a, b, done in zip(mine[3], theirs[3], mine[2], strict=True):
            # the library gives the last info of an episode, and the flag on every step; the bridge
            # gives it where it means something
            assert {
                **a,
                "TimeLimit.truncated": a.get("TimeLimit.truncated", False),
            }.keys() == b.keys()
            np.testing.assert_equal(a, {k: b[k] for k in a})
            if done:
                cut.add(a["TimeLimit.truncated"])
        np.testing.assert_equal(bridge.reset_infos, own.reset_infos)
    assert cut == {True, False}


def test_bridge_keeps_infos_short_and_works_under_the_librarys_wrappers() -> None:
    env = VecNormalize(VecMonitor(make_native(HARD, 3, **BRIEF)))
    env.reset()
    ended = []
    for _ in range(20):
        _, rewards, done, infos = env.step(np.full((3, 1), 1.0, np.float32))
        assert rewards.dtype == np.float32
        ended += [info for info, over in zip(infos, done, strict=True) if over]
        assert all(info == {} for info, over in zip(infos, done, strict=True) if not over)
    assert len(ended) >= 3
    assert [info["episode"]["r"] for info in ended] == pytest.approx(
        [info["score"] for info in ended], abs=1e-5
    )


def test_bridge_refuses_what_it_cannot_do() -> None:
    with pytest.raises(ParameterError, match="autoreset_mode"):
        NativeVecEnv(gymnasium.make_vec(HARD, num_envs=2, autoreset_mode="NEXT_STEP", **BRIEF))
    env = make_native(HARD, 2, **BRIEF)
    with pytest.raises(AttributeError, match="share"):
        env.set_attr("x", 1)
    with pytest.raises(AttributeError, match="single"):
        env.env_method("reset")
    assert env.get_attr("num_envs", [0]) == [2]


class Interrupt:
    """Presses Ctrl-C after some calls."""

    def __init__(self, after: int) -> None:
        self.left = after

    def __call__(self, *_progress: object) -> None:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("algorithm", "after", "changes"),
    [
        ("ppo", 60, {}),
        ("ppo", 60, {"start": "rule", "critic_rounds": 4}),
        ("sac", 32, {"use_sde": True, "sde_sample_freq": 3, "train_freq": 5}),
        ("rpi", 12, {}),
    ],
)
def test_interrupted_training_equals_one_that_never_stopped(
    tmp_path: Path, algorithm: str, after: int, changes: dict[str, Any]
) -> None:
    job = small_iteration() if algorithm == "rpi" else small_job(algorithm, **changes)
    whole = train(job, tmp_path / "whole")
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            train(job, tmp_path / "broken", Interrupt(after))
        assert 0 < len(read_evaluations(tmp_path / "broken")) < 3
    assert train(job, tmp_path / "broken") == whole
    for name in ("evaluations.csv", "final.npz"):
        assert (tmp_path / "broken" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    folders = checkpoints(tmp_path / "whole" / "checkpoints")
    best = int(np.argmax([evaluation.score for evaluation in whole]))
    assert [folder.name for folder in folders] == [f"leg-{k:03d}" for k in sorted({best, 1, 2})]
    agent = (tmp_path / "whole" / "final.npz").read_bytes()
    assert [(folder / "agent.npz").read_bytes() == agent for folder in folders] == [
        folder.name == f"leg-{best:03d}" for folder in folders
    ]
    assert not list(tmp_path.rglob("replay.*"))


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


def test_only_the_critic_is_trained_in_the_first_rounds(tmp_path: Path) -> None:
    job = small_job("ppo", steps=384, legs=3, critic_rounds=2)  # rounds of 128 steps, one a leg
    actors = []
    critics = []

    def watch(_steps: int, done: list[TrainingEvaluation]) -> None:
        if len(done) > len(actors):
            folder = tmp_path / "checkpoints" / f"leg-{len(actors):03d}"
            policy = PPO.load(folder / "model.zip", device="cpu").policy.state_dict()
            actors.append({k: v for k, v in policy.items() if "policy" in k or "action" in k})
            critics.append({k: v for k, v in policy.items() if "value" in k})

    train(job, tmp_path, watch)
    assert len(actors) == 3
    assert all(len(part) == 6 for part in critics)

    def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
        return all(bool((one[name] == other[name]).all()) for name in one)

    assert [same(actors[0], actors[1]), same(actors[1], actors[2])] == [True, False]
    assert not same(critics[0], critics[1])


def test_the_start_of_a_run_is_in_its_settings(tmp_path: Path) -> None:
    """By what is imitated, and not by where it lies; what cannot be imitated is refused."""
    fresh, ruled, shipped_agent = (
        small_job("ppo", start=start).describe() for start in ("none", "rule", "agent")
    )
    assert "start" not in fresh
    assert ruled["start"]["rule"]["family"] == "GapByEstimatedForce"
    copies = [tmp_path / "one.zip", tmp_path / "other.zip"]
    for copy in copies:
        copy.write_bytes(packaged_file("GapChoice-v1").read_bytes())
        assert small_job("ppo", start=str(copy)).describe() == shipped_agent
    for start, words in (
        ("nothing", "start = 'nothing' is not allowed: rule, agent, none, or the path"),
        (str(packaged_file("ActiveGap-v0")), "an agent of ImpactAbsorber/GapChoice-v1"),
        ("", "start = '' is not allowed"),
    ):
        with pytest.raises(ParameterError, match=words):
            small_job("ppo", start=start).describe()
    noisy = "ImpactAbsorber/SweepRateNoisy-v1"
    with pytest.raises(ParameterError, match="start = 'rule' is not allowed: none for rppo"):
        Job(noisy, "rppo", 0, settings_for(noisy, "rppo", start="rule"))


def test_another_librarys_environment_is_refused() -> None:
    job = replace(small_job("ppo"), env_id="CartPole-v1", arguments={})
    with pytest.raises(ParameterError, match="env_id = 'CartPole-v1' is not allowed"):
        job.describe()


def test_folder_of_other_settings_is_refused(tmp_path: Path) -> None:
    job = small_job("ppo", steps=128, legs=1, gamma=0.98)
    train(job, tmp_path)
    before = (tmp_path / "settings.json").read_bytes()
    for changed, words in (
        (
            replace(job, hyperparameters=replace(job.hyperparameters, gamma=0.5)),
            "hyperparameters.gamma is 0.98 there and 0.5 here",
        ),
        (
            replace(job, arguments={**job.arguments, "interval": 10.0}),
            "environment_arguments.interval is 5.0 there and 10.0 here",
        ),
    ):
        with pytest.raises(ParameterError, match="other settings") as error:
            train(changed, tmp_path)
        assert words in str(error.value)
    assert (tmp_path / "settings.json").read_bytes() == before


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
    assert np.ptp(expected) > 0.05
    assert (loaded.env_id, loaded.algorithm, loaded.steps, loaded.arguments) == (
        GAP,
        algorithm,
        model.num_timesteps,
        job.arguments,
    )
    assert file.stat().st_size < 40_000
    assert [agent.name for agent in find_agents(tmp_path, env_id=GAP)] == [
        f"{algorithm.upper()}, seed 0"
    ]
    assert find_agents(tmp_path, env_id=HARD) == []


def test_critics_begin_at_the_chosen_value() -> None:
    """Critics start at the chosen value.

    Unknown states thus cost as much as that value, and delaying is not worth more.
    """
    hopeful, wary = (
        make_model(
            job.hyperparameters, make_lanes(job.env_id, job.hyperparameters, job.arguments, 1), 0
        )
        for job in (small_job("sac", initial_value=value) for value in (0.0, -12.0))
    )
    observations = torch.from_numpy(
        np.random.default_rng(0).normal(0, 1, (50, 10)).astype(np.float32)
    )
    actions = torch.linspace(-1, 1, 50)[:, None]
    for critics in ("critic", "critic_target"):
        for one, other in zip(
            getattr(hopeful, critics)(observations, actions),
            getattr(wary, critics)(observations, actions),
            strict=True,
        ):
            assert one.detach().numpy().std() > 0.01
            np.testing.assert_allclose((other - one).detach().numpy(), -12.0, atol=1e-4)
    with pytest.raises(ParameterError, match="initial_value = 'low'"):
        settings_for(GAP, "sac", initial_value="low")


def test_what_is_no_agent_is_refused(tmp_path: Path) -> None:
    for name in ("text.npz", "archive.zip"):
        (tmp_path / name).write_text("nothing")
    np.savez(tmp_path / "arrays.npz", a=np.zeros(3))
    for name in ("text.npz", "arrays.npz", "absent.npz", "archive.zip"):
        with pytest.raises(
            ParameterError, match=rf"{name}.* is not allowed: a file that train wrote"
        ):
            load_agent(tmp_path / name)
    with pytest.raises(ParameterError, match="task = 'nothing' is not allowed"):
        load_agent("nothing")
    with pytest.raises(ParameterError, match="algorithm = 'sac'"):
        load_agent("GapChoice-v1", "sac")
    with pytest.raises(ParameterError, match="layers"):
        Agent(
            GAP,
            "ppo",
            0,
            0,
            {},
            "tanh",
            "clip",
            [(np.zeros((4, 10), np.float32), np.zeros(4, np.float32))],
        )


def test_recipes_are_written_in_the_form_of_rl_zoo3(tmp_path: Path) -> None:
    """Recipes are written in the form of rl_zoo3.

    Each algorithm has a file. Apart from that library's own keys it has only arguments that
    stable-baselines3 knows.
    """
    assert train_command("--zoo", tmp_path / "zoo").exit_code == 0
    recurrent = pytest.importorskip("sb3_contrib").RecurrentPPO
    kinds = {"ppo": PPO, "sac": SAC, "ppo_lstm": recurrent}
    its_own = {"n_envs", "n_timesteps", "normalize", "policy"}
    assert {file.stem for file in (tmp_path / "zoo").iterdir()} == set(kinds)
    recipes = {
        name: yaml.safe_load((tmp_path / "zoo" / f"{name}.yml").read_text()) for name in kinds
    }
    for name, kind in kinds.items():
        for recipe in recipes[name].values():
            assert set(recipe) - its_own <= set(inspect.signature(kind).parameters)
            of_policy = eval(recipe["policy_kwargs"])
            policy = kind.policy_aliases[recipe["policy"]]
            assert set(of_policy) <= set(inspect.signature(policy).parameters)
            assert of_policy["net_arch"] in ([64, 64], [128, 128])
    own = recipes["sac"]["ImpactAbsorber/ActiveGap-v0"]
    chosen = settings_for("ImpactAbsorber/ActiveGap-v0", "sac")
    assert (own["n_envs"], own["n_timesteps"], own["learning_rate"]) == (
        chosen.lanes,
        chosen.steps,
        "lin_0.001",
    )


def test_hyperparameters_of_the_package_are_whole_and_a_file_replaces_what_it_names(
    tmp_path: Path,
) -> None:
    for algorithm, kind in (("ppo", PPOSettings), ("sac", SACSettings)):
        assert isinstance(settings_for(GAP, algorithm), kind)
    file = tmp_path / "mine.yaml"
    file.write_text(f"{GAP}:\n  ppo:\n    gamma: 0.5\n    hidden: [8]\n")
    mine = settings_for(GAP, "ppo", file)
    packaged = settings_for(GAP, "ppo")
    assert (mine.gamma, mine.hidden) == (0.5, (8,))
    assert replace(mine, gamma=packaged.gamma, hidden=packaged.hidden) == packaged
    assert settings_for(GAP, "sac", file) == settings_for(GAP, "sac")
    assert mine.rate_of(0) == packaged.learning_rate
    assert mine.rate_of(mine.legs - 1) == pytest.approx(packaged.final_learning_rate)
    assert read(PACKAGED)[GAP]["ppo"]["gamma"] == packaged.gamma


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "a mapping"),
        ("Other-v0:\n  ppo: {gamma: 1}", "'Other-v0' is not allowed: an environment of"),
        (f"{GAP}:\n  ppo: {{gama: 1}}", "'gama' is not allowed: a hyperparameter of"),
        (f"{GAP}:\n  ppo: {{learning_rate: 1e-3}}", "learning_rate = '1e-3'"),
        (f"{GAP}:\n  ppo: {{batch_size: 1000}}", "batch_size = 1000 is not allowed: a divisor of"),
    ],
)
def test_bad_hyperparameters_are_named(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    result = train_command(
        "--task",
        "GapChoice-v1",
        "--algorithm",
        "ppo",
        "--hyperparameters",
        file,
        "--out",
        tmp_path / "out",
    )
    assert result.exit_code == 2, result.output
    assert words in result.output
    assert not list((tmp_path / "out").rglob("*.*"))


@pytest.mark.slow
def test_the_command_trains_reports_and_ships(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "small.yaml"
    out = tmp_path / "out"
    file.write_text(json.dumps({GAP: {"ppo": SMALL["ppo"]}}))
    words = [
        word for name, value in SHORT.items() for word in ("--argument", name, json.dumps(value))
    ]
    options = [
        "--task",
        "GapChoice-v1",
        "--algorithm",
        "ppo",
        "--seeds",
        1,
        "--workers",
        1,
        "--hyperparameters",
        file,
        *words,
        "--out",
        out,
    ]
    drawn = saved_figures(monkeypatch)
    done = train_command(*options, "--ship", tmp_path / "kept")
    assert done.exit_code == 0, done.output
    assert "| PPO " in done.output
    (run,) = find_runs(out)
    assert run.finished
    assert (out / "learning_GapChoice-v1.png").is_file()
    scores = [evaluation.score for evaluation in run.evaluations]
    np.testing.assert_allclose(line(drawn[0].axes[0], "PPO, 1 seed")[1], scores)
    with ZipFile(tmp_path / "kept" / "GapChoice-v1_ppo.zip") as archive:
        assert (
            archive.read("final.npz")
            == (out / "GapChoice-v1" / "ppo" / "seed-0" / "final.npz").read_bytes()
        )
    refused = train_command(*options, "--from", tmp_path / "nothing")
    assert refused.exit_code == 2
    assert "is not allowed: rule, agent, none, or the path" in refused.output
    refused = train_command(*options, "--steps", 1280)
    assert refused.exit_code == 2
    assert "steps is 900 there and 1280 here" in refused.output


@pytest.mark.same_bits
@pytest.mark.slow
def test_the_command_goes_on_after_kill_9(tmp_path: Path) -> None:
    """The same command finishes what was killed as an undisturbed one would have."""
    file = tmp_path / "small.yaml"
    file.write_text(json.dumps({GAP: {"ppo": {**SMALL["ppo"], "steps": 1024, "legs": 4}}}))
    words = [
        word for name, value in SHORT.items() for word in ("--argument", name, json.dumps(value))
    ]
    options = [
        "--task",
        "GapChoice-v1",
        "--algorithm",
        "ppo",
        "--seeds",
        1,
        "--workers",
        1,
        "--hyperparameters",
        file,
        *words,
    ]
    killed, undisturbed = (
        tmp_path / out / "GapChoice-v1" / "ppo" / "seed-0" for out in ("killed", "undisturbed")
    )
    command = [
        sys.executable,
        "-m",
        "optimisation.cli.group",
        "train",
        *map(str, options),
        "--out",
        str(tmp_path / "killed"),
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + 120
    while process.poll() is None and len(read_evaluations(killed)) < 2 and time.monotonic() < until:
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert 2 <= len(read_evaluations(killed)) < 4
    assert train_command(*options, "--out", tmp_path / "killed").exit_code == 0
    assert train_command(*options, "--out", tmp_path / "undisturbed").exit_code == 0
    assert read_evaluations(killed) == read_evaluations(undisturbed)


# Agents that ship: they act without torch as stable-baselines3 makes them act, and go on learning;
# what they score: test_suite.py.


SHIPPED = [(task, algorithm) for task, own in list_shipped().items() for algorithm in own]
KINDS = {"ppo": PPO, "sac": SAC, "rpi": RolloutPolicyIteration}


@pytest.mark.parametrize(("task", "algorithm"), SHIPPED)
def test_the_small_file_acts_as_the_model(task: str, algorithm: str) -> None:
    agent = load_agent(task, algorithm)
    model = KINDS[algorithm].load(packaged_file(task, algorithm), device="cpu")
    observed = (
        np.random.default_rng(0)
        .normal(size=(50, model.observation_space.shape[0]))
        .astype(np.float32)
    )
    np.testing.assert_allclose(
        agent.act(observed), model.predict(observed, deterministic=True)[0], atol=1e-5
    )


def test_an_agent_goes_on_learning() -> None:
    env = make_lanes("ImpactAbsorber/ActiveGap-v0", "ppo")
    model = PPO.load(packaged_file("ActiveGap-v0"), env=env, device="cpu")
    model.set_random_seed(0)  # the lanes' seeds, too
    before = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(5120, reset_num_timesteps=False)
    assert model.num_timesteps >= 400_000 + 5120
    assert all(
        not bool((a == b.detach()).all())
        for a, b in zip(before, model.policy.parameters(), strict=True)
    )
    # the critic that came along knows these rewards: what they add up to for ever; without their
    # scale it is off by 50
    buffer = model.rollout_buffer
    assert 0.2 < buffer.values.mean() * (1 - model.gamma) / buffer.rewards.mean() < 5


def made_run(out: Path, seed: int, scores: list[float]) -> bytes:
    """Write a finished run with these evaluation scores; return the bytes of its agent."""
    folder = run_folder(out, "GapChoice-v1", "ppo", seed)
    for leg in range(len(scores)):
        (folder / "checkpoints" / f"leg-{leg:03d}").mkdir(parents=True)
    evaluations = [
        TrainingEvaluation(leg, 100 * (leg + 1), score, score, score, score, 20.0)
        for leg, score in enumerate(scores)
    ]
    write_evaluations(folder, evaluations)
    (folder / "settings.json").write_text(json.dumps({"algorithm": "ppo", "seed": seed}))
    agent = f"agent {seed}".encode()
    (folder / "final.npz").write_bytes(agent)
    for leg in range(len(scores)):
        checkpoint = folder / "checkpoints" / f"leg-{leg:03d}"
        written = agent if leg == int(np.argmax(scores)) else b"another"
        (checkpoint / "agent.npz").write_bytes(written)
        with ZipFile(checkpoint / "model.zip", "w") as archive:
            archive.writestr("policy.pth", written)
    return agent


def test_the_run_that_ships_is_the_one_in_the_middle(tmp_path: Path) -> None:
    """The shipped run is the median one by the score of its best evaluation.

    Of two runs in the middle it is the better one. Its model is that of the same checkpoint.
    """
    best = {0: -0.1, 1: -0.7, 2: -0.4, 3: -0.2, 4: -0.5}
    agents = {seed: made_run(tmp_path, seed, [score, -0.8]) for seed, score in best.items()}
    for seeds, chosen in ((range(5), 2), (range(4), 3), (range(1), 0)):
        out = tmp_path / f"{len(seeds)}"
        for seed in seeds:
            made_run(out, seed, [best[seed], -0.8])
        (file,) = ship(out, tmp_path / f"kept {len(seeds)}")
        with ZipFile(file) as archive:
            assert archive.read("final.npz") == archive.read("policy.pth") == agents[chosen]


def test_learning_curves_are_drawn_from_the_evaluations(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    scores = [[-0.9, -0.5], [-0.8, -0.4], [-0.7, -0.1], [-0.6, -0.2]]
    for seed, row in enumerate(scores):
        made_run(tmp_path, seed, row)
    drawn = saved_figures(monkeypatch)
    save_learning_curve(tmp_path / "a.png", "task", find_runs(tmp_path), {"planner": -0.05})
    (panel,) = drawn[0].axes
    thin = [points.tolist() for points, label in labelled_lines(panel) if label[:1] == "_"]
    assert [[100.0, 200.0], scores[2]] in thin
    middle = np.mean(np.sort(scores, axis=0)[1:3], axis=0)
    np.testing.assert_allclose(line(panel, "PPO, 4 seeds"), [[100, 200], middle])
    np.testing.assert_allclose(line(panel, "planner")[1], -0.05)
    (band,) = bands(panel)
    np.testing.assert_allclose(band[1:], np.percentile(scores, (10, 90), axis=0))


# Rollout policy iteration.


FRICTION = "ImpactAbsorber/ActiveFriction-v0"


def small_iteration(**changes: Any) -> Job:
    own = {"lanes": 4, "n_steps": 8, "steps": 2600, "legs": 3, "batch_size": 16, "start": "none"}
    return Job(FRICTION, "rpi", 0, settings_for(FRICTION, "rpi", **{**own, **changes}), episodes=8)


def test_candidates_are_the_mean_and_one_in_each_part_of_the_reach() -> None:
    means = np.array([[0.0, 0.9], [-3.0, 0.2]], np.float32)
    drawn = draw_candidates(means, 4, 0.5, np.random.default_rng(0))
    assert drawn.shape == (2, 5, 2)
    np.testing.assert_array_equal(drawn[:, 0], np.clip(means, -1, 1))
    for lane, number, low, high in ((0, 0, -0.5, 0.5), (0, 1, 0.4, 1.0), (1, 0, -1.0, -0.5)):
        parts = np.sort((drawn[lane, 1:, number] - low) / (high - low) * 4)
        np.testing.assert_array_equal(parts.astype(int), range(4))


@pytest.mark.parametrize("delay", [0, 2])
def test_a_trial_scores_a_candidate_as_the_single_environment_does(delay: int) -> None:
    """A trial scores a candidate as the single environment does.

    Some intervals have the candidate action, and the following ones those of the agent, from the
    lane's present state. The lane itself does not advance.
    """
    agent = load_agent("ActiveFriction-v0")
    actions = np.array([[0.3], [-0.8]], np.float32)
    late = {"observation_delay": delay, "action_delay": delay}
    lanes, trials = (gymnasium.make_vec(FRICTION, num_envs=n, **late).unwrapped for n in (2, 4))
    lanes.reset(seed=5)
    trials.reset(seed=0)
    for _ in range(3):
        lanes.step(actions)
    candidates = np.array([[[0.9], [-0.9]], [[0.0], [0.5]]], np.float32)
    trials.task.copy_from(lanes.task, 2)
    scores = score_candidates(trials.task, candidates, agent, 2, horizon=6, gamma=0.9)
    for lane in range(2):
        for number in range(2):
            env = gymnasium.make(FRICTION, **late)
            env.reset(seed=5 + lane)
            for _ in range(3):
                env.step(actions[lane])
            rewards = []
            action = candidates[lane, number]
            for interval in range(6):
                observed, reward, *_ = env.step(action)
                rewards.append(reward)
                if interval >= 1:
                    action = agent.act(observed[None])[0]
            expected = sum(0.9**k * reward for k, reward in enumerate(rewards))
            assert scores[lane, number] == pytest.approx(
                expected, rel=1e-6
            )  # digits of matrix products


def test_trials_have_the_delays_of_the_lanes_and_no_noise() -> None:
    job = small_iteration(steps=800, legs=1)
    arguments = {"observation_noise": 0.3, "observation_delay": 1, "observation_drift": 0.1}
    env = make_lanes(job.env_id, job.hyperparameters, arguments, 1)
    model: Any = make_model(job.hyperparameters, env, 0)
    model.learn(1)
    sensors = model._trial_env.unwrapped.task.sensors
    assert (sensors.noise, sensors.drift, sensors.delay) == (0.0, 0.0, 1)
    assert env.task_lanes.task.sensors.noise == 0.3
    assert all(np.isfinite(part).all() for part in model.memory[0])


def test_errors_are_those_of_a_group() -> None:
    load = {"kind": "random", "spectrum": [[20.0, 0.05], [60.0, 0.05]], "duration_s": 2.0}
    env = gymnasium.make_vec(FRICTION, num_envs=6, load={**load, "seed": 4}).unwrapped
    env.reset(seed=0)
    force, phase = (
        values.copy() for values in (env.task.lanes.force, env.task.runs.orders["phase"])
    )
    add_errors(env.task, 3, np.random.default_rng(0))
    shares = env.task.lanes.force / force - 1
    turned = env.task.runs.orders["phase"] - phase
    places = env.task.runs.orders["place"]
    for values in (shares, turned, places):
        np.testing.assert_allclose(values[[0, 3]].repeat(3), values, atol=1e-12)
        assert values[0] != values[3]
    assert np.all((np.abs(shares) >= 0.002) & (np.abs(shares) <= 0.01))
    assert np.all((np.abs(turned) >= 0.02) & (np.abs(turned) <= 0.1))


def test_the_actor_moves_to_the_best_action() -> None:
    """The actor moves to the best action.

    Scores are parabolas whose vertex depends on the state. After the updates the mean action is
    close to the vertex.
    """
    job = small_iteration(batch_size=64, n_epochs=30, learning_rate=3e-3)
    env = make_lanes(job.env_id, job.hyperparameters, {}, 1)
    model = make_model(job.hyperparameters, env, 0)
    begin_leg(model, 0, 0, 3e-3)
    model._setup_learn(1)
    generator = np.random.default_rng(0)
    observations = generator.normal(size=(600, 11)).astype(np.float32)
    vertices = 0.5 * np.tanh(observations[:, :1])
    candidates = draw_candidates(np.zeros((600, 1), np.float32), 5, 2.0, generator)
    scores = -((candidates[:, :, 0] - vertices) ** 2).astype(np.float32)
    model.memory = [(observations, candidates, scores)]
    model.train()
    acts = actor_of(model, FRICTION, 0, {}).act(observations)
    assert np.corrcoef(acts[:, 0], vertices[:, 0])[0, 1] > 0.95
    assert np.abs(acts - vertices).mean() < 0.1
