"""Design spaces: what may be chosen of an absorber, in which bounds, and what a choice means as a scene.

A space belongs to one concept. It is versioned, because a study that was begun in one version of a space cannot be continued in
another. Every default is the paper's (section 6), read from the simulator's own defaults where those are the paper's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from impact_env.modes import Structure
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    CoulombFriction,
    ParameterError,
    RigidWalls,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    require,
)
from impact_env.scene import Scene
from optimisation.mounting import scene_on

Values = Mapping[str, float]
IMPACT, FRICTION, TUNED, SEVERAL = "impact", "friction", "tuned", "several"
WITH_IMPACTS = (IMPACT, SEVERAL)  # chaotic, and so with noisy levels
GAP, RESTITUTION, FRICTION_LIMIT, STIFFNESS, DAMPING = "gap", "restitution", "friction_limit", "stiffness", "damping"
MASS_RATIO, POSITION, SHARE = "mass_ratio", "position", "share"
MEMBERS = (1, 2)  # numbers of the absorbers of SEVERAL


@dataclass(frozen=True)
class Variable:
    """One number of a design: ``unit``, bounds ``low`` and ``high`` of the search, ``default``; ``log`` if ratios matter, not differences."""

    name: str
    unit: str
    low: float
    high: float
    default: float
    log: bool = False

    def __post_init__(self) -> None:
        ok = math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high
        require(ok, f"bounds of {self.name}", (self.low, self.high), "two finite numbers, the first below the second")
        require(not self.log or self.low > 0, f"bounds of {self.name}", (self.low, self.high), "above 0, as it is searched in logarithms")

    def value_at(self, share: float) -> float:
        """Return the value at a share of the range, 0 to 1, in logarithms if ``log``."""
        if self.log:
            return float(math.exp(math.log(self.low) + share * (math.log(self.high) - math.log(self.low))))
        return self.low + share * (self.high - self.low)

    def share_of(self, value: float) -> float:
        """Return the share of the range at which a value lies, cut to 0..1."""
        low, high, x = (math.log(self.low), math.log(self.high), math.log(max(value, 1e-300))) if self.log else (self.low, self.high, value)
        return min(max((x - low) / (high - low), 0.0), 1.0)


_MASS = Variable(MASS_RATIO, "of the beam's mass", 0.005, 0.05, DEFAULT_MASS_RATIO, log=True)
_POSITION = Variable(POSITION, "of the beam's length", 0.3, 1.0, Beam.absorber_position)
PAPER_RESTITUTION, PAPER_FRICTION = 0.7, 0.1  # the paper's absorber of section 6; mu f_N in N
_DAMPER = friction_damper().friction
assert isinstance(_DAMPER, CoulombFriction)


def of_absorber(name: str, which: int) -> str:
    """Return the name of a variable of one of several absorbers."""
    return f"{name}_{which}"


def _one_of_several(which: int) -> tuple[Variable, ...]:
    """Return the variables of one of the two absorbers of SEVERAL. Each has half the paper's friction, as it has half the mass."""
    own = {variable.name: variable for variable in VARIABLES[IMPACT]}
    friction = replace(own[FRICTION_LIMIT], low=own[FRICTION_LIMIT].low / 2, default=PAPER_FRICTION / len(MEMBERS))
    return tuple(replace(v, name=of_absorber(v.name, which)) for v in (own[GAP], own[RESTITUTION], friction, own[POSITION]))


VARIABLES: dict[str, tuple[Variable, ...]] = {
    IMPACT: (
        Variable(GAP, "m", 1e-4, 4e-3, RigidWalls.gap, log=True),
        Variable(RESTITUTION, "", 0.3, 0.95, PAPER_RESTITUTION),
        Variable(FRICTION_LIMIT, "N", 0.01, 1.0, PAPER_FRICTION, log=True),
        _MASS,
        _POSITION,
    ),
    FRICTION: (Variable(FRICTION_LIMIT, "N", 0.02, 10.0, _DAMPER.limit, log=True), _MASS, _POSITION),
    TUNED: (
        Variable(STIFFNESS, "N/m", 100.0, 5000.0, TunedAbsorber.stiffness, log=True),
        Variable(DAMPING, "N s/m", 0.05, 10.0, TunedAbsorber.damping, log=True),
        _MASS,
        _POSITION,
    ),
}
# two impact absorbers on one mass budget: ``mass_ratio`` is that of both, of which the first has ``share``
VARIABLES[SEVERAL] = (*(v for which in MEMBERS for v in _one_of_several(which)), Variable(SHARE, "of the mass", 0.1, 0.9, 0.5), _MASS)
# raised when variables, their meaning or their defaults change: a study of another version is not continued
VERSIONS = {IMPACT: 1, FRICTION: 1, TUNED: 1, SEVERAL: 1}
FREE = {
    IMPACT: (GAP, RESTITUTION, FRICTION_LIMIT),
    FRICTION: (FRICTION_LIMIT,),
    TUNED: (STIFFNESS, DAMPING),
    SEVERAL: (of_absorber(GAP, 1), of_absorber(GAP, 2), of_absorber(POSITION, 2), SHARE),
}


