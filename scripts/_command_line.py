"""What the scripts' command lines share: errors of the caller, and files that can be written."""

from __future__ import annotations

import os
from pathlib import Path

import click


class BadInput(click.ClickException):
    """An error of the caller: one line, exit code 2."""

    exit_code = 2


def check_target(option: str, target: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Raise BadInput, before any work is done, if a file cannot be written or has a suffix other than ``suffixes``."""
    if target is None:
        return
    folder = target.resolve().parent
    if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
        raise BadInput(f"{option} = {target} is not allowed: a file in a folder that exists and can be written to")
    if target.exists() and not target.is_file():
        raise BadInput(f"{option} = {target} is not allowed: a plain file, since it is replaced as a whole")
    if suffixes and target.suffix.lower() not in suffixes:
        raise BadInput(f"{option} = {target} is not allowed: a name that ends in {', '.join(suffixes)}")
