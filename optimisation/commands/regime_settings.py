"""What the command on regimes computes: the page's cases, or a scene of one's own from its options."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from impact_env.ensemble import Executor
from impact_env.parameters import positive, require
from impact_env.periodic.jump import Range
from optimisation.command_line import BadInput
from optimisation.commands.sweep_scene import make_scene, refuse_parts
from optimisation.studies.regimes.cases import Case, Settings, cases, grid

OWN = ("scene", "structure", "modes", "damping", "mass_ratio", "gap", "restitution", "friction_limit", "force")
NOT_ASKED = ("absorber", "contact_stiffness", "friction_stiffness", "stiffness", "absorber_damping")
QUICK = {"stay_members": 10, "stay_periods": 1000.0, "sweep_members": 10, "kind_members": 4, "settle": 200.0, "window": 60, "quick": True}
FAST = 300.0  # pseudo periods per percent: slower sweeps are left out of a quick look


def is_own(given: dict[str, Any]) -> bool:
    """Return whether options describe a scene of one's own."""
    return any(given[name] is not None for name in OWN)


def own_case(given: dict[str, Any]) -> Case:
    """Return the case that the options describe. Raises BadInput or ParameterError."""
    given = given | dict.fromkeys(NOT_ASKED) | {"resonance": 1}  # the one that is looked at
    refuse_parts(given)
    scene, _ = make_scene(given)
    if given["force"] is None:  # only a structure has a force that follows from the rule
        raise BadInput("a scene of your own needs --force")
    first, last = positive("--from", given["start"]), positive("--to", given["stop"])
    require(first != last, "--to", last, f"different from --from = {first}")
    ratios, step = grid(first, last, given["points"]), 0.05 * (1 if last > first else -1)
    sweep = Range(first - step / 50, first, last, last + step) if given["slowness"] else None
    return Case("own", str(scene), scene, given["force"], given["approach"] or first, ratios, given["slowness"], sweep, tuple(sorted(ratios)))


def chosen_settings(given: dict[str, Any], executor: Executor | None = None) -> Settings:
    """Return what to compute, by an executor as in `run_lanes`. Raises BadInput or ParameterError."""
    own = is_own(given)
    picked = (own_case(given),) if own else cases()
    counts = {} if given["members"] is None else dict.fromkeys(("stay_members", "sweep_members", "kind_members"), given["members"])
    times = {} if given["silence"] is None else {"silence": given["silence"]}
    if given["quick"] and not own:
        picked = tuple(_thinned(case) for case in picked)
    chosen = {**(QUICK if given["quick"] else {}), **counts, **times}
    return Settings(picked, **chosen, seed=given["seed"], threads=given["threads"], executor=executor)


def _thinned(case: Case) -> Case:
    fast = tuple(slowness for slowness in case.slownesses if slowness <= FAST)
    return replace(case, stay_ratios=case.stay_ratios[::9], kind_ratios=case.kind_ratios[::20], slownesses=fast[::2])
