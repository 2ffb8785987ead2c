"""Stationary responses at constant frequencies, many members each: their kinds, energies, and the envelope of the frequency response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive, constant_frequency
from impact_env.energy import EnergyAccount, mechanical_energy
from impact_env.ensemble import Executor, Lane, Progress, each_lane
from impact_env.parameters import count, positive
from impact_env.periodic.approach import Approach, hold, start_from
from impact_env.periodic.classify import Classified, Criteria, Kind, Window, classify
from impact_env.periodic.residence import finished
from impact_env.response import History, Record, Response
from impact_env.scene import Scene
from impact_env.sweep import simulate

Array = NDArray[np.float64]
QUANTILES = (0.05, 0.5, 0.95)
SAMPLES = 32  # per period of the force


@dataclass(frozen=True)
class Energies:
    """Where a stationary response has its energy, and where its work goes.

    ``absorber_mean`` and ``absorber_most``: the absorber's share of the mechanical energy. ``modal``, ``impact``, ``friction``, ``damper``: shares of
    all losses in the window (0 where nothing is lost).
    """

    absorber_mean: float
    absorber_most: float
    modal: float
    impact: float
    friction: float
    damper: float


@dataclass(frozen=True, eq=False)
class Stationary:
    """One member's response: what it is classified as, its energies, and the largest |q_tip| in m of each period of the force, (M,)."""

    found: Classified
    energies: Energies
    peaks: Array


def window_of(scene: Scene, response: Response, omega: float) -> Window:
    """Return the window of a run of whole periods of the force at ``omega`` (rad/s), recorded with events and series.

    Its samples lie a whole fraction of the force's period apart.
    """
    history, impacts = response.history, response.impacts
    assert history is not None
    assert impacts is not None
    period = 2 * np.pi / omega
    periods = round(float(response.drive.schedule.times[-1]) / period)
    each = (len(history.time) - 1) // periods
    peaks = np.max(np.abs(history.tip_displacement[: periods * each]).reshape(periods, each), axis=1)
    return Window(_states(scene, history, omega)[::each][: periods + 1], impacts.time / period, peaks)


def _states(scene: Scene, history: History, omega: float) -> Array:
    """Return the samples as displacements in m, (S, 2 N_m + 2): each mode's share of the tip's, and the absorber's against the tip."""
    shape = np.where(scene.model.tip_shape == 0, 1.0, scene.model.tip_shape)
    relative = history.absorber_displacement - history.tip_displacement
    return np.column_stack(
        [
            history.modal_displacement * shape,
            relative,
            history.modal_velocity * shape / omega,
            (history.absorber_velocity - history.tip_velocity) / omega,
        ]
    )


def _energies(scene: Scene, history: History, account: EnergyAccount) -> Energies:
    share = mechanical_energy(scene, history).absorber_share
    losses = np.array([float(np.sum(account.modal_loss)), account.impact_loss, account.friction_loss, account.absorber_damping])
    total = float(np.sum(losses))
    modal, impact, friction, damper = (losses / total if total > 0 else np.zeros(4)).tolist()
    return Energies(float(np.mean(share)), float(np.max(share)), modal, impact, friction, damper)


def stationary(scene: Scene, settled: Drive, periods: int, criteria: Criteria | None = None) -> Stationary:
    """Return the response over ``periods`` of the force after the run ``settled``, at the frequency that it ended with.

    An elastic slider begins the window without force. Raises as `simulate` does, and ParameterError for fewer than two periods.
    """
    count("window periods", periods, 2)
    omega = positive("settled frequency", float(settled.schedule.omegas[-1]))
    end = simulate(scene, settled, record=Record(events=True)).end_state
    phase = settled.phase + float(settled.schedule.phase_at(float(settled.schedule.times[-1])))
    drive = Drive(settled.amplitude, constant_frequency(omega, 1.0, periods), phase)
    record = Record(level=False, events=True, series=True, energy=True, samples_per_period=SAMPLES)
    response = simulate(scene, drive, initial=start_from(scene, end), record=record)
    assert response.history is not None
    assert response.energy is not None
    window = window_of(scene, response, omega)
    return Stationary(classify(window, criteria), _energies(scene, response.history, response.energy), window.peaks)


@dataclass(frozen=True)
class _Settled:
    """What is measured of a lane: its stationary response. Plain data, so that other processes can do it."""

    periods: int
    criteria: Criteria | None

    def __call__(self, lane: Lane) -> Stationary:
        return stationary(lane.scene, lane.drive, self.periods, self.criteria)


def stationary_members(
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
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> list[Stationary]:
    """Return the stationary responses at one frequency ratio, one for each initial phase (rad) of the force (N).

    ``settle`` pseudo periods at the ratio come before the window of ``periods`` of the force. Interruption and errors as in `residence.stays`.
    """
    lanes = [Lane(scene, hold(approach, force, ratio, settle, phase)) for phase in phases]
    return finished(each_lane(lanes, _Settled(periods, criteria), threads=threads, progress=progress, executor=executor))


def envelope(members: Sequence[Stationary], quantiles: Sequence[float] = QUANTILES) -> Array:
    """Return quantiles over all members and periods of the largest |q_tip| in a period, (Q,) in m."""
    return np.quantile(np.concatenate([member.peaks for member in members]), quantiles)


def shares(members: Sequence[Stationary]) -> dict[Kind, float]:
    """Return each kind's share of the members."""
    return {kind: sum(member.found.kind is kind for member in members) / len(members) for kind in Kind}
