"""What may be chosen of an absorber: the variables of each concept, with the bounds of a search and the paper's values.

Gap, friction, stiffness and damping of an absorber are counted in units of the structure (`Units`), so that one pair of bounds fits any:
a gap in rule gaps, a friction limit in absorber mass times gap times omega squared. Every default is the paper's (section 6), in SI units, read from
the simulator's own defaults where those are the paper's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

from impact_env.modes import ModalModel, Structure
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    LARGE,
    Beam,
    CoulombFriction,
    RigidWalls,
    TunedAbsorber,
    count,
    finite,
    flag,
    friction_damper,
    instance,
    keep_checked,
    kind_of,
    number,
    require,
    text,
)
from optimisation.absorber_rules import PAPER_FRICTION, scaled_friction
from optimisation.bounds import free_amplitude, gap_unit
from optimisation.mounting import model_with_absorber_at

IMPACT = "impact"
FRICTION = "friction"
TUNED = "tuned"
SEVERAL = "several"
WITH_IMPACTS = (IMPACT, SEVERAL)  # chaotic, and so with noisy levels
GAP = "gap"
RESTITUTION = "restitution"
FRICTION_LIMIT = "friction_limit"
STIFFNESS = "stiffness"
DAMPING = "damping"
MASS_RATIO = "mass_ratio"
POSITION = "position"
SHARE = "share"
ABSORBER_IDS = (1, 2)  # numbers of the absorbers of SEVERAL


@dataclass(frozen=True)
class Variable:
    """One number of a design: bounds ``low`` and ``high`` of the search in ``unit``; ``log`` if ratios matter, not differences.

    ``default`` is in the SI unit ``si``. The bounds of a ``scaled`` variable are in a unit of the structure, those of another are in SI units too.
    ``whole``: a choice among whole numbers, bounds included; each has the same share of the range.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    log: bool = False
    si: str = ""
    scaled: bool = False
    whole: bool = False

    def __post_init__(self) -> None:
        bounds = self.low, self.high
        keep_checked(
            self,
            low=lambda _name, value: number(value),
            high=lambda _name, value: number(value),
            default=finite,
            name=text,
            unit=text,
            si=text,
            log=flag,
            scaled=flag,
            whole=flag,
        )
        allowed = "two finite numbers, the first below the second"
        ok = -LARGE <= self.low < self.high <= LARGE
        require(ok, f"bounds of {self.name}", bounds, allowed)
        require(
            not self.log or self.low > 0,
            f"bounds of {self.name}",
            (self.low, self.high),
            "above 0, as it is searched in logarithms",
        )
        ends = self.low, self.high
        require(
            not self.whole or all(x == round(x) for x in ends),
            f"bounds of {self.name}",
            ends,
            "whole numbers: it is a choice among them",
        )
        if not self.scaled:
            object.__setattr__(self, "si", self.unit)

    def within(self, low: float, high: float) -> Variable:
        """Return the variable with other bounds, in SI units."""
        return replace(self, low=low, high=high, unit=self.si, scaled=False)

    def choice(self, number: int) -> Variable:
        """Return the variable as a choice among the places 1 to ``number``; bounds that are its own by default give way, others stay."""
        ends = (
            (1.0, float(number))
            if (self.low, self.high) == (_POSITION.low, _POSITION.high)
            else (self.low, self.high)
        )
        require(
            ends[0] >= 1 and ends[1] <= number,
            f"bounds of {self.name}",
            ends,
            f"numbers of the structure's places, 1 to {number}",
        )
        return replace(self, low=ends[0], high=ends[1], unit="", si="", whole=True)

    def value_at(self, share: float) -> float:
        """Return the value at a share of the range, 0 to 1, in logarithms if ``log``."""
        if self.whole:
            return min(self.low + math.floor(share * (self.high - self.low + 1)), self.high)
        if self.log:
            return float(
                math.exp(math.log(self.low) + share * (math.log(self.high) - math.log(self.low)))
            )
        return self.low + share * (self.high - self.low)

    def share_of(self, value: float) -> float:
        """Return the share of the range at which a value lies, cut to 0..1."""
        if self.whole:
            return min(max((value - self.low + 0.5) / (self.high - self.low + 1), 0.0), 1.0)
        low, high, x = (
            (math.log(self.low), math.log(self.high), math.log(max(value, 1e-300)))
            if self.log
            else (self.low, self.high, value)
        )
        return min(max((x - low) / (high - low), 0.0), 1.0)


