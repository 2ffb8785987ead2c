"""Scene, drive and method to a response: the one place where a run is made. Only what is asked for is computed and stored."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.energy import EnergyAccount, stored_energy
from impact_env.first_use import CompilingFor
from impact_env.kernels import observers
from impact_env.kernels.observers import Counters, Energy, Events, Level, Series, close_level, new_level
from impact_env.level import HALF_WINDOW_PERIODS, ResponseLevel
from impact_env.methods import Exact, Method, Moreau, check_mass, check_step, check_supported
from impact_env.parameters import SeveralAbsorbers, StuckAbsorber
from impact_env.propagation import run_exact
from impact_env.response import ContactPhases, History, Impacts, Record, Response
from impact_env.scene import InitialState, Scene
from impact_env.stepping import run_moreau, run_runge_kutta

Array = NDArray[np.float64]
FIRST_CAPACITY = 16384  # of the list of impacts: enough for a sweep at the paper's rate


class IntegrationError(RuntimeError):
    """A run could not be finished; the message says why and what to change."""


REASONS = {
    observers.TOO_MANY_EVENTS: "more events than the integration allows (restitution 1 bounces for ever where the absorber is pressed to its wall)",
    observers.NOT_FINITE: "the state is not finite: the step is above its stability limit, or a parameter is extreme",
    observers.NO_PROGRESS: "events pile up without progress in time",
}


@dataclass
class _Room:
    """The observers' arrays of one run."""

    counters: Counters = field(default_factory=lambda: Counters(np.zeros(4)))
    level: Level | None = None
    events: Events | None = None
    series: Series | None = None
    energy: Energy | None = None


def integrate(scene: Scene, drive: Drive, method: Method, state: Array, interval: float, room: _Room) -> None:
    """Run the method's kernel on ``state`` in place; raise IntegrationError if it does not come to the end."""
    parts = (state, interval, room.counters, room.level, room.events, room.series, room.energy)
    with CompilingFor(scene, method):
        if isinstance(method, Exact):
            status = run_exact(scene, drive, *parts)
        elif isinstance(method, Moreau):
            status = run_moreau(scene, drive, method, *parts)
        else:
            status = run_runge_kutta(scene, drive, method, *parts)
    if status != observers.DONE:
        raise IntegrationError(f"{method} on {scene.absorber}: {REASONS[status]}")


def _sample_count(drive: Drive, interval: float) -> int:
    return int(np.floor(drive.schedule.times[-1] / interval * (1 + 1e-12) + 1e-6)) + 1


def _room(scene: Scene, drive: Drive, record: Record, interval: float, capacity: int) -> _Room:
    n = scene.model.modes
    return _Room(
        level=new_level(record.samples_per_period, HALF_WINDOW_PERIODS) if record.level else None,
        events=Events(np.zeros((capacity, 5)), np.zeros((capacity, 4)), np.zeros(2, dtype=np.int64)) if record.events else None,
        series=Series(np.zeros((_sample_count(drive, interval), 2 * (n + scene.places)))) if record.series else None,
        energy=Energy(np.zeros(4), np.zeros(n)) if record.energy else None,
    )


def simulate(
    scene: Scene,
    drive: Drive,
    method: Method | None = None,
    *,
    initial: InitialState | None = None,
    record: Record | None = None,
) -> Response:
    """Integrate a scene under a drive from an initial state (default: rest) and return what ``record`` asks for (default: the level).

    Raises ParameterError if the method cannot do the scene, its step is too long, a stuck absorber is too heavy or the start is impossible,
    IntegrationError if the run breaks down.
    """
    method = Exact() if method is None else method
    record = Record() if record is None else record
    check_supported(scene, method)
    check_mass(scene)
    check_step(scene, drive, method)
    start = (InitialState() if initial is None else initial).vector(scene)
    interval = drive.schedule.pseudo_period / record.samples_per_period
    capacity = FIRST_CAPACITY
    while True:
        room, state = _room(scene, drive, record, interval, capacity), start.copy()
        began = time.perf_counter()
        integrate(scene, drive, method, state, interval, room)
        wall_time = time.perf_counter() - began
        needed = 0 if room.events is None else int(np.max(room.events.counts))
        if needed <= capacity:
            return _response(scene, drive, method, start, state, room, interval, wall_time)
        capacity = needed


def _response(scene: Scene, drive: Drive, method: Method, start: Array, state: Array, room: _Room, interval: float, wall_time: float) -> Response:
    values = room.counters.values
    impacts = phases = None
    if room.events is not None:
        rows = room.events.impacts[: room.events.counts[0]].T
        impacts = Impacts(rows[0], rows[1], rows[2], rows[3], rows[4].astype(np.int64))
        rows = room.events.phases[: room.events.counts[1]].T
        phases = ContactPhases(rows[0], rows[1], rows[2].astype(np.int64), rows[3].astype(np.int64))
    return Response(
        scene,
        drive,
        method,
        state,
        int(values[observers.IMPACTS]),
        float(drive.schedule.times[-1]) if isinstance(scene.absorber, StuckAbsorber) else float(values[observers.STUCK_TIME]),
        int(values[observers.STEPS]),
        int(values[observers.EVALUATIONS]),
        wall_time,
        level=read_level(room.level, drive, interval),
        impacts=impacts,
        phases=phases,
        history=_history(scene, room.series, interval),
        energy=_energy(scene, room.energy, start, state),
    )


def read_level(level: Level | None, drive: Drive, interval: float) -> ResponseLevel | None:
    """Return the level observer's result, or None."""
    if level is None:
        return None
    value, sample, largest = close_level(level)
    at = min(float(sample) * interval, float(drive.schedule.times[-1]))
    ratio = float(drive.schedule.omega_at(at)) / drive.schedule.reference
    return ResponseLevel(float(value), at, ratio, float(largest))


def _history(scene: Scene, series: Series | None, interval: float) -> History | None:
    if series is None:
        return None
    n, rows = scene.model.modes, series.states
    times, half = interval * np.arange(len(rows)), n + scene.places
    absorber = rows[:, n:half], rows[:, half + n :]
    if not isinstance(scene.absorber, SeveralAbsorbers):
        absorber = absorber[0][:, 0], absorber[1][:, 0]
    return History(np.asarray(times), rows[:, :n], rows[:, half : half + n], *absorber, scene.model.tip_shape)


def _energy(scene: Scene, energy: Energy | None, start: Array, end: Array) -> EnergyAccount | None:
    if energy is None:
        return None
    totals = energy.totals
    return EnergyAccount(
        float(totals[observers.WORK]),
        energy.modal,
        float(totals[observers.FRICTION_LOSS]),
        float(totals[observers.IMPACT_LOSS]),
        float(totals[observers.ABSORBER_DAMPING]),
        stored_energy(scene, start),
        stored_energy(scene, end),
    )
