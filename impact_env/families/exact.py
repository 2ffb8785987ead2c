"""The families of the exact method: one rigid absorber (free or sliding, and joined), one on springs, scenes of one regime, several absorbers."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from impact_env.families.family import (
    WINDOW_PERIODS,
    Array,
    Solver,
    build_contact,
    build_losses,
    build_schedule,
    compute_window_length,
    find_gravity,
    load_law,
)
from impact_env.families.regime_cache import cache_regimes
from impact_env.kernels.control.interval import Batch
from impact_env.kernels.control.lanes import compliant_lanes, linear_lanes, rigid_lanes
from impact_env.kernels.control.work_queue import WorkQueue
from impact_env.kernels.exact.compliant import CompliantScene, compliant_lane
from impact_env.kernels.exact.compliant_contact import ContactStiffness
from impact_env.kernels.exact.linear import Linear, linear_lane
from impact_env.kernels.exact.rigid import rigid_lane
from impact_env.kernels.exact.rigid_contact import Walls
from impact_env.kernels.exact.sets import Absorbers, Sets
from impact_env.kernels.exact.several import Several, several_lane
from impact_env.kernels.exact.stick_slip import Rigid
from impact_env.kernels.motion.observers import Observers
from impact_env.kernels.motion.segments import LinearRegime
from impact_env.loads import AnyDrive, Loads
from impact_env.methods import Exact
from impact_env.parameters import CompliantWalls, RigidWalls, SeveralAbsorbers, SlidingAbsorber
from impact_env.regime_sets import regime_sets
from impact_env.regimes import (
    find_fastest,
    free_regime,
    joined_regime,
    padded_size,
    sprung_regime,
    table_reach,
)
from impact_env.scene import Scene

KernelArguments = tuple[
    Any, float
]  # a scene as its kernels take it, and the reach of its regimes' tables in s


@dataclass(frozen=True)
class ExactSolver(Solver):
    """``take`` makes of a scene, the wanted reach in s, whether the base moves, and the drive (None: under control) what the kernels take.

    ``regime``: the one of it whose slots a lane under control keeps.
    """

    take: Callable[[Scene, float, bool, AnyDrive | None], KernelArguments]
    regime: Callable[[Any], LinearRegime]

    def run(
        self, scene: Scene, drive: AnyDrive, method: Exact, state: Array, observe: Observers
    ) -> int:
        """Integrate over the whole schedule, see `Family.run`."""
        taken, reach = self.take(
            scene,
            compute_window_length(drive),
            isinstance(drive, Loads) and drive.moves_base,
            drive,
        )
        return int(self.lane(taken, build_schedule(scene, drive, reach), state, observe))

    def control(
        self, scene: Scene, method: Exact, pseudo_period: float, batch: Batch
    ) -> Callable[[WorkQueue, int, int], bool]:
        """Return the kernel that advances lanes, see `Family.control`."""
        assert self.lanes is not None
        moves = (
            batch.settings.disturbance is not None and batch.settings.disturbance.base is not None
        )
        return partial(
            self.lanes, *self.take(scene, WINDOW_PERIODS * pseudo_period, moves, None), batch
        )

    def slots(self, scene: Scene, pseudo_period: float) -> int:
        """Return the slots of the regime."""
        return self.regime(
            self.take(scene, WINDOW_PERIODS * pseudo_period, False, None)[0]
        ).system.rows.shape[1]


# One absorber with rigid walls, rigid friction or both: free or sliding, and joined.


DISTANT_WALLS = Walls(1e300, 1.0, None)


@cache_regimes
def rigid_regimes(
    scene: Scene, wanted: float, moves: bool = False
) -> tuple[LinearRegime, LinearRegime, float]:
    """Return the free and the joined regime, and the reach of their tables in s: ``wanted`` or less. ``moves``: whether the base does."""
    assert scene.absorber_mass is not None
    bounds = (find_fastest(scene.model), find_fastest(scene.model, scene.absorber_mass))
    size = padded_size(max(slots for _, slots in bounds))
    reach = table_reach(max(speed for speed, _ in bounds), wanted)
    joined = joined_regime(
        scene.model,
        scene.absorber_mass,
        size,
        reach,
        moves=moves,
        heavy=find_gravity(scene) is not None,
    )
    return free_regime(scene.model, size, reach, moves=moves), joined, reach


def rigid_laws(scene: Scene) -> tuple[Walls | None, float | None]:
    """Return rigid walls and friction limit (N), None where absent."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    return load_law(absorber.walls), load_law(absorber.friction)


