"""A statement of the paper beside what was computed of it: what its words allow, by one rule, and how members' values are judged and told.

The statements are in claims.toml.
"""

import tomllib
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from string import Formatter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impact_env.curve import BAND, quantiles
from impact_env.parameters import require
from studies.study import Array

# the one rule of tolerances: what the words of a statement allow, in numbers, the same for all claims; the page prints it
INFINITY = float("inf")
ABOUT = 0.25
SAME = 0.05
LITTLE = 0.25
MUCH = 0.8
LEFT = 0.1
WIDE = 2.0
PLACE = 0.01
OFTEN = 0.95
RARE = 0.05
EVEN = (1 + ABOUT) / (1 - ABOUT)

RULE = (
    (
        "a number, also with *about*",
        f"{100 * ABOUT:g} % either way; a frequency {PLACE:g} of the resonance's",
    ),
    (
        "*the same*, *virtually*, *closely*, *saturates*, *enough*",
        f"{100 * SAME:g} % either way, of a level or of no absorber",
    ),
    (
        "*almost*, *hardly*, *slightly*, *robust*, *no considerable influence*",
        f"{100 * LITTLE:g} % either way",
    ),
    (
        "*much*, *considerably*, *effective*, *well below*",
        f"{MUCH:g} of what it is compared with, or less",
    ),
    (
        "*nearly all*, *complete*, *close to zero*, an *order of magnitude*",
        f"a share of {LEFT:g} is left, or less",
    ),
    (
        "*evenly*, *about the same energy*",
        f"the largest {EVEN:.2f} times the smallest, or less: {100 * ABOUT:g} % either way of their middle",
    ),
    ("*a wide range* of forces", f"its ends have a ratio of {WIDE:g} or more"),
    ("more, less, better, worse, grows, falls", "the 5 to 95 % of the members are on that side"),
    (
        "something happens, in one run",
        f"in {100 * OFTEN:g} % of the runs or more it holds, in {100 * RARE:g} % or fewer it does not",
    ),
)


def range_about(number: float, to: float | None = None) -> tuple[float, float]:
    """Return the range that counts as about a number, or as a range up to another one."""
    return (1 - ABOUT) * number, (1 + ABOUT) * (number if to is None else to)


def range_within(share: float) -> tuple[float, float]:
    """Return the allowed range of a ratio that a statement says to be 1."""
    return 1 - share, 1 + share


ALLOWED = {  # by the words of claims.toml, of a number or a ratio
    "the same": range_within(SAME),
    "almost the same": range_within(LITTLE),
    "no difference": (-SAME, SAME),
    "nearly the whole": (1 - SAME, 1.0),
    "nearly nothing": (0.0, LEFT),
    "much less": (0.0, MUCH),
    "less": (0.0, 1.0),
    "more": (1.0, INFINITY),
    "even": (1.0, EVEN),
    "wide": (WIDE, INFINITY),
}
RULED = {"same": SAME, "much": MUCH, "left": LEFT, "wide": WIDE}  # what texts may name
STATED: dict[str, dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_name("claims.toml").read_text(encoding="utf-8")
)


def parse_allowed(words: Any) -> tuple[float, float]:
    """Return least and most of the key ``allowed`` of claims.toml."""
    if isinstance(words, str):
        return (
            range_about(float(words.removeprefix("about ")))
            if words.startswith("about ")
            else ALLOWED[words]
        )
    least, most = words
    return least, most


class ClaimVerdict(StrEnum):
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
    verdict: ClaimVerdict
    figure: str
    why: str = ""
    definitional: bool = False

    def __post_init__(self) -> None:
        for field in ("name", "statement", "section", "computed", "figure"):
            require(
                bool(getattr(self, field).strip()),
                f"claim's {field}",
                getattr(self, field),
                "some words",
            )
        require(
            self.verdict is ClaimVerdict.HOLDS or bool(self.why.strip()),
            f"why of {self.name}",
            self.why,
            f"a reason where a claim {self.verdict}",
        )

    def to_plain(self) -> dict[str, Any]:
        """Return a dict of strings; ``why`` is empty where the statement holds."""
        return asdict(self) | {
            "verdict": self.verdict.value,
            "why": "" if self.verdict is ClaimVerdict.HOLDS else self.why,
        }


def from_plain(plain: dict[str, Any]) -> Claim:
    """Return the claim of a plain form; raises KeyError, TypeError, ValueError or ParameterError if it is something else."""
    return Claim(**{**plain, "verdict": ClaimVerdict(plain["verdict"])})


def judge_interval(low: float, high: float, least: float, most: float) -> ClaimVerdict:
    """Return how an interval from ``low`` to ``high`` stands to what a statement allows: inside it holds, beside it not, else within spread."""
    require(
        low <= high and least <= most,
        "interval",
        (low, high, least, most),
        "low and high, least and most, each in order",
    )
    if least <= low and high <= most:
        return ClaimVerdict.HOLDS
    return ClaimVerdict.SPREAD if low <= most and least <= high else ClaimVerdict.NOT


