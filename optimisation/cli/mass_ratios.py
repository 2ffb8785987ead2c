"""Tell the best gap over the design rule's for several masses of the absorber, by simulation."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from impact_env.drive import PAPER_LIMITS, default_rate
from impact_env.ensemble import Executor
from impact_env.modes import ModalModel
from impact_env.parameters import Beam
from impact_env.scene import Scene
from optimisation.absorber_rules import rigid_walls, scaled_absorber
from optimisation.bounds import reach
from optimisation.cli.common import (
    check_page,
    check_targets,
    command,
    file_option,
    fill_page,
    name_files,
    page_option,
    plain_errors,
    rate_option,
    threads_option,
)
from optimisation.cli.scene_options import (
    RESONANCES_HELP,
    model_of,
    read_device,
    scene_option,
    structure_option,
    warn_of_nodes,
)
from optimisation.comparison import RESONANCES
from optimisation.duration import COARSER, LONG_S, PlannedRuns, announce_coarse, announce_runs
from optimisation.executors import cluster_option, workers
from optimisation.extremes import usable_rate
from optimisation.files import write_files
from optimisation.frequency_levels import (
    NO_ABSORBER,
    ResonanceCurves,
    find_worst_run,
    resonance_curves,
)
from optimisation.gap_advice import GapCheck, check_gap
from optimisation.mounting import model_with_absorber_at
from optimisation.page import markdown
from optimisation.progress import runs_bar
from optimisation.report.frequency_report import save_frequency
from optimisation.sweep_range import find_reading_ratios, find_sweep_range, is_at_end

MARKER = "masses"
RATIOS = (0.01, 0.02, 0.05, 0.1)
FACTORS = 1.12 ** np.arange(-8, 5.0)  # of the rule's gap, 12 % apart, from 0.40 to 1.57
LOW_FACTORS = 1.12 ** np.arange(
    -8, 5.0
)  # of 0.6 times the free amplitude, where that is smaller than the rule's gap
FORCE = 1.0  # N: any would do, as gap and friction are in proportion to it


def gap_factors(free_over_rule: float) -> NDArray[np.float64]:
    """Return gaps over the rule's for the free amplitude over the rule's gap; the rule's own is one of them."""
    if free_over_rule >= 1:
        return FACTORS
    return np.union1d(0.6 * free_over_rule * LOW_FACTORS, 1.0)


def checks(
    model: ModalModel, ratios: Sequence[float], resonances: Sequence[int], options: dict[str, Any]
) -> list[GapCheck]:
    """Simulate the rule's gap and its neighbours for each mass ratio near each resonance, by mass; ``options`` are arguments of `check_gap`.

    Raises KeyboardInterrupt if it is stopped.
    """
    checks = []
    for ratio in ratios:
        for resonance in resonances:
            absorber = scaled_absorber(model, FORCE, resonance, ratio)
            with runs_bar(f"mass ratio {ratio:g}, resonance {resonance}") as show:
                check = check_gap(
                    model,
                    FORCE,
                    resonance,
                    absorber,
                    factors=gap_factors(reach(model, ratio * model.beam_mass, resonance)),
                    progress=show,
                    **options,
                )
            if not check.complete:
                raise KeyboardInterrupt
            checks.append(check)
    return checks


def announce(
    model: ModalModel, ratios: Sequence[float], resonances: Sequence[int], options: dict[str, Any]
) -> float:
    """Return about how long all runs take in s, and print it where it is long."""
    planned = []
    for resonance in resonances:
        rate = options["percent_per_100_periods"] or default_rate(model, (resonance,))
        for ratio in ratios:
            low, high = find_sweep_range(model, ratio, resonance)
            gaps = gap_factors(reach(model, ratio * model.beam_mass, resonance))
            scene = Scene(model, scaled_absorber(model, FORCE, resonance, ratio))
            number = 2 * len(gaps) * options["members"]
            periods = 1e4 * (high - low) / rate
            planned.append(PlannedRuns(scene, FORCE, resonance, periods, number))
    return announce_runs(planned, options["threads"])


