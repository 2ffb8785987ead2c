"""One point of the parameters of periodic orbits: structure, absorber, force and frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    finite,
    instance,
    kind_of,
    labelled,
    non_negative,
    positive,
    require,
)
from impact_env.drive import Drive, FrequencySchedule
from impact_env.fields import check_fields
from impact_env.kernels.periodic.structure import Point, Scale, Structure
from impact_env.modes import ModalModel, require_one_phase
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    RigidWalls,
    SlidingAbsorber,
    check_restitution,
    impact_absorber,
    require_weightless,
)
from impact_env.periodic.model_parameters import (
    ABSORBER_POSITION,
    DAMPING_RATIO,
    damping_of,
    position_of,
    with_damping,
    with_position,
)
from impact_env.scene import Scene
from impact_env.secular import SPLIT_TOL, raise_off_axis

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Case:
    """A structure with an impact absorber under a harmonic force: one point of all parameters.

    Parameters
    ----------
    model : ModalModel
        Modes of the structure.
    omega : float
        Frequency of the force in rad/s.
    force : float
        Amplitude of the force in N.
    gap : float, optional
        Clearance to either wall in m.
    restitution : float, optional
        Coefficient of restitution, 0 to 1.
    friction_limit : float, optional
        Force of sliding friction in N, 0 without friction.
    mass_ratio : float, optional
        Mass of the absorber over the mass of the structure.

    Raises
    ------
    ParameterError
        A value is out of range.
    """

    model: ModalModel
    omega: float
    force: float
    gap: float = RigidWalls.gap
    restitution: float = RigidWalls.restitution
    friction_limit: float = 0.0
    mass_ratio: float = DEFAULT_MASS_RATIO

    def __post_init__(self) -> None:
        check_fields(
            self,
            omega=labelled("frequency", positive),
            force=labelled("force amplitude", finite),
            model=kind_of(ModalModel),
            gap=positive,
            restitution=check_restitution,
            friction_limit=labelled("friction limit", non_negative),
            mass_ratio=positive,
        )
        require_one_phase(self.model, "periodic orbits")

    @property
    def scene(self) -> Scene:
        """The scene for simulations."""
        return make_scene(
            self.model, self.gap, self.restitution, self.friction_limit, self.mass_ratio
        )

    @property
    def structure(self) -> Structure:
        """Structure and absorber as exponentials, for the kernels of orbits."""
        return make_structure(self.model, self.mass_ratio)

    @property
    def point(self) -> Point:
        """Force, frequency and contact parameters, for the kernels of orbits."""
        return Point(self.omega, self.force, self.gap, self.restitution, self.friction_limit)

    @property
    def scale(self) -> Scale:
        """Units of unknowns and residuals.

        They are the gap, the gap per radian of the first mode, and the impulse that gives the
        absorber this velocity.
        """
        velocity = self.gap * float(self.model.omega[0])
        return Scale(self.gap, velocity, velocity * self.mass_ratio * self.model.beam_mass)

    @property
    def omega_ratio(self) -> float:
        """Frequency over the first resonance's."""
        return self.omega / float(self.model.omega[0])

    @property
    def period(self) -> float:
        """Period of the force in s."""
        return 2 * math.pi / self.omega

    @property
    def damping_ratio(self) -> float:
        """Damping ratio of the first mode."""
        return damping_of(self.model)

    @property
    def absorber_position(self) -> float:
        """The absorber's position as a fraction of the beam's length.

        Raises ParameterError for a modal model without a beam.
        """
        return position_of(self.model)

    def changed(self, **values: float) -> Case:
        """Return the case with other values of parameters, by name.

        Besides the fields, ``damping_ratio`` is that of the first mode (the ratios of all modes
        keep their proportions) and ``absorber_position`` is a fraction of the beam's length; the
        place of the response level does not change.
        """
        model = self.model
        if DAMPING_RATIO in values:
            model = with_damping(model, values.pop(DAMPING_RATIO))
        if ABSORBER_POSITION in values:
            model = with_position(model, values.pop(ABSORBER_POSITION))
        return replace(self, model=model, **values)

    def drive(self, duration: float, phase: float) -> Drive:
        """Return the force for ``duration`` s, starting with ``phase`` (rad)."""
        return Drive(
            self.force,
            FrequencySchedule(
                np.array([0.0, duration]), np.full(2, self.omega), float(self.model.omega[0])
            ),
            phase,
        )


