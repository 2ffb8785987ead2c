"""The study of how good the answers of `design_gap` are: its numbers and its table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import NamedTuple

from impact_env.ensemble import Executor
from optimisation.gap_search import MEMBERS
from optimisation.machine import sources
from optimisation.report.markdown import markdown
from studies.gaps.scan import JUDGES, STEP, Row, row
from studies.gaps.structures import CASES, Case
from studies.study import Json, Measured, Part, Steps, Study, rows_by_case

NAME = "check_gaps"
QUICK_CASES, QUICK_STEP = (12, 19), 0.2
TOLERATED = 1.1


class Settings(NamedTuple):
    """The cases, runs for each gap, the scan's step of ln gap, the sweeps' rate (None: the default), and where."""

    cases: tuple[Case, ...]
    members: int = MEMBERS
    step: float = STEP
    rate: float | None = None
    threads: int | None = None
    executor: Executor | None = None

    @property
    def told(self) -> Json:
        """What the numbers depend on, as the file holds it."""
        return {"members": self.members, "step": self.step, "rate": self.rate}

    def keep(self, values: Json) -> Json:
        """Return what an earlier run has measured with the same settings."""
        return values if all(values.get(name) == value for name, value in self.told.items()) else {}


def _key(case: Case) -> tuple[str, int, float]:
    return case.name, case.resonance, case.mass_ratio


def _measure(given: Settings, known: Json) -> Steps:
    def measured(case: Case) -> list[Json]:
        return [asdict(row(case, given.members, given.step, given.rate, given.threads, given.executor))]

    cases: dict[tuple[str, int, float], Callable[[], list[Json]]] = {_key(case): partial(measured, case) for case in given.cases}
    for values in rows_by_case(cases, lambda found: (found["name"], found["resonance"], found["mass_ratio"]), known):
        yield {**given.told, **values}


def table(found: Sequence[Row]) -> str:
    """Return a line for each case, and what they say together."""
    header = ("structure", "resonance", "damping, %", "mass, %", "reach", "best gap over rule's", "level there, %")
    lines = [
        (
            r.name,
            str(r.resonance),
            f"{100 * r.damping:g}",
            f"{100 * r.mass_ratio:g}",
            f"{r.reach:.3g}",
            f"{r.best:.2f}",
            f"{100 * r.relative:.1f}",
            f"{r.sharp:.2f}",
            f"{r.recommended:.2f}",
            f"{r.rule:.2f}",
            f"{r.expected:.2f}",
            str(r.sweeps),
        )
        for r in found
    ]
    return markdown((*header, "`sharp`", "`recommended`", "rule", "expected", "sweeps"), lines)


def verdict(found: Sequence[Row]) -> str:
    """Return how many are good, and the worst."""
    said = []
    few = [sum(getattr(r, f"{name}_few") <= TOLERATED for r in found) for name in ("sharp", "recommended")]
    for name in ("sharp", "recommended", "rule", "expected"):
        worst = max(found, key=lambda r: getattr(r, name))
        good = sum(getattr(r, name) <= TOLERATED for r in found)
        word = f"`{name}`" if name in ("sharp", "recommended") else f"the {name}{chr(39) + 's' if name == 'rule' else ''} gap"
        said.append(f"{word}: {good} of {len(found)}, worst {getattr(worst, name):.2f} ({worst.name}, resonance {worst.resonance})")
    return (
        f"{JUDGES} members. Within {TOLERATED:g} of the scan's lowest: " + "; ".join(said) + f". On the search's own members: {few[0]} and {few[1]}."
    )


def _rows(measured: Measured) -> list[Row]:
    return [Row(**values) for values in measured.values["rows"]]


def said(measured: Measured) -> str:
    """Return table and verdict."""
    return f"{table(_rows(measured))}\n\n{verdict(_rows(measured))}"


STUDY: Study[Settings] = Study(
    (
        Part(
            NAME,
            "the answers of design_gap beside fine scans",
            measure=_measure,
            markers=(NAME,),
            sections=lambda found: {NAME: f"{said(found)}\n\n{sources(found.conditions)}"},
            steps=lambda given, known: len(given.cases) - len(known.get("rows", ())),
            whole=lambda given, values: len(values["rows"]) == len(given.cases),
            said=said,
        ),
    ),
    kept="with --json the same command goes on from here.",
)


def settings(quick: bool, members: int | None, rate: float | None, threads: int | None, executor: Executor | None) -> Settings:
    """Return what to run: all cases, or for a look two of them with a coarse scan."""
    cases = tuple(CASES[k] for k in QUICK_CASES) if quick else CASES
    return Settings(cases, members or MEMBERS, QUICK_STEP if quick else STEP, rate, threads, executor)
