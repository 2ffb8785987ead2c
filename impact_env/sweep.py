"""Runs: from scene, drive and method to a response.

All runs are made in this module. Only requested results are computed and stored. The module also
has the parts of a run: its budget, its progress, its lists of events, and the order to stop.
"""

import ctypes
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager, nullcontext
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count, instance, require
from impact_env.drive import Drive, Excitation
from impact_env.energy import stored_energy
from impact_env.first_use import compiling_for
from impact_env.force_channels import split_forces
from impact_env.kernels.compiling.parts import abandon_compilations
from impact_env.kernels.motion import observers
from impact_env.kernels.motion.observers import (
    EVALUATIONS_PER_EVENT,
    EVENTS_PER_PERIOD,
    FIRST_EVENTS,
    IMPACT_RECORD,
    PHASE_RECORD,
    REVERSAL_RECORD,
    CheckObserver,
    Counters,
    EnergyTotals,
    LevelObserver,
    Observers,
    StateSeries,
    new_check,
    new_clock,
    new_counters,
    new_energy,
    new_envelope,
    new_events,
    new_level,
    new_series,
)
from impact_env.laws import SceneKind
from impact_env.level import HALF_WINDOW_PERIODS, read_level, require_sampling
from impact_env.loads import Loads
from impact_env.methods import Exact, Method, check_mass, check_step
from impact_env.parameters import CompliantWalls, SeveralAbsorbers, StuckAbsorber
from impact_env.results import (
    ContactPhases,
    EnergyAccount,
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
from impact_env.solvers import check_load, find_solver

T = TypeVar("T")
Array = NDArray[np.float64]
Watcher = Callable[[float, float], None]  # takes the time reached and the end time in s
POLL_S = 0.1  # between two calls of a watcher
EVENTS_PER_CHUNK = 8192  # records of a kind between two calls of `EventRecorder.empty`
_FUNCTION = ctypes.CFUNCTYPE(None)
MOST_EVENTS_ALLOWED = 10**15  # of a budget: more than a run of a year has


class Stop:
    """Order to end runs, from any thread.

    Runs under way end at their next event or window, within microseconds; later runs end at once.
    Many runs and threads may share one order. An order that was given cannot be taken back.

    Examples
    --------
    >>> from impact_env import Stop
    >>> stop = Stop()
    >>> stop.give()
    >>> stop.given
    True
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._given = False
        self._running: list[Counters] = []

    def give(self) -> None:
        """End all runs that share it."""
        with self._lock:
            self._given = True
            for counters in self._running:
                counters.counts["stop"] = True

    @property
    def given(self) -> bool:
        """Whether it was given."""
        return self._given

    @contextmanager
    def reaching(self, counters: Counters) -> Iterator[None]:
        """While this is entered, the order reaches the kernel that counts there."""
        with self._lock:
            counters.counts["stop"] = self._given
            self._running.append(counters)
        try:
            yield
        finally:
            with self._lock:
                self._running[:] = [other for other in self._running if other is not counters]


class IntegrationError(RuntimeError):
    """A run could not be finished; the message has the reason, the time, and what to change.

    Attributes
    ----------
    time : float or None
        Time reached in s. None: a run under control, among many.
    response : Response or None
        The response up to this time. None: a run under control.
    """

    def __init__(
        self, message: str, time: float | None = None, response: Response | None = None
    ) -> None:
        super().__init__(message)
        self.time = time
        self.response = response


class Stopped(IntegrationError):  # noqa: N818 - no error of the run's
    """A run was ended by its `Stop`."""


FAILURE_REASONS = {
    observers.TOO_MANY_EVENTS: "more events than its budget",
    observers.TOO_MANY_EVALUATIONS: (
        "the searches for its events take more evaluations than its budget"
    ),
    observers.SEARCH_GAVE_UP: "a search for the next event came to no end",
    observers.NOT_FINITE: (
        "the state is not finite: the step is above its stability limit, or a parameter is extreme"
    ),
    observers.NO_PROGRESS: "events pile up without progress in time",
    observers.STOPPED: "it was told to stop",
    observers.JOINTS_UNSOLVED: (
        "no forces of the absorbers' joints meet the contact laws up to rounding"
    ),
    observers.STEP_TOO_LONG: (
        "the step is too long for the stiffness of the nonlinear spring at the stretch that it "
        "reaches"
    ),
}
FAILURE_ADVICE = {
    observers.TOO_MANY_EVENTS: (
        "raise most_events; a lower restitution, more friction or more damping has fewer events"
    ),
    observers.TOO_MANY_EVALUATIONS: "raise most_events, or take fewer modes or more damping",
    observers.SEARCH_GAVE_UP: "change a parameter a little, or take fewer modes",
    observers.NOT_FINITE: "take a shorter step, or milder parameters",
    observers.NO_PROGRESS: "change a parameter a little, or take another method",
    observers.JOINTS_UNSOLVED: "take lighter absorbers, or places further apart",
    observers.STEP_TOO_LONG: "raise steps_per_period",
}


class EventRecorder:
    """Recorder of the events of one run.

    ``events`` is filled by the run's kernel, which calls `empty`, with Python's lock, when a list
    is full. `join_lists` returns the recorded events. An error in `empty`, or a KeyboardInterrupt
    during it, ends the run and is raised by `close`.
    """

    def __init__(self, contacts: bool, reversals: bool, counters: Counters) -> None:
        self._counters = counters
        self._contacts = contacts
        self._reversals = reversals
        self._function = _FUNCTION(self._call)  # as long as a kernel may call it
        address = ctypes.cast(self._function, ctypes.c_void_p).value or 0
        self.events = new_events(EVENTS_PER_CHUNK * contacts, EVENTS_PER_CHUNK * reversals, address)
        self._chunks: dict[str, list[NDArray[np.void]]] = {
            "impacts": [np.zeros(0, IMPACT_RECORD)],
            "phases": [np.zeros(0, PHASE_RECORD)],
            "reversals": [np.zeros(0, REVERSAL_RECORD)],
        }
        self._error: BaseException | None = None

    def _call(self) -> None:
        try:
            self.empty()
        except BaseException as error:  # a function that compiled code calls cannot raise
            self._error = error
            self._counters.counts["stop"] = True
            for name in self._chunks:
                self.events.counts[name] = 0

    def empty(self) -> None:
        """Move the records out of the kernel's lists."""
        for name, chunks in self._chunks.items():
            used = self.events.counts[name]
            chunks.append(getattr(self.events, name)[:used].copy())
            self.events.counts[name] = 0

    def close(self) -> None:
        """Move the last records out of the lists, and raise an error that occurred in `empty`.

        The kernel must have ended.
        """
        if self._error is not None:
            raise self._error
        self.empty()

    def join_lists(self) -> tuple[Impacts | None, ContactPhases | None, Reversals | None]:
        """Return impacts, contact phases and reversals, None if they were not recorded."""
        impacts, phases, reversals = map(np.concatenate, self._chunks.values())
        return (
            Impacts(
                *(
                    impacts[name].copy()
                    for name in ("time", "relative_velocity", "impulse", "loss", "absorber")
                )
            )
            if self._contacts
            else None,
            ContactPhases(*(phases[name].copy() for name in ("start", "end", "kind", "absorber")))
            if self._contacts
            else None,
            Reversals(reversals["time"].copy(), reversals["absorber"].copy())
            if self._reversals
            else None,
        )


def new_run_counters(
    drive: Excitation, most_events: int | None, check: CheckObserver | None = None
) -> Counters:
    """Return a run's counters with its budget.

    ``most_events`` None: the default budget, which grows with the time reached. A run may use
    EVALUATIONS_PER_EVENT evaluations for each event of the budget, and with a given budget as many
    for each pseudo period.
    """
    events = FIRST_EVENTS
    per_period = EVENTS_PER_PERIOD
    evaluations_per_period = EVALUATIONS_PER_EVENT * EVENTS_PER_PERIOD
    if most_events is not None:
        events = most_events
        per_period = 0
        evaluations_per_period = EVALUATIONS_PER_EVENT
    period = drive.schedule.pseudo_period
    return new_counters(
        events,
        per_period / period,
        EVALUATIONS_PER_EVENT * events,
        evaluations_per_period / period,
        check,
    )


def run_in_thread(work: Callable[[], T], counters: Counters, end: float, progress: Watcher) -> T:
    """Call ``work`` in a thread, and ``progress(time, end)`` ten times a second, both in s.

    A KeyboardInterrupt, or an error in ``progress``, ends the kernel at its next event and is
    raised again. It does not wait for a compilation.
    """
    with ThreadPoolExecutor(1) as pool:
        try:
            running = pool.submit(work)
            while wait([running], POLL_S).not_done:
                progress(float(counters.counts["reached"]), end)
        except BaseException:
            counters.counts["stop"] = True
            with abandon_compilations():
                pool.shutdown()
            raise
    return running.result()


def _balanced(scene: Scene, record: Record) -> bool:
    """Return whether a run needs the kernel that also computes energies and checks searches."""
    if record.energy or record.check:
        return True
    # an impact on a compliant wall with a damper: only the energies know its loss
    walls = getattr(scene.absorber, "walls", None)
    return record.events and isinstance(walls, CompliantWalls) and walls.restitution < 1


def _first_sample(time: Array, interval: float, *, after: bool = False) -> NDArray[np.int64]:
    """Return the number of the first sample at times (B,) in s or later; if ``after``, later."""
    guess = np.maximum(np.floor(time / interval) - 1, 0)
    return (
        guess
        + sum(
            (guess + k) * interval <= time if after else (guess + k) * interval < time
            for k in range(4)
        )
    ).astype(np.int64)


def _series_range(drive: Excitation, record: Record, interval: float) -> tuple[int, int]:
    """Return the number of the first sample of the series, and of all its samples.

    The latter is 0 without series.
    """
    every = int(np.floor(drive.schedule.times[-1] / interval * (1 + 1e-12) + 1e-6)) + 1
    if not isinstance(record.series, Window):
        return 0, every if record.series else 0
    ends = np.array([record.series.start, record.series.end])
    first = int(_first_sample(ends[:1], interval)[0])
    stop = int(_first_sample(ends[1:], interval, after=True)[0])
    return first, max(min(stop, every) - first, 0)


def _level(scene: Scene, drive: Excitation, record: Record, interval: float) -> LevelObserver:
    """Return the observer of level and envelope."""
    ends = None
    if record.envelope is not None:
        ends = _first_sample(_envelope_edges(drive, record.envelope)[1:], interval)
    return new_level(
        record.samples_per_period,
        HALF_WINDOW_PERIODS,
        scene.model.response_shape,
        None if ends is None else new_envelope(ends),
    )


def _envelope_edges(drive: Excitation, bins: int) -> Array:
    return np.linspace(0.0, float(drive.schedule.times[-1]), bins + 1)


def _observers(
    scene: Scene,
    drive: Excitation,
    record: Record,
    interval: float,
    lists: EventRecorder,
    counters: Counters,
) -> Observers:
    first, rows = _series_range(drive, record, interval)
    return Observers(
        new_clock(interval, first, record.level or record.envelope is not None),
        counters,
        level=_level(scene, drive, record, interval),
        events=lists.events,
        series=new_series(rows, 2 * (scene.model.modes + scene.places)),
        energy=new_energy(scene.model.modes) if _balanced(scene, record) else None,
    )


def simulate(
    scene: Scene,
    drive: Excitation,
    method: Method | None = None,
    *,
    initial: InitialState | None = None,
    record: Record | None = None,
    most_events: int | None = None,
    progress: Watcher | None = None,
    stop: Stop | None = None,
) -> Response:
    """Integrate a scene under a drive and return the recorded response.

    Parameters
    ----------
    scene : Scene
        Structure with or without absorber, see `beam_scene`.
    drive : Drive or Loads
        Force or loads over time. The run ends where its schedule ends.
    method : Exact, Moreau or RungeKutta, optional
        Integration method (default: `Exact`, propagation from event to event).
    initial : InitialState, optional
        State at time 0. Default: at rest, or the start that the loads define. A `Strike` among the
        loads adds its modal velocities to a given state.
    record : Record, optional
        Parts of the response to record. Default: the response level.
    most_events : int, optional
        Budget of the exact method. Default: a million events, and 5,000 for each pseudo period that
        has passed. The event searches may use 40 evaluations for each event and each pseudo period.
    progress : callable, optional
        ``progress(time, end)`` is called ten times a second and at the end, both in s. The run then
        takes a thread of its own, and a KeyboardInterrupt ends it at its next event. Without
        ``progress`` the interrupt waits for the end of the run.
    stop : Stop, optional
        Ends the run from any other thread.

    Returns
    -------
    Response
        Recorded parts, final state and counts. All quantities are in SI units.

    Raises
    ------
    ParameterError
        The method cannot integrate the scene, its step is too long, a stuck absorber is too heavy,
        the level would have too few samples, or the initial state is outside the cavity.
    IntegrationError
        The run failed or used up its budget. The error carries the response up to that time.
    Stopped
        The run was ended by ``stop``. The error carries the response up to that time.

    Notes
    -----
    The exact method propagates the linear modes of each regime (flight, sticking, wall contact) in
    closed form and finds the events between them by interval bounds; docs/method.md derives it.
    Levels are those of the paper (section 3.1), see `ResponseLevel`.

    Examples
    --------
    The level of an impact absorber with restitution and friction in a fast sweep through the first
    resonance of the paper's beam, with the two lowest modes:

    >>> from impact_env import Beam, Drive, beam_scene, impact_absorber, linear_sweep, simulate
    >>> absorber = impact_absorber(gap=1e-3, restitution=0.7, friction_limit=0.1)
    >>> scene = beam_scene(Beam(modes=2), absorber)
    >>> schedule = linear_sweep(scene.model.resonance_omega(1), 0.98, 1.0, 20.0)
    >>> response = simulate(scene, Drive(12.0, schedule))
    >>> print(f"{1e3 * response.recorded.level.value:.1f} mm")
    2.4 mm
    """
    method = Exact() if method is None else method
    record = Record() if record is None else instance("record", record, Record)
    scene = instance("scene", scene, Scene)
    drive = instance("drive", drive, Drive | Loads)
    progress = instance("progress", progress, Callable | None)
    stop = instance("stop", stop, Stop | None)
    initial = instance("initial", initial, InitialState | None)
    start = drive.initial_state(scene, initial).vector(scene)
    check_load(scene, drive, method)
    if record.level or record.envelope is not None:
        require_sampling(scene, drive, record.samples_per_period, start)
    solver = find_solver(scene, method)
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
    budget = (
        None if most_events is None else count("most_events", most_events, 1, MOST_EVENTS_ALLOWED)
    )

    end = float(drive.schedule.times[-1])
    interval = drive.schedule.pseudo_period / record.samples_per_period
    check = new_check(record.check and solver.searched) if _balanced(scene, record) else None
    counters = new_run_counters(drive, budget, check)
    lists = EventRecorder(record.events or record.reversals, record.reversals, counters)
    observe = _observers(scene, drive, record, interval, lists, counters)
    state = start.copy()

    def work() -> int:
        with compiling_for(scene, method):
            return solver.run(*split_forces(scene, drive), method, state, observe)

    began = time.perf_counter()
    with nullcontext() if stop is None else stop.reaching(counters):
        status = work() if progress is None else run_in_thread(work, counters, end, progress)
    wall_time = time.perf_counter() - began
    lists.close()

    complete = status == observers.DONE
    if progress is not None and complete:
        progress(end, end)
    response = _response(
        scene,
        drive,
        method,
        start,
        state,
        record,
        observe,
        lists,
        wall_time=wall_time,
        complete=complete,
    )
    if not complete:
        raise _failure(response, counters, status)
    return response


def _failure(response: Response, counters: Counters, status: int) -> IntegrationError:
    """Return the error of a run that ended early: reason, time, use of the budget, and advice."""
    counts = counters.counts
    period = response.drive.schedule.pseudo_period
    at = float(counts["reached"])
    parts = [f"{response.method} on {response.scene.absorber}: {FAILURE_REASONS[status]}"]
    parts.append(
        f"at {at:.9g} s ({at / period:.6g} of {response.drive.schedule.periods:.6g} pseudo periods)"
    )
    if isinstance(response.method, Exact):
        used = counts["events"]
        most = counts["most_events"] + counts["events_per_s"] * at
        parts.append(
            f"after {used:,.0f} events of {most:,.0f} allowed up to there and "
            f"{counts['evaluations']:,.0f} evaluations"
        )
    kind = Stopped if status == observers.STOPPED else IntegrationError
    return kind(
        ", ".join(parts) + (f". {FAILURE_ADVICE[status]}" if status in FAILURE_ADVICE else ""),
        at,
        response,
    )


def _response(
    scene: Scene,
    drive: Excitation,
    method: Method,
    start: Array,
    state: Array,
    record: Record,
    observe: Observers,
    lists: EventRecorder,
    *,
    wall_time: float,
    complete: bool,
) -> Response:
    """Return the response, up to the time reached if the run is not complete."""
    counts = observe.counters.counts
    interval = float(observe.clock.interval)
    reached = float(drive.schedule.times[-1] if complete else counts["reached"])
    impacts, phases, reversals = lists.join_lists()
    sampled = cast("LevelObserver", observe.level)
    level = None
    if record.level and (complete or sampled.state["next"] > 0):
        level = read_level(sampled, drive, interval)
    envelope = None
    if record.envelope is not None:
        edges = _envelope_edges(drive, record.envelope)
        envelope = Envelope(edges, sampled.envelope.low, sampled.envelope.high)
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
        level=level,
        impacts=impacts,
        phases=phases,
        history=_history(scene, observe, None if complete else reached) if record.series else None,
        energy=_energy(scene, observe.energy, start, state) if record.energy else None,
        check=_check(observe.counters.check),
        envelope=envelope,
        reversals=reversals,
    )


