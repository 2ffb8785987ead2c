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
from optimisation.gap_advice import advise
from optimisation.gap_check import scaled_absorber
from optimisation.tuned import minimax

MEMBERS = 1  # as `design_gap --quick`


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
    """Return what a search by quick sweeps recommends at the marked force: new values by the controls' names, and why.

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

    own = scaled_absorber(model, force, resonance, values["mass_ratio"], values["restitution"])
    found = advise(model, force, resonance, own, members=MEMBERS, progress=watch)
    best = found.recommended or found.sharp
    if stop.given or best is None:
        raise Newer
    rule = 1e3 * found.check.rule
    why = f"lowest level over {100 * found.tolerance:.0f} % of the force, by {found.sweeps} sweeps; the design rule says {rule:.3g} mm"
    return {"values": {"gap": best.gap, "friction": best.friction_limit}, "why": why}
