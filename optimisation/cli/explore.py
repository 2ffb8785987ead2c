"""A page in the browser with sliders for one absorber."""

# needs: explore

import webbrowser
from dataclasses import dataclass
from pathlib import Path

import click

from impact_env.modes import Structure
from impact_env.parameters import Beam
from impact_env.structures.cyclic import BladedDisk
from optimisation.cli.common import command, parse_posterior, plain_errors
from optimisation.cli.options import OptionSpec, option, switch
from optimisation.cli.scene_options import read_disk, read_structure

PORT = 8651


@dataclass(frozen=True, kw_only=True)
class ExploreOptions:
    """Options of ``explore``; None: not given."""

    structure: Path | None = option("structure")
    uncertain: tuple[tuple[str, tuple[str, ...]], ...] = option(
        "uncertain",
        help="Posterior of calibrate: its median is an example of the page",
        more="With the 90 % intervals in its words.",
        metavar="FILE",
        usual=True,
    )
    port: int = option(
        OptionSpec(
            names=("--port",),
            help="Port of the page; 0: any that is free",
            type=click.IntRange(0, 65535),
            default=PORT,
            usual=True,
        )
    )
    host: str = option(
        OptionSpec(
            names=("--host",),
            help="Address of the page",
            more=(
                "Any but this one lets others on the network use it; 0.0.0.0 or ::: all of this "
                "machine's."
            ),
            type=str,
            metavar="ADDRESS",
            default="127.0.0.1",
            usual=True,
        )
    )
    names: tuple[str, ...] = option(
        OptionSpec(
            names=("--name",),
            help="Another name under which browsers reach the page; may be repeated",
            more="As that of a proxy or of a container.",
            type=str,
            metavar="NAME",
            multiple=True,
            usual=True,
        )
    )
    browser: bool = option(
        switch("--browser/--no-browser", "Open the page in the browser", default=True, usual=True)
    )


@command(ExploreOptions, examples=("explore", "explore --structure arm.toml --port 8700"))
def main(options: ExploreOptions) -> None:
    """Explore absorbers on a local web page until Ctrl-C.

    The structure is the paper's beam or another one.

    The page needs no network. What a kind of absorber has to be compiled for is compiled once,
    while the page says so.
    """
    with plain_errors():
        own: Structure | BladedDisk = Beam()
        if options.structure is not None:
            own = read_disk(options.structure) or read_structure(options.structure)
        from optimisation.explore.examples import make_measured_example  # needs the extra
        from optimisation.explore.server import open_socket, page_address, serve

        posterior = parse_posterior(options.uncertain)
        examples = [] if posterior is None else [make_measured_example(posterior, own)]
        listening = open_socket(options.host, options.port)
        place = page_address(listening)

        def started() -> None:
            click.echo(f"{place}  (Ctrl-C ends it)")
            if options.browser:
                webbrowser.open(place)

        serve(
            own,
            "the paper's beam" if options.structure is None else options.structure.name,
            (options.host, *options.names),
            listening,
            started,
            examples,
        )