def judge_share(low: float, high: float) -> ClaimVerdict:
    """Return how the interval of a share of runs stands to a statement on one run by the rule above."""
    return (
        ClaimVerdict.HOLDS
        if low >= OFTEN
        else ClaimVerdict.SPREAD
        if high > RARE
        else ClaimVerdict.NOT
    )


def compute_bands(values: ArrayLike) -> Array:
    """Return 5 %, median and 95 % over the last axis, the members; NaN is left out."""
    return quantiles(values, (BAND[0], 0.5, BAND[1]))


def format_interval(
    middle: float, low: float, high: float, *, form: str = "{:.2f}", factor: float = 1.0
) -> str:
    """Return a value and the interval that it lies in, as "0.64 (0.55 to 0.71)"."""
    return "{} ({} to {})".format(*(form.format(factor * x) for x in (middle, low, high)))


def format_spread(
    values: ArrayLike, form: str = "{:.2f}", factor: float = 1.0, unit: str = ""
) -> str:
    """Return median and 5 to 95 % of members, as "0.64 (0.55 to 0.71)", the median alone where all read the same; NaN is left out."""
    low, middle, high = (form.format(factor * float(x)) for x in compute_bands(np.ravel(values)))
    return f"{middle}{unit}" if low == high else f"{middle}{unit} ({low} to {high})"


def format_range(values: ArrayLike, form: str = "{:.3g}", factor: float = 1.0) -> str:
    """Return least and largest value, as "0.55 to 0.71", or the value where both read the same."""
    row = np.ravel(np.asarray(values, dtype=float))
    low, high = (form.format(factor * float(x)) for x in (np.nanmin(row), np.nanmax(row)))
    return low if low == high else f"{low} to {high}"


def compute_band(values: ArrayLike) -> tuple[float, float]:
    """Return the 5 and the 95 % of members; NaN is left out."""
    low, high = quantiles(np.ravel(values), BAND)
    return float(low), float(high)


def judge_values(
    low: float, high: float, least: float, most: float, at_step: float | None = None
) -> ClaimVerdict:
    """Return the verdict of an interval on a statement that allows least..most; ``at_step``: the value of the paper's own run, with its step."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return ClaimVerdict.NOT
    result = judge_interval(low, high, least, most)
    return (
        ClaimVerdict.STEP
        if result is ClaimVerdict.NOT and at_step is not None and least <= at_step <= most
        else result
    )


class ClaimFormatter(Formatter):
    """Fills the braces of claims.toml: values of members as `format_spread` says them, and in per cent where the form ends in %."""

    def format_field(self, value: Any, format_spec: str) -> Any:
        """Return a value in words."""
        if isinstance(value, str):
            return value
        form = format_spec
        factor = 1
        unit = ""
        if form.endswith("%"):
            form = form[:-1] + ("f" if form[-2].isdigit() else "")
            factor = 100
            unit = " %"
        return (
            f"{factor * value:{form}}"
            if np.ndim(value) == 0
            else format_spread(value, f"{{:{form}}}", factor)
        ) + unit


def make_claim(
    figure: str,
    name: str,
    result: ClaimVerdict | bool | ArrayLike,
    /,
    allowed: tuple[float, float] | None = None,
    *,
    at_step: float | None = None,
    **text_values: Any,
) -> Claim:
    """Return a claim of claims.toml: a verdict, whether it holds, or values of members, judged by their 5 to 95 %.

    ``allowed`` where claims.toml does not say it; ``text_values`` fills the braces, as do the values, as {value}.
    ``at_step``: the number by the paper's scheme and step, in one run.
    """
    own = STATED[figure][name]
    text_values = {**RULED, "value": result, **text_values}

    def claim_for(text: str) -> str:
        return ClaimFormatter().vformat(text, (), text_values)

    if isinstance(result, bool | np.bool_):
        result = ClaimVerdict.HOLDS if result else ClaimVerdict.NOT
    judgement = (
        result
        if isinstance(result, ClaimVerdict)
        else judge_values(
            *compute_band(result), *(allowed or parse_allowed(own["allowed"])), at_step
        )
    )
    if "about" in own:
        form = f"{{:{own.get('form', '.2f')}}}"
        unit = own.get("unit", "")
        computed = claim_for(own["about"]) + format_spread(text_values["value"], form, unit=unit)
        computed += "" if at_step is None else f"; {form.format(at_step)}{unit} at the paper's step"
    else:
        computed = claim_for(own["computed"])
    why = claim_for(own.get("why", ""))
    return Claim(
        claim_for(name),
        claim_for(own["statement"]),
        own["section"],
        computed,
        judgement,
        figure,
        why,
        own.get("definitional", False),
    )
