"""Scenes of one linear regime: no absorber, a stuck one, a tuned one. The exact method is a closed form, without events."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

from impact_env.families.common import WINDOW_PERIODS, Array, compiled, gravity_in, losses_of, moves_base, schedule_of, window_of
from impact_env.families.family import Family, Observers
from impact_env.kernels.control.interval import Batch
from impact_env.kernels.control.lanes import linear_lanes
from impact_env.kernels.exact.linear import Linear, linear_lane
from impact_env.kernels.motion.segments import Regime
from impact_env.loads import AnyDrive
from impact_env.methods import Exact
from impact_env.regimes import fastest, free_regime, joined_regime, padded_size, sprung_regime
from impact_env.scene import Scene
from impact_env.tables import table_reach


@lru_cache(maxsize=256)
def linear_regime(scene: Scene, wanted: float, moves: bool = False) -> tuple[Regime, float]:
    """Return the regime and the reach of its tables in s: ``wanted`` or less. ``moves``: whether the base does."""
    model, absorber, mass = scene.model, scene.absorber, scene.absorber_mass
    spring = compiled(absorber)
    speed, slots = fastest(model, mass, *(spring or (None, 0.0)))
    size, reach = padded_size(slots), table_reach(speed, wanted)
    if mass is None:
        return free_regime(model, size, reach, moves=moves), reach
    heavy = gravity_in(scene) is not None
    if spring is None:
        return joined_regime(model, mass, size, reach, moves=moves, heavy=heavy), reach
    return sprung_regime(model, mass, spring.stiffness, spring.damping, size, reach, moves=moves, heavy=heavy), reach


def _laws(scene: Scene) -> tuple[object, ...]:
    return ()


def _run(scene: Scene, drive: AnyDrive, method: Exact, state: Array, sample_dt: float, observers: Observers) -> int:
    regime, reach = linear_regime(scene, window_of(drive), moves_base(drive))
    observers = replace(observers, events=None)  # there are none, and a list would be one more variant to compile
    return int(
        linear_lane(Linear(regime, losses_of(scene), gravity_in(scene, drive)), schedule_of(scene, drive, reach), state, observers.every(sample_dt))
    )


def _control(scene: Scene, method: Exact, pseudo_period: float, batch: Batch) -> Callable[[int, int], None]:
    regime, reach = linear_regime(scene, WINDOW_PERIODS * pseudo_period)
    return partial(linear_lanes, Linear(regime, losses_of(scene), None), reach, batch)


def _slots(scene: Scene, pseudo_period: float) -> int:
    return linear_regime(scene, WINDOW_PERIODS * pseudo_period)[0].slots.rows.shape[1]


LINEAR = Family("linear", _laws, _run, _control, _slots)
