"""One absorber whose contacts are springs (paper, appendix A): a spring to the wall, and elastic Coulomb friction."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

from impact_env.families.common import WINDOW_PERIODS, Array, compiled, contact_of, losses_of, schedule_of, window_of
from impact_env.families.family import Family, Observers
from impact_env.kernels.control.interval import Batch
from impact_env.kernels.control.lanes import compliant_lanes
from impact_env.kernels.exact.compliant import Sprung, compliant_lane
from impact_env.kernels.exact.springs import Springs
from impact_env.kernels.motion.segments import Regime
from impact_env.loads import AnyDrive
from impact_env.methods import Exact
from impact_env.parameters import SlidingAbsorber
from impact_env.regimes import fastest, free_regime, padded_size, sprung_regime
from impact_env.scene import Scene
from impact_env.tables import table_reach


def _springs(scene: Scene) -> Springs:
    """Return wall and friction stiffness in N/m, 0 where absent."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    walls, friction = compiled(absorber.walls), compiled(absorber.friction)
    return Springs(0.0 if walls is None else walls.stiffness, 0.0 if friction is None else friction.stiffness)


@lru_cache(maxsize=256)
def compliant_regimes(scene: Scene, wanted: float) -> tuple[tuple[Regime, Regime, Regime, Regime], float]:
    """Return the free regime and those with the wall's spring, with the friction's, and with both, and the reach of their tables in s.

    An absent spring's regime repeats another.
    """
    model, mass = scene.model, scene.absorber_mass
    assert mass is not None
    wall, friction = _springs(scene)
    springs = [wall or friction, friction or wall, wall + friction]
    bounds = [fastest(model), *(fastest(model, mass, k) for k in springs)]
    size = padded_size(max(slots for _, slots in bounds))
    reach = table_reach(max(speed for speed, _ in bounds), wanted)
    first, second, third = (sprung_regime(model, mass, k, 0.0, size, reach) for k in springs)
    return (free_regime(model, size, reach), first, second, third), reach


def _laws(scene: Scene) -> tuple[float | None, float | None]:
    """Return gap (m) and friction limit (N), None where absent."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    return None if absorber.walls is None else absorber.walls.gap, None if absorber.friction is None else absorber.friction.limit


def _sprung(scene: Scene, wanted: float) -> tuple[Sprung, float]:
    """Return the scene as its kernels take it, and the reach of the regimes' tables in s: ``wanted`` or less."""
    regimes, reach = compliant_regimes(scene, wanted)
    return Sprung(regimes, contact_of(scene), _springs(scene), *_laws(scene), losses_of(scene)), reach


def _run(scene: Scene, drive: AnyDrive, method: Exact, state: Array, sample_dt: float, observers: Observers) -> int:
    sprung, reach = _sprung(scene, window_of(drive))
    return int(compliant_lane(sprung, schedule_of(scene, drive, reach), state, observers.every(sample_dt)))


def _control(scene: Scene, method: Exact, pseudo_period: float, batch: Batch) -> Callable[[int, int], None]:
    return partial(compliant_lanes, *_sprung(scene, WINDOW_PERIODS * pseudo_period), batch)


def _slots(scene: Scene, pseudo_period: float) -> int:
    return compliant_regimes(scene, WINDOW_PERIODS * pseudo_period)[0][0].slots.rows.shape[1]


COMPLIANT = Family("compliant", _laws, _run, _control, _slots, searched=True)
