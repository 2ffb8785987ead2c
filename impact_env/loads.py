"""Loads of machines: unbalance, moving base, tones, records, random spectra, shocks and strikes.

The order is: loads given by formulas (shocks, strikes, unbalance, base, tones and orders), records
and random loads, then several loads at once (`Loads`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    count_from,
    each_of,
    finite,
    kind_of,
    labelled,
    non_negative,
    or_none,
    positive,
    require,
    row,
    row_of,
    text,
    word_of,
)
from impact_env.drive import (
    LOAD_STARTS,
    Drive,
    Excitation,
    FrequencySchedule,
    Load,
    Member,
    Pieces,
    check_reference,
    constant_coefficients,
    find_schedule,
    schedule_pieces,
)
from impact_env.fields import check_fields, parameter
from impact_env.modes import ModalModel
from impact_env.sampling_times import EVEN_TOL, even_times, find_uneven, is_even
from impact_env.scene import InitialState, Scene

Array = NDArray[np.float64]
FORCE_QUANTITY = "force"
BASE_QUANTITY = "base_acceleration"
QUANTITIES = (FORCE_QUANTITY, BASE_QUANTITY)  # N at the structure's force place, m/s^2 of its base
STRIKE_PLACES = ("force", "absorber")
PULSES = ("half-sine", "triangle", "trapezoid", "sawtooth")
MOST_RECORD_SAMPLES = 2**22  # of a record: a piece of each is 80 bytes
MOST_SIZE = f"at most {MOST_RECORD_SAMPLES} samples, {80 * MOST_RECORD_SAMPLES / 2**20:.0f} MiB"
LINE_TOL = 1e-12  # of a frequency: a line of a random load is at a point of its spectrum
RANDOM_SAMPLES = 20  # of a random record, in a period of its highest frequency
TIME_TOL = 1e-12  # of the duration: breakpoints closer than this are one
MOST_OFFSET_RATIO = (
    6.0  # root mean squares of a velocity: more is no oscillation and no pulse, but an offset
)
GAUSS_RULE = np.polynomial.legendre.leggauss(
    4
)  # nodes and weights: right to 1e-7 of what a base moves by, on a radian of its carrier


# fields that several loads have
AMPLITUDE = parameter(finite)  # its unit follows from the quantity
PHASE = parameter(finite, unit="rad")
SCHEDULE = parameter(kind_of(FrequencySchedule))
DURATION = parameter(positive, unit="s", name="duration")
QUANTITY = parameter(word_of(QUANTITIES))
FORCE_PLACE = parameter(or_none(text), name="place")


def _check_force_place(load: Load) -> None:
    """Raise ParameterError for a load that moves the base and has a place."""
    quantity = getattr(load, "quantity", FORCE_QUANTITY)
    allowed = "left out of a base that moves: its motion acts on the whole structure"
    require(
        load.force_place is None or quantity == FORCE_QUANTITY,
        "force_place",
        load.force_place,
        allowed,
    )


def lines_between(times: Array, values: Array, moves_base: bool) -> Pieces:
    """Return the load that is linear between values (K,) at times (K,) in s.

    A time that occurs twice gives a jump.
    """
    steps = np.diff(times)
    rising = steps > 0
    rows = np.zeros((int(np.sum(rising)), 9))
    rows[:, 3] = values[:-1][rising]
    rows[:, 5] = (np.diff(values)[rising]) / steps[rising]
    return Pieces(np.append(times[:-1][rising], times[-1]), rows, moves_base)


@dataclass(frozen=True, eq=False)
class Shock(Load):
    """A pulse of a force or of the base's acceleration, followed by rest.

    Parameters
    ----------
    pulse : str
        Shape of the pulse. A sawtooth has its peak at its end (terminal-peak sawtooth, IEC
        60068-2-27): it rises linearly over its width and drops to zero.
    peak : float
        Largest value in N or m/s^2.
    width : float
        Duration of the pulse in s.
    length : float
        Duration of the load in s; it is zero after the pulse.
    rise : float, optional
        Time in s in which a trapezoid rises, and in which it falls.
    quantity : str, optional
        Whether the load is a force or the acceleration of the base, which is at rest before the
        pulse.
    force_place : str, optional
        Name of the place of the force, see `Load`.
    """

    pulse: str = field(metadata=parameter(word_of(PULSES)))
    peak: float = field(metadata=AMPLITUDE)
    width: float = field(metadata=parameter(positive, unit="s", name="pulse"))
    length: float = field(metadata=DURATION)
    rise: float | None = field(default=None, metadata=parameter(unit="s"))
    quantity: str = field(default=FORCE_QUANTITY, metadata=QUANTITY)
    force_place: str | None = field(default=None, metadata=FORCE_PLACE)
    sizes: ClassVar[tuple[str, ...]] = ("peak",)

    def __post_init__(self) -> None:
        check_fields(self)
        _check_force_place(self)
        require(
            self.width <= self.length,
            "length",
            self.length,
            f"{self.width:g} s or more, as long as the pulse",
        )
        require(
            (self.rise is not None) == (self.pulse == "trapezoid"),
            "rise",
            self.rise,
            "given for a trapezoid, else left out",
        )
        if self.rise is not None:
            check_fields(self, rise=partial(non_negative, most=self.width / 2))

    def pieces(self) -> list[Pieces]:
        """Return its pieces."""
        base = self.quantity == BASE_QUANTITY
        end = self.length
        peak = self.peak
        width = self.width
        if self.pulse == "half-sine":
            times = np.array([0.0, width] + [end] * (end > width))
            rows = np.zeros((len(times) - 1, 9))
            rows[0, :4] = np.pi / width, 0.0, -np.pi / 2, peak
            return [Pieces(times, rows, base)]
        if self.pulse == "sawtooth":
            times = np.array([0.0, width, width, end])
            return [lines_between(times, np.array([0.0, peak, 0.0, 0.0]), base)]
        rise = width / 2 if self.rise is None else self.rise
        times = np.array([0.0, rise, width - rise, width, end])
        return [lines_between(times, np.array([0.0, peak, peak, 0.0, 0.0]), base)]


@dataclass(frozen=True)
class Strike(Load):
    """A strike on the structure just before time 0, then free motion.

    Parameters
    ----------
    velocity : float
        Velocity in m/s of the struck place at time 0.
    length : float
        Duration of the free motion in s.
    place : {"force", "absorber"}, optional
        The struck place.

    Notes
    -----
    The modes of the structure without absorber get the velocities after an impulse of
    velocity / sum(shape^2) N s at the place. The mobility of a place, and with it the impulse,
    depends on the number of modes kept.
    """

    velocity: float = field(metadata=parameter(finite, unit="m/s"))
    length: float = field(metadata=DURATION)
    place: str = field(default=STRIKE_PLACES[0], metadata=parameter(word_of(STRIKE_PLACES)))
    sizes: ClassVar[tuple[str, ...]] = ("velocity",)

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def width(self) -> float:
        """Duration of the pulse in s, 0."""
        return 0.0

    def pieces(self) -> list[Pieces]:
        """Return a load of zero: the strike itself is part of the state at time 0."""
        return [Pieces(np.array([0.0, self.length]), np.zeros((1, 9)), False)]

    def modal_velocity(self, model: ModalModel) -> Array:
        """Return the modal velocities (N_m,) in sqrt(kg) m/s at time 0."""
        shape = model.force_shape if self.place == "force" else model.tip_shape
        size = float(np.sum(shape**2))
        require(size > 0, "place", self.place, "where a mode moves")
        return np.asarray(self.velocity / size * shape)


def _squared_coefficients(schedule: FrequencySchedule, factor: float) -> Array:
    """Return the coefficients (K - 1, 6) of an amplitude ``factor`` omega(t)^2, see `Pieces`."""
    coefficients = np.zeros((len(schedule.times) - 1, 6))
    omega = schedule.omegas[:-1]
    rate = np.diff(schedule.omegas) / np.diff(schedule.times)
    coefficients[:, 0] = factor * omega**2
    coefficients[:, 2] = 2 * factor * omega * rate
    coefficients[:, 4] = factor * rate**2
    return coefficients


@dataclass(frozen=True, eq=False)
class Unbalance(Load):
    """A rotor's unbalance at the force's place, with a run-up or a run-down.

    The force is U omega(t)^2 cos(integral of omega + phase). The tangential part, U times the rate
    of omega, is neglected: relative to it the rate over omega^2 is small.

    Parameters
    ----------
    unbalance : float
        Unbalance U in kg m.
    schedule : FrequencySchedule
        Speed of the rotor omega over time.
    phase : float, optional
        Phase in rad at time 0.
    force_place : str, optional
        Name of the place of the force, see `Load`.
    """

    unbalance: float = field(metadata=parameter(finite, unit="kg m"))
    schedule: FrequencySchedule = field(metadata=SCHEDULE)
    phase: float = field(default=0.0, metadata=PHASE)
    force_place: str | None = field(default=None, metadata=FORCE_PLACE)
    sizes: ClassVar[tuple[str, ...]] = ("unbalance",)

    def __post_init__(self) -> None:
        check_fields(self)
        _check_force_place(self)

    def pieces(self) -> list[Pieces]:
        """Return its pieces."""
        return [
            schedule_pieces(
                self.schedule,
                1.0,
                self.phase,
                _squared_coefficients(self.schedule, self.unbalance),
                False,
            )
        ]


@dataclass(frozen=True, eq=False)
class ShakenBase(Load):
    """A base that moves harmonically.

    The acceleration or the displacement, one of both, is its amplitude times cos(integral of omega
    + phase).

    Parameters
    ----------
    schedule : FrequencySchedule
        Frequency omega over time.
    acceleration : float, optional
        Amplitude of the acceleration in m/s^2.
    displacement : float, optional
        Amplitude of the displacement in m.
    phase : float, optional
        Phase in rad at time 0.
    """

    schedule: FrequencySchedule = field(metadata=SCHEDULE)
    acceleration: float | None = field(
        default=None, metadata=parameter(or_none(finite), unit="m/s^2")
    )
    displacement: float | None = field(default=None, metadata=parameter(or_none(finite), unit="m"))
    phase: float = field(default=0.0, metadata=PHASE)
    sizes: ClassVar[tuple[str, ...]] = ("acceleration", "displacement")

    def __post_init__(self) -> None:
        require(
            (self.acceleration is None) != (self.displacement is None),
            "acceleration",
            self.acceleration,
            "given, or a displacement in its place: one of the two",
        )
        check_fields(self)

    def pieces(self) -> list[Pieces]:
        """Return its pieces.

        The acceleration of a displacement U cos(phase) is -U (omega^2 cos(phase) + rate
        sin(phase)).
        """
        if self.acceleration is not None:
            return [
                schedule_pieces(
                    self.schedule,
                    1.0,
                    self.phase,
                    constant_coefficients(self.schedule, self.acceleration),
                    True,
                )
            ]
        assert self.displacement is not None
        coefficients = _squared_coefficients(self.schedule, -self.displacement)
        coefficients[:, 1] = (
            self.displacement * np.diff(self.schedule.omegas) / np.diff(self.schedule.times)
        )
        return [schedule_pieces(self.schedule, 1.0, self.phase, coefficients, True)]

    def base_velocity(self) -> float:
        """Return the base's velocity in m/s at time 0 with which its mean velocity is zero."""
        omega = float(self.schedule.omegas[0])
        if self.displacement is not None:
            return float(-self.displacement * omega * np.sin(self.phase))
        assert self.acceleration is not None
        require(
            omega > 0, "omegas", omega, "above 0 at the start, for a base whose mean is at rest"
        )
        return float(self.acceleration / omega * np.sin(self.phase))


