"""Performance curves: response level over the force's amplitude (paper, section 3.3).

A curve is computed as an ensemble and has a band.

In the impact regimes a level is a random variable: runs that differ in last digits only diverge
after some impacts. A curve is therefore computed over members that differ in the initial phase of
the force and, by a millionth at most, in its amplitude; it has a median and a band.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import (
    count,
    count_from,
    flag,
    instance,
    kind_of,
    listed,
    numbers,
    positive,
    require,
    row,
    row_of,
    two,
)
from impact_env.drive import (
    PAPER_LIMITS,
    Drive,
    Excitation,
    FrequencySchedule,
    Member,
    default_rate,
    linear_sweep,
)
from impact_env.ensemble import (
    MOST_MEMBERS,
    Executor,
    Lane,
    LaneLevels,
    LaneProgress,
    LevelOf,
    Members,
    available_cores,
    draw_members,
    run_lanes,
)
from impact_env.fields import check_fields
from impact_env.laws import SceneKind
from impact_env.methods import Exact, Method
from impact_env.result_files import SavedResult, TableResult
from impact_env.results import DEFAULT_SAMPLES, Record, html_table
from impact_env.scene import Scene
from impact_env.sweep import Stop, Stopped

if TYPE_CHECKING:
    from impact_env.plots import Axes

Array = NDArray[np.float64]
DEFAULT_MEMBERS = 16
BAND = (0.05, 0.95)
# directions of the sweep, the last axis of a curve's arrays
UP = 0
DOWN = 1


@dataclass(frozen=True, eq=False)
class CurveCase:
    """Forces and sweeps of one performance curve.

    Parameters
    ----------
    scene : Scene
        Structure with or without absorber.
    forces : array_like, (F,)
        Force amplitudes in N, or amplitudes in the unit of ``load``.
    resonance : int, optional
        Resonance that is swept up and down, counted from 1.
    limits : (float, float), optional
        Ends of the sweeps as ratios to the resonance frequency.
    percent_per_100_periods : float, optional
        Sweep rate in % of the resonance frequency per 100 pseudo periods. Default:
        `impact_env.drive.default_rate`.
    load : callable, optional
        ``load(force, schedule)`` returns the `Drive` or `Loads` of a run, proportional to the first
        argument; that is an acceleration in m/s^2 where it moves the base. Default: `Drive`.
    steady_start : bool, optional
        Start each sweep in the steady state of the linear structure instead of at rest.

    Raises
    ------
    ParameterError
        A value is out of range, or the structure lacks the resonance.

    Examples
    --------
    >>> from impact_env import CurveCase, beam_scene, impact_absorber
    >>> case = CurveCase(beam_scene(absorber=impact_absorber()), [1.0, 2.0, 4.0])
    >>> [round(schedule.periods) for schedule in case.schedules()]
    [1600, 1600]
    """

    scene: Scene
    forces: Array
    resonance: int = 1
    limits: tuple[float, float] = PAPER_LIMITS
    percent_per_100_periods: float = None  # type: ignore[assignment]  # replaced by `default_rate`
    load: Callable[[float, FrequencySchedule], Excitation] = Drive
    steady_start: bool = False

    def __post_init__(self) -> None:
        allowed = "a row of finite forces in N, 0 or above"
        check_fields(
            self, scene=kind_of(Scene), forces=row_of(allowed), limits=two, steady_start=flag
        )
        ok = self.forces.size > 0 and bool(np.all(self.forces >= 0))
        require(ok, "forces", self.forces.tolist(), allowed)
        model = self.scene.model
        check_fields(self, resonance=lambda _name, value: model.check_resonance(value))
        require(callable(self.load), "load", self.load, "a function of a force in N and a schedule")
        if self.percent_per_100_periods is None:
            object.__setattr__(
                self, "percent_per_100_periods", default_rate(model, (self.resonance,))
            )
        check_fields(self, percent_per_100_periods=positive)
        self.schedules()

    def schedules(self) -> tuple[FrequencySchedule, FrequencySchedule]:
        """Return the sweep up and the sweep down."""
        omega = self.scene.model.resonance_omega(self.resonance)
        (low, high) = self.limits
        return linear_sweep(omega, low, high, self.percent_per_100_periods), linear_sweep(
            omega, high, low, self.percent_per_100_periods
        )

    def drive(
        self, drawn: Members, member: int, amplitude: float, schedule: FrequencySchedule
    ) -> Excitation:
        """Return the drive or the loads of one run."""
        own = Member(member, float(drawn.phases[member]), float(drawn.factors[member]))
        return self.load(amplitude, schedule).member(own)

    def amplitudes(self) -> Array:
        """Return the force amplitudes to run in N, (F,).

        A linear scene is run at a single force of 1 N, because its level is proportional to the
        force.
        """
        return np.ones(1) if self.scene.kind is SceneKind.LINEAR else self.forces


@dataclass(frozen=True, eq=False)
class Optimum:
    """The force with the smallest median level relative to a reference.

    Bands are the 5 to 95 % intervals over the members.

    Attributes
    ----------
    force, force_band : float and (float, float)
        The force, and the band of the members' own best forces, in N.
    level, level_band : float and (float, float)
        Median and band of the response level at ``force``, in m.
    relative, relative_band : float and (float, float)
        Median and band of the level over the reference's.
    """

    force: float
    force_band: tuple[float, float]
    level: float
    level_band: tuple[float, float]
    relative: float
    relative_band: tuple[float, float]


@dataclass(frozen=True, eq=False)
class PerformanceCurve(SavedResult, TableResult):
    """Response levels over the force, as returned by `performance_curve`.

    Runs that are missing after an interruption are NaN.

    Attributes
    ----------
    forces : array, (F,)
        Force amplitudes in N.
    members : Members
        Phases and factors of the M members.
    lanes : LaneLevels
        Levels, impacts and stuck times of all runs, (F, M, 2): force, member, sweep up or down.
    """

    forces: Array
    members: Members
    lanes: LaneLevels

    @property
    def level(self) -> Array:
        """Response level in m, (F, M, 2)."""
        return self.lanes.level

    @property
    def complete(self) -> bool:
        """Whether all runs of the curve were made."""
        return self.lanes.complete

    @property
    def combined(self) -> Array:
        """The larger level of the two sweep directions in m, (F, M), as in the paper's curves.

        NaN unless both levels are known.
        """
        return np.asarray(np.max(self.level, axis=-1))

    @property
    def median(self) -> Array:
        """Median of `combined` over the members in m, (F,)."""
        return quantiles(self.combined, (0.5,))[0]

    @property
    def band(self) -> Array:
        """5 and 95 % quantiles of `combined` over the members in m, (2, F)."""
        return quantiles(self.combined, BAND)

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return all runs as columns of shape (2 F M,), by name.

        The columns are force, member, direction of the sweep, and the results of each run.
        """
        shape = self.level.shape
        force, member, direction = np.indices(shape).reshape(3, -1)
        return {
            "force_n": self.forces[force],
            "member": member,
            "direction": np.where(direction == UP, "up", "down"),
            "level_m": self.lanes.level.ravel(),
            "frequency_ratio": self.lanes.frequency_ratio.ravel(),
            "largest_displacement_m": self.lanes.max_tip.ravel(),
            "impacts": self.lanes.impacts.ravel(),
            "stuck_time_s": self.lanes.stuck_time.ravel(),
        }

    def __repr__(self) -> str:
        return f"PerformanceCurve({', '.join(text for _, text in self._table_rows())})"

    def _table_rows(self) -> list[tuple[str, str]]:
        count = len(self.forces)
        median = 1e3 * self.median[np.isfinite(self.median)]
        forces = (
            f"{count} force{'s' * (count != 1)} from {self.forces.min():.4g} to "
            f"{self.forces.max():.4g} N"
        )
        levels = (
            f"median level {median.min():.4g} to {median.max():.4g} mm"
            if median.size
            else "no level yet"
        )
        runs = f"{self.level.shape[1]} members, each up and down"
        return [
            ("forces", forces),
            ("runs", runs + ("" if self.complete else ", not all of them made")),
            ("level", levels),
        ]

    def _repr_html_(self) -> str:
        """Return the HTML table of a notebook."""
        return html_table("Performance curve", self._table_rows())

    def plot(self, axes: Axes | None = None, label: str | None = None, **options: Any) -> Axes:
        """Draw the median level over the force with its band, and return matplotlib's axes.

        Further curves can be drawn into the same axes. ``options`` are passed to the axes' loglog.
        """
        from impact_env.plots import plot_curve

        return plot_curve(self.forces, self.median, self.band, axes, label, options)

    def relative_to(self, reference: PerformanceCurve) -> Array:
        """Return the ratio of `combined` to that of the same member of a reference, (F, M).

        Raises ParameterError unless the forces and members of both curves agree.
        """
        same = (
            np.array_equal(self.forces, reference.forces)
            and self.members.key == reference.members.key
        )
        require(
            same,
            "reference",
            (reference.forces, reference.members),
            "a curve over the same forces and members",
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.combined / reference.combined)

    def at(self, k: int, reference: PerformanceCurve) -> Optimum:
        """Return the level and the relative level at the force with index ``k``, with their bands.

        The band of the force is that of the members' best forces.
        """
        relative = self.relative_to(reference)
        best = self.forces[np.argmin(np.where(np.isnan(relative), np.inf, relative), axis=0)]
        best = best[~np.isnan(relative).all(axis=0)]
        rows = [quantiles(values[k], (0.5, *BAND)) for values in (self.combined, relative)]
        (level, *level_band), (ratio, *ratio_band) = ([float(x) for x in row] for row in rows)
        low, high = (float(x) for x in quantiles(best, BAND))
        return Optimum(
            float(self.forces[k]),
            (low, high),
            level,
            (level_band[0], level_band[1]),
            ratio,
            (ratio_band[0], ratio_band[1]),
        )

    def optimum(self, reference: PerformanceCurve) -> Optimum | None:
        """Return the force with the smallest median level relative to a reference curve.

        The reference is usually the curve without absorber. None if no run is finished yet.
        """
        relative = quantiles(self.relative_to(reference), (0.5,))[0]
        return None if np.isnan(relative).all() else self.at(int(np.nanargmin(relative)), reference)


