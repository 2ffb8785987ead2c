"""Solvers of a scene and a method, and their kernels.

The table `CAPABILITIES` lists which scenes each method can simulate. No other module distinguishes
methods by the kind of scene.
"""

import math
import threading
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import instance, require
from impact_env.drive import Drive, Excitation
from impact_env.force_channels import check_places, find_base_shapes, split_forces
from impact_env.kernels.control.interval import Batch
from impact_env.kernels.control.lanes import (
    LaneMemory,
    WorkQueue,
    compliant_lanes,
    linear_lanes,
    moreau_lanes,
    new_compliant_memory,
    new_linear_memory,
    new_rigid_memory,
    new_stepping_memory,
    rigid_lanes,
    runge_kutta_lanes,
)
from impact_env.kernels.exact.compliant import CompliantScene, ContactStiffness, compliant_lane
from impact_env.kernels.exact.linear import Linear, linear_lane
from impact_env.kernels.exact.rigid import Rigid, rigid_lane
from impact_env.kernels.exact.rigid_contact import NO_WALLS, ContactLaw, Walls
from impact_env.kernels.exact.sets import Absorbers
from impact_env.kernels.exact.several import Several, several_lane
from impact_env.kernels.motion import loads
from impact_env.kernels.motion.loads import Schedule
from impact_env.kernels.motion.observers import Observers
from impact_env.kernels.motion.segments import LinearRegime, Losses
from impact_env.kernels.stepping import moreau, runge_kutta_step
from impact_env.kernels.stepping.grid import NO_SPRING, BeamModes, DriveForce, Spring, TimeStep
from impact_env.kernels.stepping.moreau import RigidLaws, moreau_lane
from impact_env.kernels.stepping.runge_kutta import runge_kutta_lane
from impact_env.kernels.stepping.runge_kutta_step import (
    CompliantLaws,
    CubicSpring,
    ElasticSlider,
    ElasticStops,
)
from impact_env.laws import SceneKind
from impact_env.loads import BASE_QUANTITY, Loads, Samples
from impact_env.methods import METHODS, Exact, Method, Moreau, RungeKutta
from impact_env.modes import ModalModel
from impact_env.parameters import (
    CompliantWalls,
    CoulombFriction,
    NonlinearSink,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    find_largest_gravity,
)
from impact_env.regime_sets import (
    Joined,
    RegimePlaces,
    SetLayout,
    build_set_regime,
    find_set_layout,
)
from impact_env.regimes import (
    find_fastest,
    free_regime,
    joined_regime,
    padded_size,
    sprung_regime,
    table_reach,
)
from impact_env.scene import Scene

Array = NDArray[np.float64]
P = ParamSpec("P")
R = TypeVar("R")
Part = TypeVar("Part")
# a scene as its kernels take it, and the reach of its regimes' tables in s
KernelArguments = tuple[Any, float]
WINDOW_PERIODS = 3.2  # wanted length of a window of the chirp, in pseudo periods
# of all regimes that are cached: those of some 450 scenes of 10 modes, or of 28 of 60 modes
MOST_BYTES_CACHED = 64 * 2**20


def variant_key(law: object) -> object:
    """Return the key of a law by which kernels differ: None, or which of its parts are present."""
    return tuple(map(variant_key, law)) if isinstance(law, tuple) else law is None


