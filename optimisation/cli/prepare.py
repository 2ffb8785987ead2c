"""Compile the usual kernels now, so that no later call waits for them."""

import os
import sys

import click

from impact_env.kernels.compiling.cache import HOST_VARIABLE
from impact_env.warm_up import JOBS
from impact_env.warm_up import main as warm_up
from optimisation.cli.common import command, plain_errors


@command()
@click.argument("what", type=click.Choice([word for word in JOBS if word]), required=False)
@click.option(
    "--host",
    is_flag=True,
    help="Compile them for this very processor, also where kernels for any came with the package.",
)
def main(what: str | None, host: bool) -> None:
    """Compile the kernels of the usual scenes, those of the environments, or both with all that is usually recorded (all), unless they are there.

    Kernels that came with the package run on any processor with AVX2; those for this one are up to a third faster, and give the same digits.
    """
    with plain_errors():
        if host:
            os.environ[HOST_VARIABLE] = "host"
        sys.exit(warm_up([] if what is None else [what], lambda line: click.echo(line, err=True)))
