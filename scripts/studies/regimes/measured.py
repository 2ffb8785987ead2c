"""What the study of regimes measures, as rows of plain values: stays and sweeps of the part jump, responses of the part kinds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from impact_env.ensemble import draw_members
from impact_env.periodic.jump import Range, jumps
from impact_env.periodic.residence import exit_rate, stays
from impact_env.periodic.stationary import QUANTILES, Kind, envelope, stationary_members
from studies.regimes.cases import Case, Settings

Row = dict[str, Any]
Key = tuple[str, str, float]
STAY, SWEEP, RESPONSE, WAYS = "stay", "sweep", "response", ("down", "up")
BEFORE, AFTER = 0.002, 0.012  # of the resonance, that sweeps either way begin before their range and go on after it
BOTH_WAYS = 100.0, 300.0  # pseudo periods per percent


def key(row: Row) -> Key:
    """Return what is measured, the case, and its frequency ratio or slowness."""
    return row["what"], row["case"], row["at"]


def jump_cases(settings: Settings) -> Mapping[Key, Callable[[], list[Row]]]:
    """Return what measures stays at each frequency and sweeps at each slowness."""
    stay = {(STAY, case.name, ratio): partial(_stay, case, ratio, settings) for case in settings.cases for ratio in case.stay_ratios}
    sweep = {(SWEEP, case.name, slow): partial(_sweep, case, slow, settings) for case in settings.cases if case.sweep for slow in case.slownesses}
    ways = {
        (way, case.name, slow): partial(_one_way, case, way, slow, settings)
        for case in settings.cases
        if case.both_ways
        for slow in BOTH_WAYS
        for way in WAYS
    }
    return {**stay, **sweep, **ways}


def kind_cases(settings: Settings) -> Mapping[Key, Callable[[], list[Row]]]:
    """Return what measures the stationary responses at each frequency."""
    return {(RESPONSE, case.name, ratio): partial(_responses, case, ratio, settings) for case in settings.cases for ratio in case.kind_ratios}


def _phases(members: int, seed: int) -> list[float]:
    return draw_members(members, seed, "phase").phases.tolist()


def _stay(case: Case, ratio: float, settings: Settings) -> list[Row]:
    drawn, length = _phases(settings.stay_members, settings.seed), settings.stay_periods
    at = (case.scene, case.force, case.approach, ratio)
    found = stays(*at, length, drawn, settings.silence, threads=settings.threads, executor=settings.executor)
    rate, late = exit_rate(found, settings.burn_in), exit_rate(found, settings.burn_in + length / 8)
    pauses = found.longest_pauses
    return [
        {
            "what": STAY, "case": case.name, "at": ratio, "runs": settings.stay_members, "absent": found.absent, "returned": found.returned,
            "exits": rate.exits, "exposure": rate.exposure, "rate": _plain(rate.rate), "low": _plain(rate.low), "high": _plain(rate.high),
            "late_exits": late.exits, "late_exposure": late.exposure,
            "longest_pause": float(np.max(pauses)) if pauses is not None and len(pauses) else None,
        }
    ]  # fmt: skip


def _sweep(case: Case, slowness: float, settings: Settings) -> list[Row]:
    assert case.sweep is not None
    drawn = _phases(settings.sweep_members, settings.seed + 1)
    at, limits = (case.scene, case.force, case.approach, case.sweep, slowness, drawn), (settings.silence, case.high_level)
    found = jumps(*at, *limits, threads=settings.threads, executor=settings.executor)
    low, high = found.interval()
    counts = {"runs": found.runs, "present": found.present, "jumped": found.jumped, "high_level": found.high}
    return [{"what": SWEEP, "case": case.name, "at": slowness, **counts, "share": _plain(found.share), "low": low, "high": high}]


def _one_way(case: Case, way: str, slowness: float, settings: Settings) -> list[Row]:
    """Return how many of twice the members leave between the two ratios in a sweep down or up; before one up they come down to its start."""
    assert case.both_ways is not None
    high, low = case.both_ways
    over = Range(high + BEFORE, high, low, low - AFTER) if way == WAYS[0] else Range(low - BEFORE, low, high, high + AFTER)
    drawn = _phases(2 * settings.sweep_members, settings.seed + 2)
    found = jumps(
        case.scene, case.force, case.approach, over, slowness, drawn, settings.silence, threads=settings.threads, executor=settings.executor
    )
    return [
        {"what": way, "case": case.name, "at": slowness, "first": over.first, "last": over.last, "present": found.present, "left": len(found.left)}
    ]


def _responses(case: Case, ratio: float, settings: Settings) -> list[Row]:
    drawn = _phases(settings.kind_members, settings.seed)
    at, lengths = (case.scene, case.force, case.approach, ratio), (settings.settle, settings.window)
    members = stationary_members(*at, *lengths, drawn, threads=settings.threads, executor=settings.executor)
    kinds = {kind.value: sum(member.found.kind is kind for member in members) for kind in Kind}
    multiples = [m for member in members if member.found.kind is Kind.PERIODIC and (m := member.found.multiple) is not None]
    peaks = dict(zip((f"peak_{100 * q:g}" for q in QUANTILES), envelope(members).tolist(), strict=True))
    means = {
        "impacts_per_period": float(np.mean([member.found.impacts_per_period for member in members])),
        "depth": float(np.mean([member.found.depth for member in members])),
        "absorber_share": float(np.mean([member.energies.absorber_mean for member in members])),
        "impact_loss": float(np.mean([member.energies.impact for member in members])),
        "friction_loss": float(np.mean([member.energies.friction for member in members])),
    }
    counted = {str(multiple): multiples.count(multiple) for multiple in sorted(set(multiples))}
    return [{"what": RESPONSE, "case": case.name, "at": ratio, "runs": len(members), **kinds, "multiples": counted, **means, **peaks}]


def _plain(value: float) -> float | None:
    return None if np.isnan(value) else value
