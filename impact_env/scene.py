"""What is present: a modal model and, if there is one, an absorber. Absent parts are None."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Absorber, Beam, RigidWalls, SlidingAbsorber, StuckAbsorber, TunedAbsorber, require


@dataclass(frozen=True, eq=False)
class Scene:
    """A beam's modal model with at most one absorber."""

    model: ModalModel
    absorber: Absorber | None = None

    def __post_init__(self) -> None:
        allowed = (StuckAbsorber, TunedAbsorber, SlidingAbsorber)
        require(self.absorber is None or isinstance(self.absorber, allowed), "absorber", self.absorber, "None or one of the absorber classes")
        sliding = self.absorber if isinstance(self.absorber, SlidingAbsorber) else None
        # a cavity without clearance holds the mass: the same mechanics as a stuck absorber
        if sliding is not None and isinstance(sliding.walls, RigidWalls) and sliding.walls.gap == 0:
            object.__setattr__(self, "absorber", StuckAbsorber(sliding.mass_ratio))
        elif sliding is not None and isinstance(sliding.walls, RigidWalls) and np.isinf(sliding.walls.gap):
            without = None if sliding.friction is None else SlidingAbsorber(sliding.mass_ratio, None, sliding.friction)
            object.__setattr__(self, "absorber", without)

    @property
    def absorber_mass(self) -> float | None:
        """Absorber mass in kg, or None."""
        return None if self.absorber is None else self.absorber.mass_ratio * self.model.beam_mass


def beam_scene(beam: Beam | None = None, absorber: Absorber | None = None) -> Scene:
    """Return the scene of a beam (default: the paper's) and an absorber (default: none)."""
    return Scene(modal_model(Beam() if beam is None else beam), absorber)


@dataclass(frozen=True, eq=False)
class InitialState:
    """State at time 0: modal displacement (N_m,) and velocity (N_m,), absorber displacement (m) and velocity (m/s). None is rest.

    An absorber displacement of None puts the absorber at the middle of the cavity: it starts with the tip's displacement.
    """

    modal_displacement: NDArray[np.float64] | None = None
    modal_velocity: NDArray[np.float64] | None = None
    absorber_displacement: float | None = None
    absorber_velocity: float = 0.0

    def vector(self, scene: Scene) -> NDArray[np.float64]:
        """Return (2 N_m + 2,): modal displacements, absorber displacement, modal velocities, absorber velocity.

        Raises ParameterError on a wrong length, a value that is not finite, or a start outside the cavity.
        """
        n = scene.model.modes
        state = np.zeros(2 * n + 2)
        for name, at in (("modal_displacement", 0), ("modal_velocity", n + 1)):
            values = getattr(self, name)
            if values is not None:
                values = np.asarray(values, dtype=float)
                require(values.shape == (n,) and bool(np.all(np.isfinite(values))), name, values, f"{n} finite numbers, one per mode")
                state[at : at + n] = values
        tip = scene.model.tip_shape @ state[:n]
        state[n] = tip if self.absorber_displacement is None else self.absorber_displacement
        state[2 * n + 1] = self.absorber_velocity
        require(bool(np.all(np.isfinite(state[[n, -1]]))), "absorber start", (self.absorber_displacement, self.absorber_velocity), "finite numbers")
        if isinstance(scene.absorber, SlidingAbsorber) and isinstance(scene.absorber.walls, RigidWalls):
            gap, distance = scene.absorber.walls.gap, state[n] - tip
            allowed = f"a start inside the cavity, within {gap} m of the tip's displacement {tip} m"
            require(abs(distance) <= gap * (1 + 1e-12), "absorber_displacement", self.absorber_displacement, allowed)
        if isinstance(scene.absorber, StuckAbsorber):
            state[2 * n + 1] = scene.model.tip_shape @ state[n + 1 : 2 * n + 1]
        return state
