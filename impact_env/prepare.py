"""Compilation of missing kernels in another process.

Meanwhile the calling process can wait, show progress, or compile other kernels.
"""

import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import get_context
from typing import Any

from impact_env.checks import ParameterError, instance, non_negative
from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import available_cores
from impact_env.kernels.compiling.jit import COMPILED
from impact_env.kernels.compiling.parts import NotCached, only_cached
from impact_env.loads import Loads
from impact_env.methods import Exact, Method
from impact_env.results import Record
from impact_env.scene import Scene
from impact_env.solvers import kernel_key
from impact_env.sweep import IntegrationError, simulate

Job = Callable[[], object]


@contextmanager
def run_alongside(kernel: Any, job: Job) -> Iterator[None]:
    """Compile the kernels of ``job`` in another process while the body of this context runs.

    No process is started if the kernels are in the cache, or on a single core. At the end of the
    context an unfinished process is terminated.

    Parameters
    ----------
    kernel : compiled kernel
        Kernel of the job. A call of it in the context first waits for the process.
    job : callable
        Short function without arguments that needs the kernels; it must be picklable. If it fails
        in the other process, the kernels are compiled in this one, where the error is raised.

    Notes
    -----
    The process is spawned, so the main module of the program must be importable.
    """
    if available_cores() < 2 or is_cached(job):
        yield
        return
    process = get_context("spawn").Process(target=_run_silently, args=(job,), daemon=True)
    process.start()
    kernel.wait = process.join
    try:
        yield
    finally:
        kernel.wait = None
        process.terminate()  # kernels are kept whole or not at all
        process.join()


def is_cached(job: Job) -> bool:
    """Return whether all kernels of a job are in the cache, and run the job if they are.

    Otherwise the job ends at the first kernel that is not in the cache. ParameterError and
    IntegrationError of the job are ignored.
    """
    try:
        with only_cached(), suppress(ParameterError, IntegrationError):
            job()
    except NotCached:
        return False
    return True


def _run_silently(job: Job) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the parent, which then ends this
    with suppress(Exception):
        job()


# a short run suffices: it only has to compile the kernels
TRIAL_FORCE = 1e-3  # N
TRIAL_PERIODS = 1.0  # pseudo periods
CHILD = """import pickle, sys
sys.path[:] = {path!r}
from impact_env.first_use import suppress_announcements
with suppress_announcements():
    pickle.load(sys.stdin.buffer)()
"""


def short_run(
    scene: Scene,
    method: Method | None = None,
    record: Record | None = None,
    loads: Loads | None = None,
) -> None:
    """Simulate a run that compiles the kernels of a scene, a method and a record.

    Without ``loads`` a small force acts over one pseudo period. Loads need other kernels; the run
    then has these loads, over their whole time.
    """
    force = Drive(
        TRIAL_FORCE, constant_frequency(scene.model.resonance_omega(1), 1.0, TRIAL_PERIODS)
    )
    simulate(scene, force if loads is None else loads, method, record=record)


def is_ready(
    scene: Scene,
    method: Method | None = None,
    record: Record | None = None,
    loads: Loads | None = None,
) -> bool:
    """Return whether `simulate` needs no compilation for a scene.

    Kernels in the cache are loaded, in up to half a second.

    Parameters
    ----------
    scene : Scene
        Structure with or without absorber.
    method : Exact, Moreau or RungeKutta, optional
        Integration method (default: `Exact`).
    record : Record, optional
        What the run records. Default: the response level.
    loads : Loads, optional
        Loads of the run. None: one force.

    Returns
    -------
    bool
        Whether all kernels are compiled.

    Raises
    ------
    ParameterError
        The method cannot simulate the scene.

    See Also
    --------
    prepare : Compile them in another process.

    Examples
    --------
    >>> from impact_env import beam_scene, impact_absorber, is_ready
    >>> ready = is_ready(beam_scene(absorber=impact_absorber()))
    """
    _checked(scene, method, record)
    return not COMPILED or is_cached(partial(short_run, scene, method, record, loads))


class Preparation:
    """A process that compiles kernels, returned by `prepare`.

    Parameters
    ----------
    job : callable
        Function without arguments that needs the kernels; it must be picklable.
    """

    def __init__(self, job: Callable[[], object]) -> None:
        self._began = time.monotonic()
        self._ended: float | None = None
        code = CHILD.format(path=[str(folder) for folder in sys.path])
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        assert self._process.stdin is not None
        with self._process.stdin as pipe:
            pipe.write(pickle.dumps(job))
        self._watcher = threading.Thread(target=self._record_end, daemon=True)
        self._watcher.start()

    def _record_end(self) -> None:
        self._process.wait()
        self._ended = time.monotonic()

    @property
    def elapsed(self) -> float:
        """Time in s from the start of the process until now, or until its end if it has ended."""
        ended = self._ended
        return (time.monotonic() if ended is None else ended) - self._began

    @property
    def done(self) -> bool:
        """Whether the process has ended, with or without success."""
        return self._ended is not None

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end of the process and return whether the kernels are compiled.

        ``timeout``: longest time in s (None: no limit). The result is False if the process failed,
        was cancelled, or has not ended by then. Raises ParameterError for a negative ``timeout``.
        """
        seconds = None if timeout is None else non_negative("timeout", timeout)
        self._watcher.join(None if seconds is None else min(seconds, threading.TIMEOUT_MAX))
        return self.done and self._process.returncode == 0

    def cancel(self) -> None:
        """End the process. Kernels that it has not finished are not in the cache."""
        self._process.terminate()
        self._watcher.join()


def prepare(
    scene: Scene,
    method: Method | None = None,
    record: Record | None = None,
    loads: Loads | None = None,
) -> Preparation:
    """Start a process that compiles the kernels of `simulate` for a scene, and return at once.

    The process compiles for up to a minute, or loads kernels from the cache within two seconds,
    while the caller continues. It does not import the caller's module, so scripts need no guard.

    Parameters
    ----------
    scene : Scene
        Structure with or without absorber.
    method : Exact, Moreau or RungeKutta, optional
        Integration method (default: `Exact`).
    record : Record, optional
        What the runs record. Default: the response level.
    loads : Loads, optional
        Loads of the runs. None: one force.

    Returns
    -------
    Preparation
        The process: ``wait()`` returns when it has ended.

    Raises
    ------
    ParameterError
        The method cannot simulate the scene.

    Examples
    --------
    >>> from impact_env import beam_scene, impact_absorber, is_ready, prepare
    >>> scene = beam_scene(absorber=impact_absorber())
    >>> ready = is_ready(scene) or prepare(scene).wait()
    """
    _checked(scene, method, record)
    return Preparation(partial(short_run, scene, method, record, loads))


def _checked(scene: Scene, method: Method | None, record: Record | None) -> None:
    record = instance("record", record, Record | None)
    kernel_key(
        instance("scene", scene, Scene),
        Exact() if method is None else instance("method", method, Method),
    )
