"""Report on one sweep.

It has the lines that are printed, the content of the JSON file, and the figure.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import LOAD_STARTS
from impact_env.energy import mechanical_energy
from impact_env.ensemble import LaneLevels
from impact_env.laws import describe_absorber, describe_modes
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.loads import Loads
from impact_env.parameters import Beam, SeveralAbsorbers, SlidingAbsorber, StuckAbsorber
from impact_env.plain import from_scene
from impact_env.results import EnergyAccount, History, Response, require_recorded
from optimisation.calibration.drawn_scenes import LevelBand
from optimisation.measures import format_number, prediction_interval, shorten_numbers
from optimisation.report.report import MM, Report, figure_of
from optimisation.sweep_range import LEAST_RATIO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SweepResult:
    """The recorded run of member 0, and further results of a sweep.

    Attributes
    ----------
    response : Response
        Run of member 0.
    others : LaneLevels, optional
        Levels of the members after it; None: there are none.
    resonance : int
        Resonance that the sweep passes, from 1.
    beam : Beam, optional
        The structure if it is a beam.
    wall_time : float, optional
        Time of an integration alone in s.
    sweep_ratio : float, optional
        Level of such sweeps without absorber over the stationary one; None at a constant frequency.
    measures : list of dict, optional
        Measures of each member, as in `optimisation.signals`.
    steady : bool
        Whether runs start from the steady state of the linear structure, not from rest.
    drawn : bool
        Whether members after the first have parameters drawn from a posterior.
    band : LevelBand, optional
        Their levels over the frequency; None without a sweep.
    """

    response: Response
    others: LaneLevels | None
    resonance: int
    beam: Beam | None = None
    wall_time: float | None = None
    sweep_ratio: float | None = None
    measures: list[dict[str, Any]] | None = None
    steady: bool = False
    drawn: bool = False
    band: LevelBand | None = None

    @property
    def levels(self) -> list[float]:
        """Response levels of all members in m."""
        return [
            require_recorded("level", self.response.level).value,
            *([] if self.others is None else self.others.level.tolist()),
        ]

    @property
    def ratios(self) -> list[float]:
        """Frequencies of the levels over that of the resonance."""
        return [
            require_recorded("level", self.response.level).frequency_ratio,
            *([] if self.others is None else self.others.frequency_ratio.tolist()),
        ]


def make_sweep_report(result: SweepResult) -> Report:
    """Return what `sweep` prints and writes; its figure needs the history."""
    response = result.response
    absorbers = describe_absorber(response.scene.absorber)
    run = describe_run(response, result.resonance, describe_start(result))
    title = "\n".join([*absorbers.split("; "), run])  # a line for each of several absorbers
    return Report(
        title="Sweep",
        text=[[absorbers, run, *number_lines(result), *end_warning(result)]],
        numbers=sweep_numbers(result),
        figures={"sweep.png": partial(draw_sweep, title, response, result.resonance, result.band)},
        resolution=130,
    )


def sweep_numbers(result: SweepResult) -> dict[str, Any]:
    """Return the content of the JSON file of a sweep.

    The scene is written with its beam, or with its modes if the structure is not a beam.
    """
    response = result.response
    level = require_recorded("level", response.level)
    impacts = require_recorded("impacts", response.impacts)
    energy = response.energy
    return {
        "impact_time_s": impacts.time.tolist(),
        "impact_relative_velocity_m_s": impacts.relative_velocity.tolist(),
        "response_level_m": result.levels,
        "level_frequency_ratio": result.ratios,
        "max_tip_m": level.max_tip,
        "impacts": response.impact_count,
        "stuck_time_s": response.stuck_time,
        **({} if energy is None else {"energy_balance_relative_error": energy.relative_error}),
        "pseudo_periods": response.drive.schedule.periods,
        "start": START_WORDS[result.steady],
        "sweep_over_stationary_level": result.sweep_ratio,
        **({} if result.band is None else {"band": band_values(result.band)}),
        **({} if result.wall_time is None else {"wall_s": result.wall_time}),
        **({} if result.measures is None else {"measures": result.measures}),
        "omega_rad_s": response.scene.model.omega.tolist(),
        "scene": from_scene(response.scene, result.beam),
    }


def band_values(band: LevelBand) -> dict[str, list[float]]:
    """Return the band of levels over the frequency as JSON values."""
    low, median, high = band.quantiles.tolist()
    return {
        "frequency_ratio": band.ratio.tolist(),
        "level_5_m": low,
        "level_50_m": median,
        "level_95_m": high,
    }


STARTED = 0.05  # of a sweep from rest: a level that is read there is that of the start
START_WORDS = {False: "rest", True: "steady state"}


def describe_start(result: SweepResult) -> str:
    """Return where the runs start, in words; nothing beside a start of the loads' own."""
    loads = result.response.drive
    if not result.steady and isinstance(loads, Loads) and loads.start != LOAD_STARTS[0]:
        return ""
    return f", from {'the ' if result.steady else ''}{START_WORDS[result.steady]}"