@dataclass(frozen=True)
class Tone:
    """One harmonic part of `Tones`.

    Parameters
    ----------
    amplitude : float
        Amplitude in N or m/s^2.
    frequency : float, optional
        Fixed frequency in Hz.
    order : float, optional
        Frequency over that of the schedule, in place of ``frequency``.
    phase : float, optional
        Phase in rad at time 0.
    """

    amplitude: float = field(metadata=AMPLITUDE)
    frequency: float | None = field(default=None, metadata=parameter(or_none(positive), unit="Hz"))
    order: float | None = field(default=None, metadata=parameter(or_none(positive)))
    phase: float = field(default=0.0, metadata=PHASE)

    def __post_init__(self) -> None:
        require(
            (self.frequency is None) != (self.order is None),
            "frequency",
            self.frequency,
            "given, or an order in its place: one of the two",
        )
        check_fields(self)


@dataclass(frozen=True, eq=False)
class Tones(Load):
    """Several tones at once.

    Parameters
    ----------
    tones : sequence of Tone
        The tones, all with fixed frequencies or all with orders.
    length : float, optional
        Duration in s of tones with fixed frequencies.
    schedule : FrequencySchedule, optional
        Frequency of order 1 over time.
    quantity : str, optional
        Whether the load is a force or the acceleration of the base.
    force_place : str, optional
        Name of the place of the force, see `Load`.
    """

    tones: tuple[Tone, ...] = field(metadata=parameter(each_of(kind_of(Tone))))
    length: float | None = field(
        default=None, metadata=parameter(or_none(positive), unit="s", name="duration")
    )
    schedule: FrequencySchedule | None = field(
        default=None, metadata=parameter(kind_of(FrequencySchedule | None))
    )
    quantity: str = field(default=FORCE_QUANTITY, metadata=QUANTITY)
    force_place: str | None = field(default=None, metadata=FORCE_PLACE)

    def __post_init__(self) -> None:
        check_fields(self)
        _check_force_place(self)
        require(len(self.tones) > 0, "tones", self.tones, "one or more")
        for tone in self.tones:
            require(
                (tone.order is None) == (self.schedule is None),
                "tones",
                tone,
                "an order for each with a schedule, else a frequency for each",
            )
        if self.schedule is None:
            require(
                self.length is not None,
                "length",
                self.length,
                "given, in s, for tones of fixed frequencies",
            )
        else:
            require(self.length is None, "length", self.length, "left out beside a schedule")

    def pieces(self) -> list[Pieces]:
        """Return the pieces of each tone."""
        return [
            schedule_pieces(
                *self._turning(tone),
                tone.phase,
                constant_coefficients(self._turning(tone)[0], tone.amplitude),
                self.quantity == BASE_QUANTITY,
            )
            for tone in self.tones
        ]

    def _turning(self, tone: Tone) -> tuple[FrequencySchedule, float]:
        if self.schedule is not None:
            assert tone.order is not None
            return self.schedule, tone.order
        assert tone.frequency is not None
        omega = 2 * np.pi * tone.frequency
        return FrequencySchedule(
            np.array([0.0, self.duration]), np.full(2, omega), 2 * np.pi / self.duration
        ), 1.0

    def member(self, other: Member) -> Tones:
        """Return the load of a member of an ensemble: each tone has another random phase."""
        drawn = np.random.default_rng([other.number, len(self.tones)]).uniform(
            0, 2 * np.pi, len(self.tones)
        )
        phases = drawn if other.number > 0 else np.zeros(len(self.tones))
        tones = (
            replace(tone, amplitude=other.factor * tone.amplitude, phase=tone.phase + float(p))
            for tone, p in zip(self.tones, phases, strict=True)
        )
        return replace(self, tones=tuple(tones))

    def base_velocity(self) -> float:
        """Return the base's velocity in m/s at time 0 with which its mean velocity is zero."""
        if self.quantity == FORCE_QUANTITY:
            return 0.0
        speeds = [
            float(schedule.omegas[0]) * order for schedule, order in map(self._turning, self.tones)
        ]
        require(
            min(speeds) > 0,
            "schedule",
            min(speeds),
            "frequencies above 0 at the start, for a base whose mean is at rest",
        )
        return float(
            sum(
                tone.amplitude / speed * np.sin(tone.phase)
                for tone, speed in zip(self.tones, speeds, strict=True)
            )
        )


