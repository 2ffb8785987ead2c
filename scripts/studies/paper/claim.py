"""A statement of the paper beside what was computed of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from impact_env.parameters import require
from studies.paper.tolerances import OFTEN, RARE


class Verdict(StrEnum):
    """What the computation says of a statement."""

    HOLDS = "holds"
    SPREAD = "holds within spread"
    STEP = "holds only at the paper's step"
    NOT = "does not hold"


@dataclass(frozen=True)
class Claim:
    """A statement in short words of our own, the ``section`` of the paper, what was ``computed`` (with its interval), and the ``figure``.

    ``definitional``: it follows from the definition of the model, or from the structure without contact, by arithmetic.
    ``why``: for a verdict other than "holds", a paragraph on the reason with its evidence; the page leaves it out where the statement holds.
    """

    name: str
    statement: str
    section: str
    computed: str
    verdict: Verdict
    figure: str
    why: str = ""
    definitional: bool = False

    def __post_init__(self) -> None:
        for field in ("name", "statement", "section", "computed", "figure"):
            require(bool(getattr(self, field).strip()), f"claim's {field}", getattr(self, field), "some words")
        require(self.verdict is Verdict.HOLDS or bool(self.why.strip()), f"why of {self.name}", self.why, f"a reason where a claim {self.verdict}")

    def to_plain(self) -> dict[str, Any]:
        """Return a dict of strings; ``why`` is empty where the statement holds."""
        named = {name: getattr(self, name) for name in ("name", "statement", "section", "computed")}
        why = "" if self.verdict is Verdict.HOLDS else self.why
        return {**named, "verdict": self.verdict.value, "figure": self.figure, "why": why, "definitional": self.definitional}


def from_plain(plain: dict[str, Any]) -> Claim:
    """Return the claim of a plain form; raises KeyError, TypeError, ValueError or ParameterError if it is something else."""
    return Claim(**{**plain, "verdict": Verdict(plain["verdict"])})


def judged(low: float, high: float, least: float, most: float) -> Verdict:
    """Return how an interval from ``low`` to ``high`` stands to what a statement allows: inside it holds, beside it not, else within spread."""
    require(low <= high and least <= most, "interval", (low, high, least, most), "low and high, least and most, each in order")
    if least <= low and high <= most:
        return Verdict.HOLDS
    return Verdict.SPREAD if low <= most and least <= high else Verdict.NOT


def chance(low: float, high: float) -> Verdict:
    """Return how the interval of a share of runs stands to a statement on one run (`tolerances`)."""
    return Verdict.HOLDS if low >= OFTEN else Verdict.SPREAD if high > RARE else Verdict.NOT