@dataclass(frozen=True)
class Solver(ABC):
    """Kernels for some kinds of scenes.

    Attributes
    ----------
    name : str
        Name of the solver.
    lane : callable
        Kernel of a single run.
    lanes : callable or None
        Kernel that advances many runs under control, None if there is none.
    laws : callable
        Returns the parts of a scene that decide which kernels are compiled, None where absent.
    searched : bool
        Whether events are searched for.
    """

    name: str
    lane: Callable[..., int]
    lanes: Callable[..., bool] | None
    laws: Callable[[Scene], tuple[Any, ...]]
    searched: bool

    def key(self, scene: Scene, drive: Excitation | None = None) -> tuple[object, ...]:
        """Return a key of the compiled kernels of a run.

        Runs with the same record have equal keys exactly if the same kernels simulate them. The key
        consists of the laws and loads that are absent from the kernels' arguments. ``drive`` None
        stands for a single force.
        """
        return self.name, variant_key(self.laws(scene)), drive is not None and drive.in_pieces

    @abstractmethod
    def run(
        self, scene: Scene, drive: Excitation, method: Any, state: Array, observe: Observers
    ) -> int:
        """Integrate over the whole schedule and return a status code of `kernels.motion.observers`.

        ``state`` (2 N_m + 2 n,) is the start, and is overwritten by the end. ``observe`` must have
        a new clock and is filled. A slider of elastic friction starts without force.
        """

    @abstractmethod
    def control(
        self, scene: Scene, method: Any, pseudo_period: float, batch: Batch
    ) -> Callable[[WorkQueue, int, int], bool]:
        """Return the kernel of `kernels.control.lanes` that advances lanes.

        It advances lanes by the intervals of their orders. ``pseudo_period`` is in s. The kernel
        has its own memory, so each thread needs one.
        """

    def slots(self, scene: Scene, pseudo_period: float) -> int:
        """Return the number of slots that a lane under control stores between intervals.

        It is 1 if the lane stores only its state.
        """
        return 1


def fill_tuple(kind: Callable[..., Part], law: object) -> Part | None:
    """Return the kernels' tuple of a law, or None for no law.

    Its fields are the law's attributes of the same names, or their defaults.
    """
    if law is None:
        return None
    fields: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
    return kind(**{field: getattr(law, field) for field in fields if hasattr(law, field)})


def compute_window_length(drive: Excitation) -> float:
    """Return the wanted length of a window in s."""
    return WINDOW_PERIODS * drive.schedule.pseudo_period


def has_bases(drive: Excitation) -> bool:
    """Return whether a drive of `split_forces` moves a base, or has forces computed as bases."""
    return any(piece.moves_base or piece.channel > 0 for piece in drive.pieces())


def build_schedule(scene: Scene, drive: Excitation, reach: float) -> Schedule:
    """Return a drive in the form of the exact kernels, in windows of at most ``reach`` (s)."""
    if isinstance(drive, Loads):
        times, pieces, which, channel = drive.on_one_clock()
        base = build_base_motion(scene, bool(channel.any()))
        load = loads.LoadPieces(pieces, which, channel, base)
        return Schedule(times, np.zeros(len(times)), np.zeros(len(times)), 0.0, reach, load)
    assert isinstance(drive, Drive)
    breaks = drive.schedule
    phases = breaks.phase_at(breaks.times) + drive.phase
    return Schedule(
        np.array(breaks.times),
        np.array(breaks.omegas),
        np.asarray(phases),
        drive.amplitude,
        reach,
        None,
    )


def build_base_motion(scene: Scene, moves: bool) -> loads.BaseParticipation:
    """Return the participations of modes and absorbers in the motions of the bases.

    They are zero unless a base ``moves``.
    """
    model = scene.model
    several = isinstance(scene.absorber, SeveralAbsorbers)
    masses = scene.absorber_masses if several else np.array([scene.absorber_mass or 0.0])
    if not moves:
        still = (np.zeros((1, size)) for size in (model.modes, len(masses)))
        participation, carried = still
        return loads.BaseParticipation(participation, np.zeros(1), carried, False)
    participation, at_absorber = find_base_shapes(model)
    return loads.BaseParticipation(participation, at_absorber, np.outer(at_absorber, masses), True)


def build_losses(scene: Scene) -> Losses:
    """Return the shapes at force and tip, the modes' damping and a linear absorber's damper."""
    model = scene.model
    damper = 0.0 if scene.link is None else scene.link.damping
    return Losses(
        np.array(model.force_shape),
        np.array(model.tip_shape),
        2 * model.damping_ratio * model.omega,
        damper,
    )


