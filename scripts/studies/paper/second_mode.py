"""The figures `varom` and `vard`: two modes under 3 N in the secondary range.

The variables are the second mode's frequency and its damping.

Level, dissipated energy, and what impacts pass to the second mode.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from impact_env import Beam, Moreau, Scene, beam_scene
from impact_env.energy import mechanical_energy
from impact_env.level import HALF_WINDOW_PERIODS
from optimisation.report.report import force_axis
from studies.paper.account import (
    SAMPLES,
    find_critical,
    make_lanes,
    make_scene,
    measure_energy_shares,
    simulate_window,
)
from studies.paper.claim import Claim, compute_band, format_spread, judge_share, make_claim
from studies.paper.curve import compute_curves, compute_level, read_curve
from studies.paper.frame import (
    SMALL,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_band,
    draw_legend_below,
    draw_legends,
    draw_signal,
    draw_unit_level,
    make_panels,
    measure_groups,
    shorten_table,
)
from studies.study import Array, CsvTable, Json, Steps

FORCE = 3.0
STATED_RANGE = (
    0.75 * 0.02,
    1.25 * 0.03,
)  # of the first mode's energy: what an impact passes on by the paper, "about 2 to 3 %"
# of the energies over time, and every which sample of it is kept
SIGNAL_PERIODS = 2.0
THINNED = 8
OWN = 6.27  # omega_2/omega_1 of the beam itself: 6.26690
DRAWN_POINTS = (OWN, 20.0)  # ratios whose energies are drawn over time
SATURATED = 30.0  # a large ratio
RATIO = 6.3  # omega_2/omega_1, as the paper has it where the damping is changed
FIRST = 0.01  # damping ratio of the first mode


def _point(settings: PaperSettings, label: str, beam: Beam, members: int) -> Json:
    """Return each member's level relative to no absorber and its energies.

    They are those of the critical direction. ``step`` is one run at the paper's step.
    """
    own = make_scene(beam)
    result = find_critical(
        settings.each(label, make_lanes(own, FORCE, members, settings.seed), measure_energy_shares)
    )
    none = read_curve(
        compute_curves(settings, label, {"none": beam_scene(beam)}, (FORCE,), members)["none"]
    ).level[0]
    step = read_curve(
        compute_curves(settings, label, {"own": own}, (FORCE,), 1, Moreau())["own"]
    ).level[0, 0]
    return {
        "relative": [account.level / level for account, level in zip(result, none, strict=True)],
        "step": float(step / none[0]),
        "at": [account.at for account in result],
        "contacts": [account.contacts for account in result],
        "share": [float(account.shares[1]) for account in result],
        "half": [float(account.passed[1] * account.contacts / 2) for account in result],
        "left": [float(account.left[1]) for account in result],
        "single": np.quantile(
            np.concatenate([account.single for account in result]), (0.05, 0.25, 0.5, 0.75, 0.95)
        ).tolist(),
        "in_stated_range": [
            float(
                np.mean((account.single >= STATED_RANGE[0]) & (account.single <= STATED_RANGE[1]))
            )
            for account in result
        ],
    }


def _signal(own: Scene, seed: int) -> Json:
    """Return the energies in J of both modes and the absorber over two pseudo periods.

    They are those around the maximum of the first member's critical sweep.
    """
    level, lane = max(
        ((compute_level(lane), lane) for lane in make_lanes(own, FORCE, 1, seed)),
        key=lambda pair: pair[0].value,
    )
    response = simulate_window(lane, level.time)
    history = response.recorded.history
    energy = mechanical_energy(own, history)
    time = history.time / response.drive.schedule.pseudo_period
    first = int(HALF_WINDOW_PERIODS * SAMPLES)
    selection = slice(first, first + int(SIGNAL_PERIODS * SAMPLES) + 1, THINNED)
    return {
        "time": (time[selection] - time[first]).tolist(),
        "modal": energy.modal[selection].T.tolist(),
        "absorber": energy.absorber[selection].tolist(),
    }


def read_row(values: Json, number: float, key: str) -> Array:
    """Return the members' values of a point."""
    return np.array(values[f"{number:g}"][key], dtype=float)


