"""Golden cases: small runs of every kind, and short episodes of every environment.

The runs have every kind of scene, method, load and record.

A refactoring keeps their bits. Two comparisons, both in plain Python (``NUMBA_DISABLE_JIT=1``), so
that nothing is compiled:

- with another commit, bit by bit, on one machine: ``python tests/support/golden.py --against
  COMMIT`` runs the cases of both versions, each with its own copy of this module, and compares
  SHA-256 hashes. ``--write FILE`` and ``--check FILE`` keep the hashes of one version in a file, so
  that it runs only once.
- with the committed file ``tests/truths/golden_numbers.json``, on any machine: `numbers` of each
  array agree up to `NUMBERS_TOL`. Hashes would not do: BLAS and libm differ in the last bits from
  machine to machine. Nor would rounded digits, which differ where a number is near the middle
  between two of them. ``--numbers`` writes this file again after a change of results that is meant.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    os.environ["NUMBA_DISABLE_JIT"] = "1"

import numpy as np
from core import ALL, EVERYTHING, OMEGA, PERIOD, drive_of, scene_of
from every_scene import EVERY, LEVEL, Values, controlled, values_of
from load_cases import cantilever
from numpy.typing import NDArray
from places import ROOT, SCRIPTS, SUPPORT, TRUTHS

from impact_env.drive import Load
from impact_env.loads import (
    Loads,
    Random,
    Samples,
    ShakenBase,
    Shock,
    Strike,
    Tone,
    Tones,
    Unbalance,
)
from impact_env.methods import Method, Moreau, RungeKutta
from impact_env.parameters import (
    Absorber,
    Beam,
    CompliantWalls,
    ElasticCoulombFriction,
    SlidingAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.results import Record, Window
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import simulate

NUMBERS = TRUTHS / "golden_numbers.json"
NUMBERS_TOL = (
    1e-8  # of an array's absolute sum: last bits of the modal model, grown by some ten impacts
)
BRIEF = drive_of(12.0, 0.98, 1.0, periods=1.0)
LENGTH = PERIOD
HERTZ = OMEGA / (2 * np.pi)


def run(
    scene: Scene,
    method: Method | None = None,
    record: Record = EVERYTHING,
    initial: InitialState | None = None,
) -> Callable[[], Values]:
    """Return a run of a swept force."""
    return lambda: values_of(simulate(scene, BRIEF, method, record=record, initial=initial))


def loaded(
    absorber: Absorber | None, *loads: Load, method: Method | None = None, start: str = "middle"
) -> Callable[[], Values]:
    """Return a run of the closed-form cantilever or of the beam under loads.

    The cantilever can have a moving base.
    """

    def simulate_loads() -> Values:
        scene = Scene(cantilever(), absorber)
        return values_of(simulate(scene, Loads(loads, OMEGA, start), method, record=EVERYTHING))

    return simulate_loads


RIGID = impact_absorber(5e-4, 0.3, 0.1)
CLOSE_WALLS = impact_absorber(4e-4, 0.8)
HEAVY = replace(CLOSE_WALLS, gravity=9.81)
SCHEDULE = BRIEF.schedule
SPECTRUM = np.array([[0.5 * HERTZ, 40.0], [2.0 * HERTZ, 40.0]])
RECORD = Samples(
    np.linspace(0.0, LENGTH, 9), 60.0 * np.cos(np.arange(9.0) ** 2), "base_acceleration"
)
MOVING = InitialState(np.array([1e-4, -1e-5]), np.array([0.05, 0.1]), 3e-4, -0.2)
MORE: dict[str, Callable[[], Values]] = {
    "one mode": run(scene_of(RIGID, modes=1)),
    "five modes": run(scene_of(CLOSE_WALLS, modes=5)),
    "an initial state": run(scene_of(RIGID, modes=2), initial=MOVING),
    "absorber's weight": run(scene_of(HEAVY, modes=2)),
    "level at another place": run(
        beam_scene(Beam(modes=2, response_position=0.6), CLOSE_WALLS), record=LEVEL
    ),
    "window of the series": run(
        scene_of(CLOSE_WALLS, modes=2), record=Record(series=Window(0.3 * PERIOD, 0.8 * PERIOD))
    ),
    "envelope": run(scene_of(CLOSE_WALLS, modes=2), record=Record(envelope=7)),
    "reversals": run(scene_of(RIGID, modes=2), record=Record(reversals=True)),
    "energy alone": run(scene_of(RIGID, modes=2), record=Record(level=False, energy=True)),
    "Moreau, energy and series": run(scene_of(RIGID, modes=2), Moreau(100), ALL),
    "Moreau, friction damper": run(scene_of(friction_damper(0.3), modes=2), Moreau(100)),
    "Runge-Kutta, level": run(
        scene_of(SlidingAbsorber(walls=CompliantWalls(1e5)), modes=2), RungeKutta(40), LEVEL
    ),
    "Runge-Kutta, elastic friction": run(
        scene_of(SlidingAbsorber(friction=ElasticCoulombFriction(0.1, 1e5)), modes=2),
        RungeKutta(40),
    ),
    "unbalance": loaded(CLOSE_WALLS, Unbalance(10.0 / OMEGA**2, SCHEDULE)),
    "moving base": loaded(CLOSE_WALLS, ShakenBase(SCHEDULE, acceleration=40.0)),
    "moving base about a mean at rest": loaded(
        CLOSE_WALLS, ShakenBase(SCHEDULE, displacement=5e-4, phase=0.3), start="base-mean-rest"
    ),
    "unbalance, Moreau": loaded(
        CLOSE_WALLS, Unbalance(10.0 / OMEGA**2, SCHEDULE), method=Moreau(200)
    ),
    "orders": loaded(
        CLOSE_WALLS, Tones((Tone(8.0, order=1.0), Tone(5.0, order=2.0)), None, SCHEDULE)
    ),
    "tones, no absorber": loaded(None, Tones((Tone(8.0, HERTZ), Tone(5.0, 3 * HERTZ)), LENGTH)),
    "record of the base": loaded(CLOSE_WALLS, RECORD),
    "record of a force, Runge-Kutta": loaded(
        SlidingAbsorber(walls=CompliantWalls(1e5)),
        replace(RECORD, quantity="force"),
        method=RungeKutta(40),
    ),
    "random load, tuned absorber": loaded(
        TunedAbsorber(), Random(SPECTRUM, LENGTH, 3, "base_acceleration")
    ),
    "shock": loaded(CLOSE_WALLS, Shock("half-sine", 60.0, 0.4 * PERIOD, LENGTH)),
    "trapezoid of the base": loaded(
        None, Shock("trapezoid", 60.0, 0.4 * PERIOD, LENGTH, 0.1 * PERIOD, "base_acceleration")
    ),
    "strike": loaded(CLOSE_WALLS, Strike(0.5, LENGTH)),
    "intervals, friction damper": controlled(friction_damper(0.3)),
}


def episode(name: str, seed: int, **arguments: Any) -> Callable[[], Values]:
    """Return an episode's first steps under random actions."""

    def play() -> Values:
        from environment_cases import make

        env = make(name, **arguments)
        env.action_space.seed(seed)
        observations = [env.reset(seed=seed)[0]]
        rewards = []
        ends = [False]
        while len(rewards) < STEPS_OF_EPISODE and not ends[-1]:
            observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
            observations.append(observation)
            rewards.append(reward)
            ends.append(bool(terminated or truncated))
        env.close()
        return {
            "observations": np.array(observations),
            "rewards": np.array(rewards, dtype=float),
            "ends": np.array(ends, dtype=np.int64),
        }

    return play


