"""Where the design rule holds: the best simulated gap over the rule's, over damping, mass ratio and place, on two beams, and in cases kept apart.

By the scaling law the force does not matter: gap and friction are in proportion to it. So a case is one number, the best gap over the rule's, and a
price, the level at the rule's gap over the smallest. `optimisation.bounds.reach` is what the cases are to be told apart by.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Executor, Progress
from impact_env.modes import modal_model
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, count
from optimisation.bounds import LARGE_REACH, LEAST_REACH, SMALL_REACH, expected_factor
from optimisation.gap_check import GapCheck, check_gap, scaled_absorber

Array = NDArray[np.float64]

STRUCTURES = {
    "paper": Beam(),
    # a steel strip of 40 x 8 mm, 1.2 m long, shaken at a quarter of it
    "steel": Beam(length=1.2, bending_stiffness=210e9 * 0.04 * 0.008**3 / 12, mass_per_length=7850 * 0.04 * 0.008, force_position=0.25),
}
# 1 m of 30 x 10 mm aluminium between two clamps, for the cases that nothing is fitted to
CLAMPED = Beam(
    ends="clamped-clamped", length=1.0, bending_stiffness=70e9 * 0.03 * 0.01**3 / 12, mass_per_length=2700 * 0.03 * 0.01, force_position=0.3,
    absorber_position=0.5,
)  # fmt: skip
RESONANCES = (1, 2)
DAMPINGS, QUICK_DAMPINGS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05), (0.005, 0.01, 0.02, 0.05)
MASSES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
PLACES = (1.0, 0.95, 0.9, 0.8, 0.7, 0.6, 0.5)
WIDEST, STEPS = 4.0, 4  # factors of the rule's gap reach this far to either side, in so many steps: 41 % apart
# Sweeps at the least damping take a hundred times as long as the paper's. So below this the gaps reach from half the rule's to twice it only, where
# light damping has its best gap, with fewer members; and the least of all is run near the first resonance only.
LIGHT, LIGHT_WIDEST = 0.004, 2.0
LIGHTEST, LIGHTEST_MEMBERS = 0.002, 1
FORCE = 1.0  # N: any would do
TOLERATED = 1.1  # a level over the smallest that counts as good
DAMPING, MASS, PLACE, FRESH = "damping", "mass ratio", "place", "fresh"
# structure, resonance, damping, mass ratio, place: two numbers or more differ from any other case
FRESH_CASES = (
    ("clamped", 1, 0.003, 0.02, 0.5),
    ("clamped", 1, 0.007, 0.03, 0.45),
    ("clamped", 1, 0.01, 0.07, 0.4),
    ("clamped", 2, 0.004, 0.02, 0.28),
    ("clamped", 2, 0.015, 0.01, 0.25),
    ("steel", 2, 0.003, 0.01, 1.0),
    ("steel", 1, 0.007, 0.08, 1.0),
    ("steel", 1, 0.02, 0.05, 0.8),
    ("paper", 1, 0.0015, 0.005, 1.0),
    ("paper", 2, 0.007, 0.03, 0.95),
)


@dataclass(frozen=True)
class Case:
    """One beam and absorber: what of the ``structure`` is ``varied`` and its ``value``, the ``beam``, the resonance and the mass ratio.

    Where several numbers are varied (`FRESH`) the value is the damping.
    """

    structure: str
    varied: str
    value: float
    resonance: int
    beam: Beam
    mass_ratio: float = DEFAULT_MASS_RATIO

    @property
    def light(self) -> bool:
        """Whether the damping is so light that the case gets less, see `LIGHT`."""
        return self.damping < LIGHT

    @property
    def damping(self) -> float:
        """The damping ratio of all modes."""
        assert isinstance(self.beam.damping_ratio, float)
        return self.beam.damping_ratio

    @property
    def key(self) -> str:
        """A name of the case that no other has."""
        if self.varied == FRESH:
            numbers = f"damping {self.value:g}, mass {self.mass_ratio:g}, place {self.beam.absorber_position:g}"
            return f"{self.structure}, resonance {self.resonance}, {numbers}"
        return f"{self.structure}, resonance {self.resonance}, {self.varied} {self.value:g}"


@dataclass(frozen=True)
class Row:
    """What a case showed: factors of the rule's gap and the levels there over no absorber, the best factor, and the price of the rule's gap.

    ``reach``: free amplitude over the rule's gap; ``sweep``: level of the sweeps without absorber over the stationary one; ``price``: level at the
    rule's gap over the smallest; ``members``: runs for each gap.
    """

    key: str
    structure: str
    varied: str
    value: float
    resonance: int
    reach: float
    rate: float
    sweep: float
    factors: Sequence[float]
    relative: Sequence[float]
    best: float
    price: float
    members: int

    @property
    def expected(self) -> float:
        """The factor of the rule's gap that is expected to be best."""
        return expected_factor(self.reach, self.value if self.varied in (DAMPING, FRESH) else Beam.damping_ratio)  # type: ignore[arg-type]


