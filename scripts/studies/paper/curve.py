"""Performance curves of this study as plain values, and their operating ranges.

Levels, contacts around the largest response and envelopes come from runs with the same observers,
so that each kernel is compiled once. A curve has the values of the sweep, up or down, with the
larger level. Operating ranges follow from the contacts (paper, table of operating ranges): linear
without impacts; primary with impacts and pauses in turn around the largest response; secondary with
impacts without pause there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from impact_env import Scene, simulate
from impact_env.checks import require
from impact_env.curve import DOWN, CurveCase, PerformanceCurve
from impact_env.drive import PAPER_LIMITS, Drive, FrequencySchedule, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.methods import Method
from impact_env.periodic.shooting import largest_exponent
from impact_env.periodic.stationary import Criteria, longest_pause
from impact_env.results import DEFAULT_SAMPLES, Record, ResponseLevel
from optimisation.report.report import force_axis
from studies.paper.claim import compute_bands, format_spread
from studies.paper.frame import MM, SMALL, LineStyle, PaperSettings, draw_band, draw_unit_level
from studies.study import Array, Json

FULL_RECORD = Record(events=True, series=True, energy=True)
SERIES = Record(level=False, events=True, series=True)


class SweepContacts(NamedTuple):
    """Contacts of a sweep.

    Attributes
    ----------
    level, at : float
        Level in m, and the frequency ratio at the maximum.
    tip : float
        Largest |q_tip| in m.
    impacts : float
        Number of impacts.
    rate, pause : float
        Impacts per pseudo period, and the longest pause between impacts in pseudo periods, in the
        window of the level: 10 pseudo periods to either side of the largest displacement.
    """

    level: float
    at: float
    tip: float
    impacts: float
    rate: float
    pause: float


def compute_level(lane: Lane) -> ResponseLevel:
    """Return the response level of a lane by the exact method."""
    return simulate(lane.scene, lane.drive).recorded.level


def compute_level_value(lane: Lane) -> float:
    """Return the response level in m of a lane by the exact method."""
    return compute_level(lane).value


def make_both_sweeps(
    scene: Scene, resonance: int = 1
) -> tuple[FrequencySchedule, FrequencySchedule]:
    """Return the paper's sweeps up and down through a resonance, counted from 1."""
    omega = scene.model.resonance_omega(resonance)
    low, high = PAPER_LIMITS
    return linear_sweep(omega, low, high), linear_sweep(omega, high, low)


def measure_contacts(lane: Lane, method: Method | None = None) -> SweepContacts:
    """Return a lane's `SweepContacts` with a method (None: the exact one)."""
    response = simulate(lane.scene, lane.drive, method, record=FULL_RECORD)
    level = response.recorded.level
    period = lane.drive.schedule.pseudo_period
    times = response.recorded.impacts.time / period
    middle = level.time / period
    begin = max(0.0, middle - HALF_WINDOW_PERIODS)
    length = min(lane.drive.schedule.periods, middle + HALF_WINDOW_PERIODS) - begin
    inside = times[(times >= begin) & (times <= begin + length)] - begin
    return SweepContacts(
        level.value,
        level.frequency_ratio,
        level.max_tip,
        len(times),
        len(inside) / length,
        longest_pause(inside, length),
    )


def compute_exponent(lane: Lane, periods: int) -> tuple[float, float, float]:
    """Return the largest Lyapunov exponent of a lane's stationary motion.

    The result is the value and the ends of its interval, each per period of the force, from a run
    over ``periods`` periods.
    """
    result = largest_exponent(lane.scene, lane.drive, periods)
    return result.value, result.low, result.high


def compute_envelope(lane: Lane, periods: int = 4) -> Array:
    """Return a lane's largest |q_tip| in m in each interval of its run, (intervals,).

    An interval has ``periods`` pseudo periods. The last one may be shorter.
    """
    history = simulate(lane.scene, lane.drive, record=FULL_RECORD).recorded.history
    return np.asarray(
        np.maximum.reduceat(
            np.abs(history.tip_displacement),
            np.arange(0, len(history.time), periods * DEFAULT_SAMPLES),
        )
    )


