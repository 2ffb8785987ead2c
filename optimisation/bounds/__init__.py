"""Limits that no device of a mass and a cavity can beat, the design rule in them, and the share of the possible that a design reached.

`optimisation.bounds.relaxation` holds the passive limit by semidefinite programming; it needs cvxpy and is imported on its own.
"""

from optimisation.bounds.rule import NEAR, common_gap, design_force, design_gap, near_range
from optimisation.bounds.share import reduction_share, share_reached
from optimisation.bounds.stroke import SWEPT, resonance_limit, stroke_limit_rms

__all__ = [
    "NEAR",
    "SWEPT",
    "common_gap",
    "design_force",
    "design_gap",
    "near_range",
    "reduction_share",
    "resonance_limit",
    "share_reached",
    "stroke_limit_rms",
]
