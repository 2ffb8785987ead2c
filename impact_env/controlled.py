"""Controlled runs: many lanes of one scene that advance together by one control interval a call.

Before each interval every lane takes new orders (rate, gap, friction).

A lane's run is that of `simulate` with the same schedule; see `impact_env.kernels.control.interval`
for what is ordered and reported.
"""

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numba import typeof
from numpy.typing import NDArray

from impact_env.checks import count, positive, require
from impact_env.ensemble import available_cores
from impact_env.first_use import compiling_for
from impact_env.kernels.compiling.jit import COMPILED
from impact_env.kernels.control.interval import (
    ORDER,
    REPORT,
    Batch,
    Disturbance,
    LaneSettings,
    find_failed_lane,
    new_lanes,
    scan_orders,
)
from impact_env.kernels.control.lanes import PARTS_DONE, PARTS_LEFT, WorkQueue, new_work_queue
from impact_env.kernels.motion.observers import ORDER_REFUSED
from impact_env.laws import SceneKind
from impact_env.level import (
    HALF_WINDOW_PERIODS,
    LEAST_SAMPLES_PER_CYCLE,
    require_samples,
    require_spectrum,
    response_spectrum,
)
from impact_env.loads import BASE_QUANTITY, Samples
from impact_env.methods import Exact, Method
from impact_env.parameters import CoulombFriction, SlidingAbsorber, require_weightless
from impact_env.scene import Scene
from impact_env.solvers import build_base_motion, check_general, find_solver
from impact_env.sweep import FAILURE_REASONS, IntegrationError

Array = NDArray[np.float64]
LANES_PER_THREAD = 64  # lanes a thread must have to be worth its start
ABSENT_RECORD_STEP = 10.0  # intervals: the step of a record that is not there
# between calls: threads stay for the next call where calls follow one another as quickly as this
QUICK_S = 2e-4
# checks of the queue before a helper thread sleeps: some 0.3 ms, just enough for the next call
SPINS_BEFORE_SLEEP = 1 << 16
SPINS_BETWEEN_CHECKS = 1 << 9
# of an interval's samples: rounding of a product, and of a quotient that gave the interval
SAMPLES_TOL = 1e-9
# what orders can change in some scenes only, and where
CHANGED_ORDERS = {
    "gap": "walls that move are for rigid walls, and the exact method or Moreau's",
    "limit": (
        "a friction limit that changes is for rigid friction, and the exact method or Moreau's"
    ),
    "place": "there is no record beside the force",
}
PARTS_PER_THREAD = 4  # of a thread, since lanes differ in their number of impacts


def friction_limit(scene: Scene) -> float:
    """Return the limit of the absorber's rigid friction in N, infinity without such friction.

    The kernels of a scene without rigid friction do not read the limits in the orders. The Moreau
    scheme computes a stuck absorber as an absorber with an infinite limit.
    """
    friction = scene.absorber.friction if isinstance(scene.absorber, SlidingAbsorber) else None
    return friction.limit if isinstance(friction, CoulombFriction) else math.inf


def _build_disturbance(
    scene: Scene, method: Method, record: Samples | None, moves_base: bool, interval: float
) -> Disturbance | None:
    """Return the load that acts in addition to the orders' force, or None without such a load.

    ``interval`` is the control interval in s. Raises ParameterError for a scene or method that
    cannot have such a load.
    """
    base = check_general(scene, method, record, moves_base=moves_base)
    if record is None and not moves_base:
        return None
    values = np.zeros(1) if record is None else np.array(record.values[:-1])
    step = ABSENT_RECORD_STEP * interval if record is None else record.duration / len(values)
    of_base = [moves_base, record is not None and record.quantity == BASE_QUANTITY]
    channel = np.array(of_base, dtype=np.int64)
    return Disturbance(values, step, channel, build_base_motion(scene, base))


Kernel = Callable[[int, int], bool]


