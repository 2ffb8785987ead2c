"""The largest Lyapunov exponent of a motion: how fast two runs that begin next to each other part, by the saltation derivative of the exact motion.

A tangent vector is carried along by the derivative of a few periods at a time and made a unit vector again (Benettin et al., Meccanica 15, 1980; with
impacts Mueller, Chaos, Solitons & Fractals 5, 1995). Positive: chaotic; negative: periodic; zero: between, as on a torus.
"""

from dataclasses import dataclass

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.parameters import count, require
from impact_env.periodic.case import case_of
from impact_env.periodic.passage import passage
from impact_env.periodic.shooting import units_of
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
STRETCH = 4  # periods of the force in which a tangent vector is followed without being made a unit vector
SETTLING = 20  # stretches in which it turns into the fastest direction, which are left out
BLOCKS = 20  # whose means are taken as independent
LEVEL = 0.95


@dataclass(frozen=True)
class Exponent:
    """The largest exponent per period of the force, with its 95 % interval by Student's distribution over the means of blocks."""

    value: float
    low: float
    high: float

    @property
    def chaotic(self) -> bool:
        """Whether the interval lies above zero."""
        return self.low > 0


def largest_exponent(scene: Scene, settled: Drive, periods: int) -> Exponent:
    """Return the largest exponent over ``periods`` of the force after the run ``settled``, at the frequency that it ended with.

    Raises ParameterError for fewer than a stretch a block, or a scene without one impact absorber; PassageError where a motion has no derivative.
    """
    count("periods", periods, STRETCH * BLOCKS)
    schedule = settled.schedule
    case = case_of(scene, settled.amplitude, float(schedule.omegas[-1]))
    state = simulate(scene, settled, record=Record(events=True)).end_state
    phase, unit = settled.phase + float(schedule.phase_at(float(schedule.times[-1]))), units_of(case)
    vector = np.random.default_rng(0).normal(size=len(unit))
    growth = []
    for _ in range(SETTLING + periods // STRETCH):
        found = passage(case, phase, state, STRETCH * case.period)
        vector = (found.derivative @ (unit * vector)) / unit
        size = float(np.linalg.norm(vector))
        require(size > 0, "tangent vector", vector, "one that friction does not take away altogether")
        growth.append(np.log(size))
        vector, state = vector / size, found.end
    return exponent_of(np.array(growth[SETTLING:]) / STRETCH)


def exponent_of(growth: Array) -> Exponent:
    """Return the exponent of growths (S,) per period, one for each stretch."""
    means = np.array([np.mean(block) for block in np.array_split(growth, BLOCKS)])
    value, width = float(np.mean(growth)), float(np.std(means, ddof=1) / np.sqrt(BLOCKS) * scipy.stats.t.ppf((1 + LEVEL) / 2, BLOCKS - 1))
    return Exponent(value, value - width, value + width)
