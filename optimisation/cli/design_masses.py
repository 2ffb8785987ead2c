"""The best gap over the design rule's for several masses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from impact_env.drive import PAPER_LIMITS, default_rate
from impact_env.ensemble import Executor
from impact_env.modes import ModalModel
from impact_env.scene import Scene
from optimisation.absorber_rules import rigid_walls, scaled_absorber
from optimisation.bounds import reach
from optimisation.cli import scene_options as scenes
from optimisation.cli.common import (
    check_page,
    check_targets,
    command,
    fill_page,
    name_files,
    page_spec,
    plain_errors,
)
from optimisation.cli.options import option
from optimisation.comparison import RESONANCES
from optimisation.executors import (
    COARSER,
    LONG_S,
    PlannedRuns,
    announce_coarse,
    announce_runs,
    runs_bar,
    workers,
)
from optimisation.files import write_files
from optimisation.frequency_levels import (
    NO_ABSORBER,
    ResonanceCurves,
    find_worst_run,
    resonance_curves,
)
from optimisation.gap_advice import GapCheck, check_gap
from optimisation.report.frequency_report import frequency_charts
from optimisation.report.report import Column, Record, Table, draw_charts, write_drawing
from optimisation.sweep_range import find_reading_ratios, find_sweep_range, is_at_end, usable_rate

MARKER = "masses"
RATIOS = (0.01, 0.02, 0.05, 0.1)
FACTORS = 1.12 ** np.arange(-8, 5.0)  # of the rule's gap, 12 % apart, from 0.40 to 1.57
LOW_FACTORS = 1.12 ** np.arange(
    -8, 5.0
)  # of 0.6 times the free amplitude, where that is smaller than the rule's gap
FORCE = 1.0  # N: any would do, as gap and friction are in proportion to it


@dataclass(frozen=True, kw_only=True)
class MassesOptions(scenes.DeviceOptions):
    """Options of ``design masses``; None or empty: not given."""

    scene: Path | None = option("scene", help="Structure from the .toml or .json file of a scene")
    mass_ratio: tuple[float, ...] = option(
        "mass_ratio",
        help="Absorber mass over the structure's; may be repeated",
        default=None,
        default_text=", ".join(map(str, RATIOS)),
        multiple=True,
    )
    mass_kg: tuple[float, ...] = option(
        "mass_kg", help="Absorber mass in place of ratios; may be repeated", multiple=True
    )
    resonances: tuple[int, int] = option("resonances", default=RESONANCES)
    rate: float | None = option("rate", usual=True)
    members: int = option("members", default=4, usual=True)
    threads: int | None = option("threads")
    cluster: str | None = option("cluster")
    json: Path | None = option("json", help="Write the rows of the table")
    plot: Path | None = option(
        "plot", help="Draw the level over the frequency with each mass at its best gap"
    )
    page: Path | None = option(page_spec(MARKER, "docs/gap_method.md"))

    def arguments(self, executor: Executor | None) -> dict[str, Any]:
        """Return the arguments of `check_gap`."""
        rate = self.rate
        if rate is not None:
            rate = usable_rate("--rate", rate, [PAPER_LIMITS])
        return {
            "members": self.members,
            "threads": self.threads,
            "percent_per_100_periods": rate,
            "executor": executor,
        }


def gap_factors(free_over_rule: float) -> NDArray[np.float64]:
    """Return gaps over the design rule's gap, among them 1.

    ``free_over_rule``: free amplitude over the rule's gap.
    """
    if free_over_rule >= 1:
        return FACTORS
    return np.union1d(0.6 * free_over_rule * LOW_FACTORS, 1.0)


def checks(
    model: ModalModel, ratios: Sequence[float], resonances: Sequence[int], options: dict[str, Any]
) -> list[GapCheck]:
    """Simulate the rule's gap and its neighbours for each mass ratio near each resonance.

    The result is in the order of the masses. ``options`` are arguments of `check_gap`.

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


NARROWEST = "narrowest"
WIDEST = "widest"


def show_gap(row: Record) -> str:
    """Return the best gap over the design rule's gap as text.

    If the narrowest or widest simulated gap is best, the text says that a better gap may exist
    beyond it.
    """
    edge = {NARROWEST: " or less", WIDEST: " or more"}.get(row["best_gap_is"], "")
    return f"{row['best_gap_over_rule']:.2f}{edge}"


