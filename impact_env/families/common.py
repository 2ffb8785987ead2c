"""What the families of the exact method share: the losses, the schedule of windows, the contact at one absorber."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import Drive
from impact_env.kernels.exact.rigid_contact import Contact, Walls
from impact_env.kernels.motion import loads
from impact_env.kernels.motion.segments import Losses, Schedule
from impact_env.kernels.motion.vector import TERMS
from impact_env.laws import entry
from impact_env.loads import AnyDrive, Loads
from impact_env.parameters import TunedAbsorber, gravity_of
from impact_env.scene import Scene

Array = NDArray[np.float64]
WINDOW_PERIODS = 3.2  # wanted length of a window of the chirp, in pseudo periods


def compiled(law: object) -> Any:
    """Return what the kernels take for a law (`laws.Law.kernel`), None for one that is absent, or that they need nothing of."""
    name = None if law is None else entry(law).kernel
    if name is None or "." not in name:
        return None if name is None else getattr(law, name)
    module, _, kind = name.rpartition(".")
    taken = getattr(import_module(f"impact_env.kernels.{module}"), kind)
    return taken(*(getattr(law, field, None) for field in taken._fields))


def window_of(drive: AnyDrive) -> float:
    """Return the wanted length of a window in s."""
    return WINDOW_PERIODS * drive.schedule.pseudo_period


def schedule_of(scene: Scene, drive: AnyDrive, reach: float) -> Schedule:
    """Return a drive as the exact kernels take it, in windows of at most ``reach`` (s)."""
    if isinstance(drive, Loads):
        return _schedule_of_loads(scene, drive, reach)
    assert isinstance(drive, Drive)
    breaks = drive.schedule
    phases = breaks.phase_at(breaks.times) + drive.phase
    return Schedule(np.array(breaks.times), np.array(breaks.omegas), np.asarray(phases), drive.amplitude, reach, None)


def _schedule_of_loads(scene: Scene, drive: Loads, reach: float) -> Schedule:
    times, pieces, which, moves_base = drive.on_one_clock()
    base = None
    if moves_base.any():
        model, mass = scene.model, scene.absorber_mass or 0.0
        assert model.base_participation is not None
        base = loads.Base(np.zeros((2, TERMS)), np.array(model.base_participation), model.base_at_absorber, mass * model.base_at_absorber)
    load = loads.Load(pieces, which, moves_base, np.zeros((2, TERMS)), base)
    return Schedule(times, np.zeros(len(times)), np.zeros(len(times)), 0.0, reach, load)


def moves_base(drive: AnyDrive | None) -> bool:
    """Return whether a drive moves the base."""
    return isinstance(drive, Loads) and drive.moves_base


def gravity_in(scene: Scene, drive: AnyDrive | None = None) -> float | None:
    """Return the gravity (m/s^2) along a single absorber's motion, None where there is none, but under loads 0: so they need no kernels without."""
    return gravity_of(scene.absorber) if isinstance(drive, Loads) else gravity_of(scene.absorber) or None


def losses_of(scene: Scene) -> Losses:
    """Return the losses of a scene: shapes at force and tip, the modes' damping, and a tuned absorber's damper."""
    model, absorber = scene.model, scene.absorber
    damper = absorber.damping if isinstance(absorber, TunedAbsorber) else 0.0
    return Losses(np.array(model.force_shape), np.array(model.tip_shape), 2 * model.damping_ratio * model.omega, damper)


def contact_of(scene: Scene, walls: Walls | None = None, limit: float | None = None, drive: AnyDrive | None = None) -> Contact:
    """Return the contact of one absorber with its place; rigid walls, and friction limit (N), None where absent. ``drive``: as in `gravity_in`."""
    mass, tip_shape = scene.absorber_mass, np.array(scene.model.tip_shape)
    assert mass is not None
    return Contact(mass, 1 / mass + float(np.sum(tip_shape**2)), tip_shape, walls, limit, gravity_in(scene, drive))
