"""The paper's resonant response level (paper, Eqs. tmax and barqtip).

The level is the RMS of the tip displacement in a window around its maximum.

It needs four samples in each cycle of a lasting force, or of the motion that a record, shock or
strike causes.
"""

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count, require, row
from impact_env.drive import Excitation, Load
from impact_env.kernels.motion.observers import (
    LevelObserver,
    compute_level,
    new_level,
    push_samples,
)
from impact_env.loads import BASE_QUANTITY, Random, Samples, Shock, Strike
from impact_env.modes import ModalModel
from impact_env.results import MOST_SAMPLES_PER_PERIOD, ResponseLevel
from impact_env.scene import InitialState, Scene

Array = NDArray[np.float64]
HALF_WINDOW_PERIODS = 10  # pseudo periods to either side of the maximum
# samples of the force's fastest cycle: the mean square of a cosine is right from three on, its peak
# at most 3/10 too low with four
LEAST_SAMPLES_PER_CYCLE = 4
SHARE_ABOVE = 0.05  # of the mean square of the displacement: the level is at most 2.5 % off
LOAD_NAMES = {Samples: "a record", Random: "a random load", Shock: "a shock", Strike: "a strike"}


def require_samples(samples_per_period: int, ratio: float) -> None:
    """Raise ParameterError if a level has fewer than `LEAST_SAMPLES_PER_CYCLE` samples a cycle.

    The cycle is that of a force of ``ratio`` times the reference frequency.
    """
    needed = LEAST_SAMPLES_PER_CYCLE * ratio * (1 - 1e-9)
    allowed = (
        f"{int(np.ceil(needed))} or more for the level under a force of {ratio:g} times the "
        f"reference frequency, {LEAST_SAMPLES_PER_CYCLE} a cycle"
    )
    require(samples_per_period >= needed, "samples_per_period", samples_per_period, allowed)


def response_level(
    tip_displacement: NDArray[np.float64],
    samples_per_period: int,
    half_window_periods: int = HALF_WINDOW_PERIODS,
) -> tuple[float, float]:
    """Return (response level, largest |q_tip|) in m of equidistant samples.

    ``tip_displacement`` (S,), S >= 2, is in m. The window has ``half_window_periods`` pseudo
    periods on either side of the maximum, and is cut at the ends of the series.
    """
    values = row("tip_displacement", tip_displacement, "two or more finite samples")
    require(len(values) >= 2, "tip_displacement", values, "two or more finite samples")
    samples_per_period = count("samples_per_period", samples_per_period, 1, MOST_SAMPLES_PER_PERIOD)
    half_window_periods = count(
        "half_window_periods", half_window_periods, 1, MOST_SAMPLES_PER_PERIOD
    )
    rms, _, largest = compute_level(level_of(values, samples_per_period, half_window_periods))
    return float(rms), float(largest)


def level_of(
    values: NDArray[np.float64],
    samples_per_period: int,
    half_window_periods: int = HALF_WINDOW_PERIODS,
) -> LevelObserver:
    """Return the level observer after a run with the samples ``values`` (S,) in m.

    The first sample is at time 0.
    """
    level = new_level(samples_per_period, half_window_periods)._replace(
        block=np.ascontiguousarray(values, dtype=np.float64)
    )
    push_samples(level, 0, len(level.block))
    return level


def read_level(
    level: LevelObserver | None, drive: Excitation, interval: float
) -> ResponseLevel | None:
    """Return the level observer's result, None without observer.

    ``interval`` is the time between samples in s.
    """
    if level is None:
        return None
    value, sample, largest = compute_level(level)
    at = min(float(sample) * interval, float(drive.schedule.times[-1]))
    ratio = float(drive.schedule.omega_at(at)) / drive.schedule.reference
    return ResponseLevel(float(value), at, ratio, float(largest))


def require_sampling(
    scene: Scene, drive: Excitation, samples_per_period: int, start: Array
) -> None:
    """Raise ParameterError if a level or an envelope has too few samples in a pseudo period.

    The necessary number depends on the loads. A harmonic force, tones, orders, an unbalance and a
    shaken base need `LEAST_SAMPLES_PER_CYCLE` samples in a cycle of their highest frequency. Under
    a record, a random load, a shock or a strike, the displacement at the place of the level of the
    structure without absorber decides: at most `SHARE_ABOVE` of its mean square may lie above the
    frequency that has so many samples in a cycle. ``start`` (2 N_m + 2 n,) is the state at time 0,
    including strikes.
    """
    reference = drive.schedule.reference
    require_samples(samples_per_period, drive.highest_lasting_omega / reference)
    for part in drive.parts:
        if isinstance(part, Strike):
            result = _free_motion(scene, start)
        elif isinstance(part, Samples | Random | Shock):
            result = response_spectrum(scene.model, part)
        else:
            continue
        require_spectrum(samples_per_period, reference, part, *result)


def require_sampled(
    scene: Scene, drive: Excitation, samples_per_period: int, initial: InitialState | None = None
) -> None:
    """Raise ParameterError as `require_sampling` does, for a run from ``initial``.

    If ``initial`` is None, the run starts as its loads define.
    """
    start = drive.initial_state(scene, initial).vector(scene)
    require_sampling(scene, drive, samples_per_period, start)


