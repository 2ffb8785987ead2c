"""The page's verdict on a setting: a grade, and a sentence with the reason.

The verdict depends on the level over that without absorber.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from optimisation.service import EFFECTIVE_RATIO

SMALL_EFFECT = 0.9  # of the level without absorber, above which an absorber hardly helps
FEW_IMPACTS = 0.02  # a period: the mass hardly ever reaches a wall
NARROW = 0.9  # the design rule's gap over the gap, above which a cavity is narrow for its load
WIDE = 0.5  # the same, below which it is wide

Numbers = Mapping[str, float | None]


@dataclass(frozen=True)
class LevelVerdict:
    """Verdict on a level.

    ``grade``: good, fair, poor or neutral. ``headline`` and ``band``: texts with percentages.
    ``sentence``: the reason.
    """

    grade: str
    headline: str
    band: str
    sentence: str


def judge_level(
    concept: str, level: float, without: float, band: tuple[float, float], numbers: Numbers
) -> LevelVerdict:
    """Return the verdict on a ``level`` in m with its ``band``.

    ``without`` is the level in m of the structure without absorber. ``numbers`` are those of the
    card by their keys (impacts_a_period, gap, rule_gap); unknown ones are missing or None.
    """
    low, high = band
    if concept == "none":
        sentence = "Nothing absorbs: the level is that of the structure alone."
        return LevelVerdict("neutral", f"{1e3 * level:.3g} mm without absorber", "", sentence)
    ratio = level / without
    grade = "good" if ratio <= EFFECTIVE_RATIO else "fair" if ratio <= SMALL_EFFECT else "poor"
    return LevelVerdict(
        grade,
        f"{format_percent(ratio)} of no absorber",
        format_band(low / without, high / without),
        explain_ratio(concept, ratio, numbers),
    )


def format_percent(ratio: float) -> str:
    """Return a ratio in percent with two digits, three above 100 %."""
    percent = 100 * ratio
    return f"{percent:.0f} %" if percent >= 9.95 else f"{percent:.2g} %"


def format_band(low: float, high: float) -> str:
    """Return in words the range of 90 % of further runs, empty where it is not known."""
    if not (low <= high):
        return "one run: no band"
    ends = format_percent(low), format_percent(high)
    if ends[0] == ends[1]:
        return "further runs differ by less than 1 %"
    return f"90 % of runs between {ends[0].removesuffix(' %')} and {ends[1]}"


def explain_ratio(concept: str, ratio: float, numbers: Numbers) -> str:
    """Return one sentence that says why the level is as it is."""
    helps = ratio <= EFFECTIVE_RATIO
    if concept == "friction":
        if helps:
            return "The mass slides against friction, which takes energy out of the resonance."
        return (
            "The mass slides too easily, or hardly at all, at this load: Recommended finds the "
            "friction limit that loses most energy."
        )
    if concept == "tuned":
        if helps:
            return "The sprung mass is tuned to this resonance, at every load alike."
        return "Spring and damper do not fit this resonance: Recommended tunes them."
    return explain_cavity(helps, numbers)


def explain_cavity(helps: bool, numbers: Numbers) -> str:
    """Return the sentence for absorbers in cavities.

    It follows from the impacts in a period and the ratio of the design rule's gap to the gap.
    """
    impacts = numbers.get("impacts_a_period") or 0.0
    gap = numbers.get("gap")
    rule = numbers.get("rule_gap")
    narrowness = rule / gap if gap and rule else None
    if impacts < FEW_IMPACTS and not helps:
        return (
            "The mass hardly ever reaches a wall: the structure moves too little for this gap. A "
            "smaller gap would let it work."
        )
    works = (
        f"The mass hits the walls {impacts:.2g} times a period and takes energy out of the "
        "resonance."
    )
    if narrowness is None or not rule:
        return (
            works
            if helps
            else "The mass hits the walls, but takes little energy out of the resonance."
        )
    if helps:
        return f"{works} A little more load may be too much." if narrowness > NARROW else works
    if narrowness > NARROW:
        return (
            "The load is too strong for this gap: the mass moves with the structure. The design "
            f"rule begins at {1e3 * rule:.3g} mm."
        )
    if narrowness < WIDE:
        return (
            "The gap is wide for this load: impacts are rare. The design rule begins at "
            f"{1e3 * rule:.3g} mm."
        )
    return (
        "The mass hits the walls, but takes little energy out: Recommended searches a better gap."
    )
