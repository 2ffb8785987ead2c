"""Objectives with a direction, and constraints, over conditions and ensemble members.

They determine how good a design is.

A design is run under every condition (a resonance, a force, a detuning), swept up and down, for
every member of an ensemble. The members are the same for all designs, so that a study is
repeatable. This does not reduce the variance of differences: runs diverge after some impacts, and
the levels of equal members of two designs are not correlated (measured: -0.17). All results after a
search are computed with members that the search has not used.

The value of a member is, as in the paper, that of the worse of the two directions. ``over`` says
how conditions join: the ``worst`` or the ``mean``. The value of the design is the ``quantile`` of
its members: the value that this share of the members meets or betters, so 0.5 is the median and 0.9
the careful choice, whether the objective is minimised or maximised.
"""

import importlib
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    ParameterError,
    count_from,
    fraction,
    kind_of,
    labelled,
    or_none,
    positive,
    require,
    two,
    within,
    word_of,
)
from impact_env.drive import PAPER_LIMITS
from impact_env.fields import check_fields
from impact_env.loads import Loads
from optimisation.measures import (
    ACCELERATION,
    DAMAGE,
    FRICTION_HEAT,
    IMPACT_POWER,
    IMPACT_RATE,
    IMPACT_SPEED,
    LEVEL,
    STRESS,
    STROKE,
    UNITS,
    format_number,
    loads_key,
    measure_of,
)
from optimisation.space import MASS_RATIO, Design
from optimisation.sweep_range import usable_force

Array = NDArray[np.float64]
WORST = "worst"
MEAN = "mean"
LIMITABLE = {
    STROKE: "m",
    IMPACT_SPEED: "m/s",
    FRICTION_HEAT: "W",
    MASS_RATIO: "of the beam's mass",
    LEVEL: "m",
    ACCELERATION: "m/s^2",
    IMPACT_POWER: "W",
    STRESS: "N m, or the file's unit",
}
# what a function of one's own is handed, by name, each (members, conditions, up or down)
HANDED = (LEVEL, STROKE, IMPACT_POWER, IMPACT_SPEED, FRICTION_HEAT, IMPACT_RATE, ACCELERATION)
Own = Callable[[dict[str, Array]], Any]
OWN = (
    "a function of one's own as MODULE:FUNCTION, which can be imported from here and returns a "
    "number for each member"
)


def function_of(name: str) -> Own:
    """Return the function named by ``module:function``.

    The module may lie in the current folder. Raises ParameterError if it does not exist.
    """
    module, _, function = name.partition(":")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    try:
        target = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise ParameterError(f"function = {name!r} is not allowed: {OWN} ({error})") from error
    require(callable(target), "function", name, OWN)
    own: Own = target
    return own


def own_values(name: str, measured: dict[str, Array]) -> Array:
    """Return the values (M,) of a user's function of the measures, one for each member.

    Raises ParameterError for any other result of the function.
    """
    members = len(measured[LEVEL])
    values = np.asarray(function_of(name)({key: measured[key] for key in HANDED}), dtype=np.float64)
    require(
        values.shape == (members,) and bool(np.isfinite(values).all()),
        f"what {name} returns",
        values,
        f"{members} finite numbers",
    )
    return values


def _is_own(name: object) -> bool:
    return isinstance(name, str) and ":" in name


def _check_limits(_name: str, value: Any) -> tuple[float, float]:
    low, high = two("limits of the sweep", value)
    return positive("lower end of the sweep", low), high


@dataclass(frozen=True)
class Condition:
    """A condition under which a design is run.

    Attributes
    ----------
    resonance : int
        Resonance that is swept, from 1.
    force : float
        Amplitude of the force in N, or a factor of ``loads``.
    limits : (float, float)
        Range of the sweep over the resonance's frequency.
    detuning : float
        Relative shift of all frequencies of the beam, for an uncertain bending stiffness. The sweep
        follows the shifted frequency.
    loads : Loads or None
        Loads instead of a swept force; their measure (`optimisation.measures`) replaces the
        response level.
    """

    resonance: int
    force: float
    limits: tuple[float, float] = PAPER_LIMITS
    detuning: float = 0.0
    loads: Loads | None = None

    def __post_init__(self) -> None:
        check_fields(
            self,
            resonance=count_from(1),
            force=usable_force,
            limits=_check_limits,
            detuning=partial(
                within,
                least=math.nextafter(-0.5, 0),
                most=math.nextafter(0.5, 0),
                allowed="above -0.5 and below 0.5",
            ),
            loads=kind_of(Loads | None),
        )

    def describe(self) -> dict[str, object]:
        """Return the condition as JSON values."""
        own = {
            "resonance": self.resonance,
            "force": self.force,
            "limits": list(self.limits),
            "detuning": self.detuning,
        }
        return (
            own
            if self.loads is None
            else own | {"loads": self.loads.describe(), "sha256": loads_key(self.loads)}
        )

    @property
    def place(self) -> str:
        """The load without its size, as text."""
        return f"resonance {self.resonance}" if self.loads is None else self.loads.describe()

    @property
    def measure_and_unit(self) -> tuple[str, str]:
        """Name and unit of the measure."""
        name = LEVEL if self.loads is None else measure_of(self.loads)
        return name, UNITS[name]

    @property
    def words(self) -> str:
        """The load with its size, as text."""
        return f"{self.place}, {format_number(self.force)} {'N' if self.loads is None else 'times'}"


