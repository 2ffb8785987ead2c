"""One absorber with rigid walls, rigid friction or both: free or sliding, and joined."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

from impact_env.drive import Drive
from impact_env.families.common import WINDOW_PERIODS, Array, clock_of, contact_of, losses_of, schedule_of, window_of
from impact_env.families.family import Batch, Family, Observers
from impact_env.kernels.contact_law import Walls
from impact_env.kernels.exact import exact_lane
from impact_env.kernels.lanes import rigid_lanes
from impact_env.kernels.segments import Regime
from impact_env.methods import Exact
from impact_env.parameters import CoulombFriction, RigidWalls, SlidingAbsorber
from impact_env.regimes import fastest, free_regime, joined_regime, padded_size
from impact_env.scene import Scene
from impact_env.tables import table_reach

FAR_AWAY = Walls(1e300, 1.0)


@lru_cache(maxsize=256)
def rigid_regimes(scene: Scene, wanted: float) -> tuple[Regime, Regime, float]:
    """Return the free and the joined regime, and the reach of their tables in s: ``wanted`` or less."""
    assert scene.absorber_mass is not None
    bounds = (fastest(scene.model), fastest(scene.model, scene.absorber_mass))
    size = padded_size(max(slots for _, slots in bounds))
    reach = table_reach(max(speed for speed, _ in bounds), wanted)
    return free_regime(scene.model, size, reach), joined_regime(scene.model, scene.absorber_mass, size, reach), reach


def rigid_laws(scene: Scene) -> tuple[Walls | None, float | None]:
    """Return rigid walls and friction limit (N), None where absent."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    walls = Walls(absorber.walls.gap, absorber.walls.restitution) if isinstance(absorber.walls, RigidWalls) else None
    return walls, absorber.friction.limit if isinstance(absorber.friction, CoulombFriction) else None


def _laws(scene: Scene) -> tuple[Walls, float | None]:
    """Return walls and friction limit (N, None where absent); walls that are absent are out of reach.

    A friction damper with such walls runs as fast as one without, to the same digits, and needs no kernels of its own.
    """
    walls, limit = rigid_laws(scene)
    return FAR_AWAY if walls is None else walls, limit


def _run(scene: Scene, drive: Drive, method: Exact, state: Array, sample_dt: float, observers: Observers) -> int:
    free, joined, reach = rigid_regimes(scene, window_of(drive))
    parts = (contact_of(scene), *_laws(scene), losses_of(scene), schedule_of(drive, reach))
    return int(exact_lane(free, joined, *parts, state, clock_of(sample_dt), *observers.parts))


def _control(scene: Scene, method: Exact, pseudo_period: float, batch: Batch) -> Callable[[int, int], None]:
    free, joined, reach = rigid_regimes(scene, WINDOW_PERIODS * pseudo_period)
    walls, limit = rigid_laws(scene)
    restitution = None if walls is None else walls.restitution
    return partial(rigid_lanes, free, joined, contact_of(scene), restitution, limit, losses_of(scene), reach, *batch)


def _slots(scene: Scene, pseudo_period: float) -> int:
    return rigid_regimes(scene, WINDOW_PERIODS * pseudo_period)[0].slots.rows.shape[1]


RIGID = Family("rigid", _laws, _run, _control, _slots, searched=True)
