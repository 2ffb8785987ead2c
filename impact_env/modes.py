"""Modal model of a structure, and the finite elements of a beam.

The model consists of frequencies, damping ratios, and mode shapes at force and absorber.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import (
    SMALL,
    count,
    finite,
    instance,
    kind_of,
    listed,
    number,
    or_none,
    positive,
    require,
    row,
    row_of,
)
from impact_env.fields import check_fields, parameter
from impact_env.parameters import MOST_DAMPING, Beam, suspension_frequencies

# Mass, damping and stiffness of modes that carry masses, or that a spring and a damper link to one
# more coordinate.
#
# In the free beam's modal coordinates, where its own matrices are 1, 2 D omega and omega^2 on the
# diagonal.


Real = NDArray[np.float64]


def with_masses(shapes: Real, masses: Real) -> Real:
    """Return the mass matrix (N_m, N_m) of modes with additional ``masses`` (n,) in kg.

    ``shapes`` (n, N_m) are the mode shapes at the places of the masses.
    """
    return np.asarray(np.eye(shapes.shape[1]) + (shapes.T * masses) @ shapes)


def with_link(own: Real, factor: float, line: Real) -> Real:
    """Return the stiffness or damping matrix (N_m + 1, N_m + 1) of modes and a linked coordinate.

    ``own`` (N_m,) are the diagonal entries of the modes. The link has the stiffness or damping
    ``factor``; ``line`` (N_m + 1,) times the coordinates is its stretch. The additional coordinate
    has no other stiffness or damping.
    """
    return np.asarray(np.diag(np.append(own, 0.0)) + factor * np.outer(line, line))


# Hermite Euler-Bernoulli beam: parameters to mass and stiffness matrices (paper, section 2.1).


_STIFFNESS = np.array(
    [
        [12.0, 6.0, -12.0, 6.0],
        [6.0, 4.0, -6.0, 2.0],
        [-12.0, -6.0, 12.0, -6.0],
        [6.0, 2.0, -6.0, 4.0],
    ]
)
_MASS = (
    np.array(
        [
            [156.0, 22.0, 54.0, -13.0],
            [22.0, 4.0, 13.0, -3.0],
            [54.0, 13.0, 156.0, -22.0],
            [-13.0, -3.0, -22.0, 4.0],
        ]
    )
    / 420
)


def _values_by_element(beam: Beam, name: str) -> Real:
    """Return the value ``name`` of each element (N_e,): that of its section, or else the beam's."""
    values = np.full(beam.elements, getattr(beam, name))
    first = 0
    for section in beam.sections:
        values[first : first + section.elements] = getattr(section, name)
        first += section.elements
    return values


def find_free_freedoms(beam: Beam) -> NDArray[np.int64]:
    """Return the indices of those of the 2 N_e + 2 freedoms of the nodes that the ends leave free.

    The freedoms are deflection and rotation of each node, from the left.
    """
    size = 2 * beam.elements + 2
    left, right = beam.ends.split("-")
    held = {"clamped": {0, 1}, "pinned": {0}, "free": set()}[left] | {
        "clamped": {size - 2, size - 1},
        "pinned": {size - 2},
        "free": set(),
    }[right]
    return np.array([k for k in range(size) if k not in held])


def assemble_matrices(beam: Beam) -> tuple[Real, Real]:
    """Return mass (kg) and stiffness (N/m) matrix of the supported beam.

    Rows and columns are the freedoms of `find_free_freedoms`, 2 N_e for a cantilever: deflection
    (m) and rotation (rad) times the element length, node by node from the left, so that all entries
    of a matrix have the same unit. This scaling keeps the eigenproblem well conditioned.
    """
    mass, stiffness = _assemble_unsupported(beam)
    free = np.ix_(find_free_freedoms(beam), find_free_freedoms(beam))
    return mass[free], stiffness[free]


def _assemble_unsupported(beam: Beam) -> tuple[Real, Real]:
    """Return mass and stiffness matrices of the beam without supports."""
    element = beam.length / beam.elements
    size = 2 * beam.elements + 2
    mass = np.zeros((size, size))
    stiffness = np.zeros((size, size))
    for e, (line, bending) in enumerate(
        zip(
            _values_by_element(beam, "mass_per_length"),
            _values_by_element(beam, "bending_stiffness"),
            strict=True,
        )
    ):
        span = slice(2 * e, 2 * e + 4)
        mass[span, span] += _MASS * line * element
        stiffness[span, span] += _STIFFNESS * bending / element**3
    mass[-2, -2] += beam.tip_mass
    return mass, stiffness


