"""A statement of the paper beside what was computed of it: what its words allow, by one rule, and how members' values are judged and told."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impact_env.curve import BAND, quantiles
from impact_env.parameters import require

# the one rule of tolerances: what the words of a statement allow, in numbers, the same for all claims; the page prints it
INFINITY = float("inf")
ABOUT = 0.25
SAME = 0.05
LITTLE = 0.25
MUCH = 0.8
LEFT = 0.1
WIDE = 2.0
PLACE = 0.01
OFTEN, RARE = 0.95, 0.05
EVEN = (1 + ABOUT) / (1 - ABOUT)

RULE = (
    ("a number, also with *about*", f"{100 * ABOUT:g} % either way; a frequency {PLACE:g} of the resonance's"),
    ("*the same*, *virtually*, *closely*, *saturates*, *enough*", f"{100 * SAME:g} % either way, of a level or of no absorber"),
    ("*almost*, *hardly*, *slightly*, *robust*, *no considerable influence*", f"{100 * LITTLE:g} % either way"),
    ("*much*, *considerably*, *effective*, *well below*", f"{MUCH:g} of what it is compared with, or less"),
    ("*nearly all*, *complete*, *close to zero*, an *order of magnitude*", f"a share of {LEFT:g} is left, or less"),
    ("*evenly*, *about the same energy*", f"the largest {EVEN:.2f} times the smallest, or less: {100 * ABOUT:g} % either way of their middle"),
    ("*a wide range* of forces", f"its ends have a ratio of {WIDE:g} or more"),
    ("more, less, better, worse, grows, falls", "the 5 to 95 % of the members are on that side"),
    ("something happens, in one run", f"in {100 * OFTEN:g} % of the runs or more it holds, in {100 * RARE:g} % or fewer it does not"),
)


def about(number: float, to: float | None = None) -> tuple[float, float]:
    """Return what counts as about a number, or as a range up to another one."""
    return (1 - ABOUT) * number, (1 + ABOUT) * (number if to is None else to)


def within(share: float) -> tuple[float, float]:
    """Return what is allowed of a ratio that a statement says to be 1."""
    return 1 - share, 1 + share


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
    """Return how the interval of a share of runs stands to a statement on one run by the rule above."""
    return Verdict.HOLDS if low >= OFTEN else Verdict.SPREAD if high > RARE else Verdict.NOT


def spread(values: ArrayLike, form: str = "{:.2f}", factor: float = 1.0, unit: str = "") -> str:
    """Return median and 5 to 95 % of members, as "0.64 (0.55 to 0.71)", the median alone where all read the same; NaN is left out."""
    low, middle, high = (form.format(factor * float(x)) for x in quantiles(np.ravel(values), (BAND[0], 0.5, BAND[1])))
    return f"{middle}{unit}" if low == high else f"{middle}{unit} ({low} to {high})"


def between(values: ArrayLike, form: str = "{:.3g}", factor: float = 1.0) -> str:
    """Return least and largest value, as "0.55 to 0.71", or the value where both read the same."""
    row = np.ravel(np.asarray(values, dtype=float))
    low, high = (form.format(factor * float(x)) for x in (np.nanmin(row), np.nanmax(row)))
    return low if low == high else f"{low} to {high}"


def middle(values: ArrayLike) -> tuple[float, float]:
    """Return the 5 and the 95 % of members; NaN is left out."""
    low, high = quantiles(np.ravel(values), BAND)
    return float(low), float(high)


def verdict(low: float, high: float, least: float, most: float, at_step: float | None = None) -> Verdict:
    """Return what an interval says of a statement that allows least..most; ``at_step``: the value of the paper's own run, with its step."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return Verdict.NOT
    found = judged(low, high, least, most)
    return Verdict.STEP if found is Verdict.NOT and at_step is not None and least <= at_step <= most else found


def claim(
    figure: str,
    name: str,
    statement: str,
    section: str,
    values: ArrayLike,
    allowed: tuple[float, float],
    why: str,
    *,
    about: str = "",
    form: str = "{:.2f}",
    unit: str = "",
    at_step: float | None = None,
    definitional: bool = False,
) -> Claim:
    """Return a claim on a number: ``values`` of the members, judged by their 5 to 95 %. ``about`` says what the number is.

    ``at_step``: the number by the paper's scheme and step, in one run.
    """
    said = f"{about}{spread(values, form, unit=unit)}" + ("" if at_step is None else f"; {form.format(at_step)}{unit} at the paper's step")
    return Claim(f"{figure}_{name}", statement, section, said, verdict(*middle(values), *allowed, at_step), figure, why, definitional)
