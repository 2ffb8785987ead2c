"""Several absorbers with rigid contact at places of their own: one regime for each set of joined ones.

The lane does a single absorber as well, which serves as a check: that has a family of its own (rigid.py), with other kernels.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from impact_env.families.common import Array, losses_of, schedule_of, window_of
from impact_env.families.family import Family, Observers
from impact_env.kernels.exact.sets import Absorbers, Sets
from impact_env.kernels.exact.several import Several, several_lane
from impact_env.loads import AnyDrive
from impact_env.methods import Exact
from impact_env.parameters import RigidWalls, SeveralAbsorbers, SlidingAbsorber
from impact_env.regime_sets import regime_sets
from impact_env.scene import Scene


@lru_cache(maxsize=64)
def _sets(scene: Scene, wanted: float) -> tuple[Sets, float]:
    return regime_sets(scene.model, scene.absorber_shapes, scene.absorber_masses, wanted)


def _absorbers(scene: Scene) -> Absorbers:
    """Return what the kernels need to know of the absorbers; one without walls has them infinitely far away."""
    every = scene.absorber.absorbers if isinstance(scene.absorber, SeveralAbsorbers) else (scene.absorber,)
    walls = [scene.cavity(a) or RigidWalls(np.inf) for a in range(len(every))]
    gap, restitution = np.array([w.gap for w in walls]), np.array([w.restitution for w in walls])
    limit = np.array([one.friction.limit if isinstance(one, SlidingAbsorber) and one.friction is not None else 0.0 for one in every])
    shapes, tip = np.array(scene.absorber_shapes), np.array(scene.model.tip_shape)
    return Absorbers(scene.absorber_masses, gap, restitution, limit, shapes, tip, scene.model.omega**2)


def _laws(scene: Scene) -> tuple[object, ...]:
    return ()


def _run(scene: Scene, drive: AnyDrive, method: Exact, state: Array, sample_dt: float, observers: Observers) -> int:
    sets, reach = _sets(scene, window_of(drive))
    several = Several(sets, _absorbers(scene), losses_of(scene))
    return int(several_lane(several, schedule_of(scene, drive, reach), state, observers.every(sample_dt)))


SEVERAL = Family("several", _laws, _run, searched=True)
