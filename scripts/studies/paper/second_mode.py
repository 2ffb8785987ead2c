"""The figures `varom` and `vard`: two modes under 3 N in the secondary range, over the second mode's frequency and over its damping.

Level, dissipated energy, and what impacts pass to the second mode.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import spearmanr

from impact_env.energy import mechanical_energy
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.methods import Moreau
from impact_env.parameters import Beam
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from optimisation.report.figures import force_axis
from studies.paper.account import SAMPLES, accounted, critical, lanes_of, scene, window_around
from studies.paper.claim import INFINITY, LEFT, OFTEN, SAME, Claim, about, claim, spread
from studies.paper.curve import curve_of, curves
from studies.paper.frame import PaperFigure, Settings, in_turn, shortened
from studies.paper.style import LOOKS, REFERENCE, legends, line, panels
from studies.study import Json, Steps, Table

Array = NDArray[np.float64]
FORCE = 3.0
TOLD = 0.75 * 0.02, 1.25 * 0.03  # of the first mode's energy: what an impact passes on by the paper, "about 2 to 3 %"
SIGNAL_PERIODS, THINNED = 2.0, 8  # of the energies over time, and every which sample of it is kept
OWN = 6.27  # omega_2/omega_1 of the beam itself: 6.26690
SHOWN = (OWN, 20.0)  # ratios whose energies are drawn over time
SATURATED = 30.0  # a large ratio
RATIO = 6.3  # omega_2/omega_1, as the paper has it where the damping is changed
FIRST = 0.01  # damping ratio of the first mode


def _point(settings: Settings, label: str, beam: Beam, members: int) -> Json:
    """Return each member's level over no absorber and account, of the critical direction; ``step``: one run at the paper's step."""
    own = scene(beam)
    found = critical(settings.each(label, lanes_of(own, FORCE, members, settings.seed), accounted))
    none = curve_of(curves(settings, label, {"none": beam_scene(beam)}, (FORCE,), members)["none"]).level[0]
    step = curve_of(curves(settings, label, {"own": own}, (FORCE,), 1, Moreau())["own"]).level[0, 0]
    single = np.concatenate([account.single for account in found])
    return {
        "relative": [account.level / level for account, level in zip(found, none, strict=True)],
        "step": float(step / none[0]),
        "at": [account.at for account in found],
        "contacts": [account.contacts for account in found],
        "share": [float(account.shares[1]) for account in found],
        "half": [float(account.passed[1] * account.contacts / 2) for account in found],
        "left": [float(account.left[1]) for account in found],
        "single": np.quantile(single, (0.05, 0.25, 0.5, 0.75, 0.95)).tolist(),
        "as_told": [float(np.mean((account.single >= TOLD[0]) & (account.single <= TOLD[1]))) for account in found],
    }


def _signal(own: Scene, seed: int) -> Json:
    """Return the energies in J of both modes and the absorber over two pseudo periods around the maximum of the first member's critical sweep."""
    found = [(simulate(lane.scene, lane.drive).level, lane) for lane in lanes_of(own, FORCE, 1, seed)]
    level, lane = max(((level, lane) for level, lane in found if level is not None), key=lambda pair: pair[0].value)
    response = window_around(lane, level.time)
    assert response.history is not None
    energy = mechanical_energy(own, response.history)
    time = response.history.time / response.drive.schedule.pseudo_period
    first = int(HALF_WINDOW_PERIODS * SAMPLES)
    kept = slice(first, first + int(SIGNAL_PERIODS * SAMPLES) + 1, THINNED)
    return {"time": (time[kept] - time[first]).tolist(), "modal": energy.modal[kept].T.tolist(), "absorber": energy.absorber[kept].tolist()}


def row(values: Json, number: float, key: str) -> Array:
    """Return the members' values of a point."""
    return np.array(values[f"{number:g}"][key], dtype=float)


def points(values: Json) -> list[float]:
    """Return the numbers of the points that are known."""
    return [float(key) for key in values if not key.startswith("signal")]


