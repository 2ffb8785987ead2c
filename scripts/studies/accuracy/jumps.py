"""The jump of the paper's two-mode absorber to the high branch.

The study gives the share of downward sweeps that reach the high branch, over the slowness of the
sweep and for each method.
"""

from functools import partial
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest

from impact_env import Beam, beam_scene, impact_absorber, simulate
from impact_env.drive import PAPER_LIMITS, linear_sweep
from impact_env.ensemble import draw_members
from impact_env.methods import Exact, Method, Moreau
from optimisation.files import markdown
from optimisation.report.report import figure_of
from studies.accuracy.cases import MARKERS, AccuracySettings, Cases, Row, named, plain, unique

NAME = "jumps"
# N
FORCE = 1.5
FRICTION = 0.025
HIGH = 0.75e-3  # m: between the two branches, which lie at about 0.5e-3 and 1.0e-3


key = itemgetter("periods_per_percent", "method", "setting")  # of a row: its case


def cases(settings: AccuracySettings) -> Cases:
    """Return a case for each slowness and method."""
    methods: list[Method] = [Exact(), *map(Moreau, settings.jump_steps)]
    return {
        (slowness, *_names(method).values()): partial(_measured, slowness, method, settings)
        for slowness in settings.jump_rates
        for method in methods
    }


def _names(method: Method) -> Row:
    return (
        {"method": "Exact", "setting": None}
        if isinstance(method, Exact)
        else {"method": "Moreau", "setting": method.steps_per_period}
    )


def _measured(slowness: float, method: Method, settings: AccuracySettings) -> list[Row]:
    """Return a row for each run."""
    scene = beam_scene(Beam(modes=2), impact_absorber(friction_limit=FRICTION))
    low, high = PAPER_LIMITS
    members = draw_members(settings.jump_members, settings.seed)
    schedule = linear_sweep(
        scene.model.resonance_omega(1), high, low, percent_per_100_periods=100 / slowness
    )
    result = []
    for member, drive in enumerate(members.drives(FORCE, schedule)):
        level = simulate(scene, drive, method).recorded.level.value
        result.append(
            {"periods_per_percent": slowness, **_names(method), "member": member, "level_m": level}
        )
    return result


class JumpShare(NamedTuple):
    """Share of the runs that reach the high branch.

    ``between`` counts the levels close to the limit between the branches.
    """

    slowness: float
    method: str
    setting: float | None
    hits: int
    runs: int
    between: int

    def interval(self, method: str = "wilson") -> tuple[float, float]:
        """Return the 95 % interval of Wilson, or the exact one (Clopper and Pearson's)."""
        result = binomtest(self.hits, self.runs).proportion_ci(method=method)
        return float(result.low), float(result.high)


def shares(all_rows: list[Row]) -> list[JumpShare]:
    """Return the share for each slowness and method, in the order of the rows."""
    cells: dict[Any, list[float]] = {}
    for row in all_rows:
        cells.setdefault(key(row), []).append(row["level_m"])
    result = []
    for (slowness, method, setting), each in cells.items():
        levels = np.array(each)
        result.append(
            JumpShare(
                slowness,
                method,
                setting,
                int(np.sum(levels > HIGH)),
                len(levels),
                int(np.sum(np.abs(levels - HIGH) < 0.1 * HIGH)),
            )
        )
    return result


def jump_table(rows: list[Row]) -> str:
    """Return a line for each slowness and method."""
    header = (
        "pseudo periods per 1 %",
        "method",
        "runs",
        "reach the high branch",
        "95 %, Wilson",
        "95 %, Clopper-Pearson",
        "near the limit",
    )
    lines = []
    for share in shares(rows):
        intervals = [
            "{:.2f} to {:.2f}".format(*share.interval(method)) for method in ("wilson", "exact")
        ]
        name = named({"method": share.method, "setting": share.setting})
        lines.append(
            (
                f"{share.slowness:g}",
                name,
                str(share.runs),
                f"{share.hits / share.runs:.2f}",
                *intervals,
                str(share.between),
            )
        )
    return markdown(header, lines)


def jump_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw the share of runs that reach the high branch over the slowness."""
    result = shares(all_rows)
    figure, panel = figure_of(8, 4.8)
    lines = unique((share.method, share.setting) for share in result)
    for k, (method, setting) in enumerate(lines):
        line = [share for share in result if (share.method, share.setting) == (method, setting)]
        at = np.array([share.slowness for share in line]) * 1.03 ** (
            k - (len(lines) - 1) / 2
        )  # side by side
        y = np.array([share.hits / share.runs for share in line])
        bars = np.abs(np.array([share.interval() for share in line]).T - y)
        label = method if setting is None else f"{method}, {setting:g} steps per highest period"
        colour = (
            "#0072B2"
            if setting is None
            else ("#D55E00", "#E69F00", "#CC79A7", "#777777")[(k - 1) % 4]
        )
        panel.errorbar(
            at,
            y,
            bars,
            color=colour,
            marker=MARKERS[k % len(MARKERS)],
            ms=6,
            lw=1.4,
            capsize=3,
            label=label,
        )
    panel.set(
        xscale="log",
        ylim=(-0.03, 1.03),
        xlabel="slowness of the sweep, pseudo periods per 1 % of the resonance frequency",
    )
    panel.set(
        ylabel="share of runs that reach the high branch",
        title="Jump of the two-mode absorber: share of runs, with 95 % intervals (Wilson)",
    )
    plain(panel, unique(share.slowness for share in result))
    panel.grid(True, color="0.9", lw=0.6)
    panel.legend(frameon=True, fontsize=9)
    return {"jumps": figure}
