"""Verdicts on the paper's statements, which are listed in claims.toml.

The words of a statement allow a range of a number. The verdict follows from the comparison of this
range with the computed values.
"""

import tomllib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from string import Formatter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from impact_env.checks import require
from impact_env.curve import BAND, quantiles
from studies.study import Array

# the rule of tolerances: what the words of a statement allow, in numbers, the same for all claims;
# the page prints it
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
MAJORITY = 0.5

RULE = (
    (
        "a number, also with *about*",
        f"{100 * ABOUT:g} % either way; a frequency {PLACE:g} of the resonance's",
    ),
    (
        "*the same*, *virtually*, *closely*, *saturates*, *enough*",
        f"{100 * SAME:g} % either way of the value that it is compared with",
    ),
    (
        "*almost*, *hardly*, *slightly*, *robust*, *insensitive*, *no considerable influence*",
        f"{100 * LITTLE:g} % either way of the value that it is compared with",
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
        (
            f"the largest {EVEN:.2f} times the smallest, or less: {100 * ABOUT:g} % either way of "
            "their middle"
        ),
    ),
    ("*a wide range* of forces", f"its ends have a ratio of {WIDE:g} or more"),
    ("*mainly*, a *large* basin", f"a share of {MAJORITY:g} or more"),
    ("*strong*", f"more than what is slight, {100 * LITTLE:g} %"),
    ("more, less, better, worse, grows, falls", "the 5 to 95 % of the members are on that side"),
    (
        "several cases (forces, frequencies, modes)",
        "holds or does not hold where each case does, else within spread",
    ),
    (
        "something happens, in one run",
        (
            f"in {100 * OFTEN:g} % of the runs or more it holds, in {100 * RARE:g} % or fewer it "
            "does not"
        ),
    ),
)


def range_about(number: float, to: float | None = None) -> tuple[float, float]:
    """Return the range (least, most) that counts as about ``number``.

    With ``to`` it is the range that counts as about ``number`` to about ``to``.
    """
    return (1 - ABOUT) * number, (1 + ABOUT) * (number if to is None else to)


def range_within(share: float, middle: float = 1.0) -> tuple[float, float]:
    """Return (least, most) of the numbers within a relative ``share`` of ``middle``."""
    return (1 - share) * middle, (1 + share) * middle