def vector_episode(name: str, mode: str) -> Callable[[], Values]:
    """Return steps of two lanes, through the end of an episode."""

    def play() -> Values:
        import gymnasium
        from environment_cases import vector

        env = vector(
            name, 2, limits=(0.965, 0.967), autoreset_mode=gymnasium.vector.AutoresetMode(mode)
        )
        env.action_space.seed(1)
        observations = [env.reset(seed=1)[0]]
        rewards = []
        for _ in range(STEPS_OF_EPISODE):
            observation, reward, *_ = env.step(env.action_space.sample())
            observations.append(observation.copy())
            rewards.append(np.array(reward, dtype=float))
        env.close()
        return {"observations": np.array(observations), "rewards": np.array(rewards)}

    return play


STEPS_OF_EPISODE = 3
ENVIRONMENTS = [
    "SweepRate-v0",
    "GapChoice-v0",
    "Passive-v0",
    "SweepRate-v1",
    "SweepRateNoisy-v1",
    "SweepRateDelayed-v1",
    "SweepAndGap-v0",
    "FrictionChoice-v0",
    "SweepRateHard-v0",
    "GapChoice-v1",
    "SweepAndGap-v1",
    "FrictionChoice-v1",
    "ActiveFriction-v0",
    "ActiveGap-v0",
    "Passage-v0",
    "Structures-v0",
]
EPISODES: dict[str, Callable[[], Values]] = {
    f"episode of {name}": episode(f"ImpactAbsorber/{name}", seed)
    for seed, name in enumerate(ENVIRONMENTS)
}
EPISODES |= {
    "episode of fatigue": episode("ImpactAbsorber/SweepRate-v1", 5, objective="fatigue"),
    "episode upwards": episode("ImpactAbsorber/SweepAndGap-v1", 6, direction="up"),
    "episode of lanes, next step": vector_episode("ImpactAbsorber/Passive-v0", "NextStep"),
    "episode of lanes, same step": vector_episode("ImpactAbsorber/Passive-v0", "SameStep"),
}
CASES = EVERY | MORE | EPISODES


