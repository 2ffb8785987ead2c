"""The best design of a kind of absorber, by search."""

# needs: optimise

from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

import click

from impact_env.checks import ParameterError
from impact_env.ensemble import Executor, LaneProgress
from optimisation.answers.design import (
    QUICK_SIZES,
    DesignAnswer,
    ExplanationSizes,
    WinnerRuns,
    run_around_winner,
    run_baselines,
)
from optimisation.checkpoint import check_study_file
from optimisation.cli import design_options as design
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    AnswerFiles,
    command,
    end_early,
    end_without,
    name_files,
    plain_errors,
)
from optimisation.cli.design_options import announce_search
from optimisation.cli.options import OptionSpec, at_least, number, option, switch
from optimisation.executors import executor as executor_on
from optimisation.executors import runs_bar
from optimisation.files import require_writable
from optimisation.frequency_levels import ResonanceCurves, WorstRun
from optimisation.objectives import KINDS, MEAN, OWN, WORST, Objective
from optimisation.problem import Problem
from optimisation.search.find import BARS, SearchOptions, find
from optimisation.search.find import MEMBERS as SMOOTH_MEMBERS
from optimisation.search.judge import AUDITED, SearchResult
from optimisation.search.settings import GP, SAMPLERS, SCIPY, default_settings
from optimisation.space import IMPACT, VARIABLES

ALL = "all"
DESIGNS = 400
QUICK_DESIGNS = 80
USUAL = ((1, 3.5), (2, 35.0))
SIZES = ExplanationSizes()


@dataclass(frozen=True, kw_only=True)
class SearchStudyOptions(design.StudyOptions):
    """Options of ``design search``; None: not given."""

    concept: str = option(
        OptionSpec(
            names=("--concept",),
            help=f"Kind of absorber: {', '.join([*VARIABLES, ALL])}",
            type=click.Choice([*VARIABLES, ALL]),
            metavar="KIND",
            default=IMPACT,
            usual=True,
            section="Absorber",
        )
    )
    at: tuple[tuple[int, float], ...] = option(
        "at", default_text="1:3.5 and 2:35, with --structure by the design rule"
    )
    objective: str = option(
        OptionSpec(
            names=("--objective",),
            help=f"What makes a design good: {', '.join(KINDS)}, or {OWN}",
            type=str,
            metavar="NAME",
            default="level",
            usual=True,
        )
    )
    combine: str = option(
        OptionSpec(
            names=("--combine",),
            help="How resonances and forces are combined",
            type=click.Choice([WORST, MEAN]),
            default=WORST,
            older=("--over",),
        )
    )
    quantile: float = option(
        number("--quantile", "Share of the members that meet or better the value", default=0.5)
    )
    limit: float | None = option(
        number("--limit", "Relative level that the objective range must stay under")
    )
    designs: int | None = option("designs", default_text=str(DESIGNS))
    sampler: str | None = option(
        OptionSpec(
            names=("--sampler",),
            help=f"Method of the search: {', '.join([*SAMPLERS, SCIPY, GP])}",
            type=click.Choice([*SAMPLERS, SCIPY, GP]),
            metavar="METHOD",
            default_text="gp with walls, scipy without",
        )
    )
    from_scratch: bool = option(switch("--from-scratch", "Do not begin with the paper's design"))
    no_screening: bool = option(
        switch(
            "--no-screening",
            "Run every design in full, also those that few runs rule out",
            section="Runs",
        )
    )
    audit: int = option(
        number(
            "--audit",
            "Designs ruled out by few runs that are run in full all the same",
            type=at_least(0),
            default=AUDITED,
            section="Runs",
        )
    )
    no_figures: bool = option(switch("--no-figures", "Search and judge only", section="Output"))
    history: Path | None = option(
        "history",
        help="Write or draw the motion of the winner's run with the highest level",
        more=".csv or .npz (every sample, SI units), or .png, .pdf, .svg. Under the first of --at.",
    )
    json: Path | None = option("json", help="Write the summary here, too; of one concept")
    out: Path = option(
        "out",
        help="Folder for figures and tables",
        more="A concept has a folder in it.",
        default=Path("results/design_search"),
    )


