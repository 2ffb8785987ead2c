"""What the explorer's button recommends: the one place that asks the library for advice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from impact_env.budget import Stop
from impact_env.modes import ModalModel
from impact_env.parameters import TunedAbsorber
from optimisation.bounds import design_gap
from optimisation.explore.settings import Asked
from optimisation.explore.waiting import Newer
from optimisation.friction_rule import best_friction
from optimisation.gap_check import check_gap, gap_factors, scaled_absorber
from optimisation.tuned import minimax

QUICK_GAPS, QUICK_MEMBERS = 5, 2  # as `design_gap --quick`


@dataclass(frozen=True)
class _Same:
    """A model that is the same as any other with the same numbers."""

    key: bytes
    model: ModalModel = field(compare=False)

    @staticmethod
    def of(model: ModalModel) -> _Same:
        return _Same(b"".join(x.tobytes() for x in (model.omega, model.damping_ratio, model.force_shape, model.tip_shape, model.level_shape)), model)


@lru_cache(maxsize=64)
def _tuned(same: _Same, mass_ratio: float, resonance: int) -> TunedAbsorber:
    return minimax(same.model, mass_ratio, resonance)  # takes seconds


def tuned_to(model: ModalModel, mass_ratio: float, resonance: int) -> TunedAbsorber:
    """Return the linear absorber with the smallest peak; known at once for the same numbers."""
    return _tuned(_Same.of(model), mass_ratio, resonance)


def recommended(values: Asked, model: ModalModel, stop: Stop, tell: Callable[[int, int], None]) -> dict[str, Any]:
    """Return what the design rule, checked by quick sweeps, recommends at the marked force: new values by the controls' names, and why.

    ``model`` has the absorber's place, ``tell`` is told finished and all runs. Raises `Newer` after a ``stop``.
    """
    mass, force, resonance = values["mass_ratio"] * model.beam_mass, values["force"], values.resonance
    if values.concept == "tuned":
        tuned = tuned_to(model, values["mass_ratio"], resonance)
        return {"values": {"stiffness": tuned.stiffness, "damper": tuned.damping}, "why": "smallest peak of the linear response"}
    if values.concept == "friction":
        limit, _ = best_friction(model, mass, force, resonance)
        return {"values": {"damper_friction": limit}, "why": "most energy lost in a cycle at this force"}
    if values.concept == "two":
        gap = design_gap(model, mass, force, resonance)
        return {"values": {"gap": gap, "second_gap": gap}, "why": "the design rule's gap, as if both masses were one"}

    def watch(done: int, total: int) -> None:
        if stop.given:
            raise KeyboardInterrupt  # the sweeps end early, with what they have
        tell(done, total)

    absorber = scaled_absorber(model, force, resonance, values["mass_ratio"], values["restitution"])
    check = check_gap(model, force, resonance, absorber, factors=gap_factors(QUICK_GAPS), members=QUICK_MEMBERS, progress=watch)
    if stop.given or check.best is None:
        raise Newer
    friction = 0.0 if absorber.friction is None else absorber.friction.limit
    level, rule = check.level[check.best], check.level[check.at_rule]
    why = (
        f"best of {len(check.gaps)} gaps around the design rule's {1e3 * check.rule:.3g} mm, by sweeps: {1e3 * level:.3g} mm, {1e3 * rule:.3g} there"
    )
    return {"values": {"gap": float(check.gaps[check.best]), "friction": friction}, "why": why}
