"""Energy of a state, and the balance of a run (paper, Eqs. Einst and edmi)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import CompliantWalls, SlidingAbsorber, TunedAbsorber
from impact_env.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EnergyAccount:
    """Work of the force, losses and stored energy in J over a run (paper, Eqs. Einst and edmi); ``modal_loss`` (N_m,)."""

    work: float
    modal_loss: Array
    friction_loss: float
    impact_loss: float
    absorber_damping: float
    stored_at_start: float
    stored_at_end: float

    @property
    def balance_error(self) -> float:
        """Work less losses less gain of stored energy, in J."""
        losses = float(np.sum(self.modal_loss)) + self.friction_loss + self.impact_loss + self.absorber_damping
        return self.work - losses - (self.stored_at_end - self.stored_at_start)

    @property
    def relative_error(self) -> float:
        """Balance error relative to the largest term of the balance."""
        scale = max(abs(self.work), float(np.sum(self.modal_loss)), abs(self.stored_at_start), abs(self.stored_at_end))
        return abs(self.balance_error) / scale if scale > 0 else abs(self.balance_error)


def stored_energy(scene: Scene, state: Array) -> float:
    """Return the energy of modes, absorber and springs of a state (2 N_m + 2,) in J (paper, Eq. Einst)."""
    n, model = scene.model.modes, scene.model
    energy = 0.5 * float(np.sum((model.omega * state[:n]) ** 2 + state[n + 1 : 2 * n + 1] ** 2))
    if scene.absorber_mass is not None:
        energy += 0.5 * scene.absorber_mass * float(state[2 * n + 1]) ** 2
        energy += contact_energy(scene, float(state[n] - model.tip_shape @ state[:n]))
    return energy


def contact_energy(scene: Scene, relative_displacement: float) -> float:
    """Return the energy in J of the absorber's spring or of the walls' springs at a relative displacement in m."""
    absorber = scene.absorber
    if isinstance(absorber, TunedAbsorber):
        return 0.5 * absorber.stiffness * relative_displacement**2
    if isinstance(absorber, SlidingAbsorber) and isinstance(absorber.walls, CompliantWalls):
        return 0.5 * absorber.walls.stiffness * max(abs(relative_displacement) - absorber.walls.gap, 0.0) ** 2
    return 0.0
