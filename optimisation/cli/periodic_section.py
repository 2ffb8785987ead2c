"""Poincare sections and Lyapunov exponents of runs."""

from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from impact_env.checks import count
from impact_env.periodic.attractors import settle_runs
from impact_env.periodic.basins import START_REACH, draw_start
from optimisation.cli import common
from optimisation.cli.attractor_options import AttractorOptions
from optimisation.cli.options import OptionSpec, option
from optimisation.executors import runs_bar
from optimisation.report.attractor_report import make_section_report


@dataclass(frozen=True, kw_only=True)
class SectionOptions(AttractorOptions):
    """Options of ``periodic section``; None: not given."""

    section: str = option(
        OptionSpec(
            names=("--section",),
            help="What the figure has: stroboscopic or impacts",
            more="States at phase 0 of the force, or phase and velocity at impacts.",
            type=click.Choice(("stroboscopic", "impacts")),
            metavar="NAME",
            default="stroboscopic",
            usual=True,
            section="Output",
        )
    )
    starts: int = option(
        "starts",
        help="Runs from random initial states; 0: one run from rest",
        default=0,
        usual=True,
    )
    csv: Path | None = option("csv", help="Write a row for each state and each impact")


@common.command(
    SectionOptions,
    examples=(
        "periodic section --modes 1 --restitution 0.75 --frequency 0.93",
        "periodic section --modes 1 --section impacts --plot a.png",
    ),
)
def main(options: SectionOptions) -> None:
    """Draw a Poincare section of a long run and classify its motion.

    The motion is periodic, quasi-periodic or chaotic.

    Of motions that do not repeat the largest Lyapunov exponent is printed with its 95 % interval,
    and the rotation number of the invariant circle with its change from one half of the window to
    the other.
    """
    with common.plain_errors():
        common.check_targets(vars(options))
        settling = options.settling
        starts = count("--starts", options.starts, 0)
        seed = count("--seed", options.seed, 0)
        case = options.case()
        begin = [(case, np.zeros(2 * case.model.modes + 2), 0.0)]
        if starts:
            reach = START_REACH * case.gap
            begin = [
                (case, *draw_start(case, reach, np.random.default_rng([seed, k])))
                for k in range(starts)
            ]
        with runs_bar("section") as show:
            result = settle_runs(begin, settling, threads=options.threads, progress=show)
        motions = [motion for motion in result if motion is not None]
        complete = len(motions) == len(result)
        common.write_report(make_section_report(motions, options.section, complete), options)
    common.end_early(complete)