def _laws_rigid(scene: Scene) -> tuple[Walls, float | None]:
    """Return walls and friction limit (N, None where absent); walls that are absent are out of reach.

    A friction damper with such walls runs as fast as one without, to the same digits, and needs no kernels of its own.
    """
    walls, limit = rigid_laws(scene)
    return DISTANT_WALLS if walls is None else walls, limit


def _rigid(scene: Scene, wanted: float, moves: bool, drive: AnyDrive | None) -> KernelArguments:
    free, joined, reach = rigid_regimes(scene, wanted, moves)
    laws = rigid_laws(scene) if drive is None else _laws_rigid(scene)
    return Rigid(free, joined, build_contact(scene, *laws, drive), build_losses(scene)), reach


RIGID_SOLVER = ExactSolver(
    "rigid",
    rigid_lane,
    rigid_lanes,
    _laws_rigid,
    searched=True,
    take=_rigid,
    regime=lambda rigid: rigid.free,
)


# One absorber whose contacts are springs (paper, appendix A): a spring to the wall, and elastic Coulomb friction.


def _springs(scene: Scene) -> ContactStiffness:
    """Return wall and friction stiffness in N/m, 0 where absent."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    walls = load_law(absorber.walls)
    friction = load_law(absorber.friction)
    return ContactStiffness(
        0.0 if walls is None else walls.stiffness, 0.0 if friction is None else friction.stiffness
    )


def wall_damper(scene: Scene) -> float:
    """Return the damper beside the spring of compliant walls in N s/m, from their coefficient of restitution.

    Two bodies that meet freely on a spring k and a damper c separate with e = exp(-pi zeta / sqrt(1 - zeta^2)) of their
    velocity, where c = 2 zeta sqrt(k m) and 1/m = 1/m_a + sum phi_i^2 (Brogliato, Nonsmooth Mechanics, 2016, section 2.1).
    """
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    walls = absorber.walls
    if not isinstance(walls, CompliantWalls):
        return 0.0
    return 2 * walls.damping_ratio * math.sqrt(walls.stiffness / build_contact(scene).compliance)


@cache_regimes
def compliant_regimes(
    scene: Scene, wanted: float
) -> tuple[tuple[LinearRegime, LinearRegime, LinearRegime, LinearRegime], float]:
    """Return the free regime and those with the wall's spring, with the friction's, and with both, and the reach of their tables in s.

    An absent spring's regime repeats another.
    """
    model = scene.model
    mass = scene.absorber_mass
    assert mass is not None
    wall, friction = _springs(scene)
    damper = wall_damper(scene)
    springs = [
        (wall, damper) if wall else (friction, 0.0),
        (friction, 0.0) if friction else (wall, damper),
        (wall + friction, damper),
    ]
    bounds = [find_fastest(model), *(find_fastest(model, mass, k, c) for k, c in springs)]
    size = padded_size(max(slots for _, slots in bounds))
    reach = table_reach(max(speed for speed, _ in bounds), wanted)
    first, second, third = (sprung_regime(model, mass, k, c, size, reach) for k, c in springs)
    return (free_regime(model, size, reach), first, second, third), reach


def _laws_compliant(scene: Scene) -> tuple[float | None, float | None]:
    """Return gap (m) and friction limit (N), None where absent."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    return (
        None if absorber.walls is None else absorber.walls.gap,
        None if absorber.friction is None else absorber.friction.limit,
    )


