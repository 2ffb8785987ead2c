"""Validated, frozen parameters in SI units.

The defaults are those of the paper's Table 1. They are defined in this module only.
"""

import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from impact_env.checks import (
    Check,
    count,
    count_from,
    each_of,
    finite,
    fraction,
    instance,
    kind_of,
    labelled,
    listed,
    non_negative,
    number,
    or_none,
    positive,
    require,
    row,
    within,
    word_of,
)
from impact_env.fields import check_fields, parameter

# by this share the next rigid-body motion's frequency is higher: shapes of equal frequencies would
# be undetermined
SUSPENSION_STEP = 0.1


def suspension_frequencies(frequency: float, motions: int) -> tuple[float, ...]:
    """Return the frequencies in Hz of rigid-body motions on a soft suspension.

    The first is ``frequency``. Each further one is higher by `SUSPENSION_STEP` times ``frequency``.
    """
    return tuple(frequency * (1 + SUSPENSION_STEP * k) for k in range(motions))


# supports at the left and the right end -> number of rigid-body motions
ENDS = {
    "clamped-free": 0,
    "clamped-pinned": 0,
    "clamped-clamped": 0,
    "pinned-pinned": 0,
    "pinned-free": 1,
    "free-free": 2,
}
SUSPENDED = (
    "given: these ends leave the beam rigid-body motions, whose frequency a soft suspension "
    "makes, in Hz, far below the first bending mode"
)


MOST_ELEMENTS = 1000  # matrices are dense
MOST_DAMPING = (
    1000  # one of a mode's two rates is fast then and the other slow, a million times apart
)


@dataclass(frozen=True)
class Section:
    """Section of a beam with its own stiffness and mass.

    Parameters
    ----------
    elements : int
        Number of elements of the section.
    bending_stiffness : float
        Bending stiffness EI in N m^2.
    mass_per_length : float
        Mass per length in kg/m.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import Beam, Section
    >>> beam = Beam(sections=(Section(10, bending_stiffness=700.0, mass_per_length=1.5),))
    >>> round(beam.mass, 3)
    0.626
    """

    elements: int = field(
        metadata=parameter(labelled("section's elements", count_from(1, MOST_ELEMENTS)))
    )
    bending_stiffness: float = field(metadata=parameter(positive, unit="N m^2"))
    mass_per_length: float = field(metadata=parameter(positive, unit="kg/m"))

    def __post_init__(self) -> None:
        check_fields(self)


# of a beam: with values in these ranges its omega is a number
LENGTH_OF_BEAM = partial(positive, least=1e-9, most=1e9)
VALUE_OF_BEAM = partial(positive, least=1e-20, most=1e20)


