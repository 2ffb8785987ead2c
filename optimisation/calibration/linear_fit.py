"""Natural frequencies and damping of the linear structure from measurements.

The measurements are without the absorber or with a stuck one.

Linear motion is not chaotic, so that the response itself is fitted: least squares of the measured
and the simulated response to the measured load, or of a free decay as a sum of decaying cosines.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.modes import Structure
from impact_env.parameters import SlidingAbsorber
from impact_env.results import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.calibration.measurement import (
    MOVING,
    DecayMeasurement,
    LevelMeasurement,
    Measurement,
    RecordMeasurement,
)
from optimisation.calibration.simulation import (
    absorber_in,
    loads_on_clock,
    model_at_sensor,
    read_sensor,
)
from optimisation.calibration.summaries import LOWEST_SHARE, USABLE_SHARE

Array = NDArray[np.float64]
BAND_SHARE = 0.005  # of a load's mean square, outside either end of the band that it excites
BAND_MARGIN = 1.1  # of that band: modes within it are fitted
FREQUENCY_RANGE = 1.2  # factor by which a frequency may be off
DAMPING_RANGE = 10.0  # factor by which a damping ratio may be off
BLOCK_PERIODS = 20  # of the resonance: residuals of blocks count as independent
USABLE_RESPONSE = 0.01  # of a decay's mean square: modes below it are not fitted
LEAST_EXPLAINED = 0.8  # of the mean square
GAIN_TOL = 0.1  # by which a measured response may differ in scale


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Fitted frequencies in Hz and damping ratios of modes, with standard errors of both.

    Attributes
    ----------
    modes : tuple of int, (M,)
        Numbers of the modes, from 1.
    hertz, damping, hertz_error, damping_error : array, (M,)
        Frequencies in Hz, damping ratios, and standard errors.
    gain : float
        Scale of the measured response over the model's, NaN for decays alone.
    explained : float
        Share of the response's mean square that the fit explains.
    """

    modes: tuple[int, ...]
    hertz: Array
    damping: Array
    hertz_error: Array
    damping_error: Array
    gain: float
    explained: float

    @property
    def warnings(self) -> list[str]:
        """Sentences about an implausible fit."""
        lines = []
        if self.explained < LEAST_EXPLAINED:
            lines.append(
                f"the linear model explains {100 * self.explained:.0f} % of the measurement "
                "without "
                "a moving absorber: the structure, its places or the load may be others"
            )
        if self.gain < 0:
            lines.append(
                "without a moving absorber the measured response is opposite to that of the model: "
                "a sensor that is mounted the other way round has direction = -1"
            )
        elif np.isfinite(self.gain) and abs(np.log(self.gain)) > np.log(1 + GAIN_TOL):
            lines.append(
                f"without a moving absorber the measured response is {self.gain:.3g} times that of "
                "the model: the scale of a sensor, a place or the structure's mass may be wrong"
            )
        return lines

    def apply(self, scene: Scene, resonance: int) -> Scene:
        """Return a scene with the fitted frequencies and damping ratios.

        Modes that were not fitted change as the mode of the resonance does.
        """
        own = self.modes.index(resonance)
        factor = 2 * np.pi * self.hertz[own] / scene.model.omega[resonance - 1]
        omega = scene.model.omega * factor
        damping = scene.model.damping_ratio.copy()
        if damping[resonance - 1] > 0:
            damping *= self.damping[own] / damping[resonance - 1]
        for k, mode in enumerate(self.modes):
            omega[mode - 1] = 2 * np.pi * self.hertz[k]
            damping[mode - 1] = self.damping[k]
        model = replace(scene.model, omega=omega, damping_ratio=damping)
        return Scene(model, scene.absorber)