def build_contact(
    scene: Scene,
    walls: Walls = NO_WALLS,
    limit: float | None = None,
) -> ContactLaw:
    """Return the contact of one absorber with its place.

    It has rigid walls and a friction limit (N), None without friction.
    """
    mass = scene.absorber_mass
    tip_shape = np.array(scene.model.tip_shape)
    friction = getattr(scene.absorber, "friction", None)
    assert mass is not None
    return ContactLaw(
        mass,
        1 / mass + float(np.sum(tip_shape**2)),
        tip_shape,
        walls,
        limit,
        find_largest_gravity(scene.absorber),
        friction.static_ratio if isinstance(friction, CoulombFriction) else 1.0,
    )


def build_spring(scene: Scene) -> Spring:
    """Return spring and damper of a linear absorber, zeros without."""
    return NO_SPRING if scene.link is None else Spring(*scene.link)


def count_bytes(value: Any) -> int:
    """Return the size of all arrays in nested tuples."""
    if isinstance(value, tuple):
        return sum(map(count_bytes, value))
    return value.nbytes if isinstance(value, np.ndarray) else 0


class RegimeCache:
    """Cache of the results of functions by their arguments; a decorator.

    The least recently used results are removed if all together have more than ``most_bytes``.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self._values: OrderedDict[Any, tuple[Any, int]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()

    @property
    def bytes(self) -> int:
        """Size of all stored results in bytes."""
        return self._bytes

    def __call__(self, function: Callable[P, R]) -> Callable[P, R]:
        """Return the function with stored results."""

        @wraps(function)
        def cached(*args: P.args, **kwargs: P.kwargs) -> R:
            key = (function, args, tuple(sorted(kwargs.items())))
            with self._lock:
                if key in self._values:
                    self._values.move_to_end(key)
                    return self._values[key][0]
            value = function(*args, **kwargs)
            with self._lock:
                if key not in self._values:
                    self._hold(key, value)
                return self._values[key][0]

        return cached

    def _hold(self, key: Any, value: Any) -> None:
        size = count_bytes(value)
        self._values[key] = value, size
        self._bytes += size
        while self._bytes > self.most_bytes and len(self._values) > 1:
            _, (_, dropped) = self._values.popitem(last=False)
            self._bytes -= dropped


cache_regimes = RegimeCache(MOST_BYTES_CACHED)


@dataclass(frozen=True)
class ExactSolver(Solver):
    """Solver of the exact method.

    Attributes
    ----------
    take : callable
        Returns the kernels' arguments of a scene, the wanted reach in s, whether the base moves,
        and the drive (None: under control).
    regime : callable
        Returns the regime whose modal amplitudes a lane under control stores between intervals.
    new_memory : callable
        Returns a thread's memory for ``lanes``.
    """

    take: Callable[[Scene, float, bool, Excitation | None], KernelArguments]
    regime: Callable[[Any], LinearRegime]
    new_memory: Callable[[Any, Batch], LaneMemory]

    def run(
        self, scene: Scene, drive: Excitation, method: Exact, state: Array, observe: Observers
    ) -> int:
        """Integrate over the whole schedule, see `Solver.run`."""
        taken, reach = self.take(
            scene,
            compute_window_length(drive),
            has_bases(drive),
            drive,
        )
        return int(self.lane(taken, build_schedule(scene, drive, reach), state, observe))

    def control(
        self, scene: Scene, method: Exact, pseudo_period: float, batch: Batch
    ) -> Callable[[WorkQueue, int, int], bool]:
        """Return the kernel that advances lanes, see `Solver.control`."""
        assert self.lanes is not None
        moves = (
            batch.settings.disturbance is not None and batch.settings.disturbance.base is not None
        )
        taken, reach = self.take(scene, WINDOW_PERIODS * pseudo_period, moves, None)
        return partial(self.lanes, taken, reach, batch, self.new_memory(taken, batch))

    def slots(self, scene: Scene, pseudo_period: float) -> int:
        """Return the slots of the regime."""
        return self.regime(
            self.take(scene, WINDOW_PERIODS * pseudo_period, False, None)[0]
        ).system.rows.shape[1]


# Exact, one absorber with rigid walls, rigid friction or both: free or sliding, and joined.


@cache_regimes
def free_and_joined_regimes(
    model: ModalModel, mass: float, wanted: float, moves: bool, heavy: bool
) -> tuple[LinearRegime, LinearRegime, float]:
    """Return the regimes of `rigid_regimes`.

    They do not depend on gap, restitution and friction limit.
    """
    bounds = (find_fastest(model), find_fastest(model, mass))
    size = padded_size(max(slots for _, slots in bounds))
    reach = table_reach(max(speed for speed, _ in bounds), wanted)
    joined = joined_regime(model, mass, size, reach, moves=moves, heavy=heavy)
    return free_regime(model, size, reach, moves=moves), joined, reach


def rigid_regimes(
    scene: Scene, wanted: float, moves: bool = False
) -> tuple[LinearRegime, LinearRegime, float]:
    """Return the free and the joined regime, and the reach of their tables in s.

    The reach is ``wanted`` or less. ``moves``: whether the base moves.
    """
    mass = scene.absorber_mass
    assert mass is not None
    heavy = find_largest_gravity(scene.absorber) != 0
    return free_and_joined_regimes(scene.model, mass, wanted, moves, heavy)


def _laws_rigid(scene: Scene) -> tuple[Walls, float | None]:
    """Return walls and friction limit (N, None without friction).

    Absent walls are replaced by walls at infinite distance: the result is the same to the last
    digit at the same speed, and no further kernels are compiled.
    """
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    limit = None if absorber.friction is None else absorber.friction.limit
    return fill_tuple(Walls, absorber.walls) or NO_WALLS, limit


def _rigid(scene: Scene, wanted: float, moves: bool, drive: Excitation | None) -> KernelArguments:
    free, joined, reach = rigid_regimes(scene, wanted, moves)
    contact = build_contact(scene, *_laws_rigid(scene))
    return Rigid(free, joined, contact, build_losses(scene)), reach


RIGID_SOLVER = ExactSolver(
    "rigid",
    rigid_lane,
    rigid_lanes,
    _laws_rigid,
    searched=True,
    take=_rigid,
    regime=lambda rigid: rigid.free,
    new_memory=new_rigid_memory,
)


# Exact, one absorber whose contacts are springs (paper, appendix A): a spring to the wall, and
# elastic Coulomb friction.


def _springs(scene: Scene) -> ContactStiffness:
    """Return wall and friction stiffness in N/m, 0 where absent."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    wall = fill_tuple(ElasticStops, absorber.walls)
    slider = fill_tuple(ElasticSlider, absorber.friction)
    return ContactStiffness(
        0.0 if wall is None else wall.stiffness, 0.0 if slider is None else slider.stiffness
    )