def rigid_shapes(beam: Beam) -> Real:
    """Return the rigid-body motions as columns over the freedoms of `find_free_freedoms`.

    A free beam has a translation and a rotation, a pinned one the rotation.
    """
    element = 1 / beam.elements
    nodes = np.arange(beam.elements + 1)
    shift = np.zeros(2 * beam.elements + 2)
    turn = np.zeros(2 * beam.elements + 2)
    shift[0::2] = 1
    turn[0::2] = nodes * element
    turn[1::2] = element
    return np.column_stack([shift, turn][2 - beam.rigid_motions :])[find_free_freedoms(beam)]


def strain_energy(beam: Beam, shapes: Real) -> Real:
    """Return the strain energy v^T K v/2 in J (S,) of displacements ``shapes`` (., S).

    Rows of the shapes are the freedoms of `assemble_matrices`. The stiffness of an element is
    proportional to 12 a a^T + b b^T with a = (1, 1/2, -1, 1/2) and b = (0, 1, 0, -1). A sum of
    squares of such differences keeps almost all digits, while in K v the large entries of a fine
    mesh almost cancel.
    """
    nodes = np.zeros((2 * beam.elements + 2, shapes.shape[1]))
    nodes[find_free_freedoms(beam)] = shapes
    deflection = nodes[0::2]
    rotation = nodes[1::2]
    shear = deflection[:-1] - deflection[1:] + (rotation[:-1] + rotation[1:]) / 2
    bend = rotation[:-1] - rotation[1:]
    element = beam.length / beam.elements
    share = _values_by_element(beam, "bending_stiffness") / beam.bending_stiffness
    return np.asarray(
        0.5
        * beam.bending_stiffness
        / element**3
        * np.sum(share[:, None] * (12 * shear**2 + bend**2), axis=0)
    )


def deflection_row(beam: Beam, position: float) -> Real:
    """Return the row whose product with the freedoms of `assemble_matrices` is a deflection.

    ``position`` of the deflection is a fraction of the length.
    """
    scaled = position * beam.elements
    e = min(int(np.floor(scaled + 1e-12)), beam.elements - 1)
    s = scaled - e
    shapes = [1 - 3 * s**2 + 2 * s**3, s - 2 * s**2 + s**3, 3 * s**2 - 2 * s**3, s**3 - s**2]
    row = np.zeros(2 * beam.elements + 2)
    row[2 * e : 2 * e + 4] = shapes
    return row[find_free_freedoms(beam)]


# mass times sum tip_shape^2: how many times less the tip moves under a mass than without it, and so
# how many digits its motion loses
MOST_HEAVINESS = 1e7


MODE_ROW = row_of("a row of finite numbers")
SHAPE_UNIT = "1/sqrt(kg)"