def _sprung(scene: Scene, wanted: float, moves: bool, drive: AnyDrive | None) -> KernelArguments:
    regimes, reach = compliant_regimes(scene, wanted)
    losses = build_losses(scene)
    return CompliantScene(
        regimes,
        build_contact(scene),
        _springs(scene),
        *_laws_compliant(scene),
        losses,
        losses._replace(damper=wall_damper(scene)),
    ), reach


COMPLIANT_SOLVER = ExactSolver(
    "compliant",
    compliant_lane,
    compliant_lanes,
    _laws_compliant,
    searched=True,
    take=_sprung,
    regime=lambda sprung: sprung.regimes[0],
)


# Scenes of one linear regime: no absorber, a stuck one, a tuned one. The exact method is a closed form, without events.


@cache_regimes
def linear_regime(scene: Scene, wanted: float, moves: bool = False) -> tuple[LinearRegime, float]:
    """Return the regime and the reach of its tables in s: ``wanted`` or less. ``moves``: whether the base does."""
    model = scene.model
    absorber = scene.absorber
    mass = scene.absorber_mass
    spring = load_law(absorber)
    speed, slots = find_fastest(model, mass, *(spring or (None, 0.0)))
    size = padded_size(slots)
    reach = table_reach(speed, wanted)
    if mass is None:
        return free_regime(model, size, reach, moves=moves), reach
    heavy = find_gravity(scene) is not None
    if spring is None:
        return joined_regime(model, mass, size, reach, moves=moves, heavy=heavy), reach
    return sprung_regime(
        model, mass, spring.stiffness, spring.damping, size, reach, moves=moves, heavy=heavy
    ), reach


def _linear(scene: Scene, wanted: float, moves: bool, drive: AnyDrive | None) -> KernelArguments:
    regime, reach = linear_regime(scene, wanted, moves)
    return Linear(regime, build_losses(scene), find_gravity(scene, drive)), reach


LINEAR_SOLVER = ExactSolver(
    "linear",
    linear_lane,
    linear_lanes,
    lambda _: (),
    searched=False,
    take=_linear,
    regime=lambda linear: linear.regime,
)


# Several absorbers with rigid contact at places of their own: one regime for each set of joined ones.
#
# The lane does a single absorber as well, which serves as a check: that has a family of its own, with other kernels.


@cache_regimes
def _sets(scene: Scene, wanted: float) -> tuple[Sets, float]:
    return regime_sets(scene.model, scene.absorber_shapes, scene.absorber_masses, wanted)


def _absorbers(scene: Scene) -> Absorbers:
    """Return the kernels' arguments for the absorbers; one without walls has them infinitely far away."""
    every = (
        scene.absorber.absorbers
        if isinstance(scene.absorber, SeveralAbsorbers)
        else (scene.absorber,)
    )
    walls = [scene.cavity(a) or RigidWalls(np.inf) for a in range(len(every))]
    gap = np.array([w.gap for w in walls])
    restitution = np.array([w.restitution for w in walls])
    limit = np.array(
        [
            one.friction.limit
            if isinstance(one, SlidingAbsorber) and one.friction is not None
            else 0.0
            for one in every
        ]
    )
    shapes = np.array(scene.absorber_shapes)
    tip = np.array(scene.model.tip_shape)
    return Absorbers(
        scene.absorber_masses, gap, restitution, limit, shapes, tip, scene.model.omega**2
    )


def _several(scene: Scene, wanted: float, moves: bool, drive: AnyDrive | None) -> KernelArguments:
    sets, reach = _sets(scene, wanted)
    return Several(sets, _absorbers(scene), build_losses(scene)), reach


SEVERAL_SOLVER = ExactSolver(
    "several",
    several_lane,
    None,
    lambda _: (),
    searched=True,
    take=_several,
    regime=lambda several: several.sets,
)
