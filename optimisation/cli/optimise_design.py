"""Find the best design of a concept: search, judge again on fresh runs, and explain.

Impact absorbers are searched with a Gaussian process or CMA-ES, other concepts by SciPy; a study continues where it was broken off.
"""

# needs: optimise

from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from impact_env.ensemble import Executor, LaneProgress
from impact_env.parameters import ParameterError
from optimisation.answers.design import (
    QUICK_SIZES,
    DesignAnswer,
    ExplanationSizes,
    WinnerRuns,
    run_around_winner,
)
from optimisation.cli import design_options as design
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    check_target,
    command,
    end_early,
    end_without,
    file_option,
    name_files,
    out_option,
    plain_errors,
)
from optimisation.cli.design_duration import announce_search
from optimisation.executors import executor as executor_on
from optimisation.files import require_writable, write_files
from optimisation.frequency_levels import (
    ResonanceCurves,
)
from optimisation.objectives import KINDS, MEAN, OWN, WORST, Objective
from optimisation.problem import Problem
from optimisation.progress import runs_bar
from optimisation.report.frequency_report import (
    HISTORY_FORMATS,
    HISTORY_HELP,
    save_history,
)
from optimisation.search.find import BARS, SearchOptions, find
from optimisation.search.judge import AUDITED, SearchResult
from optimisation.search.run_cache import check_study_file
from optimisation.search.settings import GP, SAMPLERS, SCIPY, default_settings
from optimisation.search.smooth import MEMBERS as SMOOTH_MEMBERS
from optimisation.space import IMPACT, VARIABLES

ALL = "all"
DESIGNS = 400
QUICK_DESIGNS = 80
AT_HELP = "Resonance and force in N; may be repeated.  [default: 1:3.5 and 2:35, with --structure by the design rule]"
USUAL = ((1, 3.5), (2, 35.0))
SIZES = ExplanationSizes()


def searched_share(problem: Problem, plan: SearchOptions) -> float:
    """Return how many runs a design takes on average, over those with all members at the problem's rate: hopeless ones are left behind."""
    if plan.method(problem) == SCIPY:
        return min(SMOOTH_MEMBERS, problem.members) / problem.members
    sampler = plan.sampler if plan.sampler in SAMPLERS else None
    settings = default_settings(problem, sampler, plan.batch, plan.seed, plan.screening)
    return settings.members_a_design / problem.members


def run_concept(
    concept: str, options: dict[str, Any], executor: Executor, out: Path
) -> SearchResult:
    """Search a concept, write its files, and return the findings."""
    loads = design.loads_in(options)
    spread = options["objective"] == "range"
    conditions = (
        design.make_conditions(
            design.make_space(concept, options),
            design.structure_of(options),
            design.forces_at(options, USUAL),
            spread,
        )
        if loads is None
        else design.load_conditions(loads, spread)
    )
    objective = Objective(
        options["objective"], options["over"], options["quantile"], None, options["limit"]
    )
    problem = design.make_problem(concept, conditions, (objective,), options)
    designs = options["designs"] or (QUICK_DESIGNS if options["quick"] else DESIGNS)
    plan = SearchOptions(
        designs,
        options["sampler"],
        options["batch"],
        options["seed"],
        not options["no_screening"],
        options["from_scratch"],
        options["audit"],
    )
    journal = design.journal_of(options, out)
    check_study_file(journal)
    announce_search(
        problem,
        designs * searched_share(problem, plan),
        options["threads"],
        options["cluster"],
        executor,
    )
    findings = find(problem, plan, journal, executor, BARS)
    runs = WinnerRuns(findings)
    frequency: list[ResonanceCurves] = []
    run = None
    try:
        if not options["no_figures"]:

            def stage(label: str) -> AbstractContextManager[LaneProgress | None]:
                return runs_bar(f"{concept}: {label}")

            sizes = QUICK_SIZES if options["quick"] else SIZES
            findings = run_around_winner(findings, executor, sizes, stage)
            frequency = runs.frequency_levels(executor)
        if options["history"] is not None:
            run = runs.worst_run(executor)
    except KeyboardInterrupt:
        findings = replace(findings, finished=False)
    answer = DesignAnswer(findings, tuple(frequency), design.conditions_of(options))
    click.echo(str(answer))
    files = answer.save(out)
    if run is not None:
        files += write_files({options["history"]: partial(save_history, run=run)})
    name_files(files)
    click.echo()
    return findings


