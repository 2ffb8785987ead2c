"""Computing time of the exact method, by its parts.

The tables give the cost of each part, how often each is needed, and the remaining time.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.events.search import (
    BlockStart,
    SearchStep,
    propagate_two_orders,
    scan,
    start_orders,
)
from impact_env.kernels.events.signals import (
    EventFunction,
    Guards,
    Signal,
    evaluate_terms,
    new_signal,
    select_terms,
)
from impact_env.kernels.motion.forced import Forced, fill_carrier, new_forced, solve_forced
from impact_env.kernels.motion.loads import ForceWindow
from impact_env.kernels.motion.modal_system import POINTS, ModalSystem, propagate
from impact_env.methods import Exact
from impact_env.solvers import WINDOW_PERIODS, rigid_regimes
from optimisation.checkpoint import TimedRun
from optimisation.cli.common import command
from optimisation.executors import Bar
from optimisation.files import markdown
from studies.cli.benchmark import CASES, START, SpeedCase
from studies.study import Json, OutputPaths, Study, add_table_options, make_table_study, run
from studies.timing import make_sweep_up, measure_median_time, time_call


class Buffers(NamedTuple):
    """A signal and a window to work on, and slots to advance (2, J)."""

    signal: Signal
    forced: Forced
    window: ForceWindow
    z: Any


def make_buffers(slots: ModalSystem, omega: float, half: float) -> Buffers:
    """Return buffers with an amplitude of a millimetre in every slot.

    The slots are forced at ``omega`` in a window of half length ``half`` (s).
    """
    signal = new_signal(slots.rows.shape[1])
    forced = new_forced(slots, None)
    window = ForceWindow(0.0, half, omega, 0.0, 1.0, 0.0)
    solve_forced(slots, window, None, forced)
    signal.u[:] = 1e-3
    return Buffers(signal, forced, window, np.full_like(signal.u, 1e-3))


@jit
def repeat_scan(calls, slots, workspace, level):  # type: ignore[no-untyped-def]
    """Look at a block of times, again and again."""
    w = workspace.signal.moving
    size = slots.rows.shape[1]
    total = 0
    start_orders(slots.rows, workspace.signal.u, w, size)
    fill_carrier(slots.steps, workspace.window.omega, level, workspace.forced.carrier)
    course = EventFunction(slots, workspace.forced, workspace.window.omega, workspace.signal, 0.0)
    guards = Guards(-1.0, 1.0, 0, None, False)
    place = BlockStart(0.0, 1.0, 0.0, 0)
    step = SearchStep(level, slots.steps[level, 0], size, 1e-9, 1e-9)
    for k in range(calls):
        w[0] = 1e-3 + 1e-12 * k
        walls, _ = scan(course, guards, place, step, size)
        total += walls
    return total


@jit
def repeat_turn(calls, slots, workspace, level):  # type: ignore[no-untyped-def]
    """Move the amplitudes on by a block, again and again."""
    w = workspace.signal.moving
    size = slots.rows.shape[1]
    start_orders(slots.rows, workspace.signal.u, w, size)
    turns = slots.turns
    for _ in range(calls):
        propagate_two_orders(turns, (level * POINTS + POINTS - 1) * 2 * size, w, size)


@jit
def repeat_refine(calls, slots, workspace):  # type: ignore[no-untyped-def]
    """Evaluate the signal exactly at another offset each time."""
    total = 0.0
    step = workspace.window.half / calls
    terms = select_terms(
        EventFunction(slots, workspace.forced, workspace.window.omega, workspace.signal, 0.0)
    )
    for k in range(calls):
        y, v, a, j = evaluate_terms(terms, k * step)
        total += y + v + a + j
    return total


@jit
def repeat_advance(calls, slots, workspace):  # type: ignore[no-untyped-def]
    """Advance slots by another offset each time."""
    step = workspace.window.half / calls
    for k in range(calls):
        propagate(slots.rows, slots.table, slots.scale, k * step, workspace.z)
        workspace.z[0, 0] = 1e-3


@jit
def repeat_solve(calls, slots, workspace):  # type: ignore[no-untyped-def]
    """Solve a window's forced part, again and again."""
    for _ in range(calls):
        solve_forced(slots, workspace.window, None, workspace.forced)