@dataclass(frozen=True)
class Beam:
    """Straight Euler-Bernoulli beam of Hermite elements, reduced to its lowest modes.

    The defaults are the paper's cantilever (section 2.1 and Table 1). Positions are shares of the
    length, measured from the left end.

    Parameters
    ----------
    length : float, optional
        Length l in m.
    bending_stiffness : float, optional
        Bending stiffness EI in N m^2.
    mass_per_length : float, optional
        Mass per length in kg/m.
    elements : int, optional
        Number of finite elements of one length.
    modes : int, optional
        Number of modes kept, N_m.
    damping_ratio : float or tuple of float, optional
        Modal damping ratio, one for all modes or one for each.
    force_position, absorber_position : float, optional
        Positions of the force and of the absorber.
    modal_frequency_ratio : mapping of int to float, optional
        Ratio omega_i/omega_1 to which mode i (2 or above) is shifted, by i; the paper varies
        omega_2 in this way.
    ends : str, optional
        Left and right support, one of `impact_env.parameters.ENDS`.
    tip_mass : float, optional
        Mass on the right end in kg.
    sections : tuple of Section, optional
        Sections from the left with their own stiffness and mass. Elements after them have the
        beam's.
    response_position : float, optional
        Position of the response level. None: the absorber's.
    suspension_frequency : float, optional
        Lowest frequency in Hz of the rigid-body motions on soft springs, which are then the first
        modes. Required for a beam whose supports allow rigid-body motions.

    Raises
    ------
    ParameterError
        A value is out of range, or contradicts another one.

    Examples
    --------
    >>> from impact_env import Beam, modal_model
    >>> beam = Beam(length=1.0, modes=3)
    >>> modal_model(beam).omega.shape
    (3,)
    """

    length: float = field(default=0.5, metadata=parameter(LENGTH_OF_BEAM, unit="m"))
    bending_stiffness: float = field(
        default=362.88, metadata=parameter(VALUE_OF_BEAM, unit="N m^2")
    )
    mass_per_length: float = field(default=1.1275, metadata=parameter(VALUE_OF_BEAM, unit="kg/m"))
    elements: int = field(default=30, metadata=parameter(count_from(1, MOST_ELEMENTS)))
    modes: int = 10
    damping_ratio: float | tuple[float, ...] = 0.01
    force_position: float = 0.4
    absorber_position: float = 1.0
    modal_frequency_ratio: Mapping[int, float] = field(default_factory=dict)
    ends: str = field(default="clamped-free", metadata=parameter(word_of(ENDS)))
    tip_mass: float = field(default=0.0, metadata=parameter(non_negative, unit="kg"))
    sections: tuple[Section, ...] = field(default=(), metadata=parameter(each_of(kind_of(Section))))
    response_position: float | None = None
    suspension_frequency: float | None = field(
        default=None, metadata=parameter(or_none(positive), unit="Hz")
    )

    def __post_init__(self) -> None:
        check_fields(self)
        self._check_parts()
        check_fields(
            self,
            force_position=self.place,
            absorber_position=self.place,
            response_position=or_none(self.place),
            modes=count_from(1, self.freedoms),
            damping_ratio=self._check_damping_ratio,
            modal_frequency_ratio=self._check_frequency_ratios,
        )

    def _check_damping_ratio(self, name: str, value: Any) -> float | tuple[float, ...]:
        allowed = f"one number, or one for each of the {self.modes} modes, from 0 to {MOST_DAMPING}"
        ratios = row(name, value, allowed)
        single = np.ndim(value) == 0
        ok = (single or len(ratios) == self.modes) and bool(
            np.all((ratios >= 0) & (ratios <= MOST_DAMPING))
        )
        require(ok, name, value, allowed)
        return float(ratios[0]) if single else tuple(ratios.tolist())

    def _check_frequency_ratios(self, name: str, value: Any) -> dict[int, float]:
        return {
            count(f"{name}'s mode", mode, 2, self.modes): positive(f"{name}[{mode}]", ratio)
            for mode, ratio in instance(name, value, Mapping).items()
        }

    def _check_parts(self) -> None:
        require(
            self.tip_mass == 0 or self.ends.endswith("-free"),
            "tip_mass",
            self.tip_mass,
            f"0 with {self.ends} ends, where the tip does not move",
        )
        taken = sum(section.elements for section in self.sections)
        require(
            taken <= self.elements,
            "sections",
            self.sections,
            f"with {self.elements} elements or fewer in all, not {taken}",
        )
        if self.suspension_frequency is not None or self.rigid_motions:
            require(self.suspension_frequency is not None, "suspension_frequency", None, SUSPENDED)
            require(
                self.rigid_motions > 0,
                "suspension_frequency",
                self.suspension_frequency,
                f"left out with {self.ends} ends, which hold the beam",
            )

    def place(self, name: str, value: object) -> float:
        """Return a position as a float if the beam can move at this position.

        The position is a fraction of the length.
        """
        low = self.ends.startswith("free")
        high = self.ends.endswith("free")
        if not low and high:
            return fraction(name, value)
        x = number(value)
        allowed = (
            f"a number in {'[' if low else '('}0, 1{']' if high else ')'}, where a {self.ends} "
            "beam moves"
        )
        require(0 < x < 1 or (low and x == 0) or (high and x == 1), name, value, allowed)
        return x

    @property
    def rigid_motions(self) -> int:
        """Number of rigid-body motions."""
        return ENDS[self.ends]

    @property
    def freedoms(self) -> int:
        """Number of deflections and rotations that the ends leave free."""
        held = {"clamped": 2, "pinned": 1, "free": 0}
        return 2 * self.elements + 2 - sum(held[end] for end in self.ends.split("-"))

    @property
    def mass(self) -> float:
        """Mass of the beam in kg, with that on its tip."""
        element = self.length / self.elements
        bare = self.elements - sum(section.elements for section in self.sections)
        own = (
            self.mass_per_length * self.length
            if not self.sections
            else bare * element * self.mass_per_length
        )
        return (
            own
            + sum(section.elements * element * section.mass_per_length for section in self.sections)
            + self.tip_mass
        )

    @property
    def static_tip_stiffness(self) -> float:
        """3 EI / l^3 in N/m, the paper's unit for contact stiffness (appendix)."""
        return 3 * self.bending_stiffness / self.length**3


