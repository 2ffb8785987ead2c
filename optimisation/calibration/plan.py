"""Which force to measure next: how narrow the posterior is expected to become with one more sweep at each of some forces."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.loads import Samples
from impact_env.modes import Structure
from impact_env.parameters import ParameterError, positive, require
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


@dataclass(frozen=True, eq=False)
class MeasurementPlan:
    """Expected deviations (F, P) of the parameters after one more sweep at each factor (F,) of the measured load, and those now (P,)."""

    names: tuple[str, ...]
    factors: Array
    expected: Array
    now: Array

    @property
    def ratios(self) -> Array:
        """Expected deviations over those now, (F, P)."""
        return np.asarray(self.expected / self.now)

    @property
    def best(self) -> int:
        """Index of the factor with the least product of deviations."""
        return int(np.argmin(np.sum(np.log(self.expected), axis=1)))


def scale_load(measurement: Measurement, factor: float) -> Measurement:
    """Return a measurement with a load that is a factor times as large; its response is that of no run."""
    if isinstance(measurement, RecordMeasurement):
        load = measurement.load
        return replace(measurement, load=Samples(load.times, factor * load.values, load.quantity))
    if isinstance(measurement, LevelMeasurement):
        return replace(measurement, forces=factor * measurement.forces)
    raise ParameterError(
        f"measurement {measurement.name} is not allowed: a record or levels, whose load can be larger"
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
    """Return the expected width of the posterior after one more sweep at each force.

    Parameters are drawn from the posterior (or the prior), the sweep is simulated with each, and the parameters are predicted from
    its statistics by the regression of `fit_regression_statistics`. Its error on what it was not fitted to is the expected
    deviation of the parameters, up to what a linear regression misses.

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
    expected = []
    for k, factor in enumerate(sizes):
        show = None
        if progress is not None:
            show = _shifted(progress, k * len(rows), len(sizes) * len(rows))
        simulator = Simulator(
            structure, scene, [scale_load(measurement, float(factor))], resonance, threads
        )
        statistics = simulator.simulate(posterior.names, rows, seed + k, show)
        fine = np.all(np.isfinite(statistics), axis=1)
        own = rows[fine] / deviation
        _, predicted = fit_regression_statistics(own, statistics[fine])
        expected.append(deviation * np.sqrt(np.mean((own - predicted) ** 2, axis=0)))
    return MeasurementPlan(
        posterior.names, sizes, np.minimum(np.array(expected), deviation), deviation
    )


def _shifted(progress: Progress, before: int, total: int) -> Progress:
    return lambda done, _all: progress(min(before + done, total), total)
