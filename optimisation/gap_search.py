"""The search for a gap by simulation: the best one is bracketed by one member at a time, then more run where the answers rest.

Gaps are counted in steps of ``STEP`` of ln gap from the design rule's. On the narrow side of the best gap the level climbs a cliff, on the wide one
it is in proportion to the gap, and small dips between them are noise. So steps are wide and go towards lower levels until they are bracketed; then
the wider neighbouring interval is halved, the narrow side first.

By the scaling law a device under k times the force is the device with a k-th of the gap under the force, k times as large: level(k f, g) = k
level(f, g/k), with a friction limit in proportion to the gap. So what a tolerance of the force does is in the table of levels already. What is no
length scales with another ``power`` of k: a decay time with 0.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
STEP = 0.05  # of ln gap
WIDE, NEAR, LEAST, MOST = 8, 2, -32, 32  # steps of a bracket at first and at last, and how far it goes from the rule's gap
PAIRS = 18  # of sweeps, up and down, that a search takes at most: with those of the rule's gap and of no absorber 40 sweeps
MEMBERS = 3
# (step, number of members) -> the members' levels, the first ones of the ensemble
Look = Callable[[float, int], Array]


@dataclass
class Table:
    """The members' levels by step of the gap, a whole number in a search; ``power`` see the module."""

    levels: dict[float, Array] = field(default_factory=dict)
    power: float = 1.0

    def known(self) -> tuple[Array, Array]:
        """Return (steps, ln of median levels)."""
        steps = np.array(sorted(self.levels))
        return steps, np.log([float(np.median(self.levels[n])) for n in steps])


def level_between(ln_gaps: Array, ln_levels: Array, at: ArrayLike, power: float = 1.0) -> Array:
    """Return levels at ln gaps, straight lines in ln of both; beyond the widest as the gap's ``power``, beyond the narrowest NaN."""
    x = np.asarray(at, dtype=np.float64)
    beyond = np.where(x < ln_gaps[0] - 1e-9, np.nan, power * np.maximum(x - ln_gaps[-1], 0))
    return np.asarray(np.exp(np.interp(x, ln_gaps, ln_levels) + beyond))


def worst(ln_gaps: Array, ln_levels: Array, at: ArrayLike, tolerance: float, power: float = 1.0) -> Array:
    """Return the largest level over force times (1 - tolerance), 1 and (1 + tolerance) of gaps at ln gaps; NaN where a neighbour is not known."""
    x = np.asarray(at, dtype=np.float64)
    every = [k**power * level_between(ln_gaps, ln_levels, x - np.log(k), power) for k in (1 - tolerance, 1.0, 1 + tolerance)]
    return np.asarray(np.max(every, axis=0))


def bracket(look: Callable[[int], float], start: int) -> dict[int, float]:
    """Return the levels looked at, by step, around the lowest, whose neighbours then are `NEAR` (or at the ends `LEAST`, `MOST`)."""
    seen: dict[int, float] = {}

    def at(n: int) -> float:
        if n not in seen:
            seen[n] = look(n)
        return seen[n]

    low, high = start, start + WIDE
    while at(low) <= at(high) and low - WIDE >= LEAST and at(low - WIDE) < at(low):
        low, high = low - WIDE, low
    while at(high) < at(low) and high + WIDE <= MOST and at(high + WIDE) < at(high):
        low, high = high, high + WIDE
    while True:
        best = min(seen, key=lambda n: seen[n])
        below, above = max((n for n in seen if n < best), default=best), min((n for n in seen if n > best), default=best)
        if max(best - below, above - best) <= NEAR:
            return seen
        at((best + below) // 2 if best - below >= above - best else (best + above) // 2)


def answers(table: Table, tolerance: float, members: int = 0) -> tuple[float, float]:
    """Return the steps with the lowest level and with the lowest of `worst`, as far as is known.

    ``members``: only of gaps that so many ran. Raises ValueError if there are none.
    """
    steps, levels = table.known()
    whole = np.arange(np.ceil(steps[0]), np.floor(steps[-1]) + 1)
    every = np.array([n for n, x in table.levels.items() if len(x) >= members]) if members else np.union1d(whole, steps)
    lowest = level_between(STEP * steps, levels, STEP * every)
    robust = worst(STEP * steps, levels, STEP * every, tolerance, table.power)
    return float(every[np.argmin(lowest)]), float(every[np.argmin(np.where(np.isnan(robust), np.inf, robust))])


def asked(table: Table, tolerance: float, beside: bool) -> list[float]:
    """Return the steps that the answers rest on: their own, and the narrower neighbour of a larger force; ``beside``: those beside them too."""
    sharp, robust = answers(table, tolerance)
    near = [robust - round(np.log1p(tolerance) / STEP)] if tolerance > 0 else []
    return list(dict.fromkeys((sharp, robust, *near, *((sharp - 1, sharp + 1, robust - 1) if beside else ()))))


def start_factor(reach: float) -> float:
    """Return where a search begins, over the rule's gap, for free amplitude over that gap: a fit to simulations of other structures."""
    return 1.57 / (1 + 1.14 / reach)


def search(look: Look, start: int, tolerance: float, members: int, pairs: int, table: Table) -> None:
    """Fill a table, from a step on, see the module; ``pairs``: of sweeps, up and down, after which no runs are added.

    Answers and the gaps beside them run with one member, then two, so that a lucky one does not take all runs; then the answers with all members, and
    what pairs are left go to the gaps beside them.
    """

    def levels(n: float, number: int) -> float:
        table.levels[n] = look(n, number)
        return float(table.levels[n][0])

    seen = bracket(lambda n: levels(n, 1), start)
    levels(min(seen, key=lambda n: seen[n]) - 1, 1)  # is the foot of the cliff there?
    spent = len(table.levels)
    for number, beside in ((1, True), (min(2, members), True), (members, False), (members, True)):
        while True:
            open_ = [n for n in asked(table, tolerance, beside) if len(table.levels.get(n, ())) < number]
            cost = number - len(table.levels.get(open_[0], ())) if open_ else 0
            if not open_ or spent + cost > pairs:
                break
            levels(open_[0], number)
            spent += cost
