"""Measuring the specialisation report's variants in processes of their own, and the claims that the numbers have to bear out."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from impact_env.sweep import IntegrationError
from studies.study import Json, Steps
from studies.variants import Pair, Variant, own, pairs

PROBE = Path(__file__).with_name("probe.py")
PACKAGES = PROBE.parents[3]  # the folder from which they are imported
PERIODS, QUICK_PERIODS = 400.0, 60.0
REPEATS, QUICK_REPEATS = 5, 3
FRICTION = ("rigid_contact.friction_force", "rigid_contact.add_friction_loss", "rigid_contact.turn")
LINEAR = ("no absorber", "stuck", "tuned")
REAL = 1.02  # a part switched off by its value must cost more than this, or leaving it out saves nothing
FLAT_KB = 64.0  # memory that a longer run may need more, when nothing is stored


@dataclass
class Results:
    """What was found, as plain values: own[name] of each variant, pairs in their order."""

    own: dict[str, dict[str, Any]] = field(default_factory=dict)
    pairs: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Claim:
    """A sentence and whether the numbers bear it out."""

    text: str
    found: str
    holds: bool


def _probe(variant: Variant, what: str, cache: Path, periods: float, repeats: int) -> dict[str, Any]:
    command = [sys.executable, "-P", str(PROBE), variant.absorber, variant.method, variant.record, what, str(periods), str(repeats)]
    path = os.pathsep.join([str(PACKAGES), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "IMPACT_ENV_CACHE": str(cache), "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    result = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=PACKAGES)
    if result.returncode:
        raise IntegrationError(f"{variant.name}: {result.stderr.strip().splitlines()[-1] if result.stderr.strip() else result.returncode}")
    values: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    return values


def left(quick: bool, known: Json) -> tuple[list[Variant], list[Pair]]:
    """Return the variants and the pairs that an earlier run has not measured."""
    done = {pair["part"] for pair in known.get("pairs", ())}
    return [variant for variant in own(quick) if variant.name not in known.get("own", {})], [pair for pair in pairs(quick) if pair.part not in done]


def measure(quick: bool, known: Json) -> Steps:
    """Measure everything that is not known, one process after the other, and yield what there is after each."""
    periods, repeats = (QUICK_PERIODS, QUICK_REPEATS) if quick else (PERIODS, REPEATS)
    results = Results(**known)
    variants, compared = left(quick, known)
    timed = {variant: results.own[variant.name] for variant in own(quick) if variant.name in results.own}
    with tempfile.TemporaryDirectory(prefix="impact_env-") as folder:
        caches = {kind: Path(folder) / str(number) for number, kind in enumerate(dict.fromkeys(variant.kind for variant in own(quick)))}
        for variant in variants:
            cold = _probe(variant, "inspect", caches[variant.kind], 1.0, 1)
            yield vars(results)
            timed[variant] = _probe(variant, "time", caches[variant.kind], periods, repeats)
            results.own[variant.name] = _entry(variant, cold, timed[variant])
            yield vars(results)
        for pair in compared:
            for variant in (pair.without, pair.switched_off):
                if variant not in timed:
                    timed[variant] = _probe(variant, "time", caches[variant.kind], periods, repeats)
            results.pairs.append(_compared(pair, timed))
            yield vars(results)


def _entry(variant: Variant, cold: dict[str, Any], cached: dict[str, Any]) -> dict[str, Any]:
    names = {"absorber": variant.absorber, "method": variant.method, "record": variant.record}
    compiling = {"cold_s": cold["first_s"], "cached_s": cached["first_s"], "functions": cold["functions"], "instructions": cold["instructions"]}
    running = ("ns_per_period", "impacts_per_period", "memory_mb", "peak_kb")
    return names | compiling | {name: cached[name] for name in running}


def _compared(pair: Pair, timed: dict[Variant, dict[str, Any]]) -> dict[str, Any]:
    times = [timed[variant]["ns_per_period"] for variant in (pair.without, pair.switched_off)]
    names = {"part": pair.part, "without": pair.without.name, "switched_off": pair.switched_off.name}
    return names | {"without_ns": times[0], "switched_off_ns": times[1], "ratio": times[1] / times[0]}


def _arithmetic(entry: dict[str, Any], names: tuple[str, ...]) -> int:
    return sum(function["arithmetic"] for function in entry["functions"] if function["name"] in names)


def claims(results: Results) -> Iterator[Claim]:
    """Yield what has to be true of the compiled code and of the measurements."""
    for entry in results.own.values():
        called = [function["name"] for function in entry["functions"]]
        scene = f"{entry['absorber']}, {entry['method']}, {entry['record']}"
        if entry["method"] == "exact" and entry["absorber"] in LINEAR:
            search = [name for name in called if name.startswith("search.")]
            yield Claim(f"{scene}: searches no events", f"{len(search)} functions of the search", not search)
        if entry["method"] == "exact" and entry["absorber"] == "impact":
            left = _arithmetic(entry, FRICTION)
            yield Claim(f"{scene}: no friction arithmetic", f"{left} operations", left == 0)
        if entry["method"] == "exact" and entry["absorber"] == "impact and friction":
            left = _arithmetic(entry, FRICTION)
            yield Claim(f"{scene}: has friction arithmetic (the check can fail)", f"{left} operations", left > 0)
        if entry["record"] in ("nothing", "level"):
            growth = entry["peak_kb"][1] - entry["peak_kb"][0]
            yield Claim(f"{scene}: stores no time series", f"{growth:+.1f} kB for a run 10 times longer", growth < FLAT_KB)
        if entry["record"] == "level and samples":
            growth = entry["peak_kb"][1] - entry["peak_kb"][0]
            yield Claim(f"{scene}: stores one (the check can fail)", f"{growth:+.1f} kB for a run 10 times longer", growth > FLAT_KB)


def unreal(results: Results) -> list[str]:
    """Return the parts whose absence saves no time that can be told from noise."""
    return [pair["part"] for pair in results.pairs if pair["ratio"] < REAL]