def _gap(check: Check) -> Mapping[str, Any]:
    """Return the declaration of a gap with this check."""
    return parameter(check, unit="m", description="Clearance to either wall")


def _restitution(check: Check, omit_default: bool = False) -> Mapping[str, Any]:
    """Return the declaration of a coefficient of restitution with this check."""
    return parameter(
        check,
        description="Coefficient of restitution, 0 to 1",
        omit_default=omit_default,
    )


def check_restitution(name: str, value: object) -> float:
    """Return a coefficient of restitution as a float."""
    return within(name, value, 0.0, 1.0, "a number from 0 to 1")


def check_gap(name: str, value: object) -> float:
    """Return the gap of rigid walls in m as a float."""
    return within(name, value, 0.0, math.inf, "a number in m, 0 or above (infinity: no wall)")


@dataclass(frozen=True)
class RigidWalls:
    """Rigid cavity walls with Newton's impact law (paper, Eqs. signorini and impulse).

    Parameters
    ----------
    gap : float, optional
        Clearance to either wall in m.
    restitution : float, optional
        Coefficient of restitution, 0 to 1.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import RigidWalls
    >>> RigidWalls(gap=5e-4, restitution=0.7).restitution
    0.7
    """

    gap: float = field(default=1e-3, metadata=_gap(check_gap))
    restitution: float = field(default=1.0, metadata=_restitution(check_restitution))

    def __post_init__(self) -> None:
        check_fields(self)


def check_finite_gap(name: str, value: object) -> float:
    """Return the gap of walls whose contact yields in m as a float."""
    allowed = "a number in m above 0, and finite, with a yield_velocity"
    return within(name, value, math.ulp(0.0), sys.float_info.max, allowed)


@dataclass(frozen=True)
class YieldingWalls:
    """Rigid cavity walls whose contact yields, so that restitution falls with velocity.

    With the relative velocity v at the impact, e(v) = e (1 + v/v_y)^(-1/4).

    Far above v_y it goes with v^(-1/4), as for a fully plastic sphere (K. L. Johnson, Contact
    Mechanics, 1985, section 11.5).

    Parameters
    ----------
    yield_velocity : float
        Velocity v_y in m/s above which restitution falls.
    gap : float, optional
        Clearance to either wall in m, above 0.
    restitution : float, optional
        Coefficient of restitution e of slow impacts, 0 to 1.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import SlidingAbsorber, YieldingWalls
    >>> absorber = SlidingAbsorber(walls=YieldingWalls(yield_velocity=0.1, restitution=0.8))
    >>> absorber.walls.gap
    0.001
    """

    yield_velocity: float = field(
        metadata=parameter(
            positive,
            unit="m/s",
            description="Impact velocity from which restitution falls, where contact yields",
        )
    )
    gap: float = field(default=RigidWalls.gap, metadata=_gap(check_finite_gap))
    restitution: float = field(
        default=RigidWalls.restitution, metadata=_restitution(check_restitution)
    )

    def __post_init__(self) -> None:
        check_fields(self)


RigidWallLaw = RigidWalls | YieldingWalls  # an impact takes no time

LEAST_RESTITUTION = 1e-6  # of walls that are springs: the damper is almost critical there
MOST_LOSS_FACTOR = (
    1.95  # the damping ratio is half of it, and its restitution must not be below LEAST_RESTITUTION
)


def check_damped_restitution(name: str, value: object) -> float:
    """Return the restitution of walls that are springs as a float."""
    allowed = (
        f"a number from {LEAST_RESTITUTION:g} to 1 with a contact stiffness: a damper lets every "
        "contact rebound"
    )
    return within(name, value, LEAST_RESTITUTION, 1.0, allowed)


