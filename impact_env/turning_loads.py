"""Loads given by formulas, and their form in a run (`Pieces`): harmonic force, unbalance, base motion, tones and orders, shocks and strikes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive, FrequencySchedule
from impact_env.modes import ModalModel
from impact_env.parameters import (
    each_of,
    finite,
    keep_checked,
    kind_of,
    non_negative,
    positive,
    require,
    word_of,
)

Array = NDArray[np.float64]
FORCE_QUANTITY = "force"
BASE_QUANTITY = "base_acceleration"
QUANTITIES = (FORCE_QUANTITY, BASE_QUANTITY)  # N at the structure's force place, m/s^2 of its base
STRIKE_PLACES = ("force", "absorber")
PULSES = ("half-sine", "triangle", "trapezoid", "sawtooth")


@dataclass(frozen=True, eq=False)
class Pieces:
    """A load between breakpoints ``times`` (K,) in s from 0: ``rows`` (K - 1, 9).

    A row has frequency (rad/s), its rate (rad/s^2), phase at the start (rad), then real and imaginary parts of c0, c1 and c2, in N, or in m/s^2
    where the load is of the kind that ``moves_base``.
    """

    times: Array
    rows: Array
    moves_base: bool


@dataclass(frozen=True)
class Member:
    """The random part of a member of an ensemble.

    ``number``, 0 for the load itself, draws records and tones' phases; ``phase`` in rad is added to that of a load with a schedule; ``factor``
    multiplies the amplitude.
    """

    number: int = 0
    phase: float = 0.0
    factor: float = 1.0


class Load(ABC):
    """A load, which lasts as long as its ``schedule``, or its ``length`` in s where it has none.

    ``sizes``: the attributes to which it is proportional, one of them or all; a ``phase``, where it has one, is that of its schedule.
    """

    length: float | None
    sizes: ClassVar[tuple[str, ...]] = ()
    phase: float | None = None

    @property
    def duration(self) -> float:
        """Return how long it lasts in s."""
        schedule = find_schedule(self)
        if schedule is not None:
            return float(schedule.times[-1])
        assert self.length is not None
        return self.length

    @abstractmethod
    def pieces(self) -> list[Pieces]:
        """Return its pieces, a record for each tone."""

    def member(self, other: Member) -> Self:
        """Return the load of a member of an ensemble."""
        changed = {
            name: other.factor * getattr(self, name)
            for name in self.sizes
            if getattr(self, name) is not None
        }
        if self.phase is not None:
            changed["phase"] = self.phase + other.phase
        return replace(self, **changed)  # type: ignore[type-var]

    def base_velocity(self) -> float:
        """Return the base's velocity in m/s at time 0 with which its mean velocity is zero; 0 where it does not move, or only after a pulse."""
        return 0.0


def lines_between(times: Array, values: Array, moves_base: bool) -> Pieces:
    """Return straight lines between values (K,) at times (K,), which may have one time twice: a jump."""
    steps = np.diff(times)
    rising = steps > 0
    rows = np.zeros((int(np.sum(rising)), 9))
    rows[:, 3] = values[:-1][rising]
    rows[:, 5] = (np.diff(values)[rising]) / steps[rising]
    return Pieces(np.append(times[:-1][rising], times[-1]), rows, moves_base)


