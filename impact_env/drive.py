"""Frequency schedules, the base class of loads, and the harmonic force.

A schedule is the frequency over time: constant, a linear sweep, or any piecewise-linear function.

Every load consists of pieces (`Pieces`), which the kernels read (`kernels/motion/loads.py`):
between two breakpoints it is Re((c0 + c1 u + c2 u^2) exp(i (phi + omega u + alpha u^2/2))), with
the time u since the first of the two. Only a `Drive` alone is not split into pieces.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    finite,
    instance,
    kind_of,
    labelled,
    listed,
    non_negative,
    or_none,
    positive,
    require,
    row_of,
    text,
)
from impact_env.fields import check_fields, parameter
from impact_env.modes import ModalModel
from impact_env.parameters import Beam
from impact_env.scene import InitialState, Scene

Array = NDArray[np.float64]
LOAD_STARTS = ("middle", "lower-wall", "base-mean-rest")
PAPER_RATE = 1.0  # percent of the resonance frequency per 100 pseudo periods
PAPER_LIMITS = (0.9, 1.06)  # of the resonance frequency
assert isinstance(Beam.damping_ratio, float)
PAPER_DAMPING = Beam.damping_ratio
# ten times the longest default sweep, that of a tuned absorber on a resonance without damping:
# hours for one run
MOST_PERIODS = 1e9
# of a reference frequency in rad/s, and how much faster a force may be
LOWEST_OMEGA = 1e-20
HIGHEST_OMEGA = 1e20
MOST_RATIO = 1e9
LEAST_DAMPING = 1e-4  # the sweep of an undamped resonance would never end


ALLOWED_TIMES = "two or more finite times in s, strictly rising from 0"


def check_reference(_name: str, value: object) -> float:
    """Return the reference frequency of a pseudo period in rad/s as a float."""
    return positive("reference frequency", value, LOWEST_OMEGA, HIGHEST_OMEGA)


@dataclass(frozen=True, eq=False)
class FrequencySchedule:
    """Circular frequency over time in straight lines.

    Parameters
    ----------
    times : array_like, (K,)
        Times in s, strictly rising from 0, K >= 2.
    omegas : array_like, (K,)
        Circular frequencies in rad/s at these times.
    reference : float
        Circular frequency of the resonance in rad/s. It defines the pseudo period 2 pi/reference
        and the frequency ratio omega/reference.

    Raises
    ------
    ParameterError
        Times do not rise from 0, lengths differ, or a value is out of range.

    Examples
    --------
    >>> from impact_env import FrequencySchedule
    >>> schedule = FrequencySchedule([0.0, 10.0, 20.0], [90.0, 100.0, 100.0], reference=100.0)
    >>> float(schedule.omega_at(5.0))
    95.0
    """

    times: NDArray[np.float64] = field(metadata=parameter(row_of(ALLOWED_TIMES), unit="s"))
    omegas: NDArray[np.float64] = field(metadata=parameter(unit="rad/s"))
    reference: float = field(metadata=parameter(check_reference, unit="rad/s"))

    def __post_init__(self) -> None:
        check_fields(self)
        times = self.times
        ok = len(times) >= 2 and times[0] == 0 and bool(np.all(np.diff(times) > 0))
        require(ok, "times", times, ALLOWED_TIMES)
        allowed = f"a finite frequency in rad/s, 0 or above, for each of the {len(times)} times"
        check_fields(self, omegas=row_of(allowed))
        ok = self.omegas.shape == times.shape and bool(np.all(self.omegas >= 0))
        require(ok, "omegas", self.omegas, allowed)
        allowed = (
            f"at most {MOST_PERIODS:g} pseudo periods of the reference frequency, not "
            f"{self.periods:g}"
        )
        require(self.periods <= MOST_PERIODS * (1 + 1e-12), "times", self.times, allowed)

    @property
    def pseudo_period(self) -> float:
        """Pseudo period 2 pi / reference in s."""
        return 2 * np.pi / self.reference

    @property
    def periods(self) -> float:
        """Duration in pseudo periods."""
        return float(self.times[-1]) / self.pseudo_period

    def omega_at(self, time: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return the circular frequency in rad/s at times in s."""
        return np.asarray(np.interp(time, self.times, self.omegas))

    def phase_at(self, time: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return the integral of the circular frequency in rad at times in s."""
        steps = np.diff(self.times)
        starts = np.concatenate(
            [[0.0], np.cumsum(steps * (self.omegas[1:] + self.omegas[:-1]) / 2)]
        )
        k = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(steps) - 1)
        tau = np.asarray(time) - self.times[k]
        slope = np.diff(self.omegas)[k] / steps[k]
        return np.asarray(starts[k] + (self.omegas[k] + slope * tau / 2) * tau)

    def between(self, start: float, stop: float) -> FrequencySchedule:
        """Return the part of this schedule between two times in s.

        The times must satisfy 0 <= start < stop <= end of the schedule. Times of the result are
        counted from ``start``.

        Raises ParameterError for times outside of the schedule or out of order.
        """
        end = float(self.times[-1])
        start = finite("start of the part", start)
        stop = finite("end of the part", stop)
        require(0 <= start < end, "start of the part", start, f"from 0 s to below {end:g} s")
        require(
            start < stop <= end * (1 + 1e-12),
            "end of the part",
            stop,
            f"above {start:g} s and at most {end:g} s",
        )
        inside = (self.times > start) & (self.times < stop)
        times = np.concatenate([[start], self.times[inside], [stop]])
        return FrequencySchedule(times - start, self.omega_at(times), self.reference)


def linear_sweep(
    reference: float,
    start_ratio: float = PAPER_LIMITS[0],
    stop_ratio: float = PAPER_LIMITS[1],
    percent_per_100_periods: float = PAPER_RATE,
) -> FrequencySchedule:
    """Return a linear sweep of the frequency (paper, section 3.3).

    Parameters
    ----------
    reference : float
        Circular frequency of the resonance in rad/s. It defines the pseudo period 2 pi/reference.
    start_ratio, stop_ratio : float, optional
        First and last frequency as ratios to the reference. The sweep goes up or down accordingly.
    percent_per_100_periods : float, optional
        Sweep rate in % of the reference per 100 pseudo periods, above 0.

    Returns
    -------
    FrequencySchedule
        The frequency over time, from time 0.

    Raises
    ------
    ParameterError
        Both ratios are equal, a value is out of range, or the sweep would take more than 1e9 pseudo
        periods.

    Examples
    --------
    >>> from impact_env import linear_sweep
    >>> schedule = linear_sweep(100.0, 0.9, 1.0, 1.0)
    >>> schedule.omegas.tolist()
    [90.0, 100.0]
    >>> round(schedule.periods)
    1000
    """
    reference = positive("reference frequency", reference, LOWEST_OMEGA, HIGHEST_OMEGA)
    start = non_negative("start ratio", start_ratio, MOST_RATIO)
    stop = non_negative("stop ratio", stop_ratio, MOST_RATIO)
    require(
        start != stop,
        "stop ratio",
        stop_ratio,
        "different from the start ratio (use constant_frequency for a fixed one)",
    )
    rate = positive("percent_per_100_periods", percent_per_100_periods)
    periods = abs(stop - start) * 100 * 100 / rate
    least = rate * periods / MOST_PERIODS
    allowed = (
        f"{least:.3g} or more from start ratio {start:g} to stop ratio {stop:g}, which else takes "
        f"more than {MOST_PERIODS:g} pseudo periods"
    )
    require(periods <= MOST_PERIODS, "percent_per_100_periods", rate, allowed)
    return FrequencySchedule(
        np.array([0.0, periods * 2 * np.pi / reference]),
        np.array([start, stop]) * reference,
        reference,
    )


def default_rate(model: ModalModel, resonances: Iterable[int] = (1,)) -> float:
    """Return the sweep rate that suits a model near ``resonances`` (counted from 1).

    The rate is in % of the resonance per 100 pseudo periods.

    A resonance of damping ratio D builds up in about 1/(D omega), and the frequency crosses its
    width 2 D omega at a rate r in 2 D omega/r; their ratio depends on r/(D omega)^2 alone. The
    paper's rate suits its damping of 1 %, so the default is proportional to the square of the
    damping. It is never faster than the paper's, because damping does not shorten the time scales
    of impacts. Of several resonances the least damped one counts, and a damping ratio below 1e-4
    counts as 1e-4. Raises ParameterError for a resonance that the model lacks.
    """
    model = instance("model", model, ModalModel)
    ratios = [
        float(model.damping_ratio[model.check_resonance(k) - 1])
        for k in listed("resonances", resonances)
    ]
    require(len(ratios) > 0, "resonances", ratios, "one or more")
    return PAPER_RATE * min(1.0, max(min(ratios), LEAST_DAMPING) / PAPER_DAMPING) ** 2


def constant_frequency(reference: float, ratio: float, periods: float) -> FrequencySchedule:
    """Return a constant frequency.

    Parameters
    ----------
    reference : float
        Circular frequency of the resonance in rad/s. It defines the pseudo period 2 pi/reference.
    ratio : float
        Frequency as a ratio to the reference.
    periods : float
        Duration in pseudo periods.

    Returns
    -------
    FrequencySchedule
        The frequency over time, from time 0.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import constant_frequency
    >>> constant_frequency(100.0, 0.98, 50.0).omegas.tolist()
    [98.0, 98.0]
    """
    reference = positive("reference frequency", reference, LOWEST_OMEGA, HIGHEST_OMEGA)
    duration = positive("periods", periods, most=MOST_PERIODS) * 2 * np.pi / reference
    return FrequencySchedule(
        np.array([0.0, duration]),
        np.full(2, non_negative("ratio", ratio, MOST_RATIO) * reference),
        reference,
    )


@dataclass(frozen=True, eq=False)
class Pieces:
    """A load as harmonic pieces with polynomial amplitudes, between breakpoints.

    Attributes
    ----------
    times : array, (K,)
        Breakpoints in s, from 0.
    rows : array, (K - 1, 9)
        Of each piece: circular frequency at its start (rad/s), rate of the frequency (rad/s^2),
        phase at its start (rad), then real and imaginary parts of c0, c1 and c2 (see the module),
        with time in s. They are forces in N, or accelerations of the base in m/s^2.
    moves_base : bool
        Whether the load is an acceleration of the base.
    place : str or None
        Name of the place of a force that acts elsewhere than the structure's (`Load.force_place`).
    channel : int
        Number of the kernels' force channel, see `impact_env.force_channels`.
    """

    times: Array
    rows: Array
    moves_base: bool
    place: str | None = None
    channel: int = 0

    @property
    def highest_omega(self) -> float:
        """Highest frequency (rad/s) of the harmonic pieces that are not zero, 0 without any."""
        rows = self.rows
        if not rows[:, :2].any():  # a record
            return 0.0
        acts = np.any(rows[:, 3:] != 0, axis=1)
        ends = np.maximum(rows[:, 0], rows[:, 0] + rows[:, 1] * np.diff(self.times))
        return float(np.max(ends[acts], initial=0.0))


@dataclass(frozen=True)
class Member:
    """The random part of a member of an ensemble.

    Attributes
    ----------
    number : int
        Number of the member, which seeds random records and the phases of tones; 0 stands for the
        load itself.
    phase : float
        Phase in rad, added to that of a load with a schedule.
    factor : float
        Factor of the amplitude.
    """

    number: int = 0
    phase: float = 0.0
    factor: float = 1.0


class Load(ABC):
    """A load on a structure, or a motion of its base, over a time.

    Attributes
    ----------
    length : float or None
        Duration in s of a load without a schedule.
    sizes : tuple of str, class variable
        Names of the attributes to which the load is proportional. None of them is multiplied by an
        ensemble's factor if its value is None.
    phase : float or None
        Phase in rad at time 0 of a load with a schedule.
    force_place : str or None
        Name of the place (`ModalModel.with_force_places`) at which a force acts; None: at the
        structure's own place of the force.
    """

    length: float | None
    sizes: ClassVar[tuple[str, ...]] = ()
    phase: float | None = None
    force_place: str | None = None

    @property
    def duration(self) -> float:
        """Duration of the load in s: that of its schedule, or else its ``length``."""
        schedule = find_schedule(self)
        if schedule is not None:
            return float(schedule.times[-1])
        assert self.length is not None
        return self.length

    @abstractmethod
    def pieces(self) -> list[Pieces]:
        """Return the load as pieces, one object for each tone."""

    def member(self, other: Member) -> Self:
        """Return this load with the phase and the amplitude of a member of an ensemble."""
        changed = {
            name: other.factor * getattr(self, name)
            for name in self.sizes
            if getattr(self, name) is not None
        }
        if self.phase is not None:
            changed["phase"] = self.phase + other.phase
        return replace(self, **changed)  # type: ignore[type-var]

    def base_velocity(self) -> float:
        """Return the base's velocity in m/s at time 0 for which its mean velocity is zero.

        The velocity is 0 for a fixed base, and for a base that is at rest before a pulse.
        """
        return 0.0


def find_schedule(load: Load) -> FrequencySchedule | None:
    """Return a load's frequency over time, None where it has none."""
    return getattr(load, "schedule", None)


class Excitation(Load):
    """The complete excitation of a run: a `Drive`, or `Loads`.

    Attributes
    ----------
    schedule : FrequencySchedule
        Frequency over time to which responses refer. It ends with the run, and its reference
        defines the pseudo period.
    parts : tuple of Load
        The loads that act together.
    start : str or InitialState
        State at time 0, or the name of a start, see `Loads`.
    in_pieces : bool, class variable
        Whether kernels read the load as `Pieces`, instead of as one force with a schedule.
    """

    start: str | InitialState = LOAD_STARTS[0]
    in_pieces: ClassVar[bool]

    if (
        TYPE_CHECKING
    ):  # fields or properties of its classes; a property here would be a field's default

        @property
        def schedule(self) -> FrequencySchedule:
            """Frequency over time."""

        @property
        def parts(self) -> tuple[Load, ...]:
            """The loads that act together."""

    @property
    @abstractmethod
    def moves_base(self) -> bool:
        """Whether the base moves."""

    @property
    @abstractmethod
    def highest_omega(self) -> float:
        """Highest frequency (rad/s) of the harmonic parts that are not zero, 0 without any."""

    @property
    @abstractmethod
    def highest_lasting_omega(self) -> float:
        """`highest_omega` without records, random loads, shocks and strikes."""

    @abstractmethod
    def initial_state(self, scene: Scene, initial: InitialState | None) -> InitialState:
        """Return the state of a run at time 0, with the velocities that strikes add.

        The state is ``initial``, or the start of the loads if ``initial`` is None. Raises
        ParameterError if both are given, or if the scene has no such start.
        """

    @abstractmethod
    def describe(self, *, phase: bool = True) -> str:
        """Return the load's amplitude as text, with or without the phase."""


def schedule_pieces(
    schedule: FrequencySchedule, order: float, phase: float, coefficients: Array, moves_base: bool
) -> Pieces:
    """Return a load whose frequency is ``order`` times that of a schedule.

    ``phase`` in rad is that at time 0. ``coefficients`` (K - 1, 6) are real and imaginary parts of
    c0, c1 and c2 of each piece (`Pieces`).
    """
    omegas = order * schedule.omegas
    steps = np.diff(schedule.times)
    phases = phase + order * schedule.phase_at(schedule.times)
    return Pieces(
        schedule.times,
        np.column_stack([omegas[:-1], np.diff(omegas) / steps, phases[:-1], coefficients]),
        moves_base,
    )


def constant_coefficients(schedule: FrequencySchedule, amplitude: float) -> Array:
    """Return the coefficients (K - 1, 6) of a constant amplitude."""
    coefficients = np.zeros((len(schedule.times) - 1, 6))
    coefficients[:, 0] = amplitude
    return coefficients


@dataclass(frozen=True, eq=False)
class Drive(Excitation):
    """Harmonic force F(t) = amplitude cos(integral of omega + phase) (paper, Eq. exc).

    Parameters
    ----------
    amplitude : float
        Force amplitude in N.
    schedule : FrequencySchedule
        Circular frequency omega over time, see `linear_sweep` and `constant_frequency`.
    phase : float, optional
        Phase in rad at time 0.
    force_place : str, optional
        Name of the place of the structure at which the force acts, for a drive that is one of
        `Loads`. None: the structure's own place of the force.

    Raises
    ------
    ParameterError
        A value is not finite, or ``schedule`` is not a FrequencySchedule.

    Examples
    --------
    >>> from impact_env import Drive, constant_frequency
    >>> Drive(3.5, constant_frequency(252.3, 1.0, 100.0)).amplitude
    3.5
    """

    amplitude: float = field(metadata=parameter(labelled("force amplitude", finite), unit="N"))
    schedule: FrequencySchedule = field(metadata=parameter(kind_of(FrequencySchedule)))
    phase: float = field(default=0.0, metadata=parameter(finite, unit="rad"))
    force_place: str | None = field(default=None, metadata=parameter(or_none(text), name="place"))
    sizes: ClassVar[tuple[str, ...]] = ("amplitude",)
    in_pieces: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_fields(self)

    def pieces(self) -> list[Pieces]:
        """Return the force as pieces, for a run with further loads."""
        coefficients = constant_coefficients(self.schedule, self.amplitude)
        return [schedule_pieces(self.schedule, 1.0, self.phase, coefficients, False)]

    @property
    def parts(self) -> tuple[Load, ...]:
        """The force itself."""
        return (self,)

    @property
    def moves_base(self) -> bool:
        """Whether the base moves: no."""
        return False

    @property
    def highest_omega(self) -> float:
        """Highest frequency in rad/s, 0 without a force."""
        return float(np.max(self.schedule.omegas)) if self.amplitude != 0 else 0.0

    @property
    def highest_lasting_omega(self) -> float:
        """Highest frequency in rad/s, 0 without a force."""
        return self.highest_omega

    def initial_state(self, _scene: Scene, initial: InitialState | None) -> InitialState:
        """Return the state at time 0 of a run: ``initial``, or rest."""
        return InitialState() if initial is None else initial

    def describe(self, *, phase: bool = True) -> str:
        """Return amplitude and phase as text."""
        return f"{self.amplitude:g} N{f', phase {self.phase:g} rad' if phase else ''}"

    def between(self, start: float, stop: float) -> Drive:
        """Return the part of this drive between two times in s.

        The result is a drive of its own, which begins at time 0.

        A run over ``between(0, t)``, and one over ``between(t, end)`` that starts from the first
        run's `Response.final_state`, are the whole run up to rounding.

        Raises ParameterError for times outside of the schedule or out of order.

        Examples
        --------
        >>> from impact_env import Drive, linear_sweep
        >>> sweep = Drive(2.0, linear_sweep(100.0, 0.9, 1.1))
        >>> second_half = sweep.between(sweep.schedule.times[-1] / 2, sweep.schedule.times[-1])
        >>> float(second_half.schedule.omegas[0])
        100.0
        """
        schedule = self.schedule.between(start, stop)
        return Drive(self.amplitude, schedule, self._phase_at(start), self.force_place)

    def followed_by(self, schedule: FrequencySchedule) -> Drive:
        """Return the force that continues over ``schedule`` after the end of this drive.

        It has this drive's amplitude, and starts with the phase at this drive's end.
        """
        phase = self._phase_at(float(self.schedule.times[-1]))
        return Drive(self.amplitude, schedule, phase, self.force_place)

    def _phase_at(self, time: float) -> float:
        """Return the phase in rad at a time in s."""
        return self.phase + float(self.schedule.phase_at(time))
