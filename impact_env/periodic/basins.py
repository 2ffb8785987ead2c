"""Basins of attraction: the motions on which runs from random initial states end, and their shares.

Shares have 95 % intervals.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from impact_env.checks import count, non_negative, positive, require
from impact_env.periodic.attractors import (
    MotionKind,
    SettledMotion,
    SettleOptions,
    change_parameter,
    feature_distance,
    group_motions,
    judge_motion,
    parameter_of,
    settle_runs,
)
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.orbit import Orbit, mirror_orbit
from impact_env.periodic.passage import RECORD
from impact_env.periodic.residence import ExitRate, ResidenceTimes, exit_rate
from impact_env.periodic.shooting import units_of
from impact_env.periodic.survey import (
    MOST_MULTIPLE,
    RETURN_TOL,
    find_return,
    is_same_orbit,
    least_multiple,
    orbit_next_to,
)
from impact_env.scene import InitialState
from impact_env.sweep import simulate

Array = NDArray[np.float64]
RunProgress = Callable[[int, int], None]
DEFAULT_RUNS = 16
LEAST_RUNS = 1
MOST_PERIODS_OF_RUN = 2000  # of the force
CHECKED_SHARES = (0.125, 0.25, 0.5, 1.0)  # of the periods: where a run is compared with orbits
CAPTURE_TOL = 1e-6  # of gap and gap times omega: a run so close to a stable orbit stays there
START_REACH = 1.5  # of the larger of gap and tip displacements: how far initial states reach
BASIN_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Share:
    """The share of ``runs`` that ``ended`` on a motion, with Wilson's 95 % interval."""

    ended: int
    runs: int

    @property
    def value(self) -> float:
        """The share."""
        return self.ended / self.runs

    @property
    def low(self) -> float:
        """Lower limit of the interval."""
        return self._interval()[0]

    @property
    def high(self) -> float:
        """Upper limit of the interval."""
        return self._interval()[1]

    def _interval(self) -> tuple[float, float]:
        result = scipy.stats.binomtest(self.ended, self.runs).proportion_ci(
            BASIN_CONFIDENCE, method="wilson"
        )
        return float(result.low), float(result.high)

    def to_plain(self) -> dict[str, Any]:
        """Return the number of runs that ended there, the share, and the limits of its interval."""
        return {"ended": self.ended, "share": self.value, "low": self.low, "high": self.high}


@dataclass(frozen=True, eq=False)
class Basins:
    """The motions on which runs from random initial states end.

    A run ends after ``periods`` of the force, or earlier at a stable orbit.

    Attributes
    ----------
    orbits : tuple of Orbit
        Stable orbits with impacts on which runs ended.
    ended : tuple of int
        Number of runs that ended on each of these orbits.
    without_impacts : int
        Number of runs whose impacts had ceased.
    nothing_periodic : int
        Number of all other runs: chaotic, quasi-periodic, of a longer period, or not yet settled.
    periods : int
        Length of the runs in periods of the force.
    seed : int
        Seed of the initial states.
    """

    orbits: tuple[Orbit, ...]
    ended: tuple[int, ...]
    without_impacts: int
    nothing_periodic: int
    periods: int
    seed: int

    @property
    def runs(self) -> int:
        """Number of runs."""
        return sum(self.ended) + self.without_impacts + self.nothing_periodic

    def share_of(self, orbit: Orbit) -> Share:
        """Return the share of the runs that ended on an orbit."""
        number = sum(
            number
            for other, number in zip(self.orbits, self.ended, strict=True)
            if is_same_orbit(orbit, other)
        )
        return Share(number, self.runs)

    @property
    def share_without_impacts(self) -> Share:
        """The share of the runs that ended without impacts."""
        return Share(self.without_impacts, self.runs)

    @property
    def share_of_nothing_periodic(self) -> Share:
        """The share of the runs that ended neither on an orbit with impacts nor without impacts."""
        return Share(self.nothing_periodic, self.runs)

    def to_plain(self, orbit: Orbit) -> dict[str, Any]:
        """Return the share of an orbit, and of the runs that ended on none, as plain values."""
        return {
            "runs": self.runs,
            "periods": self.periods,
            "seed": self.seed,
            **self.share_of(orbit).to_plain(),
            "without_impacts": self.share_without_impacts.to_plain(),
            "nothing_periodic": self.share_of_nothing_periodic.to_plain(),
        }


