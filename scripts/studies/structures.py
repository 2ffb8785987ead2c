"""Structures on which the answers of `design_gap` are put to the test: twenty chosen ones, and ten drawn.

They are beams, plates, frames and modal models, none of them the paper's beam. Plates are Kirchhoff's by Ritz's method, with Legendre
polynomials times what the held edges ask for; portal frames are plane Euler-Bernoulli finite elements. SI units.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import Legendre, leggauss
from numpy.random import Generator
from numpy.typing import NDArray

from impact_env import Beam, ModalModel
from impact_env.structures.matrices import lowest_modes
from optimisation.bounds import reach
from optimisation.mounting import mounted
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
class Case:
    """A structure with its name, the resonance (counted from 1) and the absorber's mass over the structure's."""

    name: str
    structure: Callable[[], Beam | ModalModel]
    resonance: int = 1
    mass_ratio: float = 0.02

    def model(self) -> ModalModel:
        """Return the modal model with absorber, force and response in their places."""
        return mounted(self.structure())


def _functions(held: str) -> list[Polynomial]:
    """Return polynomials on 0..1 that keep what is held."""
    first, last = HELD[held]
    edge = Polynomial([0, 1]) ** first * Polynomial([1, -1]) ** last
    return [edge * Legendre.basis(k, domain=[0, 1]).convert(kind=Polynomial) for k in range(TERMS)]


@cache
def _bending(held: tuple[str, str], sides: Point, poisson: float) -> tuple[Array, Array]:
    """Return (mass, stiffness) of a plate's polynomials, (TERMS^2, TERMS^2), over its mass per area and its bending stiffness."""
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
    """Return a plate held along x and y (`HELD`); sides and thickness in m; places of force, absorber and response as shares of the sides."""
    (young, density), (force, absorber, response) = material, places
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
    """Return a portal frame that is clamped at both feet: its bending stiffness in N m^2 and mass in kg/m, and sideways motion at three nodes.

    Nodes go up the left column, along the beam and down the right column, `ELEMENTS` a member. Members do not stretch noticeably.
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
    """Return (mass, stiffness) of a plane frame: places of its nodes (n, 2), and the two nodes, N m^2 and kg/m of each member.

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


def hermite(length: float, elements: int) -> tuple[Array, Array, Array, Array]:
    """Return integrals over a line of cubic Hermite elements, deflection and slope by turns: of N N, N' N', N'' N'' and N'' N."""
    found = np.zeros((4, 2 * elements + 2, 2 * elements + 2))
    step = length / elements
    bend = [1, 2, 4, 5]
    b = 3 * step
    rows = [
        [36, b, -36, b],
        [b, 4 * step**2, -b, -(step**2)],
        [-36, -b, 36, -b],
        [b, -(step**2), -b, 4 * step**2],
    ]
    slopes = np.array(rows) / (30 * step)
    ends = np.zeros((4, 4))
    ends[1, 0], ends[3, 2] = -1, 1  # slope times deflection at the ends of an element, by parts
    for k in range(elements):
        at = slice(2 * k, 2 * k + 4)
        for total, own in zip(
            found,
            (
                _inertia(step)[np.ix_(bend, bend)],
                slopes,
                _stiffness(step)[np.ix_(bend, bend)],
                ends - slopes,
            ),
            strict=True,
        ):
            total[at, at] += own
    return tuple(found)  # type: ignore[return-value]


