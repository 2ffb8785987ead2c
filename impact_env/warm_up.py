"""Compile the kernels into their cache before they are needed.

The command is ``python -m impact_env.warm_up [environments|all]``.

numba compiles a kernel for each combination of absent and present parts. By default the
combinations of the main job are compiled; with the word ``environments`` those of the Gymnasium
environments with their default scenes; with ``all`` both, and the kernels with energies, as a wheel
with kernels contains them. Other combinations are compiled, and cached, at their first use. Each
combination is compiled by a process of its own, as many at a time as there are cores.
"""

import signal
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import active_children, get_context

from impact_env.ensemble import available_cores
from impact_env.envs import ENVIRONMENTS, take_first_step
from impact_env.first_use import suppress_announcements
from impact_env.kernels.compiling.cache import cache_folder
from impact_env.kernels.compiling.jit import COMPILED
from impact_env.parameters import Absorber, Beam, impact_absorber
from impact_env.prepare import short_run
from impact_env.results import Record
from impact_env.scene import beam_scene

Jobs = list[tuple[str, Callable[[], None]]]

# the dearest first, so that none is left over at the end
ABSORBERS: dict[str, Callable[[], Absorber | None]] = {
    "impact absorber with friction, friction damper": lambda: impact_absorber(friction_limit=0.1),
    "impact absorber": impact_absorber,
    "linear scenes": lambda: None,
}
RECORDS = {"all records but energies": Record()}  # one kernel serves them all
OTHER_JOBS = {"energies": Record(energy=True)}


def main_job(records: dict[str, Record] = RECORDS) -> Jobs:
    """Return the variants of the main job by name, each a very short run on a small beam."""
    return [
        (
            f"{name}: {what}",
            partial(short_run, beam_scene(Beam(modes=2), absorber()), record=record),
        )
        for what, record in records.items()
        for name, absorber in ABSORBERS.items()
    ]


def environments() -> Jobs:
    """Return a job for each environment by name; they need gymnasium."""
    return [(name, partial(take_first_step, name)) for name in ENVIRONMENTS]


def follow_orbits(absorber: Absorber) -> None:
    """Follow the periodic orbits of a small beam through its resonance."""
    from impact_env.periodic.case import case_of  # the main job needs none of it
    from impact_env.periodic.orbit_branches import orbit_branches
    from impact_env.periodic.response_curve import orbit_curve

    scene = beam_scene(Beam(modes=2), absorber)
    low, high = (ratio * scene.model.resonance_omega(1) for ratio in (0.9, 1.06))
    for branch in orbit_branches(case_of(scene, 3.5, low), low, high):
        orbit_curve(branch, scene.model.resonance_omega(1))


def everything() -> Jobs:
    """Return all jobs by name, including those of runs that record more, and periodic orbits."""
    orbits = [
        (f"{name}: orbits", partial(follow_orbits, absorber))
        for name, make in ABSORBERS.items()
        if (absorber := make()) is not None
    ]
    return main_job(OTHER_JOBS) + orbits + environments() + main_job()


JOBS: dict[str, Callable[[], Jobs]] = {
    "": main_job,
    "environments": environments,
    "all": everything,
}  # by the command line's word


def timed(job: Callable[[], None]) -> float:
    """Call a job and return its time in s."""
    began = time.perf_counter()
    with suppress_announcements():
        job()
    return time.perf_counter() - began


def warm_up(jobs: Jobs, say: Callable[[str], None], processes: int) -> None:
    """Call all jobs in a number of processes.

    Call ``say`` with a line of text for each finished one.
    """
    if processes == 1:
        for k, (name, job) in enumerate(jobs, 1):
            say(_line(k, len(jobs), name, timed(job)))
        return
    before = active_children()
    # spawned: a process that is forked from one with numba's threads may hang
    with ProcessPoolExecutor(
        processes, get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN)
    ) as pool:
        try:
            names = {pool.submit(timed, job): name for name, job in jobs}
            for k, done in enumerate(as_completed(names), 1):
                say(_line(k, len(jobs), names[done], done.result()))
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                if process not in before:
                    process.terminate()  # kernels are kept whole or not at all
            raise


def _line(k: int, total: int, name: str, seconds: float) -> str:
    return f"  [{k:2}/{total}] {name:<54}{seconds:6.1f} s"


def main(words: list[str], say: Callable[[str], None]) -> int:
    """Compile the kernels that the command line selects and return the exit code."""
    word = " ".join(words)
    if word not in JOBS:
        say(f"{word} is not allowed: nothing, or one of the words environments and all")
        return 2
    if not COMPILED:
        say("NUMBA_DISABLE_JIT is set: kernels run in plain Python, there is nothing to compile")
        return 0
    jobs = JOBS[word]()
    warm_up(jobs, say, min(available_cores(), len(jobs)))
    folder = cache_folder()
    say(
        "  kernels are kept nowhere: no folder can be written to"
        if folder is None
        else f"  kernels are in {folder}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], partial(print, file=sys.stderr, flush=True)))
