"""Where compiled kernels are, or remove them."""

import re
import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import click
from filelock import FileLock

from impact_env.kernels.compiling.cache import LOCK_TIMEOUT_S, find_folders, hash_sources
from optimisation.cli.common import command, plain_errors
from optimisation.cli.options import OptionSpec, option, switch

SOURCE_HASH = re.compile(
    r"[0-9a-f]{16}"
)  # what `hash_sources` returns: nothing else is ever removed
STAMP = "warm"  # a checkout's set-up says with it that the usual kernels are there


@dataclass(frozen=True)
class KernelFolder:
    """A folder of compiled kernels.

    ``kernels``: their number. ``size``: size in bytes. ``current``: whether the present sources and
    compiler made them.
    """

    folder: Path
    kernels: int
    size: int
    current: bool


def parent_folders() -> tuple[Path, ...]:
    """Return the parent folders of the folders of compiled kernels.

    They are the folder in which this process writes and the one that it only reads. The result is
    empty if no kernels are stored.
    """
    places = find_folders()
    return tuple(folder.parent for folder in (places.write, places.read) if folder is not None)


def list_kernel_folders(parent: Path) -> list[KernelFolder]:
    """Return the kernels' folders in a parent folder, that of today's sources first."""
    folders = []
    for folder in parent.iterdir():
        if SOURCE_HASH.fullmatch(folder.name) and folder.is_dir() and not folder.is_symlink():
            sizes = {}
            for file in folder.rglob("*.nb[ci]"):
                with suppress(
                    FileNotFoundError
                ):  # another process has just put a new one in its place
                    sizes[file] = file.stat().st_size
            folders.append(
                KernelFolder(
                    folder,
                    sum(file.suffix == ".nbc" for file in sizes),
                    sum(sizes.values()),
                    folder.name == hash_sources(),
                )
            )
    return sorted(folders, key=lambda one: (not one.current, one.folder.name))


def clear(these: Iterable[KernelFolder]) -> None:
    """Remove folders of kernels, each when no process writes into it.

    Raises OSError if a process writes into a folder for a minute, or if a folder cannot be removed.
    """
    for one in these:
        if one.current:
            (one.folder.parent / STAMP).unlink(missing_ok=True)
        with FileLock(one.folder / "lock", timeout=LOCK_TIMEOUT_S):
            for inner in one.folder.iterdir():
                if inner.is_dir():
                    shutil.rmtree(inner)
        shutil.rmtree(one.folder)


@dataclass(frozen=True, kw_only=True)
class CacheOptions:
    """Options of ``cache``."""

    action: str = option(
        OptionSpec(
            names=("action",),
            help="What is done",
            type=click.Choice(["info", "clear"]),
            default="info",
        )
    )
    older: bool = option(
        switch("--older", "With clear: not the kernels of today's sources", usual=True)
    )


@command(CacheOptions, examples=("cache", "cache clear --older"))
def main(options: CacheOptions) -> None:
    """Show the folders of compiled kernels and their sizes (info), or remove them (clear).

    Removed kernels are compiled again when they are next used.

    Other files in that folder stay. IMPACT_ENV_CACHE names another folder.
    """
    with plain_errors():
        if options.older and options.action == "info":
            raise click.UsageError("--older goes with clear alone")
        places = parent_folders()
        if not places:
            click.echo(
                "No kernels are kept: NUMBA_DISABLE_JIT is set, or no folder can be written to."
            )
        if options.action == "clear":
            these = [
                one
                for place in places[:1]
                for one in list_kernel_folders(place)
                if not (options.older and one.current)
            ]
            clear(these)
            click.echo(
                f"removed: {len(these)} folders, {sum(one.size for one in these) / 1e6:.1f} MB"
            )
            return
        for k, place in enumerate(places):
            click.echo(f"{place}{' (only read)' if k else ''}")
            for one in list_kernel_folders(place):
                made = (
                    "of today's sources" if one.current else "of other sources or another compiler"
                )
                click.echo(
                    f"  {one.folder}: {one.kernels} kernels, {one.size / 1e6:.1f} MB, {made}"
                )
