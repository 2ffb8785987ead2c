"""Instantaneous phase lag between tip and absorber by the Hilbert transform.

See section 3.2 of the paper.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.results import History

Array = NDArray[np.float64]


def phase_lag(history: History, wrapped: bool = True) -> Array:
    """Return the angle (S,) in rad by which the absorber's displacement lags behind the tip's.

    It is given at the samples of a run and positive if the absorber is later. Each displacement,
    less its mean, is completed to its analytic signal; the lag is the difference of both angles.
    ``wrapped`` keeps it in (-pi, pi]; otherwise it is unwrapped to a continuous function of time,
    which shows slips of whole turns. The transform assumes a periodic record, so about one period
    at either end is distorted. The angle is only meaningful while both motions oscillate, not for
    an absorber that drifts between rare impacts.

    Raises ParameterError if tip or absorber do not move at all.
    """
    tip = analytic_signal("tip_displacement", history.tip_displacement)
    absorber = analytic_signal("absorber_displacement", history.absorber_displacement)
    lag = np.angle(tip * np.conj(absorber))
    if not wrapped:
        return np.asarray(np.unwrap(lag))
    return np.asarray(np.where(lag <= -np.pi, np.pi, lag))


def analytic_signal(name: str, values: Array) -> NDArray[np.complex128]:
    """Return the analytic signal (S,) of equidistant samples (S,) less their mean.

    Raises ParameterError with the signal's ``name`` if the samples are constant.
    """
    moves = len(values) >= 2 and bool(np.all(np.isfinite(values))) and float(np.ptp(values)) > 0
    require(
        moves, name, f"{len(values)} samples", "two or more finite samples of something that moves"
    )
    return np.asarray(scipy.signal.hilbert(values - np.mean(values)))
