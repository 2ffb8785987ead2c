"""Pareto fronts of two aims of one absorber."""

# needs: optimise

from dataclasses import dataclass, replace
from pathlib import Path

import click

from impact_env.checks import ParameterError
from impact_env.ensemble import Executor
from optimisation.answers.design import FrontAnswer
from optimisation.checkpoint import check_study_file
from optimisation.cli import design_options as design
from optimisation.cli.common import (
    AnswerFiles,
    command,
    end_early,
    end_without,
    name_files,
    plain_errors,
)
from optimisation.cli.design_options import announce_search
from optimisation.cli.options import OptionSpec, at_least, number, option
from optimisation.cli.scene_options import SummaryOptions, is_option_set, refuse_with_load
from optimisation.executors import executor as executor_on
from optimisation.objectives import Objective
from optimisation.problem import Problem
from optimisation.search import pareto as fronts
from optimisation.search.settings import CMA, SAMPLERS, default_settings
from optimisation.space import FRICTION_LIMIT, GAP, IMPACT

RESONANCES = "resonances"
SEVERITY = "severity"
DESIGNS = 300
QUICK_DESIGNS = 100
FRONT_SAMPLERS = [name for name in SAMPLERS if name != CMA]
MEMBERS = 4
QUICK_MEMBERS = 2
DEFAULT_AT = {RESONANCES: fronts.FORCES, SEVERITY: ((1, 3.5),)}
SEVEREST = 0.1  # W: a corner for hypervolumes
CORNERS = {RESONANCES: fronts.CORNER, SEVERITY: (fronts.CORNER[0], SEVEREST)}


@dataclass(frozen=True, kw_only=True)
class FrontOptions(SummaryOptions, design.StudyOptions):
    """Options of ``design pareto``; None: not given."""

    against: str = option(
        OptionSpec(
            names=("--against",),
            help="First against second resonance, or level against impact severity",
            type=click.Choice([RESONANCES, SEVERITY]),
            metavar="AIM",
            default=RESONANCES,
            usual=True,
        )
    )
    at: tuple[tuple[int, float], ...] = option(
        "at",
        default_text="1:3.5 and, for resonances, 2:15; with --structure by the design rule",
    )
    designs: int | None = option("designs", default_text=str(DESIGNS))
    sampler: str | None = option(
        OptionSpec(
            names=("--sampler",),
            help=f"Method of the search: {', '.join(FRONT_SAMPLERS)}",
            type=click.Choice(FRONT_SAMPLERS),
            metavar="METHOD",
            default_text="nsga2",
        )
    )
    random_seeds: int = option(
        number(
            "--random-seeds",
            "Compare with random search, with this many seeds",
            type=at_least(0),
            default=0,
        )
    )
    out: Path = option(
        "out",
        more="Each choice of --against has a folder in it.",
        default=Path("results/design_pareto"),
    )


def make(against: str, options: FrontOptions) -> Problem:
    """Return the optimisation problem.

    If the impact severity is an objective, the restitution is that of the material and not free,
    because elastic walls dissipate nothing.
    """
    objectives: tuple[Objective, ...] = (Objective(), Objective("severity"))
    if against == SEVERITY:
        options = replace(options, free_by_default=(GAP, FRICTION_LIMIT))
    source = design.read_source(options)
    loads = design.loads_in(options, source)
    pairs = design.forces_at(options, source, DEFAULT_AT[against]) if loads is None else []
    if against == RESONANCES:
        resonances = sorted({resonance for resonance, _ in pairs})
        if len(resonances) != 2:
            raise ParameterError(
                f"--at = {pairs} is not allowed: with --against {RESONANCES} two resonances"
            )
        objectives = tuple(Objective(resonance=resonance) for resonance in resonances)
    members = options.members or (QUICK_MEMBERS if options.quick else MEMBERS)
    space = design.make_space(IMPACT, options, source)
    conditions = (
        design.make_conditions(space, source.structure, pairs)
        if loads is None
        else design.load_conditions(loads)
    )
    return design.make_problem(
        space, conditions, objectives, replace(options, members=members), source
    )


def study(
    problem: Problem, against: str, options: FrontOptions, journal: Path, executor: Executor
) -> fronts.Front:
    """Search, judge and compare; what a Ctrl-C breaks off is left out."""
    designs = options.designs or (QUICK_DESIGNS if options.quick else DESIGNS)
    settings = default_settings(problem, options.sampler, options.batch, options.seed)
    check_study_file(journal)
    announce_search(
        problem,
        designs * (1 + 2 * options.random_seeds),
        options.threads,
        options.cluster,
        executor,
    )
    front = fronts.search_front(problem, settings, designs, CORNERS[against], journal, executor)
    if front.finished and front.index:
        front = fronts.front_service_loads(fronts.judge_front(front, executor), executor)
        front = (
            fronts.compare_with_random(front, settings, options.random_seeds, executor)
            if options.random_seeds
            else front
        )
    return front


@command(
    FrontOptions,
    epilog=design.variables_help(),
    examples=(
        "design pareto --quick",
        "design pareto --against severity --at 1:3.5 --quick",
    ),
)
def main(options: FrontOptions) -> None:
    """Search a Pareto front of impact absorbers.

    The objectives are first against second resonance, or response level against impact severity.

    Writes front.png, front.csv (every design) and summary.json, and prints the front. Ctrl-C ends
    the search; the same command goes on from there.
    """
    against = options.against
    if options.load is not None and not is_option_set("against"):
        against = SEVERITY
    out = options.out / against
    with plain_errors(design.BROKEN_OFF):
        if against == RESONANCES:
            refuse_with_load(
                options.load,
                "against",
                why=f"loads are met as they are; {SEVERITY} goes with it",
            )
        targets = AnswerFiles(out, options.json)
        targets.check()
        problem = make(against, options)
        with executor_on(options.threads, options.cluster) as executor:
            front = study(problem, against, options, design.journal_of(options, out), executor)
        files = targets.write(FrontAnswer(front, design.conditions_of(options)))
    name_files(files)
    end_early(front.finished, design.GOES_ON)
    end_without(bool(front.index))