@dataclass(frozen=True)
class Kind:
    """A kind of objective.

    It has a description, the measure that it needs, whether larger values are better, a unit, and
    whether it is relative to the structure without absorber.
    """

    text: str
    measure: str
    maximise: bool
    unit: str
    relative: bool


KINDS = {
    "level": Kind("response level relative to no absorber", LEVEL, False, "", True),
    "range": Kind(
        "width of the range of forces in which the relative level stays under a limit",
        LEVEL,
        True,
        "decades",
        True,
    ),
    "damage": Kind(
        "fatigue damage at the clamp, or where the file says, relative to no absorber",
        DAMAGE,
        False,
        "",
        True,
    ),
    "absolute": Kind("response level", LEVEL, False, "m", False),
    "acceleration": Kind(
        "largest acceleration where the level is read", ACCELERATION, False, "m/s^2", False
    ),
    "stress": Kind(
        "largest bending moment at the clamp, or what stress the file gives",
        STRESS,
        False,
        "N m, or the file's unit",
        False,
    ),
    "severity": Kind("power lost in impacts", IMPACT_POWER, False, "W", False),
}


@dataclass(frozen=True)
class Objective:
    """One objective of a design problem.

    It has a ``kind`` of `KINDS`, a rule ``over`` that combines conditions, the members'
    ``quantile``, and for a range the ``limit`` of the relative level.

    A kind ``module:function`` is one of one's own (`own_values`): minimised, and it joins
    conditions itself.

    ``resonance`` keeps only the conditions of one resonance (counted from 1); None keeps all.
    """

    kind: str = "level"
    over: str = WORST
    quantile: float = 0.5
    resonance: int | None = None
    limit: float | None = None

    def __post_init__(self) -> None:
        if _is_own(self.kind):
            function_of(self.kind)
        else:
            check_fields(self, kind=labelled("objective", word_of(KINDS)))
        check_fields(self, over=word_of((WORST, MEAN)), quantile=fraction)
        if self.kind == "range":
            check_fields(self, limit=labelled("limit of the relative level", positive))
        else:
            require(self.limit is None, "limit", self.limit, "for the objective range only")
        check_fields(self, resonance=or_none(count_from(1)))

    @property
    def maximise(self) -> bool:
        """Whether more is better."""
        return self.of_kind.maximise

    @property
    def own(self) -> bool:
        """Whether it is a user's function."""
        return _is_own(self.kind)

    @property
    def of_kind(self) -> Kind:
        """The kind of objective."""
        return Kind(self.kind, LEVEL, False, "", False) if self.own else KINDS[self.kind]

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures that it needs."""
        return HANDED if self.own else (self.of_kind.measure,)

    @property
    def label(self) -> str:
        """A few words for tables and axes."""
        where = "" if self.resonance is None else f", resonance {self.resonance}"
        under = "" if self.limit is None else f" of {format_number(self.limit)}"
        unit = f" in {self.of_kind.unit}" if self.of_kind.unit else ""
        return f"{self.of_kind.text}{under}{where}{unit}"

    def describe(self) -> dict[str, object]:
        """Return the objective as JSON values."""
        return {
            "kind": self.kind,
            "over": self.over,
            "quantile": self.quantile,
            "resonance": self.resonance,
            "limit": self.limit,
        }

    def chosen(self, conditions: Sequence[Condition]) -> list[int]:
        """Return the indices of the conditions that count.

        Raises ParameterError if there are too few.
        """
        index = [
            k
            for k, condition in enumerate(conditions)
            if self.resonance in (None, condition.resonance)
        ]
        require(
            len(index) > 0,
            "resonance of an objective",
            self.resonance,
            "a resonance that one of the conditions has",
        )
        if self.kind == "range":
            for part in _parts(conditions, index):
                forces = {conditions[k].force for k in part}
                require(
                    len(forces) >= 2,
                    "forces of the objective range",
                    sorted(forces),
                    "two or more at each resonance",
                )
        return index

    def per_member(self, values: Array, conditions: Sequence[Condition]) -> Array:
        """Return one value for each member, (M,), from those of its measure, (M, C, 2).

        They are relative to the structure without absorber if the kind of objective is relative.
        """
        index = self.chosen(conditions)
        worse = np.max(values, axis=2)
        if self.kind == "range":
            assert self.limit is not None
            parts = [
                (np.array([conditions[k].force for k in part]), part)
                for part in _parts(conditions, index)
            ]
            rows = np.array(
                [
                    [range_width(forces, member[part], self.limit) for forces, part in parts]
                    for member in worse
                ]
            )
            return np.asarray(rows.min(axis=1) if self.over == WORST else rows.mean(axis=1))
        rows = worse[:, index]
        return np.asarray(rows.max(axis=1) if self.over == WORST else rows.mean(axis=1))

    def value_of(self, members: Array) -> float:
        """Return the design's value from one value for each member, (M,)."""
        return float(np.quantile(members, self.share))

    @property
    def share(self) -> float:
        """Quantile of the members' values that is the design's value.

        It is `quantile`, counted from above if larger values are better.
        """
        return 1 - self.quantile if self.maximise else self.quantile