@dataclass(frozen=True, eq=False)
class Samples(Load):
    """A record of a force or of the base's acceleration, linear between its samples.

    Parameters
    ----------
    times : array_like, (K,)
        Equidistant times in s, from 0.
    values : array_like, (K,)
        Values at these times in N or m/s^2.
    quantity : str, optional
        Whether the load is a force or the acceleration of the base.
    force_place : str, optional
        Name of the place of the force, see `Load`.
    """

    times: Array = field(metadata=parameter(unit="s"))
    values: Array
    quantity: str = field(default=FORCE_QUANTITY, metadata=QUANTITY)
    force_place: str | None = field(default=None, metadata=FORCE_PLACE)
    sizes: ClassVar[tuple[str, ...]] = ("values",)

    def __post_init__(self) -> None:
        check_fields(self)
        _check_force_place(self)
        size = getattr(self.times, "size", None)
        size = len(self.times) if size is None and isinstance(self.times, Sequence) else size
        size = size if isinstance(size, int) else 0
        allowed = f"{MOST_SIZE}, not {size}: cut the record, or take every second one"
        require(size <= MOST_RECORD_SAMPLES, "samples", size, allowed)
        times = row("times", self.times, "two or more finite times in s")
        values = row("values", self.values, "finite numbers, one for each time")
        require(
            len(times) >= 2 and len(times) == len(values),
            "times",
            f"{len(times)} times and {len(values)} values",
            "as many, two or more",
        )
        steps = np.diff(times)
        require(
            times[0] == 0 and bool(np.all(steps > 0)),
            "times",
            times[: min(4, len(times))].tolist(),
            "strictly rising from 0",
        )
        even = even_times(len(times), float(times[-1]))
        if np.max(np.abs(times - even)) > EVEN_TOL * even[1]:
            where = find_uneven(times)
            require(
                is_even(times),
                f"times[{where}]",
                float(times[where]),
                f"even steps of {even[1]:g} s, here {even[where]:g}: resample the record",
            )
            times = even
            times.setflags(write=False)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    @property
    def duration(self) -> float:
        """Duration of the record in s."""
        return float(self.times[-1])

    def pieces(self) -> list[Pieces]:
        """Return its pieces."""
        return [lines_between(self.times, self.values, self.quantity == BASE_QUANTITY)]

    def share_above(self, frequency: float) -> float:
        """Return the share of the mean square above a frequency in Hz.

        The share is 0 for a record of zeros.
        """
        frequency = non_negative("frequency", frequency)
        sizes = np.abs(np.fft.rfft(self.values)) ** 2
        above = np.fft.rfftfreq(len(self.values), self.times[1]) > frequency
        return float(np.sum(sizes[above]) / max(np.sum(sizes), 1e-300))

    def drift(self) -> float | None:
        """Return the offset (m/s^2) of a base's record that makes its displacement drift.

        The result is None for a force, and for a record without such an offset. A record drifts if
        its offset changes the velocity by more than `MOST_OFFSET_RATIO` times the root mean square
        of the velocity without offset. An oscillation that is cut anywhere changes it by less than
        2.9 times, a pulse by 3.5 times.
        """
        if self.quantity == FORCE_QUANTITY:
            return None
        step = self.times[1]
        steps = step * (self.values[1:] + self.values[:-1]) / 2
        offset = float(np.sum(steps)) / self.duration
        velocity = np.append(0.0, np.cumsum(steps - step * offset))
        drifts = abs(offset) * self.duration > MOST_OFFSET_RATIO * float(np.std(velocity))
        return offset if drifts and offset != 0 else None

    def base_velocity(self) -> float:
        """Return the base's velocity in m/s at time 0 with which its mean velocity is zero."""
        if self.quantity == FORCE_QUANTITY:
            return 0.0
        steps = np.diff(self.times)
        a = self.values
        change = np.concatenate([[0.0], np.cumsum(steps * (a[1:] + a[:-1]) / 2)])
        area = np.sum(
            steps * (change[:-1] + steps * (2 * a[:-1] + a[1:]) / 6)
        )  # of a parabola in each step
        return float(-area / self.duration)


