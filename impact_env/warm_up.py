"""Compile the kernels into their cache before they are needed: ``python -m impact_env.warm_up``.

numba compiles a kernel once for each combination of absent and present parts. These are the combinations that the main job meets; any
other is compiled, and cached, when it is first used. One process, one after the other: two that fill one cache at the same
time can spoil each other's entries.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator

from impact_env.drive import Drive, constant_frequency
from impact_env.kernels.jit import cache_folder
from impact_env.parameters import Absorber, Beam, friction_damper, impact_absorber
from impact_env.response import Record
from impact_env.scene import beam_scene
from impact_env.sweep import simulate

PERIODS = 1.0
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


def compile_variant(absorber: Absorber | None, record: Record) -> float:
    """Run a tiny drive on a small beam and return the time it took in s."""
    scene = beam_scene(Beam(modes=2), absorber)
    drive = Drive(FORCE, constant_frequency(scene.model.resonance_omega(1), 1.0, PERIODS))
    began = time.perf_counter()
    simulate(scene, drive, record=record)
    return time.perf_counter() - began


def warm_up(say: Callable[[str], None]) -> None:
    """Compile all variants, telling ``say`` a line for each."""
    every = list(variants())
    for k, (name, absorber, record) in enumerate(every, 1):
        say(f"  [{k:2}/{len(every)}] {name:<54}{compile_variant(absorber, record):6.1f} s")


def _print(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


if __name__ == "__main__":
    warm_up(_print)
    _print(f"  kernels are in {cache_folder()}")
