"""Bladed disks and other cyclic structures.

They are rings of equal sectors, each coupled to its two neighbours, with engine-order forces and
mistuning.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import (
    count,
    count_from,
    each_of,
    kind_of,
    listed,
    non_negative,
    one_of,
    or_none,
    positive,
    require,
)
from impact_env.fields import check_fields, parameter
from impact_env.modes import ModalModel
from impact_env.parameters import SeveralAbsorbers, SlidingAbsorber
from impact_env.scene import Scene
from impact_env.structures.matrices import check_matrix

Array = NDArray[np.float64]
MOST_SECTORS = 1000
MOST_FREEDOMS = 4000  # of a ring, whose eigenproblem is solved densely
MOST_MISTUNING = 0.5  # standard deviation: more than half of a frequency is another structure
DIRECTIONS = ("forward", "backward", "standing")


@dataclass(frozen=True)
class Mistuning:
    """Random differences between sectors: independent, normal, with mean zero.

    Parameters
    ----------
    frequency : float
        Standard deviation of a sector's own frequency, as a share of it.
    gap : float
        Standard deviation of an absorber's clearance, as a share of it.
    seed : int
        Seed of the draws; the same seed gives the same disk.
    """

    frequency: float = field(default=0.0, metadata=parameter(non_negative))
    gap: float = field(default=0.0, metadata=parameter(non_negative))
    seed: int = field(default=0, metadata=parameter(count_from(0)))

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("frequency", "gap"):
            allowed = f"at most {MOST_MISTUNING:g}, as a share"
            require(getattr(self, name) <= MOST_MISTUNING, name, getattr(self, name), allowed)

    def factors(self, name: str, sectors: int) -> Array:
        """Return the factors (N,) of the sectors' frequencies or gaps, whose mean is 1.

        ``name`` is "frequency" or "gap"; both are drawn separately.
        """
        deviation = {"frequency": self.frequency, "gap": self.gap}[name]
        generator = np.random.default_rng([self.seed, ("frequency", "gap").index(name)])
        return np.asarray(1.0 + deviation * generator.standard_normal(sectors))


@dataclass(frozen=True, eq=False)
class CyclicStructure:
    """A ring of N equal sectors.

    Parameters
    ----------
    sectors : int
        Number of sectors N, 1 or more. A single sector has no neighbours; of two sectors each is
        the other's neighbour on both sides.
    mass, stiffness : array_like, (d, d)
        Mass (kg) and stiffness (N/m) of a sector with d degrees of freedom. The stiffness includes
        the diagonal parts of both couplings.
    coupling : array_like, (d, d)
        Stiffness (N/m) between a sector's degrees of freedom (rows) and those of the next sector
        (columns): negative for a spring.
    damping_ratio : float
        Modal damping ratio of all modes.
    force, absorber, response : int
        Degree of freedom of a sector, counted from 0, on which the force acts, that carries the
        absorber, and whose motion is the response.
    mistuning : Mistuning
        Differences between sectors; a sector's stiffness, but not the coupling block, is multiplied
        by the square of its frequency's factor.
    sector_mass : float, optional
        Mass of a sector in kg, which mass ratios refer to. None: the entry of ``mass``, if it has
        only one.

    Raises
    ------
    ParameterError
        A matrix is not symmetric or of another size, the structure is not held, or a number is out
        of its range.

    References
    ----------
    Weidemann, Bergman, Vakakis, Krack, Nonlinear Dynamics (2025), treat such a ring with an
    absorber in each sector.

    Examples
    --------
    >>> from impact_env.structures.cyclic import ring_of_masses
    >>> disk = ring_of_masses(sectors=10, coupling=0.01, frequency=100.0, damping_ratio=1e-3)
    >>> model = disk.model(engine_order=1)
    >>> print(model.modes, f"{model.omega[1] / (2 * 3.141592653589793):.2f} Hz")
    10 100.19 Hz
    """

    sectors: int
    mass: ArrayLike
    stiffness: ArrayLike
    coupling: ArrayLike
    damping_ratio: float = 1e-3
    force: int = 0
    absorber: int = 0
    response: int = 0
    mistuning: Mistuning = Mistuning()
    sector_mass: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sectors", count("sectors", self.sectors, 1, MOST_SECTORS))
        mass = check_matrix("mass", np.atleast_2d(np.asarray(self.mass, dtype=float)))
        size = len(mass)
        allowed = f"at most {MOST_FREEDOMS // size} with {size} degrees of freedom a sector"
        require(self.sectors * size <= MOST_FREEDOMS, "sectors", self.sectors, allowed)
        stiffness = np.atleast_2d(np.asarray(self.stiffness, dtype=float))
        coupling = np.atleast_2d(np.asarray(self.coupling, dtype=float))
        require(
            coupling.shape == (size, size) and bool(np.all(np.isfinite(coupling))),
            "coupling",
            coupling.tolist(),
            f"{size} rows of {size} finite numbers",
        )
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "stiffness", check_matrix("stiffness", stiffness, size))
        object.__setattr__(self, "coupling", coupling)
        for name in ("force", "absorber", "response"):
            allowed = f"a degree of freedom of a sector, 0 to {size - 1}"
            place = count(name, getattr(self, name), 0, size - 1, allowed)
            object.__setattr__(self, name, place)
        if self.sector_mass is None:
            require(size == 1, "sector_mass", None, "given, in kg, for more than one freedom")
            object.__setattr__(self, "sector_mass", float(mass[0, 0]))
        check_fields(
            self,
            damping_ratio=non_negative,
            mistuning=kind_of(Mistuning),
            sector_mass=positive,
        )

    def assemble(self) -> tuple[Array, Array]:
        """Return mass and stiffness matrix (N d, N d) of the whole ring, mistuned."""
        n = self.sectors
        mass, stiffness, coupling = (
            np.asarray(block, dtype=float) for block in (self.mass, self.stiffness, self.coupling)
        )
        squares = self.mistuning.factors("frequency", n) ** 2
        whole = np.kron(np.diag(squares), stiffness)
        size = len(mass)
        for sector in range(n if n > 1 else 0):
            own = slice(sector * size, (sector + 1) * size)
            after = (sector + 1) % n
            following = slice(after * size, (after + 1) * size)
            whole[own, following] += coupling
            whole[following, own] += coupling.T
        return np.kron(np.eye(n), mass), whole

    @cached_property
    def _modes(self) -> tuple[Array, Array]:
        """Squares of the frequencies and mass-normalised shapes.

        Squares (N d,) are in 1/s^2 in ascending order. Shapes (N d, N d) are columns.
        """
        mass, stiffness = self.assemble()
        lightest = float(np.min(np.linalg.eigvalsh(np.asarray(self.mass, dtype=float))))
        allowed = "a positive definite matrix: each degree of freedom of a sector has a mass"
        require(lightest > 0, "mass", f"a matrix with the eigenvalue {lightest:.3g} kg", allowed)
        squares, shapes = scipy.linalg.eigh(stiffness, mass)
        require(
            bool(squares[0] > 1e-12 * squares[-1]),
            "stiffness",
            f"with the square of a frequency {squares[0]:.3g} 1/s^2",
            "that of a ring that is held: all frequencies above 0",
        )
        return squares, shapes

    def model(
        self, engine_order: int = 0, direction: str = "forward", modes: int | None = None
    ) -> ModalModel:
        """Return the modal model of the ring under forces of one engine order.

        It has a place for an absorber in every sector.

        Parameters
        ----------
        engine_order : int
            Number k of periods of the force around the ring, 0 to N/2. The force on sector s
            (counted from 0) has the phase -2 pi k s/N for a wave that travels forward, the opposite
            one backward.
        direction : str
            "forward", "backward", or "standing": then the amplitudes are cos(2 pi k s/N), and all
            phases are equal.
        modes : int, optional
            Number of modes kept, from the lowest. None: all.

        Raises
        ------
        ParameterError
            The engine order is above N/2, or excites no mode that is kept; the ring is not held.
        """
        n = self.sectors
        order = count(
            "engine_order", engine_order, 0, n // 2, f"0 to {n // 2}, half of the sectors"
        )
        kind = one_of("direction", direction, DIRECTIONS)
        squares, shapes = self._modes
        number_of_modes = count("modes", len(squares) if modes is None else modes, 1, len(squares))
        size = len(np.asarray(self.mass))

        def rows(freedom: int) -> Array:
            return np.asarray(shapes[freedom::size, :number_of_modes])

        angle = 2 * np.pi * order * np.arange(n) / n
        sizes = np.cos(angle) if kind == "standing" else np.ones(n)
        sign = {"forward": -1.0, "backward": 1.0, "standing": 0.0}[kind]
        omega = np.sqrt(squares[:number_of_modes])
        model = ModalModel(
            omega,
            np.full(number_of_modes, self.damping_ratio),
            rows(self.force)[0],
            rows(self.response)[0],
            n * (self.sector_mass or 0.0),
            absorber_shapes=rows(self.absorber),
        )
        shapes_at_force = rows(self.force)
        pattern = np.abs((sizes * np.exp(1j * sign * angle)) @ shapes_at_force)
        excites = bool(np.any(pattern > 1e-10 * np.max(np.abs(shapes_at_force))))
        allowed = f"one that excites a mode of the {number_of_modes} kept"
        require(excites, "engine_order", order, allowed)
        places = {str(sector): shape for sector, shape in enumerate(shapes_at_force)}
        return model.with_forces(shapes_at_force, sizes, sign * angle).with_force_places(places)

    def all_shapes(self, modes: int | None = None) -> Array:
        """Return the displacement (N d, N_m) of all freedoms, sector by sector, in 1/sqrt(kg).

        It is per unit modal displacement.
        """
        return np.asarray(self._modes[1][:, :modes])

    def response_shapes(self, modes: int | None = None) -> Array:
        """Return the displacement (N, N_m) of each sector's response point.

        It is per modal displacement, in 1/sqrt(kg).
        """
        return self.all_shapes(modes)[self.response :: len(np.asarray(self.mass))]

    def scene(
        self,
        absorber: SlidingAbsorber | Sequence[SlidingAbsorber],
        engine_order: int = 0,
        direction: str = "forward",
        sectors: Iterable[int] | None = None,
        modes: int | None = None,
    ) -> Scene:
        """Return the ring with an absorber in every sector, or in some ``sectors``.

        Sectors are counted from 0. ``absorber`` is one for all sectors, or a sequence of one for
        each of ``sectors``. Its mass ratio refers to the mass of its sector; its gap is mistuned.
        Other parameters and errors are those of `model`.
        """
        which = check_sectors("sectors", sectors, self.sectors)
        every = _absorber_of_each(absorber, which)
        factors = self.mistuning.factors("gap", self.sectors)
        mistuned = []
        for one, sector in zip(every, which, strict=True):
            walls = one.walls
            if walls is not None and np.isfinite(walls.gap):
                gap = positive(f"gap of sector {sector}", walls.gap * float(factors[sector]))
                walls = replace(walls, gap=gap)
            mistuned.append(replace(one, walls=walls, mass_ratio=one.mass_ratio / self.sectors))
        model = self.model(engine_order, direction, modes)
        if len(which) == 1:
            return Scene(model.with_absorber_at(which[0] + 1), mistuned[0])
        places = model.with_absorbers_at([sector + 1 for sector in which])
        return Scene(places, SeveralAbsorbers(tuple(mistuned), (1.0,) * len(which)))


def check_sectors(name: str, sectors: Iterable[int] | None, number: int) -> tuple[int, ...]:
    """Return ``sectors`` as a tuple of different numbers from 0 to ``number`` - 1; None: all."""
    if sectors is None:
        return tuple(range(number))
    every = listed(name, sectors)
    allowed = f"one or more different sectors, 0 to {number - 1}"
    require(len(every) > 0, name, list(every), allowed)
    result = tuple(count(name, sector, 0, number - 1, allowed) for sector in every)
    require(len(set(result)) == len(result), name, list(result), allowed)
    return result


def _absorber_of_each(
    absorber: SlidingAbsorber | Sequence[SlidingAbsorber], sectors: tuple[int, ...]
) -> tuple[SlidingAbsorber, ...]:
    """Return an absorber for each of ``sectors``, from one for all or a sequence of as many."""
    if isinstance(absorber, SlidingAbsorber):
        return (absorber,) * len(sectors)
    every = each_of(kind_of(SlidingAbsorber))("absorber", absorber)
    allowed = f"one for all sectors, or one for each of the {len(sectors)} sectors"
    require(len(every) == len(sectors), "absorber", f"{len(every)} absorbers", allowed)
    return tuple(every)


@dataclass(frozen=True, eq=False)
class BladedDisk:
    """A cyclic structure with its engine-order force and its absorbers.

    The table ``[cyclic]`` of a file describes it.

    Parameters
    ----------
    ring : CyclicStructure
        The sectors, with their mistuning.
    engine_order : int
        Number k of periods of the force around the ring, 0 to N/2.
    direction : str
        "forward", "backward" or "standing", as in `CyclicStructure.model`.
    amplitude : float, optional
        Amplitude in N of the force on each sector (of a standing one its largest). None: given by
        each drive.
    absorbers : sequence of SlidingAbsorber
        One for each sector of ``absorber_sectors``, or one absorber for all; empty: no absorber.
        Mass ratios refer to a sector's mass.
    absorber_sectors : sequence of int, optional
        Sectors with an absorber, counted from 0. None: all.
    modes : int, optional
        Number of modes kept, from the lowest. None: all.

    Raises
    ------
    ParameterError
        The engine order is above N/2, a sector is named twice or does not exist, or there are not
        as many absorbers as sectors.

    Examples
    --------
    >>> from impact_env import impact_absorber
    >>> from impact_env.structures.cyclic import BladedDisk, ring_of_masses
    >>> ring = ring_of_masses(sectors=10, coupling=0.01, frequency=100.0)
    >>> pair = (impact_absorber(5e-5, 0.8), impact_absorber(6e-5, 0.8))
    >>> disk = BladedDisk(ring, 1, absorbers=pair, absorber_sectors=(0, 5))
    >>> print(disk.scene().places, "absorbers")
    2 absorbers
    """

    ring: CyclicStructure
    engine_order: int = 0
    direction: str = DIRECTIONS[0]
    amplitude: float | None = None
    absorbers: tuple[SlidingAbsorber, ...] = ()  # or one for all sectors
    absorber_sectors: tuple[int, ...] = None  # type: ignore[assignment]  # None: all
    modes: int | None = None

    def __post_init__(self) -> None:
        check_fields(self, ring=kind_of(CyclicStructure), amplitude=or_none(positive))
        n = self.ring.sectors
        self.ring.model(self.engine_order, self.direction, self.modes)  # raises what is wrong
        check_fields(self, engine_order=count_from(0))
        sectors = check_sectors("absorber_sectors", self.absorber_sectors, n)
        object.__setattr__(self, "absorber_sectors", sectors)
        absorbers: Any = self.absorbers
        if isinstance(absorbers, SlidingAbsorber) or len(listed("absorbers", absorbers)):
            absorbers = _absorber_of_each(absorbers, sectors)
        object.__setattr__(self, "absorbers", tuple(absorbers))

    @property
    def model(self) -> ModalModel:
        """Modal model of the mistuned ring under its force."""
        return self.ring.model(self.engine_order, self.direction, self.modes)

    @property
    def response_shapes(self) -> Array:
        """Displacement (N, N_m) of each sector's response per modal displacement, in 1/sqrt(kg)."""
        return self.ring.response_shapes(self.modes)

    def scene(self) -> Scene:
        """Return the scene: the mistuned ring with its absorbers, whose gaps are mistuned too."""
        if not self.absorbers:
            return Scene(self.model)
        return self.ring.scene(
            self.absorbers, self.engine_order, self.direction, self.absorber_sectors, self.modes
        )

    def member(self, number: int) -> "BladedDisk":
        """Return the disk of a member of an ensemble.

        Its mistuning is drawn with the seed plus ``number``, so that member 0 is the disk itself.
        """
        mistuning = self.ring.mistuning
        drawn = replace(mistuning, seed=mistuning.seed + count("number", number, 0))
        return replace(self, ring=replace(self.ring, mistuning=drawn))

    def tuned(self) -> "BladedDisk":
        """Return the disk without mistuning."""
        return replace(self, ring=replace(self.ring, mistuning=Mistuning()))

    def with_absorbers(
        self, absorbers: SlidingAbsorber | Sequence[SlidingAbsorber]
    ) -> "BladedDisk":
        """Return the disk with other absorbers in the same sectors.

        An empty tuple stands for no absorbers.
        """
        every = (
            absorbers if absorbers == () else _absorber_of_each(absorbers, self.absorber_sectors)
        )
        return replace(self, absorbers=every)


def ring_of_masses(
    sectors: int,
    coupling: float,
    frequency: float,
    damping_ratio: float = 1e-3,
    mass: float = 1.0,
    mistuning: Mistuning | None = None,
) -> CyclicStructure:
    """Return a ring of equal masses on springs, each linked to both neighbours by a spring.

    Parameters
    ----------
    sectors : int
        Number of masses.
    coupling : float
        Stiffness of a linking spring over that of the spring to the ground, 0 or above.
    frequency : float
        Frequency of a mass on its own spring to the ground, in Hz.
    damping_ratio : float
        Modal damping ratio of all modes.
    mass : float
        A sector's mass in kg.
    mistuning : Mistuning, optional
        Differences between sectors; None: there are none.
    """
    n = count("sectors", sectors, 1, MOST_SECTORS)
    link = non_negative("coupling", coupling)
    kilograms = positive("mass", mass)
    ground = kilograms * (2 * np.pi * positive("frequency", frequency)) ** 2
    neighbours = 0.0 if n == 1 else 2.0
    return CyclicStructure(
        n,
        [[kilograms]],
        [[ground * (1 + neighbours * link)]],
        [[-ground * link]],
        damping_ratio,
        mistuning=Mistuning() if mistuning is None else mistuning,
    )
