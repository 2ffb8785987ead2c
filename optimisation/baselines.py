"""What other absorbers of the same mass leave of a resonance: the best tuned absorber and the best friction damper, swept over one range.

All absorbers are judged by one criterion: the larger response level of a sweep up and one down over the same range of frequencies.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from impact_env.curve import CurveCase, performance_curves
from impact_env.ensemble import Executor
from impact_env.modes import ModalModel
from impact_env.parameters import Absorber, ParameterError, TunedAbsorber, friction_damper
from impact_env.scene import Scene
from optimisation.absorber_rules import best_friction
from optimisation.bounds import free_amplitude
from optimisation.tuned import smallest_amplitude

DAMPER_STEP = float(np.log(2.2))  # of ln friction limit


@dataclass(frozen=True)
class Baselines:
    """Levels in m (RMS) with other absorbers of the same mass, from sweeps over the same range; NaN where an absorber does nothing.

    ``tuned``: the tuned absorber with the smallest largest amplitude in the range. ``damper``: the best of the friction dampers that were simulated,
    with its limit ``damper_limit`` in N.
    """

    tuned: float
    damper: float
    damper_limit: float
    tuned_absorber: TunedAbsorber | None = None


def simulate_baselines(
    model: ModalModel,
    mass_ratio: float,
    condition: tuple[float, int],
    sweep_range: tuple[float, float],
    rate: float,
    executor: Executor,
) -> Baselines:
    """Return the levels of other absorbers of a mass; ``condition``: force in N and resonance. Raises KeyboardInterrupt if it is stopped.

    All of them are swept over one range, in units of the resonance, at one rate in % per 100 pseudo periods.
    """
    force, resonance = condition

    def level(absorber: Absorber) -> float:
        case = CurveCase(
            Scene(model, absorber),
            np.array([force]),
            resonance,
            sweep_range,
            rate,
            steady_start=True,
        )
        (curve,) = performance_curves([case], 1, executor=executor)
        if not curve.complete:
            raise KeyboardInterrupt
        return float(curve.median[0])

    tuned = None
    tuned_level = float("nan")
    try:
        tuned = smallest_amplitude(model, mass_ratio, resonance, *sweep_range)
        tuned_level = level(tuned)
    except (
        ParameterError
    ):  # nothing can be tuned where the resonance's mode does not move the place
        pass

    limit, damper_level = find_best_damper(
        lambda limit: level(friction_damper(limit, mass_ratio)),
        estimate_damper(model, mass_ratio * model.beam_mass, force, resonance),
    )
    return Baselines(tuned_level, damper_level, limit, tuned)


def estimate_damper(model: ModalModel, mass: float, force: float, resonance: int) -> float:
    """Return a friction limit in N from which to search a damper's: by the energy of a cycle, or by the free amplitude where that says nothing."""
    try:
        return best_friction(model, mass, force, resonance)[0]
    except ParameterError:
        free = free_amplitude(model, mass, force, resonance)
        return 0.2 * mass * model.resonance_omega(resonance) ** 2 * free


def find_best_damper(level: Callable[[float], float], estimate: float) -> tuple[float, float]:
    """Return (friction limit, level) of the best of four dampers: the estimate, one to either side, and one by the parabola through them.

    ``level``: of a limit in N. Where the best of three is the weakest or the strongest, the fourth goes on outwards.
    """
    if not (np.isfinite(estimate) and estimate > 0):
        return float("nan"), float("nan")
    shifts = [-DAMPER_STEP, 0.0, DAMPER_STEP]
    levels = [level(estimate * float(np.exp(shift))) for shift in shifts]
    best = int(np.argmin(levels))
    if best == 1:
        left, middle, right = np.log(levels)
        curvature = left - 2 * middle + right
        fourth = DAMPER_STEP * (left - right) / (2 * curvature) if curvature > 0 else 0.0
        if abs(fourth) < 0.05:  # the estimate is the best already
            fourth = 0.3
    else:
        fourth = 2 * shifts[best]
    shifts.append(float(fourth))
    levels.append(level(estimate * float(np.exp(fourth))))
    best = int(np.argmin(levels))
    return estimate * float(np.exp(shifts[best])), levels[best]
