"""Parts of ``compare`` and ``design gap`` for a bladed disk: options, runs and files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from impact_env.structures.cyclic import BladedDisk
from optimisation.answers.disk import advise_disk, compare_disk
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import AnswerFiles, BadInput, name_files
from optimisation.disks import (
    FORCES,
    MEMBERS,
    DiskCase,
    count_comparison_runs,
    count_gap_runs,
    disk_case,
)
from optimisation.executors import PlannedRuns, announce_runs, sweeps_bar
from optimisation.executors import executor as executor_on

if TYPE_CHECKING:
    from optimisation.cli.compare import CompareOptions
    from optimisation.cli.design_gap import GapOptions

QUICK_MEMBERS = 1


def refuse_with_disk(names: Sequence[str]) -> None:
    """Raise BadInput if one of the options that are named was given beside a bladed disk."""
    for name in names:
        if scenes.is_option_set(name):
            raise BadInput(
                f"{scenes.option_name(name)} does not go with a bladed disk: its file has the "
                "structure and the absorbers, and the level is that "
                "of the worst sector under an engine-order force"
            )


def announce_disk_runs(
    case: DiskCase, number: int, threads: int | None, cluster: str | None
) -> None:
    """Print how long a ``number`` of sweeps of a disk takes, if it is long.

    Nothing is printed for the workers of a cluster.
    """
    if cluster is None:
        periods = case.schedules()[0].periods
        planned = PlannedRuns(case.disk.scene(), case.force, case.resonance, periods, number)
        announce_runs([planned], threads, "A higher --rate, fewer --members or --quick take less.")


def compare_on_file(disk: BladedDisk, options: CompareOptions) -> None:
    """Compare the absorbers of a disk, print the table, and write table, figure and summary."""
    members = options.members or (QUICK_MEMBERS if options.quick else MEMBERS)
    forces = options.forces or FORCES
    number = count_comparison_runs(forces, members)
    case = disk_case(disk, options.force, None, options.rate)
    announce_disk_runs(case, number, options.threads, options.cluster)
    with (
        executor_on(options.threads, options.cluster) as executor,
        sweeps_bar("comparing") as show,
    ):
        answer = compare_disk(
            disk,
            options.force,
            forces=forces,
            members=members,
            seed=options.seed,
            rate=options.rate,
            progress=show,
            executor=executor,
        )
    name_files(AnswerFiles(options.out, options.json).write(answer))


def choose_gap_on_file(disk: BladedDisk, options: GapOptions) -> None:
    """Choose the clearance of a disk's absorbers, and print the result.

    Table, figure, summary and device are written.
    """
    members = options.members or (QUICK_MEMBERS if options.quick else MEMBERS)
    resonance = options.resonance if scenes.is_option_set("resonance") else None
    case = disk_case(disk, options.force, resonance, options.rate)
    announce_disk_runs(case, count_gap_runs(members), options.threads, options.cluster)
    with (
        executor_on(options.threads, options.cluster) as executor,
        sweeps_bar("simulating") as show,
    ):
        answer = advise_disk(
            disk,
            options.force,
            resonance=resonance,
            tolerance=options.force_tolerance,
            members=members,
            seed=options.seed,
            rate=options.rate,
            progress=show,
            executor=executor,
        )
    name_files(AnswerFiles(options.out, options.json, options.device).write(answer))