def wall_damper(scene: Scene) -> float:
    """Return the damper parallel to the spring of compliant walls in N s/m.

    It follows from the coefficient of restitution. Two free bodies that collide through a spring k
    and a damper c separate with e = exp(-pi zeta/sqrt(1 - zeta^2)) of their velocity, where c = 2
    zeta sqrt(k m) and 1/m = 1/m_a + sum phi_i^2 (Brogliato, Nonsmooth Mechanics, 2016, section
    2.1).
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
    """Return the regimes of compliant contact, and the reach of their tables in s.

    They are the free regime and those with the wall's spring, with the friction's spring, and with
    both. If a spring is absent, its regime is a copy of another one.
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


def _laws_compliant(scene: Scene) -> tuple[float, float | None]:
    """Return gap (m, infinite without walls) and friction limit (N, None without friction)."""
    absorber = scene.absorber
    assert isinstance(absorber, SlidingAbsorber)
    return (
        math.inf if absorber.walls is None else absorber.walls.gap,
        None if absorber.friction is None else absorber.friction.limit,
    )


def _sprung(scene: Scene, wanted: float, moves: bool, drive: Excitation | None) -> KernelArguments:
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
    new_memory=new_compliant_memory,
)


# Exact, scenes of one linear regime: no absorber, a stuck one, a tuned one. The exact method is a
# closed form, without events.