@dataclass(frozen=True, eq=False)
class RecordResidual:
    """Misfit (K,) of a record: measured minus simulated response in the usable band.

    It is divided by the root mean square of the measured response.
    """

    measurement: RecordMeasurement
    scene: Scene
    mask: NDArray[np.bool_]
    padded: int
    resonance: int

    def filter_response(self, values: Array) -> Array:
        """Return a response (K,) without drift, and without what is above the usable band."""
        spectrum = scipy.fft.rfft(values - np.mean(values), self.padded)
        return np.asarray(scipy.fft.irfft(np.where(self.mask, spectrum, 0), self.padded))[
            : len(values)
        ]

    def predict(self, omega: Array, damping: Array) -> Array:
        """Return the filtered response (K,) of the model.

        ``omega`` (rad/s) and ``damping``: frequencies and damping ratios of all modes.
        """
        model = replace(self.scene.model, omega=omega, damping_ratio=damping)
        loads, samples = loads_on_clock(
            self.measurement, self.scene.model.resonance_omega(self.resonance)
        )
        record = Record(level=False, series=True, samples_per_period=samples)
        response = simulate(Scene(model, self.scene.absorber), loads, record=record)
        return self.filter_response(read_sensor(response, self.measurement))

    def compute(self, omega: Array, damping: Array) -> tuple[Array, float]:
        """Return the residual (K,), and the gain with which it is least."""
        measured = self.filter_response(self.measurement.response)
        predicted = self.predict(omega, damping)
        gain = float(measured @ predicted) / max(float(predicted @ predicted), 1e-300)
        return (measured - gain * predicted) / np.sqrt(np.mean(measured**2)), gain

    @property
    def block(self) -> int:
        """Samples of a block."""
        omega = self.scene.model.resonance_omega(self.resonance)
        return max(int(BLOCK_PERIODS * 2 * np.pi / omega * self.measurement.rate), 1)


@dataclass(frozen=True, eq=False)
class DecayResidual:
    """Misfit of a free decay: measured response minus a sum of decaying cosines.

    It starts at the largest value of the response. The cosines are those of the fitted modes, with
    the best amplitudes.
    """

    values: Array
    rate: float
    modes: tuple[int, ...]
    block: int

    def compute(self, omega: Array, damping: Array) -> tuple[Array, float]:
        """Return the residual (K,); a decay has no gain: NaN."""
        times = np.arange(len(self.values)) / self.rate
        columns = [np.ones(len(times))]
        for mode in self.modes:
            decay = np.exp(-damping[mode - 1] * omega[mode - 1] * times)
            phase = omega[mode - 1] * np.sqrt(1 - damping[mode - 1] ** 2) * times
            columns += [decay * np.cos(phase), decay * np.sin(phase)]
        basis = np.stack(columns, axis=1)
        amplitudes = np.linalg.lstsq(basis, self.values, rcond=None)[0]
        residual = self.values - basis @ amplitudes
        return residual / np.std(self.values), np.nan


def excited_band(values: Array, rate: float) -> tuple[float, float]:
    """Return the frequency band in Hz that a load excites.

    The share `BAND_SHARE` of the load's mean square lies below the band, and the same share above
    it.
    """
    power = np.abs(np.fft.rfft(values - np.mean(values))) ** 2
    share = np.cumsum(power) / np.sum(power)
    hertz = np.fft.rfftfreq(len(values), 1 / rate)
    low = float(hertz[np.searchsorted(share, BAND_SHARE)])
    last = min(int(np.searchsorted(share, 1 - BAND_SHARE)), len(hertz) - 1)
    high = float(hertz[last])
    return low, high


def require_excited(name: str, band: tuple[float, float], hertz: float, resonance: int) -> None:
    """Raise ParameterError for a load that does not excite the resonance.

    ``band`` is the frequency band of the load in Hz, ``hertz`` the frequency of the resonance in
    Hz.
    """
    low, high = band
    require(
        low / BAND_MARGIN <= hertz <= high * BAND_MARGIN,
        f"measurement {name}: load",
        f"{low:.4g} to {high:.4g} Hz",
        f"a load that excites resonance {resonance} at {hertz:.4g} Hz",
    )


