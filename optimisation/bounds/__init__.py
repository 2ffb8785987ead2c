"""Limits that no device of a mass and a cavity can beat, the design rule in them, and the share of the possible that a design reached.

`optimisation.bounds.relaxation` holds the passive limit by semidefinite programming; it needs cvxpy and is imported on its own.
"""

from optimisation.bounds.rule import (
    LARGE_REACH,
    LEAST_REACH,
    NEAR,
    SMALL_REACH,
    common_gap,
    design_force,
    design_gap,
    expected_factor,
    expected_gap,
    free_amplitude,
    gap_unit,
    near_range,
    reach,
    reduction_share,
    require_reach,
    share_reached,
)
from optimisation.bounds.stroke import SWEPT, resonance_limit, stroke_limit_rms

__all__ = [
    "LARGE_REACH",
    "LEAST_REACH",
    "NEAR",
    "SMALL_REACH",
    "SWEPT",
    "common_gap",
    "design_force",
    "design_gap",
    "expected_factor",
    "expected_gap",
    "free_amplitude",
    "gap_unit",
    "near_range",
    "reach",
    "reduction_share",
    "require_reach",
    "resonance_limit",
    "share_reached",
    "stroke_limit_rms",
]
