"""The contents of a frequency response.

They are curves of periodic responses, linear responses, sweeps, and the stationary responses of
many runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import finite, require
from impact_env.drive import Drive, default_rate, linear_sweep
from impact_env.frequency import tip_response
from impact_env.methods import Method
from impact_env.parameters import RigidWalls, SlidingAbsorber, StuckAbsorber
from impact_env.periodic.balance_branches import balance_branches
from impact_env.periodic.branch import INTERRUPTED
from impact_env.periodic.case import case_of
from impact_env.periodic.harmonic_balance import Balance
from impact_env.periodic.isolas import Threshold, find_folds
from impact_env.periodic.keeping import ComputeOrLoad, compute_uncached
from impact_env.periodic.motion import Motion
from impact_env.periodic.offspring import descendants
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.orbit_branches import (
    OrbitBranch,
    compute_distance,
    list_places,
    make_place,
    orbit_branches,
)
from impact_env.periodic.response_curve import ResponseCurve, balance_curve, orbit_curve
from impact_env.periodic.stationary import StationaryPoint, StationaryRuns
from impact_env.results import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate

Real = NDArray[np.float64]
OverviewProgress = Callable[
    [str, int, float], None
]  # what is followed, number of points, frequency in rad/s
LINEAR_POINTS = 801


@dataclass(frozen=True, eq=False)
class LinearCurves:
    """Amplitudes of the tip in m over ``omega_ratio``, (m,) each.

    ``alone`` is that of the beam without absorber, ``stuck`` that with a stuck absorber.
    """

    omega_ratio: Real
    alone: Real
    stuck: Real


@dataclass(frozen=True, eq=False)
class SweepEnvelope:
    """Largest displacement of the tip in m in each pseudo period of a sweep.

    ``tip_max`` (m,) is given over the frequency ratio ``omega_ratio`` (m,).
    """

    omega_ratio: Real
    tip_max: Real

    def to_plain(self) -> dict[str, Any]:
        """Return lists by name, with units in the names."""
        return {"omega_ratio": self.omega_ratio.tolist(), "tip_max_m": self.tip_max.tolist()}

    @staticmethod
    def from_plain(plain: dict[str, Any]) -> SweepEnvelope:
        """Return the sweep of `to_plain`."""
        return SweepEnvelope(
            np.array(plain["omega_ratio"], dtype=np.float64),
            np.array(plain["tip_max_m"], dtype=np.float64),
        )


@dataclass(frozen=True, eq=False)
class Overview:
    """The complete frequency response of one scene under one force (N).

    Frequencies are relative to ``reference`` (rad/s). ``complete`` is False if Ctrl-C ended the
    computation early.
    """

    scene: Scene
    force: float
    reference: float
    curves: tuple[ResponseCurve, ...]
    linear: LinearCurves
    sweeps: tuple[SweepEnvelope, ...]
    stationary: tuple[StationaryPoint, ...]
    complete: bool

    @property
    def where(self) -> str:
        """The place at which all responses are measured, as text."""
        return (
            "of the tip"
            if self.scene.model.response_shape is None
            else "where the response is read"
        )

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings."""
        linear = self.linear
        return {
            "scene": str(self.scene),
            "force_N": self.force,
            "omega_reference_rad_s": self.reference,
            "response": self.where,
            "complete": self.complete,
            "curves": [curve.to_plain() for curve in self.curves],
            "linear": {
                "omega_ratio": linear.omega_ratio.tolist(),
                "alone_m": linear.alone.tolist(),
                "stuck_m": linear.stuck.tolist(),
            },
            "sweeps": [sweep.to_plain() for sweep in self.sweeps],
            "stationary": [at.to_plain() for at in self.stationary],
        }


def require_sliding(scene: Scene) -> SlidingAbsorber:
    """Return the scene's absorber, which must have walls, friction or both.

    Raises ParameterError for any other absorber.
    """
    absorber = scene.absorber
    require(
        isinstance(absorber, SlidingAbsorber),
        "absorber",
        absorber,
        "one absorber with walls, friction or both",
    )
    assert isinstance(absorber, SlidingAbsorber)
    return absorber