@dataclass(frozen=True)
class CompliantWalls:
    """Cavity walls that are unilateral springs (paper, Eq. elSignorini).

    If ``restitution`` is below 1, each spring has a damper in parallel.

    Parameters
    ----------
    stiffness : float
        Spring k_n of a wall in N/m.
    gap : float, optional
        Clearance to either wall in m, 0 or above.
    restitution : float, optional
        Velocity after a free impact over velocity before it, above 0 and at most 1. It determines
        the damper; 1 is the paper's spring without damper. The damper acts as long as the absorber
        overlaps the wall, so it may pull just before the contact ends (Kelvin-Voigt).

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import CompliantWalls, SlidingAbsorber
    >>> absorber = SlidingAbsorber(walls=CompliantWalls(stiffness=1e6, gap=5e-4))
    >>> absorber.walls.gap
    0.0005
    """

    stiffness: float = field(
        metadata=parameter(
            labelled("contact stiffness", positive),
            name="contact_stiffness",
            unit="N/m",
            description="Stiffness of walls that are springs",
        )
    )
    gap: float = field(default=RigidWalls.gap, metadata=_gap(non_negative))
    restitution: float = field(
        default=1.0, metadata=_restitution(check_damped_restitution, omit_default=True)
    )

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def from_loss_factor(
        cls, stiffness: float, loss_factor: float, gap: float = RigidWalls.gap
    ) -> "CompliantWalls":
        """Return walls whose contact has a loss factor.

        Parameters
        ----------
        stiffness : float
            Spring k_n of a wall in N/m.
        loss_factor : float
            Tangent of the loss angle at the contact's own frequency, from 0 to 1.95.
        gap : float, optional
            Clearance to either wall in m, 0 or above.

        Returns
        -------
        CompliantWalls
            Walls with the restitution of that loss factor.

        Raises
        ------
        ParameterError
            A value is out of range.

        Examples
        --------
        >>> round(CompliantWalls.from_loss_factor(1e6, 0.2).restitution, 4)
        0.7292
        """
        eta = non_negative("loss factor", loss_factor)
        require(
            eta < MOST_LOSS_FACTOR, "loss factor", eta, f"a number from 0 to {MOST_LOSS_FACTOR}"
        )
        zeta = eta / 2
        return cls(stiffness, gap, math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)))

    @property
    def damping_ratio(self) -> float:
        """Damping ratio zeta of a free contact, from e = exp(-pi zeta / sqrt(1 - zeta^2))."""
        decrement = -math.log(self.restitution)
        return decrement / math.hypot(math.pi, decrement)

    @property
    def loss_factor(self) -> float:
        """Loss factor of a contact at its own frequency, 2 zeta."""
        return 2 * self.damping_ratio


WallLaw = RigidWallLaw | CompliantWalls

LEAST_LIMIT = 1e-300  # N: a tiny limit may stand for no friction
MOST_STATIC_RATIO = 1e6  # far above any pair of materials


def check_static_ratio(name: str, value: object) -> float:
    """Return a ratio of static to sliding friction as a float if it is in the allowed range."""
    allowed = (
        f"a number from 1 to {MOST_STATIC_RATIO:g}: static friction is never below sliding friction"
    )
    return within(name, value, 1.0, MOST_STATIC_RATIO, allowed)


FRICTION_LIMIT = parameter(
    labelled("friction limit", partial(positive, least=LEAST_LIMIT)),
    name="friction_limit",
    unit="N",
    description="Friction limit, 0 for none",
)


