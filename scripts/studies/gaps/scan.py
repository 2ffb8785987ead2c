"""What `optimisation.gap_advice` answers, beside a fine scan over the gap that is judged by the same criterion on the same members."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import CurveCase, performance_curves
from impact_env.ensemble import Executor
from impact_env.parameters import CoulombFriction, SlidingAbsorber
from impact_env.scene import Scene
from optimisation.bounds import expected_gap
from optimisation.gap_advice import TOLERANCE, Advice, advise
from optimisation.gap_check import scaled_absorber
from studies.gaps.structures import FORCE, Case

Array = NDArray[np.float64]
STEP, FROM, TO = 0.05, -1.225, 1.1  # of ln (gap over the rule's); half a step off the gaps that a search tries
WITHIN, NEARER, BESIDE = 1.5, 1.25, 2  # gaps are run in full where a look is within this of the lowest; judged where a full run is; so many beside
JUDGES = 15  # members, the first of them the search's: medians of few members differ by luck, and the lowest of many such is a lucky one


@dataclass(frozen=True)
class Row:
    """One case. Levels are medians over the lowest of the scan, for ``recommended`` the worst over the tolerance, over the lowest such.

    ``best`` is the best gap over the rule's; ``rule``, ``expected``: the levels at the rule's gap and at the fit of `expected_gap`. ``relative``: the
    lowest level over that without absorber. ``sharp_few`` and ``recommended_few`` are judged on the members of the search alone.
    """

    name: str
    resonance: int
    damping: float
    mass_ratio: float
    reach: float
    best: float
    relative: float
    sharp: float
    recommended: float
    rule: float
    expected: float
    sweeps: int
    gaps: int
    sharp_few: float
    recommended_few: float


def row(case: Case, members: int, step: float = STEP, rate: float | None = None, threads: int | None = None, executor: Executor | None = None) -> Row:
    """Return a case's row; raises KeyboardInterrupt if it is stopped."""
    model = case.model()
    absorber = scaled_absorber(model, FORCE, case.resonance, case.mass_ratio)
    where = {"threads": threads, "executor": executor}
    found = advise(model, FORCE, case.resonance, absorber, members=members, percent_per_100_periods=rate, **where)  # type: ignore[arg-type]
    if not found.complete or found.sharp is None or found.recommended is None:
        raise KeyboardInterrupt
    check = found.check
    fit = float(expected_gap(model, check.mass, FORCE, case.resonance))
    told = np.log(np.array([found.sharp.gap, found.recommended.gap, check.rule, fit]) / check.rule)
    grid = np.arange(FROM, TO, step)

    def levels(at: Sequence[float] | Array, number: int, speed: float) -> Array:
        scenes = [Scene(model, scaled(check.absorber, float(np.exp(x)))) for x in at]
        cases = [CurveCase(scene, np.array([FORCE]), case.resonance, check.limits, speed) for scene in scenes]
        curves = performance_curves(cases, number, 0, threads=threads, executor=executor)
        if not all(curve.complete for curve in curves):
            raise KeyboardInterrupt
        return np.array([curve.median[0] for curve in curves])

    near = grid[_beside(levels(grid, 1, found.look_rate), WITHIN)]
    few = levels(at := np.union1d(near, told), members, check.rate)
    by_few = judged(case, found, at, few, fit / check.rule)
    nearer = at[_beside(few, NEARER)]
    many = levels(at := np.union1d(nearer, told), max(JUDGES, members), check.rate)
    return replace(judged(case, found, at, many, fit / check.rule), sharp_few=by_few.sharp, recommended_few=by_few.recommended)


def _beside(levels: Array, within: float) -> NDArray[np.bool_]:
    """Return which levels are within a factor of the lowest, and those beside them."""
    return np.convolve(levels <= within * levels.min(), np.ones(2 * BESIDE + 1), "same") > 0


def scaled(absorber: SlidingAbsorber, factor: float) -> SlidingAbsorber:
    """Return an absorber with a multiple of its gap and of its friction limit."""
    walls, friction = absorber.walls, absorber.friction
    assert walls is not None
    return replace(
        absorber,
        walls=replace(walls, gap=walls.gap * factor),
        friction=None if friction is None else CoulombFriction(friction.limit * factor),
    )


def judged(case: Case, found: Advice, at: Array, full: Array, expected: float) -> Row:
    """Return the row of medians ``full`` (m) at ``at``, ln of gaps over the rule's, rising."""

    def between(x: Array | float) -> Array:
        beyond = np.maximum(np.asarray(x) - at[-1], 0.0)  # in proportion to the gap
        return np.asarray(np.exp(np.interp(x, at, np.log(full)) + beyond))

    shares = (1 - TOLERANCE, 1.0, 1 + TOLERANCE)
    inside = at[at - np.log1p(TOLERANCE) >= at[0]]
    worst = np.max([k * between(inside - np.log(k)) for k in shares], axis=0)
    assert found.sharp is not None
    assert found.recommended is not None
    sharp, robust = (np.log(answer.gap / found.check.rule) for answer in (found.sharp, found.recommended))
    lowest = full.min()
    told = (
        float(between(sharp) / lowest),
        float(max(k * between(robust - np.log(k)) for k in shares) / worst.min()),
    )
    return Row(
        case.name,
        case.resonance,
        float(case.model().damping_ratio[case.resonance - 1]),
        case.mass_ratio,
        found.check.reach,
        float(np.exp(at[np.argmin(full)])),
        float(lowest / found.check.without.median[0]),
        *told,
        float(between(0.0) / lowest),
        float(between(np.log(expected)) / lowest),
        found.sweeps,
        len(at),
        *told,
    )
