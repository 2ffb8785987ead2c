"""Which search finds the best absorber for the same cost: CMA-ES, random search, a Gaussian process with replication, a dense map.

All methods search the same problems from scratch, over several seeds, each until it has cost as much: sweeps at the usual rate, of which the fast
ones of a screened design are parts. Then each hands on its finalists, of which fresh members choose one and others judge it (`judge.verdict`): what
counts is the judged level of the winner, and the seeds tell how far that is luck.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from impact_env.ensemble import Executor
from impact_env.parameters import Beam
from optimisation.designs import design_space
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.search.find import QUIET, Bars, Plan, find
from optimisation.search.noisy import MAP, NOISY, REPLICATED
from optimisation.search.settings import CMA, RANDOM, SAMPLERS
from optimisation.statistics import ratio_of_quantiles
from studies.rule import STRUCTURES

METHODS = (CMA, RANDOM, REPLICATED, MAP)
LABELS = SAMPLERS | NOISY
SEEDS, DESIGNS, MEMBERS = 5, 160, 8
SPEED = 2.0  # times the usual rate of the sweeps: they show 0.97 of the stationary level without absorber, and take half the time
# the paper's beam at its best operating points, alone and both, and a steel strip at its second
QUESTIONS: dict[str, tuple[Beam, tuple[Condition, ...]]] = {
    "paper, first": (STRUCTURES["paper"], (Condition(1, 3.5),)),
    "paper, both": (STRUCTURES["paper"], (Condition(1, 3.5), Condition(2, 35.0))),
    "steel, second": (STRUCTURES["steel"], (Condition(2, 5.0),)),
}


@dataclass(frozen=True)
class Trial:
    """One search: question, method and seed, the runs it made, what it thought of its winner, and the winner's ``level`` and fresh ``members``."""

    question: str
    method: str
    seed: int
    runs: int
    thought: float
    level: float
    members: tuple[float, ...]
    values: dict[str, float]

    @property
    def key(self) -> tuple[str, str, int]:
        """What no other trial shares."""
        return self.question, self.method, self.seed


def problem_of(question: str, members: int, seed: int, speed: float = 1.0) -> Problem:
    """Return a question's problem with the members of a seed; ``speed`` times the usual rate."""
    beam, conditions = QUESTIONS[question]
    problem = Problem(design_space("impact"), conditions, beam=beam, members=members, seed=seed)
    return replace(problem, rate=speed * problem.rate)


def trial(
    question: str, method: str, seed: int, designs: int, members: int, executor: Executor, speed: float = 1.0, bars: Bars = QUIET
) -> Trial | None:
    """Search and judge; None if a KeyboardInterrupt ended it, or no design came to its end."""
    problem = problem_of(question, members, seed, speed)
    plan = Plan(designs, method, seed=seed, from_scratch=True, audit=0, modes=False)
    found = find(problem, plan, None, executor, bars)
    if found.verdict is None or not found.finished:
        return None
    winner = found.verdict.winner
    thought = found.verdict.found.score.values[0]
    return Trial(
        question, method, seed, found.cost.runs, thought, winner.score.values[0], tuple(winner.members[0].tolist()), dict(winner.design.values)
    )


def wanted(questions: Sequence[str], seeds: int) -> Iterator[tuple[str, str, int]]:
    """Yield the keys of all trials, seed by seed, so that what is broken off has all methods."""
    for seed in range(seeds):
        for question in questions:
            for method in METHODS:
                yield question, method, seed


def as_json(found: Trial) -> dict[str, object]:
    """Return a trial as JSON values."""
    return asdict(found) | {"members": list(found.members)}


def from_json(values: dict[str, object]) -> Trial:
    """Return the trial that `as_json` gave."""
    return Trial(**{**values, "members": tuple(values["members"])})  # type: ignore[arg-type]


@dataclass(frozen=True)
class Standing:
    """A method on one question: judged levels of its winners over the seeds (rising), and their median over that of CMA-ES, in words."""

    question: str
    method: str
    levels: tuple[float, ...]
    over_cma: str


def standings(trials: Sequence[Trial]) -> list[Standing]:
    """Return all methods on all questions, best median first within a question."""
    found = []
    for question in dict.fromkeys(t.question for t in trials):
        levels = {m: sorted(t.level for t in trials if t.question == question and t.method == m) for m in METHODS}
        rows = [
            Standing(question, m, tuple(own), str(ratio_of_quantiles(own, levels[CMA])) if levels[CMA] else "-") for m, own in levels.items() if own
        ]
        found += sorted(rows, key=lambda row: float(np.median(row.levels)))
    return found


def winner(trials: Sequence[Trial]) -> str | None:
    """Return the method with the least mean rank of its median level over the questions; None without trials."""
    rows = standings(trials)
    ranks: dict[str, list[int]] = {}
    for question in dict.fromkeys(row.question for row in rows):
        for rank, row in enumerate(row for row in rows if row.question == question):
            ranks.setdefault(row.method, []).append(rank)
    return min(ranks, key=lambda m: (float(np.mean(ranks[m])), METHODS.index(m))) if ranks else None
