"""Is there anything to choose in a passage? Level and score over the rate, for several scenes, and over the place of a slow window."""

# needs: env

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.envs.sweep_task import Passage
from optimisation.cli.common import command
from optimisation.page import DOCS, published
from optimisation.progress import Bar
from optimisation.report.markdown import markdown
from optimisation.report.policy_figures import save_tradeoff
from optimisation.rl.tradeoff import constant_rates, windows
from studies.runner import run
from studies.study import Json, Measured, Part, Place, Steps, Study

QUICK_OUT = Path("results/sweep_tradeoff")
OUT = published(DOCS, QUICK_OUT)
NAME = "sweep_tradeoff"
SEEDS, QUICK_SEEDS = 64, 8
RATES, QUICK_RATES = np.geomspace(0.0625, 8.0, 12), np.geomspace(0.25, 4.0, 3)
CENTRES = np.arange(0.94, 1.0101, 0.005)
WIDTH, SLOW = 0.02, (0.0625, 1.0)  # of the windows, and rates in % per 100 pseudo periods inside them
CASES: list[tuple[str, dict[str, Any]]] = [
    ("2 modes, 1.5 N, e = 1, muN = 0.025 N\n(the task's default)", {}),
    ("the same with e = 0.7", {"absorber_options": {"friction_limit": 0.025, "restitution": 0.7}}),
    ("3 modes, 2.5 N, e = 0.9, muN = 0.025 N", {"modes": 3, "force": 2.5, "absorber_options": {"friction_limit": 0.025, "restitution": 0.9}}),
]
DIRECTIONS = ("down", "up")


def columns(rows: list[dict[str, float]]) -> dict[str, list[float]]:
    """Return rows of the same names as columns."""
    return {name: [row[name] for row in rows] for name in rows[0]}


def _measure(quick: bool, _known: Json) -> Steps:
    """Play all cases; yield what the figure needs."""
    seeds, rates = range(QUICK_SEEDS if quick else SEEDS), (QUICK_RATES if quick else RATES).tolist()
    cases, centres = (CASES[:1], CENTRES[::7]) if quick else (CASES, CENTRES)
    result: dict[str, Any] = {"seeds": len(seeds), "cases": []}
    with Bar(total=len(cases) * 2 * len(rates) + 1 + len(SLOW) * len(centres), desc="playing", unit="point", leave=False) as bar:
        for title, arguments in cases:
            found = {d: columns(constant_rates(rates, seeds, {**arguments, "direction": d}, bar.update)) for d in DIRECTIONS}
            result["cases"].append({"title": title, "arguments": arguments, "rates": rates, "directions": found})
        fastest = constant_rates([Passage.rates[1]], seeds, {}, bar.update)[0]
        slowed = [columns(windows(centres.tolist(), WIDTH, slow, seeds, {}, bar.update)) for slow in SLOW]
    title = f"the default, slow in a window\nof {WIDTH:g}, else the fastest rate"
    result["windows"] = {"width": WIDTH, "title": title, "centre": centres.tolist(), "slow": SLOW, "found": slowed, "fastest": fastest}
    yield result


def table(result: dict[str, Any]) -> str:
    """Return the default task's table: constant rates down."""
    found = result["cases"][0]["directions"]["down"]
    rows = [
        (f"{rate:.3g}", f"{median:.2f}", f"{low:.2f} to {high:.2f}", f"{time:,.0f}", f"{score:.3f}")
        for rate, median, low, high, time, score in zip(
            *(found[name] for name in ("rate", "level_median", "level_low", "level_high", "time", "score")), strict=True
        )
    ]
    return markdown(("rate, %", "median level", "5 to 95 %", "pseudo periods", "mean score"), rows)


def unpack(_name: str, content: Json) -> Measured:
    """Return what the JSON file holds; raises KeyError if it is another's."""
    return Measured({name: content[name] for name in ("seeds", "cases", "windows")})


STUDY: Study[bool] = Study(
    (
        Part(
            NAME,
            "level and score over the rate",
            measure=_measure,
            markers=(),
            sections=lambda _: {},
            figures=lambda measured: {NAME: lambda path: save_tradeoff(path, measured.values)},
            said=lambda measured: table(measured.values),
        ),
    ),
    pack=lambda _name, measured: measured.values,
    unpack=unpack,
    kept="nothing is written.",
)


@command()
@click.option("--quick", is_flag=True, help=f"One scene, few rates and seeds, into {QUICK_OUT} unless told otherwise.")
@click.option("--redraw", is_flag=True, help="Draw the figure again from the JSON file in the folder; nothing is played.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder for sweep_tradeoff.json.gz and .png.  [default: docs, without a checkout {QUICK_OUT}]",
)
def main(quick: bool, redraw: bool, out: Path | None) -> None:
    """Measure levels and scores of passages over the rate and over the place of a slow window, and draw them."""
    run(STUDY, quick, Place(out or (QUICK_OUT if quick else OUT)), redraw=redraw)