def fast(model: ModalModel, resonance: int, options: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `check_gap` that differ for a coarse answer."""
    rate = options["percent_per_100_periods"] or default_rate(model, (resonance,))
    return {"members": 1, "percent_per_100_periods": COARSER * rate}


def _cells(check: GapCheck) -> tuple[str, ...]:
    best = check.best
    assert best is not None
    price = float(check.level[check.at_rule] / check.level[best])
    edge = " or less" if best == 0 else " or more" if best == len(check.gaps) - 1 else ""
    low, high = check.limits
    return (
        f"{100 * check.absorber.mass_ratio:g} %",
        str(check.resonance),
        f"{check.reach:.3g}",
        f"{check.gaps[best] / check.rule:.2f}{edge}",
        f"{100 * check.relative[best]:.1f}",
        f"{100 * check.relative[check.at_rule]:.1f}",
        f"{price:.2f}",
        f"{low:.3g} to {high:.3g}",
        _reading(check, best),
    )


def _reading(check: GapCheck, best: int) -> str:
    """Return where the level at the best gap was read, over the resonance; an end of the sweeps is named."""
    ratio = float(find_reading_ratios(check.curves[best])[0])
    return f"{ratio:.3f}{' (end)' if is_at_end(ratio, check.limits, check.rate) else ''}"


def text(every_check: Sequence[GapCheck]) -> str:
    """Return a line for each mass and resonance."""
    header = ("mass ratio", "resonance", "free amplitude over gap", "best gap over the rule's")
    return markdown(
        (
            *header,
            "level there, %",
            "level at the rule's, %",
            "rule's over best",
            "swept, of the resonance",
            "level read at",
        ),
        [_cells(check) for check in every_check],
    )


def frequency_of(
    every_check: Sequence[GapCheck], executor: Executor | None
) -> list[ResonanceCurves]:
    """Return the levels over the frequency near each resonance: of the worst member of each mass at its best gap, and without absorber."""
    parts = []
    for resonance in dict.fromkeys(check.resonance for check in every_check):
        own = [check for check in every_check if check.resonance == resonance]
        cases = {}
        for check in own:
            best = check.best
            assert best is not None
            walls = replace(rigid_walls(check.absorber), gap=float(check.gaps[best]))
            case = check.swept.curve_case(replace(check.absorber, walls=walls))
            member, _ = find_worst_run(check.curves[best])
            cases[f"{100 * check.absorber.mass_ratio:.4g} % of the mass"] = (case, member)
        cases[NO_ABSORBER] = (own[-1].swept.curve_case(None), 0)
        parts.append(resonance_curves(cases, own[0].without.members, executor))
    return parts


@command()
@structure_option
@scene_option
@click.option(
    "--resonances", type=(int, int), default=RESONANCES, show_default=True, help=RESONANCES_HELP
)
@click.option(
    "--mass-ratio",
    "ratios",
    type=float,
    multiple=True,
    help=f"Absorber mass over the structure's; may be repeated.  [default: {RATIOS}]",
)
@click.option(
    "--members",
    type=click.IntRange(min=1),
    default=4,
    show_default=True,
    help="Runs for each gap, other in phase and 1e-6 of force.",
)
@rate_option
@threads_option
@cluster_option
@file_option(
    "--plot",
    "Draw the level over the frequency with each mass at its best gap: .png, .pdf or .svg.",
)
@page_option(MARKER, "docs/which_gap.md")
def main(
    structure: Path | None,
    scene: Path | None,
    ratios: tuple[float, ...],
    cluster: str | None,
    page: Path | None,
    plot: Path | None,
    **options: Any,
) -> None:
    """Simulate gaps from 0.4 to 1.6 times the design rule's for several masses, near two resonances, and print the best of each.

    Where the free structure moves less than the rule's gap they are 0.24 to 0.94 times its amplitude.

    By the scaling law the force does not matter: gap and friction are in proportion to it. Levels are relative to no absorber, at its own place.
    """
    with plain_errors():
        check_page(page, MARKER)
        check_targets({"plot": plot})
        model = (
            model_of(structure, Beam.absorber_position)
            if scene is None
            else model_with_absorber_at(read_device(scene, "structure")[0])
        )
        options["percent_per_100_periods"] = options.pop("rate")
        if options["percent_per_100_periods"] is not None:
            options["percent_per_100_periods"] = usable_rate(
                "--rate", options["percent_per_100_periods"], [PAPER_LIMITS]
            )
        warn_of_nodes(model, *options["resonances"])
        resonances = tuple(dict.fromkeys(options.pop("resonances")))
        ratios = ratios or RATIOS
        with workers(options["threads"], cluster) as options["executor"]:
            if cluster is None and announce(model, ratios, resonances, options) > LONG_S:
                coarse = [
                    text(
                        checks(
                            model, ratios, (resonance,), options | fast(model, resonance, options)
                        )
                    )
                    for resonance in resonances
                ]
                announce_coarse("\n" + "\n".join(coarse))
            checks_made = checks(model, ratios, resonances, options)
            frequency = [] if plot is None else frequency_of(checks_made, options["executor"])
        table = text(checks_made)
        click.echo(table)
        files = fill_page(page, MARKER, table)
        if plot is not None:
            files += write_files({plot: partial(save_frequency, parts=frequency)})
    name_files(files)
