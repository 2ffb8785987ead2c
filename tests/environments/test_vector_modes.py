"""The native vector against a reference that shares no code with it: single environments in a loop, restarted as each mode of autoreset has it."""

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeLimit

import impact_env
from impact_env import ParameterError
from impact_env.plain import from_scene, to_scene

V1, ADAPTIVE, GAP = "ImpactAbsorber/SweepRate-v1", "ImpactAbsorber/SweepAndGap-v1", "ImpactAbsorber/GapChoice-v1"
RUBBING = {"modes": 2, "absorber_options": {"friction_limit": 0.025}}
PASSAGE = {"interval": 5.0, "limits": (0.96, 0.98), "rates": (2.0, 20.0), "direction": "random", "time_budget": 60.0, "observation_noise": 0.1}
SHORT: dict[str, Any] = {
    V1: PASSAGE | {"observation_delay": 2, "force": (1.0, 2.0)},
    ADAPTIVE: PASSAGE | RUBBING,
    GAP: {"hold": (10.0, 30.0), "time_budget": 60.0, "observation_noise": 0.1, "frequency_ratio": (0.97, 1.03)} | RUBBING,
}
LANES = 4


class Loop:
    """Single environments, each under gymnasium's own TimeLimit where one is wanted, with autoreset as the words of gymnasium's page have it."""

    def __init__(self, name: str, mode: AutoresetMode, limit: int | None) -> None:
        singles = [gymnasium.make(name, **SHORT[name]).unwrapped for _ in range(LANES)]
        self.envs = [single if limit is None else TimeLimit(single, limit) for single in singles]
        self.mode, self.over = mode, [False] * LANES

    def reset(self, seed: int) -> np.ndarray:
        return np.stack([env.reset(seed=seed + i)[0] for i, env in enumerate(self.envs)])

    def step(self, actions: np.ndarray) -> list[tuple[Any, ...]]:
        """Return (observation, reward, terminated, truncated, info, last observation or None) of each lane."""
        rows = []
        for lane, env in enumerate(self.envs):
            if self.over[lane] and self.mode is AutoresetMode.NEXT_STEP:
                observation, info = env.reset()
                rows.append((observation, 0.0, False, False, info, None))
                self.over[lane] = False
                continue
            observation, reward, terminated, truncated, info = env.step(actions[lane])
            last = None
            self.over[lane] = terminated or truncated
            if self.over[lane] and self.mode is AutoresetMode.SAME_STEP:
                last, (observation, info) = observation, env.reset()
                self.over[lane] = False
            rows.append((observation, reward, terminated, truncated, info, last))
        return rows


@pytest.mark.parametrize("limit", [None, 7])
@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("name", SHORT)
def test_each_mode_is_a_loop_of_single_environments(name: str, mode: AutoresetMode, limit: int | None) -> None:
    loop = Loop(name, mode, limit)
    given = {} if limit is None else {"max_episode_steps": limit}
    native = gymnasium.make_vec(name, num_envs=LANES, autoreset_mode=mode.value, **given, **SHORT[name])
    assert native.metadata["autoreset_mode"] is mode
    generator, ends = np.random.default_rng(3), 0
    np.testing.assert_array_equal(native.reset(seed=5)[0], loop.reset(5))
    for _ in range(45):
        actions = generator.uniform(-1, 1, native.action_space.shape).astype(np.float32)
        rows = loop.step(actions)
        observations, rewards, terminated, truncated, infos = native.step(actions)
        for lane, (observation, reward, end, cut, info, last) in enumerate(rows):
            np.testing.assert_array_equal(observations[lane], observation)
            assert (rewards[lane], terminated[lane], truncated[lane]) == (reward, end, cut)
            assert infos["time"][lane] == info["time"]
            assert infos["score"][lane] == info["score"]
            if last is not None:
                np.testing.assert_array_equal(infos["final_obs"][lane], last)
            ends += end or cut
        if mode is AutoresetMode.DISABLED and any(loop.over):
            with pytest.raises(ResetNeeded, match="reset_mask"):
                native.step(actions)
            mask = np.array(loop.over)
            again, _ = native.reset(options={"reset_mask": mask})
            for lane in np.flatnonzero(mask):
                np.testing.assert_array_equal(again[lane], loop.envs[lane].reset()[0])
                loop.over[lane] = False
    assert ends > 2 * LANES
    native.close()