@dataclass(frozen=True)
class Changed:
    """What is changed of the second mode from point to point, and how it is called.

    ``beam(number)``: the beam of a point; ``shown``: those drawn over time. ``column``, ``axis`` and ``each`` name the number in the table,
    below the figure and above a drawing over time, ``scale`` times as large as it is; ``about(members)`` is the sentence above the table.
    """

    label: str
    beam: Callable[[float], Beam]
    shown: tuple[float, ...]
    column: str
    axis: str
    each: str
    about: Callable[[int], str]
    scale: float = 1.0

    def measure(self, settings: Settings, size: tuple[Sequence[float], int], known: Json) -> Steps:
        """Yield what is known of all points, and the energies in time of those that are shown."""
        numbers, members = size
        groups: dict[str, Callable[[], object]] = {f"{x:g}": partial(_point, settings, self.label, self.beam(x), members) for x in numbers}
        groups |= {f"signal, {x:g}": partial(_signal, scene(self.beam(x)), settings.seed) for x in self.shown}
        return in_turn(groups, known)

    def words(self, values: Json) -> str:
        """Return the sentence and some rows of the table."""
        numbers = points(values)
        return f"{self.about(len(row(values, numbers[0], 'relative')))}\n\n{shortened(self.table(values))}" if numbers else "Not finished."

    def table(self, values: Json) -> Table:
        """Return a line for each point that is known."""
        lines = [
            (
                f"{self.scale * x:.4g}",
                spread(row(values, x, "relative"), "{:.3f}"),
                f"{values[f'{x:g}']['step']:.3f}",
                spread(row(values, x, "share"), "{:.3f}"),
                f"{np.median(row(values, x, 'contacts')):.1f}",
                spread(100 * row(values, x, "half")),
                "{:.2f} to {:.2f}".format(*(100 * values[f"{x:g}"]["single"][k] for k in (1, 3))),
                f"{np.median(row(values, x, 'left')):.2f}",
            )
            for x in points(values)
        ]
        header = (
            self.column, "level over no absorber", "at the paper's step", "dissipated in mode 2", "contacts per pseudo period",
            "passed to mode 2 per half period, % of mode 1", "by single contacts (half of them), %", "left before the next contact",
        )  # fmt: skip
        return Table(self.label, header, lines)

    def draw(self, values: Json) -> Figure:
        """Draw level, shares and energy passed over what was changed, and below the energies over two pseudo periods at some of its values."""
        figure, grid = panels(2, 3, 5.2, "abdc e")
        (level, share, passed), left, numbers = grid[0], grid[1, 2], points(values)
        at = [self.scale * x for x in numbers]

        def banded(axes: Axes, key: str, factor: float, label: str | None = None) -> None:
            rows = factor * np.array([row(values, x, key) for x in numbers])
            low, middle, high = np.quantile(rows, (0.05, 0.5, 0.95), axis=1)
            line(axes, at, middle, LOOKS[0], label, band=(low, high), nominal=None if label else rows[:, 0])

        banded(level, "relative", 1)
        level.plot(at, [values[f"{x:g}"]["step"] for x in numbers], "x", color=LOOKS[1].colour, ms=4, label="one run, the paper's step")
        level.axhline(1, color=REFERENCE.colour, ls=REFERENCE.dashes, lw=0.9)
        level.set(ylabel="level over no absorber", ylim=(0.6, 1.1))
        banded(share, "share", 100)
        share.set(ylabel="dissipated in mode 2, % of both", ylim=(0, None))
        banded(passed, "half", 100, "in half a period")
        single = 100 * np.array([values[f"{x:g}"]["single"] for x in numbers])
        passed.fill_between(at, single[:, 1], single[:, 3], color="0.6", alpha=0.35, lw=0, label="half of all contacts")
        passed.axhspan(2, 3, facecolor="none", edgecolor=LOOKS[1].colour, hatch="///", lw=0.5, label="the paper: 2 to 3 %")
        passed.set(ylabel="passed to mode 2, % of mode 1", ylim=(-2, 5))
        passed.legend(loc="upper left", fontsize=6.5, frameon=False)
        for axes, x in zip(grid[1], self.shown, strict=False):
            if f"signal, {x:g}" in values:
                _energies(axes, values[f"signal, {x:g}"], self.each.format(self.scale * x))
        banded(left, "left", 100)
        left.set(ylim=(0, 105), ylabel="left of mode 2's energy\nbefore the next contact, %")
        level.legend(loc="upper right", handlelength=1.0)
        for axes in (*grid[0], left):
            axes.set(xscale="log", xlim=(at[0], at[-1]), xlabel=self.axis)
            force_axis(axes.xaxis)
            axes.tick_params(axis="x", labelsize=7)
        legends(grid)
        return figure

    def figure(
        self, title: str, sizes: tuple[tuple[Sequence[float], int], tuple[Sequence[float], int]], claims: Callable[[Json], list[Claim]]
    ) -> PaperFigure:
        """Return the figure of the paper."""
        return PaperFigure(
            self.label, title, sizes=sizes, measure=self.measure, words=self.words, draw=self.draw, claims=claims,
            needs=lambda values: len(points(values)) > 1, tables=lambda values: (self.table(values),),
        )  # fmt: skip


