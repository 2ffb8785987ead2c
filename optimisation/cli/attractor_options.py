"""Options of the commands about attractors: basins, diagram and section.

They give the case, the length of runs and ranges of parameters.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count, positive, require
from impact_env.periodic.attractors import FREQUENCY, PARAMETERS, SettleOptions, change_parameter
from impact_env.periodic.case import Case, case_of
from optimisation.cli.options import number, option
from optimisation.cli.scene_options import SceneOptions, make_scene, refuse_parts

FORCE = 1.5  # N, the paper's moderate level of excitation
FREQUENCY_RATIO = 0.95  # of the first resonance
DEFAULTS = SettleOptions()
Range = tuple[str, float, float]  # a parameter and its range


@dataclass(frozen=True, kw_only=True)
class AttractorOptions(SceneOptions):
    """The case and the length of runs of the commands about attractors; None: not given."""

    force: float | None = option("force", default=FORCE)
    frequency: float = option(
        "frequency",
        help="Frequency of the force over the first resonance",
        default=FREQUENCY_RATIO,
    )
    seed: int = option("seed")
    settle: int = option("settle", default=DEFAULTS.periods)
    window: int = option(
        "window",
        help="Periods after these by which a motion that does not repeat is judged",
        default=DEFAULTS.window,
    )
    longest: int = option(
        number(
            "--longest",
            "Longest period of a periodic motion, and most circles of a quasi-periodic one",
            type=int,
            default=DEFAULTS.most_multiple,
        )
    )
    threads: int | None = option("threads")
    json: Path | None = option("json")
    csv: Path | None = option("csv")
    plot: Path | None = option("plot")

    @property
    def settling(self) -> SettleOptions:
        """Return the length of runs."""
        return SettleOptions(self.settle, self.window, self.longest)

    def case(self) -> Case:
        """Return structure, absorber, force and frequency; raises BadInput or ParameterError."""
        refuse_parts(self)
        force = positive("--force", self.force)
        ratio = positive("--frequency", self.frequency)
        scene = make_scene(self).scene
        return case_of(scene, force, ratio * float(scene.model.omega[0]))


def range_option(names: str, words: str, **changes: Any) -> Any:
    """Return a field with an option that takes a parameter and its range."""
    return option(
        "over",
        names=(names,),
        help=words,
        more=f"{', '.join(PARAMETERS)}.",
        type=click.Tuple([click.Choice(tuple(PARAMETERS)), float, float]),
        **changes,
    )


def values_of(name_of_option: str, over: Range, points: int, case: Case) -> NDArray[np.float64]:
    """Return evenly spaced values of a range.

    Raises ParameterError for a range that does not rise, and for values that a case cannot have.
    """
    name, low, high = over
    require(low < high, name_of_option, (low, high), "two numbers, the lower one first")
    if name in (FREQUENCY, "force"):
        low = positive(f"{name_of_option} {name}", low)
    for value in (low, high):
        change_parameter(case, name, value)
    return np.linspace(low, high, count("--points", points, 2))
