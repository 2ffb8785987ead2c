"""Simulated measurements: the model is driven by the measured load.

The initial states, which are not measured, are drawn at random. The sensor's noise is added.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.drive import Drive, FrequencySchedule
from impact_env.ensemble import Lane, each_lane
from impact_env.loads import BASE_QUANTITY, Loads
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import Beam, SlidingAbsorber, StuckAbsorber
from impact_env.results import Record, Response, require_recorded
from impact_env.scene import InitialState, Scene
from impact_env.sweep import IntegrationError, simulate
from optimisation.calibration.measurement import (
    ACCELERATION,
    DISPLACEMENT,
    MOVING,
    STUCK,
    DecayMeasurement,
    LevelMeasurement,
    Measurement,
    RecordMeasurement,
    Sensor,
)
from optimisation.calibration.parameters import require_impact_absorber, scene_with
from optimisation.calibration.summaries import (
    LEVEL,
    RecordSummary,
    Statistic,
    plan_record_summary,
    summarise_levels,
)
from optimisation.mounting import model_with_absorber_at

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
OVERSAMPLING = 2  # samples of the velocity in a sampling interval of an accelerometer
MOST_EVENTS_PER_PERIOD = 400  # of the resonance: a run with more is left out
LEVEL_TOLERANCE = 0.01  # of each level: what model and sensors are trusted to at best
START_SHARE = 0.9  # of the gap: the absorber starts within it, anywhere


def model_at_sensor(structure: Structure, sensor: Sensor) -> ModalModel:
    """Return the modal model whose response is read at a sensor's place.

    Raises ParameterError for a place on a structure that is no beam.
    """
    if sensor.place is None:
        return model_with_absorber_at(structure)
    require(
        isinstance(structure, Beam),
        "measurement.response.place",
        sensor.place,
        "left out where the structure is no beam: its file says where the response is read",
    )
    assert isinstance(structure, Beam)
    return modal_model(replace(structure, response_position=sensor.place))


def absorber_in(measurement: Measurement, absorber: SlidingAbsorber) -> object:
    """Return the absorber during a measurement, None if it was removed."""
    if measurement.absorber == MOVING:
        return absorber
    return StuckAbsorber(absorber.mass_ratio) if measurement.absorber == STUCK else None


@dataclass(frozen=True, eq=False)
class SeededLane(Lane):
    """A lane with the seed of its sensor's noise."""

    seed: int = 0


@dataclass(frozen=True, eq=False)
class ResponseRecorder:
    """Simulated record measurements: the response (K,) at the sensor, with its noise.

    The response is the displacement, velocity or acceleration.
    """

    measurement: RecordMeasurement
    samples: int

    def __call__(self, lane: Lane) -> Array:
        """Return the response (K,) in SI units."""
        measurement = self.measurement
        sensor = measurement.sensor
        record = Record(level=False, series=True, samples_per_period=self.samples)
        response = simulate(lane.scene, lane.drive, initial=lane.start, record=record)
        values = read_sensor(response, measurement)
        if sensor.noise > 0:
            generator = np.random.default_rng(getattr(lane, "seed", 0))
            values = values + sensor.noise * generator.standard_normal(len(values))
        return values if sensor.limit is None else np.clip(values, -sensor.limit, sensor.limit)


def read_sensor(response: Response, measurement: RecordMeasurement) -> Array:
    """Return the signal (K,) of a sensor without noise in a run, in SI units.

    An acceleration is the change of the velocity, impacts included, over a sampling interval
    centred on the sample.
    """
    history = require_recorded("history", response.history)
    shape = response.scene.model.level_shape
    count = len(measurement.response)
    quantity = measurement.sensor.quantity
    if quantity == DISPLACEMENT:
        return np.asarray((history.modal_displacement @ shape)[:count])
    velocity = history.modal_velocity @ shape
    if quantity != ACCELERATION:
        return np.asarray(velocity[:count])
    interval = float(measurement.load.times[1])
    between = velocity[1::OVERSAMPLING]
    values = np.empty(count)
    values[1:-1] = np.diff(between)[: count - 2] / interval
    values[0] = (between[0] - velocity[0]) / (interval / 2)
    values[-1] = (velocity[OVERSAMPLING * (count - 1)] - between[count - 2]) / (interval / 2)
    if not measurement.sensor.relative:
        values = values + response.scene.model.base_at_absorber * measurement.load.values
    return values


