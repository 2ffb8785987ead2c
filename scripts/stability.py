"""Stiff and extreme cases with every method, step limits, eigenproblem, very long runs: what holds, what is refused, what fails."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path

import click
from _command_line import end_early, plain_errors
from _progress import BAR
from _report_page import ROOT, conditions, fill, load_results, published
from _stability_page import CELL_COLUMNS, sections
from _stability_tasks import Results, gather, tasks
from _workers import Outcome, Pool
from tqdm import tqdm

from impact_env.ensemble import available_cores
from optimisation.files import replacing, require_writable, write_csv, write_json

COMPILE_S = 240.0  # at most, for the kernels of a kind of scene
TEMPLATE = ROOT / "docs" / "stability.md"
QUICK_OUT = Path("results/stability")
OUT = published(Path("docs"), QUICK_OUT)


def run(quick: bool, workers: int) -> Results:
    """Do all tasks; an interrupt ends the work and keeps what is finished."""
    started, order, outcomes = time.perf_counter(), tasks(quick), list[Outcome]()
    with tqdm(total=len(order), desc="checking", bar_format=BAR, disable=None) as bar:
        stream = Pool(workers, COMPILE_S).run(order)
        try:
            for outcome in stream:
                outcomes.append(outcome)
                bar.update()
        except KeyboardInterrupt:
            pass
        finally:
            stream.close()  # type: ignore[attr-defined]
    wall = {"wall_s": round(time.perf_counter() - started, 1), "workers": workers, "quick": quick}
    return gather(outcomes, order, conditions() | wall)


def save(out: Path, results: Results) -> list[Path]:
    """Write the numbers."""
    files = [out / "stability.json", out / "stability.csv"]
    write_json(files[0], asdict(results))
    write_csv(files[1], CELL_COLUMNS, [[cell[name] for name in CELL_COLUMNS] for cell in results.cells])
    return files


def draw(out: Path, results: Results) -> list[Path]:
    """Write figure and page."""
    from _stability_figure import save_figure  # matplotlib is slow to import

    figure, page = out / "stability.png", out / "stability.md"
    with replacing(figure) as temporary:
        save_figure(temporary, results)
    fill(page, TEMPLATE, sections(results))
    return [figure, page]


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help=f"Some of the cases and shorter runs, into {QUICK_OUT} unless told otherwise.")
@click.option("--workers", type=click.IntRange(min=1), help="Number of processes.  [default: all cores]")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder for stability.json, .csv, .png and .md.  [default: {OUT}]")
@click.option("--redraw", is_flag=True, help="Draw figure and page again from the stability.json in the folder; nothing is computed.")
def main(quick: bool, workers: int | None, out: Path | None, redraw: bool) -> None:
    """Run the matrix of stiff and extreme cases with every method, and look for step limits, eigenproblem errors and drift in very long runs.

    Each cell either comes close to an independent reference or is refused with a clear error. The exit code is 1 if any cell failed. Under 10 minutes
    (--quick: under one) once the kernels are compiled. Ctrl-C ends the run early and leaves what is finished.
    """
    out = out or (QUICK_OUT if quick else OUT)
    with plain_errors():
        require_writable("--out", out)
    if redraw:
        results, files = load_results(out / "stability.json", Results), []
    else:
        results = run(quick, workers or available_cores())
        files = save(out, results)
    files += draw(out, results)
    failures = list(results.failures())
    click.echo(sections(results)["stability:matrix"])
    for line in failures:
        click.echo(f"FAILED  {line}")
    click.echo(f"\n{len(failures)} failures; written: " + ", ".join(str(file) for file in files))
    end_early(results.complete)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main(prog_name="scripts/run stability")