def compute_envelope_ratios(schedule: FrequencySchedule, periods: int = 4) -> Array:
    """Return the frequency in the middle of each interval over the reference, (intervals,).

    The intervals are those of `compute_envelope`.
    """
    stretches = int(
        np.ceil(
            (int(schedule.periods * (1 + 1e-12) * DEFAULT_SAMPLES) + 1)
            / (periods * DEFAULT_SAMPLES)
        )
    )
    middles = np.minimum((np.arange(stretches) + 0.5) * periods, schedule.periods)
    return np.asarray(schedule.omega_at(middles * schedule.pseudo_period)) / schedule.reference


def compute_envelopes(
    settings: PaperSettings, label: str, scene: Scene, drives: Sequence[Drive], periods: int = 4
) -> tuple[Json, Array]:
    """Return the envelopes in m of an ensemble of sweeps.

    ``drives`` are those of the members, with one schedule, the nominal one first. The first result
    is a dict of lists over the intervals: frequency ratio, 5 % quantile, median and 95 % quantile,
    and the nominal member's envelope. The second is the envelope of each member, (M, intervals).
    """
    rows = np.array(
        settings.each(
            label,
            [Lane(scene, drive) for drive in drives],
            partial(compute_envelope, periods=periods),
        )
    )
    own = dict(zip(("low", "median", "high"), compute_bands(rows.T).tolist(), strict=True))
    return {
        "ratio": compute_envelope_ratios(drives[0].schedule, periods).tolist(),
        **own,
        "nominal": rows[0].tolist(),
    }, rows


PAUSE = (
    Criteria().pause
)  # periods of the force: without such a pause within the level's window impacts are sustained


@dataclass(frozen=True, eq=False)
class LevelCurve:
    """A performance curve of F forces for each of M members.

    Attributes
    ----------
    forces : array, (F,)
        Forces in N.
    level, at : array, (F, M)
        The larger level of the sweeps up and down in m, and its frequency ratio.
    down : array, (F, M)
        1 if the sweep down has the larger level, else 0.
    impacts : array, (F, M)
        The larger number of impacts of both sweeps.
    tip, rate, pause : array, (F, M)
        Largest |q_tip| in m, impacts per pseudo period and longest pause in pseudo periods, of the
        sweep with the larger level, as in `SweepContacts`. Rate and pause are NaN if contacts were
        not measured.
    """

    forces: Array
    level: Array
    at: Array
    down: Array
    impacts: Array
    tip: Array
    rate: Array
    pause: Array

    @property
    def median(self) -> Array:
        """Median of the level in m, (F,)."""
        return compute_bands(self.level)[1]

    @property
    def sustained(self) -> Array:
        """Share of the members with impacts and no pause in the window of the level, (F,).

        A pause lasts at least `PAUSE` periods of the force.
        """
        return np.asarray(np.mean((self.pause * self.at < PAUSE) & (self.rate > 0), axis=1))

    @property
    def impacting(self) -> Array:
        """Share of the members with any impact, (F,)."""
        return np.asarray(np.mean(self.impacts > 0, axis=1))

    def relative(self, reference: LevelCurve) -> Array:
        """Return the level over that of the same member of a reference curve, (F, M).

        Raises ParameterError unless the reference has the same forces.
        """
        require(
            np.array_equal(self.forces, reference.forces),
            "reference",
            reference.forces,
            f"a curve over the forces {self.forces}",
        )
        return np.asarray(self.level / reference.level)

    def best(self, reference: LevelCurve) -> int:
        """Return the index of the force with the least median level over a reference curve."""
        return int(np.argmin(np.median(self.relative(reference), axis=1)))

    def nearest(self, force: float) -> int:
        """Return the index of the curve's force that is closest to ``force`` in N."""
        return int(np.argmin(np.abs(self.forces - force)))

    def to_plain(self) -> Json:
        """Return a dict of lists for JSON, with None for NaN."""
        return {field.name: _plain(getattr(self, field.name)) for field in fields(self)}