def find_points(values: Json) -> list[float]:
    """Return the numbers of the points that are known."""
    return [float(key) for key in values if not key.startswith("signal")]


@dataclass(frozen=True)
class ParameterStudy:
    """A study of one parameter of the second mode.

    Attributes
    ----------
    label, about : str
        Name of the parameter, and the sentence above the table.
    numbers : str
        Name of its values in the sizes.
    beam : callable
        Returns the beam of a value.
    drawn : tuple of float
        Values whose energies are drawn over time.
    column, axis, each : str
        Name of the parameter in the table, at the figure's axis, and above a drawing over time.
    scale : float
        Factor of the value in these.
    """

    label: str
    numbers: str
    beam: Callable[[float], Beam]
    drawn: tuple[float, ...]
    column: str
    axis: str
    each: str
    about: str
    scale: float = 1.0

    def measure(self, settings: PaperSettings, size: Size, earlier: Json) -> Steps:
        """Yield the results of all points, and the energies in time of those that are drawn."""
        numbers = vars(size)[self.numbers]
        groups: dict[str, Callable[[], object]] = {
            f"{x:g}": partial(_point, settings, self.label, self.beam(x), size.members)
            for x in numbers
        }
        groups |= {
            f"signal, {x:g}": partial(_signal, make_scene(self.beam(x)), settings.seed)
            for x in self.drawn
        }
        return measure_groups(groups, earlier)

    def describe(self, values: Json) -> str:
        """Return the sentence and some rows of the table."""
        count = len(read_row(values, find_points(values)[0], "relative"))
        return f"{self.about.format(count)}\n\n{shorten_table(self.table(values))}"

    def table(self, values: Json) -> CsvTable:
        """Return a line for each point that is known."""
        lines = [
            (
                f"{self.scale * x:.4g}",
                format_spread(read_row(values, x, "relative"), "{:.3f}"),
                f"{values[f'{x:g}']['step']:.3f}",
                format_spread(read_row(values, x, "share"), "{:.3f}"),
                f"{np.median(read_row(values, x, 'contacts')):.1f}",
                format_spread(100 * read_row(values, x, "half")),
                "{:.2f} to {:.2f}".format(*(100 * values[f"{x:g}"]["single"][k] for k in (1, 3))),
                f"{np.median(read_row(values, x, 'left')):.2f}",
            )
            for x in find_points(values)
        ]
        header = (
            self.column,
            "level over no absorber",
            "at the paper's step",
            "dissipated in mode 2",
            "contacts per pseudo period",
            "passed to mode 2 per half period, % of mode 1",
            "by single contacts (half of them), %",
            "left before the next contact",
        )
        return CsvTable(self.label, header, lines)

    def draw(self, values: Json) -> Figure:
        """Draw level, shares and energy passed over the parameter that is varied.

        Below, the energies over two pseudo periods are drawn for some of its values.
        """
        figure, grid = make_panels(2, 3, 5.5, "abdc e")
        level, share, passed = grid[0]
        left = grid[1, 2]
        numbers = find_points(values)
        at = [self.scale * x for x in numbers]
        single = 100 * np.array([values[f"{x:g}"]["single"] for x in numbers])
        for axes, key, factor in (
            (level, "relative", 1),
            (share, "share", 100),
            (passed, "half", 100),
            (left, "left", 100),
        ):
            label = "in half a period" if axes is passed else None
            draw_band(
                axes,
                at,
                factor * np.array([read_row(values, x, key) for x in numbers]),
                STYLES[0],
                label,
                nominal=label is None,
            )
        level.plot(
            at,
            [values[f"{x:g}"]["step"] for x in numbers],
            "x",
            color=STYLES[1].colour,
            ms=4,
            label="one run, the paper's step",
        )
        draw_unit_level(level)
        level.set(ylabel="level over no absorber", ylim=(0.6, 1.1))
        share.set(ylabel="dissipated in mode 2, % of both", ylim=(0, None))
        passed.fill_between(
            at,
            single[:, 1],
            single[:, 3],
            color="0.6",
            alpha=0.35,
            lw=0,
            label="half of all contacts",
        )
        passed.axhspan(
            2,
            3,
            facecolor="none",
            edgecolor=STYLES[1].colour,
            hatch="///",
            lw=0.5,
            label="the paper: 2 to 3 %",
        )
        passed.set(ylabel="passed to mode 2, % of mode 1", ylim=(-2, 5))
        passed.legend(loc="upper left", fontsize=SMALL, frameon=False)
        for axes, x in zip(grid[1], self.drawn, strict=False):
            _energies(axes, values[f"signal, {x:g}"], self.each.format(self.scale * x))
        left.set(ylim=(0, 105), ylabel="left of mode 2's energy\nbefore the next contact, %")
        level.legend(loc="upper right", handlelength=1.0)
        for axes in (*grid[0], left):
            axes.set(xscale="log", xlim=(at[0], at[-1]), xlabel=self.axis)
            force_axis(axes.xaxis)
            axes.tick_params(axis="x", labelsize=SMALL)
        draw_legends([*grid[0], left])
        draw_legend_below(figure, [grid[1, 0]], 3)
        return figure

    def figure(
        self, title: str, claims: Callable[[Json], list[Claim]], *sizes: Size
    ) -> PaperFigure:
        """Return the figure of the paper."""
        return PaperFigure(
            self.label,
            title,
            sizes=(sizes[0], sizes[1]),
            measure=self.measure,
            describe=self.describe,
            draw=self.draw,
            claims=claims,
            tables=lambda values: (self.table(values),),
        )


