"""Folds, births and mergers of the symmetric two-impact orbits: found on the fold force's map over frequency, then with all reversals of friction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.periodic.closed_form import line_of, phase_of
from impact_env.parameters import require
from impact_env.periodic.branch import STOPPED
from impact_env.periodic.case import Case
from impact_env.periodic.fold_map import closed_folds, level_places
from impact_env.periodic.folds import Fold, fold_near, level_fold, mended_fold
from impact_env.periodic.green import NoOrbit, solution_of
from impact_env.periodic.lowest_fold import lowest_level
from impact_env.periodic.orbit import Orbit, confirmed, consistent
from impact_env.periodic.orbit_branches import orbit_branches
from impact_env.periodic.survey import branches_from, closed_form_orbits
from impact_env.periodic.symmetric import fold_impulse, symmetric_schedule
from impact_env.periodic.tracing import OrbitBranch

Array = NDArray[np.float64]
MAPPED = ("gap", "restitution", "friction_limit", "mass_ratio")
NEAR = 0.01  # relative: how far reversals may move a level place
SEEDS = 40  # frequencies at which branches are begun
SAME = 1e-8  # of the first resonance: two folds of one response closer than this are one


@dataclass(frozen=True, eq=False)
class Threshold:
    """Where isolas are born (a valley of the fold force) or merge (a ridge): ``orbit`` at the fold there, or why it is none."""

    kind: str
    force: float
    omega_ratio: float
    orbit: Orbit | NoOrbit


@dataclass(frozen=True, eq=False)
class LocatedFold:
    """A fold at the case's force: ``orbit`` there, or why it is none."""

    force: float
    omega_ratio: float
    orbit: Orbit | NoOrbit


def _fold_start(case: Case) -> Array:
    """Return the unknowns (2,) of the closed form's fold at the case's frequency."""
    line, impulse = line_of(case.structure, case.point), fold_impulse(case)
    return np.array([phase_of(line, case.force, impulse), impulse / case.scale.impulse])


def folds(case: Case, low: float, high: float, branches: Iterable[OrbitBranch] | None = None) -> tuple[LocatedFold, ...]:
    """Return the folds of symmetric two-impact orbits at the case's force between two frequency ratios, those that are no orbits too.

    They are those of the closed form, where friction is taken as one-signed. With friction each of them is found again with its reversals, and the
    branches beside it are followed: where reversals come and go a branch may fold more than once, and as the order of events changes at a point of
    the branch, how finely it is followed decides which of these are met. So it is done with steps of two sizes. ``branches``: those of
    `orbit_branches` where they are known; None: they are followed here. Ctrl-C breaks it off.
    """
    found, reach = [], (low * float(case.model.omega[0]), high * float(case.model.omega[0]))
    for omega in closed_folds(case, low, high):
        at = case.changed(omega=omega)
        found += [_located(at, fold) for fold in _both_folds(at, "omega")]
    if case.friction_limit > 0:
        seeds = [closed_form_orbits(case.changed(omega=float(omega))) for omega in np.linspace(*reach, SEEDS)]
        fine = orbit_branches(case, *reach) if branches is None else branches
        for branch in chain(fine, branches_from(seeds, *reach)):
            if branch.branch.ended == STOPPED:
                raise KeyboardInterrupt
            found += [_located(case, fold) for fold in branch.folds() if not isinstance(fold, NoOrbit)]
    return tuple(sorted(_apart(found), key=lambda fold: fold.omega_ratio))


def _both_folds(case: Case, parameter: str) -> list[Fold | NoOrbit]:
    """Return the closed form's fold if nothing turns there, and the one with the reversals that its neighbours show; at least one of them."""
    schedule, start = symmetric_schedule(case.friction_limit > 0), _fold_start(case)
    plain = fold_near(solution_of(case, schedule, start, 0.0), parameter)
    alone = not isinstance(plain, NoOrbit) and (case.friction_limit == 0 or consistent(plain.motion))
    if case.friction_limit == 0:
        return [plain]
    mended = mended_fold(case, schedule, start, parameter)
    return [plain, mended] if alone else [mended]


def _located(case: Case, fold: Fold | NoOrbit) -> LocatedFold:
    return LocatedFold(case.force, case.omega_ratio if isinstance(fold, NoOrbit) else fold.case.omega_ratio, _orbit_of(fold))


def _apart(found: list[LocatedFold]) -> list[LocatedFold]:
    """Return folds that are orbits without repetitions, then those that are none and lie elsewhere."""
    kept: list[LocatedFold] = []
    for fold in sorted(found, key=lambda fold: isinstance(fold.orbit, NoOrbit)):
        if not any(_same(fold, other) for other in kept):
            kept.append(fold)
    return kept


def _same(one: LocatedFold, other: LocatedFold) -> bool:
    if abs(one.omega_ratio - other.omega_ratio) > SAME:
        return False
    tips = [fold.orbit.motion.tip_max for fold in (one, other) if isinstance(fold.orbit, Orbit)]
    return len(tips) < 2 or abs(tips[0] - tips[1]) < 1e-6 * tips[0]


def thresholds(case: Case, low: float, high: float) -> tuple[Threshold, ...]:
    """Return births and mergers of isolas of symmetric two-impact orbits between two frequency ratios, those that are no orbits too.

    They are valleys and ridges of the closed form's fold force, found again with all reversals where something turns: by Newton's method on the
    fold's own conditions, and along branches over the force where that does not settle. Ctrl-C breaks it off.
    """
    found = []
    for kind, force, omega in level_places(case, low, high):
        at = case.changed(omega=omega, force=force)
        fold = _both_folds(at, "force")[0]
        if not isinstance(fold, NoOrbit) and fold.motion.solution.schedule.reversals:
            fold = level_fold(fold, NEAR * omega)
        if isinstance(fold, NoOrbit) and case.friction_limit > 0:
            again = lowest_level(at, kind, NEAR * omega)
            fold = again if not isinstance(again, NoOrbit) else NoOrbit(at, fold.schedule, f"{fold.reason}; {again.reason}", fold.phases)
        here = at if isinstance(fold, NoOrbit) else fold.case
        found.append(Threshold(kind, here.force, here.omega_ratio, _orbit_of(fold)))
    return tuple(found)


def threshold_map(case: Case, parameter: str, values: Iterable[float], low: float, high: float) -> Iterator[tuple[float, tuple[Threshold, ...]]]:
    """Yield each value of a parameter of the case (gap, restitution, friction_limit or mass_ratio, in SI units) with its births and mergers.

    For a map over structures call `thresholds` with the cases of each model.
    """
    require(parameter in MAPPED, "parameter", parameter, f"one of {', '.join(MAPPED)}")
    for value in values:
        yield float(value), thresholds(case.changed(**{parameter: float(value)}), low, high)


def _orbit_of(fold: Fold | NoOrbit) -> Orbit | NoOrbit:
    return fold if isinstance(fold, NoOrbit) else confirmed(fold.motion)
