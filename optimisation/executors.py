"""Where the runs of a command are made: on the cores of this machine, or by a cluster's workers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from impact_env.ensemble import Executor, Threads
from impact_env.extras import how_to_install
from impact_env.parameters import ParameterError

if TYPE_CHECKING:
    from optimisation.search.cluster import Workers

cluster_option = click.option("--cluster", metavar="ADDRESS", help="Send the runs to the workers of the Dask scheduler at this address instead.")


@contextmanager
def workers(threads: int | None, cluster: str | None) -> Iterator[Workers | None]:
    """Give the workers of the scheduler at ``cluster`` (host:port), or None if there is no such option.

    Raises ParameterError with ``threads``, which are this machine's, and where the package distributed is missing; ClusterError if nothing answers.
    """
    if cluster is None:
        yield None
        return
    if threads is not None:
        raise ParameterError(f"--threads = {threads} is not allowed: with --cluster, whose workers have their own")
    try:
        from optimisation.search.cluster import Workers
    except ImportError as error:
        raise ParameterError(
            f"--cluster = {cluster} is not allowed: where the package distributed is installed; {how_to_install('cluster')}"
        ) from error
    with Workers(cluster) as found:
        yield found


@contextmanager
def executor(threads: int | None, cluster: str | None) -> Iterator[Executor]:
    """Give the executor of a study: `workers`, or else threads (None: all cores)."""
    with workers(threads, cluster) as found:
        yield Threads(threads) if found is None else found