def quantiles(values: ArrayLike, wanted: Sequence[float]) -> Array:
    """Return the ``wanted`` quantiles (0 to 1) over the last axis, as first axis of the result.

    NaN values are ignored. Where no value is left, the result is NaN.
    """
    rows = np.atleast_1d(numbers("values", values, "numbers, NaN for what is missing"))
    allowed = "a row of numbers from 0 to 1"
    wanted = row("wanted", wanted, allowed).tolist()
    require(all(0 <= q <= 1 for q in wanted), "wanted", wanted, allowed)
    result = np.full((len(wanted), *rows.shape[:-1]), np.nan)
    for index in np.ndindex(rows.shape[:-1]):
        present = rows[index][~np.isnan(rows[index])]
        if present.size:
            result[(slice(None), *index)] = np.quantile(present, wanted)
    return result


def performance_curves(
    cases: Sequence[CurveCase],
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    method: Method | None = None,
    *,
    threads: int | None = None,
    samples_per_period: int = DEFAULT_SAMPLES,
    progress: LaneProgress | None = None,
    most_events: int | None = None,
    executor: Executor | None = None,
) -> list[PerformanceCurve]:
    """Compute several performance curves together, in one pool of threads or by an executor.

    ``members`` and ``seed`` define the ensemble of all curves (`draw_members`). The arguments after
    ``seed`` and the errors are those of `run_lanes`. Returns a curve for each case.

    The member is the outermost loop, so an interrupted computation leaves all curves with fewer
    members.
    """
    drawn = draw_members(members, seed)
    sweeps = [(case, case.schedules(), case.amplitudes()) for case in cases]
    lanes = [
        Lane(case.scene, case.drive(drawn, member, float(amplitude), schedule), case.steady_start)
        for member in range(members)
        for case, schedules, amplitudes in sweeps
        for schedule in schedules
        for amplitude in amplitudes
    ]
    levels = run_lanes(
        lanes,
        method,
        threads=threads,
        samples_per_period=samples_per_period,
        progress=progress,
        most_events=most_events,
        executor=executor,
    )
    ends = np.cumsum([0] + [2 * len(amplitudes) for _, _, amplitudes in sweeps])
    return [
        PerformanceCurve(case.forces, drawn, _select_case(case, levels, members, start, stop))
        for case, start, stop in zip(cases, ends, ends[1:], strict=False)
    ]


