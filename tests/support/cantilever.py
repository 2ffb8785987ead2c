"""A uniform clamped-free beam in closed form: no finite elements."""

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

Array = NDArray[np.float64]


def roots(modes: int) -> Array:
    """Return the wave numbers times the length, solutions of cos x = -1/cosh x."""
    middle = (np.arange(modes) + 0.5) * np.pi
    return np.array(
        [
            scipy.optimize.brentq(
                lambda x: np.cos(x) + 1 / np.cosh(x), m - 1.0, m + 1.0, xtol=1e-15, rtol=1e-15
            )
            for m in middle
        ]
    )


def shapes(modes: int, at: float) -> Array:
    """Return the deflections at a share of the length, for a mass of 1 kg.

    They are positive at the tip, and free of the cancellation of hyperbolic functions.
    """
    x = roots(modes)
    denominator = np.sinh(x) + np.sin(x)
    sigma = (np.cosh(x) + np.cos(x)) / denominator
    rest = (np.sin(x) - np.cos(x) - np.exp(-x)) / denominator
    shape = (
        rest * np.exp(x * at) / 2
        + (1 + sigma) * np.exp(-x * at) / 2
        - np.cos(x * at)
        + sigma * np.sin(x * at)
    )
    return np.asarray(shape * (-1.0) ** np.arange(modes))
