"""Scene, drive and method to a response: the one place where a run is made. Only what is asked for is computed and stored."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from impact_env.budget import Stop, Watcher, counters_for, onwards, watched
from impact_env.drive import Drive
from impact_env.energy import EnergyAccount, stored_energy
from impact_env.families import family
from impact_env.first_use import compiling_for
from impact_env.kernels.motion import observers
from impact_env.kernels.motion.level import new_level
from impact_env.kernels.motion.observers import (
    Check,
    Counters,
    Energy,
    Observe,
    Series,
    new_check,
    new_clock,
    new_energy,
    new_events,
)
from impact_env.laws import SceneKind
from impact_env.level import HALF_WINDOW_PERIODS, level_of, read_level, require_samples
from impact_env.loads import AnyDrive, Loads
from impact_env.methods import Exact, Method, check_load, check_mass, check_step
from impact_env.parameters import (
    CompliantWalls,
    SeveralAbsorbers,
    StuckAbsorber,
    count,
    instance,
    require,
)
from impact_env.response import (
    ContactPhases,
    Envelope,
    History,
    Impacts,
    Record,
    Response,
    Reversals,
    SearchCheck,
    Window,
)
from impact_env.scene import InitialState, Scene

Array = NDArray[np.float64]
MOST_EVENTS = 10**15  # of a budget: more than a run of a year has
FIRST_CAPACITY = 65536  # of the lists of events: enough for a sweep at the paper's rate, and for the reversals of a thousand periods


class IntegrationError(RuntimeError):
    """A run could not be finished; the message says why, when, and what to change.

    ``time``: how far the run came in s; ``response``: what was observed up to there. Both are None where it is one of many lanes under control.
    """

    def __init__(
        self, message: str, time: float | None = None, response: Response | None = None
    ) -> None:
        super().__init__(message)
        self.time = time
        self.response = response


class Stopped(IntegrationError):  # noqa: N818 - no error of the run's
    """A run was ended by the `Stop` that it was given."""


REASONS = {
    observers.TOO_MANY_EVENTS: "more events than its budget",
    observers.TOO_MANY_EVALUATIONS: "the searches for its events take more evaluations than its budget",
    observers.SEARCH_GAVE_UP: "a search for the next event came to no end",
    observers.NOT_FINITE: "the state is not finite: the step is above its stability limit, or a parameter is extreme",
    observers.NO_PROGRESS: "events pile up without progress in time",
    observers.STOPPED: "it was told to stop",
    observers.JOINTS_UNSOLVED: "no forces of the absorbers' joints meet the contact laws up to rounding",
    observers.STEP_TOO_LONG: "the step is too long for the stiffness of the nonlinear spring at the stretch that it reaches",
}
ADVICE = {
    observers.TOO_MANY_EVENTS: "raise most_events; a lower restitution, more friction or more damping has fewer events",
    observers.TOO_MANY_EVALUATIONS: "raise most_events, or take fewer modes or more damping",
    observers.SEARCH_GAVE_UP: "change a parameter a little, or take fewer modes",
    observers.NOT_FINITE: "take a shorter step, or milder parameters",
    observers.NO_PROGRESS: "change a parameter a little, or take another method",
    observers.JOINTS_UNSOLVED: "take lighter absorbers, or places further apart",
    observers.STEP_TOO_LONG: "raise steps_per_period",
}


def integrate(scene: Scene, drive: AnyDrive, method: Method, state: Array, room: Observe) -> int:
    """Run the method's kernel on ``state`` (2 N_m + 2 n,) in place and return its status code."""
    with compiling_for(scene, method):
        return family(scene, method).run(scene, drive, method, state, room)


def needs_energy(scene: Scene, record: Record) -> bool:
    """Return whether impacts are listed whose loss only the energies know: those on compliant walls with a damper."""
    walls = getattr(scene.absorber, "walls", None)
    return record.events and isinstance(walls, CompliantWalls) and walls.restitution < 1


def _room(
    scene: Scene,
    drive: AnyDrive,
    record: Record,
    interval: float,
    capacity: int,
    counters: Counters,
) -> Observe:
    n = scene.model.modes
    samples = int(np.floor(drive.schedule.times[-1] / interval * (1 + 1e-12) + 1e-6)) + 1
    return Observe(
        new_clock(interval),
        counters,
        level=new_level(record.samples_per_period, HALF_WINDOW_PERIODS) if record.level else None,
        events=new_events(capacity, record.reversals)
        if record.events or record.reversals
        else None,
        series=Series(np.zeros((samples, 2 * (n + scene.places)))) if record.series else None,
        energy=new_energy(n) if record.energy or needs_energy(scene, record) else None,
    )