def _plain(values: Array) -> list[Any]:
    return (
        [_plain(row) for row in values]
        if values.ndim > 1
        else [float(x) if np.isfinite(x) else None for x in values]
    )


def read_curve(plain: Json) -> LevelCurve:
    """Return the curve of a dict from `LevelCurve.to_plain`."""
    return LevelCurve(
        **{
            field.name: np.array(plain[field.name], dtype=np.float64)
            for field in fields(LevelCurve)
        }
    )


def to_plain_curve(result: PerformanceCurve) -> Json:
    """Return the plain form of a performance curve whose contacts were not measured."""
    lanes = result.lanes
    nothing = np.full(result.lanes.level.shape, np.nan)
    values = {
        "level": lanes.level,
        "at": lanes.frequency_ratio,
        "tip": lanes.max_tip,
        "impacts": lanes.impacts,
        "rate": nothing,
        "pause": nothing,
    }
    return _critical(result.forces, values).to_plain()


def _critical(forces: Array, values: Mapping[str, Array]) -> LevelCurve:
    """Return the curve that has, for each force and member, the sweep with the larger level.

    ``values`` has arrays (F, M, 2), up and down, by the names of `LevelCurve`.
    """
    which = np.argmax(values["level"], axis=-1)[..., None]
    own = {
        name: np.take_along_axis(array, which, axis=-1)[..., 0] for name, array in values.items()
    }
    own["impacts"] = np.max(values["impacts"], axis=-1)
    return LevelCurve(forces, down=which[..., 0] == DOWN, **own)


def compute_curves(
    settings: PaperSettings,
    label: str,
    scenes: Mapping[str, Scene],
    forces: Sequence[float],
    members: int,
    method: Method | None = None,
) -> Json:
    """Return a dict of plain performance curves of scenes near their first resonance.

    Keys are those of ``scenes``. Contacts are not measured.
    """
    cases = [CurveCase(scene, np.array(forces)) for scene in scenes.values()]
    return {
        name: to_plain_curve(result)
        for name, result in zip(scenes, settings.curves(label, cases, members, method), strict=True)
    }


def compute_contact_curve(
    settings: PaperSettings, label: str, scene: Scene, forces: Sequence[float], members: int
) -> Json:
    """Return the plain performance curve of a scene near its first resonance, with its contacts."""
    drawn = draw_members(members, settings.seed)
    lanes = [
        Lane(scene, drive)
        for force in forces
        for schedule in make_both_sweeps(scene)
        for drive in drawn.drives(float(force), schedule)
    ]
    numbers = np.array(settings.each(label, lanes, measure_contacts)).reshape(
        len(forces), 2, members, -1
    )
    return _critical(
        np.array(forces),
        dict(zip(SweepContacts._fields, numbers.transpose(3, 0, 2, 1), strict=True)),
    ).to_plain()


def find_best_forces(own: LevelCurve, none: LevelCurve) -> Array:
    """Return the force in N at which each member has its smallest level over no absorber, (M,)."""
    return own.forces[np.argmin(own.relative(none), axis=0)]


def describe_best(own: LevelCurve, none: LevelCurve) -> tuple[str, str]:
    """Return, as texts, the force in N with the least median level over no absorber, and the level.

    The level has its band.
    """
    best = own.best(none)
    return f"{own.forces[best]:.3g}", format_spread(own.relative(none)[best])


def make_force_grid(
    low: float, high: float, points: int, also: Sequence[float] = ()
) -> tuple[float, ...]:
    """Return ``points`` forces in N, evenly spaced on a logarithmic axis, and ``also``, sorted."""
    return tuple(sorted({*np.round(np.geomspace(low, high, points), 6).tolist(), *also}))


MAJORITY = 0.5  # share of the members that decides


class Border(NamedTuple):
    """End of an operating range, between two adjacent forces of a curve in N."""

    low: float
    high: float

    @property
    def force(self) -> float:
        """Geometric mean of both forces, in N."""
        return float(np.sqrt(self.low * self.high))

    def __str__(self) -> str:
        return f"between {self.low:.3g} and {self.high:.3g} N"