def show_reading(row: Record) -> str:
    """Return where the level at the best gap was read, over the resonance, in words."""
    return f"{row['level_read_at']:.3f}{' (end)' if row['level_read_at_end'] else ''}"


COLUMNS = (
    Column("mass_ratio", "mass ratio", "{:g} %", 100),
    Column("resonance", "resonance", "{:.0f}"),
    Column("free_amplitude_over_rule_gap", "free amplitude over gap", "{:.3g}"),
    Column("best_gap_over_rule", "best gap over the rule's", show_gap),
    Column("relative_level_at_best", "level there, %", "{:.1f}", 100),
    Column("relative_level_at_rule", "level at the rule's, %", "{:.1f}", 100),
    Column("rule_over_best", "rule's over best", "{:.2f}"),
    Column(
        "sweep_range",
        "swept, of the resonance",
        lambda row: " to ".join(f"{end:.3g}" for end in row["sweep_range"]),
    ),
    Column("level_read_at", "level read at", show_reading),
    Column("best_gap_is"),
    Column("level_read_at_end"),
)


def check_table(every_check: Sequence[GapCheck]) -> Table:
    """Return a row for each mass and resonance."""
    rows = []
    for check in every_check:
        best = check.best
        assert best is not None
        ratio = float(find_reading_ratios(check.curves[best])[0])
        edge = {0: NARROWEST, len(check.gaps) - 1: WIDEST}.get(best)
        rows.append(
            (
                check.absorber.mass_ratio,
                check.resonance,
                float(check.reach),
                float(check.gaps[best] / check.rule),
                float(check.relative[best]),
                float(check.relative[check.at_rule]),
                float(check.level[check.at_rule] / check.level[best]),
                [float(end) for end in check.limits],
                ratio,
                edge,
                is_at_end(ratio, check.limits, check.rate),
            )
        )
    return Table(COLUMNS, rows)


def frequency_of(
    every_check: Sequence[GapCheck], executor: Executor | None
) -> list[ResonanceCurves]:
    """Return the levels over the frequency near each resonance.

    They are those of the worst member of each mass at its best gap, and without absorber.
    """
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


@command(
    MassesOptions,
    examples=("design masses --mass-ratio 0.02 --members 1 --rate 10",),
)
def main(options: MassesOptions) -> None:
    """Find the best gap for several masses near two resonances, by simulation.

    The best gap of each mass is printed. The simulated gaps are 0.4 to 1.6 times the design rule's
    gap.

    Where the free structure moves less than the rule's gap they are 0.24 to 0.94 times its
    amplitude.

    By the scaling law the force does not matter: gap and friction are in proportion to it. Levels
    are relative to no absorber, at its own place.
    """
    with plain_errors():
        check_page(options.page, MARKER)
        check_targets({"plot": options.plot, "json": options.json})
        model, _ = scenes.read_source_model(options, "mass_ratio", "mass_kg")
        scenes.warn_of_nodes(model, *options.resonances)
        resonances = tuple(dict.fromkeys(options.resonances))
        masses = (options.mass_ratio, options.mass_kg)
        ratios = scenes.mass_ratios_of(*masses, model.beam_mass) or RATIOS
        with workers(options.threads, options.cluster) as executor:
            arguments = options.arguments(executor)
            if options.cluster is None and announce(model, ratios, resonances, arguments) > LONG_S:
                coarse = [
                    check_table(
                        checks(
                            model,
                            ratios,
                            (resonance,),
                            arguments | fast(model, resonance, arguments),
                        )
                    ).to_text()
                    for resonance in resonances
                ]
                announce_coarse("\n" + "\n".join(coarse))
            checks_made = checks(model, ratios, resonances, arguments)
            frequency = [] if options.plot is None else frequency_of(checks_made, executor)
        table = check_table(checks_made)
        click.echo(table.to_text())
        files = fill_page(options.page, MARKER, table.to_text())
        files += write_files({options.json: table.records()})
        if options.plot is not None:
            write_drawing(options.plot, partial(draw_charts, frequency_charts(frequency)))
            files.append(options.plot)
    name_files(files)