def simulate(
    scene: Scene,
    drive: AnyDrive,
    method: Method | None = None,
    *,
    initial: InitialState | None = None,
    record: Record | None = None,
    most_events: int | None = None,
    progress: Watcher | None = None,
    stop: Stop | None = None,
) -> Response:
    """Integrate a scene under a drive from an initial state and return what ``record`` asks for (default: the level).

    Without a state it starts at rest, or as its loads say.

    The exact method may use ``most_events`` events (default: a million, and 5,000 for each pseudo period that has passed), and 40 evaluations for
    each of them and for each pseudo period, so that no run goes on for ever. ``progress`` is told the time reached and the end time in s, ten times
    a second and at the end; the run then takes a thread of its own, and a KeyboardInterrupt ends it at its next event. Without ``progress`` the
    interrupt waits for the run's end, or for its ``stop``, which any thread may give.

    Raises ParameterError if the method cannot do the scene, its step is too long, a stuck absorber is too heavy or the start is impossible,
    IntegrationError if the run breaks down or its budget is used up, `Stopped` if it was ended; they carry what was observed so far.
    """
    method = Exact() if method is None else method
    record = Record() if record is None else instance("record", record, Record)
    scene = instance("scene", scene, Scene)
    drive = instance("drive", drive, AnyDrive)
    progress = instance("progress", progress, Callable | None)
    stop = instance("stop", stop, Stop | None)
    usual = drive.initial(scene) if isinstance(drive, Loads) else InitialState()
    initial = usual if initial is None else instance("initial", initial, InitialState)
    check_load(scene, drive, method)
    again = partial(
        simulate,
        scene,
        drive,
        method,
        initial=initial,
        most_events=most_events,
        progress=progress,
        stop=stop,
    )
    if record.envelope is not None or isinstance(record.series, Window):
        return _reduced(again(record=replace(record, envelope=None, series=True)), record)
    if record.level and isinstance(drive, Drive) and drive.amplitude != 0:
        require_samples(
            record.samples_per_period, float(drive.schedule.omegas.max()) / drive.schedule.reference
        )
    if (
        record.level
        and scene.model.response_shape is not None
        and not isinstance(scene.absorber, SeveralAbsorbers)
    ):
        return _read_elsewhere(again(record=replace(record, level=False, series=True)), record)
    family(scene, method)  # refuses what the method cannot do
    if record.reversals:
        allowed = isinstance(method, Exact) and scene.kind in {SceneKind.RIGID, SceneKind.SEVERAL}
        require(
            allowed,
            "reversals",
            True,
            f"with rigid contact and the exact method, not {method} on {scene.absorber}",
        )
    check_mass(scene)
    check_step(scene, drive, method)
    budget = None if most_events is None else count("most_events", most_events, 1, MOST_EVENTS)
    return _run(
        scene,
        drive,
        method,
        initial.vector(scene),
        record,
        budget,
        None if progress is None else onwards(progress),
        stop,
    )


def _run(
    scene: Scene,
    drive: AnyDrive,
    method: Method,
    start: Array,
    record: Record,
    budget: int | None,
    tell: Watcher | None,
    stop: Stop | None,
) -> Response:
    """Run from a state (2 N_m + 2 n,), and again with longer lists where there are more impacts or phases than they hold; errors as `simulate`."""
    interval = drive.schedule.pseudo_period / record.samples_per_period
    searched = family(scene, method).searched
    end = float(drive.schedule.times[-1])
    capacity = FIRST_CAPACITY
    while True:
        counters = counters_for(drive, budget, new_check() if record.check and searched else None)
        room = _room(scene, drive, record, interval, capacity, counters)
        state = start.copy()
        work = partial(integrate, scene, drive, method, state, room)
        began = time.perf_counter()
        with nullcontext() if stop is None else stop.reaching(counters):
            status = work() if tell is None else watched(work, counters, end, tell)
        wall_time = time.perf_counter() - began
        needed = 0 if room.events is None else max(room.events.counts.item())
        if needed <= capacity:
            break
        capacity = needed
    if tell is not None and status == observers.DONE:
        tell(end, end)
    response = _response(
        scene,
        drive,
        method,
        start,
        state,
        room,
        interval,
        energies=record.energy,
        wall_time=wall_time,
        complete=status == observers.DONE,
    )
    if status != observers.DONE:
        raise _failure(response, counters, status)
    return response


def _read_elsewhere(response: Response, record: Record) -> Response:
    """Return a sampled response with the level of a place other than the absorber's: the kernels stream that of the absorber's place only."""
    history = response.history
    schedule = response.drive.schedule
    assert history is not None
    level = level_of(
        history.modal_displacement @ response.scene.model.level_shape, record.samples_per_period
    )
    found = read_level(level, response.drive, schedule.pseudo_period / record.samples_per_period)
    return replace(response, level=found, history=history if record.series else None)


