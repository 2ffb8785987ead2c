"""Summary statistics of a measured or simulated response that are robust to chaos.

Most of them are logarithms of levels in bins of time and in bands of frequency.

Two runs whose initial states differ by a millionth are different functions of time after some
impacts, so that time series cannot be fitted. Their levels in bins of a tenth of a sweep differ by
a few percent only. Because of the logarithms a wrong scale of a sensor is a constant offset, and
noise in proportion to the level has the same variance at every level.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.modes import ModalModel
from optimisation.calibration.measurement import (
    ACCELERATION,
    RESPONSE_UNITS,
    RecordMeasurement,
)

Array = NDArray[np.float64]
MOST_BINS = 12  # of a record
LEAST_BINS = 3
BIN_PERIODS = 20.0  # of the resonance, in a bin or more
USABLE_SHARE = 1 / 2.56  # of the sampling rate: the anti-aliasing filter damps frequencies above
LOWEST_SHARE = 0.2  # of the first natural frequency: lower frequencies are drift of the sensor
FLOOR = 1e-6  # of a record's root mean square: added to levels, so that their logarithm is finite
PULSE_LEVELS = 4.0  # threshold of a pulse over the median of the absolute value
RESONANT = "resonant RMS"
HIGHER = "RMS above the resonance"
PEAK = "largest value"
PULSES = "pulses a period"
BAND = "RMS in the band of a mode"
LEVEL = "response level"


@dataclass(frozen=True)
class Statistic:
    """Name of a summary statistic, the natural logarithm of a quantity of a ``measurement``.

    ``group`` is the quantity, such as `RESONANT`, and ``unit`` its unit. ``at`` is the value in
    ``at_unit`` at which it was measured: a frequency in Hz, or a force in N; NaN: none.
    """

    measurement: str
    group: str
    at: float
    at_unit: str
    unit: str

    @property
    def words(self) -> str:
        """The statistic as a text: quantity, value at which it was measured, and measurement."""
        place = "" if np.isnan(self.at) else f" at {self.at:.4g} {self.at_unit}"
        return f"{self.group}{place}, {self.measurement}"


@dataclass(frozen=True, eq=False)
class RecordSummary:
    """Settings for the summary statistics of a record of K samples, divided into B bins of time.

    Attributes
    ----------
    measurement : RecordMeasurement
        The record.
    edges : array of int, (B + 1,)
        Samples at which the bins begin and end.
    bin_hz : array, (B,)
        Frequency of the load in each bin in Hz.
    resonant, higher : array of bool, (L,)
        Lines of the spectrum below and above the geometric mean of the resonance and the next mode.
    bands : tuple of (float, array of bool (L,))
        Frequency in Hz of each mode, and the lines of the spectrum nearest to it.
    period : float
        Pseudo period in s.
    statistics : tuple of Statistic
        Names of the statistics, (D,).
    """

    measurement: RecordMeasurement
    edges: NDArray[np.int64]
    bin_hz: Array
    resonant: NDArray[np.bool_]
    higher: NDArray[np.bool_]
    bands: tuple[tuple[float, NDArray[np.bool_]], ...]
    period: float
    statistics: tuple[Statistic, ...] = field(default=())

    def compute(self, response: Array) -> Array:
        """Return the statistics (D,) of a response (K,) in the unit of the sensor.

        They are natural logarithms. For each bin they are those of the RMS near the resonance, the
        largest absolute value, the RMS above the resonance, and, for accelerations, 1 + the number
        of pulses in a pseudo period; then follows the RMS in the band of each mode. RMS and pulses
        above the resonance are left out if the record has no such frequencies.
        """
        size = len(response)
        padded = scipy.fft.next_fast_len(size, real=True)  # a prime length takes ten times as long
        spectrum = scipy.fft.rfft(response - np.mean(response), padded)
        resonant = scipy.fft.irfft(np.where(self.resonant, spectrum, 0), padded)[:size]
        has_higher = bool(np.any(self.higher))
        whole = self.resonant | self.higher
        total = scipy.fft.irfft(np.where(whole, spectrum, 0), padded)[:size]
        floor = FLOOR * float(np.sqrt(np.mean(total**2))) + 1e-300
        columns = [
            self._by_bin(root_mean_square, resonant) + floor,
            self._by_bin(largest_absolute, total) + floor,
        ]
        if has_higher:
            higher = scipy.fft.irfft(np.where(self.higher, spectrum, 0), padded)[:size]
            columns.append(self._by_bin(root_mean_square, higher) + floor)
            if self.measurement.sensor.quantity == ACCELERATION:
                seconds = np.diff(self.edges) / self.measurement.rate
                counts = self._by_bin(_count_pulses, higher)
                columns.append(1.0 + counts * self.period / seconds)
        energies = [float(np.sum(np.abs(spectrum[band]) ** 2)) for _, band in self.bands]
        levels = np.sqrt(2 * np.array(energies)) / size + floor
        return np.log(np.concatenate([*columns, levels]))

    def _by_bin(self, function: Callable[[Array], float], values: Array) -> Array:
        """Return a function of the values in each bin, (B,)."""
        return np.array([function(values[a:b]) for a, b in pairwise(self.edges)])


def root_mean_square(values: Array) -> float:
    """Return the root mean square of a signal, without subtraction of its mean."""
    return float(np.sqrt(np.mean(values**2)))


def largest_absolute(values: Array) -> float:
    """Return the largest absolute value."""
    return float(np.max(np.abs(values)))


def _count_pulses(values: Array) -> float:
    """Return how many times the absolute value rises above `PULSE_LEVELS` times its median."""
    size = np.abs(values)
    above = size > PULSE_LEVELS * np.median(size)
    return float(np.sum(above[1:] & ~above[:-1]))


def plan_record_summary(
    measurement: RecordMeasurement, model: ModalModel, resonance: int
) -> RecordSummary:
    """Return the settings for the statistics of a record: its bins and bands.

    They depend on the frequencies of the structure and on the ``resonance``, counted from 1, near
    which it vibrates.
    """
    size = len(measurement.response)
    rate = measurement.rate
    hertz = scipy.fft.rfftfreq(scipy.fft.next_fast_len(size, real=True), 1 / rate)
    modes = np.sort(model.omega) / (2 * np.pi)
    own = model.resonance_omega(resonance) / (2 * np.pi)
    highest = USABLE_SHARE * rate
    lowest = LOWEST_SHARE * float(modes[0])
    above = modes[modes > own * (1 + 1e-9)]
    split = highest if len(above) == 0 else min(float(np.sqrt(own * above[0])), highest)
    resonant = (hertz >= lowest) & (hertz < split)
    higher = (hertz >= split) & (hertz < highest)
    meeting = np.sqrt(modes[1:] * modes[:-1])
    lows = np.concatenate([[lowest], meeting])
    highs = np.concatenate([meeting, [np.inf]])
    bands = tuple(
        (float(mode), (hertz >= low) & (hertz < min(high, highest)))
        for mode, low, high in zip(modes, lows, highs, strict=True)
        if mode < highest
    )
    periods = (size - 1) / rate * own
    number = int(np.clip(periods / BIN_PERIODS, LEAST_BINS, MOST_BINS))
    edges = np.linspace(0, size, number + 1).round().astype(np.int64)
    bin_hz = []  # half the number of sign changes of the load a second
    for a, b in pairwise(edges):
        values = measurement.load.values[a:b]
        signs = np.signbit(values - np.mean(values))
        changes = float(np.sum(signs[1:] != signs[:-1]))
        bin_hz.append(changes * rate / (2 * max(len(values) - 1, 1)))
    summary = RecordSummary(measurement, edges, np.array(bin_hz), resonant, higher, bands, 1 / own)
    return replace(summary, statistics=_name_statistics(summary))


def _name_statistics(summary: RecordSummary) -> tuple[Statistic, ...]:
    """Return the names of the statistics, in the order of `RecordSummary.compute`."""
    measurement = summary.measurement
    unit = RESPONSE_UNITS[measurement.sensor.quantity]
    groups = [(RESONANT, unit), (PEAK, unit)]
    if bool(np.any(summary.higher)):
        groups.append((HIGHER, unit))
        if measurement.sensor.quantity == ACCELERATION:
            groups.append((PULSES, ""))
    name = measurement.name
    by_bin = [
        Statistic(name, group, float(hertz), "Hz", own)
        for group, own in groups
        for hertz in summary.bin_hz
    ]
    by_band = [Statistic(name, BAND, mode, "Hz", unit) for mode, _ in summary.bands]
    return (*by_bin, *by_band)


def summarise_levels(levels: Array) -> Array:
    """Return the statistics (F,) of levels (F, R) in m, measured R times at F forces.

    They are the mean natural logarithms over the R repeats.
    """
    return np.asarray(np.mean(np.log(levels), axis=1))


def list_groups(statistics: Sequence[Statistic]) -> tuple[tuple[str, str], ...]:
    """Return all pairs (measurement, group) of the statistics, each once, in their order."""
    return tuple(dict.fromkeys((one.measurement, one.group) for one in statistics))
