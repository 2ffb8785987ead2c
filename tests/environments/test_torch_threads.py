"""A training takes one of torch's threads, and gives the others back, also where it fails."""

from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

import torch
from environment_cases import GAP1 as GAP

from optimisation.rl import training
from optimisation.rl.hyperparameters import settings_for


def test_torch_has_its_threads_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def fails(*_: object) -> None:
        seen.append(torch.get_num_threads())
        raise KeyboardInterrupt

    monkeypatch.setattr(training, "_train", fails)
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        with pytest.raises(KeyboardInterrupt):
            training.train(training.Job(GAP, "ppo", 3, settings_for(GAP, "ppo")), tmp_path / "run")
        assert (seen, torch.get_num_threads()) == ([1], 3)
    finally:
        torch.set_num_threads(before)
