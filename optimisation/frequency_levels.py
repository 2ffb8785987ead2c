"""Level over the frequency of a sweep, with and without an absorber.

The motion of the worst member of an ensemble is recorded as well.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.curve import DOWN, UP, CurveCase, PerformanceCurve
from impact_env.drive import Drive
from impact_env.ensemble import Executor, Lane, Members, each_lane
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.results import DEFAULT_SAMPLES, Record, Response, require_recorded
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.measures import format_number

Array = NDArray[np.float64]
CURVE_POINTS = 400  # of a curve
FEW_SAMPLES = 8  # a pseudo period, where a run is long
FULL_BYTES = 256e6  # of a recorded motion, above which samples are fewer
MOST_BYTES = 1e9  # above which a motion is not recorded
NO_ABSORBER = "no absorber"
RECOMMENDED = "recommended device, worst member"


@dataclass(frozen=True, eq=False)
class FrequencyCurve:
    """The level over the frequency near a resonance, (n,) each, from a sweep up and one down.

    ``ratio``: frequency over the resonance's, in the middle of the window; ``level``: RMS in m over
    a window as long as that of the response level, the larger of up and down; NaN where no window
    ends.
    """

    name: str
    ratio: Array
    level: Array


@dataclass(frozen=True, eq=False)
class ResonanceCurves:
    """Curves of several absorbers near one resonance.

    ``omega``: its frequency in rad/s. ``force``: amplitude in N.
    """

    resonance: int
    omega: float
    force: float
    curves: tuple[FrequencyCurve, ...]


def samples_for(scene: Scene, periods: float) -> int | None:
    """Return the samples in a pseudo period with which a run's motion is recorded.

    The result is None if the samples would take more than `MOST_BYTES`.
    """
    bytes_a_sample = 16.0 * (scene.model.modes + 2)
    for samples in (DEFAULT_SAMPLES, FEW_SAMPLES):
        size = bytes_a_sample * samples * periods
        if size <= (FULL_BYTES if samples == DEFAULT_SAMPLES else MOST_BYTES):
            return samples
    return None


def windowed_levels(lane: Lane, samples: int) -> tuple[Array, Array]:
    """Run a lane and return the frequency and RMS of each window.

    The frequency is that in the middle of the window over the resonance's, the RMS is in m. There
    is one window in each pseudo period.
    """
    record = Record(events=True, series=True, samples_per_period=samples)
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=record)
    history = require_recorded("history", response.history)
    motion = history.modal_displacement @ lane.scene.model.level_shape
    squares = np.concatenate([[0.0], np.cumsum(motion**2)])
    half = HALF_WINDOW_PERIODS * samples
    middle = np.arange(0, len(motion), samples)  # cut at the ends, as the window of the level
    first = np.maximum(middle - half, 0)
    last = np.minimum(middle + half + 1, len(motion))
    rms = np.sqrt((squares[last] - squares[first]) / (last - first))
    schedule = lane.drive.schedule
    return np.asarray(schedule.omega_at(history.time[middle])) / schedule.reference, rms


def find_worst_run(curve: PerformanceCurve, force: int = 0) -> tuple[int, int]:
    """Return the member (from 0) and direction of the highest level at one of a curve's forces.

    The direction is `UP` or `DOWN`. Levels of NaN are ignored.
    """
    levels = curve.level[force]
    require(bool(np.isfinite(levels).any()), "curve", levels.tolist(), "one with a finished run")
    member, direction = np.unravel_index(int(np.nanargmax(levels)), levels.shape)
    return int(member), int(direction)


def lanes_of(case: CurveCase, members: Members, member: int) -> list[Lane]:
    """Return the sweep up and the sweep down of a member at a case's first force."""
    force = float(case.forces[0])
    return [
        Lane(case.scene, drive, case.steady_start)
        for schedule in case.schedules()
        for drive in members[member : member + 1].drives(force, schedule)
    ]


