"""One point of the parameters of a scene with contact of any kind.

Two to four absorbers, or one whose walls are rigid or springs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    finite,
    kind_of,
    labelled,
    positive,
    require,
)
from impact_env.drive import Drive, FrequencySchedule
from impact_env.fields import check_fields
from impact_env.modes import require_one_phase
from impact_env.parameters import (
    CompliantWalls,
    ElasticCoulombFriction,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    require_weightless,
)
from impact_env.scene import Scene
from impact_env.solvers import wall_damper

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ContactLaws:
    """Masses and contact laws of n absorbers.

    Attributes
    ----------
    mass : array, (n,)
        Masses in kg.
    gap : array, (n,)
        Clearances in m, infinite without walls.
    restitution : array, (n,)
        Coefficients of restitution.
    limit : array, (n,)
        Friction limits in N.
    compliant : bool
        Whether contact is by springs; n is then 1.
    wall_stiffness, wall_damper, slider_stiffness : float
        Spring (N/m) and damper (N s/m) of a wall, and spring of the friction (N/m), 0 where absent.
    """

    mass: Array
    gap: Array
    restitution: Array
    limit: Array
    compliant: bool = False
    wall_stiffness: float = 0.0
    wall_damper: float = 0.0
    slider_stiffness: float = 0.0

    @property
    def has_slider(self) -> bool:
        """Whether friction acts by a spring, whose slider has a position of its own."""
        return self.slider_stiffness > 0


@dataclass(frozen=True, eq=False)
class HybridCase:
    """A scene with contact under a harmonic force, at one frequency.

    Parameters
    ----------
    scene : Scene
        Structure with one sliding absorber, rigid or compliant, or with two to four absorbers.
    omega : float
        Frequency of the force in rad/s.
    force : float
        Amplitude of the force in N.

    Raises
    ------
    ParameterError
        A value is out of range, or the scene has another absorber, a weight along its motion,
        walls that yield, or a static friction other than the sliding one.

    Examples
    --------
    >>> from impact_env import CompliantWalls, SlidingAbsorber, beam_scene
    >>> scene = beam_scene(absorber=SlidingAbsorber(0.02, CompliantWalls(1e6)))
    >>> HybridCase(scene, 250.0, 1.5).laws.compliant
    True
    """

    scene: Scene
    omega: float
    force: float

    def __post_init__(self) -> None:
        check_fields(
            self,
            scene=kind_of(Scene),
            omega=labelled("frequency", positive),
            force=labelled("force amplitude", finite),
        )
        require_weightless(self.scene.absorber, "periodic orbits")
        require_one_phase(self.scene.model, "periodic orbits")
        for absorber in self.absorbers:
            _check_absorber(absorber)

    @property
    def absorbers(self) -> tuple[SlidingAbsorber, ...]:
        """The absorbers; raises ParameterError if there are none that slide."""
        absorber = self.scene.absorber
        if isinstance(absorber, SeveralAbsorbers):
            return absorber.absorbers
        require(
            isinstance(absorber, SlidingAbsorber),
            "absorber",
            absorber,
            "an absorber that slides, or several, for periodic orbits",
        )
        assert isinstance(absorber, SlidingAbsorber)
        return (absorber,)

    @cached_property
    def laws(self) -> ContactLaws:
        """Masses and contact laws as numbers."""
        every = self.absorbers
        walls = [absorber.walls for absorber in every]
        friction = [absorber.friction for absorber in every]
        gap = np.array([math.inf if wall is None else wall.gap for wall in walls])
        restitution = np.array([1.0 if wall is None else wall.restitution for wall in walls])
        limit = np.array([0.0 if one is None else one.limit for one in friction])
        compliant = isinstance(walls[0], CompliantWalls) or isinstance(
            friction[0], ElasticCoulombFriction
        )
        return ContactLaws(
            self.scene.absorber_masses,
            gap,
            restitution,
            limit,
            compliant,
            walls[0].stiffness if isinstance(walls[0], CompliantWalls) else 0.0,
            wall_damper(self.scene) if compliant else 0.0,
            friction[0].stiffness if isinstance(friction[0], ElasticCoulombFriction) else 0.0,
        )

    @cached_property
    def compliance(self) -> Array:
        """Relative acceleration (n, n) of each absorber in 1/kg per unit force at each absorber.

        The force acts between the absorber and the structure.
        """
        shapes = self.scene.absorber_shapes
        return np.asarray(shapes @ shapes.T + np.diag(1 / self.laws.mass))

    @cached_property
    def length(self) -> float:
        """Unit of displacements in m.

        It is the least clearance, or without walls the amplitude to which the force moves the
        absorbers.
        """
        least = float(np.min(self.laws.gap))
        if math.isfinite(least):
            return least
        return abs(self.force) / (float(np.sum(self.laws.mass)) * self.omega**2) or 1.0

    @cached_property
    def units(self) -> Array:
        """Unit of each entry of a state, (2 N_m + 2 n,).

        It is `length` for displacements, and `length` times the force's frequency for velocities.
        """
        half = self.scene.model.modes + self.scene.places
        return np.repeat([self.length, self.length * self.omega], half)

    @property
    def omega_ratio(self) -> float:
        """Frequency over the first resonance's."""
        return self.omega / float(self.scene.model.omega[0])

    @property
    def period(self) -> float:
        """Period of the force in s."""
        return 2 * math.pi / self.omega

    def changed(self, **values: float) -> HybridCase:
        """Return the case at another ``omega`` (rad/s) or ``force`` (N)."""
        return replace(self, **values)  # type: ignore[arg-type]

    def drive(self, duration: float, phase: float) -> Drive:
        """Return the force for ``duration`` s, starting with ``phase`` (rad)."""
        schedule = FrequencySchedule(
            np.array([0.0, duration]),
            np.full(2, self.omega),
            float(self.scene.model.omega[0]),
        )
        return Drive(self.force, schedule, phase)


def _check_absorber(absorber: SlidingAbsorber) -> None:
    """Raise ParameterError for an absorber whose contact has no derivative here."""
    walls = absorber.walls
    allowed = "rigid walls with a constant restitution, or springs, for periodic orbits"
    require(
        walls is None or isinstance(walls, RigidWalls | CompliantWalls), "walls", walls, allowed
    )
    gap = math.inf if walls is None else walls.gap
    require(gap > 0, "gap", gap, "above 0 m for periodic orbits")
    ratio = getattr(absorber.friction, "static_ratio", 1.0)
    require(ratio == 1, "static_ratio", ratio, "1 for periodic orbits")
