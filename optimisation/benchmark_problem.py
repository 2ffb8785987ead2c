"""A design problem with the attributes and methods of EngiBench's problems, for optimisers and generative models that are written for those.

The names and what calls take are theirs, of version 0.2 (tests/design/test_engibench_names.py holds them); EngiBench itself is not needed. A design
is a row of coordinates of the problem's space. The space is a Gymnasium one (extra ``rl``).
"""

from __future__ import annotations

import tempfile
import webbrowser
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from enum import Enum, auto
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from impact_env.extras import optional
from impact_env.parameters import Beam, count, require
from optimisation.designs import Design, design_space
from optimisation.evaluation import Executor
from optimisation.objectives import Condition, Constraint
from optimisation.problem import Problem

with optional():
    from gymnasium import spaces

Array = NDArray[np.float64]
SAMPLES, TRAIN = 64, 0.8  # of the data set


class ObjectiveDirection(Enum):
    """Whether less or more of an objective is better."""

    MINIMIZE = auto()
    MAXIMIZE = auto()


@dataclass(frozen=True)
class Conditions:
    """What a design is for: force in N, resonance, the beam's damping ratio."""

    force: float = 3.5
    resonance: int = 1
    damping_ratio: float = 0.01


@dataclass(frozen=True)
class Config(Conditions):
    """All that the ``config`` of a call may change: the conditions, the members of a run, and the sweep rate (None: what suits the damping)."""

    members: int = 4
    rate: float | None = None


@dataclass(frozen=True)
class OptiStep:
    """One design of an optimisation: its objectives, as `ImpactAbsorberProblem.simulate` gives them, and its number."""

    obj_values: Array
    step: int


@dataclass(frozen=True)
class Violation:
    """A design that is not allowed: the constraint's name and why."""

    constraint: str
    cause: str

    def __str__(self) -> str:
        return f"{self.constraint}: {self.cause}"


@dataclass(frozen=True)
class Violations:
    """What a design breaks, of ``n_constraints`` bounds and constraints. All of it is an error, and none is of a category."""

    violations: list[Violation]
    n_constraints: int

    def by_criticality(self, criticality: Enum) -> Violations:
        """Return the violations of a criticality, by its name: Error or Warning."""
        return self if criticality.name == "Error" else Violations([], self.n_constraints)

    def by_category(self, category: Enum) -> Violations:  # noqa: ARG002 - theirs
        """Return the violations of a category: none."""
        return Violations([], self.n_constraints)

    def __len__(self) -> int:
        return len(self.violations)

    def __str__(self) -> str:
        return "\n".join(map(str, self.violations))


# in the class these names are attributes
_Conditions = Conditions
_Config = Config


