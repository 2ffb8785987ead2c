"""Speed of the environments: single, native vectors, Gymnasium's own vectors, the stable-baselines3 bridge, and PPO's whole loop."""

# needs: env, rl

from __future__ import annotations

import multiprocessing
from pathlib import Path

import click

from optimisation.cli.common import command
from studies.benchmarks.environments import NAME, QUICK_SECONDS, SECONDS, STUDY
from studies.one_table import table_options, table_place
from studies.runner import run


@command()
@click.option("--quick", is_flag=True, help=f"{QUICK_SECONDS:g} s a repeat instead of {SECONDS:g} s: a look, not a measurement.")
@table_options(NAME, "docs/environments.md")
def main(quick: bool, target: Path | None, page: Path | None) -> None:
    """Measure environment steps per second and print a table.

    Run it on an otherwise idle machine. Kernels that are not compiled yet are compiled first, which is not part of the times.
    """
    run(STUDY, QUICK_SECONDS if quick else SECONDS, table_place(target, page))


if __name__ == "__main__":
    multiprocessing.freeze_support()
    main(prog_name="scripts/run benchmark_envs")
