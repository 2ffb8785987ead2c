"""Exported agents and rules give the actions of the policy.

They are exported as C source that is compiled, as ONNX, and as tables.
"""

import ctypes
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("gymnasium")

import itertools

from impact_env.checks import ParameterError
from optimisation.cli.rl_export import main
from optimisation.rl import rules
from optimisation.rl.agents import Agent, load_agent, save_agent
from optimisation.rl.export import make_table, write_c, write_onnx
from optimisation.rl.families import Family, FamilyPolicy
from optimisation.rl.rules import EIGHT, env_of, policies

FRICTION = env_of("ActiveFriction-v0")
PASSAGE = env_of("Passage-v0")
LANES = 40
FLOAT_TOL = 2e-5  # of actions: sums of some hundred products in another order, single precision
RULE_TOL = 1e-6  # of actions: a rule computes in double precision


def draw_observations(features: int, steps: int = 3) -> np.ndarray:
    """Return observations (steps, lanes, features), of which most are of order one."""
    drawn = np.random.default_rng(4).normal(size=(steps, LANES, features))
    drawn[..., 8:10] = np.abs(drawn[..., 8:10])  # sizes are above 0,
    drawn[:, ::7, 8:10] *= -0.1  # but for the noise of a sensor
    return drawn.astype(np.float32)


def make_agent(squash: str = "clip", activation: str = "tanh", memory: bool = False) -> Agent:
    """Return an agent of random numbers, two hidden layers."""
    generator = np.random.default_rng(1)

    def draw(*shape: int) -> np.ndarray:
        return (generator.normal(size=shape) / np.sqrt(shape[-1])).astype(np.float32)

    cells = (draw(32, 11), draw(32, 8), draw(32)) if memory else None
    widths = (8 if memory else 11, 16, 12, 1)
    layers = [(draw(after, before), draw(after)) for before, after in itertools.pairwise(widths)]
    return Agent(FRICTION, "ppo", 0, 1, {}, activation, squash, layers, cells)


AGENTS = {
    "clip": make_agent(),
    "tanh and relu": make_agent("tanh", "relu"),
    "memory": make_agent(memory=True),
}


def play(policy: Any, observations: np.ndarray) -> np.ndarray:
    """Return the actions (steps, lanes, A) of a policy."""
    policy.start(LANES)
    return np.array([policy.act(row) for row in observations])


