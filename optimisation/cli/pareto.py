"""Trade two aims of one absorber against each other: Pareto fronts of first against second resonance, or level against impact severity.

The front is searched by NSGA-II, run again on fresh members, and drawn with the paper's design and the limit.
"""

# needs: optimise

from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.ensemble import Executor
from impact_env.parameters import ParameterError
from optimisation.cli import design_options as design
from optimisation.cli.common import (
    command,
    end_early,
    end_without,
    name_files,
    out_option,
    plain_errors,
)
from optimisation.cli.design_duration import announce_search
from optimisation.cli.scene_options import is_option_set, refuse_with_load
from optimisation.executors import executor as executor_on
from optimisation.files import require_writable, write_files
from optimisation.objectives import Objective
from optimisation.problem import Problem
from optimisation.report.card import write_card
from optimisation.report.cards import front_card
from optimisation.report.design_figures import save_front
from optimisation.report.front_report import bounds_of, front_summary, front_table, front_text
from optimisation.search import pareto as fronts
from optimisation.search.run_cache import check_study_file
from optimisation.search.settings import CMA, SAMPLERS, default_settings
from optimisation.space import FRICTION_LIMIT, GAP, IMPACT

RESONANCES = "resonances"
SEVERITY = "severity"
DESIGNS = 300
QUICK_DESIGNS = 100
AT_HELP = "Resonance and force in N; may be repeated.  [default: 1:3.5 and, for resonances, 2:15; with --structure by the design rule]"
MEMBERS = 4
QUICK_MEMBERS = 2
DEFAULT_AT = {RESONANCES: fronts.FORCES, SEVERITY: ((1, 3.5),)}
SEVEREST = 0.1  # W: a corner for hypervolumes
CORNERS = {RESONANCES: fronts.CORNER, SEVERITY: (fronts.CORNER[0], SEVEREST)}


def make(against: str, options: dict[str, Any]) -> Problem:
    """Return the problem; where severity counts, the restitution is the material's and not free, as elastic walls lose nothing."""
    loads = design.loads_in(options)
    pairs = design.forces_at(options, DEFAULT_AT[against]) if loads is None else []
    if against == RESONANCES:
        if len({resonance for resonance, _ in pairs}) != 2:
            raise ParameterError(
                f"--at = {pairs} is not allowed: with --against {RESONANCES} two resonances"
            )
        objectives = tuple(
            Objective(resonance=resonance)
            for resonance in sorted({resonance for resonance, _ in pairs})
        )
    else:
        objectives = (Objective(), Objective("severity"))
        options["free"] = options["free"] or (GAP, FRICTION_LIMIT)
    options["members"] = options["members"] or (QUICK_MEMBERS if options["quick"] else MEMBERS)
    return design.make_problem(
        IMPACT,
        design.make_conditions(
            design.make_space(IMPACT, options), design.structure_of(options), pairs
        )
        if loads is None
        else design.load_conditions(loads),
        objectives,
        options,
    )


def study(
    problem: Problem, options: dict[str, Any], journal: Path, executor: Executor
) -> fronts.Front:
    """Search, judge and compare; what a Ctrl-C breaks off is left out."""
    designs = options["designs"] or (QUICK_DESIGNS if options["quick"] else DESIGNS)
    settings = default_settings(problem, options["sampler"], options["batch"], options["seed"])
    check_study_file(journal)
    announce_search(
        problem,
        designs * (1 + 2 * options["random_seeds"]),
        options["threads"],
        options["cluster"],
        executor,
    )
    front = fronts.search_front(
        problem, settings, designs, CORNERS[options["against"]], journal, executor
    )
    if front.finished and front.index:
        front = fronts.front_service_loads(fronts.judge_front(front, executor), executor)
        front = (
            fronts.compare_with_random(front, settings, options["random_seeds"], executor)
            if options["random_seeds"]
            else front
        )
    return front


def write(out: Path, front: fronts.Front, options: dict[str, Any]) -> list[Path]:
    """Write the tables and figures of a front, and return the files."""
    summary = design.conditions_of(options) | front_summary(front)
    files = write_files({out / "front.csv": front_table(front), out / "summary.json": summary})
    if front.fresh and front.paper is not None:
        labels = [o.label for o in front.problem.objectives]
        searched, front_designs = (
            np.array([e.score.values for e in part]) for part in (front.evaluated, front.members)
        )
        fresh = np.array([j.score.values for j in front.fresh])
        paper = np.array(front.paper.score.values)
        files.append(out / "front.png")
        save_front(
            files[-1],
            (labels[0], labels[1]),
            searched,
            front_designs,
            fresh,
            paper,
            bounds_of(front),
        )
    return files + write_card(out, front_card(front))


@command(epilog=design.variables_help())
@click.option(
    "--against",
    type=click.Choice([RESONANCES, SEVERITY]),
    default=RESONANCES,
    show_default=True,
    help="What is traded against what.",
)
@click.option("--at", multiple=True, type=design.At(), help=AT_HELP)
@click.option(
    "--designs",
    type=click.IntRange(min=2),
    help=f"Designs to search, rounded up to whole batches.  [default: {DESIGNS}]",
)
@click.option(
    "--sampler",
    type=click.Choice([name for name in SAMPLERS if name != CMA]),
    help="Method.  [default: nsga2]",
)
@click.option(
    "--random-seeds",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Compare with random search, with this many seeds.",
)
@design.study_option
@out_option("results/pareto", "Folder; each choice of --against has one in it.")
@design.shared_options
def main(**options: Any) -> None:
    """Search a Pareto front of impact absorbers: first against second resonance, or response level against impact severity.

    Writes front.png, front.csv (every design) and summary.json, and prints the front. Ctrl-C ends the search; the same command goes
    on from there.
    """
    if options["load"] is not None and not is_option_set("against"):
        options["against"] = SEVERITY
    out = options["out"] / options["against"]
    with plain_errors(design.BROKEN_OFF):
        if options["against"] == RESONANCES:
            refuse_with_load(
                options["load"],
                "against",
                why=f"loads are met as they are; {SEVERITY} goes with it",
            )
        require_writable("--out", out)
        problem = make(options["against"], options)
        with executor_on(options["threads"], options["cluster"]) as executor:
            front = study(problem, options, design.journal_of(options, out), executor)
        click.echo(front_text(front))
        files = write(out, front, options)
    name_files(files)
    end_early(front.finished, design.GOES_ON)
    end_without(bool(front.index))