def require_spectrum(
    samples_per_period: int, reference: float, load: Load, omega: Array, square: Array
) -> None:
    """Raise ParameterError if a load's displacement has too large a share at high frequencies.

    ``omega`` (L,) are ascending frequencies in rad/s and ``square`` (L,) the parts of the mean
    square of the displacement at the level's place, in any unit. High frequencies have fewer than
    four of the ``samples_per_period`` in a cycle. ``reference`` (rad/s) defines the pseudo period.
    """
    above = np.cumsum(square[::-1])[::-1]
    if len(above) == 0 or not above[0] > 0:
        return
    highest = float(omega[np.flatnonzero(above > SHARE_ABOVE * above[0])[-1]])
    needed = LEAST_SAMPLES_PER_CYCLE * highest / reference * (1 - 1e-9)
    words = next(words for kind, words in LOAD_NAMES.items() if isinstance(load, kind))
    allowed = (
        f"{int(np.ceil(needed))} or more for the level under {words}: "
        f"{100 * SHARE_ABOVE:g} % of the displacement's mean square lies at "
        f"{highest / (2 * np.pi):.4g} Hz or above, "
        f"and needs {LEAST_SAMPLES_PER_CYCLE} samples a cycle"
    )
    require(samples_per_period >= needed, "samples_per_period", samples_per_period, allowed)


def response_spectrum(model: ModalModel, load: Samples | Random | Shock) -> tuple[Array, Array]:
    """Return frequencies and parts of the mean square of the displacement at the level's place.

    The frequencies (L,) are in rad/s and ascending, the parts (L,) in an arbitrary unit. The
    structure has no absorber. For a record and a random load the displacement is the stationary
    response to each spectral line, for a shock it is the free motion after the shock.
    """
    weight = _modal_displacements(model, load)
    if isinstance(load, Shock):
        order = np.argsort(model.omega)
        omega = np.maximum(model.omega[order], 1e-300)
        size = weight[order] * _pulse_spectrum(load, omega) / omega
        return omega, np.asarray(size**2)
    if isinstance(load, Samples):
        lines = np.arange(len(load.values) // 2 + 1)
        length = len(load.values) * float(load.times[1])
        power = np.abs(np.fft.rfft(load.values)) ** 2
    else:
        lines = load.lines
        length = load.length
        power = load.density
    omega = np.asarray(2 * np.pi / length * lines, dtype=np.float64)
    return omega, np.asarray(power) * _squared_receptance(model, weight, omega, length)


def _modal_displacements(model: ModalModel, load: Samples | Random | Shock) -> Array:
    """Return each mode's part (N_m,) of the displacement at the level's place per unit of the load.

    The unit of the load is 1 N, or 1 m/s^2 of the base.
    """
    drives: Array | None = None
    if load.force_place is not None:
        drives = model.find_force_place(load.force_place)
    elif load.quantity == BASE_QUANTITY:
        drives = model.base_participation
    else:
        drives = model.one_phase_force_shape
    return np.asarray(model.level_shape * (0.0 if drives is None else drives))


def _squared_receptance(model: ModalModel, weight: Array, omega: Array, length: float) -> Array:
    """Return |displacement/load|^2 (L,) at frequencies omega (L,) in rad/s.

    The width of each resonance is at least that of a spectral line of a record of ``length`` s.
    """
    total = np.zeros(len(omega), complex)
    for own, damping, size in zip(model.omega, model.damping_ratio, weight, strict=True):
        width = 2 * max(damping * own, 1 / length)
        total += size / (own**2 - omega**2 + 1j * width * np.maximum(omega, 1 / length))
    return np.asarray(np.abs(total) ** 2)


def _pulse_spectrum(load: Shock, omega: Array) -> Array:
    """Return the absolute value of the Fourier integral of a pulse of unit peak in s, (L,).

    ``omega`` (L,) is in rad/s.
    """
    if load.pulse == "half-sine":
        own = np.pi / load.width
        apart = (own - omega) * (own + omega)
        near = np.abs(own - omega) < 1e-6 * own
        value = 2 * own * np.cos(omega * load.width / 2) / np.where(near, 1.0, apart)
        return np.where(near, load.width / 2, np.abs(value))
    rise = load.width / 2 if load.rise is None else load.rise
    flat = load.width - rise  # a trapezoid is a box of this width, smoothed over the rise
    return np.abs(flat * np.sinc(omega * flat / (2 * np.pi)) * np.sinc(omega * rise / (2 * np.pi)))


def _free_motion(scene: Scene, start: Array) -> tuple[Array, Array]:
    """Return frequencies and parts of the mean square of the free motion from a state.

    Both are as in `response_spectrum`. ``start`` (2 N_m + 2 n,) is the state.
    """
    model = scene.model
    n = model.modes
    half = len(start) // 2
    order = np.argsort(model.omega)
    omega = np.maximum(model.omega[order], 1e-300)
    q = start[:n][order]
    v = start[half : half + n][order]
    return omega, np.asarray(model.level_shape[order] ** 2 * (q**2 + (v / omega) ** 2))