@cache_regimes
def linear_regime(scene: Scene, wanted: float, moves: bool = False) -> tuple[LinearRegime, float]:
    """Return the regime of a linear scene and the reach of its tables in s.

    The reach is ``wanted`` or less. ``moves``: whether the base moves.
    """
    model = scene.model
    mass = scene.absorber_mass
    link = scene.link
    speed, slots = find_fastest(model, mass, *(link or (None, 0.0)))
    size = padded_size(slots)
    reach = table_reach(speed, wanted)
    if mass is None:
        return free_regime(model, size, reach, moves=moves), reach
    heavy = find_largest_gravity(scene.absorber) != 0
    if link is None:
        return joined_regime(model, mass, size, reach, moves=moves, heavy=heavy), reach
    regime = sprung_regime(model, mass, *link, size, reach, moves=moves, heavy=heavy)
    return regime, reach


def _linear(scene: Scene, wanted: float, moves: bool, drive: Excitation | None) -> KernelArguments:
    regime, reach = linear_regime(scene, wanted, moves)
    return Linear(regime, build_losses(scene), find_largest_gravity(scene.absorber)), reach


LINEAR_SOLVER = ExactSolver(
    "linear",
    linear_lane,
    linear_lanes,
    lambda _: (),
    searched=False,
    take=_linear,
    regime=lambda linear: linear.regime,
    new_memory=new_linear_memory,
)


# Exact, several absorbers with rigid contact at places of their own: a regime for each set of
# joined ones, made when a run first needs it.
#
# The lane does a single absorber as well, which serves as a check: that has a family of its own,
# with other kernels.


@cache_regimes
def _set_layout(scene: Scene, wanted: float) -> SetLayout:
    return find_set_layout(scene.model, scene.absorber_shapes, scene.absorber_masses, wanted)


@cache_regimes
def _set_regime(scene: Scene, wanted: float, moves: bool, joined: Joined) -> tuple[Array, ...]:
    return build_set_regime(
        scene.model,
        scene.absorber_shapes,
        scene.absorber_masses,
        joined,
        _set_layout(scene, wanted),
        moves,
    )


def _absorbers(scene: Scene) -> Absorbers:
    """Return the kernels' arguments for the absorbers.

    An absorber without walls has walls at infinite distance.
    """
    every = (
        scene.absorber.absorbers
        if isinstance(scene.absorber, SeveralAbsorbers)
        else (scene.absorber,)
    )
    walls = [fill_tuple(Walls, scene.cavity(a)) or Walls(np.inf, 1.0) for a in range(len(every))]
    limit = np.array(
        [
            one.friction.limit
            if isinstance(one, SlidingAbsorber) and one.friction is not None
            else 0.0
            for one in every
        ]
    )
    return Absorbers(
        scene.absorber_masses,
        np.array([wall.gap for wall in walls]),
        np.array([wall.restitution for wall in walls]),
        np.array([wall.yield_velocity for wall in walls]),
        limit,
        scene.absorber_gravities,
        np.array(scene.absorber_shapes),
        np.array(scene.model.tip_shape),
        scene.model.omega**2,
    )


@dataclass(frozen=True)
class SeveralSolver(Solver):
    """Solver for several absorbers.

    Each run has its own places for regimes, which are filled during the run.
    """

    def run(
        self, scene: Scene, drive: Excitation, method: Exact, state: Array, observe: Observers
    ) -> int:
        """Integrate over the whole schedule, see `Solver.run`."""
        absorbers = _absorbers(scene)
        wanted = compute_window_length(drive)
        moves = has_bases(drive)
        places = RegimePlaces(len(absorbers.mass), partial(_set_regime, scene, wanted, moves))
        taken = Several(places.sets, absorbers, build_losses(scene))
        schedule = build_schedule(scene, drive, _set_layout(scene, wanted).reach)
        status = int(self.lane(taken, schedule, state, observe))
        if places.error is not None:
            raise places.error
        return status

    def control(
        self, scene: Scene, method: Exact, pseudo_period: float, batch: Batch
    ) -> Callable[[WorkQueue, int, int], bool]:
        """Raise: there are no lanes of several absorbers under control."""
        raise NotImplementedError


