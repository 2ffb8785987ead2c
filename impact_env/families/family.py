"""The interface of a family of kernels, and what all families of the exact method share."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.control.interval import Batch
from impact_env.kernels.control.work_queue import WorkQueue
from impact_env.kernels.exact.rigid_contact import ContactLaw, Walls
from impact_env.kernels.motion import loads
from impact_env.kernels.motion.observers import Observers
from impact_env.kernels.motion.segments import Losses, Schedule
from impact_env.laws import find_law
from impact_env.loads import AnyDrive, Loads
from impact_env.parameters import CoulombFriction, TunedAbsorber, find_largest_gravity
from impact_env.scene import Scene

Array = NDArray[np.float64]


def variant_key(law: object) -> object:
    """Return whether a law is absent; of one that has parts which may be, which of them are."""
    return tuple(map(variant_key, law)) if isinstance(law, tuple) else law is None


@dataclass(frozen=True)
class Solver(ABC):
    """Kernels for some kinds of scenes: ``lane`` makes a single run, ``lanes`` advances many under control (None: there is no such kernel).

    ``laws``: parts of a scene without which the kernels are others, None where absent. ``searched``: whether its events are searched for.
    """

    name: str
    lane: Callable[..., int]
    lanes: Callable[..., bool] | None
    laws: Callable[[Scene], tuple[Any, ...]]
    searched: bool

    def key(self, scene: Scene, drive: AnyDrive | None = None) -> tuple[object, ...]:
        """Return a key, equal exactly for runs with one record that the same compiled kernels simulate (``drive`` None: one force).

        It holds all that is None or not in the kernels' arguments: laws, gravity, loads, a base that moves.
        """
        loads = (drive.moves_base,) if isinstance(drive, Loads) else None
        return (
            self.name,
            variant_key(self.laws(scene)),
            find_gravity(scene, drive) is None,
            loads,
        )

    @abstractmethod
    def run(
        self, scene: Scene, drive: AnyDrive, method: Any, state: Array, observe: Observers
    ) -> int:
        """Integrate over the whole schedule and return a status code of `impact_env.kernels.motion.observers`.

        ``state`` (2 N_m + 2 n,) is the start and becomes the end. ``observe``, with a new clock, is filled. A slider of elastic friction starts
        without force.
        """

    @abstractmethod
    def control(
        self, scene: Scene, method: Any, pseudo_period: float, batch: Batch
    ) -> Callable[[WorkQueue, int, int], bool]:
        """Return the kernel of `kernels.control.lanes` that advances lanes by their orders' intervals; ``pseudo_period`` in s."""

    def slots(self, scene: Scene, pseudo_period: float) -> int:
        """Return the number of slots that a lane under control keeps between intervals; 1 where it keeps nothing but its state."""
        return 1


# What the families of the exact method share: the losses, the schedule of windows, the contact at one absorber.


WINDOW_PERIODS = 3.2  # wanted length of a window of the chirp, in pseudo periods


def load_law(law: object) -> Any:
    """Return the kernels' argument for a law (`laws.Law.kernel`): None for an absent law, and for one of which they need no numbers."""
    name = None if law is None else find_law(law).kernel
    if name is None or "." not in name:
        return None if name is None else getattr(law, name)
    module, _, kind = name.rpartition(".")
    taken = getattr(import_module(f"impact_env.kernels.{module}"), kind)
    return taken(*(getattr(law, field, None) for field in taken._fields))


def compute_window_length(drive: AnyDrive) -> float:
    """Return the wanted length of a window in s."""
    return WINDOW_PERIODS * drive.schedule.pseudo_period


def build_schedule(scene: Scene, drive: AnyDrive, reach: float) -> Schedule:
    """Return a drive as the exact kernels take it, in windows of at most ``reach`` (s)."""
    if isinstance(drive, Loads):
        times, pieces, which, moves_base = drive.on_one_clock()
        load = loads.LoadPieces(
            pieces, which, moves_base, build_base_motion(scene) if moves_base.any() else None
        )
        return Schedule(times, np.zeros(len(times)), np.zeros(len(times)), 0.0, reach, load)
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


def build_base_motion(scene: Scene) -> loads.BaseParticipation:
    """Return the participations of a scene's modes and absorber in a base that moves."""
    model = scene.model
    mass = scene.absorber_mass or 0.0
    assert model.base_participation is not None
    return loads.BaseParticipation(
        np.array(model.base_participation),
        model.base_at_absorber,
        mass * model.base_at_absorber,
    )


def find_gravity(scene: Scene, drive: AnyDrive | None = None) -> float | None:
    """Return the gravity (m/s^2) along a single absorber's motion, None without; under loads 0 in place of None, so that one kernel does for both."""
    return (
        find_largest_gravity(scene.absorber)
        if isinstance(drive, Loads)
        else find_largest_gravity(scene.absorber) or None
    )


def build_losses(scene: Scene) -> Losses:
    """Return the losses of a scene: shapes at force and tip, the modes' damping, and a tuned absorber's damper."""
    model = scene.model
    absorber = scene.absorber
    damper = absorber.damping if isinstance(absorber, TunedAbsorber) else 0.0
    return Losses(
        np.array(model.force_shape),
        np.array(model.tip_shape),
        2 * model.damping_ratio * model.omega,
        damper,
    )


def find_static_ratio(absorber: object) -> float:
    """Return the limit of static over that of sliding friction, 1 where there is no rigid friction."""
    friction = getattr(absorber, "friction", None)
    return friction.static_ratio if isinstance(friction, CoulombFriction) else 1.0


def build_contact(
    scene: Scene,
    walls: Walls | None = None,
    limit: float | None = None,
    drive: AnyDrive | None = None,
) -> ContactLaw:
    """Return the contact of one absorber with its place; rigid walls, and friction limit (N), None where absent. ``drive``: as in `find_gravity`."""
    mass = scene.absorber_mass
    tip_shape = np.array(scene.model.tip_shape)
    assert mass is not None
    return ContactLaw(
        mass,
        1 / mass + float(np.sum(tip_shape**2)),
        tip_shape,
        walls,
        limit,
        find_gravity(scene, drive),
        find_static_ratio(scene.absorber),
    )