def load_c(source: str, folder: Path) -> Any:
    """Return the compiled library of C source."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    file = folder / "agent.c"
    library = folder / "agent.so"
    file.write_text(source, encoding="utf-8")
    subprocess.run(
        [
            *(compiler, "-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"),
            *(str(file), "-o", str(library), "-lm"),
        ],
        check=True,
    )
    return ctypes.CDLL(str(library))


def play_c(library: Any, observations: np.ndarray, numbers: int, memory: int = 0) -> np.ndarray:
    """Return the actions of C source; ``memory``: numbers in its memory."""
    memories = np.zeros((LANES, memory), dtype=np.float32)
    actions = np.full((*observations.shape[:2], numbers), np.nan, dtype=np.float32)
    for k, rows in enumerate(observations):
        for lane, row in enumerate(rows):
            own = [memories[lane].ctypes.data_as(ctypes.c_void_p)] if memory else []
            library.impact_agent_act(
                *own,
                row.ctypes.data_as(ctypes.c_void_p),
                actions[k, lane].ctypes.data_as(ctypes.c_void_p),
            )
    return actions


@pytest.mark.parametrize("name", AGENTS)
def test_c_source_of_an_agent_gives_its_actions(name: str, tmp_path: Path) -> None:
    agent = AGENTS[name]
    observations = draw_observations(11)
    library = load_c(write_c(agent, FRICTION), tmp_path)
    actions = play_c(library, observations, 1, 16 if agent.cells is not None else 0)
    np.testing.assert_allclose(actions, play(agent, observations), rtol=0, atol=FLOAT_TOL)
    assert np.ptp(actions) > 0.1


RULES = {
    **{task: policies(task)[EIGHT] for task in ("ActiveFriction-v0", "Passage-v0")},
    "Structures-v0": policies("Structures-v0")[EIGHT],
    "phase": FamilyPolicy("phase", rules.Phase(), (0.1, 0.3, 0.4, 0.2, -0.3, 0.1, 0.2, 0.1)),
    "impacts": FamilyPolicy(
        "impacts", rules.PairByImpacts(), (0.1, 0.3, 0.4, 0.2, -0.3, 0.1, 0.2, 0.1)
    ),
    "constant": policies("ActiveGap-v0")[rules.CONSTANT],
    "rule of 12": policies("ActiveGap-v0")[rules.READ],
}


@pytest.mark.parametrize("name", RULES)
def test_c_source_of_a_rule_gives_its_actions(name: str, tmp_path: Path) -> None:
    rule = RULES[name]
    env_id = PASSAGE if isinstance(rule.family, rules.PairBySize) else FRICTION
    env_id = env_of(name) if name == "Structures-v0" else env_id
    observations = draw_observations(14)
    actions = play(rule, observations)
    assert np.isfinite(actions).all()
    library = load_c(write_c(rule, env_id), tmp_path)
    np.testing.assert_allclose(
        play_c(library, observations, actions.shape[-1]), actions, rtol=0, atol=RULE_TOL
    )


def test_a_rule_with_a_memory_is_refused() -> None:
    with pytest.raises(ParameterError, match="a rule without memory"):
        write_c(policies("GapChoice-v1")[EIGHT], env_of("GapChoice-v1"))


@pytest.mark.parametrize("name", AGENTS)
def test_onnx_of_an_agent_gives_its_actions(name: str) -> None:
    runtime = pytest.importorskip("onnxruntime")
    agent = AGENTS[name]
    session = runtime.InferenceSession(write_onnx(agent), providers=["CPUExecutionProvider"])
    memory = [np.zeros((LANES, 8), dtype=np.float32) for _ in range(2)]
    observations = draw_observations(11)
    for observed, wanted in zip(observations, play(agent, observations), strict=True):
        inputs = {"observation": observed}
        if agent.cells is not None:
            inputs |= {"output before": memory[0], "state before": memory[1]}
        action, *memory = session.run(None, inputs)
        np.testing.assert_allclose(action, wanted, rtol=0, atol=FLOAT_TOL)


def read_message(content: bytes) -> dict[int, list[Any]]:
    """Return the fields of a message of Protocol Buffers by their numbers."""
    fields: dict[int, list[Any]] = {}
    at = 0

    def read_integer() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = content[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while at < len(content):
        number, kind = divmod(read_integer(), 8)
        if kind == 0:
            value: Any = read_integer()
        else:
            size = read_integer() if kind == 2 else 4
            value = content[at : at + size]
            at += size
        fields.setdefault(number, []).append(value)
    return fields


def test_onnx_has_the_numbers_of_the_agent_in_their_order() -> None:
    """By a reader of its own: whatever is installed, the weights come back bit for bit."""
    agent = load_agent("ActiveGap-v0", "sac")
    model = read_message(write_onnx(agent))
    graph = read_message(model[7][0])
    assert read_message(model[8][0])[2] == [13]
    tensors = {}
    for part in graph[5]:
        tensor = read_message(part)
        tensors[tensor[8][0].decode()] = np.frombuffer(tensor[9][0], "<f4").reshape(
            tensor.get(1, [])
        )
    for k, (weights, biases) in enumerate(agent.layers):
        np.testing.assert_array_equal(tensors[f"weights {k}"], weights)
        np.testing.assert_array_equal(tensors[f"biases {k}"], biases)
    kinds = [read_message(node)[4][0].decode() for node in graph[1]]
    assert kinds == ["Gemm", "Relu", "Gemm", "Relu", "Gemm", "Tanh"]


@pytest.mark.parametrize("name", AGENTS)
def test_a_table_has_all_that_an_action_needs(name: str) -> None:
    agent = AGENTS[name]
    table = json.loads(json.dumps(make_table(agent, FRICTION)))
    assert len(table["observation"]) == 11
    assert table["observation"][8]["name"] == "time left"
    assert not table["observation"][8]["measured"]
    back = Agent(
        table["environment"],
        "ppo",
        0,
        1,
        {},
        table["activation"],
        table["squash"],
        [
            tuple(np.array(layer[part], np.float32) for part in ("weights", "biases"))
            for layer in table["layers"]
        ],
        tuple(
            np.array(table["memory"][part], np.float32)
            for part in ("weights_of_inputs", "weights_of_outputs", "biases")
        )
        if "memory" in table
        else None,
    )
    observations = draw_observations(11)
    np.testing.assert_array_equal(play(back, observations), play(agent, observations))


def test_the_command_writes_each_form(tmp_path: Path) -> None:
    agent = tmp_path / "agent.npz"
    save_agent(agent, AGENTS["clip"])
    for arguments, ending in (
        (["--task", "ActiveFriction-v0"], "c"),
        (["--task", "ActiveFriction-v0", "--policy", "rpi", "--to", "onnx"], "onnx"),
        (["--agent", str(agent), "--to", "table"], "json"),
    ):
        file = tmp_path / f"policy.{ending}"
        result = CliRunner().invoke(main, [*arguments, "--out", str(file)])
        assert result.exit_code == 0, result.output
        assert file.stat().st_size > 500
        assert str(file) in result.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "a.c"], "--agent"),
        (["--task", "Passage-v0", "--agent", "a.npz", "--out", "a.c"], "either --agent FILE or"),
        (["--task", "Passage-v0", "--to", "onnx", "--out", "a.onnx"], "c or table for a rule"),
        (["--task", "Passage-v0", "--to", "c", "--out", "a.onnx"], r"\.c"),
        (["--task", "SweepRate-v1", "--out", "a.c"], "a rule without memory"),
        (["--task", "Passage-v0", "--policy", "sac", "--out", "a.c"], "algorithm"),
        (
            ["--task", "Passage-v0", "--policy", "rule12", "--out", "a.c"],
            "for rule12 one of Active",
        ),
    ],
)
def test_the_command_refuses(
    arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code != 0
    assert words.replace("\\", "") in result.output
    assert not list(tmp_path.iterdir())


def test_families_have_the_formulas_that_are_exported() -> None:
    """A rule that is chosen for an open task can be exported."""
    for task in ("ActiveFriction-v0", "ActiveGap-v0", "Structures-v0", "Passage-v0"):
        rule = policies(task)[EIGHT]
        assert isinstance(rule.family, Family)
        assert "impact_agent_act" in write_c(rule, env_of(task))
