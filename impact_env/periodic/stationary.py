"""Stationary responses at constant frequencies, with many runs each.

The module computes their kinds, their energies, and the envelope of the frequency response.

The kinds are no impacts, periodic, sustained impacts, strongly modulated (paper, sections 3.1 and
3.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    count,
    count_from,
    fraction,
    kind_of,
    non_negative,
    or_none,
    positive,
)
from impact_env.drive import Drive, constant_frequency
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Executor, Lane, LaneProgress, draw_members, each_lane
from impact_env.fields import check_fields
from impact_env.periodic.residence import Approach, drop_unfinished, hold
from impact_env.results import EnergyAccount, History, Record, Response
from impact_env.scene import InitialState, Scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
QUANTILES = (0.05, 0.5, 0.95)
SAMPLES_PER_PERIOD = 32  # per period of the force


class ResponseKind(StrEnum):
    """Kinds of stationary response."""

    LINEAR = "linear"  # no impacts; friction may still slide
    PERIODIC = "periodic"
    SUSTAINED = "sustained"  # impacts go on without pause, almost periodic or chaotic
    MODULATED = "strongly modulated"  # impacts and pauses take turns


@dataclass(frozen=True)
class Criteria:
    """Criteria by which kinds of stationary response are distinguished.

    Attributes
    ----------
    tolerance : float
        A motion is periodic if its states at one phase of the force repeat to within this share of
        the largest tip displacement throughout the window.
    most_multiple : int
        Longest period in periods of the force.
    pause : float
        Least time without impact that counts as a pause, in periods of the force.
    depth : float
        Least modulation depth of a strongly modulated response, which also has pauses.
    """

    tolerance: float = 1e-4
    most_multiple: int = 12
    pause: float = 1.0
    depth: float = 0.5

    def __post_init__(self) -> None:
        check_fields(
            self, tolerance=positive, most_multiple=count_from(1), pause=positive, depth=fraction
        )


@dataclass(frozen=True, eq=False)
class StationaryWindow:
    """M whole periods of the force from which a response is classified.

    Attributes
    ----------
    states : array, (M + 1, d)
        States at one phase of the force in m: modal displacements at the tip, relative displacement
        of the absorber, and their velocities over the force's circular frequency.
    impacts : array, (K,)
        Times of impacts from the window's start, in periods of the force.
    peaks : array, (M,)
        Largest |q_tip| of each period in m.
    """

    states: Array
    impacts: Array
    peaks: Array

    @property
    def periods(self) -> int:
        """Number of periods of the force."""
        return len(self.peaks)

    @property
    def unit(self) -> float:
        """Largest |q_tip| in m."""
        return float(np.max(self.peaks))


@dataclass(frozen=True)
class Classification:
    """The kind of a window, and the features that determine it.

    Attributes
    ----------
    kind : ResponseKind
        Kind of the response.
    multiple : int or None
        Periods of the force after which the motion repeats, None if it does not.
    miss : float
        Smallest difference of repeated states over all multiples, over the largest tip
        displacement.
    impacts_per_period : float
        Impacts in a period of the force.
    depth : float
        Modulation depth, see `modulation_depth`.
    longest_pause : float
        Longest time without impact in periods of the force.
    """

    kind: ResponseKind
    multiple: int | None
    miss: float
    impacts_per_period: float
    depth: float
    longest_pause: float


def modulation_depth(peaks: Array) -> float:
    """Return (largest - least)/(largest + least) of the peaks (M,) of a response's periods.

    The result is 0 without motion.
    """
    high = float(np.max(peaks))
    low = float(np.min(peaks))
    return (high - low) / (high + low) if high > 0 else 0.0


def longest_pause(impacts: Array, periods: float) -> float:
    """Return the longest time without impact in a window, including its ends.

    Times are in periods of the force.
    """
    return float(np.max(np.diff(np.concatenate([[0.0], impacts, [float(periods)]]))))


def compute_misses(window: StationaryWindow, most_multiple: int) -> Array:
    """Return the largest difference of states that are 1, 2, ... ``most_multiple`` periods apart.

    Differences are relative to the largest tip displacement. Multiples above half of the window's
    periods are left out.
    """
    most = min(most_multiple, window.periods // 2)
    unit = window.unit
    states = window.states
    return np.array(
        [
            float(np.max(np.abs(states[k:] - states[:-k]))) / unit if unit > 0 else 0.0
            for k in range(1, most + 1)
        ]
    )


def classify(window: StationaryWindow, criteria: Criteria | None = None) -> Classification:
    """Return a window's kind with its features.

    A response is linear without impact, periodic if its states repeat, strongly modulated if it has
    pauses and a large modulation depth, and else sustained.
    """
    criteria = Criteria() if criteria is None else criteria
    distances = compute_misses(window, criteria.most_multiple)
    close = np.flatnonzero(distances <= criteria.tolerance)
    multiple = int(close[0]) + 1 if len(close) else None
    depth = modulation_depth(window.peaks)
    pause = longest_pause(window.impacts, window.periods)
    if len(window.impacts) == 0:
        kind = ResponseKind.LINEAR
    elif multiple is not None:
        kind = ResponseKind.PERIODIC
    else:
        kind = (
            ResponseKind.MODULATED
            if pause >= criteria.pause and depth >= criteria.depth
            else ResponseKind.SUSTAINED
        )
    return Classification(
        kind, multiple, float(np.min(distances)), len(window.impacts) / window.periods, depth, pause
    )


@dataclass(frozen=True)
class Energies:
    """Shares of energy and of losses in a stationary response.

    ``absorber_mean`` and ``absorber_most`` are mean and largest share of the absorber in the
    mechanical energy. ``modal``, ``impact``, ``friction`` and ``damper`` are shares of all losses
    in the window, 0 without losses.
    """

    absorber_mean: float
    absorber_most: float
    modal: float
    impact: float
    friction: float
    damper: float


@dataclass(frozen=True, eq=False)
class Stationary:
    """The stationary response of one ensemble member.

    ``classification`` is its kind with the features, ``energies`` its energies, and ``peaks`` (M,)
    the largest |q_tip| in m of each period of the force.
    """

    classification: Classification
    energies: Energies
    peaks: Array


def cut_window(scene: Scene, response: Response, omega: float) -> StationaryWindow:
    """Return the window of a run over whole periods of the force at ``omega`` (rad/s).

    The run must have events and series recorded, with a whole number of samples in each period.
    """
    history = response.recorded.history
    impacts = response.recorded.impacts
    period = 2 * np.pi / omega
    periods = round(float(response.drive.schedule.times[-1]) / period)
    each = (len(history.time) - 1) // periods
    level = history.modal_displacement @ scene.model.level_shape
    peaks = np.max(np.abs(level[: periods * each]).reshape(periods, each), axis=1)
    return StationaryWindow(
        _states(scene, history, omega)[::each][: periods + 1], impacts.time / period, peaks
    )


def _states(scene: Scene, history: History, omega: float) -> Array:
    """Return the samples as displacements and velocities over ``omega``, in m, (S, 2 N_m + 2).

    Modes count with their displacement at the tip, the absorber with its displacement relative to
    it.
    """
    shape = np.where(scene.model.tip_shape == 0, 1.0, scene.model.tip_shape)
    places = (
        history.modal_displacement * shape,
        history.absorber_displacement - history.tip_displacement,
    )
    speeds = (
        history.modal_velocity * shape / omega,
        (history.absorber_velocity - history.tip_velocity) / omega,
    )
    return np.column_stack([*places, *speeds])


def _energies(scene: Scene, history: History, account: EnergyAccount) -> Energies:
    share = mechanical_energy(scene, history).absorber_share
    losses = np.array(
        [
            float(np.sum(account.modal_loss)),
            account.impact_loss,
            account.friction_loss,
            account.absorber_damping,
        ]
    )
    total = float(np.sum(losses))
    modal, impact, friction, damper = (losses / total if total > 0 else np.zeros(4)).tolist()
    return Energies(float(np.mean(share)), float(np.max(share)), modal, impact, friction, damper)


def classify_run(
    scene: Scene,
    settled: Drive,
    periods: int,
    criteria: Criteria | None = None,
    initial: InitialState | None = None,
) -> Stationary:
    """Return the response over ``periods`` of the force after the run ``settled``.

    ``settled`` starts from ``initial`` (default: rest); the frequency is that at its end. An
    elastic slider begins the window without force. Raises as `simulate` does, and ParameterError
    for fewer than two periods.
    """
    periods = count("window periods", periods, 2)
    omega = positive("settled frequency", float(settled.schedule.omegas[-1]))
    end = simulate(scene, settled, initial=initial, record=Record(events=True)).final_state
    drive = settled.followed_by(constant_frequency(omega, 1.0, periods))
    record = Record(
        level=False, events=True, series=True, energy=True, samples_per_period=SAMPLES_PER_PERIOD
    )
    response = simulate(scene, drive, initial=end, record=record)
    window = cut_window(scene, response, omega)
    return Stationary(
        classify(window, criteria),
        _energies(scene, response.recorded.history, response.recorded.energy),
        window.peaks,
    )


def _settled(periods: int, criteria: Criteria | None, lane: Lane) -> Stationary:
    return classify_run(lane.scene, lane.drive, periods, criteria)


def classify_members(
    scene: Scene,
    force: float,
    approach: Approach,
    ratio: float,
    settle: float,
    periods: int,
    phases: Sequence[float],
    criteria: Criteria | None = None,
    *,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> list[Stationary]:
    """Return the stationary responses at one frequency ratio, one for each initial phase (rad).

    ``force`` is in N. ``settle`` pseudo periods at the ratio precede the window of ``periods`` of
    the force. Interruption and errors are as in `residence.stays`.
    """
    lanes = [Lane(scene, hold(approach, force, ratio, settle, phase)) for phase in phases]
    return drop_unfinished(
        each_lane(
            lanes,
            partial(_settled, periods, criteria),
            threads=threads,
            progress=progress,
            executor=executor,
        )
    )


def envelope(members: Sequence[Stationary], quantiles: Sequence[float] = QUANTILES) -> Array:
    """Return quantiles of the largest |q_tip| in a period, (Q,) in m.

    They are taken over all members and periods.
    """
    return np.quantile(np.concatenate([member.peaks for member in members]), quantiles)


@dataclass(frozen=True, eq=False)
class StationaryPoint:
    """The response at one frequency ratio.

    ``tip_max`` (Q,) are the quantiles `QUANTILES` of the tip's largest displacement in a period in
    m, over all members and periods of the force. ``impacts`` is the mean number of impacts in a
    period.
    """

    omega_ratio: float
    tip_max: Array
    impacts: float

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and lists by name, with units in the names."""
        return {
            "omega_ratio": self.omega_ratio,
            "quantiles": list(QUANTILES),
            "tip_max_m": self.tip_max.tolist(),
            "impacts_per_period": self.impacts,
        }

    @staticmethod
    def from_plain(plain: dict[str, Any]) -> StationaryPoint:
        """Return the response of the plain values of `to_plain`."""
        return StationaryPoint(
            float(plain["omega_ratio"]),
            np.array(plain["tip_max_m"], dtype=np.float64),
            float(plain["impacts_per_period"]),
        )


