"""What a frequency response shows: curves of periodic responses, the linear ones, and sweeps over them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import PAPER_RATE, Drive, linear_sweep
from impact_env.frequency import tip_response
from impact_env.methods import Method
from impact_env.parameters import RigidWalls, SlidingAbsorber, StuckAbsorber, finite, require
from impact_env.periodic.balance_branches import balance_branches
from impact_env.periodic.branch import STOPPED
from impact_env.periodic.case import case_of
from impact_env.periodic.harmonic_balance import Balance
from impact_env.periodic.orbit_branches import orbit_branches
from impact_env.periodic.response_curve import ResponseCurve, balance_curve, orbit_curve
from impact_env.periodic.switching import asymmetric_branches
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.sweep import simulate

Real = NDArray[np.float64]
Progress = Callable[[str, int, float], None]  # what is followed, number of points, frequency in rad/s
LINEAR_POINTS = 801


@dataclass(frozen=True, eq=False)
class LinearCurves:
    """Amplitudes of the tip (m,) in m over ``omega_ratio`` (m,): of the beam alone and with a stuck absorber."""

    omega_ratio: Real
    alone: Real
    stuck: Real


@dataclass(frozen=True, eq=False)
class SweepEnvelope:
    """Largest displacement of the tip (m,) in m in each pseudo period of a sweep, over its frequency (m,)."""

    omega_ratio: Real
    tip_max: Real


@dataclass(frozen=True, eq=False)
class Overview:
    """All of it for one scene and force (N); frequencies over ``reference`` (rad/s). ``complete`` is False if Ctrl-C ended the work early."""

    scene: Scene
    force: float
    reference: float
    curves: tuple[ResponseCurve, ...]
    linear: LinearCurves
    sweeps: tuple[SweepEnvelope, ...]
    complete: bool

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings."""
        linear, sweeps = self.linear, self.sweeps
        return {
            "scene": str(self.scene),
            "force_N": self.force,
            "omega_reference_rad_s": self.reference,
            "complete": self.complete,
            "curves": [curve.to_plain() for curve in self.curves],
            "linear": {"omega_ratio": linear.omega_ratio.tolist(), "alone_m": linear.alone.tolist(), "stuck_m": linear.stuck.tolist()},
            "sweeps": [{"omega_ratio": s.omega_ratio.tolist(), "tip_max_m": s.tip_max.tolist()} for s in sweeps],
        }


def sliding(scene: Scene) -> SlidingAbsorber:
    """Return the scene's absorber; raises ParameterError if it is not one with walls, friction or both."""
    absorber = scene.absorber
    require(isinstance(absorber, SlidingAbsorber), "absorber", absorber, "one absorber with walls, friction or both")
    assert isinstance(absorber, SlidingAbsorber)
    return absorber


def linear_curves(scene: Scene, force: float, reference: float, low: float, high: float) -> LinearCurves:
    """Return the linear responses between two ratios of ``reference`` (rad/s)."""
    ratio = np.linspace(low, high, LINEAR_POINTS)
    stuck = StuckAbsorber(sliding(scene).mass_ratio)
    alone, held = (abs(force) * np.abs(tip_response(scene.model, absorber, ratio * reference)) for absorber in (None, stuck))
    return LinearCurves(ratio, alone, held)


def sweep_envelope(
    scene: Scene,
    force: float,
    reference: float,
    start: float,
    stop: float,
    percent_per_100_periods: float = PAPER_RATE,
    method: Method | None = None,
    phase: float = 0.0,
) -> SweepEnvelope:
    """Return the envelope of a sweep from rest, from one ratio of ``reference`` (rad/s) to another; ``method`` and errors as `simulate`.

    ``phase``: the force's initial one in rad.
    """
    schedule = linear_sweep(reference, start, stop, percent_per_100_periods)
    response = simulate(scene, Drive(force, schedule, phase), method, record=Record(level=False, series=True))
    history = response.history
    assert history is not None
    period = np.floor(history.time / schedule.pseudo_period).astype(np.int64)
    first = np.flatnonzero(np.diff(period, prepend=-1))
    largest = np.maximum.reduceat(np.abs(history.tip_displacement), first)
    return SweepEnvelope(np.asarray(schedule.omega_at(history.time[first])) / reference, largest)


def exact_curves(
    scene: Scene, force: float, reference: float, low: float, high: float, pairs: bool = False, progress: Progress | None = None
) -> Iterator[ResponseCurve]:
    """Yield the curves of symmetric orbits with one impact a wall between two ratios; none for an absorber without rigid walls.

    ``pairs``: with those of the pairs without symmetry that leave them.
    """
    if isinstance(sliding(scene).walls, RigidWalls):
        case = case_of(scene, force, low * reference)
        for branch in orbit_branches(case, low * reference, high * reference, progress=progress):
            yield orbit_curve(branch, reference)
            if branch.branch.ended == STOPPED:
                raise KeyboardInterrupt
            for pair in asymmetric_branches(branch, (low * reference, high * reference)) if pairs else ():
                yield orbit_curve(pair, reference)
                if pair.branch.ended == STOPPED:
                    raise KeyboardInterrupt


def balance_curves(balance: Balance, reference: float, low: float, high: float, progress: Progress | None = None) -> Iterator[ResponseCurve]:
    """Yield the curves of harmonic balance between two ratios."""
    for branch in balance_branches(balance, low * reference, high * reference, progress=progress):
        yield balance_curve(balance, branch, reference)
        if branch.ended == STOPPED:
            raise KeyboardInterrupt


def overview(
    scene: Scene,
    force: float,
    reference: float,
    low: float,
    high: float,
    exact: bool,
    balance: Balance | None,
    sweeps: tuple[tuple[float, float], ...],
    percent_per_100_periods: float = PAPER_RATE,
    progress: Progress | None = None,
    pairs: bool = False,
) -> Overview:
    """Return the frequency response of a scene between two ratios of ``reference`` (rad/s) under a force in N.

    ``exact``: with exact orbits, ``pairs``: also those without symmetry; ``balance``: with harmonic balance, None:
    without; ``sweeps``: pairs of ratios, from and to. Ctrl-C ends it with
    what is known so far. Raises ParameterError for bad values.
    """
    finite("force", force)
    require(0 < low < high, "frequency range", (low, high), "two ratios of the resonance frequency above 0, the lower one first")
    curves: list[ResponseCurve] = []
    envelopes: list[SweepEnvelope] = []
    linear, complete = linear_curves(scene, force, reference, low, high), True
    try:
        if exact:
            curves.extend(exact_curves(scene, force, reference, low, high, pairs, progress))
        if balance is not None:
            curves.extend(balance_curves(balance, reference, low, high, progress))
        for start, stop in sweeps:
            if progress is not None:
                progress(f"sweep {start:g} to {stop:g}", 0, start * reference)
            envelopes.append(sweep_envelope(scene, force, reference, start, stop, percent_per_100_periods))
    except KeyboardInterrupt:
        complete = False
    return Overview(scene, force, reference, tuple(curves), linear, tuple(envelopes), complete)