def _record_residual(
    measurement: RecordMeasurement, structure: Structure, scene: Scene, resonance: int
) -> tuple[RecordResidual, tuple[int, ...]]:
    """Return the residual of a record, and the modes (from 1) in the band that its load excites."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    own = Scene(
        model_at_sensor(structure, measurement.sensor),
        absorber_in(measurement, absorber),  # type: ignore[arg-type]
    )
    rate = measurement.rate
    hertz = own.model.omega / (2 * np.pi)
    padded = scipy.fft.next_fast_len(len(measurement.response), real=True)
    lines = scipy.fft.rfftfreq(padded, 1 / rate)
    mask = (lines >= LOWEST_SHARE * float(np.min(hertz))) & (lines < USABLE_SHARE * rate)
    low, high = excited_band(measurement.load.values, rate)
    inside = (hertz >= low / BAND_MARGIN) & (hertz <= high * BAND_MARGIN)
    inside &= hertz < USABLE_SHARE * rate
    inside &= np.abs(own.model.level_shape) > 1e-3 * np.max(np.abs(own.model.level_shape))
    require_excited(measurement.name, (low, high), float(hertz[resonance - 1]), resonance)
    modes = tuple(int(k) + 1 for k in np.flatnonzero(inside))
    return RecordResidual(measurement, own, mask, padded, resonance), modes


def _decay_residual(
    measurement: DecayMeasurement, structure: Structure, resonance: int
) -> tuple[DecayResidual, tuple[int, ...], dict[int, float]]:
    """Return the residual of a decay, its modes (from 1) and their frequencies in Hz.

    The frequencies are those of the peaks in the decay's spectrum.
    """
    model = model_at_sensor(structure, measurement.sensor)
    first = int(np.argmax(np.abs(measurement.response)))
    values = measurement.response[first:] - np.mean(measurement.response[first:])
    padded = 4 * len(values)
    power = np.abs(np.fft.rfft(values * np.hanning(2 * len(values))[len(values) :], padded)) ** 2
    hertz = np.fft.rfftfreq(padded, 1 / measurement.rate)
    modes = []
    peaks = {}
    for k, omega in enumerate(model.omega):
        own = float(omega) / (2 * np.pi)
        near = (hertz > own / FREQUENCY_RANGE) & (hertz < own * FREQUENCY_RANGE)
        if own > USABLE_SHARE * measurement.rate or not np.any(near):
            continue
        if k + 1 == resonance or np.sum(power[near]) > USABLE_RESPONSE * np.sum(power):
            modes.append(k + 1)
            peaks[k + 1] = float(hertz[near][np.argmax(power[near])])
    period = 2 * np.pi / model.resonance_omega(resonance)
    block = max(int(BLOCK_PERIODS * period * measurement.rate), 1)
    return DecayResidual(values, measurement.rate, tuple(modes), block), tuple(modes), peaks


def _spectral_peak(residual: RecordResidual, mode: int) -> float:
    """Return the frequency in Hz of the peak of measured response over load near a mode's own."""
    measurement = residual.measurement
    response = np.abs(
        scipy.fft.rfft(residual.filter_response(measurement.response), residual.padded)
    )
    values = measurement.load.values
    load = np.abs(scipy.fft.rfft(values - np.mean(values), residual.padded))
    hertz = scipy.fft.rfftfreq(residual.padded, 1 / measurement.rate)
    own = float(residual.scene.model.omega[mode - 1]) / (2 * np.pi)
    near = (hertz > own / FREQUENCY_RANGE) & (hertz < own * FREQUENCY_RANGE)
    near &= load > 0.1 * np.max(load)
    if not np.any(near):
        return own
    return float(hertz[near][np.argmax(response[near] / load[near])])


