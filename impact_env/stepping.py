"""From scene, drive and method to the arrays of the time-stepping kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.kernels import feedback, moreau
from impact_env.kernels.contact_law import Spring, Walls
from impact_env.kernels.feedback import Slider, Stops
from impact_env.kernels.interval import Lanes, Watch
from impact_env.kernels.lanes import moreau_lanes, runge_kutta_lanes
from impact_env.kernels.moreau import moreau_lane
from impact_env.kernels.observers import Counters, Energy, Events, Level, Series
from impact_env.kernels.runge_kutta import runge_kutta_lane
from impact_env.methods import Moreau, RungeKutta, check_supported
from impact_env.parameters import (
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    RigidWalls,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    require,
)
from impact_env.scene import Scene

Array = NDArray[np.float64]


def _writable(row: Array) -> Array:
    """Return a copy: kernels are compiled for writable arrays only, so that no second variant of them is built."""
    return np.array(row, dtype=np.float64, order="C")


def _modes(scene: Scene) -> tuple[Array, Array, Array, Array]:
    model = scene.model
    return _writable(model.omega), _writable(model.damping_ratio), _writable(model.force_shape), _writable(model.tip_shape)


def _drive(drive: Drive) -> tuple[Array, Array, Array, float, float]:
    schedule = drive.schedule
    phases = schedule.phase_at(schedule.times)
    return _writable(schedule.times), _writable(schedule.omegas), _writable(phases), drive.amplitude, drive.phase


def _spring(scene: Scene) -> Spring | None:
    return Spring(scene.absorber.stiffness, scene.absorber.damping) if isinstance(scene.absorber, TunedAbsorber) else None


def _wide(lanes: int, stride: int) -> int | None:
    padded = 4 * -(-lanes // 4)
    return padded if padded > stride else None


def _rigid_laws(scene: Scene) -> tuple[Walls | None, float | None]:
    """Return walls and friction limit (N), absent ones None; a stuck absorber is one whose friction has no limit."""
    absorber = scene.absorber
    if not isinstance(absorber, SlidingAbsorber):
        return None, np.inf if isinstance(absorber, StuckAbsorber) else None
    walls = Walls(absorber.walls.gap, absorber.walls.restitution) if isinstance(absorber.walls, RigidWalls) else None
    return walls, absorber.friction.limit if isinstance(absorber.friction, CoulombFriction) else None


def _compliant_laws(scene: Scene) -> tuple[Stops | None, Slider | None]:
    absorber = scene.absorber
    if not isinstance(absorber, SlidingAbsorber):
        return None, None
    stops = Stops(absorber.walls.gap, absorber.walls.stiffness) if isinstance(absorber.walls, CompliantWalls) else None
    return stops, Slider(absorber.friction.limit, absorber.friction.stiffness) if isinstance(absorber.friction, ElasticCoulombFriction) else None


def _masses(scene: Scene) -> tuple[float | None, float | None]:
    """Return (mass of an absorber that moves, mass added to the tip) in kg."""
    stuck = isinstance(scene.absorber, StuckAbsorber)
    return (None, scene.absorber_mass) if stuck else (scene.absorber_mass, None)


def stepping_lanes(
    scene: Scene, method: Moreau | RungeKutta, watch: Watch, lanes: Lanes, orders: Array, reports: Array, status: NDArray[np.int64]
) -> Callable[[int, int], None]:
    """Return a function that advances the lanes [start, stop) by the intervals in ``orders``; see `impact_env.kernels.interval`.

    Raises ParameterError for scenes that the method cannot do, and for elastic friction, whose slider a step-by-step state does not hold.
    """
    check_supported(scene, method)
    modes, spring, step, rest = _modes(scene), _spring(scene), method.step(scene), (watch, lanes, orders, reports, status)
    if isinstance(method, Moreau):
        walls, limit = _rigid_laws(scene)
        restitution, wide = None if walls is None else walls.restitution, _wide(scene.model.modes, moreau.STRIDE)
        return partial(moreau_lanes, modes, scene.absorber_mass, restitution, limit, spring, step, wide, *rest)
    stops, slider = _compliant_laws(scene)
    require(slider is None, "method", method, "Exact for elastic friction that is controlled in intervals")
    return partial(runge_kutta_lanes, modes, *_masses(scene), stops, spring, step, _wide(scene.model.modes + 1, feedback.STRIDE), *rest)


def run_moreau(
    scene: Scene,
    drive: Drive,
    method: Moreau,
    state: Array,
    sample_dt: float,
    counters: Counters,
    level: Level | None = None,
    events: Events | None = None,
    series: Series | None = None,
    energy: Energy | None = None,
) -> int:
    """Integrate with the Moreau scheme over the whole schedule; ``state`` (2 N_m + 2,) is the start and becomes the end.

    Samples lie ``sample_dt`` (s) apart from time 0. Returns a status code of `impact_env.kernels.observers`; raises ParameterError for
    compliant contact. A stuck absorber is one whose friction has no limit.
    """
    check_supported(scene, method)
    walls, limit = _rigid_laws(scene)
    wide = _wide(scene.model.modes, moreau.STRIDE)
    parts = (scene.absorber_mass, walls, limit, _spring(scene))
    return int(
        moreau_lane(*_modes(scene), *parts, *_drive(drive), state, method.step(scene), sample_dt, counters, level, events, series, energy, wide)
    )


def run_runge_kutta(
    scene: Scene,
    drive: Drive,
    method: RungeKutta,
    state: Array,
    sample_dt: float,
    counters: Counters,
    level: Level | None = None,
    events: Events | None = None,
    series: Series | None = None,
    energy: Energy | None = None,
) -> int:
    """Integrate with the Runge-Kutta method over the whole schedule; ``state`` (2 N_m + 2,) is the start and becomes the end.

    Samples lie ``sample_dt`` (s) apart from time 0. Returns a status code of `impact_env.kernels.observers`; raises ParameterError for
    rigid walls or rigid friction. The slider of elastic friction starts without force.
    """
    check_supported(scene, method)
    stops, slider = _compliant_laws(scene)
    free_mass, added_mass = _masses(scene)
    wide = _wide(scene.model.modes + 1, feedback.STRIDE)
    parts = (free_mass, added_mass, stops, slider, _spring(scene))
    return int(
        runge_kutta_lane(*_modes(scene), *parts, *_drive(drive), state, method.step(scene), sample_dt, counters, level, events, series, energy, wide)
    )
