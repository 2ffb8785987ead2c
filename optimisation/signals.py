"""Measures of a run's motion and impacts after a start that is left out: one definition each.

Signals are displacement, acceleration and, where the structure has one, stress where the response
level is read, relative to the base or absolute. The acceleration is the change of velocity from
sample to sample over the time between: a mean over that time, impacts included. After rigid impacts
it and the stress depend on the modes that are kept, and it on the samples: both are told.

Of each signal x, from samples:

- RMS about zero, and the percentiles of |x|; of the displacement the response level of the whole
  run as well;
- exceedances: how often a second |x| rises above multiples of its RMS;
- rainflow: cycles by their amplitude, half a range, see `measures.rainflow_amplitudes`; half cycles
  count 0.5;
- spectrum: Welch's one-sided density with `SEGMENTS` segments, Hann windows that overlap by half;
  its integral is the mean square;
- of several tones, the response level or RMS of what lies in each one's band: bands meet at the
  geometric mean of neighbouring frequencies. What is cut out of the spectrum rings at both ends of
  the run, where as much as a level's half window is left out.

After shocks, the energy of the structure and the share of the modes above the first in it, at equal
times from the end of the pulse on, and the decay time, see `measures`.

Of impacts on rigid walls: their number a second, also of those above a velocity, and the energy
that they lose a second (the power that wears).
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.ensemble import Lane
from impact_env.kernels.motion.observers import compute_level
from impact_env.level import HALF_WINDOW_PERIODS, LEAST_SAMPLES_PER_CYCLE, level_of, require_sampled
from impact_env.loads import Loads, Tones
from impact_env.modes import ModalModel
from impact_env.results import Record, Response, require_recorded
from impact_env.sweep import simulate
from optimisation.measures import (
    DECAY,
    SAMPLES,
    after_pulse,
    measure_of,
    rainflow_amplitudes,
    read,
    settled_after,
)

Array = NDArray[np.float64]
PERCENTILES = (50, 90, 95, 99, 99.9, 100)
MULTIPLES = (1, 2, 3, 4)  # of the RMS
BINS = 32  # of the rainflow's amplitudes
SEGMENTS = 8
ENERGIES = 17  # times after a pulse
HALVINGS = 6  # of the largest velocity: thresholds of impacts


@dataclass(frozen=True, eq=False)
class SignalOptions:
    """Options of the signals that are measured in a lane.

    ``samples`` is the number of samples in a pseudo period; ``absolute`` says whether the motion is
    measured in space instead of relative to the base; ``stress_shape`` (N_m,) is as in
    `measures.stress_shape`.
    """

    samples: int
    absolute: bool
    stress_shape: Array | None

    def __call__(self, lane: Lane) -> dict[str, Any]:
        """Run a lane and return its measures."""
        response = simulate(
            lane.scene,
            lane.drive,
            initial=lane.start,
            record=Record(events=True, series=True, samples_per_period=self.samples),
        )
        return signal_measures(response, self)


def signal_measures(response: Response, options: SignalOptions) -> dict[str, Any]:
    """Return the measures of a run with its samples and impacts, as JSON values in SI units."""
    history = require_recorded("history", response.history)
    impacts = require_recorded("impacts", response.impacts)
    model = response.scene.model
    start = settled_after(response)
    interval = float(history.time[1])
    late = history.time >= start
    seconds = float(history.time[-1]) - start
    signals = signals_of(response, options)
    measures = {
        name: of_signal(values[late[: len(values)]], 1 / interval)
        for name, values in signals.items()
    }
    measures["displacement_m"]["level"] = float(
        compute_level(level_of(signals["displacement_m"], options.samples))[0]
    )
    largest = float(np.max(np.abs(impacts.relative_velocity), initial=0.0))
    speeds = np.abs(impacts.relative_velocity[impacts.time >= start])
    thresholds = [0.0, *(largest * 0.5 ** np.arange(HALVINGS, 0, -1)).tolist()]
    return {
        "from_s": start,
        "sample_rate_hz": 1 / interval,
        "modes": model.modes,
        "highest_mode_hz": float(model.omega.max()) / (2 * np.pi),
        "relative_to": "space" if options.absolute else "base",
        **measures,
        **decay_of(response),
        "bands": bands_of(response, signals["displacement_m"]),
        "impacts": {
            "per_s": len(speeds) / seconds,
            "power_w": float(np.sum(impacts.energy_lost[impacts.time >= start])) / seconds,
            "above_m_s": thresholds,
            "per_s_above": [
                float(np.sum(speeds > threshold)) / seconds for threshold in thresholds
            ],
        },
    }


def signals_of(response: Response, options: SignalOptions) -> dict[str, Array]:
    """Return displacement (m), acceleration (m/s^2) and stress (S,) at the samples of a run.

    The stress is included if the model has one.
    """
    history = require_recorded("history", response.history)
    model = response.scene.model
    displacement = history.modal_displacement @ model.level_shape
    velocity = history.modal_velocity @ model.level_shape
    if options.absolute:
        require(
            isinstance(response.drive, Loads) and response.drive.moves_base,
            "absolute",
            True,
            "left out where the base does not move",
        )
        require(
            model.response_shape is None,
            "absolute",
            True,
            "with the response read at the absorber's place, where the base's share is known",
        )
        base_velocity, base = response.drive.base_motion(history.time)
        displacement = displacement + model.base_at_absorber * (base - np.mean(base))
        velocity = velocity + model.base_at_absorber * base_velocity
    signals = {
        "displacement_m": displacement,
        "acceleration_m_s2": np.diff(velocity) / np.diff(history.time),
    }
    return (
        signals
        if options.stress_shape is None
        else signals | {"stress": history.modal_displacement @ options.stress_shape}
    )


def decay_of(response: Response) -> dict[str, Any]:
    """Return the energy's decay after shocks; empty under other loads."""
    if not isinstance(response.drive, Loads) or measure_of(response.drive) != DECAY:
        return {}
    times, modal = after_pulse(response)
    at = np.linspace(0, len(times) - 1, ENERGIES).astype(int)
    energy = np.sum(modal[at], axis=1)
    higher = np.divide(
        np.sum(modal[at, 1:], axis=1), energy, out=np.zeros(len(at)), where=energy > 0
    )
    return {
        "decay": {
            "decay_s": read(response),
            "at_s": times[at].tolist(),
            "energy_j": energy.tolist(),
            "higher_modes": higher.tolist(),
        }
    }


