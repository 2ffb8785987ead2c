"""Speed of the environments and of their vectors.

Single environments, native vectors, Gymnasium's own vectors, the stable-baselines3 bridge, and a
complete PPO training loop are timed.
"""

# needs: env, rl

import multiprocessing
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from typing import Any

import click
import numpy as np

from impact_env.ensemble import available_cores
from impact_env.extras import optional
from optimisation.cli.common import command
from optimisation.executors import Bar
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    add_table_options,
    format_table,
    make_table_study,
    run,
)

NAME = "speeds"
PASSIVE = "ImpactAbsorber/Passive-v0"
SWEEP = "ImpactAbsorber/SweepRate-v0"
PASSAGE: dict[str, Any] = {
    "modes": 3,
    "force": 1.5,
    "interval": 1.0,
    "direction": "up",
    "limits": (0.98, 1.06),
}
SCENE = (
    "3 modes, 1.5 N, e = 1, no friction; up from 0.98 times the first resonance at 1 % per 100 "
    "pseudo periods; one pseudo period a step"
)
NATIVE = (64, 256, 1024, 16384)
OWN = 64
BRIDGE = 1024
TRAINED = 256
TRAINED_ON = (
    *("ActiveFriction-v0", "ActiveGap-v0", "Structures-v0", "Passage-v0"),
    *("FrictionChoice-v1", "SweepAndGap-v1", "SweepRate-v1", "GapChoice-v1"),
)
SETTLE = 60  # steps before the clock starts: from rest to steady impacts
SECONDS = 3.0
QUICK_SECONDS = 0.4
REPEATS = 3
FIRST_STEP = (
    "import time; start = time.perf_counter(); import gymnasium, impact_env; imported = "
    "time.perf_counter(); "
    f"env = gymnasium.make('{PASSIVE}', modes=3, interval=1.0); env.reset(seed=0); env.step(0); "
    "print(imported - start, time.perf_counter() - imported)"
)


def timed(
    name: str,
    lanes: int,
    step: Callable[[], object],
    seconds: float,
    advance: Callable[[], object],
    settle: int = SETTLE,
) -> Json:
    """Return environment steps per second over all lanes: the median and each repeat.

    ``interval`` is the interval of a step in pseudo periods.

    ``step``, which advances all lanes once, is called for ``seconds`` in each repeat, after so many
    calls to ``settle``. ``above``: median time in s that a step of all lanes takes above its
    periods, if that was measured.
    """
    for _ in range(settle):
        step()
    rates = []
    for _ in range(REPEATS):
        count = 0
        start = time.perf_counter()
        while (passed := time.perf_counter() - start) < seconds:
            step()
            count += 1
        rates.append(count * lanes / passed)
        advance()
    return {
        "name": name,
        "lanes": lanes,
        "steps_per_s": statistics.median(rates),
        "each": rates,
        "interval": PASSAGE["interval"],
        "above": None,
    }


def single(seconds: float, advance: Callable[[], object]) -> Json:
    """Time one environment."""
    env = gym().make(PASSIVE, **PASSAGE)
    env.reset(seed=0)

    def step() -> None:
        _, _, end, cut, _ = env.step(0)
        if end or cut:
            env.reset()

    return timed("single", 1, step, seconds, advance)


def gym() -> Any:
    """Return gymnasium."""
    with optional():
        import gymnasium
    return gymnasium


def vector(
    name: str, mode: str, lanes: int, seconds: float, advance: Callable[[], object], **options: Any
) -> Json:
    """Time a vector of environments, made by Gymnasium's `make_vec` in this mode."""
    with closing(
        gym().make_vec(PASSIVE, num_envs=lanes, vectorization_mode=mode, **options, **PASSAGE)
    ) as env:
        env.reset(seed=0)
        actions = np.zeros(lanes, dtype=np.int64)
        return timed(name, lanes, lambda: env.step(actions), seconds, advance)


def task(name: str, lanes: int, seconds: float, advance: Callable[[], object]) -> Json:
    """Time a training task under random actions, with its default settings.

    The result also has the time that a step takes in addition to the simulation.
    """
    env = gym().make_vec(name, num_envs=lanes)
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, env.action_space.shape).astype(np.float32)
    runs = env.unwrapped.task.runs
    above = list[float]()

    def step() -> None:
        start = time.perf_counter()
        env.step(actions)
        above.append(time.perf_counter() - start - runs.wall_time)

    speed = timed(name.split("/")[1], lanes, step, seconds, advance)
    env.close()
    return speed | {"interval": env.unwrapped.task.interval, "above": statistics.median(above)}


def bridge(seconds: float, advance: Callable[[], object]) -> Json:
    """Time the native vector behind the interface of stable-baselines3."""
    from optimisation.rl.vec_env import make_native

    with closing(make_native(PASSIVE, BRIDGE, **PASSAGE)) as env:
        env.reset()
        actions = np.zeros(BRIDGE, dtype=np.int64)
        return timed(
            "stable-baselines3 bridge", BRIDGE, lambda: env.step(actions), seconds, advance
        )


