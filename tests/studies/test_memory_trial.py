"""The trial of memory: what acts on several observations acts as its model does in training."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from studies.cli import memory_trial as study
from studies.study import Measurement


def test_a_stacked_policy_gives_its_model_the_frames_of_training(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(study, "LANES", 3)
    model = study.make_model(study.STACKED, 0)
    lanes = model.get_env()
    policy = study.StackedPolicy(model)
    policy.start(3)
    frames = lanes.reset()
    width = frames.shape[1] // study.FRAMES
    for _ in range(study.FRAMES + 4):
        wanted = model.predict(frames, deterministic=True)[0]
        np.testing.assert_array_equal(policy.act(frames[:, -width:]), wanted)
        frames = lanes.step(wanted)[0]
    assert np.ptp(wanted) > 0


def test_the_table_compares_agents_on_the_same_episodes() -> None:
    generator = np.random.default_rng(0)
    hard = generator.normal(size=40)  # episodes differ more than agents
    rows = [
        {"kind": kind, "seed": seed, "scores": (hard + gain + 0.01 * seed).tolist()}
        for kind, gain in ((study.LAST, 0.0), (study.STACKED, 0.5))
        for seed in range(3)
    ]
    text = study.make_table(
        Measurement({"rows": rows, "settings": {"steps": 1000, "episodes": 40}})
    )
    (line,) = (line for line in text.splitlines() if study.STACKED in line)
    assert "+0.500 [+0.4" in line
    assert "| 3 |" in line.replace("      ", " ").replace("  ", " ")
