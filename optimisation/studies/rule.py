"""Where the design rule holds: the best simulated gap over the rule's, over damping, mass ratio and place, on two beams.

By the scaling law the force does not matter: gap and friction are in proportion to it. So a case is one number, the best gap over the rule's, and a
price, the level at the rule's gap over the smallest. `optimisation.bounds.reach` is what the cases are to be told apart by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

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
RESONANCES = (1, 2)
DAMPINGS, QUICK_DAMPINGS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05), (0.002, 0.005, 0.01, 0.02, 0.05)
MASSES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
PLACES = (1.0, 0.95, 0.9, 0.8, 0.7, 0.6, 0.5)
WIDEST, STEPS, QUICK_STEPS = 4.0, 6, 4  # factors of the rule's gap reach this far to either side, in so many steps
FORCE = 1.0  # N: any would do
TOLERATED = 1.1  # a level over the smallest that counts as good
DAMPING, MASS, PLACE = "damping", "mass ratio", "place"


@dataclass(frozen=True)
class Case:
    """One beam and absorber: what of the ``structure`` is ``varied`` and its ``value``, the ``beam``, the resonance and the mass ratio."""

    structure: str
    varied: str
    value: float
    resonance: int
    beam: Beam
    mass_ratio: float = DEFAULT_MASS_RATIO

    @property
    def key(self) -> str:
        """A name of the case that no other has."""
        return f"{self.structure}, resonance {self.resonance}, {self.varied} {self.value:g}"


@dataclass(frozen=True)
class Row:
    """What a case showed: factors of the rule's gap and the levels there over no absorber, the best factor, and the price of the rule's gap.

    ``reach``: free amplitude over the rule's gap; ``sweep``: level of the sweeps without absorber over the stationary one; ``price``: level at the
    rule's gap over the smallest.
    """

    key: str
    structure: str
    varied: str
    value: float
    resonance: int
    reach: float
    rate: float
    sweep: float
    factors: tuple[float, ...]
    relative: tuple[float, ...]
    best: float
    price: float


def cases(quick: bool = False) -> list[Case]:
    """Return all cases, each beam varied in one number at a time."""
    every = []
    for name, beam in STRUCTURES.items():
        for resonance in RESONANCES:
            every += [Case(name, DAMPING, d, resonance, replace(beam, damping_ratio=d)) for d in (QUICK_DAMPINGS if quick else DAMPINGS)]
            every += [Case(name, MASS, m, resonance, beam, m) for m in MASSES]
            every += [Case(name, PLACE, x, resonance, replace(beam, absorber_position=x)) for x in PLACES]
    return every


def factors(steps: int = STEPS) -> Array:
    """Return the factors of the rule's gap, 1 in the middle, (2 steps + 1,)."""
    return np.geomspace(1 / WIDEST, WIDEST, 2 * count("steps", steps, 1) + 1)


def run_case(
    case: Case, members: int, steps: int, threads: int | None, progress: Progress | None = None, executor: Executor | None = None
) -> GapCheck:
    """Simulate a case; arguments and interruption as in `check_gap`."""
    model = modal_model(case.beam)
    multiples = factors(steps)
    multiples[steps] = 1.0
    absorber = scaled_absorber(model, FORCE, case.resonance, case.mass_ratio)
    where = {"threads": threads, "progress": progress, "executor": executor}
    return check_gap(model, FORCE, case.resonance, absorber, factors=multiples, members=members, everywhere=True, **where)  # type: ignore[arg-type]


def row_of(case: Case, check: GapCheck) -> Row:
    """Return what a finished case showed."""
    best = check.best
    assert best is not None
    own = (case.key, case.structure, case.varied, case.value, case.resonance)
    price = float(check.level[check.at_rule] / check.level[best])
    multiples = tuple(float(x) for x in check.gaps / check.rule)
    return Row(*own, check.reach, check.rate, check.sweep_ratio, multiples, tuple(float(x) for x in check.relative), multiples[best], price)


def as_json(row: Row) -> dict[str, object]:
    """Return a row as JSON values."""
    return {name: list(x) if isinstance(x, tuple) else x for name, x in asdict(row).items()}


def from_json(values: dict[str, object]) -> Row:
    """Return the row that `as_json` gave."""
    return Row(**{name: tuple(x) if isinstance(x, list) else x for name, x in values.items()})  # type: ignore[arg-type]


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
    """Return what the rule is worth by reach: where it is refused, warned of, and trusted."""
    edges = ((0.0, LEAST_REACH), (LEAST_REACH, SMALL_REACH), (SMALL_REACH, LARGE_REACH), (LARGE_REACH, np.inf))
    found = []
    for low, high in edges:
        part = [row for row in rows if low <= row.reach < high]
        if part:
            best = [row.best for row in part]
            label = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
            prices, others = [row.price for row in part], [price_at(row, expected_factor(row.reach)) for row in part]
            good = (sum(price < TOLERATED for price in prices), sum(price < TOLERATED for price in others))
            found.append(Verdict(label, len(part), float(np.median(best)), min(best), max(best), *good, max(prices), max(others)))
    return found
