"""Absorbers under loads: each concept at its own best for the loads as they are, then over their intensity.

The tuned absorber's spring and damper, the friction damper's limit and the impact absorber's gap make smallest what is left of the measure
(`measures`), in the mean over the members; the tuned one by a simplex search, the others on a grid and between its points. Under several
tones, and where a sweep goes through several resonances, the measure is that of each band, and the band of which most is left counts. Under random
loads alone the tuned absorber is that of the least mean square that is expected for the spectrum (H2). All concepts meet the same records and phases:
ratios are paired.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.drive import Excitation, Member
from impact_env.ensemble import Executor, Lane, LaneProgress, draw_members, drives_of, each_lane
from impact_env.frequency import receptance
from impact_env.loads import BASE_QUANTITY, Loads, Random
from impact_env.methods import Exact
from impact_env.modes import ModalModel
from impact_env.parameters import (
    Absorber,
    TunedAbsorber,
    count,
    friction_damper,
    impact_absorber,
    positive,
)
from impact_env.scene import Scene
from impact_env.solvers import check_load
from optimisation.absorber_rules import RESTITUTION
from optimisation.load_cases import Reading, find_reading
from optimisation.measures import (
    check_size,
    free_size,
    measure_of,
    measured,
)
from optimisation.signals import band_levels, edges_of
from optimisation.tuned import minimax

Array = NDArray[np.float64]
GAPS = np.geomspace(0.35, 5.6, 13)  # of the free motion's size at the absorber, `free_size`
LIMITS = np.geomspace(
    0.05, 51.2, 16
)  # of absorber mass times first frequency squared times that size; higher modes want larger ones
BETWEEN = np.linspace(-0.75, 0.75, 7)  # of the step of a grid, around its best
SPAN = (0.2, 5.0)  # of the loads' intensity
RECORDS = 4  # of a tuning alone
# of the simplex search, in logarithms of stiffness and damping
CLOSE = 1e-3
MOST_TRIALS = 120


@dataclass(frozen=True, eq=False)
class LoadComparison:
    """Measures ``values`` (F, M, B) of each concept over the ``factors`` (F,) of intensity, M members and B bands; absorbers, and `free_size` (m).

    ``edges`` (B + 1,) in Hz lie between the bands, see `signals.edges_of`; mostly there is one. ``readings``: where each concept's level is read
    under the loads as they are, see `find_reading`.
    """

    loads: Loads
    measure: str
    edges: Array
    factors: Array
    absorbers: dict[str, Absorber | None]
    values: dict[str, Array]
    free_size: float
    readings: dict[str, Reading]

    def ratio(self, concept: str) -> Array:
        """Return a concept's measure over that without absorber, (F, M, B), member by member."""
        return np.asarray(self.values[concept] / self.values["none"])


def _in_bands(lane: Lane) -> tuple[float, ...]:
    return (
        band_levels(lane) if len(edges_of(lane.scene.model, lane.drive)) > 2 else (measured(lane),)
    )


def runs_of(
    model: ModalModel,
    absorbers: Sequence[Absorber | None],
    drives: Sequence[Excitation],
    threads: int | None = None,
    measure: Callable[[Lane], Any] = measured,
    executor: Executor | None = None,
    progress: LaneProgress | None = None,
) -> Array:
    """Return the measure of each absorber under each drive, (absorbers, drives, ...); raises KeyboardInterrupt where it was interrupted."""
    measured_lanes = each_lane(
        [
            Lane(Scene(model, absorber), drive, steady_start=True)
            for absorber in absorbers
            for drive in drives
        ],
        measure,
        threads=threads,
        executor=executor,
        progress=progress,
    )
    if any(one is None for one in measured_lanes):
        raise KeyboardInterrupt
    values = np.array(measured_lanes, dtype=np.float64)
    return values.reshape(len(absorbers), len(drives), *values.shape[1:])


Left = Callable[[Sequence[Absorber]], Array]
Stages = Callable[[str, int, int], None]


def _left(run: Callable[..., Array], drives: Sequence[Excitation]) -> Left:
    """Return a function of absorbers: the mean over the drives of each one's largest relative measure in any band, (absorbers,).

    ``run`` is `runs_of` on a model.
    """
    free = run([None], drives, measure=_in_bands)[0]

    def left(absorbers: Sequence[Absorber]) -> Array:
        every = run(absorbers, drives, measure=_in_bands) / free
        return np.asarray(np.mean(np.max(every, axis=2), axis=1))

    return left


def _best(left: Left, make: Callable[[float], Absorber], sizes: Array) -> Absorber:
    """Return the absorber of the size (gap or limit) with the least measure: of a grid in equal ratios, then between its neighbours."""

    def least(grid: Array) -> float:
        return float(grid[np.argmin(left([make(float(size)) for size in grid]))])

    best = least(sizes) if len(sizes) > 1 else float(sizes[0])
    return make(least(best * (sizes[1] / sizes[0]) ** BETWEEN) if len(sizes) > 1 else best)


def expected_rms(model: ModalModel, tuned: TunedAbsorber | None, load: Random) -> float:
    """Return the RMS (m) that is expected where the level is read under a random load: the sum over its lines, with a tuned absorber or none.

    A base's acceleration puts a load of its own on the absorber, whose force on the structure is a rank-one change (`impact_env.frequency`).
    """
    omega = 2 * np.pi * load.lines / load.length
    driven = model.one_phase_force_shape
    if load.quantity == BASE_QUANTITY:
        assert model.base_participation is not None  # check_load
        driven = -model.base_participation
    motion = receptance(model, omega, model.level_shape, driven)
    if tuned is not None:
        mass = tuned.mass_ratio * model.beam_mass
        spring = tuned.stiffness + 1j * omega * tuned.damping
        inertia = mass * omega**2
        at_absorber, own, across = (
            receptance(model, omega, model.tip_shape, row)
            for row in (driven, model.tip_shape, model.level_shape)
        )
        pushed = mass * model.base_at_absorber * (load.quantity == BASE_QUANTITY)
        motion = motion + across * spring * (inertia * at_absorber - pushed) / (
            spring - inertia - own * inertia * spring
        )
    return float(np.sqrt(np.sum(load.density * np.abs(motion) ** 2) / load.length))


