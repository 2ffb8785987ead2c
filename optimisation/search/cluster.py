"""Runs on other machines: chunks of lanes sent to the workers of a Dask scheduler (``distributed``).

A chunk is the same plain data that a thread of this machine would get, and a worker measures it with the same function, so the
results are the same bit for bit on machines of one kind (docs/method.md says what another processor may change). A worker that dies
costs time only: the scheduler gives its chunks to another.
"""

from __future__ import annotations

import queue
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import suppress
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import first_of_each
from impact_env.extras import optional
from impact_env.families import kernel_key
from impact_env.kernels.cache import digest
from impact_env.methods import Exact
from impact_env.parameters import ParameterError
from optimisation.measures import Chunk, measure

with optional():
    import distributed

Array = NDArray[np.float64]
PATIENCE = 30.0  # s to wait for a scheduler, or for a worker when there is none
POLL = 2.0  # s between two looks for workers while nothing comes in


class ClusterError(ParameterError):
    """The scheduler or its workers cannot be used; the message says why and what to do."""


class Workers:
    """The workers of the scheduler at ``address`` (host:port), as an `optimisation.evaluation.Executor`; use it in a ``with`` statement."""

    def __init__(self, address: str, patience: float = PATIENCE) -> None:
        self._address, self._patience = address, patience
        try:
            self._client = distributed.Client(address, timeout=patience, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ClusterError(f"--cluster = {address} is not allowed: an address (host:port) where a Dask scheduler answers ({error})") from error

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with suppress(TimeoutError, OSError):
            self._client.close(timeout=self._patience)

    def run(self, chunks: Sequence[Chunk]) -> Iterator[tuple[int, Array]]:
        """See `optimisation.evaluation.Executor`. The first chunk of each kind is run here, which compiles its kernel before workers need it."""
        # kernels are compiled for each kind of scene and record: workers that share this machine's cache then find them there
        first = first_of_each([(kernel_key(chunk.lanes[0].scene, Exact()), chunk.record) for chunk in chunks])
        for k in first:
            yield k, measure(chunks[k])
        rest = [k for k in range(len(chunks)) if k not in set(first)]
        if not rest:
            return
        self._require_same_sources()
        call = uuid.uuid4().hex
        futures = {self._client.submit(measure, chunks[k], key=f"measure-{call}-{k}", priority=-k, pure=False, retries=0): k for k in rest}
        try:
            yield from self._finished(futures)
        finally:
            with suppress(Exception):
                self._client.cancel(list(futures), force=True)

    def _finished(self, futures: dict[distributed.Future, int]) -> Iterator[tuple[int, Array]]:
        finished: queue.SimpleQueue[distributed.Future] = queue.SimpleQueue()
        for future in futures:
            future.add_done_callback(finished.put)
        left, alive_at = len(futures), time.monotonic()
        while left:
            try:
                future = finished.get(timeout=POLL)
            except queue.Empty:
                if self._workers():
                    alive_at = time.monotonic()
                elif time.monotonic() - alive_at > self._patience:
                    raise ClusterError(self._lost("has no worker left")) from None
                continue
            alive_at, left = time.monotonic(), left - 1
            yield futures[future], self._result(future)

    def _result(self, future: distributed.Future) -> Array:
        try:
            return np.asarray(future.result())
        except distributed.scheduler.KilledWorker as error:
            raise ClusterError(self._lost("has lost worker after worker over one chunk")) from error
        except distributed.client.FutureCancelledError as error:
            raise ClusterError(self._lost("has dropped the runs")) from error

    def _workers(self) -> dict[str, object]:
        with suppress(OSError, TimeoutError, ValueError):
            return dict(self._client.scheduler_info(n_workers=-1)["workers"])
        return {}

    def _lost(self, what: str) -> str:
        return f"--cluster = {self._address}: the scheduler {what}; the study keeps what is finished: start workers and run it again"

    def _require_same_sources(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=self._patience)
        except (TimeoutError, distributed.TimeoutError) as error:
            raise ClusterError(f"--cluster = {self._address} is not allowed: a scheduler with one or more workers") from error
        for worker, theirs in self._client.run(sources).items():
            if theirs != sources():
                raise ClusterError(f"worker = {worker} is not allowed: one with the same version of this package ({sources()}), not {theirs}")


def sources() -> str:
    """Return the name that the kernels' sources have in their cache: the same where the kernels are the same."""
    return digest()