@dataclass(frozen=True, eq=False)
class LevelRecorder:
    """Simulated level measurements: the response level in m with a random error.

    The error is a ``share`` of the level.
    """

    share: float

    def __call__(self, lane: Lane) -> float:
        """Return the level in m; NaN for a run that used up its budget."""
        response = simulate(lane.scene, lane.drive, initial=lane.start)
        level = require_recorded("level", response.level).value
        generator = np.random.default_rng(getattr(lane, "seed", 0))
        return float(level * np.exp(self.share * generator.standard_normal()))


@dataclass(frozen=True, eq=False)
class SummaryRecorder:
    """Runs lanes of a record measurement to statistics (D,); NaN for a run that fails."""

    recorder: ResponseRecorder
    summary: RecordSummary

    def __call__(self, lane: Lane) -> Array:
        """Return the statistics."""
        try:
            return self.summary.compute(self.recorder(lane))
        except IntegrationError:
            return np.full(len(self.summary.statistics), np.nan)


class MeasurementSimulator:
    """Simulation of one measurement of a scene's structure.

    It gives the observed statistics (D,) and those of ensembles.

    Parameters
    ----------
    measurement : RecordMeasurement or LevelMeasurement
        What was measured.
    model : ModalModel
        Structure with its response at the sensor.
    resonance : int
        Resonance near which the structure moves, from 1.
    """

    def __init__(
        self, measurement: RecordMeasurement | LevelMeasurement, model: ModalModel, resonance: int
    ) -> None:
        self.measurement = measurement
        self.model = model
        self.resonance = resonance
        if isinstance(measurement, LevelMeasurement):
            self.statistics: tuple[Statistic, ...] = tuple(
                Statistic(measurement.name, LEVEL, float(force), "N", "m")
                for force in measurement.forces
            )
            self.observed = summarise_levels(measurement.levels)
            return
        self.summary = plan_record_summary(measurement, model, resonance)
        self.statistics = self.summary.statistics
        self.observed = self.summary.compute(measurement.response)
        self.loads, samples = loads_on_clock(measurement, model.resonance_omega(resonance))
        self.recorder = ResponseRecorder(measurement, samples)

    def scene_of(self, scene: Scene) -> Scene:
        """Return a scene with the response at this measurement's sensor.

        The absorber is in the state that it had during the measurement.
        """
        absorber = require_impact_absorber(scene)
        omega = scene.model.omega
        damping = scene.model.damping_ratio
        # one model for all scenes of a structure: what follows from it alone is then computed once
        own = self.model
        if not (np.array_equal(own.omega, omega) and np.array_equal(own.damping_ratio, damping)):
            own = replace(own, omega=omega, damping_ratio=damping)
            self.model = own
        return Scene(own, absorber_in(self.measurement, absorber))  # type: ignore[arg-type]

    def lanes(self, scenes: Sequence[Scene], seed: int) -> list[SeededLane]:
        """Return the lanes of simulated measurements.

        For a level measurement these are the lanes of all forces and repeats.
        """
        return [
            lane
            for k, scene in enumerate(scenes)
            for lane in self._lanes_of(self.scene_of(scene), np.random.default_rng([seed, k]))
        ]

    def _lanes_of(self, scene: Scene, generator: np.random.Generator) -> list[SeededLane]:
        if isinstance(self.measurement, RecordMeasurement):
            start = random_start(scene, generator)
            number = int(generator.integers(2**62))
            return [SeededLane(scene, self.loads, initial=start, seed=number)]
        return [
            SeededLane(
                scene,
                Drive(float(force), self._schedule(), float(generator.uniform(0, 2 * np.pi))),
                initial=random_start(scene, generator),
                seed=int(generator.integers(2**62)),
            )
            for force in self.measurement.forces
            for _ in range(self.measurement.levels.shape[1])
        ]

    def _schedule(self) -> FrequencySchedule:
        measurement = self.measurement
        assert isinstance(measurement, LevelMeasurement)
        omegas = 2 * np.pi * np.array([measurement.start_hz, measurement.stop_hz])
        reference = self.model.resonance_omega(self.resonance)
        return FrequencySchedule(np.array([0.0, measurement.duration]), omegas, reference)

    def simulate(
        self,
        scenes: Sequence[Scene],
        seed: int,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Array:
        """Return the statistics (N, D) of simulated measurements of scenes.

        The rows of failed runs are NaN.

        Raises KeyboardInterrupt if it is stopped.
        """
        lanes = self.lanes(scenes, seed)
        if isinstance(self.measurement, RecordMeasurement):
            rows = each_lane(
                lanes,
                SummaryRecorder(self.recorder, self.summary),
                threads=threads,
                progress=progress,
            )
            return np.array([require_run(one) for one in rows])
        values = each_lane(
            lanes, LevelRecorder(self.measurement.sensor.noise), threads=threads, progress=progress
        )
        levels = np.array([require_run(one) for one in values])
        shape = (len(scenes), *self.measurement.levels.shape)
        return np.array([summarise_levels(one) for one in levels.reshape(shape)])


def require_run(result: Array | float | None) -> Array | float:
    """Return the result of a lane; raises KeyboardInterrupt where an interrupt came first."""
    if result is None:
        raise KeyboardInterrupt
    return result


def random_start(scene: Scene, generator: np.random.Generator) -> InitialState | None:
    """Return an initial state at rest with the absorber at a random place in its cavity.

    This place is not measured. The result is None without a moving absorber.
    """
    absorber = scene.absorber
    share = float(generator.uniform(-START_SHARE, START_SHARE))
    if not isinstance(absorber, SlidingAbsorber) or absorber.walls is None:
        return None
    return InitialState(absorber_displacement=share * absorber.walls.gap)


def loads_on_clock(measurement: RecordMeasurement, omega: float) -> tuple[Loads, int]:
    """Return the measured load, and the number of samples in a pseudo period.

    With this number a run is sampled at the sampling instants of the record.

    The pseudo period is the whole number of sampling intervals nearest to the resonance's, 4 or
    more.
    """
    interval = float(measurement.load.times[1])
    number = max(4, round(2 * np.pi / omega / interval))
    loads = Loads((measurement.load,), 2 * np.pi / (number * interval))
    finer = OVERSAMPLING if measurement.sensor.quantity == ACCELERATION else 1
    return loads, finer * number


class Simulator:
    """Simulation of all measurements with the moving absorber.

    It gives the statistics (D,) at values of the free parameters.

    Parameters
    ----------
    structure : Beam or ModalModel
        Structure.
    scene : Scene
        Structure and absorber with all values that are not free.
    measurements : sequence
        Records and levels.
    resonance : int
        Resonance near which the structure moves, from 1.
    threads : int, optional
        Threads; the result does not depend on them.
    """

    def __init__(
        self,
        structure: Structure,
        scene: Scene,
        measurements: Sequence[Measurement],
        resonance: int,
        threads: int | None = None,
    ) -> None:
        self.scene = scene
        self.resonance = resonance
        self.threads = threads
        self.parts = [
            MeasurementSimulator(one, model_at_sensor(structure, one.sensor), resonance)
            for one in measurements
            if not isinstance(one, DecayMeasurement) and one.absorber == MOVING
        ]
        self.statistics = tuple(one for part in self.parts for one in part.statistics)
        self.observed = np.concatenate([part.observed for part in self.parts])

    def simulate(
        self,
        names: Sequence[str],
        values: Array,
        seed: int,
        progress: Progress | None = None,
    ) -> Array:
        """Return the statistics (N, D) at values (N, P) of the parameters ``names``.

        The rows of failed runs are NaN.
        """
        scenes = [
            scene_with(self.scene, dict(zip(names, row.tolist(), strict=True)), self.resonance)
            for row in values
        ]
        results = []
        total = len(self.parts) * len(scenes)
        for k, part in enumerate(self.parts):
            show = None if progress is None else partial(_shift, progress, k * len(scenes), total)
            results.append(part.simulate(scenes, seed + k, self.threads, show))
        statistics = np.concatenate(results, axis=1)
        generator = np.random.default_rng([seed, len(self.parts)])
        return statistics + LEVEL_TOLERANCE * generator.standard_normal(statistics.shape)

    @property
    def moves_base(self) -> bool:
        """Whether a measurement was made on a moving base."""
        return any(
            isinstance(part.measurement, RecordMeasurement)
            and part.measurement.load.quantity == BASE_QUANTITY
            for part in self.parts
        )


def _shift(progress: Progress, before: int, total: int, done: int, _all: int) -> None:
    progress(min(before + done, total), total)
