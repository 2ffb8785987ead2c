"""Comparison of training methods on the validation seeds.

The methods are compared at equal time of one core and at equal numbers of steps.
"""

# needs: env, rl

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from typing import NamedTuple

import click

from optimisation.cli.common import command
from optimisation.files import markdown
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_folder_options,
    make_rows_study,
    run,
)
from studies.training_methods import METHODS, SCALES, TrainingEffort

NAME = "compare_training"
PAGE = "tasks"
QUICK = TrainingEffort(seconds=2.0, evaluations=1, episodes=16, steps=10_000)


class Settings(NamedTuple):
    """Tasks, methods, number of training seeds, and the effort of each training."""

    tasks: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: int
    effort: TrainingEffort


def measure_training(task: str, method: str, seed: int, effort: TrainingEffort) -> list[Json]:
    """Return the row of a training."""
    from studies.training_runs import train_method

    return [train_method(task, method, seed, effort)]


def list_cases(settings: Settings) -> Mapping[tuple[str, str, int], Callable[[], list[Json]]]:
    """Return a function for each training, the first seed of all before the next."""
    return {
        (task, method, seed): partial(measure_training, task, method, seed, settings.effort)
        for seed in range(settings.seeds)
        for task in settings.tasks
        for method in settings.methods
    }


def make_table(measured: Measurement) -> str:
    """Return a line for each training: steps in the time, and differences to the rule of eight."""
    effort = measured.values["effort"]
    lines = []
    order = {task: number for number, task in enumerate(SCALES)}
    rows = sorted(measured.values["rows"], key=lambda row: order[row["task"]])
    for row in rows:
        mean, low, high = row["over_rule"]
        until = row["over_rule_steps"]
        last = row["points"][-1]
        lines.append(
            (
                f"`{row['task']}`",
                row["method"],
                str(row["seed"]),
                f"{last['steps']:,}",
                "-" if until is None else f"{until:+.3f}",
                f"{mean:+.3f} [{low:+.3f}, {high:+.3f}]",
                f"{last['score'] - row['rule']:+.3f}",
            )
        )
    head = (
        "task",
        "method",
        "training seed",
        f"steps in {effort['seconds']:g} s",
        f"over the rule, best to {effort['steps']:,} steps",
        "best in the time",
        "at the end",
    )
    return (
        f"{markdown(head, lines)}\n\n"
        f"Differences of mean scores to the rule of eight, {effort['episodes']} validation "
        "episodes; 95 % intervals over "
        f"the episodes. {effort['seconds']:g} s of CPU time each, with "
        f"{effort['evaluations']} evaluations in equal "
        f"parts of it and one at the end of the round with step {effort['steps']:,}; of these "
        "the best counts. Steps of "
        "trials and of planners count."
    )


def describe_settings(settings: Settings) -> Json:
    """Return what the rows depend on."""
    return {"effort": asdict(settings.effort)}


STUDY: Study[Settings] = make_rows_study(
    NAME,
    "methods of training at equal time",
    list_cases,
    lambda row: (row["task"], row["method"], row["seed"]),
    make_table,
    key_values=describe_settings,
    stopped_message="finished trainings are in the file.",
)


@command()
@click.option(
    "--quick", is_flag=True, help=f"{QUICK.seconds:g} s a training, {QUICK.episodes} episodes."
)
@click.option(
    "--task",
    "tasks",
    type=click.Choice(list(SCALES)),
    multiple=True,
    help="May be repeated (default: all).",
)
@click.option(
    "--method",
    "methods",
    type=click.Choice(list(METHODS)),
    multiple=True,
    help="May be repeated (default: all).",
)
@click.option(
    "--seeds", type=click.IntRange(1), default=1, show_default=True, help="Training seeds."
)
@add_folder_options(PAGE)
def main(
    quick: bool,
    redraw: bool,
    tasks: tuple[str, ...],
    methods: tuple[str, ...],
    seeds: int,
    place: OutputPaths,
) -> None:
    """Train by each method for the same CPU time and compare with the rule of eight.

    A run that was stopped continues when the command is called again.
    """
    effort = QUICK if quick else TrainingEffort()
    settings = Settings(tasks or tuple(SCALES), methods or tuple(METHODS), seeds, effort)
    run(STUDY, settings, place, redraw=redraw)
