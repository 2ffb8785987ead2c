"""How fast a sweep may be on a structure, and what a sweep shows of the stationary response.

A resonance of damping ratio D builds up in about 1/(D omega), and while the frequency crosses its width 2 D omega at a rate r there are 2 D omega/r
for it: what counts is r over (D omega)^2. The paper's rate suits its damping of 1 %, so the default goes with the square of the damping. It is
never faster than the paper's, since impacts have times of their own that no damping shortens.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from impact_env.drive import PAPER_LIMITS, PAPER_RATE, Drive, linear_sweep
from impact_env.modes import ModalModel
from impact_env.parameters import Beam, require
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.tuned import highest_amplitude

assert isinstance(Beam.damping_ratio, float)
PAPER_DAMPING = Beam.damping_ratio
LEAST_RATIO = 0.95  # of the stationary level that a sweep must reach for a share of the possible reduction to be told
LEAST_DAMPING = 1e-4  # the sweep of an undamped resonance would never end


def default_rate(model: ModalModel, resonances: Iterable[int] = (1,)) -> float:
    """Return the rate in % of the resonance per 100 pseudo periods: the paper's, or less by the square of a smaller damping ratio than 1 %.

    Of several ``resonances`` (counted from 1) the least damped one counts. A damping ratio below 1e-4 counts as 1e-4. Raises ParameterError for a
    resonance that the model lacks.
    """
    ratios = [float(model.damping_ratio[k - 1]) for k in resonances if model.resonance_omega(k)]
    require(len(ratios) > 0, "resonances", ratios, "one or more")
    return PAPER_RATE * min(1.0, max(min(ratios), LEAST_DAMPING) / PAPER_DAMPING) ** 2


def stationary_level(model: ModalModel, resonance: int = 1, limits: tuple[float, float] = PAPER_LIMITS) -> float:
    """Return the largest stationary RMS of the tip in m per newton over ``limits`` times omega_r, without absorber; infinite if undamped."""
    return highest_amplitude(model, None, resonance, *limits)[0] / float(np.sqrt(2))


def sweep_ratio(model: ModalModel, rate: float, resonance: int = 1, limits: tuple[float, float] = PAPER_LIMITS) -> float:
    """Return the level of the sweeps without absorber (the larger of up and down) over `stationary_level`; 0 for an undamped resonance.

    ``rate`` in % of the resonance per 100 pseudo periods, ``limits`` over omega_r. Raises ParameterError for numbers out of range.
    """
    stationary = stationary_level(model, resonance, limits)
    levels = []
    for start, stop in (limits, limits[::-1]):
        level = simulate(Scene(model), Drive(1.0, linear_sweep(model.resonance_omega(resonance), start, stop, rate))).level
        assert level is not None
        levels.append(level.value)
    return max(levels) / stationary
