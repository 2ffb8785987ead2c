"""A page in the browser to move sliders on: curve, sweep, frequency response and motion of one absorber, at once."""

# needs: explore

import webbrowser
from pathlib import Path

import click

from impact_env.modes import Structure
from impact_env.parameters import Beam
from impact_env.structures.cyclic import BladedDisk
from optimisation.cli.common import command, plain_errors
from optimisation.cli.scene_options import read_disk, read_structure, structure_option

PORT = 8651


@command()
@structure_option
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=PORT,
    show_default=True,
    help="Port of the page; 0: any that is free.",
)
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address of the page. Any but this one lets others on the network use it; 0.0.0.0 or ::: all of this machine's.",
)
@click.option(
    "--name",
    "names",
    multiple=True,
    help="Another name under which browsers reach the page, as that of a proxy or of a container; may be repeated.",
)
@click.option(
    "--browser/--no-browser", default=True, show_default=True, help="Open the page in the browser."
)
def main(
    structure: Path | None, port: int, host: str, names: tuple[str, ...], browser: bool
) -> None:
    """Explore absorbers on the paper's beam, or another structure, on a page of this machine, until Ctrl-C.

    The page needs no network. What a kind of absorber has to be compiled for is compiled once, while the page says so.
    """
    with plain_errors():
        own: Structure | BladedDisk = Beam()
        if structure is not None:
            own = read_disk(structure) or read_structure(structure)
        from optimisation.explore.server import bound, page_address, serve  # needs the extra

        listening = bound(host, port)
        place = page_address(listening)

        def started() -> None:
            click.echo(f"{place}  (Ctrl-C ends it)")
            if browser:
                webbrowser.open(place)

        serve(
            own,
            "the paper's beam" if structure is None else structure.name,
            (host, *names),
            listening,
            started,
        )
