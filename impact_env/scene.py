"""The scene of a run: a modal model and, if there is one, an absorber. Absent parts are None."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    instance,
    kind_of,
    or_none,
    require,
    row,
)
from impact_env.fields import check_fields, parameter
from impact_env.laws import (
    Link,
    SceneKind,
    describe_absorber,
    describe_modes,
    find_link,
    kind,
)
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import (
    Absorber,
    Beam,
    RigidWallLaw,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
)


@dataclass(frozen=True, eq=False)
class Scene:
    """A structure with at most one absorber, or with several.

    Parameters
    ----------
    model : ModalModel
        Modes of the structure.
    absorber : Absorber, optional
        None: the structure alone. Several absorbers are at the places of the model's
        ``absorber_shapes``. An absorber whose walls have no clearance becomes a `StuckAbsorber`,
        the same mechanics.

    Raises
    ------
    ParameterError
        An argument is of another class, or the model has not one place for each absorber.

    See Also
    --------
    beam_scene : A scene from a beam, or from the structure of a file.

    Examples
    --------
    >>> from impact_env import Beam, Scene, modal_model
    >>> Scene(modal_model(Beam(modes=2)))
    Scene(2 modes, no absorber)
    """

    model: ModalModel = field(metadata=parameter(kind_of(ModalModel)))
    absorber: Absorber | None = field(default=None, metadata=parameter(kind_of(Absorber | None)))

    def __post_init__(self) -> None:
        check_fields(self)
        shapes = self.model.absorber_shapes
        several = self.absorber if isinstance(self.absorber, SeveralAbsorbers) else None
        if (
            several is not None and self.model.response_shape is not None
        ):  # several absorbers have shapes of their own, and the level is the tip's
            object.__setattr__(
                self,
                "model",
                replace(self.model, tip_shape=self.model.level_shape, response_shape=None),
            )
        result = 0 if shapes is None else len(shapes)
        wanted = 0 if several is None else len(several.absorbers)
        allowed = f"{wanted} rows, one for each of the several absorbers"
        require(
            result == wanted or several is None,
            "absorber_shapes of the modal model",
            result,
            allowed,
        )
        sliding = self.absorber if isinstance(self.absorber, SlidingAbsorber) else None
        # a cavity without clearance holds the mass: the same mechanics as a stuck absorber
        if sliding is not None and isinstance(sliding.walls, RigidWalls) and sliding.walls.gap == 0:
            object.__setattr__(self, "absorber", StuckAbsorber(sliding.mass_ratio, sliding.gravity))
        elif (
            sliding is not None
            and isinstance(sliding.walls, RigidWalls)
            and np.isinf(sliding.walls.gap)
        ):
            without = (
                None
                if sliding.friction is None
                else SlidingAbsorber(sliding.mass_ratio, None, sliding.friction, sliding.gravity)
            )
            object.__setattr__(self, "absorber", without)

    def __repr__(self) -> str:
        return f"Scene({self})"

    def __str__(self) -> str:
        return f"{describe_modes(self.model.modes)}, {describe_absorber(self.absorber)}"

    @cached_property
    def kind(self) -> SceneKind:
        """Kind of scene, by the laws of its absorber."""
        return kind(self.absorber)

    @property
    def absorber_mass(self) -> float | None:
        """Mass of the absorber, or of all together, in kg, or None."""
        return None if self.absorber is None else self.absorber.mass_ratio * self.model.beam_mass

    @cached_property
    def link(self) -> Link | None:
        """Spring and damper of a linear absorber.

        None for a stuck absorber, without absorber, and where the scene is not linear.
        """
        return find_link(self.absorber, self.absorber_mass or 0.0)

    @property
    def places(self) -> int:
        """Number of absorbers in a state vector, which is 1 for a scene without absorber, too."""
        return len(self.absorber.absorbers) if isinstance(self.absorber, SeveralAbsorbers) else 1

    @property
    def absorber_masses(self) -> NDArray[np.float64]:
        """Mass of each absorber in kg, (n,); 0 without absorber."""
        if self.absorber is None:
            return np.zeros(1)
        every = (
            self.absorber.absorbers
            if isinstance(self.absorber, SeveralAbsorbers)
            else (self.absorber,)
        )
        return np.array([absorber.mass_ratio * self.model.beam_mass for absorber in every])

    @property
    def absorber_gravities(self) -> NDArray[np.float64]:
        """Gravity in m/s^2 along the motion of each absorber, (n,); 0 without absorber."""
        every = (
            self.absorber.absorbers
            if isinstance(self.absorber, SeveralAbsorbers)
            else (self.absorber,)
        )
        return np.array([getattr(absorber, "gravity", 0.0) for absorber in every])

    @property
    def absorber_shapes(self) -> NDArray[np.float64]:
        """Modal shapes at the absorbers' places, (n, N_m)."""
        shapes = self.model.absorber_shapes if isinstance(self.absorber, SeveralAbsorbers) else None
        return self.model.tip_shape[None, :] if shapes is None else shapes

    def cavity(self, which: int) -> RigidWallLaw | None:
        """Return the rigid walls of absorber ``which`` (counted from 0), or None."""
        one = (
            self.absorber.absorbers[which]
            if isinstance(self.absorber, SeveralAbsorbers)
            else self.absorber
        )
        return (
            one.walls
            if isinstance(one, SlidingAbsorber) and isinstance(one.walls, RigidWallLaw)
            else None
        )


