"""Trade two aims of one absorber against each other: Pareto fronts of first against second resonance, or level against impact severity.

The front is searched by NSGA-II, run again on fresh members, and drawn with the paper's design and the limit.
"""

# needs: optimise, cluster

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from _command_line import BadInput
from _design_options import (
    INTERRUPTED,
    At,
    conditions_of,
    executor_of,
    journal_of,
    make_conditions,
    make_problem,
    runs_bar,
    shared_options,
    study_bar,
    variables_help,
)
from numpy.typing import NDArray

from impact_env.parameters import ParameterError
from optimisation.designs import FRICTION_LIMIT, GAP, IMPACT
from optimisation.evaluation import Executor
from optimisation.files import replacing, require_writable, write_csv, write_json
from optimisation.measures import LEVEL
from optimisation.objectives import Objective
from optimisation.problem import Problem
from optimisation.report.design_tables import Cost, limit
from optimisation.report.front_tables import Front, costs, front_columns, front_rows, front_summary, front_text
from optimisation.search.front import hypervolume, nondominated
from optimisation.search.judge import judged
from optimisation.search.samplers import CMA, NSGA2, RANDOM, SAMPLERS
from optimisation.search.settings import default_settings
from optimisation.search.study import DesignStudy, opened

RESONANCES, SEVERITY = "resonances", "severity"
DESIGNS, QUICK_DESIGNS = 300, 100
MEMBERS, QUICK_MEMBERS = 4, 2
# forces in N: each the design force of its resonance for one gap would leave nothing to trade
DEFAULT_AT = {RESONANCES: ((1, 3.5), (2, 15.0)), SEVERITY: ((1, 3.5),)}
SEVEREST = 0.1  # W: a corner for hypervolumes
CORNERS = {RESONANCES: (1.1, 1.1), SEVERITY: (1.1, SEVEREST)}


def make(against: str, given: dict[str, Any]) -> Problem:
    """Return the problem; where severity counts, the restitution is the material's and not free, as elastic walls lose nothing."""
    pairs = list(given["at"]) or list(DEFAULT_AT[against])
    if against == RESONANCES:
        if len({resonance for resonance, _ in pairs}) != 2:
            raise ParameterError(f"--at = {pairs} is not allowed: with --against {RESONANCES} two resonances")
        objectives = tuple(Objective(resonance=resonance) for resonance in sorted({resonance for resonance, _ in pairs}))
    else:
        objectives = (Objective(), Objective("severity"))
        given["free"] = given["free"] or (GAP, FRICTION_LIMIT)
    given["members"] = given["members"] or (QUICK_MEMBERS if given["quick"] else MEMBERS)
    return make_problem(IMPACT, make_conditions(IMPACT, pairs), objectives, given)


def volume(problem: Problem, study: DesignStudy, corner: tuple[float, float]) -> float:
    return hypervolume(costs(problem, study.told), corner)


def search(problem: Problem, given: dict[str, Any], journal: Path, executor: Executor) -> Front:
    designs = given["designs"] or (QUICK_DESIGNS if given["quick"] else DESIGNS)
    settings = default_settings(problem, given["sampler"], given["batch"], given["seed"])
    corner = CORNERS[given["against"]]
    with opened(problem, settings, journal) as study:
        with study_bar("search", settings.whole_batches(designs)) as show:
            finished = study.run(designs, executor, show)
        overhead = 1 - study.evaluating / study.seconds if study.runs else 0.0
        told = study.told
        cost = Cost(len(told), study.runs, study.seconds, overhead)
    rows = costs(problem, told)
    best = {tuple(rows[k]): int(k) for k in np.flatnonzero(nondominated(rows))[::-1] if np.isfinite(rows[k]).all()}  # NSGA-II repeats designs
    index = [best[values] for values in sorted(best)]
    return Front(problem, told, finished, cost, index, corner, hypervolume(rows, corner))


def judge(front: Front, executor: Executor) -> Front:
    problem = front.problem
    designs = [e.design for e in front.members]
    with runs_bar("front on fresh members") as show:
        *fresh, paper = judged(problem, [*designs, problem.space.default], problem.fresh_phases(2 * problem.members, 0), executor, show)
    return replace(front, fresh=fresh, paper=paper)