SEVERAL_SOLVER = SeveralSolver("several", several_lane, None, lambda _: (), searched=True)


# The stepping methods: Moreau's scheme for rigid contact, Runge-Kutta's for linear scenes and
# compliant contact.


def _writable(row: Array) -> Array:
    """Return a writable copy of an array.

    Kernels are compiled for writable arrays only, so that no second variant of them is built.
    """
    return np.array(row, dtype=np.float64, order="C")


def _modes(scene: Scene) -> BeamModes:
    model = scene.model
    return BeamModes(
        _writable(model.omega),
        _writable(model.damping_ratio),
        _writable(model.force_shape),
        _writable(model.tip_shape),
    )


def _force(scene: Scene, drive: Excitation) -> DriveForce:
    if isinstance(drive, Loads):
        taken = build_schedule(scene, drive, 1.0)
        assert taken.load is not None
        return DriveForce(taken.times, taken.omegas, taken.phases, 1.0, 0.0, taken.load)
    assert isinstance(drive, Drive)
    schedule = drive.schedule
    phases = schedule.phase_at(schedule.times)
    return DriveForce(
        _writable(schedule.times),
        _writable(schedule.omegas),
        _writable(phases),
        drive.amplitude,
        drive.phase,
        loads.NO_LOADS,
    )