def searched_share(problem: Problem, plan: SearchOptions) -> float:
    """Return the mean number of runs of a design over the number with all members.

    The full number is that at the problem's rate. Designs that compare badly are abandoned early
    and need fewer runs.
    """
    if plan.method(problem) == SCIPY:
        return min(SMOOTH_MEMBERS, problem.members) / problem.members
    sampler = plan.sampler if plan.sampler in SAMPLERS else None
    settings = default_settings(problem, sampler, plan.batch, plan.seed, plan.screening)
    return settings.members_a_design / problem.members


def run_concept(
    concept: str, options: SearchStudyOptions, executor: Executor, out: Path
) -> SearchResult:
    """Search a concept, write its files, and return the findings."""
    source = design.read_source(options)
    loads = design.loads_in(options, source)
    spread = options.objective == "range"
    space = design.make_space(concept, options, source)
    conditions = (
        design.make_conditions(
            space, source.structure, design.forces_at(options, source, USUAL), spread
        )
        if loads is None
        else design.load_conditions(loads, spread)
    )
    objective = Objective(options.objective, options.combine, options.quantile, None, options.limit)
    problem = design.make_problem(space, conditions, (objective,), options, source)
    designs = options.designs or (QUICK_DESIGNS if options.quick else DESIGNS)
    plan = SearchOptions(
        designs,
        options.sampler,
        options.batch,
        options.seed,
        not options.no_screening,
        options.from_scratch,
        options.audit,
    )
    journal = design.journal_of(options, out)
    check_study_file(journal)
    announce_search(
        problem,
        designs * searched_share(problem, plan),
        options.threads,
        options.cluster,
        executor,
    )
    findings = find(problem, plan, journal, executor, BARS)
    runs = WinnerRuns(findings)
    frequency: list[ResonanceCurves] = []
    run: WorstRun | None = None
    try:
        if not options.no_figures:

            def stage(label: str) -> AbstractContextManager[LaneProgress | None]:
                return runs_bar(f"{concept}: {label}")

            sizes = QUICK_SIZES if options.quick else SIZES
            findings = run_around_winner(findings, executor, sizes, stage)
            frequency = runs.frequency_levels(executor)
        findings = run_baselines(findings, executor)
        if options.history is not None:
            run = runs.worst_run(executor)
    except KeyboardInterrupt:
        findings = replace(findings, finished=False)
    answer = DesignAnswer(findings, tuple(frequency), run, design.conditions_of(options))
    name_files(AnswerFiles(out, options.json, history=options.history).write(answer))
    click.echo()
    return findings


@command(
    SearchStudyOptions,
    epilog=design.variables_help(),
    examples=("design search --at 1:3.5 --free gap --quick", "design search --at 1:3.5 --at 2:35"),
)
def main(options: SearchStudyOptions) -> None:
    """Find the best design of an absorber for one or more resonances and forces.

    Every design runs under all of them, up and down; the finalists run again on fresh members, and
    the winner on others, beside the paper's and the rule's design, with more modes, and in service
    (impacts, wear, heat, tolerances). Writes designs.csv, summary.json, the level over the
    frequency, and curves, map, detuned and sensitivity as figures and tables. Ctrl-C ends the
    search; the same command goes on from there.
    """
    every = options.concept == ALL
    concepts = list(VARIABLES) if every else [options.concept]
    options = replace(options, every_concept=every)
    results: list[SearchResult] = []
    with plain_errors(design.BROKEN_OFF):
        own = {"study": "a file", "history": "a run", "json": "a summary"}
        for name, what in own.items():
            value = getattr(options, name)
            if every and value is not None:
                raise ParameterError(
                    f"--{name} = {value} is not allowed: with one concept, as each has {what} "
                    "of its own"
                )
        AnswerFiles(options.out, options.json, history=options.history).check()
        scenes.refuse_with_load(
            options.load, "history", why="there levels are read from other measures"
        )
        with executor_on(options.threads, options.cluster) as executor:
            for concept in concepts:
                out = options.out / concept
                require_writable("--out", out)
                results.append(run_concept(concept, options, executor, out))
                if not results[-1].finished:
                    break
    end_early(all(findings.finished for findings in results), design.GOES_ON)
    end_without(
        all(findings.verdict is not None and findings.verdict.feasible for findings in results)
    )