def beam_scene(beam: Structure | None = None, absorber: Absorber | None = None) -> Scene:
    """Return the scene of a structure with or without an absorber.

    Parameters
    ----------
    beam : Beam or ModalModel, optional
        Beam, or the modal model of any structure (see `load_structure`). Default: the paper's beam.
    absorber : optional
        Result of `impact_absorber`, `friction_damper`, `tuned_absorber` or `impact_absorbers`, or a
        `StuckAbsorber` or `NonlinearSink`. None: the structure alone.

    Returns
    -------
    Scene
        The scene, an argument of `simulate`.

    Raises
    ------
    ParameterError
        An argument is of another class, or the beam has no modal model.

    Warns
    -----
    UserWarning
        A gap is more than a tenth of the beam's length, perhaps because it is in mm.

    Examples
    --------
    >>> from impact_env import Beam, beam_scene, impact_absorber
    >>> scene = beam_scene(Beam(modes=3), impact_absorber())
    >>> round(scene.absorber_mass, 6)
    0.011275
    """
    allowed = "a Beam or a ModalModel; an absorber is given as absorber=..."
    require(not isinstance(beam, Absorber), "beam", beam, allowed)
    beam = Beam() if beam is None else instance("beam", beam, Beam | ModalModel)
    if isinstance(beam, Beam):
        _warn_of_wide_gaps(beam, absorber)
    if isinstance(beam, ModalModel) or not isinstance(absorber, SeveralAbsorbers):
        return Scene(modal_model(beam), absorber)
    if beam.response_position is not None:
        beam = replace(beam, absorber_position=beam.response_position)
    else:
        allowed = "1, the free end, for several absorbers: they have positions of their own"
        require(beam.absorber_position == 1, "absorber_position", beam.absorber_position, allowed)
    return Scene(modal_model(beam, absorber.positions), absorber)


WIDE_GAP_SHARE = 0.1  # of a beam's length: wider gaps are taken for ones that were meant in mm


def _warn_of_wide_gaps(beam: Beam, absorber: Absorber | None) -> None:
    """Warn if a gap is so wide for a beam that another unit may be meant."""
    every = absorber.absorbers if isinstance(absorber, SeveralAbsorbers) else (absorber,)
    for one in every:
        walls = getattr(one, "walls", None)
        if walls is not None and WIDE_GAP_SHARE * beam.length < walls.gap < np.inf:
            line = f"gap = {walls.gap:g} m is wide for a beam of {beam.length:g} m: gaps are in m"
            warnings.warn(line, UserWarning, stacklevel=3)


def _check_state(name: str, value: Any) -> float | NDArray[np.float64]:
    """Return displacements or velocities as an array, those of one absorber as a float."""
    allowed = "finite numbers: one for each mode, or of an absorber one, or one for each"
    values = row(name, value, allowed)
    single = np.ndim(value) == 0 and not name.startswith("modal")
    return float(values[0]) if single else values


MODAL_STATE = parameter(or_none(_check_state))


