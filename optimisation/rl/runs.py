"""Training runs on disk: where their files are, and what their evaluations say. No torch is needed to read them."""

import csv
import json
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from impact_env.parameters import ParameterError
from optimisation.files import replacing, write_csv
from optimisation.rl.agents import FINAL

SETTINGS, EVALUATIONS = "settings.json", "evaluations.csv"


@dataclass(frozen=True)
class Evaluation:
    """What an agent reached after ``steps`` of training, over the evaluation seeds.

    ``score``: mean; ``iqm``: mean of the middle half; ``low``, ``high``: 10th and 90th percentile; ``intervals``: mean length of an episode.
    """

    leg: int
    steps: int
    score: float
    iqm: float
    low: float
    high: float
    intervals: float


COLUMNS = tuple(f.name for f in fields(Evaluation))


@dataclass(frozen=True)
class Run:
    """A training run: its ``folder``, ``settings`` as JSON values, evaluations from first to last, and whether it came to its end."""

    folder: Path
    settings: dict[str, Any]
    evaluations: tuple[Evaluation, ...]
    finished: bool

    @property
    def algorithm(self) -> str:
        """Name of the algorithm."""
        return str(self.settings["algorithm"])

    @property
    def seed(self) -> int:
        """The run's seed."""
        return int(self.settings["seed"])


def run_folder(out: Path, task: str, algorithm: str, seed: int) -> Path:
    """Return the folder of a run."""
    return out / task / algorithm / f"seed-{seed}"


def write_evaluations(folder: Path, evaluations: Sequence[Evaluation]) -> None:
    """Write a run's evaluations as CSV."""
    write_csv(folder / EVALUATIONS, COLUMNS, [list(asdict(evaluation).values()) for evaluation in evaluations])


def _evaluation(row: dict[str, str]) -> Evaluation:
    return Evaluation(int(row["leg"]), int(row["steps"]), *(float(row[name]) for name in COLUMNS[2:]))


def read_evaluations(folder: Path) -> tuple[Evaluation, ...]:
    """Return a run's evaluations, none if it has not come to one. Raises ParameterError for a file that is damaged."""
    file = folder / EVALUATIONS
    if not file.exists():
        return ()
    try:
        with file.open(newline="", encoding="utf-8") as lines:
            rows = list(csv.DictReader(lines))
        return tuple(map(_evaluation, rows))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ParameterError(f"evaluations = {str(file)!r} is not allowed: a table that a training wrote ({error})") from error


def find_runs(folder: Path) -> list[Run]:
    """Return all runs under a folder, by algorithm and seed."""
    runs = []
    for file in folder.rglob(SETTINGS):
        try:
            settings = json.loads(file.read_text(encoding="utf-8"))
            run = Run(file.parent, settings, read_evaluations(file.parent), (file.parent / FINAL).exists())
            runs.append((run.algorithm, run.seed, run))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ParameterError(f"settings = {str(file)!r} is not allowed: a file that a training wrote ({error})") from error
    return [run for _, _, run in sorted(runs, key=lambda entry: entry[:2])]


def typical(runs: Sequence[Run]) -> Run:
    """Return the run in the middle by the score of its last evaluation, the better one of two: held-out seeds have no say in what is kept."""
    return sorted(runs, key=lambda run: (run.evaluations[-1].score, run.seed))[len(runs) // 2]


def ship(source: Path, target: Path) -> list[Path]:
    """Write the `typical` run of each task and algorithm under ``source`` as one file, stable-baselines3's with the agent's own in it."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in find_runs(source):
        if run.finished:
            groups.setdefault((run.folder.parent.parent.name, run.algorithm), []).append(run)
    files = []
    for (task, algorithm), runs in groups.items():
        folder, file = typical(runs).folder, target / f"{task}_{algorithm}.zip"
        model = max((folder / "checkpoints").glob("*/model.zip"))
        target.mkdir(parents=True, exist_ok=True)
        with replacing(file) as temporary, zipfile.ZipFile(model) as whole, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in whole.namelist():
                archive.writestr(name, whole.read(name))
            archive.write(folder / FINAL, FINAL)
        files.append(file)
    return files
