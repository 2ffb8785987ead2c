"""Response levels compared with earlier results of the Moreau scheme.

The levels are near the first and the second resonance.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import click
import numpy as np

from impact_env.curve import (
    BAND,
    DEFAULT_MEMBERS,
    CurveCase,
    PerformanceCurve,
    performance_curves,
    quantiles,
)
from impact_env.parameters import Absorber, Beam, friction_damper, impact_absorber
from impact_env.scene import beam_scene
from optimisation.cli.common import command, seed_option
from optimisation.executors import sweeps_bar
from studies.study import (
    Json,
    Measurement,
    OutputPaths,
    add_table_options,
    format_table,
    make_table_study,
    run,
)

NAME = "levels"
MM = 1e3


class ReferenceSettings(NamedTuple):
    """Runs for each point, and the seed of their phases and forces."""

    members: int
    seed: int


@dataclass(frozen=True)
class Column:
    """A scene near a resonance, with the earlier level for each force.

    Forces are in N. The earlier levels are in mm with their known digits, as a number or a range.

    An earlier number is one draw of what is a random variable in the impact regimes: the Moreau
    scheme at 20 steps per period of the highest mode.
    """

    name: str
    absorber: Absorber | None
    forces: tuple[float, ...]
    earlier: tuple[str, ...]
    resonance: int = 1
    modes: int = 10

    def case(self) -> CurveCase:
        """Return the case of the performance curve."""
        return CurveCase(
            beam_scene(Beam(modes=self.modes), self.absorber), np.array(self.forces), self.resonance
        )


PAPERS_BEST = impact_absorber(restitution=0.7, friction_limit=0.1)
FIRST = (1.5, 3.5, 5.0, 20.0)
END_OF_PLATEAU = (40.0, 45.0)
PLATEAU = Column(
    "e = 0.7, muN = 0.1 N",
    PAPERS_BEST,
    (15.0, 20.0, 25.0, 30.0, 35.0, 40.0),
    ("0.44 to 0.57",) * 6,
    2,
)
PAST_PLATEAU = 45.0
COLUMNS = (
    Column("no absorber", None, FIRST, ("1.345", "3.138", "4.483", "17.93")),
    Column("e = 1, no friction", impact_absorber(), FIRST, ("0.57", "0.79", "2.24", "16.8")),
    Column("e = 0.7, muN = 0.1 N", PAPERS_BEST, FIRST, ("0.60", "0.64", "1.84", "16.7")),
    Column(
        "friction damper, muN = 0.5 N", friction_damper(), FIRST, ("0.77", "1.26", "2.19", "15.5")
    ),
    Column(
        "1 mode, e = 1, no friction",
        impact_absorber(),
        FIRST,
        ("1.28", "3.19", "4.67", "18.6"),
        modes=1,
    ),
    Column(
        "3 modes, e = 1, no friction",
        impact_absorber(),
        FIRST,
        ("0.74", "2.51", "3.96", "18.1"),
        modes=3,
    ),
    PLATEAU,
    Column("no absorber", None, END_OF_PLATEAU, ("2.7", "3.1"), 2),
    Column("friction damper, muN = 0.5 N", friction_damper(), END_OF_PLATEAU, ("2.7", "3.0"), 2),
)
PAST = Column("past the plateau", PAPERS_BEST, (PAST_PLATEAU,), ("above 0.57",), 2)


def compared(median: float, low: float, high: float, earlier: str) -> Json:
    """Return the relation of median and band over the members to an earlier number or span, in mm.

    ``inside``: whether the number, within half a unit of its last digit, is in the band; for a
    span, whether the median is in it. ``deviation_percent``: median less the number, in percent of
    the number; None for a span.
    """
    ends = earlier.split(" to ")
    first, last = (
        sign * 0.5 * 10.0 ** -len(end.partition(".")[2]) + float(end)
        for sign, end in ((-1, ends[0]), (1, ends[-1]))
    )
    low, high, off = (
        (median, median, None)
        if len(ends) > 1
        else (low, high, 100 * (median / float(earlier) - 1))
    )
    return {"deviation_percent": off, "inside": low <= last and first <= high}


def compare(column: Column, curve: PerformanceCurve) -> Iterator[Json]:
    """Yield the values of the JSON file for each force of a column."""
    for force, earlier, levels in zip(
        column.forces, column.earlier, MM * quantiles(curve.combined, (0.5, *BAND)).T, strict=True
    ):
        median, low, high = levels.tolist()
        yield {
            "resonance": column.resonance,
            "scene": column.name,
            "modes": column.modes,
            "force_n": force,
            "level_median_m": median / MM,
            "level_5_to_95_percent_m": [low / MM, high / MM],
            "earlier_mm": earlier,
            **compared(median, low, high, earlier),
        }


def plateau_sentence(levels: Sequence[Json], past: Sequence[float]) -> str:
    """Return a sentence on the second resonance's plateau and the members above it.

    It gives the levels of the plateau, and how many members have left the plateau beyond its end.
    The members' levels there are ``past``, in m.
    """
    own = (PLATEAU.resonance, PLATEAU.name)
    plateau = [
        level
        for level in levels
        if (level["resonance"], level["scene"]) == own and level["force_n"] in PLATEAU.forces
    ]
    medians = [MM * level["level_median_m"] for level in plateau]
    top = MM * max(level["level_5_to_95_percent_m"][1] for level in plateau)
    beyond = MM * np.array(past)
    return (
        f"Second resonance, {PLATEAU.name}: the median lies between {min(medians):.3f} and "
        f"{max(medians):.3f} mm\n"
        f"from {PLATEAU.forces[0]:g} to {PLATEAU.forces[-1]:g} N. At {PAST_PLATEAU:g} N it is "
        f"{np.median(beyond):.3f} mm, and "
        f"{np.sum(beyond > top)} of {len(beyond)} members lie above the plateau's\nhighest "
        f"band, which ends at {top:.3f} mm."
    )


def table(levels: Sequence[Json]) -> str:
    """Return a line for each scene and force."""
    columns = {
        "resonance and scene": "{resonance}: {scene}",
        "force, N": "{force_n:g}",
        "median, mm": "{mm[0]:.4g}",
        "5 to 95 %, mm": "{mm[1]:.4g} to {mm[2]:.4g}",
        "other code, mm": "{earlier_mm}",
        "median less other": "{less}",
        "in band": "{word}",
    }
    rows = []
    for level in levels:
        off = level["deviation_percent"]
        mm = [MM * x for x in (level["level_median_m"], *level["level_5_to_95_percent_m"])]
        rows.append(
            {
                **level,
                "mm": mm,
                "less": "" if off is None else f"{off:+.1f} %",
                "word": "yes" if level["inside"] else "no",
            }
        )
    return format_table(columns, rows)


def notes(levels: Sequence[Json], members: int) -> str:
    """Return a text on how many levels are in their bands, and how to read the table.

    It also gives the deviations from the numbers of the other code.
    """
    inside = sum(level["inside"] for level in levels)
    off = [abs(x) for level in levels if (x := level["deviation_percent"]) is not None]
    return (
        f"{inside} of {len(levels)} lie in the band; medians differ by {np.median(off):.1f} % "
        f"(median), at most {max(off):.1f} %.\n"
        f"Levels: the larger of a sweep up and a sweep down; exact method, {members} members; "
        "the other code: one draw each.\n"
        "A number is in the band to its last digit, a span if the median is in it."
    )


def _measure(settings: ReferenceSettings) -> Json:
    with sweeps_bar("sweeping", leave=False) as show:
        curves = performance_curves(
            [column.case() for column in (*COLUMNS, PAST)],
            settings.members,
            settings.seed,
            progress=show,
        )
    if not all(curve.complete for curve in curves):
        raise KeyboardInterrupt
    levels = [
        level
        for column, curve in zip(COLUMNS, curves, strict=False)
        for level in compare(column, curve)
    ]
    return {
        "members": settings.members,
        "seed": settings.seed,
        "levels": levels,
        "past_plateau_level_m": curves[-1].combined[0].tolist(),
    }


def _summary(measured: Measurement) -> str:
    levels = measured.values["levels"]
    past = measured.values["past_plateau_level_m"]
    members = measured.values["members"]
    return "\n\n".join([table(levels), notes(levels, members), plateau_sentence(levels, past)])


STUDY = make_table_study(NAME, "levels beside those of another code", _measure, _summary)


@command()
@click.option(
    "--members",
    type=click.IntRange(min=1),
    default=DEFAULT_MEMBERS,
    show_default=True,
    help="Runs for each point, other in phase and 1e-6 of force.",
)
@seed_option
@add_table_options(NAME, "docs/methods.md")
def main(members: int, seed: int, place: OutputPaths) -> None:
    """Compute response levels of the paper's scenes.

    They are printed next to numbers computed earlier with the Moreau scheme.
    """
    run(STUDY, ReferenceSettings(members, seed), place)
