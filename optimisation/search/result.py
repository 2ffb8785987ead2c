"""The result of a search for one concept."""

from dataclasses import dataclass
from functools import cached_property

from optimisation.insight import Levels, Sensitivity
from optimisation.problem import Problem
from optimisation.search.judge import Audit, MoreModes, Verdict
from optimisation.search.told import Evaluated
from optimisation.service import Service


@dataclass(frozen=True, eq=False)
class Cost:
    """What a search took: designs, runs and seconds of this session, and the share of the seconds that was not spent in runs."""

    designs: int
    runs: int
    seconds: float
    overhead: float


@dataclass(frozen=True, eq=False)
class Findings:
    """All that is known about one concept; what was not computed, or was broken off, is None. All of it is judged on fresh members."""

    problem: Problem
    told: list[Evaluated]
    finished: bool
    cost: Cost
    verdict: Verdict | None = None
    audit: Audit | None = None
    wider: MoreModes | None = None
    service: Service | None = None
    curves: tuple[Levels, ...] | None = None  # over the force, one for each condition
    detuned: tuple[Levels, ...] | None = None
    gap_map: tuple[Levels, ...] | None = None
    gaps: tuple[float, ...] = ()
    sensitivity: Sensitivity | None = None

    @cached_property
    def own(self) -> Levels | None:
        """Levels of winner and paper's design under the problem's own conditions, on the members that judged them."""
        return None if self.verdict is None else self.verdict.levels(self.problem.conditions)
