"""Compare searches for the same cost: CMA-ES, random search, a Gaussian process with replication and a dense map, over several seeds.

All methods search the same problems from scratch, over several seeds, each until it has cost as much: sweeps at the usual rate, of which the fast
ones of a screened design are parts. Then each hands on its finalists, of which fresh members choose one and others judge it (`judge.verdict`): what
counts is the judged level of the winner, and the seeds tell how far that is luck.
"""

# needs: optimise

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from impact_env.ensemble import Executor
from impact_env.parameters import Beam
from optimisation.cli.common import command, plain_errors
from optimisation.designs import design_space
from optimisation.executors import cluster_option, executor
from optimisation.machine import sources
from optimisation.objectives import Condition
from optimisation.page import DOCS, published
from optimisation.problem import Problem
from optimisation.search.find import BARS, Plan, find
from optimisation.search.noisy import MAP, NOISY, REPLICATED
from optimisation.search.settings import CMA, RANDOM, SAMPLERS
from optimisation.statistics import ratio_of_quantiles
from studies.study import (
    Json,
    Measurement,
    Study,
    format_table,
    make_rows_part,
    paths_beside_page,
    run,
)

METHODS = (CMA, RANDOM, REPLICATED, MAP)
LABELS = SAMPLERS | NOISY
# speed, times the usual rate of the sweeps: at 2 they show 0.97 of the stationary level without absorber, and take half the time
FULL: Json = {"designs": 160, "members": 8, "seeds": 5, "speed": 2.0}
QUICK: Json = {"designs": 40, "members": 4, "seeds": 2, "speed": 4.0}
# the paper's beam at its best operating points, alone and both, and a steel strip at its second
STEEL = Beam(
    length=1.2,
    bending_stiffness=210e9 * 0.04 * 0.008**3 / 12,
    mass_per_length=7850 * 0.04 * 0.008,
    force_position=0.25,
)  # 40 x 8 mm
QUESTIONS: dict[str, tuple[Beam, tuple[Condition, ...]]] = {
    "paper, first": (Beam(), (Condition(1, 3.5),)),
    "paper, both": (Beam(), (Condition(1, 3.5), Condition(2, 35.0))),
    "steel, second": (STEEL, (Condition(2, 5.0),)),
}


class Standing(NamedTuple):
    """A method on one question: judged levels of its winners over the seeds (rising), and their median over that of CMA-ES, in words."""

    question: str
    method: str
    levels: list[float]
    over_cma: str

    @property
    def median(self) -> float:
        """Median level."""
        return float(np.median(self.levels))


def standings(trials: Sequence[Json]) -> list[Standing]:
    """Return all methods on all questions, best median first within a question, of the rows of `trial`."""
    result = []
    for question in dict.fromkeys(t["question"] for t in trials):
        levels = {
            m: sorted(t["level"] for t in trials if (t["question"], t["method"]) == (question, m))
            for m in METHODS
        }
        over = {
            m: str(ratio_of_quantiles(own, levels[CMA])) if levels[CMA] else "-"
            for m, own in levels.items()
            if own
        }
        result += sorted(
            (Standing(question, m, levels[m], word) for m, word in over.items()),
            key=lambda row: row.median,
        )
    return result


def winner(rows: Sequence[Standing]) -> str:
    """Return the method with the least mean rank of its median level over the questions."""
    ranks: dict[str, list[int]] = {}
    for question in dict.fromkeys(row.question for row in rows):
        for rank, row in enumerate(row for row in rows if row.question == question):
            ranks.setdefault(row.method, []).append(rank)
    return min(ranks, key=lambda m: (float(np.mean(ranks[m])), METHODS.index(m)))


NAME = "search_methods"
QUICK_OUT = Path("results/search_methods")
OUT = published(DOCS, QUICK_OUT)
SECTION = "searches:levels"
MACHINE = "searches:machine"


class ComparisonSettings(NamedTuple):
    """What is searched, and how large: designs a search, members, seeds, ``speed`` times the usual rate of the sweeps; and where it runs."""

    executor: Executor
    questions: tuple[str, ...]
    designs: int
    members: int
    seeds: int
    speed: float

    @property
    def told(self) -> Json:
        """What the numbers depend on, as the file holds it."""
        return {name: x for name, x in self._asdict().items() if name != "executor"} | {
            "questions": list(self.questions)
        }