@dataclass(frozen=True)
class StationaryRuns:
    """Settings of stationary runs over a range of frequencies.

    Attributes
    ----------
    points : int
        Number of frequencies.
    members : int
        Number of runs at each frequency, which differ in the force's phase.
    settle : float
        Pseudo periods before the window.
    window : int
        Length of the window in periods of the force.
    approach : float or None
        Frequency ratio at which runs begin, so that impacts begin. None: the frequency itself.
    seed : int
        Seed of the phases.
    threads, executor : int and Executor, or None
        As in `run_lanes`; the results do not depend on them.

    Raises
    ------
    ParameterError
        A value is out of range.
    """

    points: int
    members: int = 20
    settle: float = 500.0
    window: int = 100
    approach: float | None = None
    seed: int = 0
    threads: int | None = None
    executor: Executor | None = None

    def __post_init__(self) -> None:
        check_fields(
            self,
            points=count_from(2),
            members=count_from(1),
            settle=positive,
            window=count_from(2),
            seed=count_from(0),
            approach=or_none(non_negative),
            threads=or_none(count_from(1)),
            executor=kind_of(Executor | None),
        )

    @property
    def settings(self) -> dict[str, Any]:
        """The settings on which results depend, by name."""
        return {
            "members": self.members,
            "settle": self.settle,
            "window": self.window,
            "approach": self.approach,
            "seed": self.seed,
        }

    def ratios(self, low: float, high: float) -> list[float]:
        """Return the frequency ratios from ``low`` to ``high``."""
        return [float(x) for x in np.linspace(low, high, self.points)]

    def at(self, scene: Scene, force: float, reference: float, ratio: float) -> StationaryPoint:
        """Return the response at a ratio of ``reference`` (rad/s) under a force in N.

        Ctrl-C and errors are handled as in `classify_members`.
        """
        phases = draw_members(self.members, self.seed, "phase").phases.tolist()
        way = Approach(reference, self.approach)
        result = classify_members(
            scene,
            force,
            way,
            ratio,
            self.settle,
            self.window,
            phases,
            threads=self.threads,
            executor=self.executor,
        )
        impacts = float(np.mean([member.classification.impacts_per_period for member in result]))
        return StationaryPoint(ratio, envelope(result), impacts)