class WorkerPool:
    """A calling thread and its helper threads, which share the parts of a work queue.

    Each thread has its own kernel of `impact_env.kernels.control.lanes`, which takes parts from the
    queue and computes them.

    ``make_kernel`` returns a kernel with memory of its own; it is called once for each thread, when
    the thread is first needed.
    """

    def __init__(self, make_kernel: Callable[[], Kernel], queue: WorkQueue) -> None:
        self._make_kernel = make_kernel
        self._queue = queue
        self._kernels: list[Kernel] = []  # the caller's, then those of the helpers
        self._pool: ThreadPoolExecutor | None = None
        self._helpers: list[Future[bool]] = []
        self._ended = 0.0

    def kernel(self, worker: int) -> Kernel:
        """Return the kernel of the caller, 0, or of a helper, from 1."""
        while len(self._kernels) <= worker:
            self._kernels.append(self._make_kernel())
        return self._kernels[worker]

    def bind(self) -> None:
        """Call the machine code of the kernels directly from now on, see `bind_kernel`.

        The kernels must have been called before with arguments of the same types.
        """
        make = self._make_kernel
        self._make_kernel = lambda: bind_kernel(make())
        self._kernels = [bind_kernel(kernel) for kernel in self._kernels]

    def work(self, parts: NDArray[np.int64], helpers: int) -> None:
        """Compute all parts with ``helpers`` helper threads and return when they are done.

        ``parts`` (P, 2) has one range of lanes [low, high) in each row. The calling thread computes
        parts as well, so no part waits for a helper that starts late.
        """
        number = len(parts)
        self._queue.cuts[:number] = parts
        take = self.kernel(0)
        try:
            if helpers:
                self._call(helpers)
            done = take(number, 0)
            while not done:  # a helper has been put off its core in the midst of a part
                for helper in self._helpers:
                    if helper.done():
                        helper.result()  # raises what went wrong there
                time.sleep(0)
                done = self._queue.words[PARTS_DONE] == number
        except BaseException:
            # Ctrl-C, or no memory: a part that is left over or being computed must not be taken for
            # one of the next call
            self._queue.words[PARTS_LEFT] = 0
            self.close()
            raise
        if helpers:
            self._ended = time.perf_counter()

    def _call(self, helpers: int) -> None:
        """Start the helper threads that have not started or have ended."""
        quick = time.perf_counter() - self._ended < QUICK_S
        if self._pool is None:
            self._pool = ThreadPoolExecutor(helpers)
        polls = SPINS_BEFORE_SLEEP if quick else SPINS_BETWEEN_CHECKS
        for k in range(helpers):
            kernel = self.kernel(1 + k)
            if k == len(self._helpers):
                self._helpers.append(self._pool.submit(kernel, 0, polls))
            elif self._helpers[k].done():
                self._helpers[k] = self._pool.submit(kernel, 0, polls)

    def close(self) -> None:
        """End the threads; they start again when they are needed."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
            self._helpers = []


class ControlledRuns:
    """Lanes of one scene, each at its own time, advanced together by one control interval.

    Parameters
    ----------
    scene : Scene
        Scene of all lanes, with one absorber or none.
    lanes : int
        Number L of lanes.
    reference : float
        Circular frequency in rad/s that defines the pseudo period.
    interval : float
        Longest control interval in pseudo periods, a whole number of samples.
    method : Exact, Moreau or RungeKutta, optional
        Integration method (default: `Exact`).
    samples_per_period : int
        Samples of the level in a pseudo period.
    exponent : float, optional
        Exponent of the damage in the reports; 0: the damage is not computed.
    unit : float, optional
        Unit of the displacements in the damage, in m.
    threads : int, optional
        Threads (default: all cores). The result does not depend on it.
    record : Samples, optional
        Load that acts in addition to the orders' force and repeats: its last value takes the place
        of its first. The orders' ``place`` is the position in it, in steps, at which an interval
        begins. Only for the exact method and rigid contact, as in `Loads`.
    moves_base : bool, optional
        The orders' force is the acceleration of the base in m/s^2. Only for the exact method and
        rigid contact.

    Attributes
    ----------
    orders : structured array, (L,)
        What the next `advance` does, with the fields of `kernels.control.interval.ORDER`. An
        ordered duration is at most ``duration``.
    reports : structured array, (L,)
        Results of the last `advance`, with the fields of `kernels.control.interval.REPORT`.
    idle : array of bool, (L,)
        Lanes that the next `advance` skips; their state and report do not change.
    duration : float
        Duration of the longest interval in s.
    wall_time : float
        Computing time of the last `advance` in s.

    Raises
    ------
    ParameterError
        A value is out of range, or the method cannot compute the scene in intervals.
    """

    def __init__(
        self,
        scene: Scene,
        lanes: int,
        reference: float,
        interval: float,
        method: Method | None = None,
        *,
        samples_per_period: int,
        exponent: float = 0.0,
        unit: float = 1.0,
        threads: int | None = None,
        record: Samples | None = None,
        moves_base: bool = False,
    ) -> None:
        method = Exact() if method is None else method
        kernels = find_solver(scene, method)
        disturbance = _build_disturbance(
            scene,
            method,
            record,
            moves_base,
            interval * 2 * np.pi / positive("reference", reference),
        )
        require_weightless(scene.absorber, "a run that is controlled in intervals")
        require(
            kernels.lanes is not None,
            "absorber",
            scene.absorber,
            "one absorber in a run that is controlled in intervals",
        )
        self.scene = scene
        self.method = method
        self.lanes = count("lanes", lanes, 1)
        self.threads = available_cores() if threads is None else count("threads", threads, 1)
        period = 2 * np.pi / positive("reference", reference)
        modes = scene.model.modes
        samples = count_whole_samples(interval, count("samples_per_period", samples_per_period, 1))
        self.duration = samples * period / samples_per_period
        self.orders = np.zeros(lanes, ORDER)
        self.reports = np.zeros(lanes, REPORT)
        self.status = np.zeros(lanes, dtype=np.int64)
        self.idle = np.zeros(lanes, dtype=np.bool_)
        self._rows = np.arange(lanes)  # where in the memory a lane's is
        slots = kernels.slots(scene, period)
        self._memory = new_lanes(
            lanes, slots, 2 * modes + 2, HALF_WINDOW_PERIODS * samples_per_period
        )
        self._samples_per_period = samples_per_period
        if record is not None:
            result = response_spectrum(scene.model, record)
            require_spectrum(samples_per_period, reference, record, *result)
        mass = 0.0 if scene.absorber_mass is None else scene.absorber_mass
        omega, tip, read = (
            np.array(row)
            for row in (scene.model.omega, scene.model.tip_shape, scene.model.level_shape)
        )
        place = np.zeros(0) if scene.model.response_shape is None else read
        watch = LaneSettings(
            period / samples_per_period,
            samples,
            float(exponent),
            unit,
            omega,
            tip,
            mass,
            read,
            place,
            disturbance,
        )
        self._watch = watch
        self._period = period
        self._pool = self._new_pool()
        self._compiled = False
        self.wall_time = 0.0
        self._shares: dict[int, NDArray[np.int64]] = {}
        self.orders["duration"] = self.duration
        cavity = scene.cavity(0)
        if cavity is not None:
            self.orders["gap"] = cavity.gap
        self.orders["limit"] = friction_limit(scene)
        self._unread = {
            name: (self.orders[name][0].item(), where)
            for name, where in CHANGED_ORDERS.items()
            if name not in _find_changeable_orders(scene, disturbance is not None)
        }
        self._orders_read = (
            np.array([name not in self._unread for name in CHANGED_ORDERS]),
            np.array([self.orders[name][0] for name in CHANGED_ORDERS]),
        )
        # rad/s, above which the level has too few samples of a cycle
        self._highest = 2 * np.pi * (1 + 1e-9) / (LEAST_SAMPLES_PER_CYCLE * watch.sample_dt)
        self.restart(np.arange(lanes))

    def _new_pool(self) -> WorkerPool:
        """Return the threads that advance the lanes."""
        batch = Batch(self._watch, self._memory, self.orders, self.reports, self.status)
        queue = new_work_queue(self.lanes)
        solver = find_solver(self.scene, self.method)

        def make_kernel() -> Kernel:
            kernel = solver.control(self.scene, self.method, self._period, batch)
            return partial(kernel, queue)

        pool = WorkerPool(make_kernel, queue)
        pool.kernel(0)  # what the method cannot do is refused here, not at the first step
        return pool

    def __getstate__(self) -> dict[str, Any]:
        """Leave out threads and compiled code, which cannot be copied."""
        return {
            name: value
            for name, value in vars(self).items()
            if name not in ("_pool", "_members", "_threads")
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._pool = self._new_pool()
        self._compiled = False

    @property
    def state(self) -> Array:
        """State of each lane, (L, 2 N_m + 2).

        Its columns are modal displacements, absorber displacement, modal velocities and absorber
        velocity.
        """
        return self._memory.state

    def restart(self, which: NDArray[Any]) -> None:
        """Put lanes at rest with the absorber in the middle of the cavity.

        ``which`` contains indices or is a mask. The next interval of these lanes is the first of a
        run.
        """
        rows = self._rows[which]
        self._memory.state[rows] = 0.0
        self._memory.last_order["gap"][rows] = self.orders["gap"][which]
        self.reports[which] = np.zeros(1, REPORT)
        self.orders["fresh"][which] = True

    def advance(self) -> None:
        """Advance all lanes but idle ones by the intervals in ``orders``.

        Raises ParameterError for an order that the scene's kernels do not read or cannot do, or a
        force that is too fast for the samples of the level, and IntegrationError, naming the first
        lane, if a run breaks down.
        """
        began = time.perf_counter()
        rests = self._check_orders()
        workers = (
            max(1, min(self.threads, self.lanes // LANES_PER_THREAD))
            if COMPILED and self._compiled
            else 1
        )  # in plain Python threads only take turns
        self._do(self._parts(workers, rests), workers)
        self._check()
        self.wall_time = time.perf_counter() - began

    def _do(self, parts: NDArray[np.int64], workers: int = 1) -> None:
        """Advance the lanes of the ranges [low, high) in the rows of ``parts`` (P, 2).

        ``workers`` is the number of threads, with the calling thread. The first call compiles the
        kernels, in one thread.
        """
        if self._compiled:
            self._pool.work(parts, workers - 1)
        else:
            with compiling_for(self.scene, self.method, "environments"):
                self._pool.work(parts, 0)
            self._pool.bind()
            self._compiled = True

    def _check_orders(self) -> bool:
        """Return whether any lane is idle.

        Raises ParameterError for an order that the kernels would ignore, and for a force whose
        frequency is too high.
        """
        highest, differs, rests = scan_orders(self.orders, self.idle, *self._orders_read)
        if differs:
            self._refuse_orders()
        if highest > self._highest:
            acts = (self.orders["force"] != 0) & ~self.idle
            fastest = np.maximum(self.orders["omega_start"], self.orders["omega_stop"])
            ratio = fastest[acts].max(initial=0.0) * self._period / (2 * np.pi)
            require_samples(self._samples_per_period, float(ratio))
        return bool(rests)

    def _refuse_orders(self) -> None:
        """Raise ParameterError for the first order that the kernels would ignore.

        Such an order changes a quantity that the kernels of this scene do not read.
        """
        for name, (value, where) in self._unread.items():
            wanted = self.orders[name]
            changed = wanted != value
            if changed.any():
                lane = int(np.argmax(changed))
                require(
                    False,
                    f'orders["{name}"][{lane}]',
                    wanted[lane].item(),
                    f"{value:g} in this scene: {where}",
                )

    def _check(self) -> None:
        """Raise an error that names the first failed lane, or do nothing if none failed.

        Raises ParameterError for an order that was refused, and IntegrationError for a run that
        broke down.
        """
        lane = int(find_failed_lane(self.status))
        if lane >= 0:
            order = self.orders[lane]
            place = float(order["place"])
            require(math.isfinite(place), f'orders["place"][{lane}]', place, "steps, finite")
            require(
                self.status[lane] != ORDER_REFUSED,
                f'orders["duration"][{lane}]',
                float(order["duration"]),
                f"above 0 s, and at most the longest interval's {self.duration:g} s",
            )
            raise IntegrationError(
                f"lane {lane}, {self.method} on {self.scene.absorber}: "
                f"{FAILURE_REASONS[int(self.status[lane])]}"
            )

    def _parts(self, workers: int, rests: bool) -> NDArray[np.int64]:
        """Return ranges of lanes that are not idle, one [low, high) in each row (P, 2).

        ``rests``: whether any lane is idle. The number P grows with the number of ``workers``.
        """
        if workers not in self._shares:
            number = 1 if workers == 1 else PARTS_PER_THREAD * workers
            self._shares[workers] = _pair_cuts(
                np.unique(np.linspace(0, self.lanes, 1 + number).astype(np.int64))
            )
        parts = self._shares[workers]
        if not rests:
            return parts
        cuts = np.union1d(parts[:, 0], np.flatnonzero(np.diff(self.idle)) + 1)
        finer = _pair_cuts(np.append(cuts, self.lanes))
        return finer[~self.idle[finer[:, 0]]]

    def snapshot(self) -> list[Array]:
        """Return copies of all arrays that the next `advance` depends on, for `restore`."""
        return [values.copy() for values in self._variables()]

    def restore(self, snapshot: list[Array]) -> None:
        """Set the runs back to a snapshot of runs that were made with the same arguments."""
        for values, saved in zip(self._variables(), snapshot, strict=True):
            values[...] = saved

    def copy_from(self, source: "ControlledRuns", times: int = 1) -> None:
        """Continue from the runs of another group of lanes.

        Each run of ``source`` is copied into ``times`` consecutive lanes. Both groups were made
        with the same arguments except for the number of lanes. Raises ParameterError unless this
        group has ``times`` as many lanes as ``source``.
        """
        times = count("times", times, 1)
        allowed = f"{times} times the {source.lanes} lanes of the source"
        require(self.lanes == times * source.lanes, "lanes", self.lanes, allowed)
        for own, values in zip(self._variables(), source._variables(), strict=True):
            own[...] = np.repeat(values, times, axis=0)

    def _variables(self) -> list[NDArray[Any]]:
        return [self.orders, self.reports, self.status, *self._memory]

    def close(self) -> None:
        """End the threads; they start again when they are needed."""
        self._pool.close()


def _find_changeable_orders(scene: Scene, has_disturbance: bool) -> set[str]:
    """Return which of `CHANGED_ORDERS` the kernels of a scene read.

    ``has_disturbance`` says whether a record or a moving base acts in addition to the single force.
    """
    result = {"place"} if has_disturbance else set()
    absorber = scene.absorber
    if scene.kind is SceneKind.RIGID and isinstance(absorber, SlidingAbsorber):
        result |= {"gap"} if absorber.walls is not None else set()
        result |= {"limit"} if absorber.friction is not None else set()
    return result


def count_whole_samples(interval: float, samples_per_period: int) -> int:
    """Return the number of samples in a control interval, which is given in pseudo periods.

    Raises ParameterError if the number is not whole.
    """
    samples = positive("interval", interval) * samples_per_period
    require(
        round(samples) >= 1 and abs(samples - round(samples)) <= SAMPLES_TOL * samples,
        "interval",
        interval,
        f"a multiple of 1/{samples_per_period} pseudo periods, one sample",
    )
    return round(samples)


def bind_kernel(kernel: Any) -> Kernel:
    """Return the machine code of a compiled kernel, with the kernel's arguments bound to it.

    In an ordinary call numba inspects the types of the arguments, which takes 8 of 12 us. The
    machine code does not check its arguments, so their types are compared here, once: raises
    TypeError if the kernel has not been compiled for them.
    """
    if not COMPILED:
        return kernel
    types = tuple(map(typeof, (*kernel.args, 0, 0)))
    result = kernel.func.overloads.get(types)
    if result is None:
        raise TypeError(f"{kernel.func.__name__} is not compiled for {types}")
    for values in _collect_arrays(kernel.args):
        if not (values.flags.c_contiguous and values.flags.aligned):
            raise TypeError(f"{kernel.func.__name__} takes arrays that are contiguous and aligned")
    return partial(result.entry_point, *kernel.args)


def _collect_arrays(values: Any) -> list[NDArray[Any]]:
    """Return all arrays in nested tuples."""
    if isinstance(values, tuple):
        return [array for value in values for array in _collect_arrays(value)]
    return [values] if isinstance(values, np.ndarray) else []


def _pair_cuts(cuts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the ranges [low, high) between n + 1 ascending cuts, (n, 2)."""
    return np.column_stack([cuts[:-1], cuts[1:]])


