"""Scenes with parameters drawn from the posterior of a calibration.

The band of their levels over the frequency is computed as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from impact_env.ensemble import Executor, Lane
from impact_env.scene import Scene
from optimisation.calibration.parameters import scene_with
from optimisation.calibration.posterior import INTERVAL, Posterior
from optimisation.frequency_levels import frequency_curve

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LevelBand:
    """Quantiles of the level over the frequency of scenes with drawn parameters.

    ``quantiles``: 5, 50 and 95 % in m, (3, n). ``ratio``: frequencies over the resonance's, (n,).
    """

    ratio: Array
    quantiles: Array


def draw_scenes(
    scene: Scene, posterior: Posterior, count: int, seed: int, resonance: int
) -> list[Scene]:
    """Return scenes with parameters drawn from a posterior.

    A draw is used again only after all draws have been used.

    Parameters
    ----------
    scene : Scene
        Structure and impact absorber; it has all values that the posterior lacks.
    posterior : Posterior
        Posterior of a calibration.
    count : int
        Number of scenes.
    seed : int
        Seed of the draws.
    resonance : int
        Resonance to which frequency and damping of the posterior belong, from 1.

    Raises
    ------
    ParameterError
        For an absorber that lacks the parameters.
    """
    generator = np.random.default_rng([seed, 6])
    total = len(posterior.draws)
    rows = np.concatenate([generator.permutation(total) for _ in range(-(-count // total))])
    scenes = []
    for row in posterior.draws[rows[:count]].tolist():
        chosen = dict(zip(posterior.names, row, strict=True))
        try:
            scenes.append(scene_with(scene, chosen, resonance))
        except ParameterError as error:
            raise ParameterError(f"posterior of {', '.join(posterior.names)}: {error}") from error
    return scenes


def band_of_levels(
    lanes: Sequence[Lane], limits: tuple[float, float], executor: Executor | None = None
) -> LevelBand | None:
    """Return the band of levels over the frequency of sweeps, or None.

    The result is None if the motion is too long to be recorded.

    ``limits``: frequencies over the resonance's. Raises KeyboardInterrupt if it is stopped.
    """
    curves = []
    for lane in lanes:
        curve = frequency_curve("draw", [lane], limits, executor)
        if curve is None:
            return None
        curves.append(curve)
    levels = np.array([curve.level for curve in curves])
    everywhere = np.all(np.isfinite(levels), axis=0)
    quantiles = np.quantile(levels[:, everywhere], INTERVAL, axis=0)
    return LevelBand(curves[0].ratio[everywhere], np.asarray(quantiles))
