"""A disturbance beside the sweep, and a base that moves in the place of the force."""

import pickle
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from environment_cases import ACTIVE_FRICTION, ADAPTIVE, STRUCTURES, actions, make, vector

from impact_env import Beam, ParameterError, modal_model

SHAKEN = {"kind": "random", "quantity": "base_acceleration", "spectrum": [[20.0, 0.5], [60.0, 0.5]], "duration_s": 2.0, "seed": 4}


@pytest.mark.parametrize("name", [ACTIVE_FRICTION, ADAPTIVE])
def test_lanes_are_single_environments_and_snapshots_go_on(name: str) -> None:
    """Bit for bit, each lane with a part of the record of its own; no episode ends in these steps."""
    extra: dict[str, Any] = {"load": SHAKEN, "moves_base": True, "force": (1.0, 3.0), "raw_state": True}
    many, singles = vector(name, 3, **extra), [make(name, **extra) for _ in range(3)]
    many.reset(seed=7)
    for lane, env in enumerate(singles):
        env.reset(seed=7 + lane)
    kept, seen = b"", []
    for k, action in enumerate(actions(name, 4, 3)):
        if k == 2:
            kept = pickle.dumps(many.unwrapped.snapshot())
        seen.append(many.step(action))
        for lane, env in enumerate(singles):
            observation, reward, _, _, info = env.step(action[lane])
            np.testing.assert_array_equal(seen[-1][0][lane], observation)
            np.testing.assert_array_equal(seen[-1][4]["state"][lane], info["state"])
            assert seen[-1][1][lane] == reward
    assert len({float(state[0]) for state in seen[-1][4]["state"]}) == 3
    other = vector(name, 3, **extra)
    other.reset(seed=1)
    other.unwrapped.restore(pickle.loads(kept))
    for action, expected in zip(actions(name, 4, 3)[2:], seen[2:], strict=True):
        np.testing.assert_array_equal(other.step(action)[4]["state"], expected[4]["state"])


def test_without_absorber_the_base_is_answered_in_closed_form() -> None:
    """RMS of the last period, of an absorber that weighs nothing; a disturbance changes it."""
    model = modal_model(Beam(modes=2, damping_ratio=0.05))
    slots = model.omega**2 - model.omega[0] ** 2 + 2j * model.damping_ratio * model.omega * model.omega[0]
    expected, found = abs(np.sum(model.level_shape * model.base_participation / slots)) / np.sqrt(2), []
    light: dict[str, Any] = {"absorber": "friction", "absorber_options": {"mass_ratio": 1e-9}, "friction_range": (1e-9, 1e-8)}
    arguments = light | {"beam": {"damping_ratio": 0.05}, "frequency_ratio": 1.0, "time_budget": 21.0, "force": 1.0, "moves_base": True}
    for load in (None, SHAKEN):
        env = make(ACTIVE_FRICTION, load=load, **arguments)
        env.reset(seed=0)
        found.append(np.sqrt(np.mean([env.step(np.zeros(1, np.float32))[4]["rms"] ** 2 for _ in range(80)][-4:])) / expected)
    assert found[0] == pytest.approx(1.0, abs=0.01)
    assert abs(found[1] - 1.0) > 0.05


def test_what_cannot_be_is_refused_by_name() -> None:
    shock = {"kind": "shock", "pulse": "triangle", "peak_n": 1.0, "pulse_s": 0.1, "duration_s": 0.2}
    cases: list[tuple[str, dict[str, Any], str]] = [
        (ACTIVE_FRICTION, {"load": shock}, "one load of the kind random or samples"),
        (ACTIVE_FRICTION, {"load": {"kind": "random"}}, "spectrum"),
        (ACTIVE_FRICTION, {"load": SHAKEN, "method": "moreau"}, "forces with Moreau"),
        (ACTIVE_FRICTION, {"moves_base": 1}, "moves_base = 1"),
        (STRUCTURES, {"moves_base": True}, "base_participation"),
    ]
    for name, arguments, words in cases:
        with pytest.raises(ParameterError, match=words):
            make(name, **arguments)
