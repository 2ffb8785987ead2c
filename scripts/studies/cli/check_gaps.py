"""Put the answers of design_gap to the test on twenty structures and ten drawn ones, beside fine scans over the gap."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from impact_env import CoulombFriction, Scene, SlidingAbsorber
from impact_env.curve import CurveCase, performance_curves
from impact_env.drive import PAPER_RATE
from impact_env.ensemble import Executor
from optimisation.bounds import expected_gap
from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, workers
from optimisation.gap_advice import FASTER, MEMBERS, TOLERANCE, Advice, advise
from optimisation.gap_check import scaled_absorber
from optimisation.machine import sources
from studies.structures import CASES, DRAWN, Case
from studies.study import (
    Array,
    Json,
    Measured,
    Study,
    lines,
    rows_part,
    run,
    table_options,
    table_place,
    there,
)

FORCE = 1.0  # N; it does not matter, as gap and friction are in proportion to it
# of ln (gap over the rule's); half a step off the gaps that a search tries
STEP = 0.05
FROM = -1.225
TO = 1.1
# gaps are run in full where a look is within this of the lowest, and so many beside
WITHIN = 1.5
BESIDE = 2
# members by which the scan's lowest gap is judged anew, and their seed
FRESH = 12
UNSEEN = 1


class GapSettings(NamedTuple):
    """The cases, runs for each gap, the scan's step of ln gap, the sweeps' rate (None: the default), and runs that judge (None: the search's)."""

    cases: tuple[Case, ...]
    members: int = MEMBERS
    step: float = STEP
    rate: float | None = None
    judges: int | None = None
    threads: int | None = None
    executor: Executor | None = None


def row(case: Case, given: GapSettings) -> list[Json]:
    """Return a case's one row; raises KeyboardInterrupt if it is stopped."""
    model = case.model()
    absorber = scaled_absorber(model, FORCE, case.resonance, case.mass_ratio)
    where: Json = {"threads": given.threads, "executor": given.executor}
    found = advise(
        model,
        FORCE,
        case.resonance,
        absorber,
        members=given.members,
        percent_per_100_periods=given.rate,
        **where,
    )
    if not found.complete or found.sharp is None or found.recommended is None:
        raise KeyboardInterrupt
    check = found.check
    fit = float(expected_gap(model, check.mass, FORCE, case.resonance))
    best = found.recommended.gap  # and what it is under more and less force
    told = np.log(
        np.array(
            [found.sharp.gap, best / (1 + TOLERANCE), best, best / (1 - TOLERANCE), check.rule, fit]
        )
        / check.rule
    )
    grid = np.arange(FROM, TO, given.step)
    own = {
        told[0]: found.sharp.absorber,
        told[2]: found.recommended.absorber,
    }  # the very devices: runs part from those of other last digits

    def levels(
        at: Sequence[float] | Array, number: int, speed: float, first: int = 0, seed: int = 0
    ) -> Array:
        scenes = [
            Scene(model, own[x] if x in own else scaled(check.absorber, float(np.exp(x))))
            for x in at
        ]
        cases = [
            CurveCase(scene, np.array([FORCE]), case.resonance, check.limits, speed)
            for scene in scenes
        ]
        curves = performance_curves(cases, number, seed, **where)
        if not all(curve.complete for curve in curves):
            raise KeyboardInterrupt
        return np.array([np.median(curve.combined[0, first:]) for curve in curves])

    looked = levels(grid, 1, min(PAPER_RATE, FASTER * check.rate))
    near = grid[
        np.convolve(looked <= WITHIN * looked.min(), np.ones(2 * BESIDE + 1), "same") > 0
    ]  # and those beside
    at = np.union1d(near, told)
    full = levels(at, given.judges or given.members, check.rate)
    again = levels(
        [told[0], at[np.argmin(full)]], FRESH + 1, check.rate, 1, UNSEEN
    )  # the first member of all ensembles is one and the same run
    return [judged(case, found, at, full, fit / check.rule, float(again[0] / again[1]))]


def scaled(absorber: SlidingAbsorber, factor: float) -> SlidingAbsorber:
    """Return an absorber with a multiple of its gap and of its friction limit."""
    walls = absorber.walls
    friction = absorber.friction
    assert walls is not None
    return replace(
        absorber,
        walls=replace(walls, gap=walls.gap * factor),
        friction=None if friction is None else CoulombFriction(friction.limit * factor),
    )


def judged(
    case: Case, found: Advice, at: Array, full: Array, expected: float, fresh: float
) -> Json:
    """Return the row of medians ``full`` (m) at ``at``, ln of gaps over the rule's, rising. Its levels are medians over the lowest of the scan.

    ``recommended`` is the worst over the tolerance, over the lowest such. ``fresh``: the level of `sharp` over that at the scan's lowest gap, both
    with members that neither was chosen by. ``best`` is the best gap over the rule's; ``rule``, ``expected``: the levels at the rule's gap and at
    the fit of `expected_gap`. ``relative``: the lowest level over that without absorber.
    """

    def between(x: Array | float) -> Array:
        beyond = np.maximum(np.asarray(x) - at[-1], 0.0)  # in proportion to the gap
        return np.asarray(np.exp(np.interp(x, at, np.log(full)) + beyond))

    shares = (1 - TOLERANCE, 1.0, 1 + TOLERANCE)
    inside = at[at - np.log1p(TOLERANCE) >= at[0]]
    worst = np.max([k * between(inside - np.log(k)) for k in shares], axis=0)
    sharp, robust = (
        np.log(there(answer).gap / found.check.rule) for answer in (found.sharp, found.recommended)
    )
    lowest = full.min()
    return {
        "name": case.name, "resonance": case.resonance, "damping": float(case.model().damping_ratio[case.resonance - 1]),
        "mass_ratio": case.mass_ratio, "reach": found.check.reach, "best": float(np.exp(at[np.argmin(full)])),
        "relative": float(lowest / found.check.without.median[0]), "sharp": float(between(sharp) / lowest), "fresh": fresh,
        "recommended": float(max(k * between(robust - np.log(k)) for k in shares) / worst.min()), "rule": float(between(0.0) / lowest),
        "expected": float(between(np.log(expected)) / lowest), "sweeps": found.sweeps, "gaps": len(at),
    }  # fmt: skip


# also the page's markers
NAME = "check_gaps"
HELD_OUT = "check_gaps_held_out"
QUICK_CASES = (12, 19)
QUICK_STEP = 0.2
TOLERATED = 1.1


def tables(measured: Measured) -> dict[str, str]:
    """Return a table of the cases beside which the search was made, and one of those drawn, as far as there are any."""
    found = measured.values["rows"]
    drawn = {case.name for case in DRAWN}
    parts = {
        name: [r for r in found if (r["name"] in drawn) is own]
        for name, own in ((NAME, False), (HELD_OUT, True))
    }
    return {name: _table(rows) for name, rows in parts.items() if rows}


def _table(found: list[Json]) -> str:
    """Return a line for each case, how many are good, and the worst."""
    columns = {
        "structure": "{name}",
        "resonance": "{resonance}",
        "damping, %": "{percent[0]:.3g}",
        "mass, %": "{percent[1]:g}",
        "reach": "{reach:.3g}",
        "best gap over rule's": "{best:.2f}",
        "level there, %": "{percent[2]:.1f}",
        "`sharp`": "{sharp:.2f}",
        "`sharp`, fresh": "{fresh:.2f}",
        "`recommended`": "{recommended:.2f}",
        **{name: f"{{{name}:.2f}}" for name in ("rule", "expected")},
        "sweeps": "{sweeps}",
    }
    table = lines(
        columns,
        (
            {**r, "percent": [100 * r[name] for name in ("damping", "mass_ratio", "relative")]}
            for r in found
        ),
    )
    words = []
    known = {
        "sharp": "`sharp`",
        "fresh": "`sharp` on fresh members",
        "recommended": "`recommended`",
        "rule": "the rule's gap",
    }
    for name, word in (known | {"expected": "the expected gap"}).items():
        worst = max(found, key=lambda r: float(r[name]))
        good = sum(r[name] <= TOLERATED for r in found)
        words.append(
            f"{word}: {good} of {len(found)}, worst {worst[name]:.2f} ({worst['name']}, resonance {worst['resonance']})"
        )
    return f"{table}\n\nWithin {TOLERATED:g} of the scan's lowest: {'; '.join(words)}."


def _said(measured: Measured) -> str:
    return "\n\n".join(tables(measured).values())


STUDY: Study[GapSettings] = Study(
    (
        rows_part(
            NAME,
            "the answers of design_gap beside fine scans",
            cases=lambda given: {
                (case.name, case.resonance, case.mass_ratio): partial(row, case, given)
                for case in given.cases
            },
            key=itemgetter("name", "resonance", "mass_ratio"),
            text=_said,
            told=lambda given: {
                "members": given.members,
                "step": given.step,
                "rate": given.rate,
                "judges": given.judges,
            },
            sections=lambda found: {
                name: f"{table}\n\n{sources(found.conditions)}"
                for name, table in tables(found).items()
            },
            said=_said,
        ),
    ),
    kept="with --json the same command goes on from here.",
)


@command()
@click.option("--quick", is_flag=True, help="A look: two structures, with a coarse scan.")
@click.option(
    "--members",
    type=click.IntRange(min=1),
    help="Runs for each gap.  [default: those of design_gap]",
)
@click.option(
    "--judges",
    type=click.IntRange(min=1),
    help="Runs for each gap by which all are judged.  [default: those of the search]",
)
@click.option(
    "--rate",
    type=float,
    help="Sweep rate in % per 100 pseudo periods.  [default: 1, less by the square of damping below 1 %]",
)
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Number of threads; the result does not depend on it.  [default: all cores]",
)
@cluster_option
@table_options(NAME, "docs/which_gap.md")
def main(
    quick: bool, cluster: str | None, target: Path | None, page: Path | None, **given: Any
) -> None:
    """Print, for twenty structures and ten drawn ones, what the answers of design_gap lose against a scan with gaps 5 % apart.

    A scan is judged by what each answer minimises. Ctrl-C prints, and writes, what is finished; with --json the same
    command goes on from there.
    """
    with plain_errors(), workers(given["threads"], cluster) as found:
        given |= {
            "members": given["members"] or MEMBERS,
            "threads": given["threads"] if found is None else None,
        }
        settings = GapSettings(
            tuple(CASES[k] for k in QUICK_CASES) if quick else CASES + DRAWN,
            step=QUICK_STEP if quick else STEP,
            executor=found,
            **given,
        )
        run(STUDY, settings, table_place(target, page))
