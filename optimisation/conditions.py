"""The conditions (resonance, force) under which commands and studies judge a design, and the size of a quick look."""

from __future__ import annotations

import numpy as np

from impact_env.drive import PAPER_LIMITS
from impact_env.loads import Loads
from optimisation.comparison import WIDE_LIMITS
from optimisation.designs import TUNED
from optimisation.objectives import Condition

RANGE_FORCES = 8  # forces between a third and three times the given one, for the objective range
QUICK_SPEED, QUICK_MEMBERS = 10.0, 2


def load_conditions(loads: Loads, spread: bool = False) -> tuple[Condition, ...]:
    """Return the conditions under loads: as they are, or with ``spread`` times factors."""
    factors = np.geomspace(1 / 3, 3, RANGE_FORCES) if spread else np.ones(1)
    return tuple(Condition(1, float(factor), loads=loads) for factor in factors)


def make_conditions(concept: str, at: list[tuple[int, float]], spread: bool = False) -> tuple[Condition, ...]:
    """Return conditions; a tuned absorber is swept so wide that both of its peaks are seen."""
    limits = WIDE_LIMITS if concept == TUNED else PAPER_LIMITS
    factors = np.geomspace(1 / 3, 3, RANGE_FORCES) if spread else np.ones(1)
    return tuple(Condition(resonance, force * float(factor), limits) for resonance, force in at for factor in factors)