ALLOWED_SPECTRUM = (
    "two or more pairs [Hz, value], frequencies strictly rising from above 0 but for two of one "
    "frequency, a step, between others; values above 0"
)


@dataclass(frozen=True, eq=False)
class Random(Load):
    """A Gaussian random record with a given one-sided spectrum.

    The record repeats after its length: it consists of spectral lines at whole multiples of
    1/length with random amplitudes and phases. It is sampled at `RANDOM_SAMPLES` times its highest
    frequency. Straight lines between samples lower a line of frequency f by sinc(f/rate)^2, so each
    line is raised by this factor.

    Parameters
    ----------
    spectrum : array_like, (P, 2)
        Frequency in Hz, and density in N^2/Hz or (m/s^2)^2/Hz. The density is linear in double
        logarithmic scale between the points, and zero outside. Two points of one frequency are a
        step; a line at this frequency has their mean density.
    length : float
        Duration in s.
    seed : int, optional
        Seed of the record.
    quantity : str, optional
        Whether the load is a force or the acceleration of the base.
    number : int, optional
        Number of the record among those of one seed, see `Member`.
    factor : float, optional
        Factor of the amplitude.
    force_place : str, optional
        Name of the place of the force, see `Load`.
    """

    spectrum: Array = field(metadata=parameter(row_of(ALLOWED_SPECTRUM, axes=2)))
    length: float = field(metadata=DURATION)
    seed: int = field(default=0, metadata=parameter(count_from(0)))
    quantity: str = field(default=FORCE_QUANTITY, metadata=QUANTITY)
    number: int = field(default=0, metadata=parameter(count_from(0)))
    factor: float = field(default=1.0, metadata=parameter(finite))
    force_place: str | None = field(default=None, metadata=FORCE_PLACE)

    def __post_init__(self) -> None:
        check_fields(self)
        _check_force_place(self)
        spectrum = self.spectrum
        ok = spectrum.shape[1] == 2 and len(spectrum) >= 2 and bool(np.all(spectrum > 0))
        require(ok, "spectrum", spectrum.tolist(), ALLOWED_SPECTRUM)
        widths = np.diff(spectrum[:, 0])
        steps = np.flatnonzero(widths == 0)
        inside = not len(steps) or (steps[0] > 0 and steps[-1] < len(widths) - 1)
        single = bool(np.all(np.diff(steps) > 1))
        rising = bool(np.all(widths >= 0)) and inside and single
        require(rising, "spectrum", spectrum.tolist(), ALLOWED_SPECTRUM)
        # before `lines`, which is an array of as many numbers
        samples = RANDOM_SAMPLES * float(spectrum[-1, 0]) * self.length
        allowed = f"{MOST_SIZE}, not {samples:.0f}: a shorter one, or a lower band"
        require(samples <= MOST_RECORD_SAMPLES, "length", self.length, allowed)
        require(
            len(self.lines) > 0,
            "spectrum",
            spectrum.tolist(),
            f"a band with a multiple of {1 / self.length:g} Hz, one over the duration",
        )

    @property
    def _samples(self) -> int:
        return int(np.ceil(RANDOM_SAMPLES * float(self.spectrum[-1, 0]) * self.length))

    @property
    def lines(self) -> NDArray[np.int64]:
        """Numbers (L,) of the spectral lines, their frequencies in multiples of 1/length."""
        low, high = self.spectrum[[0, -1], 0] * self.length
        first = int(np.ceil(low * (1 - LINE_TOL)))
        return np.arange(first, int(np.floor(high * (1 + LINE_TOL))) + 1)

    @property
    def density(self) -> Array:
        """Spectrum (L,) at each line, in N^2/Hz or (m/s^2)^2/Hz."""
        hertz, values = self.spectrum.T
        frequency = np.clip(self.lines / self.length, hertz[0], hertz[-1])
        result = np.exp(np.interp(np.log(frequency), np.log(hertz), np.log(values)))
        for k in np.flatnonzero(np.diff(hertz) == 0):
            result[np.isclose(frequency, hertz[k], rtol=LINE_TOL, atol=0)] = np.mean(
                values[k : k + 2]
            )
        return np.asarray(self.factor**2 * result)

    def amplitudes(self) -> NDArray[np.complex128]:
        """Return the complex amplitude (L,) of each line in N or m/s^2."""
        density = self.density
        drawn = np.random.default_rng([self.seed, self.number]).standard_normal((2, len(density)))
        return np.asarray(np.sqrt(density / self.length) * (drawn[0] + 1j * drawn[1]))

    def record(self) -> Samples:
        """Return the sampled record."""
        n = self._samples
        lines = self.lines
        whole = np.zeros(n // 2 + 1, complex)
        whole[lines] = self.amplitudes() / np.sinc(lines / n) ** 2
        values = np.fft.irfft(whole * n / 2, n)
        return Samples(
            np.asarray(self.length / n * np.arange(n + 1)),
            np.append(values, values[0]),
            self.quantity,
        )

    def pieces(self) -> list[Pieces]:
        """Return its pieces."""
        return self.record().pieces()

    def share_above(self, frequency: float) -> float:
        """Return the share of the mean square above a frequency in Hz."""
        frequency = non_negative("frequency", frequency)
        sizes = np.abs(self.amplitudes()) ** 2
        return float(np.sum(sizes[self.lines > frequency * self.length]) / np.sum(sizes))

    def member(self, other: Member) -> Random:
        """Return the load of a member of an ensemble: another record."""
        return replace(self, number=self.number + other.number, factor=other.factor * self.factor)

    def base_velocity(self) -> float:
        """Return the base's velocity in m/s at time 0 with which its mean velocity is zero."""
        return self.record().base_velocity()


@dataclass(frozen=True, eq=False)
class Loads(Excitation):
    """Loads that act together and have the same duration.

    Parameters
    ----------
    parts : sequence of Load
        The loads.
    reference : float, optional
        Circular frequency in rad/s that defines the pseudo period. If a load has a schedule, its
        reference is used.
    start : str or InitialState, optional
        State at time 0, in coordinates relative to the base. "middle": structure and absorber at
        rest relative to the base, the absorber in the middle of its cavity. "lower-wall": the same
        with the absorber at the lower of its rigid walls. "base-mean-rest": the base moves about a
        mean at rest, structure and absorber are at rest in space, undeformed.
    """

    parts: tuple[Load, ...] = field(metadata=parameter(labelled("loads", each_of(kind_of(Load)))))
    reference: float | None = None
    start: str | InitialState = LOAD_STARTS[0]
    in_pieces: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_fields(self)
        require(len(self.parts) > 0, "loads", self.parts, "one or more")
        single = not any(isinstance(part, Loads) for part in self.parts)
        require(single, "loads", self.parts, "single loads: add the parts of Loads one by one")
        placed = [part.force_place for part in self.parts if isinstance(part, Samples)]
        for place in placed:
            once = place is None or placed.count(place) == 1
            require(once, "place", place, "the place of one record: add records of one place up")
        durations = [part.duration for part in self.parts]
        ok = max(durations) - min(durations) <= TIME_TOL * max(durations)
        require(ok, "duration", durations, "the same for all loads that act together")
        known = [result for result in map(find_schedule, self.parts) if result is not None]
        if self.reference is None:
            require(
                len(known) > 0, "reference", None, "given, in rad/s, for loads without a schedule"
            )
            object.__setattr__(self, "reference", known[0].reference)
        check_fields(self, reference=check_reference)
        if not isinstance(self.start, InitialState):
            check_fields(self, start=word_of(LOAD_STARTS))

    @property
    def schedule(self) -> FrequencySchedule:
        """Frequency over time to which responses refer.

        It is the first schedule of the loads, or otherwise the constant reference for their
        duration.
        """
        assert self.reference is not None
        for result in map(find_schedule, self.parts):
            if result is not None:
                return FrequencySchedule(result.times, result.omegas, self.reference)
        return FrequencySchedule(
            np.array([0.0, self.parts[0].duration]), np.full(2, self.reference), self.reference
        )

    def pieces(self) -> list[Pieces]:
        """Return the pieces of all loads."""
        return self._pieces

    @property
    def moves_base(self) -> bool:
        """Whether the base moves."""
        return any(piece.moves_base for piece in self._pieces)

    @property
    def force_places(self) -> tuple[str, ...]:
        """Names of the places (`Load.force_place`) at which loads act."""
        return tuple(dict.fromkeys(part.force_place for part in self.parts if part.force_place))

    @cached_property
    def _pieces(self) -> list[Pieces]:
        """The pieces of all parts, each with the place of its force."""
        return [
            piece if part.force_place is None else replace(piece, place=part.force_place)
            for part in self.parts
            for piece in part.pieces()
        ]

    @property
    def highest_omega(self) -> float:
        """Highest frequency (rad/s) of the harmonic parts that are not zero, 0 without any."""
        return max((piece.highest_omega for piece in self._pieces), default=0.0)

    @property
    def highest_lasting_omega(self) -> float:
        """`highest_omega` without records, random loads, shocks and strikes."""
        lasting = (part for part in self.parts if not isinstance(part, Samples | Random | Shock))
        return max(
            (piece.highest_omega for part in lasting for piece in part.pieces()), default=0.0
        )

    def describe(self, *, phase: bool = True) -> str:  # noqa: ARG002 - as of a drive
        """Return the kinds of the loads as text."""
        names = ("Force" if isinstance(part, Drive) else type(part).__name__ for part in self.parts)
        return " and ".join(re.sub(r"\B([A-Z])", r" \1", name).lower() for name in names)

    def member(self, other: Member) -> Loads:
        """Return the loads of a member of an ensemble."""
        return replace(self, parts=tuple(part.member(other) for part in self.parts))

    def base_velocity(self) -> float:
        """Return the base's velocity in m/s at time 0 with which its mean velocity is zero."""
        return sum(part.base_velocity() for part in self.parts)

    def base_motion(self, times: Array) -> tuple[Array, Array]:
        """Return velocity (m/s) and displacement (m) of the base, (S,) each, at ``times`` (S,).

        The times are in s and ascend from 0. Both are integrals of the acceleration, from
        `base_velocity` and from a displacement of 0.
        """
        breaks, rows, which, channel = self.on_one_clock()
        even = (
            np.arange(0.0, times[-1], 1 / self.highest_omega) if self.highest_omega > 0 else times
        )
        grid = np.unique(np.concatenate([times, even, breaks[breaks < times[-1]]]))
        steps = np.diff(grid)
        which = which[
            np.clip(np.searchsorted(breaks, grid[:-1], side="right") - 1, 0, len(which) - 1)
        ][:, channel == 1]
        speed = np.zeros(len(steps))
        place = np.zeros(len(steps))
        for node, weight in zip((GAUSS_RULE[0] + 1) / 2, GAUSS_RULE[1] / 2, strict=True):
            u = (grid[:-1] + node * steps)[:, None] - rows[which, 0]
            turn = np.exp(1j * (rows[which, 3] + (rows[which, 1] + rows[which, 2] * u / 2) * u))
            size = sum(
                (rows[which, 4 + 2 * k] + 1j * rows[which, 5 + 2 * k]) * u**k for k in range(3)
            )
            acceleration = np.sum(np.real(size * turn), axis=1)
            speed += weight * steps * acceleration
            place += weight * steps**2 * (1 - node) * acceleration
        velocity = self.base_velocity() + np.append(0.0, np.cumsum(speed))
        displacement = np.append(0.0, np.cumsum(velocity[:-1] * steps + place))
        at = np.searchsorted(grid, times)
        return np.asarray(velocity[at]), np.asarray(displacement[at])

    def initial(self, scene: Scene) -> InitialState:
        """Return the state at time 0 that ``start`` and strikes define.

        Raises ParameterError if the scene cannot start in this way.
        """
        return self.struck(scene, self._start(scene))

    def initial_state(self, scene: Scene, initial: InitialState | None) -> InitialState:
        """Return the state of a run at time 0, with the velocities that strikes add.

        The state is ``initial``, or the start of the loads if ``initial`` is None. Raises
        ParameterError if both are given, or if the scene has no such start.
        """
        if initial is None:
            return self.initial(scene)
        require(
            isinstance(self.start, str) and self.start == LOAD_STARTS[0],
            "initial",
            initial,
            f"None under loads that start at {self.start!r}: one state at time 0",
        )
        return self.struck(scene, initial)

    def struck(self, scene: Scene, state: InitialState) -> InitialState:
        """Return a state with the modal velocities that strikes add to it."""
        strikes = [
            part.modal_velocity(scene.model) for part in self.parts if isinstance(part, Strike)
        ]
        if not strikes:
            return state
        own = state.modal_velocity
        require(
            own is None or len(own) == scene.model.modes,
            "modal_velocity",
            own,
            f"{scene.model.modes} finite numbers, one per mode",
        )
        return replace(
            state, modal_velocity=np.sum(strikes if own is None else [own, *strikes], axis=0)
        )

    def _start(self, scene: Scene) -> InitialState:
        if isinstance(self.start, InitialState) or self.start == "middle":
            return self.start if isinstance(self.start, InitialState) else InitialState()
        if self.start == "lower-wall":
            walls = [scene.cavity(k) for k in range(scene.places)]
            return InitialState(
                absorber_displacement=[0.0 if one is None else -one.gap for one in walls]
            )
        participation = scene.model.base_participation
        require(
            self.moves_base and participation is not None,
            "start",
            self.start,
            "one of the others where the base does not move",
        )
        assert participation is not None
        speed = self.base_velocity()
        return InitialState(
            modal_velocity=-speed * participation,
            absorber_velocity=-scene.model.base_at_absorber * speed,
        )

    def on_one_clock(self) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]]:
        """Return the pieces of all loads on common breakpoints.

        Returns
        -------
        tuple of arrays
            Breakpoints (K,) in s; all pieces (P, 10), each with its start in s and a row of
            `Pieces`; the index of the piece of each of the n loads in each interval (K - 1, n); and
            the channel (n,) of each load: 0 of a force, 1 of the base, or those of
            `impact_env.force_channels`.
        """
        sources = self._pieces
        if len(sources) == 1:
            (one,) = sources
            pieces = np.column_stack([one.times[:-1], one.rows])
            return (
                np.array(one.times),
                pieces,
                np.arange(len(pieces))[:, None],
                np.array([_find_channel(one)]),
            )
        times = np.unique(np.concatenate([source.times for source in sources]))
        near = np.append(np.diff(times) > TIME_TOL * times[-1], True)
        times = times[near]
        times[0] = 0.0
        middles = (times[1:] + times[:-1]) / 2
        first = 0
        rows = []
        which = []
        for source in sources:
            rows.append(np.column_stack([source.times[:-1], source.rows]))
            which.append(
                first
                + np.clip(
                    np.searchsorted(source.times, middles, side="right") - 1,
                    0,
                    len(source.rows) - 1,
                )
            )
            first += len(source.rows)
        return (
            times,
            np.vstack(rows),
            np.column_stack(which).astype(np.int64),
            np.array([_find_channel(source) for source in sources]),
        )


def _find_channel(piece: Pieces) -> int:
    """Return the channel of a load: its own, or 1 if it moves the base."""
    return piece.channel or int(piece.moves_base)


def Force(drive: Drive) -> Drive:  # noqa: N802 - the name of a class in 1.0.0rc1
    """Return the drive unchanged: a former name of `Drive` among other loads."""
    return drive