def _inertia(length: float) -> Array:
    """Return an element's mass matrix (6, 6) over its mass per length: freedoms are motion along, across and turn at either end."""
    found = np.zeros((6, 6))
    found[np.ix_([0, 3], [0, 3])] = length * np.array([[2, 1], [1, 2]]) / 6
    a = 22 * length
    b = 13 * length
    rows = [
        [156, a, 54, -b],
        [a, 4 * length**2, b, -3 * length**2],
        [54, b, 156, -a],
        [-b, -3 * length**2, -a, 4 * length**2],
    ]
    found[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = length * np.array(rows) / 420
    return found


def _stiffness(length: float) -> Array:
    """Return an element's stiffness matrix (6, 6) over its bending stiffness; it is 1000 times as stiff along as a slenderness of 1 gives."""
    found = np.zeros((6, 6))
    found[np.ix_([0, 3], [0, 3])] = 1e5 / length * np.array([[1, -1], [-1, 1]])
    a = 6 * length
    rows = [
        [12, a, -12, a],
        [a, 4 * length**2, -a, 2 * length**2],
        [-12, -a, 12, -a],
        [a, 2 * length**2, -a, 4 * length**2],
    ]
    found[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = np.array(rows) / length**3
    return found


def storeys(number: int, damping: float, force: int, absorber: int) -> ModalModel:
    """Return a shear building of equal storeys, 1 t and 2 MN/m each; force and absorber at storeys counted from 1. Its modes are sines."""
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
    """Return a model of measured numbers: frequencies in Hz, damping ratios, mass-normalised shapes in 1/sqrt(kg), mass in kg."""
    return ModalModel(
        2 * np.pi * np.array(hertz), np.array(damping), np.array(force), np.array(tip), mass
    )


STEEL = (210e9, 7850.0)
ALUMINIUM = (70e9, 2700.0)


def beam(
    material: tuple[float, float], length: float, width: float, depth: float, **given: object
) -> Beam:
    """Return a beam of rectangular section (m) of a material's Young's modulus (Pa) and density (kg/m^3)."""
    young, density = material
    return Beam(
        length=length,
        bending_stiffness=young * width * depth**3 / 12,
        mass_per_length=density * width * depth,
        **given,  # type: ignore[arg-type]
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
    Case("boom", boom, 1),
    Case("boom", boom, 2),
    Case("shelf", shelf, 1),
    Case("shelf", shelf, 2),
    Case(
        "mast, 0.3 % damping",
        lambda: beam(STEEL, 2.0, 0.06, 0.02, damping_ratio=0.003, force_position=0.2),
        1,
        0.01,
    ),
    Case(
        "mast, 0.3 % damping",
        lambda: beam(STEEL, 2.0, 0.06, 0.02, damping_ratio=0.003, force_position=0.2),
        3,
        0.02,
    ),
    Case(
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
    Case(
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
    Case(
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
    Case(
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
    Case(
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
    Case(
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
    Case(
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
    Case(
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
    Case(
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
    Case("portal frame", lambda: frame(1.2, 0.8, 1400.0, 3.1, 3, 6, 12, 0.006), 1, 0.02),
    Case("portal frame", lambda: frame(1.2, 0.8, 1400.0, 3.1, 2, 3, 15, 0.007), 3, 0.03),
    Case("five storeys", lambda: storeys(5, 0.02, 2, 5), 1, 0.04),
    Case("five storeys", lambda: storeys(5, 0.005, 5, 5), 2, 0.01),
    Case(
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


# Structures drawn by a seed that had no part in how `design_gap` searches: what its answers are worth where nobody has looked.
#
# Four families by turns: plates with a machine on them, by finite elements (Bogner, Fox and Schmit); stepped beams with a tip mass; frames of two
# storeys; modal models as a test gives them. Sizes, places, damping of 0.12 to 3 %, resonance 1 to 4 and an absorber of 1 to 5 % are drawn anew until
# the free amplitude is 1.5 to 15 times the rule's gap.

SEEDS = range(2001, 2011)
REACH = (1.5, 15.0)
DAMPING = (0.0012, 0.03)
SHARES = (0.01, 0.05)
# elements of a plate and of a beam
ALONG = 8
ACROSS = 6
STEPS = 12


def _drawn_modes(
    draw: Generator,
    mass: Array,
    stiffness: Array,
    free: NDArray[np.intp],
    places: NDArray[np.intp],
    total: float,
) -> ModalModel:
    """Return a model of what is free to move, with force, absorber and response at three of the places, all freedoms by number."""
    modes = lowest_modes(mass[np.ix_(free, free)], stiffness[np.ix_(free, free)], MODES)
    force, tip, read = modes.shapes[
        np.searchsorted(free, draw.choice(np.intersect1d(places, free), 3))
    ]
    return ModalModel(modes.omega, np.ones(MODES), force, tip, total, response_shape=read)


def machine_plate(draw: Generator) -> ModalModel:
    """Return a plate that is held along one edge or two, with a machine of up to its own mass on it."""
    (young, density), thickness, poisson = (
        (STEEL, ALUMINIUM)[draw.integers(2)],
        draw.uniform(0.002, 0.006),
        0.3,
    )
    length, width = draw.uniform(0.25, 0.8, 2)
    (ax, bx, cx, dx), (ay, by, cy, dy) = hermite(length, ALONG), hermite(width, ACROSS)
    stiffness: Array = (
        np.kron(cx, ay)
        + np.kron(ax, cy)
        + poisson * (np.kron(dx, dy.T) + np.kron(dx.T, dy))
        + 2 * (1 - poisson) * np.kron(bx, by)
    )
    stiffness *= young * thickness**3 / (12 * (1 - poisson**2))
    mass = np.asarray(density * thickness * np.kron(ax, ay), dtype=np.float64)
    total = density * thickness * length * width
    x, y = np.divmod(
        np.arange(len(mass)), len(ay)
    )  # freedoms along and across: deflection and slope by turns
    held = [x < 2, (x < 2) | (x >= 2 * ALONG), (x < 2) | (y < 2)][draw.integers(3)]
    places = np.flatnonzero((x % 2 == 0) & (y % 2 == 0) & ~held)
    machine = draw.choice(places)
    own = draw.uniform(0, total)
    mass[machine, machine] += own
    return _drawn_modes(draw, mass, stiffness, np.flatnonzero(~held), places, total + own)


def stepped_beam(draw: Generator) -> ModalModel:
    """Return a cantilever of three depths with a mass at its end that turns with it."""
    (young, density), width = (STEEL, ALUMINIUM)[draw.integers(2)], draw.uniform(0.02, 0.06)
    length = draw.uniform(0.4, 2.0)
    depth = np.repeat(draw.uniform(0.006, 0.02, 3), STEPS // 3)
    nodes = np.stack([np.linspace(0, length, STEPS + 1), np.zeros(STEPS + 1)], 1)
    per_length = density * width * depth
    mass, stiffness = assembled(
        nodes, [(k, k + 1) for k in range(STEPS)], young * width * depth**3 / 12, per_length
    )
    total = float(per_length.mean() * length)
    tip = draw.uniform(0.05, 1.0) * total
    mass[-3:, -3:] += np.diag([tip, tip, tip * (0.03 * length) ** 2])
    return _drawn_modes(
        draw, mass, stiffness, np.arange(3, len(mass)), np.arange(4, len(mass), 3), total + tip
    )


def two_storeys(draw: Generator) -> ModalModel:
    """Return a frame of two storeys that is clamped at both feet, each member of two elements; it is pushed and read sideways."""
    width = draw.uniform(0.5, 3.0)
    heights = np.cumsum([0, *draw.uniform(0.4, 2.0, 2)])
    nodes = [(x, float(y)) for x in (0.0, width) for y in heights]
    pairs = [(0, 1), (1, 2), (3, 4), (4, 5), (1, 4), (2, 5)]
    bending, per_length = np.exp(draw.normal(np.log([3e3, 4.0]), 0.4, (len(pairs), 2))).T
    members = []
    for k, (a, b) in enumerate(pairs):
        nodes.append(tuple(np.mean([nodes[a], nodes[b]], axis=0)))
        members += [(a, 6 + k), (6 + k, b)]
    at = np.array(nodes)
    mass, stiffness = assembled(at, members, np.repeat(bending, 2), np.repeat(per_length, 2))
    free = np.setdiff1d(np.arange(len(mass)), [0, 1, 2, 9, 10, 11])
    total = float(
        sum(m * np.hypot(*(at[b] - at[a])) for m, (a, b) in zip(per_length, pairs, strict=True))
    )
    return _drawn_modes(draw, mass, stiffness, free, np.arange(0, len(mass), 3), total)


def measured(draw: Generator) -> ModalModel:
    """Return a modal model of four to eight modes, each with its own damping around what is drawn for all."""
    number = int(draw.integers(4, 9))
    total = float(np.exp(draw.uniform(0, 4)))
    omega = 2 * np.pi * draw.uniform(10, 80) * np.cumprod([1, *draw.uniform(1.3, 2.5, number - 1)])
    shapes = draw.normal(0, 1 / np.sqrt(0.4 * total), (3, number))
    return ModalModel(
        omega,
        np.exp(draw.normal(0, 0.3, number)),
        shapes[0],
        shapes[1],
        total,
        response_shape=shapes[2],
    )


FAMILIES: tuple[Callable[[Generator], ModalModel], ...] = (
    machine_plate,
    stepped_beam,
    two_storeys,
    measured,
)


def drawn(seed: int) -> Case:
    """Return the case of a seed."""
    draw = np.random.default_rng(seed)
    family = FAMILIES[seed % len(FAMILIES)]
    while True:
        ratio = float(np.exp(draw.uniform(*np.log(DAMPING))))
        resonance = int(draw.integers(1, 5))
        share = float(draw.uniform(*SHARES))
        model = family(draw)
        model = replace(model, damping_ratio=np.clip(ratio * model.damping_ratio, *DAMPING))
        if REACH[0] <= reach(model, share * model.beam_mass, resonance) <= REACH[1]:
            return Case(
                f"{family.__name__.replace('_', ' ')} {seed}",
                partial(replace, model),
                resonance,
                round(share, 4),
            )


DRAWN = tuple(drawn(seed) for seed in SEEDS)
