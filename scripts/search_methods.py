"""Compare searches for the same cost: CMA-ES, random search, a Gaussian process with replication and a dense map, over several seeds."""

# needs: optimise

from __future__ import annotations

import json
from pathlib import Path

import click
import numpy as np
from _design_search import BARS

from optimisation.command_line import BadInput, end_early, name_files, plain_errors
from optimisation.evaluation import Threads
from optimisation.files import require_writable, write_json
from optimisation.report.markdown import markdown
from optimisation.studies.machine import conditions, sources
from optimisation.studies.page import ROOT, fill, published, require_markers
from optimisation.studies.search_methods import (
    DESIGNS,
    LABELS,
    MEMBERS,
    QUESTIONS,
    SEEDS,
    Trial,
    as_json,
    from_json,
    standings,
    trial,
    wanted,
    winner,
)

PAGE, RESULTS, SECTION, MACHINE = "search_methods.md", "search_methods.json", "searches:levels", "searches:machine"
QUICK = {"designs": 40, "members": 4, "seeds": 2, "speed": 4.0}
FULL = {"designs": DESIGNS, "members": MEMBERS, "seeds": SEEDS, "speed": 1.0}


def table(trials: list[Trial]) -> str:
    header = ("question", "method", "seeds", "level of the winner, %: median", "from", "to", "over CMA-ES (95 %)")
    rows = [
        (
            r.question,
            LABELS[r.method],
            str(len(r.levels)),
            *(f"{100 * x:.1f}" for x in (np.median(r.levels), min(r.levels), max(r.levels))),
            r.over_cma,
        )
        for r in standings(trials)
    ]
    best = winner(trials)
    return markdown(header, rows) + (f"\n\nLeast mean rank: {LABELS[best]}." if best else "")


def known_trials(file: Path, settings: dict[str, object]) -> dict[tuple[str, str, int], Trial]:
    if not file.exists():
        return {}
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        found = [from_json(values) for values in content["trials"]] if content["settings"] == settings else []
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{file} is not allowed: a file that an earlier run wrote ({error!r}); remove it or choose another --out") from error
    return {one.key: one for one in found}


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help="A look: 40 designs, 4 members, 2 seeds, sweeps 4 times as fast.")
@click.option("--question", multiple=True, type=click.Choice(list(QUESTIONS)), help="What is searched; may be repeated.  [default: all]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: docs, with --quick results/search_methods]")
def main(quick: bool, question: tuple[str, ...], threads: int | None, out: Path | None) -> None:
    """Search with each method from scratch over several seeds, and judge the winners on fresh members.

    Writes search_methods.json after each search, and the page search_methods.md. Ctrl-C keeps what is finished: the same command goes on from there.
    """
    results, size = Path("results/search_methods"), QUICK if quick else FULL
    out = out or (results if quick else published(ROOT / "docs", results))
    questions = list(question) or list(QUESTIONS)
    with plain_errors():
        require_writable("--out", out)
        template, file = ROOT / "docs" / PAGE, out / RESULTS
        require_markers(out / PAGE, template, [SECTION, MACHINE])
        settings: dict[str, object] = {**size, "questions": questions}
        known, machine, keys = known_trials(file, settings), conditions(), list(wanted(questions, int(size["seeds"])))
        for key in keys:
            if key in known:
                continue
            one = trial(*key, int(size["designs"]), int(size["members"]), Threads(threads), size["speed"], BARS)
            if one is None:
                break
            known[key] = one
            write_json(file, {"settings": settings, "conditions": machine, "trials": [as_json(known[k]) for k in keys if k in known]})
        trials = [known[k] for k in keys if k in known]
        if trials:
            fill(out / PAGE, template, {SECTION: table(trials), MACHINE: sources(machine)})
            click.echo(table(trials))
            name_files([file, out / PAGE])
    end_early(len(trials) == len(keys), "the same command goes on from here.")


if __name__ == "__main__":
    main()