def find_end(result: SweepResult) -> str | None:
    """Return the end of the sweep at which the first member's level was read.

    It is "start" or "end". It is None if the level was read inside, or if nothing is swept.
    """
    response = result.response
    schedule = response.drive.schedule
    if schedule.omegas[0] == schedule.omegas[-1]:
        return None
    time = require_recorded("level", response.level).time
    total = float(schedule.times[-1])
    near = HALF_WINDOW_PERIODS * schedule.pseudo_period
    from_start = near if result.steady else max(near, STARTED * total)
    if time <= from_start:
        return "start"
    return "end" if time >= total - near else None


def end_warning(result: SweepResult) -> list[str]:
    """Return the warning about a level that was read at an end of the sweep; none inside."""
    end = find_end(result)
    if end is None:
        return []
    why = {
        "start": "the range may begin too late"
        if result.steady
        else (
            "the force that begins at once shakes all modes, or the range begins too late: see "
            "--start steady"
        ),
        "end": "the range may end too early, or another resonance decides",
    }[end]
    return [f"Warning: the level was read at the {end} of the sweep: {why}."]


def describe_run(response: Response, resonance: int, start: str = "") -> str:
    """Return a line that describes the drive, the start and the method of a run.

    ``start``: text that describes the start.
    """
    schedule = response.drive.schedule
    modes = response.scene.model.modes
    if isinstance(response.drive, Loads):
        about = f"{response.drive.describe()} for {float(schedule.times[-1]):g} s"
        return (
            f"{about}, {schedule.periods:g} pseudo periods of {schedule.reference:.6g} "
            f"rad/s{start}, {describe_modes(modes)}, {response.method}"
        )
    ratios = schedule.omegas / schedule.reference
    frequency = (
        f"at {ratios[0]:g}" if ratios[0] == ratios[-1] else f"from {ratios[0]:g} to {ratios[-1]:g}"
    )
    where = f"{frequency} times resonance {resonance} ({schedule.reference:.6g} rad/s)"
    return (
        f"{format_number(response.drive.amplitude)} N {where}, "
        f"{schedule.periods:g} pseudo periods{start}, {describe_modes(modes)}, {response.method}"
    )


