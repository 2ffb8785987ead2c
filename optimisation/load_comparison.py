"""Absorbers of one mass compared under loads: each concept at its own best for the loads as they are, then over their intensity.

The tuned absorber's spring and damper, the friction damper's limit and the impact absorber's gap make the measure smallest (`load_measures`), in the
mean over the members; the tuned one by a simplex search, the others on a grid and between its points. All concepts meet the same records and phases:
ratios are paired.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from impact_env.ensemble import Lane, draw_members, drives_of, each_lane
from impact_env.loads import AnyDrive, Loads, Member
from impact_env.methods import Exact, check_load
from impact_env.modes import ModalModel
from impact_env.parameters import Absorber, TunedAbsorber, count, friction_damper, impact_absorber, positive
from impact_env.scene import Scene
from optimisation.load_measures import free_size, measure_of, measured
from optimisation.tuned import minimax

Array = NDArray[np.float64]
GAPS = np.geomspace(0.35, 5.6, 13)  # of the free motion's size at the absorber, `free_size`
LIMITS = np.geomspace(0.05, 51.2, 16)  # of absorber mass times first frequency squared times that size; higher modes want larger ones
BETWEEN = np.linspace(-0.75, 0.75, 7)  # of the step of a grid, around its best
SPAN = (0.2, 5.0)  # of the loads' intensity
RESTITUTION = 0.7
RECORDS = 4  # of a tuning alone
TOLERANCE, MOST_TRIALS = 1e-3, 120  # of the simplex search, in logarithms of stiffness and damping


@dataclass(frozen=True, eq=False)
class LoadComparison:
    """Measures ``values`` (F, M) of each concept over the ``factors`` (F,) of intensity and M members; the absorbers, and `free_size` (m)."""

    loads: Loads
    measure: str
    factors: Array
    absorbers: dict[str, Absorber | None]
    values: dict[str, Array]
    free_size: float

    def ratio(self, concept: str) -> Array:
        """Return what a concept leaves of the measure without absorber, (F, M), member by member."""
        return np.asarray(self.values[concept] / self.values["none"])


def runs_of(model: ModalModel, absorbers: Sequence[Absorber | None], drives: Sequence[AnyDrive], threads: int | None = None) -> Array:
    """Return the measure of each absorber under each drive, (absorbers, drives); raises KeyboardInterrupt where it was interrupted."""
    lanes = [Lane(Scene(model, absorber), drive) for absorber in absorbers for drive in drives]
    found = each_lane(lanes, measured, threads=threads)
    if None in found:
        raise KeyboardInterrupt
    return np.array(found, dtype=np.float64).reshape(len(absorbers), -1)


def _best(model: ModalModel, make: Callable[[float], Absorber], sizes: Array, drives: Sequence[AnyDrive], threads: int | None) -> Absorber:
    """Return what is made of the size (gap or limit) with the least mean over the drives: of a grid in equal ratios, then between its neighbours."""

    def least(grid: Array) -> float:
        return float(grid[np.argmin(np.mean(runs_of(model, [make(float(size)) for size in grid], drives, threads), axis=1))])

    best = least(sizes) if len(sizes) > 1 else float(sizes[0])
    return make(least(best * (sizes[1] / sizes[0]) ** BETWEEN) if len(sizes) > 1 else best)


def tuned_for(model: ModalModel, mass_ratio: float, drives: Sequence[AnyDrive], threads: int | None = None) -> TunedAbsorber:
    """Return the spring and damper with the least mean of the measure; the search begins at the tuning for the first resonance's peak."""
    first = minimax(model, mass_ratio)

    def of(shifts: Array) -> TunedAbsorber:
        stiffness, damping = np.exp(shifts) * [first.stiffness, first.damping]
        return TunedAbsorber(mass_ratio, float(stiffness), float(damping))

    def mean(shifts: Array) -> float:
        return float(np.mean(runs_of(model, [of(shifts)], drives, threads)))

    options = {"xatol": TOLERANCE, "fatol": 0.0, "maxfev": MOST_TRIALS, "initial_simplex": [[0, 0], [0.1, 0], [0, 0.3]]}
    return of(scipy.optimize.minimize(mean, np.zeros(2), method="Nelder-Mead", options=options).x)


@dataclass(frozen=True, eq=False)
class TunedUnder:
    """Tuned absorbers under ``loads``: the ``best`` for them and that with the least ``peak``; measures of both and of no absorber, (3, M)."""

    loads: Loads
    measure: str
    best: TunedAbsorber
    peak: TunedAbsorber
    values: Array


def tuned_under(model: ModalModel, loads: Loads, mass_ratio: float, threads: int | None = None) -> TunedUnder:
    """Return the tuned absorber with the least measure under loads, over `RECORDS` members: for a random load that of the least mean square."""
    check_load(Scene(model, None), loads, Exact())
    drives = drives_of(draw_members(RECORDS, 0), loads)
    best, peak = tuned_for(model, positive("mass_ratio", mass_ratio), drives, threads), minimax(model, mass_ratio)
    return TunedUnder(loads, measure_of(loads), best, peak, runs_of(model, [best, peak, None], drives, threads))


def compare_loads(
    model: ModalModel, loads: Loads, *, mass_ratio: float, gap: float | None, factors: int, members: int, seed: int, threads: int | None = None
) -> LoadComparison:
    """Return the comparison over a number of ``factors`` of the loads' intensity; a ``gap`` in m is taken instead of the best one."""
    none = Scene(model, None)
    check_load(none, loads, Exact())
    drives = drives_of(draw_members(count("members", members, 1), seed), loads)
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    size = float(np.mean([free_size(Lane(none, drive)) for drive in drives]))
    gaps = size * GAPS if gap is None else np.array([positive("gap", gap)])
    impact = _best(model, lambda gap: impact_absorber(gap, RESTITUTION, None, mass_ratio), gaps, drives, threads)
    scale = mass * float(model.omega[0]) ** 2 * size
    friction = _best(model, lambda limit: friction_damper(limit, mass_ratio), scale * LIMITS, drives, threads)
    absorbers = {"none": None, "impact": impact, "friction": friction, "tuned": tuned_for(model, mass_ratio, drives, threads)}
    found = np.geomspace(*SPAN, factors)
    grid = [drive.member(Member(factor=float(factor))) for factor in found for drive in drives if isinstance(drive, Loads)]
    values = {name: runs_of(model, [one], grid, threads).reshape(factors, members) for name, one in absorbers.items()}
    return LoadComparison(loads, measure_of(loads), found, absorbers, values, size)
