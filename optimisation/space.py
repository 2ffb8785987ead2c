"""Design spaces: variables of an absorber, their bounds, and the scene of a design.

A space belongs to one concept, whose `VARIABLES` have the bounds of a search and the paper's values
(section 6), in SI units, read from the simulator's own defaults where those are the paper's. Gap,
friction, stiffness and damping of an absorber are counted in units of the structure (`Units`), so
that one pair of bounds fits any: a gap in rule gaps, a friction limit in absorber mass times gap
times omega squared.

A space is versioned, because a study that was begun in one version of a space cannot be continued
in another. A design is in SI units; its *coordinates*, in which searches move, count scaled
variables in units of the structure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    LARGE,
    ParameterError,
    count,
    each_of,
    finite,
    flag,
    instance,
    kind_of,
    labelled,
    listed,
    number,
    one_of,
    require,
    table_of,
    text,
    two,
)
from impact_env.fields import check_fields
from impact_env.modes import ModalModel, Structure
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    CoulombFriction,
    RigidWalls,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
    impact_absorbers,
)
from impact_env.scene import Scene
from optimisation.absorber_rules import PAPER_FRICTION, scaled_friction
from optimisation.bounds import free_amplitude, gap_unit
from optimisation.mounting import model_with_absorber_at, scene_on
from optimisation.sweep_range import usable_mass_ratio

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
    """A variable of a design.

    Attributes
    ----------
    name : str
        Plain name.
    unit : str
        Unit of the bounds.
    low, high : float
        Bounds of the search in ``unit``.
    default : float
        Default in the SI unit ``si``.
    log : bool
        Whether the search scale is logarithmic.
    si : str
        SI unit.
    scaled : bool
        Whether the bounds are in a unit of the structure; else they are in SI units.
    whole : bool
        Whether the values are whole numbers, bounds included, with equal shares of the range.
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
        check_fields(
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
        """Return the variable as a choice among the places 1 to ``number``.

        The variable's default bounds are replaced, other bounds remain.
        """
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
    """Return the variables of one of the two absorbers of SEVERAL.

    Each has half the paper's friction, because it has half the mass.
    """
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
# two impact absorbers on one mass budget: ``mass_ratio`` is that of both, of which the first has
# ``share``
VARIABLES[SEVERAL] = (
    *(v for which in ABSORBER_IDS for v in _one_of_several(which)),
    Variable(SHARE, "of the mass", 0.1, 0.9, 0.5),
    _MASS,
)
# raised when variables, their meaning or their defaults change: a study of another version is not
# continued
VERSIONS = {IMPACT: 2, FRICTION: 2, TUNED: 2, SEVERAL: 2}
DEFAULT_FREE = {
    IMPACT: (GAP, RESTITUTION, FRICTION_LIMIT),
    FRICTION: (FRICTION_LIMIT,),
    TUNED: (STIFFNESS, DAMPING),
    SEVERAL: (of_absorber(GAP, 1), of_absorber(GAP, 2), of_absorber(POSITION, 2), SHARE),
}


# Units of a structure by which absorbers are counted, so that bounds and start of a search fit any
# structure.
#
# The scaling law leaves a design only ratios: its gap over a length of the motion, here the rule's
# gap, or the free amplitude where that is smaller; its friction limit over m_a g0 omega^2; a
# stiffness over m_a omega^2 and a damping over 2 m_a omega. A damper has no gap, and its length is
# the free amplitude. omega is that of the lowest resonance that counts, and of several resonances
# the widest gap counts (`optimisation.bounds.common_gap`).


Values = Mapping[str, float]
# the free amplitude counts as no more gaps than this: that of an undamped structure is infinite
MOST_GAPS = 10.0


def parts_of(name: str) -> tuple[str, int | None]:
    """Return the kind of a variable and the number of its absorber.

    The number is None unless there are several absorbers.
    """
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
        check_fields(self, beam=kind_of(Structure), forces=_check_forces)

    @cached_property
    def _cached(self) -> dict[tuple[str, float, float], float]:
        return {}

    @cached_property
    def _models(self) -> dict[float | None, ModalModel]:
        return {}

    def model(self, position: float | None = None) -> ModalModel:
        """Return the modal model with the absorber at a position.

        The position is a share of the length, or the number of a modal model's place. None: the
        structure's own place.
        """
        if position is not None and isinstance(self.beam, Beam):
            # a space that is not bound to its modal model yet counts in the paper's units, which
            # know no places
            position = min(position, 1.0)
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
        """Return the unit of a scaled variable, in SI units.

        ``values``: mass, place and, for the friction, gap of the design.
        """
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
        """Return the start of a search in SI units.

        The gap is the rule's, and the friction is the paper's by the scaling law. For other
        variables it is the paper's share of the unit.
        """
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


Array = NDArray[np.float64]
AT_BOUND = (
    0.02  # share of a variable's range: a winner that lies closer to a bound is said to lie at it
)


@dataclass(frozen=True)
class Design:
    """One or two absorbers of a concept.

    The design has a value for each of the concept's variables, in SI units.
    """

    concept: str
    values: Values

    def __post_init__(self) -> None:
        names = _known(self.concept)
        check_fields(self, values=table_of(finite))
        allowed = f"one for each of {', '.join(names)}"
        require(set(self.values) == set(names), "values", dict(self.values), allowed)

    def absorber(self) -> Absorber:
        """Return the absorber; a friction limit of 0 leaves friction out."""
        v = self.values
        if self.concept == SEVERAL:
            gaps, restitutions, limits = (
                [v[of_absorber(n, k)] for k in ABSORBER_IDS]
                for n in (GAP, RESTITUTION, FRICTION_LIMIT)
            )
            positions = [
                min(x, 1.0) for x in self.positions
            ]  # a place of a modal model, counted from 1, is no share of a length: see `scene`
            return impact_absorbers(
                gaps, positions, restitutions, limits, v[MASS_RATIO], (v[SHARE], 1 - v[SHARE])
            )
        if self.concept == IMPACT:
            return impact_absorber(v[GAP], v[RESTITUTION], v[FRICTION_LIMIT], v[MASS_RATIO])
        if self.concept == FRICTION:
            return friction_damper(v[FRICTION_LIMIT], v[MASS_RATIO])
        return TunedAbsorber(v[MASS_RATIO], v[STIFFNESS], v[DAMPING])

    def scene(self, structure: Structure) -> Scene:
        """Return the absorber on a structure, at the design's positions.

        The level is read where `optimisation.mounting.with_response_point` says.
        """
        return scene_on(structure, self.absorber(), *self.positions)

    @property
    def positions(self) -> list[float]:
        """Position of each absorber.

        It is a share of a beam's length, or the number of one of a modal model's places.
        """
        return [
            self.values[name]
            for name in (
                (of_absorber(POSITION, k) for k in ABSORBER_IDS)
                if self.concept == SEVERAL
                else (POSITION,)
            )
        ]

    def __str__(self) -> str:
        return f"{self.concept} absorber, " + ", ".join(
            f"{name} {value:.4g}" for name, value in self.values.items()
        )


@dataclass(frozen=True)
class DesignSpace:
    """A concept with its free and fixed variables.

    ``free`` are variables with their bounds, ``fixed`` values of other variables in SI units.
    ``units`` are those of the structure, set by a problem: they define scaled bounds, and the
    values of variables that are neither free nor fixed. None: the paper's beam, for which the start
    is the paper's design.
    """

    concept: str
    free: tuple[Variable, ...]
    fixed: Values = field(default_factory=dict)
    units: Units | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        known = _known(self.concept)
        check_fields(
            self,
            free=labelled("free variables", each_of(kind_of(Variable))),
            fixed=table_of(finite),
            units=kind_of(Units | None),
        )
        names = [variable.name for variable in self.free]
        require(len(names) > 0, "free variables", names, f"one or more of {', '.join(known)}")
        require(len(set(names)) == len(names), "free variables", names, "each of them once")
        for name in [*names, *self.fixed]:
            require(
                name in known,
                f"variable of the concept {self.concept!r}",
                name,
                f"one of {', '.join(known)}",
            )
        both = sorted(set(names) & set(self.fixed))
        require(not both, "variables", both, "free or fixed, not both")
        in_order = {name: self.fixed[name] for name in known if name in self.fixed}
        object.__setattr__(self, "fixed", in_order)
        for share in (
            0.0,
            1.0,
        ):
            # bounds and fixed values that the simulator refuses are named now, not during a search
            design = self.at([share] * len(self.free))
            mass_ratio = usable_mass_ratio(MASS_RATIO, design.values[MASS_RATIO])
            replace(design, values={**design.values, MASS_RATIO: mass_ratio}).absorber()
            # 0 is the left end, which a structure may hold or not; 2, 3, ... are places of a modal
            # model
            for x in design.positions:
                Beam(absorber_position=1.0 if x == 0 or (x > 1 and x == round(x)) else x)

    @property
    def version(self) -> int:
        """Version of the concept's variables."""
        return VERSIONS[self.concept]

    @property
    def low(self) -> Array:
        """Lower bounds of the coordinates, (variables,)."""
        return np.array([v.low for v in self.free])

    @property
    def high(self) -> Array:
        """Upper bounds of the coordinates, (variables,)."""
        return np.array([v.high for v in self.free])

    def on_places(self, number: int) -> DesignSpace:
        """Return the space on a modal model with ``number`` places for absorbers.

        A position is a choice among these places.
        """
        at = [v.name for v in self.free if parts_of(v.name)[0] == POSITION]
        allowed = (
            "left out on a modal model with one place: the absorber is where its shapes say, and "
            "its file lists no other place"
        )
        require(not at or number > 1, at[0] if at else POSITION, "free", allowed)
        for name, value in self.fixed.items():
            if parts_of(name)[0] == POSITION:
                require(
                    value in range(1, number + 1),
                    name,
                    value,
                    f"the number of one of the structure's places for absorbers, 1 to {number}",
                )
        return replace(self, free=tuple(v.choice(number) if v.name in at else v for v in self.free))

    @property
    def _units(self) -> Units:
        return paper_units() if self.units is None else self.units

    @property
    def paper(self) -> Design:
        """The paper's design, at the place of this space.

        It does not depend on the bounds and the other fixed values of the space.
        """
        return Design(
            self.concept,
            {
                v.name: self.fixed.get(v.name, v.default) if v.name == POSITION else v.default
                for v in VARIABLES[self.concept]
            },
        )

    @property
    def default(self) -> Design:
        """Start of a search.

        It is the paper's design scaled to the structure (the rule's gap), with the fixed values,
        within the bounds.
        """
        return self._resolved(lambda v, unit, start: min(max(start, v.low * unit), v.high * unit))

    def _resolved(self, choose: Callable[[Variable, float, float], float]) -> Design:
        """Return a design, variable by variable in the order that their units require.

        ``choose``: function of a free variable, its unit and its start.
        """
        free = {v.name: v for v in self.free}
        values: dict[str, float] = {}
        # a unit is known after mass and place, and that of a friction limit after the gap
        for v in sorted(
            VARIABLES[self.concept], key=lambda v: v.scaled + v.name.startswith(FRICTION_LIMIT)
        ):
            start = (
                v.default
                if not v.scaled or self.units is None
                else self._units.start(self.concept, v.name, values)
            )
            if v.name in free:
                unit = self._units.of(self.concept, v.name, values) if free[v.name].scaled else 1.0
                values[v.name] = float(choose(free[v.name], unit, start))
            else:
                values[v.name] = self.fixed.get(v.name, start)
        return Design(self.concept, {v.name: values[v.name] for v in VARIABLES[self.concept]})

    def design(self, values: Values) -> Design:
        """Return the design with these values (SI) of the free variables.

        Raises ParameterError unless each variable has a value within its bounds.
        """
        return self._checked("values", values, counted=False)

    def _checked(self, what: str, values: Values, counted: bool) -> Design:
        names = [variable.name for variable in self.free]
        require(
            set(values) == set(names), what, dict(values), f"one for each of {', '.join(names)}"
        )

        def checked(v: Variable, unit: float, _start: float) -> float:
            x = values[v.name]
            scale, words = (1.0, v.unit) if counted else (unit, v.si)
            low = v.low * scale
            high = v.high * scale
            require(
                low * (1 - 1e-12) <= x <= high * (1 + 1e-12),
                v.name,
                x,
                f"from {low:g} to {high:g} {words}".rstrip(),
            )
            return x if not counted else round(x) if v.whole else x * unit

        return self._resolved(checked)

    def decoded(self, coordinates: Values) -> Design:
        """Return the design at coordinates, one for each free variable.

        Raises ParameterError unless each variable has a coordinate within its bounds.
        """
        return self._checked("coordinates", coordinates, counted=True)

    def coordinates(self, design: Design) -> dict[str, float]:
        """Return the coordinates of a design's free variables, cut to their bounds."""
        units = {
            v.name: self._units.of(self.concept, v.name, design.values) if v.scaled else 1.0
            for v in self.free
        }
        return {
            v.name: min(max(design.values[v.name] / units[v.name], v.low), v.high)
            for v in self.free
        }

    def shares(self, design: Design) -> list[float]:
        """Return a design's place in the ranges of the free variables, as shares from 0 to 1.

        A value outside of its range gives 0 or 1.
        """
        return [
            v.share_of(x) for v, x in zip(self.free, self.coordinates(design).values(), strict=True)
        ]

    def at(self, shares: Iterable[float]) -> Design:
        """Return the design at shares (0 to 1) of the free variables' ranges."""
        return self.decoded(
            {v.name: v.value_at(share) for v, share in zip(self.free, shares, strict=True)}
        )

    def at_bounds(self, design: Design) -> list[str]:
        """Return a text for each free variable of a design that lies at a bound.

        The text names the bound. The list is empty if no variable lies at a bound.
        """
        values = []
        for v, share in zip(self.free, self.shares(design), strict=True):
            if v.whole:  # a choice has no other side
                continue
            at_end = (
                parts_of(v.name)[0] == POSITION and share > 0.5 and v.high == 1.0
            )  # the structure ends there, not the search
            if not AT_BOUND < share < 1 - AT_BOUND and not at_end:
                which, bound = ("lower", v.low) if share < 0.5 else ("upper", v.high)
                values.append(f"{v.name} at its {which} bound of {bound:g} {v.unit}".rstrip())
        return values

    def describe(self) -> dict[str, object]:
        """Return the space's identity as JSON values."""
        start = self.coordinates(self.default)
        free = {
            v.name: {
                "low": v.low,
                "high": v.high,
                "log": v.log,
                "unit": v.unit,
                "start": start[v.name],
            }
            for v in self.free
        }
        free |= {v.name: free[v.name] | {"whole": True} for v in self.free if v.whole}
        default = self.default.values
        names = {v.name for v in self.free}
        return {
            "concept": self.concept,
            "version": self.version,
            "free": free,
            "fixed": {n: x for n, x in default.items() if n not in names},
        }


def _known(concept: str) -> dict[str, Variable]:
    return {
        variable.name: variable for variable in VARIABLES[one_of("concept", concept, VARIABLES)]
    }


def design_space(
    concept: str,
    free: Iterable[str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    fixed: Values | None = None,
) -> DesignSpace:
    """Return a concept's space with the named variables free.

    Without names, the variables of `FREE` that are not fixed are free. Their ``bounds`` (SI) are
    the given ones, or else those of the concept. A variable that is neither free nor fixed has the
    paper's value, scaled to the structure. Raises ParameterError for a name that the concept lacks,
    and for bounds that are empty or inverted.
    """
    known = _known(concept)
    fixed = {} if fixed is None else instance("fixed", fixed, Mapping)
    names = (
        tuple(name for name in DEFAULT_FREE[concept] if name not in fixed)
        if free is None
        else tuple(one_of("free variables", name, known) for name in listed("free variables", free))
    )
    bounds = {} if bounds is None else instance("bounds", bounds, Mapping)
    for name in (*names, *bounds):
        require(
            name in known,
            f"variable of the concept {concept!r}",
            name,
            f"one of {', '.join(known)}",
        )
    unused = sorted(set(bounds) - set(names))
    if unused:
        raise ParameterError(
            f"bounds of {', '.join(unused)} are not allowed: bounds are for free variables, "
            f"which are {', '.join(names)}"
        )
    variables = [known[name] for name in names]
    chosen = tuple(
        v.within(*two(f"bounds of {v.name}", bounds[v.name])) if v.name in bounds else v
        for v in variables
    )
    return DesignSpace(concept, chosen, fixed)