def _check(check: CheckObserver | None) -> SearchCheck | None:
    if check is None or len(check.first) == 0:
        return None
    first = check.first[: check.counts["misses"]]
    listed = first["time"], first["kind"], first["share"]
    return SearchCheck(
        int(check.counts["searches"]),
        int(check.counts["misses"]),
        float(np.max(check.worst)),
        *listed,
    )


def _history(scene: Scene, observe: Observers, reached: float | None) -> History:
    """Return the samples up to the time ``reached`` (s), None: up to the end."""
    n = scene.model.modes
    rows = cast("StateSeries", observe.series).states
    first = int(observe.clock.first)
    interval = float(observe.clock.interval)
    if reached is not None:
        rows = rows[: max(int(np.ceil(reached / interval * (1 - 1e-9))) - first, 0)]
    times = interval * np.arange(first, first + len(rows))
    half = n + scene.places
    absorber = rows[:, n:half], rows[:, half + n :]
    if not isinstance(scene.absorber, SeveralAbsorbers):
        absorber = absorber[0][:, 0], absorber[1][:, 0]
    return History(
        np.asarray(times), rows[:, :n], rows[:, half : half + n], *absorber, scene.model.tip_shape
    )


def _energy(
    scene: Scene, energy: EnergyTotals | None, start: Array, end: Array
) -> EnergyAccount | None:
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
