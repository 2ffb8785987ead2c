"""What ``compare`` and ``design gap`` do with a bladed disk: options that go with it, runs, and files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from impact_env.plain import from_disk
from impact_env.structures.cyclic import BladedDisk
from optimisation.answers.disk import advise_disk, compare_disk
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import BadInput, name_files
from optimisation.disk_levels import FORCES, MEMBERS
from optimisation.executors import executor as executor_on
from optimisation.files import write_files, write_json
from optimisation.progress import sweeps_bar

if TYPE_CHECKING:
    from optimisation.cli.compare import CompareOptions
    from optimisation.cli.design_gap import GapOptions

QUICK_MEMBERS = 1


def refuse_with_disk(names: Sequence[str]) -> None:
    """Raise BadInput if one of the options that are named was given beside a bladed disk."""
    for name in names:
        if scenes.is_option_set(name):
            raise BadInput(
                f"{scenes.option_name(name)} does not go with a bladed disk: its file has the structure and the absorbers, and the level is that "
                "of the worst sector under an engine-order force"
            )


def compare_on_file(disk: BladedDisk, options: CompareOptions) -> None:
    """Compare the absorbers of a disk, print the table, and write table, figure and summary."""
    usual = QUICK_MEMBERS if options.quick else MEMBERS
    with (
        executor_on(options.threads, options.cluster) as executor,
        sweeps_bar("comparing") as show,
    ):
        answer = compare_disk(
            disk,
            options.force,
            forces=options.forces or FORCES,
            members=options.members or usual,
            seed=options.seed,
            rate=options.rate,
            progress=show,
            executor=executor,
        )
    click.echo(str(answer))
    name_files(answer.save(options.out) + write_files({options.json: answer.to_json()}))


def choose_gap_on_file(disk: BladedDisk, options: GapOptions) -> None:
    """Choose the clearance of a disk's absorbers, print the answer, and write table, figure, summary and device."""
    usual = QUICK_MEMBERS if options.quick else MEMBERS
    with (
        executor_on(options.threads, options.cluster) as executor,
        sweeps_bar("simulating") as show,
    ):
        answer = advise_disk(
            disk,
            options.force,
            resonance=options.resonance if scenes.is_option_set("resonance") else None,
            tolerance=options.force_tolerance,
            members=options.members or usual,
            seed=options.seed,
            rate=options.rate,
            progress=show,
            executor=executor,
        )
    click.echo(str(answer))
    files = answer.save(options.out) + write_files({options.json: answer.to_json()})
    if options.device is not None:
        write_json(options.device, from_disk(answer.device))
        files.append(options.device)
    name_files(files)