RELATIONS = {  # ranges of a number or a ratio, by the words of claims.toml
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
RULE_NUMBERS = {"same": SAME, "much": MUCH, "left": LEFT, "wide": WIDE}  # that texts may name
REASONS = {  # why a statement does not simply hold, by the key "reason" of claims.toml
    "chance": (
        "One run. In the impact regimes levels, phase lags, jumps and energies are random; one "
        "run shows one sample."
    ),
    "range": (
        "A part of the range. It is true of some forces, frequencies, modes or friction limits, "
        "and not of others."
    ),
    "contacts": (
        "More contacts. With several modes the absorber strikes a wall more than once at a visit."
    ),
    "truncation": "Truncation. Too few modes or harmonics are kept.",
    "step": (
        "The step. At 20 steps per period of the highest mode impacts and reversals of slip come "
        "late."
    ),
    "tuning": (
        "Mistuning. The tuned absorber's stiffness follows from a modal mass of 1 kg, not from "
        "the effective one at the tip."
    ),
    "degree": "Degree. The computed number is beyond what the word allows.",
}
STATED: dict[str, dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_name("claims.toml").read_text(encoding="utf-8")
)


def parse_relation(relation: Any) -> tuple[float, float]:
    """Return the least and the most that a relation of claims.toml allows.

    A relation is a key of `RELATIONS`, "about" with a number, or a pair of numbers. Raises KeyError
    for any other text.
    """
    if not isinstance(relation, str):
        least, most = relation
        return least, most
    if relation.startswith("about "):
        return range_about(float(relation.removeprefix("about ")))
    return RELATIONS[relation]


class Interval(NamedTuple):
    """A computed value and its interval, where that is not 5 to 95 % of the members."""

    value: float
    low: float
    high: float


def find_extent(values: ArrayLike) -> Interval:
    """Return the median of some values with the least and the largest of them."""
    row = np.ravel(np.asarray(values, dtype=float))
    return Interval(float(np.median(row)), float(np.min(row)), float(np.max(row)))


class ClaimVerdict(StrEnum):
    """Result of the comparison of a statement with computed values."""

    HOLDS = "holds"
    SPREAD = "holds within spread"
    STEP = "holds only at the paper's step"
    NOT = "does not hold"


@dataclass(frozen=True)
class Claim:
    """A statement of the paper with its verdict.

    Attributes
    ----------
    name, statement : str
        Key, and the statement in short form in our own words.
    section, figure : str
        Section of the paper, and figure to which it belongs.
    computed : str
        Computed value with its interval.
    verdict : ClaimVerdict
        The verdict.
    why, reason : str
        For a verdict other than "holds": a paragraph on the cause with its evidence, and the kind
        of cause, a key of `REASONS`.
    definitional : bool
        Whether the statement follows from the definition of the model, or from the structure
        without contact, by arithmetic.
    value, low, high : float or None
        Median and 5 to 95 % of the computed values, or an `Interval`; None if several numbers
        decide.
    least, most : float or None
        Range that the statement allows.
    """

    name: str
    statement: str
    section: str
    computed: str
    verdict: ClaimVerdict
    figure: str
    why: str = ""
    definitional: bool = False
    reason: str = ""
    value: float | None = None
    low: float | None = None
    high: float | None = None
    least: float | None = None
    most: float | None = None

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
        require(
            self.verdict is ClaimVerdict.HOLDS or self.reason in REASONS,
            f"reason of {self.name}",
            self.reason,
            f"one of {', '.join(REASONS)} where a claim {self.verdict}",
        )

    def to_plain(self) -> dict[str, Any]:
        """Return a dict of strings and numbers.

        ``why`` and ``reason`` are empty if the statement holds.
        """
        plain = asdict(self) | {"verdict": self.verdict.value}
        return plain | {"why": "", "reason": ""} if self.verdict is ClaimVerdict.HOLDS else plain


def from_plain(plain: dict[str, Any]) -> Claim:
    """Return the claim of a plain form.

    Raises KeyError, TypeError, ValueError or ParameterError if it is something else.
    """
    return Claim(**{**plain, "verdict": ClaimVerdict(plain["verdict"])})


def judge_interval(low: float, high: float, least: float, most: float) -> ClaimVerdict:
    """Return the verdict of an interval on a range that a statement allows.

    The statement holds if the interval from ``low`` to ``high`` is inside the range from ``least``
    to ``most``, does not hold if they do not overlap, and is otherwise within spread. Raises
    ParameterError if ``low`` exceeds ``high``, or ``least`` exceeds ``most``.
    """
    require(
        low <= high and least <= most,
        "interval",
        (low, high, least, most),
        "low and high, least and most, each in order",
    )
    if least <= low and high <= most:
        return ClaimVerdict.HOLDS
    return ClaimVerdict.SPREAD if low <= most and least <= high else ClaimVerdict.NOT


def judge_cases(cases: Iterable[ClaimVerdict]) -> ClaimVerdict:
    """Return the verdict of a statement on several cases.

    It is the verdict of the cases if that is the same in all of them, else within spread.
    """
    verdicts = set(cases)
    return verdicts.pop() if len(verdicts) == 1 else ClaimVerdict.SPREAD


def judge_share(low: float, high: float) -> ClaimVerdict:
    """Return the verdict on a statement that something happens in one run.

    ``low`` and ``high`` are the confidence interval of the share of runs in which it happens. The
    statement holds if ``low`` is at least `OFTEN`, and does not hold if ``high`` is at most `RARE`.
    """
    return (
        ClaimVerdict.HOLDS
        if low >= OFTEN
        else ClaimVerdict.SPREAD
        if high > RARE
        else ClaimVerdict.NOT
    )


def compute_bands(values: ArrayLike) -> Array:
    """Return the 5 % quantile, median and 95 % quantile over the last axis, (3, ...).

    The last axis is that of the members. NaN is ignored.
    """
    return quantiles(values, (BAND[0], 0.5, BAND[1]))


def format_interval(
    middle: float, low: float, high: float, *, form: str = "{:.2f}", factor: float = 1.0
) -> str:
    """Return a value and its interval, each times ``factor``, as "0.64 (0.55 to 0.71)"."""
    return "{} ({} to {})".format(*(form.format(factor * x) for x in (middle, low, high)))


def format_spread(
    values: ArrayLike, form: str = "{:.2f}", factor: float = 1.0, unit: str = ""
) -> str:
    """Return median and 5 to 95 % of members, each times ``factor``, as "0.64 (0.55 to 0.71)".

    If both ends of the band have the same text, only the median is returned. NaN is ignored.
    """
    low, middle, high = (form.format(factor * float(x)) for x in compute_bands(np.ravel(values)))
    return f"{middle}{unit}" if low == high else f"{middle}{unit} ({low} to {high})"


def format_range(values: ArrayLike, form: str = "{:.3g}", factor: float = 1.0) -> str:
    """Return least and largest value, each times ``factor``, as "0.55 to 0.71".

    If both have the same text, it is returned once. NaN is ignored.
    """
    row = np.ravel(np.asarray(values, dtype=float))
    low, high = (form.format(factor * float(x)) for x in (np.nanmin(row), np.nanmax(row)))
    return low if low == high else f"{low} to {high}"


def compute_band(values: ArrayLike) -> tuple[float, float]:
    """Return the 5 and the 95 % quantile over members; NaN is ignored."""
    low, high = quantiles(np.ravel(values), BAND)
    return float(low), float(high)


def judge_values(
    low: float, high: float, least: float, most: float, at_step: float | None = None
) -> ClaimVerdict:
    """Return the verdict of `judge_interval`, with two additions.

    If the statement does not hold, but the value ``at_step`` of one run with the paper's scheme and
    step is inside the range, the verdict is `ClaimVerdict.STEP`. A statement on values that are not
    finite does not hold.
    """
    if not (np.isfinite(low) and np.isfinite(high)):
        return ClaimVerdict.NOT
    result = judge_interval(low, high, least, most)
    return (
        ClaimVerdict.STEP
        if result is ClaimVerdict.NOT and at_step is not None and least <= at_step <= most
        else result
    )


class ClaimFormatter(Formatter):
    """Formatter of the texts of claims.toml, with values in braces.

    Arrays, the values of the members, are formatted by `format_spread`. With a format that ends in
    %, values are given in per cent.
    """

    def format_field(self, value: Any, format_spec: str) -> Any:
        """Return a number, an array or a text as text; texts stay as they are."""
        if isinstance(value, str):
            return value
        form = format_spec
        factor = 1
        unit = ""
        if form.endswith("%"):
            form = form[:-1] + ("f" if form[-2].isdigit() else "")
            factor = 100
            unit = " %"
        if np.ndim(value) == 0:
            return f"{factor * value:{form}}{unit}"
        return format_spread(value, f"{{:{form}}}", factor) + unit


def make_claim(
    figure: str,
    name: str,
    result: ClaimVerdict | bool | Interval | ArrayLike,
    /,
    allowed: tuple[float, float] | None = None,
    *,
    at_step: float | None = None,
    **text_values: Any,
) -> Claim:
    """Return the claim ``name`` of a ``figure`` of claims.toml, with its verdict.

    Parameters
    ----------
    figure, name : str
        Table and key in claims.toml. Raises KeyError if they do not exist.
    result : array, Interval, ClaimVerdict or bool
        Values of the members, judged by their 5 to 95 %; a value with its interval; a verdict; or
        whether the claim holds.
    allowed : (float, float), optional
        Least and most allowed value. Default: the relation of claims.toml.
    at_step : float, optional
        Value of one run with the paper's scheme and step, see `judge_values`.
    text_values
        Values for the braces in the texts of claims.toml. ``{value}`` is ``result`` unless given.
    """
    own = STATED[figure][name]
    text_values = {**RULE_NUMBERS, "value": result, **text_values}

    def fill(text: str) -> str:
        return ClaimFormatter().vformat(text, (), text_values)

    numbers: dict[str, float | None] = {}
    if isinstance(result, bool | np.bool_):
        verdict = ClaimVerdict.HOLDS if result else ClaimVerdict.NOT
    elif isinstance(result, ClaimVerdict):
        verdict = result
    else:
        if isinstance(result, Interval):
            middle, low, high = result
        else:
            low, middle, high = (float(x) for x in compute_bands(np.ravel(result)))
        least, most = allowed or parse_relation(own["relation"])
        verdict = judge_values(low, high, least, most, at_step)
        numbers = {"value": middle, "low": low, "high": high, "least": least, "most": most}
        numbers = {
            key: x if x is not None and np.isfinite(x) else None for key, x in numbers.items()
        }
    if "about" in own:
        form = f"{{:{own.get('form', '.2f')}}}"
        unit = own.get("unit", "")
        computed = fill(own["about"]) + format_spread(text_values["value"], form, unit=unit)
        computed += "" if at_step is None else f"; {form.format(at_step)}{unit} at the paper's step"
    else:
        computed = fill(own["computed"])
    return Claim(
        fill(name),
        fill(own["statement"]),
        own["section"],
        computed,
        verdict,
        figure,
        fill(own.get("why", "")),
        own.get("definitional", False),
        own.get("reason", "range"),
        **numbers,
    )
