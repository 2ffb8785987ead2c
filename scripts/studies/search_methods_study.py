"""The comparison of searches: its files, its table and its page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from impact_env.ensemble import Executor
from optimisation.machine import sources
from optimisation.page import DOCS, published
from optimisation.report.markdown import markdown
from optimisation.search.bars import BARS
from studies import search_methods
from studies.search_methods import (
    DESIGNS,
    LABELS,
    MEMBERS,
    QUESTIONS,
    SEEDS,
    SPEED,
    Trial,
    as_json,
    from_json,
    standings,
    wanted,
    winner,
)
from studies.study import Json, Measured, Part, Steps, Study, rows_by_case

NAME = "search_methods"
QUICK_OUT = Path("results/search_methods")
OUT = published(DOCS, QUICK_OUT)
SECTION, MACHINE = "searches:levels", "searches:machine"
Key = tuple[str, str, int]


class Settings(NamedTuple):
    """What is searched, and how large: designs a search, members, seeds, ``speed`` times the usual rate of the sweeps; and where it runs."""

    questions: tuple[str, ...]
    designs: int
    members: int
    seeds: int
    speed: float
    executor: Executor

    @property
    def told(self) -> Json:
        """What the numbers depend on, as the file holds it."""
        own = self._asdict()
        return {name: own[name] for name in ("designs", "members", "seeds", "speed")} | {"questions": list(self.questions)}

    def keep(self, values: Json) -> Json:
        """Return what an earlier run has measured with the same settings."""
        return values if values["settings"] == self.told else {}

    def searches(self) -> list[Key]:
        """Return what tells all searches apart."""
        return list(wanted(self.questions, self.seeds))


FULL: dict[str, float] = {"designs": DESIGNS, "members": MEMBERS, "seeds": SEEDS, "speed": SPEED}
QUICK: dict[str, float] = {"designs": 40, "members": 4, "seeds": 2, "speed": 4.0}


def settings(quick: bool, questions: Sequence[str], executor: Executor) -> Settings:
    """Return how much to search; no question is all of them."""
    size = QUICK if quick else FULL
    designs, members, seeds = (int(size[name]) for name in ("designs", "members", "seeds"))
    return Settings(tuple(questions) or tuple(QUESTIONS), designs, members, seeds, size["speed"], executor)


def _run(key: Key, given: Settings) -> list[Json]:
    one = search_methods.trial(*key, given.designs, given.members, given.executor, given.speed, BARS)
    if one is None:
        raise KeyboardInterrupt
    return [as_json(one)]


def _measure(given: Settings, known: Json) -> Steps:
    cases: dict[Key, Callable[[], list[Json]]] = {key: partial(_run, key, given) for key in given.searches()}
    for values in rows_by_case(cases, lambda row: from_json(row).key, known):
        yield {"settings": given.told, **values}


def table(trials: Sequence[Trial]) -> str:
    """Return a line for each method on each question, and the best of them."""
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


def _table(measured: Measured) -> str:
    return table([from_json(row) for row in measured.values["rows"]])


def pack(_name: str, measured: Measured) -> Json:
    """Return what the JSON file holds."""
    own = measured.values
    return {"settings": own["settings"], "conditions": measured.conditions, "complete": measured.complete, "trials": own["rows"]}


def unpack(_name: str, content: Json) -> Measured:
    """Return what `pack` has packed; raises KeyError or TypeError if it was another."""
    rows = [as_json(from_json(row)) for row in content["trials"]]
    return Measured({"settings": content["settings"], "rows": rows}, {"wall_s": 0.0, **content["conditions"]}, bool(content.get("complete", True)))


STUDY: Study[Settings] = Study(
    (
        Part(
            NAME,
            "searches for the same cost",
            measure=_measure,
            markers=(SECTION, MACHINE),
            sections=lambda measured: {SECTION: _table(measured), MACHINE: sources(measured.conditions)},
            whole=lambda given, values: len(values["rows"]) == len(given.searches()),
            said=_table,
        ),
    ),
    pack=pack,
    unpack=unpack,
    kept="the same command goes on from here.",
)