def _energies(axes: Axes, own: Json, title: str) -> None:
    energies = *(np.array(mode) for mode in own["modal"]), np.array(own["absorber"])
    mean = np.mean(sum(energies))
    for style, energy, name in zip(
        STYLES, energies, ("(c): mode 1", "mode 2", "absorber"), strict=False
    ):
        draw_signal(axes, own["time"], 100 * energy / mean, style, name, 1.0)
    axes.set(
        yscale="log",
        ylim=(0.1, 200),
        xlim=(0, own["time"][-1]),
        xlabel="pseudo periods",
        ylabel="energy, % of the mean total",
    )
    axes.set_title(title, fontsize=8.5)


def _frequency_claims(values: Json) -> list[Claim]:
    """Return the verdicts on the second mode's frequency."""
    ratios = find_points(values)
    relative = {ratio: read_row(values, ratio, "relative") for ratio in ratios}
    high, falling = ([ratio for ratio in ratios if ratio >= least] for least in (SATURATED, 3.0))
    orders = [
        float(spearmanr(falling, one).statistic)
        for one in np.array([relative[ratio] for ratio in falling]).T
    ]
    gain = 100 * (1 - np.concatenate([relative[ratio] for ratio in high]))
    stepped = 100 * (1 - float(np.mean([values[f"{ratio:g}"]["step"] for ratio in high])))
    half, in_stated_range = (
        np.concatenate([read_row(values, ratio, key) for ratio in DRAWN_POINTS])
        for key in ("half", "in_stated_range")
    )
    low, most = (
        100 * each(values[f"{ratio:g}"]["single"][k] for ratio in DRAWN_POINTS)
        for each, k in ((min, 1), (max, 3))
    )
    contacts = np.concatenate([read_row(values, ratio, "contacts") for ratio in ratios])
    shares = [100 * np.median(read_row(values, ratio, "share")) for ratio in falling]
    medians = ", ".join(
        f"{share:.0f} % at {ratio:g}" for ratio, share in zip(falling, shares, strict=True)
    )
    judge = partial(make_claim, "varom")
    visible = " and ".join(f"{ratio:g}" for ratio in DRAWN_POINTS)
    return [
        judge("varom_contacts", contacts),
        judge("varom_falls", orders),
        judge(
            "varom_improvement", gain, saturated=SATURATED, median=np.median(gain), at_step=stepped
        ),
        judge(
            "varom_saturates", relative[high[-1]] / relative[high[0]], low=high[0], high=high[-1]
        ),
        judge(
            "varom_passed",
            judge_share(*compute_band(in_stated_range)),
            share=in_stated_range,
            ratios=visible,
            least=100 * STATED_RANGE[0],
            most=STATED_RANGE[1],
            low=low,
            high=most / 100,
            half=100 * half,
            contacts=np.median(contacts) / 2,
        ),
        judge("varom_dissipated", read_row(values, ratios[-1], "left"), ratio=ratios[-1]),
        judge(
            "varom_share",
            [float(spearmanr(falling, shares).statistic)],
            first=shares[0],
            last=shares[-1] / 100,
            medians=medians,
        ),
    ]


