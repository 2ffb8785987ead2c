"""Structures on which the results of `design gap` are tested.

There are twenty of many kinds, and ten difficult ones.

They are beams, plates, frames and modal models, none of them the paper's beam. Plates are
Kirchhoff's by Ritz's method, with Legendre polynomials times what the held edges ask for; portal
frames are plane Euler-Bernoulli finite elements. SI units.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import Legendre, leggauss

from impact_env import Beam, ModalModel
from impact_env.structures.matrices import lowest_modes
from optimisation.mounting import model_with_absorber_at
from studies.study import Array

Point = tuple[float, float]
# modes kept; polynomials along each edge of a plate
MODES = 10
TERMS = 8
HELD = {
    "free": (0, 0),
    "clamped": (2, 2),
    "pinned": (1, 1),
    "cantilever": (2, 0),
}  # zeros of the deflection at the two ends of an edge


@dataclass(frozen=True)
class StructureCase:
    """A structure with its name, a resonance and a mass ratio.

    ``resonance`` is counted from 1, and ``mass_ratio`` is the absorber's mass over that of the
    structure.
    """

    name: str
    structure: Callable[[], Beam | ModalModel]
    resonance: int = 1
    mass_ratio: float = 0.02

    def model(self) -> ModalModel:
        """Return the modal model with absorber, force and response in their places."""
        return model_with_absorber_at(self.structure())


def _functions(held: str) -> list[Polynomial]:
    """Return polynomials on 0..1 that keep what is held."""
    first, last = HELD[held]
    edge = Polynomial([0, 1]) ** first * Polynomial([1, -1]) ** last
    return [edge * Legendre.basis(k, domain=[0, 1]).convert(kind=Polynomial) for k in range(TERMS)]


@cache
def _bending(held: tuple[str, str], sides: Point, poisson: float) -> tuple[Array, Array]:
    """Return (mass, stiffness) of a plate's polynomials, (TERMS^2, TERMS^2).

    They are relative to its mass per area and its bending stiffness.
    """
    points, weights = leggauss(2 * TERMS + 4)
    tables = [
        np.array(
            [
                [
                    f.deriv(d)((points + 1) / 2) / side**d if d else f((points + 1) / 2)
                    for f in _functions(edge)
                ]
                for d in range(3)
            ]
        )
        for edge, side in zip(held, sides, strict=True)
    ]
    area = sides[0] * sides[1] / 4
    xx, yy, xy, w = (
        np.einsum("ip,jq->ijpq", tables[0][a], tables[1][b]).reshape(TERMS**2, -1)
        for a, b in ((2, 0), (0, 2), (1, 1), (0, 0))
    )
    measure = area * np.outer(weights, weights).ravel()

    def product(first: Array, second: Array) -> Array:
        return np.asarray((first * measure) @ second.T)

    cross = product(xx, yy)
    stiffness = (
        product(xx, xx)
        + product(yy, yy)
        + poisson * (cross + cross.T)
        + 2 * (1 - poisson) * product(xy, xy)
    )
    return product(w, w), stiffness


def plate(
    held: tuple[str, str],
    sides: Point,
    thickness: float,
    places: tuple[Point, Point, Point],
    damping: float,
    material: Point,
) -> ModalModel:
    """Return a plate that is held along x and y as in `HELD`.

    Sides and thickness are in m. Places of force, absorber and response are shares of the sides.
    """
    young, density = material
    force, absorber, response = places
    mass, stiffness = _bending(held, sides, 0.3)
    rigidity = young * thickness**3 / (12 * (1 - 0.3**2))
    modes = lowest_modes(density * thickness * mass, rigidity * stiffness, MODES)

    def shape(place: Point) -> Array:
        values = [[f(x) for f in _functions(edge)] for edge, x in zip(held, place, strict=True)]
        return np.asarray(np.outer(values[0], values[1]).ravel() @ modes.shapes)

    ratios = np.full(MODES, damping)
    return ModalModel(
        modes.omega,
        ratios,
        shape(force),
        shape(absorber),
        density * thickness * sides[0] * sides[1],
        response_shape=shape(response),
    )


ELEMENTS = 6  # of each member of a frame


def frame(
    width: float,
    height: float,
    bending: float,
    per_length: float,
    force: int,
    absorber: int,
    response: int,
    damping: float,
) -> ModalModel:
    """Return a portal frame that is clamped at both feet.

    ``bending`` is its bending stiffness in N m^2, and ``per_length`` its mass in kg/m. Force,
    absorber and response are sideways motions at three nodes.

    Nodes go up the left column, along the beam and down the right column, `ELEMENTS` a member.
    Members do not stretch noticeably.
    """
    corners = np.array([[0, 0], [0, height], [width, height], [width, 0]])
    steps = np.linspace(0, 1, ELEMENTS, endpoint=False)
    nodes = np.vstack(
        [a + steps[:, None] * (b - a) for a, b in itertools.pairwise(corners)] + [corners[-1:]]
    )
    pairs = list(itertools.pairwise(range(len(nodes))))
    mass, stiffness = assembled(
        nodes, pairs, np.full(len(pairs), bending), np.full(len(pairs), per_length)
    )
    inner = slice(3, len(mass) - 3)
    modes = lowest_modes(mass[inner, inner], stiffness[inner, inner], MODES)
    force_shape, tip, read = (modes.shapes[3 * (node - 1)] for node in (force, absorber, response))
    return ModalModel(
        modes.omega,
        np.full(MODES, damping),
        force_shape,
        tip,
        per_length * (2 * height + width),
        response_shape=read,
    )


def assembled(
    nodes: Array, members: Sequence[tuple[int, int]], bending: Array, per_length: Array
) -> tuple[Array, Array]:
    """Return (mass, stiffness) of a plane frame.

    ``nodes`` (n, 2) are the positions of its nodes. Each member has two nodes, ``bending`` in N m^2
    and ``per_length`` in kg/m.

    Three freedoms a node: along both axes, and turn.
    """
    mass, stiffness = np.zeros((2, 3 * len(nodes), 3 * len(nodes)))
    for (first, second), rigidity, own in zip(members, bending, per_length, strict=True):
        x, y = nodes[second] - nodes[first]
        length = float(np.hypot(x, y))
        both = np.kron(
            np.eye(2), [[x / length, y / length, 0], [-y / length, x / length, 0], [0, 0, 1]]
        )
        at = np.ix_(*2 * [[3 * node + k for node in (first, second) for k in range(3)]])
        mass[at] += own * both.T @ _inertia(length) @ both
        stiffness[at] += rigidity * both.T @ _stiffness(length) @ both
    return mass, stiffness


def _inertia(length: float) -> Array:
    """Return an element's mass matrix (6, 6) over its mass per length.

    Its degrees of freedom are axial motion, transverse motion and rotation at either end.
    """
    result = np.zeros((6, 6))
    result[np.ix_([0, 3], [0, 3])] = length * np.array([[2, 1], [1, 2]]) / 6
    a = 22 * length
    b = 13 * length
    rows = [
        [156, a, 54, -b],
        [a, 4 * length**2, b, -3 * length**2],
        [54, b, 156, -a],
        [-b, -3 * length**2, -a, 4 * length**2],
    ]
    result[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = length * np.array(rows) / 420
    return result


def _stiffness(length: float) -> Array:
    """Return an element's stiffness matrix (6, 6) over its bending stiffness.

    Its axial stiffness EA is 1e5 times the bending stiffness EI (1/m^2), so that the element hardly
    stretches.
    """
    result = np.zeros((6, 6))
    result[np.ix_([0, 3], [0, 3])] = 1e5 / length * np.array([[1, -1], [-1, 1]])
    a = 6 * length
    rows = [
        [12, a, -12, a],
        [a, 4 * length**2, -a, 2 * length**2],
        [-12, -a, 12, -a],
        [a, 2 * length**2, -a, 4 * length**2],
    ]
    result[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = np.array(rows) / length**3
    return result


def storeys(number: int, damping: float, force: int, absorber: int) -> ModalModel:
    """Return a shear building of equal storeys, 1 t and 2 MN/m each.

    Force and absorber act at storeys, counted from 1. The modes are sines.
    """
    k = np.arange(1, number + 1)
    angle = (2 * k - 1) * np.pi / (2 * number + 1)
    omega = 2 * np.sqrt(2e6 / 1e3) * np.sin(angle / 2)
    shapes = np.sin(np.outer(k, angle)) * np.sqrt(4 / (2 * number + 1) / 1e3)
    return ModalModel(
        omega, np.full(number, damping), shapes[force - 1], shapes[absorber - 1], 1e3 * number
    )


def modal(
    hertz: tuple[float, ...],
    damping: tuple[float, ...],
    force: tuple[float, ...],
    tip: tuple[float, ...],
    mass: float,
) -> ModalModel:
    """Return a modal model of measured values.

    They are frequencies in Hz, damping ratios, mass-normalised shapes in 1/sqrt(kg), and the mass
    in kg.
    """
    return ModalModel(
        2 * np.pi * np.array(hertz), np.array(damping), np.array(force), np.array(tip), mass
    )


STEEL = (210e9, 7850.0)
ALUMINIUM = (70e9, 2700.0)


def beam(
    material: tuple[float, float], length: float, width: float, depth: float, **settings: object
) -> Beam:
    """Return a beam of rectangular section.

    ``material`` has Young's modulus (Pa) and density (kg/m^3). Length, width and depth are in m.
    """
    young, density = material
    return Beam(
        length=length,
        bending_stiffness=young * width * depth**3 / 12,
        mass_per_length=density * width * depth,
        **settings,  # type: ignore[arg-type]
    )


def boom(damping: float = 0.008) -> Beam:
    """Return a cantilever with a tip mass."""
    return Beam(
        length=0.8,
        bending_stiffness=875.0,
        mass_per_length=3.925,
        tip_mass=0.4,
        damping_ratio=damping,
        force_position=0.3,
    )


def shelf(damping: float = 0.006) -> ModalModel:
    """Return a steel plate that is clamped along one edge."""
    return plate(
        ("cantilever", "free"),
        (0.4, 0.3),
        0.004,
        ((0.5, 0.25), (1.0, 0.9), (0.9, 0.7)),
        damping,
        STEEL,
    )


CASES = (
    StructureCase("boom", boom, 1),
    StructureCase("boom", boom, 2),
    StructureCase("shelf", shelf, 1),
    StructureCase("shelf", shelf, 2),
    StructureCase(
        "mast, 0.3 % damping",
        lambda: beam(STEEL, 2.0, 0.06, 0.02, damping_ratio=0.003, force_position=0.2),
        1,
        0.01,
    ),
    StructureCase(
        "mast, 0.3 % damping",
        lambda: beam(STEEL, 2.0, 0.06, 0.02, damping_ratio=0.003, force_position=0.2),
        3,
        0.02,
    ),
    StructureCase(
        "bridge",
        lambda: beam(
            ALUMINIUM,
            1.5,
            0.05,
            0.01,
            damping_ratio=0.012,
            ends="pinned-pinned",
            force_position=0.3,
            absorber_position=0.5,
        ),
    ),
    StructureCase(
        "bridge off its middle",
        lambda: beam(
            ALUMINIUM,
            1.5,
            0.05,
            0.01,
            damping_ratio=0.005,
            ends="pinned-pinned",
            force_position=0.3,
            absorber_position=0.22,
        ),
        2,
        0.03,
    ),
    StructureCase(
        "beam between clamps",
        lambda: beam(
            STEEL,
            0.9,
            0.03,
            0.01,
            damping_ratio=0.0035,
            ends="clamped-clamped",
            absorber_position=0.5,
        ),
        1,
        0.045,
    ),
    StructureCase(
        "beam between clamps",
        lambda: beam(
            STEEL,
            0.9,
            0.03,
            0.01,
            damping_ratio=0.027,
            ends="clamped-clamped",
            absorber_position=0.45,
        ),
        1,
        0.05,
    ),
    StructureCase(
        "propped beam",
        lambda: beam(
            ALUMINIUM,
            1.0,
            0.04,
            0.008,
            damping_ratio=0.0012,
            ends="clamped-pinned",
            absorber_position=0.6,
        ),
        1,
        0.006,
    ),
    StructureCase(
        "propped beam",
        lambda: beam(
            ALUMINIUM,
            1.0,
            0.04,
            0.008,
            damping_ratio=0.004,
            ends="clamped-pinned",
            absorber_position=0.7,
        ),
        2,
        0.015,
    ),
    StructureCase(
        "floor panel, simply supported",
        lambda: plate(
            ("pinned", "pinned"),
            (0.8, 0.5),
            0.003,
            ((0.3, 0.35), (0.5, 0.5), (0.4, 0.6)),
            0.01,
            ALUMINIUM,
        ),
    ),
    StructureCase(
        "window, clamped all around",
        lambda: plate(
            ("clamped", "clamped"),
            (0.6, 0.45),
            0.005,
            ((0.4, 0.3), (0.7, 0.5), (0.3, 0.5)),
            0.015,
            (70e9, 2500.0),
        ),
        2,
        0.04,
    ),
    StructureCase(
        "wide shelf",
        lambda: plate(
            ("cantilever", "free"),
            (0.25, 0.6),
            0.003,
            ((0.4, 0.2), (1.0, 0.85), (1.0, 0.15)),
            0.003,
            STEEL,
        ),
        2,
        0.03,
    ),
    StructureCase("portal frame", lambda: frame(1.2, 0.8, 1400.0, 3.1, 3, 6, 12, 0.006), 1, 0.02),
    StructureCase("portal frame", lambda: frame(1.2, 0.8, 1400.0, 3.1, 2, 3, 15, 0.007), 3, 0.03),
    StructureCase("five storeys", lambda: storeys(5, 0.02, 2, 5), 1, 0.04),
    StructureCase("five storeys", lambda: storeys(5, 0.005, 5, 5), 2, 0.01),
    StructureCase(
        "measured bracket",
        lambda: modal(
            (31.2, 74.6, 128.0, 201.5),
            (0.011, 0.007, 0.009, 0.013),
            (0.21, 0.34, -0.28, 0.19),
            (0.9, -0.8, 0.85, -1.1),
            6.5,
        ),
        4,
        0.02,
    ),
)


def close_plate() -> ModalModel:
    """Return a nearly square plate on simple supports.

    Its second and third resonance are 5 % apart.
    """
    return plate(
        ("pinned", "pinned"),
        (0.5, 0.48),
        0.003,
        ((0.3, 0.35), (0.7, 0.3), (0.7, 0.3)),
        0.006,
        STEEL,
    )


def close_pair() -> ModalModel:
    """Return a modal model with two resonances 8 % apart.

    Both modes move the absorber's place.
    """
    return modal(
        (20.0, 21.6, 55.0),
        (0.006, 0.006, 0.006),
        (0.5, 0.4, 0.3),
        (0.8, -0.7, 0.6),
        4.0,
    )


# ten cases beyond the first twenty: close modes, force and absorber near a node, light and heavy
# damping, light and heavy absorbers, high resonances
HARD_CASES = (
    StructureCase("close pair", close_pair, 1, 0.02),
    StructureCase("nearly square plate", close_plate, 2, 0.02),
    StructureCase(
        "bridge, force near a node",
        lambda: beam(
            ALUMINIUM,
            1.5,
            0.05,
            0.01,
            damping_ratio=0.006,
            ends="pinned-pinned",
            force_position=0.47,
            absorber_position=0.25,
        ),
        2,
        0.02,
    ),
    StructureCase(
        "mast, absorber near a node",
        lambda: beam(
            STEEL,
            2.0,
            0.06,
            0.02,
            damping_ratio=0.004,
            force_position=0.2,
            absorber_position=0.72,
        ),
        2,
        0.03,
    ),
    StructureCase(
        "mast, 0.1 % damping",
        lambda: beam(STEEL, 2.0, 0.06, 0.02, damping_ratio=0.001, force_position=0.2, modes=4),
        1,
        0.01,
    ),
    StructureCase(
        "mast, 3 % damping",
        lambda: beam(STEEL, 2.0, 0.06, 0.02, damping_ratio=0.03, force_position=0.2),
        1,
        0.03,
    ),
    StructureCase("boom, absorber of 0.5 %", partial(boom, 0.004), 1, 0.005),
    StructureCase("boom, absorber of 8 %", boom, 1, 0.08),
    StructureCase(
        "strip, resonance 4",
        lambda: beam(STEEL, 0.7, 0.05, 0.006, damping_ratio=0.01, force_position=0.3),
        4,
        0.02,
    ),
    StructureCase("five storeys, resonance 5", lambda: storeys(5, 0.01, 3, 4), 5, 0.03),
)
