"""Is there anything to choose? Level, time and score of passages at constant rates, and of passages that are slow in a window only."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from optimisation.rl.families import ConstantAction, FrequencyWindow, Rates, policy_of, task_of
from optimisation.rl.play import SWEEP, Episodes, play

Row = dict[str, float]
Advance = Callable[[], object]


def _summary(episodes: Episodes) -> Row:
    levels = episodes.last["relative_level"]
    low, median, high = np.quantile(levels, (0.05, 0.5, 0.95)).tolist()
    time = float(episodes.last["time"].mean())
    return {"level_low": low, "level_median": median, "level_high": high, "time": time, "score": float(episodes.scores.mean())}


def constant_rates(rates: Sequence[float], seeds: Sequence[int], arguments: Mapping[str, Any], advance: Advance) -> list[Row]:
    """Return a row for each rate in % per 100 pseudo periods; the time suffices for all of them, whatever the task's budget is."""
    passage = task_of(SWEEP, arguments).passage
    rows = []
    for rate in rates:
        needed = (passage.limits[1] - passage.limits[0]) / (rate * 1e-4)
        enough = {"rates": (rate, rate), "time_budget": 1.01 * needed + 1}
        episodes = play(policy_of("constant", ConstantAction(), [0.0]), SWEEP, seeds, {**arguments, **enough})
        rows.append({"rate": rate, **_summary(episodes)})
        advance()
    return rows


def windows(centres: Sequence[float], width: float, slow: float, seeds: Sequence[int], arguments: Mapping[str, Any], advance: Advance) -> list[Row]:
    """Return a row for each centre (frequency ratio) of a window that is passed at the rate ``slow``, all else at the task's fastest rate."""
    rates = Rates.of(task_of(SWEEP, arguments))
    rows = []
    for centre in centres:
        low, high = ((edge - rates.low) / (rates.high - rates.low) for edge in (centre - width / 2, centre + width / 2))
        policy = policy_of("window", FrequencyWindow(rates), [low, high, float(rates.action(slow)), 1.0])
        rows.append({"centre": centre, **_summary(play(policy, SWEEP, seeds, arguments))})
        advance()
    return rows