def draw_start(case: Case, reach: float, rng: np.random.Generator) -> tuple[Array, float]:
    """Return a random state (2 N_m + 2,) and phase of the force in rad.

    All are uniform. The phase lies in one turn and the relative displacement within the clearance.
    The relative velocity lies within +- ``reach`` (m) times the force's frequency. Each mode's
    velocity at the tip lies within +- ``reach`` times the first resonance's frequency, and its
    displacement within that limit over its own frequency.
    """
    model = case.model
    largest = float(np.max(np.abs(model.tip_shape))) or 1.0
    velocity = reach * float(model.omega[0]) / largest * rng.uniform(-1, 1, model.modes)
    displacement = (
        reach * float(model.omega[0]) / (largest * model.omega) * rng.uniform(-1, 1, model.modes)
    )
    shape = model.tip_shape
    absorber = float(shape @ displacement) + case.gap * rng.uniform(-1, 1)
    rate = float(shape @ velocity) + reach * case.omega * rng.uniform(-1, 1)
    state = np.concatenate([displacement, [absorber], velocity, [rate]])
    return state, float(rng.uniform(0, 2 * np.pi))


def find_basins(
    case: Case,
    known: Sequence[Orbit] = (),
    starts: int = DEFAULT_RUNS,
    periods: int = MOST_PERIODS_OF_RUN,
    seed: int = 0,
    most_multiple: int = MOST_MULTIPLE,
    reach: float | None = None,
    progress: RunProgress | None = None,
) -> Basins:
    """Return the motions on which runs from random initial states end.

    Newton's method computes the orbit that a run approaches.

    Parameters
    ----------
    case
        Structure, absorber, force and frequency.
    known
        Orbits that are known already, such as those of branches.
    starts
        Number of runs, each from a state of its own (see `draw_start`).
    periods
        Length of each run in periods of the force; a run ends earlier at a stable orbit.
    seed
        Of the random states.
    most_multiple
        The longest period sought, in periods of the force.
    reach
        How far initial states reach, in m. None: 1.5 times the larger of the clearance and the
        known orbits' tip displacements.
    progress
        Called with the number of finished runs and of all.

    Returns
    -------
    Basins
        Orbits, and the shares of the runs that end on each, without impacts, and on nothing
        periodic.

    Raises
    ------
    ParameterError
        For numbers out of range.
    """
    starts = count("starts", starts, LEAST_RUNS)
    periods = count("periods", periods, len(CHECKED_SHARES) * 2)
    seed = count("seed", seed, 0)
    most_multiple = count("most_multiple", most_multiple, 1)
    if reach is None:
        reach = START_REACH * max([case.gap, *(orbit.motion.tip_max for orbit in known)])
    reach = positive("reach", reach)
    stable = [orbit for orbit in known if orbit.stability.stable and len(orbit.impacts) > 0]
    ended = [0] * len(stable)
    silent = 0
    other = 0
    for k in range(starts):
        state, phase = draw_start(case, reach, np.random.default_rng([seed, k]))
        end = _find_attractor(case, state, phase, periods, most_multiple, stable)
        if isinstance(end, Orbit):
            place = next((j for j, orbit in enumerate(stable) if orbit is end), len(stable))
            if place == len(stable):
                image = () if end.schedule.symmetric else (mirror_orbit(end),)
                new = [end, *(orbit for orbit in image if isinstance(orbit, Orbit))]
                stable += new
                ended += [0] * len(new)
            ended[place] += 1
        elif end:
            silent += 1
        else:
            other += 1
        if progress is not None:
            progress(k + 1, starts)
    return Basins(tuple(stable), tuple(ended), silent, other, periods, seed)


def _find_attractor(
    case: Case,
    state: Array,
    phase: float,
    periods: int,
    most_multiple: int,
    stable: Sequence[Orbit],
) -> Orbit | bool:
    """Return the stable orbit with impacts on which a run ends.

    If the orbit is one of ``stable``, the object from there is returned. If there is no such orbit,
    the result is a bool: whether the run ends without impacts.
    """
    done = 0
    silent = False
    for share in CHECKED_SHARES:
        span = round(share * periods) - done
        done += span
        response = simulate(
            case.scene,
            case.drive(span * case.period, phase),
            initial=InitialState.from_vector(case.scene, state),
            record=RECORD,
        )
        state = response.end_state
        phase = (phase + 2 * np.pi * span) % (2 * np.pi)
        assert response.impacts is not None
        silent = bool(np.all(response.impacts.time < 0.5 * span * case.period))
        if silent:
            continue
        near = RETURN_TOL if done == periods else CAPTURE_TOL
        for orbit in stable:
            if distance_to(orbit, state, phase) < near:
                return orbit
        result = _find_orbit_near(case, state, phase, most_multiple)
        if result is not None and distance_to(result, state, phase) < near:
            return next((orbit for orbit in stable if is_same_orbit(orbit, result)), result)
    return silent


