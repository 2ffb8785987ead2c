"""A Pareto front of two objectives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from optimisation.report.front_report import make_report
from optimisation.report.report import CompleteAnswer, Report
from optimisation.search.pareto import Front


@dataclass(frozen=True, eq=False)
class FrontAnswer(CompleteAnswer):
    """A front of designs.

    Attributes
    ----------
    front : Front
        All designs, and those of the front on fresh members.
    conditions : dict
        What else summary.json has: versions, settings.

    """

    front: Front
    conditions: Mapping[str, object] = field(default_factory=dict)

    def make_report(self) -> Report:
        """Return the content of the answer."""
        return make_report(self.front, self.conditions)
