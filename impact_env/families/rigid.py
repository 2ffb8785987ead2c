"""One absorber with rigid walls, rigid friction or both: free or sliding, and joined."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

from impact_env.families.common import WINDOW_PERIODS, Array, compiled, contact_of, gravity_in, losses_of, moves_base, schedule_of, window_of
from impact_env.families.family import Family, Observers
from impact_env.kernels.control.interval import Batch
from impact_env.kernels.control.lanes import rigid_lanes
from impact_env.kernels.exact.free_and_joined import Rigid
from impact_env.kernels.exact.rigid import exact_lane
from impact_env.kernels.exact.rigid_contact import Walls
from impact_env.kernels.motion.segments import Regime
from impact_env.loads import AnyDrive
from impact_env.methods import Exact
from impact_env.parameters import SlidingAbsorber
from impact_env.regimes import fastest, free_regime, joined_regime, padded_size
from impact_env.scene import Scene
from impact_env.tables import table_reach

FAR_AWAY = Walls(1e300, 1.0, None)


@lru_cache(maxsize=256)
def rigid_regimes(scene: Scene, wanted: float, moves: bool = False) -> tuple[Regime, Regime, float]:
    """Return the free and the joined regime, and the reach of their tables in s: ``wanted`` or less. ``moves``: whether the base does."""
    assert scene.absorber_mass is not None
    bounds = (fastest(scene.model), fastest(scene.model, scene.absorber_mass))
    size = padded_size(max(slots for _, slots in bounds))
    reach = table_reach(max(speed for speed, _ in bounds), wanted)
    joined = joined_regime(scene.model, scene.absorber_mass, size, reach, moves=moves, heavy=gravity_in(scene) is not None)
    return free_regime(scene.model, size, reach, moves=moves), joined, reach


def rigid_laws(scene: Scene) -> tuple[Walls | None, float | None]:
    """Return rigid walls and friction limit (N), None where absent."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    return compiled(absorber.walls), compiled(absorber.friction)


def _laws(scene: Scene) -> tuple[Walls, float | None]:
    """Return walls and friction limit (N, None where absent); walls that are absent are out of reach.

    A friction damper with such walls runs as fast as one without, to the same digits, and needs no kernels of its own.
    """
    walls, limit = rigid_laws(scene)
    return FAR_AWAY if walls is None else walls, limit


def _rigid(scene: Scene, wanted: float, walls: Walls | None, limit: float | None, drive: AnyDrive | None = None) -> tuple[Rigid, float]:
    """Return the scene as its kernels take it, and the reach of the regimes' tables in s: ``wanted`` or less."""
    free, joined, reach = rigid_regimes(scene, wanted, moves_base(drive))
    return Rigid(free, joined, contact_of(scene, walls, limit, drive), losses_of(scene)), reach


def _run(scene: Scene, drive: AnyDrive, method: Exact, state: Array, sample_dt: float, observers: Observers) -> int:
    rigid, reach = _rigid(scene, window_of(drive), *_laws(scene), drive)
    return int(exact_lane(rigid, schedule_of(scene, drive, reach), state, observers.every(sample_dt)))


def _control(scene: Scene, method: Exact, pseudo_period: float, batch: Batch) -> Callable[[int, int], None]:
    return partial(rigid_lanes, *_rigid(scene, WINDOW_PERIODS * pseudo_period, *rigid_laws(scene)), batch)


def _slots(scene: Scene, pseudo_period: float) -> int:
    return rigid_regimes(scene, WINDOW_PERIODS * pseudo_period)[0].slots.rows.shape[1]


RIGID = Family("rigid", _laws, _run, _control, _slots, searched=True)
