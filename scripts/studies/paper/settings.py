"""How much of the paper's figures to compute, and where the runs are made; what a figure's module calls for its runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from impact_env.curve import CurveCase, PerformanceCurve, performance_curves
from impact_env.ensemble import Executor, Lane, each_lane
from impact_env.methods import Method
from impact_env.parameters import count
from impact_env.periodic.residence import finished
from optimisation.progress import sweeps_bar

R = TypeVar("R")
T = TypeVar("T")


@dataclass(frozen=True)
class Settings:
    """``folder`` of the numbers; ``quick``: a look with few points and members; runs in ``threads`` (None: all cores), or by an ``executor``.

    The numbers depend on ``quick`` and ``seed`` only.
    """

    folder: Path
    quick: bool = False
    seed: int = 0
    threads: int | None = None
    executor: Executor | None = None

    def __post_init__(self) -> None:
        count("seed", self.seed, 0)
        if self.threads is not None:
            count("threads", self.threads, 1)

    def size(self, full: T, quick: T) -> T:
        """Return one of two sizes: that of the whole figure, or that of a look."""
        return quick if self.quick else full

    def curves(self, label: str, cases: Sequence[CurveCase], members: int, method: Method | None = None) -> list[PerformanceCurve]:
        """Return performance curves, with a bar; raises KeyboardInterrupt if they are broken off, errors as `performance_curves`."""
        with sweeps_bar(label, leave=False) as show:
            found = performance_curves(cases, members, self.seed, method, threads=self.threads, progress=show, executor=self.executor)
        if not all(curve.complete for curve in found):
            raise KeyboardInterrupt
        return found

    def each(self, label: str, lanes: Sequence[Lane], measure: Callable[[Lane], R], method: Method | None = None) -> list[R]:
        """Return what ``measure`` finds of each lane, with a bar; raises KeyboardInterrupt if that is broken off, errors as `each_lane`.

        ``measure`` is a function of a module or a frozen value that can be called, so that it can be sent to another process.
        """
        with sweeps_bar(label, leave=False) as show:
            return finished(each_lane(lanes, measure, method, threads=self.threads, progress=show, executor=self.executor))