def _find_orbit_near(case: Case, state: Array, phase: float, most_multiple: int) -> Orbit | None:
    """Return the stable orbit with impacts next to a state that almost repeats.

    Of several orbits it is the one with the smallest period. None if there is none.
    """
    symmetric, multiple, _ = find_return(case, state, phase, most_multiple)
    if multiple == 0:
        return None
    result = orbit_next_to(case, phase, state, symmetric, multiple)
    if isinstance(result, Orbit) and least_multiple(result) != multiple:
        result = orbit_next_to(case, phase, state, symmetric, least_multiple(result))
    if isinstance(result, NoOrbit) or len(result.impacts) == 0 or not result.stability.stable:
        return None
    return result


def distance_to(orbit: Orbit, state: Array, phase: float) -> float:
    """Return the distance of a state (2 N_m + 2,) at a phase (rad) from an orbit.

    Displacements are over the gap, velocities over the gap times omega.
    """
    phases = phase + 2 * np.pi * np.arange(orbit.schedule.period_multiple)
    miss = np.abs(orbit.motion.states(phases) - state) / units_of(orbit.case)
    return float(np.min(np.max(miss, axis=1)))


MATCH_TOL = 0.3  # of the features of one attractor at neighbouring values of a parameter
BURN_IN = 100.0  # periods at a run's start that are left out of its lifetime
FRACTION_STARTS = 50


@dataclass(frozen=True)
class Lifetimes:
    """Lifetimes of a transient regime of impacts, in periods of the force, after a ``burn_in``.

    Attributes
    ----------
    ended : int
        Runs that ended on a periodic motion or on a motion without impacts, after the burn-in.
    censored : int
        Runs that did not: their lifetimes are at least as long as their observation.
    rate : ExitRate
        Maximum-likelihood exit rate per period with its 95 % interval.
    constant : float
        p-value of a constant rate: probability of a split of the exits between the first and the
        second half of the time at risk that is at least as uneven; NaN without exits. A small value
        means that lifetimes are not exponential.
    burn_in : float
        Periods left out at the start of each run.
    """

    ended: int
    censored: int
    rate: ExitRate
    constant: float
    burn_in: float

    @property
    def mean(self) -> float:
        """Mean lifetime in periods; infinite without exits."""
        return 1 / self.rate.rate if self.rate.rate > 0 else float("inf")

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the mean lifetime; its upper limit is infinite without exits."""
        low = 1 / self.rate.high if self.rate.high > 0 else float("nan")
        return low, 1 / self.rate.low if self.rate.low > 0 else float("inf")

    def to_plain(self) -> dict[str, Any]:
        """Return numbers by name; None stands for infinite ones."""
        values = {
            "rate_per_period": self.rate.rate,
            "rate_low": self.rate.low,
            "rate_high": self.rate.high,
            "mean_periods": self.mean,
            "mean_low": self.interval[0],
            "mean_high": self.interval[1],
            "constant_rate_p": self.constant,
        }
        plain = {name: float(x) if np.isfinite(x) else None for name, x in values.items()}
        return {
            "ended": self.ended,
            "censored": self.censored,
            "burn_in_periods": self.burn_in,
        } | plain


def fit_lifetimes(
    durations: Sequence[float], ended: Sequence[bool], burn_in: float = BURN_IN
) -> Lifetimes:
    """Return the exponential distribution of lifetimes of which some are censored.

    Parameters
    ----------
    durations
        Periods (n,) until each run ended or its observation stopped.
    ended
        Whether (n,) each run ended; the others are censored.
    burn_in
        Periods at the start of each run that are left out. Runs that ended earlier do not count.

    Returns
    -------
    Lifetimes
        Rate and mean with 95 % intervals, and a test of the rate's constancy.

    Raises
    ------
    ParameterError
        Rows of different lengths, or a negative number.

    Examples
    --------
    >>> from impact_env.periodic import fit_lifetimes
    >>> fit_lifetimes([300.0, 500.0, 1000.0], [True, True, False], burn_in=0.0).mean
    900.0
    """
    require(len(durations) == len(ended), "ended", len(ended), f"{len(durations)} values")
    burn_in = non_negative("burn_in", burn_in)
    times = np.array([non_negative("durations", float(x)) for x in durations])
    left = np.array(ended, dtype=np.bool_)
    rest = ResidenceTimes(times, left).after(burn_in)
    rate = exit_rate(ResidenceTimes(times, left), burn_in)
    return Lifetimes(
        int(np.sum(rest.ended)), int(np.sum(~rest.ended)), rate, _constancy(rest), burn_in
    )


def _constancy(rest: ResidenceTimes) -> float:
    """Return the two-sided p-value of a test for a constant rate of exits.

    The test compares the numbers of exits in the two halves of the time at risk, in the order of
    the runs' ages.
    """
    exits = rest.durations[rest.ended]
    if len(exits) == 0:
        return float("nan")
    low = 0.0
    high = float(np.max(rest.durations))
    for _ in range(60):  # the age at which half of the time at risk has passed
        middle = (low + high) / 2
        if np.sum(np.minimum(rest.durations, middle)) < np.sum(rest.durations) / 2:
            low = middle
        else:
            high = middle
    early = int(np.sum(exits <= high))
    return float(scipy.stats.binomtest(early, len(exits), 0.5).pvalue)


@dataclass(frozen=True, eq=False)
class Attractor:
    """An attractor at one point of the parameters; a mirror image counts as the same attractor.

    Attributes
    ----------
    label : int
        Number of the attractor, the same along a parameter.
    motion : SettledMotion
        A motion on it.
    share : Share
        Share of the runs that end on it.
    orbit : Orbit or None
        The periodic orbit, None for other kinds and if Newton's method does not converge.
    """

    label: int
    motion: SettledMotion
    share: Share
    orbit: Orbit | None = None

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and strings by name, with units in the names."""
        stable = None if self.orbit is None else self.orbit.stability.stable
        return (
            {"attractor": self.label}
            | self.share.to_plain()
            | {"stable": stable}
            | self.motion.to_plain()
        )


