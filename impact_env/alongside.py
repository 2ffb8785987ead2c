"""Compile a kernel in another process while this one compiles others."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from typing import Any

from impact_env.ensemble import available_cores
from impact_env.kernels.compiling.parts import NotKept, only_kept
from impact_env.parameters import ParameterError
from impact_env.sweep import IntegrationError

Job = Callable[[], object]


@contextmanager
def alongside(kernel: Any, job: Job) -> Iterator[None]:
    """While this is entered, another process compiles what ``job`` runs, if it is not kept yet; ``kernel`` waits for that once it is called.

    ``job`` is short and can be pickled. What fails there is compiled here, and told here. Nothing is begun on a single core. A process is spawned:
    only a program may use this whose own module can be imported, which a command's can.
    """
    if available_cores() < 2 or is_kept(job):
        yield
        return
    process = get_context("spawn").Process(target=_quietly, args=(job,), daemon=True)
    process.start()
    kernel.wait = process.join
    try:
        yield
    finally:
        kernel.wait = None
        process.terminate()  # kernels are kept whole or not at all
        process.join()


def is_kept(job: Job) -> bool:
    """Run a job if all its kernels are in the cache, and return whether they are; ParameterError and IntegrationError of the job are ignored."""
    try:
        with only_kept(), suppress(ParameterError, IntegrationError):
            job()
    except NotKept:
        return False
    return True


def _quietly(job: Job) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one who waits, and ends this
    with suppress(Exception):
        job()