def fit_linear(
    structure: Structure, scene: Scene, measurements: Sequence[Measurement], resonance: int
) -> LinearFit | None:
    """Fit frequencies and damping ratios to the measurements without a moving absorber.

    Parameters
    ----------
    structure : Beam or ModalModel
        Structure.
    scene : Scene
        Structure and absorber; a stuck absorber has its mass.
    measurements : sequence
        Records and decays; those with a moving absorber, and levels, are left out.
    resonance : int
        Resonance that must be among the fitted modes, from 1.

    Returns
    -------
    LinearFit or None
        None where there is no such measurement.

    Raises
    ------
    ParameterError
        For a load that does not excite the resonance.

    """
    residuals: list[RecordResidual | DecayResidual] = []
    modes: set[int] = set()
    starts: dict[int, float] = {}
    for one in measurements:
        if one.absorber == MOVING or isinstance(one, LevelMeasurement):
            continue
        if isinstance(one, DecayMeasurement):
            decay, own, peaks = _decay_residual(one, structure, resonance)
            residuals.append(decay)
            starts |= peaks
        else:
            record, own = _record_residual(one, structure, scene, resonance)
            residuals.append(record)
            for mode in own:
                starts.setdefault(mode, _spectral_peak(record, mode))
        modes |= set(own)
    if not residuals:
        return None
    return _fit(residuals, tuple(sorted(modes)), starts, scene)


def _fit(
    residuals: Sequence[RecordResidual | DecayResidual],
    modes: tuple[int, ...],
    starts: dict[int, float],
    scene: Scene,
) -> LinearFit:
    which = np.array(modes) - 1
    nominal = np.concatenate([scene.model.omega[which], scene.model.damping_ratio[which]])
    count = len(which)

    def arrays(x: Array) -> tuple[Array, Array]:
        omega = scene.model.omega.copy()
        damping = scene.model.damping_ratio.copy()
        omega[which] = nominal[:count] * np.exp(x[:count])
        damping[which] = nominal[count:] * np.exp(x[count:])
        return omega, damping

    def misfit(x: Array) -> Array:
        return np.concatenate([one.compute(*arrays(x))[0] for one in residuals])

    widths = np.repeat([np.log(FREQUENCY_RANGE), np.log(DAMPING_RANGE)], count)
    start = np.zeros(2 * count)
    start[:count] = [
        np.log(2 * np.pi * starts[mode] / scene.model.omega[mode - 1]) for mode in modes
    ]
    start = np.clip(start, -0.99 * widths, 0.99 * widths)
    scale = np.repeat([1e-3, 0.1], count)
    solved = scipy.optimize.least_squares(
        misfit, start, bounds=(-widths, widths), x_scale=scale, diff_step=1e-5, xtol=1e-6, ftol=1e-8
    )
    omega, damping = arrays(solved.x)
    gains = [one.compute(omega, damping)[1] for one in residuals]
    finite = [gain for gain in gains if np.isfinite(gain)]
    error = _standard_errors(solved.jac, solved.fun, residuals)
    explained = 1 - float(np.mean(solved.fun**2))
    return LinearFit(
        modes,
        omega[which] / (2 * np.pi),
        damping[which],
        omega[which] / (2 * np.pi) * error[:count],
        damping[which] * error[count:],
        float(np.mean(finite)) if finite else float("nan"),
        explained,
    )


def _standard_errors(
    jacobian: Array, residual: Array, residuals: Sequence[RecordResidual | DecayResidual]
) -> Array:
    """Return the standard errors of the fitted logarithms.

    They are the larger of those for independent residuals, and of those for residuals with any
    dependence within a block.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    scores = np.zeros_like(inverse)
    begin = 0
    for one in residuals:
        length = len(one.measurement.response if isinstance(one, RecordResidual) else one.values)
        for first in range(begin, begin + length, one.block):
            part = slice(first, min(first + one.block, begin + length))
            score = jacobian[part].T @ residual[part]
            scores += np.outer(score, score)
        begin += length
    independent = np.mean(residual**2) * np.diag(inverse)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse @ scores @ inverse), independent)))
