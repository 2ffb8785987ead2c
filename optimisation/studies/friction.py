"""What friction does to an impact absorber: which of two branches the members take, and whether anything is left of it with less damping.

On the paper's beam at 3.5 N near the first resonance, the paper's absorber otherwise; with less damping also a gap 1.4 times the rule's, where the
rule's is too narrow (docs/design_rule.md). Levels are those of fresh members, relative to no absorber.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from impact_env.curve import BAND
from impact_env.parameters import Beam
from optimisation.branches import Branches, branches
from optimisation.designs import FRICTION_LIMIT, GAP, IMPACT, Design, design_space
from optimisation.evaluation import Executor, Progress
from optimisation.insight import SHOWN
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.search.judge import judged

LIMITS = (0.0, 0.002, 0.0125, 0.06, 0.1)  # N
CASES = ((0.01, 1.0), (0.005, 1.0), (0.005, 1.4), (0.002, 1.4))  # damping ratio, and gap over the rule's
FORCE = 3.5


@dataclass(frozen=True)
class Row:
    """Levels over no absorber of one friction limit (N): median and 5 to 95 % over the members, and their branches."""

    damping: float
    gap: float  # over the rule's
    limit: float
    median: float
    low: float
    high: float
    branches: Branches | None


def rows(
    damping: float, factor: float, members: int, executor: Executor, speed: float = 1.0, progress: Progress | None = None, beam: Beam | None = None
) -> Iterator[Row]:
    """Yield a row for each of `LIMITS`, on the paper's ``beam`` with another damping; ``speed`` times the usual sweep rate."""
    own = Beam(damping_ratio=damping) if beam is None else beam
    problem = Problem(design_space(IMPACT), (Condition(1, FORCE),), beam=own, members=members)
    start = problem.space.default.values
    designs = [Design(IMPACT, {**start, GAP: factor * start[GAP], FRICTION_LIMIT: limit}) for limit in LIMITS]
    swept = Problem(design_space(IMPACT), (Condition(1, FORCE),), beam=own, members=members, rate=speed * problem.rate)
    for limit, found in zip(LIMITS, judged(swept, designs, swept.fresh_ensemble(members, SHOWN), executor, progress), strict=True):
        low, median, high = (float(x) for x in np.quantile(found.members[0], (BAND[0], 0.5, BAND[1])))
        yield Row(damping, factor, limit, median, low, high, branches(found.members[0]))
