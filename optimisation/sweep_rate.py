"""What a sweep shows of the stationary response; `impact_env.drive.default_rate` says how fast it may be."""

from dataclasses import replace

import numpy as np

from impact_env.drive import PAPER_LIMITS, Drive, linear_sweep
from impact_env.modes import ModalModel
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.tuned import highest_amplitude

LEAST_RATIO = 0.95  # of the stationary level that a sweep must reach for a share of the possible reduction to be told


def stationary_level(model: ModalModel, resonance: int = 1, limits: tuple[float, float] = PAPER_LIMITS) -> float:
    """Return the largest stationary RMS where the level is read, in m per newton, over ``limits`` times omega_r, without absorber.

    Infinite if undamped.
    """
    return highest_amplitude(model, None, resonance, *limits)[0] / float(np.sqrt(2))


def sweep_ratio(model: ModalModel, rate: float, resonance: int = 1, limits: tuple[float, float] = PAPER_LIMITS) -> float:
    """Return the level of the sweeps without absorber (the larger of up and down) over `stationary_level`; 0 for an undamped resonance.

    ``rate`` in % of the resonance per 100 pseudo periods, ``limits`` over omega_r. Raises ParameterError for numbers out of range.
    """
    stationary = stationary_level(model, resonance, limits)
    if np.isinf(stationary):
        return 0.0
    scene = Scene(replace(model, tip_shape=model.level_shape, response_shape=None))  # without absorber its place is free, and a level there streams
    levels = []
    for start, stop in (limits, limits[::-1]):
        level = simulate(scene, Drive(1.0, linear_sweep(model.resonance_omega(resonance), start, stop, rate))).level
        assert level is not None
        levels.append(level.value)
    return max(levels) / stationary
