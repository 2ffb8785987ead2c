"""Every environment follows the rules of Gymnasium and refuses wrong arguments.

The tests cover Gymnasium's checks, pickles, seeds, registration, docstrings and frames.
"""

import pickle
import re
import warnings
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import (
    ACTIVE_FRICTION,
    ACTIVE_GAP,
    ADAPTIVE,
    GAP,
    LIMITED,
    PASSIVE,
    SHAKEN,
    STRUCTURES,
    SWEEP,
    V1,
    actions,
    make,
    vector,
)
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from places import fresh

from impact_env import Beam, ParameterError, Scene, impact_absorber, modal_model
from impact_env.envs import ENVIRONMENTS, drawing, register_environments
from impact_env.envs.arguments import read_parameters
from impact_env.envs.settings import TaskSettings
from impact_env.modes import mode_shapes

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*-v0 is out of date"
)  # gymnasium says so of everything with a later version


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_gymnasium_has_nothing_to_say(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*-v0 is out of date")
        check_env(make(name).unwrapped, skip_render_check=True)
        check_env(
            make(
                name,
                render_mode="rgb_array",
                raw_state=True,
                observation_noise=0.1,
                observation_delay=2,
            ).unwrapped
        )


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_spec_can_be_written_and_read(name: str) -> None:
    first = make(name)
    chosen = actions(name, 4, 1)[:, 0]
    spec = gymnasium.envs.registration.EnvSpec.from_json(first.spec.to_json())
    runs = []
    for env in (
        first,
        gymnasium.make(spec),
        gymnasium.make(pickle.loads(pickle.dumps(first.spec))),
    ):
        env.reset(seed=3)
        runs.append([env.step(action)[0] for action in chosen])
    np.testing.assert_array_equal(runs[1:], [runs[0], runs[0]])


def test_noise_and_delay_touch_measured_features_only() -> None:
    observed = []
    for arguments in ({}, {"observation_noise": 0.1}, {"observation_delay": 2}):
        env = make(PASSIVE, **arguments)
        observed.append([env.reset(seed=5)[0]] + [env.step(0)[0] for _ in range(5)])
    clean, noisy, late = np.array(observed)
    measured = [0, 1, 2, 3, 4, 5, 8]
    known = [6, 7, 9]
    for other in (noisy, late):
        np.testing.assert_array_equal(other[:, known], clean[:, known])
    assert np.all(noisy[:, measured] != clean[:, measured])
    assert np.std((noisy - clean)[:, measured]) == pytest.approx(0.1, rel=0.4)
    np.testing.assert_array_equal(late[2:, measured], clean[:-2, measured])
    np.testing.assert_array_equal(late[:2, measured], clean[[0, 0]][:, measured])


@pytest.mark.slow
def test_names_are_registered_by_the_import_that_their_prefix_asks_for_and_only_once() -> None:
    """In a process that has imported nothing of the package."""
    code = f"import gymnasium; print(gymnasium.make('impact_env:{PASSIVE}', interval=1.0).spec.id)"
    assert fresh("-W", "error", "-c", code).stdout.strip() == PASSIVE
    before = {name: gymnasium.registry[name] for name in ENVIRONMENTS}
    register_environments()
    assert all(gymnasium.registry[name] is before[name] for name in ENVIRONMENTS)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_docstring_has_gymnasiums_sections_and_all_arguments(name: str) -> None:
    env = make(name).unwrapped
    text = type(env).__doc__ or ""
    for section in (
        "Description",
        "Action Space",
        "Observation Space",
        "Rewards",
        "Starting State",
        "Episode End",
        "Arguments",
        "Version History",
    ):
        assert f"## {section}" in text
    if name != PASSIVE:  # and of the suite's names: those with noise and delay are arguments of v1
        rows = re.findall(r"^\| \d+ \|", text, re.MULTILINE)
        assert len(rows) == len(env.task.features)
    shared = read_parameters(TaskSettings)
    for group in type(env).kind.groups:
        meanings = read_parameters(group)
        for argument in (field.name for field in fields(group)):
            assert meanings[argument]
            assert argument in shared or f"- ``{argument}`` (default" in text


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
    window = make(GAP, render_mode="human")
    picture = make(GAP, render_mode="rgb_array")
    for env in (window, picture):
        env.reset(seed=0)
        # the strips have a point for each picture; a window draws one by itself after each step
        env.render()
        env.step(actions(GAP, 1, 1)[0, 0])
    displayed = np.swapaxes(pygame.surfarray.array3d(pygame.display.get_surface()), 0, 1)
    np.testing.assert_array_equal(displayed, picture.render())
    window.close()
    assert pygame.display.get_surface() is None


def test_amplitudes_along_the_beam_are_those_of_the_mode_that_moves_the_place_of_the_level() -> (
    None
):
    """Amplitudes along the beam are those of the mode that moves the level's place.

    The modes of a pinned beam are sines. At a quarter of its length the fourth mode has a node and
    the second is largest.
    """
    beam = Beam(ends="pinned-pinned", modes=4, elements=60, absorber_position=0.25)
    x = np.linspace(0, 1, drawing.POSITIONS + 1)
    shapes = mode_shapes(beam, x)
    level_shape = modal_model(beam).level_shape
    for resonance, sine in ((1, 1), (2, 2), (3, 3), (4, 2)):
        relative = drawing.relative_amplitudes(shapes, level_shape, resonance)
        expected = np.abs(np.sin(sine * np.pi * x) / np.sin(sine * np.pi / 4))
        np.testing.assert_allclose(relative, expected, atol=1e-4)
    np.testing.assert_array_equal(drawing.relative_amplitudes(shapes, np.zeros(4), 1), 0.0)


def test_an_absorber_at_a_node_can_be_drawn() -> None:
    """An absorber at a node can be drawn.

    The band is that of the second mode. The first mode's shape at the absorber is 0, or almost 0.
    """
    frames = []
    for first in (0.0, 1e-9):
        model = replace(modal_model(Beam(modes=2)), tip_shape=[first, 2.0], beam=None)
        scene = Scene(model, impact_absorber(friction_limit=0.025))
        env = make(V1, render_mode="rgb_array", whole_scene=scene)
        env.reset(seed=0)
        for _ in range(3):
            env.step(np.array([0.5], np.float32))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            frames.append(env.render())
    np.testing.assert_array_equal(*frames)


def test_a_beam_with_another_damping_is_drawn_as_a_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the damping differs, so the beam's own shapes hold: no straight line is drawn."""
    monkeypatch.setattr("impact_env.envs.drawing.straight_shapes", pytest.fail)
    for name, arguments in ((ACTIVE_FRICTION, {"damping_error": (-0.3, 0.3)}), (LIMITED, {})):
        env = make(name, render_mode="rgb_array", **arguments)
        env.reset(seed=0)
        assert env.render().shape == (420, 640, 3)


# Calls in a wrong order, and impossible actions, arguments and resets.


def test_order_of_calls_is_enforced() -> None:
    env = make(SWEEP).unwrapped
    many = vector(SWEEP, 2)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(1, np.float32))
    with pytest.raises(ResetNeeded):
        many.step(np.zeros((2, 1), np.float32))
    with pytest.raises(ResetNeeded):
        many.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ResetNeeded, match="snapshot"):
        many.unwrapped.snapshot()
    many.reset(seed=0)
    with pytest.raises(
        ParameterError, match="lanes of the snapshot = 2 is not allowed: num_envs = 3"
    ):
        vector(SWEEP, 3).unwrapped.restore(many.unwrapped.snapshot())
    env.reset(seed=0)
    end = False
    while not end:
        end = env.step(np.ones(1, np.float32))[2]
    with pytest.raises(ResetNeeded, match="over"):
        env.step(np.zeros(1, np.float32))