@dataclass(frozen=True, eq=False)
class Shock(Load):
    """A pulse of a ``peak`` in N or m/s^2 that takes ``width`` seconds, then nothing until ``length``; a trapezoid rises and falls in ``rise`` s.

    A sawtooth has its peak at its end (terminal-peak sawtooth, IEC 60068-2-27): it rises in a
    straight line over its width and drops to zero at once. A base is at rest before a pulse.
    """

    pulse: str
    peak: float
    width: float
    length: float
    rise: float | None = None
    quantity: str = FORCE_QUANTITY
    sizes: ClassVar[tuple[str, ...]] = ("peak",)

    def __post_init__(self) -> None:
        keep_checked(
            self,
            pulse=word_of(PULSES),
            quantity=word_of(QUANTITIES),
            peak=finite,
            width=positive,
            length=positive,
        )
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
            keep_checked(self, rise=partial(non_negative, most=self.width / 2))

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
    """A structure that is struck at a ``place``, "force" or "absorber", just before time 0, and left alone for ``length`` s.

    The place then has the ``velocity`` (m/s), and the modes of the bare structure what an impulse of velocity / sum(shape^2) N s there leaves them:
    the mobility of a place grows with the number of modes kept.
    """

    velocity: float
    length: float
    place: str = STRIKE_PLACES[0]
    sizes: ClassVar[tuple[str, ...]] = ("velocity",)

    def __post_init__(self) -> None:
        keep_checked(self, velocity=finite, length=positive, place=word_of(STRIKE_PLACES))

    @property
    def width(self) -> float:
        """Duration of the pulse in s, 0."""
        return 0.0

    def pieces(self) -> list[Pieces]:
        """Return a load of zero: the strike itself is part of the state at time 0."""
        return [Pieces(np.array([0.0, self.length]), np.zeros((1, 9)), False)]

    def modal_velocity(self, model: ModalModel) -> Array:
        """Return the velocities (N_m,) in sqrt(kg) m/s that it leaves."""
        shape = model.force_shape if self.place == "force" else model.tip_shape
        size = float(np.sum(shape**2))
        require(size > 0, "place", self.place, "where a mode moves")
        return np.asarray(self.velocity / size * shape)


def find_schedule(load: Load) -> FrequencySchedule | None:
    """Return a load's frequency over time, None where it has none."""
    return getattr(load, "schedule", None)


def _schedule_pieces(
    schedule: FrequencySchedule, order: float, phase: float, coefficients: Array, moves_base: bool
) -> Pieces:
    """Return a load that turns ``order`` times as fast as a schedule; ``coefficients`` (K - 1, 6) as in `Pieces`."""
    omegas = order * schedule.omegas
    steps = np.diff(schedule.times)
    phases = phase + order * schedule.phase_at(schedule.times)
    return Pieces(
        schedule.times,
        np.column_stack([omegas[:-1], np.diff(omegas) / steps, phases[:-1], coefficients]),
        moves_base,
    )


def _constant_coefficients(schedule: FrequencySchedule, amplitude: float) -> Array:
    coefficients = np.zeros((len(schedule.times) - 1, 6))
    coefficients[:, 0] = amplitude
    return coefficients


def _squared_coefficients(schedule: FrequencySchedule, factor: float) -> Array:
    """Return the coefficients of ``factor`` omega(t)^2."""
    coefficients = np.zeros((len(schedule.times) - 1, 6))
    omega = schedule.omegas[:-1]
    rate = np.diff(schedule.omegas) / np.diff(schedule.times)
    coefficients[:, 0] = factor * omega**2
    coefficients[:, 2] = 2 * factor * omega * rate
    coefficients[:, 4] = factor * rate**2
    return coefficients


@dataclass(frozen=True, eq=False)
class Force(Load):
    """The harmonic force of a `Drive`, beside other loads."""

    drive: Drive

    def __post_init__(self) -> None:
        keep_checked(self, drive=kind_of(Drive))

    @property
    def schedule(self) -> FrequencySchedule:
        """Return its frequency over time."""
        return self.drive.schedule

    def pieces(self) -> list[Pieces]:
        """Return its pieces."""
        return [
            _schedule_pieces(
                self.schedule,
                1.0,
                self.drive.phase,
                _constant_coefficients(self.schedule, self.drive.amplitude),
                False,
            )
        ]

    def member(self, other: Member) -> Force:
        """Return the load of a member of an ensemble."""
        return Force(
            replace(
                self.drive,
                amplitude=other.factor * self.drive.amplitude,
                phase=self.drive.phase + other.phase,
            )
        )