def linear_curves(
    scene: Scene, force: float, reference: float, low: float, high: float
) -> LinearCurves:
    """Return the linear responses between two ratios of ``reference`` (rad/s)."""
    ratio = np.linspace(low, high, LINEAR_POINTS)
    stuck = StuckAbsorber(require_sliding(scene).mass_ratio)
    alone, held = (
        abs(force) * np.abs(tip_response(scene.model, absorber, ratio * reference))
        for absorber in (None, stuck)
    )
    return LinearCurves(ratio, alone, held)


def _rate(scene: Scene, reference: float) -> float:
    return default_rate(scene.model, (int(np.argmin(np.abs(scene.model.omega - reference))) + 1,))


def sweep_envelope(
    scene: Scene,
    force: float,
    reference: float,
    start: float,
    stop: float,
    percent_per_100_periods: float | None = None,
    method: Method | None = None,
    phase: float = 0.0,
) -> SweepEnvelope:
    """Return the envelope of a sweep from rest.

    The sweep goes from one ratio of ``reference`` (rad/s) to another at a rate of
    ``percent_per_100_periods`` (None: the rate that suits the damping of the resonance nearest to
    ``reference``). ``phase`` is the force's initial phase in rad. ``method`` and errors are as in
    `simulate`.
    """
    if percent_per_100_periods is None:
        percent_per_100_periods = _rate(scene, reference)
    schedule = linear_sweep(reference, start, stop, percent_per_100_periods)
    response = simulate(
        scene, Drive(force, schedule, phase), method, record=Record(level=False, series=True)
    )
    history = response.history
    assert history is not None
    period = np.floor(history.time / schedule.pseudo_period).astype(np.int64)
    first = np.flatnonzero(np.diff(period, prepend=-1))
    largest = np.maximum.reduceat(
        np.abs(history.modal_displacement @ scene.model.level_shape), first
    )
    return SweepEnvelope(np.asarray(schedule.omega_at(history.time[first])) / reference, largest)


def exact_curves(
    scene: Scene,
    force: float,
    reference: float,
    low: float,
    high: float,
    pairs: bool = False,
    progress: OverviewProgress | None = None,
) -> Iterator[ResponseCurve]:
    """Yield the curves of symmetric orbits with one impact at each wall between two ratios.

    Nothing is yielded for an absorber without rigid walls. Their folds are those of
    `isolas.find_folds`. ``pairs``: include the orbits without symmetry, and those of doubled
    periods, that emerge from them.
    """
    if not isinstance(require_sliding(scene).walls, RigidWalls):
        return
    case = case_of(scene, force, low * reference)
    limits = (low * reference, high * reference)
    branches = tuple(orbit_branches(case, *limits, progress=progress))
    first = float(case.model.omega[0])
    stopped = any(branch.branch.ended == INTERRUPTED for branch in branches)
    located = (
        []
        if stopped
        else _by_branch(branches, find_folds(case, limits[0] / first, limits[1] / first, branches))
    )
    for k, branch in enumerate(branches):
        yield orbit_curve(branch, reference, located[k] if located else None)
    if stopped:
        raise KeyboardInterrupt
    for pair in descendants(branches, limits) if pairs else ():
        if isinstance(pair, OrbitBranch):
            yield orbit_curve(pair, reference)
            if pair.branch.ended == INTERRUPTED:
                raise KeyboardInterrupt


def _by_branch(
    branches: tuple[OrbitBranch, ...], result: tuple[Threshold, ...]
) -> list[list[Motion]]:
    """Return the folds that are orbits, in a list for each branch."""
    places = [list_places(branch) for branch in branches]
    groups = list[list[Motion]]([] for _ in branches)
    for fold in result:
        if isinstance(fold.orbit, Orbit) and isinstance(fold.orbit.motion, Motion) and branches:
            point = make_place(fold.orbit.solution)
            groups[int(np.argmin([compute_distance(rows, point) for rows in places]))].append(
                fold.orbit.motion
            )
    return groups


def balance_curves(
    balance: Balance,
    reference: float,
    low: float,
    high: float,
    progress: OverviewProgress | None = None,
    hill: bool = False,
) -> Iterator[ResponseCurve]:
    """Yield the curves of harmonic balance between two ratios, with ``hill`` their stability."""
    for branch in balance_branches(balance, low * reference, high * reference, progress=progress):
        yield balance_curve(balance, branch, reference, hill)
        if branch.ended == INTERRUPTED:
            raise KeyboardInterrupt