@dataclass(frozen=True)
class CoulombFriction:
    """Rigid Coulomb friction (paper, Eq. coulomb).

    Parameters
    ----------
    limit : float
        Force of sliding friction mu f_N in N, above 0.
    static_ratio : float, optional
        Limit of static friction over that of sliding friction, 1 or above; the paper has 1.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import CoulombFriction, SlidingAbsorber
    >>> SlidingAbsorber(friction=CoulombFriction(limit=0.5)).friction.limit
    0.5
    """

    limit: float = field(metadata=FRICTION_LIMIT)
    static_ratio: float = field(
        default=1.0,
        metadata=parameter(
            check_static_ratio,
            name="static_friction_ratio",
            description="Static friction over sliding friction, 1 or above",
            omit_default=True,
        ),
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class ElasticCoulombFriction:
    """Spring in series with a Coulomb slider (paper, Eq. elCoulomb).

    Parameters
    ----------
    limit : float
        Force of sliding friction mu f_N in N.
    stiffness : float
        Stiffness k_t of the spring in N/m.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import ElasticCoulombFriction, SlidingAbsorber
    >>> friction = ElasticCoulombFriction(limit=0.5, stiffness=1e5)
    >>> SlidingAbsorber(friction=friction).friction.stiffness
    100000.0
    """

    limit: float = field(metadata=FRICTION_LIMIT)
    stiffness: float = field(
        metadata=parameter(
            labelled("friction stiffness", positive),
            name="friction_stiffness",
            unit="N/m",
            description="Stiffness of a spring in series with friction",
        )
    )

    def __post_init__(self) -> None:
        check_fields(self)


FrictionLaw = CoulombFriction | ElasticCoulombFriction


DEFAULT_MASS_RATIO = 0.02
MASS_RATIO = parameter(positive, description="Absorber mass over beam mass")
GRAVITY = parameter(finite, unit="m/s^2")
DAMPING = parameter(
    labelled("absorber damping", non_negative),
    unit="N s/m",
    description="Damper of the absorber",
)


@dataclass(frozen=True)
class StuckAbsorber:
    """An absorber that never moves in its cavity: mass added to the structure (paper, section 3.1).

    Parameters
    ----------
    mass_ratio : float, optional
        Mass of the absorber over the mass of the structure.
    gravity : float, optional
        Gravity in m/s^2 along the motion, as in `SlidingAbsorber`.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import StuckAbsorber, beam_scene
    >>> scene = beam_scene(absorber=StuckAbsorber(mass_ratio=0.02))
    >>> round(scene.absorber_mass, 6)
    0.011275
    """

    mass_ratio: float = field(default=DEFAULT_MASS_RATIO, metadata=MASS_RATIO)
    gravity: float = field(default=0.0, metadata=GRAVITY)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class TunedAbsorber:
    """Linear tuned absorber, LTVA: a mass on a spring and a damper (paper, section 6).

    The defaults are the paper's.

    Parameters
    ----------
    mass_ratio : float, optional
        Mass of the absorber over the mass of the structure.
    stiffness : float, optional
        Stiffness of the spring in N/m.
    damping : float, optional
        Coefficient of the damper in N s/m, 0 or above.
    gravity : float, optional
        Gravity in m/s^2 along the motion, as in `SlidingAbsorber`.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import TunedAbsorber, beam_scene
    >>> scene = beam_scene(absorber=TunedAbsorber(stiffness=650.0, damping=0.7))
    >>> scene.absorber.mass_ratio
    0.02
    """

    mass_ratio: float = field(default=DEFAULT_MASS_RATIO, metadata=MASS_RATIO)
    stiffness: float = field(
        default=701.8,
        metadata=parameter(
            labelled("absorber stiffness", positive),
            unit="N/m",
            description="Spring of the absorber",
        ),
    )
    damping: float = field(default=0.728, metadata=DAMPING)
    gravity: float = field(default=0.0, metadata=GRAVITY)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class NonlinearSink:
    """Nonlinear energy sink: a mass on a cubic spring and a linear damper.

    Without a linear spring it has no frequency of its own (O. Gendelman et al., J. Appl. Mech. 68,
    2001).

    Parameters
    ----------
    cubic_stiffness : float
        Force of the spring over the cube of its stretch, k_3 in N/m^3.
    mass_ratio : float, optional
        Mass of the absorber over the mass of the structure.
    damping : float, optional
        Coefficient of the damper in N s/m, 0 or above.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import NonlinearSink, beam_scene
    >>> scene = beam_scene(absorber=NonlinearSink(cubic_stiffness=1e9))
    >>> scene.absorber.mass_ratio
    0.02
    """

    cubic_stiffness: float = field(
        metadata=parameter(
            positive,
            unit="N/m^3",
            description="Spring of the absorber, whose force grows with the cube",
        )
    )
    mass_ratio: float = field(default=DEFAULT_MASS_RATIO, metadata=MASS_RATIO)
    damping: float = field(default=TunedAbsorber.damping, metadata=DAMPING)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class SlidingAbsorber:
    """A mass that slides along the tip's deflection (paper, section 2.2).

    It has walls, friction, or both.

    With walls it is the impact absorber, without them the friction damper.

    Parameters
    ----------
    mass_ratio : float, optional
        Mass of the absorber over the mass of the structure.
    walls : RigidWalls, YieldingWalls or CompliantWalls, optional
        Walls of the cavity. None: without.
    friction : CoulombFriction or ElasticCoulombFriction, optional
        Friction on the structure. None: without.
    gravity : float, optional
        Gravity in m/s^2 along the motion, towards the lower wall. It acts on the absorber alone:
        the displacement of the structure is measured from its static equilibrium.

    Raises
    ------
    ParameterError
        A value is out of range, or both walls and friction are absent.

    See Also
    --------
    impact_absorber, friction_damper : The two kinds from single values.

    Examples
    --------
    >>> from impact_env import CoulombFriction, RigidWalls, SlidingAbsorber
    >>> SlidingAbsorber(walls=RigidWalls(1e-3, 0.7), friction=CoulombFriction(0.1)).walls.gap
    0.001
    """

    mass_ratio: float = field(default=DEFAULT_MASS_RATIO, metadata=MASS_RATIO)
    walls: WallLaw | None = field(
        default=None,
        metadata=parameter(kind_of(WallLaw | None)),
    )
    friction: FrictionLaw | None = field(
        default=None,
        metadata=parameter(kind_of(FrictionLaw | None)),
    )
    gravity: float = field(default=0.0, metadata=GRAVITY)

    def __post_init__(self) -> None:
        check_fields(self)
        present = [part for part in (self.walls, self.friction) if part is not None]
        require(
            present != [],
            "absorber",
            self,
            "walls, friction or both (a mass with neither does not touch the beam: leave it out)",
        )
        soft = {isinstance(part, CompliantWalls | ElasticCoulombFriction) for part in present}
        require(
            len(soft) == 1,
            "absorber",
            self,
            "walls and friction either both rigid or both compliant",
        )


MOST_ABSORBERS = 128  # more have not been tried


@dataclass(frozen=True)
class SeveralAbsorbers:
    """Two to 128 absorbers with rigid contact, each at a place of its own.

    Parameters
    ----------
    absorbers : sequence of SlidingAbsorber, (n,)
        The absorbers.
    positions : sequence of float, (n,)
        Their positions as shares of the beam's length, from the left end.

    Raises
    ------
    ParameterError
        There are not 2 to 128, or not as many positions; or an absorber is on springs.

    See Also
    --------
    impact_absorbers : Absorbers that share one mass.

    Examples
    --------
    >>> from impact_env import SeveralAbsorbers, impact_absorber
    >>> pair = SeveralAbsorbers((impact_absorber(), impact_absorber()), (0.7, 1.0))
    >>> len(pair.absorbers)
    2
    """

    absorbers: tuple[SlidingAbsorber, ...] = field(metadata=parameter(listed))
    positions: tuple[float, ...] = field(metadata=parameter(each_of(fraction)))

    def __post_init__(self) -> None:
        check_fields(self)
        n = len(self.absorbers)
        require(
            2 <= n <= MOST_ABSORBERS,
            "number of absorbers",
            n,
            f"2 to {MOST_ABSORBERS}; one is an absorber by itself",
        )
        require(
            len(self.positions) == n,
            "positions",
            self.positions,
            f"one for each of the {n} absorbers",
        )
        for absorber in self.absorbers:
            rigid = isinstance(absorber, SlidingAbsorber) and isinstance(
                absorber.walls, RigidWalls | YieldingWalls | None
            )
            rigid = rigid and not isinstance(absorber.friction, ElasticCoulombFriction)
            require(
                rigid,
                "absorber",
                absorber,
                "among several only impact absorbers and friction dampers with rigid contact",
            )
            require(
                not isinstance(absorber.friction, CoulombFriction)
                or absorber.friction.static_ratio == 1,
                "static_ratio",
                getattr(absorber.friction, "static_ratio", None),
                "1 among several absorbers",
            )
            walls = absorber.walls
            touches = absorber.friction is not None or (
                walls is not None and math.isfinite(walls.gap)
            )
            require(
                walls is None or walls.gap > 0,
                "gap",
                getattr(walls, "gap", None),
                "above 0 among several absorbers",
            )
            require(
                touches,
                "gap",
                getattr(walls, "gap", None),
                "finite where there is no friction: this absorber would not touch the beam",
            )

    @property
    def mass_ratio(self) -> float:
        """Mass of all absorbers together over the mass of the structure."""
        return math.fsum(absorber.mass_ratio for absorber in self.absorbers)


LinearAbsorber = StuckAbsorber | TunedAbsorber
Absorber = LinearAbsorber | NonlinearSink | SlidingAbsorber | SeveralAbsorbers


def find_largest_gravity(absorber: Absorber | None) -> float:
    """Return the gravity in m/s^2 along the motion of an absorber, or the largest of several."""
    if isinstance(absorber, SeveralAbsorbers):
        return max((one.gravity for one in absorber.absorbers), key=abs)
    return getattr(absorber, "gravity", 0.0)


def require_weightless(absorber: Absorber | None, what: str) -> None:
    """Raise ParameterError for an absorber that has a weight along its motion.

    ``what`` names the computation that does not include such a weight.
    """
    heavy = find_largest_gravity(absorber)
    require(heavy == 0, "gravity", heavy, f"0 for {what}")


def friction_law(
    limit: float | None, stiffness: float | None = None, static_ratio: float = 1.0
) -> FrictionLaw | None:
    """Return friction with a ``limit`` in N, elastic if it has a ``stiffness`` (N/m).

    The result is None for a limit of 0 or None. ``static_ratio`` is as in `CoulombFriction`;
    elastic friction must have 1.
    """
    stiffness = None if stiffness is None else positive("friction stiffness", stiffness)
    if limit is None or non_negative("friction limit", limit) == 0:
        return None
    if stiffness is None:
        return CoulombFriction(limit, static_ratio)
    allowed = "left out with a friction stiffness: elastic friction has one limit"
    require(static_ratio == 1, "static_ratio", static_ratio, allowed)
    return ElasticCoulombFriction(limit, stiffness)


def impact_absorber(
    gap: float = RigidWalls.gap,
    restitution: float = RigidWalls.restitution,
    friction_limit: float | None = None,
    mass_ratio: float = DEFAULT_MASS_RATIO,
) -> SlidingAbsorber:
    """Return an impact absorber: a mass between two rigid walls, with or without friction.

    Parameters
    ----------
    gap : float, optional
        Clearance to either wall in m (default: the paper's 1 mm).
    restitution : float, optional
        Coefficient of restitution, 0 to 1.
    friction_limit : float, optional
        Force of sliding friction mu f_N in N. None or 0: no friction.
    mass_ratio : float, optional
        Mass of the absorber over the mass of the structure.

    Returns
    -------
    SlidingAbsorber
        The absorber, to be put on a structure by `beam_scene`.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import impact_absorber
    >>> impact_absorber(gap=5e-4, restitution=0.7).walls.gap
    0.0005
    """
    return SlidingAbsorber(mass_ratio, RigidWalls(gap, restitution), friction_law(friction_limit))


def friction_damper(
    friction_limit: float = 0.5,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    friction_stiffness: float | None = None,
    static_friction_ratio: float = 1.0,
) -> SlidingAbsorber:
    """Return a friction damper: a mass that slides on the structure without walls.

    Parameters
    ----------
    friction_limit : float, optional
        Force of sliding friction mu f_N in N, above 0 (default: the paper's optimum for 3.5 N).
    mass_ratio : float, optional
        Mass of the damper over the mass of the structure.
    friction_stiffness : float, optional
        Stiffness in N/m of a spring in series with the slider. None: rigid friction.
    static_friction_ratio : float, optional
        Static over sliding friction, 1 or above; above 1 only with rigid friction.

    Returns
    -------
    SlidingAbsorber
        The damper, to be put on a structure by `beam_scene`.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import friction_damper
    >>> friction_damper(0.3).friction.limit
    0.3
    """
    ratio = check_static_ratio("static_friction_ratio", static_friction_ratio)
    friction = friction_law(friction_limit, friction_stiffness, ratio)
    allowed = (
        "above 0 for a friction damper: without friction it would not touch the beam, so leave "
        "the absorber out"
    )
    require(friction is not None, "friction limit", friction_limit, allowed)
    return SlidingAbsorber(mass_ratio, None, friction)


def tuned_absorber(
    stiffness: float = TunedAbsorber.stiffness,
    damping: float = TunedAbsorber.damping,
    mass_ratio: float = DEFAULT_MASS_RATIO,
) -> TunedAbsorber:
    """Return a linear tuned absorber: a mass on a spring and a damper.

    Parameters
    ----------
    stiffness : float, optional
        Stiffness of the spring in N/m (default: the paper's, for its beam's first resonance).
    damping : float, optional
        Coefficient of the damper in N s/m, 0 or above.
    mass_ratio : float, optional
        Mass of the absorber over the mass of the structure.

    Returns
    -------
    TunedAbsorber
        The absorber, to be put on a structure by `beam_scene`.

    Raises
    ------
    ParameterError
        A value is out of range.

    See Also
    --------
    optimisation.tuned : Tunings for a structure.

    Examples
    --------
    >>> from impact_env import tuned_absorber
    >>> tuned_absorber(stiffness=700.0, damping=0.7).stiffness
    700.0
    """
    return TunedAbsorber(mass_ratio, stiffness, damping)


def shared_masses(
    number: int, mass_ratio: float = DEFAULT_MASS_RATIO, shares: Iterable[float] | None = None
) -> tuple[float, ...]:
    """Return the mass ratio of each of ``number`` absorbers.

    ``mass_ratio`` is that of all absorbers together, and ``shares`` of it are equal by default.
    """
    number = count("number", number, 1, MOST_ABSORBERS)
    shares = (
        (1 / number,) * number
        if shares is None
        else tuple(positive("shares", x) for x in listed("shares", shares))
    )
    require(len(shares) == number, "shares", shares, f"one for each of the {number} absorbers")
    require(abs(math.fsum(shares) - 1) < 1e-9, "shares", shares, "numbers above 0 whose sum is 1")
    return tuple(positive("mass_ratio", mass_ratio) * share for share in shares)


def impact_absorbers(
    gaps: Iterable[float],
    positions: Iterable[float],
    restitution: float | Iterable[float] = RigidWalls.restitution,
    friction_limit: float | Iterable[float | None] | None = None,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    shares: Iterable[float] | None = None,
) -> SeveralAbsorbers:
    """Return impact absorbers with rigid contact that share one mass.

    Parameters
    ----------
    gaps : iterable of float, (n,)
        Clearance of each absorber to either wall in m.
    positions : iterable of float, (n,)
        Place of each absorber as a share of the beam's length, from the left end.
    restitution : float or iterable of float, optional
        Coefficient of restitution of all absorbers, or one for each.
    friction_limit : float or iterable of float, optional
        Force of sliding friction in N of all absorbers, or one for each. None or 0: no friction.
    mass_ratio : float, optional
        Mass of all absorbers together over the mass of the structure.
    shares : iterable of float, (n,), optional
        Share of that mass that each absorber has, 1 in all. Default: equal shares.

    Returns
    -------
    SeveralAbsorbers
        The absorbers, to be put on a structure by `beam_scene`.

    Raises
    ------
    ParameterError
        A value is out of range, or the arguments are not of one length.

    Examples
    --------
    >>> from impact_env import impact_absorbers
    >>> impact_absorbers(gaps=[5e-4, 1e-3], positions=[0.7, 1.0]).mass_ratio
    0.02
    """
    gaps = listed("gaps", gaps)
    positions = listed("positions", positions)
    n = len(gaps)
    restitutions = (
        listed("restitution", restitution)
        if isinstance(restitution, Iterable)
        else (restitution,) * n
    )
    limits = (
        listed("friction_limit", friction_limit)
        if isinstance(friction_limit, Iterable)
        else (friction_limit,) * n
    )
    for name, values in (
        ("positions", positions),
        ("restitution", restitutions),
        ("friction_limit", limits),
    ):
        require(len(values) == n, name, values, f"one for each of the {n} gaps")
    every = zip(gaps, restitutions, limits, shared_masses(n, mass_ratio, shares), strict=True)
    return SeveralAbsorbers(tuple(impact_absorber(*one) for one in every), positions)
