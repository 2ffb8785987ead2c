"""Error against run time: all methods and two peers over all scenes, with the growth of errors, the jump study and the costs."""
# needs: peers

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import click
from _command_line import INTERRUPTED, BadInput
from _progress import BAR
from _report_page import published
from accuracy import bands, cost, distribution, figures, growth, jumps, more_figures, tables, trajectory
from accuracy.cases import KINDS
from accuracy.study import FULL, QUICK, Result, Row, Settings, circumstances, load, save, with_scenes
from matplotlib.figure import Figure
from tqdm import tqdm

from impact_env.parameters import ParameterError
from impact_env.sweep import IntegrationError
from optimisation.files import replacing, require_writable

QUICK_OUT = Path("results/error_vs_runtime")
OUT = published(Path("docs/error_vs_runtime"), QUICK_OUT)
DPI = 110


@dataclass(frozen=True)
class Part:
    """A part of the study: how many steps it takes, its rows step by step, its figures by file name, its table."""

    count: Callable[[Settings], int]
    rows: Callable[[Settings], Iterator[list[Row]]]
    figures: Callable[[list[Row]], dict[str, Figure]]
    table: Callable[[list[Row]], str]


PARTS = {
    trajectory.NAME: Part(trajectory.count, trajectory.rows, figures.trajectory_figures, tables.trajectory_table),
    distribution.NAME: Part(distribution.count, distribution.rows, figures.distribution_figures, tables.distribution_table),
    bands.NAME: Part(bands.count, bands.rows, lambda _rows: {}, tables.band_table),
    growth.NAME: Part(growth.count, growth.rows, more_figures.growth_figures, tables.growth_table),
    jumps.NAME: Part(jumps.count, jumps.rows, more_figures.jump_figures, tables.jump_table),
    cost.NAME: Part(cost.count, cost.rows, more_figures.cost_figures, tables.cost_table),
}


def compute(name: str, settings: Settings, quick: bool) -> Result:
    """Compute a part; Ctrl-C, or a run that breaks down, ends it with the steps that are finished."""
    part, rows, began, complete, failure = PARTS[name], [], time.perf_counter(), False, ""
    total = part.count(settings)
    with tqdm(total=total, desc=name, bar_format=BAR, disable=None) as bar:
        try:
            for step in part.rows(settings):
                rows += step
                bar.update()
            complete = True
        except KeyboardInterrupt:
            pass
        except IntegrationError as error:
            failure = str(error)
    return Result(name, rows, circumstances(quick, time.perf_counter() - began, complete) | {"failure": failure})


def draw(out: Path, result: Result) -> list[Path]:
    files = []
    for name, figure in PARTS[result.part].figures(result.rows).items():
        files.append(out / f"{name}.png")
        with replacing(files[-1]) as temporary:
            figure.savefig(temporary, dpi=DPI)
    return files


def publish(out: Path, result: Result) -> None:
    """Draw a part's figures, print its table, and put it into the page beside the folder, if there is one."""
    files = draw(out, result)
    table = PARTS[result.part].table(result.rows)
    click.echo(f"\n{result.part}\n\n{table}" + ("\n\nwritten: " + ", ".join(map(str, files)) if files else ""))
    page = out.with_suffix(".md")
    if page.is_file() and not tables.insert(page, result.part, f"\n{table}\n\n{tables.made_with(result)}\n"):
        click.echo(f"{page} has no place for the part {result.part}", err=True)


def redraw(out: Path, names: list[str]) -> None:
    found = [result for name in names if (result := load(out, name)) is not None]
    if not found:
        raise BadInput(f"--out = {out} is not allowed with --redraw: a folder with results of {', '.join(names)}")
    for result in found:
        publish(out, result)


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--only", type=click.Choice(list(PARTS)), multiple=True, help="Compute this part only; may be given several times.")
@click.option(
    "--scene",
    "scenes",
    type=click.Choice([kind.name for kind in KINDS]),
    multiple=True,
    help=f"Measure this scene's {trajectory.NAME} anew and keep the other scenes in the files; may be given several times.",
)
@click.option("--quick", is_flag=True, help="A look in about two minutes: few scenes, methods and runs.")
@click.option("--no-peers", is_flag=True, help="Leave SciPy and heyoka out.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of phases and perturbations.")
@click.option("--redraw", "only_draw", is_flag=True, help="Draw figures and tables anew from the files in --out; nothing is computed.")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder for results and figures.  [default: {OUT}; {QUICK_OUT} with --quick]")
def main(only: tuple[str, ...], scenes: tuple[str, ...], quick: bool, no_peers: bool, seed: int, only_draw: bool, out: Path | None) -> None:
    """Measure error against run time, on one core and without compilation.

    Each part writes PART.json and PART.csv and its figures into --out, and its table into the page FOLDER.md beside that folder if there is one. Run
    it on an otherwise idle machine: the times are medians, but nothing can make up for a core that is shared. Ctrl-C ends a part early and leaves
    what is finished.
    """
    out = out or (QUICK_OUT if quick else OUT)
    names = [name for name in PARTS if not only or name in only] if not scenes else [trajectory.NAME]
    settings = replace(QUICK if quick else FULL, seed=seed, peers=not no_peers)
    if scenes:
        settings = replace(settings, kinds=tuple(kind.name for kind in KINDS if kind.name in scenes))
    try:
        if only_draw:
            redraw(out, names)
            return
        require_writable("--out", out)
        for name in names:
            result = compute(name, settings, quick)
            if scenes and result.rows and (old := load(out, name)) is not None:
                result = with_scenes(old, result, [(kind.name, modes) for kind in KINDS for modes in FULL.modes])
            if result.rows:
                save(out, result)
                publish(out, result)
            if result.circumstances["failure"]:
                raise click.ClickException(f"{name} is not complete: {result.circumstances['failure']}")
            if not result.complete:
                click.echo("Stopped early: the files hold what was finished.", err=True)
                sys.exit(INTERRUPTED)
    except (ParameterError, ValueError) as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:  # while files are written
        click.echo("Broken off.", err=True)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main(prog_name="scripts/run error_vs_runtime")
