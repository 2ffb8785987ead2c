"""What the exact method's time is spent on: the cost of its parts, how often each is needed, and what is left over."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from _command_line import check_target
from _cost_pieces import make_room, repeat_advance, repeat_refine, repeat_scan, repeat_solve, repeat_turn
from _table import markdown
from _timing import Timed
from benchmark import CASES, START, Case, machine
from tqdm import tqdm

from impact_env.drive import PAPER_RATE, Drive, linear_sweep
from impact_env.families.common import WINDOW_PERIODS
from impact_env.families.rigid import rigid_regimes
from impact_env.kernels.vector import POINTS
from impact_env.methods import Exact
from optimisation.files import write_json

PERIODS, QUICK_PERIODS = 800.0, 60.0
CALLS = 20_000
REPEATS = 7


@dataclass(frozen=True)
class Part:
    """A part of the kernel: time of one call in ns, calls per pseudo period."""

    name: str
    ns: float
    calls: float

    @property
    def us(self) -> float:
        return 1e-3 * self.ns * self.calls


@dataclass(frozen=True)
class Cost:
    """Time per pseudo period in us, slots, and the parts that were timed alone."""

    case: Case
    us: float
    slots: int
    parts: tuple[Part, ...]
    least_us: float

    @property
    def rest(self) -> float:
        return self.us - sum(part.us for part in self.parts)


def nanoseconds(call: Callable[[], object]) -> float:
    """Return the median time of one of CALLS calls."""
    call()
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return 1e9 * statistics.median(times) / CALLS


def measure(case: Case, periods: float) -> Cost:
    """Time a whole run, and each part in a loop of its own on the same scene."""
    scene = case.scene()
    omega = scene.model.resonance_omega(1)
    run = Timed(scene, Drive(case.force, linear_sweep(omega, START, START + periods * PAPER_RATE / 1e4)), Exact())
    responses = [run.run() for _ in range(REPEATS)]
    us = 1e6 * statistics.median(response.wall_time for response in responses) / periods
    events, evaluations = responses[0].steps / periods, responses[0].evaluations / periods
    regime = rigid_regimes(scene, WINDOW_PERIODS * 2 * np.pi / omega)[0]
    room = make_room(regime, omega, 0.5 * WINDOW_PERIODS * 2 * np.pi / omega)
    level = 1
    scan = nanoseconds(lambda: repeat_scan(CALLS, regime.slots, room, level))
    turn = nanoseconds(lambda: repeat_turn(CALLS, regime.slots, room, level))
    parts = (
        Part(f"{POINTS} times of the signal, its rate and the margins to walls", scan, evaluations - events),
        Part("amplitudes moved on", turn, evaluations - events),
        Part("one exact value, rate and bend (refining an event)", nanoseconds(lambda: repeat_refine(CALLS, regime.slots, room)), events),
        Part("slots advanced to the event", nanoseconds(lambda: repeat_advance(CALLS, regime.slots, room)), events),
        Part("chirp of a window", nanoseconds(lambda: repeat_solve(CALLS, regime.slots, room)), 1 / WINDOW_PERIODS),
    )
    return Cost(case, us, int(regime.slots.rows.shape[1]), parts, 1e-3 * events * (scan + turn))


def table(costs: list[Cost]) -> str:
    """Return the parts of every case: time of a call, calls, share."""
    rows: list[tuple[str, ...]] = []
    for cost in costs:
        rows.append((cost.case.name, f"{cost.slots} slots", "", f"{cost.us:.3g}", "100 %"))
        rows += [("", part.name, f"{part.ns:.0f} x {part.calls:.1f}", f"{part.us:.2f}", f"{100 * part.us / cost.us:.0f} %") for part in cost.parts]
        rows.append(("", "all else: jumps, joined phases, decisions, arguments", "", f"{cost.rest:.2f}", f"{100 * cost.rest / cost.us:.0f} %"))
        rows.append(("", "least: one block an event", "", f"{cost.least_us:.2f}", f"{100 * cost.least_us / cost.us:.0f} %"))
    return markdown(("case", "part", "ns x calls per period", "us", "share"), rows)


def values(costs: list[Cost]) -> dict[str, Any]:
    """Return what the JSON file holds."""
    cases = [
        {
            "case": cost.case.name,
            "us": cost.us,
            "slots": cost.slots,
            "least_us": cost.least_us,
            "parts": [{"name": part.name, "ns": part.ns, "calls": part.calls} for part in cost.parts],
        }
        for cost in costs
    ]
    return {"machine": machine(), "cases": cases}


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help=f"Runs of {QUICK_PERIODS:g} pseudo periods instead of {PERIODS:g}.")
@click.option("--json", "target", type=click.Path(path_type=Path, dir_okay=False), help="Also write the numbers to this file.")
def main(quick: bool, target: Path | None) -> None:
    """Say what the exact method's time is spent on, on one core."""
    if target is not None:
        check_target("--json", target)
    costs = [measure(case, QUICK_PERIODS if quick else PERIODS) for case in tqdm(CASES, desc="timing", unit="case", leave=False, disable=None)]
    click.echo(table(costs))
    click.echo(
        "\nTimes per pseudo period, medians on one core. Parts are timed alone in a loop, with warm caches, and their sum is therefore a lower bound."
    )
    if target is not None:
        write_json(target, values(costs))


if __name__ == "__main__":
    main()
