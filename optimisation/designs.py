"""Design spaces: what may be chosen of an absorber, in which bounds, and what a choice means as a scene.

A space belongs to one concept (`optimisation.variables`). It is versioned, because a study that was begun in one version of a space cannot be
continued in another. A design is in SI units; its *coordinates*, in which searches move, count scaled variables in units of the structure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.modes import Structure
from impact_env.parameters import (
    Absorber,
    Beam,
    ParameterError,
    TunedAbsorber,
    each_of,
    finite,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    instance,
    keep_checked,
    kind_of,
    labelled,
    listed,
    one_of,
    require,
    table_of,
    two,
)
from impact_env.scene import Scene
from optimisation.extremes import usable_mass_ratio
from optimisation.mounting import scene_on
from optimisation.variables import (
    ABSORBER_IDS,
    DAMPING,
    DEFAULT_FREE,
    FRICTION,
    FRICTION_LIMIT,
    GAP,
    IMPACT,
    MASS_RATIO,
    POSITION,
    RESTITUTION,
    SEVERAL,
    SHARE,
    STIFFNESS,
    VARIABLES,
    VERSIONS,
    Units,
    Variable,
    of_absorber,
    paper_units,
    parts_of,
)

Array = NDArray[np.float64]
Values = Mapping[str, float]
AT_BOUND = (
    0.02  # share of a variable's range: a winner that lies closer to a bound is said to lie at it
)


@dataclass(frozen=True)
class Design:
    """One absorber of a concept, or two: a value for each of the concept's variables, in SI units."""

    concept: str
    values: Values

    def __post_init__(self) -> None:
        names = _known(self.concept)
        keep_checked(self, values=table_of(finite))
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
        """Return the absorber on a structure, at the design's positions; the level is read where `optimisation.mounting.with_response_point` says."""
        return scene_on(structure, self.absorber(), *self.positions)

    @property
    def positions(self) -> list[float]:
        """The position of each absorber: a share of a beam's length, or the number of one of a modal model's places."""
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
    """A concept with its ``free`` variables, within their bounds, and the values, in SI units, of those that are ``fixed``.

    ``units`` are those of the structure (a problem puts in its own), which scaled bounds and the values of what is neither free nor fixed follow;
    None: the paper's beam, on which the start is the paper's design.
    """

    concept: str
    free: tuple[Variable, ...]
    fixed: Values = field(default_factory=dict)
    units: Units | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        known = _known(self.concept)
        keep_checked(
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
        ):  # bounds and fixed values that the simulator refuses are named now, not in the middle of a search
            design = self.at([share] * len(self.free))
            mass_ratio = usable_mass_ratio(MASS_RATIO, design.values[MASS_RATIO])
            replace(design, values={**design.values, MASS_RATIO: mass_ratio}).absorber()
            for x in design.positions:  # 0 is the left end, which a structure may hold or not; 2, 3, ... are places of a modal model
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
        """Return the space on a modal model with so many places for absorbers: a position is a choice among them."""
        at = [v.name for v in self.free if parts_of(v.name)[0] == POSITION]
        allowed = "left out on a modal model with one place: the absorber is where its shapes say, and its file lists no other place"
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
        """The paper's design, whatever this space's bounds and fixed values are, at the place of this space's."""
        return Design(
            self.concept,
            {
                v.name: self.fixed.get(v.name, v.default) if v.name == POSITION else v.default
                for v in VARIABLES[self.concept]
            },
        )

    @property
    def default(self) -> Design:
        """Where a search begins: the paper's design scaled to the structure (the rule's gap), with the fixed values, within the bounds."""
        return self._resolved(lambda v, unit, start: min(max(start, v.low * unit), v.high * unit))

    def _resolved(self, choose: Callable[[Variable, float, float], float]) -> Design:
        """Return a design, variable by variable in the order in which units follow; ``choose`` takes a free variable, its unit and its start."""
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
        """Return the design with these values (SI) of the free variables; raises ParameterError unless each has one within its bounds."""
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
        """Return the design at coordinates, one for each free variable; raises ParameterError unless each has one within its bounds."""
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
        """Return the shares (0 to 1) of the free variables' ranges at which a design lies, cut to them."""
        return [
            v.share_of(x) for v, x in zip(self.free, self.coordinates(design).values(), strict=True)
        ]

    def at(self, shares: Iterable[float]) -> Design:
        """Return the design at shares (0 to 1) of the free variables' ranges."""
        return self.decoded(
            {v.name: v.value_at(share) for v, share in zip(self.free, shares, strict=True)}
        )

    def at_bounds(self, design: Design) -> list[str]:
        """Return in words which free variables of a design lie at a bound of their range, with the bound; empty if none does."""
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
    """Return a concept's space with the named variables free, in ``bounds`` (SI) where given, else in the concept's own.

    Without names those of `FREE` are free that are not fixed.

    What is neither free nor fixed has the paper's value, scaled to the structure. Raises ParameterError for a name that the concept
    lacks, and for bounds that are empty or inverted.
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
            f"bounds of {', '.join(unused)} are not allowed: bounds are for free variables, which are {', '.join(names)}"
        )
    variables = [known[name] for name in names]
    chosen = tuple(
        v.within(*two(f"bounds of {v.name}", bounds[v.name])) if v.name in bounds else v
        for v in variables
    )
    return DesignSpace(concept, chosen, fixed)
