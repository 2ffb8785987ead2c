"""Speed of the environments: single, native vectors, Gymnasium's own vectors, the stable-baselines3 bridge, and PPO's whole loop."""

# needs: env, rl

from __future__ import annotations

import multiprocessing
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numba
import numpy as np
from _command_line import check_target, plain_errors
from _table import markdown
from llvmlite.binding import get_host_cpu_name
from tqdm import tqdm

from impact_env.ensemble import available_cores
from impact_env.extras import optional
from optimisation.files import write_json

with optional():
    import gymnasium

PASSIVE, SWEEP = "ImpactAbsorber/Passive-v0", "ImpactAbsorber/SweepRate-v0"
PASSAGE: dict[str, Any] = {"modes": 3, "force": 1.5, "interval": 1.0, "direction": "up", "limits": (0.98, 1.06)}
SCENE = "3 modes, 1.5 N, e = 1, no friction; up from 0.98 times the first resonance at 1 % per 100 pseudo periods; one pseudo period a step"
NATIVE, OWN, BRIDGE, TRAINED = (64, 1024, 16384), 64, 1024, 256
SETTLE = 60  # steps before the clock starts: from rest to steady impacts
SECONDS, QUICK_SECONDS, REPEATS = 4.0, 0.4, 3
FIRST_STEP = (
    "import time; start = time.perf_counter(); import gymnasium, impact_env; imported = time.perf_counter(); "
    f"env = gymnasium.make('{PASSIVE}', modes=3, interval=1.0); env.reset(seed=0); env.step(0); "
    "print(imported - start, time.perf_counter() - imported)"
)


@dataclass(frozen=True)
class Speed:
    """Environment steps per second over all lanes: the median of the repeats, and each of them."""

    name: str
    lanes: int
    steps_per_s: float
    each: tuple[float, ...]


def timed(name: str, lanes: int, step: Callable[[], object], seconds: float, advance: Callable[[], object]) -> Speed:
    """Call ``step``, which advances all lanes once, for ``seconds`` in each repeat."""
    for _ in range(SETTLE):
        step()
    rates = []
    for _ in range(REPEATS):
        count, start = 0, time.perf_counter()
        while (passed := time.perf_counter() - start) < seconds:
            step()
            count += 1
        rates.append(count * lanes / passed)
        advance()
    return Speed(name, lanes, statistics.median(rates), tuple(rates))


def single(seconds: float, advance: Callable[[], object]) -> Speed:
    env = gymnasium.make(PASSIVE, **PASSAGE)
    env.reset(seed=0)

    def step() -> None:
        _, _, end, cut, _ = env.step(0)
        if end or cut:
            env.reset()

    return timed("single", 1, step, seconds, advance)


def vector(name: str, mode: str, lanes: int, seconds: float, advance: Callable[[], object], **options: Any) -> Speed:
    env = gymnasium.make_vec(PASSIVE, num_envs=lanes, vectorization_mode=mode, **options, **PASSAGE)
    try:
        env.reset(seed=0)
        actions = np.zeros(lanes, dtype=np.int64)
        return timed(name, lanes, lambda: env.step(actions), seconds, advance)
    finally:
        env.close()


def bridge(seconds: float, advance: Callable[[], object]) -> Speed:
    from optimisation.rl.vec_env import make_native

    env = make_native(PASSIVE, BRIDGE, **PASSAGE)
    env.reset()
    actions = np.zeros(BRIDGE, dtype=np.int64)
    speed = timed("stable-baselines3 bridge", BRIDGE, lambda: env.step(actions), seconds, advance)
    env.close()
    return speed


def training(seconds: float, advance: Callable[[], object]) -> Speed:
    """Time PPO's whole loop on the sweep task: collecting, learning, resetting."""
    with optional():
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import VecMonitor

    from optimisation.rl.vec_env import make_native

    env = VecMonitor(make_native(SWEEP, TRAINED, **PASSAGE, absorber_options={}))
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=1024, n_epochs=4, seed=0, device="cpu")
    round_of = 16 * TRAINED
    model.learn(round_of)
    rates = []
    for _ in range(REPEATS):
        count, start = 0, time.perf_counter()
        while (passed := time.perf_counter() - start) < seconds:
            model.learn(round_of, reset_num_timesteps=False)
            count += round_of
        rates.append(count / passed)
        advance()
    env.close()
    return Speed("PPO's whole loop", TRAINED, statistics.median(rates), tuple(rates))


def first_step() -> tuple[float, float]:
    """Return the times in s that a new process needs to import what there is, and then to make an environment and do its first step."""
    pairs = []
    for _ in range(REPEATS):
        done = subprocess.run([sys.executable, "-c", FIRST_STEP], capture_output=True, text=True, check=True)
        pairs.append([float(number) for number in done.stdout.split()])
    imported, made = zip(*pairs, strict=True)
    return statistics.median(imported), statistics.median(made)


def cases() -> list[Callable[[float, Callable[[], object]], Speed]]:
    cores = available_cores()

    def native(lanes: int) -> Callable[[float, Callable[[], object]], Speed]:
        return lambda seconds, advance: vector("native vector", "vector_entry_point", lanes, seconds, advance)

    def asynchronous(lanes: int) -> Callable[[float, Callable[[], object]], Speed]:
        return lambda seconds, advance: vector("Gymnasium's AsyncVectorEnv", "async", lanes, seconds, advance, vector_kwargs={"context": "spawn"})

    return [
        single,
        *map(native, NATIVE),
        lambda seconds, advance: vector("Gymnasium's SyncVectorEnv", "sync", OWN, seconds, advance),
        *map(asynchronous, sorted({cores, 4 * cores})),
        bridge,
        training,
    ]


def table(speeds: list[Speed]) -> str:
    best = max(speed.steps_per_s for speed in speeds if speed.name.startswith("Gymnasium"))
    rows = [(speed.name, f"{speed.lanes:,}", f"{speed.steps_per_s:,.0f}", f"{speed.steps_per_s / best:.1f}") for speed in speeds]
    return markdown(("environment", "lanes", "steps/s", "over Gymnasium's best"), rows)


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help=f"{QUICK_SECONDS:g} s a repeat instead of {SECONDS:g} s: a look, not a measurement.")
@click.option("--json", "target", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write the results and every repeat.")
def main(quick: bool, target: Path | None) -> None:
    """Measure environment steps per second and print a table.

    Run it on an otherwise idle machine. Kernels that are not compiled yet are compiled first, which is not part of the times.
    """
    check_target("--json", target)
    seconds, every = QUICK_SECONDS if quick else SECONDS, cases()
    with plain_errors():
        with tqdm(total=REPEATS * len(every), desc="timing", unit="repeat", leave=False, disable=None) as bar:
            speeds = [case(seconds, bar.update) for case in every]
        imported, made = first_step()
    machine = {"processor": get_host_cpu_name(), "cores": available_cores(), "numba": numba.__version__}
    if target is not None:
        results = {"machine": machine, "scene": SCENE, "make_and_first_step_s": made, "import_s": imported}
        write_json(target, results | {"speeds": [asdict(speed) for speed in speeds]})
    click.echo(table(speeds))
    click.echo(f"\n{SCENE}.\nMedian of {REPEATS} repeats of {seconds:g} s on {machine['cores']} cores ({machine['processor']}).")
    click.echo(
        f"In a new process, kernels compiled: {imported:.2f} s to import gymnasium and impact_env, {made:.2f} s for make, reset and first step."
    )


if __name__ == "__main__":
    multiprocessing.freeze_support()
    main(prog_name="scripts/run benchmark_envs")
