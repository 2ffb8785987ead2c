"""Compile the usual kernels now."""

import os
import sys
from dataclasses import dataclass

import click

from impact_env.kernels.compiling.cache import HOST_VARIABLE
from impact_env.warm_up import JOBS
from impact_env.warm_up import main as warm_up
from optimisation.cli.common import command, plain_errors
from optimisation.cli.options import OptionSpec, option, switch


@dataclass(frozen=True, kw_only=True)
class PrepareOptions:
    """Options of ``prepare``; None: not given."""

    what: str | None = option(
        OptionSpec(
            names=("what",),
            help="Which kernels",
            type=click.Choice([word for word in JOBS if word]),
        )
    )
    this_processor: bool = option(
        switch(
            "--this-processor",
            "Compile them for this very processor",
            more="Also where kernels for any came with the package.",
            usual=True,
            older=("--host",),
        )
    )


@command(PrepareOptions, examples=("prepare", "prepare all --this-processor"))
def main(options: PrepareOptions) -> None:
    """Compile the kernels of the usual scenes, of the environments, or of both (all).

    With all, kernels for the usual recordings are compiled as well. Kernels that exist are not
    compiled again.

    Kernels that came with the package run on any processor with AVX2; those for this one are up to
    a third faster, and give the same digits.
    """
    with plain_errors():
        if options.this_processor:
            os.environ[HOST_VARIABLE] = "host"
        sys.exit(
            warm_up(
                [] if options.what is None else [options.what],
                lambda line: click.echo(line, err=True),
            )
        )
