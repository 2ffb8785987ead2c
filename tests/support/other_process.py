"""Use a kernel that another process compiles.

Argument 1 is "well" or "badly" (it fails in the other process).
"""

import multiprocessing
import sys
from functools import partial
from importlib import import_module

from impact_env.kernels.periodic.closed_form import SymmetricLine, compute_phase

prepare_module = import_module("impact_env.prepare")  # not the function of that name
LINE = SymmetricLine(1.0, 2.0, 3.0, 4.0, 1.0 + 1.0j)


def job(way: str) -> None:
    """Call the kernel, or fail in the other process before it."""
    if way == "badly" and multiprocessing.parent_process() is not None:
        raise RuntimeError("this must not be seen")
    compute_phase(LINE, 1.0, 0.5)


def main(way: str) -> None:
    """Print how a kernel was prepared by another process.

    The line has whether it was cached before, the number of processes, how often it was loaded, how
    many processes still run, the process that the kernel waits for (None), and whether it is cached
    now.
    """
    prepare_module.available_cores = lambda: 2
    call = partial(job, way)
    before = prepare_module.is_cached(call)
    with prepare_module.run_alongside(compute_phase, call):
        processes = len(multiprocessing.active_children())
        compute_phase(LINE, 1.0, 0.5)
    left = len(multiprocessing.active_children())
    print(
        before,
        processes,
        sum(compute_phase.stats.cache_hits.values()),
        left,
        compute_phase.wait,
        prepare_module.is_cached(call),
    )


if __name__ == "__main__":
    main(sys.argv[1])