def plain_arrays(values: Values) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the name and array of each, a structured one field by field."""
    for name, array in values.items():
        if array.dtype.names is None:
            yield name, array
        else:
            yield from ((f"{name} {part}", array[part]) for part in array.dtype.names)


def numbers(values: Values) -> dict[str, list[float]]:
    """Return the size and two sums of each array.

    They are the absolute sum, and the sum weighted by cos(1), cos(2), ..., which depends on the
    order of the numbers.
    """
    result = {}
    for name, array in plain_arrays(values):
        flat = array.astype(float).ravel()
        weights = np.cos(1.0 + np.arange(flat.size))
        result[name] = [float(flat.size), float(np.sum(np.abs(flat))), float(weights @ flat)]
    return result


def agree(numbers: list[float], stored: list[float]) -> bool:
    """Return whether the `numbers` of two arrays agree up to rounding."""
    if numbers[0] != stored[0]:
        return False
    pairs = zip(numbers[1:], stored[1:], strict=True)
    return all(
        a == b or abs(a - b) <= NUMBERS_TOL * stored[1] or (np.isnan(a) and np.isnan(b))
        for a, b in pairs
    )


def hashes(values: Values) -> dict[str, str]:
    """Return the SHA-256 of each array's bytes."""
    return {name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in values.items()}


def run_cases(pattern: str = "") -> dict[str, Values]:
    """Return the results of the cases whose names contain a pattern."""
    return {name: case() for name, case in CASES.items() if pattern in name}


def differences(new: dict[str, dict[str, str]], old: dict[str, dict[str, str]]) -> list[str]:
    """Return a line for each case or array whose hashes differ, or that only one of the two has."""
    lines = [f"{name}: only before" for name in old.keys() - new.keys()]
    for name, arrays in new.items():
        if name not in old:
            lines.append(f"{name}: only now")
            continue
        lines += [
            f"{name}: {part}"
            for part in sorted(arrays.keys() | old[name].keys())
            if arrays.get(part) != old[name].get(part)
        ]
    return lines


def hashes_of_commit(commit: str) -> dict[str, dict[str, str]]:
    """Return the hashes of another version of the sources.

    They are computed by that version's own copy of this module.
    """
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        archive = subprocess.run(
            ["git", "archive", commit, "impact_env", "optimisation", "scripts", "tests"],
            cwd=ROOT,
            capture_output=True,
            check=True,
        )
        subprocess.run(["tar", "-x", "-C", folder], input=archive.stdout, check=True)
        support = root / SUPPORT.relative_to(ROOT)
        path = (root, root / SCRIPTS.relative_to(ROOT), support, support.parent)
        file = root / "hashes.json"
        subprocess.run(
            [sys.executable, "-P", str(support / "golden.py"), "--write", str(file)],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, path))},
            cwd=folder,
            check=True,
        )
        hashes: dict[str, dict[str, str]] = json.loads(file.read_text())
    return hashes


def main() -> int:
    parser = argparse.ArgumentParser(description="Hashes of the golden cases, in plain Python.")
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--write", metavar="FILE", type=Path, help="write the hashes")
    group.add_argument("--check", metavar="FILE", type=Path, help="compare with written hashes")
    group.add_argument("--against", metavar="COMMIT", help="compare with another version's")
    parser.add_argument(
        "--numbers", action="store_true", help=f"write {NUMBERS.relative_to(ROOT)} again"
    )
    options = parser.parse_args()
    values = run_cases()
    if options.numbers:
        lines = [
            f"{json.dumps(name)}: {json.dumps(numbers(arrays))}" for name, arrays in values.items()
        ]
        NUMBERS.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    now = {name: hashes(arrays) for name, arrays in values.items()}
    if options.write:
        options.write.write_text(json.dumps(now, indent=0))
    if options.check:
        before = json.loads(options.check.read_text())
    elif options.against:
        before = hashes_of_commit(options.against)
    else:
        return 0
    changed = differences(now, before)
    print("\n".join(changed) or f"{len(now)} cases: every bit is the same")
    return int(bool(changed))


if __name__ == "__main__":
    sys.exit(main())