def _select_case(
    case: CurveCase, levels: LaneLevels, members: int, start: int, stop: int
) -> LaneLevels:
    """Return the results of one case, arrays (F, M, 2), from those of all lanes.

    Of the lanes of each member the case has those from ``start`` to ``stop``. Levels of a linear
    scene, which was run at 1 N, are multiplied by the force.
    """
    shape = (len(case.forces), members, 2)
    arrays = {}
    for name in (field.name for field in fields(LaneLevels) if field.name != "complete"):
        share = (
            getattr(levels, name)
            .reshape(members, -1)[:, start:stop]
            .reshape(members, 2, -1)
            .transpose(2, 0, 1)
        )
        scale = (
            case.forces[:, None, None]
            if case.scene.kind is SceneKind.LINEAR and name in ("level", "max_tip")
            else 1.0
        )
        arrays[name] = np.array(np.broadcast_to(share * scale, shape))
    return LaneLevels(**arrays, complete=not np.isnan(arrays["level"]).any())


def performance_curve(
    scene: Scene,
    forces: ArrayLike,
    resonance: int = 1,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    method: Method | None = None,
    *,
    limits: tuple[float, float] = PAPER_LIMITS,
    percent_per_100_periods: float | None = None,
    threads: int | None = None,
    samples_per_period: int = DEFAULT_SAMPLES,
    progress: LaneProgress | None = None,
    most_events: int | None = None,
    steady_start: bool = False,
) -> PerformanceCurve:
    """Compute a performance curve: the response level over the force, with a band over an ensemble.

    Parameters
    ----------
    scene : Scene
        Structure with or without absorber.
    forces : array_like, (F,)
        Force amplitudes in N.
    resonance : int, optional
        Resonance that is swept, counted from 1.
    members : int, optional
        Members M of the ensemble. They differ in the phase of the force and, by a millionth at
        most, in its amplitude, since levels in the impact regimes are random (paper, section 3.3).
    seed : int, optional
        Seed of the members.
    method : Exact, Moreau or RungeKutta, optional
        Integration method (default: `Exact`).
    limits : (float, float), optional
        Ends of the sweeps as ratios to the resonance frequency.
    percent_per_100_periods : float, optional
        Sweep rate in % of the resonance frequency per 100 pseudo periods. Default:
        `impact_env.drive.default_rate`, which suits the damping of the resonance.
    threads : int, optional
        Threads (default: all cores). The result does not depend on it.
    samples_per_period : int, optional
        Samples of the level in a pseudo period.
    progress : callable, optional
        ``progress(done, total)`` is called after each run.
    most_events : int, optional
        Budget of each run, see `simulate`.
    steady_start : bool, optional
        Start each sweep in the steady state of the linear structure instead of at rest.

    Returns
    -------
    PerformanceCurve
        Levels (F, M, 2) in m of the sweeps up and down; `PerformanceCurve.median` and
        `PerformanceCurve.band` are over the members.

    Raises
    ------
    ParameterError
        A value is out of range, or the method cannot integrate the scene.
    IntegrationError
        A run failed or used up its budget.

    See Also
    --------
    curve_passes : the same curve, coarse first and then refined.

    Examples
    --------
    >>> from impact_env import Beam, beam_scene, impact_absorber, performance_curve
    >>> absorber = impact_absorber(gap=1e-3, restitution=0.7, friction_limit=0.1)
    >>> scene = beam_scene(Beam(modes=2), absorber)
    >>> curve = performance_curve(
    ...     scene, [6.0, 12.0], members=2, limits=(0.98, 1.0), percent_per_100_periods=20.0
    ... )
    >>> curve.median.shape
    (2,)
    >>> bool(curve.median[1] > curve.median[0])
    True
    """
    rate: Any = percent_per_100_periods
    case = CurveCase(scene, forces, resonance, limits, rate, steady_start=steady_start)  # type: ignore[arg-type]  # made an array there
    (curve,) = performance_curves(
        [case],
        members,
        seed,
        method,
        threads=threads,
        samples_per_period=samples_per_period,
        progress=progress,
        most_events=most_events,
    )
    return curve