@dataclass(frozen=True, eq=False)
class ModalModel:
    """Mass-normalised modes of the structure without absorber (paper, Eq. eqmmod).

    Arrays are read-only.

    Parameters
    ----------
    omega : array_like, (N_m,)
        Natural circular frequencies in rad/s.
    damping_ratio : array_like, (N_m,)
        Modal damping ratios.
    force_shape, tip_shape : array_like, (N_m,)
        Mode shapes at the force's and at the absorber's place in 1/sqrt(kg).
    beam_mass : float
        Mass of the structure in kg, to which mass ratios refer.
    absorber_shapes : array_like, (n, N_m), optional
        Mode shapes at the places of several absorbers, or at possible places of one absorber.
    response_shape : array_like, (N_m,), optional
        Mode shape at the place of the response level. None: the tip.
    stress_shape : array_like, (N_m,), optional
        Stress, strain or moment per modal displacement, in any unit. None: not known.
    base_participation : array_like, (N_m,), optional
        shapes^T M r in sqrt(kg), where r is the rigid displacement of the structure for a unit
        motion of the base. None: not known.
    base_at_absorber : float, optional
        The displacement r at the absorber's place. None: not known.
    beam : Beam, optional
        The beam whose modes these are, for `mode_shapes` at other positions.
    force_quadrature : array_like, (N_m,), optional
        Mode shape in 1/sqrt(kg) of the part of the force that is a quarter period ahead. It is
        needed for forces at several places with different phases (`with_forces`). None: one phase.
    force_places : array_like, (P, N_m), optional
        Mode shapes in 1/sqrt(kg) at the places for loads with a ``force_place``.
    force_place_names : sequence of str, (P,)
        Names of these places.

    Raises
    ------
    ParameterError
        Lengths differ, or a value is out of range.

    Examples
    --------
    >>> from impact_env import ModalModel
    >>> model = ModalModel([60.0, 380.0], [0.01, 0.01], [1.4, 1.4], [2.0, -2.0], beam_mass=1.0)
    >>> model.modes
    2
    """

    omega: NDArray[np.float64] = field(metadata=parameter(MODE_ROW, unit="rad/s"))
    damping_ratio: NDArray[np.float64] = field(metadata=parameter(MODE_ROW))
    force_shape: NDArray[np.float64] = field(metadata=parameter(MODE_ROW, unit=SHAPE_UNIT))
    tip_shape: NDArray[np.float64] = field(metadata=parameter(MODE_ROW, unit=SHAPE_UNIT))
    beam_mass: float = field(metadata=parameter(positive, unit="kg"))
    absorber_shapes: NDArray[np.float64] | None = field(
        default=None, metadata=parameter(unit=SHAPE_UNIT)
    )
    response_shape: NDArray[np.float64] | None = field(
        default=None, metadata=parameter(or_none(MODE_ROW), unit=SHAPE_UNIT)
    )
    stress_shape: NDArray[np.float64] | None = field(
        default=None, metadata=parameter(or_none(MODE_ROW))
    )
    base_participation: NDArray[np.float64] | None = field(
        default=None, metadata=parameter(or_none(MODE_ROW), unit="sqrt(kg)")
    )
    base_at_absorber: float = field(default=1.0, metadata=parameter(finite))
    beam: Beam | None = field(default=None, metadata=parameter(kind_of(Beam | None)))
    force_quadrature: NDArray[np.float64] | None = field(
        default=None, metadata=parameter(or_none(MODE_ROW), unit=SHAPE_UNIT)
    )
    force_places: NDArray[np.float64] | None = field(
        default=None, metadata=parameter(unit=SHAPE_UNIT)
    )
    force_place_names: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        optional = tuple(
            name
            for name in ("response_shape", "stress_shape", "base_participation", "force_quadrature")
            if getattr(self, name) is not None
        )
        rows = ("omega", "damping_ratio", "force_shape", "tip_shape", *optional)
        lengths = {len(getattr(self, name)) for name in rows}
        require(
            len(lengths) == 1 and min(lengths) > 0,
            "modal model",
            lengths,
            f"arrays of one length, 1 or more: {', '.join(rows)}",
        )
        if self.absorber_shapes is not None:
            allowed = f"a row of {len(self.omega)} finite numbers for each absorber"
            check_fields(self, absorber_shapes=row_of(allowed, axes=2))
            shapes = self.absorber_shapes
            require(shapes.shape[1] == len(self.omega), "absorber_shapes", shapes, allowed)
        self._check_force_places()
        require(
            bool(np.all(self.omega >= SMALL)),
            "omega",
            self.omega,
            f"frequencies above 0, from {SMALL:g} rad/s",
        )
        ok = bool(np.all((self.damping_ratio >= 0) & (self.damping_ratio <= MOST_DAMPING)))
        require(ok, "damping_ratio", self.damping_ratio, f"0 or above and at most {MOST_DAMPING}")

    def _check_force_places(self) -> None:
        """Check the places of forces and their names."""
        allowed = f"a row of {len(self.omega)} finite numbers for each name in force_place_names"
        both = (self.force_places is None) == (self.force_place_names is None)
        require(both, "force_places", self.force_places, allowed)
        if self.force_place_names is None:
            return
        names = tuple(listed("force_place_names", self.force_place_names))
        object.__setattr__(self, "force_place_names", names)
        once = all(isinstance(name, str) for name in names) and len(set(names)) == len(names)
        require(once, "force_place_names", names, "different names, one for each of force_places")
        check_fields(self, force_places=row_of(allowed, axes=2))
        assert self.force_places is not None
        shape = self.force_places.shape
        require(shape == (len(names), len(self.omega)), "force_places", shape, allowed)

    @property
    def modes(self) -> int:
        """Number of modes kept."""
        return len(self.omega)

    @property
    def one_phase_force_shape(self) -> NDArray[np.float64]:
        """Mode shape (N_m,) at the force, for formulas that hold for a force of one phase.

        Raises ParameterError if forces at several places differ in phase.
        """
        differ = self.force_quadrature is not None
        require(not differ, "force_quadrature", "given", "None here: forces of one phase")
        return self.force_shape

    @property
    def force_pattern(self) -> NDArray[np.complex128]:
        """Complex modal shape (N_m,) of the force.

        A force Re(F exp(i phi)) acts on the modes as Re(shape F exp(i phi)).
        """
        quadrature = 0.0 if self.force_quadrature is None else self.force_quadrature
        return np.asarray(self.force_shape + 1j * quadrature, dtype=np.complex128)

    def with_forces(
        self, shapes: ArrayLike, amplitudes: ArrayLike, phases: ArrayLike = 0.0
    ) -> ModalModel:
        """Return the model under forces at several places, which share one frequency.

        Parameters
        ----------
        shapes : array_like, (P, N_m)
            Mode shapes at the places in 1/sqrt(kg).
        amplitudes : array_like, (P,)
            Amplitude of each force as a factor of the drive's amplitude.
        phases : array_like, (P,) or one number
            Phase of each force in rad, in addition to the drive's.

        Raises
        ------
        ParameterError
            The rows are not of one length, or the forces cancel on all modes kept.
        """
        shapes = row("shapes", shapes, f"rows of {self.modes} finite numbers", axes=2)
        allowed = f"finite numbers, one for each of the {len(shapes)} places"
        sizes = row("amplitudes", amplitudes, allowed)
        turns = row("phases", phases, f"one finite number, or {len(shapes)}")
        require(
            len(turns) in {1, len(shapes)},
            "phases",
            turns.tolist(),
            f"one number, or {len(shapes)}",
        )
        require(shapes.shape[1] == self.modes, "shapes", shapes.shape, f"(P, {self.modes})")
        require(len(sizes) == len(shapes), "amplitudes", sizes.tolist(), allowed)
        pattern = (sizes * np.exp(1j * turns)) @ shapes
        rounding = 1e-12 * np.abs(sizes) @ np.abs(shapes)
        cancels = bool(np.all(np.abs(pattern) <= rounding))
        require(not cancels, "amplitudes", sizes.tolist(), "forces that do not cancel on all modes")
        standing = bool(np.all(np.abs(pattern.imag) <= rounding))
        return replace(
            self,
            force_shape=pattern.real,
            force_quadrature=None if standing else pattern.imag,
        )

    def force_pattern_at(self, place: str | None) -> NDArray[np.complex128]:
        """Return the complex modal shape (N_m,) of a force at a place of `with_force_places`.

        For None it is the shape of the structure's own force.
        """
        if place is None:
            return self.force_pattern
        return self.find_force_place(place).astype(np.complex128)

    def with_force_places(self, places: Mapping[str, ArrayLike]) -> ModalModel:
        """Return the model with places for loads of their own, such as a record for each.

        Parameters
        ----------
        places : mapping of str to array_like, (N_m,)
            Mode shape at each place in 1/sqrt(kg), by the name that loads give as ``force_place``.

        Raises
        ------
        ParameterError
            There is no place, or a shape has not one finite number for each mode.
        """
        places = instance("places", places, Mapping)
        require(len(places) > 0, "places", places, "one or more places")
        allowed = f"{self.modes} finite numbers, one for each mode"
        shapes = [row(f"places[{name!r}]", shape, allowed) for name, shape in places.items()]
        for name, shape in zip(places, shapes, strict=True):
            require(len(shape) == self.modes, f"places[{name!r}]", shape, allowed)
        return replace(self, force_places=np.array(shapes), force_place_names=tuple(places))

    def find_force_place(self, name: str) -> NDArray[np.float64]:
        """Return the mode shape (N_m,) at a place of `with_force_places`.

        Raises ParameterError if the model has no such place.
        """
        names = self.force_place_names or ()
        allowed = (
            f"one of the places of the structure's forces: {', '.join(names) or 'there are none'}"
        )
        require(name in names, "place", name, allowed)
        assert self.force_places is not None
        return np.asarray(self.force_places[names.index(name)])

    @property
    def level_shape(self) -> NDArray[np.float64]:
        """Mode shape (N_m,) at the place of the response level."""
        return self.tip_shape if self.response_shape is None else self.response_shape

    @property
    def places(self) -> NDArray[np.float64]:
        """Mode shapes (n, N_m) at the places for absorbers, which are numbered from 1.

        They are `absorber_shapes`, or else only the tip's shape.
        """
        return self.tip_shape[None, :] if self.absorber_shapes is None else self.absorber_shapes

    def _place(self, place: float) -> int:
        n = len(self.places)
        result = number(place)
        allowed = f"the number of one of the structure's places for absorbers, 1 to {n}"
        require(result in range(1, n + 1), "position", place, allowed)
        return int(result) - 1

    def with_absorber_at(self, place: float) -> ModalModel:
        """Return the model for one absorber at a place (counted from 1) of `places`.

        The place of the level is unchanged.
        """
        own = self.places[self._place(place)]
        level = self.level_shape
        return replace(
            self,
            tip_shape=own,
            absorber_shapes=None,
            response_shape=None if np.array_equal(own, level) else level,
        )

    def with_absorbers_at(self, places: Iterable[float]) -> ModalModel:
        """Return the model for several absorbers at places (counted from 1) of `places`.

        The place of the level is unchanged.
        """
        return replace(
            self,
            absorber_shapes=self.places[
                [self._place(place) for place in listed("positions", places)]
            ],
        )

    def detuned(self, share: float) -> ModalModel:
        """Return the model with all frequencies multiplied by 1 + ``share``."""
        return replace(self, omega=self.omega * (1 + finite("share", share)))

    def pseudo_period(self, resonance: int = 1) -> float:
        """Return 2 pi / omega of a resonance (counted from 1) in s (paper, section 3.1)."""
        return 2 * np.pi / self.resonance_omega(resonance)

    def resonance_omega(self, resonance: int) -> float:
        """Return a resonance's circular frequency in rad/s.

        Raises ParameterError if the model lacks this mode.
        """
        return float(self.omega[self.check_resonance(resonance) - 1])

    def check_resonance(self, resonance: int) -> int:
        """Return a resonance (counted from 1) as an int.

        Raises ParameterError if the model lacks this mode.
        """
        allowed = f"a mode of the model, 1 to {self.modes}"
        return count("resonance", resonance, 1, self.modes, allowed)


