"""Energy of a state, and the balance of a run (paper, Eqs. Einst and edmi)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.laws import find_law, list_laws
from impact_env.results import History
from impact_env.scene import Scene

Array = NDArray[np.float64]


def stored_energy(scene: Scene, state: Array) -> float:
    """Return the energy in J of a state (2 N_m + 2 n,) with n absorbers (paper, Eq. Einst).

    The energy is the sum over modes, absorbers, springs and weights.
    """
    n = scene.model.modes
    model = scene.model
    half = len(state) // 2
    energy = 0.5 * float(np.sum((model.omega * state[:n]) ** 2 + state[half : half + n] ** 2))
    if scene.absorber_mass is not None:
        energy += 0.5 * float(scene.absorber_masses @ state[half + n :] ** 2)
        # springs; several absorbers have none, since their contact is rigid
        displacement = float(state[n] - model.tip_shape @ state[:n])
        if scene.link is not None:
            energy += 0.5 * scene.link.stiffness * displacement**2
        energy += sum(find_law(law).stored(law, displacement) for law in list_laws(scene.absorber))
        energy += float((scene.absorber_masses * scene.absorber_gravities) @ state[n:half])
    return energy


@dataclass(frozen=True, eq=False)
class MechanicalEnergy:
    """Energy in J at the samples of a run (paper, Eq. Einst).

    ``modal`` (S, N_m) is the energy of each mode and ``absorber`` (S,) the kinetic energy of the
    absorbers.
    """

    modal: Array
    absorber: Array

    @property
    def total(self) -> Array:
        """Energy of all modes and all absorbers in J, (S,)."""
        return np.asarray(np.sum(self.modal, axis=1) + self.absorber)

    @property
    def absorber_share(self) -> Array:
        """Share of the absorber in the total, (S,); 0 where nothing moves."""
        total = self.total
        return np.divide(self.absorber, total, out=np.zeros_like(total), where=total > 0)


def mechanical_energy(scene: Scene, history: History) -> MechanicalEnergy:
    """Return the energy of modes and absorbers at the samples of a run (paper, Eq. Einst).

    As in the paper only the kinetic energy of absorbers counts, not that of the springs of a tuned
    absorber or of compliant walls (see `stored_energy`). In a scene without absorber their
    energy is 0.
    """
    modal = 0.5 * (
        (scene.model.omega * history.modal_displacement) ** 2 + history.modal_velocity**2
    )
    velocity = history.absorber_velocity.reshape(len(history.time), -1)
    return MechanicalEnergy(
        np.asarray(modal), np.asarray(0.5 * velocity**2 @ scene.absorber_masses)
    )
