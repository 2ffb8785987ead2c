"""Designs to measures: all runs of a batch in one call, on the cores of this machine or on other machines' workers.

`evaluate_arrays` is for optimisers of other packages: arrays in, arrays out, in the order of the designs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.ensemble import Executor, Members, Threads
from impact_env.methods import Exact
from impact_env.parameters import ParameterError, require
from impact_env.solvers import kernel_key
from optimisation.designs import Design
from optimisation.measures import Chunk, measure
from optimisation.statistics import standard_error

if TYPE_CHECKING:
    from optimisation.problem import Problem

Array = NDArray[np.float64]
T = TypeVar("T")
R = TypeVar("R")
Progress = Callable[[int, int], None]  # takes the number of finished runs and of all runs of a call


@dataclass
class TimedExecutor:
    """An executor that counts the ``seconds`` that its caller waits for runs: the rest of a search is overhead."""

    executor: Executor
    seconds: float = 0.0

    def each(
        self, function: Callable[[T], R], items: Sequence[T], kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, R], None, None]:
        """See `Executor`."""
        results = self.executor.each(function, items, kinds)
        while True:
            began = time.perf_counter()
            result = next(results, None)
            self.seconds += time.perf_counter() - began
            if result is None:
                return
            yield result


def run_chunks(
    chunks: Sequence[Chunk], executor: Executor, progress: Progress | None = None
) -> Iterator[tuple[int, Array]]:
    """Yield (number of the chunk, its measures (lanes, measures)) in the order in which they are finished; closing it drops what has not begun."""
    total = sum(len(chunk.lanes) for chunk in chunks)
    done = 0
    for k, values in executor.each(
        measure,
        chunks,
        [
            (kernel_key(chunk.lanes[0].scene, Exact(), chunk.lanes[0].drive), chunk.record)
            for chunk in chunks
        ],
    ):
        done += len(values)
        if progress is not None:
            progress(done, total)
        yield k, values


def measured_chunks(
    chunks: Sequence[Chunk], executor: Executor, progress: Progress | None = None
) -> list[Array]:
    """Return the measures of chunks, (lanes, measures) each, in their order."""
    measured = dict(run_chunks(chunks, executor, progress))
    return [measured[k] for k in range(len(chunks))]


def evaluate(
    problem: Problem,
    designs: Sequence[Design],
    ensemble: Members,
    rate: float,
    executor: Executor,
    progress: Progress | None = None,
) -> Iterator[tuple[int, Array]]:
    """Yield (number of the design, measures (members, conditions, up or down, measures)) as designs are finished; `rate` as in `Problem`.

    Designs begin in the order given, so that an interrupted call leaves the first ones whole. Raises ParameterError if the simulator
    refuses a design; a run that the integrator gives up is NaN.
    """
    owned = [problem.chunks(design, ensemble, rate) for design in designs]
    owners = [k for k, own in enumerate(owned) for _ in own]
    starts = np.cumsum([0] + [len(own) for own in owned])
    chunks = [chunk for own in owned for chunk in own]
    waiting = [len(own) for own in owned]
    parts: dict[int, Array] = {}
    for i, values in run_chunks(chunks, executor, progress):
        parts[i] = values
        k = owners[i]
        waiting[k] -= 1
        if not waiting[k]:
            yield (
                k,
                problem.join(
                    [parts.pop(j) for j in range(starts[k], starts[k + 1])], len(ensemble)
                ),
            )


class ProblemValues(NamedTuple):
    """Values, constraints and spread of N designs, row by row in their order; NaN in the rows of designs that failed.

    ``F`` (N, objectives): values, all to be minimised (the width of a range and the like have their sign turned). ``G`` (N, constraints): share by
    which a limit is exceeded, 0 or below if it is kept. ``spread`` (N, objectives): the bootstrap's standard error of F over the members,
    NaN for one member.
    """

    F: Array
    G: Array
    spread: Array


def evaluate_arrays(
    problem: Problem,
    X: ArrayLike,
    ensemble: Members | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    failures: dict[int, str] | None = None,
) -> ProblemValues:
    """Return F, G and spread of designs at coordinates ``X`` (N, variables), rows in the order of X: see `ProblemValues`.

    Coordinates are those of ``problem.space`` (`DesignSpace.low` and `high`). ``ensemble`` None is the search's own members (what is to be reported
    takes `Problem.fresh_ensemble`), ``executor`` None all cores. A row out of bounds, one that the simulator refuses, and one of which the integrator
    gives up a run are NaN, and ``failures`` takes the reason by the row's number. Raises ParameterError unless X has one column a variable.
    """
    rows = np.atleast_2d(np.asarray(X, dtype=np.float64))
    free = problem.space.free
    require(
        rows.ndim == 2 and rows.shape[1] == len(free),
        "X",
        rows.shape,
        f"(designs, {len(free)}): {', '.join(v.name for v in free)}",
    )
    ensemble = problem.ensemble if ensemble is None else ensemble
    reasons: dict[int, str] = {} if failures is None else failures
    F, spread = (np.full((len(rows), len(problem.objectives)), np.nan) for _ in range(2))
    G = np.full((len(rows), len(problem.constraints)), np.nan)
    designs: dict[int, Design] = {}
    for i, row in enumerate(rows):
        try:
            designs[i] = problem.space.decoded(
                dict(zip((v.name for v in free), map(float, row), strict=True))
            )
            designs[i].absorber()
        except ParameterError as error:
            designs.pop(i, None)
            reasons[i] = str(error)
    numbers = list(designs)
    for k, measured in evaluate(
        problem,
        [designs[i] for i in numbers],
        ensemble,
        problem.rate,
        executor or Threads(),
        progress,
    ):
        i = numbers[k]
        lost = np.isnan(measured).any(axis=(2, 3))
        if lost.any():
            member, condition = (int(x) for x in np.argwhere(lost)[0])
            where = f"member {member} at {problem.conditions[condition].words}"
            reasons[i] = (
                f"the integrator gave up {int(lost.sum())} of {lost.size} runs, the first of them {where}"
            )
            continue
        F[i], G[i], spread[i] = _row(problem, designs[i], measured, ensemble)
    return ProblemValues(F, G, spread)


def _row(
    problem: Problem, design: Design, measured: Array, ensemble: Members
) -> tuple[Array, Array, Array]:
    """Return a design's row of F, G and spread from its measures."""
    score = problem.score(design, measured, ensemble, problem.rate)
    signs = np.array([-1.0 if objective.maximise else 1.0 for objective in problem.objectives])
    members = problem.member_values(measured, ensemble, problem.rate)
    spread = np.array(
        [standard_error(row, o.share) for row, o in zip(members, problem.objectives, strict=True)]
    )
    return signs * np.array(score.values), np.array(score.violations), spread
