"""Checkpoints of a training run: folders that are whole or absent, of which the last two are kept."""

import json
import os
import shutil
from dataclasses import asdict
from pathlib import Path

from impact_env.parameters import ParameterError
from optimisation.files import write_json
from optimisation.rl.models import Model, ScaledRewards, load_model, save_model
from optimisation.rl.runs import Evaluation

KEPT = 2


def save_checkpoint(folder: Path, leg: int, model: Model, env: ScaledRewards, evaluations: list[Evaluation]) -> None:
    """Write the checkpoint at the end of a leg, and remove those before the last two."""
    target = folder / f"leg-{leg:03d}"
    temporary = folder / f".{target.name}-{os.getpid()}"
    temporary.mkdir(parents=True)
    save_model(temporary, model, env)
    write_json(temporary / "evaluations.json", [asdict(evaluation) for evaluation in evaluations])
    temporary.rename(target)
    for old in checkpoints(folder)[:-KEPT]:
        shutil.rmtree(old)


def checkpoints(folder: Path) -> list[Path]:
    """Return the checkpoints from first to last."""
    return sorted(folder.glob("leg-*"))


def last_checkpoint(folder: Path, algorithm: str, env: ScaledRewards) -> tuple[Model, list[Evaluation]] | None:
    """Return model and evaluations of the last checkpoint that is whole, or None; what is not whole is removed."""
    for half_made in folder.glob(".leg-*"):
        shutil.rmtree(half_made)
    for checkpoint in reversed(checkpoints(folder)):
        try:
            evaluations = [Evaluation(**values) for values in json.loads((checkpoint / "evaluations.json").read_text(encoding="utf-8"))]
            return load_model(checkpoint, algorithm, env), evaluations
        except (ParameterError, OSError, ValueError, TypeError):
            shutil.rmtree(checkpoint)
    return None


def forget_replay(folder: Path) -> None:
    """Remove what SAC remembered: of a finished run it is the larger part by far, and nothing needs it."""
    for file in folder.glob("leg-*/replay.npz"):
        file.unlink()
