"""Is there anything to choose in a passage? Level and score over the rate, for several scenes, and over the place of a slow window."""

# needs: env, rl

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from tqdm import tqdm

from impact_env.envs.sweep_task import Passage
from impact_env.parameters import ParameterError, require
from optimisation.command_line import BadInput
from optimisation.files import require_writable, write_json
from optimisation.report.markdown import markdown
from optimisation.report.policy_figures import save_tradeoff
from optimisation.rl.tradeoff import constant_rates, windows
from optimisation.studies.page import ROOT, published

QUICK_OUT = Path("results/sweep_tradeoff")
OUT = published(ROOT / "docs", QUICK_OUT)
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
INTERRUPTED = 130


def columns(rows: list[dict[str, float]]) -> dict[str, list[float]]:
    return {name: [row[name] for row in rows] for name in rows[0]}


def measure(quick: bool) -> dict[str, Any]:
    """Play all cases; return what the figure needs."""
    seeds, rates = range(QUICK_SEEDS if quick else SEEDS), (QUICK_RATES if quick else RATES).tolist()
    cases, centres = (CASES[:1], CENTRES[::7]) if quick else (CASES, CENTRES)
    result: dict[str, Any] = {"seeds": len(seeds), "cases": []}
    with tqdm(total=len(cases) * 2 * len(rates) + 1 + len(SLOW) * len(centres), desc="playing", unit="point", leave=False, disable=None) as bar:
        for title, arguments in cases:
            found = {d: columns(constant_rates(rates, seeds, {**arguments, "direction": d}, bar.update)) for d in DIRECTIONS}
            result["cases"].append({"title": title, "arguments": arguments, "rates": rates, "directions": found})
        fastest = constant_rates([Passage.rates[1]], seeds, {}, bar.update)[0]
        slowed = [columns(windows(centres.tolist(), WIDTH, slow, seeds, {}, bar.update)) for slow in SLOW]
    title = f"the default, slow in a window\nof {WIDTH:g}, else the fastest rate"
    result["windows"] = {"width": WIDTH, "title": title, "centre": centres.tolist(), "slow": SLOW, "found": slowed, "fastest": fastest}
    return result


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


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--quick", is_flag=True, help=f"One scene, few rates and seeds, into {QUICK_OUT} unless told otherwise.")
@click.option("--redraw", is_flag=True, help="Draw the figure again from the JSON file in the folder; nothing is played.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help=f"Folder for sweep_tradeoff.json and .png.  [default: docs, without a checkout {QUICK_OUT}]",
)
def main(quick: bool, redraw: bool, out: Path | None) -> None:
    """Measure levels and scores of passages over the rate and over the place of a slow window, and draw them."""
    folder = out or (QUICK_OUT if quick else OUT)
    stored = folder / f"{NAME}.json"
    try:
        require_writable("--out", folder)
        if redraw:
            require(stored.is_file(), "--redraw", str(stored), "a file that sweep_tradeoff has written")
            result = json.loads(stored.read_text(encoding="utf-8"))
        else:
            result = measure(quick)
            write_json(stored, result)
        save_tradeoff(folder / f"{NAME}.png", result)
    except ParameterError as error:
        raise BadInput(str(error)) from error
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    click.echo(table(result))


if __name__ == "__main__":
    main(prog_name="scripts/run sweep_tradeoff")