@dataclass(frozen=True)
class Design:
    """One absorber of a concept, or two: a value for each of the concept's variables, in SI units."""

    concept: str
    values: Values

    def absorber(self) -> Absorber:
        """Return the absorber; a friction limit of 0 leaves friction out."""
        v = self.values
        if self.concept == SEVERAL:
            gaps, positions, restitutions, limits = ([v[of_absorber(n, k)] for k in MEMBERS] for n in (GAP, POSITION, RESTITUTION, FRICTION_LIMIT))
            return impact_absorbers(gaps, positions, restitutions, limits, v[MASS_RATIO], (v[SHARE], 1 - v[SHARE]))
        if self.concept == IMPACT:
            return impact_absorber(v[GAP], v[RESTITUTION], v[FRICTION_LIMIT], v[MASS_RATIO])
        if self.concept == FRICTION:
            return friction_damper(v[FRICTION_LIMIT], v[MASS_RATIO])
        return TunedAbsorber(v[MASS_RATIO], v[STIFFNESS], v[DAMPING])

    def scene(self, structure: Structure) -> Scene:
        """Return the absorber on a structure, at the design's position; the level is read where `optimisation.mounting.watched` says."""
        return scene_on(structure, self.absorber(), None if self.concept == SEVERAL else self.values[POSITION])

    def __str__(self) -> str:
        return f"{self.concept} absorber, " + ", ".join(f"{name} {value:.4g}" for name, value in self.values.items())


@dataclass(frozen=True)
class DesignSpace:
    """A concept with its ``free`` variables, within their bounds, and the values of those that are ``fixed``."""

    concept: str
    free: tuple[Variable, ...]
    fixed: Values = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = _known(self.concept)
        names = [variable.name for variable in self.free]
        require(len(names) > 0, "free variables", names, f"one or more of {', '.join(known)}")
        require(len(set(names)) == len(names), "free variables", names, "each of them once")
        for name in [*names, *self.fixed]:
            require(name in known, f"variable of the concept {self.concept!r}", name, f"one of {', '.join(known)}")
        both = sorted(set(names) & set(self.fixed))
        require(not both, "variables", both, "free or fixed, not both")
        object.__setattr__(self, "fixed", {name: float(self.fixed.get(name, known[name].default)) for name in known if name not in names})
        for share in (0.0, 1.0):  # bounds and fixed values that the simulator refuses are named now, not in the middle of a search
            design = self.design({variable.name: variable.value_at(share) for variable in self.free})
            design.absorber()
            Beam(absorber_position=design.values.get(POSITION, 1.0))

    @property
    def version(self) -> int:
        """Version of the concept's variables."""
        return VERSIONS[self.concept]

    @property
    def default(self) -> Design:
        """The paper's design, with this space's fixed values; free values are cut to their bounds."""
        return self.design({v.name: min(max(v.default, v.low), v.high) for v in self.free})

    def design(self, values: Values) -> Design:
        """Return the design with these values of the free variables; raises ParameterError unless each has one within its bounds."""
        names = [variable.name for variable in self.free]
        require(set(values) == set(names), "values", dict(values), f"one for each of {', '.join(names)}")
        for v in self.free:
            x = values[v.name]
            require(v.low * (1 - 1e-12) <= x <= v.high * (1 + 1e-12), v.name, x, f"from {v.low:g} to {v.high:g} {v.unit}".rstrip())
        chosen = {**self.fixed, **{name: float(values[name]) for name in names}}
        return Design(self.concept, {v.name: chosen[v.name] for v in VARIABLES[self.concept]})

    def at(self, shares: Iterable[float]) -> Design:
        """Return the design at shares (0 to 1) of the free variables' ranges."""
        return self.design({v.name: v.value_at(share) for v, share in zip(self.free, shares, strict=True)})

    def describe(self) -> dict[str, object]:
        """Return what identifies the space, as JSON values."""
        free = {v.name: {"low": v.low, "high": v.high, "log": v.log, "unit": v.unit, "start": self.default.values[v.name]} for v in self.free}
        return {"concept": self.concept, "version": self.version, "free": free, "fixed": dict(self.fixed)}


def _known(concept: str) -> dict[str, Variable]:
    require(concept in VARIABLES, "concept", concept, f"one of {', '.join(VARIABLES)}")
    return {variable.name: variable for variable in VARIABLES[concept]}


def design_space(
    concept: str,
    free: Iterable[str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    fixed: Values | None = None,
) -> DesignSpace:
    """Return a concept's space with the named variables free (default: those of `FREE`), in ``bounds`` where given, else in the concept's own.

    What is neither free nor fixed keeps the paper's value. Raises ParameterError for a name that the concept lacks, and for bounds that
    are empty or inverted.
    """
    known, names = _known(concept), tuple(FREE.get(concept, ()) if free is None else free)
    bounds = {} if bounds is None else bounds
    for name in (*names, *bounds):
        require(name in known, f"variable of the concept {concept!r}", name, f"one of {', '.join(known)}")
    unused = sorted(set(bounds) - set(names))
    if unused:
        raise ParameterError(f"bounds of {', '.join(unused)} are not allowed: bounds are for free variables, which are {', '.join(names)}")
    variables = [known[name] for name in names]
    chosen = tuple(replace(v, low=float(bounds[v.name][0]), high=float(bounds[v.name][1])) if v.name in bounds else v for v in variables)
    return DesignSpace(concept, chosen, {} if fixed is None else fixed)
