"""Choice of the forces to measure next in a calibration.

The plan gives the expected width of the posterior after one more sweep at each force, and after
several.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, positive, require
from impact_env.loads import Samples
from impact_env.modes import Structure
from impact_env.scene import Scene
from optimisation.calibration.inference import Progress
from optimisation.calibration.likelihood import fit_regression_statistics
from optimisation.calibration.measurement import (
    LevelMeasurement,
    Measurement,
    RecordMeasurement,
)
from optimisation.calibration.posterior import Posterior
from optimisation.calibration.simulation import Simulator

Array = NDArray[np.float64]
FACTORS = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)  # of the load that was measured
PLAN_RUNS = 128  # simulated sweeps at each force
MOST_NEXT = 3  # further sweeps that are recommended


@dataclass(frozen=True, eq=False)
class MeasurementPlan:
    """Expected standard deviations of the parameters after more sweeps.

    Attributes
    ----------
    names : tuple of str
        Parameters, (P,).
    factors : array, (F,)
        Factors of the measured load.
    expected : array, (F, P)
        Expected deviations after one more sweep at each factor.
    now : array, (P,)
        Deviations now.
    order : array, (S,)
        Indices of the factors to measure at next, in this order: each is the best after those
        before it.
    together : array, (S, P)
        Expected deviations after the first sweep of ``order``, after the first two, and so on.

    """

    names: tuple[str, ...]
    factors: Array
    expected: Array
    now: Array
    order: NDArray[np.int64]
    together: Array

    @property
    def ratios(self) -> Array:
        """Expected deviations over those now, (F, P)."""
        return np.asarray(self.expected / self.now)

    @property
    def next_factors(self) -> Array:
        """Factors of the load to measure at next, (S,), in this order."""
        return np.asarray(self.factors[self.order])


def scale_load(measurement: Measurement, factor: float) -> Measurement:
    """Return a measurement with a load multiplied by a factor; its response is unchanged."""
    if isinstance(measurement, RecordMeasurement):
        load = measurement.load
        return replace(measurement, load=Samples(load.times, factor * load.values, load.quantity))
    if isinstance(measurement, LevelMeasurement):
        return replace(measurement, forces=factor * measurement.forces)
    raise ParameterError(
        f"measurement {measurement.name} is not allowed: a record or levels, whose load can "
        "be larger"
    )


def plan_measurement(
    structure: Structure,
    scene: Scene,
    measurement: Measurement,
    posterior: Posterior,
    resonance: int,
    *,
    factors: Sequence[float] = FACTORS,
    runs: int = PLAN_RUNS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> MeasurementPlan:
    """Return the expected width of the posterior after further sweeps, and their forces.

    The width is given for one more sweep at each force. The plan also names the forces to measure
    at next.

    Parameters are drawn from the posterior (or the prior), the sweep is simulated with each, and
    the parameters are predicted from its statistics by the regression of
    `fit_regression_statistics`. Its error on what it was not fitted to is the expected deviation of
    the parameters, up to what a linear regression misses. The same parameters are simulated at all
    forces, so that the statistics of several sweeps together say what these sweeps would give. The
    next force is the one with the least product of expected deviations, together with those chosen
    before it.

    Parameters
    ----------
    structure, scene, measurement, resonance
        As of a calibration; the sweep has the measurement's load times a factor, and its sensor.
    posterior : Posterior
        What is known of the parameters now.
    factors : sequence of float
        Factors of the load, (F,).
    runs : int
        Simulated sweeps at each force.
    seed, threads, progress
        As of a calibration.

    Returns
    -------
    MeasurementPlan
    """
    sizes = np.array([positive("factors", one) for one in factors])
    require(len(sizes) > 0, "factors", factors, "one or more")
    generator = np.random.default_rng([seed, 5])
    rows = posterior.draws[generator.permutation(len(posterior.draws))[:runs]]
    deviation = np.std(rows, axis=0)
    require(bool(np.all(deviation > 0)), "posterior", deviation.tolist(), "draws that differ")
    sweeps = []
    for k, factor in enumerate(sizes):
        show = None
        if progress is not None:
            show = _shift_progress(progress, k * len(rows), len(sizes) * len(rows))
        simulator = Simulator(
            structure, scene, [scale_load(measurement, float(factor))], resonance, threads
        )
        sweeps.append(simulator.simulate(posterior.names, rows, seed + k, show))
    shares = rows / deviation
    expected = np.array([expect_deviations(shares, [sweep]) for sweep in sweeps])
    order, together = order_sweeps(shares, sweeps, MOST_NEXT)
    return MeasurementPlan(
        posterior.names, sizes, deviation * expected, deviation, order, deviation * together
    )


def expect_deviations(parameters: Array, sweeps: Sequence[Array]) -> Array:
    """Return the expected deviations (P,) of ``parameters`` (N, P) after further sweeps.

    The parameters have deviation 1 before the sweeps, so the results are at most 1. Each of
    ``sweeps`` has statistics (N, D).
    """
    statistics = np.concatenate(sweeps, axis=1)
    fine = np.all(np.isfinite(statistics), axis=1)
    own = parameters[fine]
    _, predicted = fit_regression_statistics(own, statistics[fine])
    return np.minimum(np.sqrt(np.mean((own - predicted) ** 2, axis=0)), 1.0)


def order_sweeps(
    parameters: Array, sweeps: Sequence[Array], most: int
) -> tuple[NDArray[np.int64], Array]:
    """Return the sweeps to make next, (S,), and the deviations (S, P) expected after each.

    The deviations after a sweep are those expected from it together with the sweeps before it.

    Each is the one with the least product of deviations, together with those chosen before it;
    ``sweeps`` are statistics (N, D) of each force, and ``most`` the number of further sweeps.
    """
    order: list[int] = []
    together = []
    while len(order) < min(most, len(sweeps)):
        left = [k for k in range(len(sweeps)) if k not in order]
        chosen = [sweeps[k] for k in order]
        expected = [expect_deviations(parameters, [*chosen, sweeps[k]]) for k in left]
        best = int(np.argmin([np.sum(np.log(one)) for one in expected]))
        order.append(left[best])
        together.append(expected[best])
    return np.array(order), np.array(together)


def _shift_progress(progress: Progress, before: int, total: int) -> Progress:
    """Return a progress function of a sweep that reports all sweeps, ``before`` runs done."""
    return lambda done, _all: progress(min(before + done, total), total)
