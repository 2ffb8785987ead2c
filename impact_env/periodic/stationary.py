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
    """What tells the kinds apart.

    ``tolerance``: a motion is periodic if its states at one phase of the force come again, after up
    to ``most_multiple`` periods, to within this share of the largest tip displacement, throughout
    the window. ``pause``: periods of the force without impact that make a pause, and ``depth``: the
    least modulation depth of a strongly modulated response, which has both.
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
    """A stretch of M whole periods of the force: all that a response is judged by.

    ``states`` (M + 1, d): states at one phase of the force, each as a displacement of the tip or of
    the absorber against it in m (velocities over the force's circular frequency). ``impacts`` (K,):
    times of impacts in periods of the force from the window's start. ``peaks`` (M,): largest
    |q_tip| of each period in m.
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
class Classified:
    """A window's kind, and what it was judged by.

    ``multiple``: periods of the force after which the motion comes again, None unless it does;
    ``miss``: how close it comes to itself at the best of all multiples, of the largest tip
    displacement; ``impacts_per_period`` of the force; ``depth``: modulation depth;
    ``longest_pause`` in periods of the force.
    """

    kind: ResponseKind
    multiple: int | None
    miss: float
    impacts_per_period: float
    depth: float
    longest_pause: float


def modulation_depth(peaks: Array) -> float:
    """Return (largest - least) / (largest + least) of the peaks (M,) of a response's periods.

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
    """Return the largest distance of two states that are 1, 2, ... periods apart.

    The result has an entry for each multiple of the period. Distances are relative to the largest
    tip displacement.

    At most half of the window's periods are compared so.
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


def classify(window: StationaryWindow, criteria: Criteria | None = None) -> Classified:
    """Return a window's kind.

    Without impact it is linear. It is periodic if it comes again; else strongly modulated if it has
    pauses and is deeply modulated, or sustained.
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
    return Classified(
        kind, multiple, float(np.min(distances)), len(window.impacts) / window.periods, depth, pause
    )


@dataclass(frozen=True)
class Energies:
    """Where a stationary response has its energy, and where its work goes.

    ``absorber_mean`` and ``absorber_most``: the absorber's share of the mechanical energy.
    ``modal``, ``impact``, ``friction``, ``damper``: shares of all losses in the window (0 where
    nothing is lost).
    """

    absorber_mean: float
    absorber_most: float
    modal: float
    impact: float
    friction: float
    damper: float


@dataclass(frozen=True, eq=False)
class Stationary:
    """One member's response.

    It has a classification, energies, and the largest |q_tip| in m of each period of the force,
    (M,).
    """

    found: Classified
    energies: Energies
    peaks: Array


def cut_window(scene: Scene, response: Response, omega: float) -> StationaryWindow:
    """Return the window of a run over whole periods of the force at ``omega`` (rad/s).

    The run must be recorded with events and series.

    Its samples lie a whole fraction of the force's period apart.
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
    """Return the samples as displacements in m, (S, 2 N_m + 2).

    They are each mode's share of the tip's displacement, and the absorber's displacement relative
    to the tip.
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

    This run starts from a state (default: rest). The frequency is that at its end.

    An elastic slider begins the window without force. Raises as `simulate` does, and ParameterError
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
    """Return the stationary responses at one frequency ratio.

    The result has one response for each initial phase (rad) of the force (N).

    ``settle`` pseudo periods at the ratio come before the window of ``periods`` of the force.
    Interruption and errors as in `residence.stays`.
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

    ``tip_max`` (Q,) in m are the quantiles `QUANTILES` over all members and periods of the force.

    They are of the tip's largest displacement in a period; ``impacts``: mean number in a period.
    """

    omega_ratio: float
    tip_max: Array
    impacts: float

    def to_plain(self) -> dict[str, Any]:
        """Return numbers and lists; keys with their units."""
        return {
            "omega_ratio": self.omega_ratio,
            "quantiles": list(QUANTILES),
            "tip_max_m": self.tip_max.tolist(),
            "impacts_per_period": self.impacts,
        }

    @staticmethod
    def from_plain(plain: dict[str, Any]) -> StationaryPoint:
        """Return the response of `to_plain`."""
        return StationaryPoint(
            float(plain["omega_ratio"]),
            np.array(plain["tip_max_m"], dtype=np.float64),
            float(plain["impacts_per_period"]),
        )


@dataclass(frozen=True)
class StationaryRuns:
    """Settings of stationary runs.

    At each of ``points`` frequencies ``members`` runs are made, each with its own phase.

    ``settle`` pseudo periods come before a window of ``window`` periods of the force. ``approach``:
    the ratio at which runs begin, to come into impact; None: at the frequency itself. ``threads``
    and ``executor``: as in `run_lanes`; nothing depends on them. Raises ParameterError for values
    out of range.
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
        """What the numbers depend on, but for scene, force and frequency."""
        return {
            "members": self.members,
            "settle": self.settle,
            "window": self.window,
            "approach": self.approach,
            "seed": self.seed,
        }

    def ratios(self, low: float, high: float) -> list[float]:
        """Return the frequency ratios between two."""
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
        impacts = float(np.mean([member.found.impacts_per_period for member in result]))
        return StationaryPoint(ratio, envelope(result), impacts)
