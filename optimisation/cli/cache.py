"""Tell where compiled kernels are kept and how large they are, or remove them."""

from __future__ import annotations

import click

from optimisation.cli.common import command, plain_errors
from optimisation.kept_kernels import Kept, clear, kept, parents


def line(one: Kept) -> str:
    """Return what is said of one folder."""
    made = "of today's sources" if one.current else "of other sources or another compiler"
    return f"{one.folder}: {one.kernels} kernels, {one.size / 1e6:.1f} MB, {made}"


@command()
@click.argument("action", type=click.Choice(["info", "clear"]), default="info")
@click.option("--older", is_flag=True, help="With clear: keep the kernels of today's sources.")
def main(action: str, older: bool) -> None:
    """Tell where compiled kernels are kept and how large they are (info), or remove them (clear): they are compiled anew when they are next used.

    Other files in that folder stay. IMPACT_ENV_CACHE names another folder.
    """
    with plain_errors():
        if older and action == "info":
            raise click.UsageError("--older goes with clear alone")
        places = parents()
        if not places:
            click.echo("No kernels are kept: NUMBA_DISABLE_JIT is set, or no folder can be written to.")
        if action == "clear":
            these = [one for place in places[:1] for one in kept(place) if not (older and one.current)]
            clear(these)
            click.echo(f"removed: {len(these)} folders, {sum(one.size for one in these) / 1e6:.1f} MB")
            return
        for k, place in enumerate(places):
            click.echo(f"{place}{' (only read)' if k else ''}")
            for one in kept(place):
                click.echo(f"  {line(one)}")