def _energies(axes: Axes, own: Json, title: str) -> None:
    time, (first, second), absorber = np.array(own["time"]), np.array(own["modal"]), np.array(own["absorber"])
    total = first + second + absorber
    for look, energy, name in zip(LOOKS, (first, second, absorber), ("mode 1", "mode 2", "absorber"), strict=False):
        axes.plot(time, 100 * energy / np.mean(total), color=look.colour, ls=look.dashes, lw=1.0, label=name)
    axes.legend(loc="upper center", ncols=3, fontsize=5.5, columnspacing=0.5, handlelength=1.3, handletextpad=0.3, frameon=False)
    axes.set(yscale="log", ylim=(0.1, 600), xlim=(0, time[-1]), xlabel="pseudo periods", ylabel="energy, % of the mean total")
    axes.set_title(title, fontsize=8.5)


def _frequency_claims(values: Json) -> list[Claim]:
    """Return what the second mode's frequency does."""
    ratios = points(values)
    said = partial(claim, "varom")
    relative = {ratio: row(values, ratio, "relative") for ratio in ratios}
    high = [ratio for ratio in ratios if ratio >= SATURATED]
    falling = [ratio for ratio in ratios if ratio >= 3.0]
    orders = [float(spearmanr(falling, one).statistic) for one in np.array([relative[ratio] for ratio in falling]).T]
    changes = relative[high[0]] - relative[high[-1]]
    gain = 100 * (1 - np.concatenate([relative[ratio] for ratio in high]))
    half = np.concatenate([100 * row(values, ratio, "half") for ratio in SHOWN])
    single = [min(values[f"{ratio:g}"]["single"][1] for ratio in SHOWN), max(values[f"{ratio:g}"]["single"][3] for ratio in SHOWN)]
    told = np.concatenate([row(values, ratio, "as_told") for ratio in SHOWN])
    contacts = np.concatenate([row(values, ratio, "contacts") for ratio in ratios])
    shares = [np.median(row(values, ratio, "share")) for ratio in falling]
    return [
        said("contacts", "in the secondary range two or more impacts occur in each pseudo period", "4.2", contacts, (1.99, INFINITY),
             "Counted as contacts in the level's window.", about="contacts in a pseudo period ", form="{:.1f}"),
        said("falls", "the level falls as the frequency ratio grows", "4.2", orders, (-1.0, 0.0),
             "Spearman's rank correlation of level and ratio in single members; their spread is of the size of the fall between neighbouring ratios.",
             about="from 3 on, rank correlation of level and ratio "),
        said("improvement", "for large ratios the level is lower by about 20 %", "4.2", gain, about(20),
             f"Members at ratios of {SATURATED:g} and more; their median alone is {np.median(gain):.0f} %.",
             about="less than no absorber by ", form="{:.0f}", unit=" %",
             at_step=100 * (1 - float(np.mean([values[f"{ratio:g}"]["step"] for ratio in high])))),
        said("saturates", "the level saturates at large ratios", "4.2", changes, (-SAME, SAME),
             "A band of 5 % of no absorber is asked for, and single members spread by about that.",
             about=f"from {high[0]:g} to {high[-1]:g}, of no absorber, ", form="{:.3f}"),
        said("passed", "each impact passes 2 to 3 % of the resonant mode's energy to the second", "4.2", told, (OFTEN, 1.0),
             f"Such contacts there are, but half of all pass {100 * single[0]:.2f} to {100 * single[1]:.2f} %, and some take energy back. What "
             f"counts for the level is the net sum: {spread(half)} % in half a pseudo period, by {np.median(contacts) / 2:.1f} contacts.",
             about=f"share of contacts at {' and '.join(f'{ratio:g}' for ratio in SHOWN)} that pass {100 * TOLD[0]:g} to {100 * TOLD[1]:g} %: "),
        said("dissipated", "for large ratios nearly all that an impact passes on is dissipated before the next", "4.2",
             row(values, ratios[-1], "left"), (0.0, LEFT), "Up to a tenth may be left.",
             about=f"at {ratios[-1]:g}, share of the second mode's energy that is left before the next contact "),
        said("share", "the share that the second mode dissipates grows with its frequency", "4.2",
             [float(spearmanr(falling, shares).statistic)], (0.0, 1.0),
             f"Medians: {', '.join(f'{100 * s:.0f} % at {r:g}' for r, s in zip(falling, shares, strict=True))}.",
             about=f"{100 * shares[0]:.0f} to {100 * shares[-1]:.0f} %; rank correlation of share and ratio, from 3 on "),
    ]  # fmt: skip