def number_lines(result: SweepResult) -> list[str]:
    """Return lines with levels, impacts, energies and what else was measured."""
    response = result.response
    levels = 1e3 * np.array(result.levels)
    ratios = result.ratios
    level = require_recorded("level", response.level)
    energy = response.energy
    schedule = response.drive.schedule
    rows = [
        ("response level", f"{levels[0]:.4g} mm", f"around {ratios[0]:.4f} times the resonance")
    ]
    if len(levels) > 1:
        drawn = levels[1:] if result.drawn else levels
        low, high = prediction_interval(drawn)
        members = "draws of the posterior" if result.drawn else "members"
        rows.append(
            (
                "",
                f"{np.median(drawn):.4g} mm",
                f"median of {len(drawn)} {members}, 90 % of runs: {low:.4g} to {high:.4g} mm",
            )
        )
    stuck = response.stuck_time / float(schedule.times[-1])
    rows += [
        ("largest tip displacement", f"{1e3 * level.max_tip:.4g} mm", ""),
        (
            "impacts",
            f"{response.impact_count}",
            f"{response.impact_count / schedule.periods:.3g} a pseudo period",
        ),
        (
            "time stuck or held",
            f"{response.stuck_time:.4g} s",
            f"{100 * stuck:.3g} % of {float(schedule.times[-1]):.4g} s",
        ),
    ]
    if energy is not None:
        rows.append(
            (
                "energy balance, relative",
                f"{energy.relative_error:.1e}",
                f"work of the force {energy.work:.4g} J",
            )
        )
    if result.measures is not None:
        displacement = result.measures[0]["displacement_m"]
        rows.append(
            (
                "RMS of the displacement",
                f"{1e3 * displacement['rms']:.4g} mm",
                f"after {result.measures[0]['from_s']:.4g} s",
            )
        )
        rows.append(
            (
                "power lost in impacts",
                f"{1e3 * result.measures[0]['impacts']['power_w']:.4g} mW",
                "",
            )
        )
    if result.wall_time is not None:
        rows.append(
            (
                "integration alone",
                f"{1e3 * result.wall_time:.4g} ms",
                f"{1e6 * result.wall_time / schedule.periods:.3g} us a pseudo period",
            )
        )
    if result.sweep_ratio is not None:
        rate = (
            1e4
            * abs(float(schedule.omegas[-1] - schedule.omegas[0]))
            / schedule.reference
            / schedule.periods
        )
        fast = "" if result.sweep_ratio >= LEAST_RATIO else ": too fast for shares"
        rows.append(
            (
                "sweep over stationary",
                f"{result.sweep_ratio:.3f}",
                f"without absorber, at {rate:.3g} % per 100 pseudo periods{fast}",
            )
        )
    return [f"  {name:<26}{value:>12}   {note}".rstrip() for name, value, note in rows]


Array = NDArray[np.float64]
TIP = "#1f4e79"
ABSORBER = "#d1641a"
LEVEL = "#a0182d"
WALL = "#555555"
OTHER = "#7a9a3a"
BINS = 1500  # more than this many columns cannot be told apart
DETAIL_PERIODS = 4  # to either side of the maximum


@dataclass(frozen=True)
class _Axis:
    """The figure's horizontal axis.

    It is the frequency ratio of a sweep, or the time in pseudo periods at a constant frequency.
    """

    response: Response
    resonance: int

    @property
    def swept(self) -> bool:
        return bool(np.ptp(self.response.drive.schedule.omegas) > 0)

    def of(self, time: Array) -> Array:
        schedule = self.response.drive.schedule
        return np.asarray(
            schedule.omega_at(time) / schedule.reference
            if self.swept
            else time / schedule.pseudo_period
        )

    @property
    def label(self) -> str:
        return (
            rf"excitation frequency $\Omega/\omega_{{{self.resonance}}}$"
            if self.swept
            else "time in pseudo periods"
        )


def draw_sweep(
    title: str, response: Response, resonance: int, band: LevelBand | None = None
) -> Figure:
    """Draw a response of which level, events and history were recorded.

    Energies are drawn if the response has them.

    ``band``: levels of scenes with drawn parameters, over the frequency.
    """
    history = require_recorded("history", response.history)
    axis = _Axis(response, resonance)
    # several move at places of their own, away from the tip
    moving = not isinstance(response.scene.absorber, StuckAbsorber | SeveralAbsorbers | None)
    rows = 3 if moving else 2
    figure, axes = figure_of(12, 3.1 * rows, rows, 2, width_ratios=[2, 1])
    figure.suptitle(shorten_numbers(title), fontsize=10)
    _displacement(axes[0, 0], response, history, axis)
    if band is not None:
        low, _, high = MM * band.quantiles
        label = "level (RMS), 90 % of the posterior's draws"
        axes[0, 0].fill_between(band.ratio, low, high, color=LEVEL, alpha=0.6, lw=0, label=label)
        axes[0, 0].legend(fontsize=7, loc="upper left")
    _detail(axes[0, 1], response, history, moving)
    if moving:
        _relative(axes[1, 0], response, history, axis)
        _relative_detail(axes[1, 1], response, history)
    _energies(axes[-1, 0], response, history, axis)
    if response.energy is None:
        axes[-1, 1].remove()
    else:
        _account(axes[-1, 1], response.energy, resonance)
    for ax in axes[:, 0]:
        ax.set_xlim(
            *sorted(
                (float(axis.of(np.array(0.0))), float(axis.of(response.drive.schedule.times[-1])))
            )
        )
        ax.set_xlabel(axis.label)
    return figure