def training(seconds: float, advance: Callable[[], object]) -> Json:
    """Time PPO's whole loop on the sweep task: collecting, learning, resetting."""
    with optional():
        from stable_baselines3 import PPO
        from stable_baselines3.common.logger import Logger
        from stable_baselines3.common.vec_env import VecMonitor

    from optimisation.rl.vec_env import make_native

    env = VecMonitor(make_native(SWEEP, TRAINED, **PASSAGE, absorber_options={}))
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=1024, n_epochs=4, seed=0, device="cpu")
    model.set_logger(
        Logger(None, [])
    )  # its own would leave a folder in the temporary one at every call of learn
    round_of = 16 * TRAINED
    model.learn(round_of)
    speed = timed(
        "PPO's whole loop",
        round_of,
        lambda: model.learn(round_of, reset_num_timesteps=False),
        seconds,
        advance,
        settle=0,
    )
    env.close()
    return speed | {"lanes": TRAINED}


def first_step() -> tuple[float, float]:
    """Return the times in s for the imports and for the first step in a new process.

    The second time includes making the environment.
    """
    done = [
        subprocess.run(
            [sys.executable, "-c", FIRST_STEP], capture_output=True, text=True, check=True
        ).stdout
        for _ in range(REPEATS)
    ]
    imported, made = np.median(
        [[float(number) for number in pair.split()] for pair in done], axis=0
    ).tolist()
    return imported, made


def cases() -> list[Callable[[float, Callable[[], object]], Json]]:
    """Return the timed cases in the order of the table."""
    cores = available_cores()
    spawned = {"context": "spawn"}
    return [
        single,
        *(partial(vector, "native vector", "vector_entry_point", lanes) for lanes in NATIVE),
        partial(vector, "Gymnasium's SyncVectorEnv", "sync", OWN),
        *(
            partial(vector, "Gymnasium's AsyncVectorEnv", "async", lanes, vector_kwargs=spawned)
            for lanes in sorted({cores, 4 * cores})
        ),
        bridge,
        training,
        *(
            partial(task, f"ImpactAbsorber/{name}", lanes)
            for name in TRAINED_ON
            for lanes in (OWN, BRIDGE)
        ),
    ]


def table(speeds: Sequence[Json]) -> str:
    """Return a line for each kind and number of environments."""
    best = max(speed["steps_per_s"] for speed in speeds if speed["name"].startswith("Gymnasium"))
    columns = {
        "environment": "{name}",
        "lanes": "{lanes:,}",
        "steps/s": "{steps_per_s:,.0f}",
        "pseudo periods/s": "{periods:,.0f}",
        "over Gymnasium's best": "{over}",
        "µs a step above its periods": "{more}",
    }
    rows = []
    for speed in speeds:
        rate = speed["steps_per_s"]
        trained = speed["name"] in TRAINED_ON
        over, more = (
            ("-", f"{1e6 * speed['above']:,.0f}") if trained else (f"{rate / best:.1f}", "-")
        )
        rows.append({**speed, "periods": rate * speed["interval"], "over": over, "more": more})
    return format_table(columns, rows)


def _measure(seconds: float) -> Json:
    every = cases()
    with Bar(total=REPEATS * len(every), desc="timing", unit="repeat", leave=False) as bar:
        speeds = [case(seconds, bar.update) for case in every]
    imported, made = first_step()
    return {
        "scene": SCENE,
        "repeat_s": seconds,
        "make_and_first_step_s": made,
        "import_s": imported,
        "speeds": speeds,
    }


def _summary(measured: Measurement) -> str:
    values = measured.values
    made = measured.conditions
    return (
        f"{table(values['speeds'])}\n\n"
        f"{SCENE}.\nMedian of {REPEATS} repeats of {values['repeat_s']:g} s on "
        f"{made['cores']} cores ({made['processor']}).\n"
        f"In a new process, kernels compiled: {values['import_s']:.2f} s to import gymnasium "
        "and impact_env, "
        f"{values['make_and_first_step_s']:.2f} s for make, reset and first step."
    )


# settings: length of a repeat in s
STUDY = make_table_study(NAME, "speed of the environments", _measure, _summary)


@command()
@click.option(
    "--quick",
    is_flag=True,
    help=f"{QUICK_SECONDS:g} s a repeat instead of {SECONDS:g} s: a look, not a measurement.",
)
@add_table_options(NAME, "docs/environments.md")
def main(quick: bool, place: OutputPaths) -> None:
    """Measure environment steps per second and print a table.

    Run it on an otherwise idle machine. Kernels that are not compiled yet are compiled first, which
    is not part of the times.
    """
    run(STUDY, QUICK_SECONDS if quick else SECONDS, place)


if __name__ == "__main__":
    multiprocessing.freeze_support()
    main(prog_name="scripts/run reproduce benchmark-envs")
