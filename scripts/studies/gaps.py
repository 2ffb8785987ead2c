"""The quality of the answers of `design_gap`: twenty structures, and fine scans of their gaps judged by the same criterion on the same members.

The structures are beams, plates, frames and modal models, none of them the paper's beam. Plates are Kirchhoff's by Ritz's method, with Legendre
polynomials times what the held edges ask for; portal frames are plane Euler-Bernoulli finite elements. The force does not matter, as gap and friction
are in proportion to it. SI units.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import Legendre, leggauss

from impact_env import Beam, CoulombFriction, ModalModel, Scene, SlidingAbsorber
from impact_env.curve import CurveCase, performance_curves
from impact_env.drive import PAPER_RATE
from impact_env.ensemble import Executor
from impact_env.structures.matrices import lowest_modes
from optimisation.bounds import expected_gap
from optimisation.gap_advice import FASTER, MEMBERS, TOLERANCE, Advice, advise
from optimisation.gap_check import scaled_absorber
from optimisation.mounting import mounted
from studies.study import Array, Json, there

Point = tuple[float, float]
FORCE = 1.0  # N
MODES, TERMS = 10, 8  # modes kept; polynomials along each edge of a plate
HELD = {"free": (0, 0), "clamped": (2, 2), "pinned": (1, 1), "cantilever": (2, 0)}  # zeros of the deflection at the two ends of an edge


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
        np.array([[f.deriv(d)((points + 1) / 2) / side**d if d else f((points + 1) / 2) for f in _functions(edge)] for d in range(3)])
        for edge, side in zip(held, sides, strict=True)
    ]
    area = sides[0] * sides[1] / 4
    xx, yy, xy, w = (np.einsum("ip,jq->ijpq", tables[0][a], tables[1][b]).reshape(TERMS**2, -1) for a, b in ((2, 0), (0, 2), (1, 1), (0, 0)))
    measure = area * np.outer(weights, weights).ravel()

    def product(first: Array, second: Array) -> Array:
        return np.asarray((first * measure) @ second.T)

    cross = product(xx, yy)
    stiffness = product(xx, xx) + product(yy, yy) + poisson * (cross + cross.T) + 2 * (1 - poisson) * product(xy, xy)
    return product(w, w), stiffness


def plate(held: tuple[str, str], sides: Point, thickness: float, places: tuple[Point, Point, Point], damping: float, material: Point) -> ModalModel:
    """Return a plate held along x and y (`HELD`); sides and thickness in m; places of force, absorber and response as shares of the sides."""
    (young, density), (force, absorber, response) = material, places
    mass, stiffness = _bending(held, sides, 0.3)
    rigidity = young * thickness**3 / (12 * (1 - 0.3**2))
    modes = lowest_modes(density * thickness * mass, rigidity * stiffness, MODES)

    def shape(place: Point) -> Array:
        values = [[f(x) for f in _functions(edge)] for edge, x in zip(held, place, strict=True)]
        return np.asarray(np.outer(values[0], values[1]).ravel() @ modes.shapes)

    ratios = np.full(MODES, damping)
    return ModalModel(modes.omega, ratios, shape(force), shape(absorber), density * thickness * sides[0] * sides[1], response_shape=shape(response))


ELEMENTS = 6  # of each member of a frame


def frame(width: float, height: float, bending: float, per_length: float, force: int, absorber: int, response: int, damping: float) -> ModalModel:
    """Return a portal frame that is clamped at both feet: its bending stiffness in N m^2 and mass in kg/m, and sideways motion at three nodes.

    Nodes go up the left column, along the beam and down the right column, `ELEMENTS` a member. Members do not stretch noticeably.
    """
    corners = np.array([[0, 0], [0, height], [width, height], [width, 0]])
    steps = np.linspace(0, 1, ELEMENTS, endpoint=False)
    nodes = np.vstack([a + steps[:, None] * (b - a) for a, b in itertools.pairwise(corners)] + [corners[-1:]])
    pairs = list(itertools.pairwise(range(len(nodes))))
    mass, stiffness = assembled(nodes, pairs, np.full(len(pairs), bending), np.full(len(pairs), per_length))
    inner = slice(3, len(mass) - 3)
    modes = lowest_modes(mass[inner, inner], stiffness[inner, inner], MODES)
    force_shape, tip, read = (modes.shapes[3 * (node - 1)] for node in (force, absorber, response))
    return ModalModel(modes.omega, np.full(MODES, damping), force_shape, tip, per_length * (2 * height + width), response_shape=read)


def assembled(nodes: Array, members: Sequence[tuple[int, int]], bending: Array, per_length: Array) -> tuple[Array, Array]:
    """Return (mass, stiffness) of a plane frame: places of its nodes (n, 2), and the two nodes, N m^2 and kg/m of each member.

    Three freedoms a node: along both axes, and turn.
    """
    mass, stiffness = np.zeros((2, 3 * len(nodes), 3 * len(nodes)))
    for (first, second), rigidity, own in zip(members, bending, per_length, strict=True):
        x, y = nodes[second] - nodes[first]
        length = float(np.hypot(x, y))
        both = np.kron(np.eye(2), [[x / length, y / length, 0], [-y / length, x / length, 0], [0, 0, 1]])
        at = np.ix_(*2 * [[3 * node + k for node in (first, second) for k in range(3)]])
        mass[at] += own * both.T @ _inertia(length) @ both
        stiffness[at] += rigidity * both.T @ _stiffness(length) @ both
    return mass, stiffness


def hermite(length: float, elements: int) -> tuple[Array, Array, Array, Array]:
    """Return integrals over a line of cubic Hermite elements, deflection and slope by turns: of N N, N' N', N'' N'' and N'' N."""
    found = np.zeros((4, 2 * elements + 2, 2 * elements + 2))
    step, bend = length / elements, [1, 2, 4, 5]
    b = 3 * step
    rows = [[36, b, -36, b], [b, 4 * step**2, -b, -(step**2)], [-36, -b, 36, -b], [b, -(step**2), -b, 4 * step**2]]
    slopes = np.array(rows) / (30 * step)
    ends = np.zeros((4, 4))
    ends[1, 0], ends[3, 2] = -1, 1  # slope times deflection at the ends of an element, by parts
    for k in range(elements):
        at = slice(2 * k, 2 * k + 4)
        for total, own in zip(found, (_inertia(step)[np.ix_(bend, bend)], slopes, _stiffness(step)[np.ix_(bend, bend)], ends - slopes), strict=True):
            total[at, at] += own
    return tuple(found)  # type: ignore[return-value]


def _inertia(length: float) -> Array:
    """Return an element's mass matrix (6, 6) over its mass per length: freedoms are motion along, across and turn at either end."""
    found = np.zeros((6, 6))
    found[np.ix_([0, 3], [0, 3])] = length * np.array([[2, 1], [1, 2]]) / 6
    a, b = 22 * length, 13 * length
    rows = [[156, a, 54, -b], [a, 4 * length**2, b, -3 * length**2], [54, b, 156, -a], [-b, -3 * length**2, -a, 4 * length**2]]
    found[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = length * np.array(rows) / 420
    return found


def _stiffness(length: float) -> Array:
    """Return an element's stiffness matrix (6, 6) over its bending stiffness; it is 1000 times as stiff along as a slenderness of 1 gives."""
    found = np.zeros((6, 6))
    found[np.ix_([0, 3], [0, 3])] = 1e5 / length * np.array([[1, -1], [-1, 1]])
    a = 6 * length
    rows = [[12, a, -12, a], [a, 4 * length**2, -a, 2 * length**2], [-12, -a, 12, -a], [a, 2 * length**2, -a, 4 * length**2]]
    found[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = np.array(rows) / length**3
    return found


def storeys(number: int, damping: float, force: int, absorber: int) -> ModalModel:
    """Return a shear building of equal storeys, 1 t and 2 MN/m each; force and absorber at storeys counted from 1. Its modes are sines."""
    k = np.arange(1, number + 1)
    angle = (2 * k - 1) * np.pi / (2 * number + 1)
    omega = 2 * np.sqrt(2e6 / 1e3) * np.sin(angle / 2)
    shapes = np.sin(np.outer(k, angle)) * np.sqrt(4 / (2 * number + 1) / 1e3)
    return ModalModel(omega, np.full(number, damping), shapes[force - 1], shapes[absorber - 1], 1e3 * number)


def modal(hertz: tuple[float, ...], damping: tuple[float, ...], force: tuple[float, ...], tip: tuple[float, ...], mass: float) -> ModalModel:
    """Return a model of measured numbers: frequencies in Hz, damping ratios, mass-normalised shapes in 1/sqrt(kg), mass in kg."""
    return ModalModel(2 * np.pi * np.array(hertz), np.array(damping), np.array(force), np.array(tip), mass)


STEEL, ALUMINIUM = (210e9, 7850.0), (70e9, 2700.0)


def beam(material: tuple[float, float], length: float, width: float, depth: float, **given: object) -> Beam:
    """Return a beam of rectangular section (m) of a material's Young's modulus (Pa) and density (kg/m^3)."""
    young, density = material
    return Beam(length=length, bending_stiffness=young * width * depth**3 / 12, mass_per_length=density * width * depth, **given)  # type: ignore[arg-type]


def boom(damping: float = 0.008) -> Beam:
    """Return a cantilever with a tip mass."""
    return Beam(length=0.8, bending_stiffness=875.0, mass_per_length=3.925, tip_mass=0.4, damping_ratio=damping, force_position=0.3)


def shelf(damping: float = 0.006) -> ModalModel:
    """Return a steel plate that is clamped along one edge."""
    return plate(("cantilever", "free"), (0.4, 0.3), 0.004, ((0.5, 0.25), (1.0, 0.9), (0.9, 0.7)), damping, STEEL)


CASES = (
    Case("boom", boom, 1),
    Case("boom", boom, 2),
    Case("shelf", shelf, 1),
    Case("shelf", shelf, 2),
    Case("mast, 0.3 % damping", lambda: beam(STEEL, 2.0, 0.06, 0.02, damping_ratio=0.003, force_position=0.2), 1, 0.01),
    Case("mast, 0.3 % damping", lambda: beam(STEEL, 2.0, 0.06, 0.02, damping_ratio=0.003, force_position=0.2), 3, 0.02),
    Case("bridge", lambda: beam(ALUMINIUM, 1.5, 0.05, 0.01, damping_ratio=0.012, ends="pinned-pinned", force_position=0.3, absorber_position=0.5)),
    Case(
        "bridge off its middle",
        lambda: beam(ALUMINIUM, 1.5, 0.05, 0.01, damping_ratio=0.005, ends="pinned-pinned", force_position=0.3, absorber_position=0.22),
        2,
        0.03,
    ),
    Case("beam between clamps", lambda: beam(STEEL, 0.9, 0.03, 0.01, damping_ratio=0.0035, ends="clamped-clamped", absorber_position=0.5), 1, 0.045),
    Case("beam between clamps", lambda: beam(STEEL, 0.9, 0.03, 0.01, damping_ratio=0.027, ends="clamped-clamped", absorber_position=0.45), 1, 0.05),
    Case("propped beam", lambda: beam(ALUMINIUM, 1.0, 0.04, 0.008, damping_ratio=0.0012, ends="clamped-pinned", absorber_position=0.6), 1, 0.006),
    Case("propped beam", lambda: beam(ALUMINIUM, 1.0, 0.04, 0.008, damping_ratio=0.004, ends="clamped-pinned", absorber_position=0.7), 2, 0.015),
    Case(
        "floor panel, simply supported",
        lambda: plate(("pinned", "pinned"), (0.8, 0.5), 0.003, ((0.3, 0.35), (0.5, 0.5), (0.4, 0.6)), 0.01, ALUMINIUM),
    ),
    Case(
        "window, clamped all around",
        lambda: plate(("clamped", "clamped"), (0.6, 0.45), 0.005, ((0.4, 0.3), (0.7, 0.5), (0.3, 0.5)), 0.015, (70e9, 2500.0)),
        2,
        0.04,
    ),
    Case("wide shelf", lambda: plate(("cantilever", "free"), (0.25, 0.6), 0.003, ((0.4, 0.2), (1.0, 0.85), (1.0, 0.15)), 0.003, STEEL), 2, 0.03),
    Case("portal frame", lambda: frame(1.2, 0.8, 1400.0, 3.1, 3, 6, 12, 0.006), 1, 0.02),
    Case("portal frame", lambda: frame(1.2, 0.8, 1400.0, 3.1, 2, 3, 15, 0.007), 3, 0.03),
    Case("five storeys", lambda: storeys(5, 0.02, 2, 5), 1, 0.04),
    Case("five storeys", lambda: storeys(5, 0.005, 5, 5), 2, 0.01),
    Case(
        "measured bracket",
        lambda: modal((31.2, 74.6, 128.0, 201.5), (0.011, 0.007, 0.009, 0.013), (0.21, 0.34, -0.28, 0.19), (0.9, -0.8, 0.85, -1.1), 6.5),
        4,
        0.02,
    ),
)


STEP, FROM, TO = 0.05, -1.225, 1.1  # of ln (gap over the rule's); half a step off the gaps that a search tries
WITHIN, BESIDE = 1.5, 2  # gaps are run in full where a look is within this of the lowest, and so many beside
FRESH, UNSEEN = 12, 1  # members by which the scan's lowest gap is judged anew, and their seed


class Settings(NamedTuple):
    """The cases, runs for each gap, the scan's step of ln gap, the sweeps' rate (None: the default), and runs that judge (None: the search's)."""

    cases: tuple[Case, ...]
    members: int = MEMBERS
    step: float = STEP
    rate: float | None = None
    judges: int | None = None
    threads: int | None = None
    executor: Executor | None = None


def row(case: Case, given: Settings) -> list[Json]:
    """Return a case's one row; raises KeyboardInterrupt if it is stopped."""
    model = case.model()
    absorber = scaled_absorber(model, FORCE, case.resonance, case.mass_ratio)
    where: Json = {"threads": given.threads, "executor": given.executor}
    found = advise(model, FORCE, case.resonance, absorber, members=given.members, percent_per_100_periods=given.rate, **where)
    if not found.complete or found.sharp is None or found.recommended is None:
        raise KeyboardInterrupt
    check = found.check
    fit = float(expected_gap(model, check.mass, FORCE, case.resonance))
    best = found.recommended.gap  # and what it is under more and less force
    told = np.log(np.array([found.sharp.gap, best / (1 + TOLERANCE), best, best / (1 - TOLERANCE), check.rule, fit]) / check.rule)
    grid = np.arange(FROM, TO, given.step)
    own = {told[0]: found.sharp.absorber, told[2]: found.recommended.absorber}  # the very devices: runs part from those of other last digits

    def levels(at: Sequence[float] | Array, number: int, speed: float, first: int = 0, seed: int = 0) -> Array:
        scenes = [Scene(model, own[x] if x in own else scaled(check.absorber, float(np.exp(x)))) for x in at]
        cases = [CurveCase(scene, np.array([FORCE]), case.resonance, check.limits, speed) for scene in scenes]
        curves = performance_curves(cases, number, seed, **where)
        if not all(curve.complete for curve in curves):
            raise KeyboardInterrupt
        return np.array([np.median(curve.combined[0, first:]) for curve in curves])

    looked = levels(grid, 1, min(PAPER_RATE, FASTER * check.rate))
    near = grid[np.convolve(looked <= WITHIN * looked.min(), np.ones(2 * BESIDE + 1), "same") > 0]  # and those beside
    at = np.union1d(near, told)
    full = levels(at, given.judges or given.members, check.rate)
    again = levels([told[0], at[np.argmin(full)]], FRESH + 1, check.rate, 1, UNSEEN)  # the first member of all ensembles is one and the same run
    return [judged(case, found, at, full, fit / check.rule, float(again[0] / again[1]))]


def scaled(absorber: SlidingAbsorber, factor: float) -> SlidingAbsorber:
    """Return an absorber with a multiple of its gap and of its friction limit."""
    walls, friction = absorber.walls, absorber.friction
    assert walls is not None
    return replace(
        absorber, walls=replace(walls, gap=walls.gap * factor), friction=None if friction is None else CoulombFriction(friction.limit * factor)
    )


def judged(case: Case, found: Advice, at: Array, full: Array, expected: float, fresh: float) -> Json:
    """Return the row of medians ``full`` (m) at ``at``, ln of gaps over the rule's, rising. Its levels are medians over the lowest of the scan.

    ``recommended`` is the worst over the tolerance, over the lowest such. ``fresh``: the level of `sharp` over that at the scan's lowest gap, both
    with members that neither was chosen by. ``best`` is the best gap over the rule's; ``rule``, ``expected``: the levels at the rule's gap and at
    the fit of `expected_gap`. ``relative``: the lowest level over that without absorber.
    """

    def between(x: Array | float) -> Array:
        beyond = np.maximum(np.asarray(x) - at[-1], 0.0)  # in proportion to the gap
        return np.asarray(np.exp(np.interp(x, at, np.log(full)) + beyond))

    shares = (1 - TOLERANCE, 1.0, 1 + TOLERANCE)
    inside = at[at - np.log1p(TOLERANCE) >= at[0]]
    worst = np.max([k * between(inside - np.log(k)) for k in shares], axis=0)
    sharp, robust = (np.log(there(answer).gap / found.check.rule) for answer in (found.sharp, found.recommended))
    lowest = full.min()
    return {
        "name": case.name, "resonance": case.resonance, "damping": float(case.model().damping_ratio[case.resonance - 1]),
        "mass_ratio": case.mass_ratio, "reach": found.check.reach, "best": float(np.exp(at[np.argmin(full)])),
        "relative": float(lowest / found.check.without.median[0]), "sharp": float(between(sharp) / lowest), "fresh": fresh,
        "recommended": float(max(k * between(robust - np.log(k)) for k in shares) / worst.min()), "rule": float(between(0.0) / lowest),
        "expected": float(between(np.log(expected)) / lowest), "sweeps": found.sweeps, "gaps": len(at),
    }  # fmt: skip
