"""The gap at one frequency under a force that changes: a fixed gap, and the design rule for the true force and for an estimated one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from impact_env.parameters import RigidWalls
from optimisation.rl.families import ConstantAction, Family
from optimisation.rl.gap_rules import EstimatedForceRule, GapOverFrequency, GapScale, TrueForceRule
from optimisation.rl.play import GAP
from optimisation.rl.policies import Policy
from optimisation.rl.tasks.baseline import BEST_GAP, TUNED_ESTIMATE, TUNED_TRUE, Baseline
from optimisation.rl.tasks.effort import Effort, grid, spent
from optimisation.rl.tasks.task import EPISODE, FEW_SEEDS, Figure, Kinds, Rest, Task
from optimisation.rl.traces import Curves, gap_curves
from optimisation.rl.tuning import Progress, best_of, evolve

RULE_BOUNDS, MEMORY_BOUNDS = [(0.2, 4.0), (-5.0, 5.0)], [(0.3, 1.5), (0.0, 0.98)]


def kinds(behind: Any) -> dict[str, Family]:
    """Return the kinds of policies by name."""
    scale = GapScale(behind)
    return {
        "constant": ConstantAction(),
        "over frequency": GapOverFrequency(),
        "true force": TrueForceRule(scale),
        "estimated force": EstimatedForceRule(scale),
    }


def search(kinds: Kinds, rest: Rest, effort: Effort, advance: Progress | None) -> list[Baseline]:
    """Return the paper's gap, the best fixed one, the best over the frequency, and the design rule for both forces, as it is and fitted."""
    known, guessed = kinds["true force"], kinds["estimated force"]
    assert isinstance(known, TrueForceRule)
    scale, fit = known.scale, effort.fit
    constant = best_of(kinds["constant"], grid(effort), *rest, advance)
    line = evolve(kinds["over frequency"], [(constant.parameters[0], 0.0)], np.array([(-1, 1), (-5, 5)]), *rest, fit, advance)
    true = evolve(known, [(1.0, 0.0), (1.5, 0.0)], np.array(RULE_BOUNDS), *rest, fit, advance)
    starts = [(*true.parameters, 1.0, 0.7), (1.0, 0.0, 1.0, 0.5)]
    estimate = evolve(guessed, starts, np.array(RULE_BOUNDS + MEMORY_BOUNDS), *rest, fit, advance)
    return [
        Baseline("paper's gap, 1 mm", "constant", (float(scale.action(RigidWalls.gap)),)),
        Baseline.tuned(BEST_GAP, "constant", constant),
        Baseline.tuned("best gap over the frequency", "over frequency", line),
        Baseline("rule, estimated force", "estimated force", (1.0, 0.0, 1.0, 0.5)),
        Baseline.tuned(TUNED_ESTIMATE, "estimated force", estimate),
        Baseline("rule, true force", "true force", (1.0, 0.0)),
        Baseline.tuned(TUNED_TRUE, "true force", true),
    ]


def tried(effort: Effort) -> int:
    """Return how many candidates a search is going to try."""
    return effort.grid + spent(effort.fit, 5)


def curves(policies: Mapping[str, Sequence[Policy]], seeds: Sequence[int], arguments: Mapping[str, Any]) -> Curves:
    """Return what the first of each policy's runs does in the episode of the first seed."""
    return gap_curves({name: runs[0] for name, runs in policies.items()}, seeds[0], arguments)


TASK = Task(
    name="gap",
    env_id=GAP,
    words="gap",
    kinds=kinds,
    search=search,
    tried=tried,
    curves=curves,
    figure=Figure(EPISODE, "One episode", (TUNED_TRUE, TUNED_ESTIMATE)),
    zero=BEST_GAP,
    one=TUNED_TRUE,
    rival=TUNED_ESTIMATE,
    columns=(),
    marked=(),
    luck=None,
    more_training=1,
    evaluation_seeds=FEW_SEEDS,
)