def test_modes_go_by_name_value_or_enum_and_nothing_else() -> None:
    for mode in ("NEXT_STEP", "NextStep", AutoresetMode.NEXT_STEP):
        assert gymnasium.make_vec(V1, num_envs=1, autoreset_mode=mode).metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    for bad in ("next", None, 1):
        with pytest.raises(ParameterError, match="autoreset_mode"):
            gymnasium.make_vec(V1, num_envs=1, autoreset_mode=bad)
    for bad in (0, 2.5, "3"):
        with pytest.raises(ParameterError, match="max_episode_steps"):
            gymnasium.make_vec(V1, num_envs=1, max_episode_steps=bad)
    assert gymnasium.make_vec(V1, num_envs=1, max_episode_steps=-1).unwrapped.task.limit is None


def test_normalize_observation_takes_the_next_step_mode() -> None:
    from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

    env = NormalizeObservation(RecordEpisodeStatistics(gymnasium.make_vec(V1, num_envs=3, autoreset_mode="NextStep", **SHORT[V1])))
    env.reset(seed=0)
    lengths = []
    for _ in range(40):
        *_, infos = env.step(np.ones((3, 1), np.float32))
        if "episode" in infos:
            lengths += infos["episode"]["l"][infos["_episode"]].tolist()
    assert len(lengths) >= 9
    assert max(lengths) == 2  # two per cent at twenty per hundred periods, five periods a step


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["deepcopy", "pickle"])
@pytest.mark.parametrize("name", SHORT)
def test_copies_go_on_like_the_original_and_apart_from_it(name: str, copied: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("impact_env.controlled.FEWEST", 1)  # so that threads are at work before the copy
    single = gymnasium.make(name, render_mode="rgb_array", **SHORT[name])
    single.reset(seed=1)
    many = gymnasium.make_vec(name, num_envs=3, threads=2, autoreset_mode="NextStep", **SHORT[name])
    many.reset(seed=1)
    single.render()
    for _ in range(3):
        single.step(np.zeros(single.action_space.shape, np.float32))
        many.step(np.zeros(many.action_space.shape, np.float32))
    for env in (single, many):
        before = env.unwrapped.task.runs.state.copy()
        other = copied(env)
        action = np.full(env.action_space.shape, 0.3, np.float32)
        a = [env.step(action)[:2] for _ in range(2)]
        assert not np.array_equal(env.unwrapped.task.runs.state, before)
        np.testing.assert_array_equal(other.unwrapped.task.runs.state, before)
        b = [other.step(action)[:2] for _ in range(2)]
        for x, y in zip(a, b, strict=True):
            np.testing.assert_array_equal(x[0], y[0])
            np.testing.assert_array_equal(x[1], y[1])
        other.close()
    np.testing.assert_array_equal(single.render().shape, (420, 640, 3))


def test_any_structure_can_be_used() -> None:
    """A scene object, its plain form, and the arguments for the same scene give the same numbers; one that knows only its modes can be drawn."""
    plain = {"beam": {"modes": 2}, "absorber": {"kind": "impact", "friction": {"kind": "coulomb", "limit_n": 0.025}}}
    scene = to_scene(plain)
    runs = []
    for given in (RUBBING, {"whole_scene": plain}, {"whole_scene": scene}, {"whole_scene": from_scene(scene)}):
        env = gymnasium.make(V1, render_mode="rgb_array", **PASSAGE, **given)
        env.reset(seed=2)
        runs.append([env.step(np.array([0.5], np.float32))[:2] for _ in range(3)])
        assert env.render().shape == (420, 640, 3)
        described = env.unwrapped.task.describe()
        again = gymnasium.make(V1, **{name: value for name, value in described.items() if value is not None})
        again.reset(seed=2)
        np.testing.assert_array_equal(again.step(np.array([0.5], np.float32))[0], runs[-1][0][0])
    for other in runs[1:]:
        for x, y in zip(runs[0], other, strict=True):
            np.testing.assert_array_equal(x[0], y[0])
            assert x[1] == y[1]
    assert impact_env.Scene is type(scene)


def test_videos_can_be_recorded(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = gymnasium.wrappers.RecordVideo(gymnasium.make(V1, render_mode="rgb_array", **SHORT[V1]), str(tmp_path), episode_trigger=lambda _: True)
    env.reset(seed=0)
    over = False
    while not over:
        *_, end, cut, _ = env.step(np.ones(1, np.float32))
        over = end or cut
    env.close()
    (film,) = tmp_path.glob("*.mp4")
    assert film.stat().st_size > 1000