WRONG_ACTIONS = (
    np.array([np.nan], np.float32),
    np.array([np.inf]),
    np.zeros(2),
    0.5,
    "up",
    None,
    [[0.1]],
    [0.1 + 0.2j],
    [0j],
)


@pytest.mark.parametrize(
    ("name", "wrong"), [(SWEEP, WRONG_ACTIONS), (PASSIVE, (1, -1, 0.5, np.nan, None))]
)
def test_impossible_actions_are_refused(name: str, wrong: tuple[Any, ...]) -> None:
    env = make(name).unwrapped
    env.reset(seed=0)
    for bad in wrong:
        with pytest.raises(ParameterError, match="action"):
            env.step(bad)
    assert (
        env.step(np.zeros(1, np.float32) if name == SWEEP else 0)[4]["time"] == 5.0
    )  # nothing has happened


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        (SWEEP, {"forces": 1.0}, "forces is not an argument"),
        (SWEEP, {"beam": {"lenght": 1.0}}, "beam = {'lenght': 1.0}"),
        (V1, {"budget_end": "cut"}, "budget_end = 'cut'"),
        (V1, {"whole_scene": {"beem": {}}}, "beem"),
        (V1, {"whole_scene": {}, "modes": 2}, "modes = 2"),
        (ADAPTIVE, {"gap_limits": (0.0, 1e-3)}, "gap_limits"),
        (ADAPTIVE, {"absorber": "stuck", "absorber_options": {}}, "absorber"),
        (SWEEP, {"method": "runge-kutta"}, "method"),
        (SWEEP, {"limits": (0.5, 20.0)}, "samples_per_period = 32 is not allowed: 80 or more"),
        (SWEEP, {"direction": "left"}, "direction = 'left'"),
        (SWEEP, {"objective": "rms"}, "objective = 'rms'"),
        (SWEEP, {"observation_delay": 0.5}, "observation_delay = 0.5"),
        (ACTIVE_GAP, {"gap_speed": 0.0}, "gap_speed = 0.0"),
        (ACTIVE_FRICTION, {"frequency_ratio": (1.0, 0.9)}, "frequency_ratio"),
        (LIMITED, {"start_spread": 0.06}, "start_spread = 0.06"),
        (STRUCTURES, {"split": "exam"}, "split = 'exam'"),
        (STRUCTURES, {"modes": 3}, "modes = 3"),
        (STRUCTURES, {"moves_base": True}, "base_participation"),
        (ACTIVE_FRICTION, {"load": SHAKEN | {"kind": "shock"}}, "load"),
        (
            ACTIVE_FRICTION,
            {"load": SHAKEN | {"seed": 10**5000}},
            "load = dict with a whole number of very many digits",
        ),
        (ACTIVE_FRICTION, {"load": SHAKEN, "method": "moreau"}, "forces with Moreau"),
        (PASSIVE, {"vector_reward": True}, "without a vector of costs"),
        (
            SWEEP,
            {"limits": (0.9, 1.0), "rates": (1.0, 1e9)},
            "rates = (1.0, 1000000000.0) is not allowed",
        ),
        (
            LIMITED,
            {"sweep_rates": (1e9, 1e10)},
            (
                "sweep_rates = (1000000000.0, 10000000000.0) is not allowed: in % per 100 pseudo "
                "periods"
            ),
        ),
        (
            LIMITED,
            {"limits": (1.0, 1.0)},
            "start_spread = 0.01 is not allowed: less than half the width of limits",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode")
def test_impossible_arguments_are_named(name: str, arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError) as error:
        gymnasium.make(name, **arguments)
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        (SWEEP, {"speed": 1}, "options"),
        (ACTIVE_FRICTION, {"force": 0.0}, "options['force'] = 0"),
        (ACTIVE_FRICTION, {"frequency_ratio": 2.0}, "0.96 to 1.02"),
        (ACTIVE_FRICTION, {"force": "much"}, "force"),
        (ACTIVE_FRICTION, {"structure": 1}, "only force"),
        (
            STRUCTURES,
            {"structure": 0.5},
            "options['structure'] = 0.5 is not allowed: a whole number from 0 to 4",
        ),
    ],
)
def test_what_no_reset_can_choose_is_refused(
    name: str, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ParameterError) as error:
        make(name).reset(options=options)
    assert words in str(error.value)


