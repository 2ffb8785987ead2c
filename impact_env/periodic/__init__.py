"""Periodic responses: exact orbits with their stability, branches, and lifetimes of regimes.

Examples are in docs/periodic_python.md.

The names below are the public interface; a module is imported at the first use of one of its names.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from impact_env.periodic.attractors import (
        MotionKind,
        SettledMotion,
        SettleOptions,
        settle_motion,
    )
    from impact_env.periodic.basins import (
        Attractor,
        AttractorMap,
        BasinPoint,
        Basins,
        Lifetimes,
        Share,
        attractor_map,
        basin_fractions,
        find_basins,
        fit_lifetimes,
    )
    from impact_env.periodic.bifurcation_curves import (
        BifurcationCurve,
        bifurcation_curve,
        bifurcation_curves,
    )
    from impact_env.periodic.bifurcations import confirmed_bifurcation, critical_multipliers
    from impact_env.periodic.case import Case, case_of
    from impact_env.periodic.diagrams import (
        BranchPoints,
        Diagram,
        DiagramPoint,
        diagram_branches,
        diagram_points,
    )
    from impact_env.periodic.green import NoOrbit
    from impact_env.periodic.harmonic_balance import hill_multipliers
    from impact_env.periodic.hybrid_branches import HybridBranch, hybrid_branch
    from impact_env.periodic.hybrid_case import HybridCase
    from impact_env.periodic.hybrid_orbit import (
        HybridOrbit,
        NoHybridOrbit,
        find_hybrid_orbits,
        hybrid_orbit_of,
        hybrid_orbit_of_simulation,
        plain_hybrid_orbit,
        shoot_hybrid,
    )
    from impact_env.periodic.normal_forms import MapForms
    from impact_env.periodic.offspring import descendants
    from impact_env.periodic.orbit import (
        Orbit,
        confirm_orbit,
        orbit_of,
        plain_orbit,
        shoot_orbit,
        unpack_orbits,
    )
    from impact_env.periodic.orbit_branches import OrbitBranch, orbit_branch, orbit_branches
    from impact_env.periodic.orbit_map import critical_point_of
    from impact_env.periodic.quasi_periodic import RotationNumber, rotation_number
    from impact_env.periodic.residence import (
        Approach,
        Hazard,
        Range,
        exit_rate,
        hazard,
        jumps,
        residence_times,
    )
    from impact_env.periodic.shooting import Exponent, largest_exponent
    from impact_env.periodic.slow_manifold import (
        ManifoldCheck,
        SlowManifold,
        check_manifold,
        manifold_gap,
        modal_restitution,
    )
    from impact_env.periodic.survey import closed_form_orbits, orbit_of_simulation

__all__ = [
    "Approach",
    "Basins",
    "BifurcationCurve",
    "Case",
    "Exponent",
    "Hazard",
    "ManifoldCheck",
    "MapForms",
    "NoOrbit",
    "Orbit",
    "OrbitBranch",
    "Range",
    "Share",
    "SlowManifold",
]
__all__ += [
    "bifurcation_curve",
    "bifurcation_curves",
    "case_of",
    "check_manifold",
    "closed_form_orbits",
    "confirm_orbit",
    "confirmed_bifurcation",
    "critical_multipliers",
    "critical_point_of",
    "descendants",
    "exit_rate",
    "find_basins",
    "hazard",
]
__all__ += [
    "hill_multipliers",
    "jumps",
    "largest_exponent",
    "manifold_gap",
    "modal_restitution",
    "orbit_branch",
    "orbit_branches",
    "orbit_of",
    "orbit_of_simulation",
    "plain_orbit",
]
__all__ += ["residence_times", "shoot_orbit", "unpack_orbits"]
__all__ += [
    "Attractor",
    "AttractorMap",
    "BasinPoint",
    "BranchPoints",
    "Diagram",
    "DiagramPoint",
    "Lifetimes",
    "MotionKind",
    "RotationNumber",
    "SettleOptions",
    "SettledMotion",
    "attractor_map",
    "basin_fractions",
    "diagram_branches",
    "diagram_points",
    "fit_lifetimes",
    "rotation_number",
    "settle_motion",
]
__all__ += [
    "HybridBranch",
    "HybridCase",
    "HybridOrbit",
    "NoHybridOrbit",
    "find_hybrid_orbits",
    "hybrid_branch",
    "hybrid_orbit_of",
    "hybrid_orbit_of_simulation",
    "plain_hybrid_orbit",
    "shoot_hybrid",
]
_MODULES = {
    "attractors": ("MotionKind", "SettledMotion", "SettleOptions", "settle_motion"),
    "basins": (
        "Attractor",
        "AttractorMap",
        "BasinPoint",
        "Basins",
        "Lifetimes",
        "Share",
        "attractor_map",
        "basin_fractions",
        "find_basins",
        "fit_lifetimes",
    ),
    "bifurcations": ("confirmed_bifurcation", "critical_multipliers"),
    "bifurcation_curves": ("BifurcationCurve", "bifurcation_curve", "bifurcation_curves"),
    "case": ("Case", "case_of"),
    "diagrams": (
        "BranchPoints",
        "Diagram",
        "DiagramPoint",
        "diagram_branches",
        "diagram_points",
    ),
    "green": ("NoOrbit",),
    "harmonic_balance": ("hill_multipliers",),
    "hybrid_branches": ("HybridBranch", "hybrid_branch"),
    "hybrid_case": ("HybridCase",),
    "hybrid_orbit": (
        "HybridOrbit",
        "NoHybridOrbit",
        "find_hybrid_orbits",
        "hybrid_orbit_of",
        "hybrid_orbit_of_simulation",
        "plain_hybrid_orbit",
        "shoot_hybrid",
    ),
    "normal_forms": ("MapForms",),
    "offspring": ("descendants",),
    "orbit": ("Orbit", "confirm_orbit", "orbit_of", "plain_orbit", "shoot_orbit", "unpack_orbits"),
    "orbit_branches": ("OrbitBranch", "orbit_branch", "orbit_branches"),
    "orbit_map": ("critical_point_of",),
    "quasi_periodic": ("RotationNumber", "rotation_number"),
    "residence": ("Approach", "Hazard", "Range", "exit_rate", "hazard", "jumps", "residence_times"),
    "shooting": ("Exponent", "largest_exponent"),
    "slow_manifold": (
        "ManifoldCheck",
        "SlowManifold",
        "check_manifold",
        "manifold_gap",
        "modal_restitution",
    ),
    "survey": ("closed_form_orbits", "orbit_of_simulation"),
}


# names before, for one release
_FORMER_NAMES = {
    "confirmed": "confirm_orbit",
    "shot_orbit": "shoot_orbit",
    "stays": "residence_times",
    "unpacked": "unpack_orbits",
}


def __getattr__(name: str) -> Any:
    name = _FORMER_NAMES.get(name, name)
    module = next((module for module, names in _MODULES.items() if name in names), None)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{module}"), name)
