"""What may be chosen of an absorber: the variables of each concept, with the bounds of a search and the paper's values.

Gap, friction, stiffness and damping of an absorber are counted in units of the structure (`optimisation.units`), so that one pair of bounds fits any:
a gap in rule gaps, a friction limit in absorber mass times gap times omega squared. Every default is the paper's (section 6), in SI units, read from
the simulator's own defaults where those are the paper's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from impact_env.parameters import DEFAULT_MASS_RATIO, LARGE, Beam, CoulombFriction, RigidWalls, TunedAbsorber, friction_damper, number, require
from optimisation.friction_rule import PAPER_FRICTION

IMPACT, FRICTION, TUNED, SEVERAL = "impact", "friction", "tuned", "several"
WITH_IMPACTS = (IMPACT, SEVERAL)  # chaotic, and so with noisy levels
GAP, RESTITUTION, FRICTION_LIMIT, STIFFNESS, DAMPING = "gap", "restitution", "friction_limit", "stiffness", "damping"
MASS_RATIO, POSITION, SHARE = "mass_ratio", "position", "share"
MEMBERS = (1, 2)  # numbers of the absorbers of SEVERAL


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
        ok = -LARGE <= number(self.low) < number(self.high) <= LARGE
        require(ok, f"bounds of {self.name}", (self.low, self.high), "two finite numbers, the first below the second")
        require(not self.log or self.low > 0, f"bounds of {self.name}", (self.low, self.high), "above 0, as it is searched in logarithms")
        ends = self.low, self.high
        require(not self.whole or all(x == round(x) for x in ends), f"bounds of {self.name}", ends, "whole numbers: it is a choice among them")
        for name in ("low", "high"):
            object.__setattr__(self, name, float(getattr(self, name)))
        if not self.scaled:
            object.__setattr__(self, "si", self.unit)

    def within(self, low: float, high: float) -> Variable:
        """Return the variable with other bounds, in SI units."""
        return replace(self, low=low, high=high, unit=self.si, scaled=False)

    def choice(self, number: int) -> Variable:
        """Return the variable as a choice among the places 1 to ``number``; bounds that are its own by default give way, others stay."""
        ends = (1.0, float(number)) if (self.low, self.high) == (_POSITION.low, _POSITION.high) else (self.low, self.high)
        require(ends[0] >= 1 and ends[1] <= number, f"bounds of {self.name}", ends, f"numbers of the structure's places, 1 to {number}")
        return replace(self, low=ends[0], high=ends[1], unit="", si="", whole=True)

    def value_at(self, share: float) -> float:
        """Return the value at a share of the range, 0 to 1, in logarithms if ``log``."""
        if self.whole:
            return min(self.low + math.floor(share * (self.high - self.low + 1)), self.high)
        if self.log:
            return float(math.exp(math.log(self.low) + share * (math.log(self.high) - math.log(self.low))))
        return self.low + share * (self.high - self.low)

    def share_of(self, value: float) -> float:
        """Return the share of the range at which a value lies, cut to 0..1."""
        if self.whole:
            return min(max((value - self.low + 0.5) / (self.high - self.low + 1), 0.0), 1.0)
        low, high, x = (math.log(self.low), math.log(self.high), math.log(max(value, 1e-300))) if self.log else (self.low, self.high, value)
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
    friction = replace(own[FRICTION_LIMIT], default=PAPER_FRICTION / len(MEMBERS))
    return tuple(replace(v, name=of_absorber(v.name, which)) for v in (own[GAP], own[RESTITUTION], friction, own[POSITION]))


VARIABLES: dict[str, tuple[Variable, ...]] = {
    IMPACT: (
        Variable(GAP, "of the rule's gap", 0.1, 4.0, RigidWalls.gap, log=True, si="m", scaled=True),
        Variable(RESTITUTION, "", 0.3, 0.95, PAPER_RESTITUTION),
        Variable(FRICTION_LIMIT, "of m_a gap omega^2", 0.001, 1.0, PAPER_FRICTION, log=True, si="N", scaled=True),
        _MASS,
        _POSITION,
    ),
    FRICTION: (
        Variable(FRICTION_LIMIT, "of m_a omega^2 times the free amplitude", 0.005, 10.0, _DAMPER.limit, log=True, si="N", scaled=True),
        _MASS,
        _POSITION,
    ),
    TUNED: (
        Variable(STIFFNESS, "of m_a omega^2", 0.14, 7.0, TunedAbsorber.stiffness, log=True, si="N/m", scaled=True),
        Variable(DAMPING, "of 2 m_a omega", 0.009, 1.8, TunedAbsorber.damping, log=True, si="N s/m", scaled=True),
        _MASS,
        _POSITION,
    ),
}
# two impact absorbers on one mass budget: ``mass_ratio`` is that of both, of which the first has ``share``
VARIABLES[SEVERAL] = (*(v for which in MEMBERS for v in _one_of_several(which)), Variable(SHARE, "of the mass", 0.1, 0.9, 0.5), _MASS)
# raised when variables, their meaning or their defaults change: a study of another version is not continued
VERSIONS = {IMPACT: 2, FRICTION: 2, TUNED: 2, SEVERAL: 2}
FREE = {
    IMPACT: (GAP, RESTITUTION, FRICTION_LIMIT),
    FRICTION: (FRICTION_LIMIT,),
    TUNED: (STIFFNESS, DAMPING),
    SEVERAL: (of_absorber(GAP, 1), of_absorber(GAP, 2), of_absorber(POSITION, 2), SHARE),
}