_MASS = Variable(MASS_RATIO, "of the beam's mass", 0.005, 0.05, DEFAULT_MASS_RATIO, log=True)
_POSITION = Variable(POSITION, "of the beam's length", 0.3, 1.0, Beam.absorber_position)
PAPER_RESTITUTION = 0.7  # of the paper's absorber of section 6
_DAMPER = friction_damper().friction
assert isinstance(_DAMPER, CoulombFriction)


def of_absorber(name: str, which: int) -> str:
    """Return the name of a variable of one of several absorbers."""
    return f"{name}_{which}"


def _one_of_several(which: int) -> tuple[Variable, ...]:
    """Return the variables of one of the two absorbers of SEVERAL. Each has half the paper's friction, as it has half the mass."""
    own = {variable.name: variable for variable in VARIABLES[IMPACT]}
    friction = replace(own[FRICTION_LIMIT], default=PAPER_FRICTION / len(ABSORBER_IDS))
    return tuple(
        replace(v, name=of_absorber(v.name, which))
        for v in (own[GAP], own[RESTITUTION], friction, own[POSITION])
    )


VARIABLES: dict[str, tuple[Variable, ...]] = {
    IMPACT: (
        Variable(GAP, "of the rule's gap", 0.1, 4.0, RigidWalls.gap, log=True, si="m", scaled=True),
        Variable(RESTITUTION, "", 0.3, 0.95, PAPER_RESTITUTION),
        Variable(
            FRICTION_LIMIT,
            "of m_a gap omega^2",
            0.001,
            1.0,
            PAPER_FRICTION,
            log=True,
            si="N",
            scaled=True,
        ),
        _MASS,
        _POSITION,
    ),
    FRICTION: (
        Variable(
            FRICTION_LIMIT,
            "of m_a omega^2 times the free amplitude",
            0.005,
            10.0,
            _DAMPER.limit,
            log=True,
            si="N",
            scaled=True,
        ),
        _MASS,
        _POSITION,
    ),
    TUNED: (
        Variable(
            STIFFNESS,
            "of m_a omega^2",
            0.14,
            7.0,
            TunedAbsorber.stiffness,
            log=True,
            si="N/m",
            scaled=True,
        ),
        Variable(
            DAMPING,
            "of 2 m_a omega",
            0.009,
            1.8,
            TunedAbsorber.damping,
            log=True,
            si="N s/m",
            scaled=True,
        ),
        _MASS,
        _POSITION,
    ),
}
# two impact absorbers on one mass budget: ``mass_ratio`` is that of both, of which the first has ``share``
VARIABLES[SEVERAL] = (
    *(v for which in ABSORBER_IDS for v in _one_of_several(which)),
    Variable(SHARE, "of the mass", 0.1, 0.9, 0.5),
    _MASS,
)
# raised when variables, their meaning or their defaults change: a study of another version is not continued
VERSIONS = {IMPACT: 2, FRICTION: 2, TUNED: 2, SEVERAL: 2}
DEFAULT_FREE = {
    IMPACT: (GAP, RESTITUTION, FRICTION_LIMIT),
    FRICTION: (FRICTION_LIMIT,),
    TUNED: (STIFFNESS, DAMPING),
    SEVERAL: (of_absorber(GAP, 1), of_absorber(GAP, 2), of_absorber(POSITION, 2), SHARE),
}