def _reduced(response: Response, record: Record) -> Response:
    """Return a sampled response with what is wanted of its samples: an envelope, a window of them, all or none."""
    history = response.history
    envelope = None
    assert history is not None
    if record.envelope is not None:
        edges = np.linspace(0.0, float(response.drive.schedule.times[-1]), record.envelope + 1)
        values = history.modal_displacement @ response.scene.model.level_shape
        bins = np.minimum(
            np.searchsorted(edges, history.time, side="right") - 1, record.envelope - 1
        )
        low = np.full(record.envelope, np.nan)
        high = np.full(record.envelope, np.nan)
        np.fmin.at(low, bins, values)
        np.fmax.at(high, bins, values)
        envelope = Envelope(edges, low, high)
    if isinstance(record.series, Window):
        kept = slice(
            *np.searchsorted(
                history.time, (record.series.start, np.nextafter(record.series.end, np.inf))
            )
        )
        sampled = {
            name: values[kept].copy()
            for name, values in vars(history).items()
            if name != "tip_shape"
        }
        history = History(**sampled, tip_shape=history.tip_shape)
    return replace(response, envelope=envelope, history=history if record.series else None)


def _failure(response: Response, counters: Counters, status: int) -> IntegrationError:
    """Return the error of a run that ended early: why, when, its use of the budget, and advice."""
    counts = counters.counts
    period = response.drive.schedule.pseudo_period
    at = float(counts["reached"])
    parts = [f"{response.method} on {response.scene.absorber}: {REASONS[status]}"]
    parts.append(
        f"at {at:.9g} s ({at / period:.6g} of {response.drive.schedule.periods:.6g} pseudo periods)"
    )
    if isinstance(response.method, Exact):
        used = counts["events"]
        most = counts["most_events"] + counts["events_per_s"] * at
        parts.append(
            f"after {used:,.0f} events of {most:,.0f} allowed up to there and {counts['evaluations']:,.0f} evaluations"
        )
    kind = Stopped if status == observers.STOPPED else IntegrationError
    return kind(
        ", ".join(parts) + (f". {ADVICE[status]}" if status in ADVICE else ""), at, response
    )


def _response(
    scene: Scene,
    drive: AnyDrive,
    method: Method,
    start: Array,
    state: Array,
    room: Observe,
    interval: float,
    *,
    energies: bool,
    wall_time: float,
    complete: bool,
) -> Response:
    """Return the response, with ``energies`` if they are wanted, up to the time reached if the run is not complete."""
    counts = room.counters.counts
    reached = float(drive.schedule.times[-1] if complete else counts["reached"])
    impacts = phases = reversals = None
    if room.events is not None:
        rows = room.events.impacts[: room.events.counts["impacts"]]
        impacts = Impacts(
            *(
                rows[name].copy()
                for name in ("time", "relative_velocity", "impulse", "loss", "absorber")
            )
        )
        rows = room.events.phases[: room.events.counts["phases"]]
        phases = ContactPhases(
            *(rows[name].copy() for name in ("start", "end", "kind", "absorber"))
        )
        if room.events.reversals is not None:
            rows = room.events.reversals[: room.events.counts["reversals"]]
            reversals = Reversals(rows["time"].copy(), rows["absorber"].copy())
    return Response(
        scene,
        drive,
        method,
        state,
        int(counts["impacts"]),
        reached if isinstance(scene.absorber, StuckAbsorber) else float(counts["stuck_time"]),
        int(counts["steps"]),
        int(counts["evaluations"]),
        wall_time,
        level=read_level(room.level, drive, interval)
        if complete or (room.level is not None and room.level.state["next"] > 0)
        else None,
        impacts=impacts,
        phases=phases,
        history=_history(scene, room.series, interval, None if complete else reached),
        energy=_energy(scene, room.energy, start, state) if energies else None,
        check=_check(room.counters.check),
        reversals=reversals,
    )


def _check(check: Check | None) -> SearchCheck | None:
    if check is None:
        return None
    first = check.first[: check.counts["misses"]]
    listed = first["time"], first["kind"], first["share"]
    return SearchCheck(
        int(check.counts["searches"]),
        int(check.counts["misses"]),
        float(np.max(check.worst)),
        *listed,
    )


def _history(
    scene: Scene, series: Series | None, interval: float, reached: float | None
) -> History | None:
    """Return the samples, without those after the time reached (s) if that is not the end."""
    if series is None:
        return None
    n = scene.model.modes
    rows = series.states
    if reached is not None:
        rows = rows[: int(np.ceil(reached / interval * (1 - 1e-9)))]
    times = interval * np.arange(len(rows))
    half = n + scene.places
    absorber = rows[:, n:half], rows[:, half + n :]
    if not isinstance(scene.absorber, SeveralAbsorbers):
        absorber = absorber[0][:, 0], absorber[1][:, 0]
    return History(
        np.asarray(times), rows[:, :n], rows[:, half : half + n], *absorber, scene.model.tip_shape
    )


def _energy(scene: Scene, energy: Energy | None, start: Array, end: Array) -> EnergyAccount | None:
    if energy is None:
        return None
    totals = energy.totals[0]
    friction, impacts, damper = (
        float(totals[name]) for name in ("friction_loss", "impact_loss", "absorber_damping")
    )
    return EnergyAccount(
        float(totals["work"]),
        energy.modal,
        friction,
        impacts,
        damper,
        stored_energy(scene, start),
        stored_energy(scene, end),
    )