def require_one_phase(model: ModalModel, what: str) -> None:
    """Raise ParameterError if forces at several places differ in phase.

    ``what`` names the computation that needs forces of one phase.
    """
    allowed = f"None for {what}: forces of one phase"
    require(model.force_quadrature is None, "force_quadrature", "given", allowed)


Structure = Beam | ModalModel  # what a structure is given as


def modal_model(beam: Structure, positions: Iterable[float] | None = None) -> ModalModel:
    """Return the lowest modes of a beam.

    The inverse problem M v = (1/omega^2) K v is solved because the low modes then belong to the
    largest eigenvalues and keep more digits than from K v = omega^2 M v. The frequencies follow
    from the shapes. The first modes of a beam on a soft suspension are the rigid-body motions.

    Parameters
    ----------
    beam : Beam or ModalModel
        The beam, of which ``beam.modes`` modes are kept. A modal model is returned as it is.
    positions : iterable of float, (n,), optional
        Places of several absorbers as shares of the beam's length.

    Returns
    -------
    ModalModel
        The modes, with their shapes at force, absorber and response.

    Raises
    ------
    ParameterError
        A position is not on the beam, or is given for a modal model.

    Examples
    --------
    >>> from impact_env import Beam, modal_model
    >>> round(float(modal_model(Beam()).omega[0]), 1)
    252.3
    """
    if isinstance(beam, ModalModel):
        require(
            positions is None,
            "positions",
            positions,
            (
                "for beams only: a modal model has shapes at the places of its absorbers, and no "
                "others"
            ),
        )
        return beam
    beam = instance("beam", beam, Beam | ModalModel)
    if positions is not None:
        positions = listed("positions", positions)
        require(len(positions) > 0, "positions", positions, "one or more shares of the length")
    vectors, squares = solve_modes(beam)
    omega = np.sqrt(squares)[: beam.modes]
    for mode, ratio in beam.modal_frequency_ratio.items():
        omega[mode - 1] = ratio * omega[0]

    def shape(position: float) -> NDArray[np.float64]:
        return (deflection_row(beam, position) @ vectors)[: beam.modes]

    elsewhere = (
        beam.response_position is not None and beam.response_position != beam.absorber_position
    )
    # M r in kg over the free freedoms, where r is the unit displacement of the whole beam with its
    # supports, whose masses are part of M
    shift = np.zeros(2 * beam.elements + 2)
    shift[0::2] = 1
    base_load = (_assemble_unsupported(beam)[0] @ shift)[find_free_freedoms(beam)]
    return ModalModel(
        omega=omega,
        damping_ratio=np.broadcast_to(np.asarray(beam.damping_ratio, dtype=float), omega.shape),
        force_shape=shape(beam.force_position),
        tip_shape=shape(beam.absorber_position),
        beam_mass=beam.mass,
        absorber_shapes=None
        if positions is None
        else np.array([shape(beam.place("position", x)) for x in positions]),
        response_shape=shape(beam.response_position)
        if elsewhere and beam.response_position is not None
        else None,
        base_participation=(base_load @ vectors)[: beam.modes],
        beam=beam,
    )


