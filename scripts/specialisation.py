"""What each scene leaves out: compiled code, compile time, speed, memory and imports, beside a part that is only switched off."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path

import click
from _command_line import end_early, name_files, plain_errors
from _report_page import ROOT, conditions, fill, load_results, published
from _specialisation_results import Measured, claims, measure, steps
from tqdm import tqdm

from optimisation.files import replacing, require_writable, write_csv, write_json

TEMPLATE = ROOT / "docs" / "specialisation.md"
QUICK_OUT = Path("results/specialisation")
OUT = published(Path("docs"), QUICK_OUT)
COLUMNS = (
    "absorber", "method", "record", "cold_s", "cached_s", "ns_per_period", "impacts_per_period", "memory_mb", "import_s", "instructions",
)  # fmt: skip


def run(quick: bool) -> Measured:
    started = time.perf_counter()
    with tqdm(total=steps(quick), desc="measuring", unit="process", disable=None) as bar:
        measured = measure(quick, bar.update)
    measured.conditions = conditions() | {"wall_s": round(time.perf_counter() - started, 1), "quick": quick}
    return measured


def save(out: Path, measured: Measured) -> list[Path]:
    """Write the numbers."""
    files = [out / "specialisation.json", out / "specialisation.csv"]
    write_json(files[0], asdict(measured))
    write_csv(files[1], COLUMNS, [[entry[name] for name in COLUMNS] for entry in measured.own.values()])
    return files


def draw(out: Path, measured: Measured) -> list[Path]:
    """Write figure and page."""
    from _specialisation_page import save_figure, sections  # matplotlib is slow to import

    figure, page = out / "specialisation.png", out / "specialisation.md"
    with replacing(figure) as temporary:
        save_figure(temporary, measured)
    fill(page, TEMPLATE, sections(measured))
    return [figure, page]


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help=f"Three scenes and short runs, into {QUICK_OUT} unless told otherwise.")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder for specialisation.json, .csv, .png and .md.  [default: {OUT}]")
@click.option("--redraw", is_flag=True, help="Draw figure and page again from the specialisation.json in the folder; nothing is measured.")
def main(quick: bool, out: Path | None, redraw: bool) -> None:
    """Compile each scene into a cache of its own, look into its compiled code, time it, and compare it with scenes that have a part switched off.

    Run it on an otherwise idle machine: it compiles some twenty variants, one process after the other. The exit code is 1 if a claim does not
    hold. Ctrl-C ends the run early and leaves what is finished.
    """
    out = out or (QUICK_OUT if quick else OUT)
    with plain_errors():
        require_writable("--out", out)
    if redraw:
        measured, files = load_results(out / "specialisation.json", Measured), []
    else:
        measured = run(quick)
        files = save(out, measured)
    files += draw(out, measured)
    broken = [claim for claim in claims(measured) if not claim.holds]
    for claim in claims(measured):
        click.echo(f"{'holds ' if claim.holds else 'BROKEN'}  {claim.text}: {claim.found}")
    name_files(files)
    end_early(measured.complete)
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main(prog_name="scripts/run specialisation")