@dataclass(frozen=True)
class Pass:
    """One pass over a performance curve: how many forces and members, and how fast the sweeps.

    Passes are arguments of `curve_passes`.

    Parameters
    ----------
    forces : int, optional
        Number of forces, spread over the case's. None: all of them.
    faster : float, optional
        Factor on the sweep rate of the case.
    members : int, optional
        Number of members of the ensemble.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import Pass
    >>> Pass(forces=4, faster=5.0).members
    1
    """

    forces: int | None = None
    faster: float = 1.0
    members: int = 1

    def __post_init__(self) -> None:
        if self.forces is not None:
            check_fields(self, forces=count_from(1))
        check_fields(self, faster=positive, members=count_from(1, MOST_MEMBERS))


LANES_PER_REPORT = 0.05  # s between two partial curves of a pass
_Run = tuple[int, int, int]  # force, member, direction


class Measure(Protocol):
    """Function that runs a lane and measures it, in place of the response level."""

    def __call__(self, lane: Lane, stop: Stop) -> tuple[float, ...]:
        """Run a lane; return the six numbers of `LaneLevels`, NaN for unknown ones."""


def curve_passes(
    case: CurveCase,
    passes: Sequence[Pass],
    stop: Stop | None = None,
    *,
    seed: int = 0,
    method: Method | None = None,
    threads: int | None = None,
    samples_per_period: int = DEFAULT_SAMPLES,
    measure: Measure | None = None,
    both_ways: bool = True,
) -> Generator[tuple[Pass, PerformanceCurve], None, None]:
    """Yield a performance curve while it is computed, rough first.

    Parameters
    ----------
    case : CurveCase
        Forces and sweeps.
    passes : sequence of Pass
        Passes in the order of computation, such as ``[Pass(4, 5.0), Pass(), Pass(members=8)]``.
        A run that an earlier pass has made is not made again.
    stop : Stop, optional
        Ends the runs from any other thread, as the iterator's ``close()`` does.
    seed : int, optional
        Seed of the members.
    method : Exact, Moreau or RungeKutta, optional
        Integration method (default: `Exact`).
    threads : int, optional
        Threads (default: all cores). The result does not depend on it.
    samples_per_period : int, optional
        Samples of the level in a pseudo period.
    measure : callable, optional
        ``measure(lane, stop)`` runs a lane and returns the six numbers of `LaneLevels`. Default:
        the response level of `simulate`.
    both_ways : bool, optional
        Run sweeps up and down. False for a load that is the same in both directions, such as a
        random load: each run then counts for both.

    Yields
    ------
    tuple of Pass and PerformanceCurve
        The pass, and the curve so far at the pass's forces, NaN where a run is missing. The last
        curve of a pass has all runs: the numbers of `performance_curve` at that rate. After
        ``stop`` one last curve follows, with NaN for the runs that were not made.

    Raises
    ------
    ParameterError, IntegrationError
        As `simulate`.

    Examples
    --------
    >>> from impact_env import Beam, CurveCase, Pass, Scene, curve_passes, modal_model
    >>> case = CurveCase(Scene(modal_model(Beam(modes=2))), [1.0, 2.0, 4.0], limits=(0.98, 1.0))
    >>> for one, curve in curve_passes(case, [Pass(2, 100.0), Pass(faster=100.0)]):
    ...     complete = curve.forces.tolist()
    >>> complete
    [1.0, 2.0, 4.0]
    """
    case = instance("case", case, CurveCase)
    stop = instance("stop", stop, Stop | None)
    passes = [instance("passes", one, Pass) for one in listed("passes", passes)]
    method = Exact() if method is None else method
    workers = available_cores() if threads is None else count("threads", threads, 1)
    drawn = draw_members(max((one.members for one in passes), default=1), seed)
    order = Stop() if stop is None else stop
    of = (
        LevelOf(method, Record(samples_per_period=samples_per_period), None, order)
        if measure is None
        else partial(measure, stop=order)
    )
    known: dict[float, dict[_Run, tuple[float, ...]]] = {}
    with ThreadPoolExecutor(workers) as pool:
        try:
            for one in passes:
                result = known.setdefault(one.faster, {})
                yield from (
                    (one, curve)
                    for curve in _run_pass(
                        case, one, drawn, of, pool, result, (UP, DOWN if both_ways else UP)
                    )
                )
                if order.given:
                    return
        finally:
            if order is not stop:
                order.give()
            pool.shutdown(wait=True, cancel_futures=True)


