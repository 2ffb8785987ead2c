"""What every environment is to Gymnasium: checks, pickles, seeds, registration, docstrings, frames."""

import pickle
import re
import warnings
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import GAP, PASSIVE, SWEEP, actions, make, vector
from gymnasium.utils.env_checker import check_env

from impact_env.envs import ENVIRONMENTS, register_environments
from impact_env.envs.settings import Settings

pytestmark = pytest.mark.filterwarnings("ignore:.*-v0 is out of date")  # gymnasium says so of everything with a later version


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_gymnasium_has_nothing_to_say(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*-v0 is out of date")
        check_env(make(name).unwrapped, skip_render_check=True)
        check_env(make(name, render_mode="rgb_array", raw_state=True, observation_noise=0.1, observation_delay=2).unwrapped)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_spec_can_be_written_and_read(name: str) -> None:
    first, given = make(name), actions(name, 4, 1)[:, 0]
    spec = gymnasium.envs.registration.EnvSpec.from_json(first.spec.to_json())
    runs = []
    for env in (first, gymnasium.make(spec), gymnasium.make(pickle.loads(pickle.dumps(first.spec)))):
        env.reset(seed=3)
        runs.append([env.step(action)[0] for action in given])
    np.testing.assert_array_equal(runs[1:], [runs[0], runs[0]])


def test_seeds_decide_all_draws() -> None:
    env = make(SWEEP)
    draws = {}
    for seed in (0, 1, 0):
        _, info = env.reset(seed=seed)
        drawn = (info["force"], info["frequency_ratio"], env.unwrapped.task.runs.orders["phase"][0])
        assert draws.setdefault(seed, drawn) == drawn
    assert draws[0] != draws[1]
    starts = {vector(SWEEP, 16).reset(seed=0)[1]["frequency_ratio"][lane] for lane in range(16)}
    assert starts == {0.96, 0.98}


def test_noise_and_delay_touch_measured_features_only() -> None:
    seen = []
    for arguments in ({}, {"observation_noise": 0.1}, {"observation_delay": 2}):
        env = make(PASSIVE, **arguments)
        seen.append([env.reset(seed=5)[0]] + [env.step(0)[0] for _ in range(5)])
    clean, noisy, late = np.array(seen)
    measured, known = [0, 1, 2, 3, 4, 5, 8], [6, 7, 9]
    for other in (noisy, late):
        np.testing.assert_array_equal(other[:, known], clean[:, known])
    assert np.all(noisy[:, measured] != clean[:, measured])
    assert np.std((noisy - clean)[:, measured]) == pytest.approx(0.1, rel=0.4)
    np.testing.assert_array_equal(late[2:, measured], clean[:-2, measured])
    np.testing.assert_array_equal(late[:2, measured], clean[[0, 0]][:, measured])


def test_names_are_registered_once_and_have_the_package_as_their_prefix() -> None:
    before = {name: gymnasium.registry[name] for name in ENVIRONMENTS}
    register_environments()
    assert all(gymnasium.registry[name] is before[name] for name in ENVIRONMENTS)
    assert gymnasium.make(f"impact_env:{PASSIVE}", interval=1.0).spec.id == PASSIVE


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_docstring_has_gymnasiums_sections_and_all_arguments(name: str) -> None:
    env = make(name).unwrapped
    text = type(env).__doc__ or ""
    for section in ("Description", "Action Space", "Observation Space", "Rewards", "Starting State", "Episode End", "Arguments", "Version History"):
        assert f"## {section}" in text
    if name != PASSIVE:  # and of the suite's names: those with noise and delay are arguments of v1
        assert len(env.task.features) == sum(line.strip().startswith("| ") for line in text.splitlines()) - 2
    described = {type(own).__name__: type(own).__doc__ or "" for own in (make(other).unwrapped for other in ENVIRONMENTS)}
    described["Settings"] = Settings.__doc__ or ""
    referred, read = [text], set[str]()
    while referred:  # an argument stands here, or in a docstring that this one refers to
        read.add(referred.pop())
        found = {name for one in read for name in re.findall(r"`(?:[\w.]+\.)?(\w+Env|Settings)`", one)}
        referred = [own for own in (described[name] for name in found) if own not in read]
    arguments = {field.name for group in type(env).kind.groups for field in fields(group)}
    assert not {argument for argument in arguments if not any(f"``{argument}``" in one for one in read)}


def test_frames_show_the_motion() -> None:
    env = make(GAP, render_mode="rgb_array")
    env.reset(seed=0)
    frames = [env.render()]
    for action in actions(GAP, 3, 1)[:, 0]:
        env.step(action)
        frames.append(env.render())
    for frame in frames:
        assert (frame.dtype, frame.shape) == (np.uint8, (420, 640, 3))
        assert frame.min() < 60 < 250 < frame.max()
    assert all(np.mean(a != b) > 0.001 for a, b in pairwise(frames))
    many = vector(GAP, 2, render_mode="rgb_array")
    many.reset(seed=0)
    np.testing.assert_array_equal(many.render()[0], frames[0])


def test_a_window_shows_what_rgb_array_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window, picture = make(GAP, render_mode="human"), make(GAP, render_mode="rgb_array")
    for env in (window, picture):
        env.reset(seed=0)
        env.render()  # the strips have a point for each picture; a window draws one by itself after each step
        env.step(actions(GAP, 1, 1)[0, 0])
    shown = np.swapaxes(pygame.surfarray.array3d(pygame.display.get_surface()), 0, 1)
    np.testing.assert_array_equal(shown, picture.render())
    window.close()
    assert pygame.display.get_surface() is None