@dataclass(frozen=True, eq=False)
class BasinPoint:
    """Basin fractions at one value of a parameter.

    Attributes
    ----------
    case : Case
        Structure, absorber, force and frequency.
    parameter, value : str and float, or None
        The parameter and its value; None without parameter.
    attractors : tuple of Attractor
        Attractors by falling share. Those with share 0 were reached only from attractors at the
        previous value.
    lifetimes : Lifetimes
        Lifetimes of runs that end on periodic motions or without impacts; chaotic and undecided
        runs are censored.
    runs : int
        Number of runs from random initial states.
    """

    case: Case
    parameter: str | None
    value: float | None
    attractors: tuple[Attractor, ...]
    lifetimes: Lifetimes
    runs: int

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and strings by name, with units in the names."""
        return {
            "parameter": self.parameter,
            "value": self.value,
            "runs": self.runs,
            "attractors": [attractor.to_plain() for attractor in self.attractors],
            "lifetimes": self.lifetimes.to_plain(),
        }


def basin_fractions(
    case: Case,
    parameter: str | None = None,
    values: Sequence[float] = (),
    *,
    starts: int = FRACTION_STARTS,
    options: SettleOptions | None = None,
    reach: float | None = None,
    match_tolerance: float = MATCH_TOL,
    burn_in: float = BURN_IN,
    seed: int = 0,
    threads: int | None = None,
    progress: RunProgress | None = None,
) -> Iterator[BasinPoint]:
    """Yield the share of random initial states that ends on each attractor.

    The shares are computed at one point or along a parameter.

    At each value after the first, further runs begin on the attractors of the previous value. They
    decide which attractor continues which, and do not count for shares. An attractor has the label
    of the earlier attractor from which a run reaches it. Without such a run it has the label of the
    nearest earlier attractor, if the features of both differ by ``match_tolerance`` at most (see
    `attractors.feature_distance`).

    Parameters
    ----------
    case
        Structure, absorber, force and frequency.
    parameter
        One of "frequency" (over the first resonance), "force", "gap", "restitution",
        "friction-limit" and "mass-ratio"; None: only the case.
    values
        Values of the parameter, in SI units, in the order in which attractors are followed.
    starts
        Number of random initial states at each value (see `draw_start`), the same ones at all
        values.
    options
        How long runs are.
    reach
        How far initial states reach, in m. None: 1.5 times the gap.
    match_tolerance
        Largest difference of the features of one attractor at neighbouring values.
    burn_in
        Periods at the start of each run that are left out of lifetimes.
    seed
        Of the random states.
    threads
        Number of threads; the result does not depend on it. None: all cores.
    progress
        Called with the number of finished runs and of all runs at a value.

    Yields
    ------
    BasinPoint
        Attractors with their shares, and lifetimes.

    Raises
    ------
    ParameterError
        For numbers out of range.

    Examples
    --------
    >>> from impact_env import Beam, modal_model
    >>> from impact_env.periodic import Case, basin_fractions
    >>> model = modal_model(Beam(modes=1))
    >>> case = Case(model, 0.93 * float(model.omega[0]), 1.5, restitution=0.75)
    >>> (point,) = basin_fractions(case, starts=4)
    >>> [(attractor.motion.name, attractor.share.value) for attractor in point.attractors]
    [('period 1', 1.0)]
    """
    options = SettleOptions() if options is None else options
    starts = count("starts", starts, 1)
    seed = count("seed", seed, 0)
    match_tolerance = positive("match_tolerance", match_tolerance)
    if reach is not None:
        reach = positive("reach", reach)
    if parameter is None:
        cases = [case]
        require(len(values) == 0, "values", values, "none without a parameter")
    else:
        require(len(values) > 0, "values", values, "one or more numbers")
        cases = [change_parameter(case, parameter, float(value)) for value in values]
    latest: dict[int, SettledMotion] = {}
    current: list[int] = []
    for here in cases:
        random = [
            (
                here,
                *draw_start(
                    here, reach or START_REACH * here.gap, np.random.default_rng([seed, k])
                ),
            )
            for k in range(starts)
        ]
        led = [(here, latest[label].state, 0.0) for label in current]
        settled = settle_runs(
            [*random, *led], options, with_exponent=False, threads=threads, progress=progress
        )
        motions = [motion for motion in settled if motion is not None]
        if len(motions) < len(settled):
            raise KeyboardInterrupt
        groups = _judged_groups(motions, options)
        leads = {label: starts + k for k, label in enumerate(current)}
        labels = _match_groups(groups, motions, latest, leads, match_tolerance)
        attractors = [
            Attractor(
                label,
                motions[group[0]],
                Share(sum(k < starts for k in group), starts),
                motions[group[0]].orbit(),
            )
            for label, group in zip(labels, groups, strict=True)
        ]
        attractors.sort(key=lambda attractor: (-attractor.share.ended, attractor.label))
        latest |= {attractor.label: attractor.motion for attractor in attractors}
        current = sorted(attractor.label for attractor in attractors)
        value = None if parameter is None else parameter_of(here, parameter)
        lifetimes = _lifetimes_of(motions[:starts], burn_in)
        yield BasinPoint(here, parameter, value, tuple(attractors), lifetimes, starts)


def _judged_groups(motions: list[SettledMotion], options: SettleOptions) -> list[list[int]]:
    """Return the groups of motions, as lists of indices.

    The first motion of each group is replaced in ``motions`` by the same motion with its exponent.
    Groups whose first motions then have the same kind are merged.
    """
    groups = list(group_motions(motions))
    for group in groups:
        motions[group[0]] = judge_motion(motions[group[0]], options)
    judged = group_motions([motions[group[0]] for group in groups])
    return [[k for number in numbers for k in groups[number]] for numbers in judged]


def _match_groups(
    groups: Sequence[Sequence[int]],
    motions: Sequence[SettledMotion],
    latest: dict[int, SettledMotion],
    leads: dict[int, int],
    tolerance: float,
) -> list[int]:
    """Return a label for each group of motions; each label is used once.

    ``latest`` has the motion of each known label, and ``leads`` the label from which run k started,
    by k. A group has the label of the earlier attractor whose run ended in the group, or else of
    the nearest earlier attractor within ``tolerance``, or else a new label.
    """
    pairs = []
    for number, group in enumerate(groups):
        motion = motions[group[0]]
        for label, earlier in latest.items():
            silent = MotionKind.NO_IMPACTS in (motion.kind, earlier.kind)
            if silent and motion.kind is not earlier.kind:
                continue
            distance = feature_distance(motion, earlier)
            if distance <= tolerance:
                pairs.append((leads.get(label) not in group, distance, number, label))
    labels: dict[int, int] = {}
    for _, _, number, label in sorted(pairs):
        if number not in labels and label not in labels.values():
            labels[number] = label
    free = max(latest, default=0)
    for number in range(len(groups)):
        if number not in labels:
            free += 1
            labels[number] = free
    return [labels[number] for number in range(len(groups))]


def _lifetimes_of(motions: Sequence[SettledMotion], burn_in: float) -> Lifetimes:
    """Return the lifetimes of runs.

    Quasi-periodic runs are left out, because their capture has no definite time.
    """
    durations: list[float] = []
    ended: list[bool] = []
    for motion in motions:
        if motion.captured is not None:
            durations.append(float(motion.captured))
            ended.append(True)
        elif motion.kind is not MotionKind.QUASI_PERIODIC:
            durations.append(float(motion.periods))
            ended.append(False)
    return fit_lifetimes(durations, ended, burn_in)


@dataclass(frozen=True, eq=False)
class AttractorMap:
    """The motion on which one run ends at each point of two parameters.

    Attributes
    ----------
    names : (str, str)
        The parameters.
    first, second : array, (n,) and (m,)
        Their values.
    motions : tuple of tuple of SettledMotion or None
        n rows of m motions, None for runs that an interrupt prevented.
    """

    names: tuple[str, str]
    first: Array
    second: Array
    motions: tuple[tuple[SettledMotion | None, ...], ...]

    @property
    def complete(self) -> bool:
        """Whether all runs were made."""
        return all(motion is not None for row in self.motions for motion in row)

    def cells(self) -> Iterator[tuple[float, float, SettledMotion]]:
        """Yield both values and the motion of each run that was made."""
        for value, row in zip(self.first, self.motions, strict=True):
            for other, motion in zip(self.second, row, strict=True):
                if motion is not None:
                    yield float(value), float(other), motion

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and strings by name, with units in the names."""
        names = [name.replace("-", "_") for name in self.names]
        return {
            "parameters": list(self.names),
            "complete": self.complete,
            "cells": [
                {names[0]: value, names[1]: other} | motion.to_plain()
                for value, other, motion in self.cells()
            ],
        }


