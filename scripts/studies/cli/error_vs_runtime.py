"""Error against run time of all methods and two peers, on all scenes.

The study also has the growth of errors, the jump study and the costs.
"""
# needs: peers

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType

import click
from matplotlib.figure import Figure

from optimisation.cli.common import command, seed_option
from optimisation.files import publication_folder
from optimisation.report.report import write_figure
from studies.accuracy import bands, cost, distribution, growth, jumps, trajectory
from studies.accuracy.cases import FULL, QUICK, AccuracySettings, Row, made_with
from studies.study import Measurement, Part, Saver, Study, make_rows_part, paths_with_page, run

QUICK_OUT = Path("results/error_vs_runtime")
OUT = publication_folder(Path("docs/methods"), QUICK_OUT)
DPI = 110


def _part(
    module: ModuleType,
    title: str,
    table: Callable[[list[Row]], str],
    draw: Callable[[list[Row]], dict[str, Figure]] = lambda _: {},
) -> Part[AccuracySettings]:
    """Return a part of the study.

    ``module`` has the ``cases`` and the ``key`` of a row's case. ``table`` makes a table from the
    rows, and ``draw`` makes figures by file name.
    """

    def text(measured: Measurement) -> str:
        return f"{table(measured.values['rows'])}\n\n{made_with(measured)}"

    def figures(measured: Measurement) -> dict[str, Saver]:
        return {
            file: partial(write_figure, figure, dpi=DPI)
            for file, figure in draw(measured.values["rows"]).items()
        }

    return make_rows_part(module.NAME, title, module.cases, module.key, text, figures=figures)


STUDY: Study[AccuracySettings] = Study(
    (
        _part(
            trajectory,
            "errors over the first impacts",
            trajectory.trajectory_table,
            trajectory.trajectory_figures,
        ),
        _part(
            distribution,
            "errors of the level's distribution",
            distribution.distribution_table,
            distribution.distribution_figures,
        ),
        _part(bands, "what a band stands for", bands.band_table),
        _part(growth, "how fast errors grow", growth.growth_table, growth.growth_figures),
        _part(jumps, "the jump of the two-mode absorber", jumps.jump_table, jumps.jump_figures),
        _part(cost, "what a pseudo period costs", cost.cost_table, cost.cost_figures),
    ),
    notes=lambda settings: {
        "quick": settings.quick,
        "seed": settings.seed,
        "peers": settings.peers,
    },
    packages=("numpy", "scipy", "numba", "mpmath", "heyoka"),
    same=("processor", "versions", "quick", "seed", "peers"),
)
PARTS = tuple(part.name for part in STUDY.parts)


@command()
@click.option(
    "--only",
    type=click.Choice(PARTS),
    multiple=True,
    help="Compute this part only; may be given several times.",
)
@click.option(
    "--quick", is_flag=True, help="A look in about two minutes: few scenes, methods and runs."
)
@click.option("--no-peers", is_flag=True, help="Leave SciPy and heyoka out.")
@seed_option
@click.option(
    "--redraw",
    is_flag=True,
    help="Draw figures and tables anew from the files in --out; nothing is computed.",
)
@click.option(
    "--resume",
    is_flag=True,
    help=(
        "Go on from the files in --out where runs were stopped early; what is complete is left as "
        "it is."
    ),
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder for results and figures.  [default: {OUT}; {QUICK_OUT} with --quick]",
)
def main(
    only: tuple[str, ...],
    quick: bool,
    no_peers: bool,
    seed: int,
    redraw: bool,
    resume: bool,
    out: Path | None,
) -> None:
    """Measure error against run time, on one core and without compilation.

    Each part writes PART.json.gz and its figures into --out, and its table into the page FOLDER.md
    beside that folder if there is one. Run it on an otherwise idle machine: the times are medians,
    but nothing can make up for a core that is shared. Ctrl-C ends a part early and leaves what is
    finished.
    """
    settings = replace(QUICK if quick else FULL, seed=seed, peers=not no_peers)
    run(
        STUDY,
        settings,
        paths_with_page(out or (QUICK_OUT if quick else OUT), only or PARTS),
        only=only,
        redraw=redraw,
        resume=resume,
    )
