"""Plans for the friction limit of a passage: constant, by the force, by what is seen, and switched on the way; the best of each sort, judged."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
from tqdm import tqdm

from optimisation.report.markdown import markdown
from optimisation.rl.friction_study import LIMITS, Machines, Plan, by_force, by_look, once, switched
from optimisation.rl.statistics import interval

FORCES, TRAINING_SEED, HELD_OUT_SEED = (0.5, 6.0), 1, 2
PLACES, FEW = (1.0, 0.985, 0.97, 0.955), slice(2, None, 3)
LOOK_UNIT = 1e4  # 1/m: an amplitude of 0.1 mm counts one


def plans(per_force: np.ndarray) -> dict[str, dict[str, Plan]]:
    """Return all plans that are tried, by sort and name."""
    few = LIMITS[FEW].tolist()
    pairs = [(a, b, at) for a, b, at in product(few, few, PLACES) if a != b]
    return {
        "one limit": {f"{x:.3g} N": once(float(x)) for x in LIMITS},
        "limit by the true force": {f"{x:.3g} N per N": by_force(float(x)) for x in per_force},
        "limit by what is seen": {f"{x * LOOK_UNIT:.3g} N/m": by_look(float(x) * LOOK_UNIT) for x in LIMITS},
        "two limits, switched": {f"{a:.3g} N above {at}, {b:.3g} N below": switched(a, b, at) for a, b, at in pairs},
        "two limits by what is seen": {
            f"{a * LOOK_UNIT:.3g} N/m above {at}, {b * LOOK_UNIT:.3g} N/m below": switched(a, b, at, LOOK_UNIT) for a, b, at in pairs
        },
    }


def scores(plan: Plan, forces: np.ndarray, seed: int) -> np.ndarray:
    """Return the scores of a plan for machines with these forces."""
    machines = Machines.at_start(forces, seed)
    plan(machines)
    return machines.scores()


def best(tried: Mapping[str, Plan], forces: np.ndarray, bar: tqdm) -> str:
    """Return the name of the plan with the best mean score on the training phases."""
    found = {}
    for name, plan in tried.items():
        found[name] = float(scores(plan, forces, TRAINING_SEED).mean())
        bar.update()
    return max(found, key=found.__getitem__)


def compared(machines: int) -> dict[str, Any]:
    """Return the best of each sort of plan for so many training machines, and how well it does on eight times as many others."""
    training, held_out = (
        np.random.default_rng(seed + 10).uniform(*FORCES, number) for seed, number in ((TRAINING_SEED, machines), (HELD_OUT_SEED, 8 * machines))
    )
    tried, results = plans(LIMITS / 2), {}
    with tqdm(total=sum(map(len, tried.values())), desc="trying", unit="plan", leave=False, disable=None) as bar:
        chosen = {sort: best(named, training, bar) for sort, named in tried.items()}
    judged = {sort: scores(tried[sort][name], held_out, HELD_OUT_SEED)[None] for sort, name in chosen.items()}
    for sort, values in judged.items():
        low, high = interval(lambda x: x.mean(), values)
        gain, (less, more) = float((values - judged["one limit"]).mean()), interval(lambda x: x.mean(), values - judged["one limit"])
        results[sort] = {"plan": chosen[sort], "score": [float(values.mean()), float(low), float(high)], "gain": [gain, float(less), float(more)]}
    return {"machines": [len(training), len(held_out)], "forces_n": list(FORCES), "sorts": results}


def table(compared: Mapping[str, Any]) -> str:
    """Return a line for each sort of plan."""
    rows = []
    for sort, found in compared["sorts"].items():
        (mean, low, high), (gain, less, more) = found["score"], found["gain"]
        rows.append((sort, found["plan"], f"{mean:.3f} [{low:.3f}, {high:.3f}]", f"{gain:+.3f} [{less:+.3f}, {more:+.3f}]"))
    return markdown(("friction", "best of its sort", "mean score", "gain over one limit"), rows)
