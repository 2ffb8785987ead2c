"""Put the answers of design_gap to the test on twenty structures and ten drawn ones, beside fine scans over the gap."""

from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import click

from optimisation.cli.common import command, plain_errors
from optimisation.executors import cluster_option, workers
from optimisation.gap_advice import MEMBERS
from optimisation.machine import sources
from studies.drawn import CASES as DRAWN
from studies.gaps import CASES, STEP, Settings, row
from studies.study import Json, Measured, Study, lines, rows_part, run, table_options, table_place

NAME, HELD_OUT = "check_gaps", "check_gaps_held_out"  # also the page's markers
QUICK_CASES, QUICK_STEP = (12, 19), 0.2
TOLERATED = 1.1


def tables(measured: Measured) -> dict[str, str]:
    """Return a table of the cases beside which the search was made, and one of those drawn, as far as there are any."""
    found, drawn = measured.values["rows"], {case.name for case in DRAWN}
    parts = {name: [r for r in found if (r["name"] in drawn) is own] for name, own in ((NAME, False), (HELD_OUT, True))}
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
    table = lines(columns, ({**r, "percent": [100 * r[name] for name in ("damping", "mass_ratio", "relative")]} for r in found))
    words = []
    known = {"sharp": "`sharp`", "fresh": "`sharp` on fresh members", "recommended": "`recommended`", "rule": "the rule's gap"}
    for name, word in (known | {"expected": "the expected gap"}).items():
        worst = max(found, key=lambda r: float(r[name]))
        good = sum(r[name] <= TOLERATED for r in found)
        words.append(f"{word}: {good} of {len(found)}, worst {worst[name]:.2f} ({worst['name']}, resonance {worst['resonance']})")
    return f"{table}\n\nWithin {TOLERATED:g} of the scan's lowest: {'; '.join(words)}."


def _said(measured: Measured) -> str:
    return "\n\n".join(tables(measured).values())


STUDY: Study[Settings] = Study(
    (
        rows_part(
            NAME,
            "the answers of design_gap beside fine scans",
            cases=lambda given: {(case.name, case.resonance, case.mass_ratio): partial(row, case, given) for case in given.cases},
            key=itemgetter("name", "resonance", "mass_ratio"),
            text=_said,
            told=lambda given: {"members": given.members, "step": given.step, "rate": given.rate, "judges": given.judges},
            sections=lambda found: {name: f"{table}\n\n{sources(found.conditions)}" for name, table in tables(found).items()},
            said=_said,
        ),
    ),
    kept="with --json the same command goes on from here.",
)


@command()
@click.option("--quick", is_flag=True, help="A look: two structures, with a coarse scan.")
@click.option("--members", type=click.IntRange(min=1), help="Runs for each gap.  [default: those of design_gap]")
@click.option("--judges", type=click.IntRange(min=1), help="Runs for each gap by which all are judged.  [default: those of the search]")
@click.option("--rate", type=float, help="Sweep rate in % per 100 pseudo periods.  [default: 1, less by the square of damping below 1 %]")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the result does not depend on it.  [default: all cores]")
@cluster_option
@table_options(NAME, "docs/which_gap.md")
def main(quick: bool, cluster: str | None, target: Path | None, page: Path | None, **given: Any) -> None:
    """Print, for twenty structures and ten drawn ones, what the answers of design_gap lose against a scan with gaps 5 % apart.

    A scan is judged by what each answer minimises. Ctrl-C prints, and writes, what is finished; with --json the same
    command goes on from there.
    """
    with plain_errors(), workers(given["threads"], cluster) as found:
        given |= {"members": given["members"] or MEMBERS, "threads": given["threads"] if found is None else None}
        settings = Settings(
            tuple(CASES[k] for k in QUICK_CASES) if quick else CASES + DRAWN, step=QUICK_STEP if quick else STEP, executor=found, **given
        )
        run(STUDY, settings, table_place(target, page))