class ImpactAbsorberProblem:
    """The level of a beam's free end with an absorber of a concept, relative to no absorber, as one objective to be minimised."""

    version = 0
    dataset_id = "impact-absorber-simulated-v0"  # of no hub: `dataset` is simulated
    container_id = None
    Conditions = _Conditions
    Config = _Config
    design_constraints = ()

    def __init__(
        self,
        seed: int = 0,
        config: Mapping[str, Any] | None = None,
        *,
        concept: str = "impact",
        beam: Beam | None = None,
        constraints: tuple[Constraint, ...] = (),
        executor: Executor | None = None,
    ) -> None:
        """Raises ParameterError as `Problem` does."""
        self._concept, self._beam, self._constraints = concept, Beam() if beam is None else beam, constraints
        self._executor = executor
        self.config = _Config()
        self.config = self._config(config or {})
        self.reset(seed)

    @property
    def conditions(self) -> _Conditions:
        """The conditions among `config`."""
        return _Conditions(**{key: getattr(self.config, key) for key in (field.name for field in fields(_Conditions))})

    @property
    def conditions_keys(self) -> list[str]:
        """Names of the conditions."""
        return [field.name for field in fields(_Conditions)]

    @property
    def objectives(self) -> tuple[tuple[str, ObjectiveDirection], ...]:
        """Names and directions of what `simulate` returns."""
        direction = {False: ObjectiveDirection.MINIMIZE, True: ObjectiveDirection.MAXIMIZE}
        return tuple((objective.kind, direction[objective.maximise]) for objective in self.problem.objectives)

    @property
    def objectives_keys(self) -> list[str]:
        """Names of the objectives."""
        return [name for name, _ in self.objectives]

    @property
    def design_space(self) -> spaces.Box:
        """The coordinates' box; see `DesignSpace`."""
        return spaces.Box(self.problem.space.low, self.problem.space.high, dtype=np.float64)

    def _config(self, changes: Mapping[str, Any]) -> _Config:
        known = asdict(self.config)
        unknown = sorted(set(changes) - set(known))
        require(not unknown, "config", unknown, f"keys among {', '.join(known)}")
        return _Config(**{**known, **changes})

    def _problem(self, config: Mapping[str, Any]) -> Problem:
        chosen = self._config(config)
        beam = replace(self._beam, damping_ratio=chosen.damping_ratio)
        given: dict[str, Any] = {"members": chosen.members, "seed": self._members_seed, "rate": chosen.rate}
        condition = Condition(chosen.resonance, chosen.force)
        return Problem(design_space(self._concept), (condition,), constraints=self._constraints, beam=beam, **given)

    def reset(self, seed: int | None = None) -> None:
        """Begin anew with a seed of members and random designs; None: a random one."""
        self.seed = None if seed is None else count("seed", seed, 0)
        self.np_random = np.random.default_rng(self.seed)
        self._members_seed = int(self.np_random.integers(2**31)) if self.seed is None else self.seed
        self._samples: dict[str, dict[str, Array]] | None = None
        self.problem = self._problem({})

    def simulate(self, design: ArrayLike, config: Mapping[str, Any] | None = None) -> Array:
        """Return the objectives of a design, (objectives,), in their own direction; NaN if it failed."""
        problem = self._problem(config or {})
        signs = np.array([-1.0 if objective.maximise else 1.0 for objective in problem.objectives])
        return np.asarray(signs * problem.evaluate(np.asarray(design, dtype=np.float64)[None], executor=self._executor).F[0])

    def check_constraints(self, design: ArrayLike, config: Mapping[str, Any] | None = None) -> Violations:
        """Return what a design breaks: a bound of the space, or a constraint of the problem (which takes its runs); empty if it is allowed."""
        return Violations(self._broken(design, config), len(self.problem.space.free) + len(self._constraints))

    def _broken(self, design: ArrayLike, config: Mapping[str, Any] | None) -> list[Violation]:
        problem, row = self._problem(config or {}), np.asarray(design, dtype=np.float64)
        space = problem.space
        outside = (row < space.low) | (row > space.high) | ~np.isfinite(row)
        found = [
            Violation(v.name, f"{x:g} is not from {v.low:g} to {v.high:g} {v.unit}".rstrip())
            for v, x, out in zip(space.free, row, outside, strict=True)
            if out
        ]
        if found or not problem.constraints:
            return found
        G = problem.evaluate(row[None], executor=self._executor).G[0]
        return [
            Violation(constraint.name, f"the limit of {constraint.limit:g} is exceeded by {100 * g:.3g} %" if np.isfinite(g) else "a run failed")
            for constraint, g in zip(problem.constraints, G, strict=True)
            if not g <= 0
        ]

    def random_design(self) -> tuple[Array, int]:
        """Return a design of the data set's part ``train``, which need not be simulated for it, and its index there."""
        number = int(self.np_random.integers(_trained(SAMPLES)))
        return self._spread(SAMPLES)[number], number

    def _spread(self, samples: int) -> Array:
        """Return designs spread evenly over the space (in logarithms where ratios matter), (samples, variables)."""
        points = qmc.Halton(len(self.problem.space.free), rng=np.random.default_rng(self._members_seed)).random(samples)
        return np.array([self._coordinates(row) for row in points])

    def _coordinates(self, shares: Array) -> Array:
        return np.array([v.value_at(float(share)) for v, share in zip(self.problem.space.free, shares, strict=True)])

    def optimize(self, starting_point: ArrayLike, config: Mapping[str, Any] | None = None, *, designs: int = 40) -> tuple[Array, list[OptiStep]]:
        """Return the best of a pattern search from a design, and its history: a simple baseline, `optimisation.search.find` is the real search.

        Each round tries every coordinate both ways in one batch; a round that betters nothing halves the step.
        """
        problem, space = self._problem(config or {}), self._problem(config or {}).space
        shares = np.array(space.shares(space.decoded(dict(zip((v.name for v in space.free), np.ravel(starting_point).tolist(), strict=True)))))
        best, step, history = np.inf, 0.15, list[OptiStep]()
        batch = shares[None]
        while True:
            F = problem.evaluate(np.array([self._coordinates(row) for row in batch]), executor=self._executor).F
            history += [OptiStep(row, len(history) + k) for k, row in enumerate(F)]
            k = int(np.nanargmin(F[:, 0])) if np.isfinite(F[:, 0]).any() else 0
            if F[k, 0] < best:
                best, shares = float(F[k, 0]), batch[k]
            elif len(history) > 1:
                step /= 2
            batch = np.clip(shares + step * np.concatenate([np.eye(len(shares)), -np.eye(len(shares))]), 0, 1)
            if len(history) + len(batch) > designs:
                return self._coordinates(shares), history

    @property
    def dataset(self) -> dict[str, dict[str, Array]]:
        """Two sets, ``train`` and ``test``, of designs (N, variables) spread evenly over the space, with what was simulated of them on first use."""
        if self._samples is None:
            self._samples = self.make_dataset(SAMPLES)
        return self._samples

    def make_dataset(self, samples: int) -> dict[str, dict[str, Array]]:
        """Simulate ``samples`` designs; see `dataset`. Beside the designs there is a column for each objective and condition."""
        X = self._spread(count("samples", samples, 2))
        F, G, spread = self.problem.evaluate(X, executor=self._executor)
        signs = np.array([-1.0 if objective.maximise else 1.0 for objective in self.problem.objectives])
        columns = {"design": X, "objectives": F, "constraints": G, "spread": spread}
        columns |= {name: (signs * F)[:, k] for k, name in enumerate(self.objectives_keys)}
        columns |= {name: np.full(samples, getattr(self.config, name)) for name in self.conditions_keys}
        cut = _trained(samples)
        parts = {"train": slice(None, cut), "test": slice(cut, None)}
        return {name: {column: values[part] for column, values in columns.items()} for name, part in parts.items()}

    def design_of(self, design: ArrayLike) -> Design:
        """Return a row of coordinates as an absorber's design in SI units."""
        return self.problem.space.decoded(dict(zip((v.name for v in self.problem.space.free), np.ravel(design).tolist(), strict=True)))

    def render(self, design: ArrayLike, *, open_window: bool = False, path: Path | None = None) -> str:
        """Return a design in words; with a ``path`` draw its free coordinates within their bounds there too (matplotlib).

        ``open_window`` shows the drawing, of a temporary file if there is no path, in the machine's viewer.
        """
        chosen = self.design_of(design)
        if path is None and open_window:
            path = Path(tempfile.mkdtemp()) / "design.png"
        if path is not None:
            from optimisation.report.design_card import save_card

            save_card(path, self.problem.space, chosen)
            if open_window:
                webbrowser.open(path.resolve().as_uri())
        return str(chosen)


def _trained(samples: int) -> int:
    """Return how many of so many samples are in the part ``train``."""
    return max(1, round(TRAIN * samples))
