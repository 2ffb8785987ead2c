"""Print as JSON a hash of the results of one scene, after the named scenes.

The module runs as a process of its own. The scenes before are those that the arguments name.

``child``: also in a process that this one starts. ``worker``: also on a worker of dask.
``threads``: instead, its level as a lane among lanes of other kinds, on one thread and on four.
"""

import hashlib
import json
import multiprocessing
import sys
from collections.abc import Callable

import numpy as np

from impact_env.drive import Drive, linear_sweep
from impact_env.ensemble import Lane, run_lanes
from impact_env.methods import Moreau
from impact_env.parameters import (
    Absorber,
    Beam,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.results import Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate

ABSORBERS: dict[str, Callable[[], Absorber | None]] = {
    "none": lambda: None,
    "stuck": StuckAbsorber,
    "tuned": TunedAbsorber,
    "damper": friction_damper,
    "frictionless": impact_absorber,
}


def scene() -> Scene:
    return beam_scene(Beam(modes=10), impact_absorber(restitution=0.7, friction_limit=0.1))


def drive(of: Scene) -> Drive:
    return Drive(3.5, linear_sweep(of.model.resonance_omega(1), 0.93, 1.0))


def digest() -> str:
    """Return a hash of the end state, the level and every impact."""
    response = simulate(scene(), drive(scene()), record=Record(events=True))
    parts = (
        response.end_state,
        np.array([response.level.value]),
        response.impacts.time,
        response.impacts.impulse,
    )
    return hashlib.sha256(
        b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
    ).hexdigest()


def level_in_a_batch(threads: int) -> str:
    """Return the scene's level in hexadecimal, as one of many lanes of all kinds."""
    mixed = [beam_scene(Beam(modes=10), make()) for make in ABSORBERS.values()]
    lanes = [Lane(one, drive(one)) for one in [*mixed, scene(), *mixed]]
    return float(run_lanes(lanes, threads=threads).level[len(mixed)]).hex()


def before(word: str) -> None:
    """Simulate another scene first."""
    other = beam_scene(Beam(modes=10), ABSORBERS[word if word in ABSORBERS else "frictionless"]())
    method = Moreau() if word == "moreau" else None
    simulate(other, Drive(1.0, linear_sweep(other.model.resonance_omega(1), 0.99, 1.0)), method)


def on_a_worker() -> str:
    import distributed

    local = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    )
    with local, distributed.Client(local) as client:
        return str(client.submit(digest).result())


def main(words: list[str]) -> dict[str, str]:
    if words == ["threads"]:
        return {str(threads): level_in_a_batch(threads) for threads in (1, 4)}
    for word in words:
        if word not in ("child", "worker"):
            before(word)
    results = {"here": digest()}
    if "child" in words:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            results["child"] = pool.apply(digest)
    if "worker" in words:
        results["worker"] = on_a_worker()
    return results


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1:])))
