"""Checks of measurements before anything is simulated at length: each mistake is one line."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import ParameterError, require
from impact_env.drive import Drive, FrequencySchedule
from impact_env.loads import Samples
from impact_env.modes import ModalModel, Structure, mode_shapes
from impact_env.results import Record, require_recorded
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.calibration.linear_fit import excited_band, require_excited
from optimisation.calibration.measurement import (
    MOVING,
    RESPONSE_UNITS,
    DecayMeasurement,
    LevelMeasurement,
    Measurement,
    RecordMeasurement,
)
from optimisation.calibration.simulation import loads_on_clock, model_at_sensor, read_sensor
from optimisation.calibration.summaries import LOWEST_SHARE, USABLE_SHARE

Array = NDArray[np.float64]
NODE_SHARE = 0.02  # of a mode's largest deflection: a place with less is at its node
LEAST_RATIO = 1 / 50  # of a response's root mean square over that of the structure alone
MOST_RATIO = 20.0
SPECTRUM_BANDS = 30
LEAST_PERIODS = 10.0  # of the resonance, that a sweep to a level lasts
LEAST_GAP = 1 / 500  # of the largest motion of the structure alone at the absorber
MOST_GAP = 20.0
# correlation of measured and predicted response over load, below which the two records are
# exchanged
EXCHANGED = -0.4


def require_plausible(
    measurements: Sequence[Measurement], structure: Structure, resonance: int
) -> None:
    """Raise ParameterError for a measurement that does not fit the structure.

    Examples are a sensor or force at a node, load and response that are exchanged, and wrong units.
    The response is compared with that of the structure without absorber under the measured load: an
    absorber changes it by a factor of some tens at most, and its spectrum is similar.
    """
    for one in measurements:
        model = model_at_sensor(structure, one.sensor)
        require_moving_places(one, model, resonance)
        if isinstance(one, RecordMeasurement):
            require_rate(one, model, resonance)
            require_plausible_record(one, model, resonance)
        elif isinstance(one, LevelMeasurement):
            require_plausible_levels(one, model, resonance)


def require_moving_places(measurement: Measurement, model: ModalModel, resonance: int) -> None:
    """Raise ParameterError for a sensor, force or absorber at a node of the resonance's mode."""
    mode = model.check_resonance(resonance) - 1
    places = {"response": model.level_shape, "absorber": model.tip_shape}
    moves_base = isinstance(measurement, RecordMeasurement) and (
        measurement.load.quantity != "force"
    )
    if not isinstance(measurement, DecayMeasurement) and not moves_base:
        places["load"] = model.one_phase_force_shape
    largest = max(abs(float(shape[mode])) for shape in places.values())
    if model.beam is not None:
        along = mode_shapes(model.beam, np.linspace(0, 1, 101))[:, mode]
        largest = max(largest, float(np.max(np.abs(along))))
    for name, shape in places.items():
        share = abs(float(shape[mode])) / largest
        require(
            share >= NODE_SHARE,
            f"measurement {measurement.name}: {name}",
            f"{100 * share:.2g} % of the largest deflection of mode {resonance}",
            f"a place with {100 * NODE_SHARE:g} % or more: it is at a node",
        )


def require_rate(measurement: RecordMeasurement, model: ModalModel, resonance: int) -> None:
    """Raise ParameterError if a record has too few samples for the resonance."""
    own = model.resonance_omega(resonance) / (2 * np.pi)
    require(
        own < USABLE_SHARE * measurement.rate / 2,
        f"measurement {measurement.name}: sampling rate",
        f"{measurement.rate:.4g} Hz",
        f"{2 * own / USABLE_SHARE:.4g} Hz or more, for resonance {resonance} at {own:.4g} Hz",
    )


def require_plausible_record(
    measurement: RecordMeasurement, model: ModalModel, resonance: int
) -> None:
    """Raise ParameterError if a record does not fit the structure alone.

    The error is raised if load and response are exchanged, or if the response is far from that of
    the structure without absorber.
    """
    name = f"measurement {measurement.name}"
    own = model.resonance_omega(resonance) / (2 * np.pi)
    band = excited_band(measurement.load.values, measurement.rate)
    require_excited(measurement.name, band, own, resonance)
    agreement, ratio = compare_with_linear(measurement, model, resonance)
    far = not LEAST_RATIO <= ratio <= MOST_RATIO
    if agreement < EXCHANGED or (far and fits_exchanged(measurement, model, resonance, agreement)):
        raise ParameterError(
            f"{name}: response over load = correlation {agreement:.2f} with the structure's "
            "frequency response and "
            f"{ratio:.3g} times its size is not allowed: a correlation above 0 and 0.02 to 20 "
            "times; load and response may be exchanged, "
            "or the times have another unit"
        )
    unit = RESPONSE_UNITS[measurement.sensor.quantity]
    require_ratio(name, ratio, f"units of load and response ({unit} after conversion)")


