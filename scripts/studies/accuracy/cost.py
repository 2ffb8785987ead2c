"""What a pseudo period costs: against the number of modes, of lanes, of threads, and the length of the sweep."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from impact_env.drive import Drive, linear_sweep
from impact_env.ensemble import Lane, available_cores, draw_members, run_lanes
from impact_env.methods import Exact, Method, Moreau
from impact_env.parameters import Beam
from impact_env.scene import beam_scene
from impact_env.sweep import simulate
from studies.accuracy.cases import case, kind_named, method_name
from studies.accuracy.settings import Cases, Row, Settings, median_time
from studies.accuracy.trajectory import own_time

NAME = "cost"
MODES, LANES, THREADS, LENGTH = "modes", "lanes", "threads", "pseudo periods"
OVER_MODES: tuple[tuple[str, Method], ...] = (
    ("no absorber", Exact()),
    ("impact, e = 1", Exact()),
    ("impact, e = 0.7, with friction", Exact()),
    ("compliant walls, stiff", Exact()),
    ("impact, e = 1", Moreau()),
)
LANE_KIND, LANE_MODES, LANE_PERIODS = "impact, e = 1", 10, 400.0
THREAD_LANES = 64
LENGTH_KIND, LENGTH_MODES, LENGTH_LIMITS = "impact, e = 1", 3, (0.94, 0.98)


def _thread_counts() -> list[int]:
    cores = available_cores()
    return sorted({2**k for k in range(cores.bit_length()) if 2**k <= cores} | {cores})


def _row(over: str, value: float, scene: str, modes: int, method: str, us: float) -> Row:
    return {"over": over, "value": value, "scene": scene, "modes": modes, "method": method, "us_per_period": us}


def key(row: Row) -> tuple[str, float, str, str]:
    """Return what the cost is measured against, its value, scene and method."""
    return row["over"], row["value"], row["scene"], row["method"]


def cases(settings: Settings) -> Cases:
    """Return a case for each row."""
    found: dict[tuple[str, float, str, str], Callable[[], list[Row]]] = {}
    for name, method in OVER_MODES:
        for modes in settings.cost_modes:
            label = _label(name, modes, method)
            found[MODES, modes, name, label] = partial(_own_row, name, modes, method, label, settings)
    for over, values, measure in (
        (LANES, settings.cost_lanes, partial(_lanes_time, threads=1)),
        (THREADS, _thread_counts(), partial(_lanes_time, THREAD_LANES)),
        (LENGTH, settings.cost_periods, _length_time),
    ):
        scene, modes = (LENGTH_KIND, LENGTH_MODES) if over == LENGTH else (LANE_KIND, LANE_MODES)
        for value in values:
            found[over, value, scene, "Exact"] = partial(_timed_row, over, value, scene, modes, measure, settings)
    return found


def _label(name: str, modes: int, method: Method) -> str:
    words = method_name(method, beam_scene(Beam(modes=modes), kind_named(name).absorber()))
    return f"{words}, {method.steps_per_period} steps" if isinstance(method, Moreau) else words


def _own_row(name: str, modes: int, method: Method, label: str, settings: Settings) -> list[Row]:
    return [_row(MODES, modes, name, modes, label, own_time(case(kind_named(name), modes), method, 1.0, settings))]


def _timed_row(over: str, value: int, scene: str, modes: int, measure: Callable[..., float], settings: Settings) -> list[Row]:
    return [_row(over, value, scene, modes, "Exact", measure(value, settings=settings))]


def _lanes_time(lanes: int, threads: int, settings: Settings) -> float:
    """Return the time of a pseudo period of one lane in us, all lanes run together through the ensemble."""
    kind = kind_named(LANE_KIND)
    scene = beam_scene(Beam(modes=LANE_MODES), kind.absorber())
    schedule = linear_sweep(scene.model.resonance_omega(1), 0.95, 0.95 + LANE_PERIODS / 1e4)
    wanted = [Lane(scene, drive) for drive in draw_members(lanes, settings.seed).drives(kind.force, schedule)]
    run_lanes(wanted[:1], threads=1)  # compile

    def run() -> float:
        began = time.perf_counter()
        run_lanes(wanted, threads=threads)
        return time.perf_counter() - began

    return 1e6 * median_time(run, settings.repeats, settings.patience) / (lanes * LANE_PERIODS)


def _length_time(periods: float, settings: Settings) -> float:
    """Return the time of a pseudo period in us of a sweep that takes ``periods`` of them through the same range, with its level observed."""
    kind = kind_named(LENGTH_KIND)
    scene = beam_scene(Beam(modes=LENGTH_MODES), kind.absorber())
    width = float(np.diff(LENGTH_LIMITS)[0])
    schedule = linear_sweep(scene.model.resonance_omega(1), *LENGTH_LIMITS, percent_per_100_periods=1e4 * width / periods)
    simulate(scene, Drive(kind.force, linear_sweep(scene.model.resonance_omega(1), 0.94, 0.9401)), Exact())  # compile
    return 1e6 * median_time(lambda: simulate(scene, Drive(kind.force, schedule), Exact()).wall_time, settings.repeats, settings.patience) / periods