class Ranges(NamedTuple):
    """Operating ranges of a performance curve.

    ``first_impacts`` is the end of the linear range, ``transition`` the end of the primary one. A
    border outside the curve's forces is None.
    """

    first_impacts: Border | None
    transition: Border | None


def find_operating_ranges(forces: ArrayLike, impacting: ArrayLike, sustained: ArrayLike) -> Ranges:
    """Return the borders between the operating ranges on rising forces (F,) in N.

    ``impacting`` and ``sustained`` (F,) are the shares of members with impacts, and with impacts
    without pause. The linear range ends at the first force at which more than half of the members
    have impacts. The secondary range begins above the last force at which no more than half of them
    have impacts without pause.
    """
    rising = np.asarray(forces, dtype=float)
    impacts = np.flatnonzero(np.asarray(impacting) > MAJORITY)
    paused = np.flatnonzero(np.asarray(sustained) <= MAJORITY)
    ends = impacts[0] if len(impacts) else 0, paused[-1] + 1 if len(paused) else 0
    return Ranges(
        *(
            Border(float(rising[k - 1]), float(rising[k])) if 0 < k < len(rising) else None
            for k in ends
        )
    )


def find_ranges(curve: LevelCurve) -> Ranges:
    """Return the operating ranges of a curve whose contacts were measured."""
    return find_operating_ranges(curve.forces, curve.impacting, curve.sustained)


def compute_slopes(curve: LevelCurve, inside: NDArray[np.bool_]) -> Array:
    """Return d log(level)/d log(force) of each member, (M,), by least squares.

    Only the forces in the mask ``inside`` (F,) are used. A slope of 1 is a level proportional to
    the force, 0 a saturated level. The result is NaN for fewer than two forces.
    """
    if np.count_nonzero(inside) < 2:
        return np.full(curve.level.shape[1], np.nan)
    return np.asarray(
        np.polynomial.polynomial.polyfit(
            np.log(curve.forces[inside]), np.log(curve.level[inside]), 1
        )[1]
    )


def draw_curve(
    axes: Axes, own: LevelCurve, style: LineStyle, label: str, marked: bool = True
) -> None:
    """Draw the median of a curve with its band and its nominal member, levels in mm.

    ``marked``: with markers.
    """
    draw_band(axes, own.forces, own.level, style, label, MM, marked=marked)


def set_level_axes(axes: Axes, none: LevelCurve, most: float) -> None:
    """Set the axes for levels over forces up to ``most`` in N.

    Both axes are linear, as in the paper. ``none`` is the curve without absorber.
    """
    axes.set(xlim=(0, most), ylim=(0, 1.05 * MM * float(np.interp(most, none.forces, none.median))))
    axes.set(xlabel="amplitude of the force in N", ylabel="resonant response level in mm (RMS)")


def draw_inset(
    axes: Axes,
    bounds: tuple[float, float, float, float],
    none: LevelCurve,
    drawn: Mapping[LineStyle, LevelCurve],
) -> Axes:
    """Add an inset with the levels over those without absorber, and return its axes.

    ``bounds``: its place in the axes, as in matplotlib's ``inset_axes``. ``none``: the curve
    without absorber; ``drawn``: the other curves by their line styles, over the same forces.
    """
    small = axes.inset_axes(bounds)
    for style, own in drawn.items():
        low, middle, high = compute_bands(own.relative(none))
        small.fill_between(own.forces, low, high, color=style.colour, alpha=0.18, lw=0)
        small.plot(own.forces, middle, color=style.colour, ls=style.dashes, lw=1.0)
    draw_unit_level(small)
    small.set(xscale="log", xlim=(none.forces[0], none.forces[-1]))
    small.set(ylim=(0, 1.15), yticks=(0, 0.5, 1))
    small.set_title("level over no absorber", fontsize=SMALL, pad=2)
    small.set_xlabel("force in N", fontsize=SMALL, labelpad=1)
    force_axis(small.xaxis)
    small.tick_params(labelsize=SMALL)
    return small
