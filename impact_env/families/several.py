"""Several absorbers with rigid contact at places of their own: one regime for each set of joined ones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from impact_env.drive import Drive
from impact_env.families.common import Array, clock_of, losses_of, schedule_of, window_of
from impact_env.families.family import Family, Observers
from impact_env.kernels.sets import Absorbers, Sets
from impact_env.kernels.several import several_lane
from impact_env.methods import Exact
from impact_env.parameters import RigidWalls, SeveralAbsorbers
from impact_env.regime_sets import regime_sets
from impact_env.scene import Scene


@lru_cache(maxsize=64)
def _sets(scene: Scene, wanted: float) -> tuple[Sets, float]:
    return regime_sets(scene.model, scene.absorber_masses, wanted)


def _absorbers(scene: Scene) -> Absorbers:
    """Return what the kernels need to know of the absorbers; one without walls has them infinitely far away."""
    several = scene.absorber
    assert isinstance(several, SeveralAbsorbers)
    walls = [absorber.walls if isinstance(absorber.walls, RigidWalls) else RigidWalls(np.inf) for absorber in several.absorbers]
    gap, restitution = np.array([w.gap for w in walls]), np.array([w.restitution for w in walls])
    limit = np.array([0.0 if absorber.friction is None else absorber.friction.limit for absorber in several.absorbers])
    shapes, tip = np.array(scene.absorber_shapes), np.array(scene.model.tip_shape)
    return Absorbers(scene.absorber_masses, gap, restitution, limit, shapes, tip, scene.model.omega**2)


def _laws(scene: Scene) -> tuple[object, ...]:
    return ()


def _run(scene: Scene, drive: Drive, method: Exact, state: Array, sample_dt: float, observers: Observers) -> int:
    sets, reach = _sets(scene, window_of(drive))
    parts = (_absorbers(scene), losses_of(scene), schedule_of(drive, reach))
    return int(several_lane(sets, *parts, state, clock_of(sample_dt), *observers.parts))


SEVERAL = Family("several", _laws, _run, searched=True)
