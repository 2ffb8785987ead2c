"""Error of harmonic balance against exact orbits."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from impact_env.checks import count, positive, require
from impact_env.modes import modal_model
from impact_env.parameters import Beam
from impact_env.periodic.balance_branches import (
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
    numbers,
    plain_errors,
    write_report,
)
from optimisation.cli.options import OptionSpec, option, switch
from optimisation.executors import BAR, Bar
from optimisation.report.balance_report import make_balance_report


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
    """Compare harmonic balance with the exact orbit of the larger impulse.

    They are compared at one frequency and along the branch of the orbit.

    Times are those of the processor; nothing is compiled.
    """
    with plain_errors():
        check_targets(vars(options))
        exact, rows, complete = computed(options)
        write_report(make_balance_report(exact, rows, options.growing, complete), options)
    end_early(complete)
