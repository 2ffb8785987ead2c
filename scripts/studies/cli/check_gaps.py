"""Put the answers of design_gap to the test on twenty structures, beside fine scans over the gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click

from impact_env.ensemble import Executor
from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, workers
from optimisation.gap_search import MEMBERS
from optimisation.machine import sources
from studies.gaps import CASES, JUDGES, STEP, Case, Row, row
from studies.one_table import lines, table_options, table_place
from studies.runner import run
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


def _measure(given: Settings, known: Json) -> Steps:
    def measured(case: Case) -> list[Json]:
        return [asdict(row(case, given.members, given.step, given.rate, given.threads, given.executor))]

    cases: dict[tuple[str, int, float], Callable[[], list[Json]]] = {
        (case.name, case.resonance, case.mass_ratio): partial(measured, case) for case in given.cases
    }
    for values in rows_by_case(cases, lambda found: (found["name"], found["resonance"], found["mass_ratio"]), known):
        yield {**given.told, **values}


def said(measured: Measured) -> str:
    """Return a line for each case, how many are good, and the worst."""
    found = [Row(**values) for values in measured.values["rows"]]
    columns = {
        "structure": "{name}",
        "resonance": "{resonance}",
        "damping, %": "{percent[0]:g}",
        "mass, %": "{percent[1]:g}",
        "reach": "{reach:.3g}",
        "best gap over rule's": "{best:.2f}",
        "level there, %": "{percent[2]:.1f}",
        **{f"`{name}`": f"{{{name}:.2f}}" for name in ("sharp", "recommended")},
        **{name: f"{{{name}:.2f}}" for name in ("rule", "expected")},
        "sweeps": "{sweeps}",
    }
    table = lines(columns, ({**asdict(r), "percent": [100 * x for x in (r.damping, r.mass_ratio, r.relative)]} for r in found))
    words = []
    few = [sum(getattr(r, f"{name}_few") <= TOLERATED for r in found) for name in ("sharp", "recommended")]
    for name, word in (("sharp", "`sharp`"), ("recommended", "`recommended`"), ("rule", "the rule's gap"), ("expected", "the expected gap")):
        worst = max(found, key=lambda r: getattr(r, name))
        good = sum(getattr(r, name) <= TOLERATED for r in found)
        words.append(f"{word}: {good} of {len(found)}, worst {getattr(worst, name):.2f} ({worst.name}, resonance {worst.resonance})")
    own = f"On the search's own members: {few[0]} and {few[1]}."
    return f"{table}\n\n{JUDGES} members. Within {TOLERATED:g} of the scan's lowest: {'; '.join(words)}. {own}"


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


@command()
@click.option("--quick", is_flag=True, help="A look: two structures, with a coarse scan.")
@click.option("--members", type=click.IntRange(min=1), help="Runs for each gap.  [default: those of design_gap]")
@click.option("--rate", type=float, help="Sweep rate in % per 100 pseudo periods.  [default: 1, less by the square of damping below 1 %]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@table_options(NAME, "docs/which_gap.md")
def main(
    quick: bool, members: int | None, rate: float | None, threads: int | None, cluster: str | None, target: Path | None, page: Path | None
) -> None:
    """Print, for twenty beams, plates, frames and modal models, what the answers of design_gap lose against a scan with gaps 5 % apart.

    A scan has the same members, and is judged by what each answer minimises. Ctrl-C prints, and writes, what is finished; with --json the same
    command goes on from there.
    """
    with plain_errors(), workers(threads, cluster) as found:
        given = settings(quick, members, rate, threads if found is None else None, found)
        run(STUDY, given, table_place(target, page), keep=given.keep)
