"""Poincare sections and Lyapunov exponents of runs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.parameters import count
from impact_env.periodic.attractors import SettledMotion, settle_runs
from impact_env.periodic.basins import START_REACH, draw_start
from optimisation.cli import common
from optimisation.cli.attractor_options import AttractorOptions, ratio_text
from optimisation.cli.options import OptionSpec, option
from optimisation.files import write_files
from optimisation.page import markdown
from optimisation.progress import runs_bar
from optimisation.report.attractor_figures import save_section

SECTION_COLUMNS = ("run", "section", "number", "phase_rad", "relative_m", "velocity_m_s", "wall")


def section_table(motions: list[SettledMotion]) -> str:
    """Return a line for each run."""
    rows = []
    for number, motion in enumerate(motions, 1):
        exponent = motion.exponent
        rotation = motion.rotation
        rows.append(
            (
                str(number),
                motion.name,
                f"{1e3 * motion.level:.4f}",
                f"{motion.impacts_per_period:.3f}",
                ""
                if exponent is None
                else f"{exponent.value:.4f} ({exponent.low:.4f} to {exponent.high:.4f})",
                "" if rotation is None else f"{rotation.value:.7f}",
                "" if rotation is None else f"{rotation.change:.1e}",
            )
        )
    header = (
        "run",
        "motion",
        "level, mm",
        "impacts/period",
        "exponent per period (95 %)",
        "rotation number",
        "change from half to half",
    )
    return markdown(header, rows)


def section_rows(motions: list[SettledMotion]) -> list[list[Any]]:
    """Return the values of `SECTION_COLUMNS`: the states at phase 0, then the impacts, of each run."""
    rows: list[list[Any]] = []
    for number, motion in enumerate(motions, 1):
        section = motion.section
        n = motion.case.model.modes
        shape = motion.case.model.tip_shape
        states = section.states
        relative = states[:, n] - states[:, :n] @ shape
        velocity = states[:, -1] - states[:, n + 1 : -1] @ shape
        rows += [
            [number, "stroboscopic", k, 0.0, float(relative[k]), float(velocity[k]), None]
            for k in range(len(states))
        ]
        impacts = zip(section.impact_phase, section.impact_velocity, section.wall, strict=True)
        for k, (phase, speed, wall) in enumerate(impacts):
            place = float(wall) * motion.case.gap
            rows.append([number, "impact", k, float(phase), place, float(speed), int(wall)])
    return rows


def plain_section(motion: SettledMotion) -> dict[str, Any]:
    """Return a run's numbers and its sections; keys with their units."""
    section = motion.section
    return motion.to_plain() | {
        "states": section.states.tolist(),
        "impact_phase_rad": section.impact_phase.tolist(),
        "impact_velocity_m_s": section.impact_velocity.tolist(),
        "impact_wall": section.wall.tolist(),
    }


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
    """Draw a Poincare section of a long run, and say whether its motion is periodic, quasi-periodic or chaotic.

    Of motions that do not repeat the largest Lyapunov exponent is printed with its 95 % interval, and the rotation number of the invariant circle
    with its change from one half of the window to the other.
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
        if motions:
            click.echo(f"{ratio_text(case)}\n\n{section_table(motions)}")
        files = write_files(
            {
                options.json: {
                    "complete": complete,
                    "runs": [plain_section(motion) for motion in motions],
                },
                options.csv: (list(SECTION_COLUMNS), section_rows(motions)),
            }
            | (
                {options.plot: lambda path: save_section(path, motions, options.section)}
                if motions
                else {}
            )
        )
    common.name_files(files)
    common.end_early(complete)
