"""What becomes of a kernel that another process compiles: argument 1 is "well" or "badly" (it fails there)."""

import multiprocessing
import sys
from functools import partial
from importlib import import_module

from impact_env.kernels.periodic.closed_form import Line, phase_of

beside = import_module("impact_env.prepare")  # not the function of that name
LINE = Line(1.0, 2.0, 3.0, 4.0, 1.0 + 1.0j)


def job(way: str) -> None:
    """Call the kernel, or fail in the other process before it."""
    if way == "badly" and multiprocessing.parent_process() is not None:
        raise RuntimeError("this must not be seen")
    phase_of(LINE, 1.0, 0.5)


def main(way: str) -> None:
    """Print whether it was kept before, processes, times that it was loaded, whether one still runs, whether it is kept now."""
    beside.available_cores = lambda: 2
    call = partial(job, way)
    before = beside.is_kept(call)
    with beside.alongside(phase_of, call):
        processes = len(multiprocessing.active_children())
        phase_of(LINE, 1.0, 0.5)
    left = len(multiprocessing.active_children())
    print(
        before,
        processes,
        sum(phase_of.stats.cache_hits.values()),
        left,
        phase_of.wait,
        beside.is_kept(call),
    )


if __name__ == "__main__":
    main(sys.argv[1])
