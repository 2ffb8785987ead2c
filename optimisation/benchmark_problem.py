"""A design problem with the attributes and methods of EngiBench's problems, for optimisers and generative models that are written for those.

The names are theirs (`design_space`, `objectives`, `conditions`, `simulate`, `optimize`, `random_design`, `check_constraints`, `render`, `dataset`,
`reset`); EngiBench itself is not needed. A design is a row of coordinates of the problem's space. The space is a Gymnasium one (extra ``rl``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from enum import Enum
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

    MINIMIZE = "minimize"
    MAXIMIZE = "maximize"


@dataclass(frozen=True)
class Conditions:
    """What may be changed from call to call, as the ``config`` of a call: force in N, resonance, the beam's damping ratio."""

    force: float = 3.5
    resonance: int = 1
    damping_ratio: float = 0.01


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


class ImpactAbsorberProblem:
    """The level of a beam's free end with an absorber of a concept, relative to no absorber, as one objective to be minimised."""

    version = 0
    dataset_id = None
    container_id = None

    def __init__(
        self,
        seed: int = 0,
        concept: str = "impact",
        beam: Beam | None = None,
        members: int = 4,
        constraints: tuple[Constraint, ...] = (),
        conditions: Conditions | None = None,
        executor: Executor | None = None,
    ) -> None:
        """Raises ParameterError as `Problem` does."""
        self.seed, self.conditions = seed, Conditions() if conditions is None else conditions
        self._concept, self._beam, self._members, self._constraints = concept, Beam() if beam is None else beam, members, constraints
        self._executor = executor
        self._generator = np.random.default_rng(seed)
        self._samples: dict[str, dict[str, Array]] | None = None
        self.problem = self._problem({})

    @property
    def objectives(self) -> tuple[tuple[str, ObjectiveDirection], ...]:
        """Names and directions of what `simulate` returns."""
        direction = {False: ObjectiveDirection.MINIMIZE, True: ObjectiveDirection.MAXIMIZE}
        return tuple((objective.kind, direction[objective.maximise]) for objective in self.problem.objectives)

    @property
    def design_space(self) -> spaces.Box:
        """The coordinates' box; see `DesignSpace`."""
        return spaces.Box(self.problem.space.low, self.problem.space.high, dtype=np.float64)

    def _problem(self, config: Mapping[str, Any]) -> Problem:
        known = asdict(self.conditions)
        unknown = sorted(set(config) - set(known))
        require(not unknown, "config", unknown, f"keys among {', '.join(known)}")
        chosen = Conditions(**{**known, **config})
        beam = replace(self._beam, damping_ratio=chosen.damping_ratio)
        condition = Condition(chosen.resonance, chosen.force)
        return Problem(design_space(self._concept), (condition,), constraints=self._constraints, beam=beam, members=self._members, seed=self.seed)

    def reset(self, seed: int | None = None) -> None:
        """Begin anew with a seed of members and random designs."""
        self.seed = self.seed if seed is None else count("seed", seed, 0)
        self._generator = np.random.default_rng(self.seed)
        self.problem = self._problem({})

    def simulate(self, design: ArrayLike, config: Mapping[str, Any] | None = None) -> Array:
        """Return the objectives of a design, (objectives,), in their own direction; NaN if it failed."""
        problem = self._problem(config or {})
        signs = np.array([-1.0 if objective.maximise else 1.0 for objective in problem.objectives])
        return np.asarray(signs * problem.evaluate(np.asarray(design, dtype=np.float64)[None], executor=self._executor).F[0])

    def check_constraints(self, design: ArrayLike, config: Mapping[str, Any] | None = None) -> list[Violation]:
        """Return what a design breaks: a bound of the space, or a constraint of the problem (which takes its runs); empty if it is allowed."""
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
        """Return a design drawn evenly from the space (in logarithms where ratios matter), and a number that no other draw has."""
        shares = self._generator.random(len(self.problem.space.free))
        return self._coordinates(shares), int(self._generator.integers(2**31))

    def _coordinates(self, shares: Array) -> Array:
        return np.array([v.value_at(float(share)) for v, share in zip(self.problem.space.free, shares, strict=True)])

    def optimize(self, starting_point: ArrayLike, config: Mapping[str, Any] | None = None, designs: int = 40) -> tuple[Array, list[OptiStep]]:
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
        """Simulate ``samples`` designs of a Halton sequence; see `dataset`."""
        points = qmc.Halton(len(self.problem.space.free), rng=np.random.default_rng(self.seed)).random(count("samples", samples, 2))
        X = np.array([self._coordinates(row) for row in points])
        F, G, spread = self.problem.evaluate(X, executor=self._executor)
        cut = max(1, round(TRAIN * samples))
        parts = {"train": slice(None, cut), "test": slice(cut, None)}
        return {name: {"design": X[part], "objectives": F[part], "constraints": G[part], "spread": spread[part]} for name, part in parts.items()}

    def design_of(self, design: ArrayLike) -> Design:
        """Return a row of coordinates as an absorber's design in SI units."""
        return self.problem.space.decoded(dict(zip((v.name for v in self.problem.space.free), np.ravel(design).tolist(), strict=True)))

    def render(self, design: ArrayLike, path: Path | None = None) -> str:
        """Return a design in words; with a ``path`` draw its free coordinates within their bounds there too (matplotlib)."""
        chosen = self.design_of(design)
        if path is not None:
            from optimisation.report.design_card import save_card

            save_card(path, self.problem.space, chosen)
        return str(chosen)