# Units of a structure by which absorbers are counted, so that bounds and start of a search fit any structure.
#
# The scaling law leaves a design only ratios: its gap over a length of the motion, here the rule's gap, or the free amplitude where that is smaller;
# its friction limit over m_a g0 omega^2; a stiffness over m_a omega^2 and a damping over 2 m_a omega. A damper has no gap, and its length is the free
# amplitude. omega is that of the lowest resonance that counts, and of several resonances the widest gap counts (`optimisation.bounds.common_gap`).


Values = Mapping[str, float]
MOST_GAPS = 10.0  # the free amplitude counts as no more gaps than this: that of an undamped structure is infinite


def parts_of(name: str) -> tuple[str, int | None]:
    """Return the kind of a variable and, of several absorbers, the number of the one that it is of."""
    kind, _, which = name.rpartition("_")
    return (kind, int(which)) if which.isdigit() else (name, None)


def _check_forces(name: str, value: Any) -> dict[int, float]:
    """Return a force in N for each resonance, counted from 1."""
    forces = instance(name, value, Mapping)
    require(len(forces) > 0, name, dict(forces), "at least one resonance with its force in N")
    return {count("resonance", k, 1): finite(f"{name}[{k}]", force) for k, force in forces.items()}


@dataclass(frozen=True, eq=False)
class Units:
    """Units of a ``beam`` under ``forces`` in N, one for each resonance (counted from 1)."""

    beam: Structure
    forces: Mapping[int, float]

    def __post_init__(self) -> None:
        keep_checked(self, beam=kind_of(Structure), forces=_check_forces)

    @cached_property
    def _cached(self) -> dict[tuple[str, float, float], float]:
        return {}

    @cached_property
    def _models(self) -> dict[float | None, ModalModel]:
        return {}

    def model(self, position: float | None = None) -> ModalModel:
        """Return the modal model with the absorber at a share of the length, or at a modal model's place; None: at the structure's own place."""
        if position is not None and isinstance(self.beam, Beam):
            position = min(
                position, 1.0
            )  # a space that is not bound to its modal model yet counts in the paper's units, which know no places
        if position not in self._models:
            self._models[position] = model_with_absorber_at(self.beam, position)
        return self._models[position]

    @cached_property
    def omega(self) -> float:
        """Frequency in rad/s of the lowest resonance that counts."""
        return self.model().resonance_omega(min(self.forces))

    def _length(self, kind: str, mass_ratio: float, position: float) -> float:
        key = (kind, mass_ratio, position)
        if key not in self._cached:
            model = self.model(position)
            mass = mass_ratio * model.beam_mass
            if kind == GAP:
                self._cached[key] = max(
                    gap_unit(model, mass, force, resonance)
                    for resonance, force in self.forces.items()
                )
            else:
                lowest = min(self.forces)
                widest = MOST_GAPS * gap_unit(model, mass, self.forces[lowest], lowest)
                self._cached[key] = min(
                    free_amplitude(model, mass, self.forces[lowest], lowest), widest
                )
        return self._cached[key]

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
        require(
            kind == DAMPING,
            "scaled variable",
            name,
            f"one of {GAP}, {FRICTION_LIMIT}, {STIFFNESS}, {DAMPING}",
        )
        return 2 * inertia / self.omega

    def start(self, concept: str, name: str, values: Values) -> float:
        """Return the start of a search in SI units: the rule's gap, the paper's friction by the scaling law, else the paper's share of the unit."""
        kind, which = parts_of(name)
        if kind == GAP:
            return self.of(concept, name, values)
        if kind == FRICTION_LIMIT and concept in (IMPACT, SEVERAL):
            mass = self.of(concept, name, values) / (
                self.omega**2 * values[GAP if which is None else of_absorber(GAP, which)]
            )
            return scaled_friction(
                self.model(), mass, values[GAP if which is None else of_absorber(GAP, which)]
            )
        default = {v.name: v.default for v in VARIABLES[concept]}
        return (
            default[name]
            / paper_units().of(concept, name, default)
            * self.of(concept, name, values)
        )


@cache
def paper_units() -> Units:
    """Return the units of the paper's beam at its best operating point near the first resonance."""
    return Units(Beam(), {1: 3.5})
