"""The one rule of tolerances: what the words of a statement allow, in numbers, the same for all claims. The page prints it."""

from __future__ import annotations

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