def attractor_map(
    case: Case,
    names: tuple[str, str],
    first: Sequence[float],
    second: Sequence[float],
    *,
    random_start: int | None = None,
    options: SettleOptions | None = None,
    threads: int | None = None,
    progress: RunProgress | None = None,
) -> AttractorMap:
    """Return the motion on which a run ends at each point of two parameters.

    Parameters
    ----------
    case : Case
        Structure, absorber, force and frequency.
    names : (str, str)
        Two of the parameters of `basin_fractions`.
    first, second : array_like, (n,) and (m,)
        Values of both parameters, in SI units.
    random_start : int, optional
        Seed of the random initial state, the same at all points (see `draw_start`). None: runs
        start from rest.
    options : SettleOptions, optional
        Lengths of the runs.
    threads : int, optional
        Number of threads; the result does not depend on it. None: all cores.
    progress : callable, optional
        ``progress(done, total)`` is called with the number of finished runs and of all runs.

    Returns
    -------
    AttractorMap
        A motion for each point; None for runs that Ctrl-C prevented.

    Raises
    ------
    ParameterError
        A number is out of range, or both parameters are the same.
    """
    require(names[0] != names[1], "names", names, "two different parameters")
    options = SettleOptions() if options is None else options
    size = 2 * case.model.modes + 2
    starts = []
    for value in first:
        here = change_parameter(case, names[0], float(value))
        for other in second:
            point = change_parameter(here, names[1], float(other))
            start = (np.zeros(size), 0.0)
            if random_start is not None:
                rng = np.random.default_rng([count("random_start", random_start, 0), 0])
                start = draw_start(point, START_REACH * point.gap, rng)
            starts.append((point, *start))
    settled = settle_runs(starts, options, threads=threads, progress=progress)
    width = len(second)
    rows = tuple(tuple(settled[k * width : (k + 1) * width]) for k in range(len(first)))
    return AttractorMap(names, np.array(first, float), np.array(second, float), rows)