class PooledRuns(ControlledRuns):
    """Lanes that run scenes of a pool.

    ``which`` (L,) is the index into ``scenes`` of each lane's scene; a caller changes its values in
    place before `advance`. ``options`` are further arguments of `ControlledRuns`.

    All scenes have the same number of modes, the same kind of absorber and the same ``reference``
    frequency. The kernels of a scene are built when a lane first needs them. The states are stored
    scene by scene, so that one call of compiled code advances a contiguous range of lanes; orders
    and reports are in the order of the lanes.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        lanes: int,
        reference: float,
        interval: float,
        method: Method | None = None,
        **options: Any,
    ) -> None:
        self._make: Callable[..., ControlledRuns] = partial(
            ControlledRuns, reference=reference, interval=interval, method=method, **options
        )
        self.scenes = tuple(scenes)
        self.which = np.zeros(lanes, dtype=np.int64)
        self._members: dict[int, ControlledRuns] = {}
        super().__init__(scenes[0], lanes, reference, interval, method, **options)
        self._ordered, self._reported, self._ended = (
            self.orders.copy(),
            self.reports.copy(),
            self.status.copy(),
        )
        self._laid = self.which.copy()
        self._still: NDArray[np.bool_] | None = (
            None  # the lanes that rested when the turns were made; None: make them anew
        )
        self._turns: list[tuple[int, NDArray[np.int64]]] = []  # of scenes: which rows are advanced
        self._threads: ThreadPoolExecutor | None = None

    def _member(self, number: int) -> ControlledRuns:
        if number not in self._members:
            made = self._make(self.scenes[number], self.lanes)
            require(
                made._memory.z.shape == self._memory.z.shape,
                "scenes",
                made.scene,
                "scenes with as many modes and the same kind of absorber",
            )
            made.orders = self._ordered
            made.reports = self._reported
            made.status = self._ended
            made._memory = self._memory
            made._pool = made._new_pool()
            self._members[number] = made
        return self._members[number]

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._members = {}
        self._threads = None

    def _lay(self, order: NDArray[np.int64]) -> None:
        """Sort the memory of the lanes: lane ``order[k]`` gets row k."""
        rows = self._rows[order]
        for values in self._memory:
            values[...] = values[rows]
        self._rows[order] = np.arange(self.lanes)

    @property
    def state(self) -> Array:
        """State of each lane, a copy (L, 2 N_m + 2)."""
        return np.asarray(self._memory.state[self._rows])

    def advance(self) -> None:
        """Advance all lanes that are not idle, scene by scene.

        Raises the errors of `ControlledRuns.advance`.
        """
        began = time.perf_counter()
        self._check_orders()
        if not np.array_equal(self._laid, self.which):
            self._lay(np.argsort(self.which, kind="stable"))
            self._laid[...], self._still = self.which, None
        if self._still is None or not np.array_equal(self._still, self.idle):
            self._take_turns()
        rows = self._rows
        self._ordered[rows], self._reported[rows], self._ended[rows] = (
            self.orders,
            self.reports,
            self.status,
        )
        self._advance_scenes()
        self.orders[...], self.reports[...], self.status[...] = (
            self._ordered[rows],
            self._reported[rows],
            self._ended[rows],
        )
        self._check()
        self.wall_time = time.perf_counter() - began

    def _advance_scenes(self) -> None:
        """Advance the lanes scene by scene, each scene in one thread.

        The calling thread and its helpers each take the next scene when they are free.
        """
        members = [(self._member(number), parts) for number, parts in self._turns]
        workers = min(self.threads, self.lanes // LANES_PER_THREAD, len(members))
        turns = iter(members)

        def advance_rest() -> None:
            for member, parts in turns:
                member._do(parts)

        if workers < 2 or not COMPILED or not all(member._compiled for member, _ in members):
            advance_rest()
            return
        if self._threads is None:
            self._threads = ThreadPoolExecutor(workers - 1)
        helpers = [self._threads.submit(advance_rest) for _ in range(workers - 1)]
        try:
            advance_rest()
        finally:
            for helper in helpers:
                helper.result()

    def _take_turns(self) -> None:
        scenes = np.empty_like(self.which)
        idle = np.empty_like(self.idle)
        scenes[self._rows], idle[self._rows] = self.which, self.idle
        cuts = np.union1d(np.flatnonzero(np.diff(scenes) | np.diff(idle)) + 1, (0, self.lanes))
        parts = _pair_cuts(cuts)
        at = scenes[parts[:, 0]]
        wanted = ~idle[parts[:, 0]]
        self._turns = [
            (number, parts[wanted & (at == number)]) for number in np.unique(at[wanted]).tolist()
        ]
        self._still = self.idle.copy()

    def _variables(self) -> list[NDArray[Any]]:
        self._lay(np.arange(self.lanes))  # what is kept is then that of lane after lane
        self._laid[...] = -1
        self._still = None
        return [*super()._variables(), self.which]

    def close(self) -> None:
        """End the threads; they start again when they are needed."""
        if self._threads is not None:
            self._threads.shutdown()
            self._threads = None