def _run_pass(
    case: CurveCase,
    one: Pass,
    drawn: Members,
    measure: Callable[[Lane], tuple[float, ...]],
    pool: ThreadPoolExecutor,
    result: dict[_Run, tuple[float, ...]],
    ways: tuple[int, int],
) -> Iterator[PerformanceCurve]:
    """Compute the missing runs of a pass, and yield the curve repeatedly and at the end.

    Runs whose level is in ``result`` are not computed again; new ones are added to it. Coarse grids
    of forces come first.

    ``ways``: the directions whose runs count for up and for down; both `UP` if the load is the same
    in both directions.
    """
    total = len(case.forces)
    linear = case.scene.kind is SceneKind.LINEAR
    here = np.unique(np.linspace(0, total - 1, min(one.forces or total, total)).round().astype(int))
    schedules = replace(
        case, percent_per_100_periods=one.faster * case.percent_per_100_periods
    ).schedules()
    wanted = [
        (int(k), m, d)
        for m in range(one.members)
        for k in ([0] if linear else here[_order_coarse_to_fine(len(here))])
        for d in dict.fromkeys(ways)
    ]

    def run(which: _Run) -> None:
        k, m, d = which
        result[which] = measure(
            Lane(
                case.scene,
                case.drive(drawn, m, 1.0 if linear else float(case.forces[k]), schedules[d]),
                case.steady_start,
            )
        )

    def curve() -> PerformanceCurve:
        values = np.full((6, len(here), one.members, 2), np.nan)
        for k, force in enumerate(here):
            for m, d in np.ndindex(one.members, 2):
                values[:, k, m, d] = result.get((0 if linear else int(force), m, ways[d]), np.nan)
        if linear:
            values[[0, 3]] *= case.forces[here][:, None, None]
        level, at, ratio, tip, impacts, stuck = values
        levels = LaneLevels(
            level, at, ratio, tip, impacts, stuck, complete=not np.isnan(level).any()
        )
        return PerformanceCurve(case.forces[here], drawn[: one.members], levels)

    missing = [which for which in wanted if which not in result]
    left: set[Future[None]] = set()
    last_report = time.monotonic()
    for number, which in enumerate(missing):
        left.add(pool.submit(run, which))
        if number == 0:
            wait(left)  # if kernels have to be compiled, other threads would only wait for them
    try:
        while left:
            done, left = wait(left, timeout=LANES_PER_REPORT, return_when=FIRST_COMPLETED)
            for future in done:
                future.result()
            if left and done and time.monotonic() - last_report > LANES_PER_REPORT:
                part = curve()
                if (
                    not part.complete
                ):  # runs may end meanwhile: a whole curve is the last of its pass
                    yield part
                last_report = time.monotonic()
    except Stopped:
        for future in left:
            future.cancel()
        wait(left)
    yield curve()


def _order_coarse_to_fine(number: int) -> list[int]:
    """Return 0 to number - 1 in an order that refines a grid.

    The two ends come first, then points between the earlier ones.
    """
    order = sorted({0, number - 1})
    step = number - 1
    while step > 1:
        step = -(-step // 2)
        order += [k for k in range(0, number, step) if k not in order]
    return order
