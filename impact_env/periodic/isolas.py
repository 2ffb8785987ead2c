"""Folds, births and mergers of isolas of symmetric two-impact orbits.

The module also follows them over restitution, friction and number of modes.

They are found on the curve of the fold's force over the frequency, then with all reversals of
friction. With many modes the order of events changes so close to a fold that Newton's method on the
fold's conditions alternates between two orders. Continuation over the force passes each change of
order; the smallest force on the branch is that of the fold (`find_lowest_fold`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from impact_env.checks import count, require
from impact_env.kernels.periodic.closed_form import compute_line, compute_phase
from impact_env.modes import ModalModel
from impact_env.periodic.bifurcations import confirmed_bifurcation
from impact_env.periodic.branch import FOLD, INTERRUPTED, NoConvergenceError
from impact_env.periodic.case import Case
from impact_env.periodic.continuation import Steps
from impact_env.periodic.folds import Fold, find_fold, find_level_fold, find_reordered_fold
from impact_env.periodic.green import NoOrbit, Solution, make_solution
from impact_env.periodic.keeping import ComputeOrLoad, compute_uncached
from impact_env.periodic.orbit import Orbit, is_consistent, reorder_events
from impact_env.periodic.orbit_branches import OrbitBranch, orbit_branch, orbit_branches
from impact_env.periodic.symmetric import (
    BIRTH,
    MERGER,
    closed_folds,
    closed_form,
    find_level_places,
    fold_force,
    fold_impulse,
    map_frequencies,
    symmetric_schedule,
)

Array = NDArray[np.float64]
LEVEL_FOLD_REACH = 0.01  # relative: how far reversals may move a level place
SAME_FOLD_TOL = 1e-8  # of the first resonance: two folds of one response closer than this are one
ISOLA_COLUMNS = (
    "modes",
    "restitution",
    "friction_limit_N",
    "kind",
    "force_N",
    "omega_ratio",
    "orbit",
)
FORCE_FACTORS = (
    1.05,
    1.02,
    1.1,
)  # of the closed form's fold force: where an orbit of the branch is sought
FORCE_LIMITS = (0.85, 1.15)  # of it: forces between which the branch is followed
ISOLA_STEPS = Steps(first=0.01, least=1e-7, most=0.1, points=250)
SAME_PLACE_TOL = (
    1e-5  # of the frequency: how sharply a level place is found before Newton's method finishes it
)
EDGE_SHARE = 0.02  # of the range: a level place this close to its end lies elsewhere
SAME_FORCE_TOL = 1e-3  # of the force
# of frequency and force: where the smallest force changes faster than so it has gone over to
# another fold
FOLD_SHIFT = 1e-4
MOST_JUMP = 5e-4


@dataclass(frozen=True, eq=False)
class Threshold:
    """A fold, or a birth or merger of isolas, with its ``orbit`` or the reason why there is none.

    ``kind`` is a birth of isolas (minimum of the fold's force over the frequency), a merger
    (maximum), or a fold. ``force`` is in N, ``omega_ratio`` relative to the first resonance.
    """

    kind: str
    force: float
    omega_ratio: float
    orbit: Orbit | NoOrbit


def find_folds(
    case: Case, low: float, high: float, branches: Iterable[OrbitBranch] | None = None
) -> tuple[Threshold, ...]:
    """Return the folds of symmetric two-impact orbits at the case's force.

    They lie between two frequency ratios. Folds that are not confirmed as orbits are included.

    They are the folds of the closed form, in which friction has one sign between impacts. With
    friction each of them is computed again with its reversals, and the branches next to it are
    followed: where reversals appear and disappear a branch may have several folds, and the step
    size decides which of them are met. Steps of two sizes are therefore used. ``branches``: result
    of `orbit_branches` if known; None: computed here. Ctrl-C raises KeyboardInterrupt.
    """
    result = []
    reach = (low * float(case.model.omega[0]), high * float(case.model.omega[0]))
    for omega in closed_folds(case, low, high):
        at = case.changed(omega=omega)
        result += [_locate_folds(at, fold) for fold in _find_both_folds(at, "omega")]
    for branch in (
        ()
        if case.friction_limit == 0
        else orbit_branches(case, *reach)
        if branches is None
        else branches
    ):
        coarse = orbit_branch(branch.solution(len(branch.schedules) // 2), "omega", reach)
        for again in (branch, coarse):
            if again.branch.ended == INTERRUPTED:
                raise KeyboardInterrupt
            result += [
                _locate_folds(case, fold) for fold in again.folds() if not isinstance(fold, NoOrbit)
            ]
    confirmed: list[
        Threshold
    ] = []  # without repetitions, and those that are no orbits where none is
    for fold in sorted(result, key=lambda fold: isinstance(fold.orbit, NoOrbit)):
        if not any(_is_same_fold(fold, other) for other in confirmed):
            confirmed.append(fold)
    return tuple(sorted(confirmed, key=lambda fold: fold.omega_ratio))


def _find_both_folds(case: Case, parameter: str) -> list[Fold | NoOrbit]:
    """Return the closed form's fold and the fold with consistent reversals, at least one of them.

    The closed form's fold is left out if its motion has reversals. The other has the reversals of
    the motions next to it.
    """
    schedule = symmetric_schedule(case.friction_limit > 0)
    line = compute_line(case.structure, case.point)
    impulse = fold_impulse(case)
    start = np.array([compute_phase(line, case.force, impulse), impulse / case.scale.impulse])
    plain = find_fold(make_solution(case, schedule, start, 0.0), parameter)
    alone = not isinstance(plain, NoOrbit) and (
        case.friction_limit == 0 or is_consistent(plain.motion)
    )
    if case.friction_limit == 0:
        return [plain]
    reordered = find_reordered_fold(case, schedule, start, parameter)
    return [plain, reordered] if alone else [reordered]


def _locate_folds(case: Case, fold: Fold | NoOrbit) -> Threshold:
    return Threshold(
        FOLD,
        case.force,
        case.omega_ratio if isinstance(fold, NoOrbit) else fold.case.omega_ratio,
        _orbit_of(fold),
    )


def _is_same_fold(one: Threshold, other: Threshold) -> bool:
    """Return whether two folds have the same frequency and tip amplitude."""
    if abs(one.omega_ratio - other.omega_ratio) > SAME_FOLD_TOL:
        return False
    tips = [fold.orbit.motion.tip_max for fold in (one, other) if isinstance(fold.orbit, Orbit)]
    return len(tips) < 2 or abs(tips[0] - tips[1]) < 1e-6 * tips[0]


def find_thresholds(case: Case, low: float, high: float) -> tuple[Threshold, ...]:
    """Return births and mergers of isolas of symmetric two-impact orbits.

    They lie between two frequency ratios. Thresholds that are not confirmed as orbits are included.

    They are minima and maxima of the closed form's fold force over the frequency. If the motion has
    reversals, they are computed again: by Newton's method on the fold's conditions, or, if it does
    not converge, along branches over the force. Ctrl-C raises KeyboardInterrupt.
    """
    result = []
    for kind, force, omega in find_level_places(case, low, high):
        at = case.changed(omega=omega, force=force)
        fold = _find_both_folds(at, "force")[0]
        if not isinstance(fold, NoOrbit) and fold.motion.solution.schedule.reversals:
            fold = find_level_fold(fold, LEVEL_FOLD_REACH * omega)
        if isinstance(fold, NoOrbit) and case.friction_limit > 0:
            again = find_lowest_level(at, kind, LEVEL_FOLD_REACH * omega)
            fold = (
                again
                if not isinstance(again, NoOrbit)
                else NoOrbit(at, fold.schedule, f"{fold.reason}; {again.reason}", fold.phases)
            )
        here = at if isinstance(fold, NoOrbit) else fold.case
        result.append(Threshold(kind, here.force, here.omega_ratio, _orbit_of(fold)))
    return tuple(result)


def _orbit_of(fold: Fold | NoOrbit) -> Orbit | NoOrbit:
    return fold if isinstance(fold, NoOrbit) else confirmed_bifurcation(FOLD, fold.motion)


@dataclass(frozen=True)
class LevelPoint:
    """A birth or a merger of isolas (``kind``) at a force in N and a frequency ratio.

    ``refused`` is the reason why there is no orbit, or empty.
    """

    kind: str
    force: float
    omega_ratio: float
    refused: str = ""


@dataclass(frozen=True, eq=False)
class IsolaCell:
    """Births and mergers of isolas at one cell of the map, in the order of frequency.

    A cell is a number of modes, a restitution and a friction limit in N.
    """

    modes: int
    restitution: float
    friction_limit: float
    points: tuple[LevelPoint, ...]

    @property
    def pair(self) -> tuple[LevelPoint | None, LevelPoint | None]:
        """Birth and merger of the isola next to the resonance, None if absent.

        They are the last merger below the resonance (or, without any, the last merger of the
        range), and the last birth before this merger.
        """
        mergers = [t for t in self.points if t.kind == MERGER]
        mergers = [t for t in mergers if t.omega_ratio < 1] or mergers
        if not mergers:
            return None, None
        births = [
            t for t in self.points if t.kind == BIRTH and t.omega_ratio < mergers[-1].omega_ratio
        ]
        return (births[-1] if births else None), mergers[-1]

    def rows(self) -> list[tuple[object, ...]]:
        """Return a row of `ISOLA_COLUMNS` for each birth and merger.

        "orbit" is "yes", or the reason why the exact method refuses it.
        """
        own = (self.modes, self.restitution, self.friction_limit)
        return [
            (*own, level.kind, level.force, level.omega_ratio, level.refused or "yes")
            for level in self.points
        ]

    def to_plain(self) -> dict[str, Any]:
        """Return names and plain values; ``found`` are the points."""
        plain = asdict(self)
        return {("found" if name == "points" else name): value for name, value in plain.items()}

    @staticmethod
    def from_plain(plain: dict[str, Any]) -> IsolaCell:
        """Return the cell of the plain values of `to_plain`."""
        levels = tuple(LevelPoint(**level) for level in plain["found"])
        return IsolaCell(
            int(plain["modes"]), float(plain["restitution"]), float(plain["friction_limit"]), levels
        )


def make_cell(case: Case, low: float, high: float) -> IsolaCell:
    """Return the births and mergers of a case between two ratios of its first resonance."""
    levels = [
        LevelPoint(
            t.kind, t.force, t.omega_ratio, t.orbit.reason if isinstance(t.orbit, NoOrbit) else ""
        )
        for t in find_thresholds(case, low, high)
    ]
    return IsolaCell(case.model.modes, case.restitution, case.friction_limit, tuple(levels))


@dataclass(frozen=True, eq=False)
class IsolaMap:
    """Fold force of one case over the frequency, and births and mergers of isolas over parameters.

    Attributes
    ----------
    case : Case
        The case.
    omega_ratio, fold_force : array, (m,)
        Frequency ratios, and the fold's force in N at each.
    own : IsolaCell
        Births and mergers of the case itself.
    cells : tuple of IsolaCell
        Those of other numbers of modes, restitutions and friction limits.
    complete : bool
        False after Ctrl-C.
    """

    case: Case
    omega_ratio: Array
    fold_force: Array
    own: IsolaCell
    cells: tuple[IsolaCell, ...]
    complete: bool

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings."""
        return {
            "scene": str(self.case.scene),
            "complete": self.complete,
            "thresholds": [dict(zip(ISOLA_COLUMNS, row, strict=True)) for row in self.own.rows()],
            "fold_force": {
                "omega_ratio": self.omega_ratio.tolist(),
                "force_N": [float(f) if np.isfinite(f) else None for f in self.fold_force],
            },
            "map": [
                dict(zip(ISOLA_COLUMNS, row, strict=True))
                for cell in self.cells
                for row in cell.rows()
            ],
        }


def truncate_model(model: ModalModel, modes: int) -> ModalModel:
    """Return the model with its first ``modes`` modes; raises ParameterError if it has fewer."""
    modes = count("modes", modes, 1, model.modes)
    level = None if model.response_shape is None else model.response_shape[:modes]
    rows = (
        model.omega[:modes],
        model.damping_ratio[:modes],
        model.one_phase_force_shape[:modes],
        model.tip_shape[:modes],
    )
    return ModalModel(*rows, model.beam_mass, response_shape=level)


def isola_map(
    case: Case,
    low: float,
    high: float,
    modes: Sequence[int],
    restitutions: Sequence[float],
    progress: Callable[[int, int], None] | None = None,
    limits: Sequence[float] = (),
    keep: ComputeOrLoad = compute_uncached,
) -> IsolaMap:
    """Return a case's fold force and thresholds, and thresholds for other parameters.

    The frequencies lie between two ratios, ``low`` and ``high``, of the case's first resonance. The
    cells have all combinations of the numbers of ``modes``, ``restitutions`` and friction
    ``limits`` in N (none: the case's own limit). The case's own model has the largest number of
    modes. ``keep`` stores and reads finished cells. After Ctrl-C the finished cells are returned.
    Raises ParameterError for bad values.
    """
    require(
        0 < low < high,
        "frequency range",
        (low, high),
        "two ratios of the resonance frequency above 0, the lower one first",
    )
    omegas = map_frequencies(case, low, high)
    models = [truncate_model(case.model, n) for n in modes]
    mass = case.mass_ratio * case.model.beam_mass
    friction = limits or (case.friction_limit,)
    points = [
        Case(model, case.omega, case.force, case.gap, e, limit, mass / model.beam_mass)
        for model in models
        for limit in friction
        for e in restitutions
    ]

    def cell(at: Case) -> Iterator[IsolaCell]:
        name = {
            "modes": at.model.modes,
            "restitution": at.restitution,
            "friction_limit": at.friction_limit,
            "range": [low, high],
        }
        return keep(name, lambda: iter([make_cell(at, low, high)]), IsolaCell.from_plain)

    (own,) = cell(case)
    cells: list[IsolaCell] = []
    complete = True
    try:
        for at in points:
            cells += cell(at)
            if progress is not None:
                progress(len(cells), len(points))
    except KeyboardInterrupt:
        complete = False
    return IsolaMap(
        case,
        omegas / float(case.model.omega[0]),
        fold_force(case, omegas),
        own,
        tuple(cells),
        complete,
    )


def find_lowest_fold(case: Case) -> Fold | NoOrbit:
    """Return the orbit with the smallest force at the case's frequency, or why none is found.

    The force of the case is ignored. Ctrl-C interrupts the search.
    """
    schedule = symmetric_schedule(case.friction_limit > 0)
    reason = "no orbit above the fold"
    lowest = float(fold_force(case, [case.omega])[0])
    for share in FORCE_FACTORS:
        at = case.changed(force=share * lowest)
        result = list[Fold]()
        for start in closed_form(at):
            motion = reorder_events(at, schedule, [start.phase])
            if isinstance(motion, NoOrbit):
                reason = motion.reason
                continue
            try:
                result += _folds_over_force(
                    motion.solution, FORCE_LIMITS[0] * lowest, FORCE_LIMITS[1] * lowest
                )
                reason = "no fold of the branch over the force is an orbit"
            except NoConvergenceError as error:
                reason = str(error)
        if result:
            return min(result, key=lambda fold: fold.case.force)
    return NoOrbit(case, schedule, reason, np.zeros(1))


def _folds_over_force(solution: Solution, low: float, high: float) -> list[Fold]:
    """Return the confirmed folds on the branch over the force (N) through a solution.

    Raises NoConvergenceError if the solution has no branch.
    """
    branch = orbit_branch(solution, "force", (low, high), ISOLA_STEPS)
    if branch.branch.ended == INTERRUPTED:
        raise KeyboardInterrupt
    return [
        fold
        for fold in branch.folds()
        if isinstance(fold, Fold)
        and not isinstance(confirmed_bifurcation(FOLD, fold.motion), NoOrbit)
    ]


def find_lowest_level(case: Case, kind: str, reach: float) -> Fold | NoOrbit:
    """Return the fold at which the smallest force of orbits has a minimum over the frequency.

    For a merger (``kind``) it is a maximum. The frequency is sought within ``reach`` (rad/s) of the
    case's. The result is the extremum itself, or the corner where two orders of events meet. Ctrl-C
    raises KeyboardInterrupt.
    """
    sign = 1.0 if kind == BIRTH else -1.0
    known = dict[float, Fold]()
    lost = list[NoOrbit]()

    def height(omega: float) -> float:
        fold = find_lowest_fold(case.changed(omega=omega))
        if isinstance(fold, NoOrbit):
            lost.append(fold)
            return 2 * abs(
                case.force
            )  # higher than any force near a birth, lower than any near a merger
        known[omega] = fold
        return sign * fold.case.force

    low = case.omega - reach
    high = case.omega + reach
    scipy.optimize.minimize_scalar(
        height,
        bounds=(low, high),
        method="bounded",
        options={"xatol": SAME_PLACE_TOL * case.omega, "maxiter": 40},
    )
    if not known:
        return lost[0]
    best = min(known.values(), key=lambda fold: sign * fold.case.force)
    if min(best.case.omega - low, high - best.case.omega) < EDGE_SHARE * (high - low):
        return NoOrbit(
            best.case,
            best.motion.solution.schedule,
            "its level fold lies elsewhere",
            best.motion.solution.phases,
        )
    for omega in (best.case.omega * (1 - FOLD_SHIFT), best.case.omega * (1 + FOLD_SHIFT)):
        next_to = find_lowest_fold(best.case.changed(omega=omega))
        if (
            isinstance(next_to, NoOrbit)
            or abs(next_to.case.force / best.case.force - 1) > MOST_JUMP
        ):
            return NoOrbit(
                best.case,
                best.motion.solution.schedule,
                "the smallest force jumps there",
                best.motion.solution.phases,
            )
    finished = find_level_fold(best, reach)
    if (
        isinstance(finished, Fold)
        and abs(finished.case.force / best.case.force - 1) < SAME_FORCE_TOL
    ):
        return finished
    return best
