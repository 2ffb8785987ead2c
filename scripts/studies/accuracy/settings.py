"""How much to compute, and what the parts of the study share."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

Row = dict[str, Any]
Cases = Mapping[Any, Callable[[], list[Row]]]  # functions that measure rows, by what tells these from others


@dataclass(frozen=True)
class Settings:
    """How much to compute. Steps are per period of the highest mode; rates in pseudo periods per 1 % of the resonance frequency."""

    modes: tuple[int, ...] = (1, 3, 10, 30)
    kinds: tuple[str, ...] = ()  # empty: all
    scenes: tuple[str, ...] = ()  # the trajectories of these alone are measured, and anew; empty: of all kinds
    steps: tuple[int, ...] = (20, 40, 100, 200, 400, 1000, 2000, 4000, 10000, 20000)
    peers: bool = True
    scipy_tolerances: tuple[float, ...] = (1e-6, 1e-9, 1e-12)
    heyoka_tolerances: tuple[float, ...] = (1e-9, 1e-15)
    starts: int = 5  # places in the motion over whose errors the median is taken
    repeats: int = 5
    timed_seconds: float = 0.05  # wanted length of a timed run
    patience: float = 2.0  # no further repeat of a run once its repeats have taken this many seconds
    sweep: tuple[float, float] = (0.92, 1.0)  # of the ensembles, times the first resonance
    sweep_steps: tuple[int, ...] = (20, 80, 320)
    truth_members: int = 64
    members: int = 32
    budget: float = 8.0  # seconds for the ensemble of one method
    band_members: int = 200
    band_phases: int = 20
    band_repeats: int = 10
    stretches: int = 200
    twins: int = 12
    jump_rates: tuple[float, ...] = (100.0, 200.0, 400.0, 725.0, 1450.0)
    jump_steps: tuple[int, ...] = (20, 60, 200)
    jump_members: int = 60
    cost_modes: tuple[int, ...] = (1, 2, 3, 5, 7, 10, 14, 20, 30, 40, 50, 60)
    cost_lanes: tuple[int, ...] = (1, 4, 16, 64, 256, 1024)
    cost_periods: tuple[int, ...] = (10, 100, 1000, 10_000, 100_000)
    seed: int = 0
    quick: bool = False


FULL = Settings()
QUICK = Settings(
    quick=True,
    modes=(3, 10),
    kinds=("no absorber", "impact, e = 1", "impact, e = 0.7, with friction", "compliant walls, stiff"),
    steps=(20, 200, 2000),
    scipy_tolerances=(1e-9,),
    heyoka_tolerances=(1e-15,),
    starts=3,
    repeats=3,
    timed_seconds=0.02,
    patience=0.5,
    sweep_steps=(20, 80),
    truth_members=16,
    members=12,
    budget=1.5,
    band_members=20,
    band_phases=5,
    band_repeats=4,
    stretches=40,
    twins=4,
    jump_rates=(100.0, 200.0),
    jump_steps=(20, 60),
    jump_members=12,
    cost_modes=(1, 3, 10, 30),
    cost_lanes=(1, 16, 64),
    cost_periods=(10, 100, 1000),
)


def median_time(run: Callable[[], float], repeats: int, patience: float) -> float:
    """Return the median of several times in s; slow runs are repeated less often."""
    began = time.perf_counter()
    times = [run()]
    while len(times) < repeats and time.perf_counter() - began < patience:
        times.append(run())
    return statistics.median(times)


def unique(values: Iterable[Any]) -> list[Any]:
    """Return the values without repetition, in the order in which they appear."""
    return list(dict.fromkeys(values))
