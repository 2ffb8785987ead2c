"""The suite in which feedback pays: its tasks, the kinds of policies that need no learning, and how their numbers are searched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from optimisation.rl.families import ConstantAction, Family, FrequencyWindow, OpenLoop, Rates
from optimisation.rl.friction_rules import LimitByLook, LimitByTrueForce, LimitScale
from optimisation.rl.gap_rules import GapScale
from optimisation.rl.passage_rules import BlindTries, TryAgain
from optimisation.rl.play import ADAPTIVE, DELAYED, FRICTION, NOISY, PASSAGE
from optimisation.rl.sweep_gap_rules import ConstantPair, PairByEstimatedForce, PairByTrueForce, PairOverFrequency
from optimisation.rl.tuning import Progress, Search, Tuned, best_of, evolve

SUITE = {"passage": PASSAGE, "noisy": NOISY, "delayed": DELAYED, "adaptive": ADAPTIVE, "friction": FRICTION}
FEEDBACK, ORACLE = "feedback rule", "rule, true force"
WINDOW, BLIND = "slow window", "blind tries"
Kinds = Mapping[str, Family]
Rest = tuple[str, Sequence[int], Mapping[str, Any]]
Found = tuple[str, str, Tuned]  # name, kind, numbers
# numbers of a passage's way, and where they may lie
WAY_BOUNDS = [(0, 1), (0, 1), (0, 1), (0.3, 0.7), (0, 1), (0.2, 0.6), (-1, 0)]
STARTS = ((0.9, 0.77, 0.5, 0.5, 0.0, 0.38, -0.3), (0.9, 0.9, 1.0, 0.47, 0.1, 0.4, -0.4))
TRY_ENDS, BLIND_ENDS = ((2.5, 0.05), [(0.5, 8.5), (0.0, 0.5)]), ((3.0,), [(-0.4, 8.4)])
WINDOW_STARTS = ((0.35, 0.5, 0.05, 1.0), (0.33, 0.47, 0.1, 1.0))
PACE_BOUNDS = [(-1, 1), (0, 1), (-1, 1)]
FRICTION_KNOTS = 6
LIMIT_STARTS, LIMIT_BOUNDS = ((1.0, 0.9, 0.5, 1.0, 0.0), (0.5, 0.5, 0.0, 1.0, 0.0)), [(-1, 1), (0.2, 0.98), (-1, 1), (0.0, 2.5), (-1, 1)]
PARABOLA_BOUNDS, RULE_BOUNDS, MEMORY_BOUNDS = [(-1, 1), (-2, 2), (-2, 2)], [(0.2, 4.0), (-5.0, 5.0)], [(0.3, 1.5), (0.0, 0.98)]


def kinds_of(task: str, behind: Any) -> dict[str, Family]:
    """Return the kinds of policies of a task of the suite by name; ``behind`` is the task behind its environment."""
    rates = Rates.of(behind)
    if task == "friction":
        limits = LimitScale(behind)
        blind: dict[str, Family] = {"constant": ConstantAction(), "schedule": OpenLoop(rates, FRICTION_KNOTS)}
        return blind | {"true force": LimitByTrueForce(limits), "feedback": LimitByLook(limits)}
    if task != "adaptive":
        return {"constant": ConstantAction(), "window": FrequencyWindow(rates), "blind": BlindTries(rates), "feedback": TryAgain(rates)}
    scale = GapScale(behind)
    return {
        "pair": ConstantPair(),
        "schedule": PairOverFrequency(rates),
        "true force": PairByTrueForce(rates, scale),
        "feedback": PairByEstimatedForce(rates, scale),
    }


def search_passage(kinds: Kinds, rest: Rest, grid: int, search: Search, advance: Progress | None) -> list[Found]:
    """Return what a passage's policies come to: the best constant rate, the best window, blind tries, and the feedback rule."""
    constant = best_of(kinds["constant"], np.linspace(0, 1, grid)[:, None], *rest, advance)
    window = evolve(kinds["window"], WINDOW_STARTS, np.array([(0, 1), (0, 1), (0, 1), (0, 1)]), *rest, search, advance)
    found = {}
    for kind, (end, bounds) in (("blind", BLIND_ENDS), ("feedback", TRY_ENDS)):
        starts = [(*start, *end) for start in STARTS]
        found[kind] = evolve(kinds[kind], starts, np.array(WAY_BOUNDS + bounds, dtype=np.float64), *rest, search, advance)
    return [
        ("constant", "constant", constant),
        (WINDOW, "window", window),
        (BLIND, "blind", found["blind"]),
        (FEEDBACK, "feedback", found["feedback"]),
    ]


def search_adaptive(kinds: Kinds, rest: Rest, grid: int, search: Search, advance: Progress | None) -> list[Found]:
    """Return what policies of rate and gap come to: constant, scheduled, by the true force, and by the estimated one."""
    points = np.linspace(-1, 1, max(2, round(np.sqrt(4 * grid))))
    pairs = np.array([(rate, gap) for rate in points[len(points) // 2 :] for gap in points])
    constant = best_of(kinds["pair"], pairs, *rest, advance)
    rate, gap = constant.parameters
    plan = (
        ("schedule", [(rate, 0.5, rate, gap, 0.0, 0.0)], PACE_BOUNDS + PARABOLA_BOUNDS),
        ("true force", [(rate, 0.5, rate, 1.5, 0.0)], PACE_BOUNDS + RULE_BOUNDS),
        ("feedback", [(rate, 0.5, rate, 1.5, 0.0, 1.0, 0.7), (0.0, 0.9, rate, 1.5, 0.0, 1.0, 0.9)], PACE_BOUNDS + RULE_BOUNDS + MEMORY_BOUNDS),
    )
    found = {kind: evolve(kinds[kind], starts, np.array(bounds, dtype=np.float64), *rest, search, advance) for kind, starts, bounds in plan}
    return [
        ("constant", "pair", constant),
        ("schedule", "schedule", found["schedule"]),
        (ORACLE, "true force", found["true force"]),
        (FEEDBACK, "feedback", found["feedback"]),
    ]


def search_friction(kinds: Kinds, rest: Rest, grid: int, search: Search, advance: Progress | None) -> list[Found]:
    """Return what policies of the friction limit come to: constant, scheduled over the frequency, by the true force, and by one look."""
    constant = best_of(kinds["constant"], np.linspace(-1, 1, grid)[:, None], *rest, advance)
    (action,), half = constant.parameters, FRICTION_KNOTS // 2  # the schedule begins as a constant, and as the rules do: fast at first
    plan = (
        ("schedule", [(action,) * FRICTION_KNOTS, (action,) * half + (0.5,) * half], [(-1, 1)] * FRICTION_KNOTS),
        ("true force", LIMIT_STARTS, LIMIT_BOUNDS),
        ("feedback", LIMIT_STARTS, LIMIT_BOUNDS),
    )
    found = {kind: evolve(kinds[kind], starts, np.array(bounds, dtype=np.float64), *rest, search, advance) for kind, starts, bounds in plan}
    return [
        ("constant", "constant", constant),
        ("schedule", "schedule", found["schedule"]),
        (ORACLE, "true force", found["true force"]),
        (FEEDBACK, "feedback", found["feedback"]),
    ]


def tried(task: str, grid: int, search: Search) -> int:
    """Return how many candidates a search of a task is going to try."""
    each = search.generations * search.population + search.finalists + 2
    points = max(2, round(np.sqrt(4 * grid)))
    if task == "friction":
        return grid + 6 * each
    return grid + 6 * each if task != "adaptive" else points * (points - points // 2) + 4 * each