def tuned_for(
    model: ModalModel,
    mass_ratio: float,
    drives: Sequence[Excitation],
    run: Callable[..., Array] | None = None,
) -> TunedAbsorber:
    """Return the spring and damper that leave least of the measure; the search begins at the tuning for the first resonance's peak.

    ``run`` is `runs_of` on the model, as it is to be done (None: in threads on all cores).
    """
    run = partial(runs_of, model) if run is None else run
    first = minimax(model, mass_ratio)
    parts = drives[0].parts if isinstance(drives[0], Loads) else ()
    randoms = [part for part in parts if isinstance(part, Random)]
    left = _left(run, drives) if len(randoms) < max(len(parts), 1) else None

    def of(shifts: Array) -> TunedAbsorber:
        stiffness, damping = np.exp(shifts) * [first.stiffness, first.damping]
        return TunedAbsorber(mass_ratio, float(stiffness), float(damping))

    def cost(shifts: Array) -> float:
        if left is None:
            return float(
                np.linalg.norm([expected_rms(model, of(shifts), part) for part in randoms])
            )
        return float(left([of(shifts)])[0])

    options = {
        "xatol": CLOSE,
        "fatol": 0.0,
        "maxfev": MOST_TRIALS,
        "initial_simplex": [[0, 0], [0.1, 0], [0, 0.3]],
    }
    return of(scipy.optimize.minimize(cost, np.zeros(2), method="Nelder-Mead", options=options).x)


@dataclass(frozen=True, eq=False)
class TunedUnder:
    """Tuned absorbers under ``loads``: the ``best`` for them and that with the least ``peak``; what either leaves of the measure, (2, M).

    Under several tones that is of the band of which most is left.
    """

    loads: Loads
    measure: str
    best: TunedAbsorber
    peak: TunedAbsorber
    ratios: Array


def tuned_under(model: ModalModel, loads: Loads, mass_ratio: float) -> TunedUnder:
    """Return the tuned absorber with the least measure under loads, over `RECORDS` members: for a random load that of the least mean square."""
    check_load(Scene(model, None), loads, Exact())
    drives = drives_of(draw_members(RECORDS, 0), loads)
    best = tuned_for(model, positive("mass_ratio", mass_ratio), drives)
    peak = minimax(model, mass_ratio)
    levels = runs_of(model, [best, peak, None], drives, measure=_in_bands)
    return TunedUnder(loads, measure_of(loads), best, peak, np.max(levels[:2] / levels[2], axis=2))


def compare_loads(
    model: ModalModel,
    loads: Loads,
    *,
    mass_ratio: float,
    gap: float | None,
    factors: int,
    members: int,
    seed: int,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: Stages | None = None,
) -> LoadComparison:
    """Return the comparison over a number of ``factors`` of the loads' intensity; a ``gap`` in m is taken instead of the best one.

    The absorbers are chosen on ``members`` runs, and compared on as many others.
    ``progress`` takes what is looked for, the number of runs so far, and how many there will be (0: not known). An ``executor`` runs them elsewhere.
    """
    none = Scene(model, None)
    check_load(none, loads, Exact())
    members = count("members", members, 1)
    every = drives_of(draw_members(2 * members, seed), loads)
    drives = every[:members]  # on which absorbers are chosen; they are compared on the others
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    size = float(np.mean([free_size(Lane(none, drive, steady_start=True)) for drive in drives]))
    if gap is not None:
        check_size(Scene(model, impact_absorber(gap, RESTITUTION, None, mass_ratio)), loads)
    gaps = size * GAPS if gap is None else np.array([gap])
    done = 0

    def run(
        absorbers: Sequence[Absorber | None], drives: Sequence[Excitation], **how: Any
    ) -> Array:
        nonlocal done
        before = done
        done += len(absorbers) * len(drives)
        show = None if progress is None else lambda k, _: progress("runs", before + k, 0)
        return runs_of(model, absorbers, drives, threads, executor=executor, progress=show, **how)

    left = _left(run, drives)
    impact = _best(left, lambda gap: impact_absorber(gap, RESTITUTION, None, mass_ratio), gaps)
    scale = mass * float(model.omega[0]) ** 2 * size
    friction = _best(left, lambda limit: friction_damper(limit, mass_ratio), scale * LIMITS)
    absorbers = {
        "none": None,
        "impact": impact,
        "friction": friction,
        "tuned": tuned_for(model, mass_ratio, drives, run),
    }
    factors_run = np.geomspace(*SPAN, factors)
    grid = [
        drive.member(Member(factor=float(factor)))
        for factor in factors_run
        for drive in every[members:]
        if isinstance(drive, Loads)
    ]
    values = {
        name: run([one], grid, measure=_in_bands).reshape(factors, members, -1)
        for name, one in absorbers.items()
    }
    readings = {name: find_reading(model, one, loads) for name, one in absorbers.items()}
    return LoadComparison(
        loads,
        measure_of(loads),
        edges_of(model, loads),
        factors_run,
        absorbers,
        values,
        size,
        readings,
    )
