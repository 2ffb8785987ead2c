"""Find the best design of a concept: search, judge again on fresh runs, and explain.

Impact absorbers are searched with a Gaussian process or CMA-ES, other concepts by SciPy; a study continues where it was broken off.
"""

# needs: optimise

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.ensemble import Executor, Lane, run_lanes
from impact_env.parameters import ParameterError
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
from optimisation.designs import Design
from optimisation.executors import executor as executor_on
from optimisation.files import require_writable, write_files
from optimisation.frequency_levels import (
    NO_ABSORBER,
    ResonanceCurves,
    WorstRun,
    frequency_curve,
    record_lane,
)
from optimisation.insight import (
    DRAWS,
    FEW,
    REPORT_SEEDS,
    Levels,
    detuned,
    levels,
    over_force,
    sensitivity,
    service,
    varied,
    with_gaps,
)
from optimisation.objectives import KINDS, MEAN, OWN, WORST, Condition, Objective
from optimisation.problem import Problem
from optimisation.progress import runs_bar
from optimisation.report import design_tables as tables
from optimisation.report.card import write_card
from optimisation.report.cards import findings_card
from optimisation.report.design_figures import (
    save_curves,
    save_map,
    save_robustness,
    save_sensitivity,
)
from optimisation.report.frequency_report import (
    HISTORY_FORMATS,
    HISTORY_HELP,
    frequency_files,
    save_history,
)
from optimisation.search.find import BARS, SearchOptions, find
from optimisation.search.judge import AUDITED, SearchResult
from optimisation.search.run_cache import check_study_file
from optimisation.search.settings import FAST, GP, SAMPLERS, SCIPY, default_settings
from optimisation.search.smooth import MEMBERS as SMOOTH_MEMBERS
from optimisation.variables import GAP, IMPACT, VARIABLES

ALL = "all"
DESIGNS = 400
QUICK_DESIGNS = 80
AT_HELP = "Resonance and force in N; may be repeated.  [default: 1:3.5 and 2:35, with --structure by the design rule]"
USUAL = ((1, 3.5), (2, 35.0))
FORCES = 10
DETUNINGS = 9
MAP = 16
SOBOL = 64
QUICK_SOBOL = 16
QUICK_DRAWS = 8


def explain(findings: SearchResult, options: dict[str, Any], executor: Executor) -> SearchResult:
    """Run the winner in service, and what the figures show around it."""
    problem = findings.problem
    verdict = findings.verdict
    if verdict is None or not verdict.feasible or options["no_figures"] or not findings.finished:
        return findings
    name = problem.space.concept
    few = min(FEW, problem.members)
    if not problem.under_loads:  # its ranges and tolerances are those of a force
        with runs_bar(f"{name}: winner in service") as show:
            draws = QUICK_DRAWS if options["quick"] else DRAWS
            findings = replace(
                findings,
                service=service(problem, verdict.winner.design, executor, few, draws, show),
            )
    both = [verdict.winner.design, verdict.paper.design]
    main = main_conditions(findings)

    def run_levels(
        what: str,
        designs: list[Design],
        around: list[list[Condition]],
        members: int = few,
        rate: float | None = None,
    ) -> tuple[Levels, ...]:
        with runs_bar(f"{name}: {what}") as show:
            return tuple(
                levels(problem, designs, conditions, members, executor, show, rate)
                for conditions in around
            )

    grids = [
        [over_force(c, np.geomspace(c.force / 5, 5 * c.force, number)) for c in main]
        for number in (FORCES, MAP)
    ]
    findings = replace(findings, curves=run_levels("curves over the force", both, grids[0]))
    findings = replace(
        findings,
        detuned=run_levels(
            "detuned beams", both, [detuned(c, np.linspace(-0.1, 0.1, DETUNINGS)) for c in main]
        ),
    )
    if name == IMPACT:
        gap = verdict.winner.design.values[GAP]
        fast = problem.rate if options["quick"] else FAST * problem.rate
        gaps = np.geomspace(gap / 5, 5 * gap, MAP)
        gap_map = run_levels(
            "map over gap and force", with_gaps(verdict.winner.design, gaps), grids[1], 1, fast
        )
        findings = replace(findings, gap_map=gap_map, gaps=tuple(gaps.tolist()))
    if len(varied(problem.space)) > 1:
        samples = QUICK_SOBOL if options["quick"] else SOBOL
        with runs_bar(f"{name}: sensitivity") as show:
            findings = replace(
                findings,
                sensitivity=sensitivity(
                    problem, verdict.winner.design, samples, few, executor, progress=show
                ),
            )
    return findings


