"""Units of a structure by which absorbers are counted, so that bounds and start of a search fit any structure.

The scaling law leaves a design only ratios: its gap over a length of the motion, here the rule's gap, or the free amplitude where that is smaller;
its friction limit over m_a g0 omega^2; a stiffness over m_a omega^2 and a damping over 2 m_a omega. A damper has no gap, and its length is the free
amplitude. omega is that of the lowest resonance that counts, and of several resonances the widest gap counts (`optimisation.bounds.common_gap`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property

from impact_env.modes import ModalModel, Structure
from impact_env.parameters import Beam, require
from optimisation.bounds import free_amplitude, gap_unit
from optimisation.friction_rule import scaled_friction
from optimisation.mounting import mounted
from optimisation.variables import (
    DAMPING,
    FRICTION_LIMIT,
    GAP,
    IMPACT,
    MASS_RATIO,
    POSITION,
    SEVERAL,
    SHARE,
    STIFFNESS,
    VARIABLES,
    of_absorber,
)

Values = Mapping[str, float]
MOST_GAPS = 10.0  # the free amplitude counts as no more gaps than this: that of an undamped structure is infinite


def parts_of(name: str) -> tuple[str, int | None]:
    """Return the kind of a variable and, of several absorbers, the number of the one that it is of."""
    kind, _, which = name.rpartition("_")
    return (kind, int(which)) if which.isdigit() else (name, None)


@dataclass(frozen=True, eq=False)
class Units:
    """Units of a ``beam`` under ``forces`` in N, one for each resonance (counted from 1)."""

    beam: Structure
    forces: Mapping[int, float]

    def __post_init__(self) -> None:
        require(len(self.forces) > 0, "forces", dict(self.forces), "at least one resonance with its force in N")

    @cached_property
    def _kept(self) -> dict[tuple[str, float, float], float]:
        return {}

    @cached_property
    def _models(self) -> dict[float | None, ModalModel]:
        return {}

    def model(self, position: float | None = None) -> ModalModel:
        """Return the modal model with the absorber at a share of the length, or at a modal model's place; None: at the structure's own place."""
        if position is not None and isinstance(self.beam, Beam):
            position = min(position, 1.0)  # a space that is not bound to its modal model yet counts in the paper's units, which know no places
        if position not in self._models:
            self._models[position] = mounted(self.beam, position)
        return self._models[position]

    @cached_property
    def omega(self) -> float:
        """Frequency in rad/s of the lowest resonance that counts."""
        return self.model().resonance_omega(min(self.forces))

    def _length(self, kind: str, mass_ratio: float, position: float) -> float:
        key = (kind, mass_ratio, position)
        if key not in self._kept:
            model = self.model(position)
            mass = mass_ratio * model.beam_mass
            if kind == GAP:
                self._kept[key] = max(gap_unit(model, mass, force, resonance) for resonance, force in self.forces.items())
            else:
                lowest = min(self.forces)
                widest = MOST_GAPS * gap_unit(model, mass, self.forces[lowest], lowest)
                self._kept[key] = min(free_amplitude(model, mass, self.forces[lowest], lowest), widest)
        return self._kept[key]

    def gap(self, mass_ratio: float, position: float = 1.0) -> float:
        """Return the unit of gaps in m for an absorber of this mass and place."""
        return self._length(GAP, mass_ratio, position)

    def amplitude(self, mass_ratio: float, position: float = 1.0) -> float:
        """Return the free amplitude in m under the lowest resonance's force, at most ten gaps."""
        return self._length("amplitude", mass_ratio, position)

    def of(self, concept: str, name: str, values: Values) -> float:
        """Return the unit of a scaled variable, in SI units, for a design with these ``values`` of mass, place and, for its friction, gap."""
        kind, which = parts_of(name)
        total = values[MASS_RATIO]
        share = 1.0 if which is None else values[SHARE] if which == 1 else 1 - values[SHARE]
        place = values[POSITION if which is None else of_absorber(POSITION, which)]
        inertia = total * share * self.model().beam_mass * self.omega**2
        if kind == GAP:
            return self.gap(total, place)
        if kind == FRICTION_LIMIT and concept in (IMPACT, SEVERAL):
            return inertia * values[GAP if which is None else of_absorber(GAP, which)]
        if kind == FRICTION_LIMIT:
            return inertia * self.amplitude(total, place)
        if kind == STIFFNESS:
            return inertia
        require(kind == DAMPING, "scaled variable", name, f"one of {GAP}, {FRICTION_LIMIT}, {STIFFNESS}, {DAMPING}")
        return 2 * inertia / self.omega

    def start(self, concept: str, name: str, values: Values) -> float:
        """Return the start of a search in SI units: the rule's gap, the paper's friction by the scaling law, else the paper's share of the unit."""
        kind, which = parts_of(name)
        if kind == GAP:
            return self.of(concept, name, values)
        if kind == FRICTION_LIMIT and concept in (IMPACT, SEVERAL):
            mass = self.of(concept, name, values) / (self.omega**2 * values[GAP if which is None else of_absorber(GAP, which)])
            return scaled_friction(self.model(), mass, values[GAP if which is None else of_absorber(GAP, which)])
        default = {v.name: v.default for v in VARIABLES[concept]}
        return default[name] / paper_units().of(concept, name, default) * self.of(concept, name, values)


@cache
def paper_units() -> Units:
    """Return the units of the paper's beam at its best operating point near the first resonance."""
    return Units(Beam(), {1: 3.5})
