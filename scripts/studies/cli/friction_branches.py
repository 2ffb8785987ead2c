"""Print the effect of friction on the levels and branches of the paper's absorber.

The members have 1, 0.5 and 0.2 % damping.

On the paper's beam at 3.5 N near the first resonance, the paper's absorber otherwise; with less
damping also a gap 1.4 times the rule's, where the rule's is too narrow (docs/gap_method.md). Levels
are those of fresh members, relative to no absorber.
"""

from functools import partial
from operator import itemgetter
from typing import NamedTuple

import click
import numpy as np

from impact_env.curve import BAND
from impact_env.drive import PAPER_DAMPING
from impact_env.ensemble import Executor
from impact_env.parameters import Beam
from optimisation.cli.common import cluster_option, command, threads_option
from optimisation.executors import executor, runs_bar
from optimisation.insight import REPORT_SEEDS
from optimisation.measures import branches
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.search.judge import judge_designs
from optimisation.space import FRICTION_LIMIT, GAP, IMPACT, Design, design_space
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_table_options,
    format_table,
    make_rows_study,
    run,
)

LIMITS = (0.0, 0.002, 0.0125, 0.06, 0.1)  # N
CASES = (
    (0.01, 1.0),
    (0.005, 1.0),
    (0.005, 1.4),
    (0.002, 1.4),
)  # damping ratio, and gap over the rule's
FORCE = 3.5
NAME = "friction_branches"
MEMBERS = 32  # at the paper's damping


class BranchSettings(NamedTuple):
    """Settings of the study.

    ``members`` are the runs for each point at the paper's damping, ``cases`` those of `CASES`.
    """

    members: int
    cases: tuple[tuple[float, float], ...]
    executor: Executor


def _rows(damping: float, factor: float, settings: BranchSettings) -> list[Json]:
    """Return relative levels and branches of the members for each friction limit of `LIMITS`.

    Levels are relative to those without absorber: median and 5 to 95 % of the members.

    On the paper's beam with another damping, and a gap ``factor`` times the rule's. There are fewer
    members at less damping, whose sweeps take longer by its square, but a quarter at least.
    """
    members = max(1, round(settings.members * min(1.0, max(0.25, damping / PAPER_DAMPING))))
    result = []
    problem = Problem(
        design_space(IMPACT),
        (Condition(1, FORCE),),
        beam=Beam(damping_ratio=damping),
        members=members,
    )
    start = problem.space.default.values
    designs = [
        Design(IMPACT, {**start, GAP: factor * start[GAP], FRICTION_LIMIT: limit})
        for limit in LIMITS
    ]
    with runs_bar(f"damping {100 * damping:g} %, gap {factor:g}") as show:
        levels = judge_designs(
            problem, designs, problem.fresh_ensemble(members, REPORT_SEEDS), settings.executor, show
        )
    for limit, one in zip(LIMITS, levels, strict=True):
        low, median, high = (float(x) for x in np.quantile(one.members[0], (BAND[0], 0.5, BAND[1])))
        apart = branches(one.members[0])
        result.append(
            {
                "damping_ratio": damping,
                "gap_over_rule": factor,
                "members": members,
                "friction_limit_n": limit,
                "relative_median": median,
                "relative_5_to_95_percent": [low, high],
                "branches": "one" if apart is None else apart.text(100, " %"),
            }
        )
    return result


def table(measured: Measurement) -> str:
    """Return a line for each friction limit of each case."""
    result = measured.values["rows"]
    columns = {
        "damping, %": "{damping:g}",
        "gap over rule's": "{gap_over_rule:g}",
        "muN, N": "{friction_limit_n:g}",
        "level, %": "{level[0]:.1f}",
        "5 to 95 %": "{level[1]:.1f} to {level[2]:.1f}",
        "branches": "{branches}",
        "members": "{members}",
    }
    levels = (
        [100 * x for x in (row["relative_median"], *row["relative_5_to_95_percent"])]
        for row in result
    )
    return format_table(
        columns,
        (
            {**row, "damping": 100 * row["damping_ratio"], "level": level}
            for row, level in zip(result, levels, strict=True)
        ),
    )


STUDY: Study[BranchSettings] = make_rows_study(
    NAME,
    "friction and branches",
    cases=lambda settings: {case: partial(_rows, *case, settings) for case in settings.cases},
    key=itemgetter("damping_ratio", "gap_over_rule"),
    text=table,
    key_values=lambda settings: {"members": settings.members},
    steps=None,
)


@command()
@click.option("--quick", is_flag=True, help="A look: the paper's damping only.")
@click.option(
    "--members",
    type=click.IntRange(min=1),
    default=MEMBERS,
    show_default=True,
    help="Runs for each point at 1 %; half and a quarter at less.",
)
@threads_option
@cluster_option
@add_table_options(NAME, "docs/findings.md")
def main(
    quick: bool,
    members: int,
    threads: int | None,
    cluster: str | None,
    place: OutputPaths,
) -> None:
    """Print the table of docs/findings.md on friction.

    The sweeps are slower for less damping, so 0.2 % takes longest.

    Ctrl-C prints, and writes, what is finished; with --json the same command goes on from there.
    """
    with executor(threads, cluster) as where:
        settings = BranchSettings(members, CASES[:1] if quick else CASES, where)
        run(STUDY, settings, place)
