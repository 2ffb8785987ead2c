"""A trained agent as a small file with the layers of its actor and its training task.

The agent needs neither torch nor stable-baselines3 to act.
"""

import csv
import io
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from impact_env.envs import ENVIRONMENTS
from impact_env.plain_files import require_readable
from optimisation.files import replacing, write_csv

AGENT_FORMAT = 1
FINAL = "final.npz"
CHECKPOINT_AGENT = "agent.npz"  # in the folder of a checkpoint
TRAINED = Path(__file__).with_name(
    "trained"
)  # TASK_ALGORITHM.zip, the middle one of its seeds by the best evaluation
Map = Callable[[NDArray[np.float32]], NDArray[np.float32]]
ACTIVATIONS: dict[str, Map] = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, np.float32(0))}
SQUASHES: dict[str, Map] = {
    "clip": lambda x: np.clip(x, np.float32(-1), np.float32(1)),
    "tanh": np.tanh,
}
Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
Cells = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
CELLS = ("inputs", "outputs", "biases")  # of an LSTM, as they are called in a file
SHORT = {"RecurrentPPO": "rppo", "RolloutPolicyIteration": "rpi"}


def _sigmoid(x: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(np.float32(0.5) * (np.tanh(np.float32(0.5) * x) + np.float32(1)))


class Memory:
    """Long short-term memory (S. Hochreiter and J. Schmidhuber 1997) of several lanes.

    The gates are in the order input, forget, cell, output.

    ``cells``: weights of the inputs (4 H, features) and of its own outputs (4 H, H), biases (4 H,).
    """

    def __init__(self, cells: Cells) -> None:
        self.cells = cells
        self.start(0)

    def start(self, lanes: int) -> None:
        """Forget everything."""
        self.output, self.state = (
            np.zeros((lanes, self.cells[1].shape[1]), dtype=np.float32) for _ in range(2)
        )

    def see(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return outputs (L, H) after one more row of inputs (L, features)."""
        inputs, outputs, biases = self.cells
        takes, keeps, new, shows = np.split(
            values @ inputs.T + self.output @ outputs.T + biases, 4, axis=1
        )
        self.state = _sigmoid(keeps) * self.state + _sigmoid(takes) * np.tanh(new)
        self.output = _sigmoid(shows) * np.tanh(self.state)
        return self.output


@dataclass(frozen=True, eq=False)
class Agent:
    """A policy that depends on the observation alone: fully connected layers without randomness.

    Attributes
    ----------
    env_id : str
        Environment of the training.
    algorithm : str
        Name of the algorithm.
    seed, steps : int
        Seed and number of steps of the training.
    arguments : mapping
        Arguments of the environment.
    activation, squash : str
        Functions between the layers, and after the last one.
    layers : sequence of (array, array)
        Weights (out, in) and biases (out,) of each layer, from first to last.
    cells : Cells or None
        Recurrent cells (`Memory`) before the layers, None without memory.
    """

    env_id: str
    algorithm: str
    seed: int
    steps: int
    arguments: Mapping[str, Any]
    activation: str
    squash: str
    layers: Sequence[Layer]
    cells: Cells | None = None

    def __post_init__(self) -> None:
        require(
            self.env_id in ENVIRONMENTS,
            "environment of the agent",
            self.env_id,
            f"one of {', '.join(ENVIRONMENTS)}",
        )
        require(
            self.activation in ACTIVATIONS,
            "activation",
            self.activation,
            f"one of {', '.join(ACTIVATIONS)}",
        )
        require(self.squash in SQUASHES, "squash", self.squash, f"one of {', '.join(SQUASHES)}")
        widths = [weights.shape[1] for weights, _ in self.layers] + [
            ENVIRONMENTS[self.env_id].numbers
        ]
        fits = all(
            w.shape == (n, w.shape[1]) and b.shape == (n,)
            for (w, b), n in zip(self.layers, widths[1:], strict=True)
        )
        shapes = [weights.shape for weights, _ in self.layers]
        allowed = "layers that fit one another, to as many numbers as an action has"
        require(len(self.layers) > 0 and fits, "layers", shapes, allowed)
        if self.cells is not None:
            size = self.cells[1].shape[1]
            sizes = (
                self.cells[0].shape[0],
                self.cells[1].shape[0],
                *self.cells[2].shape,
                4 * self.layers[0][0].shape[1],
            )
            require(
                set(sizes) == {4 * size},
                "cells",
                [part.shape for part in self.cells],
                "a memory that fits the first layer",
            )
        object.__setattr__(self, "_memory", None if self.cells is None else Memory(self.cells))

    @property
    def name(self) -> str:
        """Algorithm and seed."""
        return f"{self.algorithm.upper()}, seed {self.seed}"

    def start(self, lanes: int) -> None:
        """Forget earlier episodes."""
        memory: Memory | None = getattr(self, "_memory")  # noqa: B009
        if memory is not None:
            memory.start(lanes)

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions (L, A) for observations (L, features)."""
        values = np.asarray(observations, dtype=np.float32)
        memory: Memory | None = getattr(self, "_memory")  # noqa: B009
        if memory is not None:
            values = memory.see(values)
        for number, (weights, biases) in enumerate(self.layers):
            values = values @ weights.T + biases
            values = (
                ACTIVATIONS[self.activation]
                if number + 1 < len(self.layers)
                else SQUASHES[self.squash]
            )(values)
        return values


def save_agent(path: Path, agent: Agent) -> None:
    """Write an agent; the file appears as a whole or not at all."""
    about = {
        name: getattr(agent, name)
        for name in ("env_id", "algorithm", "seed", "steps", "activation", "squash")
    }
    text = json.dumps({"format": AGENT_FORMAT, **about, "arguments": dict(agent.arguments)})
    arrays = {
        f"{kind}{k}": values
        for k, layer in enumerate(agent.layers)
        for kind, values in zip(("weights", "biases"), layer, strict=True)
    }
    if agent.cells is not None:
        arrays |= dict(zip(CELLS, agent.cells, strict=True))
    with replacing(path) as temporary:
        np.savez(temporary, about=np.array(text), **arrays)  # type: ignore[arg-type]


def list_shipped() -> dict[str, list[str]]:
    """Return the algorithms of which an agent ships with the package, by task."""
    known: dict[str, list[str]] = {}
    for path in sorted(TRAINED.glob("*.zip")):
        task, _, algorithm = path.stem.rpartition("_")
        known.setdefault(task, []).append(algorithm)
    return known


def packaged_file(task: str, algorithm: str = "ppo") -> Path:
    """Return the file of an agent that ships with the package.

    stable-baselines3 can continue the training from this file, which includes critic and optimiser:
    ``PPO.load(file, env=...)``. It also contains the small file that needs no torch. Raises
    ParameterError if there is none.
    """
    known = list_shipped()
    require(task in known, "task", task, f"one of {', '.join(known)}")
    require(algorithm in known[task], "algorithm", algorithm, f"one of {', '.join(known[task])}")
    return TRAINED / f"{task}_{algorithm}.zip"


def load_agent(place: Path | str, algorithm: str = "ppo") -> Agent:
    """Return the agent of a file, or the agent that ships with the package for a task.

    ``place``: a file that `save_agent` wrote, or the name of a task (ActiveGap-v0).

    Raises ParameterError for any other file, task or algorithm.
    """
    path = place if isinstance(place, Path) else packaged_file(place, algorithm)
    require_readable("agent", path, "a file that train wrote")
    try:
        source = io.BytesIO(zipfile.ZipFile(path).read(FINAL)) if path.suffix == ".zip" else path
        with np.load(source, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            require(
                about.pop("format") == AGENT_FORMAT,
                "agent",
                str(path),
                f"a file of format {AGENT_FORMAT}, which this version reads",
            )
            layers = [
                (file[f"weights{k}"], file[f"biases{k}"])
                for k in range(sum(name.startswith("weights") for name in file.files))
            ]
            cells = tuple(file[name] for name in CELLS) if CELLS[0] in file.files else None
        return Agent(**about, layers=layers, cells=cells)
    except ParameterError:
        raise
    except Exception as error:  # of damaged files NumPy and zipfile raise many kinds
        raise ParameterError(
            f"agent = {str(path)!r} is not allowed: a file that train wrote ({error})"
        ) from error


def find_agents(folder: Path, name: str = FINAL, env_id: str | None = None) -> list[Agent]:
    """Return the agents of all files called ``name`` under a folder, optionally of one environment.

    They are in the order of environment, algorithm and seed.
    """
    agents = [load_agent(path) for path in sorted(folder.rglob(name))]
    return sorted(
        (a for a in agents if env_id in (None, a.env_id)),
        key=lambda a: (a.env_id, a.algorithm, a.seed),
    )


def actor_of(model: Any, env_id: str, seed: int, arguments: Mapping[str, Any]) -> Agent:
    """Return the agent with the deterministic actions of a model of stable-baselines3.

    The model is PPO, SAC or recurrent PPO. The other arguments are attributes of `Agent`.
    """
    stochastic_squash = hasattr(model, "actor")
    policy = model.policy
    hidden, last = (
        (model.actor.latent_pi, model.actor.mu)
        if stochastic_squash
        else (policy.mlp_extractor.policy_net, policy.action_net)
    )
    linear = [layer for layer in hidden if hasattr(layer, "weight")] + [last]
    layers = [
        (layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy())
        for layer in linear
    ]
    kind = type(model).__name__
    squash = "tanh" if stochastic_squash else "clip"
    steps = int(model.num_timesteps)
    activation = policy.activation_fn.__name__.lower()
    memory = getattr(policy, "lstm_actor", None)
    cells = None
    if memory is not None:
        names = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
        inputs, outputs, one, other = (
            getattr(memory, f"{name}_l0").detach().numpy().copy() for name in names
        )
        cells = (inputs, outputs, one + other)
    return Agent(
        env_id,
        SHORT.get(kind, kind.lower()),
        seed,
        steps,
        dict(arguments),
        activation,
        squash,
        layers,
        cells,
    )


SETTINGS = "settings.json"
EVALUATIONS = "evaluations.csv"


@dataclass(frozen=True)
class TrainingEvaluation:
    """Scores of an agent after ``steps`` of training, over the evaluation seeds.

    ``score`` is the mean, ``iqm`` the mean of the middle half, ``low`` and ``high`` the 10th and
    90th percentile, and ``intervals`` the mean length of an episode. ``leg`` is the number of the
    leg.
    """

    leg: int
    steps: int
    score: float
    iqm: float
    low: float
    high: float
    intervals: float


COLUMNS = tuple(f.name for f in fields(TrainingEvaluation))


@dataclass(frozen=True)
class Run:
    """A training run.

    It has its ``folder``, its ``settings`` as JSON values, its evaluations from first to last, and
    whether it is finished.
    """

    folder: Path
    settings: dict[str, Any]
    evaluations: tuple[TrainingEvaluation, ...]
    finished: bool

    @property
    def algorithm(self) -> str:
        """Name of the algorithm."""
        return str(self.settings["algorithm"])

    @property
    def seed(self) -> int:
        """The run's seed."""
        return int(self.settings["seed"])

    @property
    def score(self) -> float:
        """Score of the best leg on the evaluation seeds, whose agent the run stores."""
        return max(evaluation.score for evaluation in self.evaluations)


def run_folder(out: Path, task: str, algorithm: str, seed: int) -> Path:
    """Return the folder of a run."""
    return out / task / algorithm / f"seed-{seed}"


def write_evaluations(folder: Path, evaluations: Sequence[TrainingEvaluation]) -> None:
    """Write a run's evaluations as CSV."""
    write_csv(
        folder / EVALUATIONS,
        COLUMNS,
        [list(asdict(evaluation).values()) for evaluation in evaluations],
    )


def read_evaluations(folder: Path) -> tuple[TrainingEvaluation, ...]:
    """Return a run's evaluations, none if it has not reached the first one.

    Raises ParameterError for a damaged file.
    """
    file = folder / EVALUATIONS
    if not file.exists():
        return ()
    try:
        with file.open(newline="", encoding="utf-8") as lines:
            rows = list(csv.DictReader(lines))
        return tuple(
            TrainingEvaluation(
                int(row["leg"]), int(row["steps"]), *(float(row[name]) for name in COLUMNS[2:])
            )
            for row in rows
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ParameterError(
            f"evaluations = {str(file)!r} is not allowed: a table that a training wrote ({error})"
        ) from error


def find_runs(folder: Path) -> list[Run]:
    """Return all runs under a folder, by algorithm and seed."""
    runs = []
    for file in folder.rglob(SETTINGS):
        try:
            settings = json.loads(file.read_text(encoding="utf-8"))
            run = Run(
                file.parent, settings, read_evaluations(file.parent), (file.parent / FINAL).exists()
            )
            runs.append((run.algorithm, run.seed, run))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ParameterError(
                f"settings = {str(file)!r} is not allowed: a file that a training wrote ({error})"
            ) from error
    return [run for _, _, run in sorted(runs, key=lambda entry: entry[:2])]


def _model_of(folder: Path) -> Path:
    """Return the model of a finished run whose actor is the run's agent."""
    agent = (folder / FINAL).read_bytes()
    for checkpoint in sorted((folder / "checkpoints").iterdir(), reverse=True):
        file = checkpoint / CHECKPOINT_AGENT
        if file.is_file() and file.read_bytes() == agent:
            return checkpoint / "model.zip"
    raise ParameterError(
        f"run = {str(folder)!r} is not allowed: one whose checkpoints hold the model of its agent"
    )


def ship(source: Path, target: Path) -> list[Path]:
    """Write the typical run of each task and algorithm under ``source`` as one file.

    It is the file of stable-baselines3, which also contains the agent's own file.
    """
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in find_runs(source):
        if run.finished:
            groups.setdefault((run.folder.parent.parent.name, run.algorithm), []).append(run)
    files = []
    for (task, algorithm), runs in groups.items():
        # the typical run has the median score on the evaluation seeds; of an even number of runs it
        # is the better one of the two in the middle
        ranked = sorted(runs, key=lambda run: (run.score, run.seed))
        folder = ranked[len(runs) // 2].folder
        file = target / f"{task}_{algorithm}.zip"
        model = _model_of(folder)
        target.mkdir(parents=True, exist_ok=True)
        with (
            replacing(file) as temporary,
            zipfile.ZipFile(model) as whole,
            zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive,
        ):
            for name in whole.namelist():
                archive.writestr(name, whole.read(name))
            archive.write(folder / FINAL, FINAL)
        files.append(file)
    return files
