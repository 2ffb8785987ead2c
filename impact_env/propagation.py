"""From scene and drive to the arrays of the exact kernels; linear scenes go to the closed form, which has no events at all."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.kernels.compliant import Springs, compliant_lane
from impact_env.kernels.contact_law import Walls
from impact_env.kernels.exact import exact_lane
from impact_env.kernels.interval import Lanes, Watch
from impact_env.kernels.lanes import compliant_lanes, linear_lanes, rigid_lanes
from impact_env.kernels.linear import linear_lane
from impact_env.kernels.observers import Counters, Energy, Events, Level, Series
from impact_env.kernels.rigid_contact import Contact
from impact_env.kernels.segments import Losses, Regime, Schedule
from impact_env.kernels.sets import Absorbers, Sets
from impact_env.kernels.several import several_lane
from impact_env.parameters import (
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
)
from impact_env.regime_sets import regime_sets
from impact_env.regimes import fastest, free_regime, joined_regime, padded_size, sprung_regime
from impact_env.scene import Scene
from impact_env.tables import table_reach

Array = NDArray[np.float64]
WINDOW_PERIODS = 3.2  # wanted length of a window of the chirp, in pseudo periods


def is_linear(scene: Scene) -> bool:
    """Return whether a scene is one linear regime."""
    return not isinstance(scene.absorber, SlidingAbsorber | SeveralAbsorbers)


def _stiffnesses(absorber: SlidingAbsorber) -> tuple[float, float]:
    """Return wall and friction stiffness in N/m of a compliant scene, 0 where absent."""
    wall = absorber.walls.stiffness if isinstance(absorber.walls, CompliantWalls) else 0.0
    return wall, absorber.friction.stiffness if isinstance(absorber.friction, ElasticCoulombFriction) else 0.0


def is_compliant(scene: Scene) -> bool:
    """Return whether a scene's contacts are springs."""
    return isinstance(scene.absorber, SlidingAbsorber) and any(_stiffnesses(scene.absorber))


@lru_cache(maxsize=256)
def _linear(scene: Scene, wanted: float) -> tuple[Regime, float]:
    model, absorber = scene.model, scene.absorber
    mass, spring = scene.absorber_mass, (absorber.stiffness, absorber.damping) if isinstance(absorber, TunedAbsorber) else (None, 0.0)
    speed, slots = fastest(model, mass, *spring)
    size, reach = padded_size(slots), table_reach(speed, wanted)
    if mass is None:
        return free_regime(model, size, reach), reach
    if isinstance(absorber, StuckAbsorber):
        return joined_regime(model, mass, size, reach), reach
    return sprung_regime(model, mass, absorber.stiffness, absorber.damping, size, reach), reach  # type: ignore[union-attr]


@lru_cache(maxsize=256)
def rigid_regimes(scene: Scene, wanted: float) -> tuple[Regime, Regime, float]:
    """Return the free and the joined regime of a scene with rigid contact, and the reach of their tables in s: ``wanted`` or less."""
    assert scene.absorber_mass is not None
    bounds = (fastest(scene.model), fastest(scene.model, scene.absorber_mass))
    size = padded_size(max(slots for _, slots in bounds))
    reach = table_reach(max(speed for speed, _ in bounds), wanted)
    return free_regime(scene.model, size, reach), joined_regime(scene.model, scene.absorber_mass, size, reach), reach


@lru_cache(maxsize=256)
def _compliant(scene: Scene, wanted: float) -> tuple[Regime, tuple[Regime, Regime, Regime], float]:
    """Return the free regime and those with the wall's spring, with the friction's spring, and with both; an absent one repeats another."""
    model, mass, absorber = scene.model, scene.absorber_mass, scene.absorber
    assert mass is not None
    assert isinstance(absorber, SlidingAbsorber)
    wall, friction = _stiffnesses(absorber)
    springs = [wall or friction, friction or wall, wall + friction]
    bounds = [fastest(model), *(fastest(model, mass, k) for k in springs)]
    size = padded_size(max(slots for _, slots in bounds))
    reach = table_reach(max(speed for speed, _ in bounds), wanted)
    first, second, third = (sprung_regime(model, mass, k, 0.0, size, reach) for k in springs)
    return free_regime(model, size, reach), (first, second, third), reach


@lru_cache(maxsize=64)
def _sets(scene: Scene, wanted: float) -> tuple[Sets, float]:
    return regime_sets(scene.model, scene.absorber_masses, wanted)


def _absorbers(scene: Scene, several: SeveralAbsorbers) -> Absorbers:
    """Return what the kernels need to know of several absorbers; one without walls has them infinitely far away."""
    walls = [absorber.walls if isinstance(absorber.walls, RigidWalls) else RigidWalls(np.inf) for absorber in several.absorbers]
    gap, restitution = np.array([w.gap for w in walls]), np.array([w.restitution for w in walls])
    limit = np.array([0.0 if absorber.friction is None else absorber.friction.limit for absorber in several.absorbers])
    shapes, tip = np.array(scene.absorber_shapes), np.array(scene.model.tip_shape)
    return Absorbers(scene.absorber_masses, gap, restitution, limit, shapes, tip, scene.model.omega**2)