def cases(quick: bool = False) -> list[Case]:
    """Return all cases: each beam varied in one number at a time, and the fresh ones."""
    every = []
    for name, beam in STRUCTURES.items():
        for resonance in RESONANCES:
            dampings = QUICK_DAMPINGS if quick else DAMPINGS if resonance == 1 else DAMPINGS[1:]
            every += [Case(name, DAMPING, d, resonance, replace(beam, damping_ratio=d)) for d in dampings]
            every += [Case(name, MASS, m, resonance, beam, m) for m in MASSES]
            every += [Case(name, PLACE, x, resonance, replace(beam, absorber_position=x)) for x in PLACES]
    beams = STRUCTURES | {"clamped": CLAMPED}
    for name, resonance, damping, mass, place in FRESH_CASES:
        if not quick or damping in QUICK_DAMPINGS:
            beam = replace(beams[name], damping_ratio=damping, absorber_position=place)
            every.append(Case(name, FRESH, damping, resonance, beam, mass))
    return every


def factors(steps: int = STEPS, widest: float = WIDEST) -> Array:
    """Return the factors of the rule's gap, 1 in the middle, (2 steps + 1,)."""
    found = np.geomspace(1 / widest, widest, 2 * count("steps", steps, 1) + 1)
    found[steps] = 1.0
    return found


def halfway(check: GapCheck) -> list[float]:
    """Return the factors between that of the best gap and its neighbours (one at an end), with the rule's own, as `check_gap` asks for it."""
    assert check.best is not None
    near = np.log(check.gaps[max(0, check.best - 1) : check.best + 2] / check.rule)
    return [*np.exp((near[1:] + near[:-1]) / 2).tolist(), 1.0]


def run_case(
    case: Case, members: int, steps: int, threads: int | None, progress: Progress | None = None, executor: Executor | None = None, fine: bool = False
) -> list[GapCheck]:
    """Simulate a case, and with ``fine`` the gaps halfway from the best to its neighbours too; arguments and interruption as in `check_gap`.

    With light damping (`LIGHT`) it has fewer gaps, and with very light damping fewer members.
    """
    model, light = modal_model(case.beam), case.light
    multiples = factors(max(1, steps // 2), LIGHT_WIDEST) if light else factors(steps)
    absorber = scaled_absorber(model, FORCE, case.resonance, case.mass_ratio)
    fewer = min(members, LIGHTEST_MEMBERS) if case.damping < LIGHTEST else members
    where = {"members": fewer, "everywhere": True, "threads": threads, "progress": progress, "executor": executor}

    def at(chosen: Sequence[float] | Array) -> GapCheck:
        return check_gap(model, FORCE, case.resonance, absorber, factors=chosen, **where)  # type: ignore[arg-type]

    coarse = at(multiples)
    return [coarse, at(halfway(coarse))] if fine and coarse.complete else [coarse]


def row_of(case: Case, checks: Sequence[GapCheck]) -> Row:
    """Return the row of a finished case."""
    first = checks[0]
    known: dict[float, float] = {}
    for check in reversed(checks):  # the rule's own gap is in all of them, with the same members
        known.update(zip((float(x) for x in check.gaps / check.rule), (float(x) for x in check.relative), strict=True))
    multiples = tuple(sorted(known))
    relative = tuple(known[x] for x in multiples)
    own = (case.key, case.structure, case.varied, case.value, case.resonance, first.reach, first.rate, first.sweep_ratio)
    best = int(np.nanargmin(relative))
    return Row(*own, multiples, relative, multiples[best], relative[multiples.index(1.0)] / relative[best], len(first.without.members))


def price_at(row: Row, factor: float) -> float:
    """Return the level at a factor of the rule's gap over the smallest, from a straight line between the points in logarithms."""
    levels = np.log(row.relative)
    return float(np.exp(np.interp(np.log(factor), np.log(row.factors), levels) - levels.min()))


@dataclass(frozen=True)
class Verdict:
    """The cases of one class of `reach`: how many, and median and extremes of the best gap over the rule's.

    ``good`` and ``expected``: how many lose less than a tenth at the rule's gap, and at `expected_gap`; ``worst`` and ``worst_expected``: the largest
    price of either.
    """

    label: str
    cases: int
    median: float
    low: float
    high: float
    good: int
    expected: int
    worst: float
    worst_expected: float


def verdicts(rows: Sequence[Row]) -> list[Verdict]:
    """Return the rule's price by reach, where it is refused, warned of, and trusted, and in the fresh cases, which nothing is fitted to."""
    fitted = [row for row in rows if row.varied != FRESH]
    edges = (0.0, LEAST_REACH, SMALL_REACH, LARGE_REACH, np.inf)
    classes = {
        f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more": [row for row in fitted if low <= row.reach < high]
        for low, high in pairwise(edges)
    }
    classes["fresh cases, any"] = [row for row in rows if row.varied == FRESH]
    return [_verdict(label, part) for label, part in classes.items() if part]


def _verdict(label: str, rows: Sequence[Row]) -> Verdict:
    best = [row.best for row in rows]
    prices, others = [row.price for row in rows], [price_at(row, row.expected) for row in rows]
    good = (sum(price < TOLERATED for price in prices), sum(price < TOLERATED for price in others))
    return Verdict(label, len(rows), float(np.median(best)), min(best), max(best), *good, max(prices), max(others))
