"""From scene, drive and method to the arrays of the time-stepping kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.kernels import feedback, moreau
from impact_env.kernels.contact_law import Spring, Walls
from impact_env.kernels.feedback import Slider, Stops
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
    absorber = scene.absorber
    walls, limit = None, None
    if isinstance(absorber, StuckAbsorber):
        limit = np.inf
    if isinstance(absorber, SlidingAbsorber):
        walls = Walls(absorber.walls.gap, absorber.walls.restitution) if isinstance(absorber.walls, RigidWalls) else None
        limit = absorber.friction.limit if isinstance(absorber.friction, CoulombFriction) else None
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
    absorber = scene.absorber
    stops, slider = None, None
    if isinstance(absorber, SlidingAbsorber):
        stops = Stops(absorber.walls.gap, absorber.walls.stiffness) if isinstance(absorber.walls, CompliantWalls) else None
        slider = Slider(absorber.friction.limit, absorber.friction.stiffness) if isinstance(absorber.friction, ElasticCoulombFriction) else None
    stuck = isinstance(absorber, StuckAbsorber)
    free_mass, added_mass = (None, scene.absorber_mass) if stuck else (scene.absorber_mass, None)
    wide = _wide(scene.model.modes + 1, feedback.STRIDE)
    parts = (free_mass, added_mass, stops, slider, _spring(scene))
    return int(
        runge_kutta_lane(*_modes(scene), *parts, *_drive(drive), state, method.step(scene), sample_dt, counters, level, events, series, energy, wide)
    )