def _wide(lanes: int, stride: int) -> int | None:
    padded = 4 * -(-lanes // 4)
    return padded if padded > stride else None


def _moreau_laws(scene: Scene) -> tuple[RigidLaws, int | None]:
    """Return the absorber's laws and the padded width of the table.

    A stuck absorber is one with an infinite friction limit.
    """
    walls = NO_WALLS
    limit: float | None = np.inf if isinstance(scene.absorber, StuckAbsorber) else 0.0
    if isinstance(scene.absorber, SlidingAbsorber):
        walls, limit = _laws_rigid(scene)
    laws = RigidLaws(scene.absorber_mass or 0.0, walls, limit or 0.0, build_spring(scene))
    return laws, _wide(scene.model.modes, moreau.STRIDE)


def _runge_kutta_laws(scene: Scene) -> tuple[CompliantLaws, int | None]:
    """Return the absorber's laws and the padded width of the table.

    A stuck absorber is a mass that is added to the tip.
    """
    absorber = scene.absorber
    mass = scene.absorber_mass or 0.0
    stops = runge_kutta_step.NO_STOPS
    slider = runge_kutta_step.NO_SLIDER
    if isinstance(absorber, SlidingAbsorber):
        stops = fill_tuple(ElasticStops, absorber.walls) or stops
        slider = fill_tuple(ElasticSlider, absorber.friction) or slider
    free_mass, added_mass = (0.0, mass) if isinstance(absorber, StuckAbsorber) else (mass, 0.0)
    cubic = runge_kutta_step.NO_CUBIC_SPRING
    if isinstance(absorber, NonlinearSink):
        cubic = CubicSpring(absorber.cubic_stiffness, absorber.damping)
    laws = CompliantLaws(free_mass, added_mass, stops, slider, build_spring(scene), cubic)
    return laws, _wide(scene.model.modes + 1, runge_kutta_step.STRIDE)


@dataclass(frozen=True)
class SteppingSolver(Solver):
    """Solver of a method with a fixed step.

    ``laws`` returns the absorber's laws for the kernels, and the padded width of the table. Laws
    and loads are values of the kernel's arguments, so one kernel simulates all scenes.
    """

    def key(self, scene: Scene, drive: Excitation | None = None) -> tuple[object, ...]:
        """Return the key of the kernels, see `Solver.key`."""
        return self.name, variant_key(self.laws(scene))

    def run(
        self,
        scene: Scene,
        drive: Excitation,
        method: Moreau | RungeKutta,
        state: Array,
        observe: Observers,
    ) -> int:
        """Integrate over the whole schedule, see `Solver.run`."""
        laws, wide = self.laws(scene)
        return int(
            self.lane(
                _modes(scene),
                laws,
                _force(scene, drive),
                state,
                TimeStep(method.step(scene), wide),
                observe,
            )
        )

    def control(
        self, scene: Scene, method: Moreau | RungeKutta, pseudo_period: float, batch: Batch
    ) -> Callable[[WorkQueue, int, int], bool]:
        """Return the kernel that advances lanes, see `Solver.control`."""
        assert self.lanes is not None
        laws, wide = self.laws(scene)
        # a state of steps does not hold the slider
        require(
            not isinstance(laws, CompliantLaws) or laws.slider.limit == 0,
            "method",
            method,
            "Exact for elastic friction that is controlled in intervals",
        )
        step = TimeStep(method.step(scene), wide)
        return partial(self.lanes, _modes(scene), laws, step, batch, new_stepping_memory(batch))


MOREAU_SOLVER = SteppingSolver("moreau", moreau_lane, moreau_lanes, _moreau_laws, searched=False)
RUNGE_KUTTA_SOLVER = SteppingSolver(
    "runge_kutta", runge_kutta_lane, runge_kutta_lanes, _runge_kutta_laws, searched=False
)


# Which method can simulate which kind of scene.


@dataclass(frozen=True)
class Capability:
    """Whether and how a method simulates a kind of scene.

    Attributes
    ----------
    solver : Solver or None
        The solver, None if the method cannot simulate the scene.
    refusal : str
        Text that names an alternative, without a solver.
    moves_base : bool
        Whether the base may move.
    general : bool
        Whether gravity, and forces that differ in phase, are allowed.
    """

    solver: Solver | None
    refusal: str = ""
    moves_base: bool = False
    general: bool = False


CAPABILITIES: dict[tuple[SceneKind, type[Method]], Capability] = {
    (SceneKind.LINEAR, Exact): Capability(LINEAR_SOLVER, moves_base=True, general=True),
    (SceneKind.LINEAR, Moreau): Capability(MOREAU_SOLVER),
    (SceneKind.LINEAR, RungeKutta): Capability(RUNGE_KUTTA_SOLVER),
    (SceneKind.RIGID, Exact): Capability(RIGID_SOLVER, moves_base=True, general=True),
    (SceneKind.RIGID, Moreau): Capability(MOREAU_SOLVER),
    (SceneKind.RIGID, RungeKutta): Capability(
        None,
        (
            "for rigid walls or rigid friction Exact or Moreau, since RungeKutta needs a force "
            "that is a function of the state"
        ),
    ),
    (SceneKind.COMPLIANT, Exact): Capability(COMPLIANT_SOLVER),
    (SceneKind.COMPLIANT, Moreau): Capability(
        None, "for compliant contact Exact or RungeKutta, since the Moreau scheme is for rigid laws"
    ),
    (SceneKind.COMPLIANT, RungeKutta): Capability(RUNGE_KUTTA_SOLVER),
    (SceneKind.SMOOTH, Exact): Capability(
        None, "RungeKutta for a nonlinear spring, which has no linear regimes"
    ),
    (SceneKind.SMOOTH, Moreau): Capability(None, "RungeKutta for a nonlinear spring"),
    (SceneKind.SMOOTH, RungeKutta): Capability(RUNGE_KUTTA_SOLVER),
    (SceneKind.SEVERAL, Exact): Capability(SEVERAL_SOLVER, moves_base=True, general=True),
    (SceneKind.SEVERAL, Moreau): Capability(None, "Exact for several absorbers"),
    (SceneKind.SEVERAL, RungeKutta): Capability(None, "Exact for several absorbers"),
}
MOVES_BASE = (
    "for that Exact, and a scene without absorber, with one that is stuck or tuned, or with rigid "
    "contact"
)


def find_capability(scene: Scene, method: Method) -> Capability:
    """Return the capability of a method for a scene's kind.

    A method that is derived from one of the library's methods has the capability of that method.

    Raises ParameterError for a scene or a method of another class.
    """
    scene = instance("scene", scene, Scene)
    method = instance("method", method, Method)
    known = next(known for known in METHODS.values() if isinstance(method, known))
    return CAPABILITIES[scene.kind, known]


def find_solver(scene: Scene, method: Method) -> Solver:
    """Return the solver that simulates a scene with a method.

    Raises ParameterError if the method cannot simulate the scene.
    """
    able = find_capability(scene, method)
    if (heavy := find_largest_gravity(scene.absorber)) != 0:
        allowed = f"0 with {method} and {scene.kind.value}; {MOVES_BASE}"
        require(able.general, "gravity", heavy, allowed)
    require(able.solver is not None, "method", method, able.refusal)
    friction = getattr(scene.absorber, "friction", None)
    static = isinstance(friction, CoulombFriction) and friction.static_ratio != 1
    require(
        not static or isinstance(method, Exact),
        "method",
        method,
        "Exact for static friction above sliding friction: Moreau's law has one limit",
    )
    walls = getattr(scene.absorber, "walls", None)
    damped = isinstance(walls, CompliantWalls) and walls.restitution < 1
    require(
        not damped or isinstance(method, Exact),
        "method",
        method,
        (
            "Exact for compliant walls with a restitution below 1: their damper's force jumps at "
            "the touch"
        ),
    )
    assert able.solver is not None
    return able.solver


def kernel_key(scene: Scene, method: Method, drive: Excitation | None = None) -> tuple[object, ...]:
    """Return the key of a run's kernels, see `Solver.key`.

    Raises ParameterError as `find_solver` does.
    """
    solver = find_solver(scene, method)
    return solver.key(scene) if drive is None else solver.key(*split_forces(scene, drive))


def check_load(scene: Scene, drive: Excitation, method: Method) -> None:
    """Raise ParameterError if a scene or a method cannot have a drive.

    Such drives are a base that moves, or forces that differ in phase.
    """
    check_places(scene.model, drive)
    able = find_capability(scene, method).general
    value = f"given with {method} and {scene.kind.value}"
    if scene.model.force_quadrature is not None:
        require(able, "force_quadrature", value, f"forces of one phase; {MOVES_BASE}")
    if isinstance(drive, Loads) and drive.force_places:
        require(able, "place", drive.force_places, f"left out with {method}; {MOVES_BASE}")
    if drive.moves_base:
        _check_base(scene, method, [type(part).__name__ for part in drive.parts], True)


def check_general(
    scene: Scene, method: Method, record: Samples | None, *, moves_base: bool
) -> bool:
    """Return whether the base moves in runs in intervals.

    Raises ParameterError if a scene or a method cannot have a moving base, or a record in addition
    to the force.
    """
    one_phase = scene.model.force_quadrature is None
    require(one_phase, "force_quadrature", "given", "None under control")
    shaken = bool(moves_base) or (record is not None and record.quantity == BASE_QUANTITY)
    if shaken or record is not None:
        loads = ["a record"] * (record is not None) + ["a base that moves"] * shaken
        _check_base(scene, method, loads, shaken)
    return shaken


def _check_base(scene: Scene, method: Method, loads: list[str], moves_base: bool) -> None:
    able = find_capability(scene, method).moves_base
    require(able, "loads", loads, f"forces with {method} and {scene.kind.value}; {MOVES_BASE}")
    allowed = (
        "given for a base that moves: the participation of the modes (base_vector, or "
        "base_participation_sqrt_kg)"
    )
    require(
        not moves_base or scene.model.base_participation is not None,
        "base_participation",
        None,
        allowed,
    )
