"""The budget of a run in events, its progress, and how another thread stops it while its kernel runs."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import TypeVar

from impact_env.kernels.compiling.parts import abandon_compilations
from impact_env.kernels.exact.budget import EVALUATIONS_PER_EVENT, EVENTS_PER_PERIOD, FIRST_EVENTS
from impact_env.kernels.motion.observers import CheckObserver, Counters, new_counters
from impact_env.loads import AnyDrive

T = TypeVar("T")
Watcher = Callable[[float, float], None]  # takes the time reached and the end time in s
POLL_S = 0.1


class Stop:
    """Order to end runs, from any thread.

    Runs under way end at their next event or window, within microseconds; later runs end at once. Many
    runs and threads may share one order. An order that was given cannot be taken back.

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


def new_run_counters(
    drive: AnyDrive, most_events: int | None, check: CheckObserver | None = None
) -> Counters:
    """Return a run's counters with its budget; None is the default, which grows with the time reached.

    Evaluations are EVALUATIONS_PER_EVENT for each event; where events are given, as many for each pseudo period that has passed, too.
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
    """Do ``work`` in a thread and call ``progress`` ten times a second with the time reached.

    A KeyboardInterrupt, or an error in ``progress``, ends the kernel at its next event and is passed on; one that is being compiled is left behind.
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