def _damping_claims(values: Json) -> list[Claim]:
    """Return what the second mode's damping does."""
    dampings = points(values)
    said = partial(claim, "vard")
    relative = {damping: row(values, damping, "relative") for damping in dampings}
    high = [damping for damping in dampings if damping >= 0.3]
    left = np.concatenate([row(values, damping, "left") for damping in high])
    gain = np.concatenate([relative[FIRST] - relative[damping] for damping in high])
    contacts = np.median(np.concatenate([row(values, damping, "contacts") for damping in high]))
    return [
        said("improvement", "more damping of the second mode lowers the level as a higher frequency does", "4.2",
             100 * (1 - np.concatenate([relative[d] for d in high])), about(20),
             f"Members at D_2 of {100 * high[0]:g} % and more.", about="less than no absorber by ", form="{:.0f}", unit=" %",
             at_step=100 * (1 - float(np.mean([values[f"{d:g}"]["step"] for d in high])))),
        said("lower", "the level at high damping is below that of the nominal 1 %", "4.2", 100 * gain, (0.0, 100.0),
             "Single members spread by as much as the gain.", about="lower, in % of no absorber, by ", form="{:.1f}"),
        said("dissipated", "at high damping nearly all that an impact passes on is dissipated before the next", "4.2", left, (0.0, LEFT),
             f"Up to a tenth may be left; there are {contacts:.1f} contacts a pseudo period, not evenly spaced.",
             about="share of the second mode's energy that is left before the next contact "),
        said("saturates", "the level saturates at high damping", "4.2", relative[high[0]] - relative[high[-1]], (-SAME, SAME),
             "A band of 5 % of no absorber is asked for.", about=f"from {100 * high[0]:g} to {100 * high[-1]:g} %, of no absorber, ", form="{:.3f}"),
    ]  # fmt: skip


class Ratios(NamedTuple):
    """Frequency ratios, and members."""

    ratios: tuple[float, ...]
    members: int


class Dampings(NamedTuple):
    """Damping ratios of the second mode, and members."""

    dampings: tuple[float, ...]
    members: int


DAMPING = Changed(
    "vard",
    lambda damping: Beam(modes=2, modal_frequency_ratio={2: RATIO}, damping_ratio=(FIRST, damping)),
    shown=(FIRST, 0.3),
    column="D_2, %",
    axis="damping ratio $D_2$ in %",
    each="$D_2 = {:g}$ %",
    about=lambda members: f"As above at omega_2 = {RATIO:g} omega_1 with 1 % damping of the first mode, {members} members.",
    scale=100.0,
).figure(
    "the second mode's damping",
    (Dampings((0.001, 0.002, 0.005, FIRST, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5), 24), Dampings((0.001, FIRST, 0.05, 0.1, 0.3, 0.5), 4)),
    _damping_claims,
)
FREQUENCY = Changed(
    "varom",
    lambda ratio: Beam(modes=2, modal_frequency_ratio={2: ratio}),
    shown=SHOWN,
    column="omega_2/omega_1",
    axis=r"frequency ratio $\omega_2/\omega_1$",
    each=r"$\omega_2/\omega_1 = {:g}$",
    about=lambda members: (
        f"Two modes, e = 1, no friction, {FORCE:g} N, {members} members. Energies are those of the level's window; impacts closer than 0.05 pseudo "
        "periods are one contact."
    ),
).figure(
    "the second mode's frequency",
    (
        Ratios((1.5, 2.0, 3.0, 4.0, 5.0, OWN, 8.0, 10.0, 12.5, 15.0, 20.0, SATURATED, 40.0, 60.0, 100.0), 24),
        Ratios((1.5, 3.0, OWN, 10.0, 20.0, SATURATED, 100.0), 4),
    ),
    _frequency_claims,
)