def test_impossible_masks_seeds_and_vectors_are_refused() -> None:
    env = make(SWEEP).unwrapped
    many = vector(SWEEP, 2)
    many.reset(seed=0)
    for mask in (np.array([True]), np.array([False, False]), np.array([1, 0]), [True, False]):
        with pytest.raises(ParameterError, match="reset_mask"):
            many.reset(options={"reset_mask": mask})
    for one, seeds in (
        (env, (1.5, -1, "1", True)),
        (many, (1.5, -1, "1", True, [1, 2, 3], [1, 1.5], [0, -2])),
    ):
        for seed in seeds:
            with pytest.raises(ParameterError, match="seed"):
                one.reset(seed=seed)
    np.testing.assert_array_equal(env.reset(seed=np.int64(3))[0], env.reset(seed=3)[0])
    for name, values in (
        ("num_envs", (0,)),
        ("autoreset_mode", ("next", None, 1)),
        ("max_episode_steps", (0, 2.5, "3")),
    ):
        for value in values:
            with pytest.raises(ParameterError, match=name):
                gymnasium.make_vec(SWEEP, **({"num_envs": 1} | {name: value}))
    for mode in ("NEXT_STEP", "NextStep"):
        assert (
            vector(SWEEP, 1, autoreset_mode=mode).metadata["autoreset_mode"]
            is AutoresetMode.NEXT_STEP
        )
    assert vector(SWEEP, 1, max_episode_steps=-1).unwrapped.task.limit is None