def frequency_curve(
    name: str,
    lanes: Sequence[Lane],
    limits: tuple[float, float],
    executor: Executor | None = None,
) -> FrequencyCurve | None:
    """Return the largest level over the frequency of several sweeps, such as up and down.

    The result is None if the motion is too long to be recorded.

    ``limits``: frequencies over the resonance's. Raises KeyboardInterrupt if it is stopped.
    """
    samples = samples_for(lanes[0].scene, lanes[0].drive.schedule.periods)
    if samples is None:
        return None
    recorded = each_lane(lanes, partial(windowed_levels, samples=samples), executor=executor)
    pairs = [pair for pair in recorded if pair is not None]
    if len(pairs) < len(lanes):
        raise KeyboardInterrupt
    edges = np.linspace(*limits, CURVE_POINTS + 1)
    levels = np.full(CURVE_POINTS, -np.inf)
    for ratio, rms in pairs:
        at = np.clip(np.searchsorted(edges, ratio, side="right") - 1, 0, CURVE_POINTS - 1)
        np.maximum.at(levels, at, rms)
    return FrequencyCurve(
        name, (edges[1:] + edges[:-1]) / 2, np.where(np.isinf(levels), np.nan, levels)
    )


def resonance_curves(
    cases: Mapping[str, tuple[CurveCase, int]], members: Members, executor: Executor | None = None
) -> ResonanceCurves:
    """Return the levels over the frequency of several absorbers near one resonance.

    They are those at the first force of the absorbers' cases.

    Parameters
    ----------
    cases : dict
        The sweeps of each absorber by its name, and the member (from 0) that is drawn.
    members : Members
        The ensemble.
    executor : Executor, optional
        Where the runs are made.

    Returns
    -------
    ResonanceCurves
        Without the absorbers whose sweeps are too long to be recorded.
    """
    first, _ = next(iter(cases.values()))
    curves = [
        frequency_curve(name, lanes_of(case, members, member), case.limits, executor)
        for name, (case, member) in cases.items()
    ]
    return ResonanceCurves(
        first.resonance,
        first.scene.model.resonance_omega(first.resonance),
        float(first.forces[0]),
        tuple(curve for curve in curves if curve is not None),
    )


@dataclass(frozen=True, eq=False)
class WorstRun:
    """The motion of the member with the highest level.

    It has the number of the member, the direction of the sweep, the resonance and the recorded run.
    """

    member: int
    direction: int
    resonance: int
    response: Response

    @property
    def words(self) -> str:
        """Which run it is, in words."""
        way = {UP: "up", DOWN: "down"}[self.direction]
        drive = self.response.drive
        assert isinstance(drive, Drive)
        return (
            f"member {self.member + 1}, sweep {way}, {format_number(drive.amplitude)} N near "
            f"resonance {self.resonance}"
        )


def record_worst_run(case: CurveCase, curve: PerformanceCurve, force: int = 0) -> WorstRun:
    """Repeat the sweep with the highest level at one of a curve's forces, with its motion.

    ``force``: index of the force.

    The level is that of the curve to the last bit. Raises ParameterError where the motion is too
    long to be recorded.
    """
    member, direction = find_worst_run(curve, force)
    single = replace(case, forces=case.forces[force : force + 1])
    return record_lane(
        lanes_of(single, curve.members, member)[direction], member, direction, case.resonance
    )


def record_lane(lane: Lane, member: int, direction: int, resonance: int) -> WorstRun:
    """Run a lane with its motion recorded; raises ParameterError where that is too long."""
    periods = lane.drive.schedule.periods
    samples = samples_for(lane.scene, periods)
    require(
        samples is not None,
        "history",
        f"{periods:,.0f} pseudo periods",
        f"sweeps whose motion takes at most {MOST_BYTES / 1e9:g} GB: a higher rate takes less",
    )
    assert samples is not None
    record = Record(events=True, series=True, samples_per_period=samples)
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=record)
    return WorstRun(member, direction, resonance, response)
