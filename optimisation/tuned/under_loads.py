"""The tuned absorber under loads.

Its spring and damper are those with the least measure of these loads.

Under several tones, and where a sweep goes through several resonances, the measure is that of each
band, and the band of which most is left counts. Under random loads alone it is the absorber with
the least mean square that is expected for the spectrum (H2).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import positive
from impact_env.drive import Excitation
from impact_env.ensemble import draw_members, drives_of
from impact_env.frequency import receptance
from impact_env.loads import BASE_QUANTITY, Loads, Random
from impact_env.methods import Exact
from impact_env.modes import ModalModel
from impact_env.parameters import Absorber, TunedAbsorber
from impact_env.scene import Scene
from impact_env.solvers import check_load
from optimisation.load_cases import measure_bands, runs_of
from optimisation.measures import measure_of
from optimisation.tuned import minimax

Array = NDArray[np.float64]
RECORDS = 4  # of a tuning alone
# of the simplex search, in logarithms of stiffness and damping
CLOSE = 1e-3
MOST_TRIALS = 120
MeanRatio = Callable[[Sequence[Absorber]], Array]


def mean_ratio(run: Callable[..., Array], drives: Sequence[Excitation]) -> MeanRatio:
    """Return a function of absorbers that gives their mean relative measure, (absorbers,).

    It is the mean over the drives of the largest relative measure in any band.

    ``run`` is `runs_of` on a model.
    """
    free = run([None], drives, measure=measure_bands)[0]

    def ratios_of(absorbers: Sequence[Absorber]) -> Array:
        every = run(absorbers, drives, measure=measure_bands) / free
        return np.asarray(np.mean(np.max(every, axis=2), axis=1))

    return ratios_of


def expected_rms(model: ModalModel, tuned: TunedAbsorber | None, load: Random) -> float:
    """Return the expected RMS (m) where the level is read under a random load.

    It is the sum over the load's lines, with a tuned absorber or without absorber.

    A base's acceleration puts a load of its own on the absorber, whose force on the structure is a
    rank-one change (`impact_env.frequency`).
    """
    omega = 2 * np.pi * load.lines / load.length
    place = load.force_place
    driven = model.one_phase_force_shape if place is None else model.find_force_place(place)
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


def tune_for_loads(
    model: ModalModel,
    mass_ratio: float,
    drives: Sequence[Excitation],
    run: Callable[..., Array] | None = None,
) -> TunedAbsorber:
    """Return the spring and damper with the least measure.

    The search starts at the tuning for the first resonance's peak.

    ``run`` is `runs_of` on the model, as it is to be done (None: in threads on all cores).
    """
    run = partial(runs_of, model) if run is None else run
    first = minimax(model, mass_ratio)
    parts = drives[0].parts if isinstance(drives[0], Loads) else ()
    randoms = [part for part in parts if isinstance(part, Random)]
    left = mean_ratio(run, drives) if len(randoms) < max(len(parts), 1) else None

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
class TunedForLoads:
    """Tuned absorbers under ``loads``.

    ``best`` is the absorber with the least measure, ``peak`` the absorber with the smallest peak,
    and ``ratios`` (2, M) are their measures over those without absorber. Under several tones the
    measure is that of the band with the largest ratio.
    """

    loads: Loads
    measure: str
    best: TunedAbsorber
    peak: TunedAbsorber
    ratios: Array


def tune_under_loads(model: ModalModel, loads: Loads, mass_ratio: float) -> TunedForLoads:
    """Return the tuned absorber with the least measure under loads.

    The measure is taken over `RECORDS` members. For a random load the absorber is that of the least
    mean square.
    """
    check_load(Scene(model, None), loads, Exact())
    drives = drives_of(draw_members(RECORDS, 0), loads)
    best = tune_for_loads(model, positive("mass_ratio", mass_ratio), drives)
    peak = minimax(model, mass_ratio)
    levels = runs_of(model, [best, peak, None], drives, measure=measure_bands)
    return TunedForLoads(
        loads, measure_of(loads), best, peak, np.max(levels[:2] / levels[2], axis=2)
    )