def spectrum(values: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies in Hz and the one-sided density of samples at a ``rate`` in Hz.

    The density is in the unit of the samples squared per Hz.
    """
    segment = max(2 * len(values) // (SEGMENTS + 1), 1)
    frequencies, density = scipy.signal.welch(values, rate, nperseg=segment, detrend=False)
    return frequencies, density


def of_signal(values: Array, rate: float) -> dict[str, Any]:
    """Return the measures of a signal (S,) that is sampled at a ``rate`` in Hz.

    They are JSON values in the unit of the signal.
    """
    size = np.abs(values)
    rms = float(np.sqrt(np.mean(values**2)))
    rises = [int(np.sum((size[:-1] <= k * rms) & (size[1:] > k * rms))) for k in MULTIPLES]
    amplitudes, counts = rainflow_amplitudes(values)
    cycles, edges = np.histogram(
        amplitudes,
        bins=BINS,
        range=(0.0, float(np.max(amplitudes, initial=0.0)) or 1.0),
        weights=counts,
    )
    frequencies, density = spectrum(values, rate)
    return {
        "rms": rms,
        "percentiles": {f"{share:g}": float(np.percentile(size, share)) for share in PERCENTILES},
        "exceedances": {
            "over_rms": list(MULTIPLES),
            "per_s": [n * rate / max(len(values) - 1, 1) for n in rises],
        },
        "rainflow": {"amplitude_edges": edges.tolist(), "cycles": cycles.tolist()},
        "spectrum": {"frequency_hz": frequencies.tolist(), "density": density.tolist()},
    }


def band_edges(loads: Loads) -> Array:
    """Return the frequencies in Hz that separate the tones of loads, from 0 to infinity.

    Their shape is (number of tones + 1,).
    """
    tones = []
    for part in loads.parts:
        if isinstance(part, Tones):
            middle = (
                1.0 if part.schedule is None else float(np.mean(part.schedule.omegas)) / (2 * np.pi)
            )
            tones += [
                float(tone.frequency or 0.0) if tone.order is None else tone.order * middle
                for tone in part.tones
            ]
    tones = sorted(set(tones))
    return np.array([0.0, *np.sqrt(np.array(tones[:-1]) * tones[1:]), np.inf])


def edges_of(model: ModalModel, loads: Loads) -> Array:
    """Return the ends in Hz of the bands in which loads are measured, from 0 to infinity.

    There is one band for each of several tones.

    Of a sweep one way through several resonances, it is one for each of them; the bands meet at the
    geometric mean of neighbouring resonances.
    """
    edges = band_edges(loads)
    omegas = loads.schedule.omegas
    if len(edges) > 2 or not (np.all(np.diff(omegas) > 0) or np.all(np.diff(omegas) < 0)):
        return edges
    crossed = model.omega[(model.omega > np.min(omegas)) & (model.omega < np.max(omegas))]
    return np.array([0.0, *np.sqrt(crossed[:-1] * crossed[1:]) / (2 * np.pi), np.inf])


def band_levels(lane: Lane) -> tuple[float, ...]:
    """Run a lane and return its level in m in each of the bands of `edges_of`.

    The level is the response level for loads with a schedule, otherwise the RMS of the
    displacement.
    """
    ratio = lane.drive.highest_lasting_omega / lane.drive.schedule.reference
    samples = max(SAMPLES, int(np.ceil(LEAST_SAMPLES_PER_CYCLE * ratio)))
    require_sampled(lane.scene, lane.drive, samples)
    record = Record(level=False, series=True, samples_per_period=samples)
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=record)
    history = require_recorded("history", response.history)
    model = response.scene.model
    displacement = history.modal_displacement @ model.level_shape
    if bands := bands_of(response, displacement):
        return tuple(band.get("level_m", band.get("rms_m", 0.0)) for band in bands)
    hertz = lane.drive.schedule.omega_at(history.time) / (2 * np.pi)
    parts = (
        displacement[(hertz >= low) & (hertz < high)]
        for low, high in pairwise(edges_of(model, lane.drive))
    )
    return tuple(float(compute_level(level_of(part, samples))[0]) for part in parts)


def bands_of(response: Response, displacement: Array) -> list[dict[str, float]]:
    """Return the level in the band of each of several tones.

    The level is the response level for loads with a schedule, otherwise the RMS. Other loads have
    no bands.
    """
    drive = response.drive
    if not isinstance(drive, Loads) or len(edges := band_edges(drive)) < 3:
        return []
    history = require_recorded("history", response.history)
    spectrum = np.fft.rfft(displacement)
    interval = float(history.time[1])
    frequencies = np.fft.rfftfreq(len(displacement), interval)
    samples = round(drive.schedule.pseudo_period / interval)
    swept = settled_after(response) == 0
    cut = min(HALF_WINDOW_PERIODS * samples, len(displacement) // 4)
    middle = slice(max(cut, int(settled_after(response) / interval)), -cut)
    bands = []
    for low, high in pairwise(edges):
        part = np.fft.irfft(
            np.where((frequencies >= low) & (frequencies < high), spectrum, 0), len(displacement)
        )[middle]
        value = (
            float(compute_level(level_of(part, samples))[0])
            if swept
            else float(np.sqrt(np.mean(part**2)))
        )
        bands.append(
            {
                "from_hz": float(low),
                **({} if np.isinf(high) else {"to_hz": float(high)}),
                "level_m" if swept else "rms_m": value,
            }
        )
    return bands