@dataclass(frozen=True, eq=False)
class OverviewOptions:
    """Parts of an overview in addition to the linear responses.

    Attributes
    ----------
    exact : bool
        Exact orbits.
    pairs : bool
        Also exact orbits without symmetry.
    balance : Balance or None
        Harmonic balance.
    sweeps : tuple of (float, float)
        First and last frequency ratio of each sweep.
    percent_per_100_periods : float or None
        Rate of the sweeps. None: the rate that suits the damping.
    runs : StationaryRuns or None
        Stationary responses of many runs.
    hill : bool
        Stability of harmonic balance.
    """

    exact: bool = False
    pairs: bool = False
    balance: Balance | None = None
    sweeps: tuple[tuple[float, float], ...] = ()
    percent_per_100_periods: float | None = None
    runs: StationaryRuns | None = None
    hill: bool = False


def compute_overview(
    scene: Scene,
    force: float,
    reference: float,
    low: float,
    high: float,
    options: OverviewOptions,
    progress: OverviewProgress | None = None,
    keep: ComputeOrLoad = compute_uncached,
) -> Overview:
    """Return the frequency response of a scene between two ratios of ``reference`` (rad/s).

    ``force`` is in N. The response contains the linear curves and the parts that ``options``
    selects. ``keep`` stores and reads finished pieces. After Ctrl-C the finished pieces are
    returned. Raises ParameterError for bad values.
    """
    force = finite("force", force)
    require(
        0 < low < high,
        "frequency range",
        (low, high),
        "two ratios of the resonance frequency above 0, the lower one first",
    )
    curves: list[ResponseCurve] = []
    sweeps: list[SweepEnvelope] = []
    stationary: list[StationaryPoint] = []
    linear = linear_curves(scene, force, reference, low, high)
    complete = True
    ends = {"range": [low, high]}

    def swept(start: float, stop: float, rate: float) -> Iterator[SweepEnvelope]:
        if progress is not None:
            progress(f"sweep {start:g} to {stop:g}", 0, start * reference)
        yield sweep_envelope(scene, force, reference, start, stop, rate)

    def settled(runs: StationaryRuns, ratio: float) -> Iterator[StationaryPoint]:
        if progress is not None:
            progress(f"{runs.members} runs", 0, ratio * reference)
        yield runs.at(scene, force, reference, ratio)

    try:
        if options.exact:
            exact = partial(
                exact_curves, scene, force, reference, low, high, options.pairs, progress
            )
            curves.extend(
                keep(
                    {"piece": "exact", **ends, "pairs": options.pairs},
                    exact,
                    ResponseCurve.from_plain,
                )
            )
        if options.balance is not None:
            linear_part = options.balance.linear
            law = repr(options.balance.law)
            name = {
                "piece": "balance",
                **ends,
                "harmonics": linear_part.harmonics,
                "law": law,
                "damper": linear_part.grounded_damper,
                "hill": options.hill,
            }
            curves.extend(
                keep(
                    name,
                    partial(
                        balance_curves,
                        options.balance,
                        reference,
                        low,
                        high,
                        progress,
                        options.hill,
                    ),
                    ResponseCurve.from_plain,
                )
            )
        rate = (
            _rate(scene, reference)
            if options.percent_per_100_periods is None
            else options.percent_per_100_periods
        )
        for start, stop in options.sweeps:
            name = {"piece": "sweep", "from": start, "to": stop, "rate": rate}
            sweeps.extend(keep(name, partial(swept, start, stop, rate), SweepEnvelope.from_plain))
        if options.runs is not None:
            for ratio in options.runs.ratios(low, high):
                name = {"piece": "stationary", "at": ratio, **options.runs.settings}
                stationary.extend(
                    keep(name, partial(settled, options.runs, ratio), StationaryPoint.from_plain)
                )
    except KeyboardInterrupt:
        complete = False
    return Overview(
        scene, force, reference, tuple(curves), linear, tuple(sweeps), tuple(stationary), complete
    )
