"""Runs on other machines: pieces of work sent to the workers of a Dask scheduler (``distributed``).

A piece has the same data as for a thread of this machine, and a worker calls the same function, so
the results are bit for bit the same on machines of one kind (docs/method.md has the effect of other
processors). Each piece contains the fingerprint of its sources, which the worker compares with its
own, so no result comes from other sources. If a worker dies, the scheduler gives its pieces to
another one.
"""

from __future__ import annotations

import queue
import time
import uuid
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from impact_env.ensemble import find_first_of_each
from impact_env.extras import optional
from impact_env.sweep import IntegrationError
from optimisation.checkpoint import difference, source_hash

with optional():
    import distributed

Array = NDArray[np.float64]
PATIENCE = 30.0  # s to wait for a scheduler, or for a worker when there is none
POLL = 2.0  # s between two looks for workers while nothing comes in
SOURCES = (
    source_hash()
)  # of what this process has just loaded: its files may be others by the time of a run
SAME = "the same version of this package and of what it computes with"
T = TypeVar("T")
R = TypeVar("R")


class ClusterError(ParameterError):
    """The scheduler or its workers cannot be used; the message says why and what to do."""


class Workers:
    """The workers of the scheduler at ``address`` (host:port).

    They are an `impact_env.ensemble.Executor`, to be used in a ``with`` statement.
    """

    def __init__(self, address: str, patience: float = PATIENCE) -> None:
        self._address = address
        self._patience = patience
        try:
            self._client = distributed.Client(address, timeout=patience, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ClusterError(
                f"--cluster = {address} is not allowed: an address (host:port) where a Dask "
                f"scheduler answers ({error})"
            ) from error

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with suppress(TimeoutError, OSError):
            self._client.close(timeout=self._patience)

    def each(
        self, function: Callable[[T], R], items: Sequence[T], kinds: Sequence[Hashable]
    ) -> Generator[tuple[int, R], None, None]:
        """Run items on the workers, see `impact_env.ensemble.Executor`.

        The first item of each kind is run in this process, so that its kernels are compiled before
        the workers need them.

        Raises ClusterError if there are no workers, or one of other sources; ParameterError and
        IntegrationError as the function does.
        """
        first = find_first_of_each(
            kinds
        )  # workers that share this machine's cache then find the kernels there
        for k in first:
            yield k, function(items[k])
        rest = [k for k in range(len(items)) if k not in set(first)]
        if not rest:
            return
        try:
            self._client.wait_for_workers(1, timeout=self._patience)
        except (TimeoutError, distributed.TimeoutError) as error:
            raise ClusterError(
                f"--cluster = {self._address} is not allowed: a scheduler with one or more workers"
            ) from error
        call = uuid.uuid4().hex
        keys = {k: f"{call}-{k}" for k in rest}
        futures = {
            self._client.submit(
                run_item,
                SOURCES,
                function,
                items[k],
                key=keys[k],
                priority=-k,
                pure=False,
                retries=0,
            ): k
            for k in rest
        }
        try:
            yield from self._collect(futures)
        finally:
            with suppress(Exception):
                self._client.cancel(list(futures), force=True)

    def _collect(self, futures: dict[distributed.Future, int]) -> Iterator[tuple[int, Any]]:
        finished: queue.SimpleQueue[distributed.Future] = queue.SimpleQueue()
        for future in futures:
            future.add_done_callback(finished.put)
        left = len(futures)
        alive_at = time.monotonic()
        while left:
            try:
                future = finished.get(timeout=POLL)
            except queue.Empty:
                workers: dict[str, object] = {}
                with suppress(OSError, TimeoutError, ValueError):
                    workers = self._client.scheduler_info(n_workers=-1)["workers"]
                if workers:
                    alive_at = time.monotonic()
                elif time.monotonic() - alive_at > self._patience:
                    raise ClusterError(self._describe_loss("has no worker left")) from None
                continue
            alive_at = time.monotonic()
            left = left - 1
            yield futures[future], self._result(future)

    def _result(self, future: distributed.Future) -> Any:
        try:
            return future.result()
        except distributed.scheduler.KilledWorker as error:
            raise ClusterError(
                self._describe_loss("has lost worker after worker over one piece of work")
            ) from error
        except distributed.client.FutureCancelledError as error:
            raise ClusterError(self._describe_loss("has dropped the runs")) from error
        except (ParameterError, IntegrationError):
            raise
        except Exception as error:  # a worker that does not even know the function or the data
            raise ClusterError(
                f"--cluster = {self._address} is not allowed: workers with {SAME}; one could "
                f"not do its work ({error!r})"
            ) from error

    def _describe_loss(self, what: str) -> str:
        return (
            f"--cluster = {self._address}: the scheduler {what}; the study keeps what is "
            "finished: start workers and run it again"
        )


def run_item(sources: dict[str, str], function: Callable[[T], R], item: T) -> R:
    """Return ``function(item)``, on a worker.

    Raises ClusterError if the worker's sources differ from the given ones.
    """
    if sources != SOURCES:
        other = difference(SOURCES, sources, "sources")
        raise ClusterError(
            f"worker = {distributed.get_worker().address} is not allowed: one with {SAME}; "
            f"its {other}"
        )
    return function(item)