def compare_with_linear(
    measurement: RecordMeasurement, model: ModalModel, resonance: int
) -> tuple[float, float]:
    """Return correlation and ratio of a record's response and that of the structure alone.

    The correlation is that of `compare_responses`. The ratio is the root mean square of the
    measured response over that of the structure alone, both in the usable band. The structure's
    response is that at the record's sensor under the record's load, without noise.
    """
    loads, samples = loads_on_clock(measurement, model.resonance_omega(resonance))
    record = Record(level=False, series=True, samples_per_period=samples)
    predicted = read_sensor(simulate(Scene(model), loads, record=record), measurement)
    lowest = LOWEST_SHARE * float(np.min(model.omega)) / (2 * np.pi)
    root_mean_squares = []
    for values in (measurement.response, predicted):
        spectrum = np.abs(scipy.fft.rfft(values - np.mean(values)))
        hertz = scipy.fft.rfftfreq(len(values), 1 / measurement.rate)
        inside = (hertz >= lowest) & (hertz < USABLE_SHARE * measurement.rate)
        square = 2 * np.sum(spectrum[inside] ** 2)
        root_mean_squares.append(float(np.sqrt(square) / len(values)))
    own, alone = root_mean_squares
    return compare_responses(measurement, predicted), own / max(alone, 1e-300)


def fits_exchanged(
    measurement: RecordMeasurement, model: ModalModel, resonance: int, agreement: float
) -> bool:
    """Return whether load and response fit the structure better if they are exchanged.

    They must fit the structure, and better than the ``agreement`` of the given order.
    """
    load = measurement.load
    other = replace(
        measurement,
        load=Samples(load.times, measurement.response, load.quantity),
        response=load.values,
    )
    exchanged, ratio = compare_with_linear(other, model, resonance)
    return exchanged > max(agreement, 0.0) and LEAST_RATIO <= ratio <= MOST_RATIO


def require_ratio(name: str, ratio: float, what: str) -> None:
    """Raise ParameterError if a response is far larger or smaller than that of the structure.

    The structure is taken without absorber.
    """
    require(
        LEAST_RATIO <= ratio <= MOST_RATIO,
        f"{name}: response",
        f"{ratio:.3g} times that of the structure without absorber",
        f"{LEAST_RATIO:g} to {MOST_RATIO:g} times: check {what}, scale and structure",
    )


def require_plausible_levels(
    measurement: LevelMeasurement, model: ModalModel, resonance: int
) -> None:
    """Raise ParameterError for implausible sweeps or levels.

    The sweeps must excite the resonance and last enough of its periods. The levels must not be far
    from those of the structure alone.
    """
    name = f"measurement {measurement.name}"
    own = model.resonance_omega(resonance) / (2 * np.pi)
    ends = sorted((measurement.start_hz, measurement.stop_hz))
    require_excited(measurement.name, (ends[0], ends[1]), own, resonance)
    require(
        measurement.duration * own >= LEAST_PERIODS,
        f"{name}: duration_s",
        measurement.duration,
        f"{LEAST_PERIODS / own:.4g} or more, {LEAST_PERIODS:g} periods of resonance {resonance}",
    )
    omegas = 2 * np.pi * np.array([measurement.start_hz, measurement.stop_hz])
    schedule = FrequencySchedule(
        np.array([0.0, measurement.duration]), omegas, model.resonance_omega(resonance)
    )
    response = simulate(Scene(model), Drive(1.0, schedule))
    unit_level = require_recorded("level", response.level).value
    ratios = np.mean(measurement.levels, axis=1) / (measurement.forces * unit_level)
    for ratio in (float(np.min(ratios)), float(np.max(ratios))):
        require_ratio(name, ratio, "units of forces (N) and levels (m)")


def require_reachable_gap(
    measurements: Sequence[Measurement], scene: Scene, gap: float, resonance: int
) -> None:
    """Raise ParameterError for a gap (m) that does not match the structure's motion.

    The gap must not be far larger or smaller than the motion of the structure alone at the
    absorber. Such a gap is probably in another unit: the absorber would never reach a wall, or
    would stick to the structure.
    """
    model = scene.model
    largest = 0.0
    for one in measurements:
        if isinstance(one, DecayMeasurement) or one.absorber != MOVING:
            continue
        if isinstance(one, LevelMeasurement):
            largest = max(largest, float(np.max(one.levels)))
            continue
        loads, samples = loads_on_clock(one, model.resonance_omega(resonance))
        record = Record(level=False, series=True, samples_per_period=samples)
        history = require_recorded("history", simulate(Scene(model), loads, record=record).history)
        largest = max(largest, float(np.max(np.abs(history.modal_displacement @ model.tip_shape))))
    require(
        LEAST_GAP * largest <= gap <= MOST_GAP * largest,
        "gap",
        f"{gap:.4g} m",
        (
            f"{LEAST_GAP * largest:.3g} to {MOST_GAP * largest:.3g} m: the structure without "
            f"absorber moves by {largest:.3g} m there"
        ),
    )


def compare_responses(measurement: RecordMeasurement, predicted: Array) -> float:
    """Return the correlation, -1 to 1, of the logarithms of measured and predicted response.

    Both are divided by the load and compared in the frequency band that the load excites. If load
    and response are exchanged, the measured ratio is the reciprocal of the structure's and the
    correlation is near -1.
    """
    load = measurement.load.values
    low, high = excited_band(load, measurement.rate)
    hertz = scipy.fft.rfftfreq(len(load), 1 / measurement.rate)
    edges = np.linspace(low, high, SPECTRUM_BANDS + 1)

    def band_powers(values: Array) -> Array:
        power = np.abs(scipy.fft.rfft(values - np.mean(values))) ** 2
        parts = [power[(hertz >= a) & (hertz < b)] for a, b in pairwise(edges)]
        return np.array([np.mean(part) for part in parts if len(part) > 0])

    powers = band_powers(load)
    measured = np.log(band_powers(measurement.response) / powers)
    expected = np.log(band_powers(predicted) / powers)
    return float(np.corrcoef(measured, expected)[0, 1])
