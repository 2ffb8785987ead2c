"""What policies do on the way: rates and amplitudes over the frequency of a passage, gaps over the time of an episode. As plain values for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from optimisation.rl.families import Array, Rates, task_of
from optimisation.rl.gap_rules import GapScale
from optimisation.rl.play import ACTION, AMPLITUDE, GAP, SWEEP, Episodes, play
from optimisation.rl.policies import Policy

POINTS = 99
QUANTILES = (0.05, 0.5, 0.95)
Curves = dict[str, Any]


def _quantiles(values: Array) -> list[list[float | None]]:
    """Return the quantiles over the lanes of values (lanes, points), (quantiles, points); None where no lane has been."""
    columns = [column[np.isfinite(column)] for column in values.T]
    return [[float(np.quantile(column, q)) if column.size else None for column in columns] for q in QUANTILES]


def passage_curves(policies: Mapping[str, Sequence[Policy]], seeds: Sequence[int], arguments: Mapping[str, Any]) -> Curves:
    """Return quantiles over all runs of each policy of the rate (% per 100 pseudo periods) and amplitude (half-clearances) over the frequency."""
    rates = Rates.of(task_of(SWEEP, arguments))
    at = np.linspace(rates.low, rates.high, POINTS + 2)[1:-1]
    curves: Curves = {"frequency_ratio": at.tolist(), "quantiles": list(QUANTILES), "policies": {}}
    for name, runs in policies.items():
        parts = [_at_frequencies(play(policy, SWEEP, seeds, arguments, (ACTION, AMPLITUDE, "frequency_ratio")), rates, at) for policy in runs]
        rate, amplitude = (np.concatenate(values) for values in zip(*parts, strict=True))
        curves["policies"][name] = {"rate": _quantiles(rate), "amplitude": _quantiles(amplitude)}
    return curves


def _at_frequencies(episodes: Episodes, rates: Rates, at: Array) -> tuple[Array, Array]:
    """Return rates and amplitudes (lanes, points) of the intervals in which each lane first passed the frequency ratios ``at``; NaN where never."""
    ratio = episodes.traces["frequency_ratio"]
    middle = 0.5 * (rates.low + rates.high)
    passed = np.where((ratio[0] > middle)[:, None, None], ratio.T[:, :, None] <= at, ratio.T[:, :, None] >= at)  # (lanes, steps, points)
    first, lanes = passed.argmax(axis=1), np.arange(ratio.shape[1])[:, None]
    reached = passed.any(axis=1)
    speed = rates.rate(episodes.traces[ACTION])
    return np.where(reached, speed[first, lanes], np.nan), np.where(reached, episodes.traces[AMPLITUDE][first, lanes], np.nan)


def gap_curves(policies: Mapping[str, Policy], seed: int, arguments: Mapping[str, Any]) -> Curves:
    """Return force (N), and each policy's gap and tip RMS (m) over the time (pseudo periods) of one episode; the force's gap by the design rule."""
    scale = GapScale(task_of(GAP, arguments))
    curves: Curves = {"seed": seed, "policies": {}}
    for name, policy in policies.items():
        traces = play(policy, GAP, [seed], arguments, ("time", "force", "frequency_ratio", "gap", "rms")).traces
        curves |= {key: traces[key][:, 0].tolist() for key in ("time", "force")}
        curves["frequency_ratio"] = float(traces["frequency_ratio"][0, 0])
        curves["policies"][name] = {key: traces[key][:, 0].tolist() for key in ("gap", "rms")}
    curves["rule_gap"] = (np.array(curves["force"]) / scale.force_per_gap).tolist()
    return curves
