"""What policies do on the way: rates and amplitudes over the frequency of a passage, gaps over the time of an episode. As plain values for JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from optimisation.rl.families import Array, Rates, task_of
from optimisation.rl.gap_rules import GapScale
from optimisation.rl.play import ACTION, AMPLITUDE, GAP, SWEEP, Episodes, play
from optimisation.rl.policies import Policy

POINTS, BINS = 99, 50
QUANTILES = (0.05, 0.5, 0.95)
Curves = dict[str, Any]
Responses = Callable[[Any, Mapping[str, Array]], Mapping[str, Array]]


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


def response_curves(
    env_id: str,
    recorded: Sequence[str],
    responses: Responses,
    policies: Mapping[str, Sequence[Policy]],
    seeds: Sequence[int],
    arguments: Mapping[str, Any],
) -> Curves:
    """Return what policies do over the frequency, apart for intervals after which impacts go on and after which there are none.

    Quantiles over all intervals in a bin of what ``responses`` returns by name, for the task behind the environment and the traces ``recorded``, by
    name and as long as there are intervals.
    """
    behind = task_of(env_id, arguments)
    rates = Rates.of(behind)
    edges = np.linspace(rates.low, rates.high, BINS + 1)
    curves: Curves = {"frequency_ratio": (0.5 * (edges[1:] + edges[:-1])).tolist(), "quantiles": list(QUANTILES), "policies": {}}
    places = ("frequency_ratio", "impacts")
    for name, runs in policies.items():
        traces = [play(policy, env_id, seeds, arguments, (*places, *recorded)).traces for policy in runs]
        before = {key: np.concatenate([t[key][:-1].ravel() for t in traces]) for key in places}
        values = responses(behind, {key: np.concatenate([t[key][1:].ravel() for t in traces]) for key in recorded})
        curves["policies"][name] = _split(values, before, edges)
    return curves


def _split(values: Mapping[str, Array], before: Mapping[str, Array], edges: Array) -> dict[str, Any]:
    """Return quantiles of values by bin of the frequency and by whether there were impacts in the interval before."""
    place = np.digitize(before["frequency_ratio"], edges) - 1
    found: dict[str, Any] = {}
    for word, mask in (("impacting", before["impacts"] > 0), ("quiet", before["impacts"] == 0)):
        for key, numbers in values.items():
            parts = [numbers[mask & (place == k) & np.isfinite(numbers)] for k in range(len(edges) - 1)]
            found[f"{key}, {word}"] = [[float(np.quantile(part, q)) if part.size else None for part in parts] for q in QUANTILES]
    return found
