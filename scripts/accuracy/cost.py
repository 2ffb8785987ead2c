"""What a pseudo period costs: against the number of modes, of lanes, of threads, and the length of the sweep."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from accuracy.cases import case, kind_named, method_name
from accuracy.study import Row, Settings, median_time
from accuracy.trajectory import own_time
from impact_env.drive import Drive, linear_sweep
from impact_env.ensemble import Lane, available_cores, draw_members, run_lanes
from impact_env.methods import Exact, Method, Moreau
from impact_env.parameters import Beam
from impact_env.scene import beam_scene
from impact_env.sweep import simulate

NAME = "cost"
MODES, LANES, THREADS, LENGTH = "modes", "lanes", "threads", "pseudo periods"
OVER_MODES: tuple[tuple[str, Method], ...] = (
    ("no absorber", Exact()),
    ("impact, e = 1", Exact()),
    ("impact, e = 0.7, with friction", Exact()),
    ("compliant walls, stiff", Exact()),
    ("impact, e = 1", Moreau()),
)
LANE_KIND, LANE_MODES, LANE_PERIODS = "impact, e = 1", 10, 40.0
THREAD_LANES = 64
LENGTH_KIND, LENGTH_MODES, LENGTH_LIMITS = "impact, e = 1", 3, (0.94, 0.98)


def _thread_counts() -> list[int]:
    cores = available_cores()
    return sorted({2**k for k in range(cores.bit_length()) if 2**k <= cores} | {cores})


def count(settings: Settings) -> int:
    return len(OVER_MODES) * len(settings.cost_modes) + len(settings.cost_lanes) + len(_thread_counts()) + len(settings.cost_periods)


def _row(over: str, value: float, scene: str, modes: int, method: str, us: float) -> Row:
    return {"over": over, "value": value, "scene": scene, "modes": modes, "method": method, "us_per_period": us}


def rows(settings: Settings) -> Iterator[list[Row]]:
    """Yield one row after the other."""
    for name, method in OVER_MODES:
        for modes in settings.cost_modes:
            it = case(kind_named(name), modes)
            label = (
                f"{method_name(method, it.scene)}, {method.steps_per_period} steps" if isinstance(method, Moreau) else method_name(method, it.scene)
            )
            yield [_row(MODES, modes, name, modes, label, own_time(it, method, 1.0, settings))]
    for lanes in settings.cost_lanes:
        yield [_row(LANES, lanes, LANE_KIND, LANE_MODES, "Exact", _lanes_time(lanes, 1, settings))]
    for threads in _thread_counts():
        yield [_row(THREADS, threads, LANE_KIND, LANE_MODES, "Exact", _lanes_time(THREAD_LANES, threads, settings))]
    for periods in settings.cost_periods:
        yield [_row(LENGTH, periods, LENGTH_KIND, LENGTH_MODES, "Exact", _length_time(periods, settings))]


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
