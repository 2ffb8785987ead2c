"""Compile the kernels into their cache before they are needed: ``python -m impact_env.warm_up [environments]``.

numba compiles a kernel once for each combination of absent and present parts. These are the combinations that the main job meets or, with the word
``environments``, the Gymnasium environments with their default scenes; any other is compiled, and cached, when it is first used. One
process, one after the other: two that fill one cache at the same time can spoil each other's entries.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from functools import partial

from impact_env.drive import Drive, constant_frequency
from impact_env.envs import ENVIRONMENTS, first_step
from impact_env.first_use import quiet
from impact_env.kernels.cache import cache_folder
from impact_env.parameters import Absorber, Beam, friction_damper, impact_absorber
from impact_env.response import Record
from impact_env.scene import beam_scene
from impact_env.sweep import simulate

PERIODS = 1.0
Jobs = list[tuple[str, Callable[[], None]]]
FORCE = 1e-3  # N: nothing needs to happen, only to be compiled

ABSORBERS: dict[str, Callable[[], Absorber | None]] = {
    "linear scenes": lambda: None,
    "impact absorber with friction": lambda: impact_absorber(friction_limit=0.1),
    "friction damper": friction_damper,
    "impact absorber": impact_absorber,
}
RECORDS = {
    "level": Record(),
}


def variants() -> Iterator[tuple[str, Absorber | None, Record]]:
    """Yield name, absorber and record of each combination, those of the main job first."""
    for what, record in RECORDS.items():
        for name, absorber in ABSORBERS.items():
            yield f"{name}: {what}", absorber(), record


def compile_variant(absorber: Absorber | None, record: Record) -> None:
    """Run a tiny drive on a small beam."""
    scene = beam_scene(Beam(modes=2), absorber)
    drive = Drive(FORCE, constant_frequency(scene.model.resonance_omega(1), 1.0, PERIODS))
    simulate(scene, drive, record=record)


def main_job() -> Jobs:
    """Return the main job's variants."""
    return [(name, partial(compile_variant, absorber, record)) for name, absorber, record in variants()]


def environments() -> Jobs:
    """Return the environments; they need the package gymnasium."""
    return [(name, partial(first_step, name)) for name in ENVIRONMENTS]


def warm_up(jobs: Jobs, say: Callable[[str], None]) -> None:
    """Do all jobs, telling ``say`` a line for each."""
    for k, (name, job) in enumerate(jobs, 1):
        began = time.perf_counter()
        job()
        say(f"  [{k:2}/{len(jobs)}] {name:<54}{time.perf_counter() - began:6.1f} s")


def main(words: list[str], say: Callable[[str], None]) -> int:
    """Compile what the command line asks for and return the exit code."""
    if words not in ([], ["environments"]):
        say(f"{' '.join(words)} is not allowed: nothing, or the word environments")
        return 2
    with quiet():
        warm_up(environments() if words else main_job(), say)
    folder = cache_folder()
    say("  kernels are kept nowhere: no folder can be written to" if folder is None else f"  kernels are in {folder}")
    return 0


def _print(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], _print))