def case_of(scene: Scene, force: float, omega: float) -> Case:
    """Return the case of a scene with one impact absorber, rigid walls and rigid or no friction.

    Raises ParameterError for any other scene.
    """
    scene = instance("scene", scene, Scene)
    absorber = scene.absorber
    allowed = (
        "one impact absorber with rigid walls at a finite distance, and rigid friction or none"
    )
    ok = isinstance(absorber, SlidingAbsorber) and isinstance(absorber.walls, RigidWalls)
    require(
        ok and not isinstance(absorber.friction, ElasticCoulombFriction),  # type: ignore[union-attr]
        "absorber",
        absorber,
        allowed,
    )
    assert isinstance(absorber, SlidingAbsorber)
    require_weightless(absorber, "periodic orbits")
    friction = absorber.friction
    ratio = friction.static_ratio if isinstance(friction, CoulombFriction) else 1.0
    require(ratio == 1, "static_ratio", ratio, "1 for periodic orbits")
    walls = absorber.walls
    assert walls is not None
    assert not isinstance(walls, CompliantWalls)
    limit = 0.0 if absorber.friction is None else absorber.friction.limit
    return Case(scene.model, omega, force, walls.gap, walls.restitution, limit, absorber.mass_ratio)


@lru_cache(maxsize=64)
def make_scene(
    model: ModalModel, gap: float, restitution: float, limit: float, mass_ratio: float
) -> Scene:
    """Return a scene, which is the same object for the same arguments.

    The exact method stores its tables by scene.
    """
    return Scene(model, impact_absorber(gap, restitution, limit, mass_ratio))


@lru_cache(maxsize=64)
def make_structure(model: ModalModel, mass_ratio: float) -> Structure:
    """Return the exponentials of a model's modes, and the absorber's share.

    A mode has one complex exponential, above critical damping two real ones, and near critical
    damping the three complex ones of `secular.raise_off_axis`, as in the exact method's regimes.
    """
    omega = np.array(model.omega)
    damping = np.array(model.damping_ratio)
    tip = np.array(model.tip_shape)
    square = omega**2 * (1 - damping) * (1 + damping)
    near = np.abs(square) < (SPLIT_TOL * omega) ** 2
    heights = raise_off_axis(omega, square)
    s: list[complex] = []
    weight: list[complex] = []
    mode: list[int] = []
    for i, (w, d) in enumerate(zip(omega, damping, strict=True)):
        root = np.sqrt(complex(1 - d * d))
        if near[i]:
            for height, share in heights:
                s = [*s, -d * w + 1j * height[i]]
                weight = [*weight, share[i] / (1j * height[i])]
                mode = [*mode, i]
        elif d < 1:
            s = [*s, w * (-d + 1j * root.real)]
            weight = [*weight, 1 / (1j * w * root.real)]
            mode = [*mode, i]
        else:
            fast = -w * (d + root.imag)
            slow = w * w / fast
            s = [*s, slow, fast]
            weight = [*weight, 1 / (slow - fast), -1 / (slow - fast)]
            mode = [*mode, i, i]
    values = np.array(s, complex)
    weights = np.array(weight, complex)
    modes = np.array(mode, np.int64)
    share = weights * tip[modes] ** 2
    powers = np.array([share / values, share, share * values, share * values**2])
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    static = float(np.sum((tip / omega) ** 2))
    rates = 2 * damping * omega
    push = np.array(model.one_phase_force_shape)
    return Structure(
        values,
        weights,
        powers,
        modes,
        omega,
        rates,
        push,
        tip,
        mass,
        1 / mass + float(np.sum(tip**2)),
        static,
    )