def _losses(scene: Scene) -> Losses:
    model, absorber = scene.model, scene.absorber
    damper = absorber.damping if isinstance(absorber, TunedAbsorber) else 0.0
    return Losses(np.array(model.force_shape), np.array(model.tip_shape), 2 * model.damping_ratio * model.omega, damper)


def _contact(scene: Scene) -> Contact:
    mass, tip_shape = scene.absorber_mass, np.array(scene.model.tip_shape)
    assert mass is not None
    return Contact(mass, 1 / mass + float(np.sum(tip_shape**2)), tip_shape)


def exact_lanes(
    scene: Scene, pseudo_period: float, watch: Watch, lanes: Lanes, orders: Array, reports: Array, status: NDArray[np.int64]
) -> Callable[[int, int], None]:
    """Return a function that advances the lanes [start, stop) by the intervals in ``orders``; see `impact_env.kernels.interval`.

    ``pseudo_period`` in s. The slots of ``lanes.z`` must be at least `slot_count`.
    """
    absorber, wanted, losses = scene.absorber, WINDOW_PERIODS * pseudo_period, _losses(scene)
    rest = (watch, lanes, orders, reports, status)
    if not isinstance(absorber, SlidingAbsorber):
        regime, reach = _linear(scene, wanted)
        return partial(linear_lanes, regime, losses, reach, *rest)
    contact = _contact(scene)
    if is_compliant(scene):
        free, sprung, reach = _compliant(scene, wanted)
        gap = absorber.walls.gap if absorber.walls is not None else None
        limit = absorber.friction.limit if absorber.friction is not None else None
        return partial(compliant_lanes, free, *sprung, contact, Springs(*_stiffnesses(absorber)), gap, limit, losses, reach, *rest)
    free, joined, reach = rigid_regimes(scene, wanted)
    restitution = absorber.walls.restitution if isinstance(absorber.walls, RigidWalls) else None
    limit = absorber.friction.limit if isinstance(absorber.friction, CoulombFriction) else None
    return partial(rigid_lanes, free, joined, contact, restitution, limit, losses, reach, *rest)


def slot_count(scene: Scene, pseudo_period: float) -> int:
    """Return the number of slots (padded) of a scene's regimes."""
    wanted = WINDOW_PERIODS * pseudo_period
    if not isinstance(scene.absorber, SlidingAbsorber):
        return _linear(scene, wanted)[0].slots.rows.shape[1]
    return (_compliant(scene, wanted)[0] if is_compliant(scene) else rigid_regimes(scene, wanted)[0]).slots.rows.shape[1]


def run_exact(
    scene: Scene,
    drive: Drive,
    state: Array,
    sample_dt: float,
    counters: Counters,
    level: Level | None = None,
    events: Events | None = None,
    series: Series | None = None,
    energy: Energy | None = None,
) -> int:
    """Integrate exactly over the whole schedule; ``state`` (2 N_m + 2, or more for several absorbers) is the start and becomes the end.

    Samples lie ``sample_dt`` (s) apart from time 0. Returns a status code of `impact_env.kernels.observers`. The slider of elastic friction
    starts without force.
    """
    absorber = scene.absorber
    wanted = WINDOW_PERIODS * drive.schedule.pseudo_period
    breaks = drive.schedule
    losses = _losses(scene)
    clock = np.array([0.0, sample_dt, 0.0])

    def schedule(reach: float) -> Schedule:
        phases = breaks.phase_at(breaks.times) + drive.phase
        return Schedule(np.array(breaks.times), np.array(breaks.omegas), np.asarray(phases), drive.amplitude, reach)

    if isinstance(absorber, SeveralAbsorbers):
        sets, reach = _sets(scene, wanted)
        return int(several_lane(sets, _absorbers(scene, absorber), losses, schedule(reach), state, clock, counters, level, events, series, energy))
    if not isinstance(absorber, SlidingAbsorber):
        regime, reach = _linear(scene, wanted)
        return int(linear_lane(regime, losses.tip_shape, losses, schedule(reach), state, clock, counters, level, series, energy))
    contact = _contact(scene)
    observers = (clock, counters, level, events, series, energy)
    if is_compliant(scene):
        free, sprung, reach = _compliant(scene, wanted)
        gap = absorber.walls.gap if absorber.walls is not None else None
        limit = absorber.friction.limit if absorber.friction is not None else None
        springs = Springs(*_stiffnesses(absorber))
        return int(compliant_lane(free, *sprung, contact, springs, gap, limit, losses, schedule(reach), state, *observers))
    free, joined, reach = rigid_regimes(scene, wanted)
    walls = Walls(absorber.walls.gap, absorber.walls.restitution) if isinstance(absorber.walls, RigidWalls) else None
    limit = absorber.friction.limit if isinstance(absorber.friction, CoulombFriction) else None
    return int(exact_lane(free, joined, contact, walls, limit, losses, schedule(reach), state, *observers))
