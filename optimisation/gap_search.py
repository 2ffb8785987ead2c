"""The search for a gap by simulation: quick looks until the best one is bracketed, then full sweeps where the answers rest.

Gaps are counted in steps of ``STEP`` of ln gap from the design rule's. On the narrow side of the best gap the level climbs a cliff, on the wide one
it is in proportion to the gap, and small dips between them are noise. So a look is one member, steps are wide and go towards lower levels until they
are bracketed; then the wider neighbouring interval is halved, the narrow side first. Looks are swept up to four times as fast as full runs.

By the scaling law a device under k times the force is the device with a k-th of the gap under the force, k times as large: level(k f, g) = k
level(f, g/k), with a friction limit in proportion to the gap. So what a tolerance of the force does is in the table of levels already. What is no
length scales with another ``power`` of k: a decay time with 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
STEP = 0.05  # of ln gap
WIDE, NEAR, LEAST, MOST = 8, 2, -32, 32  # steps of a bracket at first and at last, and how far it goes from the rule's gap
CLIFF, MARGIN_CLIFF = 1.15, 1.25  # times as high a step narrower: steeper than where all members are on one branch; with a margin of force
PAIRS = 18  # of sweeps, up and down, that a search takes at most: with those of the rule's gap and of no absorber 40 sweeps
MEMBERS = 3
# (step, number of members, whether at the full rate) -> the members' levels, the first ones of the ensemble
Look = Callable[[float, int, bool], Array]


@dataclass
class Table:
    """Levels by step of the gap, a whole number in a search: ``quick`` looks, and the members' levels of ``full`` runs.

    ``power`` see the module; ``cliff``: whether levels climb a cliff on the narrow side.
    """

    quick: dict[float, Array] = field(default_factory=dict)
    full: dict[float, Array] = field(default_factory=dict)
    power: float = 1.0
    cliff: bool = True

    def known(self) -> tuple[Array, Array]:
        """Return (steps, ln of levels): medians of full runs, else quick looks, times what full runs are of looks at the same gaps."""
        both = [np.median(self.full[n]) / self.quick[n][0] for n in self.full if n in self.quick]
        scale = float(np.median(both)) if both else 1.0
        levels = {n: scale * float(x[0]) for n, x in self.quick.items()} | {n: float(np.median(x)) for n, x in self.full.items()}
        steps = np.array(sorted(levels))
        return steps, np.log([levels[n] for n in steps])


def level_between(ln_gaps: Array, ln_levels: Array, at: ArrayLike, power: float = 1.0) -> Array:
    """Return levels at ln gaps, straight lines in ln of both; beyond the widest as the gap's ``power``, beyond the narrowest NaN."""
    x = np.asarray(at, dtype=np.float64)
    beyond = np.where(x < ln_gaps[0] - 1e-9, np.nan, power * np.maximum(x - ln_gaps[-1], 0))
    return np.asarray(np.exp(np.interp(x, ln_gaps, ln_levels) + beyond))


def safe(ln_gaps: Array, ln_levels: Array, cliff: float) -> tuple[Array, Array]:
    """Return ln of gaps and of levels that count: no lower than the level of the gap a step narrower, where that is known, over ``cliff``.

    At the foot of the cliff members take either branch, at a gap that differs by rounding others do, and few members do not tell how many.
    """
    near = np.isclose(np.diff(ln_gaps, prepend=-np.inf), STEP)
    return ln_gaps, np.where(near, np.maximum(ln_levels, np.roll(ln_levels, 1) - np.log(cliff)), ln_levels)


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
    """Return the steps with the lowest level and with the lowest of `worst`, of levels that are `safe`, as far as is known.

    ``members``: only of gaps that so many ran in full. Raises ValueError if there are none.
    """
    steps, levels = table.known()
    whole = np.arange(np.ceil(steps[0]), np.floor(steps[-1]) + 1)
    every = np.array([n for n, x in table.full.items() if len(x) >= members]) if members else np.union1d(whole, steps)
    cliffs = (CLIFF, MARGIN_CLIFF if tolerance > 0 else CLIFF) if table.cliff else (np.inf, np.inf)
    lowest = level_between(*safe(STEP * steps, levels, cliffs[0]), STEP * every)
    robust = worst(*safe(STEP * steps, levels, cliffs[1]), STEP * every, tolerance, table.power)
    return float(every[np.argmin(lowest)]), float(every[np.argmin(np.where(np.isnan(robust), np.inf, robust))])


def asked(table: Table, tolerance: float, beside: bool) -> list[float]:
    """Return the steps that the answers rest on: their own, and the narrower neighbour of a larger force; ``beside``: those beside them too."""
    sharp, robust = answers(table, tolerance)
    near = [robust - round(np.log1p(tolerance) / STEP)] if tolerance > 0 else []
    return list(dict.fromkeys((sharp, robust, *near, *((sharp - 1, sharp + 1, robust - 1) if beside else ()))))


def start_factor(reach: float) -> float:
    """Return where a search begins, over the rule's gap, for free amplitude over that gap: a fit to simulations of other structures."""
    return 1.57 / (1 + 1.14 / reach)


def search(look: Look, start: int, tolerance: float, members: int, pairs: int, table: Table, same: bool) -> None:
    """Fill a table, from a step on, see the module. ``same``: looks are full runs; ``pairs``: of sweeps, up and down, after which no runs are added.

    Answers are run with two members first, so that a lucky look does not take all runs, with all members where they stay, and what pairs are left
    go to the gaps beside them.
    """
    known = table.full if same else table.quick

    def quick(n: int) -> float:
        known[n] = look(n, 1, False)
        return float(known[n][0])

    seen = bracket(quick, start)
    quick(min(seen, key=lambda n: seen[n]) - 1)  # is the foot of the cliff there?
    spent = len(known)
    for number, beside in ((min(2, members), False), (members, False), (members, True)):
        while True:
            open_ = [n for n in asked(table, tolerance, beside) if len(table.full.get(n, ())) < number]
            cost = number - len(table.full.get(open_[0], ())) if open_ else 0
            if not open_ or spent + cost > pairs:
                break
            table.full[open_[0]] = look(open_[0], number, True)
            spent += cost
