"""The integration methods and what each of them can do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impact_env.parameters import CompliantWalls, CoulombFriction, ElasticCoulombFriction, RigidWalls, SlidingAbsorber, TunedAbsorber, count, require
from impact_env.scene import Scene

PAPER_STEPS = 20  # per period of the highest mode (paper, section 2.3), and per contact (paper, appendix A)


def _compliance(scene: Scene) -> float:
    """Return the relative acceleration of absorber and tip per unit of force between them, 1/m_a + sum tip_shape^2, in 1/kg."""
    mass = scene.absorber_mass
    return float(np.sum(scene.model.tip_shape**2)) + (0.0 if mass is None else 1 / mass)


def _highest_frequency(scene: Scene) -> float:
    """Return the highest circular frequency (rad/s) that a step must resolve: a mode's, or the tuned absorber's against the tip."""
    highest = float(np.max(scene.model.omega))
    if isinstance(scene.absorber, TunedAbsorber):
        highest = max(highest, np.sqrt(scene.absorber.stiffness * _compliance(scene)), scene.absorber.damping * _compliance(scene))
    return highest


def _contact_stiffness(scene: Scene) -> float | None:
    """Return the largest compliant contact stiffness in N/m, or None."""
    sliding = scene.absorber
    if not isinstance(sliding, SlidingAbsorber):
        return None
    springs = [part.stiffness for part in (sliding.walls, sliding.friction) if isinstance(part, CompliantWalls | ElasticCoulombFriction)]
    return max(springs, default=None)


@dataclass(frozen=True)
class Exact:
    """Event-driven propagation by linear regimes; every scene."""


@dataclass(frozen=True)
class Moreau:
    """The paper's time stepping for rigid contact (paper, section 2.3): ``steps_per_period`` of the highest mode."""

    steps_per_period: int = PAPER_STEPS

    def __post_init__(self) -> None:
        count("steps_per_period", self.steps_per_period, 4)

    def step(self, scene: Scene) -> float:
        """Return the time step in s."""
        return 2 * np.pi / (self.steps_per_period * _highest_frequency(scene))


@dataclass(frozen=True)
class RungeKutta:
    """Classical fourth-order stepping for linear scenes and compliant contact (paper, appendix A): steps per period of the highest mode
    and per contact, whose duration is pi sqrt(m_a/k).
    """  # noqa: D205

    steps_per_period: int = PAPER_STEPS
    steps_per_contact: int = PAPER_STEPS

    def __post_init__(self) -> None:
        count("steps_per_period", self.steps_per_period, 4)
        count("steps_per_contact", self.steps_per_contact, 4)

    def step(self, scene: Scene) -> float:
        """Return the time step in s, the smallest of the two conditions of the paper.

        The paper's contact duration takes the beam as immovable. Where the tip gives way more easily than the absorber the contact is
        shorter, and a third condition, 1/sqrt(k (1/m_a + sum tip_shape^2)), keeps the method stable.
        """
        dt = 2 * np.pi / (self.steps_per_period * _highest_frequency(scene))
        stiffness, mass = _contact_stiffness(scene), scene.absorber_mass
        if stiffness is not None and mass is not None:
            dt = min(dt, np.pi * np.sqrt(mass / stiffness) / self.steps_per_contact, 1 / np.sqrt(stiffness * _compliance(scene)))
        return float(dt)


Method = Exact | Moreau | RungeKutta


def check_supported(scene: Scene, method: Method) -> None:
    """Raise ParameterError if a method cannot do a scene."""
    require(isinstance(method, Exact | Moreau | RungeKutta), "method", method, "Exact(), Moreau(...) or RungeKutta(...)")
    sliding = scene.absorber
    if not isinstance(sliding, SlidingAbsorber):
        return
    parts = (sliding.walls, sliding.friction)
    if isinstance(method, Moreau):
        compliant = any(isinstance(part, CompliantWalls | ElasticCoulombFriction) for part in parts)
        require(not compliant, "method", method, "for compliant contact Exact or RungeKutta, since the Moreau scheme is for rigid laws")
    if isinstance(method, RungeKutta):
        rigid = any(isinstance(part, RigidWalls | CoulombFriction) for part in parts)
        require(
            not rigid,
            "method",
            method,
            "for rigid walls or rigid friction Exact or Moreau, since RungeKutta needs a force that is a function of the state",
        )