def compare(front: Front, given: dict[str, Any], executor: Executor) -> Front:
    """Search again with other seeds, by the method and at random, with the same budget; the members stay the same."""
    problem, wanted = front.problem, len(front.told)
    rows = []
    for seed in range(given["seed"], given["seed"] + given["random_seeds"]):
        found = []
        for sampler in (given["sampler"] or NSGA2, RANDOM):
            settings = default_settings(problem, sampler, given["batch"] or default_settings(problem, NSGA2).batch, seed)
            with opened(problem, settings) as study, study_bar(f"seed {seed}, {SAMPLERS[sampler]}", settings.whole_batches(wanted)) as show:
                if not study.run(wanted, executor, show):
                    return replace(front, against=tuple(rows), finished=False)
                found.append(volume(problem, study, front.corner))
        rows.append((seed, found[0], found[1]))
    return replace(front, against=tuple(rows))


def bounds_of(front: Front) -> NDArray[np.float64]:
    """Return the stationary limits of the designs on the front, (designs, 2), as relative levels; NaN where the closed form does not apply."""
    problem = front.problem
    without = problem.reference(problem.phases[:1], problem.rate)[0, :, :, problem.measures.index(LEVEL)].max(axis=1)
    rows = []
    for judge in front.fresh or []:
        relative = [limit(problem, judge.design, c) / float(w) for c, w in zip(problem.conditions, without, strict=True)]
        own = [
            max(relative[k] for k in o.chosen(problem.conditions)) if o.kind == "level" else x
            for o, x in zip(problem.objectives, judge.score.values, strict=True)
        ]
        rows.append(own)
    return np.array(rows)


def write(out: Path, front: Front, given: dict[str, Any]) -> list[Path]:
    from optimisation.report.design_figures import save_front  # matplotlib is slow to import

    files = [out / "front.csv", out / "summary.json"]
    write_csv(files[0], front_columns(front.problem), front_rows(front))
    write_json(files[1], conditions_of(given) | front_summary(front))
    if front.fresh and front.paper is not None:
        labels = [o.label for o in front.problem.objectives]
        searched, found = (np.array([e.score.values for e in part]) for part in (front.told, front.members))
        fresh, paper = np.array([j.score.values for j in front.fresh]), np.array(front.paper.score.values)
        files.append(out / "front.png")
        with replacing(files[-1]) as temporary:
            save_front(temporary, (labels[0], labels[1]), searched, found, fresh, paper, bounds_of(front))
    return files


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120}, epilog=variables_help())
@click.option("--against", type=click.Choice([RESONANCES, SEVERITY]), default=RESONANCES, show_default=True, help="What is traded against what.")
@click.option("--at", multiple=True, type=At(), help="Resonance and force in N; may be repeated.  [default: 1:3.5 and, for resonances, 2:15]")
@click.option("--designs", type=click.IntRange(min=2), help=f"Designs to search, rounded up to whole batches.  [default: {DESIGNS}]")
@click.option("--sampler", type=click.Choice([name for name in SAMPLERS if name != CMA]), help="Method.  [default: nsga2]")
@click.option("--random-seeds", type=click.IntRange(min=0), default=0, show_default=True, help="Compare with random search, with this many seeds.")
@click.option("--study", type=click.Path(path_type=Path, dir_okay=False), help="Study file.  [default: study.journal in the folder]")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("results/pareto"),
    show_default=True,
    help="Folder; each choice of --against has one in it.",
)
@shared_options
def main(**given: Any) -> None:
    """Search a Pareto front of impact absorbers: first against second resonance, or response level against impact severity.

    Writes front.png, front.csv (every design) and summary.json, and prints the front. Ctrl-C ends the search; the same command goes
    on from there.
    """
    out = given["out"] / given["against"]
    try:
        require_writable("--out", out)
        problem = make(given["against"], given)
        with executor_of(given) as executor:
            front = search(problem, given, journal_of(given["study"], out), executor)
            if front.finished and front.index:
                front = judge(front, executor)
                front = compare(front, given, executor) if given["random_seeds"] else front
        files = write(out, front, given)
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:  # while the front is judged or files are written
        click.echo("Broken off; the study keeps what is finished.", err=True)
        sys.exit(INTERRUPTED)
    click.echo(front_text(front))
    click.echo("written: " + ", ".join(str(file) for file in files))
    if not front.finished:
        click.echo("Stopped early: the same command goes on from here.", err=True)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
