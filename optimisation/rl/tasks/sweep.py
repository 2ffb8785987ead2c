"""The first passage: the rate over the frequency, against the best schedule that does not look at the response."""

from __future__ import annotations

from typing import Any

import numpy as np

from impact_env.drive import PAPER_RATE
from optimisation.rl.families import ConstantAction, Family, FrequencyWindow, OpenLoop, Rates
from optimisation.rl.play import SWEEP
from optimisation.rl.tasks.baseline import BEST_CONSTANT, BEST_SCHEDULE, KNOTTED, WINDOWED, Baseline
from optimisation.rl.tasks.effort import Effort, grid, spent
from optimisation.rl.tasks.task import FEW_SEEDS, SCHEDULES, Figure, Kinds, Rest, Task
from optimisation.rl.traces import passage_curves
from optimisation.rl.tuning import Progress, Tuned, best_of, evolve, mean_scores, searched

KNOTS = 21
PAPER_SLOW_RATE = 100 / 725  # % per 100 pseudo periods, of the paper's example of a jump (section 3.1)
# a first look for slow windows, in shares of the range
WINDOW_EDGES, WINDOW_WIDTHS, SLOW_ACTIONS = np.arange(0.25, 0.56, 0.05), (0.1, 0.15, 0.2, 0.3), (-0.9, -0.7, -0.5)


def kinds(behind: Any) -> dict[str, Family]:
    """Return the kinds of policies by name."""
    rates = Rates.of(behind)
    return {"constant": ConstantAction(), "window": FrequencyWindow(rates), "open loop": OpenLoop(rates, KNOTS)}


def search(kinds: Kinds, rest: Rest, effort: Effort, advance: Progress | None) -> list[Baseline]:
    """Return the paper's rates, the best constant one, and the two schedules over the frequency."""
    window, schedule = kinds["window"], kinds["open loop"]
    assert isinstance(window, FrequencyWindow)
    assert isinstance(schedule, OpenLoop)
    rates = window.rates
    found = [Baseline(f"paper's rate, {rate:.3g} %", "constant", (float(rates.action(rate)),)) for rate in (PAPER_RATE, PAPER_SLOW_RATE)]
    constant = best_of(kinds["constant"], grid(effort), *rest, advance)
    rule = evolve(window, _windows(window, rest, effort, advance), np.array([(0, 1), (0, 1), (-1, 1), (-1, 1)]), *rest, effort.rule, advance)
    knots = np.linspace(0, 1, schedule.knots)
    edges = np.sort(rule.parameters[:2])
    begin = np.where((knots > edges[0]) & (knots <= edges[1]), rule.parameters[2], rule.parameters[3]).tolist()
    best = evolve(schedule, [begin] * 2, np.array([(-1.0, 1.0)] * schedule.knots), *rest, effort.schedule, advance)
    return [*found, Baseline.tuned(BEST_CONSTANT, "constant", constant), *schedules(rule, best)]


def schedules(rule: Tuned, knotted: Tuned) -> list[Baseline]:
    """Return both schedules over the frequency; the one with the better score on the seeds that neither search saw is the best open-loop schedule."""
    simple = rule.score >= knotted.score
    names = (BEST_SCHEDULE, KNOTTED) if simple else (WINDOWED, BEST_SCHEDULE)
    return [Baseline.tuned(names[0], "window", rule), Baseline.tuned(names[1], "open loop", knotted)]


def _windows(window: FrequencyWindow, rest: Rest, effort: Effort, advance: Progress | None) -> list[list[float]]:
    """Return two starts for the search of a rule: the best of a coarse grid of slow windows, with the fastest rate outside."""
    windows = np.array([(low, low + width, slow, 1.0) for low in WINDOW_EDGES for width in WINDOW_WIDTHS for slow in SLOW_ACTIONS])
    if not effort.windows:
        return [[0.3, 0.5, -0.8, 1.0], [0.35, 0.5, -0.8, 1.0]]
    name, seeds, arguments = rest
    scores = mean_scores(window, windows, name, searched(seeds), arguments)
    if advance is not None:
        advance(len(windows))
    return windows[np.argsort(-scores)[:2]].tolist()


def tried(effort: Effort) -> int:
    """Return how many candidates a search is going to try."""
    windows = len(WINDOW_EDGES) * len(WINDOW_WIDTHS) * len(SLOW_ACTIONS) if effort.windows else 0
    return effort.grid + windows + spent(effort.rule, 2) + spent(effort.schedule, 2)


TASK = Task(
    name="sweep",
    env_id=SWEEP,
    words="passage (v0)",
    kinds=kinds,
    search=search,
    tried=tried,
    curves=passage_curves,
    figure=Figure(
        SCHEDULES, "What the policies do (median and 5 to 95 % over passages and agents)", (BEST_CONSTANT, BEST_SCHEDULE, WINDOWED, KNOTTED)
    ),
    zero=BEST_CONSTANT,
    one=BEST_SCHEDULE,
    marked=(),
    luck=None,
    more_training=1,
    evaluation_seeds=FEW_SEEDS,
)