def lanes_under(
    findings: SearchResult, condition: Condition, design: Design | None, members: int
) -> list[Lane]:
    """Return the runs of a design, None without absorber, on fresh members under a condition; each member sweeps up and down."""
    problem = replace(findings.problem, conditions=(condition,), uncertain={})
    chunks = problem.chunks(design, problem.fresh_ensemble(members, REPORT_SEEDS), problem.rate)
    lanes = [lane for chunk in chunks for lane in chunk.lanes]
    if design is not None:
        return lanes
    drives = [replace(lane.drive, amplitude=condition.force) for lane in lanes]  # not one newton
    return [replace(lane, drive=drive) for lane, drive in zip(lanes, drives, strict=True)]


def main_conditions(findings: SearchResult) -> list[Condition]:
    """Return the middle condition of each resonance."""
    by_resonance: dict[int, list[Condition]] = {}
    for condition in findings.problem.conditions:
        by_resonance.setdefault(condition.resonance, []).append(condition)
    return [part[len(part) // 2] for part in by_resonance.values()]


def frequency_of(findings: SearchResult, executor: Executor) -> list[ResonanceCurves]:
    """Return the levels over the frequency of the winner, the highest of a few members, and without absorber, near each resonance."""
    problem = findings.problem
    verdict = findings.verdict
    if verdict is None or not verdict.feasible or problem.under_loads or not findings.finished:
        return []
    members = min(FEW, problem.members)
    curves = []
    for condition in main_conditions(findings):
        own = lanes_under(findings, condition, verdict.winner.design, members)
        without = lanes_under(findings, condition, None, 1)
        name = f"winner, highest of {members} members" if members > 1 else "winner"
        both = (
            frequency_curve(name, own, condition.limits, executor),
            frequency_curve(NO_ABSORBER, without, condition.limits, executor),
        )
        omega = own[0].drive.schedule.reference
        finished_curves = tuple(one for one in both if one is not None)
        curves.append(ResonanceCurves(condition.resonance, omega, condition.force, finished_curves))
    return curves


def worst_run(findings: SearchResult, executor: Executor) -> WorstRun | None:
    """Return the motion of the winner's run with the highest level under the first condition, of a few fresh members."""
    verdict = findings.verdict
    if verdict is None or not verdict.feasible or not findings.finished:
        return None
    members = min(FEW, findings.problem.members)
    condition = main_conditions(findings)[0]
    lanes = lanes_under(findings, condition, verdict.winner.design, members)
    levels = run_lanes(lanes, executor=executor)
    if not levels.complete:
        raise KeyboardInterrupt
    k = int(np.argmax(levels.level))
    return record_lane(lanes[k], k // 2, k % 2, condition.resonance)


def write(
    out: Path,
    findings: SearchResult,
    options: dict[str, Any],
    frequency: Sequence[ResonanceCurves] = (),
) -> list[Path]:
    """Write tables and figures of the findings, and return the files."""
    designs = tables.design_table(findings.problem, findings.evaluated)
    summary = design.conditions_of(options) | tables.summary(findings)
    contents: dict[Path | None, object] = {
        out / "designs.csv": designs,
        out / "summary.json": summary,
    }
    drawn = (
        ("curves", findings.curves, save_curves),
        ("detuned", findings.detuned, save_robustness),
        ("map", findings.gap_map, save_map),
    )
    for name, part, save in drawn:
        if part is not None:
            names, gaps = (
                ([], findings.gaps) if name == "map" else ((tables.WINNER, tables.PAPER), ())
            )
            contents[out / f"{name}.csv"] = tables.level_table(part, names, gaps)
            contents[out / f"{name}.png"] = partial(save, findings=findings)
    contents |= frequency_files(out, frequency)
    if findings.sensitivity is not None:
        contents[out / "sensitivity.png"] = partial(
            save_sensitivity, sensitivity=findings.sensitivity
        )
    return write_files(contents) + write_card(out, findings_card(findings, frequency))


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
    frequency: list[ResonanceCurves] = []
    run = None
    try:
        findings = explain(findings, options, executor)
        if not options["no_figures"]:
            frequency = frequency_of(findings, executor)
        if options["history"] is not None:
            run = worst_run(findings, executor)
    except KeyboardInterrupt:
        findings = replace(findings, finished=False)
    click.echo(tables.text(findings))
    files = write(out, findings, options, frequency)
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