def mode_shapes(beam: Beam, positions: ArrayLike) -> NDArray[np.float64]:
    """Return the mass-normalised shapes of a beam's modes at positions along it.

    They are what `modal_model` has at the force and the absorber, also at ends that are held.

    Parameters
    ----------
    beam : Beam
        The beam, of which ``beam.modes`` modes are kept.
    positions : array_like, (P,)
        Shares of the length, 0 to 1.

    Returns
    -------
    array, (P, N_m)
        Shapes in 1/sqrt(kg).

    Raises
    ------
    ParameterError
        A position is not on the beam.

    Examples
    --------
    >>> from impact_env import Beam, mode_shapes
    >>> mode_shapes(Beam(modes=2), [0.0, 0.5, 1.0]).shape
    (3, 2)
    """
    beam = instance("beam", beam, Beam)
    allowed = "one or more shares of the length, 0 to 1"
    places = row("positions", positions, allowed)
    require(
        places.size > 0 and bool(np.all((places >= 0) & (places <= 1))),
        "positions",
        positions,
        allowed,
    )
    vectors, _ = solve_modes(beam)
    return np.array([deflection_row(beam, x) @ vectors for x in places])[:, : beam.modes]


def solve_modes(beam: Beam) -> tuple[Real, Real]:
    """Return all shapes as columns, and the squares of their frequencies in ascending order.

    Each shape has the sign with which the tip moves up.
    """
    mass, stiffness = assemble_matrices(beam)
    vectors, squares = (
        _solve_elastic(beam, mass, stiffness)
        if beam.rigid_motions == 0
        else _solve_suspended(beam, mass, stiffness)
    )
    end = 1.0 if beam.ends.endswith("free") else beam.absorber_position
    return vectors * np.where(deflection_row(beam, end) @ vectors < 0, -1.0, 1.0), squares