NAME = "cost"
PERIODS = 800.0
QUICK_PERIODS = 60.0
CALLS = 20_000
REPEATS = 7


def nanoseconds(call: Callable[[], object]) -> float:
    """Return the median time of one of CALLS calls."""
    call()
    return 1e9 * measure_median_time(partial(time_call, call), REPEATS) / CALLS


def measure(case: SpeedCase, periods: float) -> Json:
    """Time a whole run, and each part in a loop of its own on the same scene."""
    scene = case.scene()
    level = 1
    window = WINDOW_PERIODS * 2 * np.pi / scene.model.resonance_omega(1)
    run = TimedRun(scene, make_sweep_up(scene, case.force, START, periods), Exact())
    response = run.run()
    us = 1e6 * measure_median_time(lambda: run.run().wall_time, REPEATS) / periods
    events = response.steps / periods
    evaluations = response.evaluations / periods
    slots = rigid_regimes(scene, window)[0].system
    workspace = make_buffers(slots, scene.model.resonance_omega(1), 0.5 * window)
    scan, turn = (
        nanoseconds(partial(repeat, CALLS, slots, workspace, level))
        for repeat in (repeat_scan, repeat_turn)
    )
    refine, advanced, chirp = (
        nanoseconds(partial(repeat, CALLS, slots, workspace))
        for repeat in (repeat_refine, repeat_advance, repeat_solve)
    )
    parts = {  # time of one call in ns, calls per pseudo period
        f"{POINTS} times of the signal, its rate and the margins to walls": (
            scan,
            evaluations - events,
        ),
        "amplitudes moved on": (turn, evaluations - events),
        "one exact value and three derivatives (refining an event)": (refine, events),
        "slots advanced to the event": (advanced, events),
        "chirp of a window": (chirp, 1 / WINDOW_PERIODS),
    }
    own = {"us": us, "slots": int(slots.rows.shape[1]), "least_us": 1e-3 * events * (scan + turn)}
    return {
        "case": case.name,
        **own,
        "parts": [{"name": name, "ns": ns, "calls": calls} for name, (ns, calls) in parts.items()],
    }


def table(cases: Sequence[Json]) -> str:
    """Return the parts of every case: time of a call, calls, share."""
    rows: list[tuple[str, ...]] = []
    for case in cases:
        us = case["us"]
        spent = {part["name"]: 1e-3 * part["ns"] * part["calls"] for part in case["parts"]}
        calls = {part["name"]: f"{part['ns']:.0f} x {part['calls']:.1f}" for part in case["parts"]}
        rest = {
            "all else: jumps, joined phases, decisions, arguments": us - sum(spent.values()),
            "least: one block an event": case["least_us"],
        }
        rows.append((case["case"], f"{case['slots']} slots", "", f"{us:.3g}", "100 %"))
        rows += [
            ("", name, calls.get(name, ""), f"{own:.2f}", f"{100 * own / us:.0f} %")
            for name, own in (spent | rest).items()
        ]
    return markdown(("case", "part", "ns x calls per period", "us", "share"), rows)


# settings: pseudo periods of a run
STUDY: Study[float] = make_table_study(
    NAME,
    "what the exact method's time is spent on",
    lambda periods: {
        "cases": [
            measure(case, periods) for case in Bar(CASES, desc="timing", unit="case", leave=False)
        ]
    },
    lambda measured: (
        f"{table(measured.values['cases'])}\n\n"
        "Times per pseudo period, medians on one core. Parts are timed alone in a loop, with "
        "warm caches, and their sum is therefore a lower bound."
    ),
)


@command()
@click.option(
    "--quick",
    is_flag=True,
    help=f"Runs of {QUICK_PERIODS:g} pseudo periods instead of {PERIODS:g}.",
)
@add_table_options(NAME, "docs/internals/cost.md")
def main(quick: bool, place: OutputPaths) -> None:
    """Measure the parts of the exact method's time, on one core."""
    run(STUDY, QUICK_PERIODS if quick else PERIODS, place)