@dataclass(frozen=True, eq=False)
class Unbalance(Load):
    """A rotor's unbalance U (kg m) at the force's place: U omega(t)^2 cos(integral of omega + phase), a run-up or a run-down.

    The tangential part, U times the rate of omega, is left out: it is smaller by rate over omega^2.
    """

    unbalance: float
    schedule: FrequencySchedule
    phase: float = 0.0
    sizes: ClassVar[tuple[str, ...]] = ("unbalance",)

    def __post_init__(self) -> None:
        keep_checked(self, unbalance=finite, phase=finite, schedule=kind_of(FrequencySchedule))

    def pieces(self) -> list[Pieces]:
        """Return its pieces."""
        return [
            _schedule_pieces(
                self.schedule,
                1.0,
                self.phase,
                _squared_coefficients(self.schedule, self.unbalance),
                False,
            )
        ]


@dataclass(frozen=True, eq=False)
class ShakenBase(Load):
    """A base whose ``acceleration`` (m/s^2) or ``displacement`` (m) is that amplitude times cos(integral of omega + phase)."""

    schedule: FrequencySchedule
    acceleration: float | None = None
    displacement: float | None = None
    phase: float = 0.0
    sizes: ClassVar[tuple[str, ...]] = ("acceleration", "displacement")

    def __post_init__(self) -> None:
        keep_checked(self, schedule=kind_of(FrequencySchedule))
        names = [
            name for name in ("acceleration", "displacement") if getattr(self, name) is not None
        ]
        require(
            len(names) == 1,
            "acceleration",
            self.acceleration,
            "given, or a displacement in its place: one of the two",
        )
        keep_checked(self, **dict.fromkeys((*names, "phase"), finite))

    def pieces(self) -> list[Pieces]:
        """Return its pieces; of a displacement U cos(phase) the acceleration is -U (omega^2 cos(phase) + rate sin(phase))."""
        if self.acceleration is not None:
            return [
                _schedule_pieces(
                    self.schedule,
                    1.0,
                    self.phase,
                    _constant_coefficients(self.schedule, self.acceleration),
                    True,
                )
            ]
        assert self.displacement is not None
        coefficients = _squared_coefficients(self.schedule, -self.displacement)
        coefficients[:, 1] = (
            self.displacement * np.diff(self.schedule.omegas) / np.diff(self.schedule.times)
        )
        return [_schedule_pieces(self.schedule, 1.0, self.phase, coefficients, True)]

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
    """A tone: ``amplitude`` in N or m/s^2, ``phase`` in rad, and either ``frequency`` in Hz or, of a schedule, ``order``."""

    amplitude: float
    frequency: float | None = None
    order: float | None = None
    phase: float = 0.0

    def __post_init__(self) -> None:
        keep_checked(self, amplitude=finite, phase=finite)
        require(
            (self.frequency is None) != (self.order is None),
            "frequency",
            self.frequency,
            "given, or an order in its place: one of the two",
        )
        names = "order" if self.frequency is None else "frequency"
        keep_checked(self, **{names: positive})


@dataclass(frozen=True, eq=False)
class Tones(Load):
    """Several tones at once: of fixed frequencies for a ``duration`` in s, or all of them orders of a ``schedule``."""

    tones: tuple[Tone, ...]
    length: float | None = None
    schedule: FrequencySchedule | None = None
    quantity: str = FORCE_QUANTITY

    def __post_init__(self) -> None:
        keep_checked(self, tones=each_of(kind_of(Tone)))
        require(len(self.tones) > 0, "tones", self.tones, "one or more")
        keep_checked(self, quantity=word_of(QUANTITIES), schedule=kind_of(FrequencySchedule | None))
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
            keep_checked(self, length=positive)
        else:
            require(self.length is None, "length", self.length, "left out beside a schedule")

    def pieces(self) -> list[Pieces]:
        """Return the pieces of each tone."""
        return [
            _schedule_pieces(
                *self._turning(tone),
                tone.phase,
                _constant_coefficients(self._turning(tone)[0], tone.amplitude),
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
        """Return the load of a member of an ensemble: every tone has a phase of its own."""
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
