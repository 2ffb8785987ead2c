"""What the workbench finds on the paper's beam: best designs, optima, place, robustness, limits; figures and tables of docs/findings.md."""

# needs: optimise, cluster

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from _command_line import BadInput, name_files, plain_errors
from _design_options import QUICK_MEMBERS, QUICK_SPEED
from _findings_page import PARTS, data_rows, sections
from _findings_parts import Json, Study, concepts, optima, place, robustness
from _memory import peak_memory
from _report_page import ROOT, conditions, fill, published, require_markers

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import PAPER_RATE
from optimisation.evaluation import Threads
from optimisation.files import replacing, require_writable, write_csv, write_json

TEMPLATE = ROOT / "docs" / "findings.md"
QUICK_OUT = Path("results/findings")
OUT = published(Path("docs"), QUICK_OUT)
JOURNALS = Path("results/findings/journals")
DESIGNS, FEW, POINTS = 400, 4, 13  # odd: the study's own force is one of the points
QUICK_DESIGNS, QUICK_POINTS = 20, 6
NEEDS_CONCEPTS = "robustness"


def study_of(given: dict[str, Any], folder: Path) -> Study:
    quick, executor = given["quick"], Threads(given["threads"])
    if quick:
        return Study(executor, folder, QUICK_DESIGNS, QUICK_MEMBERS, QUICK_MEMBERS, QUICK_POINTS, QUICK_SPEED * PAPER_RATE, given["seed"])
    return Study(executor, folder, DESIGNS, DEFAULT_MEMBERS, FEW, POINTS, PAPER_RATE, given["seed"])


def compute(part: str, study: Study, data: Path) -> Json:
    """Return a part's numbers; the robustness is that of the designs that the part concepts has found."""
    if part == NEEDS_CONCEPTS:
        return robustness(study, load(data / "concepts.json"))
    from _findings_measured import front, full_study, scaling  # distributed is slow to import

    functions: dict[str, Callable[[Study], Json]] = {
        "concepts": concepts, "optima": optima, "place": place, "front": front, "scaling": scaling, "full": full_study,
    }  # fmt: skip
    return functions[part](study)


def load(path: Path) -> Json:
    """Read a part's numbers; raises BadInput if they are not there."""
    try:
        return dict(json.loads(path.read_text(encoding="utf-8"))["result"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path} is not allowed: a file that an earlier run of this script wrote ({error})") from error


def draw(part: str, out: Path, result: Json) -> list[Path]:
    """Write a part's table, figure and section of the page from its numbers."""
    from _findings_figures import FIGURES  # matplotlib is slow to import

    data, files = out / "findings", []
    for name, columns, rows in data_rows(part, result):
        write_csv(data / f"{name}.csv", columns, rows)
        files.append(data / f"{name}.csv")
    if part in FIGURES:
        files.append(data / f"{part}.png")
        with replacing(files[-1]) as temporary:
            FIGURES[part](temporary, result)
    fill(out / "findings.md", TEMPLATE, {f"findings:{part}": sections(part, result)})
    return [*files, out / "findings.md"]


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--part", "parts", type=click.Choice(list(PARTS)), multiple=True, help="Part to do; may be repeated.  [default: all]")
@click.option("--quick", is_flag=True, help=f"A look: few designs, fast sweeps, into {QUICK_OUT} unless told otherwise; the numbers mean little.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of searches and members.")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the numbers do not depend on it.  [default: all cores]")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder for findings.md and its folder findings.  [default: {OUT}]")
@click.option("--redraw", is_flag=True, help="Draw figures and tables again from the numbers in the folder; nothing is computed.")
def main(**given: Any) -> None:
    """Search, judge and explain the best absorbers for the paper's beam, and write docs/findings.md with its figures and tables.

    The text of the page is written by hand; what stands between markers is written by this command. Ctrl-C ends a part; finished parts are written,
    and the same command goes on inside the searches of the other.
    """
    out = given["out"] or (QUICK_OUT if given["quick"] else OUT)
    data, journals = out / "findings", JOURNALS / ("quick" if given["quick"] else "full") / str(given["seed"])
    with plain_errors("Broken off: finished parts are written; the same command goes on from here."):
        for folder in (data, journals):
            require_writable("--out" if folder is data else "results", folder)
        parts = given["parts"] or tuple(PARTS)
        require_markers(out / "findings.md", TEMPLATE, [f"findings:{part}" for part in parts])
        for part in parts:
            if not given["redraw"]:
                began = time.perf_counter()
                result = compute(part, study_of(given, journals), data)
                taken = {
                    "wall_s": round(time.perf_counter() - began, 1),
                    "memory_bytes": peak_memory(),
                    "quick": given["quick"],
                    "seed": given["seed"],
                }
                write_json(data / f"{part}.json", {"conditions": conditions() | taken, "result": result})
            result = load(data / f"{part}.json")
            files = draw(part, out, result)
            click.echo(f"{part}: {PARTS[part]}\n\n{sections(part, result)}")
            name_files(files)


if __name__ == "__main__":
    main(prog_name="scripts/run findings")
