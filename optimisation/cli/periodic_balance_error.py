"""Error of harmonic balance against exact orbits."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.modes import modal_model
from impact_env.parameters import Beam, count, positive, require
from impact_env.periodic.balance_branches import (
    BALANCE_COLUMNS,
    BalanceRow,
    ReferenceOrbit,
    balance_rows,
    exact_orbit,
)
from impact_env.periodic.case import Case
from optimisation.cli.common import (
    check_targets,
    command,
    end_early,
    name_files,
    numbers,
    plain_errors,
)
from optimisation.cli.options import OptionSpec, option, switch
from optimisation.files import write_files
from optimisation.page import markdown
from optimisation.progress import BAR, Bar
from optimisation.report.periodic_figures import save_balance


@dataclass(frozen=True, kw_only=True)
class BalanceOptions:
    """Options of ``periodic balance-error``; None: not given."""

    modes: int = option("modes", default=3, default_text="", usual=True)
    friction_limit: float = option("friction_limit", default=0.01)
    gap: float = option("gap")
    force: float = option("force", default=1.5)
    frequency: float = option(
        "frequency",
        help="Frequency over the first resonance at which displacements are compared",
        default=0.95,
    )
    start: float = option("start", help="First frequency of the branch over the first resonance")
    stop: float = option("stop", help="Last frequency of the branch over the first resonance")
    harmonics: str = option(
        OptionSpec(
            names=("--harmonics",),
            help="Highest harmonics, with commas between",
            type=str,
            metavar="H,H,...",
            default="10,20,40",
            usual=True,
        )
    )
    weights: str = option(
        OptionSpec(
            names=("--weights",),
            help="Weights of the contact in m_a omega_1^2, with commas between",
            type=str,
            metavar="W,W,...",
            default="50,100,200",
            usual=True,
        )
    )
    growing: bool = option(
        switch(
            "--growing",
            "Weights are those at 20 harmonics and grow with the square of their number",
        )
    )
    branches: bool = option(
        switch(
            "--branches/--no-branches",
            "Follow and time the branch at each setting too",
            default=True,
            usual=True,
        )
    )
    json: Path | None = option("json", help="Write the rows")
    csv: Path | None = option("csv", help="Write the rows")
    plot: Path | None = option("plot", help="Draw errors and times over harmonics")


def format_value(value: Any, scale: float, digits: int) -> str:
    """Return a value times ``scale`` with so many digits, and nothing for None."""
    return "" if value is None else f"{scale * value:.{digits}f}"


def text(exact: ReferenceOrbit, rows: list[BalanceRow]) -> str:
    """Return the exact orbit in words, and a table with a line for each setting of harmonic balance."""
    header = (
        "harmonics",
        "weight",
        "error, %",
        "first fold",
        "last fold",
        "peak error, %",
        "CPU s, 250 points",
        "ended",
    )
    lines = []
    for row in rows:
        located = [
            format_value(row.first_fold_ratio, 1, 6),
            format_value(row.last_fold_ratio, 1, 6),
        ]
        last = [
            format_value(row.peak_error, 100, 2),
            format_value(row.cpu_seconds_per_250_points, 1, 2),
            "closed" if row.closed else row.reason,
        ]
        lines.append(
            [
                str(row.harmonics),
                f"{row.weight:g}",
                format_value(row.tip_max_error, 100, 2),
                *located,
                *last,
            ]
        )
    case = exact.case
    peak = exact.curve.peak
    folds = sorted(fold.omega_ratio for fold in exact.curve.folds)
    notes = [
        f"{case.scene}, {case.force:g} N. The exact orbit at {case.omega_ratio:g}: {1e3 * exact.motion.tip_max:.4f} mm."
    ]
    if peak is not None and folds:
        notes.append(
            f"Its branch: folds at {folds[0]:.6f} and {folds[-1]:.6f}, peak {1e3 * peak.tip_max:.4f} mm at {peak.omega_ratio:.4f}."
        )
    return "\n".join([*notes, "", markdown(header, lines)])


def computed(options: BalanceOptions) -> tuple[ReferenceOrbit, list[BalanceRow], bool]:
    """Do what the options ask for; False: ended by Ctrl-C."""
    orders, weights = (
        [positive(f"--{name}", x) for x in numbers(f"--{name}", getattr(options, name), float)]
        for name in ("harmonics", "weights")
    )
    harmonics = [count("--harmonics", round(h), 1, 1000) for h in orders]
    low = positive("--from", options.start)
    high = positive("--to", options.stop)
    require(
        low < options.frequency < high,
        "--frequency",
        options.frequency,
        f"between --from = {low} and --to = {high}",
    )
    model = modal_model(Beam(modes=options.modes))
    case = Case(
        model,
        options.frequency * float(model.omega[0]),
        options.force,
        options.gap,
        1.0,
        options.friction_limit,
    )
    exact = exact_orbit(case, low, high)
    rows = []
    complete = True
    settings = [
        (h, float(np.round(weight * (h / 20) ** 2 if options.growing else weight, 6)))
        for h in harmonics
        for weight in weights
    ]
    try:
        with Bar(total=len(settings), desc="harmonic balance", bar_format=BAR, leave=False) as bar:
            for row in balance_rows(exact, low, high, settings, options.branches):
                rows.append(row)
                bar.update()
    except KeyboardInterrupt:
        complete = False
    return exact, rows, complete


@command(
    BalanceOptions,
    examples=("periodic balance-error --modes 2 --weights 50",),
)
def main(options: BalanceOptions) -> None:
    """Compare harmonic balance with the exact orbit of the larger impulse, at one frequency and along its branch.

    Times are those of the processor; nothing is compiled.
    """
    with plain_errors():
        check_targets(vars(options))
        exact, rows, complete = computed(options)
        plain = [row.to_plain() for row in rows]
        contents = {
            options.json: {"complete": complete, "rows": plain},
            options.csv: (
                BALANCE_COLUMNS,
                [["" if v is None else v for v in row.values()] for row in plain],
            ),
            options.plot: lambda path: save_balance(path, exact, rows, options.growing),
        }
        click.echo(text(exact, rows))
        files = write_files(contents)
    name_files(files)
    end_early(complete)
