"""The main job: impact absorber, friction damper and tuned absorbers compared over the force, near two resonances."""

from __future__ import annotations

import platform
import time
from pathlib import Path

import click
import numba
import numpy
import scipy
from _command_line import end_early, name_files, plain_errors
from _memory import peak_memory
from _progress import sweeps_bar

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.ensemble import available_cores
from optimisation.comparison import DEFAULT_FORCES, Comparison, compare
from optimisation.executors import cluster_option, workers
from optimisation.files import replacing, require_writable, write_csv, write_json
from optimisation.report.comparison_tables import CURVE_COLUMNS, RUN_COLUMNS, curve_rows, run_rows, summary, text_table

QUICK_FORCES, QUICK_MEMBERS = 10, 2


def write(out: Path, comparison: Comparison, conditions: dict[str, object]) -> list[Path]:
    from optimisation.report.comparison_figure import save_figure  # matplotlib is slow to import

    files = [out / name for name in ("runs.csv", "curves.csv", "summary.json", "comparison.png")]
    write_csv(files[0], RUN_COLUMNS, run_rows(comparison))
    write_csv(files[1], CURVE_COLUMNS, curve_rows(comparison))
    write_json(files[2], conditions | summary(comparison))
    with replacing(files[3]) as temporary:
        save_figure(temporary, comparison)
    return files


def run(forces: int, members: int, seed: int, threads: int | None, cluster: str | None) -> Comparison:
    with workers(threads, cluster) as executor, sweeps_bar("comparing") as show:
        return compare(forces=forces, members=members, seed=seed, threads=threads, progress=show, executor=executor)


def conditions(started: float, threads: int | None, cluster: str | None) -> dict[str, object]:
    versions = {"python": platform.python_version(), "numpy": numpy.__version__, "scipy": scipy.__version__, "numba": numba.__version__}
    return {
        "versions": versions,
        **({"cluster": cluster} if cluster else {"threads": threads or available_cores()}),
        "wall_s": round(time.perf_counter() - started, 2),
        "memory_bytes": peak_memory(),
    }


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help=f"A look in a few seconds: {QUICK_FORCES} forces, {QUICK_MEMBERS} members, unless given.")
@click.option("--members", type=click.IntRange(min=1), help=f"Runs for each point, with other phases and roundings.  [default: {DEFAULT_MEMBERS}]")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the phases and roundings.")
@click.option("--forces", type=click.IntRange(min=2), help=f"Number of forces for each resonance.  [default: {DEFAULT_FORCES}]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("results/compare_absorbers"), show_default=True, help="Folder for figure and tables."
)
def main(quick: bool, members: int | None, seed: int, forces: int | None, threads: int | None, cluster: str | None, out: Path) -> None:
    """Compare absorbers of one mass on the paper's beam: response level over the force near the first and the second resonance.

    Writes comparison.png, curves.csv (medians and bands), runs.csv (every run) and summary.json, and prints a table. Ctrl-C ends the
    run early and leaves what is finished.
    """
    started = time.perf_counter()
    members = members or (QUICK_MEMBERS if quick else DEFAULT_MEMBERS)
    forces = forces or (QUICK_FORCES if quick else DEFAULT_FORCES)
    with plain_errors():
        require_writable("--out", out)
        comparison = run(forces, members, seed, threads, cluster)
        files = write(out, comparison, conditions(started, threads, cluster))
    click.echo(text_table(comparison))
    name_files(files)
    end_early(comparison.complete, "the files hold the runs that were finished.")


if __name__ == "__main__":
    main()