def _parts(conditions: Sequence[Condition], index: Sequence[int]) -> list[list[int]]:
    """Return the indices by resonance, limits and detuning, each by rising force."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for k in sorted(index, key=lambda k: conditions[k].force):
        groups.setdefault(
            (conditions[k].resonance, conditions[k].limits, conditions[k].detuning), []
        ).append(k)
    return list(groups.values())


def range_width(forces: Array, levels: Array, limit: float) -> float:
    """Return the longest interval of forces in which levels do not exceed ``limit``.

    The interval is in decades, for forces (F,) and levels (F,). Levels are interpolated linearly
    over the logarithm of the force.
    """
    at = np.log10(forces)
    best = 0.0
    begun = None if levels[0] > limit else at[0]
    for k in range(1, len(at)):
        if (levels[k - 1] <= limit) != (levels[k] <= limit):
            crossing = at[k - 1] + (limit - levels[k - 1]) / (levels[k] - levels[k - 1]) * (
                at[k] - at[k - 1]
            )
            if begun is None:
                begun = crossing
            else:
                best = max(best, crossing - begun)
                begun = None
    return float(best if begun is None else max(best, at[-1] - begun))


@dataclass(frozen=True)
class Constraint:
    """An upper ``limit``, in SI units, on a quantity.

    The quantity is a name of `LIMITABLE` or ``module:function``. Its worst value of all runs
    counts.
    """

    name: str
    limit: float

    def __post_init__(self) -> None:
        if _is_own(self.name):
            function_of(self.name)
        else:
            check_fields(self, name=labelled("constraint", word_of(LIMITABLE)))
        check_fields(self, limit=labelled(f"limit of {self.name}", positive))

    def value(self, design: Design, measured: dict[str, Array]) -> float:
        """Return the value of the limited quantity for a design."""
        if _is_own(self.name):
            return float(np.max(own_values(self.name, measured)))
        return (
            design.values[MASS_RATIO]
            if self.name == MASS_RATIO
            else float(np.max(measured[self.name]))
        )

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures that it needs."""
        return HANDED if _is_own(self.name) else () if self.name == MASS_RATIO else (self.name,)

    @property
    def unit(self) -> str:
        """Unit of the limited quantity."""
        return LIMITABLE.get(self.name, "")

    def violation(self, design: Design, measured: dict[str, Array]) -> float:
        """Return the relative excess over the limit; 0 or below if the constraint is satisfied."""
        return self.value(design, measured) / self.limit - 1

    def describe(self) -> dict[str, object]:
        """Return the constraint as JSON values."""
        return {"name": self.name, "limit": self.limit}


@dataclass(frozen=True)
class Score:
    """Score of a design.

    ``values`` has one number for each objective, ``violations`` one for each constraint (above 0 if
    it is violated), and ``failed`` says whether a run failed.
    """

    values: tuple[float, ...]
    violations: tuple[float, ...] = field(default=())
    failed: bool = False

    @property
    def feasible(self) -> bool:
        """Whether all constraints are kept and all runs came to their end."""
        return not self.failed and all(v <= 0 for v in self.violations)

    @property
    def violation(self) -> float:
        """Sum of the violations above 0; infinite for a failed design."""
        return math.inf if self.failed else sum(max(v, 0.0) for v in self.violations)
