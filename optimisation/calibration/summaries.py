"""Summary statistics of a measured or simulated response that are robust to chaos.

They are logarithms of levels in bins and bands.

Two runs that differ by a millionth in their start are different functions of time after some
impacts, so that time series cannot be fitted. Their levels in bins of a tenth of a sweep differ by
a few percent only. All statistics are logarithms: a wrong scale of a sensor is an offset, and noise
of a share of the level is the same at every level.
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
USABLE_SHARE = 1 / 2.56  # of the sampling rate: frequencies above are in the filter's slope
LOWEST_SHARE = 0.2  # of the first natural frequency: what is below is drift
FLOOR = 1e-6  # of a record's root mean square: levels below it are zero
PULSE_LEVELS = 4.0  # medians of the absolute value that a pulse rises above
RESONANT = "resonant RMS"
HIGHER = "RMS above the resonance"
PEAK = "largest value"
PULSES = "pulses a period"
BAND = "RMS in the band of a mode"
LEVEL = "response level"


@dataclass(frozen=True)
class Statistic:
    """A summary statistic: the logarithm of a quantity of a ``group``.

    ``at``: its frequency in Hz (NaN: none) or its force in N.
    """

    measurement: str
    group: str
    at: float
    at_unit: str
    unit: str

    @property
    def words(self) -> str:
        """The statistic in words."""
        place = "" if np.isnan(self.at) else f" at {self.at:.4g} {self.at_unit}"
        return f"{self.group}{place}, {self.measurement}"


@dataclass(frozen=True, eq=False)
class RecordSummary:
    """Computation of the summary statistics of a record.

    Attributes
    ----------
    measurement : RecordMeasurement
        The record.
    edges : array of int, (B + 1,)
        Samples at which the bins begin and end.
    bin_hz : array, (B,)
        Frequency of each bin in Hz.
    resonant, higher : array of bool
        Lines of the spectrum near the resonance, and above it.
    bands : tuple of (float, array of bool)
        Frequency of each mode in Hz and its lines of the spectrum.
    period : float
        Pseudo period in s.
    statistics : tuple of Statistic
        Names of the statistics.
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
        """Return the statistics (D,) of a response (K,)."""
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
        return np.array([function(values[a:b]) for a, b in pairwise(self.edges)])


def root_mean_square(values: Array) -> float:
    """Return the root mean square of a signal about zero."""
    return float(np.sqrt(np.mean(values**2)))


def largest_absolute(values: Array) -> float:
    """Return the largest absolute value."""
    return float(np.max(np.abs(values)))


def _count_pulses(values: Array) -> float:
    """Return how often the absolute value rises above `PULSE_LEVELS` times its median."""
    size = np.abs(values)
    above = size > PULSE_LEVELS * np.median(size)
    return float(np.sum(above[1:] & ~above[:-1]))


def plan_record_summary(
    measurement: RecordMeasurement, model: ModalModel, resonance: int
) -> RecordSummary:
    """Return how the statistics of a record are computed.

    This depends on the structure and on the resonance near which it vibrates.
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
    """Return the statistics (F,) of levels (F, R).

    They are the means over the repeats of the logarithms of the levels.
    """
    return np.asarray(np.mean(np.log(levels), axis=1))


def list_groups(statistics: Sequence[Statistic]) -> tuple[tuple[str, str], ...]:
    """Return measurement and group of each kind of statistic, once, in their order."""
    return tuple(dict.fromkeys((one.measurement, one.group) for one in statistics))
