"""Designs to measures: all runs of a batch in one call, on the cores of this machine or on other machines' workers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Members, available_cores
from impact_env.parameters import count
from optimisation.designs import Design
from optimisation.measures import Chunk, measure
from optimisation.problem import Problem

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]  # takes the number of finished runs and of all runs of a call


class Executor(Protocol):
    """Something that measures chunks."""

    def run(self, chunks: Sequence[Chunk]) -> Iterator[tuple[int, Array]]:
        """Yield (number of the chunk, its measures) in the order in which they are finished; closing it drops what has not begun."""


@dataclass(frozen=True)
class Threads:
    """The cores of this machine: the kernels release Python's lock. The results do not depend on the number of ``threads``."""

    threads: int | None = None

    def __post_init__(self) -> None:
        if self.threads is not None:
            count("threads", self.threads, 1)

    def run(self, chunks: Sequence[Chunk]) -> Iterator[tuple[int, Array]]:
        """See `Executor`. Chunks under way are finished before a closed call returns."""
        pool = ThreadPoolExecutor(self.threads or available_cores())
        try:
            futures: dict[Future[Array], int] = {pool.submit(measure, chunk): k for k, chunk in enumerate(chunks)}
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@dataclass
class Clocked:
    """An executor that counts the ``seconds`` that its caller waits for runs: the rest of a search is overhead."""

    executor: Executor
    seconds: float = 0.0

    def run(self, chunks: Sequence[Chunk]) -> Iterator[tuple[int, Array]]:
        """See `Executor`."""
        results = iter(self.executor.run(chunks))
        while True:
            began = time.perf_counter()
            result = next(results, None)
            self.seconds += time.perf_counter() - began
            if result is None:
                return
            yield result


def evaluate(
    problem: Problem, designs: Sequence[Design], ensemble: Members, rate: float, executor: Executor, progress: Progress | None = None
) -> Iterator[tuple[int, Array]]:
    """Yield (number of the design, measures (members, conditions, up or down, measures)) as designs are finished; `rate` as in `Problem`.

    Designs begin in the order given, so that an interrupted call leaves the first ones whole. Raises ParameterError if the simulator
    refuses a design; a run that the integrator gives up is NaN.
    """
    owned = [problem.chunks(design, ensemble, rate) for design in designs]
    owners = [k for k, own in enumerate(owned) for _ in own]
    starts = np.cumsum([0] + [len(own) for own in owned])
    chunks = [chunk for own in owned for chunk in own]
    total, done = sum(len(chunk.lanes) for chunk in chunks), 0
    waiting = [len(own) for own in owned]
    parts: dict[int, Array] = {}
    for i, values in executor.run(chunks):
        parts[i] = values
        done += len(values)
        if progress is not None:
            progress(done, total)
        k = owners[i]
        waiting[k] -= 1
        if not waiting[k]:
            yield k, problem.join([parts.pop(j) for j in range(starts[k], starts[k + 1])], len(ensemble))