@dataclass(frozen=True, eq=False)
class InitialState:
    """State at time 0.

    Parameters
    ----------
    modal_displacement : array_like, (N_m,), optional
        Modal displacements in sqrt(kg) m. None: zero.
    modal_velocity : array_like, (N_m,), optional
        Modal velocities in sqrt(kg) m/s. None: zero.
    absorber_displacement : float or array_like, (n,), optional
        Displacement of the absorber in m; of several absorbers one number each, or one for all.
        None: the middle of the cavity, the displacement of the structure at the absorber's place.
    absorber_velocity : float or array_like, (n,), optional
        Velocity of the absorber in m/s.

    Raises
    ------
    ParameterError
        A value is not finite. `simulate` also refuses a wrong length, and an absorber outside the
        cavity.

    Examples
    --------
    >>> from impact_env import InitialState
    >>> InitialState(absorber_velocity=0.1).absorber_velocity
    0.1
    """

    modal_displacement: NDArray[np.float64] | None = field(default=None, metadata=MODAL_STATE)
    modal_velocity: NDArray[np.float64] | None = field(default=None, metadata=MODAL_STATE)
    absorber_displacement: float | Sequence[float] | NDArray[np.float64] | None = field(
        default=None, metadata=parameter(or_none(_check_state), unit="m")
    )
    absorber_velocity: float | Sequence[float] | NDArray[np.float64] = field(
        default=0.0, metadata=parameter(_check_state, unit="m/s")
    )

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def from_vector(cls, scene: Scene, vector: NDArray[np.float64]) -> "InitialState":
        """Return the state of a vector (2 N_m + 2 n,), such as the end state of a run.

        It is the inverse of `vector`. An absorber beyond a rigid wall by rounding is moved onto the
        wall. The force of an elastic slider is not part of a state: it starts at 0. Raises
        ParameterError for a vector of another length.
        """
        n = scene.model.modes
        places = scene.places
        half = n + places
        allowed = (
            f"{2 * half} finite numbers for {n} modes and {places} absorber{'s' * (places > 1)}"
        )
        state = row("state vector", vector, allowed)
        require(len(state) == 2 * half, "state vector", vector, allowed)
        displacements = np.empty(places)
        for k, shape in enumerate(scene.absorber_shapes):
            cavity = scene.cavity(k)
            gap = np.inf if cavity is None else cavity.gap
            beam = float(shape @ state[:n])
            displacements[k] = beam + float(np.clip(state[n + k] - beam, -gap, gap))
        velocities = state[half + n :]
        if places == 1:
            return cls(state[:n], state[half : half + n], displacements[0], velocities[0])
        return cls(state[:n], state[half : half + n], displacements, velocities)

    def vector(self, scene: Scene) -> NDArray[np.float64]:
        """Return the state as a vector (2 N_m + 2 n,) for a scene.

        It has the modal displacements, the displacements of the n absorbers, the modal velocities,
        and the velocities of the absorbers; n is 1 without an absorber, too. Raises ParameterError
        for a wrong length, or an absorber outside the cavity.
        """
        n = scene.model.modes
        places = scene.places
        half = n + places
        state = np.zeros(2 * half)
        for name, at in (("modal_displacement", 0), ("modal_velocity", half)):
            values = getattr(self, name)
            if values is not None:
                require(len(values) == n, name, values, f"{n} finite numbers, one per mode")
                state[at : at + n] = values
        beam = np.array([shape @ state[:n] for shape in scene.absorber_shapes])
        for name, at in (("absorber_displacement", n), ("absorber_velocity", half + n)):
            values = beam if getattr(self, name) is None else getattr(self, name)
            require(
                np.ndim(values) == 0 or len(values) == places,
                name,
                values,
                "a finite number, or one for each absorber",
            )
            state[at : at + places] = values
        for a in range(places):
            walls = scene.cavity(a)
            if walls is not None:
                allowed = (
                    f"a start inside the cavity, within {walls.gap} m of the tip's displacement "
                    f"{beam[a]} m"
                )
                require(
                    abs(state[n + a] - beam[a]) <= walls.gap * (1 + 1e-12),
                    "absorber_displacement",
                    self.absorber_displacement,
                    allowed,
                )
        if isinstance(scene.absorber, StuckAbsorber):
            state[2 * n + 1] = scene.model.tip_shape @ state[n + 1 : 2 * n + 1]
        return state