def _bins(history: History, response: Response) -> list[Array]:
    """Return the samples of each column of the figure.

    A column has whole pseudo periods. There are no more columns than can be distinguished.
    """
    samples = len(history.time)
    per_period = (
        max(1, round(response.drive.schedule.pseudo_period / (history.time[1] - history.time[0])))
        if samples > 1
        else 1
    )
    width = per_period * max(1, -(-samples // (per_period * BINS)))
    return np.array_split(np.arange(samples), max(1, samples // width))


def _envelope(
    ax: Axes,
    response: Response,
    history: History,
    axis: _Axis,
    values: Array,
    colour: str,
    label: str,
) -> None:
    """Draw least and largest value of each bin, or the curve itself where the record is short."""
    bins = _bins(history, response)
    if len(bins) <= 60:
        ax.plot(axis.of(history.time), values, color=colour, lw=0.8, label=label)
        return
    x = axis.of(np.array([np.mean(history.time[b]) for b in bins]))
    low, high = (np.array([reduce(values[b]) for b in bins]) for reduce in (np.min, np.max))
    ax.fill_between(x, low, high, color=colour, alpha=0.75, lw=0.3, label=label)


def _headroom(ax: Axes, below: float = 0.0) -> None:
    """Widen the vertical axis by shares of its height, for the legend and the impacts' marks."""
    low, high = ax.get_ylim()
    ax.set_ylim(low - below * (high - low), high + 0.25 * (high - low))


def _displacement(ax: Axes, response: Response, history: History, axis: _Axis) -> None:
    level = require_recorded("level", response.level)
    period = response.drive.schedule.pseudo_period
    _envelope(ax, response, history, axis, MM * history.tip_displacement, TIP, "tip")
    window = np.clip(
        level.time + np.array([-1, 1]) * HALF_WINDOW_PERIODS * period,
        0,
        response.drive.schedule.times[-1],
    )
    start, stop = axis.of(window)
    ax.axvspan(
        start,
        stop,
        color=LEVEL,
        alpha=0.15,
        lw=0,
        label=f"window, ±{HALF_WINDOW_PERIODS} pseudo periods",
    )
    for sign in (-1, 1):
        ax.axhline(
            sign * MM * level.value,
            color=LEVEL,
            lw=1,
            ls="--",
            label=f"response level {MM * level.value:.3g} mm" if sign > 0 else None,
        )
    _headroom(ax, below=0.12)
    if response.impacts is not None and len(response.impacts.time):
        times = response.impacts.time
        alpha = float(np.clip(400 / len(times), 0.08, 1))
        ax.plot(
            axis.of(times),
            np.full(len(times), 0.035),
            "|",
            color=ABSORBER,
            ms=9,
            mew=0.6,
            alpha=alpha,
            transform=ax.get_xaxis_transform(),
        )
        ax.plot([], [], "|", color=ABSORBER, ms=9, label=f"{len(times)} impacts")
    ax.set_ylabel("tip displacement in mm")
    ax.legend(loc="upper left", fontsize=8, ncols=4, framealpha=0.9)


def _around_maximum(ax: Axes, response: Response, history: History) -> tuple[slice, Array]:
    """Return the samples around the maximum and their times, and draw the impacts there.

    The times are counted from the maximum in pseudo periods.
    """
    start = require_recorded("level", response.level).time
    period = response.drive.schedule.pseudo_period
    at = (history.time - start) / period
    inside = np.flatnonzero(np.abs(at) <= DETAIL_PERIODS)
    part = slice(inside[0], inside[-1] + 1) if len(inside) else slice(0, len(at))
    for x in () if response.impacts is None else (response.impacts.time - start) / period:
        if abs(x) <= DETAIL_PERIODS:
            ax.axvline(x, color=ABSORBER, lw=0.5, alpha=0.5)
    return part, at[part]


def _detail(ax: Axes, response: Response, history: History, moving: bool) -> None:
    part, x = _around_maximum(ax, response, history)
    ax.plot(x, MM * history.tip_displacement[part], color=TIP, label="tip")
    if moving:
        ax.plot(x, MM * history.absorber_displacement[part], color=ABSORBER, lw=1, label="absorber")
    ax.set(xlabel="pseudo periods from the maximum", ylabel="displacement in mm")
    _headroom(ax)
    ax.legend(loc="upper left", fontsize=8, ncols=2)


def _walls(ax: Axes, response: Response) -> None:
    absorber = response.scene.absorber
    if isinstance(absorber, SlidingAbsorber) and absorber.walls is not None:
        for sign in (-1, 1):
            ax.axhline(
                sign * MM * absorber.walls.gap,
                color=WALL,
                lw=1.6,
                label="cavity walls" if sign > 0 else None,
            )


def _relative(ax: Axes, response: Response, history: History, axis: _Axis) -> None:
    values = MM * (history.absorber_displacement - history.tip_displacement)
    _envelope(ax, response, history, axis, values, ABSORBER, "absorber relative to the tip")
    _walls(ax, response)
    _headroom(ax)
    ax.set_ylabel("relative displacement in mm")
    ax.legend(loc="upper left", fontsize=8, ncols=2, framealpha=0.9)


def _relative_detail(ax: Axes, response: Response, history: History) -> None:
    part, x = _around_maximum(ax, response, history)
    ax.plot(
        x,
        MM * (history.absorber_displacement - history.tip_displacement)[part],
        color=ABSORBER,
        lw=1,
    )
    _walls(ax, response)
    ax.set(xlabel="pseudo periods from the maximum", ylabel="relative displacement in mm")


def _energies(ax: Axes, response: Response, history: History, axis: _Axis) -> None:
    energy = mechanical_energy(response.scene, history)
    bins = _bins(history, response)
    resonant = axis.resonance - 1
    short = len(bins) <= 60
    x = axis.of(history.time if short else np.array([np.mean(history.time[b]) for b in bins]))
    curves = [(energy.modal[:, resonant], TIP, f"mode {axis.resonance}")]
    if response.scene.model.modes > 1:
        curves.append(
            (np.sum(np.delete(energy.modal, resonant, axis=1), axis=1), OTHER, "all other modes")
        )
    if response.scene.absorber is not None:
        curves.append((energy.absorber, ABSORBER, "absorber, kinetic"))
    highest = 0.0
    for values, colour, label in curves:
        y = MM * (values if short else np.array([np.mean(values[b]) for b in bins]))
        highest = max(highest, float(np.max(y)))
        ax.plot(x, y, color=colour, lw=0.9, label=label)
    if highest > 0:
        ax.set_yscale("log")
        ax.set_ylim(highest * 1e-5, highest * 8)
    ax.set_ylabel("energy in mJ" if short else "energy in mJ, mean over bins")
    ax.legend(loc="upper left", fontsize=8, ncols=3, framealpha=0.9)


def _account(ax: Axes, account: EnergyAccount, resonance: int) -> None:
    parts = {
        "force's work": (account.work, WALL),
        f"damping, mode {resonance}": (float(account.modal_loss[resonance - 1]), TIP),
        "damping, other modes": (
            float(np.sum(np.delete(account.modal_loss, resonance - 1))),
            OTHER,
        ),
        "friction": (account.friction_loss, ABSORBER),
        "impacts": (account.impact_loss, ABSORBER),
        "absorber's damper": (account.absorber_damping, ABSORBER),
        "stored": (account.stored_at_end - account.stored_at_start, WALL),
    }
    drawn = {name: part for name, part in parts.items() if part[0] != 0 or name == "force's work"}
    values = [MM * value for value, _ in drawn.values()]
    bars = ax.barh(range(len(drawn)), values, color=[colour for _, colour in drawn.values()])
    work = values[0]
    labels = [
        f" {name}" + (f": {100 * value / work:.3g} %" if work > 0 else "")
        for name, value in zip(drawn, values, strict=True)
    ]
    ax.bar_label(bars, labels, fontsize=8)
    ax.set_yticks([])
    ax.invert_yaxis()
    ax.set_xlim(min(0, *values) * 1.9, max(values) * 1.9 or 1)  # room for the labels
    ax.set_xlabel("energy over the run in mJ")