def _damping_claims(values: Json) -> list[Claim]:
    """Return the verdicts on the second mode's damping."""
    dampings = find_points(values)
    relative = {damping: read_row(values, damping, "relative") for damping in dampings}
    high = [damping for damping in dampings if damping >= 0.3]
    left, contacts = (
        np.concatenate([read_row(values, damping, key) for damping in high])
        for key in ("left", "contacts")
    )
    gain = np.concatenate([relative[FIRST] - relative[damping] for damping in high])
    stepped = 100 * (1 - float(np.mean([values[f"{d:g}"]["step"] for d in high])))
    judge = partial(make_claim, "vard")
    return [
        judge(
            "vard_improvement",
            100 * (1 - np.concatenate([relative[d] for d in high])),
            low=high[0],
            at_step=stepped,
        ),
        judge("vard_lower", 100 * gain),
        judge("vard_dissipated", left, contacts=np.median(contacts)),
        judge(
            "vard_saturates",
            relative[high[-1]] / relative[high[0]],
            low=100 * high[0],
            high=100 * high[-1],
        ),
    ]


DAMPING = ParameterStudy(
    "vard",
    "dampings",
    lambda damping: Beam(modes=2, modal_frequency_ratio={2: RATIO}, damping_ratio=(FIRST, damping)),
    drawn=(FIRST, 0.3),
    column="D_2, %",
    axis="damping ratio $D_2$ in %",
    each="$D_2 = {:g}$ %",
    about=(
        f"As above at omega_2 = {RATIO:g} omega_1 with 1 % damping of the first mode, {{}} members."
    ),
    scale=100.0,
).figure(
    "the second mode's damping",
    _damping_claims,
    Size(dampings=(0.001, 0.002, 0.005, FIRST, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5), members=24),
    Size(dampings=(0.001, FIRST, 0.05, 0.1, 0.3, 0.5), members=4),
)
FREQUENCY = ParameterStudy(
    "varom",
    "ratios",
    lambda ratio: Beam(modes=2, modal_frequency_ratio={2: ratio}),
    drawn=DRAWN_POINTS,
    column="omega_2/omega_1",
    axis=r"frequency ratio $\omega_2/\omega_1$",
    each=r"$\omega_2/\omega_1 = {:g}$",
    about=f"Two modes, e = 1, no friction, {FORCE:g} N, {{}} members. Energies are those of the "
    "level's window; impacts closer than 0.05 pseudo "
    "periods are one contact.",
).figure(
    "the second mode's frequency",
    _frequency_claims,
    Size(
        ratios=(
            1.5,
            2.0,
            3.0,
            4.0,
            5.0,
            OWN,
            8.0,
            10.0,
            12.5,
            15.0,
            20.0,
            SATURATED,
            40.0,
            60.0,
            100.0,
        ),
        members=24,
    ),
    Size(ratios=(1.5, 3.0, OWN, 10.0, 20.0, SATURATED, 100.0), members=4),
)
