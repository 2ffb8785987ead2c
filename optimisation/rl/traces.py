"""What policies do on the way: rates and amplitudes over the frequency of a passage, gaps over the time of an episode. As plain values for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from optimisation.rl.families import Array, Rates, task_of
from optimisation.rl.gap_rules import GapScale
from optimisation.rl.play import ACTION, AMPLITUDE, GAP, SWEEP, Episodes, play
from optimisation.rl.policies import Policy

BINS = 50
QUANTILES = (0.05, 0.5, 0.95)
Curves = dict[str, Any]


def _binned(values: Array, at: Array, edges: Array) -> list[list[float | None]]:
    """Return the quantiles of values in each bin, (quantiles, bins); None where nothing was seen."""
    which = np.digitize(at, edges) - 1
    groups = [values[which == k] for k in range(len(edges) - 1)]
    return [[float(np.quantile(group, q)) if group.size else None for group in groups] for q in QUANTILES]


def passage_curves(policies: Mapping[str, Sequence[Policy]], seeds: Sequence[int], arguments: Mapping[str, Any]) -> Curves:
    """Return quantiles over all runs of each policy of the rate (% per 100 pseudo periods) and amplitude (half-clearances) over the frequency."""
    rates = Rates.of(task_of(SWEEP, arguments))
    edges = np.linspace(rates.low, rates.high, BINS + 1)
    curves: Curves = {"frequency_ratio": (0.5 * (edges[1:] + edges[:-1])).tolist(), "quantiles": list(QUANTILES), "policies": {}}
    for name, runs in policies.items():
        parts = [_passage(play(policy, SWEEP, seeds, arguments, (ACTION, AMPLITUDE, "frequency_ratio")), rates) for policy in runs]
        ratio, rate, amplitude = (np.concatenate(values) for values in zip(*parts, strict=True))
        curves["policies"][name] = {"rate": _binned(rate, ratio, edges), "amplitude": _binned(amplitude, ratio, edges)}
    return curves


def _passage(episodes: Episodes, rates: Rates) -> tuple[Array, Array, Array]:
    ratio = episodes.traces["frequency_ratio"]
    start = np.where(ratio[:1] > 0.5 * (rates.low + rates.high), rates.high, rates.low)
    middle = 0.5 * (ratio + np.concatenate([start, ratio[:-1]]))  # of the interval
    seen = np.isfinite(ratio)
    return middle[seen], rates.rate(episodes.traces[ACTION])[seen], episodes.traces[AMPLITUDE][seen]


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