@command(epilog=design.variables_help())
@click.option(
    "--concept",
    type=click.Choice([*VARIABLES, ALL]),
    default=IMPACT,
    show_default=True,
    help="Kind of absorber.",
)
@click.option("--at", multiple=True, type=design.At(), help=AT_HELP)
@click.option(
    "--objective",
    default="level",
    show_default=True,
    help=f"What makes a design good: {', '.join(KINDS)}, or {OWN}.",
)
@click.option(
    "--over",
    type=click.Choice([WORST, MEAN]),
    default=WORST,
    show_default=True,
    help="How resonances and forces join.",
)
@click.option(
    "--quantile",
    type=float,
    default=0.5,
    show_default=True,
    help="Share of the members that meet or better the value.",
)
@click.option(
    "--limit", type=float, help="Relative level that the objective range must stay under."
)
@click.option(
    "--designs",
    type=click.IntRange(min=2),
    help=f"Designs to search, rounded up to whole batches.  [default: {DESIGNS}]",
)
@click.option(
    "--sampler",
    type=click.Choice([*SAMPLERS, SCIPY, GP]),
    help="Method.  [default: gp with walls, scipy without]",
)
@click.option("--from-scratch", is_flag=True, help="Do not begin with the paper's design.")
@click.option(
    "--no-screening",
    is_flag=True,
    help="Run every design in full instead of leaving hopeless ones behind.",
)
@click.option(
    "--audit",
    type=click.IntRange(min=0),
    default=AUDITED,
    show_default=True,
    help="Designs left behind to run in full all the same.",
)
@click.option("--no-figures", is_flag=True, help="Search and judge only.")
@file_option("--history", f"{HISTORY_HELP} Of the winner under the first of --at.")
@design.study_option
@out_option("results/optimise_design", "Folder; a concept has one in it.")
@design.shared_options
def main(**options: Any) -> None:
    """Find the best design of an absorber for one or more resonances and forces.

    Every design runs under all of them, up and down; the finalists run again on fresh members, and the winner on others, beside the paper's and
    the rule's design, with more modes, and in service (impacts, wear, heat, tolerances). Writes designs.csv, summary.json, the level over the
    frequency, and curves, map, detuned and sensitivity as figures and tables. Ctrl-C ends the search; the same command goes on from there.
    """
    concepts = list(VARIABLES) if options["concept"] == ALL else [options["concept"]]
    options["every"] = len(concepts) > 1
    results: list[SearchResult] = []
    with plain_errors(design.BROKEN_OFF):
        if options["every"] and options["study"] is not None:
            raise ParameterError(
                f"--study = {options['study']} is not allowed: with one concept, as each has a file of its own"
            )
        if options["every"] and options["history"] is not None:
            raise ParameterError(
                f"--history = {options['history']} is not allowed: with one concept, as each has a run of its own"
            )
        check_target("--history", options["history"], HISTORY_FORMATS)
        scenes.refuse_with_load(
            options["load"], "history", why="there levels are read from other measures"
        )
        with executor_on(options["threads"], options["cluster"]) as executor:
            for concept in concepts:
                out = options["out"] / concept
                require_writable("--out", out)
                results.append(run_concept(concept, options, executor, out))
                if not results[-1].finished:
                    break
    end_early(all(findings.finished for findings in results), design.GOES_ON)
    end_without(
        all(findings.verdict is not None and findings.verdict.feasible for findings in results)
    )