def trial(question: str, method: str, seed: int, settings: ComparisonSettings) -> list[Json]:
    """Return the one row of a search: the runs it made, what it ``thought`` of its winner, and the winner's ``level`` of fresh ``members``.

    Raises KeyboardInterrupt if one ended it, or no design came to its end.
    """
    beam, conditions = QUESTIONS[question]
    problem = Problem(
        design_space("impact"), conditions, beam=beam, members=settings.members, seed=seed
    )
    plan = Plan(settings.designs, method, seed=seed, from_scratch=True, audit=0, modes=False)
    result = find(
        replace(problem, rate=settings.speed * problem.rate), plan, None, settings.executor, BARS
    )
    if result.verdict is None or not result.finished:
        raise KeyboardInterrupt
    winner = result.verdict.winner
    thought = result.verdict.found.score.values[0]
    level = winner.score.values[0]
    members = winner.members[0].tolist()
    values = dict(winner.design.values)
    row = {
        "question": question,
        "method": method,
        "seed": seed,
        "runs": result.cost.runs,
        "thought": thought,
    }
    return [row | {"level": level, "members": members, "values": values}]


def _searches(settings: ComparisonSettings) -> dict[tuple[str, str, int], Callable[[], list[Json]]]:
    """Return all searches, seed by seed, so that a run that is stopped has all methods."""
    every = product(range(settings.seeds), settings.questions, METHODS)
    return {
        (question, method, seed): partial(trial, question, method, seed, settings)
        for seed, question, method in every
    }


def table(measured: Measurement) -> str:
    """Return a line for each method on each question, and the best of them."""
    result = standings(measured.values["rows"])
    columns = {
        "question": "{question}",
        "method": "{label}",
        "seeds": "{seeds}",
        "level of the winner, %: median": "{percent[0]:.1f}",
        "from": "{percent[1]:.1f}",
        "to": "{percent[2]:.1f}",
        "over CMA-ES (95 %)": "{over_cma}",
    }
    rows = []
    for row in result:
        percent = [100 * x for x in (row.median, row.levels[0], row.levels[-1])]
        rows.append(
            {
                **row._asdict(),
                "label": LABELS[row.method],
                "seeds": len(row.levels),
                "percent": percent,
            }
        )
    return f"{format_table(columns, rows)}\n\nLeast mean rank: {LABELS[winner(result)]}."


STUDY: Study[ComparisonSettings] = Study(
    (
        make_rows_part(
            NAME,
            "searches for the same cost",
            cases=_searches,
            key=itemgetter("question", "method", "seed"),
            text=table,
            told=lambda settings: {"settings": settings.told},
            steps=None,
            markers=(SECTION, MACHINE),
            sections=lambda measured: {
                SECTION: table(measured),
                MACHINE: sources(measured.conditions),
            },
            said=table,
        ),
    ),
    kept="the same command goes on from here.",
)


@command()
@click.option(
    "--quick", is_flag=True, help="A look: 40 designs, 4 members, 2 seeds, sweeps 4 times as fast."
)
@click.option(
    "--question",
    multiple=True,
    type=click.Choice(list(QUESTIONS)),
    help="What is searched; may be repeated.  [default: all]",
)
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Number of threads; the result does not depend on it.  [default: all cores]",
)
@cluster_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder.  [default: docs, with --quick {QUICK_OUT}]",
)
@click.option(
    "--redraw",
    is_flag=True,
    help="Write the page again from the numbers in the folder; nothing is computed.",
)
def main(
    quick: bool,
    question: tuple[str, ...],
    threads: int | None,
    cluster: str | None,
    out: Path | None,
    redraw: bool,
) -> None:
    """Search with each method from scratch over several seeds, and judge the winners on fresh members.

    Writes search_methods.json.gz and the page search_methods.md. Ctrl-C keeps what is finished: the same command goes on from there.
    """
    with plain_errors(), executor(threads, None if redraw else cluster) as where:
        settings = ComparisonSettings(
            where, question or tuple(QUESTIONS), **(QUICK if quick else FULL)
        )
        run(
            STUDY,
            settings,
            paths_beside_page(out or (QUICK_OUT if quick else OUT), NAME),
            redraw=redraw,
        )