def _solve_elastic(beam: Beam, mass: Real, stiffness: Real) -> tuple[Real, Real]:
    """Return all mass-normalised shapes as columns, and their squared frequencies, ascending."""
    vectors = scipy.linalg.eigh(mass, stiffness)[1][:, ::-1]
    # all modes, of which some are kept at the end: products of other sizes round differently, and a
    # truncation would not be the start of the whole
    vectors = vectors / np.sqrt(np.einsum("ij,ij->j", vectors, mass @ vectors))
    # Rayleigh's quotient squares the error of the shapes, and its strain energy has nothing to
    # cancel: all digits, for any number of elements
    return vectors, 2 * strain_energy(beam, vectors)


def _solve_suspended(beam: Beam, mass: Real, stiffness: Real) -> tuple[Real, Real]:
    """Return shapes and squared frequencies as `_solve_elastic` does, for a suspended beam.

    The rigid-body motions have the frequencies of the beam's suspension. Springs that resist only
    these motions make the stiffness regular; they are much softer than the first bending mode, and
    their effect is subtracted at the end.
    """
    assert beam.suspension_frequency is not None
    rigid = rigid_shapes(beam)
    rigid = np.linalg.solve(np.linalg.cholesky(rigid.T @ mass @ rigid), rigid.T).T
    held = mass @ rigid
    softest = min(
        [beam.bending_stiffness, *(section.bending_stiffness for section in beam.sections)]
    )
    soft = softest / (beam.mass * beam.length**3)
    vectors, _ = _solve_elastic(beam, mass, stiffness + soft * held @ held.T)
    bending = vectors[
        :, np.sort(np.argsort(np.linalg.norm(held.T @ vectors, axis=0))[: -rigid.shape[1]])
    ]
    bending = bending - rigid @ (held.T @ bending)
    squares = 2 * strain_energy(beam, bending)
    own = 2 * np.pi * np.array(suspension_frequencies(beam.suspension_frequency, rigid.shape[1]))
    allowed = (
        f"below half of the first bending frequency, {np.sqrt(squares[0]) / (2 * np.pi):.6g} Hz"
    )
    require(
        bool(4 * own[-1] ** 2 < squares[0]),
        "suspension_frequency",
        beam.suspension_frequency,
        allowed,
    )
    return np.column_stack([rigid, bending]), np.concatenate([own**2, squares])
